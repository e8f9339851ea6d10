//! The `.npy` header: magic, version, and a Python dictionary of element type, order and shape, padded to 64 bytes.
//!
//! ```text
//! 93 'N' 'U' 'M' 'P' 'Y' | major minor | length u16 (major 1) or u32
//! {'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), } ␠…␠ \n
//! ```
//!
//! Own code, because the crate at hand allocates any length claimed by a file, parses the dictionary recursively and
//! multiplies the shape unchecked, and a reader of three kinds of value is short. The crate is a second opinion in the
//! tests. Source: the format's description in NumPy (`numpy.lib.format`).

use std::io::{self, Read};

/// Bytes of the longest header read. NumPy writes 118 for a matrix; only structured types need more.
const HEADER_MAX: usize = 1 << 14;

/// Type of an array's elements, little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElementType {
    /// `<f4`
    F32,
    /// `<f8`
    F64,
    /// `<i4`
    I32,
    /// `<i8`
    I64,
    /// `|u1`
    U8,
    /// `<u2`
    U16,
    /// `<u4`
    U32,
    /// `<u8`
    U64,
    /// Byte strings of a fixed length.
    Bytes(u32),
    /// Unicode strings of a fixed length, 4 bytes a character.
    Text(u32),
}

impl ElementType {
    /// The header of a `.npy` file of elements in C order.
    pub fn npy_header(self, shape: &[u64]) -> Vec<u8> {
        Header::bytes(self, shape)
    }

    /// Bytes of an element.
    pub fn size(self) -> u64 {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::F32 | Self::I32 | Self::U32 => 4,
            Self::F64 | Self::I64 | Self::U64 => 8,
            Self::Bytes(length) => u64::from(length),
            Self::Text(length) => 4 * u64::from(length),
        }
    }

    fn descr(self) -> String {
        match self {
            Self::F32 => "<f4".into(),
            Self::F64 => "<f8".into(),
            Self::I32 => "<i4".into(),
            Self::I64 => "<i8".into(),
            Self::U8 => "|u1".into(),
            Self::U16 => "<u2".into(),
            Self::U32 => "<u4".into(),
            Self::U64 => "<u8".into(),
            Self::Bytes(length) => format!("|S{length}"),
            Self::Text(length) => format!("<U{length}"),
        }
    }

    fn parse(descr: &str) -> Result<Self, String> {
        Ok(match descr {
            "<f4" => Self::F32,
            "<f8" => Self::F64,
            "<i4" => Self::I32,
            "<i8" => Self::I64,
            "|u1" => Self::U8,
            "<u2" => Self::U16,
            "<u4" => Self::U32,
            "<u8" => Self::U64,
            _ => {
                let length = |prefix| descr.strip_prefix(prefix).and_then(|digits| digits.parse::<u16>().ok());
                match (length("|S"), length("<U")) {
                    (Some(length), _) => Self::Bytes(length.into()),
                    (_, Some(length)) => Self::Text(length.into()),
                    _ => {
                        return Err(format!(
                            "has elements of type `{descr}`; save it as little-endian f4 or f8"
                        ));
                    }
                }
            }
        })
    }
}

/// A number that an array can hold.
pub trait Element: Copy {
    /// Element type of an array of them.
    const TYPE: ElementType;
    /// Appends its bytes.
    fn put(self, bytes: &mut Vec<u8>);
    /// Decodes a chunk of exactly the element's size.
    fn get(chunk: &[u8]) -> Self;
}

macro_rules! element {
    ($($number:ty: $kind:ident),*) => {$(
        impl Element for $number {
            const TYPE: ElementType = ElementType::$kind;
            fn put(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
            fn get(chunk: &[u8]) -> Self {
                let mut bytes = [0; size_of::<Self>()];
                bytes.copy_from_slice(chunk);
                Self::from_le_bytes(bytes)
            }
        }
    )*};
}
element!(f32: F32, f64: F64, i32: I32, i64: I64, u8: U8, u16: U16, u32: U32, u64: U64);

/// Decodes all whole elements of `bytes`.
pub fn decode<T: Element>(bytes: &[u8]) -> Vec<T> {
    bytes.chunks_exact(size_of::<T>()).map(T::get).collect()
}

/// Header of a `.npy` file.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// Type of the elements.
    pub element: ElementType,
    /// Whether the first index runs fastest.
    pub fortran_order: bool,
    /// Length along each axis.
    pub shape: Vec<u64>,
    /// Start of the elements, in bytes from the start of the header.
    pub size: u64,
}

