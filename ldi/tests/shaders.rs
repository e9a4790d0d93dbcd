//! The shaders link, are valid, and become pipelines on a device that needs no GPU and has WebGPU's default limits.
#![cfg(feature = "gpu")]

use std::sync::Arc;

use isophote_ldi::{Coverage, LdiParams, gpu::LdiGpuTracer};
use isophote_scene::{
    Selection, builtin,
    gpu::{BuildGpuTracer, Context, GpuScene, GpuTracer, RayBatch},
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
