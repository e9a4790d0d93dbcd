//! Imperfect visibility: the boxes around triangles instead of the triangles.

use std::sync::Arc;

use glam::{Affine3A, Vec4};

use super::{check_ray_query, geometry::MortonCodes, structures::Structures};
use crate::{
    Aabb, Answers, Error, Result, Scene, Selection,
    gpu::{BuildGpuTracer, Context, GpuTracer, tracer::binding::TracerBinding},
    trace::brute_force::{check_transforms, world_triangles},
};

/// Finds the nearest of the boxes (along the world's axes) around the triangles, by ray query, where the ray enters
/// it. A box that contains the start or the end of the ray does not count, nor does alpha.
///
/// Binds an acceleration structure and one storage buffer or texture.
#[derive(Debug)]
pub struct RayQueryBoxTracer {
    scene: Arc<Scene>,
    selection: Selection,
    binding: TracerBinding,
}

impl GpuTracer for RayQueryBoxTracer {
    fn name(&self) -> &'static str {
        "boxes"
    }

    fn answers(&self) -> Answers {
        Answers::Distance
    }

    fn required_features(&self) -> wgpu::Features {
        wgpu::Features::EXPERIMENTAL_RAY_QUERY
    }

    fn module(&self) -> &'static str {
        "scene::tracer::ray_query_boxes"
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

impl BuildGpuTracer for RayQueryBoxTracer {
    type Options = ();

    fn build(
        context: &Context,
        scene: &Arc<Scene>,
        selection: &Selection,
        (): &(),
    ) -> Result<Self> {
        check_ray_query(context)?;
        let boxes = boxes(scene, selection, &scene.transforms())?;
        let structures = Structures::of_boxes(context, &boxes)?;
        let corners = corners(&boxes);
        let tables = [(CORNERS, bytemuck::cast_slice(&corners))];
        let label = "ray query over boxes";
        Ok(Self {
            binding: TracerBinding::new(context, label, Some(structures.top()), &tables)?,
            scene: scene.clone(),
            selection: *selection,
        })
    }

    fn update(&mut self, context: &Context, transforms: &[Affine3A]) -> Result<()> {
        check_transforms(&self.scene, transforms)?;
        let boxes = boxes(&self.scene, &self.selection, transforms)?;
        let structures = Structures::of_boxes(context, &boxes)?;
        let corners = corners(&boxes);
        let tables = [(CORNERS, bytemuck::cast_slice(&corners))];
        self.binding
            .replace(context, Some(structures.top()), &tables)
    }

    fn bytes(&self) -> u64 {
        self.binding.bytes()
    }
}

const CORNERS: &str = "the triangles' boxes";

/// Around the selected triangles, neighbours together.
fn boxes(scene: &Scene, selection: &Selection, transforms: &[Affine3A]) -> Result<Vec<Aabb>> {
    let mut triangles = world_triangles(scene, transforms, selection);
    if triangles.is_empty() {
        return Err(Error::NoGeometry {
            reason: "no triangle is selected".into(),
        });
    }
    let bounds = Aabb::around(triangles.iter().flat_map(|triangle| triangle.corners));
    let codes = MortonCodes::within(&bounds);
    triangles.sort_by_cached_key(|triangle| (codes.of(triangle.corners), triangle.surface));
    Ok(triangles
        .iter()
        .map(|triangle| Aabb::around(triangle.corners))
        .collect())
}

/// As the shader reads them.
fn corners(boxes: &[Aabb]) -> Vec<[Vec4; 2]> {
    boxes
        .iter()
        .map(|one| [one.min.extend(0.0), one.max.extend(0.0)])
        .collect()
}
