//! Rays, hits, and the questions that every visibility backend answers.
//!
//! A [`Tracer`] answers two: what is hit first, and whether anything is hit. How much its answer holds is
//! [`Answers`]; how far off it may be is [`Tracer::tolerance`]. A [`ParallelTracer`] answers for many points
//! along one direction, both ways at once, so that a layered depth map of that direction can be built, used and
//! dropped. Every `Tracer` is a `ParallelTracer` through [`Directions`].
//!
//! Tracers are made by [`BuildTracer`]: which instances take part is said by a [`Selection`], and
//! [`BuildTracer::update`] moves them.

mod agreement;
pub(crate) mod brute_force;
pub(crate) mod bvh;
mod fallback;
mod triangle;

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, Vec2, Vec3};

pub use self::{
    agreement::Agreement,
    brute_force::{BruteForceTracer, WorldTriangle, check_transforms, world_triangles},
    bvh::{BvhOptions, BvhTracer, Leaves, Levels},
    fallback::{Confident, WithFallback},
    triangle::Shear,
};
use crate::{Aabb, Error, InstanceMask, Result, Scene};

/// An open piece of a line: points `origin + t · direction` with `t_min < t < t_max`.
///
/// `t` counts in lengths of `direction`, so for unit directions in metres.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Ray {
    /// Where it starts, metres.
    pub origin: Vec3,
    /// Nothing is hit up to here; at least 0.
    pub t_min: f32,
    /// Where it goes; of any length but 0.
    pub direction: Vec3,
    /// Nothing is hit from here on; may be infinite.
    pub t_max: f32,
}

impl Ray {
    /// A ray without end.
    pub const fn new(origin: Vec3, direction: Vec3) -> Self {
        Self {
            origin,
            t_min: 0.0,
            direction,
            t_max: f32::INFINITY,
        }
    }

    /// The same ray with an end.
    #[must_use]
    pub const fn until(self, t_max: f32) -> Self {
        Self { t_max, ..self }
    }

    /// The point at `t`.
    #[inline]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + t * self.direction
    }

    /// Whether it can hit anything: finite, with a direction and a range from 0 on. Any other ray misses.
    #[inline]
    pub fn is_valid(&self) -> bool {
        self.origin.is_finite()
            && self.direction.is_finite()
            && self.direction != Vec3::ZERO
            && 0.0 <= self.t_min
            && self.t_min < self.t_max
    }
}

/// Where a ray met a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// How far along the ray, in lengths of its direction.
    pub t: f32,
    /// Barycentric coordinates: the point is `(1 − u − v)·a + u·b + v·c`. Zero where the tracer knows no surface.
    pub uv: Vec2,
    /// The triangle that was hit; [`SurfaceId::UNKNOWN`] where the tracer knows no surface.
    pub surface: SurfaceId,
}

/// A triangle of an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SurfaceId {
    /// Index in [`Scene::instances`].
    pub instance: u32,
    /// Index in [`Mesh::triangles`](crate::Mesh::triangles).
    pub primitive: u32,
}

impl SurfaceId {
    /// No triangle, or one that is not known.
    pub const UNKNOWN: Self = Self {
        instance: u32::MAX,
        primitive: u32::MAX,
    };
}

/// How much a tracer's answers hold, from least to most.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Answers {
    /// Only whether something is hit; `t` is not to be used.
    Occlusion,
    /// And how far away it is; the triangle is not known.
    Distance,
    /// And which triangle, and where on it.
    Surface,
}

impl Answers {
    /// An error unless these are at least what a technique needs of a tracer in some role.
    ///
    /// # Errors
    /// [`Error::TracerKnowsLess`].
    pub fn require(self, needed: Self, technique: &'static str, role: &str) -> Result<()> {
        if self >= needed {
            return Ok(());
        }
        Err(Error::TracerKnowsLess {
            technique,
            needed,
            tracer: role.into(),
            answered: self,
        })
    }
}

/// Answers visibility queries.
///
/// Rays that are not [valid](Ray::is_valid) miss. Answers do not depend on the number of threads or on how rays
/// are batched.
pub trait Tracer: Send + Sync {
    /// What the answers hold.
    fn answers(&self) -> Answers;

    /// How far off `t` may be near a point, in metres: rays that end on a surface are to be shortened, and origins
    /// lifted, by this. 0 for exact tracers.
    fn tolerance(&self, point: Vec3) -> f32 {
        let _ = point;
        0.0
    }

    /// The first surface the ray meets, if any.
    fn closest_hit(&self, ray: &Ray) -> Option<Hit>;

    /// Whether the ray meets any surface.
    fn any_hit(&self, ray: &Ray) -> bool {
        self.closest_hit(ray).is_some()
    }

