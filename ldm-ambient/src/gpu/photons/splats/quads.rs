//! Stage 9 as in the paper (§4.2): every splat is an instance of a quad over the pixels that it may reach, and blending adds it.
//!
//! What blends is taken in the order in which it is drawn, that of the splats, whatever the order in which it is computed.

use isophote_scene::gpu::{Context, Timer};
use wgpu::{BindGroup, BindingResource, BufferBindingType, ShaderStages, TextureFormat};

use crate::{Error, Result, gpu::linker};

/// Nothing that is added up is lost in it.
const FORMAT: TextureFormat = TextureFormat::Rgba32Float;

#[derive(Debug)]
pub(super) struct Quads {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::RenderPipeline,
    /// W/m².
    pub(super) light: wgpu::TextureView,
}

impl Quads {
    pub(super) fn new(context: &Context, size: [u32; 2]) -> Result<Self> {
        let features = context.device().features();
        if !features.contains(wgpu::Features::FLOAT32_BLENDABLE) {
            return Err(Error::parameter(
                "the way of splatting",
                "quads",
                "the device does not blend 32-bit floats: choose tiles",
            ));
        }
        let layout = layout(context)?;
        Ok(Self {
            pipeline: pipeline(context, &layout)?,
            layout,
            light: light(context, size)?,
        })
    }

    /// Of what all of splatting binds, that which quads do.
    pub(super) fn bind(
        &self,
        context: &Context,
        all: &[(u32, BindingResource<'_>)],
    ) -> Result<BindGroup> {
        let used = all.iter().filter(|(binding, _)| {
            let mut bindings = BINDINGS.iter();
            bindings.any(|(used, ..)| used == binding)
        });
        let entries: Vec<_> = used
            .map(|(binding, resource)| wgpu::BindGroupEntry {
                binding: *binding,
                resource: resource.clone(),
            })
            .collect();
        Ok(context.check("splatting quads", |device| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("splatting quads"),
                layout: &self.layout,
                entries: &entries,
            })
        })?)
    }

    /// Records that there is no light.
    pub(super) fn clear(&self, encoder: &mut wgpu::CommandEncoder) {
        self.pass(encoder, wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), None);
    }

    /// Records that so many splats are added, of the maps that a uniform at an offset tells of.
    pub(super) fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        groups: &[BindGroup],
        slots: u32,
        offset: u32,
        timer: Option<&mut Timer>,
    ) {
        let mut pass = self.pass(encoder, wgpu::LoadOp::Load, timer);
        pass.set_pipeline(&self.pipeline);
        for group in groups {
            pass.set_bind_group(0, group, &[offset]);
            pass.draw(0..4, 0..slots);
        }
    }

    fn pass<'a>(
        &self,
        encoder: &'a mut wgpu::CommandEncoder,
        load: wgpu::LoadOp<wgpu::Color>,
        timer: Option<&mut Timer>,
    ) -> wgpu::RenderPass<'a> {
        let attachment = wgpu::RenderPassColorAttachment {
            view: &self.light,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load,
                store: wgpu::StoreOp::Store,
            },
        };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("splat"),
            color_attachments: &[Some(attachment)],
            timestamp_writes: timer.and_then(|timer| timer.render("splat")),
            ..Default::default()
        })
    }
}

const UNIFORM: BufferBindingType = BufferBindingType::Uniform;
const STORAGE: BufferBindingType = BufferBindingType::Storage { read_only: true };
/// The maps, what splatting is told, points, photons, splats, the screen.
const BINDINGS: [(u32, ShaderStages, BufferBindingType); 6] = [
    (0, ShaderStages::VERTEX, UNIFORM),
    (3, ShaderStages::VERTEX_FRAGMENT, UNIFORM),
    (4, ShaderStages::VERTEX, STORAGE),
    (5, ShaderStages::VERTEX, STORAGE),
    (6, ShaderStages::VERTEX, STORAGE),
    (7, ShaderStages::FRAGMENT, STORAGE),
];

fn layout(context: &Context) -> Result<wgpu::BindGroupLayout> {
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
    Ok(context.check("splatting quads", |device| {
        device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("splatting quads"),
            entries: &BINDINGS.map(entry),
        })
    })?)
}

fn pipeline(context: &Context, layout: &wgpu::BindGroupLayout) -> Result<wgpu::RenderPipeline> {
    let shader = linker().link("ldm_ambient::photons::quads")?;
    let module = shader.module(context)?;
    let sum = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    let target = wgpu::ColorTargetState {
        format: FORMAT,
        blend: Some(wgpu::BlendState {
            color: sum,
            alpha: sum,
        }),
        write_mask: wgpu::ColorWrites::ALL,
    };
    let pipeline = context.check("splatting quads", |device| {
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("splatting quads"),
            bind_group_layouts: &[Some(layout)],
            immediate_size: 0,
        });
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("splatting quads"),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("corner"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState {
                topology: wgpu::PrimitiveTopology::TriangleStrip,
                ..wgpu::PrimitiveState::default()
            },
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("splat"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(target)],
            }),
            multiview_mask: None,
            cache: None,
        })
    })?;
    Ok(pipeline)
}

fn light(context: &Context, [width, height]: [u32; 2]) -> Result<wgpu::TextureView> {
    let texture = context.check("light of photons", |device| {
        device.create_texture(&wgpu::TextureDescriptor {
            label: Some("light of photons"),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        })
    })?;
    Ok(texture.create_view(&wgpu::TextureViewDescriptor::default()))
}
