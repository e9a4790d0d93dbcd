//! The reference integrators on a GPU against those on the CPU: the same samples, so that they differ by rounding and by
//! the few rays that rounding moves across an edge.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "a test may fail")]

use std::{sync::Arc, time::Instant};

use glam::{Affine3A, Quat, Vec3};
use isophote_scene::{
    BuildTracer, BvhTracer, Environment, EnvironmentMap, Light, LightKind, Receivers, Scene,
    Selection, builtin,
    gpu::{
        BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, GpuTracer, RayQueryBoxTracer,
        RayQueryTracer, reference as gpu,
    },
    reference::{self, Estimate, Materials, Normals, Quantity, Settings, Tracers},
};

const SIZE: [u32; 2] = [32, 24];
/// A pixel differs by more than rounding where it is off by more than this part of the picture's mean.
const ROUNDING: f32 = 1e-3;
/// The share of pixels that may: a ray of theirs passed an edge on the other side.
const ODD: f32 = 0.01;
/// How far the means may be apart, as a part of the mean.
const BIAS: f32 = 1e-3;

#[track_caller]
fn compare(name: &str, gpu: &[Estimate], cpu: &[Estimate]) {
    for (gpu, cpu) in gpu.iter().zip(cpu) {
        assert_eq!(gpu.quantity, cpu.quantity);
        assert_eq!(gpu.values.len(), cpu.values.len());
        let count = cpu.values.len() as f32;
        let mean = |values: &[Vec3]| {
            let sum: Vec3 = values.iter().copied().sum();
            sum.element_sum() / (3.0 * count)
        };
        let (found, expected) = (mean(&gpu.values), mean(&cpu.values));
        let pairs = || gpu.values.iter().zip(&cpu.values);
        let squares: f32 = pairs().map(|(a, b)| (a - b).length_squared() / 3.0).sum();
        let off = |(a, b): &(&Vec3, &Vec3)| (**a - **b).abs().max_element() > ROUNDING * expected;
        let odd = pairs().filter(off).count() as f32 / count;
        let bias = found / expected - 1.0;
        println!(
            "{name}, {}: mean {expected:.4}, relRMSE {:.1e}, bias {bias:+.1e}, {:.2} % odd; noise {:.3}",
            cpu.quantity,
            (squares / count).sqrt() / expected,
            100.0 * odd,
            cpu.noise,
        );
        let same_noise = (gpu.noise / cpu.noise - 1.0).abs() < 0.05;
        assert!(
            odd <= ODD && bias.abs() <= BIAS && same_noise,
            "{name}, {}: {odd} odd, bias {bias}, noise {} instead of {}",
            cpu.quantity,
            gpu.noise,
            cpu.noise
        );
    }
}

/// A device, and an integrator that is not compiled again for every scene.
struct Lab {
    context: Context,
    integrator: gpu::Integrator,
}

impl Lab {
    fn new(features: wgpu::Features) -> Option<Self> {
        Self::on(Context::for_tests_of(features)?)
    }

    fn on(context: Context) -> Option<Self> {
        let integrator = gpu::Integrator::new(&context);
        Some(Self {
            context,
            integrator,
        })
    }

    /// Renders and bakes on both sides.
    fn check<T: BuildGpuTracer<Options = ()>>(
        &mut self,
        name: &str,
        scene: Scene,
        quantities: &[Quantity],
        settings: &Settings,
    ) {
        let scene = Arc::new(scene);
        let (context, none) = (&self.context, &|_, _| {});
        let bvh = BvhTracer::build(&scene, &Selection::default(), &Default::default()).unwrap();
        let tracer = T::build(context, &scene, &Selection::default(), &()).unwrap();
        let gpu_scene = GpuScene::new(context, &scene).unwrap();
        let camera = &scene.cameras[0];
        let on_cpu = Tracers {
            exact: &bvh,
            secondary: &bvh,
        };
        let world = gpu::World {
            scene: &scene,
            gpu_scene: &gpu_scene,
            exact: &tracer,
            secondary: &tracer,
        };
        let start = Instant::now();
        let found = self
            .integrator
            .render(world, camera, SIZE, quantities, settings, none)
            .unwrap();
        let name = format!("{name}, {}", tracer.name());
        let times = self.integrator.take_times();
        println!(
            "{name}: {:.1} s with compiling; {times:?}",
            start.elapsed().as_secs_f64()
        );
        let expected =
            reference::render(&scene, on_cpu, camera, SIZE, quantities, settings, none).unwrap();
        compare(&name, &found.estimates, &expected.estimates);
        let rays = found.rays as f64 / expected.rays as f64;
        assert!((rays - 1.0).abs() < 1e-3, "{rays}");
        let depths = found.layers.depth.iter().zip(&expected.layers.depth);
        let same = depths.filter(|(a, b)| a == b || (*a - *b).abs() <= 1e-4 * **b);
        assert!(same.count() * 1000 >= 995 * found.layers.depth.len());

        let receivers = Receivers::from_camera(&scene, &bvh, camera, SIZE);
        let (expected, _) =
            reference::bake(&scene, on_cpu, &receivers, quantities, settings, none).unwrap();
        let (found, _) = self
            .integrator
            .bake(world, &receivers, quantities, settings, none)
            .unwrap();
        compare(&format!("{name}, baked"), &found, &expected);
    }
}

