//! Stage 4, direct and specular light (§4): a Whitted-style tree of rays from what the camera sees.
//!
//! What mirrors and glass show is kept as [`Mirrored`], to be lit by the virtual point lights too.

use std::f32::consts::PI;

use glam::Vec3;
use isophote_scene::{
    Bsdf, DirectLight, MIRROR_ROUGHNESS, Ray, Scene, Seen, SurfaceMaterial, SurfacePoint, Tracer,
    fresnel, reference::Materials, sample::Sampler,
};

use super::indirect::Receiver;
use crate::GiParams;

/// Rays that carry less than this share of a pixel's light are not followed.
const LEAST: f32 = 1e-3;

/// Who follows.
pub(super) struct Tree<'a, E: Tracer + ?Sized> {
    pub(super) scene: &'a Scene,
    pub(super) exact: &'a E,
    pub(super) direct: &'a DirectLight<'a, E>,
    pub(super) params: &'a GiParams,
}

/// A diffuse surface that a pixel shows in a mirror or through glass.
pub(super) struct Mirrored {
    pub(super) point: SurfacePoint,
    /// The shading normal on the viewer's side.
    pub(super) normal: Vec3,
    /// The pixel's radiance by its irradiance.
    pub(super) weight: Vec3,
    /// The pixel's number.
    pub(super) pixel: u32,
}

impl Mirrored {
    /// To be lit by all virtual point lights.
    pub(super) fn receiver(&self) -> Receiver<'_> {
        Receiver {
            point: &self.point,
            normal: self.normal,
            parts: 1,
            stream: self.pixel,
        }
    }
}

/// What a tree finds beside light.
#[derive(Default)]
pub(super) struct Found {
    pub(super) mirrored: Vec<Mirrored>,
    pub(super) rays: u64,
}

/// A ray to follow.
#[derive(Clone, Copy)]
struct Branch {
    direction: Vec3,
    weight: Vec3,
    /// Whether it alone finds the lights it meets: those of a highlight were asked already.
    sharp: bool,
}

impl<E: Tracer + ?Sized> Tree<'_, E> {
    /// Light that leaves what a pixel sees: straight from the lights, and by mirrors, glass and highlights. That of the
    /// virtual point lights is in neither.
    pub(super) fn light(&self, seen: &Seen, pixel: u32, found: &mut Found) -> [Vec3; 2] {
        let direct = self.direct_at(seen, pixel, &mut found.rays);
        [direct, self.reflected(seen, pixel, Vec3::ONE, 0, found)]
    }

    fn direct_at(&self, seen: &Seen, pixel: u32, rays: &mut u64) -> Vec3 {
        if seen.material.unlit {
            return seen.material.base_color;
        }
        let count = if self.direct.is_noisy() {
            self.params.light_rays
        } else {
            1
        };
        let bsdf = Bsdf::new(seen.normal(), &seen.material, seen.is_outside());
        let mut sum = Vec3::ZERO;
        for number in 0..count {
            let sampler = Sampler::new(self.params.seed, 4 * pixel, number);
            let (light, traced) = self
                .direct
                .scattered(&seen.point, seen.view, &bsdf, &sampler);
            sum += light;
            *rays += traced;
        }
        sum / count as f32
    }

    /// Light by the metal and the glass of a surface.
    fn reflected(
        &self,
        seen: &Seen,
        pixel: u32,
        throughput: Vec3,
        depth: u32,
        found: &mut Found,
    ) -> Vec3 {
        if depth == self.params.depth || self.params.materials == Materials::Lambert {
            return Vec3::ZERO;
        }
        let mut sum = Vec3::ZERO;
        self.branches(seen, pixel, depth, |branch| {
            let throughput = throughput * branch.weight;
            if throughput.max_element() > LEAST {
                sum +=
                    branch.weight * self.radiance(seen, &branch, pixel, throughput, depth, found);
            }
        });
        sum
    }

    /// The rays a surface asks for.
    fn branches(&self, seen: &Seen, pixel: u32, depth: u32, mut follow: impl FnMut(Branch)) {
        let SurfaceMaterial {
            metallic,
            transmission,
            roughness,
            ..
        } = seen.material;
        let (normal, view) = (seen.normal(), seen.view);
        let outside = seen.is_outside();
        if metallic > 0.0 {
            let metal = SurfaceMaterial {
                metallic: 1.0,
                ..seen.material
            };
            let bsdf = Bsdf::new(normal, &metal, outside);
            let mirror = roughness < MIRROR_ROUGHNESS;
            let count = if mirror || depth > 0 {
                1
            } else {
                self.params.glossy_rays
            };
            for number in 0..count {
                let sampler = Sampler::new(self.params.seed, 4 * pixel + 1, number);
                if let Some(sample) = bsdf.sample(view, 0.0, sampler.get_2d(depth)) {
                    follow(Branch {
                        direction: sample.light,
                        weight: sample.weight * (metallic / count as f32),
                        sharp: mirror,
                    });
                }
            }
        }
        let glass = (1.0 - metallic) * transmission;
        if glass > 0.0 {
            let clear = SurfaceMaterial {
                metallic: 0.0,
                transmission: 1.0,
                ..seen.material
            };
            let bsdf = Bsdf::new(normal, &clear, outside);
            let eta = if outside {
                seen.material.ior
            } else {
                1.0 / seen.material.ior
            };
            let (reflectance, _) = fresnel(normal.dot(view).clamp(0.0, 1.0), eta);
            // The lobe is chosen by the number it is given, below the reflectance to reflect.
            for (choice, share) in [
                (0.5 * reflectance, reflectance),
                (0.5 * (1.0 + reflectance), 1.0 - reflectance),
            ] {
                if share > 0.0
                    && let Some(sample) = bsdf.sample(view, choice, glam::Vec2::ZERO)
                {
                    follow(Branch {
                        direction: sample.light,
                        weight: sample.weight * (glass * share),
                        sharp: true,
                    });
                }
            }
        }
    }

    /// Radiance that a ray finds.
    fn radiance(
        &self,
        from: &Seen,
        branch: &Branch,
        pixel: u32,
        throughput: Vec3,
        depth: u32,
        found: &mut Found,
    ) -> Vec3 {
        let origin = from
            .point
            .lifted(branch.direction, self.exact.tolerance(from.point.position));
        let ray = Ray::new(origin, branch.direction);
        found.rays += 1;
        let Some(hit) = self.exact.closest_hit_from(&ray, from.point.surface) else {
            return if branch.sharp {
                self.scene.environment.radiance(branch.direction)
            } else {
                Vec3::ZERO
            };
        };
        let point = self.scene.surface_point(&hit);
        let seen = Seen::new(self.scene, point, -branch.direction, self.params.materials);
        let mut sum = self.direct_at(&seen, pixel, &mut found.rays);
        if branch.sharp {
            sum += seen.material.emissive;
        }
        let albedo = seen.albedo();
        if albedo != Vec3::ZERO {
            found.mirrored.push(Mirrored {
                point,
                normal: seen.normal(),
                weight: throughput * albedo / PI,
                pixel,
            });
        }
        sum + self.reflected(&seen, pixel, throughput, depth + 1, found)
    }
}
