//! Where points look in a map, and what they see there: which pixel, how deep on the line of its centre, how far the next layer.
//!
//! A layer is the surface at the centre of a pixel, and x is not there: x is moved to the centre's line within the plane it
//! lies in, so that a plane never shadows itself however steep the map sees it. Where the surface of x does not reach so far,
//! in a corner or at an edge, or where something stands between, the pixels beside it are asked.

use super::{
    lanes::Simd,
    maps::{Extents, Map, Quads},
    points::PointBlock,
    room::Room,
    view::View,
};

/// How far a point is moved at most along a map's direction to reach a pixel's centre, pixels.
const STEEPEST: f32 = 64.0;

/// Points whose planes have less of a cosine to the direction ask no other pixel: those planes are narrower than a pixel in
/// the map, and hardly count.
const STEEP: f32 = 0.15;

/// What eight points see along a map.
#[derive(Clone, Copy)]
pub(super) struct Aim<S: Simd> {
    /// 1 for the map's direction, −1 for its opposite.
    pub(super) signs: S::Floats,
    /// Of the shading normal, at least 0.
    pub(super) cosines: S::Floats,
    /// Where the direction is above the surface.
    pub(super) above: S::Mask,
    /// The pixel that was asked.
    pub(super) columns: S::Floats,
    pub(super) rows: S::Floats,
    /// How deep the point's plane is on the line of its centre, metres.
    pub(super) depths: S::Floats,
    /// From there to the nearest layer before the point, metres; infinite where there is none.
    pub(super) ahead: S::Floats,
}

/// What eight points ask a map for.
#[derive(Clone, Copy)]
pub(super) struct Question<S: Simd> {
    /// Those that ask.
    asking: S::Mask,
    /// 1 for the map's direction, −1 for its opposite.
    signs: S::Floats,
    pixels: S::Ints,
    /// How deep the points are, metres.
    depths: S::Floats,
    /// How near a layer is that still is the point itself, metres.
    tolerance: S::Floats,
}

/// A map that can be asked for what is before a point.
pub(super) trait Layers {
    fn view(&self) -> &View;

    /// How far the nearest layer is, metres, infinite where there is none; and whether there may be one at the point itself: where
    /// `surely`, whether it is known to be there.
    fn ahead<S: Simd>(&self, simd: S, points: &Question<S>, surely: bool) -> (S::Floats, S::Mask);
}

impl Layers for Map {
    #[inline(always)]
    fn view(&self) -> &View {
        &self.view
    }

    #[inline(always)]
    fn ahead<S: Simd>(&self, simd: S, points: &Question<S>, _: bool) -> (S::Floats, S::Mask) {
        let one = simd.splat_int(1);
        let mut layer = simd.gather_ints(&self.firsts, points.pixels);
        let end = simd.gather_ints(&self.firsts, simd.add_ints(points.pixels, one));
        let none = simd.splat(f32::INFINITY);
        let (mut ahead, mut known) = (none, simd.none());
        loop {
            let there = simd.and(points.asking, simd.less_ints(layer, end));
            if simd.bits(there) == 0 {
                return (ahead, known);
            }
            let depth = simd.gather_floats(&self.depths, layer, there, none);
            let offset = simd.mul(simd.sub(depth, points.depths), points.signs);
            let here = simd.at_most(simd.abs(offset), points.tolerance);
            known = simd.or(known, simd.and(here, there));
            let beyond = simd.and(there, simd.less(points.tolerance, offset));
            ahead = simd.select(beyond, simd.min(offset, ahead), ahead);
            layer = simd.add_ints(layer, one);
        }
    }
}

impl Layers for Quads {
    #[inline(always)]
    fn view(&self) -> &View {
        &self.view
    }

    #[inline(always)]
    fn ahead<S: Simd>(&self, simd: S, points: &Question<S>, _: bool) -> (S::Floats, S::Mask) {
        let (one, four) = (simd.splat_int(1), simd.splat_int(4));
        let mut place = simd.gather_ints(&self.firsts, points.pixels);
        let end = simd.gather_ints(&self.firsts, simd.add_ints(points.pixels, one));
        let none = simd.splat(f32::INFINITY);
        let (mut ahead, mut known) = (none, simd.none());
        loop {
            let there = simd.and(points.asking, simd.less_ints(place, end));
            if simd.bits(there) == 0 {
                return (ahead, known);
            }
            // Nothing is in the first four.
            for depths in simd.quads(&self.depths, simd.where_set(there, place)) {
                let offset = simd.mul(simd.sub(depths, points.depths), points.signs);
                known = simd.or(known, simd.at_most(simd.abs(offset), points.tolerance));
                let beyond = simd.less(points.tolerance, offset);
                ahead = simd.min(simd.select(beyond, offset, none), ahead);
            }
            place = simd.add_ints(place, four);
        }
    }
}

impl Layers for Extents {
    #[inline(always)]
    fn view(&self) -> &View {
        &self.view
    }

