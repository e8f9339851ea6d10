//! Buffers: the BIN chunk, `data:` URIs (RFC 2397, base64 of RFC 4648), and files beside the scene.

use super::json::Document;
use super::{MEND, extension};
use crate::{Error, ErrorKind};
use base64::alphabet;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use base64::{DecodeError, Engine as _};
use std::borrow::Cow;
use std::io::{self, Read};
use std::path::Path;

/// The bytes of a buffer: at least `byteLength`.
pub(super) fn open<'a>(
    document: &Document<'_>,
    index: usize,
    bin: Option<&'a [u8]>,
    base_dir: Option<&Path>,
) -> Result<Cow<'a, [u8]>, Error> {
    let buffer = document.buffers.get(index)?;
    let length = buffer.required_whole("byteLength")?;
    let place = buffer.place();
    let bytes = match buffer.text("uri")? {
        None => match bin {
            Some(bin) if index == 0 => Cow::Borrowed(bin),
            _ if buffer.has_extension(&extension::MESHOPT)? => {
                return Err(extension::meshopt(&format!("`{place}`"), extension::MESHOPT[0]));
            }
            _ => {
                return Err(Error::malformed(format!(
                    "`{place}` has no `uri`, and there is no BIN chunk that would be its bytes; {MEND}"
                )));
            }
        },
        Some(uri) => match uri.get(..5) {
            Some(scheme) if scheme.eq_ignore_ascii_case("data:") => {
                Cow::Owned(from_data_uri(&uri[5..]).map_err(|reason| {
                    Error::malformed(format!(
                        "`{place}.uri` is a data URI that cannot be read: {reason}; {MEND}"
                    ))
                })?)
            }
            _ => Cow::Owned(from_file(uri, index, length, base_dir)?),
        },
    };
    if bytes.len() < length {
        return Err(Error::malformed(format!(
            "`{place}` has {} bytes, but its `byteLength` is {length}; fetch or export the file again",
            bytes.len()
        )));
    }
    Ok(bytes)
}

/// The bytes of a data URI, after `data:`.
fn from_data_uri(uri: &str) -> Result<Vec<u8>, String> {
    let (kind, payload) = uri.split_once(',').ok_or("no comma")?;
    if !kind.to_ascii_lowercase().ends_with(";base64") {
        return Err("only base64 is read".to_owned());
    }
    from_base64(payload)
}

/// Decodes base64, with or without the padding at the end. Bits after the last byte are ignored.
fn from_base64(text: &str) -> Result<Vec<u8>, String> {
    const CONFIG: GeneralPurposeConfig = GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true);
    const ENGINE: GeneralPurpose = GeneralPurpose::new(&alphabet::STANDARD, CONFIG);
    ENGINE.decode(text).map_err(|error| match error {
        DecodeError::InvalidByte(position, _) => format!("character {position} is no base64 digit"),
        _ => "the base64 text is cut off".to_owned(),
    })
}

/// The first `length` bytes of a file in the scene's folder or below it.
fn from_file(uri: &str, index: usize, length: usize, base_dir: Option<&Path>) -> Result<Vec<u8>, Error> {
    let name = percent_decoded(uri).ok_or_else(|| {
        Error::malformed(format!(
            "`buffers[{index}].uri` is `{}`, which does not decode to a file name; {MEND}",
            super::cut(uri)
        ))
    })?;
    let shown = super::cut(&name);
    // Both as written and decoded: neither form may be an address elsewhere.
    if is_absolute(uri) || is_absolute(&name) {
        return Err(Error::unsupported(format!(
            "`buffers[{index}].uri` is the absolute address `{shown}`, which is not followed; put the buffer beside \
             the scene and name it there, or export as `.glb`"
        )));
    }
    let Some(base_dir) = base_dir else {
        return Err(Error::unsupported(format!(
            "`buffers[{index}]` is the file `{shown}`, but the scene was not read from a folder; export as `.glb`"
        )));
    };
    let failed = |e: io::Error| {
        let message = format!("`buffers[{index}]` in `{shown}`: {e}; put the file beside the scene");
        Error::new(ErrorKind::Io(io::Error::new(e.kind(), message)))
    };
    let file = crate::regular::open_beside(base_dir, &name).map_err(failed)?;
    let found = file.metadata().map_err(failed)?.len();
    if found < length as u64 {
        return Err(Error::malformed(format!(
            "`buffers[{index}]` in `{shown}` has {found} bytes, but its `byteLength` is {length}; fetch or export the \
             file again"
        )));
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(length).map_err(|_| {
        Error::new(ErrorKind::TooLarge(format!(
            "the {length} bytes of `buffers[{index}]` do not fit in this machine's memory; split the scene"
        )))
    })?;
    file.take(length as u64).read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes)
}

/// Returns whether an address has a scheme, such as `file:` or a drive's letter, or begins at a root.
fn is_absolute(address: &str) -> bool {
    let has_scheme = address.split_once(':').is_some_and(|(scheme, _)| {
        scheme.starts_with(|c: char| c.is_ascii_alphabetic())
            && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
    });
    has_scheme || address.starts_with(['/', '\\'])
}

/// Percent-decoding (RFC 3986, 2.1). A `%` without two digits stands for itself, for files of writers that never
/// encoded.
fn percent_decoded(uri: &str) -> Option<String> {
    let hex = |byte: Option<&u8>| {
        char::from(*byte?)
            .to_digit(16)
            .and_then(|digit| u8::try_from(digit).ok())
    };
    let source = uri.as_bytes();
    let mut bytes = Vec::with_capacity(source.len());
    let mut position = 0;
    while let Some(&byte) = source.get(position) {
        match (byte, hex(source.get(position + 1)), hex(source.get(position + 2))) {
            (b'%', Some(high), Some(low)) => {
                bytes.push(high << 4 | low);
                position += 3;
            }
            _ => {
                bytes.push(byte);
                position += 1;
            }
        }
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_reads_rfc_4648_vectors_with_and_without_padding() {
        let pairs = [
            ("", ""),
            ("Zg==", "f"),
            ("Zm8=", "fo"),
            ("Zm9v", "foo"),
            ("Zm9vYg==", "foob"),
            ("Zm9vYmE=", "fooba"),
            ("Zm9vYmFy", "foobar"),
        ];
        for (text, bytes) in pairs {
            assert_eq!(from_base64(text).as_deref(), Ok(bytes.as_bytes()));
            assert_eq!(from_base64(text.trim_end_matches('=')).as_deref(), Ok(bytes.as_bytes()));
        }
        assert_eq!(from_base64("+/+/").as_deref(), Ok(&[0xfb, 0xff, 0xbf][..]));
        for wrong in ["Z", "Zm9v!", "Zg===", "Zm 9", "Z=9v"] {
            assert!(from_base64(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn percent_decoding_leaves_what_was_never_encoded() {
        assert_eq!(percent_decoded("a%20b%2Ec").as_deref(), Some("a b.c"));
        assert_eq!(percent_decoded("100%.bin").as_deref(), Some("100%.bin"));
        assert_eq!(percent_decoded("%4").as_deref(), Some("%4"));
        assert_eq!(percent_decoded("%ff"), None);
    }
}
