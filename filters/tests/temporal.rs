//! Temporal accumulation.

#![expect(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{Picture, assert_close, noise, view};
use isophote_filters::{
    Error, Guides, History, Pinhole, Temporal, TemporalParams, Thresholds, camera_motion,
};

const AXES: [[f32; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];

fn temporal(max_pictures: u32, clamp: f32) -> Temporal {
    Temporal::new(TemporalParams {
        max_pictures,
        clamp,
        ..TemporalParams::default()
    })
    .unwrap()
}

/// A picture's own places and depths: nothing moved.
fn still(picture: &Picture) -> Vec<f32> {
    let depths = view(&picture.depths, picture.width, picture.height, 1);
    camera_motion(depths, &picture.camera(), &picture.camera()).unwrap()
}

fn values(history: &History) -> &[f32] {
    history.values().unwrap().data()
}

fn lengths(history: &History) -> &[f32] {
    history.lengths().unwrap().data()
}

#[test]
fn a_still_picture_becomes_the_mean() {
    let picture = Picture::planes(40, 30, 6);
    let motion = still(&picture);
    let mut history = History::default();
    let mut mean = vec![0.0; 40 * 30 * 2];
    for number in 1..=6_u32 {
        let image = noise(number, mean.len());
        temporal(100, f32::INFINITY)
            .apply(
                view(&image, 40, 30, 2),
                picture.guides(),
                view(&motion, 40, 30, 3),
                &mut history,
            )
            .unwrap();
        for (mean, value) in mean.iter_mut().zip(&image) {
            *mean += (f64::from(*value) - *mean) / f64::from(number);
        }
        assert_close(values(&history), mean.iter().copied(), 2e-5);
        let expected = [f64::from(number); 40 * 30];
        assert_close(lengths(&history), expected, 1e-4);
    }
}

#[test]
fn then_an_exponential_mean() {
    let wall = Picture::wall(8, 6);
    let motion = still(&wall);
    let mut history = History::default();
    for value in [1.0, 0.0, 0.0, 0.0, 0.0] {
        temporal(2, f32::INFINITY)
            .apply(
                view(&[value; 48], 8, 6, 1),
                wall.guides(),
                view(&motion, 8, 6, 3),
                &mut history,
            )
            .unwrap();
    }
    assert_close(values(&history), [1.0 / 16.0; 48], 1e-6);
    assert_close(lengths(&history), [2.0; 48], 0.0);
}

/// A camera that moves before a wall by whole pixels: the history moves along, and what comes in is new.
#[test]
fn the_history_moves_with_the_camera() {
    let (width, height) = (40, 30);
    let wall = Picture::wall(width, height);
    // A pixel at depth 2.
    let pixel = 2.0 * 2.0 * (0.5 * wall.yfov).tan() / height as f32;
    let camera = |steps: f32| Pinhole::new([steps * pixel, 0.0, 0.0], AXES, wall.yfov).unwrap();
    let first = noise(1, width * height);
    let mut history = History::default();
    let accumulate = |image: &[f32], motion: &[f32], history: &mut History| {
        let (image, motion) = (
            view(image, width, height, 1),
            view(motion, width, height, 3),
        );
        temporal(10, f32::INFINITY)
            .apply(image, wall.guides(), motion, history)
            .unwrap();
    };
    accumulate(&first, &still(&wall), &mut history);
    let depths = view(&wall.depths, width, height, 1);
    let motion = camera_motion(depths, &camera(3.0), &camera(0.0)).unwrap();
    accumulate(&vec![0.0; first.len()], &motion, &mut history);
    for y in 0..height {
        for x in 0..width {
            let (value, length) = (
                values(&history)[y * width + x],
                lengths(&history)[y * width + x],
            );
            let known = x + 3 < width;
            let expected = if known {
                0.5 * first[y * width + x + 3]
            } else {
                0.0
            };
            assert!(
                (value - expected).abs() < 1e-4,
                "({x}, {y}): {value}, not {expected}"
            );
            let expected = if known { 2.0 } else { 1.0 };
            assert!((length - expected).abs() < 1e-3, "({x}, {y}): {length}");
        }
    }
}

/// Turning the camera about its own position moves surfaces and background alike.
#[test]
fn a_turned_camera_sees_the_same_directions() {
    let picture = Picture::planes(60, 40, 2);
    let (sin, cos) = 0.1_f32.sin_cos();
    let turned = [[cos, 0.0, sin], [0.0, 1.0, 0.0], [sin, 0.0, -cos]];
    let before = Pinhole::new([0.0; 3], turned, picture.yfov).unwrap();
    let depths = view(&picture.depths, 60, 40, 1);
    let motion = camera_motion(depths, &picture.camera(), &before).unwrap();
    let scale = 2.0 * (0.5 * picture.yfov).tan() / 40.0;
    for (pixel, moved) in motion.chunks_exact(3).enumerate() {
        let ray = picture.ray((pixel % 60) as f64, (pixel / 60) as f64);
        let [x, y] = [(moved[0] - 30.0) * scale, (20.0 - moved[1]) * scale];
        let again: [f32; 3] =
            std::array::from_fn(|axis| turned[2][axis] + x * turned[0][axis] + y * turned[1][axis]);
        let ratio = f64::from(again[2]) / ray[2];
        for axis in 0..3 {
            assert!(
                (f64::from(again[axis]) - ratio * ray[axis]).abs() < 1e-4,
                "{pixel}"
            );
        }
        let depth = picture.depths[pixel];
        assert_eq!(depth.is_finite(), moved[2] > 0.0, "{pixel}");
        if depth.is_finite() {
            // The same point at the depth of the turned camera.
            let expected = depth / ratio as f32;
            assert!(
                (moved[2] / expected - 1.0).abs() < 1e-4,
                "{} {expected}",
                moved[2]
            );
        }
    }
}

#[test]
fn what_shows_something_else_is_rejected() {
    let (width, height) = (20, 10);
    let before = Picture::of(width, height, |x, _| match x / 5 {
        0 => Some(([0.0, 0.0, 1.0], 2.0)),
        1 => Some(([1.0, 0.0, 0.2], 2.0)),
        2 => Some(([0.0, 0.0, 1.0], 3.0)),
        _ => None,
    });
    let wall = Picture::wall(width, height);
    let sky = Picture::of(width, height, |_, _| None);
    for (now, kept) in [(&wall, 0), (&sky, 3)] {
        let mut history = History::default();
        let temporal = temporal(10, f32::INFINITY);
        let (old, new) = (vec![1.0; 200], vec![0.0; 200]);
        let mut add = |image: &[f32], picture: &Picture| {
            let motion = still(picture);
            let motion = view(&motion, width, height, 3);
            let image = view(image, width, height, 1);
            temporal
                .apply(image, picture.guides(), motion, &mut history)
                .unwrap();
        };
        add(&old, &before);
        add(&new, now);
        let expected = (0..200).map(|pixel| if pixel % 20 / 5 == kept { 0.5 } else { 0.0 });
        assert_close(values(&history), expected, 1e-5);
    }
}

#[test]
fn the_clamp_drops_light_that_has_gone() {
    let wall = Picture::wall(8, 8);
    let motion = still(&wall);
    for (clamp, expected) in [(f32::INFINITY, 0.5), (1.0, 0.0)] {
        let mut history = History::default();
        for value in [1.0, 0.0] {
            let image = view(&[value; 64], 8, 8, 1).data().to_vec();
            temporal(10, clamp)
                .apply(
                    view(&image, 8, 8, 1),
                    wall.guides(),
                    view(&motion, 8, 8, 3),
                    &mut history,
                )
                .unwrap();
        }
        assert_close(values(&history), [expected; 64], 1e-6);
    }
}

#[test]
fn strange_motion_does_no_harm_and_another_size_starts_anew() {
    let strange = [f32::NAN, f32::INFINITY, -1e30, 1e30, 0.0, -0.4, 7.9, 3.0];
    let wall = Picture::wall(8, 8);
    let motion: Vec<f32> = noise(3, 192)
        .into_iter()
        .map(|pick| strange[(pick * 8.0) as usize])
        .collect();
    let mut history = History::default();
    for number in 0..3 {
        let image = noise(number + 1, 64);
        temporal(10, 1.0)
            .apply(
                view(&image, 8, 8, 1),
                wall.guides(),
                view(&motion, 8, 8, 3),
                &mut history,
            )
            .unwrap();
        assert!(
            values(&history)
                .iter()
                .all(|value| (0.0..=1.0).contains(value))
        );
        assert!(
            lengths(&history)
                .iter()
                .all(|length| (1.0..=10.0).contains(length))
        );
    }
    let other = Picture::wall(4, 4);
    temporal(10, 1.0)
        .apply(
            view(&[0.25; 16], 4, 4, 1),
            other.guides(),
            view(&still(&other), 4, 4, 3),
            &mut history,
        )
        .unwrap();
    assert_eq!(values(&history), [0.25; 16]);
    assert_eq!(lengths(&history), [1.0; 16]);
}

#[test]
fn wrong_parameters_and_sizes_are_errors() {
    let params = TemporalParams::default();
    let thresholds = Thresholds {
        angle: -1.0,
        depth: 0.1,
    };
    for params in [
        TemporalParams {
            max_pictures: 0,
            ..params
        },
        TemporalParams {
            max_pictures: 65_537,
            ..params
        },
        TemporalParams {
            clamp: 0.0,
            ..params
        },
        TemporalParams {
            clamp: f32::NAN,
            ..params
        },
        TemporalParams {
            thresholds,
            ..params
        },
    ] {
        let error = Temporal::new(params).unwrap_err();
        assert!(matches!(error, Error::Parameter { .. }), "{error}");
    }
    for (position, yfov) in [
        ([f32::NAN, 0.0, 0.0], 1.0),
        ([0.0; 3], 0.0),
        ([0.0; 3], 4.0),
    ] {
        let error = Pinhole::new(position, AXES, yfov).unwrap_err();
        assert!(matches!(error, Error::Parameter { .. }), "{error}");
    }
    let skewed = [AXES[0], AXES[0], AXES[2]];
    assert!(Pinhole::new([0.0; 3], skewed, 1.0).is_err());
    let wall = Picture::wall(8, 6);
    let guides = |picture: &Picture| -> Guides { picture.guides() };
    let error = temporal(2, 1.0)
        .apply(
            view(&[0.0; 48], 8, 6, 1),
            guides(&Picture::wall(6, 8)),
            view(&still(&wall), 8, 6, 3),
            &mut History::default(),
        )
        .unwrap_err();
    assert!(matches!(error, Error::Size { .. }), "{error}");
}
