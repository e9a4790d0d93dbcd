//! Every shader links, is valid, and becomes a pipeline on a device that needs no GPU and has WebGPU's default limits.
#![cfg(feature = "gpu")]

use std::sync::Arc;

use glam::{Vec2, Vec3};
use isophote_ldm_ambient::{
    Deposit, Error, MapParams, OcclusionParams, PhotonParams,
    cpu::{self, hbao::HbaoParams},
    gpu::{
        BuildMethod, GBufferPoints, Look, Occlusion, Points, Targets,
        gather::{Gather, Picture},
        hbao::Hbao,
        photons::{Photons, SplatMethod},
    },
};
use isophote_scene::{
    Alpha, BuildTracer, BvhOptions, BvhTracer, Environment, Error as SceneError, Leaves, Selection,
    builtin,
    gpu::{
        BuildGpuTracer, ComputeBvhTracer, Context, GBuffer, GpuScene, GpuTracer, Rasters,
        RayQueryTracer, reference::World,
    },
    reference::Normals,
};

const SIZE: [u32; 2] = [33, 20];

fn params(d_max: f32) -> OcclusionParams {
    OcclusionParams {
        maps: MapParams {
            maps: 24,
            resolution: 40,
            ..MapParams::default()
        },
        d_max,
        ..OcclusionParams::default()
    }
}

#[test]
fn stages_build() {
    let mut scene = builtin::build("builtin:cornell").unwrap();
    scene.materials[0].alpha = Alpha::Mask { cutoff: 0.5 };
    let scene = Arc::new(scene);
    let selection = Selection::default();
    // The last one has room for few maps at a time.
    let small = wgpu::Limits {
        max_storage_buffer_binding_size: 1 << 15,
        ..wgpu::Limits::default()
    };
    for context in [Context::noop(), Context::noop_within(small)] {
        let gpu_scene = GpuScene::new(&context, &scene).unwrap();
        let tracers: [Box<dyn GpuTracer>; 2] = [
            Box::new(ComputeBvhTracer::build(&context, &scene, &selection, &()).unwrap()),
            Box::new(RayQueryTracer::build(&context, &scene, &selection, &()).unwrap()),
        ];
        for method in [BuildMethod::LinkedLists, BuildMethod::Linearised] {
            for d_max in [1.0, f32::INFINITY] {
                let world = (&*scene, &gpu_scene);
                let mut occlusion =
                    Occlusion::new(&context, world, &selection, &params(d_max), method, SIZE)
                        .unwrap();
                let camera = &scene.cameras[0];
                let mut points = Points::new(&context, SIZE).unwrap();
                let targets = Targets::new(&context, SIZE).unwrap();
                for samples in [1, 4] {
                    let gbuffer = GBuffer::new(&context, SIZE, samples).unwrap();
                    let rasters = Rasters::new(&context, Some(&gbuffer), None).unwrap();
                    let taker =
                        GBufferPoints::new(&context, &gpu_scene, samples, &rasters).unwrap();
                    let mut encoder = context.device().create_command_encoder(&Default::default());
                    occlusion.begin(&mut encoder, &gpu_scene);
                    let look = Look {
                        camera,
                        place: Vec2::splat(0.5),
                        sample: 0,
                        normals: Normals::Smooth,
                    };
                    let from = (&gpu_scene, &rasters);
                    taker
                        .record(&context, &mut encoder, &occlusion, from, &look, &mut points)
                        .unwrap();
                    occlusion
                        .add(
                            &context,
                            &mut encoder,
                            &gpu_scene,
                            &points,
                            [0, samples],
                            None,
                        )
                        .unwrap();
                    occlusion.resolve(&context, &mut encoder, &targets).unwrap();
                    context.submit("occlusion", encoder).unwrap();
                    // This device computes nothing, which is found out.
                    let error = targets.read(&context).unwrap_err().to_string();
                    assert!(error.contains("did not finish"), "{error}");
                }
                for tracer in &tracers {
                    let world = World {
                        scene: &scene,
                        gpu_scene: &gpu_scene,
                        exact: &**tracer,
                        secondary: &**tracer,
                    };
                    let made =
                        occlusion.render(&context, world, camera, 2, Normals::Flat, &|_, _| {});
                    assert!(made.is_err());
                }
            }
        }
    }
}

