//! Numbers in buffers: every index type, normalised integers, interleaved and sparse data (glTF 2.0 §3.6.2).
//!
//! Accessors are not copied out: [`Floats`] and [`Integers`] read elements where they lie, after one check that all
//! of them do lie there.

use gltf_json::{
    accessor::{Accessor, ComponentType, Type, sparse::Sparse},
    validation::Checked,
};

use super::{document::Document, source::GltfElements};
use crate::{Result, load::budget::bytes_of};

/// Elements at equal distances in a view; all of them are within `bytes`.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
}

impl<'a> Elements<'a> {
    #[inline]
    fn get(&self, index: usize) -> &'a [u8] {
        &self.bytes[index * self.stride..][..self.size]
    }
}

/// An accessor of vectors with `N` components, read as floats.
pub(super) struct Floats<'a, const N: usize> {
    /// Number of vectors.
    pub(super) count: usize,
    elements: Option<Elements<'a>>,
    decode: Decode,
    component: usize,
    /// What a sparse accessor replaces, by increasing index.
    replaced: Vec<(usize, [f32; N])>,
}

impl<const N: usize> Floats<'_, N> {
    /// The vector at an index below [`Self::count`].
    #[inline]
    pub(super) fn get(&self, index: usize) -> [f32; N] {
        if !self.replaced.is_empty()
            && let Ok(found) = self.replaced.binary_search_by_key(&index, |entry| entry.0)
        {
            return self.replaced[found].1;
        }
        match &self.elements {
            Some(elements) => vector(elements.get(index), self.component, self.decode),
            None => [0.0; N],
        }
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = [f32; N]> + '_ {
        (0..self.count).map(|index| self.get(index))
    }
}

/// An accessor of indices.
pub(super) struct Integers<'a> {
    /// Number of indices.
    pub(super) count: usize,
    elements: Option<Elements<'a>>,
    replaced: Vec<(usize, u32)>,
}

impl Integers<'_> {
    /// The number at an index below [`Self::count`].
    #[inline]
    pub(super) fn get(&self, index: usize) -> u32 {
        if !self.replaced.is_empty()
            && let Ok(found) = self.replaced.binary_search_by_key(&index, |entry| entry.0)
        {
            return self.replaced[found].1;
        }
        self.elements
            .as_ref()
            .map_or(0, |elements| unsigned(elements.get(index)))
    }
}

