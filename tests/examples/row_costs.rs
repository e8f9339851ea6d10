//! Prints what a row costs by rung, for every scene of the folder of real scenes: milliseconds on one thread, over a
//! seeded sample of rows and the rows of the largest patches; the slowest row, and its share of a whole run's time.
//!
//! `row_costs [ROWS [SCENE…]]`: ROWS of the sample (default 200); SCENE is a path below the folder of real scenes or
//! any other path. With `RUNGS=WORD,WORD`, only those of pixel, default (2 %), tolerance (1 %). Memory, and time a rung (a
//! minute or so), are bounded by the number of rows.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "an example prints")]

use hemicube::accuracy::correct::Correction;
use hemicube::backend::{Culling, RenderSettings};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection, compute};
use hemicube::driver::level::DEFAULT_TOLERANCE;
use hemicube::store::Part;
use hemicube::{InputPatch, Model};
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::{ReadOptions, Scene, Subdivision, load};
use hemicube_tests::rows::Rung;
use hemicube_tests::scenes::{model, read, scenes_or_skip};
use std::path::Path;
use std::time::{Duration, Instant};

const SEED: u64 = 1;
/// Rows of the largest patches that are always among those measured.
const LARGEST: usize = 8;

struct Cost {
    /// Of the sample's rows alone.
    per_row: f64,
    slowest: (InputPatch, f64),
    /// Of the largest patches' rows.
    largest: f64,
    settling: f64,
    hemicubes: u64,
    cut_short: u64,
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let rows = arguments
        .first()
        .map_or(200, |rows| rows.parse().expect("a number of rows"));
    let names: Vec<String> = match arguments.get(1..) {
        Some(names) if !names.is_empty() => names.to_vec(),
        _ => all_scenes(),
    };
    let rungs = std::env::var("RUNGS").unwrap_or_else(|_| "pixel,default,tolerance".into());
    println!(
        "| scene | patches | rung | settle, s | ms a row | slowest row, s | its share of a run, % | hemicubes | cut short |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for name in names {
        let Some(scene) = open(&name) else { continue };
        let model = model(scene, Subdivision::None);
        let patches = model.patches().len();
        for rung in rungs.split(',') {
            let cost = measure(&model, rung, rows);
            let others = (patches as f64 - LARGEST as f64).max(0.0);
            let run = cost.per_row * others + cost.largest;
            println!(
                "| {name} | {patches} | {rung} | {:.2} | {:.3} | {:.3} ({}) | {:.2} | {} | {} |",
                cost.settling,
                1e3 * cost.per_row,
                cost.slowest.1,
                cost.slowest.0.0,
                100.0 * cost.slowest.1 / run,
                cost.hemicubes,
                cost.cut_short,
            );
        }
    }
}

fn open(name: &str) -> Option<Scene> {
    let found = match scenes_or_skip(name) {
        Some(folder) if folder.join(name).exists() || folder.join(format!("{name}.zst")).exists() => {
            read(&folder, name)
        }
        _ => load(Path::new(name), ReadOptions::default()),
    };
    found.map_err(|error| eprintln!("{name}: {error}")).ok()
}

/// Those of the manifest, by path, that have triangles.
fn all_scenes() -> Vec<String> {
    let Some(folder) = scenes_or_skip("row_costs") else {
        return Vec::new();
    };
    let manifest = std::fs::read_to_string(folder.join("manifest.tsv")).expect("the manifest");
    let mut names: Vec<String> = manifest
        .lines()
        .skip(1)
        .filter_map(|line| {
            let mut fields = line.split('\t');
            let (path, _bytes, triangles) = (fields.next()?, fields.next()?, fields.next()?);
            (triangles.parse::<u64>().is_ok_and(|count| count > 0)).then(|| path.to_owned())
        })
        .collect();
    names.sort();
    names
}

fn measure(model: &Model, rung: &str, rows: usize) -> Cost {
    let began = Instant::now();
    let (correction, resolution) = match rung {
        "pixel" => (Correction::Pixel, 256),
        "default" | "tolerance" => {
            let rung = Rung::settled(model, if rung == "default" { DEFAULT_TOLERANCE } else { 0.01 });
            (rung.correction, rung.resolution)
        }
        other => panic!("`{other}` is no rung"),
    };
    let settling = began.elapsed().as_secs_f64();
    correction.prepare(model);
    let render = RenderSettings {
        resolution,
        culling: Culling::On,
        covered: false,
    };
    let count = u32::try_from(rows).unwrap_or(u32::MAX);
    let sampled = Plan::new(
        model,
        RowChoice::Sample { count, seed: SEED },
        Selection::default(),
        1,
        true,
    );
    let sampled = sampled.with_correction(correction);
    let largest = Plan {
        rows: largest(model),
        ..sampled.clone()
    };
    let mut done = [sampled, largest].map(|plan| {
        let execution = Execution {
            threads: 1,
            ..Execution::default()
        };
        let mut parts = Vec::<Part>::new();
        let summary = compute(
            model,
            &plan,
            render,
            Box::new(CpuBackend::new()),
            execution,
            &mut parts,
            &mut |_| {},
        );
        summary.unwrap_or_else(|error| panic!("{error}"))
    });
    let seconds = |took: Duration| took.as_secs_f64();
    let slowest = done
        .iter_mut()
        .filter_map(|summary| summary.slowest)
        .max_by_key(|slowest| slowest.1);
    Cost {
        per_row: seconds(done[0].row_time) / done[0].rows.max(1) as f64,
        slowest: slowest.map_or((InputPatch(0), 0.0), |(patch, took)| (patch, seconds(took))),
        largest: seconds(done[1].row_time),
        settling,
        hemicubes: done.iter().map(|summary| summary.hemicubes).sum(),
        cut_short: done.iter().map(|summary| summary.cut_short).sum(),
    }
}

/// The largest patches, the largest first.
fn largest(model: &Model) -> Vec<InputPatch> {
    let mut order: Vec<InputPatch> = model.order().collect();
    order.sort_by(|&p, &q| model.patches().area(q).total_cmp(&model.patches().area(p)));
    order.truncate(LARGEST);
    order
}
