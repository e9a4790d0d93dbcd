//! Ambient occlusion at pixels by exact rays and by fields.

use anyhow::Result;
use serde_json::{Value, json};

use super::bunny;
use crate::paper::{
    lab::{Lab, number},
    page::{Part, Picture, Section},
};

const TEXT: &str = "The same rays of every pixel, by exact rays and by fields of 4226 positions of 32 × 32 directions. The floor and \
    what has few triangles are met exactly in both.";

/// What is beside the exact picture: a name, a title, and flags.
const CASES: [(&str, &str, &[&str]); 4] = [
    ("nearest", "8 bits, nearest", &["--field-look-up=nearest"]),
    ("aimed", "8 bits, aimed", &["--field-look-up=aimed"]),
    ("interpolated", "8 bits, interpolated", &[]),
    (
        "bit",
        "1 bit, 64 × 64 directions, interpolated",
        &["--field-bits=1", "--field-resolution=64"],
    ),
];

pub(super) fn measure(lab: &Lab) -> Result<(Section, Value)> {
    let scene = bunny(lab);
    let (size, samples) = if lab.quick {
        ("--size=160x120", "--spp=16")
    } else {
        ("--size=480x360", "--spp=64")
    };
    let all = ["--quantity=ao", size, samples];
    let truth = lab.render("exact", &scene, &[&all[..], &["--device=cpu"]].concat())?;
    let mut pictures = vec![Picture {
        png: lab.png(&truth)?,
        left: None,
        caption: format!("exact rays: {:.2} s", truth.seconds()?),
        command: truth.command.clone(),
    }];
    let mut numbers = Vec::new();
    let on_gpu: &[&str] = &["--device=gpu"];
    let mut cases: Vec<(&str, &str, Vec<&str>)> = CASES
        .iter()
        .map(|(name, title, flags)| (*name, *title, [&["--device=cpu"], *flags].concat()))
        .collect();
    if lab.gpu {
        cases.push(("gpu", "8 bits, interpolated, on the GPU", on_gpu.to_vec()));
    }
    for (name, title, flags) in cases {
        let flags = [&all[..], &["--tracer=field"], &flags].concat();
        let shot = lab.render(name, &scene, &flags)?;
        let compared = lab.compare_whole(&shot, &truth)?;
        let [rms, bias] = [
            number(&compared, "/grey_rms")?,
            number(&compared, "/grey_bias")?,
        ];
        let device = shot.report["device"]
            .as_str()
            .unwrap_or_default()
            .to_owned();
        let caption = format!(
            "{title}: RMS {rms:.2}, bias {bias:.2} of 255 grey levels; {:.2} s on {device}",
            shot.seconds()?
        );
        pictures.push(Picture {
            png: lab.png(&shot)?,
            left: None,
            caption,
            command: shot.command.clone(),
        });
        numbers.push(json!({ "case": name, "grey_rms": rms, "grey_bias": bias, "seconds": shot.seconds()?, "device": device }));
    }
    let section = Section {
        id: "pictures",
        title: "Pictures",
        parts: vec![
            Part::Text(TEXT.to_owned()),
            Part::Pictures {
                title: format!("{}, ambient occlusion", scene.title),
                pictures,
            },
        ],
    };
    Ok((section, Value::Array(numbers)))
}
