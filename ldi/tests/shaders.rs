//! The shaders link, are valid, and become pipelines on a device that needs no GPU and has WebGPU's default limits.
#![cfg(feature = "gpu")]

use std::sync::Arc;

use glam::Vec3;
use isophote_ldi::{
    Coverage, HybridParams, LdiParams, Shadows,
    gpu::{Hybrid, LdiGpuTracer},
};
use isophote_scene::{
    Selection, builtin,
    gpu::{
        BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, GpuTracer, RayBatch, ShadowOptions,
        reference::World,
    },
};

#[test]
fn batches_build_in_buffers_and_in_textures() {
    let scene = Arc::new(builtin::build("builtin:cornell").unwrap());
    let small = wgpu::Limits {
        max_storage_buffer_binding_size: 128,
        ..wgpu::Limits::default()
    };
    for (context, in_textures) in [
        (Context::noop(), false),
        (Context::noop_within(small), true),
    ] {
        let gpu_scene = GpuScene::new(&context, &scene).unwrap();
        for coverage in [Coverage::Center, Coverage::Touched] {
            let params = LdiParams {
                cells: 2,
                resolution: 16,
                coverage,
                ..LdiParams::default()
            };
            let tracer =
                LdiGpuTracer::build(&context, &scene, &Selection::default(), &params).unwrap();
            assert_eq!(tracer.shader_flags().is_empty(), !in_textures);
            RayBatch::new(&context, &gpu_scene, &tracer).unwrap();
        }
    }
}

#[test]
fn the_hybrid_renderer_builds() {
    let cornell = builtin::build("builtin:cornell").unwrap();
    let mut glass = cornell.clone();
    for material in &mut glass.materials {
        material.transmission = 0.5;
    }
    let context = Context::noop();
    let mut lamps = cornell.clone();
    for material in &mut lamps.materials {
        material.emissive = Vec3::ZERO;
    }
    for (scene, samples, shadows, light_filter_width, shadow_maps) in [
        (cornell, 1, Shadows::Exact, 1, false),
        (glass, 4, Shadows::Secondary, 5, false),
        (lamps, 1, Shadows::Exact, 1, true),
    ] {
        let scene = Arc::new(scene);
        let gpu_scene = GpuScene::new(&context, &scene).unwrap();
        let selection = Selection::default();
        let exact = ComputeBvhTracer::build(&context, &scene, &selection, &()).unwrap();
        let maps = LdiParams {
            cells: 2,
            resolution: 16,
            ..LdiParams::default()
        };
        let secondary = LdiGpuTracer::build(&context, &scene, &selection, &maps).unwrap();
        let params = HybridParams {
            samples,
            shadows,
            light_filter_width,
            ..HybridParams::default()
        };
        let world = World {
            scene: &scene,
            gpu_scene: &gpu_scene,
            exact: &exact,
            secondary: &secondary,
        };
        let maps = shadow_maps.then(ShadowOptions::default);
        let hybrid = Hybrid::new(&context, world, &params, [33, 20], maps.as_ref()).unwrap();
        let mut encoder = context.device().create_command_encoder(&Default::default());
        let camera = &scene.cameras[0];
        hybrid
            .record(&context, &mut encoder, world, camera, None)
            .unwrap();
        context.submit("hybrid", encoder).unwrap();
        // This device computes nothing, which is found out.
        assert!(hybrid.read(&context).is_err());
    }
}
