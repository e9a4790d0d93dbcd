//! The Khronos validator (npm `gltf-validator`), where it is.

use std::{
    path::{Path, PathBuf},
    process::Command,
    sync::OnceLock,
};

use serde_json::Value;

/// Reads files named as arguments and prints a list of reports.
const SCRIPT: &str = "
const validator = require('gltf-validator'), fs = require('fs'), path = require('path');
const beside = file => uri => fs.promises.readFile(path.join(path.dirname(file), decodeURIComponent(uri)));
const report = async file => {
  const options = { uri: file, externalResourceFunction: beside(file), maxIssues: 1000 };
  try {
    const found = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), options);
    return found.issues.messages.filter(message => message.severity == 0);
  } catch (error) {
    return [String(error)];
  }
};
Promise.all(process.argv.slice(1).map(report)).then(all => console.log(JSON.stringify(all)));
";

/// Where `cargo xtask test` puts it.
fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/gltf-validator/node_modules")
}

fn node(files: &[&Path]) -> Option<Vec<Value>> {
    let output = Command::new("node")
        .args(["-e", SCRIPT])
        .args(files)
        .env("NODE_PATH", folder())
        .output()
        .ok()?;
    serde_json::from_slice(&output.stdout).ok()
}

fn is_there() -> bool {
    static FOUND: OnceLock<bool> = OnceLock::new();
    *FOUND.get_or_init(|| {
        let found = node(&[]).is_some();
        if !found {
            eprintln!("skipped: no Khronos validator; `cargo xtask test tools` installs it where npm is there");
        }
        found
    })
}

/// The errors that the validator finds in each file; none where it is not there.
pub(crate) fn errors(files: &[&Path]) -> Vec<Vec<Value>> {
    if !is_there() {
        return vec![Vec::new(); files.len()];
    }
    let found = node(files).expect("the validator's answer");
    let list = |report: Value| report.as_array().expect("a list").clone();
    found.into_iter().map(list).collect()
}

/// Fails if the validator finds an error.
pub(crate) fn check(file: &Path) {
    let found = errors(&[file]).remove(0);
    assert!(found.is_empty(), "{}: {found:#?}", file.display());
}
