//! Files of numbers as they lie in memory, so that what took long to calculate is kept.
//!
//! ```text
//! start      16 bytes: what it is, its version, the order of bytes
//! header     as the kind of file has it
//! arrays     one after the other, as they lie in memory
//! checksum   16 bytes: SipHash-1-3 of all before
//! ```
//!
//! Nothing is taken from a file before its length and its checksum have been found right.

use std::{fs::File, hash::Hasher, io::Read, io::Write, path::Path};

use bytemuck::{Pod, Zeroable};
use siphasher::sip128::{Hasher128, SipHasher13};

use crate::{Error, Result, write_atomically};

/// Reads differently where bytes lie the other way round.
const BYTE_ORDER: u32 = 0x0102_0304;
const CHECKSUM: usize = 16;

/// A kind of file.
#[derive(Clone, Copy, Debug)]
pub struct Sealed {
    /// The file's first bytes.
    pub magic: [u8; 8],
    /// Of the header and what follows; files of another are refused.
    pub version: u32,
    /// What such a file holds, as it stands in errors: "maps".
    pub what: &'static str,
    /// What to do without the file, as it stands in errors: "build the maps anew".
    pub remedy: &'static str,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
struct Start {
    magic: [u8; 8],
    version: u32,
    byte_order: u32,
}

impl Sealed {
    /// Writes a header and arrays into a file, whole or not at all. Returns the file's length in bytes.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be written.
    pub fn write<H: Pod>(&self, path: &Path, header: &H, arrays: &[&[u8]]) -> Result<u64> {
        let start = self.start();
        let mut length = CHECKSUM as u64;
        write_atomically(path, |writer| {
            let mut hasher = SipHasher13::new();
            let front = [bytemuck::bytes_of(&start), bytemuck::bytes_of(header)];
            for part in front.into_iter().chain(arrays.iter().copied()) {
                hasher.write(part);
                length += part.len() as u64;
                writer
                    .write_all(part)
                    .map_err(|source| Error::io(path, source))?;
            }
            let sum = hasher.finish128().as_bytes();
            writer
                .write_all(&sum)
                .map_err(|source| Error::io(path, source))
        })?;
        Ok(length)
    }

    /// Reads a file's header and the bytes of its arrays. `length` says how many bytes the arrays must have by the
    /// header, or refuses it; only then are they read.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read, [`Error::Damaged`] when it is no such file or not as it was written,
    /// [`Error::Foreign`] when it is of another version, and what `length` returns.
    pub fn read<H: Pod>(
        &self,
        path: &Path,
        length: impl FnOnce(&H) -> Result<u64>,
    ) -> Result<(H, Vec<u8>)> {
        let fail = |source| Error::io(path, source);
        let mut file = File::open(path).map_err(fail)?;
        let found = file.metadata().map_err(fail)?.len();
        let mut front = vec![0; size_of::<Start>() + size_of::<H>()];
        let (start, header) = front.split_at_mut(size_of::<Start>());
        file.read_exact(start).map_err(|_| self.too_short(path))?;
        self.check(path, bytemuck::pod_read_unaligned(start))?;
        file.read_exact(header).map_err(|_| self.too_short(path))?;
        let header: H = bytemuck::pod_read_unaligned(header);
        // Only what is there is read, whatever the header says.
        let arrays = length(&header)?;
        if arrays.checked_add((front.len() + CHECKSUM) as u64) != Some(found) {
            let reason =
                "it is not as long as its header says: it was cut off, or something was added";
            return Err(self.damaged(path, reason));
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(fail)?;
        if (front.len() + bytes.len()) as u64 != found {
            return Err(self.damaged(path, "it changed while it was read"));
        }
        let sum = bytes.split_off(bytes.len() - CHECKSUM);
        let mut hasher = SipHasher13::new();
        hasher.write(&front);
        hasher.write(&bytes);
        if hasher.finish128().as_bytes()[..] != sum {
            return Err(self.damaged(path, "its checksum is wrong"));
        }
        Ok((header, bytes))
    }

    /// That a file is none of this kind, or not as it was written.
    pub fn damaged(&self, path: &Path, reason: &str) -> Error {
        Error::Damaged {
            path: path.to_owned(),
            reason: reason.to_owned(),
            remedy: self.remedy,
        }
    }

    /// That a file was made of something else than it is wanted for.
    pub fn foreign(&self, path: &Path, reason: &str) -> Error {
        Error::Foreign {
            path: path.to_owned(),
            reason: reason.to_owned(),
            remedy: self.remedy,
        }
    }

    fn start(&self) -> Start {
        Start {
            magic: self.magic,
            version: self.version,
            byte_order: BYTE_ORDER,
        }
    }

    fn check(&self, path: &Path, start: Start) -> Result<()> {
        if start.magic != self.magic {
            return Err(self.damaged(path, &format!("it is no file of {}", self.what)));
        }
        if start != self.start() {
            let reason = "it was saved by another version or on another kind of processor";
            return Err(self.foreign(path, reason));
        }
        Ok(())
    }

    fn too_short(&self, path: &Path) -> Error {
        self.damaged(path, &format!("it is too short to hold {}", self.what))
    }
}

/// The next array of bytes whose number is known to be right.
///
/// # Panics
/// When there are fewer than `count` values.
pub fn take<T: Pod>(rest: &mut &[u8], count: usize) -> Vec<T> {
    let (now, later) = rest.split_at(count * size_of::<T>());
    *rest = later;
    let mut values = vec![T::zeroed(); count];
    bytemuck::cast_slice_mut(&mut values).copy_from_slice(now);
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    const FORMAT: Sealed = Sealed {
        magic: *b"ISOPHTST",
        version: 3,
        what: "numbers",
        remedy: "count anew",
    };

    fn read(path: &Path) -> Result<(u64, Vec<u8>)> {
        FORMAT.read(path, |&count: &u64| Ok(count.saturating_mul(4)))
    }

    #[test]
    fn what_is_written_is_read_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("numbers");
        let numbers = [1_u32, 2, 3];
        let length = FORMAT
            .write(&path, &3_u64, &[bytemuck::cast_slice(&numbers)])
            .unwrap();
        let whole = std::fs::read(&path).unwrap();
        assert_eq!(whole.len() as u64, length);
        let (count, bytes) = read(&path).unwrap();
        assert_eq!(take::<u32>(&mut &bytes[..], count as usize), numbers);
        for cut in 0..whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            assert!(matches!(read(&path), Err(Error::Damaged { .. })), "{cut}");
        }
        for place in 0..whole.len() {
            let mut other = whole.clone();
            other[place] ^= 1;
            std::fs::write(&path, &other).unwrap();
            let error = read(&path).unwrap_err();
            let version = (8..16).contains(&place);
            assert_eq!(
                matches!(error, Error::Foreign { .. }),
                version,
                "{place}: {error}"
            );
            assert_eq!(
                matches!(error, Error::Damaged { .. }),
                !version,
                "{place}: {error}"
            );
            assert!(error.to_string().ends_with("; count anew"), "{error}");
        }
        let missing = read(&folder.path().join("none"));
        assert!(matches!(missing, Err(Error::Io { .. })));
    }
}
