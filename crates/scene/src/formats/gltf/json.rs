//! Checked access to the JSON of a glTF file: a value is typed at each access, and every refusal names its place, such
//! as `meshes[3].primitives[0].mode`.

use super::MEND;
use super::glb::Container;
use crate::{Error, ErrorKind, Ledger};
use serde_json::{Map, Value};
use std::fmt;

/// Most objects. One costs some 650 bytes in memory and as few as 3 in the file: this many are 2.7 GB, and far more
/// than the nodes, meshes and accessors of any scene that fits in memory.
const OBJECTS_MAX: usize = 1 << 22;
/// A value costs 32 bytes in memory and as few as 2 in the file.
const VALUES_MAX: usize = 1 << 26;

/// Parses the JSON text of a file. Nesting is bounded by `serde_json`'s own limit of 128.
pub(super) fn parse(container: &Container<'_>, ledger: &mut Ledger) -> Result<Value, Error> {
    let mut text = crate::text::unmarked(container.json)?;
    if text.len() < container.json.len() {
        ledger.note("byte order mark");
    }
    // Some writers pad the JSON chunk with zeros in place of spaces.
    while let Some(rest) = text.strip_suffix(b"\0") {
        text = rest;
    }
    let (mut objects, mut values) = (0_usize, 0_usize);
    for byte in text {
        objects += usize::from(*byte == b'{');
        values += usize::from(*byte == b',');
    }
    if objects > OBJECTS_MAX || values > VALUES_MAX {
        return Err(Error::new(ErrorKind::TooLarge(format!(
            "the JSON holds {objects} objects and {values} values, more than the {OBJECTS_MAX} and {VALUES_MAX} that \
             are read; split the scene into several files"
        ))));
    }
    serde_json::from_slice(text).map_err(|e| {
        let full = e.to_string();
        let reason = full.split(" at line ").next().unwrap_or(&full);
        let column = e.column();
        match (container.text, text.trim_ascii_start().first()) {
            (false, _) => Error::malformed(format!("the JSON chunk of the GLB cannot be read ({full}); {MEND}")),
            (true, Some(b'{')) => {
                Error::malformed(format!("the JSON cannot be read ({reason}, column {column}); {MEND}"))
                    .at(e.line() as u64)
            }
            (true, _) => Error::malformed(format!("is neither GLB nor the JSON of a glTF file ({reason}); {MEND}")),
        }
    })
}

/// The place of a value in the JSON. Copied about instead of a string, since only refusals print it.
#[derive(Clone, Copy)]
pub(super) struct Place {
    parts: [(&'static str, Option<usize>); 5],
    len: usize,
}

impl Place {
    const ROOT: Self = Self {
        parts: [("", None); 5],
        len: 0,
    };

    fn member(mut self, key: &'static str) -> Self {
        // Every accessed value lies above this depth; otherwise only the message would be shorter.
        if let Some(part) = self.parts.get_mut(self.len) {
            *part = (key, None);
            self.len += 1;
        }
        self
    }

    fn element(mut self, index: usize) -> Self {
        if let Some(part) = self.len.checked_sub(1).and_then(|last| self.parts.get_mut(last)) {
            part.1 = Some(index);
        }
        self
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (position, (key, index)) in self.parts.iter().take(self.len).enumerate() {
            write!(f, "{}{key}", if position == 0 { "" } else { "." })?;
            if let Some(index) = index {
                write!(f, "[{index}]")?;
            }
        }
        Ok(())
    }
}

/// A JSON object and its place.
#[derive(Clone, Copy)]
pub(super) struct Object<'v> {
    members: &'v Map<String, Value>,
    place: Place,
}

/// A JSON array of objects and its place.
#[derive(Clone, Copy)]
pub(super) struct List<'v> {
    values: &'v [Value],
    place: Place,
}

impl<'v> List<'v> {
    pub(super) fn len(&self) -> usize {
        self.values.len()
    }

