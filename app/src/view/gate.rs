//! Ends a renderer's work early.

use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::atomic::Ordering,
};

use anyhow::{Result, anyhow};
use isophote_scene::reference::Progress;

use super::worker::Shared;

/// Thrown through a renderer when something else is wanted.
struct Stopped;

/// Hears how far a renderer is, and stops it when something else is wanted: the next part of the work unwinds, as
/// renderers have no other way to end early.
pub(super) struct Gate<'a> {
    shared: &'a Shared,
    /// The only number that may be wanted; whatever is wanted where there is none.
    number: Option<u64>,
    is_of_truth: bool,
}

impl<'a> Gate<'a> {
    pub(super) fn new(shared: &'a Shared, number: Option<u64>, is_of_truth: bool) -> Self {
        Self {
            shared,
            number,
            is_of_truth,
        }
    }

    fn is_shut(&self) -> bool {
        let other = |number| self.shared.number.load(Ordering::Relaxed) != number;
        self.shared.quits.load(Ordering::Relaxed)
            || self.number.is_some_and(other)
            || self.is_of_truth && !self.shared.truth_is_wanted.load(Ordering::Relaxed)
    }
}

impl Progress for Gate<'_> {
    fn advance(&self, done: u64, total: u64) {
        self.shared.done.fetch_max(done, Ordering::Relaxed);
        self.shared.total.store(total, Ordering::Relaxed);
        if self.is_shut() {
            // Unlike a panic it says nothing.
            resume_unwind(Box::new(Stopped));
        }
    }
}

/// The result, or none where the work was stopped.
pub(super) fn stoppable<T>(work: impl FnOnce() -> Result<T>) -> Result<Option<T>> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(result) => result.map(Some),
        Err(payload) if payload.is::<Stopped>() => Ok(None),
        Err(payload) => Err(anyhow!("this is a bug: {}", said(&*payload))),
    }
}

/// What a panic said.
fn said(payload: &(dyn Any + Send)) -> &str {
    let text = payload.downcast_ref::<&str>().copied();
    text.or(payload.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("the renderer stopped")
}

#[cfg(test)]
mod tests {
    use rayon::prelude::*;

    use super::*;

    #[test]
    fn what_is_no_longer_wanted_stops_on_all_threads() {
        let shared = Shared::default();
        let work = |gate: &Gate<'_>| {
            (0..64_u64)
                .into_par_iter()
                .for_each(|part| gate.advance(part, 64));
            Ok(7)
        };
        let gate = Gate::new(&shared, Some(0), false);
        assert_eq!(stoppable(|| work(&gate)).unwrap(), Some(7));
        shared.number.store(1, Ordering::Relaxed);
        assert_eq!(stoppable(|| work(&gate)).unwrap(), None);
        // A picture that is only small is finished.
        let patient = Gate::new(&shared, None, false);
        assert_eq!(stoppable(|| work(&patient)).unwrap(), Some(7));
        let of_truth = Gate::new(&shared, None, true);
        assert_eq!(stoppable(|| work(&of_truth)).unwrap(), None);
    }

    #[test]
    fn bugs_are_told() {
        let told = stoppable::<()>(|| resume_unwind(Box::new("a bug")));
        assert!(told.unwrap_err().to_string().ends_with("a bug"));
    }
}
