//! Accessors: typed elements in the bytes of a buffer, every bound checked before the first is read.
//!
//! Element n of an accessor lies at view.byteOffset + accessor.byteOffset + n · stride and must end inside its view,
//! and the view inside its buffer (glTF 2.0, 3.6). Elements without a view are zero; a sparse accessor replaces some.
//!
//! Alignment is not asked for, since bytes are read one by one; `min` and `max` are not looked at.

use super::MEND;
use super::json::{Document, Object};
use super::mesh::Primitive;
use crate::Error;
use glam::DVec3;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Most elements without bytes in the file: a longer accessor could make any number of triangles out of nothing.
const BYTELESS_MAX: usize = 1 << 20;

/// The type of one component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn from_code(code: usize) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn of(object: &Object<'_>) -> Result<Self, Error> {
        let code = object.required_whole("componentType")?;
        Self::from_code(code).ok_or_else(|| {
            Error::malformed(format!(
                "`{}.componentType` is {code}, which names no type; {MEND}",
                object.place()
            ))
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// The largest value of an index type: it restarts a primitive. `None` for other types.
    fn index_max(self) -> Option<u32> {
        match self {
            Self::U8 => Some(u8::MAX.into()),
            Self::U16 => Some(u16::MAX.into()),
            Self::U32 => Some(u32::MAX),
            Self::I8 | Self::I16 | Self::F32 => None,
        }
    }

    /// Component `n` of an element long enough for it ([`Layout`] has checked).
    fn read(self, element: &[u8], n: usize, normalized: bool) -> f64 {
        let at = n * self.size();
        let two = || [element[at], element[at + 1]];
        let four = || [element[at], element[at + 1], element[at + 2], element[at + 3]];
        // glTF 2.0, 3.11 (and KHR_mesh_quantization): f = max(c / (2ᵇ⁻¹ − 1), −1) signed, c / (2ᵇ − 1) unsigned.
        let (value, one) = match self {
            Self::I8 => (f64::from(i8::from_le_bytes([element[at]])), 127.0),
            Self::U8 => (f64::from(element[at]), 255.0),
            Self::I16 => (f64::from(i16::from_le_bytes(two())), 32767.0),
            Self::U16 => (f64::from(u16::from_le_bytes(two())), 65535.0),
            Self::U32 => return f64::from(u32::from_le_bytes(four())),
            Self::F32 => return f64::from(f32::from_le_bytes(four())),
        };
        if normalized { (value / one).max(-1.0) } else { value }
    }

    /// Index `n` of tightly packed or single indices.
    fn read_index(self, bytes: &[u8], n: usize) -> u32 {
        let at = n * self.size();
        match self {
            Self::U8 | Self::I8 => bytes[at].into(),
            Self::U16 | Self::I16 => u16::from_le_bytes([bytes[at], bytes[at + 1]]).into(),
            Self::U32 | Self::F32 => u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]),
        }
    }
}

/// The range of an accessor's bytes, from the first element to the last, checked against the buffer's length.
#[derive(Clone, Copy)]
struct Span {
    buffer: usize,
    start: usize,
    end: usize,
    stride: usize,
}

struct SparseLayout {
    count: usize,
    component: Component,
    indices: Span,
    values: Span,
}

/// An accessor of the JSON, found consistent.
pub(super) struct Layout {
    pub(super) count: usize,
    pub(super) component: Component,
    width: usize,
    normalized: bool,
    elements: Option<Span>,
    sparse: Option<SparseLayout>,
}

/// Number of components of an element type.
fn width(kind: &str) -> Option<usize> {
    Some(match kind {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" | "MAT2" => 4,
        "MAT3" => 9,
        "MAT4" => 16,
        _ => return None,
    })
}

