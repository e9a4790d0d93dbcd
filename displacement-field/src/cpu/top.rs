//! Which of many spheres a ray meets: a tree over them that is built anew in a millisecond, since it is a sorted list.
//!
//! The spheres are divided in halves across the longest side of their middles, over and over; eight neighbours make a leaf,
//! eight leaves a node of the next level. Nothing but the list, the spheres of the leaves and the boxes of each level is kept.

use glam::Vec3;
use isophote_scene::{Aabb, Ray};

use crate::{
    Sphere,
    lanes::{Lanes, Mask, set_bits},
};

/// Children of a node.
pub(crate) const WIDTH: usize = 8;
/// Of 2²⁴ spheres and more: of each level all but one may wait.
const STACK: usize = WIDTH * 12;
/// As many are divided by several threads.
const MANY: usize = 2048;

/// A tree over spheres.
#[derive(Clone, Debug, Default)]
pub(crate) struct Top {
    /// Spheres by their number, neighbours together.
    order: Vec<u32>,
    /// The same spheres.
    leaves: Vec<Leaf>,
    /// From the nodes whose children are leaves to the root; none where the root is a leaf.
    levels: Vec<Vec<Node>>,
}

/// Eight spheres; what those that are not there say is not to be used.
#[derive(Clone, Copy, Debug)]
struct Leaf {
    center: [[f32; WIDTH]; 3],
    radius: [f32; WIDTH],
}

/// Eight boxes; what those that are not there say is not to be used.
#[derive(Clone, Copy, Debug)]
struct Node {
    min: [[f32; WIDTH]; 3],
    max: [[f32; WIDTH]; 3],
}

/// A ray's way through the tree: from near to far, as far as boxes tell.
#[derive(Clone, Copy)]
pub(crate) struct Walk {
    origin: Vec3,
    /// Of unit length, and one by it.
    direction: Vec3,
    inverse: Vec3,
    /// Of the ray's own direction.
    length: f32,
    /// Metres along the ray.
    start: f32,
    limit: f32,
    depth: usize,
    waiting: [Waiting; STACK],
}

/// A node, a leaf or a sphere that is still to be visited.
#[derive(Clone, Copy, Default)]
struct Waiting {
    /// 0 of spheres, 1 of leaves, from 2 on of nodes.
    level: u32,
    index: u32,
    /// Where the ray enters it.
    near: f32,
}

impl Default for Walk {
    fn default() -> Self {
        Self {
            origin: Vec3::ZERO,
            direction: Vec3::ZERO,
            inverse: Vec3::ZERO,
            length: 0.0,
            start: 0.0,
            limit: 0.0,
            depth: 0,
            waiting: [Waiting::default(); STACK],
        }
    }
}

impl Walk {
    /// Nothing from here on is looked for.
    #[inline(always)]
    pub(crate) fn shorten(&mut self, t_max: f32) {
        self.limit = t_max * self.length;
    }
}

impl Leaf {
    fn of(spheres: &[Sphere]) -> Self {
        let mut leaf = Self {
            center: [[0.0; WIDTH]; 3],
            radius: [0.0; WIDTH],
        };
        for (child, sphere) in spheres.iter().enumerate() {
            for axis in 0..3 {
                leaf.center[axis][child] = sphere.center[axis];
            }
            leaf.radius[child] = sphere.radius;
        }
        leaf
    }

    /// Which spheres a line meets between the ends of a walk, as bits, and where it enters them.
    #[inline(always)]
    fn meets<W: Lanes>(&self, walk: &Walk) -> (u32, [f32; WIDTH]) {
        let k = W::splat;
        let (mut bits, mut entered) = (0, [0.0; WIDTH]);
        for first in (0..WIDTH).step_by(W::COUNT) {
            let away = |axis: usize| W::load(&self.center[axis][first..]) - k(walk.origin[axis]);
            let (x, y, z) = (away(0), away(1), away(2));
            let radius = W::load(&self.radius[first..]);
            let Vec3 { x: u, y: v, z: w } = walk.direction;
            let ahead = x * k(u) + y * k(v) + z * k(w);
            let apart = x * x + y * y + z * z;
            // Rounding must not lose rays that touch.
            let square = ahead * ahead + radius * radius - apart * k(1.0 - 1e-6);
            let half = square.max(k(0.0)).sqrt();
            let near = (ahead - half).max(k(walk.start));
            let misses = square.less(k(0.0)) | (ahead + half).less(k(walk.start));
            bits |= (!misses & near.less(k(walk.limit))).bits() << first;
            let near = near.to_array();
            for lane in 0..W::COUNT {
                entered[first + lane] = near[lane];
            }
        }
        (bits, entered)
    }
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

