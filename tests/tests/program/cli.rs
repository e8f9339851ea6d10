//! The program as a user meets it: the flows of a first day, what it prints where, exit codes, settings, bad input,
//! interruption, and stores that do not depend on threads, batches or culling.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

#![allow(clippy::print_stderr, reason = "a skipped test says so")]

use assert_cmd::Command;
use hemicube_tests::runs::{TIME_LIMIT, command_in, files};
use hemicube_tests::scenes::program;
use serde_json::Value;
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The outcome of a run.
struct Ran {
    code: Option<i32>,
    out: String,
    err: String,
}

impl Ran {
    #[track_caller]
    fn is(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "stdout: {}\nstderr: {}", self.out, self.err);
        self
    }

    /// It failed as a program should: one error line, no panic, nothing on standard output.
    #[track_caller]
    fn fails_with(self, words: &[&str]) -> Self {
        let ran = self.is(2);
        assert_eq!(
            ran.err.lines().filter(|line| line.starts_with("error: ")).count(),
            1,
            "{}",
            ran.err
        );
        assert_eq!(ran.out, "");
        for word in words {
            assert!(ran.err.contains(word), "`{word}` is not in: {}", ran.err);
        }
        ran
    }

    #[track_caller]
    fn json(&self) -> Value {
        serde_json::from_str(&self.out).unwrap_or_else(|error| panic!("{error} in: {}", self.out))
    }
}

/// A directory of its own to run in, without settings of the user or the environment.
struct Place {
    directory: TempDir,
    variables: Vec<(String, String)>,
}

impl Place {
    fn new() -> Self {
        Self {
            directory: tempfile::tempdir().expect("a temporary directory"),
            variables: Vec::new(),
        }
    }

    fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.directory.path().join(name)
    }

    fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().expect("a parent")).expect("a directory");
        std::fs::write(path, text).expect("a file");
    }

    fn command(&self) -> std::process::Command {
        let mut command = command_in(&program(), self.directory.path());
        command.envs(self.variables.iter().map(|(name, value)| (name, value)));
        command
    }

    fn run<A: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = A>) -> Ran {
        let mut command = self.command();
        command.args(arguments);
        ran(Command::from_std(command)
            .timeout(TIME_LIMIT)
            .output()
            .expect("the program runs"))
    }

    /// Runs a line of words without blanks in them.
    fn line(&self, line: &str) -> Ran {
        self.run(line.split_whitespace())
    }
}

fn ran(output: std::process::Output) -> Ran {
    let ran = Ran {
        code: output.status.code(),
        out: String::from_utf8(output.stdout).expect("UTF-8 on standard output"),
        err: String::from_utf8(output.stderr).expect("UTF-8 on standard error"),
    };
    assert!(!ran.err.contains("panicked"), "{}", ran.err);
    ran
}

/// A file of the shared scenes, or `None` with a loud line where they are not there.
fn shared_scene(file: &str) -> Option<PathBuf> {
    let root = std::env::var_os("HEMICUBE_SCENES").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/scenes"),
        PathBuf::from,
    );
    let path = root.join(file);
    if path.is_file() {
        return Some(path);
    }
    eprintln!("SKIP {file}: no ../shared/scenes");
    None
}

#[track_caller]
fn assert_same_store(a: &Path, b: &Path, what: &str) {
    let (a, b) = (files(a), files(b));
    assert!(a.len() > 3, "{what}: {} files are no store", a.len());
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>(), "{what}");
    for (name, bytes) in &a {
        assert!(Some(bytes) == b.get(name), "{what}: {} differs", name);
    }
}

#[test]
fn the_first_day() {
    let place = Place::new();
    let made = place.line("generate room --patches 1000 -o room.obj").is(0);
    assert!(
        made.err.contains("`room.obj`: 1,000 patches (room)") && made.out.is_empty(),
        "{}",
        made.err
    );
    assert!(place.path("room.mtl").is_file(), "the room's materials have optics");

    let computed = place.line("compute room.obj -o room.hemicube -v").is(0);
    for word in [
        "matrix  room.hemicube: 1,000 × 1,000, ",
        "expected (asked: 2 %)",
        "energy  0 % escapes",
    ] {
        assert!(computed.out.contains(word), "`{word}` is not in {}", computed.out);
    }
    let says = |start: &str, end: &str| {
        let found = computed.err.lines().any(|l| l.starts_with(start) && l.ends_with(end));
        assert!(found, "`{start}…{end}` is missing:\n{}", computed.err);
    };
    says("culling ", "16 trial hemicubes");
    says("backend cpu order-2 ", "1,000 patches");
    says("engine order: ", "lanes in use");
    for word in ["1,000, one for each patch", "hemicube check room.hemicube", "for SciPy"] {
        assert!(computed.err.contains(word), "`{word}` is not in {}", computed.err);
    }

    let checked = place.line("check room.hemicube").is(0);
    assert!(
        checked.out.contains("Everything holds.") && checked.out.contains("closure"),
        "{}",
        checked.out
    );

    for (file, word) in [
        ("F.npz", "load_npz"),
        ("F.mtx", "mmread"),
        ("F.txt", "spconvert"),
        ("F.npy", "numpy.load"),
    ] {
        let exported = place.run(["export", "room.hemicube", "-o", file]).is(0);
        assert!(
            exported.err.contains(word) && place.path(file).is_file(),
            "{}",
            exported.err
        );
    }
    place
        .line("export room.hemicube -o F.npz")
        .fails_with(&["exists", "--overwrite"]);
    place.line("export room.hemicube -o F.npz --overwrite").is(0);
    place
        .line("export room.hemicube -o F.xls")
        .fails_with(&[".npz", ".mtx", ".npy"]);
    for file in ["F.npz", "F.npy"] {
        let compared = place.run(["compare", file, "room.hemicube", "--max-error", "0"]).is(0);
        assert!(compared.out.contains("The matrices are equal."), "{}", compared.out);
    }

    place
        .line("compute room.obj -o coarse --correction pixel --resolution 16 -q")
        .is(0);
    let compared = place.line("compare coarse room.hemicube --max-error 1e-3").is(1);
    assert!(
        compared.out.contains("FAILED: the error is above the bound"),
        "{}",
        compared.out
    );
    place
        .line("compare coarse room.hemicube --max-error 10 -o errors.svg")
        .is(0);
    let picture = std::fs::read_to_string(place.path("errors.svg")).unwrap();
    assert!(picture.contains("coarse against room.hemicube") && picture.contains("allowed"));
    assert!(!picture.contains("expected"), "no tolerance was asked for");
    place
        .line("compare coarse room.hemicube -o errors.bmp")
        .fails_with(&["errors.bmp", ".svg or .png"]);
    let json = place.line("compare coarse room.hemicube --json").is(0).json();
    assert!(
        json["relative_frobenius"].as_f64().is_some_and(|error| error > 1e-3),
        "{json}"
    );

    let inspected = place.line("inspect room.obj -v").is(0);
    for word in ["1,000", "area", "octree", "occlusion", "on disk", "unit"] {
        assert!(inspected.out.contains(word), "`{word}` is not in {}", inspected.out);
    }
    let json = place.line("inspect room.obj --json").is(0).json();
    assert_eq!(json["patches"]["count"], 1000);
    assert!(json.get("timings").is_none() && json["forecast"].get("seconds").is_none());
    assert!(
        json["forecast"]["visible_median"]
            .as_u64()
            .is_some_and(|seen| seen > 10)
    );

    let listed = place.line("backends list").is(0);
    assert!(
        listed
            .out
            .lines()
            .any(|line| line.starts_with("cpu ") && line.contains("lossless-culling"))
    );
    assert_eq!(
        place.line("backends list --json").is(0).json()["backends"][0]["name"],
        "cpu"
    );
}

