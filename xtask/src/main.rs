//! `cargo xtask`: what CI runs, the demo page and the benchmarks.
//!
//! One file per command. There is no graphics code here: every command drives cargo or the `isophote` binary.

mod test;
mod workspace;

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
}

fn main() -> anyhow::Result<()> {
    match Command::parse() {
        Command::Test(arguments) => test::run(&arguments),
    }
}
