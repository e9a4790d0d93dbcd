//! What is kept of a field's rays: distances from the position in radii of the sphere, 0..=2, or that nothing was hit.

use crate::{FieldParams, Storage, lanes::Lanes};

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
pub(crate) trait Store<'a>: Copy {
    /// Of samples that are kept this way; others are read as misses.
    fn of(samples: &'a Samples, cells: usize) -> Self;

    /// Distances in radii, infinite where nothing is hit: one map and one of its cells a lane. `cosines` are those of
    /// the rays to the inward normals.
    fn distances<L: Lanes>(
        stores: L::Array<Self>,
        positions: L::Array<u32>,
        cells: L,
        cosines: L,
    ) -> L;
}

/// Distances by index.
#[derive(Clone, Copy)]
pub(crate) struct Maps<'a, T> {
    samples: &'a [T],
    cells: usize,
}

impl<T: Copy> Maps<'_, T> {
    #[inline(always)]
    fn read(&self, position: u32, cell: u32) -> Option<T> {
        let index = position as usize * self.cells + cell as usize;
        self.samples.get(index).copied()
    }
}

/// Bits by index.
#[derive(Clone, Copy)]
pub(crate) struct BitMaps<'a> {
    words: &'a [u64],
    depths: &'a [f32],
    /// Words of a map.
    map: usize,
}

impl<'a> Store<'a> for Maps<'a, f32> {
    fn of(samples: &'a Samples, cells: usize) -> Self {
        let samples = match samples {
            Samples::Float(samples) => &samples[..],
            _ => &[],
        };
        Self { samples, cells }
    }

    #[inline(always)]
    fn distances<L: Lanes>(stores: L::Array<Self>, positions: L::Array<u32>, cells: L, _: L) -> L {
        let cells = cells.to_whole();
        L::of(
            #[inline(always)]
            |lane| {
                let sample = stores[lane].read(positions[lane], cells[lane]);
                sample.unwrap_or(f32::INFINITY)
            },
        )
    }
}

/// Of codes, the largest of which is a miss.
macro_rules! store_codes {
    ($code:ty, $kind:ident, $largest:expr) => {
        impl<'a> Store<'a> for Maps<'a, $code> {
            fn of(samples: &'a Samples, cells: usize) -> Self {
                let samples = match samples {
                    Samples::$kind(samples) => &samples[..],
                    _ => &[],
                };
                Self { samples, cells }
            }

            #[inline(always)]
            fn distances<L: Lanes>(
                stores: L::Array<Self>,
                positions: L::Array<u32>,
                cells: L,
                _: L,
            ) -> L {
                let cells = cells.to_whole();
                let codes = L::of_whole(
                    #[inline(always)]
                    |lane| {
                        let code = stores[lane].read(positions[lane], cells[lane]);
                        u32::from(code.unwrap_or(<$code>::MAX))
                    },
                );
                let hits = codes.less(L::splat($largest + 0.5));
                let distances = codes * L::splat(2.0 / $largest);
                L::select(hits, distances, L::splat(f32::INFINITY))
            }
        }
    };
}
store_codes!(u16, Word, WORDS);
store_codes!(u8, Byte, BYTES);

impl<'a> Store<'a> for BitMaps<'a> {
    fn of(samples: &'a Samples, cells: usize) -> Self {
        let (words, depths): (&[u64], &[f32]) = match samples {
            Samples::Bit(bits) => (&bits.words, &bits.depths),
            _ => (&[], &[]),
        };
        Self {
            words,
            depths,
            map: cells.div_ceil(64),
        }
    }

    #[inline(always)]
    fn distances<L: Lanes>(
        stores: L::Array<Self>,
        positions: L::Array<u32>,
        cells: L,
        cosines: L,
    ) -> L {
        let cells = cells.to_whole();
        let depths = L::of(
            #[inline(always)]
            |lane| {
                let (store, cell) = (stores[lane], cells[lane] as usize);
                let position = positions[lane] as usize;
                let word = store.words.get(position * store.map + cell / 64);
                let hits = word.is_some_and(|word| word >> (cell % 64) & 1 == 1);
                let depth = store.depths.get(position).filter(|_| hits);
                depth.copied().unwrap_or(f32::INFINITY)
            },
        );
        let hits = depths.less(L::splat(f32::INFINITY));
        // Not beyond the sphere's other side, where grazing rays would reach the plane.
        let end = L::splat(2.0) * cosines.max(L::splat(0.0));
        let distances = (depths / cosines.max(L::splat(1e-3))).min(end);
        L::select(hits, distances, depths)
    }
}

