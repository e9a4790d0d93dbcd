//! What can go wrong with layered depth maps.

/// Result of this crate's fallible functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Everything that can go wrong.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A parameter is out of its range.
    #[error("{name} is {value}, but {expected}")]
    Parameter {
        /// The parameter's name.
        name: &'static str,
        /// The value given.
        value: String,
        /// What was expected.
        expected: &'static str,
    },
    /// Stored maps would take more memory than is allowed.
    #[error(
        "the maps take more than the {limit} bytes that are allowed: take fewer maps or a lower resolution, or stream them"
    )]
    TooLarge {
        /// [`MapParams::max_bytes`](crate::MapParams::max_bytes).
        limit: u64,
    },
    /// The scene, or a tracer of it.
    #[error(transparent)]
    Scene(#[from] isophote_scene::Error),
}

impl Error {
    pub(crate) fn parameter(
        name: &'static str,
        value: impl ToString,
        expected: &'static str,
    ) -> Self {
        Self::Parameter {
            name,
            value: value.to_string(),
            expected,
        }
    }
}
