//! The XML formats. Raw bytes at the end of a file are no XML, so the document is cut before `<AppendedData`.

use super::{Cells, Grid, Kind, Piece, Texts, Values, is_group};
use crate::bounds::Bounds;
use crate::cursor::shown;
use crate::{Error, ErrorKind};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use roxmltree::Node;
use std::borrow::Cow;
use std::collections::HashSet;

pub(super) fn read(bytes: &[u8], bounds: &mut Bounds, grid: &mut Grid) -> Result<(), Error> {
    let begin = find(bytes, b"<AppendedData");
    let document: Cow<'_, [u8]> = match begin {
        Some(begin) => Cow::Owned([&bytes[..begin], b"</VTKFile>"].concat()),
        None => Cow::Borrowed(bytes),
    };
    let text = std::str::from_utf8(&document).map_err(|error| {
        let line = document[..error.valid_up_to()].iter().filter(|&&b| b == b'\n').count();
        Error::malformed("is not UTF-8 text before its appended data").at(line as u64 + 1)
    })?;
    let document = crate::formats::parse_xml(text)?;
    let root = document.root_element();
    if root.tag_name().name() != "VTKFile" {
        return Err(at(root, "the root is not `VTKFile`"));
    }
    let appended = match begin {
        Some(begin) => Some(appended(&bytes[begin..])?),
        None => None,
    };
    let mut reader = Reader {
        big: root.attribute("byte_order").is_some_and(|order| order == "BigEndian"),
        header: match root.attribute("header_type") {
            Some("UInt64") => 8,
            _ => 4,
        },
        compressed: match root.attribute("compressor") {
            None | Some("") => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                return Err(unsupported(
                    root,
                    format!(
                        "is compressed by `{}`; save it without compression or by zlib",
                        shown(other.as_bytes())
                    ),
                ));
            }
        },
        appended,
        offsets: document
            .descendants()
            .filter_map(|node| node.attribute("offset")?.trim().parse().ok())
            .collect(),
        inflated: 0,
        taken: HashSet::new(),
        bounds,
    };
    reader.offsets.sort_unstable();
    let kind = root.attribute("type").unwrap_or_default();
    let Some(data) = child(root, kind).filter(|_| kind == "PolyData" || kind == "UnstructuredGrid") else {
        return Err(unsupported(
            root,
            format!(
                "holds `{}`, not PolyData or UnstructuredGrid; extract the surface (in ParaView: Extract Surface) and \
                 open that",
                shown(kind.as_bytes())
            ),
        ));
    };
    for array in arrays(child(data, "FieldData")) {
        if let (Some(name), Some("String")) = (array.attribute("Name"), array.attribute("type"))
            && let Values::Names(names) = reader.array(array)?
        {
            grid.names.insert(name.to_ascii_lowercase(), names);
        }
    }
    for piece in data.children().filter(|node| node.tag_name().name() == "Piece") {
        let read = reader.piece(piece)?;
        grid.add(read).map_err(|error| located(piece, error))?;
    }
    Ok(())
}

fn find(bytes: &[u8], what: &[u8]) -> Option<usize> {
    let first = what.first()?;
    let mut from = 0;
    loop {
        from += bytes.get(from..)?.iter().position(|byte| byte == first)?;
        if bytes[from..].starts_with(what) {
            return Some(from);
        }
        from += 1;
    }
}

/// The appended data, and whether it is base64.
fn appended(section: &[u8]) -> Result<(&[u8], bool), Error> {
    let missing = || Error::malformed("`AppendedData` has no `_` before its data; the file is cut short");
    let tag = section.iter().position(|&byte| byte == b'>').ok_or_else(missing)?;
    let base64 = find(&section[..tag], b"base64").is_some();
    let mark = section[tag..]
        .iter()
        .position(|&byte| byte == b'_')
        .ok_or_else(missing)?;
    Ok((&section[tag + mark + 1..], base64))
}

fn at(node: Node<'_, '_>, reason: impl Into<String>) -> Error {
    Error::malformed(reason).at(u64::from(node.document().text_pos_at(node.range().start).row))
}

fn unsupported(node: Node<'_, '_>, reason: String) -> Error {
    let mut error = at(node, "");
    error.kind = ErrorKind::Unsupported(reason);
    error
}

/// An error with the line of an element, unless it has one.
fn located(node: Node<'_, '_>, error: Error) -> Error {
    let line = error.line.or(at(node, "").line);
    Error { line, ..error }
}

fn child<'a, 'input>(node: Node<'a, 'input>, name: &str) -> Option<Node<'a, 'input>> {
    node.children().find(|child| child.tag_name().name() == name)
}

fn arrays<'a, 'input>(node: Option<Node<'a, 'input>>) -> impl Iterator<Item = Node<'a, 'input>> {
    node.into_iter()
        .flat_map(|node| node.children())
        .filter(|node| matches!(node.tag_name().name(), "DataArray" | "Array"))
}

