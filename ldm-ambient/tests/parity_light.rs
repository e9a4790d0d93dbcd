//! Light that points gather, in shaders beside the CPU's: straight from lights and from the environment, and of photons.
//!
//! Both see the same points, ask the same lights with the same samples, and look along the same maps for the same photons. What is left
//! is rounding.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

use std::{f32::consts::PI, sync::Arc};

use glam::Vec3;
use isophote_ldm_ambient::{
    MapParams, OcclusionParams, PhotonParams, Photons,
    cpu::{self, Triangles, photons::Mirrored},
    gpu::{
        BuildMethod, Occlusion, Points,
        gather::{Gather, Lit, LitTargets, Picture},
        photons::Light,
    },
};
use isophote_scene::{
    Bsdf, BuildTracer, BvhOptions, BvhTracer, DirectLight, Environment, EnvironmentMap, Scene,
    Seen, Selection, SurfaceMaterial, builtin,
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
/// The same of what metals show, whose every edge is where a map has it: in maps that are fitted around their rays, and in those that
/// are fitted around all points.
const MOST_OF_METALS: [f32; 2] = [0.04, 0.1];

fn params() -> PhotonParams {
    PhotonParams {
        maps: MapParams {
            maps: 50,
            resolution: 100,
            ..MapParams::default()
        },
        raster: 16,
        finest: 32,
        bounces: 0,
        frames: 2,
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

/// Lamps of all kinds, metal, a surface that is not lit; under a sky, in the dark, with the triangles' own normals, and by photons.
fn cases() -> Vec<(&'static str, Scene, PhotonParams)> {
    let build = |name: &str, environment| {
        let mut scene = builtin::build(name).unwrap();
        scene.environment = environment;
        scene.materials[0].unlit = name == "cornell";
        scene
    };
    let (dark, white) = (Environment::Black, Environment::Constant(Vec3::ONE));
    let flat = PhotonParams {
        normals: Normals::Flat,
        ..params()
    };
    let bounced = PhotonParams {
        bounces: 2,
        branches: 2,
        ..params()
    };
    let landed = PhotonParams {
        direct: true,
        materials: Materials::Lambert,
        ..params()
    };
    let mirrored = PhotonParams {
        bounces: 1,
        ..params()
    };
    vec![
        ("in the dark", build("office", dark.clone()), params()),
        ("on metal", build("office", panorama()), mirrored),
        ("below a sky", build("cornell", panorama()), params()),
        ("all white", build("office", white.clone()), flat),
        ("bounced", build("cornell", white), bounced),
        ("by photons", build("cornell", dark), landed),
    ]
}

/// A ray that a metal reflects.
struct Ray {
    pixel: u32,
    seen: Seen,
    towards: Vec3,
    weight: Vec3,
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
    fn new(context: &Context, scene: Scene, params: PhotonParams) -> Self {
        let scene = Arc::new(scene);
        let all = Selection::default();
        Self {
            context: context.clone(),
            gpu_scene: GpuScene::new(context, &scene).unwrap(),
            exact: BvhTracer::build(&scene, &all, &BvhOptions::default()).unwrap(),
            tracer: ComputeBvhTracer::build(context, &scene, &all, &()).unwrap(),
            scene,
            params,
        }
    }

    fn gather(&self) -> Gather {
        let (context, world) = (&self.context, (&*self.scene, &self.gpu_scene));
        let picture = Picture {
            size: SIZE,
            lights: true,
            irradiance: true,
            mirrored: true,
        };
        let all = Selection::default();
        let triangles = Triangles::new(&self.scene, &self.scene.transforms(), &all).unwrap();
        let sent = Photons::emit(&triangles, &self.exact, &self.params).unwrap();
        let (params, tracer, sent) = (&self.params, &self.tracer, Some(&sent));
        Gather::new(context, world, &all, params, tracer, picture, sent).unwrap()
    }

    fn seen(&self, sample: u32) -> (cpu::Points, Vec<Seen>) {
        let (scene, camera) = (&self.scene, &self.scene.cameras[0]);
        let kinds = (self.params.normals, self.params.materials);
        cpu::Points::with_seen(scene, &self.exact, camera, SIZE, sample, kinds)
    }

    fn on_cpu(&self) -> Lit {
        let scene = &self.scene;
        let triangles = Triangles::new(scene, &scene.transforms(), &Selection::default()).unwrap();
        let photons = Photons::emit(&triangles, &self.exact, &self.params).unwrap();
        let missing = 0.5 * (self.params.maps.maps * self.params.frames) as f32 / SAMPLES as f32;
        let mut weights = vec![missing * SAMPLES as f32; COUNT];
        // Of lights, of the sky, of surfaces: radiance and irradiance.
        let mut sums = vec![[[Vec3::ZERO; 2]; 3]; COUNT];
        let mut rays = Vec::new();
        for sample in 0..SAMPLES {
            let (points, seen) = self.seen(sample);
            let (light, _) = photons.light(&points, [sample, SAMPLES], &|_, _| {});
            let landed = photons.direct(&points);
            self.reflect(&points, &seen, sample, &mut rays);
            let all = points.indices().iter().zip(light).zip(landed).zip(&seen);
            for (((&pixel, light), landed), seen) in all {
                let sums = &mut sums[pixel as usize];
                weights[pixel as usize] += light.weight - missing;
                let sent = |light| [seen.albedo() / PI * light, light];
                let direct = match self.params.direct {
                    true => sent(landed),
                    false => self.by_rays(pixel, sample, seen),
                };
                for (sum, more) in sums
                    .iter_mut()
                    .zip([direct, sent(light.sky), sent(light.light)])
                {
                    *sum = [sum[0] + more[0], sum[1] + more[1]];
                }
                if seen.material.unlit {
                    sums[0][0] += seen.material.base_color;
                }
            }
        }
        // Of surfaces that metals show.
        let mut shown = vec![Vec3::ZERO; COUNT];
        for (pixel, [light, sky]) in self.mirrored(&photons, &rays) {
            sums[pixel as usize][0][0] += sky;
            shown[pixel as usize] += light;
        }
        let of = |kind: usize| {
            let pairs = sums.iter().zip(&weights);
            let mean = |([direct, sky, light], weight): (&[[Vec3; 2]; 3], &f32)| {
                let direct = direct[kind] / SAMPLES as f32 + sky[kind] / *weight;
                (direct, light[kind] / *weight)
            };
            pairs.map(mean).unzip::<_, _, Vec<_>, Vec<_>>()
        };
        let ((direct, mut indirect), (direct_irradiance, irradiance)) = (of(0), of(1));
        for (light, shown) in indirect.iter_mut().zip(shown) {
            *light += shown / SAMPLES as f32;
        }
        Lit {
            direct: Light {
                radiance: direct,
                irradiance: direct_irradiance,
            },
            indirect: Light {
                radiance: indirect,
                irradiance,
            },
        }
    }

    /// The rays that metals reflect.
    fn reflect(&self, points: &cpu::Points, seen: &[Seen], sample: u32, rays: &mut Vec<Ray>) {
        for (&pixel, seen) in points.indices().iter().zip(seen) {
            let share = seen.material.metallic;
            if share <= 0.0 {
                continue;
            }
            let metal = SurfaceMaterial {
                base_color: share * seen.material.base_color,
                metallic: 1.0,
                transmission: 0.0,
                ..seen.material
            };
            let bsdf = Bsdf::new(seen.normal(), &metal, seen.is_outside());
            let sampler = Sampler::new(self.params.seed ^ 0x6c64_6d67, pixel, sample);
            if let Some(chosen) = bsdf.sample(seen.view, 0.0, sampler.get_2d(0)) {
                rays.push(Ray {
                    pixel,
                    seen: *seen,
                    towards: chosen.light,
                    weight: chosen.weight,
                });
            }
        }
    }

    /// What metals show of surfaces and of the sky, and in which pixels.
    fn mirrored(&self, photons: &Photons<'_>, rays: &[Ray]) -> Vec<(u32, [Vec3; 2])> {
        let seen: Vec<Seen> = rays.iter().map(|ray| ray.seen).collect();
        let towards: Vec<Vec3> = rays.iter().map(|ray| ray.towards).collect();
        let points = cpu::Points::of_seen(&seen, self.params.normals);
        let (found, _) = photons.mirrored(&points, &towards, &|_, _| {});
        let shown = |(ray, found): (&Ray, Mirrored)| {
            (
                ray.pixel,
                [ray.weight * found.light, ray.weight * found.sky],
            )
        };
        rays.iter().zip(found).map(shown).collect()
    }

    /// Radiance and irradiance straight from the lights.
    fn by_rays(&self, pixel: u32, sample: u32, seen: &Seen) -> [Vec3; 2] {
        let lights = DirectLight::without_environment(&self.scene, &self.exact);
        let sampler = Sampler::new(self.params.seed, pixel, sample);
        let (normal, material) = (seen.normal(), &seen.material);
        let black = Bsdf::diffuse(normal, Vec3::ZERO);
        let lit = match material.unlit {
            true => black,
            false => Bsdf::new(normal, material, seen.is_outside()),
        };
        let white = Bsdf::diffuse(normal, Vec3::splat(PI));
        [lit, white].map(|bsdf| lights.scattered(&seen.point, seen.view, &bsdf, &sampler).0)
    }

    /// With maps fitted around the CPU's points.
    fn on_gpu(&self, gather: &mut Gather) -> Lit {
        let (context, camera) = (&self.context, &self.scene.cameras[0]);
        let mut points = Points::new(context, SIZE).unwrap();
        let world = (&*self.scene, &self.gpu_scene);
        let all = Selection::default();
        let about = OcclusionParams::default();
        let about =
            Occlusion::new(context, world, &all, &about, BuildMethod::default(), SIZE).unwrap();
        let submit = |encoder| context.submit("light", encoder).unwrap();
        let encoder = || context.device().create_command_encoder(&Default::default());
        for _ in 0..3 {
            let mut first = encoder();
            gather.begin(&mut first, &self.gpu_scene);
            submit(first);
            for sample in 0..SAMPLES {
                let mut seeing = encoder();
                let on = (&self.gpu_scene, &self.tracer as _);
                let look = (camera, sample);
                gather
                    .see(context, &mut seeing, on, look, &mut points, None)
                    .unwrap();
                submit(seeing);
                points.upload(context, &about, &self.seen(sample).0);
                let mut adding = encoder();
                let part = [sample, SAMPLES];
                gather
                    .add(context, &mut adding, on, &points, part, None)
                    .unwrap();
                submit(adding);
            }
            let targets = LitTargets::new(context, SIZE).unwrap();
            let mut last = encoder();
            gather.resolve(context, &mut last, &targets).unwrap();
            submit(last);
            if gather.has_room(context).unwrap() {
                return targets.read(context).unwrap().0;
            }
        }
        panic!("there is never room");
    }

    fn rendered(&self, gather: &mut Gather) -> Lit {
        let world = World {
            scene: &self.scene,
            gpu_scene: &self.gpu_scene,
            exact: &self.tracer,
            secondary: &self.tracer,
        };
        let camera = &self.scene.cameras[0];
        let made = gather.render(&self.context, world, camera, SAMPLES, &|_, _| {});
        made.unwrap().0
    }
}

/// relRMSE, the largest of all kinds of light.
fn off(found: &Lit, expected: &Lit) -> f32 {
    let error = |found: &[Vec3], expected: &[Vec3]| {
        let pairs = found.iter().zip(expected);
        let squares: f32 = pairs.map(|(a, b)| (*a - *b).length_squared()).sum();
        let sum: f32 = expected.iter().map(|light| light.element_sum()).sum();
        match squares > 0.0 {
            true => (squares * 3.0 * COUNT as f32).sqrt() / sum,
            false => 0.0,
        }
    };
    let of = |found: &Light, expected: &Light| {
        [
            error(&found.radiance, &expected.radiance),
            error(&found.irradiance, &expected.irradiance),
        ]
    };
    let all = [
        of(&found.direct, &expected.direct),
        of(&found.indirect, &expected.indirect),
    ];
    println!("{all:?}");
    all.into_iter().flatten().fold(0.0, f32::max)
}

#[test]
fn gathered_light_is_that_of_the_cpu() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    for (name, scene, params) in cases() {
        println!("{name}");
        let ground = Ground::new(&context, scene, params);
        let expected = ground.on_cpu();
        let mut gather = ground.gather();
        let error = off(&ground.on_gpu(&mut gather), &expected);
        let most = match name {
            "on metal" => MOST_OF_METALS,
            _ => [MOST; 2],
        };
        assert!(error < most[1], "{name}: {error}");
        let found = ground.rendered(&mut gather);
        let error = off(&found, &expected);
        assert!(error < most[0], "{name}: {error}");
        let is_bounced = found
            .indirect
            .radiance
            .iter()
            .any(|light| *light != Vec3::ZERO);
        assert_eq!(is_bounced, params.bounces > 0, "{name}");
        // No flicker: the same picture again is the same to the bit.
        assert_eq!(found, ground.rendered(&mut gather), "{name}");
    }
}
