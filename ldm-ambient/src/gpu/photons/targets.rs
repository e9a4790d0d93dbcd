//! The light of photons, in textures and read back.

use glam::{Vec3, Vec4};
use isophote_scene::gpu::Context;

use crate::{
    Result,
    gpu::{broken, target},
};

/// Textures that [`Photons::resolve`](super::Photons::resolve) fills: `Rgba32Float` with the usage `STORAGE_BINDING`, of the size of the picture. Their
/// fourth number is 1.
#[derive(Clone, Debug)]
pub struct Targets {
    /// Irradiance by light that bounced, W/m².
    pub irradiance: wgpu::Texture,
    /// The radiance of it that diffuse surfaces send to the camera, W/(sr·m²).
    pub radiance: wgpu::Texture,
}

/// The light of a picture, row by row from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Light {
    /// W/m².
    pub irradiance: Vec<Vec3>,
    /// W/(sr·m²).
    pub radiance: Vec<Vec3>,
}

impl Targets {
    /// Textures of a size in pixels, which can also be read by shaders and copied.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the device has no textures that large.
    pub fn new(context: &Context, size: [u32; 2]) -> Result<Self> {
        Ok(Self {
            irradiance: target(context, "irradiance", size)?,
            radiance: target(context, "radiance", size)?,
        })
    }

    /// Reads back what was submitted.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the device fails, or has not filled them.
    pub fn read(&self, context: &Context) -> Result<Light> {
        let read = |label, texture| -> Result<Vec<Vec3>> {
            let values: Vec<Vec4> = context.read_texture(label, texture)?;
            if values
                .iter()
                .any(|value| value.w != 1.0 || !value.is_finite())
            {
                return Err(broken("the device did not finish, or its driver is broken"));
            }
            Ok(values.into_iter().map(Vec4::truncate).collect())
        };
        Ok(Light {
            irradiance: read("irradiance", &self.irradiance)?,
            radiance: read("radiance", &self.radiance)?,
        })
    }
}
