//! A scene on a GPU, and who answers rays there.

mod kept;

use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use anyhow::Result;
use isophote_ldi::gpu::LdiGpuTracer;
use isophote_scene::{
    Leaves,
    gpu::{
        AdapterChoice, BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, GpuTracer,
        RayQueryBoxTracer, RayQueryTracer, reference::Integrator,
    },
};

use self::kept::Kept;
use crate::{
    maps::static_part,
    tracers::{GpuTracerChoice, Plan},
};

/// A scene and a tracer on a GPU.
pub(crate) struct Gpu {
    pub(crate) context: Context,
    pub(crate) scene: GpuScene,
    pub(crate) tracer: Box<dyn GpuTracer>,
    /// The exact one of the same structures, where it is not.
    pub(crate) exact: Option<Box<dyn GpuTracer>>,
    /// Held by the tracer's own structures.
    pub(crate) bytes: usize,
    /// The techniques' renderers of this scene by this tracer.
    pub(crate) kept: Kept,
    integrator: Mutex<Integrator>,
}

/// Whether there is a GPU that is hardware.
pub(crate) fn has_hardware() -> bool {
    // Whoever is asked often, as the viewer is, need not look often.
    static FOUND: OnceLock<bool> = OnceLock::new();
    let found = || {
        isophote_scene::gpu::adapters()
            .iter()
            .any(|adapter| !adapter.is_software())
    };
    *FOUND.get_or_init(found)
}

impl Gpu {
    /// Opens an adapter, by a part of its name or the fastest there is, and builds the tracer on it.
    pub(crate) fn build(
        choice: GpuTracerChoice,
        adapter: Option<&str>,
        plan: &Plan<'_>,
    ) -> Result<Self> {
        let adapter = adapter.map_or(AdapterChoice::Any, |name| AdapterChoice::Named(name.into()));
        let context = Context::open(&adapter)?;
        let Built {
            tracer,
            exact,
            bytes,
        } = build(choice, &context, plan)?;
        Ok(Self {
            scene: GpuScene::new(&context, plan.scene)?,
            kept: Kept::default(),
            integrator: Mutex::new(Integrator::new(&context)),
            context,
            tracer,
            exact,
            bytes: bytes as usize,
        })
    }

    /// The reference integrator, with the pipelines that it has needed so far.
    pub(crate) fn integrator(&self) -> MutexGuard<'_, Integrator> {
        // A picture that was given up leaves pipelines, which are whole.
        self.integrator
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// The adapter's name and driver.
    pub(crate) fn device(&self) -> String {
        let info = self.context.device().adapter_info();
        let driver = format!("{} {}", info.driver, info.driver_info);
        format!("gpu: {} ({}, {})", info.name, info.backend, driver.trim())
    }
}

/// A tracer that is ready.
pub(crate) struct Built {
    pub(crate) tracer: Box<dyn GpuTracer>,
    /// The exact one of the same structures, where it is not.
    exact: Option<Box<dyn GpuTracer>>,
    /// Held by its own structures.
    bytes: u64,
}

impl Built {
    fn new(tracer: impl BuildGpuTracer + 'static) -> Self {
        Self {
            bytes: tracer.bytes(),
            tracer: Box::new(tracer),
            exact: None,
        }
    }
}

pub(crate) fn build(choice: GpuTracerChoice, context: &Context, plan: &Plan<'_>) -> Result<Built> {
    match choice {
        GpuTracerChoice::ComputeBvh => boxed::<ComputeBvhTracer>(context, plan, &()),
        GpuTracerChoice::RayQuery => boxed::<RayQueryTracer>(context, plan, &()),
        GpuTracerChoice::Boxes => boxed::<RayQueryBoxTracer>(context, plan, &()),
        GpuTracerChoice::ComputeBoxes => {
            let exact = ComputeBvhTracer::build(context, plan.scene, plan.selection, &())?;
            let bytes = exact.bytes();
            Ok(Built {
                tracer: Box::new(exact.with_leaves(Leaves::Boxes)),
                exact: Some(Box::new(exact)),
                bytes,
            })
        }
        GpuTracerChoice::Ldi => maps(context, plan),
        GpuTracerChoice::Field => {
            let tracer = plan.args.field.build_gpu(context, plan)?;
            Ok(Built {
                bytes: tracer.bytes(),
                tracer: Box::new(tracer),
                exact: None,
            })
        }
    }
}

fn boxed<T: BuildGpuTracer + 'static>(
    context: &Context,
    plan: &Plan<'_>,
    options: &T::Options,
) -> Result<Built> {
    let tracer = T::build(context, plan.scene, plan.selection, options)?;
    Ok(Built::new(tracer))
}

/// Maps of what does not move.
fn maps(context: &Context, plan: &Plan<'_>) -> Result<Built> {
    let (args, selection) = (&plan.args.ldi, static_part(plan));
    let tracer = if args.has_file() {
        LdiGpuTracer::upload(context, &args.maps(plan)?)?
    } else {
        LdiGpuTracer::build(context, plan.scene, &selection, &args.params())?
    };
    Ok(Built::new(tracer))
}
