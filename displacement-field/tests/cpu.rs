//! Fields of meshes against the exact tracer and moved about.

mod support;

use std::sync::Arc;

use glam::{Affine3A, Quat, Vec3};
use isophote_displacement_field::{
    Directions, Field, FieldParams, FieldTracer, LookUp, Object, ObjectParams, Positions, Storage,
    alone, split,
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Ray, Scene, Selection, SurfaceId, Tracer,
    sample::{Sampler, uniform_sphere},
    testing::{Tolerances, conformance},
};
use support::{coarse, errors, exact, field, mesh, placed, rays, scene, torus};

#[test]
fn finer_look_ups_are_closer_to_the_truth() {
    let torus = torus("torus", 48, 24, 0.45);
    let scene = scene(&torus, &[Affine3A::IDENTITY]);
    let (truth, rays) = (exact(&scene), rays(Vec3::ZERO, 1.45, 6000));
    let field = field(&torus, &coarse());
    let mut last = f64::INFINITY;
    for look_up in LookUp::ALL {
        let tracer = placed(&scene, field.clone(), look_up);
        let [wrong, off] = errors(&tracer, &truth, &rays);
        eprintln!("{look_up:?}: {wrong:.4} wrong, t off by {off:.4}");
        assert!(
            wrong < 0.04 && off < 0.06 && wrong < last,
            "{look_up:?}: {wrong} {off}"
        );
        last = wrong;
    }
    let fine = FieldParams {
        positions: Positions::Slater { rings: 40 },
        resolution: 64,
        storage: Storage::Word,
        ..FieldParams::default()
    };
    let tracer = placed(&scene, support::field(&torus, &fine), LookUp::Interpolated);
    let [wrong, off] = errors(&tracer, &truth, &rays);
    assert!(wrong < 0.01 && off < 0.02, "{wrong} {off}");
}

#[test]
fn every_kind_of_map_answers() {
    let torus = torus("torus", 32, 16, 0.45);
    let scene = scene(&torus, &[Affine3A::IDENTITY]);
    let (truth, rays) = (exact(&scene), rays(Vec3::ZERO, 1.45, 2000));
    for positions in [
        Positions::Slater { rings: 16 },
        Positions::PAPER_SPHERICAL,
        Positions::Octahedral { side: 33 },
    ] {
        for directions in Directions::ALL {
            for storage in Storage::ALL {
                let params = FieldParams {
                    positions,
                    directions,
                    storage,
                    resolution: 33,
                    ..FieldParams::default()
                };
                let field = field(&torus, &params);
                assert_eq!(field.bytes() as u64, params.bytes());
                for look_up in LookUp::ALL {
                    let tracer = placed(&scene, field.clone(), look_up);
                    let [wrong, off] = errors(&tracer, &truth, &rays);
                    let bit = storage == Storage::Bit;
                    let allowed = if bit { [0.1, 0.5] } else { [0.035, 0.08] };
                    assert!(
                        wrong < allowed[0] && off < allowed[1],
                        "{params:?} {look_up:?}: {wrong} {off}"
                    );
                }
            }
        }
    }
}

#[test]
fn the_suite_for_tracers_is_passed() {
    let torus = torus("torus", 32, 16, 0.45);
    let place = Affine3A::from_rotation_translation(Quat::from_rotation_x(1.0), Vec3::ONE);
    let one = scene(&torus, &[place]);
    let two = scene(&torus, &[place, Affine3A::from_translation(Vec3::X * 4.0)]);
    // Most of the suite's rays start on the object, without saying so, which a field cannot answer well; what is to hold
    // strictly is what does not depend on accuracy.
    let tolerances = Tolerances {
        false_hits: 0.3,
        leaks: 0.65,
        t_error: 0.05,
        early: 0.65,
    };
    for scene in [one, two] {
        for look_up in LookUp::ALL {
            let tracer = placed(&scene, field(&torus, &coarse()), look_up);
            let report = conformance(&scene, &tracer, &exact(&scene), &tolerances, 1500, 3);
            assert!(report.violations.is_empty(), "{look_up:?}\n{report}");
        }
    }
}

