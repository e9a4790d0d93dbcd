//! The method in shaders beside the CPU's, stage by stage, over every tracer.
//!
//! Both shoot the same paths and take the same samples. What is left is rounding, and the few rays that it moves across an
//! edge.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

use std::sync::Arc;

use glam::{Vec3, Vec4};
use isophote_instant_gi::{
    Error, Filter, GiParams, History, InstantGi, Lookup, Pattern, ShadowMaps, Stages, Visibility,
    gpu,
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Environment, GBuffer as SeenByRays, Leaves, Light,
    LightKind, Scene, Selection, builtin,
    gpu::{
        BuildGpuTracer, ComputeBvhTracer, Context, GBuffer, GBufferViews, GpuScene, GpuTracer,
        RayQueryBoxTracer, RayQueryTracer, Timer, reference::World,
    },
    reference::{Materials, Tracers},
    testing::{mean, relative_rmse},
};

const SIZE: [u32; 2] = [64, 48];
/// How far two pictures may be apart, as relRMSE.
const MOST: f64 = 0.005;

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
            "refined",
            zoo(),
            GiParams {
                paths: 40,
                downsampling: 4,
                interleaving: [2, 2],
                refinement: 2,
                glossy_rays: 1,
                ..plain
            },
        ),
        (
            "kept",
            filled.clone(),
            GiParams {
                paths: 400,
                kept: 60,
                ..plain
            },
        ),
        (
            "all are kept",
            filled.clone(),
            GiParams {
                paths: 20,
                kept: 100,
                ..plain
            },
        ),
        (
            "selected of those that are kept",
            filled.clone(),
            GiParams {
                paths: 500,
                kept: 100,
                selection: 40,
                interleaving: [2, 1],
                filter: Filter::Fill,
                seed: 2,
                ..plain
            },
        ),
        (
            "selected",
            filled.clone(),
            GiParams {
                paths: 200,
                selection: 40,
                seed: 5,
                ..plain
            },
        ),
        (
            "selected of parts, filled and mirrored",
            zoo(),
            GiParams {
                paths: 100,
                selection: 10,
                downsampling: 2,
                interleaving: [2, 2],
                filter: Filter::Fill,
                compensation: 2,
                ..plain
            },
        ),
        (
            "selected, by shadow maps",
            filled.clone(),
            GiParams {
                paths: 100,
                selection: 60,
                visibility: maps(32, Lookup::Smooth),
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

/// Of a sequence of pictures with a camera that moves the last one knows as much as the CPU's.
#[test]
fn sequences_are_the_cpus() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let scene = Arc::new(builtin::build("builtin:cornell").unwrap());
    let params = GiParams {
        paths: 40,
        downsampling: 2,
        refinement: 2,
        ..GiParams::default()
    };
    let exact = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default()).unwrap();
    let tracers = Tracers {
        exact: &exact,
        secondary: &exact,
    };
    let on_cpu = InstantGi::new(&scene, tracers, &params).unwrap();
    let tracer = ComputeBvhTracer::build(&context, &scene, &Selection::default(), &()).unwrap();
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let world = World {
        scene: &scene,
        gpu_scene: &gpu_scene,
        exact: &tracer,
        secondary: &tracer,
    };
    let on_gpu = gpu::InstantGi::new(&context, world, &params, SIZE).unwrap();
    let mut expected_history = History::new(8).unwrap();
    let mut history = gpu::History::new(&context, 8, SIZE).unwrap();
    let mut camera = scene.cameras[0].clone();
    for number in 0..3 {
        let expected = on_cpu
            .render_next(&camera, SIZE, &mut expected_history, &|_, _| {})
            .unwrap();
        let mut encoder = context.device().create_command_encoder(&Default::default());
        on_gpu
            .record_next(&context, &mut encoder, world, &camera, &mut history, None)
            .unwrap();
        context.submit("next", encoder).unwrap();
        let found = on_gpu.read(&context).unwrap();
        let error = relative_rmse(&found.picture, &expected.picture);
        println!("picture {number}: relRMSE {error:.1e}");
        assert!(error <= MOST, "picture {number}: {error}");
        camera.transform.translation.x += 0.02;
    }
    assert_eq!(history.pictures(), expected_history.pictures());
    let other = gpu::History::new(&context, 8, [8, 8]);
    let mut encoder = context.device().create_command_encoder(&Default::default());
    let refused = on_gpu.record_next(
        &context,
        &mut encoder,
        world,
        &camera,
        &mut other.unwrap(),
        None,
    );
    assert!(matches!(refused, Err(Error::Filter(_))), "{refused:?}");
}

