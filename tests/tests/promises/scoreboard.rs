//! The scoreboard's test: reference rows are what the reference says, no figure is worse than committed, and who asks
//! for more gets more.

use hemicube_tests::board::{self, Cell, Level};
use hemicube_tests::golden::scenes::{self, NAMES, Ready};
use hemicube_tests::golden::{Golden, disagreement, plan, trace_again};
use hemicube_tests::scenes::{say, skip};
use std::collections::BTreeSet;

/// Milliseconds of processor time, by the committed times, within which cells are computed anew: the dear ones, most of
/// which settle for seconds, are left to `scoreboard board`, or to `HEMICUBE_BOARD=all`.
const BUDGET: f64 = 60_000.0;

/// A scene, or a skip.
fn ready(test: &str, name: &'static str) -> Option<Ready> {
    let ready = scenes::ready(name);
    if ready.is_none() {
        skip(
            test,
            &format!("no scene `{name}` in ../shared/scenes"),
            "HEMICUBE_REQUIRE_SCENES",
        );
    }
    ready
}

/// By other random numbers and three times the error: the mean squared difference in its own variances is about 1.
#[test]
fn reference_rows_are_what_the_reference_says() {
    // Half as much again: entries' variances are themselves estimates, from eight batches and few hits.
    const MOST: f64 = 2.0;
    for name in NAMES {
        let Some(ready) = ready("reference_rows_are_what_the_reference_says", name) else {
            continue;
        };
        let golden = Golden::read(&ready).unwrap_or_else(|stale| panic!("{name}: {stale}"));
        // Two that cost little: rows that took more rays than others are dear here, too.
        let mut cheapest: Vec<_> = golden.rows.iter().filter(|row| !row.values.is_empty()).collect();
        cheapest.sort_by_key(|row| row.rays);
        let sampled: Vec<_> = cheapest
            .iter()
            .step_by(cheapest.len().div_ceil(4).max(1))
            .take(2)
            .copied()
            .cloned()
            .collect();
        let emitters: Vec<_> = sampled.iter().map(|row| hemicube::InputPatch(row.emitter)).collect();
        let again = trace_again(&ready, &emitters, 3e-3, 991);
        let off = disagreement(&sampled, &again);
        say(&format!(
            "{name}: {} rows by other rays differ by {off:.2} of their variances",
            again.len()
        ));
        assert!(!again.is_empty() && off < MOST, "{name}: {off}");
        // The same rows with a column exchanged, or 2 % more, are none of the reference.
        let mut altered = sampled.clone();
        for row in &mut altered {
            row.values.iter_mut().for_each(|value| *value *= 1.02);
        }
        let off = disagreement(&altered, &again);
        assert!(off > MOST, "{name}: 2 % more would pass: {off}");
    }
}

#[test]
fn the_command_makes_the_same_rows_again() {
    let Some(ready) = ready("the_command_makes_the_same_rows_again", "sealed") else {
        return;
    };
    let golden = Golden::read(&ready).unwrap_or_else(|stale| panic!("{stale}"));
    let again = Golden::trace(&ready, 0);
    let off = disagreement(&golden.rows, &again.rows);
    assert!(off < 1e-3, "{off}");
    if cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        assert!(
            again.pack() == std::fs::read(Golden::path("sealed")).expect("a file"),
            "other bytes"
        );
    }
}

#[test]
fn rows_of_another_scene_or_reference_are_stale() {
    let Some(sealed) = ready("rows_of_another_scene_or_reference_are_stale", "sealed") else {
        return;
    };
    let golden = Golden::read(&sealed).unwrap_or_else(|stale| panic!("{stale}"));
    assert_eq!(golden.rows.len(), plan(&sealed.model).rows.len());
    type Change = fn(&mut Golden);
    let changes: [(&str, Change); 4] = [
        ("the version", |golden| golden.version += 1),
        ("hash", |golden| golden.hash = golden.hash.replace('a', "b")),
        ("settings", |golden| golden.settings.push('0')),
        ("patches", |golden| golden.rows[1].emitter += 1),
    ];
    for (word, change) in changes {
        let mut other = golden.clone();
        change(&mut other);
        let stale = other.fits(&sealed).expect_err(word).to_string();
        assert!(
            stale.contains(word) && stale.contains("scoreboard -- golden"),
            "{stale}"
        );
    }
}

