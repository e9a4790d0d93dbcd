//! Stage 2: what the camera sees through the centres of its pixels.

use glam::{UVec2, Vec3};
use isophote_scene::{
    Camera, Scene, SurfaceMaterial, SurfacePoint, Tracer, facing, reference::Materials,
};
use rayon::prelude::*;

/// A surface in a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub(super) point: SurfacePoint,
    /// Unit, towards the viewer.
    pub(super) view: Vec3,
    pub(super) material: SurfaceMaterial,
}

impl Seen {
    pub(super) fn new(
        scene: &Scene,
        point: SurfacePoint,
        view: Vec3,
        materials: Materials,
    ) -> Self {
        let mut material = scene.surface_material(&point);
        if materials == Materials::Lambert {
            (material.metallic, material.transmission) = (0.0, 0.0);
        }
        Self {
            point,
            view,
            material,
        }
    }

    /// The shading normal on the viewer's side.
    pub(super) fn normal(&self) -> Vec3 {
        facing(self.point.shading_normal, self.view)
    }

    /// Albedo of the diffuse part; what is unlit reflects nothing.
    pub(super) fn albedo(&self) -> Vec3 {
        if self.material.unlit {
            return Vec3::ZERO;
        }
        self.material.base_color
            * (1.0 - self.material.metallic)
            * (1.0 - self.material.transmission)
    }
}

/// One surface per pixel, row by row from the top; `None` where nothing is seen.
pub(super) fn see<T: Tracer + ?Sized>(
    scene: &Scene,
    tracer: &T,
    camera: &Camera,
    [width, height]: [u32; 2],
    materials: Materials,
) -> Vec<Option<Seen>> {
    (0..width as usize * height as usize)
        .into_par_iter()
        .map(|pixel| {
            let corner = UVec2::new(pixel as u32 % width, pixel as u32 / width).as_vec2();
            let ray = camera.ray(corner + 0.5, width, height);
            let hit = tracer.closest_hit(&ray)?;
            let view = -ray.direction.normalize();
            Some(Seen::new(scene, scene.surface_point(&hit), view, materials))
        })
        .collect()
}
