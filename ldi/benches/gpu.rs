//! How long maps take to build, on the CPU and on the GPU in both ways; and rays per second of maps and of the compute
//! BVH there, on the same incoherent diffuse rays.
//!
//! `cargo bench -p isophote-ldi --features gpu --bench gpu -- [SCENE...] [--no-peeling]`; the built-in atrium unless
//! given. On software adapters depth peeling takes minutes.

use std::{path::Path, sync::Arc, time::Instant};

use glam::Vec3;
use isophote_ldi::{
    Coverage, LdiParams, LdiTracer,
    gpu::{BuildMethod, LdiGpuTracer},
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Ray, Scene, Selection, Tracer, builtin,
    gpu::{
        Adapter, AdapterChoice, BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, GpuTracer,
        RayBatch,
    },
    load,
    sample::{Frame, Sampler, cosine_hemisphere, uniform_sphere},
};

const RAYS: usize = 1 << 17;
const REPEATS: usize = 3;

fn main() {
    let peels = !std::env::args().any(|argument| argument == "--no-peeling");
    let scenes: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with("--"))
        .collect();
    let scenes = if scenes.is_empty() {
        vec!["builtin:atrium".into()]
    } else {
        scenes
    };
    let adapter = Adapter::find(&AdapterChoice::Any).expect("an adapter");
    let context = adapter.open().expect("a device");
    println!("{}", adapter.info.name);
    for name in scenes {
        let scene = match name.strip_prefix(builtin::PREFIX) {
            Some(_) => builtin::build(&name),
            None => load(Path::new(&name)),
        };
        let scene = Arc::new(scene.expect("a scene"));
        println!("{name}: {} triangles", scene.triangle_count());
        measure(&context, &scene, peels);
    }
}

/// The result and the shortest of several times, seconds.
fn shortest<T>(mut run: impl FnMut() -> T) -> (T, f64) {
    let mut once = || {
        let start = Instant::now();
        (run(), start.elapsed().as_secs_f64())
    };
    let (mut result, mut best) = once();
    for _ in 1..REPEATS {
        let (again, seconds) = once();
        (result, best) = (again, best.min(seconds));
    }
    (result, best)
}

fn measure(context: &Context, scene: &Arc<Scene>, peels: bool) {
    let selection = Selection::default();
    let exact = BvhTracer::build(scene, &selection, &BvhOptions::default()).expect("a tracer");
    let rays = diffuse(scene, &exact);
    let gpu_scene = GpuScene::new(context, scene).expect("a scene on the GPU");
    let bvh = ComputeBvhTracer::build(context, scene, &selection, &()).expect("a tree");
    let bvh_rates = rates(context, &gpu_scene, &bvh, &rays);
    println!(
        "  compute BVH: {:.3} closest, {:.3} any (million rays/s)",
        bvh_rates[0], bvh_rates[1]
    );
    for (cells, resolution, coverage) in [(4, 128, Coverage::Touched), (4, 128, Coverage::Center)] {
        let params = LdiParams {
            cells,
            resolution,
            coverage,
            ..LdiParams::default()
        };
        let (_, cpu) = shortest(|| LdiTracer::build(scene, &selection, &params).expect("maps"));
        println!(
            "  {} directions, {resolution}², {coverage:?}: built on the CPU in {cpu:.2} s",
            6 * cells * cells
        );
        let methods = [BuildMethod::SinglePass, BuildMethod::DepthPeeling];
        for method in methods.into_iter().take(1 + usize::from(peels)) {
            let build = || {
                LdiGpuTracer::build_with(context, scene, &selection, &params, method).expect("maps")
            };
            let (mut tracer, first) = timed(context, build);
            // The second time its pipelines are there.
            let transforms = scene.transforms();
            let ((), again) = timed(context, || {
                tracer.update(context, &transforms).expect("maps");
            });
            print!(
                "    {method:?}: built in {again:.2} s, {first:.2} s with its pipelines; {:.1} MB",
                tracer.bytes() as f64 / 1e6
            );
            if method == BuildMethod::SinglePass {
                let rates = rates(context, &gpu_scene, &tracer, &rays);
                print!(
                    "; {:.3} closest ({:.2}× the compute BVH), {:.3} any ({:.2}×)",
                    rates[0],
                    rates[0] / bvh_rates[0],
                    rates[1],
                    rates[1] / bvh_rates[1]
                );
            }
            println!();
        }
    }
}

/// A result and the seconds it took, those of the device among them.
fn timed<T>(context: &Context, run: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = run();
    context.wait("building").expect("a device");
    (result, start.elapsed().as_secs_f64())
}

/// Million rays per second.
fn rates(context: &Context, scene: &GpuScene, tracer: &dyn GpuTracer, rays: &[Ray]) -> [f64; 2] {
    let mut batch = RayBatch::new(context, scene, tracer).expect("a batch");
    let (mut hits, mut any) = (vec![None; rays.len()], vec![false; rays.len()]);
    let ((), closest) = shortest(|| {
        batch
            .closest_hits(context, scene, tracer, rays, &mut hits)
            .expect("answers");
    });
    let ((), first) = shortest(|| {
        batch
            .any_hits(context, scene, tracer, rays, &mut any)
            .expect("answers");
    });
    [closest, first].map(|seconds| rays.len() as f64 / seconds / 1e6)
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
            let normal: Vec3 = point.geometric_normal
                * -1_f32.copysign(point.geometric_normal.dot(look.direction));
            let direction = Frame::new(normal).to_world(cosine_hemisphere(sampler.get_2d(1)));
            Some(Ray::new(point.position + lift * normal, direction))
        })
        .take(RAYS)
        .collect()
}
