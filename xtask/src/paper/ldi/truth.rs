//! What approximate answers cost in truth, and how fast they are, in the same run.

use anyhow::Result;
use serde_json::{Value, json};

use super::{cornell, sibenik, sponza};
use crate::paper::{
    lab::{Lab, number},
    page::{Part, Section},
    plot::{Curve, Plot},
    report::{cells, percent, signed},
};

const CASES: [&str; 4] = [
    "4x128:touched",
    "4x128:center",
    "4x512:touched",
    "4x512:center",
];

const TEXT: &str = "Tracing alone, one thread, incoherent diffuse rays around the camera; 'indirect' is one diffuse bounce \
    with many rays a pixel and no filter, against the same samples by the exact tracer. 'dial' sends the least sure answers \
    to the exact tracer; sorting and asking again are in its time, and its share, speed and error are of the picture's own rays. Aims: closest hit 3 times and any hit 2 times the exact \
    tracer; relRMSE 12 % and bias 4 % at 128², 6 % and 2 % at 512², with the dial 5 % and 2 %. The paper gives no errors.";
const PLOTS: &str = "Error against time. Each curve starts with the maps alone; its other points are the dial's. Rings at the foot err by nothing.";
const LEAKS: &str = "Wrong answers by kind of ray, on triangles chosen without regard to their size, so mostly on the \
    smallest: leaks are hits of the exact tracer that the maps miss or pass by more than a ten-thousandth of the scene. Not of scenes whose maps are fitted to a part of them.";

pub(super) fn measure(lab: &Lab) -> Result<(Section, Value)> {
    let [rays, samples, conformance] = if lab.quick {
        ["65536", "8", "1000"]
    } else {
        ["524288", "128", "10000"]
    };
    let mut flags = vec![
        "--rays",
        rays,
        "--truth",
        samples,
        "--conformance",
        conformance,
    ];
    let cases = if lab.quick { &CASES[..2] } else { &CASES[..] };
    flags.extend(cases.iter().flat_map(|case| ["--case", case]));
    let (mut rows, mut leaks, mut numbers) = (Vec::new(), Vec::new(), Vec::new());
    let mut plots = Vec::new();
    for scene in [sponza(lab), sibenik(lab), cornell(lab)] {
        let (mut curves, mut exact) = (Vec::new(), f64::NAN);
        for line in lab.bench(["isophote-ldi", "trace"], &scene, &flags)? {
            let resolution = line["resolution"].as_u64().unwrap_or_default();
            let maps = format!(
                "{resolution}² {}",
                line["layers"].as_str().unwrap_or_default()
            );
            rows.push(row(&scene.title, &maps, &line)?);
            curves.push(curve(&maps, &line)?);
            exact = 1.0 / number(&line, "/exact_closest_mrays")?;
            for dial in line["dials"].as_array().into_iter().flatten() {
                let maps = format!("{maps}, dial at {}", percent(number(dial, "/exact_share")?));
                rows.push(row(&scene.title, &maps, dial)?);
            }
            for kind in line["conformance"].as_array().into_iter().flatten() {
                let share = |key: &str| number(kind, key).map(percent);
                leaks.push(vec![
                    scene.title.clone(),
                    maps.clone(),
                    kind["kind"].as_str().unwrap_or_default().to_lowercase(),
                    share("/leaks")?,
                    share("/false_hits")?,
                    share("/false_misses")?,
                    share("/early")?,
                    share("/late")?,
                ]);
            }
            numbers.push(json!({ "title": scene.title, "measured": line }));
        }
        curves.push(Curve {
            name: "exact tracer".to_owned(),
            points: vec![(exact, 0.0)],
        });
        let plot = Plot {
            title: &format!("relRMSE of indirect light: {}", scene.title),
            x: "µs a ray, closest hit, one thread",
            curves,
        };
        plots.push(Part::Plot(plot.svg()?));
    }
    let head = cells([
        "scene",
        "maps",
        "closest, million/s",
        "× exact",
        "any, million/s",
        "× exact",
        "hit/miss confused",
        "t off by 1/1000",
        "indirect relRMSE",
        "bias",
    ]);
    let leak_head = cells([
        "scene",
        "maps",
        "rays",
        "leaks",
        "false hits",
        "false misses",
        "early",
        "late",
    ]);
    let mut parts = vec![
        Part::Text(TEXT.to_owned()),
        Part::Table { head, rows },
        Part::Text(PLOTS.to_owned()),
    ];
    parts.append(&mut plots);
    parts.push(Part::Text(LEAKS.to_owned()));
    parts.push(Part::Table {
        head: leak_head,
        rows: leaks,
    });
    let section = Section {
        id: "truth",
        title: "Truth, and speed of tracing alone",
        parts,
    };
    Ok((section, Value::Array(numbers)))
}

/// From the maps alone to ever more of their answers asked again of the exact tracer.
fn curve(maps: &str, line: &Value) -> Result<Curve> {
    let dials = line["dials"].as_array().into_iter().flatten();
    let mut curve = Curve::of(
        maps,
        std::iter::once(line).chain(dials),
        ["/closest_mrays", "/truth/rel_rmse"],
    )?;
    for (time, _) in &mut curve.points {
        *time = 1.0 / *time;
    }
    curve.points.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(curve)
}

/// A row of what was measured, beside the exact tracer on the same rays.
fn row(scene: &str, maps: &str, measured: &Value) -> Result<Vec<String>> {
    let [closest, any] = ["/closest_mrays", "/any_mrays"].map(|key| number(measured, key));
    let [exact_closest, exact_any] =
        ["/exact_closest_mrays", "/exact_any_mrays"].map(|key| number(measured, key));
    let (closest, any) = (closest?, any?);
    Ok(vec![
        scene.to_owned(),
        maps.to_owned(),
        format!("{closest:.2}"),
        format!("{:.2}", closest / exact_closest?),
        format!("{any:.2}"),
        format!("{:.2}", any / exact_any?),
        percent(number(measured, "/confused")?),
        percent(number(measured, "/t_off")?),
        percent(number(measured, "/truth/rel_rmse")?),
        signed(number(measured, "/truth/bias")?),
    ])
}
