//! How two pictures differ, in one number.

use glam::Vec3;

/// The mean over all pixels and channels.
pub fn mean(values: &[Vec3]) -> f64 {
    let sum: f64 = values
        .iter()
        .map(|value| f64::from(value.element_sum()))
        .sum();
    sum / (3 * values.len()) as f64
}

/// How far `values` are from `truth`: the root of the mean square over all pixels and channels, by the mean of `truth`.
///
/// # Panics
/// If the slices differ in length.
pub fn relative_rmse(values: &[Vec3], truth: &[Vec3]) -> f64 {
    assert_eq!(values.len(), truth.len(), "pictures of one size");
    let pairs = values.iter().zip(truth);
    let squares: f64 = pairs
        .map(|(a, b)| f64::from((*a - *b).length_squared()))
        .sum();
    (squares / (3 * truth.len()) as f64).sqrt() / mean(truth)
}
