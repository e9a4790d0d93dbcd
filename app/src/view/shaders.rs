//! Shaders of a checkout, watched while they are worked on.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    time::{Instant, SystemTime},
};

use anyhow::{Context, Result, ensure};

/// How deep modules lie below a crate's `shaders`.
const DEPTH: u32 = 4;

/// A checkout, and when its shaders were changed.
pub(super) struct Shaders {
    checkout: PathBuf,
    seen: BTreeMap<PathBuf, SystemTime>,
    looked: Option<Instant>,
}

impl Shaders {
    pub(super) fn new(checkout: PathBuf) -> Self {
        Self {
            checkout,
            seen: BTreeMap::new(),
            looked: None,
        }
    }

    /// The texts of all modules, by `crate/shaders/module.wesl`, where one was changed since the last time.
    pub(super) fn changed(&mut self) -> Option<Result<BTreeMap<String, String>>> {
        // Looking is not for nothing, and the thread may ask often.
        if self
            .looked
            .is_some_and(|looked| looked.elapsed() < super::worker::LOOK / 2)
        {
            return None;
        }
        self.looked = Some(Instant::now());
        let files = self.files();
        if files == self.seen {
            return None;
        }
        let texts = self.read(&files);
        self.seen = files;
        Some(texts)
    }

    /// When each was changed.
    fn files(&self) -> BTreeMap<PathBuf, SystemTime> {
        let mut files = BTreeMap::new();
        for one in fs::read_dir(&self.checkout).into_iter().flatten().flatten() {
            collect(&one.path().join("shaders"), DEPTH, &mut files);
        }
        files
    }

    fn read(&self, files: &BTreeMap<PathBuf, SystemTime>) -> Result<BTreeMap<String, String>> {
        ensure!(
            !files.is_empty(),
            "--shaders: {} holds no CRATE/shaders/*.wesl; give a checkout of Isophote",
            self.checkout.display()
        );
        let read = |path: &PathBuf| {
            let text = fs::read_to_string(path);
            let text = text.with_context(|| format!("cannot read {}", path.display()))?;
            let below = path.strip_prefix(&self.checkout).unwrap_or(path);
            let parts = below.iter().map(|part| part.to_string_lossy());
            Ok((parts.collect::<Vec<_>>().join("/"), text))
        };
        files.keys().map(read).collect()
    }
}

fn collect(folder: &Path, depth: u32, files: &mut BTreeMap<PathBuf, SystemTime>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let Ok(metadata) = entry.metadata() else {
            continue;
        };
        if metadata.is_dir() && depth > 0 {
            collect(&path, depth - 1, files);
        } else if path.extension().is_some_and(|suffix| suffix == "wesl")
            && let Ok(time) = metadata.modified()
        {
            files.insert(path, time);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_are_seen_once() {
        let folder = tempfile::tempdir().unwrap();
        let mut shaders = Shaders::new(folder.path().to_owned());
        let mut look = || {
            shaders.looked = None;
            shaders.changed()
        };
        assert!(look().is_none());
        let deep = folder.path().join("scene/shaders/tracer");
        fs::create_dir_all(&deep).unwrap();
        let file = deep.join("a.wesl");
        fs::write(&file, "old").unwrap();
        fs::write(deep.join("a.txt"), "no shader").unwrap();
        let texts = look().unwrap().unwrap();
        assert_eq!(texts.len(), 1);
        assert_eq!(texts["scene/shaders/tracer/a.wesl"], "old");
        assert!(look().is_none());
        fs::remove_file(&file).unwrap();
        assert!(look().unwrap().is_err());
    }
}
