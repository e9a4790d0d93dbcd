//! How far a picture is off: errors in linear light, and what remains of them beyond both pictures' own noise.
//!
//! All sums are made in 64 bits and in order, so that a number does not depend on the machine.

use glam::{DVec3, Vec3};
use serde::Serialize;

/// Errors of a picture `a` against a reference `b`, over all pixels and channels, in linear light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Errors {
    /// Mean of the picture.
    pub(crate) mean_test: f64,
    /// Mean of the reference.
    pub(crate) mean_reference: f64,
    /// `sqrt(mean((a − b)²)) / mean(b)`; infinite or NaN where the reference is black.
    pub(crate) rel_rmse: f64,
    /// `mean(a) / mean(b) − 1`.
    pub(crate) bias: f64,
    /// `255 · sqrt(mean((a − b)²))`, grey levels.
    pub(crate) grey_rms: f64,
    /// `255 · (mean(a) − mean(b))`, grey levels.
    pub(crate) grey_bias: f64,
}

impl Errors {
    /// Compares as many pixels as both have.
    pub(crate) fn of(test: &[Vec3], reference: &[Vec3]) -> Self {
        let (mut squares, mut sum_test, mut sum_reference) = (0.0, 0.0, 0.0);
        for (a, b) in test.iter().zip(reference) {
            let (a, b) = (a.as_dvec3(), b.as_dvec3());
            squares += (a - b).length_squared();
            sum_test += a.element_sum();
            sum_reference += b.element_sum();
        }
        let count = 3.0 * test.len().min(reference.len()) as f64;
        let (mean_test, mean_reference) = (sum_test / count, sum_reference / count);
        let rms = (squares / count).sqrt();
        Self {
            mean_test,
            mean_reference,
            rel_rmse: rms / mean_reference,
            bias: mean_test / mean_reference - 1.0,
            grey_rms: 255.0 * rms,
            grey_bias: 255.0 * (mean_test - mean_reference),
        }
    }

    /// What is left of [`rel_rmse`](Self::rel_rmse) without the noise of both pictures, each given relative to its
    /// own mean.
    pub(crate) fn rel_rmse_beyond(&self, noise_test: f64, noise_reference: f64) -> f64 {
        let scaled = noise_test * self.mean_test / self.mean_reference;
        beyond(self.rel_rmse, scaled, noise_reference)
    }

    /// What is left of [`grey_rms`](Self::grey_rms) without the noise of both pictures, each given relative to its
    /// own mean.
    pub(crate) fn grey_rms_beyond(&self, noise_test: f64, noise_reference: f64) -> f64 {
        let grey = |noise: f64, mean: f64| 255.0 * noise * mean;
        beyond(
            self.grey_rms,
            grey(noise_test, self.mean_test),
            grey(noise_reference, self.mean_reference),
        )
    }
}

/// Independent errors add up by their squares.
fn beyond(measured: f64, noise_test: f64, noise_reference: f64) -> f64 {
    (measured.powi(2) - noise_test.powi(2) - noise_reference.powi(2))
        .max(0.0)
        .sqrt()
}

/// The picture of one colour that is nearest to a reference: its mean. A technique must do much better.
pub(crate) fn constant_like(reference: &[Vec3]) -> Vec<Vec3> {
    let sum: DVec3 = reference.iter().map(|pixel| pixel.as_dvec3()).sum();
    let mean = (sum / reference.len().max(1) as f64).as_vec3();
    vec![mean; reference.len()]
}

