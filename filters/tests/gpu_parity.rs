//! The filters on textures against those on slices: within 10⁻⁴ of the values' range.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{Picture, noise, textures, view};
use isophote_filters::{
    ATrous, DiscontinuityBuffer, EdgeStop, Error, Gaussian, History, ImageView, JointBilateral,
    Neighborhood, NormalWeight, Pinhole, SampleGrid, SinglePass, Temporal, TemporalParams,
    Thresholds, camera_motion, gpu,
};
use isophote_scene::gpu::Context;
use wgpu::{CommandEncoder, TextureView};

const TOLERANCE: f32 = 1e-4;

/// A device, and a picture's guides on it.
struct Lab {
    context: Context,
    picture: Picture,
    guides: gpu::Guides,
}

impl Lab {
    fn new(picture: Picture) -> Option<Self> {
        let context = Context::for_tests()?;
        let size = [picture.width as u32, picture.height as u32];
        let guides = gpu::Guides::new(&context, size, &picture.camera()).unwrap();
        let lab = Self {
            context,
            picture,
            guides,
        };
        let [normals, depths] = lab.inputs();
        lab.submit(|encoder| {
            lab.guides
                .record(&lab.context, encoder, &normals, &depths)
                .unwrap();
        });
        Some(lab)
    }

    fn size(&self) -> [u32; 2] {
        self.guides.size()
    }

    /// Normals and depths as textures. Infinity becomes 0, which is no surface either.
    fn inputs(&self) -> [TextureView; 2] {
        let normals = self.picture.normals.chunks_exact(3);
        let normals: Vec<f32> = normals.flat_map(|n| [n[0], n[1], n[2], 0.0]).collect();
        let depths = self.picture.depths.iter();
        let depths: Vec<f32> = depths
            .map(|&z| if z.is_finite() { z } else { 0.0 })
            .collect();
        let depths: Vec<f32> = depths
            .into_iter()
            .flat_map(|z| [z, 0.0, 0.0, 0.0])
            .collect();
        [
            self.upload(&normals, self.size()),
            self.upload(&depths, self.size()),
        ]
    }

    fn upload(&self, values: &[f32], size: [u32; 2]) -> TextureView {
        textures::upload(&self.context, values, size)
    }

    fn submit(&self, record: impl FnOnce(&mut CommandEncoder)) {
        textures::submit(&self.context, record);
    }

    fn download(&self, view: &TextureView, channels: u32) -> Vec<f32> {
        textures::download(&self.context, view, channels)
    }

    /// What a filter makes of a picture of four channels.
    fn run(
        &self,
        image: &[f32],
        size: [u32; 2],
        record: impl FnOnce(&mut CommandEncoder, &TextureView, &TextureView),
    ) -> Vec<f32> {
        let image = self.upload(image, size);
        // A value that survives was never written.
        let output = self.upload(&vec![-77.0; self.picture.depths.len() * 4], self.size());
        self.submit(|encoder| record(encoder, &image, &output));
        self.download(&output, 4)
    }

    fn image(&self, seed: u32) -> Vec<f32> {
        noise(seed, self.picture.depths.len() * 4)
    }

    fn view<'a>(&self, image: &'a [f32]) -> ImageView<'a> {
        view(image, self.picture.width, self.picture.height, 4)
    }
}

fn assert_same(found: &[f32], expected: &[f32], what: &str) {
    assert_eq!(found.len(), expected.len());
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (found - expected).abs();
        assert!(
            error <= TOLERANCE,
            "{what}, number {index}: {found}, but {expected} on the processor"
        );
    }
}

fn edge_stops() -> [EdgeStop; 3] {
    [
        EdgeStop::default(),
        EdgeStop::COSINE,
        EdgeStop::new(NormalWeight::Angle(0.5), 0.1).unwrap(),
    ]
}

