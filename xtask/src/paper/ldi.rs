//! `cargo xtask paper ldi`: the tables and figures of Nießner, Schäfer and Stamminger 2010.
//!
//! One file per section. Its numbers stand in the page beside the paper's, and in `ldi.json`.

mod figures;
mod filter;
mod growth;
mod memory;
mod table1;
mod truth;

use super::{
    lab::{Lab, Scene},
    report::{Measure, Report},
};

pub(super) const REPORT: Report = Report {
    name: "ldi",
    title: "Fast indirect illumination using layered depth images",
    intro: "Nießner, Schäfer and Stamminger, The Visual Computer 26, 2010, made again. Their numbers are of an \
    NVIDIA GTX 285 (GPU) at 512 × 512 pixels; ours are of the processor named below, so a rate is to be read against the \
    exact tracer beside it and not against theirs. 'touched' layers hold all triangles of a pixel and are exact; 'center' \
    layers are the paper's, sampled at the pixels' centres.",
    sections: &SECTIONS,
};

const SECTIONS: [(&str, Measure); 6] = [
    ("table-1", table1::measure),
    ("truth", truth::measure),
    ("memory", memory::measure),
    ("filter", filter::measure),
    ("figures", figures::measure),
    ("growth", growth::measure),
];

fn sponza(lab: &Lab) -> Scene {
    lab.scene("sponza_dabrovic", "Sponza", &[], "atrium")
}

/// Fitted to the nave: the file holds the houses around it too.
fn sibenik(lab: &Lab) -> Scene {
    let bounds = ["--bounds=-20,-2,-9,28,31,9"];
    lab.scene("sibenik", "Sibenik", &bounds, "office")
}

fn cornell(lab: &Lab) -> Scene {
    lab.scene("cornell_original", "Cornell box", &[], "cornell")
}
