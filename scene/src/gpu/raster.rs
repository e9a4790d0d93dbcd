//! What rasterising passes share: pipelines that fetch their vertices from the scene's buffers, and the draws.

use std::sync::OnceLock;

use super::{Context, GpuScene, Linker, upload::Draw, words::Placement};
use crate::Result;

/// What distinguishes a rasterising pass.
#[derive(Debug)]
pub(super) struct RasterPass {
    /// The WESL module with the vertex shader `corner`.
    pub(super) module: &'static str,
    /// Its fragment shader; masked triangles only, where `opaque_fragments` is off.
    pub(super) fragment: &'static str,
    /// Whether opaque triangles need the fragment shader too.
    pub(super) opaque_fragments: bool,
    pub(super) targets: Vec<Option<wgpu::ColorTargetState>>,
    pub(super) samples: u32,
}

/// The pipelines of a pass for every scene.
#[derive(Debug)]
pub(super) struct RasterPipelines {
    own: wgpu::BindGroupLayout,
    pass: RasterPass,
    buffers: ScenePipelines,
    /// Few scenes are so large: made when the first is drawn.
    textures: OnceLock<ScenePipelines>,
}

/// Pipelines for meshes that stop every ray and for those with masked triangles: a fragment shader that may discard keeps
/// the hardware from testing depth before it runs.
#[derive(Debug)]
pub(super) struct ScenePipelines {
    opaque: wgpu::RenderPipeline,
    masked: wgpu::RenderPipeline,
}

/// Clip depth of the nearest is 1, of the farthest 0.
pub(super) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

impl RasterPipelines {
    /// `own` is the layout of group 0; the scene is group 2.
    pub(super) fn new(
        context: &Context,
        own: wgpu::BindGroupLayout,
        pass: RasterPass,
    ) -> Result<Self> {
        Ok(Self {
            buffers: ScenePipelines::new(context, &own, &pass, Placement::Buffers)?,
            textures: OnceLock::new(),
            own,
            pass,
        })
    }

    /// Those for a scene.
    pub(super) fn of(&self, context: &Context, scene: &GpuScene) -> Result<&ScenePipelines> {
        if !scene.is_in_textures() {
            return Ok(&self.buffers);
        }
        if let Some(made) = self.textures.get() {
            return Ok(made);
        }
        let made = ScenePipelines::new(context, &self.own, &self.pass, Placement::Textures)?;
        Ok(self.textures.get_or_init(|| made))
    }
}

impl ScenePipelines {
    fn new(
        context: &Context,
        own: &wgpu::BindGroupLayout,
        pass: &RasterPass,
        placement: Placement,
    ) -> Result<Self> {
        Ok(Self {
            opaque: pipeline(context, own, pass, placement, false)?,
            masked: pipeline(context, own, pass, placement, true)?,
        })
    }

    /// Draws, in the order of the instances.
    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, scene: &GpuScene, draws: &[Draw]) {
        pass.set_bind_group(2, scene.bind_group(), &[]);
        for masked in [false, true] {
            let pipeline = if masked { &self.masked } else { &self.opaque };
            pass.set_pipeline(pipeline);
            for draw in draws.iter().filter(|draw| draw.masked == masked) {
                pass.draw(0..3 * draw.triangle_count, draw.instances.clone());
            }
        }
    }
}

fn pipeline(
    context: &Context,
    own: &wgpu::BindGroupLayout,
    pass: &RasterPass,
    placement: Placement,
    masked: bool,
) -> Result<wgpu::RenderPipeline> {
    let shader = Linker::default()
        .feature("masked", masked)
        .feature("multisampled", pass.samples > 1)
        .feature("scene_in_textures", placement == Placement::Textures)
        .link(pass.module)?;
    let module = shader.module(context)?;
    let scene = GpuScene::layout(context.device(), placement);
    context.check(pass.module, |device| {
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(pass.module),
            bind_group_layouts: &[Some(own), None, Some(&scene)],
            immediate_size: 0,
        });
        let fragment = wgpu::FragmentState {
            module: &module,
            entry_point: Some(pass.fragment),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &pass.targets,
        };
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(pass.module),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("corner"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            // Surfaces are two-sided: nothing is culled.
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH_FORMAT,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState {
                count: pass.samples,
                ..Default::default()
            },
            fragment: (masked || pass.opaque_fragments).then_some(fragment),
            multiview_mask: None,
            cache: None,
        })
    })
}

/// What depth is cleared to before a pass; kept afterwards where it is read.
pub(super) fn depth_attachment(
    view: &wgpu::TextureView,
    store: wgpu::StoreOp,
) -> wgpu::RenderPassDepthStencilAttachment<'_> {
    wgpu::RenderPassDepthStencilAttachment {
        view,
        depth_ops: Some(wgpu::Operations {
            load: wgpu::LoadOp::Clear(0.0),
            store,
        }),
        stencil_ops: None,
    }
}

/// A layout entry of a uniform buffer.
pub(super) fn uniform_entry(binding: u32, dynamic: bool) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::all(),
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: dynamic,
            min_binding_size: None,
        },
        count: None,
    }
}
