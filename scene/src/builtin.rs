//! Scenes made by calculation, so that everything can be tried without a file.
//!
//! [`build`] takes a name of [`NAMES`], with a number behind a colon where the scene has a parameter:
//!
//! ```
//! # fn main() -> isophote_scene::Result<()> {
//! use isophote_scene::builtin;
//! let scene = builtin::build("builtin:hairball:10000")?;
//! assert!(scene.triangle_count().abs_diff(10_000) <= 100);
//! assert!(scene.camera("camera_main").is_some());
//! # Ok(())
//! # }
//! ```
//!
//! Every scene is in metres with +Y up, has a camera `camera_main` and lights that expose it well at exposure 1,
//! and is the same on every run. Repeated things are instances of one mesh, some of them mirrored. No two faces lie
//! in one plane over each other, so it is never left to chance which material a ray meets.

mod atrium;
mod cave;
mod cornell;
mod corner;
mod hairball;
mod office;
mod paint;
mod random;
mod shapes;
mod stage;

#[cfg(test)]
mod tests;

use crate::{Error, Result, Scene};

/// What a scene's name starts with where a file could also be named.
pub const PREFIX: &str = "builtin:";

/// The built-in scenes: name and one-line description.
pub const NAMES: &[(&str, &str)] = &[
    (
        "cornell",
        "the measured Cornell box with its area light, 38 triangles",
    ),
    (
        "corner",
        "three planes with objects, for ambient occlusion; corner:N has N × N vertices a plane (2 to 1025, 33 unless given)",
    ),
    (
        "atrium",
        "a two-storey colonnaded hall in the sun, about 250,000 triangles",
    ),
    (
        "office",
        "a furnished room with metal and a mirror, about 20,000 triangles",
    ),
    (
        "hairball",
        "thin random strands; hairball:N has N triangles (1,000 to 5,000,000, 250,000 unless given)",
    ),
    (
        "cave",
        "a hollow of one wavy surface; cave:N has about N triangles (1,000 to 5,000,000, 100,000 unless given)",
    ),
];

/// Whether a scene argument names a built-in scene (existing or not) and no file: it starts with [`PREFIX`].
pub fn is_builtin(scene: &str) -> bool {
    scene.starts_with(PREFIX)
}

/// Makes a built-in scene from `NAME` or `NAME:NUMBER`, with or without [`PREFIX`] before it.
///
/// # Errors
/// [`Error::UnknownBuiltin`] when there is no such scene, [`Error::Parameter`] when the number is not one, is out of
/// the range given in [`NAMES`], or the scene takes none.
pub fn build(spec: &str) -> Result<Scene> {
    let spec = spec.strip_prefix(PREFIX).unwrap_or(spec);
    let (name, parameter) = match spec.split_once(':') {
        Some((name, parameter)) => (name, Some(parameter)),
        None => (spec, None),
    };
    let plain = |make: fn() -> Scene| match parameter {
        None => Ok(make()),
        Some(value) => Err(Error::Parameter {
            name: "the number behind the built-in scene's name",
            value: format!("'{value}'"),
            expected: "only corner, hairball and cave take one",
        }),
    };
    match name {
        "cornell" => plain(cornell::build),
        "corner" => number(parameter, corner::VERTICES).map(corner::build),
        "atrium" => plain(atrium::build),
        "office" => plain(office::build),
        "hairball" => number(parameter, hairball::TRIANGLES).map(hairball::build),
        "cave" => number(parameter, cave::TRIANGLES).map(cave::build),
        _ => Err(Error::UnknownBuiltin {
            name: name.to_owned(),
            known: NAMES
                .iter()
                .map(|(name, _)| *name)
                .collect::<Vec<_>>()
                .join(", "),
        }),
    }
}

/// A whole number that a scene takes.
struct Number {
    name: &'static str,
    default: usize,
    min: usize,
    max: usize,
    expected: &'static str,
}

fn number(text: Option<&str>, number: Number) -> Result<usize> {
    let Some(text) = text else {
        return Ok(number.default);
    };
    text.replace('_', "")
        .parse()
        .ok()
        .filter(|value| (number.min..=number.max).contains(value))
        .ok_or_else(|| Error::Parameter {
            name: number.name,
            value: format!("'{text}'"),
            expected: number.expected,
        })
}
