//! The method on the CPU: the hybrid renderer (§4, §5), in the order of its stages.
//!
//! 0. [`build`]: the maps, once for a scene (§3.1); [`trace`]: the tracer over them (§3.2).
//! 1. `fragments`: what the camera sees, one shading per primitive and pixel.
//! 2. `light`: direct light, with shadows by exact rays or by the maps.
//! 3. `gather`: diffuse secondary rays, a few a pixel, single bounce.
//! 4. `filter`: the two-pass Gaussian over the irradiance they find (`isophote-filters`).
//! 5. `gather`: glossy and mirror rays.
//! 6. Everything combined; each intermediate of the paper's Fig. 5 is a layer of the image.
//!
//! The maps are one tracer among others here: what must be sharp (the camera, the shadows) is asked of an exact
//! tracer, the bounced light of any. The exact tracer holds everything, the other what the selection it was built of
//! holds: objects that move are left out of maps, receive their light and stay in the shadows (§6).

pub mod build;
mod file;
pub(crate) mod filter;
mod fragments;
mod gather;
mod light;
pub mod maps;
pub mod trace;

use std::{
    f32::consts::PI,
    sync::atomic::{AtomicU64, Ordering},
};

use glam::Vec3;
use isophote_filters::Gaussian;
use isophote_scene::{
    Answers, Camera, Image, Pass, Scene, Tracer,
    reference::{Progress, Tracers},
};

use self::{
    filter::Blur,
    fragments::{Fragment, Fragments},
    light::Lights,
};
use crate::{Error, HybridParams, Result, Shadows};

/// Most samples of a picture: what is known of each takes up to 256 bytes.
const MOST_SAMPLES: u64 = 1 << 25;

/// Renders a scene as the paper does.
pub struct Hybrid<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> {
    scene: &'a Scene,
    tracers: Tracers<'a, E, S>,
    params: HybridParams,
    gaussian: Gaussian,
    /// `None` where it would do nothing.
    light_gaussian: Option<Gaussian>,
    /// Light straight from the lights with exact shadows: what secondary rays hit has no other.
    lights: Lights<'a, E>,
    /// The same with shadows by the secondary tracer, where they are asked for.
    lights_by_secondary: Option<Lights<'a, S>>,
}

/// The stages' results, one value per pixel, row by row from the top; linear RGB.
#[derive(Clone, Debug, Default)]
pub struct Stages {
    /// Radiance by light straight from the lights.
    pub direct: Vec<Vec3>,
    /// Irradiance by one diffuse bounce, as the few rays of each pixel found it.
    pub irradiance: Vec<Vec3>,
    /// The same after the Gaussian.
    pub filtered: Vec<Vec3>,
    /// Radiance by the filtered irradiance.
    pub diffuse: Vec<Vec3>,
    /// Radiance by glossy and mirror rays, and by those through glass.
    pub glossy: Vec<Vec3>,
    /// The sum of direct, diffuse and glossy.
    pub picture: Vec<Vec3>,
    /// What each stage took: `camera`, `direct`, `diffuse`, `filter`, `glossy`.
    pub passes: Vec<Pass>,
}

/// Counts finished fragments for whoever watches.
struct Meter<'a> {
    progress: &'a dyn Progress,
    done: AtomicU64,
    total: u64,
}

impl Meter<'_> {
    fn advance(&self, fragments: usize) {
        let done = self.done.fetch_add(fragments as u64, Ordering::Relaxed) + fragments as u64;
        self.progress.advance(done, self.total);
    }
}

