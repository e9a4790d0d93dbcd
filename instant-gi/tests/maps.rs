//! Visibility by shadow maps: against what can be calculated, whoever answers the rays.

use std::sync::Arc;

use glam::{Vec2, Vec3, Vec4};
use isophote_instant_gi::{
    Error, GiParams, InstantGi, Lookup, ShadowMaps, Visibility,
    cpu::{emission::Vpl, maps::Maps},
};
use isophote_scene::{
    Answers, BruteForceTracer, BuildTracer, BvhOptions, BvhTracer, Hit, Ray, Selection, SurfaceId,
    SurfacePoint, Tracer, builtin,
    reference::{Materials, Tracers},
    testing::{mean, relative_rmse},
};
use proptest::prelude::*;

/// A plane, a disk before it, and what the answers are off by.
struct Planes {
    /// A point of the plane, and its normal.
    plane: [Vec3; 2],
    /// Around a place, facing as the plane does.
    disk: Option<(Vec3, f32)>,
    /// Metres.
    off: f32,
}

impl Tracer for Planes {
    fn answers(&self) -> Answers {
        Answers::Distance
    }

    fn tolerance(&self, _: Vec3) -> f32 {
        self.off
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        let [point, normal] = self.plane;
        let slope = ray.direction.dot(normal);
        let meets = |place: Vec3| (place - ray.origin).dot(normal) / slope;
        let disk = self.disk.map(|(center, radius)| {
            let t = meets(center);
            match ray.at(t).distance(center) < radius {
                true => t,
                false => f32::NAN,
            }
        });
        let all = [Some(meets(point)), disk].into_iter().flatten();
        let before = all.filter(|&t| t > ray.t_min && t < ray.t_max);
        let nearest = before.min_by(f32::total_cmp)?;
        Some(Hit {
            t: (nearest - self.off).max(0.0),
            uv: Vec2::ZERO,
            surface: SurfaceId::UNKNOWN,
        })
    }
}

fn light(position: Vec3, normal: Vec3) -> Vpl {
    Vpl {
        point: SurfacePoint {
            surface: SurfaceId::UNKNOWN,
            position,
            error: 1e-5,
            geometric_normal: normal,
            shading_normal: normal,
            uvs: Default::default(),
            color: Vec4::ONE,
            material: 0,
        },
        normal,
        intensity: Vec3::ONE,
        bounce: 1,
    }
}

/// A disk half way between a light and a floor has a shadow of twice its size.
#[test]
fn a_disk_throws_its_shadow() {
    let tracer = Planes {
        plane: [Vec3::ZERO, Vec3::Y],
        disk: Some((Vec3::Y, 0.5)),
        off: 0.0,
    };
    let vpls = [light(2.0 * Vec3::Y, -Vec3::Y)];
    for lookup in [Lookup::Nearest, Lookup::Smooth] {
        for (resolution, edge) in [(64, 0.12), (512, 0.02)] {
            let params = ShadowMaps {
                resolution,
                lookup,
                ..ShadowMaps::default()
            };
            let (maps, rays) = Maps::new(&tracer, &vpls, &params).unwrap();
            assert!(rays > 3 * u64::from(resolution).pow(2) / 4);
            for step in 0..400 {
                let radius = 0.01 * step as f32;
                let point = radius * Vec3::new(0.6, 0.0, 0.8);
                let seen = maps.visibility(0, point, Vec3::Y, 0.0);
                let is_near = (radius - 1.0).abs() < edge;
                let expected = f32::from(radius > 1.0);
                assert!(
                    is_near || seen == expected,
                    "{resolution} {lookup:?} {radius}: {seen}"
                );
                assert!((0.0..=1.0).contains(&seen));
            }
        }
    }
}

