//! The file that is written: the JSON of the one that was read with things added, and its binary chunk with bytes appended.
//!
//! What is not asked for stays: keys and their order, numbers, extensions, extras, and every byte of the binary chunk.
//! A `.glb` holds everything itself: buffers that were data URIs or files beside are appended to the binary chunk, and so
//! are images that were files beside.

use std::{io::Write, path::Path};

use anyhow::{Context, Result, bail};
use isophote_scene::{Error, GltfSource, write_atomically};
use serde_json::{Map, Value, json};

/// `bufferView.target` of vertices.
pub(super) const VERTICES: u32 = 34962;
/// `bufferView.target` of indices.
pub(super) const INDICES: u32 = 34963;

const JSON_CHUNK: u32 = 0x4E4F_534A;
const BIN_CHUNK: u32 = 0x004E_4942;

/// A glTF file in the making.
pub(super) struct Document {
    pub(super) json: Value,
    bin: Vec<u8>,
    chunks: Vec<(u32, Vec<u8>)>,
}

impl Document {
    /// The file as it was read, with everything in its binary chunk.
    pub(super) fn new(source: &GltfSource) -> Result<Self> {
        let text = &source.json[..];
        // A byte order mark is wrong there, but harmless.
        let text = text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text);
        let mut document = Self {
            json: serde_json::from_slice(text).context("the file's JSON")?,
            bin: Vec::new(),
            chunks: source.chunks.clone(),
        };
        document.take_buffers(source)?;
        document.take_images(source)?;
        Ok(document)
    }

    /// Puts all buffers whose bytes are known into the binary chunk, which is buffer 0.
    fn take_buffers(&mut self, source: &GltfSource) -> Result<()> {
        let old = std::mem::take(self.list("buffers")?);
        let mut chunk = None;
        let mut kept = Vec::new();
        // For each buffer its new place: nothing but an offset for what is in the chunk.
        let mut places = Vec::new();
        for (buffer, bytes) in old.into_iter().zip(&source.buffers) {
            match bytes {
                Some(bytes) => {
                    self.align();
                    places.push((0, self.bin.len() as u64));
                    self.bin.extend_from_slice(bytes);
                    chunk.get_or_insert(buffer);
                }
                None => {
                    kept.push(buffer);
                    places.push((kept.len() as u64, 0));
                }
            }
        }
        let mut chunk = chunk.unwrap_or_else(|| json!({}));
        object(&mut chunk, "a buffer")?.shift_remove("uri");
        let buffers = self.list("buffers")?;
        buffers.push(chunk);
        buffers.extend(kept);
        for view in self.list("bufferViews")? {
            let view = object(view, "a buffer view")?;
            move_slice(view, &places);
            let extensions = view.get_mut("extensions").and_then(Value::as_object_mut);
            for (name, extension) in extensions.into_iter().flatten() {
                if name.ends_with("_meshopt_compression")
                    && let Some(extension) = extension.as_object_mut()
                {
                    move_slice(extension, &places);
                }
            }
        }
        Ok(())
    }

    fn take_images(&mut self, source: &GltfSource) -> Result<()> {
        for (index, bytes) in source.images.iter().enumerate() {
            let Some((bytes, kind)) = bytes.as_ref().and_then(|bytes| Some((bytes, kind(bytes)?)))
            else {
                continue;
            };
            let view = self.add_view(bytes, None)?;
            let image = object(&mut self.json["images"][index], "an image")?;
            image.shift_remove("uri");
            image.insert("bufferView".into(), view.into());
            image.insert("mimeType".into(), kind.into());
        }
        Ok(())
    }

    /// A list of the root, which is there from now on.
    pub(super) fn list(&mut self, name: &str) -> Result<&mut Vec<Value>> {
        let root = object(&mut self.json, "the root")?;
        let list = root.entry(name).or_insert_with(|| Value::Array(Vec::new()));
        list.as_array_mut()
            .with_context(|| format!("'{name}' is no list in the file's JSON"))
    }

    /// Appends to a list of the root and returns the index.
    pub(super) fn add(&mut self, name: &str, item: Value) -> Result<usize> {
        let list = self.list(name)?;
        list.push(item);
        Ok(list.len() - 1)
    }

    /// Appends bytes and returns the index of their view.
    pub(super) fn add_view(&mut self, bytes: &[u8], target: Option<u32>) -> Result<usize> {
        self.align();
        let mut view =
            json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.bin.extend_from_slice(bytes);
        self.add("bufferViews", view)
    }

    /// Appends elements of `size` bytes for vertices, each at a multiple of four bytes, and returns the accessor's index;
    /// `accessor` says all but where they are and how many.
    pub(super) fn add_vertices(
        &mut self,
        mut accessor: Value,
        bytes: &[u8],
        size: usize,
    ) -> Result<usize> {
        let stride = size.next_multiple_of(4);
        let view = if stride == size {
            self.add_view(bytes, Some(VERTICES))?
        } else {
            let mut padded = vec![0; bytes.len() / size * stride];
            for (to, from) in padded.chunks_mut(stride).zip(bytes.chunks(size)) {
                to[..size].copy_from_slice(from);
            }
            let view = self.add_view(&padded, Some(VERTICES))?;
            self.list("bufferViews")?[view]["byteStride"] = stride.into();
            view
        };
        accessor["bufferView"] = view.into();
        accessor["count"] = (bytes.len() / size).into();
        self.add("accessors", accessor)
    }

    /// Notes that the file uses an extension.
    pub(super) fn use_extension(&mut self, name: &str) -> Result<()> {
        let used = self.list("extensionsUsed")?;
        if !used.iter().any(|other| other == name) {
            used.push(name.into());
        }
        Ok(())
    }

    fn align(&mut self) {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
    }

    /// Writes a `.glb`, whole or not at all.
    pub(super) fn save(mut self, path: &Path) -> Result<()> {
        self.align();
        let size = self.bin.len();
        self.list("buffers")?[0]["byteLength"] = size.into();
        let mut text = serde_json::to_vec(&self.json)?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut chunks = vec![(JSON_CHUNK, text), (BIN_CHUNK, self.bin)];
        chunks.extend(self.chunks);
        let total: usize = chunks.iter().map(|(_, bytes)| 8 + bytes.len()).sum();
        let Ok(total) = u32::try_from(12 + total) else {
            bail!("{}: a .glb has at most 4 GiB", path.display());
        };
        write_atomically(path, |writer| {
            let mut write = || -> std::io::Result<()> {
                writer.write_all(b"glTF")?;
                for word in [2, total] {
                    writer.write_all(&word.to_le_bytes())?;
                }
                for (kind, bytes) in &chunks {
                    writer.write_all(&(bytes.len() as u32).to_le_bytes())?;
                    writer.write_all(&kind.to_le_bytes())?;
                    writer.write_all(bytes)?;
                }
                Ok(())
            };
            write().map_err(|source| Error::Io {
                path: path.to_owned(),
                source,
            })
        })?;
        Ok(())
    }
}

