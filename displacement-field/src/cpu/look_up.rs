//! Stage 3: what a ray through the sphere meets, by the samples next to it (Algorithm 2).
//!
//! Everything here is in the field's own space, where the sphere has radius 1 and its centre is the origin. A ray's line
//! is its chord; a look-up answers from either end of it. That is what makes rays that start inside the sphere as good
//! as others: the chord's last surface, looked up from behind, tells whether anything lies before the ray at all; only how
//! far away it is has to be found from the front.
//!
//! A sample is a ray from another point than the one looked up, in almost the same direction. [`LookUp::Nearest`] takes its
//! distance as it is, as the paper does. The others take the sample that comes closest to the ray in the sphere's middle,
//! where the object is, instead of one that is parallel to it: that undoes most of the error of the position.

#![expect(
    clippy::needless_range_loop,
    reason = "a lane is of several arrays at once"
)]

use glam::Vec3;

use super::{field::Field, samples::Store};
use crate::{
    Directions, Positions,
    directions::{cell_at, concentric, corners_at},
    math::tangents,
    positions::Slater,
};

/// Which samples answer a ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LookUp {
    /// The nearest position, the nearest direction (§3.2).
    Nearest,
    /// The nearest position, and of its directions the one that meets the ray in the middle of its chord.
    #[default]
    Aimed,
    /// Twelve samples: three positions around the ray and four directions of each, aimed. A hit where those that hit weigh
    /// more than those that miss, at the mean of their distances.
    Interpolated,
}

impl LookUp {
    /// Every look-up.
    pub const ALL: [Self; 3] = [Self::Nearest, Self::Aimed, Self::Interpolated];
}

/// The part of a line that lies in the unit sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Chord {
    /// Its middle: the line's point that is closest to the centre.
    pub(crate) middle: Vec3,
    /// Unit direction of the line.
    pub(crate) direction: Vec3,
    /// Half its length.
    pub(crate) half: f32,
    /// Where on the line its middle is.
    pub(crate) at: f32,
}

impl Chord {
    /// The chord of a line; `half` is not above 0 where the line passes the sphere by, or is none.
    #[inline(always)]
    pub(crate) fn new(origin: Vec3, direction: Vec3) -> Self {
        let rough = -origin.dot(direction);
        let near = origin + rough * direction;
        // Far origins leave a rounding error along the line.
        let rest = -near.dot(direction);
        let middle = near + rest * direction;
        let squared = 1.0 - middle.length_squared();
        Self {
            middle,
            direction,
            half: squared.max(0.0).sqrt(),
            at: rough + rest,
        }
    }
}

/// What a look-up starts with: a chord's middle, half its length, and the direction from the end that is asked from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Question<const N: usize> {
    pub(crate) middle: [[f32; N]; 3],
    pub(crate) toward: [[f32; N]; 3],
    pub(crate) half: [f32; N],
}

impl Question<1> {
    fn one(chord: &Chord, backward: bool) -> Self {
        let toward = if backward {
            -chord.direction
        } else {
            chord.direction
        };
        Self {
            middle: chord.middle.to_array().map(|value| [value]),
            toward: toward.to_array().map(|value| [value]),
            half: [chord.half],
        }
    }
}

/// Where maps are found.
pub(crate) trait Sites: Copy {
    fn cell(self, x: f32, y: f32, z: f32) -> i32;
    fn corners(self, x: f32, y: f32, z: f32) -> ([i32; 3], [f32; 3]);
}

impl Sites for Slater {
    #[inline(always)]
    fn cell(self, x: f32, y: f32, z: f32) -> i32 {
        Self::cell(&self, x, y, z)
    }

    #[inline(always)]
    fn corners(self, x: f32, y: f32, z: f32) -> ([i32; 3], [f32; 3]) {
        Self::corners(&self, x, y, z)
    }
}

impl Sites for Positions {
    fn cell(self, x: f32, y: f32, z: f32) -> i32 {
        self.nearest(Vec3::new(x, y, z)) as i32
    }

    fn corners(self, x: f32, y: f32, z: f32) -> ([i32; 3], [f32; 3]) {
        let corners = self.around(Vec3::new(x, y, z));
        (
            corners.map(|(index, _)| index as i32),
            corners.map(|(_, weight)| weight),
        )
    }
}

/// Where in a map directions are found.
pub(crate) trait Mapping: Copy {
    fn cell(self, local: Vec3, resolution: i32) -> i32;
    fn corners(self, local: Vec3, resolution: i32) -> ([i32; 4], [f32; 4]);
}

