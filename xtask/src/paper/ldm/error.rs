//! Error against time: ambient occlusion by more and more maps, and by more and more rays of the exact tracer.

use anyhow::Result;
use serde_json::{Value, json};

use super::{Measured, sponza};
use crate::paper::{
    lab::{Lab, Scene, Shot, number},
    page::{Part, Section},
    plot::{Curve, Plot},
    report::cells,
};

const TEXT: &str = "One point a pixel for maps, so that only their number is told apart; all threads, what is kept between pictures not \
    counted: the exact tracer's tree, but not maps, which are built for each picture. RMS in grey levels against the \
    exact tracer with many rays.";

const MAPS: [&str; 7] = ["16", "32", "64", "128", "256", "512", "1024"];
const RAYS: [&str; 5] = ["1", "4", "16", "64", "256"];

pub(super) fn measure(lab: &Lab) -> Measured {
    let scene = sponza(lab);
    let (samples, maps, rays) = match lab.quick {
        true => ("--spp=64", &MAPS[..3], &RAYS[..3]),
        false => ("--spp=1024", &MAPS[..], &RAYS[..]),
    };
    let exact = ["--technique=reference", "--tracer=bvh"];
    let truth = shoot(
        lab,
        &scene,
        "truth",
        &[&exact[..], &[samples, "--seed=1"]].concat(),
    )?;
    let by_maps = maps.iter().map(|count| {
        let flag = format!("--ldm-maps={count}");
        let flags = ["--technique=ldm", "--ldm-samples=1", &flag];
        let shot = shoot(lab, &scene, &format!("maps-{count}"), &flags)?;
        case(lab, "maps", count, &shot, &truth)
    });
    let by_maps: Vec<Value> = by_maps.collect::<Result<_>>()?;
    let by_rays = rays.iter().map(|count| {
        let flag = format!("--spp={count}");
        let flags = [exact[0], exact[1], &flag];
        let shot = shoot(lab, &scene, &format!("rays-{count}"), &flags)?;
        case(lab, "rays", count, &shot, &truth)
    });
    let by_rays: Vec<Value> = by_rays.collect::<Result<_>>()?;
    let plots = [
        ("RMS, grey levels", "seconds", ["/seconds", "/grey_rms"]),
        ("seconds", "maps, or rays a pixel", ["/count", "/seconds"]),
    ];
    let plots = plots.map(|(what, x, keys)| {
        let curves = vec![
            Curve::of("maps", &by_maps, keys)?,
            Curve::of("rays of the exact tracer", &by_rays, keys)?,
        ];
        let title = &format!("{what}: {}", scene.title);
        Plot { title, x, curves }.svg().map(Part::Plot)
    });
    let [of_time, of_size] = plots;
    let mut numbers = by_maps;
    numbers.extend(by_rays);
    let rows = numbers.iter().map(row).collect::<Result<_>>()?;
    let head = cells(["by", "number", "RMS", "bias", "seconds"]);
    let section = Section {
        id: "error",
        title: "Error against time",
        parts: vec![
            Part::Text(format!("{}. {TEXT}", scene.title)),
            of_time?,
            of_size?,
            Part::Table { head, rows },
        ],
    };
    Ok((section, Value::Array(numbers)))
}

fn shoot(lab: &Lab, scene: &Scene, name: &str, flags: &[&str]) -> Result<Shot> {
    let size = if lab.quick {
        "--size=80x60"
    } else {
        "--size=640x480"
    };
    let common = ["--quantity=ao", "--d-max=6", size];
    lab.render(
        &format!("error-{name}"),
        scene,
        &[&common[..], flags].concat(),
    )
}

fn case(lab: &Lab, by: &str, count: &str, shot: &Shot, truth: &Shot) -> Result<Value> {
    let errors = lab.compare_whole(shot, truth)?;
    Ok(json!({
        "by": by, "count": count.parse::<u32>()?, "seconds": shot.seconds()?, "command": shot.command,
        "grey_rms": number(&errors, "/grey_rms")?, "grey_bias": number(&errors, "/grey_bias")?,
    }))
}

fn row(case: &Value) -> Result<Vec<String>> {
    Ok(vec![
        case["by"].as_str().unwrap_or_default().to_owned(),
        case["count"].to_string(),
        format!("{:.2}", number(case, "/grey_rms")?),
        format!("{:+.2}", number(case, "/grey_bias")?),
        format!("{:.3}", number(case, "/seconds")?),
    ])
}