#[test]
fn an_existing_matrix_is_not_replaced_unasked() {
    let place = Place::new();
    place.line("generate room --patches 40 -o room.obj").is(0);
    place
        .line("generate room --patches 40 -o room.obj")
        .fails_with(&["`room.obj` exists", "hint: `--overwrite`"]);
    place
        .line("compute room.obj -o m --correction pixel --resolution 32 -q")
        .is(0);
    let before = files(&place.path("m"));
    place
        .line("compute room.obj -o m --correction pixel --resolution 16")
        .fails_with(&[
            "`m` holds another matrix",
            "it was computed with resolution 32, and here it is with resolution 16",
            "--overwrite",
        ]);
    assert_eq!(files(&place.path("m")), before);
    place
        .line("compute room.obj -o m --correction pixel --resolution 16 --overwrite -q")
        .is(0);
    assert_ne!(files(&place.path("m")), before);
    place.line("check m").is(0);
}

#[test]
fn help_fits_a_screen_and_names_everything() {
    let place = Place::new();
    for command in [
        "",
        "compute",
        "inspect",
        "tradeoff",
        "check",
        "merge",
        "compare",
        "export",
        "generate",
        "backends list",
        "backends check",
    ] {
        let short = place.line(&format!("{command} -h")).is(0);
        let lines = short.out.lines().count();
        assert!((5..=60).contains(&lines), "`{command} -h` has {lines} lines");
        assert!(
            short.out.lines().all(|line| line.chars().count() <= 100),
            "{}",
            short.out
        );
        let long = place.line(&format!("{command} --help")).is(0);
        for word in ["Environment:", "Exit status:", "HEMICUBE_", "130"] {
            // The program's own is a list of commands, and a list of backends ends at once.
            let is_short = command.is_empty() || command == "backends list" && word == "130";
            assert!(
                is_short || long.out.contains(word),
                "`{word}` is not in `{command} --help`"
            );
        }
        assert!(
            command == "backends list" || long.out.contains("Examples:"),
            "{command}"
        );
    }
    assert!(place.line("--version").is(0).out.starts_with("hemicube "));
    let compute = place.line("compute --help").is(0).out;
    for flag in [
        "--keep-duplicates",
        "--config <FILE|none>",
        "--occluders",
        "hemicube.toml",
    ] {
        assert!(compute.contains(flag), "{flag}");
    }
    place.line("").is(2);
    let typo = place.line("compute a -o b --resolutoin 3").is(2);
    assert!(typo.err.contains("--resolution"), "a spelling suggestion: {}", typo.err);
}

#[test]
fn the_report_has_every_field() {
    let place = Place::new();
    place.line("generate maze --patches 500 -o maze.obj").is(0);
    let ran = place
        .line("compute maze.obj -o m --correction pixel --resolution 64 --samples 4 --threads 2 --json -v")
        .is(0);
    let report = ran.json();
    for field in [
        "schema",
        "program",
        "version",
        "inputs",
        "scene",
        "settings",
        "backend",
        "culling",
        "threads",
        "repair",
        "store",
        "bytes",
        "complete",
        "parts",
        "part_count",
        "rows",
        "row_count",
        "entries",
        "row_sum",
        "escaped",
        "blocked",
        "unselected",
        "closure",
        "counters",
        "timings",
    ] {
        assert!(report.get(field).is_some(), "no `{field}` in {report}");
    }
    assert_eq!(report["schema"], 1);
    assert_eq!(report["settings"]["samples"], 4);
    assert_eq!(report["inputs"][0]["blake3"].as_str().map(str::len), Some(64));
    assert_eq!(
        report["inputs"][0]["bytes"],
        std::fs::metadata(place.path("maze.obj")).expect("a file").len()
    );
    assert_eq!(report["complete"], true);
    assert_eq!(report["rows"], report["scene"]["patches"]);
    assert_eq!(
        report["counters"]["hemicubes"].as_u64(),
        report["rows"].as_u64().map(|rows| 4 * rows)
    );
    assert!(
        report["closure"].as_f64().is_some_and(|closure| closure < 1e-6),
        "{report}"
    );
    let mean = report["row_sum"]["mean"].as_f64().expect("a mean");
    let lost = ["escaped", "blocked", "unselected"].map(|name| report[name].as_f64().expect("a fraction"));
    assert!((mean + lost.iter().sum::<f64>() - 1.0).abs() < 1e-6, "{report}");
    for stage in ["load", "build", "rows", "write"] {
        assert!(
            report["timings"][stage].as_f64().is_some_and(|seconds| seconds >= 0.0),
            "{stage}"
        );
    }
    if cfg!(target_os = "linux") {
        assert!(
            report["peak_memory_bytes"]
                .as_u64()
                .is_some_and(|bytes| bytes > 1 << 20)
        );
    }

    let line = "compute maze.obj -o m --overwrite -q --json";
    let first = place.line(line).is(0).out;
    let second = place.line(&format!("{line} --threads 2")).is(0).out;
    assert_eq!(first, second, "without times, equal runs report equally");
    assert!(!first.contains("timings") && !first.contains("peak_memory"));
    let check = place.line("check m --json").is(0).json();
    assert_eq!((&check["ok"], &check["schema"]), (&Value::Bool(true), &Value::from(1)));
}

