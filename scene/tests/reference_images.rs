//! The reference integrators against pictures that another renderer made of real scenes.
//!
//! A few pictures with few samples, so that the test is quick; `cargo xtask reference` compares all of them.

use std::{path::PathBuf, sync::Arc};

use glam::Vec3;
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Image, Selection, load,
    reference::{Materials, Quantity, Settings, Tracers, render},
};

fn shared() -> Option<PathBuf> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared"));
    if folder.join("references").is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: there is no ../shared/references to compare with");
    None
}

/// Errors beyond the noise of both pictures (RMS) and of the mean, both relative to the reference's mean.
fn errors(ours: &[Vec3], noise: f32, reference: &[Vec3], reference_noise: f64) -> (f64, f64) {
    assert_eq!(ours.len(), reference.len());
    let (mut squares, mut sum, mut reference_sum) = (0.0, 0.0, 0.0);
    for (a, b) in ours.iter().zip(reference) {
        let (a, b) = (a.as_dvec3(), b.as_dvec3());
        squares += (a - b).length_squared();
        sum += a.element_sum();
        reference_sum += b.element_sum();
    }
    let count = 3.0 * ours.len() as f64;
    let measured = (squares / count).sqrt() / (reference_sum / count);
    let noise = f64::from(noise);
    let beyond = (measured.powi(2) - noise.powi(2) - reference_noise.powi(2))
        .max(0.0)
        .sqrt();
    (beyond, sum / reference_sum - 1.0)
}

#[test]
fn real_scenes() {
    let Some(shared) = shared() else { return };
    let pictures = [
        (
            "cornell_original",
            "lambert",
            &[
                (Quantity::Direct, "direct"),
                (Quantity::Indirect, "indirect"),
                (Quantity::Path, "path"),
                (Quantity::Ao, "ao_0.5m"),
            ][..],
        ),
        ("cornell_mirror", "pbr", &[(Quantity::Path, "path")]),
        ("bunny", "lambert", &[(Quantity::Direct, "direct")]),
    ];
    for (name, materials, wanted) in pictures {
        let scene = Arc::new(load(&shared.join(format!("scenes/{name}.glb"))).expect("loads"));
        let tracer = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default())
            .expect("builds");
        let camera = scene.camera("camera_main").expect("has it");
        let pbr = materials == "pbr";
        for &(quantity, file) in wanted {
            let stem = format!("references/{name}{}.{file}", if pbr { ".pbr" } else { "" });
            let reference = Image::load(shared.join(format!("{stem}.exr"))).expect("loads");
            let json = std::fs::read(shared.join(format!("{stem}.json"))).expect("is there");
            let json: serde_json::Value = serde_json::from_slice(&json).expect("is JSON");
            let settings = Settings {
                d_max: json["d_max"]
                    .as_f64()
                    .map_or(f32::INFINITY, |d_max| d_max as f32),
                materials: if pbr {
                    Materials::Pbr
                } else {
                    Materials::Lambert
                },
                samples: if quantity.is_occlusion() { 32 } else { 8 },
                ..Settings::default()
            };
            let tracers = Tracers {
                exact: &tracer,
                secondary: &tracer,
            };
            let size = [reference.width, reference.height];
            let picture = render(
                &scene,
                tracers,
                camera,
                size,
                &[quantity],
                &settings,
                &|_, _| {},
            )
            .expect("valid");
            let estimate = &picture.estimates[0];
            let reference_noise = json["relative_noise"].as_f64().expect("is a number");
            let reference = reference.rgb("").expect("has R, G and B");
            let (error, bias) = errors(
                &estimate.values,
                estimate.noise,
                &reference,
                reference_noise,
            );
            eprintln!("{stem}: {error:.4} beyond the noise, bias {bias:+.4}");
            if quantity.is_occlusion() {
                // In grey levels, as occlusion is counted.
                let mean = reference
                    .iter()
                    .map(|value| f64::from(value.x))
                    .sum::<f64>()
                    / reference.len() as f64;
                assert!(
                    255.0 * mean * error <= 1.5 && (255.0 * mean * bias).abs() <= 0.5,
                    "{stem}"
                );
            } else {
                assert!(error <= 0.04 && bias.abs() <= 0.01, "{stem}");
            }
        }
    }
}
