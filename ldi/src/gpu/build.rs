//! Stage 2 on a GPU, building the maps (§3.1): triangles are grouped and projected as on the CPU, the layers of pixels are
//! found by the rasteriser, and stay on the device.
//!
//! Two ways lead to the same layers ([`BuildMethod`]):
//! - `single_pass`: fragments are drawn twice. The first time they are counted by pixel, the counts summed up (`scan`);
//!   the second time each goes where its pixel's next layer belongs.
//! - `peel`: the paper's depth peeling, one pass for each layer, and the prefix sum to compact them.
//!
//! Then the layers of each pixel are sorted (`sort.wesl`). Maps are built in groups, of each of which the number of layers
//! is read back, since memory cannot be allocated by the device; depth peeling also reads whether there are more.

mod peel;
mod single_pass;
#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};
use isophote_scene::{
    Error, Result,
    gpu::{Context, grid},
};

use super::{
    kernel::{Kernel, uniform},
    upload::{Head, Words, faces, is_wide},
};
use crate::{
    Coverage,
    cpu::{
        build::{Plan, too_large},
        maps::{LANES, PADDING, margin},
    },
};

/// How layers are found on a GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BuildMethod {
    /// The paper's (§3.1): a pass for each layer, of what lies behind the last one.
    DepthPeeling,
    /// All layers in two passes, one that counts and one that scatters; needs no more than that however many there are.
    #[default]
    SinglePass,
}

/// The uniform `plan`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct GpuPlan {
    resolution: u32,
    depth_steps: f32,
    cells: u32,
    face_words: u32,
    margin: f32,
    depth_margin: f32,
    first_map: u32,
    capacity: u32,
    base: u32,
    depth_bits: u32,
    padding: [u32; 2],
}

/// What is drawn.
struct Source<'a> {
    context: &'a Context,
    settings: GpuPlan,
    faces: wgpu::Buffer,
    frames: wgpu::Buffer,
    /// Of a map.
    vertices: u32,
    layer_bytes: u64,
}

/// Maps that are built together.
#[derive(Clone, Copy, Debug)]
struct Group {
    first: u32,
    count: u32,
}

/// The layers of a group, those of a pixel beside each other.
struct Compacted {
    /// Where those of each pixel begin, and their number at the end.
    firsts: wgpu::Buffer,
    /// Where they ended when they were written.
    cursors: wgpu::Buffer,
    layers: wgpu::Buffer,
    count: u32,
}

/// A group as the table of maps holds it.
struct Built {
    pixels: wgpu::Buffer,
    layers: wgpu::Buffer,
    count: u32,
}

enum Finder {
    Peel(peel::Peel),
    SinglePass(single_pass::SinglePass),
}

/// Pipelines for layers of a width.
struct Pipelines {
    wide: bool,
    touched: bool,
    finder: Finder,
    sort: Kernel,
}

/// Builds maps; it keeps its pipelines.
pub(super) struct MapBuilder {
    method: BuildMethod,
    pipelines: Option<Pipelines>,
}

impl std::fmt::Debug for MapBuilder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("MapBuilder").field(&self.method).finish()
    }
}

impl MapBuilder {
    pub(super) fn new(method: BuildMethod) -> Self {
        Self {
            method,
            pipelines: None,
        }
    }

