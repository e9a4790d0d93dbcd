//! Stage 6, ambient occlusion and obscurance (§3.3, §4.1), streamed: maps are built, asked for every point and dropped.
//!
//! AO(x) = Σ V(x, ω) cosθ / Σ cosθ over the directions ω in the hemisphere of x, which are one of ±ω of each map (Eq. (2)
//! with the sum of its weights in the place of N/2, so that an open sky is 1 at every normal). V is 0 where the map has a
//! layer before x along ω within `d_max` (Eq. (3)), or t/`d_max` of the nearest for obscurance. Without it the first and last
//! layer of each pixel say all.

use std::sync::{Mutex, PoisonError};

use glam::Vec3;
use isophote_scene::{Aabb, reference::Progress};
use rayon::prelude::*;

use super::{
    aim::{Aim, Layers},
    lanes::{LANES, Lanes, Simd, Vectors, Work, with_registers},
    maps::{Extents, Quads, Redrawn, Scratch},
    points::{Point, PointBlock, Points},
    reach::{Reach, cells},
    triangles::Triangles,
    view::{View, longest_axis},
};
use crate::{Directions, OcclusionParams, Result};

/// Blocks of points that are asked together.
const CHUNK: usize = 64;
/// Points whose box maps are fitted around together.
const BOX: usize = 64;
/// The side of the cells in which points are looked for together, of `d_max`; and at least, of the scene's diagonal.
pub(crate) const CELL: f32 = 0.25;
pub(crate) const LEAST_CELL: f32 = 0.01;
/// Maps that are there at the same time, at least and at most; between them as many as there are threads.
pub(super) const MAPS: [usize; 2] = [4, 16];

/// What the sky means to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sky {
    /// Ambient occlusion, 0 to 1; 1 is unoccluded.
    pub ao: f32,
    /// The same with V = min(1, t / `d_max`); that of `ao` where `d_max` is infinite.
    pub obscurance: f32,
    /// The mean of the directions from which nothing is in the way, by cosine; unit, or zero where all is.
    pub bent_normal: Vec3,
}

impl Sky {
    /// Nothing in the way.
    pub const OPEN: Self = Self {
        ao: 1.0,
        obscurance: 1.0,
        bent_normal: Vec3::ZERO,
    };
}

/// Collects the occlusion of points.
///
/// Points that are added as one of several parts share the maps between them: of two parts, one is asked along every other
/// direction. So several points of a pixel cost what one does, and memory holds one part at a time.
pub struct Occlusion<'a> {
    triangles: &'a Triangles<'a>,
    params: OcclusionParams,
    directions: Vec<Vec3>,
    count: usize,
    /// Empty before the first points are found.
    totals: Vec<Total>,
    /// The weight of a pixel that has a point in every part.
    weight: f32,
    lookups: u64,
    most_bytes: usize,
}

/// What has been found for an index.
#[derive(Clone, Copy, Default)]
struct Total {
    weight: f32,
    ao: f32,
    obscurance: f32,
    bent: Vec3,
    /// Weight of the parts in which it has a point.
    seen: f32,
}

/// The sums of eight points.
#[derive(Clone, Copy, Default)]
struct Sums {
    weight: Lanes,
    ao: Lanes,
    obscurance: Lanes,
    bent: Vectors,
}

/// What is asked along the same directions.
struct Part<'a> {
    triangles: &'a Triangles<'a>,
    params: &'a OcclusionParams,
    views: &'a [View],
    blocks: &'a [PointBlock],
    sums: &'a mut [Sums],
}

impl<'a> Occlusion<'a> {
    /// For points whose indices are below `count`.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) for parameters out of their range.
    pub fn new(
        triangles: &'a Triangles<'a>,
        count: usize,
        params: &OcclusionParams,
    ) -> Result<Self> {
        params.check()?;
        let directions = Directions::new(params.maps.maps);
        let turned = |frame| directions.turned(params.seed, frame).vectors().to_vec();
        Ok(Self {
            triangles,
            params: *params,
            directions: (0..params.frames).flat_map(turned).collect(),
            count,
            totals: Vec::new(),
            weight: 0.0,
            lookups: 0,
            most_bytes: 0,
        })
    }

