//! `cargo xtask test`: everything CI runs.
//!
//! The steps run from the quickest to the slowest, and all of them run even if one fails, so that one look at the
//! output shows everything there is to repair. They share cargo's build directory and its flags: warnings become
//! errors through clippy's and rustdoc's own arguments, since another `RUSTFLAGS` would build all dependencies again.

mod display;
mod structure;
mod tools;
mod validator;
mod vulkan;

use std::time::{Duration, Instant};

use anyhow::{Result, bail};

use crate::workspace::{Package, Workspace, cargo, root, run as run_command};

/// Run everything CI runs: structure, format, lints, feature combinations, docs, tests and doc tests
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Only these steps: tools, structure, format, lints, features, docs, tests, doctests
    #[arg(value_name = "STEP", value_parser = STEPS.map(|step| step.name))]
    steps: Vec<String>,
    /// Only say which tools are missing; otherwise root on Debian or Ubuntu gets them with apt-get, and the
    /// Khronos validator comes with npm where that is; announced
    #[arg(long)]
    no_install: bool,
}

struct Step {
    name: &'static str,
    run: fn(&Arguments, &Workspace) -> Result<()>,
}

const STEPS: [Step; 8] = [
    Step {
        name: "tools",
        run: |arguments, _| {
            tools::require(!arguments.no_install)?;
            validator::provide(!arguments.no_install);
            vulkan::provide(!arguments.no_install)?;
            display::provide(!arguments.no_install)
        },
    },
    Step {
        name: "structure",
        run: |_, workspace| structure::check(workspace),
    },
    Step {
        name: "format",
        run: |_, _| run_command(&mut cargo(["fmt", "--all", "--check"])),
    },
    Step {
        name: "lints",
        run: |_, _| run_command(&mut clippy(&["--workspace", "--all-targets"])),
    },
    Step {
        name: "features",
        run: |_, workspace| features(workspace),
    },
    Step {
        name: "docs",
        run: |_, _| {
            run_command(
                cargo(["doc", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-D warnings"),
            )
        },
    },
    Step {
        name: "tests",
        run: |_, _| test(&["--lib", "--bins", "--tests", "--examples"]),
    },
    Step {
        name: "doctests",
        run: |_, _| test(&["--doc"]),
    },
];

/// Runs the steps, says how each ended and how long it took, and fails if one failed.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let workspace = Workspace::load()?;
    let mut outcomes = Vec::new();
    let chosen = |step: &&Step| {
        arguments.steps.is_empty() || arguments.steps.iter().any(|name| name == step.name)
    };
    for step in STEPS.iter().filter(chosen) {
        eprintln!("\n==> {}", step.name);
        let start = Instant::now();
        let result = (step.run)(arguments, &workspace);
        if let Err(error) = &result {
            eprintln!("{error:#}");
        }
        let failed = result.is_err();
        outcomes.push((step.name, !failed, start.elapsed()));
        if failed && step.name == "tools" {
            break;
        }
    }
    summarize(&outcomes)
}

fn summarize(outcomes: &[(&str, bool, Duration)]) -> Result<()> {
    println!();
    for (name, passed, time) in outcomes {
        let outcome = if *passed { "ok" } else { "FAILED" };
        println!("{name:<10} {outcome:<6} {:>8.1} s", time.as_secs_f64());
    }
    let total: Duration = outcomes.iter().map(|(_, _, time)| time).sum();
    println!("{:<10} {:<6} {:>8.1} s", "total", "", total.as_secs_f64());
    let failed = outcomes.iter().filter(|(_, passed, _)| !passed).count();
    println!("steps: {} passed, {failed} failed", outcomes.len() - failed);
    if failed > 0 {
        bail!("`cargo xtask test STEP` runs a failed step alone");
    }
    Ok(())
}

/// A crate must build alone with every set of features a user may choose: none, each, all; and its tests, examples
/// and benches with the defaults.
fn features(workspace: &Workspace) -> Result<()> {
    let combinations = workspace.packages.iter().flat_map(combinations);
    let failed: Vec<_> = combinations
        .filter_map(|combination| {
            let words: Vec<_> = combination.iter().map(String::as_str).collect();
            run_command(&mut clippy(&words)).err()
        })
        .map(|error| error.to_string())
        .collect();
    if !failed.is_empty() {
        bail!("{}", failed.join("\n"));
    }
    Ok(())
}

/// The arguments that choose a package and its features, once for every combination.
fn combinations(package: &Package) -> Vec<Vec<String>> {
    let chosen = |more: &[&str]| {
        let words = ["--package", &package.name]
            .into_iter()
            .chain(more.iter().copied());
        words.map(str::to_owned).collect::<Vec<_>>()
    };
    let mut combinations = vec![chosen(&["--all-targets"])];
    let features = package.features.keys().filter(|name| *name != "default");
    let single: Vec<_> = features
        .map(|name| chosen(&["--no-default-features", "--features", name]))
        .collect();
    if !single.is_empty() {
        combinations.push(chosen(&["--no-default-features"]));
        combinations.extend(single);
        combinations.push(chosen(&["--all-features"]));
    }
    combinations
}

/// Clippy with warnings as errors. It shares its dependencies' artefacts with `cargo check`.
fn clippy(arguments: &[&str]) -> std::process::Command {
    let ends = [&["clippy", "--quiet"], arguments, &["--", "-D", "warnings"]].concat();
    cargo(ends)
}

fn test(targets: &[&str]) -> Result<()> {
    let arguments = [&["test", "--workspace", "--no-fail-fast"], targets].concat();
    let mut command = cargo(arguments);
    // Tests compile far more shaders than they run, and llvmpipe compiles for vectors of 128 bits in half of the time. Its
    // cache does not tell these from others, and a mixture crashes: they get a cache of their own.
    if std::env::var_os("LP_NATIVE_VECTOR_WIDTH").is_none() {
        command.env("LP_NATIVE_VECTOR_WIDTH", "128");
        command.env("MESA_SHADER_CACHE_DIR", root().join("target/llvmpipe-128"));
    }
    // Where there is none, the loaders of some drivers complain on standard error, which tests read line by line.
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        command.env("XDG_RUNTIME_DIR", root().join("target"));
    }
    run_command(&mut command)
}
