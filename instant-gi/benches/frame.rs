//! What frames take, stage by stage, and how far shortcuts are off: one line of JSON for each case.
//!
//! ```sh
//! cargo bench -p isophote-instant-gi --bench frame -- SCENE [--size WxH] [--frames N] [--mirror MATERIAL[,…]] [--caching METRES]
//!     [--case PATHS[/SELECTED[/KEPT]]:VISIBILITY:DOWNSAMPLING:MxN:PATTERN:FILTER[+refine/N]:SEQUENCE]...
//! ```
//!
//! With SELECTED every point picks so many of the lights; with KEPT so many are kept for the picture. Visibility is `triangles`, `boxes` or `maps[/SIDE[/BIAS[/nearest]]]`, the pattern `regular` or `irregular`, the filter `edges`,
//! `fill` or `paper`, with `+refine/N` for pixels that fewer than N samples are like, the sequence `lattice` or `halton`; what is left out is the plain method's. Materials are diffuse, unless some
//! are made mirrors. Every frame shoots its light paths anew
//! and is rendered wholly; times are medians over the frames. Errors are those of the indirect light against the plain
//! method with the same light paths; `mirrors_rel_rmse` is that of what mirrors show where there
//! are some, against light gathered at all of it. The built-in office and 180 light paths unless given.

use std::{path::Path, sync::Arc, time::Instant};

use glam::Vec3;
use isophote_instant_gi::{
    Filter, GiParams, InstantGi, Lookup, Pattern, Sequence, ShadowMaps, Stages, Visibility,
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Leaves, Scene, Selection, builtin, load,
    reference::{Materials, Tracers},
};
use serde_json::{Value, json};

/// What is measured.
struct Arguments {
    scene: String,
    size: [u32; 2],
    frames: usize,
    mirrors: Vec<String>,
    caching: f32,
    cases: Vec<String>,
}

fn main() {
    let arguments = Arguments::parse(std::env::args().skip(1));
    let mut bench = Bench::new(&arguments);
    for text in &arguments.cases {
        println!("{}", bench.run(text, &Case::parse(text, bench.materials)));
    }
}

impl Arguments {
    fn parse(mut words: impl Iterator<Item = String>) -> Self {
        let mut arguments = Self {
            scene: "builtin:office".into(),
            size: [800, 600],
            frames: 7,
            mirrors: Vec::new(),
            caching: 0.0,
            cases: Vec::new(),
        };
        while let Some(word) = words.next() {
            let mut value = || words.next().expect("a value");
            match word.as_str() {
                // Cargo's own.
                "--bench" => {}
                "--size" => arguments.size = pair(&value()),
                "--frames" => arguments.frames = value().parse().expect("a number"),
                "--mirror" => arguments.mirrors = value().split(',').map(str::to_owned).collect(),
                "--caching" => arguments.caching = value().parse().expect("a number"),
                "--case" => arguments.cases.push(value()),
                flag if flag.starts_with("--") => panic!("what is {flag}?"),
                scene => arguments.scene = scene.into(),
            }
        }
        if arguments.cases.is_empty() {
            arguments.cases = ["180", "180:boxes", "180:boxes:4", "180:boxes:4:3x3"]
                .map(str::to_owned)
                .into();
        }
        arguments
    }
}

fn pair(text: &str) -> [u32; 2] {
    let (a, b) = text.split_once('x').expect("NxN");
    [a, b].map(|side| side.parse().expect("a number"))
}

/// A way to make frames.
struct Case {
    boxes: bool,
    params: GiParams,
}

