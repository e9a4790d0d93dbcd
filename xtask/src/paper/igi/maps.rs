//! Visibility by paraboloid shadow maps, which the paper proposes (§6): what they gain beside rays, and what they cost in truth.

use anyhow::Result;
use serde_json::{Value, json};

use super::{
    Measured, conference, cornell,
    frames::{MIRRORS, stage},
    office,
};
use crate::paper::{
    lab::{Lab, Scene, number},
    page::{Part, Picture, Section},
    report::{cells, percent, signed},
};

const TEXT: &str = "The paper proposes to see virtual lights by parabolic shadow maps. Here a map is filled by one ray of the tracer \
    for each of its texels, and points look it up. 'Stage' is the light of the virtual lights and its maps; errors are those of \
    the indirect light against rays with the same virtual lights, and 'gained' and 'lost' the light that pixels have more or less than by \
    rays, of all light: what leaks through, and what maps hide too much. Without shortcuts unless they are told.";

/// A case of the bench `frame`, between the number of light paths and the other shortcuts.
const WAYS: [(&str, &str); 5] = [
    ("rays", "triangles"),
    ("maps of 64 × 64", "maps/64"),
    ("maps of 128 × 128", "maps/128"),
    ("the same, nearest texel", "maps/128/0.5/nearest"),
    ("maps of 256 × 256", "maps/256"),
];

/// The same, with what makes rays fewer.
const SHORTCUTS: [(&str, &str); 4] = [
    ("rays, 4 × 4", "triangles:4"),
    ("maps of 64 × 64, 4 × 4", "maps/64:4"),
    (
        "rays, 4 × 4 and 3 × 3 filled",
        "triangles:4:3x3:regular:fill",
    ),
    (
        "maps of 64 × 64, 4 × 4 and 3 × 3 filled",
        "maps/64:4:3x3:regular:fill",
    ),
];

const BIASES: [(&str, &str); 5] = [
    ("bias 0", "maps/128/0"),
    ("bias 0.25", "maps/128/0.25"),
    ("bias 0.5", "maps/128/0.5"),
    ("bias 1", "maps/128/1"),
    ("bias 4", "maps/128/4"),
];

pub(super) fn measure(lab: &Lab) -> Measured {
    let mut table = Table {
        lab,
        rows: Vec::new(),
        numbers: Vec::new(),
    };
    for scene in [conference(lab), office(lab), cornell(lab)] {
        for paths in [30, 90, 180] {
            table.add(&scene, paths, &WAYS, "")?;
        }
    }
    let scene = conference(lab);
    table.add(&scene, 180, &BIASES, "")?;
    table.add(&scene, 180, &SHORTCUTS, "")?;
    if !scene.is_builtin {
        table.add(&scene, 180, &WAYS[..3], &MIRRORS.join(","))?;
    }
    let head = cells([
        "scene",
        "light paths",
        "visibility",
        "maps",
        "indirect",
        "mirrored",
        "stage",
        "speed-up",
        "relRMSE",
        "bias",
        "gained",
        "lost",
    ]);
    let mut parts = vec![
        Part::Text(TEXT.to_owned()),
        Part::Table {
            head,
            rows: table.rows,
        },
    ];
    for scene in [conference(lab), office(lab)] {
        parts.push(Part::Pictures {
            title: format!("Irradiance of 180 light paths, {}", scene.title),
            pictures: pictures(lab, &scene)?,
        });
    }
    let section = Section {
        id: "maps",
        title: "Shadow maps instead of rays (§6)",
        parts,
    };
    Ok((section, Value::Array(table.numbers)))
}

struct Table<'a> {
    lab: &'a Lab,
    rows: Vec<Vec<String>>,
    numbers: Vec<Value>,
}

impl Table<'_> {
    /// Measures some ways, the speed-up of each over the first.
    fn add(
        &mut self,
        scene: &Scene,
        paths: u32,
        ways: &[(&str, &str)],
        mirrors: &str,
    ) -> Result<()> {
        let cases: Vec<String> = ways
            .iter()
            .map(|(_, case)| format!("{paths}:{case}"))
            .collect();
        let mut flags: Vec<&str> = cases.iter().flat_map(|case| ["--case", case]).collect();
        flags.extend(match self.lab.quick {
            true => ["--size", "160x120", "--frames", "2"],
            false => ["--size", "800x600", "--frames", "3"],
        });
        if !mirrors.is_empty() {
            flags.extend(["--mirror", mirrors]);
        }
        let bench = ["isophote-instant-gi", "frame"];
        let lines = self.lab.bench(bench, scene, &flags)?;
        let whole = |line: &Value| -> Result<[f64; 4]> {
            let [maps, indirect, mirrored] = [
                stage(line, "maps")?,
                stage(line, "indirect")?,
                stage(line, "mirrored")?,
            ];
            Ok([maps, indirect, mirrored, maps + indirect + mirrored])
        };
        for ((name, _), line) in ways.iter().zip(&lines) {
            let times = whole(line)?;
            let what = match mirrors {
                "" => (*name).to_owned(),
                _ => format!("{name}, table and frames mirrors"),
            };
            let mut row = vec![scene.title.clone(), paths.to_string(), what];
            row.extend(times.map(|seconds| format!("{:.0} ms", 1e3 * seconds)));
            row.push(format!("{:.2}", whole(&lines[0])?[3] / times[3]));
            row.push(percent(number(line, "/rel_rmse")?));
            row.push(signed(number(line, "/bias")?));
            row.push(percent(number(line, "/gained")?));
            row.push(percent(number(line, "/lost")?));
            self.rows.push(row);
            self.numbers
                .push(json!({ "title": scene.title, "visibility": name, "measured": line }));
        }
        Ok(())
    }
}

fn pictures(lab: &Lab, scene: &Scene) -> Result<Vec<Picture>> {
    let ways: [(&str, &[&str]); 3] = [
        ("64 × 64", &["--igi-visibility=maps", "--igi-map-size=64"]),
        (
            "128 × 128",
            &["--igi-visibility=maps", "--igi-map-size=128"],
        ),
        (
            "128 × 128, bias 0",
            &["--igi-visibility=maps", "--igi-map-bias=0"],
        ),
    ];
    let base = [
        "--technique=igi",
        "--device=cpu",
        "--materials=lambert",
        "--quantity=irradiance.indirect",
        "--exposure=-1.3",
        match lab.quick {
            true => "--size=160x120",
            false => "--size=800x600",
        },
    ];
    let shoot = |flags: &[&str]| {
        let name = format!("maps-{}", flags.len());
        lab.render(&name, scene, &[&base[..], flags].concat())
    };
    let rays = shoot(&[])?;
    let mut pictures = vec![Picture {
        png: lab.png(&rays)?,
        left: None,
        caption: "rays".to_owned(),
        command: rays.command.clone(),
    }];
    for (name, flags) in ways {
        let shot = shoot(flags)?;
        let compared = lab.compare_whole(&shot, &rays)?;
        let [all, at] = ["/rel_rmse", "/silhouettes/rel_rmse"].map(|at| number(&compared, at));
        pictures.push(Picture {
            png: lab.png(&shot)?,
            left: None,
            caption: format!("{name}: {}, {} at silhouettes", percent(all?), percent(at?)),
            command: shot.command.clone(),
        });
    }
    Ok(pictures)
}