    /// Which boxes a line meets between the ends of a walk, as bits, and where it enters them.
    #[inline(always)]
    fn meets<W: Lanes>(&self, walk: &Walk) -> (u32, [f32; WIDTH]) {
        let k = W::splat;
        let (mut bits, mut entered) = (0, [0.0; WIDTH]);
        for first in (0..WIDTH).step_by(W::COUNT) {
            let (mut near, mut far) = (k(walk.start), k(walk.limit));
            for axis in 0..3 {
                let (o, i) = (k(walk.origin[axis]), k(walk.inverse[axis]));
                let a = (W::load(&self.min[axis][first..]) - o) * i;
                let b = (W::load(&self.max[axis][first..]) - o) * i;
                // A ray along a side, where there is NaN, may miss the box: its spheres do not reach that far.
                near = a.min(b).max(near);
                far = a.max(b).min(far);
            }
            bits |= (!far.less(near) & near.less(k(walk.limit))).bits() << first;
            let near = near.to_array();
            for lane in 0..W::COUNT {
                entered[first + lane] = near[lane];
            }
        }
        (bits, entered)
    }

    #[cfg(feature = "gpu")]
    fn boxes(&self) -> [Aabb; WIDTH] {
        let corner =
            |axes: &[[f32; WIDTH]; 3], child: usize| Vec3::from_array(axes.map(|a| a[child]));
        std::array::from_fn(|child| Aabb {
            min: corner(&self.min, child),
            max: corner(&self.max, child),
        })
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

/// A box that holds a sphere, rounded up.
fn around(sphere: &Sphere) -> Aabb {
    let Sphere { center, radius } = *sphere;
    let reach = Vec3::splat(radius * 1.000_01 + 4.0 * f32::EPSILON * center.abs().max_element());
    Aabb {
        min: center - reach,
        max: center + reach,
    }
}

impl Top {
    pub(crate) fn new(spheres: &[Sphere]) -> Self {
        let mut items: Vec<(Vec3, u32)> = spheres
            .iter()
            .zip(0..)
            .map(|(sphere, index)| (sphere.center, index))
            .collect();
        arrange(&mut items);
        let order: Vec<u32> = items.into_iter().map(|(_, index)| index).collect();
        let sorted: Vec<Sphere> = order.iter().map(|&index| spheres[index as usize]).collect();
        let united = |boxes: &[Aabb]| boxes.iter().fold(Aabb::EMPTY, |all, one| all.union(one));
        let boxes: Vec<Aabb> = sorted.iter().map(around).collect();
        let mut boxes: Vec<Aabb> = boxes.chunks(WIDTH).map(united).collect();
        let mut levels = Vec::new();
        while boxes.len() > 1 {
            levels.push(boxes.chunks(WIDTH).map(Node::of).collect());
            boxes = boxes.chunks(WIDTH).map(united).collect();
        }
        Self {
            order,
            leaves: sorted.chunks(WIDTH).map(Leaf::of).collect(),
            levels,
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        let nodes: usize = self.levels.iter().map(Vec::len).sum();
        size_of_val(&self.order[..]) + size_of_val(&self.leaves[..]) + nodes * size_of::<Node>()
    }

    /// The numbers of the spheres, eight to a leaf.
    #[cfg(feature = "gpu")]
    pub(crate) fn order(&self) -> &[u32] {
        &self.order
    }

    /// The boxes of each level's nodes, from those whose children are leaves to the root.
    #[cfg(feature = "gpu")]
    pub(crate) fn boxes(&self) -> impl Iterator<Item = Vec<[Aabb; WIDTH]>> {
        let level = |nodes: &Vec<Node>| nodes.iter().map(Node::boxes).collect();
        self.levels.iter().map(level)
    }

    /// How many children a leaf, of level 1, or a node has: the last of a level may have less than others.
    #[inline(always)]
    fn children(&self, level: usize, index: usize) -> usize {
        let below = match level {
            1 => self.order.len(),
            2 => self.leaves.len(),
            level => self.levels[level - 3].len(),
        };
        (below - index * WIDTH).min(WIDTH)
    }

    /// Lets a walk begin. Rays that are not valid meet nothing.
    #[inline(always)]
    pub(crate) fn start(&self, walk: &mut Walk, ray: &Ray) {
        walk.depth = 0;
        if !ray.is_valid() || self.order.is_empty() {
            return;
        }
        // Squares of very long and very short directions would leave the range.
        let largest = ray.direction.abs().max_element();
        let scaled = ray.direction / largest;
        let length = scaled.length();
        walk.origin = ray.origin;
        walk.direction = scaled / length;
        walk.inverse = 1.0 / walk.direction;
        walk.length = length * largest;
        walk.start = ray.t_min * walk.length;
        walk.shorten(ray.t_max);
        walk.waiting[0] = Waiting {
            level: self.levels.len() as u32 + 1,
            index: 0,
            near: walk.start,
        };
        walk.depth = 1;
    }

    /// The next sphere on a walk's way that is not beyond its end.
    #[inline(always)]
    pub(crate) fn next<W: Lanes>(&self, walk: &mut Walk) -> Option<usize> {
        while walk.depth > 0 {
            walk.depth -= 1;
            let Waiting { level, index, near } = walk.waiting[walk.depth];
            if near >= walk.limit {
                continue;
            }
            let (level, index) = (level as usize, index as usize);
            let (bits, entered) = match level {
                0 => return Some(self.order[index] as usize),
                1 => self.leaves[index].meets::<W>(walk),
                level => self.levels[level - 2][index].meets::<W>(walk),
            };
            let bits = bits & ((1 << self.children(level, index)) - 1);
            let first = walk.depth;
            for child in set_bits(bits) {
                // The nearest comes last, to be visited first.
                let near = entered[child];
                let mut place = walk.depth;
                while place > first && walk.waiting[place - 1].near < near {
                    walk.waiting[place] = walk.waiting[place - 1];
                    place -= 1;
                }
                walk.waiting[place] = Waiting {
                    level: level as u32 - 1,
                    index: (index * WIDTH + child) as u32,
                    near,
                };
                walk.depth += 1;
            }
        }
        None
    }

    /// Calls with each sphere that is within a limit of a point; the call may lower it.
    pub(crate) fn near(&self, point: Vec3, limit: f32, mut call: impl FnMut(usize, &mut f32)) {
        let mut limit = limit;
        let mut waiting = [(0, 0); STACK];
        waiting[0] = (self.levels.len() + 1, 0);
        let mut depth = usize::from(!self.order.is_empty());
        while depth > 0 {
            depth -= 1;
            let (level, index) = waiting[depth];
            for child in 0..self.children(level, index) {
                let below = index * WIDTH + child;
                if level > 1 {
                    let square = self.levels[level - 2][index].squared_distances(point)[child];
                    if square <= limit * limit {
                        waiting[depth] = (level - 1, below);
                        depth += 1;
                    }
                    continue;
                }
                let leaf = &self.leaves[index];
                let center = Vec3::from_array(leaf.center.map(|axis| axis[child]));
                if center.distance(point) - leaf.radius[child] <= limit {
                    call(self.order[below] as usize, &mut limit);
                }
            }
        }
    }
}

/// Sorts spheres by their middles, so that each node's are together: as many as a full node's, but for the last ones.
fn arrange(items: &mut [(Vec3, u32)]) {
    let mut size = WIDTH;
    while size * WIDTH < items.len() {
        size *= WIDTH;
    }
    if items.len() > WIDTH {
        divide(items, size);
    }
}

/// Divides what several nodes of a size hold.
fn divide(items: &mut [(Vec3, u32)], size: usize) {
    if items.len() <= size {
        return arrange(items);
    }
    let bounds = Aabb::around(items.iter().map(|item| item.0));
    let axis = (bounds.max - bounds.min).max_position();
    let half = items.len().div_ceil(size) / 2 * size;
    items.select_nth_unstable_by(half, |a, b| {
        a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1))
    });
    let (low, high) = items.split_at_mut(half);
    if low.len() + high.len() > MANY {
        rayon::join(|| divide(low, size), || divide(high, size));
    } else {
        divide(low, size);
        divide(high, size);
    }
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
        for count in [0, 1, 2, 8, 9, 64, 65, 513, 1000] {
            let spheres = spheres(count);
            let top = Top::new(&spheres);
            for index in 0..200 {
                let sampler = Sampler::new(2, 0, index);
                let origin = sampler.get_2d(0).extend(sampler.get_1d(1)) * 12.0 - 1.0;
                let mut direction = uniform_sphere(sampler.get_2d(2));
                if index % 10 == 0 {
                    direction = Vec3::X;
                }
                let ray = Ray::new(origin, direction).until(6.0);
                let mut met = vec![0; spheres.len()];
                let mut walk = Walk::default();
                top.start(&mut walk, &ray);
                while let Some(index) = top.next::<f32>(&mut walk) {
                    met[index] += 1;
                }
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
