//! Every way in which a plugin can be wrong, a test each, as `docs/plugins.md` lists them: what the host says, that it
//! lives on, and that a store keeps nothing wrong.
//!
//! Tries faults that end the process which loads a plugin, in processes of the program's own.

use glam::DVec3;
use hemicube::backend::{BackendError, HemicubeBackend};
use hemicube::row::RowBlock;
use hemicube_host::{LoadError, LoadedBackend, OpenError, file_name};
use hemicube_scene::Subdivision;
use hemicube_tests::plugins::{c, c_with, library, rust, session, sources, try_session};
use hemicube_tests::rows::{hemicubes, settings, spread};
use hemicube_tests::scenes::{model, program, workspace};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

const RESOLUTION: u32 = 16;

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary directory")
}

/// The plugin with a table that is wrong by these macros.
fn bad_table(place: &TempDir, macros: &[&str]) -> PathBuf {
    c("faulty/table.c", place.path(), "bad-table", macros)
}

#[track_caller]
fn refused(path: &Path) -> LoadError {
    library(path).expect_err("it is not loaded")
}

fn faulty(fault: &str) -> LoadedBackend {
    session(&rust("faulty"), &[&format!("fault={fault}")])
}

/// A session with a small scene loaded, and what comes of five rows.
fn rows_of(backend: &mut LoadedBackend, covered: bool) -> Result<RowBlock, BackendError> {
    let room = model(hemicube_scene::generate::cornell_box(), Subdivision::None);
    let mut settings = settings(RESOLUTION);
    settings.covered = covered;
    backend.load(room.geometry(), settings)?;
    let mut rows = RowBlock::default();
    backend.rows(&hemicubes(&room, &spread(&room, 5)), &mut rows)?;
    Ok(rows)
}

/// A fault in `rows` is an error with these words; the session is closed, and another one is as good as ever.
#[track_caller]
fn rows_fail(fault: &str, words: &[&str]) -> BackendError {
    let mut backend = faulty(fault);
    let error = rows_of(&mut backend, true).expect_err(fault);
    for word in words {
        assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
    }
    let again = rows_of(&mut backend, true).expect_err("the session is closed");
    assert!(again.to_string().contains("closed after it had failed"), "{again}");
    let rows = rows_of(&mut faulty("none"), true).expect("another session");
    assert_eq!(rows.len(), 5);
    error
}

/// A run of the program in a folder of its own.
struct Run {
    place: TempDir,
}

impl Run {
    fn new() -> Self {
        let run = Self { place: folder() };
        // Enough rows for several parts, so that a fault can come after some of them are stored.
        let made = run.program(&["generate", "room", "--patches", "1000", "-o", "room.obj"]);
        assert!(made.status.success(), "{}", text(&made.stderr));
        run
    }

    /// The program, without settings of the user or the environment.
    fn command(&self) -> Command {
        let mut command = Command::new(program());
        for (name, _) in std::env::vars_os() {
            if name.to_string_lossy().starts_with("HEMICUBE_") {
                command.env_remove(name);
            }
        }
        command
            .current_dir(self.place.path())
            .env("HOME", self.place.path())
            .env_remove("XDG_CONFIG_HOME")
            .env_remove("XDG_DATA_HOME");
        command
    }

    fn program(&self, arguments: &[&str]) -> Output {
        self.command().args(arguments).output().expect("the program runs")
    }

    /// `compute` with the faulty backend, on one thread.
    fn compute_command(&self, options: &[&str]) -> Command {
        let mut command = self.command();
        command.args("compute room.obj -o m --correction pixel --resolution 16".split(' '));
        command
            .args("--threads 1 --culling on --batch 32 --backend".split(' '))
            .arg(rust("faulty"));
        for option in options {
            command.args(["--backend-option", option]);
        }
        command
    }

    fn compute(&self, options: &[&str]) -> Output {
        self.compute_command(options).output().expect("the program runs")
    }

