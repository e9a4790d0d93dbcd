//! The hybrid renderer in shaders beside the CPU's, stage by stage.
//!
//! Both take the same samples. What rounding changes is a shadow ray or a secondary ray here and there that passes an edge
//! on the other side, which shows in single pixels; what is left is compared pixel by pixel.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

use std::sync::Arc;

use glam::Vec3;
use isophote_ldi::{
    Coverage, Error, Hybrid, HybridParams, LdiParams, LdiTracer, Shadows, Stages,
    gpu::{self, LdiGpuTracer},
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, LightKind, Scene, Selection, builtin,
    gpu::{BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, ShadowOptions, reference::World},
    reference::Tracers,
};

const SIZE: [u32; 2] = [48, 36];

fn maps(scene: &Arc<Scene>, coverage: Coverage) -> LdiTracer {
    let params = LdiParams {
        coverage,
        resolution: 64,
        ..LdiParams::default()
    };
    LdiTracer::build(scene, &Selection::default(), &params).unwrap()
}

fn on_cpu(scene: &Arc<Scene>, params: &HybridParams, coverage: Coverage) -> Stages {
    let selection = Selection::default();
    let exact = BvhTracer::build(scene, &selection, &BvhOptions::default()).unwrap();
    let secondary = maps(scene, coverage);
    let tracers = Tracers {
        exact: &exact,
        secondary: &secondary,
    };
    let hybrid = Hybrid::new(scene, tracers, params).unwrap();
    hybrid.render(&scene.cameras[0], SIZE, &|_, _| {}).unwrap()
}

fn on_gpu(
    context: &Context,
    scene: &Arc<Scene>,
    params: &HybridParams,
    coverage: Coverage,
    shadow_maps: Option<&ShadowOptions>,
) -> Stages {
    let selection = Selection::default();
    let gpu_scene = GpuScene::new(context, scene).unwrap();
    let exact = ComputeBvhTracer::build(context, scene, &selection, &()).unwrap();
    let twin = maps(scene, coverage);
    let secondary = match coverage {
        Coverage::Touched => LdiGpuTracer::build(context, scene, &selection, twin.params()),
        // Built on the device a few layers at edges are others.
        Coverage::Center => LdiGpuTracer::upload(context, &twin),
    };
    let secondary = secondary.unwrap();
    let world = World {
        scene,
        gpu_scene: &gpu_scene,
        exact: &exact,
        secondary: &secondary,
    };
    let hybrid = gpu::Hybrid::new(context, world, params, SIZE, shadow_maps).unwrap();
    let camera = &scene.cameras[0];
    let times = hybrid.render(context, world, camera, &|_, _| {}).unwrap();
    println!("{times:?}");
    let stages = hybrid.read(context).unwrap();
    // In one submission it is the same.
    let mut encoder = context.device().create_command_encoder(&Default::default());
    hybrid
        .record(context, &mut encoder, world, camera, None)
        .unwrap();
    context.submit("hybrid", encoder).unwrap();
    assert_eq!(stages.picture, hybrid.read(context).unwrap().picture);
    stages
}

/// Numbers of rays that no buffer of dispatches holds are refused before anything is allocated.
#[test]
fn too_many_rays_are_an_error() {
    let context = Context::noop();
    let scene = Arc::new(builtin::build("builtin:cornell").unwrap());
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let exact = ComputeBvhTracer::build(&context, &scene, &Selection::default(), &()).unwrap();
    let world = World {
        scene: &scene,
        gpu_scene: &gpu_scene,
        exact: &exact,
        secondary: &exact,
    };
    let params = HybridParams {
        diffuse_rays: 1 << 16,
        ..HybridParams::default()
    };
    assert!(gpu::Hybrid::new(&context, world, &params, [64, 64], None).is_ok());
    let error = gpu::Hybrid::new(&context, world, &params, [1024, 1024], None).unwrap_err();
    assert!(
        matches!(error, Error::Scene(isophote_scene::Error::GpuLimit { .. })),
        "{error}"
    );
}

/// How two pictures differ: the bias, and the shares of pixels that are off by more than 1 % and 10 % of the mean.
fn differences(found: &[Vec3], expected: &[Vec3]) -> [f32; 3] {
    let mean = |values: &[Vec3]| {
        values.iter().map(|value| value.element_sum()).sum::<f32>() / (3 * values.len()) as f32
    };
    let whole = mean(expected);
    let off = |limit: f32| {
        let pairs = found.iter().zip(expected);
        let off = pairs.filter(|(a, b)| (**a - **b).abs().max_element() > limit * whole);
        off.count() as f32 / expected.len() as f32
    };
    [mean(found) / whole - 1.0, off(0.01), off(0.1)]
}

/// Compares all stages with samples in the middle of pixels.
fn check(
    context: &Context,
    name: &str,
    scene: &Arc<Scene>,
    params: &HybridParams,
    coverage: Coverage,
) {
    let expected = on_cpu(scene, params, coverage);
    let found = on_gpu(context, scene, params, coverage, None);
    for pass in &found.passes {
        let twin = expected.passes.iter().find(|twin| twin.name == pass.name);
        let twin = twin.unwrap();
        for (rays, expected) in [(pass.rays, twin.rays), (pass.shadow_rays, twin.shadow_rays)] {
            assert!(
                rays.abs_diff(expected) <= expected / 200,
                "{name}: {pass:?}, on the CPU {twin:?}"
            );
        }
    }
    let stages = found.layers().into_iter().zip(expected.layers());
    for ((stage, found), (_, expected)) in
        stages.chain([(("picture", &found.picture[..]), ("", &expected.picture[..]))])
    {
        if expected.iter().all(|value| *value == Vec3::ZERO) {
            assert!(
                found.iter().all(|value| *value == Vec3::ZERO),
                "{name}, {stage}"
            );
            continue;
        }
        let [bias, off, far_off] = differences(found, expected);
        println!(
            "{name}, {stage}: bias {bias:.5}, {off:.4} and {far_off:.4} of the pixels off by 1 % and 10 %"
        );
        // The filter spreads what single rays find.
        let most = match stage {
            "direct" | "glossy" | "irradiance.noisy" => [0.02, 0.01],
            _ => [0.1, 0.02],
        };
        assert!(
            bias.abs() < 0.01 && off < most[0] && far_off < most[1],
            "{name}, {stage}: {bias} {off} {far_off}"
        );
    }
}

