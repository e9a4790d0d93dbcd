//! Reads material libraries.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
};

use glam::{Vec2, Vec3};

use super::text::{decode, lines, number, statement, words};
use crate::{Result, load::context::Context};

/// All materials of a scene's libraries, as they are written.
#[derive(Default)]
pub(super) struct Library {
    materials: HashMap<String, Entry>,
}

/// A material as it is written.
#[derive(Clone, Debug, Default)]
pub(super) struct Entry {
    /// The library's file, where textures are searched first.
    pub(super) file: PathBuf,
    /// `Kd`: the diffuse reflectance, taken as linear RGB.
    pub(super) diffuse: Option<Vec3>,
    /// `Ks`: the specular reflectance, taken as linear RGB.
    pub(super) specular: Option<Vec3>,
    /// `Ke`: the emitted radiance.
    pub(super) emissive: Option<Vec3>,
    /// `Ns`: the exponent of Blinn and Phong.
    pub(super) shininess: Option<f32>,
    /// `Ni`: the index of refraction.
    pub(super) ior: Option<f32>,
    /// `Pr`, of the PBR extension.
    pub(super) roughness: Option<f32>,
    /// `Pm`, of the PBR extension.
    pub(super) metallic: Option<f32>,
    /// `map_Kd`.
    pub(super) diffuse_map: Option<Map>,
    /// `map_Ke`.
    pub(super) emissive_map: Option<Map>,
    /// `map_d`.
    pub(super) alpha_map: Option<Map>,
}

/// A texture as it is written.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Map {
    /// The file.
    pub(super) name: String,
    /// `-o`, added to the coordinates.
    pub(super) offset: Vec2,
    /// `-s`, multiplied with the coordinates.
    pub(super) scale: Vec2,
    /// `-clamp on`.
    pub(super) clamp: bool,
}

impl Library {
    /// Reads the libraries of all `mtllib` lines. One that is missing or unreadable is a warning.
    pub(super) fn load(context: &Context<'_>, lines: &[String]) -> Result<Self> {
        let mut library = Self::default();
        for name in lines.iter().flat_map(|line| file_names(context, line)) {
            let Some(path) = context.find(context.path, &name) else {
                context.warn(format!("the material library '{name}' is missing"));
                continue;
            };
            if let Some((bytes, _held)) = context.optional(context.read(&path))? {
                library.read(context, &path, &bytes)?;
            }
        }
        Ok(library)
    }

    /// The material of that name.
    pub(super) fn get(&self, name: &str) -> Option<&Entry> {
        self.materials.get(name)
    }

    fn read(&mut self, context: &Context<'_>, path: &Path, bytes: &[u8]) -> Result<()> {
        let (text, _held) = decode(bytes, context.budget)?;
        let mut name = None;
        let mut entry = Entry::default();
        for line in lines(&text) {
            let Some((keyword, rest)) = statement(&line) else {
                continue;
            };
            if keyword == "newmtl" {
                self.add(name.replace(rest.trim_end().to_owned()), &mut entry);
                let size = 4 * (size_of::<Entry>() + rest.len() + path.as_os_str().len());
                context.budget.claim("the materials", size as u64)?;
                entry.file = path.to_owned();
            } else {
                context.budget.claim("the materials", rest.len() as u64)?;
                entry.set(context, keyword, rest);
            }
        }
        self.add(name, &mut entry);
        Ok(())
    }

    fn add(&mut self, name: Option<String>, entry: &mut Entry) {
        let entry = std::mem::take(entry);
        if let Some(name) = name {
            self.materials.insert(name, entry);
        }
    }
}

impl Entry {
    fn set(&mut self, context: &Context<'_>, keyword: &str, rest: &str) {
        let scalar = || Some(number(rest)).filter(|value| value.is_finite());
        match keyword {
            "Kd" => self.diffuse = color(rest),
            "Ks" => self.specular = color(rest),
            "Ke" => self.emissive = color(rest),
            "Ns" => self.shininess = scalar(),
            "Ni" => self.ior = scalar(),
            "Pr" => self.roughness = scalar(),
            "Pm" => self.metallic = scalar(),
            "map_Kd" => self.diffuse_map = map(rest),
            "map_Ke" => self.emissive_map = map(rest),
            "map_d" => self.alpha_map = map(rest),
            "d" if scalar().is_some_and(|opacity| opacity < 1.0) => translucent(context),
            "Tr" if scalar().is_some_and(|transparency| transparency > 0.0) => translucent(context),
            "bump" | "map_bump" | "map_Bump" | "norm" | "map_Kn" => {
                context.warn("bump and normal maps are ignored");
            }
            "map_Pr" | "map_Pm" | "map_Ns" => {
                context.warn("maps of shininess, roughness and metalness are ignored");
            }
            _ => {}
        }
    }
}