/// The pixels with a 3×3 neighbour whose depth differs by more than 5 % or whose normal by more than 30°.
/// Pixels that see nothing have an infinite depth or none at all (0 or NaN).
pub(crate) fn silhouettes(width: usize, depths: &[f32], normals: &[Vec3]) -> Vec<bool> {
    let height = depths.len() / width.max(1);
    let seen = |i: usize| depths[i].is_finite() && depths[i] > 0.0;
    let cos_limit = 30_f32.to_radians().cos();
    let differ = |i: usize, j: usize| match (seen(i), seen(j)) {
        (true, true) => {
            let (near, far) = (depths[i].min(depths[j]), depths[i].max(depths[j]));
            far > 1.05 * near || normals[i].dot(normals[j]) < cos_limit
        }
        (a, b) => a != b,
    };
    (0..depths.len())
        .map(|i| {
            let (x, y) = (i % width, i / width);
            let columns = x.saturating_sub(1)..(x + 2).min(width);
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            rows.flat_map(|row| columns.clone().map(move |column| row * width + column))
                .any(|j| differ(i, j))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(value: f64, expected: f64) {
        assert!(
            (value - expected).abs() < 1e-6 * expected.abs().max(1.0),
            "{value}, not {expected}"
        );
    }

    #[test]
    fn errors_are_those_of_the_definitions() {
        // Differences 1, 0, 0, 0, 0, 2: mean square 5/6; means 10/6 and 9/6.
        let test = [Vec3::new(2.0, 1.0, 1.0), Vec3::new(1.0, 1.0, 4.0)];
        let reference = [Vec3::new(1.0, 1.0, 1.0), Vec3::new(1.0, 1.0, 2.0)];
        let errors = Errors::of(&test, &reference);
        near(errors.mean_test, 10.0 / 6.0);
        near(errors.mean_reference, 7.0 / 6.0);
        near(errors.rel_rmse, (5.0_f64 / 6.0).sqrt() / (7.0 / 6.0));
        near(errors.bias, 3.0 / 7.0);
        near(errors.grey_rms, 255.0 * (5.0_f64 / 6.0).sqrt());
        near(errors.grey_bias, 255.0 * 0.5);
    }

    #[test]
    fn noise_is_subtracted_in_squares() {
        // rms 0.5 over a reference of 1; the test's mean is 1.5.
        let errors = Errors::of(&[Vec3::splat(1.5)], &[Vec3::ONE]);
        near(errors.rel_rmse_beyond(0.2, 0.0), (0.25_f64 - 0.09).sqrt());
        near(errors.rel_rmse_beyond(0.0, 0.3), 0.4);
        near(errors.rel_rmse_beyond(0.0, 0.6), 0.0);
        near(errors.grey_rms_beyond(0.2, 0.0), 255.0 * 0.4);
    }

    #[test]
    fn the_constant_picture_has_the_mean_colour() {
        let constant = constant_like(&[Vec3::X, Vec3::Y]);
        assert_eq!(constant, [Vec3::new(0.5, 0.5, 0.0); 2]);
        // Four of six values are off by 1/2, the mean is 1/3.
        let errors = Errors::of(&constant, &[Vec3::X, Vec3::Y]);
        near(errors.rel_rmse, (4.0_f64 * 0.25 / 6.0).sqrt() * 3.0);
        near(errors.bias, 0.0);
    }

    #[test]
    fn silhouettes_are_where_depth_or_normal_jumps() {
        let up = Vec3::Y;
        let turned = |degrees: f32| {
            let angle = degrees.to_radians();
            Vec3::new(angle.sin(), angle.cos(), 0.0)
        };
        let line = |depths: &[f32], normals: &[Vec3]| silhouettes(depths.len(), depths, normals);
        assert_eq!(line(&[1.0, 1.04, 1.08], &[up; 3]), [false; 3]);
        assert_eq!(line(&[1.0, 1.0, 1.06], &[up; 3]), [false, true, true]);
        let normals = [up, turned(29.0), turned(60.0)];
        assert_eq!(line(&[1.0; 3], &normals), [false, true, true]);
        let nothing = [f32::INFINITY, f32::INFINITY, 1.0];
        assert_eq!(line(&nothing, &[Vec3::ZERO; 3]), [false, true, true]);
        // Diagonal neighbours count, pixels of the next row's other end do not.
        let square = silhouettes(3, &[1., 1., 1., 1., 1., 1., 2., 1., 1.], &[up; 9]);
        assert_eq!(
            square,
            [false, false, false, true, true, false, true, true, false]
        );
    }
}
