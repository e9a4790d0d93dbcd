//! Where light comes from, and how to choose a direction towards it.
//!
//! Three groups are sampled apart, one ray each: the lights without geometry, chosen by what each would
//! contribute without occlusion; the emissive triangles, by emitted power; the environment, by radiance.

use std::{collections::HashMap, f32::consts::PI};

use glam::{Vec2, Vec3};

use crate::{
    Environment, Light, LightKind, Scene, SurfaceId, SurfacePoint,
    sample::{Frame, uniform_cone, uniform_sphere, uniform_triangle},
};

/// The lights of a scene, ready to be sampled.
pub(crate) struct LightSampler<'a> {
    scene: &'a Scene,
    emitters: Vec<Emitter>,
    /// Index in `emitters` by triangle.
    index: HashMap<SurfaceId, u32>,
}

/// An emissive triangle.
pub(crate) struct Emitter {
    pub(crate) surface: SurfaceId,
    pub(crate) area: f32,
    /// Probability of this triangle, and of all up to and including it.
    probability: f32,
    pub(crate) cumulative: f32,
}

impl Emitter {
    /// Probability over area.
    pub(crate) fn density(&self) -> f32 {
        self.probability / self.area
    }
}

/// The emissive triangles of a scene in its order.
pub(crate) fn emitters(scene: &Scene) -> Vec<Emitter> {
    if !scene.materials.iter().any(crate::Material::is_emissive) {
        return Vec::new();
    }
    let mut emitters = Vec::new();
    let mut total = 0.0_f64;
    for (index, instance) in scene.instances.iter().enumerate() {
        let mesh = scene.mesh(instance);
        for (primitive, &material) in mesh.triangle_materials.iter().enumerate() {
            let material = &scene.materials[material as usize];
            if !material.is_emissive() {
                continue;
            }
            let [a, b, c] = mesh
                .corners(primitive)
                .map(|corner| instance.transform.transform_point3(corner));
            let area = crate::area(a, b, c) as f32;
            let power = f64::from(area * material.emissive.element_sum());
            let surface = SurfaceId {
                instance: index as u32,
                primitive: primitive as u32,
            };
            total += power;
            emitters.push((surface, area, power, total));
        }
    }
    emitters
        .into_iter()
        .map(|(surface, area, power, sum)| Emitter {
            surface,
            area,
            probability: (power / total) as f32,
            cumulative: (sum / total) as f32,
        })
        .collect()
}

/// Light that arrives from one chosen direction, if nothing is in the way.
pub(crate) struct Incoming {
    /// Unit, towards the light.
    pub(crate) direction: Vec3,
    /// Where the light is; `None` where it is infinitely far away.
    pub(crate) end: Option<Vec3>,
    /// Radiance over the density of the choice; for lights without extent the irradiance at normal incidence
    /// over the probability of the choice.
    pub(crate) weight: Vec3,
    /// Solid-angle density, where scattered rays can find the light too; infinite elsewhere.
    pub(crate) pdf: f32,
}

impl<'a> LightSampler<'a> {
    pub(crate) fn new(scene: &'a Scene) -> Self {
        let emitters = emitters(scene);
        let index = emitters
            .iter()
            .enumerate()
            .map(|(i, emitter)| (emitter.surface, i as u32))
            .collect();
        Self {
            scene,
            emitters,
            index,
        }
    }

    /// Whether a ray can find light: on an emissive triangle or outside the scene.
    pub(crate) fn can_be_hit(&self) -> bool {
        self.has_emitters() || !self.scene.environment.is_black()
    }

    /// Whether there are emissive triangles.
    pub(crate) fn has_emitters(&self) -> bool {
        !self.emitters.is_empty()
    }

    /// One of the lights without geometry, chosen by `contribution` of its unoccluded light (a function of
    /// the direction and the irradiance at normal incidence).
    pub(crate) fn sample_lights(
        &self,
        point: Vec3,
        choice: f32,
        u: Vec2,
        contribution: impl Fn(Vec3, Vec3) -> f32,
    ) -> Option<Incoming> {
        let weigh = |light: &Light| {
            let (direction, irradiance, extent) = at_center(light, point);
            // A sphere can shine over the horizon of a point that its centre is below.
            contribution(direction, irradiance) + extent * irradiance.element_sum()
        };
        let weights = self.scene.lights.iter().map(weigh);
        let total: f32 = weights.clone().sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let mut rest = choice * total;
        let mut chosen = None;
        for (light, weight) in self.scene.lights.iter().zip(weights) {
            if weight > 0.0 {
                chosen = Some((light, weight));
                if rest < weight {
                    break;
                }
            }
            rest -= weight;
        }
        let (light, weight) = chosen?;
        let mut incoming = towards(light, point, u)?;
        incoming.weight *= total / weight;
        Some(incoming)
    }

