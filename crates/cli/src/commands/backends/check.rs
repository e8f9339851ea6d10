//! `hemicube backends check`: the conformance suite on a backend, each case in a child process with a time limit. A
//! crash or a hang is a result like any other.

use crate::again;
use crate::args::{Report as ReportArguments, Talk};
use crate::exit::{Exit, hinted};
use crate::outputs::Paths;
use crate::prepare::{BACKENDS_HINT, BUILT_IN, registry};
use crate::report::{self, JsonReport, SCHEMA, counted};
use crate::selection::matches_glob;
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use hemicube::backend::{BackendInfo, HemicubeBackend};
use hemicube_backend_cpu::CpuBackend;
use hemicube_conformance::{Case, Outcome, cases, run as run_case};
use hemicube_host::Options;
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::process::{Child, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Prefix of a child's answer; a plugin may write to standard output, too.
const ANSWER: &str = "hemicube-case ";

/// The first case: only opens a session.
const OPEN: &str = "open";

/// Interval between looks at a child.
const POLL: Duration = Duration::from_millis(5);

/// Lines shown of a child's standard error, if it ended without an answer.
const LAST_LINES: usize = 3;

/// `hemicube backends check`
#[derive(Args, Debug)]
pub(crate) struct Arguments {
    /// The backend: a name, or the file of one
    #[arg(value_name = "NAME|PATH")]
    pub(crate) backend: String,
    /// An option of the backend, such as `device=1` (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    pub(crate) backend_option: Vec<String>,
    /// Only cases `scene/check` that match
    #[arg(long, value_name = "GLOB", default_value = "*")]
    pub(crate) only: String,
    /// Seconds after which a case counts as hung
    #[arg(
        long,
        value_name = "SECONDS",
        default_value = "120",
        hide = true,
        value_parser = clap::value_parser!(u32).range(1..=86_400)
    )]
    pub(crate) time_limit: u32,
    /// Run this case, in this process, and say on standard output what came of it
    #[arg(long, value_name = "CASE", hide = true)]
    pub(crate) case: Option<String>,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}
impl Arguments {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default()
    }
}

#[derive(Serialize)]
struct CheckReport {
    schema: u32,
    backend: Opened,
    held: usize,
    not_claimed: usize,
    broken: usize,
    cases: Vec<CaseReport>,
}

#[derive(Serialize)]
struct CaseReport {
    case: String,
    #[serde(flatten)]
    answer: Answer,
    #[serde(skip_serializing_if = "Option::is_none")]
    seconds: Option<f64>,
}

/// Result of a case.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "snake_case", tag = "outcome", content = "detail")]
enum Answer {
    /// The session opened.
    Opened(Opened),
    Held(String),
    NotClaimed(String),
    Broken(String),
    /// The process ended without an answer.
    Crashed(String),
    /// It was ended, having taken too long.
    TimedOut(String),
    /// The session did not open.
    Refused(String),
}

#[derive(Clone, Debug, Deserialize, Serialize)]
struct Opened {
    name: String,
    version: String,
    device: String,
}

impl From<&BackendInfo> for Opened {
    fn from(info: &BackendInfo) -> Self {
        Self {
            name: info.name.clone(),
            version: info.version.clone(),
            device: info.device.clone(),
        }
    }
}

impl From<Outcome> for Answer {
    fn from(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Held(detail) => Self::Held(detail),
            Outcome::NotClaimed(detail) => Self::NotClaimed(detail),
            Outcome::Broken(detail) => Self::Broken(detail),
        }
    }
}

impl Answer {
    /// In a word, and in more.
    fn text(&self) -> (&'static str, &str) {
        match self {
            Self::Opened(opened) => ("opened", &opened.name),
            Self::Held(detail) => ("held", detail),
            Self::NotClaimed(detail) => ("not claimed", detail),
            Self::Broken(detail) => ("BROKEN", detail),
            Self::Crashed(detail) => ("CRASHED", detail),
            Self::TimedOut(detail) => ("HUNG", detail),
            Self::Refused(detail) => ("REFUSED", detail),
        }
    }
}

