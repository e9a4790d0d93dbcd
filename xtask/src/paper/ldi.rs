//! `cargo xtask paper ldi`: the tables and figures of Nießner, Schäfer and Stamminger 2010.
//!
//! One file per section. Its numbers stand in the page beside the paper's, and in `ldi.json`.

mod figures;
mod filter;
mod growth;
mod memory;
mod table1;
mod truth;

use anyhow::{Result, bail};
use serde_json::{Map, Value, json};

use super::{
    lab::{Lab, Scene},
    page::{Page, Section},
};
use crate::{isophote::Source, machine::Machine};

const TITLE: &str = "Fast indirect illumination using layered depth images";
const INTRO: &str = "Nießner, Schäfer and Stamminger, The Visual Computer 26, 2010, made again. Their numbers are of an \
    NVIDIA GTX 285 (GPU) at 512 × 512 pixels; ours are of the processor named below, so a rate is to be read against the \
    exact tracer beside it and not against theirs. 'touched' layers hold all triangles of a pixel and are exact; 'center' \
    layers are the paper's, sampled at the pixels' centres.";

/// NSS10: layered depth images
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Small pictures, few rays, coarse maps: a look in minutes
    #[arg(long)]
    quick: bool,
    /// Table 1 on the fastest GPU too
    #[arg(long)]
    gpu: bool,
    /// Only these sections: table-1, truth, memory, filter, figures, growth
    #[arg(long, value_name = "SECTION[,…]", value_delimiter = ',')]
    only: Vec<String>,
    #[command(flatten)]
    source: Source,
}

/// Measures a section; its numbers go into the JSON.
type Measure = fn(&Lab) -> Result<(Section, Value)>;

const SECTIONS: [(&str, Measure); 6] = [
    ("table-1", table1::measure),
    ("truth", truth::measure),
    ("memory", memory::measure),
    ("filter", filter::measure),
    ("figures", figures::measure),
    ("growth", growth::measure),
];

/// Measures everything and writes the page.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    for name in &arguments.only {
        if !SECTIONS.iter().any(|section| section.0 == name) {
            let known = SECTIONS.map(|section| section.0).join(", ");
            bail!("there is no section '{name}'; there are: {known}");
        }
    }
    let machine = Machine::current();
    let lab = Lab::new(
        arguments.source.isophote()?,
        "ldi",
        arguments.quick,
        arguments.gpu,
    )?;
    let mut sections = Vec::new();
    let mut numbers = Map::new();
    for (name, measure) in SECTIONS {
        if arguments.only.is_empty() || arguments.only.iter().any(|only| only == name) {
            let (section, values) = measure(&lab)?;
            sections.push(section);
            numbers.insert(name.to_owned(), values);
        }
    }
    let page = Page {
        title: TITLE,
        intro: INTRO,
        machine: &machine,
        seconds: lab.seconds(),
        sections: &sections,
    };
    let index = lab.write("index.html", &page.html())?;
    let report = json!({
        "machine": machine,
        "quick": arguments.quick,
        "seconds": lab.seconds(),
        "sections": numbers,
    });
    lab.write("ldi.json", &(serde_json::to_string_pretty(&report)? + "\n"))?;
    println!("{}", index.display());
    Ok(())
}

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

/// A share in percent.
fn percent(share: f64) -> String {
    format!("{:.2} %", 100.0 * share)
}

/// A share in percent, with its sign.
fn signed(share: f64) -> String {
    format!("{:+.2} %", 100.0 * share)
}

fn cells<const N: usize>(texts: [&str; N]) -> Vec<String> {
    texts.map(str::to_owned).into()
}
