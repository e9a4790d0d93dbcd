//! Stage 1, virtual point lights (§4): particles leave the lights along a Halton sequence, and every diffuse surface they
//! meet becomes a light.

use glam::{Vec2, Vec3};
use isophote_scene::{
    Bsdf, Emission, Ray, Scene, SurfacePoint, Tracer, facing,
    reference::Materials,
    sample::{hash, hash_seed, radical_inverse},
};
use rayon::prelude::*;

use crate::GiParams;

/// Bases of the Halton sequence. Directions, which count most, have the smallest.
const BASES: [u32; 8] = [2, 3, 5, 7, 11, 13, 17, 19];
/// Dimensions of a path's start: direction, place, light.
const START: u32 = 5;
/// Further dimensions for each bounce: direction and lobe.
const PER_BOUNCE: u32 = 3;

/// A virtual point light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vpl {
    /// Where it is.
    pub point: SurfacePoint,
    /// The triangle's normal on the side that is lit.
    pub normal: Vec3,
    /// `L_e` of Eq. (1), Φ · albedo/π, W/sr along the normal.
    pub intensity: Vec3,
    /// How many surfaces its light has met, this one counted; at least 1.
    pub bounce: u32,
}

/// Shoots the light paths. The order is that of the paths, whatever the number of threads. Returns the number of rays too.
pub fn shoot<T: Tracer + ?Sized>(scene: &Scene, tracer: &T, params: &GiParams) -> (Vec<Vpl>, u64) {
    let emission = Emission::new(scene);
    let paths: Vec<(Vec<Vpl>, u64)> = (0..params.paths)
        .into_par_iter()
        .map(|path| follow(scene, tracer, &emission, params, path))
        .collect();
    let rays = paths.iter().map(|(_, rays)| rays).sum();
    let vpls = paths.into_iter().flat_map(|(vpls, _)| vpls).collect();
    (vpls, rays)
}

/// A path's numbers in [0, 1).
struct Halton {
    index: u32,
    seed: u64,
}

impl Halton {
    /// Further dimensions than there are bases take those again, of a shuffled index.
    fn get(&self, dimension: u32) -> f32 {
        let count = BASES.len() as u32;
        let (base, again) = (BASES[(dimension % count) as usize], dimension / count);
        // The first point of the sequence is 0 in all dimensions.
        let index = self.index + 1;
        let value = if again == 0 {
            radical_inverse(base, index)
        } else {
            (hash(index ^ hash(again * count + base)) >> 8) as f32 / 16_777_216.0
        };
        if self.seed == 0 {
            return value;
        }
        // Rotated (Cranley and Patterson), so that every seed has a sequence of its own.
        let shift = hash(hash_seed(self.seed) ^ hash(dimension + 1)) >> 8;
        (value + shift as f32 / 16_777_216.0).fract()
    }

    fn pair(&self, dimension: u32) -> Vec2 {
        Vec2::new(self.get(dimension), self.get(dimension + 1))
    }
}

fn follow<T: Tracer + ?Sized>(
    scene: &Scene,
    tracer: &T,
    emission: &Emission<'_>,
    params: &GiParams,
    path: u32,
) -> (Vec<Vpl>, u64) {
    let numbers = Halton {
        index: path,
        seed: params.seed,
    };
    let mut vpls = Vec::new();
    let mut rays = 0;
    let Some(particle) = emission.emit(numbers.get(4), numbers.pair(2), numbers.pair(0)) else {
        return (vpls, rays);
    };
    let (mut ray, mut start) = (particle.ray, particle.start);
    let mut flux = particle.flux / params.paths as f32;
    for bounce in 1..=params.bounces {
        rays += 1;
        let Some(hit) = tracer.closest_hit_from(&ray, start) else {
            break;
        };
        let point = scene.surface_point(&hit);
        let mut material = scene.surface_material(&point);
        if material.unlit {
            break;
        }
        if params.materials == Materials::Lambert {
            (material.metallic, material.transmission) = (0.0, 0.0);
        }
        let from = -ray.direction;
        let normal = facing(point.geometric_normal, from);
        let shading = facing(point.shading_normal, from);
        // A surface takes what its shading normal receives; flux is counted around the triangle's.
        let received = shading.dot(from).max(0.0) / normal.dot(from).max(1e-4);
        let diffuse = (1.0 - material.metallic) * (1.0 - material.transmission);
        let intensity =
            flux * (received.min(8.0) * diffuse) * material.base_color / std::f32::consts::PI;
        if intensity != Vec3::ZERO && intensity.is_finite() {
            vpls.push(Vpl {
                point,
                normal,
                intensity,
                bounce,
            });
        }
        let outside = point.shading_normal.dot(from) >= 0.0;
        let bsdf = Bsdf::new(shading, &material, outside);
        let dimension = START + PER_BOUNCE * (bounce - 1);
        let Some(sample) = bsdf.sample(from, numbers.get(dimension + 2), numbers.pair(dimension))
        else {
            break;
        };
        flux *= sample.weight;
        if flux == Vec3::ZERO || !flux.is_finite() {
            break;
        }
        let origin = point.lifted(sample.light, tracer.tolerance(point.position));
        ray = Ray::new(origin, sample.light);
        start = point.surface;
    }
    (vpls, rays)
}
