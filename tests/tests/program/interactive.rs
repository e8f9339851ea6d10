//! `hemicube interactive`, on a terminal: what is on the screen, what is run, and what is left behind.
//!
//! The terminal is a pseudo-terminal, and what the program writes to it goes through an emulator: tests read the screen
//! as a person does, and type. The binary is the one beside this test: build it with the same profile and target
//! directory before.
#![cfg(unix)]

use hemicube_tests::runs::{Place, Ran, assert_same, until};
use hemicube_tests::scenes::{program, scenes_dir, workspace};
use pty_process::blocking::{Command as OnTerminal, Pty};
use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// For what a person would not wait longer.
const PATIENCE: Duration = Duration::from_secs(60);

const ENTER: &str = "\r";
const ESCAPE: &str = "\x1b";
const CTRL_C: &str = "\x03";
const CTRL_D: &str = "\x04";
const DOWN: &str = "\x1b[B";
const UP: &str = "\x1b[A";
const BACKSPACE: &str = "\x7f";

/// A screen on which nothing scrolls away.
const TALL: (u16, u16) = (600, 160);

/// A program on a terminal, and what it shows there.
struct Terminal {
    child: Child,
    pty: Option<Arc<Pty>>,
    shown: Arc<Mutex<(vt100::Parser, Vec<u8>)>>,
    reader: Option<JoinHandle<()>>,
}

impl Terminal {
    /// Starts a command of `place` on a terminal of so many rows and columns.
    fn start(mut command: Command, (rows, columns): (u16, u16)) -> Self {
        let (pty, other_end) = pty_process::blocking::open().expect("a pseudo-terminal");
        pty.resize(pty_process::Size::new(rows, columns)).expect("a size");
        // The terminal of the tests is another one.
        let said: Vec<_> = command.get_envs().map(|(name, _)| name.to_owned()).collect();
        if !said.iter().any(|name| name == "NO_COLOR") {
            command.env_remove("NO_COLOR");
        }
        if !said.iter().any(|name| name == "TERM") {
            command.env("TERM", "xterm-256color");
        }
        let child = OnTerminal::from(command).spawn(other_end).expect("the program starts");
        let size = |size: u16| size.try_into().expect("a screen");
        let parser = vt100::Parser::new(size(rows), size(columns), 0);
        let shown = Arc::new(Mutex::new((parser, Vec::new())));
        let pty = Arc::new(pty);
        let reader = std::thread::spawn({
            let (pty, shown) = (Arc::clone(&pty), Arc::clone(&shown));
            move || {
                let mut bytes = [0; 4096];
                // An error: nothing holds the other end any more.
                while let Ok(count @ 1..) = (&*pty).read(&mut bytes) {
                    let mut shown = shown.lock().expect("no other panics");
                    shown.0.process(&bytes[..count]);
                    shown.1.extend_from_slice(&bytes[..count]);
                }
            }
        });
        Self {
            child,
            pty: Some(pty),
            shown,
            reader: Some(reader),
        }
    }

    /// Starts `hemicube` without arguments in `place`.
    fn hemicube(place: &Place) -> Self {
        Self::start(place.command(""), TALL)
    }

    fn shown(&self) -> MutexGuard<'_, (vt100::Parser, Vec<u8>)> {
        self.shown.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn screen(&self) -> String {
        self.shown().0.screen().contents()
    }

    fn bytes(&self) -> Vec<u8> {
        self.shown().1.clone()
    }

