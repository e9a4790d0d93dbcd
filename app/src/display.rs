//! How different two pictures look: PSNR, SSIM and FLIP of what a screen shows.

use glam::Vec3;
use isophote_scene::linear_to_srgb;
use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageFloat, FlipImageRgb8, FlipPool};
use serde::Serialize;

/// Differences between two pictures as sRGB in 0..=1.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Look {
    /// Peak signal to noise ratio in dB for a peak of 1; infinite for equal pictures.
    pub(crate) psnr: f64,
    /// Structural similarity, 1 for equal pictures.
    pub(crate) ssim: f64,
    /// Mean FLIP error at 67 pixels per degree, 0 for equal pictures, at most 1.
    pub(crate) flip: f64,
}

impl Look {
    /// Compares linear pictures of one size after multiplication with 2^`exposure`.
    pub(crate) fn of(size: [u32; 2], test: &[Vec3], reference: &[Vec3], exposure: f32) -> Self {
        let (test, reference) = (shown(test, exposure), shown(reference, exposure));
        Self {
            psnr: psnr(&test, &reference),
            ssim: ssim(size[0] as usize, &test, &reference),
            flip: flip(size, &test, &reference),
        }
    }
}

/// What a screen shows of linear values: sRGB in 0..=1.
fn shown(pixels: &[Vec3], exposure: f32) -> Vec<Vec3> {
    let factor = exposure.exp2();
    pixels
        .iter()
        .map(|&pixel| (pixel * factor).clamp(Vec3::ZERO, Vec3::ONE))
        .map(|pixel| Vec3::from(pixel.to_array().map(linear_to_srgb)))
        .collect()
}

fn psnr(test: &[Vec3], reference: &[Vec3]) -> f64 {
    let squares: f64 = test
        .iter()
        .zip(reference)
        .map(|(a, b)| (a.as_dvec3() - b.as_dvec3()).length_squared())
        .sum();
    -10.0 * (squares / (3.0 * test.len() as f64)).log10()
}

/// Mean structural similarity over channels and pixels: Wang, Bovik, Sheikh, Simoncelli: "Image Quality Assessment:
/// From Error Visibility to Structural Similarity", IEEE TIP 13(4), 2004, Eq. (13) with the constants of §III-C
/// (K1 = 0.01, K2 = 0.03, Gaussian window of 11×11, σ = 1.5), over the pixels around which the window fits; in a
/// picture too small for any, over all pixels with the window cut at the border.
fn ssim(width: usize, test: &[Vec3], reference: &[Vec3]) -> f64 {
    const C1: f32 = 0.01 * 0.01;
    const C2: f32 = 0.03 * 0.03;
    let blurred = |value: &dyn Fn(Vec3, Vec3) -> Vec3| {
        let values: Vec<Vec3> = test
            .iter()
            .zip(reference)
            .map(|(&a, &b)| value(a, b))
            .collect();
        gaussian(width, &values)
    };
    let (mean_a, mean_b) = (blurred(&|a, _| a), blurred(&|_, b| b));
    let (aa, bb, ab) = (
        blurred(&|a, _| a * a),
        blurred(&|_, b| b * b),
        blurred(&|a, b| a * b),
    );
    let inside = |at: usize, length: usize| length < 11 || (5..length - 5).contains(&at);
    let height = test.len() / width.max(1);
    let similarities: Vec<f64> = (0..test.len())
        .filter(|i| inside(i % width, width) && inside(i / width, height))
        .map(|i| {
            let (a, b) = (mean_a[i], mean_b[i]);
            let covariance = ab[i] - a * b;
            let variances = aa[i] - a * a + bb[i] - b * b;
            let similarity = (2.0 * a * b + C1) * (2.0 * covariance + C2)
                / ((a * a + b * b + C1) * (variances + C2));
            f64::from(similarity.element_sum()) / 3.0
        })
        .collect();
    similarities.iter().sum::<f64>() / similarities.len() as f64
}

/// Weighs 11×11 pixels by a Gaussian of σ = 1.5; pixels outside the image do not count.
fn gaussian(width: usize, values: &[Vec3]) -> Vec<Vec3> {
    let height = values.len() / width.max(1);
    let weights: [f32; 6] = std::array::from_fn(|i| (-((i * i) as f32) / 4.5).exp());
    let blur = |values: &[Vec3], at: usize, length: usize, index: &dyn Fn(usize) -> usize| {
        let (mut sum, mut weight_sum) = (Vec3::ZERO, 0.0);
        for other in at.saturating_sub(5)..(at + 6).min(length) {
            let weight = weights[at.abs_diff(other)];
            sum += weight * values[index(other)];
            weight_sum += weight;
        }
        sum / weight_sum
    };
    let pixels = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let rows: Vec<Vec3> = pixels()
        .map(|(x, y)| blur(values, x, width, &|x| y * width + x))
        .collect();
    pixels()
        .map(|(x, y)| blur(&rows, y, height, &|y| y * width + x))
        .collect()
}

