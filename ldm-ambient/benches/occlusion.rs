//! What ambient occlusion takes, build included, beside the exact tracer with the same rays; and what maps take that are kept:
//! one line of JSON for each case.
//!
//! ```sh
//! cargo bench -p isophote-ldm-ambient --bench occlusion -- SCENE [--size WxH] [--share N]
//!     [--case MAPS:RESOLUTION:D_MAX]... [--stored MAPS:RESOLUTION]...
//! ```
//!
//! The exact tracer answers for every Nth pixel, 32 unless given, along the same directions; its time is multiplied by N. Both
//! see the camera's points by the exact tracer, which is counted. `D_MAX` is in metres, or `inf`.

use std::{path::Path, sync::Arc, time::Instant};

use isophote_ldm_ambient::{
    Directions, LdmTracer, MapParams, OcclusionParams,
    cpu::{Points, Triangles, occlusion::Occlusion},
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, GBuffer, Ray, Scene, Seen, Selection, Tracer, builtin,
    load,
    reference::{Materials, Normals},
};
use rayon::prelude::*;
use serde_json::{Value, json};

/// What is measured.
struct Arguments {
    scene: String,
    size: [u32; 2],
    share: usize,
    cases: Vec<String>,
    stored: Vec<String>,
}

fn main() {
    let arguments = Arguments::parse(std::env::args().skip(1));
    let scene = match builtin::is_builtin(&arguments.scene) {
        true => builtin::build(&arguments.scene),
        false => load(Path::new(&arguments.scene)),
    };
    let scene = Arc::new(scene.expect("a scene"));
    let exact = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default());
    let exact = exact.expect("a tracer");
    for case in &arguments.cases {
        println!("{}", occlusion(&scene, &exact, &arguments, case));
    }
    for case in &arguments.stored {
        println!("{}", stored(&scene, case));
    }
}

impl Arguments {
    fn parse(mut words: impl Iterator<Item = String>) -> Self {
        let mut arguments = Self {
            scene: "builtin:atrium".into(),
            size: [800, 800],
            share: 32,
            cases: Vec::new(),
            stored: Vec::new(),
        };
        while let Some(word) = words.next() {
            let mut value = || words.next().expect("a value");
            match word.as_str() {
                // Cargo's own.
                "--bench" => {}
                "--size" => {
                    let text = value();
                    let (width, height) = text.split_once('x').expect("WxH");
                    arguments.size = [width, height].map(|side| side.parse().expect("a number"));
                }
                "--share" => arguments.share = value().parse().expect("a number"),
                "--case" => arguments.cases.push(value()),
                "--stored" => arguments.stored.push(value()),
                flag if flag.starts_with("--") => panic!("what is {flag}?"),
                scene => arguments.scene = scene.into(),
            }
        }
        arguments
    }
}

/// The maps of a case, and what follows.
fn maps(case: &str) -> (MapParams, Option<&str>) {
    let mut parts = case.split(':');
    let mut number = || parts.next().expect("a number").parse().expect("a number");
    let params = MapParams {
        maps: number(),
        resolution: number(),
        ..MapParams::default()
    };
    (params, parts.next())
}

fn occlusion(scene: &Arc<Scene>, exact: &BvhTracer, arguments: &Arguments, case: &str) -> Value {
    let (maps, d_max) = maps(case);
    let d_max: f32 = d_max.map_or(f32::INFINITY, |d_max| d_max.parse().expect("metres"));
    let (camera, size) = (&scene.cameras[0], arguments.size);
    let start = Instant::now();
    let select = Selection::default();
    let triangles = Triangles::new(scene, &scene.transforms(), &select).expect("triangles");
    let points = Points::from_camera(scene, exact, camera, size, 0, Normals::Smooth);
    let camera_seconds = start.elapsed().as_secs_f64();
    let params = OcclusionParams {
        maps,
        d_max,
        ..OcclusionParams::default()
    };
    let pixels = (size[0] * size[1]) as usize;
    let mut occlusion = Occlusion::new(&triangles, pixels, &params).expect("parameters");
    occlusion.add(&points, [0, 1], &|_, _| {});
    let mean: f32 = occlusion.skies().iter().map(|sky| sky.ao).sum::<f32>() / pixels as f32;
    let seconds = start.elapsed().as_secs_f64();
    let seen = GBuffer::see(scene, exact, camera, size, Materials::Lambert);
    let directions = Directions::new(maps.maps);
    let ask = |seen: &Seen| {
        let (normal, mut rays) = (seen.normal(), 0_u64);
        for &direction in directions.vectors() {
            let direction = direction * 1_f32.copysign(direction.dot(normal));
            let ray = Ray::new(seen.point.lifted(direction, 0.0), direction).until(d_max);
            std::hint::black_box(exact.any_hit_from(&ray, seen.point.surface));
            rays += 1;
        }
        rays
    };
    let start = Instant::now();
    let some = seen.pixels.par_iter().step_by(arguments.share).flatten();
    let rays: u64 = some.map(ask).sum();
    let exact_seconds = camera_seconds + arguments.share as f64 * start.elapsed().as_secs_f64();
    json!({
        "maps": maps.maps,
        "resolution": maps.resolution,
        "d_max": if d_max.is_finite() { json!(d_max) } else { Value::Null },
        "size": size,
        "threads": rayon::current_num_threads(),
        "mean_ao": mean,
        "seconds": seconds,
        "camera_seconds": camera_seconds,
        "lookups": occlusion.lookups(),
        "exact_rays": rays * arguments.share as u64,
        "exact_seconds": exact_seconds,
        "times": exact_seconds / seconds,
        "most_bytes": occlusion.most_bytes(),
    })
}

fn stored(scene: &Arc<Scene>, case: &str) -> Value {
    let (maps, _) = maps(case);
    let start = Instant::now();
    let tracer = LdmTracer::build(scene, &Selection::default(), &maps).expect("maps");
    json!({
        "maps": maps.maps,
        "resolution": maps.resolution,
        "stored_bytes": tracer.bytes(),
        "layers": tracer.layers(),
        "build_seconds": start.elapsed().as_secs_f64(),
    })
}
