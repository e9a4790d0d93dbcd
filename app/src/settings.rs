//! Settings in file headers: every flag of a command by its name, and flags again from a header.
//!
//! Both directions go through the command's own definition, so a new flag is stored and repeated without a word here.

use std::{collections::BTreeMap, ffi::OsString};

use clap::{Arg, ArgAction, ArgMatches, Command, parser::ValueSource};

use crate::applies::Idle;

/// Flags that say where results go and how fast, not what is in them.
const NOT_SETTINGS: [&str; 14] = [
    "output",
    "settings",
    "quiet",
    "json",
    "threads",
    "device",
    "adapter",
    "ldi_save",
    "ldi_load",
    "field_save",
    "field_load",
    "shard",
    "merge",
    "help",
];

/// Values are divided by this in a header where a flag may be repeated.
const DIVIDER: char = '\n';

fn settings(command: &Command) -> impl Iterator<Item = &Arg> {
    command
        .get_arguments()
        .filter(|arg| !NOT_SETTINGS.contains(&arg.get_id().as_str()))
}

fn name(arg: &Arg) -> &str {
    arg.get_long().unwrap_or_else(|| arg.get_id().as_str())
}

/// Every setting with its value, given or by default, but for those without effect.
pub(crate) fn store(
    command: &Command,
    matches: &ArgMatches,
    idle: &[Idle],
) -> BTreeMap<String, String> {
    settings(command)
        .filter(|arg| !is_idle(arg, idle))
        .filter_map(|arg| {
            let values = matches.try_get_raw(arg.get_id().as_str()).ok()??;
            let divider = arg.get_value_delimiter().unwrap_or(DIVIDER).to_string();
            let values: Vec<_> = values.map(|value| value.to_string_lossy()).collect();
            Some((name(arg).to_owned(), values.join(&divider)))
        })
        .collect()
}

fn is_idle(arg: &Arg, idle: &[Idle]) -> bool {
    idle.iter().any(|idle| idle.id == arg.get_id().as_str())
}

/// Arguments that repeat stored settings, without those given on the command line and those without effect.
pub(crate) fn repeat(
    command: &Command,
    given: &ArgMatches,
    stored: &BTreeMap<String, String>,
    idle: &[Idle],
) -> Vec<OsString> {
    let mut arguments = Vec::new();
    for arg in settings(command).filter(|arg| !is_idle(arg, idle)) {
        let (name, id) = (name(arg), arg.get_id().as_str());
        let Some(value) = stored.get(name) else {
            continue;
        };
        if given.value_source(id) == Some(ValueSource::CommandLine) {
            continue;
        }
        match arg.get_action() {
            ArgAction::SetTrue if value == "true" => arguments.push(format!("--{name}").into()),
            ArgAction::SetTrue => {}
            _ if arg.is_positional() => arguments.push(value.into()),
            ArgAction::Append if arg.get_value_delimiter().is_none() => {
                let flags = value.split(DIVIDER).map(|part| format!("--{name}={part}"));
                arguments.extend(flags.map(OsString::from));
            }
            _ => arguments.push(format!("--{name}={value}").into()),
        }
    }
    arguments
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command() -> Command {
        Command::new("x")
            .arg(Arg::new("scene"))
            .arg(Arg::new("size").long("size").default_value("1x1"))
            .arg(Arg::new("list").long("list").value_delimiter(','))
            .arg(Arg::new("many").long("many").action(ArgAction::Append))
            .arg(Arg::new("flag").long("flag").action(ArgAction::SetTrue))
            .arg(Arg::new("output").long("output"))
    }

    fn parse(arguments: &[&str]) -> ArgMatches {
        command().get_matches_from([&["x"], arguments].concat())
    }

    #[test]
    fn what_is_stored_is_repeated() {
        let given = [
            "a.glb",
            "--list=a,b",
            "--many=1=2",
            "--many=3",
            "--flag",
            "--output=o",
        ];
        let stored = store(&command(), &parse(&given), &[]);
        assert_eq!(stored["scene"], "a.glb");
        assert_eq!(stored["size"], "1x1");
        assert_eq!(stored["list"], "a,b");
        assert!(!stored.contains_key("output"));
        let repeated = repeat(&command(), &parse(&[]), &stored, &[]);
        let expected = [
            "a.glb",
            "--size=1x1",
            "--list=a,b",
            "--many=1=2",
            "--many=3",
            "--flag",
        ];
        assert_eq!(repeated, expected);
    }

    #[test]
    fn what_has_no_effect_is_left_out() {
        let idle: Vec<Idle> = Idle::all(["size"], "").collect();
        let matches = parse(&["a.glb", "--size=9x9"]);
        assert!(!store(&command(), &matches, &idle).contains_key("size"));
        let stored = store(&command(), &matches, &[]);
        assert_eq!(repeat(&command(), &parse(&[]), &stored, &idle), ["a.glb"]);
    }

    #[test]
    fn the_command_line_wins() {
        let stored = store(
            &command(),
            &parse(&["a.glb", "--many=1", "--size=9x9"]),
            &[],
        );
        let repeated = repeat(&command(), &parse(&["b.glb", "--many=2"]), &stored, &[]);
        assert_eq!(repeated, ["--size=9x9"]);
    }
}
