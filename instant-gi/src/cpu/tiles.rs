//! Stage 3 over the picture: tile by tile the trees of rays, and then the light of the virtual point lights on all that a
//! tile's mirrors and glass show.
//!
//! That is the paper's hidden cost: at full resolution, since no grid of pixels lies over it. It is timed apart.

use std::{
    iter::Sum,
    time::{Duration, Instant},
};

use glam::Vec3;
use isophote_scene::{GBuffer, Seen, Tracer};
use rayon::prelude::*;

use super::{
    Meter,
    indirect::{Gather, Receiver, Share},
    specular::{Found, Tree},
};

/// Pixels of a tile, across and down.
const TILE: [usize; 2] = [16, 8];
/// What mirrors show is lit once there is so much of it, so that memory does not grow with the number of glossy rays.
const MOST: usize = 1 << 12;

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
        let cost = direct
            .par_chunks_mut(band)
            .zip(specular.par_chunks_mut(band))
            .zip(seen.pixels.par_chunks(band))
            .enumerate()
            .map(|(number, ((direct, specular), seen))| {
                self.band(number * band, width, seen, [direct, specular])
            })
            .sum();
        Direct {
            direct,
            specular,
            cost,
        }
    }

    /// Some rows, the first of whose pixels has a number.
    fn band(
        &self,
        first: usize,
        width: usize,
        seen: &[Option<Seen>],
        [direct, specular]: [&mut [Vec3]; 2],
    ) -> Cost {
        let mut cost = Cost::default();
        let mut found = Found::default();
        for left in (0..width).step_by(TILE[0]) {
            let start = Instant::now();
            let before = cost.mirrored;
            for row in (0..seen.len()).step_by(width) {
                for place in row + left..row + (left + TILE[0]).min(width) {
                    if let Some(seen) = &seen[place] {
                        let pixel = (first + place) as u32;
                        [direct[place], specular[place]] = self.tree.light(seen, pixel, &mut found);
                    }
                    if found.mirrored.len() >= MOST {
                        self.light_mirrored(first, &mut found, specular, &mut cost);
                    }
                }
            }
            self.light_mirrored(first, &mut found, specular, &mut cost);
            cost.own += start.elapsed().saturating_sub(cost.mirrored - before);
        }
        cost.rays = found.rays;
        self.meter.advance(seen.len());
        cost
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
        let receivers: Vec<Receiver<'_>> = found
            .mirrored
            .iter()
            .map(|mirrored| Receiver {
                point: &mirrored.point,
                normal: mirrored.normal,
                parts: 1,
                stream: mirrored.pixel,
            })
            .collect();
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
