//! Which technique goes with which tracer where, and why the others do not.

use anyhow::{Result, bail};
use clap::ValueEnum;
use isophote_scene::reference::Quantity;

use crate::{
    technique::{Technique, TechniqueArgs, TechniqueChoice},
    tracers::{AnyTracer, Choice, Device, choose},
};

/// A technique, and who answers its rays where.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Pair {
    pub(crate) technique: TechniqueChoice,
    pub(crate) tracer: AnyTracer,
    pub(crate) device: Device,
}

impl Pair {
    /// Every pair, whether it can be or not.
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        let techniques = TechniqueChoice::value_variants().iter();
        techniques.flat_map(|&technique| {
            let tracers = AnyTracer::value_variants().iter();
            tracers.flat_map(move |&tracer| {
                [Device::Cpu, Device::Gpu].map(|device| Self {
                    technique,
                    tracer,
                    device,
                })
            })
        })
    }

    /// The tracer to build.
    ///
    /// # Errors
    /// Why the pair cannot be, in a line.
    pub(crate) fn check(self, args: &TechniqueArgs, quantity: Quantity) -> Result<Choice> {
        let choice = choose(self.device, Some(self.tracer), None)?;
        check(
            self.technique,
            args.chosen(self.technique),
            choice,
            &[quantity],
        )?;
        Ok(choice)
    }
}

/// Refuses a technique that cannot use a tracer, or does not know a quantity.
pub(crate) fn check(
    choice: TechniqueChoice,
    technique: &dyn Technique,
    tracer: Choice,
    quantities: &[Quantity],
) -> Result<()> {
    choice.check(technique, quantities)?;
    if technique.has_own_tracer() && tracer != tracer.exact() {
        bail!(
            "the technique {} answers its rays itself, and asks a tracer only what the camera sees: leave out --tracer",
            choice.name()
        );
    }
    for &quantity in quantities {
        let (needs, answers) = (technique.needs(quantity), tracer.answers());
        if answers < needs {
            bail!(
                "{quantity} by the technique {} needs a tracer that answers {needs:?}, but the secondary tracer, {}, \
                 answers {answers:?}",
                choice.name(),
                tracer.name()
            );
        }
        if let Some(why) = technique.refuses(tracer, quantity) {
            bail!(
                "{quantity} by the technique {} does not go with the tracer {} this way: {why}",
                choice.name(),
                tracer.name()
            );
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Flags {
        #[command(flatten)]
        techniques: TechniqueArgs,
    }

    /// The quantities of a pair, or "no".
    fn cell(args: &TechniqueArgs, pair: Pair) -> String {
        let can_be = |quantity: &&Quantity| pair.check(args, **quantity).is_ok();
        let quantities: Vec<&str> = Quantity::ALL
            .iter()
            .filter(can_be)
            .map(|quantity| quantity.name())
            .collect();
        match quantities.len() {
            0 => "no".to_owned(),
            count if count == Quantity::ALL.len() => "all".to_owned(),
            _ => quantities.join(", "),
        }
    }

    /// The table as the guide has it: a row for every tracer and device, a column for every technique.
    fn table(args: &TechniqueArgs) -> String {
        let techniques = TechniqueChoice::value_variants();
        let names: Vec<String> = techniques.iter().map(|one| one.name()).collect();
        let mut text = format!("| tracer | device | {} |\n", names.join(" | "));
        text += &format!("|---|---|{}\n", "---|".repeat(names.len()));
        for &tracer in AnyTracer::value_variants() {
            for (device, name) in [(Device::Cpu, "cpu"), (Device::Gpu, "gpu")] {
                if !tracer.runs_on(device) {
                    continue;
                }
                let cells = techniques.iter().map(|&technique| {
                    let pair = Pair {
                        technique,
                        tracer,
                        device,
                    };
                    cell(args, pair)
                });
                let cells: Vec<String> = cells.collect();
                text += &format!("| {} | {name} | {} |\n", tracer.name(), cells.join(" | "));
            }
        }
        text
    }

    #[test]
    fn the_guide_has_the_table() {
        let args = Flags::parse_from(["isophote"]).techniques;
        let guide = include_str!("../../docs/pairs.md");
        let table = table(&args);
        assert!(
            guide.contains(&table),
            "docs/pairs.md does not have this table:\n{table}"
        );
    }

    #[test]
    fn every_refusal_says_why_in_a_line() {
        let args = Flags::parse_from(["isophote"]).techniques;
        let mut refused = BTreeSet::new();
        for pair in Pair::all() {
            for quantity in Quantity::ALL {
                if let Err(error) = pair.check(&args, quantity) {
                    refused.insert(error.to_string());
                }
            }
        }
        assert!(refused.len() > 10, "{refused:?}");
        for why in refused {
            let says_what_to_do = ["leave out", "needs"].iter().any(|word| why.contains(word));
            assert!(!why.contains('\n') && says_what_to_do, "{why}");
        }
    }
}
