//! AVX2 with fused multiply-add.
#![expect(unsafe_code, reason = "SIMD intrinsics")]

use std::{arch::x86_64::*, mem::MaybeUninit};

use glam::{Affine3A, Vec3A};

use super::Kernel;
use crate::trace::{
    bvh::{
        blocks::{Block, LANES},
        slabs::Slabs,
        traverse::Entry,
        wide::{Child, Node, WIDTH},
    },
    triangle::Shear,
};

/// Proof that the processor has AVX2, FMA, BMI1, BMI2 and LZCNT.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2(());

impl Avx2 {
    #[inline]
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
pub(crate) struct Boxes {
    inverse: [__m256; 3],
    near: [__m256; 3],
    far: [__m256; 3],
    down: [usize; 3],
    start: __m256,
}

#[derive(Clone, Copy)]
pub(crate) struct Triangles {
    origin: [__m256; 3],
    slope: [__m256; 2],
    axes: [usize; 3],
}

impl Kernel for Avx2 {
    type Boxes = Boxes;
    type Triangles = Triangles;

    #[inline(always)]
    fn boxes(self, slabs: &Slabs) -> Boxes {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { boxes(slabs) }
    }

    #[inline(always)]
    fn triangles(self, shear: &Shear) -> Triangles {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { triangles(shear) }
    }

    #[inline(always)]
    fn enter(self, ray: &Boxes, node: &Node, limit: f32) -> (u32, [Entry; WIDTH]) {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { enter(ray, node, limit) }
    }

    #[inline(always)]
    fn placed(self, transform: &Affine3A, block: &Block) -> Block {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { placed(transform, block) }
    }

    #[inline(always)]
    fn candidates(self, ray: &Triangles, block: &Block) -> u32 {
        // SAFETY: `self` proves that the instructions exist.
        unsafe { candidates(ray, block) }
    }
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn boxes(slabs: &Slabs) -> Boxes {
    let splat = |v: Vec3A| {
        [
            _mm256_set1_ps(v.x),
            _mm256_set1_ps(v.y),
            _mm256_set1_ps(v.z),
        ]
    };
    Boxes {
        inverse: splat(slabs.inverse),
        near: splat(slabs.near),
        far: splat(slabs.far),
        down: [slabs.down(0), slabs.down(1), slabs.down(2)],
        start: _mm256_set1_ps(slabs.start),
    }
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn triangles(shear: &Shear) -> Triangles {
    let [x, y, z] = shear.origin;
    let [slope_x, slope_y] = shear.slope;
    Triangles {
        origin: [_mm256_set1_ps(x), _mm256_set1_ps(y), _mm256_set1_ps(z)],
        slope: [_mm256_set1_ps(slope_x), _mm256_set1_ps(slope_y)],
        axes: shear.axes,
    }
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn load(lanes: &[f32; 8]) -> __m256 {
    // SAFETY: the pointer is of a whole array.
    unsafe { _mm256_loadu_ps(lanes.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn enter(ray: &Boxes, node: &Node, limit: f32) -> (u32, [Entry; WIDTH]) {
    let plane = |axis: usize, face: usize| load(&node.bounds[axis][face & 1]);
    let near = |axis: usize| {
        let plane = plane(axis, ray.down[axis]);
        _mm256_fmsub_ps(plane, ray.inverse[axis], ray.near[axis])
    };
    let far = |axis: usize| {
        let plane = plane(axis, ray.down[axis] ^ 1);
        _mm256_fmsub_ps(plane, ray.inverse[axis], ray.far[axis])
    };
    let enter = _mm256_max_ps(
        _mm256_max_ps(near(0), near(1)),
        _mm256_max_ps(near(2), ray.start),
    );
    let leave = _mm256_min_ps(
        _mm256_min_ps(far(0), far(1)),
        _mm256_min_ps(far(2), _mm256_set1_ps(limit)),
    );
    let met = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(enter, leave));
    (met as u32, entries(enter, &node.children))
}

/// Distances above children, as in [`Entry`].
#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn entries(enter: __m256, children: &[Child; WIDTH]) -> [Entry; WIDTH] {
    let mut entries = [const { MaybeUninit::<[Entry; 2]>::uninit() }; WIDTH / 2];
    // SAFETY: the pointers are of whole arrays, and all pairs are written.
    unsafe {
        let children = _mm256_loadu_si256(children.as_ptr().cast());
        let enter = _mm256_castps_si256(enter);
        let even = _mm256_unpacklo_epi32(children, enter);
        let odd = _mm256_unpackhi_epi32(children, enter);
        _mm_storeu_si128(entries[0].as_mut_ptr().cast(), _mm256_castsi256_si128(even));
        _mm_storeu_si128(entries[1].as_mut_ptr().cast(), _mm256_castsi256_si128(odd));
        _mm_storeu_si128(
            entries[2].as_mut_ptr().cast(),
            _mm256_extracti128_si256::<1>(even),
        );
        _mm_storeu_si128(
            entries[3].as_mut_ptr().cast(),
            _mm256_extracti128_si256::<1>(odd),
        );
        std::mem::transmute(entries)
    }
}

/// Not fused, and in the order of [`Affine3A::transform_point3`], so that the bits are the same.
#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn placed(transform: &Affine3A, block: &Block) -> Block {
    let columns = transform.matrix3;
    let columns = [columns.x_axis, columns.y_axis, columns.z_axis];
    let mut placed = Block {
        corners: [[[0.0; LANES]; 3]; 3],
    };
    for (from, to) in block.corners.iter().zip(&mut placed.corners) {
        let [x, y, z] = [load(&from[0]), load(&from[1]), load(&from[2])];
        for (axis, lanes) in to.iter_mut().enumerate() {
            let [mx, my, mz] = columns.map(|column| _mm256_set1_ps(column[axis]));
            let sum = _mm256_add_ps(_mm256_mul_ps(mx, x), _mm256_mul_ps(my, y));
            let sum = _mm256_add_ps(sum, _mm256_mul_ps(mz, z));
            let sum = _mm256_add_ps(sum, _mm256_set1_ps(transform.translation[axis]));
            // SAFETY: the pointer is of a whole array.
            unsafe { _mm256_storeu_ps(lanes.as_mut_ptr(), sum) };
        }
    }
    placed
}

#[inline]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
fn candidates(ray: &Triangles, block: &Block) -> u32 {
    let [kx, ky, kz] = ray.axes;
    let sheared = |corner: &[[f32; LANES]; 3]| {
        let x = _mm256_sub_ps(load(&corner[kx]), ray.origin[0]);
        let y = _mm256_sub_ps(load(&corner[ky]), ray.origin[1]);
        let z = _mm256_sub_ps(load(&corner[kz]), ray.origin[2]);
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
