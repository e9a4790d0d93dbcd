//! Pixels and vertices as receivers of light.

use std::sync::Arc;

use glam::{Affine3A, Quat, Vec2, Vec3};
use isophote_scene::{
    BruteForceTracer, BuildTracer, Camera, Directions, Instance, Material, Mesh, ParallelTracer,
    Receivers, Scene, Selection,
};

/// A bent sheet of 2 × 3 m in 8 × 12 quads, unwrapped over the whole of the second texture coordinates, placed
/// by a transform.
fn sheet(transform: Affine3A) -> Arc<Scene> {
    let (columns, rows) = (8_u32, 12_u32);
    let mut mesh = Mesh::default();
    for y in 0..=rows {
        for x in 0..=columns {
            let uv = Vec2::new(x as f32 / columns as f32, y as f32 / rows as f32);
            mesh.positions.push(Vec3::new(
                2.0 * uv.x,
                if uv.x > 0.5 { uv.x - 0.5 } else { 0.0 },
                3.0 * uv.y,
            ));
            mesh.normals.push(Vec3::Y);
            mesh.uvs[1].push(uv);
        }
    }
    for y in 0..rows {
        for x in 0..columns {
            let a = y * (columns + 1) + x;
            let b = a + columns + 1;
            mesh.triangles.extend([[a, b, a + 1], [a + 1, b, b + 1]]);
        }
    }
    mesh.triangle_materials = vec![0; mesh.triangles.len()];
    isophote_scene::clean(&mut mesh);
    Arc::new(Scene {
        meshes: vec![Arc::new(mesh)],
        materials: vec![Material::diffuse("sheet", Vec3::splat(0.5))],
        instances: vec![Instance::new(0, transform)],
        ..Scene::default()
    })
}

fn transforms() -> [Affine3A; 3] {
    let turned =
        Affine3A::from_rotation_translation(Quat::from_rotation_x(0.7), Vec3::new(3.0, -2.0, 5.0));
    [
        Affine3A::IDENTITY,
        turned,
        turned * Affine3A::from_scale(Vec3::new(-2.0, 1.5, 0.5)),
    ]
}

fn surface_area(scene: &Scene) -> f64 {
    let mesh = &scene.meshes[0];
    (0..mesh.triangles.len())
        .map(|triangle| {
            let [a, b, c] = mesh
                .corners(triangle)
                .map(|p| scene.instances[0].transform.transform_point3(p));
            isophote_scene::area(a, b, c)
        })
        .sum()
}

#[test]
fn vertices_share_out_the_area() {
    for transform in transforms() {
        let scene = sheet(transform);
        let receivers = Receivers::from_vertices(&scene, 0);
        assert_eq!(receivers.points.len(), scene.meshes[0].positions.len());
        let sum: f64 = receivers
            .points
            .iter()
            .map(|receiver| f64::from(receiver.area))
            .sum();
        assert!((sum / surface_area(&scene) - 1.0).abs() < 1e-5, "{sum}");
        for receiver in &receivers.points {
            let position = scene.meshes[0].positions[receiver.index as usize];
            let expected = transform.transform_point3(position);
            assert!((receiver.point.position - expected).length() < 1e-5);
            // The front of the mesh is up, whatever the transform.
            assert!(
                receiver
                    .point
                    .geometric_normal
                    .dot(receiver.point.shading_normal)
                    > 0.5
            );
        }
    }
}

#[test]
fn pixels_see_what_the_camera_sees() {
    let scene = sheet(Affine3A::IDENTITY);
    let tracer =
        BruteForceTracer::build(&scene, &Selection::default(), &()).expect("has triangles");
    let camera = Camera::look_at("", Vec3::new(1.0, 6.0, 1.5), Vec3::new(1.0, 0.0, 1.5), 0.8);
    let receivers = Receivers::from_camera(&scene, &tracer, &camera, [20, 10]);
    assert!(!receivers.points.is_empty() && receivers.points.len() < 200);
    for receiver in &receivers.points {
        let ray = camera.ray(
            Vec2::new(
                (receiver.index % 20) as f32 + 0.5,
                (receiver.index / 20) as f32 + 0.5,
            ),
            20,
            10,
        );
        let offset = receiver.point.position - ray.origin;
        assert!((offset - offset.dot(ray.direction) * ray.direction).length() < 1e-5);
    }
}

#[test]
fn any_tracer_traces_in_parallel() {
    let scene = sheet(Affine3A::IDENTITY);
    let tracer =
        BruteForceTracer::build(&scene, &Selection::default(), &()).expect("has triangles");
    let directions = Directions::new(&tracer, vec![Vec3::Y, Vec3::X]);
    assert_eq!(directions.directions(), [Vec3::Y, Vec3::X]);
    let points = [
        Vec3::new(0.5, -2.0, 1.0),
        Vec3::new(0.5, 3.0, 1.0),
        Vec3::new(9.0, 0.0, 0.0),
    ];
    let mut answers = [(0.0, 0.0); 3];
    directions.trace(0, &points, &mut answers);
    let none = f32::INFINITY;
    assert_eq!(answers, [(2.0, none), (none, 3.0), (none, none)]);
}
