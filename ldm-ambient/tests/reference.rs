//! Photons and the screen-space baseline against the reference integrators, and what must hold of photons: no energy is made
//! or lost, and nothing depends on threads.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::sync::Arc;

use glam::{Affine3A, Quat, Vec3};
use isophote_ldm_ambient::{
    Deposit, Error, MapParams, PhotonParams, Photons, Spread,
    cpu::{
        Points, Triangles,
        hbao::{Depths, HbaoParams, hbao},
        photons::{Gathered, Lit, light},
    },
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Camera, GBuffer, Instance, Light, LightKind, Material,
    Mesh, Receivers, Scene, Selection, builtin,
    reference::{Materials, Normals, Quantity, Settings, Tracers, bake, render},
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
    let (gathered, splatted) = (Deposit::Gathered, Deposit::Splatted);
    for (deposit, spread) in [
        (gathered, Spread::Parallel),
        (splatted, Spread::Parallel),
        (splatted, Spread::Turned),
    ] {
        let params = PhotonParams {
            direct: true,
            deposit,
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
                assert!(
                    (share - 1.0).abs() < 0.02,
                    "{deposit:?} {spread:?}: direct {share}"
                );
                assert!(total(&lit.indirect) < 1e-3 * lit.power.x);
            } else {
                // Some leaves between the slabs.
                let share = total(&lit.indirect) / (0.5 * lit.power.x);
                assert!(
                    share > 0.85 && share < 1.01,
                    "{deposit:?} {spread:?}: indirect {share}"
                );
            }
        }
    }
}

#[test]
fn indirect_light_is_near_the_reference() {
    let scene = Arc::new(builtin::build("cornell").unwrap());
    let exact = exact(&scene);
    let (camera, size) = (&scene.cameras[0], [48, 36]);
    // Through the middles of pixels, as photons are gathered and splatted.
    let receivers = Receivers::from_camera(&scene, &exact, camera, size);
    let indices: Vec<usize> = receivers.points.iter().map(|r| r.index as usize).collect();
    let truth = baked(&scene, &exact, &receivers, 512);
    // Footprints are large for so small a room: what splats lose at its edges is most of their error.
    for (deposit, flatness, splat_size, bound) in [
        (Deposit::Gathered, 0.1, 2.0, [0.01, 0.21]),
        (Deposit::Gathered, 0.1, 1.0, [0.01, 0.21]),
        (Deposit::Splatted, 3.0, 2.0, [0.075, 0.26]),
    ] {
        let params = PhotonParams {
            deposit,
            flatness,
            splat_size,
            ..params(128, 64)
        };
        let (lit, _) = lit(&scene, camera, size, &params);
        let light: Vec<Vec3> = indices.iter().map(|&index| lit.indirect[index]).collect();
        let (bias, error) = errors(&light, &truth);
        assert!(bias.abs() < bound[0], "{deposit:?}: bias {bias}");
        assert!(error < bound[1], "{deposit:?}: {error}");
    }
}

/// The reference's irradiance by light that bounced once.
fn baked(scene: &Scene, exact: &BvhTracer, receivers: &Receivers, samples: u32) -> Vec<Vec3> {
    let settings = Settings {
        samples,
        materials: Materials::Lambert,
        ..Settings::default()
    };
    let tracers = Tracers {
        exact,
        secondary: exact,
    };
    let quantity = [Quantity::IrradianceIndirect];
    let (mut truth, _) = bake(scene, tracers, receivers, &quantity, &settings, &|_, _| {}).unwrap();
    truth.remove(0).values
}

/// Bias and relRMSE.
fn errors(light: &[Vec3], truth: &[Vec3]) -> (f32, f32) {
    let count = 3.0 * truth.len() as f32;
    let mean = |light: &[Vec3]| light.iter().map(|light| light.element_sum()).sum::<f32>() / count;
    let pairs = light.iter().zip(truth);
    let squares: f32 = pairs.map(|(a, b)| (*a - *b).length_squared()).sum();
    let (of_light, of_truth) = (mean(light), mean(truth));
    (
        of_light / of_truth - 1.0,
        (squares / count).sqrt() / of_truth,
    )
}

