//! glTF files made for tests, and files that were written, taken apart.

use std::path::Path;

use serde_json::{Value, json};

/// A file in the making: JSON and a binary chunk.
pub(crate) struct Maker {
    pub(crate) json: Value,
    pub(crate) bin: Vec<u8>,
}

impl Maker {
    /// A file with nothing in it but what nobody may touch.
    pub(crate) fn new() -> Self {
        let json = json!({
            "extras": { "z": 1, "a": [1.0, 0.1, 1e-30, 12345678901234u64, -0.25], "ü": null },
            "asset": { "version": "2.0", "generator": "a test" },
            "extensionsUsed": ["VENDOR_unknown"],
            "extensions": { "VENDOR_unknown": { "b": 2, "a": 1 } },
            "scene": 0,
            "scenes": [{ "nodes": [] }],
            "nodes": [], "meshes": [], "accessors": [], "bufferViews": [],
            "buffers": [{ "byteLength": 0, "name": "the buffer" }],
        });
        Self {
            json,
            bin: Vec::new(),
        }
    }

    pub(crate) fn list(&mut self, name: &str) -> &mut Vec<Value> {
        let root = self.json.as_object_mut().unwrap();
        let list = root.entry(name).or_insert_with(|| json!([]));
        list.as_array_mut().unwrap()
    }

    pub(crate) fn add(&mut self, name: &str, item: Value) -> usize {
        self.list(name).push(item);
        self.list(name).len() - 1
    }

    pub(crate) fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view =
            json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.bin.extend_from_slice(bytes);
        self.add("bufferViews", view)
    }

    pub(crate) fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let flat = values.as_flattened();
        let bytes: Vec<u8> = flat.iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(34962));
        let bound = |fold: fn(f32, f32) -> f32| -> Vec<f32> {
            let column = |i: usize| values.iter().map(|v| v[i]).reduce(fold).unwrap();
            (0..N).map(column).collect()
        };
        let (min, max) = (bound(f32::min), bound(f32::max));
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][N];
        self.add(
            "accessors",
            json!({ "bufferView": view, "componentType": 5126, "count": values.len(), "type": kind, "min": min, "max": max }),
        )
    }

    pub(crate) fn indices(&mut self, indices: &[u16]) -> usize {
        let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(34963));
        self.add(
            "accessors",
            json!({ "bufferView": view, "componentType": 5123, "count": indices.len(), "type": "SCALAR" }),
        )
    }

    /// A horizontal grid of `n` × `n` squares around the origin; its coordinates in set 1 fill part of the atlas.
    pub(crate) fn grid(&mut self, n: u16, half: f32, y: f32, down: bool, atlas: [f32; 4]) -> Value {
        let points = (0..=n).flat_map(|z| (0..=n).map(move |x| [x, z]));
        let points: Vec<[f32; 2]> = points
            .map(|p| p.map(|i| f32::from(i) / f32::from(n)))
            .collect();
        let positions: Vec<[f32; 3]> = points
            .iter()
            .map(|[u, v]| [half * (2.0 * u - 1.0), y, half * (2.0 * v - 1.0)])
            .collect();
        let [left, top, width, height] = atlas;
        let uvs: Vec<[f32; 2]> = points
            .iter()
            .map(|[u, v]| [left + u * width, top + v * height])
            .collect();
        let normal = [0.0, if down { -1.0 } else { 1.0 }, 0.0];
        let mut indices = Vec::new();
        for z in 0..n {
            for x in 0..n {
                let a = z * (n + 1) + x;
                let [b, c, d] = [a + 1, a + n + 1, a + n + 2];
                indices.extend(if down {
                    [a, b, c, b, d, c]
                } else {
                    [a, c, b, b, c, d]
                });
            }
        }
        let normals = vec![normal; positions.len()];
        json!({
            "attributes": {
                "POSITION": self.floats(&positions),
                "NORMAL": self.floats(&normals),
                "TEXCOORD_0": self.floats(&uvs),
                "TEXCOORD_1": self.floats(&uvs),
            },
            "indices": self.indices(&indices),
        })
    }

    /// A node with a mesh of these primitives.
    pub(crate) fn place(&mut self, primitives: Vec<Value>, translation: [f32; 3]) -> usize {
        let mesh = self.add("meshes", json!({ "primitives": primitives }));
        self.stand(mesh, translation)
    }

    /// A node with a mesh.
    pub(crate) fn stand(&mut self, mesh: usize, translation: [f32; 3]) -> usize {
        let node = self.add(
            "nodes",
            json!({ "mesh": mesh, "translation": translation, "extras": { "id": mesh } }),
        );
        self.json["scenes"][0]["nodes"]
            .as_array_mut()
            .unwrap()
            .push(node.into());
        node
    }

    pub(crate) fn glb(&mut self) -> Vec<u8> {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.json["buffers"][0]["byteLength"] = self.bin.len().into();
        let mut text = serde_json::to_vec(&self.json).unwrap();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bytes = b"glTF".to_vec();
        let total = 12 + 8 + text.len() + 8 + self.bin.len();
        for word in [2, total as u32, text.len() as u32, 0x4E4F_534A] {
            bytes.extend(word.to_le_bytes());
        }
        bytes.extend(&text);
        for word in [self.bin.len() as u32, 0x004E_4942] {
            bytes.extend(word.to_le_bytes());
        }
        bytes.extend(&self.bin);
        bytes
    }
}

