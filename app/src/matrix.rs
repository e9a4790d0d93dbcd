//! `isophote matrix`: one scene by every technique over every tracer, each against the same reference.

mod page;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::Arc,
};

use anyhow::{Context, Result, ensure};
use clap::Args;
use glam::Vec3;
use isophote_scene::{
    Agreement, Camera, Image, Ray, Scene, Selection, check_writable,
    reference::{Quantity, Settings},
    write_atomically,
};
use serde::Serialize;

use crate::{
    metrics::Errors,
    output::{PROGRAM, Program, Voice, advance, print, print_json, timed},
    pairs::Pair,
    rays::{self, RayKind},
    reference::{Ground, Order},
    scene_args::{SceneArgs, choose_camera, note_moving, require_geometry, require_light},
    technique::{TechniqueArgs, TechniqueChoice},
    tracers::{AnyTracer, Choice, Device, Plan, TracerArgs, TracerChoice},
    values,
};

const EXAMPLES: &str = "\
Every pair that can be is rendered with one setting; why the others cannot is told in a line each. Errors are against \
the reference technique with the exact tracer and --reference-spp samples a pixel; 'as reference' is how long the \
reference technique with the exact tracer of the same device would take for an error like this one, over how long the \
pair took, building its tracer and compiling its shaders included: above 1 the pair wins.

Examples:
  isophote matrix hall.glb -o hall-matrix
  isophote matrix hall.glb --quantity ao --d-max 2 --device cpu --json
  isophote matrix builtin:office --technique reference,igi --tracer bvh,ldi --igi-paths 512";

/// Triangles up to which every ray can be tested against every triangle in a reasonable time.
const BRUTE_FORCE: usize = 1000;
/// Rays by which leaks are found.
const PROBES: usize = 1 << 16;

/// Render a scene by every technique over every tracer.
#[derive(Args, Debug)]
#[command(after_help = EXAMPLES)]
pub(crate) struct MatrixArgs {
    /// A .glb, .gltf or .obj file, or builtin:NAME as `isophote --help` lists them
    scene: String,
    /// What to calculate, as for `isophote render`; several with commas
    #[arg(
        long,
        value_name = "NAME[,…]",
        value_delimiter = ',',
        default_value = "ao,indirect"
    )]
    quantity: Vec<Quantity>,
    /// The techniques; all unless given
    #[arg(long, value_enum, value_name = "NAME[,…]", value_delimiter = ',')]
    technique: Vec<TechniqueChoice>,
    /// The tracers; all unless given, brute-force only where the scene has few triangles
    #[arg(long, value_enum, value_name = "NAME[,…]", value_delimiter = ',')]
    tracer: Vec<AnyTracer>,
    /// Where; auto is on the CPU, and on a GPU if there is an adapter
    #[arg(long, value_enum, default_value = "auto")]
    device: Device,
    /// How far ao and obscurance look; obscurance needs a finite one [metres]
    #[arg(long, value_name = "METRES", default_value = "inf", value_parser = values::distance)]
    d_max: f32,
    /// Width and height of the pictures [pixels]
    #[arg(long, value_name = "WxH", default_value = "240x180", value_parser = values::size)]
    size: Size,
    /// Samples per pixel of the technique reference
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    spp: u32,
    /// Samples per pixel of what all are compared with
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(2..=1 << 20))]
    reference_spp: u32,
    /// Chooses the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// The camera; the scene's first one unless given. 'auto' frames the scene
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Threads to use; all unless given
    #[arg(long, value_name = "N", value_parser = values::threads)]
    pub(crate) threads: Option<usize>,
    /// A folder for index.html, matrix.json and the pictures
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Print the table as JSON
    #[arg(long)]
    json: bool,
    /// Say nothing but errors and the table
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    tracer_args: TracerArgs,
    #[command(flatten)]
    techniques: TechniqueArgs,
    #[command(flatten)]
    changes: SceneArgs,
}

// clap takes a bare array for a list of values.
type Size = [u32; 2];

/// All that was found.
#[derive(Serialize)]
struct Matrix<'a> {
    scene: &'a str,
    #[serde(flatten)]
    program: Program,
    triangles: usize,
    threads: usize,
    size: Size,
    samples: u32,
    reference_samples: u32,
    /// relRMSE of the pictures that all are compared with.
    reference_noise: BTreeMap<&'static str, f32>,
    rows: Vec<Row>,
}

/// A pair and a quantity.
#[derive(Serialize)]
struct Row {
    technique: String,
    tracer: String,
    device: &'static str,
    quantity: &'static str,
    #[serde(skip)]
    is_occlusion: bool,
    #[serde(flatten)]
    outcome: Outcome,
}

