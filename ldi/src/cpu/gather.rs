//! Hybrid stages 3 and 5: secondary rays, and what they bring back.
//!
//! The rays of many pixels are traced together, so that a tracer can sort them by direction. The surface a ray hits is
//! lit by the lights alone (a single bounce); where it is diffuse its texture is read at a coarse level, since a
//! diffuse or glossy ray stands for a wide cone (§5); a mirror's does not.

use std::f32::consts::PI;

use glam::Vec3;
use isophote_scene::{
    Bsdf, Hit, MIRROR_ROUGHNESS, Ray, SurfaceId, SurfaceMaterial, Tracer, facing,
    reference::Materials,
    sample::{Frame, Sampler, cosine_hemisphere},
};
use rayon::prelude::*;

use super::{
    Hybrid, Meter,
    fragments::{Fragment, Fragments},
};

/// Rays that are traced together, and the most fragments they are of.
const BATCH: u32 = 1 << 18;
const MOST_FRAGMENTS: u32 = 8192;

/// The stages' own samples among a fragment's streams.
const DIFFUSE: u32 = 1;
const GLOSSY: u32 = 2;

/// A secondary ray, and what its light counts for its fragment.
struct Secondary {
    ray: Ray,
    weight: Vec3,
    start: SurfaceId,
    fragment: usize,
    /// Of the samples of its fragment.
    number: u32,
    level: f32,
}

/// A ray that a fragment asks for.
struct Wanted {
    direction: Vec3,
    weight: Vec3,
    /// Of the samples of the fragment.
    number: u32,
    /// The mip level of textures where it hits: a diffuse or glossy ray stands for a wide cone (§5), one by a mirror or
    /// through glass for itself.
    level: f32,
}

/// Light at every fragment; rays, and the shadow rays of what they hit.
type Gathered = (Vec<Vec3>, [u64; 2]);

