//! Long runs survive: killed at any moment, told to end, on a full or failing disk, with damaged files, a clock that
//! jumps, two writers at once. Whatever happened, the same command goes on, and the store ends the same to the bit.

#![cfg(unix)]
#![allow(clippy::print_stderr, reason = "figures, and skipped tests say so")]

use hemicube::backend::{BackendError, BackendInfo, Counters, Geometry, Hemicube, HemicubeBackend, RenderSettings};
use hemicube::driver::compute::{ComputeError, Execution, compute};
use hemicube::row::RowBlock;
use hemicube::store::{BackendEntry, Header, PatchTable, SceneEntry, StoreWriter, scene_hash};
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::Subdivision;
use hemicube_tests::random::Random;
use hemicube_tests::rows::{plan, settings};
use hemicube_tests::runs::{Place, assert_same, files, finish, until};
use hemicube_tests::scenes::model;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, Instant};

/// Many parts soon: 63 of 128 rows in a city of 8,000 patches.
const COMPUTE: &str = "compute city.obj -q --correction pixel --resolution 32";

fn city(patches: u32) -> Place {
    let place = Place::new();
    let line = format!("generate city --patches {patches} --seed 3 -o city.obj");
    assert_eq!(place.line(&line).code, Some(0));
    place
}

fn signal(child: &Child, name: &str) {
    let id = child.id().to_string();
    let sent = Command::new("kill").args([name, &id]).status();
    assert!(sent.expect("kill runs").success());
}

/// The phase of a run when it said its last line.
fn stage_of(line: &str) -> String {
    let after = |key: &str| {
        let rest = line.split_once(key)?.1;
        Some(rest.split(['"', ' ']).next().unwrap_or("").to_owned())
    };
    match (after("step=\""), after("file=")) {
        (Some(step), Some(file)) => {
            let what = match () {
                () if file.ends_with("manifest.json") => "manifest",
                () if file.ends_with("patches.npz") => "patches",
                () => "part",
            };
            match step.as_str() {
                "written" => format!("after {what}"),
                step => format!("{what}: {step}"),
            }
        }
        _ => after("stage=\"").map_or_else(|| "start".to_owned(), |stage| format!("stage {stage}")),
    }
}

/// Kills runs until there were so many: half of them at a random time, half at a random line of what they say, which is
/// where a time would seldom hit. Every store that is complete must be the undisturbed one. The histogram of stages.
fn kill(kills: u64) -> BTreeMap<String, u64> {
    let place = city(8_000);
    place.line(&format!("{COMPUTE} -o whole")).is(0);
    let mut random = Random(kills);
    let mut stages: BTreeMap<String, u64> = BTreeMap::new();
    let (mut killed, mut lives, mut stores) = (0, 0, 0);
    while killed < kills || place.path("m").exists() {
        lives += 1;
        assert!(lives < 20 * kills, "{killed} kills in {lives} runs");
        let mut command = place.command(&format!("{COMPUTE} -o m"));
        command.env("HEMICUBE_LOG", "hemicube=trace");
        let mut child = place.spawn(command);
        let mut stderr = BufReader::new(child.stderr.take().expect("standard error is a pipe"));
        let mut last = String::new();
        let mut line = String::new();
        // Enough are killed: now one run to the end.
        let target = (killed < kills).then(|| random.below(2) == 0);
        match target {
            Some(true) => {
                std::thread::sleep(Duration::from_micros(random.bits() % 500_000));
                signal(&child, "-KILL");
            }
            Some(false) => {
                for _ in 0..random.below(120) {
                    line.clear();
                    if stderr.read_line(&mut line).expect("text") == 0 {
                        break;
                    }
                    last.clone_from(&line);
                }
                signal(&child, "-KILL");
            }
            None => {}
        }
        let mut rest = String::new();
        stderr.read_to_string(&mut rest).expect("text");
        // A line may be half.
        if let Some(end) = rest.trim_end_matches(|c| c != '\n').trim_end().lines().last() {
            end.clone_into(&mut last);
        }
        let status = child.wait().expect("it ends");
        assert!(!rest.contains("panicked") && !rest.contains("error"), "{rest}");
        match status.code() {
            None => {
                killed += 1;
                *stages.entry(stage_of(&last)).or_default() += 1;
            }
            Some(code) => {
                assert_eq!(code, 0, "{rest}");
                assert_same(&place.path("m"), &place.path("whole"));
                std::fs::remove_dir_all(place.path("m")).expect("the store goes");
                stores += 1;
            }
        }
    }
    eprintln!("{killed} kills in {lives} runs, {stores} stores the same to the bit. Killed at:");
    for (stage, count) in &stages {
        eprintln!("{count:5}  {stage}");
    }
    stages
}

