//! What ambient occlusion takes on the GPU, maps built included, in both ways of building them, beside the compute BVH with as many
//! rays a pixel; and what the stages of splatted photons take, in both ways of splatting: one line of JSON for each case.
//!
//! ```sh
//! cargo bench -p isophote-ldm-ambient --features gpu --bench gpu -- SCENE [--size WxH] [--case MAPS:RESOLUTION:D_MAX]... \
//!     [--splats MAPS:RESOLUTION:RASTER:SPLAT_SIZE]...
//! ```
//!
//! The shortest of three times each, seen points not counted for maps; of the passes of one more picture the device's own times,
//! where it has a clock. `D_MAX` is in metres, or `inf`, without which both ways are the same. Of photons, `splatting` is listing and
//! adding, and `share` its share of the time in which the device was at work.

use std::{collections::BTreeMap, path::Path, sync::Arc, time::Instant};

use glam::Vec2;

use isophote_ldm_ambient::{
    Deposit, MapParams, OcclusionParams, PhotonParams,
    gpu::{
        BuildMethod, CameraPoints, Look, Occlusion, Points,
        photons::{Photons, SplatMethod},
    },
};
use isophote_scene::{
    Pass, Scene, Selection, builtin,
    gpu::{
        Adapter, AdapterChoice, BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, Timer,
        reference::{Integrator, World},
    },
    load,
    reference::{Materials, Normals, Quantity, Settings},
};
use serde_json::{Value, json};

const REPEATS: usize = 3;

fn main() {
    let (mut name, mut size) = ("builtin:office".to_owned(), [160, 120]);
    let (mut cases, mut splats) = (Vec::new(), Vec::new());
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().expect("a value");
        match word.as_str() {
            // Cargo's own.
            "--bench" => {}
            "--size" => {
                let text = value();
                let (width, height) = text.split_once('x').expect("WxH");
                size = [width, height].map(|side| side.parse().expect("a number"));
            }
            "--case" => cases.push(value()),
            "--splats" => splats.push(value()),
            flag if flag.starts_with("--") => panic!("what is {flag}?"),
            scene => name = scene.into(),
        }
    }
    let scene = match builtin::is_builtin(&name) {
        true => builtin::build(&name),
        false => load(Path::new(&name)),
    };
    let scene = Arc::new(scene.expect("a scene"));
    let adapter = Adapter::find(&AdapterChoice::Any).expect("an adapter");
    let context = adapter.open().expect("a device");
    let gpu_scene = GpuScene::new(&context, &scene).expect("a scene on the GPU");
    let tree = ComputeBvhTracer::build(&context, &scene, &Selection::default(), &());
    let tree = tree.expect("a tree");
    let world = World {
        scene: &scene,
        gpu_scene: &gpu_scene,
        exact: &tree,
        secondary: &tree,
    };
    let occlusion = cases
        .iter()
        .map(|case| measure(&context, world, size, case));
    let light = splats.iter().map(|case| splat(&context, world, size, case));
    for mut line in occlusion.chain(light) {
        line["adapter"] = json!(adapter.info.name);
        println!("{line}");
    }
}

/// Seconds of the shortest time.
fn shortest(mut run: impl FnMut() -> f64) -> f64 {
    (0..REPEATS).map(|_| run()).fold(f64::INFINITY, f64::min)
}

fn measure(context: &Context, world: World<'_>, size: [u32; 2], case: &str) -> Value {
    let mut words = case.split(':');
    let mut word = || words.next().expect("MAPS:RESOLUTION:D_MAX");
    let maps = MapParams {
        maps: word().parse().expect("a number"),
        resolution: word().parse().expect("a number"),
        ..MapParams::default()
    };
    let params = OcclusionParams {
        maps,
        d_max: word().parse().expect("metres"),
        ..OcclusionParams::default()
    };
    let camera = &world.scene.cameras[0];
    let of_method = |method| {
        let scene: (&Scene, &GpuScene) = (world.scene, world.gpu_scene);
        let selection = Selection::default();
        let occlusion = Occlusion::new(context, scene, &selection, &params, method, size);
        let mut occlusion = occlusion.expect("pipelines");
        let seconds = shortest(|| {
            let (_, passes) = occlusion
                .render(context, world, camera, 1, Normals::Smooth, &|_, _| {})
                .expect("a picture");
            let passes = passes
                .iter()
                .filter(|pass: &&Pass| pass.name == "occlusion");
            passes.map(|pass| pass.seconds).sum()
        });
        json!({ "seconds": seconds, "passes": passes(context, world, size, &mut occlusion) })
    };
    let [linearised, lists] = [BuildMethod::Linearised, BuildMethod::LinkedLists].map(of_method);
    let seconds = |way: &Value| way["seconds"].as_f64().unwrap_or(f64::NAN);
    let fastest = seconds(&linearised).min(seconds(&lists));
    let settings = Settings {
        samples: maps.maps,
        d_max: params.d_max,
        ..Settings::default()
    };
    let mut integrator = Integrator::new(context);
    let exact = shortest(|| {
        let start = Instant::now();
        let quantities = [Quantity::Ao];
        let made = integrator.render(world, camera, size, &quantities, &settings, &|_, _| {});
        made.expect("a picture");
        start.elapsed().as_secs_f64()
    });
    json!({
        "maps": maps.maps, "resolution": maps.resolution, "size": size,
        "d_max": if params.d_max.is_finite() { json!(params.d_max) } else { Value::Null },
        "linearised": linearised, "linked_lists": lists,
        "compute_bvh_seconds": exact, "times": exact / fastest,
    })
}

