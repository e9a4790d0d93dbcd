//! What can only be seen: a sequence with a moving object, the points of maps (Fig. 3), the directions (Fig. 5). Pictures go into a
//! folder; one line of JSON for each of them and for the sequence.
//!
//! ```sh
//! cargo bench -p isophote-ldm-ambient --bench pictures -- SCENE --out FOLDER [--size WxH] [--frames N] [--d-max METRES]
//!     [--maps N] [--resolution R] [--directions N] [--cloud]
//! ```
//!
//! In the sequence an instance that is about a twentieth of the picture goes to and fro over half a metre; the first frame is
//! made twice, to the bit the same. Away from it means farther than `d_max` from all places where it is: nothing changes
//! there, and what is measured is flicker. `--frames 0` makes no sequence.

use std::{
    f32::consts::TAU,
    path::{Path, PathBuf},
    sync::Arc,
};

use glam::{Quat, Vec2, Vec3};
use isophote_ldm_ambient::{
    Directions, LdmTracer, MapParams, OcclusionParams, Partition,
    cpu::{Points, Triangles, occlusion::Occlusion},
};
use isophote_scene::{
    Aabb, BuildTracer, BvhOptions, BvhTracer, GBuffer, Image, ParallelTracer, Scene, Selection,
    builtin, load,
    reference::{Materials, Normals},
};
use serde_json::{Value, json};

/// What is made.
struct Arguments {
    scene: String,
    out: PathBuf,
    size: [u32; 2],
    frames: u32,
    d_max: f32,
    maps: MapParams,
    directions: u32,
    cloud: bool,
}

fn main() {
    let arguments = Arguments::parse(std::env::args().skip(1));
    let scene = match builtin::is_builtin(&arguments.scene) {
        true => builtin::build(&arguments.scene),
        false => load(Path::new(&arguments.scene)),
    };
    let scene = Arc::new(scene.expect("a scene"));
    if arguments.frames > 0 {
        println!("{}", sequence(&scene, &arguments));
    }
    if arguments.cloud {
        cloud(&scene, &arguments);
    }
    if arguments.directions > 0 {
        directions(&arguments);
    }
}

impl Arguments {
    fn parse(mut words: impl Iterator<Item = String>) -> Self {
        let mut arguments = Self {
            scene: "builtin:office".into(),
            out: ".".into(),
            size: [160, 120],
            frames: 0,
            d_max: 1.0,
            maps: MapParams::default(),
            directions: 0,
            cloud: false,
        };
        while let Some(word) = words.next() {
            let mut value = || words.next().expect("a value");
            match word.as_str() {
                // Cargo's own.
                "--bench" => {}
                "--cloud" => arguments.cloud = true,
                "--out" => arguments.out = value().into(),
                "--size" => {
                    let text = value();
                    let (width, height) = text.split_once('x').expect("WxH");
                    arguments.size = [width, height].map(|side| side.parse().expect("a number"));
                }
                "--frames" => arguments.frames = value().parse().expect("a number"),
                "--d-max" => arguments.d_max = value().parse().expect("a number"),
                "--maps" => arguments.maps.maps = value().parse().expect("a number"),
                "--resolution" => arguments.maps.resolution = value().parse().expect("a number"),
                "--directions" => arguments.directions = value().parse().expect("a number"),
                flag if flag.starts_with("--") => panic!("what is {flag}?"),
                scene => arguments.scene = scene.into(),
            }
        }
        arguments
    }
}

fn tracer(scene: &Arc<Scene>) -> BvhTracer {
    BvhTracer::build(scene, &Selection::default(), &BvhOptions::default()).expect("a tracer")
}

/// A frame: occlusion, and where and on which instance each pixel's point is.
struct Frame {
    open: Vec<f32>,
    seen: Vec<Option<(Vec3, u32)>>,
}

fn frame(scene: &Arc<Scene>, arguments: &Arguments) -> Frame {
    let exact = tracer(scene);
    let (camera, size) = (&scene.cameras[0], arguments.size);
    let points = Points::from_camera(scene, &exact, camera, size, 0, Normals::Smooth);
    let triangles = Triangles::new(scene, &scene.transforms(), &Selection::default());
    let triangles = triangles.expect("triangles");
    let params = OcclusionParams {
        maps: arguments.maps,
        d_max: arguments.d_max,
        ..OcclusionParams::default()
    };
    let pixels = size[0] as usize * size[1] as usize;
    let mut occlusion = Occlusion::new(&triangles, pixels, &params).expect("parameters");
    occlusion.add(&points, [0, 1], &|_, _| {});
    let place = |seen: &isophote_scene::Seen| {
        let point = &seen.point;
        (point.position, point.surface.instance)
    };
    let seen = GBuffer::see(scene, &exact, camera, size, Materials::Lambert);
    Frame {
        open: occlusion.skies().iter().map(|sky| sky.ao).collect(),
        seen: seen
            .pixels
            .iter()
            .map(|seen| seen.as_ref().map(place))
            .collect(),
    }
}

