//! What was rasterised, bound as one group for techniques to read.

use super::{Context, GBuffer, ShadowMaps};
use crate::Result;

/// A G-buffer, shadow maps, or both, as bind group 3: what `scene::gbuffer::read` and `scene::shadow` read. A shader that
/// reads a G-buffer with several samples is linked with the feature `multisampled`.
#[derive(Debug)]
pub struct Rasters {
    layout: wgpu::BindGroupLayout,
    bind_group: wgpu::BindGroup,
}

impl Rasters {
    /// Binds what there is; to be made again when one of them is replaced, not when it is filled again.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) when they are another device's.
    pub fn new(
        context: &Context,
        gbuffer: Option<&GBuffer>,
        shadow_maps: Option<&ShadowMaps>,
    ) -> Result<Self> {
        let mut layouts = gbuffer.map_or_else(Vec::new, GBuffer::layout_entries);
        layouts.extend(
            shadow_maps
                .into_iter()
                .flat_map(|_| ShadowMaps::layout_entries()),
        );
        let mut entries = gbuffer.map_or_else(Vec::new, GBuffer::bind_entries);
        entries.extend(shadow_maps.into_iter().flat_map(ShadowMaps::bind_entries));
        context.check("rasters", |device| {
            let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("rasters"),
                entries: &layouts,
            });
            let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("rasters"),
                layout: &layout,
                entries: &entries,
            });
            Self { layout, bind_group }
        })
    }

    /// The layout of [`bind_group`](Self::bind_group).
    pub fn bind_group_layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    /// What the shaders bind as group 3.
    pub fn bind_group(&self) -> &wgpu::BindGroup {
        &self.bind_group
    }
}
