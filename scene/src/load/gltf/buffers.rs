//! The bytes of buffers and views (glTF 2.0 §3.6.1).

use base64::{
    Engine,
    alphabet::STANDARD,
    engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig},
};
use gltf_json::Buffer;
use percent_encoding::percent_decode_str;

use super::{document::Document, meshopt};
use crate::{Result, load::budget::Borrowed};

/// Bytes that a URI stands for, and the memory they hold.
pub(super) type Fetched<'a> = (Vec<u8>, Borrowed<'a>);

impl Document<'_> {
    /// The bytes of a view.
    pub(super) fn view(&self, index: usize) -> Result<&[u8]> {
        let view = self.item(&self.root.buffer_views, "buffer view", index)?;
        if let Some(compressed) = meshopt::Compressed::of(view)
            .map_err(|reason| self.malformed(format!("buffer view {index}: {reason}")))?
        {
            let cell = self.item(&self.views, "buffer view", index)?;
            if cell.get().is_none() {
                let range = (compressed.byte_offset, compressed.byte_length);
                let bytes = self.slice(index, compressed.buffer, range)?;
                let size = compressed.decoded_size() as u64;
                self.budget.claim("a compressed buffer view", size)?;
                let decoded = compressed
                    .decode(bytes)
                    .map_err(|reason| self.malformed(format!("buffer view {index}: {reason}")))?;
                // It was empty a moment ago.
                let _ = cell.set(decoded);
            }
            let words = cell.get().map_or(&[][..], Vec::as_slice);
            return Ok(&bytemuck::cast_slice(words)[..compressed.decoded_size()]);
        }
        let offset = view.byte_offset.unwrap_or_default().0;
        self.slice(index, view.buffer.value(), (offset, view.byte_length.0))
    }

    /// A view's piece of a buffer, given by offset and length.
    fn slice(&self, view: usize, buffer: usize, (offset, length): (u64, u64)) -> Result<&[u8]> {
        let bytes = self.buffer(buffer)?;
        let end = offset.checked_add(length);
        end.and_then(|end| bytes.get(usize::try_from(offset).ok()?..usize::try_from(end).ok()?))
            .ok_or_else(|| {
                let size = bytes.len();
                self.malformed(format!(
                    "buffer view {view} is {length} bytes at {offset}, but buffer {buffer} has only {size}"
                ))
            })
    }

    /// The bytes of a buffer.
    pub(super) fn buffer(&self, index: usize) -> Result<&[u8]> {
        let buffer = self.item(&self.root.buffers, "buffer", index)?;
        let bytes = match (self.bin(), &buffer.uri) {
            (Some(bin), None) if index == 0 => bin,
            _ => {
                let cell = self.item(&self.buffers, "buffer", index)?;
                if cell.get().is_none() {
                    // It was empty a moment ago.
                    let _ = cell.set(self.read_buffer(index, buffer)?);
                }
                cell.get().map_or(&[][..], Vec::as_slice)
            }
        };
        let (length, found) = (buffer.byte_length.0, bytes.len());
        bytes
            .get(..usize::try_from(length).unwrap_or(usize::MAX))
            .ok_or_else(|| {
                self.malformed(format!(
                    "buffer {index} should have {length} bytes, but has only {found}"
                ))
            })
    }

    fn read_buffer(&self, index: usize, buffer: &Buffer) -> Result<Vec<u8>> {
        let what = format!("buffer {index}");
        if let Some(uri) = &buffer.uri {
            let (bytes, held) = self.fetch(&what, uri)?;
            held.keep();
            return Ok(bytes);
        }
        if index == 0 && self.is_binary {
            return Err(self.malformed("the binary chunk that buffer 0 should be is missing"));
        }
        // The specification lets applications fill such buffers in; here nobody does.
        self.warn(format!("{what} has no data; zeros take its place"));
        self.budget.claim(&what, buffer.byte_length.0)?;
        Ok(vec![0; buffer.byte_length.0 as usize])
    }

    /// The bytes that a URI stands for: embedded, or in a file beside this one.
    pub(super) fn fetch(&self, what: &str, uri: &str) -> Result<Fetched<'_>> {
        let start: String = uri.chars().take(60).collect();
        if let Some(data) = strip_prefix_ignoring_case(uri, "data:") {
            let held = self.budget.borrow(what, data.len() as u64)?;
            let bytes = decode_data(data).map_err(|reason| {
                self.malformed(format!("{what}: the data URI '{start}' {reason}"))
            })?;
            return Ok((bytes, held));
        }
        if has_scheme(uri) {
            return Err(self.malformed(format!(
                "{what} is at '{start}'; only files beside this one and data URIs are read, so download it first"
            )));
        }
        let decoded = percent_decode_str(uri).decode_utf8_lossy();
        let context = &self.context;
        let path = context
            .find(context.path, &decoded)
            .or_else(|| context.find(context.path, uri))
            .ok_or_else(|| self.malformed(format!("{what}: the file '{decoded}' is missing")))?;
        context.read(&path)
    }
}

/// The bytes of a data URI after its `data:` (RFC 2397).
fn decode_data(data: &str) -> Result<Vec<u8>, String> {
    // Padding and left-over bits are where encoders differ.
    const LENIENT: GeneralPurpose = GeneralPurpose::new(
        &STANDARD,
        GeneralPurposeConfig::new()
            .with_decode_padding_mode(DecodePaddingMode::Indifferent)
            .with_decode_allow_trailing_bits(true),
    );
    let (media_type, data) = data.split_once(',').ok_or("has no comma")?;
    if !media_type.to_ascii_lowercase().ends_with(";base64") {
        return Ok(percent_decode_str(data).collect());
    }
    LENIENT
        .decode(data)
        .map_err(|error| format!("is not valid base64: {error}"))
}

fn strip_prefix_ignoring_case<'a>(text: &'a str, prefix: &str) -> Option<&'a str> {
    let start = text.get(..prefix.len())?;
    start
        .eq_ignore_ascii_case(prefix)
        .then(|| &text[prefix.len()..])
}

/// Whether a URI names a protocol; a single letter is a drive of Windows.
fn has_scheme(uri: &str) -> bool {
    uri.split_once(':').is_some_and(|(scheme, _)| {
        scheme.len() > 1
            && scheme.starts_with(|first: char| first.is_ascii_alphabetic())
            && scheme
                .chars()
                .all(|c| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.'))
    })
}
