//! From a sample to a picture or a bake: two independent halves for every pixel or receiver, in parallel.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{UVec2, Vec3};
use rayon::prelude::*;

use super::{Integrator, Normals, Quantity, Settings, Tracers, facing};
use crate::{Camera, Error, Hit, Ray, Receivers, Result, Scene, Tracer, sample::Sampler};

/// Pixels or receivers that one task computes.
const CHUNK: usize = 64;

/// Told how far the work is; called from many threads.
pub trait Progress: Sync {
    /// `done` of `total` equal parts of the work are finished. Not called in order.
    fn advance(&self, done: u64, total: u64);
}

impl<F: Fn(u64, u64) + Sync> Progress for F {
    fn advance(&self, done: u64, total: u64) {
        self(done, total);
    }
}

/// A picture of every quantity, and what the camera saw.
#[derive(Clone, Debug, PartialEq)]
pub struct Render {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// In the order asked for; values row by row from the top.
    pub estimates: Vec<Estimate>,
    /// What the camera saw.
    pub layers: Layers,
    /// Rays traced.
    pub rays: u64,
}

/// The values of a quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Which quantity.
    pub quantity: Quantity,
    /// Linear RGB, one per pixel or receiver.
    pub values: Vec<Vec3>,
    /// relRMSE of `values` against the truth, estimated from two independent halves of the samples; NaN for
    /// less than two samples or a black picture.
    pub noise: f32,
}

/// What the camera saw through the centre of every pixel, row by row from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layers {
    /// Base colour, linear RGB; black where nothing was seen.
    pub albedo: Vec<Vec3>,
    /// Unit shading normal, turned to the camera; zero where nothing was seen.
    pub normal: Vec<Vec3>,
    /// Metres; zero where nothing was seen.
    pub position: Vec<Vec3>,
    /// Distance along the viewing direction, metres; infinite where nothing was seen.
    pub depth: Vec<f32>,
    /// Index of the triangle in its mesh; −1 where nothing was seen.
    pub primitive: Vec<f32>,
    /// Index of the instance; −1 where nothing was seen.
    pub instance: Vec<f32>,
}

