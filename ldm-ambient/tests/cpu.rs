//! Occlusion and traces against analytic answers and against exact tracers.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::sync::Arc;

use glam::{Affine3A, Quat, Vec3};
use isophote_ldm_ambient::{
    Error, LdmTracer, MapParams, OcclusionParams, StreamedMaps,
    cpu::{
        Points, Triangles,
        occlusion::{Occlusion, Sky},
    },
};
use isophote_scene::{
    BruteForceTracer, BuildTracer, BvhOptions, BvhTracer, Directions as Exact, Instance, Material,
    Mesh, ParallelTracer, Ray, Receivers, Scene, Selection, Tracer, builtin,
    reference::{Normals, Quantity, Settings, Tracers, bake},
    testing::{RayKind, Tolerances, conformance},
};

/// A square in the plane y = 0 around the origin.
fn square(side: f32) -> Mesh {
    let half = 0.5 * side;
    Mesh {
        positions: [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(x, z)| Vec3::new(half * x, 0.0, half * z))
            .into(),
        normals: vec![Vec3::Y; 4],
        triangles: vec![[0, 2, 1], [0, 3, 2]],
        triangle_materials: vec![0; 2],
        ..Mesh::default()
    }
}

fn squares(places: &[(f32, Affine3A)]) -> Scene {
    Scene {
        meshes: places
            .iter()
            .map(|(side, _)| Arc::new(square(*side)))
            .collect(),
        instances: places
            .iter()
            .zip(0..)
            .map(|((_, place), mesh)| Instance::new(mesh, *place))
            .collect(),
        materials: vec![Material::default()],
        ..Scene::default()
    }
}

fn skies(scene: &Scene, points: &Points, count: usize, params: &OcclusionParams) -> Vec<Sky> {
    let triangles = Triangles::new(scene, &scene.transforms(), &Selection::default()).unwrap();
    let mut occlusion = Occlusion::new(&triangles, count, params).unwrap();
    occlusion.add(points, [0, 1], &|_, _| {});
    occlusion.skies()
}

fn params(maps: u32, resolution: u32, d_max: f32) -> OcclusionParams {
    OcclusionParams {
        maps: MapParams {
            maps,
            resolution,
            ..MapParams::default()
        },
        d_max,
        ..OcclusionParams::default()
    }
}

/// A plane under the open sky is open however it is turned: it never shadows itself.
#[test]
fn a_plane_alone_is_open() {
    for turn in 0..12 {
        let turn = Quat::from_euler(
            glam::EulerRot::XYZ,
            0.5 * turn as f32,
            0.3 * turn as f32,
            0.0,
        );
        let scene = squares(&[(2.0, Affine3A::from_quat(turn))]);
        let receivers = Receivers::from_vertices(&scene, 0);
        let points = Points::of_receivers(&receivers, Normals::Smooth);
        for d_max in [f32::INFINITY, 1.0] {
            for sky in skies(&scene, &points, 4, &params(64, 50, d_max)) {
                // A direction within the plane may count as below it.
                assert!(sky.ao > 0.999 && sky.obscurance > 0.999, "{sky:?}");
                let angle = sky.bent_normal.angle_between(turn * Vec3::Y);
                assert!(angle < 0.05, "{angle}");
            }
        }
    }
}

/// A small point under a square at a height equal to half its side: the form factor between a point and a parallel
/// rectangle is known.
#[test]
fn under_a_square_the_sky_is_what_it_leaves() {
    let scene = squares(&[
        (0.02, Affine3A::IDENTITY),
        (2.0, Affine3A::from_translation(Vec3::Y)),
    ]);
    let points = Points::of_receivers(&Receivers::from_vertices(&scene, 0), Normals::Smooth);
    // A quarter of the square, seen from below one of its corners: a = b = 1.
    let quarter = (2.0 / 2_f32.sqrt() * (1.0 / 2_f32.sqrt()).atan()) / (2.0 * std::f32::consts::PI);
    for d_max in [f32::INFINITY, 3.0] {
        // A direction is under the square's edge or not: those of several frames tell it apart more finely.
        for (frames, bound) in [(1, 0.02), (16, 0.004)] {
            let params = OcclusionParams {
                frames,
                ..params(512, 200, d_max)
            };
            for sky in skies(&scene, &points, 4, &params) {
                let off = sky.ao - (1.0 - 4.0 * quarter);
                assert!(off.abs() < bound, "{frames} frames: {off}");
            }
        }
    }
    // Beyond its reach the square is not there.
    for sky in skies(&scene, &points, 4, &params(512, 200, 0.9)) {
        assert_eq!(sky.ao, 1.0);
    }
    // Between, obscurance is t / d_max.
    for sky in skies(&scene, &points, 4, &params(512, 200, 1.2)) {
        assert!(sky.ao < sky.obscurance && sky.obscurance < 1.0);
    }
}

