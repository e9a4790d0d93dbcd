//! How deep those are, tile by tile of a map, that will ask it, and how far they look: what is drawn farther away answers nobody.

use std::collections::HashMap;

use glam::{Vec2, Vec3};
use isophote_scene::Aabb;

use super::{
    lanes::LANES,
    points::PointBlock,
    raster::{Span, Target},
    view::View,
};

/// Pixels of a tile's side.
const TILE: f32 = 8.0;
/// How far points are taken to be moved within their planes, pixels: those that are moved farther hardly count.
const MOVED: f32 = 8.0;
/// Triangles over more tiles than this in a row or column are drawn without being asked about.
const MOST: usize = 4;

/// Boxes around the points of each cell of a grid, in no order. Those beside each other in a picture may be far from each other.
pub(crate) fn cells(blocks: &[PointBlock], side: f32) -> Vec<Aabb> {
    let mut cells: HashMap<[i32; 3], Aabb> = HashMap::new();
    let mut add = |bounds: Aabb| {
        let cell = (bounds.center() / side).floor().as_ivec3().to_array();
        let all = cells.entry(cell).or_insert(Aabb::EMPTY);
        *all = all.union(&bounds);
    };
    for block in blocks {
        let bounds = PointBlock::bounds(std::slice::from_ref(block));
        if (bounds.max - bounds.min).max_element() <= side {
            add(bounds);
            continue;
        }
        for lane in 0..LANES {
            let point = Vec3::from_array(block.positions.map(|axis| axis[lane]));
            add(Aabb {
                min: point,
                max: point,
            });
        }
    }
    cells.into_values().collect()
}

/// Ranges of depth.
pub(crate) struct Reach {
    columns: usize,
    rows: usize,
    /// Of each tile, metres; the first greater than the last where nobody is.
    ranges: Vec<[f32; 2]>,
}

impl Reach {
    /// Of points in boxes, which look as far as `d_max` and at the pixels beside theirs.
    pub(crate) fn new(view: &View, boxes: &[Aabb], d_max: f32) -> Self {
        let tiles = |pixels: usize| (pixels as f32 / TILE).ceil() as usize;
        let (columns, rows) = (tiles(view.columns), tiles(view.rows));
        let mut ranges = vec![[f32::INFINITY, f32::NEG_INFINITY]; columns * rows];
        let axes = [view.right, view.up, view.forward];
        let [right, up, forward] = axes.map(Vec3::abs);
        let scale = 1.0 / view.pixel;
        for bounds in boxes {
            let half = 0.5 * (bounds.max - bounds.min);
            let (at, depth) = view.place(bounds.center());
            let size = scale * Vec2::new(half.dot(right), half.dot(up)) + 2.0;
            let deep = half.dot(forward) + d_max + MOVED * view.pixel;
            let first = ((at - size) / TILE).max(Vec2::ZERO);
            let last = (at + size) / TILE;
            for row in first.y as usize..=(last.y as usize).min(rows - 1) {
                for column in first.x as usize..=(last.x as usize).min(columns - 1) {
                    let range = &mut ranges[row * columns + column];
                    *range = [range[0].min(depth - deep), range[1].max(depth + deep)];
                }
            }
        }
        Self {
            columns,
            rows,
            ranges,
        }
    }

    /// Whether a triangle of corners in pixels and metres of depth may be in somebody's way.
    #[inline(always)]
    fn meets(&self, [a, b, c]: &[Vec3; 3]) -> bool {
        let (low, high) = (a.min(*b).min(*c), a.max(*b).max(*c));
        let first = (low / TILE).max(Vec3::ZERO);
        let last = high / TILE;
        let columns = first.x as usize..=(last.x as usize).min(self.columns - 1);
        let rows = first.y as usize..=(last.y as usize).min(self.rows - 1);
        if columns.end() - columns.start() >= MOST || rows.end() - rows.start() >= MOST {
            return true;
        }
        for row in rows {
            for column in columns.clone() {
                let [least, most] = self.ranges[row * self.columns + column];
                if low.z <= most && high.z >= least {
                    return true;
                }
            }
        }
        false
    }
}

/// Takes what is within reach.
pub(crate) struct Within<'a, T> {
    pub(crate) reach: &'a Reach,
    pub(crate) target: &'a mut T,
}

impl<T: Target> Target for Within<'_, T> {
    #[inline(always)]
    fn wants(&self, corners: &[Vec3; 3]) -> bool {
        self.reach.meets(corners)
    }

    #[inline(always)]
    fn cover(&mut self, span: &Span) {
        self.target.cover(span);
    }
}
