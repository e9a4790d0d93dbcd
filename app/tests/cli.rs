//! The program from outside: what it writes, what it says, and how it refuses.

#![expect(clippy::unwrap_used, reason = "a test's helpers may fail the test")]

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
};

use assert_cmd::cargo::cargo_bin;
use glam::Vec3;
use isophote_scene::Image;
use serde_json::Value;

/// A folder of its own for every test, with the program run inside.
struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, content: impl AsRef<[u8]>) -> &Self {
        fs::write(self.path(name), content).unwrap();
        self
    }

    /// A triangle one metre wide, without camera and light.
    fn put_triangle(&self) -> &Self {
        let corners = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let bytes: Vec<u8> = corners
            .iter()
            .flatten()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        self.put("triangle.bin", bytes)
            .put("triangle.gltf", TRIANGLE)
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(cargo_bin!("isophote"));
        command
            .args(arguments)
            .current_dir(self.0.path())
            .env_remove("RUST_LOG");
        command
    }

    fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs what must succeed, and returns what it said on standard error.
    fn ok(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(
            output.status.success(),
            "{arguments:?}: {}",
            text(&output.stderr)
        );
        text(&output.stderr)
    }

    fn json(&self, arguments: &[&str]) -> Value {
        let output = self.run(arguments);
        assert!(
            output.status.success(),
            "{arguments:?}: {}",
            text(&output.stderr)
        );
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// Runs what must be refused: code 2, one line that starts with `error:`, nothing on standard output, and an
    /// output that exists stays as it was.
    fn refused(&self, arguments: &[&str], expected: &str) {
        let kept = ["out.exr", "out.png", "out.npy"];
        for name in kept {
            self.put(name, "old");
        }
        let output = self.run(arguments);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        let lines: Vec<_> = said.lines().collect();
        assert!(
            lines.len() == 1 && said.starts_with("error: "),
            "{arguments:?}: {said}"
        );
        assert!(said.contains(expected), "{arguments:?}: {said}");
        assert!(output.stdout.is_empty(), "{arguments:?}");
        for name in kept {
            assert_eq!(fs::read(self.path(name)).unwrap(), b"old", "{arguments:?}");
        }
    }

    fn image(&self, name: &str) -> Image {
        Image::load(self.path(name)).unwrap()
    }
}

const TRIANGLE: &str = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
  "nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
  "materials": [{"name": "Paint"}],
  "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
  "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"uri": "triangle.bin", "byteLength": 36}]}"#;

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A quick render of a built-in scene, with further arguments.
fn quick<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let quick = [
        "render",
        "builtin:cornell",
        "--size",
        "12x8",
        "--spp",
        "4",
        "-q",
    ];
    [&quick[..], more].concat()
}

