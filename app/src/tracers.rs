//! The tracers that can be chosen on the command line.

use std::sync::Arc;

#[cfg(feature = "gpu")]
use crate::gpu::has_hardware;
use anyhow::{Result, bail, ensure};
use clap::{Args, ValueEnum};
use isophote_scene::{
    Answers, BruteForceTracer, BuildTracer, BvhOptions, BvhTracer, Camera, Leaves, Levels, Scene,
    Selection, Tracer,
};

use crate::{
    applies::{Idle, ids},
    depth_maps::DepthMapArgs,
    fields::FieldArgs,
    maps::{LdiArgs, MapsInfo},
    technique::TechniqueChoice,
};

/// Who answers rays on the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TracerChoice {
    Bvh,
    BvhBoxes,
    BruteForce,
    Ldi,
    Field,
    Ldm,
}

/// Who answers rays on a GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum GpuTracerChoice {
    ComputeBvh,
    RayQuery,
    Boxes,
    ComputeBoxes,
    Ldi,
    Field,
}

/// Who answers rays, wherever.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum AnyTracer {
    /// CPU: exact, by a bounding volume hierarchy
    Bvh,
    /// CPU: the boxes around triangles, unless they hold an end of the ray: imperfect visibility
    BvhBoxes,
    /// CPU: exact, by testing every triangle: slow, for checking
    BruteForce,
    /// CPU or GPU: layered depth images: see --ldi-layers
    Ldi,
    /// CPU or GPU: displacement fields around objects, distances only: see --field-rings
    Field,
    /// CPU: layered depth maps along fixed directions, of which the nearest answers, distances only: see --ldm-maps
    Ldm,
    /// GPU: exact, by a bounding volume hierarchy
    ComputeBvh,
    /// GPU: exact, by the GPU's own ray tracing
    RayQuery,
    /// GPU: the boxes around triangles, by the GPU's own ray tracing
    Boxes,
    /// GPU: the boxes around triangles, by a bounding volume hierarchy
    ComputeBoxes,
}

/// Where to compute.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Device {
    Auto,
    Cpu,
    Gpu,
}

/// A tracer, by where it runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Choice {
    Cpu(TracerChoice),
    Gpu(GpuTracerChoice),
}

impl AnyTracer {
    /// Of those that run anywhere, the one that is asked for.
    fn choice(self, on_gpu: bool) -> Choice {
        match self {
            Self::Bvh => Choice::Cpu(TracerChoice::Bvh),
            Self::BvhBoxes => Choice::Cpu(TracerChoice::BvhBoxes),
            Self::BruteForce => Choice::Cpu(TracerChoice::BruteForce),
            Self::Ldi if on_gpu => Choice::Gpu(GpuTracerChoice::Ldi),
            Self::Ldi => Choice::Cpu(TracerChoice::Ldi),
            Self::Field if on_gpu => Choice::Gpu(GpuTracerChoice::Field),
            Self::Field => Choice::Cpu(TracerChoice::Field),
            Self::Ldm => Choice::Cpu(TracerChoice::Ldm),
            Self::ComputeBvh => Choice::Gpu(GpuTracerChoice::ComputeBvh),
            Self::RayQuery => Choice::Gpu(GpuTracerChoice::RayQuery),
            Self::Boxes => Choice::Gpu(GpuTracerChoice::Boxes),
            Self::ComputeBoxes => Choice::Gpu(GpuTracerChoice::ComputeBoxes),
        }
    }

    /// Whether it can be asked for there.
    pub(crate) fn runs_on(self, device: Device) -> bool {
        match self.choice(device == Device::Gpu) {
            Choice::Cpu(_) => device != Device::Gpu,
            Choice::Gpu(_) => device != Device::Cpu,
        }
    }

