//! Fig. 10: one bounce of light by photons, gathered and splatted, against the number of photons and the size of splats.

use anyhow::Result;
use serde_json::{Value, json};

use super::{Measured, cornell, sibenik, sponza};
use crate::paper::{
    lab::Lab,
    page::{Part, Picture, Section},
    plot::{Curve, Plot},
    report::{cells, percent, signed},
};

const TEXT: &str = "512 maps of 200². Splatted: every part of a photon lights the pixels around where it lands, as in the paper. \
    Gathered: every point looks along the maps for the photons that light it; the sums are the same, but nothing is smeared \
    over what receives; photons are cut where they meet edges and shadows, down to a quarter of their side, and sent closer to \
    each other where splats are narrower than two footprints. Uncut: gathered, each photon as large as its pixel, as in the paper. \
    The stages are shares of the time of the whole picture.";

/// What is made: by whom, photons along a side, the size of splats.
const CASES: [[&str; 3]; 13] = [
    ["gathered", "16", "2"],
    ["gathered", "32", "2"],
    ["gathered", "64", "2"],
    ["gathered", "128", "2"],
    ["gathered", "64", "1"],
    ["gathered", "64", "4"],
    ["uncut", "16", "2"],
    ["uncut", "32", "2"],
    ["uncut", "64", "2"],
    ["uncut", "128", "2"],
    ["splatted", "64", "2"],
    ["splatted", "64", "1"],
    ["splatted", "128", "1"],
];

pub(super) fn measure(lab: &Lab) -> Measured {
    let (size, samples, maps) = match lab.quick {
        true => ("--size=64x48", "--spp=64", "--ldm-maps=64"),
        false => ("--size=320x240", "--spp=1024", "--ldm-maps=512"),
    };
    let common = [size, "--quantity=indirect", "--materials=lambert"];
    let (mut rows, mut numbers) = (Vec::new(), Vec::new());
    let (mut pictures, mut of_photons, mut of_sizes) = (Vec::new(), Vec::new(), Vec::new());
    let mut of_time = Vec::new();
    for scene in [sponza(lab), cornell(lab), sibenik(lab)] {
        let title = scene.title.split(' ').next().unwrap_or_default().to_owned();
        let reference = ["--technique=reference", "--tracer=bvh", samples];
        let name = format!("{title}-reference");
        let truth = lab.render(&name, &scene, &[&common[..], &reference].concat())?;
        let (mut by_photons, mut by_sizes) = (Vec::new(), Vec::new());
        let mut by_uncut = Vec::new();
        for [deposit, raster, splat] in CASES {
            let way = match deposit {
                "splatted" => "splatted",
                _ => "gathered",
            };
            let mut flags = vec![
                format!("--ldm-deposit={way}"),
                format!("--ldm-photons={raster}"),
                format!("--ldm-splat-size={splat}"),
            ];
            if deposit == "uncut" {
                flags.push(format!("--ldm-finest={raster}"));
            }
            let mut all = [&common[..], &["--technique=ldm", maps]].concat();
            all.extend(flags.iter().map(String::as_str));
            let shot = lab.render(&format!("{title}-{deposit}-{raster}-{splat}"), &scene, &all)?;
            let [error, bias] = lab.compare(&shot, &truth)?;
            let stages: &[&str] = match way {
                "splatted" => &["emission", "maps", "split", "splat"],
                _ => &["emission", "field", "maps", "gather"],
            };
            let mut shares = Vec::new();
            for stage in stages {
                let share = shot.pass_seconds(stage)? / shot.seconds()?;
                shares.push(format!("{stage} {}", percent(share)));
            }
            rows.push(vec![
                scene.title.clone(),
                deposit.to_owned(),
                format!("{raster}²"),
                splat.to_owned(),
                percent(error),
                signed(bias),
                format!("{:.2} s", shot.seconds()?),
                shares.join(", "),
            ]);
            numbers.push(json!({
                "scene": scene.title, "deposit": deposit, "raster": raster, "splat_size": splat,
                "rel_rmse": error, "bias": bias, "seconds": shot.seconds()?,
                "passes": shot.report["passes"], "command": shot.command,
            }));
            if deposit == "uncut" {
                by_uncut.push((raster.parse()?, error));
            }
            if deposit == "gathered" && splat == "2" {
                by_photons.push((raster.parse()?, error));
            }
            if deposit == "gathered" && raster == "64" {
                by_sizes.push((splat.parse()?, error));
            }
            if raster == "64" && splat == "2" && deposit != "uncut" {
                pictures.push(Picture {
                    png: lab.png(&shot)?,
                    left: Some(lab.png(&truth)?),
                    caption: format!("{}, left the reference, right {deposit}", scene.title),
                    command: shot.command.clone(),
                });
            }
        }
        of_time.push(over_time(&scene.title, &numbers)?);
        let uncut = format!("{}, uncut", scene.title);
        by_sizes.sort_by(|a: &(f64, f64), b| a.0.total_cmp(&b.0));
        for (curves, points) in [(&mut of_photons, by_photons), (&mut of_sizes, by_sizes)] {
            let name = scene.title.clone();
            curves.push(Curve { name, points });
        }
        of_photons.push(Curve {
            name: uncut,
            points: by_uncut,
        });
    }
    let plots = [
        ("photons along a side", of_photons),
        ("size of splats", of_sizes),
    ];
    let plots = plots.map(|(x, curves)| {
        let title = "relRMSE, gathered";
        Plot { title, x, curves }.svg().map(Part::Plot)
    });
    let [of_photons, of_sizes] = plots;
    let head = cells([
        "scene",
        "deposit",
        "photons a face",
        "splat size",
        "relRMSE",
        "bias",
        "time",
        "stages",
    ]);
    let mut parts = vec![
        Part::Text(TEXT.to_owned()),
        Part::Table { head, rows },
        of_photons?,
        of_sizes?,
    ];
    parts.append(&mut of_time);
    parts.push(Part::Pictures {
        title: "Pictures".to_owned(),
        pictures,
    });
    let section = Section {
        id: "indirect",
        title: "Fig. 10: indirect light",
        parts,
    };
    Ok((section, Value::Array(numbers)))
}

/// Error against time of a scene's pictures by more and more photons, splatted ones in smaller splats.
fn over_time(title: &str, numbers: &[Value]) -> Result<Part> {
    let curve = |deposit: &&str| {
        let of_deposit = |one: &&Value| one["scene"] == title && one["deposit"] == *deposit;
        let splats = match *deposit {
            "splatted" => "1",
            _ => "2",
        };
        let is_shown = |one: &&Value| one["splat_size"] == splats;
        let own = numbers.iter().filter(of_deposit).filter(is_shown);
        Curve::of(*deposit, own, ["/seconds", "/rel_rmse"])
    };
    let plot = Plot {
        title: &format!("relRMSE: {title}"),
        x: "seconds",
        curves: ["gathered", "uncut", "splatted"]
            .iter()
            .map(curve)
            .collect::<Result<_>>()?,
    };
    plot.svg().map(Part::Plot)
}