impl Header {
    /// Number of elements of the shape, if 64 bits can count them.
    pub fn count(&self) -> Option<u64> {
        self.shape
            .iter()
            .try_fold(1u64, |product, &length| product.checked_mul(length))
    }

    /// The size of the whole array with its header, if 64 bits can count it.
    pub fn total_size(&self) -> Option<u64> {
        self.count()?.checked_mul(self.element.size())?.checked_add(self.size)
    }

    /// The bytes of a header for elements in C order.
    pub fn bytes(element: ElementType, shape: &[u64]) -> Vec<u8> {
        let lengths: String = shape.iter().map(|length| format!("{length}, ")).collect();
        // Python writes a tuple of one with a trailing comma, and of more without.
        let lengths = if shape.len() == 1 {
            lengths.trim_end()
        } else {
            lengths.trim_end_matches(", ")
        };
        let mut text = format!(
            "{{'descr': '{}', 'fortran_order': False, 'shape': ({lengths}), }}",
            element.descr()
        );
        let unpadded = 10 + text.len() + 1;
        text.extend(std::iter::repeat_n(' ', unpadded.next_multiple_of(64) - unpadded));
        text.push('\n');
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        // At most 20 digits for each of at most two lengths.
        #[allow(clippy::cast_possible_truncation, reason = "a header of ours has at most 192 bytes")]
        bytes.extend_from_slice(&(text.len() as u16).to_le_bytes());
        bytes.extend_from_slice(text.as_bytes());
        bytes
    }

    /// Reads a header, and leaves `reader` at the first element.
    ///
    /// The inner error is the reason why the bytes are no header of a readable array.
    pub fn read(reader: &mut impl Read) -> io::Result<Result<Self, String>> {
        let mut start = [0; 8];
        reader.read_exact(&mut start)?;
        if start[..6] != *b"\x93NUMPY" {
            return Ok(Err("is no NumPy array".into()));
        }
        let (length, prefix) = match start[6] {
            1 => {
                let mut length = [0; 2];
                reader.read_exact(&mut length)?;
                (usize::from(u16::from_le_bytes(length)), 10)
            }
            2 | 3 => {
                let mut length = [0; 4];
                reader.read_exact(&mut length)?;
                (usize::try_from(u32::from_le_bytes(length)).unwrap_or(usize::MAX), 12)
            }
            major => {
                return Ok(Err(format!(
                    "has version {major} of NumPy's format, which is not known"
                )));
            }
        };
        if length > HEADER_MAX {
            return Ok(Err(format!("claims a header of {length} bytes")));
        }
        let mut text = vec![0; length];
        reader.read_exact(&mut text)?;
        Ok(Self::parse(&text, prefix + length as u64))
    }

    fn parse(text: &[u8], size: u64) -> Result<Self, String> {
        let text = std::str::from_utf8(text).map_err(|_| "has a header that is not text")?;
        let mut scan = Scan { rest: text };
        let (mut descr, mut fortran_order, mut shape) = (None, None, None);
        scan.expect('{')?;
        while !scan.accept('}') {
            let key = scan.string()?;
            scan.expect(':')?;
            match key {
                "descr" => descr = Some(scan.string()?),
                "fortran_order" => fortran_order = Some(scan.boolean()?),
                "shape" => shape = Some(scan.tuple()?),
                _ => return Err(format!("has a header with an unknown key `{key}`")),
            }
            if !scan.accept(',') {
                scan.expect('}')?;
                break;
            }
        }
        if !scan.rest.trim().is_empty() {
            return Err("has a header with something after its dictionary".into());
        }
        let missing = |key| move || format!("has a header without `{key}`");
        Ok(Self {
            element: ElementType::parse(descr.ok_or_else(missing("descr"))?)?,
            fortran_order: fortran_order.ok_or_else(missing("fortran_order"))?,
            shape: shape.ok_or_else(missing("shape"))?,
            size,
        })
    }
}

