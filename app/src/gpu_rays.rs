//! Rays traced on a GPU.

use anyhow::Result;
use isophote_scene::{Hit, Ray, gpu::RayBatch};

use crate::{
    caster::Answered,
    gpu::Gpu,
    output::timed,
    tracers::{GpuTracerChoice, Plan},
};

/// A scene and a tracer on a GPU, ready for rays.
pub(crate) struct GpuRays {
    pub(crate) gpu: Gpu,
    batch: RayBatch,
}

impl GpuRays {
    /// As [`Gpu::build`].
    pub(crate) fn build(
        choice: GpuTracerChoice,
        adapter: Option<&str>,
        plan: &Plan<'_>,
    ) -> Result<Self> {
        let gpu = Gpu::build(choice, adapter, plan)?;
        let mut rays = Self {
            batch: RayBatch::new(&gpu.context, &gpu.scene, &*gpu.tracer)?,
            gpu,
        };
        // Drivers compile shaders when they are first used, which belongs to building.
        rays.closest(&[Ray::new(glam::Vec3::ZERO, glam::Vec3::ZERO)])?;
        rays.any(&[Ray::new(glam::Vec3::ZERO, glam::Vec3::ZERO)])?;
        Ok(rays)
    }

    pub(crate) fn closest(&mut self, rays: &[Ray]) -> Result<Answered<Option<Hit>>> {
        let mut hits = vec![None; rays.len()];
        let Self { gpu, batch } = self;
        let (context, scene, tracer) = (&gpu.context, &gpu.scene, &*gpu.tracer);
        let (done, seconds) = timed(|| batch.closest_hits(context, scene, tracer, rays, &mut hits));
        done?;
        Ok(self.answers(hits, seconds))
    }

    pub(crate) fn any(&mut self, rays: &[Ray]) -> Result<Answered<bool>> {
        let mut hits = vec![false; rays.len()];
        let Self { gpu, batch } = self;
        let (context, scene, tracer) = (&gpu.context, &gpu.scene, &*gpu.tracer);
        let (done, seconds) = timed(|| batch.any_hits(context, scene, tracer, rays, &mut hits));
        done?;
        Ok(self.answers(hits, seconds))
    }

    fn answers<T>(&mut self, hits: Vec<T>, seconds: f64) -> Answered<T> {
        let kernel = self.batch.take_kernel_time().as_secs_f64();
        Answered {
            hits,
            seconds,
            kernel_seconds: (kernel > 0.0).then_some(kernel),
        }
    }
}