    /// The tables that the walk reads: maps and triangles.
    ///
    /// # Errors
    /// [`Error::GpuLimit`] when something is too large for the device's buffers, [`Error::Parameter`] when the maps would
    /// take more than the memory that is allowed, [`Error::Gpu`] when the device fails.
    pub(super) fn build(
        &mut self,
        context: &Context,
        plan: &Plan<'_>,
    ) -> Result<[wgpu::Buffer; 2]> {
        let wide = is_wide(plan.packing);
        let touched = plan.params.coverage == Coverage::Touched;
        let pipelines = match self.pipelines.take() {
            Some(made) if made.wide == wide && made.touched == touched => made,
            _ => Pipelines::new(context, self.method, wide, touched)?,
        };
        let pipelines = self.pipelines.insert(pipelines);
        let head = Head {
            params: plan.params,
            resolution: plan.resolution,
            frames: &plan.frames(),
            packing: plan.packing,
        };
        let source = Source::new(context, plan, &head)?;
        let wrong = context.storage("wrong pixels", 4)?;
        let mut built: Vec<Built> = Vec::new();
        let mut base = 0;
        for group in source.groups(pipelines.most_maps(&source)) {
            let compacted = pipelines.layers(&source, group, Budget { plan, base })?;
            let one = pipelines.sort(&source, group, base, compacted, &wrong)?;
            base += one.count;
            built.push(one);
        }
        if context.read::<u32>("wrong pixels", &wrong, 1)?[0] != 0 {
            return Err(Error::Gpu {
                what: "building layered depth images".into(),
                reason: "the device drew other layers the second time: its driver is broken".into(),
            });
        }
        Ok([source.assemble(&head, &built, base)?, source.faces])
    }
}

/// How much the layers may still take.
struct Budget<'a> {
    plan: &'a Plan<'a>,
    /// Layers so far.
    base: u32,
}

impl Budget<'_> {
    fn too_large(&self) -> Error {
        too_large(self.plan.params.max_bytes).into()
    }

    /// An error if so many more layers are too many.
    fn check(&self, layers: u32) -> Result<()> {
        let most = self.plan.most_layers();
        let all = u64::from(self.base) + u64::from(layers);
        // The prefix sum stays at the largest number.
        if layers == u32::MAX || all > most {
            return Err(self.too_large());
        }
        Ok(())
    }
}

impl<'a> Source<'a> {
    fn new(context: &'a Context, plan: &Plan<'_>, head: &Head<'_>) -> Result<Self> {
        let steps = plan.packing.depth_steps();
        let planes = plan.planes();
        let face_words = if planes.is_empty() { 3 } else { 4 };
        let lanes = plan.blocks.len() * LANES;
        let bytes = 16 * face_words as u64 * lanes as u64;
        context.check_storage_size("the triangles of the maps", bytes)?;
        let faces = faces(&plan.blocks, &plan.surfaces, &planes);
        let usage = wgpu::BufferUsages::STORAGE;
        Ok(Self {
            context,
            settings: GpuPlan {
                resolution: plan.resolution,
                depth_steps: steps as f32,
                cells: plan.params.cells,
                face_words,
                depth_bits: plan.packing.depth_bits(),
                margin: margin(plan.resolution) as f32,
                // 32 bits tell 2²² of the depth apart, or a little less.
                depth_margin: (steps as f32 / (1 << 18) as f32).max(1.0 / 64.0),
                ..GpuPlan::zeroed()
            },
            faces: context.buffer("the triangles of the maps", &faces, usage)?,
            frames: context.buffer("the frames of the maps", &head.frame_words(), usage)?,
            vertices: match plan.params.coverage {
                Coverage::Center => 3 * lanes,
                Coverage::Touched => 6 * plan.blocks.len(),
            } as u32,
            layer_bytes: if is_wide(head.packing) { 8 } else { 4 },
        })
    }

    fn pixels(&self, group: Group) -> u64 {
        u64::from(group.count) * u64::from(self.settings.resolution).pow(2)
    }

    /// All maps, in groups of at most `most`.
    fn groups(&self, most: u32) -> impl Iterator<Item = Group> {
        let maps = 3 * self.settings.cells.pow(2);
        let most = most.max(1);
        (0..maps).step_by(most as usize).map(move |first| Group {
            first,
            count: most.min(maps - first),
        })
    }

    fn settings(&self, group: Group, capacity: u32) -> GpuPlan {
        GpuPlan {
            first_map: group.first,
            capacity,
            ..self.settings
        }
    }

    /// Pieces of a group that take a moment to draw.
    fn pieces(&self, group: Group) -> impl Iterator<Item = std::ops::Range<u32>> {
        const WORK: u32 = 1 << 22;
        let of_map = self.vertices.max(self.settings.resolution.pow(2)).max(1);
        let step = (WORK / of_map).max(1);
        let end = group.first + group.count;
        (group.first..end)
            .step_by(step as usize)
            .map(move |first| first..end.min(first + step))
    }

