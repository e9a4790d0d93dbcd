//! Every feature of glTF that is read, on files made here.
#![cfg(feature = "gltf")]
#![expect(clippy::unwrap_used, reason = "a test may fail")]

mod support;

use glam::{Affine3A, Quat, Vec2, Vec3, Vec4};
use isophote_scene::{
    Alpha, ColorSpace, Dropped, Error, Filter, InstanceMask, LightKind, LoadOptions, Mesh,
    Projection, Scene, Wrap,
};
use serde_json::json;
use support::{
    Files,
    check::check,
    gltf::{
        BYTE, FLOAT, Gltf, SHORT, SQUARE, UNSIGNED_BYTE, UNSIGNED_INT, UNSIGNED_SHORT, bytes_of,
    },
    png, seeds,
};

fn loaded(files: &Files) -> Scene {
    let scene = files.load().unwrap();
    check(&scene);
    scene
}

/// The only mesh of a scene.
fn mesh(scene: &Scene) -> &Mesh {
    assert_eq!(scene.meshes.len(), 1);
    &scene.meshes[0]
}

/// The corners of all triangles of a mesh.
fn corners(mesh: &Mesh) -> Vec<[Vec3; 3]> {
    (0..mesh.triangles.len()).map(|i| mesh.corners(i)).collect()
}

/// The two triangles of [`SQUARE`].
fn square() -> Vec<[Vec3; 3]> {
    let [a, b, c, d] = SQUARE.map(Vec3::from);
    vec![[a, b, c], [a, c, d]]
}

/// A file with one primitive of these attributes, and what it loads as.
fn primitive(gltf: &mut Gltf, primitive: serde_json::Value) -> Scene {
    gltf.show(json!([primitive]));
    loaded(&gltf.glb())
}

fn message(files: &Files) -> String {
    files.load().unwrap_err().to_string()
}

#[test]
fn binary_embedded_and_external_files_are_the_same() {
    let gltf = seeds::geometry();
    let [binary, embedded, external] =
        [gltf.glb(), gltf.embedded(), gltf.external()].map(|files| loaded(&files));
    assert_eq!(binary.meshes, embedded.meshes);
    assert_eq!(binary.meshes, external.meshes);
    assert_eq!(binary.instances, external.instances);
    let mut misnamed = gltf.glb();
    misnamed.0[0].0 = "scene.gltf".into();
    assert_eq!(loaded(&misnamed).meshes, binary.meshes);
}

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
fn materials_with_all_their_extensions() {
    let scene = loaded(&seeds::scene().glb());
    let [all, unlit] = &scene.materials[..] else {
        panic!("{:?}", scene.materials);
    };
    assert_eq!(all.name, "all");
    assert_eq!(all.base_color, Vec4::new(0.5, 0.6, 0.7, 1.0));
    assert_eq!((all.metallic, all.roughness), (0.5, 0.25));
    assert_eq!(all.emissive, Vec3::new(4.0, 2.0, 0.0));
    assert_eq!(all.alpha, Alpha::Mask { cutoff: 0.25 });
    assert_eq!((all.transmission, all.ior), (0.5, 1.33));
    assert!(!all.unlit && unlit.unlit && unlit.alpha == Alpha::Opaque);
    assert_eq!(all.emissive_texture, None, "its image is missing");
    // v points down, so a counter-clockwise turn takes +u towards −v.
    let texture = all.base_color_texture.unwrap();
    assert_eq!(texture.uv_set, 1);
    let found = texture.transform.transform_point2(Vec2::X);
    let expected = Vec2::new(0.1 + 2.0 * 0.5_f32.cos(), 0.2 - 2.0 * 0.5_f32.sin());
    assert!((found - expected).length() < 1e-6, "{found}");
    for part in [
        "normal maps",
        "occlusion maps",
        "missing.png",
        "BLEND",
        "X_unknown",
        "skins",
        "morph",
    ] {
        let warnings = &scene.report.warnings;
        assert_eq!(
            warnings.iter().filter(|line| line.contains(part)).count(),
            1,
            "{part} {warnings:?}"
        );
    }
}

