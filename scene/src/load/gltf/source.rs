//! What a file held beside the scene that was made of it, for programs that write it again with something added.
//!
//! A scene's mesh is all primitives of one of the file's meshes, its vertices are chosen and may be repeated, and a node
//! can be several instances: [`GltfMesh`] and [`GltfInstance`] remember where each came from. Everything else of the file
//! is there as it was: the JSON's text, the bytes of buffers and images, and the accessors of the meshes as plain arrays.

use std::{
    collections::{BTreeMap, btree_map::Entry},
    ops::Range,
};

use gltf_json::Value;

use super::{container, document::Document};
use crate::Result;

/// A glTF file as it was, and what of it became which part of the scene.
#[derive(Clone, Debug)]
pub struct GltfSource {
    /// The text of its JSON.
    pub json: Vec<u8>,
    /// The bytes of each buffer: of the binary chunk, of a data URI, or of a file beside. `None` where there are none.
    pub buffers: Vec<Option<Vec<u8>>>,
    /// The bytes of each image that is a file beside.
    pub images: Vec<Option<Vec<u8>>>,
    /// The chunks of a `.glb` that are neither the JSON nor the binary chunk: their kinds and bytes.
    pub chunks: Vec<(u32, Vec<u8>)>,
    /// The accessors that the primitives of [`meshes`](Self::meshes) refer to, by index.
    pub accessors: BTreeMap<usize, GltfElements>,
    /// Where each mesh of the scene came from.
    pub meshes: Vec<GltfMesh>,
    /// Where each instance of the scene came from.
    pub instances: Vec<GltfInstance>,
}

/// The elements of an accessor one after another: decompressed, without gaps, and with what is sparse put in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GltfElements {
    /// The type of a component by its number in glTF: 5120 (i8), 5121 (u8), 5122 (i16), 5123 (u16), 5125 (u32), 5126 (f32).
    pub component_type: u32,
    /// Components of an element.
    pub components: usize,
    /// Bytes of an element.
    pub size: usize,
    /// Number of elements.
    pub count: usize,
    /// `count` times `size` bytes.
    pub bytes: Vec<u8>,
}

/// Where a mesh of the scene came from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GltfMesh {
    /// Index of the mesh in the file.
    pub mesh: usize,
    /// The primitives that it consists of, in this order; those without triangles are left out.
    pub primitives: Vec<GltfPrimitive>,
}

/// Where some vertices of a mesh came from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GltfPrimitive {
    /// Index of the primitive in its mesh in the file.
    pub primitive: usize,
    /// Its vertices in the scene's mesh. The triangles between them are its triangles, in the file's order, without those
    /// that were dropped.
    pub vertices: Range<u32>,
    /// For each of them its index in the accessors of the file. Where there are no normals every corner of a triangle is a
    /// vertex of its own.
    pub sources: Vec<u32>,
    /// How many vertices the accessors have.
    pub count: usize,
}

/// Where an instance of the scene came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GltfInstance {
    /// Index of the node in the file.
    pub node: usize,
    /// The mesh of the scene that it was loaded with.
    pub mesh: u32,
    /// Whether the node says that its mesh stands in many places (`EXT_mesh_gpu_instancing`).
    pub is_multiplied: bool,
}

/// What was noted while a scene was made.
pub(super) struct Origins {
    pub(super) meshes: Vec<GltfMesh>,
    pub(super) instances: Vec<GltfInstance>,
}

impl Document<'_> {
    /// The file as it was, whose bytes these are.
    pub(super) fn source(&self, bytes: &[u8], origins: Origins) -> Result<GltfSource> {
        let Origins { meshes, instances } = origins;
        let parts = container::split(self.context.path, bytes)?;
        let chunk = |(kind, range): (u32, Range<usize>)| Ok((kind, self.copied(&bytes[range])?));
        let json = self.copied(&bytes[parts.json])?;
        Ok(GltfSource {
            buffers: self.all_buffers()?,
            images: self.external_images()?,
            chunks: parts.others.into_iter().map(chunk).collect::<Result<_>>()?,
            accessors: self.accessors(&json, &meshes)?,
            json,
            meshes,
            instances,
        })
    }

    fn all_buffers(&self) -> Result<Vec<Option<Vec<u8>>>> {
        let bytes = |(index, buffer): (usize, &gltf_json::Buffer)| {
            if buffer.uri.is_none() {
                let is_chunk = index == 0 && self.bin().is_some();
                let bin = self.bin().filter(|_| is_chunk);
                return bin.map(|bin| self.copied(bin)).transpose();
            }
            // What is missing and was not needed for the scene stays missing.
            let bytes = self.context.optional(self.buffer(index))?;
            bytes.map(|bytes| self.copied(bytes)).transpose()
        };
        self.root.buffers.iter().enumerate().map(bytes).collect()
    }

    fn external_images(&self) -> Result<Vec<Option<Vec<u8>>>> {
        let bytes = |(index, image): (usize, &gltf_json::Image)| {
            let uri = image.uri.as_ref().filter(|uri| {
                let start = uri.get(..5);
                !start.is_some_and(|start| start.eq_ignore_ascii_case("data:"))
            });
            let Some(uri) = uri else {
                return Ok(None);
            };
            let fetched = self.fetch(&format!("image {index}"), uri);
            Ok(self.context.optional(fetched)?.map(|(bytes, held)| {
                held.keep();
                bytes
            }))
        };
        self.root.images.iter().enumerate().map(bytes).collect()
    }

    fn copied(&self, bytes: &[u8]) -> Result<Vec<u8>> {
        let size = bytes.len() as u64;
        self.budget.claim("a copy of the file's buffers", size)?;
        Ok(bytes.to_vec())
    }

    /// All accessors that some primitives refer to. The data model knows no attributes of foreign extensions, hence the JSON
    /// as it is.
    fn accessors(&self, json: &[u8], meshes: &[GltfMesh]) -> Result<BTreeMap<usize, GltfElements>> {
        let (json, _held) = container::read(self.context.path, json, self.budget)?;
        let mut found = BTreeMap::new();
        for mesh in meshes {
            for primitive in &mesh.primitives {
                let json = &json["meshes"][mesh.mesh]["primitives"][primitive.primitive];
                let targets = json["targets"].as_array().into_iter().flatten();
                let attributes = targets.chain([&json["attributes"]]);
                let indices = attributes.filter_map(Value::as_object);
                let indices = indices.flat_map(|all| all.values().filter_map(Value::as_u64));
                for index in indices.map(|index| index as usize) {
                    if let Entry::Vacant(place) = found.entry(index) {
                        let elements = self.gathered(index);
                        if let Some(elements) = self.context.optional(elements)? {
                            place.insert(elements);
                        }
                    }
                }
            }
        }
        Ok(found)
    }
}
