//! Two hemispheres of rings of 4k points (M. Slater, "Constant time queries on uniformly distributed points on a
//! hemisphere", 2002, as §3.3 uses it).
//!
//! Subdividing the four triangles of a half octahedron gives rings k = 0..=n of 4k points. Slater normalises the middles
//! of edges and finds the nearest point in an image of the hemisphere that he renders once; here the rings' heights are
//! those at which each point stands for the same area, and the inverse is a formula.

use std::f32::consts::FRAC_PI_2;

use glam::{Vec2, Vec3};

use super::Arrangement;
use crate::{
    lanes::Lanes,
    math::{Vector, quadrant, whole},
};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Slater {
    rings: u32,
    /// Points of a hemisphere.
    count: f32,
    /// The ring coordinate of the equator, a little less than n + ½.
    equator: f32,
}

impl Slater {
    pub(crate) fn new(rings: u32) -> Self {
        let n = rings as f32;
        Self {
            rings,
            count: 2.0 * n * n + 2.0 * n + 1.0,
            equator: (n * n + n).sqrt(),
        }
    }

    fn hemisphere(&self) -> usize {
        let n = self.rings as usize;
        2 * n * n + 2 * n + 1
    }

    /// The number of a ring's first point in its hemisphere, that of the points within it.
    fn first(ring: usize) -> usize {
        match ring {
            0 => 0,
            k => 2 * k * (k - 1) + 1,
        }
    }

    /// The height of a ring over the equator: the middle, by area, of its band; the pole for ring 0.
    fn height(&self, ring: usize) -> f32 {
        match ring {
            0 => 1.0,
            k => 1.0 - (2 * k * k + 1) as f32 / self.count,
        }
    }

    /// The number of a point of a ring, by steps around it, in 0..=4 ring.
    #[inline(always)]
    fn index<L: Lanes>(&self, ring: L, around: L, lower: L::Mask) -> L {
        let k = L::splat;
        let points = k(4.0) * ring;
        let around = around - L::select(around.less(points), k(0.0), points);
        let first = k(2.0) * ring * (ring - k(1.0)) + k(1.0);
        let first = L::select(ring.less(k(0.5)), k(0.0), first);
        L::select(lower, k(self.count), k(0.0)) + (first + around)
    }

    /// As [`Positions::nearest`](super::Positions::nearest), without branches.
    #[inline(always)]
    pub(crate) fn cell<L: Lanes>(&self, direction: Vector<L>) -> L {
        let k = L::splat;
        let Vector { x, y, z } = direction;
        // Points of a hemisphere above this height; ring k's band has 2k² + 2k + 1 at its lower edge.
        let above = (k(1.0) - z.abs()) * k(self.count);
        let band = k(0.5) * (k(2.0) * above.max(k(1.0)) - k(1.0)).sqrt() - k(0.5);
        let ring = L::select(above.less(k(1.0)), k(0.0), whole(band) + k(1.0));
        let ring = ring.min(k(self.rings as f32));
        let (number, share) = quadrant(x, y);
        let around = whole((number + share) * ring + k(0.5));
        self.index(ring, around, z.less(k(0.0)))
    }

    /// As [`Positions::around`](super::Positions::around), without branches: barycentric coordinates in the lattice, whose
    /// triangles are the points' own. Between the two rings next to the equator there is a strip of triangles.
    #[inline(always)]
    pub(crate) fn corners<L: Lanes>(&self, direction: Vector<L>) -> ([L; 3], [L; 3]) {
        let k = L::splat;
        let Vector { x, y, z } = direction;
        let n = self.rings as f32;
        let above = (k(1.0) - z.abs()) * k(self.count);
        // The inverse of `height`, made to reach 0 at the pole.
        let middle = above.less(k(3.0));
        let third = above.max(k(0.0)) * k(1.0 / 3.0);
        let ring = L::select(middle, third, k(0.5) * (above - k(1.0))).sqrt();
        let (number, share) = quadrant(x, y);
        let strip = !ring.less(k(n));
        let (u, v) = (ring * (k(1.0) - share), ring * share);
        // Along the outermost ring, and across the equator from the upper to the lower one.
        let gap = (ring - k(n)) * k(0.5 / (self.equator - n));
        let gap = gap.max(k(0.0)).min(k(0.5));
        let lower = z.less(k(0.0));
        let across = L::select(lower, k(1.0) - gap, gap);
        let along = share * k(n);
        let i = whole(u);
        let j = L::select(strip, whole(along).min(k(n - 1.0)), whole(v));
        let first = L::select(strip, across, u - i);
        let second = L::select(strip, along, v) - j;
        // Rounding at the outermost ring must not leave the lattice.
        let sum = i + j;
        let near = (first + second).less(k(1.0)) | (!strip & k(n - 2.0).less(sum));
        let far = L::select(near, k(0.0), k(1.0));
        let opposite = first + second - k(1.0);
        let weights = [
            L::select(near, (-opposite).max(k(0.0)), opposite),
            L::select(near, first, k(1.0) - second),
            L::select(near, second, k(1.0) - first),
        ];
        // In the strip `first` leads to the lower ring, elsewhere along the lattice's first axis.
        let ring = |inside: L| L::select(strip, k(n), inside);
        let (same, other) = (lower & !strip, !near & strip);
        let corner =
            |ring: L, step: L, lower: L::Mask| self.index(ring, number * ring + step, lower);
        let indices = [
            corner(ring(sum + k(2.0) * far), j + far, same | other),
            corner(ring(sum + k(1.0)), j, lower | strip),
            corner(ring(sum + k(1.0)), j + k(1.0), same),
        ];
        (indices, weights)
    }
}

impl Arrangement for Slater {
    fn count(&self) -> usize {
        2 * self.hemisphere()
    }

    fn point(&self, index: usize) -> Vec3 {
        let half = self.hemisphere();
        let lower = index >= half;
        let within = index - if lower { half } else { 0 };
        let mut ring = 0;
        while ring < self.rings as usize && Self::first(ring + 1) <= within {
            ring += 1;
        }
        let height = self.height(ring);
        let radius = (1.0 - height * height).max(0.0).sqrt();
        let angle = match ring {
            0 => 0.0,
            _ => FRAC_PI_2 * (within - Self::first(ring)) as f32 / ring as f32,
        };
        let z = if lower { -height } else { height };
        (radius * Vec2::from_angle(angle)).extend(z).normalize()
    }

    fn nearest(&self, direction: Vec3) -> u32 {
        self.cell(Vector::from(direction)) as u32
    }

    fn around(&self, direction: Vec3) -> [(u32, f32); 3] {
        let (indices, weights) = self.corners(Vector::from(direction));
        [0, 1, 2].map(|corner| (indices[corner] as u32, weights[corner]))
    }

    /// Measured: 1.63/n at the corners of the cells next to the poles, and less elsewhere.
    fn reach(&self) -> f32 {
        1.75 / self.rings as f32
    }
}
