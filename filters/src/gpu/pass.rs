//! One compute pass: a pipeline, its parameters, and the textures it is given each time.

use bytemuck::{Pod, Zeroable};
use isophote_scene::gpu::{ComputePass, Context, Dispatch, Linker};
use wgpu::{BindingResource, TextureView};

use super::{Guides, SHADERS};
use crate::{Error, Result, guides::EdgeKernel};

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

pub(super) struct Pass {
    label: &'static str,
    compute: ComputePass,
    params: wgpu::Buffer,
}

impl Pass {
    /// A pass of an entry point of a module of this crate, with its parameters in binding 0.
    pub(super) fn new<T: Pod>(
        context: &Context,
        [module, entry_point]: [&'static str; 2],
        format: Format,
        params: &T,
    ) -> Result<Self> {
        let shader = Linker::default()
            .package(SHADERS)
            .feature("half", format == Format::Half)
            .link(&format!("filters::{module}"))?;
        let usage = wgpu::BufferUsages::UNIFORM;
        Ok(Self {
            label: entry_point,
            compute: shader.compute_pass(context, entry_point, &[], &[])?,
            params: context.buffer(entry_point, std::slice::from_ref(params), usage)?,
        })
    }

    /// Replaces the parameters, from the next submission on.
    pub(super) fn set_params<T: Pod>(&self, context: &Context, params: &T) {
        context
            .queue()
            .write_buffer(&self.params, 0, bytemuck::bytes_of(params));
    }

    /// Records the pass over `size` pixels with what it is given this time, in the order of its bindings from 1 on, and with
    /// the guides where edges.wesl reads them.
    pub(super) fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        size: [u32; 2],
        resources: &[BindingResource<'_>],
        guides: Option<&Guides>,
    ) -> Result<()> {
        let params = [(0, self.params.as_entire_binding())];
        let numbered = (1..).zip(resources.iter().cloned());
        let guides = guides.into_iter().flat_map(Guides::resources);
        let all: Vec<_> = params.into_iter().chain(numbered).chain(guides).collect();
        let group = self.compute.bind(context, &all)?;
        let pixels = [Dispatch::over_pixels(size)];
        self.compute
            .record(encoder, self.label, None, &[&group], &pixels);
        Ok(())
    }
}

impl std::fmt::Debug for Pass {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Pass").field(&self.label).finish()
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
