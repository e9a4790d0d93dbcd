//! Stage 6, ambient occlusion and obscurance (§3.3, §4.1), streamed: maps are built, asked for every point and dropped.
//!
//! AO(x) = Σ V(x, ω) cosθ / Σ cosθ over the directions ω in the hemisphere of x, which are one of ±ω of each map (Eq. (2)
//! with the sum of its weights in the place of N/2, so that an open sky is 1 at every normal). V is 0 where the map has a
//! layer before x along ω within `d_max` (Eq. (3)), or t/`d_max` of the nearest for obscurance. Without it the first and last
//! layer of each pixel say all.
//!
//! A layer is the surface at the centre of a pixel, and x is not there: x is moved to the centre's line within the plane it
//! lies in, so that a plane never shadows itself however steep the map sees it. Where the surface of x does not reach so far,
//! in a corner or at an edge, another of the four pixels around x is asked.

use glam::Vec3;
use isophote_scene::{Aabb, reference::Progress};
use rayon::prelude::*;

use super::{
    lanes::{LANES, Lanes, Vectors, dot, vectorised},
    maps::{Extents, Map, Scratch},
    points::{PointBlock, Points},
    triangles::Triangles,
    view::{View, longest_axis},
};
use crate::{Directions, OcclusionParams, Result};

/// How far a point is moved at most along a map's direction to reach a pixel's centre, pixels.
const STEEPEST: f32 = 64.0;
/// Blocks of points that are asked together.
const CHUNK: usize = 64;
/// Maps that are there at the same time, at least and at most; between them as many as there are threads.
const MAPS: [usize; 2] = [4, 16];

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

/// Where eight points look along a map.
struct Aim {
    /// Places in the map, pixels.
    at: [Lanes; 2],
    /// There, metres along the map's direction.
    depths: Lanes,
    /// How much deeper the point's plane is a pixel further, metres.
    slopes: [Lanes; 2],
    /// 1 for the map's direction, −1 for its opposite.
    signs: Lanes,
    /// Of the shading normal, at least 0.
    cosines: Lanes,
    /// 1, or 0 where the direction is below the surface.
    above: Lanes,
    /// The nearest pixel.
    nearest: [u32; LANES],
    /// On the line of its centre.
    nearest_depths: Lanes,
}

/// A map that can be asked for what is before a point.
trait Layers {
    fn view(&self) -> &View;

    /// Whether a pixel may have a layer so deep, give or take the tolerance.
    fn may_have(&self, pixel: u32, depth: f32, tolerance: f32) -> bool;

    /// Whether it is known to have one.
    fn has(&self, pixel: u32, depth: f32, tolerance: f32) -> bool;
}

impl Layers for Map {
    #[inline(always)]
    fn view(&self) -> &View {
        &self.view
    }

    #[inline(always)]
    fn may_have(&self, pixel: u32, depth: f32, tolerance: f32) -> bool {
        self.has(pixel, depth, tolerance)
    }

    #[inline(always)]
    fn has(&self, pixel: u32, depth: f32, tolerance: f32) -> bool {
        let layers = self.layers(pixel as usize).iter();
        layers.fold(false, |has, layer| {
            has | ((layer - depth).abs() <= tolerance)
        })
    }
}

impl Layers for Extents {
    #[inline(always)]
    fn view(&self) -> &View {
        &self.view
    }

    #[inline(always)]
    fn may_have(&self, pixel: u32, depth: f32, tolerance: f32) -> bool {
        let [low, high] = self.ends[pixel as usize];
        low - tolerance <= depth && depth <= high + tolerance
    }

