//! Stage 6, samples become a picture: the filters of `isophote-filters`, as in `cpu/filter.rs`.

use isophote_filters::{
    Pinhole,
    gpu::{DiscontinuityBuffer, Format, Guides, JointBilateral, SinglePass, texture},
};
use isophote_scene::gpu::Context;
use wgpu::TextureView;

use super::{
    StageTextures,
    passes::{Targets, whole},
};
use crate::{
    Result,
    cpu::filter::{Upsample, pinhole},
};

/// What makes a picture of samples.
#[derive(Debug)]
pub(super) enum Filter {
    /// The samples are the picture.
    Nothing,
    /// Tiles are joined and samples upsampled at once.
    Single(Guides, SinglePass),
    /// Tiles are joined, if there are any, then samples upsampled.
    Joint(Guides, Option<Box<Tiles>>, JointBilateral),
}

/// Tiles of interleaved sampling.
#[derive(Debug)]
pub(super) struct Tiles {
    guides: Guides,
    buffer: DiscontinuityBuffer,
    joined: TextureView,
}

impl Filter {
    pub(super) fn new(context: &Context, upsample: &Upsample, size: [u32; 2]) -> Result<Self> {
        if upsample.is_copy() {
            return Ok(Self::Nothing);
        }
        let format = Format::Single;
        // The camera comes with each picture.
        let guides =
            |size| -> Result<Guides> { Ok(Guides::new(context, size, &Pinhole::at_origin(1.0)?)?) };
        if upsample.is_single() {
            let single = SinglePass::new(context, &upsample.single, format)?;
            return Ok(Self::Single(guides(size)?, single));
        }
        let tiles = if upsample.is_tiled() {
            let grid = upsample.grid.size().map(|side| side as u32);
            let joined = texture(context, "joined tiles", grid, format.texture())?;
            Some(Box::new(Tiles {
                guides: guides(grid)?,
                buffer: DiscontinuityBuffer::new(context, &upsample.buffer, format)?,
                joined: whole(&joined),
            }))
        } else {
            None
        };
        let bilateral = JointBilateral::new(context, &upsample.bilateral, format)?;
        Ok(Self::Joint(guides(size)?, tiles, bilateral))
    }

    pub(super) fn set_camera(
        &self,
        context: &Context,
        eye: &isophote_scene::Pinhole,
    ) -> Result<()> {
        let camera = pinhole(eye)?;
        match self {
            Self::Nothing => {}
            Self::Single(guides, _) => guides.set_camera(context, &camera),
            Self::Joint(guides, tiles, _) => {
                guides.set_camera(context, &camera);
                if let Some(tiles) = tiles {
                    tiles.guides.set_camera(context, &camera);
                }
            }
        }
        Ok(())
    }

    pub(super) fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        targets: &Targets,
        stages: &StageTextures,
    ) -> Result<()> {
        let samples = whole(targets.samples(stages));
        let output = whole(targets.filtered(stages));
        let (normals, depths) = (&targets.normals, &targets.depths);
        match self {
            Self::Nothing => {}
            Self::Single(guides, single) => {
                guides.record(context, encoder, normals, depths)?;
                single.record(context, encoder, &samples, guides, &output)?;
            }
            Self::Joint(guides, tiles, bilateral) => {
                guides.record(context, encoder, normals, depths)?;
                let mut source = &samples;
                if let Some(tiles) = tiles {
                    let (normals, depths) = (&targets.sample_normals, &targets.sample_depths);
                    tiles.guides.record(context, encoder, normals, depths)?;
                    tiles.buffer.record(
                        context,
                        encoder,
                        &samples,
                        &tiles.guides,
                        &tiles.joined,
                    )?;
                    source = &tiles.joined;
                }
                bilateral.record(context, encoder, source, guides, &output)?;
            }
        }
        Ok(())
    }
}
