//! A file that is being loaded.

use std::{
    cell::{Cell, OnceCell},
    ops::Range,
};

use gltf_json::Root;

use super::{buffers::Fetched, container};
use crate::{
    Dropped, Error, Result, Scene,
    load::{budget::Budget, context::Context},
};

/// The extensions that are understood, at least as far as a renderer of light needs them.
pub(super) const SUPPORTED: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_texture_transform",
];

/// An open file: its JSON, its bytes, and what has happened so far.
pub(super) struct Document<'a> {
    pub(super) context: Context<'a>,
    pub(super) budget: &'a Budget<'a>,
    pub(super) root: Root,
    /// Whether the file is a `.glb`, whatever its name.
    pub(super) is_binary: bool,
    /// The whole file if it has a binary chunk.
    bytes: Vec<u8>,
    bin: Option<Range<usize>>,
    /// External and embedded buffers, read when first asked for.
    pub(super) buffers: Vec<OnceCell<Vec<u8>>>,
    /// Views that had to be decompressed, in words for the sake of alignment.
    pub(super) views: Vec<OnceCell<Vec<u64>>>,
    dropped: Cell<Dropped>,
}

impl<'a> Document<'a> {
    /// Reads a file's JSON, and checks that its required extensions are supported.
    pub(super) fn new(
        context: Context<'a>,
        budget: &'a Budget<'a>,
        (mut bytes, bytes_held): Fetched<'a>,
    ) -> Result<Self> {
        let path = context.path;
        let parts = container::split(path, &bytes)?;
        let (root, root_held) = container::parse(path, &bytes[parts.json], budget)?;
        root_held.keep();
        let is_binary = bytes.starts_with(container::MAGIC);
        if parts.bin.is_some() {
            bytes_held.keep();
        } else {
            bytes = Vec::new();
        }
        let document = Self {
            context,
            budget,
            is_binary,
            bytes,
            bin: parts.bin,
            buffers: root.buffers.iter().map(|_| OnceCell::new()).collect(),
            views: root.buffer_views.iter().map(|_| OnceCell::new()).collect(),
            dropped: Cell::default(),
            root,
        };
        document.check_extensions()?;
        Ok(document)
    }

    /// The binary chunk of a `.glb`.
    pub(super) fn bin(&self) -> Option<&[u8]> {
        self.bin.clone().map(|range| &self.bytes[range])
    }

    /// The item of a list that an index in the file refers to.
    pub(super) fn item<'b, T>(&self, list: &'b [T], what: &str, index: usize) -> Result<&'b T> {
        list.get(index).ok_or_else(|| {
            let count = list.len();
            self.malformed(format!("refers to {what} {index}, but there are {count}"))
        })
    }

    pub(super) fn malformed(&self, reason: impl Into<String>) -> Error {
        self.context.malformed(reason)
    }

    pub(super) fn warn(&self, line: impl Into<String>) {
        self.context.warn(line);
    }

    /// Adds to the numbers of dropped triangles.
    pub(super) fn drop_triangles(&self, dropped: Dropped) {
        let mut all = self.dropped.get();
        all += dropped;
        self.dropped.set(all);
    }

    /// The scene with the report of how it was loaded.
    pub(super) fn finish(self, scene: Scene) -> Scene {
        self.context.finish(scene, self.dropped.get())
    }

    fn check_extensions(&self) -> Result<()> {
        let unsupported = |name: &&String| !SUPPORTED.contains(&name.as_str());
        if let Some(name) = self.root.extensions_required.iter().find(unsupported) {
            return Err(Error::Unsupported {
                path: self.context.path.to_owned(),
                feature: name.clone(),
                remedy: remedy(name),
            });
        }
        for name in self.root.extensions_used.iter().filter(unsupported) {
            self.warn(format!(
                "the extension {name} is not supported and is ignored"
            ));
        }
        Ok(())
    }
}

fn remedy(extension: &str) -> String {
    match extension {
        "KHR_draco_mesh_compression" => {
            "re-export the file without Draco compression (EXT_meshopt_compression is supported)"
        }
        "KHR_texture_basisu" | "MSFT_texture_dds" | "EXT_texture_avif" => {
            "re-export the file with PNG, JPEG or WebP textures"
        }
        "KHR_materials_pbrSpecularGlossiness" => "convert its materials to metallic-roughness",
        _ => "re-export the file without it",
    }
    .into()
}
