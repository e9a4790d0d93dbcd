//! How much memory a file may still take.

use std::{cell::Cell, path::Path};

use crate::{Error, Result};

/// Bytes that may be held while one file is loaded. Every allocation whose size is a file's word is claimed first.
pub(super) struct Budget<'a> {
    path: &'a Path,
    limit: u64,
    held: Cell<u64>,
}

impl<'a> Budget<'a> {
    pub(super) fn new(path: &'a Path, limit: u64) -> Self {
        Self {
            path,
            limit,
            held: Cell::new(0),
        }
    }

    /// Claims memory for good.
    pub(super) fn claim(&self, what: &str, bytes: u64) -> Result<()> {
        let held = self.held.get().saturating_add(bytes);
        if held > self.limit {
            return Err(Error::TooLarge {
                path: self.path.to_owned(),
                what: what.to_owned(),
                bytes: held,
                limit: self.limit,
            });
        }
        self.held.set(held);
        Ok(())
    }

    /// Claims memory until the returned guard is dropped.
    pub(super) fn borrow(&self, what: &str, bytes: u64) -> Result<Borrowed<'_>> {
        self.claim(what, bytes)?;
        Ok(Borrowed {
            held: &self.held,
            bytes,
        })
    }

    /// What is left to claim, in bytes.
    pub(super) fn left(&self) -> u64 {
        self.limit - self.held.get()
    }
}

/// Memory that is given back to its [`Budget`] on drop.
pub(super) struct Borrowed<'a> {
    held: &'a Cell<u64>,
    bytes: u64,
}

impl Borrowed<'_> {
    /// Never gives it back.
    pub(super) fn keep(self) {
        std::mem::forget(self);
    }
}

impl Drop for Borrowed<'_> {
    fn drop(&mut self) {
        self.held.set(self.held.get() - self.bytes);
    }
}

/// `count` things of `size` bytes.
pub(super) fn bytes_of(count: usize, size: usize) -> u64 {
    (count as u64).saturating_mul(size as u64)
}
