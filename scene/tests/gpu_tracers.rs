//! The GPU's tracers against the CPU's exact one.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

use std::{path::Path, sync::Arc, time::Instant};

use isophote_scene::{
    BuildTracer, BvhTracer, Hit, Ray, Scene, Selection, Tracer, builtin,
    gpu::{BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, GpuTracer, RayBatch},
    sample::{Sampler, uniform_sphere},
};

/// Rays per scene: a few in ordinary tests, as many as asked for by `ISOPHOTE_GPU_RAYS` in measurements.
fn ray_count() -> usize {
    std::env::var("ISOPHOTE_GPU_RAYS")
        .ok()
        .and_then(|count| count.parse().ok())
        .unwrap_or(10_000)
}

fn shared(name: &str) -> Option<Arc<Scene>> {
    let path = format!(
        "{}/../../shared/scenes/{name}.glb",
        env!("CARGO_MANIFEST_DIR")
    );
    if !Path::new(&path).exists() {
        eprintln!("SKIPPED {name}: there is no ../shared");
        return None;
    }
    Some(Arc::new(isophote_scene::load(Path::new(&path)).unwrap()))
}

/// Half of the rays go from anywhere to anywhere, half start on surfaces, as light does; some end early.
fn rays(scene: &Arc<Scene>, tracer: &BvhTracer, count: usize) -> Vec<Ray> {
    let bounds = scene.bounds();
    let mut rays: Vec<Ray> = Vec::with_capacity(count);
    for index in 0..count {
        let sample = Sampler::new(7, 0, index as u32);
        let direction = uniform_sphere(sample.get_2d(0));
        let start = index
            .checked_sub(1)
            .and_then(|last| tracer.closest_hit(&rays[last]));
        let ray = match start {
            Some(hit) if index % 2 == 1 => {
                let point = scene.surface_point(&hit);
                Ray::new(point.lifted(direction, 0.0), direction)
            }
            _ => {
                let at = sample.get_2d(2).extend(sample.get_1d(4));
                Ray::new(bounds.min + at * (bounds.max - bounds.min), direction)
            }
        };
        rays.push(if index % 8 < 2 {
            ray.until(0.2 * bounds.diagonal() * sample.get_1d(5))
        } else {
            ray
        });
    }
    rays
}

/// What a comparison found.
#[derive(Debug, Default)]
struct Differences {
    hit_or_miss: usize,
    distance: usize,
    worst: f32,
    surface: usize,
    any: usize,
}

fn compare(
    context: &Context,
    scene: &Arc<Scene>,
    tracer: &dyn GpuTracer,
    rays: &[Ray],
    exact: &dyn Tracer,
) -> Differences {
    let gpu_scene = GpuScene::new(context, scene).unwrap();
    let mut batch = RayBatch::new(context, &gpu_scene, tracer).unwrap();
    let mut hits = vec![None; rays.len()];
    let start = Instant::now();
    batch
        .closest_hits(context, &gpu_scene, tracer, rays, &mut hits)
        .unwrap();
    let closest = start.elapsed();
    let kernel = batch.take_kernel_time();
    let mut any = vec![false; rays.len()];
    let start = Instant::now();
    batch
        .any_hits(context, &gpu_scene, tracer, rays, &mut any)
        .unwrap();
    let rate = |time: f64| rays.len() as f64 / time / 1e6;
    println!(
        "{}: {} rays, million/s: closest {:.3} ({:.3} on the device's clock), any {:.3}",
        tracer.name(),
        rays.len(),
        rate(closest.as_secs_f64()),
        rate(kernel.as_secs_f64()),
        rate(start.elapsed().as_secs_f64()),
    );
    let mut expected = vec![None; rays.len()];
    exact.closest_hits(rays, &mut expected);
    let largest = scene.bounds().largest_coordinate();
    let mut differences = Differences::default();
    for (index, ray) in rays.iter().enumerate() {
        let (hit, expected) = (hits[index], expected[index]);
        differences.any += usize::from(any[index] != expected.is_some());
        match (hit, expected) {
            (Some(hit), Some(expected)) => {
                let off = (hit.t - expected.t).abs();
                differences.worst = differences.worst.max(off / expected.t);
                // Origins and corners are known to one unit of the last place, and so is the distance between.
                if off > (1e-4 * expected.t).max(f32::EPSILON * largest) {
                    differences.distance += 1;
                    let truth = plane_distance(scene, ray, &expected);
                    println!(
                        "truth {truth}: off by {:.2e}, CPU by {:.2e}",
                        (f64::from(hit.t) - truth) / truth,
                        (f64::from(expected.t) - truth) / truth
                    );
                    println!(
                        "t {} instead of {}: {ray:?}\n{hit:?}\n{expected:?}",
                        hit.t, expected.t
                    );
                }
                differences.surface += usize::from(hit.surface != expected.surface);
            }
            (None, None) => {}
            _ => {
                differences.hit_or_miss += 1;
                println!("{hit:?} instead of {expected:?}: {ray:?}");
            }
        }
    }
    println!("{differences:?}");
    differences
}

/// The distance to a hit's plane, in 64 bits.
fn plane_distance(scene: &Scene, ray: &Ray, hit: &Hit) -> f64 {
    let instance = &scene.instances[hit.surface.instance as usize];
    let [a, b, c] = scene
        .mesh(instance)
        .corners(hit.surface.primitive as usize)
        .map(|corner| instance.transform.transform_point3(corner).as_dvec3());
    let normal = (b - a).cross(c - a);
    normal.dot(a - ray.origin.as_dvec3()) / normal.dot(ray.direction.as_dvec3())
}

fn check_compute_bvh(name: &str, scene: &Arc<Scene>) {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let exact = BvhTracer::build(scene, &Selection::default(), &Default::default()).unwrap();
    let rays = rays(scene, &exact, ray_count());
    let tracer = ComputeBvhTracer::build(&context, scene, &Selection::default(), &()).unwrap();
    println!(
        "{name}: {} triangles, {} bytes",
        scene.triangle_count(),
        tracer.bytes()
    );
    let differences = compare(&context, scene, &tracer, &rays, &exact);
    let allowed = rays.len().div_ceil(100_000);
    assert!(
        differences.hit_or_miss <= allowed,
        "{name}: {differences:?}"
    );
    assert!(differences.any <= allowed, "{name}: {differences:?}");
    assert!(differences.distance == 0, "{name}: {differences:?}");
    // Neighbours at an edge are equally right.
    assert!(
        differences.surface <= rays.len() / 1000,
        "{name}: {differences:?}"
    );
}

#[test]
fn compute_bvh_agrees_in_built_in_scenes() {
    for name in ["cornell", "corner:17", "hairball:20000"] {
        check_compute_bvh(name, &Arc::new(builtin::build(name).unwrap()));
    }
}

#[test]
fn compute_bvh_agrees_in_real_scenes() {
    for name in ["sibenik", "sponza_dabrovic", "conference"] {
        if let Some(scene) = shared(name) {
            check_compute_bvh(name, &scene);
        }
    }
}