/// Receivers of a room, against the reference integrator.
#[test]
fn baked_occlusion_is_near_the_reference() {
    let scene = Arc::new(builtin::build("cornell").unwrap());
    let exact = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default()).unwrap();
    let camera = &scene.cameras[0];
    let receivers = Receivers::from_camera(&scene, &exact, camera, [40, 30]);
    let count = 40 * 30;
    let points = Points::of_receivers(&receivers, Normals::Smooth);
    let settings = Settings {
        samples: 256,
        d_max: 0.8,
        ..Settings::default()
    };
    let tracers = Tracers {
        exact: &exact,
        secondary: &exact,
    };
    let (truth, _) = bake(
        &scene,
        tracers,
        &receivers,
        &[Quantity::Obscurance],
        &settings,
        &|_, _| {},
    )
    .unwrap();
    let found = skies(&scene, &points, count, &params(512, 200, 0.8));
    let mut sum = 0.0;
    for (receiver, truth) in receivers.points.iter().zip(&truth[0].values) {
        sum += (found[receiver.index as usize].obscurance - truth.x).powi(2);
    }
    let rms = 255.0 * (sum / receivers.points.len() as f32).sqrt();
    assert!(rms < 6.0, "{rms} grey levels");
}

/// Whatever the number of threads, and whether a frame is rendered again.
#[test]
fn results_do_not_depend_on_threads() {
    let scene = Arc::new(builtin::build("office").unwrap());
    let exact = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default()).unwrap();
    let points = Points::from_camera(
        &scene,
        &exact,
        &scene.cameras[0],
        [64, 48],
        0,
        Normals::Smooth,
    );
    for d_max in [f32::INFINITY, 1.0] {
        let render = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| skies(&scene, &points, 64 * 48, &params(40, 64, d_max)))
        };
        let one = render(1);
        assert_eq!(one, render(7));
        assert_eq!(one, render(2));
    }
}

/// What moves far away, and changes what maps are fitted around, hardly changes anything.
#[test]
fn nothing_flickers() {
    let room = builtin::build("office").unwrap();
    let params = params(64, 100, 0.5);
    let frame = |step: u32| {
        let mut scene = room.clone();
        let mut bird = squares(&[(0.3, Affine3A::IDENTITY)]);
        let mesh = scene.meshes.len() as u32;
        scene.meshes.append(&mut bird.meshes);
        let side = room.bounds().max.x + 1.0 + 0.01 * step as f32;
        let place = Affine3A::from_translation(Vec3::new(side, 0.5, 0.02 * step as f32));
        scene.instances.push(Instance::new(mesh, place));
        let scene = Arc::new(scene);
        let select = Selection::default();
        let exact = BvhTracer::build(&scene, &select, &BvhOptions::default()).unwrap();
        let mut receivers = Receivers::from_camera(&scene, &exact, &scene.cameras[0], [64, 48]);
        let far = receivers.points.len();
        let others = Receivers::from_vertices(&scene, mesh);
        receivers.points.extend(others.points);
        for (index, receiver) in (0..).zip(&mut receivers.points) {
            receiver.index = index;
        }
        let points = Points::of_receivers(&receivers, Normals::Smooth);
        let skies = skies(&scene, &points, receivers.points.len(), &params);
        skies[..far].iter().map(|sky| 255.0 * sky.ao).collect()
    };
    let frames: Vec<Vec<f32>> = (0..8).map(frame).collect();
    let mut squares = 0.0;
    for pair in frames.windows(2) {
        let changes = pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b).powi(2));
        squares += changes.sum::<f32>();
    }
    let rms = (squares / (7 * frames[0].len()) as f32).sqrt();
    println!("{rms} grey levels");
    assert!(rms < 0.5, "{rms} grey levels from frame to frame");
}

