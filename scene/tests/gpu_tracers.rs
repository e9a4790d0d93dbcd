//! The GPU's tracers against the CPU's exact one.
//!
//! Each comparison traces 100,000 rays; `ISOPHOTE_GPU_RAYS` asks for another number.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "a test may fail")]

use std::{path::Path, sync::Arc, time::Instant};

use glam::{Affine2, Affine3A, Vec2, Vec3, Vec4};
use isophote_scene::{
    Aabb, Alpha, BuildTracer, BvhTracer, ColorSpace, Hit, Instance, InstanceMask, Leaves, Material,
    Mesh, Ray, Scene, Selection, SurfaceId, Texture, TextureRef, Tracer, Wrap, builtin,
    gpu::{
        BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, GpuTracer, RayBatch,
        RayQueryBoxTracer, RayQueryTracer, check_ray_query,
    },
    sample::{Sampler, uniform_sphere},
};

/// A device and batches for one kind of tracer: compiling them takes longer than using them.
struct Lab {
    context: Context,
    batch: Option<RayBatch>,
    rays: usize,
    /// How far off distances may be, in units of the coordinates' last place.
    last_places: f32,
}

impl Lab {
    /// `None`, loudly, where there is no adapter or it lacks what is needed.
    fn new(features: wgpu::Features) -> Option<Self> {
        let rays = std::env::var("ISOPHOTE_GPU_RAYS").ok();
        let rays = rays.and_then(|count| count.parse().ok()).unwrap_or(100_000);
        Some(Self::with(Context::for_tests_of(features)?, rays))
    }

    fn with(context: Context, rays: usize) -> Self {
        Self {
            context,
            batch: None,
            last_places: 1.0,
            rays,
        }
    }

    fn ask(&mut self, scene: &Scene, tracer: &dyn GpuTracer, rays: &[Ray]) -> Answers {
        let last_places = self.last_places;
        let Self { context, batch, .. } = self;
        let gpu_scene = GpuScene::new(context, scene).unwrap();
        let batch =
            batch.get_or_insert_with(|| RayBatch::new(context, &gpu_scene, tracer).unwrap());
        let mut answers = Answers {
            last_places,
            closest: vec![None; rays.len()],
            any: vec![false; rays.len()],
        };
        let start = Instant::now();
        let closest = &mut answers.closest;
        batch
            .closest_hits(context, &gpu_scene, tracer, rays, closest)
            .unwrap();
        let closest = start.elapsed().as_secs_f64();
        let kernel = batch.take_kernel_time().as_secs_f64();
        batch
            .any_hits(context, &gpu_scene, tracer, rays, &mut answers.any)
            .unwrap();
        let any = batch.take_kernel_time().as_secs_f64();
        let rate = |time: f64| rays.len() as f64 / time / 1e6;
        println!(
            "{}, {} triangles, {} rays, million/s: closest {:.3} with transfers, {:.3} on the device; any {:.3}",
            tracer.name(),
            scene.triangle_count(),
            rays.len(),
            rate(closest),
            rate(kernel),
            rate(any),
        );
        answers
    }

    /// Builds a tracer of a kind and compares it with the exact one.
    fn compare<T: BuildGpuTracer<Options = ()>>(
        &mut self,
        name: &str,
        scene: &Arc<Scene>,
        selection: &Selection,
    ) {
        let exact = BvhTracer::build(scene, selection, &Default::default()).unwrap();
        let tracer = T::build(&self.context, scene, selection, &()).unwrap();
        let rays = rays(scene, &exact, self.rays);
        let answers = self.ask(scene, &tracer, &rays);
        check(name, scene, &exact, &rays, &answers);
    }
}

struct Answers {
    last_places: f32,
    closest: Vec<Option<Hit>>,
    any: Vec<bool>,
}

