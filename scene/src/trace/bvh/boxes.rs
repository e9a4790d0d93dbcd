//! Leaves whose triangles stand for the boxes around them: imperfect visibility (MS10 §4.1).
//!
//! A box is hit where the ray enters it. A box that contains either end of the ray does not count, or no surface would
//! ever see light. Boxes are made of the corners as they are tested, so there is no second structure.

use std::borrow::Borrow;

use glam::Vec2;

use super::{
    blocks::{Block, Blocks, LANES},
    kernel::Kernel,
    traverse::Visitor,
    triangles::{Found, Place, Question},
};
use crate::{Ray, SurfaceId};

/// A ray for boxes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BoxRay {
    origin: [f32; 3],
    /// Not used along axes of which the direction has nothing.
    inverse: [f32; 3],
    parallel: [bool; 3],
    t_min: f32,
    t_max: f32,
}

impl BoxRay {
    #[inline(always)]
    pub(crate) fn new(ray: &Ray) -> Self {
        Self {
            origin: ray.origin.to_array(),
            inverse: ray.direction.recip().to_array(),
            parallel: ray.direction.to_array().map(|along| along == 0.0),
            t_min: ray.t_min,
            t_max: ray.t_max,
        }
    }

    /// The boxes that the ray enters after its start and before `t`, and leaves before its end, one bit each, and where it
    /// enters them.
    #[inline(always)]
    fn enter(&self, block: &Block, t: f32) -> (u32, [f32; LANES]) {
        let mut enter = [f32::NEG_INFINITY; LANES];
        let mut leave = [f32::INFINITY; LANES];
        let mut inside = [true; LANES];
        for axis in 0..3 {
            let [a, b, c] = block.corners.each_ref().map(|corner| &corner[axis]);
            let (origin, inverse) = (self.origin[axis], self.inverse[axis]);
            for lane in 0..LANES {
                let low = least(least(a[lane], b[lane]), c[lane]);
                let high = greatest(greatest(a[lane], b[lane]), c[lane]);
                if self.parallel[axis] {
                    inside[lane] &= low <= origin && origin <= high;
                } else {
                    let (p, q) = ((low - origin) * inverse, (high - origin) * inverse);
                    enter[lane] = greatest(least(p, q), enter[lane]);
                    leave[lane] = least(greatest(p, q), leave[lane]);
                }
            }
        }
        let mut met = 0;
        for lane in 0..LANES {
            let counts = inside[lane]
                & (enter[lane] <= leave[lane])
                & (enter[lane] > self.t_min)
                & (leave[lane] < self.t_max)
                & (enter[lane] < t)
                // An empty lane is no number.
                & !block.corners[0][0][lane].is_nan();
            met |= u32::from(counts) << lane;
        }
        (met, enter)
    }
}

/// As one instruction has it: `b` where one is no number.
#[inline(always)]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greatest(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Looks for the first box (`ANY`: any box) of the leaves it visits.
pub(crate) struct Boxes<'a, const ANY: bool, K: Kernel, P: Place> {
    pub(crate) kernel: K,
    pub(crate) ray: &'a BoxRay,
    pub(crate) blocks: &'a Blocks,
    pub(crate) place: &'a P,
    pub(crate) question: &'a Question<'a>,
    pub(crate) found: &'a mut Found,
}

impl<const ANY: bool, K: Kernel, P: Place> Visitor for Boxes<'_, ANY, K, P> {
    #[inline(always)]
    fn leaf(&mut self, leaf: usize, limit: &mut f32) -> bool {
        let Some(block) = self.blocks.blocks.get(leaf) else {
            return false;
        };
        let block = self.place.block(self.kernel, block);
        let block = block.borrow();
        let (mut met, enter) = self.ray.enter(block, self.found.t);
        while met != 0 {
            let lane = met.trailing_zeros() as usize & (LANES - 1);
            met &= met - 1;
            let surface = self
                .place
                .surface(self.blocks.surfaces[leaf].surfaces[lane]);
            if surface == self.question.start
                || enter[lane] >= self.found.t
                || !self.place.selects(block, lane)
            {
                continue;
            }
            // Which triangle's box it is says nothing about the surface.
            *self.found = Found::at(enter[lane], Vec2::ZERO, SurfaceId::UNKNOWN);
            if ANY {
                return true;
            }
            *limit = self.place.limit(enter[lane]);
        }
        false
    }
}
