//! The maps of some directions: bound, and recorded batch by batch.

use bytemuck::Zeroable;
use isophote_scene::gpu::{Context, Dispatch, GpuScene, Timer, UniformArray};
use wgpu::{BindGroup, Buffer};

use super::{Asked, BATCH, BLOCK, Batch, BuildMethod, Builder, FORMAT, Kept, MapView, Memory};
use crate::{
    Result,
    cpu::view::View,
    gpu::{grid, reach::Near, triangles::Triangles},
};

/// The maps of some directions, ready to be built batch by batch.
pub(in crate::gpu) struct Series<'a> {
    builder: &'a Builder,
    views: Vec<&'a [View]>,
    pub(in crate::gpu) batches: UniformArray<Batch>,
    /// Of each chunk of triangles.
    culls: Vec<BindGroup>,
    draws: Vec<BindGroup>,
    /// Of each pass of the prefix sum.
    scan: Vec<BindGroup>,
    sort: BindGroup,
    /// As large as the largest map.
    picture: wgpu::TextureView,
}

impl Builder {
    /// Maps along some directions, of some triangles.
    pub(in crate::gpu) fn series<'a>(
        &'a self,
        context: &Context,
        triangles: &Triangles,
        views: &'a [View],
        asked: Asked,
    ) -> Result<Series<'a>> {
        let views: Vec<&[View]> = views.chunks(self.most).collect();
        let firsts = (0..).step_by(self.most);
        let values = views.iter().zip(firsts);
        let values = values.map(|(views, first)| self.batch(views, first, asked));
        let values: Vec<Batch> = values.collect();
        let batches = UniformArray::new(context, "maps", &values)?;
        let memory = &self.memory;
        let buffer = |binding, buffer: &'a Buffer| (binding, buffer.as_entire_binding());
        let draws = triangles.chunks.iter().map(|chunk| {
            let mut resources = vec![
                (0, batches.binding()),
                (1, chunk.corners.as_entire_binding()),
                buffer(2, &memory.pixels),
                buffer(3, &memory.layers),
                (5, chunk.drawn.as_entire_binding()),
            ];
            resources.extend(self.reach.as_ref().map(|reach| buffer(4, &reach.ranges)));
            let entry = |(binding, resource)| wgpu::BindGroupEntry { binding, resource };
            let entries: Vec<_> = resources.into_iter().map(entry).collect();
            context.check("drawing maps", |device| {
                device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some("drawing maps"),
                    layout: &self.pipelines.layout,
                    entries: &entries,
                })
            })
        });
        let draws = draws.collect::<isophote_scene::Result<_>>()?;
        let culls = triangles.chunks.iter().map(|chunk| {
            let mut resources = vec![
                (0, batches.binding()),
                (1, chunk.corners.as_entire_binding()),
                (2, chunk.drawn.as_entire_binding()),
                (3, chunk.draws.as_entire_binding()),
            ];
            resources.extend(self.reach.as_ref().map(|reach| buffer(4, &reach.ranges)));
            self.pipelines.cull.bind(context, &resources)
        });
        let sums = [buffer(1, &memory.firsts), buffer(2, &memory.totals)];
        let scan = self.pipelines.scan.iter();
        let scan = scan.map(|pass| pass.bind(context, &sums));
        let sort = [
            (0, batches.binding()),
            buffer(1, &memory.firsts),
            buffer(2, &memory.layers),
        ];
        Ok(Series {
            builder: self,
            culls: culls.collect::<isophote_scene::Result<_>>()?,
            draws,
            scan: scan.collect::<isophote_scene::Result<_>>()?,
            sort: self.pipelines.sort.bind(context, &sort)?,
            picture: picture(context, &views)?,
            views,
            batches,
        })
    }

    fn batch(&self, views: &[View], first: u32, asked: Asked) -> Batch {
        let mut batch = Batch {
            views: [MapView::zeroed(); BATCH],
            count: views.len() as u32,
            stride: self.stride,
            capacity: self.capacity,
            points: asked.points,
            tolerance: asked.tolerance,
            // An infinite one is a large number.
            d_max: asked.d_max.min(1e37),
            tiles: self.tiles,
            first,
        };
        for (place, view) in batch.views.iter_mut().zip(views) {
            *place = MapView::new(view);
        }
        batch
    }
}

