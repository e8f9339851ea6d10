//! What it costs to make form factors of weights, and what the closed form's own error is: `convert [ROWS [N
//! [SCENE…]]]`.
//!
//! Rows are rendered once; a backend that only hands them out then stands in for the renderer, so that what its thread
//! spends is the conversion. Times are processor time of that thread, the best of several in turns.
#![allow(clippy::print_stdout, reason = "an example prints")]

mod clock;

use clock::thread_seconds;
use hemicube::accuracy::correct::Correction;
use hemicube::backend::{
    BackendError, BackendInfo, Counters, Culling, Geometry, Hemicube, HemicubeBackend, RenderSettings,
};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection, compute};
use hemicube::factor::FactorRule;
use hemicube::row::RowBlock;
use hemicube::store::Part;
use hemicube::{HierarchyOptions, Model};
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::generate::{BlockCityParameters, Generate, Kind, cornell_box, generate};
use hemicube_scene::{Patches, Scene, Subdivision};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

const TURNS: usize = 5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let rows: u32 = args.next().map_or(Ok(512), |a| a.parse())?;
    let resolution: u32 = args.next().map_or(Ok(128), |a| a.parse())?;
    let chosen: Vec<String> = args.collect();
    let corrections = [
        Correction::Pixel,
        Correction::Point,
        Correction::Area(FactorRule::for_tolerance(1e-2)),
        Correction::Area(FactorRule::for_tolerance(1e-3)),
        Correction::Area(FactorRule::for_tolerance(1e-4)),
    ];
    println!("N = {resolution}, {rows} rows, one thread; ms a row, and ns a pair more than `pixel`");
    println!(
        "| scene | pairs a row | pixel | point | area, 1 % | area, 0.1 % | area, 0.01 % | error of 1 % | of 0.1 % |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for (name, scene, subdivision) in scenes()? {
        if !chosen.is_empty() && chosen.iter().all(|c| c != name) {
            continue;
        }
        let model = Model::new(Patches::new(&scene, subdivision)?.into(), HierarchyOptions::default())?;
        let choice = RowChoice::Sample { count: rows, seed: 1 };
        let mut plan = Plan::new(&model, choice, Selection::default(), 1, true);
        let settings = RenderSettings {
            resolution,
            culling: Culling::On,
            covered: true,
        };
        // Odd rows would be rendered again, and their time is not what is asked for.
        let strictest = plan.clone().with_correction(corrections[4]);
        let mut first: Vec<Part> = Vec::new();
        let one_thread = Execution {
            threads: 1,
            ..Execution::default()
        };
        let backend = Box::new(CpuBackend::new());
        compute(
            &model,
            &strictest,
            settings,
            backend,
            one_thread,
            &mut first,
            &mut |_| {},
        )?;
        let hemicubes_of_row = first.iter().flat_map(|part| &part.hemicubes);
        plan.rows = plan
            .rows
            .iter()
            .zip(hemicubes_of_row)
            .filter(|(_, n)| **n == 1)
            .map(|(&p, _)| p)
            .collect();
        // One call of the backend for all rows: processor time is read once before and once after.
        plan.rows_per_part = u32::try_from(plan.rows.len())?;
        let hemicubes: Vec<Hemicube> = plan.rows.iter().flat_map(|&p| model.hemicubes(p, 1, true)).collect();
        let mut block = RowBlock::default();
        let mut renderer = CpuBackend::new();
        renderer.load(model.geometry(), settings)?;
        renderer.rows(&hemicubes, &mut block)?;
        let block = Arc::new(block);

        let mut best = [f64::INFINITY; 5];
        let mut parts = [(); 5].map(|()| Vec::<Part>::new());
        for _ in 0..TURNS {
            for (k, &correction) in corrections.iter().enumerate() {
                parts[k].clear();
                let spent = Arc::new(Mutex::new(Spent::default()));
                let backend = Box::new(Replay {
                    info: renderer.info().clone(),
                    renderer: renderer.fork()?,
                    rows: block.clone(),
                    spent: spent.clone(),
                });
                let execution = Execution {
                    batch: plan.rows.len(),
                    ..one_thread
                };
                let plan = plan.clone().with_correction(correction);
                compute(&model, &plan, settings, backend, execution, &mut parts[k], &mut |_| {})?;
                let spent = spent.lock().map_err(|e| e.to_string())?;
                best[k] = best[k].min(spent.end - spent.start);
            }
        }
        let (rows, pairs) = (plan.rows.len() as f64, block.patches.len() as f64);
        let cell = |k: usize| format!("{:.3} ({:.0})", 1e3 * best[k] / rows, 1e9 * (best[k] - best[0]) / pairs);
        println!(
            "| {name} | {:.0} | {:.3} | {} | {} | {} | {} | {:.1e} | {:.1e} |",
            pairs / rows,
            1e3 * best[0] / rows,
            cell(1),
            cell(2),
            cell(3),
            cell(4),
            relative_frobenius(&parts[2], &parts[4]),
            relative_frobenius(&parts[3], &parts[4]),
        );
    }
    Ok(())
}

