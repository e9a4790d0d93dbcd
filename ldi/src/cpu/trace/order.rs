//! The order in which a batch of rays is traced: those of a map beside each other.
//!
//! Within a map they stay in the order given. Sorting them by place too was tried, and cost as much as it gained.

use glam::Vec3;
use isophote_scene::Ray;

use super::kernel::Kernel;
use crate::Directions;

/// A ray and its number in the caller's slice.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Numbered {
    pub(crate) ray: Ray,
    pub(crate) number: u32,
}

/// Rays by map.
pub(crate) struct Sorted {
    pub(crate) rays: Vec<Numbered>,
    /// Where those of each map end.
    ends: Vec<u32>,
}

impl Sorted {
    /// As a counting sort; rays of a map stay in the order given.
    #[inline(always)]
    pub(crate) fn by_map<K: Kernel>(kernel: K, rays: &[Ray], directions: Directions) -> Self {
        let mut maps = vec![0_u16; rays.len()];
        let (eights, rest) = rays.as_chunks::<8>();
        let (eight_maps, rest_maps) = maps.as_chunks_mut::<8>();
        for (rays, maps) in eights.iter().zip(eight_maps) {
            *maps = kernel.nearest(directions, rays);
        }
        for (ray, map) in rest.iter().zip(rest_maps) {
            *map = directions.nearest(ray.direction) as u16;
        }
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
        Self {
            rays: sorted,
            ends: next,
        }
    }

    /// Each map and where its rays lie.
    pub(crate) fn maps(&self) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> {
        let mut first = 0;
        let maps = self.ends.len() - 1;
        self.ends[..maps]
            .iter()
            .enumerate()
            .map(move |(map, &end)| {
                let range = first..end as usize;
                first = end as usize;
                (map, range)
            })
    }
}
