//! `isophote compare`: how far a picture is from a reference.

use std::{
    borrow::Cow,
    path::{Path, PathBuf},
    process::ExitCode,
};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use glam::Vec3;
use isophote_scene::{Image, check_writable};
use serde::Serialize;

use crate::{
    bake::COVERAGE,
    display::{Look, false_color},
    metrics::{Errors, constant_like, silhouettes},
    output::{print, print_json},
};

const EXAMPLES: &str = "\
Errors are of linear light, over all pixels and channels:
  relRMSE  sqrt(mean((test − reference)²)) / mean(reference)
  rms      255·sqrt(mean((test − reference)²)), in grey levels, the headline for ao and obscurance
  bias     mean(test)/mean(reference) − 1, or 255·(mean(test) − mean(reference)) in grey levels
'Beyond the noise' is what remains after subtracting the squares of both pictures' own noise: the header attribute \
'noise', or 'relative_noise' in a .json beside the file. PSNR, SSIM and FLIP compare what a screen shows (sRGB) and \
are no errors of light. Of lightmaps only texels on surfaces count.

Examples:
  isophote compare mine.exr reference.exr
  isophote compare both.exr reference.ao.exr --layer ao --error-image error.png
  isophote compare mine.exr reference.exr --max-relrmse 0.04 --json   (exit code 1 if it is worse)";

/// Measure how far a picture is from a reference.
#[derive(Args, Debug)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CompareArgs {
    /// The picture to judge: .exr, .hdr or .png (taken as sRGB)
    test: PathBuf,
    /// What it should be
    reference: PathBuf,
    /// Compare this layer ('ao' stands for ao.R, ao.G, ao.B) instead of the picture in R, G, B
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// What the pictures show; by default what their headers say. It only chooses the headline.
    #[arg(long, value_name = "NAME")]
    quantity: Option<String>,
    /// Write where they differ: .png shows |difference| in false colour, .exr keeps the signed difference
    #[arg(long, value_name = "FILE")]
    error_image: Option<PathBuf>,
    /// Brighten both by this many stops for PSNR, SSIM and FLIP
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, value_parser = crate::values::finite, allow_hyphen_values = true)]
    exposure: f32,
    /// Exit with code 1 when relRMSE beyond the noise is above this fraction (0.04 is 4 %)
    #[arg(long, value_name = "FRACTION", value_parser = crate::values::not_negative)]
    max_relrmse: Option<f32>,
    /// Exit with code 1 when the rms beyond the noise is above this many grey levels
    #[arg(long, value_name = "LEVELS", value_parser = crate::values::not_negative)]
    max_rms: Option<f32>,
    /// Print the numbers as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    test: PathBuf,
    reference: PathBuf,
    layer: Option<String>,
    quantity: Option<String>,
    width: u32,
    height: u32,
    /// `rms` for ao and obscurance, `relrmse` for all else.
    headline: &'static str,
    #[serde(flatten)]
    errors: Errors,
    noise_test: Option<f64>,
    noise_reference: Option<f64>,
    rel_rmse_beyond_noise: f64,
    grey_rms_beyond_noise: f64,
    /// How many times worse a constant image of the reference's mean colour does.
    constant_ratio: f64,
    silhouettes: Option<Silhouettes>,
    exposure: f32,
    #[serde(flatten)]
    look: Look,
}

/// Errors at the edges of things and between them.
#[derive(Serialize)]
struct Silhouettes {
    /// Share of the pixels.
    share: f64,
    rel_rmse: f64,
    rel_rmse_elsewhere: f64,
    grey_rms: f64,
    grey_rms_elsewhere: f64,
}

/// A picture with what its file says about it.
struct Picture {
    pixels: Vec<Vec3>,
    quantity: Option<String>,
    noise: Option<f64>,
}

