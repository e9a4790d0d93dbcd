//! The method in shaders beside the CPU's, stage by stage, over every tracer.
//!
//! Both shoot the same paths and take the same samples. What is left is rounding, and the few rays that it moves across an
//! edge.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

use std::sync::Arc;

use glam::Vec3;
use isophote_instant_gi::{
    Filter, GiParams, InstantGi, Lookup, Pattern, ShadowMaps, Stages, Visibility, gpu,
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Environment, Leaves, Light, LightKind, Scene, Selection,
    builtin,
    gpu::{
        BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, GpuTracer, RayQueryBoxTracer,
        RayQueryTracer, Timer, reference::World,
    },
    reference::{Materials, Tracers},
};

const SIZE: [u32; 2] = [64, 48];
/// How far two pictures may be apart, as relRMSE.
const MOST: f32 = 0.005;

fn on_cpu(scene: &Arc<Scene>, params: &GiParams, leaves: Leaves) -> Stages {
    let selection = Selection::default();
    let exact = BvhTracer::build(scene, &selection, &BvhOptions::default()).unwrap();
    let options = BvhOptions {
        leaves,
        ..BvhOptions::default()
    };
    let secondary = BvhTracer::build(scene, &selection, &options).unwrap();
    let tracers = Tracers {
        exact: &exact,
        secondary: &secondary,
    };
    let gi = InstantGi::new(scene, tracers, params).unwrap();
    gi.render(&scene.cameras[0], SIZE, &|_, _| {}).unwrap()
}

fn on_gpu(
    context: &Context,
    scene: &Arc<Scene>,
    params: &GiParams,
    exact: &dyn GpuTracer,
    secondary: &dyn GpuTracer,
) -> Stages {
    let gpu_scene = GpuScene::new(context, scene).unwrap();
    let world = World {
        scene,
        gpu_scene: &gpu_scene,
        exact,
        secondary,
    };
    let gi = gpu::InstantGi::new(context, world, params, SIZE).unwrap();
    let camera = &scene.cameras[0];
    let stages = gi.render(context, world, camera, &|_, _| {}).unwrap();
    // The same in one submission.
    let mut encoder = context.device().create_command_encoder(&Default::default());
    let mut timer = Timer::new(context, 64);
    gi.record(context, &mut encoder, world, camera, Some(&mut timer))
        .unwrap();
    timer.resolve(&mut encoder);
    context.submit("igi", encoder).unwrap();
    let times = timer.read(context).unwrap();
    if !times.is_empty() {
        let is_timed = |name| times.iter().any(|pass| pass.name == name);
        let mut traced = stages.passes.iter().filter(|pass| pass.rays > 0);
        assert!(traced.all(|pass| is_timed(pass.name)), "{times:?}");
        assert!(is_timed("filter") && is_timed("compose"), "{times:?}");
    }
    let again = gi.read(context).unwrap();
    assert_eq!(stages.picture, again.picture);
    stages
}

fn mean(values: &[Vec3]) -> f32 {
    values.iter().map(|value| value.element_sum()).sum::<f32>() / (3 * values.len()) as f32
}

fn relative_rmse(found: &[Vec3], expected: &[Vec3]) -> f32 {
    let pairs = found.iter().zip(expected);
    let squares: f32 = pairs.map(|(a, b)| (*a - *b).length_squared()).sum();
    (squares / (3 * expected.len()) as f32).sqrt() / mean(expected)
}