/// Frames with turned directions come nearer to the truth.
#[test]
fn frames_accumulate() {
    let scene = Arc::new(builtin::build("cornell").unwrap());
    let exact = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default()).unwrap();
    let points = Points::from_camera(
        &scene,
        &exact,
        &scene.cameras[0],
        [40, 30],
        0,
        Normals::Smooth,
    );
    let render = |maps, frames| {
        let params = OcclusionParams {
            frames,
            ..params(maps, 100, f32::INFINITY)
        };
        skies(&scene, &points, 40 * 30, &params)
    };
    let truth = render(4096, 1);
    let error = |skies: &[Sky]| {
        let squares = skies
            .iter()
            .zip(&truth)
            .map(|(sky, truth)| (sky.ao - truth.ao).powi(2));
        (squares.sum::<f32>() / truth.len() as f32).sqrt()
    };
    let (one, many) = (error(&render(16, 1)), error(&render(16, 16)));
    assert!(many < 0.5 * one, "{one} {many}");
}

/// Distances along the maps' directions are those of an exact tracer, but for the pixels at edges.
#[test]
fn maps_answer_as_an_exact_tracer_does() {
    let scene = Arc::new(builtin::build("office").unwrap());
    let exact = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default()).unwrap();
    let options = MapParams {
        maps: 12,
        resolution: 400,
        ..MapParams::default()
    };
    let stored = LdmTracer::build(&scene, &Selection::default(), &options).unwrap();
    let triangles = Triangles::new(&scene, &scene.transforms(), &Selection::default()).unwrap();
    let streamed = StreamedMaps::new(&triangles, &options).unwrap();
    let oracle = Exact::new(&exact, stored.directions().to_vec());
    assert_eq!(stored.directions(), streamed.directions());
    let bounds = scene.bounds();
    let points: Vec<Vec3> = (0..500)
        .map(|index| {
            let u = isophote_scene::sample::Sampler::new(1, 0, index);
            bounds.min + (bounds.max - bounds.min) * u.get_2d(0).extend(u.get_1d(1))
        })
        .collect();
    let tolerance = stored.tolerance(Vec3::ZERO);
    let maps: [&dyn ParallelTracer; 2] = [&stored, &streamed];
    for maps in maps {
        let (mut wrong, mut all) = (0, 0);
        for direction in 0..12 {
            let (mut found, mut truth) = (vec![(0.0, 0.0); 500], vec![(0.0, 0.0); 500]);
            maps.trace(direction, &points, &mut found);
            oracle.trace(direction, &points, &mut truth);
            for (found, truth) in found.iter().zip(&truth) {
                for (found, truth) in [(found.0, truth.0), (found.1, truth.1)] {
                    let same = found == truth || (found - truth).abs() < 4.0 * tolerance;
                    (wrong, all) = (wrong + u32::from(!same), all + 1);
                }
            }
        }
        // 2.2 %: lines beside edges meet what is before or behind them.
        assert!(wrong * 40 < all, "{wrong} of {all}");
    }
    // A ray is answered as the map's direction is, whatever its length.
    let direction = -stored.directions()[5];
    let mut behind = [(0.0, 0.0)];
    stored.trace(5, &points[..1], &mut behind);
    let hit = stored
        .closest_hit(&Ray::new(points[0], 2.0 * direction))
        .unwrap();
    assert!((2.0 * hit.t - behind[0].1).abs() < 1e-4);
}

/// The contract of tracers holds for any rays; how wrong those are that run along no map's direction is bounded.
#[test]
fn the_nearest_direction_keeps_the_contract() {
    let scene = Arc::new(builtin::build("cornell").unwrap());
    let select = Selection::default();
    let maps = LdmTracer::build(&scene, &select, &MapParams::default()).unwrap();
    let oracle = BruteForceTracer::build(&scene, &select, &()).unwrap();
    // Segments end on surfaces, and rays along or from a surface may meet it again: those lose most.
    let tolerances = Tolerances {
        false_hits: 0.2,
        leaks: 0.4,
        t_error: 0.06,
        early: 0.3,
    };
    let report = conformance(&scene, &maps, &oracle, &tolerances, 2000, 5);
    assert!(report.violations.is_empty(), "{report}");
    for (kind, found) in &report.kinds {
        if [RayKind::Uniform, RayKind::Axis].contains(kind) {
            let early = found.early as f64 / found.hits as f64;
            assert!(
                found.leak_rate() < 0.05 && early < 0.02 && found.false_hit_rate() < 0.02,
                "{report}"
            );
        }
    }
}

