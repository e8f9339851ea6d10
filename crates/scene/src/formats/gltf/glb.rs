//! The GLB container (glTF 2.0, section 4), little-endian:
//!
//! ```text
//! header  "glTF"  version u32  length u32 (whole file)
//! chunk   length u32  type u32  data ...              first JSON, then at most one BIN, others are skipped
//! ```

use super::MEND;
use crate::{Error, Ledger};

/// The contents of a `.gltf` or `.glb` file.
pub(super) struct Container<'a> {
    pub(super) json: &'a [u8],
    /// The BIN chunk of a GLB.
    pub(super) bin: Option<&'a [u8]>,
    /// True if the file is JSON text, so that line numbers mean something.
    pub(super) text: bool,
}

const JSON: u32 = 0x4e4f_534a;
const BIN: u32 = 0x004e_4942;

/// Splits a file, taken for a GLB if it begins like one.
pub(super) fn open<'a>(bytes: &'a [u8], ledger: &mut Ledger) -> Result<Container<'a>, Error> {
    if bytes.is_empty() {
        return Err(Error::malformed("is empty; export the scene again"));
    }
    let Some(after_magic) = bytes.strip_prefix(b"glTF") else {
        return Ok(Container {
            json: bytes,
            bin: None,
            text: true,
        });
    };
    let (Some((version, rest)), Some(length)) = (
        word(after_magic),
        word(after_magic)
            .and_then(|(_, rest)| word(rest))
            .map(|(length, _)| length),
    ) else {
        return Err(Error::malformed(format!(
            "is a GLB cut off inside its 12-byte header, after {} bytes; fetch the file again",
            bytes.len()
        )));
    };
    if version != 2 {
        return Err(Error::unsupported(format!(
            "is a GLB of version {version}; only version 2 is read: convert the file to glTF 2.0"
        )));
    }
    let length = usize::try_from(length).unwrap_or(usize::MAX);
    if length < 12 {
        return Err(Error::malformed(format!(
            "the GLB header claims {length} bytes, less than the header; {MEND}"
        )));
    }
    if length > bytes.len() {
        return Err(Error::malformed(format!(
            "the GLB header claims {length} bytes, but the file has {}: it is cut off; fetch the file again",
            bytes.len()
        )));
    }
    ledger.note_many("byte after the end of the GLB", (bytes.len() - length) as u64);

    // `rest` still begins with the length; the chunks follow it.
    let mut rest = rest.get(4..length - 8).unwrap_or_default();
    let (mut json, mut bin) = (None, None);
    let mut number = 0;
    while !rest.is_empty() {
        let Some((size, (kind, body))) = word(rest).and_then(|(size, rest)| Some((size, word(rest)?))) else {
            return Err(Error::malformed(format!(
                "chunk {number} of the GLB is cut off inside its header; {MEND}"
            )));
        };
        let size = usize::try_from(size).unwrap_or(usize::MAX);
        let Some((chunk, after)) = body.split_at_checked(size) else {
            return Err(Error::malformed(format!(
                "chunk {number} of the GLB claims {size} bytes, but {} are left; fetch or export the file again",
                body.len()
            )));
        };
        match kind {
            JSON if number == 0 => json = Some(chunk),
            _ if number == 0 => {
                return Err(Error::malformed(format!(
                    "the first chunk of the GLB is not its JSON; {MEND}"
                )));
            }
            JSON => return Err(Error::malformed(format!("the GLB has a second JSON chunk; {MEND}"))),
            BIN if bin.is_some() => return Err(Error::malformed(format!("the GLB has a second BIN chunk; {MEND}"))),
            BIN => bin = Some(chunk),
            _ => ledger.note("GLB chunk of another kind"),
        }
        rest = after;
        number += 1;
    }
    let json = json.ok_or_else(|| Error::malformed(format!("the GLB has no JSON chunk; {MEND}")))?;
    Ok(Container { json, bin, text: false })
}

fn word(bytes: &[u8]) -> Option<(u32, &[u8])> {
    let (word, rest) = bytes.split_first_chunk()?;
    Some((u32::from_le_bytes(*word), rest))
}