/// Remainder of a header's text.
struct Scan<'a> {
    rest: &'a str,
}

impl<'a> Scan<'a> {
    fn accept(&mut self, wanted: char) -> bool {
        self.rest = self.rest.trim_start();
        match self.rest.strip_prefix(wanted) {
            Some(rest) => {
                self.rest = rest;
                true
            }
            None => false,
        }
    }

    fn expect(&mut self, wanted: char) -> Result<(), String> {
        if self.accept(wanted) {
            Ok(())
        } else {
            Err(format!("has a header without the `{wanted}` it should have"))
        }
    }

    fn string(&mut self) -> Result<&'a str, String> {
        let quote = if self.accept('\'') {
            '\''
        } else if self.accept('"') {
            '"'
        } else {
            return Err("has a header for records, not numbers".into());
        };
        let (text, rest) = self.rest.split_once(quote).ok_or("has a header with an open string")?;
        self.rest = rest;
        Ok(text)
    }

    fn boolean(&mut self) -> Result<bool, String> {
        self.rest = self.rest.trim_start();
        for (word, value) in [("True", true), ("False", false)] {
            if let Some(rest) = self.rest.strip_prefix(word) {
                self.rest = rest;
                return Ok(value);
            }
        }
        Err("has a header without True or False as its order".into())
    }

    fn tuple(&mut self) -> Result<Vec<u64>, String> {
        self.expect('(')?;
        let mut lengths = Vec::new();
        while !self.accept(')') {
            self.rest = self.rest.trim_start();
            let end = self.rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(self.rest.len());
            let (digits, rest) = self.rest.split_at(end);
            lengths.push(
                digits
                    .parse()
                    .map_err(|_| "has a header whose shape is not whole numbers")?,
            );
            // Python 2 wrote long integers with a suffix.
            self.rest = rest.strip_prefix('L').unwrap_or(rest);
            if !self.accept(',') {
                self.expect(')')?;
                break;
            }
        }
        Ok(lengths)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn written_headers_read_back_and_are_what_the_reference_crate_reads() {
        for (element, shape) in [
            (ElementType::F32, vec![7]),
            (ElementType::F64, vec![3, 4]),
            (ElementType::U64, vec![u64::from(u32::MAX), 4]),
            (ElementType::Bytes(3), vec![]),
            (ElementType::U8, vec![0]),
        ] {
            let bytes = Header::bytes(element, &shape);
            assert_eq!(bytes.len() % 64, 0);
            let header = Header::read(&mut bytes.as_slice()).unwrap().unwrap();
            assert_eq!(
                (header.element, header.fortran_order, &header.shape),
                (element, false, &shape)
            );
            assert_eq!(header.size, bytes.len() as u64);
            let other = npyz::NpyHeader::from_reader(bytes.as_slice()).unwrap();
            assert_eq!(
                (other.shape(), other.dtype().descr()),
                (shape.as_slice(), format!("'{}'", element.descr()))
            );
        }
    }

    #[test]
    fn hostile_headers_are_refused() {
        let header = |text: &str| {
            let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
            bytes.extend_from_slice(&u16::try_from(text.len()).unwrap().to_le_bytes());
            bytes.extend_from_slice(text.as_bytes());
            bytes
        };
        for text in [
            "",
            "{",
            "{'descr': '<f4', 'fortran_order': False}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (-1,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999999,)}",
            "{'descr': '>f4', 'fortran_order': False, 'shape': (1,)}",
            "{'descr': '|O', 'fortran_order': False, 'shape': (1,)}",
            "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (1,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1,)} (",
        ] {
            assert!(Header::read(&mut header(text).as_slice()).unwrap().is_err(), "{text}");
        }
        let huge = Header::read(
            &mut header("{'descr': '<f4', 'fortran_order': False, 'shape': (4611686018427387904, 4)}").as_slice(),
        );
        assert_eq!(huge.unwrap().unwrap().count(), None);
        let long = [b"\x93NUMPY\x02\x00".as_slice(), &u32::MAX.to_le_bytes()].concat();
        assert!(Header::read(&mut long.as_slice()).unwrap().is_err());
        assert!(Header::read(&mut b"\x93NUM".as_slice()).is_err());
    }
}
