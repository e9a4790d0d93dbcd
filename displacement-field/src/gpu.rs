//! Fields on a GPU: uploaded once, with a tree over what is placed that is uploaded anew when instances move.
//!
//! | stage | CPU | GPU |
//! |---|---|---|
//! | positions | `positions/slater.rs` | `shaders/slater.wesl` |
//! | directions and samples | `directions.rs`, `cpu/samples.rs` | `gpu/upload.rs`, `shaders/maps.wesl` |
//! | look-up (Algorithm 2) | `cpu/look_up.rs` | `shaders/look_up.wesl` |
//! | placed fields | `cpu/span.rs`, `cpu/top.rs`, `cpu/walk.rs` | `gpu/upload.rs`, `shaders/trace.wesl` |
//!
//! Building is tracing, by any exact tracer, and stays on the CPU.

mod upload;

use std::sync::Arc;

use glam::Affine3A;
use isophote_scene::{
    Answers, Scene, Selection, WorldTriangle,
    gpu::{Context, GpuTracer, ShaderPackage, TracerBinding},
    shader_package, world_triangles,
};

use self::upload::{Fields, Words, tree_words};
use crate::{Error, FieldTracer, Result};

/// The WESL modules of this crate.
pub const SHADERS: ShaderPackage =
    shader_package!("displacement_field", ["look_up", "maps", "slater", "trace"]);

const LABEL: &str = "displacement fields";
/// The tables' names.
const FIELDS: &str = "the displacement fields";
const TREE: &str = "the tree over the displacement fields";

/// Answers rays from displacement fields, in shaders, and from the triangles of what has no field. Binds two storage buffers, or
/// two textures.
///
/// Knows distances but no triangles, also of what it meets exactly.
#[derive(Debug)]
pub struct FieldGpuTracer {
    twin: FieldTracer,
    others: Option<(Arc<Scene>, Selection)>,
    fields: Fields,
    buffer: wgpu::Buffer,
    binding: TracerBinding,
}

impl FieldGpuTracer {
    /// Uploads the fields of a tracer on CPUs, where they are placed, and triangles that have none: those that a selection takes
    /// of another scene with the same instances, one by one: such as the same one with other masks.
    ///
    /// # Errors
    /// [`Error::Parameter`] for fields whose positions are not Slater's, and when the other scene has not as many instances;
    /// [`Error::Scene`] when what is uploaded is too large for the device or it fails.
    pub fn new(
        context: &Context,
        twin: FieldTracer,
        others: Option<(Arc<Scene>, Selection)>,
    ) -> Result<Self> {
        if let Some((scene, _)) = &others {
            let (found, wanted) = (scene.instances.len(), twin.scene().instances.len());
            if found != wanted {
                return Err(Error::Parameter {
                    name: "the number of instances of the scene beside the fields",
                    value: format!("{found}, not {wanted}"),
                    expected: "both scenes are moved together and must have the same instances",
                });
            }
        }
        let (fields, words) = Fields::new(&twin)?;
        let buffer = context.buffer(FIELDS, &words, wgpu::BufferUsages::STORAGE)?;
        let transforms = others.as_ref().map(|(scene, _)| scene.transforms());
        let tree = tree(
            &twin,
            others.as_ref(),
            &fields,
            &transforms.unwrap_or_default(),
        );
        let tables = [
            (FIELDS, buffer.clone()),
            (TREE, upload_tree(context, &tree)?),
        ];
        Ok(Self {
            binding: TracerBinding::from_buffers(context, LABEL, &tables)?,
            twin,
            others,
            fields,
            buffer,
        })
    }

    /// Moves the instances, as [`BuildGpuTracer::update`](isophote_scene::gpu::BuildGpuTracer::update): only the tree is built and
    /// uploaded.
    ///
    /// # Errors
    /// As [`FieldTracer::update`], and [`Error::Scene`] when the device fails; the instances then are
    /// where they were.
    pub fn update(&mut self, context: &Context, transforms: &[Affine3A]) -> Result<()> {
        let mut twin = self.twin.clone();
        twin.update(transforms)?;
        let tree = tree(&twin, self.others.as_ref(), &self.fields, transforms);
        let tree = upload_tree(context, &tree)?;
        let tables = [(FIELDS, self.buffer.clone()), (TREE, tree)];
        self.binding.replace_with_buffers(context, &tables)?;
        self.twin = twin;
        Ok(())
    }

    /// The tracer on CPUs that has the same fields.
    pub const fn twin(&self) -> &FieldTracer {
        &self.twin
    }

    /// Bytes of GPU memory held.
    pub fn bytes(&self) -> u64 {
        self.binding.bytes()
    }
}

fn tree(
    twin: &FieldTracer,
    others: Option<&(Arc<Scene>, Selection)>,
    fields: &Fields,
    transforms: &[Affine3A],
) -> Vec<Words> {
    let triangles: Vec<(WorldTriangle, bool)> =
        others.map_or_else(Vec::new, |(scene, selection)| {
            let triangles = world_triangles(scene, transforms, selection);
            let masked = |triangle: WorldTriangle| (triangle, scene.is_masked(triangle.surface));
            triangles.into_iter().map(masked).collect()
        });
    tree_words(twin, fields, &triangles)
}

fn upload_tree(context: &Context, words: &[Words]) -> Result<wgpu::Buffer> {
    Ok(context.buffer(TREE, words, wgpu::BufferUsages::STORAGE)?)
}

impl GpuTracer for FieldGpuTracer {
    fn name(&self) -> &'static str {
        "field"
    }

    fn answers(&self) -> Answers {
        Answers::Distance
    }

    fn module(&self) -> &'static str {
        "displacement_field::trace"
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
