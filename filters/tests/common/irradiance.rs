//! Upsampling real irradiance, and how wrong it is at silhouettes. Shared by a test and an example.

#![expect(
    clippy::unwrap_used,
    reason = "a test may fail, and so may a measurement"
)]

use std::{path::Path, sync::Arc};

use glam::{UVec2, Vec3};
use isophote_filters::{
    EdgeStop, Guides, ImageView, JointBilateral, Neighborhood, Pinhole, SampleGrid,
};
use isophote_scene::{
    BuildTracer, BvhTracer, Projection, Selection, builtin, load,
    reference::{Integrator, Layers, Materials, Normals, Quantity, Settings, Tracers},
    sample::Sampler,
};
use rayon::prelude::*;

/// What a camera sees, and the indirect irradiance there.
pub(crate) struct Seen {
    size: [usize; 2],
    normals: Vec<f32>,
    depths: Vec<f32>,
    camera: Pinhole,
    /// Linear RGB at the centres of the pixels, from each half of the samples.
    halves: [Vec<f32>; 2],
}

/// Errors as relRMSE over the pixels at silhouettes, √mean((a − b)²) / mean(b), b the irradiance at full resolution.
///
/// They are free of noise: each is computed from two independent halves of the samples, the square (a − b)² as the
/// product of the halves' differences, in which noise has no part on average.
pub(crate) struct Errors {
    /// How many of all pixels are silhouettes.
    pub(crate) share: f64,
    /// The reference's noise, which the others do not hold.
    pub(crate) noise: f64,
    /// Of a constant, the reference's mean.
    pub(crate) constant: f64,
    /// Bicubic upsampling of the same samples.
    pub(crate) bicubic: f64,
    /// Bicubic upsampling of the means of blocks of pixels, which are less noisy and have no aliases.
    pub(crate) bicubic_of_means: f64,
    /// Joint bilateral upsampling with the weight of MS10 Eq. (2).
    pub(crate) cosine: f64,
    /// And with the default weights.
    pub(crate) joint_bilateral: f64,
}

/// Renders a scene's file or `builtin:NAME` as its first camera sees it.
///
/// # Panics
/// If it does not load or has no perspective camera.
pub(crate) fn render(scene: &str, size: [usize; 2], samples: u32) -> Seen {
    let loaded = if builtin::is_builtin(scene) {
        builtin::build(scene)
    } else {
        load(Path::new(scene))
    };
    let scene = Arc::new(loaded.unwrap());
    let camera = &scene.cameras[0];
    let Projection::Perspective { yfov } = camera.projection else {
        panic!("the camera is not a perspective one");
    };
    let tracer = BvhTracer::build(&scene, &Selection::default(), &Default::default()).unwrap();
    let [width, height] = size.map(|side| side as u32);
    let layers = Layers::of(&scene, &tracer, camera, [width, height], Normals::Smooth);
    let settings = Settings {
        materials: Materials::Lambert,
        samples,
        ..Settings::default()
    };
    let tracers = Tracers {
        exact: &tracer,
        secondary: &tracer,
    };
    let integrator =
        Integrator::new(&scene, tracers, &[Quantity::IrradianceIndirect], &settings).unwrap();
    let half = |half: u32| -> Vec<f32> {
        let pixel = |pixel: u32| {
            let at = UVec2::new(pixel % width, pixel / width).as_vec2() + 0.5;
            let ray = camera.ray(at, width, height);
            let mut sum = [Vec3::ZERO];
            if let Some(hit) = isophote_scene::Tracer::closest_hit(&tracer, &ray) {
                let point = scene.surface_point(&hit);
                for number in 0..samples / 2 {
                    let sampler = Sampler::new(settings.seed, 2 * pixel + half, number);
                    integrator.estimate(&point, -ray.direction, &sampler, &mut sum);
                }
            }
            (sum[0] / (samples / 2) as f32).to_array()
        };
        (0..width * height)
            .into_par_iter()
            .flat_map_iter(pixel)
            .collect()
    };
    let matrix = camera.transform.matrix3;
    let axes = [matrix.x_axis, matrix.y_axis, -matrix.z_axis].map(|axis| axis.normalize().into());
    Seen {
        size,
        normals: layers.normal.iter().flat_map(Vec3::to_array).collect(),
        depths: layers.depth,
        camera: Pinhole::new(camera.position().into(), axes, yfov).unwrap(),
        halves: [half(0), half(1)],
    }
}

