//! Every entry point with every tracer links, is valid, and becomes a pipeline on a device that needs no GPU and has
//! WebGPU's default limits.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

use std::sync::Arc;

use glam::{Affine3A, Vec3};
use isophote_scene::{
    Answers, BuildTracer, BvhTracer, Camera, Error, Instance, Leaves, Light, Material, Mesh,
    Receivers, Scene, Selection,
    gpu::{
        BuildGpuTracer, ComputeBvhTracer, Context, GBuffer, GBufferPass, GpuScene, GpuTracer,
        Linker, Rasters, RayBatch, RayQueryBoxTracer, RayQueryTracer, ShaderPackage, ShadowMaps,
        ShadowOptions, reference,
    },
    reference::{Quantity, Settings},
};

/// A few triangles in one place.
fn triangles() -> Arc<Scene> {
    let mesh = Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        triangles: vec![[0, 1, 2]; 40],
        triangle_materials: vec![0; 40],
        ..Mesh::default()
    };
    Arc::new(Scene {
        meshes: vec![Arc::new(mesh)],
        materials: vec![Material::default()],
        instances: vec![Instance::new(0, Affine3A::IDENTITY)],
        ..Scene::default()
    })
}

/// One that binds buffers of any size that occurs here, and one that does not.
fn contexts() -> [Context; 2] {
    let small = wgpu::Limits {
        max_storage_buffer_binding_size: 128,
        ..wgpu::Limits::default()
    };
    [Context::noop(), Context::noop_within(small)]
}

fn tracers(context: &Context, scene: &Arc<Scene>) -> Vec<Box<dyn GpuTracer>> {
    let selection = Selection::default();
    vec![
        Box::new(ComputeBvhTracer::build(context, scene, &selection, &()).unwrap()),
        Box::new(RayQueryTracer::build(context, scene, &selection, &()).unwrap()),
        Box::new(RayQueryBoxTracer::build(context, scene, &selection, &()).unwrap()),
        Box::new(ComputeBvhTracer::build_with(context, scene, &selection, Leaves::Boxes).unwrap()),
    ]
}

#[test]
fn batches_build_with_every_tracer() {
    let scene = triangles();
    for (context, in_textures) in contexts().iter().zip([false, true]) {
        let gpu_scene = GpuScene::new(context, &scene).unwrap();
        assert_eq!(gpu_scene.is_in_textures(), in_textures);
        for tracer in tracers(context, &scene) {
            let flags = tracer.shader_flags();
            assert_eq!(flags.contains(&"tracer_in_textures"), in_textures);
            RayBatch::new(context, &gpu_scene, &*tracer)
                .unwrap_or_else(|error| panic!("{}: {error}", tracer.name()));
        }
    }
}

/// A pipeline that was linked without the scene cannot be used with one in textures.
#[test]
fn the_wrong_way_to_read_a_scene_is_an_error() {
    let [_, context] = contexts();
    let scene = triangles();
    let tracer = &tracers(&context, &scene)[0];
    let scene = GpuScene::new(&context, &scene).unwrap();
    let link = |linker: Linker| linker.package(READ).link("test_read::read").unwrap();
    let device = context.device();
    let empty = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &[],
    });
    let layouts = [
        &empty,
        tracer.bind_group_layout(),
        scene.bind_group_layout(),
    ];
    let pipeline = |linker| link(linker).compute_pipeline(&context, "look", &layouts);
    let (right, wrong) = (Linker::default().scene(&scene), Linker::default());
    pipeline(right.tracer(&**tracer)).unwrap();
    pipeline(wrong.tracer(&**tracer)).unwrap_err();
}

const READ: ShaderPackage = ShaderPackage {
    name: "test_read",
    modules: &[(
        "read",
        "import scene::ray::Ray;
        import scene::scene_data::vertex_position;
        import tracer::any_hit;
        @compute @workgroup_size(1)
        fn look() {
            if any_hit(Ray(vertex_position(0u), 0.0, vec3f(1.0), 1.0)) { return; }
        }",
    )],
};

/// A tracer of another crate, of several modules.
struct Foreign(ComputeBvhTracer);

const FOREIGN: ShaderPackage = ShaderPackage {
    name: "test_foreign",
    modules: &[
        (
            "trace",
            "import package::maps::first_word;
            import scene::ray::{Hit, Ray, no_hit};
            fn closest_hit(ray: Ray) -> Hit { return no_hit(); }
            fn any_hit(ray: Ray) -> bool { return first_word() == 1u; }
            fn tolerance(point: vec3f) -> f32 { return 0.0; }",
        ),
        (
            "maps",
            "@if(!tracer_in_textures) @group(1) @binding(0) var<storage, read> nodes: array<vec4u>;
            @if(tracer_in_textures) @group(1) @binding(0) var nodes: texture_2d<u32>;
            fn first_word() -> u32 {
                @if(!tracer_in_textures) return nodes[0].x;
                @if(tracer_in_textures) return textureLoad(nodes, vec2u(0u), 0).x;
            }",
        ),
    ],
};

