//! Triangles side by side, so that one instruction tests several.

use bytemuck::Zeroable;
use glam::Vec3;

use crate::SurfaceId;

/// Triangles of a block.
pub(crate) const LANES: usize = 8;

/// The corners of some triangles: corner, axis, triangle. Empty lanes are NaN, which no ray hits.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, Zeroable)]
pub(crate) struct Block {
    pub(crate) corners: [[[f32; LANES]; 3]; 3],
}

/// What the triangles of a block are; looked at only when one of them is hit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockSurfaces {
    pub(crate) surfaces: [SurfaceId; LANES],
    /// A bit for each triangle that may let rays pass.
    pub(crate) masked: u8,
}

/// A triangle to be put in a block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Triangle {
    pub(crate) corners: [Vec3; 3],
    pub(crate) surface: SurfaceId,
    /// Whether its material may let rays pass.
    pub(crate) masked: bool,
}

impl Block {
    /// The coordinates of one triangle by corner and axis.
    #[inline]
    pub(crate) fn triangle(&self, lane: usize) -> impl Fn(usize, usize) -> f32 {
        move |corner, axis| self.corners[corner][axis][lane]
    }
}

/// Blocks and what is in them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Blocks {
    pub(crate) blocks: Vec<Block>,
    pub(crate) surfaces: Vec<BlockSurfaces>,
}

impl Blocks {
    /// Adds a block of at most [`LANES`] triangles.
    pub(crate) fn push(&mut self, triangles: impl IntoIterator<Item = Triangle>) {
        let mut block = Block {
            corners: [[[f32::NAN; LANES]; 3]; 3],
        };
        let mut surfaces = BlockSurfaces {
            surfaces: [SurfaceId::UNKNOWN; LANES],
            masked: 0,
        };
        for (lane, triangle) in triangles.into_iter().take(LANES).enumerate() {
            for (corner, position) in triangle.corners.into_iter().enumerate() {
                for axis in 0..3 {
                    block.corners[corner][axis][lane] = position[axis];
                }
            }
            surfaces.surfaces[lane] = triangle.surface;
            surfaces.masked |= u8::from(triangle.masked) << lane;
        }
        self.blocks.push(block);
        self.surfaces.push(surfaces);
    }

    /// Gives back the room that was kept for more.
    pub(crate) fn shrink(&mut self) {
        self.blocks.shrink_to_fit();
        self.surfaces.shrink_to_fit();
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.blocks[..]) + size_of_val(&self.surfaces[..])
    }
}
