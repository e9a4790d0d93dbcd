//! Nodes of 80 bytes: eight boxes on a grid of 256 steps a side that spans the node, rounded outwards.
//!
//! After Ylitie, Karras, Laine: "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", HPG 2017, §3:
//! children lie in slots so that the slots' numbers, turned by the signs of a ray's direction, are roughly the order
//! in which the ray meets them. What differs: planes are verified after rounding, so that a box is never smaller
//! than what it holds.

use glam::Vec3;

use crate::trace::bvh::wide::{Node, WIDTH, WideTree};

/// Most triangles in a leaf: a slot has three bits for them.
pub(super) const LEAF_ITEMS: usize = 3;

/// The shader's stack is this high.
pub(super) const MAX_DEPTH: usize = 32;

/// A node as the shader reads it.
pub(super) type Words = [[u32; 4]; 5];

/// A tree as the shader reads it.
pub(super) struct Encoded {
    pub(super) nodes: Vec<Words>,
    /// The items of all leaves, in the order in which nodes refer to them.
    pub(super) items: Vec<u32>,
    /// Nodes on the longest way down.
    pub(super) depth: usize,
}

impl Encoded {
    /// Encodes a tree whose leaves hold at most [`LEAF_ITEMS`] items each.
    pub(super) fn new(tree: &WideTree, leaves: &[Vec<u32>]) -> Self {
        let mut encoded = Self {
            nodes: vec![[[0; 4]; 5]],
            items: Vec::new(),
            depth: 0,
        };
        let mut pending = vec![(0_usize, 0_usize, 1_usize)];
        while let Some((source, place, depth)) = pending.pop() {
            encoded.depth = encoded.depth.max(depth);
            let node = &tree.nodes[source];
            let first_child = encoded.nodes.len();
            let mut packed = Packed::new(node, first_child, encoded.items.len());
            for (slot, child) in slots(node).into_iter().enumerate() {
                let Some(child) = child else { continue };
                packed.set_planes(slot, node, child);
                let of = node.children[child];
                if of.is_leaf() {
                    let items = &leaves[of.index()];
                    packed.set_leaf(slot, encoded.items.len(), items.len());
                    encoded.items.extend(items);
                } else {
                    packed.set_inner(slot);
                    pending.push((of.index(), encoded.nodes.len(), depth + 1));
                    encoded.nodes.push([[0; 4]; 5]);
                }
            }
            encoded.nodes[place] = packed.words();
        }
        encoded
    }
}

/// Which child goes to which slot: the one that lies farthest towards the slot's corner of the node first, then the
/// next best pair, and so on.
fn slots(node: &Node) -> [Option<usize>; WIDTH] {
    let middle = |child: usize| {
        Vec3::from_array([0, 1, 2].map(|axis| {
            let [low, high] = node.bounds[axis];
            // Halves first, so that the sum does not overflow.
            0.5 * low[child] + 0.5 * high[child]
        }))
    };
    let children: Vec<usize> = (0..WIDTH)
        .filter(|&child| is_present(node, child))
        .collect();
    let center = children
        .iter()
        .map(|&child| middle(child) / children.len() as f32)
        .sum::<Vec3>();
    let corner = |slot: usize| {
        let side = |bit: usize| if slot & bit == 0 { -1.0 } else { 1.0 };
        Vec3::new(side(1), side(2), side(4))
    };
    let mut pairs: Vec<(f32, usize, usize)> = children
        .iter()
        .flat_map(|&child| (0..WIDTH).map(move |slot| (child, slot)))
        .map(|(child, slot)| ((middle(child) - center).dot(corner(slot)), child, slot))
        .collect();
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut slots = [None; WIDTH];
    for (_, child, slot) in pairs {
        if slots[slot].is_none() && !slots.contains(&Some(child)) {
            slots[slot] = Some(child);
        }
    }
    slots
}

fn is_present(node: &Node, child: usize) -> bool {
    node.bounds[0][0][child] <= node.bounds[0][1][child]
}

/// A node in the making.
struct Packed {
    origin: [f32; 3],
    /// Biased exponents of the steps.
    exponents: [u8; 3],
    first_child: u32,
    first_item: u32,
    inner: u8,
    slots: [u8; WIDTH],
    /// By axis, lower and upper face, slot.
    planes: [[[u8; WIDTH]; 2]; 3],
}

impl Packed {
    fn new(node: &Node, first_child: usize, first_item: usize) -> Self {
        let mut packed = Self {
            origin: [0.0; 3],
            exponents: [1; 3],
            first_child: first_child as u32,
            first_item: first_item as u32,
            inner: 0,
            slots: [0; WIDTH],
            planes: [[[0; WIDTH]; 2]; 3],
        };
        for axis in 0..3 {
            let [low, high] = node.bounds[axis];
            let (low, high) = (
                low.into_iter().fold(f32::INFINITY, f32::min),
                high.into_iter().fold(f32::NEG_INFINITY, f32::max),
            );
            packed.origin[axis] = low;
            // The smallest power of two of which 255 reach across.
            let extent = f64::from(high) - f64::from(low);
            while 255.0 * packed.step(axis) < extent && packed.exponents[axis] < 254 {
                packed.exponents[axis] += 1;
            }
        }
        packed
    }

    fn step(&self, axis: usize) -> f64 {
        f64::from(f32::from_bits(u32::from(self.exponents[axis]) << 23))
    }

