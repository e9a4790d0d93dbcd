//! Which pixels a triangle is in, and how deep.
//!
//! All in 64 bits: what is left to rounding are the rays, and the [`margin`] is for them.

use glam::{DVec2, DVec3};

use crate::{
    Coverage,
    cpu::maps::{margin, pixel_index},
};

/// A triangle's part in a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Fragment {
    pub(super) pixel: u32,
    pub(super) target: u32,
    pub(super) near: u16,
    pub(super) far: u16,
}

/// So many depths of the map over half a pixel are those of a plane that is seen edge-on.
const STEEP: f64 = 40.0;

/// Rasterises triangles of a map.
pub(super) struct Raster {
    resolution: u32,
    depth_steps: u32,
    coverage: Coverage,
    margin: f64,
}

/// The plane of a triangle as depth over the picture.
struct Plane {
    corner: DVec3,
    gradient: DVec2,
}

impl Raster {
    pub(super) fn new(resolution: u32, depth_steps: u32, coverage: Coverage) -> Self {
        Self {
            resolution,
            depth_steps,
            coverage,
            margin: margin(resolution),
        }
    }

    /// Calls `emit` for every pixel of a triangle, whose corners are in pixels and depth steps.
    pub(super) fn draw(&self, corners: [DVec3; 3], target: u32, emit: &mut impl FnMut(Fragment)) {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a);
        let plane = Plane {
            corner: a,
            gradient: -normal.truncate() / normal.z,
        };
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let Some(rows) = self.pixels(low.y, high.y) else {
            return;
        };
        for row in rows {
            let strip = Strip::cut(
                &corners,
                f64::from(row) - self.margin,
                f64::from(row) + 1.0 + self.margin,
            );
            let Some(columns) = self.pixels(strip.low.x, strip.high.x) else {
                continue;
            };
            for column in columns {
                let center = DVec2::new(f64::from(column), f64::from(row)) + 0.5;
                if self.coverage == Coverage::Center && !covers(&corners, center) {
                    continue;
                }
                let depths = plane.depths(center, 0.5 + self.margin, self.depth_steps);
                let (mut near, mut far) = (depths[0].max(strip.low.y), depths[1].min(strip.high.y));
                if near > far {
                    (near, far) = (strip.low.y, strip.high.y);
                }
                let (near, far) = (near - self.margin, far + self.margin);
                let last = f64::from(self.depth_steps - 1);
                if far < 0.0 || near >= last + 1.0 {
                    continue;
                }
                emit(Fragment {
                    pixel: pixel_index(self.resolution, column, row) as u32,
                    target,
                    near: near.clamp(0.0, last) as u16,
                    far: far.clamp(0.0, last) as u16,
                });
            }
        }
    }

    /// The pixels of a range, margins included, that are in the map.
    fn pixels(&self, low: f64, high: f64) -> Option<std::ops::RangeInclusive<u32>> {
        let (low, high) = (low - self.margin, high + self.margin);
        let last = f64::from(self.resolution - 1);
        // Also false for NaN.
        (high >= 0.0 && low < last + 1.0)
            .then(|| low.clamp(0.0, last) as u32..=high.clamp(0.0, last) as u32)
    }
}

impl Plane {
    /// The least and greatest depth over a square. All depths where the plane is seen edge-on.
    fn depths(&self, center: DVec2, half: f64, depth_steps: u32) -> [f64; 2] {
        let middle = self.corner.z + self.gradient.dot(center - self.corner.truncate());
        let spread = self.gradient.abs().element_sum() * half;
        // A steep plane's depth is lost in the rounding of its corners.
        if spread < STEEP * f64::from(depth_steps) {
            [middle - spread, middle + spread]
        } else {
            [f64::NEG_INFINITY, f64::INFINITY]
        }
    }
}

/// The part of a triangle between two rows: the ranges of its x and z.
struct Strip {
    low: DVec2,
    high: DVec2,
}

impl Strip {
    fn cut(corners: &[DVec3; 3], bottom: f64, top: f64) -> Self {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let mut take = |x: f64, z: f64| {
            low = low.min(DVec2::new(x, z));
            high = high.max(DVec2::new(x, z));
        };
        for index in 0..3 {
            let (p, q) = (corners[index], corners[(index + 1) % 3]);
            if bottom <= p.y && p.y <= top {
                take(p.x, p.z);
            }
            for edge in [bottom, top] {
                if (p.y < edge) != (q.y < edge) {
                    let share = (edge - p.y) / (q.y - p.y);
                    take(p.x + share * (q.x - p.x), p.z + share * (q.z - p.z));
                }
            }
        }
        Self { low, high }
    }
}

/// Whether a point is in a triangle of the picture, or on its edge.
fn covers(corners: &[DVec3; 3], point: DVec2) -> bool {
    let [u, v, w] = [0, 1, 2].map(|index| {
        let (p, q) = (
            corners[index].truncate(),
            corners[(index + 1) % 3].truncate(),
        );
        (q - p).perp_dot(point - p)
    });
    (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0)
}
