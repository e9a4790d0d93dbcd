//! The header of a picture, and flags and files that are refused.

use std::fs;

use isophote_scene::Image;

use crate::{Place, TRIANGLE, hybrid, quick};

#[test]
fn the_header_holds_all_settings_and_repeats_them() {
    let place = Place::new();
    let flags = [
        "--quantity=direct,ao",
        "--d-max=0.5",
        "--materials=lambert",
        "--normals=flat",
        "--seed=9",
        "--camera=auto",
        "--material=white=0.5,0.25",
        "--material=red=1,0.3",
        "--add=builtin:corner@0.2,0,0.2,0.01,30:moving",
        "--environment=0.1,0.2,0.3",
        "--bounds=-9,-9,-9,9,9,9",
        "--time=1.5",
        "--bvh-levels=two",
    ];
    place.ok(&quick(&[&flags[..], &["-o", "old.exr"]].concat()));
    let old = place.image("old.exr");
    for (name, value) in [
        ("scene", "builtin:cornell"),
        ("technique", "reference"),
        ("tracer", "bvh"),
        ("quantity", "direct,ao"),
        ("d-max", "0.5"),
        ("materials", "lambert"),
        ("normals", "flat"),
        ("size", "12x8"),
        ("spp", "4"),
        ("seed", "9"),
        ("camera", "auto"),
        ("material", "white=0.5,0.25\nred=1,0.3"),
        ("time", "1.5"),
        ("bounds", "-9,-9,-9,9,9,9"),
        ("bvh-levels", "two"),
        ("isophote", env!("CARGO_PKG_VERSION")),
    ] {
        assert_eq!(
            old.attributes.get(name).map(String::as_str),
            Some(value),
            "{name}"
        );
    }
    assert!(old.attributes["device"].starts_with("cpu"));
    place.ok(&["render", "-q", "--settings", "old.exr", "-o", "again.exr"]);
    assert!(fs::read(place.path("again.exr")).unwrap() == fs::read(place.path("old.exr")).unwrap());
    place.ok(&[
        "render",
        "-q",
        "--settings",
        "old.exr",
        "--size",
        "5x4",
        "-o",
        "smaller.exr",
    ]);
    let smaller = place.image("smaller.exr");
    assert_eq!((smaller.width, &smaller.attributes["seed"][..]), (5, "9"));
    place.ok(&[
        "render",
        "-q",
        "builtin:corner",
        "--settings",
        "old.exr",
        "--material=plaster=0,1",
        "--camera=camera_main",
        "-o",
        "other.exr",
    ]);
    assert_eq!(
        place.image("other.exr").attributes["scene"],
        "builtin:corner"
    );
}

