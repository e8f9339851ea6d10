//! The stored part of a matrix, as a user meets it: the compact form, small form factors left out, and `balance` with
//! its exit codes.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

use assert_cmd::Command;
use hemicube::store::{Form, Store};
use hemicube_scene::InputPatch;
use hemicube_tests::runs::{TIME_LIMIT, command_in, files};
use hemicube_tests::scenes::program;
use serde_json::Value;
use std::collections::BTreeMap;
use std::process::Output;
use tempfile::TempDir;

/// Runs a line of words in a directory, without settings of the user or the environment.
#[track_caller]
fn run(place: &TempDir, line: &str, code: i32) -> Output {
    let mut command = command_in(&program(), place.path());
    command.args(line.split_whitespace());
    let output = Command::from_std(command)
        .timeout(TIME_LIMIT)
        .output()
        .expect("the program runs");
    assert_eq!(
        output.status.code(),
        Some(code),
        "{line}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

#[track_caller]
fn json(place: &TempDir, line: &str, code: i32) -> Value {
    let output = run(place, line, code);
    serde_json::from_slice(&output.stdout).expect("a report")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A place with a small block city in it.
fn city() -> TempDir {
    let place = tempfile::tempdir().expect("a temporary directory");
    run(&place, "generate block-city --patches 1500 -o city.obj", 0);
    place
}

/// A store's files under names that do not depend on where it is.
fn bytes(place: &TempDir, store: &str) -> Vec<Vec<u8>> {
    files(&place.path().join(store)).into_values().collect()
}

/// (column, factor as bits) of every row that is there.
fn rows(place: &TempDir, store: &str) -> BTreeMap<InputPatch, Vec<(u32, u64)>> {
    let store = Store::open(&place.path().join(store)).expect("a store");
    let rows = store.rows().expect("rows").map(|row| {
        let (patch, row) = row.expect("a row");
        let bits = row.data.iter().map(f64::to_bits);
        (patch, row.indices.iter().copied().zip(bits).collect())
    });
    rows.collect()
}

#[test]
fn a_compact_matrix_is_the_plain_one_rounded_whatever_the_threads() {
    let place = city();
    run(
        &place,
        "compute city.obj -o plain --correction pixel --resolution 64",
        0,
    );
    let report = json(
        &place,
        "compute city.obj -o one --correction pixel --resolution 64 --form compact --threads 1 --json",
        0,
    );
    run(
        &place,
        "compute city.obj -o three --correction pixel --resolution 64 --form compact --threads 3 --batch 5",
        0,
    );
    assert_eq!(bytes(&place, "one"), bytes(&place, "three"));
    assert_eq!(
        (&report["form"], &report["value_error"]),
        (&"compact".into(), &(1.0 / 2048.0).into())
    );

    let (plain, compact) = (rows(&place, "plain"), rows(&place, "one"));
    let rounded: BTreeMap<_, Vec<(u32, u64)>> = plain
        .iter()
        .map(|(&patch, row)| {
            let round = |bits: u64| Form::Compact.round(f64::from_bits(bits)).to_bits();
            (patch, row.iter().map(|&(column, bits)| (column, round(bits))).collect())
        })
        .collect();
    assert!(compact == rounded && plain != rounded);
    let size = |name: &str| {
        files(&place.path().join(name).join("parts"))
            .values()
            .map(Vec::len)
            .sum::<usize>()
    };
    // Rows of a hundred entries: what is kept of a row beside them weighs.
    assert!(
        size("one") * 5 < size("plain") * 3,
        "{} of {}",
        size("one"),
        size("plain")
    );

    let checked = json(&place, "check one --json", 0);
    assert_eq!(checked["form"], "compact");
    let text = run(&place, "check one", 0);
    assert!(String::from_utf8_lossy(&text.stdout).contains("within 0.05 % of themselves"));
    run(&place, "compare one plain --max-error 0.0005", 0);
    run(&place, "compare one plain --max-error 0.00001", 1);
    run(&place, "export one -o one.npz", 0);
    let exported = json(&place, "compare one one.npz --json", 0);
    assert_eq!(exported["relative_frobenius"], 0.0);
}

#[test]
fn sums_of_pixels_keep_their_bounds_in_the_compact_form() {
    let place = city();
    run(
        &place,
        "compute city.obj -o pixel --correction pixel --resolution 64 --form compact --min-factor 1e-4",
        0,
    );
    let checked = json(&place, "check pixel --json", 0);
    let found = checked["closure"]["max"].as_f64().expect("a number");
    let bound = checked["closure"]["bound"].as_f64().expect("a bound");
    assert!(found > 1e-6 && found < bound && bound < 5e-4, "{found} of {bound}");
    // The compact form rounds more than f32 does.
    run(&place, "check pixel --max-closure 1e-6", 1);
}

#[test]
fn a_least_factor_does_what_balance_does_afterwards() {
    let place = city();
    run(&place, "compute city.obj -o whole", 0);
    let report = json(
        &place,
        "compute city.obj -o thin --min-factor 2e-4 --threads 3 --batch 7 --json",
        0,
    );
    let after = json(&place, "balance whole -o balanced --min-factor 2e-4 --json", 0);
    assert!(rows(&place, "thin") == rows(&place, "balanced"));
    assert!(rows(&place, "thin") != rows(&place, "whole"));

    let thinning = &report["thinning"];
    let balance = &after["balance"];
    for name in ["entries_dropped", "rows_kept_whole", "scale_max", "min_factor"] {
        assert_eq!(thinning[name], balance[name], "{name}");
    }
    let number = |value: &Value| value.as_f64().expect("a number");
    assert!(number(&thinning["entries_dropped"]) > 1000.0);
    let share = number(&thinning["mass_dropped"]);
    assert!(share > 0.0 && (share / number(&balance["mass_dropped"]) - 1.0).abs() < 1e-9);
    for (name, residual) in [
        ("closure_max_before", &balance["before"]),
        ("closure_max_after", &balance["after"]),
    ] {
        assert!(
            (number(&thinning[name]) - number(&residual["closure_max"])).abs() < 1e-12,
            "{name}"
        );
    }
    // The sums stay: that is what sharing is for.
    let sums = ["closure_rms_before", "closure_rms_after"].map(|name| number(&thinning[name]));
    assert!((sums[0] - sums[1]).abs() < 1e-6, "{sums:?}");

    let manifest = |store: &str| -> Value {
        let text = std::fs::read(place.path().join(store).join("manifest.json")).expect("a manifest");
        serde_json::from_slice(&text).expect("JSON")
    };
    assert_eq!(&manifest("thin")["thinning"], thinning);
    assert_eq!(manifest("thin")["settings"]["min_factor"], 2e-4);
    assert_ne!(manifest("thin")["settings_hash"], manifest("whole")["settings_hash"]);
    let whole = manifest("whole");
    assert!(
        ["form", "value_error", "min_factor", "thinning"]
            .iter()
            .all(|name| whole.get(name).is_none())
    );
    let text = run(&place, "check thin", 0);
    assert!(String::from_utf8_lossy(&text.stdout).contains("form factors below 2.00e-4"));
}

#[test]
fn a_tolerance_and_what_is_kept_are_held_against_each_other() {
    let place = city();
    let refused = stderr(&run(
        &place,
        "compute city.obj -o F --tolerance 0.05% --form compact",
        2,
    ));
    assert!(
        refused.contains("--form plain") && refused.contains("0.05 %"),
        "{refused}"
    );
    assert!(!place.path().join("F").exists(), "a refused run left a directory");
    let said = stderr(&run(
        &place,
        "compute city.obj -o F --tolerance 1% --rows 40 --min-factor 3e-3",
        0,
    ));
    assert!(
        said.contains("warning: the expected error") && said.contains("--min-factor"),
        "{said}"
    );
    let said = stderr(&run(
        &place,
        "compute city.obj -o F --overwrite --tolerance 1% --rows 40 --form compact",
        0,
    ));
    assert!(!said.contains("warning"), "{said}");
    for wrong in ["--form small", "--min-factor -1", "--min-factor 1", "--min-factor x"] {
        run(&place, &format!("compute city.obj -o F --overwrite {wrong}"), 2);
    }
}

/// At a million patches, what is kept follows from their number, whichever rows are computed, and is said.
#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn a_large_matrix_is_kept_small_unless_all_of_it_is_asked_for() {
    let place = tempfile::tempdir().expect("a temporary directory");
    run(&place, "generate block-city --patches 1000000 -o city.obj", 0);
    let rows = "compute city.obj --rows 0..16 --resolution 32 --correction pixel";
    let said = stderr(&run(&place, &format!("{rows} -o small"), 0));
    assert!(
        said.contains("compact form, form factors below 1e-7 left out")
            && said.contains("`--form plain --min-factor 0`"),
        "{said}"
    );
    let kept = |name: &str| {
        let store = Store::open(&place.path().join(name)).expect("a store");
        (store.manifest().form, store.manifest().min_factor)
    };
    assert_eq!(kept("small"), (Form::Compact, 1e-7));
    let said = stderr(&run(&place, &format!("{rows} -o all --form plain --min-factor 0"), 0));
    assert!(!said.contains("left out"), "{said}");
    assert_eq!(kept("all"), (Form::Plain, 0.0));
}

#[test]
fn balance_says_by_its_exit_code_how_it_went() {
    let place = tempfile::tempdir().expect("a temporary directory");
    run(&place, "generate room --patches 400 -o room.obj", 0);
    run(&place, "compute room.obj -o F --form compact", 0);
    let found = json(&place, "balance F -o closed --closure --json", 0);
    assert_eq!(found["balance"]["converged"], true);
    let of_others = found["balance"]["closure_max_of_others"].as_f64().expect("a number");
    assert!(
        of_others < 1e-6,
        "the compact form of the source spoils nothing here: {of_others}"
    );
    run(&place, "check closed --max-reciprocity 1e-6", 0);
    let manifest = std::fs::read_to_string(place.path().join("closed/manifest.json")).expect("a manifest");
    assert!(
        !manifest.contains("\"form\""),
        "what is made equal is written with all digits"
    );
    assert!(manifest.contains("source_value_error"));

    // Too few sweeps: written, and said.
    let short = run(&place, "balance F -o short --closure --max-iterations 1", 1);
    assert!(stderr(&short).contains("--max-iterations"), "{}", stderr(&short));
    run(&place, "check short", 0);

    // Wrong usage, and what cannot be balanced.
    run(&place, "balance F -o both", 0);
    run(&place, "check both --max-closure 1e-5 --max-reciprocity 1e-6", 0);
    run(&place, "balance F -o closed --closure", 2);
    run(&place, "balance F -o F --closure --overwrite", 2);
    run(&place, "balance nothing -o none --closure", 2);
    run(&place, "compute room.obj -o some --rows 10", 0);
    let refused = stderr(&run(&place, "balance some -o none --closure", 2));
    assert!(refused.contains("10 of"), "{refused}");
    assert!(!place.path().join("none").exists());

    let help = run(&place, "balance --help", 0);
    let help = String::from_utf8_lossy(&help.stdout).into_owned();
    assert!(help.contains("130  interrupted; OUT is not there") && !help.contains("finished parts are kept"));
    let help = run(&place, "compute --help", 0);
    assert!(String::from_utf8_lossy(&help.stdout).contains("130  interrupted; finished parts are kept"));
}
