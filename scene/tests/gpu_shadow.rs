//! Shadow maps against the CPU's shadow rays.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

#[path = "support/compute.rs"]
mod compute;

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use compute::compute;
use glam::{Affine3A, Quat, UVec2, Vec3, Vec4};
use isophote_scene::{
    BuildTracer, BvhTracer, Image, Instance, Light, LightKind, Material, Mesh, Ray, Scene,
    Selection, Tracer, builtin,
    gpu::{Context, GpuScene, Linker, Rasters, ShaderPackage, ShadowMaps, ShadowOptions},
};

const PACKAGE: ShaderPackage = ShaderPackage {
    name: "test_shadow",
    modules: &[("ask", ASK)],
};

const ASK: &str = "
import scene::scene_data::scene_info;
import scene::shadow::read::shadow;

struct Point {
    position: vec3f,
    light: u32,
    normal: vec3f,
    answer: f32,
}

@group(0) @binding(0) var<storage, read_write> points: array<Point>;

@compute @workgroup_size(64)
fn ask(@builtin(global_invocation_id) id: vec3u) {
    if id.x < arrayLength(&points) && points[id.x].light < scene_info.light_count {
        points[id.x].answer = shadow(points[id.x].light, points[id.x].position, points[id.x].normal);
    }
}
";

/// A question, and its answer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Point {
    position: Vec3,
    light: u32,
    normal: Vec3,
    answer: f32,
}

fn light(kind: LightKind, eye: Vec3, target: Vec3) -> Light {
    let turn = Quat::from_rotation_arc(Vec3::NEG_Z, (target - eye).normalize());
    Light {
        kind,
        transform: Affine3A::from_rotation_translation(turn, eye),
        ..Light::point("", eye, Vec3::ONE)
    }
}

const POINT: LightKind = LightKind::Point { radius: 0.0 };
const SPOT: LightKind = LightKind::Spot {
    inner: 0.3,
    outer: 0.9,
};

/// Fills the maps and answers all points.
fn ask(context: &Context, scene: &Scene, options: &ShadowOptions, points: &mut [Point]) {
    let gpu_scene = GpuScene::new(context, scene).unwrap();
    let maps = ShadowMaps::new(context, &scene.lights, options).unwrap();
    let rasters = Rasters::new(context, None, Some(&maps)).unwrap();
    let buffer = context
        .buffer("points", points, wgpu::BufferUsages::STORAGE)
        .unwrap();
    let shader = Linker::default()
        .scene(&gpu_scene)
        .package(PACKAGE)
        .link("test_shadow::ask")
        .unwrap();
    let mut encoder = context
        .device()
        .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    maps.record(context, &mut encoder, &gpu_scene, &scene.lights, None)
        .unwrap();
    compute(
        context,
        &mut encoder,
        (&shader, "ask"),
        &[&buffer],
        &[
            (2, gpu_scene.bind_group_layout(), gpu_scene.bind_group()),
            (3, rasters.bind_group_layout(), rasters.bind_group()),
        ],
        [(points.len() as u32).div_ceil(64), 1],
    );
    context.submit("shadows", encoder).unwrap();
    points.copy_from_slice(&context.read("points", &buffer, points.len()).unwrap());
}

/// Whether light arrives, by a ray; at a position with a normal and how far it is to be lifted.
fn lit(tracer: &BvhTracer, light: &Light, at: Vec3, normal: Vec3, lift: f32) -> bool {
    let origin = at + lift * normal;
    let offset = match light.kind {
        LightKind::Directional => -1e4 * light.direction(),
        _ => light.position() - origin,
    };
    let (distance, direction) = (offset.length(), offset.normalize());
    normal.dot(direction) > 0.0
        && !tracer.any_hit(&Ray::new(origin, direction).until(distance * (1.0 - 1e-5)))
}

const SIZE: [u32; 2] = [128, 96];

