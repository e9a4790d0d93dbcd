//! Stage 3, which pixels' centres a triangle covers, and how deep: front and back faces alike (§3).
//!
//! A row of a triangle is where its two edges cross the line of pixel centres, from the left up to but not including the
//! right one. An edge is always followed from its lower end, so two triangles that share it agree to the bit: no centre
//! falls between them and none into both. Corners are rounded to a 256th of a pixel, as GPUs do, so that those cover the same.

use glam::{Vec2, Vec3};

use super::{
    lanes::{LANES, Lanes, Simd, Work},
    triangles::{Block, Masked, Triangles},
    view::View,
};

/// Of a pixel, to which corners are rounded; a power of two.
const PARTS: f32 = 256.0;

/// A piece of a row of pixels that a triangle covers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span {
    /// The number of its first pixel.
    pub(crate) first: u32,
    pub(crate) count: u32,
    /// At the first pixel's centre, metres.
    pub(crate) depth: f32,
    /// To the next pixel.
    pub(crate) step: f32,
    /// The triangle's own least and greatest, which no pixel leaves.
    pub(crate) range: [f32; 2],
}

impl Span {
    /// The depth at a pixel's centre.
    #[inline(always)]
    pub(crate) fn at(&self, pixel: usize) -> f32 {
        (self.depth + pixel as f32 * self.step).clamp(self.range[0], self.range[1])
    }
}

/// What takes the surfaces that are drawn.
pub(crate) trait Target {
    /// Whether a triangle is wanted, of corners in pixels and metres of depth.
    #[inline(always)]
    fn wants(&self, _: &[Vec3; 3]) -> bool {
        true
    }

    fn cover(&mut self, span: &Span);
}

/// Draws all triangles.
pub(crate) struct Draw<'a, 'b, T> {
    pub(crate) triangles: &'a Triangles<'b>,
    pub(crate) view: &'a View,
    pub(crate) target: &'a mut T,
}

impl<T: Target> Work for Draw<'_, '_, T> {
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self {
            triangles,
            view,
            target,
        } = self;
        for block in &triangles.blocks {
            let (mut touched, placed) = place(simd, view, block);
            while touched != 0 {
                let lane = touched.trailing_zeros() as usize;
                touched &= touched - 1;
                let corners = [0, 1, 2].map(|corner| {
                    let [x, y] = &placed[corner];
                    let depth = block.corner(corner, lane).dot(view.forward);
                    Vec3::new(x[lane], y[lane], depth)
                });
                if target.wants(&corners) {
                    scan(view, corners, target);
                }
            }
        }
        for triangle in &triangles.masked {
            let corners = triangle.corners.map(|corner| {
                let (at, depth) = view.place(corner);
                ((at * PARTS + 0.5).floor() / PARTS).extend(depth)
            });
            let mut holes = Holes {
                triangles,
                triangle,
                view,
                corners,
                target,
            };
            scan(view, corners, &mut holes);
        }
    }
}

/// A bit for each triangle whose box holds a pixel's centre, and where the corners are, pixels.
#[inline(always)]
fn place<S: Simd>(simd: S, view: &View, block: &Block) -> (u32, [[Lanes; 2]; 3]) {
    let (zero, half) = (simd.splat(0.0), simd.splat(0.5));
    let scale = simd.splat(1.0 / view.pixel);
    let mut placed = [[[0.0; LANES]; 2]; 3];
    let mut bits = !0;
    for (axis, (along, low, limit)) in [
        (view.right, view.low.x, view.columns),
        (view.up, view.low.y, view.rows),
    ]
    .into_iter()
    .enumerate()
    {
        let low = simd.splat(low);
        let at = |corner: usize| {
            let at = simd.dot(&block.corners[corner], along);
            simd.mul(simd.sub(at, low), scale)
        };
        let (a, b, c) = (at(0), at(1), at(2));
        let (a, b, c) = (rounded(simd, a), rounded(simd, b), rounded(simd, c));
        placed[0][axis] = simd.store(a);
        placed[1][axis] = simd.store(b);
        placed[2][axis] = simd.store(c);
        let least = simd.min(simd.min(a, b), c);
        let most = simd.max(simd.max(a, b), c);
        // What is rounded up is what is left of rounding its opposite down.
        let first = simd.sub(zero, simd.floor(simd.sub(half, least)));
        let end = simd.sub(zero, simd.floor(simd.sub(half, most)));
        let first = simd.max(first, zero);
        let end = simd.min(end, simd.splat(limit as f32));
        bits &= simd.bits(simd.less(first, end));
    }
    (bits, placed)
}

