//! What can go wrong between a file and a picture.

use std::path::{Path, PathBuf};

/// Result of this crate's fallible functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Everything that can go wrong while loading scenes and images or making tracers.
///
/// The message says what happened, where, and what to do about it.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A file is not what its name or header says, or contradicts itself.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where in the file.
        reason: String,
    },
    /// A file of numbers is of another kind, or not as it was written.
    #[error("{}: {reason}; {remedy}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
        /// What to do without it.
        remedy: &'static str,
    },
    /// A file of numbers was made of something else than it is wanted for, or by another version.
    #[error("{}: {reason}; {remedy}", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What differs.
        reason: String,
        /// What to do without it.
        remedy: &'static str,
    },
    /// A file needs a feature that is not implemented.
    #[error("{}: needs {feature}, which is not supported; {remedy}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The feature, by the name its specification gives it.
        feature: String,
        /// What the user can do about it.
        remedy: String,
    },
    /// The file name's suffix stands for no format that is known here.
    #[error("{}: unknown suffix; {known} are known", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// The known suffixes, as a readable list.
        known: &'static str,
    },
    /// Loading would take more memory than is allowed.
    #[error("{}: {what} would take {bytes} bytes, more than the {limit} that are allowed", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// What would be allocated.
        what: String,
        /// How much that is.
        bytes: u64,
        /// The limit.
        limit: u64,
    },
    /// `builtin:NAME` names no built-in scene.
    #[error("no built-in scene is called '{name}'; there are {known}")]
    UnknownBuiltin {
        /// The name asked for.
        name: String,
        /// The names that exist, as a readable list.
        known: String,
    },
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
    /// Nothing is left to build a tracer of.
    #[error("nothing to trace: {reason}")]
    NoGeometry {
        /// Why there are no triangles.
        reason: String,
    },
    /// A tracer's answers hold less than what a technique needs.
    #[error(
        "{technique} needs a tracer that answers {needed:?}, but {tracer} answers {answered:?}"
    )]
    TracerKnowsLess {
        /// Who asks.
        technique: &'static str,
        /// What it needs.
        needed: crate::Answers,
        /// The tracer's name.
        tracer: String,
        /// What it offers.
        answered: crate::Answers,
    },
    /// No GPU adapter is what was asked for.
    #[cfg(feature = "gpu")]
    #[error("no {wanted}: {found}")]
    NoAdapter {
        /// What was asked for.
        wanted: String,
        /// What there is instead, and what to do.
        found: String,
    },
    /// A device, its driver or the validation in front of it refused or failed.
    #[cfg(feature = "gpu")]
    #[error("GPU, {what}: {reason}")]
    Gpu {
        /// What was being done.
        what: String,
        /// What the device or the validation said.
        reason: String,
    },
    /// Something is larger than what the adapter can hold or bind in one piece.
    #[cfg(feature = "gpu")]
    #[error(
        "GPU, {what}: {needs} bytes are needed in one piece, but {adapter} takes at most {limit}; \
         use a smaller scene, another adapter, or the CPU"
    )]
    GpuLimit {
        /// What would be created.
        what: String,
        /// How large it would be, bytes.
        needs: u64,
        /// What the adapter takes, bytes.
        limit: u64,
        /// The adapter's name.
        adapter: String,
    },
    /// A shader does not link, or is not valid.
    #[cfg(feature = "gpu")]
    #[error("{file}:{line}: {message}")]
    Shader {
        /// The WESL file, from the root of its crate.
        file: String,
        /// The line in it, from 1; 0 when it is not known.
        line: u32,
        /// What is wrong.
        message: String,
    },
}

impl Error {
    pub(crate) fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            source,
        }
    }

    pub(crate) fn malformed(path: &Path, reason: impl Into<String>) -> Self {
        Self::Malformed {
            path: path.to_owned(),
            reason: reason.into(),
        }
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn gpu(what: impl Into<String>, reason: impl ToString) -> Self {
        Self::Gpu {
            what: what.into(),
            reason: reason.to_string(),
        }
    }
}
