//! The command line: the one definition from which help, settings files, environment variables, man pages and
//! completions are made. Arguments stand beside their command, in `commands`.

use crate::args::{EXPERT, Talk};
use crate::commands;
use crate::exit::{Exit, hinted};
use crate::help::examples;
use crate::outputs::Paths;
use crate::report::matrix_of;
use crate::shell::word;
use anyhow::{Result, anyhow};
use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, Parser, Subcommand};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Form-factor (view-factor) matrices of triangle scenes by the hemicube method.
#[derive(Debug, Parser)]
#[command(
    name = "hemicube",
    version,
    max_term_width = 100,
    subcommand_required = true,
    arg_required_else_help = true,
    disable_help_subcommand = true,
    after_long_help = examples(
        "  hemicube generate room --patches 10240 -o room.obj
  hemicube compute room.obj -o room.hemicube
  hemicube check room.hemicube
  hemicube export room.hemicube -o room.npz",
        false,
    )
)]
pub(crate) struct Cli {
    /// What to do
    #[command(subcommand)]
    pub(crate) command: Command,
    #[command(flatten)]
    pub(crate) talk: Talk,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Compute(Box<commands::compute::Arguments>),
    Inspect(Box<commands::inspect::Arguments>),
    Tradeoff(Box<commands::tradeoff::Arguments>),
    Check(commands::check::Arguments),
    Merge(commands::merge::Arguments),
    Balance(commands::balance::Arguments),
    Compare(commands::compare::Arguments),
    Export(Box<commands::export::Arguments>),
    Solve(Box<commands::solve::Arguments>),
    Exchange(commands::exchange::Arguments),
    Sky(Box<commands::sky::Arguments>),
    Suns(commands::suns::Arguments),
    Points(Box<commands::points::Arguments>),
    /// Draw pictures: the hemicube of a patch, the model in the colours of a result, the matrix
    View {
        /// What to draw.
        #[command(subcommand)]
        command: commands::view::View,
    },
    Report(Box<commands::report::Arguments>),
    View3d(commands::view3d::Arguments),
    Interactive(commands::interactive::Arguments),
    Generate(commands::generate::Arguments),
    Manual(commands::manual::Arguments),
    Completions(commands::manual::Completions),
    /// The engines that render hemicubes
    Backends {
        /// What to do.
        #[command(subcommand)]
        command: commands::backends::Backends,
    },
}

impl Command {
    /// Paths that the command reads and writes.
    pub(crate) fn paths(&self) -> Paths {
        match self {
            Self::Compute(arguments) => arguments.paths(),
            Self::Inspect(arguments) => arguments.paths(),
            Self::Tradeoff(arguments) => arguments.paths(),
            Self::Check(arguments) => arguments.paths(),
            Self::Merge(arguments) => arguments.paths(),
            Self::Balance(arguments) => arguments.paths(),
            Self::Compare(arguments) => arguments.paths(),
            Self::Export(arguments) => arguments.paths(),
            Self::Solve(arguments) => arguments.paths(),
            Self::Exchange(arguments) => arguments.paths(),
            Self::Sky(arguments) => arguments.paths(),
            Self::Suns(arguments) => arguments.paths(),
            Self::Points(arguments) => arguments.paths(),
            Self::View { command } => command.paths(),
            Self::Report(arguments) => arguments.paths(),
            Self::View3d(arguments) => arguments.paths(),
            Self::Generate(arguments) => arguments.paths(),
            Self::Backends { command } => command.paths(),
            // They write into folders of their own, by their own rules.
            Self::Interactive(_) | Self::Manual(_) | Self::Completions(_) => Paths::default(),
        }
    }
}

/// The definition, with the options that `-h` leaves out under a heading of their own in `--help`.
pub(crate) fn definition() -> clap::Command {
    fn completed(command: clap::Command, path: &str) -> clap::Command {
        let names: Vec<String> = command
            .get_subcommands()
            .map(|inner| inner.get_name().to_owned())
            .collect();
        let command = command.mut_args(|argument| {
            if argument.is_hide_short_help_set() && !argument.is_positional() {
                argument.help_heading(EXPERT)
            } else {
                argument
            }
        });
        let command = match crate::help::ending(path) {
            None => command,
            Some(ending) => {
                let above = command
                    .get_after_long_help()
                    .map(|text| format!("{text}\n"))
                    .unwrap_or_default();
                command.after_long_help(above + &ending)
            }
        };
        names.into_iter().fold(command, |command, name| {
            let path = format!("{path} {name}");
            command.mut_subcommand(name, |inner| completed(inner, path.trim()))
        })
    }
    completed(Cli::command(), "")
}

/// Takes the commands `help`, `help COMMAND` and `version` for the flags.
pub(crate) fn words_for_flags(mut arguments: Vec<OsString>) -> Vec<OsString> {
    match arguments.get(1).and_then(|word| word.to_str()) {
        Some("help") => {
            arguments.remove(1);
            arguments.push("--help".into());
        }
        Some("version") => arguments[1] = "--version".into(),
        _ => {}
    }
    arguments
}

