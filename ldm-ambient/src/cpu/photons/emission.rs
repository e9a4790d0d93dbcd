//! Stage 7, photons leave the lights (§4.2): each pixel of a light's view is one. A point light has a view of six faces, a
//! spot one; a sun a parallel one. What emits otherwise, triangles and the environment, sends photons from a low-discrepancy
//! sequence, whose differentials are what one of so many stands for.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};
use isophote_scene::{
    Emission, Environment, Light, LightKind, Ray, Scene, Seen, SurfaceId, Tracer,
    sample::{Frame, Sampler},
};
use rayon::prelude::*;

use super::{PhotonParams, differential::Differential};
use crate::{Directions, cpu::Point};

/// Of the footprint that one of so many photons without a raster stands for.
const OVERLAP: f32 = 0.125;

/// A photon on the first surface it meets.
#[derive(Clone, Copy)]
pub(crate) struct Photon {
    pub(crate) surface: SurfaceId,
    pub(crate) point: Point,
    /// Unit, as it came.
    pub(crate) direction: Vec3,
    /// Watts that it brought.
    pub(crate) flux: Vec3,
    /// Of them what is reflected diffusely.
    pub(crate) albedo: Vec3,
    pub(crate) differential: Differential,
}

/// A photon that leaves a light.
struct Leaving {
    ray: Ray,
    start: SurfaceId,
    flux: Vec3,
    differential: Differential,
}

/// The photons of all lights where they meet the first surface, and what left the lights in watts.
pub(crate) fn emit<T: Tracer + ?Sized>(
    scene: &Scene,
    exact: &T,
    params: &PhotonParams,
) -> (Vec<Photon>, Vec3) {
    let mut leaving: Vec<Leaving> = scene
        .lights
        .iter()
        .flat_map(|light| leave_light(scene, light, params.raster))
        .collect();
    leaving.extend(leave_others(scene, params));
    let power = leaving.iter().map(|photon| photon.flux).sum();
    let land = |photon: &Leaving| land(scene, exact, photon, params);
    (leaving.par_iter().filter_map(land).collect(), power)
}

/// What photons become that are reflected once more, each along some of the maps' directions, and meet a surface. All go along
/// the same ones, so footprints tile what they meet.
pub(crate) fn bounce<T: Tracer + ?Sized>(
    scene: &Scene,
    exact: &T,
    photons: &[Photon],
    branches: u32,
    params: &PhotonParams,
) -> Vec<Photon> {
    let directions = Directions::new(params.maps.maps).subset(branches);
    let reflect = |photon: &Photon| {
        let normals = [photon.point.shading_normal, photon.point.geometric_normal];
        let cosine = |direction: &Vec3| direction.dot(normals[0]).abs();
        let sum: f32 = directions.iter().map(cosine).sum();
        let go = |direction: &Vec3| {
            let direction = direction * 1_f32.copysign(direction.dot(normals[0]));
            let above = direction.dot(normals[1]) > 0.0;
            let share = cosine(&direction) / sum;
            (above && share > 0.0).then_some((direction, share))
        };
        let leaving = directions
            .iter()
            .filter_map(go)
            .map(|(direction, share)| Leaving {
                ray: Ray::new(photon.point.position, direction),
                start: photon.surface,
                flux: share * photon.albedo * photon.flux,
                differential: photon.differential.parallel(),
            });
        let reflects = photon.albedo != Vec3::ZERO;
        leaving.filter(|_| reflects).collect::<Vec<_>>()
    };
    let leaving: Vec<Leaving> = photons.par_iter().flat_map_iter(reflect).collect();
    let land = |photon: &Leaving| land(scene, exact, photon, params);
    leaving.par_iter().filter_map(land).collect()
}

/// A photon where it meets the first surface.
fn land<T: Tracer + ?Sized>(
    scene: &Scene,
    exact: &T,
    photon: &Leaving,
    params: &PhotonParams,
) -> Option<Photon> {
    let hit = exact.closest_hit_from(&photon.ray, photon.start)?;
    let seen = Seen::new(
        scene,
        scene.surface_point(&hit),
        -photon.ray.direction,
        params.materials,
    );
    let point = Point::new(&seen.point, seen.view, params.normals);
    let direction = photon.ray.direction;
    let differential = photon
        .differential
        .transfer(direction, hit.t, point.geometric_normal);
    let footprint = differential.parallelogram();
    (footprint.is_finite() && photon.flux != Vec3::ZERO).then_some(Photon {
        surface: hit.surface,
        point,
        direction,
        flux: photon.flux,
        albedo: seen.albedo(),
        differential,
    })
}

/// The photons of a light without geometry.
fn leave_light(scene: &Scene, light: &Light, raster: u32) -> Vec<Leaving> {
    match light.kind {
        LightKind::Point { .. } => [Vec3::X, Vec3::Y, Vec3::Z]
            .into_iter()
            .flat_map(|axis| [axis, -axis])
            .flat_map(|axis| through_raster(light, axis, 1.0, raster))
            .collect(),
        LightKind::Spot { outer, .. } => {
            // A cone wider than a face sees no more than that.
            let half = outer.min(1.5).tan();
            through_raster(light, light.direction(), half, raster)
        }
        LightKind::Directional => parallel_raster(scene, light, raster),
    }
}