fn sequence(scene: &Arc<Scene>, arguments: &Arguments) -> Value {
    let first = frame(scene, arguments);
    let is_same = first.open == frame(scene, arguments).open;
    let object = object(scene, &first);
    let around = scene.meshes[scene.instances[object].mesh as usize].bounds();
    let (mut swept, mut frames) = (Aabb::EMPTY, Vec::new());
    for number in 0..arguments.frames {
        let mut moved = (**scene).clone();
        let transform = &mut moved.instances[object].transform;
        let turn = TAU * number as f32 / arguments.frames as f32;
        transform.translation.x += 0.25 * turn.sin();
        transform.translation.z += 0.25 * (turn.cos() - 1.0);
        let corners = around
            .corners()
            .map(|corner| transform.transform_point3(corner));
        swept = swept.union(&Aabb::around(corners));
        frames.push(frame(&Arc::new(moved), arguments));
    }
    let (mut away, mut near) = (Change::default(), Change::default());
    for pair in frames.windows(2) {
        for pixel in 0..first.open.len() {
            let [Some(a), Some(b)] = [0, 1].map(|frame| pair[frame].seen[pixel]) else {
                continue;
            };
            let change = 255.0 * (pair[1].open[pixel] - pair[0].open[pixel]);
            let off = (swept.min - a.0).max(a.0 - swept.max).max(Vec3::ZERO);
            if a == b && a.1 as usize != object && off.length() > arguments.d_max {
                away.add(change);
            } else {
                near.add(change);
            }
        }
    }
    let name = "sequence.png";
    sheet(&frames, arguments.size, &arguments.out.join(name));
    json!({
        "picture": name,
        "object": scene.meshes[scene.instances[object].mesh as usize].name,
        "frames": arguments.frames,
        "maps": arguments.maps.maps,
        "resolution": arguments.maps.resolution,
        "d_max": arguments.d_max,
        "size": arguments.size,
        "first_frame_again_is_the_same": is_same,
        "away": away.report(),
        "elsewhere": near.report(),
    })
}

/// Of pixels from frame to frame, grey levels.
#[derive(Default)]
struct Change {
    count: u64,
    changed: u64,
    squares: f64,
    most: f32,
}

impl Change {
    fn add(&mut self, change: f32) {
        self.count += 1;
        self.changed += u64::from(change != 0.0);
        self.squares += f64::from(change * change);
        self.most = self.most.max(change.abs());
    }

    fn report(&self) -> Value {
        json!({
            "pixels": self.count,
            "changed": self.changed,
            "rms": (self.squares / self.count.max(1) as f64).sqrt(),
            "most": self.most,
        })
    }
}

/// The instance that takes nearest to a twentieth of the picture.
fn object(scene: &Scene, frame: &Frame) -> usize {
    let mut pixels = vec![0_usize; scene.instances.len()];
    for (_, instance) in frame.seen.iter().flatten() {
        pixels[*instance as usize] += 1;
    }
    let wanted = frame.seen.len() / 20;
    let nearest = (0..pixels.len()).min_by_key(|&number| pixels[number].abs_diff(wanted));
    nearest.expect("an instance")
}

/// All frames side by side, ten in a row.
fn sheet(frames: &[Frame], [width, height]: [u32; 2], path: &Path) {
    let columns = frames.len().min(10);
    let rows = frames.len().div_ceil(columns);
    let mut canvas = Canvas::new([columns as u32 * width, rows as u32 * height]);
    for (number, frame) in frames.iter().enumerate() {
        let corner = [
            (number % columns) as u32 * width,
            (number / columns) as u32 * height,
        ];
        for (pixel, &open) in (0..).zip(&frame.open) {
            let at = [corner[0] + pixel % width, corner[1] + pixel / width];
            canvas.set(at, Vec3::splat(open));
        }
    }
    canvas.save(path);
}

/// A picture that is drawn pixel by pixel.
struct Canvas {
    size: [u32; 2],
    pixels: Vec<Vec3>,
}

impl Canvas {
    fn new(size: [u32; 2]) -> Self {
        Self {
            size,
            pixels: vec![Vec3::ZERO; size[0] as usize * size[1] as usize],
        }
    }

    fn set(&mut self, at: [u32; 2], color: Vec3) {
        if at[0] < self.size[0] && at[1] < self.size[1] {
            self.pixels[(at[1] * self.size[0] + at[0]) as usize] = color;
        }
    }

    fn save(&self, path: &Path) {
        let mut image = Image::new(self.size[0], self.size[1]);
        image.push_layer("", "RGB", &self.pixels);
        image.save_png(path, 0.0).expect("a picture");
    }
}

