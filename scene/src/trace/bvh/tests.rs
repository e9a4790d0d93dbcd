use std::f32::consts::TAU;

use glam::{Affine3A, Mat3A, Quat, Vec2, Vec3, Vec3A};
use proptest::{prelude::*, sample::Index};

use super::*;
use crate::{
    Aabb, Alpha, BruteForceTracer, ColorSpace, Instance, InstanceMask, Material, Mesh, Texture,
    TextureRef, sample::Sampler,
};

/// A mesh in which every triangle has its own corners.
fn soup(corners: &[[Vec3; 3]]) -> Mesh {
    let count = corners.len() as u32;
    Mesh {
        positions: corners.iter().flatten().copied().collect(),
        normals: vec![Vec3::Y; corners.len() * 3],
        triangles: (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        triangle_materials: vec![0; corners.len()],
        ..Mesh::default()
    }
}

/// Each mesh at each of its transforms.
fn scene(meshes: Vec<(Mesh, Vec<Affine3A>)>) -> Scene {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    for (index, (mesh, transforms)) in meshes.into_iter().enumerate() {
        scene.meshes.push(Arc::new(mesh));
        let placed = |transform| Instance::new(index as u32, transform);
        scene.instances.extend(transforms.into_iter().map(placed));
    }
    scene
}

/// One level and two, each with and without special instructions.
fn tracers(scene: &Arc<Scene>, selection: &Selection) -> Vec<(&'static str, BvhTracer)> {
    let build = |levels| {
        BvhTracer::build(
            scene,
            selection,
            &BvhOptions {
                levels,
                ..BvhOptions::default()
            },
        )
        .expect("has triangles")
    };
    let (flat, two) = (build(Levels::Flat), build(Levels::Two));
    vec![
        ("flat, portable", portable(flat.clone())),
        ("two levels, portable", portable(two.clone())),
        ("flat", flat),
        ("two levels", two),
    ]
}

fn portable(tracer: BvhTracer) -> BvhTracer {
    BvhTracer {
        #[cfg(target_arch = "x86_64")]
        avx2: None,
        ..tracer
    }
}

fn brute_force(scene: &Arc<Scene>, selection: &Selection) -> BruteForceTracer {
    BruteForceTracer::build(scene, selection, &()).expect("has triangles")
}

/// Every question about a ray has the same answer, to the last bit.
fn agree(
    exact: &BruteForceTracer,
    tracers: &[(&str, BvhTracer)],
    ray: &Ray,
) -> Result<(), TestCaseError> {
    let closest = exact.closest_hit(ray);
    let start = closest.map_or(SurfaceId::UNKNOWN, |hit| hit.surface);
    let next = exact.closest_hit_from(ray, start);
    for (name, tracer) in tracers {
        prop_assert_eq!(closest, tracer.closest_hit(ray), "{} {:?}", name, ray);
        prop_assert_eq!(closest.is_some(), tracer.any_hit(ray), "{} {:?}", name, ray);
        let from = tracer.closest_hit_from(ray, start);
        prop_assert_eq!(next, from, "{} {:?} from {:?}", name, ray, start);
        let any = tracer.any_hit_from(ray, start);
        prop_assert_eq!(next.is_some(), any, "{} {:?} from {:?}", name, ray, start);
    }
    Ok(())
}

fn point() -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(-1.0_f32..1.0).prop_map(Vec3::from_array)
}

/// Of any scale and any place, with many vertices in common and many planes parallel to the axes.
fn triangles(most: usize) -> impl Strategy<Value = Vec<[Vec3; 3]>> {
    let corner = prop_oneof![
        point(),
        prop::array::uniform3(-2_i8..3).prop_map(|p| Vec3::from_array(p.map(f32::from)))
    ];
    let place = prop_oneof![Just(Vec3::ZERO), point().prop_map(|p| p * 1000.0)];
    let scale = prop_oneof![Just(1e-3_f32), Just(1.0), Just(1e3)];
    let corners = prop::collection::vec(prop::array::uniform3(corner), 1..most);
    (corners, place, scale).prop_map(|(corners, place, scale)| {
        corners
            .into_iter()
            .map(|triangle| triangle.map(|corner| (corner + place) * scale))
            .collect()
    })
}

