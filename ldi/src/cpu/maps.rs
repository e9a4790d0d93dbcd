//! The maps as they lie in memory: flat arrays that a GPU can hold too.
//!
//! ```text
//! frames   one per map                      where its pixels and depths lie in the world
//! pixels   one per pixel of all maps, + 1   its first layer: the prefix sum of the layer counts (§3.1); and in which
//!                                           of 32 slabs of depth it has any, so that empty space is passed fast
//! layers   one per layer                    near and far depth, and what it is a part of, in 2 to 8 bytes ([`Packing`])
//! blocks   eight triangles each             corners, and which triangles they are
//! planes   one per triangle                 only for the paper's layers (`Coverage::Center`)
//! ```
//!
//! Depths only say which layers a ray can meet in a pixel. Where it meets them is calculated from the triangles. So depths
//! are rounded outwards to as few bits as the bound on their error allows ([`LdiParams::depth_error`](crate::LdiParams)):
//! coarser ones make rays ask more triangles in vain, and lose none. Pixels lie in tiles of 4 × 4 ([`pixel_index`]), so that a ray that walks in
//! any direction stays in few lines of the cache.

use std::ops::RangeInclusive;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use isophote_scene::SurfaceId;

use crate::directions::axes;

/// Triangles of a block.
pub const LANES: usize = 8;
/// Pixels on the side of a tile.
pub const TILE: u32 = 4;

/// Where a pixel lies among those of its map, whose side is a multiple of [`TILE`].
#[inline(always)]
pub const fn pixel_index(resolution: u32, x: u32, y: u32) -> usize {
    let tile = (y / TILE) * (resolution / TILE) + x / TILE;
    ((tile * TILE + y % TILE) * TILE + x % TILE) as usize
}

/// Where a map's pixels and depths lie: the parallel projection along its direction onto the plane across its axis.
///
/// For the axes a (depth), b and c: x = (b − slope.x · a − low.x) · scale.x in pixels, y likewise with c, and
/// z = (a − low.z) · scale.z in steps of the depth. The paper's maps lie across their direction instead; along the
/// same lines this one needs no rotation, and walls and floors have one depth.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Frame {
    /// The direction's b and c per unit of a.
    pub slope: [f32; 2],
    /// The lowest sheared b and c and the lowest a, metres.
    pub low: [f32; 3],
    /// Pixels, pixels and depth steps per metre.
    pub scale: [f32; 3],
}

impl Frame {
    /// A point's place in the map, in 64 bits so that nothing is lost far from the origin.
    #[inline(always)]
    pub(crate) fn place(&self, depth: usize, point: Vec3) -> DVec3 {
        (self.shear(depth, point) - wide(self.low)) * wide(self.scale)
    }

    /// The larger side of a pixel, metres.
    #[inline(always)]
    pub(crate) fn footprint(&self) -> f32 {
        (1.0 / self.scale[0]).max(1.0 / self.scale[1])
    }

    /// The change of place along a direction.
    #[inline(always)]
    pub(crate) fn turn(&self, depth: usize, direction: Vec3) -> DVec3 {
        self.shear(depth, direction) * wide(self.scale)
    }

    #[inline(always)]
    fn shear(&self, depth: usize, v: Vec3) -> DVec3 {
        let [a, b, c] = axes(depth);
        let z = f64::from(v[a]);
        let x = f64::from(v[b]) - f64::from(self.slope[0]) * z;
        let y = f64::from(v[c]) - f64::from(self.slope[1]) * z;
        DVec3::new(x, y, z)
    }
}

#[inline(always)]
fn wide([x, y, z]: [f32; 3]) -> DVec3 {
    DVec3::new(f64::from(x), f64::from(y), f64::from(z))
}

/// A pixel of a map.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Pixel {
    /// The number of its first layer; its last is before that of the next pixel.
    pub first: u32,
    /// A bit for each 32nd of the map's depth in which it has a layer.
    pub slabs: u32,
}

/// The slabs of a range of depths, as bits.
#[inline(always)]
pub(crate) fn slabs(low: u32, high: u32, depth_steps: u32) -> u32 {
    let per_slab = depth_steps / 32;
    let (low, high) = (low / per_slab, high / per_slab);
    (u32::MAX << low) & (u32::MAX >> (31 - high))
}

