#![doc = include_str!("../README.md")]
//!
//! # Stages
//!
//! 1. [`cpu::Triangles`]: what is drawn into every map.
//! 2. `cpu/view.rs`: how a map looks at it, along one of the [`Directions`] (§3.2), fitted around the points it is asked for.
//! 3. `cpu/raster.rs`: which pixels a triangle covers, and how deep.
//! 4. `cpu/maps.rs`: layered depth maps (§3): count, prefix sum, fill, sort; `cpu/reach.rs`: what of them nobody asks for.
//! 5. [`cpu::trace`]: rays through maps (§3.1), stored or streamed.
//! 6. [`cpu::occlusion`]: ambient occlusion, obscurance and bent normals (§3.3, §4.1).
//! 7. [`cpu::photons`], `cpu/photons/emission.rs`: photon differentials leave the lights and land (§3.4, §4.2).
//! 8. `cpu/photons/split.rs`: those that are to be splatted are split along the maps ([`Deposit`]).
//! 9. Their light arrives: they are splatted (`cpu/photons/splat.rs`), or points look along the maps for those that light them
//!    (`cpu/photons/gather.rs`).
//!
//! [`cpu::hbao`] is the screen-space method that the paper compares with. The module `gpu` (feature `gpu`) is all stages as wgpu
//! passes, with the device's rasteriser; photons that are gathered are sent on the CPU.
//!
//! # From the paper to the code
//!
//! | paper | code |
//! |---|---|
//! | §3.1, trace(x, ω): find map, pixel, depth, intersection | [`cpu::trace`] |
//! | §3.2, recursive zonal equal-area partition, culled directions (Fig. 5) | [`Partition`], [`Directions`] |
//! | Eq. (1) to (3), obscurance | [`cpu::occlusion::Occlusion`] |
//! | §3.4, D x and D d, transfer (Igehy 1999), rotation by α | `cpu/photons/differential.rs` |
//! | §4.2, photons leave the light's view; splitting | `cpu/photons/{views,emission}.rs`, [`cpu::photons::light`] |
//! | Eq. (4) to (7), footprints and splatting | `cpu/photons/footprint.rs`, `cpu/photons/splat.rs`; as quads that blending adds, `gpu/photons/splats/quads.rs` |
//! | Fig. 11, environment light through the maps | `cpu/environment.rs`, [`cpu::photons::Gathered::sky`], `gpu/gather/looks.rs` |
//! | §6, glossy by the nearest direction | `cpu/photons/glossy.rs`, [`Photons::mirrored`], `gpu/gather/mirror.rs` |
//! | §6, direct light from photons | [`PhotonParams::direct`], [`Photons::direct`] |
//! | §6, multiple bounces over subsets of the directions | [`PhotonParams::bounces`], [`Directions::subset`] |
//! | §6, arbitrary light sources | `cpu/photons/emission.rs` |
//! | §6, progressive rendering | [`OcclusionParams::frames`], [`PhotonParams::frames`], [`Directions::turned`] |
//! | Fig. 3, point clouds | [`LdmTracer::point_cloud`] |
//! | Fig. 8, HBAO | [`cpu::hbao`], `gpu/hbao.rs` |
//!
//! # Differences from the paper
//!
//! - N counts directions of a hemisphere: the sphere is cut into 2N regions and each map answers for two of them. The sum of
//!   Eq. (2) is divided by the sum of its cosines and not by N/2, so that an open sky is 1 at every normal.
//! - Maps are streamed: built, asked for all points, dropped. Memory does not grow with N. [`LdmTracer`] stores them.
//! - Maps are fitted around the points, not the scene. Their pixels are square, at most as many as asked for, and those of a lattice
//!   that stays while something moves.
//! - Corners are rounded to a 256th of a pixel on the CPU too, so that both sides cover the same pixels.
//! - A point is moved to the line of its pixel's centre within its own plane; where its surface does not reach so far, the pixels
//!   beside it are asked. The paper compares depths as they are, with a tolerance.
//! - Points that gather light are moved only as far as four short rays along their planes found room (`cpu/room.rs`): beside a lit
//!   ledge a pixel's line may begin inside it.
//! - With `d_max` a map holds what is within the reach of the points that ask it, and its layers are not sorted: eight points at a
//!   time look through all layers of a pixel, whatever their order.
//! - Without `d_max` a map keeps the first and the last layer of each pixel: nothing else is asked for.
//! - Several points of a pixel share the maps between them.
//! - Parts of a photon that run along a map keep the footprint they had ([`Spread::Parallel`]); the paper's turned differentials
//!   are [`Spread::Turned`], for photons that are splatted.
//! - Split photons share what is reflected by cosθ / Σ cosθ, so that no energy is lost between directions.
//! - By default points gather ([`Deposit::Gathered`]): the sum over maps and photons is that of splatting, but the map decides
//!   for each point which surface lights it, so nothing is smeared over edges and shadows of what receives.
//! - The environment is averaged over the regions of the directions, so that a sun that is smaller than one is not lost. Its
//!   photons come in parallel along 384 directions, each with what comes from its region.
//! - A spot's view is not a plane before it but the square of its cone, whose pixels have equal solid angles.
//! - Photons that are gathered are cut into smaller ones where their footprints meet edges or shadows, and their light is
//!   divided by the part of the footprint that is on a surface (`cpu/photons/{cut,field}.rs`).
//! - Photons that are splatted land in the planes of what the camera sees, which the map's distance only chooses; those whose middle is hidden
//!   or outside of the picture count where their footprint is not.
//! - Photons leave a light's view as rays of a tracer; the paper draws the scene from the light.
//! - Footprints are twice as wide as their differentials ([`PhotonParams::splat_size`]), so that a raster of them adds up to even
//!   light; what faces away from where a photon came from gets none of it.
//! - Directions above the shading normal but below the surface count as hidden.
//! - On GPUs photons that are splatted leave direct light to rays; those that are gathered need not.
//! - Splatting is tiled, without atomics that add (on GPUs the paper's quads can be chosen); the filter's third row reaches a share of the footprint's radius out of its plane.

pub mod cpu;
mod directions;
mod error;
#[cfg(feature = "gpu")]
pub mod gpu;
mod params;

pub use self::{
    cpu::{
        photons::{Deposit, PhotonParams, Photons, Spread},
        trace::{LdmTracer, StreamedMaps},
    },
    directions::{Directions, Partition, Region, Zone},
    error::{Error, Result},
    params::{MapParams, OcclusionParams},
};
