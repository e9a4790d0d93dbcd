//! What must hold in every built-in scene.

use std::collections::{BTreeMap, HashSet};

use glam::{Vec2, Vec3};

use super::*;
use crate::{Aabb, LightKind, area, unit_normal};

/// Scene, fewest and most triangles, and the box all of it lies in.
type Expected = (&'static str, usize, usize, [f32; 3], [f32; 3]);

const SCENES: &[Expected] = &[
    ("cornell", 38, 38, [-0.001; 3], [0.557, 0.549, 0.56]),
    ("corner", 10_000, 30_000, [-0.02; 3], [4.01, 4.01, 4.01]),
    (
        "atrium",
        237_500,
        262_500,
        [-14.76, -0.32, -6.45],
        [14.76, 12.04, 6.45],
    ),
    (
        "office",
        19_000,
        23_000,
        [-3.41, -0.31, -2.91],
        [3.41, 3.11, 2.91],
    ),
    (
        "hairball:20000",
        19_900,
        20_000,
        [-4.0, 0.0, -1.61],
        [4.0, 5.01, 4.01],
    ),
    ("cave:10000", 9_500, 10_000, [-3.6; 3], [3.6; 3]),
];

fn world_triangles(scene: &Scene) -> Vec<[Vec3; 3]> {
    let mut triangles = Vec::with_capacity(scene.triangle_count());
    for instance in &scene.instances {
        let mesh = scene.mesh(instance);
        let place = |corner| instance.transform.transform_point3(corner);
        triangles.extend((0..mesh.triangles.len()).map(|i| mesh.corners(i).map(place)));
    }
    triangles
}

#[test]
fn sizes_and_bounds_are_as_documented_and_nothing_is_dropped() {
    for &(name, fewest, most, min, max) in SCENES {
        let scene = build(name).unwrap();
        assert_eq!(scene.report.dropped.total(), 0, "{name}");
        let count = scene.triangle_count();
        assert!((fewest..=most).contains(&count), "{name}: {count}");
        let allowed = Aabb {
            min: min.into(),
            max: max.into(),
        };
        let bounds = scene.bounds();
        assert_eq!(allowed.union(&bounds), allowed, "{name}: {bounds:?}");
    }
}

#[test]
fn arrays_fit_together_and_normals_agree_with_the_winding() {
    for &(name, ..) in SCENES {
        let scene = build(name).unwrap();
        for mesh in &scene.meshes {
            let label = format!("{name}, {}", mesh.name);
            assert_eq!(mesh.normals.len(), mesh.positions.len(), "{label}");
            assert_eq!(mesh.uvs[0].len(), mesh.positions.len(), "{label}");
            assert_eq!(mesh.triangle_materials.len(), mesh.triangles.len());
            let mut turned = 0;
            for (i, triangle) in mesh.triangles.iter().enumerate() {
                assert!((mesh.triangle_materials[i] as usize) < scene.materials.len());
                let [a, b, c] = mesh.corners(i);
                let face = unit_normal(a, b, c);
                let mean: Vec3 = triangle.iter().map(|&k| mesh.normals[k as usize]).sum();
                turned += usize::from(face.dot(mean) <= 0.0);
            }
            // A tube of three sides may fold over itself where a hair has a kink.
            let kinks = match mesh.name.as_str() {
                "hairball" => mesh.triangles.len() / 100,
                _ => 0,
            };
            assert!(turned <= kinks, "{label}: {turned}");
        }
        for material in &scene.materials {
            for texture in material.clone().textures_mut() {
                assert!((texture.texture as usize) < scene.textures.len(), "{name}");
            }
            assert!(material.base_color.max_element() <= 1.0, "{name}");
        }
    }
}

#[test]
fn names_are_unique() {
    let unique = |names: Vec<&String>| {
        let set: HashSet<&String> = names.iter().copied().collect();
        set.len() == names.len() && !names.iter().any(|name| name.is_empty())
    };
    for &(name, ..) in SCENES {
        let scene = build(name).unwrap();
        assert!(
            unique(scene.meshes.iter().map(|m| &m.name).collect()),
            "{name}"
        );
        assert!(unique(scene.materials.iter().map(|m| &m.name).collect()));
        assert!(unique(scene.textures.iter().map(|t| &t.name).collect()));
        assert!(unique(scene.instances.iter().map(|i| &i.name).collect()));
        assert!(unique(scene.lights.iter().map(|l| &l.name).collect()));
        assert!(unique(scene.cameras.iter().map(|c| &c.name).collect()));
        assert_eq!(scene.cameras[0].name, "camera_main");
    }
}

#[test]
fn every_build_is_the_same() {
    for &(name, ..) in SCENES {
        let (a, b) = (build(name).unwrap(), build(name).unwrap());
        assert_eq!(a.meshes, b.meshes, "{name}");
        assert_eq!(a.textures, b.textures, "{name}");
        assert_eq!(a.instances, b.instances, "{name}");
    }
}

#[test]
fn some_instances_are_shared_and_some_mirrored() {
    let mirrored = |i: &crate::Instance| i.transform.matrix3.determinant() < 0.0;
    let scene = build("corner").unwrap();
    assert!(scene.instances.len() > scene.meshes.len());
    assert!(scene.instances.iter().any(mirrored));
}

/// Where an infinite line from a point crosses the triangles: an odd number of crossings in every direction means
/// that the point is inside something solid.
fn crossings(triangles: &[[Vec3; 3]], origin: Vec3, direction: Vec3) -> usize {
    let crosses = |&[a, b, c]: &[Vec3; 3]| {
        let (e, f) = (b - a, c - a);
        let p = direction.cross(f);
        let det = e.dot(p);
        let s = origin - a;
        let (u, q) = (s.dot(p) / det, s.cross(e));
        let v = direction.dot(q) / det;
        u >= 0.0 && v >= 0.0 && u + v <= 1.0 && f.dot(q) / det > 0.0
    };
    triangles
        .iter()
        .filter(|triangle| crosses(triangle))
        .count()
}

#[test]
fn cameras_see_the_scene_and_stand_free() {
    for &(name, ..) in SCENES {
        let scene = build(name).unwrap();
        let triangles = world_triangles(&scene);
        let camera = &scene.cameras[0];
        let mut seen = 0;
        for i in 0..16 {
            let pixel = Vec2::new(10.0 * (i % 4) as f32 + 5.0, 10.0 * (i / 4) as f32 + 5.0);
            let ray = camera.ray(pixel, 40, 40);
            seen += usize::from(crossings(&triangles, ray.origin, ray.direction) > 0);
        }
        assert!(seen >= 10, "{name}: {seen} of 16");
        let distance = triangles
            .iter()
            .map(|corners| corners.map(|c| c.distance(camera.position())))
            .fold(f32::INFINITY, |d, [a, b, c]| d.min(a).min(b).min(c));
        assert!(distance > 0.02, "{name}: {distance}");
    }
}

#[test]
fn lights_shine_on_something() {
    for &(name, ..) in SCENES {
        let scene = build(name).unwrap();
        assert!(scene.has_light(), "{name}");
        let bounds = scene.bounds();
        for light in &scene.lights {
            if light.kind != LightKind::Directional {
                let at = light.position();
                assert!(at.cmpge(bounds.min).all() && at.x <= bounds.max.x, "{name}");
            }
        }
    }
}

#[test]
fn no_two_faces_lie_over_each_other_in_one_plane() {
    // Hairs cross as they happen to.
    for &(name, ..) in SCENES
        .iter()
        .filter(|scene| !scene.0.starts_with("hairball"))
    {
        let triangles = world_triangles(&build(name).unwrap());
        if let Some((a, b)) = coplanar_overlap(&triangles) {
            panic!("{name}: {a:?} and {b:?}");
        }
    }
}

/// Two triangles of one plane (to 0.05 mm and 0.1°) whose interiors overlap.
fn coplanar_overlap(triangles: &[[Vec3; 3]]) -> Option<([Vec3; 3], [Vec3; 3])> {
    // Triangles are filed by the plane's normal and offset, rounded, so that only neighbours are compared.
    let mut planes: BTreeMap<[i32; 4], Vec<usize>> = BTreeMap::new();
    for (i, &[a, b, c]) in triangles.iter().enumerate() {
        let mut normal = unit_normal(a, b, c);
        let main = normal[normal.abs().max_position()];
        normal *= main.signum();
        let n = (normal * 500.0).round().as_ivec3();
        let offset = (normal.dot(a) / 2e-4).round() as i32;
        // The rounding may part two that are close: file under both.
        for shift in 0..2 {
            planes
                .entry([n.x, n.y, n.z, (offset + shift) / 2])
                .or_default()
                .push(i);
        }
    }
    for group in planes.values_mut() {
        group.sort_by(|&a, &b| min_x(&triangles[a]).total_cmp(&min_x(&triangles[b])));
        for (k, &a) in group.iter().enumerate() {
            let reach = max_x(&triangles[a]);
            for &b in &group[k + 1..] {
                if min_x(&triangles[b]) >= reach {
                    break;
                }
                if a != b && overlap(&triangles[a], &triangles[b]) {
                    return Some((triangles[a], triangles[b]));
                }
            }
        }
    }
    None
}

/// Along a skew axis, so that no plane is seen edge on.
fn along(point: Vec3) -> f32 {
    point.dot(Vec3::new(0.803, 0.411, 0.432))
}

fn min_x(corners: &[Vec3; 3]) -> f32 {
    corners.map(along).into_iter().fold(f32::INFINITY, f32::min)
}

fn max_x(corners: &[Vec3; 3]) -> f32 {
    corners
        .map(along)
        .into_iter()
        .fold(f32::NEG_INFINITY, f32::max)
}

/// Whether two triangles of about one plane overlap by more than 0.1 mm (separating axes: their edges' normals).
fn overlap(a: &[Vec3; 3], b: &[Vec3; 3]) -> bool {
    let normal = unit_normal(a[0], a[1], a[2]);
    let other = unit_normal(b[0], b[1], b[2]);
    if normal.dot(other).abs() < 0.999_998
        || b.iter().any(|&p| (p - a[0]).dot(normal).abs() > 5e-5)
        || a.iter().any(|&p| (p - b[0]).dot(other).abs() > 5e-5)
    {
        return false;
    }
    for (p, q) in [(a, b), (b, a)] {
        for i in 0..3 {
            let edge = p[(i + 1) % 3] - p[i];
            let axis = normal.cross(edge).normalize_or_zero();
            let span = |corners: &[Vec3; 3]| {
                let along = corners.map(|c| (c - p[i]).dot(axis));
                (
                    along.into_iter().fold(f32::INFINITY, f32::min),
                    along.into_iter().fold(f32::NEG_INFINITY, f32::max),
                )
            };
            let ((low, high), (other_low, other_high)) = (span(p), span(q));
            if high.min(other_high) - low.max(other_low) < 1e-4 {
                return false;
            }
        }
    }
    true
}

#[test]
fn the_overlap_test_finds_one() {
    let a = [Vec3::ZERO, Vec3::X, Vec3::Z];
    let lift = |triangle: [Vec3; 3], by: Vec3| triangle.map(|c| c + by);
    assert!(coplanar_overlap(&[a, lift(a, Vec3::new(0.3, 0.0, 0.3))]).is_some());
    assert!(coplanar_overlap(&[a, lift(a, Vec3::new(0.3, 0.001, 0.3))]).is_none());
    assert!(coplanar_overlap(&[a, [Vec3::X, Vec3::new(1.0, 0.0, 1.0), Vec3::Z]]).is_none());
}

#[test]
fn hairball_has_the_triangles_asked_for() {
    for count in [1_000, 1_001, 5_000, 54_321, 250_000] {
        let scene = build(&format!("hairball:{count}")).unwrap();
        let made = scene.triangle_count();
        assert!(made <= count && count - made < 6, "{count}: {made}");
    }
}

#[test]
fn corner_has_the_vertices_asked_for() {
    let vertices = |spec: &str| build(spec).unwrap().meshes[0].positions.len();
    assert_eq!(vertices("corner"), 33 * 33);
    assert_eq!(vertices("builtin:corner:5"), 25);
}

#[test]
fn cornell_has_red_on_the_left_and_light_above() {
    let scene = build("cornell").unwrap();
    let camera = &scene.cameras[0];
    let mean = |color: &str| {
        let mesh = &scene.meshes[0];
        let material = scene
            .materials
            .iter()
            .position(|m| m.name == color)
            .unwrap() as u32;
        let i = mesh
            .triangle_materials
            .iter()
            .position(|&m| m == material)
            .unwrap();
        let middle = mesh.corners(i).iter().sum::<Vec3>() / 3.0;
        camera.transform.inverse().transform_point3(middle)
    };
    assert!(mean("red").x < -0.2 && mean("green").x > 0.2);
    assert!(scene.meshes[1].normals.iter().all(|n| *n == Vec3::NEG_Y));
    let lamp = (0..2).map(|i| {
        let [a, b, c] = scene.meshes[1].corners(i);
        area(a, b, c)
    });
    assert!((lamp.sum::<f64>() - 0.130 * 0.105).abs() < 1e-6);
}

#[test]
fn wrong_names_and_numbers_are_errors() {
    let message = |spec: &str| build(spec).unwrap_err().to_string();
    assert!(message("builtin:sponza").contains("cornell, corner, atrium, office, hairball"));
    assert!(message("").contains("hairball"));
    for spec in [
        "hairball:999",
        "hairball:5000001",
        "hairball:",
        "hairball:-3",
        "hairball:1e5",
        "hairball:99999999999999999999999",
        "corner:1",
        "cornell:3",
    ] {
        let error = build(spec).unwrap_err();
        assert!(matches!(error, Error::Parameter { .. }), "{spec}: {error}");
    }
    assert!(is_builtin("builtin:nothing") && !is_builtin("cornell.glb"));
}