/// Half of the rays go from anywhere to anywhere, half start on surfaces, as light does; some end early, some are not
/// of unit length.
fn rays(scene: &Scene, tracer: &dyn Tracer, count: usize) -> Vec<Ray> {
    let bounds = scene.bounds();
    let mut rays: Vec<Ray> = Vec::with_capacity(count);
    for index in 0..count {
        let sampler = Sampler::new(7, 0, index as u32);
        let direction = uniform_sphere(sampler.get_2d(0));
        let start = index
            .checked_sub(1)
            .and_then(|last| tracer.closest_hit(&rays[last]));
        let mut ray = match start {
            Some(hit) if index % 2 == 1 => {
                let point = scene.surface_point(&hit);
                Ray::new(point.lifted(direction, 0.0), direction)
            }
            _ => {
                let at = sampler.get_2d(2).extend(sampler.get_1d(4));
                Ray::new(bounds.min + at * (bounds.max - bounds.min), direction)
            }
        };
        match index % 8 {
            0 | 1 => ray.t_max = 0.2 * bounds.diagonal() * sampler.get_1d(5),
            2 => ray.t_min = 0.05 * bounds.diagonal() * sampler.get_1d(5),
            3 => ray.direction *= 1e-3 + 100.0 * sampler.get_1d(5),
            _ => {}
        }
        rays.push(ray);
    }
    rays
}

/// Hit or miss may differ for one ray in 100,000, distances by 1e-4 or by what the coordinates' last place means.
fn check(name: &str, scene: &Scene, exact: &dyn Tracer, rays: &[Ray], answers: &Answers) {
    let mut expected = vec![None; rays.len()];
    exact.closest_hits(rays, &mut expected);
    let last_place = answers.last_places * f32::EPSILON * scene.bounds().largest_coordinate();
    let (mut confused, mut far, mut beyond, mut others, mut astray) = (0, 0, 0, 0, 0);
    for (index, ray) in rays.iter().enumerate() {
        let (hit, expected) = (answers.closest[index], expected[index]);
        match (hit, expected) {
            (Some(hit), Some(expected)) => {
                let off = (hit.t - expected.t).abs();
                beyond += usize::from(off > 1e-4 * expected.t);
                if off * ray.direction.length()
                    > (1e-4 * expected.t * ray.direction.length()).max(last_place)
                {
                    far += 1;
                    println!("{name}: {hit:?} instead of {expected:?}: {ray:?}");
                }
                others += usize::from(hit.surface != expected.surface);
                // Of two triangles at one edge or in one place either is right, if the ray meets it there.
                if hit.surface != SurfaceId::UNKNOWN {
                    let place = scene.surface_point(&hit).position;
                    let off = place.distance(ray.at(hit.t));
                    let grazing = 1e-4 * (hit.t * ray.direction.length() + off);
                    astray += usize::from(off > grazing.max(64.0 * last_place));
                }
            }
            (None, None) => {}
            _ => println!("{name}: {hit:?} instead of {expected:?}: {ray:?}"),
        }
        let is_hit = expected.is_some();
        confused += usize::from(hit.is_some() != is_hit || answers.any[index] != is_hit);
    }
    let hits = expected.iter().flatten().count();
    println!(
        "{name}: {hits} hits; hit or miss differ {confused}, t {far} ({beyond} by more than 1e-4), surface {others} ({astray} astray)"
    );
    let allowed = rays.len() / 100_000;
    assert!(hits > rays.len() / 50, "{name}: only {hits} hits");
    assert!(
        confused <= allowed,
        "{name}: {confused} hits or misses differ"
    );
    assert!(far <= allowed, "{name}: {far} distances differ");
    assert!(
        astray <= allowed,
        "{name}: {astray} hits are not on their triangle"
    );
}

fn shared(name: &str) -> Option<Arc<Scene>> {
    let path = format!(
        "{}/../../shared/scenes/{name}.glb",
        env!("CARGO_MANIFEST_DIR")
    );
    if !Path::new(&path).exists() {
        eprintln!("SKIPPED {name}: there is no ../shared");
        return None;
    }
    Some(Arc::new(isophote_scene::load(Path::new(&path)).unwrap()))
}

fn builtin(name: &str) -> Arc<Scene> {
    Arc::new(builtin::build(name).unwrap())
}

