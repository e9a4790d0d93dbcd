//! Occlusion in shaders beside the CPU's.
//!
//! Both draw the same triangles into the same maps and ask them for the same points. What is left is rounding: that of a
//! pixel's centre on an edge, and that of a depth.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

use std::sync::Arc;

use glam::{Vec2, Vec3};
use isophote_ldm_ambient::{
    Deposit, MapParams, OcclusionParams, PhotonParams, Spread,
    cpu::{
        self, Triangles,
        occlusion::{self, Sky},
        photons::light,
    },
    gpu::{
        BuildMethod, GBufferPoints, Look, Occlusion, Points, Targets,
        photons::{Light, Photons, SplatMethod},
    },
};
use isophote_scene::{
    Alpha, BuildTracer, BvhOptions, BvhTracer, ColorSpace, Scene, Selection, Texture, TextureRef,
    builtin,
    gpu::{
        BuildGpuTracer, ComputeBvhTracer, Context, GBuffer, GBufferPass, GpuScene, Rasters,
        reference::World,
    },
    reference::{Materials, Normals},
};

const SIZE: [u32; 2] = [48, 36];
const COUNT: usize = (SIZE[0] * SIZE[1]) as usize;
/// How far two pictures may be apart, as relRMSE. Both sides round where corners are as rasterisers do.
const MOST: f32 = 0.001;
/// How photons spread, how often they bounce, and the same for their light: parts land elsewhere where a distance is rounded, and
/// turned differentials that nearly cancel make bright points of what is rounded.
const WAYS: [(Spread, u32, f32); 4] = [
    (Spread::Parallel, 1, 0.011),
    (Spread::Turned, 1, 0.03),
    (Spread::Parallel, 3, 0.013),
    (Spread::Turned, 2, 0.03),
];
/// And by quads beside tiles, which add the same splats one by one.
const MOST_OF_QUADS: f32 = 1e-5;

fn params(d_max: f32) -> OcclusionParams {
    OcclusionParams {
        maps: MapParams {
            maps: 70,
            resolution: 100,
            ..MapParams::default()
        },
        d_max,
        ..OcclusionParams::default()
    }
}

/// A device and a scene on it.
struct Ground {
    context: Context,
    scene: Arc<Scene>,
    gpu_scene: GpuScene,
    exact: BvhTracer,
}

impl Ground {
    fn new(context: &Context, scene: Scene) -> Self {
        let scene = Arc::new(scene);
        Self {
            context: context.clone(),
            gpu_scene: GpuScene::new(context, &scene).unwrap(),
            exact: BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default()).unwrap(),
            scene,
        }
    }

    fn points(&self, sample: u32) -> cpu::Points {
        let camera = &self.scene.cameras[0];
        let (scene, exact) = (&self.scene, &self.exact);
        cpu::Points::from_camera(scene, exact, camera, SIZE, sample, Normals::Smooth)
    }

    fn on_cpu(&self, params: &OcclusionParams, parts: u32) -> Vec<Sky> {
        let (scene, selection) = (&self.scene, Selection::default());
        let triangles = Triangles::new(scene, &scene.transforms(), &selection).unwrap();
        let mut occlusion = occlusion::Occlusion::new(&triangles, COUNT, params).unwrap();
        for part in 0..parts {
            occlusion.add(&self.points(part), [part, parts], &|_, _| {});
        }
        occlusion.skies()
    }

    fn occlusion(&self, params: &OcclusionParams, method: BuildMethod) -> Occlusion {
        let world = (&*self.scene, &self.gpu_scene);
        let selection = Selection::default();
        Occlusion::new(&self.context, world, &selection, params, method, SIZE).unwrap()
    }

    /// By the same points; until there was room.
    fn on_gpu(&self, occlusion: &mut Occlusion, parts: u32) -> Vec<Sky> {
        let context = &self.context;
        let targets = Targets::new(context, SIZE).unwrap();
        let all: Vec<Points> = (0..parts)
            .map(|part| {
                let mut points = Points::new(context, SIZE).unwrap();
                points.upload(context, occlusion, &self.points(part));
                points
            })
            .collect();
        for _ in 0..3 {
            let mut encoder = context.device().create_command_encoder(&Default::default());
            occlusion.begin(&mut encoder, &self.gpu_scene);
            for (part, points) in (0..).zip(&all) {
                let parts = [part, parts];
                occlusion
                    .add(context, &mut encoder, &self.gpu_scene, points, parts, None)
                    .unwrap();
            }
            occlusion.resolve(context, &mut encoder, &targets).unwrap();
            context.submit("occlusion", encoder).unwrap();
            if occlusion.has_room(context, &self.gpu_scene).unwrap() {
                return targets.read(context).unwrap();
            }
        }
        panic!("there is never room");
    }
}

