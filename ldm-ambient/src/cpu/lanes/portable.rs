//! Registers as arrays.

use super::{LANES, Lanes, Simd};

/// On any processor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

#[inline(always)]
fn each<T: Copy, R: Copy + Default>(
    a: [T; LANES],
    b: [T; LANES],
    of: impl Fn(T, T) -> R,
) -> [R; LANES] {
    let mut result = [R::default(); LANES];
    for lane in 0..LANES {
        result[lane] = of(a[lane], b[lane]);
    }
    result
}

impl Simd for Portable {
    type Floats = Lanes;
    type Ints = [u32; LANES];
    type Mask = [bool; LANES];

    #[inline(always)]
    fn load(self, lanes: &Lanes) -> Lanes {
        *lanes
    }

    #[inline(always)]
    fn store(self, values: Lanes) -> Lanes {
        values
    }

    #[inline(always)]
    fn splat(self, value: f32) -> Lanes {
        [value; LANES]
    }

    #[inline(always)]
    fn splat_int(self, value: u32) -> [u32; LANES] {
        [value; LANES]
    }

    #[inline(always)]
    fn add(self, a: Lanes, b: Lanes) -> Lanes {
        each(a, b, |a, b| a + b)
    }

    #[inline(always)]
    fn sub(self, a: Lanes, b: Lanes) -> Lanes {
        each(a, b, |a, b| a - b)
    }

    #[inline(always)]
    fn mul(self, a: Lanes, b: Lanes) -> Lanes {
        each(a, b, |a, b| a * b)
    }

    #[inline(always)]
    fn div(self, a: Lanes, b: Lanes) -> Lanes {
        each(a, b, |a, b| a / b)
    }

    #[inline(always)]
    fn min(self, a: Lanes, b: Lanes) -> Lanes {
        each(a, b, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn max(self, a: Lanes, b: Lanes) -> Lanes {
        each(a, b, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn abs(self, value: Lanes) -> Lanes {
        value.map(f32::abs)
    }

    #[inline(always)]
    fn floor(self, value: Lanes) -> Lanes {
        value.map(f32::floor)
    }

    #[inline(always)]
    fn with_sign(self, value: Lanes, sign: Lanes) -> Lanes {
        each(value, sign, f32::copysign)
    }

    #[inline(always)]
    fn less(self, a: Lanes, b: Lanes) -> [bool; LANES] {
        each(a, b, |a, b| a < b)
    }

    #[inline(always)]
    fn at_most(self, a: Lanes, b: Lanes) -> [bool; LANES] {
        each(a, b, |a, b| a <= b)
    }

    #[inline(always)]
    fn select(self, mask: [bool; LANES], yes: Lanes, no: Lanes) -> Lanes {
        let mut result = no;
        for lane in 0..LANES {
            if mask[lane] {
                result[lane] = yes[lane];
            }
        }
        result
    }

    #[inline(always)]
    fn and(self, a: [bool; LANES], b: [bool; LANES]) -> [bool; LANES] {
        each(a, b, |a, b| a & b)
    }

    #[inline(always)]
    fn or(self, a: [bool; LANES], b: [bool; LANES]) -> [bool; LANES] {
        each(a, b, |a, b| a | b)
    }

    #[inline(always)]
    fn and_not(self, a: [bool; LANES], b: [bool; LANES]) -> [bool; LANES] {
        each(a, b, |a, b| a & !b)
    }

    #[inline(always)]
    fn none(self) -> [bool; LANES] {
        [false; LANES]
    }

    #[inline(always)]
    fn bits(self, mask: [bool; LANES]) -> u32 {
        let bits = mask
            .iter()
            .zip(0..)
            .map(|(&set, lane)| u32::from(set) << lane);
        bits.sum()
    }

    #[inline(always)]
    fn whole(self, value: Lanes) -> [u32; LANES] {
        value.map(|value| value as u32)
    }

    #[inline(always)]
    fn add_ints(self, a: [u32; LANES], b: [u32; LANES]) -> [u32; LANES] {
        each(a, b, u32::wrapping_add)
    }

    #[inline(always)]
    fn where_set(self, mask: [bool; LANES], values: [u32; LANES]) -> [u32; LANES] {
        let mut result = [0; LANES];
        for lane in 0..LANES {
            if mask[lane] {
                result[lane] = values[lane];
            }
        }
        result
    }

    #[inline(always)]
    fn less_ints(self, a: [u32; LANES], b: [u32; LANES]) -> [bool; LANES] {
        each(a, b, |a, b| a < b)
    }

    #[inline(always)]
    fn gather_ints(self, table: &[u32], places: [u32; LANES]) -> [u32; LANES] {
        let last = table.len().saturating_sub(1);
        places.map(|place| table.get(last.min(place as usize)).copied().unwrap_or(0))
    }

    #[inline(always)]
    fn gather_floats(
        self,
        table: &[f32],
        places: [u32; LANES],
        mask: [bool; LANES],
        otherwise: Lanes,
    ) -> Lanes {
        let last = table.len().saturating_sub(1);
        let mut result = otherwise;
        for lane in 0..LANES {
            if mask[lane] {
                let entry = table.get(last.min(places[lane] as usize));
                result[lane] = entry.copied().unwrap_or(0.0);
            }
        }
        result
    }

    #[inline(always)]
    fn quads(self, table: &[f32], places: [u32; LANES]) -> [Lanes; 4] {
        let mut quads = [[0.0; LANES]; 4];
        if let Some(last) = table.len().checked_sub(4) {
            for (lane, place) in places.into_iter().enumerate() {
                let first = last.min(place as usize);
                for (number, quad) in quads.iter_mut().enumerate() {
                    quad[lane] = table[first + number];
                }
            }
        }
        quads
    }
}
