//! The dialogue's means of asking. Two fronts implement it: menus on a terminal with a movable cursor, and numbered
//! lines anywhere.

use unicode_width::{UnicodeWidthChar, UnicodeWidthStr};

/// Why the dialogue ends without its exit being chosen.
#[derive(Debug)]
pub(super) enum Left {
    /// The input is over.
    Ended,
    /// Ctrl-C, or a request to terminate.
    Interrupted,
    /// The terminal fails.
    Failed(anyhow::Error),
}

/// Answer to a question. `None`: back to the previous one.
pub(super) type Answer<T> = Result<Option<T>, Left>;

/// An item to choose.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Item {
    pub(super) name: String,
    /// A few words about it; empty if the name suffices.
    pub(super) note: String,
}

impl Item {
    pub(super) fn new(name: impl Into<String>, note: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            note: note.into(),
        }
    }
}

/// A question with a list of answers; the last goes back.
#[derive(Debug)]
pub(super) struct Menu<'a> {
    pub(super) question: &'a str,
    pub(super) items: &'a [Item],
    /// Place of the item highlighted first.
    pub(super) start: usize,
}

/// A question answered by typing.
pub(super) struct Text<'a> {
    pub(super) question: &'a str,
    /// Meaning of an empty answer.
    pub(super) default: Option<&'a str>,
    /// One line about possible answers.
    pub(super) help: &'a str,
    /// Returns the error of an answer.
    pub(super) check: &'a dyn Fn(&str) -> Result<(), String>,
    /// True for the path of a file, to be completed.
    #[cfg_attr(not(feature = "menus"), allow(dead_code, reason = "lines complete nothing"))]
    pub(super) is_path: bool,
}

/// A front.
pub(super) trait Ask {
    /// Returns the place of the chosen item.
    fn choose(&mut self, menu: &Menu<'_>) -> Answer<usize>;
    /// Returns the typed text.
    fn text(&mut self, text: &Text<'_>) -> Answer<String>;
    /// Prints lines unchanged.
    fn tell(&mut self, text: &str);
    /// Number of columns, if known.
    fn width(&self) -> Option<usize>;
}

/// Lines of a menu: items numbered, notes aligned, all cut to the width.
pub(super) fn rows(items: &[Item], width: Option<usize>) -> Vec<String> {
    let noted = items.iter().filter(|item| !item.note.is_empty());
    let column = noted.map(|item| item.name.width()).max().unwrap_or(0);
    let digits = items.len().to_string().len();
    let rows = items.iter().enumerate().map(|(place, item)| {
        let Item { name, note } = item;
        let gap = " ".repeat((column + 2).saturating_sub(name.width()));
        let row = format!("{:digits$} - {name}{gap}{note}", place + 1);
        width.map_or_else(|| row.trim_end().to_owned(), |width| fitted(row.trim_end(), width))
    });
    rows.collect()
}

/// Cuts a line to `width` columns.
pub(super) fn fitted(line: &str, width: usize) -> String {
    if line.width() <= width {
        return line.to_owned();
    }
    let mut cut = String::new();
    // One column for the sign of omission.
    let mut left = width.saturating_sub(1);
    for c in line.chars() {
        let Some(rest) = left.checked_sub(c.width().unwrap_or(0)) else {
            break;
        };
        left = rest;
        cut.push(c);
    }
    cut.truncate(cut.trim_end().len());
    cut.push('…');
    cut
}

/// Breaks words into lines of at most `width` columns.
pub(super) fn wrapped(text: &str, width: usize) -> String {
    let mut lines = String::new();
    let mut filled = 0;
    for word in text.split_whitespace() {
        if filled > 0 && filled + 1 + word.width() > width {
            lines.push('\n');
            filled = 0;
        }
        if filled > 0 {
            lines.push(' ');
            filled += 1;
        }
        lines.push_str(word);
        filled += word.width();
    }
    lines
}

/// The item meant by a typed answer: its number, or an unambiguous beginning of its name, in any case.
pub(super) fn meant(items: &[Item], typed: &str) -> Option<usize> {
    let typed = typed.trim();
    if let Ok(number) = typed.parse::<usize>()
        && (1..=items.len()).contains(&number)
    {
        return Some(number - 1);
    }
    let typed = typed.to_lowercase();
    let begins = |item: &Item| item.name.to_lowercase().starts_with(&typed);
    let mut fitting = (0..items.len()).filter(|&place| begins(&items[place]));
    match (typed.is_empty(), fitting.next(), fitting.next()) {
        (false, Some(place), None) => Some(place),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn items() -> Vec<Item> {
        vec![
            Item::new("high.ac", "12 kB"),
            Item::new("high_x16.ac", "1.2 MB"),
            Item::new("Back", ""),
        ]
    }

    #[test]
    fn rows_are_numbered_and_aligned() {
        assert_eq!(
            rows(&items(), None),
            ["1 - high.ac      12 kB", "2 - high_x16.ac  1.2 MB", "3 - Back"]
        );
        let many: Vec<Item> = (0..10).map(|_| Item::new("x", "")).collect();
        assert_eq!(rows(&many, None)[0], " 1 - x");
        assert_eq!(rows(&many, None)[9], "10 - x");
    }

    #[test]
    fn no_row_is_wider_than_the_screen() {
        let wide = [Item::new("日本語のモデル.obj", "4 MB"), Item::new("é.obj", "1 kB")];
        for width in 5..30 {
            for row in rows(&wide, Some(width)).iter().chain(&rows(&items(), Some(width))) {
                assert!(row.width() <= width, "{width}: {row}");
            }
        }
        assert_eq!(rows(&items(), Some(12))[1], "2 - high_x1…");
        assert_eq!(fitted("abc", 3), "abc");
        assert_eq!(fitted("ab cd", 4), "ab…");
    }

    #[test]
    fn words_are_wrapped_and_kept() {
        assert_eq!(wrapped("one two three", 7), "one two\nthree");
        assert_eq!(wrapped("extraordinarily long", 5), "extraordinarily\nlong");
    }

    #[test]
    fn a_number_or_the_beginning_of_a_name_is_meant() {
        assert_eq!(meant(&items(), "2"), Some(1));
        assert_eq!(meant(&items(), " 3 "), Some(2));
        assert_eq!(meant(&items(), "bA"), Some(2));
        assert_eq!(meant(&items(), "high_"), Some(1));
        for wrong in ["", "0", "4", "high", "x"] {
            assert_eq!(meant(&items(), wrong), None, "{wrong}");
        }
    }
}