/// Leaves with holes: masked triangles with every kind of look-up, instances that are mirrored, moved, scaled, or play
/// no role.
fn leaves() -> Arc<Scene> {
    let texels = (0..64 * 32)
        .map(|i: u32| {
            let alpha = if (i % 64) / 5 % 2 == (i / 64) / 3 % 2 {
                255
            } else {
                (i % 200) as u8
            };
            [200, 100, 50, alpha]
        })
        .collect();
    let mut texture = Texture::new("holes", 64, 32, texels, ColorSpace::Srgb);
    texture.wrap = [Wrap::Mirror, Wrap::Clamp];
    let mut nearest = texture.clone();
    nearest.filter = isophote_scene::Filter::Nearest;
    nearest.wrap = [Wrap::Repeat; 2];
    nearest.color_space = ColorSpace::Linear;
    let masked = |texture: u32, uv_set: u8, cutoff: f32| Material {
        alpha: Alpha::Mask { cutoff },
        base_color_texture: Some(TextureRef {
            texture,
            uv_set,
            transform: Affine2::from_scale_angle_translation(
                Vec2::new(1.5, 0.7),
                0.3,
                Vec2::new(0.2, -0.1),
            ),
        }),
        ..Material::default()
    };
    let quad = |z: f32| {
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| Vec3::new(x, y, z))
    };
    let mut mesh = Mesh {
        positions: (0..6).flat_map(|i| quad(0.3 * i as f32)).collect(),
        normals: vec![Vec3::Z; 24],
        ..Mesh::default()
    };
    mesh.uvs = [1.3, -0.8].map(|scale| {
        mesh.positions
            .iter()
            .map(|p| scale * Vec2::new(p.x, p.y) + p.z)
            .collect()
    });
    mesh.colors = mesh
        .positions
        .iter()
        .map(|p| Vec4::new(1.0, 1.0, 1.0, 0.75 + 0.25 * p.x))
        .collect();
    for layer in 0..6_u32 {
        mesh.triangles
            .extend([[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|i| 4 * layer + i)));
        mesh.triangle_materials.extend([layer % 4; 2]);
    }
    let placed = |at: Vec3, scale: Vec3| {
        let turn = glam::Quat::from_axis_angle(Vec3::new(1.0, 2.0, 3.0).normalize(), at.x);
        Instance::new(
            0,
            Affine3A::from_scale_rotation_translation(scale, turn, at),
        )
    };
    let mut instances = vec![
        placed(Vec3::ZERO, Vec3::ONE),
        placed(Vec3::new(3.0, 0.5, 0.0), Vec3::new(-1.0, 1.0, 1.0)),
        placed(Vec3::new(-2.5, 1.0, 1.0), Vec3::new(0.5, -2.0, 0.7)),
        placed(Vec3::new(0.5, 2.5, -2.0), Vec3::splat(1.5)),
    ];
    instances[3].mask = InstanceMask::STATIC;
    Arc::new(Scene {
        meshes: vec![Arc::new(mesh)],
        materials: vec![
            masked(0, 0, 0.5),
            Material::default(),
            masked(1, 1, 0.3),
            masked(0, 1, 0.7),
        ],
        textures: vec![Arc::new(texture), Arc::new(nearest)],
        instances,
        ..Scene::default()
    })
}

/// What every exact tracer must pass.
fn agrees<T: BuildGpuTracer<Options = ()>>(lab: &mut Lab) {
    lab.compare::<T>("cornell", &builtin("cornell"), &Selection::default());
    lab.compare::<T>("corner", &builtin("corner:9"), &Selection::default());
    selections_and_movement::<T>(lab);
    odd_rays::<T>(lab);
}

fn selections_and_movement<T: BuildGpuTracer<Options = ()>>(lab: &mut Lab) {
    let scene = leaves();
    lab.compare::<T>("leaves", &scene, &Selection::default());
    let resting = Selection {
        mask: InstanceMask::STATIC,
        bounds: None,
    };
    lab.compare::<T>("all leaves", &scene, &resting);
    let bounds = Aabb::around([Vec3::new(-0.7, -3.0, -3.0), Vec3::splat(0.6)]);
    for bounds in [None, Some(bounds)] {
        let selection = Selection {
            bounds,
            ..Selection::default()
        };
        let mut exact = BvhTracer::build(&scene, &selection, &Default::default()).unwrap();
        let mut tracer = T::build(&lab.context, &scene, &selection, &()).unwrap();
        let mut moved = Scene::clone(&scene);
        for instance in &mut moved.instances {
            instance.transform =
                Affine3A::from_translation(Vec3::new(0.2, -0.4, 0.3)) * instance.transform;
        }
        exact.update(&moved.transforms()).unwrap();
        tracer.update(&lab.context, &moved.transforms()).unwrap();
        let rays = rays(&moved, &exact, lab.rays);
        let answers = lab.ask(&moved, &tracer, &rays);
        check("moved leaves", &moved, &exact, &rays, &answers);
        assert!(tracer.update(&lab.context, &[]).is_err());
    }
    let nothing = Selection {
        mask: InstanceMask::CASTER,
        bounds: Some(Aabb::around([Vec3::splat(90.0), Vec3::splat(91.0)])),
    };
    assert!(T::build(&lab.context, &scene, &nothing, &()).is_err());
}