#[test]
fn textures_know_their_color_space_wrap_and_filter() {
    let scene = loaded(&seeds::scene().glb());
    let material = &scene.materials[0];
    let texture = |reference: Option<isophote_scene::TextureRef>| {
        scene.textures[reference.unwrap().texture as usize].clone()
    };
    let color = texture(material.base_color_texture);
    assert_eq!(color.color_space, ColorSpace::Srgb);
    assert_eq!(color.size(), [2, 2]);
    assert_eq!(color.wrap, [Wrap::Clamp, Wrap::Mirror]);
    assert_eq!(color.filter, Filter::Nearest);
    assert_eq!(color.level(0).2[3], [255, 255, 255, 0]);
    let roughness = texture(material.metallic_roughness_texture);
    assert_eq!(roughness.color_space, ColorSpace::Linear);
    assert_eq!(
        material.metallic_roughness_texture,
        material
            .transmission_texture
            .map(|t| { isophote_scene::TextureRef { uv_set: 1, ..t } })
    );
    assert_eq!(scene.textures.len(), 2, "one image in two colour spaces");
}

#[test]
fn images_of_every_kind() {
    use image::{DynamicImage, ImageFormat};
    let rgb = DynamicImage::ImageRgba8(image::load_from_memory(&png()).unwrap().to_rgba8());
    let images = [
        (rgb.clone(), ImageFormat::WebP),
        (rgb.clone(), ImageFormat::Bmp),
        (rgb.clone(), ImageFormat::Tga),
        (rgb.clone(), ImageFormat::Gif),
        (DynamicImage::ImageRgba16(rgb.to_rgba16()), ImageFormat::Png),
        (DynamicImage::ImageLuma16(rgb.to_luma16()), ImageFormat::Png),
        (
            DynamicImage::ImageLumaA8(rgb.to_luma_alpha8()),
            ImageFormat::Png,
        ),
        (DynamicImage::ImageRgb8(rgb.to_rgb8()), ImageFormat::Jpeg),
    ];
    for (image, format) in images {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        let mut gltf = Gltf::new();
        gltf.add("images", json!({ "uri": "texture.tga" }));
        gltf.add("textures", json!({ "source": 0 }));
        gltf.add(
            "materials",
            json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }),
        );
        let shown = gltf.square();
        let mesh = gltf.json["nodes"][shown]["mesh"].as_u64().unwrap() as usize;
        gltf.json["meshes"][mesh]["primitives"][0]["material"] = json!(0);
        let scene = loaded(&gltf.glb().and("texture.tga", bytes.into_inner()));
        assert_eq!(scene.report.warnings, [""; 0], "{format:?}");
        assert_eq!(scene.textures[0].size(), [2, 2]);
        let [grey, ..] = image.to_rgba8().into_raw()[..] else {
            panic!("no pixels");
        };
        let found = scene.textures[0].level(0).2[0][0];
        assert!(
            found.abs_diff(grey) <= 1 || format == ImageFormat::Jpeg,
            "{format:?} {found} {grey}"
        );
    }
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
fn instances_rest_and_move() {
    let mut scene = loaded(&seeds::instanced().glb());
    assert_eq!((scene.meshes.len(), scene.instances.len()), (1, 4));
    // (1, 0, 0), doubled, turned half around z and moved by 5 along x.
    let far = |scene: &Scene, instance: usize| {
        let transform = scene.instances[instance].transform;
        transform.transform_point3(Vec3::X)
    };
    assert!((far(&scene, 1) - Vec3::X * 3.0).length() < 1e-5);
    assert!((far(&scene, 3) - Vec3::X * 3.0).length() < 1e-5);
    scene.set_time(1.0);
    assert!((far(&scene, 1) - Vec3::X * 3.0).length() < 1e-5);
    assert!((far(&scene, 2) - Vec3::new(1.0, 0.0, 3.0)).length() < 1e-5);
    assert!((far(&scene, 3) - Vec3::new(3.0, 0.0, 3.0)).length() < 1e-5);
}

/// A file whose one node has instances with these attributes, which a function adds.
fn instances(attributes: impl FnOnce(&mut Gltf) -> serde_json::Value) -> Gltf {
    let mut gltf = Gltf::new();
    let node = gltf.square();
    let attributes = attributes(&mut gltf);
    let extension = json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
    gltf.set("nodes", node, "extensions", extension);
    gltf.set("nodes", node, "name", json!("grass"));
    gltf
}

