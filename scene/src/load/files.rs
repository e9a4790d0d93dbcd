//! Reading the files a scene consists of.

use std::{
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

/// The file that a scene means by `name`, searched beside the scene's own file: as named; with the slashes of
/// another system; in the same folder only; and with capitals that do not count, as on other systems.
pub(super) fn beside(scene: &Path, name: &str) -> Option<PathBuf> {
    let folder = scene.parent().unwrap_or(Path::new(""));
    let slashed = name.replace('\\', "/");
    let base = slashed.rsplit('/').next().unwrap_or(&slashed);
    let exact = [name, &slashed, base]
        .into_iter()
        .filter(|name| !name.is_empty() && !name.contains('\0'))
        .map(|name| folder.join(name));
    exact
        .chain(
            [folder.join(&slashed), folder.join(base)]
                .into_iter()
                .filter_map(|path| ignoring_case(&path)),
        )
        .find(|path| path.is_file())
}

/// The entry of a path's folder whose name differs in nothing but case.
fn ignoring_case(path: &Path) -> Option<PathBuf> {
    let name = path.file_name()?.to_str()?.to_lowercase();
    let folder = match path.parent()? {
        folder if folder.as_os_str().is_empty() => Path::new("."),
        folder => folder,
    };
    std::fs::read_dir(folder)
        .ok()?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .find(|path| {
            path.file_name()
                .and_then(|name| name.to_str())
                .is_some_and(|other| other.to_lowercase() == name)
        })
}
