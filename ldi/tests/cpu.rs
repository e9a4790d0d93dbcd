//! The maps against the oracle, analytic cases, files and limits.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::{collections::BTreeMap, path::Path, sync::Arc};

use glam::{Affine3A, Vec3};
use isophote_ldi::{
    Coverage, Error, LdiParams, LdiTracer,
    cpu::maps::{Layer, Maps},
};
use isophote_scene::{
    Aabb, BruteForceTracer, BuildTracer, BvhOptions, BvhTracer, Error as SceneError, Hit, Instance,
    InstanceMask, Mesh, Ray, Scene, Selection, SurfaceId, Tracer, WithFallback, builtin, clean,
    testing::{RayKind, Tolerances, conformance, rays},
};
use proptest::prelude::*;

fn params(cells: u32, resolution: u32, coverage: Coverage) -> LdiParams {
    LdiParams {
        cells,
        resolution,
        coverage,
        ..LdiParams::default()
    }
}

fn scene(name: &str) -> Arc<Scene> {
    Arc::new(builtin::build(name).unwrap())
}

fn maps(scene: &Arc<Scene>, params: &LdiParams) -> LdiTracer {
    LdiTracer::build(scene, &Selection::default(), params).unwrap()
}

fn oracle(scene: &Arc<Scene>) -> BruteForceTracer {
    BruteForceTracer::build(scene, &Selection::default(), &()).unwrap()
}

#[test]
fn touched_pixels_lose_nothing() {
    let cornell = scene("cornell");
    for (cells, resolution) in [(1, 8), (2, 32), (4, 128), (3, 301)] {
        let maps = maps(&cornell, &params(cells, resolution, Coverage::Touched));
        let exact = Tolerances::EXACT;
        let report = conformance(&cornell, &maps, &oracle(&cornell), &exact, 2000, 7);
        assert!(
            report.violations.is_empty(),
            "{cells} {resolution}\n{report}"
        );
    }
}

/// A looser bound on the depths' error takes fewer bytes, and no hit is lost by it.
#[test]
fn coarse_depths_take_less_and_lose_nothing() {
    let cornell = scene("cornell");
    let mut before = None;
    for (depth_error, bytes) in [(1.0 / 64.0, 4), (1.0 / 4.0, 3), (64.0, 2)] {
        let params = LdiParams {
            depth_error,
            ..params(2, 64, Coverage::Touched)
        };
        let maps = maps(&cornell, &params);
        let exact = Tolerances::EXACT;
        let report = conformance(&cornell, &maps, &oracle(&cornell), &exact, 500, 7);
        assert!(report.violations.is_empty(), "{depth_error}\n{report}");
        assert!(maps.maps().depth_error() <= depth_error.into());
        let packing = maps.maps().layers.packing();
        assert_eq!(packing.bytes(), bytes, "{depth_error}: {packing:?}");
        let taken = maps.maps().map_bytes();
        assert!(
            before.is_none_or(|before| taken < before),
            "{depth_error}: {taken}"
        );
        before = Some(taken);
    }
}

/// More than 65,536 groups need wide layers.
#[test]
fn many_triangles_are_exact_too() {
    let hairball = scene("hairball:500000");
    let exact = BvhTracer::build(&hairball, &Selection::default(), &BvhOptions::default()).unwrap();
    let maps = maps(&hairball, &params(1, 64, Coverage::Touched));
    for kind in RayKind::ALL {
        let rays = rays(&hairball, kind, 300, 3);
        let (mut found, mut truth) = (vec![None; 300], vec![None; 300]);
        maps.closest_hits(&rays, &mut found);
        exact.closest_hits(&rays, &mut truth);
        assert_eq!(found, truth, "{kind:?}");
    }
}

