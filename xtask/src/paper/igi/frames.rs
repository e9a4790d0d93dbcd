//! Fig. 4 and 5: what the stages of a frame take, what each shortcut gains and what it costs in truth.

use anyhow::{Context, Result};
use serde_json::{Value, json};

use super::{Measured, conference, office};
use crate::paper::{
    lab::{Lab, Scene, number},
    page::{Part, Picture, Section},
    plot::{Curve, Plot},
    report::{cells, percent, signed},
};

/// A case of the bench `frame`, without the number of light paths; what it is, and what the paper has of it.
#[derive(Clone, Copy)]
struct Variant {
    name: &'static str,
    case: &'static str,
    /// The speed-up of the indirect stage that the paper tells.
    then: &'static str,
    /// The variant to which that speed-up is.
    over: Option<usize>,
}

/// The paper's, one shortcut after another.
const PAPER: [Variant; 4] = [
    Variant {
        name: "plain",
        case: "triangles:1:1x1:regular:paper:halton",
        then: "",
        over: None,
    },
    Variant {
        name: "imperfect visibility",
        case: "boxes:1:1x1:regular:paper:halton",
        then: "1.5 to 2",
        over: Some(0),
    },
    Variant {
        name: "+ downsampling 4 × 4",
        case: "boxes:4:1x1:regular:paper:halton",
        then: "about 5",
        over: Some(1),
    },
    Variant {
        name: "+ interleaving 3 × 3",
        case: "boxes:4:3x3:regular:paper:halton",
        then: "further",
        over: Some(2),
    },
];

/// The milder ones that the paper proposes, and ours; to the plain method, all with a lattice for each light.
const OTHERS: [Variant; 13] = [
    Variant {
        over: None,
        ..other("plain", "triangles")
    },
    other("downsampling 4 × 4 alone", "triangles:4:1x1:regular:paper"),
    other("downsampling 4 × 4, depths too", "triangles:4"),
    other("downsampling 3 × 3, depths too", "triangles:3"),
    other("4 × 4 and 3 × 3", "triangles:4:3x3:regular:paper"),
    other("4 × 4 and 2 × 2", "triangles:4:2x2:regular:paper"),
    other(
        "4 × 4 and 3 × 3, irregular",
        "triangles:4:3x3:irregular:paper",
    ),
    other(
        "4 × 4 and 3 × 3, one pass, depths too",
        "triangles:4:3x3:regular:edges",
    ),
    other(
        "4 × 4 and 3 × 3, irregular, one pass",
        "triangles:4:3x3:irregular:edges",
    ),
    other(
        "4 × 4 and 3 × 3, gaps filled",
        "triangles:4:3x3:regular:fill",
    ),
    other(
        "4 × 4 and 3 × 3, gaps filled, pixels refined",
        "triangles:4:3x3:regular:fill+refine/2",
    ),
    other(
        "4 × 4, depths too, pixels refined",
        "triangles:4:1x1:regular:edges+refine/2",
    ),
    other(
        "boxes, 4 × 4 and 3 × 3, gaps filled",
        "boxes:4:3x3:regular:fill",
    ),
];

const fn other(name: &'static str, case: &'static str) -> Variant {
    Variant {
        name,
        case,
        then: "",
        over: Some(0),
    }
}

/// Materials of the table and of the chairs' frames in Conference.
pub(super) const MIRRORS: [&str; 2] = ["mesh29_SG", "mesh21_SG"];
/// With caching of what they show.
const CACHED: [Variant; 1] = [Variant {
    name: "triangles, gaps filled",
    case: "triangles:4:3x3:regular:fill",
    then: "",
    over: None,
}];

const TEXT: &str = "Milliseconds of the stages of a frame and their share, medians; every frame shoots its light paths anew. \
    'mirrored' is the light of the virtual lights on what mirrors show, which the paper counts as part of its direct stage. Speed-ups \
    are those of the indirect stage; errors are those of the indirect light against the plain method with the same virtual lights. \
    The paper tells speed-ups, and 2.8 frames/s for Conference with all three shortcuts.";

