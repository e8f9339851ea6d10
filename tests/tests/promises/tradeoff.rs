//! Accuracy as a user asks for it: tolerances as a setting, runs that measure their own error, and error against time.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

use hemicube_tests::runs;
use serde_json::Value;
use std::path::PathBuf;
use std::process::{Command, Output};
use std::time::Duration;

/// A directory of its own to run in, without settings of the user or the environment.
struct Place(runs::Place);

impl Place {
    fn new() -> Self {
        Self(runs::Place::new())
    }

    /// One with a generated scene, `scene.obj`.
    fn with(kind: &str, patches: u32) -> Self {
        let place = Self::new();
        place.line(&format!("generate {kind} --patches {patches} -o scene.obj -q"), 0);
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path(name)
    }

    fn write(&self, name: &str, text: &str) {
        self.0.write(name, text);
    }

    fn command(&self, line: &str) -> Command {
        self.0.command(line)
    }

    /// Runs a line of words without blanks in them, which must end with `code`.
    #[track_caller]
    fn line(&self, line: &str, code: i32) -> (String, String) {
        let output = self.command(line).output().expect("the program runs");
        ended(&output, line, code)
    }

    #[track_caller]
    fn json(&self, line: &str, code: i32) -> Value {
        let (out, _) = self.line(line, code);
        serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error} in: {out}"))
    }

    fn manifest(&self, store: &str) -> Value {
        let text = std::fs::read_to_string(self.path(store).join("manifest.json")).expect("a manifest");
        serde_json::from_str(&text).expect("a manifest is JSON")
    }
}

#[track_caller]
fn ended(output: &Output, line: &str, code: i32) -> (String, String) {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).expect("UTF-8");
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{line}\nstdout: {out}\nstderr: {err}");
    assert!(!err.contains("panicked"), "{err}");
    (out, err)
}

#[track_caller]
fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn what_is_not_said_is_settled_and_recorded() {
    let place = Place::with("room", 40);
    for (settings, correction, resolution, tolerance) in [
        ("", "tolerance", 128, Some(0.02)),
        ("--correction pixel", "pixel", 256, None),
        ("--correction pixel --resolution 64", "pixel", 64, None),
        ("--tolerance 0.3%", "tolerance", 128, Some(0.003)),
        ("--tolerance 0.02 --correction tolerance", "tolerance", 128, Some(0.02)),
    ] {
        let report = place.json(&format!("compute scene.obj -o m --overwrite -q --json {settings}"), 0);
        let manifest = place.manifest("m");
        assert_eq!(manifest["settings"], report["settings"], "{settings}");
        assert_eq!(manifest["correction"], correction, "{settings}");
        let recorded = &manifest["settings"];
        assert_eq!(
            (&recorded["correction"], &recorded["resolution"]),
            (&Value::from(correction), &Value::from(resolution)),
            "{settings}"
        );
        assert_eq!(recorded["tolerance"].as_f64(), tolerance, "{settings}");
        assert_eq!(
            recorded["reason"].is_string(),
            tolerance.is_some(),
            "{settings}: {recorded}"
        );
    }
    let (_, err) = place.line("compute scene.obj -o m --overwrite --tolerance 1% -v", 0);
    assert!(err.contains("tolerance 1%: "), "the choice is explained: {err}");
}

