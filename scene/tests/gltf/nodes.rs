//! The hierarchy and what hangs on it: scenes, cameras, lights, animations.

use glam::{Affine3A, Quat, Vec2, Vec3};
use isophote_scene::{InstanceMask, LightKind, LoadOptions, Projection};
use serde_json::json;

use crate::{
    loaded,
    support::{gltf::Gltf, seeds},
};

#[test]
fn hierarchy_matrices_and_mirrors() {
    let mut gltf = Gltf::new();
    let shown = gltf.square();
    let mesh = gltf.json["nodes"][shown]["mesh"].clone();
    let child = gltf.add(
        "nodes",
        json!({
            "name": "child", "mesh": mesh, "translation": [1, 0, 0], "rotation": [0, 0, 2, 2], "scale": [1, 1, -1]
        }),
    );
    // The columns of a matrix that doubles and moves.
    gltf.node(json!({
        "children": [child], "matrix": [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 3, 0, 1]
    }));
    gltf.node(json!({ "mesh": mesh, "scale": [0, 1, 1], "name": "flat" }));
    let scene = loaded(&gltf.glb());
    assert_eq!(scene.meshes.len(), 1);
    assert_eq!(scene.instances.len(), 2);
    let child = &scene.instances[1];
    assert_eq!(child.name, "child");
    // (1, 0, 1) → scaled (1, 0, −1) → a quarter turn about z (0, 1, −1) → moved (1, 1, −1) → (2, 5, −2).
    let found = child.transform.transform_point3(Vec3::new(1.0, 0.0, 1.0));
    assert!(
        (found - Vec3::new(2.0, 5.0, -2.0)).length() < 1e-6,
        "{found}"
    );
    assert!(child.transform.matrix3.determinant() < 0.0);
    assert_eq!(child.mask, InstanceMask::ALL);
    assert_eq!(
        scene.report.warnings.len(),
        1,
        "{:?}",
        scene.report.warnings
    );
    assert!(scene.report.warnings[0].contains("'flat'"));
}

#[test]
fn scenes_are_chosen_by_name_or_number() {
    let mut gltf = Gltf::new();
    let first = gltf.square();
    let mesh = gltf.json["nodes"][first]["mesh"].clone();
    let second = gltf.add("nodes", json!({ "mesh": mesh, "name": "second" }));
    gltf.add(
        "scenes",
        json!({ "name": "other", "nodes": [first, second] }),
    );
    gltf.add("scenes", json!({ "name": "empty" }));
    let instances = |scene: Option<&str>| {
        let options = LoadOptions {
            scene: scene.map(str::to_owned),
            ..LoadOptions::default()
        };
        let scene = gltf.glb().load_with(&options);
        scene.map(|scene| scene.instances.len())
    };
    assert_eq!(instances(None).unwrap(), 1);
    assert_eq!(instances(Some("other")).unwrap(), 2);
    assert_eq!(instances(Some("1")).unwrap(), 2);
    assert_eq!(instances(Some("2")).unwrap(), 0);
    assert!(
        instances(Some("3"))
            .unwrap_err()
            .to_string()
            .contains("no scene '3'")
    );
}

#[test]
fn cameras_and_lights() {
    let scene = loaded(&seeds::scene().glb());
    let names: Vec<_> = scene
        .cameras
        .iter()
        .map(|camera| &camera.name[..])
        .collect();
    assert_eq!(names, ["eye", "plan"]);
    assert_eq!(
        scene.cameras[0].projection,
        Projection::Perspective { yfov: 0.8 }
    );
    assert_eq!(scene.cameras[0].position(), Vec3::Z * 5.0);
    assert_eq!(
        scene.cameras[1].projection,
        Projection::Orthographic { half_height: 1.5 }
    );
    // The matrix turns −z to −y.
    let ray = scene.cameras[1].ray(Vec2::splat(50.0), 100, 100);
    assert!(
        (ray.direction - Vec3::NEG_Y).length() < 1e-6,
        "{}",
        ray.direction
    );
    let [bulb, spot, sun] = &scene.lights[..] else {
        panic!("{:?}", scene.lights);
    };
    assert_eq!(
        (&bulb.name[..], bulb.kind),
        ("bulb", LightKind::Point { radius: 0.0 })
    );
    assert_eq!(bulb.intensity, Vec3::new(7.0, 3.5, 0.0));
    assert_eq!(
        spot.kind,
        LightKind::Spot {
            inner: 0.2,
            outer: 0.6
        }
    );
    assert_eq!((&spot.name[..], spot.intensity), ("light 1", Vec3::ONE));
    assert_eq!(spot.position(), Vec3::Y);
    assert_eq!(
        (sun.kind, sun.intensity),
        (LightKind::Directional, Vec3::splat(3.0))
    );
    assert_eq!(sun.direction(), Vec3::NEG_Z);
}

#[test]
fn animations_move_nodes_and_what_hangs_on_them() {
    let mut scene = loaded(&seeds::scene().glb());
    let [fixed, moving] = &scene.instances[..] else {
        panic!("{:?}", scene.instances);
    };
    assert_eq!((fixed.node, fixed.mask), (None, InstanceMask::ALL));
    assert_eq!(moving.mask, InstanceMask::ALL.without(InstanceMask::STATIC));
    assert!(moving.node.is_some());
    let rest = moving.transform;
    assert_eq!(
        Vec3::from(rest.translation),
        Vec3::new(1.0, 2.0, 3.0),
        "the pose of the file"
    );
    let fixed = fixed.transform;
    assert_eq!(scene.animation.duration(), 2.0);
    scene.set_time(1.0);
    assert_eq!(scene.instances[0].transform, fixed);
    // At a key, a cubic spline goes through its value, the middle of three: 1.4.
    let turned = Affine3A::from_scale_rotation_translation(
        Vec3::splat(1.4),
        Quat::from_rotation_z(std::f32::consts::FRAC_PI_2),
        Vec3::X,
    );
    let found = scene.instances[1].transform;
    assert!(found.abs_diff_eq(turned, 1e-4), "{found:?} {turned:?}");
    scene.set_time(1.5);
    let found = scene.instances[1].transform;
    assert!((Vec3::from(found.translation) - Vec3::new(1.0, 0.5, 0.0)).length() < 1e-5);
    let (_, rotation, _) = found.to_scale_rotation_translation();
    let expected = Quat::from_rotation_z(0.75 * std::f32::consts::PI);
    assert!(rotation.dot(expected).abs() > 0.9999, "{rotation}");
    let twice = "several animations move the same node";
    assert!(
        scene
            .report
            .warnings
            .iter()
            .any(|line| line.contains(twice))
    );
}

#[test]
fn deep_hierarchies_do_not_exhaust_the_stack() {
    let mut gltf = Gltf::new();
    gltf.node(json!({ "children": [1] }));
    for child in 2..100_000 {
        gltf.add("nodes", json!({ "children": [child] }));
    }
    gltf.add("nodes", json!({ "name": "deepest" }));
    let scene = loaded(&gltf.glb());
    assert_eq!(scene.animation.nodes.len(), 100_000);
}
