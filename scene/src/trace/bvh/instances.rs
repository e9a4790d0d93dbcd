//! Two levels: a tree for each mesh in its own space, shared by the mesh's instances, and above them a tree over the
//! instances' boxes in the world.
//!
//! A ray that meets an instance's box is taken into the mesh's space to find the leaves it meets there. A leaf's
//! triangles are then placed in the world, by the operations and in the order in which
//! [`instance_triangles`] places them, and tested with the world's ray. So an answer has the bits that one
//! flattened tree gives, provided that no leaf is missed.
//!
//! # Why no leaf is missed
//! Notation as in `slabs`. The transform is x ↦ Ax + T, B = A⁻¹; |·| of a matrix or a vector is taken by element. V is the
//! largest |vertex| on each axis, K the row sums of |B|: what is 1 long in the world on every axis is at most K in the mesh's
//! space. There, the ray may be off by:
//! - K·8uM + |B|·4u(|A|V + |T|): a hit that the triangle test accepts lies within 8uM (`slabs`) of a triangle of placed
//!   corners, which are off Ax + T by three rounded products and three rounded sums.
//! - (K·5uM) + |B|·5u(|o| + |T|): the ray's direction, o − T, and B are rounded to 32 bits, and products with B have
//!   three more roundings.
//! - |B|·u/2·(|A|V + |T|): B is calculated in 64 bits, its cofactors exactly but for the last rounding. Its determinant is
//!   right to 2⁻²⁶, because a matrix whose determinant cancels by more than 2⁻²⁴ is not inverted here (see below).
//! - 5u(M' + |o'|) by the slab test (`slabs`), by axis, for the origin o' and the distance M' in the mesh's space. There
//!   M' ≤ |o'| + V and |o'| ≤ |B|(|o| + |T|).
//!
//! Together less than K·13u(M + |o|) + K·2u|o| + |B|(5u|A|V + 20u|T|) + 5uV. What is taken is K times the padding in the world,
//! which is 16u(M + |o|), and `slack`: |B|(8u|A|V + 24u|T|) + 8uV.
//!
//! Instances that cannot be traced so have a tree of their own in the world: those whose transform flattens them, or nearly
//! so that the inverse means nothing, and those of which an element or its inverse is beyond 10²⁴.

use std::borrow::Borrow;

use glam::{Affine3A, DMat3, DVec3, Mat3A, Vec3, Vec3A};
use rayon::prelude::*;

use super::{
    Structure,
    binary::BinaryTree,
    blocks::{Block, Triangle},
    kernel::Kernel,
    slabs::{Slabs, padding},
    traverse::{Visitor, walk},
    triangles::{Aim, Found, Place, Question, TriangleTree, World},
    wide::{Costs, WideTree},
    world_tree,
};
use crate::{
    Aabb, Ray, Scene, Selection, SurfaceId,
    trace::brute_force::{instance_triangles, is_within},
};

/// Trees of meshes under a tree of instances.
#[derive(Clone, Debug)]
pub(crate) struct InstanceTree {
    top: WideTree,
    /// The leaves of `top`.
    leaves: Vec<Leaf>,
    /// One per mesh; empty where no instance needs it.
    meshes: Vec<MeshTree>,
    /// Triangles that do not touch this are not selected.
    bounds: Option<Aabb>,
}

/// The tree of a mesh in its own space.
#[derive(Clone, Debug)]
struct MeshTree {
    tree: TriangleTree,
    /// Boxes that hold all triangles between them.
    parts: Vec<Aabb>,
}

#[derive(Clone, Debug)]
enum Leaf {
    Placed(Placed),
    /// A tree in the world.
    Alone(Box<TriangleTree>),
}

/// An instance of a mesh that has a tree.
#[derive(Clone, Debug)]
struct Placed {
    transform: Affine3A,
    /// From the world's vectors to the mesh's: B.
    inverse: Mat3A,
    /// Padding in the mesh's space for each metre of padding in the world: K.
    spread: Vec3A,
    /// Padding in the mesh's space that does not depend on the ray.
    slack: Vec3A,
    instance: u32,
    mesh: u32,
    /// Whether some triangles may lie outside the selected bounds.
    is_cut: bool,
}

impl InstanceTree {
    /// The trees of the meshes that selected instances have, and the instances placed.
    pub(crate) fn new(scene: &Scene, transforms: &[Affine3A], selection: &Selection) -> Self {
        let mut selected = vec![None; scene.meshes.len()];
        for (index, instance) in scene.instances.iter().enumerate() {
            if instance.mask.contains(selection.mask) {
                selected[instance.mesh as usize] = Some(index);
            }
        }
        let mut tree = Self {
            top: WideTree::empty(),
            leaves: Vec::new(),
            meshes: selected
                .into_par_iter()
                .map(|instance| MeshTree::new(scene, instance))
                .collect(),
            bounds: selection.bounds,
        };
        tree.place(scene, transforms, selection);
        tree
    }

