//! The stages by themselves: what they must keep whatever the parameters.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::sync::Arc;

use glam::Vec3;
use isophote_instant_gi::{
    Error, Filter, GiParams, History, InstantGi, Pattern, ShadowMaps, Stages, Visibility,
    cpu::emission::shoot,
};
use isophote_scene::{
    Answers, BruteForceTracer, BuildTracer, BvhOptions, BvhTracer, Hit, Leaves, Ray, Receivers,
    Scene, Selection, Tracer, builtin,
    reference::{Materials, Normals, Tracers},
    testing::{mean, relative_rmse},
};

const SIZE: [u32; 2] = [48, 36];

fn scene(name: &str) -> (Arc<Scene>, BvhTracer) {
    let scene = Arc::new(builtin::build(name).unwrap());
    let tracer = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default()).unwrap();
    (scene, tracer)
}

fn render(scene: &Scene, exact: &dyn Tracer, secondary: &dyn Tracer, params: &GiParams) -> Stages {
    let tracers = Tracers { exact, secondary };
    let gi = InstantGi::new(scene, tracers, params).unwrap();
    gi.render(&scene.cameras[0], SIZE, &|_, _| {}).unwrap()
}

/// What pixels show is lit as points of their own are, bit for bit, and in whatever company.
#[test]
fn receivers_are_lit_as_pixels_are() {
    let (scene, tracer) = scene("cornell");
    let maps = Visibility::Maps(ShadowMaps {
        resolution: 16,
        ..ShadowMaps::default()
    });
    for (selection, visibility) in [(0, Visibility::Rays), (5, Visibility::Rays), (0, maps)] {
        let params = GiParams {
            paths: 20,
            bounces: 2,
            compensation: 2,
            selection,
            visibility,
            ..GiParams::default()
        };
        let stages = render(&scene, &tracer, &tracer, &params);
        let tracers = Tracers {
            exact: &tracer,
            secondary: &tracer,
        };
        let gi = InstantGi::new(&scene, tracers, &params).unwrap();
        let shot = gi.shoot().unwrap();
        assert!(shot.rays() > 0 && !shot.vpls().is_empty());
        let camera = &scene.cameras[0];
        let mut receivers = Receivers::from_camera(&scene, &tracer, camera, SIZE);
        receivers.points.reverse();
        // Normals of pixels are on the viewer's side.
        let eye = camera.position();
        receivers.points.retain(|receiver| {
            let point = &receiver.point;
            point.shading_normal.dot(eye - point.position) > 0.0
        });
        assert!(receivers.points.len() > 1000);
        let (light, rays) = gi.irradiance(&shot, &receivers, Normals::Smooth, &|_, _| {});
        assert_eq!(rays == 0, visibility == maps && params.compensation == 0);
        for (receiver, light) in receivers.points.iter().zip(light) {
            assert_eq!(light, stages.irradiance[receiver.index as usize]);
        }
    }
    let params = GiParams {
        kept: 4,
        ..GiParams::default()
    };
    let tracers = Tracers {
        exact: &tracer,
        secondary: &tracer,
    };
    let gi = InstantGi::new(&scene, tracers, &params).unwrap();
    assert!(matches!(
        gi.shoot(),
        Err(Error::Parameter { name: "kept", .. })
    ));
}

/// In a closed room of albedo ρ what is reflected once is ρ of what is emitted.
#[test]
fn particles_carry_what_the_lights_emit() {
    let (mut scene, tracer) = scene("cornell");
    let emitted = {
        let scene = Arc::make_mut(&mut scene);
        for material in &mut scene.materials {
            material.emissive = Vec3::ZERO;
            material.base_color = glam::Vec4::new(0.5, 0.5, 0.5, 1.0);
            material.base_color_texture = None;
            (material.metallic, material.transmission) = (0.0, 0.0);
        }
        let center = scene.bounds().center();
        scene.lights = vec![isophote_scene::Light::point("lamp", center, Vec3::ONE)];
        4.0 * std::f32::consts::PI
    };
    let params = GiParams {
        paths: 4096,
        bounces: 3,
        ..GiParams::default()
    };
    let (vpls, rays) = shoot(&scene, &tracer, &params);
    assert!(rays >= 4096);
    for bounce in 1..=3 {
        // A diffuse surface of intensity L along its normal sends out πL.
        let sent: f32 = vpls
            .iter()
            .filter(|vpl| vpl.bounce == bounce)
            .map(|vpl| std::f32::consts::PI * vpl.intensity.x)
            .sum();
        // The box is open in front: particles that leave are lost.
        let most = emitted * 0.5_f32.powi(bounce as i32);
        assert!(
            sent <= 1.01 * most && sent > 0.7_f32.powi(bounce as i32) * most,
            "{bounce}: {sent} {most}"
        );
    }
}

