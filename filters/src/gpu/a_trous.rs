//! Twin of the slices' [`ATrous`](crate::ATrous).

use bytemuck::{Pod, Zeroable};
use isophote_scene::gpu::Context;
use wgpu::{BindingResource, TextureView};

use super::{
    guides::Guides,
    pass::{EdgeParams, Format, Pass, expect_size, texture, whole},
};
use crate::Result;

/// The edge-avoiding à-trous wavelet for pictures of one size. Twin of [`crate::ATrous`].
#[derive(Debug)]
pub struct ATrous {
    levels: Vec<Pass>,
    size: [u32; 2],
    between: [TextureView; 2],
}

/// `Level` of `a_trous.wesl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Level {
    stop: EdgeParams,
    spacing: i32,
    per_square: f32,
    padding: [u32; 2],
}

impl ATrous {
    /// A filter for pictures of `[width, height]` pixels.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) when the device allows no such textures.
    pub fn new(
        context: &Context,
        filter: &crate::ATrous,
        size: [u32; 2],
        format: Format,
    ) -> Result<Self> {
        let level = |level: usize| {
            let params = Level {
                stop: filter.edges.into(),
                spacing: 1 << level,
                per_square: filter.per_square(level),
                padding: [0; 2],
            };
            Pass::new(context, ["a_trous", "smooth_level"], format, &params)
        };
        let between = || -> Result<TextureView> {
            let texture = texture(context, "between levels", size, format.texture())?;
            Ok(whole(&texture))
        };
        Ok(Self {
            levels: (0..filter.levels).map(level).collect::<Result<_>>()?,
            size,
            between: [between()?, between()?],
        })
    }

    /// Filters `image` into `output`.
    ///
    /// # Errors
    /// [`Error::Size`](crate::Error::Size) and [`Error::Gpu`](crate::Error::Gpu) when the textures do not fit.
    pub fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        image: &TextureView,
        guides: &Guides,
        output: &TextureView,
    ) -> Result<()> {
        expect_size("the image", image, self.size)?;
        expect_size("the output", output, self.size)?;
        expect_size("the guides", guides.view(), self.size)?;
        let mut source = image;
        for (number, level) in self.levels.iter().enumerate() {
            let target = if number + 1 == self.levels.len() {
                output
            } else {
                &self.between[number % 2]
            };
            let resources = [source, target].map(BindingResource::TextureView);
            level.record(context, encoder, self.size, &resources, Some(guides))?;
            source = target;
        }
        Ok(())
    }
}
