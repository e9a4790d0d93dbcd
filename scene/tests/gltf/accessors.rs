//! Numbers in buffers: every type and layout of indices, vertices and views.

use glam::{Quat, Vec2, Vec3};
use serde_json::json;

use crate::{
    corners, loaded, mesh, primitive, square,
    support::{
        gltf::{
            BYTE, FLOAT, Gltf, SHORT, SQUARE, UNSIGNED_BYTE, UNSIGNED_INT, UNSIGNED_SHORT, bytes_of,
        },
        seeds,
    },
};

#[test]
fn every_index_type() {
    for (component, bytes) in [
        (UNSIGNED_BYTE, vec![0, 1, 2, 0, 2, 3]),
        (UNSIGNED_SHORT, bytes_of(&[0_u16, 1, 2, 0, 2, 3])),
        (UNSIGNED_INT, bytes_of(&[0_u32, 1, 2, 0, 2, 3])),
    ] {
        let mut gltf = Gltf::new();
        let positions = gltf.floats(&SQUARE);
        let indices = gltf.accessor(&bytes, component, "SCALAR");
        let scene = primitive(
            &mut gltf,
            json!({ "attributes": { "POSITION": positions }, "indices": indices }),
        );
        assert_eq!(corners(mesh(&scene)), square());
    }
}

#[test]
fn strips_and_fans_wind_like_lists() {
    let mut gltf = Gltf::new();
    let positions = gltf.floats(&SQUARE);
    let zigzag = gltf.indices(&[0, 1, 3, 2]);
    gltf.show(json!([
        { "attributes": { "POSITION": positions }, "indices": zigzag, "mode": 5 },
        { "attributes": { "POSITION": positions }, "mode": 6 },
        { "attributes": { "POSITION": positions }, "mode": 0 },
        { "attributes": { "POSITION": positions }, "mode": 3 }
    ]));
    let scene = loaded(&gltf.glb());
    let [a, b, c, d] = SQUARE.map(Vec3::from);
    let expected = [[a, b, d], [b, c, d], [b, c, a], [c, d, a]];
    let found = corners(mesh(&scene));
    let rotations = |[a, b, c]: [Vec3; 3]| [[a, b, c], [b, c, a], [c, a, b]];
    for (found, expected) in found.iter().zip(expected) {
        assert!(rotations(expected).contains(found), "{found:?}");
    }
    assert_eq!(found.len(), 4);
    assert!(mesh(&scene).normals.iter().all(|normal| *normal == Vec3::Z));
    assert_eq!(scene.report.warnings, ["points and lines are ignored"]);
}

#[test]
fn interleaved_vertices_and_offsets() {
    let mut gltf = Gltf::new();
    let vertices: Vec<f32> = SQUARE
        .iter()
        .flat_map(|p| [p[0], p[1], p[2], 0.0, 0.6, 0.8, p[0], p[1]])
        .collect();
    let view = gltf.view(&bytes_of(&vertices));
    gltf.set("bufferViews", view, "byteStride", json!(32));
    let mut part = |offset: usize, kind: &str| {
        gltf.add(
            "accessors",
            json!({
                "bufferView": view, "byteOffset": offset, "componentType": FLOAT, "type": kind, "count": 4
            }),
        )
    };
    let attributes = json!({ "POSITION": part(0, "VEC3"), "NORMAL": part(12, "VEC3"), "TEXCOORD_0": part(24, "VEC2") });
    let indices = gltf.indices(&[0, 1, 2, 0, 2, 3]);
    let scene = primitive(
        &mut gltf,
        json!({ "attributes": attributes, "indices": indices }),
    );
    let mesh = mesh(&scene);
    assert_eq!(corners(mesh), square());
    assert_eq!(mesh.normals, [Vec3::new(0.0, 0.6, 0.8); 4]);
    assert_eq!(mesh.uvs[0], SQUARE.map(|p| Vec2::new(p[0], p[1])));
    assert!(mesh.uvs[1].is_empty() && mesh.colors.is_empty());
}

#[test]
fn sparse_accessors_replace_values() {
    let scene = loaded(&seeds::geometry().glb());
    // The last two meshes: the square with two corners moved, and zeros with the same corners.
    let [.., over, zeros] = &scene.meshes[..] else {
        panic!("too few meshes");
    };
    let moved = [Vec3::ZERO, Vec3::X * 2.0, Vec3::new(2.0, 2.0, 0.0), Vec3::Y];
    assert_eq!(
        corners(over),
        [
            [moved[0], moved[1], moved[2]],
            [moved[0], moved[2], moved[3]]
        ]
    );
    assert_eq!(corners(zeros), [[moved[0], moved[1], moved[2]]]);
    assert_eq!(scene.report.dropped.zero_area, 1);
}