const STAGES: [&str; 8] = [
    "vpls", "camera", "direct", "mirrored", "indirect", "filter", "refine", "compose",
];

pub(super) fn measure(lab: &Lab) -> Measured {
    let (mut parts, mut numbers) = (vec![Part::Text(TEXT.to_owned())], Vec::new());
    for scene in [conference(lab), office(lab)] {
        let mut table = Table::new(lab, &scene, &[]);
        for paths in [30, 90, 180] {
            table.add(paths, &PAPER)?;
        }
        let plot = table.plot(&PAPER)?;
        parts.push(Part::Text(format!("Fig. 4 and 5, {}", scene.title)));
        table.finish(&mut parts, &mut numbers);
        parts.push(plot);
        let mut table = Table::new(lab, &scene, &[]);
        table.add(180, &OTHERS)?;
        parts.push(Part::Text(format!(
                "Milder settings and other filters, {}; light paths from a lattice for each light, which the paper has not",
            scene.title
        )));
        table.finish(&mut parts, &mut numbers);
    }
    let scene = conference(lab);
    if !scene.is_builtin {
        let mut table = Table::new(lab, &scene, &MIRRORS);
        table.add(180, &PAPER)?;
        for caching in ["0", "0.05", "0.1", "0.2"] {
            table.caching = caching;
            table.add(180, &CACHED)?;
        }
        let title = "Conference with the table and the chairs' frames made mirrors: what they show is lit at full resolution \
                     and by all virtual lights, whatever the shortcuts";
        parts.push(Part::Text(title.to_owned()));
        table.finish(&mut parts, &mut numbers);
        parts.push(pictures(lab, &scene)?);
    }
    let section = Section {
        id: "frames",
        title: "Fig. 4 and 5: frames, stage by stage",
        parts,
    };
    Ok((section, Value::Array(numbers)))
}

/// Conference with diffuse materials, and with mirrors.
fn pictures(lab: &Lab, scene: &Scene) -> Result<Part> {
    let size = match lab.quick {
        true => "--size=160x120",
        false => "--size=800x600",
    };
    let base = [
        "--technique=igi",
        "--device=cpu",
        "--quantity=path",
        "--igi-downsampling=4",
        "--igi-interleaving=3x3",
        "--igi-filter=fill",
        "--exposure=0.5",
        size,
    ];
    let mirrors = MIRRORS.map(|name| format!("--material={name}=1,0"));
    let mirrors: Vec<&str> = mirrors.iter().map(String::as_str).collect();
    let cached = [&mirrors[..], &["--igi-caching=0.1"]].concat();
    let ways: [(&str, &[&str]); 3] = [
        ("diffuse materials", &["--materials=lambert"]),
        ("table and frames made mirrors", &mirrors),
        ("the same, light on what they show cached at 10 cm", &cached),
    ];
    let picture = |(caption, flags): (&str, &[&str])| {
        let shot = lab.render("frames-materials", scene, &[&base[..], flags].concat())?;
        Ok(Picture {
            png: lab.png(&shot)?,
            left: None,
            caption: caption.to_owned(),
            command: shot.command,
        })
    };
    Ok(Part::Pictures {
        title: "Conference, 180 light paths, 4 × 4 and 3 × 3 with gaps filled".to_owned(),
        pictures: ways.into_iter().map(picture).collect::<Result<_>>()?,
    })
}

/// A table of one scene.
struct Table<'a> {
    lab: &'a Lab,
    scene: &'a Scene,
    mirrors: &'static [&'static str],
    caching: &'static str,
    rows: Vec<Vec<String>>,
    numbers: Vec<Value>,
}

