//! A ray made ready for box tests that never lose a hit.
//!
//! # Why no hit is lost
//! Let u = 2⁻²⁴, all lengths in the norm that is the largest absolute coordinate, o the origin, and M at least the
//! distance from the origin to any point of the tree's box. A hit that the triangle test
//! ([`Shear`](crate::trace::triangle::Shear)) accepts is a point P = Σλᵢ(vᵢ − o) of the triangle, so o + P lies in every
//! box around it, with the exact barycentric coordinates λ (up to 2⁻⁵²) of a triangle whose sheared vertices
//! are rounded: vᵢ − o by uM, the slope by u (shifting x by uM), the product by uM, the difference by 2uM. Hence
//! |Px − slope·Pz| ≤ 5uM. The answer t is Pz/dz up to 3uM in length, so the point t·d is within 8uM of P on
//! every axis: it lies in every box that contains the triangle, padded by 8uM.
//!
//! The slab test evaluates (plane − o)/d as plane·r − (o·r) with r = 1/d rounded. In length, its rounding is at most
//! u|o| (padding o) + 2uM (r) + u|o| (o·r) + u(M + |o|) (plane·r, where it is not fused) + uM (the difference), that is
//! less than 4u(M + |o|). Directions that are 0 or tiny along an axis are replaced by 2⁻³⁰ of the largest coordinate so
//! that r is finite; over the length of a hit, M, that moves the ray by less than uM/64. In total 13u(M + |o|)
//! suffice; 16u(M + |o|) = 2⁻²⁰(M + |o|) are taken. Moving the origin against the direction for near planes and along
//! it for far planes pads all boxes at no cost per box.
//!
//! Distances are counted in units of the direction's largest coordinate, so that no power of ten of the direction
//! or the scene overflows where the hit itself is a number.

use glam::Vec3A;

use crate::{Aabb, Ray};

/// See the module.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slabs {
    /// Reciprocal direction.
    pub(crate) inverse: Vec3A,
    /// To be subtracted from near planes times `inverse`.
    pub(crate) near: Vec3A,
    /// To be subtracted from far planes times `inverse`.
    pub(crate) far: Vec3A,
    /// A bit for each axis on which the ray goes down, so that the upper face of a box is the near one.
    down: usize,
    /// Where the ray starts, at least 0.
    pub(crate) start: f32,
    scale: f32,
}

impl Slabs {
    /// A ray for the boxes within `bounds`; its end does not count.
    #[inline]
    pub(crate) fn new(ray: &Ray, bounds: &Aabb) -> Self {
        let (o, d) = (Vec3A::from(ray.origin), Vec3A::from(ray.direction));
        let scale = d.abs().max_element();
        let start = ray.t_min * scale;
        Self {
            start: (start - slack(start)).max(0.0),
            scale,
            ..Self::along(o, d / scale, Vec3A::splat(padding(o, bounds)), Vec3A::ONE)
        }
    }

    /// This ray in another space: its origin and direction there, where distances are counted as here, and by how much
    /// boxes are to be padded. The direction's smallest coordinates may be moved by 2⁻³⁰ of `size`.
    #[inline]
    pub(crate) fn taken_to(&self, o: Vec3A, d: Vec3A, pad: Vec3A, size: Vec3A) -> Self {
        Self {
            start: self.start,
            scale: self.scale,
            ..Self::along(o, d, pad, size)
        }
    }

    #[inline]
    fn along(o: Vec3A, d: Vec3A, pad: Vec3A, size: Vec3A) -> Self {
        let least = size * power_of_two(-30);
        let d = Vec3A::select(d.abs().cmplt(least), least.copysign(d), d);
        let (pad, inverse) = (pad.copysign(d), d.recip());
        Self {
            inverse,
            near: (o + pad) * inverse,
            far: (o - pad) * inverse,
            down: d.is_negative_bitmask() as usize,
            start: 0.0,
            scale: 1.0,
        }
    }

    /// Whether the upper face of boxes is the near one, as 0 or 1.
    #[inline]
    pub(crate) fn down(&self, axis: usize) -> usize {
        self.down >> axis & 1
    }

    /// A distance along the ray in the units of the box tests, rounded up.
    #[inline]
    pub(crate) fn limit(&self, t: f32) -> f32 {
        let limit = t * self.scale;
        limit + slack(limit)
    }
}

/// By how much boxes are padded for a ray from `origin`: 2⁻²⁰(M + |o|).
#[inline]
pub(crate) fn padding(origin: Vec3A, bounds: &Aabb) -> f32 {
    let (low, high) = (Vec3A::from(bounds.min), Vec3A::from(bounds.max));
    let farthest = (low - origin).abs().max((high - origin).abs());
    (farthest.max_element() + origin.abs().max_element()) * power_of_two(-20)
}

/// More than the rounding of a product.
#[inline]
fn slack(t: f32) -> f32 {
    t.abs() * power_of_two(-22) + f32::MIN_POSITIVE
}

const fn power_of_two(exponent: i32) -> f32 {
    f32::from_bits(((127 + exponent) as u32) << 23)
}