type Named = (&'static str, Scene, Subdivision);

fn scenes() -> Result<Vec<Named>, Box<dyn std::error::Error>> {
    let city = |split| {
        BlockCityParameters {
            blocks: 25,
            split,
            ..BlockCityParameters::for_target(1000, 1)
        }
        .generate()
    };
    let spheres = Generate {
        kind: Kind::Spheres,
        target_patches: 10_000,
        seed: 1,
    };
    Ok(vec![
        ("room-10k", cornell_box(), Subdivision::Levels(4)),
        ("block-city-9k", city(1)?, Subdivision::None),
        ("block-city-140k", city(4)?, Subdivision::None),
        ("spheres-10k", generate(spheres)?, Subdivision::None),
    ])
}

/// √(Σ (F − exact F)² / Σ exact F²).
fn relative_frobenius(found: &[Part], exact: &[Part]) -> f64 {
    let (mut difference, mut norm) = (0.0, 0.0);
    for (found, exact) in found.iter().zip(exact) {
        for row in 0..exact.rows.len() {
            let mut columns: BTreeMap<i32, (f64, f64)> = BTreeMap::new();
            let ((found_columns, found_values), (exact_columns, exact_values)) = (found.row(row), exact.row(row));
            for (&column, value) in found_columns.iter().zip(found_values) {
                columns.entry(column).or_default().0 = value;
            }
            for (&column, value) in exact_columns.iter().zip(exact_values) {
                columns.entry(column).or_default().1 = value;
            }
            for (found, exact) in columns.values() {
                difference += (found - exact) * (found - exact);
                norm += exact * exact;
            }
        }
    }
    (difference / norm).sqrt()
}

/// Processor time of the driver's thread when it got its rows, later by what was rendered since, and when it was done.
#[derive(Debug, Default)]
struct Spent {
    start: f64,
    end: f64,
}

/// Hands out rows that were rendered before.
struct Replay {
    info: BackendInfo,
    /// For rows that only the rule in hand finds odd.
    renderer: Box<dyn HemicubeBackend>,
    rows: Arc<RowBlock>,
    spent: Arc<Mutex<Spent>>,
}

impl HemicubeBackend for Replay {
    fn info(&self) -> &BackendInfo {
        &self.info
    }

    fn load(&mut self, _: &Arc<Geometry>, _: RenderSettings) -> Result<(), BackendError> {
        Ok(())
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        Err(BackendError::Unsupported("replayed rows are for one thread".to_owned()))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        if hemicubes.len() != self.rows.len() {
            let before = thread_seconds();
            let counters = self.renderer.rows(hemicubes, out);
            if let Ok(mut spent) = self.spent.lock() {
                spent.start += thread_seconds() - before;
            }
            return counters;
        }
        out.clone_from(&self.rows);
        if let Ok(mut spent) = self.spent.lock() {
            spent.start = thread_seconds();
        }
        Ok(Counters::default())
    }
}

impl Drop for Replay {
    fn drop(&mut self) {
        // The driver drops a backend on the thread that used it.
        if let Ok(mut spent) = self.spent.lock() {
            spent.end = thread_seconds();
        }
    }
}