fn while_writing(stages: &BTreeMap<String, u64>) -> u64 {
    let is_writing = |stage: &str| stage.contains(": ") || stage.starts_with("stage finish");
    stages
        .iter()
        .filter(|(stage, _)| is_writing(stage))
        .map(|(_, count)| count)
        .sum()
}

#[test]
fn killed_runs_end_in_the_same_store() {
    let stages = kill(40);
    assert!(while_writing(&stages) >= 4, "{stages:?}");
}

#[test]
#[ignore = "some minutes: ./test --full"]
fn two_hundred_kills_end_in_the_same_store() {
    let stages = kill(200);
    assert!(while_writing(&stages) >= 20, "{stages:?}");
    let at = |what: &str| stages.keys().any(|stage| stage.contains(what));
    assert!(at("part: ") && at(": rename") && at("manifest: "), "{stages:?}");
}

/// Settings under which what a run settles, leaves out and rounds must be settled, left out and rounded again.
#[test]
fn every_kind_of_run_goes_on() {
    goes_on(&[
        "--min-factor 1e-5 --form compact",
        "--rows 100..3000 --correction pixel --samples 4 --resolution 32",
    ]);
}

#[test]
#[ignore = "half a minute of whole matrices: ./test --full"]
fn runs_to_a_tolerance_go_on() {
    goes_on(&["--tolerance 2%", "--rows 30% --tolerance 1%"]);
}

/// Kills a run of each of these settings, and holds what goes on to the bytes of one that nothing stopped.
fn goes_on(settings: &[&str]) {
    let place = city(6_000);
    for settings in settings {
        let compute = format!("compute city.obj -q {settings}");
        place.line(&format!("{compute} -o whole --overwrite")).is(0);
        let child = place.spawn(place.command(&format!("{compute} -o m")));
        let second = place.path("m/parts/part-00001.npz");
        until("a second part is written", || second.exists());
        signal(&child, "-KILL");
        finish(child);
        place.line(&format!("{compute} -o m --threads 1")).is(0);
        assert_same(&place.path("m"), &place.path("whole"));
        std::fs::remove_dir_all(place.path("m")).expect("the store goes");
    }
}

#[test]
fn a_request_to_terminate_finishes_the_part() {
    let place = city(8_000);
    place.line(&format!("{COMPUTE} -o whole")).is(0);
    for request in ["-TERM", "-INT", "-HUP"] {
        let child = place.spawn(place.command(&format!("{} -o m", COMPUTE.replace(" -q", ""))));
        let first = place.path("m/parts/part-00000.npz");
        until("a part is written", || first.exists());
        signal(&child, request);
        let ended = finish(child).is(130).says(&["interrupted", "goes on", "are kept"]);
        let checked = place.line("check m --allow-incomplete --json").is(0).json();
        let parts = files(&place.path("m/parts"));
        assert_eq!(
            checked["rows"].as_u64(),
            Some(128 * parts.len() as u64),
            "the manifest names every part that is there: {}",
            ended.err
        );
        assert!(parts.keys().all(|name| !name.contains("tmp")));
        let report = place.line(&format!("{COMPUTE} -o m --json")).is(0).json();
        assert_eq!(report["parts_kept"].as_u64(), Some(parts.len() as u64));
        assert_eq!((&report["rows"], &report["complete"]), (&8000.into(), &true.into()));
        assert_same(&place.path("m"), &place.path("whole"));
        std::fs::remove_dir_all(place.path("m")).expect("the store goes");
    }
}

