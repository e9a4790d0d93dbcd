//! Which of many spheres a ray meets: a tree over them that is built anew in a millisecond, since it is a sorted list.
//!
//! The spheres are sorted along a curve that fills space (Morton's); eight neighbours make a node, eight nodes the next
//! level's. Nothing but the list and the boxes of each level is kept.

use glam::Vec3;
use isophote_scene::{Aabb, Ray};
use rayon::prelude::*;

use crate::Sphere;

/// Children of a node.
const WIDTH: usize = 8;
/// Of 2²⁴ leaves and more.
const STACK: usize = WIDTH * 12;

/// A tree over spheres.
#[derive(Clone, Debug, Default)]
pub(crate) struct Top {
    /// Spheres by their number, sorted along the curve.
    order: Vec<u32>,
    /// From the leaves, whose children are spheres, to the root.
    levels: Vec<Vec<Node>>,
}

/// Eight boxes; what those that are not there say is not to be used.
#[derive(Clone, Copy, Debug)]
struct Node {
    min: [[f32; WIDTH]; 3],
    max: [[f32; WIDTH]; 3],
}

impl Node {
    fn of(boxes: &[Aabb]) -> Self {
        let side = |value: fn(&Aabb) -> Vec3, axis: usize| {
            std::array::from_fn(|child| value(boxes.get(child).unwrap_or(&Aabb::EMPTY))[axis])
        };
        Self {
            min: [0, 1, 2].map(|axis| side(|bounds| bounds.min, axis)),
            max: [0, 1, 2].map(|axis| side(|bounds| bounds.max, axis)),
        }
    }

    fn bounds(&self) -> Aabb {
        let least = |axis: &[f32; WIDTH]| axis.iter().copied().fold(f32::INFINITY, f32::min);
        let most = |axis: &[f32; WIDTH]| axis.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        Aabb {
            min: Vec3::from_array([0, 1, 2].map(|axis| least(&self.min[axis]))),
            max: Vec3::from_array([0, 1, 2].map(|axis| most(&self.max[axis]))),
        }
    }

    /// Where a line enters each box, and where it leaves it.
    #[inline(always)]
    fn slabs(&self, origin: Vec3, inverse: Vec3) -> ([f32; WIDTH], [f32; WIDTH]) {
        let (mut near, mut far) = ([f32::NEG_INFINITY; WIDTH], [f32::INFINITY; WIDTH]);
        for axis in 0..3 {
            let (o, i) = (origin[axis], inverse[axis]);
            for child in 0..WIDTH {
                let a = (self.min[axis][child] - o) * i;
                let b = (self.max[axis][child] - o) * i;
                near[child] = near[child].max(a.min(b));
                far[child] = far[child].min(a.max(b));
            }
        }
        (near, far)
    }

    /// The squared distance from a point to each box.
    fn squared_distances(&self, point: Vec3) -> [f32; WIDTH] {
        let mut squares = [0.0; WIDTH];
        for axis in 0..3 {
            for (child, square) in squares.iter_mut().enumerate() {
                let below = self.min[axis][child] - point[axis];
                let above = point[axis] - self.max[axis][child];
                let beside = below.max(above).max(0.0);
                *square += beside * beside;
            }
        }
        squares
    }
}

impl Top {
    pub(crate) fn new(spheres: impl Iterator<Item = Sphere>) -> Self {
        let spheres: Vec<Sphere> = spheres.collect();
        let centers = Aabb::around(spheres.iter().map(|sphere| sphere.center));
        let size = (centers.max - centers.min)
            .max_element()
            .max(f32::MIN_POSITIVE);
        let mut order: Vec<(u64, u32)> = spheres
            .iter()
            .zip(0..)
            .map(|(sphere, index)| (morton((sphere.center - centers.min) / size), index))
            .collect();
        order.par_sort_unstable();
        let order: Vec<u32> = order.into_iter().map(|(_, index)| index).collect();
        let mut boxes: Vec<Aabb> = order
            .iter()
            .map(|&index| {
                let Sphere { center, radius } = spheres[index as usize];
                // Rounding must not lose rays that touch.
                let reach = Vec3::splat(
                    radius * 1.000_01 + 4.0 * f32::EPSILON * center.abs().max_element(),
                );
                Aabb {
                    min: center - reach,
                    max: center + reach,
                }
            })
            .collect();
        let mut levels = Vec::new();
        while !boxes.is_empty() {
            let nodes: Vec<Node> = boxes.chunks(WIDTH).map(Node::of).collect();
            boxes = nodes.iter().map(Node::bounds).collect();
            levels.push(nodes);
            if boxes.len() == 1 {
                break;
            }
        }
        Self { order, levels }
    }

    pub(crate) fn bytes(&self) -> usize {
        let nodes: usize = self.levels.iter().map(Vec::len).sum();
        size_of_val(&self.order[..]) + nodes * size_of::<Node>()
    }