#[test]
fn one_patch_is_no_plural() {
    let place = Place::new();
    place.write("one.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    place
        .line("view hemicube one.obj --patch 7 -o v.png")
        .fails_with(&["the scene has 1 patch, from 0 on"]);
}

#[test]
fn stores_do_not_depend_on_threads_batches_and_culling() {
    let place = Place::new();
    place.line("generate city --patches 2000 -o city.obj").is(0);
    let compute = "compute city.obj --correction pixel --resolution 64 -q";
    place
        .line(&format!("{compute} --threads 1 --batch 1 --culling on -o reference"))
        .is(0);
    let mut runs = 0;
    for threads in [1, 2, 7] {
        for batch in [1, 5, 64] {
            for culling in ["on", "off"] {
                let store = format!("store-{runs}");
                let what = format!("threads {threads}, batch {batch}, culling {culling}");
                let settings = format!("--threads {threads} --batch {batch} --culling {culling}");
                place.line(&format!("{compute} {settings} -o {store}")).is(0);
                assert_same_store(&place.path("reference"), &place.path(&store), &what);
                std::fs::remove_dir_all(place.path(&store)).expect("a store");
                runs += 1;
            }
        }
    }
    assert_eq!(runs, 18);
    // A setting that rows depend on shows.
    place
        .line(&format!("{} --overwrite -o other", compute.replace("64", "80")))
        .is(0);
    assert_ne!(files(&place.path("reference")), files(&place.path("other")));
    place.line("check reference").is(0);
}

#[test]
fn a_tolerance_brings_rows_nearer_to_reciprocity() {
    let place = Place::new();
    place.line("generate room --patches 1000 -o room.obj").is(0);
    let residual = |correction: &str| {
        let compute = format!("compute room.obj --correction {correction} -q");
        place
            .line(&format!("{compute} -o {correction} --threads 1 --batch 3"))
            .is(0);
        place.line(&format!("{compute} -o again --overwrite --threads 2")).is(0);
        assert_same_store(&place.path(correction), &place.path("again"), correction);
        let report = place.line(&format!("check {correction} --json")).is(0).json();
        report["reciprocity"]["residual"].as_f64().expect("a residual")
    };
    let (pixel, within) = (residual("pixel"), residual("tolerance"));
    assert!(within < 0.5 * pixel, "{within} {pixel}");
    // An error that nobody bounded is reported, and a bound that is asked for is kept.
    place.line("check tolerance --max-closure 1e-9").is(1);
}

#[test]
fn culling_is_on_where_it_spares_something() {
    let place = Place::new();
    place.line("generate city --patches 2000 -o city.obj").is(0);
    let ran = place
        .line("compute city.obj -o m --correction pixel --resolution 64 --json -v")
        .is(0);
    assert_eq!(ran.json()["culling"], "on");
    assert!(ran.err.contains("culling on: it leaves"), "{}", ran.err);
    let on = ran.json()["counters"]["triangles_transformed"]
        .as_u64()
        .expect("a number");
    let off = place
        .line("compute city.obj -o m --overwrite --correction pixel --resolution 64 --culling off --json")
        .is(0)
        .json();
    let off = off["counters"]["triangles_transformed"].as_u64().expect("a number");
    assert!(2 * on < off, "culling left {on} of {off}");
    // Two triangles face to face: nothing to spare.
    place.write(
        "pair.obj",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 1 1\nv 1 0 1\nf 1 2 3\nf 4 5 6\n",
    );
    let ran = place
        .line("compute pair.obj -o pair --correction pixel --resolution 64 --json")
        .is(0);
    assert_eq!(ran.json()["culling"], "off", "{}", ran.err);
    assert_eq!(ran.json()["entries"], 2);
}

#[test]
fn rows_and_columns_are_selected() {
    let place = Place::new();
    place.write(
        "rooms.obj",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 1 1\nv 1 0 1\nv 0 0 0.5\nv 0.3 0 0.5\nv 0 0.3 0.5\n\
         o floor\nusemtl grey\nf 1 2 3\no ceiling\nusemtl white\nf 4 5 6\no tree\nusemtl green\nf 7 8 9\n",
    );
    let report = |settings: &str| {
        place
            .line(&format!(
                "compute rooms.obj -o m --overwrite --correction pixel --resolution 64 -q --json {settings}"
            ))
            .is(0)
            .json()
    };
    let all = report("");
    assert_eq!((&all["rows"], &all["unselected"]), (&Value::from(3), &Value::from(0.0)));
    let report_of = report("--emitters f*r --receivers whi?e");
    assert_eq!(report_of["rows"], 1);
    assert_eq!(report_of["entries"], 1);
    let report_of = report("--occluders green");
    assert_eq!(report_of["rows"], 2);
    assert!(report_of["unselected"].as_f64().is_some_and(|fraction| fraction > 0.0));
    place.line("check m").is(0);
    assert_eq!(report("--rows 1..")["rows"], 2);
    assert_eq!(report("--rows 50%")["rows"], 2);
    assert_eq!(report("--rows 1000")["rows"], 3);
    assert_eq!(report("--two-sided on")["scene"]["patches"], 6);
    let [one, doubled] = ["", "--scale 2"].map(|settings| report(settings)["scene"]["area"].as_f64().expect("an area"));
    assert!((doubled / one - 4.0).abs() < 1e-12);
    assert_eq!(report("--split 4")["scene"]["patches"], 48);
    assert_eq!(report("--split 3")["scene"]["patches"], 27);
    assert!(
        report("--patch-size 0.2")["scene"]["patches"]
            .as_u64()
            .is_some_and(|count| count > 27)
    );
    assert_eq!(report("--up z")["settings"]["up"], "z");

    let compute = |settings: &str| place.line(&format!("compute rooms.obj -o new {settings}"));
    compute("--emitters walls*").fails_with(&["`--emitters walls*` matches no object", "`floor`", "`grey`"]);
    compute("--occluders *").fails_with(&["no row is left"]);
    compute("--rows 2..9").fails_with(&["2..9", "3 patches"]);
    compute("--emitters tree --rows 0..1").fails_with(&["no row is left"]);
    compute("--split 2 --patch-size 2").fails_with(&["`--split` and `--patch-size` exclude each other"]);
    compute("--split 2147483648").fails_with(&["patches", "subdivide less"]);
    compute("--patch-size 1e-300").fails_with(&["10¹⁸ or more patches", "subdivide less"]);
    compute("--scale 1e160").fails_with(&["extent", "1e-60 to 1e60", "another unit"]);
    assert!(
        !place.path("new").exists(),
        "a run that failed at its start leaves no directory behind"
    );
}

#[test]
fn settings_come_in_layers() {
    let mut place = Place::new();
    place.write(
        "home/.config/hemicube/hemicube.toml",
        "correction = \"pixel\"\nsamples = 4\npatch-size = 1\nthreads = 1\n",
    );
    place.write(
        "hemicube.toml",
        "# of this project\nresolution = 48\nform = \"plain\"\nsplit = 3\n",
    );
    place.variables = vec![
        ("HEMICUBE_RESOLUTION".into(), "64".into()),
        ("HEMICUBE_FORM".into(), "double".into()),
    ];
    let printed = |place: &Place, line: &str| {
        let text = place.line(&format!("compute --print-config {line}")).is(0).out;
        let mut settings = BTreeMap::new();
        for line in text.lines() {
            let (setting, origin) = line.rsplit_once("  # ").expect("a setting and its origin");
            settings.insert(setting.trim().to_owned(), origin.to_owned());
        }
        settings
    };
    let settings = printed(&place, "--resolution 80 --emitters a* --emitters b");
    for (setting, origin) in [
        ("resolution = 80", "command line"),
        ("form = \"double\"", "HEMICUBE_FORM"),
        ("split = 3", "hemicube.toml:4"),
        ("# patch-size =", "not set"),
        ("emitters = [\"a*\", \"b\"]", "command line"),
        ("two-sided = \"auto\"", "built-in"),
        ("# rows =", "not set"),
    ] {
        assert_eq!(
            settings.get(setting).map(String::as_str),
            Some(origin),
            "{setting} in {settings:#?}"
        );
    }
    assert!(settings["samples = 4"].ends_with("hemicube.toml:2"), "{settings:?}");
    assert_eq!(printed(&place, "")["resolution = 64"], "HEMICUBE_RESOLUTION");
    assert_eq!(printed(&place, "--patch-size 2")["patch-size = 2"], "command line");
    assert_eq!(printed(&place, "--config=none")["samples = 1"], "built-in");
    place.write("other.toml", "resolution = 0x60\n");
    place.variables.clear();
    let settings = printed(&place, "--config other.toml");
    assert_eq!(settings["resolution = 96"], "other.toml:1");
    assert_eq!(settings["samples = 1"], "built-in");

    // The output is itself a file of settings.
    let text = place.line("compute --print-config --emitters x*").is(0).out;
    place.write("printed.toml", &text);
    assert_eq!(
        printed(&place, "--config printed.toml")["emitters = [\"x*\"]"],
        "printed.toml:18"
    );

    // They hold for the run, and `inspect` shares what it knows.
    place.line("generate room --patches 40 -o room.obj").is(0);
    let report = place.line("compute room.obj -o m --json").is(0).json();
    assert_eq!(report["settings"]["resolution"], 48);
    assert_eq!(report["settings"]["subdivision"]["split"], 3);
    assert_eq!(
        place.line("inspect room.obj --json").is(0).json()["forecast"]["resolution"],
        48
    );

    for (text, words) in [
        (
            "resolution = 48\nresolutoin = 3\n",
            ["bad.toml:2", "`resolutoin`", "did you mean `resolution`?"],
        ),
        ("\n\nresolution = 100\n", ["bad.toml:3", "100", "multiple of 16"]),
        ("form = true\n", ["bad.toml:1", "`form`", "quotes"]),
        ("a = [\n", ["bad.toml:", "error", ""]),
        ("[compute]\nresolution = 3\n", ["bad.toml:1", "`compute`", ""]),
        ("split = 2\npatch-size = 1\n", ["bad.toml:1", "bad.toml:2", "exclude"]),
        ("keep-duplicates = \"perhaps\"\n", ["bad.toml:1", "on, off", ""]),
    ] {
        place.write("bad.toml", text);
        place.line("compute room.obj -o n --config bad.toml").fails_with(&words);
    }
    place.write("bad.toml", [0xFF, 0xFE, 0x00]);
    place
        .line("compute room.obj -o n --config bad.toml")
        .fails_with(&["bad.toml", "UTF-8"]);
    place
        .line("compute room.obj -o n --config none.toml")
        .fails_with(&["none.toml", "cannot be read"]);
    place.variables = vec![("HEMICUBE_SAMPLES".into(), "3".into())];
    place
        .line("compute room.obj -o n")
        .fails_with(&["HEMICUBE_SAMPLES", "perfect square"]);
}

#[test]
fn settings_that_do_nothing_are_refused() {
    let mut place = Place::new();
    place.line("generate room --patches 40 -o room.obj -q").is(0);
    place
        .line("compute room.obj -o m --tolerance 1% --resolution 512")
        .fails_with(&["`--resolution` and `--tolerance` exclude each other"]);
    place.write("hemicube.toml", "tolerance = 0.01\nresolution = 512\n");
    place
        .line("compute room.obj -o m")
        .fails_with(&["hemicube.toml:1", "hemicube.toml:2", "exclude each other"]);
    // A setting that changes nothing is no contradiction, and the stronger layer holds.
    place.write("hemicube.toml", "resolution = 512\n");
    let ran = place.line("compute room.obj -o m --tolerance 5% --print-config").is(0);
    assert!(ran.out.contains("resolution = \"auto\""), "{}", ran.out);
    std::fs::remove_file(place.path("hemicube.toml")).expect("a file");
    place.line("inspect room.obj -q --tolerance 5% --resolution auto").is(0);

    for (name, words) in [
        (
            "HEMICUBE_RESOLUTOIN",
            [
                "there is no setting of the variable `HEMICUBE_RESOLUTOIN`",
                "`HEMICUBE_RESOLUTION`",
            ],
        ),
        ("HEMICUBE_SHARD", ["`HEMICUBE_SHARD`", "give `--shard`"]),
        ("HEMICUBE_VERIFY", ["`HEMICUBE_VERIFY`", "give `--verify`"]),
    ] {
        place.variables = vec![(name.into(), "2".into())];
        place.line("compute room.obj -o m").fails_with(&words);
        assert!(!place.path("m").exists(), "{name}");
    }
    place.variables = vec![("HEMICUBE_COLOURS".into(), "2".into())];
    let ran = place.line("compute room.obj -o m").is(0);
    assert!(
        ran.err
            .contains("warning: the variable `HEMICUBE_COLOURS` is no setting, and nothing reads it"),
        "{}",
        ran.err
    );
    place.variables = vec![("HEMICUBE_MEMORY".into(), "2M".into())];
    place
        .line("compute room.obj -o n --split 256")
        .fails_with(&["of the 2.0 MB allowed are left", "allows it"]);
}

#[test]
fn words_in_place_of_commands_are_understood() {
    let place = Place::new();
    place.line("generate room --patches 40 -o room.obj -q").is(0);
    assert_eq!(place.line("help").is(0).out, place.line("--help").is(0).out);
    assert_eq!(place.line("help check").is(0).out, place.line("check --help").is(0).out);
    assert_eq!(place.line("version").is(0).out, place.line("--version").is(0).out);
    let scene = [
        "and no command is given",
        "hint: `hemicube compute room.obj -o room.hemicube`",
    ];
    place.line("room.obj").fails_with(&scene);
    place.line("gone/room.ply").fails_with(&["`gone/room.ply` is a scene"]);
    // Hidden commands are not suggested.
    let ran = place.line("manua").is(2);
    assert!(!ran.err.contains("manual"), "{}", ran.err);
    let ran = place.line("comp").is(2);
    assert!(ran.err.contains("'compute'"), "{}", ran.err);

    // A matrix has its scene's name where none is given.
    place
        .line("compute room.obj -q --correction pixel --resolution 32")
        .is(0);
    place.line("check room.hemicube").is(0);
    place
        .line("compute room.obj -q --correction pixel --resolution 64")
        .fails_with(&["`room.hemicube` holds another matrix"]);
    place
        .line("room.hemicube")
        .fails_with(&["no command is given", "hemicube check room.hemicube"]);
    for command in ["check", "solve", "merge"] {
        place.line(&format!("{command} room.obj")).fails_with(&[
            "`room.obj` is a file, and a matrix is a directory",
            "hint: `hemicube compute room.obj -o room.hemicube`",
        ]);
    }
}

/// A floor and a lamp above it in two files of a folder are the scene that one file makes of them, but for names.
#[test]
fn a_folder_is_one_scene() {
    let place = Place::new();
    let floor = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nf 1 2 3 4\n";
    let lamp = "v 0 0 1\nv 0 1 1\nv 1 1 1\nv 1 0 1\n";
    place.write("model/floor.obj", format!("o Body\n{floor}"));
    place.write("model/lamp.obj", format!("o Body\n{lamp}f 1 2 3 4\n"));
    place.write("whole.obj", format!("{floor}{lamp}f 5 6 7 8\n"));
    for scene in ["model", "whole.obj"] {
        place
            .line(&format!(
                "compute {scene} -q --up z --split 4 --correction pixel --resolution 64"
            ))
            .is(0);
    }
    let matrix = |store: &str| {
        place
            .line(&format!("export {store}.hemicube -o {store}.mtx -q --overwrite"))
            .is(0);
        let read = std::fs::read_to_string(place.path(format!("{store}.mtx"))).expect("a matrix");
        let rows: Vec<String> = read
            .lines()
            .filter(|line| !line.starts_with('%'))
            .map(str::to_owned)
            .collect();
        rows
    };
    assert!(matrix("model").len() > 64);
    assert_eq!(matrix("model"), matrix("whole"));

    let seen = place.line("inspect model --json").is(0).json();
    let read = std::fs::read_to_string(place.path("model.hemicube/manifest.json")).expect("a manifest");
    let manifest: Value = serde_json::from_str(&read).expect("JSON");
    assert_eq!(manifest["objects"], serde_json::json!(["floor", "lamp"]));
    let bytes = files(&place.path("model")).values().map(Vec::len).sum::<usize>();
    assert_eq!(seen["inputs"][0]["bytes"], bytes);

    // Every command that asks for the scene takes the folder, and tells when it is another.
    place.line("export model.hemicube -o p.vtp --scene model").is(0);
    place
        .line("compute model/floor.obj model/lamp.obj -o n")
        .fails_with(&["`model/lamp.obj` is a second scene", "in a folder, and give the folder"]);
    place
        .line("model")
        .fails_with(&["hemicube compute model -o model.hemicube"]);
    place.write("model/more.obj", "v 0 0 2\nv 1 0 2\nv 0 1 2\nf 1 2 3\n");
    place.line("export model.hemicube -o q.vtp --scene model").is(2);
    place
        .line("compute model.hemicube")
        .fails_with(&["is a matrix, and a scene is needed"]);
}

#[test]
fn the_only_solution_is_shown() {
    let place = Place::new();
    place.line("generate room --patches 40 -o room.obj -q").is(0);
    place
        .line("compute room.obj -q --correction pixel --resolution 32")
        .is(0);
    place.write("m.toml", "[default]\nreflectance = 0.5\nemission = 1.0\n");
    let solve = "solve room.hemicube --scene room.obj --materials m.toml -q --solution";
    let view = "view model room.hemicube room.obj -q -o";
    place.line(&format!("{solve} noon")).is(0);
    place.line(&format!("{view} noon.png")).is(0);
    place.line(&format!("{solve} night")).is(0);
    place
        .line(&format!("{view} two.png"))
        .fails_with(&["`night`, `noon`", "`--solution`"]);
    place.line(&format!("{solve} radiosity")).is(0);
    place.line(&format!("{view} usual.png")).is(0);
}

#[test]
fn wrong_usage_is_refused() {
    let place = Place::new();
    place.line("generate room --patches 40 -o room.obj").is(0);
    for (settings, word) in [
        ("--resolution 100", "multiple of 16"),
        ("--resolution 2048", "multiple of 16"),
        ("--samples 3", "perfect square"),
        ("--samples 0", "perfect square"),
        ("--correction better", "pixel"),
        ("--rows 5..2", "no row"),
        ("--rows few", "a range"),
        ("--rows 0", "at least 1"),
        ("--rows 120%", "percentage"),
        ("--scale 0", "above 0"),
        ("--scale nan", "above 0"),
        ("--patch-size -1", "above 0"),
        ("--threads 100000", "1024"),
        ("--two-sided maybe", "auto, on, off"),
        ("--backend gpu", "no backend named `gpu`"),
        ("--backend CPU", "no backend named `CPU`"),
        ("-q -v", "cannot be used with"),
    ] {
        let ran = place.line(&format!("compute room.obj -o m {settings}")).is(2);
        assert!(
            ran.err.contains(word) && ran.err.starts_with("error: "),
            "{settings}: {}",
            ran.err
        );
        assert!(!place.path("m").exists(), "{settings}");
    }
    place.line("compute").is(2);
    place.line("compute -o m").is(2);
    place.line("generate castle -o castle.obj").is(2);
    place.line("generate room -o room.stl").fails_with(&[".obj"]);
    place.line("generate room --patches 0 -o new.obj").is(2);
    place
        .line("generate room --patches 99999999999 -o new.obj")
        .fails_with(&["patches"]);
    assert!(!place.path("new.obj").exists());
    // The scene is never taken for the report's file.
    let before = std::fs::read(place.path("room.obj")).expect("a scene");
    assert_eq!(
        place.line("inspect --json room.obj").is(0).json()["patches"]["count"],
        40
    );
    assert_eq!(std::fs::read(place.path("room.obj")).expect("a scene"), before);
}

#[test]
fn bad_scenes_are_refused() {
    let place = Place::new();
    place.write("empty.obj", "");
    place.write("vertices.obj", "v 0 0 0\nv 1 0 0\n");
    place.write("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    place.write(
        "nan.obj",
        "v nan 0 0\nv 1 nan 0\nv 0 1 nan\nv 0 0 1e400\nf 1 2 3\nf 1 2 4\n",
    );
    place.write("broken.obj", "v 0 0 0\nv 1 0\nf 1 2 3\n");
    place.write("noise.obj", [0u8, 255, 254, 7].repeat(1000));
    place.write("cut.glb", b"glTF\x02\0\0\0\xff\xff\xff\xffJSON");
    place.write("empty.glb", "");
    place.write("claims.ac", "AC3Db\nMATERIAL \"\" rgb 1 1 1 amb 0 0 0 emis 0 0 0 spec 0 0 0 shi 0 trans 0\nOBJECT poly\nnumvert 999999999999\n");
    place.write("scene.xyz", "solid\n");
    place.write("cut.stl", "solid\n");
    place.write("cut.vs3", "F 3\nV 1 0 0\n");
    place.write("other.json", "{\"type\": \"FeatureCollection\"}");
    std::fs::create_dir(place.path("directory.obj")).expect("a directory");
    for command in ["inspect", "compute -o m"] {
        for (scene, words) in [
            ("empty.obj", ["empty.obj", "no triangle"]),
            ("vertices.obj", ["vertices.obj", "no triangle"]),
            ("flat.obj", ["flat.obj", "1 is without area"]),
            ("nan.obj", ["nan.obj", "not finite"]),
            ("broken.obj", ["broken.obj:2", ""]),
            ("noise.obj", ["noise.obj", ""]),
            ("cut.glb", ["cut.glb", ""]),
            ("empty.glb", ["empty.glb", ""]),
            ("claims.ac", ["claims.ac", ""]),
            ("scene.xyz", ["scene.xyz", ".gltf"]),
            ("cut.stl", ["cut.stl:", "cut short"]),
            ("cut.vs3", ["cut.vs3:2: ", "before a coordinate"]),
            ("other.json", ["other.json", "not `CityJSON`"]),
            ("missing.obj", ["missing.obj", "does not exist"]),
            ("directory.obj", ["directory.obj", "is a folder without a scene file"]),
        ] {
            place.line(&format!("{command} {scene}")).fails_with(&words);
            assert!(!place.path("m").exists(), "{scene}");
        }
    }
}

#[test]
fn bad_matrices_are_refused() {
    let place = Place::new();
    place.write("directory/notes.txt", "mine");
    place.write("store/manifest.json", "{}");
    place.write("noise.npz", [7u8; 100]);
    for command in ["check", "export"] {
        let rest = if command == "export" { " -o F.npz" } else { "" };
        place
            .line(&format!("{command} directory{rest}"))
            .fails_with(&["directory", "no store"]);
        place.line(&format!("{command} store{rest}")).fails_with(&["manifest"]);
        place
            .line(&format!("{command} missing{rest}"))
            .fails_with(&["`missing` does not exist"]);
    }
    place.line("compare noise.npz noise.npz").fails_with(&["noise.npz"]);
    place.line("compare directory noise.npz").fails_with(&["directory"]);
    assert!(!place.path("F.npz").exists());

    // A bit that flipped is a check that does not hold, not an error.
    place.line("generate room --patches 40 -o room.obj").is(0);
    place
        .line("compute room.obj -o m --correction pixel --resolution 32 -q")
        .is(0);
    place.line("check m").is(0);
    place.line("check m --max-reciprocity 0").is(1);
    let part = place.path("m/parts/part-00000.npz");
    let mut bytes = std::fs::read(&part).expect("a part");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&part, bytes).expect("a part");
    let checked = place.line("check m").is(1);
    assert!(checked.out.contains("files: 1 case"), "{}", checked.out);
    assert_eq!(place.line("check m --json").is(1).json()["ok"], false);
}

