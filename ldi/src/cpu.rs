//! The method on the CPU: the hybrid renderer (§4, §5), in the order of its stages.
//!
//! 0. [`build`]: the maps, once for a scene (§3.1); [`trace`]: the tracer over them (§3.2).
//! 1. `fragments`: what the camera sees, one shading per primitive and pixel.
//! 2. Direct light, with shadows by exact rays.
//! 3. `gather`: diffuse secondary rays, a few a pixel, single bounce.
//! 4. The two-pass Gaussian over the irradiance they find (`isophote-filters`).
//! 5. `gather`: glossy and mirror rays.
//! 6. Everything combined; each intermediate of the paper's Fig. 5 is a layer of the image.
//!
//! The maps are one tracer among others here: what must be sharp (the camera, the shadows) is asked of an exact
//! tracer, the bounced light of any.

pub mod build;
mod file;
mod fragments;
mod gather;
pub mod maps;
pub mod trace;

use std::f32::consts::PI;

use glam::{Vec3, Vec4};
use isophote_filters::{Gaussian, ImageView};
use isophote_scene::{
    Answers, Camera, Image, Scene, Tracer,
    reference::{Integrator, Materials, Quantity, Settings, Tracers},
    sample::Sampler,
};
use rayon::prelude::*;

use self::fragments::{Fragment, Fragments};
use crate::{Error, HybridParams, Result};

/// Most samples of a picture: what is known of each takes up to 256 bytes.
const MOST_SAMPLES: u64 = 1 << 25;

/// Renders a scene as the paper does.
pub struct Hybrid<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> {
    scene: &'a Scene,
    tracers: Tracers<'a, E, S>,
    params: HybridParams,
    gaussian: Gaussian,
    /// Light straight from the lights, at the camera's fragments.
    direct: Integrator<'a, E, E>,
    /// And at the points that secondary rays hit, where no map is needed: the paper's shadow map.
    bounced: Integrator<'a, E, E>,
}

/// The stages' results, one value per pixel, row by row from the top; linear RGB.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stages {
    /// Radiance by light straight from the lights.
    pub direct: Vec<Vec3>,
    /// Irradiance by one diffuse bounce, as the few rays of each pixel found it.
    pub irradiance: Vec<Vec3>,
    /// The same after the Gaussian.
    pub filtered: Vec<Vec3>,
    /// Radiance by the filtered irradiance.
    pub diffuse: Vec<Vec3>,
    /// Radiance by glossy and mirror rays.
    pub glossy: Vec<Vec3>,
    /// The sum of direct, diffuse and glossy.
    pub picture: Vec<Vec3>,
    /// Secondary rays traced.
    pub rays: u64,
}

