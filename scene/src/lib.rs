//! What every Isophote technique shares: scenes, ray tracers and the integrators that define the right answer.
//!
//! The way through the crate is the way of a picture:
//!
//! 1. A file becomes a [`Scene`]: [`load()`], or [`builtin`] for scenes that need no file.
//! 2. A [`Tracer`] is built of it ([`BuildTracer`]): [`BvhTracer`] is exact, [`BruteForceTracer`] the oracle.
//! 3. A [`Camera`] gives rays, a [`Hit`] becomes a [`SurfacePoint`] with its [`SurfaceMaterial`].
//! 4. [`mod@reference`] computes what light arrives there.
//! 5. The result is an [`Image`] of named layers.

mod animation;
mod bsdf;
pub mod builtin;
mod camera;
mod clean;
mod emission;
mod environment;
mod error;
mod gbuffer;
#[cfg(feature = "gpu")]
pub mod gpu;
mod image;
mod light;
mod lighting;
mod load;
mod material;
mod mesh;
mod output;
mod pass;
mod receivers;
pub mod reference;
pub mod sample;
mod scene;
pub mod sealed;
mod surface;
#[cfg(feature = "testing")]
pub mod testing;
mod texture;
mod trace;

#[cfg(feature = "gltf")]
pub use self::load::{GltfElements, GltfInstance, GltfMesh, GltfPrimitive, GltfSource, load_gltf};
pub use self::{
    animation::{Animation, Channel, Interpolation, Keys, Local, Node, Track},
    bsdf::{Bsdf, BsdfSample, MIRROR_ROUGHNESS, fresnel},
    camera::{Camera, Pinhole, Projection},
    clean::clean,
    emission::{Emission, Particle},
    environment::EnvironmentMap,
    error::{Error, Result},
    gbuffer::{GBuffer, Seen},
    image::Image,
    light::{Environment, Light, LightKind},
    lighting::DirectLight,
    load::{LoadOptions, load, load_with},
    material::{Alpha, Material, TextureRef},
    mesh::{Aabb, Mesh},
    output::{check_writable, write_atomically},
    pass::Pass,
    receivers::{Receiver, Receivers},
    scene::{Dropped, Instance, InstanceMask, LoadReport, Scene, area, unit_normal},
    surface::{SurfaceMaterial, SurfacePoint, facing},
    texture::{ColorSpace, Filter, Texture, Wrap, linear_to_srgb, srgb_to_linear},
    trace::{
        Agreement, Answers, BruteForceTracer, BuildTracer, BvhOptions, BvhTracer, Confident,
        Directions, Hit, Leaves, Levels, ParallelTracer, Ray, Selection, Shear, SurfaceId, Tracer,
        WithFallback, WorldTriangle, check_transforms, world_triangles,
    },
};

/// Runs the examples of this crate's README and of the workspace's as doc tests.
#[cfg(doctest)]
mod readmes {
    #[doc = include_str!("../README.md")]
    struct Crate;
    #[doc = include_str!("../../README.md")]
    struct Workspace;
    #[doc = include_str!("../../docs/adding.md")]
    struct Adding;
}
