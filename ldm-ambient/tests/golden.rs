//! Occlusion is as near to the reference as it was, maps have as many layers, and nothing takes more memory.
//!
//! `ISOPHOTE_GOLDEN=write cargo test -p isophote-ldm-ambient --test golden` writes what is measured into `golden.json`.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::{collections::BTreeMap, fs, path::Path, sync::Arc};

use isophote_ldm_ambient::{
    LdmTracer, MapParams, OcclusionParams,
    cpu::{Points, Triangles, hbao, occlusion::Occlusion},
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Scene, Selection, builtin,
    reference::{Normals, Quantity, Settings, Tracers, render},
};

/// Everything may be smaller.
const WORSE: f64 = 1.03;
const SIZE: [u32; 2] = [64, 48];
const SAMPLES: u32 = 4;

type Metrics = BTreeMap<String, f64>;

const MAPS: MapParams = MapParams {
    maps: 128,
    resolution: 120,
    tolerance: 0.3,
    max_bytes: 1 << 30,
};

fn measure() -> Metrics {
    let mut metrics = Metrics::new();
    for (name, reaches) in [
        ("cornell", &[f32::INFINITY, 0.3][..]),
        ("office", &[f32::INFINITY, 2.0, 0.3]),
    ] {
        let scene = Arc::new(builtin::build(name).unwrap());
        let exact =
            BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default()).unwrap();
        let stored = LdmTracer::build(&scene, &Selection::default(), &MAPS).unwrap();
        metrics.insert(format!("{name}: layers"), stored.layers() as f64);
        metrics.insert(format!("{name}: stored bytes"), stored.bytes() as f64);
        for &d_max in reaches {
            of_reach(&mut metrics, name, &scene, &exact, d_max);
        }
    }
    metrics
}

/// RMS of maps and of the screen-space baseline, grey levels, and the bytes of the former.
fn of_reach(metrics: &mut Metrics, name: &str, scene: &Arc<Scene>, exact: &BvhTracer, d_max: f32) {
    let camera = &scene.cameras[0];
    let settings = Settings {
        samples: 512,
        d_max,
        ..Settings::default()
    };
    let tracers = Tracers {
        exact,
        secondary: exact,
    };
    let truth = render(
        scene,
        tracers,
        camera,
        SIZE,
        &[Quantity::Ao],
        &settings,
        &|_, _| {},
    );
    let truth = truth.unwrap().estimates.remove(0).values;
    let rms = |found: &[f32]| {
        let squares = found
            .iter()
            .zip(&truth)
            .map(|(a, b)| f64::from(a - b.x).powi(2));
        255.0 * (squares.sum::<f64>() / truth.len() as f64).sqrt()
    };
    let triangles = Triangles::new(scene, &scene.transforms(), &Selection::default()).unwrap();
    let params = OcclusionParams {
        maps: MAPS,
        d_max,
        ..OcclusionParams::default()
    };
    let mut occlusion = Occlusion::new(&triangles, truth.len(), &params).unwrap();
    let mut screen = vec![0.0; truth.len()];
    let baseline = hbao::HbaoParams {
        d_max,
        directions: 4,
        ..hbao::HbaoParams::default()
    };
    let depths = d_max
        .is_finite()
        .then(|| hbao::Depths::see(scene, exact, camera, SIZE, &baseline).unwrap());
    for sample in 0..SAMPLES {
        let points = Points::from_camera(scene, exact, camera, SIZE, sample, Normals::Smooth);
        occlusion.add(&points, [sample, SAMPLES], &|_, _| {});
        if let Some(depths) = &depths {
            let skies = hbao::hbao(&points, depths, sample, &baseline).unwrap();
            for (sum, sky) in screen.iter_mut().zip(skies) {
                *sum += sky.ao / SAMPLES as f32;
            }
        }
    }
    let open: Vec<f32> = occlusion.skies().iter().map(|sky| sky.ao).collect();
    metrics.insert(format!("{name}, {d_max} m: maps"), rms(&open));
    if d_max.is_finite() {
        metrics.insert(format!("{name}, {d_max} m: HBAO"), rms(&screen));
    }
}

#[test]
fn occlusion_is_as_good_as_it_was() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden.json");
    let now = measure();
    if std::env::var_os("ISOPHOTE_GOLDEN").is_some_and(|what| what == "write") {
        fs::write(&path, serde_json::to_string_pretty(&now).unwrap() + "\n").unwrap();
        return;
    }
    let golden: Metrics = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    assert!(now.keys().eq(golden.keys()));
    for (name, value) in now {
        let was = golden[&name];
        assert!(
            value <= WORSE * was + 1e-6,
            "{name} was {was} and is {value}"
        );
    }
}
