//! Stages 3 and 5: secondary rays, and what they bring back.
//!
//! The rays of many pixels are traced together, so that a tracer can sort them by direction. The surface a ray hits is
//! lit by the lights alone (a single bounce) and reflects diffusely; its texture is read at a coarse level, since a
//! secondary ray stands for a wide cone (§5).

use std::f32::consts::PI;

use glam::Vec3;
use isophote_scene::{
    Bsdf, Hit, MIRROR_ROUGHNESS, Ray, SurfaceMaterial, Tracer,
    sample::{Frame, Sampler, cosine_hemisphere},
};
use rayon::prelude::*;

use super::{
    Hybrid,
    fragments::{Fragment, Fragments},
};

/// Fragments whose rays are traced together.
const CHUNK: usize = 8192;

/// What secondary rays brought back, one value per fragment.
pub(super) struct Gathered {
    pub(super) light: Vec<Vec3>,
    pub(super) rays: u64,
}

/// A secondary ray, and what its light counts for its fragment.
struct Secondary {
    ray: Ray,
    weight: Vec3,
    fragment: usize,
}

impl<E: Tracer + ?Sized, S: Tracer + ?Sized> Hybrid<'_, E, S> {
    /// Stage 3: irradiance. With density cosθ/π it is π times the mean of the radiance.
    pub(super) fn diffuse(&self, fragments: &Fragments) -> Gathered {
        let count = self.params.diffuse_rays;
        self.gather(fragments, 1, |fragment, stream, rays| {
            if fragment.diffuse == Vec3::ZERO {
                return;
            }
            let frame = Frame::new(facing(fragment.point.shading_normal, fragment.view));
            for number in 0..count {
                let sampler = Sampler::new(self.params.seed, stream, number);
                let direction = frame.to_world(cosine_hemisphere(sampler.get_2d(1)));
                rays(direction.normalize(), Vec3::splat(PI / count as f32));
            }
        })
    }

    /// Stage 5: radiance by the metal lobe. A mirror takes one ray.
    pub(super) fn glossy(&self, fragments: &Fragments) -> Gathered {
        self.gather(fragments, 2, |fragment, stream, rays| {
            let material = &fragment.material;
            if material.metallic == 0.0 {
                return;
            }
            let metal = SurfaceMaterial {
                metallic: 1.0,
                base_color: material.base_color * material.metallic,
                ..*material
            };
            let count = if material.roughness < MIRROR_ROUGHNESS {
                1
            } else {
                self.params.glossy_rays
            };
            let normal = fragment.point.shading_normal;
            let outside = normal.dot(fragment.view) >= 0.0;
            let bsdf = Bsdf::new(facing(normal, fragment.view), &metal, outside);
            for number in 0..count {
                let sampler = Sampler::new(self.params.seed, stream, number);
                if let Some(sample) = bsdf.sample(fragment.view, 0.0, sampler.get_2d(1)) {
                    rays(sample.light, sample.weight / count as f32);
                }
            }
        })
    }

    /// Traces the rays that `make` chooses for each fragment (direction and weight) and sums up what they see.
    fn gather(
        &self,
        fragments: &Fragments,
        stage: u32,
        make: impl Fn(&Fragment, u32, &mut dyn FnMut(Vec3, Vec3)) + Sync,
    ) -> Gathered {
        let tracer = self.tracers.secondary;
        let chunk = |(number, fragments): (usize, &[Fragment])| {
            let mut secondary = Vec::new();
            for (index, fragment) in fragments.iter().enumerate() {
                let stream = (4 * (number * CHUNK + index)) as u32 + stage;
                let point = &fragment.point;
                let lift = tracer.tolerance(point.position);
                make(fragment, stream, &mut |direction, weight| {
                    // Below the surface there is nothing to be seen.
                    let side = facing(point.geometric_normal, fragment.view);
                    if direction.dot(side) > 0.0 {
                        secondary.push(Secondary {
                            ray: Ray::new(point.lifted(direction, lift), direction),
                            weight,
                            fragment: index,
                        });
                    }
                });
            }
            let rays: Vec<Ray> = secondary.iter().map(|one| one.ray).collect();
            let mut hits = vec![None; rays.len()];
            tracer.closest_hits(&rays, &mut hits);
            let mut light = vec![Vec3::ZERO; fragments.len()];
            for (index, (one, hit)) in secondary.iter().zip(&hits).enumerate() {
                if let Some(hit) = hit {
                    let stream = (number * CHUNK + one.fragment) as u32;
                    let sampler =
                        Sampler::new(self.params.seed ^ 1, 4 * stream + stage, index as u32);
                    light[one.fragment] +=
                        one.weight * self.leaving(hit, one.ray.direction, &sampler);
                }
            }
            (light, rays.len() as u64)
        };
        let parts: Vec<_> = fragments
            .all
            .par_chunks(CHUNK)
            .enumerate()
            .map(chunk)
            .collect();
        let rays = parts.iter().map(|part| part.1).sum();
        let light = parts.into_iter().flat_map(|part| part.0).collect();
        Gathered { light, rays }
    }

    /// Radiance that leaves a hit towards where the ray came from, by light straight from the lights.
    fn leaving(&self, hit: &Hit, direction: Vec3, sampler: &Sampler) -> Vec3 {
        let point = self.scene.surface_point(hit);
        let mut irradiance = [Vec3::ZERO];
        self.bounced
            .estimate(&point, -direction, sampler, &mut irradiance);
        let material = self
            .scene
            .surface_material_at(&point, self.params.texture_level);
        irradiance[0] * material.base_color / PI
    }
}

/// A normal, turned to the side of a direction.
fn facing(normal: Vec3, direction: Vec3) -> Vec3 {
    if normal.dot(direction) < 0.0 {
        -normal
    } else {
        normal
    }
}
