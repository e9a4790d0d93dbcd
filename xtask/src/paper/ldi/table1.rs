//! Table 1: secondary rays per second, shading included, beside the exact tracer on the same rays.

use anyhow::Result;
use serde_json::{Value, json};

use super::{cells, percent, sibenik};
use crate::paper::{
    lab::{Lab, Shot},
    page::{Part, Section},
};

/// A row of the paper's table.
struct Brdf {
    name: &'static str,
    /// The pass that traces its rays.
    pass: &'static str,
    /// Of the cube's side: 6k² directions.
    cells: &'static str,
    directions: u32,
    /// The paper's million rays per second at 512² and at 128².
    then: [&'static str; 2],
    /// What makes these rays and few others.
    flags: &'static [&'static str],
}

const BRDFS: [Brdf; 3] = [
    Brdf {
        name: "diffuse",
        pass: "diffuse",
        cells: "4",
        directions: 96,
        then: ["11–16", "37–50"],
        flags: &["--ldi-light-rays=1", "--ldi-diffuse-rays=8"],
    },
    Brdf {
        name: "glossy",
        pass: "glossy",
        cells: "5",
        directions: 150,
        then: ["63–71", "151–209"],
        flags: &[
            "--ldi-light-rays=1",
            "--ldi-diffuse-rays=1",
            "--ldi-glossy-rays=16",
            "--material=sibenik=1,0.3",
        ],
    },
    Brdf {
        name: "soft shadows",
        pass: "direct",
        cells: "8",
        directions: 384,
        then: ["79–103", "283–377"],
        flags: &[
            "--ldi-light-rays=16",
            "--ldi-diffuse-rays=1",
            "--ldi-shadows=tracer",
            "--light-radius=0.5",
        ],
    },
];

pub(super) fn measure(lab: &Lab) -> Result<(Section, Value)> {
    let scene = sibenik(lab);
    let size = if lab.quick {
        "--size=128x128"
    } else {
        "--size=512x512"
    };
    let mut rows = Vec::new();
    let mut numbers = Vec::new();
    for brdf in &BRDFS {
        // A built-in scene is one of many objects, whose materials are as they are.
        let flags = brdf.flags.iter().copied();
        let flags = flags.filter(|flag| !(scene.is_builtin && flag.starts_with("--material")));
        let base: Vec<&str> = ["--technique=ldi", size].into_iter().chain(flags).collect();
        let shoot = |name: &str, more: &[&str]| {
            let name = format!("table1-{}-{name}", brdf.pass);
            lab.render(&name, &scene, &[&base[..], more].concat())
        };
        let exact = shoot("exact", &["--tracer=bvh"])?;
        let rate = exact.mrays(brdf.pass)?;
        rows.push(vec![
            brdf.name.to_owned(),
            "exact tracer".to_owned(),
            String::new(),
            String::new(),
            format!("{rate:.2}"),
            "1".to_owned(),
            String::new(),
            String::new(),
        ]);
        numbers.push(json!({ "rays": brdf.name, "tracer": "bvh", "mrays": rate }));
        for (resolution, then) in [("512", brdf.then[0]), ("128", brdf.then[1])] {
            for layers in ["touched", "center"] {
                let resolution = if lab.quick { "64" } else { resolution };
                let maps = [
                    format!("--ldi-layers={layers}"),
                    format!("--ldi-cells={}", brdf.cells),
                    format!("--ldi-resolution={resolution}"),
                    "--ldi-memory-limit=16384".to_owned(),
                ];
                let maps: Vec<&str> = maps.iter().map(String::as_str).collect();
                let shot = shoot(&format!("{layers}-{resolution}"), &maps)?;
                let now = Now::of(lab, &shot, &exact, brdf.pass)?;
                rows.push(vec![
                    brdf.name.to_owned(),
                    format!("maps, {layers}"),
                    format!("{} × {resolution}²", brdf.directions),
                    then.to_owned(),
                    format!("{:.2}", now.mrays),
                    format!("{:.2}", now.mrays / rate),
                    percent(now.rel_rmse),
                    percent(now.bias),
                ]);
                numbers.push(json!({
                    "rays": brdf.name, "tracer": "ldi", "layers": layers, "directions": brdf.directions,
                    "resolution": resolution, "mrays": now.mrays, "of_exact": now.mrays / rate,
                    "rel_rmse": now.rel_rmse, "bias": now.bias, "command": shot.command,
                }));
            }
        }
    }
    let head = cells([
        "rays",
        "tracer",
        "maps",
        "then, million/s",
        "now, million/s",
        "× exact tracer",
        "picture's relRMSE",
        "bias",
    ]);
    let text = format!(
        "{}, one secondary or shadow ray after another with its shading, all threads. Error is the picture's against that by \
         the exact tracer with the same rays: what the maps get wrong, without noise.",
        scene.title
    );
    let section = Section {
        id: "table-1",
        title: "Table 1: rays per second",
        parts: vec![Part::Text(text), Part::Table { head, rows }],
    };
    Ok((section, Value::Array(numbers)))
}

/// Speed and error of the same picture.
struct Now {
    mrays: f64,
    rel_rmse: f64,
    bias: f64,
}

impl Now {
    fn of(lab: &Lab, shot: &Shot, exact: &Shot, pass: &str) -> Result<Self> {
        let [rel_rmse, bias] = lab.compare(shot, exact)?;
        Ok(Self {
            mrays: shot.mrays(pass)?,
            rel_rmse,
            bias,
        })
    }
}
