//! `cargo xtask reference`: our reference integrators against the pictures of another renderer.
//!
//! Every picture `SCENE[.pbr].QUANTITY[_<d_max>m].exr` of a folder is rendered again by `isophote render --technique
//! reference` and compared by `isophote compare`; the limits are those of the `reference` tests: for light a relative
//! RMS error of 4 % and a bias of 1 %, for occlusion 1.5 and 0.5 grey levels, beyond the noise of both pictures.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, bail, ensure};
use serde::Serialize;
use serde_json::Value;

use crate::{
    isophote::{Isophote, Source},
    machine::Machine,
    workspace::Workspace,
};

/// Compare the reference integrators with another renderer's pictures
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// The folder with the other renderer's pictures
    #[arg(long, value_name = "FOLDER", default_value = "../shared/references")]
    references: PathBuf,
    /// The folder with the scenes
    #[arg(long, value_name = "FOLDER", default_value = "../shared/scenes")]
    scenes: PathBuf,
    /// Only pictures whose name contains this
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
    /// Samples per pixel
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(2..))]
    spp: u32,
    /// Where to write the results as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    source: Source,
}

#[derive(Serialize)]
struct Report {
    machine: Machine,
    spp: u32,
    pictures: Vec<Picture>,
}

#[derive(Serialize)]
struct Picture {
    name: String,
    is_occlusion: bool,
    within: bool,
    /// In percent for light, in grey levels for occlusion.
    error_beyond_noise: f64,
    bias: f64,
    render: Value,
    compare: Value,
}

/// What a file name says.
struct Name<'a> {
    scene: &'a str,
    materials: &'static str,
    quantity: &'a str,
    d_max: Option<&'a str>,
}

impl<'a> Name<'a> {
    fn of(stem: &'a str) -> Option<Self> {
        // The distance has a point of its own, so the first one ends the scene's name.
        let (scene, rest) = stem.split_once('.')?;
        let (materials, quantity) = rest
            .strip_prefix("pbr.")
            .map_or(("lambert", rest), |rest| ("pbr", rest));
        let (quantity, d_max) = match quantity.split_once('_') {
            Some((quantity, d_max)) => (quantity, Some(d_max.strip_suffix('m')?)),
            None => (quantity, None),
        };
        Some(Self {
            scene,
            materials,
            quantity,
            d_max,
        })
    }

    fn is_occlusion(&self) -> bool {
        matches!(self.quantity, "ao" | "obscurance")
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let isophote = arguments.source.isophote()?;
    let folder = Workspace::load()?.target_directory.join("reference");
    fs::create_dir_all(&folder)?;
    let mut names = Vec::new();
    let entries = fs::read_dir(&arguments.references).with_context(|| {
        format!(
            "{}: no pictures to compare with",
            arguments.references.display()
        )
    })?;
    for entry in entries {
        let path = entry?.path();
        let stem = path
            .file_stem()
            .and_then(|stem| stem.to_str())
            .unwrap_or_default();
        if path.extension().is_some_and(|suffix| suffix == "exr") && stem.contains(&arguments.only)
        {
            names.push(stem.to_owned());
        }
    }
    names.sort();
    ensure!(
        !names.is_empty(),
        "{}: no picture to compare with",
        arguments.references.display()
    );
    println!(
        "{:<34} {:>10} {:>10} {:>10}",
        "picture", "error", "bias", "noise"
    );
    let mut pictures = Vec::new();
    for stem in names {
        let picture = compare(&isophote, arguments, &folder, stem)?;
        let (unit, scale) = if picture.is_occlusion {
            ("", 1.0)
        } else {
            ("%", 100.0)
        };
        let noise = picture.compare["noise_reference"]
            .as_f64()
            .unwrap_or(f64::NAN)
            * 100.0;
        println!(
            "{:<34} {:>9.2}{unit:1} {:>9.2}{unit:1} {noise:>9.2}%{}",
            picture.name,
            scale * picture.error_beyond_noise,
            scale * picture.bias,
            if picture.within {
                ""
            } else {
                "  beyond the limit"
            }
        );
        pictures.push(picture);
    }
    let beyond = pictures.iter().filter(|picture| !picture.within).count();
    let report = Report {
        machine: Machine::current(),
        spp: arguments.spp,
        pictures,
    };
    if let Some(path) = &arguments.json {
        fs::write(path, serde_json::to_string_pretty(&report)?)
            .with_context(|| path.display().to_string())?;
    }
    if beyond > 0 {
        bail!(
            "{beyond} of {} pictures are beyond the limits",
            report.pictures.len()
        );
    }
    Ok(())
}

fn compare(
    isophote: &Isophote,
    arguments: &Arguments,
    folder: &Path,
    stem: String,
) -> Result<Picture> {
    let name =
        Name::of(&stem).with_context(|| format!("{stem}: not SCENE[.pbr].QUANTITY[_<d_max>m]"))?;
    let text = |path: PathBuf| path.to_string_lossy().into_owned();
    let absolute = |path: PathBuf| std::path::absolute(path).map(text);
    let scene = absolute(arguments.scenes.join(format!("{}.glb", name.scene)))?;
    let reference = absolute(arguments.references.join(format!("{stem}.exr")))?;
    let ours = text(folder.join(format!("{stem}.exr")));
    let error_image = text(folder.join(format!("{stem}.error.png")));
    let spp = arguments.spp.to_string();
    let mut render = vec![
        "render",
        &scene,
        "--technique",
        "reference",
        "--tracer",
        "bvh",
        "--quantity",
        name.quantity,
    ];
    render.extend([
        "--size", "320x240", "--spp", &spp, "--quiet", "--json", "-o", &ours,
    ]);
    if let Some(d_max) = name.d_max {
        render.extend(["--d-max", d_max]);
    }
    if !["ao", "obscurance"].contains(&name.quantity) {
        render.extend(["--materials", name.materials]);
    }
    let render = isophote.json(&render)?;
    let compare = isophote.json(&[
        "compare",
        &ours,
        &reference,
        "--quantity",
        name.quantity,
        "--json",
        "--error-image",
        &error_image,
    ])?;
    let number = |key: &str| {
        compare[key]
            .as_f64()
            .with_context(|| format!("`isophote compare` named no {key}"))
    };
    let (error, bias, limits) = if name.is_occlusion() {
        (
            number("grey_rms_beyond_noise")?,
            number("grey_bias")?,
            (1.5, 0.5),
        )
    } else {
        (
            number("rel_rmse_beyond_noise")?,
            number("bias")?,
            (0.04, 0.01),
        )
    };
    let within = error <= limits.0 && bias.abs() <= limits.1;
    Ok(Picture {
        is_occlusion: name.is_occlusion(),
        within,
        error_beyond_noise: error,
        bias,
        render,
        compare,
        name: stem,
    })
}
