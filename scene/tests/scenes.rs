//! The real scenes in `../shared/scenes`, where that folder is.
#![cfg(feature = "gltf")]

mod support;

use std::fs;

use isophote_scene::{Dropped, LightKind, load};
use support::{check::check, shared};

/// The first three columns of MANIFEST.md's table: name, triangles, textures.
fn manifest(text: &str) -> Vec<(String, usize, usize)> {
    text.lines()
        .filter_map(|line| {
            let mut columns = line.split('|').skip(1).map(str::trim);
            let name = columns.next()?.to_owned();
            let triangles = columns.next()?.replace(',', "").parse().ok()?;
            let textures = columns.next()?.parse().unwrap_or(0);
            Some((name, triangles, textures))
        })
        .collect()
}

#[test]
fn scenes_hold_what_their_manifest_says() {
    let Some(folder) = shared("scenes") else {
        return;
    };
    let rows = manifest(&fs::read_to_string(folder.join("MANIFEST.md")).unwrap());
    assert_eq!(rows.len(), 15);
    for (name, triangles, textures) in rows {
        let scene = load(&folder.join(&name).with_extension("glb")).unwrap();
        check(&scene);
        assert_eq!(scene.triangle_count(), triangles, "{name}");
        assert_eq!(scene.textures.len(), textures, "{name}");
        assert!(scene.camera("camera_main").is_some(), "{name}");
        assert!(!scene.lights.is_empty(), "{name}");
        let point = |kind| matches!(kind, LightKind::Point { .. });
        assert!(scene.lights.iter().all(|light| point(light.kind)), "{name}");
        assert_eq!(scene.report.dropped, Dropped::default(), "{name}");
        assert_eq!(scene.report.warnings, [""; 0], "{name}");
    }
}