/// Turned, mirrored, stretched, sheared, tiny, huge, far away, flattened, or gone.
fn transform() -> impl Strategy<Value = Affine3A> {
    let factor = prop_oneof![
        4 => prop_oneof![-2.0_f32..-0.5, 0.5_f32..2.0],
        1 => prop_oneof![Just(1e-3_f32), Just(1e3), Just(-1.0), Just(1.0), Just(1e-6)],
    ];
    let scale = prop_oneof![
        4 => factor.clone().prop_map(Vec3::splat),
        4 => prop::array::uniform3(factor).prop_map(Vec3::from_array),
        1 => Just(Vec3::new(1.0, 0.0, 1.0)),
        1 => Just(Vec3::new(0.0, 2.0, 0.0)),
        1 => Just(Vec3::ZERO),
    ];
    let quarter = (0_u8..4).prop_map(|turns| Quat::from_rotation_y(f32::from(turns) * TAU / 4.0));
    let rotation = prop_oneof![
        Just(Quat::IDENTITY),
        quarter,
        (point(), 0.0..TAU).prop_map(|(axis, angle)| {
            Quat::from_axis_angle(axis.try_normalize().unwrap_or(Vec3::X), angle)
        })
    ];
    let translation = prop_oneof![
        2 => Just(Vec3::ZERO),
        4 => point().prop_map(|p| p * 3.0),
        1 => point().prop_map(|p| p * 1e5),
    ];
    let shear = prop_oneof![3 => Just(0.0), 1 => -1.0_f32..1.0];
    (scale, rotation, translation, shear).prop_map(|(scale, rotation, translation, shear)| {
        let sheared = Affine3A::from_mat3(glam::Mat3::from_cols(
            Vec3::X,
            Vec3::new(shear, 1.0, 0.0),
            Vec3::Z,
        ));
        Affine3A::from_scale_rotation_translation(scale, rotation, translation) * sheared
    })
}

/// How a ray comes about from the corners in a scene.
type Recipe = (Index, Index, Vec3, Vec3, u8);

fn recipes(count: usize) -> impl Strategy<Value = Vec<Recipe>> {
    let recipe = (any::<Index>(), any::<Index>(), point(), point(), 0_u8..4);
    prop::collection::vec(recipe, count)
}

/// Rays aimed at corners, at edges, along edges, or anywhere; three for each recipe.
fn rays(corners: &[Vec3], recipes: &[Recipe]) -> Vec<Ray> {
    let size = Aabb::around(corners.iter().copied()).diagonal();
    recipes
        .iter()
        .flat_map(|(from, to, offset, other, kind)| {
            let (from, to) = (from.index(corners.len()), to.index(corners.len()));
            let start = corners[from];
            let next = corners[to / 3 * 3 + (to + 1) % 3];
            let target = match kind {
                0 => corners[to],
                1 => corners[to].lerp(next, other.x.abs()),
                2 => start + (corners[to] - corners[to / 3 * 3]),
                _ => start + size * other,
            };
            let origin = if *kind == 2 {
                start
            } else {
                start + offset * size
            };
            [
                target - origin,
                offset.round(),
                -offset.signum() * other.round(),
            ]
            .map(|direction| Ray::new(origin, direction))
        })
        .collect()
}

