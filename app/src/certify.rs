//! `isophote certify`: how far a tracer can be trusted in a scene.
//!
//! Two questions, asked apart. Of rays as they occur in rendering: what does it say, beside an exact tracer? And of a
//! picture: how much of its error is the tracer's, and how much is noise that any tracer leaves? The second is told by
//! rendering with both tracers and the same samples, and with the exact one and others.

mod pictures;

use std::{path::PathBuf, sync::Arc};

use anyhow::{Result, ensure};
use clap::{ArgMatches, Args};
use isophote_scene::{
    Agreement, Answers, Hit, Ray, Selection, check_writable, reference::Quantity,
};
use serde::Serialize;

use self::pictures::{OfPicture, Pictures};
use crate::{
    applies::{of_other_quantities, refuse},
    caster::Caster,
    maps::MapsInfo,
    output::{PROGRAM, Program, Voice, check_available, has_suffix, print, print_json},
    picture::{Size, check_memory},
    rays::{self, RayKind},
    scene_args::{SceneArgs, choose_camera, note_moving, require_geometry, require_light},
    technique::TechniqueChoice,
    tracers::{AnyTracer, Choice, Device, Plan, TracerArgs, TracerChoice, choose},
    values,
};

const EXAMPLES: &str = "\
Of rays, against the exact tracer of the same device:
  leaks       share of the hits that it misses, or passes by more than --t-error
  false hits  share of all rays that it says hit where there is nothing
  early       share of the hits that it sees too near by more than --t-error
Of a picture: its error by visibility alone (the same samples by both tracers), and the noise that the exact tracer \
has with as many samples. A .png shows the picture by the exact tracer, by the tracer, and where visibility and noise \
differ, both on one scale; an .exr holds them as layers exact, tracer, visibility and noise.

Examples:
  isophote certify hall.glb --tracer ldi --ldi-layers center
  isophote certify hall.glb --tracer field --quantity ao --d-max 2 -o certificate.png
  isophote certify hall.glb --tracer boxes --device gpu --json";

/// Tell how far a tracer is off, and whether a picture would show it.
#[derive(Args, Debug)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CertifyArgs {
    /// A .glb, .gltf or .obj file, or builtin:NAME as `isophote --help` lists them
    scene: String,
    /// The tracer to judge
    #[arg(long, value_enum)]
    tracer: AnyTracer,
    /// Where; auto is where the tracer runs, or a GPU if there is one in hardware
    #[arg(long, value_enum, default_value = "auto")]
    device: Device,
    /// A part of the name of the GPU to use; the fastest unless given (`isophote devices` lists them)
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Rays of each kind
    #[arg(long, value_name = "N", default_value_t = 200_000, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    count: u32,
    /// What is off by no more than this is right; a thousandth of the scene's diagonal unless given [metres]
    #[arg(long, value_name = "METRES", value_parser = values::not_negative)]
    t_error: Option<f32>,
    /// What the picture shows; ao, or indirect, where the tracer knows what it hits, unless given
    #[arg(long, value_name = "NAME")]
    quantity: Option<Quantity>,
    /// How far ao and obscurance look; obscurance needs a finite one [metres]
    #[arg(long, value_name = "METRES", default_value = "inf", value_parser = values::distance)]
    d_max: f32,
    /// Width and height of the picture [pixels]
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = values::size)]
    size: Size,
    /// Samples per pixel
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    spp: u32,
    /// Chooses rays and samples
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// The camera; the scene's first one unless given. 'auto' frames the scene
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Threads to use; all unless given
    #[arg(long, value_name = "N", value_parser = values::threads)]
    pub(crate) threads: Option<usize>,
    /// A picture to write: .png to look at, .exr with its layers; may be repeated
    #[arg(short, long, value_name = "FILE")]
    output: Vec<PathBuf>,
    /// Print the certificate as JSON
    #[arg(long)]
    json: bool,
    /// Say nothing but errors and the certificate
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    tracer_args: TracerArgs,
    #[command(flatten)]
    changes: SceneArgs,
}

#[derive(Serialize)]
struct Certificate<'a> {
    scene: &'a str,
    tracer: String,
    exact: String,
    device: String,
    #[serde(flatten)]
    program: Program,
    triangles: usize,
    bytes: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    maps: Option<Box<MapsInfo>>,
    /// Metres.
    t_error: f32,
    rays: Vec<OfRays>,
    picture: OfPicture,
}

