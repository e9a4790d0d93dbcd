//! Models made by others, many of them wrong on purpose, in `../shared/corpora` where that folder is.
#![cfg(all(feature = "gltf", feature = "obj"))]

mod support;

use std::{fs, path::Path};

use isophote_scene::{Error, load};
use serde_json::Value;
use support::{check::check, models, shared};

/// Loads a model, and checks it if that succeeds.
fn try_load(path: &Path) -> Result<usize, Error> {
    let scene = load(path)?;
    check(&scene);
    Ok(scene.triangle_count())
}

#[test]
fn what_the_khronos_validator_finds_no_error_in_loads() {
    let Some(folder) = shared("corpora/gltf-validator") else {
        return;
    };
    let (mut valid, mut wrong, mut refused) = (0, 0, 0);
    for path in models(&folder) {
        let report = fs::read(format!("{}.report.json", path.display())).unwrap();
        let report: Value = serde_json::from_slice(&report).unwrap();
        let result = try_load(&path);
        if report["issues"]["numErrors"] == 0 {
            valid += 1;
            result.unwrap();
        } else {
            wrong += 1;
            refused += usize::from(result.is_err());
        }
    }
    eprintln!("{valid} valid files loaded; {refused} of {wrong} wrong ones were refused");
    assert!(valid >= 70 && wrong >= 150);
}

/// Folders of assimp's glTF models that are meant to fail, or need an extension that is not supported.
const REFUSED: [&str; 6] = [
    "BoxTextured-glTF-techniqueWebGL",
    "MissingBin",
    "RecursiveNodes",
    "SchemaFailures",
    "draco",
    "wrongTypes",
];

#[test]
fn assimps_models_load_or_name_what_they_need() {
    let Some(folder) = shared("corpora/assimp") else {
        return;
    };
    for path in models(&folder) {
        let expected = REFUSED
            .iter()
            .any(|name| path.components().any(|part| part.as_os_str() == *name));
        match try_load(&path) {
            Ok(_) => assert!(!expected, "{} should be refused", path.display()),
            Err(error) => assert!(expected, "{error}"),
        }
    }
}

/// Triangles of every face in the file with at least three corners.
fn triangles_in(text: &str) -> usize {
    let text = text.replace("\\\n", " ").replace("\\\r\n", " ");
    text.lines()
        .filter_map(|line| line.trim().strip_prefix("f "))
        .map(|face| {
            face.split('#')
                .next()
                .unwrap_or(face)
                .split_whitespace()
                .count()
        })
        .map(|corners| corners.saturating_sub(2))
        .sum()
}

#[test]
fn obj_models_keep_every_face() {
    for folder in ["corpora/tinyobjloader", "corpora/assimp/OBJ"] {
        let Some(folder) = shared(folder) else {
            return;
        };
        for path in models(&folder) {
            let scene = load(&path).unwrap();
            check(&scene);
            let bytes = fs::read(&path).unwrap();
            let text = match bytes.strip_prefix(b"\xFE\xFF") {
                Some(utf16) => {
                    let units = utf16.as_chunks::<2>().0.iter();
                    String::from_utf16_lossy(
                        &units
                            .map(|unit| u16::from_be_bytes(*unit))
                            .collect::<Vec<_>>(),
                    )
                }
                None => String::from_utf8_lossy(&bytes).into_owned(),
            };
            let found = scene.triangle_count() as u64 + scene.report.dropped.total();
            assert_eq!(found, triangles_in(&text) as u64, "{}", path.display());
        }
    }
}
