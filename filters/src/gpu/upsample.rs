//! Twins of the slices' [`JointBilateral`](crate::JointBilateral) and [`SinglePass`](crate::SinglePass).

use bytemuck::{Pod, Zeroable};
use isophote_scene::gpu::Context;
use wgpu::{BindingResource, TextureView};

use super::{
    guides::Guides,
    pass::{EdgeParams, Format, Pass, expect_size},
};
use crate::{
    Neighborhood, Result,
    upsample::{SampleGrid, Upsampling},
};

/// Joint bilateral upsampling. Twin of [`crate::JointBilateral`].
#[derive(Debug)]
pub struct JointBilateral(Upsampler);

impl JointBilateral {
    /// A filter for pictures of any size.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) when the device fails.
    pub fn new(context: &Context, filter: &crate::JointBilateral, format: Format) -> Result<Self> {
        let mut upsampling = filter.upsampling.clone();
        if upsampling.factor == 1 {
            // A copy: with so narrow a Gaussian a pixel's own sample counts alone.
            upsampling.around = Neighborhood {
                radius: 1,
                sigma: 0.01,
                reach: 1,
            };
        }
        Ok(Self(Upsampler::new(context, &upsampling, format)?))
    }

    /// Upsamples the samples of a [`SampleGrid`] into `output`, of the size of the guides.
    ///
    /// # Errors
    /// [`Error::Size`](crate::Error::Size) and [`Error::Gpu`](crate::Error::Gpu) when the textures do not fit.
    pub fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        samples: &TextureView,
        guides: &Guides,
        output: &TextureView,
    ) -> Result<()> {
        self.0.record(context, encoder, samples, guides, output)
    }
}

/// Upsampling and joining of interleaved tiles in a single pass. Twin of [`crate::SinglePass`].
#[derive(Debug)]
pub struct SinglePass(Upsampler);

impl SinglePass {
    /// A filter for pictures of any size.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) when the device fails.
    pub fn new(context: &Context, filter: &crate::SinglePass, format: Format) -> Result<Self> {
        Ok(Self(Upsampler::new(context, &filter.upsampling, format)?))
    }

    /// Filters the samples of a [`SampleGrid`] into `output`, of the size of the guides.
    ///
    /// # Errors
    /// [`Error::Size`](crate::Error::Size) and [`Error::Gpu`](crate::Error::Gpu) when the textures do not fit.
    pub fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        samples: &TextureView,
        guides: &Guides,
        output: &TextureView,
    ) -> Result<()> {
        self.0.record(context, encoder, samples, guides, output)
    }
}

#[derive(Debug)]
struct Upsampler {
    pass: Pass,
    factor: usize,
}

/// `Params` of upsample.wesl.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    stop: EdgeParams,
    tile: [i32; 2],
    factor: i32,
    radius: i32,
    reach: i32,
    sigma: f32,
    padding: [u32; 2],
}

impl Upsampler {
    fn new(context: &Context, upsampling: &Upsampling, format: Format) -> Result<Self> {
        let params = Params {
            stop: upsampling.edges.into(),
            tile: upsampling.tile.map(|side| side as i32),
            factor: upsampling.factor as i32,
            radius: upsampling.around.radius as i32,
            reach: upsampling.around.reach as i32,
            sigma: upsampling.around.sigma,
            padding: [0; 2],
        };
        Ok(Self {
            pass: Pass::new(context, ["upsample", "upsample"], format, &params)?,
            factor: upsampling.factor,
        })
    }

    fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        samples: &TextureView,
        guides: &Guides,
        output: &TextureView,
    ) -> Result<()> {
        let full = guides.size().map(|side| side as usize);
        let coarse = SampleGrid::new(full, self.factor)?.size();
        expect_size(
            "the image of samples",
            samples,
            coarse.map(|side| side as u32),
        )?;
        expect_size("the output", output, guides.size())?;
        let resources = [samples, output].map(BindingResource::TextureView);
        self.pass
            .record(context, encoder, guides.size(), &resources, Some(guides))
    }
}