    #[track_caller]
    fn waits(&self, what: &str, holds: impl Fn(&str) -> bool) {
        let started = Instant::now();
        loop {
            let screen = self.screen();
            if holds(&screen) {
                return;
            }
            assert!(started.elapsed() < PATIENCE, "{what} is not on the screen:\n{screen}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    fn type_in(&self, keys: &str) {
        let mut pty = self.pty.as_deref().expect("the terminal is there");
        pty.write_all(keys.as_bytes()).expect("the terminal takes keys");
    }

    /// Waits until this is asked.
    #[track_caller]
    fn asked(&self, question: &str) {
        self.waits(question, |screen| {
            open_question(screen).is_some_and(|(asked, _)| asked.starts_with(question))
                && screen.trim_end().ends_with(']')
        });
    }

    /// Types keys, and waits until the open question is answered by them.
    #[track_caller]
    fn answer(&self, keys: &str) {
        let before = answered(&self.screen());
        self.type_in(keys);
        self.waits("an answer", |screen| answered(screen) > before);
    }

    /// Waits for a question, and picks the item of this name by typing its number.
    #[track_caller]
    fn pick(&self, question: &str, item: &str) {
        self.asked(question);
        let number = self.number(item);
        self.answer(&format!("{number}{ENTER}"));
    }

    /// The number of an item of the open menu.
    #[track_caller]
    fn number(&self, item: &str) -> usize {
        let screen = self.screen();
        let (_, rows) = open_question(&screen).expect("a question");
        let named = rows.iter().find_map(|row| {
            let (number, name) = row.get(2..)?.trim_start().split_once(" - ")?;
            name.starts_with(item).then(|| number.parse().ok()).flatten()
        });
        named.unwrap_or_else(|| panic!("`{item}` is not in the menu:\n{screen}"))
    }

    /// Waits for a question, and answers it with a text.
    #[track_caller]
    fn typed(&self, question: &str, text: &str) {
        self.asked(question);
        self.answer(&format!("{text}{ENTER}"));
    }

    /// Waits for the end of the program: its exit code, and the screen.
    #[track_caller]
    fn ends(mut self) -> Ran {
        let started = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().expect("its state") {
                break status;
            }
            assert!(started.elapsed() < PATIENCE, "it does not end:\n{}", self.screen());
            std::thread::sleep(Duration::from_millis(10));
        };
        if let Some(reader) = self.reader.take() {
            reader.join().expect("the screen is read to its end");
        }
        let out = self.screen();
        assert!(!out.contains("panicked"), "{out}");
        Ran {
            code: status.code(),
            out,
            err: String::new(),
        }
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The last question that has no answer yet, and the lines beneath it.
fn open_question(screen: &str) -> Option<(&str, Vec<&str>)> {
    let lines: Vec<&str> = screen.lines().collect();
    let place = lines.iter().rposition(|line| line.starts_with("? "))?;
    let question = lines[place].get(2..)?;
    (!question.ends_with("(back)")).then(|| (question, lines[place + 1..].to_vec()))
}

/// How many questions were answered, or gone back from.
fn answered(screen: &str) -> usize {
    let is_answered = |line: &&str| {
        let is_item = line
            .get(2..)
            .and_then(|row| row.trim_start().split_once(" - "))
            .is_some_and(|(n, _)| n.parse::<u32>().is_ok());
        (line.starts_with("> ") && !is_item) || (line.starts_with("? ") && line.ends_with("(back)"))
    };
    screen.lines().filter(is_answered).count()
}

/// The command lines that a screen ends with.
fn lines_run(screen: &str) -> Vec<&str> {
    let lines = screen.lines().skip_while(|line| *line != "# What was run:").skip(1);
    lines.filter(|line| !line.is_empty()).collect()
}

/// A shell in `place` with the program's environment, which is to run a script.
fn shell(place: &Place, script: &str) -> Command {
    let mut command = Command::new("sh");
    command.arg("-c").arg(script).current_dir(place.path(""));
    for (name, value) in place.command("").get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    command
}

fn copy(place: &Place, file: &Path) {
    let name = file.file_name().expect("a file");
    std::fs::copy(file, place.path(name)).expect("room for a scene");
}

fn cornell(place: &Place) {
    for name in ["cornell-box.obj", "cornell-box.mtl"] {
        copy(place, &workspace().join("crates/scene/data").join(name));
    }
}

/// Runs a printed line in a shell.
fn by_shell(place: &Place, line: &str) -> Ran {
    shell(place, line)
        .stdin(Stdio::null())
        .output()
        .expect("a shell")
        .into()
}

const MAIN: &str = "Select an option:";
const SCENE: &str = "Select the scene to process:";
const RUN: &str = "Run this command?";
const CHANGE: &str = "Change which setting:";

/// Figure 3.6 of the thesis, and what its text says the interface is for: a scene is chosen, parameters are changed,
/// the error between matrices is computed.
#[test]
fn the_dialogue_of_the_thesis() {
    let place = Place::new();
    cornell(&place);
    // Beside it an AC3D scene as in the thesis, where there are real scenes.
    let mut scene = "cornell-box.obj";
    if let Some(folder) = scenes_dir() {
        copy(&place, &folder.join("cornell/cornell-measured-closed.ac"));
        scene = "cornell-measured-closed.ac";
    }
    let stem = scene.rsplit_once('.').expect("an extension").0;
    // One file cut otherwise is another scene.
    place
        .line(&format!("compute {scene} -o other.hemicube --split 2"))
        .is(0);
    let terminal = Terminal::hemicube(&place);

    terminal.asked(MAIN);
    for (number, item) in [
        (1, "Compute form factors"),
        (2, "Compare results"),
        (3, "Change configuration"),
        (6, "Exit"),
    ] {
        assert_eq!(terminal.number(item), number);
    }
    terminal.answer(&format!("1{ENTER}"));
    terminal.asked(SCENE);
    assert_eq!(terminal.number("cornell-box.obj"), 1);
    terminal.pick(SCENE, scene);
    terminal.asked(RUN);
    let first = format!("{} compute {scene} -o {stem}.hemicube", program().display());
    assert!(
        terminal.screen().contains(&format!("\n$ {first}\n")),
        "{}",
        terminal.screen()
    );
    // Enter takes the highlighted item.
    terminal.answer(ENTER);
    terminal.asked(&format!("What next with {stem}.hemicube:"));
    assert!(place.path(format!("{stem}.hemicube/manifest.json")).exists());
    terminal.answer(ESCAPE);

    terminal.pick(MAIN, "Change configuration");
    terminal.pick(CHANGE, "resolution");
    terminal.typed("resolution:", "64");
    terminal.pick(CHANGE, "correction");
    terminal.pick("correction:", "pixel");
    terminal.pick(CHANGE, "Back");

    terminal.pick(MAIN, "Compute form factors");
    terminal.pick(SCENE, scene);
    terminal.pick(RUN, "Another name for the result");
    terminal.typed("Folder for the result:", "");
    terminal.pick(RUN, "Run it");
    terminal.pick(&format!("What next with {stem}-2.hemicube:"), "Back");

    terminal.pick(MAIN, "Compare results");
    terminal.asked("Compare which result:");
    terminal.number("other.hemicube");
    terminal.pick("Compare which result:", &format!("{stem}-2.hemicube"));
    terminal.asked("With which reference:");
    let screen = terminal.screen();
    let (_, rows) = open_question(&screen).expect("a menu");
    assert!(
        rows[0].starts_with(&format!("> 1 - {stem}.hemicube  tolerance 2.0 %, 128 px")),
        "{screen}"
    );
    assert!(rows[1].starts_with("  2 - Another…"), "{screen}");
    terminal.pick("With which reference:", &format!("{stem}.hemicube"));
    terminal.asked(MAIN);
    let compared = place
        .line(&format!("compare {stem}-2.hemicube {stem}.hemicube"))
        .is(0)
        .out;
    assert!(compared.contains("relative Frobenius error"), "{compared}");
    let screen = terminal.screen();
    for line in compared.lines() {
        assert!(
            screen.contains(line.trim_end()),
            "`{line}` is not on the screen:\n{screen}"
        );
    }
    terminal.pick(MAIN, "Exit");
    let ran = terminal.ends().is(0);

    // The lines say all of it: by themselves, somewhere else, they give the same bytes.
    let lines = lines_run(&ran.out);
    let second = format!(
        "{} compute {scene} -o {stem}-2.hemicube --correction pixel --resolution 64",
        program().display()
    );
    assert_eq!(lines.len(), 3, "{lines:?}");
    assert_eq!(lines[..2], [first, second]);
    let elsewhere = Place::new();
    copy(&elsewhere, &place.path(scene));
    for line in &lines {
        assert!(by_shell(&elsewhere, line).code.is_some_and(|code| code == 0), "{line}");
    }
    for store in [format!("{stem}.hemicube"), format!("{stem}-2.hemicube")] {
        assert_same(&place.path(&store), &elsewhere.path(&store));
    }
}

#[test]
fn arrow_keys_move_and_words_filter() {
    let place = Place::new();
    for name in ["high.ac", "high_x16.ac", "room.obj"] {
        std::fs::write(place.path(name), "").unwrap();
    }
    let terminal = Terminal::hemicube(&place);
    terminal.asked(MAIN);
    terminal.type_in(&format!("{DOWN}{DOWN}{UP}{UP}"));
    terminal.waits("the first item", |screen| {
        screen.contains("\n> 1 - Compute form factors")
    });
    terminal.type_in(DOWN);
    terminal.waits("the second item", |screen| screen.contains("\n> 2 - Compare results"));
    terminal.type_in(UP);
    terminal.answer(ENTER);
    terminal.asked(SCENE);
    terminal.type_in("X16");
    terminal.waits("one item", |screen| {
        open_question(screen).is_some_and(|(_, rows)| rows[0].starts_with("> 2 - high_x16.ac") && rows.len() == 2)
    });
    // A name that matches nothing cannot be chosen.
    terminal.type_in(&format!("?{ENTER}"));
    terminal.waits("no item", |screen| {
        open_question(screen).is_some_and(|(_, rows)| rows.len() == 1)
    });
    terminal.answer(&format!("{BACKSPACE}{ENTER}"));
    terminal.asked(RUN);
    assert!(
        terminal.screen().contains("compute high_x16.ac -o high_x16.hemicube\n"),
        "{}",
        terminal.screen()
    );
}

#[test]
fn back_and_away_by_escape_and_the_end_of_the_input() {
    let place = Place::new();
    cornell(&place);
    for keys in [ESCAPE, CTRL_D] {
        let terminal = Terminal::hemicube(&place);
        terminal.pick(MAIN, "Compute form factors");
        terminal.asked(SCENE);
        terminal.pick(SCENE, "cornell-box.obj");
        terminal.asked(RUN);
        terminal.answer(keys);
        terminal.pick(MAIN, "Change configuration");
        terminal.pick(CHANGE, "threads");
        terminal.asked("threads:");
        terminal.answer(keys);
        terminal.asked(CHANGE);
        terminal.answer(keys);
        terminal.asked(MAIN);
        terminal.type_in(keys);
        let ran = terminal.ends().is(0);
        assert!(lines_run(&ran.out).is_empty(), "nothing was run: {}", ran.out);
    }
    assert!(!place.path("cornell-box.hemicube").exists());
}

#[test]
fn a_terminal_that_goes_away_ends_it() {
    let place = Place::new();
    let (mut pty, other_end) = pty_process::blocking::open().expect("a pseudo-terminal");
    pty.resize(pty_process::Size::new(24, 80)).expect("a size");
    let mut command = place.command("");
    command.env("TERM", "xterm");
    let mut child = OnTerminal::from(command).spawn(other_end).expect("the program starts");
    // No thread here that would hold the terminal.
    let mut seen = Vec::new();
    while !String::from_utf8_lossy(&seen).contains("Esc: exit") {
        let mut bytes = [0; 4096];
        let count = pty.read(&mut bytes).expect("the program writes");
        seen.extend_from_slice(&bytes[..count]);
    }
    drop(pty);
    let started = Instant::now();
    while child.try_wait().expect("its state").is_none() {
        if started.elapsed() > PATIENCE {
            let _ = child.kill();
            panic!("it does not end with its terminal");
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn control_c_at_a_question_ends_it_and_leaves_the_terminal_as_it_was() {
    let place = Place::new();
    cornell(&place);
    let script = format!(
        "stty -a > before; '{}'; echo \"exit $?\"; stty -a > after",
        program().display()
    );
    let terminal = Terminal::start(shell(&place, &script), TALL);
    terminal.pick(MAIN, "Inspect a scene");
    terminal.pick("Inspect which scene:", "cornell-box.obj");
    terminal.asked(MAIN);
    terminal.type_in(CTRL_C);
    terminal.waits("the end", |screen| screen.contains("\nexit 130"));
    let screen = terminal.screen();
    assert_eq!(
        lines_run(&screen)[0],
        format!("{} inspect cornell-box.obj", program().display()),
        "{screen}"
    );
    {
        let shown = terminal.shown();
        let screen = shown.0.screen();
        assert!(!screen.hide_cursor() && !screen.bracketed_paste());
    }
    terminal.ends();
    let settings = |name: &str| std::fs::read_to_string(place.path(name)).expect("stty ran");
    assert_eq!(settings("before"), settings("after"));
    assert!(settings("after").contains(" icanon"), "{}", settings("after"));
}

#[test]
fn a_request_to_terminate_leaves_the_terminal_as_it_was() {
    let place = Place::new();
    let terminal = Terminal::hemicube(&place);
    terminal.asked(MAIN);
    let sent = Command::new("kill").arg(terminal.child.id().to_string()).status();
    assert!(sent.expect("`kill` runs").success());
    {
        let started = Instant::now();
        while terminal.shown().0.screen().bracketed_paste() {
            assert!(started.elapsed() < PATIENCE, "{}", terminal.screen());
            std::thread::sleep(Duration::from_millis(10));
        }
    }
    assert!(!terminal.shown().0.screen().hide_cursor());
    terminal.ends().is(130);
}

#[test]
fn control_c_while_rows_are_computed_keeps_them_and_comes_back() {
    let place = Place::new();
    place.line("generate room --patches 1000 -o room.obj").is(0);
    place
        .line("compute room.obj -o straight.hemicube --correction pixel --samples 16")
        .is(0);
    std::fs::write(place.path("hemicube.toml"), "correction = \"pixel\"\nsamples = 16\n").unwrap();
    let terminal = Terminal::hemicube(&place);
    terminal.pick(MAIN, "Compute form factors");
    terminal.pick(SCENE, "room.obj");
    terminal.pick(RUN, "Run it");
    until("a part is written", || {
        std::fs::read_dir(place.path("room.hemicube/parts")).is_ok_and(|parts| parts.count() > 0)
    });
    terminal.type_in(CTRL_C);
    terminal.asked(RUN);
    let screen = terminal.screen();
    for words in [
        "interrupted: finishing what is being computed",
        "(exit status 130: it was interrupted)",
        "`room.hemicube` is there already:",
    ] {
        assert!(screen.contains(words), "`{words}` is not on the screen:\n{screen}");
    }
    let manifest = std::fs::read_to_string(place.path("room.hemicube/manifest.json")).expect("a manifest");
    let manifest: serde_json::Value = serde_json::from_str(&manifest).expect("JSON");
    assert_eq!(
        manifest["complete"], false,
        "it was done before it could be interrupted"
    );
    terminal.pick(RUN, "Go on with it");
    terminal.pick("What next with room.hemicube:", "Back");
    terminal.pick(MAIN, "Exit");
    let ran = terminal.ends().is(0);
    let lines = lines_run(&ran.out);
    assert!(
        lines[0].ends_with("compute room.obj -o room.hemicube  # exit status 130"),
        "{lines:?}"
    );
    assert!(lines[1].ends_with("compute room.obj -o room.hemicube"), "{lines:?}");
    assert_same(&place.path("straight.hemicube"), &place.path("room.hemicube"));
}

#[test]
fn a_wrong_value_is_refused_in_the_words_of_the_command_line() {
    let place = Place::new();
    cornell(&place);
    let terminal = Terminal::hemicube(&place);
    terminal.pick(MAIN, "Change configuration");
    for (setting, wrong, right) in [
        ("resolution", "100", "64"),
        ("samples", "3", "4"),
        ("tolerance", "5", "5%"),
    ] {
        let refused = place
            .line(&format!("compute cornell-box.obj -o x --{setting} {wrong}"))
            .is(2);
        let reason = refused
            .err
            .lines()
            .next()
            .expect("a reason")
            .trim_start_matches("error: ")
            .to_owned();
        terminal.pick(CHANGE, setting);
        terminal.asked(&format!("{setting}:"));
        terminal.type_in(&format!("{wrong}{ENTER}"));
        terminal.waits(&reason, |screen| screen.contains(&reason));
        terminal.asked(&format!("{setting}: {wrong}"));
        terminal.answer(&format!("{}{right}{ENTER}", BACKSPACE.repeat(wrong.len())));
        terminal.asked(CHANGE);
        let row = format!("{setting}  ");
        terminal.waits("the new value", |screen| {
            let (_, rows) = open_question(screen).expect("a menu");
            rows.iter()
                .any(|row_shown| row_shown.contains(&row) && row_shown.contains(&format!("{right}*")))
        });
    }
    // Pixels and a tolerance, and hemicubes a patch and a tolerance, exclude each other: the last choice holds.
    let screen = terminal.screen();
    let (_, rows) = open_question(&screen).expect("a menu");
    assert!(
        rows.iter().any(|row| row.contains("samples") && !row.contains("4*")),
        "{screen}"
    );
    terminal.pick(CHANGE, "Back");
    terminal.pick(MAIN, "Compute form factors");
    terminal.pick(SCENE, "cornell-box.obj");
    terminal.asked(RUN);
    let line = "compute cornell-box.obj -o cornell-box.hemicube --tolerance 5%\n";
    assert!(terminal.screen().contains(line), "{}", terminal.screen());
}

#[test]
fn settings_are_written_to_the_file_only_when_that_is_said() {
    let place = Place::new();
    cornell(&place);
    std::fs::write(
        place.path("hemicube.toml"),
        "# ours\ncorrection = \"tolerance\" # enough\ntolerance = 0.02\nscenes = \"more\"\n",
    )
    .unwrap();
    std::fs::create_dir(place.path("more")).unwrap();
    std::fs::write(place.path("more/other.ac"), "").unwrap();
    let file = || std::fs::read_to_string(place.path("hemicube.toml")).expect("the file");
    let before = file();
    let terminal = Terminal::hemicube(&place);
    terminal.pick(MAIN, "Change configuration");
    terminal.pick(CHANGE, "tolerance");
    terminal.waits("where it comes from", |screen| {
        screen.contains("It is 0.02, from hemicube.toml:3.")
    });
    terminal.answer(ESCAPE);
    terminal.pick(CHANGE, "correction");
    terminal.pick("correction:", "pixel");
    terminal.pick(CHANGE, "resolution");
    terminal.typed("resolution:", "64");
    terminal.pick(CHANGE, "Write changes");
    terminal.asked("Write these settings:");
    terminal.answer(ESCAPE);
    terminal.asked(CHANGE);
    assert_eq!(file(), before, "nobody said that it be written");
    terminal.pick(CHANGE, "Write changes");
    terminal.pick("Write these settings:", "Write them");
    terminal.asked(CHANGE);
    assert_eq!(
        file(),
        "# ours\ncorrection = \"pixel\" # enough\n# tolerance = 0.02\nscenes = \"more\"\nresolution = 64\n"
    );
    // Options are not needed for them any more.
    terminal.pick(CHANGE, "Back");
    terminal.pick(MAIN, "Compute form factors");
    terminal.asked(SCENE);
    assert_eq!(terminal.number("more/other.ac"), 2);
    terminal.pick(SCENE, "cornell-box.obj");
    terminal.asked(RUN);
    let line = "compute cornell-box.obj -o cornell-box.hemicube\n";
    assert!(terminal.screen().contains(line), "{}", terminal.screen());
    terminal.pick(RUN, "Run it");
    terminal.asked("What next with cornell-box.hemicube:");
    drop(terminal);
    place
        .line("compute cornell-box.obj -o other.hemicube --config=none --correction pixel --resolution 64")
        .is(0);
    assert_same(&place.path("other.hemicube"), &place.path("cornell-box.hemicube"));
}

#[test]
fn a_result_is_looked_at() {
    let place = Place::new();
    cornell(&place);
    place.line("compute cornell-box.obj -o a.hemicube").is(0);
    std::fs::write(place.path("a.npz"), "mine").unwrap();
    let terminal = Terminal::hemicube(&place);
    terminal.pick(MAIN, "Look at a result");
    terminal.asked("Look at which result:");
    assert!(
        terminal
            .screen()
            .contains("a.hemicube  tolerance 2.0 %, 128 px, cpu, 40 patches of cornell-box.obj"),
        "{}",
        terminal.screen()
    );
    terminal.pick("Look at which result:", "a.hemicube");
    let next = "What next with a.hemicube:";
    terminal.pick(next, "Check it");
    terminal.pick(next, "Draw the matrix");
    // The scene is found by the name that the matrix has of it.
    terminal.pick(next, "Write a page");
    terminal.pick(next, "Export it");
    terminal.asked("a.npz is there already:");
    assert_eq!(std::fs::read(place.path("a.npz")).expect("the file"), b"mine");
    terminal.pick("a.npz is there already:", "Replace it");
    terminal.pick(next, "Back");
    terminal.pick(MAIN, "Exit");
    let ran = terminal.ends().is(0);
    let lines: Vec<&str> = lines_run(&ran.out)
        .iter()
        .map(|line| &line[program().as_os_str().len() + 1..])
        .collect();
    assert_eq!(
        lines,
        [
            "check a.hemicube",
            "view sparsity a.hemicube -o a.png",
            "report a.hemicube cornell-box.obj -o a.html",
            "export a.hemicube -o a.npz --overwrite",
        ]
    );
    assert!(std::fs::read(place.path("a.npz")).expect("the file").starts_with(b"PK"));
    assert!(place.path("a.png").exists() && place.path("a.html").exists());
}

/// As the command asks for it, which refuses the scene without `--up`.
#[test]
fn up_is_asked_for_where_nothing_tells() {
    let place = Place::new();
    place.write(
        "cube.obj",
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
         f 1 2 3 4\nf 8 7 6 5\nf 1 5 6 2\nf 3 7 8 4\nf 2 6 7 3\nf 1 4 8 5\n",
    );
    place.line("compute cube.obj -o a.hemicube").is(0);
    place.line("compute cube.obj -o told.hemicube --up x").is(0);
    place.line("report a.hemicube cube.obj -o a.html").is(2);
    let terminal = Terminal::hemicube(&place);
    let up = "Which axis points up:";
    for store in ["a.hemicube", "told.hemicube"] {
        let next = format!("What next with {store}:");
        terminal.pick(MAIN, "Look at a result");
        terminal.pick("Look at which result:", store);
        terminal.pick(&next, "Write a page");
        if store == "a.hemicube" {
            terminal.asked(up);
            let screen = terminal.screen();
            assert!(screen.contains("does not say which axis points up"), "{screen}");
            let (_, rows) = open_question(&screen).expect("a menu");
            assert!(rows.contains(&"> 2 - y  guessed"), "{screen}");
            terminal.answer(ESCAPE);
            terminal.pick(&next, "Write a page");
            terminal.asked(up);
            terminal.answer(ENTER);
            terminal.pick(&next, "Write a page");
            terminal.pick(up, "z");
            terminal.pick("a.html is there already:", "Replace it");
        }
        terminal.pick(&next, "Back");
    }
    terminal.pick(MAIN, "Exit");
    let ran = terminal.ends().is(0);
    let lines: Vec<&str> = lines_run(&ran.out)
        .iter()
        .map(|line| &line[program().as_os_str().len() + 1..])
        .collect();
    assert_eq!(
        lines,
        [
            "report a.hemicube cube.obj -o a.html --up y",
            "report a.hemicube cube.obj -o a.html --up z --overwrite",
            "report told.hemicube cube.obj -o told.html",
        ]
    );
}

#[test]
fn where_no_scene_is_one_is_named_or_generated() {
    let place = Place::new();
    let terminal = Terminal::hemicube(&place);
    terminal.pick(MAIN, "Compute form factors");
    terminal.waits("that there is none", |screen| screen.contains("There is no scene here"));
    // A path is completed by Tab, and one that leads nowhere is refused.
    terminal.pick(SCENE, "Another file");
    terminal.asked("File of the scene:");
    let folder = workspace()
        .join("crates/scene/data")
        .canonicalize()
        .expect("the folder");
    terminal.type_in(&format!("{}/cornell-box.o\t", folder.display()));
    terminal.waits("the whole name", |screen| {
        open_question(screen).is_some_and(|(asked, _)| asked.trim_end().ends_with("/cornell-box.obj"))
    });
    terminal.type_in(&format!("x{ENTER}"));
    terminal.waits("that it is not there", |screen| {
        screen.contains("cornell-box.objx` does not exist")
    });
    let file = "cornell-box.objx".len();
    terminal.type_in(&format!("{}{ENTER}", BACKSPACE.repeat(file)));
    terminal.waits("that it is no file", |screen| screen.contains("/data/` is a directory"));
    terminal.answer(ESCAPE);
    terminal.pick(SCENE, "Generate a room");
    terminal.pick(SCENE, "room.obj");
    terminal.asked(RUN);
    terminal.answer(ESCAPE);
    terminal.pick(MAIN, "Compare results");
    terminal.waits("that there is none", |screen| {
        screen.contains("There is no such result here.")
    });
}

#[test]
fn a_command_that_fails_says_why_and_the_dialogue_goes_on() {
    let place = Place::new();
    std::fs::write(place.path("it's broken.obj"), "v 0 0 x\n").unwrap();
    let terminal = Terminal::hemicube(&place);
    terminal.pick(MAIN, "Compute form factors");
    terminal.pick(SCENE, "it's broken.obj");
    terminal.pick(RUN, "Run it");
    terminal.asked(RUN);
    let screen = terminal.screen();
    assert!(
        screen.contains("it's broken.obj:1") && screen.contains("(exit status 2: it failed)"),
        "{screen}"
    );
    terminal.answer(ESCAPE);
    terminal.pick(MAIN, "Exit");
    let ran = terminal.ends().is(0);
    let line = format!(
        r"{} compute 'it'\''s broken.obj' -o 'it'\''s broken.hemicube'  # exit status 2",
        program().display()
    );
    assert_eq!(lines_run(&ran.out), [line.as_str()]);
    by_shell(&place, &line).is(2).says(&["it's broken.obj:1"]);
}

#[test]
fn menus_fit_narrow_screens() {
    for (rows, columns) in [(24, 80), (20, 50), (10, 40)] {
        let place = Place::new();
        std::fs::write(
            place.path("a-scene-with-a-name-that-is-longer-than-most-screens-are-wide.obj"),
            "",
        )
        .unwrap();
        std::fs::write(place.path("b.ac"), "").unwrap();
        let terminal = Terminal::start(place.command(""), (rows, columns));
        let fits = |question: &str| {
            terminal.asked(question);
            // A menu is drawn again line by line: for a moment, the old and the new item are both highlighted.
            terminal.waits("one highlighted item", |screen| {
                let menu = screen.rsplit_once("\n? ").map_or("", |(_, menu)| menu);
                menu.lines().filter(|line| line.starts_with("> ")).count() == 1
            });
            let shown = terminal.shown();
            let screen = shown.0.screen();
            let contents: Vec<String> = screen.rows(0, columns).collect();
            let question_row = contents
                .iter()
                .rposition(|row| row.starts_with("? "))
                .expect("the question");
            // From the question on every row is one of the menu: none is broken in two.
            for (row, text) in contents.iter().enumerate().skip(question_row) {
                let row = u16::try_from(row).expect("a row");
                assert!(!screen.row_wrapped(row), "row {row} of {columns} columns: {text}");
            }
            let items = contents
                .iter()
                .skip(question_row + 1)
                .filter(|row| row.contains(" - "))
                .count();
            assert!(items >= 3, "{contents:?}");
        };
        fits(MAIN);
        terminal.type_in(&format!("3{ENTER}"));
        fits(CHANGE);
        // To the last item and back, through all pages of the menu.
        terminal.type_in(UP);
        terminal.waits("the last item", |screen| screen.contains("\n> 11 - Back"));
        fits(CHANGE);
        terminal.type_in(DOWN);
        terminal.waits("the first item", |screen| screen.contains("\n>  1 - tolerance"));
        fits(CHANGE);
        terminal.type_in(ESCAPE);
        fits(MAIN);
        terminal.type_in(&format!("1{ENTER}"));
        fits(SCENE);
    }
}

#[test]
fn colours_are_left_out_where_nobody_wants_them() {
    let place = Place::new();
    let colored = |value: Option<&str>| {
        let mut command = place.command("");
        if let Some(value) = value {
            command.env("NO_COLOR", value);
        }
        let terminal = Terminal::start(command, TALL);
        terminal.asked(MAIN);
        let bytes = terminal.bytes();
        bytes.windows(5).any(|window| window == b"\x1b[38;")
    };
    assert!(colored(None));
    assert!(!colored(Some("1")));
}

#[test]
fn a_terminal_that_can_do_lines_only_gets_lines() {
    let place = Place::new();
    cornell(&place);
    let mut command = place.command("");
    command.env("TERM", "dumb");
    let terminal = Terminal::start(command, TALL);
    let says = |words: &str| {
        terminal.waits(words, |screen| {
            screen.ends_with(words) || screen.trim_end().ends_with(words)
        })
    };
    says("6 - Exit\nNumber:");
    terminal.type_in("1\n");
    says("3 - Back\nNumber:");
    terminal.type_in("17\n");
    says("`17` is none of them; a number from 1 to 3 is needed\nNumber:");
    terminal.type_in("1\n");
    says("4 - Back\nNumber:");
    terminal.type_in("1\n");
    says("6 - Back\nNumber:");
    terminal.type_in(CTRL_C);
    // The last that it writes.
    terminal.waits("what was run", |screen| lines_run(screen).len() == 1);
    let bytes = terminal.bytes();
    let ran = terminal.ends().is(130);
    assert_eq!(lines_run(&ran.out).len(), 1, "{}", ran.out);
    assert!(!bytes.contains(&0x1b), "{}", String::from_utf8_lossy(&bytes));
    assert!(place.path("cornell-box.hemicube/manifest.json").exists());
}

#[test]
fn a_script_may_answer() {
    let place = Place::new();
    cornell(&place);
    let answer = |answers: &str| {
        let mut command = place.command("interactive");
        command.stdin(Stdio::piped());
        let mut child = place.spawn(command);
        let mut input = child.stdin.take().expect("its input");
        input.write_all(answers.as_bytes()).expect("it reads");
        drop(input);
        hemicube_tests::runs::finish(child)
    };
    // By numbers and by names; the input ends at a question.
    let ran = answer("compute\n1\nrun it\ncheck\n").is(0);
    assert!(ran.err.contains("What next with cornell-box.hemicube:"), "{}", ran.err);
    let lines = lines_run(&ran.out);
    assert_eq!(lines.len(), 2, "{lines:?}");
    assert!(lines[1].ends_with("check cornell-box.hemicube"), "{lines:?}");
    let ran = answer("").is(0);
    assert!(lines_run(&ran.out).is_empty(), "{}", ran.out);
}

#[test]
fn without_a_terminal_nothing_is_asked() {
    let place = Place::new();
    let bare = place.line("").is(2).says(&["Usage: hemicube [OPTIONS] <COMMAND>"]);
    assert!(!bare.err.contains("Select an option"), "{}", bare.err);
    // Its input is at its end: there are no answers.
    place.line("interactive").is(0);
    // One that is written to is not enough, and neither is one to read from.
    for redirected in ["> out", "2> err", "< /dev/null"] {
        let script = format!("'{}' {redirected}; echo \"exit $?\"", program().display());
        let ran = Terminal::start(shell(&place, &script), TALL).ends();
        assert!(
            ran.out.contains("exit 2") && !ran.out.contains("Select an option"),
            "{redirected}: {}",
            ran.out
        );
    }
}