#[test]
fn gaussian() {
    let Some(lab) = Lab::new(Picture::planes(83, 57, 5)) else {
        return;
    };
    let image = lab.image(1);
    let filter = Gaussian::new(11, 2.0).unwrap();
    let mut expected = vec![0.0; image.len()];
    filter.apply(lab.view(&image), &mut expected).unwrap();
    let format = gpu::Format::Single;
    let twin = gpu::Gaussian::new(&lab.context, &filter, None, lab.size(), format).unwrap();
    let found = lab.run(&image, lab.size(), |encoder, image, output| {
        twin.record(&lab.context, encoder, image, None, output)
            .unwrap();
    });
    assert_same(&found, &expected, "plain");
    let guides = lab.picture.guides();
    for edges in edge_stops() {
        filter
            .apply_guided(lab.view(&image), &guides, &edges, &mut expected)
            .unwrap();
        let twin = gpu::Gaussian::new(&lab.context, &filter, Some(edges), lab.size(), format);
        let twin = twin.unwrap();
        let found = lab.run(&image, lab.size(), |encoder, image, output| {
            let guides = Some(&lab.guides);
            twin.record(&lab.context, encoder, image, guides, output)
                .unwrap();
        });
        assert_same(&found, &expected, &format!("{edges:?}"));
    }
}

#[test]
fn upsampling() {
    let Some(lab) = Lab::new(Picture::planes(83, 57, 6)) else {
        return;
    };
    let guides = lab.picture.guides();
    let mut expected = lab.image(1);
    for (factor, tile) in [
        (1, [1, 1]),
        (4, [1, 1]),
        (3, [1, 1]),
        (1, [2, 2]),
        (4, [3, 3]),
    ] {
        for edges in edge_stops() {
            let grid = SampleGrid::new([83, 57], factor).unwrap();
            let [columns, rows] = grid.size();
            let values = noise(3, 4 * columns * rows);
            let samples = view(&values, columns, rows, 4);
            let around = Neighborhood {
                radius: 2,
                sigma: 0.7,
                reach: 3,
            };
            let coarse = [columns as u32, rows as u32];
            let (context, format) = (&lab.context, gpu::Format::Single);
            let found = if tile == [1, 1] {
                let filter = JointBilateral::new(factor, around, edges).unwrap();
                filter.apply(samples, &guides, &mut expected).unwrap();
                let twin = gpu::JointBilateral::new(context, &filter, format).unwrap();
                lab.run(&values, coarse, |encoder, samples, output| {
                    twin.record(context, encoder, samples, &lab.guides, output)
                        .unwrap();
                })
            } else {
                let filter = SinglePass::new(factor, tile, around, edges).unwrap();
                filter.apply(samples, &guides, &mut expected).unwrap();
                let twin = gpu::SinglePass::new(context, &filter, format).unwrap();
                lab.run(&values, coarse, |encoder, samples, output| {
                    twin.record(context, encoder, samples, &lab.guides, output)
                        .unwrap();
                })
            };
            assert_same(&found, &expected, &format!("{factor}, {tile:?}, {edges:?}"));
        }
    }
}

#[test]
fn discontinuity_buffer() {
    let Some(lab) = Lab::new(Picture::planes(83, 57, 7)) else {
        return;
    };
    let image = lab.image(2);
    let guides = lab.picture.guides();
    let mut expected = vec![0.0; image.len()];
    for tile in [[3, 3], [2, 4]] {
        let filter = DiscontinuityBuffer::new(tile, Thresholds::default()).unwrap();
        filter
            .apply(lab.view(&image), &guides, &mut expected)
            .unwrap();
        let format = gpu::Format::Single;
        let twin = gpu::DiscontinuityBuffer::new(&lab.context, &filter, format).unwrap();
        let found = lab.run(&image, lab.size(), |encoder, image, output| {
            twin.record(&lab.context, encoder, image, &lab.guides, output)
                .unwrap();
        });
        assert_same(&found, &expected, &format!("{tile:?}"));
    }
}