impl Document<'_> {
    /// Number of components of an accessor's elements.
    pub(super) fn components(&self, index: usize) -> Result<usize> {
        Ok(self.layout(index)?.components)
    }

    /// An accessor whose elements have `N` components.
    pub(super) fn floats<const N: usize>(&self, index: usize) -> Result<Floats<'_, N>> {
        let Layout {
            accessor,
            component_type,
            components,
            count,
        } = self.layout(index)?;
        if components != N {
            return Err(self.malformed(format!(
                "accessor {index} has {components} components where {N} belong"
            )));
        }
        let component = component_type.size();
        let decode = decoder(component_type, accessor.normalized);
        let elements = self.elements(index, accessor, count, N * component)?;
        let replaced = match &accessor.sparse {
            None => Vec::new(),
            Some(sparse) => self
                .sparse(index, sparse, count, N * component)?
                .map(|(at, bytes)| (at, vector(bytes, component, decode)))
                .collect(),
        };
        self.check_order(index, &replaced)?;
        Ok(Floats {
            count,
            elements,
            decode,
            component,
            replaced,
        })
    }

    /// An accessor of unsigned integers.
    pub(super) fn integers(&self, index: usize) -> Result<Integers<'_>> {
        let Layout {
            accessor,
            component_type,
            components,
            count,
        } = self.layout(index)?;
        if components != 1
            || !matches!(
                component_type,
                ComponentType::U8 | ComponentType::U16 | ComponentType::U32
            )
        {
            return Err(self.malformed(format!(
                "accessor {index} holds indices, but is not of unsigned integers"
            )));
        }
        let size = component_type.size();
        let elements = self.elements(index, accessor, count, size)?;
        let replaced = match &accessor.sparse {
            None => Vec::new(),
            Some(sparse) => self
                .sparse(index, sparse, count, size)?
                .map(|(at, bytes)| (at, unsigned(bytes)))
                .collect(),
        };
        self.check_order(index, &replaced)?;
        Ok(Integers {
            count,
            elements,
            replaced,
        })
    }

    /// A copy of an accessor's elements without gaps. Matrices, whose columns may have gaps, are refused.
    pub(super) fn gathered(&self, index: usize) -> Result<GltfElements> {
        let Layout {
            accessor,
            component_type,
            components,
            count,
        } = self.layout(index)?;
        if matches!(
            accessor.type_,
            Checked::Valid(Type::Mat2 | Type::Mat3 | Type::Mat4)
        ) {
            return Err(self.malformed(format!("accessor {index} holds matrices")));
        }
        let size = components * component_type.size();
        let elements = self.elements(index, accessor, count, size)?;
        self.budget
            .claim("a copy of a mesh's vertices", bytes_of(count, size))?;
        let mut bytes = match elements {
            None => vec![0; count * size],
            Some(elements) => {
                let mut bytes = Vec::with_capacity(count * size);
                (0..count).for_each(|i| bytes.extend_from_slice(elements.get(i)));
                bytes
            }
        };
        if let Some(sparse) = &accessor.sparse {
            for (at, value) in self.sparse(index, sparse, count, size)? {
                let place = bytes
                    .get_mut(at * size..)
                    .and_then(|rest| rest.get_mut(..size));
                if let Some(place) = place {
                    place.copy_from_slice(value);
                }
            }
        }
        Ok(GltfElements {
            component_type: component_type.as_gl_enum(),
            components,
            size,
            count,
            bytes,
        })
    }

    fn layout(&self, index: usize) -> Result<Layout<'_>> {
        let accessor = self.item(&self.root.accessors, "accessor", index)?;
        let (Checked::Valid(component_type), Checked::Valid(type_)) =
            (accessor.component_type, accessor.type_)
        else {
            return Err(self.malformed(format!("accessor {index} has an unknown type")));
        };
        Ok(Layout {
            accessor,
            component_type: component_type.0,
            components: type_.multiplicity(),
            count: usize::try_from(accessor.count.0).unwrap_or(usize::MAX),
        })
    }

    /// The elements of an accessor, or `None` where it has no view and all are zero.
    fn elements(
        &self,
        index: usize,
        accessor: &Accessor,
        count: usize,
        size: usize,
    ) -> Result<Option<Elements<'_>>> {
        let Some(view) = accessor.buffer_view else {
            return Ok(None);
        };
        let offset = accessor.byte_offset.unwrap_or_default().0;
        self.strided(index, view.value(), offset, count, size, true)
            .map(Some)
    }

    /// `count` elements of `size` bytes in a view; `interleaved` if the view's stride holds for them.
    fn strided(
        &self,
        accessor: usize,
        view: usize,
        offset: u64,
        count: usize,
        size: usize,
        interleaved: bool,
    ) -> Result<Elements<'_>> {
        let stride = self.item(&self.root.buffer_views, "buffer view", view)?;
        let stride = match stride.byte_stride {
            Some(stride) if interleaved => stride.0,
            _ => size,
        };
        if stride < size && count > 1 {
            return Err(self.malformed(format!(
                "accessor {accessor}: a stride of {stride} bytes is too small for elements of {size}"
            )));
        }
        let bytes = self.view(view)?;
        let found = bytes.len();
        let needed = match count {
            0 => Some(0),
            _ => (count - 1)
                .checked_mul(stride)
                .and_then(|last| last.checked_add(size)),
        };
        let piece = usize::try_from(offset).ok().and_then(|offset| {
            let end = offset.checked_add(needed?)?;
            bytes.get(offset..end)
        });
        let bytes = piece.ok_or_else(|| {
            self.malformed(format!(
                "accessor {accessor}: {count} elements at byte {offset} do not fit into the {found} bytes of buffer view {view}"
            ))
        })?;
        Ok(Elements {
            bytes,
            stride,
            size,
        })
    }

    /// The indices and values that a sparse accessor replaces.
    fn sparse<'b>(
        &'b self,
        index: usize,
        sparse: &'b Sparse,
        count: usize,
        size: usize,
    ) -> Result<impl Iterator<Item = (usize, &'b [u8])> + 'b> {
        let replaced = usize::try_from(sparse.count.0).unwrap_or(usize::MAX);
        let Checked::Valid(component_type) = sparse.indices.component_type else {
            return Err(self.malformed(format!("accessor {index} has sparse indices of no type")));
        };
        if replaced > count {
            return Err(self.malformed(format!(
                "accessor {index} replaces {replaced} of only {count} elements"
            )));
        }
        let indices = self.strided(
            index,
            sparse.indices.buffer_view.value(),
            sparse.indices.byte_offset.0,
            replaced,
            component_type.0.size(),
            false,
        )?;
        let values = self.strided(
            index,
            sparse.values.buffer_view.value(),
            sparse.values.byte_offset.0,
            replaced,
            size,
            false,
        )?;
        self.budget
            .claim("a sparse accessor", bytes_of(replaced, 80))?;
        Ok((0..replaced).map(move |i| (unsigned(indices.get(i)) as usize, values.get(i))))
    }

    fn check_order<T>(&self, index: usize, replaced: &[(usize, T)]) -> Result<()> {
        if replaced.is_sorted_by(|a, b| a.0 < b.0) {
            return Ok(());
        }
        Err(self.malformed(format!(
            "accessor {index} has sparse indices that do not increase"
        )))
    }
}

