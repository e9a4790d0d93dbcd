//! Light from an environment, on mirrors and straight from the lights, against the reference integrators.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::{f32::consts::PI, sync::Arc};

use glam::Vec3;
use isophote_ldm_ambient::{
    Deposit, MapParams, PhotonParams, Photons, Spread,
    cpu::{Points, Triangles, photons::light},
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Environment, EnvironmentMap, GBuffer, Light, Receivers,
    Scene, Seen, Selection, builtin,
    reference::{Materials, Normals, Quantity, Settings, Tracers, bake, render},
};

fn exact(scene: &Arc<Scene>) -> BvhTracer {
    BvhTracer::build(scene, &Selection::default(), &BvhOptions::default()).unwrap()
}

/// The Cornell box, dark but for what is added.
fn dark_box() -> Scene {
    let mut scene = builtin::build("cornell").unwrap();
    for material in &mut scene.materials {
        material.emissive = Vec3::ZERO;
    }
    scene.lights.clear();
    scene
}

/// Brighter to one side, with a small sun that stands where the box is open.
fn panorama() -> Environment {
    let texel = |index: usize| {
        let (x, y) = (index % 128, index / 128);
        let sun = (x, y) == (4, 26);
        let gradient = Vec3::new(0.2 + x as f32 / 128.0, 0.5, 1.0 - y as f32 / 64.0);
        gradient + if sun { Vec3::splat(200.0) } else { Vec3::ZERO }
    };
    let texels = (0..128 * 64).map(texel).collect();
    Environment::Map(EnvironmentMap::new(128, 64, texels).unwrap())
}

fn params(maps: u32) -> PhotonParams {
    PhotonParams {
        maps: MapParams {
            maps,
            resolution: 100,
            ..MapParams::default()
        },
        materials: Materials::Lambert,
        ..PhotonParams::default()
    }
}

fn baked(scene: &Scene, exact: &BvhTracer, receivers: &Receivers, quantity: Quantity) -> Vec<Vec3> {
    let settings = Settings {
        samples: 512,
        materials: Materials::Lambert,
        ..Settings::default()
    };
    let tracers = Tracers {
        exact,
        secondary: exact,
    };
    let (mut truth, _) = bake(
        scene,
        tracers,
        receivers,
        &[quantity],
        &settings,
        &|_, _| {},
    )
    .unwrap();
    truth.remove(0).values
}

/// Bias and relRMSE.
fn errors(light: &[Vec3], truth: &[Vec3]) -> [f32; 2] {
    let count = 3.0 * truth.len() as f32;
    let mean = |light: &[Vec3]| light.iter().map(|light| light.element_sum()).sum::<f32>() / count;
    let pairs = light.iter().zip(truth);
    let squares: f32 = pairs.map(|(a, b)| (*a - *b).length_squared()).sum();
    let (of_light, of_truth) = (mean(light), mean(truth));
    [
        of_light / of_truth - 1.0,
        (squares / count).sqrt() / of_truth,
    ]
}

/// Points that look through the maps see of an environment what the reference integrator sees, and what its light becomes when it
/// bounces.
#[test]
fn an_environment_lights_through_the_maps() {
    for (environment, bounds) in [
        (Environment::Constant(Vec3::ONE), [0.025, 0.09, 0.03, 0.15]),
        (panorama(), [0.04, 0.15, 0.06, 0.2]),
    ] {
        let scene = Arc::new(Scene {
            environment,
            ..dark_box()
        });
        let exact = exact(&scene);
        let receivers = Receivers::from_camera(&scene, &exact, &scene.cameras[0], [40, 30]);
        let triangles = Triangles::new(&scene, &scene.transforms(), &Selection::default()).unwrap();
        let points = Points::of_receivers(&receivers, Normals::Smooth);
        let photons = Photons::emit(&triangles, &exact, &params(512)).unwrap();
        let (light, _) = photons.light(&points, [0, 1], &|_, _| {});
        let sky: Vec<Vec3> = light.iter().map(|light| light.sky_irradiance()).collect();
        let bounced: Vec<Vec3> = light.iter().map(|light| light.irradiance()).collect();
        let truth = baked(&scene, &exact, &receivers, Quantity::IrradianceDirect);
        let [bias, error] = errors(&sky, &truth);
        println!("sky: {bias} {error}");
        assert!(
            bias.abs() < bounds[0] && error < bounds[1],
            "{bias} {error}"
        );
        let truth = baked(&scene, &exact, &receivers, Quantity::IrradianceIndirect);
        let [bias, error] = errors(&bounced, &truth);
        println!("bounced: {bias} {error}");
        assert!(
            bias.abs() < bounds[2] && error < bounds[3],
            "{bias} {error}"
        );
        // Without photons the sky is nearly the same: the ends of maps say whether there is anything, but less of corners.
        let none = PhotonParams {
            bounces: 0,
            ..params(512)
        };
        let none = Photons::emit(&triangles, &exact, &none).unwrap();
        let (alone, _) = none.light(&points, [0, 1], &|_, _| {});
        assert!(alone.iter().all(|light| light.irradiance() == Vec3::ZERO));
        let alone: Vec<Vec3> = alone.iter().map(|light| light.sky_irradiance()).collect();
        let [bias, error] = errors(&alone, &sky);
        println!("alone: {bias} {error}");
        assert!(bias.abs() < 0.01 && error < 0.05, "{bias} {error}");
        let off = PhotonParams {
            environment: false,
            ..params(16)
        };
        assert!(Photons::emit(&triangles, &exact, &off).unwrap().is_dark());
    }
}

