//! The pipelines, what they bind, and the textures and buffers between them.

use isophote_filters::gpu::texture;
use isophote_scene::gpu::{Context, GpuTracer, Linker, Rasters, reference::World};
use wgpu::{BindingResource, BindingType, BufferBindingType, TextureFormat, TextureView};

use super::{Piece, StageTextures};
use crate::{
    HybridParams, Result, Shadows,
    gpu::{SHADERS, kernel},
};

/// What `light` holds of a sample, as fragments.wesl tells: the light of the three stages and their rays, and the rays
/// towards lights from what diffuse and what glossy rays hit.
pub(super) type Light = [[f32; 4]; 4];

const LIGHT_BYTES: u64 = size_of::<Light>() as u64;
/// `Found` of gather.wesl.
const HIT_BYTES: u64 = 48;

/// What the stages leave to each other.
#[derive(Debug)]
pub(super) struct Target {
    /// Four words of four a sample ([`Light`]).
    pub(super) light: wgpu::Buffer,
    /// Three a sample of a dispatch.
    hits: wgpu::Buffer,
    pub(super) irradiance: TextureView,
    pub(super) light_irradiance: TextureView,
    pub(super) normals: TextureView,
    pub(super) depths: TextureView,
    pub(super) blurred: TextureView,
    pub(super) blurred_light: TextureView,
    filtered_light: TextureView,
}

/// Everything that does not depend on the scene.
pub(super) fn textures(
    context: &Context,
    size: [u32; 2],
    at_once: u32,
    samples: u32,
) -> Result<(Target, StageTextures)> {
    let color = TextureFormat::Rgba32Float;
    let picture = |label| texture(context, label, size, color);
    let view = |label, format| -> Result<TextureView> {
        Ok(whole(&texture(context, label, size, format)?))
    };
    let stages = StageTextures {
        direct: picture("direct")?,
        irradiance: picture("irradiance")?,
        filtered: picture("filtered irradiance")?,
        diffuse: picture("diffuse")?,
        glossy: picture("glossy")?,
        picture: picture("picture")?,
    };
    let target = Target {
        light: context.storage("light", LIGHT_BYTES * u64::from(samples))?,
        hits: context.storage("secondary hits", HIT_BYTES * u64::from(at_once))?,
        irradiance: whole(&stages.irradiance),
        light_irradiance: view("irradiance of direct light", color)?,
        normals: view("normals", color)?,
        depths: view("depths", color)?,
        blurred: view("blurred irradiance", color)?,
        blurred_light: view("blurred direct light", color)?,
        filtered_light: view("filtered direct light", color)?,
    };
    Ok((target, stages))
}

fn whole(texture: &wgpu::Texture) -> TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// A pass over pixels: its name, its pipeline, and what it binds as group 0.
type PixelPass = (&'static str, wgpu::ComputePipeline, wgpu::BindGroup);

/// Pipelines that have not been given anything to bind.
pub(super) struct Unbound {
    layouts: Layouts,
    direct: wgpu::ComputePipeline,
    trace: wgpu::ComputePipeline,
    shade: Option<wgpu::ComputePipeline>,
    pixels: [wgpu::ComputePipeline; 3],
}

/// The pipelines, bound.
#[derive(Debug)]
pub(super) struct Passes {
    pub(super) direct: wgpu::ComputePipeline,
    pub(super) trace: wgpu::ComputePipeline,
    /// `None` where `trace` lights what it hits.
    pub(super) shade: Option<wgpu::ComputePipeline>,
    rays: wgpu::BindGroup,
    pub(super) resolve: PixelPass,
    pub(super) mean: PixelPass,
    pub(super) light_mean: PixelPass,
    pub(super) combine: PixelPass,
}

/// Layouts of group 0.
struct Layouts {
    rays: wgpu::BindGroupLayout,
    resolve: wgpu::BindGroupLayout,
    mean: wgpu::BindGroupLayout,
    combine: wgpu::BindGroupLayout,
}

const UNIFORM: BindingType = buffer(BufferBindingType::Uniform, false);
const PIECE: BindingType = buffer(BufferBindingType::Uniform, true);
const WRITTEN: BindingType = buffer(BufferBindingType::Storage { read_only: false }, false);
const TEXTURE: BindingType = BindingType::Texture {
    sample_type: wgpu::TextureSampleType::Float { filterable: false },
    view_dimension: wgpu::TextureViewDimension::D2,
    multisampled: false,
};
const COLOR: BindingType = output(TextureFormat::Rgba32Float);

const fn buffer(ty: BufferBindingType, has_dynamic_offset: bool) -> BindingType {
    BindingType::Buffer {
        ty,
        has_dynamic_offset,
        min_binding_size: None,
    }
}

const fn output(format: TextureFormat) -> BindingType {
    BindingType::StorageTexture {
        access: wgpu::StorageTextureAccess::WriteOnly,
        format,
        view_dimension: wgpu::TextureViewDimension::D2,
    }
}

impl Layouts {
    fn new(context: &Context) -> Result<Self> {
        let layout = |bindings: &[(u32, BindingType)]| -> Result<wgpu::BindGroupLayout> {
            let entries: Vec<_> = bindings
                .iter()
                .map(|&(binding, ty)| wgpu::BindGroupLayoutEntry {
                    binding,
                    visibility: wgpu::ShaderStages::COMPUTE,
                    ty,
                    count: None,
                })
                .collect();
            Ok(context.check("hybrid", |device| {
                device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                    label: Some("hybrid"),
                    entries: &entries,
                })
            })?)
        };
        let common = [(1, UNIFORM), (3, WRITTEN)];
        let rays = [(2, PIECE), (5, WRITTEN)];
        let resolve = [(6, COLOR), (7, COLOR), (8, COLOR), (9, COLOR)];
        let combine = [
            (12, TEXTURE),
            (13, TEXTURE),
            (14, COLOR),
            (15, COLOR),
            (16, COLOR),
            (17, COLOR),
        ];
        Ok(Self {
            rays: layout(&[&common[..], &rays].concat())?,
            resolve: layout(&[&common[..], &resolve].concat())?,
            mean: layout(&[(10, TEXTURE), (11, COLOR)])?,
            combine: layout(&[&common[..], &combine].concat())?,
        })
    }
}