/// The corners of all triangles in the world, three each.
fn corners(scene: &Scene, transforms: &[Affine3A]) -> Vec<Vec3> {
    let everything = Selection {
        mask: InstanceMask::NONE,
        bounds: None,
    };
    world_triangles(scene, transforms, &everything)
        .iter()
        .flat_map(|triangle| triangle.corners)
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn answers_are_those_of_brute_force(corners in triangles(60), recipes in recipes(60)) {
        let scene = Arc::new(scene(vec![(soup(&corners), vec![Affine3A::IDENTITY])]));
        let selection = Selection::default();
        let (exact, tracers) = (brute_force(&scene, &selection), tracers(&scene, &selection));
        for ray in rays(corners.as_flattened(), &recipes) {
            agree(&exact, &tracers, &ray)?;
        }
    }

    #[test]
    fn instances_answer_as_brute_force_does(
        meshes in prop::collection::vec((triangles(16), prop::collection::vec(transform(), 1..5)), 1..3),
        moved in prop::collection::vec(transform(), 8),
        masks in prop::collection::vec(prop_oneof![3 => Just(InstanceMask::ALL), 1 => Just(InstanceMask::STATIC)], 8),
        bounds in prop::option::of((any::<Index>(), point())),
        recipes in recipes(24),
    ) {
        let meshes = meshes.into_iter().map(|(corners, transforms)| (soup(&corners), transforms));
        let mut scene = scene(meshes.collect());
        for (instance, mask) in scene.instances.iter_mut().zip(masks) {
            instance.mask = mask;
        }
        // An instance that is always there, so that something is selected.
        scene.instances[0].mask = InstanceMask::ALL;
        let scene = Arc::new(scene);
        let placed = corners(&scene, &scene.transforms());
        let bounds = bounds.map(|(corner, size)| {
            let (corner, size) = (placed[corner.index(placed.len())], size.abs() * scene.bounds().diagonal());
            Aabb { min: corner - 0.5 * size, max: corner + 0.5 * size }
        });
        let selection = Selection { bounds, ..Selection::default() };
        let Ok(mut exact) = BruteForceTracer::build(&scene, &selection, &()) else {
            for levels in [Levels::Flat, Levels::Two] {
                let built = BvhTracer::build(&scene, &selection, &BvhOptions { levels, ..BvhOptions::default() });
                let is_refused = matches!(built, Err(Error::NoGeometry { .. }));
                prop_assert!(is_refused);
            }
            return Ok(());
        };
        let mut tracers = tracers(&scene, &selection);
        for ray in rays(&placed, &recipes) {
            agree(&exact, &tracers, &ray)?;
        }
        let moved = &moved[..scene.instances.len()];
        exact.update(moved).unwrap();
        for (_, tracer) in &mut tracers {
            tracer.update(moved).unwrap();
        }
        for ray in rays(&corners(&scene, moved), &recipes) {
            agree(&exact, &tracers, &ray)?;
        }
    }
}

/// Numbers in 0..1 that look random.
fn random(seed: u32) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    }
}

#[test]
fn piles_of_copies_do_not_overflow_the_stack() {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    // Each a little larger than the one before: a chain of boxes in boxes.
    let chain: Vec<[Vec3; 3]> = (0..2000)
        .map(|i| corners.map(|corner| corner * 1.01_f32.powi(i)))
        .collect();
    let turned = Affine3A::from_axis_angle(Vec3::ONE.normalize(), 0.5);
    let nested = (0..500).map(|i| turned * Affine3A::from_scale(Vec3::splat(1.05_f32.powi(i))));
    let scenes = [
        scene(vec![(soup(&[corners; 3000]), vec![Affine3A::IDENTITY; 2])]),
        scene(vec![(soup(&chain), vec![turned])]),
        scene(vec![(soup(&[corners; 3]), vec![turned; 1000])]),
        scene(vec![(soup(&[corners]), nested.collect())]),
    ];
    for scene in scenes {
        let scene = Arc::new(scene);
        let selection = Selection::default();
        let (exact, tracers) = (brute_force(&scene, &selection), tracers(&scene, &selection));
        let to = scene.instances[0]
            .transform
            .transform_point3(Vec3::new(0.2, 0.2, 0.0));
        for from in [Vec3::new(0.3, 0.1, 2.0), Vec3::new(5.0, -4.0, -0.1), to] {
            agree(&exact, &tracers, &Ray::new(from, to - from + 1e-3)).unwrap();
        }
    }
}

