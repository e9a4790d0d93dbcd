//! The hybrid renderer against the reference integrators.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::sync::Arc;

use glam::Vec3;
use isophote_ldi::{Coverage, Hybrid, HybridParams, LdiParams, LdiTracer, Stages};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Scene, Selection, Tracer, builtin,
    reference::{Materials, Quantity, Settings, Tracers, render},
};

const SIZE: [u32; 2] = [48, 36];

fn bvh(scene: &Arc<Scene>) -> BvhTracer {
    BvhTracer::build(scene, &Selection::default(), &BvhOptions::default()).unwrap()
}

fn maps(scene: &Arc<Scene>, coverage: Coverage) -> LdiTracer {
    let params = LdiParams {
        coverage,
        resolution: 96,
        ..LdiParams::default()
    };
    LdiTracer::build(scene, &Selection::default(), &params).unwrap()
}

fn hybrid(
    scene: &Scene,
    exact: &BvhTracer,
    secondary: &dyn Tracer,
    params: &HybridParams,
) -> Stages {
    let tracers = Tracers { exact, secondary };
    let hybrid = Hybrid::new(scene, tracers, params).unwrap();
    hybrid.render(&scene.cameras[0], SIZE).unwrap()
}

fn reference(
    scene: &Scene,
    exact: &BvhTracer,
    quantity: Quantity,
    materials: Materials,
) -> Vec<Vec3> {
    let settings = Settings {
        samples: 512,
        materials,
        seed: 9,
        ..Settings::default()
    };
    let tracers = Tracers {
        exact,
        secondary: exact,
    };
    let camera = &scene.cameras[0];
    let quantities = [quantity];
    let quiet = |_, _| {};
    let render = render(scene, tracers, camera, SIZE, &quantities, &settings, &quiet).unwrap();
    render.estimates[0].values.clone()
}

fn mean(values: &[Vec3]) -> f32 {
    values.iter().map(|value| value.element_sum()).sum::<f32>() / (3 * values.len()) as f32
}

fn relative_rmse(values: &[Vec3], truth: &[Vec3]) -> f32 {
    let pairs = values.iter().zip(truth);
    let squares: f32 = pairs.map(|(a, b)| (*a - *b).length_squared()).sum();
    (squares / (3 * truth.len()) as f32).sqrt() / mean(truth)
}

fn unfiltered(rays: u32) -> HybridParams {
    HybridParams {
        samples: 4,
        diffuse_rays: rays,
        filter_width: 1,
        materials: Materials::Lambert,
        ..HybridParams::default()
    }
}

/// Without the filter and with many rays, one diffuse bounce is what the reference says, up to the difference between
/// shading a primitive once a pixel and everywhere. Exact layers give the very picture of the exact tracer, the paper's
/// layers one with their error.
#[test]
fn one_bounce_is_the_references() {
    let cornell = Arc::new(builtin::build("cornell").unwrap());
    let exact = bvh(&cornell);
    let truth = reference(&cornell, &exact, Quantity::Indirect, Materials::Lambert);
    let stages = hybrid(&cornell, &exact, &exact, &unfiltered(128));
    let bias = mean(&stages.diffuse) / mean(&truth) - 1.0;
    let rmse = relative_rmse(&stages.diffuse, &truth);
    assert!(bias.abs() < 0.01 && rmse < 0.25, "{bias} {rmse}");
    let flat = vec![Vec3::splat(mean(&truth)); truth.len()];
    assert!(
        relative_rmse(&flat, &truth) > 0.5,
        "the picture is not flat"
    );

    let touched = maps(&cornell, Coverage::Touched);
    assert_eq!(hybrid(&cornell, &exact, &touched, &unfiltered(128)), stages);
    let center = hybrid(
        &cornell,
        &exact,
        &maps(&cornell, Coverage::Center),
        &unfiltered(128),
    );
    let bias = mean(&center.diffuse) / mean(&stages.diffuse) - 1.0;
    let rmse = relative_rmse(&center.diffuse, &stages.diffuse);
    assert!(
        bias.abs() < 0.04 && rmse > 0.0 && rmse < 0.12,
        "{bias} {rmse}"
    );
    assert!(stages.glossy.iter().all(|light| *light == Vec3::ZERO));
}

/// The filter takes the noise of 8 rays away and leaves the mean.
#[test]
fn the_filter_removes_noise() {
    let cornell = Arc::new(builtin::build("cornell").unwrap());
    let exact = bvh(&cornell);
    let maps = maps(&cornell, Coverage::Touched);
    let plain = |rays| hybrid(&cornell, &exact, &maps, &unfiltered(rays)).diffuse;
    let (truth, noisy) = (plain(256), plain(8));
    let params = HybridParams {
        filter_width: 5,
        filter_sigma: 1.0,
        ..unfiltered(8)
    };
    let filtered = hybrid(&cornell, &exact, &maps, &params).diffuse;
    let [noisy, after] = [&noisy, &filtered].map(|light| relative_rmse(light, &truth));
    assert!(after < 0.7 * noisy, "{noisy} {after}");
    let bias = mean(&filtered) / mean(&truth) - 1.0;
    assert!(bias.abs() < 0.05, "{bias}");
}

/// Metal reflects what the reference's does: its picture of one bounce is the sum of both stages.
#[test]
fn glossy_rays_are_the_references() {
    let office = Arc::new(builtin::build("office").unwrap());
    let exact = bvh(&office);
    let params = HybridParams {
        glossy_rays: 128,
        texture_level: 0.0,
        materials: Materials::Pbr,
        ..unfiltered(128)
    };
    let stages = hybrid(&office, &exact, &maps(&office, Coverage::Touched), &params);
    assert!(mean(&stages.glossy) > 0.0);
    let truth = reference(&office, &exact, Quantity::Direct, Materials::Pbr);
    let direct = mean(&stages.direct) / mean(&truth) - 1.0;
    assert!(direct.abs() < 0.05, "{direct}");
    let truth = reference(&office, &exact, Quantity::Indirect, Materials::Pbr);
    let indirect = (mean(&stages.diffuse) + mean(&stages.glossy)) / mean(&truth) - 1.0;
    // Metal that is seen in metal reflects diffusely here, as in the paper's local lighting model.
    assert!(indirect.abs() < 0.1, "{indirect}");
}

#[test]
fn wrong_parameters_are_errors() {
    let cornell = Arc::new(builtin::build("cornell").unwrap());
    let exact = bvh(&cornell);
    let good = HybridParams::default();
    for params in [
        HybridParams { samples: 3, ..good },
        HybridParams {
            diffuse_rays: 0,
            ..good
        },
        HybridParams {
            filter_width: 4,
            ..good
        },
        HybridParams {
            filter_sigma: f32::NAN,
            ..good
        },
        HybridParams {
            texture_level: -1.0,
            ..good
        },
    ] {
        let tracers = Tracers {
            exact: &exact,
            secondary: &exact,
        };
        assert!(
            Hybrid::new(&cornell, tracers, &params).is_err(),
            "{params:?}"
        );
    }
    let tracers = Tracers {
        exact: &exact,
        secondary: &exact,
    };
    let hybrid = Hybrid::new(&cornell, tracers, &good).unwrap();
    for size in [[0, 4], [4, 0], [1 << 14, 1 << 14]] {
        assert!(hybrid.render(&cornell.cameras[0], size).is_err());
    }
}
