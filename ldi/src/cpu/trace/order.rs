//! The order in which a batch of rays is traced: those of a map beside each other.
//!
//! Within a map they stay in the order given. Sorting them by place too was tried, and cost as much as it gained.

use glam::Vec3;
use isophote_scene::Ray;

use crate::Directions;

/// A ray and its number in the caller's slice.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Numbered {
    pub(crate) ray: Ray,
    pub(crate) number: u32,
}

/// Rays by map, as a counting sort; those of a map in the order given.
pub(crate) fn by_map(rays: &[Ray], directions: Directions) -> Vec<Numbered> {
    let maps: Vec<u16> = rays
        .iter()
        .map(|ray| directions.nearest(ray.direction) as u16)
        .collect();
    let mut next = vec![0_u32; directions.maps() + 1];
    for &map in &maps {
        next[usize::from(map) + 1] += 1;
    }
    for map in 1..next.len() {
        next[map] += next[map - 1];
    }
    let none = Numbered {
        ray: Ray::new(Vec3::ZERO, Vec3::ZERO),
        number: 0,
    };
    let mut sorted = vec![none; rays.len()];
    for ((&ray, &map), number) in rays.iter().zip(&maps).zip(0..) {
        let slot = &mut next[usize::from(map)];
        sorted[*slot as usize] = Numbered { ray, number };
        *slot += 1;
    }
    sorted
}
