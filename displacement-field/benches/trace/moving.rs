//! Many instances that all move in every frame.

use std::{sync::Arc, time::Instant};

use glam::{Affine3A, Quat, Vec3};
use isophote_displacement_field::{
    Field, FieldParams, FieldTracer, LookUp, Object, Positions, alone,
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Instance, Levels, Mesh, Ray, Scene, Selection, Tracer,
    sample::{Frame, Sampler, cosine_hemisphere},
};
use rayon::prelude::*;
use serde_json::json;

use crate::{
    corner::{exact, joined},
    open,
};

const POINTS: usize = 100_000;
/// Rays of a point.
const RAYS: u32 = 16;
const FRAMES: usize = 3;

/// Where an instance is in a frame: it drifts and turns.
fn place(index: usize, frame: usize, count: usize, scale: f32, center: Vec3) -> Affine3A {
    let sampler = Sampler::new(7, 0, index as u32);
    let (a, b) = (sampler.get_2d(0), sampler.get_2d(1));
    let width = (count as f32).cbrt() * 2.5;
    let speed = Vec3::new(b.x - 0.5, 0.0, b.y - 0.5) * 0.2;
    let position = Vec3::new(a.x, 0.3 * sampler.get_1d(2), a.y) * width + speed * frame as f32;
    let turn = Quat::from_rotation_y(std::f32::consts::TAU * b.x + 0.1 * frame as f32);
    Affine3A::from_scale_rotation_translation(Vec3::splat(scale), turn, position)
        * Affine3A::from_translation(-center)
}

pub(crate) fn measure(instances: usize, names: &[String]) {
    let meshes: Vec<Arc<Mesh>> = names
        .iter()
        .map(|name| Arc::new(joined(&open(name))))
        .collect();
    assert!(!meshes.is_empty(), "--moving needs scenes");
    let mut scene = Scene {
        meshes: meshes.clone(),
        materials: vec![isophote_scene::Material::diffuse("", Vec3::ONE)],
        ..Scene::default()
    };
    let start = Instant::now();
    let fields: Vec<Field> = meshes
        .iter()
        .map(|mesh| {
            let alone = Arc::new(alone(&scene, mesh));
            let params = FieldParams {
                positions: Positions::Slater { rings: 32 },
                ..FieldParams::default()
            };
            Field::build(mesh, &exact(&alone), &params, &|_, _| {}).expect("a field")
        })
        .collect();
    let field_seconds = start.elapsed().as_secs_f64();
    // Spheres of half a metre.
    let spheres: Vec<_> = fields.iter().map(Field::sphere).collect();
    let transforms = |frame: usize| -> Vec<Affine3A> {
        (0..instances)
            .map(|index| {
                let sphere = spheres[index % spheres.len()];
                place(index, frame, instances, 0.5 / sphere.radius, sphere.center)
            })
            .collect()
    };
    scene.instances = transforms(0)
        .into_iter()
        .enumerate()
        .map(|(index, place)| Instance::new((index % meshes.len()) as u32, place))
        .collect();
    let scene = Arc::new(scene);
    let objects: Vec<Object> = fields
        .into_iter()
        .map(|field| Object::new(field).with_distant())
        .collect();
    let mut field =
        FieldTracer::new(&scene, &Selection::default(), objects, LookUp::Aimed).expect("a tracer");
    let two = BvhOptions {
        levels: Levels::Two,
        ..BvhOptions::default()
    };
    let mut exact = BvhTracer::build(&scene, &Selection::default(), &two).expect("a tracer");
    let rays = rays(&scene, instances);
    let mut seconds = [[0.0; 2]; 2];
    let mut shares = [0.0; 2];
    for frame in 1..=FRAMES {
        let transforms = transforms(frame);
        let start = Instant::now();
        field.update(&transforms).expect("transforms");
        seconds[0][0] += start.elapsed().as_secs_f64();
        let start = Instant::now();
        exact.update(&transforms).expect("transforms");
        seconds[1][0] += start.elapsed().as_secs_f64();
        for (which, tracer) in [&field as &dyn Tracer, &exact].into_iter().enumerate() {
            let start = Instant::now();
            shares[which] += share(tracer, &rays);
            seconds[which][1] += start.elapsed().as_secs_f64();
        }
    }
    let frames = FRAMES as f64;
    let report = json!({
        "instances": instances,
        "meshes": meshes.len(),
        "triangles": scene.triangle_count(),
        "points": POINTS,
        "rays": rays.len(),
        "threads": rayon::current_num_threads(),
        "field_build_seconds": field_seconds,
        "update_seconds": seconds[0][0] / frames,
        "trace_seconds": seconds[0][1] / frames,
        "exact_update_seconds": seconds[1][0] / frames,
        "exact_trace_seconds": seconds[1][1] / frames,
        "occluded": shares[0] / frames,
        "exact_occluded": shares[1] / frames,
        "bytes": field.bytes(),
        "exact_bytes": exact.bytes(),
    });
    println!("{report}");
}

/// From points of a floor under everything.
fn rays(scene: &Scene, instances: usize) -> Vec<Ray> {
    let width = (instances as f32).cbrt() * 2.5;
    let floor = scene.bounds().min.y;
    (0..POINTS as u32)
        .flat_map(|point| {
            let at = Sampler::new(3, 0, point).get_2d(0) * width;
            (0..RAYS).map(move |ray| {
                let local = cosine_hemisphere(Sampler::new(5, point, ray).get_2d(0));
                Ray::new(
                    Vec3::new(at.x, floor, at.y),
                    Frame::new(Vec3::Y).to_world(local),
                )
            })
        })
        .collect()
}

/// The share of rays that hit, by all threads.
fn share(tracer: &dyn Tracer, rays: &[Ray]) -> f64 {
    let hits: usize = rays
        .par_chunks(4096)
        .map(|rays| {
            let mut hits = vec![false; rays.len()];
            tracer.any_hits(rays, &mut hits);
            hits.iter().filter(|hit| **hit).count()
        })
        .sum();
    hits as f64 / rays.len() as f64
}
