//! `hemicube manual` and `hemicube completions`: further files of a package of the program, from the one definition of
//! the command line.

use crate::exit::Exit;
use crate::report::{PendingFile, output_error};
use anyhow::{Context, Result};
use clap::{Arg, Args, Command};
use clap_mangen::Man;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Write man pages, for packages of the program
#[derive(Args, Debug)]
#[command(hide = true)]
pub(crate) struct Arguments {
    /// The directory to write them to
    #[arg(
        value_name = "DIR",
        required_unless_present = "markdown",
        conflicts_with = "markdown"
    )]
    pub(crate) directory: Option<PathBuf>,
    /// Print one page of all commands in Markdown instead, the book's
    #[arg(long)]
    pub(crate) markdown: bool,
}
/// Print a script that completes command lines in a shell: `hemicube completions bash`
#[derive(Args, Debug)]
pub(crate) struct Completions {
    /// The shell
    #[arg(value_name = "SHELL")]
    pub(crate) shell: clap_complete::Shell,
}

/// Lines not to be filled into paragraphs: examples and tables.
fn literal(text: &str) -> String {
    let mut lines = String::new();
    for line in text.lines() {
        let line = line.replace('\\', "\\e").replace('-', "\\-");
        // Such lines are requests to the typesetter.
        if line.starts_with(['.', '\'']) {
            lines.push_str("\\&");
        }
        lines.push_str(&line);
        lines.push('\n');
    }
    lines
}

/// Turns the text below the options into sections. A section's name stands on a line of its own, or before the
/// section's first line.
fn sections(text: &str) -> String {
    let mut page = String::new();
    let mut open = false;
    for line in text.lines() {
        let heading = (!line.starts_with(' ')).then(|| line.split_once(':')).flatten();
        if let Some((name, rest)) = heading {
            if open {
                page.push_str(".fi\n");
            }
            page.push_str(&format!(".SH {}\n.nf\n", literal(&name.to_uppercase()).trim_end()));
            open = true;
            if !rest.trim().is_empty() {
                page.push_str(&literal(rest.trim()));
            }
        } else {
            page.push_str(&literal(line));
        }
    }
    if open {
        page.push_str(".fi\n");
    }
    page
}

/// Beginning of each section from `Man`: the definition of an apostrophe.
const APOSTROPHE: &str = ".ie \\n(.g .ds Aq \\(aq\n.el .ds Aq '\n";
/// A paragraph between two breaks: typesetters complain about it.
const EMPTY_PARAGRAPH: &str = "\n.br\n\n.br\n";

/// The page of a command: its definition, and its examples from `--help`. Without a date, the same program has the same
/// pages.
fn page(command: &Command) -> io::Result<(String, String)> {
    let below = command
        .get_after_long_help()
        .map(ToString::to_string)
        .unwrap_or_default();
    let man = Man::new(command.clone());
    let mut made = Vec::new();
    man.render_name_section(&mut made)?;
    man.render_synopsis_section(&mut made)?;
    man.render_description_section(&mut made)?;
    man.render_options_section(&mut made)?;
    if command.get_subcommands().any(|command| !command.is_hide_set()) {
        man.render_subcommands_section(&mut made)?;
    }
    let made = String::from_utf8(made).map_err(io::Error::other)?;
    let name = man.get_filename();
    let title = name.trim_end_matches(".1").to_uppercase();
    let page = format!(
        "{APOSTROPHE}.TH \"{title}\" 1 \"\" \"hemicube {}\" \"User Commands\"\n{}{}",
        env!("CARGO_PKG_VERSION"),
        made.replace(APOSTROPHE, "").replace(EMPTY_PARAGRAPH, "\n.sp\n"),
        sections(&below)
    );
    Ok((name, page))
}

/// The command with long help for all options: `Man` would leave out those missing from `-h`.
fn in_full(command: Command) -> Command {
    let with_help = |argument: clap::Arg| match (argument.get_help().cloned(), argument.get_long_help()) {
        (Some(help), None) => argument.long_help(help),
        _ => argument,
    };
    command.mut_args(with_help).mut_subcommands(in_full)
}

