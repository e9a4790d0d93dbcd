//! `isophote render`: a scene becomes a picture.

use std::{collections::BTreeMap, path::PathBuf, sync::Arc};

use anyhow::{Result, ensure};
use clap::{Args, ValueEnum};
use glam::Vec3;
use isophote_scene::{
    Camera, Image, Pass, Scene, Selection, check_writable,
    reference::{Materials, Normals, Quantity, Render, Settings},
};
use serde::Serialize;

use crate::{
    applies::Idle,
    maps::MapsInfo,
    output::{
        PROGRAM, Program, Voice, advance, has_suffix, memory_available_bytes, memory_peak_bytes,
        print_json, timed,
    },
    pairs,
    reference::{Ground, Made, Order},
    scene_args::{SceneArgs, choose_camera, note_moving, require_geometry, require_light},
    technique::{Technique, TechniqueArgs, TechniqueChoice},
    tracers::{AnyTracer, Device, Plan, TracerArgs, choose},
    values,
};

const EXAMPLES: &str = "\
An .exr file keeps linear light in 32-bit floats: the picture in R, G, B when one quantity is asked for, a layer for \
each (ao.R, direct.R, …) when there are several, and always albedo, normal, position, depth, primitive and instance; \
with another technique than reference also its stages (direct, diffuse, glossy, irradiance.indirect, …). \
Its header holds every setting and the picture's own noise (relRMSE). A .png file is for looking at: every quantity, \
ao too, is multiplied with 2^exposure and shown as sRGB.

Examples:
  isophote render builtin:cornell -o cornell.png
  isophote render hall.glb --quantity ao --d-max 1.5 --spp 256 -o ao.exr
  isophote render hall.glb --quantity direct,indirect,path --materials lambert --size 1280x720 -o hall.exr
  isophote render --settings hall.exr --seed 2 -o again.exr   (with another seed)
  isophote render hall.glb --device gpu --tracer ray-query --spp 1024 -o hall.exr
  isophote render hall.glb --technique ldi --ldi-samples 4 -o hall.exr -o hall.png   (direct light and one bounce)
  isophote render hall.glb --technique ldi --ldi-layers center --ldi-exact 15% --ldi-save hall.maps -o hall.exr
  isophote render hall.glb --technique igi --igi-downsampling 4 --igi-interleaving 3x3 -o hall.png
  isophote render room.obj --environment sky.hdr --add bunny.glb@0,0.8,0,0.5,30 -o room.png --exposure 1";

