//! A place in the bytes of a file that is text, binary, or text with binary sections: words, lines and numbers from it,
//! and errors that say where they stopped.

use crate::Error;

/// Characters of a word shown in an error.
const SHOWN: usize = 40;

/// A place in a file.
#[derive(Clone)]
pub(crate) struct Cursor<'a> {
    bytes: &'a [u8],
    /// Bytes before the place.
    pub(crate) at: usize,
    /// Numbers are binary, and errors name the byte instead of the line.
    pub(crate) binary: bool,
    /// Binary numbers have their highest byte first.
    pub(crate) big: bool,
}

impl<'a> Cursor<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes,
            at: 0,
            binary: false,
            big: false,
        }
    }

    pub(crate) fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    /// An error at this place: with its line in text, with its byte in binary.
    pub(crate) fn fail(&self, reason: impl std::fmt::Display) -> Error {
        if self.binary {
            return Error::malformed(format!("at byte {}: {reason}", self.at));
        }
        // The text read so far ends before the place, often with its line.
        let before = self.bytes.get(..self.at.min(self.bytes.len())).unwrap_or_default();
        let before = before.strip_suffix(b"\n").unwrap_or(before);
        let ends = before.iter().filter(|&&byte| byte == b'\n').count();
        Error::malformed(reason.to_string()).at(ends as u64 + 1)
    }

    /// The next line without its end; `None` at the end of the file.
    pub(crate) fn line(&mut self) -> Option<&'a [u8]> {
        let rest = self.rest();
        if rest.is_empty() {
            return None;
        }
        let end = rest.iter().position(|&byte| byte == b'\n');
        self.at += end.map_or(rest.len(), |end| end + 1);
        let line = rest.get(..end.unwrap_or(rest.len())).unwrap_or_default();
        Some(line.strip_suffix(b"\r").unwrap_or(line))
    }

    /// The next word, on this line or a later one.
    pub(crate) fn word(&mut self) -> Option<&'a [u8]> {
        let rest = self.rest();
        let begin = rest.iter().position(|byte| !byte.is_ascii_whitespace())?;
        let word = rest.get(begin..)?;
        let length = word.iter().position(u8::is_ascii_whitespace).unwrap_or(word.len());
        self.at += begin + length;
        word.get(..length)
    }

    /// The words left on this line of a text; none in binary.
    #[cfg(feature = "gmsh")]
    pub(crate) fn words_left(&self) -> usize {
        if self.binary {
            return 0;
        }
        let line = self.rest().split(|&byte| byte == b'\n').next().unwrap_or_default();
        line.split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty())
            .count()
    }

    pub(crate) fn bytes(&mut self, count: usize) -> Result<&'a [u8], Error> {
        let bytes = self.rest().get(..count).ok_or_else(|| self.cut_short())?;
        self.at += count;
        Ok(bytes)
    }

    fn chunk<const N: usize>(&mut self) -> Result<[u8; N], Error> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.bytes(N)?);
        if self.big {
            bytes.reverse();
        }
        Ok(bytes)
    }

    pub(crate) fn cut_short(&self) -> Error {
        self.fail("the file ends where a number is due; it is cut short, get the whole of it")
    }

    fn parsed<T: std::str::FromStr>(&mut self, what: &str) -> Result<T, Error> {
        let Some(word) = self.word() else {
            return Err(self.cut_short());
        };
        let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        number.ok_or_else(|| self.fail(format!("`{}` where {what} is due", shown(word))))
    }

    /// A whole number: a word, or `size` bytes (4 or 8).
    pub(crate) fn whole(&mut self, size: usize) -> Result<i64, Error> {
        match (self.binary, size) {
            (false, _) => self.parsed("a whole number"),
            (true, 4) => Ok(i64::from(i32::from_le_bytes(self.chunk()?))),
            (true, _) => Ok(i64::from_le_bytes(self.chunk()?)),
        }
    }

    /// A count: a whole number that is not negative, and not above the bytes that are left, because what is counted
    /// takes a byte or more.
    pub(crate) fn count(&mut self, size: usize) -> Result<usize, Error> {
        let number = self.whole(size)?;
        match usize::try_from(number) {
            Ok(count) if count <= self.rest().len() => Ok(count),
            _ => Err(self.fail(format!(
                "{number} things are announced, and {} bytes are left; the file is cut short or damaged",
                self.rest().len()
            ))),
        }
    }

    /// A number of f64.
    pub(crate) fn real(&mut self) -> Result<f64, Error> {
        if self.binary {
            return Ok(f64::from_le_bytes(self.chunk()?));
        }
        self.parsed("a number")
    }
}

/// A word for an error.
pub(crate) fn shown(word: &[u8]) -> String {
    let text = String::from_utf8_lossy(word);
    text.chars().take(SHOWN).collect::<String>().escape_debug().to_string()
}
