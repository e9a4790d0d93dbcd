//! Twins of the slices' [`Temporal`](crate::Temporal) and [`camera_motion`](crate::camera_motion).

use bytemuck::{Pod, Zeroable};
use isophote_scene::gpu::Context;
use wgpu::{BindingResource, TextureFormat, TextureView};

use super::{
    guides::{CameraParams, Guides},
    pass::{Format, Pass, expect_size, texture, whole},
};
use crate::{Pinhole, Result};

/// Temporal accumulation of pictures of one size, with its history. Twin of [`crate::Temporal`] and
/// [`crate::History`].
#[derive(Debug)]
pub struct Temporal {
    /// Without and with a history.
    passes: [Pass; 2],
    size: [u32; 2],
    /// Results, taking turns.
    values: [TextureView; 2],
    lengths: [TextureView; 2],
    /// What the last picture saw.
    surfaces: wgpu::Texture,
    slopes: wgpu::Texture,
    /// Pictures so far.
    count: u64,
}

/// `Params` of temporal.wesl.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    max_pictures: f32,
    clamp: f32,
    cosine: f32,
    depth: f32,
    continued: u32,
    padding: [u32; 3],
}

impl Temporal {
    /// An empty history of pictures of `[width, height]` pixels.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) when the device allows no such textures.
    pub fn new(
        context: &Context,
        filter: &crate::Temporal,
        size: [u32; 2],
        format: Format,
    ) -> Result<Self> {
        let params = &filter.params;
        let pass = |continued| {
            let params = Params {
                max_pictures: params.max_pictures as f32,
                clamp: if params.clamp < f32::INFINITY {
                    params.clamp
                } else {
                    -1.0
                },
                cosine: params.thresholds.cosine(),
                depth: params.thresholds.depth.min(f32::MAX),
                continued,
                padding: [0; 3],
            };
            Pass::new(context, ["temporal", "accumulate"], format, &params)
        };
        let make = |label, format| texture(context, label, size, format);
        let values = || -> Result<TextureView> {
            Ok(whole(&make("accumulated picture", format.texture())?))
        };
        let lengths = || -> Result<TextureView> {
            Ok(whole(&make("history's lengths", TextureFormat::R32Float)?))
        };
        let single = TextureFormat::Rgba32Float;
        Ok(Self {
            passes: [pass(0)?, pass(1)?],
            size,
            values: [values()?, values()?],
            lengths: [lengths()?, lengths()?],
            surfaces: make("former normals and inverse depths", single)?,
            slopes: make("former slopes", single)?,
            count: 0,
        })
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds a picture to the history. `motion` holds what [`crate::Temporal::apply`] says in its first three channels;
    /// a place outside of all pictures has no history. It is not looked at for the first picture.
    ///
    /// # Errors
    /// [`Error::Size`](crate::Error::Size) and [`Error::Gpu`](crate::Error::Gpu) when the textures do not fit.
    pub fn record(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        image: &TextureView,
        guides: &Guides,
        motion: &TextureView,
    ) -> Result<()> {
        expect_size("the image", image, self.size)?;
        expect_size("the motion", motion, self.size)?;
        expect_size("the guides", guides.view(), self.size)?;
        let pass = &self.passes[usize::from(self.count > 0)];
        let new = (self.count % 2) as usize;
        let former = [whole(&self.surfaces), whole(&self.slopes)];
        let view = BindingResource::TextureView;
        let resources = [
            view(image),
            view(&self.values[new]),
            view(&self.values[1 - new]),
            view(&self.lengths[1 - new]),
            view(&former[0]),
            view(&former[1]),
            view(motion),
            view(&self.lengths[new]),
        ];
        pass.record(context, encoder, self.size, &resources, Some(guides))?;
        let extent = self.surfaces.size();
        for (from, to) in [
            (&guides.surfaces, &self.surfaces),
            (&guides.slopes, &self.slopes),
        ] {
            encoder.copy_texture_to_texture(from.as_image_copy(), to.as_image_copy(), extent);
        }
        self.count += 1;
        Ok(())
    }

    /// The accumulated picture as of the last [`record`](Self::record).
    pub fn values(&self) -> &TextureView {
        &self.values[self.last()]
    }

    /// In how many pictures each pixel's surface was seen, in the first channel.
    pub fn lengths(&self) -> &TextureView {
        &self.lengths[self.last()]
    }

    const fn last(&self) -> usize {
        (self.count + 1) as usize % 2
    }
}

/// Where the surfaces of a still scene were in the picture before. Twin of [`crate::camera_motion`].
#[derive(Debug)]
pub struct CameraMotion(Pass);

/// `Cameras` of `camera_motion.wesl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Cameras {
    now: CameraParams,
    before: CameraParams,
}

impl CameraMotion {
    /// For a camera that moved; [`set_cameras`](Self::set_cameras) says where it moves next.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) when the device fails.
    pub fn new(context: &Context, now: &Pinhole, before: &Pinhole) -> Result<Self> {
        Ok(Self(Pass::new(
            context,
            ["camera_motion", "move_camera"],
            Format::Single,
            &Self::params(now, before),
        )?))
    }

    /// The cameras of what is recorded from the next submission on.
    pub fn set_cameras(&self, context: &Context, now: &Pinhole, before: &Pinhole) {
        self.0.set_params(context, &Self::params(now, before));
    }

    /// Writes to `motion` (`Rgba32Float`) from `depths`, the first channel of a texture of the same size.
    ///
    /// # Errors
    /// [`Error::Size`](crate::Error::Size) and [`Error::Gpu`](crate::Error::Gpu) when the textures do not fit.
    pub fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        depths: &TextureView,
        motion: &TextureView,
    ) -> Result<()> {
        let size = [motion.texture().width(), motion.texture().height()];
        expect_size("the depths", depths, size)?;
        let resources = [depths, motion].map(BindingResource::TextureView);
        self.0.record(context, encoder, size, &resources, None)
    }

    fn params(now: &Pinhole, before: &Pinhole) -> Cameras {
        Cameras {
            now: now.into(),
            before: before.into(),
        }
    }
}
