//! What of the maps nobody asks for: in which cells of a grid there are points, and how far those look. Twin of `cpu/reach.rs`.

use bytemuck::{Pod, Zeroable};
use glam::{UVec3, Vec3};
use isophote_scene::{
    Aabb,
    gpu::{ComputePass, Context, Dispatch, Timer, UniformArray},
};
use wgpu::{BindGroup, BindingResource, Buffer, BufferUsages};

use super::{grid, linker, maps::Batch};
use crate::{
    Result,
    cpu::occlusion::{CELL, LEAST_CELL},
};

/// Cells of the grid, at most.
const MOST_CELLS: u32 = 1 << 18;

/// `Cells` of reach.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Cells {
    low: Vec3,
    side: f32,
    counts: UVec3,
    points: u32,
}

/// Finds the depths within reach; it keeps its pipelines and its memory.
#[derive(Debug)]
pub(super) struct Reach {
    mark: ComputePass,
    spread: ComputePass,
    /// A bit for each cell.
    marks: Buffer,
    /// Two words for each tile of the maps of a batch.
    pub(super) ranges: Buffer,
}

/// The reach of some points.
pub(super) struct Near<'a> {
    reach: &'a Reach,
    cells: Cells,
    mark: BindGroup,
    spread: BindGroup,
}

impl Reach {
    /// For so many tiles of all maps of a batch.
    pub(super) fn new(context: &Context, tiles: u64) -> Result<Self> {
        let shader = linker().link("ldm_ambient::reach")?;
        Ok(Self {
            mark: shader.compute_pass(context, "mark", &[], &[])?,
            spread: shader.compute_pass(context, "spread", &[], &[0])?,
            marks: context.storage("cells with points", u64::from(MOST_CELLS) / 8)?,
            ranges: context.storage("depths within reach", 8 * tiles)?,
        })
    }

    /// Bytes on the device.
    pub(super) fn bytes(&self) -> u64 {
        self.marks.size() + self.ranges.size()
    }

    /// Of so many points, all of them in a box, that look as far as `d_max` in a scene of a size, metres.
    pub(super) fn of(
        &self,
        context: &Context,
        batches: &UniformArray<Batch>,
        (points, count): (&Buffer, u32),
        bounds: &Aabb,
        [d_max, size]: [f32; 2],
    ) -> Result<Near<'_>> {
        let extent = bounds.max - bounds.min;
        let mut side = (CELL * d_max).max(LEAST_CELL * size).max(f32::MIN_POSITIVE);
        let counts = |side: f32| {
            (extent / side)
                .floor()
                .as_uvec3()
                .saturating_add(UVec3::ONE)
        };
        let product = |counts: UVec3| counts.as_u64vec3().element_product();
        while product(counts(side)) > u64::from(MOST_CELLS) {
            side *= 1.25;
        }
        let cells = Cells {
            low: bounds.min,
            side,
            counts: counts(side),
            points: count,
        };
        let uniform = context.buffer("cells", &[cells], BufferUsages::UNIFORM)?;
        let resources: [(u32, BindingResource<'_>); 5] = [
            (0, batches.binding()),
            (1, uniform.as_entire_binding()),
            (2, points.as_entire_binding()),
            (3, self.marks.as_entire_binding()),
            (4, self.ranges.as_entire_binding()),
        ];
        Ok(Near {
            reach: self,
            cells,
            mark: self.mark.bind(context, &resources)?,
            spread: self.spread.bind(context, &resources)?,
        })
    }
}

impl Near<'_> {
    /// Records which cells there are points in.
    pub(super) fn mark(&self, encoder: &mut wgpu::CommandEncoder, timer: Option<&mut Timer>) {
        encoder.clear_buffer(&self.reach.marks, 0, None);
        let dispatch = Dispatch {
            offset: None,
            workgroups: grid(u64::from(self.cells.points).div_ceil(64)),
        };
        let pass = &self.reach.mark;
        pass.record(encoder, "reach", timer, &[&self.mark], &[dispatch]);
    }

    /// Records what is within reach in the maps of a batch, of which there are so many.
    pub(super) fn spread(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (batch, maps): (usize, usize),
        timer: Option<&mut Timer>,
    ) {
        encoder.clear_buffer(&self.reach.ranges, 0, None);
        let words = u64::from(self.cells.counts.element_product().div_ceil(32));
        let dispatch = Dispatch {
            offset: Some(UniformArray::<Batch>::offset(batch as u32)),
            workgroups: grid((words * maps as u64).div_ceil(64)),
        };
        let pass = &self.reach.spread;
        pass.record(encoder, "reach", timer, &[&self.spread], &[dispatch]);
    }
}
