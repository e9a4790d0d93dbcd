//! What light is computed for: points on surfaces, whether they are pixels, vertices or texels.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::{
    Camera, Hit, InstanceMask, Ray, Scene, SurfaceId, SurfacePoint, Tracer, area,
    gbuffer::through_pixels, unit_normal,
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
    /// The roles of its instance.
    pub mask: InstanceMask,
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
            Some(Receiver::new(scene, point, 0.0, index as u32))
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
            Some(Receiver::new(scene, point, areas[vertex], vertex as u32))
        };
        Self {
            points: (0..mesh.positions.len()).filter_map(receiver).collect(),
        }
    }

    /// The texels of a lightmap of `size` over the texture coordinates of set `uv_set` whose centres lie on a
    /// triangle of the instance; [`Receiver::index`] is the texel's number, row by row from the top. Where
    /// triangles overlap in the map the first counts.
    pub fn from_texels(scene: &Scene, instance: u32, uv_set: usize, size: [u32; 2]) -> Self {
        let mesh = scene.mesh(&scene.instances[instance as usize]);
        let [width, height] = size;
        let mut texels: Vec<Option<Receiver>> = vec![None; width as usize * height as usize];
        if mesh.uvs[uv_set].is_empty() {
            return Self::default();
        }
        for (primitive, triangle) in mesh.triangles.iter().enumerate() {
            let scale = Vec2::new(width as f32, height as f32);
            let [a, b, c] = triangle.map(|vertex| mesh.uvs[uv_set][vertex as usize] * scale);
            let surface = SurfaceId {
                instance,
                primitive: primitive as u32,
            };
            let doubled = (b - a).perp_dot(c - a);
            if doubled == 0.0 || !doubled.is_finite() {
                continue;
            }
            let last = scale - 1.0;
            let low = (a.min(b).min(c) - 0.5)
                .ceil()
                .clamp(Vec2::ZERO, scale)
                .as_uvec2();
            let high = (a.max(b).max(c) - 0.5).floor().min(last);
            if high.min_element() < 0.0 {
                continue;
            }
            let [p, q, r] = mesh.corners(primitive).map(|corner| {
                scene.instances[instance as usize]
                    .transform
                    .transform_point3(corner)
            });
            // The world's area of one texel under this triangle's map.
            let texel_area = (area(p, q, r) / (0.5 * f64::from(doubled.abs()))) as f32;
            for y in low.y..=high.y as u32 {
                for x in low.x..=high.x as u32 {
                    let at = Vec2::new(x as f32, y as f32) + 0.5;
                    let (v, w) = (
                        (at - a).perp_dot(c - a) / doubled,
                        (b - a).perp_dot(at - a) / doubled,
                    );
                    let index = y as usize * width as usize + x as usize;
                    if v >= 0.0 && w >= 0.0 && v + w <= 1.0 && texels[index].is_none() {
                        let point = scene.point_on(surface, Vec2::new(v, w));
                        texels[index] = Some(Receiver::new(scene, point, texel_area, index as u32));
                    }
                }
            }
        }
        Self {
            points: texels.into_iter().flatten().collect(),
        }
    }
}

impl Receiver {
    fn new(scene: &Scene, point: SurfacePoint, area: f32, index: u32) -> Self {
        let mask = scene.instances[point.surface.instance as usize].mask;
        Self {
            point,
            area,
            mask,
            index,
        }
    }
}
