//! Stage 1, virtual point lights (§4): particles leave the lights along a low-discrepancy sequence, and every diffuse surface
//! they meet becomes a light.
//!
//! Virtual lights are spread as evenly as the paths' numbers are, and what is uneven about them is the error of the picture. The
//! first of a path's numbers chooses its light. In the paper's Halton sequence that leaves to each light every so-manieth path,
//! whose other numbers are spread no better than random ones. With [`Sequence::Lattice`] the first number runs from 0 to 1, so
//! that each light has a stretch of the paths, in proportion to its power; how far a path is in its stretch is one
//! coordinate of its direction, and multiples of the golden ratio are the other: around a point light the directions are a spherical
//! Fibonacci lattice, of as many points as the light has paths.

use glam::{Vec2, Vec3};
use isophote_scene::{
    Bsdf, Emission, Ray, Scene, SurfacePoint, Tracer, facing,
    reference::Materials,
    sample::{hash, hash_seed, radical_inverse},
};
use rayon::prelude::*;

use crate::{GiParams, Sequence};

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

/// Of Kronecker sequences, as 32-bit fractions: those of the golden ratio, of √2 and of √3.
const RATIOS: [u32; 3] = [0x9e37_79b9, 0x6a09_e667, 0xbb67_ae85];

/// A path's numbers in [0, 1).
struct Numbers<'a> {
    path: u32,
    params: &'a GiParams,
}

/// The numbers of a path's start.
struct Start {
    choice: f32,
    place: Vec2,
    direction: Vec2,
}

impl Numbers<'_> {
    fn start(&self, emission: &Emission<'_>) -> Start {
        match self.params.sequence {
            Sequence::Halton => Start {
                choice: self.get(4),
                place: self.pair(2),
                direction: self.pair(0),
            },
            Sequence::Lattice => {
                let choice = (self.path as f32 + 0.5) / self.params.paths as f32;
                let [x, y, z] = RATIOS.map(|ratio| self.path.wrapping_mul(ratio));
                Start {
                    choice,
                    place: Vec2::new(self.rotated(y, 2), self.rotated(z, 3)),
                    direction: Vec2::new(emission.remainder(choice), self.rotated(x, 1)),
                }
            }
        }
    }

    /// A 32-bit fraction, rotated (Cranley and Patterson) so that every seed has a sequence of its own.
    fn rotated(&self, fraction: u32, dimension: u32) -> f32 {
        (fraction.wrapping_add(self.shift(dimension)) >> 8) as f32 / 16_777_216.0
    }

    /// How far a dimension is rotated, as a 32-bit fraction.
    fn shift(&self, dimension: u32) -> u32 {
        match self.params.seed {
            0 => 0,
            seed => hash(hash_seed(seed) ^ hash(dimension + 1)),
        }
    }

    /// Of the Halton sequence. Further dimensions than there are bases take those again, of a shuffled index.
    fn get(&self, dimension: u32) -> f32 {
        let count = BASES.len() as u32;
        let (base, again) = (BASES[(dimension % count) as usize], dimension / count);
        // The first point of the sequence is 0 in all dimensions.
        let index = self.path + 1;
        let value = if again == 0 {
            radical_inverse(base, index)
        } else {
            (hash(index ^ hash(again * count + base)) >> 8) as f32 / 16_777_216.0
        };
        let shift = self.shift(dimension) >> 8;
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
    let numbers = Numbers { path, params };
    let mut vpls = Vec::new();
    let mut rays = 0;
    let start = numbers.start(emission);
    let Some(particle) = emission.emit(start.choice, start.place, start.direction) else {
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