#[test]
fn another_scene_and_other_settings_are_refused_by_name() {
    let place = city(3_000);
    place.line("generate city --patches 3000 --seed 4 -o other.obj").is(0);
    place.line(&format!("{COMPUTE} -o m")).is(0);
    let before = files(&place.path("m"));
    std::fs::copy(place.path("city.obj"), place.path("renamed.obj")).expect("a copy");
    for (line, words) in [
        (
            "compute city.obj -q --correction pixel --resolution 64",
            &["it was computed with resolution 32, and here it is with resolution 64"][..],
        ),
        (
            "compute city.obj -q",
            &["with correction pixel, and here it is with correction tolerance"],
        ),
        (
            "compute city.obj -q --correction pixel --resolution 32 --rows 0..100",
            &["with all rows, and here it is with rows 0..100"],
        ),
        (
            "compute city.obj -q --correction pixel --resolution 32 --min-factor 1e-4",
            &["without min factor, and here it is with min factor 0.0001"],
        ),
        (
            "compute city.obj -q --correction pixel --resolution 32 --form compact",
            &["its form is plain, here it is compact"],
        ),
        (
            "compute city.obj -q --correction pixel --resolution 32 --split 2",
            &["with uncut triangles, and here it is with split 2"],
        ),
        (
            "compute other.obj -q --correction pixel --resolution 32",
            &["another scene", "`other.obj`"],
        ),
        (
            "compute city.obj -q --correction pixel --resolution 32 --engine depth",
            &["its version of the backend `cpu` is order-1, here it is depth-"],
        ),
    ] {
        let words = [words, &["`m` holds another matrix", "`--overwrite` replaces it"]].concat();
        place.line(&format!("{line} -o m")).is(2).says(&words);
        assert!(files(&place.path("m")) == before, "{line}");
    }
    // Settings that change no bit may change, and so may the name of the file.
    place
        .line(&format!("{COMPUTE} -o m --threads 1 --batch 3 --culling off"))
        .is(0);
    let line = COMPUTE.replace("city.obj", "renamed.obj").replace(" -q", "");
    place
        .line(&format!("{line} -o m"))
        .is(0)
        .says(&["nothing was computed"]);
    assert!(files(&place.path("m")) == before);
    place
        .line("compute city.obj -q --correction pixel --resolution 64 -o m --overwrite")
        .is(0);
    assert!(files(&place.path("m")) != before);
}

#[test]
fn two_writers_are_kept_apart() {
    let place = city(20_000);
    let slow = "compute city.obj -q --correction pixel --resolution 512 --threads 1";
    let child = place.spawn(place.command(&format!("{slow} -o m")));
    let first = place.path("m/parts/part-00000.npz");
    until("a part is written", || first.exists());
    let holder = format!("process {}", child.id());
    for second in ["", " --shard 1/2", " --overwrite"] {
        place
            .line(&format!("{slow} -o m{second}"))
            .is(2)
            .says(&["is being written by", &holder]);
    }
    place.line("merge m").is(2).says(&["is being written by", &holder]);
    // Who reads is not kept out.
    place.line("check m --allow-incomplete").is(0);
    signal(&child, "-KILL");
    finish(child);
    assert!(
        place.path("m/.lock.hemicube-tmp").exists(),
        "it was killed with the lock"
    );
    // A lock ends with who held it.
    let written = || {
        let parts = std::fs::read_dir(place.path("m/parts")).expect("a directory");
        // A part that is being written may be gone before it is read.
        let names = parts.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        names.filter(|name| !name.contains("tmp")).count()
    };
    let before = written();
    let child = place.spawn(place.command(&format!("{slow} -o m")));
    until("a further part is written", || written() > before);
    signal(&child, "-TERM");
    finish(child).is(130);
    assert!(!place.path("m/.lock.hemicube-tmp").exists());
}

