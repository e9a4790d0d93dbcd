//! The technique `ldi`: the hybrid renderer of `isophote-ldi` with a tracer from the command line.

use std::collections::BTreeMap;

use anyhow::{Context, Result, ensure};
use clap::{Args, ValueEnum};
use glam::Vec3;
use isophote_ldi::{Hybrid, HybridParams, Shadows, Stages};
use isophote_scene::{
    Answers, Scene,
    reference::{Layers, Normals, Progress, Quantity},
};

#[cfg(feature = "gpu")]
use isophote_scene::gpu::{GpuTracer, ShadowOptions, reference::World};

use super::Technique;
#[cfg(feature = "gpu")]
use crate::gpu::Gpu;
use crate::{
    applies::Idle,
    reference::{Ground, Made, Order},
    tracers::AnyTracer,
    values,
};

/// Quantities that it knows. `path` is direct light and one bounce.
const QUANTITIES: [Quantity; 3] = [Quantity::Direct, Quantity::Indirect, Quantity::Path];
/// Surfaces that its light paths meet.
const BOUNCES: u32 = 2;
/// Layers of the picture beside the quantities.
const STAGES: u64 = 5;
/// What a sample takes while it is worked on, bytes.
const SAMPLE_BYTES: u64 = 512;

/// How the technique `ldi` makes pictures; the defaults are the paper's.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "The technique ldi")]
pub(crate) struct LdiTechnique {
    /// Samples a pixel, 1 or 4; what meets the same triangle is shaded once
    #[arg(long, value_name = "1|4", default_value_t = 1, value_parser = values::one_or_four)]
    ldi_samples: u32,
    /// Diffuse rays a pixel
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    ldi_diffuse_rays: u32,
    /// Glossy rays a pixel; mirrors take one
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    ldi_glossy_rays: u32,
    /// Shadow rays a pixel towards the lights
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    ldi_light_rays: u32,
    /// Who answers the shadow rays of what the camera sees
    #[arg(long, value_enum, value_name = "TRACER", default_value = "exact")]
    ldi_shadows: ShadowsChoice,
    /// Width of the Gaussian over the diffuse light that bounced, odd; 1 does not filter [pixels]
    #[arg(long, value_name = "PIXELS", default_value_t = 11, value_parser = values::odd)]
    ldi_filter_width: u32,
    /// Width of the Gaussian over the light straight from the lights, odd; 1 does not filter [pixels]
    #[arg(long, value_name = "PIXELS", default_value_t = 1, value_parser = values::odd)]
    ldi_light_filter_width: u32,
    /// Standard deviation of both [pixels]
    #[arg(long, value_name = "PIXELS", default_value_t = 2.0, value_parser = values::sigma)]
    ldi_filter_sigma: f32,
    /// Where both end
    #[arg(long, value_enum, value_name = "WHERE", default_value = "edges")]
    ldi_filter_stops: Stops,
    /// The mip level of textures where secondary rays hit
    #[arg(long, value_name = "LEVEL", default_value_t = 3.0, value_parser = values::level)]
    ldi_texture_level: f32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ShadowsChoice {
    /// The exact tracer: sharp, and with everything in it
    Exact,
    /// The tracer of the secondary rays; what moves is not in maps and casts no shadow then
    Tracer,
    /// Shadow maps of all lights, of what secondary rays hit too, as in the paper; hard, and on a GPU only
    Maps,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Stops {
    /// At edges of depth and normal
    Edges,
    /// Nowhere, as in the paper
    Nowhere,
}

impl LdiTechnique {
    fn params(&self, order: &Order<'_>) -> HybridParams {
        let default = HybridParams::default();
        HybridParams {
            samples: self.ldi_samples,
            diffuse_rays: self.ldi_diffuse_rays,
            glossy_rays: self.ldi_glossy_rays,
            light_rays: self.ldi_light_rays,
            shadows: match self.ldi_shadows {
                // With maps neither tracer is asked.
                ShadowsChoice::Exact | ShadowsChoice::Maps => Shadows::Exact,
                ShadowsChoice::Tracer => Shadows::Secondary,
            },
            filter_width: self.ldi_filter_width,
            light_filter_width: self.ldi_light_filter_width,
            filter_sigma: self.ldi_filter_sigma,
            edges: match self.ldi_filter_stops {
                Stops::Edges => default.edges,
                Stops::Nowhere => None,
            },
            texture_level: self.ldi_texture_level,
            materials: order.settings.materials,
            seed: order.settings.seed,
        }
    }
}

impl Technique for LdiTechnique {
    fn quantities(&self) -> &'static [Quantity] {
        &QUANTITIES
    }

    fn idle(&self, _: &[Quantity]) -> Vec<Idle> {
        let of_reference = ["d_max", "min_d", "normals", "path_bounces"];
        let mut idle: Vec<Idle> =
            Idle::all(of_reference, "the technique ldi does not know it").collect();
        let why = "the technique ldi counts rays: --ldi-diffuse-rays, --ldi-glossy-rays, --ldi-light-rays";
        idle.extend(Idle::all(["spp"], why));
        if self.ldi_filter_width == 1 && self.ldi_light_filter_width == 1 {
            let why = "nothing is filtered: both widths are 1";
            idle.extend(Idle::all(["ldi_filter_sigma", "ldi_filter_stops"], why));
        }
        idle
    }

    fn needs(&self, _: Quantity) -> Answers {
        Answers::Surface
    }

    fn tracer(&self) -> Option<AnyTracer> {
        Some(AnyTracer::Ldi)
    }

    fn path_bounces(&self) -> Option<u32> {
        Some(BOUNCES)
    }

    fn costs(&self) -> [u64; 2] {
        [STAGES, u64::from(self.ldi_samples) * SAMPLE_BYTES]
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
            return on_gpu(self, scene, gpu, exact, order, progress);
        }
        ensure!(
            self.ldi_shadows != ShadowsChoice::Maps,
            "--ldi-shadows maps runs on a GPU: give --device gpu"
        );
        let tracers = ground.on_cpu().context("there is no tracer")?;
        let hybrid = Hybrid::new(scene, tracers, &self.params(&order))?;
        let stages = hybrid.render(order.camera, order.size, progress)?;
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
    args: &LdiTechnique,
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
    let params = args.params(&order);
    let shadow_maps = (args.ldi_shadows == ShadowsChoice::Maps).then(ShadowOptions::default);
    let hybrid = gpu.kept.get((params, order.size, shadow_maps), || {
        let (size, shadow_maps) = (order.size, shadow_maps.as_ref());
        let hybrid = isophote_ldi::gpu::Hybrid::new(context, world, &params, size, shadow_maps);
        Ok(hybrid?)
    })?;
    let times = hybrid.render(context, world, order.camera, progress)?;
    let mut stages = hybrid.read(context)?;
    let times = times.into_iter();
    let gpu_seconds: BTreeMap<String, f64> = times
        .map(|pass| (pass.name, pass.time.as_secs_f64()))
        .collect();
    for pass in &mut stages.passes {
        pass.seconds = gpu_seconds.get(pass.name).copied().unwrap_or_default();
    }
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
    let bounced = stages.diffuse.iter().zip(&stages.glossy);
    match quantity {
        Quantity::Direct => stages.direct.clone(),
        Quantity::Indirect => bounced
            .map(|(&diffuse, &glossy)| diffuse + glossy)
            .collect(),
        _ => stages.picture.clone(),
    }
}