/// The corners of some triangles: corner, axis, triangle. Empty lanes are NaN, which no ray hits.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, Zeroable, Pod)]
pub struct Block {
    /// Metres.
    pub corners: [[[f32; LANES]; 3]; 3],
}

impl Block {
    /// One triangle's coordinates by corner and axis.
    #[inline]
    pub(crate) fn triangle(&self, lane: usize) -> impl Fn(usize, usize) -> f32 {
        move |corner, axis| self.corners[corner][axis][lane]
    }

    /// One triangle's corners.
    pub(crate) fn corners(&self, lane: usize) -> [Vec3; 3] {
        [0, 1, 2]
            .map(|corner| Vec3::from_array([0, 1, 2].map(|axis| self.corners[corner][axis][lane])))
    }
}

/// What the triangles of a block are; looked at only when one of them is hit.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct BlockSurfaces {
    /// Index in `Scene::instances`; `u32::MAX` in empty lanes.
    pub instances: [u32; LANES],
    /// Index in `Mesh::triangles`.
    pub primitives: [u32; LANES],
    /// A bit for each triangle that may let rays pass.
    pub masked: u32,
}

impl BlockSurfaces {
    #[inline]
    pub(crate) fn surface(&self, lane: usize) -> SurfaceId {
        SurfaceId {
            instance: self.instances[lane],
            primitive: self.primitives[lane],
        }
    }
}

/// A layer: a range of depths, and what it is a part of. Those of a pixel are in the order of these numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Layer {
    /// The least depth in the pixel, rounded down; steps.
    pub near: u32,
    /// The greatest depth in the pixel, rounded down: it reaches up to the next step.
    pub far: u32,
    /// A block, or with [`Coverage::Center`](crate::Coverage::Center) a triangle of one (block × 8 + lane).
    pub target: u32,
}

/// How a layer's numbers share its bytes: near depth, far depth and target, from the highest bit down, so that words are
/// in the order of layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packing {
    depth_bits: u32,
    bytes: u32,
}

impl Packing {
    /// Bits of a depth: at least those of the 32 slabs, at most those of two bytes.
    pub(crate) const DEPTH_BITS: RangeInclusive<u32> = 5..=16;

    /// As few bytes as hold depths of so many bits and one of so many targets. What is left of the last byte makes the
    /// depths finer.
    pub(crate) fn new(depth_bits: u32, targets: usize) -> Self {
        let target_bits = usize::BITS - targets.saturating_sub(1).leading_zeros();
        let bytes = (2 * depth_bits + target_bits).div_ceil(8).clamp(2, 8);
        Self {
            depth_bits: ((8 * bytes - target_bits) / 2).min(*Self::DEPTH_BITS.end()),
            bytes,
        }
    }

    /// None unless there are 2 to 8 bytes with room for the depths.
    pub(crate) fn from_parts(depth_bits: u32, bytes: u32) -> Option<Self> {
        let fits = Self::DEPTH_BITS.contains(&depth_bits)
            && (2..=8).contains(&bytes)
            && 2 * depth_bits <= 8 * bytes;
        fits.then_some(Self { depth_bits, bytes })
    }

    /// Bits of a depth, 5 to 16.
    pub fn depth_bits(self) -> u32 {
        self.depth_bits
    }

    /// Steps of the depth.
    #[inline(always)]
    pub fn depth_steps(self) -> u32 {
        1 << self.depth_bits
    }

    /// Bytes of a layer, 2 to 8.
    #[inline(always)]
    pub fn bytes(self) -> u32 {
        self.bytes
    }

    /// The lowest bits of near and far depth.
    #[inline(always)]
    pub(crate) fn shifts(self) -> [u32; 2] {
        let all = 8 * self.bytes;
        [all - self.depth_bits, all - 2 * self.depth_bits]
    }

    #[inline(always)]
    pub(crate) fn pack(self, layer: Layer) -> u64 {
        let [near, far] = self.shifts();
        u64::from(layer.near) << near | u64::from(layer.far) << far | u64::from(layer.target)
    }

