//! Virtual point lights in a renderer of one's own: `cargo run --release -p isophote-instant-gi --features gpu --example own_gbuffer -- out.png`.
//!
//! 1. The renderer opens its device, uploads its vertices, and rasterises what the camera sees in one render pass: depth, normal,
//!    base colour, and which triangle it is.
//! 2. Isophote takes those textures, traces no camera rays, and records its stages into the renderer's own commands.
//! 3. What it leaves lies in textures of the same device; here they are read back.

use std::{path::Path, sync::Arc};

use bytemuck::{Pod, Zeroable};
use glam::{
    Mat4, Vec3,
    camera::rh::proj::directx::{orthographic, perspective},
};
use isophote_instant_gi::{GiParams, gpu::InstantGi};
use isophote_scene::{
    Camera, Projection, Scene, Selection, builtin,
    gpu::{
        AdapterChoice, BuildGpuTracer, ComputeBvhTracer, Context, GBuffer, GBufferViews, GpuScene,
        reference::World,
    },
};
use wgpu::TextureFormat;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const SIZE: [u32; 2] = [400, 300];

fn main() -> Result<()> {
    let output = std::env::args().nth(1).unwrap_or("own_gbuffer.png".into());
    let scene = Arc::new(builtin::build("builtin:cornell")?);
    let camera = &scene.cameras[0];
    // A renderer that has a device already: Context::new(device, queue).
    let context = Context::open(&AdapterChoice::Any)?;
    let renderer = Renderer::new(context.device(), context.queue(), &scene);

    let gpu_scene = GpuScene::new(&context, &scene)?;
    let tracer = ComputeBvhTracer::build(&context, &scene, &Selection::default(), &())?;
    let world = World {
        scene: &scene,
        gpu_scene: &gpu_scene,
        exact: &tracer,
        secondary: &tracer,
    };
    let gbuffer = GBuffer::from_views(&context, renderer.views(), camera)?;
    let params = GiParams {
        downsampling: 4,
        refinement: 2,
        ..GiParams::default()
    };
    let gi = InstantGi::over(&context, world, &params, &gbuffer)?;

    let mut encoder = context.device().create_command_encoder(&Default::default());
    renderer.record(context.queue(), &mut encoder, camera);
    gi.record(&context, &mut encoder, world, camera, None)?;
    context.submit("picture", encoder)?;

    // A renderer would go on with gi.stages().indirect, which is multiplied with the base colour already, or with
    // gi.stages().irradiance.
    gi.read(&context)?.image(SIZE).save(Path::new(&output))?;
    println!("{output}");
    Ok(())
}

