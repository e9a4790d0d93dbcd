//! `isophote trace`: rays from a file, hits into a file, and how fast that went.

use std::{path::PathBuf, sync::Arc};

use anyhow::{Context, Result, ensure};
use clap::{ArgMatches, Args, ValueEnum};
use isophote_scene::{Hit, Ray, Selection, SurfaceId, check_writable};
use serde::Serialize;

use crate::{
    applies::{Idle, refuse},
    caster::{Answered, Caster},
    maps::MapsInfo,
    npy,
    output::{
        PROGRAM, Program, Voice, check_available, has_suffix, memory_peak_bytes, print, print_json,
        timed,
    },
    rays::{self, RayKind},
    scene_args::{SceneArgs, choose_camera, note_moving, require_geometry},
    technique::TechniqueChoice,
    tracers::{AnyTracer, Device, Plan, TracerArgs, choose},
    values,
};

const EXAMPLES: &str = "\
Files are NumPy arrays of float32 (numpy.load, numpy.save):
  rays  (N, 8)  origin x y z, t_min, direction x y z (unit length), t_max   [metres]
  hits  (N, 5)  t (+inf where missed), u, v, instance, primitive (−1 where missed or unknown)
A ray with a NaN, an infinite origin or no direction misses. With --mode any only whether something is hit is \
known: t is 0 or +inf, and the rest stays unknown.

Examples:
  isophote trace hall.glb --make diffuse --count 1000000 -o rays.npy
  isophote trace hall.glb --rays rays.npy -o hits.npy --json
  isophote trace hall.glb --rays rays.npy --mode any --threads 1 --repeat 5 -o hits.npy
  isophote trace hall.glb --rays rays.npy --device gpu --tracer ray-query -o hits.npy";

/// Trace rays from a file, or make such a file.
#[derive(Args, Debug)]
#[command(after_help = EXAMPLES)]
pub(crate) struct TraceArgs {
    /// A .glb, .gltf or .obj file, or builtin:NAME as `isophote --help` lists them
    scene: String,
    /// Who answers the rays; bvh on the CPU and compute-bvh on a GPU unless given
    #[arg(long, value_enum)]
    tracer: Option<AnyTracer>,
    /// Where; auto is where the tracer runs, or a GPU if there is one in hardware
    #[arg(long, value_enum, default_value = "auto")]
    device: Device,
    /// A part of the name of the GPU to use; the fastest unless given (`isophote devices` lists them)
    #[arg(long, value_name = "NAME", conflicts_with = "make")]
    adapter: Option<String>,
    /// What is asked of each ray
    #[arg(long, value_enum, default_value = "closest")]
    mode: Mode,
    /// The rays to trace: a .npy file
    #[arg(long, value_name = "RAYS.npy", required_unless_present = "make")]
    rays: Option<PathBuf>,
    /// Trace the rays this many times and take the median time
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    repeat: u32,
    /// Make rays of this kind instead of tracing any
    #[arg(long, value_enum, value_name = "KIND", conflicts_with = "rays")]
    make: Option<RayKind>,
    /// How many rays to make
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    count: u32,
    /// Chooses the rays that are made
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// The camera that rays are made around, and near which some tracers answer better; the scene's first one unless given
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Threads to use; all unless given
    #[arg(long, value_name = "N", value_parser = values::threads)]
    pub(crate) threads: Option<usize>,
    /// The file to write, .npy: hits, or rays with --make
    #[arg(short, long, value_name = "FILE.npy")]
    output: PathBuf,
    /// Print rates, times and memory as JSON
    #[arg(long)]
    json: bool,
    /// Say nothing but errors
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    tracer_args: TracerArgs,
    #[command(flatten)]
    changes: SceneArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
enum Mode {
    /// The first surface
    Closest,
    /// Whether there is any surface
    Any,
}

#[derive(Serialize)]
struct Report<'a> {
    scene: &'a str,
    output: &'a PathBuf,
    tracer: String,
    mode: Option<Mode>,
    threads: usize,
    repeat: u32,
    rays: usize,
    hits: Option<usize>,
    /// Of the tracing alone: the median of the repeats.
    rays_per_second: Option<f64>,
    trace_seconds: Option<f64>,
    /// Without the way to the GPU and back, by its own clock.
    kernel_seconds: Option<f64>,
    build_seconds: f64,
    load_seconds: f64,
    /// Held by the tracer's own structures.
    bytes: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    maps: Option<Box<MapsInfo>>,
    triangles: usize,
    memory_peak_bytes: Option<u64>,
    device: String,
    #[serde(flatten)]
    program: Program,
}

