//! Rays traced on a GPU.

use std::sync::Arc;

use anyhow::Result;
use isophote_scene::{
    Hit, Ray, Scene, Selection,
    gpu::{
        AdapterChoice, BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, GpuTracer, RayBatch,
        RayQueryBoxTracer, RayQueryTracer,
    },
};

use crate::{output::timed, tracers::GpuTracerChoice};

/// A scene and a tracer on a GPU, ready for rays.
pub(crate) struct GpuRays {
    context: Context,
    scene: GpuScene,
    tracer: Box<dyn GpuTracer>,
    batch: RayBatch,
    /// Held by the tracer's own structures.
    pub(crate) bytes: usize,
}

/// Answers, and how long they took.
pub(crate) struct GpuAnswers<T> {
    pub(crate) hits: Vec<T>,
    /// With the way to the GPU and back.
    pub(crate) seconds: f64,
    /// By the GPU's own clock, where it has one.
    pub(crate) kernel_seconds: Option<f64>,
}

/// Whether there is a GPU that is hardware.
pub(crate) fn has_hardware() -> bool {
    isophote_scene::gpu::adapters()
        .iter()
        .any(|adapter| !adapter.is_software())
}

impl GpuRays {
    /// Opens an adapter, by a part of its name or the fastest there is, and builds the tracer on it.
    pub(crate) fn build(
        choice: GpuTracerChoice,
        adapter: Option<&str>,
        scene: &Arc<Scene>,
        selection: &Selection,
    ) -> Result<Self> {
        let adapter = adapter.map_or(AdapterChoice::Any, |name| AdapterChoice::Named(name.into()));
        let context = Context::open(&adapter)?;
        let (tracer, bytes) = match choice {
            GpuTracerChoice::ComputeBvh => build::<ComputeBvhTracer>(&context, scene, selection)?,
            GpuTracerChoice::RayQuery => build::<RayQueryTracer>(&context, scene, selection)?,
            GpuTracerChoice::Boxes => build::<RayQueryBoxTracer>(&context, scene, selection)?,
        };
        let scene = GpuScene::new(&context, scene)?;
        let mut rays = Self {
            batch: RayBatch::new(&context, &scene, &*tracer)?,
            context,
            scene,
            tracer,
            bytes: bytes as usize,
        };
        // Drivers compile shaders when they are first used, which belongs to building.
        rays.closest(&[Ray::new(glam::Vec3::ZERO, glam::Vec3::ZERO)])?;
        rays.any(&[Ray::new(glam::Vec3::ZERO, glam::Vec3::ZERO)])?;
        Ok(rays)
    }

    /// The adapter's name and driver.
    pub(crate) fn device(&self) -> String {
        let info = self.context.device().adapter_info();
        let driver = format!("{} {}", info.driver, info.driver_info);
        format!("gpu: {} ({}, {})", info.name, info.backend, driver.trim())
    }

    pub(crate) fn closest(&mut self, rays: &[Ray]) -> Result<GpuAnswers<Option<Hit>>> {
        let mut hits = vec![None; rays.len()];
        let Self {
            context,
            scene,
            tracer,
            batch,
            ..
        } = self;
        let (done, seconds) =
            timed(|| batch.closest_hits(context, scene, &**tracer, rays, &mut hits));
        done?;
        Ok(self.answers(hits, seconds))
    }

    pub(crate) fn any(&mut self, rays: &[Ray]) -> Result<GpuAnswers<bool>> {
        let mut hits = vec![false; rays.len()];
        let Self {
            context,
            scene,
            tracer,
            batch,
            ..
        } = self;
        let (done, seconds) = timed(|| batch.any_hits(context, scene, &**tracer, rays, &mut hits));
        done?;
        Ok(self.answers(hits, seconds))
    }

    fn answers<T>(&mut self, hits: Vec<T>, seconds: f64) -> GpuAnswers<T> {
        let kernel = self.batch.take_kernel_time().as_secs_f64();
        GpuAnswers {
            hits,
            seconds,
            kernel_seconds: (kernel > 0.0).then_some(kernel),
        }
    }
}

fn build<T: BuildGpuTracer + 'static>(
    context: &Context,
    scene: &Arc<Scene>,
    selection: &Selection,
) -> Result<(Box<dyn GpuTracer>, u64)> {
    let tracer = T::build(context, scene, selection, &T::Options::default())?;
    let bytes = tracer.bytes();
    Ok((Box::new(tracer), bytes))
}
