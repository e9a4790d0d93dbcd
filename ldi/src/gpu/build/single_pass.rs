//! Count, prefix sum, scatter: the same draw twice, in any order of its fragments.

use std::iter::once;

use isophote_scene::{Result, gpu::Context};

use super::{Budget, Compacted, Group, Source};
use crate::gpu::kernel::{PrefixSum, bind, linker, uniform};

/// Pixels of a group.
pub(super) const MOST_PIXELS: u32 = 1 << 23;
/// Nothing is drawn into it.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

/// Draws fragments into buffers.
pub(super) struct SinglePass {
    pipeline: wgpu::RenderPipeline,
    prefix_sum: PrefixSum,
}

impl SinglePass {
    pub(super) fn new(context: &Context, flags: &[(&'static str, bool)]) -> Result<Self> {
        let shader = linker(flags).link("ldi::build::single_pass")?;
        let module = shader.module(context)?;
        let target = wgpu::ColorTargetState {
            format: FORMAT,
            blend: None,
            write_mask: wgpu::ColorWrites::empty(),
        };
        let pipeline = context.check("drawing layers", |device| {
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some("drawing layers"),
                layout: None,
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("corner"),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers: &[],
                },
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
        Ok(Self {
            pipeline,
            prefix_sum: PrefixSum::new(context)?,
        })
    }

    pub(super) fn layers(
        &self,
        source: &Source<'_>,
        group: Group,
        budget: Budget<'_>,
    ) -> Result<Compacted> {
        let context = source.context;
        let pixels = source.pixels(group);
        let cursors = context.storage("layers of pixels", 4 * (pixels + 1))?;
        let none = context.storage("no layers", 8)?;
        self.draw(source, group, 0, [&cursors, &none])?;
        let encoder = context.device().create_command_encoder(&Default::default());
        let (firsts, count) = self.prefix_sum.of(context, encoder, &cursors, pixels)?;
        budget.check(count)?;
        let bytes = source.layer_bytes * u64::from(count);
        let layers = context.storage("layers", bytes)?;
        let mut encoder = context.device().create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&firsts, 0, &cursors, 0, 4 * (pixels + 1));
        context.submit("layers", encoder)?;
        self.draw(source, group, count, [&cursors, &layers])?;
        Ok(Compacted {
            firsts,
            cursors,
            layers,
            count,
        })
    }

    fn draw(
        &self,
        source: &Source<'_>,
        group: Group,
        capacity: u32,
        [cursors, layers]: [&wgpu::Buffer; 2],
    ) -> Result<()> {
        let context = source.context;
        let settings = uniform(context, source.settings(group, capacity))?;
        let buffers = [&settings, &source.faces, &source.frames, cursors, layers];
        let resources: Vec<_> = (0..)
            .zip(buffers.map(wgpu::Buffer::as_entire_binding))
            .collect();
        let layout = self.pipeline.get_bind_group_layout(0);
        let binding = bind(context, "drawing layers", &layout, &resources)?;
        let nothing = nothing(context, source.settings.resolution)?;
        for maps in source.pieces(group) {
            context.check("drawing layers", |device| {
                let mut encoder = device.create_command_encoder(&Default::default());
                let attachment = wgpu::RenderPassColorAttachment {
                    view: &nothing,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Discard,
                    },
                };
                let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some("drawing layers"),
                    color_attachments: &[Some(attachment)],
                    ..Default::default()
                });
                pass.set_pipeline(&self.pipeline);
                pass.set_bind_group(0, &binding, &[]);
                pass.draw(0..source.vertices, maps);
                drop(pass);
                context.queue().submit(once(encoder.finish()));
            })?;
        }
        Ok(())
    }
}

/// What gives the picture its size.
fn nothing(context: &Context, side: u32) -> Result<wgpu::TextureView> {
    context.check("drawing layers", |device| {
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("drawing layers"),
            size: wgpu::Extent3d {
                width: side,
                height: side,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        texture.create_view(&wgpu::TextureViewDescriptor::default())
    })
}
