//! AVX2.
#![expect(unsafe_code, reason = "SIMD intrinsics")]

use std::arch::x86_64::*;

use isophote_scene::Shear;

use super::Kernel;
use crate::cpu::maps::{Block, LANES};

/// Proof that the processor has AVX2, FMA, BMI1, BMI2 and LZCNT.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2(());

impl Avx2 {
    pub(crate) fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt"))
        .then_some(Self(()))
    }
}

#[derive(Clone, Copy)]
pub(crate) struct Triangles {
    origin: [__m256; 3],
    slope: [__m256; 2],
    axes: [usize; 3],
}

impl Kernel for Avx2 {
    type Triangles = Triangles;

    #[inline(always)]
    fn triangles(self, shear: &Shear) -> Triangles {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { triangles(shear) }
    }

    #[inline(always)]
    fn fetch<T>(self, place: *const T) {
        // SAFETY: prefetching any address is harmless.
        unsafe { _mm_prefetch::<_MM_HINT_ET0>(place.cast()) }
    }

    #[inline(always)]
    fn narrow(self, layers: &[u32; 8], low: u32, high: u32) -> u32 {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { narrow(layers, low, high) }
    }

    #[inline(always)]
    fn wide(self, layers: &[u64; 4], low: u32, high: u32) -> u32 {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { wide(layers, low, high) }
    }

    #[inline(always)]
    fn candidates(self, ray: &Triangles, block: &Block) -> u32 {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { candidates(ray, block) }
    }
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn triangles(shear: &Shear) -> Triangles {
    Triangles {
        origin: shear.origin.map(|value| _mm256_set1_ps(value)),
        slope: shear.slope.map(|value| _mm256_set1_ps(value)),
        axes: shear.axes,
    }
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn narrow(layers: &[u32; 8], low: u32, high: u32) -> u32 {
    // SAFETY: the pointer is of a whole array.
    let words = unsafe { _mm256_loadu_si256(layers.as_ptr().cast()) };
    let near = _mm256_srli_epi32::<24>(words);
    let far = _mm256_srli_epi32::<24>(_mm256_slli_epi32::<8>(words));
    let behind = _mm256_cmpgt_epi32(near, _mm256_set1_epi32(high as i32));
    let before = _mm256_cmpgt_epi32(_mm256_set1_epi32(low as i32), far);
    let apart = _mm256_castsi256_ps(_mm256_or_si256(behind, before));
    !(_mm256_movemask_ps(apart) as u32) & 0xff
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn wide(layers: &[u64; 4], low: u32, high: u32) -> u32 {
    // SAFETY: the pointer is of a whole array.
    let words = unsafe { _mm256_loadu_si256(layers.as_ptr().cast()) };
    let near = _mm256_srli_epi64::<48>(words);
    let far = _mm256_srli_epi64::<48>(_mm256_slli_epi64::<16>(words));
    let behind = _mm256_cmpgt_epi64(near, _mm256_set1_epi64x(i64::from(high)));
    let before = _mm256_cmpgt_epi64(_mm256_set1_epi64x(i64::from(low)), far);
    let apart = _mm256_castsi256_pd(_mm256_or_si256(behind, before));
    !(_mm256_movemask_pd(apart) as u32) & 0xf
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn load(lanes: &[f32; LANES]) -> __m256 {
    // SAFETY: the pointer is of a whole array.
    unsafe { _mm256_loadu_ps(lanes.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn candidates(ray: &Triangles, block: &Block) -> u32 {
    let [kx, ky, kz] = ray.axes;
    let sheared = |corner: &[[f32; LANES]; 3]| {
        let x = _mm256_sub_ps(load(&corner[kx]), ray.origin[0]);
        let y = _mm256_sub_ps(load(&corner[ky]), ray.origin[1]);
        let z = _mm256_sub_ps(load(&corner[kz]), ray.origin[2]);
        // No fused multiply-add: see `Shear`.
        (
            _mm256_sub_ps(x, _mm256_mul_ps(ray.slope[0], z)),
            _mm256_sub_ps(y, _mm256_mul_ps(ray.slope[1], z)),
        )
    };
    let edge = |(px, py): (__m256, __m256), (qx, qy): (__m256, __m256)| {
        _mm256_sub_ps(_mm256_mul_ps(px, qy), _mm256_mul_ps(py, qx))
    };
    let [a, b, c] = &block.corners;
    let (a, b, c) = (sheared(a), sheared(b), sheared(c));
    let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
    let low = _mm256_min_ps(_mm256_min_ps(u, v), w);
    let high = _mm256_max_ps(_mm256_max_ps(u, v), w);
    let zero = _mm256_setzero_ps();
    _mm256_movemask_ps(_mm256_or_ps(
        _mm256_cmp_ps::<_CMP_GE_OQ>(low, zero),
        _mm256_cmp_ps::<_CMP_LE_OQ>(high, zero),
    )) as u32
}
