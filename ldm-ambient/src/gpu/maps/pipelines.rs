//! What draws layers into maps, and what brings them into their order.

use isophote_scene::gpu::{ComputePass, Context, GpuScene, Shader};
use wgpu::ShaderStages;

use super::{BuildMethod, FORMAT, Kept};
use crate::{Result, gpu::linker};

/// The pipelines of a way to build maps.
#[derive(Debug)]
pub(super) struct Pipelines {
    pub(super) cull: ComputePass,
    pub(super) layout: wgpu::BindGroupLayout,
    /// One for each time that layers are drawn: for those that stop light everywhere, and for those that do not.
    pub(super) draws: Vec<[wgpu::RenderPipeline; 2]>,
    /// `sum_blocks`, `sum_totals`, `add_totals`.
    pub(super) scan: [ComputePass; 3],
    pub(super) sort: ComputePass,
}

impl Pipelines {
    pub(super) fn new(
        context: &Context,
        gpu_scene: &GpuScene,
        kept: Kept,
        reach: bool,
    ) -> Result<Self> {
        let layout = context.check("drawing maps", |device| {
            let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
            let entry = |(binding, visibility, ty)| wgpu::BindGroupLayoutEntry {
                binding,
                visibility,
                ty: wgpu::BindingType::Buffer {
                    ty,
                    has_dynamic_offset: binding == 0,
                    min_binding_size: None,
                },
                count: None,
            };
            let uniform = wgpu::BufferBindingType::Uniform;
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("drawing maps"),
                entries: &[
                    (0, ShaderStages::VERTEX_FRAGMENT, uniform),
                    (1, ShaderStages::VERTEX, storage(true)),
                    (2, ShaderStages::FRAGMENT, storage(false)),
                    (3, ShaderStages::FRAGMENT, storage(false)),
                    (5, ShaderStages::VERTEX, storage(true)),
                    (4, ShaderStages::FRAGMENT, storage(true)),
                ]
                .map(entry)[..if reach { 6 } else { 5 }],
            })
        })?;
        let flags: &[&str] = match kept {
            Kept::Extents => &["extents"],
            Kept::Layers(BuildMethod::LinkedLists) => &["lists"],
            Kept::Layers(BuildMethod::Linearised) => &["count", "fill"],
        };
        let pair = |flag: &&str| -> Result<[wgpu::RenderPipeline; 2]> {
            let pipeline = |masked| pipeline(context, gpu_scene, &layout, (flag, reach), masked);
            Ok([pipeline(false)?, pipeline(true)?])
        };
        let draws = flags.iter().map(pair).collect::<Result<_>>()?;
        let cull = linker().feature("reach", reach).link("ldm_ambient::cull")?;
        let scan = linker().link("ldm_ambient::scan")?;
        let pass = |entry_point| scan.compute_pass(context, entry_point, &[], &[]);
        let scan = [
            pass("sum_blocks")?,
            pass("sum_totals")?,
            pass("add_totals")?,
        ];
        let sort = linker().link("ldm_ambient::sort")?;
        Ok(Self {
            cull: cull.compute_pass(context, "cull", &[], &[0])?,
            draws,
            scan,
            sort: sort.compute_pass(context, "sort", &[], &[0])?,
            layout,
        })
    }
}

fn pipeline(
    context: &Context,
    gpu_scene: &GpuScene,
    layout: &wgpu::BindGroupLayout,
    (flag, reach): (&str, bool),
    masked: bool,
) -> Result<wgpu::RenderPipeline> {
    let shader: Shader = linker()
        .scene(gpu_scene)
        .feature(flag, true)
        .feature("masked", masked)
        .feature("reach", reach)
        .link("ldm_ambient::draw")?;
    let module = shader.module(context)?;
    let target = wgpu::ColorTargetState {
        format: FORMAT,
        blend: None,
        write_mask: wgpu::ColorWrites::empty(),
    };
    let pipeline = context.check("drawing maps", |device| {
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("drawing maps"),
            bind_group_layouts: &[Some(layout), None, Some(gpu_scene.bind_group_layout())],
            immediate_size: 0,
        });
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("drawing maps"),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("corner"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            // Front and back faces alike.
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("layer"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(target)],
            }),
            multiview_mask: None,
            cache: None,
        })
    })?;
    Ok(pipeline)
}