/// Writes the pages of a command and its subcommands.
fn write_pages(command: &Command, directory: &Path) -> Result<()> {
    let (name, page) = page(command).with_context(|| format!("the page of `{command}` cannot be made"))?;
    let path = directory.join(name);
    let mut file = PendingFile::create(&path)?;
    file.write_all(page.as_bytes())
        .with_context(|| format!("`{}` cannot be written", path.display()))?;
    file.commit()?;
    for command in command.get_subcommands().filter(|command| !command.is_hide_set()) {
        write_pages(command, directory)?;
    }
    Ok(())
}

/// Text for a cell of a table in Markdown, which takes what stands between backticks as it is, but for bars.
fn cell(text: &str) -> String {
    let text = text
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
        .replace('|', "\\|");
    let pieces = text.split('`').enumerate().map(|(k, piece)| match k % 2 {
        0 => piece.replace('<', "&lt;").replace('*', "\\*").replace('_', "\\_"),
        _ => piece.to_owned(),
    });
    pieces.collect::<Vec<_>>().join("`")
}

/// The line of an argument or option in its table: how it is written, what it is for, and its default.
fn table_line(argument: &Arg) -> String {
    let short = argument.get_short().map(|short| format!("-{short}, "));
    let written = format!("{}{argument}", short.unwrap_or_default());
    let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
    let defaults: Vec<_> = argument
        .get_default_values()
        .iter()
        .map(|value| value.to_string_lossy())
        .collect();
    let is_shown =
        argument.get_action().takes_values() && !argument.is_hide_default_value_set() && !defaults.is_empty();
    let default = if is_shown {
        format!(" [default: {}]", defaults.join(" "))
    } else {
        String::new()
    };
    format!("| `{}` | {} |\n", written.replace('|', "\\|"), cell(&(help + &default)))
}

/// The tables of some arguments, one for each heading in their order.
fn tables<'a>(arguments: impl Iterator<Item = &'a Arg>) -> String {
    let mut tables: Vec<(&str, String)> = Vec::new();
    for argument in arguments {
        let other = if argument.is_positional() {
            "Arguments"
        } else {
            "Options"
        };
        let heading = argument.get_help_heading().unwrap_or(other);
        match tables.iter_mut().find(|(name, _)| *name == heading) {
            Some((_, lines)) => *lines += &table_line(argument),
            None => tables.push((heading, table_line(argument))),
        }
    }
    let tables = tables
        .into_iter()
        .map(|(heading, lines)| format!("\n| {heading} | |\n|---|---|\n{lines}"));
    tables.collect()
}

/// A command and its subcommands, but those that are hidden, in their order.
fn visible(command: &Command) -> Vec<&Command> {
    let subcommands = command.get_subcommands().filter(|command| !command.is_hide_set());
    std::iter::once(command).chain(subcommands.flat_map(visible)).collect()
}

/// The section of a command. Options with the same line in several commands, `common`, are named alone.
fn section(command: &Command, common: &[&str]) -> String {
    let name = command.get_bin_name().unwrap_or_else(|| command.get_name());
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    let usage = command.clone().render_usage().to_string();
    let usage = usage.strip_prefix("Usage: ").unwrap_or(&usage);
    let mut text = format!(
        "\n## {name}\n\n{}.\n\n```text\n{}\n```\n",
        cell(&about),
        usage.trim_end()
    );
    let shown = command
        .get_arguments()
        .filter(|argument| !argument.is_hide_set() && !argument.is_global_set() && argument.get_id() != "help");
    let (named, told): (Vec<&Arg>, Vec<&Arg>) =
        shown.partition(|argument| common.contains(&table_line(argument).as_str()));
    text += &tables(told.into_iter());
    let named: Vec<String> = named
        .iter()
        .filter_map(|argument| Some(format!("`--{}`", argument.get_long()?)))
        .collect();
    if !named.is_empty() {
        text += &format!("\nAlso: {}.\n", named.join(", "));
    }
    text
}

/// Commands from which on an option that is the same in all of them is explained once.
const SEVERAL: usize = 3;

