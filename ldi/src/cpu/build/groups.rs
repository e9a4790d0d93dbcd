//! Which triangles are stored together: compact groups of up to eight, found by the surface area heuristic.
//!
//! A layer of a map names a group, so that a scene of many small triangles has few layers, and all of a group's
//! triangles are tested at once.

use glam::Vec3;
use isophote_scene::{Aabb, WorldTriangle};

use crate::cpu::maps::LANES;

/// Bins along an axis in which splits are tried.
const BINS: usize = 32;

/// Orders `triangles` so that each group lies together, and returns where groups start (and the end).
pub(super) fn group(triangles: &mut [WorldTriangle]) -> Vec<usize> {
    let mut items: Vec<Item> = triangles.iter().map(Item::new).collect();
    let mut starts = split(&mut items, 0);
    starts.sort_unstable();
    starts.push(items.len());
    for (slot, item) in triangles.iter_mut().zip(&items) {
        *slot = item.triangle;
    }
    starts
}

#[derive(Clone, Copy)]
struct Item {
    triangle: WorldTriangle,
    bounds: Aabb,
    center: Vec3,
}

impl Item {
    fn new(triangle: &WorldTriangle) -> Self {
        let bounds = Aabb::around(triangle.corners);
        Self {
            triangle: *triangle,
            bounds,
            center: bounds.center(),
        }
    }
}

/// The starts of the groups of some items, the first of which has the number `first`.
fn split(items: &mut [Item], first: usize) -> Vec<usize> {
    if items.len() <= LANES {
        return vec![first];
    }
    let middle = partition(items);
    let (left, right) = items.split_at_mut(middle);
    let (mut starts, mut more) = if left.len() + right.len() > 4096 {
        rayon::join(|| split(left, first), || split(right, first + middle))
    } else {
        (split(left, first), split(right, first + middle))
    };
    starts.append(&mut more);
    starts
}

/// Divides items in two where the sum of areas times numbers of groups is least; both parts have some.
fn partition(items: &mut [Item]) -> usize {
    let centers = Aabb::around(items.iter().map(|item| item.center));
    let mut best = (f32::INFINITY, 0, 0);
    for axis in 0..3 {
        let bin = binning(&centers, axis);
        let mut bins = [(Aabb::EMPTY, 0_usize); BINS];
        for item in &*items {
            let (bounds, count) = &mut bins[bin(item)];
            *bounds = bounds.union(&item.bounds);
            *count += 1;
        }
        let cost = |bounds: &Aabb, count: usize| half_area(bounds) * count.div_ceil(LANES) as f32;
        let mut right = [0.0; BINS];
        let (mut bounds, mut count) = (Aabb::EMPTY, 0);
        for index in (1..BINS).rev() {
            bounds = bounds.union(&bins[index].0);
            count += bins[index].1;
            right[index] = cost(&bounds, count);
        }
        let (mut bounds, mut count) = (Aabb::EMPTY, 0);
        for index in 1..BINS {
            bounds = bounds.union(&bins[index - 1].0);
            count += bins[index - 1].1;
            if count == 0 || count == items.len() {
                continue;
            }
            let total = cost(&bounds, count) + right[index];
            if total < best.0 {
                best = (total, axis, index);
            }
        }
    }
    let (cost, axis, index) = best;
    if cost.is_infinite() {
        // All centres are in one place.
        return items.len() / 2;
    }
    let bin = binning(&centers, axis);
    // Stable, so that the order does not depend on anything but the scene.
    items.sort_by_key(|item| bin(item) >= index);
    items.partition_point(|item| bin(item) < index)
}

fn binning(centers: &Aabb, axis: usize) -> impl Fn(&Item) -> usize + Copy {
    let (low, extent) = (centers.min[axis], centers.max[axis] - centers.min[axis]);
    let scale = if extent > 0.0 {
        BINS as f32 / extent
    } else {
        0.0
    };
    move |item: &Item| (((item.center[axis] - low) * scale) as usize).min(BINS - 1)
}

fn half_area(bounds: &Aabb) -> f32 {
    if bounds.is_empty() {
        return 0.0;
    }
    let size = bounds.max - bounds.min;
    size.x * size.y + size.y * size.z + size.z * size.x
}
