//! The hybrid renderer's pictures of built-in scenes, and of real ones where there are any in `../shared/scenes`, are as
//! bright as they were, and no further from the exact ones.
//!
//! `ISOPHOTE_GOLDEN=write cargo test -p isophote-ldi --test golden` writes what is measured into `golden.json`.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::{collections::BTreeMap, path::Path, sync::Arc};

use glam::Vec3;
use isophote_ldi::{Coverage, Hybrid, HybridParams, LdiParams, LdiTracer, Stages};
use isophote_scene::{
    Aabb, BuildTracer, BvhOptions, BvhTracer, Scene, Selection, Tracer, builtin, load,
    reference::Tracers,
    testing::{Golden, Metrics, mean, relative_rmse},
};

const SIZE: [u32; 2] = [40, 30];
const SCENES: [&str; 3] = ["cornell", "corner", "office"];
/// Files, and the bounds that the maps are fitted to.
const FILES: [(&str, Option<Aabb>); 3] = [
    ("cornell_glossy.glb", None),
    ("sponza_dabrovic.glb", None),
    // The nave: the file holds the houses around it too.
    (
        "sibenik.glb",
        Some(Aabb {
            min: Vec3::new(-20.0, -2.0, -9.0),
            max: Vec3::new(28.0, 31.0, 9.0),
        }),
    ),
];
const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/scenes");
/// Means are the same up to rounding, which decides where light falls on an edge.
const SAME: f64 = 0.01;
/// Errors may be smaller.
const WORSE: f64 = 1.1;

fn render(
    scene: &Scene,
    exact: &BvhTracer,
    secondary: &dyn Tracer,
    params: &HybridParams,
) -> Stages {
    let tracers = Tracers { exact, secondary };
    let hybrid = Hybrid::new(scene, tracers, params).unwrap();
    hybrid.render(&scene.cameras[0], SIZE, &|_, _| {}).unwrap()
}

/// Means of the stages, what each kind of layers gets wrong, and what each filter does.
fn measure(scene: Scene, bounds: Option<Aabb>) -> Metrics {
    let scene = Arc::new(scene);
    let everything = Selection::default();
    let inside = Selection {
        bounds,
        ..everything
    };
    let exact = BvhTracer::build(&scene, &everything, &BvhOptions::default()).unwrap();
    let paper = HybridParams::default();
    let truth = render(&scene, &exact, &exact, &paper);
    let many = HybridParams {
        diffuse_rays: 128,
        light_rays: 1,
        filter_width: 1,
        ..paper
    };
    let converged = render(&scene, &exact, &exact, &many);
    let plain = HybridParams {
        edges: None,
        ..paper
    };
    let blurred = render(&scene, &exact, &exact, &plain);
    let mut metrics = Metrics::new();
    for (stage, light) in [
        ("direct", &truth.direct),
        ("diffuse", &truth.diffuse),
        ("glossy", &truth.glossy),
        ("picture", &truth.picture),
    ] {
        metrics.insert(format!("mean of {stage}"), mean(light));
    }
    for (filter, light) in [("edges", &truth), ("nowhere", &blurred)] {
        let error = relative_rmse(&light.diffuse, &converged.diffuse);
        metrics.insert(format!("error of the filter that stops at {filter}"), error);
    }
    for (layers, coverage) in [("touched", Coverage::Touched), ("center", Coverage::Center)] {
        let params = LdiParams {
            resolution: 64,
            coverage,
            ..LdiParams::default()
        };
        let maps = LdiTracer::build(&scene, &inside, &params).unwrap();
        let stages = render(&scene, &exact, &maps, &paper);
        let error = relative_rmse(&stages.picture, &truth.picture);
        metrics.insert(format!("error of layers {layers}"), error);
    }
    metrics
}

#[test]
fn pictures_are_as_they_were() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden.json");
    let built_in = SCENES.map(|name| {
        (
            name.to_owned(),
            measure(builtin::build(name).unwrap(), None),
        )
    });
    let mut now = BTreeMap::from(built_in);
    for (name, bounds) in FILES {
        let file = Path::new(FOLDER).join(name);
        if file.exists() {
            now.insert(name.to_owned(), measure(load(&file).unwrap(), bounds));
        } else {
            eprintln!("skipped: there is no {}", file.display());
        }
    }
    let golden = Golden {
        file: &path,
        same: SAME,
        worse: WORSE,
    };
    golden.check(&now);
}