/// The paper's layers: what they get wrong is measured and bounded.
#[test]
fn centers_are_wrong_at_edges_only() {
    let cornell = scene("cornell");
    let maps = maps(&cornell, &params(4, 128, Coverage::Center));
    // Rays along surfaces and those aimed at edges are the worst case.
    let tolerances = Tolerances {
        false_hits: 0.08,
        leaks: 0.2,
        t_error: 1e-4,
        early: 0.15,
    };
    let report = conformance(&cornell, &maps, &oracle(&cornell), &tolerances, 4000, 7);
    assert!(report.violations.is_empty(), "{report}");
    for (kind, found) in &report.kinds {
        if [RayKind::Uniform, RayKind::Diffuse, RayKind::Axis].contains(kind) {
            let early = found.early as f64 / found.hits as f64;
            assert!(
                found.leak_rate() < 0.02 && early < 0.01 && found.false_hit_rate() < 0.01,
                "{report}"
            );
        }
    }
}

/// With the dial at its exact end every answer is the exact tracer's; on the way there the error falls.
#[test]
fn the_dial_goes_from_fast_to_exact() {
    let office = scene("office");
    let exact = BvhTracer::build(&office, &Selection::default(), &BvhOptions::default()).unwrap();
    let maps = maps(&office, &params(3, 64, Coverage::Center));
    let rays = rays(&office, RayKind::Diffuse, 4000, 1);
    let mut truth = vec![None; rays.len()];
    exact.closest_hits(&rays, &mut truth);
    let answer = |least: f32| {
        let tracer = WithFallback::new(&maps, &exact, least);
        let mut hits = vec![None; rays.len()];
        tracer.closest_hits(&rays, &mut hits);
        let wrong = |(hit, truth): (&Option<Hit>, &Option<Hit>)| hit != truth;
        let sent = tracer.doubtful(&rays).iter().filter(|sent| **sent).count();
        (
            sent,
            hits.iter().zip(&truth).filter(|pair| wrong(*pair)).count(),
            hits,
        )
    };
    let (sent, _, plain) = answer(0.0);
    let mut fast = vec![None; rays.len()];
    maps.closest_hits(&rays, &mut fast);
    assert!(sent == 0 && plain == fast);
    let far = |hits: &[Option<Hit>]| {
        let off = |(hit, truth): &(&Option<Hit>, &Option<Hit>)| match (hit, truth) {
            (Some(hit), Some(truth)) => (hit.t - truth.t).abs() > 1e-3 * truth.t,
            (None, None) => false,
            _ => true,
        };
        hits.iter().zip(&truth).filter(off).count()
    };
    let middle = answer(0.7);
    let before = far(&plain);
    assert!(
        middle.0 < rays.len() / 2 && far(&middle.2) < before,
        "{} {}",
        middle.0,
        before
    );
    let (sent, wrong, _) = answer(1.1);
    assert!(sent == rays.len() && wrong == 0, "{sent} {wrong}");
}

/// A ray never meets the triangle it starts on, and rays from one side of a thin wall meet it from the other.
#[test]
fn a_rays_own_triangle_is_not_hit() {
    let cornell = scene("cornell");
    for coverage in [Coverage::Touched, Coverage::Center] {
        let maps = maps(&cornell, &params(2, 64, coverage));
        let mut hits = 0;
        for ray in rays(&cornell, RayKind::Diffuse, 500, 5) {
            let Some(first) = maps.closest_hit(&ray) else {
                continue;
            };
            let again = maps.closest_hit_from(&ray, first.surface);
            assert!(again.is_none_or(|hit| hit.surface != first.surface && hit.t >= first.t));
            assert_eq!(maps.any_hit_from(&ray, first.surface), again.is_some());
            hits += 1;
        }
        assert!(hits > 300);
    }
}