type Damage<'a> = (&'a str, &'a dyn Fn(&Path));

#[test]
fn damaged_parts_are_told_and_computed_again() {
    let place = city(4_000);
    place.line(&format!("{COMPUTE} -o whole")).is(0);
    let damages: [Damage<'_>; 6] = [
        ("truncated", &|path| {
            let bytes = std::fs::read(path).expect("a file");
            std::fs::write(path, &bytes[..bytes.len() / 2]).expect("a file");
        }),
        ("empty", &|path| std::fs::write(path, "").expect("a file")),
        ("a bit", &|path| {
            let mut bytes = std::fs::read(path).expect("a file");
            let middle = bytes.len() / 2;
            bytes[middle] ^= 4;
            std::fs::write(path, bytes).expect("a file");
        }),
        ("the seal", &|path| {
            let mut bytes = std::fs::read(path).expect("a file");
            *bytes.last_mut().expect("a byte") ^= 1;
            std::fs::write(path, bytes).expect("a file");
        }),
        ("longer", &|path| {
            let mut bytes = std::fs::read(path).expect("a file");
            bytes.push(0);
            std::fs::write(path, bytes).expect("a file");
        }),
        ("gone", &|path| std::fs::remove_file(path).expect("it goes")),
    ];
    for (what, damage) in damages {
        for file in ["parts/part-00007.npz", "patches.npz"] {
            place.line(&format!("{COMPUTE} -o m")).is(0);
            damage(&place.path("m").join(file));
            assert_ne!(place.line("check m").code, Some(0), "{what} of {file}");
            let again = place.line(&format!("{} -o m", COMPUTE.replace(" -q", ""))).is(0);
            if file.contains("part-") && what != "gone" {
                again.says(&["part 7 is computed again", "part-00007.npz"]);
            }
            assert_same(&place.path("m"), &place.path("whole"));
        }
    }
    // A part of another matrix under the right name.
    place
        .line("compute city.obj -q --correction pixel --resolution 48 -o other")
        .is(0);
    std::fs::copy(
        place.path("other/parts/part-00002.npz"),
        place.path("m/parts/part-00002.npz"),
    )
    .expect("a copy");
    assert_ne!(place.line("check m").code, Some(0));
    place
        .line(&format!("{} -o m", COMPUTE.replace(" -q", "")))
        .is(0)
        .says(&["part 2 is computed again", "of another run"]);
    assert_same(&place.path("m"), &place.path("whole"));
    // A manifest that is damaged is written anew when the parts are of this run, and only then.
    let manifest = place.path("m/manifest.json");
    let doctored = std::fs::read_to_string(&manifest)
        .expect("text")
        .replace("\"entries\": ", "\"entries\": 1");
    std::fs::write(&manifest, &doctored).expect("a file");
    place.line("check m").is(2).says(&["has changed since it was written"]);
    place
        .line("compute city.obj -q --correction pixel --resolution 48 -o m")
        .is(2)
        .says(&["has changed since it was written", "`--overwrite`"]);
    place.line(&format!("{COMPUTE} -o m")).is(0);
    assert_same(&place.path("m"), &place.path("whole"));
}

