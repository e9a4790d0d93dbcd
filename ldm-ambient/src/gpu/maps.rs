//! Stages 2 to 4, the maps of several directions at a time, built by the device's rasteriser.
//!
//! - Linearised: layers are drawn and counted by pixel, the counts summed up (`scan.wesl`), the same layers drawn again and
//!   each put where its pixel's next one goes, and those of each pixel sorted (`sort.wesl`).
//! - Linked lists: layers are drawn once, and each is put at its place in its pixel's list (§3).
//! - Where the first and the last layer are enough, nothing else is kept.
//!
//! Only the order of the depths of a pixel is kept, so that nothing depends on the order in which a device draws.
//!
//! Memory cannot be allocated by the device. There is room for some layers, and how many were needed is noted; where there
//! were more, the picture is not right, and is made again with more room.

mod pipelines;

use bytemuck::{Pod, Zeroable};
use isophote_scene::gpu::{Context, Dispatch, GpuScene, Timer, UniformArray};
use wgpu::{BindGroup, BindingResource, Buffer};

use self::pipelines::Pipelines;
use super::{
    grid,
    reach::{Near, Reach},
    triangles::Triangles,
};
use crate::{Result, cpu::view::View};

/// How all layers of a pixel are found on a GPU: the same layers in the same order.
///
/// Lists are drawn once and sums twice, but lists are slower to walk along. On a software adapter with two threads (llvmpipe,
/// `benches/gpu.rs`), a map of 200² pixels takes with lists and with sums: 22 and 28 ms in `builtin:office` with a `d_max` of 1.5 m
/// for 400 × 300 points, of which asking are 4.7 and 2.5 ms; 25 and 47 ms in Sponza (66,000 triangles) with 12 m for 200 × 150
/// points; 49 and 92 ms in a hairball (245,000 triangles) with 1 m for 100² points, and 5 and 8 ms there with maps of 50². Only with
/// millions of points, or with few triangles, are sums faster.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BuildMethod {
    /// The paper's: linked lists that are sorted while they are built. Where a pixel has more layers than lists are walked along,
    /// a thousand, all are [linearised](Self::Linearised) from then on.
    #[default]
    LinkedLists,
    /// Counted, summed up, written and sorted.
    Linearised,
}

/// What is kept of a pixel's layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kept {
    /// The first and the last.
    Extents,
    /// All.
    Layers(BuildMethod),
}

/// Maps that are there at the same time, `MAPS` of batch.wesl.
pub(super) const BATCH: usize = 16;
/// And at most so many pixels, unless it is one map.
const MOST_PIXELS: u32 = 1 << 20;
/// What a pixel takes at most in a buffer.
const PIXEL_BYTES: u64 = 8;
/// Layers of a pixel on the average, for which there is room at first.
const LAYERS: u64 = 8;
/// Values that one workgroup sums up, `BLOCK` of scan.wesl.
const BLOCK: u64 = 2048;
/// Nothing is drawn into it.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

/// `MapView` of batch.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct MapView {
    right: [f32; 3],
    pixel: f32,
    up: [f32; 3],
    columns: u32,
    forward: [f32; 3],
    rows: u32,
    low: [f32; 2],
    padding: [u32; 2],
}

impl MapView {
    fn new(view: &View) -> Self {
        Self {
            right: view.right.to_array(),
            pixel: view.pixel,
            up: view.up.to_array(),
            columns: view.columns as u32,
            forward: view.forward.to_array(),
            rows: view.rows as u32,
            low: view.low.to_array(),
            padding: [0; 2],
        }
    }
}

/// `Batch` of batch.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Batch {
    views: [MapView; BATCH],
    count: u32,
    stride: u32,
    capacity: u32,
    points: u32,
    tolerance: f32,
    d_max: f32,
    tiles: u32,
    first: u32,
}

/// What maps are asked, beside where they are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    pub(super) points: u32,
    pub(super) tolerance: f32,
    pub(super) d_max: f32,
}

/// Builds maps; it keeps its pipelines and its memory.
#[derive(Debug)]
pub(super) struct Builder {
    pub(super) kept: Kept,
    /// Pixels from one map to the next.
    stride: u32,
    /// Maps of a batch.
    most: usize,
    capacity: u32,
    /// Tiles from one map to the next.
    tiles: u32,
    /// Where only what is within reach of points is drawn.
    reach: Option<Reach>,
    pipelines: Pipelines,
    memory: Memory,
}

#[derive(Debug)]
struct Memory {
    /// Of each pixel how many layers it has, then where its next one goes; its first node; or its ends.
    pixels: Buffer,
    /// Where the layers of each pixel begin, and their end.
    firsts: Buffer,
    /// Sums of blocks of those.
    totals: Buffer,
    layers: Buffer,
}

