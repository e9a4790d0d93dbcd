//! `cargo xtask paper field`: the figures of Gaitatzes, Chrysanthou and Papaioannou 2008.
//!
//! Everything is measured by the crate's bench `trace`, a line of JSON for each setting; here the lines become tables.

mod pictures;

use anyhow::Result;
use serde_json::Value;

use super::{
    lab::{Lab, Scene},
    page::{Part, Section},
    plot::{Curve, Plot},
    report::{Measure, Report},
};

pub(super) const REPORT: Report = Report {
    name: "field",
    title: "Presampled visibility for ambient occlusion",
    intro: "Gaitatzes, Chrysanthou and Papaioannou, Journal of WSCG 2008, made again. Their times are of a Pentium 4 and a \
        dual Xeon of 2008; ours are of the processor named below, so a rate is to be read against the exact tracer beside it. \
        An object stands on the floor of a corner of 3 × 33 × 33 vertices, which receives and does not cast; 256 rays a \
        vertex. RMS is over the vertices in grey levels, against exact answers to the same rays.",
    sections: &SECTIONS,
};

const SECTIONS: [(&str, Measure); 7] = [
    ("pictures", pictures::measure),
    ("resolutions", resolutions),
    ("objects", objects),
    ("together", together),
    ("growth", growth),
    ("moving", moving),
    ("parts", parts),
];

/// A column: its head, where its value is in a line, and what it is multiplied by.
type Column = (&'static str, &'static str, f64);

const SETTING: [Column; 5] = [
    ("positions", "positions", 1.0),
    ("directions a side", "resolution", 1.0),
    ("mapping", "directions", 1.0),
    ("storage", "storage", 1.0),
    ("look-up", "look_up", 1.0),
];
const ERRORS: [Column; 4] = [
    ("RMS of ao", "ao_rms", 1.0),
    ("bias of ao", "ao_bias", 1.0),
    ("RMS of obscurance, one radius", "obscurance_rms", 1.0),
    ("RMS of a constant", "constant_rms", 1.0),
];
const SHADOWS: [Column; 3] = [
    ("RMS of soft shadows", "shadow_rms", 1.0),
    ("RMS of a constant", "shadow_constant_rms", 1.0),
    ("×", "shadow_times", 1.0),
];
const RATES: [Column; 6] = [
    ("million rays/s, all", "all_mrays", 1.0),
    ("exact", "all_exact_mrays", 1.0),
    ("×", "all_times", 1.0),
    ("those that meet the sphere", "meeting_mrays", 1.0),
    ("exact", "meeting_exact_mrays", 1.0),
    ("×", "meeting_times", 1.0),
];

fn table(lines: &[Value], columns: &[Column]) -> Part {
    let cell = |line: &Value, (_, key, factor): &Column| match &line[*key] {
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_u64() && *factor == 1.0 => number.to_string(),
        Value::Number(number) => format!("{:.3}", number.as_f64().unwrap_or(f64::NAN) * factor),
        _ => "–".to_owned(),
    };
    Part::Table {
        head: columns.iter().map(|column| column.0.to_owned()).collect(),
        rows: lines
            .iter()
            .map(|line| columns.iter().map(|column| cell(line, column)).collect())
            .collect(),
    }
}

fn section(
    id: &'static str,
    title: &'static str,
    text: &str,
    lines: Vec<Value>,
    columns: &[&[Column]],
) -> (Section, Value) {
    let section = Section {
        id,
        title,
        parts: vec![
            Part::Text(text.to_owned()),
            table(&lines, &columns.concat()),
        ],
    };
    (section, Value::Array(lines))
}

fn bench(lab: &Lab, scene: &Scene, flags: &[String]) -> Result<Vec<Value>> {
    let flags: Vec<&str> = flags.iter().map(String::as_str).collect();
    lab.bench(["isophote-displacement-field", "trace"], scene, &flags)
}

fn cases(cases: impl IntoIterator<Item = String>) -> Vec<String> {
    let flags = cases.into_iter().map(|case| ["--case".to_owned(), case]);
    flags.flatten().collect()
}

fn bunny(lab: &Lab) -> Scene {
    lab.scene("bunny", "bunny", &[], "cave")
}

