//! Where points look in a map: which pixel, and how deep on the line of its centre.
//!
//! A layer is the surface at the centre of a pixel, and x is not there: x is moved to the centre's line within the plane it
//! lies in, so that a plane never shadows itself however steep the map sees it. Where the surface of x does not reach so far,
//! in a corner or at an edge, another of the four pixels around x is asked.

use super::{
    lanes::{LANES, Lanes, dot},
    maps::{Extents, Map},
    points::PointBlock,
    view::View,
};

/// How far a point is moved at most along a map's direction to reach a pixel's centre, pixels.
const STEEPEST: f32 = 64.0;
/// Where eight points look along a map.
pub(super) struct Aim {
    /// Places in the map, pixels.
    at: [Lanes; 2],
    /// There, metres along the map's direction.
    pub(super) depths: Lanes,
    /// How much deeper the point's plane is a pixel further, metres.
    slopes: [Lanes; 2],
    /// 1 for the map's direction, −1 for its opposite.
    pub(super) signs: Lanes,
    /// Of the shading normal, at least 0.
    pub(super) cosines: Lanes,
    /// 1, or 0 where the direction is below the surface.
    pub(super) above: Lanes,
    /// The nearest pixel.
    pub(super) nearest: [u32; LANES],
    /// On the line of its centre.
    pub(super) nearest_depths: Lanes,
}

/// A map that can be asked for what is before a point.
pub(super) trait Layers {
    fn view(&self) -> &View;

    /// Whether a pixel may have a layer so deep, give or take the tolerance.
    fn may_have(&self, pixel: u32, depth: f32, tolerance: f32) -> bool;

    /// Whether it is known to have one.
    fn has(&self, pixel: u32, depth: f32, tolerance: f32) -> bool;
}

impl Layers for Map {
    #[inline(always)]
    fn view(&self) -> &View {
        &self.view
    }

    #[inline(always)]
    fn may_have(&self, pixel: u32, depth: f32, tolerance: f32) -> bool {
        self.has(pixel, depth, tolerance)
    }

    #[inline(always)]
    fn has(&self, pixel: u32, depth: f32, tolerance: f32) -> bool {
        let layers = self.layers(pixel as usize).iter();
        layers.fold(false, |has, layer| {
            has | ((layer - depth).abs() <= tolerance)
        })
    }
}

impl Layers for Extents {
    #[inline(always)]
    fn view(&self) -> &View {
        &self.view
    }

    #[inline(always)]
    fn may_have(&self, pixel: u32, depth: f32, tolerance: f32) -> bool {
        let [low, high] = self.ends[pixel as usize];
        low - tolerance <= depth && depth <= high + tolerance
    }

    #[inline(always)]
    fn has(&self, pixel: u32, depth: f32, tolerance: f32) -> bool {
        let [low, high] = self.ends[pixel as usize];
        (low - depth).abs() <= tolerance || (high - depth).abs() <= tolerance
    }
}

impl Aim {
    /// Where a block of points looks: each at the nearest pixel that knows its surface.
    #[inline(always)]
    pub(super) fn at<M: Layers>(map: &M, block: &PointBlock, tolerance: f32) -> Self {
        let mut aim = Self::new(map.view(), block);
        for lane in 0..LANES {
            let (pixel, depth) = (aim.nearest[lane], aim.nearest_depths[lane]);
            if !map.may_have(pixel, depth, tolerance) {
                aim.move_aside(map, lane, tolerance);
            }
        }
        aim
    }