/// Calls some code with the [`Store`] of a way of keeping samples: compiled once for each.
macro_rules! with_store {
    ($storage:expr, $store:ident => $code:expr) => {
        match $storage {
            $crate::Storage::Float => {
                type $store<'a> = $crate::cpu::samples::Maps<'a, f32>;
                $code
            }
            $crate::Storage::Word => {
                type $store<'a> = $crate::cpu::samples::Maps<'a, u16>;
                $code
            }
            $crate::Storage::Byte => {
                type $store<'a> = $crate::cpu::samples::Maps<'a, u8>;
                $code
            }
            $crate::Storage::Bit => {
                type $store<'a> = $crate::cpu::samples::BitMaps<'a>;
                $code
            }
        }
    };
}
pub(crate) use with_store;

/// The code of a distance, or the one beyond the largest for a miss.
fn encode(distance: f32, largest: f32) -> f32 {
    if distance.is_finite() {
        (0.5 * distance.clamp(0.0, 2.0) * largest).round()
    } else {
        largest + 1.0
    }
}

impl Samples {
    /// None yet, with room for those of a whole field.
    pub(crate) fn with_room(params: &FieldParams) -> Self {
        let (maps, cells) = (params.positions.count(), params.cells());
        match params.storage {
            Storage::Float => Self::Float(Vec::with_capacity(maps * cells)),
            Storage::Word => Self::Word(Vec::with_capacity(maps * cells)),
            Storage::Byte => Self::Byte(Vec::with_capacity(maps * cells)),
            Storage::Bit => Self::Bit(Bits {
                words: Vec::with_capacity(maps * cells.div_ceil(64)),
                depths: Vec::with_capacity(maps),
            }),
        }
    }

    /// Adds whole maps of distances; `cosines` are those of a map's cells to the normal.
    pub(crate) fn extend(&mut self, distances: &[f32], cosines: &[f32]) {
        match self {
            Self::Float(samples) => samples.extend_from_slice(distances),
            Self::Word(samples) => {
                samples.extend(
                    distances
                        .iter()
                        .map(|&distance| encode(distance, WORDS) as u16),
                );
            }
            Self::Byte(samples) => {
                samples.extend(
                    distances
                        .iter()
                        .map(|&distance| encode(distance, BYTES) as u8),
                );
            }
            Self::Bit(bits) => {
                for map in distances.chunks_exact(cosines.len()) {
                    bits.push(map, cosines);
                }
            }
        }
    }

    /// One distance in radii.
    pub(crate) fn distance(&self, position: usize, cell: usize, cells: usize, cosine: f32) -> f32 {
        with_store!(self.storage(), S => {
            let stores = [<S<'_> as Store<'_>>::of(self, cells)];
            S::distances::<f32>(stores, [position as u32], cell as f32, cosine)
        })
    }

    fn storage(&self) -> Storage {
        match self {
            Self::Float(_) => Storage::Float,
            Self::Word(_) => Storage::Word,
            Self::Byte(_) => Storage::Byte,
            Self::Bit(_) => Storage::Bit,
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
    use crate::Positions;

    /// Those of a field of ten positions, in two goes.
    fn samples(maps: &[f32], storage: Storage, resolution: u32, cosines: &[f32]) -> Samples {
        let mut samples = Samples::with_room(&FieldParams {
            positions: Positions::Slater { rings: 1 },
            resolution,
            storage,
            ..FieldParams::default()
        });
        let (first, rest) = maps.split_at(cosines.len());
        samples.extend(first, cosines);
        samples.extend(rest, cosines);
        samples
    }

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
            let samples = samples(&distances, storage, 4, &[1.0; 16]);
            for (index, distance) in distances.iter().enumerate() {
                let found = samples.distance(index / 16, index % 16, 16, 1.0);
                let same = found == *distance || (found - distance).abs() <= error;
                assert!(same, "{storage:?} {index}: {found} {distance}");
            }
        }
    }

    #[test]
    fn bits_have_the_mean_depth() {
        let distances = [0.5, f32::INFINITY, 1.0, f32::INFINITY];
        let samples = samples(&distances, Storage::Bit, 2, &[1.0, 1.0, 0.5, 1.0]);
        let at = |cell, cosine| samples.distance(0, cell, 4, cosine);
        assert_eq!([at(0, 1.0), at(2, 0.5)], [0.5, 1.0]);
        assert_eq!([at(1, 1.0), at(3, 1.0)], [f32::INFINITY; 2]);
    }
}