    pub(crate) fn name(self) -> String {
        self.to_possible_value()
            .map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

impl Choice {
    /// The exact tracer of the same device.
    pub(crate) fn exact(self) -> Self {
        match self {
            Self::Cpu(_) => Self::Cpu(TracerChoice::Bvh),
            Self::Gpu(_) => Self::Gpu(GpuTracerChoice::ComputeBvh),
        }
    }

    /// Whether it answers for the boxes around triangles.
    pub(crate) fn is_of_boxes(self) -> bool {
        matches!(
            self,
            Self::Cpu(TracerChoice::BvhBoxes)
                | Self::Gpu(GpuTracerChoice::Boxes | GpuTracerChoice::ComputeBoxes)
        )
    }

    /// What its answers hold.
    pub(crate) fn answers(self) -> Answers {
        match self {
            Self::Cpu(TracerChoice::Bvh | TracerChoice::BruteForce | TracerChoice::Ldi)
            | Self::Gpu(
                GpuTracerChoice::ComputeBvh | GpuTracerChoice::RayQuery | GpuTracerChoice::Ldi,
            ) => Answers::Surface,
            Self::Cpu(TracerChoice::BvhBoxes | TracerChoice::Field | TracerChoice::Ldm)
            | Self::Gpu(
                GpuTracerChoice::Boxes | GpuTracerChoice::ComputeBoxes | GpuTracerChoice::Field,
            ) => Answers::Distance,
        }
    }

    /// Says in the log that such a tracer was built.
    pub(crate) fn log_built(self, bytes: usize, seconds: f64) {
        tracing::debug!(tracer = self.name(), bytes, seconds, "tracer built");
    }

    /// As on the command line.
    pub(crate) fn name(self) -> String {
        let of = |one: &&AnyTracer| {
            [false, true]
                .map(|on_gpu| one.choice(on_gpu))
                .contains(&self)
        };
        AnyTracer::value_variants()
            .iter()
            .find(of)
            .map_or_else(String::new, |one| one.name())
    }
}

/// The tracer that was asked for, or else the best on the device that was.
pub(crate) fn choose(
    device: Device,
    tracer: Option<AnyTracer>,
    adapter: Option<&str>,
) -> Result<Choice> {
    let choice = match (tracer, device) {
        (Some(tracer), _) => tracer.choice(device == Device::Gpu || adapter.is_some()),
        (None, Device::Gpu) => Choice::Gpu(GpuTracerChoice::ComputeBvh),
        (None, Device::Auto) if adapter.is_some() || has_hardware() => {
            Choice::Gpu(GpuTracerChoice::ComputeBvh)
        }
        (None, _) => Choice::Cpu(TracerChoice::Bvh),
    };
    match (choice, device, adapter) {
        (Choice::Cpu(_), Device::Gpu, _) => {
            bail!(
                "{} runs on the CPU: leave out --device gpu, or choose compute-bvh or ray-query",
                choice.name()
            )
        }
        (Choice::Gpu(_), Device::Cpu, _) => {
            bail!(
                "{} runs on a GPU: leave out --device cpu, or choose bvh",
                choice.name()
            )
        }
        (Choice::Cpu(_), _, Some(_)) => {
            bail!("{} runs on the CPU: leave out --adapter", choice.name())
        }
        _ => Ok(choice),
    }
}

#[cfg(not(feature = "gpu"))]
fn has_hardware() -> bool {
    false
}

/// What can be chosen of a tracer.
#[derive(Args, Clone, Debug)]
pub(crate) struct TracerArgs {
    /// How the tracers bvh and bvh-boxes hold instances; the answers do not depend on it
    #[arg(long, value_enum, value_name = "LEVELS", default_value = "auto")]
    bvh_levels: BvhLevels,
    #[command(flatten)]
    pub(crate) ldi: LdiArgs,
    #[command(flatten)]
    pub(crate) field: FieldArgs,
    #[command(flatten)]
    pub(crate) depth_maps: DepthMapArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum BvhLevels {
    /// Two where flat would hold over 200,000 triangles and four times as many as the meshes have
    Auto,
    /// One tree over the triangles of all instances: faster where meshes are placed once
    Flat,
    /// A tree for each mesh and one over the instances: little memory where meshes are placed often
    Two,
}

impl TracerArgs {
    pub(crate) fn bvh_options(&self) -> BvhOptions {
        BvhOptions {
            levels: match self.bvh_levels {
                BvhLevels::Auto => Levels::Auto,
                BvhLevels::Flat => Levels::Flat,
                BvhLevels::Two => Levels::Two,
            },
            leaves: Leaves::Triangles,
        }
    }

    /// Refuses what was asked of another tracer, or cannot be.
    pub(crate) fn check(&self, choice: Choice) -> Result<()> {
        ensure!(
            matches!(
                choice,
                Choice::Cpu(TracerChoice::Bvh | TracerChoice::BvhBoxes)
            ) || self.bvh_levels == BvhLevels::Auto,
            "--bvh-levels is for the tracers bvh and bvh-boxes; {} has none",
            choice.name()
        );
        self.field.check()?;
        self.ldi.check(matches!(choice, Choice::Gpu(_)))
    }

    /// Whether a tracer must be built again where the camera stands elsewhere.
    pub(crate) fn depends_on_camera(&self) -> bool {
        self.ldi.depends_on_camera() || self.field.depends_on_camera()
    }

    /// Flags that have no effect with a tracer and a technique.
    pub(crate) fn idle(&self, tracer: Option<AnyTracer>, technique: TechniqueChoice) -> Vec<Idle> {
        let mut idle = if tracer == Some(AnyTracer::Ldi) {
            self.ldi.idle()
        } else {
            Idle::all(ids::<LdiArgs>(), "it is for the tracer ldi").collect()
        };
        if tracer == Some(AnyTracer::Field) {
            idle.extend(self.field.idle());
        } else {
            idle.extend(Idle::all(ids::<FieldArgs>(), "it is for the tracer field"));
        }
        idle.extend(DepthMapArgs::idle(tracer, technique));
        idle
    }
}

/// A tracer, and the bytes its own structures hold.
pub(crate) struct BuiltTracer {
    pub(crate) tracer: Box<dyn Tracer>,
    pub(crate) bytes: usize,
    /// Where it has any.
    pub(crate) maps: Option<Box<MapsInfo>>,
}

/// What tracers are built of.
pub(crate) struct Plan<'a> {
    pub(crate) args: &'a TracerArgs,
    pub(crate) scene: &'a Arc<Scene>,
    pub(crate) selection: &'a Selection,
    /// The viewpoint around which rays are to be answered.
    pub(crate) camera: &'a Camera,
}

impl TracerChoice {
    pub(crate) fn build(self, plan: &Plan<'_>) -> Result<BuiltTracer> {
        match self {
            Self::Bvh => build::<BvhTracer>(plan, &plan.args.bvh_options()),
            Self::BvhBoxes => build::<BvhTracer>(
                plan,
                &BvhOptions {
                    leaves: Leaves::Boxes,
                    ..plan.args.bvh_options()
                },
            ),
            Self::BruteForce => build::<BruteForceTracer>(plan, &()),
            Self::Ldi => plan.args.ldi.build(plan),
            Self::Field => plan.args.field.build(plan),
            Self::Ldm => plan.args.depth_maps.build(plan),
        }
    }
}

fn build<T: BuildTracer + 'static>(plan: &Plan<'_>, options: &T::Options) -> Result<BuiltTracer> {
    let tracer = T::build(plan.scene, plan.selection, options)?;
    Ok(BuiltTracer {
        bytes: tracer.bytes(),
        tracer: Box::new(tracer),
        maps: None,
    })
}
