//! The hybrid renderer against the reference integrators.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::sync::Arc;

use glam::{Affine3A, Vec3};
use isophote_ldi::{Coverage, Hybrid, HybridParams, LdiParams, LdiTracer, Shadows, Stages};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, InstanceMask, Scene, Selection, Tracer, builtin,
    reference::{Materials, Quantity, Settings, Tracers, render},
    testing::{mean, relative_rmse},
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
    hybrid.render(&scene.cameras[0], SIZE, &|_, _| {}).unwrap()
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

fn unfiltered(rays: u32) -> HybridParams {
    HybridParams {
        samples: 4,
        diffuse_rays: rays,
        light_rays: 4,
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
    let flat = vec![Vec3::splat(mean(&truth) as f32); truth.len()];
    assert!(
        relative_rmse(&flat, &truth) > 0.5,
        "the picture is not flat"
    );

    let touched = maps(&cornell, Coverage::Touched);
    let same = hybrid(&cornell, &exact, &touched, &unfiltered(128));
    assert_eq!(same.layers(), stages.layers());
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
    let bias = mean(&filtered) / mean(&noisy) - 1.0;
    assert!(bias.abs() < 0.02, "{bias}");
    let [noisy, after] = [&noisy, &filtered].map(|light| relative_rmse(light, &truth));
    assert!(after < 0.7 * noisy, "{noisy} {after}");
}

/// A box of metal alone: what its glossy rays bring is all the light that bounced, as the reference has it.
#[test]
fn metal_alone_is_the_references() {
    let mut cornell = Arc::new(builtin::build("cornell").unwrap());
    for material in &mut Arc::make_mut(&mut cornell).materials {
        (material.metallic, material.roughness) = (1.0, 0.3);
    }
    let exact = bvh(&cornell);
    let truth = reference(&cornell, &exact, Quantity::Indirect, Materials::Pbr);
    let params = HybridParams {
        glossy_rays: 128,
        materials: Materials::Pbr,
        texture_level: 0.0,
        ..unfiltered(1)
    };
    let stages = hybrid(&cornell, &exact, &exact, &params);
    assert!(stages.diffuse.iter().all(|&light| light == Vec3::ZERO));
    let bias = mean(&stages.glossy) / mean(&truth) - 1.0;
    assert!(mean(&truth) > 1e-3 && bias.abs() < 0.04, "{bias}");
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
    // For diffuse rays metal is a diffuse surface.
    assert!(indirect.abs() < 0.08, "{indirect}");
}

/// Where surfaces meet, the paper's Gaussian mixes what one that stops at edges keeps apart.
#[test]
fn stopping_at_edges_is_nearer_to_the_truth() {
    let cornell = Arc::new(builtin::build("cornell").unwrap());
    let exact = bvh(&cornell);
    let truth = hybrid(&cornell, &exact, &exact, &unfiltered(256)).diffuse;
    let error = |edges| {
        let params = HybridParams {
            edges,
            ..HybridParams {
                filter_width: 11,
                ..unfiltered(32)
            }
        };
        relative_rmse(&hybrid(&cornell, &exact, &exact, &params).diffuse, &truth)
    };
    let [stopped, plain] = [HybridParams::default().edges, None].map(error);
    assert!(stopped < 0.6 * plain, "{stopped} {plain}");
}

/// By maps that are exact, soft shadows are those of the exact tracer; the filter takes their noise away.
#[test]
fn shadows_are_softened_by_maps_and_filtered() {
    let mut office = builtin::build("office").unwrap();
    for light in &mut office.lights {
        if let isophote_scene::LightKind::Point { radius } = &mut light.kind {
            *radius = 0.1;
        }
    }
    let office = Arc::new(office);
    let exact = bvh(&office);
    let maps = maps(&office, Coverage::Touched);
    let render = |shadows, light_rays, light_filter_width| {
        let params = HybridParams {
            shadows,
            light_rays,
            light_filter_width,
            filter_sigma: 1.0,
            ..unfiltered(1)
        };
        hybrid(&office, &exact, &maps, &params).direct
    };
    let by_maps = render(Shadows::Secondary, 2, 1);
    assert_eq!(by_maps, render(Shadows::Exact, 2, 1));
    let truth = render(Shadows::Exact, 128, 1);
    let filtered = render(Shadows::Exact, 2, 3);
    let [noisy, filtered] = [&by_maps, &filtered].map(|light| relative_rmse(light, &truth));
    assert!(filtered < 0.9 * noisy, "{noisy} {filtered}");
}

/// An object that is not in the maps receives light from them, gives none back, and stays in the shadows (§6).
#[test]
fn what_moves_receives_and_is_left_out() {
    let mut scene = builtin::build("cornell").unwrap();
    let still = scene.instances.len();
    let other = builtin::build("cornell").unwrap();
    // A small box in the middle of the floor: the room itself, turned outside in.
    let size = 0.2 / other.bounds().diagonal();
    let center = scene.bounds().center();
    let place = Affine3A::from_translation(center)
        * Affine3A::from_scale(Vec3::splat(size))
        * Affine3A::from_translation(-other.bounds().center());
    let added = scene.add(&other, place);
    for instance in &mut scene.instances[added] {
        instance.mask = instance.mask.without(InstanceMask::STATIC);
    }
    let scene = Arc::new(scene);
    let exact = bvh(&scene);
    let kept = Selection {
        mask: InstanceMask::CASTER.union(InstanceMask::STATIC),
        ..Selection::default()
    };
    let params = LdiParams::default();
    let maps = LdiTracer::build(&scene, &kept, &params).unwrap();
    let stages = hybrid(&scene, &exact, &maps, &unfiltered(8));
    let all = hybrid(&scene, &exact, &exact, &unfiltered(8));
    // Its shadow is there, and what it does to the bounced light is not.
    assert_eq!(stages.direct, all.direct);
    assert_ne!(stages.irradiance, all.irradiance);
    let camera = &scene.cameras[0];
    let [width, height] = SIZE;
    let lit = (0..width * height).filter(|pixel| {
        let place = glam::Vec2::new((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5);
        let hit = exact.closest_hit(&camera.ray(place, width, height));
        hit.is_some_and(|hit| hit.surface.instance as usize >= still)
            && stages.irradiance[*pixel as usize] != Vec3::ZERO
    });
    assert!(lit.count() > 10);
}

/// What is unlit shows its colour and reflects nothing; glass shows what is behind it.
#[test]
fn unlit_surfaces_and_glass_are_no_diffuse_ones() {
    let mut scene = builtin::build("cornell").unwrap();
    for material in &mut scene.materials {
        (material.unlit, material.transmission) = (true, 0.0);
    }
    let unlit = Arc::new(scene.clone());
    let stages = hybrid(&unlit, &bvh(&unlit), &bvh(&unlit), &unfiltered(4));
    for layer in [&stages.diffuse, &stages.glossy] {
        assert!(layer.iter().all(|light| *light == Vec3::ZERO));
    }
    assert!(mean(&stages.direct) > 0.1);

    let mut scene = builtin::build("cornell").unwrap();
    let front = isophote_scene::Material {
        transmission: 1.0,
        ..isophote_scene::Material::diffuse("pane", Vec3::ONE)
    };
    let mut pane = Scene::default();
    pane.materials.push(front);
    let mut mesh = isophote_scene::Mesh::clone(&scene.meshes[0]);
    mesh.positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 0.0)];
    mesh.normals = vec![Vec3::Z; 4];
    mesh.uvs = Default::default();
    mesh.colors = Vec::new();
    mesh.triangles = vec![[0, 1, 2], [1, 3, 2]];
    mesh.triangle_materials = vec![0; 2];
    pane.meshes.push(Arc::new(mesh));
    pane.instances
        .push(isophote_scene::Instance::new(0, Affine3A::IDENTITY));
    let camera = scene.cameras[0].clone();
    // Across the whole view, a little before the camera.
    let place = camera.transform
        * Affine3A::from_translation(Vec3::new(-1.0, -1.0, -0.3))
        * Affine3A::from_scale(Vec3::splat(2.0));
    scene.add(&pane, place);
    let scene = Arc::new(scene);
    let exact = bvh(&scene);
    let params = HybridParams {
        materials: Materials::Pbr,
        ..unfiltered(4)
    };
    let stages = hybrid(&scene, &exact, &exact, &params);
    assert!(stages.diffuse.iter().all(|light| *light == Vec3::ZERO));
    let truth = reference(&scene, &exact, Quantity::Indirect, Materials::Pbr);
    let off = mean(&stages.glossy) / mean(&truth) - 1.0;
    assert!(mean(&truth) > 0.0 && off.abs() < 0.1, "{off}");
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
        let camera = &cornell.cameras[0];
        assert!(hybrid.render(camera, size, &|_, _| {}).is_err());
    }
}
