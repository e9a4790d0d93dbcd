//! Views compressed with meshoptimizer (`EXT_meshopt_compression`, and its successor `KHR_meshopt_compression`).

use gltf_json::{Value, buffer::View};
use meshopt::ffi;

/// How a view is compressed.
pub(super) struct Compressed {
    pub(super) buffer: usize,
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    stride: usize,
    count: usize,
    mode: Mode,
    filter: Filter,
}

#[derive(Clone, Copy, PartialEq)]
enum Mode {
    Attributes,
    Triangles,
    Indices,
}

#[derive(Clone, Copy, PartialEq)]
enum Filter {
    None,
    Octahedral,
    Quaternion,
    Exponential,
    Color,
}

impl Compressed {
    /// Reads the extension of a view, if it has it. The error is the reason why it is not valid.
    pub(super) fn of(view: &View) -> Result<Option<Self>, String> {
        let others = view
            .extensions
            .as_ref()
            .map(|extensions| &extensions.others);
        let Some(extension) = others.and_then(|others| {
            ["EXT_meshopt_compression", "KHR_meshopt_compression"]
                .iter()
                .find_map(|name| others.get(*name))
        }) else {
            return Ok(None);
        };
        let number = |key: &str| extension.get(key).and_then(Value::as_u64);
        let required = |key: &str| number(key).ok_or(format!("its compression has no valid {key}"));
        let word = |key: &str| extension.get(key).and_then(Value::as_str);
        let compressed = Self {
            buffer: required("buffer")? as usize,
            byte_offset: number("byteOffset").unwrap_or(0),
            byte_length: required("byteLength")?,
            stride: required("byteStride")? as usize,
            count: required("count")? as usize,
            mode: match word("mode") {
                Some("ATTRIBUTES") => Mode::Attributes,
                Some("TRIANGLES") => Mode::Triangles,
                Some("INDICES") => Mode::Indices,
                mode => return Err(format!("its compression mode is {mode:?}")),
            },
            filter: match word("filter") {
                None | Some("NONE") => Filter::None,
                Some("OCTAHEDRAL") => Filter::Octahedral,
                Some("QUATERNION") => Filter::Quaternion,
                Some("EXPONENTIAL") => Filter::Exponential,
                Some("COLOR") => Filter::Color,
                filter => return Err(format!("its compression filter is {filter:?}")),
            },
        };
        compressed.check()?;
        Ok(Some(compressed))
    }

    /// The conditions of the extension, which are also the preconditions of the decoders.
    fn check(&self) -> Result<(), String> {
        let stride = self.stride;
        let fits = match self.mode {
            Mode::Attributes => stride.is_multiple_of(4) && (4..=256).contains(&stride),
            Mode::Triangles | Mode::Indices => stride == 2 || stride == 4,
        };
        let filterable = match self.filter {
            Filter::None => true,
            _ if self.mode != Mode::Attributes => false,
            Filter::Octahedral | Filter::Color => stride == 4 || stride == 8,
            Filter::Quaternion => stride == 8,
            Filter::Exponential => true,
        };
        if !fits || !filterable {
            return Err(format!(
                "a stride of {stride} does not go with its compression mode and filter"
            ));
        }
        if self.mode == Mode::Triangles && !self.count.is_multiple_of(3) {
            return Err("its compressed triangles have a count that is no multiple of 3".into());
        }
        Ok(())
    }

    /// Size of the decompressed data in bytes.
    pub(super) fn decoded_size(&self) -> usize {
        self.count.saturating_mul(self.stride)
    }

    /// Decompresses the view's bytes; [`Self::decoded_size`] must have been claimed. The last word may be part used.
    #[expect(
        unsafe_code,
        reason = "meshopt's safe wrappers fix the stride at compile time; files choose it"
    )]
    pub(super) fn decode(&self, bytes: &[u8]) -> Result<Vec<u64>, String> {
        let (count, stride) = (self.count, self.stride);
        // Words, because the filters read and write whole components and want them aligned.
        let mut words = vec![0_u64; self.decoded_size().div_ceil(8)];
        let target: *mut std::ffi::c_void = words.as_mut_ptr().cast();
        // SAFETY: `words` has room for `count` elements of `stride` bytes, which is all that the decoders write.
        // They are made for untrusted input: they read only `bytes` and report when it is too short. The strides
        // are those they accept, by `check`.
        let status = unsafe {
            match self.mode {
                Mode::Attributes => ffi::meshopt_decodeVertexBuffer(
                    target,
                    count,
                    stride,
                    bytes.as_ptr(),
                    bytes.len(),
                ),
                Mode::Triangles => ffi::meshopt_decodeIndexBuffer(
                    target,
                    count,
                    stride,
                    bytes.as_ptr(),
                    bytes.len(),
                ),
                Mode::Indices => ffi::meshopt_decodeIndexSequence(
                    target,
                    count,
                    stride,
                    bytes.as_ptr(),
                    bytes.len(),
                ),
            }
        };
        if status != 0 {
            return Err(format!("its compressed data is damaged (code {status})"));
        }
        // SAFETY: as above, the filters work in place on `count` elements of `stride` bytes.
        unsafe {
            match self.filter {
                Filter::None => {}
                Filter::Octahedral => ffi::meshopt_decodeFilterOct(target, count, stride),
                Filter::Quaternion => ffi::meshopt_decodeFilterQuat(target, count, stride),
                Filter::Exponential => ffi::meshopt_decodeFilterExp(target, count, stride),
                Filter::Color => ffi::meshopt_decodeFilterColor(target, count, stride),
            }
        }
        Ok(words)
    }
}