impl Layout {
    pub(super) fn of(document: &Document<'_>, index: usize) -> Result<Self, Error> {
        let accessor = document.accessors.get(index)?;
        let count = accessor.required_whole("count")?;
        let component = Component::of(&accessor)?;
        let width = accessor.text("type")?.and_then(width).ok_or_else(|| {
            Error::malformed(format!(
                "`{}.type` is missing or no type such as VEC3; {MEND}",
                accessor.place()
            ))
        })?;
        let size = component.size() * width;
        let elements = Span::of(document, &accessor, count, size, true)?;
        let sparse = match accessor.object("sparse")? {
            None => None,
            Some(sparse) => {
                let sparse_count = sparse.required_whole("count")?;
                if sparse_count > count {
                    return Err(Error::malformed(format!(
                        "`{}.count` is {sparse_count}, more than the {count} elements of the accessor; {MEND}",
                        sparse.place()
                    )));
                }
                let indices = sparse.required_object("indices")?;
                let values = sparse.required_object("values")?;
                let index_component = Component::of(&indices)?;
                if index_component.index_max().is_none() {
                    return Err(Error::malformed(format!(
                        "`{}.componentType` is no unsigned type; {MEND}",
                        indices.place()
                    )));
                }
                let missing = |object: &Object<'_>| {
                    Error::malformed(format!("`{}.bufferView` is missing; {MEND}", object.place()))
                };
                Some(SparseLayout {
                    count: sparse_count,
                    component: index_component,
                    indices: Span::of(document, &indices, sparse_count, index_component.size(), false)?
                        .ok_or_else(|| missing(&indices))?,
                    values: Span::of(document, &values, sparse_count, size, false)?.ok_or_else(|| missing(&values))?,
                })
            }
        };
        if elements.is_none() && count > BYTELESS_MAX {
            return Err(Error::malformed(format!(
                "`{}` has {count} elements but no `bufferView`; more than {BYTELESS_MAX} elements without bytes are \
                 not read; {MEND}",
                accessor.place()
            )));
        }
        let normalized = accessor.boolean("normalized")?.unwrap_or(false);
        Ok(Self {
            count,
            component,
            width,
            normalized,
            elements,
            sparse,
        })
    }

    /// Returns whether the elements can be vertex indices.
    pub(super) fn is_indices(&self) -> bool {
        self.width == 1 && self.component.index_max().is_some()
    }

    /// Returns whether the elements can be positions, quantised or not.
    pub(super) fn is_positions(&self) -> bool {
        self.width == 3 && self.component != Component::U32
    }

    /// Returns whether an element has this many numbers.
    pub(super) fn has_width(&self, width: usize) -> bool {
        self.width == width
    }

    /// Returns whether the elements have no bytes in the file: they are then all zero.
    pub(super) fn is_zero(&self) -> bool {
        self.elements.is_none() && self.sparse.is_none()
    }

    /// Number of replaced elements.
    pub(super) fn sparse_count(&self) -> usize {
        self.sparse.as_ref().map_or(0, |sparse| sparse.count)
    }

    /// The buffers with the elements.
    pub(super) fn buffers(&self) -> impl Iterator<Item = usize> + use<> {
        let sparse = self.sparse.as_ref();
        [
            self.elements.map(|s| s.buffer),
            sparse.map(|s| s.indices.buffer),
            sparse.map(|s| s.values.buffer),
        ]
        .into_iter()
        .flatten()
    }
}

/// Refuses accessors and views with references to nothing, even unused ones: such a file lost a part.
pub(super) fn check_references(document: &Document<'_>) -> Result<(), Error> {
    for view in document.buffer_views.iter() {
        view?.reference("buffer", &document.buffers)?;
    }
    for accessor in document.accessors.iter() {
        let accessor = accessor?;
        accessor.reference("bufferView", &document.buffer_views)?;
        if let Some(sparse) = accessor.object("sparse")? {
            for part in ["indices", "values"] {
                if let Some(part) = sparse.object(part)? {
                    part.reference("bufferView", &document.buffer_views)?;
                }
            }
        }
    }
    Ok(())
}

impl Span {
    /// The bytes of `count` elements of `size` bytes of `object` (an accessor, or a part of a sparse one); `None` if it
    /// names no view.
    fn of(
        document: &Document<'_>,
        object: &Object<'_>,
        count: usize,
        size: usize,
        strided: bool,
    ) -> Result<Option<Self>, Error> {
        let place = object.place();
        let Some(view) = object.reference("bufferView", &document.buffer_views)? else {
            return Ok(None);
        };
        let view = document.buffer_views.get(view)?;
        let buffer = view.required_reference("buffer", &document.buffers)?;
        let buffer_length = document.buffers.get(buffer)?.required_whole("byteLength")?;
        let view_start = view.whole("byteOffset")?.unwrap_or(0);
        let view_length = view.required_whole("byteLength")?;
        if view_start
            .checked_add(view_length)
            .is_none_or(|end| end > buffer_length)
        {
            return Err(Error::malformed(format!(
                "`{}` is {view_length} bytes from byte {view_start} on, but `buffers[{buffer}]` has {buffer_length}; \
                 {MEND}",
                view.place()
            )));
        }
        let stride = if strided {
            view.whole("byteStride")?.unwrap_or(size)
        } else {
            size
        };
        if stride < size {
            return Err(Error::malformed(format!(
                "`{}.byteStride` is {stride}, less than the {size} bytes of an element of `{place}`; {MEND}",
                view.place()
            )));
        }
        let offset = object.whole("byteOffset")?.unwrap_or(0);
        let length = match count.checked_sub(1) {
            None => Some(0),
            Some(last) => last.checked_mul(stride).and_then(|bytes| bytes.checked_add(size)),
        };
        let end = length
            .and_then(|length| length.checked_add(offset))
            .filter(|&end| end <= view_length);
        let Some(end) = end else {
            return Err(Error::malformed(format!(
                "`{place}` claims {count} elements of {size} bytes every {stride}, from byte {offset} of `{}` on, \
                 which has {view_length} bytes; {MEND}",
                view.place()
            )));
        };
        Ok(Some(Self {
            buffer,
            start: view_start + offset,
            end: view_start + end,
            stride,
        }))
    }

