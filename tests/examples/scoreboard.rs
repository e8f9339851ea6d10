//! The scoreboard of accuracy and cost over sixteen scenes and five accuracy levels.
//!
//! `scoreboard board [--bless] [SCENE…]` computes the rows, and prints error and cost beside the committed board, and
//! where asking for more gives less; `--bless` commits them: `tests/golden/board.csv`, and the tables of
//! docs/dev/scoreboard.md. `scoreboard golden [SCENE…]` traces the reference rows anew. `scoreboard rendering` prints
//! what rendering costs by what a backend counts. `scoreboard bits [--bless]` tells whether bits changed, and fails if so.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "an example prints")]

use hemicube::accuracy::correct::Correction;
use hemicube::backend::Counters;
use hemicube::driver::compute::Execution;
use hemicube_backend_cpu::CpuBackend;
use hemicube_tests::bits::Bits;
use hemicube_tests::board::{self, Cell, Level};
use hemicube_tests::golden::{self, Golden, scenes};
use hemicube_tests::rows::{parts, settings};
use std::time::Instant;

const USAGE: &str = "scoreboard board [--bless] [SCENE…] | golden [SCENE…] | bits [--bless] | rendering";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((command, rest)) = arguments.split_first() else {
        return Err(USAGE.into());
    };
    let (flags, names): (Vec<String>, Vec<String>) = rest.iter().cloned().partition(|word| word.starts_with("--"));
    let bless = match flags.as_slice() {
        [] => false,
        [flag] if flag == "--bless" => true,
        _ => return Err(USAGE.into()),
    };
    if let Some(name) = names.iter().find(|name| !scenes::NAMES.contains(&name.as_str())) {
        return Err(format!("`{name}` is no scene of the board: {}", scenes::NAMES.join(", ")).into());
    }
    match (command.as_str(), bless) {
        ("golden", false) => golden(&names),
        ("board", _) => whole_board(&names, bless),
        ("bits", _) => bits(bless),
        ("rendering", false) => rendering(&names),
        _ => Err(USAGE.into()),
    }
}

/// Computes the cells of the named scenes, or of all.
fn whole_board(names: &[String], bless: bool) -> Result<(), Box<dyn std::error::Error>> {
    let committed = board::committed().unwrap_or_default();
    let mut cells: Vec<Cell> = Vec::new();
    for name in scenes::NAMES {
        if !names.is_empty() && !names.iter().any(|chosen| chosen == name) {
            cells.extend(committed.iter().filter(|cell| cell.scene == name).cloned());
            continue;
        }
        let Some(ready) = scenes::ready(name) else {
            eprintln!("SKIP {name}: no ../shared/scenes; its committed figures stay");
            cells.extend(committed.iter().filter(|cell| cell.scene == name).cloned());
            continue;
        };
        let golden = Golden::read(&ready)?;
        let began = Instant::now();
        let new = Level::ALL.map(|level| board::measure(&ready, &golden, level, true).rounded());
        eprintln!("{name}: {:.1?}", began.elapsed());
        cells.extend(new);
    }
    println!("{}\n{}", board::table(&cells, &committed), board::summary(&cells));
    for cell in &cells {
        if let Some(old) = committed
            .iter()
            .find(|old| old.scene == cell.scene && old.level == cell.level)
        {
            board::worse(cell, old)
                .iter()
                .for_each(|line| println!("worse: {line}"));
        }
    }
    for (name, figures) in board::not_monotone(&cells) {
        println!("more asked, less had: {name} ({figures})");
    }
    if bless {
        board::commit(&cells)?;
    }
    Ok(())
}

/// Tells whether bits changed; with `bless`, commits them, unless an old program would have the new bits' name.
fn bits(bless: bool) -> Result<(), Box<dyn std::error::Error>> {
    let committed = std::fs::read_to_string(Bits::path()).unwrap_or_default();
    let (new, old) = (Bits::compute(), Bits::of_text(&committed));
    let changed = new.changed(&old);
    println!("{}", changed.as_deref().unwrap_or("bits changed: no"));
    if changed.is_some() && !bless {
        std::process::exit(1);
    }
    if bless {
        if !new.may_replace(&old) {
            return Err("not committed: `PROGRAM` in crates/store/src/lib.rs is not raised".into());
        }
        std::fs::write(Bits::path(), new.to_text())?;
    }
    Ok(())
}

/// Prints what a hemicube costs and counts, with pixel sums, which take little else.
fn rendering(names: &[String]) -> Result<(), Box<dyn std::error::Error>> {
    println!(
        "| scene | N | ns a hemicube | pixels | triangles drawn | nodes tested | steps |\n|---|---|---|---|---|---|---|"
    );
    for name in scenes::NAMES {
        let chosen = names.is_empty() || names.iter().any(|chosen| chosen == name);
        let Some(ready) = chosen.then(|| scenes::ready(name)).flatten() else {
            continue;
        };
        for resolution in [64, 128] {
            let plan = golden::plan(&ready.model).with_correction(Correction::Pixel);
            let execution = Execution {
                threads: 1,
                ..Execution::default()
            };
            // The least of several: others compute, too.
            let mut least = f64::INFINITY;
            let mut counters = Counters::default();
            for _ in 0..5 {
                let backend = Box::new(CpuBackend::new());
                let (_, summary) = parts(&ready.model, &plan, settings(resolution), backend, execution)?;
                least = least.min(summary.row_time.as_secs_f64());
                counters = summary.counters;
            }
            let hemicubes = counters.hemicubes as f64;
            println!(
                "| {name} | {resolution} | {:.0} | {} | {:.0} | {:.0} | {:.0} |",
                1e9 * least / hemicubes,
                3 * resolution * resolution,
                counters.triangles_drawn as f64 / hemicubes,
                counters.nodes_tested as f64 / hemicubes,
                board::steps_of_rendering(&counters, resolution) / hemicubes,
            );
        }
    }
    Ok(())
}

/// Traces and writes the reference rows of the named scenes, or of all.
fn golden(names: &[String]) -> Result<(), Box<dyn std::error::Error>> {
    for name in scenes::NAMES {
        if !names.is_empty() && !names.iter().any(|chosen| chosen == name) {
            continue;
        }
        let Some(ready) = scenes::ready(name) else {
            eprintln!("SKIP {name}: no ../shared/scenes");
            continue;
        };
        let began = Instant::now();
        let golden = Golden::trace(&ready, 1);
        let bytes = golden.pack();
        let path = Golden::path(name);
        std::fs::create_dir_all(path.parent().ok_or("a folder")?)?;
        std::fs::write(&path, &bytes)?;
        let entries: usize = golden.rows.iter().map(|row| row.columns.len()).sum();
        let worst = golden
            .rows
            .iter()
            .map(hemicube::reference::ReferenceRow::noise)
            .fold(0.0, f64::max);
        eprintln!(
            "{name}: {} patches, {} rows, {entries} entries, {} bytes, noise {:.5} (worst {worst:.5}), {} cut short, {:.1?}",
            ready.model.patches().len(),
            golden.rows.len(),
            bytes.len(),
            hemicube::reference::noise_of(&golden.rows),
            golden.rows.iter().filter(|row| row.cut_short).count(),
            began.elapsed(),
        );
    }
    Ok(())
}
