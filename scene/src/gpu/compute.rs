//! Compute passes: an entry point of a shader, and what it binds as group 0, which is read off the shader.

use std::{marker::PhantomData, num::NonZero};

use bytemuck::Pod;
use wgpu::{BindGroup, BindGroupLayout, BindingResource, BindingType, BufferBindingType};

use super::{Context, Shader, Timer};
use crate::{Error, Result};

/// Uniform buffers are bound at multiples of this on every device.
const STRIDE: usize = 256;

/// An entry point of a compute shader.
///
/// Its group 0 is laid out as the shader declares it, so that what binds it is written once. Groups 1 to 3 are tracers, the
/// scene and what else [others lay out](super#bind-groups).
#[derive(Debug)]
pub struct ComputePass {
    name: &'static str,
    pipeline: wgpu::ComputePipeline,
    layout: BindGroupLayout,
    bindings: Vec<u32>,
}

/// A part of a pass: how many workgroups, and at which offset of its [`UniformArray`] what it is told lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dispatch {
    /// For a pass that binds a [`UniformArray`].
    pub offset: Option<u32>,
    /// In all three dimensions; each at most 65,535.
    pub workgroups: [u32; 3],
}

impl Dispatch {
    /// One workgroup of 8 × 8 for each such part of a picture.
    pub fn over_pixels(size: [u32; 2]) -> Self {
        let [columns, rows] = size.map(|side| side.div_ceil(8));
        Self {
            offset: None,
            workgroups: [columns, rows, 1],
        }
    }
}

/// So many workgroups in two dimensions, of which each holds at most 65,535; up to one row more than was asked for.
pub fn grid(groups: u64) -> [u32; 3] {
    const MOST: u64 = 65_535;
    let columns = groups.clamp(1, MOST);
    [columns as u32, groups.div_ceil(columns).max(1) as u32, 1]
}

impl Shader {
    /// A pass of one of its entry points. `groups` are the layouts of the bind groups from 1 on; the uniforms at the
    /// bindings `arrays` of group 0 are elements of [`UniformArray`]s.
    ///
    /// # Errors
    /// As [`compute_pipeline`](Self::compute_pipeline); [`Error::Shader`] when there is no such entry point, or it binds what
    /// is not known here.
    pub fn compute_pass(
        &self,
        context: &Context,
        entry_point: &'static str,
        groups: &[&BindGroupLayout],
        arrays: &[u32],
    ) -> Result<ComputePass> {
        let entries = self.group_0(entry_point, arrays)?;
        let layout = context.check(entry_point, |device| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(entry_point),
                entries: &entries,
            })
        })?;
        let layouts: Vec<_> = [&layout]
            .into_iter()
            .chain(groups.iter().copied())
            .collect();
        Ok(ComputePass {
            name: entry_point,
            pipeline: self.compute_pipeline(context, entry_point, &layouts)?,
            layout,
            bindings: entries.iter().map(|entry| entry.binding).collect(),
        })
    }

    /// What an entry point uses of group 0.
    fn group_0(
        &self,
        entry_point: &str,
        arrays: &[u32],
    ) -> Result<Vec<wgpu::BindGroupLayoutEntry>> {
        let (module, info) = self.module_and_info();
        let error = |message: String| Error::Shader {
            file: self.name().into(),
            line: 0,
            message,
        };
        let mut entry_points = module.entry_points.iter();
        let index = entry_points
            .position(|one| one.name == entry_point)
            .ok_or_else(|| error(format!("there is no entry point {entry_point}")))?;
        let used = info.get_entry_point(index);
        let mut entries = Vec::new();
        for (handle, variable) in module.global_variables.iter() {
            let Some(place) = variable.binding else {
                continue;
            };
            if place.group != 0 || used[handle].is_empty() {
                continue;
            }
            let is_array = arrays.contains(&place.binding);
            let ty = binding_type(module, variable, is_array).ok_or_else(|| {
                let name = variable.name.as_deref().unwrap_or_default();
                error(format!("{name} is of a kind that passes do not bind"))
            })?;
            entries.push(wgpu::BindGroupLayoutEntry {
                binding: place.binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty,
                count: None,
            });
        }
        Ok(entries)
    }
}

