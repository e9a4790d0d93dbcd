//! `cargo xtask bench bake`: a lightmap of ambient occlusion by layered depth maps and by exact rays, at equal error.
//!
//! Both bake the same texels of one atlas, with more and more maps or rays until the RMS error against a converged bake is
//! small enough; then the times of these two are compared. Errors are of texels that are on a surface, not of those between.

use std::{fs, path::PathBuf};

use anyhow::{Context, Result, bail};
use serde::Serialize;
use serde_json::Value;

use super::write;
use crate::{
    isophote::{Isophote, Source},
    machine::Machine,
    workspace::Workspace,
};

/// Seconds of a lightmap by layered depth maps and by exact rays at equal error
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// A .glb or .gltf file
    #[arg(
        long,
        value_name = "FILE",
        default_value = "../shared/scenes/sponza_dabrovic.glb"
    )]
    scene: String,
    /// How far occlusion looks, in metres; may be given more than once
    #[arg(long, value_name = "METRES", default_values = ["inf"])]
    d_max: Vec<String>,
    /// Texels on each side
    #[arg(long, default_value_t = 2048)]
    size: u32,
    /// The RMS error to be reached, in grey levels
    #[arg(long, default_value_t = 4.0)]
    rms: f64,
    /// Rays a texel of the converged bake
    #[arg(long, default_value_t = 512)]
    reference: u32,
    /// Rays a texel to begin with
    #[arg(long, default_value_t = 8)]
    samples: u32,
    /// Maps to begin with
    #[arg(long, default_value_t = 16)]
    maps: u32,
    /// A map has at most R² pixels; may be given more than once
    #[arg(long, value_name = "R", default_values = ["128", "200"])]
    resolution: Vec<u32>,
    /// Threads
    #[arg(long, default_value_t = 2)]
    threads: u32,
    /// Where to write the results; standard output unless given
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    source: Source,
}

#[derive(Serialize)]
struct Report<'a> {
    machine: Machine,
    scene: &'a str,
    size: u32,
    threads: u32,
    wanted_grey_rms: f64,
    comparisons: Vec<Comparison>,
}

#[derive(Serialize)]
struct Comparison {
    d_max: String,
    reference_samples: u32,
    reference_seconds: f64,
    /// Texels that are computed.
    receivers: u64,
    /// By exact rays, with more of them from case to case.
    rays: Vec<Case>,
    /// By layered depth maps, alike, for every resolution.
    maps: Vec<Case>,
    /// What the wanted error takes by each, between two cases by their logarithms; none where it was not reached.
    rays_seconds: Option<f64>,
    maps_seconds: Option<f64>,
    /// How many times as fast the maps are.
    speedup: Option<f64>,
}

/// One bake and its error.
#[derive(Serialize)]
struct Case {
    flags: String,
    /// Of computing values, without loading, the atlas and building trees.
    seconds: f64,
    /// Of all these too.
    seconds_in_all: f64,
    grey_rms: f64,
    /// Without the noise of the converged bake.
    error: f64,
    grey_bias: f64,
    /// How many times worse a constant lightmap is.
    constant_ratio: f64,
}

/// Most steps until an error is small enough.
const MOST: u32 = 64;

/// Steps in which a number doubles: fine ones, since each number of maps is another set of directions, some of which fit a scene
/// better than others.
const STEPS: u32 = 8;

/// Bakes and writes the report.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let folder = Workspace::load()?.target_directory.join("bench");
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let bench = Bench {
        arguments,
        isophote: arguments.source.isophote()?,
        folder,
    };
    let comparisons = arguments.d_max.iter().map(|d_max| bench.compare(d_max));
    let report = Report {
        machine: Machine::current(),
        scene: &arguments.scene,
        size: arguments.size,
        threads: arguments.threads,
        wanted_grey_rms: arguments.rms,
        comparisons: comparisons.collect::<Result<_>>()?,
    };
    write(&report, arguments.json.as_deref())
}

struct Bench<'a> {
    arguments: &'a Arguments,
    isophote: Isophote,
    folder: PathBuf,
}

