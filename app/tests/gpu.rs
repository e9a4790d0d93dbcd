//! The program on a GPU: what there is, rays that are answered as on the CPU, and pictures that are the same.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "a test's helpers may fail the test")]

use std::{
    fs,
    io::Write,
    path::Path,
    process::{Command, Output},
};

use assert_cmd::cargo::cargo_bin;
use serde_json::Value;

fn run(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(cargo_bin!("isophote"))
        .args(arguments)
        .current_dir(folder)
        .env_remove("RUST_LOG")
        .output()
        .unwrap()
}

fn json(folder: &Path, arguments: &[&str]) -> Value {
    let output = run(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {said}");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The adapters; none, loudly, where there are none and none is required.
fn adapters(folder: &Path) -> Vec<Value> {
    let report = json(folder, &["devices", "--json"]);
    assert!(report["threads"].as_u64().unwrap() > 0);
    let adapters = report["adapters"].as_array().unwrap().clone();
    if adapters.is_empty() {
        let required = std::env::var_os("ISOPHOTE_REQUIRE_GPU").is_some_and(|value| value == "1");
        assert!(!required, "a GPU adapter is required, but there is none");
        let _ = writeln!(std::io::stderr(), "SKIPPED a GPU test: there is no adapter");
    }
    adapters
}

/// The numbers of a hits file of version 1, five a ray.
fn hits(path: &Path) -> Vec<f32> {
    let bytes = fs::read(path).unwrap();
    let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let numbers = bytes[header..].chunks_exact(4);
    numbers
        .map(|four| f32::from_le_bytes(four.try_into().unwrap()))
        .collect()
}

#[test]
fn gpu_tracers_answer_as_the_cpu_does() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let Some(adapter) = adapters(at).into_iter().next() else {
        return;
    };
    let scene = "builtin:cornell";
    let make = [
        "trace",
        scene,
        "--make=diffuse",
        "--count=3000",
        "-q",
        "-o",
        "rays.npy",
    ];
    assert!(run(at, &make).status.success());
    let trace = ["trace", scene, "--rays=rays.npy", "--json"];
    json(
        at,
        &[&trace[..], &["--tracer=bvh", "-o", "exact.npy"]].concat(),
    );
    let exact = hits(&at.join("exact.npy"));
    let mut tracers = vec!["compute-bvh"];
    if adapter["ray_query"].as_str().unwrap().starts_with("passed") {
        tracers.push("ray-query");
    }
    let name = adapter["name"].as_str().unwrap();
    for tracer in tracers {
        let chosen = ["--device=gpu", "--tracer", tracer, "--adapter", name];
        let report = json(at, &[&trace[..], &chosen, &["-o", "hits.npy"]].concat());
        assert!(
            report["device"].as_str().unwrap().contains(name),
            "{report}"
        );
        let found = hits(&at.join("hits.npy"));
        assert_eq!(found.len(), exact.len());
        let differ = |(a, b): &(&[f32], &[f32])| {
            a[0].is_finite() != b[0].is_finite() || (a[0] - b[0]).abs() > 1e-4 * b[0] + 1e-6
        };
        let rows = found.chunks_exact(5).zip(exact.chunks_exact(5));
        assert_eq!(rows.filter(differ).count(), 0, "{tracer}");
        let report = json(
            at,
            &[&trace[..], &chosen, &["--mode=any", "-o", "any.npy"]].concat(),
        );
        let expected = exact
            .chunks_exact(5)
            .filter(|row| row[0].is_finite())
            .count();
        assert_eq!(report["hits"], expected, "{tracer}");
    }
}

#[test]
fn a_gpu_renders_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let Some(adapter) = adapters(at).into_iter().next() else {
        return;
    };
    let name = adapter["name"].as_str().unwrap();
    let render = [
        "render",
        "builtin:cornell",
        "--quantity=ao",
        "--d-max=0.3",
        "--size=40x30",
        "--spp=5",
        "--json",
    ];
    let on_cpu = json(
        at,
        &[&render[..], &["--device=cpu", "-o", "cpu.exr"]].concat(),
    );
    let chosen = ["--device=gpu", "--adapter", name, "-o", "gpu.exr"];
    let on_gpu = json(at, &[&render[..], &chosen].concat());
    assert_eq!(on_cpu["settings"]["tracer"], "bvh");
    assert_eq!(on_gpu["settings"]["tracer"], "compute-bvh");
    assert!(
        on_gpu["device"].as_str().unwrap().contains(name),
        "{on_gpu}"
    );
    let ratio = |key: &str| on_gpu[key].as_f64().unwrap() / on_cpu[key].as_f64().unwrap();
    assert!((ratio("rays") - 1.0).abs() < 1e-2, "{on_gpu} {on_cpu}");
    let compared = json(at, &["compare", "gpu.exr", "cpu.exr", "--json"]);
    let rms = compared["grey_rms"].as_f64().unwrap();
    assert!(rms < 1.0, "{compared}");
    // The header repeats the picture on the device that it came from.
    let again = [
        "render",
        "--settings=gpu.exr",
        "--size=8x6",
        "--json",
        "-o",
        "again.exr",
    ];
    let again = json(at, &again);
    assert_eq!(again["settings"]["tracer"], "compute-bvh");
}

