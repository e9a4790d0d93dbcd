//! What shaders read of an uploaded scene is what the CPU reads: surfaces, materials, textures, lights, environment.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "a test may fail")]

#[path = "support/compute.rs"]
mod compute;

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use compute::compute;
use glam::{Affine2, Affine3A, Quat, Vec2, Vec3, Vec4};
use isophote_scene::{
    Alpha, ColorSpace, Environment, EnvironmentMap, Filter, Hit, Instance, Light, LightKind,
    Material, Mesh, Scene, SurfaceId, Texture, TextureRef, Wrap,
    gpu::{Context, GpuScene, Linker, ShaderPackage},
    sample::{Sampler, uniform_sphere},
};

const PROBE: ShaderPackage = ShaderPackage {
    name: "probe",
    modules: &[("probe", include_str!("shaders/probe.wesl"))],
};

/// `scene::ray::Hit`, and a level of detail where it has room.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Question {
    direction: Vec3,
    lod: f32,
    uv: Vec2,
    instance: u32,
    primitive: u32,
}

/// What the probe writes, in words of four.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Answer {
    position: Vec3,
    error: f32,
    geometric_normal: Vec3,
    material: u32,
    shading_normal: Vec3,
    unlit: u32,
    uv0: Vec2,
    uv1: Vec2,
    color: Vec4,
    base_color: Vec3,
    metallic: f32,
    emissive: Vec3,
    roughness: f32,
    lifted: Vec3,
    transmission: f32,
    environment: Vec3,
    ior: f32,
    /// Of each light, towards `direction`.
    lights: [Vec4; 3],
    bounds: [Vec4; 2],
}

fn texture(
    width: u32,
    height: u32,
    color_space: ColorSpace,
    wrap: [Wrap; 2],
    filter: Filter,
) -> Arc<Texture> {
    let mut state = width * 1000 + height;
    let texels = (0..width * height)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state.to_le_bytes()
        })
        .collect();
    let mut texture = Texture::new("noise", width, height, texels, color_space);
    texture.wrap = wrap;
    texture.filter = filter;
    Arc::new(texture)
}

/// A bent strip of triangles with everything that a mesh can have, and one with nothing of it.
fn meshes() -> Vec<Arc<Mesh>> {
    let point = |i: u32| Vec3::new(0.3 * (i / 2) as f32, (i % 2) as f32, (0.7 * i as f32).sin());
    let mut full = Mesh {
        positions: (0..12).map(point).collect(),
        normals: (0..12)
            .map(|i| uniform_sphere(Sampler::new(1, 0, i).get_2d(0)))
            .collect(),
        triangles: (0..10).map(|i| [i, i + 1, i + 2]).collect(),
        triangle_materials: (0..10).map(|i| i % 4).collect(),
        ..Mesh::default()
    };
    full.uvs = [2.3, -0.9].map(|scale| {
        full.positions
            .iter()
            .map(|p| scale * Vec2::new(p.x - p.z, p.y))
            .collect()
    });
    full.colors = (0..12)
        .map(|i| Vec4::new(1.0, 0.1 * i as f32 % 1.0, 0.004, 0.5))
        .collect();
    let mut bare = full.clone();
    bare.uvs = Default::default();
    bare.colors.clear();
    vec![Arc::new(bare), Arc::new(full)]
}

