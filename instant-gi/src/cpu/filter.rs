//! Stage 6, samples become a picture: the discontinuity buffer over tiles of interleaved sampling (§4.3) and joint
//! bilateral upsampling (§4.2, Eq. (2)).

use glam::Vec3;
use isophote_filters::{
    DiscontinuityBuffer, EdgeStop, Guides, ImageView, JointBilateral, Neighborhood, Pinhole,
    SampleGrid, SinglePass, Thresholds,
};
use isophote_scene::GBuffer;

use crate::{Filter, GiParams, Result};

/// The filters of a picture's size.
pub(crate) struct Upsample {
    pub(crate) grid: SampleGrid,
    size: [usize; 2],
    tile: [usize; 2],
    filter: Filter,
    pub(crate) buffer: DiscontinuityBuffer,
    pub(crate) bilateral: JointBilateral,
    pub(crate) single: SinglePass,
}

impl Upsample {
    pub(crate) fn new(size: [u32; 2], params: &GiParams) -> Result<Self> {
        let size = size.map(|side| side as usize);
        let factor = params.downsampling as usize;
        let tile = params.interleaving.map(|side| side as usize);
        let edges = match params.filter {
            Filter::Paper => EdgeStop::COSINE,
            Filter::Edges | Filter::Fill => EdgeStop::default(),
        };
        let thresholds = match params.filter {
            Filter::Paper => Thresholds {
                depth: 0.1,
                ..Thresholds::default()
            },
            Filter::Edges | Filter::Fill => Thresholds::default(),
        };
        // Of each part of the lights the nearest samples on all sides.
        let near = Neighborhood {
            radius: 1,
            sigma: 0.7,
            reach: 3,
        };
        let around = match params.filter {
            Filter::Paper => Neighborhood {
                reach: Neighborhood::default().radius,
                ..Neighborhood::default()
            },
            Filter::Edges | Filter::Fill => Neighborhood::default(),
        };
        Ok(Self {
            grid: SampleGrid::new(size, factor)?,
            size,
            tile,
            filter: params.filter,
            buffer: DiscontinuityBuffer::new(tile, thresholds)?,
            bilateral: JointBilateral::new(factor, around, edges)?,
            single: SinglePass::new(factor, tile, near, edges)?,
        })
    }

    /// Whether the samples are the picture.
    pub(crate) fn is_copy(&self) -> bool {
        self.grid.size() == self.size && !self.is_tiled()
    }

    /// Whether tiles are joined and samples upsampled at once.
    pub(crate) fn is_single(&self) -> bool {
        self.filter == Filter::Edges && self.is_tiled()
    }

    /// Whether there are tiles to be joined; filled ones are already.
    pub(crate) fn is_tiled(&self) -> bool {
        self.tile != [1, 1] && self.filter != Filter::Fill
    }

    /// Irradiance in every pixel of that of the samples.
    pub(super) fn apply(
        &self,
        samples: &[Vec3],
        seen: &GBuffer,
        eye: &isophote_scene::Pinhole,
    ) -> Result<Vec<Vec3>> {
        let [columns, rows] = self.grid.size();
        let [width, height] = self.size;
        if self.is_copy() {
            return Ok(samples.to_vec());
        }
        let (normals, depths) = seen.normals_and_depths(eye);
        let camera = pinhole(eye)?;
        let guides = Guides::new(
            ImageView::new(bytemuck::cast_slice(&normals), width, height, 3)?,
            ImageView::new(&depths, width, height, 1)?,
            &camera,
        )?;
        let view = ImageView::new(bytemuck::cast_slice(samples), columns, rows, 3)?;
        let mut output = vec![Vec3::ZERO; width * height];
        if self.is_single() {
            self.single
                .apply(view, &guides, bytemuck::cast_slice_mut(&mut output))?;
            return Ok(output);
        }
        let mut joined = samples.to_vec();
        if self.is_tiled() {
            let coarse_normals = self.grid.gather(ImageView::new(
                bytemuck::cast_slice(&normals),
                width,
                height,
                3,
            )?)?;
            let coarse_depths = self
                .grid
                .gather(ImageView::new(&depths, width, height, 1)?)?;
            let coarse = Guides::new(
                ImageView::new(&coarse_normals, columns, rows, 3)?,
                ImageView::new(&coarse_depths, columns, rows, 1)?,
                &camera,
            )?;
            self.buffer
                .apply(view, &coarse, bytemuck::cast_slice_mut(&mut joined))?;
        }
        let view = ImageView::new(bytemuck::cast_slice(&joined), columns, rows, 3)?;
        self.bilateral
            .apply(view, &guides, bytemuck::cast_slice_mut(&mut output))?;
        Ok(output)
    }
}

/// The camera, as the filters know it.
pub(crate) fn pinhole(eye: &isophote_scene::Pinhole) -> Result<Pinhole> {
    let axes = [eye.right, eye.up, eye.forward].map(|axis| axis.to_array());
    Ok(Pinhole::new(eye.eye.to_array(), axes, eye.yfov)?)
}
