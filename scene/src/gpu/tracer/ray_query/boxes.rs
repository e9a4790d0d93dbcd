//! Imperfect visibility: the boxes around triangles instead of the triangles.

use std::sync::Arc;

use glam::{Affine3A, Vec4};

use super::{
    check_ray_query,
    geometry::MortonCodes,
    structures::{self, Structures},
};
use crate::{
    Aabb, Answers, Error, Result, Scene, Selection,
    gpu::{BuildGpuTracer, Context, GpuTracer, upload::entries},
    trace::brute_force::{check_transforms, world_triangles},
};

/// Finds the nearest of the boxes (along the world's axes) around the triangles, by ray query, where the ray enters
/// it. A box that contains the start or the end of the ray does not count, nor does alpha.
///
/// Binds one storage buffer and an acceleration structure.
#[derive(Debug)]
pub struct RayQueryBoxTracer {
    scene: Arc<Scene>,
    selection: Selection,
    layout: wgpu::BindGroupLayout,
    bind_group: wgpu::BindGroup,
    bytes: u64,
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

    fn bind_group_layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    fn bind_group(&self) -> &wgpu::BindGroup {
        &self.bind_group
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
        let layout = structures::layout(context)?;
        let (bind_group, bytes) = upload(context, &layout, scene, selection, &scene.transforms())?;
        Ok(Self {
            scene: scene.clone(),
            selection: *selection,
            layout,
            bind_group,
            bytes,
        })
    }

    fn update(&mut self, context: &Context, transforms: &[Affine3A]) -> Result<()> {
        check_transforms(&self.scene, transforms)?;
        (self.bind_group, self.bytes) = upload(
            context,
            &self.layout,
            &self.scene,
            &self.selection,
            transforms,
        )?;
        Ok(())
    }

    fn bytes(&self) -> u64 {
        self.bytes
    }
}

fn upload(
    context: &Context,
    layout: &wgpu::BindGroupLayout,
    scene: &Scene,
    selection: &Selection,
    transforms: &[Affine3A],
) -> Result<(wgpu::BindGroup, u64)> {
    let mut triangles = world_triangles(scene, transforms, selection);
    if triangles.is_empty() {
        return Err(Error::NoGeometry {
            reason: "no triangle is selected".into(),
        });
    }
    context.check_storage_size("the triangles' boxes", 32 * triangles.len() as u64)?;
    let bounds = Aabb::around(triangles.iter().flat_map(|triangle| triangle.corners));
    let codes = MortonCodes::within(&bounds);
    triangles.sort_by_cached_key(|triangle| (codes.of(triangle.corners), triangle.surface));
    let boxes: Vec<Aabb> = triangles
        .iter()
        .map(|triangle| Aabb::around(triangle.corners))
        .collect();
    let corners: Vec<[Vec4; 2]> = boxes
        .iter()
        .map(|one| [one.min.extend(0.0), one.max.extend(0.0)])
        .collect();
    let corners = context.buffer("boxes", &corners, wgpu::BufferUsages::STORAGE)?;
    let structures = Structures::of_boxes(context, &boxes)?;
    let bind_group = context.check("ray query over boxes", |device| {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("ray query over boxes"),
            layout,
            entries: &entries([structures.binding(), corners.as_entire_binding()]),
        })
    })?;
    Ok((bind_group, corners.size()))
}
