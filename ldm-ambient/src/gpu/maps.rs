//! Stages 2 to 4, the maps of several directions at a time, built by the device's rasteriser.
//!
//! - Linearised: layers are drawn and counted by pixel, the counts summed up (`scan.wesl`), the same layers drawn again and
//!   each put where its pixel's next one goes, and those of each pixel sorted (`sort.wesl`).
//! - Linked lists: layers are drawn once, and each is put at its place in its pixel's list (§3).
//! - Where the first and the last layer are enough, nothing else is kept.
//!
//! Only the order of the depths of a pixel is kept, so that nothing depends on the order in which a device draws.
//!
//! Memory cannot be allocated by the device. There is room for some layers, and how many were needed is noted; where there
//! were more, the picture is not right, and is made again with more room.

mod pipelines;
mod series;

use bytemuck::{Pod, Zeroable};
use isophote_scene::gpu::{Context, GpuScene};
use wgpu::{BindingResource, Buffer};

use self::pipelines::Pipelines;
pub(super) use self::series::Series;
use super::reach::Reach;
use crate::{Result, cpu::view::View};

/// How all layers of a pixel are found on a GPU: the same layers in the same order.
///
/// Lists are drawn once and sums twice, but lists are slower to walk along. On a software adapter with two threads (llvmpipe,
/// `benches/gpu.rs`), a map of 200² pixels takes with lists and with sums: 22 and 28 ms in `builtin:office` with a `d_max` of 1.5 m
/// for 400 × 300 points, of which asking are 4.7 and 2.5 ms; 25 and 47 ms in Sponza (66,000 triangles) with 12 m for 200 × 150
/// points; 49 and 92 ms in a hairball (245,000 triangles) with 1 m for 100² points, and 5 and 8 ms there with maps of 50². Only with
/// millions of points, or with few triangles, are sums faster.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BuildMethod {
    /// The paper's: linked lists that are sorted while they are built. Where a pixel has more layers than lists are walked along,
    /// a thousand, all are [linearised](Self::Linearised) from then on; light that is [gathered](super::gather) always is.
    #[default]
    LinkedLists,
    /// Counted, summed up, written and sorted.
    Linearised,
}

/// What is kept of a pixel's layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kept {
    /// The first and the last.
    Extents,
    /// All.
    Layers(BuildMethod),
}

/// Maps that are there at the same time, `MAPS` of batch.wesl.
pub(super) const BATCH: usize = 16;
/// And at most so many pixels, unless it is one map.
const MOST_PIXELS: u32 = 1 << 20;
/// What a pixel takes at most in a buffer.
const PIXEL_BYTES: u64 = 8;
/// Layers of a pixel on the average, for which there is room at first.
const LAYERS: u64 = 8;
/// Values that one workgroup sums up, `BLOCK` of scan.wesl.
const BLOCK: u64 = 2048;
/// Nothing is drawn into it.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

/// `MapView` of batch.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct MapView {
    right: [f32; 3],
    pixel: f32,
    up: [f32; 3],
    columns: u32,
    forward: [f32; 3],
    rows: u32,
    low: [f32; 2],
    padding: [u32; 2],
}

impl MapView {
    fn new(view: &View) -> Self {
        Self {
            right: view.right.to_array(),
            pixel: view.pixel,
            up: view.up.to_array(),
            columns: view.columns as u32,
            forward: view.forward.to_array(),
            rows: view.rows as u32,
            low: view.low.to_array(),
            padding: [0; 2],
        }
    }
}

/// `Batch` of batch.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Batch {
    views: [MapView; BATCH],
    count: u32,
    stride: u32,
    capacity: u32,
    points: u32,
    tolerance: f32,
    d_max: f32,
    tiles: u32,
    first: u32,
}

/// What maps are asked, beside where they are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    pub(super) points: u32,
    pub(super) tolerance: f32,
    pub(super) d_max: f32,
}

/// Builds maps; it keeps its pipelines and its memory.
#[derive(Debug)]
pub(super) struct Builder {
    pub(super) kept: Kept,
    /// Pixels from one map to the next.
    stride: u32,
    /// Maps of a batch.
    most: usize,
    capacity: u32,
    /// Tiles from one map to the next.
    tiles: u32,
    /// Where only what is within reach of points is drawn.
    reach: Option<Reach>,
    pipelines: Pipelines,
    memory: Memory,
}

#[derive(Debug)]
struct Memory {
    /// Of each pixel how many layers it has, then where its next one goes; its first node; or its ends.
    pixels: Buffer,
    /// Where the layers of each pixel begin, and their end.
    firsts: Buffer,
    /// Sums of blocks of those.
    totals: Buffer,
    layers: Buffer,
}

