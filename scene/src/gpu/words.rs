//! Large tables that shaders read: in storage buffers, or, where the device binds no buffer that large, in the rows of
//! textures.
//!
//! WebGPU promises 8 storage buffers a stage, and bindings of 128 MiB. Spread over several buffers, a table would take
//! bindings that techniques need. A texture is one binding and holds 1 GiB where WebGPU's promises are all there is.
//! The shader modules read either by the same functions, between which a flag of the linker chooses; tables that fit are
//! read as if there were no other way. On Mesa's llvmpipe rays through a tree in textures take about 1.6 times as long.

use super::Context;
use crate::Result;

/// Words of four in a row, as in `shaders/words.wesl`. WebGPU promises that textures may be as wide.
const ROW: u32 = 8192;
/// Bytes of a word.
const WORD: usize = 16;
const ROW_BYTES: usize = WORD * ROW as usize;

/// Where tables that are read together lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Placement {
    Buffers,
    Textures,
}

impl Placement {
    /// Where tables of these names and sizes in bytes fit: in buffers if all do. To be asked before they are filled.
    ///
    /// # Errors
    /// [`Error::GpuLimit`](crate::Error::GpuLimit) when one fits nowhere.
    pub(super) fn of(context: &Context, tables: &[(&str, u64)]) -> Result<Self> {
        let fits = |placement: &Self| {
            let limit = placement.limit(context);
            tables.iter().all(|&(_, bytes)| bytes <= limit)
        };
        let all = [Self::Buffers, Self::Textures];
        if let Some(placement) = all.into_iter().find(fits) {
            return Ok(placement);
        }
        let limit = all.map(|placement| placement.limit(context));
        for (what, bytes) in tables {
            context.check_size(what, *bytes, limit[0].max(limit[1]))?;
        }
        Ok(Self::Textures)
    }

    /// Bytes of the largest table.
    fn limit(self, context: &Context) -> u64 {
        let limits = context.device().limits();
        let rows = u64::from(limits.max_texture_dimension_2d);
        match self {
            Self::Buffers => limits
                .max_buffer_size
                .min(limits.max_storage_buffer_binding_size),
            Self::Textures if rows < u64::from(ROW) => 0,
            Self::Textures => rows * u64::from(ROW) * WORD as u64,
        }
    }

    /// The layout entry of a table, for every stage.
    pub(super) fn layout_entry(self, binding: u32) -> wgpu::BindGroupLayoutEntry {
        let ty = match self {
            Self::Buffers => wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only: true },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            Self::Textures => wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Uint,
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
        };
        wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::all(),
            ty,
            count: None,
        }
    }
}

/// A table.
#[derive(Debug)]
pub(super) enum Words {
    Buffer(wgpu::Buffer),
    Texture(wgpu::Texture, wgpu::TextureView),
}

impl Words {
    /// Uploads a table, whose bytes are a multiple of 16.
    ///
    /// # Errors
    /// [`Error::GpuLimit`](crate::Error::GpuLimit) when it does not fit, [`Error::Gpu`](crate::Error::Gpu) when memory is
    /// out.
    pub(super) fn new(
        context: &Context,
        placement: Placement,
        label: &str,
        bytes: &[u8],
    ) -> Result<Self> {
        debug_assert!(bytes.len().is_multiple_of(WORD), "{label}");
        context.check_size(label, bytes.len() as u64, placement.limit(context))?;
        if placement == Placement::Buffers {
            let usage = wgpu::BufferUsages::STORAGE;
            return Ok(Self::Buffer(context.buffer(label, bytes, usage)?));
        }
        context.check(label, |device| {
            let texture = rows_of(device, label, bytes.len() as u64);
            write_rows(context, &texture, bytes);
            let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
            Self::Texture(texture, view)
        })
    }