/// The vertices of a room full of small things that touch each other are lit as the reference integrator lights them: what is
/// lit does not shine through what is thin or under what lies there.
#[test]
fn baked_light_is_near_the_reference() {
    let scene = Arc::new(builtin::build("office").unwrap());
    let exact = exact(&scene);
    let triangles = Triangles::new(&scene, &scene.transforms(), &Selection::default()).unwrap();
    let instances = 0..scene.instances.len() as u32;
    let vertices = instances.flat_map(|instance| Receivers::from_vertices(&scene, instance).points);
    let receivers = Receivers {
        points: vertices.step_by(17).collect(),
    };
    let truth = baked(&scene, &exact, &receivers, 256);
    let points = Points::of_receivers(&receivers, Normals::Smooth);
    let fine = params(128, 64);
    let maps = MapParams {
        resolution: 400,
        ..fine.maps
    };
    let photons = Photons::emit(&triangles, &exact, &PhotonParams { maps, ..fine }).unwrap();
    let (whole, _) = photons.light(&points, [0, 1], &|_, _| {});
    let light: Vec<Vec3> = whole.iter().map(Gathered::irradiance).collect();
    let (bias, error) = errors(&light, &truth);
    let even = vec![truth.iter().sum::<Vec3>() / truth.len() as f32; truth.len()];
    let (_, constant) = errors(&even, &truth);
    // 8.8 % and 0.87, where a constant has 2.1: some vertices touch other things.
    assert!(
        bias.abs() < 0.09 && error < 0.43 * constant,
        "{bias} {error} {constant}"
    );
    // By parts that share the maps too.
    let halves = [0, 1].map(|part| photons.light(&points, [part, 2], &|_, _| {}).0);
    for ((a, b), whole) in halves[0].iter().zip(&halves[1]).zip(&whole) {
        let sum = a.light + b.light;
        assert!(
            (sum - whole.light).abs().max_element() <= 1e-3 * (1.0 + whole.light.max_element())
        );
    }
}

/// Frames with turned directions come nearer to the truth than one, however the light is deposited.
#[test]
fn frames_accumulate() {
    let scene = Arc::new(builtin::build("cornell").unwrap());
    let camera = &scene.cameras[0];
    for deposit in [Deposit::Gathered, Deposit::Splatted] {
        let light = |maps, frames| {
            let params = PhotonParams {
                deposit,
                frames,
                ..params(maps, 32)
            };
            lit(&scene, camera, [32, 24], &params).0.indirect
        };
        let truth = light(512, 1);
        let [one, many] = [1, 16].map(|frames| errors(&light(16, frames), &truth).1);
        assert!(many < 0.6 * one, "{deposit:?}: {one} {many}");
    }
}

/// A second bounce adds what the reference integrator says that it adds.
#[test]
fn second_bounces_are_near_the_reference() {
    let scene = Arc::new(builtin::build("cornell").unwrap());
    let exact = exact(&scene);
    let (camera, size) = (&scene.cameras[0], [64, 48]);
    let tracers = Tracers {
        exact: &exact,
        secondary: &exact,
    };
    let all = |path_bounces| {
        let settings = Settings {
            samples: 128,
            path_bounces,
            materials: Materials::Lambert,
            ..Settings::default()
        };
        let quantity = [Quantity::Path];
        let render = render(
            &scene,
            tracers,
            camera,
            size,
            &quantity,
            &settings,
            &|_, _| {},
        );
        render.unwrap().estimates.remove(0).values
    };
    let truth: Vec<Vec3> = all(3).iter().zip(all(1)).map(|(a, b)| *a - b).collect();
    let two = PhotonParams {
        bounces: 2,
        branches: 16,
        ..params(128, 32)
    };
    let radiance = |params: &PhotonParams| {
        let (lit, seen) = lit(&scene, camera, size, params);
        let albedo = |seen: &Option<isophote_scene::Seen>| {
            seen.as_ref().map_or(Vec3::ZERO, |seen| seen.albedo())
        };
        let pixels = seen.pixels.iter().zip(&lit.indirect);
        let radiance = pixels.map(|(seen, light)| albedo(seen) / std::f32::consts::PI * *light);
        (radiance.collect::<Vec<Vec3>>(), lit.photons[0])
    };
    let (both, photons) = radiance(&two);
    let (one, first) = radiance(&PhotonParams { bounces: 1, ..two });
    let (bias, _) = errors(&both, &truth);
    let (without, _) = errors(&one, &truth);
    assert!(bias.abs() < 0.02 && without < -0.1, "{bias} {without}");
    // A photon has at most so many parts.
    assert!(photons <= 17 * first, "{photons} of {first}");
}

