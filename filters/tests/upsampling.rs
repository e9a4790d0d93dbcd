//! Joint bilateral upsampling, the discontinuity buffer, and both in one pass.

#![expect(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{Picture, assert_close, noise, view, window};
use isophote_filters::{
    DiscontinuityBuffer, EdgeStop, Error, Gaussian, JointBilateral, Neighborhood, NormalWeight,
    SampleGrid, SinglePass, Thresholds,
};

const ROUND: Neighborhood = Neighborhood {
    radius: 2,
    sigma: 0.7,
    reach: 4,
};

fn edges() -> EdgeStop {
    EdgeStop::new(NormalWeight::Angle(0.4), 0.1).unwrap()
}

/// A sample around a pixel.
struct Sample {
    /// Its place in the tiles of interleaved sampling, but for a shift.
    group: [isize; 2],
    is_near: bool,
    pixel: [usize; 2],
    index: usize,
}

fn samples(
    picture: &Picture,
    [x, y]: [usize; 2],
    factor: usize,
    around: Neighborhood,
    tile: [usize; 2],
) -> Vec<Sample> {
    let full = [picture.width, picture.height];
    let grid = SampleGrid::new(full, factor).unwrap();
    let [columns, rows] = grid.size();
    let offset = grid.pixel([0, 0]);
    let near = [
        (x as isize - offset[0] as isize).div_euclid(factor as isize),
        (y as isize - offset[1] as isize).div_euclid(factor as isize),
    ];
    let [m, n] = tile.map(|side| side as isize);
    let window = |radius: usize, side: isize| 1 - radius as isize * side..=radius as isize * side;
    let all = common::window(window(around.reach, m), window(around.reach, n));
    let exists = |&[a, b]: &[isize; 2]| {
        (0..columns as isize).contains(&(near[0] + a))
            && (0..rows as isize).contains(&(near[1] + b))
    };
    let sample = |[a, b]: [isize; 2]| {
        let [i, j] = [(near[0] + a) as usize, (near[1] + b) as usize];
        Sample {
            group: [a.rem_euclid(m), b.rem_euclid(n)],
            is_near: window(around.radius, m).contains(&a) && window(around.radius, n).contains(&b),
            pixel: grid.pixel([i, j]),
            index: j * columns + i,
        }
    };
    all.into_iter().filter(exists).map(sample).collect()
}

/// The formulas of [`SinglePass`], of which joint bilateral upsampling is the case of one group.
fn oracle(
    picture: &Picture,
    values: &[f32],
    factor: usize,
    tile: [usize; 2],
    angle: Option<f64>,
    depth: f64,
) -> Vec<f64> {
    let mut output = Vec::new();
    for y in 0..picture.height {
        for x in 0..picture.width {
            let around = samples(picture, [x, y], factor, ROUND, tile);
            let log_edge = |sample: &Sample| picture.log_weight([x, y], sample.pixel, angle, depth);
            let best = |samples: &mut dyn Iterator<Item = &Sample>| {
                samples.map(log_edge).fold(f64::NEG_INFINITY, f64::max)
            };
            // The cosine of Eq. (2) is no part of the exponent that far samples depend on.
            let exponent = |sample: &Sample| {
                let likeness = picture.likeness([x, y], sample.pixel);
                match (angle, likeness) {
                    (None, Some((cosine, distance))) if cosine > 0.0 => -distance / depth,
                    (None, _) => f64::NEG_INFINITY,
                    _ => log_edge(sample),
                }
            };
            let near = around.iter().filter(|sample| sample.is_near);
            let alike = near.map(exponent).fold(f64::NEG_INFINITY, f64::max);
            let far = ((-1.0 - alike) / 3.0).clamp(0.0, 1.0);
            let counting = || around.iter().filter(|sample| sample.is_near || far > 0.0);
            let best = best(&mut counting());
            let edge = |sample: &Sample| {
                let share = if sample.is_near { 1.0 } else { far };
                match best {
                    f64::NEG_INFINITY => f64::from(u8::from(sample.is_near)),
                    _ => share * (log_edge(sample) - best).exp(),
                }
            };
            let spatial = |sample: &Sample| {
                let sigma = match sample.is_near {
                    true => f64::from(ROUND.sigma),
                    false => 0.5 * ROUND.reach as f64,
                };
                let [u, v] = sample.pixel;
                let distance = (u as f64 - x as f64) / (sigma * (tile[0] * factor) as f64);
                let height = (v as f64 - y as f64) / (sigma * (tile[1] * factor) as f64);
                (-0.5 * (distance * distance + height * height)).exp()
            };
            let (mut sum, mut norm) = (0.0, 0.0);
            for group in window(0..tile[0] as isize, 0..tile[1] as isize) {
                let (mut values_sum, mut weights, mut best) = (0.0, 0.0, 0.0_f64);
                for sample in counting().filter(|sample| sample.group == group) {
                    let weight = spatial(sample) * edge(sample);
                    values_sum += weight * f64::from(values[sample.index]);
                    weights += weight;
                    best = best.max(edge(sample));
                }
                if weights > 0.0 {
                    sum += best * values_sum / weights;
                    norm += best;
                }
            }
            output.push(sum / norm);
        }
    }
    output
}