fn resolutions(lab: &Lab) -> Result<(Section, Value)> {
    let (positions, sides): (&[u32], &[u32]) = if lab.quick {
        (&[290, 1090], &[16, 32])
    } else {
        (&[1090, 4226, 16642], &[16, 32, 64, 128])
    };
    let grid = positions.iter().flat_map(|positions| {
        sides
            .iter()
            .map(move |side| format!("{positions}x{side}:concentric:byte:nearest"))
    });
    let others = [
        "1122x64:polar:byte:nearest",
        "1090x64:polar:byte:nearest",
        "1090x64:rejection:byte:nearest",
        "1090x64:concentric:byte:nearest",
        "4226x32:concentric:float:nearest",
        "4226x32:concentric:word:nearest",
        "4226x32:concentric:byte:aimed",
        "4226x32:concentric:float:interpolated",
        "4226x32:concentric:byte:interpolated",
        "4226x64:concentric:bit:nearest",
        "4226x64:concentric:bit:aimed",
        "4225x32:concentric:byte:nearest",
    ];
    let flags = cases(grid.chain(others.map(str::to_owned)));
    let lines = bench(lab, &bunny(lab), &flags)?;
    let text = "Each mapping makes the rays of the vertices too, weighted by cosθ/(π·density). The paper has 4.4030 for one bit at \
        4226 positions of 64 × 64. Nearest is the paper's look-up but for rays that start inside the sphere. Seconds to build are of \
        all threads, to trace all rays once of one thread. Asked of 8 bits at 4226 positions of 32 × 32: an RMS of at most 5 by the \
        nearest sample and 2.5 interpolated, that differs by less than 0.6 from that of 32 bits; of one bit at 64 × 64 at most 4.4; \
        that concentric beats polar, and that the error falls with positions and hardly with directions.";
    let costs = [
        ("seconds to build", "build_seconds", 1.0),
        ("seconds to trace", "run_seconds", 1.0),
    ];
    let of_floats = [("RMS against 32 bits", "ao_rms_of_floats", 1.0)];
    let columns: [&[Column]; 4] = [&SETTING, &costs, &ERRORS, &of_floats];
    let plots = [("seconds to build", "/build_seconds"), ("bytes", "/bytes")];
    let plots = plots.map(|(x, key)| {
        let curve = |count: &u32| {
            let mut own = lines.clone();
            own.retain(|line| line["positions"] == *count && is_of_grid(line));
            own.sort_by_key(|line| line["resolution"].as_u64());
            Curve::of(format!("{count} positions"), &own, [key, "/ao_rms"])
        };
        let title = "RMS of ao, grey levels";
        let curves = positions.iter().map(curve).collect::<Result<_>>()?;
        Plot { title, x, curves }.svg().map(Part::Plot)
    });
    let title = "Fig. 5, 6, 7: resolutions, mappings, storage, look-up";
    let (mut section, numbers) = section("resolutions", title, text, lines, &columns);
    for plot in plots {
        section.parts.push(plot?);
    }
    Ok((section, numbers))
}

/// Whether a setting differs from others in positions and directions alone.
fn is_of_grid(line: &Value) -> bool {
    let setting = [&line["directions"], &line["storage"], &line["look_up"]];
    setting == ["concentric", "byte", "nearest"]
}

fn objects(lab: &Lab) -> Result<(Section, Value)> {
    let mut flags = cases(
        ["nearest", "aimed", "interpolated"]
            .map(|look_up| format!("4226x32:concentric:byte:{look_up}")),
    );
    flags.extend(["--speed", "--memory"].map(str::to_owned));
    let mut lines = Vec::new();
    for (file, title) in [
        ("tree", "tree"),
        ("bunny", "bunny"),
        ("igea_67k", "Igea"),
        ("dragon", "dragon"),
    ] {
        lines.extend(bench(lab, &lab.scene(file, title, &[], "cave"), &flags)?);
    }
    let text = "836,352 rays each, any hit, one thread. Then: 196 s by casting rays against 0.24 s for the lemon tree, 331 s \
        against 0.23 s for the bunny, 616 s against 0.20 s for Igea, and 4.3 MB a field. Asked: at least 4 times the exact tracer's \
        rate, over all rays and over those that meet the sphere, and files of at most half of the 4.3 MB. Coded is what a file takes. Soft shadows are of a \
        square light over the object, one radius wide, 256 rays a vertex.";
    let object = [
        ("object", "scene", 1.0),
        ("triangles", "triangles", 1.0),
        ("look-up", "look_up", 1.0),
    ];
    let memory = [
        ("seconds to build", "build_seconds", 1.0),
        ("MB", "bytes", 1e-6),
        ("MB coded", "coded_bytes", 1e-6),
    ];
    let columns: [&[Column]; 5] = [&object, &memory, &ERRORS, &RATES, &SHADOWS];
    Ok(section(
        "objects",
        "Fig. 8: objects, rates and memory",
        text,
        lines,
        &columns,
    ))
}

