//! What light is computed for: points on surfaces, whether they are pixels, vertices or texels.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::{
    Camera, Hit, Ray, Scene, SurfaceId, SurfacePoint, Tracer, area, gbuffer::through_pixels,
    unit_normal,
};

/// Points that receive light. A technique that computes light for receivers can render and bake.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Receivers {
    /// The points.
    pub points: Vec<Receiver>,
}

/// A point that receives light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// Where it is, its normals and its material.
    pub point: SurfacePoint,
    /// The surface area it stands for, square metres; 0 where it stands for a pixel.
    pub area: f32,
    /// Which pixel, vertex or texel it is, in the order that made it.
    pub index: u32,
}

impl Receivers {
    /// What a camera sees through the centres of its pixels, row by row; pixels that see nothing have no receiver,
    /// and [`Receiver::index`] is the pixel's number.
    pub fn from_camera<T: Tracer + ?Sized>(
        scene: &Scene,
        tracer: &T,
        camera: &Camera,
        size: [u32; 2],
    ) -> Self {
        let receiver = |(index, found): (usize, Option<(Ray, Hit)>)| {
            let (_, hit) = found?;
            let point = scene.surface_point(&hit);
            Some(Receiver {
                point,
                area: 0.0,
                index: index as u32,
            })
        };
        let found = through_pixels(tracer, camera, size).enumerate();
        Self {
            points: found.filter_map(receiver).collect(),
        }
    }

    /// The vertices of an instance that belong to a triangle. A vertex stands for a third of the area of each of
    /// its triangles; its geometric normal is their mean by area.
    pub fn from_vertices(scene: &Scene, instance: u32) -> Self {
        let placed = &scene.instances[instance as usize];
        let mesh = scene.mesh(placed);
        let mut areas = vec![0.0; mesh.positions.len()];
        let mut normals = vec![Vec3::ZERO; mesh.positions.len()];
        let mut first = vec![None; mesh.positions.len()];
        let facing = placed.transform.matrix3.determinant().signum();
        for (primitive, triangle) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = mesh
                .corners(primitive)
                .map(|corner| placed.transform.transform_point3(corner));
            let weight = area(a, b, c) as f32;
            for (corner, &vertex) in triangle.iter().enumerate() {
                areas[vertex as usize] += weight / 3.0;
                normals[vertex as usize] += facing * weight * unit_normal(a, b, c);
                first[vertex as usize].get_or_insert((primitive, corner));
            }
        }
        let receiver = |vertex: usize| {
            let (primitive, corner) = first[vertex]?;
            let surface = SurfaceId {
                instance,
                primitive: primitive as u32,
            };
            let uv = [Vec2::ZERO, Vec2::X, Vec2::Y][corner];
            let mut point = scene.point_on(surface, uv);
            point.geometric_normal = normals[vertex]
                .try_normalize()
                .unwrap_or(point.geometric_normal);
            Some(Receiver {
                point,
                area: areas[vertex],
                index: vertex as u32,
            })
        };
        Self {
            points: (0..mesh.positions.len()).filter_map(receiver).collect(),
        }
    }
}