/// Render a scene.
#[derive(Args, Debug)]
#[command(after_help = EXAMPLES)]
pub(crate) struct RenderArgs {
    /// A .glb, .gltf or .obj file, or builtin:NAME as `isophote --help` lists them
    #[arg(required_unless_present = "settings")]
    scene: Option<String>,
    /// How light is calculated
    #[arg(long, value_enum, default_value = "reference")]
    technique: TechniqueChoice,
    /// Who answers its rays; bvh on the CPU and compute-bvh on a GPU unless given
    #[arg(long, value_enum)]
    tracer: Option<AnyTracer>,
    /// Where; auto is where the tracer runs, or a GPU if there is one in hardware
    #[arg(long, value_enum, default_value = "auto")]
    device: Device,
    /// A part of the name of the GPU to use; the fastest unless given (`isophote devices` lists them)
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// What to calculate: ao, obscurance, direct, indirect, path, irradiance.direct, irradiance.indirect or
    /// irradiance.path; several with commas. The techniques ldi and igi know direct, indirect, and path with as many
    /// bounces as they have
    #[arg(
        long,
        value_name = "NAME[,…]",
        value_delimiter = ',',
        default_value = "path"
    )]
    quantity: Vec<Quantity>,
    /// How far ao and obscurance look; obscurance needs a finite one [metres]
    #[arg(long, value_name = "METRES", default_value = "inf", value_parser = values::distance)]
    d_max: f32,
    /// Leave out the indirect light of surfaces nearer than about this, as methods with virtual lights must; 0 unless
    /// given, and 0.1 with --technique igi [metres]
    #[arg(long, value_name = "METRES", value_parser = values::not_negative)]
    min_d: Option<f32>,
    /// Which part of the materials counts
    #[arg(long, value_enum, default_value = "pbr")]
    materials: MaterialsChoice,
    /// Which normals surfaces are shaded with
    #[arg(long, value_enum, default_value = "smooth")]
    normals: NormalsChoice,
    /// Surfaces that a light path of 'path' may meet
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000))]
    path_bounces: u32,
    /// Width and height of the picture [pixels]
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = values::size)]
    size: Size,
    /// Samples per pixel; powers of two have the least noise
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    spp: u32,
    /// Chooses the random numbers; the same seed gives the same picture
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// The camera, by its node's name; the scene's first one unless given. 'auto' frames the scene
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Brighten a .png by this many stops (each doubles the light); .exr stays as it is
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, value_parser = values::finite, allow_hyphen_values = true)]
    exposure: f32,
    /// Threads to use; all unless given. The picture does not depend on it
    #[arg(long, value_name = "N", value_parser = values::threads)]
    pub(crate) threads: Option<usize>,
    /// Repeat the settings in this file's header; flags given beside it win
    #[arg(long, value_name = "OLD.exr")]
    pub(crate) settings: Option<PathBuf>,
    /// The picture to write: .exr or .png; may be repeated
    #[arg(short, long, value_name = "FILE", required = true)]
    output: Vec<PathBuf>,
    /// Print settings, times, rays and memory as JSON
    #[arg(long)]
    json: bool,
    /// Say nothing but errors
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

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum MaterialsChoice {
    /// Every surface is diffuse with its base colour
    Lambert,
    /// Metallic-roughness and transmission
    Pbr,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum NormalsChoice {
    /// Interpolated from the vertices
    Smooth,
    /// The triangles' own
    Flat,
}

#[derive(Serialize)]
struct Report<'a> {
    outputs: &'a [PathBuf],
    #[serde(flatten)]
    program: Program,
    device: String,
    threads: usize,
    settings: &'a BTreeMap<String, String>,
    triangles: usize,
    tracer_bytes: usize,
    seconds: Seconds,
    #[serde(skip_serializing_if = "Option::is_none")]
    maps: Option<&'a MapsInfo>,
    /// What each stage took, of techniques that have some.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    passes: Vec<PassReport>,
    rays: u64,
    rays_per_second: f64,
    /// By pass and the GPU's own clock, where it has one.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    gpu_seconds: BTreeMap<String, f64>,
    /// relRMSE of each quantity, from two independent halves of the samples.
    noise: BTreeMap<String, f32>,
    memory_peak_bytes: Option<u64>,
}

#[derive(Serialize)]
struct PassReport {
    name: &'static str,
    rays: u64,
    /// Towards lights, from what the rays of the stage hit.
    shadow_rays: u64,
    seconds: f64,
}

#[derive(Default, Serialize)]
struct Seconds {
    load: f64,
    build: f64,
    render: f64,
    write: f64,
}

impl RenderArgs {
    /// Flags that have no effect beside the others.
    pub(crate) fn idle(&self) -> Vec<Idle> {
        let mut idle = self.tracer_args.idle(self.tracer(), self.technique);
        idle.extend(self.techniques.idle(self.technique));
        idle
    }

    fn chosen(&self) -> &dyn Technique {
        self.techniques.chosen(self.technique)
    }

    fn tracer(&self) -> Option<AnyTracer> {
        self.tracer.or(self.chosen().tracer())
    }

    fn settings_of(&self) -> Settings {
        Settings {
            d_max: self.d_max,
            min_d: self.min_d.unwrap_or(0.0),
            materials: match self.materials {
                MaterialsChoice::Lambert => Materials::Lambert,
                MaterialsChoice::Pbr => Materials::Pbr,
            },
            normals: match self.normals {
                NormalsChoice::Smooth => Normals::Smooth,
                NormalsChoice::Flat => Normals::Flat,
            },
            samples: self.spp,
            seed: self.seed,
            path_bounces: self.path_bounces,
        }
    }