/// Renders quantities as a camera sees them, box-filtered over each pixel.
///
/// # Errors
/// [`Error::Parameter`] for a size of zero or settings out of range, [`Error::TracerKnowsLess`] as
/// [`Integrator::new`].
pub fn render<E: Tracer + ?Sized, S: Tracer + ?Sized>(
    scene: &Scene,
    tracers: Tracers<'_, E, S>,
    camera: &Camera,
    size: [u32; 2],
    quantities: &[Quantity],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Render> {
    check_size(size)?;
    let [width, height] = size;
    let integrator = Integrator::new(scene, tracers, quantities, settings)?;
    let sample = |pixel: usize, sampler: &Sampler, sums: &mut [Vec3]| {
        let corner = UVec2::new(pixel as u32 % width, pixel as u32 / width).as_vec2();
        let ray = camera.ray(corner + sampler.get_2d(0), width, height);
        match tracers.exact.closest_hit(&ray) {
            Some(hit) => {
                1 + integrator.estimate(&scene.surface_point(&hit), -ray.direction, sampler, sums)
            }
            None => {
                integrator.background(sums);
                1
            }
        }
    };
    let count = width as usize * height as usize;
    let (estimates, rays) = estimate(count, quantities, settings, progress, &sample);
    let layers = Layers::of(scene, tracers.exact, camera, size, settings.normals);
    Ok(Render {
        size,
        estimates,
        layers,
        rays,
    })
}

pub(crate) fn check_size([width, height]: [u32; 2]) -> Result<()> {
    if width > 0 && height > 0 {
        return Ok(());
    }
    Err(Error::Parameter {
        name: "the size",
        value: format!("{width}x{height}"),
        expected: "there must be at least one pixel",
    })
}

/// Estimates quantities at receivers, seen from above. Returns one value per receiver and quantity, and the
/// number of rays.
///
/// # Errors
/// As [`Integrator::new`].
pub fn bake<E: Tracer + ?Sized, S: Tracer + ?Sized>(
    scene: &Scene,
    tracers: Tracers<'_, E, S>,
    receivers: &Receivers,
    quantities: &[Quantity],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<(Vec<Estimate>, u64)> {
    let integrator = Integrator::new(scene, tracers, quantities, settings)?;
    let sample = |index: usize, sampler: &Sampler, sums: &mut [Vec3]| {
        let point = &receivers.points[index].point;
        integrator.estimate(point, point.shading_normal, sampler, sums)
    };
    Ok(estimate(
        receivers.points.len(),
        quantities,
        settings,
        progress,
        &sample,
    ))
}

/// Runs `sample` for `count` pixels or receivers: half of the samples from one sequence, half from another.
fn estimate(
    count: usize,
    quantities: &[Quantity],
    settings: &Settings,
    progress: &dyn Progress,
    sample: &(impl Fn(usize, &Sampler, &mut [Vec3]) -> u64 + Sync),
) -> (Vec<Estimate>, u64) {
    let columns = quantities.len();
    let samples = settings.halves();
    let (done, rays) = (AtomicU64::new(0), AtomicU64::new(0));
    let mut halves = vec![Vec3::ZERO; 2 * columns * count];
    halves
        .par_chunks_mut(2 * columns * CHUNK)
        .enumerate()
        .for_each(|(chunk, sums)| {
            let mut traced = 0;
            for (offset, sums) in sums.chunks_exact_mut(2 * columns).enumerate() {
                let index = chunk * CHUNK + offset;
                for (half, sums) in sums.chunks_exact_mut(columns).enumerate() {
                    let stream = (index as u32).wrapping_mul(2) + half as u32;
                    for number in 0..samples[half] {
                        traced += sample(index, &Sampler::new(settings.seed, stream, number), sums);
                    }
                }
            }
            rays.fetch_add(traced, Ordering::Relaxed);
            let finished = (sums.len() / (2 * columns)) as u64;
            progress.advance(
                done.fetch_add(finished, Ordering::Relaxed) + finished,
                count as u64,
            );
        });
    let estimates = estimates(quantities, settings, &halves);
    (estimates, rays.into_inner())
}

impl Settings {
    /// How many samples the two halves of a pixel or receiver have.
    pub(crate) fn halves(&self) -> [u32; 2] {
        [self.samples.div_ceil(2), self.samples / 2]
    }
}

/// Values and noise from the sums of the two halves of every pixel or receiver: `halves` holds a value of every quantity
/// for the first half, then for the second, then of the next pixel.
pub(crate) fn estimates(
    quantities: &[Quantity],
    settings: &Settings,
    halves: &[Vec3],
) -> Vec<Estimate> {
    let columns = quantities.len();
    let count = halves.len() / (2 * columns);
    let column = |(column, &quantity)| {
        let half = |pixel: usize, half: usize| halves[(2 * pixel + half) * columns + column];
        let (total, samples) = (settings.samples as f32, settings.halves());
        let values = (0..count)
            .map(|pixel| (half(pixel, 0) + half(pixel, 1)) / total)
            .collect();
        let noise =
            noise((0..count).map(|pixel| [0, 1].map(|i| half(pixel, i) / samples[i] as f32)));
        Estimate {
            quantity,
            values,
            noise,
        }
    };
    quantities.iter().enumerate().map(column).collect()
}

/// relRMSE of the mean of two independent halves: half of their RMS difference over the mean.
fn noise(halves: impl Iterator<Item = [Vec3; 2]>) -> f32 {
    let (mut squares, mut sum) = (0.0_f64, 0.0_f64);
    let mut count = 0_u64;
    for [a, b] in halves {
        let (a, b) = (a.as_dvec3(), b.as_dvec3());
        squares += (a - b).length_squared();
        sum += 0.5 * (a + b).element_sum();
        count += 3;
    }
    let count = count as f64;
    ((squares / count).sqrt() / 2.0 / (sum / count)) as f32
}

impl Layers {
    /// Looks through the centre of every pixel.
    pub fn of<T: Tracer + ?Sized>(
        scene: &Scene,
        tracer: &T,
        camera: &Camera,
        size: [u32; 2],
        normals: Normals,
    ) -> Self {
        let [width, height] = size;
        let mut layers = Self::default();
        for y in 0..height {
            let hits: Vec<_> = (0..width)
                .into_par_iter()
                .map(|x| tracer.closest_hit(&center_ray(camera, [x, y], size)))
                .collect();
            layers.push_row(scene, camera, normals, size, &hits);
        }
        layers
    }

    /// Adds the next row, by what the rays through its pixels' centres have hit.
    pub(crate) fn push_row(
        &mut self,
        scene: &Scene,
        camera: &Camera,
        normals: Normals,
        size: [u32; 2],
        hits: &[Option<Hit>],
    ) {
        let forward = -Vec3::from(camera.transform.matrix3.z_axis).normalize_or(Vec3::Z);
        let y = (self.depth.len() / hits.len()) as u32;
        let row: Vec<_> = (0..hits.len() as u32)
            .into_par_iter()
            .zip(hits)
            .map(|(x, hit)| {
                let hit = (*hit)?;
                let direction = center_ray(camera, [x, y], size).direction;
                let point = scene.surface_point(&hit);
                let albedo = scene.surface_material(&point).base_color;
                Some((hit, direction, point, albedo))
            })
            .collect();
        for seen in row {
            let Some((hit, direction, point, albedo)) = seen else {
                self.push(Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, f32::INFINITY, [-1.0; 2]);
                continue;
            };
            let normal = match normals {
                Normals::Smooth => point.shading_normal,
                Normals::Flat => point.geometric_normal,
            };
            self.push(
                albedo,
                facing(normal, -direction),
                point.position,
                hit.t * direction.dot(forward),
                [hit.surface.primitive as f32, hit.surface.instance as f32],
            );
        }
    }

    fn push(
        &mut self,
        albedo: Vec3,
        normal: Vec3,
        position: Vec3,
        depth: f32,
        [primitive, instance]: [f32; 2],
    ) {
        self.albedo.push(albedo);
        self.normal.push(normal);
        self.position.push(position);
        self.depth.push(depth);
        self.primitive.push(primitive);
        self.instance.push(instance);
    }
}

/// The ray through the centre of a pixel.
pub(crate) fn center_ray(camera: &Camera, [x, y]: [u32; 2], [width, height]: [u32; 2]) -> Ray {
    camera.ray(UVec2::new(x, y).as_vec2() + 0.5, width, height)
}