/// An office whose lamps have an extent, and of which something glows.
fn office() -> Arc<Scene> {
    let mut office = builtin::build("builtin:office").unwrap();
    for light in &mut office.lights {
        if let LightKind::Point { radius } = &mut light.kind {
            *radius = 0.1;
        }
    }
    let last = office.instances.last().unwrap();
    let material = office.mesh(last).triangle_materials[0] as usize;
    office.materials[material].emissive = Vec3::new(0.5, 0.3, 0.1);
    Arc::new(office)
}

fn params() -> HybridParams {
    HybridParams {
        light_rays: 4,
        glossy_rays: 4,
        ..HybridParams::default()
    }
}

#[test]
fn stages_are_the_cpus() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let office = office();
    let touched = Coverage::Touched;
    check(&context, "stopped at edges", &office, &params(), touched);
    let filtered = HybridParams {
        light_filter_width: 5,
        edges: None,
        ..params()
    };
    check(&context, "light filtered", &office, &filtered, touched);
}

/// The paper's layers, shadows by them, and what glass shows; with more light rays than a dispatch takes.
#[test]
fn other_maps_shadows_and_glass_are_the_cpus() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let mut office = builtin::build("builtin:office").unwrap();
    for material in &mut office.materials {
        material.transmission = 0.5;
        material.roughness = 0.3;
    }
    let glass = Arc::new(office);
    let by_maps = HybridParams {
        shadows: Shadows::Secondary,
        light_rays: 20,
        ..params()
    };
    let cornell = Arc::new(builtin::build("builtin:cornell").unwrap());
    let (touched, center) = (Coverage::Touched, Coverage::Center);
    check(&context, "glass", &glass, &params(), touched);
    check(&context, "shadows by maps", &cornell, &by_maps, touched);
    check(
        &context,
        "shadows by the paper's",
        &cornell,
        &by_maps,
        center,
    );
}

fn rms(a: &[Vec3], b: &[Vec3]) -> f32 {
    let squares = a.iter().zip(b).map(|(a, b)| (*a - *b).length_squared());
    (squares.sum::<f32>() / (3 * a.len()) as f32).sqrt()
}

/// With four samples a pixel the GPU looks at a triangle near the pixel's centre, the CPU at its first sample, up to half
/// a pixel away: they differ by little more than two pictures of the CPU with other seeds do.
#[test]
fn four_samples_are_the_cpus_but_for_noise() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let cornell = Arc::new(builtin::build("builtin:cornell").unwrap());
    let params = HybridParams {
        samples: 4,
        light_rays: 16,
        ..params()
    };
    let touched = Coverage::Touched;
    let (expected, found) = (
        on_cpu(&cornell, &params, touched),
        on_gpu(&context, &cornell, &params, touched, None),
    );
    let other = on_cpu(&cornell, &HybridParams { seed: 1, ..params }, touched);
    let layers = found.layers().into_iter().zip(expected.layers());
    for (((stage, found), (_, expected)), (_, other)) in layers.zip(other.layers()) {
        if stage == "glossy" {
            continue;
        }
        let [bias, ..] = differences(found, expected);
        let [error, noise] = [found, other].map(|picture| rms(picture, expected));
        println!("{stage}: bias {bias:.5}, error {error:.5} where noise is {noise:.5}");
        assert!(
            bias.abs() < 0.02 && error < 2.5 * noise,
            "{stage}: {bias} {error} {noise}"
        );
    }
}

/// With shadow maps no light is chosen and shadows are as fine as the maps: the CPU's pictures with many rays, but for
/// noise and the edges of shadows.
#[test]
fn shadow_maps_cast_the_shadows_of_rays() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let office = Arc::new(builtin::build("builtin:office").unwrap());
    let quick = HybridParams {
        diffuse_rays: 16,
        ..params()
    };
    let slow = HybridParams {
        light_rays: 64,
        ..quick
    };
    let maps = ShadowOptions::default();
    let touched = Coverage::Touched;
    let found = on_gpu(&context, &office, &quick, touched, Some(&maps));
    let expected = on_cpu(&office, &slow, touched);
    // What secondary rays hit is lit by one light at a time there, so that of indirect light only the mean can be compared.
    for (stage, limits) in [
        ("direct", [0.03, 0.2]),
        ("irradiance.indirect", [0.06, 1.0]),
    ] {
        let layer = |stages: &Stages| {
            let layers = stages.layers();
            layers.iter().find(|one| one.0 == stage).unwrap().1.to_vec()
        };
        let (found, expected) = (layer(&found), layer(&expected));
        let [bias, _, far_off] = differences(&found, &expected);
        println!("shadow maps, {stage}: bias {bias:.4}, {far_off:.4} of the pixels off by 10 %");
        assert!(
            bias.abs() < limits[0] && far_off < limits[1],
            "{stage}: {bias} {far_off}"
        );
    }
    assert!(found.passes[0].rays == 0 && found.passes[1].rays > 0);
}