/// Ends the program by its help or its usage. A path in place of a command is said to lack one, a second scene to be
/// one too many, and hidden commands are not suggested.
///
/// # Errors
/// For such a path.
pub(crate) fn misused(mut error: clap::Error, definition: &clap::Command, arguments: &[OsString]) -> Result<Exit> {
    if let Some(ContextValue::String(given)) = error.get(ContextKind::InvalidArg) {
        if hemicube_scene::Format::from_path(Path::new(given)).is_some() && Path::new(given).is_file() {
            return Err(hinted(
                anyhow!("`{given}` is a second scene, and one is taken"),
                "for a scene in several files, put them, and nothing else, in a folder, and give the folder",
            ));
        }
        let tips = tips_on_option(given, definition, arguments);
        if error.kind() == ErrorKind::UnknownArgument && !tips.is_empty() {
            error.remove(ContextKind::SuggestedArg);
            let tips = tips.into_iter().map(StyledStr::from).collect();
            error.insert(ContextKind::Suggested, ContextValue::StyledStrs(tips));
        }
    }
    let Some(ContextValue::String(given)) = error.get(ContextKind::InvalidSubcommand) else {
        error.exit()
    };
    let path = PathBuf::from(given);
    if path.exists() || hemicube_scene::Format::from_path(&path).is_some() {
        return Err(without_command(&path));
    }
    if let Some(ContextValue::Strings(names)) = error.get(ContextKind::SuggestedSubcommand) {
        let is_shown = |name: &&String| {
            definition
                .find_subcommand(name)
                .is_some_and(|command| !command.is_hide_set())
        };
        let shown: Vec<String> = names.iter().filter(is_shown).cloned().collect();
        if shown.is_empty() {
            error.remove(ContextKind::SuggestedSubcommand);
        } else {
            error.insert(ContextKind::SuggestedSubcommand, ContextValue::Strings(shown));
        }
    }
    error.exit()
}

/// Advice on an option that a command lacks: its own options with that word in their names, and the other commands that
/// have it. Empty where neither is known.
fn tips_on_option(given: &str, definition: &clap::Command, arguments: &[OsString]) -> Vec<String> {
    let Some(long) = given.strip_prefix("--") else {
        return Vec::new();
    };
    let long = long.split_once('=').map_or(long, |(name, _)| name);
    let mut command = definition;
    for word in arguments.iter().skip(1).filter_map(|word| word.to_str()) {
        match command.find_subcommand(word) {
            Some(inner) => command = inner,
            None => break,
        }
    }
    let longs = |command: &clap::Command| -> Vec<String> {
        let shown = command.get_arguments().filter(|argument| !argument.is_hide_set());
        shown
            .filter_map(|argument| argument.get_long())
            .map(str::to_owned)
            .collect()
    };
    let elsewhere: Vec<String> = definition
        .get_subcommands()
        .filter(|other| !other.is_hide_set() && longs(other).iter().any(|known| known == long))
        .map(|other| format!("`{}`", other.get_name()))
        .collect();
    if elsewhere.is_empty() {
        return Vec::new();
    }
    let own: Vec<String> = longs(command)
        .into_iter()
        .filter(|known| known.split('-').any(|word| word == long))
        .map(|known| format!("`--{known}`"))
        .collect();
    let mut tips = Vec::new();
    if !own.is_empty() {
        tips.push(format!("`{}` has {}", command.get_name(), own.join(", ")));
    }
    tips.push(format!("`--{long}` is an option of {}", elsewhere.join(", ")));
    tips
}

/// The error of a path in place of a command.
fn without_command(path: &Path) -> anyhow::Error {
    let shown = word(path);
    if path.is_dir() && hemicube_scene::files(path).is_err() {
        return hinted(
            anyhow!("`{}` is a directory, and no command is given", path.display()),
            format!("for a matrix: `hemicube check {shown}`, `hemicube report {shown}`"),
        );
    }
    let output = word(&matrix_of(path));
    hinted(
        anyhow!("`{}` is a scene, and no command is given", path.display()),
        format!(
            "`hemicube compute {shown} -o {output}` computes its form factors, `hemicube inspect {shown}` says what \
             that takes"
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_definition_is_sound() {
        definition().debug_assert();
    }

    #[test]
    fn every_command_says_its_exit_statuses() {
        fn walk(command: &clap::Command, path: &str) {
            let mut leaf = true;
            for inner in command.get_subcommands() {
                leaf = false;
                walk(inner, format!("{path} {}", inner.get_name()).trim());
            }
            let text = command
                .get_after_long_help()
                .map(ToString::to_string)
                .unwrap_or_default();
            assert!(!leaf || text.contains("Exit status"), "{path}: {text}");
            assert!(text.matches("Exit status").count() <= 1, "{path}");
        }
        walk(&definition(), "");
    }

    #[test]
    fn an_option_of_another_command_is_named_with_that_command() {
        let definition = definition();
        let tips = |words: &[&str], given: &str| {
            let words: Vec<OsString> = words.iter().map(OsString::from).collect();
            tips_on_option(given, &definition, &words)
        };
        let of_rows = tips(&["hemicube", "tradeoff", "a.obj", "--rows", "0..9"], "--rows");
        assert_eq!(of_rows[0], "`tradeoff` has `--rows`");
        assert!(
            of_rows[1].starts_with("`--rows` is an option of `compute`"),
            "{of_rows:?}"
        );
        let of_shard = tips(&["hemicube", "sky", "a.obj", "--shard"], "--shard");
        assert_eq!(of_shard, ["`--shard` is an option of `compute`"]);
        assert!(tips(&["hemicube", "sky", "--nonsense"], "--nonsense").is_empty());
    }

    #[test]
    fn the_resolution_settles_by_the_correction() {
        let settled = |words: &[&str]| {
            let words = ["hemicube", "compute", "a", "-o", "b"].iter().chain(words);
            let Command::Compute(mut compute) = Cli::try_parse_from(words).expect("good words").command else {
                panic!("`compute` is `compute`");
            };
            compute.render.settle();
            compute.render.resolution
        };
        assert_eq!(settled(&[]), 128);
        assert_eq!(settled(&["--correction", "pixel"]), 256);
        assert_eq!(settled(&["--tolerance", "1%"]), 128);
        assert_eq!(settled(&["--correction=pixel", "--resolution", "64"]), 64);
    }
}
