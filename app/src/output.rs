//! What the program prints, and how.

use std::{
    io::{self, Write},
    path::Path,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, ensure};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressFinish, ProgressStyle};
use serde::Serialize;

/// Writes text to standard output.
pub(crate) fn print(text: &str) -> Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())?;
    Ok(out.flush()?)
}

/// Writes a value as JSON to standard output. NaN and infinities become `null`.
pub(crate) fn print_json(value: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value).context("the report cannot be put in JSON")?;
    print(&(text + "\n"))
}

/// Says things on standard error, unless told to be quiet.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Voice {
    quiet: bool,
}

impl Voice {
    pub(crate) fn new(quiet: bool) -> Self {
        Self { quiet }
    }

    /// Something chosen for the user.
    pub(crate) fn note(self, text: impl std::fmt::Display) {
        self.say("note", &text);
    }

    /// Something that may not be what the user meant.
    pub(crate) fn warning(self, text: impl std::fmt::Display) {
        self.say("warning", &text);
    }

    /// How far work is, on standard error; indicatif hides it where that is no terminal.
    pub(crate) fn bar(self) -> ProgressBar {
        let bar = ProgressBar::with_draw_target(Some(0), self.target());
        styled(bar, "{wide_bar} {percent:>3} %  {elapsed}, {eta} left")
    }

    /// That there is work whose end is not known; gone when it is dropped.
    pub(crate) fn wheel(self, what: &'static str) -> ProgressBar {
        let bar = ProgressBar::with_draw_target(None, self.target());
        let bar = styled(bar, "{spinner} {msg}, {elapsed}").with_message(what);
        bar.enable_steady_tick(Duration::from_millis(200));
        bar.with_finish(ProgressFinish::AndClear)
    }

    fn target(self) -> ProgressDrawTarget {
        if self.quiet {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr()
        }
    }

    fn say(self, kind: &str, text: &dyn std::fmt::Display) {
        if !self.quiet {
            // Nobody listens: no reason to stop the work.
            let _ = writeln!(io::stderr(), "{kind}: {text}");
        }
    }
}

/// Tells a bar how far work is.
pub(crate) fn advance(bar: &ProgressBar) -> impl Fn(u64, u64) + Sync + '_ {
    |done, total| {
        bar.set_length(total);
        bar.set_position(bar.position().max(done));
    }
}

fn styled(bar: ProgressBar, template: &str) -> ProgressBar {
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Whether a file's name ends in one of some suffixes (without dot, lower case).
pub(crate) fn has_suffix(path: &Path, known: &[&str]) -> bool {
    path.extension()
        .and_then(|suffix| suffix.to_str())
        .is_some_and(|suffix| known.contains(&suffix.to_ascii_lowercase().as_str()))
}

/// A result and the seconds it took.
pub(crate) fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}

/// The program, as it stands in headers and reports.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Program {
    pub(crate) version: &'static str,
    /// The commit it was built of, where that is known.
    pub(crate) commit: Option<&'static str>,
}

pub(crate) const PROGRAM: Program = Program {
    version: env!("CARGO_PKG_VERSION"),
    commit: option_env!("ISOPHOTE_COMMIT"),
};

/// What computes: the processor, by the name it gives itself.
pub(crate) fn device() -> String {
    let name = std::fs::read_to_string("/proc/cpuinfo")
        .ok()
        .and_then(|text| {
            let line = text.lines().find(|line| line.starts_with("model name"))?;
            Some(line.split_once(':')?.1.trim().to_owned())
        });
    format!(
        "cpu: {}",
        name.unwrap_or_else(|| std::env::consts::ARCH.to_owned())
    )
}

/// The most memory the program has held, or what it holds now where the system does not tell.
pub(crate) fn memory_peak_bytes() -> Option<u64> {
    proc_kibibytes("/proc/self/status", "VmHWM:")
        .or_else(|| memory_stats::memory_stats().map(|stats| stats.physical_mem as u64))
}

/// The memory that could still be taken, where the system tells.
fn memory_available_bytes() -> Option<u64> {
    let free = proc_kibibytes("/proc/meminfo", "MemAvailable:");
    free.into_iter().chain(address_space_bytes()).min()
}

/// What `ulimit -v` leaves, where it is set: an allocation beyond it ends the program.
fn address_space_bytes() -> Option<u64> {
    let limits = std::fs::read_to_string("/proc/self/limits").ok()?;
    let line = limits
        .lines()
        .find_map(|line| line.strip_prefix("Max address space"))?;
    let limit: u64 = line.split_whitespace().next()?.parse().ok()?;
    let taken = proc_kibibytes("/proc/self/status", "VmSize:")?;
    Some(limit.saturating_sub(taken))
}

/// Refuses what needs more memory than there is; `flag` says what asks for it.
pub(crate) fn check_available(needed: u64, flag: &str) -> Result<()> {
    if let Some(available) = memory_available_bytes() {
        ensure!(
            needed <= available,
            "{flag}: needs about {:.1} GiB of memory, but only {:.1} are free",
            gibibytes(needed),
            gibibytes(available)
        );
    }
    Ok(())
}

pub(crate) fn gibibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 30)
}

fn proc_kibibytes(file: &str, key: &str) -> Option<u64> {
    let text = std::fs::read_to_string(file).ok()?;
    let value = text.lines().find_map(|line| line.strip_prefix(key))?;
    let kibibytes: u64 = value.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(1024 * kibibytes)
}
