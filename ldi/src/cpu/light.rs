//! Hybrid stage 2: light straight from the lights, shadows by rays.

use glam::Vec3;
use isophote_scene::{
    Scene, SurfacePoint, Tracer,
    reference::{Integrator, Materials, Quantity, Settings, Tracers},
    sample::Sampler,
};
use rayon::prelude::*;

use super::{Meter, fragments::Fragments};
use crate::{HybridParams, Result};

/// Fragments that a task lights.
const CHUNK: usize = 256;

/// The lights of a scene and who answers the rays towards them.
pub(super) struct Lights<'a, T: Tracer + ?Sized> {
    radiance: Integrator<'a, T, T>,
    irradiance: Integrator<'a, T, T>,
}

impl<'a, T: Tracer + ?Sized> Lights<'a, T> {
    pub(super) fn new(scene: &'a Scene, tracer: &'a T, params: &HybridParams) -> Result<Self> {
        let tracers = Tracers {
            exact: tracer,
            secondary: tracer,
        };
        let settings = Settings {
            materials: params.materials,
            seed: params.seed,
            ..Settings::default()
        };
        let lambert = Settings {
            materials: Materials::Lambert,
            ..settings
        };
        let irradiance = [Quantity::IrradianceDirect];
        Ok(Self {
            radiance: Integrator::new(scene, tracers, &[Quantity::Direct], &settings)?,
            irradiance: Integrator::new(scene, tracers, &irradiance, &lambert)?,
        })
    }

    /// Radiance at every fragment, and the number of rays. Lights with an extent take several.
    pub(super) fn direct(
        &self,
        fragments: &Fragments,
        params: &HybridParams,
        meter: &Meter<'_>,
    ) -> (Vec<Vec3>, u64) {
        let mut light = vec![Vec3::ZERO; fragments.all.len()];
        let rays = light
            .par_chunks_mut(CHUNK)
            .zip(fragments.all.par_chunks(CHUNK))
            .map(|(light, fragments)| {
                let mut rays = 0;
                for (light, fragment) in light.iter_mut().zip(fragments) {
                    let stream = 4 * fragment.sample;
                    let count = fragment.rays(params.light_rays);
                    for number in 0..count {
                        let sampler = Sampler::new(params.seed, stream, number);
                        let (found, traced) =
                            self.radiance(&fragment.point, fragment.view, &sampler);
                        *light += found / count as f32;
                        rays += traced;
                    }
                }
                meter.advance(fragments.len());
                rays
            })
            .sum();
        (light, rays)
    }

    /// One sample of the radiance that leaves a point, and its rays.
    pub(super) fn radiance(
        &self,
        point: &SurfacePoint,
        view: Vec3,
        sampler: &Sampler,
    ) -> (Vec3, u64) {
        let mut sum = [Vec3::ZERO];
        let rays = self.radiance.estimate(point, view, sampler, &mut sum);
        (sum[0], rays)
    }

    /// One sample of the irradiance of a point, and its rays.
    pub(super) fn irradiance(
        &self,
        point: &SurfacePoint,
        view: Vec3,
        sampler: &Sampler,
    ) -> (Vec3, u64) {
        let mut sum = [Vec3::ZERO];
        let rays = self.irradiance.estimate(point, view, sampler, &mut sum);
        (sum[0], rays)
    }
}
