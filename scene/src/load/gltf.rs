//! glTF 2.0: `.gltf` with external or embedded buffers, and `.glb`.
//!
//! The way of a file: [`container`] finds the JSON and the binary chunk; [`document`] holds both and answers
//! questions about extensions; [`buffers`] gives the bytes of a view and [`accessor`] the numbers in them, checked
//! against the bytes that are there. [`nodes`] walks the chosen scene and asks [`meshes`] for what it meets, which
//! ask [`materials`], which ask [`textures`]; so what the scene does not use costs nothing and cannot fail.
//! [`source`] keeps the file as it was, for who writes it again. [`instancing`] multiplies a node's mesh; [`animations`] moves the nodes that were met.
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
mod source;
mod textures;

use std::path::Path;

pub use self::source::{GltfElements, GltfInstance, GltfMesh, GltfPrimitive, GltfSource};
use self::{buffers::Fetched, document::Document};
use super::{LoadOptions, budget::Budget, context::Context};
use crate::{Result, Scene};

/// Loads a glTF file, whatever of the two suffixes it has.
pub(super) fn load(path: &Path, options: &LoadOptions) -> Result<Scene> {
    let budget = Budget::new(path, options.memory_limit);
    let context = Context::new(path, &budget);
    let file = context.read(path)?;
    let document = Document::new(context, &budget, file)?;
    let (scene, _) = nodes::load(&document, options.scene.as_deref())?;
    Ok(document.finish(scene))
}

/// Loads a glTF file as [`load_with`](crate::load_with) does, and keeps what else it held.
///
/// # Errors
/// As [`load_with`](crate::load_with); what is kept counts against the memory limit too.
pub fn load_gltf(path: &Path, options: &LoadOptions) -> Result<(Scene, GltfSource)> {
    let budget = Budget::new(path, options.memory_limit);
    let context = Context::new(path, &budget);
    let (bytes, held): Fetched<'_> = context.read(path)?;
    let _copy = budget.borrow("a copy of the file", bytes.len() as u64)?;
    let document = Document::new(context, &budget, (bytes.clone(), held))?;
    let (scene, origins) = nodes::load(&document, options.scene.as_deref())?;
    let source = document.source(&bytes, origins)?;
    Ok((document.finish(scene), source))
}
