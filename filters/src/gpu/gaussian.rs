//! Twin of the slices' [`Gaussian`](crate::Gaussian).

use bytemuck::{Pod, Zeroable};
use isophote_scene::gpu::Context;
use wgpu::{BindingResource, TextureView};

use super::{
    guides::Guides,
    pass::{EdgeParams, Format, Pass, expect_size, texture, whole},
};
use crate::{EdgeStop, Result, error::require};

/// A Gaussian blur of pictures of one size, plain or stopped at edges. Twin of [`crate::Gaussian`].
#[derive(Debug)]
pub struct Gaussian {
    passes: [Pass; 2],
    is_guided: bool,
    size: [u32; 2],
    weights: wgpu::Buffer,
    half: TextureView,
}

/// `Params` of gaussian.wesl.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    stop: EdgeParams,
    direction: [i32; 2],
    radius: i32,
    padding: u32,
}

impl Gaussian {
    /// A blur of `[width, height]` pixels; with `edges`, [`record`](Self::record) needs guides.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) when the device allows no such texture.
    pub fn new(
        context: &Context,
        gaussian: &crate::Gaussian,
        edges: Option<EdgeStop>,
        size: [u32; 2],
        format: Format,
    ) -> Result<Self> {
        let pass = |direction| {
            let params = Params {
                stop: edges.unwrap_or_default().into(),
                direction,
                radius: (gaussian.weights.len() / 2) as i32,
                padding: 0,
            };
            let entry_point = if edges.is_some() {
                "blur_guided"
            } else {
                "blur"
            };
            Pass::new(context, ["gaussian", entry_point], format, &params)
        };
        let half = texture(context, "Gaussian, half done", size, format.texture())?;
        Ok(Self {
            passes: [pass([0, 1])?, pass([1, 0])?],
            is_guided: edges.is_some(),
            size,
            weights: context.buffer(
                "Gaussian's weights",
                &gaussian.weights,
                wgpu::BufferUsages::STORAGE,
            )?,
            half: whole(&half),
        })
    }

    /// Blurs `image` into `output`. Guides are needed where the blur stops at edges, and not looked at elsewhere.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when needed guides are missing,
    /// [`Error::Size`](crate::Error::Size) and [`Error::Gpu`](crate::Error::Gpu) when the textures do not fit.
    pub fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        image: &TextureView,
        guides: Option<&Guides>,
        output: &TextureView,
    ) -> Result<()> {
        expect_size("the image", image, self.size)?;
        expect_size("the output", output, self.size)?;
        let guides = guides.filter(|_| self.is_guided);
        require(
            guides.is_some() == self.is_guided,
            "the Gaussian's guides",
            "missing",
            "a blur that stops at edges needs them",
        )?;
        if let Some(guides) = guides {
            expect_size("the guides", guides.view(), self.size)?;
        }
        let targets = [(image, &self.half), (&self.half, output)];
        for (pass, (source, target)) in self.passes.iter().zip(targets) {
            let resources = [
                BindingResource::TextureView(source),
                BindingResource::TextureView(target),
                self.weights.as_entire_binding(),
            ];
            pass.record(context, encoder, self.size, &resources, guides)?;
        }
        Ok(())
    }
}