pub(crate) fn compare(args: &CompareArgs) -> Result<ExitCode> {
    if let Some(path) = &args.error_image {
        ensure!(
            crate::output::has_suffix(path, &["exr", "png"]),
            "{}: unknown suffix; .exr and .png are known",
            path.display()
        );
        check_writable(path)?;
    }
    let (test_image, reference_image) = (Image::load(&args.test)?, Image::load(&args.reference)?);
    let size = [test_image.width, test_image.height];
    let other = [reference_image.width, reference_image.height];
    if size != other {
        bail!(
            "{} has {}×{} pixels, but {} has {}×{}",
            args.test.display(),
            size[0],
            size[1],
            args.reference.display(),
            other[0],
            other[1]
        );
    }
    let layer = args.layer.as_deref();
    let test = Picture::of(&test_image, &args.test, layer)?;
    let reference = Picture::of(&reference_image, &args.reference, layer)?;
    let report = measure(
        args,
        size,
        &test,
        &reference,
        &[&test_image, &reference_image],
    );
    if let Some(path) = &args.error_image {
        write_error_image(path, &report, &test.pixels, &reference.pixels)?;
    }
    if args.json {
        print_json(&report)?;
    } else {
        print(&report.text())?;
    }
    // NaN, from a black reference, is no pass.
    let passes = |limit: Option<f32>, value: f64| limit.is_none_or(|limit| value <= limit.into());
    let passed = passes(args.max_relrmse, report.rel_rmse_beyond_noise)
        && passes(args.max_rms, report.grey_rms_beyond_noise);
    Ok(ExitCode::from(u8::from(!passed)))
}

impl Picture {
    fn of(image: &Image, path: &Path, layer: Option<&str>) -> Result<Self> {
        let record = Record::beside(path)?;
        let quantity = image
            .attributes
            .get("quantity")
            .cloned()
            .or_else(|| record.as_ref().and_then(Record::quantity));
        // A file of one quantity has it in R, G, B, one of several has each in a layer of its own.
        let (found, pixels) = match layer {
            Some(layer) => match colors(image, layer) {
                Some(pixels) => (layer, Some(pixels)),
                None if quantity.as_deref().is_none_or(|quantity| quantity == layer) => {
                    ("", colors(image, ""))
                }
                None => (layer, None),
            },
            None => ("", colors(image, "")),
        };
        let Some(pixels) = pixels else {
            let wanted = layer.map_or("picture in R, G, B".into(), |name| {
                format!("layer '{name}'")
            });
            bail!(
                "{}: has no {wanted}; choose with --layer from: {}",
                path.display(),
                layers(image).join(", ")
            );
        };
        let broken = |pixel: &Vec3| !pixel.is_finite();
        if let Some(first) = pixels.iter().position(broken) {
            bail!(
                "{}: {} of {} pixels are NaN or infinite, the first at ({}, {})",
                path.display(),
                pixels.iter().filter(|pixel| broken(pixel)).count(),
                pixels.len(),
                first as u32 % image.width,
                first as u32 / image.width
            );
        }
        let attribute = match found {
            "" => "noise".to_owned(),
            layer => format!("noise.{layer}"),
        };
        let noise = image
            .attributes
            .get(&attribute)
            .and_then(|text| text.parse().ok())
            .or_else(|| record.and_then(|record| record.relative_noise));
        Ok(Self {
            pixels,
            quantity: layer.map(str::to_owned).or(quantity),
            noise: noise.filter(|noise: &f64| noise.is_finite()),
        })
    }

    /// Those of its pixels that count.
    fn only(&self, counted: Option<&[f32]>) -> Cow<'_, [Vec3]> {
        let Some(counted) = counted else {
            return Cow::Borrowed(&self.pixels);
        };
        let pixels = self.pixels.iter().zip(counted);
        let chosen = pixels.filter(|(_, counts)| **counts > 0.0);
        chosen.map(|(pixel, _)| *pixel).collect()
    }
}

/// The colours of a layer, or its one grey channel three times.
fn colors(image: &Image, layer: &str) -> Option<Vec<Vec3>> {
    let prefix = if layer.is_empty() {
        String::new()
    } else {
        format!("{layer}.")
    };
    image.rgb(layer).or_else(|| {
        let grey = image
            .channel(&format!("{prefix}Y"))
            .or_else(|| image.channel(&format!("{prefix}Z")))
            .or_else(|| image.channel(layer))?;
        Some(grey.iter().map(|&value| Vec3::splat(value)).collect())
    })
}

