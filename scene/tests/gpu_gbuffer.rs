//! The G-buffer against the CPU's primary rays.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

#[path = "support/seen.rs"]
mod seen;

use std::{path::Path, sync::Arc};

use glam::{Affine3A, DVec2, Quat, UVec2, Vec2, Vec3, Vec4};
use isophote_scene::{
    Alpha, BuildTracer, BvhTracer, Camera, Image, Instance, InstanceMask, Projection, Scene,
    Selection, builtin,
    gpu::{Context, GBuffer, GBufferPass, GBufferViews, GpuScene},
    reference::{Layers, Normals},
};
use seen::{Seen, see};

const SIZE: [u32; 2] = [128, 96];

/// Pixels whose neighbours differ by more than 5 % in depth or 30 degrees in normal.
fn silhouettes(layers: &Layers, [width, height]: [u32; 2]) -> Vec<bool> {
    let differs = |a: usize, b: usize| {
        let (near, far) = (
            layers.depth[a].min(layers.depth[b]),
            layers.depth[a].max(layers.depth[b]),
        );
        far > 1.05 * near || layers.normal[a].dot(layers.normal[b]) < 30_f32.to_radians().cos()
    };
    let at = |x: u32, y: u32| (y * width + x) as usize;
    (0..width * height)
        .map(|pixel| {
            let (x, y) = (pixel % width, pixel / width);
            (y.saturating_sub(1)..(y + 2).min(height)).any(|v| {
                (x.saturating_sub(1)..(x + 2).min(width)).any(|u| {
                    let (own, other) = (at(x, y), at(u, v));
                    own != other
                        && layers.depth[own].is_finite() | layers.depth[other].is_finite()
                        && differs(own, other)
                })
            })
        })
        .collect()
}

/// Shares of pixels.
#[derive(Debug, Default)]
struct Parity {
    /// That agree in depth and normal.
    agree: f64,
    /// That do not and are no silhouettes.
    wrong_inside: usize,
    /// The same, but with the edge of a triangle within a 256th of a pixel.
    at_edges: usize,
    silhouettes: f64,
    /// Of those that agree.
    worst_depth: f32,
    worst_normal: f32,
    worst_position: f32,
    /// That agree, but not in the triangle or in albedo.
    other_triangle: f64,
    other_albedo: f64,
}

fn tracer(scene: &Arc<Scene>) -> BvhTracer {
    let everything = Selection {
        mask: InstanceMask::NONE,
        bounds: None,
    };
    BvhTracer::build(scene, &everything, &Default::default()).unwrap()
}

/// Whether the edge of a triangle is within a 256th of a pixel from a pixel's centre. To this fraction rasterisers round
/// where corners are, so that they may see either side.
fn is_at_an_edge(
    scene: &Scene,
    camera: &Camera,
    ids: [u32; 2],
    pixel: u32,
    size: [u32; 2],
) -> bool {
    let [instance, primitive] = ids;
    let Some(instance) = scene.instances.get(instance as usize) else {
        return false;
    };
    let center = DVec2::new((pixel % size[0]).into(), (pixel / size[0]).into()) + 0.5;
    let project = |corner: Vec3| {
        // By the rays of three corners of the picture.
        let ray = |x: f32, y: f32| camera.ray(Vec2::new(x, y), size[0], size[1]);
        let end = UVec2::from(size).as_vec2();
        let [o, x, y] = [ray(0.0, 0.0), ray(end.x, 0.0), ray(0.0, end.y)];
        let forward = -Vec3::from(camera.transform.matrix3.z_axis).as_dvec3();
        let at_one = |ray: &isophote_scene::Ray| {
            let direction = ray.direction.as_dvec3();
            direction / direction.dot(forward)
        };
        let offset = corner.as_dvec3() - o.origin.as_dvec3();
        let offset = offset / offset.dot(forward) - at_one(&o);
        let [u, v] = [at_one(&x) - at_one(&o), at_one(&y) - at_one(&o)];
        DVec2::new(offset.dot(u) / u.dot(u), offset.dot(v) / v.dot(v)) * end.as_dvec2()
    };
    let corners = scene
        .mesh(instance)
        .corners(primitive as usize)
        .map(|corner| project(instance.transform.transform_point3(corner)));
    (0..3).any(|edge| {
        let (p, q) = (corners[edge], corners[(edge + 1) % 3]);
        let along = ((center - p).dot(q - p) / (q - p).length_squared()).clamp(0.0, 1.0);
        (p + along * (q - p) - center).length() <= 1.0 / 256.0
    })
}

