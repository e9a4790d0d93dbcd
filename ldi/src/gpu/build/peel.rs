//! Depth peeling (§3.1): a pass for each layer, until none finds any more; then the prefix sum of how many each pixel has,
//! and the layers are put beside each other.

use isophote_scene::{Result, gpu::Context};

use super::{Budget, Compacted, Group, Source};
use crate::gpu::kernel::{Kernel, PrefixSum, bind, linker, uniform};

/// Pixels of a group: the layers of all passes are kept until they are compacted.
pub(super) const MOST_PIXELS: u32 = 1 << 20;
/// Maps of a group: WebGPU's default for layers of textures.
pub(super) const MOST_MAPS: u32 = 256;
/// Passes before it is asked whether they found anything.
const BATCH: usize = 4;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Draws layer behind layer.
pub(super) struct Peel {
    wide: bool,
    first: wgpu::RenderPipeline,
    next: wgpu::RenderPipeline,
    count: Kernel,
    scatter: Kernel,
    prefix_sum: PrefixSum,
}

/// What passes draw into: one picture a map.
struct Target {
    all: wgpu::TextureView,
    maps: Vec<wgpu::TextureView>,
}

impl Target {
    fn new(
        source: &Source<'_>,
        group: Group,
        format: wgpu::TextureFormat,
        label: &str,
    ) -> Result<Self> {
        let side = source.settings.resolution;
        source.context.check(label, |device| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d {
                    width: side,
                    height: side,
                    depth_or_array_layers: group.count,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                    | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            let view = |dimension, first, count| {
                texture.create_view(&wgpu::TextureViewDescriptor {
                    dimension: Some(dimension),
                    base_array_layer: first,
                    array_layer_count: Some(count),
                    ..Default::default()
                })
            };
            Self {
                all: view(wgpu::TextureViewDimension::D2Array, 0, group.count),
                maps: (0..group.count)
                    .map(|map| view(wgpu::TextureViewDimension::D2, map, 1))
                    .collect(),
            }
        })
    }
}

