//! How far points can be moved within their planes before something stands in the way.
//!
//! A map is asked on the line of a pixel's centre, to which a point is moved (`aim`). Beside a ledge or a wall that line may
//! begin inside it, where nothing is lit, and it is next to lit things that light is strongest: what maps of few pixels lose
//! there is most of their bias. So four short rays along each point's plane tell how much room it has; pixels to which it had
//! to be moved further are not asked, and where all near ones are such the direction does not count.

use glam::Vec3;
use isophote_scene::{Ray, Tracer, sample::Frame};
use rayon::prelude::*;

use super::{
    lanes::{LANES, Lanes, Simd, Vectors},
    points::Point,
    view::View,
};

/// How far points are moved at most, pixels; those of grazing directions further, but these hardly count.
const REACH: f32 = 2.0;
/// How far above the surface rays run, pixels: what is lower is nearer than maps can tell.
const LIFT: f32 = 0.1;
/// The least room, pixels: a point in a gap that is narrower still has directions that count. With less, edges of large rooms are
/// nearer to the reference, but what stands between small things that touch becomes too bright.
const LEAST: f32 = 0.4;

/// The room of eight points, some of which have something beside them.
#[derive(Clone, Copy)]
pub(super) struct Room {
    /// Unit, in the points' planes.
    axes: [Vectors; 2],
    /// One over the distance to what is there along each axis and against it, 1/m; 0 where there is nothing.
    tightness: [[Lanes; 2]; 2],
}

impl Room {
    /// Of points, eight by eight, in maps with pixels of so many metres; none where all of the eight have room.
    pub(super) fn measure(exact: &dyn Tracer, points: &[Point], pixel: f32) -> Vec<Option<Self>> {
        let block = |points: &[Point]| {
            let beside: [_; LANES] = std::array::from_fn(|lane| {
                Beside::look(exact, &points[lane.min(points.len() - 1)], pixel)
            });
            let has_room = |beside: &Beside| beside.tightness == [[0.0; 2]; 2];
            if beside.iter().all(has_room) {
                return None;
            }
            let lanes = |of: &dyn Fn(&Beside) -> f32| beside.each_ref().map(of);
            Some(Self {
                axes: [0, 1].map(|axis| [0, 1, 2].map(|i| lanes(&|beside| beside.axes[axis][i]))),
                tightness: [0, 1]
                    .map(|axis| [0, 1].map(|way| lanes(&|beside| beside.tightness[axis][way]))),
            })
        };
        points.par_chunks(LANES).map(block).collect()
    }

    /// Whether the points stay before what is beside them when they are moved along the axes of a view by so many metres. What is
    /// there is taken for a wall through the places where two axes meet it.
    #[inline(always)]
    pub(super) fn holds<S: Simd>(&self, simd: S, view: &View, moved: [S::Floats; 3]) -> S::Mask {
        let zero = simd.splat(0.0);
        let mut used = zero;
        for (axis, [after, before]) in self.axes.iter().zip(&self.tightness) {
            let mut along = zero;
            for (moved, side) in moved.into_iter().zip([view.right, view.up, view.forward]) {
                along = simd.add(along, simd.mul(moved, simd.dot(axis, side)));
            }
            let after = simd.mul(simd.max(along, zero), simd.load(after));
            let before = simd.mul(simd.min(along, zero), simd.load(before));
            used = simd.add(used, simd.sub(after, before));
        }
        simd.less(used, simd.splat(1.0))
    }
}

/// What is beside a point.
struct Beside {
    axes: [Vec3; 2],
    tightness: [[f32; 2]; 2],
}

impl Beside {
    fn look(exact: &dyn Tracer, point: &Point, pixel: f32) -> Self {
        let normal = point.geometric_normal;
        let frame = Frame::new(normal);
        let from = point.position + LIFT * pixel * normal;
        let tightness = |towards: Vec3| {
            let ray = Ray::new(from, towards).until(REACH * pixel);
            let hit = exact.closest_hit(&ray);
            hit.map_or(0.0, |hit| 1.0 / hit.t.max(LEAST * pixel))
        };
        let axes = [frame.x, frame.y];
        Self {
            axes,
            tightness: axes.map(|axis| [tightness(axis), tightness(-axis)]),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Vec2;
    use isophote_scene::{BuildTracer, BvhOptions, BvhTracer, Selection, builtin};

    use super::*;
    use crate::cpu::lanes::Portable;

    const PIXEL: f32 = 0.02;
    /// From the wall.
    const NEAR: f32 = 0.013;

    /// On the floor beside the right wall of the Cornell box, whose floor is a plane of y.
    fn point_beside_a_wall(exact: &dyn Tracer) -> Point {
        let middle = Vec3::new(0.28, 0.3, 0.5);
        let floor = exact.closest_hit(&Ray::new(middle, -Vec3::Y)).unwrap();
        let position = middle - floor.t * Vec3::Y;
        let above = position + 1e-3 * Vec3::Y;
        let wall = exact.closest_hit(&Ray::new(above, Vec3::X)).unwrap();
        Point {
            position: position + (wall.t - NEAR) * Vec3::X,
            shading_normal: Vec3::Y,
            geometric_normal: Vec3::Y,
        }
    }

    #[test]
    fn a_wall_stops_what_is_moved_towards_it() {
        let scene = Arc::new(builtin::build("cornell").unwrap());
        let exact = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default());
        let exact = exact.unwrap();
        let beside = point_beside_a_wall(&exact);
        let free = Point {
            position: beside.position - 0.1 * Vec3::X,
            ..beside
        };
        let rooms = Room::measure(&exact, &[[free; LANES], [beside; LANES]].concat(), PIXEL);
        assert!(rooms[0].is_none(), "nothing is near");
        let room = rooms[1].unwrap();
        let view = View {
            right: Vec3::X,
            up: Vec3::Z,
            forward: Vec3::NEG_Y,
            ..View::default()
        };
        let holds = |by: Vec2| {
            let moved = [by.x, by.y, 0.0].map(|metres| Portable.splat(metres));
            Portable.bits(room.holds(Portable, &view, moved)) & 1 == 1
        };
        // However far along the wall.
        for along in [-0.03, 0.0, 0.01, 0.03] {
            assert!(holds(Vec2::new(0.9 * NEAR, along)), "{along}");
            assert!(!holds(Vec2::new(1.1 * NEAR, along)), "{along}");
            assert!(holds(Vec2::new(-0.03, along)), "{along}");
        }
    }
}
