//! A tree over triangles.

use std::borrow::Borrow;

use glam::Vec2;
use rayon::prelude::*;

use super::{
    Leaves, Structure,
    binary::BinaryTree,
    blocks::{Block, Blocks, LANES, Triangle},
    boxes::{BoxRay, Boxes},
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
    /// The tree over some triangles.
    pub(crate) fn new(triangles: &[Triangle]) -> Self {
        let mut blocks = Blocks::default();
        if triangles.is_empty() {
            let tree = WideTree::empty();
            return Self { tree, blocks };
        }
        let boxes: Vec<Aabb> = triangles
            .par_iter()
            .map(|triangle| Aabb::around(triangle.corners))
            .collect();
        let binary = BinaryTree::new(&boxes, 0.2);
        let costs = Costs {
            node: 1.0,
            leaf_items: LANES as u32,
        };
        let tree = WideTree::collapse(&binary, &costs, &mut |items| {
            blocks.push(items.iter().map(|&item| triangles[item as usize]));
            blocks.blocks.len() - 1
        });
        blocks.shrink();
        Self { tree, blocks }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.blocks.blocks.is_empty()
    }

    pub(crate) fn bytes(&self) -> usize {
        self.tree.bytes() + self.blocks.bytes()
    }

    /// Looks for a hit better than `found` (`ANY`: for any hit before it) and puts it there. Returns whether no other is
    /// asked for.
    #[inline(always)]
    pub(crate) fn search<const ANY: bool, K: Kernel>(
        &self,
        aim: &Aim<K>,
        place: &impl Place,
        question: &Question,
        found: &mut Found,
    ) -> bool {
        let limit = place.limit(found.t);
        if let Some(ray) = &aim.boxes {
            let mut visitor = Boxes::<ANY, _, _> {
                kernel: aim.kernel,
                ray,
                blocks: &self.blocks,
                place,
                question,
                found,
            };
            return if ANY {
                walk::<false, K>(aim.kernel, &self.tree, place.slabs(), limit, &mut visitor)
            } else {
                walk::<true, K>(aim.kernel, &self.tree, place.slabs(), limit, &mut visitor)
            };
        }
        let mut visitor = Triangles::<ANY, _, _> {
            blocks: &self.blocks,
            aim,
            place,
            question,
            found,
        };
        if ANY {
            walk::<false, K>(aim.kernel, &self.tree, place.slabs(), limit, &mut visitor)
        } else {
            walk::<true, K>(aim.kernel, &self.tree, place.slabs(), limit, &mut visitor)
        }
    }
}

impl Structure for TriangleTree {
    #[inline(always)]
    fn trace<const ANY: bool, K: Kernel>(
        &self,
        kernel: K,
        ray: &Ray,
        question: &Question,
        found: &mut Found,
    ) {
        let world = World(&Slabs::new(ray, &self.tree.bounds));
        let aim = Aim::new(kernel, ray, question.leaves);
        self.search::<ANY, K>(&aim, &world, question, found);
    }
}

/// A ray made ready for the tests of leaves, which are always done in the world.
pub(crate) struct Aim<K: Kernel> {
    pub(crate) kernel: K,
    shear: Shear,
    wide: K::Triangles,
    /// Where boxes are asked for.
    boxes: Option<BoxRay>,
}

impl<K: Kernel> Aim<K> {
    #[inline(always)]
    pub(crate) fn new(kernel: K, ray: &Ray, leaves: Leaves) -> Self {
        let shear = Shear::new(ray);
        Self {
            kernel,
            shear,
            wide: kernel.triangles(&shear),
            boxes: (leaves == Leaves::Boxes).then(|| BoxRay::new(ray)),
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
    pub(crate) leaves: Leaves,
}

/// How a tree lies in the world.
pub(crate) trait Place {
    /// The ray in the tree's space.
    fn slabs(&self) -> &Slabs;

    /// A distance along the world's ray in the units of [`slabs`](Self::slabs), rounded up.
    fn limit(&self, t: f32) -> f32;

    /// A block's triangles in the world.
    fn block<K: Kernel>(&self, kernel: K, block: &Block) -> impl Borrow<Block>;

    /// What a triangle of the tree is in the scene.
    fn surface(&self, surface: SurfaceId) -> SurfaceId;

    /// Whether a triangle in the world is selected.
    fn selects(&self, block: &Block, lane: usize) -> bool;
}

/// The tree is in the world itself, and holds what is selected.
pub(crate) struct World<'a>(pub(crate) &'a Slabs);

impl Place for World<'_> {
    #[inline(always)]
    fn slabs(&self) -> &Slabs {
        self.0
    }

    #[inline(always)]
    fn limit(&self, t: f32) -> f32 {
        self.0.limit(t)
    }

    #[inline(always)]
    fn block<K: Kernel>(&self, _: K, block: &Block) -> impl Borrow<Block> {
        block
    }

    #[inline(always)]
    fn surface(&self, surface: SurfaceId) -> SurfaceId {
        surface
    }

    #[inline(always)]
    fn selects(&self, _: &Block, _: usize) -> bool {
        true
    }
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

    /// A hit.
    #[inline(always)]
    pub(crate) fn at(t: f32, uv: Vec2, surface: SurfaceId) -> Self {
        Self {
            t,
            uv,
            surface: Some(surface),
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

struct Triangles<'a, const ANY: bool, K: Kernel, P: Place> {
    blocks: &'a Blocks,
    aim: &'a Aim<K>,
    place: &'a P,
    question: &'a Question<'a>,
    found: &'a mut Found,
}

impl<const ANY: bool, K: Kernel, P: Place> Visitor for Triangles<'_, ANY, K, P> {
    #[inline(always)]
    fn leaf(&mut self, leaf: usize, limit: &mut f32) -> bool {
        let Some(block) = self.blocks.blocks.get(leaf) else {
            return false;
        };
        let block = self.place.block(self.aim.kernel, block);
        let block = block.borrow();
        let mut candidates = self.aim.kernel.candidates(&self.aim.wide, block);
        while candidates != 0 {
            let lane = candidates.trailing_zeros() as usize & (LANES - 1);
            candidates &= candidates - 1;
            let Some((t, uv)) = self.aim.shear.intersect_candidate(block.triangle(lane)) else {
                continue;
            };
            if !(t > self.question.t_min && t <= self.found.t) {
                continue;
            }
            let surfaces = &self.blocks.surfaces[leaf];
            let surface = self.place.surface(surfaces.surfaces[lane]);
            if surface == self.question.start
                || !self.found.is_worse_than(t, surface)
                || !self.place.selects(block, lane)
                || (surfaces.masked >> lane & 1 != 0
                    && !self.question.scene.alpha_passes(surface, uv))
            {
                continue;
            }
            *self.found = Found::at(t, uv, surface);
            if ANY {
                return true;
            }
            *limit = self.place.limit(t);
        }
        false
    }
}