impl<'a> Table<'a> {
    fn new(lab: &'a Lab, scene: &'a Scene, mirrors: &'static [&'static str]) -> Self {
        Self {
            lab,
            scene,
            mirrors,
            caching: "0",
            rows: Vec::new(),
            numbers: Vec::new(),
        }
    }

    /// Measures some variants with as many light paths.
    fn add(&mut self, paths: u32, variants: &[Variant]) -> Result<()> {
        let cases: Vec<String> = variants
            .iter()
            .map(|variant| format!("{paths}:{}", variant.case))
            .collect();
        let mut flags: Vec<&str> = cases.iter().flat_map(|case| ["--case", case]).collect();
        flags.extend(match self.lab.quick {
            true => ["--size", "160x120", "--frames", "2"],
            false => ["--size", "800x600", "--frames", "3"],
        });
        let mirrors = self.mirrors.join(",");
        if !mirrors.is_empty() {
            flags.extend(["--mirror", &mirrors, "--caching", self.caching]);
        }
        let lines = self
            .lab
            .bench(["isophote-instant-gi", "frame"], self.scene, &flags)?;
        for (variant, line) in variants.iter().zip(&lines) {
            let over = variant.over.and_then(|over| lines.get(over));
            let mut row = row(paths, variant, line, over)?;
            if self.caching != "0" {
                let name = format!("{}, mirrors cached at {} m", variant.name, self.caching);
                row[1] = name;
            }
            if !mirrors.is_empty() {
                row.push(percent(number(line, "/mirrors_rel_rmse")?));
            }
            self.rows.push(row);
            self.numbers.push(json!({
                "title": self.scene.title, "variant": variant.name, "paths": paths, "speed_up_then": variant.then,
                "measured": line,
            }));
        }
        Ok(())
    }

    /// The time of a frame against the number of light paths.
    fn plot(&self, variants: &[Variant]) -> Result<Part> {
        let curve = |variant: &Variant| {
            let own = self.numbers.iter();
            let own = own.filter(|one| one["variant"] == variant.name);
            Curve::of(variant.name, own, ["/paths", "/measured/frame_seconds"])
        };
        let plot = Plot {
            title: &format!("seconds a frame: {}", self.scene.title),
            x: "light paths",
            curves: variants.iter().map(curve).collect::<Result<_>>()?,
        };
        plot.svg().map(Part::Plot)
    }

    fn finish(self, parts: &mut Vec<Part>, numbers: &mut Vec<Value>) {
        let mut head = cells([
            "light paths",
            "variant",
            "frames/s",
            "vpls",
            "camera",
            "direct",
            "mirrored",
            "indirect",
            "filter",
            "refine",
            "compose",
            "speed-up then",
            "now",
            "relRMSE added",
            "bias",
        ]);
        if !self.mirrors.is_empty() {
            head.push("mirrors' relRMSE".to_owned());
        }
        parts.push(Part::Table {
            head,
            rows: self.rows,
        });
        numbers.extend(self.numbers);
    }
}

fn row(paths: u32, variant: &Variant, line: &Value, over: Option<&Value>) -> Result<Vec<String>> {
    let frame = number(line, "/frame_seconds")?;
    let mut row = vec![
        paths.to_string(),
        variant.name.to_owned(),
        format!("{:.2}", 1.0 / frame),
    ];
    for name in STAGES {
        let seconds = stage(line, name)?;
        row.push(format!(
            "{:.0} ({:.0}\u{a0}%)",
            1e3 * seconds,
            100.0 * seconds / frame
        ));
    }
    row.push(variant.then.to_owned());
    row.push(match over {
        Some(over) => format!("{:.2}", stage(over, "indirect")? / stage(line, "indirect")?),
        None => String::new(),
    });
    row.push(percent(number(line, "/rel_rmse")?));
    row.push(signed(number(line, "/bias")?));
    Ok(row)
}

/// Seconds of a stage.
pub(super) fn stage(line: &Value, name: &str) -> Result<f64> {
    let passes = line["passes"].as_array();
    let pass = passes.and_then(|passes| passes.iter().find(|pass| pass["name"] == name));
    number(
        pass.with_context(|| format!("the bench told nothing of the stage {name}"))?,
        "/seconds",
    )
}
