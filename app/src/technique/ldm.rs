//! The technique `ldm`: occlusion and light by layered depth maps along fixed directions, by
//! `isophote-ldm-ambient`.

mod hbao;
mod light;
#[cfg(feature = "gpu")]
mod on_gpu;

use std::{collections::BTreeMap, f32::consts::PI};

use anyhow::{Context, Result, ensure};
use clap::{Args, ValueEnum};
use glam::Vec3;
use isophote_ldm_ambient::{
    Deposit, OcclusionParams, PhotonParams, Spread,
    cpu::{
        Points, Triangles,
        occlusion::{Occlusion, Sky},
        photons::light,
    },
};
use isophote_scene::{
    GBuffer, Pass, Scene, Tracer,
    reference::{Layers, Progress, Quantity, Tracers},
};

use self::light::{Light, Lighting, Lit, is_bounced, is_direct, is_irradiance};
use super::Technique;
use crate::{
    applies::Idle,
    reference::{Ground, Made, Order},
};

/// How the technique `ldm` makes pictures.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "The technique ldm")]
pub(crate) struct LdmTechnique {
    /// Points a pixel, which share the maps; more of them soften edges at the same cost
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=64))]
    ldm_samples: u32,
    /// Frames that are accumulated, each with its directions turned at random
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    ldm_frames: u32,
    /// Who finds what is in the way of ao and obscurance
    #[arg(long, value_enum, value_name = "METHOD", default_value = "maps")]
    ldm_occlusion: OcclusionChoice,
    /// Photons along each side of a light's view; a point light has six views
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=4096))]
    ldm_photons: u32,
    /// By how much a photon's splat is wider than its footprint
    #[arg(long, value_name = "FACTOR", default_value_t = PhotonParams::default().splat_size, value_parser = crate::values::not_negative)]
    ldm_splat_size: f32,
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=4096),
        help = "Photons along each side of a light's view where those that are gathered meet edges and shadows, and are \
                halved until they are as small; four times --ldm-photons unless given, and as many as those for none"
    )]
    ldm_finest: Option<u32>,
    /// Who finds whom: points the photons that light them, or photons the pixels that they light
    #[arg(long, value_enum, value_name = "WAY", default_value = "gathered")]
    ldm_deposit: DepositChoice,
    #[arg(
        long,
        value_enum,
        value_name = "WAY",
        help = "What splitting does to how photons that are splatted spread; parallel unless given"
    )]
    ldm_spread: Option<SpreadChoice>,
    #[arg(
        long,
        value_enum,
        value_name = "WAY",
        help = "How GPUs add splats up, which only differs in speed; tiled unless given"
    )]
    ldm_splat: Option<SplatChoice>,
    /// Diffuse reflections between the lights and what is lit
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=16))]
    ldm_bounces: u32,
    /// Directions in which a photon goes on to its second reflection; a half of them to the third, and so on
    #[arg(long, value_name = "N", default_value_t = PhotonParams::default().branches, value_parser = clap::value_parser!(u32).range(1..=1024))]
    ldm_branches: u32,
    /// How light comes straight from the lights; that of an environment comes by the maps
    #[arg(long, value_enum, value_name = "WAY", default_value = "rays")]
    ldm_direct: DirectChoice,
    /// What metals reflect of surfaces
    #[arg(long, value_enum, value_name = "WAY", default_value = "nearest")]
    ldm_glossy: GlossyChoice,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum DirectChoice {
    /// Shadow rays, exact
    Rays,
    /// The photons that land around a point: as many as --ldm-finest make out
    Photons,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum GlossyChoice {
    /// Metals are black
    None,
    /// Each ray is answered by the nearest direction of the maps
    Nearest,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum DepositChoice {
    /// Every point looks along the maps for what lights it
    Gathered,
    /// Every part of a photon is splatted where it lands, as in the paper
    Splatted,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SpreadChoice {
    /// Parts of neighbours run along the same map
    Parallel,
    /// Directional differentials turn as light does, as in the paper
    Turned,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SplatChoice {
    /// Listed for the tiles of the picture, which add them
    Tiled,
    /// Drawn as quads and added by blending, as in the paper
    Quads,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum OcclusionChoice {
    /// Layered depth maps
    Maps,
    /// What the camera sees alone: horizon-based ambient occlusion, to compare with
    Hbao,
}

/// How far splats reach out of their planes: a receiving surface is rarely one plane.
const SPLAT_FLATNESS: f32 = 3.0;

/// Values of the quantities, layers of their own, and what it took.
#[derive(Default)]
struct Found {
    values: BTreeMap<Quantity, Vec<Vec3>>,
    stages: Vec<(&'static str, Vec<Vec3>)>,
    passes: Vec<Pass>,
}

/// What some quantities need.
struct Uses {
    occlusion: bool,
    direct: bool,
    bounced: bool,
    /// Light that bounced is splatted.
    splatted: bool,
    /// Points look for photons.
    gathered: bool,
    /// Metals look along the maps.
    mirrored: bool,
}

impl LdmTechnique {
    fn occlusion(&self, order: &Order<'_>) -> OcclusionParams {
        OcclusionParams {
            maps: order.maps,
            d_max: order.settings.d_max,
            frames: self.ldm_frames,
            seed: order.settings.seed,
        }
    }
}

impl Technique for LdmTechnique {
    fn quantities(&self) -> &'static [Quantity] {
        &[
            Quantity::Ao,
            Quantity::Obscurance,
            Quantity::Direct,
            Quantity::Indirect,
            Quantity::Path,
            Quantity::IrradianceDirect,
            Quantity::IrradianceIndirect,
            Quantity::IrradiancePath,
        ]
    }

    fn idle(&self, quantities: &[Quantity]) -> Vec<Idle> {
        let Uses {
            occlusion,
            direct,
            bounced,
            splatted,
            gathered,
            mirrored,
        } = self.uses(quantities);
        let by_maps = occlusion && self.ldm_occlusion == OcclusionChoice::Maps;
        let is_light = direct || bounced;
        let splats = "it is for light that bounced and is splatted: --quantity indirect --ldm-deposit splatted";
        let all: [(&[&str], bool, &str); 12] = [
            (
                &["path_bounces", "min_d"],
                false,
                "the technique ldm does not know it",
            ),
            (&["spp"], false, "the technique ldm counts maps: --ldm-maps"),
            (
                &["ldm_maps", "ldm_resolution", "ldm_tolerance", "ldm_frames"],
                by_maps || is_light,
                "HBAO has no maps",
            ),
            (
                &["ldm_samples"],
                occlusion || direct || !splatted,
                "photons are splatted to one point of each pixel",
            ),
            (&["ldm_occlusion"], occlusion, "it is for ao and obscurance"),
            (
                &["ldm_photons", "ldm_splat_size"],
                splatted || gathered,
                "there are no photons: direct light is theirs with --ldm-direct photons",
            ),
            (
                &["ldm_finest"],
                gathered,
                "it is for photons that are gathered",
            ),
            (
                &["ldm_deposit", "ldm_bounces"],
                bounced,
                "it is for light that bounced",
            ),
            (&["ldm_spread", "ldm_splat"], splatted, splats),
            (
                &["ldm_branches"],
                bounced && self.ldm_bounces > 1,
                "it is for more than one of --ldm-bounces",
            ),
            (&["ldm_direct"], direct, "it is for direct light"),
            (
                &["ldm_glossy"],
                mirrored,
                "it is for the radiance of points that look along the maps",
            ),
        ];
        let idle = all.into_iter().filter(|(_, has_effect, _)| !has_effect);
        idle.flat_map(|(ids, _, why)| Idle::all(ids.iter().copied(), why))
            .collect()
    }

    fn has_own_tracer(&self) -> bool {
        true
    }

    fn path_bounces(&self) -> Option<u32> {
        Some(self.ldm_bounces + 1)
    }

    fn costs(&self) -> [u64; 2] {
        [1, 512]
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
            return on_gpu::render(self, scene, gpu, exact, &order, progress);
        }
        let Tracers { exact, .. } = ground.on_cpu().context("it runs on the CPU")?;
        ensure!(
            self.ldm_splat.is_none(),
            "--ldm-splat is how GPUs add splats up: leave it out, or add --device gpu"
        );
        let triangles = Triangles::new(scene, &scene.transforms(), order.selection)?;
        let mut found = Found::default();
        if order.wants(Quantity::is_occlusion) {
            self.find_occlusion(&triangles, exact, &order, progress, &mut found)?;
        }
        if order.wants(|quantity| !quantity.is_occlusion()) {
            self.find_light(&triangles, exact, &order, progress, &mut found)?;
        }
        let normals = order.settings.normals;
        let layers = Layers::of(scene, exact, order.camera, order.size, normals);
        Ok(found.made(&order, layers))
    }
}

impl Found {
    fn made(mut self, order: &Order<'_>, layers: Layers) -> Made {
        let passes = merged(&self.passes);
        let rays = passes.iter().map(|pass| pass.rays).sum();
        let values = |quantity: Quantity| self.values.remove(&quantity).unwrap_or_default();
        Made {
            stages: self.stages,
            ..super::made(order, layers, rays, &passes, values)
        }
    }

    fn skies(&mut self, skies: &[Sky]) {
        let splat =
            |value: fn(&Sky) -> f32| skies.iter().map(|sky| Vec3::splat(value(sky))).collect();
        self.values.insert(Quantity::Ao, splat(|sky| sky.ao));
        self.values
            .insert(Quantity::Obscurance, splat(|sky| sky.obscurance));
        let bent = skies.iter().map(|sky| sky.bent_normal).collect();
        self.stages.push(("bent-normal", bent));
    }

    fn light(&mut self, lit: Lit, order: &Order<'_>) {
        use Quantity::{
            Direct, Indirect, IrradianceDirect, IrradianceIndirect, IrradiancePath, Path,
        };
        if order.wants(|quantity| matches!(quantity, Path | IrradiancePath)) {
            let all = lit.direct.sum(&lit.indirect);
            self.values.insert(Path, all.radiance);
            self.values.insert(IrradiancePath, all.irradiance);
        }
        for (names, light) in [
            ([Direct, IrradianceDirect], lit.direct),
            ([Indirect, IrradianceIndirect], lit.indirect),
        ] {
            self.values.insert(names[0], light.radiance);
            self.values.insert(names[1], light.irradiance);
        }
    }
}

impl LdmTechnique {
    fn find_occlusion(
        &self,
        triangles: &Triangles<'_>,
        exact: &dyn Tracer,
        order: &Order<'_>,
        progress: &dyn Progress,
        found: &mut Found,
    ) -> Result<()> {
        let skies = match self.ldm_occlusion {
            OcclusionChoice::Maps => self.by_maps(triangles, exact, order, progress, found)?,
            OcclusionChoice::Hbao => self.by_hbao(triangles, exact, order, found)?,
        };
        found.skies(&skies);
        Ok(())
    }

    fn by_maps(
        &self,
        triangles: &Triangles<'_>,
        exact: &dyn Tracer,
        order: &Order<'_>,
        progress: &dyn Progress,
        found: &mut Found,
    ) -> Result<Vec<Sky>> {
        let [width, height] = order.size;
        let pixels = width as usize * height as usize;
        let normals = order.settings.normals;
        let mut occlusion = Occlusion::new(triangles, pixels, &self.occlusion(order))?;
        for sample in 0..self.ldm_samples {
            let points = Pass::timed(&mut found.passes, "camera", || {
                let scene = triangles.scene();
                let points =
                    Points::from_camera(scene, exact, order.camera, order.size, sample, normals);
                (points, [pixels as u64, 0])
            });
            Pass::timed(&mut found.passes, "occlusion", || {
                let before = occlusion.lookups();
                occlusion.add(&points, [sample, self.ldm_samples], progress);
                ((), [occlusion.lookups() - before, 0])
            });
        }
        Ok(occlusion.skies())
    }

    fn uses(&self, quantities: &[Quantity]) -> Uses {
        let wants = |kind: fn(Quantity) -> bool| quantities.iter().copied().any(kind);
        let (direct, bounced) = (wants(is_direct), wants(is_bounced));
        let splatted = bounced && self.ldm_deposit == DepositChoice::Splatted;
        let of_lights = direct && self.ldm_direct == DirectChoice::Photons;
        let is_radiance = |quantity: Quantity| !quantity.is_occlusion() && !is_irradiance(quantity);
        Uses {
            occlusion: wants(Quantity::is_occlusion),
            direct,
            bounced,
            splatted,
            gathered: (bounced && !splatted) || of_lights,
            mirrored: wants(is_radiance) && (direct || !splatted),
        }
    }

    fn photons(&self, order: &Order<'_>, deposit: DepositChoice) -> PhotonParams {
        let fine = PhotonParams::default();
        PhotonParams {
            maps: order.maps,
            raster: self.ldm_photons,
            finest: self.ldm_finest.unwrap_or((4 * self.ldm_photons).min(4096)),
            splat_size: self.ldm_splat_size,
            deposit: match deposit {
                DepositChoice::Gathered => Deposit::Gathered,
                DepositChoice::Splatted => Deposit::Splatted,
            },
            spread: match self.ldm_spread {
                Some(SpreadChoice::Turned) => Spread::Turned,
                Some(SpreadChoice::Parallel) | None => Spread::Parallel,
            },
            flatness: match deposit {
                DepositChoice::Gathered => fine.flatness,
                DepositChoice::Splatted => SPLAT_FLATNESS,
            },
            bounces: self.ldm_bounces,
            branches: self.ldm_branches,
            frames: self.ldm_frames,
            materials: order.settings.materials,
            normals: order.settings.normals,
            seed: order.settings.seed,
            ..fine
        }
    }

    /// Photons that points look for: those that light bounces from where it is gathered, and those of lights where direct light is
    /// theirs.
    fn gathered(&self, order: &Order<'_>, bounces: bool) -> PhotonParams {
        PhotonParams {
            bounces: match bounces && order.wants(is_bounced) {
                true => self.ldm_bounces,
                false => 0,
            },
            direct: order.wants(is_direct) && self.ldm_direct == DirectChoice::Photons,
            spread: Spread::Parallel,
            ..self.photons(order, DepositChoice::Gathered)
        }
    }

    fn find_light(
        &self,
        triangles: &Triangles<'_>,
        exact: &dyn Tracer,
        order: &Order<'_>,
        progress: &dyn Progress,
        found: &mut Found,
    ) -> Result<()> {
        let splatted = self.uses(order.quantities).splatted;
        let lighting = Lighting {
            technique: self,
            triangles,
            exact,
            order,
            progress,
        };
        let mut lit = match splatted && !order.wants(is_direct) {
            true => Lit::default(),
            false => lighting.gather(found)?,
        };
        if splatted {
            lit.indirect = self.by_splatting(triangles, exact, order, progress, found)?;
        }
        found.light(lit, order);
        Ok(())
    }

    fn by_splatting(
        &self,
        triangles: &Triangles<'_>,
        exact: &dyn Tracer,
        order: &Order<'_>,
        progress: &dyn Progress,
        found: &mut Found,
    ) -> Result<Light> {
        let seen = self.see(triangles, exact, order, found);
        let params = self.photons(order, DepositChoice::Splatted);
        let lit = light(triangles, exact, order.camera, &seen, &params, progress)?;
        let pixels = seen.pixels.iter().zip(&lit.indirect);
        let radiance = pixels.map(|(seen, &irradiance)| {
            let albedo = seen.as_ref().map_or(Vec3::ZERO, |seen| seen.albedo());
            albedo / PI * irradiance
        });
        let radiance = radiance.collect();
        found.passes.extend(lit.passes);
        Ok(Light {
            radiance,
            irradiance: lit.indirect,
        })
    }

    fn see(
        &self,
        triangles: &Triangles<'_>,
        exact: &dyn Tracer,
        order: &Order<'_>,
        found: &mut Found,
    ) -> GBuffer {
        Pass::timed(&mut found.passes, "camera", || {
            let materials = order.settings.materials;
            let seen = GBuffer::see(
                triangles.scene(),
                exact,
                order.camera,
                order.size,
                materials,
            );
            let rays = seen.pixels.len() as u64;
            (seen, [rays, 0])
        })
    }
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