/// Fields of what has many triangles, and triangles of what has few, next to each other.
#[test]
fn fields_render_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let Some(adapter) = adapters(at).into_iter().next() else {
        return;
    };
    let name = adapter["name"].as_str().unwrap();
    let render = [
        "render",
        "builtin:corner",
        "--quantity=ao",
        "--tracer=field",
        "--field-rings=8",
        "--field-distant=20",
        "--size=40x30",
        "--spp=5",
        "--json",
    ];
    json(
        at,
        &[&render[..], &["--device=cpu", "-o", "cpu.exr"]].concat(),
    );
    let chosen = ["--device=gpu", "--adapter", name, "-o", "gpu.exr"];
    let on_gpu = json(at, &[&render[..], &chosen].concat());
    assert_eq!(on_gpu["settings"]["tracer"], "field");
    let compared = json(at, &["compare", "gpu.exr", "cpu.exr", "--json"]);
    let rms = compared["grey_rms"].as_f64().unwrap();
    // Rounding decides at the borders of cells and of triangles, for a few of five samples a pixel.
    assert!(rms < 3.0, "{compared}");
}

#[test]
fn the_technique_ldi_renders_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let Some(adapter) = adapters(at).into_iter().next() else {
        return;
    };
    let name = adapter["name"].as_str().unwrap();
    let render = [
        "render",
        "builtin:cornell",
        "--technique=ldi",
        "--size=24x18",
        "--ldi-cells=2",
        "--ldi-resolution=32",
        "--ldi-light-rays=2",
        "--json",
    ];
    let on_cpu = json(
        at,
        &[&render[..], &["--device=cpu", "-o", "cpu.exr"]].concat(),
    );
    let chosen = ["--device=gpu", "--adapter", name, "-o", "gpu.exr"];
    let on_gpu = json(at, &[&render[..], &chosen].concat());
    assert_eq!(on_gpu["settings"]["tracer"], "ldi");
    assert!(
        on_gpu["device"].as_str().unwrap().contains(name),
        "{on_gpu}"
    );
    // The GPU rasterises what the camera's rays find.
    let camera = on_cpu["passes"][0]["rays"].as_f64().unwrap();
    let [found, expected] = [&on_gpu, &on_cpu].map(|report| report["rays"].as_f64().unwrap());
    assert!((found / (expected - camera) - 1.0).abs() < 1e-2, "{on_gpu}");
    for layer in ["", "direct", "diffuse", "irradiance.indirect"] {
        let compare = ["compare", "gpu.exr", "cpu.exr", "--json"];
        let layer: &[&str] = match layer {
            "" => &[],
            layer => &["--layer", layer],
        };
        let compared = json(at, &[&compare[..], layer].concat());
        let error = compared["rel_rmse"].as_f64().unwrap();
        assert!(error < 0.03, "{layer:?}: {compared}");
    }
}