#[test]
fn no_ray_is_too_long_or_too_far_away() {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let transforms = [
        Affine3A::IDENTITY,
        Affine3A::from_scale(Vec3::splat(1e-20)),
        Affine3A::from_scale(Vec3::new(1e15, 1.0, -1e-15)),
        Affine3A::from_translation(Vec3::splat(1e17)),
        // Overflow.
        Affine3A::from_scale(Vec3::splat(1e38)) * Affine3A::from_translation(Vec3::splat(10.0)),
        Affine3A {
            matrix3: Mat3A::IDENTITY,
            translation: Vec3A::splat(f32::NAN),
        },
    ];
    let scene = Arc::new(scene(vec![(soup(&[corners; 20]), transforms.to_vec())]));
    let selection = Selection::default();
    let (exact, tracers) = (brute_force(&scene, &selection), tracers(&scene, &selection));
    let mut next = random(5);
    for power in [-38, -30, -20, -10, 0, 10, 20, 30, 38] {
        for length in [1e-40, 1e-30, 1.0, 1e30, 1e38] {
            let mut vector = || Vec3::from_array([0; 3].map(|_| 2.0 * next() - 1.0));
            for target in
                transforms.map(|transform| transform.transform_point3(vector().abs() / 3.0))
            {
                let origin = vector() * 10_f32.powi(power);
                let aimed = (target - origin).normalize_or_zero() * length;
                for direction in [aimed, vector() * length, Vec3::Z * length] {
                    agree(&exact, &tracers, &Ray::new(origin, direction)).unwrap();
                }
            }
        }
    }
}

#[test]
fn rays_pass_what_is_cut_out() {
    // A texture that is opaque on its left half.
    let texel = |i: usize| [255, 255, 255, if i % 8 < 4 { 255 } else { 0 }];
    let texture = Texture::new("half", 8, 8, (0..64).map(texel).collect(), ColorSpace::Srgb);
    let square = [
        [Vec3::ZERO, Vec3::X, Vec3::Y],
        [Vec3::X, Vec3::X + Vec3::Y, Vec3::Y],
    ];
    let mut mesh = soup(&square);
    mesh.uvs[0] = mesh.positions.iter().map(|p| Vec2::new(p.x, p.y)).collect();
    let place = |z| Affine3A::from_rotation_y(0.3) * Affine3A::from_translation(Vec3::Z * z);
    let mut scene = scene(vec![(mesh, vec![place(0.0), place(1.0), place(2.0)])]);
    scene.textures = vec![Arc::new(texture)];
    scene.materials[0].alpha = Alpha::Mask { cutoff: 0.5 };
    scene.materials[0].base_color_texture = Some(TextureRef::new(0));
    // The last one is the other way round.
    scene.instances[2].transform *= Affine3A::from_scale_rotation_translation(
        Vec3::new(-1.0, 1.0, 1.0),
        Quat::IDENTITY,
        Vec3::X,
    );
    let scene = Arc::new(scene);
    let selection = Selection::default();
    let (exact, tracers) = (brute_force(&scene, &selection), tracers(&scene, &selection));
    let mut next = random(3);
    let mut hits = [0; 3];
    for _ in 0..500 {
        let target = place(0.0).transform_point3(Vec3::new(next(), next(), 0.0));
        let slant = 0.1 * Vec3::new(next() - 0.5, next() - 0.5, 0.0);
        let direction = place(0.0).transform_vector3(Vec3::Z + slant);
        let ray = Ray::new(target - direction, direction);
        agree(&exact, &tracers, &ray).unwrap();
        if let Some(hit) = exact.closest_hit(&ray) {
            hits[hit.surface.instance as usize] += 1;
        }
    }
    assert!(
        hits[0] > 150 && hits[2] > 100 && hits[1] < hits[0],
        "{hits:?}"
    );
}

#[test]
fn what_moves_out_of_the_bounds_is_not_selected() {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let scene = Arc::new(scene(vec![(soup(&[corners]), vec![Affine3A::IDENTITY; 2])]));
    let selection = Selection {
        bounds: Some(Aabb::around([Vec3::splat(-1.0), Vec3::splat(2.0)])),
        ..Selection::default()
    };
    let ray = Ray::new(Vec3::new(0.2, 0.2, -5.0), Vec3::Z);
    for (name, mut tracer) in tracers(&scene, &selection) {
        let mut hit_at = |z: [f32; 2]| {
            let places = z.map(|z| Affine3A::from_translation(Vec3::Z * z));
            tracer.update(&places).expect("there are two");
            tracer
                .closest_hit(&ray)
                .map(|hit| (hit.t, hit.surface.instance))
        };
        assert_eq!(hit_at([1.0, -9.0]), Some((6.0, 0)), "{name}");
        assert_eq!(hit_at([9.0, -9.0]), None, "{name}");
        assert_eq!(hit_at([9.0, 0.0]), Some((5.0, 1)), "{name}");
        assert!(tracer.update(&[Affine3A::IDENTITY]).is_err(), "{name}");
    }
}

