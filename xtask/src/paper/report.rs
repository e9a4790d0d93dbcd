//! A page and its JSON, section by section.

use anyhow::{Result, bail};
use serde_json::{Map, Value, json};

use super::{
    lab::Lab,
    page::{Page, Section},
};
use crate::machine::Machine;

/// Measures a section; its numbers go into the JSON.
pub(super) type Measure = fn(&Lab) -> Result<(Section, Value)>;

/// What is made of a paper.
pub(super) struct Report {
    /// Of its folder and its JSON.
    pub(super) name: &'static str,
    pub(super) title: &'static str,
    pub(super) intro: &'static str,
    pub(super) sections: &'static [(&'static str, Measure)],
}

impl Report {
    /// Refuses names that no section has.
    pub(super) fn check(&self, only: &[String]) -> Result<()> {
        for name in only {
            if !self.sections.iter().any(|section| section.0 == name) {
                let known: Vec<&str> = self.sections.iter().map(|section| section.0).collect();
                bail!(
                    "there is no section '{name}'; there are: {}",
                    known.join(", ")
                );
            }
        }
        Ok(())
    }

    /// Measures the sections named, or all where none is, and writes the page.
    pub(super) fn write(&self, lab: &Lab, only: &[String]) -> Result<()> {
        let machine = Machine::current();
        let mut sections = Vec::new();
        let mut numbers = Map::new();
        for (name, measure) in self.sections {
            if only.is_empty() || only.iter().any(|only| only == name) {
                let (section, values) = measure(lab)?;
                sections.push(section);
                numbers.insert((*name).to_owned(), values);
            }
        }
        let page = Page {
            title: self.title,
            intro: self.intro,
            machine: &machine,
            seconds: lab.seconds(),
            sections: &sections,
        };
        let index = lab.write("index.html", &page.html())?;
        let report = json!({
            "machine": machine,
            "quick": lab.quick,
            "seconds": lab.seconds(),
            "sections": numbers,
        });
        let json = serde_json::to_string_pretty(&report)? + "\n";
        lab.write(&format!("{}.json", self.name), &json)?;
        println!("{}", index.display());
        Ok(())
    }
}

/// A share in percent, which no line breaks.
pub(super) fn percent(share: f64) -> String {
    format!("{:.2}\u{a0}%", 100.0 * share)
}

/// A share in percent, with its sign.
pub(super) fn signed(share: f64) -> String {
    format!("{:+.2}\u{a0}%", 100.0 * share)
}

pub(super) fn cells<const N: usize>(texts: [&str; N]) -> Vec<String> {
    texts.map(str::to_owned).into()
}