struct Layout<'a> {
    accessor: &'a Accessor,
    component_type: ComponentType,
    components: usize,
    count: usize,
}

/// Reads one component.
type Decode = fn(&[u8]) -> f32;

/// How a component becomes a float (glTF 2.0 §3.11, and `KHR_mesh_quantization` for integers that are not
/// normalised).
fn decoder(component_type: ComponentType, normalized: bool) -> Decode {
    match (component_type, normalized) {
        (ComponentType::I8, false) => |b| f32::from(b[0] as i8),
        (ComponentType::I8, true) => |b| (f32::from(b[0] as i8) / 127.0).max(-1.0),
        (ComponentType::U8, false) => |b| f32::from(b[0]),
        (ComponentType::U8, true) => |b| f32::from(b[0]) / 255.0,
        (ComponentType::I16, false) => |b| f32::from(i16::from_le_bytes([b[0], b[1]])),
        (ComponentType::I16, true) => {
            |b| (f32::from(i16::from_le_bytes([b[0], b[1]])) / 32767.0).max(-1.0)
        }
        (ComponentType::U16, false) => |b| f32::from(u16::from_le_bytes([b[0], b[1]])),
        (ComponentType::U16, true) => |b| f32::from(u16::from_le_bytes([b[0], b[1]])) / 65535.0,
        (ComponentType::U32, false) => |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as f32,
        (ComponentType::U32, true) => {
            |b| (f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])) / 4_294_967_295.0) as f32
        }
        (ComponentType::F32, _) => |b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]),
    }
}

#[inline]
fn vector<const N: usize>(bytes: &[u8], component: usize, decode: Decode) -> [f32; N] {
    std::array::from_fn(|i| decode(&bytes[i * component..]))
}

/// An unsigned integer of one, two or four bytes.
#[inline]
fn unsigned(bytes: &[u8]) -> u32 {
    match *bytes {
        [a] => u32::from(a),
        [a, b] => u32::from(u16::from_le_bytes([a, b])),
        [a, b, c, d] => u32::from_le_bytes([a, b, c, d]),
        _ => u32::MAX,
    }
}