impl GpuTracer for Foreign {
    fn name(&self) -> &'static str {
        "foreign"
    }

    fn answers(&self) -> Answers {
        Answers::Occlusion
    }

    fn module(&self) -> &'static str {
        "test_foreign::trace"
    }

    fn packages(&self) -> &[ShaderPackage] {
        &[FOREIGN]
    }

    fn shader_flags(&self) -> &[&'static str] {
        self.0.shader_flags()
    }

    fn bind_group_layout(&self) -> &wgpu::BindGroupLayout {
        self.0.bind_group_layout()
    }

    fn bind_group(&self) -> &wgpu::BindGroup {
        self.0.bind_group()
    }
}

const READ_TWO: ShaderPackage = ShaderPackage {
    name: "test_read_two",
    modules: &[(
        "read",
        "import scene::ray::Ray;
        import tracer::any_hit;
        import secondary::any_hit as any_hit_of_other;
        @group(0) @binding(0) var<storage, read_write> found: array<u32>;
        @compute @workgroup_size(1)
        fn look() {
            let ray = Ray(vec3f(0.0), 0.0, vec3f(1.0), 1.0);
            found[0] = select(0u, 1u, any_hit(ray)) + select(0u, 2u, any_hit_of_other(ray));
        }",
    )],
};

/// A shader asks two tracers of any kinds at once, and binds no more than WebGPU promises.
#[test]
fn shaders_ask_two_tracers() {
    let scene = triangles();
    for context in contexts() {
        let gpu_scene = GpuScene::new(&context, &scene).unwrap();
        let selection = Selection::default();
        let mut tracers = tracers(&context, &scene);
        let walked = ComputeBvhTracer::build(&context, &scene, &selection, &()).unwrap();
        tracers.push(Box::new(Foreign(walked)));
        for first in &tracers {
            for second in &tracers {
                let groups = [
                    first.bind_group_layout(),
                    gpu_scene.bind_group_layout(),
                    second.bind_group_layout(),
                ];
                Linker::default()
                    .package(READ_TWO)
                    .scene(&gpu_scene)
                    .tracer(&**first)
                    .secondary(&**second)
                    .link("test_read_two::read")
                    .and_then(|shader| shader.compute_pass(&context, "look", &groups, &[]))
                    .unwrap_or_else(|error| panic!("{}, {}: {error}", first.name(), second.name()));
            }
        }
    }
}

/// Every pass of the reference integrators becomes a pipeline. What the device then leaves undone is noticed.
#[test]
fn reference_passes_build_with_every_tracer() {
    let scene = triangles();
    let small = wgpu::Limits {
        max_storage_buffer_binding_size: 512,
        ..wgpu::Limits::default()
    };
    let contexts = [Context::noop(), Context::noop_within(small)];
    for (context, in_textures) in contexts.iter().zip([false, true]) {
        let gpu_scene = GpuScene::new(context, &scene).unwrap();
        assert_eq!(gpu_scene.is_in_textures(), in_textures);
        let tracers = tracers(context, &scene);
        for exact in &tracers {
            for secondary in &tracers {
                check_reference(context, &scene, &gpu_scene, &**exact, &**secondary);
            }
        }
    }
}

fn check_reference(
    context: &Context,
    scene: &Arc<Scene>,
    gpu_scene: &GpuScene,
    exact: &dyn GpuTracer,
    secondary: &dyn GpuTracer,
) {
    let settings = Settings {
        d_max: 1.0,
        ..Settings::default()
    };
    let camera = Camera::framing(&scene.bounds());
    let bvh = BvhTracer::build(scene, &Selection::default(), &Default::default()).unwrap();
    let receivers = Receivers::from_camera(scene, &bvh, &camera, [8, 8]);
    let quantities = match secondary.answers() {
        Answers::Surface => &Quantity::ALL[..],
        _ => &[Quantity::Ao, Quantity::Obscurance],
    };
    let world = reference::World {
        scene,
        gpu_scene,
        exact,
        secondary,
    };
    let none = &|_, _| {};
    let mut integrator = reference::Integrator::new(context);
    let rendered = integrator.render(world, &camera, [8, 8], quantities, &settings, none);
    let baked = integrator.bake(world, &receivers, quantities, &settings, none);
    let expected = match exact.answers() {
        Answers::Surface => "did not finish",
        _ => "needs a tracer that answers Surface",
    };
    for error in [rendered.err(), baked.err()] {
        let error = error.unwrap().to_string();
        // Acceleration structures are not built here either.
        let fits = error.contains(expected) || error.contains("Tlas");
        assert!(fits, "{}, {}: {error}", exact.name(), secondary.name());
    }
}

