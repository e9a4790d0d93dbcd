//! The tree that rays walk: nodes with eight children, leaves with blocks of triangles.
//!
//! A binary tree is collapsed so that the expected cost of a ray is least (surface area heuristic), by the dynamic
//! programme of Ylitie, Karras, Laine: "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", HPG
//! 2017, §3.1.

use bytemuck::Zeroable;
use glam::Vec3;

use super::binary::{BinaryKind, BinaryNode, BinaryTree};
use crate::Aabb;

/// Children of a node.
pub(crate) const WIDTH: usize = 8;

/// Eight boxes and what is in them.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Zeroable)]
pub(crate) struct Node {
    /// By axis, lower and upper face, child. The boxes of missing children are inside out.
    pub(crate) bounds: [[[f32; WIDTH]; 2]; 3],
    pub(crate) children: [Child; WIDTH],
}

/// The index of a node, or of a leaf.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Zeroable)]
#[repr(transparent)]
pub(crate) struct Child(u32);

impl Child {
    const LEAF: u32 = 1 << 31;

    /// No child: a leaf that no tree has. The box is inside out, yet a ray whose numbers overflow may meet it.
    const MISSING: Self = Self(u32::MAX);

    pub(crate) fn node(index: usize) -> Self {
        Self(index as u32)
    }

    pub(crate) fn leaf(index: usize) -> Self {
        Self(index as u32 | Self::LEAF)
    }

    #[inline]
    pub(crate) fn bits(self) -> u32 {
        self.0
    }

    #[inline]
    pub(crate) fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    #[inline]
    pub(crate) fn is_leaf(self) -> bool {
        self.0 & Self::LEAF != 0
    }

    #[inline]
    pub(crate) fn index(self) -> usize {
        (self.0 & !Self::LEAF) as usize
    }
}

/// The nodes of a tree; what its leaves are is known to who built it.
#[derive(Clone, Debug)]
pub(crate) struct WideTree {
    pub(crate) nodes: Vec<Node>,
    pub(crate) bounds: Aabb,
}

/// What a collapse weighs.
pub(crate) struct Costs {
    /// Of a node, relative to a leaf.
    pub(crate) node: f32,
    /// Most items in a leaf.
    pub(crate) leaf_items: u32,
}

impl WideTree {
    /// A tree that nothing is in.
    pub(crate) fn empty() -> Self {
        Self {
            nodes: vec![empty_node()],
            bounds: Aabb::around([Vec3::ZERO]),
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..])
    }

    /// The boxes two levels down, at most 64: together a closer fit than the box around all.
    pub(crate) fn parts(&self) -> Vec<Aabb> {
        let below = |(child, bounds): (Child, Aabb)| {
            if child.is_leaf() {
                vec![bounds]
            } else {
                children(&self.nodes[child.index()])
                    .map(|(_, bounds)| bounds)
                    .collect()
            }
        };
        children(&self.nodes[0]).flat_map(below).collect()
    }

    /// Collapses a binary tree; `make_leaf` is called with the items of each leaf and returns the leaf's index.
    pub(crate) fn collapse(
        tree: &BinaryTree,
        costs: &Costs,
        make_leaf: &mut dyn FnMut(&[u32]) -> usize,
    ) -> Self {
        let scale = scale(tree);
        let plans = plan(tree, costs, scale);
        let mut nodes = vec![empty_node()];
        let mut pending = vec![(0_u32, 0_usize)];
        let (mut roots, mut items) = (Vec::new(), Vec::new());
        while let Some((binary, place)) = pending.pop() {
            roots.clear();
            if plans[binary as usize].is_leaf {
                // Only the root of a tree that is one leaf.
                roots.push(binary);
            } else {
                distribute(tree, &plans, binary, WIDTH, &mut roots);
            }
            // Any-hit walks visit the children in this order: those that a hit is most likely found in for the work they
            // are, whose area is large for their number of items.
            let promise = |&root: &u32| {
                let node = &tree.nodes[root as usize];
                half_area(&node.bounds, scale) / node.items as f32
            };
            roots.sort_by(|a, b| promise(b).total_cmp(&promise(a)));
            for (slot, &root) in roots.iter().enumerate() {
                let child = if plans[root as usize].is_leaf {
                    items.clear();
                    collect(tree, root, &mut items);
                    Child::leaf(make_leaf(&items))
                } else {
                    nodes.push(empty_node());
                    pending.push((root, nodes.len() - 1));
                    Child::node(nodes.len() - 1)
                };
                set_child(
                    &mut nodes[place],
                    slot,
                    child,
                    &tree.nodes[root as usize].bounds,
                );
            }
        }
        nodes.shrink_to_fit();
        Self {
            nodes,
            bounds: tree.nodes[0].bounds,
        }
    }
}

