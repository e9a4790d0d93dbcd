//! Rays to measure tracers with, as they occur in rendering.

use std::sync::Arc;

use anyhow::{Result, ensure};
use clap::ValueEnum;
use glam::{Vec2, Vec3};
use isophote_scene::{
    Camera, LightKind, Ray, Scene, Tracer,
    sample::{Frame, Sampler, cosine_hemisphere, uniform_sphere, uniform_triangle},
};
use rayon::prelude::*;

/// What kind of rays to make.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum RayKind {
    /// Cosine-distributed, from the surfaces seen all around the camera
    Diffuse,
    /// Through the camera's pixels, row by row
    Coherent,
    /// From the surfaces seen all around the camera to the lights
    Shadow,
    /// From the surfaces seen all around the camera, almost along them
    Grazing,
}

/// How far rays start above their surface, in diagonals of the scene.
const LIFT: f32 = 1e-5;
/// The sine of the steepest grazing ray.
const GRAZING: f32 = 0.01;
/// How much of the way to a light a shadow ray goes.
const SHADOW_SHARE: f32 = 1.0 - 1e-4;

/// Makes `count` rays; the same ones for the same seed, whatever the number of threads.
pub(crate) fn make(
    kind: RayKind,
    scene: &Arc<Scene>,
    tracer: &dyn Tracer,
    camera: &Camera,
    count: usize,
    seed: u64,
) -> Result<Vec<Ray>> {
    match kind {
        RayKind::Coherent => Ok(coherent(camera, count)),
        RayKind::Diffuse => from_surfaces(scene, tracer, camera, count, seed, &|start, sampler| {
            Some(start.leave(cosine_hemisphere(sampler.get_2d(1))))
        }),
        RayKind::Grazing => from_surfaces(scene, tracer, camera, count, seed, &|start, sampler| {
            let local = cosine_hemisphere(sampler.get_2d(1));
            let along = local.truncate().normalize_or(Vec2::X);
            Some(start.leave(along.extend(GRAZING * local.z).normalize()))
        }),
        RayKind::Shadow => {
            let targets = Target::all(scene);
            ensure!(
                !targets.is_empty(),
                "the scene has no light to aim shadow rays at"
            );
            from_surfaces(scene, tracer, camera, count, seed, &|start, sampler| {
                let pick = sampler.get_1d(1) * targets.len() as f32;
                let target = &targets[(pick as usize).min(targets.len() - 1)];
                target.ray(start, sampler.get_2d(2))
            })
        }
    }
}

/// Whether shadow rays can be aimed at anything.
pub(crate) fn has_targets(scene: &Scene) -> bool {
    !Target::all(scene).is_empty()
}

fn coherent(camera: &Camera, count: usize) -> Vec<Ray> {
    let side = (count as f64).sqrt().ceil() as u32;
    (0..count as u32)
        .map(|i| Vec2::new((i % side) as f32, (i / side) as f32) + 0.5)
        .map(|at| camera.ray(at, side, side))
        .collect()
}

/// A point just above a surface and the normal on that side.
struct Start {
    origin: Vec3,
    normal: Vec3,
}

impl Start {
    /// A ray in a direction by the surface's own axes, +Z along the normal.
    fn leave(&self, local: Vec3) -> Ray {
        Ray::new(self.origin, Frame::new(self.normal).to_world(local))
    }
}

fn from_surfaces(
    scene: &Scene,
    tracer: &dyn Tracer,
    camera: &Camera,
    count: usize,
    seed: u64,
    ray: &(dyn Fn(&Start, &Sampler) -> Option<Ray> + Sync),
) -> Result<Vec<Ray>> {
    const BATCH: u32 = 1 << 16;
    let lift = LIFT * scene.bounds().diagonal();
    let attempt = |index: u32| {
        let sampler = Sampler::new(seed, 0, index);
        let look = Ray::new(camera.position(), uniform_sphere(sampler.get_2d(0)));
        let point = scene.surface_point(&tracer.closest_hit(&look)?);
        let front = point.geometric_normal.dot(look.direction) < 0.0;
        let normal = if front {
            point.geometric_normal
        } else {
            -point.geometric_normal
        };
        let origin = point.position + lift * normal;
        ray(&Start { origin, normal }, &sampler)
    };
    let mut rays = Vec::with_capacity(count);
    let mut next = 0_u32;
    while rays.len() < count {
        let batch: Vec<Ray> = (next..next + BATCH)
            .into_par_iter()
            .filter_map(attempt)
            .collect();
        // A camera outside of a small thing sees it in few directions, but not in fewer than this.
        ensure!(
            batch.len() >= 16 && next < u32::MAX - 2 * BATCH,
            "the camera '{}' sees too little around it to start rays from",
            camera.name
        );
        rays.extend(batch);
        next += BATCH;
    }
    rays.truncate(count);
    Ok(rays)
}

/// Something that gives light.
enum Target {
    Point(Vec3),
    /// Light that comes from this direction.
    Direction(Vec3),
    Triangle([Vec3; 3]),
}

impl Target {
    fn all(scene: &Scene) -> Vec<Self> {
        let mut targets: Vec<Self> = scene
            .lights
            .iter()
            .map(|light| match light.kind {
                LightKind::Directional => Self::Direction(-light.direction()),
                LightKind::Point { .. } | LightKind::Spot { .. } => Self::Point(light.position()),
            })
            .collect();
        for instance in &scene.instances {
            let mesh = scene.mesh(instance);
            for (triangle, &material) in mesh.triangle_materials.iter().enumerate() {
                if scene.materials[material as usize].is_emissive() {
                    let place = |corner| instance.transform.transform_point3(corner);
                    targets.push(Self::Triangle(mesh.corners(triangle).map(place)));
                }
            }
        }
        targets
    }

    /// None where the light is behind the surface.
    fn ray(&self, start: &Start, random: Vec2) -> Option<Ray> {
        let to = |point: Vec3| {
            let way = point - start.origin;
            let length = way.length();
            Ray::new(start.origin, way / length).until(SHADOW_SHARE * length)
        };
        let ray = match self {
            Self::Point(point) => to(*point),
            Self::Direction(direction) => Ray::new(start.origin, *direction),
            Self::Triangle([a, b, c]) => {
                let uv = uniform_triangle(random);
                to((1.0 - uv.x - uv.y) * a + uv.x * b + uv.y * c)
            }
        };
        (ray.is_valid() && ray.direction.dot(start.normal) > 0.0).then_some(ray)
    }
}
