//! The order in which a batch of rays is traced.

use glam::Vec3;
use isophote_scene::Ray;

/// A ray and its number in the caller's slice.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Numbered {
    pub(crate) ray: Ray,
    pub(crate) number: u32,
}

/// Items by a key less than `buckets`, equal keys in the order given.
pub(crate) fn counting_sort(
    items: impl Iterator<Item = Numbered> + Clone,
    count: usize,
    buckets: usize,
    key: impl Fn(&Numbered) -> usize,
) -> Vec<Numbered> {
    let mut keys = Vec::with_capacity(count);
    let mut next = vec![0_u32; buckets + 1];
    for item in items.clone() {
        let key = key(&item);
        next[key + 1] += 1;
        keys.push(key as u32);
    }
    for bucket in 1..next.len() {
        next[bucket] += next[bucket - 1];
    }
    let none = Numbered {
        ray: Ray::new(Vec3::ZERO, Vec3::ZERO),
        number: 0,
    };
    let mut sorted = vec![none; count];
    for (item, &key) in items.zip(&keys) {
        let slot = &mut next[key as usize];
        sorted[*slot as usize] = item;
        *slot += 1;
    }
    sorted
}
