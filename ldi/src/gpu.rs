//! The maps on a GPU: built as [`LdiTracer`](crate::LdiTracer)'s, uploaded, and traced in shaders.
//!
//! | stage | CPU | GPU |
//! |---|---|---|
//! | maps | `cpu/maps.rs` | `gpu/upload.rs`, `shaders/maps.wesl` |
//! | tracing (§3.2) | `cpu/trace.rs` | `shaders/trace.wesl` |
//! | planes within pixels | `cpu/trace/meet.rs` | `shaders/plane.wesl` |

mod upload;

use std::sync::Arc;

use glam::Affine3A;
use isophote_scene::{
    Answers, Result, Scene, Selection, check_transforms,
    gpu::{BuildGpuTracer, Context, GpuTracer, ShaderPackage, TracerBinding, TracerTable},
    shader_package,
};

use self::upload::{Words, faces, words};
use crate::{LdiParams, cpu::build::build, cpu::maps::Maps};

/// The WESL modules of this crate.
pub const SHADERS: ShaderPackage = shader_package!("ldi", ["maps", "plane", "trace"]);

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
    binding: TracerBinding,
}

/// What the shader reads.
struct Tables {
    maps: Vec<Words>,
    faces: Vec<Words>,
}

impl Tables {
    fn new(params: &LdiParams, maps: &Maps) -> Self {
        Self {
            maps: words(params, maps),
            faces: faces(maps),
        }
    }

    fn bind(&self) -> [TracerTable<'_>; 2] {
        [
            ("the layered depth images", bytemuck::cast_slice(&self.maps)),
            ("their triangles", bytemuck::cast_slice(&self.faces)),
        ]
    }
}

impl LdiGpuTracer {
    /// Uploads maps that have been built or loaded before.
    ///
    /// # Errors
    /// [`Error::GpuLimit`](isophote_scene::Error::GpuLimit) when they are too large for the device, and
    /// [`Error::Gpu`](isophote_scene::Error::Gpu) when it fails.
    pub fn from_maps(
        context: &Context,
        scene: &Arc<Scene>,
        selection: &Selection,
        params: &LdiParams,
        maps: &Maps,
    ) -> Result<Self> {
        let tables = Tables::new(params, maps);
        Ok(Self {
            binding: TracerBinding::new(context, "layered depth images", None, &tables.bind())?,
            scene: scene.clone(),
            selection: *selection,
            params: *params,
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
        let maps = build(scene, &scene.transforms(), selection, params)?;
        Self::from_maps(context, scene, selection, params, &maps)
    }

    /// Builds the maps anew: they are for what does not move.
    fn update(&mut self, context: &Context, transforms: &[Affine3A]) -> Result<()> {
        check_transforms(&self.scene, transforms)?;
        let maps = build(&self.scene, transforms, &self.selection, &self.params)?;
        let tables = Tables::new(&self.params, &maps);
        self.binding.replace(context, None, &tables.bind())
    }

    fn bytes(&self) -> u64 {
        self.binding.bytes()
    }
}
