//! What picking virtual point lights for each point gains: errors at times, one line of JSON for each way, number of lights and
//! scene.
//!
//! ```sh
//! cargo bench -p isophote-instant-gi --bench importance -- SCENE... [--size WxH] [--seeds N] [--truth PATHS] [--way NAME[,…]]
//! ```
//!
//! With N lights:
//! - `plain`: N light paths, all of whose lights every pixel asks for.
//! - `kept`: eight times as many, of whose lights N are kept for the picture.
//! - `selected`, `selected-16`: four and sixteen times as many, of which every pixel picks N.
//! - `interleaved`, `filled`: nine times as many, divided among 3 × 3 pixels and joined by the filters `edges` and `fill`.
//! - `kept-filled`: seventy-two times as many, of which nine times as many are kept, divided and filled.
//!
//! Light paths, gathering and filters count towards the time. The truth is the plain method's with many light
//! paths of another seed. Indirect light of diffuse materials, one bounce.

use std::{path::Path, sync::Arc};

use glam::Vec3;
use isophote_instant_gi::{Filter, GiParams, InstantGi, Stages};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Scene, Selection, builtin, load,
    reference::{Materials, Tracers},
};
use serde_json::json;

const WAYS: [&str; 7] = [
    "plain",
    "kept",
    "selected",
    "selected-16",
    "interleaved",
    "filled",
    "kept-filled",
];
/// Seeds of the truth lie far from those of what is measured.
const TRUTH: u64 = 1 << 20;

/// What is measured.
struct Arguments {
    scenes: Vec<String>,
    size: [u32; 2],
    seeds: u64,
    truth: u32,
    ways: Vec<String>,
}

fn main() {
    let arguments = Arguments::parse(std::env::args().skip(1));
    for name in &arguments.scenes {
        let bench = Bench::new(name, arguments.size);
        let truth = bench.render(&GiParams {
            seed: TRUTH,
            ..params("plain", arguments.truth)
        });
        for way in &arguments.ways {
            for lights in [30, 90, 180, 360, 720] {
                bench.run(&arguments, way, lights, &truth.indirect);
            }
        }
    }
}

impl Arguments {
    fn parse(mut words: impl Iterator<Item = String>) -> Self {
        let mut arguments = Self {
            scenes: Vec::new(),
            size: [200, 150],
            seeds: 4,
            truth: 16_384,
            ways: WAYS.map(str::to_owned).into(),
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
                "--seeds" => arguments.seeds = value().parse().expect("a number"),
                "--truth" => arguments.truth = value().parse().expect("a number"),
                "--way" => arguments.ways = value().split(',').map(str::to_owned).collect(),
                flag if flag.starts_with("--") => panic!("what is {flag}?"),
                scene => arguments.scenes.push(scene.into()),
            }
        }
        if arguments.scenes.is_empty() {
            arguments.scenes.push("builtin:office".into());
        }
        arguments
    }
}

/// A way to spend N rays a pixel.
fn params(way: &str, lights: u32) -> GiParams {
    let plain = GiParams {
        paths: lights,
        light_rays: 1,
        materials: Materials::Lambert,
        ..GiParams::default()
    };
    let of_more = |times, selection| GiParams {
        paths: times * lights,
        selection,
        ..plain
    };
    let tiled = |filter| GiParams {
        interleaving: [3, 3],
        filter,
        ..of_more(9, 0)
    };
    match way {
        "plain" => plain,
        "selected" => of_more(4, lights),
        "selected-16" => of_more(16, lights),
        "kept" => GiParams {
            kept: lights,
            ..of_more(8, 0)
        },
        "interleaved" => tiled(Filter::Edges),
        "filled" => tiled(Filter::Fill),
        "kept-filled" => GiParams {
            paths: 72 * lights,
            kept: 9 * lights,
            ..tiled(Filter::Fill)
        },
        _ => panic!("what is the way {way}?"),
    }
}

/// A scene, and who answers its rays.
struct Bench<'a> {
    name: &'a str,
    size: [u32; 2],
    scene: Arc<Scene>,
    tracer: BvhTracer,
}

impl<'a> Bench<'a> {
    fn new(name: &'a str, size: [u32; 2]) -> Self {
        let scene = match builtin::is_builtin(name) {
            true => builtin::build(name),
            false => load(Path::new(name)),
        };
        let scene = Arc::new(scene.expect("a scene"));
        let tracer = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default())
            .expect("a tracer");
        Self {
            name,
            size,
            scene,
            tracer,
        }
    }

    fn render(&self, params: &GiParams) -> Stages {
        let tracers = Tracers {
            exact: &self.tracer,
            secondary: &self.tracer,
        };
        let gi = InstantGi::new(&self.scene, tracers, params).expect("parameters in their range");
        let camera = &self.scene.cameras[0];
        gi.render(camera, self.size, &|_, _| {}).expect("a picture")
    }

    fn run(&self, arguments: &Arguments, way: &str, lights: u32, truth: &[Vec3]) {
        let (mut times, mut rays) = (Vec::new(), 0);
        let (mut squares, mut bias) = (0.0, 0.0);
        for seed in 1..=arguments.seeds {
            let stages = self.render(&GiParams {
                seed,
                ..params(way, lights)
            });
            let counted = stages.passes.iter();
            let counted =
                counted.filter(|pass| ["vpls", "keep", "indirect", "filter"].contains(&pass.name));
            times.push(counted.clone().map(|pass| pass.seconds).sum::<f64>());
            rays = counted.map(|pass| pass.rays).sum();
            let [rmse, off] = errors(&stages.indirect, truth);
            squares += rmse * rmse;
            bias += off;
        }
        times.sort_by(f64::total_cmp);
        let seeds = arguments.seeds as f64;
        let line = json!({
            "scene": self.name, "way": way, "lights": lights, "size": self.size, "rays": rays,
            "seconds": times[times.len() / 2],
            "rel_rmse": (squares / seeds).sqrt(), "bias": bias / seeds,
        });
        println!("{line}");
    }
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
