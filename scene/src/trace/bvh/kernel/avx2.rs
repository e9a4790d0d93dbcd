//! AVX2 with fused multiply-add.
#![expect(unsafe_code, reason = "SIMD intrinsics")]

use std::arch::x86_64::*;

use super::Kernel;
use crate::trace::{
    bvh::{
        blocks::{Block, LANES},
        slabs::Slabs,
        wide::{Node, WIDTH},
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
        let splat = |v: f32| unsafe { _mm256_set1_ps(v) };
        Boxes {
            inverse: slabs.inverse.to_array().map(splat),
            near: slabs.near.to_array().map(splat),
            far: slabs.far.to_array().map(splat),
            down: slabs.down.map(usize::from),
            start: splat(slabs.start),
        }
    }

    #[inline(always)]
    fn triangles(self, shear: &Shear) -> Triangles {
        // SAFETY: `self` proves that the instructions exist.
        let splat = |v: f32| unsafe { _mm256_set1_ps(v) };
        Triangles {
            origin: shear.axes.map(|axis| splat(shear.origin[axis])),
            slope: shear.slope.to_array().map(splat),
            axes: shear.axes,
        }
    }

    #[inline(always)]
    fn enter(self, ray: &Boxes, node: &Node, limit: f32) -> (u32, [f32; WIDTH]) {
        // SAFETY: `self` proves that the instructions exist; all pointers are of whole arrays.
        unsafe {
            let plane =
                |axis: usize, face: usize| _mm256_load_ps(node.bounds[axis][face & 1].as_ptr());
            let near = |axis: usize| {
                _mm256_fmsub_ps(
                    plane(axis, ray.down[axis]),
                    ray.inverse[axis],
                    ray.near[axis],
                )
            };
            let far = |axis: usize| {
                _mm256_fmsub_ps(
                    plane(axis, ray.down[axis] ^ 1),
                    ray.inverse[axis],
                    ray.far[axis],
                )
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
            let mut distances = [0.0; WIDTH];
            _mm256_storeu_ps(distances.as_mut_ptr(), enter);
            (met as u32, distances)
        }
    }

    #[inline(always)]
    fn candidates(self, ray: &Triangles, block: &Block) -> u32 {
        // SAFETY: `self` proves that the instructions exist; all pointers are of whole arrays.
        unsafe {
            let [kx, ky, kz] = ray.axes.map(|axis| axis.min(2));
            let load = |lanes: &[f32; LANES]| _mm256_load_ps(lanes.as_ptr());
            let sheared = |corner: usize| {
                let axes = &block.corners[corner];
                let x = _mm256_sub_ps(load(&axes[kx]), ray.origin[0]);
                let y = _mm256_sub_ps(load(&axes[ky]), ray.origin[1]);
                let z = _mm256_sub_ps(load(&axes[kz]), ray.origin[2]);
                (
                    _mm256_sub_ps(x, _mm256_mul_ps(ray.slope[0], z)),
                    _mm256_sub_ps(y, _mm256_mul_ps(ray.slope[1], z)),
                )
            };
            let edge = |(px, py): (__m256, __m256), (qx, qy): (__m256, __m256)| {
                _mm256_sub_ps(_mm256_mul_ps(px, qy), _mm256_mul_ps(py, qx))
            };
            let (a, b, c) = (sheared(0), sheared(1), sheared(2));
            let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
            let low = _mm256_min_ps(_mm256_min_ps(u, v), w);
            let high = _mm256_max_ps(_mm256_max_ps(u, v), w);
            let zero = _mm256_setzero_ps();
            _mm256_movemask_ps(_mm256_or_ps(
                _mm256_cmp_ps::<_CMP_GE_OQ>(low, zero),
                _mm256_cmp_ps::<_CMP_LE_OQ>(high, zero),
            )) as u32
        }
    }
}