    #[inline(always)]
    pub(crate) fn unpack(self, word: u64) -> Layer {
        let [near, far] = self.shifts();
        let ones = |bits: u32| (1_u64 << bits) - 1;
        Layer {
            near: (word >> near & ones(self.depth_bits)) as u32,
            far: (word >> far & ones(self.depth_bits)) as u32,
            target: (word & ones(far)) as u32,
        }
    }
}

/// The layers of all pixels, packed; followed by unused bytes, so that kernels may read on.
#[derive(Clone, Debug, PartialEq)]
pub struct Layers {
    packing: Packing,
    bytes: Vec<u8>,
}

/// Unused bytes behind the last layer.
pub(crate) const PADDING: usize = 32;

impl Layers {
    /// Of packed words, one after the other.
    pub(crate) fn pack(packing: Packing, words: impl Iterator<Item = u64>) -> Vec<u8> {
        let size = packing.bytes as usize;
        let mut bytes = Vec::with_capacity(size * words.size_hint().0);
        for word in words {
            bytes.extend_from_slice(&word.to_le_bytes()[..size]);
        }
        bytes
    }

    /// Of what [`pack`](Self::pack) gave, with the padding.
    pub(crate) fn from_bytes(packing: Packing, bytes: Vec<u8>) -> Self {
        Self { packing, bytes }
    }

    /// How they are packed.
    #[inline(always)]
    pub fn packing(&self) -> Packing {
        self.packing
    }

    /// Number of layers.
    pub fn count(&self) -> usize {
        (self.bytes.len() - PADDING) / self.packing.bytes as usize
    }

    /// The bytes held, the padding among them.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The bytes from a layer on.
    #[inline(always)]
    pub(crate) fn since(&self, index: usize) -> &[u8] {
        &self.bytes[index * self.packing.bytes as usize..]
    }

    /// A layer.
    ///
    /// # Panics
    /// If there are not so many.
    #[inline(always)]
    pub fn get(&self, index: usize) -> Layer {
        let word = self.since(index).first_chunk();
        self.packing
            .unpack(word.map_or(0, |word| u64::from_le_bytes(*word)))
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = Layer> {
        (0..self.count()).map(|index| self.get(index))
    }
}

/// The maps of all directions.
#[derive(Clone, Debug)]
pub struct Maps {
    /// Pixels on each side of a map; a multiple of [`TILE`].
    pub resolution: u32,
    /// See the module.
    pub frames: Vec<Frame>,
    /// See the module.
    pub pixels: Vec<Pixel>,
    /// See the module.
    pub layers: Layers,
    /// See the module.
    pub blocks: Vec<Block>,
    /// One for each block.
    pub surfaces: Vec<BlockSurfaces>,
    /// For [`Coverage::Center`](crate::Coverage::Center) the plane of each lane of each block: unit normal n and n · p
    /// of its points; else empty.
    pub planes: Vec<[f32; 4]>,
}

impl Maps {
    /// Pixels of a map.
    pub fn pixels_per_map(&self) -> usize {
        self.resolution as usize * self.resolution as usize
    }

    /// Bytes of the maps and of the triangles they point at.
    pub fn bytes(&self) -> usize {
        self.map_bytes()
            + size_of_val(&self.blocks[..])
            + size_of_val(&self.surfaces[..])
            + size_of_val(&self.planes[..])
    }

    /// Bytes of the maps alone: frames, pixels and layers.
    pub fn map_bytes(&self) -> usize {
        size_of_val(&self.frames[..]) + size_of_val(&self.pixels[..]) + self.layers.bytes.len()
    }

    /// How far layers reach beyond what they are of at either end at most, pixels of the map.
    pub fn depth_error(&self) -> f64 {
        let step = |frame: &Frame| {
            let reach = 1.0 + margin(self.resolution);
            reach / f64::from(frame.scale[2]) / f64::from(frame.footprint())
        };
        self.frames.iter().map(step).fold(0.0, f64::max)
    }
}

/// By how much pixels and depth steps reach into their neighbours, so that a rounded ray finds the triangle in the
/// pixel where it believes to be.
///
/// A ray's place is known to about 2⁻²² of the resolution once it is in the map (`trace.rs`), and the exact test takes
/// hits up to 2⁻²¹ of the scene's size beside a triangle.
pub(crate) fn margin(resolution: u32) -> f64 {
    (f64::from(resolution) / f64::from(1 << 16)).max(1.0 / 64.0)
}
