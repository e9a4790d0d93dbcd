//! Stage 9, splatting (§4.2): each photon lights the pixels that its footprint overlaps, by Silverman's kernel of their distance
//! from its middle (Eq. (4) to (7)).
//!
//! The picture is cut into tiles. Photons are listed for the tiles they may reach, counted, summed up and filled in, and each
//! tile adds its own in their order: nothing is written by two threads, and sums are the same whatever their number.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{
    footprint::Footprint,
    screen::{Screen, TILE},
};
use crate::cpu::lanes::{LANES, Lanes, vectorised};

/// A photon that lights pixels.
#[derive(Clone, Copy)]
pub(crate) struct Splat {
    footprint: Footprint,
    /// Towards where it came from, unit.
    towards: Vec3,
    /// Pixels from and up to which it reaches, exclusive.
    low: [u16; 2],
    high: [u16; 2],
}

impl Splat {
    /// None where it is out of the picture.
    pub(crate) fn new(screen: &Screen, footprint: Footprint, towards: Vec3) -> Option<Self> {
        let thickness = 2.0 * footprint.thickness * footprint.normal;
        let [low, high] = reach(screen, footprint.position, footprint.sides, thickness)?;
        Some(Self {
            footprint,
            towards,
            low,
            high,
        })
    }
}

/// Adds splats to irradiance, which is laid out by tiles; returns how many pixels were weighed.
pub(crate) fn splat(screen: &Screen, splats: &[Splat], light: &mut [[Lanes; 3]]) -> u64 {
    let columns = screen.tiles[0];
    let tiles = |splat: &Splat| {
        let range = |axis: usize| {
            usize::from(splat.low[axis]) / TILE..usize::from(splat.high[axis]).div_ceil(TILE)
        };
        let across = range(0);
        range(1).flat_map(move |row| across.clone().map(move |column| row * columns + column))
    };
    let mut firsts = vec![0_u32; columns * screen.tiles[1] + 1];
    for splat in splats {
        for tile in tiles(splat) {
            firsts[tile + 1] += 1;
        }
    }
    for tile in 1..firsts.len() {
        firsts[tile] += firsts[tile - 1];
    }
    let mut next = firsts.clone();
    let mut listed = vec![0_u32; firsts[firsts.len() - 1] as usize];
    for (index, splat) in splats.iter().enumerate() {
        for tile in tiles(splat) {
            listed[next[tile] as usize] = index as u32;
            next[tile] += 1;
        }
    }
    let per_tile = TILE * TILE / LANES;
    light
        .par_chunks_mut(per_tile)
        .enumerate()
        .map(|(tile, light)| {
            let list = &listed[firsts[tile] as usize..firsts[tile + 1] as usize];
            let mut weighed = 0;
            vectorised(|| {
                for &index in list {
                    weighed += add(screen, tile, &splats[index as usize], light);
                }
            });
            weighed
        })
        .sum()
}

/// Adds a photon to the pixels of a tile.
#[inline(always)]
fn add(screen: &Screen, tile: usize, splat: &Splat, light: &mut [[Lanes; 3]]) -> u64 {
    let corner = [tile % screen.tiles[0] * TILE, tile / screen.tiles[0] * TILE];
    let range = |axis: usize| {
        let low = usize::from(splat.low[axis]).saturating_sub(corner[axis]);
        low..(usize::from(splat.high[axis]) - corner[axis]).min(TILE)
    };
    let (across, down) = (range(0), range(1));
    let blocks = across.start / LANES..across.end.div_ceil(LANES);
    let base = tile * (TILE * TILE / LANES);
    let Splat {
        footprint, towards, ..
    } = splat;
    let mut weighed = 0;
    for row in down {
        for block in blocks.clone() {
            let index = row * (TILE / LANES) + block;
            let pixels = &screen.pixels[base + index];
            let sums = &mut light[index];
            let [p, n] = [&pixels.positions, &pixels.normals];
            let mut weights = [0.0; LANES];
            for lane in 0..LANES {
                let (x, y, z) = (
                    p[0][lane] - footprint.position.x,
                    p[1][lane] - footprint.position.y,
                    p[2][lane] - footprint.position.z,
                );
                let along = |row: Vec3| row.x * x + row.y * y + row.z * z;
                let [u, v, w] = footprint.filter.map(along);
                let rest = 1.0 - (u * u + v * v + w * w);
                let facing = |d: Vec3| n[0][lane] * d.x + n[1][lane] * d.y + n[2][lane] * d.z;
                let lit = rest > 0.0 && facing(*towards) > 0.0 && facing(footprint.normal) > 0.0;
                weights[lane] = if lit { rest * rest } else { 0.0 };
            }
            for (sums, peak) in sums.iter_mut().zip(footprint.peak.to_array()) {
                for lane in 0..LANES {
                    sums[lane] += weights[lane] * peak;
                }
            }
            weighed += LANES as u64;
        }
    }
    weighed
}

/// The pixels that a parallelogram around a point may overlap; none where it is out of the picture.
fn reach(
    screen: &Screen,
    position: Vec3,
    sides: [Vec3; 2],
    thickness: Vec3,
) -> Option<[[u16; 2]; 2]> {
    let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
    for corner in 0..8 {
        let sign = |bit: u32| if corner >> bit & 1 == 0 { -0.5 } else { 0.5 };
        let at = position + sign(0) * sides[0] + sign(1) * sides[1] + sign(2) * thickness;
        // Behind the viewer's plane the projection means nothing.
        let at = screen.project(at)?;
        low = low.min(at);
        high = high.max(at);
    }
    let size = Vec2::new(screen.size[0] as f32, screen.size[1] as f32);
    let low = (low - 0.5).ceil().max(Vec2::ZERO);
    let high = (high - 0.5).floor().min(size - 1.0);
    let inside = low.cmple(high).all();
    inside.then(|| {
        [
            [low.x as u16, low.y as u16],
            [high.x as u16 + 1, high.y as u16 + 1],
        ]
    })
}
