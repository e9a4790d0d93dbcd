//! The two-pass Gaussian (§5): the paper's, which stops nowhere, and ours, which stops at edges.

use anyhow::Result;
use serde_json::{Value, json};

use super::sponza;
use crate::paper::{
    lab::{Lab, number},
    page::{Part, Section},
    report::{cells, percent, signed},
};

const TEXT: &str = "Indirect light by 8 diffuse rays a pixel of the exact tracer, against many rays and no filter. 11 × 11 \
    pixels, σ 2 pixels. The paper did not find it necessary to stop at edges and left it to be assessed.";

const FILTERS: [(&str, &[&str]); 3] = [
    ("none", &["--ldi-filter-width=1"]),
    (
        "the paper's: stops nowhere",
        &["--ldi-filter-stops=nowhere"],
    ),
    ("stops at edges", &["--ldi-filter-stops=edges"]),
];

pub(super) fn measure(lab: &Lab) -> Result<(Section, Value)> {
    let size = if lab.quick {
        "--size=48x48"
    } else {
        "--size=192x192"
    };
    let base = [
        "--technique=ldi",
        "--tracer=bvh",
        "--quantity=indirect",
        "--ldi-light-rays=1",
        size,
    ];
    let glossy = lab.scene("cornell_glossy", "Cornell box with a sphere", &[], "office");
    let (mut rows, mut numbers) = (Vec::new(), Vec::new());
    for scene in [sponza(lab), glossy] {
        let many = [
            "--ldi-diffuse-rays=128",
            "--ldi-glossy-rays=64",
            "--seed=5",
            "--ldi-filter-width=1",
        ];
        let truth = lab.render("filter-truth", &scene, &[&base[..], &many].concat())?;
        for (name, flags) in FILTERS {
            let shot = lab.render("filter", &scene, &[&base[..], flags].concat())?;
            let report = lab.compare_whole(&shot, &truth)?;
            rows.push(vec![
                scene.title.clone(),
                name.to_owned(),
                percent(number(&report, "/rel_rmse")?),
                signed(number(&report, "/bias")?),
                percent(number(&report, "/silhouettes/rel_rmse")?),
                percent(number(&report, "/silhouettes/rel_rmse_elsewhere")?),
            ]);
            numbers.push(json!({ "scene": scene.title, "filter": name, "command": shot.command, "compared": report }));
        }
    }
    let head = cells([
        "scene",
        "filter",
        "relRMSE",
        "bias",
        "at silhouettes",
        "elsewhere",
    ]);
    let section = Section {
        id: "filter",
        title: "The filter",
        parts: vec![Part::Text(TEXT.to_owned()), Part::Table { head, rows }],
    };
    Ok((section, Value::Array(numbers)))
}
