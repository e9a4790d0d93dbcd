//! Shaders of tests: one compute pass over storage buffers.

use isophote_scene::gpu::{Context, Shader};

/// A bind group of the crate's own and its number.
pub(crate) type Group<'a> = (usize, &'a wgpu::BindGroupLayout, &'a wgpu::BindGroup);

/// Runs an entry point; `buffers` are group 0, to be read and written.
pub(crate) fn compute(
    context: &Context,
    encoder: &mut wgpu::CommandEncoder,
    (shader, entry_point): (&Shader, &str),
    buffers: &[&wgpu::Buffer],
    groups: &[Group<'_>],
    [columns, rows]: [u32; 2],
) {
    let device = context.device();
    let layout = |entries: &[wgpu::BindGroupLayoutEntry]| {
        device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries,
        })
    };
    let storage = |binding| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only: false },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    };
    let entries: Vec<_> = (0..buffers.len() as u32).map(storage).collect();
    let resources: Vec<_> = (0..)
        .zip(buffers)
        .map(|(binding, buffer)| wgpu::BindGroupEntry {
            binding,
            resource: buffer.as_entire_binding(),
        })
        .collect();
    let own = layout(&entries);
    let own_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &own,
        entries: &resources,
    });
    let empty = layout(&[]);
    let mut layouts = vec![&own];
    for &(index, layout, _) in groups {
        layouts.resize(index, &empty);
        layouts.push(layout);
    }
    let pipeline = shader
        .compute_pipeline(context, entry_point, &layouts)
        .unwrap();
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &own_group, &[]);
    for &(index, _, group) in groups {
        pass.set_bind_group(index as u32, group, &[]);
    }
    pass.dispatch_workgroups(columns, rows, 1);
}