    #[inline(always)]
    fn new(view: &View, block: &PointBlock) -> Self {
        let scale = 1.0 / view.pixel;
        let (x, y) = (
            dot(&block.positions, view.right),
            dot(&block.positions, view.up),
        );
        let depths = dot(&block.positions, view.forward);
        let cosine = dot(&block.shading, view.forward);
        let facing = dot(&block.geometric, view.forward);
        let (tilt_x, tilt_y) = (
            dot(&block.geometric, view.right),
            dot(&block.geometric, view.up),
        );
        let last = [(view.columns - 1) as f32, (view.rows - 1) as f32];
        let mut aim = Self {
            at: [[0.0; LANES]; 2],
            depths,
            slopes: [[0.0; LANES]; 2],
            signs: [0.0; LANES],
            cosines: [0.0; LANES],
            above: [0.0; LANES],
            nearest: [0; LANES],
            nearest_depths: [0.0; LANES],
        };
        for lane in 0..LANES {
            let column = (x[lane] - view.low.x) * scale;
            let row = (y[lane] - view.low.y) * scale;
            aim.at[0][lane] = column;
            aim.at[1][lane] = row;
            // A plane that is seen edge-on is nowhere else.
            let steep = -view.pixel / facing[lane];
            let steep = if steep.is_finite() { steep } else { 0.0 };
            aim.slopes[0][lane] = steep * tilt_x[lane];
            aim.slopes[1][lane] = steep * tilt_y[lane];
            let (i, j) = (
                column.floor().clamp(0.0, last[0]),
                row.floor().clamp(0.0, last[1]),
            );
            aim.nearest[lane] = j as u32 * view.columns as u32 + i as u32;
            let along =
                (i + 0.5 - column) * aim.slopes[0][lane] + (j + 0.5 - row) * aim.slopes[1][lane];
            let steepest = STEEPEST * view.pixel;
            aim.nearest_depths[lane] = depths[lane] + along.clamp(-steepest, steepest);
            let sign = 1_f32.copysign(cosine[lane]);
            aim.signs[lane] = sign;
            aim.cosines[lane] = cosine[lane].abs();
            aim.above[lane] = f32::from(facing[lane] * sign > 0.0);
        }
        aim
    }

    /// Takes another of the four pixels around a point, where the nearest does not know the point's surface.
    #[inline(never)]
    fn move_aside<M: Layers>(&mut self, map: &M, lane: usize, tolerance: f32) {
        let view = map.view();
        let at = [self.at[0][lane], self.at[1][lane]];
        let cell = at.map(f32::floor);
        let aside = [0, 1].map(|axis| {
            if at[axis] - cell[axis] < 0.5 {
                -1.0
            } else {
                1.0
            }
        });
        let far = [0, 1].map(|axis| (at[axis] - cell[axis] - 0.5).abs());
        // The neighbour across the nearer side first.
        let (x, y) = ([aside[0], 0.0], [0.0, aside[1]]);
        let order = if far[0] >= far[1] {
            [x, y, aside]
        } else {
            [y, x, aside]
        };
        for step in order {
            let (i, j) = (cell[0] + step[0], cell[1] + step[1]);
            if i < 0.0 || j < 0.0 || i >= view.columns as f32 || j >= view.rows as f32 {
                continue;
            }
            let pixel = j as u32 * view.columns as u32 + i as u32;
            let along =
                (i + 0.5 - at[0]) * self.slopes[0][lane] + (j + 0.5 - at[1]) * self.slopes[1][lane];
            let steepest = STEEPEST * view.pixel;
            let depth = self.depths[lane] + along.clamp(-steepest, steepest);
            if map.has(pixel, depth, tolerance) {
                self.nearest[lane] = pixel;
                self.nearest_depths[lane] = depth;
                return;
            }
        }
    }
}

impl Map {
    /// How far the nearest layer before a point is, metres; infinite where there is none.
    #[inline(always)]
    pub(super) fn ahead(&self, aim: &Aim, lane: usize, tolerance: f32) -> f32 {
        let depth = aim.nearest_depths[lane];
        let mut layers = self.layers(aim.nearest[lane] as usize).iter();
        if aim.signs[lane] > 0.0 {
            let from = depth + tolerance;
            layers
                .find(|&&layer| layer > from)
                .map_or(f32::INFINITY, |layer| layer - depth)
        } else {
            let from = depth - tolerance;
            layers
                .rfind(|&&layer| layer < from)
                .map_or(f32::INFINITY, |layer| depth - layer)
        }
    }
}