#[test]
fn a_tolerance_comes_in_layers_like_any_setting() {
    let place = Place::with("room", 40);
    let printed = |line: &str| place.line(&format!("compute --print-config {line}"), 0).0;
    let has = |text: &str, setting: &str, origin: &str| {
        text.lines().any(|line| {
            line.split_once("  # ")
                .is_some_and(|(value, from)| value.trim() == setting && from.starts_with(origin))
        })
    };
    let text = printed("--config=none");
    assert!(
        has(&text, "# tolerance =", "not set") && has(&text, "resolution = \"auto\"", "built-in"),
        "{text}"
    );
    assert!(has(&text, "correction = \"tolerance\"", "built-in"), "{text}");

    place.write("hemicube.toml", "tolerance = \"3%\"\n");
    assert!(has(&printed(""), "tolerance = \"3%\"", "hemicube.toml:1"));
    let text = printed("--tolerance 0.004");
    assert!(has(&text, "tolerance = 0.004", "command line"), "{text}");
    // The command line's word against the file's: the tolerance gives way, or what excludes it does.
    for settings in ["--correction pixel", "--correction pixel --samples 4"] {
        assert!(
            has(&printed(settings), "# tolerance =", "not set"),
            "{settings}: {}",
            printed(settings)
        );
    }
    place.write("hemicube.toml", "correction = \"pixel\"\nsamples = 4\n");
    let text = printed("--tolerance 1%");
    assert!(
        has(&text, "correction = \"tolerance\"", "built-in") && has(&text, "samples = 1", "built-in"),
        "{text}"
    );
    place.write("hemicube.toml", "correction = \"tolerance\"\ntolerance = 0.01\n");
    place.line("compute scene.obj -o m -q", 0);
    assert_eq!(place.manifest("m")["settings"]["tolerance"], 0.01);

    for (settings, words) in [
        (
            "--tolerance 1% --correction pixel",
            ["exclude each other", "`--correction`"],
        ),
        (
            "--resolution 64",
            ["`--resolution` does nothing", "`--correction pixel`"],
        ),
        ("--samples 4", ["`--samples` does nothing", "`--correction pixel`"]),
        ("--correction area", ["`tolerance`", "`pixel`"]),
        ("--tolerance 1% --samples 4", ["exclude each other", "`--samples`"]),
        ("--tolerance 0", ["--tolerance", "50%"]),
        ("--tolerance=-1%", ["--tolerance", "50%"]),
        ("--tolerance 1", ["--tolerance", "100 %"]),
        ("--tolerance nan", ["--tolerance", "50%"]),
        ("--tolerance much", ["--tolerance", "`1%`"]),
        ("--verify 0", ["--verify", "0"]),
    ] {
        let (out, err) = place.line(&format!("compute scene.obj -o n --config=none {settings}"), 2);
        assert!(
            out.is_empty() && words.iter().all(|word| err.contains(word)),
            "{settings}: {err}"
        );
        assert!(!place.path("n").exists(), "{settings}");
    }
    place.write("hemicube.toml", "tolerance = \"70%\"\n");
    let (_, err) = place.line("compute scene.obj -o n", 2);
    assert!(err.contains("hemicube.toml:1") && err.contains("50 %"), "{err}");
}

#[test]
fn a_run_measures_its_own_error() {
    let place = Place::with("room", 60);
    let verified = |settings: &str| {
        let line = format!("compute scene.obj -o m --overwrite -q --json {settings}");
        place.json(&line, 0)["verification"].clone()
    };
    let pixel = verified("--correction pixel --verify 100000");
    let area = verified("--verify 100000");
    assert_eq!(
        (&pixel["rows"], &pixel["rows_computed"]),
        (&Value::from(40), &Value::from(40))
    );
    let error = |of: &Value| number(&of["measured"]["relative_frobenius"]);
    // One hemicube's sums of pixels are off by a tenth and more on rooms; fractions by much less.
    assert!(
        error(&pixel) > 0.05 && error(&area) < 0.5 * error(&pixel),
        "{pixel} {area}"
    );
    assert!(pixel["verdict"].is_null(), "without a tolerance there is no verdict");
    assert_eq!(area["verdict"], "kept", "{area}");
    assert!(number(&area["measured"]["reference_noise"]) < 0.005, "{area}");

    let kept = verified("--tolerance 5% --verify 100000");
    assert_eq!(kept["verdict"], "kept", "{kept}");
    assert!(number(&kept["measured"]["interval_of_rows"]["high"]) <= 0.05, "{kept}");
    // A handful of rows is no word on the others.
    let few = verified("--tolerance 5% --verify 3");
    assert_eq!(
        (&few["verdict"], &few["rows"]),
        (&Value::from("unsure_for_rows"), &Value::from(3))
    );
    // Rows are drawn by the seed, among those that were computed.
    let drawn = "--tolerance 5% --rows 10..30 --verify 12 --threads 1 --seed";
    assert_eq!(verified(&format!("{drawn} 3")), verified(&format!("{drawn} 3")));
    assert_ne!(
        verified(&format!("{drawn} 3"))["measured"],
        verified(&format!("{drawn} 4"))["measured"]
    );
    assert_eq!(verified(&format!("{drawn} 3"))["rows_computed"], 20);

    let (_, err) = place.line("compute scene.obj -o m --overwrite --tolerance 5% --verify 20 -v", 0);
    for word in [
        "verified",
        "20 of 40 rows (seed 1)",
        "relative Frobenius",
        "95 %",
        "tolerance  ",
        "its own noise",
    ] {
        assert!(err.contains(word), "`{word}` is not in {err}");
    }
}

#[test]
fn columns_that_were_not_asked_for_do_not_count_as_errors() {
    let place = Place::new();
    place.write(
        "scene.obj",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 1 1\nv 1 0 1\nv 0 0 0.5\nv 0.3 0 0.5\nv 0 0.3 0.5\n\
         o floor\nf 1 2 3\no ceiling\nf 4 5 6\no shelf\nf 7 9 8\n",
    );
    let line = "compute scene.obj -o m --split 4 --emitters floor --receivers shelf --verify 99 -q --json";
    let verification = &place.json(line, 0)["verification"];
    assert_eq!(verification["rows"], 16);
    let measured = &verification["measured"];
    assert!(number(&measured["relative_frobenius"]) < 0.02, "{measured}");
    assert_eq!(number(&measured["missed_mass"]), 0.0, "{measured}");
}

