//! What `hemicube inspect` says of scenes with and without defects, what it finds in real ones, and the statistics that
//! settings choose themselves by.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

use glam::DVec3;
use hemicube::backend::WHOLE;
use hemicube::backend::{Culling, HemicubeBackend, RenderSettings};
use hemicube::diagnose::{DiagnoseOptions, FindingKind, SceneStatistics, diagnose};
use hemicube::row::RowBlock;
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::Subdivision;
use hemicube_scene::generate::Kind;
use hemicube_tests::geometry::{box_inside, flipped, quad, scene_of};
use hemicube_tests::runs::Place;
use hemicube_tests::scenes::{generated, model, program, read, say, scenes_dir, scenes_or_skip, workspace};
use serde_json::Value;
use std::path::Path;

/// Standard output of `hemicube inspect`.
fn inspect(scene: &Path, arguments: &[&str]) -> String {
    let output = assert_cmd::Command::new(program())
        .arg("inspect")
        .arg(scene)
        .args(arguments)
        .arg("--config=none")
        .timeout(std::time::Duration::from_secs(300))
        .output()
        .expect("the program runs");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    String::from_utf8(output.stdout).expect("UTF-8")
}

fn json(scene: &Path, arguments: &[&str]) -> Value {
    let arguments = [arguments, &["--json"]].concat();
    serde_json::from_str(&inspect(scene, &arguments)).expect("JSON")
}

/// An OBJ file of these triangles, all in object `thing`.
fn write(path: &Path, triangles: &[[DVec3; 3]]) {
    let mut text = "o thing\n".to_owned();
    for corner in triangles.iter().flatten() {
        text.push_str(&format!("v {} {} {}\n", corner.x, corner.y, corner.z));
    }
    for k in 0..triangles.len() {
        text.push_str(&format!("f {} {} {}\n", 3 * k + 1, 3 * k + 2, 3 * k + 3));
    }
    std::fs::write(path, text).expect("room in the temporary directory");
}

const HEADING: &str = "Doubtful patches";

#[test]
fn nothing_is_said_where_nothing_is_wrong() {
    let place = tempfile::tempdir().expect("a temporary directory");
    let scene = place.path().join("room.obj");
    let room: Vec<[DVec3; 3]> = box_inside(DVec3::new(4.0, 3.0, 2.0))
        .into_iter()
        .flat_map(quad)
        .collect();
    write(&scene, &room);
    let arguments = ["--split", "8"];
    let text = inspect(&scene, &["--split", "8", "-v"]);
    assert!(!text.contains(HEADING) && !text.contains("try"), "{text}");
    let report = json(&scene, &arguments);
    assert_eq!(report["diagnosis"]["findings"], Value::Array(Vec::new()));
    assert_eq!(report["statistics"]["escaped"], 0.0);
    let occlusion = report["statistics"]["occlusion"].as_f64();
    assert!(
        occlusion.is_some_and(|hidden| hidden < 5e-3),
        "{occlusion:?}: only what is smaller than a pixel"
    );
}

#[test]
fn a_finding_has_its_count_its_place_and_the_next_thing_to_try() {
    let place = tempfile::tempdir().expect("a temporary directory");
    let scene = place.path().join("walls.obj");
    let p = DVec3::new;
    let ground = [p(0.0, 0.0, 0.0), p(4.0, 0.0, 0.0), p(0.0, 4.0, 0.0)];
    let wall = [p(0.5, 1.0, -1.0), p(1.5, 1.0, -1.0), p(1.0, 1.0, 1.0)];
    write(&scene, &[ground, wall]);
    let text = inspect(&scene, &["-v"]);
    for words in [
        HEADING,
        "crossing: 1 pair of triangles passing through each other",
        "0.50 of crossing lines",
        "patch 1 with 0 (`thing`) at (1 1 0): crossing line 0.50",
        "try",
        "--split 2",
    ] {
        assert!(text.contains(words), "`{words}` is not in {text}");
    }
    assert!(text.lines().all(|line| line.chars().count() <= 150), "{text}");
    let report = json(&scene, &[]);
    let finding = &report["diagnosis"]["findings"][0];
    assert_eq!(finding["kind"], "crossing");
    assert_eq!((&finding["count"], &finding["total"]), (&1.into(), &0.5.into()));
    assert_eq!(finding["examples"][0]["at"], serde_json::json!([1.0, 1.0, 0.0]));
    assert_eq!(finding["objects"][0][0]["object"], "thing");
    assert_eq!(finding["unit"], "length");

    // Equal bytes, whatever the threads.
    let arguments = |threads| json(&scene, &["--threads", threads])["diagnosis"].to_string();
    assert_eq!(arguments("1"), arguments("3"));
}

