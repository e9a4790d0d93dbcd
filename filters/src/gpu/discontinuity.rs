//! Twin of the slices' [`DiscontinuityBuffer`](crate::DiscontinuityBuffer).

use bytemuck::{Pod, Zeroable};
use isophote_scene::gpu::Context;
use wgpu::{BindingResource, TextureView};

use super::{
    guides::Guides,
    pass::{Format, Pass, expect_size},
};
use crate::Result;

/// Joins the tiles of interleaved sampling. Twin of [`crate::DiscontinuityBuffer`].
#[derive(Debug)]
pub struct DiscontinuityBuffer(Pass);

/// `Params` of discontinuity.wesl.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    tile: [i32; 2],
    cosine: f32,
    depth: f32,
}

impl DiscontinuityBuffer {
    /// A filter for pictures of any size.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) when the device fails.
    pub fn new(
        context: &Context,
        filter: &crate::DiscontinuityBuffer,
        format: Format,
    ) -> Result<Self> {
        let params = Params {
            tile: filter.tile.map(|side| side as i32),
            cosine: filter.thresholds.cosine(),
            depth: filter.thresholds.depth.min(f32::MAX),
        };
        let shader = ["discontinuity", "join_tiles"];
        Ok(Self(Pass::new(context, shader, format, &params)?))
    }

    /// Filters `image` into `output`, both of the size of the guides.
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
        expect_size("the image", image, guides.size())?;
        expect_size("the output", output, guides.size())?;
        let resources = [image, output].map(BindingResource::TextureView);
        self.0
            .record(context, encoder, guides.size(), &resources, Some(guides))
    }
}