    /// A table that the device has filled, in a buffer with the usages `STORAGE` and `COPY_SRC`, whose size is a multiple of
    /// 16 bytes. It is copied where it has to be a texture.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub(super) fn from_buffer(
        context: &Context,
        placement: Placement,
        label: &str,
        buffer: &wgpu::Buffer,
    ) -> Result<Self> {
        debug_assert!(buffer.size().is_multiple_of(WORD as u64), "{label}");
        context.check_size(label, buffer.size(), placement.limit(context))?;
        if placement == Placement::Buffers {
            return Ok(Self::Buffer(buffer.clone()));
        }
        context.check(label, |device| {
            let texture = rows_of(device, label, buffer.size());
            let mut encoder = device
                .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) });
            copy_rows(&mut encoder, buffer, &texture);
            context.queue().submit([encoder.finish()]);
            let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
            Self::Texture(texture, view)
        })
    }

    /// Overwrites the beginning, from the next submission on.
    pub(super) fn write(&self, context: &Context, words: &[[u32; 4]]) {
        let bytes = bytemuck::cast_slice(words);
        match self {
            Self::Buffer(buffer) => context.queue().write_buffer(buffer, 0, bytes),
            Self::Texture(texture, _) => write_rows(context, texture, bytes),
        }
    }

    pub(super) fn binding(&self) -> wgpu::BindingResource<'_> {
        match self {
            Self::Buffer(buffer) => buffer.as_entire_binding(),
            Self::Texture(_, view) => wgpu::BindingResource::TextureView(view),
        }
    }

    /// Bytes of GPU memory taken.
    pub(super) fn bytes(&self) -> u64 {
        match self {
            Self::Buffer(buffer) => buffer.size(),
            Self::Texture(texture, _) => {
                u64::from(texture.width()) * u64::from(texture.height()) * WORD as u64
            }
        }
    }
}

/// A texture that holds so many bytes.
fn rows_of(device: &wgpu::Device, label: &str, bytes: u64) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d {
            width: ROW,
            // The caller has seen to it that they are not too many.
            height: bytes.div_ceil(ROW_BYTES as u64).max(1) as u32,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Uint,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

/// Copies a buffer to row after row.
fn copy_rows(encoder: &mut wgpu::CommandEncoder, buffer: &wgpu::Buffer, texture: &wgpu::Texture) {
    let whole = buffer.size() / ROW_BYTES as u64;
    let rest = buffer.size() % ROW_BYTES as u64 / WORD as u64;
    let pieces = [(0, ROW, whole as u32), (whole, rest as u32, 1)];
    for (first, width, height) in pieces {
        if width == 0 || height == 0 {
            continue;
        }
        encoder.copy_buffer_to_texture(
            wgpu::TexelCopyBufferInfo {
                buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: first * ROW_BYTES as u64,
                    bytes_per_row: (height > 1).then_some(ROW_BYTES as u32),
                    rows_per_image: None,
                },
            },
            wgpu::TexelCopyTextureInfo {
                texture,
                mip_level: 0,
                origin: wgpu::Origin3d {
                    x: 0,
                    y: first as u32,
                    z: 0,
                },
                aspect: wgpu::TextureAspect::All,
            },
            wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
        );
    }
}

/// Writes row after row from the first on, in pieces, so that staging memory stays small.
fn write_rows(context: &Context, texture: &wgpu::Texture, bytes: &[u8]) {
    const PIECE: usize = 512 * ROW_BYTES;
    for (index, piece) in bytes.chunks(PIECE).enumerate() {
        let whole = piece.len() / ROW_BYTES;
        let (rows, rest) = piece.split_at(whole * ROW_BYTES);
        let first = 512 * index;
        for (y, bytes) in [(first, rows), (first + whole, rest)] {
            if bytes.is_empty() {
                continue;
            }
            let width = bytes.len().min(ROW_BYTES) / WORD;
            context.queue().write_texture(
                wgpu::TexelCopyTextureInfo {
                    texture,
                    mip_level: 0,
                    origin: wgpu::Origin3d {
                        x: 0,
                        y: y as u32,
                        z: 0,
                    },
                    aspect: wgpu::TextureAspect::All,
                },
                bytes,
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some((width * WORD) as u32),
                    rows_per_image: None,
                },
                wgpu::Extent3d {
                    width: width as u32,
                    height: bytes.len().div_ceil(ROW_BYTES) as u32,
                    depth_or_array_layers: 1,
                },
            );
        }
        if bytes.len() > PIECE {
            context.queue().submit([]);
        }
    }
}
