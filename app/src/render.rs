//! `isophote render`: a scene becomes a picture.

use std::{collections::BTreeMap, path::PathBuf};

use anyhow::{Result, ensure};
use clap::Args;
use isophote_scene::{Image, Pass, Scene, check_writable};
use serde::Serialize;

use crate::{
    maps::MapsInfo,
    output::{PROGRAM, Program, Voice, advance, has_suffix, memory_peak_bytes, print_json, timed},
    picture::{PictureArgs, image},
    reference::{Ground, Made, Order},
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
    #[command(flatten)]
    pub(crate) picture: PictureArgs,
    /// Threads to use; all unless given. The picture does not depend on it
    #[arg(long, value_name = "N", value_parser = values::threads)]
    pub(crate) threads: Option<usize>,
    /// The picture to write: .exr or .png; may be repeated
    #[arg(short, long, value_name = "FILE", required = true)]
    output: Vec<PathBuf>,
    /// Print settings, times, rays and memory as JSON
    #[arg(long)]
    json: bool,
    /// Say nothing but errors
    #[arg(short, long)]
    quiet: bool,
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

/// Renders; `settings` are the command's settings by name, for the header.
pub(crate) fn render(args: &RenderArgs, mut settings: BTreeMap<String, String>) -> Result<()> {
    let (voice, picture) = (Voice::new(args.quiet), &args.picture);
    check_outputs(args)?;
    picture.check()?;
    let choice = picture.choice()?;
    let mut seconds = Seconds::default();
    let (shot, time) = timed(|| picture.shot(picture.load(voice)?, voice));
    let shot = shot?;
    seconds.load = time;
    let (ground, time) = timed(|| {
        let _wheel = voice.wheel("building the tracer");
        Ground::build(choice, picture.adapter.as_deref(), &picture.plan(&shot))
    });
    let ground = ground?;
    seconds.build = time;
    let wanted = picture.settings();
    let order = picture.order(&shot, &wanted);
    picture.complete(&mut settings, choice, &ground, &order);
    let (made, time) = timed(|| make(picture, &shot.scene, &ground, order, voice));
    let made = made?;
    seconds.render = time;
    log_passes(&made, time);
    let noise: BTreeMap<String, f32> = made
        .render
        .estimates
        .iter()
        .map(|estimate| (estimate.quantity.to_string(), estimate.noise))
        .collect();
    let device = ground.device();
    let rays = made.render.rays;
    let (passes, gpu_seconds) = (made.passes, made.gpu_seconds);
    let image = image(made.render, made.stages, &settings, &device);
    let (written, time) = timed(|| write(args, &image, voice));
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
        triangles: shot.scene.triangle_count(),
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

fn log_passes(made: &Made, seconds: f64) {
    for pass in &made.passes {
        let (rays, seconds) = (pass.rays + pass.shadow_rays, pass.seconds);
        tracing::debug!(pass = pass.name, rays, seconds, "pass done");
    }
    tracing::debug!(rays = made.render.rays, seconds, "picture made");
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

/// Hours of work must not end at a file that cannot be written, or that cannot hold what was asked for.
fn check_outputs(args: &RenderArgs) -> Result<()> {
    let quantities = args.picture.quantity.len();
    for path in &args.output {
        ensure!(
            has_suffix(path, &["exr", "png"]),
            "{}: unknown suffix; .exr and .png are known",
            path.display()
        );
        ensure!(
            quantities == 1 || has_suffix(path, &["exr"]),
            "{}: a .png shows one quantity; write .exr for {quantities}",
            path.display(),
        );
        check_writable(path)?;
    }
    Ok(())
}

fn make(
    args: &PictureArgs,
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

fn write(args: &RenderArgs, image: &Image, voice: Voice) -> Result<()> {
    for path in &args.output {
        let is_exr = has_suffix(path, &["exr"]);
        let (written, seconds) = timed(|| match is_exr {
            true => image.save(path),
            false => image.save_png(path, args.picture.exposure),
        });
        written?;
        tracing::debug!(path = %path.display(), seconds, "picture written");
        if !is_exr {
            voice.note(format_args!(
                "{} shows {} as sRGB at exposure {} stops; write .exr for measuring",
                path.display(),
                args.picture.quantity[0],
                args.picture.exposure
            ));
        }
    }
    Ok(())
}
