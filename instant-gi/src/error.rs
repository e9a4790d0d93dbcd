//! What can go wrong with instant global illumination.

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
    /// Something would take more memory than is allowed.
    #[error("{what} would take {bytes} bytes, more than the {limit} that are allowed; {remedy}")]
    TooLarge {
        /// What would be allocated.
        what: String,
        /// How much that is.
        bytes: u64,
        /// The limit.
        limit: u64,
        /// What to do about it.
        remedy: &'static str,
    },
    /// The scene, or a tracer of it.
    #[error(transparent)]
    Scene(#[from] isophote_scene::Error),
    /// The filters' parameters, or what they were given.
    #[error("the filter: {0}")]
    Filter(#[from] isophote_filters::Error),
}