#[test]
fn joint_bilateral_upsampling_is_its_formula() {
    for (size, factor) in [
        ([61, 40], 4),
        ([20, 33], 3),
        ([40, 17], 2),
        ([7, 5], 16),
        ([90, 9], 5),
    ] {
        let picture = Picture::planes(size[0], size[1], 5);
        let [columns, rows] = SampleGrid::new(size, factor).unwrap().size();
        let values = noise(3, columns * rows);
        for (edges, angle, depth) in [
            (edges(), Some(f64::from(0.4_f32)), f64::from(0.1_f32)),
            (EdgeStop::COSINE, None, f64::INFINITY),
        ] {
            let mut output = vec![f32::NAN; size[0] * size[1]];
            JointBilateral::new(factor, ROUND, edges)
                .unwrap()
                .apply(
                    view(&values, columns, rows, 1),
                    &picture.guides(),
                    &mut output,
                )
                .unwrap();
            let expected = oracle(&picture, &values, factor, [1, 1], angle, depth);
            assert_close(&output, expected, 5e-5);
        }
    }
}

#[test]
fn the_single_pass_is_its_formula() {
    for (factor, tile) in [(1, [3, 3]), (2, [2, 3]), (4, [3, 3]), (3, [1, 2])] {
        let size = [50, 38];
        let picture = Picture::planes(size[0], size[1], 8);
        let [columns, rows] = SampleGrid::new(size, factor).unwrap().size();
        let values = noise(4, columns * rows);
        let mut output = vec![f32::NAN; size[0] * size[1]];
        SinglePass::new(factor, tile, ROUND, edges())
            .unwrap()
            .apply(
                view(&values, columns, rows, 1),
                &picture.guides(),
                &mut output,
            )
            .unwrap();
        let expected = oracle(&picture, &values, factor, tile, Some(0.4), 0.1);
        assert_close(&output, expected, 5e-5);
    }
}

#[test]
fn a_single_pass_without_tiles_is_joint_bilateral_upsampling() {
    let picture = Picture::planes(64, 48, 1);
    let guides = picture.guides();
    let values = noise(9, 16 * 12 * 3);
    let low = view(&values, 16, 12, 3);
    let (mut one, mut other) = (vec![0.0; 64 * 48 * 3], vec![1.0; 64 * 48 * 3]);
    let upsampling = JointBilateral::new(4, ROUND, edges()).unwrap();
    upsampling.apply(low, &guides, &mut one).unwrap();
    let single = SinglePass::new(4, [1, 1], ROUND, edges()).unwrap();
    single.apply(low, &guides, &mut other).unwrap();
    assert_eq!(one, other);
}

#[test]
fn factor_one_is_the_identity() {
    let image = noise(2, 30 * 20 * 2);
    let mut output = vec![f32::NAN; image.len()];
    JointBilateral::new(1, ROUND, edges())
        .unwrap()
        .apply(
            view(&image, 30, 20, 2),
            &Picture::planes(30, 20, 1).guides(),
            &mut output,
        )
        .unwrap();
    assert_eq!(output, image);
}

/// What has one value per surface is upsampled exactly wherever each surface has a sample nearby.
#[test]
fn flat_surfaces_come_back() {
    let value = |picture: &Picture, pixel: usize| {
        let normal = &picture.normals[3 * pixel..][..3];
        if picture.depths[pixel].is_finite() {
            1.0 + normal[0] + 2.0 * normal[1]
        } else {
            0.3
        }
    };
    let picture = Picture::planes(80, 60, 21);
    let image: Vec<f32> = (0..80 * 60).map(|pixel| value(&picture, pixel)).collect();
    let grid = SampleGrid::new([80, 60], 4).unwrap();
    let low = grid.gather(view(&image, 80, 60, 1)).unwrap();
    let mut output = vec![f32::NAN; image.len()];
    JointBilateral::new(4, Neighborhood::default(), EdgeStop::default())
        .unwrap()
        .apply(view(&low, 20, 15, 1), &picture.guides(), &mut output)
        .unwrap();
    for y in 0..60 {
        for x in 0..80 {
            let around = samples(&picture, [x, y], 4, Neighborhood::default(), [1, 1]);
            let expected = image[y * 80 + x];
            if around.iter().any(|sample| low[sample.index] == expected) {
                let found = output[y * 80 + x];
                assert!(
                    (found - expected).abs() < 1e-3,
                    "({x}, {y}): {found}, not {expected}"
                );
            }
        }
    }
}