impl Builder {
    pub(super) fn new(
        context: &Context,
        gpu_scene: &GpuScene,
        kept: Kept,
        resolution: u32,
    ) -> Result<Self> {
        let stride = resolution * resolution;
        let limits = context.device().limits();
        let limit = limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size);
        let bound = limit / (PIXEL_BYTES * u64::from(stride));
        let most = u64::from(MOST_PIXELS / stride).min(bound);
        let most = most.clamp(1, BATCH as u64) as usize;
        let pixels = u64::from(stride) * most as u64;
        let fits = (limit / layer_bytes(kept)).saturating_sub(1);
        let capacity = (LAYERS * pixels).min(fits).min(u64::from(u32::MAX / 2)) as u32;
        Ok(Self {
            kept,
            stride,
            most,
            capacity,
            // However long the map is: tiles are of 8 × 8 pixels.
            tiles: stride / 8 + 1,
            reach: None,
            pipelines: Pipelines::new(context, gpu_scene, kept, false)?,
            memory: Memory::new(context, kept, pixels, capacity)?,
        })
    }

    /// Layers that points ask for who look no farther than they were told.
    pub(super) fn near(
        context: &Context,
        gpu_scene: &GpuScene,
        method: BuildMethod,
        resolution: u32,
    ) -> Result<Self> {
        let kept = Kept::Layers(method);
        let all = Self::new(context, gpu_scene, kept, resolution)?;
        let tiles = u64::from(all.tiles) * all.most as u64;
        Ok(Self {
            reach: Some(Reach::new(context, tiles)?),
            pipelines: Pipelines::new(context, gpu_scene, kept, true)?,
            ..all
        })
    }

    /// What finds out what is within reach, where that is of interest.
    pub(super) fn reach(&self) -> Option<&Reach> {
        self.reach.as_ref()
    }

    /// Makes room for so many layers; whether there was not.
    pub(super) fn make_room(&mut self, context: &Context, needed: u32) -> Result<bool> {
        if needed <= self.capacity {
            return Ok(false);
        }
        let pixels = u64::from(self.stride) * self.most as u64;
        // A little more, so that what moves a little still has room.
        let capacity = needed.saturating_add(needed / 4).min(u32::MAX / 2);
        self.memory = Memory::new(context, self.kept, pixels, capacity)?;
        self.capacity = capacity;
        Ok(true)
    }

    /// Maps that are there at the same time, at most.
    pub(super) fn maps_at_once(&self) -> usize {
        self.most
    }

    /// Bytes on the device.
    pub(super) fn bytes(&self) -> u64 {
        let Memory {
            pixels,
            firsts,
            totals,
            layers,
        } = &self.memory;
        let sizes = [pixels, firsts, totals, layers].map(Buffer::size);
        sizes.iter().sum::<u64>() + self.reach.as_ref().map_or(0, Reach::bytes)
    }

    /// What maps are read from: bindings 1 and 2 of layers.wesl.
    pub(super) fn tables(&self) -> [(u32, BindingResource<'_>); 2] {
        let pixels = match self.kept {
            Kept::Layers(BuildMethod::Linearised) => &self.memory.firsts,
            _ => &self.memory.pixels,
        };
        [
            (1, pixels.as_entire_binding()),
            (2, self.memory.layers.as_entire_binding()),
        ]
    }
}

/// What a layer takes.
fn layer_bytes(kept: Kept) -> u64 {
    match kept {
        Kept::Layers(BuildMethod::LinkedLists) => 8,
        _ => 4,
    }
}

impl Memory {
    fn new(context: &Context, kept: Kept, pixels: u64, capacity: u32) -> Result<Self> {
        let capacity = u64::from(capacity);
        let [words, firsts, layers] = match kept {
            Kept::Extents => [2 * pixels, 0, 0],
            // Node 0 is none.
            Kept::Layers(BuildMethod::LinkedLists) => [pixels, 0, 2 * (capacity + 1)],
            Kept::Layers(BuildMethod::Linearised) => [pixels + 1, pixels + 1, capacity],
        };
        Ok(Self {
            pixels: context.storage("the pixels of the maps", 4 * words)?,
            firsts: context.storage("the first layers of pixels", 4 * firsts)?,
            totals: context.storage("sums of blocks", 4 * firsts.div_ceil(BLOCK))?,
            layers: context.storage("the layers of the maps", 4 * layers)?,
        })
    }
}