    /// What is stored is a store, begun and not finished, of which nothing is wrong: every part is that of a run
    /// without a fault, byte by byte.
    #[track_caller]
    fn store_is_intact(&self) {
        let checked = self.program(&["check", "m"]);
        let said = format!("{}{}", text(&checked.stdout), text(&checked.stderr));
        assert_ne!(
            checked.status.code(),
            Some(0),
            "an unfinished store passed for a finished one: {said}"
        );
        assert!(said.contains("UNFINISHED  parts are still to be computed"), "{said}");
        let checked = self.program(&["check", "m", "--allow-incomplete"]);
        let said = format!("{}{}", text(&checked.stdout), text(&checked.stderr));
        assert_eq!(checked.status.code(), Some(0), "{said}");
        let good = Self::new();
        let output = good.compute(&[]);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let parts = self.parts();
        assert!(!parts.is_empty(), "nothing was stored before the fault");
        for (name, bytes) in parts {
            let wanted = std::fs::read(good.place.path().join("m/parts").join(&name)).expect("a part of the good run");
            assert!(bytes == wanted, "{name} is not that of a run without a fault");
        }
    }

    /// Finished parts, by name. One that was being written has a name of another form.
    fn parts(&self) -> BTreeMap<String, Vec<u8>> {
        let entries = std::fs::read_dir(self.place.path().join("m/parts"));
        let names = entries.into_iter().flatten().flatten().map(|entry| entry.file_name());
        names
            .map(|name| name.to_string_lossy().into_owned())
            .filter(|name| name.ends_with(".npz"))
            .map(|name| {
                (
                    name.clone(),
                    std::fs::read(self.place.path().join("m/parts").join(name)).expect("a part"),
                )
            })
            .collect()
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A fault after some parts are stored: exit 2 with these words, and an intact store.
#[track_caller]
fn compute_fails(fault: &str, words: &[&str]) {
    let run = Run::new();
    let output = run.compute(&[&format!("fault={fault}"), "after=11"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert_eq!(
        said.lines().filter(|line| line.starts_with("error: ")).count(),
        1,
        "{said}"
    );
    for word in [&["backend `faulty`"], words].concat() {
        assert!(said.contains(word), "`{word}` is not in: {said}");
    }
    run.store_is_intact();
}

#[test]
fn fault_01_missing_file_wrong_format_or_architecture() {
    let place = folder();
    let path = place.path().join(file_name("x"));
    assert_eq!(refused(&path), LoadError::Missing);
    std::fs::write(&path, "no library").expect("a file");
    let LoadError::Refused(said) = refused(&path) else {
        panic!("not the loader's words")
    };
    assert!(!said.is_empty() && !said.contains(&*path.to_string_lossy()), "{said}");
    // The header of a library for another processor.
    let mut bytes = std::fs::read(rust("rust-minimal")).expect("a library");
    bytes[18] ^= 0xFF;
    std::fs::write(&path, bytes).expect("a file");
    assert!(matches!(refused(&path), LoadError::Machine { .. }));
    let run = Run::new();
    std::fs::write(run.place.path().join("x.so"), "no library").expect("a file");
    let output = run.program(&["compute", "room.obj", "-o", "m", "--backend", "./x.so"]);
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(
        said.starts_with("error: backend `./x.so`: not loaded: ") && said.contains("hint: "),
        "{said}"
    );
    assert!(!run.place.path().join("m").exists());
}

#[test]
fn fault_02_no_table() {
    let place = folder();
    let wrong = refused(&bad_table(&place, &["NO_SYMBOL"]));
    assert_eq!(wrong, LoadError::NoTable);
    assert!(wrong.to_string().starts_with("not a hemicube backend"));
}

#[test]
fn fault_03_another_version_of_the_abi() {
    let place = folder();
    let wrong = refused(&bad_table(&place, &["FAULT_ABI=7"]));
    assert_eq!(wrong, LoadError::Abi { found: 7 });
    assert_eq!(wrong.to_string(), "built for ABI 7, this program speaks ABI 1");
}

#[test]
fn fault_04_truncated_table() {
    let place = folder();
    assert_eq!(
        refused(&bad_table(&place, &["FAULT_SIZE=16"])),
        LoadError::Truncated { found: 16 }
    );
}

#[test]
fn a_table_of_the_first_version_is_loaded_and_has_neither_passes_nor_rays() {
    let place = folder();
    let path = bad_table(&place, &["FAULT_SIZE=80", "OLD", "FAULT_PASS=behind"]);
    let model = model(hemicube_scene::generate::cornell_box(), Subdivision::None);
    let mut old = session(&path, &[]);
    assert!(!old.info().capabilities.passes && old.info().capabilities.items);
    old.load(model.geometry(), settings(RESOLUTION)).expect("a small scene");
    let open = vec![u32::MAX; hemicube::face::pixel_count(RESOLUTION) / 32];
    let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z];
    let pass = hemicube::backend::Pass {
        origin: DVec3::ZERO,
        axes: [x, y, z],
        normal: z,
        offset: 0.1,
        open: &open,
    };
    let refused = old.pass(&pass);
    assert!(matches!(refused, Err(BackendError::Unsupported(_))), "{refused:?}");
    let rays = hemicube::backend::Rays {
        emitter: hemicube_scene::InputPatch(0),
        normal: z,
        offset: 0.0,
        ends: &[],
    };
    let refused = old.rays(&rays);
    assert!(matches!(refused, Err(BackendError::Unsupported(_))), "{refused:?}");
}

#[test]
fn fault_05_required_function_missing_or_name_wrong() {
    for (function, name) in [
        ("FAULT_DEVICES", "devices"),
        ("FAULT_OPEN", "open"),
        ("FAULT_LOAD", "load"),
        ("FAULT_ROWS", "rows"),
        ("FAULT_CLOSE", "close"),
    ] {
        let place = folder();
        let wrong = refused(&bad_table(&place, &[&format!("{function}=NULL")]));
        assert_eq!(wrong, LoadError::NoFunction(name));
    }
    for (name, word) in [
        ("NULL", "name is NULL"),
        ("\"\"", "name is empty"),
        ("\"Bad Name\"", "`Bad Name`"),
        ("\"\\xff\"", "not UTF-8"),
        ("\"a123456789b123456789c123456789d123\"", "longer than 32"),
    ] {
        let place = folder();
        let wrong = refused(&bad_table(&place, &[&format!("FAULT_NAME={name}")])).to_string();
        assert!(wrong.contains(word), "{wrong}");
    }
    let place = folder();
    assert!(
        refused(&bad_table(&place, &["FAULT_VERSION=\"\""]))
            .to_string()
            .contains("version is empty")
    );
    // A function that a claimed capability needs.
    let place = folder();
    let error = try_session(&bad_table(&place, &["FAULT_ITEMS=NULL"]), &[]).expect_err("it claims item buffers");
    assert!(error.to_string().contains("has no `items`"), "{error}");
    // By another name than it has.
    let run = Run::new();
    c("faulty/table.c", run.place.path(), "other-name", &[]);
    let here = |arguments: &[&str]| {
        let mut command = run.command();
        command.env("HEMICUBE_BACKEND_PATH", ".").args(arguments);
        command.output().expect("the program runs")
    };
    let output = here(&["backends", "list"]);
    assert!(text(&output.stdout).contains("it calls itself `bad-table`, not `other-name`"));
    let arguments = ["compute", "room.obj", "-o", "m", "--backend", "other-name"];
    let said = text(&here(&arguments).stderr);
    assert!(
        said.starts_with("error: no backend named `other-name`\n  tried  "),
        "{said}"
    );
    assert!(
        said.contains("it calls itself `bad-table`") && said.contains("no such folder"),
        "{said}"
    );
    assert!(
        said.contains("hint: `hemicube backends list` shows what is installed"),
        "{said}"
    );
}

#[test]
fn fault_06_no_device_or_it_does_not_open() {
    let place = folder();
    let path = bad_table(&place, &["NO_DEVICE", "FAULT_DEVICES=no_device"]);
    assert!(matches!(try_session(&path, &[]), Err(OpenError::NoDevice { .. })));
    let place = folder();
    let path = bad_table(&place, &["NO_DRIVER", "FAULT_DEVICES=no_driver"]);
    let error = try_session(&path, &[]).expect_err("no driver").to_string();
    assert_eq!(error, "backend `bad-table`: no driver is installed");
    let error = try_session(&rust("faulty"), &["fault=no-session"])
        .expect_err("no session")
        .to_string();
    assert!(error.contains("gave no session"), "{error}");
    let error = try_session(&rust("faulty"), &["device=3"])
        .expect_err("no such device")
        .to_string();
    assert!(
        error.contains("no device `3`") && error.contains("cannot be relied on"),
        "{error}"
    );
    let error = try_session(&rust("faulty"), &["speed=11"])
        .expect_err("no such option")
        .to_string();
    assert!(error.contains("no option `speed`"), "{error}");
    // The program says so, and stores nothing.
    let run = Run::new();
    let output = run.compute(&["fault=open-fails"]);
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(
        said.starts_with("error: backend `faulty`: device lost: the device is on fire"),
        "{said}"
    );
    assert!(!run.place.path().join("m").exists());
}

#[test]
fn fault_07_panic() {
    let error = try_session(&rust("faulty"), &["fault=panic-in-open"])
        .expect_err("it panics")
        .to_string();
    // The message is cut at a character, and what was said of the place goes with its end.
    assert!(error.contains("it panicked: öpen ää") && error.len() < 700, "{error}");
    let mut backend = faulty("panic-in-load");
    let error = rows_of(&mut backend, true).expect_err("it panics").to_string();
    assert!(
        error.contains("it panicked: the scene is ugly (") && error.contains("lib.rs:"),
        "{error}"
    );
    rows_fail("panic-in-rows", &["it panicked: no row 7 (", "lib.rs:"]);
    rows_fail("panic-with-a-bomb", &["it panicked"]);
    compute_fails("panic-in-rows", &["it panicked: no row 7"]);
}

/// Runs a case of the suite on the faulty backend, in the program's child processes.
#[track_caller]
fn checked(fault: &str, time_limit: &str) -> String {
    check_of(
        &rust("faulty"),
        "room/contract",
        &["--backend-option", &format!("fault={fault}")],
        time_limit,
    )
}

/// Runs a case of the suite that must not hold on a plugin, in the program's child processes.
#[track_caller]
fn check_of(plugin: &Path, case: &str, options: &[&str], time_limit: &str) -> String {
    let run = Run { place: folder() };
    let plugin = plugin.to_str().expect("a path in UTF-8");
    let arguments = ["backends", "check", plugin, "--only", case, "--time-limit", time_limit];
    let output = run.program(&[&arguments, options].concat());
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{said}{}", text(&output.stderr));
    said
}

/// A fault that ends the process after some parts are stored: not by itself, and the store is intact.
#[track_caller]
fn compute_dies(fault: &str) -> String {
    let run = Run::new();
    // So late that the first parts are written for certain, whatever still waits for the thread that writes.
    let output = run.compute(&[&format!("fault={fault}"), "after=30"]);
    assert_eq!(
        output.status.code(),
        None,
        "it ended by itself: {}",
        text(&output.stderr)
    );
    run.store_is_intact();
    text(&output.stderr)
}

#[test]
fn fault_08_crash() {
    for (fault, word) in [
        ("abort", "SIGABRT"),
        ("segfault", "SIGSEGV"),
        ("exit", "exit status: 0"),
    ] {
        let said = checked(fault, "60");
        assert!(said.contains("CRASHED") && said.contains(word), "{said}");
    }
    compute_dies("segfault");
    let place = folder();
    let object = place.path().join("throws.o");
    let mut compiler = Command::new("c++");
    compiler.args([
        "-std=c++17",
        "-Wall",
        "-Wextra",
        "-pedantic",
        "-Werror",
        "-fPIC",
        "-c",
        "-I",
    ]);
    compiler.arg(workspace().join("crates/backends/abi/include"));
    compiler.arg(sources().join("faulty/throws.cpp")).arg("-o").arg(&object);
    assert!(compiler.status().expect("`c++` runs; install g++").success());
    let object = object.to_str().expect("a path in UTF-8");
    let path = c_with(
        "faulty/table.c",
        place.path(),
        "bad-table",
        &["THROWS", "FAULT_ROWS=throws"],
        &[object, "-lstdc++"],
    );
    let said = check_of(&path, "room/contract", &[], "60");
    assert!(said.contains("CRASHED") && said.contains("SIGABRT"), "{said}");
}

#[test]
fn fault_09_hang() {
    let said = checked("hang", "2");
    assert!(said.contains("HUNG") && said.contains("not done after 2 s"), "{said}");
    // In the program itself nothing can be done about it; ended from outside, it leaves an intact store.
    let run = Run::new();
    let mut command = run.compute_command(&["fault=hang", "after=30"]);
    let mut child = Ended(command.arg("-q").spawn().expect("the program runs"));
    let started = std::time::Instant::now();
    while run.parts().len() < 3 {
        assert!(started.elapsed().as_secs() < 60, "nothing is stored");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert!(child.0.try_wait().expect("a child").is_none(), "it does not hang");
    drop(child);
    run.store_is_intact();
}

/// A process that is ended when the test is over, however that ends.
struct Ended(std::process::Child);

impl Drop for Ended {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn fault_10_nothing_written() {
    rows_fail("nothing-written", &["row 0 of 5 ends at entry"]);
    rows_fail("few-rows", &["0 row ends where 5 are due"]);
    compute_fails("nothing-written", &["row 0"]);
}

#[test]
fn fault_11_patch_out_of_range_or_not_ascending() {
    rows_fail(
        "patch-out-of-range",
        &["row 4", "patch 4294967290 of a scene of 40 patches"],
    );
    rows_fail("not-ascending", &["row 4", "patch 2 after patch 3"]);
    rows_fail("patch-twice", &["row 4", "patch 3 after patch 3"]);
    rows_fail("covered-below-visible", &["row 4", "shows weight 10 but covers only 9"]);
    compute_fails("not-ascending", &["patch 2 after patch 3"]);
    // An item buffer is judged likewise.
    let mut backend = faulty("item-out-of-range");
    let room = model(hemicube_scene::generate::cornell_box(), Subdivision::None);
    backend.load(room.geometry(), settings(RESOLUTION)).expect("it loads");
    let hemicube = hemicubes(&room, &spread(&room, 1))[0];
    let error = backend.items(&hemicube).expect_err("no such patch").to_string();
    assert!(error.contains("pixel 0 shows patch 4294967290"), "{error}");
}

#[test]
fn fault_12_row_ends_decreasing_or_beyond_the_room() {
    rows_fail("row-end-decreasing", &["row 1 of 5 ends at entry 0; it begins at 2"]);
    rows_fail(
        "row-end-beyond",
        &["row 4 of 5 ends at entry 201", "there is room for 200"],
    );
    compute_fails("row-end-beyond", &["there is room for"]);
}

#[test]
fn fault_13_light_lost_or_invented() {
    rows_fail("light-lost", &["2147483647, not 2147483648", "lost or invented light"]);
    rows_fail("light-invented", &["2147483649, not 2147483648"]);
    compute_fails("light-lost", &["lost or invented light"]);
}

#[test]
fn fault_14_not_a_number() {
    // Weights are integers, and anything but a legal sum of them is fault 13. What could be no number goes the other
    // way, and is refused before a plugin sees it; the session stays usable.
    let mut backend = faulty("none");
    let room = model(hemicube_scene::generate::cornell_box(), Subdivision::None);
    backend.load(room.geometry(), settings(RESOLUTION)).expect("it loads");
    let mut hemicube = hemicubes(&room, &spread(&room, 1))[0];
    let good = hemicube;
    hemicube.origin.x = f64::NAN;
    let mut rows = RowBlock::default();
    let error = backend.rows(&[hemicube], &mut rows).expect_err("not finite");
    assert!(matches!(error, BackendError::InvalidArgument(_)), "{error}");
    assert!(backend.rows(&[good], &mut rows).is_ok());
}

#[test]
fn fault_15_written_past_the_end() {
    for (fault, array) in [
        ("past-patches", "`patches` in `rows`"),
        ("past-visible", "`visible` in `rows`"),
        ("past-row-end", "`row_end` in `rows`"),
        ("past-escaped", "`escaped` in `rows`"),
        ("past-blocked", "`blocked` in `rows`"),
        ("past-message", "`a struct` in `rows`"),
        ("past-struct", "`a struct` in `rows`"),
    ] {
        let run = Run::new();
        let output = run.compute(&[&format!("fault={fault}"), "after=3"]);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), None, "{fault}: the program went on: {said}");
        assert!(
            said.contains("wrote past the end of") && said.contains(array),
            "{fault}: {said}"
        );
        assert!(said.contains("hint: memory cannot be trusted any more"), "{said}");
    }
    let said = checked("past-covered", "60");
    assert!(
        said.contains("CRASHED") && said.contains("wrote past the end of `covered`"),
        "{said}"
    );
    let options = ["--backend-option", "fault=past-items"];
    let said = check_of(&rust("faulty"), "room/reduction", &options, "60");
    assert!(
        said.contains("CRASHED") && said.contains("wrote past the end of `items`"),
        "{said}"
    );
    compute_dies("past-patches");
}

#[test]
fn fault_16_two_plugins_of_one_name() {
    let run = Run::new();
    for (folder, version) in [("first", "FAULT_VERSION=\"one\""), ("second", "FAULT_VERSION=\"two\"")] {
        std::fs::create_dir(run.place.path().join(folder)).expect("a folder");
        c(
            "faulty/table.c",
            &run.place.path().join(folder),
            "bad-table",
            &[version],
        );
    }
    let mut command = run.command();
    command
        .env("HEMICUBE_BACKEND_PATH", "first:second")
        .args(["backends", "list"]);
    let said = text(&command.output().expect("the program runs").stdout);
    let line = |word: &str| {
        said.lines()
            .find(|line| line.contains(word))
            .unwrap_or_default()
            .to_owned()
    };
    assert!(line("first/lib").contains("one"), "{said}");
    let shadowed = line("shadowed by");
    assert!(shadowed.contains("second") && shadowed.contains("first"), "{said}");
    command.args(["--json"]);
    let report: serde_json::Value =
        serde_json::from_slice(&command.output().expect("the program runs").stdout).expect("JSON");
    let versions: Vec<&str> = report["backends"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|b| b["version"].as_str())
        .collect();
    assert!(versions.contains(&"one") && !versions.contains(&"two"), "{report}");
}

#[test]
fn fault_17_unknown_status() {
    let error = rows_fail("unknown-status", &["unknown status 77"]);
    assert!(matches!(error, BackendError::Internal(_)));
    compute_fails("unknown-status", &["unknown status 77"]);
}

#[test]
fn fault_18_nothing_is_called_after_a_fatal_status() {
    // It aborts if it is called again; `rows_fail` tries.
    let mut backend = faulty("called-again");
    assert!(rows_of(&mut backend, true).is_err());
    let room = model(hemicube_scene::generate::cornell_box(), Subdivision::None);
    let hemicube = hemicubes(&room, &spread(&room, 1))[0];
    let mut rows = RowBlock::default();
    for error in [
        backend
            .rows(&[hemicube], &mut rows)
            .map(|_| ())
            .expect_err("it is closed"),
        backend.items(&hemicube).map(|_| ()).expect_err("it is closed"),
        backend
            .load(room.geometry(), settings(RESOLUTION))
            .expect_err("it is closed"),
    ] {
        assert!(error.to_string().contains("closed after it had failed"), "{error}");
    }
    rows_fail("device-lost", &["device lost: it was pulled out"]);
    compute_fails("device-lost", &["device lost: it was pulled out"]);
    // But after what leaves it usable, it is used.
    let mut backend = session(&rust("faulty"), &["fault=out-of-memory", "after=1"]);
    assert!(rows_of(&mut backend, true).is_ok());
    assert!(matches!(rows_of(&mut backend, true), Err(BackendError::OutOfMemory(_))));
    assert!(matches!(rows_of(&mut backend, true), Err(BackendError::OutOfMemory(_))));
}

/// A closed room with a mirror for a wall, which a hemicube sees by large passes.
const MIRROR_ROOM: &str = "v 0.01 0 0\nv 1.11 0.1 0.01\nv 1.01 1.2 0.02\nv -0.08 1 0.01\nv 0.03 0.01 0.9\nv 1.13 0.08 0.91\n\
    v 1.04 1.22 0.92\nv -0.06 1.03 0.91\no floor\nf 1 2 3 4\no ceiling\nf 5 8 7 6\no wall\nf 1 4 8 5\nf 2 6 7 3\nf 1 5 6 2\n\
    o mirror\nf 4 3 7 8\n";

/// A run through the mirror by a fault of passes.
fn through_a_mirror(fault: &str) -> (Run, Output) {
    let run = Run { place: folder() };
    std::fs::write(run.place.path().join("room.obj"), MIRROR_ROOM).expect("a file");
    std::fs::write(
        run.place.path().join("optics.toml"),
        "[object.mirror]\nspecular = 0.8\n",
    )
    .expect("a file");
    let mut command = run.compute_command(&[&format!("fault={fault}"), "after=3", "passes=on"]);
    let output = command
        .args(["--split", "2", "--specular", "optics.toml", "-v"])
        .output();
    let output = output.expect("the program runs");
    if !output.status.success() {
        // It says that it is unfinished, and of what it has nothing is wrong.
        assert_ne!(run.program(&["check", "m"]).status.code(), Some(0), "{fault}");
        let checked = run.program(&["check", "m", "--allow-incomplete"]);
        assert_eq!(checked.status.code(), Some(0), "{fault}: {}", text(&checked.stdout));
    }
    (run, output)
}

#[test]
fn fault_19_wrong_passes() {
    let check = |fault: &str| {
        let options = ["--backend-option", &format!("fault={fault}")];
        check_of(&rust("faulty"), "room/passes", &options, "60")
    };
    // What is illegal is an error, and nothing of it is stored.
    for (fault, words) in [
        ("pass-out-of-range", "shows patch 48 of a scene of 48 patches"),
        ("pass-unwritten", "of an item buffer was not written"),
    ] {
        let said = text(&through_a_mirror(fault).1.stderr);
        assert!(
            said.contains("error: backend `faulty`") && said.contains(words),
            "{fault}: {said}"
        );
        let said = check(fault);
        assert!(
            said.contains("BROKEN") && said.contains("`pass` failed"),
            "{fault}: {said}"
        );
    }
    let (_run, output) = through_a_mirror("pass-past-items");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), None, "the program went on: {said}");
    assert!(said.contains("wrote past the end of `items` in `pass`"), "{said}");
    // What is legal and wrong is the suite's to find.
    for fault in ["pass-wrong-pixel", "pass-ignores-plane", "pass-of-before"] {
        let said = check(fault);
        assert!(
            said.contains("BROKEN") && said.contains("where its ray meets"),
            "{fault}: {said}"
        );
    }
    // Closed pixels are not read, whatever is in them.
    let parts = ["pass-right", "pass-ignores-mask"].map(|fault| {
        let (run, output) = through_a_mirror(fault);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        assert!(
            text(&output.stderr).contains("where passes are large"),
            "{}",
            text(&output.stderr)
        );
        run.parts()
    });
    assert_eq!(parts[0], parts[1]);
}

/// A run with rays by a fault of theirs, in a city, whose rows lose much to the sky.
fn rays_of_a_city(fault: &str, switch: &str) -> (Run, Output) {
    let run = Run { place: folder() };
    let made = run.program(&["generate", "city", "--patches", "300", "-o", "city.obj"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let mut command = run.command();
    command.args("compute city.obj -o m --tolerance 0.3% --rows 24 --threads 1 --backend".split(' '));
    command.arg(rust("faulty"));
    for option in [&format!("fault={fault}"), &format!("rays={switch}")] {
        command.args(["--backend-option", option]);
    }
    let output = command.output().expect("the program runs");
    (run, output)
}

#[test]
fn fault_20_wrong_rays() {
    let check = |fault: &str| {
        let options = ["--backend-option", &format!("fault={fault}")];
        check_of(&rust("faulty"), "room/rays", &options, "60")
    };
    for (fault, words) in [
        ("rays-fail", "it was pulled out"),
        ("rays-few", "answers to"),
        ("rays-out-of-range", "which is no patch of a scene of"),
        ("rays-unwritten", "which is no patch of a scene of"),
    ] {
        let (run, output) = rays_of_a_city(fault, "on");
        let said = text(&output.stderr);
        assert!(
            output.status.code() == Some(2) && said.contains("error: backend `faulty`") && said.contains(words),
            "{fault}: {said}"
        );
        assert_eq!(run.parts().len(), 0, "{fault}: nothing of it is stored");
        let said = check(fault);
        assert!(
            said.contains("BROKEN") && said.contains("`rays` failed"),
            "{fault}: {said}"
        );
    }
    let said = text(&rays_of_a_city("rays-past", "on").1.stderr);
    assert!(said.contains("wrote past the end of `met` in `rays`"), "{said}");
    // What is legal and wrong is the suite's to find.
    for (fault, words) in [
        ("rays-wrong", "it says; it meets"),
        ("rays-escape", "it says; it meets"),
        ("rays-ignore-ends", "it says; it meets"),
        ("rays-doubtful", "rays are doubtful"),
        ("rays-too-sure", "it passes an edge within 100 plane tolerances"),
    ] {
        let said = check(fault);
        assert!(said.contains("BROKEN") && said.contains(words), "{fault}: {said}");
    }
    // Nobody is asked for rays without the switch, and doubtful ones are the processor's, to the bit.
    let parts = [("rays-escape", "off"), ("rays-doubtful", "on"), ("rays-escape", "on")].map(|(fault, switch)| {
        let (run, output) = rays_of_a_city(fault, switch);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        run.parts()
    });
    assert_eq!(parts[0], parts[1]);
    assert_ne!(parts[0], parts[2], "answers are used");
}

/// The numbers of the faults in the table of `docs/plugins.md`.
fn listed(page: &str) -> Vec<u32> {
    let numbers = page
        .lines()
        .filter_map(|line| line.strip_prefix("| ")?.split(" |").next()?.parse().ok());
    numbers.collect()
}

#[test]
fn every_fault_of_the_table_has_its_test() {
    let page = std::fs::read_to_string(workspace().join("docs/plugins.md")).expect("the page on plugins");
    let listed = listed(&page);
    assert_eq!(listed, (1..=20).collect::<Vec<_>>());
    let source = include_str!("plugin_faults.rs");
    for number in &listed {
        let test = format!("#[test]\nfn fault_{number:02}_");
        assert_eq!(
            source.matches(&test).count(),
            1,
            "fault {number} has no test, or several"
        );
    }
    assert_eq!(
        source.matches("\nfn fault_").count(),
        listed.len(),
        "a test that is not listed"
    );
    assert!(sources().join("faulty/src/lib.rs").is_file());
}