/// All instances share a field: what moves with the object changes nothing.
#[test]
fn answers_move_with_the_instance() {
    let torus = torus("torus", 32, 16, 0.45);
    let here = scene(&torus, &[Affine3A::IDENTITY]);
    let field = field(&torus, &coarse());
    let still = placed(&here, field.clone(), LookUp::Aimed);
    for (scale, mirror) in [
        (1.0, 1.0),
        (0.01, -1.0),
        (300.0, 1.0),
        (1e-12, 1.0),
        (1e-14, -1.0),
        (1e13, 1.0),
        (1e14, 1.0),
    ] {
        let place = Affine3A::from_scale_rotation_translation(
            Vec3::splat(scale) * Vec3::new(mirror, 1.0, 1.0),
            Quat::from_axis_angle(Vec3::new(1.0, 2.0, 3.0).normalize(), 2.0),
            Vec3::new(3.0, -2.0, 1.0) * scale,
        );
        let moved = placed(&scene(&torus, &[place]), field.clone(), LookUp::Aimed);
        let mut other = 0;
        for ray in rays(Vec3::ZERO, 1.45, 2000) {
            let there = Ray {
                origin: place.transform_point3(ray.origin),
                // Not of unit length: t counts in lengths.
                direction: place.transform_vector3(ray.direction),
                ..ray
            };
            match (still.closest_hit(&ray), moved.closest_hit(&there)) {
                (Some(a), Some(b)) => other += usize::from((a.t - b.t).abs() > 1e-3),
                (None, None) => {}
                _ => other += 1,
            }
        }
        // Rounding takes a few rays to another sample.
        assert!(other < 20, "{scale}: {other}");
    }
}

#[test]
fn instances_move_and_are_found() {
    let torus = torus("torus", 24, 12, 0.4);
    let places: Vec<Affine3A> = (0..40)
        .map(|i| {
            Affine3A::from_translation(Vec3::new(3.0 * (i % 8) as f32, 0.0, 3.0 * (i / 8) as f32))
        })
        .collect();
    let scene = scene(&torus, &places);
    let mut tracer = placed(&scene, field(&torus, &coarse()), LookUp::Aimed);
    let mut truth = exact(&scene);
    for frame in 0..2 {
        let moved: Vec<Affine3A> = places
            .iter()
            .map(|place| *place * Affine3A::from_rotation_z(frame as f32))
            .collect();
        tracer.update(&moved).unwrap();
        truth.update(&moved).unwrap();
        let [wrong, _] = errors(&tracer, &truth, &rays(Vec3::new(10.0, 0.0, 6.0), 8.0, 3000));
        assert!(wrong < 0.04, "{wrong}");
    }
    assert!(tracer.update(&places[1..]).is_err());
}

/// Rays that start on the object itself: it does not hide them from themselves.
#[test]
fn an_object_does_not_shadow_its_own_surface_all_over() {
    let torus = torus("torus", 48, 24, 0.3);
    let scene = scene(&torus, &[Affine3A::IDENTITY]);
    let truth = exact(&scene);
    let bvh =
        |scene: &Arc<Scene>| BvhTracer::build(scene, &Selection::default(), &BvhOptions::default());
    // About as many samples in all. Where there are several spheres, rays start close to others than their own part's.
    for (parts, rings) in [(1, 32), (6, 13)] {
        let params = ObjectParams {
            field: FieldParams {
                positions: Positions::Slater { rings },
                ..FieldParams::default()
            },
            parts,
            distant: false,
        };
        let object = Object::build(&scene, &torus, &params, &bvh, &|_, _| {}).unwrap();
        let objects = vec![object];
        let selection = Selection::default();
        let tracer = FieldTracer::new(&scene, &selection, objects, LookUp::Interpolated).unwrap();
        let [share, hidden] = wrong_from_surfaces(&scene, &tracer, &truth);
        eprintln!(
            "{parts} parts: {share:.3} of the rays from the surface are answered wrong, {hidden:.3} hit what is not there"
        );
        assert!(share < 0.08, "{parts} parts: {share}");
    }
}

/// The share of rays from the middles of triangles that are answered wrong, and that hit and should not.
fn wrong_from_surfaces(scene: &Scene, tracer: &FieldTracer, truth: &BvhTracer) -> [f64; 2] {
    let torus = &scene.meshes[0];
    let (mut wrong, mut hidden, mut count) = (0, 0, 0);
    for primitive in 0..torus.triangles.len() as u32 {
        let start = SurfaceId {
            instance: 0,
            primitive,
        };
        let point = scene.point_on(start, glam::Vec2::splat(0.3));
        for sample in 0..8 {
            let direction = uniform_sphere(Sampler::new(3, primitive, sample).get_2d(0));
            if direction.dot(point.geometric_normal) < 0.1 {
                continue;
            }
            let ray = Ray::new(point.lifted(direction, 0.0), direction);
            let (hits, should) = (
                tracer.any_hit_from(&ray, start),
                truth.any_hit_from(&ray, start),
            );
            wrong += u32::from(hits != should);
            hidden += u32::from(hits && !should);
            count += 1;
        }
    }
    [wrong, hidden].map(|rays| f64::from(rays) / f64::from(count))
}

