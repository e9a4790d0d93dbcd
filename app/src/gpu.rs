//! A scene on a GPU, and who answers rays there.

use std::sync::Arc;

use anyhow::Result;
use isophote_ldi::gpu::LdiGpuTracer;
use isophote_scene::{
    Scene, Selection,
    gpu::{
        AdapterChoice, BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, GpuTracer,
        RayQueryBoxTracer, RayQueryTracer,
    },
};

use crate::tracers::{GpuTracerChoice, TracerArgs};

/// A scene and a tracer on a GPU.
pub(crate) struct Gpu {
    pub(crate) context: Context,
    pub(crate) scene: GpuScene,
    pub(crate) tracer: Box<dyn GpuTracer>,
    /// Held by the tracer's own structures.
    pub(crate) bytes: usize,
}

/// Whether there is a GPU that is hardware.
pub(crate) fn has_hardware() -> bool {
    isophote_scene::gpu::adapters()
        .iter()
        .any(|adapter| !adapter.is_software())
}

impl Gpu {
    /// Opens an adapter, by a part of its name or the fastest there is, and builds the tracer on it.
    pub(crate) fn build(
        choice: GpuTracerChoice,
        args: TracerArgs,
        adapter: Option<&str>,
        scene: &Arc<Scene>,
        selection: &Selection,
    ) -> Result<Self> {
        let adapter = adapter.map_or(AdapterChoice::Any, |name| AdapterChoice::Named(name.into()));
        let context = Context::open(&adapter)?;
        let (tracer, bytes) = build(choice, args, &context, scene, selection)?;
        Ok(Self {
            scene: GpuScene::new(&context, scene)?,
            context,
            tracer,
            bytes: bytes as usize,
        })
    }

    /// The adapter's name and driver.
    pub(crate) fn device(&self) -> String {
        let info = self.context.device().adapter_info();
        let driver = format!("{} {}", info.driver, info.driver_info);
        format!("gpu: {} ({}, {})", info.name, info.backend, driver.trim())
    }
}

/// A tracer, and the bytes its own structures hold.
pub(crate) fn build(
    choice: GpuTracerChoice,
    args: TracerArgs,
    context: &Context,
    scene: &Arc<Scene>,
    selection: &Selection,
) -> Result<(Box<dyn GpuTracer>, u64)> {
    match choice {
        GpuTracerChoice::ComputeBvh => boxed::<ComputeBvhTracer>(context, scene, selection, &()),
        GpuTracerChoice::RayQuery => boxed::<RayQueryTracer>(context, scene, selection, &()),
        GpuTracerChoice::Boxes => boxed::<RayQueryBoxTracer>(context, scene, selection, &()),
        GpuTracerChoice::Ldi => {
            boxed::<LdiGpuTracer>(context, scene, selection, &args.ldi.params())
        }
    }
}

fn boxed<T: BuildGpuTracer + 'static>(
    context: &Context,
    scene: &Arc<Scene>,
    selection: &Selection,
    options: &T::Options,
) -> Result<(Box<dyn GpuTracer>, u64)> {
    let tracer = T::build(context, scene, selection, options)?;
    let bytes = tracer.bytes();
    Ok((Box::new(tracer), bytes))
}
