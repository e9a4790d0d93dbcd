//! Every exact tracer of this crate passes the suite that every tracer must pass.

use std::sync::Arc;

use glam::{Affine3A, Quat, Vec3};
use isophote_scene::{
    BruteForceTracer, BuildTracer, BvhOptions, BvhTracer, Confident, Hit, Instance, Levels, Ray,
    Scene, Selection, SurfaceId, Tracer, WithFallback, builtin,
    testing::{Tolerances, conformance},
};

/// A built-in scene with its instances copied, turned, mirrored and scaled, so that every kind of transform occurs.
fn scene(name: &str, scale: f32) -> Arc<Scene> {
    let mut scene = builtin::build(name).expect("is built in");
    let originals = scene.instances.clone();
    let place = Affine3A::from_scale_rotation_translation(
        Vec3::new(-0.5, 0.7, 0.6),
        Quat::from_rotation_y(0.7),
        Vec3::new(0.3, 0.1, -0.2),
    );
    scene
        .instances
        .extend(originals.into_iter().map(|original| Instance {
            transform: place * original.transform,
            ..original
        }));
    for instance in &mut scene.instances {
        instance.transform = Affine3A::from_scale(Vec3::splat(scale)) * instance.transform;
    }
    Arc::new(scene)
}

fn build<T: BuildTracer>(scene: &Arc<Scene>) -> T {
    T::build(scene, &Selection::default(), &T::Options::default()).expect("has triangles")
}

#[test]
fn exact_tracers_conform() {
    for scale in [1e-3, 1.0, 1e3] {
        for (name, count) in [("builtin:cornell", 2000), ("builtin:corner", 150)] {
            let scene = scene(name, scale);
            let oracle: BruteForceTracer = build(&scene);
            for levels in [Levels::Flat, Levels::Two] {
                let bvh = BvhTracer::build(
                    &scene,
                    &Selection::default(),
                    &BvhOptions {
                        levels,
                        ..BvhOptions::default()
                    },
                )
                .expect("has triangles");
                let report = conformance(&scene, &bvh, &oracle, &Tolerances::EXACT, count, 1);
                let what = format!("{name} at {scale}, {levels:?}\n{report}");
                assert!(report.violations.is_empty(), "{what}");
                assert!(
                    report.kinds.iter().all(|(_, found)| found.hits > 0),
                    "{what}"
                );
            }
        }
    }
}

/// Loses half of all rays, and knows which.
struct Lossy<'a>(&'a BvhTracer);

impl Tracer for Lossy<'_> {
    fn answers(&self) -> isophote_scene::Answers {
        self.0.answers()
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.closest_with_confidence(ray, SurfaceId::UNKNOWN).0
    }
}

impl Confident for Lossy<'_> {
    fn closest_with_confidence(&self, ray: &Ray, start: SurfaceId) -> (Option<Hit>, f32) {
        if ray.direction.x.to_bits().is_multiple_of(2) {
            (None, 0.3)
        } else {
            (self.0.closest_hit_from(ray, start), 0.7)
        }
    }
}

#[test]
fn what_is_asked_again_is_exact() {
    let scene = scene("builtin:cornell", 1.0);
    let oracle: BruteForceTracer = build(&scene);
    let exact: BvhTracer = build(&scene);
    for (least, conforms) in [(0.0, false), (0.5, true), (1.1, true)] {
        let both = WithFallback::new(Lossy(&exact), &exact, least);
        let report = conformance(&scene, &both, &oracle, &Tolerances::EXACT, 500, 5);
        let what = format!("at least {least}\n{report}");
        assert_eq!(report.violations.is_empty(), conforms, "{what}");
    }
}

type Flaw = fn(&Ray, Option<Hit>) -> Option<Hit>;

/// A tracer with one flaw each, which the suite must find.
struct Flawed<'a> {
    tracer: &'a BvhTracer,
    flaw: Flaw,
}

impl Tracer for Flawed<'_> {
    fn answers(&self) -> isophote_scene::Answers {
        self.tracer.answers()
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        (self.flaw)(ray, self.tracer.closest_hit(ray))
    }
}

#[test]
fn the_suite_finds_flaws() {
    let scene = scene("builtin:cornell", 1.0);
    let oracle: BruteForceTracer = build(&scene);
    let tracer: BvhTracer = build(&scene);
    let flaws: [Flaw; 6] = [
        |ray, hit| hit.filter(|_| ray.direction.x.to_bits() % 64 != 0),
        |_, hit| {
            hit.map(|hit| Hit {
                t: hit.t * 1.01,
                ..hit
            })
        },
        |_, hit| {
            hit.map(|hit| Hit {
                t: hit.t * 0.99,
                ..hit
            })
        },
        |ray, hit| {
            hit.or((ray.direction == Vec3::ZERO).then_some(Hit {
                t: 1.0,
                uv: glam::Vec2::ZERO,
                surface: SurfaceId::UNKNOWN,
            }))
        },
        |_, hit| {
            hit.map(|hit| Hit {
                uv: glam::Vec2::splat(0.9),
                ..hit
            })
        },
        // In metres, whatever the length of the direction.
        |ray, hit| {
            hit.map(|hit| Hit {
                t: hit.t * ray.direction.length(),
                ..hit
            })
        },
    ];
    for (index, flaw) in flaws.into_iter().enumerate() {
        let flawed = Flawed {
            tracer: &tracer,
            flaw,
        };
        let report = conformance(&scene, &flawed, &oracle, &Tolerances::EXACT, 300, 3);
        assert!(
            !report.violations.is_empty(),
            "flaw {index} was not found\n{report}"
        );
    }
}
