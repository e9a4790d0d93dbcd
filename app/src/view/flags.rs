//! What can be set of a picture, as texts by the names of the flags of `isophote render`.
//!
//! The command line's own definition is the only list of what there is: the panel is drawn from it, every change goes
//! through its parsers, and what a header stores can be rendered again by `isophote render --settings`.

use std::{collections::BTreeMap, sync::Arc};

use anyhow::{Result, anyhow};
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches, parser::ValueSource};

use crate::{
    applies::{Idle, ids},
    picture::PictureArgs,
    scene_args::SceneArgs,
    settings, told,
    tracers::{Choice, TracerArgs},
};

/// Texts by the ids of flags.
pub(super) type Values = BTreeMap<String, Vec<String>>;

/// The flags that differ from their defaults.
#[derive(Clone)]
pub(super) struct Flags {
    command: Arc<Command>,
    values: Values,
}

/// A picture that can be made.
pub(super) struct Wish {
    pub(super) args: PictureArgs,
    pub(super) choice: Choice,
    /// As they stand in headers.
    pub(super) stored: BTreeMap<String, String>,
    values: Values,
}

impl Flags {
    /// The flags on the command line.
    pub(super) fn given(matches: &ArgMatches) -> Self {
        let command = PictureArgs::augment_args(Command::new("view"));
        let mut values = Values::new();
        for arg in command.get_arguments() {
            let id = arg.get_id().as_str();
            if matches.value_source(id) == Some(ValueSource::CommandLine)
                && let Some(raw) = matches.get_raw(id)
            {
                let texts = raw.map(|text| text.to_string_lossy().into_owned());
                values.insert(id.into(), texts.collect());
            }
        }
        // A window shows one quantity.
        if let Some(quantities) = values.get_mut("quantity") {
            quantities.truncate(1);
        }
        values.remove("settings");
        Self {
            command: Arc::new(command),
            values,
        }
    }

    pub(super) fn arguments(&self) -> impl Iterator<Item = &Arg> {
        self.command.get_arguments()
    }

    /// The values of a flag, by default those of the command line; none where it has none.
    pub(super) fn get(&self, id: &str) -> Vec<String> {
        if let Some(values) = self.values.get(id) {
            return values.clone();
        }
        self.default(id)
    }

    /// The one value of a flag.
    pub(super) fn one(&self, id: &str) -> Option<String> {
        self.get(id).into_iter().next()
    }

    fn default(&self, id: &str) -> Vec<String> {
        let arg = self.command.get_arguments().find(|arg| arg.get_id() == id);
        let defaults = arg.into_iter().flat_map(Arg::get_default_values);
        defaults
            .map(|text| text.to_string_lossy().into_owned())
            .collect()
    }

    pub(super) fn is_default(&self, id: &str) -> bool {
        !self.values.contains_key(id)
    }

    pub(super) fn set(&mut self, id: &str, values: Vec<String>) {
        if values == self.default(id) {
            self.values.remove(id);
        } else {
            self.values.insert(id.into(), values);
        }
    }

    pub(super) fn set_one(&mut self, id: &str, value: impl Into<String>) {
        self.set(id, vec![value.into()]);
    }

    /// Whether all flags are the same.
    pub(super) fn is_as(&self, other: &Self) -> bool {
        self.values == other.values
    }

    /// The same with one flag changed.
    pub(super) fn with(&self, id: &str, values: Vec<String>) -> Self {
        let mut other = self.clone();
        other.set(id, values);
        other
    }

    /// Refuses values that the flag's own parser refuses.
    pub(super) fn check(&self) -> Result<()> {
        self.parse(&[]).map(drop)
    }

    /// Flags without effect beside the others.
    pub(super) fn idle(&self) -> Result<Vec<Idle>> {
        Ok(self.args(&[])?.idle())
    }

    /// The picture that is asked for.
    ///
    /// # Errors
    /// Why it cannot be made, in a line.
    pub(super) fn wish(&self) -> Result<Wish> {
        // What has no effect does not hinder either.
        let idle = self.idle()?;
        let args = self.args(&idle)?;
        args.check()?;
        Ok(Wish {
            choice: args.choice()?,
            args,
            stored: settings::store(&self.command, &self.parse(&idle)?, &idle),
            values: self.values.clone(),
        })
    }

    fn args(&self, idle: &[Idle]) -> Result<PictureArgs> {
        Ok(PictureArgs::from_arg_matches(&self.parse(idle)?)?)
    }

    fn parse(&self, idle: &[Idle]) -> Result<ArgMatches> {
        let mut texts = vec!["view".to_owned()];
        for arg in self.arguments() {
            let id = arg.get_id().as_str();
            let Some(values) = self.values.get(id) else {
                continue;
            };
            if idle.iter().any(|idle| idle.id == id) {
                continue;
            }
            match (arg.get_long(), arg.get_action()) {
                (None, _) => texts.extend(values.iter().cloned()),
                (Some(name), ArgAction::SetTrue) => texts.push(format!("--{name}")),
                (Some(name), _) => {
                    texts.extend(values.iter().map(|value| format!("--{name}={value}")));
                }
            }
        }
        let parsed = Command::clone(&self.command).try_get_matches_from(texts);
        parsed.map_err(|error| anyhow!("{}", told(&error)))
    }
}

/// What moves things without loading the scene again.
const MOVING: [&str; 2] = ["time", "moves"];

impl Wish {
    /// What the loaded scene depends on.
    pub(super) fn of_scene(&self) -> Values {
        let mut ids = ids::<SceneArgs>();
        ids.retain(|id| !MOVING.contains(&id.as_str()));
        ids.push("scene".into());
        self.only(ids)
    }

    /// What places of things and the camera depend on.
    pub(super) fn of_shot(&self) -> Values {
        let mut ids = ids::<SceneArgs>();
        ids.extend(["scene", "camera"].map(String::from));
        self.only(ids)
    }

    /// What a tracer depends on.
    pub(super) fn of_tracer(&self, choice: Choice) -> Values {
        let mut ids = ids::<SceneArgs>();
        ids.extend(crate::applies::ids::<TracerArgs>());
        ids.extend(["scene", "adapter"].map(String::from));
        if self.args.tracer_args.depends_on_camera() {
            ids.push("camera".into());
        }
        let mut values = self.only(ids);
        values.insert("choice".into(), vec![format!("{choice:?}")]);
        values
    }

    /// What the right answer depends on.
    pub(super) fn of_reference(&self) -> Values {
        let others = [
            "scene",
            "camera",
            "device",
            "adapter",
            "quantity",
            "size",
            "d_max",
            "materials",
            "normals",
        ];
        let scene = ids::<SceneArgs>().into_iter();
        let mut values = self.only(scene.chain(others.map(String::from)));
        let exact = format!("{:?}", self.choice.exact());
        values.insert("choice".into(), vec![exact]);
        values.insert("bounces".into(), vec![self.path_bounces().to_string()]);
        values
    }

    /// How many surfaces paths of light meet: as many as those of the technique, so that like is compared with like.
    pub(super) fn path_bounces(&self) -> u32 {
        self.args
            .chosen()
            .path_bounces()
            .unwrap_or(self.args.path_bounces)
    }

    fn only(&self, ids: impl IntoIterator<Item = String>) -> Values {
        let values = ids.into_iter();
        values
            .filter_map(|id| Some((id.clone(), self.values.get(&id)?.clone())))
            .collect()
    }
}