#[test]
fn what_is_in_the_way_stays() {
    let place = Place::new();
    place.line("generate room --patches 40 -o room.obj").is(0);
    place.write("file", "mine");
    place.write("directory/notes.txt", "mine");
    std::fs::create_dir(place.path("empty")).expect("a directory");
    place
        .line("compute room.obj -o file")
        .fails_with(&["`file` is a file", "choose another name"]);
    place
        .line("compute room.obj -o file --overwrite")
        .fails_with(&["`file` is a file"]);
    place
        .line("compute room.obj -o directory --overwrite")
        .fails_with(&["`directory`", "`notes.txt`"]);
    place.line("compute room.obj -o file/m").fails_with(&["file/m"]);
    assert_eq!(files(&place.path("directory")).len(), 1);
    place
        .line("compute room.obj -o empty --correction pixel --resolution 16 -q")
        .is(0);
    place
        .line("compute room.obj -o a/b/c --correction pixel --resolution 16 -q")
        .is(0);
    place
        .line("generate room -o directory")
        .fails_with(&["`directory` is a directory"]);
    place
        .line("generate room -o missing/room.obj")
        .fails_with(&["missing/room.obj", "cannot be written"]);
    place.line("export empty -o directory").is(2);
    place
        .line("export empty -o missing/F.npz")
        .fails_with(&["missing/F.npz"]);
    if Path::new("/proc/self").is_dir() {
        place
            .line("compute room.obj -o /proc/self/nothing")
            .fails_with(&["`/proc/self/nothing` cannot be created"]);
        place
            .line("compute missing.obj -o /proc/self/nothing")
            .fails_with(&["`/proc/self/nothing` cannot be created"]);
    }
    assert!(!place.path("m").exists());
}

