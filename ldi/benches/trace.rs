//! What maps cost and what they get wrong, beside the exact tracer on the same rays: one line of JSON for each setting.
//!
//! ```sh
//! cargo bench -p isophote-ldi --bench trace -- SCENE... [--bounds X0,Y0,Z0,X1,Y1,Z1] [--case CELLSxPIXELS:LAYERS[:EPSILON[:DEPTH_ERROR]]]...
//!     [--rays N] [--truth SAMPLES] [--conformance N] [--share PERCENT]...
//! ```
//!
//! Layers are `touched` or `center`. Rates are of one thread, on incoherent diffuse rays around the camera, tracing
//! alone. `--truth 0` leaves out the pictures, `--conformance 0` the suite. The built-in atrium, 4x128 of both layers and
//! a share of 15 unless given.

use std::{
    path::Path,
    sync::{Arc, Mutex},
    time::Instant,
};

use glam::Vec3;
use isophote_ldi::{Coverage, Directions, LdiParams, LdiTracer, cpu::build::pairs};
use isophote_scene::{
    Aabb, Answers, BuildTracer, BvhOptions, BvhTracer, Confident, Hit, Ray, Scene, Selection,
    SurfaceId, Tracer, WithFallback, builtin, load,
    reference::{Materials, Quantity, Settings, Tracers, render},
    sample::{Frame, Sampler, cosine_hemisphere, uniform_sphere},
    testing::{Tolerances, conformance},
};
use serde_json::{Value, json};

const REPEATS: usize = 3;
/// Pictures by which light is compared.
const SIZE: [u32; 2] = [80, 60];
/// t is off where it differs by more than this share of it.
const OFF: f32 = 1e-3;

/// What is measured.
struct Arguments {
    scenes: Vec<String>,
    bounds: Option<Aabb>,
    cases: Vec<LdiParams>,
    rays: usize,
    truth: u32,
    conformance: usize,
    shares: Vec<f32>,
}

fn main() {
    let arguments = Arguments::parse(std::env::args().skip(1));
    for name in &arguments.scenes {
        let scene = match builtin::is_builtin(name) {
            true => builtin::build(name),
            false => load(Path::new(name)),
        };
        let scene = Arc::new(scene.expect("a scene"));
        Bench::new(&arguments, name, scene).run();
    }
}

impl Arguments {
    fn parse(mut words: impl Iterator<Item = String>) -> Self {
        let mut arguments = Self {
            scenes: Vec::new(),
            bounds: None,
            cases: Vec::new(),
            rays: 1 << 20,
            truth: 128,
            conformance: 0,
            shares: Vec::new(),
        };
        while let Some(word) = words.next() {
            let mut value = || words.next().expect("a value");
            match word.as_str() {
                // Cargo's own.
                "--bench" => {}
                "--bounds" => arguments.bounds = Some(bounds(&value())),
                "--case" => arguments.cases.push(case(&value())),
                "--rays" => arguments.rays = value().parse().expect("a number"),
                "--truth" => arguments.truth = value().parse().expect("a number"),
                "--conformance" => arguments.conformance = value().parse().expect("a number"),
                "--share" => arguments.shares.push(value().parse().expect("a number")),
                flag if flag.starts_with("--") => panic!("what is {flag}?"),
                scene => arguments.scenes.push(scene.into()),
            }
        }
        if arguments.scenes.is_empty() {
            arguments.scenes.push("builtin:atrium".into());
        }
        if arguments.cases.is_empty() {
            arguments.cases = ["4x128:touched", "4x128:center"].map(case).into();
        }
        if arguments.shares.is_empty() {
            arguments.shares.push(15.0);
        }
        arguments
    }
}

fn bounds(text: &str) -> Aabb {
    let numbers: Vec<f32> = text
        .split(',')
        .map(|number| number.parse().expect("a number"))
        .collect();
    let [min, max] = [0, 3].map(|first| Vec3::from_slice(&numbers[first..]));
    Aabb { min, max }
}

fn case(text: &str) -> LdiParams {
    let mut parts = text.split(':');
    let (cells, resolution) = parts
        .next()
        .and_then(|size| size.split_once('x'))
        .expect("CELLSxPIXELS");
    let default = LdiParams::default();
    LdiParams {
        cells: cells.parse().expect("a number"),
        resolution: resolution.parse().expect("a number"),
        coverage: match parts.next() {
            Some("center") => Coverage::Center,
            _ => Coverage::Touched,
        },
        epsilon: parts
            .next()
            .map_or(default.epsilon, |text| text.parse().expect("a number")),
        depth_error: parts
            .next()
            .map_or(default.depth_error, |text| text.parse().expect("a number")),
        max_bytes: 16 << 30,
    }
}

