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
    /// How far occlusion looks [metres]; may be given more than once
    #[arg(long, value_name = "METRES", default_values = ["inf"])]
    d_max: Vec<String>,
    /// Texels on each side
    #[arg(long, default_value_t = 2048)]
    size: u32,
    /// The RMS error to be reached [grey levels]
    #[arg(long, default_value_t = 4.0)]
    rms: f64,
    /// Rays a texel of the converged bake
    #[arg(long, default_value_t = 1024)]
    reference: u32,
    /// Rays a texel to begin with
    #[arg(long, default_value_t = 8)]
    samples: u32,
    /// Maps to begin with
    #[arg(long, default_value_t = 32)]
    maps: u32,
    /// A map has at most R² pixels; may be given more than once
    #[arg(long, value_name = "R", default_values = ["256", "512"])]
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
    /// How many times as fast the fastest maps are as the rays, both at the wanted error; none where that was not reached.
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
    /// Without what the converged bake's own noise explains.
    grey_rms_beyond_noise: f64,
    grey_bias: f64,
    /// How many times worse a constant lightmap is.
    constant_ratio: f64,
}

/// Most doublings until an error is small enough.
const MOST: u32 = 8;

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
            format!("--samples {}", self.arguments.samples << step)
        })?;
        let mut maps = Vec::new();
        for resolution in &self.arguments.resolution {
            maps.extend(self.until(d_max, |step| {
                let maps = self.arguments.maps << step;
                format!("--technique ldm --ldm-maps {maps} --ldm-resolution {resolution}")
            })?);
        }
        let is_good = |case: &&Case| case.grey_rms_beyond_noise <= self.arguments.rms;
        let fastest = |cases: &[Case]| {
            let seconds = cases.iter().filter(is_good).map(|case| case.seconds);
            seconds.min_by(f64::total_cmp)
        };
        Ok(Comparison {
            d_max: d_max.to_owned(),
            reference_samples: samples,
            reference_seconds: number(&reference, "/seconds/light")?,
            receivers: number(&reference, "/receivers")? as u64,
            speedup: fastest(&rays)
                .zip(fastest(&maps))
                .map(|(rays, maps)| rays / maps),
            rays,
            maps,
        })
    }

    /// Bakes with twice as much from step to step, until the error is small enough.
    fn until(&self, d_max: &str, flags: impl Fn(u32) -> String) -> Result<Vec<Case>> {
        let mut cases: Vec<Case> = Vec::new();
        for step in 0..=MOST {
            let case = self.case(d_max, flags(step))?;
            let error = case.grey_rms_beyond_noise;
            eprintln!(
                "d_max {d_max}, {}: {:.2} s, {error:.2} grey levels",
                case.flags, case.seconds
            );
            // What more maps of one resolution do not change is their resolution's error.
            let is_stuck = cases
                .last()
                .is_some_and(|last| error > 0.95 * last.grey_rms_beyond_noise);
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
        let parts = ["load", "layout", "build", "light"];
        let parts = parts.map(|part| number(&baked, &format!("/seconds/{part}")));
        Ok(Case {
            flags,
            seconds: number(&baked, "/seconds/light")?,
            seconds_in_all: parts.into_iter().sum::<Result<f64>>()?,
            grey_rms: number(&errors, "/grey_rms")?,
            grey_rms_beyond_noise: number(&errors, "/grey_rms_beyond_noise")?,
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

fn number(value: &Value, path: &str) -> Result<f64> {
    match value.pointer(path).and_then(Value::as_f64) {
        Some(number) => Ok(number),
        None => bail!("the report has no number {path}"),
    }
}
