//! Every entry point links, is valid, and becomes a pipeline on a device that needs no GPU and has WebGPU's default
//! limits.
#![cfg(feature = "gpu")]

use isophote_filters::{
    ATrous, DiscontinuityBuffer, EdgeStop, Gaussian, JointBilateral, Neighborhood, Pinhole,
    SinglePass, Temporal, TemporalParams, Thresholds, gpu,
};
use isophote_scene::gpu::Context;

#[test]
fn every_filter_builds_in_both_formats() {
    let context = Context::noop();
    let size = [64, 48];
    let (around, edges) = (Neighborhood::default(), EdgeStop::default());
    let camera = Pinhole::at_origin(1.0).unwrap();
    gpu::Guides::new(&context, size, &camera).unwrap();
    gpu::CameraMotion::new(&context, &camera, &camera).unwrap();
    for format in [gpu::Format::Single, gpu::Format::Half] {
        let gaussian = Gaussian::default();
        gpu::Gaussian::new(&context, &gaussian, None, size, format).unwrap();
        gpu::Gaussian::new(&context, &gaussian, Some(edges), size, format).unwrap();
        let joint_bilateral = JointBilateral::new(4, around, edges).unwrap();
        gpu::JointBilateral::new(&context, &joint_bilateral, format).unwrap();
        let discontinuity = DiscontinuityBuffer::new([3, 3], Thresholds::default()).unwrap();
        gpu::DiscontinuityBuffer::new(&context, &discontinuity, format).unwrap();
        let single_pass = SinglePass::new(4, [3, 3], around, edges).unwrap();
        gpu::SinglePass::new(&context, &single_pass, format).unwrap();
        let a_trous = ATrous::new(5, 1.0, edges).unwrap();
        gpu::ATrous::new(&context, &a_trous, size, format).unwrap();
        let temporal = Temporal::new(TemporalParams::default()).unwrap();
        gpu::Temporal::new(&context, &temporal, size, format).unwrap();
    }
}
