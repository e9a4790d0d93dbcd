//! What takes the time, many at once, for the instruction sets there are: the maps of eight rays and the ways of four
//! through theirs, which layers a ray may meet in a pixel, and which triangles of a block. All give the same bits.

#[cfg(target_arch = "x86_64")]
mod avx2;

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::Avx2;

use isophote_scene::{Ray, Shear};

use super::path::{Entrance, Path};
use crate::{
    Directions,
    cpu::maps::{Block, LANES, Layers, PADDING, Packing},
};

/// An instruction set's way to do the tests.
pub(crate) trait Kernel: Copy {
    /// A ray for triangle tests in registers.
    type Triangles: Copy;

    fn triangles(self, shear: &Shear) -> Self::Triangles;

    /// The maps for eight rays.
    #[inline(always)]
    fn nearest(self, directions: Directions, rays: &[Ray; 8]) -> [u16; 8] {
        rays.map(|ray| directions.nearest(ray.direction) as u16)
    }

    /// The ways of four rays through their map.
    #[inline(always)]
    fn paths(self, map: &Entrance<'_>, rays: [&Ray; 4]) -> [Option<Path>; 4] {
        rays.map(|ray| Path::new(map, ray))
    }

    /// Brings the place of an answer into the cache.
    #[inline(always)]
    fn fetch<T>(self, _place: *const T) {}

    /// How layers are read, in registers.
    type Layers: Copy;

    fn layers(self, packing: Packing) -> Self::Layers;

    /// A bit for each of 8 layers of up to 4 bytes whose range of depths meets [low, high]; the bytes are those of the layers
    /// and more.
    fn narrow(self, how: &Self::Layers, bytes: &[u8; READ], low: u32, high: u32) -> u32;

    /// A bit for each of 4 layers of up to 8 bytes.
    fn wide(self, how: &Self::Layers, bytes: &[u8; READ], low: u32, high: u32) -> u32;

    /// The triangles that 32 bits do not reject, one bit each.
    fn candidates(self, ray: &Self::Triangles, block: &Block) -> u32;
}

