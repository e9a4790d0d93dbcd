//! A virtual screen for the test of the viewer: Xvfb, what types and clicks there, and what a window loads on Linux.
//!
//! Without them that test says that it is skipped, unless the environment variable `ISOPHOTE_REQUIRE_GPU` is 1, as CI
//! sets it.

use std::{env, process::Command};

use anyhow::Result;

use super::tools::may_use_apt;
use crate::workspace::run;

const PROGRAMS: [&str; 2] = ["Xvfb", "xdotool"];
const PACKAGES: [&str; 7] = [
    "xvfb",
    "xdotool",
    "libx11-6",
    "libx11-xcb1",
    "libxcursor1",
    "libxi6",
    "libxkbcommon-x11-0",
];

/// Sees to a screen, or says what is missing. Only Linux is looked after.
pub(super) fn provide(install: bool) -> Result<()> {
    if !cfg!(target_os = "linux") || is_there() {
        return Ok(());
    }
    eprintln!("missing: a virtual screen, for the test of `isophote view`");
    if !install || !may_use_apt() {
        eprintln!(
            "It will be skipped. To run it: sudo apt-get install {}",
            PACKAGES.join(" ")
        );
        return Ok(());
    }
    eprintln!("installing {} with apt-get", PACKAGES.join(", "));
    run(Command::new("apt-get").args(["update", "--quiet"]))?;
    run(Command::new("apt-get")
        .args(["install", "--yes", "--quiet", "--no-install-recommends"])
        .args(PACKAGES)
        .env("DEBIAN_FRONTEND", "noninteractive"))
}

/// Whether the programs are, and where Debian's package manager is, the libraries that are loaded at run time.
fn is_there() -> bool {
    let paths = env::var_os("PATH").unwrap_or_default();
    let has = |program: &&str| env::split_paths(&paths).any(|folder| folder.join(program).exists());
    let status = Command::new("dpkg-query")
        .args(["--show", "--showformat=${db:Status-Status}\n"])
        .args(PACKAGES)
        .output();
    let installed = status.map_or(true, |output| {
        let text = String::from_utf8_lossy(&output.stdout);
        text.lines().filter(|line| *line == "installed").count() == PACKAGES.len()
    });
    PROGRAMS.iter().all(has) && installed
}
