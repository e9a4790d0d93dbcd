//! `cargo xtask bench`: measurements, as JSON.

mod bake;
mod filters;
mod trace;

use std::{fs, path::Path};

use anyhow::{Context, Result};
use serde::Serialize;

/// Measure, and print the results as JSON
#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    Bake(bake::Arguments),
    Filters(filters::Arguments),
    Trace(trace::Arguments),
}

/// Runs one benchmark.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.what {
        What::Bake(arguments) => bake::run(arguments),
        What::Filters(arguments) => filters::run(arguments),
        What::Trace(arguments) => trace::run(arguments),
    }
}

/// Writes a report to a file, or prints it.
fn write(report: &impl Serialize, path: Option<&Path>) -> Result<()> {
    let text = serde_json::to_string_pretty(report)? + "\n";
    match path {
        None => print!("{text}"),
        Some(path) => {
            fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
        }
    }
    Ok(())
}
