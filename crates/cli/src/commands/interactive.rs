//! `hemicube interactive`, and `hemicube` alone on a terminal: asks, shows the resulting command line, and runs it.
//!
//! Every command is a process of its own, of this program with the words shown. It handles signals, logs and fails like
//! a typed command, and the dialogue can do nothing that the command line cannot.
//!
//! `dialogue.rs` knows the next question and the command line of the answers. A front behind the trait `Ask` puts the
//! question (`menus.rs`, `lines.rs`). `settings.rs` holds choices above the layers of `config.rs`, by the parsers of
//! the command line, and drops every option without effect.

mod ask;
mod dialogue;
mod found;
mod line;
mod lines;
#[cfg(feature = "menus")]
mod menus;
mod settings;

use crate::args::{Color, Talk};
use crate::exit::Exit;
use crate::{again, progress, report};
use anyhow::{Context, Result};
use ask::{Ask, Left};
use clap::Args;
use dialogue::{Dialogue, Ended, Run};
use line::Line;
use lines::Lines;
use settings::Settings;
use std::ffi::OsString;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// End of `--help`: keys, and exit statuses of its own.
const AFTER_INTERACTIVE_HELP: &str = "\
Examples:
  hemicube
  hemicube interactive ~/scenes
  hemicube interactive <answers     # a line for each question
Keys:
  arrow keys, Enter  choose; or type the number, or a part of the name
  Tab                complete a path
  Esc, Ctrl-D        back; at the first menu, exit
  Ctrl-C             exit; while a command runs, end that, and come back
Environment:
  TERM                  dumb, or nothing: numbered lines in place of menus, as without a terminal
  NO_COLOR              no colours
  HEMICUBE_SCENES       as DIR
  HEMICUBE_NAME         as in `hemicube compute --help`, of which the dialogue shows the values
Exit status, whatever that of the commands was:
  0    left by the exit, by Esc, or at the end of the input
  2    no terminal, or a wrong file of settings
  130  left by Ctrl-C or a request to terminate";

/// Choose from menus, which show the command lines that they run; on a terminal, `hemicube` alone is this
#[derive(Args, Debug)]
#[command(after_long_help = AFTER_INTERACTIVE_HELP)]
pub(crate) struct Arguments {
    /// Look for scenes in DIR, too; as `scenes = "DIR"` in a file of settings, always
    #[arg(value_name = "DIR")]
    pub(crate) scenes: Option<PathBuf>,
}

/// Returns whether somebody can be asked: a program without arguments then starts the dialogue.
pub(crate) fn is_wanted() -> bool {
    std::io::stdin().is_terminal() && std::io::stdout().is_terminal() && std::io::stderr().is_terminal()
}

pub(crate) fn run(arguments: &Arguments, definition: clap::Command, talk: Talk) -> Result<Exit> {
    let has_terminal = std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
    let session = Arc::new(Session {
        called: called(std::env::args_os().next().filter(|_| !again::is_guest())),
        ..Session::default()
    });
    let is_plain = !has_terminal || progress::is_dumb(std::env::var_os("TERM").as_deref());
    session.watch(is_plain)?;
    let mut front = front(is_plain);
    let mut runner = Runner {
        session: Arc::clone(&session),
    };
    let left = Dialogue {
        ask: front.as_mut(),
        run: &mut runner,
        program: session.called.clone(),
        common: common(talk),
        settings: Settings::read(definition)?,
        here: PathBuf::from("."),
        scenes: arguments.scenes.clone(),
        scenes_are_chosen: false,
        computed: Vec::new(),
    }
    .main();
    drop(front);
    session.tell_lines()?;
    match left {
        Ok(()) | Err(Left::Ended) => Ok(Exit::Done),
        Err(Left::Interrupted) => Ok(Exit::Interrupted),
        Err(Left::Failed(error)) => Err(error),
    }
}

#[cfg(feature = "menus")]
fn front(is_plain: bool) -> Box<dyn Ask> {
    if is_plain {
        lines_front()
    } else {
        Box::new(menus::Menus)
    }
}

#[cfg(not(feature = "menus"))]
fn front(_: bool) -> Box<dyn Ask> {
    lines_front()
}

fn lines_front() -> Box<dyn Ask> {
    Box::new(Lines::new(std::io::stdin().lock(), std::io::stderr()))
}

