//! Horizon-based occlusion in shaders beside the CPU's. What is left is rounding: that of a place between two depths, and that of
//! the depths beside an edge.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

use std::sync::Arc;

use glam::{Vec2, Vec3};
use isophote_ldm_ambient::{
    cpu::{
        self,
        hbao::{Depths, HbaoParams, hbao},
        occlusion::Sky,
    },
    gpu::{GBufferPoints, Look, Points, Targets, hbao::Hbao},
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Camera, Projection, Scene, Selection, builtin,
    gpu::{
        BuildGpuTracer, ComputeBvhTracer, Context, GBuffer, GBufferPass, GpuScene, Rasters,
        reference::World,
    },
    reference::Normals,
};

const SIZE: [u32; 2] = [48, 36];
const SAMPLES: u32 = 4;
/// How far two pictures may be apart, grey levels RMS; 0.015 was measured.
const MOST: f32 = 0.05;

/// A device and a scene on it.
struct Ground {
    context: Context,
    scene: Arc<Scene>,
    gpu_scene: GpuScene,
    exact: BvhTracer,
}

impl Ground {
    fn new(context: &Context, name: &str) -> Self {
        let scene = Arc::new(builtin::build(name).unwrap());
        Self {
            context: context.clone(),
            gpu_scene: GpuScene::new(context, &scene).unwrap(),
            exact: BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default()).unwrap(),
            scene,
        }
    }

    fn points(&self, camera: &Camera, sample: u32) -> cpu::Points {
        let (scene, exact) = (&self.scene, &self.exact);
        cpu::Points::from_camera(scene, exact, camera, SIZE, sample, Normals::Smooth)
    }

    fn on_cpu(&self, camera: &Camera, params: &HbaoParams, samples: u32) -> Vec<Sky> {
        let depths = Depths::see(&self.scene, &self.exact, camera, SIZE, params).unwrap();
        let mut sum = vec![[0.0; 2]; (SIZE[0] * SIZE[1]) as usize];
        for sample in 0..samples {
            let skies = hbao(&self.points(camera, sample), &depths, sample, params).unwrap();
            for (sum, sky) in sum.iter_mut().zip(skies) {
                *sum = [sum[0] + sky.ao, sum[1] + sky.obscurance];
            }
        }
        let mean = |sum: [f32; 2]| Sky {
            ao: sum[0] / samples as f32,
            obscurance: sum[1] / samples as f32,
            bent_normal: Vec3::ZERO,
        };
        sum.into_iter().map(mean).collect()
    }

    fn on_gpu(&self, camera: &Camera, params: &HbaoParams) -> Vec<Sky> {
        let (context, scene) = (&self.context, &self.scene);
        let exact = ComputeBvhTracer::build(context, scene, &Selection::default(), &()).unwrap();
        let world = World {
            scene,
            gpu_scene: &self.gpu_scene,
            exact: &exact,
            secondary: &exact,
        };
        let mut made = Hbao::new(context, &self.gpu_scene, params, SIZE).unwrap();
        let mut render = || {
            let smooth = Normals::Smooth;
            let made = made.render(context, world, camera, SAMPLES, smooth, &|_, _| {});
            made.unwrap().0
        };
        let first = render();
        assert_eq!(first, render(), "it differs from time to time");
        first
    }
}

fn check(name: &str, found: &[Sky], expected: &[Sky]) {
    for (what, value) in [
        ("ao", (|sky: &Sky| sky.ao) as fn(&Sky) -> f32),
        ("obscurance", |sky| sky.obscurance),
    ] {
        let pairs = found.iter().zip(expected);
        let squares: f32 = pairs.map(|(a, b)| (value(a) - value(b)).powi(2)).sum();
        let off = 255.0 * (squares / expected.len() as f32).sqrt();
        let mean = expected.iter().map(value).sum::<f32>() / expected.len() as f32;
        println!("{name}, {what}: {off} grey levels of {}", 255.0 * mean);
        assert!(off <= MOST && mean < 0.99, "{name}, {what}: {off}, {mean}");
    }
}

#[test]
fn horizons_are_those_of_the_cpu() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    for (name, d_max) in [("cornell", 0.1), ("cornell", 1.0), ("office", 0.5)] {
        let ground = Ground::new(&context, name);
        let camera = &ground.scene.cameras[0];
        let bounds = ground.gpu_scene.bounds();
        let eye = camera.position() + bounds.diagonal() * Vec3::new(0.113, 0.047, 0.011);
        let parallel = Camera {
            projection: Projection::Orthographic {
                half_height: 0.2 * bounds.diagonal(),
            },
            ..Camera::look_at("parallel", eye, bounds.center(), 1.0)
        };
        let params = HbaoParams {
            d_max,
            directions: 4,
            ..HbaoParams::default()
        };
        for (kind, camera) in [("pinhole", camera), ("parallel", &parallel)] {
            let expected = ground.on_cpu(camera, &params, SAMPLES);
            let found = ground.on_gpu(camera, &params);
            let name = format!("{name} {d_max} m, {kind}");
            check(&name, &found, &expected);
        }
    }
}

/// What a G-buffer holds is points and depths; no wider and no finer.
#[test]
fn a_g_buffer_is_enough() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let ground = Ground::new(&context, "cornell");
    let (camera, gpu_scene) = (&ground.scene.cameras[0], &ground.gpu_scene);
    let params = HbaoParams {
        d_max: 0.1,
        finer: 1,
        margin: 0.0,
        ..HbaoParams::default()
    };
    let gbuffer = GBuffer::new(&context, SIZE, 1).unwrap();
    let pass = GBufferPass::new(&context, 1).unwrap();
    let rasters = Rasters::new(&context, Some(&gbuffer), None).unwrap();
    let finder = GBufferPoints::new(&context, gpu_scene, 1, &rasters).unwrap();
    let mut hbao = Hbao::new(&context, gpu_scene, &params, SIZE).unwrap();
    assert_eq!(hbao.wider(camera), (camera.clone(), SIZE));
    let mut points = Points::new(&context, SIZE).unwrap();
    let targets = Targets::new(&context, SIZE).unwrap();
    let look = Look {
        camera,
        place: Vec2::splat(0.5),
        sample: 0,
        normals: Normals::Smooth,
    };
    let mut encoder = context.device().create_command_encoder(&Default::default());
    pass.record(&context, &mut encoder, gpu_scene, camera, &gbuffer, None)
        .unwrap();
    let (on, origin) = ((gpu_scene, &rasters), hbao.origin());
    finder
        .record_about(&context, &mut encoder, origin, on, &look, &mut points)
        .unwrap();
    hbao.begin(&mut encoder);
    hbao.see(&context, &mut encoder, camera, &points, 0, None)
        .unwrap();
    hbao.add(&context, &mut encoder, camera, &points, 0, None)
        .unwrap();
    hbao.resolve(&context, &mut encoder, &targets).unwrap();
    context.submit("hbao", encoder).unwrap();
    let found = targets.read(&context).unwrap();
    check("G-buffer", &found, &ground.on_cpu(camera, &params, 1));
}
