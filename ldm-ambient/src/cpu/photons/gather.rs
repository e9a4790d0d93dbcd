//! Stage 9, backwards: instead of every part of a photon looking for the pixels that it lights, every point looks along each map
//! for the surface that lights it, and takes the footprints of the photons there.
//!
//! Both add the same parts. But a part that lands is smeared over the receiving surface, across its edges and its shadows, and
//! here the map decides for each point alone; and a point asks few footprints, where a splat has many pixels. Any points
//! can be lit: pixels, vertices, texels.
//!
//! A direction along which a map has nothing is the environment's (Fig. 11): points add what comes from its region of the sphere.

use std::{f32::consts::PI, time::Instant};

use glam::{Vec2, Vec3};
use isophote_scene::{Pass, Tracer, reference::Progress};
use rayon::prelude::*;

use super::{PhotonParams, field::Field};
use crate::cpu::{
    Points, Triangles,
    aim::{Aim, Layers},
    lanes::{LANES, Lanes, Simd, Work, with_registers},
    maps::{Extents, Map, Redrawn, Scratch},
    occlusion::MAPS,
    points::PointBlock,
    room::Room,
    view::{View, longest_axis},
};

/// Blocks of points that are lit together.
const CHUNK: usize = 32;

/// The sums of eight points.
#[derive(Clone, Copy, Default)]
struct Sums {
    weight: Lanes,
    light: [[f32; 3]; LANES],
    sky: [Lanes; 3],
}

/// The light of a point by some of the maps. Directions in which it could not be moved to a pixel (`room`) are in no sum.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gathered {
    /// Σ cosθ B, W/m².
    pub light: Vec3,
    /// Σ cosθ π L of the directions that meet nothing, L the environment's radiance there, W/m².
    pub sky: Vec3,
    /// Σ cosθ.
    pub weight: f32,
}

impl Gathered {
    /// By light that bounced, W/m².
    pub fn irradiance(&self) -> Vec3 {
        self.mean(self.light)
    }

    /// Straight from the environment, W/m².
    pub fn sky_irradiance(&self) -> Vec3 {
        self.mean(self.sky)
    }

    fn mean(&self, sum: Vec3) -> Vec3 {
        if self.weight > 0.0 {
            sum / self.weight
        } else {
            Vec3::ZERO
        }
    }
}

/// What points look for.
#[derive(Clone, Copy)]
pub(super) struct Shining<'a> {
    /// Light on surfaces.
    pub(super) field: &'a Field,
    /// What comes from beyond along each direction of all frames, and along its opposite, W/(sr·m²); empty where nothing does.
    pub(super) sky: &'a [[Vec3; 2]],
}

/// The light of points, in their order, by every so manyth map.
pub(super) fn gather(
    (triangles, exact): (&Triangles<'_>, &dyn Tracer),
    shining: Shining<'_>,
    points: &Points,
    part: [u32; 2],
    params: &PhotonParams,
    progress: &dyn Progress,
) -> (Vec<Gathered>, [Pass; 3]) {
    let gathering = Gathering {
        triangles,
        exact,
        shining,
        points,
        part,
        params,
        progress,
    };
    if shining.field.is_empty() {
        // Whether there is anything is all that is asked.
        return gathering.by(|scratch, view| {
            let mut map = Extents::default();
            map.redraw(triangles, *view, None, scratch);
            map
        });
    }
    gathering.by(|scratch, view| Map::build(triangles, *view, scratch))
}

struct Gathering<'a> {
    triangles: &'a Triangles<'a>,
    exact: &'a dyn Tracer,
    shining: Shining<'a>,
    points: &'a Points,
    part: [u32; 2],
    params: &'a PhotonParams,
    progress: &'a dyn Progress,
}

