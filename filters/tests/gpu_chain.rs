//! From a scene to filtered light on the GPU without a look at it on the way: G-buffer, sparse light by rays,
//! upsampling and blur are recorded into one encoder and submitted at once.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use std::sync::Arc;

use common::{textures, view};
use isophote_filters::{
    EdgeStop, Gaussian, Guides, JointBilateral, Neighborhood, Pinhole, SampleGrid, gpu,
};
use isophote_scene::{
    Camera, Projection, Selection, builtin,
    gpu::{
        BuildGpuTracer, ComputeBvhTracer, Context, GBuffer, GBufferPass, GpuScene, GpuTracer,
        Linker, Rasters, ShaderPackage,
    },
};
use wgpu::{BindingResource, CommandEncoder, TextureView};

const SIZE: [u32; 2] = [120, 90];
const FACTOR: usize = 4;

/// How open every fourth pixel's surroundings are, by rays of up to 0.3 m.
const OPENNESS: &str = "
import scene::gbuffer::read::{gbuffer_size, seen_at};
import scene::ray::Ray;
import tracer::any_hit;

@group(0) @binding(0) var samples: texture_storage_2d<rgba32float, write>;

const DIRECTIONS: u32 = 32u;

@compute @workgroup_size(8, 8)
fn gather(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= textureDimensions(samples)) {
        return;
    }
    let seen = seen_at(4u * id.xy + 2u, 0u);
    var light = vec3f(0.0);
    var total = 0.0;
    for (var k = 0u; k < DIRECTIONS; k++) {
        let z = 1.0 - 2.0 * (f32(k) + 0.5) / f32(DIRECTIONS);
        let turn = 2.3999632 * f32(k);
        let direction = vec3f(sqrt(1.0 - z * z) * vec2f(cos(turn), sin(turn)), z);
        let cosine = dot(direction, seen.normal);
        if cosine > 0.0 {
            total += cosine;
            if !any_hit(Ray(seen.position + 1e-3 * seen.normal, 0.0, direction, 0.3)) {
                light += cosine * (0.5 + 0.5 * direction);
            }
        }
    }
    textureStore(samples, id.xy, vec4f(light / max(total, 1e-3), 1.0));
}
";

/// Records the gathering of `samples`.
struct Gather {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
}

impl Gather {
    fn new(
        context: &Context,
        scene: &GpuScene,
        tracer: &dyn GpuTracer,
        rasters: &Rasters,
        samples: &TextureView,
    ) -> Self {
        let package = ShaderPackage {
            name: "test_chain",
            modules: &[("openness", OPENNESS)],
        };
        let shader = Linker::default().package(package).tracer(tracer);
        let shader = shader.link("test_chain::openness").unwrap();
        let device = context.device();
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::StorageTexture {
                    access: wgpu::StorageTextureAccess::WriteOnly,
                    format: samples.texture().format(),
                    view_dimension: wgpu::TextureViewDimension::D2,
                },
                count: None,
            }],
        });
        let layouts = [
            &layout,
            tracer.bind_group_layout(),
            scene.bind_group_layout(),
            rasters.bind_group_layout(),
        ];
        Self {
            pipeline: shader
                .compute_pipeline(context, "gather", &layouts)
                .unwrap(),
            group: device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &layout,
                entries: &[wgpu::BindGroupEntry {
                    binding: 0,
                    resource: BindingResource::TextureView(samples),
                }],
            }),
        }
    }

    fn record(
        &self,
        encoder: &mut CommandEncoder,
        scene: &GpuScene,
        tracer: &dyn GpuTracer,
        rasters: &Rasters,
        [columns, rows]: [u32; 2],
    ) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.pipeline);
        let groups = [
            &self.group,
            tracer.bind_group(),
            scene.bind_group(),
            rasters.bind_group(),
        ];
        for (index, group) in (0..).zip(groups) {
            pass.set_bind_group(index, group, &[]);
        }
        pass.dispatch_workgroups(columns.div_ceil(8), rows.div_ceil(8), 1);
    }
}

fn pinhole(camera: &Camera) -> Pinhole {
    let Projection::Perspective { yfov } = camera.projection else {
        panic!("the camera is not a perspective one");
    };
    let matrix = camera.transform.matrix3;
    let axes = [matrix.x_axis, matrix.y_axis, -matrix.z_axis].map(|axis| axis.normalize().into());
    Pinhole::new(camera.position().into(), axes, yfov).unwrap()
}