fn with_lamp() -> Scene {
    let mut scene = dark_box();
    let bounds = scene.bounds();
    let size = bounds.max - bounds.min;
    let place = bounds.center() + Vec3::new(0.2, 0.1, -0.3) * size;
    scene
        .lights
        .push(Light::point("", place, Vec3::new(1.0, 0.8, 0.5)));
    scene
}

/// Photons that stay where they land first are the light that rays towards the lights find, and nearer to it the more there are.
#[test]
fn direct_light_can_be_that_of_photons() {
    let scene = Arc::new(with_lamp());
    let exact = exact(&scene);
    let receivers = Receivers::from_camera(&scene, &exact, &scene.cameras[0], [64, 48]);
    let truth = baked(&scene, &exact, &receivers, Quantity::IrradianceDirect);
    let triangles = Triangles::new(&scene, &scene.transforms(), &Selection::default()).unwrap();
    let points = Points::of_receivers(&receivers, Normals::Smooth);
    let mut last = f32::INFINITY;
    for (raster, most) in [(16, 0.6), (32, 0.4), (64, 0.3)] {
        let params = PhotonParams {
            direct: true,
            bounces: 0,
            raster,
            finest: 4 * raster,
            ..params(16)
        };
        let photons = Photons::emit(&triangles, &exact, &params).unwrap();
        let [bias, error] = errors(&photons.direct(&points), &truth);
        println!("{raster}: {bias} {error}");
        assert!(
            bias.abs() < 0.03 && error < most,
            "{raster}: {bias} {error}"
        );
        assert!(error < last, "{raster}: {error} after {last}");
        last = error;
    }
}

/// A mirror shows what the nearest direction meets: nearly what the reference integrator shows, and nearer the more maps there are.
#[test]
fn mirrors_show_the_nearest_direction() {
    let mut scene = with_lamp();
    let camera = scene.cameras[0].clone();
    let size = [64, 48];
    let look = |scene: &Arc<Scene>, exact: &BvhTracer| {
        GBuffer::see(scene, exact, &camera, size, Materials::Pbr)
    };
    // The tall block alone.
    let mut metal = scene.materials[0].clone();
    (metal.metallic, metal.roughness) = (1.0, 0.0);
    let block = scene.instances[2].mesh as usize;
    let mut mesh = (*scene.meshes[block]).clone();
    mesh.triangle_materials.fill(scene.materials.len() as u32);
    scene.meshes[block] = Arc::new(mesh);
    scene.materials.push(metal);
    let scene = Arc::new(scene);
    let exact = exact(&scene);
    let tracers = Tracers {
        exact: &exact,
        secondary: &exact,
    };
    let settings = Settings {
        samples: 64,
        ..Settings::default()
    };
    let quantity = [Quantity::Indirect];
    let truth = render(
        &scene,
        tracers,
        &camera,
        size,
        &quantity,
        &settings,
        &|_, _| {},
    );
    let truth = truth.unwrap().estimates.remove(0).values;
    let mirrors = look(&scene, &exact).pixels.into_iter().zip(truth);
    let mirrors = mirrors.filter_map(|(seen, truth)| Some((seen?, truth)));
    let (seen, truth): (Vec<Seen>, Vec<Vec3>) = mirrors
        .filter(|(seen, _)| seen.material.metallic > 0.0)
        .unzip();
    assert!(seen.len() > 100, "{}", seen.len());
    let points = Points::of_seen(&seen, Normals::Smooth);
    let towards = |seen: &Seen| (-seen.view).reflect(seen.normal());
    let towards: Vec<Vec3> = seen.iter().map(towards).collect();
    let triangles = Triangles::new(&scene, &scene.transforms(), &Selection::default()).unwrap();
    let found = |maps| {
        let params = PhotonParams {
            materials: Materials::Pbr,
            ..params(maps)
        };
        let photons = Photons::emit(&triangles, &exact, &params).unwrap();
        let (mirrored, _) = photons.mirrored(&points, &towards, &|_, _| {});
        let shown = mirrored.iter().zip(&seen);
        let shown: Vec<Vec3> = shown
            .map(|(mirrored, seen)| seen.material.base_color * mirrored.light)
            .collect();
        errors(&shown, &truth)
    };
    let (few, many) = (found(64), found(4096));
    println!("64: {few:?}, 4096: {many:?}");
    // At this size most pixels of the mirror show edges.
    assert!(many[1] < 0.85 * few[1] && many[1] < 0.9, "{few:?} {many:?}");
    assert!(many[0].abs() < 0.05, "{many:?}");
}