#[test]
fn flipped_bits_are_harmless_or_detected() {
    let place = city(1_000);
    place.line(&format!("{COMPUTE} -o m")).is(0);
    place.line("check m").is(0);
    let whole = files(&place.path("m"));
    let bits: u64 = whole.values().map(|bytes| 8 * bytes.len() as u64).sum();
    let mut random = Random(5);
    let started = Instant::now();
    // By the library, as `check` does it: a thousand starts of the program would take half a minute.
    for _ in 0..1_000 {
        let mut bit = random.bits() % bits;
        let (name, bytes) = whole
            .iter()
            .find(|(_, bytes)| {
                let inside = bit < 8 * bytes.len() as u64;
                if !inside {
                    bit -= 8 * bytes.len() as u64;
                }
                inside
            })
            .expect("a bit of some file");
        let mut doctored = bytes.clone();
        doctored[usize::try_from(bit / 8).expect("a place")] ^= 1 << (bit % 8);
        std::fs::write(place.path("m").join(name), doctored).expect("a file");
        let detected = match hemicube::store::Store::open(&place.path("m")) {
            Err(_) => true,
            Ok(store) => hemicube::analysis::check::check(&store, &hemicube::analysis::check::CheckOptions::default())
                .map_or(true, |report| !report.ok),
        };
        assert!(detected, "bit {bit} of {name}");
        std::fs::write(place.path("m").join(name), bytes).expect("a file");
    }
    place.line("check m").is(0);
    eprintln!(
        "1,000 flipped bits detected in {:.1} s",
        started.elapsed().as_secs_f64()
    );
}

/// The library that puts faults between the program and the C library.
fn faults(place: &Place) -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/program/durability/fault.c");
    let library = place.path("fault.so");
    let built = Command::new("cc")
        .args(["-shared", "-fPIC", "-O1", "-o"])
        .arg(&library)
        .arg(source)
        .arg("-ldl")
        .output()
        .expect("cc, which links Rust, too, runs");
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    library
}

#[cfg(target_os = "linux")]
#[test]
fn a_disk_that_fails_loses_nothing() {
    let place = city(4_000);
    let library = faults(&place);
    place.line(&format!("{COMPUTE} -o whole")).is(0);
    // Manifest and patch table are written when a store is begun and when it ends.
    let cases = [
        ("parts/", 5),
        ("patches.npz", 0),
        ("patches.npz", 1),
        ("manifest", 0),
        ("manifest", 1),
        ("manifest", 2),
    ];
    for call in ["write", "fsync", "rename"] {
        for (name, after) in cases {
            let mut command = place.command(&format!("{COMPUTE} -o m"));
            command
                .env("LD_PRELOAD", &library)
                .env("FAULT_CALL", call)
                .env("FAULT_NAME", name)
                .env("FAULT_AFTER", after.to_string());
            let named = if name == "parts/" { "part-0000" } else { name };
            finish(place.spawn(command)).is(2).says(&["Input/output error", named]);
            if name == "parts/" {
                let kept = files(&place.path("m/parts"));
                assert!(!kept.is_empty() && kept.keys().all(|name| !name.contains("tmp")));
                place.line("check m --allow-incomplete").is(0);
            }
            place.line(&format!("{COMPUTE} -o m")).is(0);
            assert_same(&place.path("m"), &place.path("whole"));
            std::fs::remove_dir_all(place.path("m")).expect("the store goes");
        }
    }
    // A part that cannot be read is not thrown away for it.
    place.line(&format!("{COMPUTE} -o m")).is(0);
    let mut command = place.command(&format!("{COMPUTE} -o m"));
    command
        .env("LD_PRELOAD", &library)
        .env("FAULT_CALL", "open")
        .env("FAULT_NAME", "part-00003");
    finish(place.spawn(command))
        .is(2)
        .says(&["part-00003.npz` cannot be opened: Input/output error", "hint: "]);
    assert_same(&place.path("m"), &place.path("whole"));
}

#[cfg(target_os = "linux")]
#[test]
fn a_clock_that_jumps_changes_nothing() {
    let place = city(4_000);
    let library = faults(&place);
    place.line(&format!("{COMPUTE} -o whole")).is(0);
    for _ in 0..3 {
        let mut command = place.command(&format!("{COMPUTE} -o m --json --progress-file progress.json"));
        command.env("LD_PRELOAD", &library).env("FAULT_CLOCK", "1");
        let started = Instant::now();
        finish(place.spawn(command)).is(0);
        assert!(started.elapsed() < Duration::from_secs(60));
        assert_same(&place.path("m"), &place.path("whole"));
        std::fs::remove_dir_all(place.path("m")).expect("the store goes");
    }
}

