//! The method on the CPU, in the order of its stages.
//!
//! Maps of one direction are independent of those of others: several are built at the same time, each by one thread, and
//! then asked in the order of their directions for many points at the same time. So nothing depends on the number of threads.

mod aim;
pub(crate) mod environment;
pub mod hbao;
mod lanes;
mod maps;
pub mod occlusion;
mod packed;
pub mod photons;
pub(crate) mod points;
mod raster;
mod reach;
mod room;
pub mod trace;
mod triangles;
pub(crate) mod view;

pub use self::{
    points::{Point, Points},
    triangles::Triangles,
};