/// How it answered one kind of rays.
#[derive(Serialize)]
struct OfRays {
    kind: &'static str,
    rays: usize,
    hits: usize,
    hit_in_both: usize,
    missed_by_both: usize,
    false_hits: usize,
    false_misses: usize,
    /// The next four only where the tracer knows distances.
    #[serde(skip_serializing_if = "Option::is_none")]
    late: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    early: Option<usize>,
    leak_rate: f64,
    false_hit_rate: f64,
    /// Metres, at 50, 90, 99, 99.9 and 100 % of the rays that hit in both.
    #[serde(skip_serializing_if = "Option::is_none")]
    t_error_quantiles: Option<[f32; 5]>,
    rays_per_second: f64,
    exact_rays_per_second: f64,
}

pub(crate) fn certify(args: &CertifyArgs, given: &ArgMatches) -> Result<()> {
    let voice = Voice::new(args.quiet);
    let tracer_args = &args.tracer_args;
    let technique = TechniqueChoice::Reference;
    refuse(&tracer_args.idle(Some(args.tracer), technique), given)?;
    for path in &args.output {
        ensure!(
            has_suffix(path, &["exr", "png"]),
            "{}: unknown suffix; .exr and .png are known",
            path.display()
        );
        check_writable(path)?;
    }
    let choice = choose(args.device, Some(args.tracer), args.adapter.as_deref())?;
    args.tracer_args.check(choice)?;
    let quantity = args.quantity_of(choice)?;
    refuse(&of_other_quantities(&[quantity]), given)?;
    check_memory(args.size, 1, [0, 0])?;
    let needed = u64::from(args.count) * RAY_BYTES;
    check_available(needed, &format!("--count {}", args.count))?;
    let mut scene = args.changes.load(&args.scene, voice)?;
    require_geometry(&scene, &args.scene)?;
    if !quantity.is_occlusion() {
        require_light(&mut scene, voice);
    }
    let scene = Arc::new(scene);
    let camera = choose_camera(&scene, args.camera.as_deref(), voice)?;
    note_moving(&scene, Some(args.tracer), voice);
    let selection = Selection {
        bounds: args.changes.bounds(),
        ..Selection::default()
    };
    let plan = Plan {
        args: &args.tracer_args,
        scene: &scene,
        selection: &selection,
        camera: &camera,
    };
    let t_error = args.t_error.unwrap_or(1e-3 * scene.bounds().diagonal());
    let asked = args.ask(choice, &plan, t_error, voice)?;
    let pictures = Pictures::render(args, choice, quantity, &plan, voice)?;
    for path in &args.output {
        pictures.write(path, args.size)?;
    }
    let certificate = Certificate {
        scene: &args.scene,
        tracer: choice.name(),
        exact: choice.exact().name(),
        device: asked.tracer.device(),
        program: PROGRAM,
        triangles: scene.triangle_count(),
        bytes: asked.tracer.bytes(),
        maps: asked.tracer.maps(),
        t_error,
        rays: asked.rays,
        picture: pictures.errors(quantity, args.spp),
    };
    if args.json {
        print_json(&certificate)
    } else {
        print(&certificate.text())
    }
}

impl CertifyArgs {
    fn quantity_of(&self, choice: Choice) -> Result<Quantity> {
        let knows = choice.answers();
        let quantity = self.quantity.unwrap_or(match knows {
            Answers::Surface => Quantity::Indirect,
            _ => Quantity::Ao,
        });
        ensure!(
            knows >= quantity.needs(),
            "{quantity} needs a tracer that answers {:?}, but {} answers {knows:?}: leave out --quantity, or choose ao",
            quantity.needs(),
            choice.name()
        );
        ensure!(
            self.d_max.is_finite() || quantity != Quantity::Obscurance,
            "obscurance needs a finite --d-max, since it grows with the distance over that"
        );
        Ok(quantity)
    }

