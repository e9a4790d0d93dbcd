//! Stage 4 over the picture: tile by tile the trees of rays, and then the light of the virtual point lights on all that a
//! tile's mirrors and glass show.
//!
//! That is the paper's hidden cost: at full resolution, since no grid of pixels lies over it, unless it is interpolated over the
//! scene (`cpu/cache.rs`). It is timed apart.

use std::{
    iter::Sum,
    time::{Duration, Instant},
};

use glam::Vec3;
use isophote_scene::{GBuffer, Seen, Tracer};
use rayon::prelude::*;

use super::{
    Meter,
    cache::Cache,
    indirect::{Gather, Receiver, Share},
    specular::{Found, Mirrored, Tree},
};

/// Pixels of a tile, across and down.
const TILE: [usize; 2] = [16, 8];
/// What mirrors show is lit once there is so much of it, so that memory does not grow with the number of glossy rays.
const MOST: usize = 1 << 12;
/// Pixels whose mirrors are looked into before what they show is interpolated, so that memory does not grow with the picture.
const AT_ONCE: usize = 1 << 17;

/// Light by pixel, row by row from the top, and what it took.
pub(super) struct Direct {
    pub(super) direct: Vec<Vec3>,
    pub(super) specular: Vec<Vec3>,
    pub(super) cost: Cost,
}

/// What tiles took: rays, and time of threads; of the trees and of what they show.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cost {
    pub(super) rays: u64,
    pub(super) mirrored_rays: u64,
    own: Duration,
    mirrored: Duration,
}

impl Cost {
    /// The part of the time that went to light on what mirrors and glass show.
    pub(super) fn mirrored_share(&self) -> f64 {
        let all = (self.own + self.mirrored).as_secs_f64();
        self.mirrored.as_secs_f64() / all.max(f64::MIN_POSITIVE)
    }
}

impl Sum for Cost {
    fn sum<I: Iterator<Item = Self>>(costs: I) -> Self {
        costs.fold(Self::default(), |a, b| Self {
            rays: a.rays + b.rays,
            mirrored_rays: a.mirrored_rays + b.mirrored_rays,
            own: a.own + b.own,
            mirrored: a.mirrored + b.mirrored,
        })
    }
}

/// Who lights tiles.
pub(super) struct Tiles<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> {
    pub(super) tree: Tree<'a, E>,
    pub(super) gather: &'a Gather<'a, E, S>,
    pub(super) meter: &'a Meter<'a>,
}

impl<E: Tracer + ?Sized, S: Tracer + ?Sized> Tiles<'_, E, S> {
    pub(super) fn light(&self, seen: &GBuffer) -> Direct {
        let width = seen.size[0] as usize;
        let pixels = seen.pixels.len();
        let (mut direct, mut specular) = (vec![Vec3::ZERO; pixels], vec![Vec3::ZERO; pixels]);
        let band = TILE[1] * width;
        let side = self.tree.params.caching;
        let mut cache = (side > 0.0).then(|| Cache::new(side));
        let mut cost = Cost::default();
        let part = AT_ONCE.div_ceil(band) * band;
        for first in (0..pixels).step_by(part) {
            let all = first..(first + part).min(pixels);
            let bands = direct[all.clone()]
                .par_chunks_mut(band)
                .zip(specular[all.clone()].par_chunks_mut(band))
                .zip(seen.pixels[all].par_chunks(band))
                .enumerate()
                .map(|(number, ((direct, specular), seen))| {
                    self.band(first + number * band, width, seen, [direct, specular])
                });
            let (costs, shown): (Vec<Cost>, Vec<Vec<Mirrored>>) = bands.unzip();
            cost = costs.into_iter().chain([cost]).sum();
            if let Some(cache) = &mut cache {
                let shown: Vec<Mirrored> = shown.into_iter().flatten().collect();
                self.look_up(cache, &shown, &mut specular, &mut cost);
            }
        }
        Direct {
            direct,
            specular,
            cost,
        }
    }

    /// Adds what a cache knows of the light on what mirrors show.
    fn look_up(
        &self,
        cache: &mut Cache,
        shown: &[Mirrored],
        specular: &mut [Vec3],
        cost: &mut Cost,
    ) {
        let start = Instant::now();
        let (irradiance, rays) = cache.irradiance(self.gather, shown);
        for (mirrored, irradiance) in shown.iter().zip(irradiance) {
            specular[mirrored.pixel as usize] += mirrored.weight * irradiance;
        }
        cost.mirrored_rays += rays;
        // All threads work on it.
        cost.mirrored += start.elapsed() * rayon::current_num_threads() as u32;
    }

    /// Some rows, the first of whose pixels has a number. Returns what mirrors show if it is to be looked up.
    fn band(
        &self,
        first: usize,
        width: usize,
        seen: &[Option<Seen>],
        [direct, specular]: [&mut [Vec3]; 2],
    ) -> (Cost, Vec<Mirrored>) {
        let mut cost = Cost::default();
        let mut found = Found::default();
        let is_cached = self.tree.params.caching > 0.0;
        for left in (0..width).step_by(TILE[0]) {
            let start = Instant::now();
            let before = cost.mirrored;
            for row in (0..seen.len()).step_by(width) {
                for place in row + left..row + (left + TILE[0]).min(width) {
                    if let Some(seen) = &seen[place] {
                        let pixel = (first + place) as u32;
                        [direct[place], specular[place]] = self.tree.light(seen, pixel, &mut found);
                    }
                    if found.mirrored.len() >= MOST && !is_cached {
                        self.light_mirrored(first, &mut found, specular, &mut cost);
                    }
                }
            }
            if !is_cached {
                self.light_mirrored(first, &mut found, specular, &mut cost);
            }
            cost.own += start.elapsed().saturating_sub(cost.mirrored - before);
        }
        cost.rays = found.rays;
        self.meter.advance(seen.len());
        (cost, found.mirrored)
    }

    /// Adds the light of the virtual point lights to the pixels that mirrors show it in.
    fn light_mirrored(
        &self,
        first: usize,
        found: &mut Found,
        specular: &mut [Vec3],
        cost: &mut Cost,
    ) {
        if found.mirrored.is_empty() {
            return;
        }
        let start = Instant::now();
        let receivers: Vec<Receiver<'_>> = found.mirrored.iter().map(Mirrored::receiver).collect();
        let mut irradiance = vec![Vec3::ZERO; receivers.len()];
        cost.mirrored_rays += self
            .gather
            .irradiance(&receivers, &Share::ALL, &mut irradiance);
        for (mirrored, irradiance) in found.mirrored.drain(..).zip(irradiance) {
            specular[mirrored.pixel as usize - first] += mirrored.weight * irradiance;
        }
        cost.mirrored += start.elapsed();
    }
}
