//! What is rendered: pictures, layers, lights, and what threads and tracers do not change.

use std::{fs, path::Path};

use glam::Vec3;
use isophote_scene::Image;

use crate::{Place, TRIANGLE, quick};

#[test]
fn one_quantity_is_the_picture_and_several_are_layers() {
    let place = Place::new();
    place.ok(&quick(&[
        "--quantity",
        "ao",
        "--d-max",
        "0.2",
        "-o",
        "one.exr",
        "-o",
        "one.png",
    ]));
    let one = place.image("one.exr");
    assert_eq!((one.width, one.height), (12, 8));
    assert_eq!(place.image("one.png").width, 12);
    assert!(one.rgb("").is_some() && one.attributes["noise"].parse::<f32>().unwrap() > 0.0);
    let layers = ["--quantity", "ao,direct,irradiance.indirect", "--d-max=0.2"];
    place.ok(&quick(&[&layers[..], &["-o", "many.exr"]].concat()));
    let many = place.image("many.exr");
    assert!(many.rgb("").is_none());
    assert_eq!(many.rgb("ao"), one.rgb(""));
    for name in [
        "direct.R",
        "irradiance.indirect.B",
        "albedo.G",
        "normal.Z",
        "position.X",
    ] {
        assert!(many.channel(name).is_some(), "{name}");
    }
    for name in ["depth.Z", "primitive", "instance"] {
        let values = one.channel(name).expect(name);
        assert!(values.iter().any(|&value| value >= 0.0), "{name}");
    }
    for quantity in ["ao", "direct", "irradiance.indirect"] {
        assert!(
            many.attributes.contains_key(&format!("noise.{quantity}")),
            "{quantity}"
        );
    }
}

#[test]
fn threads_change_no_bit() {
    let place = Place::new();
    for threads in ["1", "3"] {
        let name = format!("{threads}.exr");
        place.ok(&quick(&[
            "--quantity=ao,path",
            "--threads",
            threads,
            "-o",
            &name,
        ]));
    }
    assert!(fs::read(place.path("1.exr")).unwrap() == fs::read(place.path("3.exr")).unwrap());
    place.ok(&quick(&[
        "--quantity=ao,path",
        "--seed=1",
        "-o",
        "seed.exr",
    ]));
    assert_ne!(
        place.image("seed.exr").rgb("path"),
        place.image("1.exr").rgb("path")
    );
}

#[test]
fn both_tracers_give_the_same_picture() {
    let place = Place::new();
    for tracer in ["bvh", "brute-force"] {
        place.ok(&quick(&[
            "--tracer",
            tracer,
            "-o",
            &format!("{tracer}.exr"),
        ]));
    }
    assert_eq!(
        place.image("bvh.exr").rgb(""),
        place.image("brute-force.exr").rgb("")
    );
}

