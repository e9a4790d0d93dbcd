//! Splatting on a GPU (§4.2), the paper's bottleneck: as quads that blending adds, and by tiles.

use serde_json::{Value, json};

use super::{Measured, cornell, sponza};
use crate::paper::{
    lab::Lab,
    page::{Part, Section},
    report::{cells, percent},
};

const TEXT: &str = "Photons splatted on the GPU: by quads that additive blending adds, as in the paper, and by tiles, for which prefix \
    sums list what reaches them. Splatting is listing and adding; its share is that of all stages, which are timed by the device's own clock.";

pub(super) fn measure(lab: &Lab) -> Measured {
    let (mut rows, mut numbers) = (Vec::new(), Vec::new());
    let (size, maps, photons) = match (lab.quick, lab.gpu && lab.is_gpu_software()?) {
        (true, _) => ("--size=64x48", "--ldm-maps=16", "--ldm-photons=16"),
        // Long enough that shaders, which software compiles while it runs them, do not count.
        (false, true) => ("--size=320x240", "--ldm-maps=128", "--ldm-photons=32"),
        (false, false) => ("--size=800x800", "--ldm-maps=512", "--ldm-photons=64"),
    };
    // A GPU is measured only where one is asked for.
    let scenes = match lab.gpu {
        true => vec![sponza(lab), cornell(lab)],
        false => Vec::new(),
    };
    for scene in scenes {
        for (width, method) in [
            ("2", "quads"),
            ("2", "tiled"),
            ("8", "quads"),
            ("8", "tiled"),
        ] {
            let flags = [
                "--technique=ldm",
                "--quantity=indirect",
                "--materials=lambert",
                "--device=gpu",
                size,
                maps,
                photons,
                "--ldm-deposit=splatted",
                &format!("--ldm-splat={method}"),
                &format!("--ldm-splat-size={width}"),
            ];
            let shot = lab.render(&format!("splatting-{method}-{width}"), &scene, &flags)?;
            let listing = match method {
                "tiled" => shot.pass_seconds("bins")?,
                _ => 0.0,
            };
            let splatting = listing + shot.pass_seconds("splat")?;
            let before = shot.pass_seconds("maps")? + shot.pass_seconds("split")?;
            let share = splatting / (before + splatting);
            let milliseconds = |seconds: f64| format!("{:.1} ms", 1e3 * seconds);
            rows.push(vec![
                scene.title.clone(),
                width.to_owned(),
                method.to_owned(),
                milliseconds(before),
                milliseconds(splatting),
                percent(share),
            ]);
            numbers.push(json!({
                "scene": scene.title, "splat_size": width, "method": method, "share": share,
                "gpu_seconds": shot.report["gpu_seconds"], "command": shot.command,
            }));
        }
    }
    let text = match lab.gpu {
        true => format!("{TEXT} {}", [size, maps, photons].join(" ")),
        false => format!("{TEXT} Not measured: no --gpu."),
    };
    let head = cells([
        "scene",
        "splat size",
        "splatting",
        "maps, split",
        "splatting",
        "share",
    ]);
    let mut parts = vec![Part::Text(text)];
    if !rows.is_empty() {
        parts.push(Part::Table { head, rows });
    }
    let section = Section {
        id: "splatting",
        title: "Splatting on the GPU: quads beside tiles",
        parts,
    };
    Ok((section, Value::Array(numbers)))
}