impl Case {
    fn parse(text: &str, materials: Materials) -> Self {
        let mut parts = text.split(':');
        let mut next = || parts.next();
        let counts = next().unwrap_or("180").split('/');
        let mut counts = counts.map(|count| count.parse().expect("a number"));
        let paths = counts.next().unwrap_or(180);
        let selection = counts.next().unwrap_or(0);
        let kept = counts.next().unwrap_or(0);
        let seen_by = next().unwrap_or("triangles");
        let boxes = seen_by == "boxes";
        let visibility = match seen_by.strip_prefix("maps") {
            Some(maps) => Visibility::Maps(shadow_maps(maps)),
            None => Visibility::Rays,
        };
        let mut params = GiParams {
            paths,
            selection,
            kept,
            downsampling: next().map_or(1, |factor| factor.parse().expect("a number")),
            interleaving: next().map_or([1, 1], pair),
            pattern: match next() {
                Some("irregular") => Pattern::Irregular,
                _ => Pattern::Regular,
            },
            visibility,
            light_rays: 1,
            materials,
            ..GiParams::default()
        };
        let filter = next().unwrap_or("edges");
        let (filter, refinement) = filter.split_once("+refine/").unwrap_or((filter, "0"));
        params.refinement = refinement.parse().expect("a number");
        params.filter = match filter {
            "paper" => Filter::Paper,
            "fill" => Filter::Fill,
            _ => Filter::Edges,
        };
        if next() == Some("halton") {
            params.sequence = Sequence::Halton;
        }
        Self { boxes, params }
    }
}

/// Side, bias and look-up, each behind a slash.
fn shadow_maps(text: &str) -> ShadowMaps {
    let mut maps = ShadowMaps::default();
    let mut parts = text.split('/').skip(1);
    if let Some(side) = parts.next() {
        maps.resolution = side.parse().expect("a number");
    }
    if let Some(bias) = parts.next() {
        maps.bias = bias.parse().expect("a number");
    }
    if parts.next() == Some("nearest") {
        maps.lookup = Lookup::Nearest;
    }
    maps
}

/// Light paths, and the light of the plain method with them.
type Truth = ((u32, Sequence), [Vec<Vec3>; 2]);

/// A scene and who answers its rays.
struct Bench<'a> {
    arguments: &'a Arguments,
    scene: Arc<Scene>,
    materials: Materials,
    triangles: BvhTracer,
    boxes: BvhTracer,
    /// Indirect light of the plain method and what mirrors show, with its light paths.
    truth: Option<Truth>,
}