impl TraceArgs {
    /// Flags that have no effect beside the others.
    fn idle(&self) -> Vec<Idle> {
        let technique = TechniqueChoice::Reference;
        let mut idle = self.tracer_args.idle(self.tracer, technique);
        match self.make {
            Some(kind) => {
                let why = "rays are made on the CPU, and not traced: it is for --rays";
                idle.extend(Idle::all(["mode", "repeat", "device"], why));
                if kind == RayKind::Coherent {
                    let why = "nothing is random in coherent rays";
                    idle.extend(Idle::all(["seed"], why));
                }
            }
            None => {
                idle.extend(Idle::all(["count", "seed"], "it is for --make"));
                if !self.tracer_args.depends_on_camera() {
                    let why = "it is for --make, and for tracers that answer by what is near it";
                    idle.extend(Idle::all(["camera"], why));
                }
            }
        }
        idle
    }
}

pub(crate) fn trace(args: &TraceArgs, given: &ArgMatches) -> Result<()> {
    let voice = Voice::new(args.quiet);
    refuse(&args.idle(), given)?;
    ensure!(
        has_suffix(&args.output, &["npy"]),
        "{}: unknown suffix; .npy is known",
        args.output.display()
    );
    check_writable(&args.output)?;
    if args.make.is_some() {
        let needed = u64::from(args.count) * size_of::<Ray>() as u64;
        check_available(needed, &format!("--count {}", args.count))?;
    }
    let rays = match &args.rays {
        Some(path) => npy::read_rays(path)?,
        None => Vec::new(),
    };
    let (scene, load_seconds) = timed(|| args.changes.load(&args.scene, voice));
    let scene = Arc::new(scene?);
    require_geometry(&scene, &args.scene)?;
    let selection = Selection {
        bounds: args.changes.bounds(),
        ..Selection::default()
    };
    // Rays are made on the CPU.
    let device = if args.make.is_some() {
        Device::Cpu
    } else {
        args.device
    };
    let choice = choose(device, args.tracer, args.adapter.as_deref())?;
    args.tracer_args.check(choice)?;
    note_moving(&scene, args.tracer, voice);
    let camera = choose_camera(&scene, args.camera.as_deref(), Voice::new(true))?;
    let plan = Plan {
        args: &args.tracer_args,
        scene: &scene,
        selection: &selection,
        camera: &camera,
    };
    let (built, build_seconds) = timed(|| {
        let _wheel = voice.wheel("building the tracer");
        Caster::build(choice, args.adapter.as_deref(), &plan)
    });
    let mut built = built?;
    let mut report = Report {
        scene: &args.scene,
        output: &args.output,
        tracer: choice.name(),
        mode: None,
        threads: rayon::current_num_threads(),
        repeat: args.repeat,
        rays: rays.len(),
        hits: None,
        rays_per_second: None,
        trace_seconds: None,
        kernel_seconds: None,
        build_seconds,
        load_seconds,
        bytes: built.bytes(),
        maps: built.maps(),
        triangles: scene.triangle_count(),
        memory_peak_bytes: None,
        device: built.device(),
        program: PROGRAM,
    };
    if let Some(kind) = args.make {
        let camera = choose_camera(&scene, args.camera.as_deref(), voice)?;
        let count = args.count as usize;
        let tracer = built.on_cpu().context("rays are made on the CPU")?;
        let rays = rays::make(kind, &scene, tracer, &camera, count, args.seed)?;
        report.rays = rays.len();
        npy::write_rays(&args.output, &rays)?;
    } else {
        warn_of_lengths(&rays, voice);
        let traced = trace_all(&mut built, &rays, args.mode, args.repeat)?;
        report.mode = Some(args.mode);
        report.hits = Some(
            traced
                .hits
                .chunks_exact(5)
                .filter(|hit| hit[0].is_finite())
                .count(),
        );
        report.trace_seconds = Some(traced.seconds);
        report.kernel_seconds = traced.kernel_seconds;
        report.rays_per_second = Some(rays.len() as f64 / traced.seconds);
        npy::write(&args.output, 5, &traced.hits)?;
    }
    report.memory_peak_bytes = memory_peak_bytes();
    if args.json {
        print_json(&report)
    } else if args.quiet {
        Ok(())
    } else {
        print(&report.text())
    }
}