    pub(super) fn get(&self, index: usize) -> Result<Object<'v>, Error> {
        let place = self.place.element(index);
        match self.values.get(index) {
            Some(Value::Object(members)) => Ok(Object { members, place }),
            Some(_) => Err(Error::malformed(format!("`{place}` is not a JSON object; {MEND}"))),
            None => Err(Error::malformed(format!("`{place}` is not there; {MEND}"))),
        }
    }

    pub(super) fn iter(self) -> impl Iterator<Item = Result<Object<'v>, Error>> + use<'v> {
        (0..self.len()).map(move |index| self.get(index))
    }
}

impl<'v> Object<'v> {
    pub(super) fn place(&self) -> Place {
        self.place
    }

    pub(super) fn has(&self, key: &str) -> bool {
        self.members.contains_key(key)
    }

    /// A member converted by `convert`, or a refusal naming `expected`.
    fn typed<T>(
        &self,
        key: &'static str,
        expected: &str,
        convert: impl FnOnce(&'v Value) -> Option<T>,
    ) -> Result<Option<T>, Error> {
        let Some(value) = self.members.get(key) else {
            return Ok(None);
        };
        convert(value).map(Some).ok_or_else(|| {
            let place = self.place.member(key);
            let is = match value {
                Value::Number(number) => format!("`{place}` is {number}, not {expected}"),
                _ => format!("`{place}` is not {expected}"),
            };
            Error::malformed(format!("{is}; {MEND}"))
        })
    }

    /// A count, length, offset, code or index. `24.0` is legal for one.
    pub(super) fn whole(&self, key: &'static str) -> Result<Option<usize>, Error> {
        self.typed(key, "a whole number that could be a count", whole)
    }

    pub(super) fn required_whole(&self, key: &'static str) -> Result<usize, Error> {
        self.whole(key)?.ok_or_else(|| self.missing(key))
    }

    fn missing(&self, key: &'static str) -> Error {
        Error::malformed(format!("`{}` is missing; {MEND}", self.place.member(key)))
    }

    /// An index into `list`.
    pub(super) fn reference(&self, key: &'static str, list: &List<'_>) -> Result<Option<usize>, Error> {
        let index = self.whole(key)?;
        if let Some(index) = index
            && index >= list.len()
        {
            return Err(out_of_range(self.place.member(key), index, list));
        }
        Ok(index)
    }

    pub(super) fn required_reference(&self, key: &'static str, list: &List<'_>) -> Result<usize, Error> {
        self.reference(key, list)?.ok_or_else(|| self.missing(key))
    }

    /// Indices into `list`; none if the member is absent.
    pub(super) fn references(&self, key: &'static str, list: &List<'_>) -> Result<Vec<usize>, Error> {
        let Some(values) = self.typed(key, "an array", Value::as_array)? else {
            return Ok(Vec::new());
        };
        let place = self.place.member(key);
        let mut indices = Vec::with_capacity(values.len());
        for (position, value) in values.iter().enumerate() {
            let index = whole(value)
                .ok_or_else(|| Error::malformed(format!("`{}` is not an index; {MEND}", place.element(position))))?;
            if index >= list.len() {
                return Err(out_of_range(place.element(position), index, list));
            }
            indices.push(index);
        }
        Ok(indices)
    }

    pub(super) fn number(&self, key: &'static str) -> Result<Option<f64>, Error> {
        self.typed(key, "a number", Value::as_f64)
    }

    pub(super) fn numbers<const N: usize>(&self, key: &'static str) -> Result<Option<[f64; N]>, Error> {
        self.typed(key, &format!("an array of {N} numbers"), |value| {
            let values = value.as_array().filter(|values| values.len() == N)?;
            let mut numbers = [0.0; N];
            for (number, value) in numbers.iter_mut().zip(values) {
                *number = value.as_f64()?;
            }
            Some(numbers)
        })
    }

    pub(super) fn boolean(&self, key: &'static str) -> Result<Option<bool>, Error> {
        self.typed(key, "true or false", Value::as_bool)
    }

    pub(super) fn text(&self, key: &'static str) -> Result<Option<&'v str>, Error> {
        self.typed(key, "a string", Value::as_str)
    }

    pub(super) fn texts(&self, key: &'static str) -> Result<Vec<&'v str>, Error> {
        let texts = self.typed(key, "an array of strings", |value| {
            value.as_array()?.iter().map(Value::as_str).collect::<Option<Vec<_>>>()
        })?;
        Ok(texts.unwrap_or_default())
    }

    /// The `name`, unless it is absent, empty, or no string: nothing depends on it.
    pub(super) fn name(&self) -> Option<&'v str> {
        self.members
            .get("name")
            .and_then(Value::as_str)
            .filter(|name| !name.is_empty())
    }

    pub(super) fn object(&self, key: &'static str) -> Result<Option<Self>, Error> {
        let members = self.typed(key, "a JSON object", Value::as_object)?;
        Ok(members.map(|members| Self {
            members,
            place: self.place.member(key),
        }))
    }

    pub(super) fn required_object(&self, key: &'static str) -> Result<Self, Error> {
        self.object(key)?.ok_or_else(|| self.missing(key))
    }

    /// The extension `name` of this object.
    pub(super) fn extension(&self, name: &'static str) -> Result<Option<Self>, Error> {
        match self.object("extensions")? {
            Some(extensions) => extensions.object(name),
            None => Ok(None),
        }
    }

    /// Returns whether this object bears one of the extensions.
    pub(super) fn has_extension(&self, names: &[&str]) -> Result<bool, Error> {
        let extensions = self.object("extensions")?;
        Ok(extensions.is_some_and(|extensions| names.iter().any(|name| extensions.has(name))))
    }

    /// The objects of an array; none if the member is absent.
    pub(super) fn list(&self, key: &'static str) -> Result<List<'v>, Error> {
        let values = self.typed(key, "an array", Value::as_array)?;
        Ok(List {
            values: values.map_or(&[], Vec::as_slice),
            place: self.place.member(key),
        })
    }

    pub(super) fn required_list(&self, key: &'static str) -> Result<List<'v>, Error> {
        if self.has(key) {
            self.list(key)
        } else {
            Err(self.missing(key))
        }
    }
}

/// A whole number from 0 on, also in the form `24.0`.
fn whole(value: &Value) -> Option<usize> {
    let whole = value.as_u64().or_else(|| {
        let float = value
            .as_f64()
            .filter(|f| f.fract() == 0.0 && (0.0..=9_007_199_254_740_992.0).contains(f))?;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole, 0 to 2⁵³")]
        Some(float as u64)
    })?;
    usize::try_from(whole).ok()
}

fn out_of_range(place: Place, index: usize, list: &List<'_>) -> Error {
    Error::malformed(format!(
        "`{place}` is {index}, but the file has {} `{}`; {MEND}",
        list.len(),
        list.place
    ))
}

/// The parts of a glTF file for geometry.
pub(super) struct Document<'v> {
    pub(super) root: Object<'v>,
    pub(super) scenes: List<'v>,
    pub(super) nodes: List<'v>,
    pub(super) meshes: List<'v>,
    pub(super) accessors: List<'v>,
    pub(super) buffer_views: List<'v>,
    pub(super) buffers: List<'v>,
    pub(super) materials: List<'v>,
}

impl<'v> Document<'v> {
    pub(super) fn new(root: &'v Value) -> Result<Self, Error> {
        let members = root
            .as_object()
            .ok_or_else(|| Error::malformed(format!("is not glTF: the JSON is not an object; {MEND}")))?;
        let root = Object {
            members,
            place: Place::ROOT,
        };
        Ok(Self {
            root,
            scenes: root.list("scenes")?,
            nodes: root.list("nodes")?,
            meshes: root.list("meshes")?,
            accessors: root.list("accessors")?,
            buffer_views: root.list("bufferViews")?,
            buffers: root.list("buffers")?,
            materials: root.list("materials")?,
        })
    }
}
