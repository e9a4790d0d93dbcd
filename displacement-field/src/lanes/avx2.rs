//! Eight numbers in a register of AVX2.
//!
//! Only [`run`](super::run) names [`Eight`], after it has asked the processor: that is why the instructions exist wherever
//! a value of it does.
#![expect(unsafe_code, reason = "SIMD intrinsics")]

use std::{
    arch::x86_64::*,
    ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub},
};

use super::{Lanes, Mask};

const COUNT: usize = 8;

#[derive(Clone, Copy)]
pub(super) struct Eight(__m256);

/// All bits of a lane are set, or none.
#[derive(Clone, Copy)]
pub(super) struct EightMask(__m256);

macro_rules! operator {
    ($of:ident, $trait:ident, $name:ident, $intrinsic:ident) => {
        impl $trait for $of {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                // SAFETY: see the module.
                Self(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    };
}
operator!(Eight, Add, add, _mm256_add_ps);
operator!(Eight, Sub, sub, _mm256_sub_ps);
operator!(Eight, Mul, mul, _mm256_mul_ps);
operator!(Eight, Div, div, _mm256_div_ps);
operator!(EightMask, BitAnd, bitand, _mm256_and_ps);
operator!(EightMask, BitOr, bitor, _mm256_or_ps);

impl Neg for Eight {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_xor_ps(self.0, _mm256_set1_ps(-0.0)) })
    }
}

impl Not for EightMask {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_xor_ps(self.0, _mm256_castsi256_ps(_mm256_set1_epi32(-1))) })
    }
}

impl Mask for EightMask {
    #[inline(always)]
    fn bits(self) -> u32 {
        // SAFETY: see the module.
        unsafe { _mm256_movemask_ps(self.0) as u32 }
    }
}

impl Lanes for Eight {
    const COUNT: usize = COUNT;
    type Mask = EightMask;
    type Array<T: Copy> = [T; COUNT];

    #[inline(always)]
    fn array<T: Copy>(value: impl FnMut(usize) -> T) -> [T; COUNT] {
        [0, 1, 2, 3, 4, 5, 6, 7].map(value)
    }

    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    fn of(mut value: impl FnMut(usize) -> f32) -> Self {
        let [a, b, c, d] = [value(0), value(1), value(2), value(3)];
        let [e, f, g, h] = [value(4), value(5), value(6), value(7)];
        // SAFETY: see the module.
        Self(unsafe { _mm256_setr_ps(a, b, c, d, e, f, g, h) })
    }

    #[inline(always)]
    fn of_whole(mut value: impl FnMut(usize) -> u32) -> Self {
        let mut next = |lane| value(lane) as i32;
        let [a, b, c, d] = [next(0), next(1), next(2), next(3)];
        let [e, f, g, h] = [next(4), next(5), next(6), next(7)];
        // SAFETY: see the module.
        Self(unsafe { _mm256_cvtepi32_ps(_mm256_setr_epi32(a, b, c, d, e, f, g, h)) })
    }

    #[inline(always)]
    fn columns(mut row: impl FnMut(usize) -> [f32; 4]) -> [Self; 4] {
        let rows: [[f32; 4]; COUNT] = [
            row(0),
            row(1),
            row(2),
            row(3),
            row(4),
            row(5),
            row(6),
            row(7),
        ];
        // SAFETY: see the module; the pointers are of whole rows.
        unsafe {
            let pair = |low: usize| {
                let half = |index: usize| _mm_loadu_ps(rows[index].as_ptr());
                _mm256_set_m128(half(low + 4), half(low))
            };
            let (a, b, c, d) = (pair(0), pair(1), pair(2), pair(3));
            let (ab, cd) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
            let (ab_high, cd_high) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
            [
                Self(_mm256_shuffle_ps::<0x44>(ab, cd)),
                Self(_mm256_shuffle_ps::<0xee>(ab, cd)),
                Self(_mm256_shuffle_ps::<0x44>(ab_high, cd_high)),
                Self(_mm256_shuffle_ps::<0xee>(ab_high, cd_high)),
            ]
        }
    }

    #[inline(always)]
    fn load(values: &[f32]) -> Self {
        let values = &values[..COUNT];
        // SAFETY: see the module; the pointer is of as many numbers as are read.
        Self(unsafe { _mm256_loadu_ps(values.as_ptr()) })
    }

    #[inline(always)]
    fn to_array(self) -> [f32; COUNT] {
        let mut array = [0.0; COUNT];
        // SAFETY: see the module; the array is as long as what is written.
        unsafe { _mm256_storeu_ps(array.as_mut_ptr(), self.0) };
        array
    }

    #[inline(always)]
    fn to_whole(self) -> [u32; COUNT] {
        let mut array = [0_u32; COUNT];
        // SAFETY: see the module; the array is as long as what is written.
        unsafe { _mm256_storeu_si256(array.as_mut_ptr().cast(), _mm256_cvttps_epi32(self.0)) };
        array
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_min_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_sqrt_ps(self.0) })
    }

    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
    }

    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        // SAFETY: see the module.
        unsafe {
            let bit = _mm256_set1_ps(-0.0);
            let (size, sign) = (_mm256_andnot_ps(bit, self.0), _mm256_and_ps(bit, sign.0));
            Self(_mm256_or_ps(size, sign))
        }
    }

    #[inline(always)]
    fn less(self, other: Self) -> EightMask {
        // SAFETY: see the module.
        EightMask(unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0) })
    }

    #[inline(always)]
    fn select(mask: EightMask, yes: Self, no: Self) -> Self {
        // SAFETY: see the module.
        Self(unsafe { _mm256_blendv_ps(no.0, yes.0, mask.0) })
    }
}