#[test]
fn the_discontinuity_buffer_is_its_formula() {
    for tile in [[3, 3], [2, 2], [4, 1], [1, 5], [1, 1]] {
        let picture = Picture::planes(43, 31, 13);
        let image = noise(6, 43 * 31 * 3);
        let thresholds = Thresholds {
            angle: 0.2,
            depth: 0.07,
        };
        let mut output = vec![f32::NAN; image.len()];
        DiscontinuityBuffer::new(tile, thresholds)
            .unwrap()
            .apply(view(&image, 43, 31, 3), &picture.guides(), &mut output)
            .unwrap();
        let [columns, rows] = tile.map(|side| {
            let first = -((side / 2) as isize);
            first..first + side as isize
        });
        let offsets = window(columns, rows);
        let pixels = (0..31).flat_map(|y| (0..43).map(move |x| [x, y]));
        let expected = pixels.flat_map(|p| {
            picture.weighted_mean(&image, 3, p, &offsets, |q, _| {
                let holds = picture
                    .likeness(p, q)
                    .is_some_and(|(cosine, distance)| cosine > 0.2_f64.cos() && distance < 0.07);
                f64::from(u8::from(holds))
            })
        });
        assert_close(&output, expected, 1e-5);
    }
}

/// Interleaved sampling: each pixel of a tile has a part of the light, and their mean is all of it.
#[test]
fn interleaved_parts_are_joined() {
    for tile in [[3, 3], [2, 2], [2, 3]] {
        let parts = noise(17, tile[0] * tile[1]);
        let mean = parts.iter().sum::<f32>() / parts.len() as f32;
        let image: Vec<f32> = (0..48 * 36)
            .map(|pixel| parts[(pixel / 48 % tile[1]) * tile[0] + pixel % 48 % tile[0]])
            .collect();
        let guides = Picture::wall(48, 36).guides();
        let mut output = vec![f32::NAN; image.len()];
        let input = view(&image, 48, 36, 1);
        DiscontinuityBuffer::new(tile, Thresholds::default())
            .unwrap()
            .apply(input, &guides, &mut output)
            .unwrap();
        for y in 3..33 {
            assert_close(
                &output[y * 48 + 3..y * 48 + 45],
                [f64::from(mean); 42],
                1e-6,
            );
        }
        // In a single pass there are no borders where a part is missing.
        SinglePass::new(1, tile, ROUND, EdgeStop::default())
            .unwrap()
            .apply(input, &guides, &mut output)
            .unwrap();
        assert_close(&output, [f64::from(mean); 48 * 36], 1e-6);
        // At a coarse resolution the two filters one after the other do the same where all parts are seen.
        let guides = Picture::wall(192, 144).guides();
        let mut output = vec![f32::NAN; 192 * 144];
        SinglePass::new(4, tile, ROUND, EdgeStop::default())
            .unwrap()
            .apply(input, &guides, &mut output)
            .unwrap();
        assert_close(&output, [f64::from(mean); 192 * 144], 1e-6);
    }
}

/// The artefact of MS10 §5.2: at an edge the pattern of the tiles shows when the filters run one after the other.
#[test]
fn the_single_pass_leaves_less_pattern_at_edges() {
    let (width, height, tile) = (96, 72, [3, 3]);
    // A strip of wall six samples wide stands before another wall.
    let in_front = |x: usize| (36..60).contains(&x);
    let picture = Picture::of(width, height, |x, _| {
        Some(([0.0, 0.0, 1.0], if in_front(x) { 1.0 } else { 2.0 }))
    });
    let parts = noise(23, 9);
    let mean = parts.iter().sum::<f32>() / 9.0;
    let low: Vec<f32> = (0..24 * 18)
        .map(|sample| parts[(sample / 24 % 3) * 3 + sample % 24 % 3])
        .collect();
    let guides = picture.guides();
    let samples = view(&low, 24, 18, 1);
    let mut single = vec![0.0; width * height];
    SinglePass::new(4, tile, ROUND, EdgeStop::default())
        .unwrap()
        .apply(samples, &guides, &mut single)
        .unwrap();
    // The two in a row, the first at the low resolution.
    let coarse = Picture::of(24, 18, |x, _| {
        Some(([0.0, 0.0, 1.0], if in_front(4 * x + 2) { 1.0 } else { 2.0 }))
    });
    let mut joined = vec![0.0; low.len()];
    DiscontinuityBuffer::new(tile, Thresholds::default())
        .unwrap()
        .apply(samples, &coarse.guides(), &mut joined)
        .unwrap();
    let mut row = vec![0.0; width * height];
    JointBilateral::new(4, ROUND, EdgeStop::default())
        .unwrap()
        .apply(view(&joined, 24, 18, 1), &guides, &mut row)
        .unwrap();
    let error = |image: &[f32]| {
        let squares: f32 = image.iter().map(|value| (value - mean).powi(2)).sum();
        (squares / image.len() as f32).sqrt()
    };
    assert!(error(&row) > 0.005, "{}", error(&row));
    assert!(
        error(&single) < 0.02 * error(&row),
        "{} {}",
        error(&single),
        error(&row)
    );
}