impl Passes {
    /// What the passes with rays bind as group 0.
    pub(super) fn rays(&self) -> &wgpu::BindGroup {
        &self.rays
    }
}

impl Unbound {
    /// Links and compiles everything for the tracers of `world`.
    pub(super) fn new(
        context: &Context,
        world: &World<'_>,
        params: &HybridParams,
        rasters: &Rasters,
        shadow_maps: bool,
    ) -> Result<Self> {
        let layouts = Layouts::new(context)?;
        let pipeline = |module: &str,
                        entry_point: &str,
                        tracer: &dyn GpuTracer,
                        own: &wgpu::BindGroupLayout|
         -> Result<wgpu::ComputePipeline> {
            let shader = Linker::default()
                .package(SHADERS)
                .scene(world.gpu_scene)
                .tracer(tracer)
                .feature("multisampled", params.samples > 1)
                .feature("shadow_maps", shadow_maps)
                .link(module)?;
            let layouts = [
                own,
                tracer.bind_group_layout(),
                world.gpu_scene.bind_group_layout(),
                rasters.bind_group_layout(),
            ];
            Ok(shader.compute_pipeline(context, entry_point, &layouts)?)
        };
        let (exact, secondary) = (world.exact, world.secondary);
        let direct = match params.shadows {
            Shadows::Exact => exact,
            Shadows::Secondary => secondary,
        };
        Ok(Self {
            direct: pipeline("ldi::light", "direct", direct, &layouts.rays)?,
            trace: pipeline("ldi::gather", "trace", secondary, &layouts.rays)?,
            shade: if shadow_maps {
                None
            } else {
                Some(pipeline("ldi::gather", "shade", exact, &layouts.rays)?)
            },
            pixels: [
                pipeline("ldi::filter", "resolve", exact, &layouts.resolve)?,
                pipeline("ldi::filter", "mean", exact, &layouts.mean)?,
                pipeline("ldi::combine", "combine", exact, &layouts.combine)?,
            ],
            layouts,
        })
    }

    pub(super) fn bound(
        self,
        context: &Context,
        settings: &wgpu::Buffer,
        pieces: &wgpu::Buffer,
        target: &Target,
        stages: &StageTextures,
    ) -> Result<Passes> {
        let bind = |layout, resources: &[(u32, BindingResource<'_>)]| {
            kernel::bind(context, "hybrid", layout, resources)
        };
        let piece = BindingResource::Buffer(wgpu::BufferBinding {
            buffer: pieces,
            offset: 0,
            size: wgpu::BufferSize::new(size_of::<Piece>() as u64),
        });
        let common = [
            (1, settings.as_entire_binding()),
            (3, target.light.as_entire_binding()),
        ];
        let rays = [(2, piece), (5, target.hits.as_entire_binding())];
        let resolve = views([
            (6, &target.irradiance),
            (7, &target.light_irradiance),
            (8, &target.normals),
            (9, &target.depths),
        ]);
        let stage = |texture| whole(texture);
        let [filtered, direct, diffuse, glossy, picture] = [
            &stages.filtered,
            &stages.direct,
            &stages.diffuse,
            &stages.glossy,
            &stages.picture,
        ]
        .map(stage);
        let combine = views([
            (12, &filtered),
            (13, &target.filtered_light),
            (14, &direct),
            (15, &diffuse),
            (16, &glossy),
            (17, &picture),
        ]);
        let mean = views([(10, &target.blurred), (11, &filtered)]);
        let light_mean = views([(10, &target.blurred_light), (11, &target.filtered_light)]);
        let [resolve_pipeline, mean_pipeline, combine_pipeline] = self.pixels;
        let layouts = &self.layouts;
        Ok(Passes {
            direct: self.direct,
            trace: self.trace,
            shade: self.shade,
            rays: bind(&layouts.rays, &[&common[..], &rays].concat())?,
            resolve: (
                "resolve",
                resolve_pipeline,
                bind(&layouts.resolve, &[&common[..], &resolve].concat())?,
            ),
            mean: ("mean", mean_pipeline.clone(), bind(&layouts.mean, &mean)?),
            light_mean: ("mean", mean_pipeline, bind(&layouts.mean, &light_mean)?),
            combine: (
                "combine",
                combine_pipeline,
                bind(&layouts.combine, &[&common[..], &combine].concat())?,
            ),
        })
    }
}

fn views<const N: usize>(views: [(u32, &TextureView); N]) -> [(u32, BindingResource<'_>); N] {
    views.map(|(binding, view)| (binding, BindingResource::TextureView(view)))
}