#[test]
fn a_mesh_is_held_once() {
    let mut next = random(1);
    let corners: Vec<[Vec3; 3]> = (0..2500)
        .map(|_| {
            let place = Vec3::new(next(), next(), next());
            [Vec3::ZERO, Vec3::X, Vec3::Y].map(|corner| place + 0.1 * corner)
        })
        .collect();
    let places = |count| (0..count).map(|i| Affine3A::from_translation(Vec3::X * i as f32));
    let held = |count, levels| {
        let scene = Arc::new(scene(vec![(soup(&corners), places(count).collect())]));
        let selection = Selection::default();
        let tracer = BvhTracer::build(
            &scene,
            &selection,
            &BvhOptions {
                levels,
                ..BvhOptions::default()
            },
        );
        (
            tracer.expect("has triangles").bytes(),
            levels.are_two(&scene, &selection),
        )
    };
    let (flat, _) = held(40, Levels::Flat);
    let (two, _) = held(40, Levels::Two);
    assert!(two * 20 < flat, "{two} {flat}");
    let is_two = |count| {
        let scene = scene(vec![(soup(&corners), places(count).collect())]);
        Levels::Auto.are_two(&scene, &Selection::default())
    };
    assert!(!is_two(80) && is_two(81));
}

/// Boxes are hit where a slow reading of the rule says, in one level and in two.
#[test]
fn leaves_may_be_boxes() {
    let scene = Arc::new(crate::builtin::build("builtin:cornell").expect("a built-in scene"));
    let selection = Selection::default();
    let triangles = world_triangles(&scene, &scene.transforms(), &selection);
    let boxes: Vec<Aabb> = triangles
        .iter()
        .map(|triangle| Aabb::around(triangle.corners))
        .collect();
    let enters = |ray: &Ray, bounds: &Aabb| {
        let (mut enter, mut leave) = (f32::NEG_INFINITY, f32::INFINITY);
        for axis in 0..3 {
            let inverse = 1.0 / ray.direction[axis];
            let [a, b] = [bounds.min, bounds.max].map(|p| (p[axis] - ray.origin[axis]) * inverse);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        (enter <= leave && enter > ray.t_min && leave < ray.t_max).then_some(enter)
    };
    for levels in [Levels::Flat, Levels::Two] {
        let leaves = Leaves::Boxes;
        let options = BvhOptions { levels, leaves };
        let tracer = BvhTracer::build(&scene, &selection, &options).expect("has triangles");
        assert_eq!(tracer.answers(), Answers::Distance);
        let mut met = 0;
        for index in 0..2000 {
            let sampler = Sampler::new(7, 0, index);
            let [p, q] = [0, 1].map(|dimension| {
                let u = sampler.get_2d(dimension);
                let size = scene.bounds().max - scene.bounds().min;
                let w = sampler.get_1d(dimension + 2);
                scene.bounds().min + size * Vec3::new(u.x, u.y, w)
            });
            let ray = Ray::new(p, q - p).until(1.0);
            let nearest = boxes
                .iter()
                .filter_map(|bounds| enters(&ray, bounds))
                .fold(f32::INFINITY, f32::min);
            let found = tracer.closest_hit(&ray).map_or(f32::INFINITY, |hit| hit.t);
            assert_eq!(found, nearest, "ray {index}, {levels:?}");
            assert_eq!(tracer.any_hit(&ray), nearest.is_finite());
            met += usize::from(nearest.is_finite());
        }
        assert!((200..1900).contains(&met), "{met}");
    }
}
