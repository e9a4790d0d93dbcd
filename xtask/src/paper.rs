//! `cargo xtask paper`: what a paper showed, made again, with its numbers beside ours.
//!
//! Each page is one HTML file with its pictures inside, and the same numbers as JSON beside it. Everything is measured
//! by `isophote` and by the crates' own benches; here it is only put together.

mod field;
mod igi;
mod lab;
mod ldi;
mod ldm;
mod page;
mod plot;
mod report;

use anyhow::Result;

/// Make a paper's tables and figures again, into target/paper
#[derive(clap::Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    paper: Paper,
}

#[derive(clap::Subcommand)]
enum Paper {
    Ldi(ldi::Arguments),
    Ldm(ldm::Arguments),
    Igi(igi::Arguments),
    Field(field::Arguments),
}

/// Makes one page.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.paper {
        Paper::Ldi(arguments) => ldi::run(arguments),
        Paper::Ldm(arguments) => ldm::run(arguments),
        Paper::Igi(arguments) => igi::run(arguments),
        Paper::Field(arguments) => field::run(arguments),
    }
}
