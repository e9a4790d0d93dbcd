//! What can only be seen: a sequence with a moving object, and the paper's Fig. 3 and 5.

use anyhow::{Context, Result};
use serde_json::{Value, json};

use super::{Measured, sponza};
use crate::paper::{
    lab::{Lab, Scene, number},
    page::{Part, Picture, Section},
    report::cells,
};

const FLICKER: &str = "An object goes to and fro. Maps are built anew for every frame, along the same directions. Away from it means \
    farther than d_max from all places where it is: there nothing changes, and what is measured is flicker: maps are fitted around \
    what is seen, in pixels of a lattice that stays, but where it changes its size a map may get pixels of the next size. Changes are from frame to frame, in grey levels. One point a pixel.";

const FIGURES: &str = "Fig. 3: the layers of three of the maps of a scene, as points, seen from the same place; the nearer the brighter. \
    Fig. 5: the regions of equal area with all their centres, and those that maps are along, which answer for the opposite ones too.";

/// Runs the bench that draws.
fn draw(lab: &Lab, scene: &Scene, flags: &[&str]) -> Result<(Vec<Value>, String)> {
    let out = lab.folder().to_string_lossy().into_owned();
    let lines = lab.bench(
        ["isophote-ldm-ambient", "pictures"],
        scene,
        &[&["--out", &out], flags].concat(),
    )?;
    let command = format!(
        "cargo bench -p isophote-ldm-ambient --bench pictures -- {} {}",
        scene.path,
        flags.join(" ")
    );
    Ok((lines, command))
}

fn picture(lab: &Lab, line: &Value, caption: String, command: &str) -> Result<Picture> {
    let name = line["picture"].as_str();
    let name = name.context("the bench named no picture")?;
    Ok(Picture {
        png: lab.read(name.trim_end_matches(".png"))?,
        left: None,
        caption,
        command: command.to_owned(),
    })
}

pub(super) fn measure_flicker(lab: &Lab) -> Measured {
    let scene = Scene {
        path: "builtin:office".to_owned(),
        title: "office (built in)".to_owned(),
        flags: Vec::new(),
        is_builtin: true,
    };
    let flags: &[&str] = match lab.quick {
        true => &[
            "--frames", "4", "--size", "64x48", "--maps", "32", "--d-max", "0.5",
        ],
        false => &[
            "--frames", "60", "--size", "192x144", "--maps", "512", "--d-max", "0.5",
        ],
    };
    let (lines, command) = draw(lab, &scene, flags)?;
    let line = lines.first().context("the bench printed no sequence")?;
    let mut rows = Vec::new();
    for (where_, key) in [("away from the object", "away"), ("elsewhere", "elsewhere")] {
        let count = |of: &str| number(line, &format!("/{key}/{of}"));
        rows.push(vec![
            where_.to_owned(),
            format!("{:.0}", count("pixels")?),
            format!(
                "{:.2} %",
                100.0 * count("changed")? / count("pixels")?.max(1.0)
            ),
            format!("{:.3}", count("rms")?),
            format!("{:.2}", count("most")?),
        ]);
    }
    let same = match line["first_frame_again_is_the_same"].as_bool() {
        Some(true) => "Two frames of the scene at rest are the same to the bit.",
        _ => "Two frames of the scene at rest are NOT the same.",
    };
    let head = cells([
        "pixels",
        "pairs of frames",
        "that change at all",
        "RMS",
        "most",
    ]);
    let section = Section {
        id: "flicker",
        title: "Flicker",
        parts: vec![
            Part::Text(format!("{FLICKER} {same}")),
            Part::Table { head, rows },
            Part::Pictures {
                title: format!("{}, {} frames", scene.title, line["frames"]),
                pictures: vec![picture(lab, line, "row by row".to_owned(), &command)?],
            },
        ],
    };
    Ok((section, line.clone()))
}

pub(super) fn measure_figures(lab: &Lab) -> Measured {
    let scene = sponza(lab);
    let (clouds, command) = draw(
        lab,
        &scene,
        &["--cloud", "--maps", "32", "--resolution", "200"],
    )?;
    let mut pictures = Vec::new();
    for line in &clouds {
        let caption = format!(
            "map {} of {}: {} layers",
            line["map"], line["of"], line["points"]
        );
        pictures.push(picture(lab, line, caption, &command)?);
    }
    let (spheres, command) = draw(lab, &scene, &["--directions", "64"])?;
    let line = spheres.first().context("the bench drew no sphere")?;
    let caption = format!("{} regions, {} maps", line["regions"], line["maps"]);
    let section = Section {
        id: "figures",
        title: "Fig. 3 and 5: maps and their directions",
        parts: vec![
            Part::Text(FIGURES.to_owned()),
            Part::Pictures {
                title: format!("Fig. 3, {}", scene.title),
                pictures,
            },
            Part::Pictures {
                title: "Fig. 5".to_owned(),
                pictures: vec![picture(lab, line, caption, &command)?],
            },
        ],
    };
    Ok((section, json!({ "clouds": clouds, "directions": spheres })))
}
