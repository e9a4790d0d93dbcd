//! The technique `ldm`: occlusion by layered depth maps along fixed directions, by `isophote-ldm-ambient`.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use clap::Args;
use glam::Vec3;
use isophote_ldm_ambient::{
    MapParams, OcclusionParams,
    cpu::{
        Points, Triangles,
        occlusion::{Occlusion, Sky},
    },
};
use isophote_scene::{
    Pass, Scene,
    reference::{Estimate, Layers, Progress, Quantity, Render},
};

use super::Technique;
use crate::{
    applies::Idle,
    reference::{Ground, Made, Order},
};

/// How the technique `ldm` makes pictures.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "The technique ldm")]
pub(crate) struct LdmTechnique {
    /// Maps; each answers for two opposite directions
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    ldm_maps: u32,
    /// A map has at most R² pixels
    #[arg(long, value_name = "R", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=4096))]
    ldm_resolution: u32,
    /// What is nearer is the surface itself [pixels of a map]
    #[arg(long, value_name = "PIXELS", default_value_t = MapParams::default().tolerance, value_parser = crate::values::not_negative)]
    ldm_tolerance: f32,
    /// Points a pixel, which share the maps; more of them soften edges at the same cost
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=64))]
    ldm_samples: u32,
    /// Frames that are accumulated, each with its directions turned at random
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    ldm_frames: u32,
}

impl LdmTechnique {
    fn maps(&self) -> MapParams {
        MapParams {
            maps: self.ldm_maps,
            resolution: self.ldm_resolution,
            tolerance: self.ldm_tolerance,
            ..MapParams::default()
        }
    }

    fn occlusion(&self, order: &Order<'_>) -> OcclusionParams {
        OcclusionParams {
            maps: self.maps(),
            d_max: order.settings.d_max,
            frames: self.ldm_frames,
            seed: order.settings.seed,
        }
    }
}

impl Technique for LdmTechnique {
    fn quantities(&self) -> &'static [Quantity] {
        &[Quantity::Ao, Quantity::Obscurance]
    }

    fn idle(&self) -> Vec<Idle> {
        let mut idle: Vec<Idle> = Idle::all(
            ["path_bounces", "min_d", "materials"],
            "the technique ldm does not know it",
        )
        .collect();
        let why = "the technique ldm counts maps: --ldm-maps";
        idle.extend(Idle::all(["spp"], why));
        idle
    }

    fn runs_on_gpu(&self) -> bool {
        false
    }

    fn costs(&self) -> [u64; 2] {
        [1, 256]
    }

    fn render(
        &self,
        scene: &Scene,
        ground: &Ground,
        order: Order<'_>,
        progress: &dyn Progress,
    ) -> Result<Made> {
        let exact = ground.on_cpu().context("it runs on the CPU")?.exact;
        let [width, height] = order.size;
        let pixels = width as usize * height as usize;
        let normals = order.settings.normals;
        let mut passes = Vec::new();
        let triangles = Triangles::new(scene, &scene.transforms(), order.selection)?;
        let mut occlusion = Occlusion::new(&triangles, pixels, &self.occlusion(&order))?;
        for sample in 0..self.ldm_samples {
            let points = Pass::timed(&mut passes, "camera", || {
                let points =
                    Points::from_camera(scene, exact, order.camera, order.size, sample, normals);
                (points, [pixels as u64, 0])
            });
            Pass::timed(&mut passes, "occlusion", || {
                let before = occlusion.lookups();
                occlusion.add(&points, [sample, self.ldm_samples], progress);
                ((), [occlusion.lookups() - before, 0])
            });
        }
        let passes = merged(&passes);
        let skies = occlusion.skies();
        let estimate = |&quantity| Estimate {
            quantity,
            values: values(&skies, quantity),
            // There are no two halves.
            noise: f32::NAN,
        };
        let render = Render {
            size: order.size,
            estimates: order.quantities.iter().map(estimate).collect(),
            layers: Layers::of(scene, exact, order.camera, order.size, normals),
            rays: passes.iter().map(|pass| pass.rays).sum(),
        };
        let bent = skies.iter().map(|sky| sky.bent_normal).collect();
        Ok(Made {
            render,
            stages: vec![("bent-normal", bent)],
            passes,
            gpu_seconds: BTreeMap::new(),
        })
    }
}

fn values(skies: &[Sky], quantity: Quantity) -> Vec<Vec3> {
    let value = |sky: &Sky| match quantity {
        Quantity::Obscurance => sky.obscurance,
        _ => sky.ao,
    };
    skies.iter().map(|sky| Vec3::splat(value(sky))).collect()
}

/// One pass of each name, in the order of the first of each.
fn merged(passes: &[Pass]) -> Vec<Pass> {
    let mut merged: Vec<Pass> = Vec::new();
    for pass in passes {
        match merged.iter_mut().find(|other| other.name == pass.name) {
            Some(sum) => {
                sum.rays += pass.rays;
                sum.seconds += pass.seconds;
            }
            None => merged.push(*pass),
        }
    }
    merged
}