fn compare(
    layers: &Layers,
    seen: &[Seen],
    size: [u32; 2],
    is_at_an_edge: impl Fn([u32; 2], u32) -> bool,
) -> Parity {
    let silhouettes = silhouettes(layers, size);
    let mut parity = Parity::default();
    let share = 1.0 / seen.len() as f64;
    for (pixel, seen) in seen.iter().enumerate() {
        parity.silhouettes += share * f64::from(u8::from(silhouettes[pixel]));
        let (depth, normal) = (layers.depth[pixel], layers.normal[pixel]);
        let nothing = seen.depth == 0.0 && seen.normal == Vec3::ZERO && seen.instance == u32::MAX;
        let off = (seen.depth - depth).abs() / depth;
        let angle = normal.angle_between(seen.normal).to_degrees();
        let agrees = if depth.is_finite() {
            off < 1e-4 && angle < 1.0
        } else {
            nothing
        };
        if !agrees {
            if silhouettes[pixel] {
                continue;
            }
            let truth = [
                layers.instance[pixel] as u32,
                layers.primitive[pixel] as u32,
            ];
            let edge = |ids| is_at_an_edge(ids, pixel as u32);
            if edge([seen.instance, seen.primitive]) || edge(truth) {
                parity.at_edges += 1;
                continue;
            }
            parity.wrong_inside += 1;
            if parity.wrong_inside < 5 {
                println!(
                    "pixel {} {}: {depth} {normal} {} {}, but {seen:?}",
                    pixel as u32 % size[0],
                    pixel as u32 / size[0],
                    layers.instance[pixel],
                    layers.primitive[pixel]
                );
            }
            continue;
        }
        parity.agree += share;
        if !depth.is_finite() {
            continue;
        }
        parity.worst_depth = parity.worst_depth.max(off);
        parity.worst_normal = parity.worst_normal.max(angle);
        let moved = (seen.position - layers.position[pixel]).length() / depth;
        parity.worst_position = parity.worst_position.max(moved);
        let same = seen.instance as f32 == layers.instance[pixel]
            && seen.primitive as f32 == layers.primitive[pixel];
        parity.other_triangle += share * f64::from(u8::from(!same));
        let other = (seen.albedo - layers.albedo[pixel]).abs().max_element() > 2e-3;
        parity.other_albedo += share * f64::from(u8::from(other));
    }
    parity
}

