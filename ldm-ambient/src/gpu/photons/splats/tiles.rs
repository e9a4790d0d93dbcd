//! Stage 9 by tiles: splats are listed for the bins of the picture that they may reach, in their order, and the pixels of each tile
//! add what its bin lists.

use bytemuck::{Pod, Zeroable};
use isophote_scene::gpu::{ComputePass, Context, Dispatch, Timer};
use wgpu::{BindGroup, BindingResource, Buffer};

use crate::{
    Result,
    gpu::{grid, linker},
};

/// Pixels of a tile's side, `TILE` of photons/splat.wesl.
const TILE: u32 = 16;
/// Bins of a picture at most, `BINS` of photons/bin.wesl.
const BINS: u32 = 256;
/// Splats of a block, `BLOCK` of photons/bin.wesl.
const BLOCK: u64 = 256;
/// Values that one workgroup sums up, `BLOCK` of scan.wesl.
const SUMMED: u64 = 2048;
/// Bins of a splat on the average, for which there is room at first.
const ENTRIES: u64 = 2;
/// Passes that it takes.
pub(super) const PASSES: usize = 6;

/// The part of `Splatting` of photons/splats.wesl that tells of the lists of bins.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Lists {
    bin: u32,
    bins: [u32; 2],
    blocks: u32,
    capacity: u32,
}

#[derive(Debug)]
pub(super) struct Tiles {
    size: [u32; 2],
    /// Pixels of a bin's side.
    bin: u32,
    /// `count`, `sum_blocks`, `sum_totals`, `add_totals`, `list`, `splat`.
    passes: [ComputePass; PASSES],
    /// W/m².
    pub(super) light: Buffer,
    memory: Memory,
}

#[derive(Debug)]
struct Memory {
    firsts: Buffer,
    totals: Buffer,
    listed: Buffer,
    blocks: u32,
    capacity: u32,
}

impl Tiles {
    pub(super) fn new(context: &Context, size: [u32; 2]) -> Result<Self> {
        let bins = linker().link("ldm_ambient::photons::bin")?;
        let scan = linker().link("ldm_ambient::scan")?;
        let splat = linker().link("ldm_ambient::photons::splat")?;
        let sum = |entry_point| scan.compute_pass(context, entry_point, &[], &[]);
        let mut bin = TILE;
        while size[0].div_ceil(bin) * size[1].div_ceil(bin) > BINS {
            bin *= 2;
        }
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        Ok(Self {
            size,
            bin,
            passes: [
                bins.compute_pass(context, "count", &[], &[0])?,
                sum("sum_blocks")?,
                sum("sum_totals")?,
                sum("add_totals")?,
                bins.compute_pass(context, "list", &[], &[0])?,
                splat.compute_pass(context, "splat", &[], &[0])?,
            ],
            light: context.storage("light of photons", 16 * pixels)?,
            memory: Memory::new(context, 1, 1, 1)?,
        })
    }

    fn bins(&self) -> [u32; 2] {
        self.size.map(|side| side.div_ceil(self.bin))
    }

    pub(super) fn lists(&self) -> Lists {
        Lists {
            bin: self.bin,
            bins: self.bins(),
            blocks: self.memory.blocks,
            capacity: self.memory.capacity,
        }
    }

    /// Makes room for so many splats.
    pub(super) fn reserve(&mut self, context: &Context, slots: u64) -> Result<()> {
        let [columns, rows] = self.bins();
        let capacity = (ENTRIES * slots).max(u64::from(self.memory.capacity));
        self.memory = Memory::new(context, slots, u64::from(columns * rows), capacity)?;
        Ok(())
    }

    /// Makes room for so many entries of lists; whether there was not.
    pub(super) fn make_room(&mut self, context: &Context, needed: u32) -> Result<bool> {
        if needed <= self.memory.capacity {
            return Ok(false);
        }
        // A little more, so that what moves a little still has room.
        self.memory.capacity = needed.saturating_add(needed / 4);
        let bytes = 4 * u64::from(self.memory.capacity);
        self.memory.listed = context.storage("splats of bins", bytes)?;
        Ok(true)
    }

    /// What its passes bind beside what all of splatting does.
    pub(super) fn bind(
        &self,
        context: &Context,
        all: &[(u32, BindingResource<'_>)],
    ) -> Result<Vec<BindGroup>> {
        let Memory {
            firsts,
            totals,
            listed,
            ..
        } = &self.memory;
        let own = [(9, firsts), (10, listed), (11, &self.light)];
        let own = own.map(|(binding, buffer)| (binding, buffer.as_entire_binding()));
        let lists = [all, &own[..]].concat();
        let sums = [(1, firsts), (2, totals)];
        let sums = sums.map(|(binding, buffer)| (binding, buffer.as_entire_binding()));
        let [count, blocks, of_totals, add, list, splat] = &self.passes;
        Ok(vec![
            count.bind(context, &lists)?,
            blocks.bind(context, &sums)?,
            of_totals.bind(context, &sums)?,
            add.bind(context, &sums)?,
            list.bind(context, &lists)?,
            splat.bind(context, &lists)?,
        ])
    }

    /// Records that so many splats are added, of the maps that a uniform at an offset tells of.
    pub(super) fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        groups: &[BindGroup],
        slots: u32,
        offset: u32,
        mut timer: Option<&mut Timer>,
    ) {
        encoder.clear_buffer(&self.memory.firsts, 0, None);
        let told = Some(offset);
        let blocks = grid(u64::from(slots).div_ceil(BLOCK));
        let sums = grid((self.memory.firsts.size() / 4).div_ceil(SUMMED));
        let [columns, rows] = self.size.map(|side| side.div_ceil(TILE));
        let steps = [
            ("bins", told, blocks),
            ("bins", None, sums),
            ("bins", None, [1; 3]),
            ("bins", None, sums),
            ("bins", told, blocks),
            ("splat", told, [columns, rows, 1]),
        ];
        for ((pass, group), (name, offset, workgroups)) in self.passes.iter().zip(groups).zip(steps)
        {
            let dispatch = [Dispatch { offset, workgroups }];
            pass.record(encoder, name, timer.as_deref_mut(), &[group], &dispatch);
        }
    }
}

impl Memory {
    fn new(context: &Context, slots: u64, bins: u64, capacity: u64) -> Result<Self> {
        let blocks = slots.div_ceil(BLOCK);
        let firsts = bins * blocks + 1;
        Ok(Self {
            firsts: context.storage("the first splats of bins", 4 * firsts)?,
            totals: context.storage("sums of blocks", 4 * firsts.div_ceil(SUMMED))?,
            listed: context.storage("splats of bins", 4 * capacity)?,
            blocks: blocks as u32,
            capacity: capacity.min(u64::from(u32::MAX)) as u32,
        })
    }
}
