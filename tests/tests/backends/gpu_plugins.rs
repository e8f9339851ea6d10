//! The plugins for GPUs as the program loads them, on whatever device there is: the conformance suite, the corrections
//! over them, and all of them at once in one process.
//!
//! `./test --full` also runs the public cases at a tolerance over each of them (`HEMICUBE_TEST_BACKEND`).

use assert_cmd::Command;
use glam::DVec3;
use hemicube::Model;
use hemicube::backend::{BackendError, HemicubeBackend};
use hemicube::close::is_close;
use hemicube::row::RowBlock;
use hemicube_backend_cpu::CpuBackend;
use hemicube_host::DeviceKind;
use hemicube_scene::generate::Kind;
use hemicube_scene::{InputPatch, Scene, Subdivision, Triangle};
use hemicube_tests::devices::{EXACT_EDGES, is_there};
use hemicube_tests::plugins::{rust, try_session};
use hemicube_tests::random::Random;
use hemicube_tests::rows::{hemicubes, render_with, settings, spread};
use hemicube_tests::scenes::{generated, model, program, read, say, scenes_or_skip};
use serde_json::Value;
use std::path::Path;

const NAMES: [&str; 3] = ["gl", "vulkan", "wgpu"];

/// Tells if the plugin has a device to run on; otherwise says a skip, or fails where the device is required.
fn has_device(name: &str) -> bool {
    let opened = try_session(&rust(name), &[]);
    let opened = opened.map(|session| Box::new(session) as Box<dyn HemicubeBackend>);
    is_there(
        name,
        &opened.map_err(|error| BackendError::Unsupported(error.to_string())),
    )
}

fn folder() -> String {
    let plugin = rust("gl");
    plugin
        .parent()
        .and_then(Path::to_str)
        .expect("a folder in UTF-8")
        .to_owned()
}

/// Cases that the backend does not claim.
fn keeps_the_conformance_suite(name: &str, options: &[&str]) -> Vec<String> {
    if !has_device(name) {
        return Vec::new();
    }
    let output = Command::new(program())
        .args(["backends", "check", name])
        .args(options)
        .env("HEMICUBE_BACKEND_PATH", folder())
        .output()
        .expect("the program starts");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success(),
        "{text}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let lines = text.lines().filter(|line| line.starts_with("not claimed"));
    lines.map(str::to_owned).collect()
}

/// Claims every case of two scenes, between them all checks but one (`rows.rs` of each backend has that), and keeps it.
/// So it does the rays of every scene, which are not for OpenGL.
fn keeps_the_conformance_suite_of_two_scenes(name: &str) {
    for cases in ["room/*", "towers/*", "*/rays"] {
        let mut unclaimed = keeps_the_conformance_suite(name, &["--only", cases]);
        unclaimed.retain(|line| name != "gl" || !line.contains("/rays"));
        assert!(unclaimed.is_empty(), "{name} is to claim all: {unclaimed:?}");
    }
}

#[test]
fn gl_keeps_the_conformance_suite_of_two_scenes() {
    keeps_the_conformance_suite_of_two_scenes("gl");
}

#[test]
fn vulkan_keeps_the_conformance_suite_of_two_scenes() {
    keeps_the_conformance_suite_of_two_scenes("vulkan");
}

#[test]
fn wgpu_keeps_the_conformance_suite_of_two_scenes() {
    keeps_the_conformance_suite_of_two_scenes("wgpu");
}

#[test]
#[ignore = "73 cases of a process each, over drivers that render on the processor: ./test --full"]
fn each_keeps_all_of_the_conformance_suite() {
    for name in NAMES {
        let mut unclaimed = keeps_the_conformance_suite(name, &[]);
        unclaimed.retain(|line| name != "gl" || !line.contains("/rays"));
        assert!(unclaimed.is_empty(), "{name} is to claim all: {unclaimed:?}");
    }
}

/// Tiles count no triangles, so that what is culled is not claimed.
#[test]
#[ignore = "tiles are several times as dear on a driver that renders on the processor: ./test --full"]
fn each_keeps_the_conformance_suite_drawing_by_compute() {
    for name in NAMES {
        let mut unclaimed = keeps_the_conformance_suite(name, &["--backend-option", "draw=compute"]);
        unclaimed.retain(|line| name != "gl" || !line.contains("/rays"));
        assert!(
            unclaimed.iter().all(|line| line.contains("culls")),
            "{name}: {unclaimed:?}"
        );
    }
}

/// The share of the pixels that differ from the built-in backend's, by the suite's own words, of each scene.
fn shares_of_pixels(text: &str) -> Vec<(String, f64)> {
    let of_line = |line: &str| {
        let (before, _) = line.split_once(" of the pixels differ")?;
        let scene = line.split('/').next()?.split_whitespace().last()?;
        Some((scene.to_owned(), before.split_whitespace().last()?.parse().ok()?))
    };
    text.lines().filter_map(of_line).collect()
}