/// A scene, rays through it, and what is true.
struct Bench<'a> {
    arguments: &'a Arguments,
    name: &'a str,
    scene: Arc<Scene>,
    selection: Selection,
    exact: BvhTracer,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    rates: [f64; 2],
    picture: Vec<Vec3>,
}

impl<'a> Bench<'a> {
    fn new(arguments: &'a Arguments, name: &'a str, scene: Arc<Scene>) -> Self {
        let selection = Selection {
            bounds: arguments.bounds,
            ..Selection::default()
        };
        let options = BvhOptions::default();
        let exact = BvhTracer::build(&scene, &selection, &options).expect("a tracer");
        let rays = diffuse(&scene, &exact, arguments.rays);
        let (hits, rates) = rates(&exact, &rays);
        let picture = indirect(&scene, &exact, &exact, arguments.truth);
        Self {
            arguments,
            name,
            scene,
            selection,
            exact,
            rays,
            hits,
            rates,
            picture,
        }
    }

    fn run(&self) {
        for params in &self.arguments.cases {
            let start = Instant::now();
            let maps = LdiTracer::build(&self.scene, &self.selection, params).expect("maps");
            let report = self.measure(&maps, start.elapsed().as_secs_f64());
            println!("{report}");
        }
    }

    /// Bytes as the paper would hold maps of the same answers (§3.1): a depth and a triangle of four bytes each for every
    /// triangle in a pixel, four bytes a pixel, and a map for each of two opposite directions.
    fn unshared_bytes(&self, tracer: &LdiTracer) -> u64 {
        let transforms = self.scene.transforms();
        let pairs = pairs(&self.scene, &transforms, &self.selection, tracer.params());
        2 * (8 * pairs.expect("maps") + 4 * tracer.maps().pixels.len() as u64)
    }

    fn measure(&self, tracer: &LdiTracer, build_seconds: f64) -> Value {
        let (params, maps) = (tracer.params(), tracer.maps());
        let (hits, rates) = rates(tracer, &self.rays);
        let layers = maps.layers.count();
        let mut report = json!({
            "scene": self.name,
            "triangles": self.scene.triangle_count(),
            "cells": params.cells,
            "directions": 6 * params.cells * params.cells,
            "resolution": params.resolution,
            "layers": if params.coverage == Coverage::Center { "center" } else { "touched" },
            "epsilon": params.epsilon,
            "build_seconds": build_seconds,
            "bytes": maps.bytes(),
            "map_bytes": maps.map_bytes(),
            "layer_count": layers,
            "depth_error": params.depth_error,
            "depth_error_kept": maps.depth_error(),
            "depth_bits": maps.layers.packing().depth_bits(),
            "bytes_per_layer": maps.layers.packing().bytes(),
            "map_bytes_per_layer": maps.map_bytes() as f64 / layers as f64,
            "unshared_bytes": self.unshared_bytes(tracer),
            "rays": self.rays.len(),
            "closest_mrays": rates[0],
            "any_mrays": rates[1],
            "exact_closest_mrays": self.rates[0],
            "exact_any_mrays": self.rates[1],
            "crossings": crossings(tracer, &self.rays, &hits),
            "confused": share_of(&hits, &self.hits, is_confused),
            "t_off": share_of(&hits, &self.hits, t_is_off),
        });
        if self.arguments.truth > 0 {
            report["truth"] = self.truth(tracer);
        }
        // The suite's rays come from the whole scene, of which maps within bounds hold a part.
        if self.arguments.conformance > 0 && self.arguments.bounds.is_none() {
            report["conformance"] = self.conformance(tracer);
        }
        if params.coverage == Coverage::Center {
            let rays = self.picture_rays(tracer);
            let dials = self.arguments.shares.iter();
            let dials = dials.map(|share| self.dial(tracer, &rays, share / 100.0));
            report["dials"] = dials.collect();
        }
        report
    }

    /// The first rays that the picture asks of the secondary tracer, as many as are measured; one after the other as the
    /// picture's pixels lie.
    fn picture_rays(&self, tracer: &LdiTracer) -> Vec<Ray> {
        let recorder = Recorder {
            tracer,
            rays: Mutex::default(),
        };
        let samples = self.arguments.rays.div_ceil((SIZE[0] * SIZE[1]) as usize);
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let one = one.expect("a thread");
        one.install(|| indirect(&self.scene, &self.exact, &recorder, samples as u32));
        let mut rays = recorder.rays.into_inner().expect("no panic");
        rays.truncate(self.arguments.rays);
        rays
    }