#[cfg(unix)]
#[test]
fn a_reader_that_goes_away_is_success() {
    let place = Place::new();
    for line in ["generate city --patches 20000 -o -", "backends list --json", "--help"] {
        let mut child = place
            .command()
            .args(line.split_whitespace())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program runs");
        drop(child.stdout.take());
        let ran = ran(child.wait_with_output().expect("the program ends"));
        assert!(!ran.is(0).err.contains("error"), "{line}");
    }
    // A full disk behind it is not.
    if let Ok(full) = std::fs::File::options().write(true).open("/dev/full") {
        let mut command = place.command();
        command.args(["backends", "list"]).stdout(full);
        let ran = ran(command
            .stderr(Stdio::piped())
            .spawn()
            .and_then(|c| c.wait_with_output())
            .expect("it runs"));
        ran.fails_with(&["standard output cannot be written"]);
    }
}

/// A command whose files cannot grow beyond `kilobytes`: for the program the same as a full disk.
#[cfg(unix)]
fn limited(place: &Place, kilobytes: u32, line: &str) -> Ran {
    let script = format!("trap '' XFSZ; ulimit -f {}; exec \"$@\"", 2 * kilobytes);
    let started = place.command();
    let mut command = std::process::Command::new("sh");
    command
        .args(["-c", &script, "sh"])
        .arg(program())
        .args(line.split_whitespace());
    command.current_dir(place.directory.path());
    for (name, value) in started.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    ran(Command::from_std(command)
        .timeout(TIME_LIMIT)
        .output()
        .expect("sh runs"))
}