    /// Adds points as one part of so many.
    pub fn add(&mut self, points: &Points, [part, parts]: [u32; 2], progress: &dyn Progress) {
        let all = self.directions.len() as u64;
        let of_part = self
            .directions
            .iter()
            .skip(part as usize)
            .step_by(parts as usize);
        let directions: Vec<Vec3> = of_part.copied().collect();
        // The mean cosine over a hemisphere is a half.
        let weight = 0.5 * directions.len() as f32;
        self.weight += weight;
        if points.is_empty() {
            return;
        }
        // Those near to each other ask the same part of a map.
        let order = points.along_curve();
        let origin = self.triangles.origin;
        let blocks = PointBlock::pack_in(&order, &points.points, origin);
        let mut sums = vec![Sums::default(); blocks.len()];
        let around =
            |points: &[Point]| Aabb::around(points.iter().map(|point| point.position - origin));
        let boxes: Vec<Aabb> = points.points.par_chunks(BOX).map(around).collect();
        let bounds = boxes
            .iter()
            .fold(Aabb::EMPTY, |bounds, other| bounds.union(other));
        let d_max = self.params.d_max;
        // Boxes without an end overlap everything.
        let near = self.triangles.near(&Aabb {
            min: bounds.min - d_max,
            max: bounds.max + d_max,
        });
        let triangles = near.as_ref().unwrap_or(self.triangles);
        let (longest, resolution) = (longest_axis(&bounds), self.params.maps.resolution);
        let views: Vec<View> = directions
            .par_iter()
            .map(|&direction| View::fit(direction, origin, &boxes, longest, resolution))
            .collect();
        let fixed = size_of_val(&blocks[..])
            + size_of_val(&sums[..])
            + size_of_val(&self.totals[..])
            + size_of_val(&boxes[..])
            + size_of_val(&order[..])
            + near.as_ref().map_or(0, Triangles::bytes);
        let before = all * u64::from(part) / u64::from(parts);
        let advance = |done: usize| progress.advance((before + done as u64).min(all), all);
        let asked = Part {
            triangles,
            params: &self.params,
            views: &views,
            blocks: &blocks,
            sums: &mut sums,
        };
        let of_maps = match d_max.is_finite() {
            true => asked.stream::<Quads>(&advance),
            false => asked.stream::<Extents>(&advance),
        };
        self.most_bytes = self.most_bytes.max(fixed + of_maps);
        self.lookups += (points.len() * views.len()) as u64;
        drop(blocks);
        self.totals.resize(self.count, Total::default());
        for (place, &number) in order.iter().enumerate() {
            let (sums, lane) = (&sums[place / LANES], place % LANES);
            let total = &mut self.totals[points.indices[number as usize] as usize];
            total.weight += sums.weight[lane];
            total.ao += sums.ao[lane];
            total.obscurance += sums.obscurance[lane];
            total.bent += Vec3::from_array(sums.bent.map(|axis| axis[lane]));
            total.seen += weight;
        }
    }

    /// Look-ups so far: pairs of a point and a map.
    pub fn lookups(&self) -> u64 {
        self.lookups
    }

    /// Most bytes held at once so far, beyond the scene and the points that were given.
    pub fn most_bytes(&self) -> usize {
        self.most_bytes
    }

    /// The sky of each index; open where there was no point.
    pub fn skies(&self) -> Vec<Sky> {
        let sky = |total: &Total| {
            let missing = self.weight - total.seen;
            let weight = total.weight + missing;
            // A point whose hemisphere has no direction is open.
            let share = |sum: f32| {
                if weight > 0.0 {
                    (sum + missing) / weight
                } else {
                    1.0
                }
            };
            Sky {
                ao: share(total.ao),
                obscurance: share(total.obscurance),
                bent_normal: total.bent.normalize_or_zero(),
            }
        };
        let none = Total::default();
        let totals = (0..self.count).map(|index| self.totals.get(index).unwrap_or(&none));
        totals.map(sky).collect()
    }
}

impl Part<'_> {
    /// Draws maps, asks them and draws others in the same memory; returns how many bytes those took at most.
    fn stream<M: Redrawn + Layers>(self, advance: &dyn Fn(usize)) -> usize {
        let at_once = rayon::current_num_threads().clamp(MAPS[0], MAPS[1]);
        let mut maps: Vec<M> = Vec::new();
        maps.resize_with(at_once.min(self.views.len()), M::default);
        let scratches: Mutex<Vec<Scratch>> = Mutex::default();
        let free = || scratches.lock().unwrap_or_else(PoisonError::into_inner);
        let d_max = self.params.d_max;
        let size = self.triangles.bounds.diagonal();
        let near =
            (d_max < size).then(|| cells(self.blocks, (CELL * d_max).max(LEAST_CELL * size)));
        let mut done = 0;
        for views in self.views.chunks(at_once) {
            let draw = |(map, view): (&mut M, &View)| {
                let mut scratch = free().pop().unwrap_or_default();
                let reach = near.as_ref().map(|boxes| Reach::new(view, boxes, d_max));
                map.redraw(self.triangles, *view, reach.as_ref(), &mut scratch);
                free().push(scratch);
            };
            maps.par_iter_mut().zip(views).for_each(draw);
            let maps = &maps[..views.len()];
            self.blocks
                .par_chunks(CHUNK)
                .zip(self.sums.par_chunks_mut(CHUNK))
                .for_each(|(blocks, sums)| look_up(maps, blocks, sums, self.params));
            done += views.len();
            advance(done);
        }
        let scratches: usize = free().iter().map(Scratch::bytes).sum();
        scratches + maps.iter().map(M::bytes).sum::<usize>()
    }
}

