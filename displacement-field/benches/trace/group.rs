//! Several objects together, as in the last column of Fig. 8: all cast, and they and the corner receive.

use std::{sync::Arc, time::Instant};

use glam::{Affine3A, Vec3};
use isophote_displacement_field::{Field, FieldParams, FieldTracer, LookUp, Object, alone};
use isophote_scene::{
    Instance, Ray, Scene, Selection, Tracer,
    sample::{Frame, Sampler, cosine_hemisphere},
};
use serde_json::json;

use crate::{
    corner::{any, difference, exact, joined, open, vertices},
    open as open_scene,
};

/// Points that receive, about: 26,444,800 rays in the paper.
const POINTS: usize = 103_300;
const RAYS: u32 = 256;
/// Points whose rays are held at once.
const PIECE: usize = 1000;

pub(crate) fn measure(names: &[String]) {
    let mut scene = Scene {
        materials: vec![isophote_scene::Material::diffuse("", Vec3::ONE)],
        ..Scene::default()
    };
    let mut objects = Vec::new();
    for (index, name) in names.iter().enumerate() {
        let mesh = Arc::new(joined(&open_scene(name)));
        let field = Field::build(
            &mesh,
            &exact(&Arc::new(alone(&scene, &mesh))),
            &FieldParams::default(),
            &|_, _| {},
        );
        let field = field.expect("a field");
        let sphere = field.sphere();
        let scale = 0.5 / sphere.radius;
        // Spheres of half a metre that touch, and stand on the floor.
        let cell = Vec3::new((index % 2) as f32 + 0.7, 0.0, (index / 2) as f32 + 0.7);
        let foot = Vec3::new(sphere.center.x, mesh.bounds().min.y, sphere.center.z);
        let place = Affine3A::from_translation(cell)
            * Affine3A::from_scale(Vec3::splat(scale))
            * Affine3A::from_translation(-foot);
        scene.instances.push(Instance::new(index as u32, place));
        scene.meshes.push(mesh);
        objects.push(Object::new(field));
    }
    let scene = Arc::new(scene);
    let fields = FieldTracer::new(&scene, &Selection::default(), objects, LookUp::Aimed);
    let (fields, exact) = (fields.expect("a tracer"), exact(&scene));
    let points = points(&scene, &fields);
    let (mut seconds, mut values) = ([0.0; 2], [Vec::new(), Vec::new()]);
    for (piece, points) in points.chunks(PIECE).enumerate() {
        let rays = rays(points, piece);
        for (which, tracer) in [&fields as &dyn Tracer, &exact].into_iter().enumerate() {
            let start = Instant::now();
            let hits = any(tracer, &rays);
            seconds[which] += start.elapsed().as_secs_f64();
            let of_points = open(&hits);
            let means = of_points
                .chunks(RAYS as usize)
                .map(|values| f64::from(values.iter().sum::<f32>()) / f64::from(RAYS));
            values[which].extend(means);
        }
    }
    let [rms, bias, constant] = difference(&values[0], &values[1]);
    let count = (points.len() * RAYS as usize) as f64;
    let report = json!({
        "scene": "together",
        "objects": names.len(),
        "triangles": scene.triangle_count(),
        "rays": count,
        "ao_rms": rms,
        "ao_bias": bias,
        "constant_rms": constant,
        "seconds": seconds[0],
        "exact_seconds": seconds[1],
        "mrays": count / seconds[0] / 1e6,
        "exact_mrays": count / seconds[1] / 1e6,
        "times": seconds[1] / seconds[0],
    });
    println!("{report}");
}

/// The corner's and the objects' vertices, lifted by what the fields may be off.
fn points(scene: &Scene, fields: &FieldTracer) -> Vec<(Vec3, Vec3)> {
    let mut points = vertices(3.0);
    let all = scene.instances.iter().flat_map(|instance| {
        let mesh = scene.mesh(instance);
        let vertices = mesh.positions.iter().zip(&mesh.normals);
        vertices.map(|(point, normal)| {
            let point = instance.transform.transform_point3(*point);
            let normal = instance.transform.transform_vector3(*normal);
            (point, normal.normalize_or(Vec3::Y))
        })
    });
    let all: Vec<(Vec3, Vec3)> = all.collect();
    let needed = POINTS - points.len();
    points.extend((0..needed).map(|index| {
        let (point, normal) = all[index * all.len() / needed];
        (point + 2.0 * fields.tolerance(point) * normal, normal)
    }));
    points
}

fn rays(points: &[(Vec3, Vec3)], piece: usize) -> Vec<Ray> {
    let of_point = |(index, (point, normal)): (usize, &(Vec3, Vec3))| {
        let frame = Frame::new(*normal);
        let (point, index) = (*point, (piece * PIECE + index) as u32);
        (0..RAYS).map(move |ray| {
            let local = cosine_hemisphere(Sampler::new(9, index, ray).get_2d(0));
            Ray::new(point, frame.to_world(local))
        })
    };
    points.iter().enumerate().flat_map(of_point).collect()
}