#[test]
fn from_scene_to_filtered_light_in_one_submission() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let scene = Arc::new(builtin::build("builtin:cornell").unwrap());
    let camera = &scene.cameras[0];
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let tracer = ComputeBvhTracer::build(&context, &scene, &Selection::default(), &()).unwrap();
    let gbuffer = GBuffer::new(&context, SIZE, 1).unwrap();
    let pass = GBufferPass::new(&context, 1).unwrap();
    let rasters = Rasters::new(&context, Some(&gbuffer), None).unwrap();

    let full = SIZE.map(|side| side as usize);
    let grid = SampleGrid::new(full, FACTOR).unwrap();
    let [columns, rows] = grid.size();
    let coarse = [columns as u32, rows as u32];
    let samples = textures::empty(&context, coarse);
    let gather = Gather::new(&context, &gpu_scene, &tracer, &rasters, &samples);

    let edges = EdgeStop::default();
    let joint_bilateral = JointBilateral::new(FACTOR, Neighborhood::default(), edges).unwrap();
    let gaussian = Gaussian::new(11, 2.0).unwrap();
    let format = gpu::Format::Single;
    let guides = gpu::Guides::new(&context, SIZE, &pinhole(camera)).unwrap();
    let upsample = gpu::JointBilateral::new(&context, &joint_bilateral, format).unwrap();
    let blur = gpu::Gaussian::new(&context, &gaussian, Some(edges), SIZE, format).unwrap();
    let upsampled = textures::empty(&context, SIZE);
    let light = textures::empty(&context, SIZE);
    let layers = gbuffer.views();

    textures::submit(&context, |encoder| {
        pass.record(&context, encoder, &gpu_scene, camera, &gbuffer, None)
            .unwrap();
        gather.record(encoder, &gpu_scene, &tracer, &rasters, coarse);
        guides
            .record(&context, encoder, &layers.normal, &layers.depth)
            .unwrap();
        upsample
            .record(&context, encoder, &samples, &guides, &upsampled)
            .unwrap();
        blur.record(&context, encoder, &upsampled, Some(&guides), &light)
            .unwrap();
    });
    let found = textures::download(&context, &light, 4);

    // From here on everything is read back, to do the same on the processor. A Gaussian of width 1 makes numbers of
    // 32 bits of the normals.
    let copy = Gaussian::new(1, 1.0).unwrap();
    let copy = gpu::Gaussian::new(&context, &copy, None, SIZE, format).unwrap();
    let normals = textures::empty(&context, SIZE);
    textures::submit(&context, |encoder| {
        copy.record(&context, encoder, &layers.normal, None, &normals)
            .unwrap();
    });
    let normals = textures::download(&context, &normals, 4);
    let normals: Vec<f32> = normals
        .chunks_exact(4)
        .flat_map(|normal| [normal[0], normal[1], normal[2]])
        .collect();
    let depths = textures::download(&context, &layers.depth, 1);
    let samples = textures::download(&context, &samples, 4);
    let [width, height] = full;
    let twin = Guides::new(
        view(&normals, width, height, 3),
        view(&depths, width, height, 1),
        &pinhole(camera),
    )
    .unwrap();
    let mut upsampled = vec![0.0; found.len()];
    joint_bilateral
        .apply(view(&samples, columns, rows, 4), &twin, &mut upsampled)
        .unwrap();
    let mut expected = vec![0.0; found.len()];
    gaussian
        .apply_guided(
            view(&upsampled, width, height, 4),
            &twin,
            &edges,
            &mut expected,
        )
        .unwrap();
    common::assert_close(&found, expected.into_iter().map(f64::from), 1e-4);

    // The box is open in the middle and closed in its corners, so there is something to see.
    let seen = depths.iter().filter(|&&depth| depth > 0.0).count();
    assert!(seen > depths.len() / 2, "{seen} pixels see a surface");
    let reds = samples.chunks_exact(4).map(|sample| sample[0]);
    let (least, most) = reds.fold((1.0_f32, 0.0_f32), |(a, b), red| (a.min(red), b.max(red)));
    assert!(most - least > 0.3, "{least} to {most}");
}
