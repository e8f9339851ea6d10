//! Backends loaded at run time: the smallest ones in Rust and in C do what the built-in one does, alone and side by
//! side.

use hemicube::Model;
use hemicube::backend::{BackendInfo, Counters, HemicubeBackend, RenderSettings};
use hemicube::delta::DeltaTable;
use hemicube::row::RowBlock;
use hemicube_backend_cpu::{CpuBackend, EngineChoice};
use hemicube_conformance::scenes::TestScene;
use hemicube_conformance::{Outcome, cases, run as run_case};
use hemicube_host::{Environment, Options, Registry, Search};
use hemicube_scene::Subdivision;
use hemicube_scene::generate::Kind;
use hemicube_tests::devices::unoccluded;
use hemicube_tests::plugins::{c, c_minimal, rust, session};
use hemicube_tests::rows::{hemicubes, render_with, settings, spread};
use hemicube_tests::runs::{command_in, with_words};
use hemicube_tests::scenes::{generated, model, program, say, workspace};
use std::path::Path;
use std::process::{Command, Output};

const RESOLUTION: u32 = 16;

/// A closed room: what a row should be is known.
fn room() -> Model {
    model(hemicube_scene::generate::cornell_box(), Subdivision::Levels(1))
}

fn rows_of(backend: &mut dyn HemicubeBackend, model: &Model) -> (RowBlock, Counters) {
    let all = hemicubes(model, &spread(model, 12));
    let mut rows = RowBlock::default();
    let counters = backend.rows(&all, &mut rows).expect("legal hemicubes");
    rows.check(all.len(), model.geometry().patch_count, false)
        .expect("rows that keep the contract");
    (rows, counters)
}

fn loaded(mut backend: impl HemicubeBackend + 'static, model: &Model) -> Box<dyn HemicubeBackend> {
    backend
        .load(model.geometry(), settings(RESOLUTION))
        .expect("a small scene");
    Box::new(backend)
}

#[test]
fn the_smallest_backends_render_as_the_built_in_one() {
    let (_place, c) = c_minimal();
    let (room, city) = (room(), generated(Kind::City, 400));
    for model in [&room, &city] {
        let reference = rows_of(loaded(CpuBackend::new(), model).as_mut(), model).0;
        for path in [&rust("rust-minimal"), &c] {
            let mut plugin = loaded(session(path, &[]), model);
            let (rows, counters) = rows_of(plugin.as_mut(), model);
            assert_eq!(counters.hemicubes, rows.len() as u64);
            // Rays in f64 against edges in f32 of the built-in one: a pixel centre on an edge falls to either side.
            let different = distance(&rows, &reference, model.geometry().patch_count);
            assert!(different < 0.02, "{}: {different}", path.display());
            // And the reduction is exact.
            let hemicube = hemicubes(model, &spread(model, 12))[5];
            let items = plugin.items(&hemicube).expect("item buffers are claimed");
            let (entries, escaped, blocked) = items.reduce(&DeltaTable::new(RESOLUTION));
            let row = rows.row(5);
            let found: Vec<_> = row.patches.iter().zip(row.visible).map(|(&p, &w)| (p, w)).collect();
            assert_eq!(found, entries.iter().map(|&(p, w)| (p.0, w)).collect::<Vec<_>>());
            assert_eq!((row.escaped, row.blocked), (escaped, blocked));
        }
    }
}

/// The largest L1 distance of two rows, as a share of a hemicube.
fn distance(found: &RowBlock, wanted: &RowBlock, patch_count: u32) -> f64 {
    let dense = |rows: &RowBlock, row: usize| {
        let row = rows.row(row);
        let mut dense = vec![0u32; patch_count as usize + 2];
        for (&patch, &weight) in row.patches.iter().zip(row.visible) {
            dense[patch as usize] = weight;
        }
        (dense[patch_count as usize], dense[patch_count as usize + 1]) = (row.escaped, row.blocked);
        dense
    };
    let of_row = |row| {
        let (a, b) = (dense(found, row), dense(wanted, row));
        a.iter().zip(&b).map(|(&a, &b)| f64::from(a.abs_diff(b))).sum::<f64>() / f64::from(hemicube::backend::WHOLE)
    };
    (0..found.len()).map(of_row).fold(0.0, f64::max)
}