/// The committed board, with the cells that the budget allows computed anew.
#[test]
fn nothing_is_worse_than_committed_and_who_asks_for_more_gets_more() {
    const TEST: &str = "nothing_is_worse_than_committed_and_who_asks_for_more_gets_more";
    let committed = board::committed().unwrap_or_else(|error| panic!("{error}"));
    let all = std::env::var("HEMICUBE_BOARD").is_ok_and(|word| word == "all");
    let chosen = board::within_budget(&committed, if all { f64::INFINITY } else { BUDGET });
    let mut cells = committed.clone();
    let (mut count, mut faults) = (0, Vec::new());
    for name in NAMES {
        let levels: Vec<&Cell> = chosen.iter().filter(|cell| cell.scene == name).copied().collect();
        if levels.is_empty() {
            continue;
        }
        let Some(ready) = ready(TEST, name) else { continue };
        let golden = Golden::read(&ready).unwrap_or_else(|stale| panic!("{name}: {stale}"));
        for old in levels {
            let level = Level::of(&old.level).expect("a level of the board");
            let new = board::measure(&ready, &golden, level, false).rounded();
            faults.extend(board::worse(&new, old));
            if !board::worse(old, &new).is_empty() {
                say(&format!("better: {}", board::worse(old, &new).join(", ")));
            }
            let place = cells
                .iter()
                .position(|cell| cell.scene == name && cell.level == old.level);
            cells[place.expect("a cell of the board")] = new;
            count += 1;
        }
    }
    let left: Vec<String> = committed
        .iter()
        .filter(|cell| !chosen.iter().any(|own| std::ptr::eq(*own, *cell)))
        .map(|cell| format!("{} {}", cell.scene, cell.level))
        .collect();
    say(&format!(
        "{count} of {} cells computed; as committed: {}",
        committed.len(),
        left.join(", ")
    ));
    assert!(count > 0, "nothing was computed");
    let failures = board::not_monotone(&cells);
    let found: BTreeSet<String> = failures.keys().cloned().collect();
    let expected = board::expected_failures().unwrap_or_else(|error| panic!("{error}"));
    for name in found.difference(&expected) {
        faults.push(format!("more asked, less had: {name} ({})", failures[name]));
    }
    for name in expected.difference(&found) {
        faults.push(format!(
            "`{name}` holds now: take its line from tests/golden/expected-failures.txt"
        ));
    }
    let bless = "`cargo run --release -p hemicube-tests --example scoreboard -- board --bless` commits other figures";
    assert!(faults.is_empty(), "{bless}\n  {}", faults.join("\n  "));
}

#[test]
fn the_board_is_whole_and_its_page_has_its_figures() {
    let committed = board::committed().unwrap_or_else(|error| panic!("{error}"));
    let names: Vec<(String, String)> = committed.iter().map(|c| (c.scene.clone(), c.level.clone())).collect();
    let whole: Vec<(String, String)> = NAMES
        .iter()
        .flat_map(|scene| Level::ALL.map(|level| ((*scene).to_owned(), level.name())))
        .collect();
    assert_eq!(names, whole);
    let page = std::fs::read_to_string(board::page()).expect("the board's page");
    assert!(
        board::page_with(&page, &committed).expect("a page with a board") == page,
        "docs/dev/scoreboard.md has other figures than tests/golden/board.csv: `scoreboard board --bless` writes both"
    );
    let mut other = committed;
    other[5].steps *= 1.5;
    assert!(board::page_with(&page, &other).expect("a page with a board") != page);
}
