//! `isophote bake`: the right light in the right place, everything else as it was, in one process or several.

#![expect(clippy::unwrap_used, reason = "a test's helpers may fail the test")]

mod corpora;
mod edges;
mod files;
mod shards;
mod validator;

use std::{
    path::PathBuf,
    process::{Command, Output},
};

use assert_cmd::cargo::cargo_bin;
use isophote_scene::Image;
use serde_json::{Value, json};

use crate::files::{Maker, floats, open_share, parts, plate_over_floor};

/// A folder of its own for every test, with the program run inside.
pub(crate) struct Place(tempfile::TempDir);

impl Place {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// With a file in it.
    pub(crate) fn with(name: &str, bytes: impl AsRef<[u8]>) -> Self {
        let place = Self::new();
        std::fs::write(place.path(name), bytes).unwrap();
        place
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(cargo_bin!("isophote"));
        command
            .arg("bake")
            .args(arguments.split_whitespace())
            .current_dir(self.0.path())
            .env_remove("RUST_LOG");
        command
    }

    pub(crate) fn run(&self, arguments: &str) -> Output {
        self.command(arguments).output().unwrap()
    }

    pub(crate) fn ok(&self, arguments: &str) {
        let output = self.run(&format!("{arguments} --quiet"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{arguments}: {said}");
    }

    /// Runs what must be refused in one line, and returns that.
    pub(crate) fn refused(&self, arguments: &str) -> String {
        let output = self.run(&format!("{arguments} --quiet"));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments}: {said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        said
    }

    pub(crate) fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let name = |entry: std::io::Result<std::fs::DirEntry>| entry.unwrap().file_name();
        let mut names: Vec<_> = entries.map(|e| name(e).into_string().unwrap()).collect();
        names.sort();
        names
    }
}

#[test]
fn occlusion_in_vertices_is_that_of_a_plate_over_a_floor() {
    let place = Place::with("a.glb", plate_over_floor().glb());
    for technique in ["reference --samples 1024", "ldm --ldm-maps 2048"] {
        place.ok(&format!(
            "a.glb --attribute _AO --technique {technique} -o b.glb"
        ));
        let (json, bin) = parts(&place.path("b.glb"));
        let attributes = &json["meshes"][0]["primitives"][0]["attributes"];
        let positions = floats(&json, &bin, &attributes["POSITION"]);
        let values = floats(&json, &bin, &attributes["_AO"]);
        assert_eq!(values.len(), 17 * 17);
        for (position, value) in positions.chunks(3).zip(values) {
            let truth = open_share(position[0], position[2]);
            assert!(
                (value - truth).abs() < 0.03,
                "{technique}, {position:?}: {value}, not {truth}"
            );
        }
        validator::check(&place.path("b.glb"));
    }
}

#[test]
fn occlusion_in_texels_is_that_of_a_plate_over_a_floor() {
    let place = Place::with("a.glb", plate_over_floor().glb());
    place.ok("a.glb --to texels --size 64 --samples 256 -o b.glb -o b.exr");
    let map = Image::load(place.path("b.exr")).unwrap();
    let red = map.channel("R").unwrap();
    // A quarter of the atlas is the plate's, and a quarter empty but for the rim.
    let covered: f32 = map.channel("coverage").unwrap().iter().sum();
    assert!((3072.0..3400.0).contains(&covered), "{covered} texels");
    let mut squares = 0.0;
    for y in 0..64 {
        // The floor is the left half.
        for x in 0..32 {
            let at = [(x as f32 + 0.5) / 4.0 - 4.0, (y as f32 + 0.5) / 8.0 - 4.0];
            squares += (red[y * 64 + x] - open_share(at[0], at[1])).powi(2);
        }
    }
    let rms = 255.0 * (squares / (64.0 * 32.0)).sqrt();
    assert!(rms < 2.5, "{rms} grey levels");
    let (json, _) = parts(&place.path("b.glb"));
    let texture = &json["materials"][0]["occlusionTexture"];
    // The coordinates that were there are used.
    assert_eq!(texture["texCoord"], 1);
    assert_eq!(json["accessors"].as_array().unwrap().len(), 10);
    validator::check(&place.path("b.glb"));
}

/// Irradiance under an environment of radiance 1 is π times the occlusion.
#[test]
fn irradiance_is_in_watts_per_square_metre() {
    let place = Place::with("a.glb", plate_over_floor().glb());
    place.ok("a.glb --quantity irradiance.direct --environment 1,1,1 --samples 256 -o b.glb");
    let (json, bin) = parts(&place.path("b.glb"));
    let attributes = &json["meshes"][0]["primitives"][0]["attributes"];
    let positions = floats(&json, &bin, &attributes["POSITION"]);
    let values = floats(&json, &bin, &attributes["_IRRADIANCE"]);
    for (position, value) in positions.chunks(3).zip(values.chunks(3)) {
        let truth = std::f32::consts::PI * open_share(position[0], position[2]);
        assert!(
            (value[0] - truth).abs() < 0.3 && value[0] == value[2],
            "{value:?}, not {truth}"
        );
    }
    // In a lightmap, the texture times its intensity.
    place.ok("a.glb --to texels --quantity irradiance --environment 1,1,1 --size 32 --samples 64 -o c.glb -o c.exr");
    let (json, _) = parts(&place.path("c.glb"));
    let map = &json["materials"][0]["extensions"]["MOZ_lightmap"];
    let brightest = Image::load(place.path("c.exr")).unwrap();
    let brightest = brightest.channels.iter().flat_map(|c| &c.samples);
    let brightest = brightest.copied().fold(0.0, f32::max);
    assert_eq!(map["intensity"].as_f64().unwrap() as f32, brightest);
    assert_eq!(
        json["extensionsUsed"],
        json!(["VENDOR_unknown", "MOZ_lightmap"])
    );
    validator::check(&place.path("b.glb"));
    validator::check(&place.path("c.glb"));
}

/// One bounce by virtual point lights is that of the reference, corners included.
#[test]
fn virtual_lights_light_vertices() {
    let mut maker = matt_plate_over_floor();
    maker.json["extensions"]["KHR_lights_punctual"] =
        json!({ "lights": [{ "type": "point", "intensity": 1000.0 }] });
    maker.add("extensionsUsed", json!("KHR_lights_punctual"));
    let lamp = json!({ "translation": [0.0, 0.5, 0.0], "extensions": { "KHR_lights_punctual": { "light": 0 } } });
    let lamp = maker.add("nodes", lamp);
    let nodes = maker.json["scenes"][0]["nodes"].as_array_mut().unwrap();
    nodes.push(lamp.into());
    let place = Place::with("a.glb", maker.glb());
    let [bias, error] = errors(&place, "indirect", "", "igi --igi-paths 4096");
    println!("bias {bias}, relRMSE {error}");
    assert!(bias.abs() < 0.02 && error < 0.05, "{bias} {error}");
}

/// One bounce by photons is that of the reference, and so is an environment through the maps.
#[test]
fn photons_light_vertices() {
    let place = Place::with("a.glb", matt_plate_over_floor().glb());
    for (kind, bounds) in [("indirect", [0.05, 0.3]), ("direct", [0.01, 0.03])] {
        let [bias, error] = errors(&place, kind, "--environment 1,1,1", "ldm");
        println!("{kind}: bias {bias}, relRMSE {error}");
        assert!(
            bias.abs() < bounds[0] && error < bounds[1],
            "{kind}: {bias} {error}"
        );
    }
}

fn matt_plate_over_floor() -> Maker {
    let mut maker = plate_over_floor();
    // Without one they would be of metal, which reflects no photons.
    let matt = json!({ "pbrMetallicRoughness": { "metallicFactor": 0.0 } });
    let matt = maker.add("materials", matt);
    for mesh in 0..2 {
        maker.json["meshes"][mesh]["primitives"][0]["material"] = matt.into();
    }
    maker
}

/// Bias and relRMSE of a kind of a technique's light at vertices.
fn errors(place: &Place, kind: &str, lights: &str, technique: &str) -> [f32; 2] {
    let bake = format!("a.glb --quantity irradiance.{kind} {lights}");
    let light = |technique: &str| {
        place.ok(&format!("{bake} --technique {technique} -o b.glb"));
        let (json, bin) = parts(&place.path("b.glb"));
        let attributes = |mesh: usize| &json["meshes"][mesh]["primitives"][0]["attributes"];
        let of = |mesh| floats(&json, &bin, &attributes(mesh)["_IRRADIANCE"]);
        [of(0), of(1)].concat()
    };
    let (truth, found) = (light("reference --samples 1024"), light(technique));
    let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
    let squares: Vec<f32> = truth
        .iter()
        .zip(&found)
        .map(|(a, b)| (a - b).powi(2))
        .collect();
    let error = mean(&squares).sqrt() / mean(&truth);
    [mean(&found) / mean(&truth) - 1.0, error]
}

/// Takes away what was added to lists, and compares.
fn assert_kept(before: &Value, mut after: Value) {
    for (name, list) in before.as_object().unwrap() {
        if let Some(list) = list.as_array() {
            after[name].as_array_mut().unwrap().truncate(list.len());
        }
    }
    after["buffers"] = before["buffers"].clone();
    // As text, so that the order of keys counts.
    assert_eq!(after.to_string(), before.to_string());
}

#[test]
fn everything_else_stays_as_it_was() {
    let mut maker = plate_over_floor();
    maker.add(
        "cameras",
        json!({ "type": "perspective", "perspective": { "yfov": 0.7, "znear": 0.1 }, "extras": 1 }),
    );
    maker.add(
        "materials",
        json!({ "name": "m", "extras": { "q": [3, 1, 2] } }),
    );
    maker.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    maker.json["meshes"][1]["primitives"][0]["material"] = 0.into();
    let place = Place::with("a.glb", maker.glb());
    let (before, old_bytes) = parts(&place.path("a.glb"));
    place.ok("a.glb --samples 16 -o v.glb");
    let (mut json, bytes) = parts(&place.path("v.glb"));
    assert_eq!(bytes[..old_bytes.len()], old_bytes);
    assert_eq!(json["buffers"][0]["byteLength"], bytes.len());
    for mesh in 0..2 {
        let attributes = &mut json["meshes"][mesh]["primitives"][0]["attributes"];
        let added = attributes.as_object_mut().unwrap().shift_remove("COLOR_0");
        assert!(added.is_some());
    }
    assert_kept(&before, json);
    place.ok("a.glb --samples 16 --to texels --size 32 -o t.glb");
    let (mut json, bytes) = parts(&place.path("t.glb"));
    assert_eq!(bytes[..old_bytes.len()], old_bytes);
    let material = json["materials"][0].as_object_mut().unwrap();
    assert!(material.shift_remove("occlusionTexture").is_some());
    for name in ["images", "samplers", "textures"] {
        assert!(json.as_object_mut().unwrap().shift_remove(name).is_some());
    }
    assert_kept(&before, json);
}
