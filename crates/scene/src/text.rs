//! Byte-order marks before a text, for all readers of texts.

use crate::Error;

/// What is said of a text in UTF-16, after its name.
pub(crate) const IS_UTF_16: &str = "is UTF-16 text; save it as UTF-8";

/// The text of a file without UTF-8's byte-order mark, put there by editors and spreadsheets. All of it if there is no
/// mark.
///
/// # Errors
/// When the mark is that of UTF-16 or UTF-32: neither is read.
///
/// ```
/// use hemicube_scene::text::unmarked;
///
/// assert_eq!(unmarked("\u{FEFF}solid s".as_bytes())?, b"solid s");
/// assert_eq!(unmarked(b"solid s")?, b"solid s");
/// let utf_16: Vec<u8> = "\u{FEFF}solid s".encode_utf16().flat_map(u16::to_le_bytes).collect();
/// assert!(unmarked(&utf_16).is_err_and(|error| error.to_string().contains("UTF-8")));
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn unmarked(bytes: &[u8]) -> Result<&[u8], Error> {
    match bytes {
        [0xEF, 0xBB, 0xBF, rest @ ..] => Ok(rest),
        [0xFF, 0xFE, 0, 0, ..] | [0, 0, 0xFE, 0xFF, ..] => Err(Error::unsupported("is UTF-32 text; save it as UTF-8")),
        [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..] => Err(Error::unsupported(IS_UTF_16)),
        _ => Ok(bytes),
    }
}
