//! What takes the time, many at once, for the instruction sets there are: which layers a ray may meet in a pixel, and
//! which triangles of a block. All give the same bits.

#[cfg(target_arch = "x86_64")]
mod avx2;

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::Avx2;

use isophote_scene::Shear;

use crate::cpu::maps::{Block, LANES, Layer};

/// An instruction set's way to do the tests.
pub(crate) trait Kernel: Copy {
    /// A ray for triangle tests in registers.
    type Triangles: Copy;

    fn triangles(self, shear: &Shear) -> Self::Triangles;

    /// Brings the place of an answer into the cache.
    #[inline(always)]
    fn fetch<T>(self, _place: *const T) {}

    /// A bit for each of 8 layers whose range of depths meets [low, high].
    fn narrow(self, layers: &[u32; 8], low: u32, high: u32) -> u32;

    /// A bit for each of 4 layers.
    fn wide(self, layers: &[u64; 4], low: u32, high: u32) -> u32;

    /// The triangles that 32 bits do not reject, one bit each.
    fn candidates(self, ray: &Self::Triangles, block: &Block) -> u32;
}

/// No special instructions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl Kernel for Portable {
    type Triangles = Shear;

    #[inline(always)]
    fn triangles(self, shear: &Shear) -> Shear {
        *shear
    }

    #[inline(always)]
    fn narrow(self, layers: &[u32; 8], low: u32, high: u32) -> u32 {
        overlapping(layers, low, high)
    }

    #[inline(always)]
    fn wide(self, layers: &[u64; 4], low: u32, high: u32) -> u32 {
        overlapping(layers, low, high)
    }

    #[inline(always)]
    fn candidates(self, ray: &Shear, block: &Block) -> u32 {
        let mut candidates = 0;
        for lane in 0..LANES {
            candidates |= u32::from(ray.is_candidate(block.triangle(lane))) << lane;
        }
        candidates
    }
}

#[inline(always)]
fn overlapping<L: Layer>(layers: &[L], low: u32, high: u32) -> u32 {
    let bit = |(index, layer): (usize, &L)| {
        u32::from(layer.near() <= high && layer.far() >= low) << index
    };
    layers.iter().enumerate().map(bit).sum()
}

/// Which kernel function is for which word.
pub(crate) trait Scan: Layer {
    /// A bit for each of the first layers, [`WIDTH`](Layer::WIDTH) at most, whose range of depths meets [low, high].
    fn overlaps<K: Kernel>(kernel: K, layers: &[Self], low: u32, high: u32) -> u32;
}

impl Scan for u32 {
    #[inline(always)]
    fn overlaps<K: Kernel>(kernel: K, layers: &[Self], low: u32, high: u32) -> u32 {
        layers
            .first_chunk()
            .map_or(0, |layers| kernel.narrow(layers, low, high))
    }
}

impl Scan for u64 {
    #[inline(always)]
    fn overlaps<K: Kernel>(kernel: K, layers: &[Self], low: u32, high: u32) -> u32 {
        layers
            .first_chunk()
            .map_or(0, |layers| kernel.wide(layers, low, high))
    }
}
