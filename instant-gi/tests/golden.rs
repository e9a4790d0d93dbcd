//! Pictures of built-in scenes are as bright as they were, and shortcuts cost no more truth than they did.
//!
//! `ISOPHOTE_GOLDEN=write cargo test -p isophote-instant-gi --test golden` writes what is measured into `golden.json`.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::{path::Path, sync::Arc};

use isophote_instant_gi::{Filter, GiParams, InstantGi, Stages};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Leaves, Scene, Selection, builtin,
    reference::Tracers,
    testing::{Golden, Metrics, mean, relative_rmse},
};

const SIZE: [u32; 2] = [80, 60];
const SCENES: [&str; 3] = ["cornell", "corner", "office"];
/// Means are the same up to rounding, which decides where light falls on an edge.
const SAME: f64 = 0.01;
/// Errors may be smaller.
const WORSE: f64 = 1.1;

fn render(scene: &Scene, exact: &BvhTracer, secondary: &BvhTracer, params: &GiParams) -> Stages {
    let gi = InstantGi::new(scene, Tracers { exact, secondary }, params).unwrap();
    gi.render(&scene.cameras[0], SIZE, &|_, _| {}).unwrap()
}

/// Means of the stages, and what each shortcut adds to the error.
fn measure(name: &str) -> Metrics {
    let scene = Arc::new(builtin::build(name).unwrap());
    let exact = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default()).unwrap();
    let boxes = exact.with_leaves(Leaves::Boxes);
    let plain = GiParams {
        paths: 90,
        ..GiParams::default()
    };
    let truth = render(&scene, &exact, &exact, &plain);
    let mut metrics = Metrics::new();
    for (stage, light) in [
        ("direct", &truth.direct),
        ("specular", &truth.specular),
        ("indirect", &truth.indirect),
        ("picture", &truth.picture),
    ] {
        metrics.insert(format!("mean of {stage}"), mean(light));
    }
    let hidden = render(&scene, &exact, &boxes, &plain);
    let error = relative_rmse(&hidden.irradiance, &truth.irradiance);
    metrics.insert("error of boxes".to_owned(), error);
    for (what, downsampling, interleaving, filter) in [
        ("downsampling, paper", 4, [1, 1], Filter::Paper),
        ("downsampling", 4, [1, 1], Filter::Edges),
        ("interleaving, paper", 1, [3, 3], Filter::Paper),
        ("interleaving", 1, [3, 3], Filter::Edges),
        ("interleaving, filled", 1, [3, 3], Filter::Fill),
        ("both, paper", 2, [2, 2], Filter::Paper),
        ("both", 2, [2, 2], Filter::Edges),
        ("both, filled", 2, [2, 2], Filter::Fill),
    ] {
        let params = GiParams {
            downsampling,
            interleaving,
            filter,
            ..plain
        };
        let stages = render(&scene, &exact, &exact, &params);
        let error = relative_rmse(&stages.irradiance, &truth.irradiance);
        metrics.insert(format!("error of {what}"), error);
    }
    metrics
}

#[test]
fn pictures_are_as_they_were() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden.json");
    let now = SCENES.map(|name| (name.to_owned(), measure(name))).into();
    let golden = Golden {
        file: &path,
        same: SAME,
        worse: WORSE,
    };
    golden.check(&now);
}

/// In every scene tiles whose gaps are filled are nearer to the truth than the paper's.
#[test]
fn filled_gaps_are_nearer_to_the_truth() {
    for name in SCENES {
        let metrics = measure(name);
        let [filled, paper] =
            ["filled", "paper"].map(|filter| metrics[&format!("error of interleaving, {filter}")]);
        assert!(filled < 0.8 * paper, "{name}: {filled} {paper}");
    }
}
