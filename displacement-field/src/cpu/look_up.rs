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

use glam::Vec3;

use super::samples::Store;
use crate::{
    Directions, Positions,
    directions::{cell_at, concentric, corners_at},
    lanes::Lanes,
    math::{Vector, tangents},
    positions::Slater,
};

/// Which samples answer a ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LookUp {
    /// The nearest position, the nearest direction (§3.2).
    Nearest,
    /// The nearest position, and of its directions the one that meets the ray in the middle of its chord.
    Aimed,
    /// Twelve samples: three positions around the ray and four directions of each, aimed. A hit where those that hit weigh
    /// more than those that miss, at the mean of their distances.
    #[default]
    Interpolated,
}

impl LookUp {
    /// Every look-up.
    pub const ALL: [Self; 3] = [Self::Nearest, Self::Aimed, Self::Interpolated];
}

/// What a look-up starts with: a chord's middle, half its length, and the direction from the end that is asked from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Question<L> {
    pub(crate) middle: Vector<L>,
    pub(crate) toward: Vector<L>,
    pub(crate) half: L,
}

/// Where maps are found.
pub(crate) trait Sites: Copy {
    fn cell<L: Lanes>(self, direction: Vector<L>) -> L;
    fn corners<L: Lanes>(self, direction: Vector<L>) -> ([L; 3], [L; 3]);
}

impl Sites for Slater {
    #[inline(always)]
    fn cell<L: Lanes>(self, direction: Vector<L>) -> L {
        Self::cell(&self, direction)
    }

    #[inline(always)]
    fn corners<L: Lanes>(self, direction: Vector<L>) -> ([L; 3], [L; 3]) {
        Self::corners(&self, direction)
    }
}

/// One lane after the other.
impl Sites for Positions {
    #[inline(always)]
    fn cell<L: Lanes>(self, direction: Vector<L>) -> L {
        let direction = each(direction);
        L::of_whole(|lane| self.nearest(direction(lane)))
    }

    #[inline(always)]
    fn corners<L: Lanes>(self, direction: Vector<L>) -> ([L; 3], [L; 3]) {
        let direction = each(direction);
        let around = L::array(|lane| self.around(direction(lane)));
        (
            [0, 1, 2].map(|corner| L::of_whole(|lane| around[lane][corner].0)),
            [0, 1, 2].map(|corner| L::of(|lane| around[lane][corner].1)),
        )
    }
}

/// Where in a map directions are found.
pub(crate) trait Mapping: Copy {
    fn cell<L: Lanes>(self, local: Vector<L>, resolution: f32) -> L;
    fn corners<L: Lanes>(self, local: Vector<L>, resolution: f32) -> ([L; 4], [L; 4]);
}

/// [`Directions::Concentric`], known to the compiler.
#[derive(Clone, Copy)]
pub(crate) struct Concentric;

impl Mapping for Concentric {
    #[inline(always)]
    fn cell<L: Lanes>(self, local: Vector<L>, resolution: f32) -> L {
        let (x, y) = concentric(local.x, local.y);
        cell_at(x, y, resolution)
    }

    #[inline(always)]
    fn corners<L: Lanes>(self, local: Vector<L>, resolution: f32) -> ([L; 4], [L; 4]) {
        let (x, y) = concentric(local.x, local.y);
        corners_at(x, y, resolution)
    }
}

/// One lane after the other.
impl Mapping for Directions {
    #[inline(always)]
    fn cell<L: Lanes>(self, local: Vector<L>, resolution: f32) -> L {
        let local = each(local);
        L::of_whole(|lane| Self::cell(self, local(lane), resolution as u32))
    }

    #[inline(always)]
    fn corners<L: Lanes>(self, local: Vector<L>, resolution: f32) -> ([L; 4], [L; 4]) {
        let local = each(local);
        let around = L::array(|lane| self.around(local(lane), resolution as u32));
        (
            [0, 1, 2, 3].map(|corner| L::of_whole(|lane| around[lane].0[corner])),
            [0, 1, 2, 3].map(|corner| L::of(|lane| around[lane].1[corner])),
        )
    }
}

/// The vector of each lane.
#[inline(always)]
fn each<L: Lanes>(vector: Vector<L>) -> impl Fn(usize) -> Vec3 {
    let (x, y, z) = (
        vector.x.to_array(),
        vector.y.to_array(),
        vector.z.to_array(),
    );
    move |lane| Vec3::new(x[lane], y[lane], z[lane])
}

/// How a field is asked: all that can be chosen known to the compiler.
#[derive(Clone, Copy)]
pub(crate) struct Maps<'a, P, D> {
    pub(crate) sites: P,
    pub(crate) mapping: D,
    pub(crate) points: &'a [[f32; 4]],
    pub(crate) resolution: f32,
}

