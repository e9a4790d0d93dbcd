//! Two tracers as one: fields for objects, and another for what stands around them.

use glam::Vec3;
use isophote_scene::{Answers, Hit, Ray, SurfaceId, Tracer};

/// Answers by the nearer of two tracers' hits: of different parts of a scene, such as objects that have fields and the
/// room, of which a field would be a poor one.
#[derive(Clone, Copy, Debug)]
pub struct Together<A, B>(pub A, pub B);

fn nearer(one: Option<Hit>, other: Option<Hit>) -> Option<Hit> {
    match (one, other) {
        (Some(a), Some(b)) => Some(if b.t < a.t { b } else { a }),
        (one, other) => one.or(other),
    }
}

impl<A: Tracer, B: Tracer> Tracer for Together<A, B> {
    fn answers(&self) -> Answers {
        self.0.answers().min(self.1.answers())
    }

    fn tolerance(&self, point: Vec3) -> f32 {
        self.0.tolerance(point).max(self.1.tolerance(point))
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        nearer(self.0.closest_hit(ray), self.1.closest_hit(ray))
    }

    fn any_hit(&self, ray: &Ray) -> bool {
        self.0.any_hit(ray) || self.1.any_hit(ray)
    }

    fn closest_hit_from(&self, ray: &Ray, start: SurfaceId) -> Option<Hit> {
        nearer(
            self.0.closest_hit_from(ray, start),
            self.1.closest_hit_from(ray, start),
        )
    }

    fn any_hit_from(&self, ray: &Ray, start: SurfaceId) -> bool {
        self.0.any_hit_from(ray, start) || self.1.any_hit_from(ray, start)
    }

    fn closest_hits(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        let mut others = vec![None; rays.len()];
        self.0.closest_hits(rays, hits);
        self.1.closest_hits(rays, &mut others);
        for (hit, other) in hits.iter_mut().zip(others) {
            *hit = nearer(*hit, other);
        }
    }

    fn any_hits(&self, rays: &[Ray], hits: &mut [bool]) {
        let mut others = vec![false; rays.len()];
        self.0.any_hits(rays, hits);
        self.1.any_hits(rays, &mut others);
        for (hit, other) in hits.iter_mut().zip(others) {
            *hit |= other;
        }
    }
}