    /// The planes of a child, rounded outwards. In 64 bits a plane's distance from the origin is exact, or nearly:
    /// rounding to the grid is checked.
    fn set_planes(&mut self, slot: usize, node: &Node, child: usize) {
        for axis in 0..3 {
            let [low, high] = node.bounds[axis].map(|planes| f64::from(planes[child]));
            let (origin, step) = (f64::from(self.origin[axis]), self.step(axis));
            let mut lower = ((low - origin) / step).floor().clamp(0.0, 255.0);
            while lower > 0.0 && origin + lower * step > low {
                lower -= 1.0;
            }
            let mut upper = ((high - origin) / step).ceil().clamp(0.0, 255.0);
            while upper < 255.0 && origin + upper * step < high {
                upper += 1.0;
            }
            self.planes[axis][0][slot] = lower as u8;
            self.planes[axis][1][slot] = upper as u8;
        }
    }

    /// The upper three bits of a slot say how many items (1, 3, 7) its leaf has, the lower five where they begin.
    fn set_leaf(&mut self, slot: usize, first: usize, count: usize) {
        let offset = (first - self.first_item as usize) as u8;
        self.slots[slot] = (((1_u32 << count) - 1) << 5) as u8 | offset;
    }

    /// An inner node has one bit, at 24 plus its slot.
    fn set_inner(&mut self, slot: usize) {
        self.slots[slot] = 1 << 5 | (24 + slot as u8);
        self.inner |= 1 << slot;
    }

    fn words(&self) -> Words {
        let [x, y, z] = self.origin.map(f32::to_bits);
        let [ex, ey, ez] = self.exponents;
        let four = |bytes: &[u8; WIDTH]| {
            let [a, b, c, d, e, f, g, h] = *bytes;
            [
                u32::from_le_bytes([a, b, c, d]),
                u32::from_le_bytes([e, f, g, h]),
            ]
        };
        let [[lx, ux], [ly, uy], [lz, uz]] =
            self.planes.map(|planes| planes.map(|bytes| four(&bytes)));
        let slots = four(&self.slots);
        [
            [x, y, z, u32::from_le_bytes([ex, ey, ez, self.inner])],
            [self.first_child, self.first_item, slots[0], slots[1]],
            [lx[0], lx[1], ly[0], ly[1]],
            [lz[0], lz[1], ux[0], ux[1]],
            [uy[0], uy[1], uz[0], uz[1]],
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Aabb,
        trace::bvh::{binary::BinaryTree, wide::Costs},
    };

    /// Boxes of very different sizes and places, some flat.
    fn boxes(count: u32) -> Vec<Aabb> {
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        (0..count)
            .map(|_| {
                let center = Vec3::new(
                    random() * 100.0 - 50.0,
                    random() * 3.0 + 1e4,
                    random() * 1e-3,
                );
                let size = Vec3::new(random() * 4.0, 0.0, random() * 1e-5) * random().powi(4);
                Aabb::around([center - size, center + size])
            })
            .collect()
    }

    fn encoded(boxes: &[Aabb]) -> Encoded {
        super::super::encode_tree(&BinaryTree::new(boxes, 0.2))
    }

    fn walk(encoded: &Encoded, boxes: &[Aabb]) -> Vec<u32> {
        let mut items = Vec::new();
        let mut pending = vec![0_u32];
        while let Some(node) = pending.pop() {
            let words = &encoded.nodes[node as usize];
            let bytes: &[u8] = bytemuck::cast_slice(words);
            let (exponents, inner) = (&bytes[12..15], bytes[15]);
            let [first_child, first_item] = [words[1][0], words[1][1]];
            for slot in 0..WIDTH {
                let meta = bytes[24 + slot];
                let plane = |index: usize, axis: usize| {
                    let step = f32::from_bits(u32::from(exponents[axis]) << 23);
                    let origin = f32::from_bits(words[0][axis]);
                    f64::from(origin) + f64::from(bytes[32 + 8 * index + slot]) * f64::from(step)
                };
                let contains = |item: u32| {
                    (0..3).all(|axis| {
                        plane(axis, axis) <= f64::from(boxes[item as usize].min[axis])
                            && plane(3 + axis, axis) >= f64::from(boxes[item as usize].max[axis])
                    })
                };
                if meta == 0 {
                    continue;
                }
                if meta & 0x1f >= 24 {
                    assert_eq!(usize::from(meta & 0x1f), 24 + slot);
                    let rank = (inner & ((1_u32 << slot) - 1) as u8).count_ones();
                    pending.push(first_child + rank);
                    continue;
                }
                for bit in 0..(meta >> 5).count_ones() {
                    let item = encoded.items[(first_item + u32::from(meta & 0x1f) + bit) as usize];
                    assert!(contains(item), "item {item} sticks out");
                    items.push(item);
                }
            }
        }
        items
    }

    #[test]
    fn every_item_is_found_in_a_box_that_holds_it() {
        for count in [1, 2, 3, 8, 9, 1000] {
            let boxes = boxes(count);
            let encoded = encoded(&boxes);
            let mut items = walk(&encoded, &boxes);
            items.sort_unstable();
            assert_eq!(items, (0..count).collect::<Vec<u32>>());
            assert!(encoded.depth <= MAX_DEPTH);
        }
    }

    #[test]
    fn balanced_trees_are_shallow() {
        let boxes = boxes(3000);
        let balanced = BinaryTree::balanced(&boxes);
        let costs = Costs {
            node: 1.0,
            leaf_items: 3,
        };
        let mut leaves = Vec::new();
        let wide = WideTree::collapse(&balanced, &costs, &mut |items| {
            leaves.push(items.to_vec());
            leaves.len() - 1
        });
        assert!(Encoded::new(&wide, &leaves).depth <= 12);
    }
}
