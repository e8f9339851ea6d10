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
        let message = error.message().trim();
        let value = text.get(span.clone()).unwrap_or_default();
        let mut reason = plain(message, before, value).unwrap_or_else(|| message.replace('\n', ", "));
        // The message leaves out which.
        if reason == "duplicate key"
            && let Some(key) = text.get(span)
        {
            reason = format!("{reason} `{}`", key.trim());
        }
        (1 + before.matches('\n').count(), reason)
    })
}

/// Longest value that an error repeats, in characters.
const VALUE_SHOWN: usize = 40;

/// The reason in plain words, where a value is of another kind than its key takes: the key, the value, what is needed.
fn plain(message: &str, before: &str, value: &str) -> Option<String> {
    let needed = match message.strip_prefix("invalid type: ") {
        Some(kinds) => match kinds.rsplit_once(", expected ")?.1 {
            "f64" => "a number is needed",
            "a boolean" => "true or false is needed",
            "a string" => "a text in quotes is needed",
            "a sequence" => "a list is needed",
            kind if kind == "a map" || kind.starts_with("struct ") => "a table of keys is needed",
            _ => return None,
        },
        // What a value of several kinds says of itself.
        None => Some(message).filter(|message| message.ends_with(" is needed") && !message.starts_with('`'))?,
    };
    let value = match value.trim() {
        value if value.is_empty() || value.contains('\n') || value.chars().count() > VALUE_SHOWN => "of another kind",
        value => &format!("`{value}`"),
    };
    // What stands between the key and the value is blank, or the beginning of a list that the value is in.
    let key = before.rsplit_once('=').and_then(|(left, between)| {
        let is_of_key = between.trim().is_empty() || between.trim_start().starts_with('[') && !between.contains(']');
        let key = left.rsplit(['\n', '{', ',']).next().unwrap_or(left).trim();
        (is_of_key && !key.is_empty()).then_some(key)
    });
    Some(match key {
        Some(key) => format!("`{key}` is {value}; {needed}"),
        None => format!("a value is {value}; {needed}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube::solve::Tables;

    #[test]
    fn a_value_of_another_kind_is_told_by_its_key_in_plain_words() {
        let kelvin = "a number of kelvin, or a text such as \"20 °C\", is needed";
        let spectrum = "one number, or a list with one for each band, is needed";
        for (line, told) in [
            ("temperature = [300]", format!("`temperature` is `[300]`; {kelvin}")),
            ("reflectance = 'x'", format!("`reflectance` is `'x'`; {spectrum}")),
            (
                "emission = [0.1, true]",
                format!("`emission` is `[0.1, true]`; {spectrum}"),
            ),
            ("heat = '3'", "`heat` is `'3'`; a number is needed".to_owned()),
            (
                "adiabatic = 1",
                "`adiabatic` is `1`; true or false is needed".to_owned(),
            ),
            ("body = 3", "`body` is `3`; a text in quotes is needed".to_owned()),
            (
                "[material]\nwall = 0.5",
                "`wall` is `0.5`; a table of keys is needed".to_owned(),
            ),
            (
                "[material]\nwall = { flux = 1, heat = [3] }",
                "`heat` is `[3]`; a number is needed".to_owned(),
            ),
        ] {
            let (at, reason) = parse::<Tables>(&format!("[default]\n{line}\n")).unwrap_err();
            assert_eq!((at, &*reason), (1 + line.lines().count(), &*told), "{line}");
        }
        let (at, reason) = parse::<Tables>("bands = [\"a\", 3]\n").unwrap_err();
        assert_eq!((at, &*reason), (1, "`bands` is `3`; a text in quotes is needed"));
        // Those of other errors stay.
        let reason = parse::<Tables>("[default]\ntemperature = 'warm'\n").unwrap_err().1;
        assert!(reason.starts_with("`warm` is no temperature"), "{reason}");
        let reason = parse::<Tables>("[[object]]\nname = 'x'\n").unwrap_err().1;
        assert!(reason.ends_with("; a table of keys is needed"), "{reason}");
    }

    #[test]
    fn errors_name_the_line_and_the_key() {
        let wrong = |text: &str| parse::<toml::Table>(text).unwrap_err();
        assert_eq!(wrong("a = 1\nb = 2\na = 3\n"), (3, "duplicate key `a`".into()));
        assert_eq!(wrong("a = 1\nb =\n").0, 2);
        assert!(parse::<toml::Table>("a = 1\n").is_ok());
    }
}