    /// Header, frames, pixels and layers.
    fn assemble(&self, head: &Head<'_>, built: &[Built], count: u32) -> Result<wgpu::Buffer> {
        let context = self.context;
        let maps = head.frames.len() as u64;
        let pixels = maps * u64::from(head.resolution).pow(2);
        let words = head.words(pixels);
        let pixels_at = 16 * words.len() as u64;
        let layers_at = pixels_at + (8 * (pixels + 1)).next_multiple_of(16);
        let layer_bytes = self.layer_bytes * (u64::from(count) + PADDING as u64);
        let bytes = layers_at + layer_bytes.next_multiple_of(16);
        let limit = context.device().limits().max_buffer_size;
        if bytes > limit {
            return Err(Error::GpuLimit {
                what: "the layered depth images".into(),
                needs: bytes,
                limit,
                adapter: context.device().adapter_info().name,
            });
        }
        context.check("layered depth images", |device| {
            let table = device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("layered depth images"),
                size: bytes,
                usage: wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_DST
                    | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            });
            let queue = context.queue();
            queue.write_buffer(&table, 0, bytemuck::cast_slice::<Words, u8>(&words));
            let end = [count, 0];
            queue.write_buffer(&table, pixels_at + 8 * pixels, bytemuck::cast_slice(&end));
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor {
                label: Some("layered depth images"),
            });
            let (mut pixel, mut layer) = (pixels_at, layers_at);
            for group in built {
                let size = group.pixels.size();
                encoder.copy_buffer_to_buffer(&group.pixels, 0, &table, pixel, size);
                pixel += size;
                let size = self.layer_bytes * u64::from(group.count);
                encoder.copy_buffer_to_buffer(&group.layers, 0, &table, layer, size);
                layer += size;
            }
            queue.submit([encoder.finish()]);
            table
        })
    }
}

impl Pipelines {
    fn new(context: &Context, method: BuildMethod, wide: bool, touched: bool) -> Result<Self> {
        let flags = [("wide", wide), ("touched", touched)];
        Ok(Self {
            wide,
            touched,
            finder: match method {
                BuildMethod::DepthPeeling => Finder::Peel(peel::Peel::new(context, &flags)?),
                BuildMethod::SinglePass => {
                    Finder::SinglePass(single_pass::SinglePass::new(context, &flags)?)
                }
            },
            sort: Kernel::new(context, "ldi::build::sort", "sort", &flags)?,
        })
    }

    /// Maps of a group.
    fn most_maps(&self, source: &Source<'_>) -> u32 {
        let of_map = source.settings.resolution.pow(2);
        match &self.finder {
            Finder::Peel(_) => peel::MOST_MAPS.min(peel::MOST_PIXELS / of_map),
            Finder::SinglePass(_) => single_pass::MOST_PIXELS / of_map,
        }
    }

    fn layers(&self, source: &Source<'_>, group: Group, budget: Budget<'_>) -> Result<Compacted> {
        match &self.finder {
            Finder::Peel(peel) => peel.layers(source, group, budget),
            Finder::SinglePass(single_pass) => single_pass.layers(source, group, budget),
        }
    }

    fn sort(
        &self,
        source: &Source<'_>,
        group: Group,
        base: u32,
        found: Compacted,
        wrong: &wgpu::Buffer,
    ) -> Result<Built> {
        let context = source.context;
        let count = source.pixels(group);
        let pixels = context.storage("the pixels of the maps", 8 * count)?;
        let settings = GpuPlan {
            base,
            ..source.settings(group, found.count)
        };
        let settings = uniform(context, settings)?;
        let resources = [
            &settings,
            &found.firsts,
            &found.cursors,
            &found.layers,
            &pixels,
            wrong,
        ];
        let mut encoder = context.device().create_command_encoder(&Default::default());
        let groups = grid(count.div_ceil(64));
        self.sort.record(
            context,
            &mut encoder,
            &resources.map(wgpu::Buffer::as_entire_binding),
            groups,
        )?;
        context.submit("sorting layers", encoder)?;
        Ok(Built {
            pixels,
            layers: found.layers,
            count: found.count,
        })
    }
}
