//! The method on the CPU, in the order of its stages (§4, Fig. 1 to 3).
//!
//! The exact tracer answers for the camera, the particles, direct light and mirrors; the secondary one says whether points
//! see the virtual lights: any tracer, exact or not.

mod cache;
pub mod emission;
mod fill;
pub(crate) mod filter;
mod history;
pub(crate) mod indirect;
pub(crate) mod keep;
pub mod maps;
mod receivers;
mod refine;
mod samples;
pub(crate) mod select;
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
};
use rayon::prelude::*;

use self::{
    emission::{Vpl, shoot},
    filter::Upsample,
    indirect::Gather,
    keep::keep,
    maps::Maps,
    refine::refine,
    samples::Samples,
    select::along_curve,
    specular::Tree,
    tiles::{Direct, Tiles},
};
pub use self::{history::History, receivers::Shot};
use crate::{Error, GiParams, Result, Visibility};

/// Most pixels of a picture: what is known of each takes up to 256 bytes.
const MOST_PIXELS: u64 = 1 << 25;

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
    /// The virtual point lights, in the order of their paths; where some of them are picked or kept, along a curve through space.
    pub vpls: Vec<Vpl>,
    /// What each stage took: `vpls`, `camera`, `keep`, `maps`, `direct`, `mirrored`, `indirect`, `filter`, `refine`, with a history
    /// `history`, `compose`. `mirrored` is the light of the virtual point lights on what mirrors and glass show: the paper's hidden
    /// cost, part of its direct stage. `maps` takes nothing where points see by rays.
    pub passes: Vec<Pass>,
}

impl<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> InstantGi<'a, E, S> {
    /// A renderer of a scene.
    ///
    /// # Errors
    /// [`Error::Parameter`] and [`Error::Filter`] for parameters out of their range, [`Error::Scene`] when the exact tracer
    /// does not answer [`Answers::Surface`], or the secondary one, which must when the bound is compensated, and
    /// [`Answers::Distance`] when it fills shadow maps.
    pub fn new(scene: &'a Scene, tracers: Tracers<'a, E, S>, params: &GiParams) -> Result<Self> {
        params.check()?;
        let exact = tracers.exact.answers();
        exact.require(Answers::Surface, "igi", "the exact tracer")?;
        let secondary = tracers.secondary.answers();
        secondary.require(params.needs(), "igi", "the secondary tracer")?;
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
    /// [`Error::Parameter`] for a size of zero, or of more than 2²⁵ pixels; [`Error::TooLarge`] for shadow maps of more than
    /// 4 GiB.
    pub fn render(
        &self,
        camera: &Camera,
        size: [u32; 2],
        progress: &dyn Progress,
    ) -> Result<Stages> {
        self.picture(&self.params, camera, size, None, progress)
    }

    /// Renders the next picture of a sequence: with other light paths than those before it, and with the irradiance that the
    /// history has of what is seen again. Where objects moved, their old light is rejected unless place and normal fit by
    /// chance; light that changed is followed as slowly as the history is long. A picture of another size starts it anew.
    ///
    /// # Errors
    /// As [`render`](Self::render).
    pub fn render_next(
        &self,
        camera: &Camera,
        size: [u32; 2],
        history: &mut History,
        progress: &dyn Progress,
    ) -> Result<Stages> {
        let params = GiParams {
            seed: self.params.seed.wrapping_add(history.pictures()),
            ..self.params
        };
        self.picture(&params, camera, size, Some(history), progress)
    }

    fn picture(
        &self,
        params: &GiParams,
        camera: &Camera,
        size: [u32; 2],
        history: Option<&mut History>,
        progress: &dyn Progress,
    ) -> Result<Stages> {
        let pixels = check_size(size)?;
        let (scene, exact) = (self.scene, self.tracers.exact);
        let upsample = Upsample::new(size, params)?;
        let mut passes = Vec::new();
        let vpls = Pass::timed(&mut passes, "vpls", || {
            let (vpls, rays) = self.paths(params);
            (vpls, [rays, 0])
        });
        let seen = Pass::timed(&mut passes, "camera", || {
            let seen = GBuffer::see(scene, exact, camera, size, params.materials);
            (seen, [pixels, 0])
        });
        let vpls = Pass::timed(&mut passes, "keep", || {
            let kept = match params.kept {
                0 => vpls,
                _ => keep(vpls, &seen, params),
            };
            (kept, [0, 0])
        });
        let maps = Pass::timed(&mut passes, "maps", || self.maps(&vpls))?;
        let gather = Gather::new(
            scene,
            self.tracers.secondary,
            &self.direct,
            &vpls,
            maps.as_ref().into(),
            params,
        );
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
            let samples = Samples {
                seen: &seen,
                gather: &gather,
                grid: upsample.grid,
                params,
                meter: &meter,
            };
            let (light, rays) = samples.irradiance(&camera.pinhole());
            (light, [rays, 0])
        });
        let irradiance = Pass::timed(&mut passes, "filter", || {
            (upsample.apply(&samples, &seen, &camera.pinhole()), [0, 0])
        })?;
        let irradiance = Pass::timed(&mut passes, "refine", || {
            let mut irradiance = irradiance;
            let rays = match params.refines() {
                true => refine(
                    &gather,
                    &seen,
                    upsample.grid,
                    &camera.pinhole(),
                    &mut irradiance,
                ),
                false => 0,
            };
            (irradiance, [rays, 0])
        });
        let irradiance = match history {
            Some(history) => Pass::timed(&mut passes, "history", || {
                (history.add(&irradiance, &seen, &camera.pinhole()), [0, 0])
            })?,
            None => irradiance,
        };
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

    /// The virtual point lights of all light paths, and the number of rays.
    fn paths(&self, params: &GiParams) -> (Vec<Vpl>, u64) {
        let (mut vpls, rays) = shoot(self.scene, self.tracers.exact, params);
        if params.sorts() {
            along_curve(&mut vpls, &self.scene.bounds());
        }
        (vpls, rays)
    }

    /// The shadow maps of the lights, if points see by them; and the number of rays.
    fn maps(&self, vpls: &[Vpl]) -> (Result<Option<Maps>>, [u64; 2]) {
        let Visibility::Maps(params) = &self.params.visibility else {
            return (Ok(None), [0; 2]);
        };
        match Maps::new(self.tracers.secondary, vpls, params) {
            Ok((maps, rays)) => (Ok(Some(maps)), [rays, 0]),
            Err(error) => (Err(error), [0; 2]),
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
