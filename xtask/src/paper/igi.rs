//! `cargo xtask paper igi`: the figures of Marques and Santos 2010, and what they leave open.
//!
//! One file per section. Its numbers stand in the page beside the paper's, and in `igi.json`.

mod artefacts;
mod convergence;
mod frames;
mod importance;
mod maps;
mod visibility;

use anyhow::Result;
use serde_json::Value;

use super::{
    lab::{Lab, Scene},
    page::Section,
    report::{Measure, Report},
};

pub(super) const REPORT: Report = Report {
    name: "igi",
    title: "Instant global illumination on the GPU using OptiX",
    intro: "Marques and Santos 2010, made again. Their numbers are of an NVIDIA GTX 480 at 800 × 600 pixels with OptiX 2; ours are \
        of the processor named below. Conference stands for their Conference room; their Office is not published, and another \
        office stands for it. All materials are diffuse unless some are said to be mirrors; no anti-aliasing.",
    sections: &SECTIONS,
};

const SECTIONS: [(&str, Measure); 6] = [
    ("frames", frames::measure),
    ("convergence", convergence::measure),
    ("artefacts", artefacts::measure),
    ("importance", importance::measure),
    ("visibility", visibility::measure),
    ("maps", maps::measure),
];

fn conference(lab: &Lab) -> Scene {
    lab.scene("conference", "Conference", &[], "atrium")
}

fn office(lab: &Lab) -> Scene {
    lab.scene("office_proc", "Office", &[], "office")
}

fn cornell(lab: &Lab) -> Scene {
    lab.scene("cornell_original", "Cornell box", &[], "cornell")
}

/// A section and its numbers.
type Measured = Result<(Section, Value)>;
