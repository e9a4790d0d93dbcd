//! Rays per second of maps and of the exact tracer, on the same incoherent diffuse rays, on one thread.
//!
//! `cargo bench -p isophote-ldi -- [SCENE...]`; the built-in atrium unless given.

use std::{path::Path, sync::Arc, time::Instant};

use glam::Vec3;
use isophote_ldi::{Coverage, LdiParams, LdiTracer, WithFallback};
use isophote_scene::reference::{Materials, Quantity, Settings, Tracers, render};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Hit, Ray, Scene, Selection, Tracer, load,
    sample::{Frame, Sampler, cosine_hemisphere, uniform_sphere},
};

const RAYS: usize = 1 << 20;
const REPEATS: usize = 3;

fn main() {
    let scenes: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with("--"))
        .collect();
    let scenes = if scenes.is_empty() {
        vec!["builtin:atrium".into()]
    } else {
        scenes
    };
    for name in scenes {
        let scene = Arc::new(load(Path::new(&name)).expect("a scene"));
        measure(&name, &scene);
    }
}

fn measure(name: &str, scene: &Arc<Scene>) {
    let selection = Selection::default();
    let exact = BvhTracer::build(scene, &selection, &BvhOptions::default()).expect("a tracer");
    let rays = diffuse(scene, &exact);
    let (truth, exact_rates) = rates(&exact, &rays);
    println!(
        "{name}: {} triangles; bvh {:.2} closest, {:.2} any (million rays/s)",
        scene.triangle_count(),
        exact_rates[0],
        exact_rates[1]
    );
    let picture = |secondary: &LdiTracer| indirect(scene, &exact, secondary);
    let truth_picture = indirect(scene, &exact, &exact);
    for (cells, resolution, coverage, epsilon) in [
        (4, 128, Coverage::Touched, 0.0),
        (4, 128, Coverage::Center, 0.1),
        (4, 128, Coverage::Center, 0.3),
        (4, 128, Coverage::Center, 0.6),
    ] {
        let params = LdiParams {
            cells,
            resolution,
            coverage,
            epsilon,
            ..LdiParams::default()
        };
        let start = Instant::now();
        let maps = LdiTracer::build(scene, &selection, &params).expect("maps");
        let built = start.elapsed().as_secs_f64();
        let (hits, rates) = rates(&maps, &rays);
        let (mut confused, mut off) = (0, 0);
        for (hit, truth) in hits.iter().zip(&truth) {
            match (hit, truth) {
                (Some(hit), Some(truth)) => {
                    off += usize::from((hit.t - truth.t).abs() > 1e-3 * truth.t);
                }
                (None, None) => {}
                _ => confused += 1,
            }
        }
        println!(
            "  {} directions, {resolution}², {coverage:?}: {:.2} closest ({:.2}×), {:.2} any ({:.2}×); built in {built:.2} s, \
             {:.1} MB, {} layers of {:.2} bytes; hit/miss confused {:.3} %, t off {:.3} %; {}, ε {epsilon}",
            6 * cells * cells,
            rates[0],
            rates[0] / exact_rates[0],
            rates[1],
            rates[1] / exact_rates[1],
            maps.bytes() as f64 / 1e6,
            maps.maps().layers.count(),
            maps.maps().map_bytes() as f64 / maps.maps().layers.count() as f64,
            100.0 * confused as f64 / RAYS as f64,
            100.0 * off as f64 / RAYS as f64,
            compare(&picture(&maps), &truth_picture),
        );
        if coverage == Coverage::Touched {
            continue;
        }
        for least in [0.5, 0.7, 0.8, 0.9] {
            let dial = WithFallback::new(&maps, &exact, least);
            let sent = dial.doubtful(&rays).iter().filter(|sent| **sent).count();
            let (_, rates) = self::rates(&dial, &rays);
            println!(
                "    dial at {least}: {:.1} % exact, {:.2}× closest; {}",
                100.0 * sent as f64 / RAYS as f64,
                rates[0] / exact_rates[0],
                compare(&indirect(scene, &exact, &dial), &truth_picture),
            );
        }
    }
}

/// One bounce of light, secondary rays by another tracer; the same samples for every tracer.
fn indirect<T: Tracer>(scene: &Scene, exact: &BvhTracer, secondary: &T) -> Vec<Vec3> {
    let settings = Settings {
        samples: 128,
        materials: Materials::Lambert,
        ..Settings::default()
    };
    let tracers = Tracers { exact, secondary };
    let camera = &scene.cameras[0];
    let quantities = [Quantity::Indirect];
    let picture = render(
        scene,
        tracers,
        camera,
        [80, 60],
        &quantities,
        &settings,
        &|_, _| {},
    )
    .expect("a picture");
    picture
        .estimates
        .into_iter()
        .next()
        .expect("one quantity")
        .values
}

fn compare(a: &[Vec3], b: &[Vec3]) -> String {
    let mean = |values: &[Vec3]| {
        values
            .iter()
            .map(|v| f64::from(v.element_sum()))
            .sum::<f64>()
            / (3 * values.len()) as f64
    };
    let squares: f64 = a
        .iter()
        .zip(b)
        .map(|(a, b)| f64::from((*a - *b).length_squared()))
        .sum();
    let rms = (squares / (3 * a.len()) as f64).sqrt();
    format!(
        "indirect relRMSE {:.2} %, bias {:+.2} %",
        100.0 * rms / mean(b),
        100.0 * (mean(a) / mean(b) - 1.0)
    )
}

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

/// Cosine-distributed rays from the surfaces seen all around the camera.
fn diffuse(scene: &Scene, tracer: &impl Tracer) -> Vec<Ray> {
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
        .take(RAYS)
        .collect()
}
