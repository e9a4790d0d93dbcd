//! Passes are measured where they run, whatever ran before them.
#![cfg(feature = "gpu")]

use std::time::Instant;

use isophote_scene::gpu::{Context, Timer};

const LOOP: &str = "
@group(0) @binding(0) var<storage, read_write> values: array<u32>;

@compute @workgroup_size(64)
fn turn(@builtin(global_invocation_id) id: vec3u) {
    var value = values[id.x];
    for (var step = 0u; step < 50000u; step++) {
        value = value * 1664525u + (value >> 3u);
    }
    values[id.x] = value;
}
";
const WORKGROUPS: u32 = 128;

/// Records a render pass that clears a texture, timed.
fn draw(context: &Context, encoder: &mut wgpu::CommandEncoder, timer: &mut Timer) {
    let texture = context.device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d {
            width: 64,
            height: 64,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::R8Unorm,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    let view = texture.create_view(&Default::default());
    let attachment = wgpu::RenderPassColorAttachment {
        view: &view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations::default(),
    };
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: None,
        color_attachments: &[Some(attachment)],
        timestamp_writes: timer.render("draw"),
        ..Default::default()
    });
}

/// Where the processor computes there is nothing else that could take the time.
#[test]
fn passes_are_measured_after_drawing_too() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let device = context.device();
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(LOOP.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("turn"),
        compilation_options: Default::default(),
        cache: None,
    });
    let values = vec![1_u32; 64 * WORKGROUPS as usize];
    let values = context
        .buffer("values", &values, wgpu::BufferUsages::STORAGE)
        .unwrap();
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[wgpu::BindGroupEntry {
            binding: 0,
            resource: values.as_entire_binding(),
        }],
    });
    let dispatch = |mut pass: wgpu::ComputePass<'_>| {
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(WORKGROUPS, 1, 1);
    };
    for draws in [false, true] {
        let mut timer = Timer::new(&context, 3);
        let mut encoder = device.create_command_encoder(&Default::default());
        if draws {
            draw(&context, &mut encoder, &mut timer);
        }
        let timestamp_writes = timer.compute("one", &mut encoder);
        dispatch(encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: None,
            timestamp_writes,
        }));
        timer.around("other", &mut encoder, |encoder| {
            dispatch(encoder.begin_compute_pass(&Default::default()));
        });
        timer.resolve(&mut encoder);
        let start = Instant::now();
        context.submit("passes", encoder).unwrap();
        context.wait("passes").unwrap();
        let all = start.elapsed();
        let times = timer.read(&context).unwrap();
        println!("{times:?} of {all:?}");
        if device.adapter_info().device_type == wgpu::DeviceType::Cpu && !times.is_empty() {
            for time in times.iter().filter(|time| time.name != "draw") {
                assert!(time.time > all / 8, "{times:?} of {all:?}");
            }
        }
    }
}
