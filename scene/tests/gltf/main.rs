//! Every feature of glTF that is read, on files made here.
#![cfg(feature = "gltf")]
#![expect(clippy::unwrap_used, reason = "a test may fail")]

mod accessors;
mod broken;
mod instances;
mod materials;
mod meshes;
mod nodes;
#[path = "../support/mod.rs"]
mod support;

use glam::Vec3;
use isophote_scene::{Mesh, Scene};
use serde_json::json;

use crate::support::{
    Files,
    check::check,
    gltf::{Gltf, SQUARE},
    seeds,
};

pub(crate) fn loaded(files: &Files) -> Scene {
    let scene = files.load().unwrap();
    check(&scene);
    scene
}

/// The only mesh of a scene.
pub(crate) fn mesh(scene: &Scene) -> &Mesh {
    assert_eq!(scene.meshes.len(), 1);
    &scene.meshes[0]
}

/// The corners of all triangles of a mesh.
pub(crate) fn corners(mesh: &Mesh) -> Vec<[Vec3; 3]> {
    (0..mesh.triangles.len()).map(|i| mesh.corners(i)).collect()
}

/// The two triangles of [`SQUARE`].
pub(crate) fn square() -> Vec<[Vec3; 3]> {
    let [a, b, c, d] = SQUARE.map(Vec3::from);
    vec![[a, b, c], [a, c, d]]
}

/// A file with one primitive of these attributes, and what it loads as.
pub(crate) fn primitive(gltf: &mut Gltf, primitive: serde_json::Value) -> Scene {
    gltf.show(json!([primitive]));
    loaded(&gltf.glb())
}

pub(crate) fn message(files: &Files) -> String {
    files.load().unwrap_err().to_string()
}

#[test]
fn binary_embedded_and_external_files_are_the_same() {
    let gltf = seeds::geometry();
    let [binary, embedded, external] =
        [gltf.glb(), gltf.embedded(), gltf.external()].map(|files| loaded(&files));
    assert_eq!(binary.meshes, embedded.meshes);
    assert_eq!(binary.meshes, external.meshes);
    assert_eq!(binary.instances, external.instances);
    let mut misnamed = gltf.glb();
    misnamed.0[0].0 = "scene.gltf".into();
    assert_eq!(loaded(&misnamed).meshes, binary.meshes);
}
