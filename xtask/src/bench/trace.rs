//! `cargo xtask bench trace`: how many rays a second a tracer answers, and how many times as many as the exact one.
//!
//! Every repeat measures each case once, by the tracer and by the exact one, so that a machine that slows down for a while
//! slows all cases alike and the ratios between their medians hold.

use std::{fs, path::PathBuf};

use anyhow::{Context, Result};
use serde::Serialize;
use serde_json::Value;

use super::write;
use crate::{
    isophote::{Isophote, Source},
    machine::Machine,
    workspace::Workspace,
};

/// Rays per second of closest and any hit, coherent and diffuse rays, one thread and all
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// A scene file or builtin:NAME; may be given more than once
    #[arg(long = "scene", value_name = "SCENE", default_values = ["builtin:atrium", "builtin:office", "builtin:hairball"])]
    scenes: Vec<String>,
    /// The tracer to measure, beside the exact one, which is bvh on the CPU and compute-bvh on a GPU; that alone unless given
    #[arg(long)]
    tracer: Option<String>,
    /// How the tracer bvh holds instances: auto, flat or two
    #[arg(long, value_parser = ["auto", "flat", "two"])]
    bvh_levels: Option<String>,
    /// Where to trace: cpu or gpu
    #[arg(long, default_value = "cpu", value_parser = ["cpu", "gpu"])]
    device: String,
    /// A part of the name of the GPU to use; the fastest unless given
    #[arg(long)]
    adapter: Option<String>,
    /// Rays of each kind
    #[arg(long, default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1..))]
    count: u32,
    /// Measurements of each case, whose median counts
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    repeats: u32,
    /// Seed of the rays
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Where to write the results; standard output unless given
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    source: Source,
}

#[derive(Serialize)]
struct Report<'a> {
    machine: Machine,
    settings: Settings<'a>,
    scenes: Vec<SceneReport>,
}

#[derive(Serialize)]
struct Settings<'a> {
    tracer: Option<&'a str>,
    bvh_levels: Option<&'a str>,
    device: &'a str,
    adapter: Option<&'a str>,
    rays: u32,
    repeats: u32,
    seed: u64,
}

#[derive(Serialize)]
struct SceneReport {
    scene: String,
    #[serde(flatten)]
    measured: TracerReport,
    /// Whom it is compared with; none where that is the one that was measured.
    exact: Option<TracerReport>,
    cases: Vec<Case>,
    ratios: Vec<Ratio>,
}

/// What the application says of a tracer.
#[derive(Default, Serialize)]
struct TracerReport {
    tracer: Option<String>,
    device: Option<String>,
    /// Seconds to build it and bytes it holds, where the application says so.
    build_seconds: Option<f64>,
    bytes: Option<u64>,
}

impl TracerReport {
    fn of(report: &Value) -> Self {
        Self {
            tracer: report["tracer"].as_str().map(str::to_owned),
            device: report["device"].as_str().map(str::to_owned),
            build_seconds: report["build_seconds"].as_f64(),
            bytes: report["bytes"].as_u64(),
        }
    }
}

/// By whom rays are traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum By {
    /// The tracer that is measured.
    Measured,
    /// The exact one that it is compared with.
    Exact,
}

/// One tracer, one kind of rays, one question, one number of threads.
#[derive(Serialize)]
struct Case {
    by: By,
    rays: &'static str,
    mode: &'static str,
    threads: usize,
    median_rays_per_second: f64,
    rays_per_second: Vec<f64>,
    /// Without the way to the GPU and back, by its own clock.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    kernel_rays_per_second: Vec<f64>,
}

/// How many times as fast one case is as another, by their medians.
#[derive(Serialize)]
struct Ratio {
    what: &'static str,
    by: By,
    #[serde(skip_serializing_if = "Option::is_none")]
    rays: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mode: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    threads: Option<usize>,
    ratio: f64,
}

const KINDS: [&str; 2] = ["coherent", "diffuse"];
const MODES: [&str; 2] = ["closest", "any"];

