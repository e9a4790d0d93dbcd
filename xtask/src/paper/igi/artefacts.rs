//! Fig. 6 and 7: what the shortcuts do to edges, and the pattern of regular interleaving.

use anyhow::Result;
use serde_json::{Value, json};

use super::{Measured, conference, office};
use crate::paper::{
    lab::{Lab, Scene, number},
    page::{Part, Picture, Section},
    report::{cells, percent, signed},
};

const TEXT: &str = "Irradiance of 180 light paths, which shows what textures and direct light would hide, against the plain method with \
    the same virtual lights: what the shortcuts do and nothing else. The paper's lights come from a Halton sequence, the others from \
    a lattice for each light. At silhouettes a neighbour's depth differs by 5 % or its normal by \
    30°. Aim: half the paper's error there. The paper sees the edges of the table top and the pattern on the ceiling of Conference \
    and under the desk of its Office.";

/// The paper's light paths.
const HALTON: &str = "--igi-sequence=halton";

const WAYS: [(&str, &[&str]); 8] = [
    (
        "the paper's: two filters, normals alone",
        &["--igi-interleaving=3x3", "--igi-filter=paper", HALTON],
    ),
    (
        "the paper's, from a lattice",
        &["--igi-interleaving=3x3", "--igi-filter=paper"],
    ),
    (
        "the paper's, irregular",
        &[
            "--igi-interleaving=3x3",
            "--igi-filter=paper",
            "--igi-pattern=irregular",
            HALTON,
        ],
    ),
    (
        "one pass, depths too",
        &["--igi-interleaving=3x3", "--igi-filter=edges"],
    ),
    (
        "gaps filled, depths too",
        &["--igi-interleaving=3x3", "--igi-filter=fill"],
    ),
    (
        "gaps filled, pixels refined",
        &[
            "--igi-interleaving=3x3",
            "--igi-filter=fill",
            "--igi-refine=2",
        ],
    ),
    ("depths too, not interleaved", &["--igi-filter=edges"]),
    (
        "the same, pixels refined",
        &["--igi-filter=edges", "--igi-refine=2"],
    ),
];

pub(super) fn measure(lab: &Lab) -> Measured {
    let (mut parts, mut rows, mut numbers) = (Vec::new(), Vec::new(), Vec::new());
    for scene in [conference(lab), office(lab)] {
        let pictures = of_scene(lab, &scene, &mut rows, &mut numbers)?;
        parts.push(Part::Pictures {
            title: scene.title.clone(),
            pictures,
        });
    }
    let head = cells([
        "scene",
        "shortcuts",
        "relRMSE",
        "bias",
        "at silhouettes",
        "of the paper's",
        "elsewhere",
        "indirect, filter, refine",
    ]);
    parts.insert(0, Part::Text(TEXT.to_owned()));
    parts.insert(1, Part::Table { head, rows });
    let section = Section {
        id: "artefacts",
        title: "Fig. 6 and 7: artefacts",
        parts,
    };
    Ok((section, Value::Array(numbers)))
}

fn of_scene(
    lab: &Lab,
    scene: &Scene,
    rows: &mut Vec<Vec<String>>,
    numbers: &mut Vec<Value>,
) -> Result<Vec<Picture>> {
    let size = match lab.quick {
        true => "--size=160x120",
        false => "--size=800x600",
    };
    let base = [
        "--technique=igi",
        "--device=cpu",
        "--materials=lambert",
        "--quantity=irradiance.indirect",
        "--exposure=-1.3",
        size,
    ];
    let plain = lab.render("artefacts-plain", scene, &base)?;
    let halton = lab.render(
        "artefacts-plain-halton",
        scene,
        &[&base[..], &[HALTON]].concat(),
    )?;
    let mut pictures = vec![Picture {
        png: lab.png(&plain)?,
        left: None,
        caption: "plain".to_owned(),
        command: plain.command.clone(),
    }];
    let mut of_paper = None;
    for (name, flags) in WAYS {
        let flags = [&base[..], &["--igi-downsampling=4"], flags].concat();
        let shot = lab.render("artefacts", scene, &flags)?;
        let truth = if flags.contains(&HALTON) {
            &halton
        } else {
            &plain
        };
        let compared = lab.compare_whole(&shot, truth)?;
        let at = number(&compared, "/silhouettes/rel_rmse")?;
        let paper = *of_paper.get_or_insert(at);
        let passes = ["indirect", "filter", "refine"].map(|name| shot.pass_seconds(name));
        let seconds: f64 = passes.into_iter().sum::<Result<_>>()?;
        rows.push(vec![
            scene.title.clone(),
            name.to_owned(),
            percent(number(&compared, "/rel_rmse")?),
            signed(number(&compared, "/bias")?),
            percent(at),
            format!("{:.2}", at / paper),
            percent(number(&compared, "/silhouettes/rel_rmse_elsewhere")?),
            format!("{:.0} ms", 1e3 * seconds),
        ]);
        pictures.push(Picture {
            png: lab.png(&shot)?,
            left: None,
            caption: format!("{name}: {} at silhouettes", percent(at)),
            command: shot.command.clone(),
        });
        numbers.push(json!({
            "scene": scene.title, "shortcuts": name, "command": shot.command, "compared": compared,
            "of_paper": at / paper,
        }));
    }
    Ok(pictures)
}