/// Options of the dialogue, passed on to every command.
fn common(talk: Talk) -> Vec<OsString> {
    let flags = [
        (talk.quiet, "--quiet"),
        (talk.verbose, "--verbose"),
        (talk.color == Color::Always, "--color=always"),
        (talk.color == Color::Never, "--color=never"),
    ];
    flags
        .iter()
        .filter(|(is_set, _)| *is_set)
        .map(|(_, flag)| flag.into())
        .collect()
}

/// The program as it was called: by name, or by a path.
fn called(first: Option<OsString>) -> OsString {
    first
        .filter(|name| Path::new(name).components().count() > 1)
        .unwrap_or_else(|| "hemicube".into())
}

/// State shared by the dialogue and the thread waiting for signals.
#[derive(Debug, Default)]
struct Session {
    /// Name of the program as called.
    called: OsString,
    /// Command lines that were run, with the exit status of failed ones.
    lines: Mutex<Vec<String>>,
    /// True while a command is running, and gets the terminal's signals, too.
    is_running: AtomicBool,
    was_signalled: AtomicBool,
}

impl Session {
    /// Passes signals to a running command; without one, they end the dialogue.
    ///
    /// A terminal limited to lines was not changed, and would show the escape sequences that undo changes.
    #[cfg_attr(
        not(feature = "menus"),
        expect(unused_variables, reason = "lines change no terminal")
    )]
    fn watch(self: &Arc<Self>, is_plain: bool) -> Result<()> {
        let session = Arc::clone(self);
        ctrlc::set_handler(move || {
            session.was_signalled.store(true, Ordering::SeqCst);
            if session.is_running.load(Ordering::SeqCst) {
                return;
            }
            #[cfg(feature = "menus")]
            if !is_plain {
                menus::restore();
            }
            // A terminal has shown `^C` on the line.
            let _ = writeln!(std::io::stderr());
            // Whoever has gone cannot be told.
            let _ = session.tell_lines();
            std::process::exit(crate::exit::INTERRUPTED.into());
        })
        .context("Ctrl-C cannot be watched")
    }

    /// Prints the command lines that were run, for copying.
    fn tell_lines(&self) -> Result<()> {
        let lines = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        if lines.is_empty() {
            return Ok(());
        }
        report::print(&format!("\n# What was run:\n{}\n", lines.join("\n")))
    }
}

/// Runs this program.
#[derive(Debug)]
struct Runner {
    session: Arc<Session>,
}

impl Run for Runner {
    fn run(&mut self, line: &Line) -> Result<Ended, Left> {
        let session = &self.session;
        session.was_signalled.store(false, Ordering::SeqCst);
        session.is_running.store(true, Ordering::SeqCst);
        // No command reads standard input; keys typed meanwhile are for the next question.
        let status =
            again::command().and_then(|mut command| Ok(command.args(&line.words).stdin(Stdio::null()).status()?));
        session.is_running.store(false, Ordering::SeqCst);
        let was_signalled = session.was_signalled.load(Ordering::SeqCst);
        let status = status.context("the program cannot be started").map_err(Left::Failed)?;
        let ended = status.code().map_or(Ended::Not, Ended::By);
        let shown = line.shown(&session.called);
        let shown = match ended {
            Ended::By(0) => shown,
            Ended::By(status) => format!("{shown}  # exit status {status}"),
            Ended::Not => format!("{shown}  # ended by a signal"),
        };
        session.lines.lock().unwrap_or_else(PoisonError::into_inner).push(shown);
        match ended {
            // A signal without effect on the command was meant for the dialogue.
            Ended::By(status) if was_signalled && status != i32::from(crate::exit::INTERRUPTED) => {
                Err(Left::Interrupted)
            }
            ended => Ok(ended),
        }
    }

    fn output(&mut self, line: &Line) -> Result<Vec<u8>, String> {
        let output =
            again::command().and_then(|mut command| Ok(command.args(&line.words).stdin(Stdio::null()).output()?));
        let output = output.map_err(|error| error.to_string())?;
        if output.status.success() {
            Ok(output.stdout)
        } else {
            Err(String::from_utf8_lossy(&output.stderr).trim().to_owned())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_program_is_called_as_it_was() {
        let called = |name: &str| called(Some(name.into())).to_string_lossy().into_owned();
        assert_eq!(called("hemicube"), "hemicube");
        assert_eq!(called("-hemicube"), "hemicube");
        assert_eq!(called("./hemicube"), "./hemicube");
        assert_eq!(called("/opt/hemicube 2/bin/hemicube"), "/opt/hemicube 2/bin/hemicube");
        assert_eq!(super::called(None), "hemicube");
    }
}