impl<P: Sites, D: Mapping> Maps<'_, P, D> {
    /// Distances from the chords' ends to the first surfaces from there, infinite where nothing is hit. A store a lane: all
    /// of fields that are sampled as these maps say.
    #[inline(always)]
    pub(crate) fn distances<'s, S: Store<'s>, L: Lanes>(
        &self,
        stores: L::Array<S>,
        question: &Question<L>,
        look_up: LookUp,
    ) -> L {
        match look_up {
            LookUp::Nearest => self.nearest::<false, S, L>(stores, question),
            LookUp::Aimed => self.nearest::<true, S, L>(stores, question),
            LookUp::Interpolated => self.interpolated::<S, L>(stores, question),
        }
    }

    #[inline(always)]
    fn points<L: Lanes>(&self, sites: L::Array<u32>) -> Vector<L> {
        let [x, y, z, _] = L::columns(
            #[inline(always)]
            |lane| self.points[sites[lane] as usize],
        );
        Vector { x, y, z }
    }

    #[inline(always)]
    fn nearest<'s, const AIMED: bool, S: Store<'s>, L: Lanes>(
        &self,
        stores: L::Array<S>,
        question: &Question<L>,
    ) -> L {
        let Question {
            middle,
            toward,
            half,
        } = *question;
        let sites = self.sites.cell(middle - toward * half).to_whole();
        let point = self.points::<L>(sites);
        let aim = if AIMED { aim(middle - point) } else { toward };
        let local = local(point, aim);
        let cells = self.mapping.cell(local, self.resolution);
        let distances = S::distances(stores, sites, cells, local.z);
        if !AIMED {
            return distances;
        }
        // The sample's hit, seen along the ray.
        let along = (point + aim * distances - middle).dot(toward) + half;
        let inside = along.max(L::splat(0.0)).min(half + half);
        let miss = L::splat(f32::INFINITY);
        L::select(distances.less(miss), inside, miss)
    }

    /// Twelve samples around a ray, those that hit and those that miss weighed against each other.
    #[inline(always)]
    fn interpolated<'s, S: Store<'s>, L: Lanes>(
        &self,
        stores: L::Array<S>,
        question: &Question<L>,
    ) -> L {
        let Question {
            middle,
            toward,
            half,
        } = *question;
        let (zero, miss) = (L::splat(0.0), L::splat(f32::INFINITY));
        let (sites, shares) = self.sites.corners(middle - toward * half);
        let (mut weight, mut sum) = (zero, zero);
        for corner in 0..3 {
            let site = sites[corner].to_whole();
            let point = self.points::<L>(site);
            let away = middle - point;
            let aim = aim(away);
            let local = local(point, aim);
            let (cells, parts) = self.mapping.corners(local, self.resolution);
            // A sample's hit lies at `offset + distance · slope` along the ray.
            let (offset, slope) = (half - away.dot(toward), aim.dot(toward));
            for cell in 0..4 {
                let distance = S::distances(stores, site, cells[cell], local.z);
                let hits = distance.less(miss);
                let share = parts[cell] * shares[corner];
                let along = offset + distance * slope;
                weight = weight + L::select(hits, share, zero);
                sum = sum + L::select(hits, share * along, zero);
            }
        }
        let mean = (sum / weight).max(zero).min(half + half);
        L::select(L::splat(0.5).less(weight), mean, miss)
    }
}

#[inline(always)]
fn aim<L: Lanes>(away: Vector<L>) -> Vector<L> {
    away * (L::splat(1.0) / away.dot(away).max(L::splat(1e-30)).sqrt())
}

/// A direction in the frame of a position, z inward. One that leaves the hemisphere goes along its horizon.
#[inline(always)]
fn local<L: Lanes>(point: Vector<L>, direction: Vector<L>) -> Vector<L> {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let (x_axis, y_axis) = tangents(-point);
    let (x, y) = (direction.dot(x_axis), direction.dot(y_axis));
    let z = -direction.dot(point);
    let rim = one / (x * x + y * y).max(L::splat(1e-30)).sqrt();
    let scale = L::select(z.less(zero), rim, one);
    Vector::new(scale * x, scale * y, z.max(zero))
}

/// Calls some code with the [`Store`] and the [`Maps`] of a field, the usual parameters known to the compiler.
macro_rules! with_maps {
    ($field:expr, $store:ident, $maps:ident => $code:expr) => {{
        let field: &$crate::cpu::field::Field = $field;
        let params = &field.params;
        $crate::cpu::samples::with_store!(params.storage, $store => {
            match (params.positions, params.directions) {
                ($crate::Positions::Slater { rings }, $crate::Directions::Concentric) => {
                    let $maps = $crate::cpu::look_up::Maps {
                        sites: $crate::positions::Slater::new(rings),
                        mapping: $crate::cpu::look_up::Concentric,
                        points: &field.points,
                        resolution: params.resolution as f32,
                    };
                    $code
                }
                (sites, mapping) => {
                    let $maps = $crate::cpu::look_up::Maps {
                        sites,
                        mapping,
                        points: &field.points,
                        resolution: params.resolution as f32,
                    };
                    $code
                }
            }
        })
    }};
}
pub(crate) use with_maps;