impl Ground {
    /// Twice the same.
    fn splatted(&self, params: &PhotonParams, method: SplatMethod) -> Light {
        let (context, all) = (&self.context, Selection::default());
        let tracer = ComputeBvhTracer::build(context, &self.scene, &all, &()).unwrap();
        let world = World {
            scene: &self.scene,
            gpu_scene: &self.gpu_scene,
            exact: &tracer,
            secondary: &tracer,
        };
        let on = (&*self.scene, &self.gpu_scene);
        let made = Photons::new(context, on, &all, params, &tracer, method, SIZE);
        let mut photons = made.unwrap();
        let [found, again] = [0; 2].map(|_| {
            let made = photons.render(context, world, &self.scene.cameras[0], &|_, _| {});
            made.unwrap().0
        });
        assert_eq!(found, again, "{method:?}: no flicker");
        found
    }
}

/// relRMSE of a value.
fn off(found: &[Sky], expected: &[Sky], value: impl Fn(&Sky) -> f32) -> f32 {
    let squares: f32 = found
        .iter()
        .zip(expected)
        .map(|(a, b)| (value(a) - value(b)).powi(2))
        .sum();
    let mean = expected.iter().map(&value).sum::<f32>() / expected.len() as f32;
    (squares / expected.len() as f32).sqrt() / mean
}

fn check(name: &str, found: &[Sky], expected: &[Sky], most: f32) {
    let [ao, obscurance] =
        [|sky: &Sky| sky.ao, |sky: &Sky| sky.obscurance].map(|value| off(found, expected, value));
    println!("{name}: relRMSE {ao:.1e} of ao, {obscurance:.1e} of obscurance");
    assert!(
        ao <= most && obscurance <= most,
        "{name}: {ao} {obscurance}"
    );
    let turned = found.iter().zip(expected).filter(|(a, b)| {
        b.bent_normal.length() > 0.5 && a.ao > 0.2 && a.bent_normal.dot(b.bent_normal) < 0.99
    });
    let turned = turned.count() as f32 / found.len() as f32;
    assert!(turned <= most, "{name}: {turned} of the normals");
}

fn scenes() -> Vec<(&'static str, Scene)> {
    let mut leafy = builtin::build("builtin:cornell").unwrap();
    // Walls with holes.
    let texel = |texel: u32| match (texel % 8 / 2 + texel / 16) % 2 {
        0 => [255; 4],
        _ => [255, 255, 255, 0],
    };
    let texels = (0..64).map(texel).collect();
    let texture = Texture::new("leaves", 8, 8, texels, ColorSpace::Linear);
    leafy.textures.push(Arc::new(texture));
    for material in leafy.materials.iter_mut().take(2) {
        material.alpha = Alpha::Mask { cutoff: 0.5 };
        material.base_color_texture = Some(TextureRef::new(0));
    }
    vec![
        ("cornell", builtin::build("builtin:cornell").unwrap()),
        ("office", builtin::build("builtin:office").unwrap()),
        ("masked", leafy),
    ]
}

#[test]
fn occlusion_is_that_of_the_cpu() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    for (name, scene) in scenes() {
        let ground = Ground::new(&context, scene);
        for d_max in [f32::INFINITY, 1.5] {
            let params = params(d_max);
            let expected = ground.on_cpu(&params, 1);
            let methods = [BuildMethod::Linearised, BuildMethod::LinkedLists];
            let found = methods.map(|method| {
                let mut occlusion = ground.occlusion(&params, method);
                let found = ground.on_gpu(&mut occlusion, 1);
                // No flicker: the same picture again is the same to the bit.
                assert_eq!(found, ground.on_gpu(&mut occlusion, 1), "{name} {method:?}");
                found
            });
            check(
                &format!("{name}, d_max {d_max}"),
                &found[0],
                &expected,
                MOST,
            );
            assert_eq!(
                found[0], found[1],
                "{name}: both ways lead to the same maps"
            );
        }
    }
}