#[test]
fn wrong_scenes_are_refused() {
    let place = Place::new();
    place
        .put_triangle()
        .put("empty.glb", "")
        .put("cut.glb", b"glTF\x02\0\0\0\xff\xff");
    place.put("nothing.gltf", r#"{"asset": {"version": "2.0"}}"#);
    place.put(
        "lies.gltf",
        TRIANGLE.replace("\"count\": 3", "\"count\": 300000000"),
    );
    place.put("noise.glb", [7; 100]).put("scene.xyz", "");
    let render = |scene| ["render", scene, "-q", "--size=4x4", "-o", "out.exr"];
    let trace = |scene| ["trace", scene, "--make=diffuse", "-o", "out.npy"];
    for (scene, expected) in [
        ("missing.glb", "missing.glb"),
        ("empty.glb", "empty.glb"),
        ("cut.glb", "cut.glb"),
        ("nothing.gltf", "no geometry"),
        ("lies.gltf", "lies.gltf"),
        ("noise.glb", "noise.glb"),
        ("scene.xyz", "suffix"),
        (".", "suffix"),
        ("builtin:nothing", "cornell"),
        ("builtin:hairball:0", "builtin"),
        ("", "suffix"),
    ] {
        place.refused(&render(scene), expected);
        place.refused(&trace(scene), expected);
        if scene != "nothing.gltf" {
            place.refused(&["info", scene], expected);
        }
    }
}

#[test]
fn wrong_settings_are_refused() {
    let place = Place::new();
    for (flags, expected) in [
        (&["--size=0x0"][..], "--size"),
        (&["--size=8x0"], "pixels"),
        (&["--size=99999x99999"], "16384"),
        (&["--size=8"], "WIDTHxHEIGHT"),
        (&["--size=16384x16384"], "GiB"),
        (&["--spp=0"], "--spp"),
        (&["--spp=-1"], "--spp"),
        (&["--camera=nobody"], "camera_main"),
        (&["--quantity=beauty"], "irradiance.path"),
        (&["--quantity="], "--quantity"),
        (&["--quantity=ao,ao"], "twice"),
        (&["--technique=magic"], "reference"),
        (&["--tracer=magic"], "bvh"),
        (&["--bvh-levels=three"], "flat"),
        (
            &["--tracer=brute-force", "--bvh-levels=two"],
            "--bvh-levels",
        ),
        (&["--materials=gold"], "lambert"),
        (&["--normals=up"], "smooth"),
        (&["--d-max=0"], "above 0"),
        (&["--d-max=nan"], "above 0"),
        (&["--quantity=obscurance"], "--d-max"),
        (&["--min-d=-1"], "at least 0"),
        (&["--threads=0"], "1 to 1024"),
        (&["--seed=-1"], "--seed"),
        (&["--exposure=inf"], "finite"),
        (&["--wrong"], "--wrong"),
        (&["second.glb"], "second.glb"),
        (&["--material=white=2,0"], "0..1"),
        (&["--material=gold=1,0"], "white"),
        (&["--environment=-1,0,0"], "negative"),
        (&["--environment=no.exr"], "no.exr"),
        (&["--environment=no.txt"], "suffix"),
        (&["--add=no.glb@0,0,0"], "no.glb"),
        (&["--add=no.glb"], "SCALE"),
        (&["--bounds=1,2"], "--bounds"),
        (&["--bounds=9,9,9,10,10,10"], "nothing to trace"),
        (&["--time=nan"], "--time"),
        (&["--light-radius=-1"], "--light-radius"),
        (&["--gltf-scene=no", "--add=triangle.gltf@0,0,0"], "no"),
        (&["--path-bounces=0"], "--path-bounces"),
    ] {
        place.put_triangle();
        place.refused(&quick(&[flags, &["-o", "out.exr"]].concat()), expected);
    }
}

#[test]
fn flags_without_effect_are_refused() {
    let place = Place::new();
    for (flags, expected) in [
        (&["--ldi-samples=4"][..], "--technique ldi"),
        (&["--ldi-cells=4"], "the tracer ldi"),
        (&["--tracer=ldi", "--ldi-epsilon=1"], "center"),
        (&["--technique=ldi"], "--ldi-diffuse-rays"),
    ] {
        place.refused(&quick(&[flags, &["-o", "out.exr"]].concat()), expected);
    }
    for (flags, expected) in [
        (&["--normals=flat"][..], "--normals"),
        (&["--d-max=1"], "--d-max"),
        (&["--path-bounces=2"], "--path-bounces"),
        (&["--quantity=ao"], "direct"),
        (&["--ldi-samples=2"], "1 or 4"),
        (&["--ldi-filter-width=4"], "odd"),
        (&["--ldi-filter-sigma=0"], "0.1"),
        (
            &["--ldi-filter-sigma=5", "--ldi-filter-width=1"],
            "nothing is filtered",
        ),
        (
            &["--ldi-filter-stops=nowhere", "--ldi-filter-width=1"],
            "nothing is filtered",
        ),
        (&["--ldi-texture-level=-1"], "0 to 32"),
        (&["--ldi-layers=center", "--ldi-exact=200%"], "share"),
        (&["--ldi-depth-error=0"], "1/64 to 4096"),
        (&["--ldi-shadows=maps"], "--device gpu"),
        (&["--ldi-memory-limit=1", "--ldi-resolution=4096"], "memory"),
    ] {
        place.refused(&hybrid(&[flags, &["-o", "out.exr"]].concat()), expected);
    }
    for (flags, expected) in [
        (&["--ldi-cells=4"][..], "the tracer ldi"),
        (&["--count=77"], "--make"),
        (&["--seed=9"], "--make"),
        (&["--camera=auto"], "--make"),
    ] {
        let trace = ["trace", "builtin:cornell", "--rays=a.npy", "-o", "out.npy"];
        place.refused(&[&trace[..], flags].concat(), expected);
    }
    for (flags, expected) in [
        (&["--make=diffuse", "--mode=any"][..], "--rays"),
        (&["--make=diffuse", "--repeat=9"], "--rays"),
        (&["--make=diffuse", "--device=gpu"], "--rays"),
        (&["--make=coherent", "--seed=9"], "nothing is random"),
    ] {
        let trace = ["trace", "builtin:cornell", "-o", "out.npy"];
        place.refused(&[&trace[..], flags].concat(), expected);
    }
    place.refused(
        &["info", "builtin:cornell", "--bounds=0,0,0,1,1,1"],
        "tracers",
    );
}

#[test]
fn wrong_outputs_are_refused_before_any_work() {
    let place = Place::new();
    fs::create_dir(place.path("folder.exr")).unwrap();
    let read_only = place.path("locked.exr");
    fs::write(&read_only, "old").unwrap();
    let mut permissions = fs::metadata(&read_only).unwrap().permissions();
    permissions.set_readonly(true);
    fs::set_permissions(&read_only, permissions).unwrap();
    for (output, expected) in [
        ("out.jpg", "suffix"),
        ("out", "suffix"),
        ("folder.exr", "folder"),
        ("no/such/out.exr", "does not exist"),
        ("locked.exr", "read-only"),
    ] {
        // A scene that would take hours: the output is looked at first.
        place.refused(
            &["render", "builtin:atrium", "--spp=65536", "-o", output],
            expected,
        );
    }
    place.refused(
        &quick(&["--quantity=ao,direct", "-o", "out.png"]),
        "one quantity",
    );
    place.refused(&["render", "builtin:cornell"], "--output");
    place.refused(&["render", "-o", "out.exr"], "SCENE");
    place.refused(
        &[
            "trace",
            "builtin:cornell",
            "--make=diffuse",
            "-o",
            "out.exr",
        ],
        ".npy",
    );
    place.refused(&["paint"], "paint");
    assert!(!place.path("out.jpg").exists());
}

#[test]
fn wrong_headers_are_refused() {
    let place = Place::new();
    let mut image = Image::new(2, 2);
    image.push("Y", vec![0.0; 4]);
    image.save(place.path("plain.exr")).unwrap();
    for (name, value) in [("technique", "magic"), ("spp", "0")] {
        image.attributes.insert(name.into(), value.into());
    }
    image
        .attributes
        .insert("scene".into(), "builtin:cornell".into());
    image.save(place.path("strange.exr")).unwrap();
    place.put(
        "cut.exr",
        &fs::read(place.path("plain.exr")).unwrap()[..200],
    );
    for (name, expected) in [
        ("no.exr", "no.exr"),
        ("plain.exr", "no settings"),
        ("cut.exr", "cut.exr"),
        ("strange.exr", "magic"),
    ] {
        place.refused(&["render", "--settings", name, "-o", "out.exr"], expected);
    }
}