fn children(node: &Node) -> impl Iterator<Item = (Child, Aabb)> {
    let bounds = |child: usize| {
        let corner = |face: usize| Vec3::from_array(node.bounds.map(|axis| axis[face][child]));
        Aabb {
            min: corner(0),
            max: corner(1),
        }
    };
    (0..WIDTH)
        .filter(|&child| node.children[child] != Child::MISSING)
        .map(move |child| (node.children[child], bounds(child)))
}

fn empty_node() -> Node {
    let (low, high) = ([f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]);
    Node {
        bounds: [[low, high]; 3],
        children: [Child::MISSING; WIDTH],
    }
}

fn set_child(node: &mut Node, slot: usize, child: Child, bounds: &Aabb) {
    for axis in 0..3 {
        node.bounds[axis][0][slot] = bounds.min[axis];
        node.bounds[axis][1][slot] = bounds.max[axis];
    }
    node.children[slot] = child;
}

/// The best ways to represent a binary subtree by wide nodes.
#[derive(Clone, Copy)]
struct Plan {
    is_leaf: bool,
    /// Least cost with at most 1, 2, … roots.
    costs: [f32; WIDTH - 1],
    /// With at most 2, 3, … roots: how many of them go to the left; 0 if one root fewer is as good.
    left: [u8; WIDTH - 1],
}

/// Makes areas relative to the whole, so that they neither overflow nor underflow.
fn scale(tree: &BinaryTree) -> f32 {
    let all = &tree.nodes[0].bounds;
    1.0 / (all.max - all.min).max_element().max(f32::MIN_POSITIVE)
}

fn plan(tree: &BinaryTree, costs: &Costs, scale: f32) -> Vec<Plan> {
    let mut plans = vec![
        Plan {
            is_leaf: true,
            costs: [0.0; WIDTH - 1],
            left: [0; WIDTH - 1],
        };
        tree.nodes.len()
    ];
    for (index, node) in tree.nodes.iter().enumerate().rev() {
        plans[index] = plan_node(node, &plans, costs, scale);
    }
    plans
}

fn plan_node(node: &BinaryNode, plans: &[Plan], costs: &Costs, scale: f32) -> Plan {
    let area = half_area(&node.bounds, scale);
    let fits = node.items <= costs.leaf_items;
    let as_leaf = if fits { area } else { f32::INFINITY };
    let BinaryKind::Inner { children } = node.kind else {
        return Plan {
            is_leaf: true,
            costs: [as_leaf; WIDTH - 1],
            left: [1; WIDTH - 1],
        };
    };
    let [l, r] = children.map(|child| &plans[child as usize].costs);
    let mut left = [1; WIDTH - 1];
    let mut split = [f32::INFINITY; WIDTH - 1];
    for roots in 2..=WIDTH {
        for share in 1..roots {
            let cost = l[share - 1] + r[roots - share - 1];
            if cost < split[roots - 2] {
                (split[roots - 2], left[roots - 2]) = (cost, share as u8);
            }
        }
    }
    let as_node = costs.node * area + split[WIDTH - 2];
    let mut best = [as_leaf.min(as_node); WIDTH - 1];
    for roots in 2..WIDTH {
        if split[roots - 2] < best[roots - 2] {
            best[roots - 1] = split[roots - 2];
        } else {
            (best[roots - 1], left[roots - 2]) = (best[roots - 2], 0);
        }
    }
    Plan {
        is_leaf: fits && as_leaf <= as_node,
        costs: best,
        left,
    }
}

/// The roots of the wide subtrees that represent what is below a binary node with `slots` (at least 2) of them.
fn distribute(tree: &BinaryTree, plans: &[Plan], binary: u32, slots: usize, roots: &mut Vec<u32>) {
    let mut pending = vec![(binary, slots)];
    while let Some((binary, mut slots)) = pending.pop() {
        let plan = &plans[binary as usize];
        while slots > 1 && plan.left[slots - 2] == 0 {
            slots -= 1;
        }
        match tree.nodes[binary as usize].kind {
            BinaryKind::Inner { children } if slots > 1 => {
                let left = usize::from(plan.left[slots - 2]);
                pending.push((children[1], slots - left));
                pending.push((children[0], left));
            }
            _ => roots.push(binary),
        }
    }
}

/// The items below a binary node.
fn collect(tree: &BinaryTree, binary: u32, items: &mut Vec<u32>) {
    let mut pending = vec![binary];
    while let Some(binary) = pending.pop() {
        match tree.nodes[binary as usize].kind {
            BinaryKind::Leaf { item } => items.push(item),
            BinaryKind::Inner { children } => pending.extend(children),
        }
    }
}

fn half_area(bounds: &Aabb, scale: f32) -> f32 {
    let Vec3 { x, y, z } = (bounds.max - bounds.min) * scale;
    x * y + y * z + z * x
}
