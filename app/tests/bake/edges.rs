//! Files that are put together in other ways, and what is refused.

use std::path::Path;

use serde_json::{Value, json};

use crate::{
    Place,
    files::{Maker, floats, parts, plate_over_floor},
    validator,
};

/// Bakes into vertices and into texels, and checks both files.
fn both(place: &Place, name: &str) -> [Value; 2] {
    place.ok(&format!("{name} --attribute _AO --samples 16 -o v.glb"));
    place.ok(&format!(
        "{name} --to texels --size 64 --samples 16 -o t.glb"
    ));
    ["v.glb", "t.glb"].map(|name| {
        validator::check(&place.path(name));
        parts(&place.path(name)).0
    })
}

fn attributes(json: &Value, mesh: usize) -> &Value {
    &json["meshes"][mesh]["primitives"][0]["attributes"]
}

/// Two floors of one mesh, one of them in the shade.
#[test]
fn nodes_that_share_a_mesh_get_light_of_their_own() {
    let mut maker = plate_over_floor();
    maker.stand(0, [100.0, 0.0, 0.0]);
    let place = Place::with("a.glb", maker.glb());
    let [vertices, texels] = both(&place, "a.glb");
    for json in [&vertices, &texels] {
        let meshes: Vec<&Value> = (0..3).map(|node| &json["nodes"][node]["mesh"]).collect();
        assert_eq!(meshes, [&json!(0), &json!(1), &json!(2)]);
    }
    let (_, bin) = parts(&place.path("v.glb"));
    let least = |mesh: usize| {
        let values = floats(&vertices, &bin, &attributes(&vertices, mesh)["_AO"]);
        values.into_iter().fold(1.0, f32::min)
    };
    assert!(
        least(0) < 0.8 && least(2) == 1.0,
        "{} {}",
        least(0),
        least(2)
    );
    // They share a place in set 1, so there is a new set; what was there stays.
    let all: Vec<&String> = attributes(&texels, 0).as_object().unwrap().keys().collect();
    assert_eq!(
        all,
        [
            "POSITION",
            "NORMAL",
            "TEXCOORD_0",
            "TEXCOORD_1",
            "TEXCOORD_2"
        ]
    );
    assert_eq!(texels["materials"][0]["occlusionTexture"]["texCoord"], 2);
}

/// A mesh that another scene of the file uses too keeps its values there.
#[test]
fn what_is_not_baked_is_not_changed() {
    let mut maker = plate_over_floor();
    let material = maker.add("materials", json!({ "name": "shared" }));
    let [floor, plate] = [0, 1].map(|mesh| maker.json["meshes"][mesh]["primitives"][0].clone());
    for mesh in 0..2 {
        maker.json["meshes"][mesh]["primitives"][0]["material"] = material.into();
    }
    let node = maker.add("nodes", json!({ "mesh": 0 }));
    maker.add("scenes", json!({ "nodes": [node] }));
    let place = Place::with("a.glb", maker.glb());
    let [vertices, texels] = both(&place, "a.glb");
    assert_eq!(attributes(&vertices, 0), &floor["attributes"]);
    assert_eq!(vertices["nodes"][0]["mesh"], 2);
    assert_eq!(attributes(&texels, 1), &plate["attributes"]);
    assert_eq!(texels["materials"][0], json!({ "name": "shared" }));
    assert_eq!(texels["meshes"][1]["primitives"][0]["material"], 1);
    assert!(texels["materials"][1].get("occlusionTexture").is_some());
}