fn picture(name: &str, layers: &Layers, seen: &[Seen], size: [u32; 2]) {
    let Some(folder) = std::env::var_os("ISOPHOTE_TEST_PICTURES") else {
        return;
    };
    let [width, height] = size;
    let far = layers
        .depth
        .iter()
        .copied()
        .filter(|depth| depth.is_finite())
        .fold(0.0, f32::max);
    let ids = |instance: f32, primitive: f32| {
        let hash = |x: f32, k: f32| (x * k).sin().abs();
        Vec3::new(
            hash(instance, 12.9),
            hash(primitive, 78.2),
            hash(primitive, 3.7),
        )
    };
    let cpu = |pixel: usize| {
        [
            Vec3::splat(layers.depth[pixel] / far),
            0.5 * layers.normal[pixel] + 0.5,
            layers.albedo[pixel],
            ids(layers.instance[pixel], layers.primitive[pixel]),
        ]
    };
    let gpu = |pixel: usize| {
        let seen = seen[pixel];
        [
            Vec3::splat(if seen.depth > 0.0 {
                seen.depth / far
            } else {
                f32::INFINITY
            }),
            0.5 * seen.normal + 0.5,
            seen.albedo,
            ids(seen.instance as i32 as f32, seen.primitive as i32 as f32),
        ]
    };
    let mut values = Vec::new();
    for row in 0..2 * height {
        let (upper, y) = (row < height, row % height);
        for layer in 0..4 {
            for x in 0..width {
                let pixel = (y * width + x) as usize;
                values.push(if upper { cpu(pixel) } else { gpu(pixel) }[layer]);
            }
        }
    }
    let mut image = Image::new(4 * width, 2 * height);
    image.push_layer("", "RGB", &values);
    image
        .save(Path::new(&folder).join(format!("gbuffer_{name}.png")))
        .unwrap();
}

fn check(name: &str, scene: &Arc<Scene>, camera: &Camera) {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let tracer = tracer(scene);
    let layers = Layers::of(scene, &tracer, camera, SIZE, Normals::Smooth);
    let gpu_scene = GpuScene::new(&context, scene).unwrap();
    let seen = see(&context, &gpu_scene, camera, SIZE, 1);
    picture(name, &layers, &seen, SIZE);
    let parity = compare(&layers, &seen, SIZE, |ids, pixel| {
        is_at_an_edge(scene, camera, ids, pixel, SIZE)
    });
    println!("{name}: {parity:?}");
    assert!(parity.agree >= 0.995, "{name}: {parity:?}");
    assert_eq!(parity.wrong_inside, 0, "{name}: {parity:?}");
    assert!(parity.at_edges <= seen.len() / 1000, "{name}: {parity:?}");
    assert!(parity.other_triangle < 5e-3, "{name}: {parity:?}");
    assert!(parity.other_albedo < 5e-3, "{name}: {parity:?}");
    assert!(parity.worst_position < 2e-4, "{name}: {parity:?}");
}

#[test]
fn built_in_scenes_agree() {
    for name in ["cornell", "office", "corner:17"] {
        let scene = Arc::new(builtin::build(name).unwrap());
        check(name, &scene, &scene.cameras[0]);
    }
}

#[test]
fn a_textured_scene_agrees() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../shared/scenes/sponza_crytek_partial.glb"
    );
    if !Path::new(path).exists() {
        eprintln!("SKIPPED sponza_crytek_partial: there is no ../shared");
        return;
    }
    let scene = Arc::new(isophote_scene::load(Path::new(path)).unwrap());
    check("sponza", &scene, &scene.cameras[0]);
}

/// Instances of one mesh next to each other, mirrored and stretched ones, holes, back faces, vertex colours.
fn features() -> Arc<Scene> {
    let mut scene = builtin::build("office").unwrap();
    let small = scene.bounds();
    let room = scene.instances.clone();
    scene.instances.clear();
    // Turned inside out: the camera sees back faces.
    for (index, place) in room.into_iter().enumerate() {
        let at = small.center();
        let flip = [
            Vec3::new(-1.0, 1.0, 1.0),
            Vec3::new(1.0, 1.0, -1.2),
            Vec3::ONE,
        ][index % 3];
        // A little apart, so that no two surfaces coincide.
        let at = at + 1e-3 * index as f32;
        let turned =
            Affine3A::from_scale_rotation_translation(flip, Quat::from_rotation_y(0.2), at)
                * Affine3A::from_translation(-small.center());
        scene.instances.push(Instance {
            transform: turned * place.transform,
            ..place
        });
    }
    for mesh in &mut scene.meshes {
        let mesh = Arc::make_mut(mesh);
        if mesh.triangles.len() % 2 == 0 {
            let colors = mesh.positions.iter().map(|at| {
                let wave = (12.0 * *at).map(f32::sin).element_sum();
                Vec4::new(1.0, 0.5, 0.25, 0.5 + 0.15 * wave)
            });
            mesh.colors = colors.collect();
        }
    }
    for material in &mut scene.materials {
        material.alpha = Alpha::Mask { cutoff: 0.4713 };
    }
    Arc::new(scene)
}