    /// As [`closest_hit`](Self::closest_hit) for a ray that starts on `start`, which it never hits.
    fn closest_hit_from(&self, ray: &Ray, start: SurfaceId) -> Option<Hit> {
        let _ = start;
        self.closest_hit(ray)
    }

    /// As [`any_hit`](Self::any_hit) for a ray that starts on `start`, which it never hits.
    fn any_hit_from(&self, ray: &Ray, start: SurfaceId) -> bool {
        let _ = start;
        self.any_hit(ray)
    }

    /// [`closest_hit`](Self::closest_hit) of many rays.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn closest_hits(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len(), "one answer per ray");
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.closest_hit(ray);
        }
    }

    /// [`any_hit`](Self::any_hit) of many rays.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn any_hits(&self, rays: &[Ray], hits: &mut [bool]) {
        assert_eq!(rays.len(), hits.len(), "one answer per ray");
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.any_hit(ray);
        }
    }
}

/// A tracer that is lent is one too.
impl<T: Tracer + ?Sized> Tracer for &T {
    fn answers(&self) -> Answers {
        (**self).answers()
    }

    fn tolerance(&self, point: Vec3) -> f32 {
        (**self).tolerance(point)
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        (**self).closest_hit(ray)
    }

    fn any_hit(&self, ray: &Ray) -> bool {
        (**self).any_hit(ray)
    }

    fn closest_hit_from(&self, ray: &Ray, start: SurfaceId) -> Option<Hit> {
        (**self).closest_hit_from(ray, start)
    }

    fn any_hit_from(&self, ray: &Ray, start: SurfaceId) -> bool {
        (**self).any_hit_from(ray, start)
    }

    fn closest_hits(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        (**self).closest_hits(rays, hits);
    }

    fn any_hits(&self, rays: &[Ray], hits: &mut [bool]) {
        (**self).any_hits(rays, hits);
    }
}

/// Which part of a scene a tracer is built of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Selection {
    /// Instances that do not play all of these roles are left out.
    pub mask: InstanceMask,
    /// Triangles whose boxes do not touch this box are left out; `None` takes all.
    pub bounds: Option<Aabb>,
}

impl Default for Selection {
    /// Everything that casts.
    fn default() -> Self {
        Self {
            mask: InstanceMask::CASTER,
            bounds: None,
        }
    }
}

/// The contract by which tracers are made and moved.
pub trait BuildTracer: Tracer + Sized {
    /// What can be chosen when building; `default()` is a good choice.
    type Options: Default;

    /// Builds the tracer of the selected part of a scene.
    ///
    /// # Errors
    /// [`Error::NoGeometry`](crate::Error::NoGeometry) when nothing is selected, and whatever the tracer's own limits are.
    fn build(scene: &Arc<Scene>, selection: &Selection, options: &Self::Options) -> Result<Self>;

    /// Moves the instances: one transform per instance of the scene, as [`Scene::transforms`] gives them.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when the number of transforms is not that of the instances.
    fn update(&mut self, transforms: &[Affine3A]) -> Result<()>;

    /// Bytes held by the tracer's own structures.
    fn bytes(&self) -> usize;
}

/// Answers for many points along one direction, both ways at once.
pub trait ParallelTracer: Send + Sync {
    /// The unit directions that can be asked for. Each stands for itself and its opposite.
    fn directions(&self) -> &[Vec3];

    /// For every point the distance in metres to the first surface along `directions()[direction]` and along its
    /// opposite; infinite where there is none.
    ///
    /// # Panics
    /// If the slices differ in length or there is no such direction.
    fn trace(&self, direction: usize, points: &[Vec3], distances: &mut [(f32, f32)]);
}

/// Any [`Tracer`] as a [`ParallelTracer`] over a given set of directions; the oracle for those that have maps.
#[derive(Clone, Debug)]
pub struct Directions<'a, T: Tracer + ?Sized> {
    tracer: &'a T,
    directions: Vec<Vec3>,
}

impl<'a, T: Tracer + ?Sized> Directions<'a, T> {
    /// Answers by single rays of `tracer` along unit `directions`.
    pub fn new(tracer: &'a T, directions: Vec<Vec3>) -> Self {
        Self { tracer, directions }
    }
}

impl<T: Tracer + ?Sized> ParallelTracer for Directions<'_, T> {
    fn directions(&self) -> &[Vec3] {
        &self.directions
    }

    fn trace(&self, direction: usize, points: &[Vec3], distances: &mut [(f32, f32)]) {
        assert_eq!(points.len(), distances.len(), "one answer per point");
        let direction = self.directions[direction];
        let distance = |point: Vec3, direction: Vec3| {
            self.tracer
                .closest_hit(&Ray::new(point, direction))
                .map_or(f32::INFINITY, |hit| hit.t)
        };
        for (&point, answer) in points.iter().zip(distances) {
            *answer = (distance(point, direction), distance(point, -direction));
        }
    }
}
