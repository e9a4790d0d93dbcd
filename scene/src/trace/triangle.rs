//! The ray–triangle test that all exact tracers share.
//!
//! Watertight after Woop, Benthin, Wald: "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013: the ray is sheared
//! onto an axis and the edges are tested in that plane. Two triangles that share an edge see the same two sheared
//! vertices, so they agree about the side on which the ray passes, and a ray cannot slip between them.
//!
//! What differs from the paper: 32 bits only reject. Rounding is monotone, so the sign of a rounded product minus
//! a rounded product is never the opposite of the true one (it can only become zero); therefore no fused
//! multiply-add may be used there. What 32 bits do not reject is decided in 64 bits, where the products of
//! 32-bit numbers are exact. So every implementation (scalar, SIMD) gives the same bits, and `t` and the
//! barycentric coordinates are those of the sheared triangle to the last bit even for slivers seen edge-on, which
//! is what makes conservative boxes possible (see `bvh/slabs.rs`).

use glam::{Vec2, Vec3};

use super::Ray;

/// A ray made ready for triangle tests (Woop et al. §3.2 and listing 1).
///
/// Every tracer that tests triangles with it finds the same hits as [`BruteForceTracer`](crate::BruteForceTracer),
/// bit by bit.
#[derive(Clone, Copy, Debug)]
pub struct Shear {
    /// The axes x, y, z of the test: the direction is longest along the third.
    pub axes: [usize; 3],
    /// By axis of the test.
    pub origin: [f32; 3],
    /// Shear of the first two axes per unit of the third.
    pub slope: [f32; 2],
    /// The direction along the third axis.
    depth: f64,
}

impl Shear {
    /// Makes a valid ray ready.
    #[inline]
    pub fn new(ray: &Ray) -> Self {
        let (o, d) = (ray.origin.to_array(), ray.direction.to_array());
        let kz = ray.direction.abs().max_position() % 3;
        let (kx, ky) = ((kz + 1) % 3, (kz + 2) % 3);
        Self {
            axes: [kx, ky, kz],
            origin: [o[kx], o[ky], o[kz]],
            slope: [d[kx] / d[kz], d[ky] / d[kz]],
            depth: f64::from(d[kz]),
        }
    }

    /// Distance and barycentric coordinates of the point where the ray's line meets a triangle, from either side.
    #[inline]
    pub fn intersect(&self, corners: &[Vec3; 3]) -> Option<(f32, Vec2)> {
        let coordinate = |corner: usize, axis: usize| corners[corner][axis];
        if self.is_candidate(coordinate) {
            self.intersect_candidate(coordinate)
        } else {
            None
        }
    }

    /// Whether 32 bits do not reject the triangle of these coordinates by corner and axis.
    #[inline]
    pub fn is_candidate(&self, coordinate: impl Fn(usize, usize) -> f32) -> bool {
        let [a, b, c] = self.sheared(coordinate);
        let u = c.x * b.y - c.y * b.x;
        let v = a.x * c.y - a.y * c.x;
        let w = b.x * a.y - b.y * a.x;
        min(min(u, v), w) >= 0.0 || max(max(u, v), w) <= 0.0
    }

    /// As [`intersect`](Self::intersect) for a triangle that 32 bits have not rejected.
    #[inline]
    pub fn intersect_candidate(
        &self,
        coordinate: impl Fn(usize, usize) -> f32,
    ) -> Option<(f32, Vec2)> {
        let [a, b, c] = self.sheared(coordinate);
        // The products are exact.
        let edge =
            |p: Vec3, q: Vec3| f64::from(p.x) * f64::from(q.y) - f64::from(p.y) * f64::from(q.x);
        let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        if det == 0.0 {
            return None;
        }
        let z = u * f64::from(a.z) + v * f64::from(b.z) + w * f64::from(c.z);
        let inverse = 1.0 / det;
        let uv = Vec2::new((v * inverse) as f32, (w * inverse) as f32);
        Some(((z / (det * self.depth)) as f32, uv))
    }

    /// The corners relative to the origin: x and y sheared, z as it is.
    #[inline]
    fn sheared(&self, coordinate: impl Fn(usize, usize) -> f32) -> [Vec3; 3] {
        let [kx, ky, kz] = self.axes;
        let [ox, oy, oz] = self.origin;
        let [sx, sy] = self.slope;
        let sheared = |corner: usize| {
            let x = coordinate(corner, kx) - ox;
            let y = coordinate(corner, ky) - oy;
            let z = coordinate(corner, kz) - oz;
            Vec3::new(x - sx * z, y - sy * z, z)
        };
        [sheared(0), sheared(1), sheared(2)]
    }
}

/// What x86's `minps` gives, also for NaN, so that SIMD and scalar code agree on every input.
#[inline]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// What x86's `maxps` gives.
#[inline]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn barycentrics_point_at_the_hit() {
        let corners = [
            Vec3::new(1.0, 0.0, -2.0),
            Vec3::new(0.0, 3.0, -1.0),
            Vec3::new(-2.0, -1.0, -3.0),
        ];
        let target = 0.2 * corners[0] + 0.5 * corners[1] + 0.3 * corners[2];
        for origin in [
            Vec3::ZERO,
            Vec3::new(4.0, 1.0, 7.0),
            Vec3::new(-1.0, 2.0, -30.0),
        ] {
            let ray = Ray::new(origin, target - origin);
            let (t, uv) = Shear::new(&ray).intersect(&corners).expect("aimed at it");
            assert!(
                (t - 1.0).abs() < 1e-5 && (uv - Vec2::new(0.5, 0.3)).length() < 1e-5,
                "{t} {uv}"
            );
        }
    }
}
