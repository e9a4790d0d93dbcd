//! The splats of a batch of maps: made, listed for the bins of the picture, and added by its tiles.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use isophote_scene::{
    Pinhole,
    gpu::{ComputePass, Context, Dispatch, Timer, UniformArray},
};
use wgpu::{BindGroup, BindingResource, Buffer, BufferUsages};

use super::super::{grid, linker, maps::Batch};
use crate::{PhotonParams, Result};

/// Pixels of a tile's side, `TILE` of photons/splat.wesl.
const TILE: u32 = 16;
/// Bins of a picture at most, `BINS` of photons/bin.wesl.
const BINS: u32 = 256;
/// Splats of a block, `BLOCK` of photons/bin.wesl.
const BLOCK: u64 = 256;
/// Values that one workgroup sums up, `BLOCK` of scan.wesl.
const SUMMED: u64 = 2048;
/// Photons that are split together.
const MANY: u32 = 1 << 15;
/// Bytes of a splat.
const SPLAT: u64 = 32;
/// Bins of a splat on the average, for which there is room at first.
const ENTRIES: u64 = 2;

/// `Splatting` of photons/splats.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Splatting {
    right: Vec3,
    scale: f32,
    up: Vec3,
    splat_size: f32,
    forward: Vec3,
    flatness: f32,
    eye: Vec3,
    first: u32,
    size: [u32; 2],
    count: u32,
    bin: u32,
    bins: [u32; 2],
    blocks: u32,
    capacity: u32,
}

