//! Stage 1, what is drawn into every map: the corners of the selected triangles, placed by the device where instances are.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use isophote_scene::{
    Aabb, Scene, Selection, WorldTriangle,
    gpu::{ComputePass, Context, Dispatch, GpuScene},
    world_triangles,
};
use wgpu::BufferUsages;

use super::{Filler, grid, linker, maps::BATCH};
use crate::{Result, cpu::view::origin_in};

/// Bytes of a triangle's corners.
const TRIANGLE: u64 = 48;
/// Bytes of its numbers in the maps of a batch.
const NUMBERS: u64 = 4 * BATCH as u64;

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
    /// Of each map of a batch the numbers of the triangles that are drawn into it, and how it is drawn: `cull.wesl` writes them.
    pub(super) drawn: wgpu::Buffer,
    pub(super) draws: wgpu::Buffer,
    /// How maps are drawn that have no triangle.
    nothing: wgpu::Buffer,
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
            / TRIANGLE.max(NUMBERS);
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
            let drawn = context.storage("triangles of maps", NUMBERS * ids.len() as u64)?;
            let first = |map: usize| 3 * (map * ids.len()) as u32;
            let nothing: Vec<[u32; 4]> = (0..BATCH).map(|map| [0, 1, first(map), 0]).collect();
            let usage = BufferUsages::STORAGE | BufferUsages::INDIRECT;
            let draws = context.buffer("draws of maps", &nothing, usage)?;
            let nothing = context.buffer("no draws", &nothing, BufferUsages::COPY_SRC)?;
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
                drawn,
                draws,
                nothing,
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

impl Chunk {
    /// Records that no triangle is drawn.
    pub(super) fn clear(&self, encoder: &mut wgpu::CommandEncoder) {
        let size = self.draws.size();
        encoder.copy_buffer_to_buffer(&self.nothing, 0, &self.draws, 0, size);
    }

    /// Bytes on the device.
    pub(super) fn bytes(&self) -> u64 {
        self.corners.size() + self.drawn.size()
    }
}
