//! Files made by others, many of them wrong on purpose, in `../shared/corpora` where that folder is.

use std::path::{Path, PathBuf};

use crate::{Place, validator};

/// All .gltf and .glb files below a folder.
fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    for path in paths {
        let suffix = path.extension().unwrap_or_default();
        if path.is_dir() {
            files(&path, found);
        } else if suffix == "gltf" || suffix == "glb" {
            found.push(path);
        }
    }
}

/// An error or a file, never a panic; and what was without errors stays so.
#[test]
fn odd_files_are_baked_or_refused() {
    let shared = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/corpora"));
    if !shared.is_dir() {
        eprintln!("skipped: there is no {}", shared.display());
        return;
    }
    let mut all = Vec::new();
    files(&shared.join("gltf-validator"), &mut all);
    files(&shared.join("assimp/glTF2"), &mut all);
    let inputs: Vec<&Path> = all.iter().map(PathBuf::as_path).collect();
    let before = validator::errors(&inputs);
    let place = Place::new();
    let (mut outputs, mut sources) = (Vec::new(), Vec::new());
    for (number, (path, errors)) in all.iter().zip(before).enumerate() {
        for to in ["vertices", "texels --size 128"] {
            let name = format!("{number}-{}.glb", to.len());
            let mut command = place.command(&format!(
                "--to {to} --samples 1 --existing replace -q -o {name}"
            ));
            let output = command.arg(path).output().unwrap();
            let said = String::from_utf8_lossy(&output.stderr);
            match output.status.code() {
                Some(0) if errors.is_empty() => {
                    outputs.push(place.path(&name));
                    sources.push(path);
                }
                Some(0) => {}
                Some(2) => assert_eq!(said.lines().count(), 1, "{}: {said}", path.display()),
                code => panic!("{}: {code:?}: {said}", path.display()),
            }
        }
    }
    assert!(outputs.len() > 20, "{} files", outputs.len());
    let outputs: Vec<&Path> = outputs.iter().map(PathBuf::as_path).collect();
    for (source, errors) in sources.iter().zip(validator::errors(&outputs)) {
        assert!(errors.is_empty(), "{}: {errors:#?}", source.display());
    }
    eprintln!("{} files are baked", outputs.len());
}