    /// The light of one bounce beside that by the exact tracer, with the same samples.
    fn truth(&self, tracer: &impl Tracer) -> Value {
        let picture = indirect(&self.scene, &self.exact, tracer, self.arguments.truth);
        let mean = |values: &[Vec3]| {
            let sum: f64 = values.iter().map(|v| f64::from(v.element_sum())).sum();
            sum / (3 * values.len()) as f64
        };
        let pairs = picture.iter().zip(&self.picture);
        let squares: f64 = pairs
            .map(|(a, b)| f64::from((*a - *b).length_squared()))
            .sum();
        let rms = (squares / (3 * picture.len()) as f64).sqrt();
        let of = mean(&self.picture);
        json!({
            "size": SIZE,
            "samples": self.arguments.truth,
            "rel_rmse": rms / of,
            "bias": mean(&picture) / of - 1.0,
        })
    }

    fn conformance(&self, tracer: &LdiTracer) -> Value {
        let tolerances = Tolerances {
            t_error: 1e-4,
            ..Tolerances::EXACT
        };
        let count = self.arguments.conformance;
        let report = conformance(&self.scene, tracer, &self.exact, &tolerances, count, 0);
        let kinds = report.kinds.iter().map(|(kind, found)| {
            let of_rays = |count: usize| count as f64 / found.rays as f64;
            json!({
                "kind": format!("{kind:?}"),
                "leaks": found.leak_rate(),
                "false_hits": of_rays(found.false_hits),
                "false_misses": of_rays(found.false_misses),
                "early": of_rays(found.early),
                "late": of_rays(found.late),
            })
        });
        kinds.collect()
    }

    /// The dial where it sends this share of the rays to the exact tracer, sorting and asking again in the time. Its share,
    /// its speed and what it gets wrong are of the rays of the picture that its error is of.
    fn dial(&self, tracer: &LdiTracer, rays: &[Ray], share: f32) -> Value {
        let (truth, exact_rates) = rates(&self.exact, rays);
        let mut answers = vec![(None, 0.0); rays.len()];
        tracer.closest_all_with_confidence(rays, &mut answers);
        let mut sure: Vec<f32> = answers.iter().map(|answer| answer.1).collect();
        sure.sort_by(f32::total_cmp);
        let index = (share * sure.len() as f32) as usize;
        let least = sure.get(index).copied().unwrap_or(2.0);
        let dial = WithFallback::new(tracer, &self.exact, least);
        let (hits, rates) = rates(&dial, rays);
        let sent = answers.iter().filter(|answer| answer.1 < least).count();
        let mut report = json!({
            "least_sure": least,
            "exact_share": sent as f64 / answers.len() as f64,
            "rays": rays.len(),
            "closest_mrays": rates[0],
            "any_mrays": rates[1],
            "exact_closest_mrays": exact_rates[0],
            "exact_any_mrays": exact_rates[1],
            "confused": share_of(&hits, &truth, is_confused),
            "t_off": share_of(&hits, &truth, t_is_off),
        });
        if self.arguments.truth > 0 {
            report["truth"] = self.truth(&dial);
        }
        report
    }
}

/// Keeps what is asked.
struct Recorder<'a> {
    tracer: &'a LdiTracer,
    rays: Mutex<Vec<Ray>>,
}

impl Recorder<'_> {
    fn keep(&self, ray: &Ray) {
        self.rays.lock().expect("no panic").push(*ray);
    }
}

impl Tracer for Recorder<'_> {
    fn answers(&self) -> Answers {
        self.tracer.answers()
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.keep(ray);
        self.tracer.closest_hit(ray)
    }

    fn any_hit(&self, ray: &Ray) -> bool {
        self.tracer.any_hit(ray)
    }

    fn closest_hit_from(&self, ray: &Ray, start: SurfaceId) -> Option<Hit> {
        self.keep(ray);
        self.tracer.closest_hit_from(ray, start)
    }

    fn any_hit_from(&self, ray: &Ray, start: SurfaceId) -> bool {
        self.tracer.any_hit_from(ray, start)
    }
}

/// The share of the rays about whose answers something is so.
fn share_of(
    hits: &[Option<Hit>],
    truth: &[Option<Hit>],
    so: fn(&Option<Hit>, &Option<Hit>) -> bool,
) -> f64 {
    let pairs = hits.iter().zip(truth);
    pairs.filter(|(hit, truth)| so(hit, truth)).count() as f64 / hits.len() as f64
}