fn statistics(model: &hemicube::Model) -> SceneStatistics {
    SceneStatistics::measure(model, &mut CpuBackend::new(), 64, 1).expect("the CPU backend")
}

#[test]
fn statistics_of_scenes_whose_view_is_known() {
    // A closed convex room: all that faces a patch is seen, and nothing else.
    let room = box_inside(DVec3::ONE).into_iter().flat_map(quad);
    let room = statistics(&model(scene_of(room), Subdivision::None));
    assert_eq!(
        (room.rows, room.escaped, room.blocked, room.occlusion),
        (12, 0.0, 0.0, 0.0)
    );
    assert_eq!((room.seen, room.facing), (10.0, 10.0));
    assert!(room.near == 10.0 && room.nearness > 1.0, "{room:?}");

    // Two plates that face each other across ten times their size, and the same turned away.
    let plate = [
        DVec3::ZERO,
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(1.0, 1.0, 0.0),
        DVec3::new(0.0, 1.0, 0.0),
    ];
    let lifted = |plate: [DVec3; 4]| plate.map(|c| c + DVec3::new(0.0, 0.0, 10.0));
    let facing = quad(plate).into_iter().chain(quad(lifted(flipped(plate))));
    let facing = statistics(&model(scene_of(facing), Subdivision::None));
    assert_eq!((facing.seen, facing.near, facing.blocked), (2.0, 0.0, 0.0));
    assert!(facing.escaped > 0.95, "{facing:?}");
    // Radius of a half square by the distance.
    assert!((facing.nearness - 5f64.sqrt() / 3.0 / 10.0).abs() < 2e-3, "{facing:?}");
    let away = quad(plate).into_iter().chain(quad(lifted(plate)));
    let away = statistics(&model(scene_of(away), Subdivision::None));
    assert_eq!((away.seen, away.facing, away.occlusion), (0.0, 0.0, 0.0));
    // The lower two of the four see the backs of the upper two.
    assert!(
        away.blocked > 0.0 && (away.blocked + away.escaped - 1.0).abs() < 1e-9,
        "{away:?}"
    );

    // Statistics are of the scene: the same twice.
    let city = generated(Kind::BlockCity, 3000);
    let found = statistics(&city);
    assert_eq!(found, statistics(&city));
    assert!(
        found.rows == 64 && found.occlusion > 0.5 && found.escaped > 0.05,
        "{found:?}"
    );
}

/// The share of each patch's view from its centroid that is backs, by a hemicube.
fn blocked_shares(model: &hemicube::Model) -> Vec<f64> {
    let mut backend = CpuBackend::new();
    let settings = RenderSettings {
        resolution: 64,
        culling: Culling::On,
        covered: false,
    };
    backend.load(model.geometry(), settings).expect("the CPU backend loads");
    let mut block = RowBlock::default();
    for patch in model.patches().iter() {
        backend
            .rows(&model.hemicubes(patch, 1, true), &mut block)
            .expect("the CPU backend renders");
    }
    block
        .blocked
        .iter()
        .map(|&weight| f64::from(weight) / f64::from(WHOLE))
        .collect()
}

/// Rays and hemicubes know nothing of each other, and must tell the same patches blocked.
#[test]
fn rays_and_hemicubes_agree_on_what_is_blocked() {
    let Some(folder) = scenes_or_skip("rays_and_hemicubes_agree_on_what_is_blocked") else {
        return;
    };
    for file in ["city/denhaag-8897.obj", "cornell/cornell-measured-closed-20q.obj"] {
        let scene = read(&folder, file).expect("a scene");
        let subdivision = if file.starts_with("cornell") {
            Subdivision::Split(16)
        } else {
            Subdivision::None
        };
        let model = model(scene, subdivision);
        let diagnosis = diagnose(&model, DiagnoseOptions::default());
        let blocked = blocked_shares(&model);
        assert_eq!(blocked.len(), model.patches().len());
        let count = |kind| diagnosis.of(kind).map_or(0.0, |finding| finding.estimate);
        let buried = count(FindingKind::Buried) + count(FindingKind::CentroidBuried);
        let mostly = buried + count(FindingKind::MostlyBlocked);
        let by_hemicubes = |share: f64| blocked.iter().filter(|&&b| b > share).count() as f64;
        say(&format!(
            "{file}: buried {buried} by rays, {} by hemicubes; mostly blocked {mostly} and {}",
            by_hemicubes(0.95),
            by_hemicubes(0.5)
        ));
        assert!((mostly - by_hemicubes(0.5)).abs() <= 0.05 * by_hemicubes(0.5) + 2.0);
        // Within what 64 rays can tell of a share of 0.95.
        assert!((by_hemicubes(0.98)..=by_hemicubes(0.9)).contains(&buried), "{buried}");
        if file.starts_with("cornell") {
            // The blocks of the measured box have no bottoms: 92 patches of the floor lie under them.
            assert_eq!(buried, 92.0);
            assert!(
                count(FindingKind::CentroidBuried) > 0.0,
                "the blocks' edges cross patches"
            );
        }
    }
}

