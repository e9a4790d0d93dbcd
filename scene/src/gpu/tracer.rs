//! Who answers rays on the GPU.
//!
//! A tracer is a WESL module with the functions that [`GpuTracer`] lists, and the bind group that it reads. A shader imports
//! their names from the package `tracer`, so that it never learns who answers; [`RayBatch`](super::RayBatch) asks about rays in
//! bulk.

pub(crate) mod batch;
pub(crate) mod binding;
pub(crate) mod compute_bvh;
pub(crate) mod ray_query;

use std::sync::Arc;

use glam::Affine3A;

use super::{Context, ShaderPackage};
use crate::{Answers, Result, Scene, Selection};

/// Answers visibility queries in shaders. Rays that are not valid miss.
///
/// Its module exports `closest_hit(ray: Ray) -> Hit` and `any_hit(ray: Ray) -> bool` with the types of `scene::ray`;
/// `closest_hit_from(ray: Ray, instance: u32) -> Hit` and `any_hit_from(ray: Ray, instance: u32) -> bool` for rays that start
/// on an instance, of which what is nearer than the tracer's own error does not count; and `tolerance(point: vec3f) -> f32`,
/// which is [`Tracer::tolerance`](crate::Tracer::tolerance): 0 for exact tracers. It binds at most two storage buffers, all as
/// group 1, and may read the scene's data in group 2.
pub trait GpuTracer: Send + Sync {
    /// The name by which it is asked for on the command line.
    fn name(&self) -> &'static str;

    /// What the answers hold.
    fn answers(&self) -> Answers;

    /// What a device must support for its module to be used.
    fn required_features(&self) -> wgpu::Features {
        wgpu::Features::empty()
    }

    /// Its module, as `package::module`.
    fn module(&self) -> &'static str;

    /// The package its module is in, and others that it imports from; the scene's is always there.
    fn packages(&self) -> &[ShaderPackage] {
        &[]
    }

    /// Flags of conditional translation with which its module is linked; they stay the same when the tracer is updated.
    fn shader_flags(&self) -> &[&'static str] {
        &[]
    }

    /// The layout of [`bind_group`](Self::bind_group); it stays the same when the tracer is updated.
    fn bind_group_layout(&self) -> &wgpu::BindGroupLayout;

    /// What its module binds as group 1; another one after an update.
    fn bind_group(&self) -> &wgpu::BindGroup;
}

/// The contract by which GPU tracers are made and moved; the twin of [`BuildTracer`](crate::BuildTracer).
pub trait BuildGpuTracer: GpuTracer + Sized {
    /// What can be chosen when building; `default()` is a good choice.
    type Options: Default;

    /// Builds the tracer of the selected part of a scene.
    ///
    /// # Errors
    /// [`Error::NoGeometry`](crate::Error::NoGeometry) when nothing is selected,
    /// [`Error::GpuLimit`](crate::Error::GpuLimit) when it is too large for the device, and
    /// [`Error::Gpu`](crate::Error::Gpu) when the device lacks what is needed or fails.
    fn build(
        context: &Context,
        scene: &Arc<Scene>,
        selection: &Selection,
        options: &Self::Options,
    ) -> Result<Self>;

    /// Moves the instances: one transform per instance of the scene, as [`Scene::transforms`] gives them.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when the number of transforms is not that of the instances, and what
    /// [`build`](Self::build) can return.
    fn update(&mut self, context: &Context, transforms: &[Affine3A]) -> Result<()>;

    /// Bytes of GPU memory held by the tracer's own structures.
    fn bytes(&self) -> u64;
}
