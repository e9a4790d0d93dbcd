//! The technique `igi`: virtual point lights by `isophote-instant-gi`, seen by a tracer from the command line.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use glam::Vec3;
use isophote_instant_gi::{
    Filter, GiParams, InstantGi, Lookup, Pattern, Sequence, ShadowMaps, Stages, Visibility,
};
use isophote_scene::{
    Answers, Scene,
    reference::{Layers, Normals, Progress, Quantity},
};

#[cfg(feature = "gpu")]
use isophote_scene::gpu::{GpuTracer, reference::World};

use super::Technique;
#[cfg(feature = "gpu")]
use crate::gpu::Gpu;
use crate::{
    applies::Idle,
    reference::{Ground, Made, Order},
    tracers::Choice,
    values,
};

/// The bounding distance unless --min-d is given, metres.
const MIN_D: f32 = 0.1;

/// How the technique `igi` makes pictures.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "The technique igi")]
pub(crate) struct IgiTechnique {
    /// Light paths that are shot
    #[arg(long, value_name = "N", default_value_t = 180, value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    igi_paths: u32,
    /// Where light paths start
    #[arg(long, value_enum, value_name = "SEQUENCE", default_value = "lattice")]
    igi_sequence: SequenceChoice,
    /// Virtual point lights that are kept for a picture, by what they would bring it; 0 keeps all
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1 << 16))]
    igi_keep: u32,
    /// Virtual point lights that a point asks for, picked by what they would bring it; 0 asks for all
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1 << 16))]
    igi_select: u32,
    /// Surfaces that a light path meets; a virtual point light at each
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=16))]
    igi_bounces: u32,
    /// Rays a point by which the light that --min-d leaves out is found again
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1024))]
    igi_compensation: u32,
    /// Mirrors and panes of glass that are looked through
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(0..=16))]
    igi_depth: u32,
    /// Metres between points at which light on what mirrors show is computed; 0 at all (CPU only)
    #[arg(long, value_name = "METRES", default_value_t = 0.0, value_parser = values::not_negative)]
    igi_caching: f32,
    /// Samples a pixel of lights with an extent
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1024))]
    igi_light_rays: u32,
    /// Rays a pixel into the highlights of rough metal
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1024))]
    igi_glossy_rays: u32,
    /// Indirect light at every s-th pixel in both directions
    #[arg(long, value_name = "S", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=16))]
    igi_downsampling: u32,
    /// The lights divided among tiles of samples, each side 1 to 8
    #[arg(long, value_name = "MxN", default_value = "1x1", value_parser = values::tile)]
    igi_interleaving: Tile,
    /// Which sample of a tile has which part of the lights
    #[arg(long, value_enum, value_name = "PATTERN", default_value = "regular")]
    igi_pattern: PatternChoice,
    /// How samples become a picture
    #[arg(long, value_enum, value_name = "FILTER", default_value = "edges")]
    igi_filter: FilterChoice,
    /// Light pixels themselves on whose surface fewer than so many of the four samples around them lie; 0 none
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=4))]
    igi_refine: u32,
    /// How points see the virtual point lights
    #[arg(long, value_enum, value_name = "WAY", default_value = "rays")]
    igi_visibility: VisibilityChoice,
    /// Texels of a shadow map's side, 8 to 1024, a multiple of 8; each light has a map of four bytes a texel
    #[arg(long, value_name = "N", default_value_t = ShadowMaps::default().resolution, value_parser = values::map_side)]
    igi_map_size: u32,
    /// How much nearer than a point what hides it must be in a shadow map, 0 to 16 texels' widths there
    #[arg(long, value_name = "TEXELS", default_value_t = ShadowMaps::default().bias, value_parser = values::bias)]
    igi_map_bias: f32,
    /// How points look the texels of shadow maps up
    #[arg(long, value_enum, value_name = "HOW", default_value = "smooth")]
    igi_map_lookup: LookupChoice,
}

