//! Questions as menus: by arrow keys, or by typed numbers and parts of names.

use super::ask::{Answer, Ask, Left, Menu, Text, fitted, rows};
use super::found::{common_beginning, completions};
use inquire::autocompletion::Replacement;
use inquire::ui::{RenderConfig, Styled};
use inquire::validator::Validation;
use inquire::{Autocomplete, CustomUserError, InquireError, Select};
use std::cmp::Reverse;
use std::io::Write;
use unicode_width::UnicodeWidthStr;

/// Lines of a menu besides its items: the question, the keys, and a last one.
const OTHER_LINES: usize = 3;
/// Items shown on the smallest screen.
const ITEMS_MIN: usize = 3;
/// Suggestions shown beneath a path.
const SUGGESTIONS: usize = 6;
/// Width of the cursor before an item.
const CURSOR: usize = "> ".len();

/// Menus on the terminal.
#[derive(Debug)]
pub(super) struct Menus;

/// Restores the terminal for the shell, from any thread.
pub(super) fn restore() {
    // The program is about to end: errors have no reader left.
    let _ = crossterm::terminal::disable_raw_mode();
    let _ = crossterm::execute!(
        std::io::stderr(),
        crossterm::terminal::Clear(crossterm::terminal::ClearType::FromCursorDown),
        crossterm::event::DisableBracketedPaste,
        crossterm::cursor::Show
    );
}

/// Columns and rows.
fn terminal_size() -> Option<(usize, usize)> {
    let (columns, rows) = crossterm::terminal::size().ok()?;
    (columns > 0 && rows > 0).then_some((columns.into(), rows.into()))
}

fn look() -> RenderConfig<'static> {
    // Without colours under `NO_COLOR`.
    RenderConfig::default().with_canceled_prompt_indicator(Styled::new("(back)"))
}

fn answer<T>(asked: Result<T, InquireError>) -> Answer<T> {
    match asked {
        Ok(answer) => Ok(Some(answer)),
        // Escape, or the end of the input by Ctrl-D.
        Err(InquireError::OperationCanceled) => Ok(None),
        Err(InquireError::OperationInterrupted) => Err(Left::Interrupted),
        Err(InquireError::IO(error)) if error.kind() == std::io::ErrorKind::UnexpectedEof => Err(Left::Ended),
        Err(error) => Err(Left::Failed(
            anyhow::Error::new(error).context("questions cannot be asked on this terminal"),
        )),
    }
}

/// The question with its closing sign.
fn asked(question: &str) -> String {
    if question.ends_with('?') {
        question.to_owned()
    } else {
        format!("{question}:")
    }
}

/// Rank of an item for typed text: a number selects items of that number, other text a part of the name.
fn score(typed: &str, row: &str, place: usize, count: usize) -> Option<i64> {
    let typed = typed.trim();
    let number = (place + 1).to_string();
    let is_number = typed.parse::<usize>().is_ok_and(|number| (1..=count).contains(&number));
    if is_number {
        return (number == typed)
            .then_some(1)
            .or_else(|| number.starts_with(typed).then_some(0));
    }
    row.to_lowercase().contains(&typed.to_lowercase()).then_some(0)
}

