//! The GPU's answers beside the CPU's.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests")]

mod support;

use std::sync::Arc;

use glam::{Affine3A, Quat, Vec3, Vec3Swizzles};
use isophote_displacement_field::{
    Directions, FieldParams, FieldTracer, LookUp, Object, Positions, Storage, Together,
    gpu::FieldGpuTracer,
};
use isophote_scene::{
    Camera, Hit, Instance, InstanceMask, Material, Ray, Scene, Selection, Tracer,
    gpu::{self, BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, GpuTracer, RayBatch},
    reference::{Quantity, Settings, Tracers, render},
    sample::{Sampler, uniform_sphere},
};

/// Tori and balls, and a floor of two triangles under them.
fn scene(count: usize) -> Arc<Scene> {
    let floor = [Vec3::ZERO, Vec3::X, Vec3::Z, Vec3::X + Vec3::Z]
        .map(|corner| 40.0 * (corner - 0.5 * (Vec3::X + Vec3::Z)) - Vec3::Y);
    let [a, b, c, d] = floor;
    let meshes = vec![
        support::torus("torus", 32, 16, 0.45),
        support::torus("ring", 24, 12, 0.2),
        support::mesh(&[[a, b, c], [b, d, c]]),
    ];
    let mut instances: Vec<Instance> = (0..count)
        .map(|index| Instance::new(index as u32 % 2, place(index, 0.0)))
        .collect();
    instances.push(Instance::new(2, Affine3A::IDENTITY));
    Arc::new(Scene {
        meshes,
        materials: vec![Material::diffuse("", Vec3::ONE)],
        instances,
        ..Scene::default()
    })
}

fn place(index: usize, time: f32) -> Affine3A {
    let sampler = Sampler::new(4, 0, index as u32);
    let (a, b) = (sampler.get_2d(0), sampler.get_2d(1));
    let turn = Quat::from_axis_angle(Vec3::new(a.x, a.y, b.x).normalize(), 6.0 * b.y + time);
    let at = Vec3::new(a.x - 0.5, 0.2 * b.x, a.y - 0.5) * 20.0 + time * Vec3::Y;
    Affine3A::from_scale_rotation_translation(Vec3::splat(0.5 + b.x), turn, at)
}

/// The scene of which only instances of many or of few triangles cast.
fn part(scene: &Scene, many: bool) -> Arc<Scene> {
    let mut part = scene.clone();
    for instance in &mut part.instances {
        if (instance.mesh < 2) != many {
            instance.mask = InstanceMask::NONE;
        }
    }
    Arc::new(part)
}

fn fields(scene: &Arc<Scene>, params: &FieldParams, look_up: LookUp) -> FieldTracer {
    let object = |mesh: usize| Object::new(support::field(&scene.meshes[mesh], params));
    // A second kind.
    let other = object(1).with_distant();
    let objects = vec![object(0), other, Object::default()];
    let scene = part(scene, true);
    FieldTracer::new(&scene, &Selection::default(), objects, look_up).unwrap()
}

fn rays(count: u32) -> Vec<Ray> {
    (0..count)
        .map(|index| {
            let sampler = Sampler::new(11, 0, index);
            let at =
                (sampler.get_2d(0).extend(sampler.get_1d(1)) - 0.5) * Vec3::new(24.0, 24.0, 8.0);
            let ray = Ray::new(at.xzy(), uniform_sphere(sampler.get_2d(2)));
            match index % 4 {
                0 => ray.until(4.0 * sampler.get_1d(3)),
                1 => Ray {
                    direction: 3.0 * ray.direction,
                    ..ray
                },
                _ => ray,
            }
        })
        .collect()
}

/// The shares of rays that one hits and the other does not, and of hits whose distances differ by more than 10⁻³ of the sphere.
fn differences(
    context: &Context,
    scene: &Arc<Scene>,
    gpu: &FieldGpuTracer,
    cpu: &dyn Tracer,
    rays: &[Ray],
) -> [f64; 3] {
    let gpu_scene = GpuScene::new(context, scene).unwrap();
    let mut batch = RayBatch::new(context, &gpu_scene, gpu).unwrap();
    let mut closest: Vec<Option<Hit>> = vec![None; rays.len()];
    batch
        .closest_hits(context, &gpu_scene, gpu, rays, &mut closest)
        .unwrap();
    let mut any = vec![false; rays.len()];
    batch
        .any_hits(context, &gpu_scene, gpu, rays, &mut any)
        .unwrap();
    let (mut hits, mut confused, mut far) = (0.0, 0.0, 0.0);
    for ((ray, found), any) in rays.iter().zip(closest).zip(any) {
        let expected = cpu.closest_hit(ray);
        confused += f64::from(u8::from(found.is_some() != any));
        match (found, expected) {
            (Some(a), Some(b)) => {
                hits += 1.0;
                far += f64::from(u8::from((a.t - b.t).abs() * ray.direction.length() > 1e-3));
            }
            (None, None) => {}
            _ => confused += 1.0,
        }
    }
    let count = rays.len() as f64;
    [hits / count, confused / count, far / count]
}

