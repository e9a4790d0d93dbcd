//! A picture by both tracers, and which part of its error is the tracer's.

use std::path::Path;

use anyhow::{Context, Result};
use glam::Vec3;
use isophote_scene::{
    Image,
    reference::{Quantity, Settings},
};
use serde::Serialize;

use super::{CertifyArgs, Size};
use crate::{
    display::false_color,
    metrics::Errors,
    output::{Voice, advance, has_suffix},
    reference::{Ground, Order},
    tracers::{Choice, Plan},
};

/// Where a picture's error comes from.
#[derive(Serialize)]
pub(super) struct OfPicture {
    quantity: &'static str,
    /// Then grey levels are what counts.
    #[serde(skip)]
    is_occlusion: bool,
    samples: u32,
    /// Of the tracer, against the exact one with the same samples.
    visibility: Errors,
    /// Of the exact tracer, against itself with other samples, as of one picture.
    noise: Noise,
}

#[derive(Clone, Copy, Serialize)]
struct Noise {
    rel_rmse: f64,
    grey_rms: f64,
}

/// One quantity, rendered three times.
pub(super) struct Pictures {
    /// By the exact tracer.
    exact: Vec<Vec3>,
    /// By the tracer, with the same samples.
    tracer: Vec<Vec3>,
    /// By the exact tracer with other samples.
    again: Vec<Vec3>,
}

impl Pictures {
    pub(super) fn render(
        args: &CertifyArgs,
        choice: Choice,
        quantity: Quantity,
        plan: &Plan<'_>,
        voice: Voice,
    ) -> Result<Self> {
        let exact = args.picture(choice.exact(), quantity, plan, args.seed, voice)?;
        let again = args.picture(
            choice.exact(),
            quantity,
            plan,
            args.seed.wrapping_add(1),
            voice,
        )?;
        Ok(Self {
            exact,
            tracer: args.picture(choice, quantity, plan, args.seed, voice)?,
            again,
        })
    }

    pub(super) fn errors(&self, quantity: Quantity, samples: u32) -> OfPicture {
        // Both pictures have noise, and it is independent.
        let other = Errors::of(&self.again, &self.exact);
        OfPicture {
            quantity: quantity.name(),
            is_occlusion: quantity.is_occlusion(),
            samples,
            visibility: Errors::of(&self.tracer, &self.exact),
            noise: Noise {
                rel_rmse: other.rel_rmse / std::f64::consts::SQRT_2,
                grey_rms: other.grey_rms / std::f64::consts::SQRT_2,
            },
        }
    }

    /// What visibility changes, and what noise does, signed.
    fn differences(&self) -> [Vec<Vec3>; 2] {
        let of = |one: &[Vec3], scale: f32| {
            let pairs = one.iter().zip(&self.exact);
            pairs
                .map(|(&one, &exact)| scale * (one - exact))
                .collect::<Vec<_>>()
        };
        [
            of(&self.tracer, 1.0),
            of(&self.again, std::f32::consts::FRAC_1_SQRT_2),
        ]
    }

    pub(super) fn write(&self, path: &Path, size: Size) -> Result<()> {
        let differences = self.differences();
        if has_suffix(path, &["png"]) {
            return self
                .sheet(size, &differences)
                .save_png(path, 0.0)
                .map_err(Into::into);
        }
        let mut image = Image::new(size[0], size[1]);
        image.push_layer("", "RGB", &self.tracer);
        image.push_layer("exact", "RGB", &self.exact);
        image.push_layer("tracer", "RGB", &self.tracer);
        image.push_layer("visibility", "RGB", &differences[0]);
        image.push_layer("noise", "RGB", &differences[1]);
        Ok(image.save(path)?)
    }

    /// Exact beside the tracer's, and below them where visibility and where noise changes how much.
    fn sheet(&self, [width, height]: Size, differences: &[Vec<Vec3>; 2]) -> Image {
        let largest = |values: &[Vec3]| {
            let mut sizes: Vec<f32> = values
                .iter()
                .map(|value| value.abs().element_sum())
                .collect();
            sizes.sort_by(f32::total_cmp);
            sizes.get(sizes.len() * 99 / 100).copied().unwrap_or(0.0)
        };
        let scale = largest(&differences[0])
            .max(largest(&differences[1]))
            .max(f32::MIN_POSITIVE);
        let [visibility, noise] = differences.each_ref().map(|values| {
            let shares: Vec<f32> = values
                .iter()
                .map(|value| value.abs().element_sum() / scale)
                .collect();
            false_color([width, height], &shares)
        });
        let (columns, rows) = (width as usize, height as usize);
        let mut pixels = Vec::with_capacity(4 * columns * rows);
        for [left, right] in [[&self.exact, &self.tracer], [&visibility, &noise]] {
            for row in 0..rows {
                for half in [left, right] {
                    pixels.extend_from_slice(&half[row * columns..(row + 1) * columns]);
                }
            }
        }
        let mut image = Image::new(2 * width, 2 * height);
        image.push_layer("", "RGB", &pixels);
        image
    }
}

impl CertifyArgs {
    /// A quantity by one tracer.
    fn picture(
        &self,
        choice: Choice,
        quantity: Quantity,
        plan: &Plan<'_>,
        seed: u64,
        voice: Voice,
    ) -> Result<Vec<Vec3>> {
        let ground = Ground::build(choice, self.adapter.as_deref(), plan)?;
        let settings = Settings {
            d_max: self.d_max,
            samples: self.spp,
            seed,
            ..Settings::default()
        };
        let order = Order {
            camera: plan.camera,
            size: self.size,
            quantities: &[quantity],
            settings: &settings,
            selection: plan.selection,
            min_d: None,
            maps: plan.args.depth_maps.params(),
        };
        let bar = voice.bar();
        let made = ground.render(plan.scene, order, &advance(&bar));
        bar.finish_and_clear();
        let estimates = made?.render.estimates.into_iter();
        let values = estimates.map(|estimate| estimate.values).next();
        values.context("nothing was rendered")
    }
}

impl OfPicture {
    pub(super) fn text(&self) -> String {
        let [errors, noise] = if self.is_occlusion {
            let grey = |value: f64| format!("{value:.2} grey levels");
            [grey(self.visibility.grey_rms), grey(self.noise.grey_rms)]
        } else {
            let share = |value: f64| format!("{:.2} %", 100.0 * value);
            [share(self.visibility.rel_rmse), share(self.noise.rel_rmse)]
        };
        format!(
            "\n{} with {} samples a pixel: rms {errors} by visibility (bias {:+.2} %), {noise} by noise\n",
            self.quantity,
            self.samples,
            100.0 * self.visibility.bias
        )
    }
}