struct Reader<'a> {
    big: bool,
    /// Bytes of the numbers before an array.
    header: usize,
    compressed: bool,
    appended: Option<(&'a [u8], bool)>,
    /// Where the appended arrays begin, sorted.
    offsets: Vec<usize>,
    /// Bytes that came of compressed ones so far.
    inflated: u64,
    /// Where arrays begin that were read before: pieces may share them.
    taken: HashSet<usize>,
    bounds: &'a mut Bounds,
}

impl Reader<'_> {
    fn piece(&mut self, node: Node<'_, '_>) -> Result<Piece, Error> {
        let mut piece = Piece::default();
        if let Some(points) = arrays(child(node, "Points")).next() {
            piece.points = self
                .array(points)?
                .reals("coordinates")
                .map_err(|error| located(points, error))?;
        }
        for (name, kind) in [
            ("Verts", Kind::Lesser("vertex cell")),
            ("Lines", Kind::Lesser("line cell")),
            ("Polys", Kind::Polygons),
            ("Strips", Kind::Strips),
            ("Cells", Kind::Types(Vec::new())),
        ] {
            let Some(node) = child(node, name) else { continue };
            let mut named = |name: &str| {
                let array = arrays(Some(node)).find(|array| array.attribute("Name") == Some(name));
                let array = array.ok_or_else(|| at(node, format!("the array `{name}` is missing")))?;
                self.array(array)?
                    .wholes("points of cells")
                    .map_err(|error| located(array, error))
            };
            let (points, ends) = (named("connectivity")?, named("offsets")?);
            let kind = match kind {
                Kind::Types(_) => Kind::Types(named("types")?),
                kind => kind,
            };
            piece.cells.push(Cells { kind, points, ends });
        }
        for array in arrays(child(node, "CellData")) {
            let name = array.attribute("Name").unwrap_or_default();
            let components = array.attribute("NumberOfComponents").unwrap_or("1").trim();
            if is_group(name) && components == "1" {
                let values = self.array(array)?;
                piece.cell_data.push((name.to_owned(), values));
            }
        }
        Ok(piece)
    }

    fn array(&mut self, node: Node<'_, '_>) -> Result<Values, Error> {
        let kind = node.attribute("type").unwrap_or_default();
        let (size, real, signed) = match kind {
            "Int8" => (1, false, true),
            "UInt8" | "String" => (1, false, false),
            "Int16" => (2, false, true),
            "UInt16" => (2, false, false),
            "Int32" => (4, false, true),
            "UInt32" => (4, false, false),
            "Int64" => (8, false, true),
            "UInt64" => (8, false, false),
            "Float32" => (4, true, true),
            "Float64" => (8, true, true),
            other => {
                return Err(at(
                    node,
                    format!("`{}` is no type of an array", shown(other.as_bytes())),
                ));
            }
        };
        let values = match node.attribute("format").unwrap_or("ascii") {
            "ascii" => words(node, node.text().unwrap_or_default(), real)?,
            "binary" => {
                let bytes =
                    decoded(node.text().unwrap_or_default().as_bytes()).map_err(|error| located(node, error))?;
                let bytes = self.payload(&bytes).map_err(|error| located(node, error))?;
                numbers(&bytes, size, real, signed, self.big)
            }
            "appended" => {
                let bytes = self.appended(node).map_err(|error| located(node, error))?;
                numbers(&bytes, size, real, signed, self.big)
            }
            other => {
                return Err(at(
                    node,
                    format!("`{}` is no format of an array", shown(other.as_bytes())),
                ));
            }
        };
        Ok(match values {
            // Bytes of names, with a 0 after each.
            Values::Whole(bytes) if kind == "String" => {
                let bytes: Vec<u8> = bytes.iter().map(|&byte| u8::try_from(byte).unwrap_or(b'?')).collect();
                let mut names = Texts::default();
                let whole = bytes.strip_suffix(&[0]).unwrap_or(&bytes);
                for name in whole.split(|&byte| byte == 0).filter(|_| !bytes.is_empty()) {
                    names.push(&String::from_utf8_lossy(name));
                }
                Values::Names(names)
            }
            values => values,
        })
    }

    /// The bytes of an array at the end of the file.
    fn appended(&mut self, node: Node<'_, '_>) -> Result<Vec<u8>, Error> {
        let offset = node
            .attribute("offset")
            .and_then(|offset| offset.trim().parse::<usize>().ok());
        let (Some((data, base64)), Some(offset)) = (self.appended, offset) else {
            return Err(Error::malformed(
                "an appended array without an offset or without data at the end of the file",
            ));
        };
        let data = data.get(offset..).ok_or_else(|| {
            Error::malformed(format!(
                "offset {offset} lies beyond the end of the file; it is cut short"
            ))
        })?;
        let again = !self.taken.insert(offset);
        if !base64 {
            let bytes = self.payload(data)?;
            return self.once_more(again, bytes);
        }
        let after = self.offsets.partition_point(|&other| other <= offset);
        let end = self
            .offsets
            .get(after)
            .map_or(data.len(), |next| next - offset)
            .min(data.len());
        let text = data[..end].split(|&byte| byte == b'<').next().unwrap_or_default();
        let bytes = self.payload(&decoded(text)?)?;
        self.once_more(again, bytes)
    }

    /// Counts the numbers of an array that was read before.
    fn once_more(&mut self, again: bool, bytes: Vec<u8>) -> Result<Vec<u8>, Error> {
        if again {
            self.bounds.copied(8 * bytes.len() as u64)?;
        }
        Ok(bytes)
    }

    /// The bytes of an array from what the file has: a count and the bytes, or counts and compressed blocks.
    fn payload(&mut self, bytes: &[u8]) -> Result<Vec<u8>, Error> {
        let short = || Error::malformed("the bytes of an array end early; the file is cut short or damaged");
        // An empty array may have no header.
        if bytes.is_empty() {
            return Ok(Vec::new());
        }
        let number = |at: usize| {
            let bytes = bytes
                .get(at * self.header..)
                .and_then(|rest| rest.get(..self.header))
                .ok_or_else(short)?;
            let Values::Whole(numbers) = numbers(bytes, self.header, false, false, self.big) else {
                return Err(short());
            };
            usize::try_from(*numbers.first().ok_or_else(short)?).map_err(|_| short())
        };
        let first = number(0)?;
        if !self.compressed {
            let data = bytes.get(self.header..).and_then(|rest| rest.get(..first));
            return Ok(data.ok_or_else(short)?.to_vec());
        }
        if first > bytes.len() / self.header {
            return Err(short());
        }
        // Sizes of a block and of the last, if that is another.
        let (block, last) = if first == 0 { (0, 0) } else { (number(1)?, number(2)?) };
        let mut begin = (3 + first) * self.header;
        let mut data = Vec::new();
        for at in 0..first {
            let size = if at + 1 == first && last != 0 { last } else { block };
            self.inflated = self.inflated.saturating_add(size as u64);
            self.bounds.inflated(self.inflated)?;
            let packed = number(3 + at)?;
            let packed = bytes
                .get(begin..)
                .and_then(|rest| rest.get(..packed))
                .ok_or_else(short)?;
            begin += packed.len();
            let unpacked = miniz_oxide::inflate::decompress_to_vec_zlib_with_limit(packed, size);
            let unpacked = unpacked.map_err(|_| Error::malformed(format!("block {at} of an array is no zlib data")))?;
            if unpacked.len() != size {
                return Err(short());
            }
            data.extend(unpacked);
        }
        Ok(data)
    }
}

