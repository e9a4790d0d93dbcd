//! AVX2.
#![expect(unsafe_code, reason = "SIMD intrinsics")]

use std::arch::x86_64::*;

use glam::Vec2;
use isophote_scene::{Ray, Shear};

use super::{Kernel, READ};
use crate::{
    Directions,
    cpu::{
        maps::{Block, LANES, Packing},
        trace::path::{Entrance, LEAST_SLOPE, Path},
    },
    directions::{BEND, axes},
};

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
    fn nearest(self, directions: Directions, rays: &[Ray; 8]) -> [u16; 8] {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { nearest(directions, rays) }
    }

    #[inline(always)]
    fn paths(self, map: &Entrance<'_>, rays: [&Ray; 4]) -> [Option<Path>; 4] {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { paths(map, rays) }
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

/// The numbers of four rays: in the low halves origin and `t_min`, in the high halves direction and `t_max`.
#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn transposed(rays: [&Ray; 4]) -> [__m256; 4] {
    const { assert!(size_of::<Ray>() == 32) };
    // SAFETY: a ray is eight floats.
    let [a, b, c, d] = rays.map(|ray| unsafe { _mm256_loadu_ps((&raw const *ray).cast()) });
    let (ab, cd) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
    let (ab_high, cd_high) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
    [
        _mm256_shuffle_ps::<0x44>(ab, cd),
        _mm256_shuffle_ps::<0xee>(ab, cd),
        _mm256_shuffle_ps::<0x44>(ab_high, cd_high),
        _mm256_shuffle_ps::<0xee>(ab_high, cd_high),
    ]
}

/// The twin of [`Directions::nearest`].
#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn nearest(directions: Directions, rays: &[Ray; 8]) -> [u16; 8] {
    let [r0, r1, r2, r3, r4, r5, r6, r7] = rays;
    let (low, high) = (transposed([r0, r1, r2, r3]), transposed([r4, r5, r6, r7]));
    let axis = |axis: usize| _mm256_permute2f128_ps::<0x31>(low[axis], high[axis]);
    let (x, y, z) = (axis(0), axis(1), axis(2));
    let sign = _mm256_set1_ps(-0.0);
    let abs = |v: __m256| _mm256_andnot_ps(sign, v);
    let at_least = |a: __m256, b: __m256| _mm256_cmp_ps::<_CMP_GE_OQ>(abs(a), abs(b));
    let is_x = _mm256_and_ps(at_least(x, y), at_least(x, z));
    let is_y = _mm256_andnot_ps(is_x, at_least(y, z));
    let choose =
        |of_x, of_y, of_z| _mm256_blendv_ps(_mm256_blendv_ps(of_z, of_y, is_y), of_x, is_x);
    let one = _mm256_set1_ps(1.0);
    let scale = _mm256_div_ps(one, choose(x, y, z));
    let (b, c) = (choose(y, z, x), choose(z, x, y));
    let half = _mm256_set1_ps(0.5);
    let count = _mm256_set1_ps(directions.cells() as f32);
    let last = _mm256_set1_epi32(directions.cells() as i32 - 1);
    let cell = |p: __m256| {
        let p = _mm256_mul_ps(p, scale);
        let bend = _mm256_mul_ps(_mm256_set1_ps(BEND), abs(p));
        let bent = _mm256_mul_ps(p, _mm256_sub_ps(_mm256_set1_ps(1.0 + BEND), bend));
        let place = _mm256_mul_ps(_mm256_add_ps(_mm256_mul_ps(half, bent), half), count);
        let cell = _mm256_cvttps_epi32(place);
        _mm256_min_epi32(_mm256_max_epi32(cell, _mm256_setzero_si256()), last)
    };
    let cells = _mm256_set1_epi32(directions.cells() as i32);
    let number = |value| _mm256_castsi256_ps(_mm256_set1_epi32(value));
    let axis = _mm256_castps_si256(choose(number(0), number(1), number(2)));
    let row = _mm256_add_epi32(_mm256_mullo_epi32(axis, cells), cell(b));
    let map = _mm256_add_epi32(_mm256_mullo_epi32(row, cells), cell(c));
    let mut maps = [0_u32; 8];
    // SAFETY: the pointer is of a whole array.
    unsafe { _mm256_storeu_si256(maps.as_mut_ptr().cast(), map) };
    maps.map(|map| map as u16)
}

