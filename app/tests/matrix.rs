//! `isophote matrix`: every pair that can be is rendered, and none is black.

#![expect(clippy::unwrap_used, reason = "a test's helpers may fail the test")]

use std::{
    path::Path,
    process::{Command, Output},
};

use assert_cmd::cargo::cargo_bin;
use serde_json::Value;

const QUICK: [&str; 6] = [
    "matrix",
    "builtin:cornell",
    "--size=24x18",
    "--spp=16",
    "--reference-spp=256",
    "-q",
];

/// Everything small, and fields of everything.
const SMALL: [&str; 8] = [
    "--ldi-resolution=32",
    "--igi-paths=64",
    "--ldm-maps=32",
    "--ldm-resolution=32",
    "--ldm-photons=8",
    "--field-rings=4",
    "--field-resolution=8",
    "--field-least-triangles=2",
];

fn run(folder: &Path, more: &[&str]) -> Output {
    Command::new(cargo_bin!("isophote"))
        .args(QUICK)
        .args(more)
        .current_dir(folder)
        .output()
        .unwrap()
}

#[test]
fn every_pair_on_the_cpu_makes_its_picture() {
    let folder = tempfile::tempdir().unwrap();
    let all = [
        "--device=cpu",
        "--quantity=ao,indirect",
        "--json",
        "-o",
        "out",
    ];
    let output = run(folder.path(), &[&SMALL[..], &all].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let rows = found["rows"].as_array().unwrap();
    let of = |row: &Value| {
        ["quantity", "technique", "tracer"].map(|key| row[key].as_str().unwrap().to_owned())
    };
    let mut measured = 0;
    for row in rows {
        let what = of(row);
        assert!(row.get("failed").is_none(), "{row}");
        if let Some(why) = row.get("refused") {
            assert_eq!(why.as_str().unwrap().lines().count(), 1, "{row}");
            continue;
        }
        measured += 1;
        let number = |key: &str| row["measured"][key].as_f64();
        assert_eq!(row["measured"]["is_black"], false, "{row}");
        assert!(number("rel_rmse").unwrap() < 2.0, "{row}");
        assert!(number("reference_seconds").unwrap() > 0.0, "{row}");
        let picture = row["measured"]["picture"].as_str().unwrap();
        assert!(folder.path().join("out").join(picture).exists(), "{what:?}");
        if ["bvh", "brute-force", "ldi"].contains(&&what[2][..]) && what[1] != "ldm" {
            assert_eq!(number("leak_rate"), Some(0.0), "{what:?}");
        }
    }
    let has = |quantity: &str, technique: &str, tracer: &str| {
        let wanted = [quantity, technique, tracer];
        rows.iter()
            .any(|row| of(row) == wanted && row.get("measured").is_some())
    };
    for (quantity, technique, tracer) in [
        ("ao", "reference", "field"),
        ("ao", "ldm", "bvh"),
        ("indirect", "ldm", "bvh"),
        ("indirect", "igi", "field"),
        ("indirect", "igi", "bvh-boxes"),
        ("indirect", "ldi", "ldi"),
        ("indirect", "ldi", "brute-force"),
    ] {
        assert!(
            has(quantity, technique, tracer),
            "{quantity} by {technique} over {tracer}"
        );
    }
    assert!(measured >= 18, "{measured}");
    let page = std::fs::read_to_string(folder.path().join("out/index.html")).unwrap();
    assert!(
        page.contains("at equal error") && page.contains("<img src=\"igi-field-cpu-indirect.png\"")
    );
    let json = std::fs::read(folder.path().join("out/matrix.json")).unwrap();
    assert_eq!(serde_json::from_slice::<Value>(&json).unwrap(), found);
}

#[test]
fn a_tracer_that_cannot_be_of_the_scene_is_a_failure_that_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let flags = ["--tracer=field", "--technique=reference", "--quantity=ao"];
    let output = run(
        folder.path(),
        &[
            &flags[..],
            &["--device=cpu", "--field-least-triangles=1000"],
        ]
        .concat(),
    );
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains("FAILED") && said.contains("--field-least-triangles"),
        "{said}"
    );
}

#[test]
fn what_changes_no_row_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (flags, expected) in [
        (
            &["--technique=reference", "--tracer=bvh", "--igi-paths=7"][..],
            "--technique igi",
        ),
        (
            &["--technique=reference", "--tracer=bvh", "--ldi-cells=2"],
            "the tracer ldi",
        ),
        // The technique ldi is not for ao, so that its flags are for no row.
        (
            &[
                "--technique=ldi,reference",
                "--quantity=ao",
                "--ldi-samples=4",
            ],
            "--technique ldi",
        ),
        (&["--quantity=indirect", "--d-max=1"], "everywhere"),
        (&["--size=16384x16384"], "GiB"),
    ] {
        let output = run(folder.path(), flags);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{flags:?}: {said}");
        assert!(
            said.lines().count() == 1 && said.contains(expected),
            "{flags:?}: {said}"
        );
    }
}
