//! Whether a device's ray query gives the right answers, by rays whose answers are known.

use std::sync::Arc;

use glam::{Affine3A, Vec2, Vec3, Vec4};

use super::RayQueryTracer;
use crate::{
    Alpha, Error, Hit, Instance, Material, Mesh, Ray, Result, Scene, Selection, SurfaceId,
    gpu::{Context, GpuScene, RayBatch},
};

/// Whether ray query can be used: the device supports it, and gives the right answers to a few rays against triangles of
/// which some are masked, mirrored and moved. The test runs once for a context.
///
/// # Errors
/// [`Error::Gpu`] with what is wrong.
pub fn check_ray_query(context: &Context) -> Result<()> {
    if !context
        .device()
        .features()
        .contains(wgpu::Features::EXPERIMENTAL_RAY_QUERY)
    {
        let name = context.device().adapter_info().name;
        return Err(Error::gpu(
            "ray query",
            format!("{name} does not support it; use compute-bvh"),
        ));
    }
    let outcome = context.ray_query_test(|| run(context).map_err(|error| error.to_string()));
    outcome.map_err(|reason| Error::gpu("ray query's self-test", reason))
}

/// Two triangles side by side, the left one masked away; a second instance behind is mirrored, so that its left one
/// lies on the right.
fn scene() -> Arc<Scene> {
    let left = [
        Vec3::ZERO,
        Vec3::new(-2.0, 0.0, 0.0),
        Vec3::new(0.0, 2.0, 0.0),
    ];
    let right = [
        Vec3::ZERO,
        Vec3::new(2.0, 0.0, 0.0),
        Vec3::new(0.0, 2.0, 0.0),
    ];
    let mesh = Mesh {
        positions: [left, right].concat(),
        normals: vec![Vec3::Z; 6],
        triangles: vec![[0, 1, 2], [3, 4, 5]],
        triangle_materials: vec![0, 1],
        ..Mesh::default()
    };
    let hidden = Material {
        base_color: Vec4::new(1.0, 1.0, 1.0, 0.25),
        alpha: Alpha::Mask { cutoff: 0.5 },
        ..Material::default()
    };
    let mirrored = Affine3A::from_translation(Vec3::new(0.0, 0.0, -3.0))
        * Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    Arc::new(Scene {
        meshes: vec![Arc::new(mesh)],
        materials: vec![hidden, Material::default()],
        instances: vec![
            Instance::new(0, Affine3A::IDENTITY),
            Instance::new(0, mirrored),
        ],
        ..Scene::default()
    })
}

/// Rays and what they must hit.
fn known() -> Vec<(Ray, Option<Hit>)> {
    let down = |x: f32, y: f32| Ray::new(Vec3::new(x, y, 2.0), Vec3::NEG_Z);
    let hit = |t: f32, uv: Vec2, instance: u32| {
        Some(Hit {
            t,
            uv,
            surface: SurfaceId {
                instance,
                primitive: 1,
            },
        })
    };
    vec![
        (down(0.5, 0.75), hit(2.0, Vec2::new(0.25, 0.375), 0)),
        (down(-0.5, 0.75), hit(5.0, Vec2::new(0.25, 0.375), 1)),
        (down(1.5, 1.5), None),
        (down(0.5, 0.75).until(1.75), None),
        (down(-0.5, 0.75).until(4.75), None),
        (
            Ray {
                t_min: 2.25,
                ..down(0.5, 0.75)
            },
            None,
        ),
        (
            Ray::new(Vec3::new(-0.5, 0.75, -5.0), Vec3::Z),
            hit(2.0, Vec2::new(0.25, 0.375), 1),
        ),
        (Ray::new(Vec3::new(0.5, 0.75, 2.0), Vec3::ZERO), None),
        (Ray::new(Vec3::new(f32::NAN, 0.75, 2.0), Vec3::NEG_Z), None),
    ]
}

fn run(context: &Context) -> Result<()> {
    let scene = scene();
    let gpu_scene = GpuScene::new(context, &scene)?;
    let tracer = RayQueryTracer::build_untested(context, &scene, &Selection::default())?;
    let mut batch = RayBatch::new(context, &gpu_scene, &tracer)?;
    let known = known();
    let rays: Vec<Ray> = known.iter().map(|(ray, _)| *ray).collect();
    let mut hits = vec![None; rays.len()];
    batch.closest_hits(context, &gpu_scene, &tracer, &rays, &mut hits)?;
    let mut any = vec![false; rays.len()];
    batch.any_hits(context, &gpu_scene, &tracer, &rays, &mut any)?;
    for (((ray, expected), hit), any) in known.iter().zip(&hits).zip(&any) {
        let same = match (expected, hit) {
            (Some(expected), Some(hit)) => {
                (hit.t - expected.t).abs() < 1e-4
                    && hit.uv.distance(expected.uv) < 1e-4
                    && hit.surface == expected.surface
            }
            (None, None) => true,
            _ => false,
        };
        if !same || *any != expected.is_some() {
            let reason = format!(
                "{ray:?} hits {hit:?} (any: {any}) instead of {expected:?}; use compute-bvh"
            );
            return Err(Error::gpu("tracing known rays", reason));
        }
    }
    Ok(())
}
