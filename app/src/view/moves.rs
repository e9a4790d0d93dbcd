//! Lights and objects that are moved by hand, as `--move` takes them.

use glam::Vec3;
use isophote_scene::{LightKind, Scene};

use super::flags::Flags;
use crate::values::{self, Shift};

/// Something that can be moved.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Movable {
    /// As `--move` calls it.
    pub(super) name: String,
    /// Shines from far away, so that only its direction counts.
    pub(super) is_sun: bool,
}

/// All lights and then all objects of a scene, by their names where these tell them from others.
pub(super) fn movables(scene: &Scene) -> Vec<Movable> {
    let lights = scene.lights.iter().map(|light| &light.name[..]);
    let objects = scene.instances.iter().map(|object| &object.name[..]);
    let mut names: Vec<&str> = lights.chain(objects).collect();
    names.sort_unstable();
    let is_own = |name: &str| {
        let first = names.partition_point(|other| *other < name);
        !name.is_empty() && names.get(first + 1) != Some(&name)
    };
    let called = |kind: &str, index: usize, name: &str| match is_own(name) {
        true => name.to_owned(),
        false => format!("{kind}#{index}"),
    };
    let lights = scene
        .lights
        .iter()
        .enumerate()
        .map(|(index, light)| Movable {
            name: called("light", index, &light.name),
            is_sun: light.kind == LightKind::Directional,
        });
    let objects = scene.instances.iter().enumerate();
    let objects = objects.map(|(index, object)| Movable {
        name: called("object", index, &object.name),
        is_sun: false,
    });
    lights.chain(objects).collect()
}

/// By how much something is moved.
pub(super) fn get(flags: &Flags, name: &str) -> Shift {
    let all = flags.get("moves");
    let shifts = all.iter().filter_map(|text| values::shift(text).ok());
    let own = shifts.into_iter().find(|shift| shift.name == name);
    own.unwrap_or(Shift {
        name: name.to_owned(),
        offset: Vec3::ZERO,
        yaw: 0.0,
        pitch: 0.0,
    })
}

/// Moves something by so much.
pub(super) fn set(flags: &mut Flags, shift: &Shift) {
    let mut all = flags.get("moves");
    let is_other = |text: &String| values::shift(text).is_ok_and(|other| other.name != shift.name);
    all.retain(is_other);
    if shift.offset != Vec3::ZERO || shift.yaw != 0.0 || shift.pitch != 0.0 {
        let [x, y, z] = shift.offset.to_array();
        let (yaw, pitch) = (shift.yaw.to_degrees(), shift.pitch.to_degrees());
        all.push(format!("{}={x},{y},{z},{yaw},{pitch}", shift.name));
    }
    flags.set("moves", all);
}

#[cfg(test)]
mod tests {
    use clap::{Args, Command};

    use super::*;
    use crate::picture::PictureArgs;

    #[test]
    fn what_is_moved_by_hand_is_a_flag_of_its_own() {
        let command = PictureArgs::augment_args(Command::new("view"));
        let texts = ["view", "builtin:cornell", "--move", "tall_block=0,1,0"];
        let mut flags = Flags::given(&command.get_matches_from(texts));
        let mut shift = get(&flags, "light#0");
        assert_eq!(
            (shift.offset, shift.yaw, shift.pitch),
            (Vec3::ZERO, 0.0, 0.0)
        );
        (shift.offset, shift.yaw) = (Vec3::new(0.5, 0.0, -0.25), 0.5);
        set(&mut flags, &shift);
        set(&mut flags, &shift);
        assert_eq!(flags.get("moves").len(), 2);
        let found = get(&flags, "light#0");
        assert!((found.yaw - 0.5).abs() < 1e-6 && found.offset == shift.offset);
        assert_eq!(get(&flags, "tall_block").offset, Vec3::Y);
        flags.check().unwrap();
        // Back where it was, it is no flag any more.
        let back = Shift {
            name: "light#0".into(),
            ..get(&flags, "nothing")
        };
        set(&mut flags, &back);
        assert_eq!(flags.get("moves"), ["tall_block=0,1,0"]);
    }
}
