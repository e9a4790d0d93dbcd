//! Whether imperfect visibility pays: boxes instead of triangles, tracer by tracer.

use anyhow::{Result, anyhow};
use serde_json::{Value, json};

use super::{Measured, conference, office};
use crate::paper::{
    lab::{Lab, Scene, number},
    page::{Part, Section},
    report::{cells, percent, signed},
};

const TEXT: &str = "The indirect stage of 180 light paths without other shortcuts, once with boxes and once with triangles, by each tracer \
    that has both, and by maps. Error is that of the indirect light against triangles. The paper, whose triangles are tested \
    by a program on the GPU, gains 1.5 to 2. Where the \
    processor stands in for a GPU pictures are smaller.";

/// Flags of a tracer of triangles, and of others to compare with it.
struct Tracer {
    name: &'static str,
    /// Of pictures where the processor stands in for a GPU.
    software_size: &'static str,
    flags: &'static [&'static str],
    others: &'static [(&'static str, &'static [&'static str])],
}

const FULL: &str = "--size=400x300";

const CPU: Tracer = Tracer {
    name: "bvh on the CPU",
    software_size: FULL,
    flags: &["--device=cpu", "--tracer=bvh"],
    others: &[
        ("boxes", &["--device=cpu", "--tracer=bvh-boxes"]),
        ("layered depth images", &["--device=cpu", "--tracer=ldi"]),
    ],
};
const GPUS: [Tracer; 2] = [
    Tracer {
        name: "compute BVH on the GPU",
        software_size: "--size=100x75",
        flags: &["--device=gpu", "--tracer=compute-bvh"],
        others: &[("boxes", &["--device=gpu", "--tracer=compute-boxes"])],
    },
    Tracer {
        name: "ray query on the GPU",
        // Mesa's trees keep triangles in the file's order, so that nearly all of them are tested.
        software_size: "--size=24x18",
        flags: &["--device=gpu", "--tracer=ray-query"],
        others: &[("boxes", &["--device=gpu", "--tracer=boxes"])],
    },
];

pub(super) fn measure(lab: &Lab) -> Measured {
    let (mut rows, mut numbers) = (Vec::new(), Vec::new());
    let is_software = lab.gpu && lab.is_gpu_software()?;
    for scene in [conference(lab), office(lab)] {
        for tracer in [&CPU].into_iter().chain(&GPUS) {
            // A GPU is measured only where one is asked for.
            let measured = match std::ptr::eq(tracer, &CPU) || lab.gpu {
                true => of_tracer(lab, &scene, tracer, is_software),
                false => Err(anyhow!("no --gpu")),
            };
            match measured {
                Ok(lines) => {
                    for (row, value) in lines {
                        rows.push(row);
                        numbers.push(value);
                    }
                }
                Err(error) => {
                    let mut row = vec![scene.title.clone(), tracer.name.to_owned()];
                    row.resize(HEAD.len() - 1, String::new());
                    row.push(format!("not measured: {error:#}"));
                    rows.push(row);
                }
            }
        }
    }
    let section = Section {
        id: "visibility",
        title: "Does imperfect visibility pay?",
        parts: vec![
            Part::Text(TEXT.to_owned()),
            Part::Table {
                head: cells(HEAD),
                rows,
            },
        ],
    };
    Ok((section, Value::Array(numbers)))
}

const HEAD: [&str; 8] = [
    "scene",
    "tracer",
    "instead",
    "triangles",
    "instead of them",
    "speed-up",
    "relRMSE",
    "bias",
];

fn of_tracer(
    lab: &Lab,
    scene: &Scene,
    tracer: &Tracer,
    is_software: bool,
) -> Result<Vec<(Vec<String>, Value)>> {
    let size = match is_software {
        true => tracer.software_size,
        false => FULL,
    };
    let size = match lab.quick && size == FULL {
        true => "--size=80x60",
        false => size,
    };
    let shoot = |name: &str, flags: &[&str]| {
        let base = [
            "--technique=igi",
            "--materials=lambert",
            "--quantity=indirect",
            size,
        ];
        lab.render(name, scene, &[&base[..], flags].concat())
    };
    let exact = shoot("visibility-triangles", tracer.flags)?;
    let before = exact.pass_seconds("indirect")?;
    let line = |(name, flags): &(&str, &[&str])| {
        let shot = shoot("visibility", flags)?;
        let after = shot.pass_seconds("indirect")?;
        let report = lab.compare_whole(&shot, &exact)?;
        let [rel_rmse, bias] = [number(&report, "/rel_rmse")?, number(&report, "/bias")?];
        let row = vec![
            scene.title.clone(),
            format!("{}, {}", tracer.name, size.trim_start_matches("--size=")),
            (*name).to_owned(),
            format!("{:.0} ms", 1e3 * before),
            format!("{:.0} ms", 1e3 * after),
            format!("{:.2}", before / after),
            percent(rel_rmse),
            signed(bias),
        ];
        let value = json!({
            "scene": scene.title, "tracer": tracer.name, "instead": name, "command": shot.command,
            "seconds_of_triangles": before, "seconds": after, "rel_rmse": rel_rmse, "bias": bias,
        });
        Ok((row, value))
    };
    tracer.others.iter().map(line).collect()
}
