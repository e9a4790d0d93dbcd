//! The reference integrators with a tracer from the command line, on the CPU or on a GPU.

use std::collections::BTreeMap;

use anyhow::Result;
#[cfg(not(feature = "gpu"))]
use anyhow::bail;
use glam::Vec3;
use isophote_ldm_ambient::MapParams;
#[cfg(feature = "gpu")]
use isophote_scene::{
    Answers,
    gpu::{self, GpuTracer},
};
use isophote_scene::{
    BuildTracer, BvhTracer, Camera, Leaves, Pass, Ray, Scene, Selection, Tracer,
    reference::{self, Progress, Quantity, Render, Settings, Tracers},
};

use crate::{
    caster::in_batches,
    maps::MapsInfo,
    output::{device, timed},
    tracers::{BuiltTracer, Choice, Plan, TracerChoice},
};
#[cfg(feature = "gpu")]
use crate::{
    gpu::{Gpu, build},
    tracers::GpuTracerChoice,
};

/// A tracer that is ready, where it runs.
pub(crate) enum Ground {
    Cpu {
        built: BuiltTracer,
        /// Who answers camera rays and the shadow rays of what the camera sees, where the tracer need not be exact.
        exact: Option<BuiltTracer>,
    },
    #[cfg(feature = "gpu")]
    Gpu {
        gpu: Box<Gpu>,
        /// Who answers camera rays and the shadow rays of what the camera sees, where the tracer cannot.
        exact: Option<Box<dyn GpuTracer>>,
    },
}

/// A picture to be made.
#[derive(Clone, Copy)]
pub(crate) struct Order<'a> {
    pub(crate) camera: &'a Camera,
    pub(crate) size: [u32; 2],
    pub(crate) quantities: &'a [Quantity],
    pub(crate) settings: &'a Settings,
    /// The part of the scene that tracers are built of.
    pub(crate) selection: &'a Selection,
    /// The bounding distance, where one was asked for, metres.
    pub(crate) min_d: Option<f32>,
    /// The layered depth maps of the technique `ldm`.
    pub(crate) maps: MapParams,
}

impl Order<'_> {
    /// Whether a quantity of some kind was asked for.
    pub(crate) fn wants(&self, kind: impl Fn(Quantity) -> bool) -> bool {
        self.quantities.iter().any(|&quantity| kind(quantity))
    }
}

/// A picture, what else is to be seen of how it was made, and how long each pass took by the GPU's clock.
#[derive(Clone)]
pub(crate) struct Made {
    pub(crate) render: Render,
    /// RGB by the names of layers.
    pub(crate) stages: Vec<(&'static str, Vec<Vec3>)>,
    pub(crate) passes: Vec<Pass>,
    pub(crate) gpu_seconds: BTreeMap<String, f64>,
}

impl Ground {
    /// Builds the tracer; `adapter` is a part of a GPU's name.
    pub(crate) fn build(choice: Choice, adapter: Option<&str>, plan: &Plan<'_>) -> Result<Self> {
        let (ground, seconds) = timed(|| Self::new(choice, adapter, plan));
        let ground = ground?;
        choice.log_built(ground.bytes(), seconds);
        Ok(ground)
    }

    fn new(choice: Choice, adapter: Option<&str>, plan: &Plan<'_>) -> Result<Self> {
        match choice {
            Choice::Cpu(TracerChoice::BvhBoxes) => boxes(plan),
            Choice::Cpu(choice) => Ok(Self::Cpu {
                built: choice.build(plan)?,
                exact: match choice {
                    TracerChoice::Bvh | TracerChoice::BruteForce => None,
                    _ => Some(TracerChoice::Bvh.build(plan)?),
                },
            }),
            #[cfg(feature = "gpu")]
            Choice::Gpu(choice) => {
                let mut gpu = Gpu::build(choice, adapter, plan)?;
                let is_exact =
                    choice != GpuTracerChoice::Ldi && gpu.tracer.answers() == Answers::Surface;
                let exact = match gpu.exact.take() {
                    None if !is_exact => {
                        let bvh = GpuTracerChoice::ComputeBvh;
                        Some(build(bvh, &gpu.context, plan)?.tracer)
                    }
                    exact => exact,
                };
                Ok(Self::Gpu {
                    gpu: Box::new(gpu),
                    exact,
                })
            }
            #[cfg(not(feature = "gpu"))]
            Choice::Gpu(_) => {
                bail!("no GPU {adapter:?}: this program was built without its feature `gpu`")
            }
        }
    }

    /// Who answers, where that is the CPU.
    pub(crate) fn on_cpu(&self) -> Option<Tracers<'_, dyn Tracer, dyn Tracer>> {
        match self {
            Self::Cpu { built, exact } => Some(on_cpu(built, exact.as_ref())),
            #[cfg(feature = "gpu")]
            Self::Gpu { .. } => None,
        }
    }

