//! What a camera sees, and what any ray that meets a surface knows of it.

use glam::{UVec2, Vec3};
use rayon::prelude::*;

use crate::{
    Camera, Hit, Pinhole, Ray, Scene, SurfaceMaterial, SurfacePoint, Tracer, facing,
    reference::Materials,
};

/// A surface, as it is seen from somewhere.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Where, and its normals.
    pub point: SurfacePoint,
    /// Unit, towards the viewer.
    pub view: Vec3,
    /// What of it counts.
    pub material: SurfaceMaterial,
}

impl Seen {
    /// A point, its material at the textures' full resolution. What is unlit is neither metal nor glass.
    pub fn new(scene: &Scene, point: SurfacePoint, view: Vec3, materials: Materials) -> Self {
        let mut material = scene.surface_material(&point);
        if materials == Materials::Lambert || material.unlit {
            (material.metallic, material.transmission) = (0.0, 0.0);
        }
        Self {
            point,
            view,
            material,
        }
    }

    /// The shading normal on the viewer's side.
    pub fn normal(&self) -> Vec3 {
        facing(self.point.shading_normal, self.view)
    }

    /// Whether the viewer is on the front.
    pub fn is_outside(&self) -> bool {
        self.point.shading_normal.dot(self.view) >= 0.0
    }

    /// Albedo of the diffuse part, linear RGB: metal and glass have none, and what is unlit reflects nothing.
    pub fn albedo(&self) -> Vec3 {
        if self.material.unlit {
            return Vec3::ZERO;
        }
        self.material.base_color
            * (1.0 - self.material.metallic)
            * (1.0 - self.material.transmission)
    }
}

/// What a camera sees through the centres of its pixels.
#[derive(Clone, Debug)]
pub struct GBuffer {
    /// Width and height.
    pub size: [u32; 2],
    /// Row by row from the top; `None` where nothing is seen.
    pub pixels: Vec<Option<Seen>>,
}

impl GBuffer {
    /// Looks through every pixel.
    pub fn see<T: Tracer + ?Sized>(
        scene: &Scene,
        tracer: &T,
        camera: &Camera,
        size: [u32; 2],
        materials: Materials,
    ) -> Self {
        let pixels = through_pixels(tracer, camera, size).map(|found| {
            let (ray, hit) = found?;
            let view = -ray.direction.normalize();
            Some(Seen::new(scene, scene.surface_point(&hit), view, materials))
        });
        Self {
            size,
            pixels: pixels.collect(),
        }
    }

    /// Of every pixel the normal and the depth along the viewing direction, metres: what image filters are guided by.
    /// Zeros where nothing is seen.
    pub fn normals_and_depths(&self, eye: &Pinhole) -> (Vec<Vec3>, Vec<f32>) {
        let guide = |seen: &Option<Seen>| {
            seen.as_ref().map_or((Vec3::ZERO, 0.0), |seen| {
                (seen.normal(), eye.depth(seen.point.position))
            })
        };
        let (mut normals, mut depths) = (Vec::new(), Vec::new());
        let guides = self.pixels.par_iter().map(guide);
        guides.unzip_into_vecs(&mut normals, &mut depths);
        (normals, depths)
    }
}

/// The rays through the centres of pixels that meet something, row by row from the top.
pub(crate) fn through_pixels<'a, T: Tracer + ?Sized>(
    tracer: &'a T,
    camera: &'a Camera,
    [width, height]: [u32; 2],
) -> impl IndexedParallelIterator<Item = Option<(Ray, Hit)>> + 'a {
    (0..width as usize * height as usize)
        .into_par_iter()
        .map(move |pixel| {
            let corner = UVec2::new(pixel as u32 % width, pixel as u32 / width).as_vec2();
            let ray = camera.ray(corner + 0.5, width, height);
            Some((ray, tracer.closest_hit(&ray)?))
        })
}
