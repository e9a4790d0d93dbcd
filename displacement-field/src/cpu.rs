//! The method on CPUs, in the order of its stages; those of the first, positions and directions, are beside this module.
//!
//! 2. [`build`]: from every position on the bounding sphere a hemisphere of rays is traced (Algorithm 1), by any exact
//!    tracer of the mesh alone.
//!    `samples`: what is kept of them; [`file`](mod@file) keeps it on disk; [`object`]: the fields of a mesh.
//! 3. [`look_up`]: a ray that enters the sphere is looked up (Algorithm 2).
//! 4. [`tracer`]: many fields, `placed`; `span` is the part of a ray that lies in a sphere, `top` finds which spheres
//!    a ray meets, `walk` takes several rays through them at once; [`together`] adds what has no field.
//!
//! Beside the ray there are [`proximity`], the distance to the closest point, and [`split`], several spheres for a mesh.

pub mod build;
pub mod field;
pub mod file;
pub mod look_up;
pub mod object;
pub(crate) mod placed;
pub mod proximity;
pub(crate) mod samples;
pub(crate) mod span;
pub mod split;
pub mod together;
pub(crate) mod top;
pub mod tracer;
pub(crate) mod walk;
