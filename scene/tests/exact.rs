//! The exact tracer against brute force: not one hit lost or invented, at any scale.
//!
//! `ISOPHOTE_EXACT_RAYS` sets the number of rays per scene and scale; the default is quick enough for every day.

use std::{path::PathBuf, sync::Arc};

use glam::{Affine3A, Quat, Vec2, Vec3};
use isophote_scene::{
    BruteForceTracer, BuildTracer, BvhOptions, BvhTracer, Hit, Instance, Levels, Material, Mesh,
    Ray, Scene, Selection, Tracer, builtin, load,
    sample::{Sampler, uniform_sphere},
    testing::{RayKind, rays},
};
use rayon::prelude::*;

fn count(default: usize) -> usize {
    std::env::var("ISOPHOTE_EXACT_RAYS")
        .map_or(default, |count| count.parse().expect("a number of rays"))
}

fn scaled(mut scene: Scene, scale: f32) -> Arc<Scene> {
    for instance in &mut scene.instances {
        instance.transform = Affine3A::from_scale(Vec3::splat(scale)) * instance.transform;
    }
    Arc::new(scene)
}

fn bvh(scene: &Arc<Scene>, levels: Levels) -> BvhTracer {
    BvhTracer::build(
        scene,
        &Selection::default(),
        &BvhOptions {
            levels,
            ..BvhOptions::default()
        },
    )
    .expect("has triangles")
}

/// With one level and with two: hits that one tracer has and the other has not, hits that differ in t by 10⁻⁶ of the
/// diagonal or more, and hits that differ in any bit.
fn differences(scene: &Arc<Scene>, count: usize) -> [[usize; 3]; 2] {
    let tracers = [Levels::Flat, Levels::Two].map(|levels| bvh(scene, levels));
    let brute = BruteForceTracer::build(scene, &Selection::default(), &()).expect("has triangles");
    let diagonal = scene.bounds().diagonal();
    let differs = |ray: &Ray| {
        let b: Option<Hit> = brute.closest_hit(ray);
        [0, 1].map(|levels| {
            let tracer = &tracers[levels];
            let a = tracer.closest_hit(ray);
            let far = matches!((a, b), (Some(a), Some(b)) if (a.t - b.t).abs() >= 1e-6 * diagonal);
            let lost = a.is_some() != b.is_some() || tracer.any_hit(ray) != b.is_some();
            [usize::from(lost), usize::from(far), usize::from(a != b)]
        })
    };
    let sum = |a: [[usize; 3]; 2], b: [[usize; 3]; 2]| {
        [0, 1].map(|levels| [0, 1, 2].map(|what| a[levels][what] + b[levels][what]))
    };
    let kinds = RayKind::ALL.len();
    RayKind::ALL
        .into_iter()
        .flat_map(|kind| rays(scene, kind, count.div_ceil(kinds), 7))
        .collect::<Vec<_>>()
        .par_iter()
        .map(differs)
        .reduce(|| [[0; 3]; 2], sum)
}

/// Many copies of a scene, turned, mirrored, stretched and moved.
fn crowd(scene: &Scene) -> Scene {
    let mut crowd = scene.clone();
    crowd.instances.clear();
    for index in 0..64 {
        let sampler = Sampler::new(3, 0, index);
        let angle = std::f32::consts::TAU * sampler.get_1d(0);
        let mirror = if index % 3 == 0 { -1.0 } else { 1.0 };
        let place = Affine3A::from_scale_rotation_translation(
            Vec3::new(mirror, 1.0, 1.0) * (0.2 + sampler.get_2d(1).extend(sampler.get_1d(2))),
            Quat::from_axis_angle(uniform_sphere(sampler.get_2d(3)), angle),
            4.0 * sampler.get_2d(4).extend(sampler.get_1d(5)),
        );
        let copies = scene.instances.iter().map(|instance| Instance {
            transform: place * instance.transform,
            ..instance.clone()
        });
        crowd.instances.extend(copies);
    }
    crowd
}