/// Rays that must miss, and rays that must not: very near, very far, along axes and edges, very short and very long.
fn odd_rays<T: BuildGpuTracer<Options = ()>>(lab: &mut Lab) {
    let scene = builtin("corner:9");
    let exact = BvhTracer::build(&scene, &Selection::default(), &Default::default()).unwrap();
    let tracer = T::build(&lab.context, &scene, &Selection::default(), &()).unwrap();
    let start = scene.bounds().center();
    let nan = f32::NAN;
    let invalid = [
        Ray::new(Vec3::new(nan, 0.0, 0.0), Vec3::X),
        Ray::new(Vec3::new(0.0, f32::INFINITY, 0.0), Vec3::X),
        Ray::new(start, Vec3::ZERO),
        Ray::new(start, Vec3::new(0.0, nan, -1.0)),
        Ray::new(start, Vec3::new(0.0, f32::NEG_INFINITY, 0.0)),
        Ray::new(start, Vec3::NEG_Y).until(0.0),
        Ray::new(start, Vec3::NEG_Y).until(nan),
        Ray {
            t_min: nan,
            ..Ray::new(start, Vec3::NEG_Y)
        },
        Ray {
            t_min: 3.0,
            t_max: 2.0,
            ..Ray::new(start, Vec3::NEG_Y)
        },
        Ray::new(start, Vec3::NEG_Y).until(-1.0),
    ];
    let answers = lab.ask(&scene, &tracer, &invalid);
    assert!(answers.closest.iter().all(Option::is_none) && !answers.any.contains(&true));
    let mut rays = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        rays.extend([axis, -axis].map(|direction| Ray::new(start, direction)));
    }
    for index in 0..200 {
        let sampler = Sampler::new(3, 0, index);
        let direction = uniform_sphere(sampler.get_2d(0));
        let Some(hit) = exact.closest_hit(&Ray::new(start, direction)) else {
            continue;
        };
        let point = start + hit.t * direction;
        for distance in [1e-5, 1e-4, 1e-3] {
            rays.push(Ray::new(point - distance * direction, direction));
        }
        rays.push(Ray::new(point - 1e3 * direction, direction));
        rays.push(Ray::new(start, 1e-6 * direction));
        rays.push(Ray::new(start, 1e6 * direction));
    }
    let answers = lab.ask(&scene, &tracer, &rays);
    check("odd rays", &scene, &exact, &rays, &answers);
}

#[test]
fn compute_bvh_agrees() {
    let Some(mut lab) = Lab::new(wgpu::Features::empty()) else {
        return;
    };
    agrees::<ComputeBvhTracer>(&mut lab);
    lab.compare::<ComputeBvhTracer>(
        "hairball",
        &builtin("hairball:20000"),
        &Selection::default(),
    );
    for name in ["sibenik", "sponza_dabrovic", "conference"] {
        if let Some(scene) = shared(name) {
            lab.compare::<ComputeBvhTracer>(name, &scene, &Selection::default());
        }
    }
}

#[test]
fn ray_query_agrees() {
    let Some(mut lab) = Lab::new(wgpu::Features::EXPERIMENTAL_RAY_QUERY) else {
        return;
    };
    check_ray_query(&lab.context).unwrap();
    // The driver's triangle test is its own.
    lab.last_places = 8.0;
    agrees::<RayQueryTracer>(&mut lab);
    lab.compare::<RayQueryTracer>("hairball", &builtin("hairball:1000"), &Selection::default());
    for name in ["sibenik", "sponza_dabrovic", "conference"] {
        if let Some(scene) = shared(name) {
            lab.compare::<RayQueryTracer>(name, &scene, &Selection::default());
        }
    }
}