/// How far off answers are, against what the field says of itself.
#[test]
fn most_answers_are_within_the_tolerance() {
    let torus = torus("torus", 48, 24, 0.45);
    let scene = scene(&torus, &[Affine3A::IDENTITY]);
    let (truth, rays) = (exact(&scene), rays(Vec3::ZERO, 1.45, 6000));
    let field = field(&torus, &coarse());
    let tolerance = field.tolerance();
    for look_up in LookUp::ALL {
        let tracer = placed(&scene, field.clone(), look_up);
        assert!((tracer.tolerance(Vec3::ZERO) / tolerance - 0.25).abs() < 1e-5);
        assert_eq!(tracer.tolerance(Vec3::X * 9.0), 0.0);
        let (mut both, mut within) = (0, [0; 2]);
        for ray in &rays {
            if let (Some(hit), Some(truth)) = (tracer.closest_hit(ray), truth.closest_hit(ray)) {
                let off = (hit.t - truth.t).abs();
                both += 1;
                within[0] += u32::from(off <= tolerance);
                within[1] += u32::from(off <= 0.25 * tolerance);
            }
        }
        let [whole, quarter] = within.map(|rays| f64::from(rays) / f64::from(both));
        eprintln!("{look_up:?}: {whole:.3} within {tolerance} m, {quarter:.3} within a quarter");
        assert!(
            whole > 0.6 && quarter > 0.3,
            "{look_up:?}: {whole} {quarter}"
        );
    }
}

/// A field of one level of detail stands for another, which has half as many triangles each way.
#[test]
fn a_field_serves_every_level_of_detail() {
    let [fine, coarser] =
        [(48, 24), (24, 12)].map(|(rings, sides)| torus("torus", rings, sides, 0.4));
    let other = torus("torus", 48, 24, 0.6);
    let field = field(&fine, &coarse());
    assert!(field.is_of(&fine) && !field.is_of(&coarser));
    assert!(field.fits(&fine) && field.fits(&coarser) && !field.fits(&other));
    let scene = scene(&coarser, &[Affine3A::IDENTITY]);
    let (truth, rays) = (exact(&scene), rays(Vec3::ZERO, 1.4, 6000));
    let own = placed(
        &scene,
        support::field(&coarser, &coarse()),
        LookUp::Interpolated,
    );
    let lent = placed(&scene, field, LookUp::Interpolated);
    let [own, lent] = [own, lent].map(|tracer| errors(&tracer, &truth, &rays));
    eprintln!("its own field {own:?}, that of the finer mesh {lent:?}");
    assert!(lent[0] < 0.04 && lent[1] < 0.05, "{own:?} {lent:?}");
}

/// Meshes that share a field hold it once.
#[test]
fn shared_fields_are_counted_once() {
    let torus = torus("torus", 24, 12, 0.4);
    let mut scene = Scene::clone(&scene(&torus, &[Affine3A::IDENTITY]));
    scene.meshes.push(torus.clone());
    let aside = Affine3A::from_translation(Vec3::X * 4.0);
    scene
        .instances
        .push(isophote_scene::Instance::new(1, aside));
    let object = Object::new(field(&torus, &coarse()));
    let (scene, bytes) = (Arc::new(scene), object.bytes());
    let objects = vec![object.clone(), object];
    let tracer = FieldTracer::new(&scene, &Selection::default(), objects, LookUp::Aimed).unwrap();
    assert!((bytes..bytes * 11 / 10).contains(&tracer.bytes()));
}

#[test]
fn fields_do_not_depend_on_threads() {
    let torus = torus("torus", 12, 8, 0.4);
    let pool = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
    };
    let files = [1, 3].map(|threads| {
        pool(threads).install(|| {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.field");
            field(&torus, &coarse()).save(&path).unwrap();
            std::fs::read(path).unwrap()
        })
    });
    assert!(files[0] == files[1]);
}

#[test]
fn progress_counts_positions() {
    use std::sync::atomic::{AtomicU64, Ordering};
    let torus = torus("torus", 12, 8, 0.4);
    let scene = Arc::new(alone(&scene(&torus, &[Affine3A::IDENTITY]), &torus));
    let last = AtomicU64::new(0);
    let progress = |done: u64, total: u64| {
        assert_eq!(total, 1090);
        last.fetch_max(done, Ordering::Relaxed);
    };
    Field::build(&torus, &exact(&scene), &coarse(), &progress).unwrap();
    assert_eq!(last.into_inner(), 1090);
}

