//! AVX2.
#![expect(unsafe_code, reason = "SIMD intrinsics")]

use std::arch::x86_64::*;

use super::{LANES, Lanes, Simd};

/// Proof that the processor has AVX2 and BMI1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Avx2(());

impl Avx2 {
    #[inline]
    pub(super) fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1")).then_some(Self(()))
    }

    #[inline]
    pub(super) fn call<R>(self, work: impl FnOnce() -> R) -> R {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { with_avx2(work) }
    }
}

#[target_feature(enable = "avx2,bmi1")]
fn with_avx2<R>(work: impl FnOnce() -> R) -> R {
    work()
}

/// The places in a table, none beyond it; `None` where it is empty or has more than can be told.
#[inline]
#[target_feature(enable = "avx2,bmi1")]
fn within(length: usize, places: __m256i) -> Option<__m256i> {
    let last = i32::try_from(length)
        .ok()?
        .checked_sub(1)
        .filter(|last| *last >= 0)?;
    Some(_mm256_min_epu32(places, _mm256_set1_epi32(last)))
}

#[inline]
#[target_feature(enable = "avx2,bmi1")]
fn gather_ints(table: &[u32], places: __m256i) -> __m256i {
    match within(table.len(), places) {
        // SAFETY: all places are in the table.
        Some(places) => unsafe { _mm256_i32gather_epi32::<4>(table.as_ptr().cast(), places) },
        None => _mm256_setzero_si256(),
    }
}

#[inline]
#[target_feature(enable = "avx2,bmi1")]
fn gather_floats(table: &[f32], places: __m256i, mask: __m256, otherwise: __m256) -> __m256 {
    match within(table.len(), places) {
        // SAFETY: all places are in the table.
        Some(places) => unsafe {
            _mm256_mask_i32gather_ps::<4>(otherwise, table.as_ptr(), places, mask)
        },
        None => _mm256_andnot_ps(mask, otherwise),
    }
}

#[inline]
#[target_feature(enable = "avx2,bmi1")]
fn quads(table: &[f32], places: __m256i) -> [__m256; 4] {
    let Some(places) = within(table.len().saturating_sub(3), places) else {
        return [_mm256_setzero_ps(); 4];
    };
    let mut firsts = [0_u32; LANES];
    // SAFETY: the array has as many bytes.
    unsafe { _mm256_storeu_si256(firsts.as_mut_ptr().cast(), places) };
    // SAFETY: from each place on there are four in the table.
    let four = |lane: usize| unsafe { _mm_loadu_ps(table.as_ptr().add(firsts[lane] as usize)) };
    let both = |lane: usize| _mm256_set_m128(four(lane + 4), four(lane));
    let [a, b, c, d] = [both(0), both(1), both(2), both(3)];
    let (low, high) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
    let (then_low, then_high) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
    [
        _mm256_shuffle_ps::<0x44>(low, then_low),
        _mm256_shuffle_ps::<0xee>(low, then_low),
        _mm256_shuffle_ps::<0x44>(high, then_high),
        _mm256_shuffle_ps::<0xee>(high, then_high),
    ]
}

/// One of the instructions, or a few of them.
macro_rules! operations {
    ($($name:ident($($value:ident: $type:ty),*) -> $result:ty $body:block)*) => {
        $(
            #[inline(always)]
            fn $name(self, $($value: $type),*) -> $result {
                // SAFETY: `self` proves that the instructions exist; what is loaded and stored are whole arrays.
                unsafe { $body }
            }
        )*
    };
}

impl Simd for Avx2 {
    type Floats = __m256;
    type Ints = __m256i;
    type Mask = __m256;

    operations! {
        load(lanes: &Lanes) -> __m256 { _mm256_loadu_ps(lanes.as_ptr()) }
        store(values: __m256) -> Lanes {
            let mut lanes = [0.0; LANES];
            _mm256_storeu_ps(lanes.as_mut_ptr(), values);
            lanes
        }
        splat(value: f32) -> __m256 { _mm256_set1_ps(value) }
        splat_int(value: u32) -> __m256i { _mm256_set1_epi32(value.cast_signed()) }
        add(a: __m256, b: __m256) -> __m256 { _mm256_add_ps(a, b) }
        sub(a: __m256, b: __m256) -> __m256 { _mm256_sub_ps(a, b) }
        mul(a: __m256, b: __m256) -> __m256 { _mm256_mul_ps(a, b) }
        div(a: __m256, b: __m256) -> __m256 { _mm256_div_ps(a, b) }
        min(a: __m256, b: __m256) -> __m256 { _mm256_min_ps(a, b) }
        max(a: __m256, b: __m256) -> __m256 { _mm256_max_ps(a, b) }
        abs(value: __m256) -> __m256 { _mm256_andnot_ps(_mm256_set1_ps(-0.0), value) }
        floor(value: __m256) -> __m256 { _mm256_floor_ps(value) }
        with_sign(value: __m256, sign: __m256) -> __m256 {
            let bit = _mm256_set1_ps(-0.0);
            _mm256_or_ps(_mm256_and_ps(bit, sign), _mm256_andnot_ps(bit, value))
        }
        less(a: __m256, b: __m256) -> __m256 { _mm256_cmp_ps::<_CMP_LT_OQ>(a, b) }
        at_most(a: __m256, b: __m256) -> __m256 { _mm256_cmp_ps::<_CMP_LE_OQ>(a, b) }
        select(mask: __m256, yes: __m256, no: __m256) -> __m256 { _mm256_blendv_ps(no, yes, mask) }
        and(a: __m256, b: __m256) -> __m256 { _mm256_and_ps(a, b) }
        or(a: __m256, b: __m256) -> __m256 { _mm256_or_ps(a, b) }
        and_not(a: __m256, b: __m256) -> __m256 { _mm256_andnot_ps(b, a) }
        none() -> __m256 { _mm256_setzero_ps() }
        bits(mask: __m256) -> u32 { _mm256_movemask_ps(mask).cast_unsigned() }
        whole(value: __m256) -> __m256i { _mm256_cvttps_epi32(value) }
        add_ints(a: __m256i, b: __m256i) -> __m256i { _mm256_add_epi32(a, b) }
        where_set(mask: __m256, values: __m256i) -> __m256i {
            _mm256_and_si256(_mm256_castps_si256(mask), values)
        }
        less_ints(a: __m256i, b: __m256i) -> __m256 {
            _mm256_castsi256_ps(_mm256_cmpgt_epi32(b, a))
        }
        gather_ints(table: &[u32], places: __m256i) -> __m256i { gather_ints(table, places) }
        gather_floats(table: &[f32], places: __m256i, mask: __m256, otherwise: __m256) -> __m256 {
            gather_floats(table, places, mask, otherwise)
        }
        quads(table: &[f32], places: __m256i) -> [__m256; 4] { quads(table, places) }
    }
}
