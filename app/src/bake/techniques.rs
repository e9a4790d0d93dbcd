//! What can be chosen of the techniques that bake.

use anyhow::{Result, bail, ensure};
use clap::Args;
use isophote_instant_gi::GiParams;
use isophote_ldm_ambient::{MapParams, PhotonParams};
use isophote_scene::reference::{Quantity, Settings};

use crate::{
    applies::{Idle, ids},
    technique::TechniqueChoice,
    values,
};

/// Flags of the techniques.
#[derive(Args, Clone, Copy, Debug)]
pub(super) struct Techniques {
    #[command(flatten)]
    ldm: LdmFlags,
    #[command(flatten)]
    igi: IgiFlags,
}

#[derive(Args, Clone, Copy, Debug)]
struct LdmFlags {
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=4096),
        help = "Photons of the technique ldm along each side of a light's view; a point light has six views")]
    ldm_photons: u32,
}

#[derive(Args, Clone, Copy, Debug)]
struct IgiFlags {
    /// Light paths of the technique igi
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    igi_paths: u32,
    /// Rays a receiver by which the technique igi finds the light of what is nearer than --min-d; without any, corners are darker
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(0..=1024))]
    igi_compensation: u32,
    /// From where on the virtual lights of the technique igi count [metres]
    #[arg(long, value_name = "METRES", default_value_t = 0.2, value_parser = values::not_negative)]
    min_d: f32,
}

impl Techniques {
    /// Refuses what a technique does not compute for receivers.
    pub(super) fn check(technique: TechniqueChoice, quantity: Quantity) -> Result<()> {
        match technique {
            TechniqueChoice::Reference => {}
            TechniqueChoice::Ldm => ensure!(
                quantity != Quantity::IrradiancePath,
                "the technique ldm bakes ao, obscurance, irradiance.direct and irradiance.indirect, but not {quantity}"
            ),
            TechniqueChoice::Igi => ensure!(
                quantity == Quantity::IrradianceIndirect,
                "the technique igi bakes irradiance.indirect, but not {quantity}"
            ),
            TechniqueChoice::Ldi => bail!(
                "the technique ldi filters pictures, which vertices and texels are not: choose reference, with --tracer ldi \
                 if its rays are to be answered by layered depth images"
            ),
            TechniqueChoice::Field => bail!(
                "the technique field is the technique reference with --tracer field: choose these"
            ),
        }
        Ok(())
    }

    /// Flags without effect.
    pub(super) fn idle(&self, technique: TechniqueChoice, quantity: Quantity) -> Vec<Idle> {
        let mut idle = Vec::new();
        match technique {
            TechniqueChoice::Ldm => {
                // Lights that have an extent are asked by rays.
                if quantity != Quantity::IrradianceDirect {
                    let why = "the technique ldm counts maps: --ldm-maps";
                    idle.extend(Idle::all(["samples"], why));
                }
                if quantity.is_occlusion() {
                    let why = "the technique ldm traces no rays";
                    idle.extend(Idle::all(["tracer"], why));
                    idle.extend(Idle::all(["ldm_photons"], "occlusion knows no light"));
                } else {
                    idle.extend(Idle::all(["tracer"], "photons are traced exactly"));
                    idle.extend(Idle::all(["path_bounces"], "photons bounce once"));
                    if quantity == Quantity::IrradianceDirect {
                        let why = "direct light is baked by rays and maps";
                        idle.extend(Idle::all(["ldm_photons"], why));
                    }
                }
            }
            TechniqueChoice::Igi => {
                let why = "the technique igi counts light paths: --igi-paths";
                idle.extend(Idle::all(["samples"], why));
                let why = "the light of virtual lights bounces once";
                idle.extend(Idle::all(["path_bounces"], why));
                if self.igi.min_d == 0.0 {
                    let why = "--min-d 0 leaves no light out that could be found again";
                    idle.extend(Idle::all(["igi_compensation"], why));
                }
            }
            _ => {}
        }
        for (of, flags) in [
            (TechniqueChoice::Ldm, ids::<LdmFlags>()),
            (TechniqueChoice::Igi, ids::<IgiFlags>()),
        ] {
            if of != technique {
                let why = format!("it is for --technique {}", of.name());
                idle.extend(Idle::all(flags, &why));
            }
        }
        idle
    }

    /// Of the technique `ldm`.
    pub(super) fn photons(
        &self,
        quantity: Quantity,
        maps: MapParams,
        settings: &Settings,
    ) -> PhotonParams {
        PhotonParams {
            maps,
            bounces: u32::from(quantity == Quantity::IrradianceIndirect),
            raster: self.ldm.ldm_photons,
            materials: settings.materials,
            normals: settings.normals,
            seed: settings.seed,
            ..PhotonParams::default()
        }
    }

    /// Of the technique `igi`.
    pub(super) fn virtual_lights(&self, settings: &Settings) -> GiParams {
        GiParams {
            paths: self.igi.igi_paths,
            compensation: self.igi.igi_compensation,
            min_d: self.igi.min_d,
            materials: settings.materials,
            seed: settings.seed,
            ..GiParams::default()
        }
    }
}
