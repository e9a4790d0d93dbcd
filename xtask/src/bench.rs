//! `cargo xtask bench`: measurements, as JSON.

mod trace;

use anyhow::Result;

/// Measure, and print the results as JSON
#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    Trace(trace::Arguments),
}

/// Runs one benchmark.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.what {
        What::Trace(arguments) => trace::run(arguments),
    }
}
