//! The binary tree: obvhs decides which boxes belong together.
//!
//! PLOC (Meister and Bittner, "Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy Construction", TVCG
//! 2018) and reinsertion (Meister and Bittner, "Parallel Reinsertion for Bounding Volume Hierarchy Optimization", CGF
//! 2018). Only the topology is taken from obvhs; bounds are calculated here, from the boxes as they are.

use obvhs::{
    bvh2::reinsertion::ReinsertionOptimizer,
    ploc::{PlocBuilder, PlocSearchDistance, SortPrecision},
};

use crate::Aabb;

/// A binary tree whose leaves are single items. Node 0 is the root; children come after their parents.
pub(crate) struct BinaryTree {
    pub(crate) nodes: Vec<BinaryNode>,
}

#[derive(Clone, Copy)]
pub(crate) struct BinaryNode {
    pub(crate) bounds: Aabb,
    /// Number of items below.
    pub(crate) items: u32,
    pub(crate) kind: BinaryKind,
}

#[derive(Clone, Copy)]
pub(crate) enum BinaryKind {
    Leaf { item: u32 },
    Inner { children: [u32; 2] },
}

/// Deeper trees are built anew as balanced ones, so that traversal stacks have a bound.
pub(crate) const MAX_DEPTH: usize = 96;

impl BinaryTree {
    /// The tree over some boxes, at least one. `effort` is the share of nodes that reinsertion looks at in each pass.
    pub(crate) fn new(boxes: &[Aabb], effort: f32) -> Self {
        let mut topology = obvhs_topology(boxes, effort);
        if topology.depth() > MAX_DEPTH {
            topology = balanced_topology(boxes);
        }
        Self::with_bounds(&topology, boxes)
    }

    /// A tree whose depth is the logarithm of the number of boxes, rounded up; slower to trace.
    #[cfg(feature = "gpu")]
    pub(crate) fn balanced(boxes: &[Aabb]) -> Self {
        Self::with_bounds(&balanced_topology(boxes), boxes)
    }

    fn with_bounds(topology: &Topology, boxes: &[Aabb]) -> Self {
        let bounds = vec![Aabb::EMPTY; topology.0.len()];
        let mut nodes: Vec<BinaryNode> = topology
            .0
            .iter()
            .zip(bounds)
            .map(|(&kind, bounds)| BinaryNode {
                bounds,
                items: 1,
                kind,
            })
            .collect();
        for index in (0..nodes.len()).rev() {
            let (bounds, items) = match nodes[index].kind {
                BinaryKind::Leaf { item } => (boxes[item as usize], 1),
                BinaryKind::Inner { children } => {
                    let [left, right] = children.map(|child| nodes[child as usize]);
                    (left.bounds.union(&right.bounds), left.items + right.items)
                }
            };
            (nodes[index].bounds, nodes[index].items) = (bounds, items);
        }
        Self { nodes }
    }
}

/// Nodes in an order in which children come after their parents.
struct Topology(Vec<BinaryKind>);

impl Topology {
    fn depth(&self) -> usize {
        let mut depths = vec![0; self.0.len()];
        for (index, kind) in self.0.iter().enumerate() {
            if let BinaryKind::Inner { children } = kind {
                for &child in children {
                    depths[child as usize] = depths[index] + 1;
                }
            }
        }
        depths.into_iter().max().unwrap_or(0)
    }
}

fn obvhs_topology(boxes: &[Aabb], effort: f32) -> Topology {
    let boxes = normalised(boxes);
    let items = (0..boxes.len() as u32).collect();
    let mut tree = PlocBuilder::with_capacity(boxes.len()).build(
        PlocSearchDistance::Medium,
        &boxes,
        items,
        SortPrecision::U64,
        0,
    );
    // obvhs's reinsertion has a stack for this depth.
    if tree.max_depth <= MAX_DEPTH {
        ReinsertionOptimizer::default().run(&mut tree, effort, None);
    }
    let mut nodes = Vec::with_capacity(tree.nodes.len());
    let mut pending = vec![(0, None)];
    while let Some((index, parent)) = pending.pop() {
        let node: &obvhs::bvh2::node::Bvh2Node = &tree.nodes[index as usize];
        let place = nodes.len() as u32;
        if let Some((parent, side)) = parent
            && let BinaryKind::Inner { children } = &mut nodes[parent as usize]
        {
            children[side] = place;
        }
        if node.is_leaf() {
            nodes.push(BinaryKind::Leaf {
                item: node.first_index,
            });
        } else {
            nodes.push(BinaryKind::Inner { children: [0; 2] });
            pending.push((node.first_index + 1, Some((place, 1))));
            pending.push((node.first_index, Some((place, 0))));
        }
    }
    Topology(nodes)
}

/// Boxes moved and scaled into the unit cube, so that areas neither overflow nor underflow, each grown by up to 1 %
/// of its size: among boxes of exactly equal costs, as in regular grids or piles of copies, obvhs would find only
/// one pair per pass.
fn normalised(boxes: &[Aabb]) -> Vec<obvhs::aabb::Aabb> {
    let all = boxes.iter().fold(Aabb::EMPTY, |all, one| all.union(one));
    let (low, high) = (all.min.as_dvec3(), all.max.as_dvec3());
    let scale = 1.0 / (high - low).max_element().max(f64::MIN_POSITIVE);
    let mut state = 0_u32;
    boxes
        .iter()
        .map(|one| {
            // Numerical Recipes' quick generator.
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let random = f64::from(state >> 8) / f64::from(1 << 24);
            let (min, max) = (one.min.as_dvec3() - low, one.max.as_dvec3() - low);
            let growth = 0.005 * random * (max - min).max_element();
            obvhs::aabb::Aabb::new(
                ((min - growth) * scale).as_vec3a(),
                ((max + growth) * scale).as_vec3a(),
            )
        })
        .collect()
}

/// Halves by the median of the middles along the longest axis: slower to trace, but its depth is logarithmic.
fn balanced_topology(boxes: &[Aabb]) -> Topology {
    let mut items: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut nodes = vec![BinaryKind::Leaf { item: 0 }];
    let mut pending = vec![(0, 0..items.len())];
    while let Some((place, range)) = pending.pop() {
        let part = &mut items[range.clone()];
        if let [item] = part {
            nodes[place] = BinaryKind::Leaf { item: *item };
            continue;
        }
        let middle = |item: u32| boxes[item as usize].center();
        let extent = Aabb::around(part.iter().map(|&item| middle(item)));
        let axis = (extent.max - extent.min).max_position();
        let half = part.len() / 2;
        part.select_nth_unstable_by(half, |&a, &b| {
            let key = |item: u32| (middle(item)[axis], item);
            let (a, b) = (key(a), key(b));
            a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
        });
        let first = nodes.len() as u32;
        nodes[place] = BinaryKind::Inner {
            children: [first, first + 1],
        };
        nodes.extend([BinaryKind::Leaf { item: 0 }; 2]);
        let split = range.start + half;
        pending.push((first as usize, range.start..split));
        pending.push((first as usize + 1, split..range.end));
    }
    Topology(nodes)
}
