//! Text from files and errors made printable: unseen characters, escaped.

use hemicube_scene::is_unseen;
use std::borrow::Cow;

/// A text from a file as one line: unseen characters are escaped as in Rust, `\u{1b}`.
pub(crate) fn shown(text: &str) -> Cow<'_, str> {
    escaped(text, |_| false)
}

/// Lines of output: line ends and tabs stay, all other unseen characters came from a file and are escaped.
pub(crate) fn shown_lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| matches!(c, '\n' | '\t'))
}

fn escaped(text: &str, stays: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.chars().any(|c| is_unseen(c) && !stays(c)) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_unseen(c) && !stays(c) {
            shown.extend(c.escape_default());
        } else {
            shown.push(c);
        }
    }
    Cow::Owned(shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_unseen_is_escaped() {
        let name = "a\u{1b}]0;t\u{7}\nerror: no\u{9b}2J\u{202e}é\u{1f600}";
        assert_eq!(
            shown(name),
            "a\\u{1b}]0;t\\u{7}\\nerror: no\\u{9b}2J\\u{202e}é\u{1f600}"
        );
        assert_eq!(shown_lines("a\tb\nc\r"), "a\tb\nc\\r");
        assert!(matches!(shown("wall – 3"), Cow::Borrowed(_)));
    }
}
