//! glTF 2.0: `.gltf` with external or embedded buffers, and `.glb`.
//!
//! The way of a file: [`container`] finds the JSON and the binary chunk; [`document`] holds both and answers
//! questions about extensions; [`buffers`] gives the bytes of a view and [`accessor`] the numbers in them, checked
//! against the bytes that are there. [`nodes`] walks the chosen scene and asks [`meshes`] for what it meets, which
//! ask [`materials`], which ask [`textures`]; so what the scene does not use costs nothing and cannot fail.
//! [`instancing`] multiplies a node's mesh; [`animations`] moves the nodes that were met.
//!
//! Ignored, with a warning: points and lines, normal and occlusion maps, skins, morph targets, optional extensions
//! that are not in [`document::SUPPORTED`].

mod accessor;
mod animations;
mod buffers;
mod container;
mod document;
mod instancing;
mod materials;
mod meshes;
mod meshopt;
mod nodes;
mod textures;

use std::path::Path;

use self::document::Document;
use super::{LoadOptions, budget::Budget};
use crate::{Result, Scene};

/// Loads a glTF file, whatever of the two suffixes it has.
pub(super) fn load(path: &Path, options: &LoadOptions) -> Result<Scene> {
    let budget = Budget::new(path, options.memory_limit);
    let document = Document::open(path, &budget)?;
    let scene = nodes::load(&document, options.scene.as_deref())?;
    Ok(document.finish(scene))
}
