//! Light that comes straight from lights and from the environment, in shaders beside the CPU's.
//!
//! Both see the same points, ask the same lights with the same samples, and look along the same maps. What is left is rounding.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

use std::{f32::consts::PI, sync::Arc};

use glam::Vec3;
use isophote_ldm_ambient::{
    MapParams, OcclusionParams, PhotonParams, Photons,
    cpu::{self, Triangles},
    gpu::{
        BuildMethod, Occlusion, Points,
        direct::Direct,
        photons::{Light, Targets},
    },
};
use isophote_scene::{
    Bsdf, BuildTracer, BvhOptions, BvhTracer, DirectLight, Environment, EnvironmentMap, Scene,
    Seen, Selection, builtin,
    gpu::{BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, reference::World},
    reference::{Materials, Normals},
    sample::Sampler,
};

const SIZE: [u32; 2] = [48, 36];
const COUNT: usize = (SIZE[0] * SIZE[1]) as usize;
/// Places of each pixel.
const SAMPLES: u32 = 3;
/// How far two pictures may be apart, as relRMSE, from the same points.
const MOST: f32 = 5e-4;
/// The same where maps are fitted around what the camera may see instead of what it sees.
const MOST_OF_OTHER_MAPS: f32 = 0.05;

fn params(normals: Normals) -> PhotonParams {
    PhotonParams {
        maps: MapParams {
            maps: 50,
            resolution: 100,
            ..MapParams::default()
        },
        bounces: 0,
        frames: 2,
        materials: Materials::Pbr,
        normals,
        seed: 5,
        ..PhotonParams::default()
    }
}

/// Brighter to one side, with a small sun.
fn panorama() -> Environment {
    let texel = |index: usize| {
        let (x, y) = (index % 64, index / 64);
        let sun = if (x, y) == (2, 13) { 200.0 } else { 0.0 };
        Vec3::new(0.2 + x as f32 / 64.0, 0.5, 1.0 - y as f32 / 32.0) + sun
    };
    let texels = (0..64 * 32).map(texel).collect();
    Environment::Map(EnvironmentMap::new(64, 32, texels).unwrap())
}

/// Lamps of all kinds, metal, a surface that is not lit; under a sky, in the dark, and with the triangles' own normals.
fn cases() -> Vec<(&'static str, Scene, Normals)> {
    let build = |name: &str, environment| {
        let mut scene = builtin::build(name).unwrap();
        scene.environment = environment;
        scene.materials[0].unlit = name == "cornell";
        scene
    };
    let dark = Environment::Black;
    vec![
        (
            "in the dark",
            build("office", dark.clone()),
            Normals::Smooth,
        ),
        ("below a sky", build("cornell", panorama()), Normals::Smooth),
        (
            "all white",
            build("office", Environment::Constant(Vec3::ONE)),
            Normals::Flat,
        ),
    ]
}

struct Ground {
    context: Context,
    scene: Arc<Scene>,
    gpu_scene: GpuScene,
    exact: BvhTracer,
    tracer: ComputeBvhTracer,
    params: PhotonParams,
}

impl Ground {
    fn new(context: &Context, scene: Scene, normals: Normals) -> Self {
        let scene = Arc::new(scene);
        let all = Selection::default();
        Self {
            context: context.clone(),
            gpu_scene: GpuScene::new(context, &scene).unwrap(),
            exact: BvhTracer::build(&scene, &all, &BvhOptions::default()).unwrap(),
            tracer: ComputeBvhTracer::build(context, &scene, &all, &()).unwrap(),
            scene,
            params: params(normals),
        }
    }

    fn direct(&self) -> Direct {
        let (context, world) = (&self.context, (&*self.scene, &self.gpu_scene));
        let picture = (SIZE, true);
        let all = Selection::default();
        Direct::new(context, world, &all, &self.params, &self.tracer, picture).unwrap()
    }

    fn seen(&self, sample: u32) -> (cpu::Points, Vec<Seen>) {
        let (scene, camera) = (&self.scene, &self.scene.cameras[0]);
        let kinds = (self.params.normals, self.params.materials);
        cpu::Points::with_seen(scene, &self.exact, camera, SIZE, sample, kinds)
    }

