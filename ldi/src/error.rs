//! What can go wrong with layered depth images.

/// Result of this crate's fallible functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Everything that can go wrong while building, saving and loading maps, and while rendering with them.
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
    /// The maps would take more memory than is allowed.
    #[error("the maps would take more than the {limit} bytes that are allowed; {remedy}")]
    TooLarge {
        /// [`LdiParams::max_bytes`](crate::LdiParams::max_bytes), or what can be counted.
        limit: u64,
        /// What to do about it.
        remedy: &'static str,
    },
    /// The scene, or a file of it or of maps.
    #[error(transparent)]
    Scene(#[from] isophote_scene::Error),
    /// The filter's parameters, or what it was given.
    #[error("the filter: {0}")]
    Filter(#[from] isophote_filters::Error),
}

impl From<Error> for isophote_scene::Error {
    fn from(error: Error) -> Self {
        match error {
            Error::Scene(error) => error,
            Error::Parameter {
                name,
                value,
                expected,
            } => Self::Parameter {
                name,
                value,
                expected,
            },
            Error::TooLarge { limit, remedy } => Self::Parameter {
                name: "the memory of the maps",
                value: format!("more than {limit} bytes"),
                expected: remedy,
            },
            Error::Filter(error) => Self::Parameter {
                name: "the filter",
                value: error.to_string(),
                expected: "its parameters must be in their ranges",
            },
        }
    }
}