/// No special instructions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl Kernel for Portable {
    type Triangles = Shear;
    type Layers = Packing;

    #[inline(always)]
    fn triangles(self, shear: &Shear) -> Shear {
        *shear
    }

    #[inline(always)]
    fn layers(self, packing: Packing) -> Packing {
        packing
    }

    #[inline(always)]
    fn narrow(self, how: &Packing, bytes: &[u8; READ], low: u32, high: u32) -> u32 {
        overlapping(*how, bytes, Narrow::WIDTH, low, high)
    }

    #[inline(always)]
    fn wide(self, how: &Packing, bytes: &[u8; READ], low: u32, high: u32) -> u32 {
        overlapping(*how, bytes, Wide::WIDTH, low, high)
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
fn overlapping(packing: Packing, bytes: &[u8; READ], width: usize, low: u32, high: u32) -> u32 {
    let size = packing.bytes() as usize;
    let mut bits = 0;
    for (index, bytes) in bytes.chunks_exact(size).take(width).enumerate() {
        let mut word = [0; 8];
        word[..size].copy_from_slice(bytes);
        let layer = packing.unpack(u64::from_le_bytes(word));
        bits |= u32::from(layer.near <= high && layer.far >= low) << index;
    }
    bits
}

/// Bytes that a kernel may read from the first layer on.
pub(crate) const READ: usize = PADDING;

/// Which kernel function is for layers of so many bytes.
pub(crate) trait Scan {
    /// Layers that are looked at together.
    const WIDTH: usize;

    /// A bit for each of the first layers whose range of depths meets [low, high].
    fn overlaps<K: Kernel>(
        kernel: K,
        how: &K::Layers,
        layers: &Layers,
        first: usize,
        low: u32,
        high: u32,
    ) -> u32;
}

/// Up to 4 bytes.
pub(crate) struct Narrow;
/// Up to 8 bytes.
pub(crate) struct Wide;

impl Scan for Narrow {
    const WIDTH: usize = 8;

    #[inline(always)]
    fn overlaps<K: Kernel>(
        kernel: K,
        how: &K::Layers,
        layers: &Layers,
        first: usize,
        low: u32,
        high: u32,
    ) -> u32 {
        let bytes = layers.since(first).first_chunk();
        bytes.map_or(0, |bytes| kernel.narrow(how, bytes, low, high))
    }
}

impl Scan for Wide {
    const WIDTH: usize = 4;

    #[inline(always)]
    fn overlaps<K: Kernel>(
        kernel: K,
        how: &K::Layers,
        layers: &Layers,
        first: usize,
        low: u32,
        high: u32,
    ) -> u32 {
        let bytes = layers.since(first).first_chunk();
        bytes.map_or(0, |bytes| kernel.wide(how, bytes, low, high))
    }
}

#[cfg(test)]
mod tests {
    #[cfg(target_arch = "x86_64")]
    use glam::Vec3;
    #[cfg(target_arch = "x86_64")]
    use isophote_scene::sample::{Sampler, uniform_sphere};

    use super::*;
    #[cfg(target_arch = "x86_64")]
    use crate::cpu::maps::Frame;
    use crate::cpu::maps::Layer;

    /// Rays of all kinds: some with axes' directions, some that are no rays, some that pass the map.
    #[cfg(target_arch = "x86_64")]
    fn rays() -> Vec<Ray> {
        let ray = |index: u32| {
            let sampler = Sampler::new(3, 0, index);
            let mut direction = uniform_sphere(sampler.get_2d(0));
            match index % 7 {
                0 => direction[index as usize / 7 % 3] = 0.0,
                1 => direction = [Vec3::X, Vec3::NEG_Y, Vec3::Z][index as usize / 7 % 3],
                2 => direction *= 1e-3,
                _ => {}
            }
            let place = sampler.get_2d(1).extend(sampler.get_1d(2));
            let mut ray = Ray::new(8.0 * place - 4.0, direction);
            match index % 5 {
                0 => (ray.t_min, ray.t_max) = (0.5, 1.0 + 3.0 * place.x),
                1 if index.is_multiple_of(11) => ray.direction = Vec3::ZERO,
                1 if index.is_multiple_of(13) => ray.origin.y = f32::NAN,
                _ => {}
            }
            ray
        };
        (0..4096).map(ray).collect()
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn all_kernels_start_rays_alike() {
        let Some(avx2) = Avx2::detect() else {
            return;
        };
        let rays = rays();
        for cells in [1, 2, 4, 5, 64] {
            let directions = Directions::new(cells);
            for rays in rays.as_chunks::<8>().0 {
                let pairs = avx2.nearest(directions, rays).into_iter();
                for ((found, expected), ray) in
                    pairs.zip(Portable.nearest(directions, rays)).zip(rays)
                {
                    assert!(usize::from(found) < directions.maps());
                    assert!(found == expected || !ray.is_valid(), "{ray:?}");
                }
            }
            let mut touching = 0;
            for map in 0..directions.maps().min(12) {
                let frame = Frame {
                    slope: directions.slope(map).to_array(),
                    low: [-2.5, -2.25, -1.9],
                    scale: [25.0, 31.0, 63.0],
                };
                let entrance = Entrance {
                    frame: &frame,
                    axis: directions.axis(map),
                    sides: [128, 256],
                };
                // A map is only for rays of its directions.
                let own = |ray: &&Ray| directions.nearest(ray.direction) == map;
                let own: Vec<Ray> = rays.iter().filter(own).copied().collect();
                for rays in own.as_chunks::<4>().0 {
                    let rays = rays.each_ref();
                    let found = avx2.paths(&entrance, rays);
                    assert_eq!(found, Portable.paths(&entrance, rays), "{rays:?}");
                    touching += found.iter().flatten().count();
                }
            }
            assert!(cells > 5 || touching > 50, "{touching}");
        }
    }

    /// Of every packing, every way to look at layers finds the same.
    #[test]
    fn all_kernels_find_the_same_layers() {
        for bytes in 2..=8 {
            for depth_bits in Packing::DEPTH_BITS {
                let Some(packing) = Packing::from_parts(depth_bits, bytes) else {
                    continue;
                };
                check(packing);
            }
        }
    }

    fn check(packing: Packing) {
        let steps = packing.depth_steps();
        let ids = 1_u64 << packing.shifts()[1].min(32);
        let layer = |index: u64| {
            let hash = |salt: u64| (index * 8 + salt).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 20;
            let (a, b) = (hash(1) as u32 % steps, hash(2) as u32 % steps);
            Layer {
                near: a.min(b),
                far: a.max(b),
                target: (hash(3) % ids) as u32,
            }
        };
        let all: Vec<Layer> = (0..40).map(layer).collect();
        let words = all.iter().map(|layer| packing.pack(*layer));
        let mut bytes = Layers::pack(packing, words);
        bytes.resize(bytes.len() + PADDING, 0);
        let layers = Layers::from_bytes(packing, bytes);
        assert!(layers.count() == 40 && layers.iter().eq(all.iter().copied()));
        let ranges = [
            [0, steps - 1],
            [steps / 3, steps / 2],
            [steps - 1, steps - 1],
            [7, 9],
        ];
        for (first, [low, high]) in (0..40).flat_map(|first| ranges.map(|range| (first, range))) {
            let meets = |layer: &Layer| layer.near <= high && layer.far >= low;
            let expected = |width: usize| -> u32 {
                let bits = all[first..].iter().take(width).enumerate();
                bits.map(|(index, layer)| u32::from(meets(layer)) << index)
                    .sum()
            };
            let width = if packing.bytes() <= 4 { 8 } else { 4 };
            let there = (1 << width.min(40 - first)) - 1;
            let expected = expected(width);
            let portable = scan(Portable, &layers, first, low, high) & there;
            assert_eq!(portable, expected, "{packing:?}");
            #[cfg(target_arch = "x86_64")]
            if let Some(avx2) = Avx2::detect() {
                let found = scan(avx2, &layers, first, low, high) & there;
                assert_eq!(found, expected, "{packing:?}");
            }
        }
    }

    fn scan<K: Kernel>(kernel: K, layers: &Layers, first: usize, low: u32, high: u32) -> u32 {
        let how = kernel.layers(layers.packing());
        match layers.packing().bytes() {
            2..=4 => Narrow::overlaps(kernel, &how, layers, first, low, high),
            _ => Wide::overlaps(kernel, &how, layers, first, low, high),
        }
    }
}
