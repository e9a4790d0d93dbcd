//! Fills a G-buffer and brings it back, as a technique would read it.

#[path = "compute.rs"]
mod compute;

use bytemuck::{Pod, Zeroable};
use compute::compute;
use glam::Vec3;
use isophote_scene::{
    Camera,
    gpu::{Context, GBuffer, GBufferPass, GpuScene, Linker, Rasters, ShaderPackage},
};

/// A sample of a pixel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct Seen {
    pub(crate) position: Vec3,
    pub(crate) depth: f32,
    pub(crate) normal: Vec3,
    pub(crate) instance: u32,
    pub(crate) albedo: Vec3,
    pub(crate) primitive: u32,
    pub(crate) material: u32,
    /// How many of the pixel's samples see the same, if this is the first.
    pub(crate) alike: u32,
    padding: [u32; 2],
}

pub(crate) const PACKAGE: ShaderPackage = ShaderPackage {
    name: "test_seen",
    modules: &[("dump", DUMP)],
};

const DUMP: &str = "
import scene::gbuffer::read::{gbuffer_size, samples_alike, seen_at};

struct Record {
    position: vec3f,
    depth: f32,
    normal: vec3f,
    instance: u32,
    albedo: vec3f,
    primitive: u32,
    material: u32,
    alike: u32,
}

@group(0) @binding(0) var<storage, read_write> records: array<Record>;

@compute @workgroup_size(8, 8)
fn dump(@builtin(global_invocation_id) id: vec3u) {
    let size = gbuffer_size();
    if any(id.xy >= size) {
        return;
    }
    let samples = arrayLength(&records) / (size.x * size.y);
    for (var sample = 0u; sample < samples; sample++) {
        let seen = seen_at(id.xy, sample);
        records[samples * (id.y * size.x + id.x) + sample] = Record(
            seen.position, seen.depth, seen.normal, seen.instance, seen.albedo, seen.primitive, seen.material,
            samples_alike(id.xy, sample),
        );
    }
}
";

/// All samples of all pixels, row by row from the top.
pub(crate) fn read(context: &Context, gbuffer: &GBuffer) -> Vec<Seen> {
    let [width, height] = gbuffer.size();
    let count = (width * height * gbuffer.samples()) as usize;
    let records = vec![Seen::zeroed(); count];
    let records = context
        .buffer("records", &records, wgpu::BufferUsages::STORAGE)
        .unwrap();
    let rasters = Rasters::new(context, Some(gbuffer), None).unwrap();
    let shader = Linker::default()
        .package(PACKAGE)
        .feature("multisampled", gbuffer.samples() > 1)
        .link("test_seen::dump")
        .unwrap();
    let mut encoder = context
        .device()
        .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    compute(
        context,
        &mut encoder,
        (&shader, "dump"),
        &[&records],
        &[(3, rasters.bind_group_layout(), rasters.bind_group())],
        [width.div_ceil(8), height.div_ceil(8)],
    );
    context.submit("reading the G-buffer", encoder).unwrap();
    context.read("records", &records, count).unwrap()
}

/// What a camera sees of a scene.
pub(crate) fn see(
    context: &Context,
    scene: &GpuScene,
    camera: &Camera,
    size: [u32; 2],
    samples: u32,
) -> Vec<Seen> {
    let gbuffer = GBuffer::new(context, size, samples).unwrap();
    let pass = GBufferPass::new(context, samples).unwrap();
    let mut encoder = context
        .device()
        .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let start = std::time::Instant::now();
    pass.record(context, &mut encoder, scene, camera, &gbuffer, None)
        .unwrap();
    context.submit("G-buffer", encoder).unwrap();
    context.wait("G-buffer").unwrap();
    println!(
        "G-buffer of {size:?}, {samples} samples: {:?}",
        start.elapsed()
    );
    read(context, &gbuffer)
}
