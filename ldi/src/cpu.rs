//! The method on the CPU.

pub mod build;
mod file;
pub mod maps;
pub mod trace;
