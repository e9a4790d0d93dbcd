//! Flags that would change nothing are refused, not ignored, and do not stand in headers.

use anyhow::{Result, bail};
use clap::{ArgMatches, Args, Command, parser::ValueSource};

/// A flag without effect, by its id, and why.
pub(crate) struct Idle {
    pub(crate) id: String,
    pub(crate) why: String,
}

impl Idle {
    /// One for each id, with the same reason.
    pub(crate) fn all<'a>(
        ids: impl IntoIterator<Item = impl Into<String>> + 'a,
        why: &'a str,
    ) -> impl Iterator<Item = Self> + 'a {
        ids.into_iter().map(move |id| Self {
            id: id.into(),
            why: why.into(),
        })
    }
}

/// The ids of a group of flags.
pub(crate) fn ids<T: Args>() -> Vec<String> {
    let command = T::augment_args(Command::new(""));
    let ids = command.get_arguments().map(|arg| arg.get_id().to_string());
    ids.collect()
}

/// An error if one of these flags was given.
pub(crate) fn refuse(idle: &[Idle], given: &ArgMatches) -> Result<()> {
    for Idle { id, why } in idle {
        if given.value_source(id) == Some(ValueSource::CommandLine) {
            bail!("--{} has no effect: {why}", id.replace('_', "-"));
        }
    }
    Ok(())
}