/// What splats are made of.
pub(super) struct Resources<'a> {
    pub(super) batches: BindingResource<'a>,
    pub(super) tables: [(u32, BindingResource<'a>); 2],
    pub(super) points: &'a Buffer,
    pub(super) photons: &'a Buffer,
    pub(super) screen: &'a Buffer,
}

/// Makes and adds splats; it keeps its pipelines and its memory.
#[derive(Debug)]
pub(super) struct Splats {
    size: [u32; 2],
    /// Pixels of a bin's side.
    bin: u32,
    maps: usize,
    split: ComputePass,
    count: ComputePass,
    /// `sum_blocks`, `sum_totals`, `add_totals`.
    scan: [ComputePass; 3],
    list: ComputePass,
    splat: ComputePass,
    /// W/m².
    pub(super) light: Buffer,
    /// Most layers and entries that were needed, and whether a layer was lost.
    status: Buffer,
    photons: u32,
    memory: Memory,
}

#[derive(Debug)]
struct Memory {
    splats: Buffer,
    firsts: Buffer,
    totals: Buffer,
    listed: Buffer,
    blocks: u32,
    capacity: u32,
}

/// What is bound for some photons.
pub(super) struct Groups {
    photons: u32,
    split: BindGroup,
    count: BindGroup,
    scan: [BindGroup; 3],
    list: BindGroup,
    splat: BindGroup,
}

impl Splats {
    pub(super) fn new(context: &Context, size: [u32; 2], maps: usize) -> Result<Self> {
        let pass = |name, entry_point| -> Result<ComputePass> {
            Ok(linker()
                .link(name)?
                .compute_pass(context, entry_point, &[], &[0])?)
        };
        let scan = linker().link("ldm_ambient::scan")?;
        let sum = |entry_point| scan.compute_pass(context, entry_point, &[], &[]);
        let mut bin = TILE;
        while size[0].div_ceil(bin) * size[1].div_ceil(bin) > BINS {
            bin *= 2;
        }
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        Ok(Self {
            size,
            bin,
            maps,
            split: pass("ldm_ambient::photons::split", "split")?,
            count: pass("ldm_ambient::photons::bin", "count")?,
            scan: [sum("sum_blocks")?, sum("sum_totals")?, sum("add_totals")?],
            list: pass("ldm_ambient::photons::bin", "list")?,
            splat: pass("ldm_ambient::photons::splat", "splat")?,
            light: context.storage("light of photons", 16 * pixels)?,
            status: context.storage("status", 12)?,
            photons: 0,
            memory: Memory::new(context, 1, 1, 1)?,
        })
    }

    fn bins(&self) -> [u32; 2] {
        self.size.map(|side| side.div_ceil(self.bin))
    }

    /// Makes room for the splats of so many photons.
    pub(super) fn reserve(&mut self, context: &Context, photons: u32) -> Result<()> {
        self.photons = photons;
        let slots = u64::from(photons.min(MANY)) * self.maps as u64;
        let [columns, rows] = self.bins();
        let capacity = (ENTRIES * slots).max(u64::from(self.memory.capacity));
        self.memory = Memory::new(context, slots, u64::from(columns * rows), capacity)?;
        Ok(())
    }

    /// Makes room for so many entries; whether there was not.
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

    pub(super) fn status(&self, context: &Context) -> Result<[u32; 3]> {
        let status: Vec<u32> = context.read("status", &self.status, 3)?;
        Ok([status[0], status[1], status[2]])
    }

    /// Records that there is no light yet.
    pub(super) fn begin(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.clear_buffer(&self.light, 0, None);
        encoder.clear_buffer(&self.status, 0, None);
    }

    /// What is bound for as many photons as are split together, as often as it takes.
    pub(super) fn bind(
        &self,
        context: &Context,
        params: &PhotonParams,
        (eye, origin): (Pinhole, Vec3),
        resources: Resources<'_>,
    ) -> Result<Vec<Groups>> {
        let firsts = (0..self.photons).step_by(MANY as usize);
        let group = |first: u32| {
            let splatting = Splatting {
                right: eye.right,
                scale: 0.5 * self.size[1] as f32 / (0.5 * eye.yfov).tan(),
                up: eye.up,
                splat_size: params.splat_size,
                forward: eye.forward,
                flatness: params.flatness,
                eye: eye.eye - origin,
                first,
                size: self.size,
                count: (self.photons - first).min(MANY),
                bin: self.bin,
                bins: self.bins(),
                blocks: self.memory.blocks,
                capacity: self.memory.capacity,
            };
            self.group(context, splatting, &resources)
        };
        firsts.map(group).collect()
    }

    fn group(
        &self,
        context: &Context,
        splatting: Splatting,
        resources: &Resources<'_>,
    ) -> Result<Groups> {
        let Memory {
            splats,
            firsts,
            totals,
            listed,
            ..
        } = &self.memory;
        let uniform = context.buffer("splatting", &[splatting], BufferUsages::UNIFORM)?;
        let bind = |pass: &ComputePass, own: &[(u32, &Buffer)]| {
            let [pixels, layers] = resources.tables.clone();
            let mut all = vec![
                (0, resources.batches.clone()),
                pixels,
                layers,
                (3, uniform.as_entire_binding()),
                (4, resources.points.as_entire_binding()),
                (5, resources.photons.as_entire_binding()),
            ];
            let own = own
                .iter()
                .map(|(binding, buffer)| (*binding, buffer.as_entire_binding()));
            all.extend(own);
            pass.bind(context, &all)
        };
        let (screen, status, light) = (resources.screen, &self.status, &self.light);
        let sums = [
            (1, firsts.as_entire_binding()),
            (2, totals.as_entire_binding()),
        ];
        let lists = [(6, splats), (7, firsts), (8, listed), (9, status)];
        let [a, b, c] = &self.scan;
        Ok(Groups {
            photons: splatting.count,
            split: bind(&self.split, &[(6, screen), (7, splats), (8, status)])?,
            count: bind(&self.count, &lists)?,
            scan: [
                a.bind(context, &sums)?,
                b.bind(context, &sums)?,
                c.bind(context, &sums)?,
            ],
            list: bind(&self.list, &lists)?,
            splat: bind(
                &self.splat,
                &[
                    (6, splats),
                    (7, firsts),
                    (8, listed),
                    (9, screen),
                    (10, light),
                ],
            )?,
        })
    }

    /// Records that the splats of a batch of so many maps are made and added.
    pub(super) fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        groups: &[Groups],
        batch: usize,
        maps: usize,
        mut timer: Option<&mut Timer>,
    ) {
        let offset = Some(UniformArray::<Batch>::offset(batch as u32));
        let told = |workgroups| [Dispatch { offset, workgroups }];
        for group in groups {
            let slots = u64::from(group.photons) * maps as u64;
            let blocks = grid(slots.div_ceil(BLOCK));
            self.split.record(
                encoder,
                "split",
                timer.as_deref_mut(),
                &[&group.split],
                &told(grid(slots.div_ceil(64))),
            );
            encoder.clear_buffer(&self.memory.firsts, 0, None);
            self.count.record(
                encoder,
                "bins",
                timer.as_deref_mut(),
                &[&group.count],
                &told(blocks),
            );
            let all = grid((self.memory.firsts.size() / 4).div_ceil(SUMMED));
            for ((pass, bound), workgroups) in
                self.scan.iter().zip(&group.scan).zip([all, [1; 3], all])
            {
                let dispatch = [Dispatch {
                    offset: None,
                    workgroups,
                }];
                pass.record(encoder, "bins", timer.as_deref_mut(), &[bound], &dispatch);
            }
            self.list.record(
                encoder,
                "bins",
                timer.as_deref_mut(),
                &[&group.list],
                &told(blocks),
            );
            let [columns, rows] = self.size.map(|side| side.div_ceil(TILE));
            self.splat.record(
                encoder,
                "splat",
                timer.as_deref_mut(),
                &[&group.splat],
                &told([columns, rows, 1]),
            );
        }
    }
}

impl Memory {
    fn new(context: &Context, slots: u64, bins: u64, capacity: u64) -> Result<Self> {
        let blocks = slots.div_ceil(BLOCK);
        let firsts = bins * blocks + 1;
        Ok(Self {
            splats: context.storage("splats", SPLAT * slots)?,
            firsts: context.storage("the first splats of bins", 4 * firsts)?,
            totals: context.storage("sums of blocks", 4 * firsts.div_ceil(SUMMED))?,
            listed: context.storage("splats of bins", 4 * capacity)?,
            blocks: blocks as u32,
            capacity: capacity.min(u64::from(u32::MAX)) as u32,
        })
    }
}