/// A strip without normals, one without indices, a fan, sparse positions, and morph targets.
#[test]
fn primitives_of_every_kind() {
    let mut maker = Maker::new();
    let corners = [
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 0.0],
        [1.0, 0.0, 1.0],
    ];
    let ring = [
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [1.0, 0.0, 0.0],
    ];
    let square = maker.floats(&corners);
    let strip = json!({ "attributes": { "POSITION": square }, "mode": 5 });
    let around = maker.floats(&ring);
    let fan = json!({ "attributes": { "POSITION": around }, "mode": 6 });
    let order = maker.indices(&[0, 1, 2, 2, 1, 3]);
    let flat = json!({ "attributes": { "POSITION": square }, "indices": order });
    let ups = maker.floats(&[[0.0, 1.0, 0.0]; 4]);
    let moved = maker.floats(&[[0.0, 0.5, 0.0]; 4]);
    let morphed = json!({
        "attributes": { "POSITION": square, "NORMAL": ups, "_TEMPERATURE": ups },
        "indices": order,
        "targets": [{ "POSITION": moved }],
    });
    let at = maker.view(&[3, 0, 0, 0], None);
    let new: Vec<u8> = [2.0_f32, 0.0, 2.0]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let new = maker.view(&new, None);
    let sparse = maker.floats(&corners);
    let mut sparse = maker.json["accessors"][sparse].clone();
    sparse["max"] = json!([2.0, 0.0, 2.0]);
    sparse["sparse"] = json!({ "count": 1, "indices": { "bufferView": at, "componentType": 5121 }, "values": { "bufferView": new } });
    let sparse = maker.add("accessors", sparse);
    let sparse = json!({ "attributes": { "POSITION": sparse, "NORMAL": ups }, "indices": order });
    for (number, primitive) in [strip, fan, flat, morphed, sparse].into_iter().enumerate() {
        maker.place(vec![primitive], [3.0 * number as f32, 0.0, 0.0]);
    }
    let place = Place::with("a.glb", maker.glb());
    let [vertices, texels] = both(&place, "a.glb");
    let (_, bin) = parts(&place.path("v.glb"));
    for mesh in 0..5 {
        let values = floats(&vertices, &bin, &attributes(&vertices, mesh)["_AO"]);
        assert_eq!(values, [1.0; 4], "{mesh}");
        let primitive = &texels["meshes"][mesh]["primitives"][0];
        assert!(primitive.get("mode").is_none_or(|mode| *mode == 4));
        let all = &primitive["attributes"];
        // Sets are numbered without gaps.
        assert_eq!(all["TEXCOORD_0"], all["TEXCOORD_1"]);
    }
    let morphed = &texels["meshes"][3]["primitives"][0];
    let count =
        |accessor: &Value| &texels["accessors"][accessor.as_u64().unwrap() as usize]["count"];
    for accessor in [
        &morphed["targets"][0]["POSITION"],
        &morphed["attributes"]["_TEMPERATURE"],
    ] {
        assert_eq!(count(accessor), count(&morphed["attributes"]["POSITION"]));
    }
    let (json, bin) = parts(&place.path("t.glb"));
    let positions = floats(&json, &bin, &attributes(&json, 4)["POSITION"]);
    assert!(
        positions.chunks(3).any(|at| at == [2.0, 0.0, 2.0]),
        "{positions:?}"
    );
}

/// Buffers and images beside, and in data URIs, are taken into the binary chunk.
#[test]
fn text_files_become_binary_ones() {
    let mut maker = plate_over_floor();
    let whole = maker.bin.clone();
    for view in maker.list("bufferViews").iter_mut().skip(4) {
        view["buffer"] = 1.into();
    }
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, 1, 1);
    encoder.set_color(png::ColorType::Rgb);
    encoder
        .write_header()
        .unwrap()
        .write_image_data(&[255, 0, 0])
        .unwrap();
    let image = maker.add("images", json!({ "uri": "red%20one.png" }));
    let texture = maker.add("textures", json!({ "source": image }));
    let material = maker.add(
        "materials",
        json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } }),
    );
    maker.json["meshes"][0]["primitives"][0]["material"] = material.into();
    maker.json["buffers"] = json!([
        { "byteLength": whole.len(), "uri": "first.bin", "extras": 7 },
        { "byteLength": whole.len(), "uri": "second.bin" },
    ]);
    let place = Place::with("a.gltf", maker.json.to_string());
    for (name, bytes) in [
        ("first.bin", &whole),
        ("second.bin", &whole),
        ("red one.png", &png),
    ] {
        std::fs::write(place.path(name), bytes).unwrap();
    }
    let [vertices, _] = both(&place, "a.gltf");
    assert_eq!(vertices["buffers"].as_array().unwrap().len(), 1);
    assert_eq!(vertices["buffers"][0]["extras"], 7);
    assert_eq!(vertices["images"][0]["mimeType"], "image/png");
    // It can be used alone.
    let moved = Place::new();
    std::fs::copy(place.path("v.glb"), moved.path("v.glb")).unwrap();
    moved.ok("v.glb --samples 16 -o again.glb");
}

#[test]
fn what_is_there_is_not_lost() {
    let mut maker = plate_over_floor();
    let colors = vec![[0.5, 0.25, 1.0, 0.5]; 289];
    let colors = maker.floats(&colors);
    maker.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = colors.into();
    let place = Place::with("a.glb", maker.glb());
    assert!(
        place
            .refused("a.glb -o b.glb")
            .contains("COLOR_0 already: give --existing replace")
    );
    let corner = |existing: &str| {
        place.ok(&format!(
            "a.glb --samples 16 --d-max 1 --existing {existing} -o b.glb"
        ));
        validator::check(&place.path("b.glb"));
        let (json, bin) = parts(&place.path("b.glb"));
        let accessor = attributes(&json, 0)["COLOR_0"].as_u64().unwrap() as usize;
        let view = json["accessors"][accessor]["bufferView"].as_u64().unwrap() as usize;
        let at = json["bufferViews"][view]["byteOffset"].as_u64().unwrap() as usize;
        let word = |i: usize| u16::from_le_bytes([bin[at + 2 * i], bin[at + 2 * i + 1]]);
        [0, 1, 2, 3].map(word)
    };
    // Nothing is within a metre of the floor's corner.
    assert_eq!(corner("multiply"), [32768, 16384, 65535, 32768]);
    assert_eq!(corner("replace"), [65535; 4]);
    place.ok("a.glb --samples 16 --to texels --size 32 -o t.glb");
    assert!(
        place
            .refused("t.glb --to texels -o b.glb")
            .contains("occlusionTexture already")
    );
    place.ok("t.glb --to texels --size 32 --samples 16 --existing replace -o b.glb");
    validator::check(&place.path("b.glb"));
}

