//! The method on the CPU, in the order of its stages (§4, Fig. 1 to 3).
//!
//! The exact tracer answers for the camera, the particles, direct light and mirrors; the secondary one says whether points
//! see the virtual lights: any tracer, exact or not.

pub mod emission;
pub(crate) mod filter;
pub(crate) mod indirect;
mod specular;
mod tiles;

use std::{
    f32::consts::PI,
    sync::atomic::{AtomicU64, Ordering},
};

use glam::Vec3;
use isophote_scene::{
    Answers, Camera, DirectLight, GBuffer, Image, Pass, Scene, Seen, Tracer,
    reference::{Progress, Tracers},
    sample::hash,
};
use rayon::prelude::*;

use self::{
    emission::{Vpl, shoot},
    filter::Upsample,
    indirect::{Gather, Receiver},
    specular::Tree,
    tiles::{Direct, Tiles},
};
use crate::{Error, GiParams, Pattern, Result};

/// Most pixels of a picture: what is known of each takes up to 256 bytes.
const MOST_PIXELS: u64 = 1 << 25;
/// Points that are lit together.
const CHUNK: usize = 256;

/// Renders a scene as the paper does.
pub struct InstantGi<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> {
    scene: &'a Scene,
    tracers: Tracers<'a, E, S>,
    params: GiParams,
    direct: DirectLight<'a, E>,
}

/// The stages' results, one value per pixel, row by row from the top; linear RGB.
#[derive(Clone, Debug, Default)]
pub struct Stages {
    /// Radiance by light straight from the lights.
    pub direct: Vec<Vec3>,
    /// Radiance by mirrors, glass and highlights, the indirect light of what they show included.
    pub specular: Vec<Vec3>,
    /// Irradiance by the virtual point lights.
    pub irradiance: Vec<Vec3>,
    /// Radiance by that irradiance.
    pub indirect: Vec<Vec3>,
    /// The sum of direct, specular and indirect.
    pub picture: Vec<Vec3>,
    /// The virtual point lights.
    pub vpls: Vec<Vpl>,
    /// What each stage took: `vpls`, `camera`, `direct`, `mirrored`, `indirect`, `filter`, `compose`. `mirrored` is the
    /// light of the virtual point lights on what mirrors and glass show: the paper's hidden cost, part of its direct stage.
    pub passes: Vec<Pass>,
}