#[test]
fn distant_instances_are_answered_by_bits() {
    let torus = torus("torus", 24, 12, 0.4);
    let scene = scene(&torus, &[Affine3A::IDENTITY]);
    let object = Object::new(field(&torus, &coarse())).with_distant();
    let words = |object: &Object| object.distant[0].bytes();
    assert_eq!(words(&object), 1090 * (1024 / 8 + 4));
    let bits = field(
        &torus,
        &FieldParams {
            storage: Storage::Bit,
            ..coarse()
        },
    );
    let only_bits = placed(&scene, bits, LookUp::Aimed);
    let objects = vec![object];
    let mut tracer =
        FieldTracer::new(&scene, &Selection::default(), objects, LookUp::Aimed).unwrap();
    let rays = rays(Vec3::ZERO, 1.4, 500);
    let agree = |tracer: &FieldTracer| {
        rays.iter()
            .all(|ray| tracer.closest_hit(ray).is_some() == only_bits.closest_hit(ray).is_some())
    };
    assert!(!agree(&tracer));
    tracer.look_from(Some((Vec3::X * 100.0, 20.0)));
    tracer.update(&scene.transforms()).unwrap();
    assert!(agree(&tracer));
    tracer.look_from(Some((Vec3::X * 10.0, 20.0)));
    tracer.update(&scene.transforms()).unwrap();
    assert!(!agree(&tracer));
}

#[test]
fn the_closest_surface_is_about_as_far_as_it_is() {
    let torus = torus("torus", 64, 32, 0.4);
    let scene = scene(
        &torus,
        &[Affine3A::from_translation(Vec3::new(5.0, 0.0, 0.0))],
    );
    let tracer = placed(&scene, field(&torus, &coarse()), LookUp::Aimed);
    for index in 0..200 {
        let sampler = Sampler::new(5, 0, index);
        let at = 3.0 * sampler.get_1d(0) * uniform_sphere(sampler.get_2d(1));
        let flat = glam::Vec2::new(at.x, at.z).length() - 1.0;
        let truth = glam::Vec2::new(flat, at.y).length() - 0.4;
        if truth < 0.05 {
            continue;
        }
        let (found, instance) = tracer.closest(at + 5.0 * Vec3::X, 100.0).unwrap();
        assert_eq!(instance, 0);
        assert!(
            found > truth - 0.05 && found < truth + 0.2 + 0.1 * truth,
            "{at}: {found} {truth}"
        );
        assert!(tracer.closest(at + 5.0 * Vec3::X, 0.5 * truth).is_none());
    }
}

#[test]
fn parts_make_a_whole() {
    let torus = torus("torus", 48, 16, 0.15);
    let parts = split(&torus, 6).unwrap();
    let triangles: usize = parts.iter().map(|part| part.triangles.len()).sum();
    assert_eq!((parts.len(), triangles), (6, torus.triangles.len()));
    let scene = scene(&torus, &[Affine3A::IDENTITY]);
    let tracer =
        |scene: &Arc<Scene>| BvhTracer::build(scene, &Selection::default(), &BvhOptions::default());
    let build = |parts, rings| {
        let params = ObjectParams {
            field: FieldParams {
                positions: Positions::Slater { rings },
                ..coarse()
            },
            parts,
            distant: false,
        };
        let object = Object::build(&scene, &torus, &params, &tracer, &|_, _| {}).unwrap();
        FieldTracer::new(
            &scene,
            &Selection::default(),
            vec![object],
            LookUp::Interpolated,
        )
        .unwrap()
    };
    let (one, six) = (build(1, 20), build(6, 8));
    assert!(six.bytes() < one.bytes() * 11 / 10);
    let (truth, rays) = (exact(&scene), rays(Vec3::ZERO, 1.2, 6000));
    let [of_one, of_six] = [&one, &six].map(|tracer| errors(tracer, &truth, &rays));
    eprintln!("one sphere {of_one:?}, six {of_six:?}");
    assert!(
        of_six[1] < of_one[1] && of_six[0] < of_one[0],
        "{of_one:?} {of_six:?}"
    );
    assert!(split(&torus, 0).is_err() && split(&torus, 65).is_err());
    let single = mesh(&[[Vec3::X, Vec3::Y, Vec3::Z]]);
    assert_eq!(split(&single, 4).unwrap().len(), 1);
}