/// The block of that language on the page about plugins.
fn block(language: &str) -> String {
    let page = std::fs::read_to_string(workspace().join("docs/plugins.md")).expect("the page on plugins");
    let mut blocks = page.split("\n```").filter_map(|block| block.split_once('\n'));
    let is_wanted = |words: &str| words.split(',').next() == Some(language);
    let (_, code) = blocks.find(|(words, _)| is_wanted(words)).expect("a block");
    format!("{code}\n")
}

#[test]
fn the_page_s_backend_in_c_compiles_and_sees_nothing() {
    let place = tempfile::tempdir().expect("a temporary directory");
    let source = place.path().join("blind.c");
    std::fs::write(&source, block("c")).expect("a source");
    let path = c(source.to_str().expect("a path in UTF-8"), place.path(), "blind", &[]);
    let room = room();
    let (rows, _) = rows_of(loaded(session(&path, &[]), &room).as_mut(), &room);
    assert!(rows.patches.is_empty() && rows.escaped.iter().all(|&weight| weight == hemicube::backend::WHOLE));
    // Neither is longer than it is said to be, by much.
    for language in ["c", "rust"] {
        let lines = block(language)
            .lines()
            .filter(|line| !line.is_empty() && !line.starts_with("# "))
            .count();
        assert!(lines <= 36, "{language}: {lines}");
    }
}

#[test]
fn a_fork_renders_the_same() {
    let (_place, c) = c_minimal();
    let room = room();
    for path in [&rust("rust-minimal"), &c] {
        let mut plugin = loaded(session(path, &[]), &room);
        let mut fork = plugin.fork().expect("another session");
        assert_eq!(rows_of(plugin.as_mut(), &room), rows_of(fork.as_mut(), &room));
    }
}

/// Opens a session with a scene loaded.
type Open<'a> = dyn Fn(&Model) -> Box<dyn HemicubeBackend> + Sync + 'a;

#[test]
fn alternately_and_from_two_threads_the_rows_are_those_of_each_alone() {
    let (_place, c) = c_minimal();
    let (room, city) = (room(), generated(Kind::City, 200));
    let open: [&Open<'_>; 3] = [
        &|model| loaded(CpuBackend::new(), model),
        &|model| loaded(session(&rust("rust-minimal"), &[]), model),
        &|model| loaded(session(&c, &[]), model),
    ];
    let alone: Vec<_> = open
        .iter()
        .flat_map(|open| [&room, &city].map(|model| rows_of(open(model).as_mut(), model)))
        .collect();

    // All of them open at once, a row of each in turn.
    let mut sessions: Vec<_> = open
        .iter()
        .flat_map(|open| [&room, &city].map(|model| (open(model), model, RowBlock::default())))
        .collect();
    for k in 0..12 {
        for (session, model, rows) in &mut sessions {
            let one = hemicubes(model, &spread(model, 12))[k];
            session.rows(&[one], rows).expect("a legal hemicube");
        }
    }
    for ((_, _, rows), (wanted, _)) in sessions.iter().zip(&alone) {
        assert_eq!(rows, wanted);
    }

    // Two threads, each with sessions of its own, in opposite order; and sessions that move from one to the other.
    std::thread::scope(|scope| {
        let run = |backwards: bool| {
            let mut all: Vec<_> = (0..6).collect();
            if backwards {
                all.reverse();
            }
            for k in all {
                let model = [&room, &city][k % 2];
                assert_eq!(rows_of(open[k / 2](model).as_mut(), model), alone[k]);
            }
        };
        let threads = [scope.spawn(move || run(false)), scope.spawn(move || run(true))];
        threads.into_iter().for_each(|thread| thread.join().expect("no panic"));
    });
    std::thread::scope(|scope| {
        for ((mut session, model, _), wanted) in sessions.into_iter().zip(&alone) {
            scope.spawn(move || assert_eq!(&rows_of(session.as_mut(), model), wanted));
        }
    });
}

