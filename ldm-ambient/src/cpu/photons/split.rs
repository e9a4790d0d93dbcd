//! Stages 8 and 9, as in the paper: photons are split along the maps, and their parts are splatted where the camera sees them land.
//!
//! A part lands in a pixel's plane: the distance that the map tells, known up to a pixel of the map, chooses the surface and
//! is then made exact. Where the middle of a footprint is hidden or outside of the picture but the surface around it is not,
//! it counts nevertheless, so that silhouettes and borders do not darken.

use std::time::Instant;

use glam::{Vec2, Vec3};
use isophote_scene::{Pass, reference::Progress};
use rayon::prelude::*;

use super::{
    PhotonParams,
    emission::Photon,
    footprint::Footprint,
    screen::Screen,
    splat::{Splat, splat},
};
use crate::cpu::{
    Triangles,
    aim::Aim,
    lanes::{LANES, Lanes, Simd, Work, with_registers},
    maps::{Map, Scratch},
    occlusion::MAPS,
    points::PointBlock,
    view::{View, longest_axis},
};

/// Blocks of photons that are split together.
const CHUNK: usize = 32;
/// The smallest cosine at which a photon may land.
const GRAZING: f32 = 0.01;

/// Photons that are split.
pub(super) struct Split<'a> {
    triangles: &'a Triangles<'a>,
    photons: &'a [Photon],
    blocks: Vec<PointBlock>,
    /// Σ cosθ over the directions of each photon.
    weights: Vec<f32>,
    views: Vec<View>,
    screen: &'a Screen,
    params: &'a PhotonParams,
}

impl<'a> Split<'a> {
    pub(super) fn new(
        triangles: &'a Triangles<'a>,
        photons: &'a [Photon],
        screen: &'a Screen,
        params: &'a PhotonParams,
    ) -> Self {
        let points: Vec<_> = photons.iter().map(|photon| photon.point).collect();
        let blocks = PointBlock::pack(&points, triangles.origin);
        let directions = params.directions();
        let weight = |photon: &Photon| {
            let cosines = directions
                .iter()
                .map(|vector| vector.dot(photon.point.shading_normal).abs());
            cosines.sum()
        };
        let boxes: Vec<_> = blocks.chunks(LANES).map(PointBlock::bounds).collect();
        let fit = |&direction: &Vec3| {
            View::fit(
                direction,
                triangles.origin,
                &boxes,
                longest_axis(&triangles.bounds),
                params.maps.resolution,
            )
        };
        Self {
            triangles,
            photons,
            weights: photons.par_iter().map(weight).collect(),
            views: match boxes.is_empty() {
                true => Vec::new(),
                false => directions.iter().map(fit).collect(),
            },
            blocks,
            screen,
            params,
        }
    }

    /// Sends a part of every photon along every map; returns how many parts were splatted.
    pub(super) fn along_all_maps(
        &self,
        light: &mut [[Lanes; 3]],
        passes: &mut Vec<Pass>,
        progress: &dyn Progress,
    ) -> u64 {
        let mut seconds = [0.0; 3];
        let (mut splatted, mut done) = (0, 0);
        let at_once = rayon::current_num_threads().clamp(MAPS[0], MAPS[1]);
        for views in self.views.chunks(at_once) {
            let start = Instant::now();
            let build =
                |scratch: &mut Scratch, view: &View| Map::build(self.triangles, *view, scratch);
            let maps: Vec<Map> = views.par_iter().map_init(Scratch::default, build).collect();
            let built = Instant::now();
            let chunks = self.blocks.len().div_ceil(CHUNK);
            let parts = maps
                .iter()
                .flat_map(|map| (0..chunks).map(move |chunk| (map, chunk)));
            let splats: Vec<Vec<Splat>> = parts
                .collect::<Vec<_>>()
                .into_par_iter()
                .map(|(map, chunk)| self.along(map, chunk * CHUNK))
                .collect();
            let split = Instant::now();
            let splats = splats.concat();
            splat(self.screen, &splats, light);
            splatted += splats.len() as u64;
            seconds[0] += (built - start).as_secs_f64();
            seconds[1] += (split - built).as_secs_f64();
            seconds[2] += split.elapsed().as_secs_f64();
            done += views.len() as u64;
            progress.advance(done, self.views.len() as u64);
        }
        let lookups = (self.photons.len() * self.views.len()) as u64;
        let rays = [0, lookups, 0];
        for ((name, seconds), rays) in ["maps", "split", "splat"]
            .into_iter()
            .zip(seconds)
            .zip(rays)
        {
            passes.push(Pass {
                name,
                rays,
                seconds,
                ..Pass::default()
            });
        }
        splatted
    }