/// [`Directions::Concentric`], known to the compiler.
#[derive(Clone, Copy)]
pub(crate) struct Concentric;

impl Mapping for Concentric {
    #[inline(always)]
    fn cell(self, local: Vec3, resolution: i32) -> i32 {
        let (x, y) = concentric(local.x, local.y);
        cell_at(x, y, resolution)
    }

    #[inline(always)]
    fn corners(self, local: Vec3, resolution: i32) -> ([i32; 4], [f32; 4]) {
        let (x, y) = concentric(local.x, local.y);
        corners_at(x, y, resolution)
    }
}

impl Mapping for Directions {
    fn cell(self, local: Vec3, resolution: i32) -> i32 {
        Self::cell(self, local, resolution as u32) as i32
    }

    fn corners(self, local: Vec3, resolution: i32) -> ([i32; 4], [f32; 4]) {
        self.around(local, resolution)
    }
}

/// A field's samples, all that can be chosen known to the compiler.
#[derive(Clone, Copy)]
pub(crate) struct Maps<'a, S, P, D> {
    pub(crate) store: S,
    pub(crate) sites: P,
    pub(crate) mapping: D,
    pub(crate) points: &'a [Vec3],
    pub(crate) resolution: i32,
}

/// A vector of each lane.
type Lanes<const N: usize> = [[f32; N]; 3];

#[inline(always)]
fn get<const N: usize>(axes: &Lanes<N>, lane: usize) -> Vec3 {
    Vec3::new(axes[0][lane], axes[1][lane], axes[2][lane])
}

#[inline(always)]
fn put<const N: usize>(axes: &mut Lanes<N>, lane: usize, value: Vec3) {
    axes[0][lane] = value.x;
    axes[1][lane] = value.y;
    axes[2][lane] = value.z;
}

impl<S: Store, P: Sites, D: Mapping> Maps<'_, S, P, D> {
    /// Distances from the chords' ends, infinite where nothing is hit. Plain loops, each either arithmetic or reads of
    /// memory, so that compilers make the former parallel and processors the latter.
    #[inline(always)]
    pub(crate) fn distances<const N: usize>(
        &self,
        question: &Question<N>,
        look_up: LookUp,
    ) -> [f32; N] {
        match look_up {
            LookUp::Nearest => self.nearest::<false, N>(question),
            LookUp::Aimed => self.nearest::<true, N>(question),
            LookUp::Interpolated => self.interpolated(question),
        }
    }

    #[inline(always)]
    fn points<const N: usize>(&self, sites: &[i32; N]) -> Lanes<N> {
        let mut points = [[0.0; N]; 3];
        for lane in 0..N {
            put(&mut points, lane, self.points[sites[lane] as usize]);
        }
        points
    }

    #[inline(always)]
    fn nearest<const AIMED: bool, const N: usize>(&self, question: &Question<N>) -> [f32; N] {
        let Question {
            middle,
            toward,
            half,
        } = question;
        let mut sites = [0_i32; N];
        for lane in 0..N {
            let start = get(middle, lane) - half[lane] * get(toward, lane);
            sites[lane] = self.sites.cell(start.x, start.y, start.z);
        }
        let points = self.points(&sites);
        let (mut cells, mut cosines, mut aims) = ([0_i32; N], [0.0; N], [[0.0; N]; 3]);
        for lane in 0..N {
            let point = get(&points, lane);
            let toward = get(toward, lane);
            let aim = if AIMED {
                aim(get(middle, lane) - point)
            } else {
                toward
            };
            let local = local(point, aim);
            cells[lane] = self.mapping.cell(local, self.resolution);
            cosines[lane] = local.z;
            put(&mut aims, lane, aim);
        }
        let mut distances = [0.0; N];
        for lane in 0..N {
            let (site, cell) = (sites[lane] as usize, cells[lane] as usize);
            distances[lane] = self.store.distance(site, cell, cosines[lane]);
        }
        if AIMED {
            for lane in 0..N {
                // The sample's hit, seen along the ray.
                let hit = get(&points, lane) + distances[lane] * get(&aims, lane);
                let along = (hit - get(middle, lane)).dot(get(toward, lane)) + half[lane];
                let inside = along.max(0.0).min(2.0 * half[lane]);
                let hits = distances[lane] < f32::INFINITY;
                distances[lane] = if hits { inside } else { f32::INFINITY };
            }
        }
        distances
    }

    /// Twelve samples around a ray, those that hit and those that miss weighed against each other.
    #[inline(always)]
    fn interpolated<const N: usize>(&self, question: &Question<N>) -> [f32; N] {
        let Question {
            middle,
            toward,
            half,
        } = question;
        let (mut sites, mut shares) = ([[0_i32; N]; 3], [[0.0; N]; 3]);
        for lane in 0..N {
            let start = get(middle, lane) - half[lane] * get(toward, lane);
            let (indices, weights) = self.sites.corners(start.x, start.y, start.z);
            for corner in 0..3 {
                sites[corner][lane] = indices[corner];
                shares[corner][lane] = weights[corner];
            }
        }
        let (mut weight, mut sum) = ([0.0; N], [0.0; N]);
        for corner in 0..3 {
            let points = self.points(&sites[corner]);
            let (mut cells, mut weights) = ([[0_i32; N]; 4], [[0.0; N]; 4]);
            // A sample's hit lies at `offset + distance · slope` along the ray.
            let (mut cosines, mut offsets, mut slopes) = ([0.0; N], [0.0; N], [0.0; N]);
            for lane in 0..N {
                let (point, toward) = (get(&points, lane), get(toward, lane));
                let away = get(middle, lane) - point;
                let aim = aim(away);
                let local = local(point, aim);
                let (indices, parts) = self.mapping.corners(local, self.resolution);
                for cell in 0..4 {
                    cells[cell][lane] = indices[cell];
                    weights[cell][lane] = parts[cell] * shares[corner][lane];
                }
                cosines[lane] = local.z;
                offsets[lane] = half[lane] - away.dot(toward);
                slopes[lane] = aim.dot(toward);
            }
            for cell in 0..4 {
                let mut distances = [0.0; N];
                for lane in 0..N {
                    let (site, cell) = (sites[corner][lane] as usize, cells[cell][lane] as usize);
                    distances[lane] = self.store.distance(site, cell, cosines[lane]);
                }
                for lane in 0..N {
                    let hits = distances[lane] < f32::INFINITY;
                    let along = offsets[lane] + distances[lane] * slopes[lane];
                    let share = weights[cell][lane];
                    weight[lane] += if hits { share } else { 0.0 };
                    sum[lane] += if hits { share * along } else { 0.0 };
                }
            }
        }
        let mut distances = [f32::INFINITY; N];
        for lane in 0..N {
            let mean = (sum[lane] / weight[lane]).max(0.0).min(2.0 * half[lane]);
            distances[lane] = if weight[lane] > 0.5 {
                mean
            } else {
                f32::INFINITY
            };
        }
        distances
    }
}