fn check_built_in(name: &str, lights: Vec<Light>) {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let mut scene = builtin::build(name).unwrap();
    scene.lights = lights;
    let scene = Arc::new(scene);
    let tracer = BvhTracer::build(&scene, &Selection::default(), &Default::default()).unwrap();
    let [width, height] = SIZE;
    let camera = &scene.cameras[0];
    let mut points = Vec::new();
    let mut expected = Vec::new();
    let hits: Vec<_> = (0..width * height)
        .map(|pixel| {
            let at = UVec2::new(pixel % width, pixel / width).as_vec2() + 0.5;
            let ray = camera.ray(at, width, height);
            let hit = tracer.closest_hit(&ray)?;
            let point = scene.surface_point(&hit);
            let front = point.geometric_normal.dot(ray.direction) < 0.0;
            let normal = if front { 1.0 } else { -1.0 } * point.geometric_normal;
            Some((point, normal, hit.t))
        })
        .collect();
    for (index, light) in (0..).zip(&scene.lights) {
        for hit in &hits {
            let (position, normal, answer) = match hit {
                Some((point, normal, _)) => {
                    let lit = lit(&tracer, light, point.position, *normal, point.error);
                    (point.position, *normal, lit)
                }
                None => (Vec3::ZERO, Vec3::ZERO, false),
            };
            expected.push(answer);
            points.push(Point {
                position,
                light: index,
                normal,
                answer: -1.0,
            });
        }
    }
    ask(&context, &scene, &ShadowOptions::default(), &mut points);
    picture(name, &points, &expected);
    let count = hits.len();
    for (index, light) in scene.lights.iter().enumerate() {
        let (points, expected) = (&points[index * count..], &expected[index * count..]);
        let (mut inside, mut agree, mut lit) = (0, 0, 0);
        for pixel in 0..count {
            let Some((own, normal, distance)) = &hits[pixel] else {
                continue;
            };
            // No edge of a shadow, and none of what is seen.
            let (x, y) = (pixel as u32 % width, pixel as u32 / width);
            let same = (y.saturating_sub(1)..(y + 2).min(height)).all(|v| {
                (x.saturating_sub(1)..(x + 2).min(width)).all(|u| {
                    let other = (v * width + u) as usize;
                    let close = hits[other].as_ref().is_some_and(|(point, towards, away)| {
                        point.surface.instance == own.surface.instance
                            && towards.dot(*normal) > 0.866
                            && (away - distance).abs() < 0.05 * distance
                    });
                    close && expected[other] == expected[pixel]
                })
            });
            // Outside a spot's cone there is nothing to cast a shadow.
            let away = own.position - light.position();
            let shone_at = light.intensity_towards(away.normalize()).x > 0.0;
            if same && shone_at {
                inside += 1;
                lit += usize::from(expected[pixel]);
                let answer = points[pixel].answer;
                agree += usize::from((answer - f32::from(u8::from(expected[pixel]))).abs() < 0.5);
            }
        }
        let share = agree as f64 / inside as f64;
        println!(
            "{name}, {:?}: {share} of {inside} pixels without edges agree, {lit} of them lit",
            light.kind
        );
        assert!(inside > count / 8, "{name}: {inside}");
        assert!(lit > inside / 50, "{name}: {lit} of {inside}");
        assert!(share >= 0.99, "{name}, {:?}: {share}", light.kind);
    }
}

fn picture(name: &str, points: &[Point], expected: &[bool]) {
    let Some(folder) = std::env::var_os("ISOPHOTE_TEST_PICTURES") else {
        return;
    };
    let [width, height] = SIZE;
    let lights = points.len() as u32 / (width * height);
    let mut values = Vec::new();
    for row in 0..2 * height {
        for column in 0..lights * width {
            let (light, x) = (column / width, column % width);
            let pixel = ((light * height + row % height) * width + x) as usize;
            values.push(Vec3::splat(if row < height {
                f32::from(u8::from(expected[pixel]))
            } else {
                points[pixel].answer
            }));
        }
    }
    let mut image = Image::new(lights * width, 2 * height);
    image.push_layer("", "RGB", &values);
    let path = std::path::Path::new(&folder).join(format!("shadow_{name}.png"));
    image.save(path).unwrap();
}