#[test]
fn instances_can_be_left_out_and_moved() {
    let mut cornell = builtin::build("cornell").unwrap();
    let last = cornell.instances.len() - 1;
    cornell.instances[last].mask = InstanceMask::ALL.without(InstanceMask::STATIC);
    let cornell = Arc::new(cornell);
    let fixed = Selection {
        mask: InstanceMask::STATIC,
        bounds: None,
    };
    let params = params(2, 32, Coverage::Touched);
    let mut maps = LdiTracer::build(&cornell, &fixed, &params).unwrap();
    let mut oracle = BruteForceTracer::build(&cornell, &fixed, &()).unwrap();
    let rays = rays(&cornell, RayKind::Uniform, 1000, 2);
    let answers = |tracer: &dyn Tracer| -> Vec<_> {
        rays.iter().map(|ray| tracer.closest_hit(ray)).collect()
    };
    let before = answers(&maps);
    assert_eq!(before, answers(&oracle));
    let left_out = |hit: &Option<Hit>| hit.is_none_or(|hit| hit.surface.instance != last as u32);
    assert!(before.iter().all(left_out));
    let moved: Vec<Affine3A> = cornell
        .transforms()
        .into_iter()
        .map(|transform| Affine3A::from_translation(Vec3::new(0.1, 0.2, 0.3)) * transform)
        .collect();
    maps.update(&moved).unwrap();
    oracle.update(&moved).unwrap();
    assert!(answers(&maps) == answers(&oracle) && answers(&maps) != before);
    assert!(maps.update(&moved[1..]).is_err());
}

/// Fitted to a part of the scene, the maps answer there as before.
#[test]
fn bounds_fit_the_maps() {
    let office = scene("office");
    let all = office.bounds();
    let bounds = Aabb {
        min: all.min,
        max: all.center(),
    };
    let selection = Selection {
        bounds: Some(bounds),
        ..Selection::default()
    };
    let maps = LdiTracer::build(&office, &selection, &params(2, 64, Coverage::Touched)).unwrap();
    let oracle = BruteForceTracer::build(&office, &selection, &()).unwrap();
    let mut inside = 0;
    for ray in rays(&office, RayKind::Uniform, 3000, 4) {
        let truth = oracle.closest_hit(&ray);
        let in_bounds =
            |point: Vec3| point.cmpge(bounds.min).all() && point.cmple(bounds.max).all();
        if in_bounds(ray.origin) && truth.is_some_and(|hit| in_bounds(ray.at(hit.t))) {
            assert_eq!(maps.closest_hit(&ray), truth);
            inside += 1;
        }
    }
    assert!(inside > 100, "{inside}");
}

/// What is built does not depend on the number of threads.
#[test]
fn threads_do_not_matter() {
    let office = scene("office");
    let params = params(2, 64, Coverage::Touched);
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| maps(&office, &params))
    };
    let (one, three) = (build(1), build(3));
    assert!(one.maps().layers == three.maps().layers && one.maps().pixels == three.maps().pixels);
}

#[test]
fn wrong_parameters_are_errors() {
    let cornell = scene("cornell");
    let fails = |params: LdiParams, part: &str| {
        let error = LdiTracer::build(&cornell, &Selection::default(), &params).unwrap_err();
        assert!(error.to_string().contains(part), "{error}");
    };
    let good = LdiParams::default();
    fails(LdiParams { cells: 0, ..good }, "1 to 64");
    fails(
        LdiParams {
            resolution: 7,
            ..good
        },
        "8 to 4096",
    );
    fails(
        LdiParams {
            epsilon: f32::NAN,
            ..good
        },
        "0 to 2",
    );
    for depth_error in [0.0, f32::NAN, f32::INFINITY] {
        fails(
            LdiParams {
                depth_error,
                ..good
            },
            "1/64 to 4096",
        );
    }
    fails(
        LdiParams {
            max_bytes: 1000,
            ..good
        },
        "fewer directions",
    );
    // Enough for the pixels, but not for the layers.
    fails(
        LdiParams {
            max_bytes: 7_000_000,
            ..good
        },
        "fewer directions",
    );
    let nothing = Selection {
        bounds: Some(Aabb {
            min: Vec3::splat(1e3),
            max: Vec3::splat(2e3),
        }),
        ..Selection::default()
    };
    assert!(LdiTracer::build(&cornell, &nothing, &good).is_err());
}

