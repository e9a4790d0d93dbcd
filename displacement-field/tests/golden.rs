//! Fields are as near to exact rays as they were, and take no more bytes in files.
//!
//! `ISOPHOTE_GOLDEN=write cargo test -p isophote-displacement-field --test golden` writes what is measured into `golden.json`.
#![expect(clippy::unwrap_used, reason = "tests")]

mod support;

use std::{collections::BTreeMap, path::Path};

use glam::{Affine3A, Vec3};
use isophote_displacement_field::{
    Directions, FieldParams, FieldTracer, LookUp, Object, Positions, Storage,
};
use isophote_scene::{
    Ray, Selection, Tracer,
    sample::{Sampler, uniform_sphere},
    testing::{Golden, Metrics},
};

/// Everything may be smaller.
const WORSE: f64 = 1.05;

/// From all around the object and from within its sphere.
fn rays() -> Vec<Ray> {
    (0..20_000)
        .map(|index| {
            let sampler = Sampler::new(21, 0, index);
            let away = 2.5 * sampler.get_1d(1).cbrt();
            let from = away * uniform_sphere(sampler.get_2d(0));
            let to = uniform_sphere(sampler.get_2d(2)) * sampler.get_1d(3);
            Ray::new(from, (to - from).normalize_or(Vec3::X))
        })
        .collect()
}

fn measure() -> BTreeMap<String, Metrics> {
    let torus = support::torus("torus", 48, 24, 0.4);
    let scene = support::scene(&torus, &[Affine3A::IDENTITY]);
    let (exact, rays) = (support::exact(&scene), rays());
    let truth: Vec<_> = rays.iter().map(|ray| exact.closest_hit(ray)).collect();
    let mut cases = BTreeMap::new();
    for (name, positions, directions, storage) in [
        (
            "byte",
            Positions::Slater { rings: 16 },
            Directions::Concentric,
            Storage::Byte,
        ),
        (
            "word",
            Positions::Slater { rings: 16 },
            Directions::Concentric,
            Storage::Word,
        ),
        (
            "bit",
            Positions::Slater { rings: 16 },
            Directions::Concentric,
            Storage::Bit,
        ),
        (
            "rejection",
            Positions::Slater { rings: 16 },
            Directions::Rejection,
            Storage::Byte,
        ),
        (
            "polar",
            Positions::PAPER_SPHERICAL,
            Directions::Polar,
            Storage::Byte,
        ),
        (
            "octahedral",
            Positions::Octahedral { side: 33 },
            Directions::Concentric,
            Storage::Byte,
        ),
    ] {
        let params = FieldParams {
            positions,
            directions,
            storage,
            ..FieldParams::default()
        };
        let field = support::field(&torus, &params);
        let mut metrics = Metrics::new();
        let share = field.coded_bytes() as f64 / field.bytes() as f64;
        metrics.insert("coded share".to_owned(), share);
        for look_up in LookUp::ALL {
            let object = Object::new(field.clone());
            let tracer =
                FieldTracer::new(&scene, &Selection::default(), vec![object], look_up).unwrap();
            let mut found = vec![None; rays.len()];
            tracer.closest_hits(&rays, &mut found);
            let (mut wrong, mut off, mut both) = (0.0, 0.0, 0.0);
            for (found, truth) in found.iter().zip(&truth) {
                match (found, truth) {
                    (Some(a), Some(b)) => {
                        off += f64::from((a.t - b.t).abs());
                        both += 1.0;
                    }
                    (None, None) => {}
                    _ => wrong += 1.0,
                }
            }
            metrics.insert(format!("{look_up:?}: wrong"), wrong / rays.len() as f64);
            metrics.insert(format!("{look_up:?}: off"), off / both);
        }
        cases.insert(name.to_owned(), metrics);
    }
    cases
}

#[test]
fn fields_are_as_good_as_they_were() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden.json");
    let golden = Golden {
        file: &path,
        same: 0.0,
        worse: WORSE,
    };
    golden.check(&measure());
}
