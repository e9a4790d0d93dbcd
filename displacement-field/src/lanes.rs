//! Numbers that stand for one ray or for eight: the same code is the scalar kernel and the vector one, bit for bit.
//!
//! Whole numbers are kept as floats: all that are needed are below 2²⁴. Nothing is fused and nothing is approximate but
//! where a function says so, so that one lane and eight agree.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod two;

pub(crate) use self::two::Two;

use std::ops::{Add, BitAnd, BitOr, Index, Mul, Neg, Not, Sub};

/// Answers to comparisons, one a lane.
pub(crate) trait Mask:
    Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self>
{
    /// The first lane is the lowest bit.
    fn bits(self) -> u32;
}

impl Mask for bool {
    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self)
    }
}

/// One number of 32 bits, or several.
pub(crate) trait Lanes:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + std::ops::Div<Output = Self>
    + Neg<Output = Self>
{
    /// How many.
    const COUNT: usize;
    type Mask: Mask;
    /// Something for each lane.
    type Array<T: Copy>: Copy + Index<usize, Output = T>;

    fn array<T: Copy>(value: impl FnMut(usize) -> T) -> Self::Array<T>;
    fn splat(value: f32) -> Self;
    fn of(value: impl FnMut(usize) -> f32) -> Self;
    /// Of whole numbers below 2³¹.
    fn of_whole(value: impl FnMut(usize) -> u32) -> Self;
    /// The columns of rows, one row a lane.
    fn columns(row: impl FnMut(usize) -> [f32; 4]) -> [Self; 4];
    /// Of the first numbers of a slice, which must not be shorter.
    fn load(values: &[f32]) -> Self;
    fn to_array(self) -> Self::Array<f32>;
    /// Of whole numbers from 0 to 2³¹ − 1.
    fn to_whole(self) -> Self::Array<u32>;
    /// The lesser; `other` where either is NaN.
    fn min(self, other: Self) -> Self;
    /// The larger; `other` where either is NaN.
    fn max(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    fn abs(self) -> Self;
    fn copysign(self, sign: Self) -> Self;
    /// False where either is NaN.
    fn less(self, other: Self) -> Self::Mask;
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
}

impl Lanes for f32 {
    const COUNT: usize = 1;
    type Mask = bool;
    type Array<T: Copy> = [T; 1];

    #[inline(always)]
    fn array<T: Copy>(mut value: impl FnMut(usize) -> T) -> [T; 1] {
        [value(0)]
    }

    #[inline(always)]
    fn splat(value: f32) -> Self {
        value
    }

    #[inline(always)]
    fn of(mut value: impl FnMut(usize) -> Self) -> Self {
        value(0)
    }

    #[inline(always)]
    fn of_whole(mut value: impl FnMut(usize) -> u32) -> Self {
        value(0) as Self
    }

    #[inline(always)]
    fn columns(mut row: impl FnMut(usize) -> [Self; 4]) -> [Self; 4] {
        row(0)
    }

    #[inline(always)]
    fn load(values: &[f32]) -> Self {
        values[0]
    }

    #[inline(always)]
    fn to_array(self) -> [f32; 1] {
        [self]
    }

    #[inline(always)]
    fn to_whole(self) -> [u32; 1] {
        [self as i32 as u32]
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }

    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        self.copysign(sign)
    }

    #[inline(always)]
    fn less(self, other: Self) -> bool {
        self < other
    }

    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
}

/// Code that is worth compiling for newer processors.
///
/// `run` must be `#[inline(always)]`, and so must be all that it calls with lanes.
pub(crate) trait Kernel {
    type Output;
    /// `W` are the widest lanes that this processor has.
    fn run<W: Lanes>(self) -> Self::Output;
}

/// Runs a kernel with the widest lanes this processor has.
#[inline]
pub(crate) fn run<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt")]
        fn with_avx2<K: Kernel>(kernel: K) -> K::Output {
            kernel.run::<avx2::Eight>()
        }
        if is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
        {
            #[expect(unsafe_code, reason = "calls code for a processor found at run time")]
            // SAFETY: the processor has just been asked for all that the function needs.
            return unsafe { with_avx2(kernel) };
        }
    }
    kernel.run::<f32>()
}

/// The bits that are set, from the lowest.
#[inline(always)]
pub(crate) fn set_bits(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lowest = (bits != 0).then(|| bits.trailing_zeros() as usize);
        bits &= bits.wrapping_sub(1);
        lowest
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Everything that lanes can do, on numbers of all kinds, as bits.
    struct Everything<'a>(&'a [[f32; 2]]);

    fn outcomes<L: Lanes>(pairs: &[[f32; 2]]) -> Vec<u32> {
        let mut all = Vec::new();
        for pairs in pairs.chunks_exact(L::COUNT) {
            let (a, b) = (L::of(|lane| pairs[lane][0]), L::of(|lane| pairs[lane][1]));
            let second: Vec<f32> = pairs.iter().map(|pair| pair[1]).collect();
            let [c, d, ..] = L::columns(|lane| [pairs[lane][0], pairs[lane][1], 0.0, 1.0]);
            let results = [
                a + b,
                c - d,
                a * L::load(&second),
                a / b,
                -a,
                a.min(b),
                a.max(b),
                a.sqrt(),
                a.abs(),
                a.copysign(b),
                L::select(a.less(b), a, L::splat(3.0)),
                L::select(!a.less(b) & b.less(a) | a.less(L::splat(0.0)), a, b),
                L::of_whole(|lane| (pairs[lane][0].abs().min(1e6)) as u32),
            ];
            let whole = a.abs().min(L::splat(1e6)).to_whole();
            let mask = a.less(b).bits();
            for lane in 0..L::COUNT {
                // Which NaN it is does not matter.
                let bits = |value: f32| if value.is_nan() { 1 } else { value.to_bits() };
                all.extend(results.map(|result| bits(result.to_array()[lane])));
                all.extend([whole[lane], mask >> lane & 1]);
            }
        }
        all
    }

    impl Kernel for Everything<'_> {
        type Output = Vec<u32>;
        #[inline(always)]
        fn run<W: Lanes>(self) -> Vec<u32> {
            outcomes::<W>(self.0)
        }
    }

    #[test]
    fn eight_lanes_are_one_eight_times() {
        let numbers = [
            0.0,
            -0.0,
            1.0,
            -2.5,
            3e-39,
            1e30,
            f32::INFINITY,
            f32::NEG_INFINITY,
            f32::NAN,
            0.3,
            7.9,
        ];
        let mut pairs: Vec<[f32; 2]> = numbers
            .iter()
            .flat_map(|a| numbers.map(|b| [*a, b]))
            .collect();
        pairs.resize(pairs.len().next_multiple_of(8), [1.0, 2.0]);
        let one = outcomes::<f32>(&pairs);
        assert_eq!(run(Everything(&pairs)), one);
        assert_eq!(outcomes::<Two<f32>>(&pairs), one);
        assert_eq!(set_bits(0b1010_0001).collect::<Vec<_>>(), [0, 5, 7]);
    }
}