#[test]
fn instances_need_one_attribute_alone_and_rotations_are_of_three_types() {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let turned = [[0.0, 0.0, half, half], [0.0, 0.0, 0.0, 1.0]];
    let of = |component: u32, bytes: Vec<u8>| {
        instances(|gltf| {
            let rotations = gltf.accessor(&bytes, component, "VEC4");
            gltf.set(
                "accessors",
                rotations,
                "normalized",
                json!(component != FLOAT),
            );
            json!({ "ROTATION": rotations, "_ID": 7 })
        })
    };
    let shorts: [i16; 8] = [0, 0, 23170, 23170, 0, 0, 0, 32767];
    let files = [
        of(FLOAT, bytes_of(turned.as_flattened())),
        of(SHORT, bytes_of(&shorts)),
        of(BYTE, bytes_of(&[0_i8, 0, 90, 90, 0, 0, 0, 127])),
    ];
    for gltf in files {
        let scene = loaded(&gltf.glb());
        assert_eq!(scene.instances.len(), 2);
        let [first, second] = [0, 1].map(|i: usize| scene.instances[i].transform);
        assert!(first.transform_point3(Vec3::X).distance(Vec3::Y) < 1e-4);
        assert_eq!(second, Affine3A::IDENTITY);
    }
    // None of them at all: nothing is multiplied. No instances: nothing is there.
    let plain = loaded(&instances(|_| json!({})).glb());
    assert_eq!(plain.instances.len(), 1);
    let none = instances(|gltf| {
        let count = gltf.floats(&[[0.0; 3]]);
        gltf.set("accessors", count, "count", json!(0));
        json!({ "SCALE": count })
    });
    assert_eq!(loaded(&none.glb()).instances.len(), 0);
}

#[test]
fn instances_that_cannot_be_placed_are_left_out() {
    let gltf = instances(|gltf| {
        let translations = gltf.floats(&[[1.0, 0.0, 0.0], [f32::NAN, 0.0, 0.0], [1e30, 0.0, 0.0]]);
        let scales = gltf.floats(&[[1.0; 3]; 3]);
        let rotations = gltf.floats(&[[0.0; 4]; 3]);
        json!({ "TRANSLATION": translations, "SCALE": scales, "ROTATION": rotations })
    });
    let scene = loaded(&gltf.glb());
    assert_eq!(scene.instances.len(), 1);
    let warnings = scene.report.warnings.join("; ");
    for part in ["'grass'", "too far away", "no valid rotation"] {
        assert!(warnings.contains(part), "{warnings}");
    }
}

