//! The Khronos validator of glTF files, for the tests of `isophote bake`: the npm package `gltf-validator`, into `target`.
//!
//! Without it those tests say that they are skipped: nothing else needs node and npm.

use std::process::{Command, Stdio};

use crate::workspace::{root, run};

const PACKAGE: &str = "gltf-validator";

/// Sees to the validator where node and npm are there, or says what is missing. Never a reason to fail.
pub(super) fn provide(install: bool) {
    let folder = root().join("target").join(PACKAGE);
    if folder.join("node_modules").join(PACKAGE).is_dir() {
        return;
    }
    let is_there = |program: &str| {
        let version = Command::new(program)
            .arg("--version")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        version.is_ok_and(|status| status.success())
    };
    let mut npm = Command::new("npm");
    npm.args(["install", "--no-audit", "--no-fund", "--prefix"])
        .arg(&folder)
        .arg(PACKAGE);
    if install && is_there("node") && is_there("npm") {
        match run(&mut npm) {
            Ok(()) => return,
            Err(error) => eprintln!("{error:#}"),
        }
    }
    eprintln!(
        "missing: the Khronos validator, for the tests of `isophote bake`, which skip it. To run it, have node and npm, and: \
         npm install --prefix target/{PACKAGE} {PACKAGE}"
    );
}