#[test]
fn instances_masks_and_both_projections_agree() {
    let scene = features();
    check("features", &scene, &scene.cameras[0]);
    let above = Camera {
        projection: Projection::Orthographic {
            half_height: 0.3 * scene.bounds().diagonal(),
        },
        ..Camera::framing(&scene.bounds())
    };
    check("orthographic", &scene, &above);
}

#[test]
fn a_scene_in_textures_looks_the_same() {
    let scene = features();
    let seen = [u64::MAX, 1 << 16].map(|binding_size| {
        let context = Context::for_tests_within(wgpu::Features::empty(), binding_size)?;
        let gpu_scene = GpuScene::new(&context, &scene).unwrap();
        assert_eq!(gpu_scene.is_in_textures(), binding_size < u64::MAX);
        Some(see(&context, &gpu_scene, &scene.cameras[0], [16, 12], 4))
    });
    if let [Some(usual), Some(in_textures)] = seen {
        let [usual, in_textures]: [&[u8]; 2] =
            [&usual, &in_textures].map(|seen| bytemuck::cast_slice(seen));
        assert!(usual == in_textures);
    }
}

#[test]
fn four_samples_see_what_a_finer_picture_sees() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let scene = Arc::new(builtin::build("office").unwrap());
    let camera = &scene.cameras[0];
    let [width, height] = SIZE;
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let one = see(&context, &gpu_scene, camera, SIZE, 1);
    let four = see(&context, &gpu_scene, camera, SIZE, 4);
    let (mut several, mut same) = (0, 0);
    for (pixel, samples) in four.chunks_exact(4).enumerate() {
        // Every triangle's shares add up to the pixel.
        assert_eq!(samples.iter().map(|seen| seen.alike).sum::<u32>(), 4);
        for (index, seen) in samples.iter().enumerate() {
            // Shaded once: samples of one triangle hold one value.
            let first = samples[..index]
                .iter()
                .find(|other| (other.instance, other.primitive) == (seen.instance, seen.primitive));
            if let Some(first) = first {
                assert_eq!(first.depth, seen.depth);
                assert_eq!(first.normal, seen.normal);
            }
            if seen.depth > 0.0 {
                // On its triangle, and within the pixel.
                let mesh = scene.mesh(&scene.instances[seen.instance as usize]);
                let transform = scene.instances[seen.instance as usize].transform;
                let [a, b, c] = mesh
                    .corners(seen.primitive as usize)
                    .map(|corner| transform.transform_point3(corner));
                let normal = isophote_scene::unit_normal(a, b, c);
                let off = normal.dot(seen.position - a).abs() / seen.depth;
                let grazing = normal
                    .dot((seen.position - camera.position()).normalize())
                    .abs();
                assert!(off < 1e-4 || grazing < 0.02, "{off} {grazing} {seen:?}");
                assert!(seen.normal.is_normalized() || (seen.normal.length() - 1.0).abs() < 2e-3);
            }
        }
        let triangles = samples.iter().filter(|seen| seen.alike > 0).count();
        several += usize::from(triangles > 1);
        if triangles == 1 && samples[0].primitive == one[pixel].primitive {
            same += 1;
            assert!((samples[0].depth - one[pixel].depth).abs() <= 1e-5 * one[pixel].depth);
        }
    }
    println!(
        "{several} pixels see several triangles, {same} see one, of {}",
        one.len()
    );
    assert!(several > one.len() / 100);
    assert!(same > one.len() / 2);
    // How much of each row the nearer half takes, against 4 x 4 pixels for one: four samples err less than one.
    let fine = see(&context, &gpu_scene, camera, [4 * width, 4 * height], 1);
    let error = |seen: &[Seen], samples: usize| {
        let coverage = |seen: &[Seen], of: u32| {
            let part = seen.iter().filter(|seen| seen.instance == of).count();
            part as f64 / seen.len() as f64
        };
        let mut error = 0.0;
        for pixel in 0..(width * height) as usize {
            let (x, y) = (pixel % width as usize, pixel / width as usize);
            let fine: Vec<Seen> = (0..16)
                .map(|i| fine[(4 * y + i / 4) * 4 * width as usize + 4 * x + i % 4])
                .collect();
            let of = fine[5].instance;
            let coarse = &seen[samples * pixel..samples * (pixel + 1)];
            error += (coverage(coarse, of) - coverage(&fine, of)).powi(2);
        }
        (error / f64::from(width * height)).sqrt()
    };
    let errors = [error(&one, 1), error(&four, 4)];
    println!(
        "error of coverage with one sample {}, with four {}",
        errors[0], errors[1]
    );
    assert!(errors[1] < 0.6 * errors[0], "{errors:?}");
}

