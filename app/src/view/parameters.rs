//! A widget for every flag, made of what the command line knows of it.

use std::{any::TypeId, collections::BTreeMap, ffi::OsStr};

use clap::{Arg, ArgAction};
use eframe::egui::{ComboBox, DragValue, Response, RichText, TextEdit, Ui};

use super::flags::Flags;
use crate::applies::Idle;

/// Flags that have other widgets, or none, as they write files or choose what the window is about.
const ELSEWHERE: [&str; 14] = [
    "scene",
    "settings",
    "size",
    "camera",
    "time",
    "moves",
    "exposure",
    "technique",
    "tracer",
    "device",
    "quantity",
    "ldi_save",
    "field_save",
    "help",
];

/// Text that is being typed, by the ids of flags.
pub(super) type Drafts = BTreeMap<String, String>;

/// Draws all groups of flags; returns whether one was changed. An error of the last change goes to `refused`.
pub(super) fn groups(
    ui: &mut Ui,
    flags: &mut Flags,
    idle: &[Idle],
    drafts: &mut Drafts,
    refused: &mut Option<String>,
) -> bool {
    let mut groups: Vec<(String, Vec<Arg>)> = Vec::new();
    for arg in flags.arguments() {
        if ELSEWHERE.contains(&arg.get_id().as_str()) {
            continue;
        }
        let heading = arg.get_help_heading().unwrap_or("Picture");
        match groups.iter_mut().find(|(name, _)| name == heading) {
            Some((_, args)) => args.push(arg.clone()),
            None => groups.push((heading.to_owned(), vec![arg.clone()])),
        }
    }
    let mut changed = false;
    for (heading, args) in groups {
        let is_idle = |arg: &Arg| why(idle, arg).is_some();
        let all_idle = args.iter().all(is_idle);
        let title = if all_idle {
            RichText::new(&heading).weak()
        } else {
            RichText::new(&heading)
        };
        ui.collapsing(title, |ui| {
            for arg in &args {
                changed |= parameter(ui, arg, flags, why(idle, arg), drafts, refused);
            }
        });
    }
    changed
}

fn why<'a>(idle: &'a [Idle], arg: &Arg) -> Option<&'a str> {
    let found = idle.iter().find(|idle| idle.id == arg.get_id().as_str());
    found.map(|idle| idle.why.as_str())
}

fn parameter(
    ui: &mut Ui,
    arg: &Arg,
    flags: &mut Flags,
    idle: Option<&str>,
    drafts: &mut Drafts,
    refused: &mut Option<String>,
) -> bool {
    let id = arg.get_id().as_str();
    let name = arg.get_long().unwrap_or(id);
    let old = flags.get(id);
    let row = ui.horizontal(|ui| {
        let label = ui.add_enabled(idle.is_none(), eframe::egui::Label::new(name));
        match idle {
            Some(why) => label.on_disabled_hover_text(format!("no effect: {why}")),
            None => label.on_hover_text(help(arg)),
        };
        let inner = ui.add_enabled_ui(idle.is_none(), |ui| widget(ui, arg, &old, drafts));
        inner.inner
    });
    let Some(new) = row.inner.filter(|new| *new != old) else {
        return false;
    };
    let other = flags.with(id, new);
    match other.check() {
        Ok(()) => {
            *flags = other;
            *refused = None;
            true
        }
        Err(error) => {
            *refused = Some(error.to_string());
            drafts.remove(id);
            false
        }
    }
}

/// The values after what the user did with the widget of a flag, if anything.
fn widget(ui: &mut Ui, arg: &Arg, old: &[String], drafts: &mut Drafts) -> Option<Vec<String>> {
    let id = arg.get_id().as_str();
    if let ArgAction::SetTrue = arg.get_action() {
        let mut on = old.first().is_some_and(|text| text == "true");
        let clicked = ui.checkbox(&mut on, "").changed();
        return clicked.then(|| if on { vec!["true".into()] } else { Vec::new() });
    }
    let choices = arg.get_possible_values();
    if !choices.is_empty() {
        let mut chosen = old.first().cloned().unwrap_or_default();
        ComboBox::from_id_salt(id)
            .selected_text(&chosen)
            .show_ui(ui, |ui| {
                for choice in &choices {
                    let name = choice.get_name().to_owned();
                    let help = choice
                        .get_help()
                        .map(ToString::to_string)
                        .unwrap_or_default();
                    ui.selectable_value(&mut chosen, name.clone(), name)
                        .on_hover_text(help);
                }
            });
        return (!chosen.is_empty()).then(|| vec![chosen]);
    }
    let kind = arg.get_value_parser().type_id();
    let is_whole = [
        TypeId::of::<u32>(),
        TypeId::of::<u64>(),
        TypeId::of::<usize>(),
    ]
    .iter()
    .any(|of| kind == *of);
    let number = old.first().and_then(|text| text.parse::<f64>().ok());
    match number {
        Some(number) if is_whole || kind == TypeId::of::<f32>() => {
            drag(ui, number, is_whole).map(|text| vec![text])
        }
        _ => typed(ui, arg, old, drafts),
    }
}

/// A number that is dragged or typed.
fn drag(ui: &mut Ui, mut number: f64, is_whole: bool) -> Option<String> {
    let speed = if is_whole {
        (0.005 * number.abs()).max(0.1)
    } else {
        (0.01 * number.abs()).clamp(0.002, 10.0)
    };
    let speed = if speed.is_finite() { speed } else { 0.1 };
    let widget = DragValue::new(&mut number).speed(speed);
    let widget = if is_whole {
        widget.fixed_decimals(0)
    } else {
        widget.max_decimals(5)
    };
    // Every number is tried: the flag's own parser knows the range.
    if !ui.add(widget.update_while_editing(false)).changed() {
        return None;
    }
    Some(if is_whole {
        format!("{}", number.round().max(0.0) as u64)
    } else {
        format!("{}", number as f32)
    })
}

/// Text that counts once it is finished; a line for each value of a flag that may be repeated.
fn typed(ui: &mut Ui, arg: &Arg, old: &[String], drafts: &mut Drafts) -> Option<Vec<String>> {
    let id = arg.get_id().as_str();
    let is_many = matches!(arg.get_action(), ArgAction::Append);
    let draft = drafts.entry(id.into()).or_insert_with(|| old.join("\n"));
    let hint = arg.get_value_names().and_then(|names| names.first());
    let hint = hint.map(ToString::to_string).unwrap_or_default();
    let response: Response = if is_many {
        let edit = TextEdit::multiline(draft).desired_rows(1).hint_text(hint);
        ui.add(edit.desired_width(200.0))
    } else {
        ui.add(
            TextEdit::singleline(draft)
                .hint_text(hint)
                .desired_width(120.0),
        )
    };
    if !response.lost_focus() {
        if !response.has_focus() {
            drafts.remove(id);
        }
        return None;
    }
    let text = drafts.remove(id).unwrap_or_default();
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    Some(lines.map(str::to_owned).collect())
}

/// The flag's help, with its default.
pub(super) fn help(arg: &Arg) -> String {
    let text = arg.get_long_help().or(arg.get_help());
    let text = text.map(ToString::to_string).unwrap_or_default();
    let defaults: Vec<_> = arg
        .get_default_values()
        .iter()
        .map(|text| OsStr::to_string_lossy(text))
        .collect();
    if defaults.is_empty() {
        text
    } else {
        format!("{text} [default: {}]", defaults.join(","))
    }
}
