//! Stage 3, direct and specular light (§4): a Whitted-style tree of rays from what the camera sees.
//!
//! What mirrors and glass show is lit by the virtual point lights too, here and at full resolution, since no grid of pixels
//! lies over it: the paper's hidden cost, which is counted apart.

use std::f32::consts::PI;

use glam::Vec3;
use isophote_scene::{
    Bsdf, DirectLight, MIRROR_ROUGHNESS, Ray, Scene, Seen, SurfaceMaterial, Tracer, fresnel,
    reference::Materials, sample::Sampler,
};

use super::indirect::{Gather, Receiver};
use crate::GiParams;

/// Rays that carry less than this share of a pixel's light are not followed.
const LEAST: f32 = 1e-3;

/// Who follows.
pub(super) struct Tree<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> {
    pub(super) scene: &'a Scene,
    pub(super) exact: &'a E,
    pub(super) direct: &'a DirectLight<'a, E>,
    pub(super) gather: &'a Gather<'a, E, S>,
    pub(super) params: &'a GiParams,
}

/// Light of a tree, and what it took.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Light {
    /// Straight from the lights.
    pub(super) direct: Vec3,
    /// By mirrors, glass and highlights.
    pub(super) specular: Vec3,
    pub(super) rays: u64,
    /// Towards virtual point lights, from what mirrors and glass show.
    pub(super) vpl_rays: u64,
}

/// A ray to follow.
#[derive(Clone, Copy)]
struct Branch {
    direction: Vec3,
    weight: Vec3,
    /// Whether it alone finds the lights it meets: those of a highlight were asked already.
    sharp: bool,
}

impl<E: Tracer + ?Sized, S: Tracer + ?Sized> Tree<'_, E, S> {
    /// Light that leaves what a pixel sees, without the indirect light of its diffuse part.
    pub(super) fn light(&self, seen: &Seen, stream: u32) -> Light {
        let mut light = Light::default();
        light.direct = self.direct_at(seen, stream, &mut light.rays);
        light.specular = self.reflected(seen, stream, Vec3::ONE, 0, &mut light);
        light
    }

    fn direct_at(&self, seen: &Seen, stream: u32, rays: &mut u64) -> Vec3 {
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
            let sampler = Sampler::new(self.params.seed, 4 * stream, number);
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
        stream: u32,
        throughput: Vec3,
        depth: u32,
        light: &mut Light,
    ) -> Vec3 {
        if depth == self.params.depth || self.params.materials == Materials::Lambert {
            return Vec3::ZERO;
        }
        let mut sum = Vec3::ZERO;
        self.branches(seen, stream, depth, |branch| {
            let throughput = throughput * branch.weight;
            if throughput.max_element() > LEAST {
                sum +=
                    branch.weight * self.radiance(seen, &branch, stream, throughput, depth, light);
            }
        });
        sum
    }

    /// The rays a surface asks for.
    fn branches(&self, seen: &Seen, stream: u32, depth: u32, mut follow: impl FnMut(Branch)) {
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
                let sampler = Sampler::new(self.params.seed, 4 * stream + 1, number);
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
        stream: u32,
        throughput: Vec3,
        depth: u32,
        light: &mut Light,
    ) -> Vec3 {
        let origin = from
            .point
            .lifted(branch.direction, self.exact.tolerance(from.point.position));
        let ray = Ray::new(origin, branch.direction);
        light.rays += 1;
        let Some(hit) = self.exact.closest_hit_from(&ray, from.point.surface) else {
            return if branch.sharp {
                self.scene.environment.radiance(branch.direction)
            } else {
                Vec3::ZERO
            };
        };
        let point = self.scene.surface_point(&hit);
        let seen = Seen::new(self.scene, point, -branch.direction, self.params.materials);
        let mut sum = self.direct_at(&seen, stream, &mut light.rays);
        if branch.sharp {
            sum += seen.material.emissive;
        }
        let albedo = seen.albedo();
        if albedo != Vec3::ZERO {
            let receiver = Receiver {
                point: &seen.point,
                normal: seen.normal(),
                part: [0, 1],
                stream,
            };
            let mut irradiance = [Vec3::ZERO];
            light.vpl_rays += self.gather.irradiance(&[receiver], &mut irradiance);
            sum += albedo / PI * irradiance[0];
        }
        sum + self.reflected(&seen, stream, throughput, depth + 1, light)
    }
}