/// A JSON object that the format says is one.
pub(super) fn object<'a>(value: &'a mut Value, what: &str) -> Result<&'a mut Map<String, Value>> {
    value
        .as_object_mut()
        .with_context(|| format!("{what} is no object in the file's JSON"))
}

/// Makes what refers to a piece of a buffer refer to where that is now.
fn move_slice(slice: &mut Map<String, Value>, places: &[(u64, u64)]) {
    let place = slice.get("buffer").and_then(Value::as_u64);
    let place = place.and_then(|index| places.get(usize::try_from(index).ok()?));
    let Some(&(buffer, offset)) = place else {
        return;
    };
    slice.insert("buffer".into(), buffer.into());
    if offset > 0 {
        let old = slice.get("byteOffset").and_then(Value::as_u64);
        slice.insert("byteOffset".into(), (old.unwrap_or(0) + offset).into());
    }
}

/// The media type of an image by its first bytes.
fn kind(bytes: &[u8]) -> Option<&'static str> {
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => Some("image/png"),
        [0xFF, 0xD8, 0xFF, ..] => Some("image/jpeg"),
        [
            b'R',
            b'I',
            b'F',
            b'F',
            _,
            _,
            _,
            _,
            b'W',
            b'E',
            b'B',
            b'P',
            ..,
        ] => Some("image/webp"),
        [0xAB, b'K', b'T', b'X', ..] => Some("image/ktx2"),
        _ => None,
    }
}
