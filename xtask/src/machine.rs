//! What stands beside every measured number: the machine, the toolchain and the commit.

use std::process::Command;

use serde::Serialize;

use crate::workspace::root;

/// Where and of what a measurement was made.
#[derive(Serialize)]
pub(crate) struct Machine {
    /// The processor's own name.
    pub(crate) cpu: String,
    /// Threads that run at once.
    pub(crate) threads: usize,
    /// `linux x86_64` and the like.
    pub(crate) system: String,
    /// The compiler's version.
    pub(crate) rustc: String,
    /// The commit's hash, with ` and changes` where files differ from it.
    pub(crate) commit: String,
}

impl Machine {
    /// Asks the system; what it does not say is `unknown`.
    pub(crate) fn current() -> Self {
        let commit = first_line("git", &["rev-parse", "--short=12", "HEAD"]);
        let changed = first_line("git", &["status", "--porcelain"]).is_some();
        let unknown = || "unknown".to_owned();
        Self {
            cpu: cpu().unwrap_or_else(unknown),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            rustc: first_line("rustc", &["--version"]).unwrap_or_else(unknown),
            commit: commit.map_or_else(unknown, |commit| {
                commit + if changed { " and changes" } else { "" }
            }),
        }
    }
}

fn cpu() -> Option<String> {
    let of_linux = || {
        let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
        let line = text.lines().find(|line| line.starts_with("model name"))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    };
    of_linux().or_else(|| first_line("sysctl", &["-n", "machdep.cpu.brand_string"]))
}

/// The first line a program prints; `None` where it fails or prints nothing.
fn first_line(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program)
        .args(arguments)
        .current_dir(root())
        .output()
        .ok()
        .filter(|output| output.status.success())?;
    let text = String::from_utf8(output.stdout).ok()?;
    text.lines().next().map(|line| line.trim().to_owned())
}