fn growth(lab: &Lab) -> Result<(Section, Value)> {
    let most: &[&str] = if lab.quick {
        &["1000", "30000"]
    } else {
        &["1000", "30000", "300000", "3000000"]
    };
    let mut flags = vec!["--growth".to_owned()];
    flags.extend(most.iter().map(|&count| count.to_owned()));
    let mut lines = bench(lab, &bunny(lab), &flags)?;
    lines.retain(|line| line["scene"] == "bumps");
    let text = "The same shape, its triangles divided into ever more: all rays, any hit, one thread. Asked: a rate that changes by less than 10 %.";
    let columns: [&[Column]; 1] = [&[
        ("triangles", "triangles", 1.0),
        ("seconds to build", "build_seconds", 1.0),
        ("MB", "bytes", 1e-6),
        ("million rays/s", "mrays", 1.0),
        ("exact", "exact_mrays", 1.0),
        ("×", "times", 1.0),
    ]];
    let curves = [
        ("field", "/mrays"),
        ("exact tracer", "/exact_mrays"),
        ("seconds to build the field", "/build_seconds"),
    ];
    let curves = curves.map(|(name, key)| Curve::of(name, &lines, ["/triangles", key]));
    let plot = Plot {
        title: "million rays/s, and seconds to build",
        x: "triangles",
        curves: curves.into_iter().collect::<Result<_>>()?,
    };
    let plot = Part::Plot(plot.svg()?);
    let title = "Cost against triangles";
    let (mut section, numbers) = section("growth", title, text, lines, &columns);
    section.parts.push(plot);
    Ok((section, numbers))
}

/// The flags that name scenes beside the first one.
fn others(lab: &Lab, names: &[&str]) -> Vec<String> {
    let scenes = names.iter().map(|name| lab.scene(name, name, &[], "cave"));
    let files = scenes.filter(|scene| !scene.is_builtin);
    let absolute = |scene: Scene| crate::workspace::root().join(&scene.path);
    files
        .map(|scene| absolute(scene).to_string_lossy().into_owned())
        .collect()
}

fn together(lab: &Lab) -> Result<(Section, Value)> {
    let mut flags = vec!["--together".to_owned()];
    flags.extend(others(lab, &["tree", "igea_67k", "lucy_10k"]));
    let lines = bench(lab, &bunny(lab), &flags)?;
    let text = "The paper's: 142,300 triangles, 26,444,800 rays, 4,287 s by casting rays against 4.69 s. Here too all objects cast and \
        they and the corner receive: 256 rays from each vertex of the corner and from some 100,000 of the objects, lifted by twice what \
        the fields say, one thread.";
    let columns: [&[Column]; 1] = [&[
        ("objects", "objects", 1.0),
        ("triangles", "triangles", 1.0),
        ("rays", "rays", 1.0),
        ("s", "seconds", 1.0),
        ("s, exact", "exact_seconds", 1.0),
        ("×", "times", 1.0),
        ("RMS of ao", "ao_rms", 1.0),
        ("bias of ao", "ao_bias", 1.0),
        ("RMS of a constant", "constant_rms", 1.0),
    ]];
    let title = "Fig. 8: several objects together";
    Ok(section("together", title, text, lines, &columns))
}

fn moving(lab: &Lab) -> Result<(Section, Value)> {
    let count = if lab.quick { "500" } else { "10000" };
    let mut flags = vec!["--moving".to_owned(), count.to_owned()];
    flags.extend(others(lab, &["tree", "igea_67k", "dragon", "lucy_10k"]));
    let mut lines = bench(lab, &bunny(lab), &flags)?;
    lines.retain(|line| line["instances"].is_u64());
    let text = "Every instance moves in every frame; 16 rays from each of 100,000 points of the floor, by all threads. The exact \
        tracer is the one of two levels, whose upper level is rebuilt.";
    let columns: [&[Column]; 1] = [&[
        ("instances", "instances", 1.0),
        ("meshes", "meshes", 1.0),
        ("rays", "rays", 1.0),
        ("ms to move", "update_seconds", 1e3),
        ("ms to trace", "trace_seconds", 1e3),
        ("ms to move, exact", "exact_update_seconds", 1e3),
        ("ms to trace, exact", "exact_trace_seconds", 1e3),
        ("occluded", "occluded", 1.0),
        ("exact", "exact_occluded", 1.0),
        ("MB", "bytes", 1e-6),
        ("MB, exact", "exact_bytes", 1e-6),
    ]];
    Ok(section("moving", "Many that move", text, lines, &columns))
}

fn parts(lab: &Lab) -> Result<(Section, Value)> {
    let counts: &[&str] = if lab.quick {
        &["1", "4"]
    } else {
        &["1", "2", "4", "8"]
    };
    let flags: Vec<String> = counts
        .iter()
        .flat_map(|&count| ["--parts", count])
        .map(str::to_owned)
        .collect();
    let mut lines = Vec::new();
    for (file, title) in [("dragon", "dragon"), ("lucy_10k", "Lucy")] {
        lines.extend(bench(lab, &lab.scene(file, title, &[], "cave"), &flags)?);
    }
    lines.retain(|line| line["parts"].is_u64());
    let text = "Several tighter spheres against one, at about the same memory.";
    let object = [
        ("object", "scene", 1.0),
        ("spheres", "parts", 1.0),
        ("positions of each", "positions", 1.0),
        ("look-up", "look_up", 1.0),
        ("MB", "bytes", 1e-6),
    ];
    let columns: [&[Column]; 3] = [&object, &ERRORS, &RATES];
    Ok(section("parts", "A sphere tree", text, lines, &columns))
}