#[test]
fn what_is_found_in_real_scenes() {
    let Some(folder) = scenes_or_skip("what_is_found_in_real_scenes") else {
        return;
    };
    let files = [
        "city/denhaag-8897.obj",
        "city/rotterdam-delfshaven.obj",
        "city/zurich-lv95-rawcoords.obj",
        "city/3dfier-testarea.obj",
        "interior/aggressor.obj",
        "interior/oa_dm5.obj",
        "ac/fg-clem-superstructure.ac",
        "ac/fg-zone_maisons-ba.ac",
        "cornell/CornellBox-Original.obj",
    ];
    for file in files {
        let model = model(read(&folder, file).expect("a scene"), Subdivision::None);
        let diagnosis = diagnose(&model, DiagnoseOptions::default());
        let counts: Vec<String> = diagnosis
            .findings
            .iter()
            .map(|finding| format!("{} {:.0}", finding.kind.name(), finding.estimate))
            .collect();
        say(&format!("{file}: {}", counts.join(", ")));
        let has = |kind| diagnosis.of(kind).is_some();
        match file {
            // Walls of joined houses, and houses standing in an unsplit ground.
            "city/denhaag-8897.obj" => {
                assert!(has(FindingKind::NearContact) && has(FindingKind::Crossing));
                let line = diagnosis.of(FindingKind::Crossing).and_then(|finding| finding.total);
                assert!(
                    line.is_some_and(|length| (1e3..1e5).contains(&length)),
                    "{line:?} m of crossing lines"
                );
            }
            // Coordinates of millions with three decimals.
            "city/zurich-lv95-rawcoords.obj" => {
                assert_eq!(diagnosis.precision.f32_step, 0.25);
                assert!(diagnosis.precision.f32_digits < 2.0);
                assert!(has(FindingKind::CoarseGrain));
            }
            // 32 clean triangles, of which two lie under the blocks.
            "cornell/CornellBox-Original.obj" => {
                assert!(has(FindingKind::CentroidBuried) && !has(FindingKind::Crossing) && !has(FindingKind::Sliver));
            }
            _ => {}
        }
    }
}

/// Processor time of whole runs, by the command that a user has for it.
#[test]
#[ignore = "takes a minute of processor time: ./test --full"]
fn times_foretold_are_within_twice_the_times_taken() {
    let place = Place::new();
    let mut scenes = Vec::new();
    for (kind, patches) in [
        ("room", 12),
        ("room", 400),
        ("room", 2_000),
        ("city", 400),
        ("city", 2_000),
        ("maze", 1_000),
        ("field", 1_000),
    ] {
        let scene = format!("{kind}-{patches}.obj");
        place
            .line(&format!("generate {kind} --patches {patches} -o {scene} -q"))
            .is(0);
        scenes.push(place.path(&scene));
    }
    scenes.push(workspace().join("crates/scene/data/cornell-box.obj"));
    if let Some(folder) = scenes_dir() {
        scenes.extend(["zurich-lv95-rawcoords.obj", "denhaag-8897.obj"].map(|name| folder.join("city").join(name)));
    }
    let forecasts = |within: &str| {
        std::process::Command::new(workspace().join("scripts/forecasts"))
            .args(["--within", within])
            .args(&scenes)
            .env("HEMICUBE_PROGRAM", program())
            .output()
            .expect("Python runs the script")
    };
    let ran = forecasts("2");
    let said = format!(
        "{}{}",
        String::from_utf8_lossy(&ran.stdout),
        String::from_utf8_lossy(&ran.stderr)
    );
    assert!(ran.status.success(), "{said}");
    assert_eq!(said.lines().count(), 1 + scenes.len(), "{said}");
    // No forecast is right to the millisecond.
    let ran = forecasts("1.0001");
    assert!(String::from_utf8_lossy(&ran.stderr).contains("further off than 1.0001 times"));
    assert_eq!(ran.status.code(), Some(1));
}

/// Two layers of crossed strips in a room: a row has hundreds of contour integrals, and takes ten times a room's.
fn screens(strips: u32) -> Vec<[DVec3; 3]> {
    let mut mesh: Vec<[DVec3; 3]> = box_inside(DVec3::splat(2.0)).into_iter().flat_map(quad).collect();
    for z in [1.0, 1.0001] {
        for k in 0..strips {
            let x = 0.1 + 1.8 * f64::from(k) / f64::from(strips);
            let (y, above) = (x + 0.6 / f64::from(strips), z + 1e-5);
            let along = [(x, 0.1), (y, 0.1), (y, 1.9), (x, 1.9)].map(|(u, v)| DVec3::new(u, v, z));
            let across = [(0.1, x), (1.9, x), (1.9, y), (0.1, y)].map(|(u, v)| DVec3::new(u, v, above));
            for strip in [along, across] {
                mesh.extend([strip, flipped(strip)].into_iter().flat_map(quad));
            }
        }
    }
    mesh
}