/// How far apart the lights are, and the stages.
fn check(name: &str, found: &Stages, expected: &Stages) {
    assert_eq!(found.vpls.len(), expected.vpls.len(), "{name}");
    for (found, expected) in found.vpls.iter().zip(&expected.vpls) {
        let off = (found.point.position - expected.point.position).length();
        let intensity = (found.intensity - expected.intensity).length();
        assert!(
            off < 1e-3
                && found.normal.dot(expected.normal) > 0.999
                && found.bounce == expected.bounce
                && intensity < 1e-2 * expected.intensity.length(),
            "{name}: {found:?} {expected:?}"
        );
    }
    let stages = found.layers().into_iter().zip(expected.layers());
    let picture = (
        ("picture", &found.picture[..]),
        ("picture", &expected.picture[..]),
    );
    for ((stage, found), (_, expected)) in stages.chain([picture]) {
        if expected.iter().all(|value| *value == Vec3::ZERO) {
            assert!(
                found.iter().all(|value| *value == Vec3::ZERO),
                "{name}, {stage}"
            );
            continue;
        }
        let error = relative_rmse(found, expected);
        let bias = mean(found) / mean(expected) - 1.0;
        println!("{name}, {stage}: relRMSE {error:.1e}, bias {bias:+.1e}");
        // A single light path's ray past an edge is a spot in a mirror.
        let most = if stage == "specular" {
            4.0 * MOST
        } else {
            MOST
        };
        assert!(
            error <= most && bias.abs() < MOST,
            "{name}, {stage}: {error}, {bias}"
        );
    }
    for (found, expected) in found.passes.iter().zip(&expected.passes) {
        assert_eq!(found.name, expected.name, "{name}");
        let rays = found.rays as f64 / expected.rays.max(1) as f64;
        // Between points of one plane rounding says whether there is any light to ask for.
        let same = found.rays == expected.rays || (rays - 1.0).abs() < 0.05;
        assert!(same, "{name}, {}: {rays} times the rays", found.name);
    }
}

/// Cornell's box with everything that shines, and things that mirror, refract and gleam.
fn zoo() -> Arc<Scene> {
    let mut scene = builtin::build("builtin:cornell").unwrap();
    let mut spot = Light::point("spot", Vec3::new(0.3, 1.5, 0.2), Vec3::splat(2.0));
    spot.kind = LightKind::Spot {
        inner: 0.3,
        outer: 0.8,
    };
    let mut bulb = Light::point("bulb", Vec3::new(-0.4, 1.2, 0.1), Vec3::new(0.5, 0.4, 0.2));
    bulb.kind = LightKind::Point { radius: 0.05 };
    scene.lights.extend([spot, bulb]);
    scene.environment = Environment::Constant(Vec3::new(0.2, 0.3, 0.5));
    for (index, material) in scene.materials.iter_mut().enumerate() {
        match index % 4 {
            1 => (material.metallic, material.roughness) = (0.5, 0.3),
            2 => (material.metallic, material.roughness) = (1.0, 0.0),
            3 => (material.transmission, material.ior) = (0.7, 1.5),
            _ => {}
        }
    }
    Arc::new(scene)
}

/// The scenes and settings that are compared.
fn cases() -> Vec<(&'static str, Arc<Scene>, GiParams)> {
    let cornell = Arc::new(builtin::build("builtin:cornell").unwrap());
    let plain = GiParams {
        paths: 60,
        bounces: 2,
        ..GiParams::default()
    };
    let filled = cornell.clone();
    let maps = |resolution, lookup| {
        Visibility::Maps(ShadowMaps {
            resolution,
            lookup,
            ..ShadowMaps::default()
        })
    };
    vec![
        ("plain", cornell.clone(), plain),
        (
            "compensated",
            cornell.clone(),
            GiParams {
                compensation: 4,
                min_d: 0.4,
                seed: 3,
                ..plain
            },
        ),
        (
            "downsampled",
            cornell.clone(),
            GiParams {
                downsampling: 4,
                ..plain
            },
        ),
        (
            "as in the paper",
            cornell.clone(),
            GiParams {
                downsampling: 4,
                interleaving: [3, 3],
                filter: Filter::Paper,
                ..plain
            },
        ),
        (
            "irregular",
            cornell,
            GiParams {
                interleaving: [3, 2],
                pattern: Pattern::Irregular,
                materials: Materials::Lambert,
                ..plain
            },
        ),
        (
            "filled",
            filled.clone(),
            GiParams {
                downsampling: 2,
                interleaving: [3, 3],
                filter: Filter::Fill,
                ..plain
            },
        ),
        (
            "filled at every pixel",
            filled.clone(),
            GiParams {
                interleaving: [2, 3],
                filter: Filter::Fill,
                pattern: Pattern::Irregular,
                compensation: 2,
                ..plain
            },
        ),
        (
            "mirrors and glass",
            zoo(),
            GiParams {
                paths: 40,
                depth: 3,
                glossy_rays: 2,
                ..plain
            },
        ),
        (
            "shadow maps",
            zoo(),
            GiParams {
                paths: 40,
                depth: 2,
                glossy_rays: 1,
                visibility: maps(32, Lookup::Smooth),
                ..plain
            },
        ),
        (
            "shadow maps, nearest",
            filled,
            GiParams {
                compensation: 2,
                min_d: 0.4,
                visibility: maps(24, Lookup::Nearest),
                ..plain
            },
        ),
    ]
}

