#![doc = include_str!("../README.md")]
//!
//! # Stages
//!
//! 1. [`Positions`] on the bounding sphere (§3.3), [`Directions`] of the hemisphere (§3.4), each with its inverse.
//! 2. [`Field::build`]: rays from every position into the sphere (Algorithm 1), kept as [`Storage`] says;
//!    [`Field::save`] and [`Field::load`] keep them in files.
//! 3. [`cpu::look_up`]: the samples that answer a ray (Algorithm 2), as [`LookUp`] says.
//! 4. [`FieldTracer`]: fields placed in a scene that moves.
//!
//! # From the paper to the code
//!
//! | paper | code |
//! |---|---|
//! | §3.1, Algorithm 1 | [`Field::build`] |
//! | §3.2, Algorithm 2: q′ = M⁻¹·q, (u, v), (θ, φ), the sum of both distances | `cpu/span.rs`, `cpu/look_up.rs`, [`LookUp::Nearest`] |
//! | §3.3, Slater's points and his inverse; spherical coordinates | [`Positions::nearest`] |
//! | §3.4, polar, rejection and concentric mapping, Malley's method | [`Directions::place`] |
//! | §4, lossless compression | [`Field::save`] |
//! | §4, one bit a ray, the average distance | [`Storage::Bit`], [`Field::with_bits`], [`FieldTracer::look_from`] |
//! | §1, collision detection | [`FieldTracer::closest`] |
//! | §5, interpolation, on GPUs too | [`LookUp::Interpolated`], `gpu::FieldGpuTracer` |
//! | §5, sphere tree | [`split`], [`ObjectParams::parts`] |
//!
//! # Differences from the paper
//!
//! - A ray that starts inside the sphere, as on the floor under an object, is looked up from where it leaves: the last
//!   surface on its line, seen from behind, lies before it or not. The paper adds the distance from the entry, which for
//!   such rays says nothing of what lies before them.
//! - By default twelve samples around a ray answer it together ([`LookUp::Interpolated`], the paper's future work). The paper
//!   takes one, of the direction next to the ray's ([`LookUp::Nearest`]); [`LookUp::Aimed`] takes one too, but of the
//!   direction that meets the ray in the middle of its way through the sphere, where the object is.
//! - Slater's rings are moved to where all points stand for the same area, which makes the inverse a formula instead of an
//!   image of indices; the two hemispheres' outermost rings lie beside the equator instead of both on it.
//! - The bounding sphere is the smallest one, larger by a share of 10⁻⁴, so that no surface lies on it.
//! - Interpolation is over the triangles of the positions' own lattice, which are found by a formula. They are a Delaunay
//!   triangulation of the positions; where there are several, of the four corners of each quad across the equator, which lie
//!   on a circle, the formula decides.
//! - A miss has a code of its own instead of the distance 2R, so that it is never averaged with a hit.
//! - The distance of a field of one bit is that of a plane across the normal at the mean depth of what is hit.
//! - Files are coded by prediction and deflate, hits apart from misses, not by run lengths.
//! - [`FieldTracer`] is no [`BuildTracer`](isophote_scene::BuildTracer): fields are built by an exact tracer, which this crate
//!   lets its caller choose.

pub mod cpu;
mod directions;
mod error;
#[cfg(feature = "gpu")]
pub mod gpu;
mod lanes;
mod math;
mod params;
mod positions;
mod sphere;

pub use self::{
    cpu::{
        build::alone,
        field::Field,
        look_up::LookUp,
        object::{Object, ObjectParams, meshes},
        split::split,
        together::Together,
        tracer::FieldTracer,
    },
    directions::Directions,
    error::{Error, Result},
    params::{FieldParams, Storage},
    positions::Positions,
    sphere::Sphere,
};
