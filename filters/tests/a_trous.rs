//! The edge-avoiding à-trous wavelet.

#![expect(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{Picture, assert_close, noise, view, window};
use isophote_filters::{ATrous, EdgeStop, Error, NormalWeight};

fn filter(filter: &ATrous, picture: &Picture, image: &[f32], channels: usize) -> Vec<f32> {
    let mut output = vec![f32::NAN; image.len()];
    let image = view(image, picture.width, picture.height, channels);
    filter.apply(image, &picture.guides(), &mut output).unwrap();
    output
}

#[test]
fn the_levels_are_the_formula() {
    let picture = Picture::planes(37, 29, 4);
    let image = noise(12, 37 * 29 * 3);
    let (levels, sigma, angle, depth) = (3, 0.6_f32, 0.5_f32, 0.1_f32);
    let edges = EdgeStop::new(NormalWeight::Angle(angle), depth).unwrap();
    let found = filter(
        &ATrous::new(levels, sigma, edges).unwrap(),
        &picture,
        &image,
        3,
    );
    let spline = [1.0 / 16.0, 0.25, 0.375, 0.25, 1.0 / 16.0];
    let mut level_image = image;
    for level in 0..levels {
        let step = 1_isize << level;
        let axis = (-2..=2).map(|k| k * step);
        let offsets = window(axis.clone(), axis);
        let color = f64::from(sigma) / f64::from(1 << level);
        let values = |[x, y]: [usize; 2]| &level_image[(y * 37 + x) * 3..][..3];
        let pixels = (0..29).flat_map(|y| (0..37).map(move |x| [x, y]));
        let next = pixels.flat_map(|p| {
            picture.weighted_mean(&level_image, 3, p, &offsets, |q, offset| {
                let squares: f64 = (values(p).iter().zip(values(q)))
                    .map(|(a, b)| f64::from(a - b).powi(2))
                    .sum();
                let [h, v] = offset.map(|d| spline[(d / step + 2) as usize]);
                h * v
                    * picture.weight(p, q, Some(angle.into()), depth.into())
                    * (-squares / (color * color)).exp()
            })
        });
        level_image = next.map(|value| value as f32).collect();
    }
    assert_close(&found, level_image.into_iter().map(f64::from), 1e-4);
}

#[test]
fn a_constant_stays_and_noise_goes() {
    let wall = Picture::wall(80, 60);
    let smooth = ATrous::new(5, f32::INFINITY, EdgeStop::default()).unwrap();
    let constant = vec![0.3; 80 * 60];
    let output = filter(&smooth, &wall, &constant, 1);
    assert_close(&output, constant.iter().map(|&value| value.into()), 1e-6);
    let noisy = noise(3, 80 * 60);
    let deviation = |image: &[f32]| {
        let squares: f32 = image.iter().map(|value| (value - 0.5).powi(2)).sum();
        (squares / image.len() as f32).sqrt()
    };
    let output = filter(&smooth, &wall, &noisy, 1);
    assert!(
        deviation(&output) < 0.05 * deviation(&noisy),
        "{}",
        deviation(&output)
    );
}

/// On a wall without borders nearby, the levels without their weights by value are convolutions that keep the sum.
#[test]
fn an_impulse_spreads_by_the_splines_and_keeps_its_energy() {
    let wall = Picture::wall(64, 64);
    let mut image = vec![0.0; 64 * 64];
    image[32 * 64 + 32] = 1.0;
    let plain = ATrous::new(3, f32::INFINITY, EdgeStop::default()).unwrap();
    let output = filter(&plain, &wall, &image, 1);
    let energy: f64 = output.iter().map(|&value| f64::from(value)).sum();
    assert!((energy - 1.0).abs() < 1e-5, "{energy}");
    let reach = 2 * 7;
    for (index, value) in output.iter().enumerate() {
        let (dx, dy) = ((index % 64).abs_diff(32), (index / 64).abs_diff(32));
        assert_eq!(*value > 0.0, dx <= reach && dy <= reach, "({dx}, {dy})");
    }
}

#[test]
fn no_light_crosses_an_edge() {
    let picture = Picture::of(50, 40, |x, y| match (x < 25, y < 20) {
        (true, true) => Some(([0.0, 0.0, 1.0], 2.0)),
        (true, false) => Some(([0.0, 0.0, 1.0], 3.0)),
        (false, true) => Some(([1.0, 0.0, 0.1], 2.0)),
        (false, false) => None,
    });
    let image: Vec<_> = (0..2000)
        .map(|pixel| (pixel % 50 / 25 + 2 * (pixel / 1000)) as f32)
        .collect();
    let plain = ATrous::new(5, f32::INFINITY, EdgeStop::default()).unwrap();
    let output = filter(&plain, &picture, &image, 1);
    assert_close(&output, image.iter().map(|&value| value.into()), 1e-5);
}

#[test]
fn wrong_parameters_are_errors() {
    for (levels, sigma) in [(0, 1.0), (11, 1.0), (1, 0.0), (1, -1.0), (1, f32::NAN)] {
        let error = ATrous::new(levels, sigma, EdgeStop::default()).unwrap_err();
        assert!(matches!(error, Error::Parameter { .. }), "{error}");
    }
}