/// A white sky on an open mirror is what it shows, and a square alone is lit with π W/m².
#[test]
fn an_open_square_has_the_whole_sky() {
    let scene = Arc::new(Scene {
        environment: Environment::Constant(Vec3::new(1.0, 2.0, 0.5)),
        ..with_lamp()
    });
    let exact = exact(&scene);
    let triangles = Triangles::new(&scene, &scene.transforms(), &Selection::default()).unwrap();
    let seen = GBuffer::see(
        &scene,
        &exact,
        &scene.cameras[0],
        [24, 18],
        Materials::Lambert,
    );
    let seen: Vec<Seen> = seen.pixels.into_iter().flatten().collect();
    let points = Points::of_seen(&seen, Normals::Smooth);
    // Towards the viewer, in the open: what is not below the surface is sky for nearly all.
    let towards: Vec<Vec3> = seen.iter().map(|seen| seen.view).collect();
    let photons = Photons::emit(&triangles, &exact, &params(512)).unwrap();
    let (mirrored, _) = photons.mirrored(&points, &towards, &|_, _| {});
    let open = mirrored
        .iter()
        .filter(|seen| seen.sky == Vec3::new(1.0, 2.0, 0.5));
    let share = open.count() as f32 / mirrored.len() as f32;
    assert!(share > 0.9, "{share}");
    // Points on the outside of the box's bounding sphere would see all of it; those within see less than π.
    let (light, _) = photons.light(&points, [0, 1], &|_, _| {});
    let most = light.iter().map(|light| light.sky_irradiance().x);
    assert!(most.fold(0.0, f32::max) < 1.01 * PI);
}

#[test]
fn photons_that_are_gathered_are_not_turned() {
    for deposit in [Deposit::Splatted, Deposit::Gathered] {
        let params = PhotonParams {
            deposit,
            spread: Spread::Turned,
            ..params(16)
        };
        assert_eq!(params.check().is_ok(), deposit == Deposit::Splatted);
    }
}

/// Light that bounces more often is nearly as much as where points gather it.
#[test]
fn photons_that_are_splatted_bounce_as_often_as_they_shall() {
    let scene = Arc::new(builtin::build("cornell").unwrap());
    let exact = exact(&scene);
    let triangles = Triangles::new(&scene, &scene.transforms(), &Selection::default()).unwrap();
    let camera = &scene.cameras[0];
    let seen = GBuffer::see(&scene, &exact, camera, [32, 24], Materials::Lambert);
    let mean = |deposit, flatness, bounces| {
        let params = PhotonParams {
            deposit,
            flatness,
            bounces,
            branches: 4,
            materials: Materials::Lambert,
            ..params(64)
        };
        let lit = light(&triangles, &exact, camera, &seen, &params, &|_, _| {}).unwrap();
        lit.indirect
            .iter()
            .map(|light| light.element_sum())
            .sum::<f32>()
    };
    let of = |deposit, flatness| [0, 1, 2, 3].map(|bounces| mean(deposit, flatness, bounces));
    let splatted = of(Deposit::Splatted, 3.0);
    let gathered = of(Deposit::Gathered, PhotonParams::default().flatness);
    println!("{splatted:?} {gathered:?}");
    assert_eq!(splatted[0], 0.0);
    for bounces in 1..4 {
        let ratio = splatted[bounces] / gathered[bounces];
        assert!((ratio - 1.0).abs() < 0.08, "{bounces} bounces: {ratio}");
    }
}
