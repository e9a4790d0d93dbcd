//! Cost against the number of directions, the resolution and the number of triangles.

use anyhow::Result;
use serde_json::{Value, json};

use super::sponza;
use crate::paper::{
    lab::{Lab, Scene},
    page::{Part, Section},
    plot::{Curve, Plot},
};

const TEXT: &str = "One thread, diffuse rays, closest hit, layers 'touched' and 'center'. The paper says (§7) that rays cross \
    about as many pixels however large the scene is: the crossings below are those of one surface, ever more finely \
    tessellated.";

const DIRECTIONS: [&str; 4] = ["2x128", "4x128", "8x128", "16x128"];
const RESOLUTIONS: [&str; 5] = ["4x64", "4x128", "4x256", "4x512", "4x1024"];
const TRIANGLES: [&str; 5] = ["1000", "10000", "100000", "1000000", "3000000"];

/// What is drawn of every measurement.
const CURVES: [(&str, &str); 3] = [
    ("closest hit, million rays/s", "/closest_mrays"),
    ("exact tracer, million rays/s", "/exact_closest_mrays"),
    ("pixels a ray visits", "/crossings"),
];

pub(super) fn measure(lab: &Lab) -> Result<(Section, Value)> {
    let scene = sponza(lab);
    let mut parts = vec![Part::Text(format!(
        "{} and a built-in surface. {TEXT}",
        scene.title
    ))];
    let mut numbers = json!({});
    let quick = lab.quick;
    let few = |all: &'static [&'static str]| if quick { &all[..2] } else { all };
    for layers in ["touched", "center"] {
        let of_cases = |cases: &[&str]| -> Result<Vec<Value>> {
            let cases: Vec<String> = cases
                .iter()
                .map(|case| format!("{case}:{layers}"))
                .collect();
            let flags = cases.iter().flat_map(|case| ["--case", case.as_str()]);
            lines(lab, &scene, &flags.collect::<Vec<_>>())
        };
        let directions = of_cases(few(&DIRECTIONS))?;
        let resolutions = of_cases(few(&RESOLUTIONS))?;
        let mut triangles = Vec::new();
        for count in few(&TRIANGLES) {
            let surface = Scene {
                path: format!("builtin:cave:{count}"),
                title: format!("cave:{count}"),
                flags: Vec::new(),
                is_builtin: true,
            };
            triangles.extend(lines(
                lab,
                &surface,
                &["--case", &format!("4x128:{layers}")],
            )?);
        }
        for (what, key, lines) in [
            ("directions", "/directions", &directions),
            ("pixels on a side", "/resolution", &resolutions),
            ("triangles", "/triangles", &triangles),
        ] {
            let title = format!("Layers '{layers}' against {what}");
            parts.push(Part::Plot(plot(&title, what, key, lines)?));
        }
        numbers[layers] = json!({
            "directions": directions, "resolutions": resolutions, "triangles": triangles,
        });
    }
    let section = Section {
        id: "growth",
        title: "Cost against size",
        parts,
    };
    Ok((section, numbers))
}

fn lines(lab: &Lab, scene: &Scene, cases: &[&str]) -> Result<Vec<Value>> {
    let flags = ["--rays", "131072", "--truth", "0", "--share", "0"];
    lab.bench(
        ["isophote-ldi", "trace"],
        scene,
        &[&flags[..], cases].concat(),
    )
}

fn plot(title: &str, x: &str, key: &str, lines: &[Value]) -> Result<String> {
    let curve = |(name, value): (&str, &str)| Curve::of(name, lines, [key, value]);
    Plot {
        title,
        x,
        curves: CURVES.into_iter().map(curve).collect::<Result<_>>()?,
    }
    .svg()
}