#[test]
fn stages_are_the_cpus() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    for (name, scene, params) in cases() {
        let selection = Selection::default();
        let tracer = ComputeBvhTracer::build(&context, &scene, &selection, &()).unwrap();
        let found = on_gpu(&context, &scene, &params, &tracer, &tracer);
        check(name, &found, &on_cpu(&scene, &params, Leaves::Triangles));
    }
}

#[test]
fn ray_queries_give_the_same_picture() {
    let Some(context) = Context::for_tests_of(wgpu::Features::EXPERIMENTAL_RAY_QUERY) else {
        return;
    };
    let (_, scene, params) = cases().swap_remove(7);
    let tracer = RayQueryTracer::build(&context, &scene, &Selection::default(), &()).unwrap();
    let found = on_gpu(&context, &scene, &params, &tracer, &tracer);
    check(
        "ray query",
        &found,
        &on_cpu(&scene, &params, Leaves::Triangles),
    );
}

/// Imperfect visibility (§4.1) by the same boxes, whoever tests them.
#[test]
fn boxes_give_the_same_picture() {
    let Some(context) = Context::for_tests_of(wgpu::Features::EXPERIMENTAL_RAY_QUERY) else {
        return;
    };
    let (_, scene, params) = cases().swap_remove(0);
    let selection = Selection::default();
    let exact = ComputeBvhTracer::build(&context, &scene, &selection, &()).unwrap();
    let walked = exact.with_leaves(Leaves::Boxes);
    let query = RayQueryBoxTracer::build(&context, &scene, &selection, &()).unwrap();
    let expected = on_cpu(&scene, &params, Leaves::Boxes);
    for secondary in [&walked as &dyn GpuTracer, &query] {
        let found = on_gpu(&context, &scene, &params, &exact, secondary);
        check(secondary.name(), &found, &expected);
    }
}

/// What moves is where it is in the next picture, and its lights with it.
#[test]
fn pictures_follow_what_moves() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let (_, scene, params) = cases().swap_remove(0);
    let selection = Selection::default();
    let mut moved = Scene::clone(&scene);
    let last = moved.instances.len() - 1;
    moved.instances[last].transform.translation.x += 0.1;
    let moved = Arc::new(moved);
    let mut tracer = ComputeBvhTracer::build(&context, &scene, &selection, &()).unwrap();
    let mut gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let camera = &scene.cameras[0];
    let world = World {
        scene: &scene,
        gpu_scene: &gpu_scene,
        exact: &tracer,
        secondary: &tracer,
    };
    let gi = gpu::InstantGi::new(&context, world, &params, SIZE).unwrap();
    gi.render(&context, world, camera, &|_, _| {}).unwrap();
    tracer.update(&context, &moved.transforms()).unwrap();
    gpu_scene.update(&context, &moved).unwrap();
    let world = World {
        scene: &moved,
        gpu_scene: &gpu_scene,
        exact: &tracer,
        secondary: &tracer,
    };
    let found = gi.render(&context, world, camera, &|_, _| {}).unwrap();
    check("moved", &found, &on_cpu(&moved, &params, Leaves::Triangles));
}