/// A photon for each pixel of a square view.
fn through_raster(light: &Light, axis: Vec3, half: f32, raster: u32) -> Vec<Leaving> {
    let frame = Frame::new(axis);
    let step = 2.0 * half / raster as f32;
    let corner = |index: u32| f64::from(index as f32 * step - half);
    let pixels = (0..raster).flat_map(|row| (0..raster).map(move |column| (column, row)));
    let leave = |(column, row): (u32, u32)| {
        let at = Vec2::new(column as f32 + 0.5, row as f32 + 0.5) * step - half;
        let through = frame.to_world(at.extend(1.0));
        let direction = through.normalize();
        let solid_angle = quadrant(corner(column + 1), corner(row + 1))
            - quadrant(corner(column), corner(row + 1))
            - quadrant(corner(column + 1), corner(row))
            + quadrant(corner(column), corner(row));
        Leaving {
            ray: Ray::new(light.position(), direction),
            start: SurfaceId::UNKNOWN,
            flux: light.intensity_towards(direction) * solid_angle as f32,
            differential: Differential::through(through, [frame.x * step, frame.y * step]),
        }
    };
    pixels
        .map(leave)
        .filter(|photon| photon.flux != Vec3::ZERO)
        .collect()
}

/// The solid angle of the rectangle between the axis and a corner of the plane at distance 1.
fn quadrant(x: f64, y: f64) -> f64 {
    (x * y).atan2((x * x + y * y + 1.0).sqrt())
}

/// A photon for each pixel of a parallel view of the whole scene.
fn parallel_raster(scene: &Scene, light: &Light, raster: u32) -> Vec<Leaving> {
    let bounds = scene.bounds();
    let frame = Frame::new(light.direction());
    let half = 0.5 * bounds.diagonal();
    let step = 2.0 * half / raster as f32;
    let pixels = (0..raster).flat_map(|row| (0..raster).map(move |column| (column, row)));
    let leave = |(column, row): (u32, u32)| {
        let at = Vec2::new(column as f32 + 0.5, row as f32 + 0.5) * step - half;
        Leaving {
            ray: Ray::new(bounds.center() + frame.to_world(at.extend(-half)), frame.z),
            start: SurfaceId::UNKNOWN,
            flux: light.intensity * step * step,
            differential: Differential {
                position: [frame.x * step, frame.y * step],
                direction: [Vec3::ZERO; 2],
            },
        }
    };
    pixels.map(leave).collect()
}

/// Photons of emissive triangles and of the environment, as many as a point light has.
fn leave_others(scene: &Scene, params: &PhotonParams) -> Vec<Leaving> {
    let others = Scene {
        lights: Vec::new(),
        environment: if params.environment {
            scene.environment.clone()
        } else {
            Environment::Black
        },
        ..scene.clone()
    };
    if !others.has_light() {
        return Vec::new();
    }
    let emission = Emission::new(&others);
    let count = 6 * params.raster * params.raster;
    let radius = 0.5 * scene.bounds().diagonal();
    // Of the directions and of the places one photon has the square root of its share, had they a raster of four dimensions. So
    // many photons meet each place of the surfaces, which have two, that a part of it is enough.
    let share = (1.0 / count as f32).sqrt() * OVERLAP;
    let leave = |index: u32| {
        let sampler = Sampler::new(params.seed, 0x6c64_6d70, index);
        let particle = emission.emit(sampler.get_1d(0), sampler.get_2d(1), sampler.get_2d(2))?;
        let frame = Frame::new(particle.ray.direction);
        let area = match particle.start {
            SurfaceId::UNKNOWN => PI * radius * radius,
            surface => {
                let [a, b, c] =
                    [Vec2::ZERO, Vec2::X, Vec2::Y].map(|uv| scene.point_on(surface, uv).position);
                isophote_scene::area(a, b, c) as f32
            }
        };
        let (across, turn) = ((area * share).sqrt(), (PI * share).sqrt());
        Some(Leaving {
            ray: particle.ray,
            start: particle.start,
            flux: particle.flux / count as f32,
            differential: Differential {
                position: [frame.x * across, frame.y * across],
                direction: [frame.x * turn, frame.y * turn],
            },
        })
    };
    (0..count).filter_map(leave).collect()
}

#[cfg(test)]
mod tests {
    use glam::Affine3A;

    use super::*;

    /// The faces of a point light send 4π times its intensity, a spot as much as its cone holds, and differentials have the
    /// solid angles of their pixels.
    #[test]
    fn flux_is_that_of_the_lights() {
        let scene = Scene::default();
        let mut light = Light::point("", Vec3::ONE, Vec3::new(1.0, 2.0, 3.0));
        for raster in [1, 7, 64] {
            let photons = leave_light(&scene, &light, raster);
            assert_eq!(photons.len(), (6 * raster * raster) as usize);
            let flux: Vec3 = photons.iter().map(|photon| photon.flux).sum();
            assert!(
                (flux / (4.0 * PI * light.intensity) - 1.0)
                    .abs()
                    .max_element()
                    < 1e-4
            );
            if raster < 32 {
                continue;
            }
            for photon in &photons {
                let [u, v] = photon.differential.direction;
                let ratio = u.cross(v).length() / photon.flux.x;
                assert!((ratio - 1.0).abs() < 2e-3, "{ratio}");
            }
        }
        light.kind = LightKind::Spot {
            inner: 0.4,
            outer: 0.4,
        };
        light.transform = Affine3A::IDENTITY;
        let flux: Vec3 = leave_light(&scene, &light, 256)
            .iter()
            .map(|photon| photon.flux)
            .sum();
        let cone = 2.0 * PI * (1.0 - 0.4_f32.cos());
        assert!((flux.x / cone - 1.0).abs() < 0.02, "{}", flux.x / cone);
    }
}