    /// Places the instances anew.
    pub(crate) fn place(&mut self, scene: &Scene, transforms: &[Affine3A], selection: &Selection) {
        let (boxes, leaves): (Vec<Aabb>, Vec<Leaf>) = transforms
            .par_iter()
            .enumerate()
            .filter_map(|(index, transform)| self.leaf(scene, index, transform, selection))
            .unzip();
        self.leaves = leaves;
        self.top = if boxes.is_empty() {
            WideTree::empty()
        } else {
            let costs = Costs {
                node: 1.0,
                leaf_items: 1,
            };
            let binary = BinaryTree::new(&boxes, 0.2);
            WideTree::collapse(&binary, &costs, &mut |items| items[0] as usize)
        };
    }

    /// An instance's box in the world and how it is traced; nothing if no ray can hit it.
    fn leaf(
        &self,
        scene: &Scene,
        index: usize,
        transform: &Affine3A,
        selection: &Selection,
    ) -> Option<(Aabb, Leaf)> {
        let instance = &scene.instances[index];
        let mesh = &self.meshes[instance.mesh as usize];
        let is_point = transform.matrix3 == Mat3A::ZERO;
        if !instance.mask.contains(selection.mask) || mesh.parts.is_empty() || is_point {
            return None;
        }
        let Some((mut placed, bounds)) = Placed::new(transform, mesh) else {
            let tree = world_tree(
                scene,
                instance_triangles(scene, index, *transform, selection),
            );
            return (!tree.is_empty()).then(|| (tree.tree.bounds, Leaf::Alone(Box::new(tree))));
        };
        if let Some(selected) = selection.bounds {
            if !selected.overlaps(&bounds) {
                return None;
            }
            placed.is_cut = selected.union(&bounds) != selected;
        }
        (placed.instance, placed.mesh) = (index as u32, instance.mesh);
        Some((bounds, Leaf::Placed(placed)))
    }

    pub(crate) fn bytes(&self) -> usize {
        let leaf = |leaf: &Leaf| match leaf {
            Leaf::Placed(_) => 0,
            Leaf::Alone(tree) => size_of_val(&**tree) + tree.bytes(),
        };
        let mesh = |mesh: &MeshTree| mesh.tree.bytes() + size_of_val(&mesh.parts[..]);
        self.top.bytes()
            + size_of_val(&self.leaves[..])
            + self.leaves.iter().map(leaf).sum::<usize>()
            + size_of_val(&self.meshes[..])
            + self.meshes.iter().map(mesh).sum::<usize>()
    }
}

impl MeshTree {
    /// The tree of an instance's mesh; empty without one.
    fn new(scene: &Scene, instance: Option<usize>) -> Self {
        let triangles = |index: usize| {
            let mesh = scene.mesh(&scene.instances[index]);
            (0..mesh.triangles.len()).map(move |primitive| {
                let surface = SurfaceId {
                    instance: index as u32,
                    primitive: primitive as u32,
                };
                Triangle {
                    corners: mesh.corners(primitive),
                    surface,
                    masked: scene.is_masked(surface),
                }
            })
        };
        let triangles: Vec<Triangle> = instance.into_iter().flat_map(triangles).collect();
        let tree = TriangleTree::new(&triangles);
        Self {
            parts: tree.tree.parts(),
            tree,
        }
    }
}

impl Placed {
    /// A mesh placed by a transform, and its box in the world; nothing if the transform cannot be undone. Which
    /// instance it is remains to be said.
    fn new(transform: &Affine3A, mesh: &MeshTree) -> Option<(Self, Aabb)> {
        let matrix = transform.matrix3.as_dmat3();
        let inverse = inverse(matrix)?;
        let translation = transform.translation.as_dvec3();
        let all = mesh.tree.tree.bounds;
        let largest = all.min.abs().max(all.max.abs()).as_dvec3();
        let reach = matrix.abs() * largest;
        // Twice that of a placed corner.
        let rounding = 8.0 * UNIT * (reach + translation.abs()) + f64::from(f32::MIN_POSITIVE);
        let mut bounds = Aabb::EMPTY;
        for part in &mesh.parts {
            let (min, max) = (part.min.as_dvec3(), part.max.as_dvec3());
            let center = matrix * (0.5 * (min + max)) + translation;
            let half = matrix.abs() * (0.5 * (max - min)) + rounding;
            bounds.grow(rounded(center - half, f32::next_down));
            bounds.grow(rounded(center + half, f32::next_up));
        }
        let slack = inverse.abs() * (rounding + 16.0 * UNIT * translation.abs());
        let up = |padding: DVec3| Vec3A::from(rounded(padding, f32::next_up));
        let placed = Self {
            transform: *transform,
            inverse: inverse.as_mat3().into(),
            spread: up(inverse.abs() * DVec3::ONE),
            slack: up(slack + 8.0 * UNIT * largest),
            instance: 0,
            mesh: 0,
            is_cut: false,
        };
        let is_finite =
            bounds.min.is_finite() && bounds.max.is_finite() && placed.slack.is_finite();
        is_finite.then_some((placed, bounds))
    }
}

