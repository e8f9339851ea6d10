//! Files in TOML that people write: their errors name the line.

use crate::exit::hinted;
use crate::report::size;
use anyhow::{Context, Result, anyhow};
use serde::de::DeserializeOwned;
use std::path::Path;

/// Bytes of such a file, at most: 70 times as many in memory. A choice: a hundred thousand tables.
const BYTES_MAX: u64 = 8_000_000;

/// Reads a file of `what` ("materials").
///
/// # Errors
/// When it cannot be read, is no regular file, or is not such a file: by `path:line:`.
pub(crate) fn read<T: DeserializeOwned>(path: &Path, what: &str) -> Result<T> {
    let cannot = || format!("`{}` cannot be read", path.display());
    let bytes = std::fs::metadata(path).with_context(cannot)?.len();
    if bytes > BYTES_MAX {
        return Err(hinted(
            anyhow!(
                "`{}` has {}, and a file of {what} at most {}: a table takes 70 times its text in memory",
                path.display(),
                size(bytes),
                size(BYTES_MAX)
            ),
            "patterns such as `[object.\"wall*\"]` stand for many names, and `[default]` for all others",
        ));
    }
    let text =
        hemicube_scene::read_regular_text(path).with_context(|| format!("`{}` cannot be read", path.display()))?;
    parse(&text).map_err(|(line, reason)| anyhow!("{}:{line}: it is no file of {what}: {reason}", path.display()))
}

/// The value, or the line of the error, from 1, and its reason on one line.
fn parse<T: DeserializeOwned>(text: &str) -> Result<T, (usize, String)> {
    toml::from_str(text).map_err(|error: toml::de::Error| {
        let span = error.span().unwrap_or_default();
        let before = text.get(..span.start).unwrap_or_default();
        let mut reason = error.message().trim().replace('\n', ", ");
        // The message leaves out which.
        if reason == "duplicate key"
            && let Some(key) = text.get(span)
        {
            reason = format!("{reason} `{}`", key.trim());
        }
        (1 + before.matches('\n').count(), reason)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_the_line_and_the_key() {
        let wrong = |text: &str| parse::<toml::Table>(text).unwrap_err();
        assert_eq!(wrong("a = 1\nb = 2\na = 3\n"), (3, "duplicate key `a`".into()));
        assert_eq!(wrong("a = 1\nb =\n").0, 2);
        assert!(parse::<toml::Table>("a = 1\n").is_ok());
    }
}