#[cfg(unix)]
#[test]
fn a_solution_that_cannot_be_written_leaves_the_earlier_one() {
    let place = Place::new();
    place.line("generate room --patches 5000 -o room.obj").is(0);
    place
        .line("compute room.obj -o m -q --correction pixel --resolution 16")
        .is(0);
    place.line("solve m").is(0);
    let before = files(&place.path("m/solutions"));
    limited(&place, 4, "solve m").fails_with(&["m/solutions/radiosity/", "disk is full"]);
    assert_eq!(files(&place.path("m/solutions")), before);
    place.line("view model m room.obj --show radiosity -o m.png").is(0);
}

#[test]
fn a_second_entry_of_a_place_is_refused_by_its_line() {
    let place = Place::new();
    let market = |entries: &[&str]| {
        let count = entries.len();
        let lines = entries.join("\n");
        format!("%%MatrixMarket matrix coordinate real general\n2 2 {count}\n{lines}\n")
    };
    place.write("a.mtx", market(&["1 2 0.5", "2 1 0.5"]));
    place.write("b.mtx", market(&["1 2 0.5", "2 1 0.5", "1 2 0.25"]));
    for line in ["compare a.mtx b.mtx", "compare b.mtx a.mtx"] {
        place
            .line(line)
            .fails_with(&["b.mtx:5: row 1, column 2 has an entry before"]);
    }
    place.line("compare a.mtx a.mtx").is(0);
}

