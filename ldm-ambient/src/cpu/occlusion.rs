//! Stage 6, ambient occlusion and obscurance (§3.3, §4.1), streamed: maps are built, asked for every point and dropped.
//!
//! AO(x) = Σ V(x, ω) cosθ / Σ cosθ over the directions ω in the hemisphere of x, which are one of ±ω of each map (Eq. (2)
//! with the sum of its weights in the place of N/2, so that an open sky is 1 at every normal). V is 0 where the map has a
//! layer before x along ω within `d_max` (Eq. (3)), or t/`d_max` of the nearest for obscurance. Without it the first and last
//! layer of each pixel say all.

use glam::Vec3;
use isophote_scene::{Aabb, reference::Progress};
use rayon::prelude::*;

use super::{
    aim::{Aim, Layers},
    lanes::{LANES, Lanes, Simd, Vectors, Work, with_registers},
    maps::{Extents, Map, Scratch},
    points::{PointBlock, Points},
    triangles::Triangles,
    view::{View, longest_axis},
};
use crate::{Directions, OcclusionParams, Result};

/// Blocks of points that are asked together.
const CHUNK: usize = 64;
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

/// The maps that are there at the same time.
enum Batch {
    Layers(Vec<Map>),
    Extents(Vec<Extents>),
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
            totals: vec![Total::default(); count],
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
        let blocks = PointBlock::pack(&points.points, self.triangles.origin);
        let mut sums = vec![Sums::default(); blocks.len()];
        let boxes: Vec<Aabb> = blocks.chunks(LANES).map(PointBlock::bounds).collect();
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
            .map(|&direction| View::fit(direction, &boxes, longest, resolution))
            .collect();
        let fixed = size_of_val(&blocks[..])
            + size_of_val(&sums[..])
            + size_of_val(&self.totals[..])
            + size_of_val(&boxes[..])
            + near.as_ref().map_or(0, Triangles::bytes);
        let at_once = rayon::current_num_threads().clamp(MAPS[0], MAPS[1]);
        let mut done = all * u64::from(part) / u64::from(parts);
        for views in views.chunks(at_once) {
            let maps = Batch::build(triangles, views, &self.params);
            self.most_bytes = self.most_bytes.max(fixed + maps.bytes());
            blocks
                .par_chunks(CHUNK)
                .zip(sums.par_chunks_mut(CHUNK))
                .for_each(|(blocks, sums)| maps.look_up(blocks, sums, &self.params));
            done += views.len() as u64;
            progress.advance(done.min(all), all);
        }
        self.lookups += (points.len() * views.len()) as u64;
        for (number, &index) in points.indices.iter().enumerate() {
            let (sums, lane) = (&sums[number / LANES], number % LANES);
            let total = &mut self.totals[index as usize];
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
        self.totals.iter().map(sky).collect()
    }
}

impl Batch {
    fn build(triangles: &Triangles<'_>, views: &[View], params: &OcclusionParams) -> Self {
        let views = views.par_iter();
        if params.d_max.is_finite() {
            let build = |scratch: &mut Scratch, view: &View| Map::build(triangles, *view, scratch);
            Self::Layers(views.map_init(Scratch::default, build).collect())
        } else {
            Self::Extents(views.map(|view| Extents::build(triangles, *view)).collect())
        }
    }

    fn bytes(&self) -> usize {
        match self {
            // While a thread builds one, its fragments take twice as much again.
            Self::Layers(maps) => {
                let built = maps.iter().map(Map::bytes);
                let largest = built.clone().max().unwrap_or(0);
                built.sum::<usize>() + 2 * largest * rayon::current_num_threads().min(maps.len())
            }
            Self::Extents(maps) => maps.iter().map(Extents::bytes).sum(),
        }
    }

    /// Asks the maps one after another.
    fn look_up(&self, blocks: &[PointBlock], sums: &mut [Sums], params: &OcclusionParams) {
        match self {
            Self::Layers(maps) => look_up(maps, blocks, sums, params),
            Self::Extents(maps) => look_up(maps, blocks, sums, params),
        }
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
    use crate::cpu::lanes::Portable;

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
            let view = View::fit(direction, &bounds, Vec3::X, 60);
            let layers = Map::build(&triangles, view, &mut Scratch::default());
            let extents = Extents::build(&triangles, view);
            assert_eq!(sums(&layers, &blocks, false), sums(&layers, &blocks, true));
            assert_eq!(
                sums(&extents, &blocks, false),
                sums(&extents, &blocks, true)
            );
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