/// One page of all commands in Markdown, from their definition alone.
fn markdown(definition: Command) -> String {
    let mut command = definition;
    command.build();
    let commands = visible(&command);
    let of = |command: &Command| -> Vec<Arg> {
        let arguments = command.get_arguments();
        let named = arguments.filter(|argument| !argument.is_hide_set() && !argument.is_positional());
        named
            .filter(|argument| !argument.is_global_set() && argument.get_id() != "help")
            .cloned()
            .collect()
    };
    let mut common: Vec<(Arg, String, usize)> = Vec::new();
    for argument in commands.iter().skip(1).flat_map(|command| of(command)) {
        let line = table_line(&argument);
        match common.iter_mut().find(|(_, other, _)| *other == line) {
            Some((.., count)) => *count += 1,
            None => common.push((argument, line, 1)),
        }
    }
    common.retain(|(.., count)| *count >= SEVERAL);
    let lines: Vec<&str> = common.iter().map(|(_, line, _)| line.as_str()).collect();
    let mut text = "# Commands\n\nMade by `hemicube manual --markdown`. `hemicube COMMAND --help` has the same with examples and exit \
                    codes, `-h` what is used most.\n\n## Options of all commands\n"
        .to_owned();
    let of_all = command.get_arguments().filter(|argument| !argument.is_hide_set());
    text += &tables(of_all.filter(|argument| argument.is_global_set()));
    text += "\n## Options of several commands\n";
    text += &tables(common.iter().map(|(argument, ..)| argument));
    for command in commands.iter().skip(1) {
        text += &section(command, &lines);
    }
    text
}

/// Writes the pages of `definition` and its subcommands, or prints one of all of them in Markdown.
///
/// # Errors
/// When the directory or a page cannot be written.
pub(crate) fn run(arguments: &Arguments, definition: Command) -> Result<Exit> {
    let Some(directory) = &arguments.directory else {
        let mut out = io::stdout().lock();
        out.write_all(markdown(definition).as_bytes())
            .and_then(|()| out.flush())
            .map_err(output_error)?;
        return Ok(Exit::Done);
    };
    std::fs::create_dir_all(directory).with_context(|| format!("`{}` cannot be created", directory.display()))?;
    let mut command = in_full(definition);
    // Makes the subcommands' names: `hemicube-compute`.
    command.build();
    write_pages(&command, directory)?;
    Ok(Exit::Done)
}

/// Prints the completions of `definition`.
///
/// # Errors
/// When standard output cannot be written.
pub(crate) fn completions(arguments: &Completions, mut definition: Command) -> Result<Exit> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut definition, "hemicube", &mut script);
    let mut out = io::stdout().lock();
    out.write_all(&script)
        .and_then(|()| out.flush())
        .map_err(output_error)?;
    Ok(Exit::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_of_commands_explains_an_option_once_and_keeps_bars_and_names() {
        let option = |name: &'static str| Arg::new(name).long(name).help("Sum <F> of `a|b`");
        let command = |name: &'static str| Command::new(name).about("Do one thing").arg(option("same").short('s'));
        let first = command("first").arg(option("one").short('o').help_heading("Expert"));
        let others = [command("second"), command("third"), Command::new("hidden").hide(true)];
        let all = option("all").global(true);
        let page = markdown(Command::new("outer").arg(all).subcommand(first).subcommands(others));
        let lines = [
            "## outer first",
            "Do one thing.",
            "| Expert | |",
            "| `-o, --one <one>` | Sum &lt;F> of `a\\|b` |",
            "Also: `--same`.",
        ];
        assert!(
            lines.iter().all(|line| page.lines().any(|other| other == *line)),
            "{page}"
        );
        let count = |what: &str| page.matches(what).count();
        assert_eq!(
            (
                count("--all"),
                count("-s, --same"),
                count("Also: `--same`."),
                count("hidden")
            ),
            (1, 1, 3, 0),
            "{page}"
        );
    }

    #[test]
    fn what_is_below_the_options_becomes_sections() {
        let text = "Examples:\n  hemicube x -o y\n.dotted\nHint, first: a\\b\nExit status:\n  0  done";
        assert_eq!(
            sections(text),
            ".SH EXAMPLES\n.nf\n  hemicube x \\-o y\n\\&.dotted\n.fi\n.SH HINT, FIRST\n.nf\na\\eb\n.fi\n.SH EXIT \
             STATUS\n.nf\n  0  done\n.fi\n"
        );
    }
}