    /// Asks the tracer, and the exact one of its device, rays of every kind.
    fn ask(&self, choice: Choice, plan: &Plan<'_>, t_error: f32, voice: Voice) -> Result<Asked> {
        let adapter = self.adapter.as_deref();
        let wheel = voice.wheel("building the tracers");
        let mut tracer = Caster::build(choice, adapter, plan)?;
        let mut exact = Caster::build(choice.exact(), adapter, plan)?;
        let starts = TracerChoice::Bvh.build(plan)?;
        wheel.finish_and_clear();
        let _wheel = voice.wheel("asking rays");
        let knows_distances = choice.answers() >= Answers::Distance;
        let mut found = Vec::new();
        for (kind, name) in KINDS {
            if kind == RayKind::Shadow && !rays::has_targets(plan.scene) {
                voice.note("nothing that gives light has a place: no shadow rays are asked");
                continue;
            }
            let (count, camera) = (self.count as usize, plan.camera);
            let rays = rays::make(kind, plan.scene, &*starts.tracer, camera, count, self.seed)?;
            let (agreement, seconds) = if knows_distances && kind != RayKind::Shadow {
                let (answers, truth) = (tracer.closest(&rays)?, exact.closest(&rays)?);
                (
                    Agreement::of(&answers.hits, &truth.hits, |_| t_error),
                    [answers.seconds, truth.seconds],
                )
            } else {
                let (answers, truth) = (tracer.any(&rays)?, exact.any(&rays)?);
                (
                    Agreement::of_occlusion(&answers.hits, &truth.hits),
                    [answers.seconds, truth.seconds],
                )
            };
            let distances = knows_distances && kind != RayKind::Shadow;
            found.push(OfRays::new(name, &agreement, distances, seconds));
        }
        Ok(Asked {
            tracer,
            rays: found,
        })
    }
}

/// What a ray takes while it is judged: itself, what both tracers say, and its error.
const RAY_BYTES: u64 = (size_of::<Ray>() + 2 * size_of::<Option<Hit>>() + size_of::<f32>()) as u64;

const KINDS: [(RayKind, &str); 4] = [
    (RayKind::Coherent, "camera"),
    (RayKind::Diffuse, "diffuse"),
    (RayKind::Shadow, "shadow"),
    (RayKind::Grazing, "grazing"),
];

/// A tracer, and how it answered.
struct Asked {
    tracer: Caster,
    rays: Vec<OfRays>,
}

impl OfRays {
    fn new(kind: &'static str, found: &Agreement, distances: bool, seconds: [f64; 2]) -> Self {
        let hit_in_both = found.hits - found.false_misses;
        Self {
            kind,
            rays: found.rays,
            hits: found.hits,
            hit_in_both,
            missed_by_both: found.rays - found.hits - found.false_hits,
            false_hits: found.false_hits,
            false_misses: found.false_misses,
            late: distances.then_some(found.late),
            early: distances.then_some(found.early),
            leak_rate: found.leak_rate(),
            false_hit_rate: found.false_hit_rate(),
            t_error_quantiles: distances.then_some(found.t_error),
            rays_per_second: found.rays as f64 / seconds[0],
            exact_rays_per_second: found.rays as f64 / seconds[1],
        }
    }
}

impl Certificate<'_> {
    fn text(&self) -> String {
        let mut text = format!(
            "{}: {} against {}, {} triangles, {:.1} MiB; late and early beyond {}\n\n\
             rays        hits      leaks   false hits      early   error in t, 50 / 90 / 99 / 99.9 / 100 %            speed\n",
            self.scene,
            self.tracer,
            self.exact,
            self.triangles,
            self.bytes as f64 / f64::from(1 << 20),
            length(self.t_error)
        );
        for one in &self.rays {
            text += &one.text();
        }
        text += &self.picture.text();
        text
    }
}

impl OfRays {
    fn text(&self) -> String {
        let percent =
            |count: usize, of: usize| format!("{:.4} %", 100.0 * count as f64 / of.max(1) as f64);
        let early = self
            .early
            .map_or_else(String::new, |early| percent(early, self.hits));
        let quantiles = self
            .t_error_quantiles
            .map_or_else(String::new, |errors| errors.map(length).join(" / "));
        format!(
            "{:<8} {:>7.2} % {:>10} {:>12} {early:>10}   {quantiles:<44} {:>8.2} times exact\n",
            self.kind,
            100.0 * self.hits as f64 / self.rays.max(1) as f64,
            format!("{:.4} %", 100.0 * self.leak_rate),
            format!("{:.4} %", 100.0 * self.false_hit_rate),
            self.rays_per_second / self.exact_rays_per_second
        )
    }
}

/// In a unit that suits.
fn length(metres: f32) -> String {
    match metres {
        0.0 => "0".to_owned(),
        _ if metres < 1e-3 => format!("{:.2} µm", 1e6 * metres),
        _ if metres < 1.0 => format!("{:.2} mm", 1e3 * metres),
        _ => format!("{metres:.2} m"),
    }
}
