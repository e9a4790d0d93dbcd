//! Table 1: secondary rays per second, shading included, beside the exact tracer on the same rays.

use anyhow::Result;
use serde_json::{Value, json};

use super::sibenik;
use crate::paper::{
    lab::{Lab, Scene, Shot},
    page::{Part, Section},
    report::{cells, percent},
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

/// Where rays are traced, and by whom exactly.
struct Device {
    name: &'static str,
    /// Of every picture.
    flags: &'static [&'static str],
    exact: &'static str,
}

const CPU: Device = Device {
    name: "CPU",
    flags: &["--device=cpu"],
    exact: "--tracer=bvh",
};
const GPU: Device = Device {
    name: "GPU",
    flags: &["--device=gpu"],
    exact: "--tracer=compute-bvh",
};

const HEAD: [&str; 9] = [
    "rays",
    "device",
    "tracer",
    "maps",
    "then, million/s",
    "now, million/s",
    "× exact tracer",
    "picture's relRMSE",
    "bias",
];

pub(super) fn measure(lab: &Lab) -> Result<(Section, Value)> {
    let scene = sibenik(lab);
    let devices = if lab.gpu { &[CPU, GPU][..] } else { &[CPU] };
    let (mut rows, mut numbers, mut names) = (Vec::new(), Vec::new(), Vec::new());
    for device in devices {
        for brdf in &BRDFS {
            let name = measure_one(lab, &scene, device, brdf, &mut rows, &mut numbers)?;
            names.push(name);
        }
    }
    names.dedup();
    let text = format!(
        "{}, one secondary or shadow ray after another with its shading, on {}. Error is the picture's against that by the \
         exact tracer of the same device with the same rays: what the maps get wrong, without noise.",
        scene.title,
        names.join(" and ")
    );
    let section = Section {
        id: "table-1",
        title: "Table 1: rays per second",
        parts: vec![
            Part::Text(text),
            Part::Table {
                head: cells(HEAD),
                rows,
            },
        ],
    };
    Ok((section, Value::Array(numbers)))
}

/// Adds the rows of one kind of rays; tells the device's own name.
fn measure_one(
    lab: &Lab,
    scene: &Scene,
    device: &Device,
    brdf: &Brdf,
    rows: &mut Vec<Vec<String>>,
    numbers: &mut Vec<Value>,
) -> Result<String> {
    let size = if lab.quick {
        "--size=128x128"
    } else {
        "--size=512x512"
    };
    // A built-in scene is one of many objects, whose materials are as they are.
    let flags = brdf.flags.iter().copied();
    let flags = flags.filter(|flag| !(scene.is_builtin && flag.starts_with("--material")));
    let flags: Vec<&str> = flags.chain(device.flags.iter().copied()).collect();
    let shoot = |name: &str, more: &[&str]| {
        let name = format!("table1-{}-{}-{name}", device.name, brdf.pass);
        let base = ["--technique=ldi", size];
        lab.render(&name, scene, &[&base[..], &flags, more].concat())
    };
    let exact = shoot("exact", &[device.exact])?;
    let rate = exact.mrays(brdf.pass)?;
    let mut row = |tracer: &str, maps: String, then: &str, now: &Now| {
        rows.push(vec![
            brdf.name.to_owned(),
            device.name.to_owned(),
            tracer.to_owned(),
            maps,
            then.to_owned(),
            format!("{:.2}", now.mrays),
            format!("{:.2}", now.mrays / rate),
            percent(now.rel_rmse),
            percent(now.bias),
        ]);
        numbers.push(json!({
            "rays": brdf.name, "device": device.name, "tracer": tracer, "mrays": now.mrays, "of_exact": now.mrays / rate,
            "rel_rmse": now.rel_rmse, "bias": now.bias, "command": now.command,
        }));
    };
    row(
        "exact",
        String::new(),
        "",
        &Now::of(lab, &exact, &exact, brdf.pass)?,
    );
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
            let maps = format!("{} × {resolution}²", brdf.directions);
            row(&format!("maps, {layers}"), maps, then, &now);
        }
    }
    let name = exact.report["device"].as_str().unwrap_or(device.name);
    Ok(name.to_owned())
}

/// Speed and error of the same picture.
struct Now {
    mrays: f64,
    rel_rmse: f64,
    bias: f64,
    command: String,
}

impl Now {
    fn of(lab: &Lab, shot: &Shot, exact: &Shot, pass: &str) -> Result<Self> {
        let [rel_rmse, bias] = lab.compare(shot, exact)?;
        Ok(Self {
            mrays: shot.mrays(pass)?,
            rel_rmse,
            bias,
            command: shot.command.clone(),
        })
    }
}
