//! The tracer `ldi` as the command line asks for it: built, or loaded from a file, and perhaps with a dial from fast to
//! exact.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::{Args, ValueEnum};
use isophote_ldi::{Coverage, LdiParams, LdiTracer};
use isophote_scene::{
    BuildTracer, BvhTracer, Confident, InstanceMask, Ray, Selection, WithFallback, check_writable,
};
use serde::Serialize;

use crate::{
    applies::Idle,
    output::timed,
    rays::{self, RayKind},
    tracers::{BuiltTracer, Plan},
    values::{self, Dial},
};

/// Rays by which a share becomes a sureness.
const PROBES: usize = 1 << 15;

/// How the maps of the tracer `ldi` are made.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "The tracer ldi")]
pub(crate) struct LdiArgs {
    /// Directions: 6 K² of them [K]
    #[arg(long, value_name = "K", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=64))]
    ldi_cells: u32,
    /// Pixels on each side of its maps
    #[arg(long, value_name = "PIXELS", default_value_t = 128, value_parser = clap::value_parser!(u32).range(8..=4096))]
    ldi_resolution: u32,
    /// What its maps hold
    #[arg(long, value_enum, value_name = "WHAT", default_value = "touched")]
    ldi_layers: Layers,
    /// How far a triangle reaches beyond its edge, for --ldi-layers center [pixels]
    #[arg(long, value_name = "PIXELS", default_value_t = LdiParams::default().epsilon, value_parser = values::not_negative)]
    ldi_epsilon: f32,
    /// How far the depths of a layer may reach beyond what it is of: more takes less memory and more time [pixels]
    #[arg(long, value_name = "PIXELS", default_value_t = LdiParams::default().depth_error, value_parser = values::not_negative)]
    ldi_depth_error: f32,
    /// Refuse maps that take more memory than this [MiB]
    #[arg(long, value_name = "MIB", default_value_t = 4096, value_parser = clap::value_parser!(u64).range(1..=1 << 20))]
    ldi_memory_limit: u64,
    /// Ask an exact tracer for the answers that are less sure than this (0 to 1; above 1 for all), or for about this share of
    /// the rays (such as 15%), for --ldi-layers center
    #[arg(long, value_name = "SURENESS|SHARE%", value_parser = values::dial)]
    ldi_exact: Option<Dial>,
    /// Write the maps into a file
    #[arg(long, value_name = "FILE", conflicts_with = "ldi_load")]
    ldi_save: Option<PathBuf>,
    /// Take the maps from a file that was written of this scene, instead of building them
    #[arg(long, value_name = "FILE")]
    ldi_load: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Layers {
    /// Triangles at the centres of pixels: approximate, as in the paper
    Center,
    /// All triangles that touch a pixel: exact
    Touched,
}

impl LdiArgs {
    pub(crate) fn params(&self) -> LdiParams {
        LdiParams {
            cells: self.ldi_cells,
            resolution: self.ldi_resolution,
            coverage: match self.ldi_layers {
                Layers::Center => Coverage::Center,
                Layers::Touched => Coverage::Touched,
            },
            epsilon: self.ldi_epsilon,
            depth_error: self.ldi_depth_error,
            max_bytes: self.ldi_memory_limit << 20,
        }
    }

    /// Whether the share of rays that are asked for again is one of those around the camera.
    pub(crate) fn depends_on_camera(&self) -> bool {
        matches!(self.ldi_exact, Some(Dial::Share(_)))
    }

    /// Whether the maps come from or go to a file.
    #[cfg(feature = "gpu")]
    pub(crate) fn has_file(&self) -> bool {
        self.ldi_load.is_some() || self.ldi_save.is_some()
    }

    /// Those of its flags that have no effect beside the others.
    pub(crate) fn idle(&self) -> Vec<Idle> {
        if self.ldi_load.is_some() {
            let ids = [
                "ldi_cells",
                "ldi_resolution",
                "ldi_layers",
                "ldi_epsilon",
                "ldi_depth_error",
                "ldi_memory_limit",
            ];
            return Idle::all(ids, "the file of --ldi-load says it").collect();
        }
        match self.ldi_layers {
            Layers::Center => Vec::new(),
            Layers::Touched => Idle::all(
                ["ldi_epsilon", "ldi_exact"],
                "it is for --ldi-layers center, and the layers 'touched' are exact",
            )
            .collect(),
        }
    }

    /// Hours of work must not end at a file that cannot be written.
    pub(crate) fn check(&self, on_gpu: bool) -> Result<()> {
        ensure!(
            !(on_gpu && self.ldi_exact.is_some()),
            "--ldi-exact runs on the CPU: leave out --device gpu and --adapter"
        );
        self.ldi_save.as_deref().map_or(Ok(()), check_writable)?;
        Ok(())
    }