#[test]
fn another_renderers_textures_are_taken_or_refused() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let scene = builtin::build("cornell").unwrap();
    let camera = &scene.cameras[0];
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let gbuffer = GBuffer::new(&context, SIZE, 1).unwrap();
    let pass = GBufferPass::new(&context, 1).unwrap();
    let device = context.device();
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    pass.record(&context, &mut encoder, &gpu_scene, camera, &gbuffer, None)
        .unwrap();
    context.submit("G-buffer", encoder).unwrap();
    let views = gbuffer.views().clone();
    let theirs = GBuffer::from_views(&context, views.clone(), camera).unwrap();
    let (own, taken) = (
        seen::read(&context, &gbuffer),
        seen::read(&context, &theirs),
    );
    assert!(own.iter().any(|seen| seen.depth > 0.0));
    assert_eq!(
        bytemuck::cast_slice::<_, u8>(&own),
        bytemuck::cast_slice::<_, u8>(&taken)
    );

    let other = |size: [u32; 2], format| {
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d {
                width: size[0],
                height: size[1],
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        texture.create_view(&wgpu::TextureViewDescriptor::default())
    };
    // A renderer that has no ids: they are unknown.
    let without = GBufferViews {
        ids: other([1, 1], wgpu::TextureFormat::Rgba16Uint),
        albedo: other(SIZE, wgpu::TextureFormat::Rgba8UnormSrgb),
        ..views.clone()
    };
    let without = GBuffer::from_views(&context, without, camera).unwrap();
    let seen = seen::read(&context, &without);
    assert!(
        seen.iter()
            .all(|seen| seen.instance == u32::MAX && seen.albedo == Vec3::ZERO)
    );
    assert!(
        seen.iter()
            .zip(&own)
            .all(|(seen, own)| seen.position == own.position)
    );

    let small = GBufferViews {
        normal: other([7, 7], wgpu::TextureFormat::Rgba16Float),
        ..views.clone()
    };
    let integers = GBufferViews {
        albedo: other(SIZE, wgpu::TextureFormat::Rgba16Uint),
        ..views
    };
    for wrong in [small, integers] {
        let error = GBuffer::from_views(&context, wrong, camera).unwrap_err();
        assert!(
            error.to_string().contains("a layer of the G-buffer"),
            "{error}"
        );
    }
}

#[test]
fn sizes_are_checked() {
    let context = Context::noop();
    for (size, samples) in [([0, 4], 1), ([4, 4], 2), ([100_000, 1], 1)] {
        let error = GBuffer::new(&context, size, samples).unwrap_err();
        println!("{error}");
    }
}
