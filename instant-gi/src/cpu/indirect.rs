//! Stage 4, the light of the virtual point lights (Eq. (1)).
//!
//! E(x) = Σ Lₖ V(x, yₖ) G(x, yₖ) is irradiance; the surface's albedo/π is multiplied on when the picture is put
//! together, so that filters do not blur textures. Rays of many points are traced together, those towards one light beside each
//! other, so that they are alike.

use std::f32::consts::PI;

use glam::Vec3;
use isophote_scene::{
    Bsdf, DirectLight, Ray, Scene, Seen, SurfacePoint, Tracer,
    reference::bound,
    sample::{Frame, Sampler, cosine_hemisphere},
};

use super::emission::Vpl;
use crate::GiParams;

/// Who gathers.
pub(super) struct Gather<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> {
    pub(super) scene: &'a Scene,
    /// Answers the rays between points and virtual lights: V.
    pub(super) tracer: &'a S,
    /// Light at what compensating rays hit.
    pub(super) direct: &'a DirectLight<'a, E>,
    pub(super) vpls: &'a [Vpl],
    pub(super) params: &'a GiParams,
}

/// A point that receives light.
#[derive(Clone, Copy)]
pub(super) struct Receiver<'a> {
    pub(super) point: &'a SurfacePoint,
    /// The shading normal on the viewer's side.
    pub(super) normal: Vec3,
    /// Which part of the lights lights it, of how many.
    pub(super) part: [u32; 2],
    /// What its random numbers belong to.
    pub(super) stream: u32,
}

/// Rays that are traced together, so that memory does not grow with the number of lights.
const BATCH: usize = 1 << 16;

impl<E: Tracer + ?Sized, S: Tracer + ?Sized> Gather<'_, E, S> {
    /// Irradiance at points, added to `light`; and the number of rays.
    pub(super) fn irradiance(&self, receivers: &[Receiver<'_>], light: &mut [Vec3]) -> u64 {
        let lights = (BATCH / receivers.len().max(1)).max(1);
        let (mut rays, mut arrivals) = (Vec::new(), Vec::new());
        let mut hidden = Vec::new();
        let mut count = 0;
        for (first, vpls) in (0..).step_by(lights).zip(self.vpls.chunks(lights)) {
            for (number, vpl) in (first..).zip(vpls) {
                for (index, receiver) in receivers.iter().enumerate() {
                    let [part, parts] = receiver.part;
                    if number % parts != part {
                        continue;
                    }
                    if let Some((ray, arriving)) = self.towards(receiver, vpl) {
                        rays.push(ray);
                        arrivals.push((index, arriving * parts as f32));
                    }
                }
            }
            hidden.clear();
            hidden.resize(rays.len(), false);
            self.tracer.any_hits(&rays, &mut hidden);
            count += rays.len() as u64;
            rays.clear();
            for ((index, arriving), hidden) in arrivals.drain(..).zip(&hidden) {
                if !hidden {
                    light[index] += arriving;
                }
            }
        }
        if self.params.compensation > 0 && self.params.min_d > 0.0 {
            for (receiver, light) in receivers.iter().zip(light) {
                let (left_out, rays) = self.left_out(receiver);
                *light += left_out;
                count += rays;
            }
        }
        count
    }

    /// `L_e` G of Eq. (1), and the ray that asks for V; `None` where no light would arrive.
    fn towards(&self, receiver: &Receiver<'_>, vpl: &Vpl) -> Option<(Ray, Vec3)> {
        let point = receiver.point;
        let offset = vpl.point.position - point.position;
        let squared = offset.length_squared();
        let distance = squared.sqrt();
        let direction = offset / distance;
        let cos_x = receiver.normal.dot(direction);
        let cos_y = -vpl.normal.dot(direction);
        // Also false for NaN, where both are one point.
        if !(cos_x > 0.0 && cos_y > 0.0) {
            return None;
        }
        let bounded = bound(self.params.min_d, distance);
        let arriving = vpl.intensity * (cos_x * cos_y / squared * bounded);
        if arriving == Vec3::ZERO || !arriving.is_finite() {
            return None;
        }
        let (here, there) = (
            self.tracer.tolerance(point.position),
            self.tracer.tolerance(vpl.point.position),
        );
        let start = point.lifted(direction, here);
        let end = vpl.point.lifted(-direction, there);
        let way = end - start;
        let length = way.length();
        // Tracers that are off may not count the surface of the light.
        let until = length - here.max(there);
        (until > 0.0).then(|| (Ray::new(start, way / length).until(until), arriving))
    }

    /// What the bound leaves out, by rays that go where light is near (Kollig and Keller 2004): they take the radiance of
    /// what they hit where 1 − f is left.
    fn left_out(&self, receiver: &Receiver<'_>) -> (Vec3, u64) {
        let count = self.params.compensation;
        let frame = Frame::new(receiver.normal);
        let tolerance = self.tracer.tolerance(receiver.point.position);
        let mut rays = 0;
        let mut sum = Vec3::ZERO;
        for number in 0..count {
            let sampler = Sampler::new(self.params.seed ^ COMPENSATION, receiver.stream, number);
            let direction = frame
                .to_world(cosine_hemisphere(sampler.get_2d(4)))
                .normalize();
            let origin = receiver.point.lifted(direction, tolerance);
            let ray = Ray::new(origin, direction).until(1.2 * self.params.min_d);
            rays += 1;
            let Some(hit) = self.tracer.closest_hit_from(&ray, receiver.point.surface) else {
                continue;
            };
            let view = -direction;
            let point = self.scene.surface_point(&hit);
            let seen = Seen::new(self.scene, point, view, self.params.materials);
            let (normal, albedo) = (seen.normal(), seen.albedo());
            if albedo == Vec3::ZERO {
                continue;
            }
            let bsdf = Bsdf::diffuse(normal, albedo);
            let (mut radiance, traced) = self.direct.scattered(&point, view, &bsdf, &sampler);
            rays += traced;
            if self.params.bounces > 1 {
                let (indirect, traced) = self.shorter(&point, normal);
                radiance += albedo / PI * indirect;
                rays += traced;
            }
            sum += (1.0 - bound(self.params.min_d, hit.t)) * radiance;
        }
        (sum * (PI / count as f32), rays)
    }

    /// Light at a point of lights that have met one surface less, bounded.
    fn shorter(&self, point: &SurfacePoint, normal: Vec3) -> (Vec3, u64) {
        let receiver = Receiver {
            point,
            normal,
            part: [0, 1],
            stream: 0,
        };
        let mut rays = 0;
        let mut sum = Vec3::ZERO;
        for vpl in self
            .vpls
            .iter()
            .filter(|vpl| vpl.bounce < self.params.bounces)
        {
            if let Some((ray, arriving)) = self.towards(&receiver, vpl) {
                rays += 1;
                if !self.tracer.any_hit(&ray) {
                    sum += arriving;
                }
            }
        }
        (sum, rays)
    }
}

/// Compensating rays have random numbers of their own.
const COMPENSATION: u64 = 0x6b6b;
