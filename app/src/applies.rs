//! Flags that would change nothing are refused, not ignored, and do not stand in headers.

use anyhow::{Result, bail};
use clap::{ArgMatches, Args, Command, parser::ValueSource};
use isophote_scene::reference::Quantity;

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

/// Flags that change nothing of these quantities, whatever computes them.
pub(crate) fn of_other_quantities(quantities: &[Quantity]) -> Vec<Idle> {
    let mut idle = Vec::new();
    let wants = |kind: fn(Quantity) -> bool| quantities.iter().copied().any(kind);
    if !wants(Quantity::is_occlusion) {
        idle.extend(Idle::all(["d_max"], "light comes from everywhere"));
    }
    if !wants(|quantity| !quantity.is_occlusion()) {
        let of_light = ["min_d", "materials"];
        idle.extend(Idle::all(of_light, "occlusion knows no light"));
    }
    if !wants(|quantity| matches!(quantity, Quantity::Path | Quantity::IrradiancePath)) {
        let why = "only paths have a number of bounces";
        idle.extend(Idle::all(["path_bounces"], why));
    }
    idle
}

/// The ids of a group of flags.
pub(crate) fn ids<T: Args>() -> Vec<String> {
    let command = T::augment_args(Command::new(""));
    let ids = command.get_arguments().map(|arg| arg.get_id().to_string());
    ids.collect()
}

/// An error if one of these flags was given. A command need not have all of them.
pub(crate) fn refuse(idle: &[Idle], given: &ArgMatches) -> Result<()> {
    for Idle { id, why } in idle {
        let is_known = given.try_contains_id(id).is_ok();
        if is_known && given.value_source(id) == Some(ValueSource::CommandLine) {
            bail!("--{} has no effect: {why}", id.replace('_', "-"));
        }
    }
    Ok(())
}