impl Seen {
    /// Upsamples every `factor`-th pixel.
    pub(crate) fn errors(&self, factor: usize) -> Errors {
        let [width, height] = self.size;
        let silhouettes = self.silhouettes();
        let grid = SampleGrid::new(self.size, factor).unwrap();
        let normals = view(&self.normals, self.size, 3);
        let guides = Guides::new(normals, view(&self.depths, self.size, 1), &self.camera).unwrap();
        let upsampled = |full: &[f32], edges| {
            let low = grid.gather(view(full, self.size, 3)).unwrap();
            let mut output = vec![0.0; full.len()];
            JointBilateral::new(factor, Neighborhood::default(), edges)
                .unwrap()
                .apply(view(&low, grid.size(), 3), &guides, &mut output)
                .unwrap();
            output
        };
        let cubic = |full: &[f32], center: f64| {
            let low = grid.gather(view(full, self.size, 3)).unwrap();
            bicubic(&low, grid.size(), self.size, factor, center)
        };
        let at_silhouettes = |values: &[f32]| -> Vec<f64> {
            let pixels = values.chunks_exact(3).zip(&silhouettes);
            let chosen = pixels.filter(|(_, silhouette)| **silhouette);
            chosen
                .flat_map(|(rgb, _)| rgb.iter().map(|&value| value.into()))
                .collect()
        };
        let references = [0, 1].map(|half| at_silhouettes(&self.halves[half]));
        let count = references[0].len() as f64;
        let mean = references.iter().flatten().sum::<f64>() / (2.0 * count);
        let error = |filter: &dyn Fn(&[f32]) -> Vec<f32>| {
            let [a, b] = [0, 1].map(|half| {
                let found = at_silhouettes(&filter(&self.halves[half])).into_iter();
                let differences = found.zip(&references[half]).map(|(a, b)| a - b);
                differences.collect::<Vec<_>>()
            });
            let squares: f64 = a.iter().zip(&b).map(|(a, b)| a * b).sum();
            (squares.max(0.0) / count).sqrt() / mean
        };
        let halves = references[0].iter().zip(&references[1]);
        let noise: f64 = halves.map(|(a, b)| (0.5 * (a - b)).powi(2)).sum();
        let middle = 0.5 * (factor as f64 - 1.0);
        Errors {
            share: count / (3 * width * height) as f64,
            noise: (noise / count).sqrt() / mean,
            constant: error(&|full| vec![mean as f32; full.len()]),
            bicubic: error(&|full| cubic(full, (factor / 2) as f64)),
            bicubic_of_means: error(&|full| cubic(&block_means(full, self.size, factor), middle)),
            cosine: error(&|full| upsampled(full, EdgeStop::COSINE)),
            joint_bilateral: error(&|full| upsampled(full, EdgeStop::default())),
        }
    }

    /// Pixels with a neighbour among the eight around them whose depth differs by more than 5 % or whose normal by
    /// more than 30°.
    fn silhouettes(&self) -> Vec<bool> {
        let [width, height] = self.size;
        let normal = |pixel: usize| Vec3::from_slice(&self.normals[3 * pixel..]);
        let differ = |p: usize, q: usize| match (self.depths[p], self.depths[q]) {
            (a, b) if a.is_finite() && b.is_finite() => {
                let angle = normal(p).dot(normal(q));
                (a - b).abs() > 0.05 * a || angle < 30_f32.to_radians().cos()
            }
            (a, b) => a.is_finite() != b.is_finite(),
        };
        let is_silhouette = |p: usize| {
            let (x, y) = (p % width, p / width);
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            let mut around = rows.flat_map(|row| {
                let columns = x.saturating_sub(1)..(x + 2).min(width);
                columns.map(move |column| row * width + column)
            });
            around.any(|q| differ(p, q))
        };
        (0..width * height).map(is_silhouette).collect()
    }
}

fn view(data: &[f32], [width, height]: [usize; 2], channels: usize) -> ImageView<'_> {
    ImageView::new(data, width, height, channels).unwrap()
}

/// Every pixel's block of `factor`×`factor` pixels, averaged.
fn block_means(image: &[f32], [width, height]: [usize; 2], factor: usize) -> Vec<f32> {
    let mut means = vec![0.0; image.len()];
    for (index, mean) in means.iter_mut().enumerate() {
        let (channel, x, y) = (index % 3, index / 3 % width, index / 3 / width);
        let block = |at: usize, side: usize| {
            let first = at / factor * factor;
            first..(first + factor).min(side)
        };
        let (columns, rows) = (block(x, width), block(y, height));
        let count = (columns.len() * rows.len()) as f32;
        let pixels = rows.flat_map(|y| columns.clone().map(move |x| y * width + x));
        *mean = pixels.map(|pixel| image[3 * pixel + channel]).sum::<f32>() / count;
    }
    means
}

/// Keys' cubic convolution (1981, a = −1/2); `center` is the pixel of the first sample. The borders are repeated.
fn bicubic(
    samples: &[f32],
    [columns, rows]: [usize; 2],
    [width, height]: [usize; 2],
    factor: usize,
    center: f64,
) -> Vec<f32> {
    let kernel = |t: f64| match t.abs() {
        t if t < 1.0 => 1.5 * t.powi(3) - 2.5 * t.powi(2) + 1.0,
        t if t < 2.0 => -0.5 * t.powi(3) + 2.5 * t.powi(2) - 4.0 * t + 2.0,
        _ => 0.0,
    };
    let taps = |pixel: usize, count: usize| {
        let at = (pixel as f64 - center) / factor as f64;
        [-1.0, 0.0, 1.0, 2.0].map(|step| {
            let tap = at.floor() + step;
            let sample = tap.clamp(0.0, (count - 1) as f64) as usize;
            (sample, kernel(at - tap))
        })
    };
    let mut output = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        let vertical = taps(y, rows);
        for x in 0..width {
            let horizontal = taps(x, columns);
            for channel in 0..3 {
                let row = |j: usize| -> f64 {
                    let value = |i: usize| f64::from(samples[3 * (j * columns + i) + channel]);
                    horizontal
                        .iter()
                        .map(|&(i, weight)| weight * value(i))
                        .sum()
                };
                let sum: f64 = vertical.iter().map(|&(j, weight)| weight * row(j)).sum();
                output.push(sum as f32);
            }
        }
    }
    output
}