impl ComputePass {
    /// Binds group 0; of `resources`, by their bindings, those that the pass uses.
    ///
    /// # Errors
    /// [`Error::Gpu`] when one is missing or of another kind.
    pub fn bind(
        &self,
        context: &Context,
        resources: &[(u32, BindingResource<'_>)],
    ) -> Result<BindGroup> {
        let used = resources
            .iter()
            .filter(|(binding, _)| self.bindings.contains(binding));
        let entries: Vec<_> = used
            .map(|(binding, resource)| wgpu::BindGroupEntry {
                binding: *binding,
                resource: resource.clone(),
            })
            .collect();
        context.check(self.name, |device| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(self.name),
                layout: &self.layout,
                entries: &entries,
            })
        })
    }

    /// Records the pass, timed under `name`. `groups` are bound from 0 on.
    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        name: &str,
        timer: Option<&mut Timer>,
        groups: &[&BindGroup],
        dispatches: &[Dispatch],
    ) {
        let timestamp_writes = timer.and_then(|timer| timer.compute(name, encoder));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(name),
            timestamp_writes,
        });
        pass.set_pipeline(&self.pipeline);
        for (index, group) in (0..).zip(groups).skip(1) {
            pass.set_bind_group(index, *group, &[]);
        }
        for dispatch in dispatches {
            pass.set_bind_group(0, groups[0], dispatch.offset.as_slice());
            let [x, y, z] = dispatch.workgroups;
            pass.dispatch_workgroups(x, y, z);
        }
    }
}

/// Values of which each dispatch of a pass is told one.
#[derive(Debug)]
pub struct UniformArray<T> {
    buffer: wgpu::Buffer,
    of: PhantomData<T>,
}

impl<T: Pod> UniformArray<T> {
    /// Uploads the values; [`write`](Self::write) replaces them.
    ///
    /// # Errors
    /// [`Error::GpuLimit`] when they are larger than the device can hold, [`Error::Gpu`] when memory is out.
    pub fn new(context: &Context, label: &str, values: &[T]) -> Result<Self> {
        let usage = wgpu::BufferUsages::UNIFORM;
        Ok(Self {
            buffer: context.buffer(label, &strided(values), usage)?,
            of: PhantomData,
        })
    }

    /// Replaces the first values, from the next submission on.
    pub fn write(&self, context: &Context, values: &[T]) {
        let bytes = strided(values);
        context.queue().write_buffer(&self.buffer, 0, &bytes);
    }

    /// Where a value lies.
    pub fn offset(index: u32) -> u32 {
        index * size_of::<T>().next_multiple_of(STRIDE) as u32
    }

    /// What is bound.
    pub fn binding(&self) -> BindingResource<'_> {
        BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.buffer,
            offset: 0,
            size: NonZero::new(size_of::<T>() as u64),
        })
    }
}

fn strided<T: Pod>(values: &[T]) -> Vec<u8> {
    let stride = size_of::<T>().next_multiple_of(STRIDE);
    let mut bytes = vec![0; stride * values.len().max(1)];
    for (place, value) in bytes.chunks_exact_mut(stride).zip(values) {
        place[..size_of::<T>()].copy_from_slice(bytemuck::bytes_of(value));
    }
    bytes
}

/// What a variable is bound to; `None` where passes do not know its kind.
fn binding_type(
    module: &naga::Module,
    variable: &naga::GlobalVariable,
    has_dynamic_offset: bool,
) -> Option<BindingType> {
    let buffer = |ty| BindingType::Buffer {
        ty,
        has_dynamic_offset,
        min_binding_size: None,
    };
    match variable.space {
        naga::AddressSpace::Uniform => return Some(buffer(BufferBindingType::Uniform)),
        naga::AddressSpace::Storage { access } => {
            let read_only = !access.contains(naga::StorageAccess::STORE);
            return Some(buffer(BufferBindingType::Storage { read_only }));
        }
        _ => {}
    }
    let naga::TypeInner::Image {
        dim: naga::ImageDimension::D2,
        arrayed,
        class,
    } = module.types[variable.ty].inner
    else {
        return None;
    };
    let view_dimension = if arrayed {
        wgpu::TextureViewDimension::D2Array
    } else {
        wgpu::TextureViewDimension::D2
    };
    match class {
        naga::ImageClass::Sampled { kind, multi } => Some(BindingType::Texture {
            sample_type: match kind {
                naga::ScalarKind::Float => wgpu::TextureSampleType::Float { filterable: false },
                naga::ScalarKind::Uint => wgpu::TextureSampleType::Uint,
                naga::ScalarKind::Sint => wgpu::TextureSampleType::Sint,
                _ => return None,
            },
            view_dimension,
            multisampled: multi,
        }),
        naga::ImageClass::Storage { format, access } => Some(BindingType::StorageTexture {
            access: if access == naga::StorageAccess::STORE {
                wgpu::StorageTextureAccess::WriteOnly
            } else {
                return None;
            },
            format: match format {
                naga::StorageFormat::Rgba32Float => wgpu::TextureFormat::Rgba32Float,
                naga::StorageFormat::Rgba16Float => wgpu::TextureFormat::Rgba16Float,
                naga::StorageFormat::Rgba32Uint => wgpu::TextureFormat::Rgba32Uint,
                naga::StorageFormat::R32Float => wgpu::TextureFormat::R32Float,
                naga::StorageFormat::R32Uint => wgpu::TextureFormat::R32Uint,
                _ => return None,
            },
            view_dimension,
        }),
        _ => None,
    }
}
