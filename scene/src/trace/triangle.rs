//! The ray–triangle test that all exact tracers share.
//!
//! Watertight after Woop, Benthin, Wald: "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013: the ray is sheared
//! onto an axis, edges are tested in that plane, and where 32 bits cannot tell the side of an edge 64 bits do. Two
//! triangles that share an edge calculate its edge function from the same two rounded products with opposite
//! sign, so a ray cannot slip between them. Therefore no fused multiply-add may be used in the edge functions,
//! and every implementation (scalar, SIMD) gives the same bits.

use glam::{Vec2, Vec3};

use super::Ray;

/// A ray made ready for triangle tests (Woop et al. §3.2 and listing 1).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shear {
    pub(crate) origin: Vec3,
    /// The axes: `k[2]` is the one along which the direction is longest.
    pub(crate) k: [usize; 3],
    /// Shear in the first two axes and scale along the third.
    pub(crate) s: Vec3,
}

impl Shear {
    pub(crate) fn new(ray: &Ray) -> Self {
        let d = ray.direction;
        let kz = d.abs().max_position();
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        // Keeps the winding of the triangles.
        if d[kz] < 0.0 {
            (kx, ky) = (ky, kx);
        }
        let s = Vec3::new(d[kx] / d[kz], d[ky] / d[kz], 1.0 / d[kz]);
        Self {
            origin: ray.origin,
            k: [kx, ky, kz],
            s,
        }
    }

    /// Distance and barycentric coordinates of the hit with `t_min < t <= t_max`; both sides of a triangle count.
    #[inline]
    pub(crate) fn intersect(
        &self,
        corners: [Vec3; 3],
        t_min: f32,
        t_max: f32,
    ) -> Option<(f32, Vec2)> {
        let [kx, ky, kz] = self.k;
        let [a, b, c] = corners.map(|corner| {
            let local = corner - self.origin;
            let (x, y, z) = (local[kx], local[ky], local[kz]);
            Vec3::new(x - self.s.x * z, y - self.s.y * z, self.s.z * z)
        });
        let mut u = c.x * b.y - c.y * b.x;
        let mut v = a.x * c.y - a.y * c.x;
        let mut w = b.x * a.y - b.y * a.x;
        if u == 0.0 || v == 0.0 || w == 0.0 {
            let edge = |p: Vec3, q: Vec3| {
                (f64::from(p.x) * f64::from(q.y) - f64::from(p.y) * f64::from(q.x)) as f32
            };
            (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
        }
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        if det == 0.0 {
            return None;
        }
        let t = (u * a.z + v * b.z + w * c.z) / det;
        (t > t_min && t <= t_max).then(|| (t, Vec2::new(v / det, w / det)))
    }
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
            let (t, uv) = Shear::new(&ray)
                .intersect(corners, 0.0, 2.0)
                .expect("aimed at it");
            assert!(
                (t - 1.0).abs() < 1e-5 && (uv - Vec2::new(0.5, 0.3)).length() < 1e-5,
                "{t} {uv}"
            );
            assert!(Shear::new(&ray).intersect(corners, 0.0, 0.99).is_none());
            assert!(Shear::new(&ray).intersect(corners, 1.01, 2.0).is_none());
        }
    }
}