    /// Builds or loads the maps, and writes them where that is asked for.
    pub(crate) fn maps(&self, plan: &Plan<'_>) -> Result<LdiTracer> {
        let (scene, selection) = (plan.scene, static_part(plan));
        let maps = match &self.ldi_load {
            Some(path) => LdiTracer::load(path, scene, &selection)?,
            None => LdiTracer::build(scene, &selection, &self.params())?,
        };
        if let Some(path) = &self.ldi_save {
            maps.save(path)?;
        }
        Ok(maps)
    }

    /// The tracer, with the exact one behind the dial.
    pub(crate) fn build(&self, plan: &Plan<'_>) -> Result<BuiltTracer> {
        let (maps, seconds) = timed(|| self.maps(plan));
        let maps = maps?;
        let mut info = MapsInfo::of(&maps);
        info.seconds = seconds;
        let Some(dial) = self.ldi_exact else {
            return Ok(BuiltTracer {
                bytes: maps.bytes(),
                tracer: Box::new(maps),
                maps: Some(Box::new(info)),
            });
        };
        ensure!(
            maps.params().coverage == Coverage::Center,
            "--ldi-exact has no effect: the maps are exact, since their layers are 'touched'"
        );
        let exact = BvhTracer::build(plan.scene, &static_part(plan), &plan.args.bvh_options())?;
        let kind = RayKind::Diffuse;
        let probes = rays::make(kind, plan.scene, &exact, plan.camera, PROBES, 0)?;
        let least = match dial {
            Dial::Sureness(least) => least,
            Dial::Share(share) => sureness(&maps, &probes, share),
        };
        let doubtful = WithFallback::new(&maps, &exact, least).doubtful(&probes);
        let sent = doubtful.iter().filter(|sent| **sent).count();
        info.least_sure = Some(least);
        info.exact_share = Some(sent as f64 / probes.len() as f64);
        Ok(BuiltTracer {
            bytes: maps.bytes() + exact.bytes(),
            tracer: Box::new(WithFallback::new(maps, exact, least)),
            maps: Some(Box::new(info)),
        })
    }
}

/// What does not move: the rest cannot be in maps (§6).
pub(crate) fn static_part(plan: &Plan<'_>) -> Selection {
    Selection {
        mask: plan.selection.mask.union(InstanceMask::STATIC),
        ..*plan.selection
    }
}

/// The sureness below which lies this share of the rays' answers.
fn sureness(maps: &LdiTracer, rays: &[Ray], share: f32) -> f32 {
    let mut answers = vec![(None, 0.0); rays.len()];
    maps.closest_all_with_confidence(rays, &mut answers);
    let mut sure: Vec<f32> = answers.into_iter().map(|answer| answer.1).collect();
    sure.sort_by(f32::total_cmp);
    let index = (share * sure.len() as f32) as usize;
    // Above 1 all rays are sent.
    sure.get(index).copied().unwrap_or(2.0)
}

/// Maps, for reports and headers.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct MapsInfo {
    pub(crate) directions: u32,
    pub(crate) cells: u32,
    pub(crate) resolution: u32,
    pub(crate) layers: &'static str,
    pub(crate) epsilon: f32,
    /// The bound on the error of depths, and what it is, pixels.
    pub(crate) depth_error: f32,
    depth_error_kept: f64,
    /// Bits of a depth.
    depth_bits: u32,
    /// Bytes of a layer.
    bytes_per_layer: u32,
    /// Of building or loading them.
    seconds: f64,
    /// How many layers all pixels have together.
    layer_count: usize,
    /// Of the maps without the triangles they point at.
    map_bytes: usize,
    bytes: usize,
    /// Answers less sure than this are asked of the exact tracer.
    least_sure: Option<f32>,
    /// The share of diffuse rays around the camera that this is.
    exact_share: Option<f64>,
}

impl MapsInfo {
    pub(crate) fn of(tracer: &LdiTracer) -> Self {
        let (params, maps) = (tracer.params(), tracer.maps());
        Self {
            directions: 6 * params.cells * params.cells,
            cells: params.cells,
            resolution: params.resolution,
            layers: match params.coverage {
                Coverage::Center => "center",
                Coverage::Touched => "touched",
            },
            epsilon: params.epsilon,
            depth_error: params.depth_error,
            depth_error_kept: maps.depth_error(),
            depth_bits: maps.layers.packing().depth_bits(),
            bytes_per_layer: maps.layers.packing().bytes(),
            seconds: 0.0,
            layer_count: maps.layers.count(),
            map_bytes: maps.map_bytes(),
            bytes: maps.bytes(),
            least_sure: None,
            exact_share: None,
        }
    }

    /// What the maps were built with, as flags: a file of maps may say something else than the command line.
    pub(crate) fn settings(&self) -> [(&'static str, String); 5] {
        [
            ("ldi-cells", self.cells.to_string()),
            ("ldi-resolution", self.resolution.to_string()),
            ("ldi-layers", self.layers.to_owned()),
            ("ldi-epsilon", self.epsilon.to_string()),
            ("ldi-depth-error", self.depth_error.to_string()),
        ]
    }
}
