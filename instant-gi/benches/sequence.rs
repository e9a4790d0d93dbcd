//! What the history of a sequence of pictures gains: one line of JSON for each movement.
//!
//! ```sh
//! cargo bench -p isophote-instant-gi --bench sequence -- SCENE [--size WxH] [--paths N] [--pictures N]
//! ```
//!
//! Pictures are made as the paper makes them, 4 × 4 and 3 × 3, but with gaps filled. Nothing moves, or the camera, by 2 cm and half a
//! degree from picture to picture, or an object, by 2 cm; the last picture is the same in all. Errors are those of its irradiance
//! against 4096 light paths without shortcuts: with the history of so many pictures, and of one picture with as many
//! times the light paths. The built-in office, 200 × 150 pixels, 180 paths and 16 pictures unless given.

use std::{path::Path, sync::Arc, time::Instant};

use glam::{Affine3A, Quat, Vec3};
use isophote_instant_gi::{Filter, GiParams, History, InstantGi, Stages};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Camera, GBuffer, Scene, Selection, builtin, load,
    reference::{Materials, Tracers},
};
use serde_json::{Value, json};

/// What is measured.
struct Arguments {
    scene: String,
    size: [u32; 2],
    paths: u32,
    pictures: u32,
}

/// Metres and radians from picture to picture.
const STEP: f32 = 0.02;
const TURN: f32 = 0.0087;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Moving {
    Nothing,
    Camera,
    Object,
}

fn main() {
    let arguments = Arguments::parse(std::env::args().skip(1));
    let scene = match builtin::is_builtin(&arguments.scene) {
        true => builtin::build(&arguments.scene),
        false => load(Path::new(&arguments.scene)),
    };
    let scene = Arc::new(scene.expect("a scene"));
    let plain = GiParams {
        paths: 4096,
        light_rays: 1,
        materials: Materials::Lambert,
        ..GiParams::default()
    };
    let bench = Bench {
        arguments: &arguments,
        object: object(&scene, &arguments),
        truth: render(&scene, &scene.cameras[0], &plain, arguments.size, None).irradiance,
        plain,
        scene: scene.clone(),
    };
    for moving in [Moving::Nothing, Moving::Camera, Moving::Object] {
        println!("{}", bench.run(moving));
    }
}

impl Arguments {
    fn parse(mut words: impl Iterator<Item = String>) -> Self {
        let mut arguments = Self {
            scene: "builtin:office".into(),
            size: [200, 150],
            paths: 180,
            pictures: 16,
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
                "--pictures" => arguments.pictures = value().parse().expect("a number"),
                flag if flag.starts_with("--") => panic!("what is {flag}?"),
                scene => arguments.scene = scene.into(),
            }
        }
        arguments
    }
}

/// The instance that takes nearest to a twentieth of the picture.
fn object(scene: &Arc<Scene>, arguments: &Arguments) -> usize {
    let exact = tracer(scene);
    let camera = &scene.cameras[0];
    let seen = GBuffer::see(scene, &exact, camera, arguments.size, Materials::Lambert);
    let mut pixels = vec![0_usize; scene.instances.len()];
    for seen in seen.pixels.iter().flatten() {
        pixels[seen.point.surface.instance as usize] += 1;
    }
    let wanted = seen.pixels.len() / 20;
    let numbers = 0..pixels.len();
    let nearest = numbers.min_by_key(|&number| pixels[number].abs_diff(wanted));
    nearest.expect("an instance")
}

fn tracer(scene: &Arc<Scene>) -> BvhTracer {
    BvhTracer::build(scene, &Selection::default(), &BvhOptions::default()).expect("a tracer")
}

fn render(
    scene: &Arc<Scene>,
    camera: &Camera,
    params: &GiParams,
    size: [u32; 2],
    history: Option<&mut History>,
) -> Stages {
    let exact = tracer(scene);
    let tracers = Tracers {
        exact: &exact,
        secondary: &exact,
    };
    let gi = InstantGi::new(scene, tracers, params).expect("parameters in their range");
    let stages = match history {
        Some(history) => gi.render_next(camera, size, history, &|_, _| {}),
        None => gi.render(camera, size, &|_, _| {}),
    };
    stages.expect("a picture")
}

struct Bench<'a> {
    arguments: &'a Arguments,
    scene: Arc<Scene>,
    object: usize,
    plain: GiParams,
    truth: Vec<Vec3>,
}

impl Bench<'_> {
    fn run(&self, moving: Moving) -> Value {
        let Arguments {
            paths,
            pictures,
            size,
            ..
        } = *self.arguments;
        let params = GiParams {
            paths,
            downsampling: 4,
            interleaving: [3, 3],
            filter: Filter::Fill,
            ..self.plain
        };
        let mut history = History::new(32).expect("a length");
        let mut errors = Vec::new();
        let mut seconds = 0.0;
        for number in 0..pictures {
            let left = (pictures - 1 - number) as f32;
            let (scene, camera) = self.moved(moving, left);
            let start = Instant::now();
            let stages = render(&scene, &camera, &params, size, Some(&mut history));
            seconds += start.elapsed().as_secs_f64();
            let rows = (number + 1).is_power_of_two() && moving == Moving::Nothing;
            if rows || number + 1 == pictures {
                errors.push(json!([number + 1, self.rel_rmse(&stages)]));
            }
        }
        let camera = &self.scene.cameras[0];
        let more = [1, 2, 4, 8, pictures].map(|times| {
            let params = GiParams {
                paths: paths * times,
                ..params
            };
            let start = Instant::now();
            let stages = render(&self.scene, camera, &params, size, None);
            json!([times, self.rel_rmse(&stages), start.elapsed().as_secs_f64()])
        });
        json!({
            "scene": self.arguments.scene,
            "moving": format!("{moving:?}"),
            "size": size,
            "paths": paths,
            "picture_seconds": seconds / f64::from(pictures),
            "rel_rmse_after_pictures": errors,
            "rel_rmse_and_seconds_of_times_the_paths": more,
        })
    }

    /// What is seen so many pictures before the last.
    fn moved(&self, moving: Moving, left: f32) -> (Arc<Scene>, Camera) {
        let mut camera = self.scene.cameras[0].clone();
        let mut scene = self.scene.clone();
        match moving {
            Moving::Nothing => {}
            Moving::Camera => {
                let turn = Affine3A::from_quat(Quat::from_rotation_y(left * TURN));
                let step = Affine3A::from_translation(left * STEP * Vec3::X);
                camera.transform = camera.transform * step * turn;
            }
            Moving::Object => {
                let scene = Arc::make_mut(&mut scene);
                let translation = &mut scene.instances[self.object].transform.translation;
                translation.x += left * STEP;
            }
        }
        (scene, camera)
    }

    fn rel_rmse(&self, stages: &Stages) -> f64 {
        let sum = |values: &[Vec3]| -> f64 {
            let sums = values.iter().map(|value| f64::from(value.element_sum()));
            sums.sum()
        };
        let pairs = stages.irradiance.iter().zip(&self.truth);
        let squares: f64 = pairs
            .map(|(a, b)| f64::from((*a - *b).length_squared()))
            .sum();
        let count = 3.0 * self.truth.len() as f64;
        (squares / count).sqrt() / (sum(&self.truth) / count)
    }
}
