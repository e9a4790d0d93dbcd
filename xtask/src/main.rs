//! `cargo xtask`: what CI runs, the demo page, the papers' pages and the benchmarks.
//!
//! One file per command. There is no graphics code here: every command drives cargo or the `isophote` binary.

mod bench;
mod demo;
mod html;
mod isophote;
mod machine;
mod paper;
mod reference;
mod test;
mod workspace;

use std::process::ExitCode;

use clap::Parser;

/// The commands of this workspace beside cargo's own.
#[derive(Parser)]
#[command(
    name = "xtask",
    bin_name = "cargo xtask",
    arg_required_else_help = true
)]
enum Command {
    Test(test::Arguments),
    Demo(demo::Arguments),
    Bench(bench::Arguments),
    Paper(paper::Arguments),
    Reference(reference::Arguments),
}

fn main() -> ExitCode {
    let result = match Command::parse() {
        Command::Test(arguments) => test::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
        Command::Paper(arguments) => paper::run(&arguments),
        Command::Reference(arguments) => reference::run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