/// Five squares above each other are five layers in every pixel of a map along their normal, and their heights are the depths.
#[test]
fn layers_are_those_of_a_stack() {
    let heights = [0.0, 0.3, 0.31, 2.0, 7.5];
    let place = |&y: &f32| (1.0, Affine3A::from_translation(y * Vec3::Y));
    let scene = Arc::new(squares(&heights.iter().map(place).collect::<Vec<_>>()));
    let options = MapParams {
        maps: 1,
        resolution: 50,
        ..MapParams::default()
    };
    let maps = LdmTracer::build(&scene, &Selection::default(), &options).unwrap();
    assert_eq!(maps.directions()[0].abs(), Vec3::Y);
    // Of the sizes of pixels the one that gives the most of them is 2^-5.5 m: 46 centres are in a metre.
    assert_eq!(maps.layers(), 5 * 46 * 46);
    let mut found = maps.point_cloud(0);
    found.sort_by(|a, b| a.y.total_cmp(&b.y));
    for (layer, height) in found.chunks(46 * 46).zip(heights) {
        assert!(layer.iter().all(|point| (point.y - height).abs() < 2e-4));
    }
}

/// What moves is drawn where it is.
#[test]
fn maps_follow_what_moves() {
    let mut scene = squares(&[
        (1.0, Affine3A::IDENTITY),
        (1.0, Affine3A::from_translation(Vec3::Y)),
    ]);
    let options = MapParams {
        maps: 1,
        resolution: 50,
        ..MapParams::default()
    };
    let mut maps =
        LdmTracer::build(&Arc::new(scene.clone()), &Selection::default(), &options).unwrap();
    let up = Ray::new(Vec3::new(0.01, 0.0, 0.01), Vec3::Y);
    assert!((maps.closest_hit(&up).unwrap().t - 1.0).abs() < 1e-3);
    scene.instances[1].transform = Affine3A::from_translation(3.0 * Vec3::Y);
    maps.update(&scene.transforms()).unwrap();
    assert!((maps.closest_hit(&up).unwrap().t - 3.0).abs() < 1e-3);
    assert!(maps.update(&[]).is_err());
}

#[test]
fn wrong_parameters_are_refused() {
    let scene = builtin::build("cornell").unwrap();
    let triangles = Triangles::new(&scene, &scene.transforms(), &Selection::default()).unwrap();
    let fine = OcclusionParams::default();
    for wrong in [
        OcclusionParams { d_max: 0.0, ..fine },
        OcclusionParams {
            d_max: f32::NAN,
            ..fine
        },
        OcclusionParams { frames: 0, ..fine },
        OcclusionParams {
            frames: 1 << 16,
            ..fine
        },
        params(0, 10, 1.0),
        params(10, 0, 1.0),
        OcclusionParams {
            maps: MapParams {
                tolerance: f32::NAN,
                ..fine.maps
            },
            ..fine
        },
    ] {
        assert!(matches!(
            Occlusion::new(&triangles, 1, &wrong),
            Err(Error::Parameter { .. })
        ));
    }
    // What they take is allowed, and no byte less.
    let scene = Arc::new(scene.clone());
    let few = MapParams {
        maps: 24,
        resolution: 60,
        ..MapParams::default()
    };
    let all = LdmTracer::build(&scene, &Selection::default(), &few).unwrap();
    for (max_bytes, fits) in [(all.bytes() as u64, true), (all.bytes() as u64 - 1, false)] {
        let limited = MapParams { max_bytes, ..few };
        let built = LdmTracer::build(&scene, &Selection::default(), &limited);
        assert_eq!(built.is_ok(), fits, "{:?}", built.err());
    }
}