#[test]
fn light_does_not_depend_on_threads() {
    let scene = Arc::new(builtin::build("cornell").unwrap());
    for deposit in [Deposit::Gathered, Deposit::Splatted] {
        let render = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                let params = PhotonParams {
                    deposit,
                    ..params(20, 16)
                };
                lit(&scene, &scene.cameras[0], [40, 30], &params).0.indirect
            })
        };
        let one = render(1);
        assert!(one.iter().any(|light| light.x > 0.0));
        assert_eq!(one, render(5));
    }
}

/// The screen-space baseline is near the reference where occluders are near.
#[test]
fn hbao_is_fair_for_near_occluders() {
    let scene = Arc::new(builtin::build("cornell").unwrap());
    let exact = exact(&scene);
    let (camera, size) = (&scene.cameras[0], [96, 72]);
    // The room is half a metre wide. With a quarter of that what stands behind the boxes counts, which no camera sees.
    let d_max = 0.05;
    let params = HbaoParams {
        d_max,
        directions: 4,
        ..HbaoParams::default()
    };
    let depths = Depths::see(&scene, &exact, camera, size, &params).unwrap();
    let find = |sample, params: &HbaoParams| {
        let points = Points::from_camera(&scene, &exact, camera, size, sample, Normals::Smooth);
        hbao(&points, &depths, sample, params)
    };
    let mut found = vec![[0.0; 2]; 96 * 72];
    for sample in 0..16 {
        for (sum, sky) in found.iter_mut().zip(find(sample, &params).unwrap()) {
            *sum = [sum[0] + sky.ao / 16.0, sum[1] + sky.obscurance / 16.0];
        }
    }
    let settings = Settings {
        samples: 256,
        d_max,
        ..Settings::default()
    };
    let tracers = Tracers {
        exact: &exact,
        secondary: &exact,
    };
    let quantities = [Quantity::Ao, Quantity::Obscurance];
    let truth = render(
        &scene,
        tracers,
        camera,
        size,
        &quantities,
        &settings,
        &|_, _| {},
    )
    .unwrap();
    for (which, truth) in truth.estimates.iter().enumerate() {
        let pairs = found.iter().zip(&truth.values);
        let squares = pairs.map(|(found, truth)| (found[which] - truth.x).powi(2));
        let rms = 255.0 * (squares.sum::<f32>() / found.len() as f32).sqrt();
        let pairs = found.iter().zip(&truth.values);
        let bias = pairs
            .map(|(found, truth)| found[which] - truth.x)
            .sum::<f32>();
        let bias = 255.0 * bias / found.len() as f32;
        println!("{:?}: {rms} grey levels, bias {bias}", truth.quantity);
        let most = [3.7, 5.1][which];
        assert!(
            rms < most && bias.abs() < 1.6,
            "{:?}: {rms} grey levels, bias {bias}",
            truth.quantity
        );
    }
    let wrong = HbaoParams {
        d_max: f32::INFINITY,
        ..HbaoParams::default()
    };
    assert!(matches!(find(0, &wrong), Err(Error::Parameter { .. })));
}
