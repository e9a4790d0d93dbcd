//! What the tests of the loaders share. Each test binary uses a part of it.
#![allow(dead_code, reason = "no test binary uses all of it")]
#![allow(clippy::unwrap_used, reason = "a test may fail")]

pub(crate) mod check;
pub(crate) mod gltf;
pub(crate) mod seeds;

use std::{
    fs,
    path::{Path, PathBuf},
};

use isophote_scene::{LoadOptions, Result, Scene, load_with};

/// A folder beside the workspace, if it is there; says so if not.
pub(crate) fn shared(folder: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")).join(folder);
    let found = path.is_dir();
    if !found {
        eprintln!("skipped: {} is absent", path.display());
    }
    found.then_some(path)
}

/// All scenes in a folder and those below it.
pub(crate) fn models(folder: &Path) -> Vec<PathBuf> {
    let mut models = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let suffix = path.extension().and_then(|suffix| suffix.to_str());
        if path.is_dir() {
            models.extend(self::models(&path));
        } else if matches!(suffix, Some("glb" | "gltf" | "obj")) {
            models.push(path);
        }
    }
    models.sort();
    models
}

/// An empty folder, in memory where the system has such: thousands of small files take minutes on a disk.
pub(crate) fn folder() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    let made = if memory.is_dir() {
        tempfile::tempdir_in(memory)
    } else {
        tempfile::tempdir()
    };
    made.unwrap()
}

/// Files of one scene: name and content, the scene's own file first.
#[derive(Clone)]
pub(crate) struct Files(pub(crate) Vec<(String, Vec<u8>)>);

impl Files {
    /// A scene of one file.
    pub(crate) fn one(name: &str, content: impl Into<Vec<u8>>) -> Self {
        Self(vec![(name.into(), content.into())])
    }

    /// The same with one file more.
    pub(crate) fn and(mut self, name: &str, content: impl Into<Vec<u8>>) -> Self {
        self.0.push((name.into(), content.into()));
        self
    }

    /// Writes the files to a folder of their own and loads the first.
    pub(crate) fn load(&self) -> Result<Scene> {
        self.load_with(&LoadOptions::default())
    }

    pub(crate) fn load_with(&self, options: &LoadOptions) -> Result<Scene> {
        let folder = folder();
        for (name, content) in &self.0 {
            fs::write(folder.path().join(name), content).unwrap();
        }
        load_with(&folder.path().join(&self.0[0].0), options)
    }
}

/// A PNG of 2×2 texels: red, green, blue, and transparent white.
pub(crate) fn png() -> Vec<u8> {
    let texels = [
        [255, 0, 0, 255],
        [0, 255, 0, 255],
        [0, 0, 255, 255],
        [255, 255, 255, 0],
    ];
    let image = image::RgbaImage::from_raw(2, 2, texels.concat()).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}
