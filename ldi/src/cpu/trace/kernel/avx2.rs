//! AVX2.
#![expect(unsafe_code, reason = "SIMD intrinsics")]

use std::arch::x86_64::*;

use isophote_scene::Shear;

use super::{Kernel, READ};
use crate::cpu::maps::{Block, LANES, Packing};

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

/// How a register of 8 or 4 layers is filled and read.
#[derive(Clone, Copy)]
pub(crate) struct LayerRegisters {
    /// Of which byte of its half each byte is.
    places: __m256i,
    /// Where the second half begins, bytes.
    half: usize,
    near: __m128i,
    far: __m128i,
    /// Ones where a depth is.
    depth: __m256i,
}

impl Kernel for Avx2 {
    type Triangles = Triangles;
    type Layers = LayerRegisters;

    #[inline(always)]
    fn layers(self, packing: Packing) -> LayerRegisters {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { layers(packing) }
    }

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
    fn narrow(self, how: &LayerRegisters, bytes: &[u8; READ], low: u32, high: u32) -> u32 {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { narrow(how, bytes, low, high) }
    }

    #[inline(always)]
    fn wide(self, how: &LayerRegisters, bytes: &[u8; READ], low: u32, high: u32) -> u32 {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { wide(how, bytes, low, high) }
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

/// For each number of bytes the places of those of 4 layers, or of 2 that take more than 4; 0x80 gives a zero.
const PLACES: [[u8; 16]; 9] = {
    let mut all = [[0x80; 16]; 9];
    let mut size = 2;
    while size <= 8 {
        let lane = if size <= 4 { 4 } else { 8 };
        let mut byte = 0;
        while byte < 16 {
            if byte % lane < size {
                all[size][byte] = (byte / lane * size + byte % lane) as u8;
            }
            byte += 1;
        }
        size += 1;
    }
    all
};

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn layers(packing: Packing) -> LayerRegisters {
    let size = packing.bytes() as usize;
    // SAFETY: the pointer is of a whole array.
    let places = unsafe { _mm_loadu_si128(PLACES[size].as_ptr().cast()) };
    let [near, far] = packing
        .shifts()
        .map(|shift| _mm_cvtsi32_si128(shift as i32));
    let steps = packing.depth_steps() - 1;
    let (half, depth) = if size <= 4 {
        (4 * size, _mm256_set1_epi32(steps as i32))
    } else {
        (2 * size, _mm256_set1_epi64x(steps.into()))
    };
    LayerRegisters {
        places: _mm256_broadcastsi128_si256(places),
        half,
        near,
        far,
        depth,
    }
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn spread(how: &LayerRegisters, bytes: &[u8; READ]) -> __m256i {
    debug_assert!(how.half <= 16, "both halves lie in the bytes");
    let start = bytes.as_ptr();
    // SAFETY: 16 bytes at the start, and at most 16 further on, lie in the array of 32.
    let (low, high) = unsafe {
        (
            _mm_loadu_si128(start.cast()),
            _mm_loadu_si128(start.add(how.half).cast()),
        )
    };
    _mm256_shuffle_epi8(_mm256_set_m128i(high, low), how.places)
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn narrow(how: &LayerRegisters, bytes: &[u8; READ], low: u32, high: u32) -> u32 {
    let words = spread(how, bytes);
    let near = _mm256_srl_epi32(words, how.near);
    let far = _mm256_and_si256(_mm256_srl_epi32(words, how.far), how.depth);
    let behind = _mm256_cmpgt_epi32(near, _mm256_set1_epi32(high as i32));
    let before = _mm256_cmpgt_epi32(_mm256_set1_epi32(low as i32), far);
    let apart = _mm256_castsi256_ps(_mm256_or_si256(behind, before));
    !(_mm256_movemask_ps(apart) as u32) & 0xff
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn wide(how: &LayerRegisters, bytes: &[u8; READ], low: u32, high: u32) -> u32 {
    let words = spread(how, bytes);
    let near = _mm256_srl_epi64(words, how.near);
    let far = _mm256_and_si256(_mm256_srl_epi64(words, how.far), how.depth);
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
