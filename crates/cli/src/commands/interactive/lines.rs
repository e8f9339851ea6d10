//! Questions and answers in numbered lines: for terminals without a movable cursor, for screen readers, and for
//! scripts.

use super::ask::{Answer, Ask, Left, Menu, Text, meant, rows};
use anyhow::Context;
use std::io::{BufRead, Write};

/// The answer that goes back, if no item does.
const BACK: &str = "-";

/// Reads lines, and writes questions.
#[derive(Debug)]
pub(super) struct Lines<R, W> {
    input: R,
    output: W,
}

impl<R: BufRead, W: Write> Lines<R, W> {
    pub(super) fn new(input: R, output: W) -> Self {
        Self { input, output }
    }

    fn say(&mut self, text: &str) -> Result<(), Left> {
        write!(self.output, "{text}")
            .and_then(|()| self.output.flush())
            .context("questions cannot be written")
            .map_err(Left::Failed)
    }

    fn read(&mut self) -> Result<String, Left> {
        let mut line = String::new();
        let read = self.input.read_line(&mut line);
        match read.context("answers cannot be read").map_err(Left::Failed)? {
            0 => {
                // The prompt stands on an unfinished line.
                self.say("\n")?;
                Err(Left::Ended)
            }
            _ => Ok(line.trim().to_owned()),
        }
    }
}

impl<R: BufRead, W: Write> Ask for Lines<R, W> {
    fn choose(&mut self, menu: &Menu<'_>) -> Answer<usize> {
        let Menu { question, items, start } = menu;
        let colon = if question.ends_with('?') { "" } else { ":" };
        self.say(&format!("\n{question}{colon}\n{}\n", rows(items, None).join("\n")))?;
        loop {
            let default = if *start > 0 {
                format!(" [{}]", start + 1)
            } else {
                String::new()
            };
            self.say(&format!("Number{default}: "))?;
            let typed = self.read()?;
            match meant(items, &typed) {
                Some(place) => return Ok(Some(place)),
                None if typed.is_empty() && *start > 0 => return Ok(Some(*start)),
                None if typed == BACK => return Ok(None),
                None => self.say(&format!(
                    "`{typed}` is none of them; a number from 1 to {} is needed\n",
                    items.len()
                ))?,
            }
        }
    }

    fn text(&mut self, text: &Text<'_>) -> Answer<String> {
        let default = text.default.map(|default| format!(" [{default}]")).unwrap_or_default();
        self.say(&format!("\n{}\n", text.help))?;
        loop {
            self.say(&format!("{}{default} (`{BACK}`: back): ", text.question))?;
            let typed = self.read()?;
            if typed == BACK {
                return Ok(None);
            }
            let typed = match text.default {
                Some(default) if typed.is_empty() => default.to_owned(),
                _ => typed,
            };
            match (text.check)(&typed) {
                Ok(()) => return Ok(Some(typed)),
                Err(reason) => self.say(&format!("{reason}\n"))?,
            }
        }
    }

    fn tell(&mut self, text: &str) {
        // If nothing can be printed, the next question fails.
        let _ = writeln!(self.output, "{text}");
    }

    fn width(&self) -> Option<usize> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::super::ask::Item;
    use super::*;

    fn asked<T>(input: &str, ask: impl FnOnce(&mut Lines<&[u8], &mut Vec<u8>>) -> T) -> (T, String) {
        let mut output = Vec::new();
        let answer = ask(&mut Lines::new(input.as_bytes(), &mut output));
        (answer, String::from_utf8(output).expect("text"))
    }

    fn menu(input: &str, start: usize) -> (Answer<usize>, String) {
        let items = [Item::new("One", "first"), Item::new("Two", ""), Item::new("Back", "")];
        asked(input, |lines| {
            lines.choose(&Menu {
                question: "Which",
                items: &items,
                start,
            })
        })
    }

    #[test]
    fn a_menu_is_answered_by_a_number_or_asked_again() {
        let (answer, said) = menu("2\n", 0);
        assert!(matches!(answer, Ok(Some(1))), "{answer:?}");
        assert_eq!(said, "\nWhich:\n1 - One  first\n2 - Two\n3 - Back\nNumber: ");
        let (answer, said) = menu("7\nx\n\none\n", 0);
        assert!(matches!(answer, Ok(Some(0))), "{answer:?}");
        assert_eq!(said.matches("a number from 1 to 3 is needed").count(), 3, "{said}");
        assert!(matches!(menu("\n", 1).0, Ok(Some(1))));
        assert!(matches!(menu("-\n", 0).0, Ok(None)));
        assert!(matches!(menu("", 0).0, Err(Left::Ended)));
    }

    #[test]
    fn a_text_is_asked_for_until_it_is_right() {
        let ask = |input: &str, default: Option<&'static str>| {
            let check = |text: &str| {
                if text.len() == 2 {
                    Ok(())
                } else {
                    Err("two letters".to_owned())
                }
            };
            asked(input, |lines| {
                lines.text(&Text {
                    question: "What",
                    default,
                    help: "Say it.",
                    check: &check,
                    is_path: false,
                })
            })
        };
        let (answer, said) = ask("abc\n\n ab \n", None);
        assert!(matches!(answer, Ok(Some(text)) if text == "ab"));
        assert_eq!(said.matches("two letters\n").count(), 2, "{said}");
        assert!(matches!(ask("\n", Some("xy")).0, Ok(Some(text)) if text == "xy"));
        assert!(matches!(ask("-\n", Some("xy")).0, Ok(None)));
        assert!(matches!(ask("abc\n", None).0, Err(Left::Ended)));
    }
}
