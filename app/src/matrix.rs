//! `isophote matrix`: one scene by every technique over every tracer, each against the same reference.

mod lab;
mod page;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::Arc,
};

use anyhow::{Context, Result, ensure};
use clap::{ArgMatches, Args};
use isophote_scene::{Selection, check_writable, reference::Quantity, write_atomically};
use serde::Serialize;

use self::lab::Lab;
use crate::{
    applies::{Idle, of_other_quantities, refuse},
    metrics::Errors,
    output::{PROGRAM, Program, Voice, print, print_json},
    pairs::Pair,
    picture::{Size, check_memory},
    scene_args::{SceneArgs, choose_camera, note_moving, require_geometry, require_light},
    technique::{TechniqueArgs, TechniqueChoice},
    tracers::{AnyTracer, Device, TracerArgs},
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

impl MatrixArgs {
    /// Pairs that are asked for, whether they can be or not. A tracer of the other device is not worth a row.
    fn pairs(&self) -> impl Iterator<Item = Pair> {
        Pair::all().filter(|pair| {
            (self.device == Device::Auto || self.device == pair.device)
                && (self.technique.is_empty() || self.technique.contains(&pair.technique))
                && (self.tracer.is_empty() || self.tracer.contains(&pair.tracer))
                && pair.tracer.runs_on(pair.device)
        })
    }

    /// Flags that change no row.
    fn idle(&self) -> Vec<Idle> {
        let of = |pair: Pair| {
            let known = |quantity: &Quantity| pair.check(&self.techniques, *quantity).is_ok();
            let quantities: Vec<Quantity> = self.quantity.iter().copied().filter(known).collect();
            let mut idle = self.tracer_args.idle(Some(pair.tracer), pair.technique);
            idle.extend(self.techniques.idle(pair.technique, &quantities));
            idle.extend(of_other_quantities(&quantities));
            (!quantities.is_empty()).then_some(idle)
        };
        let mut of_pairs = self.pairs().filter_map(of);
        let mut idle = of_pairs.next().unwrap_or_default();
        for other in of_pairs {
            idle.retain(|one| other.iter().any(|other| other.id == one.id));
        }
        idle
    }

    /// The most that a picture of any technique takes: layers, and bytes a pixel.
    fn costs(&self) -> [u64; 2] {
        let costs = self
            .pairs()
            .map(|pair| self.techniques.chosen(pair.technique).costs());
        costs.fold([0, 0], |[a, b], [c, d]| [a.max(c), b.max(d)])
    }
}

pub(crate) fn matrix(args: &MatrixArgs, given: &ArgMatches) -> Result<ExitCode> {
    let voice = Voice::new(args.quiet);
    refuse(&args.idle(), given)?;
    check_memory(args.size, args.quantity.len(), args.costs())?;
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

impl Row {
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
