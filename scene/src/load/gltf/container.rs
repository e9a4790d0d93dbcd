//! Finds the JSON and the binary chunk of a file and reads the JSON (glTF 2.0 §4, "GLB File Format").

use std::{ops::Range, path::Path};

use gltf_json::{Root, Value};

use crate::{
    Error, Result,
    load::budget::{Borrowed, Budget},
};

/// How a `.glb` begins.
pub(super) const MAGIC: &[u8] = b"glTF";
const JSON_CHUNK: u32 = 0x4E4F_534A;
const BIN_CHUNK: u32 = 0x004E_4942;

/// Where the parts of a file are.
#[derive(Debug, PartialEq)]
pub(super) struct Parts {
    pub(super) json: Range<usize>,
    /// The binary chunk of a `.glb`, which is buffer 0.
    pub(super) bin: Option<Range<usize>>,
    /// Kinds and places of other chunks.
    pub(super) others: Vec<(u32, Range<usize>)>,
}

/// Tells a binary file from a text by its first bytes, not by its name, and finds its parts.
pub(super) fn split(path: &Path, bytes: &[u8]) -> Result<Parts> {
    if !bytes.starts_with(MAGIC) {
        return Ok(Parts {
            json: 0..bytes.len(),
            bin: None,
            others: Vec::new(),
        });
    }
    let cut = || Error::malformed(path, "the file is cut off within its header");
    let version = word(bytes, 4).ok_or_else(cut)?;
    if version != 2 {
        return Err(unsupported_version(path, &version.to_string()));
    }
    let length = word(bytes, 8).ok_or_else(cut)? as usize;
    if length > bytes.len() {
        let found = bytes.len();
        return Err(Error::malformed(
            path,
            format!("is cut off: its header says {length} bytes, but there are {found}"),
        ));
    }
    let (mut json, mut bin, mut others) = (None, None, Vec::new());
    let mut at = 12;
    while at < length {
        let header = word(bytes, at).zip(word(bytes, at + 4));
        let (size, kind) = header.ok_or_else(cut)?;
        let chunk = at + 8..at + 8 + size as usize;
        if chunk.end > length {
            return Err(Error::malformed(
                path,
                format!("the chunk at byte {at} says {size} bytes, more than the file has"),
            ));
        }
        at = chunk.end;
        match kind {
            JSON_CHUNK if json.is_none() => json = Some(chunk),
            BIN_CHUNK if bin.is_none() => bin = Some(chunk),
            // Chunks of other kinds are for extensions and may be skipped.
            _ => others.push((kind, chunk)),
        }
    }
    let json = json.ok_or_else(|| Error::malformed(path, "has no JSON chunk"))?;
    Ok(Parts { json, bin, others })
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let bytes = bytes.get(at..at.checked_add(4)?)?;
    bytes.try_into().ok().map(u32::from_le_bytes)
}

/// Reads the JSON into the data model of glTF 2.0.
pub(super) fn parse<'a>(
    path: &Path,
    json: &[u8],
    budget: &'a Budget<'_>,
) -> Result<(Root, Borrowed<'a>)> {
    let (mut value, borrowed) = read(path, json, budget)?;
    check_version(path, &value)?;
    tidy_numbers(&mut value);
    tidy_omissions(&mut value);
    let root = serde_json::from_value(value).map_err(|error| not_json(path, &error))?;
    Ok((root, borrowed))
}

/// Reads the JSON as it is.
pub(super) fn read<'a>(
    path: &Path,
    json: &[u8],
    budget: &'a Budget<'_>,
) -> Result<(Value, Borrowed<'a>)> {
    let borrowed = budget.borrow("the JSON", json_memory(json))?;
    // A byte order mark is wrong here, but harmless.
    let json = json.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(json);
    let value = serde_json::from_slice(json).map_err(|error| not_json(path, &error))?;
    Ok((value, borrowed))
}

fn not_json(path: &Path, error: &serde_json::Error) -> Error {
    Error::malformed(path, format!("is not valid glTF: {error}"))
}

/// An upper estimate of the memory that a JSON text takes as values: short texts can stand for large ones.
fn json_memory(json: &[u8]) -> u64 {
    // A map's first entry allocates a tree node of about 700 bytes; an empty object can be a material or a node.
    const OBJECT: u64 = 2200;
    const ITEM: u64 = 160;
    let (mut memory, mut in_string, mut escaped) = (2 * json.len() as u64, false, false);
    for &byte in json {
        match byte {
            _ if escaped => escaped = false,
            b'\\' if in_string => escaped = true,
            b'"' => in_string = !in_string,
            _ if in_string => {}
            b'{' => memory += OBJECT,
            b'[' | b',' => memory += ITEM,
            _ => {}
        }
    }
    memory
}

fn check_version(path: &Path, value: &Value) -> Result<()> {
    if !value.is_object() {
        return Err(Error::malformed(
            path,
            "is not glTF: the JSON is not an object",
        ));
    }
    let version = |key: &str| value.get("asset")?.get(key)?.as_str();
    match version("minVersion").or(version("version")) {
        Some(version) if version == "2" || version.starts_with("2.") => Ok(()),
        Some(version) => Err(unsupported_version(path, version)),
        None => Err(Error::malformed(
            path,
            "is not glTF 2.0: asset.version is missing",
        )),
    }
}

fn unsupported_version(path: &Path, version: &str) -> Error {
    Error::Unsupported {
        path: path.to_owned(),
        feature: format!("glTF version {version}"),
        remedy: "convert it to glTF 2.0".into(),
    }
}

/// JSON does not tell `1` from `1.0`, the data model does; and it cuts indices off after 32 bits.
fn tidy_numbers(value: &mut Value) {
    match value {
        Value::Number(number) => {
            if let Some(float) = number.as_f64() {
                let is_index = float.fract() == 0.0 && float.abs() <= f64::from(u32::MAX);
                if is_index && number.is_f64() {
                    *value = Value::from(float as i64);
                } else if !is_index && !number.is_f64() {
                    *value = Value::from(float);
                }
            }
        }
        Value::Array(values) => values.iter_mut().for_each(tidy_numbers),
        Value::Object(entries) => entries.values_mut().for_each(tidy_numbers),
        _ => {}
    }
}

/// Adds or removes what the specification lets a file leave out, but the data model does not.
fn tidy_omissions(value: &mut Value) {
    fn each<'a>(value: &'a mut Value, key: &str) -> impl Iterator<Item = &'a mut Value> {
        let list = value.get_mut(key).and_then(Value::as_array_mut);
        list.into_iter().flatten()
    }
    for scene in each(value, "scenes") {
        if let Some(scene) = scene.as_object_mut() {
            scene.entry("nodes").or_insert_with(|| Value::Array(vec![]));
        }
    }
    // A channel without a node belongs to an extension.
    for animation in each(value, "animations") {
        if let Some(channels) = animation.get_mut("channels").and_then(Value::as_array_mut) {
            channels.retain(|channel| {
                channel
                    .get("target")
                    .is_none_or(|target| target.get("node").is_some())
            });
        }
    }
}
