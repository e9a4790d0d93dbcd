//! Particles that leave the lights: where paths from the light's side begin.
//!
//! A light is chosen by its power, then a place and a direction. What a particle carries, divided by how many there are, is
//! radiant flux: summed over all of them it is what the lights emit into the scene.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use crate::{
    Aabb, Environment, Light, LightKind, Ray, Scene, SurfaceId,
    reference::light_sampling::emitters,
    sample::{
        Frame, concentric_disk, cosine_hemisphere, uniform_cone, uniform_sphere, uniform_triangle,
    },
};

/// Directions by which the power of a panorama is found.
const PROBES: u32 = 256;

/// All lights of a scene, ready to emit.
pub struct Emission<'a> {
    scene: &'a Scene,
    sources: Vec<Source>,
    /// A sphere around everything.
    center: Vec3,
    radius: f32,
}

/// A light and how likely it is chosen.
pub(crate) struct Source {
    pub(crate) kind: Kind,
    pub(crate) probability: f32,
    /// Of this and all before.
    pub(crate) cumulative: f32,
}

#[derive(Clone, Copy)]
pub(crate) enum Kind {
    Light(u32),
    /// A triangle and its area.
    Triangle(SurfaceId, f32),
    Environment,
}

/// A particle that leaves a light.
#[derive(Clone, Copy, Debug)]
pub struct Particle {
    /// Where it starts and its unit direction.
    pub ray: Ray,
    /// Watts, if it were the only particle.
    pub flux: Vec3,
    /// The triangle it leaves, or [`SurfaceId::UNKNOWN`].
    pub start: SurfaceId,
}

impl<'a> Emission<'a> {
    /// The lights, emissive triangles and environment of a scene, chosen by power.
    pub fn new(scene: &'a Scene) -> Self {
        Self::within(scene, &scene.bounds())
    }

    /// As [`new`](Self::new), of a scene whose bounds are known.
    pub(crate) fn within(scene: &'a Scene, bounds: &Aabb) -> Self {
        let (center, radius) = (bounds.center(), 0.5 * bounds.diagonal());
        let disk = PI * radius * radius;
        let lights = scene.lights.iter().zip(0..).map(|(light, index)| {
            let power = light.intensity.element_sum()
                * match light.kind {
                    LightKind::Point { .. } => 4.0 * PI,
                    LightKind::Spot { outer, .. } => 2.0 * PI * (1.0 - outer.cos()),
                    LightKind::Directional => disk,
                };
            (Kind::Light(index), power)
        });
        let triangles = emitters(scene).into_iter().map(|emitter| {
            let point = scene.point_on(emitter.surface, Vec2::splat(1.0 / 3.0));
            let material = &scene.materials[point.material as usize];
            // Both sides shine.
            let power = 2.0 * PI * emitter.area * material.emissive.element_sum();
            (Kind::Triangle(emitter.surface, emitter.area), power)
        });
        let environment = (Kind::Environment, disk * of_all_around(&scene.environment));
        let powers: Vec<(Kind, f32)> = lights
            .chain(triangles)
            .chain([environment])
            .filter(|(_, power)| *power > 0.0 && power.is_finite())
            .collect();
        let total: f64 = powers.iter().map(|(_, power)| f64::from(*power)).sum();
        let mut sum = 0.0;
        let sources = powers.into_iter().map(|(kind, power)| {
            sum += f64::from(power);
            Source {
                kind,
                probability: (f64::from(power) / total) as f32,
                cumulative: (sum / total) as f32,
            }
        });
        Self {
            scene,
            sources: sources.collect(),
            center,
            radius,
        }
    }

    /// What there is to choose from.
    #[cfg(feature = "gpu")]
    pub(crate) fn sources(&self) -> &[Source] {
        &self.sources
    }

    /// A particle from numbers in [0, 1): which light, where it starts, and where it goes. `None` where nothing shines.
    pub fn emit(&self, choice: f32, place: Vec2, direction: Vec2) -> Option<Particle> {
        let source = &self.sources[self.chosen(choice)?];
        let mut particle = match source.kind {
            Kind::Light(index) => {
                self.leave_light(&self.scene.lights[index as usize], place, direction)
            }
            Kind::Triangle(surface, area) => {
                self.leave_triangle(surface, area, place, direction)?
            }
            Kind::Environment => self.leave_environment(place, direction)?,
        };
        particle.flux /= source.probability;
        particle.flux.is_finite().then_some(particle)
    }

