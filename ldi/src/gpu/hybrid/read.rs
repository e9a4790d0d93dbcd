//! The stages' textures brought back.

use glam::{Vec3, Vec4};
use isophote_scene::{Error, Pass, gpu::Context};

use super::Hybrid;
use crate::{Result, Stages};

/// What is read.
const STAGE: &str = "reading a stage";

impl Hybrid {
    /// The stages' results, once what [`record`](Self::record) has recorded was submitted. Of what they took only rays are
    /// known, those towards lights from what secondary rays hit among them.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the device fails, leaves pixels unwritten or calculates what is no number.
    pub fn read(&self, context: &Context) -> Result<Stages> {
        let stages = &self.stages;
        Ok(Stages {
            direct: read(context, &stages.direct, true)?,
            irradiance: read(context, &stages.irradiance, false)?,
            filtered: read(context, &stages.filtered, true)?,
            diffuse: read(context, &stages.diffuse, true)?,
            glossy: read(context, &stages.glossy, true)?,
            picture: read(context, &stages.picture, true)?,
            passes: self.rays(context)?,
        })
    }

    fn rays(&self, context: &Context) -> Result<Vec<Pass>> {
        let normals: Vec<Vec4> = context.read_texture(STAGE, self.target.normals.texture())?;
        let depths: Vec<Vec4> = context.read_texture(STAGE, self.target.depths.texture())?;
        let sum = |texels: &[Vec4], channel: usize| -> u64 {
            texels.iter().map(|texel| texel[channel] as u64).sum()
        };
        let passes = [
            ("direct", sum(&normals, 3)),
            ("diffuse", sum(&depths, 1)),
            ("glossy", sum(&depths, 2)),
        ];
        let pass = |(name, rays)| Pass {
            name,
            rays,
            ..Pass::default()
        };
        Ok(passes.map(pass).into())
    }
}

/// The colours of a texture; `marked` ones have 1 in the fourth channel of every pixel that was written.
fn read(context: &Context, texture: &wgpu::Texture, marked: bool) -> Result<Vec<Vec3>> {
    let texels: Vec<Vec4> = context.read_texture(STAGE, texture)?;
    let colors = texels.into_iter().map(|texel| {
        let color = texel.truncate();
        if color.is_finite() && (!marked || texel.w == 1.0) {
            return Ok(color);
        }
        Err(Error::Gpu {
            what: "the hybrid renderer".into(),
            reason: format!(
                "a pixel is {texel}: the device did not finish, or its driver is broken"
            ),
        }
        .into())
    });
    colors.collect()
}
