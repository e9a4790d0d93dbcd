//! What every part of a loader needs.

use std::path::{Path, PathBuf};

use super::{
    budget::{Borrowed, Budget},
    files::{self, Finder},
    texture::{self, Pixels},
    warnings::Warnings,
};
use crate::{Dropped, Error, LoadReport, Result, Scene};

/// A file that is being loaded, and what it has led to so far.
pub(super) struct Context<'a> {
    /// The scene's own file.
    pub(super) path: &'a Path,
    pub(super) budget: &'a Budget<'a>,
    warnings: Warnings,
    finder: Finder,
}

impl<'a> Context<'a> {
    pub(super) fn new(path: &'a Path, budget: &'a Budget<'a>) -> Self {
        Self {
            path,
            budget,
            warnings: Warnings::default(),
            finder: Finder::default(),
        }
    }

    pub(super) fn warn(&self, line: impl Into<String>) {
        self.warnings.add(line);
    }

    pub(super) fn malformed(&self, reason: impl Into<String>) -> Error {
        Error::malformed(self.path, reason)
    }

    /// The file that `name` means in one of the scene's files.
    pub(super) fn find(&self, file: &Path, name: &str) -> Option<PathBuf> {
        self.finder.beside(file, name)
    }

    /// A whole file.
    pub(super) fn read(&self, path: &Path) -> Result<(Vec<u8>, Borrowed<'a>)> {
        files::read(path, self.budget)
    }

    /// A decoded image; one that cannot be decoded is a warning.
    pub(super) fn pixels(&self, bytes: &[u8], name: &str) -> Result<Option<Pixels<'a>>> {
        texture::decode(bytes, name, self.budget, &self.warnings)
    }

    /// What became of an optional part of the scene: without it the scene loads, unless memory is lacking.
    pub(super) fn optional<T>(&self, part: Result<T>) -> Result<Option<T>> {
        match part {
            Ok(part) => Ok(Some(part)),
            Err(error @ Error::TooLarge { .. }) => Err(error),
            Err(error) => {
                self.warn(error.to_string());
                Ok(None)
            }
        }
    }

    /// The scene with the report of how it was loaded.
    pub(super) fn finish(self, mut scene: Scene, dropped: Dropped) -> Scene {
        scene.report = LoadReport {
            warnings: self.warnings.into_lines(),
            dropped,
        };
        scene
    }
}
