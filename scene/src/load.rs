//! From a file to a [`Scene`].
//!
//! [`load`] chooses the format by the file's suffix. Whatever a loader cannot keep is said in
//! [`Scene::report`]: ignored features as warnings, dropped triangles as numbers. What makes the rest of a file
//! meaningless is an [`Error`].
//!
//! No number in a file is trusted: sizes are checked against the bytes that are really there, and what cannot be
//! checked so (texture sizes, repeated references) is claimed from a memory budget before it is allocated.

#[cfg(any(feature = "gltf", feature = "obj"))]
mod budget;
#[cfg(any(feature = "gltf", feature = "obj"))]
mod context;
#[cfg(any(feature = "gltf", feature = "obj"))]
mod files;
#[cfg(feature = "gltf")]
mod gltf;
#[cfg(feature = "obj")]
mod obj;
#[cfg(feature = "obj")]
mod pool;
#[cfg(any(feature = "gltf", feature = "obj"))]
mod texture;
#[cfg(any(feature = "gltf", feature = "obj"))]
mod warnings;

use std::path::Path;

#[cfg(feature = "gltf")]
pub use self::gltf::{GltfElements, GltfInstance, GltfMesh, GltfPrimitive, GltfSource, load_gltf};
use crate::{Error, Result, Scene};

/// What to load of a file, and how much memory that may take.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoadOptions {
    /// Name or number (from 0) of the scene in a glTF file; `None` is the file's default scene.
    pub scene: Option<String>,
    /// Most bytes that may be held at any moment, an upper estimate; 1 GiB unless changed. A file that needs more
    /// is refused with [`Error::TooLarge`].
    pub memory_limit: u64,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self {
            scene: None,
            memory_limit: 1 << 30,
        }
    }
}

/// Loads a scene: `.glb` and `.gltf` (feature `gltf`), `.obj` with its `.mtl` (feature `obj`).
///
/// A file without geometry gives a scene without instances.
///
/// # Errors
/// If the file cannot be read, contradicts itself, requires an unsupported feature, needs more than 1 GiB, or has
/// an unknown suffix.
pub fn load(path: &Path) -> Result<Scene> {
    load_with(path, &LoadOptions::default())
}

/// As [`load`], with options.
///
/// # Errors
/// As [`load`], and if there is no such scene in the file.
pub fn load_with(path: &Path, options: &LoadOptions) -> Result<Scene> {
    let suffix = path.extension().unwrap_or_default().to_string_lossy();
    let format = FORMATS
        .iter()
        .find(|(known, _)| suffix.eq_ignore_ascii_case(known));
    match format {
        Some((_, load)) => load(path, options),
        None => Err(Error::UnknownFormat {
            path: path.to_owned(),
            known: KNOWN,
        }),
    }
}

type Loader = fn(&Path, &LoadOptions) -> Result<Scene>;

/// Suffixes and what loads them.
const FORMATS: &[(&str, Loader)] = &[
    #[cfg(feature = "gltf")]
    ("glb", gltf::load),
    #[cfg(feature = "gltf")]
    ("gltf", gltf::load),
    #[cfg(feature = "obj")]
    ("obj", obj::load),
];

/// The suffixes for people.
const KNOWN: &str = match (cfg!(feature = "gltf"), cfg!(feature = "obj")) {
    (true, true) => ".glb, .gltf and .obj",
    (true, false) => ".glb and .gltf",
    (false, true) => ".obj",
    (false, false) => "none, in this build,",
};
