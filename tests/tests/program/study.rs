//! The example `study` on tiny scenes: every table and picture is there, what was measured is kept, and a second run
//! measures nothing. Times are not judged: they are the machine's.
//!
//! The example is the one beside this test: build it with the same profile and target directory before.

use hemicube_tests::runs::{Place, Ran, command_in};
use hemicube_tests::scenes::program;
use serde_json::Value;
use std::collections::BTreeSet;

const LINE: &str = "--quick -o study --backend cpu --patches 60 --rows 16 --seconds 0.05 --resolution 32 --scene city \
                    --scene room --label tiny";

/// The headings of the report, each of which has a table or a picture beneath it.
const HEADINGS: [&str; 9] = [
    "Algorithms compared (table 4.6)",
    "Octree levels and least patches (tables 4.3 to 4.5)",
    "What finds itself",
    "Without the octree, and what the octree gains (tables 4.7 and 4.8)",
    "Processors and the bus (section 4.3.1)",
    "Memory over time (figures 4.7 and 4.8)",
    "Distances (table 4.9)",
    "Error against rays",
    "Pictures",
];

/// The gaps of a report: missing headings, and headings with nothing beneath them.
fn missing(report: &str) -> Vec<&'static str> {
    let body = |heading: &str| {
        let (_, rest) = report.split_once(&format!("\n## {heading}\n"))?;
        Some(rest.split("\n## ").next().unwrap_or(rest))
    };
    let is_full = |text: &str| {
        let lines = text.lines().filter(|line| line.starts_with('|')).count();
        lines > 2 || text.contains("![")
    };
    HEADINGS
        .into_iter()
        .filter(|heading| !body(heading).is_some_and(is_full))
        .collect()
}

fn study(place: &Place) -> Value {
    let text = std::fs::read_to_string(place.path("study/study.json")).expect("the study's file");
    serde_json::from_str(&text).expect("JSON")
}

fn keys(study: &Value) -> BTreeSet<String> {
    study["cells"].as_object().expect("cells").keys().cloned().collect()
}

/// A run of the study.
fn line(place: &Place, words: &str) -> Ran {
    let example = program().with_file_name("examples").join("study");
    let mut command = command_in(&example, &place.path("."));
    command
        .args(words.split_whitespace())
        .output()
        .expect("`cargo build --example study` made it")
        .into()
}

#[track_caller]
fn measured(ran: Ran, cells: &str) {
    ran.is(0).says(&[&format!("{cells} measured")]);
}