    /// There may be a layer anywhere between the first and the last one.
    #[inline(always)]
    fn ahead<S: Simd>(&self, simd: S, points: &Question<S>, surely: bool) -> (S::Floats, S::Mask) {
        let (none, zero) = (simd.splat(f32::INFINITY), simd.splat(0.0));
        let low = simd.gather_floats(&self.lows, points.pixels, points.asking, none);
        let high = simd.gather_floats(&self.highs, points.pixels, points.asking, none);
        let (below, above) = (simd.sub(points.depths, low), simd.sub(high, points.depths));
        let (short, tolerance) = (simd.sub(zero, points.tolerance), points.tolerance);
        let known = if surely {
            let first = simd.at_most(simd.abs(below), tolerance);
            simd.or(first, simd.at_most(simd.abs(above), tolerance))
        } else {
            simd.and(simd.at_most(short, below), simd.at_most(short, above))
        };
        let offset = simd.select(simd.less(points.signs, zero), below, above);
        let ahead = simd.select(simd.less(tolerance, offset), offset, none);
        (ahead, simd.and(points.asking, known))
    }
}

impl<S: Simd> Aim<S> {
    /// What a block of points sees: each at the nearest pixel that knows its surface.
    #[inline(always)]
    pub(super) fn at<M: Layers>(simd: S, map: &M, block: &PointBlock, tolerance: f32) -> Self {
        Self::look(simd, map, (block, None), tolerance, false)
    }

    /// The same, asking only pixels to which points can be moved, also across corners; where there is none near, the direction does
    /// not count.
    #[inline(always)]
    pub(super) fn within<M: Layers>(
        simd: S,
        map: &M,
        (block, room): (&PointBlock, Option<&Room>),
        tolerance: f32,
    ) -> Self {
        Self::look(simd, map, (block, room), tolerance, true)
    }

    #[inline(always)]
    fn look<M: Layers>(
        simd: S,
        map: &M,
        (block, room): (&PointBlock, Option<&Room>),
        tolerance: f32,
        corners: bool,
    ) -> Self {
        let view = map.view();
        let place = Place::new(simd, view, block);
        let zero = simd.splat(0.0);
        let cosines = simd.dot(&block.shading, view.forward);
        let signs = simd.with_sign(simd.splat(1.0), cosines);
        let facing = simd.dot(&block.geometric, view.forward);
        let above = simd.less(zero, simd.mul(facing, signs));
        let (i, j) = (
            cell(simd, place.at[0], view.columns),
            cell(simd, place.at[1], view.rows),
        );
        let mut question = Question {
            asking: above,
            signs,
            pixels: place.pixel(simd, i, j),
            depths: place.depth(simd, i, j),
            tolerance: simd.splat(tolerance),
        };
        let (ahead, known) = map.ahead(simd, &question, false);
        let mut aim = Self {
            signs,
            cosines: simd.abs(cosines),
            above,
            columns: i,
            rows: j,
            depths: question.depths,
            ahead,
        };
        let mut blocked = simd.none();
        if let Some(room) = room {
            blocked = simd.and_not(above, place.holds(simd, view, room, (i, j)));
        }
        let steep = simd.less(simd.abs(facing), simd.splat(STEEP));
        let mut unknown = simd.and_not(simd.and_not(above, known), steep);
        unknown = simd.or(unknown, blocked);
        if simd.bits(unknown) == 0 {
            return aim;
        }
        // For occlusion the pixel across the corner hardly ever knows more.
        let count = if corners { 3 } else { 2 };
        for (i, j) in place.beside(simd, i, j).into_iter().take(count) {
            if simd.bits(unknown) == 0 {
                break;
            }
            question.asking = simd.and(unknown, inside(simd, view, i, j));
            if let Some(room) = room {
                let held = place.holds(simd, view, room, (i, j));
                question.asking = simd.and(question.asking, held);
            }
            question.pixels = place.pixel(simd, i, j);
            question.depths = place.depth(simd, i, j);
            let (ahead, known) = map.ahead(simd, &question, true);
            aim.ahead = simd.select(known, ahead, aim.ahead);
            aim.depths = simd.select(known, question.depths, aim.depths);
            aim.columns = simd.select(known, i, aim.columns);
            aim.rows = simd.select(known, j, aim.rows);
            unknown = simd.and_not(unknown, known);
            blocked = simd.and_not(blocked, known);
        }
        aim.above = simd.and_not(aim.above, blocked);
        aim.cosines = simd.select(blocked, zero, aim.cosines);
        aim
    }
}

/// Where eight points are in a map.
struct Place<S: Simd> {
    /// Pixels.
    at: [S::Floats; 2],
    /// Metres.
    depths: S::Floats,
    /// How much deeper the points' planes are a pixel further, metres.
    slopes: [S::Floats; 2],
    columns: S::Floats,
    /// How much deeper it may become, metres.
    steepest: f32,
}

