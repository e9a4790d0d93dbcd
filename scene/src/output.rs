//! Files that appear whole or not at all.

use std::{
    fs::{File, Permissions},
    io::{BufWriter, Error as IoError, ErrorKind, Write},
    path::{Path, PathBuf},
};

use tempfile::NamedTempFile;

use crate::{Error, Result};

/// Writes a file so that it is either whole or untouched: into a temporary file of the same folder, which then takes
/// its name.
///
/// An error of `write` is returned as it is, and a file that existed before stays as it was. On Linux the temporary file has
/// no name until it is whole, so that nothing of it is left when the process is killed.
///
/// # Errors
/// What `write` returns, and [`Error::Io`] as for [`check_writable`] or when the disk is full.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> Result<()>,
) -> Result<()> {
    let target = check_target(path)?;
    let mut temporary = Temporary::beside(path, &target)?;
    let mut writer = BufWriter::with_capacity(1 << 20, temporary.file());
    write(&mut writer)?;
    writer.flush().map_err(|source| Error::io(path, source))?;
    drop(writer);
    let done = temporary.file().sync_all();
    done.and_then(|()| temporary.rename(&target))
        .map_err(|source| Error::io(path, source))
}

/// Whether [`write_atomically`] could write a file now. Worth asking before hours of work.
///
/// # Errors
/// [`Error::Io`] when the folder is missing or read-only, or when something that is not a writable file has the name.
pub fn check_writable(path: &Path) -> Result<()> {
    let target = check_target(path)?;
    Temporary::beside(path, &target).map(drop)
}

/// The file to replace: what a symbolic link points at, and nothing but a regular, writable file.
fn check_target(path: &Path) -> Result<PathBuf> {
    let refuse = |kind, reason: &str| Err(Error::io(path, IoError::new(kind, reason)));
    let metadata = match std::fs::metadata(path) {
        Ok(metadata) => metadata,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(path.to_owned()),
        Err(error) => return Err(Error::io(path, error)),
    };
    if metadata.is_dir() {
        return refuse(ErrorKind::IsADirectory, "is a folder, not a file");
    }
    // Renaming over a device would replace it.
    if !metadata.is_file() {
        return refuse(ErrorKind::InvalidInput, "is not a regular file");
    }
    if metadata.permissions().readonly() {
        return refuse(ErrorKind::PermissionDenied, "exists and is read-only");
    }
    path.canonicalize().map_err(|error| Error::io(path, error))
}

/// A file that is not yet what it is to be.
enum Temporary {
    #[cfg(target_os = "linux")]
    Unnamed(File),
    Named(NamedTempFile),
}

const PREFIX: &str = ".isophote-";

impl Temporary {
    fn beside(path: &Path, target: &Path) -> Result<Self> {
        let folder = folder_of(target);
        #[cfg(target_os = "linux")]
        if let Some(file) = unnamed(folder, target) {
            return Ok(Self::Unnamed(file));
        }
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX);
        if let Some(permissions) = permissions_of(target) {
            builder.permissions(permissions);
        }
        builder
            .tempfile_in(folder)
            .map(Self::Named)
            .map_err(|error| {
                let reason = match error.kind() {
                    ErrorKind::NotFound if !folder.exists() => {
                        format!("the folder {} does not exist", folder.display())
                    }
                    _ => format!("cannot write in the folder {}: {error}", folder.display()),
                };
                Error::io(path, IoError::new(error.kind(), reason))
            })
    }

    fn file(&mut self) -> &mut File {
        match self {
            #[cfg(target_os = "linux")]
            Self::Unnamed(file) => file,
            Self::Named(file) => file.as_file_mut(),
        }
    }

    fn rename(self, target: &Path) -> std::io::Result<()> {
        match self {
            #[cfg(target_os = "linux")]
            Self::Unnamed(file) => named(&file, folder_of(target))?.persist(target)?,
            Self::Named(file) => file.persist(target).map(drop)?,
        }
        Ok(())
    }
}

fn folder_of(target: &Path) -> &Path {
    match target.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// A file without a name, where the file system knows such, with the rights that [`permissions_of`] tells of.
#[cfg(target_os = "linux")]
fn unnamed(folder: &Path, target: &Path) -> Option<File> {
    use rustix::fs::{Mode, OFlags, open};
    let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
    let file = File::from(open(folder, flags, Mode::from_raw_mode(0o666)).ok()?);
    if let Ok(metadata) = std::fs::metadata(target) {
        file.set_permissions(metadata.permissions()).ok()?;
    }
    Some(file)
}

/// Gives a file without a name one. No other file can be replaced in this way, hence a rename is to follow.
#[cfg(target_os = "linux")]
fn named(file: &File, folder: &Path) -> std::io::Result<tempfile::TempPath> {
    use std::os::fd::AsRawFd;

    use rustix::fs::{AtFlags, CWD, linkat};
    let link = format!("/proc/self/fd/{}", file.as_raw_fd());
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX);
    let named = builder.make_in(folder, |path| {
        linkat(CWD, &link, CWD, path, AtFlags::SYMLINK_FOLLOW).map_err(IoError::from)
    })?;
    Ok(named.into_temp_path())
}

/// The rights the file has, or those that any new file gets: a temporary file's own rights are for its owner only.
#[cfg(unix)]
fn permissions_of(target: &Path) -> Option<Permissions> {
    use std::os::unix::fs::PermissionsExt;
    Some(match std::fs::metadata(target) {
        Ok(metadata) => metadata.permissions(),
        Err(_) => Permissions::from_mode(0o666),
    })
}

#[cfg(not(unix))]
fn permissions_of(_: &Path) -> Option<Permissions> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_failure_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let put = |text: &'static str| {
            write_atomically(&path, |writer| {
                writer
                    .write_all(text.as_bytes())
                    .map_err(|error| Error::io(&path, error))
            })
        };
        put("first").unwrap();
        put("second").unwrap();
        let failed = write_atomically(&path, |writer| {
            writer.write_all(b"half").unwrap();
            Err(Error::malformed(&path, "on purpose"))
        });
        assert!(matches!(failed, Err(Error::Malformed { .. })));
        // Whoever is killed here leaves nothing.
        if cfg!(target_os = "linux") {
            write_atomically(&path, |_| {
                assert_eq!(names(folder.path()), ["a.txt"]);
                Ok(())
            })
            .unwrap();
            put("second").unwrap();
        }
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "second");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn what_cannot_be_written_is_found_before() {
        let folder = tempfile::tempdir().unwrap();
        let fails = |path: &Path, part: &str| {
            let message = check_writable(path).unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        };
        fails(folder.path(), "is a folder");
        fails(&folder.path().join("no/such/a.txt"), "does not exist");
        let read_only = folder.path().join("a.txt");
        std::fs::write(&read_only, "old").unwrap();
        let mut permissions = std::fs::metadata(&read_only).unwrap().permissions();
        permissions.set_readonly(true);
        std::fs::set_permissions(&read_only, permissions).unwrap();
        fails(&read_only, "read-only");
        if cfg!(unix) {
            fails(Path::new("/dev/null"), "not a regular file");
        }
        check_writable(&folder.path().join("new.txt")).unwrap();
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_rights_kept() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        std::fs::write(&file, "old").unwrap();
        std::fs::set_permissions(&file, Permissions::from_mode(0o640)).unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_atomically(&link, |_| Ok(())).unwrap();
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "");
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        let mode = std::fs::metadata(&file).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o640);
    }
}