#[test]
fn no_hit_is_lost_or_invented() {
    let shared = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/scenes"));
    let cornell = builtin::build("builtin:cornell").expect("is built in");
    let crowd = crowd(&cornell);
    let mut scenes = vec![
        ("builtin:cornell".to_owned(), cornell),
        ("a crowd of it".into(), crowd),
    ];
    if shared.is_dir() {
        for name in ["teapot", "lucy_10k", "office_proc"] {
            scenes.push((
                name.into(),
                load(&shared.join(format!("{name}.glb"))).expect("loads"),
            ));
        }
    } else {
        eprintln!("skipped: there is no ../shared/scenes with real scenes");
    }
    for (name, scene) in scenes {
        for scale in [1.0, 1e-3, 1e3] {
            let count = count(1200);
            let found = differences(&scaled(scene.clone(), scale), count);
            for (levels, [lost, far, bits]) in ["one level", "two levels"].into_iter().zip(found) {
                eprintln!(
                    "{name} × {scale}, {levels}: of {count} rays {lost} lost or invented, {far} far off, {bits} not the same bits"
                );
                assert_eq!([lost, far, bits], [0; 3], "{name} × {scale}, {levels}");
            }
        }
    }
}

/// A closed sphere of radius 1 with shared vertices.
fn sphere(rings: u32) -> Arc<Scene> {
    let sectors = 2 * rings;
    let mut mesh = Mesh {
        positions: vec![Vec3::Y, Vec3::NEG_Y],
        ..Mesh::default()
    };
    let vertex = |ring: u32, sector: u32| match ring {
        0 => 0,
        _ if ring == rings => 1,
        _ => 2 + (ring - 1) * sectors + sector % sectors,
    };
    for ring in 1..rings {
        for sector in 0..sectors {
            let (theta, phi) = (
                std::f32::consts::PI * ring as f32 / rings as f32,
                std::f32::consts::TAU * sector as f32 / sectors as f32,
            );
            mesh.positions.push(Vec3::new(
                theta.sin() * phi.cos(),
                theta.cos(),
                theta.sin() * phi.sin(),
            ));
        }
    }
    for ring in 0..rings {
        for sector in 0..sectors {
            let [a, b] = [vertex(ring, sector), vertex(ring, sector + 1)];
            let [c, d] = [vertex(ring + 1, sector), vertex(ring + 1, sector + 1)];
            mesh.triangles.extend(
                [[a, b, c], [b, d, c]]
                    .into_iter()
                    .filter(|t| t[0] != t[1] && t[1] != t[2]),
            );
        }
    }
    mesh.normals.clone_from(&mesh.positions);
    mesh.triangle_materials = vec![0; mesh.triangles.len()];
    assert_eq!(isophote_scene::clean(&mut mesh).total(), 0);
    Arc::new(Scene {
        meshes: vec![Arc::new(mesh)],
        materials: vec![Material::default()],
        instances: vec![Instance::new(0, Affine3A::IDENTITY)],
        ..Scene::default()
    })
}

#[test]
fn a_closed_sphere_does_not_leak() {
    let scene = sphere(40);
    does_not_leak(&scene, &bvh(&scene, Levels::Flat));
    does_not_leak(&scene, &bvh(&scene, Levels::Two));
}

fn does_not_leak(scene: &Scene, bvh: &BvhTracer) {
    let mesh = &scene.meshes[0];
    let count = count(40_000) as u32;
    let leaks = |rays: u32, target: &(dyn Fn(&Sampler) -> Vec3 + Sync)| {
        (0..rays)
            .into_par_iter()
            .filter(|&index| {
                let sampler = Sampler::new(5, 0, index);
                let origin = 0.9 * sampler.get_1d(0) * uniform_sphere(sampler.get_2d(1));
                let ray = Ray::new(origin, target(&sampler) - origin);
                bvh.closest_hit(&ray).is_none() || !bvh.any_hit(&ray)
            })
            .count()
    };
    assert_eq!(
        leaks(count, &|sampler| 2.0 * uniform_sphere(sampler.get_2d(2))),
        0,
        "random rays"
    );
    let corners = |sampler: &Sampler| {
        let triangle =
            (sampler.get_1d(2) * mesh.triangles.len() as f32) as usize % mesh.triangles.len();
        (mesh.corners(triangle), sampler.get_2d(3))
    };
    let at_vertex = |sampler: &Sampler| {
        let (corners, choice) = corners(sampler);
        corners[(choice.x * 3.0) as usize % 3]
    };
    let at_edge = |sampler: &Sampler| {
        let (corners, Vec2 { x, y }) = corners(sampler);
        let first = (x * 3.0) as usize % 3;
        corners[first].lerp(corners[(first + 1) % 3], y)
    };
    assert_eq!(leaks(count / 20, &at_vertex), 0, "rays aimed at vertices");
    assert_eq!(leaks(count / 20, &at_edge), 0, "rays aimed at edges");
}