/// Measures every scene and writes the report.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let isophote = arguments.source.isophote()?;
    let machine = Machine::current();
    let folder = Workspace::load()?.target_directory.join("bench");
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let bench = Bench {
        arguments,
        isophote,
        folder,
        threads: machine.threads,
    };
    let scenes = arguments
        .scenes
        .iter()
        .map(|scene| bench.scene(scene))
        .collect::<Result<_>>()?;
    let settings = Settings {
        tracer: arguments.tracer.as_deref(),
        bvh_levels: arguments.bvh_levels.as_deref(),
        device: &arguments.device,
        adapter: arguments.adapter.as_deref(),
        rays: arguments.count,
        repeats: arguments.repeats,
        seed: arguments.seed,
    };
    let report = Report {
        machine,
        settings,
        scenes,
    };
    write(&report, arguments.json.as_deref())
}

struct Bench<'a> {
    arguments: &'a Arguments,
    isophote: Isophote,
    folder: PathBuf,
    threads: usize,
}

impl Bench<'_> {
    fn scene(&self, scene: &str) -> Result<SceneReport> {
        for kind in KINDS {
            eprintln!("{scene}: making {kind} rays");
            let (count, seed) = (self.arguments.count, self.arguments.seed);
            let (count, seed, rays) = (count.to_string(), seed.to_string(), self.file(kind));
            let mut make = vec![
                "trace", scene, "--make", kind, "--count", &count, "-o", &rays,
            ];
            // Nothing is random in coherent rays.
            if kind != "coherent" {
                make.extend(["--seed", &seed]);
            }
            self.isophote.run(&make)?;
        }
        let mut threads = vec![1, self.threads];
        threads.dedup();
        // A GPU does not mind how many threads wait for it.
        if self.arguments.device == "gpu" {
            threads = vec![self.threads];
        }
        let exact = self.exact();
        let tracers = [(By::Measured, true), (By::Exact, exact.is_some())];
        let tracers = tracers.into_iter().filter_map(|(by, is)| is.then_some(by));
        // What is compared is measured one after the other.
        let mut cases: Vec<_> = threads
            .iter()
            .flat_map(|&threads| KINDS.map(|kind| (threads, kind)))
            .flat_map(|(threads, rays)| MODES.map(|mode| (threads, rays, mode)))
            .flat_map(|case| tracers.clone().map(move |by| (by, case)))
            .map(|(by, (threads, rays, mode))| Case {
                by,
                rays,
                mode,
                threads,
                median_rays_per_second: 0.0,
                rays_per_second: Vec::new(),
                kernel_rays_per_second: Vec::new(),
            })
            .collect();
        let mut said = [TracerReport::default(), TracerReport::default()];
        for repeat in 1..=self.arguments.repeats {
            for case in &mut cases {
                let report = TracerReport::of(&self.measure(scene, case)?);
                let rate = case.rays_per_second.last().copied().unwrap_or_default();
                eprintln!(
                    "{scene}: {repeat}/{} {} {} hit, {} threads, {}: {:.2} million rays/s",
                    self.arguments.repeats,
                    case.rays,
                    case.mode,
                    case.threads,
                    report.tracer.as_deref().unwrap_or_default(),
                    rate / 1e6
                );
                said[case.by as usize] = report;
            }
        }
        for case in &mut cases {
            case.median_rays_per_second = median(&case.rays_per_second);
        }
        let [measured, compared] = said;
        Ok(SceneReport {
            scene: scene.to_owned(),
            measured,
            exact: exact.map(|_| compared),
            ratios: ratios(&cases),
            cases,
        })
    }

    /// The exact tracer of the device, unless it is the one that is measured.
    fn exact(&self) -> Option<&'static str> {
        let exact = match self.arguments.device.as_str() {
            "gpu" => "compute-bvh",
            _ => "bvh",
        };
        let measured = self.arguments.tracer.as_deref();
        (measured.unwrap_or(exact) != exact).then_some(exact)
    }

    /// Traces the rays of a case once and keeps the rate.
    fn measure(&self, scene: &str, case: &mut Case) -> Result<Value> {
        let mut choice = vec!["--device", self.arguments.device.as_str()];
        let (tracer, levels) = match case.by {
            By::Measured => (
                self.arguments.tracer.as_deref(),
                self.arguments.bvh_levels.as_deref(),
            ),
            By::Exact => (self.exact(), None),
        };
        for (flag, value) in [
            ("--tracer", tracer),
            ("--bvh-levels", levels),
            ("--adapter", self.arguments.adapter.as_deref()),
        ] {
            choice.extend(value.iter().flat_map(|value| [flag, value]));
        }
        let trace = [
            "trace",
            scene,
            "--mode",
            case.mode,
            "--threads",
            &case.threads.to_string(),
            "--rays",
            &self.file(case.rays),
            "-o",
            &self.file("hits"),
            "--json",
        ];
        let report = self.isophote.json(&[&trace[..], &choice].concat())?;
        let rate = report["rays_per_second"]
            .as_f64()
            .context("`isophote trace --json` printed no `rays_per_second`")?;
        case.rays_per_second.push(rate);
        let on_device = report["kernel_seconds"].as_f64();
        case.kernel_rays_per_second
            .extend(on_device.map(|seconds| f64::from(self.arguments.count) / seconds));
        Ok(report)
    }

    fn file(&self, name: &str) -> String {
        let path = self.folder.join(name).with_extension("npy");
        path.to_string_lossy().into_owned()
    }
}

