//! The maps on a GPU: built there, or built as [`LdiTracer`]'s and uploaded, and traced in shaders.
//!
//! | stage | CPU | GPU |
//! |---|---|---|
//! | maps | `cpu/maps.rs` | `gpu/upload.rs`, `shaders/maps.wesl` |
//! | building (§3.1) | `cpu/build.rs` | `gpu/build.rs`, `shaders/build/*.wesl` |
//! | tracing (§3.2) | `cpu/trace.rs` | `shaders/trace.wesl` |
//! | planes within pixels | `cpu/trace/meet.rs` | `shaders/plane.wesl` |
//! | the hybrid renderer (§4, §5) | `cpu.rs` | `gpu/hybrid.rs` |
//! | its stages | `cpu/{fragments,light,gather,filter}.rs` | `shaders/{fragments,light,gather,filter,combine}.wesl` |

mod build;
mod hybrid;
mod kernel;
mod upload;

use std::sync::Arc;

use glam::Affine3A;
use isophote_scene::{
    Answers, Error, Result, Scene, Selection,
    gpu::{BuildGpuTracer, Context, GpuTracer, ShaderPackage, TracerBinding, TracerTable},
    shader_package,
};

pub use self::{
    build::BuildMethod,
    hybrid::{Hybrid, StageTextures},
};
use self::{
    build::MapBuilder,
    upload::{Words, faces, words},
};
use crate::{
    LdiParams, LdiTracer,
    cpu::{build::Plan, maps::Maps},
};

/// The WESL modules of this crate.
pub const SHADERS: ShaderPackage = shader_package!(
    "ldi",
    [
        "build/compact",
        "build/layer",
        "build/peel",
        "build/scan",
        "build/single_pass",
        "build/sort",
        "combine",
        "filter",
        "fragments",
        "gather",
        "light",
        "maps",
        "plane",
        "trace",
    ]
);

/// Answers rays from layered depth images, in shaders. Binds two storage buffers, or two textures.
///
/// With [`Coverage::Touched`](crate::Coverage::Touched) its answers are those of the exact tracers on GPUs, but for what
/// 32 bits make of rays that start far outside: those are moved onto the maps first, so that they leak nowhere, but meet
/// what is 10⁻⁷ of their way beside them.
#[derive(Debug)]
pub struct LdiGpuTracer {
    scene: Arc<Scene>,
    selection: Selection,
    params: LdiParams,
    builder: MapBuilder,
    binding: TracerBinding,
}

const LABEL: &str = "layered depth images";
/// The tables' names.
const MAPS: &str = "the layered depth images";
const FACES: &str = "the triangles of the layered depth images";

/// What the shader reads.
struct Tables {
    maps: Vec<Words>,
    faces: Vec<Words>,
}

impl Tables {
    fn new(params: &LdiParams, maps: &Maps) -> Self {
        Self {
            maps: words(params, maps),
            faces: faces(&maps.blocks, &maps.surfaces, &maps.planes),
        }
    }

    fn bind(&self) -> [TracerTable<'_>; 2] {
        [
            (MAPS, bytemuck::cast_slice(&self.maps)),
            (FACES, bytemuck::cast_slice(&self.faces)),
        ]
    }
}

impl LdiGpuTracer {
    /// Builds the maps of the selected part of a scene on the device.
    ///
    /// Where what that takes is larger than the buffers that the device binds, they are built on the CPU and uploaded.
    ///
    /// # Errors
    /// As [`BuildGpuTracer::build`], and [`Error::Parameter`] for parameters out of their
    /// range and maps that would take more memory than is allowed.
    pub fn build_with(
        context: &Context,
        scene: &Arc<Scene>,
        selection: &Selection,
        params: &LdiParams,
        method: BuildMethod,
    ) -> Result<Self> {
        let plan = Plan::new(scene, &scene.transforms(), selection, params)?;
        let mut builder = MapBuilder::new(method);
        let binding = match builder.build(context, &plan) {
            Ok([maps, faces]) => {
                TracerBinding::from_buffers(context, LABEL, &[(MAPS, maps), (FACES, faces)])?
            }
            Err(Error::GpuLimit { .. }) => {
                let tables = Tables::new(params, &plan.draw_all()?);
                TracerBinding::new(context, LABEL, None, &tables.bind())?
            }
            Err(error) => return Err(error),
        };
        Ok(Self {
            binding,
            builder,
            scene: scene.clone(),
            selection: *selection,
            params: *params,
        })
    }

    /// Uploads the maps of a tracer on CPUs, which were built or loaded.
    ///
    /// # Errors
    /// [`Error::GpuLimit`] when they are too large for the device, and
    /// [`Error::Gpu`] when it fails.
    pub fn upload(context: &Context, twin: &LdiTracer) -> Result<Self> {
        let tables = Tables::new(twin.params(), twin.maps());
        Ok(Self {
            binding: TracerBinding::new(context, LABEL, None, &tables.bind())?,
            builder: MapBuilder::new(BuildMethod::default()),
            scene: twin.scene().clone(),
            selection: *twin.selection(),
            params: *twin.params(),
        })
    }
}

impl GpuTracer for LdiGpuTracer {
    fn name(&self) -> &'static str {
        "ldi"
    }

    fn answers(&self) -> Answers {
        Answers::Surface
    }

    fn module(&self) -> &'static str {
        "ldi::trace"
    }

    fn packages(&self) -> &[ShaderPackage] {
        &[SHADERS]
    }

    fn shader_flags(&self) -> &[&'static str] {
        self.binding.shader_flags()
    }

    fn bind_group_layout(&self) -> &wgpu::BindGroupLayout {
        self.binding.layout()
    }

    fn bind_group(&self) -> &wgpu::BindGroup {
        self.binding.group()
    }
}

impl BuildGpuTracer for LdiGpuTracer {
    type Options = LdiParams;

    fn build(
        context: &Context,
        scene: &Arc<Scene>,
        selection: &Selection,
        params: &LdiParams,
    ) -> Result<Self> {
        Self::build_with(context, scene, selection, params, BuildMethod::default())
    }

    /// Builds the maps anew: they are for what does not move.
    fn update(&mut self, context: &Context, transforms: &[Affine3A]) -> Result<()> {
        let plan = Plan::new(&self.scene, transforms, &self.selection, &self.params)?;
        match self.builder.build(context, &plan) {
            Ok([maps, faces]) => {
                let tables = [(MAPS, maps), (FACES, faces)];
                self.binding.replace_with_buffers(context, &tables)
            }
            Err(Error::GpuLimit { .. }) => {
                let tables = Tables::new(&self.params, &plan.draw_all()?);
                self.binding.replace(context, None, &tables.bind())
            }
            Err(error) => Err(error),
        }
    }

    fn bytes(&self) -> u64 {
        self.binding.bytes()
    }
}