/// Seconds of the passes of a picture, by their names.
fn passes(
    context: &Context,
    world: World<'_>,
    size: [u32; 2],
    occlusion: &mut Occlusion,
) -> BTreeMap<String, f64> {
    let finder = CameraPoints::new(context, world.gpu_scene, world.exact).expect("a pipeline");
    let mut points = Points::new(context, size).expect("points");
    let mut timer = Timer::new(context, 2048);
    let look = Look {
        camera: &world.scene.cameras[0],
        place: Vec2::splat(0.5),
        sample: 0,
        normals: Normals::Smooth,
    };
    let mut encoder = context.device().create_command_encoder(&Default::default());
    let scene = world.gpu_scene;
    occlusion.begin(&mut encoder, scene);
    let asked = (scene, world.exact);
    finder
        .record(context, &mut encoder, occlusion, asked, &look, &mut points)
        .expect("points");
    let clock = Some(&mut timer);
    occlusion
        .add(context, &mut encoder, scene, &points, [0, 1], clock)
        .expect("maps");
    timer.resolve(&mut encoder);
    context.submit("occlusion", encoder).expect("a device");
    let mut seconds = BTreeMap::new();
    for pass in timer.read(context).expect("times") {
        *seconds.entry(pass.name).or_default() += pass.time.as_secs_f64();
    }
    seconds
}

/// What the stages of photons take, by the device's clock, in both ways of splatting.
fn splat(context: &Context, world: World<'_>, size: [u32; 2], case: &str) -> Value {
    let mut words = case.split(':');
    let mut word = || words.next().expect("MAPS:RESOLUTION:RASTER:SPLAT_SIZE");
    let maps = MapParams {
        maps: word().parse().expect("a number"),
        resolution: word().parse().expect("a number"),
        ..MapParams::default()
    };
    let params = PhotonParams {
        maps,
        raster: word().parse().expect("a number"),
        splat_size: word().parse().expect("a number"),
        deposit: Deposit::Splatted,
        flatness: 3.0,
        materials: Materials::Lambert,
        ..PhotonParams::default()
    };
    let [tiled, quads] = [SplatMethod::Tiled, SplatMethod::Quads].map(|method| {
        let (on, selection) = ((world.scene, world.gpu_scene), Selection::default());
        let photons = Photons::new(context, on, &selection, &params, world.exact, method, size);
        let mut photons = photons.expect("pipelines");
        let times = (0..REPEATS).map(|_| stages(context, world, &mut photons));
        let of_all = |times: &Value| times["all"].as_f64().unwrap_or(f64::INFINITY);
        times.min_by(|a, b| of_all(a).total_cmp(&of_all(b)))
    });
    json!({
        "maps": maps.maps, "resolution": maps.resolution, "size": size,
        "raster": params.raster, "splat_size": params.splat_size,
        "tiled": tiled, "quads": quads,
    })
}

fn stages(context: &Context, world: World<'_>, photons: &mut Photons) -> Value {
    let camera = &world.scene.cameras[0];
    let made = photons.render(context, world, camera, &|_, _| {});
    let (_, passes) = made.expect("a picture");
    let of = |names: &[&str]| -> f64 {
        let named = passes.iter().filter(|pass| names.contains(&pass.name));
        named.map(|pass| pass.seconds).sum()
    };
    // All of it by the clock on the wall.
    let all = of(&["photons"]);
    let splatting = of(&["bins", "splat"]);
    json!({
        "all": all, "maps": of(&["maps"]), "split": of(&["split"]), "bins": of(&["bins"]), "splat": of(&["splat"]),
        "splatting": splatting, "share": splatting / all,
    })
}