/// A device that binds so little that all scenes are read from textures and rays come in many batches.
fn small(features: wgpu::Features) -> Option<Lab> {
    Some(Lab::with(Context::for_tests_within(features, 256)?, 1000))
}

/// In tables of many rows, too.
fn agrees_in_textures<T: BuildGpuTracer<Options = ()>>(lab: &mut Lab, triangles: u32) {
    selections_and_movement::<T>(lab);
    // Of the leaves a tracer may be small enough for buffers.
    lab.batch = None;
    let scene = builtin(&format!("hairball:{triangles}"));
    lab.compare::<T>("hairball", &scene, &Selection::default());
    let tracer = T::build(&lab.context, &scene, &Selection::default(), &()).unwrap();
    assert!(!tracer.shader_flags().is_empty());
    assert!(
        GpuScene::new(&lab.context, &scene)
            .unwrap()
            .is_in_textures()
    );
}

#[test]
fn compute_bvh_agrees_in_textures() {
    if let Some(mut lab) = small(wgpu::Features::empty()) {
        agrees_in_textures::<ComputeBvhTracer>(&mut lab, 20_000);
    }
}

#[test]
fn ray_query_agrees_in_textures() {
    if let Some(mut lab) = small(wgpu::Features::EXPERIMENTAL_RAY_QUERY) {
        lab.last_places = 8.0;
        agrees_in_textures::<RayQueryTracer>(&mut lab, 40_000);
    }
}

/// The boxes around triangles, one after the other.
struct Boxes(Vec<Aabb>);

impl Boxes {
    fn new(scene: &Scene) -> Self {
        let boxes = scene.instances.iter().flat_map(|instance| {
            let mesh = scene.mesh(instance).clone();
            (0..mesh.triangles.len()).map(move |primitive| {
                let corners = mesh.corners(primitive);
                Aabb::around(corners.map(|corner| instance.transform.transform_point3(corner)))
            })
        });
        Self(boxes.collect())
    }
}

impl Tracer for Boxes {
    fn answers(&self) -> isophote_scene::Answers {
        isophote_scene::Answers::Distance
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        let enter = |one: &Aabb| {
            let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
            for axis in 0..3 {
                let (o, d) = (f64::from(ray.origin[axis]), f64::from(ray.direction[axis]));
                let a = (f64::from(one.min[axis]) - o) / d;
                let b = (f64::from(one.max[axis]) - o) / d;
                (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
            }
            let counts =
                enter <= leave && enter > f64::from(ray.t_min) && leave < f64::from(ray.t_max);
            counts.then_some(enter)
        };
        let t = self.0.iter().filter_map(enter).min_by(f64::total_cmp)? as f32;
        Some(Hit {
            t,
            uv: Vec2::ZERO,
            surface: SurfaceId::UNKNOWN,
        })
    }
}

#[test]
fn boxes_agree_with_boxes() {
    let features = wgpu::Features::EXPERIMENTAL_RAY_QUERY;
    for lab in [Lab::new(features), small(features)] {
        let Some(mut lab) = lab else { return };
        boxes_agree(&mut lab);
    }
}

fn boxes_agree(lab: &mut Lab) {
    for name in ["cornell", "hairball:1000"] {
        let scene = builtin(name);
        let boxes = Boxes::new(&scene);
        let exact = BvhTracer::build(&scene, &Selection::default(), &Default::default()).unwrap();
        let selection = Selection::default();
        let query = RayQueryBoxTracer::build(&lab.context, &scene, &selection, &()).unwrap();
        let walked =
            ComputeBvhTracer::build_with(&lab.context, &scene, &selection, Leaves::Boxes).unwrap();
        // Starting within a flat box or just outside is a matter of rounding, so no ray starts on a surface.
        let rays: Vec<Ray> = rays(&scene, &exact, lab.rays)
            .into_iter()
            .step_by(2)
            .collect();
        for tracer in [&query as &dyn GpuTracer, &walked] {
            lab.batch = None;
            let answers = lab.ask(&scene, tracer, &rays);
            check(name, &scene, &boxes, &rays, &answers);
        }
    }
}
