//! Photons and the screen-space baseline against the reference integrators, and what must hold of photons: no energy is made
//! or lost, and nothing depends on threads.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::sync::Arc;

use glam::{Affine3A, Quat, Vec3};
use isophote_ldm_ambient::{
    Error, MapParams, PhotonParams, Spread,
    cpu::{
        Triangles,
        hbao::{HbaoParams, hbao},
        photons::{Lit, light},
    },
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Camera, GBuffer, Instance, Light, LightKind, Material,
    Mesh, Scene, Selection, builtin,
    reference::{Materials, Quantity, Settings, Tracers, render},
};

fn exact(scene: &Arc<Scene>) -> BvhTracer {
    BvhTracer::build(scene, &Selection::default(), &BvhOptions::default()).unwrap()
}

fn lit(
    scene: &Arc<Scene>,
    camera: &Camera,
    size: [u32; 2],
    params: &PhotonParams,
) -> (Lit, GBuffer) {
    let exact = exact(scene);
    let seen = GBuffer::see(scene, &exact, camera, size, Materials::Lambert);
    let triangles = Triangles::new(scene, &scene.transforms(), &Selection::default()).unwrap();
    let lit = light(&triangles, &exact, camera, &seen, params, &|_, _| {}).unwrap();
    (lit, seen)
}

fn params(maps: u32, raster: u32) -> PhotonParams {
    PhotonParams {
        maps: MapParams {
            maps,
            resolution: 100,
            ..MapParams::default()
        },
        raster,
        materials: Materials::Lambert,
        ..PhotonParams::default()
    }
}

/// A large white floor at y = 0, and over it a ceiling at y = `height`, lit by a spot on the floor.
fn slabs(height: f32) -> Scene {
    let square = Mesh {
        positions: [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(x, z)| Vec3::new(20.0 * x, 0.0, 20.0 * z))
            .into(),
        normals: vec![Vec3::Y; 4],
        triangles: vec![[0, 2, 1], [0, 3, 2]],
        triangle_materials: vec![0; 2],
        ..Mesh::default()
    };
    let place = |y| Instance::new(0, Affine3A::from_translation(y * Vec3::Y));
    let mut spot = Light::point("", 0.9 * height * Vec3::Y, Vec3::splat(3.0));
    spot.kind = LightKind::Spot {
        inner: 0.3,
        outer: 0.5,
    };
    spot.transform = Affine3A::from_rotation_translation(
        Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2),
        0.9 * height * Vec3::Y,
    );
    Scene {
        meshes: vec![Arc::new(square)],
        instances: vec![place(0.0), place(height)],
        materials: vec![Material {
            base_color: Vec3::splat(0.5).extend(1.0),
            ..Material::default()
        }],
        lights: vec![spot],
        ..Scene::default()
    }
}

/// What lands on a slab that is seen as a whole is what left the light, and half of that, once it has bounced.
#[test]
fn energy_is_conserved() {
    let scene = Arc::new(slabs(2.0));
    let size = [96, 96];
    for spread in [Spread::Parallel, Spread::Turned] {
        let params = PhotonParams {
            direct: true,
            spread,
            ..params(128, 32)
        };
        // The floor from under the ceiling, and the ceiling from over the floor.
        for (eye, target, height) in [(1.9, 0.0, 1.9_f32), (0.1, 2.0, 1.9)] {
            let camera = Camera::look_at("", eye * Vec3::Y, target * Vec3::Y, 2.6);
            let (lit, seen) = lit(&scene, &camera, size, &params);
            // All pixels of a plane across the view have the same area.
            let side = 2.0 * height * 1.3_f32.tan() / size[1] as f32;
            assert!(seen.pixels.iter().all(Option::is_some));
            let total =
                |light: &[Vec3]| light.iter().map(|light| light.x).sum::<f32>() * side * side;
            if eye > target {
                let share = total(&lit.direct) / lit.power.x;
                assert!((share - 1.0).abs() < 0.02, "{spread:?}: direct {share}");
                assert!(total(&lit.indirect) < 1e-3 * lit.power.x);
            } else {
                // Some leaves between the slabs.
                let share = total(&lit.indirect) / (0.5 * lit.power.x);
                assert!(share > 0.85 && share < 1.01, "{spread:?}: indirect {share}");
            }
        }
    }
}

/// Footprints are large for so small a room: what they lose at its edges is most of the error.
#[test]
fn indirect_light_is_near_the_reference() {
    let scene = Arc::new(builtin::build("cornell").unwrap());
    let exact = exact(&scene);
    let (camera, size) = (&scene.cameras[0], [96, 72]);
    let settings = Settings {
        samples: 64,
        materials: Materials::Lambert,
        ..Settings::default()
    };
    let tracers = Tracers {
        exact: &exact,
        secondary: &exact,
    };
    let truth = render(
        &scene,
        tracers,
        camera,
        size,
        &[Quantity::IrradianceIndirect],
        &settings,
        &|_, _| {},
    )
    .unwrap();
    let (lit, _) = lit(
        &scene,
        camera,
        size,
        &PhotonParams {
            maps: MapParams {
                maps: 128,
                ..MapParams::default()
            },
            ..params(128, 64)
        },
    );
    let mean = |light: &[Vec3]| light.iter().copied().sum::<Vec3>() / light.len() as f32;
    let truth = &truth.estimates[0].values;
    let bias = mean(&lit.indirect) / mean(truth) - 1.0;
    assert!(bias.abs().max_element() < 0.12, "{bias}");
    let squares = lit
        .indirect
        .iter()
        .zip(truth)
        .map(|(a, b)| (*a - *b).length_squared());
    let error =
        (squares.sum::<f32>() / (3 * truth.len()) as f32).sqrt() / mean(truth).element_sum() * 3.0;
    assert!(error < 0.45, "{error}");
}

#[test]
fn light_does_not_depend_on_threads() {
    let scene = Arc::new(builtin::build("cornell").unwrap());
    let render = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            lit(&scene, &scene.cameras[0], [40, 30], &params(20, 16))
                .0
                .indirect
        })
    };
    let one = render(1);
    assert!(one.iter().any(|light| light.x > 0.0));
    assert_eq!(one, render(5));
}

/// The screen-space baseline is near the reference where occluders are near.
#[test]
fn hbao_is_fair_for_near_occluders() {
    let scene = Arc::new(builtin::build("cornell").unwrap());
    let exact = exact(&scene);
    let (camera, size) = (&scene.cameras[0], [96, 72]);
    let seen = GBuffer::see(&scene, &exact, camera, size, Materials::Lambert);
    // The box is half a metre wide.
    let d_max = 0.15;
    let found = hbao(
        &seen,
        camera,
        &HbaoParams {
            d_max,
            ..HbaoParams::default()
        },
    )
    .unwrap();
    let settings = Settings {
        samples: 64,
        d_max,
        ..Settings::default()
    };
    let tracers = Tracers {
        exact: &exact,
        secondary: &exact,
    };
    let truth = render(
        &scene,
        tracers,
        camera,
        size,
        &[Quantity::Ao],
        &settings,
        &|_, _| {},
    )
    .unwrap();
    let squares = found
        .iter()
        .zip(&truth.estimates[0].values)
        .map(|(a, b)| (a.ao - b.x).powi(2));
    let rms = 255.0 * (squares.sum::<f32>() / found.len() as f32).sqrt();
    assert!(rms < 20.0, "{rms} grey levels");
    let wrong = HbaoParams {
        d_max: f32::INFINITY,
        ..HbaoParams::default()
    };
    assert!(matches!(
        hbao(&seen, camera, &wrong),
        Err(Error::Parameter { .. })
    ));
}
