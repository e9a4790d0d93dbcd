//! What is refused, how that is told, and what is allowed all the same.

use isophote_scene::{Error, LoadOptions};
use serde_json::json;

use crate::{
    loaded, message,
    support::{
        Files,
        gltf::{FLOAT, Gltf, SQUARE, UNSIGNED_INT},
    },
};

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