#[test]
fn quiet_is_quiet_and_json_is_whole() {
    let place = Place::new();
    place.put_triangle();
    let render = [
        "render",
        "triangle.gltf",
        "--size=4x4",
        "--spp=2",
        "-o",
        "a.png",
    ];
    let said = place.ok(&render);
    for part in [
        "no camera",
        "framed automatically",
        "no light",
        "white environment",
        "sRGB",
        "exposure",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let quiet = place.run(&[&render[..], &["-q"]].concat());
    assert!(quiet.stdout.is_empty() && quiet.stderr.is_empty());
    let report = place.json(&[&render[..], &["-q", "--json", "--threads=2"]].concat());
    assert_eq!(report["settings"]["spp"], "2");
    assert_eq!(report["threads"], 2);
    assert_eq!(report["triangles"], 1);
    for stage in ["load", "build", "render", "write"] {
        assert!(report["seconds"][stage].as_f64().unwrap() >= 0.0, "{stage}");
    }
    for number in ["rays", "rays_per_second", "memory_peak_bytes"] {
        assert!(report[number].as_f64().unwrap() > 0.0, "{number}");
    }
    for word in ["device", "version"] {
        assert!(!report[word].as_str().unwrap().is_empty(), "{word}");
    }
    assert!(report["noise"]["path"].is_number());
}

#[test]
fn an_unlit_scene_is_white_in_a_white_environment() {
    let place = Place::new();
    place.put_triangle();
    let flags = [
        "render",
        "triangle.gltf",
        "-q",
        "--size=32x32",
        "--spp=64",
        "--materials=lambert",
    ];
    place.ok(&[&flags[..], &["--quantity=direct", "-o", "a.exr"]].concat());
    let image = place.image("a.exr");
    // A lone white surface under light of 1 from everywhere has radiance 1.
    let mean = inner_mean(&image);
    assert!((mean - 1.0).abs().max_element() < 0.02, "{mean}");
}

/// The mean of the pixels that see a surface and are surrounded by such pixels.
fn inner_mean(image: &Image) -> Vec3 {
    let (seen, picture) = (image.channel("instance").unwrap(), image.rgb("").unwrap());
    let width = image.width as usize;
    let inner: Vec<Vec3> = (width + 1..picture.len() - width - 1)
        .filter(|&i| {
            [i, i - 1, i + 1, i - width, i + width]
                .iter()
                .all(|&i| seen[i] >= 0.0)
        })
        .map(|i| picture[i])
        .collect();
    assert!(inner.len() > 10, "{}", inner.len());
    inner.iter().sum::<Vec3>() / inner.len() as f32
}

#[test]
fn objects_have_materials_of_their_own() {
    let place = Place::new();
    place.put_triangle();
    let scene = |more: &[&'static str]| {
        let info = ["info", "builtin:cornell", "--add=triangle.gltf#a@0,0,0"];
        [&info[..], more].concat()
    };
    place.refused(&scene(&[]), "no object is called 'a'");
    let named = TRIANGLE.replace(r#"{"mesh": 0}"#, r#"{"mesh": 0, "name": "a"}"#);
    place.put("triangle.gltf", named);
    let report = place.json(&scene(&["--material=a=1,0.25,0,0,1", "--json"]));
    let materials = report["materials"].as_array().unwrap();
    let own = materials.last().unwrap();
    assert_eq!(own["name"], "Paint");
    assert_eq!(own["roughness"], 0.25);
    assert_eq!(own["base_color"][2], 1.0);
    assert!(
        materials
            .iter()
            .any(|other| { other["name"] == "Paint" && other["roughness"] == 1.0 })
    );
}

#[test]
fn panoramas_light_the_scene() {
    let place = Place::new();
    place.put_triangle();
    let mut sky = Image::new(4, 2);
    sky.push_layer("", "RGB", &[Vec3::new(0.0, 0.0, 2.0); 8]);
    sky.save(place.path("sky.exr")).unwrap();
    place.ok(&[
        "render",
        "triangle.gltf",
        "-q",
        "--size=32x32",
        "--spp=64",
        "--environment=sky.exr",
        "--materials=lambert",
        "--quantity=direct",
        "-o",
        "a.exr",
    ]);
    let mean = inner_mean(&place.image("a.exr"));
    let expected = Vec3::new(0.0, 0.0, 2.0);
    assert!((mean - expected).abs().max_element() < 0.04, "{mean}");
}

#[test]
fn real_files_render() {
    let scene = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../shared/scenes/cornell_mirror.glb"
    ));
    if !scene.exists() {
        eprintln!("skipped: {} is absent", scene.display());
        return;
    }
    let place = Place::new();
    let scene = scene.to_str().unwrap();
    place.ok(&[
        "render",
        scene,
        "--size=16x12",
        "--spp=16",
        "--light-radius=0.1",
        "-o",
        "a.exr",
    ]);
    let picture = place.image("a.exr").rgb("").unwrap();
    let mean =
        picture.iter().map(|pixel| pixel.element_sum()).sum::<f32>() / (3.0 * picture.len() as f32);
    assert!((0.1..1.0).contains(&mean), "{mean}");
}
