//! Arrays in a page: little-endian, deflated, in base64, each in a `<script>` that no browser runs.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use serde::Serialize;

/// zlib's default: higher levels take several times as long for a per cent.
const LEVEL: u8 = 6;

/// A number in a block.
pub(super) trait Number: Copy {
    const NAME: &'static str;
    fn put(self, bytes: &mut Vec<u8>);
}

impl Number for u16 {
    const NAME: &'static str = "u16";
    fn put(self, bytes: &mut Vec<u8>) {
        bytes.extend_from_slice(&self.to_le_bytes());
    }
}

impl Number for u32 {
    const NAME: &'static str = "u32";
    fn put(self, bytes: &mut Vec<u8>) {
        bytes.extend_from_slice(&self.to_le_bytes());
    }
}

impl Number for f32 {
    const NAME: &'static str = "f32";
    fn put(self, bytes: &mut Vec<u8>) {
        bytes.extend_from_slice(&self.to_le_bytes());
    }
}

/// The viewer's description of an array with a number a patch.
#[derive(Debug, Serialize)]
pub(super) struct Column {
    name: String,
    #[serde(rename = "type")]
    number: &'static str,
}

/// The blocks of a page.
#[derive(Debug, Default)]
pub(super) struct Blocks {
    /// Arrays with a number a patch.
    pub(super) columns: Vec<Column>,
    /// HTML of the blocks.
    pub(super) html: String,
}

impl Blocks {
    /// Adds an array with a number a patch.
    pub(super) fn add<T: Number>(&mut self, name: &str, numbers: &[T]) {
        self.columns.push(Column {
            name: name.to_owned(),
            number: T::NAME,
        });
        self.array(name, numbers);
    }

    /// Adds another array.
    pub(super) fn array<T: Number>(&mut self, name: &str, numbers: &[T]) {
        let mut bytes = Vec::with_capacity(size_of_val(numbers));
        for &number in numbers {
            number.put(&mut bytes);
        }
        self.bytes(name, &bytes);
    }

    /// Adds bytes of another form.
    pub(super) fn bytes(&mut self, name: &str, bytes: &[u8]) {
        let packed = BASE64.encode(miniz_oxide::deflate::compress_to_vec(bytes, LEVEL));
        self.html
            .push_str("<script type=\"application/octet-stream\" id=\"block-");
        self.html.push_str(name);
        self.html.push_str("\">");
        self.html.push_str(&packed);
        self.html.push_str("</script>\n");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base_64_as_in_the_rfc() {
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(BASE64.encode(bytes), text);
        }
    }
}
