//! `cargo xtask paper ldm`: what Aalund, Frisvad and Bærentzen 2015 showed, made again.
//!
//! One file per section. Its numbers stand in the page beside the paper's, and in `ldm.json`.

mod ao;
mod error;
mod indirect;
mod seen;
mod speed;
mod splatting;

use anyhow::Result;
use serde_json::Value;

use super::{
    lab::{Lab, Scene},
    page::Section,
    report::{Measure, Report},
};

pub(super) const REPORT: Report = Report {
    name: "ldm",
    title: "Deterministically directed layered depth maps",
    intro: "Aalund, Frisvad and Bærentzen, EGSR Experimental Ideas & Implementations 2015, made again. Their times are of an \
        NVIDIA GTX 780 Ti at 800 × 800 pixels; ours are of the processor named below, so a time is to be read against the exact \
        tracer beside it. Errors are against the reference integrator with an exact tracer; 'beyond the noise' is without the \
        reference's own noise.",
    sections: &SECTIONS,
};

const SECTIONS: [(&str, Measure); 8] = [
    ("ao", ao::measure),
    ("error", error::measure),
    ("speed", speed::measure),
    ("memory", speed::measure_memory),
    ("indirect", indirect::measure),
    ("splatting", splatting::measure),
    ("flicker", seen::measure_flicker),
    ("figures", seen::measure_figures),
];

fn sponza(lab: &Lab) -> Scene {
    lab.scene("sponza_dabrovic", "Sponza", &[], "atrium")
}

fn sibenik(lab: &Lab) -> Scene {
    lab.scene("sibenik", "Sibenik", &[], "office")
}

fn cornell(lab: &Lab) -> Scene {
    lab.scene("cornell_original", "Cornell box", &[], "cornell")
}

fn hairball(lab: &Lab) -> Scene {
    lab.scene("hairball_proc", "a hairball", &[], "hairball")
}

/// A section and its numbers.
type Measured = Result<(Section, Value)>;