/// How fields are sampled and asked.
type Case = (Storage, Directions, u32, LookUp);

/// That a GPU finds what the CPU finds, before and after everything has moved.
fn agrees(context: &Context, case: Case, count: u32, in_textures: bool) {
    let (storage, directions, resolution, look_up) = case;
    let scene = scene(20);
    let others = part(&scene, false);
    let rays = rays(count);
    let params = FieldParams {
        positions: Positions::Slater { rings: 12 },
        directions,
        resolution,
        storage,
        ..FieldParams::default()
    };
    let fields = fields(&scene, &params, look_up);
    let exact = support::exact(&others);
    let selection = Selection::default();
    let mut gpu = FieldGpuTracer::new(context, fields.clone(), Some((others, selection))).unwrap();
    assert_eq!(gpu.shader_flags().is_empty(), !in_textures);
    let mut cpu = Together(fields, exact);
    let mut transforms = scene.transforms();
    for time in [0.0, 0.7] {
        if time > 0.0 {
            for (index, transform) in transforms.iter_mut().enumerate().take(20) {
                *transform = place(index, time);
            }
            gpu.update(context, &transforms).unwrap();
            cpu.0.update(&transforms).unwrap();
        }
        let found = differences(context, &scene, &gpu, &cpu, &rays);
        let [hits, confused, far] = found;
        eprintln!("{params:?} {look_up:?}: {found:?}");
        // Rounding decides at the borders of cells, where the distances of two samples may be any.
        assert!(
            hits > 0.3 && confused < 2e-3 && far < 4e-3,
            "{params:?} {look_up:?}: {found:?}"
        );
    }
}

#[test]
fn the_gpu_finds_what_the_cpu_finds() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let (polar, concentric) = (Directions::Polar, Directions::Concentric);
    for case in [
        (Storage::Byte, concentric, 32, LookUp::Nearest),
        (Storage::Byte, concentric, 33, LookUp::Aimed),
        (Storage::Byte, concentric, 32, LookUp::Interpolated),
        (
            Storage::Bit,
            Directions::Rejection,
            33,
            LookUp::Interpolated,
        ),
        (Storage::Word, polar, 16, LookUp::Interpolated),
        (Storage::Float, polar, 17, LookUp::Aimed),
    ] {
        agrees(&context, case, 4000, false);
    }
}

/// On a device that binds too little for the tables they are textures.
#[test]
fn the_gpu_finds_the_same_in_textures() {
    let Some(context) = Context::for_tests_within(wgpu::Features::empty(), 256) else {
        return;
    };
    let case = (
        Storage::Byte,
        Directions::Concentric,
        32,
        LookUp::Interpolated,
    );
    agrees(&context, case, 1000, true);
}

/// Most pixels are of surfaces that have a field of their own, whose error must not shadow them.
#[test]
fn objects_look_alike_under_their_own_fields() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let scene = scene(8);
    let others = part(&scene, false);
    let params = FieldParams {
        positions: Positions::Slater { rings: 12 },
        ..FieldParams::default()
    };
    let fields = fields(&scene, &params, LookUp::Interpolated);
    let exact = support::exact(&scene);
    let cpu = Together(fields.clone(), support::exact(&others));
    let selection = Selection::default();
    let field = FieldGpuTracer::new(&context, fields, Some((others, selection))).unwrap();
    let gpu_exact = ComputeBvhTracer::build(&context, &scene, &selection, &()).unwrap();
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();

    let camera = Camera::look_at("above", Vec3::new(0.0, 9.0, 9.0), Vec3::ZERO, 0.9);
    let (size, settings) = (
        [48, 36],
        Settings {
            samples: 16,
            d_max: 2.0,
            ..Settings::default()
        },
    );
    let quantities = [Quantity::Ao];
    let tracers = Tracers {
        exact: &exact,
        secondary: &cpu,
    };
    let none = &|_, _| {};
    let expected = render(&scene, tracers, &camera, size, &quantities, &settings, none).unwrap();
    let world = gpu::reference::World {
        scene: &scene,
        gpu_scene: &gpu_scene,
        exact: &gpu_exact,
        secondary: &field,
    };
    let mut integrator = gpu::reference::Integrator::new(&context);
    let found = integrator
        .render(world, &camera, size, &quantities, &settings, none)
        .unwrap();
    let (found, expected) = (&found.estimates[0].values, &expected.estimates[0].values);
    let pairs = found.iter().zip(expected);
    let squares: f32 = pairs.map(|(a, b)| (a.x - b.x).powi(2)).sum();
    let rms = 255.0 * (squares / found.len() as f32).sqrt();
    eprintln!("ao: rms {rms} grey levels");
    assert!(rms < 1.0, "{rms} grey levels");
}