#[test]
fn photons_build() {
    let scene = Arc::new(builtin::build("builtin:cornell").unwrap());
    let context = Context::noop();
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let selection = Selection::default();
    let fine = PhotonParams {
        maps: params(1.0).maps,
        deposit: Deposit::Splatted,
        ..PhotonParams::default()
    };
    let tracers: [Box<dyn GpuTracer>; 2] = [
        Box::new(ComputeBvhTracer::build(&context, &scene, &selection, &()).unwrap()),
        Box::new(RayQueryTracer::build(&context, &scene, &selection, &()).unwrap()),
    ];
    for tracer in &tracers {
        let world = World {
            scene: &scene,
            gpu_scene: &gpu_scene,
            exact: &**tracer,
            secondary: &**tracer,
        };
        let make = |params: &PhotonParams, method| {
            let on = (&*scene, &gpu_scene);
            Photons::new(&context, on, &selection, params, &**tracer, method, SIZE)
        };
        for method in [SplatMethod::Tiled, SplatMethod::Quads] {
            let mut photons = make(&fine, method).unwrap();
            let made = photons.render(&context, world, &scene.cameras[0], &|_, _| {});
            // This device computes nothing, which is found out.
            assert!(made.is_err());
        }
        let gathered = PhotonParams {
            deposit: Deposit::Gathered,
            ..fine
        };
        assert!(matches!(
            make(&gathered, SplatMethod::Tiled),
            Err(Error::Parameter { .. })
        ));
    }
}

#[test]
fn light_that_is_gathered_builds() {
    let mut scene = builtin::build("builtin:cornell").unwrap();
    scene.environment = Environment::Constant(Vec3::ONE);
    let scene = Arc::new(scene);
    let context = Context::noop();
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let selection = Selection::default();
    let fine = PhotonParams {
        maps: params(1.0).maps,
        raster: 4,
        finest: 4,
        direct: true,
        ..PhotonParams::default()
    };
    let exact = BvhTracer::build(&scene, &selection, &BvhOptions::default()).unwrap();
    let triangles = cpu::Triangles::new(&scene, &scene.transforms(), &selection).unwrap();
    let sent = cpu::photons::Photons::emit(&triangles, &exact, &fine).unwrap();
    let tracers: [Box<dyn GpuTracer>; 2] = [
        Box::new(ComputeBvhTracer::build(&context, &scene, &selection, &()).unwrap()),
        Box::new(RayQueryTracer::build(&context, &scene, &selection, &()).unwrap()),
    ];
    let picture = Picture {
        size: SIZE,
        lights: true,
        irradiance: true,
        mirrored: true,
    };
    for (tracer, sent) in tracers.iter().zip([None, Some(&sent)]) {
        let world = World {
            scene: &scene,
            gpu_scene: &gpu_scene,
            exact: &**tracer,
            secondary: &**tracer,
        };
        let (on, exact) = ((&*scene, &gpu_scene), &**tracer);
        let mut gather =
            Gather::new(&context, on, &selection, &fine, exact, picture, sent).unwrap();
        let camera = &scene.cameras[0];
        let made = gather.render(&context, world, camera, 2, &|_, _| {});
        // This device computes nothing, which is found out.
        assert!(made.is_err());
        let mut points = Points::new(&context, [8, 8]).unwrap();
        let mut encoder = context.device().create_command_encoder(&Default::default());
        let on = (&gpu_scene, exact);
        let look = (camera, 0);
        let seen = gather.see(&context, &mut encoder, on, look, &mut points, None);
        assert!(matches!(seen, Err(Error::Parameter { .. })));
    }
}