/// The twin of [`Path::new`], operation by operation.
#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn paths(map: &Entrance<'_>, rays: [&Ray; 4]) -> [Option<Path>; 4] {
    let rows = transposed(rays);
    let low = |row: usize| _mm256_cvtps_pd(_mm256_castps256_ps128(rows[row]));
    let high = |row: usize| _mm256_cvtps_pd(_mm256_extractf128_ps::<1>(rows[row]));
    let set = |value: f64| _mm256_set1_pd(value);
    let zero = _mm256_setzero_pd();
    let sign_bit = set(-0.0);
    let [a, b, c] = axes(map.axis);
    let frame = map.frame;
    let [slope_x, slope_y] = frame.slope.map(|value| set(f64::from(value)));
    let (from, to) = (frame.low.map(f64::from), frame.scale.map(f64::from));
    let sheared =
        |v: __m256d, slope: __m256d, z: __m256d| _mm256_sub_pd(v, _mm256_mul_pd(slope, z));
    let placed =
        |v: __m256d, axis: usize| _mm256_mul_pd(_mm256_sub_pd(v, set(from[axis])), set(to[axis]));
    let z = low(a);
    let place_x = placed(sheared(low(b), slope_x, z), 0);
    let place_y = placed(sheared(low(c), slope_y, z), 1);
    let place_z = placed(z, 2);
    let turn = high(a);
    let turn_x = _mm256_mul_pd(sheared(high(b), slope_x, turn), set(to[0]));
    let turn_y = _mm256_mul_pd(sheared(high(c), slope_y, turn), set(to[1]));
    let turn_z = _mm256_mul_pd(turn, set(to[2]));
    let speed = _mm256_andnot_pd(sign_bit, turn_z);
    let sign = _mm256_or_pd(_mm256_and_pd(sign_bit, turn_z), set(1.0));
    let steep = |turn: __m256d| {
        let slope = _mm256_div_pd(turn, speed);
        let tiny = _mm256_cmp_pd::<_CMP_LT_OQ>(_mm256_andnot_pd(sign_bit, slope), set(LEAST_SLOPE));
        _mm256_blendv_pd(slope, set(LEAST_SLOPE), tiny)
    };
    let (across, up) = (steep(turn_x), steep(turn_y));
    let (inverse_x, inverse_y) = (_mm256_div_pd(set(1.0), across), _mm256_div_pd(set(1.0), up));
    let [side, depth] = map.sides.map(|side| set(f64::from(side)));
    let ends = |place: __m256d, slope: __m256d, inverse: __m256d| {
        let positive = _mm256_cmp_pd::<_CMP_GT_OQ>(slope, zero);
        let near = _mm256_sub_pd(_mm256_blendv_pd(side, zero, positive), place);
        let far = _mm256_sub_pd(_mm256_blendv_pd(zero, side, positive), place);
        (_mm256_mul_pd(near, inverse), _mm256_mul_pd(far, inverse))
    };
    let (near_x, far_x) = ends(place_x, across, inverse_x);
    let (near_y, far_y) = ends(place_y, up, inverse_y);
    let forward = _mm256_cmp_pd::<_CMP_GT_OQ>(sign, zero);
    let (before, behind) = (_mm256_sub_pd(zero, place_z), _mm256_sub_pd(depth, place_z));
    let near_z = _mm256_blendv_pd(_mm256_sub_pd(place_z, depth), before, forward);
    let far_z = _mm256_blendv_pd(place_z, behind, forward);
    let first = _mm256_max_pd(_mm256_mul_pd(low(3), speed), _mm256_max_pd(near_x, near_y));
    let offset = _mm256_max_pd(first, near_z);
    let last = _mm256_min_pd(_mm256_mul_pd(high(3), speed), _mm256_min_pd(far_x, far_y));
    let end = _mm256_min_pd(last, far_z);
    let touches = _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(offset, end));
    let start = |place: __m256d, slope: __m256d| _mm256_add_pd(place, _mm256_mul_pd(slope, offset));
    let narrow = [
        start(place_x, across),
        start(place_y, up),
        inverse_x,
        inverse_y,
        start(place_z, sign),
        sign,
        _mm256_sub_pd(end, offset),
    ];
    let (mut singles, mut doubles) = ([[0.0_f32; 4]; 7], [[0.0_f64; 4]; 2]);
    for (single, value) in singles.iter_mut().zip(narrow) {
        // SAFETY: the pointer is of a whole array.
        unsafe { _mm_storeu_ps(single.as_mut_ptr(), _mm256_cvtpd_ps(value)) };
    }
    for (double, value) in doubles.iter_mut().zip([speed, offset]) {
        // SAFETY: the pointer is of a whole array.
        unsafe { _mm256_storeu_pd(double.as_mut_ptr(), value) };
    }
    let path = |lane: usize| {
        (touches >> lane & 1 != 0 && rays[lane].is_valid()).then(|| Path {
            start: Vec2::new(singles[0][lane], singles[1][lane]),
            inverse: Vec2::new(singles[2][lane], singles[3][lane]),
            depth: singles[4][lane],
            sign: singles[5][lane],
            end: singles[6][lane],
            speed: doubles[0][lane],
            offset: doubles[1][lane],
            last: map.sides[0] as i32 - 1,
            last_depth: (f64::from(map.sides[1]) - 1.0) as f32,
        })
    };
    [path(0), path(1), path(2), path(3)]
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