#[test]
fn error_against_time() {
    let place = Place::with("room", 250);
    let line = "tradeoff scene.obj --split 2 --rows 8 --seed 5 --tolerance 2%";
    let (table, err) = place.line(&format!("{line} -v"), 0);
    for word in [
        "setting",
        "ms/row",
        "error %",
        "pixel K=16 N=512",
        "pixel K=4 N=128",
        "tolerance 0.1%",
        "seed 5",
    ] {
        assert!(table.contains(word), "`{word}` is not in {table}");
    }
    assert!(table.lines().all(|line| line.chars().count() <= 120), "{table}");
    assert!(err.contains("8 rows by rays"), "{err}");
    let report = place.json(&format!("{line} -o plot.svg --json -v"), 0);
    let trials = report["trials"].as_array().expect("trials");
    assert_eq!(trials.len() + report["skipped"].as_array().expect("a list").len(), 18);
    assert_eq!(
        (&report["sampled_rows"], &report["patches"]),
        (&Value::from(8), &Value::from(640))
    );
    let error = |name: &str| {
        let trial = trials.iter().find(|trial| trial["name"] == name).expect(name);
        number(&trial["measured"]["relative_frobenius"])
    };
    assert!(error("tolerance 2%") < 0.3 * error("pixel K=1 N=128"));
    assert!(error("pixel K=16 N=256") < 0.5 * error("pixel K=1 N=256"));
    assert!(error("tolerance 0.1%") < error("pixel K=16 N=256"));
    for trial in trials {
        assert_eq!(trial["measured"]["rows"], 8, "{trial}");
        assert!(number(&trial["timing"]["milliseconds_per_row"]) > 0.0, "{trial}");
    }
    // The front: by time, each better than all before it.
    let front: Vec<f64> = trials
        .iter()
        .filter(|trial| trial["timing"]["front"] == true)
        .map(|trial| number(&trial["measured"]["interval_of_rows"]["high"]))
        .collect();
    assert!(
        !front.is_empty() && front.windows(2).all(|pair| pair[1] < pair[0]),
        "{front:?}"
    );
    let is_marked = |line: &&str| line.starts_with("* ") && !line.contains("no cheaper");
    assert!(table.lines().filter(is_marked).count() >= 3, "{table}");
    // Without `-v` no other is shown.
    let (short, _) = place.line(line, 0);
    let settings = short
        .lines()
        .filter(|line| line.contains(" N=") || line.starts_with("* tolerance ") || line.starts_with("  tolerance "));
    assert!(
        settings.clone().count() >= 3 && settings.clone().all(|line| line.starts_with("* ")),
        "{short}"
    );

    // What it recommends is the cheapest tolerance that promises as much and keeps it, or else the cheapest setting that
    // keeps it; as a line that runs and keeps it.
    let recommended = &report["recommended"];
    let command = recommended["command"].as_str().expect("a command");
    assert!(command.contains("--split 2"), "{command}");
    assert!(number(&recommended["error"]) <= 0.02);
    let good = |t: &&Value| number(&t["measured"]["interval_of_rows"]["high"]) <= 0.02;
    let promises = |t: &&Value| t["tolerance"].as_f64().is_some_and(|t| t < 0.02 + 1e-9);
    let cost = |t: &Value| number(&t["timing"]["milliseconds_per_row"]);
    let least = |least: f64, trial: &Value| least.min(cost(trial));
    let promised = trials.iter().filter(good).filter(promises).fold(f64::INFINITY, least);
    let wanted = if promised.is_finite() {
        promised
    } else {
        trials.iter().filter(good).fold(f64::INFINITY, least)
    };
    assert_eq!(number(&recommended["milliseconds_per_row"]), wanted);
    let words = command.strip_prefix("hemicube ").expect("the program's name");
    let computed = place.json(&format!("{words} --rows 8 --seed 5 --verify 8 -q --json"), 0);
    assert!(
        number(&computed["verification"]["measured"]["relative_frobenius"]) <= 0.021,
        "{computed}"
    );

    let svg = std::fs::read_to_string(place.path("plot.svg")).expect("a picture");
    assert!(
        svg.starts_with("<svg ") && svg.contains("scene.obj: error against time"),
        "{}",
        &svg[..300]
    );
    let name = recommended["name"].as_str().expect("a name");
    assert!(svg.contains(name), "{name}");
}

