//! The programs that building and testing need beside cargo.

use std::{
    path::Path,
    process::{Command, Stdio},
};

use anyhow::{Result, bail};

use crate::workspace::run;

struct Tool {
    /// Succeeds where the tool is there.
    probe: &'static [&'static str],
    /// Who misses it.
    needed_by: &'static str,
    source: Source,
}

#[derive(Clone, Copy)]
enum Source {
    /// A package of Debian and Ubuntu.
    Apt(&'static str),
    /// A component of the Rust toolchain.
    Rustup(&'static str),
}

const TOOLS: [Tool; 3] = [
    Tool {
        probe: &["cargo", "fmt", "--version"],
        needed_by: "the step `format`",
        source: Source::Rustup("rustfmt"),
    },
    Tool {
        probe: &["cargo", "clippy", "--version"],
        needed_by: "the steps `lints` and `features`",
        source: Source::Rustup("clippy"),
    },
    Tool {
        probe: &["c++", "--version"],
        needed_by: "the crates meshopt and nv-flip, which build C++",
        source: Source::Apt("g++"),
    },
];

/// Fails, naming the remedy, if a tool is missing. With `install`, root on Debian or Ubuntu gets what apt has.
pub(super) fn require(install: bool) -> Result<()> {
    let missing: Vec<_> = TOOLS.iter().filter(|tool| !is_there(tool.probe)).collect();
    for tool in &missing {
        eprintln!(
            "missing: `{}`, for {}",
            tool.probe.join(" "),
            tool.needed_by
        );
    }
    let apt: Vec<_> = missing
        .iter()
        .filter_map(|tool| match tool.source {
            Source::Apt(package) => Some(package),
            Source::Rustup(_) => None,
        })
        .collect();
    if !apt.is_empty() && install && may_use_apt() {
        eprintln!("installing {} with apt-get", apt.join(", "));
        run(Command::new("apt-get").args(["update", "--quiet"]))?;
        run(Command::new("apt-get")
            .args(["install", "--yes", "--quiet"])
            .args(&apt)
            .env("DEBIAN_FRONTEND", "noninteractive"))?;
    }
    let remedies: Vec<_> = missing
        .iter()
        .filter(|tool| !is_there(tool.probe))
        .map(|tool| match tool.source {
            Source::Apt(package) => {
                format!("sudo apt-get install {package} (or your system's package of that name)")
            }
            Source::Rustup(component) => format!("rustup component add {component}"),
        })
        .collect();
    if !remedies.is_empty() {
        bail!("install what is missing:\n  {}", remedies.join("\n  "));
    }
    Ok(())
}

fn is_there(probe: &[&str]) -> bool {
    Command::new(probe[0])
        .args(&probe[1..])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// Root on Debian, Ubuntu and their like.
pub(super) fn may_use_apt() -> bool {
    let is_root = Command::new("id")
        .arg("-u")
        .output()
        .is_ok_and(|output| output.stdout.trim_ascii() == b"0");
    is_root && Path::new("/etc/debian_version").exists()
}