/// Light on what mirrors show is smooth: a few points of it tell the rest.
#[test]
fn cached_light_is_nearly_the_light() {
    let (mut scene, tracer) = scene("cornell");
    for material in &mut Arc::make_mut(&mut scene).materials {
        (material.metallic, material.roughness) = (0.5, 0.0);
    }
    let plain = GiParams {
        paths: 256,
        depth: 2,
        ..GiParams::default()
    };
    let truth = render(&scene, &tracer, &tracer, &plain);
    let mirrored = |stages: &Stages| {
        let mut passes = stages.passes.iter();
        passes.find(|pass| pass.name == "mirrored").unwrap().rays
    };
    let mut errors = Vec::new();
    for caching in [0.02, 0.1] {
        let params = GiParams { caching, ..plain };
        let found = render(&scene, &tracer, &tracer, &params);
        errors.push(relative_rmse(&found.specular, &truth.specular));
        assert!(mirrored(&found) < mirrored(&truth));
        assert_eq!(found.indirect, truth.indirect);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .build()
            .unwrap();
        let alone = pool.install(|| render(&scene, &tracer, &tracer, &params));
        assert_eq!(found.specular, alone.specular);
    }
    assert!(errors[0] < errors[1] && errors[1] < 0.1, "{errors:?}");
}

/// Pictures of a sequence shoot other light paths, and together know more than the first.
#[test]
fn sequences_come_nearer_to_the_truth() {
    let (scene, tracer) = scene("cornell");
    let tracers = Tracers {
        exact: &tracer,
        secondary: &tracer,
    };
    let params = GiParams {
        paths: 32,
        ..GiParams::default()
    };
    let many = GiParams {
        paths: 4096,
        ..params
    };
    let truth = render(&scene, &tracer, &tracer, &many).irradiance;
    let gi = InstantGi::new(&scene, tracers, &params).unwrap();
    let mut history = History::new(16).unwrap();
    let mut errors = Vec::new();
    for number in 0..8 {
        let camera = &scene.cameras[0];
        let stages = gi
            .render_next(camera, SIZE, &mut history, &|_, _| {})
            .unwrap();
        if number == 0 {
            let first = render(&scene, &tracer, &tracer, &params).irradiance;
            assert_eq!(stages.irradiance, first);
        }
        errors.push(relative_rmse(&stages.irradiance, &truth));
    }
    assert_eq!(history.pictures(), 8);
    assert!(errors[7] < 0.6 * errors[0], "{errors:?}");
}

#[test]
fn threads_do_not_matter() {
    let (scene, tracer) = scene("cornell");
    let params = GiParams {
        paths: 64,
        bounces: 2,
        compensation: 2,
        downsampling: 2,
        interleaving: [2, 2],
        ..GiParams::default()
    };
    let picture = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| render(&scene, &tracer, &tracer, &params).picture)
    };
    assert_eq!(picture(1), picture(3));
}