/// Every kind of light: what is built in, a sphere, a spot, the sun, and a panorama with a bright texel.
fn lit(mut scene: Scene) -> Scene {
    let bounds = scene.bounds();
    let mut light = |at: Vec3, kind: LightKind, intensity: f32| {
        let position = bounds.min + at * (bounds.max - bounds.min);
        let mut light = Light::point("", position, Vec3::splat(intensity));
        light.kind = kind;
        light.transform *= Affine3A::from_quat(Quat::from_rotation_x(-1.2));
        scene.lights.push(light);
    };
    let area = bounds.diagonal().powi(2);
    light(
        Vec3::splat(0.7),
        LightKind::Point { radius: 0.05 },
        0.05 * area,
    );
    light(
        Vec3::splat(0.8),
        LightKind::Point { radius: 0.0 },
        0.05 * area,
    );
    let (inner, outer) = (0.4, 0.9);
    light(
        Vec3::splat(0.9),
        LightKind::Spot { inner, outer },
        0.1 * area,
    );
    light(Vec3::ONE, LightKind::Directional, 0.5);
    let texel = |i| Vec3::new(0.2, 0.3, 0.5) + if i == 72 { 60.0 } else { 0.0 };
    let panorama = EnvironmentMap::new(32, 16, (0..32 * 16).map(texel).collect());
    scene.environment = Environment::Map(panorama.unwrap());
    scene
}

#[test]
fn a_gpu_takes_the_same_samples() {
    let Some(mut lab) = Lab::new(wgpu::Features::empty()) else {
        return;
    };
    let build = |name| builtin::build(name).unwrap();
    let settings = Settings {
        d_max: 0.3,
        samples: 5,
        ..Settings::default()
    };
    type Bvh = ComputeBvhTracer;
    lab.check::<Bvh>(
        "cornell",
        build("builtin:cornell"),
        &Quantity::ALL,
        &settings,
    );
    let metals = Settings {
        samples: 4,
        seed: 1 << 40,
        ..settings
    };
    let mut scene = lit(build("builtin:corner"));
    for (index, material) in scene.materials.iter_mut().enumerate() {
        material.metallic = [0.0, 1.0, 0.5][index % 3];
        material.roughness = [1.0, 0.6, 0.3, 0.0][index % 4];
        material.transmission = [0.0, 0.0, 0.0, 0.7, 0.0][index % 5];
    }
    lab.check::<Bvh>("corner in every light", scene, &Quantity::ALL[1..], &metals);
    let plain = Settings {
        d_max: 1.0,
        min_d: 0.3,
        samples: 4,
        materials: Materials::Lambert,
        ..settings
    };
    let quantities = [Quantity::Indirect, Quantity::Ao, Quantity::Direct];
    lab.check::<Bvh>("office", build("builtin:office"), &quantities, &plain);
    let flat = Settings {
        normals: Normals::Flat,
        ..plain
    };
    lab.check::<Bvh>("office", build("builtin:office"), &quantities, &flat);
}

/// Sums that are too large to be bound in one piece are worked on in bands.
#[test]
fn small_bindings_change_nothing() {
    let none = wgpu::Features::empty();
    let Some(mut lab) = Context::for_tests_within(none, 1 << 15).and_then(Lab::on) else {
        return;
    };
    // 96 bytes a pixel.
    assert!(96 * SIZE[0] * SIZE[1] > 2 << 15);
    let settings = Settings {
        d_max: 0.3,
        samples: 3,
        ..Settings::default()
    };
    let scene = builtin::build("builtin:cornell").unwrap();
    lab.check::<ComputeBvhTracer>("cornell in bands", scene, &[Quantity::Ao], &settings);
}

#[test]
fn ray_query_answers_them_too() {
    let Some(mut lab) = Lab::new(wgpu::Features::EXPERIMENTAL_RAY_QUERY) else {
        return;
    };
    let settings = Settings {
        d_max: 0.3,
        samples: 2,
        ..Settings::default()
    };
    let scene = builtin::build("builtin:cornell").unwrap();
    lab.check::<RayQueryTracer>("cornell", scene, &[Quantity::Ao], &settings);
}

/// A rough tracer is judged beside an exact one, as on the CPU: the boxes around a room's walls hide more than the walls.
#[test]
fn secondary_rays_may_be_answered_by_another_tracer() {
    let Some(mut lab) = Lab::new(wgpu::Features::EXPERIMENTAL_RAY_QUERY) else {
        return;
    };
    let scene = Arc::new(builtin::build("builtin:cornell").unwrap());
    let context = &lab.context;
    let selection = Selection::default();
    let exact = ComputeBvhTracer::build(context, &scene, &selection, &()).unwrap();
    let boxes = RayQueryBoxTracer::build(context, &scene, &selection, &()).unwrap();
    let gpu_scene = GpuScene::new(context, &scene).unwrap();
    let settings = Settings {
        samples: 2,
        d_max: 0.1,
        ..Settings::default()
    };
    let mut mean = |secondary: &dyn GpuTracer| {
        let world = gpu::World {
            scene: &scene,
            gpu_scene: &gpu_scene,
            exact: &exact,
            secondary,
        };
        let quantities = [Quantity::Obscurance];
        let camera = &scene.cameras[0];
        let render = lab
            .integrator
            .render(world, camera, SIZE, &quantities, &settings, &|_, _| {});
        let values = &render.unwrap().estimates[0].values;
        values.iter().map(|value| value.x).sum::<f32>() / values.len() as f32
    };
    let (right, rough) = (mean(&exact), mean(&boxes));
    assert!(0.5 < rough && rough < right - 1e-3, "{rough} {right}");
}
