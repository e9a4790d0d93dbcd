//! Stage 3, which pixels' centres a triangle covers, and how deep: front and back faces alike (§3).
//!
//! A row of a triangle is where its two edges cross the line of pixel centres, from the left up to but not including the
//! right one. An edge is always followed from its lower end, so two triangles that share it agree to the bit: no centre
//! falls between them and none into both.

use glam::{Vec2, Vec3};

use super::{
    lanes::{LANES, Vectors, dot},
    triangles::{Block, Masked, Triangles},
    view::View,
};

/// A piece of a row of pixels that a triangle covers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span {
    /// The number of its first pixel.
    pub(crate) first: usize,
    pub(crate) count: usize,
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
    fn cover(&mut self, span: &Span);
}

/// Draws all triangles.
#[inline(always)]
pub(crate) fn draw(triangles: &Triangles<'_>, view: &View, target: &mut impl Target) {
    for block in &triangles.blocks {
        let placed = place(view, block);
        let mut touched = touched(view, &placed);
        while touched != 0 {
            let lane = touched.trailing_zeros() as usize;
            touched &= touched - 1;
            let corners = placed.map(|[x, y, z]| Vec3::new(x[lane], y[lane], z[lane]));
            scan(view, corners, target);
        }
    }
    for triangle in &triangles.masked {
        let corners = triangle.corners.map(|corner| {
            let (at, depth) = view.place(corner);
            at.extend(depth)
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

/// Corners in pixels and metres of depth.
#[inline(always)]
fn place(view: &View, block: &Block) -> [Vectors; 3] {
    let scale = 1.0 / view.pixel;
    block.corners.map(|corner| {
        let (x, y) = (dot(&corner, view.right), dot(&corner, view.up));
        [
            x.map(|x| (x - view.low.x) * scale),
            y.map(|y| (y - view.low.y) * scale),
            dot(&corner, view.forward),
        ]
    })
}

/// A bit for each triangle whose box holds a pixel's centre.
#[inline(always)]
fn touched(view: &View, placed: &[Vectors; 3]) -> u32 {
    let [a, b, c] = placed;
    let limits = [view.columns as f32, view.rows as f32];
    let mut bits = 0;
    let mut inside = [true; LANES];
    for axis in 0..2 {
        for lane in 0..LANES {
            let (p, q, r) = (a[axis][lane], b[axis][lane], c[axis][lane]);
            let first = (p.min(q).min(r) - 0.5).ceil().max(0.0);
            let end = (p.max(q).max(r) - 0.5).ceil().min(limits[axis]);
            inside[lane] &= first < end;
        }
    }
    for (lane, inside) in inside.into_iter().enumerate() {
        bits |= u32::from(inside) << lane;
    }
    bits
}

/// The number of the first pixel whose centre is not before a coordinate, of so many.
#[inline(always)]
fn first_center(at: f32, count: usize) -> usize {
    // What is negative becomes 0.
    ((at - 0.5).ceil() as usize).min(count)
}

/// The rows of a triangle.
#[inline(always)]
fn scan(view: &View, corners: [Vec3; 3], target: &mut impl Target) {
    let [mut a, mut b, mut c] = corners;
    let is_after = |p: Vec3, q: Vec3| p.y > q.y || (p.y == q.y && p.x > q.x);
    if is_after(a, b) {
        (a, b) = (b, a);
    }
    if is_after(b, c) {
        (b, c) = (c, b);
    }
    if is_after(a, b) {
        (a, b) = (b, a);
    }
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
            first: row * view.columns + first,
            count: end - first,
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
            let at = Vec2::new(
                (index % self.view.columns) as f32,
                (index / self.view.columns) as f32,
            ) + 0.5;
            let uv = Vec2::new((at - a).perp_dot(c - a), (b - a).perp_dot(at - a)) / doubled;
            if self.triangles.stops(self.triangle, uv) {
                self.target.cover(&Span {
                    first: index,
                    count: 1,
                    depth: span.at(pixel),
                    ..*span
                });
            }
        }
    }
}
