//! `cargo xtask paper`: what a paper showed, made again, with its numbers beside ours.
//!
//! Each page is one HTML file with its pictures inside, and the same numbers as JSON beside it. Everything is measured
//! by `isophote` and by the crates' own benches; here it is only put together. A page is a [`Report`], one
//! file a section.

mod field;
mod igi;
mod lab;
mod ldi;
mod ldm;
mod page;
mod plot;
mod report;

use anyhow::{Result, ensure};
use clap::ValueEnum;

use self::{lab::Lab, report::Report};
use crate::isophote::Source;

/// Make a paper's tables and figures again, into target/paper
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Whose
    #[arg(value_enum)]
    paper: Paper,
    /// Small pictures, few rays, coarse maps: a look in minutes
    #[arg(long)]
    quick: bool,
    /// On the fastest GPU too, where a section has something to measure there
    #[arg(long)]
    gpu: bool,
    /// Only these sections of one paper's page
    #[arg(long, value_name = "SECTION[,…]", value_delimiter = ',')]
    only: Vec<String>,
    #[command(flatten)]
    source: Source,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Paper {
    /// NSS10: layered depth images
    Ldi,
    /// AFB15: deterministic layered depth maps
    Ldm,
    /// MS10: instant global illumination
    Igi,
    /// GCP08: displacement fields
    Field,
    /// All four pages, one after the other
    All,
}

impl Paper {
    fn reports(self) -> Vec<&'static Report> {
        match self {
            Self::Ldi => vec![&ldi::REPORT],
            Self::Ldm => vec![&ldm::REPORT],
            Self::Igi => vec![&igi::REPORT],
            Self::Field => vec![&field::REPORT],
            Self::All => vec![&ldi::REPORT, &ldm::REPORT, &igi::REPORT, &field::REPORT],
        }
    }
}

/// Makes the pages.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    ensure!(
        arguments.paper != Paper::All || arguments.only.is_empty(),
        "--only names sections of one page: name its paper instead of 'all'"
    );
    let reports = arguments.paper.reports();
    for report in &reports {
        report.check(&arguments.only)?;
    }
    let isophote = arguments.source.isophote()?;
    for report in reports {
        let lab = Lab::new(&isophote, report.name, arguments.quick, arguments.gpu)?;
        report.write(&lab, &arguments.only)?;
    }
    Ok(())
}