#[test]
fn how_far_it_is_can_be_read_from_outside() {
    let place = city(8_000);
    let slow =
        "compute city.obj -q --correction pixel --resolution 512 --samples 4 --threads 1 --progress-file progress.json";
    let child = place.spawn(place.command(&format!("{slow} -o m")));
    let read = || {
        let text = std::fs::read_to_string(place.path("progress.json")).unwrap_or_default();
        if text.is_empty() {
            return serde_json::Value::Null;
        }
        serde_json::from_str::<serde_json::Value>(&text).expect("never half a file")
    };
    until("rows are computed", || {
        let reached = read();
        reached["stage"] == "rows" && reached["rows"].as_u64().is_some_and(|rows| rows > 0)
    });
    let reached = read();
    assert_eq!(reached["process"].as_u64(), Some(child.id().into()));
    assert_eq!(reached["row_count"], 8000);
    assert!(
        reached["seconds_left"].as_f64().is_some_and(|left| left > 0.0),
        "{reached}"
    );
    signal(&child, "-TERM");
    finish(child).is(130);
    assert_eq!(read()["stage"], "interrupted");
    let kept = read()["rows"].as_u64();
    place.line(&format!("{slow} -o m")).is(0);
    let reached = read();
    assert_eq!(
        (&reached["stage"], reached["rows"].as_u64()),
        (&"done".into(), Some(8000))
    );
    assert_eq!(reached["rows_kept"].as_u64(), kept);
    place
        .line("compute missing.obj -o n -q --progress-file progress.json")
        .is(2);
    assert_eq!(read()["stage"], "failed");
    place
        .line("compute city.obj -o m --progress-file no/such/place.json")
        .is(2)
        .says(&["place.json` cannot be written"]);
}

/// The built-in backend, which dies at some hemicube.
struct Dying {
    inner: Box<dyn HemicubeBackend>,
    left: Arc<AtomicI64>,
    panics: bool,
}

impl HemicubeBackend for Dying {
    fn info(&self) -> &BackendInfo {
        self.inner.info()
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.inner.load(geometry, settings)
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        Ok(Box::new(Self {
            inner: self.inner.fork()?,
            left: Arc::clone(&self.left),
            panics: self.panics,
        }))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let count = i64::try_from(hemicubes.len()).expect("a batch");
        if self.left.fetch_sub(count, Ordering::Relaxed) < count {
            assert!(!self.panics, "the driver fell over");
            return Err(BackendError::DeviceLost("it fell off the bus".to_owned()));
        }
        self.inner.rows(hemicubes, out)
    }
}

