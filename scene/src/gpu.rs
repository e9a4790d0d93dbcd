//! The ground that GPU stages stand on: a device, shaders, the scene's data and the tracers that answer rays there.
//!
//! 1. A [`Context`] is a device and its queue, opened here or brought along by a renderer. [`adapters`] lists what
//!    there is.
//! 2. Shaders are WESL. A crate lists its modules in a [`ShaderPackage`]; a [`Linker`] makes one WGSL text of an
//!    entry module and what it imports, checks it, and says file and line where something is wrong.
//! 3. [`GpuScene`] holds a scene's vertices, triangles, materials, textures, lights and instances in a few buffers,
//!    sized against the adapter's limits before anything is created.
//! 4. A [`GpuTracer`] answers rays in shaders: [`ComputeBvhTracer`] on any adapter, [`RayQueryTracer`] where the
//!    device can trace rays itself, [`RayQueryBoxTracer`] roughly. [`RayBatch`] asks one about rays in bulk.
//!
//! # Bind groups
//! | group | who owns it |
//! |---|---|
//! | 0 | the technique |
//! | 1 | the tracer ([`GpuTracer::bind_group`]) |
//! | 2 | the scene's data ([`GpuScene::bind_group`]) |
//!
//! A shader stage may use 8 storage buffers (WebGPU's default): the scene takes 3, a tracer at most 2, so a
//! technique has 3.

mod context;
mod read;
mod shader;
mod timer;
mod tracer;
mod upload;

pub use self::{
    context::{Adapter, AdapterChoice, Context, adapters},
    shader::{Linker, SHADERS, Shader, ShaderPackage},
    timer::{PassTime, Timer},
    tracer::{
        BuildGpuTracer, GpuTracer,
        batch::RayBatch,
        compute_bvh::ComputeBvhTracer,
        ray_query::{RayQueryBoxTracer, RayQueryTracer, check_ray_query},
    },
    upload::GpuScene,
};