#[test]
fn help_teaches() {
    let place = Place::new();
    let output = place.run(&[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("Usage: isophote"));
    for command in ["render", "trace", "compare", "show", "info"] {
        let output = place.run(&[command, "--help"]);
        assert!(output.status.success());
        let help = text(&output.stdout);
        assert!(
            help.contains("Examples:") && help.contains(&format!("isophote {command} ")),
            "{help}"
        );
    }
    let help = text(&place.run(&["render", "--help"]).stdout);
    for part in [
        "[metres]",
        "[pixels]",
        "lambert",
        "brute-force",
        "builtin:NAME",
        "--settings",
    ] {
        assert!(help.contains(part), "{part}");
    }
    assert!(text(&place.run(&["--version"]).stdout).starts_with("isophote "));
}

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
fn the_header_holds_all_settings_and_repeats_them() {
    let place = Place::new();
    let flags = [
        "--quantity=direct",
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
        ("quantity", "direct"),
        ("d-max", "inf"),
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

/// Virtual point lights by any tracer, bounded as the reference is; flags of other techniques are refused.
#[test]
fn the_technique_igi_renders() {
    let place = Place::new();
    let render = |more: &[&str]| {
        let common = [
            "render",
            "builtin:cornell",
            "--size=48x36",
            "--materials=lambert",
            "--quantity=indirect",
            "-q",
        ];
        place.ok(&[&common[..], more].concat());
    };
    render(&[
        "--technique=igi",
        "--igi-paths=1024",
        "--tracer=ldi",
        "-o",
        "igi.exr",
    ]);
    render(&["--min-d=0.1", "--spp=256", "-o", "reference.exr"]);
    let bias = |picture: &str| {
        let report = place.json(&["compare", picture, "reference.exr", "--json"]);
        report["bias"].as_f64().unwrap()
    };
    assert!(bias("igi.exr").abs() < 0.05, "{}", bias("igi.exr"));
    // Boxes hide more than the triangles in them.
    let igi = ["--technique=igi", "--igi-paths=256"];
    render(&[&igi[..], &["--tracer=bvh-boxes", "-o", "boxes.exr"]].concat());
    let boxes = bias("boxes.exr");
    assert!(boxes < -0.01 && boxes > -0.6, "{boxes}");
    // Shadow maps, filled by a tracer that is not exact.
    let maps = ["--igi-visibility=maps", "--igi-map-size=64", "--tracer=ldi"];
    render(&[&igi[..], &maps, &["-o", "maps.exr"]].concat());
    let chosen = [
        "--igi-keep=64",
        "--igi-select=32",
        "--igi-downsampling=2",
        "--igi-refine=2",
    ];
    render(&[&igi[..], &chosen, &["-o", "chosen.exr"]].concat());
    assert!(bias("chosen.exr").abs() < 0.1, "{}", bias("chosen.exr"));
    assert!(bias("maps.exr").abs() < 0.05, "{}", bias("maps.exr"));
    for (flags, expected) in [
        (&["--technique=igi", "--spp=4"][..], "--igi-paths"),
        (&["--technique=igi", "--quantity=ao"], "but not ao"),
        (&["--technique=igi", "--igi-interleaving=9x1"], "3x3"),
        (&["--igi-paths=4"], "--technique igi"),
        (
            &["--technique=igi", "--igi-map-size=64"],
            "--igi-visibility maps",
        ),
        (
            &[
                "--technique=igi",
                "--igi-visibility=maps",
                "--igi-map-size=9",
            ],
            "a multiple of 8",
        ),
        (
            &["--tracer=bvh-boxes", "--quantity=indirect"],
            "the secondary tracer",
        ),
        (
            &[
                "--technique=igi",
                "--igi-visibility=maps",
                "--tracer=bvh-boxes",
            ],
            "--igi-visibility rays",
        ),
        (&["--technique=ldi", "--igi-paths=4"], "--technique igi"),
    ] {
        place.refused(
            &[&["render", "builtin:cornell", "-o", "out.exr"], flags].concat(),
            expected,
        );
    }
}

/// Occlusion and indirect light by layered depth maps are near the reference, the screen-space baseline too where occluders are
/// near; flags of other techniques are refused.
#[test]
fn the_technique_ldm_renders() {
    let place = Place::new();
    let render = |more: &[&str]| {
        let common = ["render", "builtin:cornell", "--size=48x36", "-q"];
        place.ok(&[&common[..], more].concat());
    };
    let error = |picture: &str, reference: &str| {
        let report = place.json(&["compare", picture, reference, "--json"]);
        report["grey_rms"].as_f64().unwrap()
    };
    let near = ["--quantity=ao", "--d-max=0.1"];
    let maps = ["--technique=ldm", "--ldm-maps=128"];
    render(&[&near[..], &["--spp=512", "-o", "near.exr"]].concat());
    render(&[&near[..], &maps, &["-o", "maps.exr"]].concat());
    let hbao = ["--technique=ldm", "--ldm-occlusion=hbao"];
    render(&[&near[..], &hbao, &["-o", "hbao.exr"]].concat());
    for (picture, most) in [("maps.exr", 4.2), ("hbao.exr", 20.0)] {
        let error = error(picture, "near.exr");
        assert!(error < most, "{picture}: {error} grey levels");
    }
    render(&["--quantity=ao", "--spp=512", "-o", "far.exr"]);
    render(&[&maps[..], &["--quantity=ao", "-o", "open.exr"]].concat());
    assert!(error("open.exr", "far.exr") < 5.7);
    let light = ["--quantity=indirect", "--materials=lambert"];
    render(&[&light[..], &["--spp=256", "-o", "reference.exr"]].concat());
    render(&[&light[..], &maps, &["-o", "light.exr"]].concat());
    let report = place.json(&["compare", "light.exr", "reference.exr", "--json"]);
    assert!(report["bias"].as_f64().unwrap().abs() < 0.1, "{report}");
    // Everything up to two bounces, a sky among it; direct light by photons is nearly that of rays.
    let all = ["--quantity=path", "--environment=0.5,0.6,0.8"];
    render(
        &[
            &all[..],
            &["--spp=256", "--path-bounces=3", "-o", "path.exr"],
        ]
        .concat(),
    );
    let two = ["--ldm-bounces=2", "--ldm-photons=16", "-o", "all.exr"];
    render(&[&all[..], &maps, &two].concat());
    let photons = [
        "--ldm-direct=photons",
        "--ldm-glossy=none",
        "--ldm-photons=16",
        "-o",
        "photons.exr",
    ];
    render(&[&all[..], &maps, &photons].concat());
    for (picture, reference, most) in [
        ("all.exr", "path.exr", 0.1),
        ("photons.exr", "path.exr", 0.2),
    ] {
        let report = place.json(&["compare", picture, reference, "--json"]);
        println!("{picture}: {report}");
        assert!(report["bias"].as_f64().unwrap().abs() < most, "{report}");
    }
    for (flags, expected) in [
        (&["--technique=ldm", "--spp=4"][..], "--ldm-maps"),
        (
            &[
                "--technique=ldm",
                "--quantity=indirect",
                "--ldm-deposit=splatted",
                "--ldm-bounces=2",
            ],
            "bounce once",
        ),
        (
            &[
                "--technique=ldm",
                "--quantity=indirect",
                "--ldm-splat=quads",
            ],
            "--device gpu",
        ),
        (&["--ldm-maps=4"], "--technique ldm"),
        (
            &["--technique=ldm", "--quantity=ao", "--ldm-occlusion=hbao"],
            "--d-max",
        ),
    ] {
        place.refused(
            &[&["render", "builtin:cornell", "-o", "out.exr"], flags].concat(),
            expected,
        );
    }
}

/// A quick render by the technique ldi, with further arguments.
fn hybrid<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let quick = [
        "render",
        "builtin:cornell",
        "--technique=ldi",
        "--size=12x8",
        "--ldi-cells=2",
        "--ldi-resolution=32",
        "-q",
    ];
    [&quick[..], more].concat()
}

#[test]
fn the_hybrid_renderer_shows_its_stages() {
    let place = Place::new();
    let report = place.json(&hybrid(&["--json", "-o", "all.exr"]));
    let image = place.image("all.exr");
    let layer = |name| image.rgb(name).unwrap();
    let sum = layer("direct")
        .into_iter()
        .zip(layer("diffuse"))
        .zip(layer("glossy"))
        .map(|((a, b), c)| a + b + c);
    assert_eq!(sum.collect::<Vec<_>>(), layer(""));
    for name in ["irradiance.indirect", "irradiance.noisy"] {
        assert!(layer(name).iter().any(|light| *light != Vec3::ZERO));
    }
    let passes = report["passes"].as_array().unwrap();
    let counted: u64 = passes
        .iter()
        .map(|pass| pass["rays"].as_u64().unwrap() + pass["shadow_rays"].as_u64().unwrap())
        .sum();
    assert_eq!(report["rays"], counted);
    assert_eq!(passes[0]["rays"], 12 * 8);
    assert_eq!(report["maps"]["directions"], 24);
    place.ok(&["show", "all.exr", "--layer=direct", "-o", "direct.png"]);
    assert_eq!(place.image("direct.png").width, 12);
    place.refused(&["show", "all.exr", "--layer=x", "-o", "out.png"], "glossy");
    place.refused(&["show", "all.exr", "-o", "out.exr"], ".png");
    // The reference of the same quantity is asked for by the same header.
    assert_eq!(image.attributes["path-bounces"], "2");
    assert!(!image.attributes.contains_key("spp"));
    let again = ["render", "--settings=all.exr", "-q", "--seed=1", "-o"];
    place.ok(&[&again[..], &["again.exr"]].concat());
    let reference = ["--technique=reference", "--tracer=bvh", "--spp=64"];
    place.ok(&[&again[..], &["truth.exr"], &reference].concat());
    let report = place.json(&["compare", "again.exr", "truth.exr", "--json"]);
    let bias = report["bias"].as_f64().unwrap();
    assert!(bias.abs() < 0.1, "{bias}");
}

#[test]
fn maps_are_saved_and_loaded() {
    let place = Place::new();
    let center = ["--ldi-layers=center", "--ldi-samples=4"];
    let saved = [&center[..], &["--ldi-save=maps", "-o", "saved.exr"]].concat();
    place.ok(&hybrid(&saved));
    let from_file = |more: &[&'static str]| {
        let load = [
            "render",
            "builtin:cornell",
            "--technique=ldi",
            "--size=12x8",
            "--ldi-load=maps",
            "-q",
            "-o",
            "out.exr",
        ];
        [&load[..], more].concat()
    };
    place.ok(&from_file(&["--ldi-samples=4"]));
    let (saved, loaded) = (place.image("saved.exr"), place.image("out.exr"));
    assert_eq!(saved.rgb(""), loaded.rgb(""));
    assert_eq!(loaded.attributes["ldi-layers"], "center");
    assert_eq!(loaded.attributes["ldi-cells"], "2");
    place.refused(&from_file(&["--ldi-cells=4"]), "--ldi-load");
    place.refused(&from_file(&["--ldi-save=b"]), "--ldi-load");
    place.refused(
        &from_file(&["--add=builtin:corner@0,0,0"]),
        "build the maps anew",
    );
    place.put("maps", "damaged");
    place.refused(&from_file(&[]), "maps");
}

/// With the dial at its end the answers are the exact tracer's.
#[test]
fn the_dial_goes_from_fast_to_exact() {
    let place = Place::new();
    let render = |more: &[&'static str], output: &'static str| {
        let report = place.json(&hybrid(&[more, &["--json", "-o", output]].concat()));
        (report, place.image(output).rgb(""))
    };
    let (_, exact) = render(&["--ldi-layers=touched"], "exact.exr");
    let center = ["--ldi-layers=center", "--ldi-exact"];
    let (report, all) = render(&[&center[..], &["2"]].concat(), "all.exr");
    assert_eq!(report["maps"]["exact_share"], 1.0);
    assert_eq!(all, exact);
    let (report, some) = render(&[&center[..], &["20%"]].concat(), "some.exr");
    let share = report["maps"]["exact_share"].as_f64().unwrap();
    assert!((0.1..=0.2).contains(&share), "{share}");
    assert_ne!(some, exact);
    place.refused(&hybrid(&["--ldi-exact=0.5", "-o", "out.exr"]), "touched");
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
        (&["--ldi-texture-level=-1"], "0 to 32"),
        (&["--ldi-layers=center", "--ldi-exact=200%"], "share"),
        (&["--ldi-depth-error=0"], "1/64 to 4096"),
        (&["--ldi-shadows=maps"], "--device gpu"),
        (&["--ldi-memory-limit=1", "--ldi-resolution=4096"], "memory"),
    ] {
        place.refused(&hybrid(&[flags, &["-o", "out.exr"]].concat()), expected);
    }
    place.refused(
        &[
            "trace",
            "builtin:cornell",
            "--rays=a.npy",
            "--ldi-cells=4",
            "-o",
            "out.npy",
        ],
        "the tracer ldi",
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

#[test]
fn tracers_agree_on_rays_from_files() {
    let place = Place::new();
    for kind in ["diffuse", "coherent", "shadow"] {
        let rays = format!("{kind}.npy");
        place.ok(&[
            "trace",
            "builtin:cornell",
            "--make",
            kind,
            "--count=2000",
            "--seed=3",
            "-q",
            "-o",
            &rays,
        ]);
        let mut found = Vec::new();
        for (tracer, levels, mode) in [
            ("bvh", "auto", "closest"),
            ("brute-force", "auto", "closest"),
            ("bvh", "two", "closest"),
            ("bvh", "auto", "any"),
            ("bvh", "two", "any"),
        ] {
            let report = place.json(&[
                "trace",
                "builtin:cornell",
                "--rays",
                &rays,
                "--tracer",
                tracer,
                "--bvh-levels",
                levels,
                "--mode",
                mode,
                "--repeat=2",
                "--threads=1",
                "--json",
                "-o",
                "hits.npy",
            ]);
            assert_eq!(report["rays"], 2000);
            assert_eq!(report["mode"], mode);
            for number in ["rays_per_second", "build_seconds", "bytes", "trace_seconds"] {
                assert!(report[number].as_f64().unwrap() > 0.0, "{number}");
            }
            let hits = fs::read(place.path("hits.npy")).unwrap();
            found.push((report["hits"].as_u64().unwrap(), hits));
        }
        assert_eq!(found[0], found[1], "{kind}");
        assert_eq!(found[0], found[2], "{kind}");
        assert_eq!([found[3].0, found[4].0], [found[0].0; 2], "{kind}");
        assert!(found[0].0 > 0, "{kind}");
    }
}

#[test]
fn odd_rays_miss_and_odd_files_are_refused() {
    let place = Place::new();
    let header = |shape: &str| {
        let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.into_bytes());
        bytes
    };
    let rays = [
        [0.278, 0.273, -0.8, 0.0, 0.0, 0.0, 1.0, f32::INFINITY],
        [f32::NAN, 0.273, -0.8, 0.0, 0.0, 0.0, 1.0, 9.0],
        [0.278, 0.273, -0.8, 0.0, 0.0, 0.0, 0.0, 9.0],
        [0.278, 0.273, -0.8, 0.0, 0.0, f32::INFINITY, 1.0, 9.0],
        [0.278, 0.273, -0.8, 0.0, 0.0, 0.0, 2.0, f32::NAN],
        [0.278, 0.273, -0.8, 0.0, 0.0, 0.0, 2.0, 9.0],
    ];
    let data: Vec<u8> = rays
        .iter()
        .flatten()
        .flat_map(|x: &f32| x.to_le_bytes())
        .collect();
    place.put("rays.npy", [header("(6, 8)"), data.clone()].concat());
    place.put("none.npy", header("(0, 8)"));
    place.put("cut.npy", [header("(7, 8)"), data.clone()].concat());
    place.put("shape.npy", [header("(48,)"), data].concat());
    place.put("empty.npy", "").put("text.npy", "rays");
    let trace = |rays| ["trace", "builtin:cornell", "--rays", rays, "-o", "hits.npy"];
    let said = place.ok(&trace("rays.npy"));
    assert!(
        said.contains("1 rays") && said.contains("unit length"),
        "{said}"
    );
    let bytes = fs::read(place.path("hits.npy")).unwrap();
    let data = bytes.len() - 6 * 20;
    let value = |i: usize| f32::from_le_bytes(bytes[data + 4 * i..][..4].try_into().unwrap());
    assert!(value(0).is_finite() && (value(25) - 0.5 * value(0)).abs() < 1e-6);
    for ray in 1..5 {
        let row: Vec<f32> = (0..5).map(|column| value(5 * ray + column)).collect();
        assert_eq!(row, [f32::INFINITY, 0.0, 0.0, -1.0, -1.0], "{ray}");
    }
    place.ok(&trace("none.npy"));
    let refuse = |rays, expected| {
        place.refused(
            &["trace", "builtin:cornell", "--rays", rays, "-o", "out.npy"],
            expected,
        );
    };
    refuse("no.npy", "no.npy");
    refuse("cut.npy", "cut");
    refuse("shape.npy", "(N, 8)");
    refuse("empty.npy", "empty");
    refuse("text.npy", "npy");
    place.refused(&["trace", "builtin:cornell", "-o", "out.npy"], "--rays");
    place.refused(
        &["trace", "builtin:cornell", "--make=odd", "-o", "out.npy"],
        "diffuse",
    );
    place.refused(
        &[
            "trace",
            "builtin:cornell",
            "--make=diffuse",
            "--count=0",
            "-o",
            "out.npy",
        ],
        "--count",
    );
}

#[test]
fn comparisons_measure_and_gate() {
    let place = Place::new();
    let render = |quantity: &str, spp: &str, seed: &str, name: &str| {
        let quantity = format!("--quantity={quantity}");
        place.ok(&[
            "render",
            "builtin:cornell",
            "-q",
            "--size=24x24",
            "--materials=lambert",
            &quantity,
            "--spp",
            spp,
            "--seed",
            seed,
            "--d-max=0.3",
            "-o",
            name,
        ]);
    };
    render("direct", "64", "1", "a.exr");
    render("direct", "64", "2", "b.exr");
    render("ao,direct", "64", "1", "both.exr");
    let report = place.json(&[
        "compare",
        "a.exr",
        "b.exr",
        "--json",
        "--error-image",
        "error.png",
    ]);
    let number = |name: &str| report[name].as_f64().unwrap();
    assert_eq!(report["headline"], "relrmse");
    assert!(
        number("rel_rmse") > 0.0 && number("rel_rmse_beyond_noise") <= 0.5 * number("rel_rmse")
    );
    assert!(number("bias").abs() < 0.02 && number("constant_ratio") > 5.0);
    assert!(number("ssim") > 0.9 && number("flip") < 0.1 && number("psnr") > 20.0);
    assert!(report["silhouettes"]["share"].as_f64().unwrap() > 0.0);
    assert_eq!(place.image("error.png").width, 24);
    let same = place.json(&[
        "compare",
        "both.exr",
        "a.exr",
        "--layer=direct",
        "--json",
        "--error-image=e.exr",
    ]);
    assert_eq!(same["rel_rmse"], 0.0);
    assert!(
        place
            .image("e.exr")
            .rgb("")
            .unwrap()
            .iter()
            .all(|pixel| pixel.length() == 0.0)
    );
    let ao = place.run(&["compare", "both.exr", "both.exr", "--layer=ao"]);
    assert!(text(&ao.stdout).lines().nth(1).unwrap().starts_with("rms"));
    let code = |flag| {
        place
            .run(&["compare", "a.exr", "b.exr", flag])
            .status
            .code()
    };
    assert_eq!(code("--max-relrmse=0.5"), Some(0));
    assert_eq!(code("--max-rms=200"), Some(0));
    render("direct", "64", "1", "c.exr");
    let mut darker = place.image("c.exr");
    for channel in &mut darker.channels {
        channel.samples.iter_mut().for_each(|value| *value *= 0.5);
    }
    darker.save(place.path("c.exr")).unwrap();
    let gate = place.run(&["compare", "c.exr", "b.exr", "--json", "--max-relrmse=0.04"]);
    assert_eq!(gate.status.code(), Some(1));
    let report: Value = serde_json::from_slice(&gate.stdout).unwrap();
    assert!((report["bias"].as_f64().unwrap() + 0.5).abs() < 0.01);
}

#[test]
fn wrong_comparisons_are_refused() {
    let place = Place::new();
    let save = |name: &str, width: u32, value: f32| {
        let mut image = Image::new(width, 2);
        let mut values = vec![Vec3::ONE; 2 * width as usize];
        values[1].y = value;
        image.push_layer("", "RGB", &values);
        image.save(place.path(name)).unwrap();
    };
    save("a.exr", 2, 0.5);
    save("b.exr", 3, 0.5);
    save("nan.exr", 2, f32::NAN);
    save("a.png", 2, 0.5);
    place
        .put("cut.exr", &fs::read(place.path("a.exr")).unwrap()[..150])
        .put("empty.exr", "");
    place.ok(&["compare", "a.exr", "a.png"]);
    for (arguments, expected) in [
        (&["a.exr", "b.exr"][..], "2×2 pixels"),
        (&["a.exr", "nan.exr"], "1 of 4 pixels are NaN"),
        (&["no.exr", "a.exr"], "no.exr"),
        (&["cut.exr", "a.exr"], "cut.exr"),
        (&["a.exr", "empty.exr"], "empty"),
        (&["a.exr", "a.txt"], "suffix"),
        (&["a.exr"], "REFERENCE"),
        (&["a.exr", "a.exr", "--error-image=e.jpg"], "suffix"),
        (
            &["a.exr", "a.exr", "--error-image=no/e.png"],
            "does not exist",
        ),
    ] {
        place.refused(&[&["compare"], arguments].concat(), expected);
    }
    place.put("a.json", "[]");
    place.refused(&["compare", "a.exr", "a.exr"], "a.json");
}

#[test]
fn a_record_beside_a_reference_tells_its_noise() {
    let place = Place::new();
    let mut image = Image::new(2, 1);
    image.push_layer("", "RGB", &[Vec3::ONE, Vec3::splat(0.5)]);
    image.save(place.path("ref.exr")).unwrap();
    image.save(place.path("test.exr")).unwrap();
    place.put(
        "ref.json",
        r#"{"quantity": "ao_1.5m", "relative_noise": 0.25}"#,
    );
    let report = place.json(&["compare", "test.exr", "ref.exr", "--json"]);
    assert_eq!(report["noise_reference"], 0.25);
    assert_eq!(report["noise_test"], Value::Null);
    assert_eq!(
        (&report["quantity"], &report["headline"]),
        (&"ao".into(), &"rms".into())
    );
    // Equal pictures: no finite decibels.
    assert_eq!(report["psnr"], Value::Null);
}

#[test]
fn info_tells_what_is_there() {
    let place = Place::new();
    place.put_triangle();
    let report = place.json(&[
        "info",
        "triangle.gltf",
        "--json",
        "--add",
        "builtin:corner@1,2,3:moving",
    ]);
    assert!(
        report["triangles"].as_u64().unwrap() > 1
            && report["moving_instances"].as_u64().unwrap() > 0
    );
    assert_eq!(report["materials"][0]["name"], "Paint");
    assert_eq!(report["cameras"], Value::Array(vec![]));
    assert_eq!(report["environment"]["kind"], "black");
    let said = text(
        &place
            .run(&["info", "triangle.gltf", "--material=Paint=0.25,0.5"])
            .stdout,
    );
    for part in [
        "1 triangles",
        "Paint",
        "metallic 0.25",
        "roughness 0.5",
        "framed automatically",
        "dropped",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    place.refused(&["info", "triangle.gltf", "--material=Gold=1,0"], "Paint");
    place.put("nothing.gltf", r#"{"asset": {"version": "2.0"}}"#);
    place.ok(&["info", "nothing.gltf"]);
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
fn a_closed_pipe_is_no_failure() {
    let place = Place::new();
    let mut command = place.command(&["info", "builtin:cornell", "--json"]);
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(
        output.status.success() && output.stderr.is_empty(),
        "{}",
        text(&output.stderr)
    );
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
