//! Stage 1, what is drawn into every map: the corners of the selected triangles, placed by the device where instances are.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use isophote_scene::{
    Aabb, Scene, Selection, WorldTriangle,
    gpu::{ComputePass, Context, Dispatch, GpuScene},
    world_triangles,
};
use wgpu::BufferUsages;

use super::{Filler, grid, linker};
use crate::{Result, cpu::view::origin_in};

/// Bytes of a triangle's corners.
const TRIANGLE: u64 = 48;

/// `Placing` of place.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Placing {
    origin: [f32; 3],
    count: u32,
}

/// Triangles in buffers that the device can bind.
#[derive(Debug)]
pub(super) struct Triangles {
    place: ComputePass,
    pub(super) chunks: Vec<Chunk>,
    /// What positions are relative to.
    pub(super) origin: Vec3,
    /// Around all of them when they were listed, relative to the origin.
    pub(super) bounds: Aabb,
}

/// A buffer of triangles: those that stop light everywhere, or those that do not.
#[derive(Debug)]
pub(super) struct Chunk {
    pub(super) masked: bool,
    pub(super) count: u32,
    pub(super) corners: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl Triangles {
    pub(super) fn new(
        context: &Context,
        scene: &Scene,
        gpu_scene: &GpuScene,
        selection: &Selection,
        filler: &Filler,
    ) -> Result<Self> {
        let triangles = world_triangles(scene, &scene.transforms(), selection);
        let bounds = Aabb::around(triangles.iter().flat_map(|triangle| triangle.corners));
        if bounds.is_empty() {
            return Err(isophote_scene::Error::NoGeometry {
                reason: "no triangle is selected".into(),
            }
            .into());
        }
        let origin = origin_in(&bounds);
        let shader = linker().scene(gpu_scene).link("ldm_ambient::place")?;
        let groups = [&filler.layout, gpu_scene.bind_group_layout()];
        let mut table = Self {
            place: shader.compute_pass(context, "place", &groups, &[])?,
            chunks: Vec::new(),
            origin,
            bounds: Aabb {
                min: bounds.min - origin,
                max: bounds.max - origin,
            },
        };
        let (masked, opaque): (Vec<_>, Vec<_>) = triangles
            .iter()
            .partition(|triangle| scene.is_masked(triangle.surface));
        for (triangles, masked) in [(opaque, false), (masked, true)] {
            table.list(context, &triangles, masked)?;
        }
        Ok(table)
    }

    /// Adds triangles, in as many buffers as they need.
    fn list(
        &mut self,
        context: &Context,
        triangles: &[&WorldTriangle],
        masked: bool,
    ) -> Result<()> {
        let limits = context.device().limits();
        let most = limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size)
            / TRIANGLE;
        for triangles in triangles.chunks(most.max(1) as usize) {
            let ids: Vec<[u32; 2]> = triangles
                .iter()
                .map(|triangle| [triangle.surface.instance, triangle.surface.primitive])
                .collect();
            let placing = Placing {
                origin: self.origin.to_array(),
                count: ids.len() as u32,
            };
            let placing = context.buffer("placing", &[placing], BufferUsages::UNIFORM)?;
            let corners = context.storage("corners of triangles", TRIANGLE * ids.len() as u64)?;
            let listed = context.buffer("triangles", &ids, BufferUsages::STORAGE)?;
            let resources = [
                (0, placing.as_entire_binding()),
                (1, listed.as_entire_binding()),
                (2, corners.as_entire_binding()),
            ];
            self.chunks.push(Chunk {
                masked,
                count: ids.len() as u32,
                group: self.place.bind(context, &resources)?,
                corners,
            });
        }
        Ok(())
    }

    /// Records where the corners are now.
    pub(super) fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        gpu_scene: &GpuScene,
        filler: &Filler,
    ) {
        for chunk in &self.chunks {
            let groups = [&chunk.group, &filler.group, gpu_scene.bind_group()];
            let dispatch = Dispatch {
                offset: None,
                workgroups: grid(u64::from(chunk.count.div_ceil(64))),
            };
            self.place
                .record(encoder, "triangles", None, &groups, &[dispatch]);
        }
    }
}
