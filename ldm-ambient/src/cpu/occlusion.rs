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
    lanes::{LANES, Lanes, Vectors, vectorised},
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
        let near = d_max.is_finite().then(|| {
            self.triangles.near(&Aabb {
                min: bounds.min - d_max,
                max: bounds.max + d_max,
            })
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
            // While it is built its fragments take twice as much again.
            Self::Layers(maps) => maps.iter().map(|map| 3 * map.bytes()).sum(),
            Self::Extents(maps) => maps.iter().map(|map| size_of_val(&map.ends[..])).sum(),
        }
    }

    /// Asks the maps one after another.
    fn look_up(&self, blocks: &[PointBlock], sums: &mut [Sums], params: &OcclusionParams) {
        let tolerance = params.maps.tolerance;
        match self {
            Self::Layers(maps) => {
                for map in maps {
                    let see = |aim: &Aim, near| see_within(map, aim, near, params.d_max);
                    vectorised(|| accumulate(map, blocks, sums, tolerance, see));
                }
            }
            Self::Extents(maps) => {
                for map in maps {
                    let see = |aim: &Aim, near| see_out(map, aim, near);
                    vectorised(|| accumulate(map, blocks, sums, tolerance, see));
                }
            }
        }
    }
}

/// Adds what eight points after another see.
#[inline(always)]
fn accumulate<M: Layers>(
    map: &M,
    blocks: &[PointBlock],
    sums: &mut [Sums],
    tolerance: f32,
    see: impl Fn(&Aim, f32) -> [Lanes; 2],
) {
    let view = map.view();
    let tolerance = tolerance * view.pixel;
    for (block, sums) in blocks.iter().zip(sums) {
        let aim = Aim::at(map, block, tolerance);
        let [ao, obscurance] = see(&aim, tolerance);
        for lane in 0..LANES {
            let cosine = aim.cosines[lane];
            let open = cosine * aim.above[lane];
            sums.weight[lane] += cosine;
            sums.ao[lane] += open * ao[lane];
            sums.obscurance[lane] += open * obscurance[lane];
            let along = aim.signs[lane] * open * ao[lane];
            sums.bent[0][lane] += along * view.forward.x;
            sums.bent[1][lane] += along * view.forward.y;
            sums.bent[2][lane] += along * view.forward.z;
        }
    }
}

/// Whether a layer is before each point, however far: by the first and last of its pixel.
#[inline(always)]
fn see_out(map: &Extents, aim: &Aim, tolerance: f32) -> [Lanes; 2] {
    let ends = aim.nearest.map(|pixel| map.ends[pixel as usize]);
    let open = std::array::from_fn(|lane| {
        let [low, high] = ends[lane];
        let depth = aim.nearest_depths[lane];
        let ahead = if aim.signs[lane] > 0.0 {
            high - depth
        } else {
            depth - low
        };
        f32::from(ahead <= tolerance)
    });
    [open, open]
}

/// Whether the nearest layer before each point is beyond `d_max`, and how far it is as a share of it.
#[inline(always)]
fn see_within(map: &Map, aim: &Aim, tolerance: f32, d_max: f32) -> [Lanes; 2] {
    let share: Lanes =
        std::array::from_fn(|lane| (map.ahead(aim, lane, tolerance) / d_max).min(1.0));
    [share.map(|share| f32::from(share >= 1.0)), share]
}