impl<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> Hybrid<'a, E, S> {
    /// A renderer of a scene.
    ///
    /// # Errors
    /// [`Error::Parameter`] for parameters out of their range, [`Error::Scene`] when a tracer does not answer
    /// [`Answers::Surface`].
    pub fn new(
        scene: &'a Scene,
        tracers: Tracers<'a, E, S>,
        params: &HybridParams,
    ) -> Result<Self> {
        params.check()?;
        let answered = tracers.secondary.answers();
        if answered < Answers::Surface {
            return Err(isophote_scene::Error::TracerKnowsLess {
                technique: "ldi",
                needed: Answers::Surface,
                tracer: "the secondary tracer".into(),
                answered,
            }
            .into());
        }
        let exact = Tracers {
            exact: tracers.exact,
            secondary: tracers.exact,
        };
        let settings = Settings {
            materials: params.materials,
            seed: params.seed,
            ..Settings::default()
        };
        let lambert = Settings {
            materials: Materials::Lambert,
            ..settings
        };
        let gaussian = Gaussian::new(params.filter_width as usize, params.filter_sigma)?;
        Ok(Self {
            scene,
            tracers,
            params: *params,
            gaussian,
            direct: Integrator::new(scene, exact, &[Quantity::Direct], &settings)?,
            bounced: Integrator::new(scene, exact, &[Quantity::IrradianceDirect], &lambert)?,
        })
    }

    /// Renders what a camera sees.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a size of zero, or of more than 2²⁵ samples.
    pub fn render(&self, camera: &Camera, size: [u32; 2]) -> Result<Stages> {
        let [width, height] = size;
        let samples = u64::from(width) * u64::from(height) * u64::from(self.params.samples);
        if !(1..=MOST_SAMPLES).contains(&samples) {
            return Err(Error::Parameter {
                name: "the size of the picture",
                value: format!("{width}x{height}"),
                expected: "it must have 1 to 33554432 samples",
            });
        }
        let fragments = Fragments::seen(
            self.scene,
            self.tracers.exact,
            camera,
            size,
            self.params.samples,
            self.params.materials,
        );
        let direct = self.direct(&fragments);
        let diffuse = self.diffuse(&fragments);
        let glossy = self.glossy(&fragments);
        let irradiance = fragments.over_pixels(&diffuse.light);
        let filtered = self.filter(&fragments, &irradiance, size)?;
        let lit: Vec<Vec3> = fragments
            .all
            .iter()
            .map(|fragment| fragment.diffuse / PI * filtered[fragment.pixel as usize])
            .collect();
        let mut stages = Stages {
            direct: fragments.over_pixels(&direct),
            diffuse: fragments.over_pixels(&lit),
            glossy: fragments.over_pixels(&glossy.light),
            irradiance,
            filtered,
            picture: Vec::new(),
            rays: diffuse.rays + glossy.rays,
        };
        let sum = stages
            .direct
            .iter()
            .zip(&stages.diffuse)
            .zip(&stages.glossy);
        stages.picture = sum.map(|((&a, &b), &c)| a + b + c).collect();
        Ok(stages)
    }

    /// Stage 2. Lights with an extent take several rays.
    fn direct(&self, fragments: &Fragments) -> Vec<Vec3> {
        let count = self.params.light_rays;
        let radiance = |(index, fragment): (usize, &Fragment)| {
            let mut sum = [Vec3::ZERO];
            for number in 0..count {
                let sampler = Sampler::new(self.params.seed, 4 * index as u32, number);
                self.direct
                    .estimate(&fragment.point, fragment.view, &sampler, &mut sum);
            }
            sum[0] / count as f32
        };
        fragments.all.par_iter().enumerate().map(radiance).collect()
    }

    /// Stage 4. Only surfaces that scatter diffusely count, so that neither the background nor metal darkens them: how
    /// much of a pixel they fill is filtered too.
    fn filter(
        &self,
        fragments: &Fragments,
        irradiance: &[Vec3],
        [width, height]: [u32; 2],
    ) -> Result<Vec<Vec3>> {
        let scatters = |fragment: &Fragment| {
            let scatters = fragment.diffuse != Vec3::ZERO;
            Vec3::splat(f32::from(u8::from(scatters)))
        };
        let scatters: Vec<Vec3> = fragments.all.iter().map(scatters).collect();
        let filled = fragments.over_pixels(&scatters);
        let values: Vec<Vec4> = irradiance
            .iter()
            .zip(filled)
            .map(|(light, filled)| light.extend(filled.x))
            .collect();
        let (width, height) = (width as usize, height as usize);
        let view = ImageView::new(bytemuck::cast_slice(&values), width, height, 4)?;
        let mut filtered = vec![Vec4::ZERO; values.len()];
        self.gaussian
            .apply(view, bytemuck::cast_slice_mut(&mut filtered))?;
        let mean = |sum: &Vec4| {
            if sum.w > 0.0 {
                sum.truncate() / sum.w
            } else {
                Vec3::ZERO
            }
        };
        Ok(filtered.iter().map(mean).collect())
    }
}

impl Stages {
    /// The picture in R, G, B, and a layer for each stage: `direct`, `diffuse`, `glossy`, `irradiance.indirect` and
    /// `irradiance.noisy`.
    pub fn image(&self, [width, height]: [u32; 2]) -> Image {
        let mut image = Image::new(width, height);
        image.push_layer("", "RGB", &self.picture);
        image.push_layer("direct", "RGB", &self.direct);
        image.push_layer("diffuse", "RGB", &self.diffuse);
        image.push_layer("glossy", "RGB", &self.glossy);
        image.push_layer("irradiance.indirect", "RGB", &self.filtered);
        image.push_layer("irradiance.noisy", "RGB", &self.irradiance);
        image
    }
}