#[derive(Serialize)]
#[serde(rename_all = "lowercase")]
enum Outcome {
    Measured(Measured),
    /// The pair cannot be.
    Refused(String),
    /// It can, but not with this scene.
    Failed(String),
}

#[derive(Clone, Serialize)]
struct Measured {
    #[serde(flatten)]
    errors: Errors,
    build_seconds: f64,
    render_seconds: f64,
    tracer_bytes: usize,
    /// Share of diffuse rays that pass what they should hit.
    leak_rate: f64,
    /// The seconds that the reference technique with the exact tracer would take for this error.
    reference_seconds: Option<f64>,
    /// Nothing is lit that should be.
    is_black: bool,
    /// In the folder.
    picture: Option<String>,
}

impl Measured {
    fn seconds(&self) -> f64 {
        self.build_seconds + self.render_seconds
    }

    /// How many times longer the reference technique would take.
    fn gain(&self) -> Option<f64> {
        Some(self.reference_seconds? / self.seconds())
    }
}

pub(crate) fn matrix(args: &MatrixArgs) -> Result<ExitCode> {
    let voice = Voice::new(args.quiet);
    ensure!(
        args.d_max.is_finite() || !args.quantity.contains(&Quantity::Obscurance),
        "obscurance needs a finite --d-max, since it grows with the distance over that"
    );
    if let Some(folder) = &args.output {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
        check_writable(&folder.join("index.html"))?;
    }
    let mut scene = args.changes.load(&args.scene, voice)?;
    require_geometry(&scene, &args.scene)?;
    if args
        .quantity
        .iter()
        .any(|quantity| !quantity.is_occlusion())
    {
        require_light(&mut scene, voice);
    }
    let scene = Arc::new(scene);
    let camera = choose_camera(&scene, args.camera.as_deref(), voice)?;
    note_moving(&scene, Some(AnyTracer::Ldi), voice);
    let selection = Selection {
        bounds: args.changes.bounds(),
        ..Selection::default()
    };
    let lab = Lab::new(args, &scene, &camera, &selection, voice)?;
    let mut rows = lab.rows();
    estimate(&mut rows);
    let matrix = Matrix {
        scene: &args.scene,
        program: PROGRAM,
        triangles: scene.triangle_count(),
        threads: rayon::current_num_threads(),
        size: args.size,
        samples: args.spp,
        reference_samples: args.reference_spp,
        reference_noise: lab.noise(),
        rows,
    };
    if let Some(folder) = &args.output {
        let json = serde_json::to_string_pretty(&matrix)?;
        put(&folder.join("matrix.json"), &json)?;
        put(&folder.join("index.html"), &matrix.html())?;
    }
    if args.json {
        print_json(&matrix)?;
    } else {
        print(&matrix.text())?;
    }
    let wrong = |row: &Row| match &row.outcome {
        Outcome::Measured(measured) => measured.is_black,
        Outcome::Refused(_) => false,
        Outcome::Failed(_) => true,
    };
    Ok(ExitCode::from(u8::from(matrix.rows.iter().any(wrong))))
}

/// What all pairs have in common.
struct Lab<'a> {
    args: &'a MatrixArgs,
    scene: &'a Arc<Scene>,
    camera: &'a Camera,
    selection: &'a Selection,
    voice: Voice,
    /// What every picture is compared with, and its noise.
    references: Vec<(Quantity, Vec<Vec3>, f32)>,
    /// Rays, and whether they hit anything.
    probes: Vec<Ray>,
    truth: Vec<bool>,
}

impl<'a> Lab<'a> {
    fn new(
        args: &'a MatrixArgs,
        scene: &'a Arc<Scene>,
        camera: &'a Camera,
        selection: &'a Selection,
        voice: Voice,
    ) -> Result<Self> {
        let mut lab = Self {
            args,
            scene,
            camera,
            selection,
            voice,
            references: Vec::new(),
            probes: Vec::new(),
            truth: Vec::new(),
        };
        let exact = Ground::build(Choice::Cpu(TracerChoice::Bvh), None, &lab.plan())?;
        voice.note("rendering what all are compared with");
        let settings = lab.settings(args.reference_spp, args.seed.wrapping_add(1));
        let bar = voice.bar();
        let made = exact.render(scene, lab.order(&args.quantity, &settings), &advance(&bar));
        bar.finish_and_clear();
        for estimate in made?.render.estimates {
            lab.references
                .push((estimate.quantity, estimate.values, estimate.noise));
        }
        let tracers = exact.on_cpu().context("the CPU's tracer is on the CPU")?;
        let (kind, seed) = (RayKind::Diffuse, args.seed);
        lab.probes = rays::make(kind, scene, tracers.exact, camera, PROBES, seed)?;
        lab.truth = exact.any_hits(&lab.probes)?;
        Ok(lab)
    }