#[test]
fn broken_instances_say_what_is_wrong() {
    let floats = |gltf: &mut Gltf, count: usize| gltf.floats(&vec![[1.0; 3]; count]);
    let cases = [
        (
            instances(|gltf| json!({ "TRANSLATION": floats(gltf, 3), "SCALE": floats(gltf, 2) })),
            "the instances of node 'grass' have 3 translations, no rotations and 2 scales",
        ),
        (
            instances(|gltf| json!({ "ROTATION": floats(gltf, 3) })),
            "has 3 components where 4 belong",
        ),
        (instances(|_| json!({ "SCALE": 70 })), "accessor 70"),
        (
            instances(|_| json!({ "SCALE": "big" })),
            "the attribute SCALE of instances is \"big\"",
        ),
        (
            instances(|_| json!({ "TRANSLATION": -1 })),
            "the attribute TRANSLATION of instances is -1",
        ),
        (
            instances(|gltf| {
                let small = gltf.accessor(&[1; 12], UNSIGNED_BYTE, "VEC3");
                gltf.set("accessors", small, "count", json!(4));
                json!({ "TRANSLATION": small })
            }),
            "is accessor 2, which is not of floats",
        ),
        (
            // Not normalised.
            instances(|gltf| json!({ "ROTATION": gltf.accessor(&[0, 0, 0, 127], BYTE, "VEC4") })),
            "signed bytes or shorts that are normalised",
        ),
        (
            instances(|gltf| {
                let scales = floats(gltf, 2);
                gltf.set("accessors", scales, "count", json!(4_000_000_000_u32));
                json!({ "SCALE": scales })
            }),
            "do not fit",
        ),
    ];
    for (gltf, part) in cases {
        let found = message(&gltf.glb());
        assert!(found.contains(part), "{found}");
    }
    // Without bytes of their own any number of them costs the file nothing.
    let gltf = instances(|gltf| {
        let zeros = json!({ "componentType": FLOAT, "type": "VEC3", "count": 3_000_000_000_u32 });
        json!({ "TRANSLATION": gltf.add("accessors", zeros) })
    });
    let error = gltf.glb().load().unwrap_err();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
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

#[test]
fn unsupported_extensions_name_their_remedy() {
    for (name, remedy) in [
        ("KHR_draco_mesh_compression", "without Draco"),
        ("KHR_texture_basisu", "PNG"),
        ("X_other", "without it"),
    ] {
        let mut gltf = Gltf::new();
        gltf.json["extensionsRequired"] = json!([name]);
        let error = gltf.glb().load().unwrap_err();
        assert!(matches!(&error, Error::Unsupported { feature, .. } if feature == name));
        assert!(error.to_string().contains(remedy), "{error}");
    }
}

#[test]
fn what_json_and_the_specification_allow() {
    let mut gltf = Gltf::new();
    gltf.square();
    let json = gltf.embedded().0[0].1.clone();
    let json = String::from_utf8(json)
        .unwrap()
        .replace("\"count\":4", "\"count\":4.0");
    let files = Files::one("scene.gltf", format!("\u{feff}{json}"));
    assert_eq!(loaded(&files).triangle_count(), 2);
    // A scene without nodes, an animation channel without a node, a texture without an image.
    let mut gltf = Gltf::new();
    gltf.add("scenes", json!({}));
    gltf.add("textures", json!({}));
    let channel = json!({ "sampler": 0, "target": { "path": "pointer" } });
    gltf.add(
        "animations",
        json!({ "channels": [channel], "samplers": [] }),
    );
    assert!(loaded(&gltf.glb()).instances.is_empty());
}

#[test]
fn broken_files_say_what_is_wrong() {
    let whole = || {
        let mut gltf = Gltf::new();
        gltf.square();
        gltf
    };
    let broken = |list: &str, index: usize, key: &str, value: serde_json::Value| {
        let mut gltf = whole();
        gltf.set(list, index, key, value);
        message(&gltf.glb())
    };
    for (found, part) in [
        (broken("accessors", 0, "count", json!(400)), "do not fit"),
        (
            broken("accessors", 0, "count", json!(4_000_000_000_u32)),
            "do not fit",
        ),
        (
            broken("accessors", 0, "byteOffset", json!(1e18)),
            "not valid",
        ),
        (
            broken("accessors", 0, "bufferView", json!(4_294_967_296_u64)),
            "not valid",
        ),
        (
            broken("accessors", 0, "type", json!("VEC2")),
            "2 components",
        ),
        (
            broken("accessors", 1, "componentType", json!(FLOAT)),
            "unsigned",
        ),
        (
            broken("bufferViews", 0, "byteLength", json!(9999)),
            "has only",
        ),
        (broken("bufferViews", 0, "buffer", json!(7)), "buffer 7"),
        (broken("nodes", 0, "mesh", json!(7)), "mesh 7"),
        (
            broken("nodes", 0, "children", json!([0])),
            "twice or below itself",
        ),
        (
            broken(
                "meshes",
                0,
                "primitives",
                json!([{ "attributes": { "POSITION": 0 }, "material": 3 }]),
            ),
            "material 3",
        ),
    ] {
        assert!(found.contains(part), "{found}");
    }
    let mut cut = whole().glb();
    cut.0[0].1.pop();
    assert!(message(&cut).contains("cut off"));
    let mut missing = whole().external();
    missing.0.pop();
    assert!(message(&missing).contains("'buffer 1.bin' is missing"));
    let web = whole().external().0[0].1.clone();
    let web = String::from_utf8(web)
        .unwrap()
        .replace("buffer%201.bin", "http://example.org/b.bin");
    assert!(message(&Files::one("a.gltf", web)).contains("download it"));
}

#[test]
fn no_count_is_believed() {
    let mut gltf = Gltf::new();
    let view = gltf.view(&[0; 16]);
    let huge = 4_000_000_000_u32;
    let sparse = json!({
        "count": 1, "indices": { "bufferView": view, "componentType": UNSIGNED_INT },
        "values": { "bufferView": view }
    });
    let positions = gltf.add(
        "accessors",
        json!({ "componentType": FLOAT, "type": "VEC3", "count": huge, "sparse": sparse }),
    );
    gltf.show(json!([{ "attributes": { "POSITION": positions } }]));
    let error = gltf.glb().load().unwrap_err();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
    let mut gltf = Gltf::new();
    let corner = gltf.indices(&[0; 3000]);
    let positions = gltf.floats(&SQUARE);
    let primitive = json!({ "attributes": { "POSITION": positions }, "indices": corner });
    gltf.show(json!(vec![primitive; 2_000]));
    let options = LoadOptions {
        memory_limit: 50_000_000,
        ..LoadOptions::default()
    };
    let error = gltf.glb().load_with(&options).unwrap_err();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
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
