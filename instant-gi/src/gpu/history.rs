//! Stage 6 over a sequence of pictures: irradiance of earlier ones, carried to where it is seen now. As `cpu/history.rs`, over
//! `isophote-filters`.

use isophote_filters::{
    Pinhole, TemporalParams,
    gpu::{CameraMotion, Format, Guides, Temporal, texture},
};
use isophote_scene::gpu::Context;
use wgpu::TextureView;

use super::passes::{Targets, whole};
use crate::{Result, cpu::filter::pinhole};

/// Irradiance that the pictures of a sequence have gathered so far; see
/// [`InstantGi::record_next`](super::InstantGi::record_next). Twin of [`crate::History`].
#[derive(Debug)]
pub struct History {
    temporal: Temporal,
    guides: Guides,
    motion: CameraMotion,
    /// Where what is seen now was seen before.
    places: TextureView,
    before: Option<Pinhole>,
    pictures: u64,
}

impl History {
    /// An empty one of pictures of a size in pixels, whose mean becomes an exponential one after so many pictures: the more, the
    /// longer light that changed is seen.
    ///
    /// # Errors
    /// [`Error::Filter`](crate::Error::Filter) unless `most` is 1 to 65,536, and when the device allows no such textures.
    pub fn new(context: &Context, most: u32, size: [u32; 2]) -> Result<Self> {
        let params = TemporalParams {
            max_pictures: most,
            ..TemporalParams::default()
        };
        let format = Format::Single;
        let filter = isophote_filters::Temporal::new(params)?;
        // The camera comes with each picture.
        let anywhere = Pinhole::at_origin(1.0)?;
        Ok(Self {
            temporal: Temporal::new(context, &filter, size, format)?,
            guides: Guides::new(context, size, &anywhere)?,
            motion: CameraMotion::new(context, &anywhere, &anywhere)?,
            places: whole(&texture(context, "motion", size, format.texture())?),
            before: None,
            pictures: 0,
        })
    }

    /// Pictures so far.
    pub fn pictures(&self) -> u64 {
        self.pictures
    }

    /// Records that the irradiance of a picture is added, and replaced by what all of them know of what it sees.
    pub(super) fn record(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        targets: &Targets,
        irradiance: &wgpu::Texture,
        eye: &isophote_scene::Pinhole,
    ) -> Result<()> {
        let now = pinhole(eye)?;
        self.guides.set_camera(context, &now);
        let before = self.before.as_ref().unwrap_or(&now);
        self.motion.set_cameras(context, &now, before);
        let (normals, depths) = (&targets.normals, &targets.depths);
        self.guides.record(context, encoder, normals, depths)?;
        self.motion.record(context, encoder, depths, &self.places)?;
        let image = whole(irradiance);
        self.temporal
            .record(context, encoder, &image, &self.guides, &self.places)?;
        encoder.copy_texture_to_texture(
            self.temporal.values().texture().as_image_copy(),
            irradiance.as_image_copy(),
            irradiance.size(),
        );
        self.before = Some(now);
        self.pictures += 1;
        Ok(())
    }
}