#[test]
fn errors_do_not_depend_on_the_clock_or_the_threads() {
    let place = Place::with("block-city", 300);
    let report = |threads: u32, seed: u32| {
        let line = "tradeoff scene.obj --rows 4 -q --json";
        let mut report = place.json(&format!("{line} --threads {threads} --seed {seed}"), 0);
        report.as_object_mut().expect("an object").remove("threads");
        let text = report.to_string();
        assert!(
            !text.contains("timing") && !text.contains("front") && !text.contains("recommended"),
            "{text}"
        );
        sorted(report)
    };
    assert_eq!(report(1, 1), report(2, 1));
    assert_ne!(report(1, 1), report(1, 2));
}

/// With its trials by name: their order is that of their times.
fn sorted(mut report: Value) -> Value {
    let trials = report["trials"].as_array_mut().expect("trials");
    trials.sort_by_key(|trial| trial["name"].as_str().map(ToOwned::to_owned));
    report
}

#[test]
fn the_smallest_scenes_have_a_trade_off_too() {
    let place = Place::new();
    let pair = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 1 1\nv 1 0 1\n";
    // One triangle sees nothing; two see each other.
    place.write("one.obj", &format!("{pair}f 1 2 3\n"));
    place.write("two.obj", &format!("{pair}f 1 2 3\nf 4 5 6\n"));
    for scene in ["one", "two"] {
        let (table, _) = place.line(&format!("tradeoff {scene}.obj -o {scene}.png --tolerance 0.5"), 0);
        assert!(
            table.contains(&format!("hemicube compute {scene}.obj -o {scene}.hemicube")),
            "{table}"
        );
        let png = std::fs::read(place.path(&format!("{scene}.png"))).expect("a picture");
        assert!(png.starts_with(b"\x89PNG\r\n\x1a\n") && png.len() > 10_000);
    }
}

#[test]
fn wrong_usage_is_refused_before_anything_is_read() {
    let place = Place::with("room", 40);
    for (line, word) in [
        ("tradeoff scene.obj -o plot.pdf", ".svg or .png"),
        ("tradeoff scene.obj -o missing/plot.svg", "missing/plot.svg"),
        ("tradeoff scene.obj --rows 1", "--rows"),
        ("tradeoff scene.obj --rows 5%", "--rows"),
        ("tradeoff scene.obj --tolerance 80%", "50 %"),
        ("tradeoff scene.obj --backend gpu", "no backend named `gpu`"),
        ("tradeoff missing.obj", "missing.obj"),
        ("tradeoff scene.obj --resolution 64", "--resolution"),
    ] {
        let (out, err) = place.line(line, 2);
        assert!(out.is_empty() && err.contains(word), "{line}: {err}");
    }
    // Settings of scene and engine come in layers; how many rows `compute` samples is no matter here.
    place.write("hemicube.toml", "resolution = 512\nsplit = 2\ntolerance = \"3%\"\n");
    let (printed, _) = place.line("tradeoff --print-config", 0);
    for setting in ["rows = 24", "split = 2", "tolerance = \"3%\""] {
        assert!(
            printed.lines().any(|line| line.starts_with(setting)),
            "`{setting}` is not in {printed}"
        );
    }
    assert!(!printed.contains("resolution"), "{printed}");
}

#[cfg(unix)]
#[test]
fn an_interrupt_leaves_nothing_half_done() {
    let place = Place::with("city", 20_000);
    let interrupted = |line: &str, signals_after: Duration| {
        let child = place.command(line).spawn().expect("the program runs");
        std::thread::sleep(signals_after);
        let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
        assert!(kill.expect("kill runs").success());
        ended(&child.wait_with_output().expect("the program ends"), line, 130)
    };
    let (out, _) = interrupted(
        "tradeoff scene.obj --rows 20000 -o plot.svg --json",
        Duration::from_secs(2),
    );
    assert!(out.is_empty(), "{out}");
    let left: Vec<String> = std::fs::read_dir(place.path(""))
        .expect("a directory")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .filter(|name| name.contains("plot") || name.contains("report"))
        .collect();
    assert_eq!(left, Vec::<String>::new());

    // While it verifies, the matrix is complete already.
    let line = "compute scene.obj -o m --rows 0..5000 --resolution 16 --correction pixel --verify 5000 --json";
    let (out, err) = interrupted(line, Duration::from_secs(6));
    let report: Value = serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error} in {out} {err}"));
    assert_eq!(
        (&report["complete"], &report["verification"]["interrupted"]),
        (&Value::from(true), &Value::from(true))
    );
    assert!(
        report["verification"]["rows"].as_u64().is_some_and(|rows| rows < 5000),
        "{err}"
    );
    place.line("check m --allow-incomplete", 0);
}
