//! What can go wrong before a filter runs; on the processor nothing can while it does.

/// Result of this crate's fallible functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Parameters out of range and images that do not fit together.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A parameter is out of its range.
    #[error("{name} is {value}: {expected}")]
    Parameter {
        /// Which parameter.
        name: &'static str,
        /// What was given.
        value: String,
        /// What it must be.
        expected: &'static str,
    },
    /// A slice does not have one number per pixel and channel.
    #[error(
        "{what} holds {found} numbers: {width}×{height} pixels of {channels} channels need {expected}"
    )]
    Length {
        /// Which image.
        what: &'static str,
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Numbers per pixel.
        channels: usize,
        /// width · height · channels.
        expected: usize,
        /// The slice's length.
        found: usize,
    },
    /// Two images that belong together differ in size or in channels.
    #[error(
        "{what} has {found:?} (width, height, channels): {expected:?} are needed to fit the rest"
    )]
    Size {
        /// Which image.
        what: &'static str,
        /// The width, height and channels that fit.
        expected: [usize; 3],
        /// Those it has.
        found: [usize; 3],
    },
    /// A device failed, or a texture has not the usage or the format that is needed.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] isophote_scene::Error),
}

/// An error unless a parameter is in its range.
pub(crate) fn require(
    holds: bool,
    name: &'static str,
    value: impl ToString,
    expected: &'static str,
) -> Result<()> {
    if holds {
        return Ok(());
    }
    Err(Error::Parameter {
        name,
        value: value.to_string(),
        expected,
    })
}