/// The tracer over the exact one, any hit over closest hit, diffuse over coherent rays, all threads over one.
fn ratios(cases: &[Case]) -> Vec<Ratio> {
    let mut ratios = Vec::new();
    for case in cases {
        let over = |by: By, rays: &str, mode: &str, threads: usize| {
            let is_base = |base: &&Case| {
                (base.by, base.rays, base.mode, base.threads) == (by, rays, mode, threads)
            };
            let base = cases.iter().find(is_base)?;
            Some(case.median_rays_per_second / base.median_rays_per_second)
        };
        let Case {
            by,
            rays,
            mode,
            threads,
            ..
        } = *case;
        let exact = over(By::Exact, rays, mode, threads).filter(|_| by == By::Measured);
        let any = over(by, rays, "closest", threads).filter(|_| mode == "any");
        let diffuse = over(by, "coherent", mode, threads).filter(|_| rays == "diffuse");
        let all = over(by, rays, mode, 1).filter(|_| threads > 1);
        let (rays, mode, threads) = (Some(rays), Some(mode), Some(threads));
        let found = [
            ("tracer / exact tracer", rays, mode, threads, exact),
            ("any / closest", rays, None, threads, any),
            ("diffuse / coherent", None, mode, threads, diffuse),
            ("all threads / one", rays, mode, None, all),
        ];
        ratios.extend(
            found
                .into_iter()
                .filter_map(|(what, rays, mode, threads, ratio)| {
                    Some(Ratio {
                        what,
                        by,
                        rays,
                        mode,
                        threads,
                        ratio: ratio?,
                    })
                }),
        );
    }
    ratios
}

/// The middle value, or the mean of the two in the middle.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    match sorted.len() % 2 {
        _ if sorted.is_empty() => 0.0,
        0 => (sorted[middle - 1] + sorted[middle]) / 2.0,
        _ => sorted[middle],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_in_the_middle() {
        assert_eq!(median(&[5.0, 1.0, 3.0]), 3.0);
        assert_eq!(median(&[4.0, 1.0, 3.0, 2.0]), 2.5);
    }

    #[test]
    fn ratios_compare_cases_that_differ_in_one_thing() {
        let case = |by, rays, mode, threads, median_rays_per_second| Case {
            by,
            rays,
            mode,
            threads,
            median_rays_per_second,
            rays_per_second: vec![],
            kernel_rays_per_second: vec![],
        };
        let cases = [
            case(By::Measured, "coherent", "closest", 1, 4.0),
            case(By::Measured, "diffuse", "closest", 1, 1.0),
            case(By::Exact, "diffuse", "closest", 1, 0.5),
            case(By::Measured, "diffuse", "any", 1, 3.0),
            case(By::Measured, "diffuse", "any", 2, 5.4),
        ];
        let found: Vec<_> = ratios(&cases).iter().map(|r| (r.what, r.ratio)).collect();
        assert_eq!(
            found,
            [
                ("tracer / exact tracer", 2.0),
                ("diffuse / coherent", 0.25),
                ("any / closest", 3.0),
                ("all threads / one", 1.8),
            ]
        );
    }
}