    /// A point of an emissive triangle; lifted towards `point`.
    pub(crate) fn sample_emitters(&self, point: Vec3, choice: f32, u: Vec2) -> Option<Incoming> {
        let last = self.emitters.len().checked_sub(1)?;
        let at = self
            .emitters
            .partition_point(|emitter| emitter.cumulative <= choice)
            .min(last);
        let emitter = &self.emitters[at];
        let uv = uniform_triangle(u);
        // Where a mask cuts a lamp away it does not shine.
        if !self.scene.alpha_passes(emitter.surface, uv) {
            return None;
        }
        let target = self.scene.point_on(emitter.surface, uv);
        let direction = (target.position - point).try_normalize()?;
        let end = Some(target.lifted(-direction, 0.0));
        let pdf = self.emitter_pdf(emitter, &target, point, direction);
        let radiance = self.scene.surface_material(&target).emissive;
        let incoming = Incoming {
            direction,
            end,
            weight: radiance / pdf,
            pdf,
        };
        (pdf > 0.0 && pdf.is_finite()).then_some(incoming)
    }

    /// A direction towards the environment.
    pub(crate) fn sample_environment(&self, u: Vec2) -> Option<Incoming> {
        let (direction, pdf) = match &self.scene.environment {
            Environment::Black => return None,
            Environment::Constant(_) => (uniform_sphere(u), 0.25 / PI),
            Environment::Map(map) => map.sample(u)?,
        };
        let weight = self.scene.environment.radiance(direction) / pdf;
        Some(Incoming {
            direction,
            end: None,
            weight,
            pdf,
        })
    }

    /// The density with which [`sample_emitters`](Self::sample_emitters) finds a point that a ray from `origin`
    /// has hit.
    pub(crate) fn emitter_pdf_at(
        &self,
        target: &SurfacePoint,
        origin: Vec3,
        direction: Vec3,
    ) -> f32 {
        self.index.get(&target.surface).map_or(0.0, |&i| {
            self.emitter_pdf(&self.emitters[i as usize], target, origin, direction)
        })
    }

    /// The density with which [`sample_environment`](Self::sample_environment) finds a direction.
    pub(crate) fn environment_pdf(&self, direction: Vec3) -> f32 {
        match &self.scene.environment {
            Environment::Black => 0.0,
            Environment::Constant(_) => 0.25 / PI,
            Environment::Map(map) => map.pdf(direction),
        }
    }

    fn emitter_pdf(
        &self,
        emitter: &Emitter,
        target: &SurfacePoint,
        origin: Vec3,
        direction: Vec3,
    ) -> f32 {
        let cosine = target.geometric_normal.dot(direction).abs();
        let squared = (target.position - origin).length_squared();
        emitter.density() * squared / cosine
    }
}

/// Direction to a light's centre, its irradiance there at normal incidence, and how far its extent reaches
/// (0 without).
fn at_center(light: &Light, point: Vec3) -> (Vec3, Vec3, f32) {
    if let LightKind::Directional = light.kind {
        return (-light.direction(), light.intensity, 0.0);
    }
    let offset = light.position() - point;
    let squared = offset.length_squared();
    let Some(direction) = offset.try_normalize() else {
        return (Vec3::Y, Vec3::ZERO, 0.0);
    };
    let irradiance = light.intensity_towards(-direction) / squared;
    let extent = match light.kind {
        LightKind::Point { radius } => (radius * radius / squared).min(1.0),
        _ => 0.0,
    };
    (direction, irradiance, extent)
}

/// Light from one light, as if it were the only one.
pub(crate) fn towards(light: &Light, point: Vec3, u: Vec2) -> Option<Incoming> {
    let (direction, irradiance, _) = at_center(light, point);
    let end = match light.kind {
        LightKind::Directional => None,
        LightKind::Point { radius } if radius > 0.0 => {
            return towards_sphere(light, radius, point, u);
        }
        _ => Some(light.position()),
    };
    Some(Incoming {
        direction,
        end,
        weight: irradiance,
        pdf: f32::INFINITY,
    })
}

/// A direction within the cone that a spherical light fills: radiance I/(πr²), density 1/(2π(1 − cosθ)).
fn towards_sphere(light: &Light, radius: f32, point: Vec3, u: Vec2) -> Option<Incoming> {
    let offset = light.position() - point;
    let sin2 = radius * radius / offset.length_squared();
    if sin2.is_nan() || sin2 >= 1.0 {
        return None;
    }
    let cos_max = (1.0 - sin2).sqrt();
    // 1 − cosθ without cancellation for small spheres.
    let solid_angle = 2.0 * PI * sin2 / (1.0 + cos_max);
    let axis = offset.normalize();
    let direction = Frame::new(axis)
        .to_world(uniform_cone(u, cos_max))
        .normalize();
    let along = offset.dot(direction);
    let inside = radius * radius - (offset.length_squared() - along * along);
    let distance = along - inside.max(0.0).sqrt();
    let weight = light.intensity * (solid_angle / (PI * radius * radius));
    Some(Incoming {
        direction,
        end: Some(point + distance * direction),
        weight,
        pdf: f32::INFINITY,
    })
}