fn is_confused(hit: &Option<Hit>, truth: &Option<Hit>) -> bool {
    hit.is_some() != truth.is_some()
}

fn t_is_off(hit: &Option<Hit>, truth: &Option<Hit>) -> bool {
    let pair = hit.zip(*truth);
    pair.is_some_and(|(hit, truth)| (hit.t - truth.t).abs() > OFF * truth.t)
}

/// One bounce of light, secondary rays by another tracer; the same samples for every tracer.
fn indirect<T: Tracer>(scene: &Scene, exact: &BvhTracer, secondary: &T, samples: u32) -> Vec<Vec3> {
    if samples == 0 {
        return Vec::new();
    }
    let settings = Settings {
        samples,
        materials: Materials::Lambert,
        ..Settings::default()
    };
    let tracers = Tracers { exact, secondary };
    let (camera, quantities) = (&scene.cameras[0], [Quantity::Indirect]);
    let quiet = |_, _| {};
    let picture = render(scene, tracers, camera, SIZE, &quantities, &settings, &quiet);
    let estimates = picture.expect("a picture").estimates;
    estimates.into_iter().flat_map(|one| one.values).collect()
}

/// Million rays per second on this thread, closest and any; the best of some.
fn rates(tracer: &dyn Tracer, rays: &[Ray]) -> (Vec<Option<Hit>>, [f64; 2]) {
    let (mut hits, mut any) = (vec![None; rays.len()], vec![false; rays.len()]);
    let mut best = [f64::INFINITY; 2];
    for _ in 0..REPEATS {
        let start = Instant::now();
        tracer.closest_hits(rays, &mut hits);
        best[0] = best[0].min(start.elapsed().as_secs_f64());
        let start = Instant::now();
        tracer.any_hits(rays, &mut any);
        best[1] = best[1].min(start.elapsed().as_secs_f64());
    }
    (hits, best.map(|seconds| rays.len() as f64 / seconds / 1e6))
}

/// How many pixels of its map a ray visits on average, up to its hit or the map's end.
fn crossings(tracer: &LdiTracer, rays: &[Ray], hits: &[Option<Hit>]) -> f64 {
    let maps = tracer.maps();
    let directions = Directions::new(tracer.params().cells);
    let side = f64::from(maps.resolution);
    let visited = |(ray, hit): (&Ray, &Option<Hit>)| {
        let map = directions.nearest(ray.direction);
        let (frame, a) = (&maps.frames[map], directions.axis(map));
        let place = |v: Vec3, low: [f32; 2]| {
            let [b, c] = [(a + 1) % 3, (a + 2) % 3];
            [(b, 0), (c, 1)].map(|(axis, i)| {
                f64::from((v[axis] - frame.slope[i] * v[a] - low[i]) * frame.scale[i])
            })
        };
        let (start, turn) = (
            place(ray.origin, [frame.low[0], frame.low[1]]),
            place(ray.direction, [0.0; 2]),
        );
        // Where the ray leaves the map, if it hits nothing before.
        let leaves = (0..2).map(|i| {
            let end = if turn[i] > 0.0 { side } else { 0.0 };
            ((end - start[i]) / turn[i]).max(0.0)
        });
        let end = hit.map_or(f64::INFINITY, |hit| f64::from(hit.t));
        let end = leaves.filter(|end| end.is_finite()).fold(end, f64::min);
        let steps = |i: usize| {
            let last = start[i] + end * turn[i];
            (last.clamp(0.0, side).floor() - start[i].clamp(0.0, side).floor()).abs()
        };
        1.0 + steps(0) + steps(1)
    };
    rays.iter().zip(hits).map(visited).sum::<f64>() / rays.len() as f64
}

/// Cosine-distributed rays from the surfaces seen all around the camera.
fn diffuse(scene: &Scene, tracer: &impl Tracer, count: usize) -> Vec<Ray> {
    let eye = scene.cameras[0].position();
    let lift = 1e-5 * scene.bounds().diagonal();
    (0..)
        .filter_map(|index| {
            let sampler = Sampler::new(0, 0, index);
            let look = Ray::new(eye, uniform_sphere(sampler.get_2d(0)));
            let point = scene.surface_point(&tracer.closest_hit(&look)?);
            let normal = point.geometric_normal
                * -1_f32.copysign(point.geometric_normal.dot(look.direction));
            let direction = Frame::new(normal).to_world(cosine_hemisphere(sampler.get_2d(1)));
            Some(Ray::new(point.position + lift * normal, direction))
        })
        .take(count)
        .collect()
}
