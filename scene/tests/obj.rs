//! Every feature of OBJ and MTL that is read, on files made here.
#![cfg(feature = "obj")]
#![expect(clippy::unwrap_used, reason = "a test may fail")]

mod support;

use glam::{Vec2, Vec3, Vec4};
use isophote_scene::{Alpha, Dropped, Error, LoadOptions, Scene, Wrap, area, srgb_to_linear};
use support::{Files, check::check, png, seeds};

fn loaded(files: &Files) -> Scene {
    let scene = files.load().unwrap();
    check(&scene);
    scene
}

fn text(text: &str) -> Scene {
    loaded(&Files::one("a.obj", text))
}

fn with_mtl(mtl: &str) -> Scene {
    let obj = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    loaded(
        &Files::one("a.obj", obj)
            .and("a.mtl", mtl)
            .and("a b.png", png()),
    )
}

fn total_area(scene: &Scene, mesh: usize) -> f64 {
    let mesh = &scene.meshes[mesh];
    (0..mesh.triangles.len())
        .map(|i| {
            let [a, b, c] = mesh.corners(i);
            area(a, b, c)
        })
        .sum()
}

#[test]
fn polygons_groups_and_references() {
    let scene = loaded(&seeds::obj());
    let names: Vec<_> = scene
        .instances
        .iter()
        .map(|instance| &instance.name[..])
        .collect();
    assert_eq!(names, ["square", "an L"]);
    assert_eq!(scene.meshes[0].triangles.len(), 2);
    // The L of area 5, and two triangles of half a square metre.
    assert_eq!(scene.meshes[1].triangles.len(), 4 + 2);
    assert!((total_area(&scene, 1) - 6.0).abs() < 1e-6);
    assert_eq!(
        scene.report.dropped,
        Dropped {
            out_of_range: 1,
            ..Dropped::default()
        }
    );
    // OBJ counts v from the bottom.
    let mesh = &scene.meshes[0];
    let corner = mesh
        .positions
        .iter()
        .position(|p| *p == Vec3::new(1.0, 1.0, 0.0))
        .unwrap();
    assert_eq!(mesh.uvs[0][corner], Vec2::new(1.0, 0.0));
    assert_eq!(mesh.normals[corner], Vec3::Z);
    assert_eq!(mesh.positions.len(), 4, "equal corners are one vertex");
    for part in [
        "missing.mtl",
        "'unknown'",
        "points and lines",
        "curves",
        "refer to",
        "opaque",
        "bump",
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
fn vertex_colors_are_srgb_and_may_be_missing() {
    let scene = loaded(&seeds::obj());
    let color = |position: Vec3| {
        let mesh = &scene.meshes[0];
        let vertex = mesh.positions.iter().position(|p| *p == position).unwrap();
        mesh.colors[vertex]
    };
    let half = srgb_to_linear(0.5);
    assert_eq!(color(Vec3::ZERO), Vec4::new(1.0, half, 0.0, 1.0));
    assert_eq!(color(Vec3::X), Vec4::ONE);
    assert_eq!(
        color(Vec3::new(1.0, 1.0, 0.0)),
        Vec4::new(0.0, 1.0, 0.0, 1.0)
    );
}

#[test]
fn faces_without_normals_are_flat() {
    let scene = text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\ns 1\nf 1 2 3\nf 1 4 2\n");
    let mesh = &scene.meshes[0];
    assert_eq!(
        mesh.normals,
        [Vec3::Z, Vec3::Z, Vec3::Z, Vec3::Y, Vec3::Y, Vec3::Y]
    );
}

#[test]
fn names_that_come_again_are_one_mesh() {
    let scene =
        text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no a\nf 1 2 3\ng b\nf 1 2 3\no a\nf 3 2 1\n");
    let names: Vec<_> = scene.meshes.iter().map(|mesh| &mesh.name[..]).collect();
    assert_eq!(names, ["", "a", "b"]);
    assert_eq!(scene.meshes[1].triangles.len(), 2);
}

#[test]
fn bad_numbers_cost_only_what_uses_them() {
    let scene = text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv x 0 0\nv 1\nvn 0 0 0\nvt q\nf 1/1/1 2/1/1 3/1/1\nf 1 2 4\nf 1 2 3 5\n",
    );
    assert_eq!(scene.triangle_count(), 1);
    assert_eq!(scene.report.dropped.non_finite, 3);
    assert_eq!(scene.meshes[0].normals, [Vec3::Z; 3]);
    assert_eq!(scene.meshes[0].uvs[0], [Vec2::ZERO; 3]);
}

#[test]
fn materials() {
    let scene = loaded(&seeds::obj());
    let [red, mask, unknown] = &scene.materials[..] else {
        panic!("{:?}", scene.materials);
    };
    assert_eq!(
        (&red.name[..], &mask.name[..], &unknown.name[..]),
        ("red", "mask", "unknown")
    );
    assert_eq!(red.base_color, Vec4::new(0.8, 0.1, 0.1, 1.0));
    assert_eq!(red.emissive, Vec3::new(1.0, 2.0, 3.0));
    assert_eq!((red.metallic, red.ior), (0.0, 1.3));
    // α² = 2 / (Ns + 2), α = roughness².
    assert!((red.roughness.powi(4) - 2.0 / 102.0).abs() < 1e-6);
    assert_eq!((mask.metallic, mask.roughness), (1.0, 0.3));
    assert_eq!(unknown.base_color, Vec4::new(0.8, 0.8, 0.8, 1.0));
    let texture = red.base_color_texture.unwrap();
    assert_eq!(
        scene.textures[texture.texture as usize].wrap,
        [Wrap::Clamp; 2]
    );
    // At u, v of (0.25, 0.75) from the bottom: (2·0.25 + 0.5, 3·0.75), from the top (1, −1.25).
    let found = texture.transform.transform_point2(Vec2::new(0.25, 0.25));
    assert!(
        (found - Vec2::new(1.0, 1.0 - 2.25)).length() < 1e-6,
        "{found}"
    );
}

#[test]
fn masks_become_alpha() {
    let scene = loaded(&seeds::obj());
    let mask = &scene.materials[1];
    assert_eq!(mask.alpha, Alpha::Mask { cutoff: 0.5 });
    let texture = &scene.textures[mask.base_color_texture.unwrap().texture as usize];
    assert_eq!(
        texture.level(0).2,
        [[255, 255, 255, 255], [255; 4], [255; 4], [255, 255, 255, 0]]
    );
    // A mask without alpha counts by its brightness; one of another size is scaled.
    let grey = image::GrayImage::from_raw(1, 2, vec![0, 200]).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    grey.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    let obj = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let scene = loaded(
        &Files::one("a.obj", obj)
            .and("a.mtl", "newmtl m\nmap_Kd c.png\nmap_d m.png\n")
            .and("c.png", png())
            .and("m.png", bytes.into_inner()),
    );
    let texels = scene.textures[0].level(0).2;
    assert_eq!(
        texels,
        [
            [255, 0, 0, 0],
            [0, 255, 0, 0],
            [0, 0, 255, 200],
            [255, 255, 255, 200]
        ]
    );
}

#[test]
fn what_exporters_mean() {
    let black = with_mtl("newmtl m\nKd 0 0 0\nmap_Kd a b.png\n");
    assert_eq!(black.materials[0].base_color, Vec4::ONE);
    let metal = with_mtl("newmtl m\nKd 0 0 0\nKs 0.9 0.8 0.7\nNs 1e9\n");
    assert_eq!(metal.materials[0].base_color, Vec4::new(0.9, 0.8, 0.7, 1.0));
    assert_eq!(metal.materials[0].metallic, 1.0);
    assert!(metal.materials[0].roughness < 0.05, "a mirror");
    let glow = with_mtl("newmtl m\nmap_Ke A_B.PNG\nmap_Ke .\\a B.png\n");
    assert_eq!(glow.materials[0].emissive, Vec3::ONE);
    assert!(glow.materials[0].emissive_texture.is_some());
    let strange = with_mtl("Kd 1 0 0\nnewmtl m\nKd spectral a.rfl\nKe\nNs x\nNi -3\nPr 7\n");
    assert_eq!(
        strange.materials[0].base_color,
        Vec4::new(0.8, 0.8, 0.8, 1.0)
    );
    assert_eq!(
        (strange.materials[0].ior, strange.materials[0].roughness),
        (1.0, 1.0)
    );
}

#[test]
fn missing_files_are_warnings() {
    let scene = with_mtl("newmtl m\nmap_Kd nowhere.png\n");
    assert_eq!(scene.textures.len(), 0);
    assert_eq!(scene.report.warnings.len(), 1);
    let scene = text("mtllib nowhere.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    assert_eq!(scene.triangle_count(), 1);
    assert_eq!(
        scene.report.warnings.len(),
        2,
        "{:?}",
        scene.report.warnings
    );
}

#[test]
fn other_encodings_and_line_ends() {
    let plain = "o é\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let utf16: Vec<u8> = std::iter::once(0xFEFF)
        .chain(plain.encode_utf16())
        .flat_map(u16::to_be_bytes)
        .collect();
    let latin: Vec<u8> = plain.chars().map(|c| c as u8).collect();
    for bytes in [
        utf16,
        latin,
        plain.replace('\n', "\r\n").into(),
        plain.replace('\n', "\r").into(),
    ] {
        let scene = loaded(&Files::one("a.obj", bytes));
        assert_eq!(scene.triangle_count(), 1);
        assert_eq!(scene.meshes[0].name, "é");
    }
}

#[test]
fn the_budget_holds() {
    let mut obj = String::from("v 0 0 0\nv 1 0 0\nv 0 1 0\n");
    obj.push_str(&"f 1 2 3\n".repeat(100_000));
    let options = LoadOptions {
        memory_limit: 5_000_000,
        ..LoadOptions::default()
    };
    let error = Files::one("a.obj", obj).load_with(&options).unwrap_err();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
}

#[test]
fn nothing_in_it_is_no_error() {
    for nothing in ["", "# nothing", "\0\0\0", "v", "f", "usemtl", "mtllib", "o"] {
        assert!(text(nothing).instances.is_empty(), "{nothing:?}");
    }
}