#[test]
fn cornell_agrees() {
    let scene = builtin::build("cornell").unwrap();
    let bounds = scene.bounds();
    let at = |x: f32, y: f32, z: f32| bounds.min + Vec3::new(x, y, z) * (bounds.max - bounds.min);
    check_built_in(
        "cornell",
        vec![
            light(POINT, at(0.3, 0.8, 0.6), at(0.5, 0.0, 0.5)),
            light(SPOT, at(0.7, 0.95, 0.7), at(0.4, 0.1, 0.4)),
            // Through the open front, where the camera is.
            light(
                LightKind::Directional,
                scene.cameras[0].position() + Vec3::new(0.3, 0.5, 0.0),
                bounds.center(),
            ),
        ],
    );
}

#[test]
fn the_office_agrees() {
    let scene = builtin::build("office").unwrap();
    let bounds = scene.bounds();
    let at = |x: f32, y: f32, z: f32| bounds.min + Vec3::new(x, y, z) * (bounds.max - bounds.min);
    check_built_in(
        "office",
        vec![
            light(POINT, at(0.45, 0.8, 0.55), at(0.5, 0.0, 0.5)),
            light(SPOT, at(0.7, 0.85, 0.3), at(0.4, 0.1, 0.6)),
        ],
    );
}

/// A grid of squares.
fn plane(origin: Vec3, u: Vec3, v: Vec3, squares: u32) -> Mesh {
    let normal = u.cross(v).normalize();
    let at = |i: u32| {
        let (x, y) = (i % (squares + 1), i / (squares + 1));
        origin + (x as f32 * u + y as f32 * v) / squares as f32
    };
    let positions: Vec<Vec3> = (0..(squares + 1) * (squares + 1)).map(at).collect();
    let triangles: Vec<[u32; 3]> = (0..squares * squares)
        .map(|square| square / squares * (squares + 1) + square % squares)
        .flat_map(|a| {
            let b = a + squares + 1;
            [[a, a + 1, b + 1], [a, b + 1, b]]
        })
        .collect();
    Mesh {
        normals: vec![normal; positions.len()],
        triangle_materials: vec![0; triangles.len()],
        positions,
        triangles,
        ..Mesh::default()
    }
}

fn scene_of(meshes: Vec<Mesh>, lights: Vec<Light>) -> Scene {
    Scene {
        instances: (0..meshes.len() as u32)
            .map(|mesh| Instance::new(mesh, Affine3A::IDENTITY))
            .collect(),
        meshes: meshes.into_iter().map(Arc::new).collect(),
        materials: vec![Material::diffuse("", Vec3::ONE)],
        lights,
        ..Scene::default()
    }
}

/// From nearly overhead to nearly along the plane.
fn lights_around(target: Vec3, distance: f32) -> Vec<Light> {
    let mut lights = Vec::new();
    for step in 0..8 {
        let elevation = [89.0_f32, 70.0, 45.0, 25.0, 12.0, 6.0, 3.0, 1.5][step].to_radians();
        let azimuth = 0.7 + step as f32;
        let toward = Vec3::new(
            elevation.cos() * azimuth.cos(),
            elevation.sin(),
            elevation.cos() * azimuth.sin(),
        );
        for kind in [POINT, SPOT, LightKind::Directional] {
            lights.push(light(kind, target + distance * toward, target));
        }
    }
    lights
}

#[test]
fn a_lit_plane_does_not_shade_itself() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let target = Vec3::new(20.0, 3.0, -7.0);
    let (u, v) = (8.0 * Vec3::Z, 8.0 * Vec3::X);
    let mesh = plane(target - 0.5 * (u + v), u, v, 5);
    let scene = scene_of(vec![mesh], lights_around(target, 6.0));
    let mut points = Vec::new();
    for light in 0..scene.lights.len() as u32 {
        for i in 0..1024 {
            let (x, y) = ((i % 32) as f32 / 32.0, (i / 32) as f32 / 32.0);
            points.push(Point {
                position: target + (x - 0.49) * u + (y - 0.49) * v,
                light,
                normal: Vec3::Y,
                answer: -1.0,
            });
        }
    }
    let options = ShadowOptions {
        resolution: 256,
        ..ShadowOptions::default()
    };
    ask(&context, &scene, &options, &mut points);
    let dark: Vec<&Point> = points.iter().filter(|point| point.answer != 1.0).collect();
    for point in dark.iter().take(5) {
        println!("{point:?} {:?}", scene.lights[point.light as usize]);
    }
    assert!(dark.is_empty(), "{} of {}", dark.len(), points.len());
}

