//! Whether choosing virtual point lights by what they bring to the picture pays: errors at times, one line of JSON for each
//! way, number of lights and scene.
//!
//! ```sh
//! cargo bench -p isophote-instant-gi --bench importance -- SCENE... [--size WxH] [--seeds N] [--truth PATHS] [--way NAME[,…]]
//! ```
//!
//! - `plain`: as many light paths as lights.
//! - `picked`, `picked-far`: of four and of sixteen times as many light paths lights are picked for the whole picture, by what they
//!   bring to 256 of its points, seen or not, and a tenth by their power, so that none is never picked; what they bring is divided
//!   by how likely they are. They are picked at even steps along a curve through space, so that they stay spread.
//! - `picked-seen`: of four times as many, with visibility at the points.
//! - `pixel`: each pixel weighs four times as many lights, unseen, and asks rays to some, at even steps along the same curve.
//! - `interleaved`, `filled`: nine times as many light paths, divided among 3 × 3 pixels and joined by the library's filters.
//!
//! Everything counts towards the time: light paths, picking, gathering and filters. The truth is the plain method's with many light
//! paths of another seed. Indirect light of diffuse materials, one bounce.

use std::{path::Path, sync::Arc, time::Instant};

use glam::Vec3;
use isophote_instant_gi::{
    Filter, GiParams, InstantGi,
    cpu::emission::{Vpl, shoot},
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, GBuffer, Ray, Scene, Seen, Selection, Tracer, builtin,
    load,
    reference::{Materials, Tracers, bound},
    sample::hash,
};
use rayon::prelude::*;
use serde_json::json;