    /// How many children a node has: the last of a level may have less than others.
    #[inline(always)]
    fn children(&self, level: usize, index: usize) -> usize {
        let below = match level {
            0 => self.order.len(),
            level => self.levels[level - 1].len(),
        };
        (below - index * WIDTH).min(WIDTH)
    }

    /// Calls with each sphere whose box a valid ray meets before a limit, which the call may lower.
    #[inline]
    pub(crate) fn visit(&self, ray: &Ray, mut call: impl FnMut(usize, &mut f32)) {
        let Some(root) = self.levels.len().checked_sub(1) else {
            return;
        };
        let inverse = 1.0 / ray.direction;
        let mut limit = ray.t_max;
        let mut stack = [(0_usize, 0_usize, 0.0_f32); STACK];
        stack[0] = (root, 0, f32::NEG_INFINITY);
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (level, index, entered) = stack[depth];
            if entered >= limit {
                continue;
            }
            let (near, far) = self.levels[level][index].slabs(ray.origin, inverse);
            for child in 0..self.children(level, index) {
                let meets =
                    near[child] <= far[child] && far[child] >= ray.t_min && near[child] < limit;
                if !meets {
                    continue;
                }
                let below = index * WIDTH + child;
                if level > 0 {
                    stack[depth] = (level - 1, below, near[child]);
                    depth += 1;
                } else {
                    call(self.order[below] as usize, &mut limit);
                }
            }
        }
    }

    /// Calls with each sphere whose box is within a limit of a point; the call may lower it.
    pub(crate) fn near(&self, point: Vec3, limit: f32, mut call: impl FnMut(usize, &mut f32)) {
        let Some(root) = self.levels.len().checked_sub(1) else {
            return;
        };
        let mut limit = limit;
        let mut stack = vec![(root, 0)];
        while let Some((level, index)) = stack.pop() {
            let squares = self.levels[level][index].squared_distances(point);
            for (child, square) in squares
                .into_iter()
                .enumerate()
                .take(self.children(level, index))
            {
                let below = index * WIDTH + child;
                if square > limit * limit {
                    continue;
                }
                if level > 0 {
                    stack.push((level - 1, below));
                } else {
                    call(self.order[below] as usize, &mut limit);
                }
            }
        }
    }
}

/// The bits of three coordinates in 0..=1, 21 each, in turn.
fn morton(place: Vec3) -> u64 {
    let spread = |value: f32| {
        let mut bits = (value * 2_097_151.0) as u64 & 0x1f_ffff;
        for (shift, mask) in [
            (32, 0x001f_0000_0000_ffff),
            (16, 0x001f_0000_ff00_00ff),
            (8, 0x100f_00f0_0f00_f00f),
            (4, 0x10c3_0c30_c30c_30c3),
            (2, 0x1249_2492_4924_9249),
        ] {
            bits = (bits | bits << shift) & mask;
        }
        bits
    };
    spread(place.x) | spread(place.y) << 1 | spread(place.z) << 2
}

#[cfg(test)]
mod tests {
    use isophote_scene::sample::{Sampler, uniform_sphere};

    use super::*;

    fn spheres(count: u32) -> Vec<Sphere> {
        (0..count)
            .map(|index| {
                let sampler = Sampler::new(1, 0, index);
                let (a, b) = (sampler.get_2d(0), sampler.get_2d(1));
                Sphere {
                    center: Vec3::new(a.x, a.y, b.x) * 10.0,
                    radius: 0.2 * b.y,
                }
            })
            .collect()
    }

    #[test]
    fn no_sphere_is_passed_by() {
        for count in [0, 1, 2, 8, 9, 64, 65, 1000] {
            let spheres = spheres(count);
            let top = Top::new(spheres.iter().copied());
            for index in 0..200 {
                let sampler = Sampler::new(2, 0, index);
                let origin = sampler.get_2d(0).extend(sampler.get_1d(1)) * 12.0 - 1.0;
                let mut direction = uniform_sphere(sampler.get_2d(2));
                if index % 10 == 0 {
                    direction = Vec3::X;
                }
                let ray = Ray::new(origin, direction).until(6.0);
                let mut met = vec![0; spheres.len()];
                top.visit(&ray, |index, _| met[index] += 1);
                let mut close = vec![0; spheres.len()];
                top.near(origin, 1.0, |index, _| close[index] += 1);
                for (index, sphere) in spheres.iter().enumerate() {
                    let along = (sphere.center - origin).dot(direction).clamp(0.0, 6.0);
                    let apart = sphere.center.distance(ray.at(along));
                    assert!(met[index] <= 1 && (met[index] == 1 || apart > sphere.radius));
                    let apart = sphere.center.distance(origin) - sphere.radius;
                    assert!(close[index] <= 1 && (close[index] == 1 || apart > 1.0));
                }
            }
        }
    }
}
