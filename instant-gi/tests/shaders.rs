//! Every stage with every pair of tracers links, is valid, and becomes a pipeline on a device that needs no GPU and has
//! WebGPU's default limits.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

use std::sync::Arc;

use isophote_instant_gi::{Error, Filter, GiParams, ShadowMaps, Visibility, gpu::InstantGi};
use isophote_scene::{
    Answers, Error as SceneError, Leaves, Scene, Selection, builtin,
    gpu::{
        BuildGpuTracer, ComputeBvhTracer, Context, GBuffer, GBufferViews, GpuScene, GpuTracer,
        RayQueryBoxTracer, RayQueryTracer, reference::World,
    },
};

fn cornell() -> Arc<Scene> {
    let mut scene = builtin::build("builtin:cornell").unwrap();
    scene.materials[0].metallic = 0.5;
    scene.materials[0].transmission = 0.5;
    Arc::new(scene)
}

fn tracers(context: &Context, scene: &Arc<Scene>) -> Vec<Box<dyn GpuTracer>> {
    let selection = Selection::default();
    vec![
        Box::new(ComputeBvhTracer::build(context, scene, &selection, &()).unwrap()),
        Box::new(ComputeBvhTracer::build_with(context, scene, &selection, Leaves::Boxes).unwrap()),
        Box::new(RayQueryTracer::build(context, scene, &selection, &()).unwrap()),
        Box::new(RayQueryBoxTracer::build(context, scene, &selection, &()).unwrap()),
    ]
}

/// The paper's settings, or everything else at once; with few lights where buffers are small.
fn params(few: bool) -> [GiParams; 6] {
    let paths = if few { 4 } else { 180 };
    let paper = GiParams {
        paths,
        downsampling: 4,
        interleaving: [3, 3],
        filter: Filter::Paper,
        ..GiParams::default()
    };
    let other = GiParams {
        paths,
        bounces: 2,
        compensation: 4,
        interleaving: [2, 2],
        ..GiParams::default()
    };
    let filled = GiParams {
        filter: Filter::Fill,
        ..other
    };
    let maps = GiParams {
        visibility: Visibility::Maps(ShadowMaps::default()),
        ..paper
    };
    let selected = |params: GiParams| GiParams {
        selection: 2,
        kept: if few { 0 } else { 3 },
        refinement: 2,
        ..params
    };
    [paper, other, filled, maps, selected(filled), selected(maps)]
}

#[test]
fn stages_build_with_every_tracer() {
    let scene = cornell();
    let small = wgpu::Limits {
        max_storage_buffer_binding_size: 1 << 9,
        ..wgpu::Limits::default()
    };
    for context in [Context::noop(), Context::noop_within(small)] {
        let gpu_scene = GpuScene::new(&context, &scene).unwrap();
        let in_textures = gpu_scene.is_in_textures();
        let tracers = tracers(&context, &scene);
        let exact = tracers.iter();
        for exact in exact.filter(|one| one.answers() == Answers::Surface) {
            for secondary in &tracers {
                let world = World {
                    scene: &scene,
                    gpu_scene: &gpu_scene,
                    exact: &**exact,
                    secondary: &**secondary,
                };
                for params in params(in_textures) {
                    if params.compensation == 0 || secondary.answers() == Answers::Surface {
                        check(&context, world, &params);
                    }
                }
            }
        }
    }
}

fn check(context: &Context, world: World<'_>, params: &GiParams) {
    let names = [world.exact.name(), world.secondary.name()];
    let gi = InstantGi::new(context, world, params, [33, 20])
        .unwrap_or_else(|error| panic!("{names:?}: {error}"));
    let mut encoder = context.device().create_command_encoder(&Default::default());
    let camera = &world.scene.cameras[0];
    gi.record(context, &mut encoder, world, camera, None)
        .unwrap();
    // Acceleration structures are not built here.
    if context.submit("igi", encoder).is_ok() {
        // This device computes nothing, which is found out.
        let error = gi.read(context).unwrap_err().to_string();
        assert!(error.contains("did not finish"), "{error}");
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let context = Context::noop();
    let scene = cornell();
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let tracers = tracers(&context, &scene);
    let make = |exact: usize, secondary: usize, params: &GiParams, size| {
        let world = World {
            scene: &scene,
            gpu_scene: &gpu_scene,
            exact: &*tracers[exact],
            secondary: &*tracers[secondary],
        };
        InstantGi::new(&context, world, params, size)
            .map(drop)
            .unwrap_err()
    };
    let plain = GiParams::default();
    let knows_less = |error| matches!(error, Error::Scene(SceneError::TracerKnowsLess { .. }));
    assert!(knows_less(make(1, 0, &plain, [8, 8])));
    let compensated = GiParams {
        compensation: 1,
        ..plain
    };
    assert!(knows_less(make(0, 1, &compensated, [8, 8])));
    let limit = |error| matches!(error, Error::Scene(SceneError::GpuLimit { .. }));
    assert!(limit(make(0, 0, &plain, [8193, 1])));
    let many = GiParams {
        paths: 1 << 16,
        bounces: 16,
        ..plain
    };
    let small = Context::noop_within(wgpu::Limits {
        max_storage_buffer_binding_size: 1 << 20,
        ..wgpu::Limits::default()
    });
    let gpu_scene = GpuScene::new(&small, &scene).unwrap();
    let tracer = ComputeBvhTracer::build(&small, &scene, &Selection::default(), &()).unwrap();
    let world = World {
        scene: &scene,
        gpu_scene: &gpu_scene,
        exact: &tracer,
        secondary: &tracer,
    };
    assert!(limit(
        InstantGi::new(&small, world, &many, [8, 8])
            .map(drop)
            .unwrap_err()
    ));
    let maps = GiParams {
        visibility: Visibility::Maps(ShadowMaps::default()),
        ..many
    };
    assert!(limit(make(0, 0, &maps, [8, 8])));
    for size in [[0, 8], [1 << 16, 1 << 16]] {
        assert!(matches!(make(0, 0, &plain, size), Error::Parameter { .. }));
    }
}

/// Another renderer's G-buffer must tell what the stages ask for.
#[test]
fn gbuffers_that_lack_something_are_refused() {
    let context = Context::noop();
    let scene = cornell();
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let tracer = ComputeBvhTracer::build(&context, &scene, &Selection::default(), &()).unwrap();
    let world = World {
        scene: &scene,
        gpu_scene: &gpu_scene,
        exact: &tracer,
        secondary: &tracer,
    };
    let params = GiParams::default();
    let over = |gbuffer: &GBuffer| {
        InstantGi::over(&context, world, &params, gbuffer)
            .map(drop)
            .map_err(|error| error.to_string())
    };
    let whole = GBuffer::new(&context, [16, 8], 1).unwrap();
    over(&whole).unwrap();
    let sampled = GBuffer::new(&context, [16, 8], 4).unwrap();
    assert!(over(&sampled).unwrap_err().contains("4 samples"));
    let one = GBuffer::new(&context, [1, 1], 1).unwrap();
    let without = GBufferViews {
        ids: one.views().ids.clone(),
        ..whole.views().clone()
    };
    let without = GBuffer::from_views(&context, without, &scene.cameras[0]).unwrap();
    assert!(over(&without).unwrap_err().contains("1x1 instances"));
}