/// A texture with a picture's values.
fn uploaded(
    context: &Context,
    format: wgpu::TextureFormat,
    [width, height]: [u32; 2],
    texels: &[u8],
) -> wgpu::TextureView {
    let size = wgpu::Extent3d {
        width,
        height,
        depth_or_array_layers: 1,
    };
    let texture = context.device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(texels.len() as u32 / height),
        rows_per_image: None,
    };
    context
        .queue()
        .write_texture(texture.as_image_copy(), texels, layout, size);
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// The layers of what a camera sees by rays, with the base colours dimmed.
fn layers_of(context: &Context, scene: &Arc<Scene>, dimmed: f32) -> GBufferViews {
    let exact = BvhTracer::build(scene, &Selection::default(), &BvhOptions::default()).unwrap();
    let camera = &scene.cameras[0];
    let seen = SeenByRays::see(scene, &exact, camera, SIZE, Materials::Pbr);
    let (normals, depths) = seen.normals_and_depths(&camera.pinhole());
    let (mut colors, mut ids) = (Vec::new(), Vec::new());
    for seen in &seen.pixels {
        let color = seen.as_ref().map(|seen| seen.material.base_color);
        colors.push((dimmed * color.unwrap_or_default()).extend(1.0));
        let surface = seen.as_ref().map(|seen| seen.point.surface);
        let words = surface.map_or([0, 0], |of| [of.instance + 1, of.primitive + 1]);
        ids.extend(words.map(|word| [word as u16, (word >> 16) as u16]));
    }
    let normals: Vec<Vec4> = normals
        .into_iter()
        .map(|normal| normal.extend(0.0))
        .collect();
    let layer = |format, texels: &[u8]| uploaded(context, format, SIZE, texels);
    GBufferViews {
        depth: layer(wgpu::TextureFormat::R32Float, bytemuck::cast_slice(&depths)),
        normal: layer(
            wgpu::TextureFormat::Rgba32Float,
            bytemuck::cast_slice(&normals),
        ),
        albedo: layer(
            wgpu::TextureFormat::Rgba32Float,
            bytemuck::cast_slice(&colors),
        ),
        material: uploaded(context, wgpu::TextureFormat::Rg16Uint, [1, 1], &[0; 4]),
        ids: layer(wgpu::TextureFormat::Rgba16Uint, bytemuck::cast_slice(&ids)),
    }
}

/// What another renderer has seen stands for camera rays, with its own base colours.
#[test]
fn a_gbuffer_that_is_handed_in_gives_the_same_picture() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let scene = zoo();
    let params = GiParams {
        paths: 40,
        depth: 2,
        glossy_rays: 1,
        downsampling: 4,
        refinement: 2,
        ..GiParams::default()
    };
    let tracer = ComputeBvhTracer::build(&context, &scene, &Selection::default(), &()).unwrap();
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let world = World {
        scene: &scene,
        gpu_scene: &gpu_scene,
        exact: &tracer,
        secondary: &tracer,
    };
    let camera = &scene.cameras[0];
    let handed_in = |dimmed| {
        let layers = layers_of(&context, &scene, dimmed);
        let gbuffer = GBuffer::from_views(&context, layers, camera).unwrap();
        let gi = gpu::InstantGi::over(&context, world, &params, &gbuffer).unwrap();
        gi.render(&context, world, camera, &|_, _| {}).unwrap()
    };
    let found = handed_in(1.0);
    let own = gpu::InstantGi::new(&context, world, &params, SIZE).unwrap();
    let mut expected = own.render(&context, world, camera, &|_, _| {}).unwrap();
    // No ray is asked for the camera.
    assert!(expected.passes[1].rays > 0);
    expected.passes[1].rays = 0;
    check("handed in", &found, &expected);
    let half: Vec<Vec3> = handed_in(0.5)
        .indirect
        .iter()
        .map(|light| 2.0 * light)
        .collect();
    let error = relative_rmse(&half, &found.indirect);
    assert!(
        error < 1e-5,
        "base colours are not those that were handed in: {error}"
    );
}
