//! Compute passes over buffers, and the prefix sum made of them.

use bytemuck::Pod;
use isophote_scene::{
    Result,
    gpu::{Context, Linker, grid},
};

use super::SHADERS;

/// A compute shader that binds group 0 alone: what it asks for, in the order of its bindings.
pub(super) struct Kernel {
    pipeline: wgpu::ComputePipeline,
    label: &'static str,
}

impl Kernel {
    pub(super) fn new(
        context: &Context,
        module: &'static str,
        entry_point: &'static str,
        flags: &[(&'static str, bool)],
    ) -> Result<Self> {
        let module = linker(flags).link(module)?.module(context)?;
        let pipeline = context.check(entry_point, |device| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry_point),
                layout: None,
                module: &module,
                entry_point: Some(entry_point),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        })?;
        Ok(Self {
            pipeline,
            label: entry_point,
        })
    }

    /// Records it over so many workgroups; `resources` are bound from 0 on.
    pub(super) fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        resources: &[wgpu::BindingResource<'_>],
        groups: [u32; 3],
    ) -> Result<()> {
        let numbered: Vec<_> = (0..).zip(resources.iter().cloned()).collect();
        self.record_numbered(context, encoder, &numbered, groups)
    }

    /// As [`record`](Self::record), where not all bindings are used.
    pub(super) fn record_numbered(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        resources: &[(u32, wgpu::BindingResource<'_>)],
        [x, y, z]: [u32; 3],
    ) -> Result<()> {
        let layout = self.pipeline.get_bind_group_layout(0);
        let group = bind(context, self.label, &layout, resources)?;
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(self.label),
            timestamp_writes: None,
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(x, y, z);
        Ok(())
    }
}

pub(super) fn bind(
    context: &Context,
    label: &str,
    layout: &wgpu::BindGroupLayout,
    resources: &[(u32, wgpu::BindingResource<'_>)],
) -> Result<wgpu::BindGroup> {
    let entries: Vec<_> = resources
        .iter()
        .map(|(binding, resource)| wgpu::BindGroupEntry {
            binding: *binding,
            resource: resource.clone(),
        })
        .collect();
    context.check(label, |device| {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(label),
            layout,
            entries: &entries,
        })
    })
}

/// A linker of this crate's modules.
pub(super) fn linker(flags: &[(&'static str, bool)]) -> Linker {
    let all = Linker::default().package(SHADERS);
    flags
        .iter()
        .fold(all, |linker, &(name, on)| linker.feature(name, on))
}

pub(super) fn uniform<T: Pod>(context: &Context, value: T) -> Result<wgpu::Buffer> {
    context.buffer("settings", &[value], wgpu::BufferUsages::UNIFORM)
}

/// Values that one workgroup sums up, `BLOCK` of the shader.
const BLOCK: u64 = 2048;

/// Replaces counts by the sums of those before.
pub(super) struct PrefixSum {
    sum: Kernel,
    add: Kernel,
}

impl PrefixSum {
    pub(super) fn new(context: &Context) -> Result<Self> {
        Ok(Self {
            sum: Kernel::new(context, "ldi::build::scan", "sum", &[])?,
            add: Kernel::new(context, "ldi::build::scan", "add", &[])?,
        })
    }

    /// The sums of the first `count` counts before each of `count` + 1, in a buffer of their own; and the last of them, read
    /// back.
    pub(super) fn of(
        &self,
        context: &Context,
        mut encoder: wgpu::CommandEncoder,
        counts: &wgpu::Buffer,
        count: u64,
    ) -> Result<(wgpu::Buffer, u32)> {
        let firsts = context.storage("prefix sums", 4 * (count + 1))?;
        encoder.copy_buffer_to_buffer(counts, 0, &firsts, 0, 4 * count);
        let mut levels = vec![(firsts.clone(), count + 1)];
        let mut last = count + 1;
        while last > 1 {
            last = last.div_ceil(BLOCK);
            levels.push((context.storage("prefix sums", 4 * last)?, last));
        }
        let pairs = levels
            .windows(2)
            .map(|pair| [part(&pair[0]), part(&pair[1])]);
        for (resources, (_, blocks)) in pairs.clone().zip(&levels[1..]) {
            self.sum
                .record(context, &mut encoder, &resources, grid(*blocks))?;
        }
        // The totals of the last level are of one block, to which nothing is to be added.
        for (resources, (_, blocks)) in pairs.zip(&levels[1..]).rev().skip(1) {
            self.add
                .record(context, &mut encoder, &resources, grid(*blocks))?;
        }
        let total = context.storage("number of layers", 4)?;
        encoder.copy_buffer_to_buffer(&firsts, 4 * count, &total, 0, 4);
        context.submit("prefix sums", encoder)?;
        let total = context.read::<u32>("number of layers", &total, 1)?[0];
        Ok((firsts, total))
    }
}

/// The values of a level.
fn part((buffer, values): &(wgpu::Buffer, u64)) -> wgpu::BindingResource<'_> {
    wgpu::BindingResource::Buffer(wgpu::BufferBinding {
        buffer,
        offset: 0,
        size: wgpu::BufferSize::new(4 * values),
    })
}
