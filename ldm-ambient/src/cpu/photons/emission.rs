//! Stage 7, photons leave the lights (§4.2): each pixel of a light's view is one. What emits otherwise, spheres and triangles,
//! sends photons from a low-discrepancy sequence, whose differentials are what one of so many stands for.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};
use isophote_scene::{
    Emission, Environment, Light, LightKind, Ray, Scene, Seen, SurfaceId, Tracer,
    sample::{Frame, Sampler},
};
use rayon::prelude::*;

use super::{
    Deposit, PhotonParams, Spread,
    cut::Cutter,
    differential::Differential,
    views::{Leaving, faces, has_view},
};
use crate::cpu::Point;

/// Of the footprint that one of so many photons without a raster stands for: less is noise, more is light where there is none.
/// Measured in the Cornell box along 256 maps, for 0.125, 0.25 and 0.5 of it: relRMSE 15.9, 13.1 and 12.2 % with
/// `raster` 16, 11.1, 10.2 and 9.7 % with 64, 9.8, 9.4 and 9.2 % with 128; bias −0.5, 1.2 and 2.1 %, 1.0, 1.3 and 1.8 %, 0.7,
/// 0.9 and 1.3 %.
const OVERLAP: f32 = 0.25;

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
    /// The part of its footprint where there is a surface, if that was looked at.
    pub(crate) covered: Option<f32>,
}

impl Photon {
    /// The differential of a part that goes on in a direction.
    pub(crate) fn spread(&self, direction: Vec3, params: &PhotonParams) -> Differential {
        match params.spread {
            Spread::Parallel => self.differential.parallel(),
            Spread::Turned => self.differential.reflect(self.direction, direction),
        }
    }
}

/// The photons of all lights where they meet the first surface, and what left the lights in watts.
pub(crate) fn emit<T: Tracer + ?Sized>(
    scene: &Scene,
    exact: &T,
    params: &PhotonParams,
) -> (Vec<Photon>, Vec3) {
    let alone = |photon: &Leaving| land(scene, exact, photon, params);
    let leaving = leave(scene, params);
    let power = leaving.iter().map(|photon| photon.flux).sum();
    if params.deposit == Deposit::Splatted {
        return (leaving.par_iter().filter_map(alone).collect(), power);
    }
    let faces = faces(scene, params.raster, params.environment);
    let pixels = faces
        .iter()
        .flat_map(|face| face.pixels().map(move |at| (face, at)));
    let pixels: Vec<_> = pixels.collect();
    let cutter = Cutter {
        scene,
        exact,
        params,
    };
    let halvings = (params.finest / params.raster).checked_ilog2().unwrap_or(0);
    let landed = pixels.par_iter().flat_map_iter(|(face, at)| {
        let mut photons = Vec::new();
        cutter.land(face, *at, 1.0, halvings, &mut photons);
        photons
    });
    let mut photons: Vec<Photon> = landed.collect();
    photons.par_extend(leaving[pixels.len()..].par_iter().filter_map(alone));
    (photons, power)
}

/// The photons that leave all lights: those of their views first, each a pixel.
pub(crate) fn leave(scene: &Scene, params: &PhotonParams) -> Vec<Leaving> {
    let faces = faces(scene, params.raster, params.environment);
    let of_views = faces
        .iter()
        .flat_map(|face| face.pixels().map(|at| face.leave(at, 1.0)));
    of_views.chain(leave_others(scene, params)).collect()
}

/// What photons become that are reflected once more, each along some of the maps' directions, and meet a surface. All go along
/// the same ones, so footprints tile what they meet.
pub(crate) fn bounce<T: Tracer + ?Sized>(
    scene: &Scene,
    exact: &T,
    photons: &[Photon],
    directions: &[Vec3],
    params: &PhotonParams,
) -> Vec<Photon> {
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
                differential: photon.spread(direction, params),
            });
        let reflects = photon.albedo != Vec3::ZERO;
        leaving.filter(|_| reflects).collect::<Vec<_>>()
    };
    let leaving: Vec<Leaving> = photons.par_iter().flat_map_iter(reflect).collect();
    let land = |photon: &Leaving| land(scene, exact, photon, params);
    leaving.par_iter().filter_map(land).collect()
}

/// A photon where it meets the first surface.
pub(super) fn land<T: Tracer + ?Sized>(
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
        covered: None,
    })
}

/// Photons of spheres and emissive triangles, as many as a point light has.
fn leave_others(scene: &Scene, params: &PhotonParams) -> Vec<Leaving> {
    let others = Scene {
        lights: scene
            .lights
            .iter()
            .filter(|light| !has_view(light))
            .cloned()
            .collect(),
        environment: Environment::Black,
        ..scene.clone()
    };
    if !others.has_light() {
        return Vec::new();
    }
    let emission = Emission::new(&others);
    let count = 6 * params.raster * params.raster;
    // Of the directions and of the places one photon has the square root of its share, had they a raster of four dimensions.
    // Each place of a surface, which has two, is then met by √count of them.
    let share = (1.0 / count as f32).sqrt() * OVERLAP;
    let leave = |index: u32| {
        let sampler = Sampler::new(params.seed, 0x6c64_6d70, index);
        let particle = emission.emit(sampler.get_1d(0), sampler.get_2d(1), sampler.get_2d(2))?;
        let frame = Frame::new(particle.ray.direction);
        let area = match particle.start {
            SurfaceId::UNKNOWN => sphere_area(&others, particle.ray.origin),
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

/// The area of the shining sphere that a place is on, m².
fn sphere_area(scene: &Scene, place: Vec3) -> f32 {
    let sphere = |light: &Light| match light.kind {
        LightKind::Point { radius } => Some((place.distance(light.position()) - radius, radius)),
        _ => None,
    };
    let spheres = scene.lights.iter().filter_map(sphere);
    let nearest = spheres.min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
    nearest.map_or(0.0, |(_, radius)| 4.0 * PI * radius * radius)
}