    fn order<'a>(
        &'a self,
        camera: &'a Camera,
        settings: &'a Settings,
        selection: &'a Selection,
    ) -> Order<'a> {
        Order {
            camera,
            size: self.size,
            quantities: &self.quantity,
            settings,
            selection,
            min_d: self.min_d,
            maps: self.tracer_args.depth_maps.params(),
        }
    }
}

/// Renders; `settings` are the command's settings by name, for the header.
pub(crate) fn render(args: &RenderArgs, mut settings: BTreeMap<String, String>) -> Result<()> {
    let voice = Voice::new(args.quiet);
    check_settings(args)?;
    check_memory(args)?;
    let choice = choose(args.device, args.tracer(), args.adapter.as_deref())?;
    pairs::check(args.technique, args.chosen(), choice, &args.quantity)?;
    args.tracer_args.check(choice)?;
    settings.insert("tracer".into(), choice.name());
    let mut seconds = Seconds::default();
    let name = args.scene.as_deref().unwrap_or_default();
    let (scene, time) = timed(|| args.changes.load(name, voice));
    let mut scene = scene?;
    seconds.load = time;
    require_geometry(&scene, name)?;
    require_light(&mut scene, voice);
    let camera = choose_camera(&scene, args.camera.as_deref(), voice)?;
    settings.insert("camera".into(), camera.name.clone());
    let scene = Arc::new(scene);
    note_moving(&scene, args.tracer(), voice);
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
    let (ground, time) = timed(|| {
        let _wheel = voice.wheel("building the tracer");
        Ground::build(choice, args.adapter.as_deref(), &plan)
    });
    let ground = ground?;
    seconds.build = time;
    for (name, value) in ground.maps().iter().flat_map(|maps| maps.settings()) {
        settings.insert(name.into(), value);
    }
    let wanted = args.settings_of();
    let order = args.order(&camera, &wanted, &selection);
    for (name, value) in args.chosen().header(&order) {
        settings.insert(name.into(), value);
    }
    let (made, time) = timed(|| make(args, &scene, &ground, order, voice));
    let made = made?;
    seconds.render = time;
    let noise: BTreeMap<String, f32> = made
        .render
        .estimates
        .iter()
        .map(|estimate| (estimate.quantity.to_string(), estimate.noise))
        .collect();
    let device = ground.device();
    let rays = made.render.rays;
    let (passes, gpu_seconds) = (made.passes, made.gpu_seconds);
    let picture = picture(made.render, made.stages, &settings, &device);
    let (written, time) = timed(|| write(args, &picture, voice));
    written?;
    seconds.write = time;
    if !args.json {
        return Ok(());
    }
    print_json(&Report {
        outputs: &args.output,
        program: PROGRAM,
        device,
        threads: rayon::current_num_threads(),
        settings: &settings,
        triangles: scene.triangle_count(),
        tracer_bytes: ground.bytes(),
        maps: ground.maps(),
        passes: passes.into_iter().map(PassReport::from).collect(),
        rays,
        rays_per_second: rays as f64 / seconds.render,
        seconds,
        gpu_seconds,
        noise,
        memory_peak_bytes: memory_peak_bytes(),
    })
}

impl From<Pass> for PassReport {
    fn from(pass: Pass) -> Self {
        let Pass {
            name,
            rays,
            shadow_rays,
            seconds,
        } = pass;
        Self {
            name,
            rays,
            shadow_rays,
            seconds,
        }
    }
}

/// Hours of work must not end at a file that cannot be written, or at two settings that do not go together.
fn check_settings(args: &RenderArgs) -> Result<()> {
    for path in &args.output {
        ensure!(
            has_suffix(path, &["exr", "png"]),
            "{}: unknown suffix; .exr and .png are known",
            path.display()
        );
        ensure!(
            args.quantity.len() == 1 || has_suffix(path, &["exr"]),
            "{}: a .png shows one quantity; write .exr for {}",
            path.display(),
            args.quantity.len()
        );
        check_writable(path)?;
    }
    ensure!(
        args.d_max.is_finite() || !args.quantity.contains(&Quantity::Obscurance),
        "obscurance needs a finite --d-max, since it grows with the distance over that"
    );
    for (index, quantity) in args.quantity.iter().enumerate() {
        ensure!(
            !args.quantity[..index].contains(quantity),
            "the quantity {quantity} is asked for twice"
        );
    }
    Ok(())
}