/// With `edges=exact`, no more than 1 in 10,000 pixels of any scene of the suite differs.
fn has_exact_edges(name: &str) {
    if !has_device(name) {
        return;
    }
    let output = Command::new(program())
        .args(["backends", "check", name])
        .env("HEMICUBE_BACKEND_PATH", folder())
        .args(["--backend-option", "edges=exact", "--only", "*/reference"])
        .output()
        .expect("the program starts");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success(),
        "{text}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(text.contains("gpu-4-exact"), "it is told from the driver's: {text}");
    let shares = shares_of_pixels(&text);
    assert_eq!(shares.len(), 9, "a share of each scene: {text}");
    say(&format!("{name}, exact edges: {shares:?}"));
    for (scene, share) in shares {
        assert!(
            share <= EXACT_EDGES.pixels,
            "{name}, {scene}: {share} of the pixels differ"
        );
    }
}

#[test]
#[ignore = "shaders that vulkan's are made of, too: ./test --full"]
fn gl_has_exact_edges_on_the_conformance_scenes() {
    has_exact_edges("gl");
}

#[test]
fn vulkan_has_exact_edges_on_the_conformance_scenes() {
    has_exact_edges("vulkan");
}

#[test]
#[ignore = "shaders that vulkan's are made of, too: ./test --full"]
fn wgpu_has_exact_edges_on_the_conformance_scenes() {
    has_exact_edges("wgpu");
}

/// The measured error of a run over a backend, by rays.
fn measured(place: &Path, scene: &str, backend: &str, how: &[&str]) -> f64 {
    let output = Command::new(program())
        .current_dir(place)
        .args(["compute", scene, "-o", "F", "--overwrite", "--backend", backend])
        .env("HEMICUBE_BACKEND_PATH", folder())
        // A few pairs that the centroid sees and hardly any other point does make up most of the error: 48 rows cannot
        // tell.
        .args(["--verify", "192", "--json"])
        .args(how)
        .output()
        .expect("the program starts");
    assert!(
        output.status.success(),
        "{backend}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    let report: Value = serde_json::from_slice(&output.stdout).expect("a report");
    assert_eq!(report["backend"]["name"], backend);
    let error = &report["verification"]["measured"]["relative_frobenius"];
    error
        .as_f64()
        .unwrap_or_else(|| panic!("no error in {}", report["verification"]))
}

/// Measures errors over each backend, of scenes of so many patches.
fn corrections_are_as_accurate(scenes: &[(&str, &str)], patches: &str) {
    let place = tempfile::tempdir().expect("a temporary directory");
    for &(scene, kind) in scenes {
        let generated = Command::new(program())
            .current_dir(place.path())
            .args(["generate", kind, "--output", scene, "--patches", patches])
            .output()
            .expect("the program starts");
        assert!(
            generated.status.success(),
            "{}",
            String::from_utf8_lossy(&generated.stderr)
        );
        let area = measured(place.path(), scene, "cpu", &[]);
        let at_a_hundredth = measured(place.path(), scene, "cpu", &["--tolerance", "1%"]);
        for name in NAMES.into_iter().filter(|name| has_device(name)) {
            let over = measured(place.path(), scene, name, &[]);
            say(&format!("{scene}: area over {name} {over:.4}, over cpu {area:.4}"));
            assert!(over <= 1.05 * area, "{scene} over {name}: {over}, over cpu {area}");
            let over = measured(place.path(), scene, name, &["--tolerance", "1%"]);
            say(&format!(
                "{scene}: 1 % over {name} {over:.4}, over cpu {at_a_hundredth:.4}"
            ));
            assert!(over <= 0.01, "{scene} over {name}: {over} at a tolerance of 1 %");
        }
    }
}

#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn corrections_over_each_are_as_accurate_as_over_the_built_in_backend() {
    corrections_are_as_accurate(&[("city.obj", "city")], "800");
}

#[test]
#[ignore = "three minutes on drivers that render on the processor: ./test --full"]
fn corrections_over_each_are_as_accurate_in_larger_cities() {
    corrections_are_as_accurate(&[("blocks.obj", "block-city"), ("city.obj", "city")], "2000");
}

fn rows_of(backend: &mut dyn HemicubeBackend, model: &Model) -> RowBlock {
    let all = hemicubes(model, &spread(model, 24));
    let mut rows = RowBlock::default();
    for few in all.chunks(5) {
        backend.rows(few, &mut rows).expect("legal hemicubes");
    }
    rows
}

