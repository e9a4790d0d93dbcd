#![doc = include_str!("../README.md")]

pub mod cpu;
mod directions;
mod error;
mod fallback;
#[cfg(feature = "gpu")]
pub mod gpu;
mod params;

pub use self::{
    cpu::trace::LdiTracer,
    directions::Directions,
    error::{Error, Result},
    fallback::{Confident, WithFallback},
    params::{Coverage, LdiParams},
};