/// Horizons need no maps; what does not fit them is refused.
#[test]
fn horizons_build() {
    let scene = Arc::new(builtin::build("builtin:cornell").unwrap());
    let context = Context::noop();
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let make = |params: &HbaoParams, size| Hbao::new(&context, &gpu_scene, params, size);
    let params = HbaoParams::default();
    let mut hbao = make(&params, SIZE).unwrap();
    let camera = &scene.cameras[0];
    let (_, wide) = hbao.wider(camera);
    assert_eq!((wide, hbao.places().count()), ([37, 24], 4));
    // Depths, and what is summed up.
    assert_eq!(hbao.bytes(), 8 * 4 * 37 * 24 + 32 * 33 * 20);
    let mut encoder = context.device().create_command_encoder(&Default::default());
    hbao.begin(&mut encoder);
    let points = [SIZE, wide].map(|size| Points::new(&context, size).unwrap());
    for (points, fits) in points.iter().zip([false, true]) {
        let seen = hbao.see(&context, &mut encoder, camera, points, 3, None);
        assert_eq!(seen.is_ok(), fits);
        let added = hbao.add(&context, &mut encoder, camera, points, 1, None);
        assert_eq!(added.is_ok(), !fits);
    }
    let targets = Targets::new(&context, SIZE).unwrap();
    hbao.resolve(&context, &mut encoder, &targets).unwrap();
    context.submit("hbao", encoder).unwrap();
    // This device computes nothing, which is found out.
    assert!(targets.read(&context).is_err());
    for wrong in [
        HbaoParams { finer: 9, ..params },
        HbaoParams {
            margin: f32::NAN,
            ..params
        },
    ] {
        let made = make(&wrong, SIZE).map(drop);
        assert!(matches!(made, Err(Error::Parameter { .. })));
    }
    let made = make(&params, [8192, 8192]).map(drop);
    assert!(matches!(
        made,
        Err(Error::Scene(SceneError::GpuLimit { .. }))
    ));
}

#[test]
fn what_does_not_fit_is_refused() {
    let scene = Arc::new(builtin::build("builtin:cornell").unwrap());
    let context = Context::noop();
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let world = (&*scene, &gpu_scene);
    let selection = Selection::default();
    let make = |params: &OcclusionParams, size| {
        let method = BuildMethod::default();
        Occlusion::new(&context, world, &selection, params, method, size)
    };
    assert!(matches!(
        make(&params(-1.0), SIZE).map(drop),
        Err(Error::Parameter { name: "d_max", .. })
    ));
    assert!(matches!(
        make(&params(1.0), [8192, 8192]).map(drop),
        Err(Error::Scene(SceneError::GpuLimit { .. }))
    ));
    let mut occlusion = make(&params(1.0), SIZE).unwrap();
    let points = Points::new(&context, [8, 8]).unwrap();
    let mut encoder = context.device().create_command_encoder(&Default::default());
    let added = occlusion.add(&context, &mut encoder, &gpu_scene, &points, [0, 1], None);
    assert!(matches!(added, Err(Error::Parameter { .. })));
    let boxes = ComputeBvhTracer::build_with(&context, &scene, &selection, Leaves::Boxes).unwrap();
    let world = World {
        scene: &scene,
        gpu_scene: &gpu_scene,
        exact: &boxes,
        secondary: &boxes,
    };
    let camera = &scene.cameras[0];
    let made = occlusion.render(&context, world, camera, 1, Normals::Smooth, &|_, _| {});
    assert!(matches!(
        made.map(drop),
        Err(Error::Scene(SceneError::TracerKnowsLess { .. }))
    ));
}

/// Quads need a device that blends 32-bit floats; tiles do not.
#[test]
fn quads_are_refused_where_nothing_blends_them() {
    let noop = wgpu::NoopBackendOptions {
        enable: true,
        ..Default::default()
    };
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::NOOP,
        backend_options: wgpu::BackendOptions {
            noop,
            ..Default::default()
        },
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let adapter = now(instance.request_adapter(&Default::default())).unwrap();
    let (device, queue) = now(adapter.request_device(&Default::default())).unwrap();
    let context = Context::new(device, queue);
    let scene = Arc::new(builtin::build("builtin:cornell").unwrap());
    let gpu_scene = GpuScene::new(&context, &scene).unwrap();
    let selection = Selection::default();
    let tracer = ComputeBvhTracer::build(&context, &scene, &selection, &()).unwrap();
    let params = PhotonParams {
        deposit: Deposit::Splatted,
        ..PhotonParams::default()
    };
    let make = |method| {
        let on = (&*scene, &gpu_scene);
        Photons::new(&context, on, &selection, &params, &tracer, method, SIZE)
    };
    assert!(make(SplatMethod::Tiled).is_ok());
    let error = make(SplatMethod::Quads).map(drop).unwrap_err().to_string();
    assert!(error.contains("choose tiles"), "{error}");
}

/// What is there at once, as all of this device is.
fn now<T>(future: impl Future<Output = T>) -> T {
    let mut context = std::task::Context::from_waker(std::task::Waker::noop());
    match std::pin::pin!(future).poll(&mut context) {
        std::task::Poll::Ready(value) => value,
        std::task::Poll::Pending => panic!("it waits"),
    }
}
