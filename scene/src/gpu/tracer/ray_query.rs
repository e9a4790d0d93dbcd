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
use super::{BuildGpuTracer, GpuTracer, binding::TracerBinding};
use crate::{
    Answers, Result, Scene, Selection, gpu::Context, trace::brute_force::check_transforms,
};

/// Finds what [`BvhTracer`](crate::BvhTracer) finds, by ray query. Binds an acceleration structure and one storage buffer
/// or texture.
#[derive(Debug)]
pub struct RayQueryTracer {
    scene: Arc<Scene>,
    selection: Selection,
    structures: Structures,
    binding: TracerBinding,
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

    fn shader_flags(&self) -> &[&'static str] {
        self.binding.shader_flags()
    }

    fn bind_group_layout(&self) -> &wgpu::BindGroupLayout {
        self.binding.layout()
    }

    fn bind_group(&self) -> &wgpu::BindGroup {
        self.binding.group()
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
        let geometry = Geometry::new(&self.scene, &self.selection, transforms)?;
        let structures = Structures::of_triangles(context, &geometry, transforms)?;
        let primitives = geometry.primitive_table();
        let tables = [(PRIMITIVES, bytemuck::cast_slice(&primitives))];
        self.binding
            .replace(context, Some(structures.top()), &tables)?;
        self.structures = structures;
        Ok(())
    }

    fn bytes(&self) -> u64 {
        self.binding.bytes()
    }
}

const PRIMITIVES: &str = "the triangles' order";

impl RayQueryTracer {
    fn build_untested(
        context: &Context,
        scene: &Arc<Scene>,
        selection: &Selection,
    ) -> Result<Self> {
        let transforms = scene.transforms();
        let geometry = Geometry::new(scene, selection, &transforms)?;
        let structures = Structures::of_triangles(context, &geometry, &transforms)?;
        let primitives = geometry.primitive_table();
        let tables = [(PRIMITIVES, bytemuck::cast_slice(&primitives))];
        Ok(Self {
            binding: TracerBinding::new(context, "ray query", Some(structures.top()), &tables)?,
            scene: scene.clone(),
            selection: *selection,
            structures,
        })
    }
}