pub(super) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    if arguments.backend == BUILT_IN && !arguments.backend_option.is_empty() {
        bail!("backend `{BUILT_IN}` has no options, and `--backend-option` is given");
    }
    if let Some(case) = &arguments.case {
        return answer(arguments, case);
    }
    let chosen: Vec<Case> = cases()
        .into_iter()
        .filter(|case| matches_glob(&arguments.only, &case.to_string()))
        .collect();
    if chosen.is_empty() {
        return Err(hinted(
            anyhow!("no case matches `{}`", arguments.only),
            "cases are called `scene/check`, such as `room/culling`; `--only 'room/*'` runs those of a scene",
        ));
    }
    let json = JsonReport::asked(&arguments.report);
    // The backend is never loaded into this process: its faults are results.
    let opened = match in_child(arguments, OPEN)?.0 {
        Answer::Opened(opened) => opened,
        Answer::Refused(message) => {
            return Err(hinted(anyhow!(message), BACKENDS_HINT));
        }
        other => bail!("backend `{}` does not open: {}", arguments.backend, other.text().1),
    };
    let heading = format!("backend {} {} ({})\n", opened.name, opened.version, opened.device);
    let (mut reports, mut broken, mut not_claimed) = (Vec::new(), 0, 0);
    if json.is_none() {
        report::print(&heading)?;
    }
    for case in &chosen {
        let name = case.to_string();
        let (answer, seconds) = in_child(arguments, &name)?;
        match answer {
            Answer::Held(_) => {}
            Answer::NotClaimed(_) => not_claimed += 1,
            _ => broken += 1,
        }
        if json.is_none() {
            let (word, detail) = answer.text();
            report::print(&format!("{word:<12} {name:<22} {detail}\n"))?;
        }
        reports.push(CaseReport {
            case: name,
            answer,
            seconds: talk.verbose.then_some(seconds),
        });
    }
    let held = chosen.len() - broken - not_claimed;
    match json {
        Some(json) => json.write(&CheckReport {
            schema: SCHEMA,
            backend: opened,
            held,
            not_claimed,
            broken,
            cases: reports,
        })?,
        None => report::print(&format!(
            "{} held, {not_claimed} not claimed, {broken} not held\n",
            counted(held as u64, "case"),
        ))?,
    }
    Ok(if broken == 0 { Exit::Done } else { Exit::NotHeld })
}

/// Runs one case in this process, and prints its result.
fn answer(arguments: &Arguments, case: &str) -> Result<Exit> {
    let options = Options::parse(&arguments.backend_option)?.with_passes_and_rays();
    let mut backend: Box<dyn HemicubeBackend> = if arguments.backend == BUILT_IN {
        Box::new(CpuBackend::new())
    } else {
        let opened = registry().open(&arguments.backend, &options);
        match opened {
            Ok(backend) => Box::new(backend),
            Err(error) => return say(&Answer::Refused(error.to_string())),
        }
    };
    if case == OPEN {
        return say(&Answer::Opened(backend.info().into()));
    }
    let case: Case = case.parse().map_err(|error: String| anyhow!(error))?;
    let outcome = run_case(case, backend.as_mut(), &mut CpuBackend::new());
    // Closing is part of the case: the answer counts only if the process then ends well.
    drop(backend);
    say(&outcome.into())
}

fn say(answer: &Answer) -> Result<Exit> {
    report::print(&format!("\n{ANSWER}{}\n", serde_json::to_string(answer)?))?;
    Ok(Exit::Done)
}

/// Runs a case in a process of its own, for no longer than the limit.
fn in_child(arguments: &Arguments, case: &str) -> Result<(Answer, f64)> {
    let mut command = again::command()?;
    command.args(["backends", "check", "--case", case]);
    for option in &arguments.backend_option {
        command.arg("--backend-option").arg(option);
    }
    command.arg("--").arg(&arguments.backend);
    command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let started = Instant::now();
    let mut child = command.spawn().context("a process for a case cannot be started")?;
    let (out, err) = (reader(child.stdout.take()), reader(child.stderr.take()));
    let limit = Duration::from_secs(arguments.time_limit.into());
    let ended = wait(&mut child, limit)?;
    let seconds = started.elapsed().as_secs_f64();
    let Some(status) = ended else {
        return Ok((
            Answer::TimedOut(format!("not done after {} s", limit.as_secs())),
            seconds,
        ));
    };
    let (out, err) = (text_of(out), text_of(err));
    let last = out.lines().filter_map(|line| line.strip_prefix(ANSWER)).next_back();
    let answer = match last.map(serde_json::from_str) {
        Some(Ok(answer)) if status.success() => answer,
        _ => {
            let lines: Vec<&str> = err.lines().filter(|line| !line.trim().is_empty()).collect();
            let said = lines[lines.len().saturating_sub(LAST_LINES)..].join(" | ");
            let said = if said.is_empty() { said } else { format!(": {said}") };
            Answer::Crashed(format!("{status}{said}"))
        }
    };
    Ok((answer, seconds))
}

/// Waits for a child; ends it when the limit is over.
fn wait(child: &mut Child, limit: Duration) -> Result<Option<ExitStatus>> {
    let started = Instant::now();
    loop {
        if let Some(status) = child.try_wait().context("a case cannot be waited for")? {
            return Ok(Some(status));
        }
        if started.elapsed() > limit {
            // It may just have ended by itself.
            let _ = child.kill();
            child.wait().context("a case that hung cannot be ended")?;
            return Ok(None);
        }
        std::thread::sleep(POLL);
    }
}

/// Reads a pipe to its end, to keep a talkative child running.
fn reader(pipe: Option<impl Read + Send + 'static>) -> JoinHandle<Vec<u8>> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut pipe) = pipe {
            // After an error, the bytes read so far count.
            let _ = pipe.read_to_end(&mut bytes);
        }
        bytes
    })
}

fn text_of(reader: JoinHandle<Vec<u8>>) -> String {
    String::from_utf8_lossy(&reader.join().unwrap_or_default()).into_owned()
}
