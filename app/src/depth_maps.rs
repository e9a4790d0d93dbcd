//! Layered depth maps as the command line asks for them: those of the technique `ldm`, and of the tracer `ldm`.

use anyhow::Result;
use clap::Args;
use isophote_ldm_ambient::{LdmTracer, MapParams};
use isophote_scene::BuildTracer;

use crate::{
    applies::{Idle, ids},
    technique::TechniqueChoice,
    tracers::{AnyTracer, BuiltTracer, Plan},
    values,
};

/// How layered depth maps are made.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Layered depth maps: the technique ldm, the tracer ldm")]
pub(crate) struct DepthMapArgs {
    /// Maps; each answers for two opposite directions
    #[arg(long, value_name = "N", default_value_t = MapParams::default().maps, value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    ldm_maps: u32,
    /// A map has at most R² pixels
    #[arg(long, value_name = "R", default_value_t = MapParams::default().resolution, value_parser = clap::value_parser!(u32).range(1..=4096))]
    ldm_resolution: u32,
    /// What is nearer is the surface itself [pixels of a map]
    #[arg(long, value_name = "PIXELS", default_value_t = MapParams::default().tolerance, value_parser = values::not_negative)]
    ldm_tolerance: f32,
    /// Refuse a tracer ldm whose maps take more memory than this [MiB]
    #[arg(long, value_name = "MIB", default_value_t = MapParams::default().max_bytes >> 20, value_parser = clap::value_parser!(u64).range(1..=1 << 20))]
    ldm_memory_limit: u64,
}

impl DepthMapArgs {
    pub(crate) fn params(&self) -> MapParams {
        MapParams {
            maps: self.ldm_maps,
            resolution: self.ldm_resolution,
            tolerance: self.ldm_tolerance,
            max_bytes: self.ldm_memory_limit << 20,
        }
    }

    /// Those of the flags that have no effect with a tracer and a technique.
    pub(crate) fn idle(tracer: Option<AnyTracer>, technique: TechniqueChoice) -> Vec<Idle> {
        let is_tracer = tracer == Some(AnyTracer::Ldm);
        if is_tracer {
            return Vec::new();
        }
        if technique == TechniqueChoice::Ldm {
            let why = "it is for the tracer ldm: the technique keeps one map at a time";
            return Idle::all(["ldm_memory_limit"], why).collect();
        }
        let why = "it is for --technique ldm and the tracer ldm";
        Idle::all(ids::<Self>(), why).collect()
    }

    /// The tracer that keeps all maps.
    pub(crate) fn build(&self, plan: &Plan<'_>) -> Result<BuiltTracer> {
        let tracer = LdmTracer::build(plan.scene, plan.selection, &self.params())?;
        Ok(BuiltTracer {
            bytes: tracer.bytes(),
            tracer: Box::new(tracer),
            maps: None,
        })
    }
}