impl<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> Hybrid<'a, E, S> {
    /// A renderer of a scene.
    ///
    /// # Errors
    /// [`Error::Parameter`] and [`Error::Filter`] for parameters out of their range, [`Error::Scene`] when a tracer
    /// does not answer [`Answers::Surface`].
    pub fn new(
        scene: &'a Scene,
        tracers: Tracers<'a, E, S>,
        params: &HybridParams,
    ) -> Result<Self> {
        params.check()?;
        for (role, answers) in [
            ("the exact tracer", tracers.exact.answers()),
            ("the secondary tracer", tracers.secondary.answers()),
        ] {
            answers.require(Answers::Surface, "ldi", role)?;
        }
        let gaussian = |width: u32| Gaussian::new(width as usize, params.filter_sigma);
        Ok(Self {
            scene,
            tracers,
            params: *params,
            gaussian: gaussian(params.filter_width)?,
            light_gaussian: match params.light_filter_width {
                1 => None,
                width => Some(gaussian(width)?),
            },
            lights: Lights::new(scene, tracers.exact, params)?,
            lights_by_secondary: match params.shadows {
                Shadows::Exact => None,
                Shadows::Secondary => Some(Lights::new(scene, tracers.secondary, params)?),
            },
        })
    }

    /// Renders what a camera sees; `progress` is told how far it is, in thirds of a fragment.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a size of zero, or of more than 2²⁵ samples.
    pub fn render(
        &self,
        camera: &Camera,
        size: [u32; 2],
        progress: &dyn Progress,
    ) -> Result<Stages> {
        check_size(size, self.params.samples)?;
        let mut passes = Vec::new();
        let (scene, exact, params) = (self.scene, self.tracers.exact, &self.params);
        let fragments = Pass::timed(&mut passes, "camera", || {
            let fragments = Fragments::seen(scene, exact, camera, size, params);
            let rays = fragments.camera_rays();
            (fragments, [rays, 0])
        });
        let meter = Meter {
            progress,
            done: AtomicU64::new(0),
            total: 3 * fragments.all.len() as u64,
        };
        let blur = Blur::new(&fragments, camera, size, self.params.edges)?;
        let direct = Pass::timed(&mut passes, "direct", || {
            let (lit, rays) = match &self.lights_by_secondary {
                Some(lights) => lights.direct(&fragments, params, &meter),
                None => self.lights.direct(&fragments, params, &meter),
            };
            (lit, [rays, 0])
        });
        let diffuse = Pass::timed(&mut passes, "diffuse", || self.diffuse(&fragments, &meter));
        let glossy = Pass::timed(&mut passes, "glossy", || self.glossy(&fragments, &meter));
        let irradiance = fragments.over_pixels(&diffuse);
        let (direct, filtered) = Pass::timed(&mut passes, "filter", || {
            let direct = match &self.light_gaussian {
                Some(gaussian) => blur.lit(gaussian, &fragments, direct),
                None => Ok(direct),
            };
            let scatters = |fragment: &Fragment| fragment.diffuse != Vec3::ZERO;
            let filtered = blur.over(&self.gaussian, &fragments, &diffuse, scatters);
            ((direct, filtered), [0, 0])
        });
        let (direct, filtered) = (direct?, filtered?);
        let lit: Vec<Vec3> = fragments
            .all
            .iter()
            .map(|fragment| fragment.diffuse / PI * filtered[fragment.pixel as usize])
            .collect();
        Ok(Stages {
            direct: fragments.over_pixels(&direct),
            diffuse: fragments.over_pixels(&lit),
            glossy: fragments.over_pixels(&glossy),
            irradiance,
            filtered,
            picture: Vec::new(),
            passes,
        }
        .combined())
    }
}

pub(crate) fn check_size([width, height]: [u32; 2], samples: u32) -> Result<()> {
    let samples = u64::from(width) * u64::from(height) * u64::from(samples);
    if (1..=MOST_SAMPLES).contains(&samples) {
        return Ok(());
    }
    Err(Error::Parameter {
        name: "the size of the picture",
        value: format!("{width}x{height}"),
        expected: "it must have 1 to 33554432 samples",
    })
}

impl Stages {
    /// Hybrid stage 6.
    fn combined(mut self) -> Self {
        let bounced = self.diffuse.iter().zip(&self.glossy);
        self.picture = self
            .direct
            .iter()
            .zip(bounced)
            .map(|(&direct, (&diffuse, &glossy))| direct + diffuse + glossy)
            .collect();
        self
    }

    /// Rays of all kinds.
    pub fn rays(&self) -> u64 {
        let rays = self.passes.iter().map(|pass| pass.rays + pass.shadow_rays);
        rays.sum()
    }

    /// The stages by the names of their layers: `direct`, `diffuse`, `glossy`, `irradiance.indirect` and
    /// `irradiance.noisy`, which is before the filter.
    pub fn layers(&self) -> [(&'static str, &[Vec3]); 5] {
        [
            ("direct", &self.direct),
            ("diffuse", &self.diffuse),
            ("glossy", &self.glossy),
            ("irradiance.indirect", &self.filtered),
            ("irradiance.noisy", &self.irradiance),
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