    /// The splats of some photons along a map.
    fn along(&self, map: &Map, first: usize) -> Vec<Splat> {
        let mut splats = Vec::new();
        let blocks = &self.blocks[first..];
        with_registers(Along {
            split: self,
            map,
            first,
            blocks: &blocks[..blocks.len().min(CHUNK)],
            splats: &mut splats,
        });
        splats
    }

    /// Where a part of a photon lands, if it can be seen there.
    fn land(
        &self,
        photon: &Photon,
        direction: Vec3,
        t: f32,
        share: f32,
        pixel: f32,
    ) -> Option<Splat> {
        let start = photon.point.position;
        let differential = photon.spread(direction, self.params);
        let at = self.screen.project(start + t * direction)?;
        let across = differential
            .transfer(direction, t, -direction)
            .parallelogram();
        let radius = 0.5 * self.params.splat_size * across.sqrt();
        let pixels = radius * self.screen.pixels_per_metre(start + t * direction);
        let beyond = at.abs().max_element() - pixels
            > 2.0 * self.screen.size[0].max(self.screen.size[1]) as f32;
        if beyond || !pixels.is_finite() {
            return None;
        }
        let [x, y] = [Vec2::X, Vec2::Y].map(|axis| axis * pixels);
        let (position, normal, t) = [Vec2::ZERO, x, -x, y, -y].into_iter().find_map(|aside| {
            let (point, normal) = self.screen.surface(at + aside)?;
            let cosine = -direction.dot(normal);
            let off = (start + t * direction - point).dot(normal);
            let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
            let fits = cosine > GRAZING && off.abs() < pixel * (1.5 * sine + 0.5);
            let exact = t + off / cosine;
            let position = start + exact * direction;
            (fits && exact > 0.0).then_some((position, normal, exact))
        })?;
        let flux = share * photon.albedo * photon.flux;
        let sides = differential.transfer(direction, t, normal).position;
        let footprint = Footprint::new(position, normal, flux, sides, self.params)?;
        Splat::new(self.screen, footprint, -direction)
    }
}

/// Sends parts of some photons along a map.
struct Along<'a, 'b> {
    split: &'a Split<'b>,
    map: &'a Map,
    /// The number of the first block.
    first: usize,
    blocks: &'a [PointBlock],
    splats: &'a mut Vec<Splat>,
}

impl Work for Along<'_, '_> {
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self { split, map, .. } = self;
        let (origin, pixel) = (split.triangles.origin, map.view.pixel);
        let tolerance = split.params.maps.tolerance * pixel;
        for (offset, block) in self.blocks.iter().enumerate() {
            let aim = Aim::at(simd, map, block, tolerance);
            let above = simd.bits(aim.above);
            let (signs, cosines) = (simd.store(aim.signs), simd.store(aim.cosines));
            let (depths, ahead) = (simd.store(aim.depths), simd.store(aim.ahead));
            let first = (self.first + offset) * LANES;
            let photons = split.photons[first..].iter().zip(&split.weights[first..]);
            for (lane, (photon, weight)) in photons.take(LANES).enumerate() {
                if above >> lane & 1 == 0 || !ahead[lane].is_finite() {
                    continue;
                }
                // From the point itself, not from where it was moved to.
                let depth = (photon.point.position - origin).dot(map.view.forward);
                let t = ahead[lane] + signs[lane] * (depths[lane] - depth);
                let direction = signs[lane] * map.view.forward;
                let share = cosines[lane] / weight;
                self.splats
                    .extend(split.land(photon, direction, t, share, pixel));
            }
        }
    }
}
