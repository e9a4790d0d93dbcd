//! Two hemispheres of rings of 4k points (M. Slater, "Constant time queries on uniformly distributed points on a
//! hemisphere", 2002, as §3.3 uses it).
//!
//! Subdividing the four triangles of a half octahedron gives rings k = 0..=n of 4k points. Slater normalises the middles
//! of edges and finds the nearest point in an image of the hemisphere that he renders once; here the rings' heights are
//! those at which each point stands for the same area, and the inverse is a formula.

use std::f32::consts::FRAC_PI_2;

use glam::{Vec2, Vec3};

use super::Arrangement;
use crate::math::{quadrant, whole};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Slater {
    rings: i32,
    /// Points of a hemisphere.
    count: f32,
    /// The ring coordinate of the equator, a little less than n + ½.
    equator: f32,
}

impl Slater {
    pub(crate) fn new(rings: u32) -> Self {
        let n = rings as f32;
        Self {
            rings: rings as i32,
            count: 2.0 * n * n + 2.0 * n + 1.0,
            equator: (n * n + n).sqrt(),
        }
    }

    #[inline(always)]
    fn hemisphere(&self) -> i32 {
        2 * self.rings * self.rings + 2 * self.rings + 1
    }

    /// The number of a ring's first point in its hemisphere: that of the points within it.
    #[inline(always)]
    fn first(ring: i32) -> i32 {
        let k = ring;
        if k == 0 { 0 } else { 2 * k * (k - 1) + 1 }
    }

    /// The height of a ring over the equator: the middle, by area, of its band; the pole for ring 0.
    fn height(&self, ring: i32) -> f32 {
        match ring {
            0 => 1.0,
            k => 1.0 - (2 * k * k + 1) as f32 / self.count,
        }
    }

    /// As [`Positions::nearest`](super::Positions::nearest), without branches.
    #[inline(always)]
    pub(crate) fn cell(&self, x: f32, y: f32, z: f32) -> i32 {
        // Points of a hemisphere above this height; ring k's band has 2k² + 2k + 1 at its lower edge.
        let above = (1.0 - z.abs()) * self.count;
        let band = 0.5 * (2.0 * above.max(1.0) - 1.0).sqrt() - 0.5;
        let ring = if above < 1.0 { 0 } else { whole(band) + 1 };
        let ring = ring.min(self.rings);
        let (number, share) = quadrant(x, y);
        let around = whole((number + share) * ring as f32 + 0.5);
        let around = if around >= 4 * ring {
            around - 4 * ring
        } else {
            around
        };
        let lower = if z < 0.0 { self.hemisphere() } else { 0 };
        lower + Self::first(ring) + around.max(0)
    }

    /// As [`Positions::around`](super::Positions::around), without branches: barycentric coordinates in the lattice, whose
    /// triangles are the points' own. Between the two rings next to the equator there is a strip of triangles.
    #[inline(always)]
    pub(crate) fn corners(&self, x: f32, y: f32, z: f32) -> ([i32; 3], [f32; 3]) {
        let n = self.rings;
        let above = (1.0 - z.abs()) * self.count;
        // The inverse of `height`, made to reach 0 at the pole.
        let squared = if above < 3.0 {
            above.max(0.0) / 3.0
        } else {
            0.5 * (above - 1.0)
        };
        let ring = squared.sqrt();
        let (number, share) = quadrant(x, y);
        let strip = ring >= n as f32;
        let (u, v) = (ring * (1.0 - share), ring * share);
        // Along the outermost ring, and across the equator from the upper to the lower one.
        let gap = (0.5 * (ring - n as f32) / (self.equator - n as f32)).clamp(0.0, 0.5);
        let across = if z < 0.0 { 1.0 - gap } else { gap };
        let along = share * n as f32;
        let i = whole(u);
        let j = if strip {
            whole(along).min(n - 1)
        } else {
            whole(v)
        };
        let first = if strip { across } else { u - i as f32 };
        let second = if strip {
            along - j as f32
        } else {
            v - j as f32
        };
        // Rounding at the outermost ring must not leave the lattice.
        let near = (first + second < 1.0) | (!strip & (i + j + 2 > n));
        let far = i32::from(!near);
        let weights = if near {
            [(1.0 - first - second).max(0.0), first, second]
        } else {
            [first + second - 1.0, 1.0 - second, 1.0 - first]
        };
        let lower = z < 0.0;
        // In the strip `first` leads to the lower ring, elsewhere along the lattice's first axis.
        let rings = if strip {
            [n; 3]
        } else {
            [i + j + 2 * far, i + j + 1, i + j + 1]
        };
        let steps = [j + far, j, j + 1];
        let lowers = if strip {
            [!near, true, false]
        } else {
            [lower; 3]
        };
        let number = whole(number);
        let indices = [0, 1, 2].map(|corner| {
            let ring = rings[corner];
            let around = number * ring + steps[corner];
            let around = if around >= 4 * ring {
                around - 4 * ring
            } else {
                around
            };
            let base = if lowers[corner] { self.hemisphere() } else { 0 };
            base + Self::first(ring) + around.max(0)
        });
        (indices, weights)
    }
}

impl Arrangement for Slater {
    fn count(&self) -> usize {
        2 * self.hemisphere() as usize
    }

    fn point(&self, index: usize) -> Vec3 {
        let half = self.hemisphere();
        let lower = index as i32 >= half;
        let within = index as i32 - if lower { half } else { 0 };
        let mut ring = 0;
        while ring < self.rings && Self::first(ring + 1) <= within {
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
        self.cell(direction.x, direction.y, direction.z) as u32
    }

    fn around(&self, direction: Vec3) -> [(u32, f32); 3] {
        let (indices, weights) = self.corners(direction.x, direction.y, direction.z);
        [0, 1, 2].map(|corner| (indices[corner] as u32, weights[corner]))
    }

    /// Measured: 1.63/n at the corners of the cells next to the poles, and less elsewhere.
    fn reach(&self) -> f32 {
        1.75 / self.rings as f32
    }
}
