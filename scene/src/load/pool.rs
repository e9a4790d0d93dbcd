//! Lists that grow within the memory budget.

use super::budget::{Borrowed, Budget, bytes_of};
use crate::Result;

/// A list whose memory is claimed before it grows, for counts that are known only at the end.
pub(super) struct Pool<'a, T> {
    budget: &'a Budget<'a>,
    what: &'static str,
    values: Vec<T>,
    held: Option<Borrowed<'a>>,
}

impl<'a, T> Pool<'a, T> {
    /// An empty list; `what` it holds is for messages.
    pub(super) fn new(budget: &'a Budget<'a>, what: &'static str) -> Self {
        Self {
            budget,
            what,
            values: Vec::new(),
            held: None,
        }
    }

    pub(super) fn push(&mut self, value: T) -> Result<()> {
        if self.values.len() == self.values.capacity() {
            let capacity = (2 * self.values.len()).max(256);
            let bytes = bytes_of(capacity, size_of::<T>());
            // The old memory is given back only after the new one is filled.
            let held = self.budget.borrow(self.what, bytes)?;
            self.values.reserve_exact(capacity - self.values.len());
            self.held = Some(held);
        }
        self.values.push(value);
        Ok(())
    }
}

impl<T> std::ops::Deref for Pool<'_, T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.values
    }
}
