//! Builds small glTF files.

use base64::{Engine, engine::general_purpose::STANDARD};
use serde_json::{Value, json};

use super::Files;

/// A file in the making: its JSON, and buffer 0.
#[derive(Clone)]
pub(crate) struct Gltf {
    pub(crate) json: Value,
    pub(crate) buffer: Vec<u8>,
}

pub(crate) const BYTE: u32 = 5120;
pub(crate) const UNSIGNED_BYTE: u32 = 5121;
pub(crate) const SHORT: u32 = 5122;
pub(crate) const UNSIGNED_SHORT: u32 = 5123;
pub(crate) const UNSIGNED_INT: u32 = 5125;
pub(crate) const FLOAT: u32 = 5126;

/// The corners of a unit square in the plane z = 0.
pub(crate) const SQUARE: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 0.0],
];

pub(crate) fn bytes_of<T: bytemuck::NoUninit>(values: &[T]) -> Vec<u8> {
    bytemuck::cast_slice(values).to_vec()
}

impl Gltf {
    pub(crate) fn new() -> Self {
        let json = json!({ "asset": { "version": "2.0" } });
        Self {
            json,
            buffer: Vec::new(),
        }
    }

    /// Adds an item to a list at the top and returns its index.
    pub(crate) fn add(&mut self, list: &str, item: Value) -> usize {
        let root = self.json.as_object_mut().unwrap();
        let list = root.entry(list).or_insert_with(|| json!([]));
        let list = list.as_array_mut().unwrap();
        list.push(item);
        list.len() - 1
    }

    /// Adds bytes to the buffer and a view of them.
    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        while !self.buffer.len().is_multiple_of(4) {
            self.buffer.push(0);
        }
        let offset = self.buffer.len();
        self.buffer.extend_from_slice(bytes);
        let view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() });
        self.add("bufferViews", view)
    }

    /// Adds an accessor of tightly packed elements; the count follows from the sizes.
    pub(crate) fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str) -> usize {
        let components = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            _ => 4,
        };
        let size = components
            * match component {
                BYTE | UNSIGNED_BYTE => 1,
                SHORT | UNSIGNED_SHORT => 2,
                _ => 4,
            };
        let view = self.view(bytes);
        self.add(
            "accessors",
            json!({
                "bufferView": view, "componentType": component, "type": kind, "count": bytes.len() / size
            }),
        )
    }

    pub(crate) fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][N];
        self.accessor(&bytes_of(values.as_flattened()), FLOAT, kind)
    }

    pub(crate) fn indices(&mut self, values: &[u16]) -> usize {
        self.accessor(&bytes_of(values), UNSIGNED_SHORT, "SCALAR")
    }

    /// Sets a property of an item of a list at the top.
    pub(crate) fn set(&mut self, list: &str, index: usize, key: &str, value: Value) {
        self.json[list][index][key] = value;
    }

    /// Adds a mesh of these primitives, a node that shows it, and the node to the scene.
    pub(crate) fn show(&mut self, primitives: Value) -> usize {
        let mesh = self.add("meshes", json!({ "primitives": primitives }));
        self.node(json!({ "mesh": mesh }))
    }

    /// Adds a node to the scene.
    pub(crate) fn node(&mut self, node: Value) -> usize {
        let node = self.add("nodes", node);
        if self.json.get("scenes").is_none() {
            self.json["scene"] = json!(0);
            self.json["scenes"] = json!([{ "nodes": [] }]);
        }
        let nodes = self.json["scenes"][0]["nodes"].as_array_mut().unwrap();
        nodes.push(json!(node));
        node
    }

    /// Adds a square of two triangles with a node that shows it.
    pub(crate) fn square(&mut self) -> usize {
        let positions = self.floats(&SQUARE);
        let indices = self.indices(&[0, 1, 2, 0, 2, 3]);
        self.show(json!([{ "attributes": { "POSITION": positions }, "indices": indices }]))
    }

    fn with_buffer(&self, uri: Option<String>) -> String {
        let mut json = self.json.clone();
        if !self.buffer.is_empty() {
            let mut buffer = json!({ "byteLength": self.buffer.len() });
            if let Some(uri) = uri {
                buffer["uri"] = json!(uri);
            }
            json["buffers"] = json!([buffer]);
        }
        json.to_string()
    }

    /// As a `.glb`.
    pub(crate) fn glb(&self) -> Files {
        Files::one(
            "scene.glb",
            glb(self.with_buffer(None).as_bytes(), &self.buffer),
        )
    }

    /// As a `.gltf` with its buffer within.
    pub(crate) fn embedded(&self) -> Files {
        let uri = format!(
            "data:application/octet-stream;base64,{}",
            STANDARD.encode(&self.buffer)
        );
        Files::one("scene.gltf", self.with_buffer(Some(uri)))
    }

    /// As a `.gltf` with its buffer in a file beside it, whose name needs escaping.
    pub(crate) fn external(&self) -> Files {
        let json = self.with_buffer(Some("buffer%201.bin".into()));
        Files::one("scene.gltf", json).and("buffer 1.bin", self.buffer.clone())
    }
}

/// Puts JSON and a binary chunk into one file.
pub(crate) fn glb(json: &[u8], buffer: &[u8]) -> Vec<u8> {
    let mut chunks = Vec::new();
    for (kind, padding, content) in [(b"JSON", b' ', json), (b"BIN\0", 0, buffer)] {
        let padded = content.len().next_multiple_of(4);
        chunks.extend_from_slice(&(padded as u32).to_le_bytes());
        chunks.extend_from_slice(kind);
        chunks.extend_from_slice(content);
        chunks.resize(chunks.len() + padded - content.len(), padding);
    }
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend_from_slice(&(12 + chunks.len() as u32).to_le_bytes());
    file.extend_from_slice(&chunks);
    file
}