#[test]
fn the_technique_igi_renders_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let Some(adapter) = adapters(at).into_iter().next() else {
        return;
    };
    let name = adapter["name"].as_str().unwrap();
    let render = [
        "render",
        "builtin:cornell",
        "--technique=igi",
        "--size=48x36",
        "--igi-paths=60",
        "--igi-bounces=2",
        "--igi-downsampling=2",
        "--igi-interleaving=2x2",
        "--json",
    ];
    let on_cpu = json(
        at,
        &[&render[..], &["--device=cpu", "-o", "cpu.exr"]].concat(),
    );
    let chosen = ["--device=gpu", "--adapter", name, "-o", "gpu.exr"];
    let on_gpu = json(at, &[&render[..], &chosen].concat());
    assert_eq!(on_gpu["settings"]["tracer"], "compute-bvh");
    let [found, expected] = [&on_gpu, &on_cpu].map(|report| report["rays"].as_f64().unwrap());
    assert!((found / expected - 1.0).abs() < 5e-3, "{on_gpu}");
    for layer in ["", "direct", "indirect", "irradiance.indirect"] {
        let compare = ["compare", "gpu.exr", "cpu.exr", "--json"];
        let layer: &[&str] = match layer {
            "" => &[],
            layer => &["--layer", layer],
        };
        let compared = json(at, &[&compare[..], layer].concat());
        let error = compared["rel_rmse"].as_f64().unwrap();
        assert!(error < 5e-3, "{layer:?}: {compared}");
    }
    // Through maps.
    let maps = ["--tracer=ldi", "--ldi-cells=2", "--ldi-resolution=64"];
    for device in ["cpu", "gpu"] {
        let output = format!("maps_{device}.exr");
        let device = format!("--device={device}");
        json(
            at,
            &[&render[..], &maps, &[&device, "-o", &output]].concat(),
        );
    }
    let compared = json(at, &["compare", "maps_gpu.exr", "maps_cpu.exr", "--json"]);
    assert!(compared["rel_rmse"].as_f64().unwrap() < 0.02, "{compared}");
    // Imperfect visibility: the camera and direct light see triangles.
    let boxes = ["--tracer=compute-boxes", "-o", "boxes.exr"];
    json(at, &[&render[..], &boxes, &["--adapter", name]].concat());
    let compare = ["compare", "boxes.exr", "cpu.exr", "--json"];
    let error = |layer| {
        let compared = json(at, &[&compare[..], &["--layer", layer]].concat());
        compared["rel_rmse"].as_f64().unwrap()
    };
    assert!(error("direct") < 5e-3 && error("indirect") > 0.0);
}

/// Horizons that a GPU follows over the depths it finds.
#[test]
fn the_technique_ldm_follows_the_same_horizons() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let Some(adapter) = adapters(at).into_iter().next() else {
        return;
    };
    let name = adapter["name"].as_str().unwrap();
    let render = [
        "render",
        "builtin:cornell",
        "--technique=ldm",
        "--ldm-occlusion=hbao",
        "--quantity=ao,obscurance",
        "--d-max=0.2",
        "--size=40x30",
        "--ldm-samples=4",
        "--json",
    ];
    json(at, &[&render[..], &["-o", "cpu.exr"]].concat());
    let chosen = ["--device=gpu", "--adapter", name, "-o", "gpu.exr"];
    let on_gpu = json(at, &[&render[..], &chosen].concat());
    let passes = on_gpu["passes"].as_array().unwrap();
    assert!(
        passes.iter().any(|pass| pass["name"] == "depths"),
        "{on_gpu}"
    );
    for layer in ["ao", "obscurance"] {
        let compare = ["compare", "gpu.exr", "cpu.exr", "--json", "--layer", layer];
        let error = json(at, &compare)["grey_rms"].as_f64().unwrap();
        println!("{layer}: {error} grey levels");
        assert!(error < 0.5, "{layer}: {error} grey levels");
    }
}