fn bytes_of(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap()
}

#[test]
fn maps_are_saved_and_loaded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("maps.ldi");
    let cornell = scene("cornell");
    for coverage in [Coverage::Touched, Coverage::Center] {
        let saved = maps(&cornell, &params(2, 33, coverage));
        saved.save(&path).unwrap();
        let loaded = LdiTracer::load(&path, &cornell, &Selection::default()).unwrap();
        assert_eq!(loaded.params().resolution, 33);
        for ray in rays(&cornell, RayKind::Diffuse, 500, 1) {
            assert_eq!(saved.closest_hit(&ray), loaded.closest_hit(&ray));
        }
    }
    let foreign = LdiTracer::load(&path, &scene("office"), &Selection::default());
    assert!(matches!(
        foreign,
        Err(Error::Scene(SceneError::Foreign { .. }))
    ));
    let fixed = Selection {
        mask: InstanceMask::STATIC,
        bounds: Some(cornell.bounds()),
    };
    assert!(matches!(
        LdiTracer::load(&path, &cornell, &fixed),
        Err(Error::Scene(SceneError::Foreign { .. }))
    ));
}

/// No byte of a file can be changed, and none removed or added, without an error.
#[test]
fn damaged_files_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("maps.ldi");
    let cornell = scene("cornell");
    maps(&cornell, &params(1, 8, Coverage::Touched))
        .save(&path)
        .unwrap();
    let good = bytes_of(&path);
    let load = |bytes: &[u8]| {
        let damaged = folder.path().join("damaged.ldi");
        std::fs::write(&damaged, bytes).unwrap();
        LdiTracer::load(&damaged, &cornell, &Selection::default())
    };
    assert!(load(&good).is_ok());
    for length in [0, 5, 60, 127, good.len() / 2, good.len() - 1] {
        assert!(load(&good[..length]).is_err(), "cut to {length}");
    }
    assert!(load(&[&good[..], &[0]].concat()).is_err());
    for at in (0..128).chain((128..good.len()).step_by(97)) {
        for change in [1, 0x80, 0xff] {
            let mut bad = good.clone();
            bad[at] ^= change;
            assert!(load(&bad).is_err(), "byte {at} by {change:x}");
        }
    }
    assert!(matches!(
        LdiTracer::load(&folder.path().join("none"), &cornell, &Selection::default()),
        Err(Error::Scene(SceneError::Io { .. }))
    ));
}

/// One triangle as a scene.
fn triangle(corners: [Vec3; 3]) -> Arc<Scene> {
    triangles(&corners)
}

fn two_triangles(first: [Vec3; 3], second: [Vec3; 3]) -> Arc<Scene> {
    triangles(&[first, second].concat())
}

fn triangles(corners: &[Vec3]) -> Arc<Scene> {
    let count = corners.len() as u32;
    let mut mesh = Mesh {
        positions: corners.to_vec(),
        normals: vec![Vec3::Y; corners.len()],
        triangles: (0..count)
            .step_by(3)
            .map(|first| [first, first + 1, first + 2])
            .collect(),
        triangle_materials: vec![0; corners.len() / 3],
        ..Mesh::default()
    };
    clean(&mut mesh);
    let scene = Scene {
        meshes: vec![Arc::new(mesh)],
        materials: vec![isophote_scene::Material::default()],
        instances: vec![Instance::new(0, Affine3A::IDENTITY)],
        ..Scene::default()
    };
    Arc::new(scene)
}