impl Series<'_> {
    pub(in crate::gpu) fn len(&self) -> usize {
        self.views.len()
    }

    /// How many maps a batch has.
    pub(in crate::gpu) fn maps(&self, batch: usize) -> usize {
        self.views[batch].len()
    }

    /// Records the building of the maps of a batch, after what is within reach of those that will ask them.
    pub(in crate::gpu) fn record_near(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        batch: usize,
        near: Option<&Near<'_>>,
        (triangles, gpu_scene): (&Triangles, &GpuScene),
        mut timer: Option<&mut Timer>,
    ) {
        if let Some(near) = near {
            near.spread(encoder, (batch, self.maps(batch)), timer.as_deref_mut());
        }
        self.record(encoder, batch, triangles, gpu_scene, timer);
    }

    /// Records the building of the maps of a batch.
    pub(in crate::gpu) fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        batch: usize,
        triangles: &Triangles,
        gpu_scene: &GpuScene,
        mut timer: Option<&mut Timer>,
    ) {
        let Builder {
            kept,
            pipelines,
            memory,
            ..
        } = self.builder;
        encoder.clear_buffer(&memory.pixels, 0, None);
        if *kept == Kept::Layers(BuildMethod::LinkedLists) {
            encoder.clear_buffer(&memory.layers, 0, None);
        }
        self.cull(encoder, batch, triangles, timer.as_deref_mut());
        for (time, draw) in pipelines.draws.iter().enumerate() {
            if time == 1 {
                self.sum_up(encoder, timer.as_deref_mut());
            }
            self.draw(
                encoder,
                batch,
                draw,
                triangles,
                gpu_scene,
                timer.as_deref_mut(),
            );
        }
        if *kept == Kept::Layers(BuildMethod::Linearised) {
            let pixels = u64::from(self.builder.stride) * self.views[batch].len() as u64;
            let dispatch = Dispatch {
                offset: Some(UniformArray::<Batch>::offset(batch as u32)),
                workgroups: grid(pixels.div_ceil(64)),
            };
            pipelines
                .sort
                .record(encoder, "sort", timer, &[&self.sort], &[dispatch]);
        }
    }

    /// Finds the triangles that are drawn into each map.
    fn cull(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        batch: usize,
        triangles: &Triangles,
        mut timer: Option<&mut Timer>,
    ) {
        let pass = &self.builder.pipelines.cull;
        for (chunk, group) in triangles.chunks.iter().zip(&self.culls) {
            chunk.clear(encoder);
            let dispatch = Dispatch {
                offset: Some(UniformArray::<Batch>::offset(batch as u32)),
                workgroups: grid(u64::from(chunk.count.div_ceil(64))),
            };
            let timer = timer.as_deref_mut();
            pass.record(encoder, "cull", timer, &[group], &[dispatch]);
        }
    }

    /// Makes of how many layers pixels have where they begin.
    fn sum_up(&self, encoder: &mut wgpu::CommandEncoder, mut timer: Option<&mut Timer>) {
        let Memory { pixels, firsts, .. } = &self.builder.memory;
        encoder.copy_buffer_to_buffer(pixels, 0, firsts, 0, firsts.size());
        let blocks = grid((firsts.size() / 4).div_ceil(BLOCK));
        let groups = [blocks, [1, 1, 1], blocks];
        let passes = self.builder.pipelines.scan.iter().zip(&self.scan);
        for ((pass, group), workgroups) in passes.zip(groups) {
            let dispatch = Dispatch {
                offset: None,
                workgroups,
            };
            let timer = timer.as_deref_mut();
            pass.record(encoder, "prefix sum", timer, &[group], &[dispatch]);
        }
        encoder.copy_buffer_to_buffer(firsts, 0, pixels, 0, firsts.size());
    }

    fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        batch: usize,
        pipelines: &[wgpu::RenderPipeline; 2],
        triangles: &Triangles,
        gpu_scene: &GpuScene,
        timer: Option<&mut Timer>,
    ) {
        let attachment = wgpu::RenderPassColorAttachment {
            view: &self.picture,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                store: wgpu::StoreOp::Discard,
            },
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("drawing maps"),
            color_attachments: &[Some(attachment)],
            timestamp_writes: timer.and_then(|timer| timer.render("draw")),
            ..Default::default()
        });
        let offset = UniformArray::<Batch>::offset(batch as u32);
        pass.set_bind_group(2, gpu_scene.bind_group(), &[]);
        for (chunk, group) in triangles.chunks.iter().zip(&self.draws) {
            pass.set_pipeline(&pipelines[usize::from(chunk.masked)]);
            pass.set_bind_group(0, group, &[offset]);
            for (map, view) in (0..).zip(self.views[batch]) {
                let (columns, rows) = (view.columns as u32, view.rows as u32);
                pass.set_viewport(0.0, 0.0, columns as f32, rows as f32, 0.0, 1.0);
                pass.set_scissor_rect(0, 0, columns, rows);
                pass.draw_indirect(&chunk.draws, 16 * map);
            }
        }
    }
}

/// What gives the maps their sizes.
fn picture(context: &Context, views: &[&[View]]) -> Result<wgpu::TextureView> {
    let views = || views.iter().copied().flatten();
    let size = wgpu::Extent3d {
        width: views().map(|view| view.columns).max().unwrap_or(1) as u32,
        height: views().map(|view| view.rows).max().unwrap_or(1) as u32,
        depth_or_array_layers: 1,
    };
    let texture = context.check("drawing maps", |device| {
        device.create_texture(&wgpu::TextureDescriptor {
            label: Some("drawing maps"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        })
    })?;
    Ok(texture.create_view(&wgpu::TextureViewDescriptor::default()))
}
