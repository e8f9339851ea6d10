//! `view --live` in a window on an X server without a screen, and what is said where there is none.
//!
//! Needs Xvfb and xwd; `HEMICUBE_REQUIRE_DISPLAY=1` makes their absence a failure.
//! The binary is the one beside this test: build it with the same profile and target directory before.

use hemicube_tests::scenes::{program, skip, workspace};
use std::collections::HashSet;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(60);

/// An X server that draws into memory.
struct Display {
    server: Child,
    name: String,
}

impl Display {
    fn start(test: &str) -> Option<Self> {
        let folders = std::env::var_os("PATH").unwrap_or_default();
        for program in ["Xvfb", "xwd"] {
            if !std::env::split_paths(&folders).any(|folder| folder.join(program).is_file()) {
                skip(
                    test,
                    &format!("`{program}` is not installed"),
                    "HEMICUBE_REQUIRE_DISPLAY",
                );
                return None;
            }
        }
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1000x800x24", "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb starts");
        let mut number = String::new();
        BufReader::new(server.stdout.take().expect("its output"))
            .read_line(&mut number)
            .expect("Xvfb says its display");
        Some(Self {
            server,
            name: format!(":{}", number.trim()),
        })
    }

    /// The pixels of the whole screen, as `xwd` writes them (X11/XWDFile.h).
    fn pixels(&self) -> Vec<u32> {
        let output = Command::new("xwd")
            .args(["-root", "-silent", "-display", &self.name])
            .output()
            .expect("xwd runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let dump = output.stdout;
        let field = |k: usize| u32::from_be_bytes(dump[4 * k..4 * k + 4].try_into().expect("four bytes")) as usize;
        assert_eq!((field(1), field(4), field(5), field(11)), (7, 1000, 800, 32));
        let first = field(0) + 12 * field(19);
        let pixels = dump[first..].as_chunks::<4>().0;
        assert_eq!(pixels.len(), 1000 * 800);
        pixels
            .iter()
            .map(|&bytes| u32::from_le_bytes(bytes) & 0x00ff_ffff)
            .collect()
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

fn live(display: Option<&str>, more: &[&str]) -> Command {
    let mut command = Command::new(program());
    command
        .args(["view", "hemicube", "--live", "--split", "16", "--resolution", "64"])
        .arg(workspace().join("crates/scene/data/cornell-box.obj"))
        .args(more)
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    if let Some(display) = display {
        command.env("DISPLAY", display);
    }
    command
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn hemicubes_are_seen_one_after_another() {
    let Some(display) = Display::start("live::hemicubes_are_seen_one_after_another") else {
        return;
    };
    let colors = |pixels: &[u32]| pixels.iter().copied().collect::<HashSet<u32>>().len();
    let dark = display.pixels();
    assert!(colors(&dark) < 4, "the screen is not empty");
    let mut running = live(Some(&display.name), &[]).spawn().expect("the program runs");
    let started = Instant::now();
    let seen = loop {
        let pixels = display.pixels();
        if colors(&pixels) > 100 {
            break pixels;
        }
        if running.try_wait().expect("its state").is_some() || started.elapsed() > PATIENCE {
            let _ = running.kill();
            panic!(
                "no hemicube is seen: {}",
                said(&running.wait_with_output().expect("its output"))
            );
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    // The next one is another.
    let started = Instant::now();
    while display.pixels() == seen {
        assert!(started.elapsed() < PATIENCE, "the picture stands still");
        std::thread::sleep(Duration::from_millis(50));
    }
    let _ = running.kill();
    let _ = running.wait();
}

#[test]
fn without_a_display_it_says_so() {
    let output = live(None, &[]).output().expect("the program runs");
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    for words in ["no window can be opened", "DISPLAY", "-o FILE"] {
        assert!(said(&output).contains(words), "{}", said(&output));
    }
    let output = live(Some(":7777"), &[]).output().expect("the program runs");
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("no window can be opened"), "{}", said(&output));
}

/// X libraries are opened with the window, so that the program starts where there are none.
#[test]
#[cfg(target_os = "linux")]
fn the_program_needs_no_x_libraries_to_start() {
    let Ok(output) = Command::new("ldd").arg(program()).output() else {
        skip(
            "live::the_program_needs_no_x_libraries_to_start",
            "no `ldd`",
            "HEMICUBE_REQUIRE_DISPLAY",
        );
        return;
    };
    let libraries = String::from_utf8_lossy(&output.stdout);
    assert!(libraries.contains("libc."), "{libraries}");
    assert!(
        !libraries.contains("libX") && !libraries.contains("libxcb"),
        "{libraries}"
    );
}
