//! The exact tracer.
//!
//! 1. `binary`: obvhs finds which triangles belong together (PLOC and reinsertion).
//! 2. `wide`: the binary tree is collapsed into nodes of eight children and leaves of up to eight triangles.
//! 3. `traverse`: a ray walks the tree, nearest children first; `slabs` says why no hit is lost on the way.
//! 4. `kernel`: eight boxes or triangles are tested at once, with AVX2 where the processor has it.
//! 5. `boxes`: leaves may stand for the boxes around their triangles ([`Leaves`]).
//! 6. `instances`: a tree over trees, for meshes that are placed often or move ([`Levels`]).
//!
//! With triangles, answers are exactly those of [`BruteForceTracer`](crate::BruteForceTracer), bit by bit, with one
//! level or two.

pub(crate) mod binary;
mod blocks;
mod boxes;
mod instances;
mod kernel;
mod slabs;
mod traverse;
mod triangles;
pub(crate) mod wide;

use std::sync::Arc;

use glam::Affine3A;

use self::{
    blocks::Triangle,
    instances::InstanceTree,
    kernel::{Kernel, Portable},
    triangles::{Found, Question, TriangleTree},
};
use super::{
    Answers, BuildTracer, Hit, Ray, Selection, SurfaceId, Tracer,
    brute_force::{WorldTriangle, check_transforms, instance_triangles, world_triangles},
};
use crate::{Error, Result, Scene};

/// What can be chosen when building a [`BvhTracer`].
#[derive(Clone, Debug, Default)]
pub struct BvhOptions {
    /// How instances are held. The answers do not depend on it.
    pub levels: Levels,
    /// What rays are tested against.
    pub leaves: Leaves,
}

/// What a [`BvhTracer`] tests rays against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Leaves {
    /// Triangles: exact.
    #[default]
    Triangles,
    /// The boxes around triangles in the world: imperfect visibility (MS10 §4.1). A box is hit where the ray enters it,
    /// unless it contains either end of the ray. Answers [`Distance`](Answers::Distance); what masks cut away counts.
    Boxes,
}

/// How a [`BvhTracer`] holds instances.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Levels {
    /// [`Two`](Self::Two) where [`Flat`](Self::Flat) would hold more than 200,000 triangles (some 20 MB) and at least four
    /// times as many as the meshes of the selected instances have; otherwise `Flat`.
    #[default]
    Auto,
    /// One tree over the triangles of all instances: faster to trace where meshes are placed once, as a ray need not be
    /// taken to each instance that it may hit.
    Flat,
    /// A tree for each mesh and one over the instances: every mesh is held once, however often it is placed, and
    /// [`update`](BuildTracer::update) rebuilds only the tree over the instances. Where flattening would take much memory
    /// this is also faster to trace. Only an instance whose transform cannot be undone, or only just, has its
    /// triangles held on its own.
    Two,
}

impl Levels {
    fn are_two(self, scene: &Scene, selection: &Selection) -> bool {
        const FEW: usize = 200_000;
        let (mut placed, mut held) = (0_usize, 0);
        let mut is_held = vec![false; scene.meshes.len()];
        for instance in &scene.instances {
            if instance.mask.contains(selection.mask) {
                let count = scene.mesh(instance).triangles.len();
                placed = placed.saturating_add(count);
                if !std::mem::replace(&mut is_held[instance.mesh as usize], true) {
                    held += count;
                }
            }
        }
        match self {
            Self::Auto => placed > FEW && placed / 4 >= held,
            Self::Flat => false,
            Self::Two => true,
        }
    }
}

/// Finds exactly what [`BruteForceTracer`](crate::BruteForceTracer) finds, fast, by a bounding volume hierarchy; or the
/// boxes around triangles ([`Leaves::Boxes`]).
#[derive(Clone, Debug)]
pub struct BvhTracer {
    scene: Arc<Scene>,
    selection: Selection,
    tree: Arc<Tree>,
    leaves: Leaves,
    #[cfg(target_arch = "x86_64")]
    avx2: Option<kernel::Avx2>,
}

#[derive(Clone, Debug)]
enum Tree {
    Flat(TriangleTree),
    Two(InstanceTree),
}

/// What rays can be traced through.
trait Structure {
    /// Puts a hit better than `found` there (`ANY`: any before it). The ray must be valid.
    fn trace<const ANY: bool, K: Kernel>(
        &self,
        kernel: K,
        ray: &Ray,
        question: &Question,
        found: &mut Found,
    );
}

/// The tree over triangles in the world.
fn world_tree(scene: &Scene, triangles: impl IntoIterator<Item = WorldTriangle>) -> TriangleTree {
    let triangles: Vec<Triangle> = triangles
        .into_iter()
        .map(|triangle| Triangle {
            corners: triangle.corners,
            surface: triangle.surface,
            masked: scene.is_masked(triangle.surface),
        })
        .collect();
    TriangleTree::new(&triangles)
}

/// Whether any triangle is selected.
fn is_any_selected(scene: &Scene, transforms: &[Affine3A], selection: &Selection) -> bool {
    let mut instances = transforms.iter().enumerate();
    instances.any(|(instance, transform)| {
        let mut triangles = instance_triangles(scene, instance, *transform, selection);
        triangles.next().is_some()
    })
}

