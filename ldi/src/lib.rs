#![doc = include_str!("../README.md")]
//!
//! # Stages
//!
//! 1. [`Directions`]: which maps there are, and which one is for a ray (§3.1).
//! 2. [`cpu::build`]: the maps of a scene (§3.1), laid out as [`cpu::maps`] says.
//! 3. [`cpu::trace`]: a ray walks through a map (§3.2); [`LdiTracer::save`] and [`LdiTracer::load`] keep maps in files.
//! 4. [`WithFallback`](isophote_scene::WithFallback): doubtful answers are asked of another tracer.
//! 5. [`cpu`]: the hybrid renderer (§4, §5), over any two tracers; the stages of its own are called hybrid stages 1 to 6.
//!
//! Stages 2, 3 and 5 have twins in shaders (feature `gpu`, module `gpu`).
//!
//! # From the paper to the code
//!
//! | paper | code |
//! |---|---|
//! | §3.1, n = 6k² directions, the nearest in constant time | [`Directions::nearest`] |
//! | §3.1, depth peeling, m̄ᵢ by a prefix sum | [`cpu::build::build`], `gpu/build/peel.rs` and its shaders |
//! | §3.1, depth values and triangle ids of a pixel | [`cpu::maps::Layers`], [`cpu::maps::Pixel`] |
//! | §3.2, pixel crossings | `cpu/trace/path.rs` |
//! | §3.2, a layer before the ray leaves the pixel; ε-tolerance | `cpu/trace/meet.rs`, [`LdiParams::epsilon`] |
//! | §3.2, from the triangle id back to the geometry | [`isophote_scene::Scene::surface_point`] |
//! | §4, anti-aliasing with one shading per primitive and pixel | [`HybridParams::samples`] |
//! | §5, secondary rays, two-pass Gaussian, combination | [`Hybrid::render`] |
//! | §5, coarse mip level | [`HybridParams::texture_level`] |
//! | §6, dynamic objects are left out | [`isophote_scene::Selection`] |
//!
//! # Differences from the paper
//!
//! - One map answers both of two opposite directions; the paper mentions it and does not do it.
//! - The cells of the cube are bent to nearly equal angles.
//! - Maps are projected in parallel to their direction onto the plane across its longest axis instead of across the
//!   direction itself: the same lines, no rotation, and walls and floors of one depth.
//! - A layer keeps the range of depths its triangles have within the pixel, rounded outwards to as few bits as a bound on
//!   their error allows ([`LdiParams::depth_error`]), and only tells which triangles a ray may meet; where it meets them is
//!   calculated from the triangles. So quantised depths cost no accuracy.
//! - By default ([`Coverage::Touched`]) layers are groups of triangles that touch the pixel anywhere, and answers are
//!   exact. [`Coverage::Center`] is the paper's sampling, with ε as the distance beside a triangle that still counts as
//!   on it, and with a rule against a ray's own surroundings.
//! - A pixel knows in which 32nds of the depth it has layers, so that empty pixels are passed without reading layers.
//! - Where several triangles share a pixel they share its rays too, so that anti-aliasing costs few.
//! - Rays of a batch are sorted by map; with AVX2 the maps of eight and the ways of four are found at once.
//! - Direct light and the shadows of what secondary rays hit are traced exactly, where the paper has shadow maps;
//!   `gpu::Hybrid` has both.
//! - The Gaussians leave out the background and metal, and stop at edges unless [`HybridParams::edges`] is `None`.
//! - Metal and glass that a glossy ray meets are lit as such, and glass lets rays through; diffuse rays see both as
//!   diffuse surfaces.

pub mod cpu;
mod directions;
mod error;
#[cfg(feature = "gpu")]
pub mod gpu;
mod params;

pub use self::{
    cpu::{Hybrid, Stages, trace::LdiTracer},
    directions::Directions,
    error::{Error, Result},
    params::{Coverage, HybridParams, LdiParams, Shadows},
};