/// A renderer that draws all triangles.
struct Renderer {
    pipeline: wgpu::RenderPipeline,
    camera: wgpu::Buffer,
    group: wgpu::BindGroup,
    vertices: wgpu::Buffer,
    count: u32,
    depth: wgpu::TextureView,
    normal: wgpu::TextureView,
    albedo: wgpu::TextureView,
    ids: wgpu::TextureView,
    /// Nobody asks for materials, so that this may be one pixel.
    material: wgpu::TextureView,
    depth_test: wgpu::TextureView,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Vertex {
    position: Vec3,
    normal: Vec3,
    color: Vec3,
    /// Instance and primitive, both one more than in the scene: 0 is for what is in no scene.
    ids: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct CameraData {
    to_clip: Mat4,
    to_camera: Mat4,
}

const SHADER: &str = "
    struct Camera { to_clip: mat4x4f, to_camera: mat4x4f }
    @group(0) @binding(0) var<uniform> camera: Camera;

    struct Corner {
        @builtin(position) clip: vec4f,
        @location(0) place: vec3f,
        @location(1) normal: vec3f,
        @location(2) color: vec3f,
        @location(3) @interpolate(flat) ids: vec2u,
    }

    @vertex
    fn corner(
        @location(0) position: vec3f, @location(1) normal: vec3f, @location(2) color: vec3f, @location(3) ids: vec2u,
    ) -> Corner {
        let place = (camera.to_camera * vec4f(position, 1.0)).xyz;
        return Corner(camera.to_clip * vec4f(position, 1.0), place, normal, color, ids);
    }

    struct Layers {
        @location(0) depth: f32,
        @location(1) normal: vec4f,
        @location(2) albedo: vec4f,
        @location(3) ids: vec4u,
    }

    @fragment
    fn layers(in: Corner) -> Layers {
        let turned = (camera.to_camera * vec4f(in.normal, 0.0)).xyz;
        let side = select(1.0, -1.0, dot(turned, in.place) > 0.0);
        // Ids are told in halves.
        let halves = vec4u(in.ids.x & 0xffffu, in.ids.x >> 16u, in.ids.y & 0xffffu, in.ids.y >> 16u);
        return Layers(-in.place.z, vec4f(side * normalize(in.normal), 0.0), vec4f(in.color, 1.0), halves);
    }
";

impl Renderer {
    fn new(device: &wgpu::Device, queue: &wgpu::Queue, scene: &Scene) -> Self {
        let vertices = vertices(scene);
        let texture = |format, [width, height]: [u32; 2]| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d {
                    width,
                    height,
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                    | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            texture.create_view(&Default::default())
        };
        let pipeline = pipeline(device);
        let camera = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: size_of::<CameraData>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: camera.as_entire_binding(),
            }],
        });
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: size_of_val(&vertices[..]) as u64,
            usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&vertices));
        Self {
            pipeline,
            camera,
            group,
            vertices: buffer,
            count: vertices.len() as u32,
            depth: texture(TextureFormat::R32Float, SIZE),
            normal: texture(TextureFormat::Rgba16Float, SIZE),
            albedo: texture(TextureFormat::Rgba8UnormSrgb, SIZE),
            ids: texture(TextureFormat::Rgba16Uint, SIZE),
            material: texture(TextureFormat::Rg16Uint, [1, 1]),
            depth_test: texture(TextureFormat::Depth32Float, SIZE),
        }
    }

    /// The layers, as Isophote takes them.
    fn views(&self) -> GBufferViews {
        GBufferViews {
            depth: self.depth.clone(),
            normal: self.normal.clone(),
            albedo: self.albedo.clone(),
            material: self.material.clone(),
            ids: self.ids.clone(),
        }
    }

    fn record(&self, queue: &wgpu::Queue, encoder: &mut wgpu::CommandEncoder, camera: &Camera) {
        let aspect = SIZE[0] as f32 / SIZE[1] as f32;
        let projection = match camera.projection {
            Projection::Perspective { yfov } => perspective(yfov, aspect, 0.01, 1000.0),
            Projection::Orthographic { half_height: half } => {
                orthographic(-half * aspect, half * aspect, -half, half, 0.0, 1000.0)
            }
        };
        let to_camera = Mat4::from(camera.transform.inverse());
        let data = CameraData {
            to_clip: projection * to_camera,
            to_camera,
        };
        queue.write_buffer(&self.camera, 0, bytemuck::bytes_of(&data));
        let attachment = |view| {
            Some(wgpu::RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    // A depth of 0 says that nothing is seen.
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: None,
            color_attachments: &[&self.depth, &self.normal, &self.albedo, &self.ids]
                .map(attachment),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth_test,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(1.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.draw(0..self.count, 0..1);
    }
}

/// Three for each triangle, in the world's space.
fn vertices(scene: &Scene) -> Vec<Vertex> {
    let mut vertices = Vec::new();
    for (number, instance) in scene.instances.iter().enumerate() {
        let mesh = scene.mesh(instance);
        let normals = Mat4::from(instance.transform).inverse().transpose();
        let triangles = mesh.triangles.iter().zip(&mesh.triangle_materials);
        for (primitive, (corners, &material)) in triangles.enumerate() {
            let color = scene.materials[material as usize].base_color.truncate();
            vertices.extend(corners.map(|corner| {
                Vertex {
                    position: (instance.transform)
                        .transform_point3(mesh.positions[corner as usize]),
                    normal: normals
                        .transform_vector3(mesh.normals[corner as usize])
                        .normalize(),
                    color,
                    ids: [number as u32 + 1, primitive as u32 + 1],
                }
            }));
        }
    }
    vertices
}

fn pipeline(device: &wgpu::Device) -> wgpu::RenderPipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(SHADER.into()),
    });
    let attributes =
        wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x3, 3 => Uint32x2];
    let formats = [
        TextureFormat::R32Float,
        TextureFormat::Rgba16Float,
        TextureFormat::Rgba8UnormSrgb,
        TextureFormat::Rgba16Uint,
    ];
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("corner"),
            compilation_options: Default::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<Vertex>() as u64,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &attributes,
            })],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: TextureFormat::Depth32Float,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Less),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("layers"),
            compilation_options: Default::default(),
            targets: &formats.map(|format| Some(format.into())),
        }),
        multiview_mask: None,
        cache: None,
    })
}
