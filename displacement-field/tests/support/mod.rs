//! Meshes, their tracers and fields.
#![expect(clippy::unwrap_used, reason = "tests")]
#![allow(dead_code, reason = "not every test needs all of it")]

use std::{f32::consts::TAU, sync::Arc};

use glam::{Affine3A, Vec3};
use isophote_displacement_field::{
    Field, FieldParams, FieldTracer, LookUp, Object, Positions, alone,
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Instance, Material, Mesh, Ray, Scene, Selection, Tracer,
    sample::{Sampler, uniform_sphere},
};

/// A grid of vertices that closes around both ways.
pub(crate) fn torus(name: &str, rings: usize, sides: usize, tube: f32) -> Arc<Mesh> {
    let mut mesh = Mesh {
        name: name.to_owned(),
        ..Mesh::default()
    };
    for index in 0..rings * sides {
        let (ring, side) = (index / sides, index % sides);
        let around = TAU * ring as f32 / rings as f32;
        let (sine, cosine) = (TAU * side as f32 / sides as f32).sin_cos();
        let out = Vec3::new(around.cos(), 0.0, around.sin());
        mesh.normals.push(cosine * out + sine * Vec3::Y);
        mesh.positions
            .push((1.0 + tube * cosine) * out + tube * sine * Vec3::Y);
        let at = |ring: usize, side: usize| (ring % rings * sides + side % sides) as u32;
        let [a, b] = [at(ring, side), at(ring + 1, side)];
        let [c, d] = [at(ring + 1, side + 1), at(ring, side + 1)];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh.triangle_materials = vec![0; mesh.triangles.len()];
    Arc::new(mesh)
}

/// A mesh of given triangles.
pub(crate) fn mesh(corners: &[[Vec3; 3]]) -> Arc<Mesh> {
    let positions: Vec<Vec3> = corners.iter().flatten().copied().collect();
    let count = corners.len() as u32;
    Arc::new(Mesh {
        name: "triangles".into(),
        normals: vec![Vec3::Y; positions.len()],
        positions,
        triangles: (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        triangle_materials: vec![0; corners.len()],
        ..Mesh::default()
    })
}

pub(crate) fn scene(mesh: &Arc<Mesh>, places: &[Affine3A]) -> Arc<Scene> {
    Arc::new(Scene {
        meshes: vec![mesh.clone()],
        materials: vec![Material::diffuse("", Vec3::ONE)],
        instances: places
            .iter()
            .map(|place| Instance::new(0, *place))
            .collect(),
        ..Scene::default()
    })
}

pub(crate) fn exact(scene: &Arc<Scene>) -> BvhTracer {
    BvhTracer::build(scene, &Selection::default(), &BvhOptions::default()).unwrap()
}

pub(crate) fn field(mesh: &Arc<Mesh>, params: &FieldParams) -> Field {
    let alone = Arc::new(alone(&scene(mesh, &[Affine3A::IDENTITY]), mesh));
    Field::build(mesh, &exact(&alone), params, &|_, _| {}).unwrap()
}

/// Coarse enough for tests.
pub(crate) fn coarse() -> FieldParams {
    FieldParams {
        positions: Positions::Slater { rings: 16 },
        ..FieldParams::default()
    }
}

pub(crate) fn placed(scene: &Arc<Scene>, field: Field, look_up: LookUp) -> FieldTracer {
    let object = Object::new(field);
    FieldTracer::new(scene, &Selection::default(), vec![object], look_up).unwrap()
}

/// Rays from within twice the sphere, everywhere.
pub(crate) fn rays(center: Vec3, radius: f32, count: u32) -> Vec<Ray> {
    (0..count)
        .map(|index| {
            let sampler = Sampler::new(11, 0, index);
            let from = uniform_sphere(sampler.get_2d(0)) * 2.0 * radius * sampler.get_1d(1);
            Ray::new(center + from, uniform_sphere(sampler.get_2d(2)))
        })
        .collect()
}

/// The share of rays that hit for one tracer and miss for the other, and the median error of t where both hit.
pub(crate) fn errors(tracer: &dyn Tracer, exact: &dyn Tracer, rays: &[Ray]) -> [f64; 2] {
    let (mut wrong, mut off) = (0, vec![0.0]);
    for ray in rays {
        match (tracer.closest_hit(ray), exact.closest_hit(ray)) {
            (Some(hit), Some(truth)) => off.push(f64::from((hit.t - truth.t).abs())),
            (None, None) => {}
            _ => wrong += 1,
        }
    }
    off.sort_by(f64::total_cmp);
    [wrong as f64 / rays.len() as f64, off[off.len() / 2]]
}
