//! Colour: of errors, warnings, hints and verdicts, where it is wanted and the stream is a terminal.

use crate::args::Color;
use anstream::{AutoStream, ColorChoice};
use anstyle::{AnsiColor, Style};
use std::ffi::OsString;
use std::io::{Stderr, Stdout};

/// A style, for texts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Paint(Style);

/// Errors, and what failed.
pub(crate) const ERROR: Paint = Paint(AnsiColor::Red.on_default().bold());
/// Warnings, and what is doubtful.
pub(crate) const WARNING: Paint = Paint(AnsiColor::Yellow.on_default().bold());
/// Next steps.
pub(crate) const HINT: Paint = Paint(AnsiColor::Cyan.on_default().bold());
/// What holds.
pub(crate) const GOOD: Paint = Paint(AnsiColor::Green.on_default().bold());

impl Paint {
    /// The text in this style.
    pub(crate) fn of(self, text: &str) -> String {
        format!("{}{text}{}", self.0.render(), self.0.render_reset())
    }
}

/// Makes a choice for both streams. Without one, colour is on terminals, unless `NO_COLOR` is set or `TERM` is `dumb`.
pub(crate) fn choose(color: Color) {
    choice_of(color).write_global();
}

fn choice_of(color: Color) -> ColorChoice {
    match color {
        Color::Auto => ColorChoice::Auto,
        Color::Always => ColorChoice::Always,
        Color::Never => ColorChoice::Never,
    }
}

/// Standard error, without colour where none is wanted.
pub(crate) fn stderr() -> AutoStream<Stderr> {
    AutoStream::auto(std::io::stderr())
}

/// Standard output, likewise.
pub(crate) fn stdout() -> AutoStream<Stdout> {
    AutoStream::auto(std::io::stdout())
}

/// The choice on a command line that is not parsed yet, for messages about it: `--color never`, `--color=never`.
pub(crate) fn asked(arguments: &[OsString]) -> clap::ColorChoice {
    let words = arguments.iter().map(|word| word.to_string_lossy());
    let mut choice = clap::ColorChoice::Auto;
    let mut is_value = false;
    for word in words.take_while(|word| word != "--") {
        let value = word.strip_prefix("--color=").or(is_value.then_some(&*word));
        match value {
            Some("always") => choice = clap::ColorChoice::Always,
            Some("never") => choice = clap::ColorChoice::Never,
            _ => {}
        }
        is_value = word == "--color";
    }
    choice
}

/// The words of verdicts in colour: those in capitals, and `ok` where it is the second word of a line.
pub(crate) fn verdicts(text: &str) -> String {
    let mut painted = String::with_capacity(text.len());
    for line in text.split_inclusive('\n') {
        for (place, word) in line.split_inclusive(' ').enumerate() {
            let bare = word.trim_end_matches([' ', '\n', ',', ';', ':']);
            let is_second = || line.split_whitespace().nth(1) == Some(bare) && place > 0;
            let paint = match bare {
                "DOUBTFUL" | "UNFINISHED" | "REACHED" | "NOT" => Some(WARNING),
                "FAILED" => Some(ERROR),
                "ok" if is_second() => Some(GOOD),
                _ => None,
            };
            match paint {
                Some(paint) => {
                    painted.push_str(&paint.of(bare));
                    painted.push_str(&word[bare.len()..]);
                }
                None => painted.push_str(word),
            }
        }
    }
    painted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_verdict_is_painted_where_a_line_has_it_and_nowhere_else() {
        let text = "integrity  ok        as written\nquality    DOUBTFUL  ok\nok\nthis: FAILED, that\n";
        let painted = verdicts(text);
        assert_eq!(
            painted.matches(WARNING.of("DOUBTFUL").as_str()).count(),
            1,
            "{painted:?}"
        );
        assert_eq!(painted.matches(GOOD.of("ok").as_str()).count(), 1, "{painted:?}");
        assert_eq!(painted.matches(ERROR.of("FAILED").as_str()).count(), 1, "{painted:?}");
        assert_eq!(anstream::adapter::strip_str(&painted).to_string(), text);
    }

    #[test]
    fn the_choice_of_colour_is_known_before_the_line_is_parsed() {
        let asked = |words: &[&str]| asked(&words.iter().map(OsString::from).collect::<Vec<_>>());
        assert_eq!(
            asked(&["hemicube", "check", "--color", "never"]),
            clap::ColorChoice::Never
        );
        assert_eq!(asked(&["hemicube", "--color=always"]), clap::ColorChoice::Always);
        assert_eq!(asked(&["hemicube", "--", "--color=always"]), clap::ColorChoice::Auto);
    }
}
