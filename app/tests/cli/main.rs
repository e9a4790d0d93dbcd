//! The program from outside: what it writes, what it says, and how it refuses.

#![expect(clippy::unwrap_used, reason = "a test's helpers may fail the test")]

mod compare;
mod render;
mod settings;
mod techniques;
mod trace;

use std::{
    fs,
    path::PathBuf,
    process::{Command, Output, Stdio},
};

use assert_cmd::cargo::cargo_bin;
use isophote_scene::Image;
use serde_json::Value;

/// A folder of its own for every test, with the program run inside.
pub(crate) struct Place(tempfile::TempDir);

impl Place {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn put(&self, name: &str, content: impl AsRef<[u8]>) -> &Self {
        fs::write(self.path(name), content).unwrap();
        self
    }

    /// A triangle one metre wide, without camera and light.
    pub(crate) fn put_triangle(&self) -> &Self {
        let corners = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let bytes: Vec<u8> = corners
            .iter()
            .flatten()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        self.put("triangle.bin", bytes)
            .put("triangle.gltf", TRIANGLE)
    }

    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(cargo_bin!("isophote"));
        command
            .args(arguments)
            .current_dir(self.0.path())
            .env_remove("RUST_LOG");
        command
    }

    pub(crate) fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs what must succeed, and returns what it said on standard error.
    pub(crate) fn ok(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(
            output.status.success(),
            "{arguments:?}: {}",
            text(&output.stderr)
        );
        text(&output.stderr)
    }

    pub(crate) fn json(&self, arguments: &[&str]) -> Value {
        let output = self.run(arguments);
        assert!(
            output.status.success(),
            "{arguments:?}: {}",
            text(&output.stderr)
        );
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// Runs what must be refused: code 2, one line that starts with `error:`, nothing on standard output, and an
    /// output that exists stays as it was.
    pub(crate) fn refused(&self, arguments: &[&str], expected: &str) {
        let kept = ["out.exr", "out.png", "out.npy"];
        for name in kept {
            self.put(name, "old");
        }
        let output = self.run(arguments);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        let lines: Vec<_> = said.lines().collect();
        assert!(
            lines.len() == 1 && said.starts_with("error: "),
            "{arguments:?}: {said}"
        );
        assert!(said.contains(expected), "{arguments:?}: {said}");
        assert!(output.stdout.is_empty(), "{arguments:?}");
        for name in kept {
            assert_eq!(fs::read(self.path(name)).unwrap(), b"old", "{arguments:?}");
        }
    }

    pub(crate) fn image(&self, name: &str) -> Image {
        Image::load(self.path(name)).unwrap()
    }
}

pub(crate) const TRIANGLE: &str = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
  "nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
  "materials": [{"name": "Paint"}],
  "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
  "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"uri": "triangle.bin", "byteLength": 36}]}"#;

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A quick render of a built-in scene, with further arguments.
pub(crate) fn quick<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let quick = [
        "render",
        "builtin:cornell",
        "--size",
        "12x8",
        "--spp",
        "4",
        "-q",
    ];
    [&quick[..], more].concat()
}

/// A quick render by the technique ldi, with further arguments.
pub(crate) fn hybrid<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let quick = [
        "render",
        "builtin:cornell",
        "--technique=ldi",
        "--size=12x8",
        "--ldi-cells=2",
        "--ldi-resolution=32",
        "-q",
    ];
    [&quick[..], more].concat()
}

#[test]
fn help_teaches() {
    let place = Place::new();
    let output = place.run(&[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("Usage: isophote"));
    for command in ["render", "trace", "compare", "show", "info"] {
        let output = place.run(&[command, "--help"]);
        assert!(output.status.success());
        let help = text(&output.stdout);
        assert!(
            help.contains("Examples:") && help.contains(&format!("isophote {command} ")),
            "{help}"
        );
    }
    let help = text(&place.run(&["render", "--help"]).stdout);
    for part in [
        "[metres]",
        "[pixels]",
        "lambert",
        "brute-force",
        "builtin:NAME",
        "--settings",
    ] {
        assert!(help.contains(part), "{part}");
    }
    assert!(text(&place.run(&["--version"]).stdout).starts_with("isophote "));
}

#[test]
fn info_tells_what_is_there() {
    let place = Place::new();
    place.put_triangle();
    let report = place.json(&[
        "info",
        "triangle.gltf",
        "--json",
        "--add",
        "builtin:corner@1,2,3:moving",
    ]);
    assert!(
        report["triangles"].as_u64().unwrap() > 1
            && report["moving_instances"].as_u64().unwrap() > 0
    );
    assert_eq!(report["materials"][0]["name"], "Paint");
    assert_eq!(report["cameras"], Value::Array(vec![]));
    assert_eq!(report["environment"]["kind"], "black");
    let said = text(
        &place
            .run(&["info", "triangle.gltf", "--material=Paint=0.25,0.5"])
            .stdout,
    );
    for part in [
        "1 triangles",
        "Paint",
        "metallic 0.25",
        "roughness 0.5",
        "framed automatically",
        "dropped",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    place.refused(&["info", "triangle.gltf", "--material=Gold=1,0"], "Paint");
    place.put("nothing.gltf", r#"{"asset": {"version": "2.0"}}"#);
    place.ok(&["info", "nothing.gltf"]);
}

#[test]
fn a_closed_pipe_is_no_failure() {
    let place = Place::new();
    let mut command = place.command(&["info", "builtin:cornell", "--json"]);
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(
        output.status.success() && output.stderr.is_empty(),
        "{}",
        text(&output.stderr)
    );
}
