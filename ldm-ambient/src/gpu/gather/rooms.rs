//! How far points can be moved before something stands in the way: the twin of `cpu/room.rs`.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use isophote_scene::gpu::{ComputePass, Context, Dispatch, GpuScene, GpuTracer};
use wgpu::{Buffer, BufferUsages};

use super::super::{Points, grid, linker};
use crate::Result;

/// `Measuring` of gather/rooms.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Measuring {
    origin: Vec3,
    pixel: f32,
}

/// Measures the room of points.
#[derive(Debug)]
pub(super) struct Rooms {
    measure: ComputePass,
}

impl Rooms {
    /// By a tracer.
    pub(super) fn new(
        context: &Context,
        gpu_scene: &GpuScene,
        exact: &dyn GpuTracer,
    ) -> Result<Self> {
        let shader = linker().scene(gpu_scene).tracer(exact);
        let shader = shader.link("ldm_ambient::gather::rooms")?;
        let groups = [exact.bind_group_layout(), gpu_scene.bind_group_layout()];
        Ok(Self {
            measure: shader.compute_pass(context, "measure", &groups, &[])?,
        })
    }

    /// Records that the room of points relative to an origin is noted beside what arrives at them, in maps with pixels of so many metres.
    pub(super) fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        (gpu_scene, exact): (&GpuScene, &dyn GpuTracer),
        (origin, pixel): (Vec3, f32),
        (points, arriving): (&Points, &Buffer),
    ) -> Result<()> {
        let measuring = Measuring { origin, pixel };
        let measuring = context.buffer("rooms", &[measuring], BufferUsages::UNIFORM)?;
        let resources = [
            (0, measuring.as_entire_binding()),
            (1, points.buffer.as_entire_binding()),
            (2, arriving.as_entire_binding()),
        ];
        let group = self.measure.bind(context, &resources)?;
        let groups = [&group, exact.bind_group(), gpu_scene.bind_group()];
        let [width, height] = points.size();
        let dispatch = [Dispatch {
            offset: None,
            workgroups: grid((u64::from(width) * u64::from(height)).div_ceil(64)),
        }];
        self.measure
            .record(encoder, "rooms", None, &groups, &dispatch);
        Ok(())
    }
}