#[test]
fn a_forecast_ends_at_its_bound_of_work_and_says_so() {
    /// `MOST_STEPS` of the forecast, and the first rows of at most eight strata: four of 30 million steps at most.
    const MOST: u64 = 1_000_000_000 + 8 * 4 * 30_000_000;
    let place = tempfile::tempdir().expect("a temporary directory");
    let scene = place.path().join("screens.obj");
    write(&scene, &screens(150));
    // No clock decides, and no number of threads: three measure as many rows.
    let by = |arguments: &[&str]| {
        let mut found = json(&scene, arguments)["forecast"].clone();
        let fields = found.as_object_mut().expect("a forecast");
        (fields.remove("threads").expect("a number"), found)
    };
    let (threads, found) = by(&["--threads", "1"]);
    assert_eq!(threads, 1);
    assert_eq!(found["met_bound"], true, "{found}");
    let (rows, steps) = (&found["measured_rows"], &found["measured_steps"]);
    assert!(rows.as_u64().is_some_and(|rows| (10..400).contains(&rows)), "{rows}");
    // All 500 rows of the sample take ten times as many.
    assert!(steps.as_u64().is_some_and(|steps| steps < MOST), "{steps}");
    let by_three = inspect(&scene, &["--threads", "3"]);
    assert!(
        by_three.contains(&format!("measured on {rows} rows only, for rows like these")),
        "{by_three}"
    );

    // Rows that fit the bound are all measured.
    write(&scene, &screens(2));
    let found = &json(&scene, &[])["forecast"];
    let patches = json(&scene, &[])["patches"]["count"].clone();
    assert_eq!(
        (&found["met_bound"], &found["measured_rows"]),
        (&false.into(), &patches)
    );
    assert!(!inspect(&scene, &[]).contains("only, for rows like these"));
}

/// What a run takes of what was foretold of it.
fn taken_of_foretold(place: &Place, scene: &str, level: &str) -> [f64; 3] {
    let settings = format!("--config=none --threads 1 {level}");
    let foretold = place
        .line(&format!("inspect {scene} --json -v {settings}"))
        .is(0)
        .json()["forecast"]
        .clone();
    let line = format!("compute {scene} -o out --overwrite --json -v {settings}");
    let taken = place.line(&line).is(0).json();
    let number = |of: &Value| of.as_f64().unwrap_or(f64::NAN);
    let peak = [&taken["peak_memory_bytes"], &foretold["memory_bytes"]].map(number);
    assert!(
        peak[0] <= peak[1],
        "{scene} {level}: {} bytes for at most {}",
        peak[0],
        peak[1]
    );
    ["steps", "entries", "bytes"].map(|what| number(&taken[what]) / number(&foretold[what]))
}

#[test]
fn a_forecast_follows_the_accuracy_asked_within_a_factor_of_2() {
    forecasts_hold(&["room", "maze", "field"]);
}

#[test]
#[ignore = "the same of cities and spheres, half a minute: ./test --full"]
fn forecasts_of_cities_and_spheres_hold() {
    forecasts_hold(&["city", "block-city", "spheres", "maze"]);
}

fn forecasts_hold(kinds: &[&str]) {
    let place = Place::new();
    let (mut off, mut steps) = (Vec::new(), Vec::new());
    for kind in kinds {
        let scene = format!("{kind}.obj");
        place
            .line(&format!("generate {kind} --patches 500 -o {scene} -q"))
            .is(0);
        for level in ["", "--tolerance 0.3%"] {
            let found = taken_of_foretold(&place, &scene, level);
            if found.iter().any(|ratio| !(0.5..=2.0).contains(ratio)) {
                off.push(format!("{scene} {level}: {found:?}"));
            }
            steps.push(found[0]);
        }
    }
    assert!(off.is_empty(), "taken by foretold: steps, entries, bytes: {off:?}");
    // A forecast of another level is further off than that.
    let of = |line: &str, what: &str| {
        let report = place.line(line).is(0).json();
        report["forecast"][what]
            .as_f64()
            .or(report[what].as_f64())
            .expect("a number")
    };
    let coarse = of("inspect maze.obj --json --config=none", "steps");
    let fine = of(
        "compute maze.obj -o out --overwrite --quiet --json --config=none --tolerance 0.3%",
        "steps",
    );
    assert!(fine > 2.0 * coarse, "{fine} {coarse}");
}