impl Ask for Menus {
    fn choose(&mut self, menu: &Menu<'_>) -> Answer<usize> {
        let size = terminal_size();
        let room = size.map(|(columns, _)| columns.saturating_sub(CURSOR + 1));
        let rows = rows(menu.items, room);
        let count = rows.len();
        let shown = size.map_or(count, |(_, lines)| lines.saturating_sub(OTHER_LINES).max(ITEMS_MIN));
        let scorer = |typed: &str, _: &String, row: &str, place: usize| score(typed, row, place, count);
        let sorter = |fitting: &mut [(usize, i64)]| fitting.sort_by_key(|&(place, score)| (Reverse(score), place));
        let question = asked(menu.question);
        let question = room.map_or(question.clone(), |room| fitted(&question, room));
        let back = menu
            .items
            .last()
            .map(|item| item.name.to_lowercase())
            .unwrap_or_default();
        let help = format!("↑↓ or a number, Enter; Esc: {back}");
        let names = menu.items.iter().enumerate();
        let names: Vec<String> = names
            .map(|(place, item)| format!("{} - {}", place + 1, item.name))
            .collect();
        let left = room.map(|room| room.saturating_sub(question.width() + 1));
        let formatter = |option: inquire::list_option::ListOption<&String>| {
            let name = names.get(option.index).cloned().unwrap_or_default();
            left.map_or(name.clone(), |left| fitted(&name, left))
        };
        let select = Select::new(&question, rows)
            .with_starting_cursor(menu.start.min(count.saturating_sub(1)))
            .with_page_size(shown)
            .with_scorer(&scorer)
            .with_sorter(&sorter)
            .with_formatter(&formatter)
            .with_help_message(&help)
            .with_render_config(look());
        Ok(answer(select.raw_prompt())?.map(|option| option.index))
    }

    fn text(&mut self, text: &Text<'_>) -> Answer<String> {
        let check = text.check;
        let validator = move |typed: &str| -> Result<Validation, CustomUserError> {
            Ok(match check(typed.trim()) {
                Ok(()) => Validation::Valid,
                Err(reason) => Validation::Invalid(reason.into()),
            })
        };
        let help = format!("{} Esc: back", text.help);
        let question = asked(text.question);
        let mut prompt = inquire::Text::new(&question)
            .with_help_message(&help)
            .with_validator(validator)
            .with_page_size(SUGGESTIONS)
            .with_render_config(look());
        if let Some(default) = text.default {
            prompt = prompt.with_default(default);
        }
        if text.is_path {
            prompt = prompt.with_autocomplete(Paths);
        }
        Ok(answer(prompt.prompt())?.map(|typed| typed.trim().to_owned()))
    }

    fn tell(&mut self, text: &str) {
        // If nothing can be printed, the next question fails.
        let _ = writeln!(std::io::stderr(), "{text}");
    }

    fn width(&self) -> Option<usize> {
        terminal_size().map(|(columns, _)| columns)
    }
}

/// Completes paths.
#[derive(Clone)]
struct Paths;

impl Autocomplete for Paths {
    fn get_suggestions(&mut self, typed: &str) -> Result<Vec<String>, CustomUserError> {
        // An empty line is no question yet: the default stands there.
        Ok(if typed.is_empty() {
            Vec::new()
        } else {
            completions(typed)
        })
    }

    fn get_completion(&mut self, typed: &str, chosen: Option<String>) -> Result<Replacement, CustomUserError> {
        let found = completions(typed);
        let common = common_beginning(&found).filter(|common| common.len() > typed.len());
        Ok(chosen.or_else(|| common.map(str::to_owned)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The remaining places, best first.
    fn fitting(typed: &str, rows: &[&str]) -> Vec<usize> {
        let scores = rows.iter().enumerate();
        let mut fitting: Vec<(usize, i64)> = scores
            .filter_map(|(place, row)| Some((place, score(typed, row, place, rows.len())?)))
            .collect();
        fitting.sort_by_key(|&(place, score)| (Reverse(score), place));
        fitting.into_iter().map(|(place, _)| place).collect()
    }

    #[test]
    fn numbers_are_of_items_and_words_of_names() {
        let rows: Vec<String> = (1..=12)
            .map(|number| format!("{number} - room{}.obj", 30 - number))
            .collect();
        let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
        assert_eq!(fitting("", &rows), (0..12).collect::<Vec<_>>());
        assert_eq!(fitting("1", &rows), [0, 9, 10, 11]);
        assert_eq!(fitting("10", &rows), [9]);
        // No item has that number: it is a part of a name.
        assert_eq!(fitting("29", &rows), [0]);
        assert_eq!(fitting("ROOM2", &rows), (0..10).collect::<Vec<_>>());
        assert_eq!(fitting("x", &rows), [0; 0]);
    }
}