/// A floor below a plate, metres: 8 wide and 2 wide, 1 apart; two meshes, and atlas coordinates without overlap.
pub(crate) fn plate_over_floor() -> Maker {
    let mut maker = Maker::new();
    let floor = maker.grid(16, 4.0, 0.0, false, [0.0, 0.0, 0.5, 1.0]);
    let plate = maker.grid(1, 1.0, 0.0, true, [0.5, 0.0, 0.5, 0.5]);
    maker.place(vec![floor], [0.0; 3]);
    maker.place(vec![plate], [0.0, 1.0, 0.0]);
    maker
}

/// The unoccluded share of the cosine-weighted hemisphere above a point of the floor of [`plate_over_floor`]: 1 minus the form
/// factor of a parallel rectangle (Howell, A Catalog of Radiation Heat Transfer Configuration Factors, B-4).
pub(crate) fn open_share(x: f32, z: f32) -> f32 {
    let corner = |a: f64, b: f64| {
        let (p, q) = ((1.0 + a * a).sqrt(), (1.0 + b * b).sqrt());
        (a / p * (b / p).atan() + b / q * (a / q).atan()) / (2.0 * std::f64::consts::PI)
    };
    let (x, z) = (f64::from(x), f64::from(z));
    let sides = |at: f64| [(1.0 - at, 1.0), (-1.0 - at, -1.0)];
    let mut factor = 0.0;
    for (a, sign_a) in sides(x) {
        for (b, sign_b) in sides(z) {
            factor += sign_a * sign_b * corner(a, b);
        }
    }
    (1.0 - factor) as f32
}

/// The JSON and the binary chunk of a `.glb`.
pub(crate) fn parts(path: &Path) -> (Value, Vec<u8>) {
    let bytes = std::fs::read(path).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&bytes[..4], word(8)), (&b"glTF"[..], bytes.len()));
    let text = &bytes[20..20 + word(12)];
    let bin = 20 + word(12);
    let json = serde_json::from_slice(text).unwrap();
    (json, bytes[bin + 8..bin + 8 + word(bin)].to_vec())
}

/// The floats of an accessor without stride.
pub(crate) fn floats(json: &Value, bin: &[u8], accessor: &Value) -> Vec<f32> {
    let accessor = &json["accessors"][accessor.as_u64().unwrap() as usize];
    assert_eq!(accessor["componentType"], 5126);
    let components = match accessor["type"].as_str().unwrap() {
        "SCALAR" => 1,
        "VEC2" => 2,
        _ => 3,
    };
    let count = components * accessor["count"].as_u64().unwrap() as usize;
    let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let start = view["byteOffset"].as_u64().unwrap_or(0) as usize;
    let bytes = bin[start..start + 4 * count].chunks_exact(4);
    bytes
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect()
}