#[test]
fn rasterising_passes_build() {
    let mut scene = Scene::clone(&triangles());
    scene.lights.push(Light::point("", Vec3::Z, Vec3::ONE));
    let camera = Camera::look_at("", Vec3::Z, Vec3::ZERO, 1.0);
    for context in contexts() {
        let gpu_scene = GpuScene::new(&context, &scene).unwrap();
        let mut encoder = context.device().create_command_encoder(&Default::default());
        for samples in [1, 4] {
            let pass = GBufferPass::new(&context, samples).unwrap();
            let gbuffer = GBuffer::new(&context, [8, 8], samples).unwrap();
            pass.record(&context, &mut encoder, &gpu_scene, &camera, &gbuffer, None)
                .unwrap();
            let features = Linker::default().feature("multisampled", samples > 1);
            features.link("scene::gbuffer::read").unwrap();
        }
        let maps = ShadowMaps::new(&context, &scene.lights, &ShadowOptions::default()).unwrap();
        maps.record(&context, &mut encoder, &gpu_scene, &scene.lights, None)
            .unwrap();
        context.submit("rasterising", encoder).unwrap();
    }
    Linker::default().link("scene::shadow::read").unwrap();
}

const SHADE: ShaderPackage = ShaderPackage {
    name: "test_shade",
    modules: &[(
        "shade",
        "import scene::gbuffer::read::{gbuffer_size, samples_alike, seen_at};
        import scene::shadow::read::shadow;
        @group(0) @binding(0) var<storage, read_write> shades: array<f32>;
        @compute @workgroup_size(8, 8)
        fn shade(@builtin(global_invocation_id) id: vec3u) {
            let seen = seen_at(id.xy, 0u);
            let share = f32(samples_alike(id.xy, 0u));
            shades[id.y * gbuffer_size().x + id.x] = share * shadow(0u, seen.position, seen.normal);
        }",
    )],
};

#[test]
fn a_technique_reads_g_buffer_and_shadow_maps_at_once() {
    let context = Context::noop();
    let scene = GpuScene::new(&context, &triangles()).unwrap();
    let maps = ShadowMaps::new(&context, &[], &ShadowOptions::default()).unwrap();
    let device = context.device();
    let layout = |entries: &[wgpu::BindGroupLayoutEntry]| {
        device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries,
        })
    };
    let own = layout(&[wgpu::BindGroupLayoutEntry {
        binding: 0,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only: false },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    }]);
    let empty = layout(&[]);
    for samples in [1, 4] {
        let gbuffer = GBuffer::new(&context, [64, 32], samples).unwrap();
        let rasters = Rasters::new(&context, Some(&gbuffer), Some(&maps)).unwrap();
        let layouts = [
            &own,
            &empty,
            scene.bind_group_layout(),
            rasters.bind_group_layout(),
        ];
        Linker::default()
            .package(SHADE)
            .feature("multisampled", samples > 1)
            .link("test_shade::shade")
            .unwrap()
            .compute_pipeline(&context, "shade", &layouts)
            .unwrap();
    }
}

fn link_error(text: &'static str) -> String {
    let modules = Box::leak(Box::new([("broken", text)]));
    let package = ShaderPackage {
        name: "test_crate",
        modules,
    };
    match Linker::default()
        .package(package)
        .link("test_crate::broken")
    {
        Ok(shader) => panic!("linked:\n{}", shader.wgsl()),
        Err(error @ Error::Shader { .. }) => error.to_string(),
        Err(error) => panic!("{error:?}"),
    }
}

#[test]
fn shader_errors_name_file_and_line() {
    let place = "test-crate/shaders/broken.wesl:5: ";
    // Found by the parser, by the linker, by naga's front and by naga's validation.
    for text in [
        "\n\n@compute @workgroup_size(1)\nfn main() {\n    let x = ;\n}\n",
        "import scene::ray::Ray;\n\n@compute @workgroup_size(1)\nfn main() {\n    let x = nothing(1.0);\n}\n",
        "import scene::ray::{Ray, is_valid};\n/* a\n comment */ @compute @workgroup_size(1)\nfn main() { // fn other() {\n    let x: f32 = 1u;\n}\n",
        "import scene::ray::is_finite;\n\nfn helper(x: f32) -> f32 {\n    let a = select(x, 0.0, is_finite(x));\n    return vec2f(a);\n}\n\
         @compute @workgroup_size(1) fn main() { let y = helper(1.0); }\n",
    ] {
        let error = link_error(text);
        assert!(error.starts_with(place), "{error}\n{text}");
    }
}

#[test]
fn a_missing_tracer_or_module_is_named() {
    let error = link_error(
        "import tracer::any_hit;\nimport scene::ray::Ray;\n@compute @workgroup_size(1)\nfn main() {\n\
         if any_hit(Ray()) { return; }\n}\n",
    );
    assert!(error.contains("tracer"), "{error}");
    let error = link_error(
        "import nowhere::thing;\n@compute @workgroup_size(1)\nfn main() { let x = thing(); }\n",
    );
    assert!(error.contains("nowhere"), "{error}");
    let error = Linker::default().link("scene::no_such_thing").unwrap_err();
    assert!(error.to_string().contains("no_such_thing"), "{error}");
}