fn point() -> impl Strategy<Value = Vec3> {
    [-10.0_f32..10.0, -10.0_f32..10.0, -10.0_f32..10.0].prop_map(Vec3::from_array)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Any triangle, slivers and needles too, is found by any ray aimed at it, as the oracle finds it.
    #[test]
    fn single_triangles(a in point(), b in point(), c in point(), flat in 0.0_f32..1.0, seed in 0_u64..1000) {
        let c = b + (c - b) * flat * flat * flat;
        let scene = triangle([a, b, c]);
        prop_assume!(scene.triangle_count() == 1);
        let maps = maps(&scene, &params(2, 16, Coverage::Touched));
        let oracle = oracle(&scene);
        for kind in [RayKind::Uniform, RayKind::Edge, RayKind::Axis] {
            for ray in rays(&scene, kind, 50, seed) {
                prop_assert_eq!(maps.closest_hit(&ray), oracle.closest_hit(&ray));
                prop_assert_eq!(maps.any_hit_from(&ray, SurfaceId { instance: 0, primitive: 0 }), false);
            }
        }
    }

    /// Whatever the bound, the range of depths that is kept reaches around the finest there is, and no further than the bound.
    #[test]
    fn depths_keep_their_bound(
        corners in prop::array::uniform6(point()), depth_error in 0.02_f32..64.0, touched in any::<bool>(),
    ) {
        let [a, b, c, d, e, f] = corners;
        let scene = two_triangles([a, b, c], [d, e, f]);
        prop_assume!(scene.triangle_count() == 2);
        let coverage = if touched { Coverage::Touched } else { Coverage::Center };
        let build = |depth_error| maps(&scene, &LdiParams { depth_error, ..params(1, 16, coverage) });
        let (finest, coarse) = (build(1.0 / 64.0), build(depth_error));
        let [finest, coarse] = [finest.maps(), coarse.maps()];
        let kept = coarse.depth_error();
        prop_assert!(kept <= depth_error.into() || coarse.layers.packing().depth_bits() == 16);
        for pixel in 0..finest.pixels.len() - 1 {
            let frame = &coarse.frames[pixel / coarse.pixels_per_map()];
            let pixels = 1.0 / f64::from(frame.scale[0].min(frame.scale[1]));
            let depth = f64::from(coarse.layers.packing().depth_steps()) / f64::from(frame.scale[2]) / pixels;
            // By target, in pixels.
            let ranges = |maps: &Maps| -> BTreeMap<u32, [f64; 2]> {
                let step = depth / f64::from(maps.layers.packing().depth_steps());
                let [first, end] = [pixel, pixel + 1].map(|pixel| maps.pixels[pixel].first as usize);
                let range = |layer: Layer| [f64::from(layer.near) * step, f64::from(layer.far + 1) * step];
                (first..end).map(|index| maps.layers.get(index)).map(|layer| (layer.target, range(layer))).collect()
            };
            let found = ranges(coarse);
            for (target, [near, far]) in ranges(finest) {
                let [low, high] = found[&target];
                let room = 1e-4 * depth.max(1.0);
                prop_assert!(low <= near + room && far <= high + room, "{low} {near} {far} {high}");
                prop_assert!(near - low <= kept + room && high - far <= kept + room, "{low} {near} {far} {high}, {kept}");
            }
        }
    }

    /// Far from the world's origin and with rays from far outside.
    #[test]
    fn far_away(shift in 0.0_f32..2000.0, distance in 1.0_f32..5000.0, seed in 0_u64..1000) {
        let mut cornell = builtin::build("cornell").unwrap();
        for instance in &mut cornell.instances {
            instance.transform = Affine3A::from_translation(Vec3::splat(shift)) * instance.transform;
        }
        let cornell = Arc::new(cornell);
        let maps = maps(&cornell, &params(2, 64, Coverage::Touched));
        let oracle = oracle(&cornell);
        for ray in rays(&cornell, RayKind::Edge, 60, seed) {
            let ray = Ray { origin: ray.at(-distance), ..ray };
            prop_assert_eq!(maps.closest_hit(&ray), oracle.closest_hit(&ray));
        }
    }
}