fn translucent(context: &Context<'_>) {
    context.warn("translucent materials are taken as opaque (d, Tr)");
}

/// `r g b`, or one number for all three; `None` for spectra and CIE XYZ.
fn color(rest: &str) -> Option<Vec3> {
    let mut numbers = words(rest).map(number);
    let r = numbers.next()?;
    let color = Vec3::new(r, numbers.next().unwrap_or(r), numbers.next().unwrap_or(r));
    color.is_finite().then_some(color.max(Vec3::ZERO))
}

/// A texture's options and its file name, which may hold spaces and stands last.
fn map(rest: &str) -> Option<Map> {
    let mut map = Map {
        name: String::new(),
        offset: Vec2::ZERO,
        scale: Vec2::ONE,
        clamp: false,
    };
    let mut rest = rest.trim();
    while rest.starts_with('-') {
        let (option, after) = next_word(rest);
        rest = after;
        let most = match option {
            "-o" | "-s" | "-t" => 3,
            "-mm" => 2,
            "-blendu" | "-blendv" | "-bm" | "-boost" | "-cc" | "-clamp" | "-colorspace"
            | "-imfchan" | "-texres" | "-type" => 1,
            _ => 0,
        };
        let mut values = Vec::new();
        while values.len() < most {
            let (value, after) = next_word(rest);
            // The later values of -o, -s and -t may be left out.
            if after.is_empty() || (!values.is_empty() && value.parse::<f32>().is_err()) {
                break;
            }
            values.push(value);
            rest = after;
        }
        map.set(option, &values);
    }
    map.name = unquoted(rest).to_owned();
    (!map.name.is_empty()).then_some(map)
}

impl Map {
    fn set(&mut self, option: &str, values: &[&str]) {
        let vector = |default: f32| {
            let value = |i: usize| values.get(i).map_or(default, |value| number(value));
            let vector = Vec2::new(value(0), value(1));
            if vector.is_finite() {
                vector
            } else {
                Vec2::splat(default)
            }
        };
        match option {
            "-o" => self.offset = vector(0.0),
            "-s" => self.scale = vector(1.0),
            "-clamp" => self.clamp = values.first() == Some(&"on"),
            _ => {}
        }
    }
}

fn next_word(text: &str) -> (&str, &str) {
    let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    (word, rest.trim_start())
}

fn unquoted(name: &str) -> &str {
    let name = name.trim();
    name.strip_prefix('"')
        .and_then(|name| name.strip_suffix('"'))
        .unwrap_or(name)
}

/// The files that a `mtllib` line names: the whole of it if there is such a file, else its words; `\ ` is a space in
/// a name.
fn file_names(context: &Context<'_>, line: &str) -> Vec<String> {
    let whole = unquoted(line);
    if whole.is_empty() {
        return Vec::new();
    }
    if context.find(context.path, whole).is_some() {
        return vec![whole.to_owned()];
    }
    // No file name holds a line break.
    whole
        .replace("\\ ", "\n")
        .split([' ', '\t'])
        .filter(|name| !name.is_empty())
        .map(|name| name.replace('\n', " "))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::budget::Budget;

    fn parsed(rest: &str) -> (String, [f32; 4], bool) {
        let map = map(rest).unwrap();
        let [o, s] = [map.offset, map.scale];
        (map.name, [o.x, o.y, s.x, s.y], map.clamp)
    }

    #[test]
    fn texture_options() {
        let plain = [0.0, 0.0, 1.0, 1.0];
        for (rest, name, numbers, clamp) in [
            ("a b.png", "a b.png", plain, false),
            ("\"a b.png\" ", "a b.png", plain, false),
            ("-o 0.1 a.png", "a.png", [0.1, 0.0, 1.0, 1.0], false),
            ("-s 2 3 4 5 a.png", "5 a.png", [0.0, 0.0, 2.0, 3.0], false),
            ("-o 1 2 -s 3 4 a.png", "a.png", [1.0, 2.0, 3.0, 4.0], false),
            ("-clamp on -bm 3 a.png", "a.png", plain, true),
            ("-colorspace sRGB -mm 0 1 a.png", "a.png", plain, false),
            ("-o 1", "1", plain, false),
            ("-unknown a.png", "a.png", plain, false),
        ] {
            assert_eq!(parsed(rest), (name.into(), numbers, clamp), "{rest}");
        }
        assert_eq!(map("-clamp"), None);
        assert_eq!(map(""), None);
    }

    #[test]
    fn library_names() {
        let budget = Budget::new(Path::new(""), 0);
        let context = Context::new(Path::new("none/a.obj"), &budget);
        let names = |line| file_names(&context, line);
        assert_eq!(names("a.mtl  b\\ c.mtl"), ["a.mtl", "b c.mtl"]);
        assert_eq!(names("\"b.mtl\""), ["b.mtl"]);
        assert_eq!(names(""), [""; 0]);
    }
}