/// Parts of the points share the maps, and directions are turned from frame to frame, as on the CPU.
#[test]
fn parts_and_frames_are_those_of_the_cpu() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let ground = Ground::new(&context, builtin::build("builtin:office").unwrap());
    let params = OcclusionParams {
        frames: 2,
        ..params(2.0)
    };
    let expected = ground.on_cpu(&params, 3);
    let mut occlusion = ground.occlusion(&params, BuildMethod::default());
    check("parts", &ground.on_gpu(&mut occlusion, 3), &expected, MOST);
}

/// A picture from a tracer's points and one from a G-buffer's, whose normals have 16 bits, are nearly the same, and nearly
/// what the CPU finds in maps that are fitted more tightly.
#[test]
fn cameras_and_gbuffers_see_the_same() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let ground = Ground::new(&context, builtin::build("builtin:office").unwrap());
    let params = params(2.0);
    let (scene, gpu_scene) = (&ground.scene, &ground.gpu_scene);
    let tracer = ComputeBvhTracer::build(&context, scene, &Selection::default(), &()).unwrap();
    let world = World {
        scene,
        gpu_scene,
        exact: &tracer,
        secondary: &tracer,
    };
    let camera = &scene.cameras[0];
    let mut occlusion = ground.occlusion(&params, BuildMethod::default());
    let (traced, passes) = occlusion
        .render(&context, world, camera, 1, Normals::Smooth, &|_, _| {})
        .unwrap();
    assert_eq!(passes.len(), 2);
    assert_eq!(passes[1].rays, 70 * COUNT as u64);

    let gbuffer = GBuffer::new(&context, SIZE, 1).unwrap();
    let rasters = Rasters::new(&context, Some(&gbuffer), None).unwrap();
    let taker = GBufferPoints::new(&context, gpu_scene, 1, &rasters).unwrap();
    let mut points = Points::new(&context, SIZE).unwrap();
    let targets = Targets::new(&context, SIZE).unwrap();
    let mut encoder = context.device().create_command_encoder(&Default::default());
    GBufferPass::new(&context, 1)
        .unwrap()
        .record(&context, &mut encoder, gpu_scene, camera, &gbuffer, None)
        .unwrap();
    let look = Look {
        camera,
        place: Vec2::splat(0.5),
        sample: 0,
        normals: Normals::Smooth,
    };
    let from = (gpu_scene, &rasters);
    occlusion.begin(&mut encoder, gpu_scene);
    taker
        .record(&context, &mut encoder, &occlusion, from, &look, &mut points)
        .unwrap();
    occlusion
        .add(&context, &mut encoder, gpu_scene, &points, [0, 1], None)
        .unwrap();
    occlusion.resolve(&context, &mut encoder, &targets).unwrap();
    context.submit("occlusion", encoder).unwrap();
    let rastered = targets.read(&context).unwrap();
    // At edges a rasteriser may see another surface.
    check("G-buffer", &rastered, &traced, 0.06);
    check("CPU", &traced, &ground.on_cpu(&params, 1), 0.1);
}

/// Where pixels have more layers than lists are walked along, sums take over, and the picture is the same.
#[test]
fn lists_that_are_too_long_become_sums() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let mut scene = builtin::build("builtin:cornell").unwrap();
    let block = scene.instances[2].clone();
    // In no order, so that lists are walked along whatever their direction.
    scene.instances.extend((1..700).map(|number| {
        let mut block = block.clone();
        block.transform.translation += 1.4e-4 * (number * 297 % 700) as f32;
        block
    }));
    let ground = Ground::new(&context, scene);
    let params = OcclusionParams {
        maps: MapParams {
            maps: 4,
            resolution: 8,
            ..MapParams::default()
        },
        ..params(0.5)
    };
    let [lists, sums] = [BuildMethod::LinkedLists, BuildMethod::Linearised]
        .map(|method| ground.occlusion(&params, method));
    // Lists take other memory than sums.
    assert_ne!(lists.bytes(), sums.bytes());
    let [found, expected] = [lists, sums].map(|mut occlusion| {
        let skies = ground.on_gpu(&mut occlusion, 1);
        (skies, occlusion.bytes())
    });
    assert_eq!(found.1, expected.1, "they are not sums");
    assert!(found.0 == expected.0, "the pictures are not the same");
}