/// The maps of some directions, ready to be built batch by batch.
pub(super) struct Series<'a> {
    builder: &'a Builder,
    views: Vec<&'a [View]>,
    pub(super) batches: UniformArray<Batch>,
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
    pub(super) fn new(
        context: &Context,
        gpu_scene: &GpuScene,
        kept: Kept,
        resolution: u32,
    ) -> Result<Self> {
        let stride = resolution * resolution;
        let limits = context.device().limits();
        let limit = limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size);
        let bound = limit / (PIXEL_BYTES * u64::from(stride));
        let most = u64::from(MOST_PIXELS / stride).min(bound);
        let most = most.clamp(1, BATCH as u64) as usize;
        let pixels = u64::from(stride) * most as u64;
        let fits = (limit / layer_bytes(kept)).saturating_sub(1);
        let capacity = (LAYERS * pixels).min(fits).min(u64::from(u32::MAX / 2)) as u32;
        Ok(Self {
            kept,
            stride,
            most,
            capacity,
            // However long the map is: tiles are of 8 × 8 pixels.
            tiles: stride / 8 + 1,
            reach: None,
            pipelines: Pipelines::new(context, gpu_scene, kept, false)?,
            memory: Memory::new(context, kept, pixels, capacity)?,
        })
    }

    /// Layers that points ask for who look no farther than they were told.
    pub(super) fn near(
        context: &Context,
        gpu_scene: &GpuScene,
        method: BuildMethod,
        resolution: u32,
    ) -> Result<Self> {
        let kept = Kept::Layers(method);
        let all = Self::new(context, gpu_scene, kept, resolution)?;
        let tiles = u64::from(all.tiles) * all.most as u64;
        Ok(Self {
            reach: Some(Reach::new(context, tiles)?),
            pipelines: Pipelines::new(context, gpu_scene, kept, true)?,
            ..all
        })
    }

    /// What finds out what is within reach, where that is of interest.
    pub(super) fn reach(&self) -> Option<&Reach> {
        self.reach.as_ref()
    }

    /// Makes room for so many layers; whether there was not.
    pub(super) fn make_room(&mut self, context: &Context, needed: u32) -> Result<bool> {
        if needed <= self.capacity {
            return Ok(false);
        }
        let pixels = u64::from(self.stride) * self.most as u64;
        // A little more, so that what moves a little still has room.
        let capacity = needed.saturating_add(needed / 4).min(u32::MAX / 2);
        self.memory = Memory::new(context, self.kept, pixels, capacity)?;
        self.capacity = capacity;
        Ok(true)
    }

    /// Maps that are there at the same time, at most.
    pub(super) fn maps_at_once(&self) -> usize {
        self.most
    }

    /// Bytes on the device.
    pub(super) fn bytes(&self) -> u64 {
        let Memory {
            pixels,
            firsts,
            totals,
            layers,
        } = &self.memory;
        let sizes = [pixels, firsts, totals, layers].map(Buffer::size);
        sizes.iter().sum::<u64>() + self.reach.as_ref().map_or(0, Reach::bytes)
    }

    /// What maps are read from: bindings 1 and 2 of layers.wesl.
    pub(super) fn tables(&self) -> [(u32, BindingResource<'_>); 2] {
        let pixels = match self.kept {
            Kept::Layers(BuildMethod::Linearised) => &self.memory.firsts,
            _ => &self.memory.pixels,
        };
        [
            (1, pixels.as_entire_binding()),
            (2, self.memory.layers.as_entire_binding()),
        ]
    }

    /// Maps along some directions, of some triangles.
    pub(super) fn series<'a>(
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

/// What a layer takes.
fn layer_bytes(kept: Kept) -> u64 {
    match kept {
        Kept::Layers(BuildMethod::LinkedLists) => 8,
        _ => 4,
    }
}

impl Memory {
    fn new(context: &Context, kept: Kept, pixels: u64, capacity: u32) -> Result<Self> {
        let capacity = u64::from(capacity);
        let [words, firsts, layers] = match kept {
            Kept::Extents => [2 * pixels, 0, 0],
            // Node 0 is none.
            Kept::Layers(BuildMethod::LinkedLists) => [pixels, 0, 2 * (capacity + 1)],
            Kept::Layers(BuildMethod::Linearised) => [pixels + 1, pixels + 1, capacity],
        };
        Ok(Self {
            pixels: context.storage("the pixels of the maps", 4 * words)?,
            firsts: context.storage("the first layers of pixels", 4 * firsts)?,
            totals: context.storage("sums of blocks", 4 * firsts.div_ceil(BLOCK))?,
            layers: context.storage("the layers of the maps", 4 * layers)?,
        })
    }
}

impl Series<'_> {
    pub(super) fn len(&self) -> usize {
        self.views.len()
    }

    /// How many maps a batch has.
    pub(super) fn maps(&self, batch: usize) -> usize {
        self.views[batch].len()
    }

    /// Records the building of the maps of a batch, after what is within reach of those that will ask them.
    pub(super) fn record_near(
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
    pub(super) fn record(
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
