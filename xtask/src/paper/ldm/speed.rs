//! What ambient occlusion takes beside the exact tracer with the same rays, and what maps take in memory.

use serde_json::{Value, json};

use super::{Measured, hairball, sponza};
use crate::paper::{
    lab::{Lab, number},
    page::{Part, Section},
    report::cells,
};

const TEXT: &str = "Maps are built for this frame, asked and dropped; all threads. The exact tracer answers the same rays for a \
    share of the pixels. The paper has 1174 ms for the hairball with 512 maps of 50².";

pub(super) fn measure(lab: &Lab) -> Measured {
    let size = if lab.quick { "160x160" } else { "800x800" };
    let cases: &[&str] = match lab.quick {
        true => &["64:50:inf", "64:50:12"],
        false => &["512:200:inf", "512:200:12", "512:200:1.5", "512:50:inf"],
    };
    let mut flags = vec!["--size", size];
    flags.extend(cases.iter().flat_map(|case| ["--case", case]));
    let (mut rows, mut numbers) = (Vec::new(), Vec::new());
    for scene in [sponza(lab), hairball(lab)] {
        let lines = lab.bench(["isophote-ldm-ambient", "occlusion"], &scene, &flags)?;
        for line in lines {
            let d_max = line["d_max"].as_f64();
            rows.push(vec![
                scene.title.clone(),
                format!("{} × {}²", line["maps"], line["resolution"]),
                d_max.map_or_else(|| "∞".to_owned(), |d_max| format!("{d_max} m")),
                format!("{:.0} ms", 1e3 * number(&line, "/seconds")?),
                format!("{:.0} ms", 1e3 * number(&line, "/exact_seconds")?),
                format!("{:.1}", number(&line, "/times")?),
                format!("{:.1} MB", number(&line, "/most_bytes")? / 1e6),
            ]);
            numbers.push(json!({ "scene": scene.title, "measured": line }));
        }
    }
    let head = cells([
        "scene",
        "maps",
        "d_max",
        "maps, build included",
        "exact tracer",
        "×",
        "memory beyond the scene",
    ]);
    let section = Section {
        id: "speed",
        title: "Speed of ambient occlusion",
        parts: vec![Part::Text(TEXT.to_owned()), Part::Table { head, rows }],
    };
    Ok((section, Value::Array(numbers)))
}

pub(super) fn measure_memory(lab: &Lab) -> Measured {
    let (mut rows, mut numbers) = (Vec::new(), Vec::new());
    let cases: &[[&str; 2]] = match lab.quick {
        true => &[["64:50", ""]],
        false => &[["512:200", "805.5 MB"], ["512:50", "204.1 MB"]],
    };
    let scene = sponza(lab);
    for [case, then] in cases {
        let flags = ["--stored", case];
        let lines = lab.bench(["isophote-ldm-ambient", "occlusion"], &scene, &flags)?;
        for line in lines {
            rows.push(vec![
                format!("{} × {}²", line["maps"], line["resolution"]),
                (*then).to_owned(),
                format!("{:.1} MB", number(&line, "/stored_bytes")? / 1e6),
                line["layers"].to_string(),
                format!("{:.2} s", number(&line, "/build_seconds")?),
            ]);
            numbers.push(json!({ "then": then, "measured": line }));
        }
    }
    let head = cells(["maps", "then", "now", "layers", "build"]);
    let text = format!(
        "{}. Maps that are kept; streamed, as they are for ambient occlusion, they take what the section above says. The paper's \
         are of Crytek's Sponza.",
        scene.title
    );
    let section = Section {
        id: "memory",
        title: "Memory",
        parts: vec![Part::Text(text), Part::Table { head, rows }],
    };
    Ok((section, Value::Array(numbers)))
}