fn layers(image: &Image) -> Vec<&str> {
    let mut names: Vec<&str> = image
        .channels
        .iter()
        .filter_map(|channel| channel.name.rsplit_once('.').map(|(layer, _)| layer))
        .collect();
    names.dedup();
    names
}

/// What is known of a reference whose file has no header of ours: the .json beside it.
#[derive(serde::Deserialize)]
struct Record {
    quantity: Option<String>,
    relative_noise: Option<f64>,
}

impl Record {
    fn beside(path: &Path) -> Result<Option<Self>> {
        let path = path.with_extension("json");
        let Ok(text) = std::fs::read_to_string(&path) else {
            return Ok(None);
        };
        let record = serde_json::from_str(&text)
            .with_context(|| format!("{}: not the record of a reference", path.display()))?;
        Ok(Some(record))
    }

    /// `ao_1.5m` is `ao` with a distance.
    fn quantity(&self) -> Option<String> {
        let name = self.quantity.as_deref()?;
        Some(
            name.split_once('_')
                .map_or(name, |(name, _)| name)
                .to_owned(),
        )
    }
}

fn measure(
    args: &CompareArgs,
    size: [u32; 2],
    test: &Picture,
    reference: &Picture,
    images: &[&Image],
) -> Report {
    let counted = counted(images);
    let [of_test, of_reference] = [test, reference].map(|picture| picture.only(counted));
    let errors = Errors::of(&of_test, &of_reference);
    let constant = Errors::of(&constant_like(&of_reference), &of_reference);
    let noises = [test.noise, reference.noise].map(|noise| noise.unwrap_or(0.0));
    let quantity = args
        .quantity
        .clone()
        .or_else(|| test.quantity.clone())
        .or_else(|| reference.quantity.clone());
    let headline = match quantity.as_deref() {
        Some("ao" | "obscurance") => "rms",
        _ => "relrmse",
    };
    Report {
        test: args.test.clone(),
        reference: args.reference.clone(),
        layer: args.layer.clone(),
        quantity,
        width: size[0],
        height: size[1],
        headline,
        errors,
        noise_test: test.noise,
        noise_reference: reference.noise,
        rel_rmse_beyond_noise: errors.rel_rmse_beyond(noises[0], noises[1]),
        grey_rms_beyond_noise: errors.grey_rms_beyond(noises[0], noises[1]),
        constant_ratio: constant.grey_rms / errors.grey_rms,
        silhouettes: images
            .iter()
            .find_map(|image| Silhouettes::of(image, &test.pixels, &reference.pixels)),
        exposure: args.exposure,
        look: Look::of(size, &test.pixels, &reference.pixels, args.exposure),
    }
}

/// The pixels that count, where a picture is a lightmap: those that were computed.
fn counted<'a>(images: &[&'a Image]) -> Option<&'a [f32]> {
    images.iter().find_map(|image| image.channel(COVERAGE))
}

impl Silhouettes {
    /// Where an image has the layers to tell.
    fn of(image: &Image, test: &[Vec3], reference: &[Vec3]) -> Option<Self> {
        let depths = image.channel("depth.Z")?;
        let [x, y, z] = ["normal.X", "normal.Y", "normal.Z"].map(|name| image.channel(name));
        let (x, y, z) = (x?, y?, z?);
        let normals: Vec<Vec3> = (0..x.len()).map(|i| Vec3::new(x[i], y[i], z[i])).collect();
        let edge = silhouettes(image.width as usize, depths, &normals);
        let part = |wanted: bool| {
            let pick = |pixels: &[Vec3]| -> Vec<Vec3> {
                let chosen = pixels
                    .iter()
                    .zip(&edge)
                    .filter(|(_, edge)| **edge == wanted);
                chosen.map(|(pixel, _)| *pixel).collect()
            };
            Errors::of(&pick(test), &pick(reference))
        };
        let (on, off) = (part(true), part(false));
        Some(Self {
            share: edge.iter().filter(|edge| **edge).count() as f64 / edge.len() as f64,
            rel_rmse: on.rel_rmse,
            rel_rmse_elsewhere: off.rel_rmse,
            grey_rms: on.grey_rms,
            grey_rms_elsewhere: off.grey_rms,
        })
    }
}