    /// How far into the share of the light that it chooses a number lies, in [0, 1). Numbers that are spread evenly are so in
    /// the share of each light too, so that they can say where or in which direction its particles start. 0 where nothing shines.
    pub fn remainder(&self, choice: f32) -> f32 {
        let Some(at) = self.chosen(choice) else {
            return 0.0;
        };
        let before = at.checked_sub(1);
        let before = before.map_or(0.0, |before| self.sources[before].cumulative);
        let share = self.sources[at].cumulative - before;
        // Rounding up to 1 is not in the range.
        ((choice - before) / share).clamp(0.0, 1.0_f32.next_down())
    }

    /// The light that a number chooses: the first whose cumulative probability exceeds it.
    fn chosen(&self, choice: f32) -> Option<usize> {
        let last = self.sources.len().checked_sub(1)?;
        let at = self
            .sources
            .partition_point(|source| source.cumulative <= choice);
        Some(at.min(last))
    }

    fn leave_light(&self, light: &Light, place: Vec2, direction: Vec2) -> Particle {
        let particle = |origin, direction, flux| Particle {
            ray: Ray::new(origin, direction),
            flux,
            start: SurfaceId::UNKNOWN,
        };
        match light.kind {
            LightKind::Point { radius } => {
                let direction = uniform_sphere(direction).normalize();
                // A sphere of radius r shines into every direction with a beam of πr².
                let disk = concentric_disk(place);
                let frame = Frame::new(direction);
                let height = (1.0 - disk.length_squared()).max(0.0).sqrt();
                let origin = light.position() + radius * frame.to_world(disk.extend(height));
                particle(origin, direction, 4.0 * PI * light.intensity)
            }
            LightKind::Spot { outer, .. } => {
                let cos_outer = outer.cos();
                let local = uniform_cone(direction, cos_outer);
                let direction = Frame::new(light.direction()).to_world(local).normalize();
                let solid_angle = 2.0 * PI * (1.0 - cos_outer);
                let flux = solid_angle * light.intensity_towards(direction);
                particle(light.position(), direction, flux)
            }
            LightKind::Directional => {
                let direction = light.direction();
                particle(
                    self.before(direction, place),
                    direction,
                    PI * self.radius * self.radius * light.intensity,
                )
            }
        }
    }

    fn leave_triangle(
        &self,
        surface: SurfaceId,
        area: f32,
        place: Vec2,
        direction: Vec2,
    ) -> Option<Particle> {
        let uv = uniform_triangle(place);
        if !self.scene.alpha_passes(surface, uv) {
            return None;
        }
        let point = self.scene.point_on(surface, uv);
        // Half of the numbers are for each side.
        let (side, x) = if direction.x < 0.5 {
            (1.0, 2.0 * direction.x)
        } else {
            (-1.0, 2.0 * direction.x - 1.0)
        };
        let local = cosine_hemisphere(Vec2::new(x, direction.y));
        let normal = side * point.geometric_normal;
        let direction = Frame::new(normal).to_world(local).normalize();
        let emissive = self.scene.surface_material(&point).emissive;
        Some(Particle {
            ray: Ray::new(point.lifted(direction, 0.0), direction),
            flux: 2.0 * PI * area * emissive,
            start: surface,
        })
    }

    fn leave_environment(&self, place: Vec2, direction: Vec2) -> Option<Particle> {
        let (towards, pdf) = match &self.scene.environment {
            Environment::Black => return None,
            Environment::Constant(_) => (uniform_sphere(direction).normalize(), 0.25 / PI),
            Environment::Map(map) => map.sample(direction)?,
        };
        let radiance = self.scene.environment.radiance(towards);
        Some(Particle {
            ray: Ray::new(self.before(-towards, place), -towards),
            flux: radiance / pdf * (PI * self.radius * self.radius),
            start: SurfaceId::UNKNOWN,
        })
    }

    /// A point of the disk before the scene from which parallel light comes.
    fn before(&self, direction: Vec3, place: Vec2) -> Vec3 {
        let disk = concentric_disk(place);
        self.center + self.radius * Frame::new(direction).to_world(disk.extend(-1.0))
    }
}

