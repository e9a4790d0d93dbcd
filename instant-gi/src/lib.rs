#![doc = include_str!("../README.md")]
//!
//! # Stages
//!
//! 1. [`cpu::emission`]: light paths make virtual point lights (§4).
//! 2. [`isophote_scene::GBuffer`]: what the camera sees; on GPUs also what another renderer has seen. `cpu/keep.rs`: the lights that
//!    the picture's error would come from, where not all are kept.
//! 3. [`cpu::maps`]: shadow maps of the virtual point lights, where they are asked for (§6).
//! 4. `cpu/tiles.rs` and `cpu/specular.rs`: light straight from the lights, mirrors and glass (§4).
//! 5. `cpu/samples.rs`, `cpu/indirect.rs`: the virtual point lights' light (Eq. (1)), of all or of a part of them (§4.2, §4.3);
//!    `cpu/select.rs`: of those that a point picks.
//! 6. `cpu/filter.rs`: samples become a picture (Eq. (2), §4.3); `cpu/refine.rs`: pixels that no sample is like; in a sequence of
//!    pictures, `cpu/history.rs`.
//!
//! Vertices and texels are lit without a picture: stages 1, 3 and 5 by `cpu/receivers.rs`.
//!
//! The same stages on GPUs: `gpu.rs` and the shaders of the stages' names (feature `gpu`).
//!
//! # From the paper to the code
//!
//! | paper | code |
//! |---|---|
//! | §4, particles along a Halton sequence (the default is a lattice) | [`cpu::emission::shoot`], [`Sequence::Halton`] |
//! | §4, direct + specular, a Whitted-style tree; what secondary hits cost | `cpu/specular.rs`, `cpu/tiles.rs` |
//! | Eq. (1) and the bounded geometry term | `cpu/indirect.rs`, [`isophote_scene::reference::bound`] |
//! | §4.1, imperfect visibility | a tracer of boxes as the secondary one: `Leaves::Boxes` of scene's trees on CPUs and GPUs, or `boxes` of ray queries |
//! | §4.2, downsampling, Eq. (2) | [`GiParams::downsampling`], [`isophote_filters::JointBilateral`] |
//! | §4.3, interleaved sampling, discontinuity buffer | [`GiParams::interleaving`], [`isophote_filters::DiscontinuityBuffer`] |
//! | §6, visibility by parabolic shadow maps | [`Visibility::Maps`], [`cpu::maps`] |
//! | §6, both filters in a single pass | [`isophote_filters::SinglePass`] |
//! | §6, irregular interleaving | [`Pattern::Irregular`] |
//! | §6, instant caching for what mirrors show | [`GiParams::caching`], `cpu/cache.rs` |
//!
//! # Differences from the paper
//!
//! - All kinds of lights shoot particles; the paper has point lights. They shoot them along a lattice for each light, which is
//!   more even than the paper's Halton sequence ([`Sequence`]).
//! - Where shading normals differ from the triangles', a virtual light takes what its shading normal receives and gives
//!   it off around the triangle's, as the reference integrators do.
//! - ρ of Eq. (1) is albedo/π, and it is multiplied on at the very end: what is computed is irradiance.
//! - The bias of the bound can be compensated ([`GiParams::compensation`]).
//! - The filters compare depths with the tangent plane, unless [`Filter::Paper`] is chosen; [`Filter::Fill`] computes at a
//!   sample the parts of the lights that no sample around it has on its surface (`cpu/fill.rs`).
//! - What mirrors and glass show is lit tile by tile and timed apart; the paper lights it where it is hit.
//! - Imperfect visibility needs no second structure: [`isophote_scene::BvhTracer::with_leaves`] asks one tree for boxes.
//! - Shadow maps are filled by rays of the secondary tracer, not by rasterisation, so that any tracer has them.
//! - Instant caching (§6) interpolates between points of fixed cubes, and only what mirrors show (`cpu/cache.rs`). It is for CPUs
//!   alone: a shader would follow the trees of rays twice, once to find the cubes and once to look them up, with the lists of
//!   cubes in storage that stages do not have left; and it is off by a fifth of what mirrors show (README, "What was measured").
//!   On GPUs picking some of the lights at each point ([`GiParams::selection`]) saves rays there, without cubes.
//! - Past the paper: lights are kept for the picture by the mean square of what they bring to it ([`GiParams::kept`]), picked by
//!   points ([`GiParams::selection`]), and pixels that no sample around them is like are lit themselves
//!   ([`GiParams::refinement`]). All three are off unless asked for.

pub mod cpu;
mod error;
#[cfg(feature = "gpu")]
pub mod gpu;
mod params;

pub use self::{
    cpu::{History, InstantGi, Shot, Stages},
    error::{Error, Result},
    params::{Filter, GiParams, Lookup, Pattern, Sequence, ShadowMaps, Visibility},
};