#[test]
fn what_cannot_be_is_refused_in_one_line() {
    let place = Place::with("a.glb", plate_over_floor().glb());
    for (arguments, part) in [
        ("builtin:cornell -o b.glb", "only .glb and .gltf"),
        ("a.obj -o b.glb", "only .glb and .gltf"),
        ("a.glb -o b.obj", "written as .glb"),
        ("a.glb -o b.exr", "written as .glb"),
        ("a.glb -o no/b.glb", "does not exist"),
        ("a.glb --technique ldi -o b.glb", "choose reference"),
        ("a.glb --technique field -o b.glb", "--tracer field"),
        (
            "a.glb --technique igi --quantity irradiance -o b.glb",
            "not irradiance.path",
        ),
        ("a.glb --igi-paths 9 -o b.glb", "it is for --technique igi"),
        (
            "a.glb --technique ldm --quantity irradiance -o b.glb",
            "not irradiance.path",
        ),
        ("a.glb --quantity path -o b.glb", "expected ao"),
        ("a.glb --quantity obscurance -o b.glb", "finite --d-max"),
        (
            "a.glb --quantity irradiance --attribute COLOR_0 -o b.glb",
            "no factor of colours",
        ),
        ("a.glb --attribute ao -o b.glb", "expected COLOR_0"),
        ("a.glb --size 64 -o b.glb", "--size has no effect"),
        (
            "a.glb --to texels --attribute _AO -o b.glb",
            "--attribute has no effect",
        ),
        ("a.glb --tracer compute-bvh -o b.glb", "runs on a GPU"),
        ("a.glb --shard 3/2 -o b.part", "I from 1 to N"),
        (
            "a.glb --to texels --existing multiply -o b.glb",
            "for colours of vertices",
        ),
        (
            "a.glb --attribute _AO --existing multiply -o b.glb",
            "for colours of vertices",
        ),
        (
            "a.glb --technique igi --quantity irradiance.indirect --min-d 0 --igi-compensation 9 -o b.glb",
            "found again",
        ),
        ("a.glb -o b.glb -o c.glb", "one .glb is written"),
    ] {
        let said = place.refused(arguments);
        assert!(said.contains(part), "{arguments}: {said}");
    }
    assert_eq!(place.names(), ["a.glb"]);
    let mut maker = plate_over_floor();
    let places = maker.floats(&[[0.0_f32; 3], [50.0, 0.0, 0.0]]);
    maker.json["nodes"][0]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": places } } });
    let place = Place::with("a.glb", maker.glb());
    assert!(
        place
            .refused("a.glb -o b.glb")
            .contains("EXT_mesh_gpu_instancing")
    );
}

/// A bake that is killed leaves the old file, and can be made again.
#[test]
fn a_killed_bake_leaves_what_was_there() {
    let place = Place::with("a.glb", plate_over_floor().glb());
    std::fs::write(place.path("b.glb"), "old").unwrap();
    let slow = "a.glb --to texels --size 512 --samples 4096 -q -o b.glb";
    for milliseconds in [20, 150, 400] {
        let mut child = place.command(slow).spawn().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(milliseconds));
        child.kill().unwrap();
        child.wait().unwrap();
        assert_eq!(std::fs::read(place.path("b.glb")).unwrap(), b"old");
    }
    assert_eq!(place.names(), ["a.glb", "b.glb"]);
    place.ok("a.glb --samples 4 -o b.glb");
    validator::check(&place.path("b.glb"));
}

/// A disk without room is an error, not half a file.
#[test]
fn a_full_disk_is_an_error() {
    let place = Place::with("a.glb", plate_over_floor().glb());
    let disk = place.path("disk");
    std::fs::create_dir(&disk).unwrap();
    let mounted = std::process::Command::new("mount")
        .args(["-t", "tmpfs", "-o", "size=16k", "none"])
        .arg(&disk)
        .output();
    if !mounted.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: no small disk can be mounted here");
        return;
    }
    let output = place.run("a.glb --samples 4 -q -o disk/b.glb");
    let left = std::fs::read_dir(&disk).unwrap().count();
    let unmounted = std::process::Command::new("umount").arg(&disk).status();
    assert!(unmounted.unwrap().success());
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!((output.status.code(), left), (Some(2), 0), "{said}");
    assert!(
        said.contains("b.glb") && said.contains("No space"),
        "{said}"
    );
    assert!(Path::new(&place.path("a.glb")).exists());
}
