//! The Gaussian: analytic cases, and brute force.

#![expect(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{Picture, assert_close, noise, view, window};
use isophote_filters::{EdgeStop, Error, Gaussian, NormalWeight};

fn blur(gaussian: &Gaussian, image: &[f32], [width, height, channels]: [usize; 3]) -> Vec<f32> {
    let mut output = vec![f32::NAN; image.len()];
    gaussian
        .apply(view(image, width, height, channels), &mut output)
        .unwrap();
    output
}

fn kernel(width: usize, sigma: f64) -> Vec<f64> {
    let radius = (width / 2) as f64;
    let weights: Vec<_> = (0..width)
        .map(|k| (-0.5 * ((k as f64 - radius) / sigma).powi(2)).exp())
        .collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

#[test]
fn a_constant_stays_up_to_the_borders() {
    for size in [[40, 30, 3], [1, 1, 1], [3, 50, 2], [70, 2, 1], [17, 17, 5]] {
        for width in [1, 3, 11, 101] {
            let image = vec![0.7; size.iter().product()];
            let output = blur(&Gaussian::new(width, 2.5).unwrap(), &image, size);
            assert_close(&output, image.iter().map(|&value| value.into()), 1e-6);
        }
    }
}

#[test]
fn the_impulse_response_is_the_kernel_and_keeps_the_energy() {
    let size = [33, 29, 2];
    let mut image = vec![0.0; size.iter().product()];
    let (x, y) = (16, 14);
    image[(y * 33 + x) * 2 + 1] = 1.0;
    let output = blur(&Gaussian::default(), &image, size);
    let weights = kernel(11, 2.0);
    let at = |k: usize, center: usize| weights.get((k + 5).wrapping_sub(center)).copied();
    let expected = (0..29).flat_map(|row| {
        let weight = move |column| Some(at(column, x)? * at(row, y)?);
        (0..33).flat_map(move |column| [0.0, weight(column).unwrap_or(0.0)])
    });
    assert_close(&output, expected, 1e-8);
    let energy: f64 = output.iter().map(|&value| f64::from(value)).sum();
    assert!((energy - 1.0).abs() < 1e-6, "{energy}");
}

#[test]
fn two_passes_are_the_blur_in_two_dimensions() {
    for (size, width) in [
        ([50, 21, 3], 11),
        ([21, 40, 1], 5),
        ([9, 6, 4], 21),
        ([64, 5, 1], 3),
        ([130, 23, 1], 7),
    ] {
        let [columns, rows, channels] = size;
        let image = noise(7, size.iter().product());
        let output = blur(&Gaussian::new(width, 1.7).unwrap(), &image, size);
        let weights = kernel(width, 1.7);
        let radius = (width / 2) as isize;
        let offsets = window(-radius..=radius, -radius..=radius);
        let wall = Picture::wall(columns, rows);
        let expected = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y]));
        let expected = expected.flat_map(|p| {
            wall.weighted_mean(&image, channels, p, &offsets, |_, [dx, dy]| {
                weights[(dx + radius) as usize] * weights[(dy + radius) as usize]
            })
        });
        assert_close(&output, expected, 2e-6);
    }
}

#[test]
fn guided_passes_are_the_weighted_sums() {
    let picture = Picture::planes(45, 37, 3);
    let image = noise(11, 45 * 37 * 2);
    let gaussian = Gaussian::new(9, 2.0).unwrap();
    let edges = EdgeStop::new(NormalWeight::Angle(0.3), 0.05).unwrap();
    let mut output = vec![f32::NAN; image.len()];
    let guides = picture.guides();
    gaussian
        .apply_guided(view(&image, 45, 37, 2), &guides, &edges, &mut output)
        .unwrap();
    let weights = kernel(9, 2.0);
    let pass = |image: &[f32], offsets: &[[isize; 2]]| -> Vec<f64> {
        let pixels = (0..37).flat_map(|y| (0..45).map(move |x| [x, y]));
        pixels
            .flat_map(|p| {
                picture.weighted_mean(image, 2, p, offsets, |q, [dx, dy]| {
                    weights[(dx + dy + 4) as usize] * picture.weight(p, q, Some(0.3), 0.05)
                })
            })
            .collect()
    };
    let half = pass(&image, &window(0..=0, -4..=4));
    let half: Vec<_> = half.into_iter().map(|value| value as f32).collect();
    assert_close(&output, pass(&half, &window(-4..=4, 0..=0)), 2e-5);
}

#[test]
fn no_light_crosses_an_edge() {
    // Left a wall, right another in front of it; then a corner; then the background.
    let front = ([0.0, 0.0, 1.0], 1.0);
    let turned = ([1.0, 0.0, 0.05], 2.0);
    for right in [Some(front), Some(turned), None] {
        let left = Some(([0.0, 0.0, 1.0], 2.0));
        let picture = Picture::of(40, 20, |x, _| if x < 20 { left } else { right });
        let image: Vec<_> = (0..40 * 20)
            .map(|pixel| if pixel % 40 < 20 { 1.0 } else { 5.0 })
            .collect();
        let mut output = vec![f32::NAN; image.len()];
        Gaussian::default()
            .apply_guided(
                view(&image, 40, 20, 1),
                &picture.guides(),
                &EdgeStop::default(),
                &mut output,
            )
            .unwrap();
        assert_close(&output, image.iter().map(|&value| value.into()), 1e-5);
    }
}

#[test]
fn on_one_surface_edges_do_not_matter() {
    // A floor seen at a grazing angle: depths differ by the factor 10 from row to row.
    let floor = Picture::of(30, 30, |_, y| {
        let down = (y as f32 + 0.5 - 15.0) * 2.0 * 0.5_f32.tan() / 30.0;
        Some(([0.0, 1.0, 0.0], 1.0 / down)).filter(|_| y >= 16)
    });
    let image = noise(5, 900);
    let mut output = vec![f32::NAN; 900];
    let edges = EdgeStop::new(NormalWeight::Angle(0.1), 0.001).unwrap();
    let gaussian = Gaussian::new(7, 1.5).unwrap();
    gaussian
        .apply_guided(
            view(&image, 30, 30, 1),
            &floor.guides(),
            &edges,
            &mut output,
        )
        .unwrap();
    // FLATTEST keeps the topmost rows from being taken as they are: look below.
    let cropped = blur(&gaussian, &image[16 * 30..], [30, 14, 1]);
    let rows = |rows: std::ops::Range<usize>| rows.start * 30..rows.end * 30;
    assert_close(
        &output[rows(24..30)],
        cropped[rows(8..14)].iter().map(|&value| value.into()),
        2e-3,
    );
}

#[test]
fn wrong_parameters_and_sizes_are_errors() {
    for (width, sigma) in [
        (0, 1.0),
        (4, 1.0),
        (1025, 1.0),
        (5, 0.0),
        (5, f32::NAN),
        (5, 1e9),
    ] {
        let error = Gaussian::new(width, sigma).unwrap_err();
        assert!(matches!(error, Error::Parameter { .. }), "{error}");
    }
    let error = Gaussian::default()
        .apply(view(&[0.0; 12], 4, 3, 1), &mut [0.0; 11])
        .unwrap_err();
    assert!(matches!(error, Error::Length { found: 11, .. }), "{error}");
}
