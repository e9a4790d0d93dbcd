//! One compute pass: a pipeline, its parameters, and the textures it is given each time.

use bytemuck::{Pod, Zeroable};
use isophote_scene::gpu::{Context, Linker};
use wgpu::{BindingResource, BindingType, ShaderStages, TextureView};

use super::SHADERS;
use crate::{Error, Result, guides::EdgeKernel};

/// Pixels on a side of a workgroup, as all shaders of this crate have it.
const WORKGROUP: u32 = 8;

/// What a filter writes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Format {
    /// `Rgba32Float`.
    #[default]
    Single,
    /// `Rgba16Float`: half the memory and bandwidth, values up to 65504 with three digits.
    Half,
}

impl Format {
    /// The texture format.
    pub const fn texture(self) -> wgpu::TextureFormat {
        match self {
            Self::Single => wgpu::TextureFormat::Rgba32Float,
            Self::Half => wgpu::TextureFormat::Rgba16Float,
        }
    }
}

/// A texture that filters can write, and read from then on, of `[width, height]` pixels.
///
/// # Errors
/// [`Error::Gpu`] when it is larger than the device allows or memory is out.
pub fn texture(
    context: &Context,
    label: &str,
    size: [u32; 2],
    format: wgpu::TextureFormat,
) -> Result<wgpu::Texture> {
    Ok(context.check(label, |device| {
        device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d {
                width: size[0],
                height: size[1],
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::STORAGE_BINDING
                | wgpu::TextureUsages::COPY_SRC
                | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        })
    })?)
}

/// A texture's only view.
pub(super) fn whole(texture: &wgpu::Texture) -> TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// What a shader binds.
#[derive(Clone, Copy)]
pub(super) enum Slot {
    Texture,
    Output(wgpu::TextureFormat),
    Storage,
}

pub(super) struct Pass {
    label: &'static str,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    params: wgpu::Buffer,
    slots: Vec<u32>,
}

impl Pass {
    /// A pass of an entry point of a module of this crate, with its parameters in binding 0 and `slots` in others.
    pub(super) fn new<T: Pod>(
        context: &Context,
        [module, entry_point]: [&'static str; 2],
        format: Format,
        params: &T,
        slots: &[(u32, Slot)],
    ) -> Result<Self> {
        let shader = Linker::default()
            .package(SHADERS)
            .feature("half", format == Format::Half)
            .link(&format!("filters::{module}"))?;
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: ShaderStages::COMPUTE,
            ty,
            count: None,
        };
        let uniform = BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let mut entries = vec![entry(0, uniform)];
        entries.extend(
            slots
                .iter()
                .map(|&(binding, slot)| entry(binding, slot.ty())),
        );
        let layout = context.check(entry_point, |device| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(entry_point),
                entries: &entries,
            })
        })?;
        let usage = wgpu::BufferUsages::UNIFORM;
        Ok(Self {
            label: entry_point,
            pipeline: shader.compute_pipeline(context, entry_point, &[&layout])?,
            layout,
            params: context.buffer(entry_point, std::slice::from_ref(params), usage)?,
            slots: slots.iter().map(|(binding, _)| *binding).collect(),
        })
    }

    /// Replaces the parameters, from the next submission on.
    pub(super) fn set_params<T: Pod>(&self, context: &Context, params: &T) {
        context
            .queue()
            .write_buffer(&self.params, 0, bytemuck::bytes_of(params));
    }

    /// Records the pass over `size` pixels with what its slots hold, in their order.
    pub(super) fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        size: [u32; 2],
        resources: &[BindingResource<'_>],
    ) -> Result<()> {
        let slots = self.slots.iter().zip(resources);
        let slots = slots.map(|(&binding, resource)| (binding, resource.clone()));
        let params = (0, self.params.as_entire_binding());
        let entries: Vec<_> = std::iter::once(params)
            .chain(slots)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let group = context.check(self.label, |device| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(self.label),
                layout: &self.layout,
                entries: &entries,
            })
        })?;
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(self.label),
            timestamp_writes: None,
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        let [columns, rows] = size.map(|side| side.div_ceil(WORKGROUP));
        pass.dispatch_workgroups(columns, rows, 1);
        Ok(())
    }
}

impl std::fmt::Debug for Pass {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Pass").field(&self.label).finish()
    }
}

impl Slot {
    const fn ty(self) -> BindingType {
        match self {
            Self::Texture => BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: false },
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            Self::Output(format) => BindingType::StorageTexture {
                access: wgpu::StorageTextureAccess::WriteOnly,
                format,
                view_dimension: wgpu::TextureViewDimension::D2,
            },
            Self::Storage => BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only: true },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
        }
    }
}

/// An error unless a texture is of a size.
pub(super) fn expect_size(what: &'static str, view: &TextureView, size: [u32; 2]) -> Result<()> {
    let texture = view.texture();
    let found = [texture.width() as usize, texture.height() as usize, 4];
    let expected = [size[0] as usize, size[1] as usize, 4];
    if found == expected {
        return Ok(());
    }
    Err(Error::Size {
        what,
        expected,
        found,
    })
}

/// `EdgeStop` of edges.wesl.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct EdgeParams {
    cosine: u32,
    per_normal: f32,
    per_depth: f32,
    padding: u32,
}

impl From<crate::EdgeStop> for EdgeParams {
    fn from(stop: crate::EdgeStop) -> Self {
        let kernel = EdgeKernel::from(stop);
        Self {
            cosine: u32::from(kernel.cosine),
            per_normal: kernel.per_normal,
            per_depth: kernel.per_depth,
            padding: 0,
        }
    }
}