impl Peel {
    pub(super) fn new(context: &Context, flags: &[(&'static str, bool)]) -> Result<Self> {
        let wide = flags.contains(&("wide", true));
        Ok(Self {
            wide,
            first: pipeline(context, flags, wide, true)?,
            next: pipeline(context, flags, wide, false)?,
            count: Kernel::new(context, "ldi::build::compact", "count", flags)?,
            scatter: Kernel::new(context, "ldi::build::compact", "scatter", flags)?,
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
        let counts = context.storage("layers of pixels", 4 * (pixels + 1))?;
        let passes = self.passes(source, group, &counts, &budget)?;
        let encoder = context.device().create_command_encoder(&Default::default());
        let (firsts, count) = self.prefix_sum.of(context, encoder, &counts, pixels)?;
        budget.check(count)?;
        let bytes = source.layer_bytes * u64::from(count);
        let layers = context.storage("layers", bytes)?;
        for (number, pass) in (0..).zip(&passes) {
            let settings = uniform(context, source.settings(group, number))?;
            let mut encoder = context.device().create_command_encoder(&Default::default());
            let resources = [
                (0, settings.as_entire_binding()),
                (1, wgpu::BindingResource::TextureView(&pass.all)),
                (2, counts.as_entire_binding()),
                (4, firsts.as_entire_binding()),
                (5, layers.as_entire_binding()),
            ];
            let groups = tiles(source, group);
            self.scatter
                .record_numbered(context, &mut encoder, &resources, groups)?;
            context.submit("compacting layers", encoder)?;
        }
        Ok(Compacted {
            firsts,
            cursors: counts,
            layers,
            count,
        })
    }

    /// Peels until a pass finds nothing; counts what each pixel has.
    fn passes(
        &self,
        source: &Source<'_>,
        group: Group,
        counts: &wgpu::Buffer,
        budget: &Budget<'_>,
    ) -> Result<Vec<Target>> {
        let context = source.context;
        let format = layer_format(self.wide);
        let settings = uniform(context, source.settings(group, 0))?;
        let depths = [
            Target::new(source, group, DEPTH, "depths")?,
            Target::new(source, group, DEPTH, "depths")?,
        ];
        let most =
            budget.plan.params.max_bytes / (source.layer_bytes * source.pixels(group)).max(1);
        let mut passes: Vec<Target> = Vec::new();
        loop {
            let found = context.storage("found layers", 4)?;
            for _ in 0..BATCH {
                if passes.len() as u64 >= most {
                    return Err(budget.too_large());
                }
                let target = Target::new(source, group, format, "layers")?;
                let number = passes.len();
                let depth = &depths[number % 2];
                let before = passes.last().map(|last| (last, &depths[(number + 1) % 2]));
                self.draw(source, group, &settings, before, (&target, depth))?;
                let mut encoder = context.device().create_command_encoder(&Default::default());
                // Only the last of the batch is asked.
                let found = match (number + 1) % BATCH {
                    0 => found.clone(),
                    _ => context.storage("found layers", 4)?,
                };
                let resources = [
                    settings.as_entire_binding(),
                    wgpu::BindingResource::TextureView(&target.all),
                    counts.as_entire_binding(),
                    found.as_entire_binding(),
                ];
                let groups = tiles(source, group);
                self.count
                    .record(context, &mut encoder, &resources, groups)?;
                context.submit("counting layers", encoder)?;
                passes.push(target);
            }
            if context.read::<u32>("found layers", &found, 1)?[0] == 0 {
                return Ok(passes);
            }
        }
    }

    fn draw(
        &self,
        source: &Source<'_>,
        group: Group,
        settings: &wgpu::Buffer,
        before: Option<(&Target, &Target)>,
        (target, depth): (&Target, &Target),
    ) -> Result<()> {
        let context = source.context;
        let pipeline = match before {
            None => &self.first,
            Some(_) => &self.next,
        };
        let buffers = [settings, &source.faces, &source.frames];
        let resources: Vec<_> = (0..)
            .zip(buffers.map(wgpu::Buffer::as_entire_binding))
            .collect();
        let layout = pipeline.get_bind_group_layout(0);
        let binding = bind(context, "depth peeling", &layout, &resources)?;
        let before = before.map(|(layers, depths)| {
            let resources = [
                (0, wgpu::BindingResource::TextureView(&layers.all)),
                (1, wgpu::BindingResource::TextureView(&depths.all)),
            ];
            let layout = pipeline.get_bind_group_layout(1);
            bind(context, "depth peeling", &layout, &resources)
        });
        let before = before.transpose()?;
        for maps in source.pieces(group) {
            context.check("depth peeling", |device| {
                let mut encoder = device.create_command_encoder(&Default::default());
                for map in maps {
                    let own = (map - group.first) as usize;
                    let [layer, depth] = [target, depth].map(|target| &target.maps[own]);
                    let mut pass = begin(&mut encoder, layer, depth, self.wide);
                    pass.set_pipeline(pipeline);
                    pass.set_bind_group(0, &binding, &[]);
                    if let Some(before) = &before {
                        pass.set_bind_group(1, before, &[]);
                    }
                    pass.draw(0..source.vertices, map..map + 1);
                }
                context.queue().submit([encoder.finish()]);
            })?;
        }
        Ok(())
    }
}

/// Workgroups over all pixels of a group.
fn tiles(source: &Source<'_>, group: Group) -> [u32; 3] {
    let side = source.settings.resolution.div_ceil(8);
    [side, side, group.count]
}

fn layer_format(wide: bool) -> wgpu::TextureFormat {
    if wide {
        wgpu::TextureFormat::Rg32Uint
    } else {
        wgpu::TextureFormat::R32Uint
    }
}

/// A pass for one map. Where nothing is found stays what is no layer: its near depth lies behind its far one.
fn begin<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    layer: &wgpu::TextureView,
    depth: &wgpu::TextureView,
    wide: bool,
) -> wgpu::RenderPass<'a> {
    let none = if wide {
        wgpu::Color {
            g: f64::from(0xffff_0000_u32),
            ..wgpu::Color::TRANSPARENT
        }
    } else {
        wgpu::Color {
            r: f64::from(0xff00_0000_u32),
            ..wgpu::Color::TRANSPARENT
        }
    };
    let layer = wgpu::RenderPassColorAttachment {
        view: layer,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations {
            load: wgpu::LoadOp::Clear(none),
            store: wgpu::StoreOp::Store,
        },
    };
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("depth peeling"),
        color_attachments: &[Some(layer)],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: depth,
            depth_ops: Some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(1.0),
                store: wgpu::StoreOp::Store,
            }),
            stencil_ops: None,
        }),
        ..Default::default()
    })
}

fn pipeline(
    context: &Context,
    flags: &[(&'static str, bool)],
    wide: bool,
    first: bool,
) -> Result<wgpu::RenderPipeline> {
    let shader = linker(flags)
        .feature("first", first)
        .link("ldi::build::peel")?;
    let module = shader.module(context)?;
    context.check("depth peeling", |device| {
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("depth peeling"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("corner"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Less),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("next_layer"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(layer_format(wide).into())],
            }),
            multiview_mask: None,
            cache: None,
        })
    })
}