impl<S: Simd> Place<S> {
    #[inline(always)]
    fn new(simd: S, view: &View, block: &PointBlock) -> Self {
        let scale = simd.splat(1.0 / view.pixel);
        let x = simd.dot(&block.positions, view.right);
        let y = simd.dot(&block.positions, view.up);
        let x = simd.mul(simd.sub(x, simd.splat(view.low.x)), scale);
        let y = simd.mul(simd.sub(y, simd.splat(view.low.y)), scale);
        let facing = simd.dot(&block.geometric, view.forward);
        // A plane that is seen edge-on is nowhere else.
        let steep = simd.div(simd.splat(-view.pixel), facing);
        let flat = simd.less(simd.abs(steep), simd.splat(f32::INFINITY));
        let steep = simd.select(flat, steep, simd.splat(0.0));
        let tilt_x = simd.dot(&block.geometric, view.right);
        let tilt_y = simd.dot(&block.geometric, view.up);
        Self {
            at: [x, y],
            depths: simd.dot(&block.positions, view.forward),
            slopes: [simd.mul(steep, tilt_x), simd.mul(steep, tilt_y)],
            columns: simd.splat(view.columns as f32),
            steepest: STEEPEST * view.pixel,
        }
    }

    #[inline(always)]
    fn pixel(&self, simd: S, column: S::Floats, row: S::Floats) -> S::Ints {
        // Whole numbers up to 2²⁴ are exact.
        simd.whole(simd.add(simd.mul(row, self.columns), column))
    }

    /// How deep the points' planes are on the lines of some pixels' centres.
    #[inline(always)]
    fn depth(&self, simd: S, column: S::Floats, row: S::Floats) -> S::Floats {
        let along = simd.add(self.along(simd, 0, column), self.along(simd, 1, row));
        let along = simd.min(along, simd.splat(self.steepest));
        let along = simd.max(along, simd.splat(-self.steepest));
        simd.add(self.depths, along)
    }

    /// The pixel across the nearer side of that in which the points are, that across the other side, and that across the corner.
    #[inline(always)]
    fn beside(&self, simd: S, i: S::Floats, j: S::Floats) -> [(S::Floats, S::Floats); 3] {
        let (aside_x, far_x) = aside(simd, self.at[0], i);
        let (aside_y, far_y) = aside(simd, self.at[1], j);
        let x_first = simd.at_most(far_y, far_x);
        let first = (
            simd.select(x_first, aside_x, i),
            simd.select(x_first, j, aside_y),
        );
        let then = (
            simd.select(x_first, i, aside_x),
            simd.select(x_first, aside_y, j),
        );
        [first, then, (aside_x, aside_y)]
    }

    /// Whether points can be moved to the line of a pixel's centre.
    #[inline(always)]
    fn holds(
        &self,
        simd: S,
        view: &View,
        room: &Room,
        (column, row): (S::Floats, S::Floats),
    ) -> S::Mask {
        let (half, pixel) = (simd.splat(0.5), simd.splat(view.pixel));
        let [x, y] = self.at;
        let x = simd.mul(simd.sub(simd.add(column, half), x), pixel);
        let y = simd.mul(simd.sub(simd.add(row, half), y), pixel);
        let deeper = simd.sub(self.depth(simd, column, row), self.depths);
        room.holds(simd, view, [x, y, deeper])
    }

    #[inline(always)]
    fn along(&self, simd: S, axis: usize, cell: S::Floats) -> S::Floats {
        let center = simd.add(cell, simd.splat(0.5));
        simd.mul(simd.sub(center, self.at[axis]), self.slopes[axis])
    }
}

/// The columns or rows, of so many, that places are in.
#[inline(always)]
fn cell<S: Simd>(simd: S, at: S::Floats, count: usize) -> S::Floats {
    let last = simd.splat((count - 1) as f32);
    // What is no number becomes 0.
    simd.min(simd.max(simd.floor(at), simd.splat(0.0)), last)
}

/// The columns or rows on the nearer side of places in others, and how far those are from the middle.
#[inline(always)]
fn aside<S: Simd>(simd: S, at: S::Floats, cell: S::Floats) -> (S::Floats, S::Floats) {
    let (one, half) = (simd.splat(1.0), simd.splat(0.5));
    let off = simd.sub(simd.sub(at, cell), half);
    (simd.add(cell, simd.with_sign(one, off)), simd.abs(off))
}

/// Whether pixels are in the map.
#[inline(always)]
fn inside<S: Simd>(simd: S, view: &View, column: S::Floats, row: S::Floats) -> S::Mask {
    let zero = simd.splat(0.0);
    let columns = simd.less(column, simd.splat(view.columns as f32));
    let rows = simd.less(row, simd.splat(view.rows as f32));
    let low = simd.and(simd.at_most(zero, column), simd.at_most(zero, row));
    simd.and(low, simd.and(columns, rows))
}