#[inline(always)]
fn aim(away: Vec3) -> Vec3 {
    away * (1.0 / away.length_squared().max(1e-30).sqrt())
}

/// A direction in the frame of a position, z inward. One that leaves the hemisphere goes along its horizon.
#[inline(always)]
fn local(point: Vec3, direction: Vec3) -> Vec3 {
    let (x_axis, y_axis) = tangents(-point);
    let (x, y, z) = (
        direction.dot(x_axis),
        direction.dot(y_axis),
        -direction.dot(point),
    );
    let rim = 1.0 / (x * x + y * y).max(1e-30).sqrt();
    let scale = if z < 0.0 { rim } else { 1.0 };
    Vec3::new(scale * x, scale * y, z.max(0.0))
}

/// Calls some code with the [`Maps`] of a field, the usual parameters known to the compiler.
macro_rules! with_maps {
    ($field:expr, $maps:ident => $code:expr) => {{
        let field: &$crate::cpu::field::Field = $field;
        let params = &field.params;
        $crate::cpu::samples::with_store!(&field.samples, params.cells(), store => {
            match (params.positions, params.directions) {
                ($crate::Positions::Slater { rings }, $crate::Directions::Concentric) => {
                    let $maps = $crate::cpu::look_up::Maps {
                        store,
                        sites: $crate::positions::Slater::new(rings),
                        mapping: $crate::cpu::look_up::Concentric,
                        points: &field.points,
                        resolution: params.resolution as i32,
                    };
                    $code
                }
                (sites, mapping) => {
                    let $maps = $crate::cpu::look_up::Maps {
                        store,
                        sites,
                        mapping,
                        points: &field.points,
                        resolution: params.resolution as i32,
                    };
                    $code
                }
            }
        })
    }};
}
pub(crate) use with_maps;

impl Field {
    /// The distance from a chord's end to the first surface from there, in radii; infinite where there is none. Backward
    /// is from the end that the line leaves by.
    #[inline]
    pub(crate) fn distance(&self, chord: &Chord, backward: bool, look_up: LookUp) -> f32 {
        let question = Question::one(chord, backward);
        with_maps!(self, maps => maps.distances(&question, look_up)[0])
    }
}