impl Gathering<'_> {
    fn by<M: Layers + Send + Sync>(
        &self,
        build: impl Fn(&mut Scratch, &View) -> M + Sync,
    ) -> (Vec<Gathered>, [Pass; 3]) {
        let origin = self.triangles.origin;
        let blocks = PointBlock::pack(&self.points.points, origin);
        let mut sums = vec![Sums::default(); blocks.len()];
        let ways = self.ways(&blocks);
        let start = Instant::now();
        let rooms = self.rooms(&ways);
        let measuring = start.elapsed().as_secs_f64();
        let short = 4 * u64::from(!self.shining.field.is_empty()) * self.points.len() as u64;
        let at_once = rayon::current_num_threads().clamp(MAPS[0], MAPS[1]);
        let (mut building, mut gathering, mut done) = (0.0, 0.0, 0);
        for some in ways.chunks(at_once) {
            let start = Instant::now();
            let build = |scratch: &mut Scratch, (view, sky): &(View, [Vec3; 2])| {
                (build(scratch, view), *sky)
            };
            let maps: Vec<(M, [Vec3; 2])> =
                some.par_iter().map_init(Scratch::default, build).collect();
            building += start.elapsed().as_secs_f64();
            let start = Instant::now();
            let chunks = blocks.par_chunks(CHUNK).zip(rooms.par_chunks(CHUNK));
            let chunks = chunks.zip(sums.par_chunks_mut(CHUNK));
            chunks.for_each(|((blocks, rooms), sums)| {
                for (map, sky) in &maps {
                    with_registers(Light {
                        field: self.shining.field,
                        map,
                        sky: *sky,
                        origin,
                        tolerance: self.params.maps.tolerance * map.view().pixel,
                        blocks,
                        rooms,
                        sums,
                    });
                }
            });
            gathering += start.elapsed().as_secs_f64();
            done += some.len() as u64;
            self.progress.advance(done, ways.len() as u64);
        }
        let lookups = (self.points.len() * ways.len()) as u64;
        let passes = [
            ("room", measuring, short),
            ("maps", building, 0),
            ("gather", gathering, lookups),
        ];
        let passes = passes.map(|(name, seconds, rays)| Pass {
            name,
            rays,
            seconds,
            ..Pass::default()
        });
        let of_point = |index: usize| sums[index / LANES].of(index % LANES);
        ((0..self.points.len()).map(of_point).collect(), passes)
    }

    /// The room of the points. The sky alone does not need it: what is beside a point hides it whichever side it is seen from.
    fn rooms(&self, ways: &[(View, [Vec3; 2])]) -> Vec<Option<Room>> {
        let points = &self.points.points;
        if self.shining.field.is_empty() {
            return vec![None; points.len().div_ceil(LANES)];
        }
        let pixels = ways.iter().map(|(view, _)| view.pixel);
        Room::measure(self.exact, points, pixels.fold(0.0, f32::max))
    }

    /// The views of this part's maps, fitted around the points, and what comes from beyond along them.
    fn ways(&self, blocks: &[PointBlock]) -> Vec<(View, [Vec3; 2])> {
        if blocks.is_empty() {
            return Vec::new();
        }
        let boxes: Vec<_> = blocks.chunks(LANES).map(PointBlock::bounds).collect();
        let longest = longest_axis(&self.triangles.bounds);
        let (origin, resolution) = (self.triangles.origin, self.params.maps.resolution);
        let [part, parts] = self.part.map(|number| number as usize);
        let directions = self.params.directions().into_iter().enumerate();
        let way = |(index, direction): (usize, Vec3)| {
            let sky = self.shining.sky.get(index).copied().unwrap_or_default();
            (
                View::fit(direction, origin, &boxes, longest, resolution),
                sky,
            )
        };
        directions.skip(part).step_by(parts).map(way).collect()
    }
}

impl Sums {
    fn of(&self, lane: usize) -> Gathered {
        Gathered {
            light: Vec3::from_array(self.light[lane]),
            sky: Vec3::from_array(self.sky.map(|channel| channel[lane])),
            weight: self.weight[lane],
        }
    }
}

/// Lights some points along a map: E = Σ cosθ B / Σ cosθ over the directions, B the radiosity where they end, or π times the
/// environment's radiance where they do not.
struct Light<'a, M> {
    field: &'a Field,
    map: &'a M,
    /// Along the map's direction, and along its opposite.
    sky: [Vec3; 2],
    origin: Vec3,
    /// Metres.
    tolerance: f32,
    blocks: &'a [PointBlock],
    rooms: &'a [Option<Room>],
    sums: &'a mut [Sums],
}

impl<M: Layers> Work for Light<'_, M> {
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let view = self.map.view();
        let corner = self.origin + view.low.x * view.right + view.low.y * view.up;
        let [ahead, behind] = self.sky.map(|radiance| PI * radiance);
        let (zero, infinite) = (simd.splat(0.0), simd.splat(f32::INFINITY));
        let is_dark = self.sky == [Vec3::ZERO; 2];
        let blocks = self.blocks.iter().zip(self.rooms);
        for ((block, room), sums) in blocks.zip(self.sums) {
            let aim = Aim::within(simd, self.map, (block, room.as_ref()), self.tolerance);
            let weight = simd.add(simd.load(&sums.weight), aim.cosines);
            sums.weight = simd.store(weight);
            let finite = simd.less(aim.ahead, infinite);
            if !is_dark {
                let open = simd.select(simd.and_not(aim.above, finite), aim.cosines, zero);
                let is_behind = simd.less(aim.signs, zero);
                for channel in 0..3 {
                    let there = simd.splat(ahead[channel]);
                    let radiosity = simd.select(is_behind, simd.splat(behind[channel]), there);
                    let sum = simd.load(&sums.sky[channel]);
                    sums.sky[channel] = simd.store(simd.add(sum, simd.mul(open, radiosity)));
                }
            }
            let mut lit = match self.field.is_empty() {
                true => 0,
                false => simd.bits(simd.and(aim.above, finite)),
            };
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