#[cfg(unix)]
#[test]
fn a_file_that_cannot_grow_ends_the_run_with_a_word() {
    let place = Place::new();
    place.line("generate room --patches 5000 -o room.obj").is(0);
    // The patch table fits, a part does not.
    limited(
        &place,
        1300,
        "compute room.obj -o m --correction pixel --resolution 256",
    )
    .fails_with(&["part-00000", "disk is full", "hint: "]);
    place.line("check m --allow-incomplete").is(0);
    place.line("check m").is(1);
    limited(&place, 4, "generate city --patches 5000 -o city.obj").fails_with(&["city.obj", "cannot be written"]);
    assert!(!place.path("city.obj").exists());
    let left: Vec<_> = files(place.directory.path())
        .into_keys()
        .filter(|name| name.contains("tmp"))
        .collect();
    assert_eq!(left, Vec::<String>::new(), "temporary files are gone");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_loses_nothing_that_was_written() {
    let place = Place::new();
    let disk = place.path("disk");
    std::fs::create_dir(&disk).expect("a directory");
    let mount = std::process::Command::new("mount")
        .args(["-t", "tmpfs", "-o", "size=5m", "tmpfs"])
        .arg(&disk)
        .output();
    if !mount.is_ok_and(|output| output.status.success()) {
        eprintln!("SKIP a full disk: this user cannot mount a small one");
        return;
    }
    struct Mounted<'a>(&'a Path);
    impl Drop for Mounted<'_> {
        fn drop(&mut self) {
            let _ = std::process::Command::new("umount").arg(self.0).status();
        }
    }
    let _mounted = Mounted(&disk);
    place.line("generate room --patches 2560 -o room.obj").is(0);
    let failed = place
        .line("compute room.obj -o disk/m")
        .fails_with(&["disk is full", "parts are kept"]);
    let checked = place.line("check disk/m --allow-incomplete --json").is(0).json();
    let rows = checked["rows"].as_u64().expect("a number");
    assert!(
        rows > 0 && rows < 2560 && checked["ok"] == true,
        "{checked} {}",
        failed.err
    );
    place.line("export disk/m -o F.npz").fails_with(&["incomplete"]);
    place.line("export disk/m -o F.npz --allow-incomplete").is(0);
    // On a disk that has room it is all there, and the rows that were kept are the same.
    place.line("compute room.obj -o whole -q").is(0);
    for (name, bytes) in files(&disk.join("m/parts")) {
        assert!(
            std::fs::read(place.path("whole/parts").join(&name)).expect("a part") == bytes,
            "{}",
            name
        );
    }
}