fn scene() -> Scene {
    let look = |texture: u32, uv_set: u8| {
        Some(TextureRef {
            texture,
            uv_set,
            transform: Affine2::from_scale_angle_translation(
                Vec2::new(1.2, 0.4),
                0.7,
                Vec2::new(3.1, -2.2),
            ),
        })
    };
    let plain = Material {
        emissive: Vec3::new(1.0, 20.0, 0.3),
        unlit: true,
        ior: 1.33,
        ..Material::diffuse("plain", Vec3::new(0.01, 0.5, 0.9))
    };
    let textured = Material {
        base_color: Vec4::new(0.9, 0.8, 0.7, 0.6),
        base_color_texture: look(0, 0),
        metallic_roughness_texture: look(1, 1),
        emissive: Vec3::splat(5.0),
        emissive_texture: look(2, 0),
        transmission: 0.8,
        transmission_texture: look(3, 1),
        alpha: Alpha::Mask { cutoff: 0.25 },
        ..Material::default()
    };
    let mirrored = Material {
        base_color_texture: look(4, 1),
        emissive: Vec3::ONE,
        emissive_texture: look(0, 1),
        metallic_roughness_texture: look(3, 0),
        ..Material::default()
    };
    let placed = |mesh: u32, scale: Vec3, angle: f32| {
        let turn = Quat::from_axis_angle(Vec3::new(1.0, -2.0, 0.5).normalize(), angle);
        Instance::new(
            mesh,
            Affine3A::from_scale_rotation_translation(scale, turn, Vec3::splat(3.0 * angle)),
        )
    };
    let mut spot = Light::point("spot", Vec3::new(1.0, 2.0, 3.0), Vec3::new(5.0, 6.0, 7.0));
    spot.kind = LightKind::Spot {
        inner: 0.3,
        outer: 1.4,
    };
    spot.transform *= Affine3A::from_rotation_x(-0.8);
    let mut sun = spot.clone();
    sun.kind = LightKind::Directional;
    let texels = (0..8 * 4)
        .map(|i| Vec3::new(i as f32, 0.5, 1000.0 / (1 + i) as f32))
        .collect();
    use Filter::{Linear, Nearest};
    Scene {
        meshes: meshes(),
        materials: vec![plain, textured.clone(), mirrored, textured],
        textures: vec![
            texture(16, 8, ColorSpace::Srgb, [Wrap::Repeat; 2], Linear),
            texture(
                5,
                7,
                ColorSpace::Linear,
                [Wrap::Mirror, Wrap::Clamp],
                Linear,
            ),
            texture(33, 1, ColorSpace::Srgb, [Wrap::Clamp, Wrap::Repeat], Linear),
            texture(1, 1, ColorSpace::Linear, [Wrap::Repeat; 2], Linear),
            texture(9, 4, ColorSpace::Srgb, [Wrap::Mirror; 2], Nearest),
        ],
        instances: vec![
            placed(1, Vec3::ONE, 0.0),
            placed(1, Vec3::new(-2.0, 0.5, 1.5), 0.8),
            placed(0, Vec3::new(1.0, 1.0, 0.1), 2.0),
        ],
        lights: vec![
            Light::point("point", Vec3::NEG_X, Vec3::new(1.0, 2.0, 3.0)),
            spot,
            sun,
        ],
        environment: Environment::Map(EnvironmentMap::new(8, 4, texels).unwrap()),
        ..Scene::default()
    }
}

fn questions(scene: &Scene) -> Vec<Question> {
    (0..3000)
        .map(|index| {
            let sampler = Sampler::new(11, 0, index);
            let instance = index % 3;
            let mesh = scene.mesh(&scene.instances[instance as usize]);
            let [mut u, mut v] = sampler.get_2d(0).to_array();
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            Question {
                direction: uniform_sphere(sampler.get_2d(2)),
                lod: 6.0 * sampler.get_1d(4) - 0.5,
                uv: Vec2::new(u, v),
                instance,
                primitive: (index / 3) % mesh.triangles.len() as u32,
            }
        })
        .collect()
}

fn ask(context: &Context, scene: &GpuScene, questions: &[Question]) -> Vec<Answer> {
    let shader = Linker::default()
        .scene(scene)
        .package(PROBE)
        .link("probe::probe")
        .unwrap();
    let storage = wgpu::BufferUsages::STORAGE;
    let asked = context.buffer("questions", questions, storage).unwrap();
    let answered = vec![Answer::zeroed(); questions.len()];
    let answered = context.buffer("answers", &answered, storage).unwrap();
    let mut encoder = context
        .device()
        .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    compute(
        context,
        &mut encoder,
        (&shader, "probe"),
        &[&asked, &answered],
        &[(2, scene.bind_group_layout(), scene.bind_group())],
        [questions.len().div_ceil(64) as u32, 1],
    );
    context.submit("probe", encoder).unwrap();
    context.read("answers", &answered, questions.len()).unwrap()
}

#[track_caller]
fn near(what: &str, found: Vec4, expected: Vec4, tolerance: f32) {
    let off = (found - expected).abs().max_element();
    let scale = expected.abs().max_element().max(1.0);
    assert!(
        off <= tolerance * scale,
        "{what}: {found} instead of {expected}"
    );
}

