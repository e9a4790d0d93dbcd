//! The `isophote` binary: built in release, run with arguments, its JSON read.

use std::{
    path::PathBuf,
    process::{Command, Stdio},
};

use anyhow::{Context, Result, bail};
use serde_json::Value;

use crate::workspace::{cargo, output, root};

/// Which `isophote` a command drives.
#[derive(clap::Args)]
pub(crate) struct Source {
    /// Drive this `isophote` instead of building one
    #[arg(long = "isophote", value_name = "FILE")]
    executable: Option<PathBuf>,
}

/// The application, ready to run.
#[derive(Clone)]
pub(crate) struct Isophote {
    executable: PathBuf,
}

impl Source {
    /// The one that was named, or this workspace's, built in release; cargo says what it does.
    pub(crate) fn isophote(&self) -> Result<Isophote> {
        if let Some(named) = &self.executable {
            let executable = std::path::absolute(named)?;
            return Ok(Isophote { executable });
        }
        let messages = output(&mut cargo([
            "build",
            "--release",
            "--package=isophote",
            "--message-format=json-render-diagnostics",
        ]))?;
        let executable = messages
            .lines()
            .filter_map(|line| serde_json::from_str::<Value>(line).ok())
            .find_map(|message| Some(PathBuf::from(message.get("executable")?.as_str()?)))
            .context("cargo built the package `isophote` but named no executable")?;
        Ok(Isophote { executable })
    }
}

impl Isophote {
    /// Runs it in the workspace's root and returns the JSON it prints.
    pub(crate) fn json(&self, arguments: &[&str]) -> Result<Value> {
        let printed = self.run(arguments)?;
        serde_json::from_slice(&printed)
            .with_context(|| format!("`isophote {}` printed no JSON", arguments.join(" ")))
    }

    /// Runs it in the workspace's root and returns what it prints; its error message becomes ours.
    pub(crate) fn run(&self, arguments: &[&str]) -> Result<Vec<u8>> {
        let output = Command::new(&self.executable)
            .current_dir(root())
            .args(arguments)
            .stdin(Stdio::null())
            .output()
            .with_context(|| format!("could not start {}", self.executable.display()))?;
        if !output.status.success() {
            bail!(
                "`isophote {}` failed ({}): {}",
                arguments.join(" "),
                output.status,
                String::from_utf8_lossy(&output.stderr).trim()
            );
        }
        Ok(output.stdout)
    }
}