fn unit() -> impl Strategy<Value = Vec3> {
    (-1.0_f32..1.0, 0.0_f32..std::f32::consts::TAU).prop_map(|(z, angle)| {
        let radius = (1.0 - z * z).sqrt();
        Vec3::new(radius * angle.cos(), radius * angle.sin(), z)
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// A plane never hides its own points, however it lies and whoever answers, with hardly any bias.
    #[test]
    fn planes_do_not_hide_themselves(
        normal in unit(),
        facing in unit(),
        towards in unit(),
        distance in 0.05_f32..50.0,
        off in prop_oneof![Just(0.0_f32), 0.0_f32..0.01],
        side in 1_u32..17,
        smooth in any::<bool>(),
    ) {
        let resolution = 8 * side;
        let origin = Vec3::new(1.0, 2.0, 3.0);
        let towards = if towards.dot(facing) < 0.0 { -towards } else { towards };
        let point = origin + distance * towards;
        prop_assume!(towards.dot(facing) > 0.01 && towards.dot(normal).abs() > 0.01);
        let tracer = Planes { plane: [point, normal], disk: None, off };
        let params = ShadowMaps {
            resolution,
            bias: 0.01,
            lookup: if smooth { Lookup::Smooth } else { Lookup::Nearest },
        };
        let (maps, _) = Maps::new(&tracer, &[light(origin, facing)], &params).unwrap();
        prop_assert!(maps.visibility(0, point, normal, off) > 0.999);
    }
}

/// Pictures by maps are near those by rays, the nearer the larger the maps, and the same by every exact tracer.
#[test]
fn maps_are_nearly_rays() {
    let scene = Arc::new(builtin::build("cornell").unwrap());
    let selection = Selection::default();
    let exact = BvhTracer::build(&scene, &selection, &BvhOptions::default()).unwrap();
    let brute = BruteForceTracer::build(&scene, &selection, &()).unwrap();
    let picture = |secondary: &dyn Tracer, visibility| {
        let params = GiParams {
            paths: 90,
            bounces: 2,
            compensation: 1,
            visibility,
            materials: Materials::Lambert,
            ..GiParams::default()
        };
        let tracers: Tracers<'_, dyn Tracer, dyn Tracer> = Tracers {
            exact: &exact,
            secondary,
        };
        let gi = InstantGi::new(&scene, tracers, &params).unwrap();
        gi.render(&scene.cameras[0], [48, 36], &|_, _| {}).unwrap()
    };
    let truth = picture(&exact, Visibility::Rays);
    let by_maps = |secondary: &dyn Tracer, resolution| {
        let maps = ShadowMaps {
            resolution,
            ..ShadowMaps::default()
        };
        picture(secondary, Visibility::Maps(maps))
    };
    let errors = [32, 128].map(|resolution| {
        let found = by_maps(&exact, resolution);
        let bias = mean(&found.indirect) / mean(&truth.indirect) - 1.0;
        assert!(bias.abs() < 0.02, "{resolution}: {bias}");
        relative_rmse(&found.indirect, &truth.indirect)
    });
    println!("{errors:?}");
    assert!(errors[1] < 0.1 && errors[1] < 0.6 * errors[0], "{errors:?}");
    assert_eq!(by_maps(&exact, 32).picture, by_maps(&brute, 32).picture);
}

#[test]
fn what_cannot_be_is_an_error() {
    let with = |maps| GiParams {
        visibility: Visibility::Maps(maps),
        ..GiParams::default()
    };
    let plain = ShadowMaps::default();
    for (resolution, bias) in [(0, 1.0), (7, 1.0), (2048, 1.0), (64, -1.0), (64, f32::NAN)] {
        let params = with(ShadowMaps {
            resolution,
            bias,
            ..plain
        });
        assert!(matches!(params.check(), Err(Error::Parameter { .. })));
    }
    let tracer = Planes {
        plane: [Vec3::ZERO, Vec3::Y],
        disk: None,
        off: 0.0,
    };
    let vpls = vec![light(Vec3::Y, -Vec3::Y); 1025];
    let large = ShadowMaps {
        resolution: 1024,
        ..plain
    };
    let refused = Maps::new(&tracer, &vpls, &large);
    assert!(matches!(refused, Err(Error::TooLarge { .. })));
}