fn check(scene: &Scene, question: &Question, answer: &Answer) {
    let hit = Hit {
        t: 1.0,
        uv: question.uv,
        surface: SurfaceId {
            instance: question.instance,
            primitive: question.primitive,
        },
    };
    let point = scene.surface_point(&hit);
    let material = scene.surface_material_at(&point, question.lod);
    let wide = |v: Vec3| v.extend(0.0);
    near(
        "position",
        wide(answer.position),
        wide(point.position),
        1e-6,
    );
    assert!((answer.error / point.error - 1.0).abs() < 1e-3);
    near(
        "geometric normal",
        wide(answer.geometric_normal),
        wide(point.geometric_normal),
        1e-5,
    );
    // Stored normals are rounded to 16 bits.
    near(
        "shading normal",
        wide(answer.shading_normal),
        wide(point.shading_normal),
        2e-3,
    );
    let lifted = point.lifted(question.direction, 0.01);
    near("lifted", wide(answer.lifted), wide(lifted), 1e-5);
    let uvs = |a: Vec2, b: Vec2| Vec4::new(a.x, a.y, b.x, b.y);
    near(
        "uv",
        uvs(answer.uv0, answer.uv1),
        uvs(point.uvs[0], point.uvs[1]),
        1e-6,
    );
    near("color", answer.color, point.color, 1e-4);
    assert_eq!(answer.material, point.material);
    near(
        "base color",
        wide(answer.base_color),
        wide(material.base_color),
        3e-4,
    );
    near(
        "emissive",
        wide(answer.emissive),
        wide(material.emissive),
        3e-4,
    );
    let rest = Vec4::new(
        material.metallic,
        material.roughness,
        material.transmission,
        material.ior,
    );
    let found = Vec4::new(
        answer.metallic,
        answer.roughness,
        answer.transmission,
        answer.ior,
    );
    near("metallic, roughness, transmission, ior", found, rest, 3e-4);
    assert_eq!(answer.unlit == 1, material.unlit);
    // A direction at the edge of a texel may be in the next one by rounding.
    let d = question.direction;
    let row = 4.0 * d.y.acos() / std::f32::consts::PI;
    let column = 8.0 * (0.5 + d.x.atan2(-d.z) / std::f32::consts::TAU);
    if [row, column]
        .iter()
        .all(|at| (at - at.round()).abs() > 1e-3)
    {
        let expected = scene.environment.radiance(d);
        near(
            "environment",
            wide(answer.environment),
            wide(expected),
            1e-6,
        );
    }
    for (light, found) in scene.lights.iter().zip(answer.lights) {
        near(
            &light.name,
            found,
            wide(light.intensity_towards(question.direction)),
            1e-5,
        );
    }
}

#[test]
fn shaders_read_what_the_cpu_reads() {
    if let Some(context) = Context::for_tests() {
        compare(&context, scene(), false);
    }
}

/// A scene that is too large for the device's bindings because of vertices that lie before all others.
#[test]
fn they_read_it_from_textures_too() {
    const MOST: u64 = 700_000;
    let Some(context) = Context::for_tests_within(wgpu::Features::empty(), MOST) else {
        return;
    };
    let mut scene = scene();
    let mesh = Mesh {
        positions: vec![Vec3::ZERO; MOST as usize / 32 + 1],
        normals: vec![Vec3::Z; MOST as usize / 32 + 1],
        ..Mesh::default()
    };
    scene.meshes.insert(0, Arc::new(mesh));
    for instance in &mut scene.instances {
        instance.mesh += 1;
    }
    compare(&context, scene, true);
}

fn compare(context: &Context, mut scene: Scene, in_textures: bool) {
    let mut gpu_scene = GpuScene::new(context, &scene).unwrap();
    assert_eq!(gpu_scene.is_in_textures(), in_textures);
    let questions = questions(&scene);
    let all_near = |scene: &Scene, gpu_scene: &GpuScene| {
        let answers = ask(context, gpu_scene, &questions);
        for (question, answer) in questions.iter().zip(&answers) {
            check(scene, question, answer);
        }
        let bounds = gpu_scene.bounds();
        assert_eq!(
            answers[0].bounds,
            [bounds.min, bounds.max].map(|corner| corner.extend(0.0))
        );
    };
    let before = gpu_scene.bounds();
    all_near(&scene, &gpu_scene);
    for instance in &mut scene.instances {
        instance.transform = Affine3A::from_rotation_y(1.0) * instance.transform;
    }
    scene.lights[1].transform = Affine3A::from_rotation_z(0.3) * scene.lights[1].transform;
    gpu_scene.update(context, &scene).unwrap();
    assert_ne!(gpu_scene.bounds(), before);
    all_near(&scene, &gpu_scene);
    scene.instances.pop();
    assert!(gpu_scene.update(context, &scene).is_err());
}

#[test]
fn an_empty_scene_uploads_and_a_huge_one_is_refused() {
    GpuScene::new(&Context::noop(), &Scene::default()).unwrap();
    // With textures this small, buffers are all there is.
    let context = Context::noop_within(wgpu::Limits {
        max_storage_buffer_binding_size: 1 << 20,
        max_texture_dimension_2d: 4096,
        ..wgpu::Limits::default()
    });
    let mesh = Mesh {
        positions: vec![Vec3::ZERO; 60_000],
        normals: vec![Vec3::Z; 60_000],
        ..Mesh::default()
    };
    let huge = Scene {
        meshes: vec![Arc::new(mesh)],
        ..Scene::default()
    };
    let error = GpuScene::new(&context, &huge).unwrap_err().to_string();
    assert!(
        error.contains("vertices") && error.contains("1920000"),
        "{error}"
    );
}
