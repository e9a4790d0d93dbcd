//! Doubtful answers are asked for again: approximate where that is enough, exact elsewhere.

use super::{Answers, Hit, Ray, SurfaceId, Tracer};
use glam::Vec3;

/// A tracer that knows how sure its answers are.
pub trait Confident: Tracer {
    /// The first surface the ray meets, and how sure that is, from 0 to 1.
    fn closest_with_confidence(&self, ray: &Ray, start: SurfaceId) -> (Option<Hit>, f32);

    /// The same of many rays.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn closest_all_with_confidence(&self, rays: &[Ray], answers: &mut [(Option<Hit>, f32)]) {
        assert_eq!(rays.len(), answers.len(), "one answer per ray");
        for (ray, answer) in rays.iter().zip(answers) {
            *answer = self.closest_with_confidence(ray, SurfaceId::UNKNOWN);
        }
    }
}

impl<T: Confident + ?Sized> Confident for &T {
    fn closest_with_confidence(&self, ray: &Ray, start: SurfaceId) -> (Option<Hit>, f32) {
        (**self).closest_with_confidence(ray, start)
    }

    fn closest_all_with_confidence(&self, rays: &[Ray], answers: &mut [(Option<Hit>, f32)]) {
        (**self).closest_all_with_confidence(rays, answers);
    }
}

/// Answers by one tracer, and by another where the first is less sure than is asked for.
///
/// `least` is the dial from fast to exact: with 0 the first answers all rays, above 1 the second does.
///
/// Tracers can be lent to it: a reference to a tracer is one.
#[derive(Clone, Copy, Debug)]
pub struct WithFallback<A, B> {
    fast: A,
    exact: B,
    least: f32,
}

impl<A: Confident, B: Tracer> WithFallback<A, B> {
    /// Sends the rays whose answers are less sure than `least` to `exact`.
    pub const fn new(fast: A, exact: B, least: f32) -> Self {
        Self { fast, exact, least }
    }

    /// Which of some rays are sent on.
    pub fn doubtful(&self, rays: &[Ray]) -> Vec<bool> {
        let mut answers = vec![(None, 0.0); rays.len()];
        self.fast.closest_all_with_confidence(rays, &mut answers);
        answers.iter().map(|answer| answer.1 < self.least).collect()
    }
}

impl<A: Confident, B: Tracer> Tracer for WithFallback<A, B> {
    fn answers(&self) -> Answers {
        self.fast.answers().min(self.exact.answers())
    }

    fn tolerance(&self, point: Vec3) -> f32 {
        self.fast.tolerance(point).max(self.exact.tolerance(point))
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.closest_hit_from(ray, SurfaceId::UNKNOWN)
    }

    /// As `closest_hit`, so that both tell the same of every ray.
    fn any_hit(&self, ray: &Ray) -> bool {
        self.closest_hit(ray).is_some()
    }

    fn closest_hit_from(&self, ray: &Ray, start: SurfaceId) -> Option<Hit> {
        let (hit, confidence) = self.fast.closest_with_confidence(ray, start);
        if confidence < self.least {
            self.exact.closest_hit_from(ray, start)
        } else {
            hit
        }
    }

    fn any_hit_from(&self, ray: &Ray, start: SurfaceId) -> bool {
        self.closest_hit_from(ray, start).is_some()
    }

    fn closest_hits(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len(), "one answer per ray");
        let mut answers = vec![(None, 0.0); rays.len()];
        self.fast.closest_all_with_confidence(rays, &mut answers);
        let mut doubtful = Vec::new();
        for (index, (hit, answer)) in hits.iter_mut().zip(&answers).enumerate() {
            *hit = answer.0;
            if answer.1 < self.least {
                doubtful.push(index);
            }
        }
        let again: Vec<Ray> = doubtful.iter().map(|&index| rays[index]).collect();
        let mut exact = vec![None; again.len()];
        self.exact.closest_hits(&again, &mut exact);
        for (index, hit) in doubtful.into_iter().zip(exact) {
            hits[index] = hit;
        }
    }

    fn any_hits(&self, rays: &[Ray], hits: &mut [bool]) {
        let mut closest = vec![None; rays.len()];
        self.closest_hits(rays, &mut closest);
        for (hit, closest) in hits.iter_mut().zip(closest) {
            *hit = closest.is_some();
        }
    }
}