impl Report {
    fn grey(&self) -> bool {
        self.headline == "rms"
    }

    fn text(&self) -> String {
        let e = &self.errors;
        let rms = format!(
            "rms        {:.3} grey levels, {:.3} beyond the noise; bias {:+.3}\n",
            e.grey_rms, self.grey_rms_beyond_noise, e.grey_bias
        );
        let relative = format!(
            "relRMSE    {:.3} %, {:.3} % beyond the noise; bias {:+.3} %\n",
            100.0 * e.rel_rmse,
            100.0 * self.rel_rmse_beyond_noise,
            100.0 * e.bias
        );
        let (first, second) = if self.grey() {
            (rms, relative)
        } else {
            (relative, rms)
        };
        let percent = |noise: Option<f64>| {
            noise.map_or("unknown".into(), |noise| format!("{:.3} %", 100.0 * noise))
        };
        let mut text = format!(
            "compared   {} with {} ({}×{}, {})\n{first}{second}\
             noise      {} and {} (relRMSE of test and reference)\n\
             means      {:.5} and {:.5}\n\
             constant   an image of the reference's mean colour does {:.1} times worse{}\n",
            self.test.display(),
            self.reference.display(),
            self.width,
            self.height,
            self.quantity.as_deref().unwrap_or("quantity unknown"),
            percent(self.noise_test),
            percent(self.noise_reference),
            e.mean_test,
            e.mean_reference,
            self.constant_ratio,
            if self.constant_ratio < 5.0 {
                ": this error shows little"
            } else {
                ""
            },
        );
        if let Some(edges) = &self.silhouettes {
            let line = if self.grey() {
                format!(
                    "rms {:.3} grey levels there, {:.3}",
                    edges.grey_rms, edges.grey_rms_elsewhere
                )
            } else {
                format!(
                    "relRMSE {:.3} % there, {:.3} %",
                    100.0 * edges.rel_rmse,
                    100.0 * edges.rel_rmse_elsewhere
                )
            };
            text += &format!(
                "edges      {:.1} % of the pixels; {line} elsewhere\n",
                100.0 * edges.share
            );
        }
        text += &format!(
            "look       PSNR {:.2} dB, SSIM {:.4}, FLIP {:.4} (sRGB, exposure {})\n",
            self.look.psnr, self.look.ssim, self.look.flip, self.exposure
        );
        text
    }
}

/// Where two pictures differ, in false colour, and what the lightest colour stands for: 64 grey levels or the reference's
/// mean.
pub(crate) fn error_colors(
    size: [u32; 2],
    test: &[Vec3],
    reference: &[Vec3],
    grey: bool,
) -> (Vec<Vec3>, f32) {
    let full = if grey {
        64.0 / 255.0
    } else {
        Errors::of(test, reference).mean_reference as f32
    };
    let differences = test.iter().zip(reference).map(|(a, b)| *a - *b);
    let values: Vec<f32> = differences
        .map(|difference| difference.abs().max_element() / full)
        .collect();
    (false_color(size, &values), full)
}

fn write_error_image(
    path: &Path,
    report: &Report,
    test: &[Vec3],
    reference: &[Vec3],
) -> Result<()> {
    let mut image = Image::new(report.width, report.height);
    if crate::output::has_suffix(path, &["exr"]) {
        let differences = test.iter().zip(reference).map(|(a, b)| *a - *b);
        image.push_layer("", "RGB", &differences.collect::<Vec<_>>());
    } else {
        let size = [report.width, report.height];
        let (colors, full) = error_colors(size, test, reference, report.grey());
        let said = if report.grey() {
            "64 grey levels".to_owned()
        } else {
            format!("{full} (the reference's mean)")
        };
        image.push_layer("", "RGB", &colors);
        image
            .attributes
            .insert("error".into(), format!("black is 0, light yellow {said}"));
    }
    for (name, file) in [("test", &report.test), ("reference", &report.reference)] {
        image
            .attributes
            .insert(name.into(), file.display().to_string());
    }
    Ok(image.save(path)?)
}
