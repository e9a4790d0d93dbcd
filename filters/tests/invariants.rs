//! What holds of every filter, whatever the picture.

#![expect(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{Picture, noise, view};
use isophote_filters::{
    ATrous, DiscontinuityBuffer, EdgeStop, Gaussian, Guides, JointBilateral, Neighborhood,
    NormalWeight, SampleGrid, SinglePass, Thresholds,
};
use proptest::prelude::*;

/// Every filter on an image of one resolution; those that upsample take every `factor`-th pixel of it.
fn outputs(
    image: &[f32],
    channels: usize,
    picture: &Picture,
    factor: usize,
    edges: EdgeStop,
) -> Vec<Vec<f32>> {
    let (width, height) = (picture.width, picture.height);
    let guides: &Guides = &picture.guides();
    let full = view(image, width, height, channels);
    let grid = SampleGrid::new([width, height], factor).unwrap();
    let [columns, rows] = grid.size();
    let low = grid.gather(full).unwrap();
    let low = view(&low, columns, rows, channels);
    let output = |filter: &dyn Fn(&mut [f32])| {
        let mut output = vec![f32::NAN; image.len()];
        filter(&mut output);
        output
    };
    let around = Neighborhood::default();
    let gaussian = Gaussian::new(7, 1.5).unwrap();
    let discontinuity = DiscontinuityBuffer::new([3, 2], Thresholds::default()).unwrap();
    let a_trous = ATrous::new(3, 0.5, edges).unwrap();
    let bilateral = JointBilateral::new(factor, around, edges).unwrap();
    let single = SinglePass::new(factor, [2, 2], around, edges).unwrap();
    vec![
        output(&|output| gaussian.apply(full, output).unwrap()),
        output(&|output| gaussian.apply_guided(full, guides, &edges, output).unwrap()),
        output(&|output| discontinuity.apply(full, guides, output).unwrap()),
        output(&|output| a_trous.apply(full, guides, output).unwrap()),
        output(&|output| bilateral.apply(low, guides, output).unwrap()),
        output(&|output| single.apply(low, guides, output).unwrap()),
    ]
}

fn edge_stops() -> impl Strategy<Value = EdgeStop> {
    prop_oneof![
        Just(EdgeStop::COSINE),
        (0.02_f32..3.0, 0.001_f32..1.0).prop_map(|(angle, depth)| EdgeStop::new(
            NormalWeight::Angle(angle),
            depth
        )
        .unwrap()),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Every output is a weighted mean: it lies between the least and the greatest input, and a constant stays.
    #[test]
    fn outputs_are_means(
        width in 1_usize..45,
        height in 1_usize..30,
        channels in 1_usize..4,
        factor in 1_usize..7,
        seed in 1_u32..1000,
        scale in prop_oneof![Just(1.0_f32), Just(1e-20), Just(1e15)],
        edges in edge_stops(),
    ) {
        let picture = Picture::planes(width, height, seed);
        let image: Vec<f32> = noise(seed + 1, width * height * channels)
            .into_iter()
            .map(|value| scale * (0.5 + value))
            .collect();
        for (number, output) in outputs(&image, channels, &picture, factor, edges).iter().enumerate() {
            let wrong = output.iter().find(|value| !(0.499..1.501).contains(&(**value / scale)));
            prop_assert_eq!(wrong, None, "filter {}", number);
        }
        let constant = vec![0.7 * scale; image.len()];
        for (number, output) in outputs(&constant, channels, &picture, factor, edges).iter().enumerate() {
            let wrong = output.iter().find(|value| (**value / scale - 0.7).abs() > 1e-5);
            prop_assert_eq!(wrong, None, "filter {}", number);
        }
    }

    /// A planar picture, filtered plane by plane, is the interleaved one.
    #[test]
    fn channels_do_not_mix(
        width in 1_usize..45,
        height in 1_usize..30,
        factor in 1_usize..5,
        seed in 1_u32..1000,
        edges in edge_stops(),
    ) {
        let picture = Picture::planes(width, height, seed);
        let image = noise(seed + 1, width * height * 3);
        let together = outputs(&image, 3, &picture, factor, edges);
        for channel in 0..3 {
            let plane: Vec<f32> = image[channel..].iter().step_by(3).copied().collect();
            let alone = outputs(&plane, 1, &picture, factor, edges);
            for (number, (together, alone)) in together.iter().zip(&alone).enumerate() {
                // The à-trous wavelet (3) compares colours as a whole.
                for (together, alone) in together[channel..].iter().step_by(3).zip(alone) {
                    prop_assert!(number == 3 || (together - alone).abs() < 2e-6, "filter {number}");
                }
            }
        }
    }
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let picture = Picture::planes(150, 90, 5);
    let image = noise(2, 150 * 90 * 3);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| outputs(&image, 3, &picture, 4, EdgeStop::default()))
    };
    let one = with(1);
    for threads in [2, 3, 7] {
        assert!(with(threads) == one, "{threads} threads");
    }
}