#[test]
fn together_in_one_process_their_rows_are_those_of_each_alone() {
    let mut names: Vec<&str> = NAMES.into_iter().filter(|name| has_device(name)).collect();
    names.push("cpu");
    let scenes = [generated(Kind::Room, 1000), generated(Kind::City, 3000)];
    let open = |name: &str, model: &Model| -> Box<dyn HemicubeBackend> {
        let mut session: Box<dyn HemicubeBackend> = match name {
            "cpu" => Box::new(CpuBackend::new()),
            name => Box::new(try_session(&rust(name), &[]).expect("it opened before")),
        };
        session.load(model.geometry(), settings(64)).expect("a small scene");
        session
    };
    let alone: Vec<Vec<RowBlock>> = names
        .iter()
        .map(|name| {
            scenes
                .iter()
                .map(|model| rows_of(open(name, model).as_mut(), model))
                .collect()
        })
        .collect();
    // All open at once, a hemicube of each in turn.
    for (at, model) in scenes.iter().enumerate() {
        let all = hemicubes(model, &spread(model, 24));
        let mut sessions: Vec<_> = names
            .iter()
            .map(|name| (open(name, model), RowBlock::default()))
            .collect();
        for one in &all {
            for (session, rows) in &mut sessions {
                session.rows(std::slice::from_ref(one), rows).expect("a legal hemicube");
            }
        }
        for (((_, rows), name), alone) in sessions.iter().zip(&names).zip(&alone) {
            assert_eq!(rows, &alone[at], "{name}, one hemicube at a time beside the others");
        }
    }
    // From two threads, each with sessions of its own, in opposite order.
    std::thread::scope(|scope| {
        for backwards in [false, true] {
            let (names, scenes, alone, open) = (&names, &scenes, &alone, &open);
            scope.spawn(move || {
                for k in 0..names.len() {
                    let k = if backwards { names.len() - 1 - k } else { k };
                    for (at, model) in scenes.iter().enumerate() {
                        let rows = rows_of(open(names[k], model).as_mut(), model);
                        assert_eq!(rows, alone[k][at], "{}, beside another thread", names[k]);
                    }
                }
            });
        }
    });
}

