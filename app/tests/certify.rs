//! `isophote certify`: an exact tracer is told from one that is not, and visibility from noise.

#![expect(clippy::unwrap_used, reason = "a test's helpers may fail the test")]

use std::{path::Path, process::Command};

use assert_cmd::cargo::cargo_bin;
use isophote_scene::Image;
use serde_json::Value;

const QUICK: [&str; 7] = [
    "certify",
    "builtin:cornell",
    "--count=4000",
    "--size=24x24",
    "--spp=16",
    "--device=cpu",
    "-q",
];

fn certificate(folder: &Path, more: &[&str]) -> Value {
    let output = Command::new(cargo_bin!("isophote"))
        .args(QUICK)
        .args(more)
        .arg("--json")
        .current_dir(folder)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{more:?}: {said}");
    serde_json::from_slice(&output.stdout).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

#[test]
fn what_is_exact_is_told_from_what_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let exact = certificate(at, &["--tracer=brute-force", "--count=1000"]);
    let touched = certificate(at, &["--tracer=ldi", "--ldi-resolution=32"]);
    for right in [&exact, &touched] {
        for kind in right["rays"].as_array().unwrap() {
            assert_eq!(number(&kind["leak_rate"]), 0.0, "{kind}");
            assert_eq!(number(&kind["false_hit_rate"]), 0.0, "{kind}");
            assert!(number(&kind["rays_per_second"]) > 0.0);
        }
        let picture = &right["picture"];
        assert!(number(&picture["visibility"]["rel_rmse"]) < 1e-3);
        assert!(number(&picture["noise"]["rel_rmse"]) > 0.02);
    }
    let center = certificate(
        at,
        &[
            "--tracer=ldi",
            "--ldi-layers=center",
            "--ldi-resolution=32",
            "-o",
            "certificate.png",
            "-o",
            "certificate.exr",
        ],
    );
    let diffuse = &center["rays"][1];
    assert_eq!(diffuse["kind"], "diffuse");
    let wrong = number(&diffuse["late"]) + number(&diffuse["early"]);
    assert!(wrong > 0.0 && number(&diffuse["t_error_quantiles"][4]) > 0.0);
    let counted = [
        "hit_in_both",
        "missed_by_both",
        "false_hits",
        "false_misses",
    ];
    let counted: f64 = counted.iter().map(|name| number(&diffuse[name])).sum();
    assert_eq!(counted, number(&diffuse["rays"]));
    assert!(number(&center["picture"]["visibility"]["rel_rmse"]) > 1e-3);

    let sheet = Image::load(at.join("certificate.png")).unwrap();
    assert_eq!([sheet.width, sheet.height], [48, 48]);
    let layers = Image::load(at.join("certificate.exr")).unwrap();
    let of = |name: &str| layers.rgb(name).unwrap();
    let (exact, tracer, visibility) = (of("exact"), of("tracer"), of("visibility"));
    assert!(of("noise").iter().any(|pixel| pixel.length() > 0.0));
    for ((exact, tracer), visibility) in exact.iter().zip(tracer).zip(visibility) {
        assert!((*exact + visibility - tracer).length() < 1e-5);
    }
}

#[test]
fn distances_are_judged_where_there_are_any() {
    let folder = tempfile::tempdir().unwrap();
    let boxes = certificate(folder.path(), &["--tracer=bvh-boxes"]);
    assert_eq!(boxes["picture"]["quantity"], "ao");
    let [camera, shadow] = [0, 2].map(|index| &boxes["rays"][index]);
    assert_eq!(
        (&camera["kind"], &shadow["kind"]),
        (&"camera".into(), &"shadow".into())
    );
    assert!(camera.get("early").is_some() && shadow.get("early").is_none());
    // Boxes hide more than what is in them, and let nothing through.
    assert!(number(&camera["false_misses"]) == 0.0 && number(&camera["early"]) > 0.0);
    assert!(number(&boxes["picture"]["visibility"]["bias"]) < -0.01);
}

#[test]
fn what_cannot_be_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (more, expected) in [
        (
            &["--tracer=bvh-boxes", "--quantity=indirect"][..],
            "choose ao",
        ),
        (&["--tracer=ldi", "--quantity=obscurance"], "--d-max"),
        (&["--tracer=ldi", "-o", "certificate.jpg"], "unknown suffix"),
        (
            &["--tracer=bvh", "--ldi-cells=2"],
            "--ldi-cells has no effect",
        ),
        (
            &["--tracer=ldi", "--quantity=direct", "--d-max=0.5"],
            "light comes from everywhere",
        ),
        // What is chosen unless a quantity is given is indirect.
        (
            &["--tracer=ldi", "--d-max=0.5"],
            "light comes from everywhere",
        ),
        (&["--tracer=ldi", "--size=16384x16384"], "GiB"),
        (&["--tracer=compute-bvh"], "runs on a GPU"),
    ] {
        let output = Command::new(cargo_bin!("isophote"))
            .args(QUICK)
            .args(more)
            .current_dir(folder.path())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{more:?}: {said}");
        assert!(
            said.lines().count() == 1 && said.contains(expected),
            "{more:?}: {said}"
        );
    }
}
