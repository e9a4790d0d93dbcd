//! The device's own ray tracing: exact over triangles, imperfect over the boxes around them.
//!
//! 1. `geometry`: which triangles of which instance take part, in an order that keeps neighbours together.
//! 2. `structures`: acceleration structures of them.
//! 3. `self_test`: a few rays whose answers are known, once per device, before any other answer is trusted.

mod boxes;
mod geometry;
mod self_test;
mod structures;

use std::sync::Arc;

use glam::Affine3A;

pub use self::{boxes::RayQueryBoxTracer, self_test::check_ray_query};
use self::{geometry::Geometry, structures::Structures};
use super::{BuildGpuTracer, GpuTracer};
use crate::{
    Answers, Result, Scene, Selection,
    gpu::{Context, upload::entries},
    trace::brute_force::check_transforms,
};

/// Finds what [`BvhTracer`](crate::BvhTracer) finds, by ray query. Binds one storage buffer and an acceleration structure.
#[derive(Debug)]
pub struct RayQueryTracer {
    scene: Arc<Scene>,
    selection: Selection,
    layout: wgpu::BindGroupLayout,
    bind_group: wgpu::BindGroup,
    structures: Structures,
    bytes: u64,
}

impl GpuTracer for RayQueryTracer {
    fn name(&self) -> &'static str {
        "ray-query"
    }

    fn answers(&self) -> Answers {
        Answers::Surface
    }

    fn required_features(&self) -> wgpu::Features {
        wgpu::Features::EXPERIMENTAL_RAY_QUERY
    }

    fn module(&self) -> &'static str {
        "scene::tracer::ray_query"
    }

    fn bind_group_layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    fn bind_group(&self) -> &wgpu::BindGroup {
        &self.bind_group
    }
}

impl BuildGpuTracer for RayQueryTracer {
    type Options = ();

    fn build(
        context: &Context,
        scene: &Arc<Scene>,
        selection: &Selection,
        (): &(),
    ) -> Result<Self> {
        check_ray_query(context)?;
        Self::build_untested(context, scene, selection)
    }

    fn update(&mut self, context: &Context, transforms: &[Affine3A]) -> Result<()> {
        check_transforms(&self.scene, transforms)?;
        // Without bounds the same triangles take part wherever they are.
        if self.selection.bounds.is_none() {
            return self.structures.place(context, transforms);
        }
        let built = Built::new(
            context,
            &self.layout,
            &self.scene,
            &self.selection,
            transforms,
        )?;
        (self.bind_group, self.structures, self.bytes) =
            (built.bind_group, built.structures, built.bytes);
        Ok(())
    }

    fn bytes(&self) -> u64 {
        self.bytes
    }
}

impl RayQueryTracer {
    fn build_untested(
        context: &Context,
        scene: &Arc<Scene>,
        selection: &Selection,
    ) -> Result<Self> {
        let layout = structures::layout(context)?;
        let built = Built::new(context, &layout, scene, selection, &scene.transforms())?;
        Ok(Self {
            scene: scene.clone(),
            selection: *selection,
            layout,
            bind_group: built.bind_group,
            structures: built.structures,
            bytes: built.bytes,
        })
    }
}

/// What depends on which triangles take part.
struct Built {
    bind_group: wgpu::BindGroup,
    structures: Structures,
    bytes: u64,
}

impl Built {
    fn new(
        context: &Context,
        layout: &wgpu::BindGroupLayout,
        scene: &Scene,
        selection: &Selection,
        transforms: &[Affine3A],
    ) -> Result<Self> {
        let geometry = Geometry::new(scene, selection, transforms)?;
        let primitives = geometry.primitive_table();
        let bytes = size_of_val(&primitives[..]) as u64;
        context.check_storage_size("the triangles' order", bytes)?;
        let primitives = context.buffer("primitives", &primitives, wgpu::BufferUsages::STORAGE)?;
        let structures = Structures::of_triangles(context, &geometry, transforms)?;
        let bind_group = context.check("ray query", |device| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("ray query"),
                layout,
                entries: &entries([structures.binding(), primitives.as_entire_binding()]),
            })
        })?;
        Ok(Self {
            bind_group,
            structures,
            bytes,
        })
    }
}
