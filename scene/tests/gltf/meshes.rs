//! Primitives become triangles: normals, colours, and what is dropped.

use glam::{Vec2, Vec3, Vec4};
use isophote_scene::Dropped;
use serde_json::json;

use crate::{
    corners, loaded, mesh, primitive,
    support::gltf::{Gltf, SQUARE, UNSIGNED_BYTE, UNSIGNED_SHORT, bytes_of},
};

#[test]
fn missing_normals_are_flat() {
    let mut gltf = Gltf::new();
    let positions = gltf.floats(&[
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ]);
    let indices = gltf.indices(&[0, 1, 2, 0, 3, 1]);
    let scene = primitive(
        &mut gltf,
        json!({ "attributes": { "POSITION": positions }, "indices": indices }),
    );
    let mesh = mesh(&scene);
    assert_eq!(
        mesh.positions.len(),
        6,
        "no vertex is shared between flat triangles"
    );
    assert_eq!(
        mesh.normals,
        [Vec3::Z, Vec3::Z, Vec3::Z, Vec3::Y, Vec3::Y, Vec3::Y]
    );
}

#[test]
fn vertex_colors_of_every_type() {
    let expected = [
        Vec4::new(1.0, 0.0, 0.2, 1.0),
        Vec4::new(0.0, 1.0, 0.6, 1.0),
        Vec4::ONE,
    ];
    let floats = [[1.0_f32, 0.0, 0.2], [0.0, 1.0, 0.6], [7.0, 1.0, f32::NAN]];
    let colors = |gltf: &mut Gltf, case: usize| match case {
        0 => gltf.floats(&floats),
        1 => gltf.accessor(
            &[255, 0, 51, 255, 0, 255, 153, 255, 255, 255, 255, 255],
            UNSIGNED_BYTE,
            "VEC4",
        ),
        _ => gltf.accessor(
            &bytes_of(&[
                65535_u16, 0, 13107, 65535, 0, 65535, 39321, 65535, 65535, 65535, 65535, 65535,
            ]),
            UNSIGNED_SHORT,
            "VEC4",
        ),
    };
    for case in 0..3 {
        let mut gltf = Gltf::new();
        let positions = gltf.floats(&SQUARE[..3]);
        let colors = colors(&mut gltf, case);
        gltf.set("accessors", colors, "normalized", json!(case > 0));
        let scene = primitive(
            &mut gltf,
            json!({ "attributes": { "POSITION": positions, "COLOR_0": colors } }),
        );
        for (found, expected) in mesh(&scene).colors.iter().zip(expected) {
            assert!((*found - expected).length() < 1e-6, "{case}: {found}");
        }
    }
}

#[test]
fn primitives_of_a_mesh_share_it() {
    let mut gltf = Gltf::new();
    let red = gltf.add("materials", json!({ "name": "red" }));
    let positions = gltf.floats(&SQUARE);
    let normals = gltf.floats(&[[0.0, 0.0, 1.0]; 4]);
    let uvs = gltf.floats(&[[0.5, 0.5]; 4]);
    let indices = gltf.indices(&[0, 1, 2]);
    gltf.show(json!([
        { "attributes": { "POSITION": positions }, "indices": indices },
        { "attributes": { "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs },
          "indices": indices, "material": red }
    ]));
    let scene = loaded(&gltf.glb());
    let mesh = mesh(&scene);
    assert_eq!(mesh.triangle_materials, [0, 1]);
    assert_eq!(
        [&scene.materials[0].name[..], &scene.materials[1].name[..]],
        ["", "red"]
    );
    // Of the second, only the vertices that are used were taken.
    assert_eq!(mesh.positions.len(), 6);
    assert_eq!(mesh.uvs[0][..3], [Vec2::ZERO; 3]);
    assert_eq!(mesh.uvs[0][3..], [Vec2::splat(0.5); 3]);
    assert_eq!(corners(mesh)[0], corners(mesh)[1]);
}

#[test]
fn dropped_triangles_are_counted() {
    let mut gltf = Gltf::new();
    let mut corners = SQUARE.to_vec();
    corners.push([f32::NAN, 0.0, 0.0]);
    let positions = gltf.floats(&corners);
    let indices = gltf.indices(&[0, 1, 2, 0, 1, 4, 0, 1, 1, 0, 1, 9, 0, 2, 3, 1]);
    let scene = primitive(
        &mut gltf,
        json!({ "attributes": { "POSITION": positions }, "indices": indices }),
    );
    let expected = Dropped {
        out_of_range: 1,
        non_finite: 1,
        zero_area: 1,
    };
    assert_eq!(scene.report.dropped, expected);
    assert_eq!(scene.triangle_count(), 2);
}
