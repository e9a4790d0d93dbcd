//! The stages' textures brought back.

use glam::{Vec3, Vec4};
use isophote_scene::{Error, Pass, gpu::Context};

use super::{Hybrid, passes::Light};
use crate::{Result, Stages};

/// What is read.
const STAGE: &str = "reading a stage";

impl Hybrid {
    /// The stages' results, once what [`record`](Self::record) has recorded was submitted. Of what they took only rays are
    /// known.
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
        let buffer = &self.target.light;
        let samples = buffer.size() as usize / size_of::<Light>();
        let light: Vec<Light> = context.read("rays", buffer, samples)?;
        let sum = |word: usize, channel: usize| -> u64 {
            light.iter().map(|light| light[word][channel] as u64).sum()
        };
        let passes = [
            ("direct", sum(0, 3), 0),
            ("diffuse", sum(1, 3), sum(3, 0)),
            ("glossy", sum(2, 3), sum(3, 1)),
        ];
        let pass = |(name, rays, shadow_rays)| Pass {
            name,
            rays,
            shadow_rays,
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
