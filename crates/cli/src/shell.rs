//! Words of a shell: quoting for command lines that the program prints.
//!
//! No shlex, because it prints control characters of a file's name as they are, to a terminal; here they are escaped.

use std::ffi::OsStr;
use std::path::Path;

/// Quotes a path, if needed.
pub(crate) fn word(path: &Path) -> String {
    quoted(path.as_os_str())
}

/// Quotes a word for the system's shells, if needed.
pub(crate) fn quoted(word: &OsStr) -> String {
    if cfg!(windows) {
        for_windows(&word.to_string_lossy())
    } else {
        for_posix(word)
    }
}

/// Quotes a word for `cmd` and PowerShell alike. What only one of them reads within double quotes stays as it is: `%x%`,
/// and `$x` or a backquote.
fn for_windows(word: &str) -> String {
    let harmless = |c: char| c.is_ascii_alphanumeric() || "%+-./:\\_=".contains(c);
    if !word.is_empty() && word.chars().all(harmless) {
        return word.to_owned();
    }
    let mut text = "\"".to_owned();
    let mut backslashes = 0;
    for c in word.chars() {
        // Programs read backslashes before a quote as half as many.
        if c == '"' {
            text.push_str(&"\\".repeat(backslashes + 1));
        }
        backslashes = if c == '\\' { backslashes + 1 } else { 0 };
        text.push(if c.is_control() { char::REPLACEMENT_CHARACTER } else { c });
    }
    text.push_str(&"\\".repeat(backslashes));
    text.push('"');
    text
}

/// Quotes a word for a POSIX shell, if needed.
fn for_posix(word: &OsStr) -> String {
    let harmless = |c: char| c.is_ascii_alphanumeric() || "%+,-./:@_".contains(c);
    match word.to_str() {
        // An `=` at the beginning is zsh's.
        Some(text)
            if !text.is_empty()
                && text
                    .chars()
                    .enumerate()
                    .all(|(k, c)| harmless(c) || (k > 0 && c == '=')) =>
        {
            text.to_owned()
        }
        Some(text) if !text.chars().any(char::is_control) => format!("'{}'", text.replace('\'', r"'\''")),
        // Control characters would spoil the screen; other bytes are no text.
        _ => escaped(word.as_encoded_bytes()),
    }
}

/// Bytes in the quotes `$'…'` of POSIX 2024.
fn escaped(bytes: &[u8]) -> String {
    let mut text = "$'".to_owned();
    for &byte in bytes {
        match byte {
            b'\'' | b'\\' => text.extend(['\\', char::from(byte)]),
            b' '..=b'~' => text.push(char::from(byte)),
            // Octal: of hexadecimal digits bash takes as many as follow.
            _ => text.push_str(&format!("\\{byte:03o}")),
        }
    }
    text.push('\'');
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_become_words() {
        assert_eq!(word("a/b-1.x".as_ref()), "a/b-1.x");
        assert_eq!(word("a b".as_ref()), if cfg!(windows) { "\"a b\"" } else { "'a b'" });
    }

    #[test]
    fn words_are_quoted_where_a_shell_of_windows_would_read_them() {
        for (word, text) in [
            (r"C:\x\room.obj", r"C:\x\room.obj"),
            ("1%", "1%"),
            ("", "\"\""),
            ("my room.obj", "\"my room.obj\""),
            ("it's", "\"it's\""),
            ("a,b", "\"a,b\""),
            ("C:\\my rooms\\", "\"C:\\my rooms\\\\\""),
            ("a \\\"b", "\"a \\\\\\\"b\""),
        ] {
            assert_eq!(for_windows(word), text);
        }
    }

    #[test]
    fn words_are_quoted_where_a_posix_shell_would_read_them() {
        for (word, text) in [
            ("room.obj", "room.obj"),
            ("--tolerance", "--tolerance"),
            ("1%", "1%"),
            ("--json=a.json", "--json=a.json"),
            ("", "''"),
            ("=x", "'=x'"),
            ("my room.obj", "'my room.obj'"),
            ("it's", r"'it'\''s'"),
            ("$HOME;rm *", "'$HOME;rm *'"),
            ("~/a", "'~/a'"),
            ("höhe.obj", "'höhe.obj'"),
            ("a\nb'\\", r"$'a\012b\'\\'"),
        ] {
            assert_eq!(for_posix(OsStr::new(word)), text);
        }
    }
}
