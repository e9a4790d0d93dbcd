//! The ground that GPU stages stand on: a device, shaders, the scene's data and the tracers that answer rays there.
//!
//! 1. A [`Context`] is a device and its queue, opened here or brought along by a renderer. [`adapters`] lists what
//!    there is.
//! 2. Shaders are WESL. A crate lists its modules in a [`ShaderPackage`]; a [`Linker`] makes one WGSL text of an
//!    entry module and what it imports, checks it, and says file and line where something is wrong.
//! 3. [`GpuScene`] holds a scene's vertices, triangles, materials, textures, lights and instances in a few buffers,
//!    or in textures where the adapter's limits allow no buffers that large.
//! 4. A [`GpuTracer`] answers rays in shaders: [`ComputeBvhTracer`] on any adapter, [`RayQueryTracer`] where the
//!    device can trace rays itself, [`RayQueryBoxTracer`] roughly. [`RayBatch`] asks one about rays in bulk.
//! 5. A [`GBufferPass`] rasterises what a camera sees into the layers of a [`GBuffer`], which may also be another
//!    renderer's; [`ShadowMaps`] are what the lights see. [`Rasters`] binds both for techniques.
//! 6. [`mod@reference`] computes the right answer on the device.
//!
//! ```no_run
//! use std::sync::Arc;
//! use glam::Vec3;
//! use isophote_scene::{Ray, Selection, builtin};
//! use isophote_scene::gpu::{AdapterChoice, BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, RayBatch};
//!
//! let scene = Arc::new(builtin::build("builtin:cornell")?);
//! let context = Context::open(&AdapterChoice::Any)?;
//! let gpu_scene = GpuScene::new(&context, &scene)?;
//! let tracer = ComputeBvhTracer::build(&context, &scene, &Selection::default(), &())?;
//! let mut batch = RayBatch::new(&context, &gpu_scene, &tracer)?;
//! let rays = [Ray::new(scene.bounds().center(), Vec3::NEG_Y)];
//! let mut hits = [None];
//! batch.closest_hits(&context, &gpu_scene, &tracer, &rays, &mut hits)?;
//! # Ok::<(), isophote_scene::Error>(())
//! ```
//!
//! # Bind groups
//! | group | who owns it |
//! |---|---|
//! | 0 | the technique |
//! | 1 | the tracer ([`GpuTracer::bind_group`]) |
//! | 2 | the scene's data ([`GpuScene::bind_group`]) |
//! | 3 | G-buffer and shadow maps ([`Rasters::bind_group`]), or a second tracer ([`Linker::secondary`]) |
//!
//! A shader stage may use 8 storage buffers (WebGPU's default): the scene takes 3, a tracer at most 2, so a
//! technique has 3, or 1 beside two tracers. What lies in textures is read by other shaders: a technique tells its
//! [`Linker`] of the scene and the tracers that it binds.

mod compute;
mod context;
mod gbuffer;
mod raster;
mod rasters;
mod read;
pub mod reference;
mod shader;
mod shadow_map;
mod timer;
mod tracer;
mod upload;
mod view;
mod words;

pub use self::{
    compute::{ComputePass, Dispatch, UniformArray, grid},
    context::{Adapter, AdapterChoice, Context, adapters},
    gbuffer::{GBuffer, GBufferPass, GBufferViews},
    rasters::Rasters,
    shader::{Linker, SHADERS, Shader, ShaderPackage, replace_modules},
    shadow_map::{ShadowMaps, ShadowOptions},
    timer::{PassTime, Timer},
    tracer::{
        BuildGpuTracer, GpuTracer,
        batch::RayBatch,
        binding::{TracerBinding, TracerTable},
        compute_bvh::ComputeBvhTracer,
        ray_query::{RayQueryBoxTracer, RayQueryTracer, check_ray_query},
    },
    upload::GpuScene,
    view::View,
};
