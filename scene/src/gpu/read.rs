//! Bringing results back: the last step of a GPU pipeline, and of nothing before.

use bytemuck::Pod;

use super::Context;
use crate::{Error, Result};

impl Context {
    /// Copies the first `count` values of a buffer (usage `COPY_SRC`) back, waiting for what was submitted before.
    ///
    /// # Errors
    /// [`Error::Gpu`] when the device failed, [`Error::GpuLimit`] when the copy would be larger than it can hold.
    pub fn read<T: Pod>(&self, what: &str, buffer: &wgpu::Buffer, count: usize) -> Result<Vec<T>> {
        if count == 0 {
            return Ok(Vec::new());
        }
        let bytes = (count * size_of::<T>()) as u64;
        // Copies are counted in words.
        let size = bytes.next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT);
        self.check_size(what, size, self.device().limits().max_buffer_size)?;
        let staging = self.check(what, |device| {
            let staging = device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                size,
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            });
            let mut encoder = device
                .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(what) });
            encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, size);
            self.queue().submit([encoder.finish()]);
            staging
        })?;
        self.map(what, &staging, |mapped| {
            bytemuck::pod_collect_to_vec(&mapped[..bytes as usize])
        })
    }

    /// Copies all texels of a texture (usage `COPY_SRC`; the first mip level and layer) back, row by row from the top.
    ///
    /// # Errors
    /// As [`read`](Self::read); [`Error::Gpu`] too when a texel is not as large as `T`.
    pub fn read_texture<T: Pod>(&self, what: &str, texture: &wgpu::Texture) -> Result<Vec<T>> {
        let texel = size_of::<T>() as u32;
        if texture.format().block_copy_size(None) != Some(texel) {
            let reason = format!("its texels are {:?}, not {texel} bytes", texture.format());
            return Err(Error::gpu(what, reason));
        }
        let (width, height) = (texture.width(), texture.height());
        let row = (texel * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let size = u64::from(row) * u64::from(height);
        self.check_size(what, size, self.device().limits().max_buffer_size)?;
        let buffer = self.check(what, |device| {
            let buffer = device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                size,
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            });
            let mut encoder = device
                .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(what) });
            let target = wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: None,
                },
            };
            let extent = wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            };
            encoder.copy_texture_to_buffer(texture.as_image_copy(), target, extent);
            self.queue().submit([encoder.finish()]);
            buffer
        })?;
        self.map(what, &buffer, |mapped| {
            let rows = mapped.chunks_exact(row as usize);
            let texels = rows.flat_map(|row| {
                bytemuck::pod_collect_to_vec::<u8, T>(&row[..(texel * width) as usize])
            });
            texels.collect()
        })
    }

    /// Maps a whole buffer (usage `MAP_READ`) and takes what is needed of it.
    pub(crate) fn map<R>(
        &self,
        what: &str,
        buffer: &wgpu::Buffer,
        take: impl FnOnce(&[u8]) -> R,
    ) -> Result<R> {
        let (sender, receiver) = std::sync::mpsc::channel();
        buffer
            .slice(..)
            .map_async(wgpu::MapMode::Read, move |result| {
                // The receiver only goes away when waiting failed, which is reported instead.
                let _ = sender.send(result);
            });
        self.wait(what)?;
        match receiver.try_recv() {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err(Error::gpu(what, error)),
            Err(_) => return Err(Error::gpu(what, "the device did not answer")),
        }
        let view = buffer
            .slice(..)
            .get_mapped_range()
            .map_err(|error| Error::gpu(what, error))?;
        let result = take(&view);
        drop(view);
        buffer.unmap();
        Ok(result)
    }
}
