//! The maps as they lie in memory: flat arrays that a GPU can hold too.
//!
//! ```text
//! frames   one per map                      where its pixels and depths lie in the world
//! pixels   one per pixel of all maps, + 1   its first layer: the prefix sum of the layer counts (§3.1); and in which
//!                                           of 32 slabs of depth it has any, so that empty space is passed fast
//! layers   one per layer                    near and far depth, and what it is a part of, in one word
//! blocks   eight triangles each             corners, and which triangles they are
//! planes   one per triangle                 only for the paper's layers (`Coverage::Center`)
//! ```
//!
//! Depths only say which layers a ray can meet in a pixel. Where it meets them is calculated from the triangles, so
//! that depths of 8 bits cost no accuracy. Pixels lie in tiles of 4 × 4 ([`pixel_index`]), so that a ray that walks in
//! any direction stays in few lines of the cache.

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

/// A layer in one word.
pub trait Layer: Copy + Pod + Ord + Send + Sync {
    /// Steps of the depth.
    const STEPS: u32;
    /// Layers that are looked at together.
    const WIDTH: usize;

    /// Depths must be less than [`STEPS`](Self::STEPS).
    fn new(near: u32, far: u32, target: u32) -> Self;
    /// The least depth in the pixel, rounded down.
    fn near(self) -> u32;
    /// The greatest depth in the pixel.
    fn far(self) -> u32;
    /// What it is a part of: a block, or with [`Coverage::Center`](crate::Coverage::Center) a triangle of one
    /// (block × 8 + lane).
    fn target(self) -> u32;
}

/// 8 bits of each depth and 16 of the target.
impl Layer for u32 {
    const STEPS: Self = 1 << 8;
    const WIDTH: usize = 8;

    #[inline(always)]
    fn new(near: u32, far: u32, target: u32) -> Self {
        near << 24 | far << 16 | target
    }

    #[inline(always)]
    fn near(self) -> u32 {
        self >> 24
    }

    #[inline(always)]
    fn far(self) -> u32 {
        self >> 16 & 0xff
    }

    #[inline(always)]
    fn target(self) -> u32 {
        self & 0xffff
    }
}

/// 16 bits of each depth and 32 of the target.
impl Layer for u64 {
    const STEPS: u32 = 1 << 16;
    const WIDTH: usize = 4;

    #[inline(always)]
    fn new(near: u32, far: u32, target: u32) -> Self {
        Self::from(near) << 48 | Self::from(far) << 32 | Self::from(target)
    }

    #[inline(always)]
    fn near(self) -> u32 {
        (self >> 48) as u32
    }

    #[inline(always)]
    fn far(self) -> u32 {
        (self >> 32 & 0xffff) as u32
    }

    #[inline(always)]
    fn target(self) -> u32 {
        self as u32
    }
}

/// The layers of all pixels in as few bits as will do, those of a pixel by near depth, far depth and target; followed
/// by [`PADDING`] unused ones, so that kernels may read on.
#[derive(Clone, Debug, PartialEq)]
pub enum Layers {
    /// For up to 65,536 targets.
    Narrow(Vec<u32>),
    /// For more.
    Wide(Vec<u64>),
}

impl Layers {
    /// Number of layers.
    pub fn count(&self) -> usize {
        let all = match self {
            Self::Narrow(layers) => layers.len(),
            Self::Wide(layers) => layers.len(),
        };
        all - PADDING
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Narrow(layers) => size_of_val(&layers[..]),
            Self::Wide(layers) => size_of_val(&layers[..]),
        }
    }

    /// Steps of the depth.
    pub fn depth_steps(&self) -> u32 {
        match self {
            Self::Narrow(_) => u32::STEPS,
            Self::Wide(_) => u64::STEPS,
        }
    }
}

/// Unused layers at the end.
pub const PADDING: usize = 8;

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

    /// Bytes of the maps alone.
    pub fn map_bytes(&self) -> usize {
        size_of_val(&self.frames[..]) + size_of_val(&self.pixels[..]) + self.layers.bytes()
    }
}