#[cfg(unix)]
fn interrupt(child: &std::process::Child) {
    let status = std::process::Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    assert!(status.expect("kill runs").success());
}

#[cfg(unix)]
#[test]
fn an_interrupt_keeps_what_was_computed() {
    let place = Place::new();
    place.line("generate city --patches 20000 -o city.obj").is(0);
    let spawn = |line: &str| {
        place
            .command()
            .args(line.split_whitespace())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program runs")
    };
    let slow = "compute city.obj --correction pixel --resolution 1024 --culling off --threads 1 --overwrite";
    let child = spawn(&format!("{slow} -o m --json"));
    let first_part = place.path("m/parts/part-00000.npz");
    let started = Instant::now();
    while !first_part.exists() {
        assert!(started.elapsed() < TIME_LIMIT, "no part was written");
        std::thread::sleep(Duration::from_millis(20));
    }
    interrupt(&child);
    let ended = ran(child.wait_with_output().expect("the program ends")).is(130);
    assert!(
        ended.err.contains("are kept") && ended.err.contains("--allow-incomplete"),
        "{}",
        ended.err
    );
    let report = ended.json();
    assert_eq!(report["complete"], false);
    let kept = report["rows"].as_u64().expect("a number");
    assert!(
        kept > 0 && kept < report["row_count"].as_u64().expect("a number"),
        "{report}"
    );

    let checked = place.line("check m --allow-incomplete --json").is(0).json();
    assert_eq!(
        (checked["rows"].as_u64(), &checked["complete"]),
        (Some(kept), &Value::Bool(false))
    );
    assert!(place.line("check m").is(1).out.contains("UNFINISHED"));
    place.line("export m -o F.npz").fails_with(&["incomplete"]);
    place
        .line("compute city.obj -o m")
        .fails_with(&["`m` holds another matrix", "with correction ", "--overwrite"]);

    // Twice: at once.
    let child = spawn(&format!("{slow} -o n -q"));
    while !place.path("n/patches.npz").exists() {
        assert!(started.elapsed() < TIME_LIMIT, "the store was not begun");
        std::thread::sleep(Duration::from_millis(20));
    }
    interrupt(&child);
    std::thread::sleep(Duration::from_millis(300));
    interrupt(&child);
    ran(child.wait_with_output().expect("the program ends")).is(130);
    place.line("check n --allow-incomplete").is(0);
}

#[test]
fn real_scenes_from_start_to_end() {
    let place = Place::new();
    if let Some(scene) = shared_scene("cornell/cornell-measured-closed-20q.obj") {
        let scene = scene.to_str().expect("UTF-8");
        let line = ["compute", scene, "--split", "8", "-o", "room", "--json"];
        let report = place.run(line).is(0).json();
        assert_eq!(report["rows"], 2_560);
        assert_eq!(report["escaped"], 0.0, "the room is closed");
        // Those whose middles lie under the blocks.
        assert_eq!(report["rows_mostly_blocked"], 23, "the patches under the blocks");
        place.line("check room").is(0);
    }
    if let Some(scene) = shared_scene("city/denhaag-8897.obj") {
        let line = [
            "compute",
            scene.to_str().expect("UTF-8"),
            "--rows",
            "200",
            "-o",
            "city",
            "--json",
        ];
        let ran = place.run(line).is(0);
        assert_eq!(ran.json()["rows"], 200);
        assert_eq!(ran.json()["culling"], "on");
        assert!(ran.err.contains("patches see mostly backs of surfaces"), "{}", ran.err);
        place.line("check city").is(0);
        let inspected = place.run(["inspect", scene.to_str().expect("UTF-8")]).is(0);
        assert!(inspected.out.contains("37 triangles, kept"), "{}", inspected.out);
    }
}

#[test]
fn an_option_of_another_command_is_said_to_be() {
    let place = hemicube_tests::runs::Place::new();
    place
        .line("tradeoff a.obj --min-factor 1e-6")
        .is(2)
        .says(&["`--min-factor` is an option of `compute`"]);
    let sky = place.line("sky a.obj --config=none").is(2);
    assert!(!sky.err.contains("--no-timings'"), "{}", sky.err);
    sky.says(&["`--config` is an option of `compute`"]);
}
