//! `check` and `report` say what they vouch for: integrity, conservation and quality, each with its own verdict, and an
//! unfinished matrix is no damaged one.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

use hemicube::store::{Manifest, Store};
use hemicube_tests::runs::Place;
use hemicube_tests::scenes::workspace;
use serde_json::Value;

fn cornell() -> String {
    let path = workspace().join("crates/scene/data/cornell-box.obj");
    path.canonicalize().expect("the Cornell box").display().to_string()
}

/// The state of each verdict.
fn states(report: &Value) -> [&str; 3] {
    ["integrity", "conservation", "quality"]
        .map(|subject| report["verdicts"][subject]["state"].as_str().expect("a state"))
}

#[test]
fn a_matrix_that_compute_warned_of_is_doubtful_and_no_error() {
    let place = Place::new();
    let scene = cornell();
    place
        .line(&format!("compute {scene} --split 2 -o box --config=none"))
        .is(0)
        .says(&["warning: 2 patches see mostly backs of surfaces"]);
    let checked = place.line("check box").is(0).out;
    assert!(
        checked.contains("quality       DOUBTFUL") && checked.contains("integrity     ok"),
        "{checked}"
    );
    assert!(
        checked.contains("2 rows see mostly backs of surfaces") && !checked.contains("Everything holds"),
        "{checked}"
    );
    let report = place.line("check box --json").is(0).json();
    assert_eq!(report["ok"], true, "old scripts read what they read");
    assert_eq!(states(&report), ["ok", "ok", "doubtful"]);
    assert_eq!(report["verdicts"]["quality"]["doubts"], serde_json::json!(["warned"]));
    place.line("check box --strict").is(1);

    let summary = place
        .line(&format!("report box {scene} -o box.html --json"))
        .is(0)
        .json();
    assert_eq!(states(&summary), ["ok", "ok", "doubtful"]);
    let page = std::fs::read_to_string(place.path("box.html")).expect("a page");
    assert!(
        page.contains("card doubtful\"><b>quality: DOUBTFUL"),
        "three verdicts, three cards"
    );
    assert!(!page.contains("Everything holds"));
}

#[test]
fn rows_beyond_the_tolerance_asked_for_are_doubtful_and_beyond_a_bound_failed() {
    let place = Place::new();
    place.line("generate room --patches 300 -o room.obj -q").is(0);
    place
        .line("compute room.obj --tolerance 5% -o F -q --config=none")
        .is(0);
    let report = place.line("check F --json").is(0).json();
    assert_eq!(states(&report), ["ok"; 3]);
    assert_eq!(report["quality"]["closure_limit"], 0.05);
    assert!(place.line("check F --strict").is(0).out.contains("Everything holds."));
    let worst = report["closure"]["max"].as_f64().expect("a number");
    assert!(worst > 1e-6);
    let failed = place
        .line(&format!("check F --max-closure {} --json", worst / 2.0))
        .is(1)
        .json();
    assert_eq!(states(&failed), ["ok", "ok", "failed"]);

    // A run that asked for less than it got.
    let path = place.path("F/manifest.json");
    let text = std::fs::read_to_string(&path).expect("a manifest");
    let mut manifest = Store::open(&place.path("F")).expect("a store").manifest().clone();
    manifest.settings["tolerance"] = Value::from(worst / 2.0);
    std::fs::write(&path, sealed(&manifest)).expect("the manifest");
    let report = place.line("check F --json").is(0).json();
    assert_eq!(states(&report), ["ok", "ok", "doubtful"]);
    assert_eq!(report["verdicts"]["quality"]["doubts"], serde_json::json!(["closure"]));
    let out = place.line("check F").is(0).out;
    assert!(out.contains("rows have a closure error above"), "{out}");
    std::fs::write(&path, text).expect("the manifest");
}

fn sealed(manifest: &Manifest) -> String {
    manifest.to_json().expect("a manifest")
}

#[test]
fn an_unfinished_matrix_is_not_called_damaged() {
    let place = Place::new();
    let scene = cornell();
    place
        .line(&format!(
            "compute {scene} --split 4 --shard 1/2 -o box -q --config=none"
        ))
        .is(0);
    let checked = place.line("check box").is(1).out;
    assert!(
        checked.contains("integrity     UNFINISHED")
            && checked.contains("parts are there")
            && !checked.contains("FAILED"),
        "{checked}"
    );
    let report = place.line("check box --json").is(1).json();
    assert_eq!(states(&report)[0], "unfinished");
    assert_eq!(report["failures"][0]["check"], "complete");
    let accepted = place.line("check box --allow-incomplete").is(0).out;
    assert!(accepted.contains("What is there holds."), "{accepted}");

    // A part that is gone from a finished matrix is damage.
    place
        .line(&format!("compute {scene} --split 4 -o whole -q --config=none"))
        .is(0);
    std::fs::remove_file(place.path("whole/parts/part-00003.npz")).expect("a part");
    let checked = place.line("check whole").is(1).out;
    assert!(
        checked.contains("files: 1 case")
            && checked.contains("integrity     FAILED")
            && !checked.contains("UNFINISHED"),
        "{checked}"
    );
}

#[test]
fn help_says_the_bound_that_holds() {
    let place = Place::new();
    let help = place.line("check --help").is(0).out;
    let words = help.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(
        words.contains("doubt above the run's tolerance; for sums of pixels fail above 1e-6"),
        "{help}"
    );
    place.line("generate room --patches 100 -o room.obj -q").is(0);
    for (correction, bound) in [("pixel", Some(1e-6)), ("tolerance", None)] {
        place
            .line(&format!(
                "compute room.obj --correction {correction} -o F -q --overwrite --config=none"
            ))
            .is(0);
        let report = place.line("check F --json").is(0).json();
        assert_eq!(report["closure"]["bound"].as_f64(), bound, "{correction}");
    }
}
