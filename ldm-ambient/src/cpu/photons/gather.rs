//! Stage 9, backwards: instead of every part of a photon looking for the pixels that it lights, every point looks along each map
//! for the surface that lights it, and takes the footprints of the photons there.
//!
//! Both add the same parts. But a part that lands is smeared over the receiving surface, across its edges and its shadows, and
//! here the map decides for each point alone; and a point asks few footprints, where a splat has many pixels. Any points
//! can be lit: pixels, vertices, texels.

use std::time::Instant;

use glam::{Vec2, Vec3};
use isophote_scene::{Pass, reference::Progress};
use rayon::prelude::*;

use super::{PhotonParams, field::Field};
use crate::cpu::{
    Points, Triangles,
    aim::Aim,
    lanes::{LANES, Lanes, Simd, Work, with_registers},
    maps::{Map, Scratch},
    occlusion::MAPS,
    points::PointBlock,
    view::{View, longest_axis},
};

/// Blocks of points that are lit together.
const CHUNK: usize = 32;

/// The sums of eight points.
#[derive(Clone, Copy, Default)]
struct Sums {
    weight: Lanes,
    light: [[f32; 3]; LANES],
}

/// The light of a point by some of the maps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gathered {
    /// Σ cosθ B, W/m².
    pub light: Vec3,
    /// Σ cosθ.
    pub weight: f32,
}

impl Gathered {
    /// W/m².
    pub fn irradiance(&self) -> Vec3 {
        if self.weight > 0.0 {
            self.light / self.weight
        } else {
            Vec3::ZERO
        }
    }
}

/// The light of points, in their order, by every so manyth map.
pub(super) fn gather(
    triangles: &Triangles<'_>,
    field: &Field,
    points: &Points,
    [part, parts]: [u32; 2],
    params: &PhotonParams,
    progress: &dyn Progress,
) -> (Vec<Gathered>, [Pass; 2]) {
    let blocks = PointBlock::pack(&points.points, triangles.origin);
    let mut sums = vec![Sums::default(); blocks.len()];
    let directions = params.directions();
    let boxes: Vec<_> = blocks.chunks(LANES).map(PointBlock::bounds).collect();
    let longest = longest_axis(&triangles.bounds);
    let (origin, resolution) = (triangles.origin, params.maps.resolution);
    let fit = |&direction: &Vec3| View::fit(direction, origin, &boxes, longest, resolution);
    let views: Vec<View> = match points.is_empty() {
        true => Vec::new(),
        false => {
            let directions = directions.iter().skip(part as usize);
            directions.step_by(parts as usize).map(fit).collect()
        }
    };
    let at_once = rayon::current_num_threads().clamp(MAPS[0], MAPS[1]);
    let (mut building, mut gathering, mut done) = (0.0, 0.0, 0);
    for some in views.chunks(at_once) {
        let start = Instant::now();
        let build = |scratch: &mut Scratch, view: &View| Map::build(triangles, *view, scratch);
        let maps: Vec<Map> = some.par_iter().map_init(Scratch::default, build).collect();
        building += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let chunks = blocks.par_chunks(CHUNK).zip(sums.par_chunks_mut(CHUNK));
        chunks.for_each(|(blocks, sums)| {
            for map in &maps {
                with_registers(Light {
                    field,
                    map,
                    origin: triangles.origin,
                    tolerance: params.maps.tolerance * map.view.pixel,
                    blocks,
                    sums,
                });
            }
        });
        gathering += start.elapsed().as_secs_f64();
        done += some.len() as u64;
        progress.advance(done, views.len() as u64);
    }
    let lookups = (points.len() * views.len()) as u64;
    let passes = [("maps", building, 0), ("gather", gathering, lookups)];
    let passes = passes.map(|(name, seconds, rays)| Pass {
        name,
        rays,
        seconds,
        ..Pass::default()
    });
    let of_point = |index: usize| {
        let (sums, lane) = (&sums[index / LANES], index % LANES);
        Gathered {
            light: Vec3::from_array(sums.light[lane]),
            weight: sums.weight[lane],
        }
    };
    ((0..points.len()).map(of_point).collect(), passes)
}

/// Lights some points along a map: E = Σ cosθ B / Σ cosθ over the directions, B the radiosity where they end.
struct Light<'a> {
    field: &'a Field,
    map: &'a Map,
    origin: Vec3,
    /// Metres.
    tolerance: f32,
    blocks: &'a [PointBlock],
    sums: &'a mut [Sums],
}

impl Work for Light<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let view = &self.map.view;
        let corner = self.origin + view.low.x * view.right + view.low.y * view.up;
        for (block, sums) in self.blocks.iter().zip(self.sums) {
            let aim = Aim::at(simd, self.map, block, self.tolerance);
            let weight = simd.add(simd.load(&sums.weight), aim.cosines);
            sums.weight = simd.store(weight);
            let finite = simd.less(aim.ahead, simd.splat(f32::INFINITY));
            let mut lit = simd.bits(simd.and(aim.above, finite));
            let (signs, cosines) = (simd.store(aim.signs), simd.store(aim.cosines));
            let (depths, ahead) = (simd.store(aim.depths), simd.store(aim.ahead));
            let (columns, rows) = (simd.store(aim.columns), simd.store(aim.rows));
            while lit != 0 {
                let lane = lit.trailing_zeros() as usize;
                lit &= lit - 1;
                // The layer is the surface on the line of the pixel's centre.
                let at = (Vec2::new(columns[lane], rows[lane]) + 0.5) * view.pixel;
                let depth = depths[lane] + signs[lane] * ahead[lane];
                let place = corner + at.x * view.right + at.y * view.up + depth * view.forward;
                let radiosity = self.field.radiosity(place, -signs[lane] * view.forward);
                let light = cosines[lane] * radiosity;
                for (sum, light) in sums.light[lane].iter_mut().zip(light.to_array()) {
                    *sum += light;
                }
            }
        }
    }
}