    /// The GPU and the tracer there that is exact, where it is a GPU that answers.
    #[cfg(feature = "gpu")]
    pub(crate) fn on_gpu(&self) -> Option<(&Gpu, &dyn GpuTracer)> {
        match self {
            Self::Cpu { .. } => None,
            Self::Gpu { gpu, exact } => Some((gpu, exact.as_deref().unwrap_or(&*gpu.tracer))),
        }
    }

    /// Whether the tracer hits anything on each ray.
    pub(crate) fn any_hits(&self, rays: &[Ray]) -> Result<Vec<bool>> {
        match self {
            Self::Cpu { built, .. } => {
                let any = |rays: &[Ray], hits: &mut [bool]| built.tracer.any_hits(rays, hits);
                Ok(in_batches(rays, false, any).hits)
            }
            #[cfg(feature = "gpu")]
            Self::Gpu { gpu, .. } => {
                let (context, scene, tracer) = (&gpu.context, &gpu.scene, &*gpu.tracer);
                let mut hits = vec![false; rays.len()];
                let mut batch = gpu::RayBatch::new(context, scene, tracer)?;
                batch.any_hits(context, scene, tracer, rays, &mut hits)?;
                Ok(hits)
            }
        }
    }

    /// Held by the tracer's own structures.
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Cpu { built, .. } => built.bytes,
            #[cfg(feature = "gpu")]
            Self::Gpu { gpu, .. } => gpu.bytes,
        }
    }

    /// The tracer's maps, where it has any on the CPU.
    pub(crate) fn maps(&self) -> Option<&MapsInfo> {
        match self {
            Self::Cpu { built, .. } => built.maps.as_deref(),
            #[cfg(feature = "gpu")]
            Self::Gpu { .. } => None,
        }
    }

    /// What computes.
    pub(crate) fn device(&self) -> String {
        match self {
            Self::Cpu { .. } => device(),
            #[cfg(feature = "gpu")]
            Self::Gpu { gpu, .. } => gpu.device(),
        }
    }

    /// Renders a scene, which must be that of the tracer.
    pub(crate) fn render(
        &self,
        scene: &Scene,
        order: Order<'_>,
        progress: &dyn Progress,
    ) -> Result<Made> {
        match self {
            Self::Cpu { built, exact } => {
                let tracers = on_cpu(built, exact.as_ref());
                let Order {
                    camera,
                    size,
                    quantities,
                    settings,
                    ..
                } = order;
                let render = reference::render(
                    scene, tracers, camera, size, quantities, settings, progress,
                )?;
                Ok(Made {
                    render,
                    stages: Vec::new(),
                    passes: Vec::new(),
                    gpu_seconds: BTreeMap::new(),
                })
            }
            #[cfg(feature = "gpu")]
            Self::Gpu { gpu, exact } => {
                let exact = exact.as_deref().unwrap_or(&*gpu.tracer);
                on_gpu(gpu, exact, scene, order, progress)
            }
        }
    }
}

/// One tree, asked for triangles and for the boxes around them.
fn boxes(plan: &Plan<'_>) -> Result<Ground> {
    let exact = BvhTracer::build(plan.scene, plan.selection, &plan.args.bvh_options())?;
    let built = |tracer: BvhTracer| BuiltTracer {
        bytes: tracer.bytes(),
        tracer: Box::new(tracer),
        maps: None,
    };
    Ok(Ground::Cpu {
        built: built(exact.with_leaves(Leaves::Boxes)),
        exact: Some(built(exact)),
    })
}

fn on_cpu<'a>(
    built: &'a BuiltTracer,
    exact: Option<&'a BuiltTracer>,
) -> Tracers<'a, dyn Tracer, dyn Tracer> {
    Tracers {
        exact: &*exact.unwrap_or(built).tracer,
        secondary: &*built.tracer,
    }
}

#[cfg(feature = "gpu")]
fn on_gpu(
    gpu: &Gpu,
    exact: &dyn GpuTracer,
    scene: &Scene,
    order: Order<'_>,
    progress: &dyn Progress,
) -> Result<Made> {
    let mut integrator = gpu.integrator();
    // Those of a picture that was given up.
    drop(integrator.take_times());
    let world = gpu::reference::World {
        scene,
        gpu_scene: &gpu.scene,
        exact,
        secondary: &*gpu.tracer,
    };
    let Order {
        camera,
        size,
        quantities,
        settings,
        ..
    } = order;
    let render = integrator.render(world, camera, size, quantities, settings, progress)?;
    let times = integrator.take_times().into_iter();
    Ok(Made {
        render,
        stages: Vec::new(),
        passes: Vec::new(),
        gpu_seconds: times
            .map(|pass| (pass.name, pass.time.as_secs_f64()))
            .collect(),
    })
}
