//! What ambient occlusion takes on the GPU, maps built included, in both ways of building them, beside the compute BVH with as many
//! rays a pixel: one line of JSON for each case.
//!
//! ```sh
//! cargo bench -p isophote-ldm-ambient --features gpu --bench gpu -- SCENE [--size WxH] [--case MAPS:RESOLUTION:D_MAX]...
//! ```
//!
//! The shortest of three times each, seen points not counted for maps; of the passes of one more picture the device's own times,
//! where it has a clock. `D_MAX` is in metres, or `inf`, without which both ways are the same.

use std::{collections::BTreeMap, path::Path, sync::Arc, time::Instant};

use glam::Vec2;

use isophote_ldm_ambient::{
    MapParams, OcclusionParams,
    gpu::{BuildMethod, CameraPoints, Look, Occlusion, Points},
};
use isophote_scene::{
    Pass, Scene, Selection, builtin,
    gpu::{
        Adapter, AdapterChoice, BuildGpuTracer, ComputeBvhTracer, Context, GpuScene, Timer,
        reference::{Integrator, World},
    },
    load,
    reference::{Normals, Quantity, Settings},
};
use serde_json::{Value, json};

const REPEATS: usize = 3;

fn main() {
    let (mut name, mut size, mut cases) = ("builtin:office".to_owned(), [160, 120], Vec::new());
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
    for case in &cases {
        let mut line = measure(&context, world, size, case);
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
