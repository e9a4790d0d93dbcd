//! What tracers bind: tables, and before them an acceleration structure if there is one.

use crate::{
    Result,
    gpu::{
        Context,
        words::{Placement, Words},
    },
};

/// Bind group 1 of a tracer: tables that its module reads in words of four, in buffers or, where one is too large for
/// that, in textures.
///
/// The module declares a table both ways and chooses by the flag `tracer_in_textures`, as
/// `shaders/tracer/compute_bvh.wesl` does.
#[derive(Clone, Debug)]
pub struct TracerBinding {
    label: &'static str,
    placement: Placement,
    layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
    bytes: u64,
}

/// A table's name and contents, a multiple of 16 bytes.
pub type TracerTable<'a> = (&'static str, &'a [u8]);

/// What tables are made of.
enum Tables<'a> {
    Contents(&'a [TracerTable<'a>]),
    Filled(&'a [(&'static str, wgpu::Buffer)]),
}

impl Tables<'_> {
    fn sizes(&self) -> Vec<(&str, u64)> {
        match self {
            Self::Contents(tables) => (tables.iter())
                .map(|(what, bytes)| (*what, bytes.len() as u64))
                .collect(),
            Self::Filled(tables) => (tables.iter())
                .map(|(what, buffer)| (*what, buffer.size()))
                .collect(),
        }
    }

    fn words(&self, context: &Context, placement: Placement) -> Result<Vec<Words>> {
        match self {
            Self::Contents(tables) => (tables.iter())
                .map(|(what, bytes)| Words::new(context, placement, what, bytes))
                .collect(),
            Self::Filled(tables) => (tables.iter())
                .map(|(what, buffer)| Words::from_buffer(context, placement, what, buffer))
                .collect(),
        }
    }
}

impl TracerBinding {
    /// Uploads the tables.
    ///
    /// # Errors
    /// [`Error::GpuLimit`](crate::Error::GpuLimit) when one is too large for the device,
    /// [`Error::Gpu`](crate::Error::Gpu) when it fails.
    pub fn new(
        context: &Context,
        label: &'static str,
        structure: Option<&wgpu::Tlas>,
        tables: &[TracerTable<'_>],
    ) -> Result<Self> {
        Self::of(context, label, structure, &Tables::Contents(tables))
    }

    /// Binds tables that the device itself has filled, or fills before the tracer is asked anything: their names, and
    /// buffers with the usages `STORAGE` and `COPY_SRC` whose sizes are multiples of 16 bytes. Where one is too large to be
    /// bound it is copied to a texture, from what it holds now.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn from_buffers(
        context: &Context,
        label: &'static str,
        tables: &[(&'static str, wgpu::Buffer)],
    ) -> Result<Self> {
        Self::of(context, label, None, &Tables::Filled(tables))
    }

    fn of(
        context: &Context,
        label: &'static str,
        structure: Option<&wgpu::Tlas>,
        tables: &Tables<'_>,
    ) -> Result<Self> {
        let sizes = tables.sizes();
        let placement = Placement::of(context, &sizes)?;
        let layout = context.check(label, |device| {
            let structure = structure.map(|_| wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::all(),
                ty: wgpu::BindingType::AccelerationStructure {
                    vertex_return: false,
                },
                count: None,
            });
            let mut entries = Vec::from_iter(structure);
            for _ in &sizes {
                entries.push(placement.layout_entry(entries.len() as u32));
            }
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(label),
                entries: &entries,
            })
        })?;
        let (group, bytes) = fill(context, label, placement, &layout, structure, tables)?;
        Ok(Self {
            label,
            placement,
            layout,
            group,
            bytes,
        })
    }

    /// Binds others of the same kinds; the layout stays the same.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn replace(
        &mut self,
        context: &Context,
        structure: Option<&wgpu::Tlas>,
        tables: &[TracerTable<'_>],
    ) -> Result<()> {
        (self.group, self.bytes) = fill(
            context,
            self.label,
            self.placement,
            &self.layout,
            structure,
            &Tables::Contents(tables),
        )?;
        Ok(())
    }

    /// As [`replace`](Self::replace), of buffers as [`from_buffers`](Self::from_buffers) takes them.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn replace_with_buffers(
        &mut self,
        context: &Context,
        tables: &[(&'static str, wgpu::Buffer)],
    ) -> Result<()> {
        (self.group, self.bytes) = fill(
            context,
            self.label,
            self.placement,
            &self.layout,
            None,
            &Tables::Filled(tables),
        )?;
        Ok(())
    }

    /// What [`GpuTracer::shader_flags`](super::GpuTracer::shader_flags) returns.
    pub fn shader_flags(&self) -> &'static [&'static str] {
        match self.placement {
            Placement::Buffers => &[],
            Placement::Textures => &["tracer_in_textures"],
        }
    }

    /// What [`GpuTracer::bind_group_layout`](super::GpuTracer::bind_group_layout) returns.
    pub fn layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    /// What [`GpuTracer::bind_group`](super::GpuTracer::bind_group) returns.
    pub fn group(&self) -> &wgpu::BindGroup {
        &self.group
    }

    /// Bytes of the tables.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

fn fill(
    context: &Context,
    label: &str,
    placement: Placement,
    layout: &wgpu::BindGroupLayout,
    structure: Option<&wgpu::Tlas>,
    tables: &Tables<'_>,
) -> Result<(wgpu::BindGroup, u64)> {
    let tables = tables.words(context, placement)?;
    let resources = structure.map(wgpu::Tlas::as_binding);
    let resources = resources
        .into_iter()
        .chain(tables.iter().map(Words::binding));
    let entries: Vec<_> = (0..)
        .zip(resources)
        .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
        .collect();
    let group = context.check(label, |device| {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(label),
            layout,
            entries: &entries,
        })
    })?;
    Ok((group, tables.iter().map(Words::bytes).sum()))
}
