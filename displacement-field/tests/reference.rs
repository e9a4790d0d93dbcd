//! Ambient occlusion with fields against pictures made by another renderer, and against exact rays.
#![expect(clippy::unwrap_used, reason = "tests")]

mod support;

use std::{path::Path, sync::Arc};

use glam::Vec3;
use isophote_displacement_field::{FieldTracer, LookUp, Object, ObjectParams, Together};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Image, InstanceMask, Scene, Selection, Tracer, builtin,
    load,
    reference::{Quantity, Settings, Tracers, render},
};

const SHARED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared");

/// Fields for what has many triangles and can have one, exact rays for the rest.
fn tracer(scene: &Scene, look_up: LookUp) -> Together<FieldTracer, BvhTracer> {
    let parts = [true, false].map(|fields| {
        let mut part = scene.clone();
        for instance in &mut part.instances {
            let many = scene.mesh(instance).triangles.len() > 500;
            if many != fields {
                instance.mask = InstanceMask::NONE;
            }
        }
        Arc::new(part)
    });
    let casters = Selection::default();
    let exact = |scene: &Arc<Scene>| BvhTracer::build(scene, &casters, &BvhOptions::default());
    let params = ObjectParams::default();
    let objects = Object::build_all(&parts[0], &casters, &params, &exact, &|_, _| {}).unwrap();
    let fields = FieldTracer::new(&parts[0], &casters, objects, look_up).unwrap();
    Together(fields, exact(&parts[1]).unwrap())
}

fn picture(scene: &Arc<Scene>, tracer: &dyn Tracer, size: [u32; 2], samples: u32) -> Vec<Vec3> {
    let everything =
        BvhTracer::build(scene, &Selection::default(), &BvhOptions::default()).unwrap();
    let tracers = Tracers {
        exact: &everything,
        secondary: tracer,
    };
    let settings = Settings {
        samples,
        ..Settings::default()
    };
    let camera = &scene.cameras[0];
    let render = render(
        scene,
        tracers,
        camera,
        size,
        &[Quantity::Ao],
        &settings,
        &|_, _| {},
    );
    render.unwrap().estimates.remove(0).values
}

/// In grey levels.
fn rms(values: &[Vec3], truth: &[Vec3]) -> f64 {
    let squares: f64 = values
        .iter()
        .zip(truth)
        .map(|(a, b)| f64::from(a.x - b.x).powi(2))
        .sum();
    255.0 * (squares / truth.len() as f64).sqrt()
}

fn constant(truth: &[Vec3]) -> f64 {
    let mean = truth.iter().sum::<Vec3>() / truth.len() as f32;
    rms(&vec![mean; truth.len()], truth)
}

#[test]
fn a_corner_is_as_with_exact_rays() {
    let scene = Arc::new(builtin::build("builtin:corner").unwrap());
    let exact = support::exact(&scene);
    let size = [64, 48];
    let truth = picture(&scene, &exact, size, 64);
    for look_up in LookUp::ALL {
        let error = rms(&picture(&scene, &tracer(&scene, look_up), size, 64), &truth);
        eprintln!(
            "{look_up:?}: RMS {error:.2}, of a constant {:.2}",
            constant(&truth)
        );
        assert!(
            error < 9.2 && 4.0 * error < constant(&truth),
            "{look_up:?}: {error}"
        );
    }
}

#[test]
fn a_bunny_is_as_another_renderer_has_it() {
    let file = Path::new(SHARED).join("references/bunny.ao.exr");
    if !file.exists() {
        eprintln!("skipped: there is no {}", file.display());
        return;
    }
    let image = Image::load(&file).unwrap();
    let truth = image.rgb("").unwrap();
    let scene = Arc::new(load(&Path::new(SHARED).join("scenes/bunny.glb")).unwrap());
    let tracer = tracer(&scene, LookUp::Interpolated);
    let found = picture(&scene, &tracer, [image.width, image.height], 16);
    let exact = picture(
        &scene,
        &support::exact(&scene),
        [image.width, image.height],
        16,
    );
    let [with_fields, without] = [rms(&found, &truth), rms(&exact, &truth)];
    eprintln!(
        "RMS {with_fields:.2}, exact rays {without:.2}, of a constant {:.2}",
        constant(&truth)
    );
    assert!(
        with_fields < without + 0.5 && 3.3 * with_fields < constant(&truth),
        "{with_fields} {without}"
    );
}