// clap takes a bare array for a list of values.
type Tile = [u32; 2];

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SequenceChoice {
    /// Along the Halton sequence, which chooses the lights too
    Halton,
    /// On a lattice for each light
    Lattice,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PatternChoice {
    /// The same in every tile
    Regular,
    /// Shuffled in every tile
    Irregular,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FilterChoice {
    /// The discontinuity buffer and then upsampling by normals
    Paper,
    /// Both at once, by normals and depths
    Edges,
    /// Parts of the lights that a sample's surface lacks are computed there; then upsampling by normals and depths
    Fill,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum VisibilityChoice {
    /// By a ray for each point and light
    Rays,
    /// By paraboloid shadow maps of the lights, which the tracer fills
    Maps,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum LookupChoice {
    /// The texel they fall on
    Nearest,
    /// The four around them, weighted
    Smooth,
}

impl IgiTechnique {
    fn visibility(&self) -> Visibility {
        match self.igi_visibility {
            VisibilityChoice::Rays => Visibility::Rays,
            VisibilityChoice::Maps => Visibility::Maps(ShadowMaps {
                resolution: self.igi_map_size,
                bias: self.igi_map_bias,
                lookup: match self.igi_map_lookup {
                    LookupChoice::Nearest => Lookup::Nearest,
                    LookupChoice::Smooth => Lookup::Smooth,
                },
            }),
        }
    }

    fn params(&self, order: &Order<'_>) -> GiParams {
        GiParams {
            paths: self.igi_paths,
            sequence: match self.igi_sequence {
                SequenceChoice::Halton => Sequence::Halton,
                SequenceChoice::Lattice => Sequence::Lattice,
            },
            kept: self.igi_keep,
            selection: self.igi_select,
            bounces: self.igi_bounces,
            min_d: order.min_d.unwrap_or(MIN_D),
            compensation: self.igi_compensation,
            depth: self.igi_depth,
            caching: self.igi_caching,
            light_rays: self.igi_light_rays,
            glossy_rays: self.igi_glossy_rays,
            downsampling: self.igi_downsampling,
            interleaving: self.igi_interleaving,
            pattern: match self.igi_pattern {
                PatternChoice::Regular => Pattern::Regular,
                PatternChoice::Irregular => Pattern::Irregular,
            },
            filter: match self.igi_filter {
                FilterChoice::Paper => Filter::Paper,
                FilterChoice::Edges => Filter::Edges,
                FilterChoice::Fill => Filter::Fill,
            },
            refinement: self.igi_refine,
            visibility: self.visibility(),
            materials: order.settings.materials,
            seed: order.settings.seed,
        }
    }
}

impl Technique for IgiTechnique {
    fn quantities(&self) -> &'static [Quantity] {
        // `path` is direct light, what mirrors and glass show, and the light of the virtual lights.
        &[
            Quantity::Direct,
            Quantity::Indirect,
            Quantity::Path,
            Quantity::IrradianceIndirect,
        ]
    }

    fn idle(&self, _: &[Quantity]) -> Vec<Idle> {
        let mut idle: Vec<Idle> = Idle::all(
            ["d_max", "normals", "path_bounces"],
            "the technique igi does not know it",
        )
        .collect();
        let why = "the technique igi counts light paths: --igi-paths";
        idle.extend(Idle::all(["spp"], why));
        if self.igi_visibility == VisibilityChoice::Rays {
            let maps = ["igi_map_size", "igi_map_bias", "igi_map_lookup"];
            idle.extend(Idle::all(maps, "it is for --igi-visibility maps"));
        }
        let (is_coarse, is_tiled) = (self.igi_downsampling > 1, self.igi_interleaving != [1, 1]);
        if !is_coarse {
            let why = "every pixel is lit itself: it is for --igi-downsampling";
            idle.extend(Idle::all(["igi_refine"], why));
        }
        if !is_tiled {
            let why = "every sample has all lights: it is for --igi-interleaving";
            idle.extend(Idle::all(["igi_pattern"], why));
        }
        if !is_coarse && !is_tiled {
            let why =
                "samples are the picture: it is for --igi-downsampling and --igi-interleaving";
            idle.extend(Idle::all(["igi_filter"], why));
        }
        idle
    }

    fn needs(&self, _: Quantity) -> Answers {
        // What is seen in mirrors is asked of the exact tracer.
        Answers::Occlusion
    }

    fn refuses(&self, tracer: Choice, _: Quantity) -> Option<&'static str> {
        let by_maps = self.igi_visibility == VisibilityChoice::Maps;
        (by_maps && tracer.is_of_boxes()).then_some(
            "boxes that hold an end of a ray do not count, but a shadow map is filled before it is known where rays end; take \
             --igi-visibility rays, or a tracer of triangles",
        )
    }

    fn path_bounces(&self) -> Option<u32> {
        Some(self.igi_bounces + 1)
    }

    fn header(&self, order: &Order<'_>) -> Vec<(&'static str, String)> {
        vec![("min-d", order.min_d.unwrap_or(MIN_D).to_string())]
    }

    fn costs(&self) -> [u64; 2] {
        [4, 512]
    }

    fn render(
        &self,
        scene: &Scene,
        ground: &Ground,
        order: Order<'_>,
        progress: &dyn Progress,
    ) -> Result<Made> {
        #[cfg(feature = "gpu")]
        if let Some((gpu, exact)) = ground.on_gpu() {
            return on_gpu(&self.params(&order), scene, gpu, exact, order, progress);
        }
        let tracers = ground.on_cpu().context("there is no tracer")?;
        let gi = InstantGi::new(scene, tracers, &self.params(&order))?;
        let stages = gi.render(order.camera, order.size, progress)?;
        let layers = Layers::of(
            scene,
            tracers.exact,
            order.camera,
            order.size,
            Normals::Smooth,
        );
        Ok(made(stages, layers, &order, BTreeMap::new()))
    }
}

#[cfg(feature = "gpu")]
fn on_gpu(
    params: &GiParams,
    scene: &Scene,
    gpu: &Gpu,
    exact: &dyn GpuTracer,
    order: Order<'_>,
    progress: &dyn Progress,
) -> Result<Made> {
    let context = &gpu.context;
    let world = World {
        scene,
        gpu_scene: &gpu.scene,
        exact,
        secondary: &*gpu.tracer,
    };
    let gi = gpu.kept.get((*params, order.size), || {
        let new = isophote_instant_gi::gpu::InstantGi::new(context, world, params, order.size);
        Ok(new?)
    })?;
    let stages = gi.render(context, world, order.camera, progress)?;
    let passes = stages.passes.iter();
    let gpu_seconds = passes
        .map(|pass| (pass.name.to_owned(), pass.seconds))
        .collect();
    let mut integrator = gpu.integrator();
    let layers = integrator.layers(world, order.camera, order.size, Normals::Smooth)?;
    Ok(made(stages, layers, &order, gpu_seconds))
}

fn made(
    stages: Stages,
    layers: Layers,
    order: &Order<'_>,
    gpu_seconds: BTreeMap<String, f64>,
) -> Made {
    Made {
        stages: stages
            .layers()
            .map(|(name, values)| (name, values.to_vec()))
            .into(),
        gpu_seconds,
        ..super::made(order, layers, stages.rays(), &stages.passes, |quantity| {
            values(&stages, quantity)
        })
    }
}

fn values(stages: &Stages, quantity: Quantity) -> Vec<Vec3> {
    match quantity {
        Quantity::Direct => stages.direct.clone(),
        Quantity::Indirect => stages.indirect.clone(),
        Quantity::IrradianceIndirect => stages.irradiance.clone(),
        _ => stages.picture.clone(),
    }
}
