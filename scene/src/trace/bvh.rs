//! The exact tracer.
//!
//! 1. `binary`: obvhs finds which triangles belong together (PLOC and reinsertion).
//! 2. `wide`: the binary tree is collapsed into nodes of eight children and leaves of up to eight triangles.
//! 3. `traverse`: a ray walks the tree, nearest children first; `slabs` says why no hit is lost on the way.
//! 4. `kernel`: eight boxes or triangles are tested at once, with AVX2 where the processor has it.
//!
//! Answers are exactly those of [`BruteForceTracer`](crate::BruteForceTracer), bit by bit, where the scene is
//! flattened into one tree.

pub(crate) mod binary;
mod blocks;
mod kernel;
mod slabs;
mod traverse;
mod triangles;
pub(crate) mod wide;

use std::sync::Arc;

use glam::Affine3A;

use self::{
    blocks::Triangle,
    kernel::{Kernel, Portable},
    triangles::{Found, Question, TriangleTree},
};
use super::{
    Answers, BuildTracer, Hit, Ray, Selection, SurfaceId, Tracer,
    brute_force::{check_transforms, world_triangles},
};
use crate::{Error, Result, Scene};

/// What can be chosen when building a [`BvhTracer`].
#[derive(Clone, Debug, Default)]
pub struct BvhOptions {}

/// Finds exactly what [`BruteForceTracer`](crate::BruteForceTracer) finds, fast, by a bounding volume hierarchy.
#[derive(Clone, Debug)]
pub struct BvhTracer {
    scene: Arc<Scene>,
    selection: Selection,
    tree: TriangleTree,
    #[cfg(target_arch = "x86_64")]
    avx2: Option<kernel::Avx2>,
}

fn flat_tree(
    scene: &Scene,
    transforms: &[Affine3A],
    selection: &Selection,
) -> Result<TriangleTree> {
    let triangles: Vec<Triangle> = world_triangles(scene, transforms, selection)
        .into_iter()
        .map(|triangle| Triangle {
            corners: triangle.corners,
            surface: triangle.surface,
            masked: scene.is_masked(triangle.surface),
        })
        .collect();
    if triangles.is_empty() {
        return Err(Error::NoGeometry {
            reason: "no triangle is selected".into(),
        });
    }
    Ok(TriangleTree::new(&triangles))
}

impl BvhTracer {
    #[inline(always)]
    fn trace_with<const ANY: bool, K: Kernel>(
        &self,
        kernel: K,
        ray: &Ray,
        start: SurfaceId,
    ) -> Found {
        let question = Question {
            scene: &self.scene,
            t_min: ray.t_min,
            start,
        };
        let mut found = Found::nothing(ray.t_max);
        if ray.is_valid() {
            self.tree
                .trace::<ANY, K>(kernel, ray, &question, None, &mut found);
        }
        found
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
    fn trace_avx2<const ANY: bool>(
        &self,
        avx2: kernel::Avx2,
        ray: &Ray,
        start: SurfaceId,
    ) -> Found {
        self.trace_with::<ANY, _>(avx2, ray, start)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
    fn trace_all_avx2<const ANY: bool, T>(
        &self,
        avx2: kernel::Avx2,
        rays: &[Ray],
        answers: &mut [T],
        answer: fn(&Found) -> T,
    ) {
        for (ray, slot) in rays.iter().zip(answers) {
            *slot = answer(&self.trace_with::<ANY, _>(avx2, ray, SurfaceId::UNKNOWN));
        }
    }

    #[inline]
    fn trace<const ANY: bool>(&self, ray: &Ray, start: SurfaceId) -> Found {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            #[expect(unsafe_code, reason = "SIMD instructions")]
            // SAFETY: the token proves that the instructions exist.
            return unsafe { self.trace_avx2::<ANY>(avx2, ray, start) };
        }
        self.trace_with::<ANY, _>(Portable, ray, start)
    }

    fn trace_all<const ANY: bool, T>(
        &self,
        rays: &[Ray],
        answers: &mut [T],
        answer: fn(&Found) -> T,
    ) {
        assert_eq!(rays.len(), answers.len(), "one answer per ray");
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            #[expect(unsafe_code, reason = "SIMD instructions")]
            // SAFETY: the token proves that the instructions exist.
            return unsafe { self.trace_all_avx2::<ANY, T>(avx2, rays, answers, answer) };
        }
        for (ray, slot) in rays.iter().zip(answers) {
            *slot = answer(&self.trace_with::<ANY, _>(Portable, ray, SurfaceId::UNKNOWN));
        }
    }
}

impl Tracer for BvhTracer {
    fn answers(&self) -> Answers {
        Answers::Surface
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.trace::<false>(ray, SurfaceId::UNKNOWN).hit()
    }

    fn any_hit(&self, ray: &Ray) -> bool {
        self.trace::<true>(ray, SurfaceId::UNKNOWN).hit().is_some()
    }

    fn closest_hit_from(&self, ray: &Ray, start: SurfaceId) -> Option<Hit> {
        self.trace::<false>(ray, start).hit()
    }

    fn any_hit_from(&self, ray: &Ray, start: SurfaceId) -> bool {
        self.trace::<true>(ray, start).hit().is_some()
    }

    fn closest_hits(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        self.trace_all::<false, _>(rays, hits, Found::hit);
    }

    fn any_hits(&self, rays: &[Ray], hits: &mut [bool]) {
        self.trace_all::<true, _>(rays, hits, |found| found.hit().is_some());
    }
}

impl BuildTracer for BvhTracer {
    type Options = BvhOptions;

    fn build(scene: &Arc<Scene>, selection: &Selection, _: &BvhOptions) -> Result<Self> {
        Ok(Self {
            scene: scene.clone(),
            selection: *selection,
            tree: flat_tree(scene, &scene.transforms(), selection)?,
            #[cfg(target_arch = "x86_64")]
            avx2: kernel::Avx2::detect(),
        })
    }

    fn update(&mut self, transforms: &[Affine3A]) -> Result<()> {
        check_transforms(&self.scene, transforms)?;
        self.tree = flat_tree(&self.scene, transforms, &self.selection)?;
        Ok(())
    }

    fn bytes(&self) -> usize {
        self.tree.bytes()
    }
}

#[cfg(test)]
mod tests;