    #[inline(always)]
    fn has(&self, pixel: u32, depth: f32, tolerance: f32) -> bool {
        let [low, high] = self.ends[pixel as usize];
        (low - depth).abs() <= tolerance || (high - depth).abs() <= tolerance
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
        let mut aim = Aim::new(view, block);
        for lane in 0..LANES {
            let (pixel, depth) = (aim.nearest[lane], aim.nearest_depths[lane]);
            if !map.may_have(pixel, depth, tolerance) {
                aim.move_aside(map, lane, tolerance);
            }
        }
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

impl Aim {
    #[inline(always)]
    fn new(view: &View, block: &PointBlock) -> Self {
        let scale = 1.0 / view.pixel;
        let (x, y) = (
            dot(&block.positions, view.right),
            dot(&block.positions, view.up),
        );
        let depths = dot(&block.positions, view.forward);
        let cosine = dot(&block.shading, view.forward);
        let facing = dot(&block.geometric, view.forward);
        let (tilt_x, tilt_y) = (
            dot(&block.geometric, view.right),
            dot(&block.geometric, view.up),
        );
        let last = [(view.columns - 1) as f32, (view.rows - 1) as f32];
        let mut aim = Self {
            at: [[0.0; LANES]; 2],
            depths,
            slopes: [[0.0; LANES]; 2],
            signs: [0.0; LANES],
            cosines: [0.0; LANES],
            above: [0.0; LANES],
            nearest: [0; LANES],
            nearest_depths: [0.0; LANES],
        };
        for lane in 0..LANES {
            let column = (x[lane] - view.low.x) * scale;
            let row = (y[lane] - view.low.y) * scale;
            aim.at[0][lane] = column;
            aim.at[1][lane] = row;
            // A plane that is seen edge-on is nowhere else.
            let steep = -view.pixel / facing[lane];
            let steep = if steep.is_finite() { steep } else { 0.0 };
            aim.slopes[0][lane] = steep * tilt_x[lane];
            aim.slopes[1][lane] = steep * tilt_y[lane];
            let (i, j) = (
                column.floor().clamp(0.0, last[0]),
                row.floor().clamp(0.0, last[1]),
            );
            aim.nearest[lane] = j as u32 * view.columns as u32 + i as u32;
            let along =
                (i + 0.5 - column) * aim.slopes[0][lane] + (j + 0.5 - row) * aim.slopes[1][lane];
            let steepest = STEEPEST * view.pixel;
            aim.nearest_depths[lane] = depths[lane] + along.clamp(-steepest, steepest);
            let sign = 1_f32.copysign(cosine[lane]);
            aim.signs[lane] = sign;
            aim.cosines[lane] = cosine[lane].abs();
            aim.above[lane] = f32::from(facing[lane] * sign > 0.0);
        }
        aim
    }

    /// Takes another of the four pixels around a point, where the nearest does not know the point's surface.
    #[inline(never)]
    fn move_aside<M: Layers>(&mut self, map: &M, lane: usize, tolerance: f32) {
        let view = map.view();
        let at = [self.at[0][lane], self.at[1][lane]];
        let cell = at.map(f32::floor);
        let aside = [0, 1].map(|axis| {
            if at[axis] - cell[axis] < 0.5 {
                -1.0
            } else {
                1.0
            }
        });
        let far = [0, 1].map(|axis| (at[axis] - cell[axis] - 0.5).abs());
        // The neighbour across the nearer side first.
        let (x, y) = ([aside[0], 0.0], [0.0, aside[1]]);
        let order = if far[0] >= far[1] {
            [x, y, aside]
        } else {
            [y, x, aside]
        };
        for step in order {
            let (i, j) = (cell[0] + step[0], cell[1] + step[1]);
            if i < 0.0 || j < 0.0 || i >= view.columns as f32 || j >= view.rows as f32 {
                continue;
            }
            let pixel = j as u32 * view.columns as u32 + i as u32;
            let along =
                (i + 0.5 - at[0]) * self.slopes[0][lane] + (j + 0.5 - at[1]) * self.slopes[1][lane];
            let steepest = STEEPEST * view.pixel;
            let depth = self.depths[lane] + along.clamp(-steepest, steepest);
            if map.has(pixel, depth, tolerance) {
                self.nearest[lane] = pixel;
                self.nearest_depths[lane] = depth;
                return;
            }
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
    let share: Lanes = std::array::from_fn(|lane| {
        let depth = aim.nearest_depths[lane];
        let layers = map.layers(aim.nearest[lane] as usize);
        let distance = if aim.signs[lane] > 0.0 {
            let from = depth + tolerance;
            layers
                .iter()
                .find(|&&layer| layer > from)
                .map_or(f32::INFINITY, |layer| layer - depth)
        } else {
            let from = depth - tolerance;
            layers
                .iter()
                .rfind(|&&layer| layer < from)
                .map_or(f32::INFINITY, |layer| depth - layer)
        };
        (distance / d_max).min(1.0)
    });
    [share.map(|share| f32::from(share >= 1.0)), share]
}
