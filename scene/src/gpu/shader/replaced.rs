//! Texts of modules that change while the program runs, for work on shaders.

use std::{
    collections::BTreeMap,
    sync::{PoisonError, RwLock},
};

/// By file.
static REPLACED: RwLock<BTreeMap<String, &'static str>> = RwLock::new(BTreeMap::new());

/// Lets texts stand in for embedded modules in everything that is linked from now on, in the whole process; what was linked
/// before stays as it is. Files are named as in errors, `scene/shaders/ray.wesl`; files that are no module of a linker's
/// packages do nothing. Returns the texts that stood in before, so that these can be put back when the new ones do not link.
///
/// For work on shaders: a text that differs from what was there is kept until the process ends.
pub fn replace_modules(texts: BTreeMap<String, String>) -> BTreeMap<String, String> {
    let mut replaced = REPLACED.write().unwrap_or_else(PoisonError::into_inner);
    let old = std::mem::take(&mut *replaced);
    for (file, text) in texts {
        let kept = old.get(&file).copied().filter(|old| **old == *text);
        let text = kept.unwrap_or_else(|| Box::leak(text.into_boxed_str()));
        replaced.insert(file, text);
    }
    let owned = old.into_iter();
    owned.map(|(file, text)| (file, text.to_owned())).collect()
}

/// What stands in for a file.
pub(super) fn text(file: &str) -> Option<&'static str> {
    let replaced = REPLACED.read().unwrap_or_else(PoisonError::into_inner);
    replaced.get(file).copied()
}