#[test]
fn the_table_changes_no_bit() {
    for (scene, engine) in [
        (TestScene::City, "auto"),
        (TestScene::Plates, "depth"),
        (TestScene::Room, "order"),
    ] {
        let model = scene.model();
        let all = scene.hemicubes(&model);
        let choice = match engine {
            "depth" => EngineChoice::Depth,
            "order" => EngineChoice::Order,
            _ => EngineChoice::Auto,
        };
        let mut direct = CpuBackend::new().with_engine(choice);
        let mut wrapped = session(&rust("wrapped-cpu"), &[&format!("engine={engine}")]);
        for covered in [true, false] {
            let settings = RenderSettings {
                covered,
                ..settings(64)
            };
            let mut found = [RowBlock::default(), RowBlock::default()];
            let mut counted = [Counters::default(); 2];
            let both: [&mut dyn HemicubeBackend; 2] = [&mut direct, &mut wrapped];
            for (k, backend) in both.into_iter().enumerate() {
                backend.load(model.geometry(), settings).expect("a small scene");
                for some in all.chunks(7) {
                    counted[k] += backend.rows(some, &mut found[k]).expect("legal hemicubes");
                }
            }
            let [direct, wrapped] = &found;
            assert!(direct == wrapped && !direct.patches.is_empty(), "{scene:?}");
            assert_eq!(counted[0], counted[1]);
        }
        assert_eq!(
            direct.items(&all[3]).expect("items"),
            wrapped.items(&all[3]).expect("items")
        );
        // Decisions of the loaded scene come through: the arithmetic's version, and why.
        let (direct, name) = (direct.info().clone(), "wrapped-cpu".to_owned());
        assert_eq!(&BackendInfo { name, ..direct }, wrapped.info());
        assert!(wrapped.choices()[0].starts_with("engine "), "{:?}", wrapped.choices());
    }
}