#[test]
fn a_closed_wall_lets_nothing_through() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    // A room of six walls without thickness.
    let (low, high) = (Vec3::new(-2.0, 0.0, -3.0), Vec3::new(3.0, 2.5, 1.0));
    let size = high - low;
    let sides: Vec<[Vec3; 3]> = (0..3)
        .flat_map(|axis| {
            let unit = |axis: usize| Vec3::AXES[axis % 3] * size;
            let (u, v) = (unit(axis + 1), unit(axis + 2));
            [[low, u, v], [low + unit(axis), u, v]]
        })
        .collect();
    let meshes = sides.iter().map(|&[at, u, v]| plane(at, u, v, 3)).collect();
    let center = 0.5 * (low + high);
    let scene = scene_of(meshes, lights_around(center, 8.0));
    let options = ShadowOptions {
        resolution: 256,
        ..ShadowOptions::default()
    };
    let mut points = Vec::new();
    // At the very edges of the room filtering reaches around the corner: texels are up to 8 cm here.
    let places = |edge: f32| (0..24).map(move |i| edge + (1.0 - 2.0 * edge) * i as f32 / 23.0);
    for light in 0..scene.lights.len() as u32 {
        for &[at, u, v] in &sides {
            let normal = u.cross(v).normalize();
            let inward = if normal.dot(center - at) > 0.0 {
                normal
            } else {
                -normal
            };
            for x in places(0.25 / u.length()) {
                for y in places(0.25 / v.length()) {
                    points.push(Point {
                        position: at + x * u + y * v,
                        light,
                        normal: inward,
                        answer: -1.0,
                    });
                }
            }
        }
    }
    ask(&context, &scene, &options, &mut points);
    let lit: Vec<&Point> = points.iter().filter(|point| point.answer != 0.0).collect();
    for point in lit.iter().take(5) {
        println!("{point:?} {:?}", scene.lights[point.light as usize]);
    }
    assert!(lit.is_empty(), "{} of {}", lit.len(), points.len());
}

#[test]
fn masked_triangles_let_light_through() {
    // With bindings of 256 bytes the scene is read from textures.
    for binding_size in [u64::MAX, 256] {
        let features = wgpu::Features::empty();
        if let Some(context) = Context::for_tests_within(features, binding_size) {
            a_masked_screen(&context);
        }
    }
}

fn a_masked_screen(context: &Context) {
    let floor = plane(Vec3::ZERO, 4.0 * Vec3::Z, 4.0 * Vec3::X, 1);
    let mut screen = plane(Vec3::new(1.0, 1.0, 1.0), 2.0 * Vec3::Z, 2.0 * Vec3::X, 1);
    screen.triangle_materials = vec![1; 2];
    // Opaque along one edge, transparent along the other.
    screen.colors = screen
        .positions
        .iter()
        .map(|at| Vec4::new(1.0, 1.0, 1.0, 0.5 * (at.x - 1.0)))
        .collect();
    let down = light(
        LightKind::Directional,
        Vec3::new(2.0, 5.0, 2.0),
        Vec3::new(2.0, 0.0, 2.0),
    );
    let mut scene = scene_of(vec![floor, screen], vec![down]);
    scene.materials.push(Material {
        alpha: isophote_scene::Alpha::Mask { cutoff: 0.5 },
        ..Material::default()
    });
    let at = |x: f32| Point {
        position: Vec3::new(x, 0.0, 2.0),
        light: 0,
        normal: Vec3::Y,
        answer: -1.0,
    };
    let mut points = [0.5, 1.5, 2.5, 3.5].map(at);
    ask(context, &scene, &ShadowOptions::default(), &mut points);
    assert_eq!(points.map(|point| point.answer), [1.0, 1.0, 0.0, 1.0]);
}
