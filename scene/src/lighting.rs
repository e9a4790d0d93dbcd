//! Light that comes straight from the lights, for techniques that shade what they see.

use glam::{Vec2, Vec3};

use crate::{
    Bsdf, LightKind, Scene, SurfacePoint, Tracer,
    reference::{
        light_sampling::{Incoming, LightSampler, towards},
        path::visible,
    },
    sample::Sampler,
};

/// Lights without geometry up to this number are all asked; of more, one is chosen.
const FEW: usize = 16;

/// The lights of a scene and who answers the rays towards them.
///
/// Every light without geometry is asked (of more than 16, one is chosen by what it would contribute), one point of all
/// emissive triangles and one direction of the environment. So with point, spot and directional lights alone the answer
/// has no noise.
pub struct DirectLight<'a, T: Tracer + ?Sized> {
    scene: &'a Scene,
    tracer: &'a T,
    lights: LightSampler<'a>,
    /// Whether any light without geometry has an extent.
    is_extended: bool,
    /// Whether the environment is asked.
    has_environment: bool,
}

impl<'a, T: Tracer + ?Sized> DirectLight<'a, T> {
    /// Light with shadows by a tracer.
    pub fn new(scene: &'a Scene, tracer: &'a T) -> Self {
        Self {
            scene,
            tracer,
            lights: LightSampler::new(scene),
            is_extended: scene
                .lights
                .iter()
                .any(|light| matches!(light.kind, LightKind::Point { radius } if radius > 0.0)),
            has_environment: !scene.environment.is_black(),
        }
    }

    /// The same without the environment, for those who find its light another way.
    pub fn without_environment(scene: &'a Scene, tracer: &'a T) -> Self {
        Self {
            has_environment: false,
            ..Self::new(scene, tracer)
        }
    }

    /// Radiance that a point scatters towards a unit direction by light straight from the lights, and the rays it took.
    /// What a mirror or glass shows of the lights is not in it.
    pub fn scattered(
        &self,
        point: &SurfacePoint,
        view: Vec3,
        bsdf: &Bsdf,
        sampler: &Sampler,
    ) -> (Vec3, u64) {
        let mut sum = Vec3::ZERO;
        let mut rays = 0;
        let mut add = |incoming: Incoming| {
            let scattered = bsdf.evaluate(view, incoming.direction) * incoming.weight;
            if scattered == Vec3::ZERO || !scattered.is_finite() {
                return;
            }
            rays += 1;
            if visible(self.tracer, point, &incoming) {
                sum += scattered;
            }
        };
        let can_be_hit = self.can_be_hit();
        // Random numbers are worth their time only where they are used.
        let pair = |dimension, is_used| match is_used {
            true => sampler.get_2d(dimension),
            false => Vec2::ZERO,
        };
        let u = pair(0, self.is_extended);
        let choices = pair(1, can_be_hit || self.scene.lights.len() > FEW);
        if self.scene.lights.len() <= FEW {
            for light in &self.scene.lights {
                towards(light, point.position, u).map(&mut add);
            }
        } else {
            let contribution = |direction: Vec3, irradiance: Vec3| {
                (bsdf.evaluate(view, direction) * irradiance).element_sum()
            };
            let chosen = self
                .lights
                .sample_lights(point.position, choices.x, u, contribution);
            chosen.map(&mut add);
        }
        if can_be_hit {
            let emitter = self
                .lights
                .sample_emitters(point.position, choices.y, sampler.get_2d(2));
            emitter.map(&mut add);
        }
        if self.has_environment {
            let sky = self.lights.sample_environment(sampler.get_2d(3));
            sky.map(&mut add);
        }
        (sum, rays)
    }

    /// Whether a sample differs from another: there are lights with an extent, or too many.
    pub fn is_noisy(&self) -> bool {
        self.can_be_hit() || self.scene.lights.len() > FEW || self.is_extended
    }

    /// Whether light is asked that rays can meet by chance.
    fn can_be_hit(&self) -> bool {
        self.lights.has_emitters() || self.has_environment
    }
}