    fn plan(&self) -> Plan<'_> {
        Plan {
            args: &self.args.tracer_args,
            scene: self.scene,
            selection: self.selection,
            camera: self.camera,
        }
    }

    fn settings(&self, samples: u32, seed: u64) -> Settings {
        Settings {
            d_max: self.args.d_max,
            samples,
            seed,
            ..Settings::default()
        }
    }

    fn order<'b>(&'b self, quantities: &'b [Quantity], settings: &'b Settings) -> Order<'b> {
        Order {
            camera: self.camera,
            size: self.args.size,
            quantities,
            settings,
            selection: self.selection,
            min_d: None,
            maps: self.args.tracer_args.depth_maps.params(),
        }
    }

    fn noise(&self) -> BTreeMap<&'static str, f32> {
        let references = self.references.iter();
        references
            .map(|(quantity, _, noise)| (quantity.name(), *noise))
            .collect()
    }

    fn pairs(&self) -> impl Iterator<Item = Pair> + '_ {
        let args = self.args;
        let on_gpu = has_adapter();
        Pair::all().filter(move |pair| {
            let is_wanted = match args.device {
                Device::Auto => on_gpu || pair.device == Device::Cpu,
                device => pair.device == device,
            };
            is_wanted
                && (args.technique.is_empty() || args.technique.contains(&pair.technique))
                && (args.tracer.is_empty() || args.tracer.contains(&pair.tracer))
                // A tracer of the other device is not worth a row.
                && pair.tracer.runs_on(pair.device)
                && (pair.tracer != AnyTracer::BruteForce
                    || !args.tracer.is_empty()
                    || self.scene.triangle_count() <= BRUTE_FORCE)
        })
    }

    /// A row for every pair and quantity. Each tracer is built once.
    fn rows(&self) -> Vec<Row> {
        let pairs: Vec<Pair> = self.pairs().collect();
        let mut rows = Vec::new();
        let mut grounds: Vec<(AnyTracer, Device)> = pairs
            .iter()
            .map(|pair| (pair.tracer, pair.device))
            .collect();
        grounds.sort_by_key(|&(tracer, device)| (device == Device::Gpu, tracer as u8));
        grounds.dedup();
        for (tracer, device) in grounds {
            let mut built = None;
            let same = |pair: &&Pair| (pair.tracer, pair.device) == (tracer, device);
            for &pair in pairs.iter().filter(same) {
                for &quantity in &self.args.quantity {
                    let outcome = match pair.check(&self.args.techniques, quantity) {
                        Err(error) => Outcome::Refused(error.to_string()),
                        Ok(choice) => {
                            let built = built.get_or_insert_with(|| self.build(choice));
                            self.outcome(pair, quantity, built)
                        }
                    };
                    let row = Row::new(pair, quantity, outcome);
                    self.tell(&row);
                    rows.push(row);
                }
            }
        }
        rows
    }

    fn build(&self, choice: Choice) -> Result<Built> {
        let wheel = self.voice.wheel("building a tracer");
        let (ground, seconds) = timed(|| Ground::build(choice, None, &self.plan()));
        drop(wheel);
        let ground = ground?;
        let found = Agreement::of_occlusion(&ground.any_hits(&self.probes)?, &self.truth);
        Ok(Built {
            ground,
            seconds,
            leak_rate: found.leak_rate(),
        })
    }

    fn outcome(&self, pair: Pair, quantity: Quantity, built: &Result<Built>) -> Outcome {
        let measured = match built {
            Ok(built) => self.measure(pair, quantity, built),
            Err(error) => return Outcome::Failed(format!("{error:#}")),
        };
        measured.map_or_else(
            |error| Outcome::Failed(format!("{error:#}")),
            Outcome::Measured,
        )
    }

    fn measure(&self, pair: Pair, quantity: Quantity, built: &Built) -> Result<Measured> {
        let technique = self.args.techniques.chosen(pair.technique);
        let settings = self.settings(self.args.spp, self.args.seed);
        let quantities = [quantity];
        let order = self.order(&quantities, &settings);
        let bar = self.voice.bar();
        let (made, render_seconds) =
            timed(|| technique.render(self.scene, &built.ground, order, &advance(&bar)));
        bar.finish_and_clear();
        let mut values = made?
            .render
            .estimates
            .into_iter()
            .map(|estimate| estimate.values);
        let values = values.next_back().context("nothing was rendered")?;
        ensure!(
            values.iter().all(|pixel| pixel.is_finite()),
            "the picture has pixels that are NaN or infinite"
        );
        let mut references = self.references.iter();
        let (_, reference, _) = references
            .find(|(of, ..)| *of == quantity)
            .context("there is no reference")?;
        let errors = Errors::of(&values, reference);
        let has_own_tracer = technique.has_own_tracer();
        Ok(Measured {
            errors,
            build_seconds: built.seconds,
            render_seconds,
            tracer_bytes: built.ground.bytes(),
            leak_rate: if has_own_tracer {
                f64::NAN
            } else {
                built.leak_rate
            },
            reference_seconds: None,
            is_black: errors.mean_test < 0.01 * errors.mean_reference,
            picture: self.save(pair, quantity, &values)?,
        })
    }

    /// Writes the picture beside the page.
    fn save(&self, pair: Pair, quantity: Quantity, values: &[Vec3]) -> Result<Option<String>> {
        let Some(folder) = &self.args.output else {
            return Ok(None);
        };
        let device = device_name(pair.device);
        let name = format!(
            "{}-{}-{device}-{quantity}.png",
            pair.technique.name(),
            pair.tracer.name()
        );
        let [width, height] = self.args.size;
        let mut image = Image::new(width, height);
        image.push_layer("", "RGB", values);
        image.save_png(folder.join(&name), 0.0)?;
        Ok(Some(name))
    }

    fn tell(&self, row: &Row) {
        let Row {
            technique,
            tracer,
            device,
            quantity,
            ..
        } = row;
        let what = format!("{quantity} by {technique} over {tracer} on the {device}");
        match &row.outcome {
            Outcome::Measured(measured) => {
                self.voice
                    .note(format_args!("{what}: {:.1} s", measured.seconds()));
            }
            Outcome::Refused(_) => {}
            Outcome::Failed(why) => self.voice.warning(format_args!("{what}: {why}")),
        }
    }
}

