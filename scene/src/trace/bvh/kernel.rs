//! The two tests that take the time, eight boxes and eight triangles at once, for the instruction sets there are.
//!
//! Box tests may differ in rounding: they only have to be conservative. Triangle tests give the same bits.

#[cfg(target_arch = "x86_64")]
mod avx2;

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::Avx2;

use glam::Affine3A;

use super::{
    blocks::{Block, LANES},
    slabs::Slabs,
    traverse::Entry,
    wide::{Node, WIDTH},
};
use crate::trace::triangle::Shear;

/// An instruction set's way to do the tests.
pub(crate) trait Kernel: Copy {
    /// A ray for box tests in registers.
    type Boxes: Copy;
    /// A ray for triangle tests in registers.
    type Triangles: Copy;

    fn boxes(self, slabs: &Slabs) -> Self::Boxes;

    fn triangles(self, shear: &Shear) -> Self::Triangles;

    /// The children whose boxes the ray meets before `limit`, one bit each, and where it enters all of them.
    fn enter(self, ray: &Self::Boxes, node: &Node, limit: f32) -> (u32, [Entry; WIDTH]);

    /// The triangles of a block taken through a transform, with the bits that
    /// [`transform_point3`](Affine3A::transform_point3) gives.
    fn placed(self, transform: &Affine3A, block: &Block) -> Block;

    /// The triangles that 32 bits do not reject, one bit each.
    fn candidates(self, ray: &Self::Triangles, block: &Block) -> u32;
}

/// No special instructions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl Kernel for Portable {
    type Boxes = Slabs;
    type Triangles = Shear;

    #[inline(always)]
    fn boxes(self, slabs: &Slabs) -> Slabs {
        *slabs
    }

    #[inline(always)]
    fn triangles(self, shear: &Shear) -> Shear {
        *shear
    }

    #[inline(always)]
    fn enter(self, ray: &Slabs, node: &Node, limit: f32) -> (u32, [Entry; WIDTH]) {
        let (mut enter, mut leave) = ([ray.start; WIDTH], [limit; WIDTH]);
        for axis in 0..3 {
            let down = ray.down(axis);
            let [near, far] = [down, 1 - down].map(|face| &node.bounds[axis][face]);
            let (inverse, lower, upper) = (ray.inverse[axis], ray.near[axis], ray.far[axis]);
            for child in 0..WIDTH {
                enter[child] = enter[child].max(near[child] * inverse - lower);
                leave[child] = leave[child].min(far[child] * inverse - upper);
            }
        }
        let mut met = 0;
        for child in 0..WIDTH {
            met |= u32::from(enter[child] <= leave[child]) << child;
        }
        let entries = std::array::from_fn(|child| Entry::new(node.children[child], enter[child]));
        (met, entries)
    }

    #[inline(always)]
    fn placed(self, transform: &Affine3A, block: &Block) -> Block {
        let [x, y, z, translation] = [
            transform.matrix3.x_axis,
            transform.matrix3.y_axis,
            transform.matrix3.z_axis,
            transform.translation,
        ];
        let corners = block.corners.map(|[px, py, pz]| {
            [0, 1, 2].map(|axis| {
                std::array::from_fn(|lane| {
                    // In this order the bits are those of the library.
                    x[axis] * px[lane] + y[axis] * py[lane] + z[axis] * pz[lane] + translation[axis]
                })
            })
        });
        Block { corners }
    }

    #[inline(always)]
    fn candidates(self, ray: &Shear, block: &Block) -> u32 {
        let mut candidates = 0;
        for lane in 0..LANES {
            candidates |= u32::from(ray.is_candidate(block.triangle(lane))) << lane;
        }
        candidates
    }
}