#[test]
fn a_trous() {
    let Some(lab) = Lab::new(Picture::planes(83, 57, 8)) else {
        return;
    };
    let image = lab.image(3);
    let guides = lab.picture.guides();
    let mut expected = vec![0.0; image.len()];
    for (levels, sigma) in [(1, 0.5), (4, 0.8), (5, f32::INFINITY)] {
        for edges in edge_stops() {
            let filter = ATrous::new(levels, sigma, edges).unwrap();
            filter
                .apply(lab.view(&image), &guides, &mut expected)
                .unwrap();
            let format = gpu::Format::Single;
            let twin = gpu::ATrous::new(&lab.context, &filter, lab.size(), format).unwrap();
            let found = lab.run(&image, lab.size(), |encoder, image, output| {
                twin.record(&lab.context, encoder, image, &lab.guides, output)
                    .unwrap();
            });
            assert_same(&found, &expected, &format!("{levels}, {sigma}, {edges:?}"));
        }
    }
}

/// Three pictures of a camera that moves and turns a little.
#[test]
fn temporal() {
    let Some(lab) = Lab::new(Picture::planes(83, 57, 9)) else {
        return;
    };
    let camera = |step: f32| {
        let (sin, cos) = (0.01 * step).sin_cos();
        let axes = [[cos, 0.0, sin], [0.0, 1.0, 0.0], [sin, 0.0, -cos]];
        Pinhole::new([0.02 * step, 0.01 * step, 0.0], axes, lab.picture.yfov).unwrap()
    };
    let [_, depths] = lab.inputs();
    let cameras = gpu::CameraMotion::new(&lab.context, &camera(0.0), &camera(0.0)).unwrap();
    for clamp in [f32::INFINITY, 1.5] {
        let filter = Temporal::new(TemporalParams {
            clamp,
            ..TemporalParams::default()
        })
        .unwrap();
        let format = gpu::Format::Single;
        let mut twin = gpu::Temporal::new(&lab.context, &filter, lab.size(), format).unwrap();
        let mut history = History::default();
        for number in 0..3 {
            // The same surfaces seen again, as if they moved along: what counts is that both twins look alike.
            let (now, before) = (camera(0.0), camera(number as f32));
            let slices = view(&lab.picture.depths, 83, 57, 1);
            let places = camera_motion(slices, &now, &before).unwrap();
            let motion = lab.upload(&vec![0.0; 4 * 83 * 57], lab.size());
            cameras.set_cameras(&lab.context, &now, &before);
            lab.submit(|encoder| {
                cameras
                    .record(&lab.context, encoder, &depths, &motion)
                    .unwrap();
            });
            let found = lab.download(&motion, 4);
            for (found, expected) in found.chunks_exact(4).zip(places.chunks_exact(3)) {
                for (found, expected) in found.iter().zip(expected) {
                    let error = (found - expected).abs();
                    assert!(
                        error <= TOLERANCE * expected.abs().max(1.0),
                        "{found} {expected}"
                    );
                }
            }
            let image = lab.image(10 + number);
            let places = view(&places, 83, 57, 3);
            filter
                .apply(lab.view(&image), lab.picture.guides(), places, &mut history)
                .unwrap();
            let input = lab.upload(&image, lab.size());
            lab.submit(|encoder| {
                twin.record(&lab.context, encoder, &input, &lab.guides, &motion)
                    .unwrap();
            });
            let found = lab.download(twin.values(), 4);
            assert_same(&found, history.values().unwrap().data(), "values");
            let lengths = lab.download(twin.lengths(), 1);
            for (found, expected) in lengths.iter().zip(history.lengths().unwrap().data()) {
                assert!((found - expected).abs() < 1e-3, "{found} {expected}");
            }
        }
    }
}

#[test]
fn textures_of_the_wrong_size_are_errors() {
    let Some(lab) = Lab::new(Picture::wall(16, 8)) else {
        return;
    };
    let filter = DiscontinuityBuffer::new([3, 3], Thresholds::default()).unwrap();
    let twin = gpu::DiscontinuityBuffer::new(&lab.context, &filter, gpu::Format::Single).unwrap();
    let small = lab.upload(&[0.0; 4 * 4 * 4], [4, 4]);
    let right = lab.upload(&[0.0; 16 * 8 * 4], [16, 8]);
    lab.submit(|encoder| {
        let error = twin
            .record(&lab.context, encoder, &small, &lab.guides, &right)
            .unwrap_err();
        assert!(matches!(error, Error::Size { .. }), "{error}");
    });
}