#[test]
fn a_study_has_every_table_and_goes_on_where_it_was() {
    let place = Place::new();
    let ran = line(&place, LINE).is(0);
    assert!(
        ran.out.contains("| city |") && ran.out.contains("| room |"),
        "{}",
        ran.out
    );

    let report = std::fs::read_to_string(place.path("study/study.md")).expect("a report");
    assert_eq!(missing(&report), [""; 0], "{report}");
    assert!(
        report.contains("hemicube 0.") && report.contains(", tiny, on "),
        "{report}"
    );
    // The comparator, shown failing: a heading that is gone, and one with nothing beneath it.
    let without = report.replace("## Distances (table 4.9)", "## Nothing");
    assert_eq!(missing(&without), ["Distances (table 4.9)"]);
    let (head, _) = report.split_once("\n## Pictures\n").expect("the last heading");
    assert_eq!(missing(&format!("{head}\n## Pictures\n")), ["Pictures"]);

    for name in [
        "error-against-time-city",
        "gain-against-occlusion",
        "octree-parameters-cpu",
        "memory-over-time",
    ] {
        let picture = std::fs::read_to_string(place.path(format!("study/{name}.svg"))).expect(name);
        assert!(
            picture.starts_with("<svg") && picture.trim_end().ends_with("</svg>"),
            "{name}"
        );
        assert!(report.contains(&format!("({name}.svg)")), "{name} is not in the report");
    }

    let first = study(&place);
    let mut rates = 0;
    for (key, cell) in first["cells"].as_object().expect("cells") {
        let Some(rate) = cell.get("rate") else { continue };
        rates += 1;
        let number = |name: &str| rate[name].as_f64().unwrap_or_else(|| panic!("{key}: {name}"));
        assert!(
            number("milliseconds") > 0.0 && number("rows") == 16.0 && number("patches") >= 40.0,
            "{key}"
        );
        // All algorithms of one backend give equal bits.
        assert_eq!(number("from_original"), 0.0, "{key}");
    }
    assert!(rates >= 10, "{rates} ways");
    assert_eq!(missing_cells(&first), Vec::<String>::new());

    let (choices, said) = choices(&first);
    assert_eq!(choices, ["city/cpu/found culling", "room/cpu/found culling"], "{said}");
    assert!(report.contains("| city | cpu | engine, culling | "), "{report}");

    measured(line(&place, LINE), "0 cells");
    assert_eq!(study(&place), first);

    // A study of before choices were measured anew is read, and they are measured.
    let mut before = first.clone();
    let cells = before["cells"].as_object_mut().expect("cells");
    cells.retain(|_, cell| cell.get("choice").is_none());
    std::fs::write(place.path("study/study.json"), before.to_string()).expect("written");
    measured(line(&place, LINE), "2 cells");
    assert_eq!(keys(&study(&place)), keys(&first));

    // A cell that is gone is measured again, and no other; other settings have cells of their own.
    let mut less = first.clone();
    let cells = less["cells"].as_object_mut().expect("cells");
    let gone = keys(&first)
        .into_iter()
        .find(|key| key.ends_with("/city/cpu/ours"))
        .expect("a cell");
    cells.remove(&gone);
    assert_eq!(missing_cells(&less), ["city/cpu/ours"]);
    std::fs::write(place.path("study/study.json"), less.to_string()).expect("written");
    measured(line(&place, LINE), "1 cell");
    assert_eq!(keys(&study(&place)), keys(&first));
}

/// Choices that were held against others, each with times of both over the same rows, and what they are.
fn choices(study: &Value) -> (Vec<String>, String) {
    let mut found = Vec::new();
    let mut said = String::new();
    for (key, cell) in study["cells"].as_object().expect("cells") {
        let Some(choice) = cell.get("choice") else { continue };
        said.push_str(&format!("{key}: {choice}\n"));
        let others = choice["others"].as_array().expect("others");
        let is_time = |value: &Value| value.as_f64().is_some_and(|milliseconds| milliseconds > 0.0);
        let is_whole = (1..=4).contains(&others.len())
            && others.iter().all(|other| is_time(&other[1]))
            && is_time(&choice["found_milliseconds"])
            && choice["rows"].as_u64() >= choice["neighbours"].as_u64()
            && choice["neighbours"].as_u64() >= Some(16);
        if is_whole {
            let place = key.split_once('/').map_or(key.as_str(), |(_, place)| place);
            found.push(place.to_owned());
        }
    }
    (found, said)
}

/// Ways that every backend has, and are not there.
fn missing_cells(study: &Value) -> Vec<String> {
    let keys = keys(study);
    let wanted = ["city", "room"]
        .iter()
        .flat_map(|scene| ["original", "thesis", "ours"].map(|way| format!("{scene}/cpu/{way}")));
    wanted
        .filter(|wanted| !keys.iter().any(|key| key.ends_with(&format!("/{wanted}"))))
        .collect()
}

#[test]
fn what_cannot_be_measured_is_refused_by_name() {
    let place = Place::new();
    line(&place, "--quick -o s --backend cpu --scene atlantis")
        .is(2)
        .says(&["atlantis", "city-x16", "maze"]);
    line(&place, "--quick -o s --backend no-such-backend --scene city")
        .is(2)
        .says(&["no-such-backend"]);
    std::fs::create_dir(place.path("s2")).expect("a folder");
    std::fs::write(place.path("s2/study.json"), "{\"cells\": 3}").expect("written");
    line(&place, "--quick -o s2 --backend cpu --scene city")
        .is(2)
        .says(&["study.json", "no study"]);
    std::fs::write(place.path("peers.json"), "[]").expect("written");
    line(&place, "--quick -o s3 --backend cpu --scene city --peers peers.json")
        .is(2)
        .says(&["peers.json", "scripts/peers"]);
}
