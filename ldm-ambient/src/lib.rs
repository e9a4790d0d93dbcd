#![doc = include_str!("../README.md")]

pub mod cpu;
mod directions;
mod error;
mod params;

pub use self::{
    cpu::trace::{LdmTracer, StreamedMaps},
    directions::{Directions, Partition, Region, Zone},
    error::{Error, Result},
    params::{MapParams, OcclusionParams},
};