/// Hits count in lengths of the direction, so a direction of another length is most likely a mistake.
fn warn_of_lengths(rays: &[Ray], voice: Voice) {
    let odd = |ray: &&Ray| ray.is_valid() && (ray.direction.length() - 1.0).abs() > 1e-3;
    let count = rays.iter().filter(odd).count();
    if count > 0 {
        voice.warning(format_args!(
            "{count} rays have directions that are not of unit length; their t counts in lengths of the direction"
        ));
    }
}

/// Five numbers for each ray, and the medians of the seconds it took.
struct Traced {
    hits: Vec<f32>,
    seconds: f64,
    kernel_seconds: Option<f64>,
}

fn trace_all(caster: &mut Caster, rays: &[Ray], mode: Mode, repeat: u32) -> Result<Traced> {
    match mode {
        Mode::Closest => repeated(repeat, closest_row, || caster.closest(rays)),
        Mode::Any => repeated(repeat, |&hit| any_row(hit), || caster.any(rays)),
    }
}

fn repeated<T>(
    repeat: u32,
    row: impl Fn(&T) -> [f32; 5],
    mut trace: impl FnMut() -> Result<Answered<T>>,
) -> Result<Traced> {
    let (mut seconds, mut kernel_seconds, mut hits) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..repeat {
        let answered = trace()?;
        seconds.push(answered.seconds);
        kernel_seconds.extend(answered.kernel_seconds);
        hits = answered.hits;
    }
    Ok(Traced {
        hits: hits.iter().flat_map(row).collect(),
        seconds: median(seconds),
        kernel_seconds: (!kernel_seconds.is_empty()).then(|| median(kernel_seconds)),
    })
}

fn median(mut seconds: Vec<f64>) -> f64 {
    seconds.sort_by(f64::total_cmp);
    let middle = seconds.len() / 2;
    if seconds.len().is_multiple_of(2) {
        0.5 * (seconds[middle - 1] + seconds[middle])
    } else {
        seconds[middle]
    }
}

fn closest_row(hit: &Option<Hit>) -> [f32; 5] {
    let Some(hit) = hit else {
        return any_row(false);
    };
    let index = |index: u32| {
        if index == SurfaceId::UNKNOWN.instance {
            -1.0
        } else {
            index as f32
        }
    };
    let surface = hit.surface;
    [
        hit.t,
        hit.uv.x,
        hit.uv.y,
        index(surface.instance),
        index(surface.primitive),
    ]
}

fn any_row(hit: bool) -> [f32; 5] {
    let t = if hit { 0.0 } else { f32::INFINITY };
    [t, 0.0, 0.0, -1.0, -1.0]
}

impl Report<'_> {
    fn text(&self) -> String {
        let Some((rate, hits)) = self.rays_per_second.zip(self.hits) else {
            return format!("{}: {} rays\n", self.output.display(), self.rays);
        };
        let on_device = self.kernel_seconds.map_or_else(String::new, |seconds| {
            let rate = self.rays as f64 / seconds / 1e6;
            format!(", {rate:.3} without the way there and back")
        });
        let with = if self.device.starts_with("gpu") {
            self.device.clone()
        } else {
            format!("{} threads", self.threads)
        };
        format!(
            "{}: {} hits of {} rays\n{:.3} million rays/s{on_device} ({}, {with}), built in {:.3} s, {:.1} MiB\n",
            self.output.display(),
            hits,
            self.rays,
            rate / 1e6,
            self.tracer,
            self.build_seconds,
            self.bytes as f64 / f64::from(1 << 20)
        )
    }
}
