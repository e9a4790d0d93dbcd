//! The shaders link, are valid, and become pipelines on a device that needs no GPU and has WebGPU's default limits.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests")]

mod support;

use glam::Affine3A;
use isophote_displacement_field::{
    Error, FieldParams, FieldTracer, LookUp, Object, Positions, gpu::FieldGpuTracer,
};
use isophote_scene::{
    Selection,
    gpu::{Context, GpuScene, GpuTracer, RayBatch},
};

fn tracer(positions: Positions) -> FieldTracer {
    let torus = support::torus("torus", 8, 6, 0.45);
    let params = FieldParams {
        positions,
        ..FieldParams::default()
    };
    let object = Object::new(support::field(&torus, &params));
    let scene = support::scene(&torus, &[Affine3A::IDENTITY]);
    FieldTracer::new(&scene, &Selection::default(), vec![object], LookUp::Aimed).unwrap()
}

#[test]
fn batches_build_in_buffers_and_in_textures() {
    let twin = tracer(Positions::Slater { rings: 2 });
    let torus = support::torus("torus", 8, 6, 0.45);
    let scene = support::scene(&torus, &[Affine3A::IDENTITY]);
    let small = wgpu::Limits {
        max_storage_buffer_binding_size: 128,
        ..wgpu::Limits::default()
    };
    for (context, in_textures) in [
        (Context::noop(), false),
        (Context::noop_within(small), true),
    ] {
        let gpu_scene = GpuScene::new(&context, &scene).unwrap();
        let tracer = FieldGpuTracer::new(&context, twin.clone(), None).unwrap();
        assert_eq!(tracer.shader_flags().is_empty(), !in_textures);
        RayBatch::new(&context, &gpu_scene, &tracer).unwrap();
    }
}

#[test]
fn other_positions_are_refused() {
    let twin = tracer(Positions::Octahedral { side: 4 });
    let refused = FieldGpuTracer::new(&Context::noop(), twin, None);
    assert!(matches!(refused, Err(Error::Parameter { .. })));
}

#[test]
fn scenes_that_are_moved_together_have_the_same_instances() {
    let twin = tracer(Positions::Slater { rings: 2 });
    let torus = support::torus("torus", 8, 6, 0.45);
    let two = support::scene(&torus, &[Affine3A::IDENTITY; 2]);
    let others = Some((two, Selection::default()));
    let refused = FieldGpuTracer::new(&Context::noop(), twin, others);
    assert!(matches!(refused, Err(Error::Parameter { .. })));
}
