//! The techniques ldi, igi and ldm from the command line.

use glam::Vec3;

use crate::{Place, hybrid};

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
        (
            &["--technique=igi", "--igi-pattern=irregular"],
            "--igi-interleaving",
        ),
        (&["--technique=igi", "--igi-refine=3"], "--igi-downsampling"),
        (
            &["--technique=igi", "--igi-filter=paper"],
            "samples are the picture",
        ),
        (
            &["--technique=igi", "--igi-compensation=9", "--min-d=0"],
            "found again",
        ),
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
    for (picture, most) in [("maps.exr", 4.2), ("hbao.exr", 13.5)] {
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
                "--ldm-spread=turned",
            ],
            "--ldm-deposit splatted",
        ),
        (
            &["--technique=ldm", "--quantity=ao", "--ldm-spread=parallel"],
            "--quantity indirect",
        ),
        (
            &[
                "--technique=ldm",
                "--quantity=indirect",
                "--ldm-deposit=splatted",
                "--ldm-splat=quads",
            ],
            "--device gpu",
        ),
        (&["--ldm-maps=4"], "--technique ldm"),
        (
            &["--technique=ldm", "--quantity=ao", "--ldm-photons=8"],
            "no photons",
        ),
        (
            &["--technique=ldm", "--quantity=direct", "--ldm-bounces=2"],
            "light that bounced",
        ),
        (
            &["--technique=ldm", "--quantity=indirect", "--ldm-branches=4"],
            "--ldm-bounces",
        ),
        (
            &[
                "--technique=ldm",
                "--quantity=indirect",
                "--ldm-deposit=splatted",
                "--ldm-samples=4",
            ],
            "one point of each pixel",
        ),
        (
            &[
                "--technique=ldm",
                "--quantity=indirect",
                "--ldm-occlusion=hbao",
            ],
            "ao and obscurance",
        ),
        (&["--quantity=ao", "--materials=lambert"], "no light"),
        (&["--quantity=direct", "--d-max=1"], "everywhere"),
        (&["--quantity=direct,indirect", "--path-bounces=2"], "paths"),
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