/// The largest relative error of one rounding to 32 bits: u.
const UNIT: f64 = f32::EPSILON as f64 / 2.0;

/// The inverse, if it means anything (see the module).
fn inverse(matrix: DMat3) -> Option<DMat3> {
    const LARGEST: f64 = 1e24;
    let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let cofactors = [y.cross(z), z.cross(x), x.cross(y)];
    let determinant = x.dot(cofactors[0]);
    let uncancelled = x.abs().dot(cofactors[0].abs());
    let is_certain = determinant.abs() > uncancelled * 2_f64.powi(-24);
    let [x, y, z] = cofactors.map(|row| row / determinant);
    let inverse = DMat3::from_cols(x, y, z).transpose();
    let is_moderate = |matrix: DMat3| {
        let columns = matrix.abs().to_cols_array();
        columns.into_iter().all(|element| element <= LARGEST)
    };
    (is_certain && is_moderate(matrix) && is_moderate(inverse)).then_some(inverse)
}

fn rounded(vector: DVec3, away: impl Fn(f32) -> f32) -> Vec3 {
    Vec3::from_array(vector.as_vec3().to_array().map(away))
}

impl Structure for InstanceTree {
    #[inline(always)]
    fn trace<const ANY: bool, K: Kernel>(
        &self,
        kernel: K,
        ray: &Ray,
        question: &Question,
        found: &mut Found,
    ) {
        let slabs = Slabs::new(ray, &self.top.bounds);
        let scale = ray.direction.abs().max_element();
        let limit = slabs.limit(found.t);
        let mut visitor = Instances::<ANY, K> {
            tree: self,
            aim: &Aim::new(kernel, ray, question.leaves),
            direction: Vec3A::from(ray.direction) / scale,
            padding: padding(ray.origin.into(), &self.top.bounds),
            ray,
            slabs: &slabs,
            question,
            found,
        };
        if ANY {
            walk::<false, K>(kernel, &self.top, &slabs, limit, &mut visitor);
        } else {
            walk::<true, K>(kernel, &self.top, &slabs, limit, &mut visitor);
        }
    }
}

struct Instances<'a, const ANY: bool, K: Kernel> {
    tree: &'a InstanceTree,
    aim: &'a Aim<K>,
    /// In the units of `slabs`.
    direction: Vec3A,
    /// Of boxes in the world.
    padding: f32,
    ray: &'a Ray,
    slabs: &'a Slabs,
    question: &'a Question<'a>,
    found: &'a mut Found,
}

impl<const ANY: bool, K: Kernel> Visitor for Instances<'_, ANY, K> {
    #[inline(always)]
    fn leaf(&mut self, leaf: usize, limit: &mut f32) -> bool {
        let ended = match self.tree.leaves.get(leaf) {
            None => false,
            Some(Leaf::Placed(placed)) => {
                let mesh = &self.tree.meshes[placed.mesh as usize].tree;
                let entered = Entered {
                    placed,
                    slabs: self.taken_into(placed),
                    bounds: self.tree.bounds.as_ref().filter(|_| placed.is_cut),
                };
                mesh.search::<ANY, K>(self.aim, &entered, self.question, self.found)
            }
            Some(Leaf::Alone(tree)) => {
                let world = World(&Slabs::new(self.ray, &tree.tree.bounds));
                tree.search::<ANY, K>(self.aim, &world, self.question, self.found)
            }
        };
        *limit = self.slabs.limit(self.found.t);
        ended
    }
}

impl<const ANY: bool, K: Kernel> Instances<'_, ANY, K> {
    /// The ray in the space of an instance's mesh.
    #[inline(always)]
    fn taken_into(&self, placed: &Placed) -> Slabs {
        let origin = Vec3A::from(self.ray.origin) - placed.transform.translation;
        self.slabs.taken_to(
            placed.inverse * origin,
            placed.inverse * self.direction,
            placed.spread * self.padding + placed.slack,
            placed.spread,
        )
    }
}

/// A mesh's tree that a ray has entered.
struct Entered<'a> {
    placed: &'a Placed,
    slabs: Slabs,
    bounds: Option<&'a Aabb>,
}

impl Place for Entered<'_> {
    #[inline(always)]
    fn slabs(&self) -> &Slabs {
        &self.slabs
    }

    #[inline(always)]
    fn limit(&self, t: f32) -> f32 {
        self.slabs.limit(t)
    }

    #[inline(always)]
    fn block<K: Kernel>(&self, kernel: K, block: &Block) -> impl Borrow<Block> {
        kernel.placed(&self.placed.transform, block)
    }

    #[inline(always)]
    fn surface(&self, surface: SurfaceId) -> SurfaceId {
        SurfaceId {
            instance: self.placed.instance,
            ..surface
        }
    }

    #[inline(always)]
    fn selects(&self, block: &Block, lane: usize) -> bool {
        let coordinate = block.triangle(lane);
        let corner =
            |corner: usize| Vec3::from_array([0, 1, 2].map(|axis| coordinate(corner, axis)));
        self.bounds.is_none() || is_within(self.bounds, [0, 1, 2].map(corner))
    }
}
