//! The light of a picture, and the textures that it is written to.

use glam::Vec4;
use isophote_scene::gpu::Context;

use super::super::{
    broken,
    photons::{Light, Targets},
};
use crate::Result;

/// The light of a picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lit {
    /// Straight from the lights and from the environment; irradiance is empty unless it is wanted.
    pub direct: Light,
    /// That bounced.
    pub indirect: Light,
}

/// Textures that [`Gather::resolve`](super::Gather::resolve) fills.
#[derive(Clone, Debug)]
pub struct LitTargets {
    /// Straight from the lights and from the environment; behind the radiance stand 1 and the shadow rays it took.
    pub direct: Targets,
    /// That bounced.
    pub indirect: Targets,
}

impl LitTargets {
    /// Textures of a size in pixels, which can also be read by shaders and copied.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the device has no textures that large.
    pub fn new(context: &Context, size: [u32; 2]) -> Result<Self> {
        Ok(Self {
            direct: Targets::new(context, size)?,
            indirect: Targets::new(context, size)?,
        })
    }

    /// Reads back what was submitted, and how many shadow rays it took.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the device fails, or has not filled them.
    pub fn read(&self, context: &Context) -> Result<(Lit, u64)> {
        let irradiance: Vec<Vec4> = context.read_texture("irradiance", &self.direct.irradiance)?;
        let radiance: Vec<Vec4> = context.read_texture("radiance", &self.direct.radiance)?;
        let is_broken = |value: &Vec4| value.w < 1.0 || !value.is_finite();
        if irradiance.iter().chain(&radiance).any(is_broken) {
            return Err(broken("the device did not finish, or its driver is broken"));
        }
        let rays = radiance.iter().map(|value| value.w as u64 - 1).sum();
        let lit = Lit {
            direct: Light {
                irradiance: irradiance.into_iter().map(Vec4::truncate).collect(),
                radiance: radiance.into_iter().map(Vec4::truncate).collect(),
            },
            indirect: self.indirect.read(context)?,
        };
        Ok((lit, rays))
    }
}