/// To a part of a pixel.
#[inline(always)]
fn rounded<S: Simd>(simd: S, at: S::Floats) -> S::Floats {
    let number = simd.add(simd.mul(at, simd.splat(PARTS)), simd.splat(0.5));
    simd.mul(simd.floor(number), simd.splat(1.0 / PARTS))
}

/// The number of the first pixel whose centre is not before a coordinate, of so many.
#[inline(always)]
fn first_center(at: f32, count: usize) -> usize {
    // What is negative becomes 0.
    ((at - 0.5).ceil() as usize).min(count)
}

/// The corners by their height, and those of one height from the left; by a table, since no processor foresees their order.
#[inline(always)]
fn from_below(corners: [Vec3; 3]) -> [Vec3; 3] {
    const ORDERS: [[usize; 3]; 8] = [
        [0, 1, 2],
        [1, 0, 2],
        [0, 2, 1],
        [0, 1, 2],
        [0, 1, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ];
    let [a, b, c] = corners;
    let is_after = |p: Vec3, q: Vec3| usize::from((p.y > q.y) | ((p.y == q.y) & (p.x > q.x)));
    let order = is_after(a, b) | is_after(b, c) << 1 | is_after(a, c) << 2;
    ORDERS[order].map(|corner| corners[corner])
}

/// The rows of a triangle.
#[inline(always)]
fn scan(view: &View, corners: [Vec3; 3], target: &mut impl Target) {
    let [a, b, c] = from_below(corners);
    let (u, v) = (b - a, c - a);
    let doubled = u.x * v.y - u.y * v.x;
    if doubled == 0.0 || !doubled.is_finite() {
        return;
    }
    let slope = Vec2::new(u.z * v.y - v.z * u.y, v.z * u.x - u.z * v.x) / doubled;
    let range = [a.z.min(b.z).min(c.z), a.z.max(b.z).max(c.z)];
    let long = v.x / v.y;
    let edges = [(a, u.x / u.y), (b, (c.x - b.x) / (c.y - b.y))];
    for row in first_center(a.y, view.rows)..first_center(c.y, view.rows) {
        let y = row as f32 + 0.5;
        let (from, run) = edges[usize::from(y >= b.y)];
        let ends = [a.x + (y - a.y) * long, from.x + (y - from.y) * run];
        let first = first_center(ends[0].min(ends[1]), view.columns);
        let end = first_center(ends[0].max(ends[1]), view.columns);
        if first >= end {
            continue;
        }
        let x = first as f32 + 0.5;
        let depth = a.z + (x - a.x) * slope.x + (y - a.y) * slope.y;
        if depth.is_nan() {
            continue;
        }
        target.cover(&Span {
            first: (row * view.columns + first) as u32,
            count: (end - first) as u32,
            depth,
            step: slope.x,
            range,
        });
    }
}

/// A triangle whose pixels are asked one by one whether they stop light.
struct Holes<'a, 'b, T> {
    triangles: &'a Triangles<'b>,
    triangle: &'a Masked,
    view: &'a View,
    corners: [Vec3; 3],
    target: &'a mut T,
}

impl<T: Target> Target for Holes<'_, '_, T> {
    fn cover(&mut self, span: &Span) {
        let [a, b, c] = self.corners.map(Vec3::truncate);
        let doubled = (b - a).perp_dot(c - a);
        for pixel in 0..span.count {
            let index = span.first + pixel;
            let columns = self.view.columns as u32;
            let at = Vec2::new((index % columns) as f32, (index / columns) as f32) + 0.5;
            let uv = Vec2::new((at - a).perp_dot(c - a), (b - a).perp_dot(at - a)) / doubled;
            if self.triangles.stops(self.triangle, uv) {
                self.target.cover(&Span {
                    first: index,
                    count: 1,
                    depth: span.at(pixel as usize),
                    ..*span
                });
            }
        }
    }
}
