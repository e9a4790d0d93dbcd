//! Reading the files a scene consists of.

use std::{
    cell::RefCell,
    collections::HashMap,
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

use super::budget::{Borrowed, Budget};
use crate::{Error, Result};

/// Reads a whole file within the budget.
pub(super) fn read<'a>(path: &Path, budget: &'a Budget<'_>) -> Result<(Vec<u8>, Borrowed<'a>)> {
    let io = |source| Error::io(path, source);
    // Opening a pipe would wait for a writer.
    let metadata = std::fs::metadata(path).map_err(io)?;
    if !metadata.is_file() {
        return Err(Error::malformed(path, "is not a file"));
    }
    let size = metadata.len();
    let borrowed = budget.borrow(&format!("reading {}", path.display()), size)?;
    let mut bytes = Vec::with_capacity(size as usize);
    // Files in /proc say 0 and give more.
    let file = File::open(path).map_err(io)?;
    file.take(size).read_to_end(&mut bytes).map_err(io)?;
    Ok((bytes, borrowed))
}

/// Finds the files that others refer to.
#[derive(Default)]
pub(super) struct Finder {
    /// What is in a folder, by lower-case name.
    listings: RefCell<HashMap<PathBuf, HashMap<String, PathBuf>>>,
}

impl Finder {
    /// The file that `name` means in a file of a scene, searched beside that: as named; with the slashes of another
    /// system; in the same folder only; and with capitals that do not count, as on other systems.
    pub(super) fn beside(&self, file: &Path, name: &str) -> Option<PathBuf> {
        let folder = file.parent().unwrap_or(Path::new(""));
        let slashed = name.replace('\\', "/");
        let base = slashed.rsplit('/').next().unwrap_or(&slashed);
        let mut names = vec![name, &slashed, base];
        names.dedup();
        names.retain(|name| !name.is_empty() && !name.contains('\0'));
        let paths = || names.iter().map(|name| folder.join(name));
        paths()
            .find(|path| path.is_file())
            .or_else(|| paths().find_map(|path| self.ignoring_case(&path)))
    }

    /// The file in a path's folder whose name differs in nothing but case.
    fn ignoring_case(&self, path: &Path) -> Option<PathBuf> {
        // Enough for any scene; a file can name folders and files without end.
        const MOST_FOLDERS: usize = 100;
        const MOST_FILES: usize = 10_000;
        let name = path.file_name()?.to_str()?.to_lowercase();
        let folder = match path.parent()? {
            folder if folder.as_os_str().is_empty() => Path::new("."),
            folder => folder,
        };
        let mut listings = self.listings.borrow_mut();
        if !listings.contains_key(folder) && listings.len() < MOST_FOLDERS {
            let entries = std::fs::read_dir(folder).ok()?.take(MOST_FILES).flatten();
            let named = entries.map(|entry| {
                let name = entry.file_name().to_string_lossy().to_lowercase();
                (name, entry.path())
            });
            listings.insert(folder.to_owned(), named.collect());
        }
        let found = listings.get(folder)?.get(&name)?;
        found.is_file().then(|| found.clone())
    }
}