/// Parts of the lights together are all lights: on a surface without edges nothing is lost by either shortcut.
#[test]
fn shortcuts_keep_the_light() {
    let (scene, tracer) = scene("cornell");
    let plain = GiParams {
        paths: 512,
        materials: Materials::Lambert,
        ..GiParams::default()
    };
    let truth = render(&scene, &tracer, &tracer, &plain);
    let truth = mean(&truth.indirect);
    assert!(truth > 0.01);
    for filter in [Filter::Paper, Filter::Edges, Filter::Fill] {
        for pattern in [Pattern::Regular, Pattern::Irregular] {
            for (downsampling, interleaving) in [(2, [1, 1]), (1, [3, 3]), (2, [3, 2])] {
                let params = GiParams {
                    downsampling,
                    interleaving,
                    filter,
                    pattern,
                    ..plain
                };
                let found = mean(&render(&scene, &tracer, &tracer, &params).indirect);
                let bias = found / truth - 1.0;
                assert!(
                    bias.abs() < 0.05,
                    "{filter:?} {pattern:?} {downsampling} {interleaving:?}: {bias}"
                );
            }
        }
    }
}

/// Boxes hide more than what is in them, but never all.
#[test]
fn visibility_may_be_imperfect() {
    let (scene, tracer) = scene("cornell");
    let options = BvhOptions {
        leaves: Leaves::Boxes,
        ..BvhOptions::default()
    };
    let boxes = BvhTracer::build(&scene, &Selection::default(), &options).unwrap();
    let params = GiParams {
        paths: 256,
        materials: Materials::Lambert,
        ..GiParams::default()
    };
    let truth = mean(&render(&scene, &tracer, &tracer, &params).indirect);
    let found = mean(&render(&scene, &tracer, &boxes, &params).indirect);
    assert!(
        found < 1.01 * truth && found > 0.5 * truth,
        "{found} {truth}"
    );
    let tracers = Tracers {
        exact: &tracer,
        secondary: &boxes,
    };
    let compensated = GiParams {
        compensation: 1,
        ..params
    };
    assert!(InstantGi::new(&scene, tracers, &compensated).is_err());
}

/// A tracer that knows no surfaces.
struct Shadows<'a>(&'a BruteForceTracer);

impl Tracer for Shadows<'_> {
    fn answers(&self) -> Answers {
        Answers::Occlusion
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.0.closest_hit(ray)
    }
}

#[test]
fn what_cannot_be_is_an_error() {
    let (scene, tracer) = scene("cornell");
    let brute = BruteForceTracer::build(&scene, &Selection::default(), &()).unwrap();
    let shadows = Shadows(&brute);
    let tracers: Tracers<'_, dyn Tracer, dyn Tracer> = Tracers {
        exact: &shadows,
        secondary: &tracer,
    };
    let refused = InstantGi::new(&scene, tracers, &GiParams::default());
    assert!(matches!(refused.err(), Some(Error::Scene(_))));
    let maps = GiParams {
        visibility: Visibility::Maps(ShadowMaps::default()),
        ..GiParams::default()
    };
    let tracers: Tracers<'_, dyn Tracer, dyn Tracer> = Tracers {
        exact: &tracer,
        secondary: &shadows,
    };
    assert!(InstantGi::new(&scene, tracers, &GiParams::default()).is_ok());
    let refused = InstantGi::new(&scene, tracers, &maps);
    assert!(matches!(refused.err(), Some(Error::Scene(_))));
    let wrong = [
        GiParams {
            paths: 0,
            ..GiParams::default()
        },
        GiParams {
            bounces: 17,
            ..GiParams::default()
        },
        GiParams {
            min_d: -1.0,
            ..GiParams::default()
        },
        GiParams {
            min_d: f32::NAN,
            ..GiParams::default()
        },
        GiParams {
            downsampling: 0,
            ..GiParams::default()
        },
        GiParams {
            interleaving: [9, 1],
            ..GiParams::default()
        },
        GiParams {
            depth: 99,
            ..GiParams::default()
        },
    ];
    for params in wrong {
        assert!(
            matches!(params.check(), Err(Error::Parameter { .. })),
            "{params:?}"
        );
    }
    let tracers = Tracers {
        exact: &tracer,
        secondary: &tracer,
    };
    let gi = InstantGi::new(&scene, tracers, &GiParams::default()).unwrap();
    for size in [[0, 1], [1 << 16, 1 << 16]] {
        assert!(gi.render(&scene.cameras[0], size, &|_, _| {}).is_err());
    }
}
