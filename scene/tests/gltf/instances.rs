//! Many instances at one node (`EXT_mesh_gpu_instancing`).

use glam::{Affine3A, Vec3};
use isophote_scene::{Error, Scene};
use serde_json::json;

use crate::{
    loaded, message,
    support::{
        gltf::{BYTE, FLOAT, Gltf, SHORT, UNSIGNED_BYTE, bytes_of},
        seeds,
    },
};

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