    fn on_cpu(&self) -> Light {
        let scene = &self.scene;
        let triangles = Triangles::new(scene, &scene.transforms(), &Selection::default()).unwrap();
        let photons = Photons::emit(&triangles, &self.exact, &self.params).unwrap();
        let lights = DirectLight::without_environment(scene, &self.exact);
        let missing = 0.5 * (self.params.maps.maps * self.params.frames) as f32 / SAMPLES as f32;
        let mut weights = vec![missing * SAMPLES as f32; COUNT];
        let mut skies = vec![[Vec3::ZERO; 2]; COUNT];
        let mut lit = vec![[Vec3::ZERO; 2]; COUNT];
        for sample in 0..SAMPLES {
            let (points, seen) = self.seen(sample);
            let (light, _) = photons.light(&points, [sample, SAMPLES], &|_, _| {});
            for ((&pixel, light), seen) in points.indices().iter().zip(light).zip(&seen) {
                let sampler = Sampler::new(self.params.seed, pixel, sample);
                let scattered = |bsdf: &Bsdf| {
                    let (point, view) = (&seen.point, seen.view);
                    lights.scattered(point, view, bsdf, &sampler).0
                };
                let pixel = pixel as usize;
                weights[pixel] += light.weight - missing;
                skies[pixel][0] += seen.albedo() / PI * light.sky;
                skies[pixel][1] += light.sky;
                let (normal, material) = (seen.normal(), &seen.material);
                lit[pixel][0] += match material.unlit {
                    true => material.base_color,
                    false => scattered(&Bsdf::new(normal, material, seen.is_outside())),
                };
                lit[pixel][1] += scattered(&Bsdf::diffuse(normal, Vec3::splat(PI)));
            }
        }
        let of = |kind: usize| {
            let sums = lit.iter().zip(&skies).zip(&weights);
            let mean =
                sums.map(|((lit, sky), weight)| lit[kind] / SAMPLES as f32 + sky[kind] / *weight);
            mean.collect()
        };
        Light {
            radiance: of(0),
            irradiance: of(1),
        }
    }

    /// With maps fitted around the CPU's points.
    fn on_gpu(&self) -> Light {
        let (context, camera) = (&self.context, &self.scene.cameras[0]);
        let mut direct = self.direct();
        let mut points = Points::new(context, SIZE).unwrap();
        let world = (&*self.scene, &self.gpu_scene);
        let all = Selection::default();
        let about = OcclusionParams::default();
        let about =
            Occlusion::new(context, world, &all, &about, BuildMethod::default(), SIZE).unwrap();
        let submit = |encoder| context.submit("direct light", encoder).unwrap();
        let encoder = || context.device().create_command_encoder(&Default::default());
        let mut first = encoder();
        direct.begin(&mut first, &self.gpu_scene);
        submit(first);
        for sample in 0..SAMPLES {
            let mut seeing = encoder();
            let on = (&self.gpu_scene, &self.tracer as _);
            direct
                .see(
                    context,
                    &mut seeing,
                    on,
                    (camera, sample),
                    &mut points,
                    None,
                )
                .unwrap();
            submit(seeing);
            points.upload(context, &about, &self.seen(sample).0);
            let mut adding = encoder();
            let part = [sample, SAMPLES];
            direct
                .add(context, &mut adding, &self.gpu_scene, &points, part, None)
                .unwrap();
            submit(adding);
        }
        let targets = Targets::new(context, SIZE).unwrap();
        let mut last = encoder();
        direct.resolve(context, &mut last, &targets).unwrap();
        submit(last);
        let read = |texture| -> Vec<Vec3> {
            let values: Vec<glam::Vec4> = context.read_texture("light", texture).unwrap();
            values.into_iter().map(glam::Vec4::truncate).collect()
        };
        Light {
            radiance: read(&targets.radiance),
            irradiance: read(&targets.irradiance),
        }
    }

    fn rendered(&self, direct: &mut Direct) -> Light {
        let world = World {
            scene: &self.scene,
            gpu_scene: &self.gpu_scene,
            exact: &self.tracer,
            secondary: &self.tracer,
        };
        let camera = &self.scene.cameras[0];
        let made = direct.render(&self.context, world, camera, SAMPLES, &|_, _| {});
        made.unwrap().0
    }
}

/// relRMSE of radiance and of irradiance.
fn off(found: &Light, expected: &Light) -> [f32; 2] {
    let error = |found: &[Vec3], expected: &[Vec3]| {
        let pairs = found.iter().zip(expected);
        let squares: f32 = pairs.map(|(a, b)| (*a - *b).length_squared()).sum();
        let sum: f32 = expected.iter().map(|light| light.element_sum()).sum();
        (squares * 3.0 * COUNT as f32).sqrt() / sum
    };
    [
        error(&found.radiance, &expected.radiance),
        error(&found.irradiance, &expected.irradiance),
    ]
}

#[test]
fn direct_light_is_that_of_the_cpu() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    for (name, scene, normals) in cases() {
        let ground = Ground::new(&context, scene, normals);
        let expected = ground.on_cpu();
        let [radiance, irradiance] = off(&ground.on_gpu(), &expected);
        println!("{name}: relRMSE {radiance:.1e} of radiance, {irradiance:.1e} of irradiance");
        assert!(
            radiance.max(irradiance) < MOST,
            "{name}: {radiance} {irradiance}"
        );
        let mut direct = ground.direct();
        let found = ground.rendered(&mut direct);
        let [radiance, irradiance] = off(&found, &expected);
        println!("{name}, rendered: {radiance:.1e} and {irradiance:.1e}");
        assert!(
            radiance.max(irradiance) < MOST_OF_OTHER_MAPS,
            "{name}: {radiance} {irradiance}"
        );
        // No flicker: the same picture again is the same to the bit.
        assert_eq!(found, ground.rendered(&mut direct), "{name}");
    }
}
