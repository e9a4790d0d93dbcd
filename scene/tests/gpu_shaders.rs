//! Every entry point with every tracer links, is valid, and becomes a pipeline on a device that needs no GPU and has
//! WebGPU's default limits.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

use std::sync::Arc;

use glam::{Affine3A, Vec3};
use isophote_scene::{
    Error, Instance, Material, Mesh, Scene, Selection,
    gpu::{
        BuildGpuTracer, ComputeBvhTracer, Context, GBufferPass, GpuScene, GpuTracer, Linker,
        RayBatch, RayQueryBoxTracer, RayQueryTracer, ShaderPackage, ShadowMaps, ShadowOptions,
    },
};

fn triangle() -> Arc<Scene> {
    let mesh = Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        triangles: vec![[0, 1, 2]],
        triangle_materials: vec![0],
        ..Mesh::default()
    };
    Arc::new(Scene {
        meshes: vec![Arc::new(mesh)],
        materials: vec![Material::default()],
        instances: vec![Instance::new(0, Affine3A::IDENTITY)],
        ..Scene::default()
    })
}

fn tracers(context: &Context, scene: &Arc<Scene>) -> Vec<Box<dyn GpuTracer>> {
    let selection = Selection::default();
    vec![
        Box::new(ComputeBvhTracer::build(context, scene, &selection, &()).unwrap()),
        Box::new(RayQueryTracer::build(context, scene, &selection, &()).unwrap()),
        Box::new(RayQueryBoxTracer::build(context, scene, &selection, &()).unwrap()),
    ]
}

#[test]
fn batches_build_with_every_tracer() {
    let context = Context::noop();
    let scene = triangle();
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    for tracer in tracers(&context, &scene) {
        RayBatch::new(&context, &gpu_scene, &*tracer)
            .unwrap_or_else(|error| panic!("{}: {error}", tracer.name()));
    }
}

#[test]
fn rasterising_passes_build() {
    let context = Context::noop();
    for samples in [1, 4] {
        GBufferPass::new(&context, samples).unwrap();
        let features = Linker::default().feature("multisampled", samples > 1);
        features.link("scene::gbuffer::read").unwrap();
    }
    ShadowMaps::new(&context, &[], &ShadowOptions::default()).unwrap();
    Linker::default().link("scene::shadow::read").unwrap();
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
