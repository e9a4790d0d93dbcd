//! What can go wrong with displacement fields.

/// Result of this crate's fallible functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Everything that can go wrong while building, saving, loading and placing fields.
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
    /// The field would take more memory than is allowed.
    #[error(
        "a field would take {bytes} bytes, more than the {limit} that are allowed; fewer positions, fewer directions or fewer bits take less"
    )]
    TooLarge {
        /// How much that is.
        bytes: u64,
        /// [`FieldParams::max_bytes`](crate::FieldParams::max_bytes).
        limit: u64,
    },
    /// There is nothing to build a field around.
    #[error("the mesh '{mesh}' has no triangles, so there is nothing to build a field around")]
    Empty {
        /// The mesh's name.
        mesh: String,
    },
    /// A mesh is too large or too small for numbers of 32 bits.
    #[error(
        "the mesh '{mesh}' has a bounding sphere of {radius} m; scale it to between 1e-15 and 1e15 m"
    )]
    Size {
        /// The mesh's name.
        mesh: String,
        /// The radius, metres.
        radius: f64,
    },
    /// A mesh is so far from its origin that rounding moves it beside its size.
    #[error(
        "the mesh '{mesh}' has a bounding sphere of {radius} m at {distance} m from its origin, where 32 bits place nothing that finely; move its vertices to the origin, and its instances instead"
    )]
    Far {
        /// The mesh's name.
        mesh: String,
        /// From the origin of its space to the sphere's centre, metres.
        distance: f64,
        /// The radius, metres.
        radius: f64,
    },
    /// An instance is placed by something else than a rotation, a translation and a uniform scale.
    #[error(
        "the instance {instance} ('{name}') is {what}; a displacement field can only be turned, moved, mirrored and scaled uniformly: leave the instance out, or apply its transform to its mesh"
    )]
    Transform {
        /// Index in [`Scene::instances`](isophote_scene::Scene::instances).
        instance: usize,
        /// The instance's name.
        name: String,
        /// What the transform does.
        what: &'static str,
    },
    /// A tracer or a scene, or a file of it.
    #[error(transparent)]
    Scene(#[from] isophote_scene::Error),
}

impl From<Error> for isophote_scene::Error {
    fn from(error: Error) -> Self {
        let parameter = |name, value: String, expected| Self::Parameter {
            name,
            value,
            expected,
        };
        match error {
            Error::Scene(error) => error,
            Error::Parameter {
                name,
                value,
                expected,
            } => parameter(name, value, expected),
            Error::TooLarge { bytes, .. } => parameter(
                "the memory of a field",
                format!("{bytes} bytes"),
                "that is more than is allowed: take fewer positions or directions",
            ),
            Error::Empty { .. } => Self::NoGeometry {
                reason: error.to_string(),
            },
            Error::Size { mesh, radius } => parameter(
                "the radius of a mesh's bounding sphere",
                format!("{radius} m ('{mesh}')"),
                "it must be within 1e-15 and 1e15 m",
            ),
            Error::Far {
                mesh,
                distance,
                radius,
            } => parameter(
                "the distance of a mesh from its origin",
                format!("{distance} m ('{mesh}', of {radius} m)"),
                "move its vertices to the origin, and its instances instead",
            ),
            Error::Transform {
                instance,
                name,
                what,
            } => parameter(
                "an instance's transform",
                format!("{what} (instance {instance}, '{name}')"),
                "a displacement field can only be turned, moved, mirrored and scaled uniformly",
            ),
        }
    }
}