const MIN_D: f32 = 0.1;
const WAYS: [&str; 7] = [
    "plain",
    "picked",
    "picked-far",
    "picked-seen",
    "pixel",
    "interleaved",
    "filled",
];

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
        let bench = Bench::new(&arguments, name);
        let truth = bench.plain(arguments.truth, 1 << 20);
        for way in &arguments.ways {
            for lights in [30, 90, 180, 360, 720] {
                bench.run(&arguments, way, lights, &truth);
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

/// A scene, who answers its rays, and what its camera sees.
struct Bench<'a> {
    name: &'a str,
    scene: Arc<Scene>,
    tracer: BvhTracer,
    seen: GBuffer,
}

impl<'a> Bench<'a> {
    fn new(arguments: &Arguments, name: &'a str) -> Self {
        let scene = match builtin::is_builtin(name) {
            true => builtin::build(name),
            false => load(Path::new(name)),
        };
        let scene = Arc::new(scene.expect("a scene"));
        let tracer = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default())
            .expect("a tracer");
        let camera = &scene.cameras[0];
        let seen = GBuffer::see(&scene, &tracer, camera, arguments.size, Materials::Lambert);
        Self {
            name,
            scene,
            tracer,
            seen,
        }
    }

    fn run(&self, arguments: &Arguments, way: &str, lights: u32, truth: &[Vec3]) {
        let mut times = Vec::new();
        let (mut squares, mut bias) = (0.0, 0.0);
        for seed in 1..=arguments.seeds {
            let start = Instant::now();
            let (found, seconds) = match way {
                "plain" => (self.plain(lights, seed), None),
                "picked" => (self.picked(lights, 4, false, seed), None),
                "picked-far" => (self.picked(lights, 16, false, seed), None),
                "picked-seen" => (self.picked(lights, 4, true, seed), None),
                "pixel" => (self.by_pixel(lights, 4, seed), None),
                "interleaved" => self.interleaved(lights, Filter::Edges, seed),
                "filled" => self.interleaved(lights, Filter::Fill, seed),
                _ => panic!("what is the way {way}?"),
            };
            times.push(seconds.unwrap_or(start.elapsed().as_secs_f64()));
            let [rmse, off] = errors(&found, truth);
            squares += rmse * rmse;
            bias += off;
        }
        times.sort_by(f64::total_cmp);
        let seeds = arguments.seeds as f64;
        let line = json!({
            "scene": self.name, "way": way, "lights": lights, "size": arguments.size,
            "seconds": times[times.len() / 2],
            "rel_rmse": (squares / seeds).sqrt(), "bias": bias / seeds,
        });
        println!("{line}");
    }

    fn shot(&self, paths: u32, seed: u64) -> Vec<Vpl> {
        let params = GiParams {
            paths,
            seed,
            materials: Materials::Lambert,
            ..GiParams::default()
        };
        shoot(&self.scene, &self.tracer, &params).0
    }

    fn plain(&self, paths: u32, seed: u64) -> Vec<Vec3> {
        self.gathered(&self.shot(paths, seed))
    }

    /// Light of all of the lights at all pixels.
    fn gathered(&self, vpls: &[Vpl]) -> Vec<Vec3> {
        const CHUNK: usize = 256;
        let mut light = vec![Vec3::ZERO; self.seen.pixels.len()];
        let chunks = light
            .par_chunks_mut(CHUNK)
            .zip(self.seen.pixels.par_chunks(CHUNK));
        chunks.for_each(|(light, seen)| {
            let (mut rays, mut arrivals, mut hidden) = (Vec::new(), Vec::new(), Vec::new());
            for vpl in vpls {
                for (place, seen) in seen.iter().enumerate() {
                    if let Some(seen) = seen
                        && let Some(light) = arriving(seen, vpl)
                    {
                        rays.push(ray_between(seen, vpl));
                        arrivals.push((place, light));
                    }
                }
                if rays.len() >= 1 << 12 {
                    self.flush(&mut rays, &mut arrivals, &mut hidden, light);
                }
            }
            self.flush(&mut rays, &mut arrivals, &mut hidden, light);
            reflect(light, seen);
        });
        light
    }

    fn flush(
        &self,
        rays: &mut Vec<Ray>,
        arrivals: &mut Vec<(usize, Vec3)>,
        hidden: &mut Vec<bool>,
        light: &mut [Vec3],
    ) {
        hidden.clear();
        hidden.resize(rays.len(), false);
        self.tracer.any_hits(rays, hidden);
        rays.clear();
        for ((place, arriving), hidden) in arrivals.drain(..).zip(hidden) {
            if !*hidden {
                light[place] += arriving;
            }
        }
    }

    /// Lights picked of more for the whole picture.
    fn picked(&self, lights: u32, times: u32, are_seen: bool, seed: u64) -> Vec<Vec3> {
        let mut vpls = self.shot(times * lights, seed);
        self.along_curve(&mut vpls);
        let pixels = &self.seen.pixels;
        let points: Vec<&Seen> = (0..256)
            .filter_map(|number| pixels[number * pixels.len() / 256 + pixels.len() / 512].as_ref())
            .collect();
        let brought = |vpl: &Vpl| -> f32 {
            let light = points.iter().filter_map(|seen| {
                let light = (arriving(seen, vpl)? * seen.albedo()).element_sum();
                let is_hidden = are_seen && self.tracer.any_hit(&ray_between(seen, vpl));
                (!is_hidden).then_some(light)
            });
            light.sum()
        };
        let brought: Vec<f32> = vpls.par_iter().map(brought).collect();
        let powers: Vec<f32> = vpls.iter().map(|vpl| vpl.intensity.element_sum()).collect();
        let [all_brought, power] = [&brought, &powers].map(|all| all.iter().sum::<f32>());
        let share = |number: usize| {
            0.9 * brought[number] / all_brought.max(f32::MIN_POSITIVE)
                + 0.1 * powers[number] / power
        };
        let shares: Vec<f32> = (0..vpls.len()).map(share).collect();
        let offset = hash(seed as u32) as f32 / u32::MAX as f32;
        let mut picked = Vec::new();
        steps(&shares, lights, offset, |number, times| {
            let mut vpl = vpls[number];
            vpl.intensity *= times as f32 / (lights as f32 * shares[number]);
            picked.push(vpl);
        });
        self.gathered(&picked)
    }

    /// Lights picked of more for each pixel.
    fn by_pixel(&self, rays: u32, times: u32, seed: u64) -> Vec<Vec3> {
        let mut vpls = self.shot(times * rays, seed);
        self.along_curve(&mut vpls);
        let mut light = vec![Vec3::ZERO; self.seen.pixels.len()];
        let seen = self.seen.pixels.par_iter();
        let pixels = light.par_iter_mut().zip(seen).enumerate();
        pixels.for_each_init(
            || (Vec::new(), Vec::new(), Vec::new(), Vec::new()),
            |(all, shares, asked, arrivals), (pixel, (light, seen))| {
                let Some(seen) = seen else { return };
                all.clear();
                all.extend(
                    vpls.iter()
                        .map(|vpl| arriving(seen, vpl).unwrap_or(Vec3::ZERO)),
                );
                let sum: f32 = all.iter().map(|light| light.element_sum()).sum();
                if sum <= 0.0 {
                    return;
                }
                shares.clear();
                shares.extend(all.iter().map(|light| light.element_sum() / sum));
                let offset = hash(hash(seed as u32) ^ pixel as u32) as f32 / u32::MAX as f32;
                asked.clear();
                arrivals.clear();
                steps(shares, rays, offset, |number, times| {
                    let counts = times as f32 / (rays as f32 * shares[number]);
                    asked.push(ray_between(seen, &vpls[number]));
                    arrivals.push((0, all[number] * counts));
                });
                self.flush(
                    asked,
                    arrivals,
                    &mut Vec::new(),
                    std::slice::from_mut(light),
                );
                reflect(std::slice::from_mut(light), &[Some(*seen)]);
            },
        );
        light
    }

    /// By the library, with its own clock: what the camera sees and direct light do not count.
    fn interleaved(&self, lights: u32, filter: Filter, seed: u64) -> (Vec<Vec3>, Option<f64>) {
        let params = GiParams {
            paths: 9 * lights,
            interleaving: [3, 3],
            filter,
            seed,
            min_d: MIN_D,
            materials: Materials::Lambert,
            ..GiParams::default()
        };
        let tracers = Tracers {
            exact: &self.tracer,
            secondary: &self.tracer,
        };
        let gi = InstantGi::new(&self.scene, tracers, &params).expect("parameters in their range");
        let camera = &self.scene.cameras[0];
        let stages = gi
            .render(camera, self.seen.size, &|_, _| {})
            .expect("a picture");
        let counted = stages.passes.iter();
        let counted = counted.filter(|pass| ["vpls", "indirect", "filter"].contains(&pass.name));
        let seconds = counted.map(|pass| pass.seconds).sum();
        (stages.indirect, Some(seconds))
    }

    /// Sorts lights along a curve through space (Morton 1966), so that neighbours in the row are neighbours in the room.
    fn along_curve(&self, vpls: &mut [Vpl]) {
        let bounds = self.scene.bounds();
        let (least, extent) = (bounds.min, (bounds.max - bounds.min).max(Vec3::splat(1e-6)));
        let spread = |part: f32| {
            let bits = (part.clamp(0.0, 1.0) * 1023.0) as u32;
            (0..10).fold(0, |code, bit| code | (bits >> bit & 1) << (3 * bit))
        };
        vpls.sort_by_cached_key(|vpl| {
            let [x, y, z] = ((vpl.point.position - least) / extent).to_array();
            spread(x) | spread(y) << 1 | spread(z) << 2
        });
    }
}