/// Refuses a picture that would not fit into memory, or that no one could load again.
fn check_memory(args: &RenderArgs) -> Result<()> {
    let [width, height] = args.size;
    let (pixels, quantities) = (
        u64::from(width) * u64::from(height),
        args.quantity.len() as u64,
    );
    let [stages, bytes] = args.chosen().costs();
    // The channels of the file: RGB of each quantity, stage and of three layers, and depth, primitive, instance.
    let channels = 3 * (quantities + stages) + 12;
    let file = pixels * 4 * channels;
    // They are held three times while they are written; before, two halves and their mean.
    let needed = 3 * file.max(pixels * 12 * quantities + pixels * 48) + pixels * bytes;
    let gibibytes = |bytes: u64| bytes as f64 / f64::from(1 << 30);
    ensure!(
        file <= Image::MAX_BYTES,
        "--size {width}x{height}: the picture has {:.1} GiB, more than the {:.0} that can be loaded again",
        gibibytes(file),
        gibibytes(Image::MAX_BYTES)
    );
    if let Some(available) = memory_available_bytes() {
        ensure!(
            needed <= available,
            "--size {width}x{height}: needs about {:.1} GiB of memory, but only {:.1} are free",
            gibibytes(needed),
            gibibytes(available)
        );
    }
    Ok(())
}

fn make(
    args: &RenderArgs,
    scene: &Scene,
    ground: &Ground,
    order: Order<'_>,
    voice: Voice,
) -> Result<Made> {
    let bar = voice.bar();
    let made = args.chosen().render(scene, ground, order, &advance(&bar));
    bar.finish_and_clear();
    made
}

/// The file's image: quantities, stages, layers, and the header.
fn picture(
    render: Render,
    stages: Vec<(&'static str, Vec<Vec3>)>,
    settings: &BTreeMap<String, String>,
    device: &str,
) -> Image {
    let [width, height] = render.size;
    let mut image = Image::new(width, height);
    image.attributes.clone_from(settings);
    let single = render.estimates.len() == 1;
    for estimate in &render.estimates {
        let quantity = estimate.quantity.name();
        let (layer, noise) = if single {
            ("", "noise".to_owned())
        } else {
            (quantity, format!("noise.{quantity}"))
        };
        image.push_layer(layer, "RGB", &estimate.values);
        // With one sample there are no two halves to tell.
        if estimate.noise.is_finite() {
            image.attributes.insert(noise, estimate.noise.to_string());
        }
    }
    for (name, values) in stages {
        // A quantity may have the name of a stage, and then it is that stage.
        if image.channel(&format!("{name}.R")).is_none() {
            image.push_layer(name, "RGB", &values);
        }
    }
    let layers = render.layers;
    image.push_layer("albedo", "RGB", &layers.albedo);
    image.push_layer("normal", "XYZ", &layers.normal);
    image.push_layer("position", "XYZ", &layers.position);
    image.push("depth.Z", layers.depth);
    image.push("primitive", layers.primitive);
    image.push("instance", layers.instance);
    for (name, value) in [
        // OpenEXR has a meaning of its own for `version` and `software`.
        ("isophote", PROGRAM.version),
        ("commit", PROGRAM.commit.unwrap_or("unknown")),
        ("device", device),
        ("rays", &render.rays.to_string()),
    ] {
        image.attributes.insert(name.into(), value.into());
    }
    image
}

fn write(args: &RenderArgs, image: &Image, voice: Voice) -> Result<()> {
    for path in &args.output {
        if has_suffix(path, &["exr"]) {
            image.save(path)?;
        } else {
            image.save_png(path, args.exposure)?;
            voice.note(format_args!(
                "{} shows {} as sRGB at exposure {} stops; write .exr for measuring",
                path.display(),
                args.quantity[0],
                args.exposure
            ));
        }
    }
    Ok(())
}