/// The points of three maps from outside, and of all maps; the nearest of each pixel, brighter the nearer it is.
fn cloud(scene: &Arc<Scene>, arguments: &Arguments) {
    let maps = LdmTracer::build(scene, &Selection::default(), &arguments.maps).expect("maps");
    let count = maps.directions().len();
    for number in [0, count / 3, 2 * count / 3] {
        let name = format!("cloud-{number}.png");
        let points = maps.point_cloud(number);
        plot(&points, &arguments.out.join(&name));
        println!(
            "{}",
            json!({
                "picture": name, "map": number, "of": count, "points": points.len(),
                "direction": maps.directions()[number].to_array(),
            })
        );
    }
}

/// Points as seen from above and aside, in parallel.
fn plot(points: &[Vec3], path: &Path) {
    const SIZE: [u32; 2] = [640, 480];
    let turn = Quat::from_rotation_x(0.6) * Quat::from_rotation_y(0.5);
    let turned: Vec<Vec3> = points.iter().map(|&point| turn * point).collect();
    let bounds = Aabb::around(turned.iter().copied());
    let extent = bounds.max - bounds.min;
    let scale = (SIZE[0] as f32 / extent.x).min(SIZE[1] as f32 / extent.y) * 0.96;
    let mut canvas = Canvas::new(SIZE);
    let mut nearest = vec![f32::NEG_INFINITY; canvas.pixels.len()];
    let center = bounds.center();
    for point in turned {
        let at = (point - center) * scale;
        let pixel = [
            (0.5 * SIZE[0] as f32 + at.x) as u32,
            (0.5 * SIZE[1] as f32 - at.y) as u32,
        ];
        let index = (pixel[1] * SIZE[0] + pixel[0]) as usize;
        if nearest.get(index).is_some_and(|depth| *depth < point.z) {
            nearest[index] = point.z;
            let near = ((point.z - bounds.min.z) / extent.z.max(1e-6)).clamp(0.0, 1.0);
            let color = Vec3::new(0.03, 0.06, 0.15).lerp(Vec3::new(1.0, 0.75, 0.4), near * near);
            canvas.set(pixel, color);
        }
    }
    canvas.save(path);
}

/// The partition of a sphere, its centres, and those of them that maps are along (Fig. 5).
fn directions(arguments: &Arguments) {
    let count = arguments.directions;
    let (all, kept) = (Partition::new(2 * count), Directions::new(count));
    let name = format!("directions-{count}.png");
    let mut canvas = Canvas::new([960, 480]);
    let turn = Quat::from_rotation_x(0.5);
    for (side, is_kept) in [(0.0, false), (480.0, true)] {
        let place = |point: Vec3| {
            let point = turn * point;
            let at = Vec2::new(240.0 + side, 240.0) + 225.0 * Vec2::new(point.x, -point.y);
            (point.z > 0.0).then_some([at.x as u32, at.y as u32])
        };
        for pixel in 0..480 * 480 {
            let at = Vec2::new((pixel % 480) as f32 - 239.5, (pixel / 480) as f32 - 239.5);
            if at.length() < 226.0 {
                canvas.set([side as u32 + pixel % 480, pixel / 480], Vec3::splat(0.02));
            }
        }
        for region in all.regions() {
            let [top, bottom] = region.colatitudes;
            let [start, end] = region.longitudes;
            let along = |colatitude: f64, longitude: f64| {
                let (height, radius) = (colatitude.cos(), colatitude.sin());
                Vec3::new(
                    (radius * longitude.sin()) as f32,
                    height as f32,
                    (radius * longitude.cos()) as f32,
                )
            };
            for step in 0..=200 {
                let share = f64::from(step) / 200.0;
                let across = start + share * (end - start);
                let mut edge = vec![along(top, across), along(bottom, across)];
                if !region.is_cap() {
                    edge.push(along(top + share * (bottom - top), start));
                }
                for at in edge.into_iter().filter_map(place) {
                    canvas.set(at, Vec3::splat(0.15));
                }
            }
        }
        let centers: Vec<Vec3> = match is_kept {
            true => kept.vectors().to_vec(),
            false => all
                .regions()
                .map(|region| region.center().as_vec3())
                .collect(),
        };
        for at in centers.into_iter().filter_map(place) {
            for pixel in 0..25 {
                let at = [at[0] + pixel % 5 - 2, at[1] + pixel / 5 - 2];
                canvas.set(at, Vec3::new(1.0, 0.5, 0.1));
            }
        }
    }
    canvas.save(&arguments.out.join(&name));
    println!(
        "{}",
        json!({ "picture": name, "regions": 2 * count, "maps": kept.vectors().len() })
    );
}