/// Whatever the guides are, the result lies between the least and the greatest value, and is a number.
#[test]
fn strange_guides_do_no_harm() {
    let strange = [
        0.0,
        -1.0,
        f32::NAN,
        f32::INFINITY,
        1e-38,
        1e38,
        1e-30,
        1.0,
        -0.0,
        3.0,
    ];
    let picks = noise(31, 40 * 30 * 4);
    let mut picture = Picture::wall(40, 30);
    let pick = |number: f32| strange[(number * 10.0) as usize];
    for pixel in 0..1200 {
        picture.depths[pixel] = pick(picks[4 * pixel]);
        for axis in 0..3 {
            picture.normals[3 * pixel + axis] = pick(picks[4 * pixel + axis + 1]);
        }
    }
    let guides = picture.guides();
    let image = noise(1, 1200);
    let check = |output: &[f32]| {
        let wrong = output
            .iter()
            .find(|value| !(-1e-6..1.000_001).contains(*value));
        assert_eq!(wrong, None);
    };
    for edges in [EdgeStop::COSINE, EdgeStop::default(), edges()] {
        let mut output = vec![f32::NAN; 1200];
        for factor in [1, 2, 4, 7, 64] {
            let [columns, rows] = SampleGrid::new([40, 30], factor).unwrap().size();
            let samples = view(&image[..columns * rows], columns, rows, 1);
            JointBilateral::new(factor, ROUND, edges)
                .unwrap()
                .apply(samples, &guides, &mut output)
                .unwrap();
            check(&output);
            SinglePass::new(factor, [2, 3], ROUND, edges)
                .unwrap()
                .apply(samples, &guides, &mut output)
                .unwrap();
            check(&output);
        }
        Gaussian::default()
            .apply_guided(view(&image, 40, 30, 1), &guides, &edges, &mut output)
            .unwrap();
        check(&output);
    }
    let mut output = vec![f32::NAN; 1200];
    DiscontinuityBuffer::new([3, 3], Thresholds::default())
        .unwrap()
        .apply(view(&image, 40, 30, 1), &guides, &mut output)
        .unwrap();
    check(&output);
}

#[test]
fn wrong_parameters_and_sizes_are_errors() {
    let parameter = |result: Result<(), Error>| {
        let error = result.unwrap_err();
        assert!(matches!(error, Error::Parameter { .. }), "{error}");
    };
    parameter(JointBilateral::new(0, ROUND, edges()).map(drop));
    parameter(JointBilateral::new(65, ROUND, edges()).map(drop));
    for (radius, sigma, reach) in [
        (0, 1.0, 4),
        (5, 1.0, 6),
        (1, 0.1, 2),
        (1, f32::NAN, 2),
        (3, 1.0, 2),
        (3, 1.0, 9),
    ] {
        let around = Neighborhood {
            radius,
            sigma,
            reach,
        };
        parameter(JointBilateral::new(2, around, edges()).map(drop));
    }
    parameter(SinglePass::new(4, [0, 3], ROUND, edges()).map(drop));
    parameter(SinglePass::new(4, [3, 33], ROUND, edges()).map(drop));
    parameter(EdgeStop::new(NormalWeight::Angle(0.0), 1.0).map(drop));
    parameter(EdgeStop::new(NormalWeight::Angle(f32::NAN), 1.0).map(drop));
    parameter(EdgeStop::new(NormalWeight::Cosine, 0.0).map(drop));
    for (angle, depth) in [(-1.0, 1.0), (4.0, 1.0), (1.0, -1.0), (1.0, f32::NAN)] {
        let thresholds = Thresholds { angle, depth };
        parameter(DiscontinuityBuffer::new([3, 3], thresholds).map(drop));
    }
    parameter(SampleGrid::new([0, 3], 4).map(drop));
    let guides = Picture::wall(40, 30).guides();
    let upsampling = JointBilateral::new(4, ROUND, edges()).unwrap();
    let error = upsampling
        .apply(view(&[0.0; 80], 10, 8, 1), &guides, &mut [0.0; 1200])
        .unwrap_err();
    assert!(
        matches!(
            error,
            Error::Size {
                expected: [10, 7, 1],
                ..
            }
        ),
        "{error}"
    );
}
