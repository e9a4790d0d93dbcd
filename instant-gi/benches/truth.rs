//! How far the light of many virtual point lights is from the reference integrator's: one line of JSON for each scene.
//!
//! ```sh
//! cargo bench -p isophote-instant-gi --bench truth -- SCENE... [--size WxH] [--paths N] [--samples N] [--min-d METRES]
//!     [--compensation RAYS] [--unbounded] [--halton] [--keep N]
//! ```
//!
//! Both are asked at the same points, what the pixels' centres show, and both leave out light that travelled less than about
//! `--min-d`, unless the reference is `--unbounded`. No shortcuts, diffuse materials, one bounce. The reference's noise is told by two
//! halves of its samples and left out of `rel_rmse_beyond`; `constant` is the error of its mean, which a method must beat by far.
//! Light paths start on a lattice, or with `--halton` as in the paper; with `--keep` so many of their lights are kept.
//! The built-in Cornell box, 160x120 pixels, 4096 paths and 1024 samples unless given.

use std::{path::Path, sync::Arc, time::Instant};

use glam::Vec3;
use isophote_instant_gi::{GiParams, InstantGi, Sequence};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Receivers, Scene, Selection, builtin, facing, load,
    reference::{Estimate, Materials, Quantity, Settings, Tracers, bake},
};
use serde_json::{Value, json};

/// What is measured.
struct Arguments {
    scenes: Vec<String>,
    size: [u32; 2],
    paths: u32,
    samples: u32,
    min_d: f32,
    compensation: u32,
    is_unbounded: bool,
    sequence: Sequence,
    kept: u32,
}

fn main() {
    let arguments = Arguments::parse(std::env::args().skip(1));
    for name in &arguments.scenes {
        println!("{}", measure(&arguments, name));
    }
}

impl Arguments {
    fn parse(mut words: impl Iterator<Item = String>) -> Self {
        let mut arguments = Self {
            scenes: Vec::new(),
            size: [160, 120],
            paths: 4096,
            samples: 1024,
            min_d: 0.1,
            compensation: 0,
            is_unbounded: false,
            sequence: Sequence::default(),
            kept: 0,
        };
        while let Some(word) = words.next() {
            let mut value = || words.next().expect("a value");
            match word.as_str() {
                // Cargo's own.
                "--bench" => {}
                "--size" => {
                    let size = value();
                    let (width, height) = size.split_once('x').expect("WxH");
                    arguments.size = [width, height].map(|side| side.parse().expect("a number"));
                }
                "--paths" => arguments.paths = value().parse().expect("a number"),
                "--samples" => arguments.samples = value().parse().expect("a number"),
                "--min-d" => arguments.min_d = value().parse().expect("a number"),
                "--compensation" => arguments.compensation = value().parse().expect("a number"),
                "--unbounded" => arguments.is_unbounded = true,
                "--keep" => arguments.kept = value().parse().expect("a number"),
                "--halton" => arguments.sequence = Sequence::Halton,
                flag if flag.starts_with("--") => panic!("what is {flag}?"),
                scene => arguments.scenes.push(scene.into()),
            }
        }
        if arguments.scenes.is_empty() {
            arguments.scenes.push("builtin:cornell".into());
        }
        arguments
    }
}

fn measure(arguments: &Arguments, name: &str) -> Value {
    let scene = match builtin::is_builtin(name) {
        true => builtin::build(name),
        false => load(Path::new(name)),
    };
    let scene = Arc::new(scene.expect("a scene"));
    let exact =
        BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default()).expect("a tracer");
    let tracers = Tracers {
        exact: &exact,
        secondary: &exact,
    };
    let start = Instant::now();
    let params = GiParams {
        paths: arguments.paths,
        sequence: arguments.sequence,
        kept: arguments.kept,
        min_d: arguments.min_d,
        compensation: arguments.compensation,
        light_rays: 1,
        materials: Materials::Lambert,
        ..GiParams::default()
    };
    let gi = InstantGi::new(&scene, tracers, &params).expect("parameters in their range");
    let stages = gi.render(&scene.cameras[0], arguments.size, &|_, _| {});
    let stages = stages.expect("a picture");
    let seconds = start.elapsed().as_secs_f64();
    let (truth, pixels) = reference(arguments, &scene, tracers);
    let found: Vec<Vec3> = pixels.iter().map(|&pixel| stages.indirect[pixel]).collect();
    let [rel_rmse, bias] = errors(&found, &truth.values);
    let mean = truth.values.iter().sum::<Vec3>() / truth.values.len() as f32;
    let [constant, _] = errors(&vec![mean; truth.values.len()], &truth.values);
    let noise = f64::from(truth.noise);
    json!({
        "scene": name,
        "size": arguments.size,
        "paths": arguments.paths,
        "sequence": format!("{:?}", arguments.sequence),
        "kept": arguments.kept,
        "vpls": stages.vpls.len(),
        "samples": arguments.samples,
        "min_d": arguments.min_d,
        "compensation": arguments.compensation,
        "unbounded": arguments.is_unbounded,
        "seconds": seconds,
        "rel_rmse": rel_rmse,
        "bias": bias,
        "noise": noise,
        "rel_rmse_beyond": (rel_rmse.powi(2) - noise.powi(2)).max(0.0).sqrt(),
        "constant": constant,
    })
}

/// The reference at what the pixels show, and the numbers of those pixels.
fn reference(
    arguments: &Arguments,
    scene: &Scene,
    tracers: Tracers<'_, BvhTracer, BvhTracer>,
) -> (Estimate, Vec<usize>) {
    let settings = Settings {
        samples: arguments.samples,
        materials: Materials::Lambert,
        min_d: match arguments.is_unbounded {
            true => 0.0,
            false => arguments.min_d,
        },
        seed: 9,
        ..Settings::default()
    };
    let camera = &scene.cameras[0];
    let mut receivers = Receivers::from_camera(scene, tracers.exact, camera, arguments.size);
    // Light is baked for the upper side of a surface; the camera may see the other.
    for receiver in &mut receivers.points {
        let point = &mut receiver.point;
        let view = camera.pinhole().eye - point.position;
        point.geometric_normal = facing(point.geometric_normal, view);
        point.shading_normal = facing(point.shading_normal, view);
    }
    let quantities = [Quantity::Indirect];
    let (estimates, _) = bake(
        scene,
        tracers,
        &receivers,
        &quantities,
        &settings,
        &|_, _| {},
    )
    .expect("a reference");
    let pixels = receivers.points.iter().map(|point| point.index as usize);
    let estimate = estimates.into_iter().next().expect("one quantity");
    (estimate, pixels.collect())
}

/// relRMSE and bias.
fn errors(values: &[Vec3], truth: &[Vec3]) -> [f64; 2] {
    let sum = |values: &[Vec3]| -> f64 {
        let sums = values.iter().map(|value| f64::from(value.element_sum()));
        sums.sum()
    };
    let squares = values.iter().zip(truth);
    let squares: f64 = squares
        .map(|(a, b)| f64::from((*a - *b).length_squared()))
        .sum();
    let count = 3.0 * truth.len() as f64;
    let mean = sum(truth) / count;
    [
        (squares / count).sqrt() / mean,
        sum(values) / sum(truth) - 1.0,
    ]
}