#[test]
fn integers_are_normalised_or_not() {
    let cases: [(u32, Vec<u8>, bool, [f32; 3]); 8] = [
        (BYTE, bytes_of(&[-128_i8, 127, 0]), true, [-1.0, 1.0, 0.0]),
        (
            BYTE,
            bytes_of(&[-128_i8, 127, 0]),
            false,
            [-128.0, 127.0, 0.0],
        ),
        (UNSIGNED_BYTE, vec![0, 51, 255], true, [0.0, 0.2, 1.0]),
        (UNSIGNED_BYTE, vec![0, 51, 255], false, [0.0, 51.0, 255.0]),
        (
            SHORT,
            bytes_of(&[-32768_i16, 32767, 0]),
            true,
            [-1.0, 1.0, 0.0],
        ),
        (
            SHORT,
            bytes_of(&[-300_i16, 300, 0]),
            false,
            [-300.0, 300.0, 0.0],
        ),
        (
            UNSIGNED_SHORT,
            bytes_of(&[0_u16, 13107, 65535]),
            true,
            [0.0, 0.2, 1.0],
        ),
        (
            UNSIGNED_SHORT,
            bytes_of(&[0_u16, 13107, 65535]),
            false,
            [0.0, 13107.0, 65535.0],
        ),
    ];
    for (component, corner, normalized, expected) in cases {
        let mut gltf = Gltf::new();
        // The corner under test, then two that make a triangle with it, padded to 4 bytes.
        let size = corner.len() / 3;
        let one = {
            let mut one = vec![0; size];
            one[0] = 1;
            one
        };
        let zero = vec![0; size];
        let rows = [
            corner.clone(),
            [one.clone(), zero.clone(), zero.clone()].concat(),
            [zero.clone(), one, zero.clone()].concat(),
        ];
        let bytes: Vec<u8> = rows
            .iter()
            .flat_map(|row| [row.clone(), zero.clone()].concat())
            .collect();
        let positions = gltf.accessor(&bytes, component, "VEC4");
        gltf.set("accessors", positions, "type", json!("VEC3"));
        gltf.set("accessors", positions, "normalized", json!(normalized));
        let view = gltf.json["accessors"][positions]["bufferView"]
            .as_u64()
            .unwrap();
        gltf.set("bufferViews", view as usize, "byteStride", json!(4 * size));
        let scene = primitive(
            &mut gltf,
            json!({ "attributes": { "POSITION": positions } }),
        );
        let found = mesh(&scene).positions[0];
        assert!(
            (found - Vec3::from(expected)).length() < 1e-6,
            "{found} {expected:?}"
        );
    }
}

#[test]
fn compressed_views() {
    let scene = loaded(&seeds::compressed().glb());
    let (positions, triangles) = seeds::grid();
    assert_eq!(scene.meshes.len(), 2);
    for (mesh, same) in scene
        .meshes
        .iter()
        .zip(["triangles may be turned", "a sequence is exact"])
    {
        assert_eq!(mesh.positions.len(), positions.len());
        for (found, expected) in mesh.positions.iter().zip(&positions) {
            assert!((*found - Vec3::from(*expected)).length() < 1e-5);
        }
        let normal = Vec3::new(0.6, 0.0, 0.8);
        assert!(
            mesh.normals
                .iter()
                .all(|found| (*found - normal).length() < 0.02),
            "{same}"
        );
        let ordered = |triangle: &[u32]| {
            let least = (0..3).min_by_key(|&i| triangle[i]).unwrap();
            [0, 1, 2].map(|i| triangle[(least + i) % 3])
        };
        let found: Vec<_> = mesh.triangles.iter().map(|t| ordered(t)).collect();
        let expected: Vec<_> = triangles.chunks(3).map(ordered).collect();
        assert_eq!(found, expected, "{same}");
    }
    let mut moved = scene.clone();
    moved.set_time(1.0);
    let (_, rotation, _) = moved.instances[0].transform.to_scale_rotation_translation();
    assert!(rotation.dot(Quat::from_xyzw(0.0, 0.0, 0.6, 0.8)).abs() > 0.9999);
}