impl<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> InstantGi<'a, E, S> {
    /// A renderer of a scene.
    ///
    /// # Errors
    /// [`Error::Parameter`] and [`Error::Filter`] for parameters out of their range, [`Error::Scene`] when the exact tracer
    /// does not answer [`Answers::Surface`], or the secondary one, which must when the bound is compensated.
    pub fn new(scene: &'a Scene, tracers: Tracers<'a, E, S>, params: &GiParams) -> Result<Self> {
        params.check()?;
        let exact = tracers.exact.answers();
        exact.require(Answers::Surface, "igi", "the exact tracer")?;
        if params.compensation > 0 {
            let secondary = tracers.secondary.answers();
            secondary.require(Answers::Surface, "igi", "the secondary tracer")?;
        }
        Ok(Self {
            scene,
            tracers,
            params: *params,
            direct: DirectLight::new(scene, tracers.exact),
        })
    }

    /// Renders what a camera sees; `progress` is told how far it is.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a size of zero, or of more than 2²⁵ pixels.
    pub fn render(
        &self,
        camera: &Camera,
        size: [u32; 2],
        progress: &dyn Progress,
    ) -> Result<Stages> {
        let pixels = check_size(size)?;
        let (scene, exact, params) = (self.scene, self.tracers.exact, &self.params);
        let upsample = Upsample::new(size, params)?;
        let mut passes = Vec::new();
        let vpls = Pass::timed(&mut passes, "vpls", || {
            let (vpls, rays) = shoot(scene, exact, params);
            (vpls, [rays, 0])
        });
        let seen = Pass::timed(&mut passes, "camera", || {
            let seen = GBuffer::see(scene, exact, camera, size, params.materials);
            (seen, [pixels, 0])
        });
        let gather = Gather::new(scene, self.tracers.secondary, &self.direct, &vpls, params);
        let [columns, rows] = upsample.grid.size();
        let meter = Meter {
            progress,
            done: AtomicU64::new(0),
            total: pixels + (columns * rows) as u64,
        };
        let Direct {
            direct,
            specular,
            cost,
        } = Pass::timed(&mut passes, "direct", || {
            let tiles = Tiles {
                tree: Tree {
                    scene,
                    exact,
                    direct: &self.direct,
                    params,
                },
                gather: &gather,
                meter: &meter,
            };
            let light = tiles.light(&seen);
            let rays = light.cost.rays;
            (light, [rays, 0])
        });
        if let Some(direct) = passes.last_mut() {
            let seconds = direct.seconds * cost.mirrored_share();
            direct.seconds -= seconds;
            passes.push(Pass {
                name: "mirrored",
                rays: cost.mirrored_rays,
                shadow_rays: 0,
                seconds,
            });
        }
        let samples = Pass::timed(&mut passes, "indirect", || {
            let (samples, rays) = self.samples(&seen, &gather, &upsample, &meter);
            (samples, [rays, 0])
        });
        let irradiance = Pass::timed(&mut passes, "filter", || {
            (upsample.apply(&samples, &seen, &camera.pinhole()), [0, 0])
        })?;
        let (indirect, picture) = Pass::timed(&mut passes, "compose", || {
            let (mut indirect, mut picture) = (Vec::new(), Vec::new());
            let lit = irradiance.par_iter().zip(&direct).zip(&specular);
            let composed = seen.pixels.par_iter().zip(lit).map(
                |(seen, ((&irradiance, &direct), &specular))| {
                    let albedo = seen.as_ref().map_or(Vec3::ZERO, Seen::albedo);
                    let indirect = albedo / PI * irradiance;
                    (indirect, direct + specular + indirect)
                },
            );
            composed.unzip_into_vecs(&mut indirect, &mut picture);
            ((indirect, picture), [0, 0])
        });
        Ok(Stages {
            direct,
            specular,
            irradiance,
            indirect,
            picture,
            vpls,
            passes,
        })
    }

    /// Stage 4, at the samples of a grid of pixels.
    fn samples(
        &self,
        seen: &GBuffer,
        gather: &Gather<'_, E, S>,
        upsample: &Upsample,
        meter: &Meter<'_>,
    ) -> (Vec<Vec3>, u64) {
        let [columns, rows] = upsample.grid.size();
        let mut light = vec![Vec3::ZERO; columns * rows];
        let rays = light
            .par_chunks_mut(CHUNK)
            .enumerate()
            .map(|(chunk, light)| {
                let mut receivers = Vec::with_capacity(light.len());
                let mut places = Vec::with_capacity(light.len());
                for place in 0..light.len() {
                    let number = chunk * CHUNK + place;
                    let sample = [number % columns, number / columns];
                    let [x, y] = upsample.grid.pixel(sample);
                    let pixel = y * seen.size[0] as usize + x;
                    // Metal too, whose irradiance its neighbours may need.
                    if let Some(seen) = &seen.pixels[pixel] {
                        places.push(place);
                        receivers.push(Receiver {
                            point: &seen.point,
                            normal: seen.normal(),
                            part: self.part(sample),
                            stream: pixel as u32,
                        });
                    }
                }
                let mut found = vec![Vec3::ZERO; receivers.len()];
                let [m, n] = self.params.interleaving;
                let rays = gather.irradiance(&receivers, m * n, &mut found);
                for (place, found) in places.into_iter().zip(found) {
                    light[place] = found;
                }
                meter.advance(light.len());
                rays
            })
            .sum();
        (light, rays)
    }

    /// Which part of the lights lights a sample (§4.3).
    fn part(&self, [i, j]: [usize; 2]) -> u32 {
        let [m, n] = self.params.interleaving;
        let (i, j) = (i as u32, j as u32);
        let place = (j % n) * m + i % m;
        match self.params.pattern {
            Pattern::Regular => place,
            Pattern::Irregular => shuffled(place, m * n, hash((i / m) ^ hash(j / n))),
        }
    }
}

/// Refuses pictures that are too large, and returns the number of pixels.
pub(crate) fn check_size([width, height]: [u32; 2]) -> Result<u64> {
    let pixels = u64::from(width) * u64::from(height);
    if (1..=MOST_PIXELS).contains(&pixels) {
        return Ok(pixels);
    }
    Err(Error::Parameter {
        name: "the size of the picture",
        value: format!("{width}x{height}"),
        expected: "it must have 1 to 33554432 pixels",
    })
}

/// Where a place comes in a shuffled row of as many (Fisher and Yates).
fn shuffled(place: u32, count: u32, mut seed: u32) -> u32 {
    let mut order = [0_u8; 64];
    for (number, slot) in (0..count as u8).zip(&mut order) {
        *slot = number;
    }
    for last in (1..count as usize).rev() {
        seed = hash(seed.wrapping_add(0x9e37_79b9));
        order.swap(last, seed as usize % (last + 1));
    }
    u32::from(order[place as usize])
}

/// Counts finished points for whoever watches.
struct Meter<'a> {
    progress: &'a dyn Progress,
    done: AtomicU64,
    total: u64,
}

impl Meter<'_> {
    fn advance(&self, points: usize) {
        let done = self.done.fetch_add(points as u64, Ordering::Relaxed) + points as u64;
        self.progress.advance(done, self.total);
    }
}

impl Stages {
    /// Rays of all kinds.
    pub fn rays(&self) -> u64 {
        let rays = self.passes.iter().map(|pass| pass.rays + pass.shadow_rays);
        rays.sum()
    }

    /// The stages by the names of their layers.
    pub fn layers(&self) -> [(&'static str, &[Vec3]); 4] {
        [
            ("direct", &self.direct),
            ("specular", &self.specular),
            ("indirect", &self.indirect),
            ("irradiance.indirect", &self.irradiance),
        ]
    }

    /// The picture in R, G, B, and [`layers`](Self::layers).
    pub fn image(&self, [width, height]: [u32; 2]) -> Image {
        let mut image = Image::new(width, height);
        image.push_layer("", "RGB", &self.picture);
        for (name, values) in self.layers() {
            image.push_layer(name, "RGB", values);
        }
        image
    }
}