impl BvhTracer {
    /// The same tree, asked for other leaves: nothing is built or copied, until one of the two is moved.
    #[must_use]
    pub fn with_leaves(&self, leaves: Leaves) -> Self {
        Self {
            leaves,
            ..self.clone()
        }
    }

    #[inline(always)]
    fn trace_with<const ANY: bool, K: Kernel>(
        &self,
        kernel: K,
        tree: &impl Structure,
        ray: &Ray,
        start: SurfaceId,
    ) -> Found {
        let question = Question {
            scene: &self.scene,
            t_min: ray.t_min,
            start,
            leaves: self.leaves,
        };
        let mut found = Found::nothing(ray.t_max);
        if ray.is_valid() {
            tree.trace::<ANY, K>(kernel, ray, &question, &mut found);
        }
        found
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
    fn trace_avx2<const ANY: bool>(
        &self,
        avx2: kernel::Avx2,
        tree: &impl Structure,
        ray: &Ray,
        start: SurfaceId,
    ) -> Found {
        self.trace_with::<ANY, _>(avx2, tree, ray, start)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
    fn trace_all_avx2<const ANY: bool, T>(
        &self,
        avx2: kernel::Avx2,
        tree: &impl Structure,
        rays: &[Ray],
        answers: &mut [T],
        answer: fn(&Found) -> T,
    ) {
        for (ray, slot) in rays.iter().zip(answers) {
            *slot = answer(&self.trace_with::<ANY, _>(avx2, tree, ray, SurfaceId::UNKNOWN));
        }
    }

    #[inline]
    fn trace_in<const ANY: bool>(
        &self,
        tree: &impl Structure,
        ray: &Ray,
        start: SurfaceId,
    ) -> Found {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            #[expect(unsafe_code, reason = "SIMD instructions")]
            // SAFETY: the token proves that the instructions exist.
            return unsafe { self.trace_avx2::<ANY>(avx2, tree, ray, start) };
        }
        self.trace_with::<ANY, _>(Portable, tree, ray, start)
    }

    fn trace_all_in<const ANY: bool, T>(
        &self,
        tree: &impl Structure,
        rays: &[Ray],
        answers: &mut [T],
        answer: fn(&Found) -> T,
    ) {
        assert_eq!(rays.len(), answers.len(), "one answer per ray");
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            #[expect(unsafe_code, reason = "SIMD instructions")]
            // SAFETY: the token proves that the instructions exist.
            return unsafe { self.trace_all_avx2::<ANY, T>(avx2, tree, rays, answers, answer) };
        }
        for (ray, slot) in rays.iter().zip(answers) {
            *slot = answer(&self.trace_with::<ANY, _>(Portable, tree, ray, SurfaceId::UNKNOWN));
        }
    }

    #[inline]
    fn trace<const ANY: bool>(&self, ray: &Ray, start: SurfaceId) -> Found {
        match &*self.tree {
            Tree::Flat(tree) => self.trace_in::<ANY>(tree, ray, start),
            Tree::Two(tree) => self.trace_in::<ANY>(tree, ray, start),
        }
    }

    fn trace_all<const ANY: bool, T>(
        &self,
        rays: &[Ray],
        answers: &mut [T],
        answer: fn(&Found) -> T,
    ) {
        match &*self.tree {
            Tree::Flat(tree) => self.trace_all_in::<ANY, T>(tree, rays, answers, answer),
            Tree::Two(tree) => self.trace_all_in::<ANY, T>(tree, rays, answers, answer),
        }
    }
}

impl Tracer for BvhTracer {
    fn answers(&self) -> Answers {
        match self.leaves {
            Leaves::Triangles => Answers::Surface,
            Leaves::Boxes => Answers::Distance,
        }
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

    fn build(scene: &Arc<Scene>, selection: &Selection, options: &BvhOptions) -> Result<Self> {
        let transforms = scene.transforms();
        if !is_any_selected(scene, &transforms, selection) {
            return Err(Error::NoGeometry {
                reason: "no triangle is selected".into(),
            });
        }
        let tree = if options.levels.are_two(scene, selection) {
            Tree::Two(InstanceTree::new(scene, &transforms, selection))
        } else {
            Tree::Flat(world_tree(
                scene,
                world_triangles(scene, &transforms, selection),
            ))
        };
        Ok(Self {
            scene: scene.clone(),
            selection: *selection,
            tree: Arc::new(tree),
            leaves: options.leaves,
            #[cfg(target_arch = "x86_64")]
            avx2: kernel::Avx2::detect(),
        })
    }

    fn update(&mut self, transforms: &[Affine3A]) -> Result<()> {
        check_transforms(&self.scene, transforms)?;
        match Arc::make_mut(&mut self.tree) {
            Tree::Flat(tree) => {
                let triangles = world_triangles(&self.scene, transforms, &self.selection);
                *tree = world_tree(&self.scene, triangles);
            }
            Tree::Two(tree) => tree.place(&self.scene, transforms, &self.selection),
        }
        Ok(())
    }

    fn bytes(&self) -> usize {
        match &*self.tree {
            Tree::Flat(tree) => tree.bytes(),
            Tree::Two(tree) => tree.bytes(),
        }
    }
}

#[cfg(test)]
mod tests;