/// The integral of the environment's radiance over all directions.
fn of_all_around(environment: &Environment) -> f32 {
    match environment {
        Environment::Black => 0.0,
        Environment::Constant(radiance) => 4.0 * PI * radiance.element_sum(),
        Environment::Map(map) => {
            let probe = |index: u32| {
                let u = Vec2::new(
                    (index as f32 + 0.5) / PROBES as f32,
                    crate::sample::radical_inverse(2, index),
                );
                map.sample(u).map_or(0.0, |(direction, pdf)| {
                    map.radiance(direction).element_sum() / pdf
                })
            };
            (0..PROBES).map(probe).sum::<f32>() / PROBES as f32
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Affine3A;

    use super::*;
    use crate::{Instance, Material, Mesh, builtin, sample::Sampler};
    use std::sync::Arc;

    /// What all particles carry is what the lights emit, and they go where their light shines.
    #[test]
    fn flux_is_that_of_the_lights() {
        let mut scene = builtin::build("cornell").expect("a scene");
        for material in &mut scene.materials {
            material.emissive = Vec3::ZERO;
        }
        scene.lights = vec![Light::point(
            "a",
            Vec3::new(0.0, 1.0, 0.0),
            Vec3::new(1.0, 2.0, 3.0),
        )];
        let mut spot = Light::point("b", Vec3::new(0.0, 1.0, 0.0), Vec3::ONE);
        spot.kind = LightKind::Spot {
            inner: 0.2,
            outer: 0.6,
        };
        scene.lights.push(spot);
        let mean = |scene: &Scene| {
            let emission = Emission::new(scene);
            let count = 1 << 14;
            let flux: Vec3 = (0..count)
                .map(|index| {
                    let sampler = Sampler::new(3, 0, index);
                    emission
                        .emit(sampler.get_1d(0), sampler.get_2d(1), sampler.get_2d(2))
                        .map_or(Vec3::ZERO, |particle| particle.flux)
                })
                .sum();
            flux / count as f32
        };
        // ∫ falloff dω by a fine sum.
        let light = &scene.lights[1];
        let steps = 20_000;
        let spot: f32 = (0..steps)
            .map(|k| {
                let angle = 0.6 * (k as f32 + 0.5) / steps as f32;
                let direction = Vec3::new(angle.sin(), 0.0, -angle.cos());
                2.0 * PI * angle.sin() * light.intensity_towards(direction).x * 0.6 / steps as f32
            })
            .sum();
        let expected = 4.0 * PI * Vec3::new(1.0, 2.0, 3.0) + spot;
        let found = mean(&scene);
        assert!(
            (found / expected - 1.0).abs().max_element() < 0.01,
            "{found} {expected}"
        );

        scene.lights.clear();
        scene.environment = Environment::Constant(Vec3::ONE);
        let radius = 0.5 * scene.bounds().diagonal();
        let found = mean(&scene).x / (4.0 * PI * PI * radius * radius);
        assert!((found - 1.0).abs() < 1e-3, "{found}");
    }

    /// Each light has all remainders evenly.
    #[test]
    fn remainders_are_spread_over_every_light() {
        let mut scene = builtin::build("cornell").expect("a scene");
        let light = |power| Light::point("a", Vec3::Y, Vec3::splat(power));
        scene.lights = [1.0, 3.0, 2.0].map(light).into();
        let emission = Emission::new(&scene);
        let count = 1 << 12;
        let mut cells = vec![[0; 4]; emission.sources.len()];
        for index in 0..count {
            let choice = (index as f32 + 0.5) / count as f32;
            let remainder = emission.remainder(choice);
            assert!((0.0..1.0).contains(&remainder));
            let at = emission.chosen(choice).expect("it shines");
            cells[at][(4.0 * remainder) as usize] += 1;
        }
        for (cells, source) in cells.iter().zip(&emission.sources) {
            let expected = source.probability * count as f32 / 4.0;
            assert!(
                cells
                    .iter()
                    .all(|&cell| (cell as f32 - expected).abs() <= 1.0),
                "{cells:?}"
            );
        }
    }

    /// A triangle shines to both sides, π times its area and radiance each.
    #[test]
    fn triangles_shine_to_both_sides() {
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, 2.0 * Vec3::X, 2.0 * Vec3::Y],
            normals: vec![Vec3::Z; 3],
            triangles: vec![[0, 1, 2]],
            triangle_materials: vec![0],
            ..Mesh::default()
        };
        let scene = Scene {
            meshes: vec![Arc::new(mesh)],
            instances: vec![Instance::new(0, Affine3A::IDENTITY)],
            materials: vec![Material {
                emissive: Vec3::splat(5.0),
                ..Material::default()
            }],
            ..Scene::default()
        };
        let emission = Emission::new(&scene);
        let mut sides = [0; 2];
        for index in 0..1000 {
            let sampler = Sampler::new(3, 0, index);
            let particle = emission
                .emit(sampler.get_1d(0), sampler.get_2d(1), sampler.get_2d(2))
                .expect("it shines");
            assert!((particle.flux.x - 2.0 * PI * 2.0 * 5.0).abs() < 1e-3);
            sides[usize::from(particle.ray.direction.z > 0.0)] += 1;
        }
        assert!(sides.iter().all(|&side| side > 400), "{sides:?}");
    }
}
