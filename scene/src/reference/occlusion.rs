//! Ambient occlusion and obscurance: one cosine-distributed ray a sample.

use glam::Vec3;

use super::{Integrator, Quantity, facing};
use crate::{
    Ray, SurfacePoint, Tracer,
    sample::{Frame, Sampler, cosine_hemisphere},
};

/// The dimension pair of the occlusion ray; the first pair is the place in the pixel.
const DIMENSION: u32 = 1;

impl<E: Tracer + ?Sized, S: Tracer + ?Sized> Integrator<'_, E, S> {
    /// V of `ao` and of `obscurance` along one direction; 0 below the surface.
    pub(super) fn occlusion(
        &self,
        point: &SurfacePoint,
        view: Vec3,
        sampler: &Sampler,
        rays: &mut u64,
    ) -> [f32; 2] {
        let local = cosine_hemisphere(sampler.get_2d(DIMENSION));
        let direction = Frame::new(facing(point.shading_normal, view))
            .to_world(local)
            .normalize();
        if direction.dot(facing(point.geometric_normal, view)) <= 0.0 {
            return [0.0; 2];
        }
        let tracer = self.tracers.secondary;
        let origin = point.lifted(direction, tracer.tolerance(point.position));
        let d_max = self.settings.d_max;
        let ray = Ray::new(origin, direction).until(d_max);
        *rays += 1;
        if self.wanted.quantities.contains(&Quantity::Obscurance) {
            let distance = tracer
                .closest_hit_from(&ray, point.surface)
                .map(|hit| hit.t);
            return [
                f32::from(distance.is_none()),
                distance.map_or(1.0, |t| (t / d_max).min(1.0)),
            ];
        }
        [f32::from(!tracer.any_hit_from(&ray, point.surface)), 0.0]
    }
}