#[test]
fn a_backend_that_dies_takes_no_part_with_it() {
    let place = tempfile::tempdir().expect("a temporary directory");
    let scene = hemicube_scene::generate::cornell_box_open();
    let model = model(scene.clone(), Subdivision::Levels(3));
    let plan = plan(&model);
    let header = Header {
        program: "test".to_owned(),
        scene: SceneEntry {
            file: "room".to_owned(),
            blake3: scene_hash(&scene, model.patches()),
        },
        settings: serde_json::json!({ "resolution": 64 }),
        correction: "pixel".to_owned(),
        patch_count: model.geometry().patch_count,
        row_count: u32::try_from(plan.rows.len()).expect("few rows"),
        rows_per_part: plan.rows_per_part,
        form: plan.form,
        min_factor: 0.0,
        backend: BackendEntry {
            name: "cpu".to_owned(),
            version: "1".to_owned(),
        },
        objects: scene.objects.clone(),
        materials: scene.materials.iter().map(|material| material.name.clone()).collect(),
    };
    let table = PatchTable::new(&scene, model.patches());
    let run = |directory: &Path, backend: Box<dyn HemicubeBackend>, threads| {
        let (mut writer, kept) =
            StoreWriter::resume(directory, header.clone(), &table, None, 2, &mut |_| {}).expect("a store");
        let missing = writer.missing_parts();
        let plan = plan.clone().with_parts(|part| missing.contains(&part));
        let execution = Execution {
            threads,
            batch: 8,
            cancel: None,
        };
        let ended = compute(
            &model,
            &plan,
            settings(64),
            backend,
            execution,
            &mut writer,
            &mut |_| {},
        );
        if ended.is_ok() {
            writer.finish().expect("all parts are there");
        }
        (kept, ended)
    };
    let whole = place.path().join("whole");
    run(&whole, Box::new(CpuBackend::new()), 2).1.expect("a sound run");
    for panics in [false, true] {
        let directory = place.path().join(format!("{panics}"));
        let mut kept_before = 0;
        for left in [300, 250, 1] {
            let dying = Dying {
                inner: Box::new(CpuBackend::new()),
                left: Arc::new(AtomicI64::new(left)),
                panics,
            };
            let (kept, ended) = run(&directory, Box::new(dying), 2);
            assert!(kept.parts >= kept_before && kept.not_kept.is_empty());
            kept_before = kept.parts;
            match ended.expect_err("it died") {
                ComputeError::Backend { source, .. } => assert!(!panics && source.to_string().contains("the bus")),
                ComputeError::Panic { message } => assert!(panics && message.contains("fell over")),
                other => panic!("{other}"),
            }
        }
        assert!(kept_before >= 4, "{kept_before} parts");
        run(&directory, Box::new(CpuBackend::new()), 1).1.expect("a sound run");
        assert_same(&directory, &whole);
    }
}

/// A disk of its own, unmounted when dropped.
#[cfg(target_os = "linux")]
struct Mounted(PathBuf);

#[cfg(target_os = "linux")]
impl Drop for Mounted {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_foretold_and_a_run_goes_on_when_there_is_room() {
    let place = city(8_000);
    place.line(&format!("{COMPUTE} -o whole")).is(0);
    let disk = place.path("disk");
    std::fs::create_dir(&disk).expect("a directory");
    let resize = |size: &str| {
        let how = if size.starts_with("remount") {
            size.to_owned()
        } else {
            format!("size={size}")
        };
        let mount = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &how, "tmpfs"])
            .arg(&disk)
            .output();
        mount.is_ok_and(|output| output.status.success())
    };
    if !resize("2m") {
        eprintln!("SKIP a full disk: this user cannot mount a small one; `a_file_that_cannot_grow` stands for it");
        return;
    }
    let _mounted = Mounted(disk.clone());
    let said = COMPUTE.replace(" -q", "");
    place.line(&format!("{said} -o disk/m")).is(2).says(&[
        "warning: 8,000 rows will take about",
        "disk is full",
        "parts are kept",
        "goes on there",
    ]);
    let kept = files(&disk.join("m/parts")).len();
    assert!(kept > 3, "{kept}");
    place
        .line(&format!("{said} -o disk/m"))
        .is(2)
        .says(&["going on with `disk/m`", "disk is full"]);
    assert!(resize("remount,size=64m"), "the disk becomes larger");
    place.line(&format!("{COMPUTE} -o disk/m")).is(0);
    assert_same(&disk.join("m"), &place.path("whole"));
}

#[test]
fn memory_is_kept_within_what_is_given() {
    let place = city(8_000);
    place.line(&format!("{COMPUTE} -o whole")).is(0);
    let said = COMPUTE.replace(" -q", "");
    place
        .line(&format!("{said} -o m --memory 2M"))
        .is(2)
        .says(&["of the 2.0 MB allowed are left", "hint: "]);
    let report = place
        .line(&format!("{said} -o m --memory 64M --threads 64 --json -v"))
        .is(0);
    assert!(report.err.contains(" of 64, to keep within 64"), "{}", report.err);
    let peak = report.json()["peak_memory_bytes"].as_u64().expect("a number");
    assert!(peak < 64_000_000, "{peak}");
    assert_same(&place.path("m"), &place.path("whole"));
    place
        .line(&format!("{said} -o m --memory lots"))
        .is(2)
        .says(&["`800M`"]);
}