/// The numbers of an array in text.
fn words(node: Node<'_, '_>, text: &str, real: bool) -> Result<Values, Error> {
    let wrong = |word: &str| at(node, format!("`{}` in an array of numbers", shown(word.as_bytes())));
    let words = text.split_ascii_whitespace();
    let count = words.clone().count();
    if real {
        let mut numbers = Vec::with_capacity(count);
        for word in words {
            numbers.push(word.parse().map_err(|_| wrong(word))?);
        }
        return Ok(Values::Real(numbers));
    }
    let mut numbers = Vec::with_capacity(count);
    for word in words {
        numbers.push(word.parse().map_err(|_| wrong(word))?);
    }
    Ok(Values::Whole(numbers))
}

/// Bytes of base64. The header is encoded on its own or with the data, so `=` may stand in the middle.
fn decoded(text: &[u8]) -> Result<Vec<u8>, Error> {
    let text: Vec<u8> = text
        .iter()
        .copied()
        .filter(|byte| !byte.is_ascii_whitespace())
        .collect();
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    for part in text.chunk_by(|&a, &b| a != b'=' || b == b'=') {
        STANDARD
            .decode_vec(part, &mut bytes)
            .map_err(|error| Error::malformed(format!("an array is no base64: {error}")))?;
    }
    Ok(bytes)
}

/// Numbers of `size` bytes; bytes that are left over are none.
pub(super) fn numbers(bytes: &[u8], size: usize, real: bool, signed: bool, big: bool) -> Values {
    let bits = |chunk: &[u8]| {
        let add = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
        if big {
            chunk.iter().fold(0, add)
        } else {
            chunk.iter().rev().fold(0, add)
        }
    };
    let chunks = bytes.chunks_exact(size);
    #[allow(clippy::cast_possible_truncation, reason = "a number of 32 bits")]
    match (real, size) {
        (true, 4) => Values::Real(
            chunks
                .map(|chunk| f64::from(f32::from_bits(bits(chunk) as u32)))
                .collect(),
        ),
        (true, _) => Values::Real(chunks.map(|chunk| f64::from_bits(bits(chunk))).collect()),
        (false, _) => {
            let unused = 64 - 8 * size.clamp(1, 8);
            let whole = |chunk: &[u8]| {
                let shifted = bits(chunk) << unused;
                if signed {
                    shifted.cast_signed() >> unused
                } else {
                    (shifted >> unused).cast_signed()
                }
            };
            Values::Whole(chunks.map(whole).collect())
        }
    }
}
