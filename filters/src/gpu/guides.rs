//! Normals and depths, prepared. Twin of the slices' [`Guides`](crate::Guides).

use bytemuck::{Pod, Zeroable};
use isophote_scene::gpu::Context;
use wgpu::{BindingResource, TextureFormat, TextureView};

use super::pass::{Format, Pass, expect_size, texture, whole};
use crate::{MAX_SIDE, Pinhole, Result};

/// The bindings that edges.wesl reads guides from.
const BINDINGS: [u32; 2] = [10, 11];

/// Normals and depths of a picture of one size, prepared for the filters; [`record`](Self::record) prepares them anew
/// for each picture. Twin of [`crate::Guides`].
#[derive(Debug)]
pub struct Guides {
    pass: Pass,
    size: [u32; 2],
    pub(super) surfaces: wgpu::Texture,
    pub(super) slopes: wgpu::Texture,
    views: [TextureView; 2],
}

/// `Camera` of guides.wesl.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct CameraParams {
    position: [f32; 3],
    tan_half_yfov: f32,
    right: [f32; 3],
    padding: u32,
    up: [f32; 3],
    more_padding: u32,
    forward: [f32; 3],
    last_padding: u32,
}

impl From<&Pinhole> for CameraParams {
    fn from(camera: &Pinhole) -> Self {
        Self {
            position: camera.position,
            tan_half_yfov: camera.tan_half_yfov,
            right: camera.right,
            up: camera.up,
            forward: camera.forward,
            ..Self::zeroed()
        }
    }
}

impl Guides {
    /// For pictures of `[width, height]` pixels that `camera` sees; [`set_camera`](Self::set_camera) changes it.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) for a side of 0, [`Error::Gpu`](crate::Error::Gpu) when the
    /// device allows no such textures.
    pub fn new(context: &Context, size: [u32; 2], camera: &Pinhole) -> Result<Self> {
        for side in size {
            crate::error::require(
                (1..=MAX_SIDE as u32).contains(&side),
                "a side of the picture",
                side,
                "it must be 1 to 65536",
            )?;
        }
        let format = TextureFormat::Rgba32Float;
        let pass = Pass::new(
            context,
            ["prepare_guides", "prepare_guides"],
            Format::Single,
            &CameraParams::from(camera),
        )?;
        let surfaces = texture(context, "normals and inverse depths", size, format)?;
        let slopes = texture(context, "slopes of tangent planes", size, format)?;
        Ok(Self {
            pass,
            size,
            views: [whole(&surfaces), whole(&slopes)],
            surfaces,
            slopes,
        })
    }

    /// The camera of the pictures recorded from the next submission on.
    pub fn set_camera(&self, context: &Context, camera: &Pinhole) {
        self.pass.set_params(context, &CameraParams::from(camera));
    }

    /// Prepares a picture: `normals` in the first three channels of a texture, in the space of the camera's axes, and
    /// `depths` in the first of another.
    ///
    /// # Errors
    /// [`Error::Size`](crate::Error::Size) and [`Error::Gpu`](crate::Error::Gpu) when the textures do not fit.
    pub fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        normals: &TextureView,
        depths: &TextureView,
    ) -> Result<()> {
        expect_size("the normals", normals, self.size)?;
        expect_size("the depths", depths, self.size)?;
        let [surfaces, slopes] = &self.views;
        let resources = [normals, depths, surfaces, slopes].map(BindingResource::TextureView);
        self.pass
            .record(context, encoder, self.size, &resources, None)
    }

    /// Width and height in pixels.
    pub const fn size(&self) -> [u32; 2] {
        self.size
    }

    pub(super) const fn view(&self) -> &TextureView {
        &self.views[0]
    }

    /// What edges.wesl reads.
    pub(super) fn resources(&self) -> impl Iterator<Item = (u32, BindingResource<'_>)> {
        let views = self.views.iter().map(BindingResource::TextureView);
        BINDINGS.into_iter().zip(views)
    }
}