/// Andersson et al.: "FLIP: A Difference Evaluator for Alternating Images", HPG 2020; the mean of the error map.
fn flip([width, height]: [u32; 2], test: &[Vec3], reference: &[Vec3]) -> f64 {
    let image = |pixels: &[Vec3]| {
        let bytes: Vec<u8> = pixels
            .iter()
            .flat_map(|pixel| pixel.to_array())
            .map(|value| (value * 255.0).round() as u8)
            .collect();
        FlipImageRgb8::with_data(width, height, &bytes)
    };
    let map = nv_flip::flip(image(reference), image(test), DEFAULT_PIXELS_PER_DEGREE);
    f64::from(FlipPool::from_image(&map).mean())
}

/// Values in 0..=1 in false colour (magma: black, violet, orange, light yellow), as linear RGB.
pub(crate) fn false_color([width, height]: [u32; 2], values: &[f32]) -> Vec<Vec3> {
    let clamped: Vec<f32> = values.iter().map(|value| value.clamp(0.0, 1.0)).collect();
    FlipImageFloat::with_data(width, height, &clamped)
        .apply_color_lut(&nv_flip::magma_lut())
        .to_vec()
        .chunks_exact(3)
        .map(|rgb| Vec3::new(rgb[0].into(), rgb[1].into(), rgb[2].into()) / 255.0)
        .map(|rgb| Vec3::from(rgb.to_array().map(isophote_scene::srgb_to_linear)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Vec<Vec3> {
        (0..64 * 32)
            .map(|i| Vec3::new((i % 64) as f32 / 63.0, (i / 64) as f32 / 31.0, 0.5))
            .collect()
    }

    #[test]
    fn equal_pictures_look_equal() {
        let look = Look::of([64, 32], &ramp(), &ramp(), 0.0);
        assert_eq!(look.psnr, f64::INFINITY);
        assert!((look.ssim - 1.0).abs() < 1e-6 && look.flip == 0.0);
    }

    #[test]
    fn psnr_of_a_tenth_is_twenty_decibels() {
        let value = psnr(&[Vec3::splat(0.6); 4], &[Vec3::splat(0.5); 4]);
        assert!((value - 20.0).abs() < 1e-4, "{value}");
    }

    #[test]
    fn ssim_of_flat_pictures_is_the_luminance_term() {
        let (a, b) = (0.25, 0.75);
        let value = ssim(20, &[Vec3::splat(a); 400], &[Vec3::splat(b); 400]);
        // With no variance Eq. (13) is (2ab + C1) / (a² + b² + C1).
        let expected = (2.0 * a * b + 1e-4) / (a * a + b * b + 1e-4);
        assert!((value - f64::from(expected)).abs() < 1e-4, "{value}");
    }

    #[test]
    fn ssim_of_the_negative_is_negative() {
        let checker: Vec<Vec3> = (0..32 * 32)
            .map(|i| Vec3::splat(((i + i / 32) % 2) as f32))
            .collect();
        let negative: Vec<Vec3> = checker.iter().map(|&pixel| Vec3::ONE - pixel).collect();
        assert!(ssim(32, &checker, &negative) < -0.9);
    }

    #[test]
    fn flip_of_black_and_white_is_near_one() {
        let (black, white) = (vec![Vec3::ZERO; 32 * 32], vec![Vec3::ONE; 32 * 32]);
        let value = flip([32, 32], &black, &white);
        assert!(value > 0.9 && value <= 1.0, "{value}");
        assert!(flip([1, 1], &black[..1], &white[..1]) > 0.9);
    }

    #[test]
    fn false_color_goes_from_dark_to_light() {
        let colors = false_color([3, 1], &[-1.0, 0.5, 7.0]);
        let light = |color: Vec3| color.element_sum();
        assert!(light(colors[0]) < 0.01 && light(colors[2]) > 2.0);
        assert!(light(colors[0]) < light(colors[1]) && light(colors[1]) < light(colors[2]));
    }
}
