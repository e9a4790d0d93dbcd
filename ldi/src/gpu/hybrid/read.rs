//! The stages' textures brought back.

use glam::{Vec3, Vec4};
use isophote_scene::{Error, Pass, gpu::Context};

use super::Hybrid;
use crate::{Result, Stages};

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
        let normals = texels(context, self.target.normals.texture())?;
        let depths = texels(context, self.target.depths.texture())?;
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
    let colors = texels(context, texture)?.into_iter().map(|texel| {
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

/// All of a texture, row by row.
fn texels(context: &Context, texture: &wgpu::Texture) -> Result<Vec<Vec4>> {
    let (width, height) = (texture.width(), texture.height());
    let row = (16 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let what = "reading a stage";
    let buffer = context.check(what, |device| {
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(what),
            size: u64::from(row) * u64::from(height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        let target = wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(row),
                rows_per_image: None,
            },
        };
        encoder.copy_texture_to_buffer(texture.as_image_copy(), target, texture.size());
        context.queue().submit([encoder.finish()]);
        buffer
    })?;
    let texels: Vec<Vec4> = context.read(what, &buffer, (row / 16 * height) as usize)?;
    let rows = texels.chunks_exact(row as usize / 16);
    Ok(rows
        .flat_map(|row| &row[..width as usize])
        .copied()
        .collect())
}