impl Bench<'_> {
    fn compare(&self, d_max: &str) -> Result<Comparison> {
        let samples = self.arguments.reference;
        // Another seed, so that its noise is its own.
        let flags = format!("--samples {samples} --seed 1000");
        let reference = self.bake(d_max, &flags, "reference.exr")?;
        let rays = self.until(d_max, |step| {
            format!("--samples {}", steps(self.arguments.samples, step))
        })?;
        let mut maps = Vec::new();
        for resolution in &self.arguments.resolution {
            maps.push(self.until(d_max, |step| {
                let maps = steps(self.arguments.maps, step);
                format!("--technique ldm --ldm-maps {maps} --ldm-resolution {resolution}")
            })?);
        }
        let wanted = self.arguments.rms;
        let rays_seconds = seconds_at(&rays, wanted);
        let maps_seconds = maps.iter().filter_map(|cases| seconds_at(cases, wanted));
        let maps_seconds = maps_seconds.min_by(f64::total_cmp);
        Ok(Comparison {
            d_max: d_max.to_owned(),
            reference_samples: samples,
            reference_seconds: number(&reference, "/seconds/light")?,
            receivers: number(&reference, "/receivers")? as u64,
            speedup: rays_seconds
                .zip(maps_seconds)
                .map(|(rays, maps)| rays / maps),
            rays_seconds,
            maps_seconds,
            rays,
            maps: maps.into_iter().flatten().collect(),
        })
    }

    /// Bakes with more from step to step, until the error is small enough.
    fn until(&self, d_max: &str, flags: impl Fn(u32) -> String) -> Result<Vec<Case>> {
        let mut cases: Vec<Case> = Vec::new();
        for step in 0..=MOST {
            let case = self.case(d_max, flags(step))?;
            let error = case.error;
            eprintln!(
                "d_max {d_max}, {}: {:.2} s, {error:.2} grey levels",
                case.flags, case.seconds
            );
            // What twice as many maps of one resolution do not change is their resolution's error.
            let before = cases.len().checked_sub(STEPS as usize);
            let is_stuck = before.is_some_and(|before| error > 0.9 * cases[before].error);
            cases.push(case);
            if error <= self.arguments.rms || is_stuck {
                break;
            }
        }
        Ok(cases)
    }

    fn case(&self, d_max: &str, flags: String) -> Result<Case> {
        let baked = self.bake(d_max, &flags, "test.exr")?;
        let [test, reference] = [self.file("test.exr"), self.file("reference.exr")];
        let errors =
            self.isophote
                .json(&["compare", "--json", "--quantity=ao", &test, &reference])?;
        let grey_rms = number(&errors, "/grey_rms")?;
        // The test's own noise is its error here.
        let noise =
            255.0 * number(&errors, "/noise_reference")? * number(&errors, "/mean_reference")?;
        let parts = ["load", "layout", "build", "light"];
        let parts = parts.map(|part| number(&baked, &format!("/seconds/{part}")));
        Ok(Case {
            flags,
            seconds: number(&baked, "/seconds/light")?,
            seconds_in_all: parts.into_iter().sum::<Result<f64>>()?,
            grey_rms,
            error: (grey_rms.powi(2) - noise.powi(2)).max(0.0).sqrt(),
            grey_bias: number(&errors, "/grey_bias")?,
            constant_ratio: number(&errors, "/constant_ratio")?,
        })
    }

    fn bake(&self, d_max: &str, flags: &str, file: &str) -> Result<Value> {
        let (size, threads) = (
            self.arguments.size.to_string(),
            self.arguments.threads.to_string(),
        );
        let file = self.file(file);
        let mut words = vec![
            "bake",
            &self.arguments.scene,
            "--to=texels",
            "--json",
            "--quiet",
        ];
        words.extend(["--size", &size, "--threads", &threads, "--d-max", d_max]);
        words.extend(flags.split_whitespace());
        words.extend(["-o", &file]);
        self.isophote.json(&words)
    }

    fn file(&self, name: &str) -> String {
        self.folder.join(name).display().to_string()
    }
}

/// A number that doubles every so many steps.
fn steps(first: u32, step: u32) -> u32 {
    (f64::from(first) * (f64::from(step) / f64::from(STEPS)).exp2()).round() as u32
}

/// The seconds at which an error would be reached, between the last case above it and the first one below.
fn seconds_at(cases: &[Case], wanted: f64) -> Option<f64> {
    let good = cases.iter().position(|case| case.error <= wanted)?;
    let below = &cases[good];
    let Some(above) = good.checked_sub(1).map(|bad| &cases[bad]) else {
        return Some(below.seconds);
    };
    let part = (above.error / wanted).ln() / (above.error / below.error).ln();
    Some(above.seconds * (below.seconds / above.seconds).powf(part))
}

fn number(value: &Value, path: &str) -> Result<f64> {
    match value.pointer(path).and_then(Value::as_f64) {
        Some(number) => Ok(number),
        None => bail!("the report has no number {path}"),
    }
}
