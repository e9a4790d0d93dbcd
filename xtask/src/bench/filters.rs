//! `cargo xtask bench filters`: how close joint bilateral upsampling comes at silhouettes, and how long the Gaussian
//! takes. The crate's example `silhouettes` and its bench `gaussian` measure.

use std::path::PathBuf;

use anyhow::{Context, Result};
use serde::Serialize;
use serde_json::Value;

use super::write;
use crate::{
    machine::Machine,
    workspace::{cargo, output},
};

/// Errors of upsampled irradiance at silhouettes, and the time of the 11×11 Gaussian in one thread
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// A glTF file or builtin:NAME whose irradiance is upsampled; may be given more than once
    #[arg(long = "scene", value_name = "SCENE", default_values = ["builtin:office"])]
    scenes: Vec<String>,
    /// Pixels in a row
    #[arg(long, default_value_t = 800)]
    width: u32,
    /// Rows
    #[arg(long, default_value_t = 600)]
    height: u32,
    /// Paths of a pixel, half of them for each of two independent pictures
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(2..))]
    samples: u32,
    /// Every how manieth pixel is given, in both directions
    #[arg(long, default_value_t = 4)]
    factor: u32,
    /// A Python with the package opencv-python-headless, whose `GaussianBlur` is measured in turns with ours
    #[arg(long, value_name = "FILE")]
    python: Option<PathBuf>,
    /// Where to write the results; standard output unless given
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Serialize)]
struct Report {
    machine: Machine,
    /// As the example and the bench print them.
    silhouettes: Vec<Value>,
    gaussian: Value,
}

/// Measures and writes the report.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let report = Report {
        machine: Machine::current(),
        silhouettes: arguments
            .scenes
            .iter()
            .map(|scene| silhouettes(arguments, scene))
            .collect::<Result<_>>()?,
        gaussian: gaussian(arguments)?,
    };
    write(&report, arguments.json.as_deref())
}

fn silhouettes(arguments: &Arguments, scene: &str) -> Result<Value> {
    eprintln!("{scene}: rendering its irradiance");
    let Arguments {
        width,
        height,
        samples,
        factor,
        ..
    } = arguments;
    let mut command = cargo([
        "run",
        "--release",
        "--quiet",
        "--package=isophote-filters",
        "--example=silhouettes",
        "--",
        scene,
    ]);
    command.args([width, height, samples, factor].map(u32::to_string));
    serde_json::from_str(&output(&mut command)?).context("the example printed no JSON")
}

fn gaussian(arguments: &Arguments) -> Result<Value> {
    eprintln!("Gaussian 11x11");
    let mut command = cargo([
        "bench",
        "--quiet",
        "--package=isophote-filters",
        "--bench=gaussian",
    ]);
    if let Some(python) = &arguments.python {
        command.env("ISOPHOTE_PYTHON", python);
    }
    serde_json::from_str(&output(&mut command)?).context("the bench printed no JSON")
}