/// What moves is drawn where it is, and more layers than there is room for find room.
#[test]
fn maps_follow_what_moves() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let mut ground = Ground::new(&context, builtin::build("builtin:cornell").unwrap());
    let params = params(1.0);
    let mut occlusion = ground.occlusion(&params, BuildMethod::default());
    let before = ground.on_gpu(&mut occlusion, 1);
    let mut scene = (*ground.scene).clone();
    for instance in scene.instances.iter_mut().skip(1) {
        instance.transform.translation.y += 0.1;
    }
    let moved = Ground::new(&context, scene);
    ground.gpu_scene.update(&context, &moved.scene).unwrap();
    ground.scene = moved.scene.clone();
    ground.exact = moved.exact;
    let after = ground.on_gpu(&mut occlusion, 1);
    let expected = ground.on_cpu(&params, 1);
    assert!(off(&before, &after, |sky| sky.ao) > 2.0 * MOST);
    check("moved", &after, &expected, MOST);
}

/// relRMSE of light.
fn off_light(found: &[Vec3], expected: &[Vec3]) -> f32 {
    let pairs = found.iter().zip(expected);
    let off: f32 = pairs.map(|(a, b)| (*a - *b).length_squared()).sum();
    let sum: f32 = expected.iter().map(|light| light.element_sum()).sum();
    (off * 3.0 * COUNT as f32).sqrt() / sum
}

/// Photons that leave points, spots, the sun and surfaces splat the light that they splat on the CPU, twice the same; by tiles and
/// by quads; in parallel and turned, after one bounce and after several.
#[test]
fn photons_are_those_of_the_cpu() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let ways = |(name, scene): (&'static str, Scene)| {
        let many = if name == "masked" { 1 } else { WAYS.len() };
        WAYS[..many]
            .iter()
            .map(move |way| (name, scene.clone(), way))
    };
    for (name, scene, &(spread, bounces, most)) in scenes().into_iter().flat_map(ways) {
        println!("{name}: {spread:?}, {bounces} bounces");
        let ground = Ground::new(&context, scene);
        let (scene, exact) = (&ground.scene, &ground.exact);
        let camera = &scene.cameras[0];
        let params = PhotonParams {
            maps: params(1.0).maps,
            raster: 16,
            deposit: Deposit::Splatted,
            spread,
            bounces,
            branches: 2,
            flatness: 3.0,
            materials: Materials::Lambert,
            ..PhotonParams::default()
        };
        let triangles = Triangles::new(scene, &scene.transforms(), &Selection::default()).unwrap();
        let seen = isophote_scene::GBuffer::see(scene, exact, camera, SIZE, params.materials);
        let expected = light(&triangles, exact, camera, &seen, &params, &|_, _| {}).unwrap();
        let methods = [SplatMethod::Tiled, SplatMethod::Quads];
        let [found, quads] = methods.map(|method| ground.splatted(&params, method));
        let error = off_light(&found.irradiance, &expected.indirect);
        let of_quads = off_light(&quads.irradiance, &found.irradiance);
        println!("{name}: relRMSE {error:.1e} of light; of quads beside tiles {of_quads:.1e}");
        assert!(error < most, "{name}: {error}");
        assert!(of_quads < MOST_OF_QUADS, "{name}: {of_quads}");
        let sent = |(seen, light): (&Option<isophote_scene::Seen>, &Vec3)| {
            let albedo = seen.as_ref().map_or(Vec3::ZERO, |seen| seen.albedo());
            albedo / std::f32::consts::PI * *light
        };
        let expected = seen.pixels.iter().zip(&found.irradiance).map(sent);
        for (found, expected) in found.radiance.iter().zip(expected) {
            assert!((*found - expected).length() < 0.01 * (0.1 + expected.length()));
        }
    }
}

/// Without lights and without bounces there are no photons, and it is dark.
#[test]
fn no_photons_light_nothing() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let lit = builtin::build("builtin:cornell").unwrap();
    let mut dark = lit.clone();
    dark.lights.clear();
    for material in &mut dark.materials {
        material.emissive = Vec3::ZERO;
    }
    for (scene, bounces) in [(lit, 0), (dark.clone(), 1), (dark, 3)] {
        let params = PhotonParams {
            maps: params(1.0).maps,
            raster: 8,
            deposit: Deposit::Splatted,
            bounces,
            ..PhotonParams::default()
        };
        let ground = Ground::new(&context, scene);
        for method in [SplatMethod::Tiled, SplatMethod::Quads] {
            let found = ground.splatted(&params, method);
            let light = found.irradiance.iter().chain(&found.radiance);
            assert!(
                light.copied().all(|light| light == Vec3::ZERO),
                "{method:?}"
            );
        }
    }
}