#[test]
fn the_suite_holds_through_the_table() {
    for case in cases() {
        let outcome = run_case(case, &mut session(&rust("wrapped-cpu"), &[]), &mut CpuBackend::new());
        match outcome {
            Outcome::Held(_) => {}
            Outcome::NotClaimed(what) => assert!(
                ["read back", "portals", "rays"].iter().any(|of| what.contains(of)),
                "{case}: {what} is claimed"
            ),
            Outcome::Broken(wrong) => panic!("{case}: {wrong}"),
        }
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_plugin_in_rust_exports_its_table_and_nothing_else() {
    let mut nm = Command::new("nm");
    nm.args(["-D", "--defined-only", "--format=just-symbols"])
        .arg(rust("rust-minimal"));
    let output = nm.output().expect("`nm` runs; install binutils");
    assert_eq!(text(&output.stdout), "hemicube_backend\n");
}

/// Rows with covered weights by a session of that plugin.
fn covered_rows(path: &Path, model: &Model) -> RowBlock {
    let mut plugin = session(path, &[]);
    let covered = RenderSettings {
        covered: true,
        ..settings(64)
    };
    plugin.load(model.geometry(), covered).expect("a small scene");
    let said = plugin.choices().iter().any(|choice| choice.contains("covered weights"));
    assert!(said, "{:?}", plugin.choices());
    let mut rows = RowBlock::default();
    let all = hemicubes(model, &spread(model, 12));
    plugin.rows(&all, &mut rows).expect("legal hemicubes");
    rows.check(all.len(), model.geometry().patch_count, true)
        .expect("legal rows");
    rows
}

#[test]
fn what_a_plugin_does_not_count_the_host_counts() {
    let (_place, c) = c_minimal();
    for path in [&rust("rust-minimal"), &c] {
        for (name, model) in unoccluded() {
            let rows = covered_rows(path, &model);
            assert!(!rows.patches.is_empty());
            assert_eq!(rows.visible, rows.covered, "{name}: all that is covered is seen");
        }
        // Where something is hidden: what the built-in backend counts, but for pixels at edges.
        let city = generated(Kind::City, 400);
        let rows = covered_rows(path, &city);
        let mut built_in = CpuBackend::new();
        let covered = RenderSettings {
            covered: true,
            ..settings(64)
        };
        let wanted = render_with(&mut built_in, &city, &hemicubes(&city, &spread(&city, 12)), covered).0;
        let (mut apart, mut whole, mut hidden) = (0, 0, 0);
        for row in 0..rows.len() {
            let (found, wanted) = (rows.row(row), wanted.row(row));
            let mut others = wanted.patches.iter().zip(wanted.covered).peekable();
            for (k, &patch) in found.patches.iter().enumerate() {
                while others.next_if(|(other, _)| **other < patch).is_some() {}
                let Some((_, &other)) = others.next_if(|(other, _)| **other == patch) else {
                    continue;
                };
                apart += u64::from(found.covered[k].abs_diff(other));
                whole += u64::from(other);
                hidden += u32::from(found.visible[k] < found.covered[k]);
            }
        }
        let apart = apart as f64 / whole as f64;
        say(&format!(
            "{}: {hidden} entries partly hidden, covered weights {apart:.4} apart",
            path.display()
        ));
        assert!(hidden > 20, "{hidden} entries are partly hidden");
        assert!(apart < 0.02, "{}: {apart}", path.display());
    }
}

/// The program, without settings of the user or the environment, in a folder.
fn run(folder: &Path, program: &Path, line: &str) -> Output {
    let mut command = command_in(program, folder);
    command.env("HOME", folder);
    with_words(&mut command, line).output().expect("the program runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn the_program_computes_the_same_store_with_a_plugin_whatever_the_threads_and_batches() {
    let place = tempfile::tempdir().expect("a temporary directory");
    let here = |line: &str| run(place.path(), &program(), line);
    for (name, patches) in [("room", 160), ("small", 40)] {
        let line = format!("generate room --patches {patches} -o {name}.obj");
        assert!(here(&line).status.success());
    }
    let plugin = rust("rust-minimal");
    let compute = |out: &str, how: &str| {
        let plugin = plugin.display();
        let line = format!("compute room.obj -o {out} --backend {plugin} --correction pixel --resolution 16 {how}");
        let output = here(&line);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let part = std::fs::read(place.path().join(out).join("parts/part-00001.npz")).expect("a part");
        (text(&output.stderr), part)
    };
    let (said, one) = compute("one", "--threads 1 --batch 1 --culling off -v");
    assert!(
        said.contains("backend rust-minimal 1 (one processor core), 1 thread"),
        "{said}"
    );
    assert!(one == compute("two", "--threads 2 --batch 7 --culling on").1);
    assert!(here("check one").status.success());
    let manifest = std::fs::read_to_string(place.path().join("one/manifest.json")).expect("a manifest");
    assert!(manifest.contains("\"name\": \"rust-minimal\""), "{manifest}");

    // Corrected, it is as accurate as the built-in backend: the host counts what it does not.
    let error = |backend: &str| {
        let line = format!("compute small.obj -o area --overwrite --backend {backend} --verify 8 --json");
        let output = here(&line);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("a report");
        report["verification"]["measured"]["relative_frobenius"]
            .as_f64()
            .expect("an error")
    };
    let (over_plugin, built_in) = (error(&plugin.to_string_lossy()), error("cpu"));
    say(&format!(
        "area correction: {over_plugin:.4} over a plugin without covered weights, {built_in:.4} over cpu"
    ));
    assert!(
        over_plugin <= 1.1 * built_in + 1e-3,
        "{over_plugin}, built in {built_in}"
    );

    // An option of another backend, and one of none.
    for (how, words) in [
        (
            "--correction pixel --engine depth",
            &["`--engine` is a setting of backend `cpu`"][..],
        ),
        (
            "--correction pixel --backend-option speed=11",
            &["there is no option `speed`"],
        ),
        ("--correction pixel --backend-option speed", &["`key=value`"]),
        (
            "--correction pixel --backend-option device=2",
            &["no device `2`; it has 0 `one processor core`"],
        ),
    ] {
        let output = here(&format!("compute room.obj -o no --backend {} {how}", plugin.display()));
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
        assert!(!place.path().join("no").exists());
    }
    let output = here("compute room.obj -o no --backend cpu --backend-option device=0");
    assert!(text(&output.stderr).contains("backend `cpu` has no options"));
}

#[test]
fn auto_takes_a_gpu_where_it_pays_and_says_why_it_takes_nothing_else() {
    let place = tempfile::tempdir().expect("a temporary directory");
    let here = |line: &str| run(place.path(), &program(), line);
    let vulkan = "FAULT_NAME=\"vulkan\"";
    for (folder, name, macros) in [
        ("software", "vulkan", &[vulkan][..]),
        ("gpu", "gl", &["FAULT_NAME=\"gl\"", "A_GPU", "FAULT_DEVICES=a_gpu"]),
        ("gpu", "vulkan", &[vulkan, "NO_DRIVER", "FAULT_DEVICES=no_driver"]),
    ] {
        let folder = place.path().join(folder);
        std::fs::create_dir_all(&folder).expect("a folder");
        c("faulty/table.c", &folder, name, macros);
    }
    let auto = |folder: &str, threads| {
        let search = Search::new(&[place.path().join(folder)], &Environment::default());
        Registry::new(search, &["cpu"]).auto(&Options::default(), threads)
    };
    let found = auto("gpu", 5);
    assert_eq!(found.taken.expect("a GPU").library().name(), "gl");
    let reasons: Vec<String> = found
        .passed_over
        .iter()
        .map(|p| format!("{}: {}", p.name, p.reason))
        .collect();
    assert_eq!(reasons, ["vulkan: no driver is installed", "wgpu: not installed"]);
    let found = auto("gpu", 6);
    assert!(found.taken.is_none());
    let said = "6 threads of the processor draw more than a GPU";
    assert!(
        found
            .passed_over
            .iter()
            .any(|other| other.name == "gl" && other.reason == said)
    );
    let found = auto("software", 1);
    assert!(found.taken.is_none());
    assert_eq!(
        found.passed_over[0].reason,
        "`one processor core` runs on the processor"
    );

    assert!(here("generate room --patches 40 -o room.obj").status.success());
    let said = text(&here("HEMICUBE_BACKEND_PATH=software compute room.obj -o a").stderr);
    let wanted = "backend auto takes `cpu`; vulkan: `one processor core` runs on the processor; wgpu: not installed; gl: not installed";
    assert!(said.contains(wanted), "{said}");
    let said = text(&here("compute room.obj -o b").stderr);
    assert!(!said.contains("backend auto"), "{said}");
    let said = text(&here("compute room.obj -o c -v").stderr);
    assert!(
        said.contains("backend auto takes `cpu`; vulkan: not installed"),
        "{said}"
    );
    // Named, it is used although it runs on the processor; and what fails is not replaced.
    let said = text(
        &here(
            "HEMICUBE_BACKEND_PATH=software compute room.obj -o d --backend vulkan --correction pixel --resolution 16 -v",
        )
        .stderr,
    );
    assert!(said.contains("backend vulkan 1 (one processor core)"), "{said}");
    let output = here("HEMICUBE_BACKEND_PATH=gpu compute room.obj -o e --backend vulkan --correction pixel");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).starts_with("error: backend `vulkan`: no driver is installed"));
}

/// With the set-user-id bit, whoever starts the program must not choose what is loaded into it.
#[test]
#[cfg(unix)]
fn with_raised_privileges_nothing_is_loaded_from_where_the_user_chooses() {
    use std::os::unix::fs::PermissionsExt;
    let place = tempfile::tempdir().expect("a temporary directory");
    let raised = place.path().join("hemicube");
    std::fs::copy(program(), &raised).expect("a copy of the program");
    std::fs::set_permissions(place.path(), std::fs::Permissions::from_mode(0o755)).expect("its own folder");
    // Another user, so that the effective one differs; only root can do that.
    let chown = Command::new("chown")
        .arg("65534")
        .arg(&raised)
        .output()
        .expect("`chown` runs");
    if !chown.status.success() {
        say("SKIP with_raised_privileges: only root can make a set-user-id program of another user");
        return;
    }
    std::fs::set_permissions(&raised, std::fs::Permissions::from_mode(0o4755)).expect("its own file");
    let plugin = c("c_minimal/backend.c", place.path(), "c-minimal", &[]);
    let folders = |program: &Path| {
        let output = run(place.path(), program, "HEMICUBE_BACKEND_PATH=. backends list --json");
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        report["folders"].to_string()
    };
    assert!(folders(&program()).contains("HEMICUBE_BACKEND_PATH"));
    let of_raised = folders(&raised);
    if of_raised.contains("HEMICUBE_BACKEND_PATH") {
        // A file system that is mounted without set-user-id.
        say("SKIP with_raised_privileges: the bit has no effect in the folder of temporary files");
        return;
    }
    assert!(
        !of_raised.contains("user") && of_raised.contains("system"),
        "{of_raised}"
    );
    let line = format!("compute x.obj -o m --backend {}", plugin.display());
    let said = text(&run(place.path(), &raised, &line).stderr);
    assert!(said.contains("with raised privileges"), "{said}");
}

#[test]
fn backends_check_tells_held_from_not_claimed_from_broken() {
    let place = tempfile::tempdir().expect("a temporary directory");
    let here = |line: &str| run(place.path(), &program(), line);
    let check = |plugin: &Path, only: &str| {
        let output = here(&format!("backends check {} --only {only} --json", plugin.display()));
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        (output.status.code(), report)
    };
    let outcome = |report: &serde_json::Value, case: &str| {
        let cases = report["cases"].as_array().expect("cases");
        let found = cases.iter().find(|found| found["case"] == case).expect("the case");
        found["outcome"].as_str().expect("an outcome").to_owned()
    };
    // The smallest backend keeps its claims.
    for (case, wanted) in [
        ("empty-room/reduction", "held"),
        ("empty-room/culling", "held"),
        ("empty-room/unoccluded", "not_claimed"),
    ] {
        let (code, report) = check(&rust("rust-minimal"), case);
        assert_eq!((code, outcome(&report, case).as_str()), (Some(0), wanted), "{report}");
        assert_eq!(report["backend"]["name"], "rust-minimal");
        assert_eq!(report["broken"], 0);
    }
    // One that sees nothing keeps the contract, and is far from the reference.
    let (code, report) = check(&rust("faulty"), "room/*");
    assert_eq!(code, Some(1), "{report}");
    assert_eq!(outcome(&report, "room/contract"), "held");
    assert_eq!(outcome(&report, "room/reference"), "broken");
    // The built-in one is a backend like any other.
    let output = here("backends check cpu --only room/*");
    assert_eq!(output.status.code(), Some(0));
    let said = text(&output.stdout);
    assert!(
        said.starts_with("backend cpu ") && said.contains("held         room/reduction"),
        "{said}"
    );
    assert!(said.contains("not claimed  room/bytes"), "{said}");
    for (line, word) in [
        ("backends check nowhere", "no backend named `nowhere`"),
        ("backends check cpu --only nothing", "no case matches `nothing`"),
        ("backends check ./x.so", "backend `./x.so`: no such file"),
    ] {
        let output = here(line);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(word) && said.contains("hint: "), "{said}");
    }
}