/// A tracer that is ready.
struct Built {
    ground: Ground,
    seconds: f64,
    leak_rate: f64,
}

impl Row {
    fn new(pair: Pair, quantity: Quantity, outcome: Outcome) -> Self {
        Self {
            technique: pair.technique.name(),
            tracer: pair.tracer.name(),
            device: device_name(pair.device),
            quantity: quantity.name(),
            is_occlusion: quantity.is_occlusion(),
            outcome,
        }
    }

    fn measured(&self) -> Option<&Measured> {
        match &self.outcome {
            Outcome::Measured(measured) => Some(measured),
            _ => None,
        }
    }

    fn is_exact_reference(&self) -> bool {
        self.technique == TechniqueChoice::Reference.name()
            && [AnyTracer::Bvh, AnyTracer::ComputeBvh]
                .iter()
                .any(|tracer| tracer.name() == self.tracer)
    }
}

/// Says of each row how long the reference technique would take for its error: noise falls with the root of the samples.
fn estimate(rows: &mut [Row]) {
    let references: Vec<(&'static str, &'static str, Measured)> = rows
        .iter()
        .filter(|row| row.is_exact_reference())
        .filter_map(|row| Some((row.device, row.quantity, row.measured()?.clone())))
        .collect();
    for row in rows {
        let same = |of: &&(&'static str, &'static str, Measured)| {
            (of.0, of.1) == (row.device, row.quantity)
        };
        let Some((.., reference)) = references.iter().find(same) else {
            continue;
        };
        if let Outcome::Measured(measured) = &mut row.outcome {
            let factor = (reference.errors.grey_rms / measured.errors.grey_rms).powi(2);
            let seconds = reference.build_seconds + factor * reference.render_seconds;
            measured.reference_seconds = Some(seconds).filter(|seconds| seconds.is_finite());
        }
    }
}

fn device_name(device: Device) -> &'static str {
    match device {
        Device::Gpu => "gpu",
        _ => "cpu",
    }
}

fn put(path: &Path, text: &str) -> Result<()> {
    write_atomically(path, |writer| {
        let written = std::io::Write::write_all(writer, text.as_bytes());
        written.map_err(|source| isophote_scene::Error::Io {
            path: path.to_owned(),
            source,
        })
    })?;
    Ok(())
}

#[cfg(feature = "gpu")]
fn has_adapter() -> bool {
    !isophote_scene::gpu::adapters().is_empty()
}

#[cfg(not(feature = "gpu"))]
fn has_adapter() -> bool {
    false
}
