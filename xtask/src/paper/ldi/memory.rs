//! Build time and memory (§7).

use anyhow::Result;
use serde_json::{Value, json};

use super::sponza;
use crate::paper::{
    lab::{Lab, number},
    page::{Part, Section},
    report::cells,
};

/// Cells, pixels, and what the paper tells of them.
const CASES: [(&str, &str); 5] = [
    ("4x128", "1 s"),
    ("5x128", "15 to 60 MB"),
    ("8x128", ""),
    ("4x512", ""),
    ("8x512", "23 s"),
];

const TEXT: &str = "All threads. 'then' are maps of the same answers as the paper would hold them: a depth and a triangle of four \
    bytes each for every triangle in a pixel (at its centre, or that touches it), four bytes a pixel, and a map for each \
    of two opposite directions. The aim is a quarter of it.";

pub(super) fn measure(lab: &Lab) -> Result<(Section, Value)> {
    let scene = sponza(lab);
    let cases = if lab.quick { &CASES[..2] } else { &CASES[..] };
    let mut rows = Vec::new();
    let mut numbers = Vec::new();
    for (case, paper) in cases {
        let both = ["center", "touched"].map(|layers| format!("{case}:{layers}"));
        let flags = ["--rays", "4096", "--truth", "0", "--share", "0"];
        let flags = [&flags[..], &["--case", &both[0], "--case", &both[1]]].concat();
        let lines = lab.bench(["isophote-ldi", "trace"], &scene, &flags)?;
        for line in &lines {
            let bytes = number(line, "/map_bytes")?;
            let unshared = number(line, "/unshared_bytes")?;
            rows.push(vec![
                format!("{} × {}²", line["directions"], line["resolution"]),
                line["layers"].as_str().unwrap_or_default().to_owned(),
                (*paper).to_owned(),
                format!("{:.2} s", number(line, "/build_seconds")?),
                format!("{:.1} MB", bytes / 1e6),
                format!("{:.1} MB", number(line, "/bytes")? / 1e6),
                format!("{:.2}", number(line, "/bytes_per_layer")?),
                format!("{:.1} MB", unshared / 1e6),
                format!("{:.2}", bytes / unshared),
            ]);
            numbers.push(json!({ "then_bytes": unshared, "measured": line }));
        }
    }
    let head = cells([
        "maps",
        "layers",
        "paper",
        "build, now",
        "memory, now",
        "with triangles",
        "bytes a layer",
        "memory, then",
        "now / then",
    ]);
    let text = format!("{}. {TEXT}", scene.title);
    let section = Section {
        id: "memory",
        title: "Build time and memory",
        parts: vec![Part::Text(text), Part::Table { head, rows }],
    };
    Ok((section, Value::Array(numbers)))
}