/// Drivers on the processor have its memory. Sessions of two threads share a quarter of the limit.
#[test]
fn a_limit_of_memory_holds_for_devices_that_have_no_memory_of_their_own() {
    let place = tempfile::tempdir().expect("a temporary directory");
    let run = |words: &str| {
        let output = Command::new(program())
            .args(words.split(' '))
            .current_dir(place.path())
            .env("HEMICUBE_BACKEND_PATH", folder())
            .output()
            .expect("the program starts");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    run("generate room --patches 300 -o room.obj");
    for name in NAMES {
        let Ok(session) = try_session(&rust(name), &[]) else {
            assert!(!has_device(name));
            continue;
        };
        let compute = format!(
            "compute room.obj -o {name} --backend {name} --threads 2 --correction pixel --resolution 1024 --memory 256M"
        );
        if session.library().devices().expect("devices")[0].kind == DeviceKind::Software {
            let said = run(&compute);
            assert!(said.contains("of which 32000000 may be used"), "{name}: {said}");
        }
        let said = run(&format!("{compute} --backend-option memory=1000000000"));
        assert!(!said.contains("may be used"), "{name}: {said}");
    }
}

/// In the row of patch 4810 of this tile, a wall shared by two houses stands right before the whole view. The plugins
/// alone see through it: 0.35 of the row.
#[test]
fn a_wall_right_before_a_patch_is_seen() {
    let Some(scenes) = scenes_or_skip("a_wall_right_before_a_patch_is_seen") else {
        return;
    };
    let scratch = tempfile::tempdir().expect("a folder");
    for name in NAMES.into_iter().filter(|name| has_device(name)) {
        let output = Command::new(program())
            .arg("compute")
            .arg(scenes.join("city/denhaag-8897.obj"))
            .args(["--rows", "4810..4811", "--correction", "pixel", "--json", "--quiet"])
            .env("HEMICUBE_BACKEND_PATH", folder())
            .args(["--backend", name, "--overwrite", "-o"])
            .arg(scratch.path().join("row"))
            .output()
            .expect("the program starts");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let report: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        assert_eq!(report["row_sum"]["mean"], 1.0, "{name}");
        let version = report["backend"]["version"].as_str().expect("a version");
        assert!(
            version.starts_with("gpu-4-exact+"),
            "it is told from the plugin's alone: {version}"
        );
    }
}

/// A strip 24 by 2 pixels of triangles of a twelfth of a pixel, before the sky: nearly all that cover a pixel's centre
/// show nowhere else, and most are at the strip's edge. What settles edges found no triangle there, and gave
/// such pixels to the sky.
#[test]
fn a_wall_of_triangles_far_smaller_than_a_pixel_has_no_holes() {
    const ACROSS: u32 = 300;
    const UP: u32 = 25;
    let corner = |i: u32, j: u32| {
        let part = |k: u32, of: u32| f64::from(k) / f64::from(of);
        DVec3::new(0.1 + 0.75 * part(i, ACROSS), 0.05 + 0.06 * part(j, UP), 1.0)
    };
    let of = |corners: [DVec3; 3]| Triangle {
        corners,
        object: 0,
        material: 0,
        face: 0,
        two_sided: false,
    };
    let mut triangles = vec![of([DVec3::ZERO, DVec3::X * 0.01, DVec3::Y * 0.01])];
    for j in 0..UP {
        for i in 0..ACROSS {
            let [a, b, c, d] = [(0, 0), (0, 1), (1, 1), (1, 0)].map(|(x, y)| corner(i + x, j + y));
            triangles.extend([of([a, b, c]), of([a, c, d])]);
        }
    }
    let scene = Scene {
        triangles,
        ..Scene::default()
    };
    let model = model(scene, Subdivision::None);
    let one = hemicubes(&model, &[InputPatch(0)]);
    let seen = |backend: &mut dyn HemicubeBackend| {
        let (rows, _) = render_with(backend, &model, &one, settings(64));
        rows.row(0).visible.iter().filter(|&&weight| weight > 0).count()
    };
    let wanted = seen(&mut CpuBackend::new());
    assert!(wanted > 40, "{wanted} pixels show the strip");
    for name in NAMES.into_iter().filter(|name| has_device(name)) {
        let found = seen(&mut try_session(&rust(name), &[]).expect("it opened before"));
        assert_eq!(found, wanted, "{name}: each pixel shows another triangle");
    }
}

/// Leaves smaller than a pixel, apart from each other: of those that no pixel shows, nothing is known where edges are
/// settled. So none may lose the pixels that the driver gave it wrongly either: that took 1 % of these leaves away.
#[test]
fn leaves_smaller_than_a_pixel_lose_as_much_as_they_gain() {
    let mut random = Random(5);
    let of = |corners: [DVec3; 3], two_sided| Triangle {
        corners,
        object: 0,
        material: 0,
        face: 0,
        two_sided,
    };
    let mut triangles: Vec<Triangle> = (0..6u32)
        .map(|k| {
            let corner = DVec3::new(0.25 * f64::from(k) - 0.6, 0.0, 0.0);
            of([corner, corner + DVec3::X * 0.03, corner + DVec3::Y * 0.03], false)
        })
        .collect();
    for _ in 0..30_000 {
        let mut within = |size: f64| size * (2.0 * random.unit() - 1.0);
        let corner = DVec3::new(within(1.0), within(1.0), 1.1 + within(0.1));
        let [a, b] = [0, 1].map(|_| DVec3::new(within(0.02), within(0.02), within(0.02)));
        triangles.push(of([corner, corner + a, corner + b], true));
    }
    let scene = Scene {
        triangles,
        ..Scene::default()
    };
    let model = model(scene, Subdivision::None);
    let emitters: Vec<InputPatch> = (0..6).map(InputPatch).collect();
    let all = hemicubes(&model, &emitters);
    let seen = |backend: &mut dyn HemicubeBackend| {
        let (rows, _) = render_with(backend, &model, &all, settings(64));
        rows.visible.iter().map(|&weight| f64::from(weight)).sum::<f64>()
    };
    let wanted = seen(&mut CpuBackend::new());
    for name in NAMES.into_iter().filter(|name| has_device(name)) {
        let found = seen(&mut try_session(&rust(name), &[]).expect("it opened before"));
        let more = found / wanted - 1.0;
        say(&format!(
            "{name}: {:.2} % more of the leaves than by the processor",
            100.0 * more
        ));
        assert!(more.abs() < 5e-3, "{name}: {more}");
    }
}

/// Hemicubes that plugins leave to the processor are few in a city in which houses share walls.
#[test]
fn few_hemicubes_of_a_city_are_close() {
    let Some(scenes) = scenes_or_skip("few_hemicubes_of_a_city_are_close") else {
        return;
    };
    for scene in ["city/denhaag-8897.obj", "../cases/city/munich.obj"] {
        let model = model(read(&scenes, scene).expect("a scene"), Subdivision::None);
        let all: Vec<_> = model
            .order()
            .flat_map(|patch| model.hemicubes(patch, 1, true))
            .collect();
        let close = all
            .iter()
            .filter(|hemicube| is_close(model.geometry(), hemicube))
            .count();
        say(&format!("{scene}: {close} of {} hemicubes are close", all.len()));
        assert!(close > 0 && close * 10 < all.len(), "{scene}: {close} of {}", all.len());
    }
}
