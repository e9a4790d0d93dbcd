//! What glossy surfaces show (§6): of the directions that the maps look along, up or down, the one that is nearest to the ray that
//! a surface reflects is asked instead of it. Points that share a direction share its map, which is fitted around them.
//!
//! The answer is that of a ray beside the right one by up to [`Directions::largest_angle`](crate::Directions::largest_angle): what a
//! mirror shows of a surface is off by that angle's tangent times its distance. What comes from beyond the scene needs no map,
//! so it is the environment's in the right direction.

use std::{f32::consts::PI, time::Instant};

use glam::{Vec2, Vec3};
use isophote_scene::{Aabb, Environment, Pass, reference::Progress};
use rayon::prelude::*;

use super::{PhotonParams, field::Field};
use crate::cpu::{
    Points, Triangles,
    aim::Aim,
    lanes::{LANES, Simd, Work, with_registers},
    maps::{Map, Scratch},
    points::{Point, PointBlock},
    view::{View, longest_axis},
};

/// Points whose box a map is fitted around together.
const BOX: usize = 64;

/// What arrives along a reflected ray, W/(sr·m²).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mirrored {
    /// From a surface that photons light.
    pub light: Vec3,
    /// From the environment.
    pub sky: Vec3,
}

pub(super) struct Mirror<'a> {
    pub(super) triangles: &'a Triangles<'a>,
    pub(super) field: &'a Field,
    pub(super) environment: &'a Environment,
    pub(super) params: &'a PhotonParams,
}

impl Mirror<'_> {
    /// What arrives at points from unit directions, in their order.
    pub(super) fn look(
        &self,
        points: &Points,
        towards: &[Vec3],
        progress: &dyn Progress,
    ) -> (Vec<Mirrored>, [Pass; 2]) {
        let directions = self.params.directions();
        let points = &points.points;
        let start = Instant::now();
        let pairs = points.par_iter().zip(towards);
        let nearest = pairs.map(|(point, towards)| nearest(&directions, point, *towards));
        let nearest: Vec<u32> = nearest.collect();
        // By direction, then in their order.
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        order.par_sort_by_key(|&index| nearest[index as usize]);
        let groups: Vec<&[u32]> = order
            .chunk_by(|&a, &b| nearest[a as usize] == nearest[b as usize])
            .collect();
        let sorting = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let group = |scratch: &mut Scratch, group: &&[u32]| {
            let direction = directions[nearest[group[0] as usize] as usize];
            self.along(direction, group, points, towards, scratch)
        };
        let mut found = vec![Mirrored::default(); points.len()];
        let (mut done, all) = (0, groups.len() as u64);
        for some in groups.chunks(64) {
            let seen: Vec<Vec<Mirrored>> =
                some.par_iter().map_init(Scratch::default, group).collect();
            for (group, seen) in some.iter().zip(seen) {
                for (&index, seen) in group.iter().zip(seen) {
                    found[index as usize] = seen;
                }
            }
            done += some.len() as u64;
            progress.advance(done, all);
        }
        let looking = start.elapsed().as_secs_f64();
        let passes = [("nearest", sorting, 0), ("mirror", looking, points.len())];
        let passes = passes.map(|(name, seconds, rays)| Pass {
            name,
            rays: rays as u64,
            seconds,
            ..Pass::default()
        });
        (found, passes)
    }

    fn along(
        &self,
        direction: Vec3,
        group: &[u32],
        points: &[Point],
        towards: &[Vec3],
        scratch: &mut Scratch,
    ) -> Vec<Mirrored> {
        let origin = self.triangles.origin;
        let around = |some: &[u32]| {
            Aabb::around(
                some.iter()
                    .map(|&index| points[index as usize].position - origin),
            )
        };
        let boxes: Vec<Aabb> = group.chunks(BOX).map(around).collect();
        let longest = longest_axis(&self.triangles.bounds);
        let resolution = self.params.maps.resolution;
        let view = View::fit(direction, origin, &boxes, longest, resolution);
        let map = Map::build(self.triangles, view, scratch);
        let mut found = Vec::with_capacity(group.len() + LANES);
        with_registers(Reflect {
            map: &map,
            field: self.field,
            origin,
            tolerance: self.params.maps.tolerance * view.pixel,
            blocks: &PointBlock::pack_in(group, points, origin),
            found: &mut found,
        });
        let outside = |(&index, seen): (&u32, Option<Vec3>)| match seen {
            Some(light) => Mirrored {
                light,
                sky: Vec3::ZERO,
            },
            None => Mirrored {
                light: Vec3::ZERO,
                sky: self.environment.radiance(towards[index as usize]),
            },
        };
        group.iter().zip(found).map(outside).collect()
    }
}

/// The direction that is nearest to a vector among those that are above a point's surface.
fn nearest(directions: &[Vec3], point: &Point, towards: Vec3) -> u32 {
    let mut best = (0, f32::NEG_INFINITY);
    for (index, direction) in directions.iter().enumerate() {
        let above = 1_f32.copysign(direction.dot(point.shading_normal));
        let cosine = above * direction.dot(towards);
        if cosine > best.1 {
            best = (index as u32, cosine);
        }
    }
    best.0
}

/// The radiance that points see along a map above them; none where there is nothing.
struct Reflect<'a> {
    map: &'a Map,
    field: &'a Field,
    origin: Vec3,
    /// Metres.
    tolerance: f32,
    blocks: &'a [PointBlock],
    found: &'a mut Vec<Option<Vec3>>,
}

impl Work for Reflect<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let view = &self.map.view;
        let corner = self.origin + view.low.x * view.right + view.low.y * view.up;
        for block in self.blocks {
            let aim = Aim::at(simd, self.map, block, self.tolerance);
            let above = simd.bits(aim.above);
            let (signs, depths) = (simd.store(aim.signs), simd.store(aim.depths));
            let (columns, rows) = (simd.store(aim.columns), simd.store(aim.rows));
            for (lane, ahead) in simd.store(aim.ahead).into_iter().enumerate() {
                if above >> lane & 1 == 0 {
                    // Below the surface: nothing is lit there, and nothing is beyond.
                    self.found.push(Some(Vec3::ZERO));
                    continue;
                }
                if !ahead.is_finite() {
                    self.found.push(None);
                    continue;
                }
                let at = (Vec2::new(columns[lane], rows[lane]) + 0.5) * view.pixel;
                let depth = depths[lane] + signs[lane] * ahead;
                let place = corner + at.x * view.right + at.y * view.up + depth * view.forward;
                let radiosity = self.field.radiosity(place, -signs[lane] * view.forward);
                self.found.push(Some(radiosity / PI));
            }
        }
    }
}