impl<E: Tracer + ?Sized, S: Tracer + ?Sized> Hybrid<'_, E, S> {
    /// Hybrid stage 3: irradiance. With density cosθ/π it is π times the mean of the radiance.
    pub(super) fn diffuse(&self, fragments: &Fragments, meter: &Meter<'_>) -> Gathered {
        let most = self.params.diffuse_rays;
        self.gather(fragments, DIFFUSE, most, meter, |fragment, stream, want| {
            if fragment.diffuse == Vec3::ZERO {
                return;
            }
            let frame = Frame::new(fragment.normal());
            let count = fragment.rays(most);
            for number in 0..count {
                let sampler = Sampler::new(self.params.seed, stream, number);
                let direction = frame.to_world(cosine_hemisphere(sampler.get_2d(1)));
                want(Wanted {
                    direction: direction.normalize(),
                    weight: Vec3::splat(PI / count as f32),
                    number,
                    level: self.params.texture_level,
                });
            }
        })
    }

    /// Hybrid stage 5: radiance by the metal lobe and through glass. A mirror takes one ray.
    pub(super) fn glossy(&self, fragments: &Fragments, meter: &Meter<'_>) -> Gathered {
        let most = self.params.glossy_rays;
        self.gather(
            fragments,
            GLOSSY,
            2 * most,
            meter,
            |fragment, stream, want| {
                let material = &fragment.material;
                let glass = (1.0 - material.metallic) * material.transmission;
                let mirror = material.roughness < MIRROR_ROUGHNESS;
                // Of each lobe its material alone, how much of it there is, and its rays.
                let metal = SurfaceMaterial {
                    metallic: 1.0,
                    ..*material
                };
                let dielectric = SurfaceMaterial {
                    metallic: 0.0,
                    transmission: 1.0,
                    ..*material
                };
                let level = self.params.texture_level;
                let count = fragment.rays(most);
                let glassy = (dielectric, glass, count, 0.0);
                let lobes = if mirror {
                    [(metal, material.metallic, 1, 0.0), glassy]
                } else {
                    [(metal, material.metallic, count, level), glassy]
                };
                let outside = fragment.point.shading_normal.dot(fragment.view) >= 0.0;
                for (lobe, (material, share, count, level)) in lobes.into_iter().enumerate() {
                    if share == 0.0 {
                        continue;
                    }
                    let bsdf = Bsdf::new(fragment.normal(), &material, outside);
                    for number in 0..count {
                        let number = number + lobe as u32 * most;
                        let sampler = Sampler::new(self.params.seed, stream, number);
                        let choice = sampler.get_1d(2);
                        if let Some(sample) = bsdf.sample(fragment.view, choice, sampler.get_2d(1))
                        {
                            want(Wanted {
                                direction: sample.light,
                                weight: sample.weight * (share / count as f32),
                                number,
                                level,
                            });
                        }
                    }
                }
            },
        )
    }

    /// Traces the rays that `make` chooses for each fragment, at most `most`, and sums up what they see.
    fn gather(
        &self,
        fragments: &Fragments,
        stage: u32,
        most: u32,
        meter: &Meter<'_>,
        make: impl Fn(&Fragment, u32, &mut dyn FnMut(Wanted)) + Sync,
    ) -> Gathered {
        let size = (BATCH / most).clamp(1, MOST_FRAGMENTS) as usize;
        let stream = |fragment: &Fragment| 4 * fragment.sample + stage;
        let sharp = stage == GLOSSY;
        let chunk = |fragments: &[Fragment]| {
            let mut secondary = Vec::new();
            for (index, fragment) in fragments.iter().enumerate() {
                make(fragment, stream(fragment), &mut |wanted| {
                    secondary.extend(self.secondary(fragment, index, wanted));
                });
            }
            let hits = self.hits(&secondary);
            let mut light = vec![Vec3::ZERO; fragments.len()];
            let mut shadow_rays = 0;
            for (one, hit) in secondary.iter().zip(&hits) {
                if let Some(hit) = hit {
                    let stream = stream(&fragments[one.fragment]);
                    let sampler = Sampler::new(self.params.seed ^ 1, stream, one.number);
                    let (found, rays) = self.leaving(hit, one, sharp, &sampler);
                    light[one.fragment] += one.weight * found;
                    shadow_rays += rays;
                }
            }
            meter.advance(fragments.len());
            (light, [secondary.len() as u64, shadow_rays])
        };
        let parts: Vec<Gathered> = fragments.all.par_chunks(size).map(chunk).collect();
        let rays = [0, 1].map(|kind| parts.iter().map(|part| part.1[kind]).sum());
        let light = parts.into_iter().flat_map(|part| part.0).collect();
        (light, rays)
    }

    /// A ray that was asked for, unless it goes to one side by the shading normal and to the other by the triangle's.
    fn secondary(&self, fragment: &Fragment, index: usize, wanted: Wanted) -> Option<Secondary> {
        let Wanted {
            direction,
            weight,
            number,
            level,
        } = wanted;
        let point = &fragment.point;
        let side = facing(point.geometric_normal, fragment.view);
        if direction.dot(side) * direction.dot(fragment.normal()) <= 0.0 {
            return None;
        }
        let lift = self.tracers.secondary.tolerance(point.position);
        Some(Secondary {
            ray: Ray::new(point.lifted(direction, lift), direction),
            weight,
            start: point.surface,
            fragment: index,
            number,
            level,
        })
    }

    /// What the rays hit; not the triangle they start on.
    fn hits(&self, secondary: &[Secondary]) -> Vec<Option<Hit>> {
        let tracer = self.tracers.secondary;
        let rays: Vec<Ray> = secondary.iter().map(|one| one.ray).collect();
        let mut hits = vec![None; rays.len()];
        tracer.closest_hits(&rays, &mut hits);
        for (one, hit) in secondary.iter().zip(&mut hits) {
            // A batch knows of no starts, and they are hit next to never.
            if hit.is_some_and(|hit| hit.surface == one.start) {
                *hit = tracer.closest_hit_from(&one.ray, one.start);
            }
        }
        hits
    }

    /// Radiance that leaves a hit towards where the ray came from, by light straight from the lights; and the rays
    /// that took. Only `sharp` rays see metal and glass as such: of the highlights on them a few diffuse rays would find
    /// one now and then and make a spot of it, so for those all surfaces are diffuse.
    fn leaving(&self, hit: &Hit, by: &Secondary, sharp: bool, sampler: &Sampler) -> (Vec3, u64) {
        let view = -by.ray.direction;
        let point = self.scene.surface_point(hit);
        let material = self.scene.surface_material_at(&point, by.level);
        if material.unlit {
            return (Vec3::ZERO, 0);
        }
        let sharp = sharp && self.params.materials == Materials::Pbr;
        if sharp && (material.metallic > 0.0 || material.transmission > 0.0) {
            return self.lights.radiance(&point, view, sampler);
        }
        let (irradiance, rays) = self.lights.irradiance(&point, view, sampler);
        (irradiance * material.base_color / PI, rays)
    }
}