    fn bytes<'a>(&self, buffers: &'a BTreeMap<usize, Cow<'_, [u8]>>) -> Result<&'a [u8], Error> {
        buffers
            .get(&self.buffer)
            .and_then(|bytes| bytes.get(self.start..self.end))
            .ok_or_else(|| {
                Error::malformed(format!(
                    "`buffers[{}]` ends before byte {}; {MEND}",
                    self.buffer, self.end
                ))
            })
    }
}

struct SparseElements<'a> {
    count: usize,
    component: Component,
    indices: &'a [u8],
    values: &'a [u8],
}

/// The elements of an accessor, with the bytes they lie in.
pub(super) struct Elements<'a> {
    count: usize,
    component: Component,
    normalized: bool,
    size: usize,
    stride: usize,
    bytes: Option<&'a [u8]>,
    sparse: Option<SparseElements<'a>>,
}

impl<'a> Elements<'a> {
    /// Binds a layout to the bytes. Checks that sparse indices ascend: the search relies on it.
    pub(super) fn new(
        accessor: usize,
        layout: &Layout,
        buffers: &'a BTreeMap<usize, Cow<'_, [u8]>>,
    ) -> Result<Self, Error> {
        let sparse = match &layout.sparse {
            None => None,
            Some(sparse) => {
                let (indices, values) = (sparse.indices.bytes(buffers)?, sparse.values.bytes(buffers)?);
                let mut after_last = 0;
                for n in 0..sparse.count {
                    let index = sparse.component.read_index(indices, n) as usize;
                    if index < after_last || index >= layout.count {
                        return Err(Error::malformed(format!(
                            "`accessors[{accessor}].sparse.indices`: index {n} is {index}, which is not above the one \
                             before it or not below the {} elements; {MEND}",
                            layout.count
                        )));
                    }
                    after_last = index + 1;
                }
                Some(SparseElements {
                    count: sparse.count,
                    component: sparse.component,
                    indices,
                    values,
                })
            }
        };
        let size = layout.component.size() * layout.width;
        Ok(Self {
            count: layout.count,
            component: layout.component,
            normalized: layout.normalized,
            size,
            stride: layout.elements.map_or(size, |span| span.stride),
            bytes: layout.elements.map(|span| span.bytes(buffers)).transpose()?,
            sparse,
        })
    }

    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// The bytes of element `n` < count; `None` for an element without bytes, zero.
    fn element(&self, n: usize) -> Option<&'a [u8]> {
        if let Some(sparse) = &self.sparse {
            let (mut low, mut high) = (0, sparse.count);
            while low < high {
                let middle = usize::midpoint(low, high);
                match (sparse.component.read_index(sparse.indices, middle) as usize).cmp(&n) {
                    std::cmp::Ordering::Equal => return Some(&sparse.values[middle * self.size..][..self.size]),
                    std::cmp::Ordering::Less => low = middle + 1,
                    std::cmp::Ordering::Greater => high = middle,
                }
            }
        }
        self.bytes.map(|bytes| &bytes[n * self.stride..][..self.size])
    }

    /// Element `n` < count of positions.
    pub(super) fn position(&self, n: usize) -> DVec3 {
        DVec3::from_array(self.numbers(n))
    }

    /// The numbers of element `n` < count, which has so many.
    pub(super) fn numbers<const N: usize>(&self, n: usize) -> [f64; N] {
        let read = |bytes| std::array::from_fn(|at| self.component.read(bytes, at, self.normalized));
        self.element(n).map_or([0.0; N], read)
    }

    /// Element `n` < count of indices, checked to be below `vertex_count`.
    pub(super) fn vertex(&self, n: usize, vertex_count: usize, primitive: &Primitive) -> Result<usize, Error> {
        let vertex = self.element(n).map_or(0, |bytes| self.component.read_index(bytes, 0));
        if Some(vertex) == self.component.index_max() {
            return Err(Error::malformed(format!(
                "`meshes[{}].primitives[{}].indices`: index {n} is {vertex}, the value for primitive restart, which \
                 glTF does not have; {MEND}",
                primitive.mesh, primitive.number
            )));
        }
        let vertex = vertex as usize;
        if vertex >= vertex_count {
            return Err(Error::malformed(format!(
                "`meshes[{}].primitives[{}].indices`: index {n} is {vertex}, but there are {vertex_count} positions; \
                 {MEND}",
                primitive.mesh, primitive.number
            )));
        }
        Ok(vertex)
    }
}
