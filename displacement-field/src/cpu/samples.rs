//! What is kept of a field's rays: distances from the position in radii of the sphere, 0..=2, or that nothing was hit.

use crate::Storage;

/// All samples of a field: map after map, row after row.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Samples {
    Float(Vec<f32>),
    Word(Vec<u16>),
    Byte(Vec<u8>),
    Bit(Bits),
}

/// Whether rays hit, and how deep the object lies under each position.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Bits {
    /// Each map starts with a word of its own.
    pub(crate) words: Vec<u64>,
    /// For every position the mean depth, along its normal, of all that is hit from there; in radii.
    pub(crate) depths: Vec<f32>,
}

/// The codes of distances; the largest code is a miss.
const WORDS: f32 = 65_534.0;
const BYTES: f32 = 254.0;

/// One way of keeping samples, to look up in.
pub(crate) trait Store: Copy {
    /// A ray's distance in radii, infinite where nothing is hit. `cosine` is that of the ray to the inward normal.
    fn distance(self, position: usize, cell: usize, cosine: f32) -> f32;
}

/// Distances by index.
#[derive(Clone, Copy)]
pub(crate) struct Maps<'a, T> {
    samples: &'a [T],
    cells: usize,
}

/// Bits by index.
#[derive(Clone, Copy)]
pub(crate) struct BitMaps<'a> {
    bits: &'a Bits,
    /// Words of a map.
    words: usize,
}

impl Store for Maps<'_, f32> {
    #[inline(always)]
    fn distance(self, position: usize, cell: usize, _: f32) -> f32 {
        self.samples[position * self.cells + cell]
    }
}

impl Store for Maps<'_, u16> {
    #[inline(always)]
    fn distance(self, position: usize, cell: usize, _: f32) -> f32 {
        decode(self.samples[position * self.cells + cell])
    }
}

impl Store for Maps<'_, u8> {
    #[inline(always)]
    fn distance(self, position: usize, cell: usize, _: f32) -> f32 {
        decode_byte(self.samples[position * self.cells + cell])
    }
}

impl Store for BitMaps<'_> {
    #[inline(always)]
    fn distance(self, position: usize, cell: usize, cosine: f32) -> f32 {
        let word = self.bits.words[position * self.words + cell / 64];
        if word >> (cell % 64) & 1 == 0 {
            return f32::INFINITY;
        }
        // Not beyond the sphere's other side, where grazing rays would reach the plane.
        let end = 2.0 * cosine.max(0.0);
        (self.bits.depths[position] / cosine.max(1e-3)).min(end)
    }
}

/// Calls some code with the [`Store`] of samples: compiled once for each.
macro_rules! with_store {
    ($samples:expr, $cells:expr, $store:ident => $code:expr) => {
        match $samples {
            $crate::cpu::samples::Samples::Float(samples) => {
                let $store = $crate::cpu::samples::Maps::of(samples, $cells);
                $code
            }
            $crate::cpu::samples::Samples::Word(samples) => {
                let $store = $crate::cpu::samples::Maps::of(samples, $cells);
                $code
            }
            $crate::cpu::samples::Samples::Byte(samples) => {
                let $store = $crate::cpu::samples::Maps::of(samples, $cells);
                $code
            }
            $crate::cpu::samples::Samples::Bit(bits) => {
                let $store = $crate::cpu::samples::BitMaps::of(bits, $cells);
                $code
            }
        }
    };
}
pub(crate) use with_store;

impl<'a, T> Maps<'a, T> {
    pub(crate) fn of(samples: &'a [T], cells: usize) -> Self {
        Self { samples, cells }
    }
}

impl<'a> BitMaps<'a> {
    pub(crate) fn of(bits: &'a Bits, cells: usize) -> Self {
        Self {
            bits,
            words: cells.div_ceil(64),
        }
    }
}

fn encode(distance: f32, largest: f32) -> f32 {
    (0.5 * distance.clamp(0.0, 2.0) * largest).round()
}

#[inline(always)]
fn decode(code: u16) -> f32 {
    if code == u16::MAX {
        f32::INFINITY
    } else {
        f32::from(code) * (2.0 / WORDS)
    }
}

#[inline(always)]
fn decode_byte(code: u8) -> f32 {
    if code == u8::MAX {
        f32::INFINITY
    } else {
        f32::from(code) * (2.0 / BYTES)
    }
}

impl Samples {
    /// Keeps distances, map after map of `cells` each; `cosines` are those of the cells to the normal.
    pub(crate) fn of(distances: Vec<f32>, storage: Storage, cells: usize, cosines: &[f32]) -> Self {
        let coded = |largest: f32| {
            let code = move |distance: &f32| {
                if distance.is_finite() {
                    encode(*distance, largest)
                } else {
                    largest + 1.0
                }
            };
            distances.iter().map(code)
        };
        match storage {
            Storage::Float => Self::Float(distances),
            Storage::Word => Self::Word(coded(WORDS).map(|code| code as u16).collect()),
            Storage::Byte => Self::Byte(coded(BYTES).map(|code| code as u8).collect()),
            Storage::Bit => {
                let mut bits = Bits::default();
                for map in distances.chunks_exact(cells) {
                    bits.push(map, cosines);
                }
                Self::Bit(bits)
            }
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Float(samples) => size_of_val(&samples[..]),
            Self::Word(samples) => size_of_val(&samples[..]),
            Self::Byte(samples) => size_of_val(&samples[..]),
            Self::Bit(bits) => size_of_val(&bits.words[..]) + size_of_val(&bits.depths[..]),
        }
    }
}

impl Bits {
    fn push(&mut self, map: &[f32], cosines: &[f32]) {
        let (mut depth, mut hits) = (0.0, 0.0_f32);
        for (word, cosines) in map.chunks(64).zip(cosines.chunks(64)) {
            let mut bits = 0;
            for (index, (distance, cosine)) in word.iter().zip(cosines).enumerate() {
                if distance.is_finite() {
                    bits |= 1 << index;
                    depth += distance * cosine;
                    hits += 1.0;
                }
            }
            self.words.push(bits);
        }
        self.depths.push(depth / hits.max(1.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_come_back_and_misses_stay_misses() {
        let distances: Vec<f32> = (0..64)
            .map(|i| {
                if i % 3 == 0 {
                    f32::INFINITY
                } else {
                    i as f32 / 32.0
                }
            })
            .collect();
        for (storage, error) in [
            (Storage::Float, 0.0),
            (Storage::Word, 1.01 / 65_534.0),
            (Storage::Byte, 1.01 / 254.0),
        ] {
            let samples = Samples::of(distances.clone(), storage, 16, &[1.0; 16]);
            for (index, distance) in distances.iter().enumerate() {
                let found =
                    with_store!(&samples, 16, store => store.distance(index / 16, index % 16, 1.0));
                let same = found == *distance || (found - distance).abs() <= error;
                assert!(same, "{storage:?} {index}: {found} {distance}");
            }
        }
    }

    #[test]
    fn bits_have_the_mean_depth() {
        let distances = vec![0.5, f32::INFINITY, 1.0, f32::INFINITY];
        let samples = Samples::of(distances, Storage::Bit, 4, &[1.0, 1.0, 0.5, 1.0]);
        let at = |cell, cosine| with_store!(&samples, 4, store => store.distance(0, cell, cosine));
        assert_eq!([at(0, 1.0), at(2, 0.5)], [0.5, 1.0]);
        assert_eq!([at(1, 1.0), at(3, 1.0)], [f32::INFINITY; 2]);
    }
}