fn look_up<M: Layers>(
    maps: &[M],
    blocks: &[PointBlock],
    sums: &mut [Sums],
    params: &OcclusionParams,
) {
    for map in maps {
        with_registers(Accumulate {
            map,
            blocks,
            sums,
            tolerance: params.maps.tolerance * map.view().pixel,
            d_max: params.d_max,
        });
    }
}

/// Adds what eight points after another see.
struct Accumulate<'a, M> {
    map: &'a M,
    blocks: &'a [PointBlock],
    sums: &'a mut [Sums],
    /// Metres.
    tolerance: f32,
    d_max: f32,
}

impl<M: Layers> Work for Accumulate<'_, M> {
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Vec3 { x, y, z } = self.map.view().forward;
        let forward = [simd.splat(x), simd.splat(y), simd.splat(z)];
        let (zero, one) = (simd.splat(0.0), simd.splat(1.0));
        let (d_max, share) = (simd.splat(self.d_max), simd.splat(1.0 / self.d_max));
        for (block, sums) in self.blocks.iter().zip(self.sums) {
            let aim = Aim::at(simd, self.map, block, self.tolerance);
            let hidden = simd.less(aim.ahead, d_max);
            let obscurance = simd.select(hidden, simd.mul(aim.ahead, share), one);
            let lit = simd.select(aim.above, aim.cosines, zero);
            let open = simd.select(hidden, zero, lit);
            let along = simd.mul(aim.signs, open);
            add(simd, &mut sums.weight, aim.cosines);
            add(simd, &mut sums.ao, open);
            add(simd, &mut sums.obscurance, simd.mul(lit, obscurance));
            for (sum, axis) in sums.bent.iter_mut().zip(forward) {
                add(simd, sum, simd.mul(along, axis));
            }
        }
    }
}

#[inline(always)]
fn add<S: Simd>(simd: S, sum: &mut Lanes, value: S::Floats) {
    *sum = simd.store(simd.add(simd.load(sum), value));
}

#[cfg(test)]
mod tests {
    use isophote_scene::{
        BuildTracer, BvhOptions, BvhTracer, Selection, builtin, reference::Normals,
    };

    use super::*;
    use crate::cpu::{lanes::Portable, maps::Map};

    /// Registers or not, to the bit.
    #[test]
    fn registers_compute_what_single_numbers_do() {
        let scene = std::sync::Arc::new(builtin::build("office").expect("a scene"));
        let select = Selection::default();
        let exact = BvhTracer::build(&scene, &select, &BvhOptions::default()).expect("a tracer");
        let triangles = Triangles::new(&scene, &scene.transforms(), &select).expect("triangles");
        let camera = &scene.cameras[0];
        let points = Points::from_camera(&scene, &exact, camera, [40, 30], 0, Normals::Smooth);
        let blocks = PointBlock::pack(&points.points, triangles.origin);
        let bounds = [PointBlock::bounds(&blocks)];
        for &direction in Directions::new(6).vectors() {
            let view = View::fit(direction, Vec3::ZERO, &bounds, Vec3::X, 60);
            let scratch = &mut Scratch::default();
            let layers = Map::build(&triangles, view, scratch);
            let (mut quads, mut extents) = (Quads::default(), Extents::default());
            quads.redraw(&triangles, view, None, scratch);
            extents.redraw(&triangles, view, None, scratch);
            let expected = sums(&layers, &blocks, false);
            assert_eq!(expected, sums(&layers, &blocks, true));
            // Layers in groups are the same layers.
            assert_eq!(expected, sums(&quads, &blocks, false));
            assert_eq!(expected, sums(&quads, &blocks, true));
            // What is out of reach is in nobody's way.
            let reach = Reach::new(&view, &bounds, 1.5);
            quads.redraw(&triangles, view, Some(&reach), scratch);
            assert_eq!(expected, sums(&quads, &blocks, false));
            let ends = sums(&extents, &blocks, false);
            assert_eq!(ends, sums(&extents, &blocks, true));
        }
    }

    fn sums<M: Layers>(map: &M, blocks: &[PointBlock], portable: bool) -> Vec<[Lanes; 6]> {
        let mut sums = vec![Sums::default(); blocks.len()];
        let work = Accumulate {
            map,
            blocks,
            sums: &mut sums,
            tolerance: 0.3 * map.view().pixel,
            d_max: 1.5,
        };
        if portable {
            work.run(Portable);
        } else {
            with_registers(work);
        }
        let values = sums.iter().map(|sums| {
            let [x, y, z] = sums.bent;
            [sums.weight, sums.ao, sums.obscurance, x, y, z]
        });
        values.collect()
    }
}
