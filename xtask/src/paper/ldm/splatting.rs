//! Splatting (§4.2), the paper's bottleneck: as quads that blending adds, by tiles, and not at all where points gather.

use anyhow::Result;
use serde_json::{Value, json};

use super::{Measured, cornell, sponza};
use crate::paper::{
    lab::{Lab, Shot},
    page::{Part, Section},
    report::{cells, percent},
};

const TEXT: &str = "Light that bounced once, by photons that are splatted, and gathered instead. On GPUs splats are quads that additive \
    blending adds, as in the paper, or prefix sums list them for tiles; its stages are timed by the device's own clock. Splatting is \
    listing and adding; its share is of maps, splitting and splatting. Gathered pictures have the light of 16 points a pixel, splatted ones that of one.";

/// Device, how photons light, by how much splats are wider than footprints.
const CASES: [(&str, &str, &str); 8] = [
    ("cpu", "splatted", "2"),
    ("cpu", "gathered", "2"),
    ("gpu", "quads", "2"),
    ("gpu", "tiled", "2"),
    ("gpu", "gathered", "2"),
    ("cpu", "splatted", "8"),
    ("gpu", "quads", "8"),
    ("gpu", "tiled", "8"),
];

pub(super) fn measure(lab: &Lab) -> Measured {
    let (mut rows, mut numbers) = (Vec::new(), Vec::new());
    let (size, maps, photons) = match (lab.quick, lab.gpu && lab.is_gpu_software()?) {
        (true, _) => ("--size=64x48", "--ldm-maps=16", "--ldm-photons=16"),
        // Long enough that shaders, which software compiles while it runs them, do not count.
        (false, true) => ("--size=320x240", "--ldm-maps=128", "--ldm-photons=32"),
        (false, false) => ("--size=800x800", "--ldm-maps=512", "--ldm-photons=64"),
    };
    for scene in [sponza(lab), cornell(lab)] {
        // A GPU is measured only where one is asked for.
        for (device, way, width) in CASES.iter().filter(|case| lab.gpu || case.0 == "cpu") {
            let mut flags = vec![
                "--technique=ldm".to_owned(),
                "--quantity=indirect".to_owned(),
                "--materials=lambert".to_owned(),
                size.to_owned(),
                maps.to_owned(),
                photons.to_owned(),
                format!("--device={device}"),
                format!("--ldm-splat-size={width}"),
            ];
            if *way != "gathered" {
                flags.push("--ldm-deposit=splatted".to_owned());
            }
            if ["quads", "tiled"].contains(way) {
                flags.push(format!("--ldm-splat={way}"));
            }
            let flags: Vec<&str> = flags.iter().map(String::as_str).collect();
            let shot = lab.render(&format!("splatting-{device}-{way}-{width}"), &scene, &flags)?;
            let [before, splatting] = stages(&shot, way)?;
            let share = splatting / (before + splatting);
            let milliseconds = |seconds: f64| format!("{:.1} ms", 1e3 * seconds);
            let told = match *way {
                "gathered" => cells(["–", "–", "0 %"]),
                _ => vec![
                    milliseconds(before),
                    milliseconds(splatting),
                    percent(share),
                ],
            };
            let mut row = vec![
                scene.title.clone(),
                (*width).to_owned(),
                format!("{device}, {way}"),
            ];
            row.extend(told);
            row.push(format!("{:.2} s", shot.seconds()?));
            rows.push(row);
            numbers.push(json!({
                "scene": scene.title, "splat_size": width, "device": device, "method": way, "share": share,
                "seconds": shot.seconds()?, "passes": shot.report["passes"], "gpu_seconds": shot.report["gpu_seconds"],
                "command": shot.command,
            }));
        }
    }
    let text = match lab.gpu {
        true => format!("{TEXT} {}", [size, maps, photons].join(" ")),
        false => format!(
            "{TEXT} {} Not on a GPU: no --gpu.",
            [size, maps, photons].join(" ")
        ),
    };
    let head = cells([
        "scene",
        "splat size",
        "by",
        "maps, split",
        "splatting",
        "share",
        "all",
    ]);
    let parts = vec![Part::Text(text), Part::Table { head, rows }];
    let section = Section {
        id: "splatting",
        title: "Splatting: quads, tiles, and none",
        parts,
    };
    Ok((section, Value::Array(numbers)))
}

/// Seconds before splats are added, and of adding them.
fn stages(shot: &Shot, way: &str) -> Result<[f64; 2]> {
    if way == "gathered" {
        return Ok([shot.seconds()?, 0.0]);
    }
    let listing = match way {
        "tiled" => shot.pass_seconds("bins")?,
        _ => 0.0,
    };
    let before = shot.pass_seconds("maps")? + shot.pass_seconds("split")?;
    Ok([before, listing + shot.pass_seconds("splat")?])
}
