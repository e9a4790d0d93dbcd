//! Arithmetic that compilers turn into vector instructions: no branches, no calls.

use glam::Vec3;

/// The share of a right angle between the x axis and (x, y), for x and y of at least 0: in 0..=1, off by 4·10⁻⁶ at most.
/// 0 where both are 0.
#[inline(always)]
pub(crate) fn quarter(x: f32, y: f32) -> f32 {
    let ratio = x.min(y) / x.max(y).max(1e-30);
    let s = ratio * ratio;
    // Minimax of atan on 0..=1, times 2/π.
    let angle = ratio
        * (0.636_605_4
            + s * (-0.211_755_12
                + s * (0.123_213_64
                    + s * (-0.074_123_464 + s * (0.033_520_144 - s * 0.007_461_948)))));
    if y > x { 1.0 - angle } else { angle }
}

/// The quadrant around z of (x, y), 0..=3, and how far into it, 0..=1.
#[inline(always)]
pub(crate) fn quadrant(x: f32, y: f32) -> (f32, f32) {
    let share = quarter(x.abs(), y.abs());
    let (left, below) = (x < 0.0, y < 0.0);
    let odd = left != below;
    let number = match (below, left) {
        (false, false) => 0.0,
        (false, true) => 1.0,
        (true, true) => 2.0,
        (true, false) => 3.0,
    };
    (number, if odd { 1.0 - share } else { share })
}

/// The whole part of a number of 0..4·10⁶; 0 for what is less or NaN. `as` would do, but not for many at once.
#[inline(always)]
pub(crate) fn whole(x: f32) -> i32 {
    /// Added to it, a number is rounded to a whole one, which stands in its last bits.
    const MAGIC: f32 = 8_388_608.0;
    #[expect(clippy::manual_clamp, reason = "NaN becomes 0")]
    let x = x.max(0.0).min(4e6);
    let rounded = x + MAGIC;
    let above = rounded - MAGIC > x;
    (rounded.to_bits() as i32 - MAGIC.to_bits() as i32) - i32::from(above)
}

/// The first two axes of the frame around a unit vector: as [`Frame`](isophote_scene::sample::Frame), without its
/// branch.
#[inline(always)]
pub(crate) fn tangents(z: Vec3) -> (Vec3, Vec3) {
    let sign = if z.z < -0.55 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + z.z);
    let b = z.x * z.y * a;
    (
        Vec3::new(1.0 + sign * z.x * z.x * a, sign * b, -sign * z.x),
        Vec3::new(b, sign + z.y * z.y * a, -z.y),
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
            assert_eq!(whole(x), x as i32, "{x}");
        }
        assert_eq!([f32::NAN, -1.5, -0.0, f32::NEG_INFINITY].map(whole), [0; 4]);
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