impl<'a> Bench<'a> {
    fn new(arguments: &'a Arguments) -> Self {
        let scene = match builtin::is_builtin(&arguments.scene) {
            true => builtin::build(&arguments.scene),
            false => load(Path::new(&arguments.scene)),
        };
        let mut scene = scene.expect("a scene");
        for name in &arguments.mirrors {
            let found = scene
                .materials
                .iter_mut()
                .find(|material| &material.name == name);
            let material = found.unwrap_or_else(|| panic!("there is no material {name}"));
            (material.metallic, material.roughness) = (1.0, 0.0);
            material.metallic_roughness_texture = None;
        }
        let scene = Arc::new(scene);
        let triangles = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default())
            .expect("a tracer");
        let boxes = triangles.with_leaves(Leaves::Boxes);
        let materials = match arguments.mirrors.is_empty() {
            true => Materials::Lambert,
            false => Materials::Pbr,
        };
        Self {
            arguments,
            scene,
            materials,
            triangles,
            boxes,
            truth: None,
        }
    }

    fn render(&self, case: &Case) -> Stages {
        let secondary = if case.boxes {
            &self.boxes
        } else {
            &self.triangles
        };
        let tracers = Tracers {
            exact: &self.triangles,
            secondary,
        };
        let gi =
            InstantGi::new(&self.scene, tracers, &case.params).expect("parameters in their range");
        gi.render(&self.scene.cameras[0], self.arguments.size, &|_, _| {})
            .expect("a picture")
    }

    /// Indirect light of the plain method with the same light paths, and what mirrors show.
    fn truth(&mut self, case: &Case) -> [Vec<Vec3>; 2] {
        let paths = (case.params.paths, case.params.sequence);
        if let Some((of, truth)) = &self.truth
            && *of == paths
        {
            return truth.clone();
        }
        let plain = Case {
            boxes: false,
            params: GiParams {
                selection: 0,
                kept: 0,
                downsampling: 1,
                interleaving: [1, 1],
                refinement: 0,
                visibility: Visibility::Rays,
                ..case.params
            },
        };
        let stages = self.render(&plain);
        let truth = [stages.indirect, stages.specular];
        self.truth = Some((paths, truth.clone()));
        truth
    }

    fn run(&mut self, text: &str, case: &Case) -> Value {
        let [truth, mirrored] = self.truth(case);
        let case = &Case {
            params: GiParams {
                caching: self.arguments.caching,
                ..case.params
            },
            ..*case
        };
        let mut frames = Vec::new();
        let mut stages: Vec<Vec<f64>> = Vec::new();
        let mut last = Stages::default();
        for _ in 0..self.arguments.frames {
            drop(std::mem::take(&mut last));
            let start = Instant::now();
            last = self.render(case);
            frames.push(start.elapsed().as_secs_f64());
            stages.push(last.passes.iter().map(|pass| pass.seconds).collect());
        }
        let passes = last.passes.iter().enumerate().map(|(number, pass)| {
            let seconds = median(stages.iter().map(|stages| stages[number]).collect());
            json!({ "name": pass.name, "seconds": seconds, "rays": pass.rays, "shadow_rays": pass.shadow_rays })
        });
        let [rel_rmse, bias] = errors(&last.indirect, &truth);
        let [gained, lost] = changes(&last.indirect, &truth);
        json!({
            "scene": self.arguments.scene,
            "case": text,
            "size": self.arguments.size,
            "mirrors": self.arguments.mirrors,
            "threads": rayon::current_num_threads(),
            "vpls": last.vpls.len(),
            "frame_seconds": median(frames),
            "passes": passes.collect::<Vec<_>>(),
            "caching": self.arguments.caching,
            "mirrors_rel_rmse": where_mirrored(&last.specular, &mirrored),
            "rel_rmse": rel_rmse,
            "bias": bias,
            "gained": gained,
            "lost": lost,
        })
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// What pixels have more and what they have less, of all light.
fn changes(values: &[Vec3], truth: &[Vec3]) -> [f64; 2] {
    let pairs = || values.iter().zip(truth).map(|(a, b)| *a - *b);
    let sum = |changes: &mut dyn Iterator<Item = Vec3>| -> f64 {
        changes.map(|change| f64::from(change.element_sum())).sum()
    };
    let all = sum(&mut truth.iter().copied());
    let gained = sum(&mut pairs().map(|change| change.max(Vec3::ZERO)));
    let lost = sum(&mut pairs().map(|change| (-change).max(Vec3::ZERO)));
    [gained / all, lost / all]
}

/// relRMSE in the pixels that show mirrors; 0 where there are none.
fn where_mirrored(values: &[Vec3], truth: &[Vec3]) -> f64 {
    let pairs = values.iter().zip(truth);
    let (values, truth): (Vec<Vec3>, Vec<Vec3>) =
        pairs.filter(|(_, truth)| **truth != Vec3::ZERO).unzip();
    match truth.is_empty() {
        true => 0.0,
        false => errors(&values, &truth)[0],
    }
}

/// relRMSE and bias.
fn errors(values: &[Vec3], truth: &[Vec3]) -> [f64; 2] {
    let sum = |values: &[Vec3]| {
        values
            .iter()
            .map(|value| f64::from(value.element_sum()))
            .sum::<f64>()
    };
    let squares = values.iter().zip(truth);
    let squares: f64 = squares
        .map(|(a, b)| f64::from((*a - *b).length_squared()))
        .sum();
    let count = 3.0 * truth.len() as f64;
    let mean = sum(truth) / count;
    [
        (squares / count).sqrt() / mean,
        sum(values) / sum(truth) - 1.0,
    ]
}
