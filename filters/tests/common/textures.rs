//! Numbers into textures and back.

use isophote_filters::gpu;
use isophote_scene::gpu::Context;
use wgpu::{CommandEncoder, TextureFormat, TextureView};

/// A texture of four channels with these numbers.
pub(crate) fn upload(context: &Context, values: &[f32], size: [u32; 2]) -> TextureView {
    let texture = gpu::texture(context, "input", size, TextureFormat::Rgba32Float).unwrap();
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(16 * size[0]),
        rows_per_image: None,
    };
    let bytes = bytemuck::cast_slice(values);
    let queue = context.queue();
    queue.write_texture(texture.as_image_copy(), bytes, layout, texture.size());
    view(&texture)
}

/// A texture of four channels that nothing was written to.
pub(crate) fn empty(context: &Context, size: [u32; 2]) -> TextureView {
    view(&gpu::texture(context, "result", size, TextureFormat::Rgba32Float).unwrap())
}

fn view(texture: &wgpu::Texture) -> TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// Records, and submits it at once.
pub(crate) fn submit(context: &Context, record: impl FnOnce(&mut CommandEncoder)) {
    let descriptor = wgpu::CommandEncoderDescriptor::default();
    let mut encoder = context.device().create_command_encoder(&descriptor);
    record(&mut encoder);
    context.submit("filter", encoder).unwrap();
}

/// The numbers in a texture of so many channels of 32 bits.
pub(crate) fn download(context: &Context, view: &TextureView, channels: u32) -> Vec<f32> {
    let texture = view.texture();
    let (width, height) = (texture.width(), texture.height());
    let row = (4 * channels * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = context.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(row * height),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    submit(context, |encoder| {
        let target = wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(row),
                rows_per_image: None,
            },
        };
        encoder.copy_texture_to_buffer(texture.as_image_copy(), target, texture.size());
    });
    let count = (row / 4 * height) as usize;
    let values: Vec<f32> = context.read("result", &buffer, count).unwrap();
    let rows = values.chunks_exact((row / 4) as usize);
    let used = (channels * width) as usize;
    rows.flat_map(|row| &row[..used]).copied().collect()
}