/// Picks at even steps along the sum of shares, which is 1: tells the number of each that is picked, and how often it is.
fn steps(shares: &[f32], count: u32, offset: f32, mut pick: impl FnMut(usize, u32)) {
    let (mut sum, mut next) = (0.0_f64, f64::from(offset));
    for (number, &share) in shares.iter().enumerate() {
        sum += f64::from(share) * f64::from(count);
        let mut times = 0;
        while next < sum {
            next += 1.0;
            times += 1;
        }
        if times > 0 {
            pick(number, times);
        }
    }
}

/// `L_e` G of Eq. (1); `None` where there is none.
fn arriving(seen: &Seen, vpl: &Vpl) -> Option<Vec3> {
    let offset = vpl.point.position - seen.point.position;
    let (at_point, at_light) = (seen.normal().dot(offset), -vpl.normal.dot(offset));
    if !(at_point > 0.0 && at_light > 0.0) {
        return None;
    }
    let squared = offset.length_squared();
    let bounded = bound(MIN_D, squared.sqrt());
    let light = vpl.intensity * (at_point * at_light / (squared * squared) * bounded);
    (light.is_finite() && light != Vec3::ZERO).then_some(light)
}

fn ray_between(seen: &Seen, vpl: &Vpl) -> Ray {
    let direction = vpl.point.position - seen.point.position;
    let start = seen.point.lifted(direction, 0.0);
    let way = vpl.point.lifted(-direction, 0.0) - start;
    let length = way.length();
    Ray::new(start, way / length).until(length)
}

fn reflect(light: &mut [Vec3], seen: &[Option<Seen>]) {
    for (light, seen) in light.iter_mut().zip(seen) {
        *light *= seen.as_ref().map_or(Vec3::ZERO, Seen::albedo) / std::f32::consts::PI;
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
