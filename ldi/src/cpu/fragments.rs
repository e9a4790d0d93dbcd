//! Hybrid stage 1, the G-buffer: what the camera sees, one shading per primitive and pixel.
//!
//! With several samples a pixel those that meet the same triangle are one fragment, which is shaded once, at the first
//! of them, and weighted with how many there are: anti-aliasing as graphics hardware does it (§4).

use glam::{UVec2, Vec2, Vec3};
use isophote_scene::{Camera, Scene, Seen, SurfaceMaterial, SurfacePoint, Tracer, facing};
use rayon::prelude::*;

use crate::HybridParams;

/// A primitive in a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fragment {
    pub(super) pixel: u32,
    /// The number of its first sample among those of all pixels: what its random numbers belong to.
    pub(super) sample: u32,
    /// The share of the pixel's samples.
    pub(super) weight: f32,
    pub(super) point: SurfacePoint,
    /// Unit, towards the viewer.
    pub(super) view: Vec3,
    pub(super) material: SurfaceMaterial,
    /// Albedo of its diffuse part.
    pub(super) diffuse: Vec3,
}

impl Fragment {
    /// The shading normal on the viewer's side.
    pub(super) fn normal(&self) -> Vec3 {
        facing(self.point.shading_normal, self.view)
    }

    /// Its part of a pixel's rays, at least one: so a pixel takes as many whatever it shows, and its noise is the same.
    pub(super) fn rays(&self, of_pixel: u32) -> u32 {
        ((of_pixel as f32 * self.weight).ceil() as u32).max(1)
    }

    /// Whether it scatters diffusely and does nothing else with light.
    pub(super) fn is_matte(&self) -> bool {
        let material = &self.material;
        material.metallic == 0.0 && material.transmission == 0.0 && !material.unlit
    }
}

/// What the camera sees, in the order of pixels.
#[derive(Clone, Debug)]
pub(super) struct Fragments {
    pub(super) all: Vec<Fragment>,
    pixels: usize,
    /// Samples of a pixel.
    samples: usize,
}

/// Places of samples in a pixel: the rotated grid of four.
const ROTATED: [Vec2; 4] = [
    Vec2::new(0.375, 0.125),
    Vec2::new(0.875, 0.375),
    Vec2::new(0.125, 0.625),
    Vec2::new(0.625, 0.875),
];

impl Fragments {
    /// With one sample in the middle of each pixel, or four.
    pub(super) fn seen<T: Tracer + ?Sized>(
        scene: &Scene,
        tracer: &T,
        camera: &Camera,
        [width, height]: [u32; 2],
        params: &HybridParams,
    ) -> Self {
        let places: &[Vec2] = if params.samples == 1 {
            &[Vec2::splat(0.5)]
        } else {
            &ROTATED
        };
        let pixels = width as usize * height as usize;
        let of_pixel = |pixel: usize| {
            let corner = UVec2::new(pixel as u32 % width, pixel as u32 / width).as_vec2();
            let mut found: Vec<Fragment> = Vec::new();
            for (number, &place) in places.iter().enumerate() {
                let ray = camera.ray(corner + place, width, height);
                let Some(hit) = tracer.closest_hit(&ray) else {
                    continue;
                };
                let weight = 1.0 / places.len() as f32;
                let same = found
                    .iter_mut()
                    .find(|other| other.point.surface == hit.surface);
                if let Some(same) = same {
                    same.weight += weight;
                    continue;
                }
                let point = scene.surface_point(&hit);
                let seen = Seen::new(scene, point, -ray.direction, params.materials);
                found.push(Fragment {
                    pixel: pixel as u32,
                    sample: (pixel * places.len() + number) as u32,
                    weight,
                    point: seen.point,
                    view: seen.view,
                    diffuse: seen.albedo(),
                    material: seen.material,
                });
            }
            found
        };
        let all = (0..pixels)
            .into_par_iter()
            .flat_map_iter(of_pixel)
            .collect();
        Self {
            all,
            pixels,
            samples: places.len(),
        }
    }

    pub(super) fn camera_rays(&self) -> u64 {
        (self.pixels * self.samples) as u64
    }

    /// The weighted sum of the fragments' values in each pixel.
    pub(super) fn over_pixels(&self, values: &[Vec3]) -> Vec<Vec3> {
        let mut sums = vec![Vec3::ZERO; self.pixels];
        for (fragment, &value) in self.all.iter().zip(values) {
            sums[fragment.pixel as usize] += fragment.weight * value;
        }
        sums
    }
}
