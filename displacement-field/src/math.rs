//! Arithmetic of [`Lanes`]: no branches, no calls.

use std::ops::{Add, Mul, Neg, Sub};

use glam::Vec3;

use crate::lanes::Lanes;

/// A vector of three axes, of one lane or several.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Vector<L> {
    pub(crate) x: L,
    pub(crate) y: L,
    pub(crate) z: L,
}

impl<L: Lanes> Vector<L> {
    #[inline(always)]
    pub(crate) fn new(x: L, y: L, z: L) -> Self {
        Self { x, y, z }
    }

    #[inline(always)]
    pub(crate) fn dot(self, other: Self) -> L {
        self.x * other.x + self.y * other.y + self.z * other.z
    }
}

impl From<Vec3> for Vector<f32> {
    fn from(Vec3 { x, y, z }: Vec3) -> Self {
        Self { x, y, z }
    }
}

impl<L: Lanes> Add for Vector<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self::new(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}

impl<L: Lanes> Sub for Vector<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self::new(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}

impl<L: Lanes> Mul<L> for Vector<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: L) -> Self {
        Self::new(self.x * factor, self.y * factor, self.z * factor)
    }
}

impl<L: Lanes> Neg for Vector<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::new(-self.x, -self.y, -self.z)
    }
}

/// The share of a right angle between the x axis and (x, y), for x and y of at least 0: in 0..=1, off by 4·10⁻⁶ at most.
/// 0 where both are 0.
#[inline(always)]
pub(crate) fn quarter<L: Lanes>(x: L, y: L) -> L {
    let k = L::splat;
    let ratio = x.min(y) / x.max(y).max(k(1e-30));
    let s = ratio * ratio;
    // Minimax of atan on 0..=1, times 2/π.
    let series = k(0.033_520_144) - s * k(0.007_461_948);
    let series = k(-0.074_123_464) + s * series;
    let series = k(0.123_213_64) + s * series;
    let series = k(-0.211_755_12) + s * series;
    let angle = ratio * (k(0.636_605_4) + s * series);
    L::select(x.less(y), k(1.0) - angle, angle)
}

/// The quadrant around z of (x, y), 0..=3, and how far into it, 0..=1.
#[inline(always)]
pub(crate) fn quadrant<L: Lanes>(x: L, y: L) -> (L, L) {
    let k = L::splat;
    let share = quarter(x.abs(), y.abs());
    let (left, below) = (x.less(k(0.0)), y.less(k(0.0)));
    let odd = (left & !below) | (below & !left);
    let upper = L::select(left, k(1.0), k(0.0));
    let lower = L::select(left, k(2.0), k(3.0));
    let number = L::select(below, lower, upper);
    (number, L::select(odd, k(1.0) - share, share))
}

/// The whole part of a number of 0..4·10⁶; 0 for what is less or NaN.
#[inline(always)]
pub(crate) fn whole<L: Lanes>(x: L) -> L {
    /// Added to it, a number is rounded to a whole one.
    const MAGIC: f32 = 8_388_608.0;
    let x = x.max(L::splat(0.0)).min(L::splat(4e6));
    let rounded = (x + L::splat(MAGIC)) - L::splat(MAGIC);
    rounded - L::select(x.less(rounded), L::splat(1.0), L::splat(0.0))
}

/// The first two axes of the frame around a unit vector: as [`Frame`](isophote_scene::sample::Frame), without its
/// branch.
#[inline(always)]
pub(crate) fn tangents<L: Lanes>(z: Vector<L>) -> (Vector<L>, Vector<L>) {
    let one = L::splat(1.0);
    let sign = L::select(z.z.less(L::splat(-0.55)), -one, one);
    let a = -one / (sign + z.z);
    let b = z.x * z.y * a;
    (
        Vector::new(one + sign * z.x * z.x * a, sign * b, -sign * z.x),
        Vector::new(b, sign + z.y * z.y * a, -z.y),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarters_are_angles() {
        for step in 0..=1000 {
            let angle = step as f32 / 1000.0 * std::f32::consts::FRAC_PI_2;
            let share = quarter(angle.cos().max(0.0), angle.sin());
            assert!(
                (share - step as f32 / 1000.0).abs() < 4e-6,
                "{step}: {share}"
            );
        }
        assert_eq!(quarter(0.0, 0.0), 0.0);
    }

    #[test]
    fn whole_parts() {
        for x in [
            0.0,
            0.4,
            0.5,
            0.999_999_9,
            1.0,
            1.5,
            2.5,
            1000.7,
            65_535.996,
            3_999_999.5,
        ] {
            assert_eq!(whole(x), x.floor(), "{x}");
        }
        assert_eq!(
            [f32::NAN, -1.5, -0.0, f32::NEG_INFINITY].map(whole),
            [0.0; 4]
        );
    }

    #[test]
    fn quadrants_go_around() {
        for step in 0..4000 {
            let turn = (step as f32 + 0.5) / 1000.0;
            let angle = turn * std::f32::consts::FRAC_PI_2;
            let (number, share) = quadrant(angle.cos(), angle.sin());
            assert!(
                (number + share - turn).abs() < 2e-5,
                "{turn}: {number} {share}"
            );
        }
    }
}
