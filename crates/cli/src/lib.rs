//! The hemicube program: scene in, form-factor matrix out. A library so that the study of algorithms is an example of
//! the tests, and no command.
//!
//! Files use only files further down:
//!
//! ```text
//! lib             joins the layers of settings, dispatches
//! command_line    the definition of all commands
//! commands/       one module a command: its arguments, its paths, its work, its report
//! stored verify enclosure materials picture/    work shared by commands: an old matrix's scene, errors, pictures
//! prepare level selection shard config          scenes and settings made from arguments
//! progress outputs table toml_file forecast     progress, the rule of outputs, files people write, memory and disk
//! report          reports, files, the form of numbers
//! exit            exit codes, interrupts, errors with hints
//! advice          what libraries advise, in options
//! log style       messages, colour
//! args help escape shell clock again            argument groups, texts, quoting, clocks, own processes
//! ```
//!
//! Two commands use another: `report` shows the verdicts of `check`, and `check`
//! the operations of `balance`. The study measures by `tradeoff`.

mod advice;
mod again;
mod args;
mod clock;
mod command_line;
mod commands;
mod config;
mod enclosure;
mod escape;
mod exit;
mod forecast;
mod help;
mod level;
mod log;
mod materials;
mod outputs;
mod picture;
mod portals;
mod prepare;
mod progress;
mod report;
mod selection;
mod shard;
mod shell;
mod stored;
mod study;
mod style;
mod suns;
mod table;
mod toml_file;
mod verify;

use crate::command_line::{Cli, Command};
use crate::config::Layers;
use crate::exit::Exit;
use anyhow::Result;
use clap::FromArgMatches;
use std::ffi::OsString;
use std::io::Write;
use std::process::ExitCode;

/// Runs the program by the command line of this process.
pub fn main() -> ExitCode {
    exit::code(run(std::env::args_os())).into()
}

/// Runs the program within another one, and returns its exit code. `words` follow the program's name, and `again` are
/// the command that starts it as a process of its own. Once in a process: it takes the signals and the log.
///
/// Help, wrong usage and interrupts end the process, as they end the program.
pub fn main_within(again: Vec<OsString>, words: Vec<OsString>) -> u8 {
    /// What Rust's runtime ends with after a panic.
    const PANICKED: u8 = 101;
    again::be_guest(again);
    let words = std::iter::once("hemicube".into()).chain(words);
    let code = std::panic::catch_unwind(|| exit::code(run(words.collect::<Vec<_>>()))).unwrap_or(PANICKED);
    // Rust's runtime does it at the end of its own programs.
    let _ = std::io::stdout().flush();
    code
}

/// Runs the study of algorithms by the command line of this process.
pub fn study() -> ExitCode {
    exit::code(study::run_line(std::env::args_os())).into()
}

fn run(arguments: impl IntoIterator<Item = OsString>) -> Result<Exit> {
    let Some(mut arguments) = commands::view3d::arguments_of(arguments.into_iter().collect()) else {
        return Ok(commands::view3d::usage());
    };
    if arguments.len() == 1 && commands::interactive::is_wanted() {
        arguments.push("interactive".into());
    }
    let arguments = command_line::words_for_flags(arguments);
    // Help and wrong usage end the program here, before anything is read.
    let definition = command_line::definition().color(style::asked(&arguments));
    let first = match definition.clone().try_get_matches_from(&arguments) {
        Ok(matches) => matches,
        Err(error) => return command_line::misused(error, &definition, &arguments),
    };
    let (subcommand, matches) = match first.subcommand() {
        Some((name @ ("compute" | "inspect" | "tradeoff" | "interactive"), matches)) => (name, matches),
        _ => return dispatch(Cli::from_arg_matches(&first)?, None, &[]),
    };
    let known = definition.find_subcommand(subcommand).cloned().unwrap_or_default();
    let layers = Layers::gather(&known, matches)?;
    layers.refuse_idle(&known, matches)?;
    let unread = config::unread_variables(&known)?;
    let layered = layers.apply(definition, subcommand).get_matches_from(&arguments);
    let cli = Cli::from_arg_matches(&layered)?;
    let settings = layered
        .subcommand_matches(subcommand)
        .map(|matches| layers.print(&known, matches));
    dispatch(cli, settings, &unread)
}

/// Runs a command, with its settings in force and the variables that nothing reads.
fn dispatch(mut cli: Cli, settings: Option<String>, unread: &[String]) -> Result<Exit> {
    let talk = cli.talk;
    match &mut cli.command {
        Command::Compute(compute) => compute.settle(),
        Command::Inspect(inspect) => inspect.render.settle(),
        Command::Sky(sky) => sky.patches.settle_memory()?,
        Command::Points(points) => points.patches.settle_memory()?,
        _ => {}
    }
    log::start(talk);
    for name in unread {
        talk.warn(&format!("the variable `{name}` is no setting, and nothing reads it"));
    }
    let print_config = match &cli.command {
        Command::Compute(compute) => compute.config.print_config,
        Command::Inspect(inspect) => inspect.config.print_config,
        Command::Tradeoff(tradeoff) => tradeoff.config.print_config,
        _ => false,
    };
    let settings = settings.unwrap_or_default();
    if print_config {
        report::print(&settings)?;
        return Ok(Exit::Done);
    }
    talk.detail(settings.trim_end());
    outputs::check(&cli.command.paths())?;
    match cli.command {
        Command::Interactive(arguments) => commands::interactive::run(&arguments, command_line::definition(), talk),
        Command::Compute(arguments) => commands::compute::run(*arguments, talk),
        Command::Inspect(arguments) => commands::inspect::run(*arguments, talk),
        Command::Tradeoff(arguments) => commands::tradeoff::run(*arguments, talk),
        Command::Check(arguments) => commands::check::run(&arguments, talk),
        Command::Merge(arguments) => commands::merge::run(&arguments, talk),
        Command::Suns(arguments) => commands::suns::run(&arguments, talk),
        Command::Balance(arguments) => commands::balance::run(&arguments, talk),
        Command::Compare(arguments) => commands::compare::run(&arguments, talk),
        Command::Export(arguments) => commands::export::run(&arguments, talk),
        Command::Solve(arguments) => commands::solve::run(&arguments, talk),
        Command::Exchange(arguments) => commands::exchange::run(&arguments, talk),
        Command::Sky(arguments) => commands::sky::run(&arguments, talk),
        Command::Points(arguments) => commands::points::run(&arguments, talk),
        Command::View { command } => commands::view::run(&command, talk),
        Command::Report(arguments) => commands::report::run(&arguments, talk),
        Command::View3d(arguments) => commands::view3d::run(&arguments, talk),
        Command::Generate(arguments) => commands::generate::run(&arguments, talk),
        Command::Manual(arguments) => commands::manual::run(&arguments, command_line::definition()),
        Command::Completions(arguments) => commands::manual::completions(&arguments, command_line::definition()),
        Command::Backends { command } => commands::backends::run(&command, talk),
    }
}