/// Layered depth maps that a GPU draws: light of a lamp and a sky, straight and bounced, splatted and gathered.
#[test]
fn the_technique_ldm_renders_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let Some(adapter) = adapters(at).into_iter().next() else {
        return;
    };
    let name = adapter["name"].as_str().unwrap();
    let quantities = "direct,path,irradiance.direct,irradiance.path";
    let render = [
        "render",
        "--technique=ldm",
        "--environment=0.4,0.5,0.7",
        "--quantity",
        quantities,
        "--size=40x30",
        "--ldm-maps=48",
        "--ldm-resolution=100",
        "--ldm-samples=4",
        "--ldm-photons=16",
        "--json",
    ];
    let splatted = [
        "builtin:cornell",
        "--ldm-deposit=splatted",
        "--ldm-bounces=2",
        "--ldm-branches=2",
        "--ldm-glossy=none",
    ];
    let gathered = [
        "builtin:office",
        "--ldm-glossy=nearest",
        "--ldm-deposit=gathered",
        "--ldm-bounces=2",
        "--ldm-branches=2",
        "--ldm-direct=photons",
    ];
    // Of what metals show every edge is where a map has it.
    for (more, most) in [(&splatted[..], 1e-3), (&gathered, 5e-3)] {
        let chosen = ["--device=cpu", "-o", "cpu.exr"];
        json(at, &[&render[..], more, &chosen].concat());
        let chosen = ["--device=gpu", "--adapter", name, "-o", "gpu.exr"];
        let on_gpu = json(at, &[&render[..], more, &chosen].concat());
        assert_eq!(on_gpu["settings"]["tracer"], "compute-bvh");
        assert!(
            on_gpu["device"].as_str().unwrap().contains(name),
            "{on_gpu}"
        );
        for layer in quantities.split(',') {
            let compare = ["compare", "gpu.exr", "cpu.exr", "--json", "--layer", layer];
            let compared = json(at, &compare);
            let error = compared["rel_rmse"].as_f64().unwrap();
            println!("{more:?} {layer}: {error}");
            assert!(error < most, "{more:?} {layer:?}: {compared}");
        }
    }
}

/// Splats are the same light by tiles and by quads.
#[test]
fn the_technique_ldm_splats_in_both_ways() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let Some(adapter) = adapters(at).into_iter().next() else {
        return;
    };
    let name = adapter["name"].as_str().unwrap();
    for way in ["tiled", "quads"] {
        let splat = format!("--ldm-splat={way}");
        let output = format!("{way}.exr");
        let render = [
            "render",
            "builtin:cornell",
            "--technique=ldm",
            "--quantity=indirect",
            "--size=24x18",
            "--ldm-maps=16",
            "--ldm-resolution=32",
            "--ldm-photons=8",
            "--ldm-deposit=splatted",
            "--ldm-spread=turned",
            "--device=gpu",
            "--adapter",
            name,
            &splat,
            "--json",
            "-o",
            &output,
        ];
        json(at, &render);
    }
    let compared = json(at, &["compare", "quads.exr", "tiled.exr", "--json"]);
    assert!(compared["rel_rmse"].as_f64().unwrap() < 1e-4, "{compared}");
}

#[test]
fn wrong_devices_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let make = [
        "trace",
        "builtin:cornell",
        "--make=diffuse",
        "--count=10",
        "-q",
        "-o",
        "rays.npy",
    ];
    assert!(run(at, &make).status.success());
    for (choice, expected) in [
        (&["--device=gpu", "--tracer=bvh"][..], "runs on the CPU"),
        (&["--device=cpu", "--tracer=boxes"], "runs on a GPU"),
        (&["--adapter=llvmpipe", "--tracer=bvh"], "runs on the CPU"),
        (&["--device=gpu", "--adapter=No Such GPU"], "No Such GPU"),
    ] {
        let trace = [
            "trace",
            "builtin:cornell",
            "--rays=rays.npy",
            "-o",
            "hits.npy",
        ];
        let output = run(at, &[&trace[..], choice].concat());
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{choice:?}: {said}");
        assert!(said.contains(expected), "{choice:?}: {said}");
        assert!(!at.join("hits.npy").exists(), "{choice:?}");
        let render = ["render", "builtin:cornell", "--size=8x6", "-o", "p.exr"];
        let output = run(at, &[&render[..], choice].concat());
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{choice:?}: {said}");
        assert!(
            said.contains(expected) && said.lines().count() == 1,
            "{choice:?}: {said}"
        );
        assert!(!at.join("p.exr").exists(), "{choice:?}");
    }
}
