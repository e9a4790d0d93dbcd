//! Light transport: a path from the eye, light sampled at each of its surfaces.
//!
//! Both ways of finding an emitter, sampling it and hitting it by a scattered ray, are weighted by the power
//! heuristic with exponent 2 (Veach 1997, §9.2). Contributions are kept by the number of surfaces the light has
//! met: one is `direct`, two `indirect`, all of them `path`.

use std::f32::consts::PI;

use glam::Vec3;

use super::{Bounces, Integrator, Materials, facing, light_sampling::Incoming};
use crate::{Bsdf, Ray, SurfaceMaterial, SurfacePoint, Tracer, sample::Sampler};

/// The first dimension pair of a path; each bounce takes [`PER_BOUNCE`] of them.
const FIRST_DIMENSION: u32 = 2;
const PER_BOUNCE: u32 = 5;

/// Light by the number of surfaces it has met.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ByBounces {
    pub(super) direct: Vec3,
    pub(super) indirect: Vec3,
    pub(super) path: Vec3,
}

impl ByBounces {
    fn add(&mut self, value: Vec3, bounce: u32, bound: f32, path_bounces: u32) {
        // Nothing that is not finite leaves this stage.
        let value = if value.is_finite() { value } else { Vec3::ZERO };
        match bounce {
            1 => self.direct += value,
            2 => self.indirect += value * bound,
            _ => {}
        }
        if bounce <= path_bounces {
            self.path += value;
        }
    }
}

impl<E: Tracer + ?Sized, S: Tracer + ?Sized> Integrator<'_, E, S> {
    /// One path. With `irradiance` the first surface reflects as a BRDF of 1 would, so that what leaves it is the
    /// irradiance that arrives.
    pub(super) fn light(
        &self,
        point: &SurfacePoint,
        view: Vec3,
        sampler: &Sampler,
        bounces: Bounces,
        irradiance: bool,
        rays: &mut u64,
    ) -> ByBounces {
        let mut sum = ByBounces::default();
        let limit = self.settings.path_bounces;
        let (mut point, mut view, mut throughput) = (*point, view, Vec3::ONE);
        // How much MS10's bound leaves of light that goes on to the second surface.
        let mut bound = 1.0;
        for bounce in 1..=bounces.last {
            let material = self.scene.surface_material(&point);
            // The irradiance of an unlit surface is known, but it reflects none of it.
            if material.unlit && !(irradiance && bounce == 1) {
                if bounce == 1 {
                    sum.add(material.base_color, 1, 1.0, limit);
                }
                break;
            }
            let bsdf = self.bsdf(&point, view, &material, irradiance && bounce == 1);
            let dimension = FIRST_DIMENSION + PER_BOUNCE * (bounce - 1);
            if bounce >= bounces.first {
                let arriving =
                    self.sampled_light(&point, view, &bsdf, sampler, dimension, bounce == 1, rays);
                sum.add(throughput * arriving, bounce, bound, limit);
            }
            // Beyond the last surface there are only emitters to be found.
            if bounce == bounces.last && !self.lights.can_be_hit() {
                break;
            }
            let lobe = sampler.get_1d(dimension + 3);
            let Some(sample) = bsdf.sample(view, lobe, sampler.get_2d(dimension + 4)) else {
                break;
            };
            throughput *= sample.weight;
            let tracer = self.tracers.secondary;
            let origin = point.lifted(sample.light, tracer.tolerance(point.position));
            *rays += 1;
            let hit = tracer.closest_hit_from(&Ray::new(origin, sample.light), point.surface);
            let Some(hit) = hit else {
                let found = self.scene.environment.radiance(sample.light);
                let weight = power_heuristic(sample.pdf, self.lights.environment_pdf(sample.light));
                if bounce >= bounces.first {
                    sum.add(throughput * found * weight, bounce, bound, limit);
                }
                break;
            };
            let next = self.with_normals(self.scene.surface_point(&hit));
            if bounce >= bounces.first {
                let found = self.scene.surface_material(&next).emissive;
                if found != Vec3::ZERO {
                    let pdf = self
                        .lights
                        .emitter_pdf_at(&next, point.position, sample.light);
                    let weight = power_heuristic(sample.pdf, pdf);
                    sum.add(throughput * found * weight, bounce, bound, limit);
                }
            }
            if bounce == 1 {
                bound = super::bound(self.settings.min_d, hit.t);
            }
            (point, view) = (next, -sample.light);
        }
        sum
    }

    /// Light of one direction towards each group of lights, scattered towards the viewer.
    #[expect(
        clippy::too_many_arguments,
        reason = "the state of a path's vertex, used once"
    )]
    fn sampled_light(
        &self,
        point: &SurfacePoint,
        view: Vec3,
        bsdf: &Bsdf,
        sampler: &Sampler,
        dimension: u32,
        first: bool,
        rays: &mut u64,
    ) -> Vec3 {
        let choices = sampler.get_2d(dimension + 2);
        let contribution = |direction: Vec3, irradiance: Vec3| {
            (bsdf.evaluate(view, direction) * irradiance).element_sum()
        };
        let position = point.position;
        let samples = [
            self.lights
                .sample_lights(position, choices.x, sampler.get_2d(dimension), contribution),
            self.lights
                .sample_emitters(position, choices.y, sampler.get_2d(dimension + 1)),
            self.lights.sample_environment(sampler.get_2d(dimension)),
        ];
        let mut sum = Vec3::ZERO;
        for incoming in samples.into_iter().flatten() {
            let scattered = bsdf.evaluate(view, incoming.direction) * incoming.weight;
            if scattered == Vec3::ZERO {
                continue;
            }
            *rays += 1;
            let visible = if first {
                visible(self.tracers.exact, point, &incoming)
            } else {
                visible(self.tracers.secondary, point, &incoming)
            };
            if visible {
                sum +=
                    scattered * power_heuristic(incoming.pdf, bsdf.pdf(view, incoming.direction));
            }
        }
        sum
    }

    fn bsdf(
        &self,
        point: &SurfacePoint,
        view: Vec3,
        material: &SurfaceMaterial,
        irradiance: bool,
    ) -> Bsdf {
        let normal = facing(point.shading_normal, view);
        let outside = point.shading_normal.dot(view) >= 0.0;
        match self.settings.materials {
            _ if irradiance => Bsdf::diffuse(normal, Vec3::splat(PI)),
            Materials::Lambert => Bsdf::diffuse(normal, material.base_color),
            Materials::Pbr => Bsdf::new(normal, material, outside),
        }
    }
}

/// Whether nothing is between a point and a light.
pub(crate) fn visible<T: Tracer + ?Sized>(
    tracer: &T,
    point: &SurfacePoint,
    incoming: &Incoming,
) -> bool {
    let tolerance = tracer.tolerance(point.position);
    let origin = point.lifted(incoming.direction, tolerance);
    let mut ray = Ray::new(origin, incoming.direction);
    if let Some(end) = incoming.end {
        // From the lifted origin, so that the end stays before the surface it was lifted from.
        let distance = (end - origin).length();
        ray = Ray::new(origin, (end - origin) / distance).until(distance - tolerance);
    }
    !tracer.any_hit_from(&ray, point.surface)
}

/// The share of a choice with density `a` that another way with density `b` could have made too. An infinite
/// density is one the other way cannot reach.
fn power_heuristic(a: f32, b: f32) -> f32 {
    if a.is_infinite() {
        return 1.0;
    }
    let (a2, b2) = (a * a, b * b);
    if a2 + b2 > 0.0 { a2 / (a2 + b2) } else { 0.0 }
}
