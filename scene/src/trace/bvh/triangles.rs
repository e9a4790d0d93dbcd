//! A tree over triangles.

use glam::Vec2;
use rayon::prelude::*;

use super::{
    binary::BinaryTree,
    blocks::{Blocks, LANES, Triangle},
    kernel::Kernel,
    slabs::Slabs,
    traverse::{Visitor, walk},
    wide::{Costs, WideTree},
};
use crate::{Aabb, Hit, Ray, Scene, SurfaceId, trace::triangle::Shear};

/// A tree whose leaves are blocks of triangles, all in one space.
#[derive(Clone, Debug)]
pub(crate) struct TriangleTree {
    pub(crate) tree: WideTree,
    blocks: Blocks,
}

impl TriangleTree {
    /// The tree over some triangles, at least one.
    pub(crate) fn new(triangles: &[Triangle]) -> Self {
        let boxes: Vec<Aabb> = triangles
            .par_iter()
            .map(|triangle| Aabb::around(triangle.corners))
            .collect();
        let binary = BinaryTree::new(&boxes, 0.2);
        let mut blocks = Blocks::default();
        let costs = Costs {
            node: 1.0,
            leaf_items: LANES as u32,
        };
        let tree = WideTree::collapse(&binary, &costs, &mut |items| {
            blocks.push(items.iter().map(|&item| triangles[item as usize]));
            blocks.blocks.len() - 1
        });
        Self { tree, blocks }
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.tree.nodes[..]) + self.blocks.bytes()
    }

    /// Looks for a hit better than `found` (`ANY`: for any hit before it) and puts it there. A tree that stands for an
    /// `instance` has its triangles' primitives only.
    #[inline(always)]
    pub(crate) fn trace<const ANY: bool, K: Kernel>(
        &self,
        kernel: K,
        ray: &Ray,
        question: &Question,
        instance: Option<u32>,
        found: &mut Found,
    ) -> bool {
        let slabs = Slabs::new(ray, &self.tree.bounds, 1.0);
        let shear = Shear::new(ray);
        let limit = slabs.limit(found.t);
        let mut visitor = Triangles::<ANY, K> {
            kernel,
            blocks: &self.blocks,
            slabs: &slabs,
            shear: &shear,
            wide: kernel.triangles(&shear),
            question,
            instance,
            found,
        };
        if ANY {
            walk::<false, K>(kernel, &self.tree, &slabs, limit, &mut visitor)
        } else {
            walk::<true, K>(kernel, &self.tree, &slabs, limit, &mut visitor)
        }
    }
}

/// What is the same for all triangles of a query.
#[derive(Clone, Copy)]
pub(crate) struct Question<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) t_min: f32,
    /// A triangle that is not hit.
    pub(crate) start: SurfaceId,
}

/// The closest hit so far, or where the ray ends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found {
    pub(crate) t: f32,
    uv: Vec2,
    surface: Option<SurfaceId>,
}

impl Found {
    /// Nothing yet.
    pub(crate) fn nothing(t_max: f32) -> Self {
        Self {
            t: t_max,
            uv: Vec2::ZERO,
            surface: None,
        }
    }

    pub(crate) fn hit(&self) -> Option<Hit> {
        self.surface.map(|surface| Hit {
            t: self.t,
            uv: self.uv,
            surface,
        })
    }

    /// Of hits at the same distance the first in scene order counts, so that answers do not depend on the tree.
    #[inline(always)]
    fn is_worse_than(&self, t: f32, surface: SurfaceId) -> bool {
        t < self.t || (t == self.t && self.surface.is_some_and(|found| surface < found))
    }
}

struct Triangles<'a, const ANY: bool, K: Kernel> {
    kernel: K,
    blocks: &'a Blocks,
    slabs: &'a Slabs,
    shear: &'a Shear,
    wide: K::Triangles,
    question: &'a Question<'a>,
    instance: Option<u32>,
    found: &'a mut Found,
}

impl<const ANY: bool, K: Kernel> Visitor for Triangles<'_, ANY, K> {
    #[inline(always)]
    fn leaf(&mut self, leaf: usize, limit: &mut f32) -> bool {
        let block = &self.blocks.blocks[leaf];
        let mut candidates = self.kernel.candidates(&self.wide, block);
        while candidates != 0 {
            let lane = candidates.trailing_zeros() as usize & (LANES - 1);
            candidates &= candidates - 1;
            let Some((t, uv)) = self.shear.intersect_candidate(block.triangle(lane)) else {
                continue;
            };
            if !(t > self.question.t_min && t <= self.found.t) {
                continue;
            }
            let surfaces = &self.blocks.surfaces[leaf];
            let mut surface = surfaces.surfaces[lane];
            if let Some(instance) = self.instance {
                surface.instance = instance;
            }
            if surface == self.question.start
                || !self.found.is_worse_than(t, surface)
                || (surfaces.masked >> lane & 1 != 0
                    && !self.question.scene.alpha_passes(surface, uv))
            {
                continue;
            }
            *self.found = Found {
                t,
                uv,
                surface: Some(surface),
            };
            if ANY {
                return true;
            }
            *limit = self.slabs.limit(t);
        }
        false
    }
}
