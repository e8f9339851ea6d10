//! Error against cost of every rung of the accuracy ladder: `accuracy [ROWS]`, sampled rows of five scenes held against the
//! reference by rays. Prints the table of docs/accuracy.md.
#![allow(clippy::print_stdout, reason = "an example prints")]

use hemicube::backend::{Culling, RenderSettings};
use hemicube::compute::{Execution, Plan, RowChoice, Selection, compute};
use hemicube::correct::{Correction, Refinement};
use hemicube::factor::FactorRule;
use hemicube::reference::{EstimatedRow, Reference, ReferenceSettings, errors_against, noise_of};
use hemicube::store::Part;
use hemicube::{HierarchyOptions, Model};
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::generate::{BlockCityParameters, cornell_box};
use hemicube_scene::repair::{RepairOptions, repair};
use hemicube_scene::{Patches, ReadOptions, Scene, Subdivision, load};

/// A rung: its name, the correction, N, and n of n² hemicubes.
const RUNGS: [(&str, Rung, u32, u32); 9] = [
    ("pixel, K = 1, N = 256", Rung::Pixel, 256, 1),
    ("pixel, K = 16, N = 256", Rung::Pixel, 256, 4),
    ("area, K = 1, N = 64", Rung::Area, 64, 1),
    ("area, K = 1, N = 128", Rung::Area, 128, 1),
    ("area, K = 4, N = 128", Rung::Area, 128, 2),
    ("area, K = 16, N = 128", Rung::Area, 128, 4),
    ("tolerance 1 %, N = 128", Rung::Tolerance(1e-2), 128, 1),
    ("tolerance 0.3 %, N = 128", Rung::Tolerance(3e-3), 128, 1),
    ("tolerance 0.1 %, N = 128", Rung::Tolerance(1e-3), 128, 1),
];

#[derive(Clone, Copy)]
enum Rung {
    Pixel,
    Area,
    Tolerance(f64),
}

fn scenes() -> Vec<(&'static str, Scene, Subdivision)> {
    let block_city = |split| {
        let parameters = BlockCityParameters {
            blocks: 25,
            split,
            ..BlockCityParameters::for_target(1000, 1)
        };
        parameters.generate().expect("a city")
    };
    let mut scenes = vec![
        ("room 10k", cornell_box(), Subdivision::Levels(4)),
        ("block city 9k", block_city(1), Subdivision::None),
        ("block city 140k", block_city(4), Subdivision::None),
    ];
    let tile = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../../shared/scenes/city/denhaag-8897.obj"
    );
    match load(tile.as_ref(), ReadOptions::default()) {
        Ok(scene) => {
            scenes.push(("denhaag-8897", scene.clone(), Subdivision::None));
            scenes.push(("denhaag-8897 ×16", scene, Subdivision::Levels(2)));
        }
        Err(_) => println!("SKIP denhaag-8897: no ../shared/scenes"),
    }
    scenes
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let rows = std::env::args().nth(1).map_or(Ok(32), |a| a.parse())?;
    println!("| scene | rung | ms a row | relative Frobenius | median row | 90th percentile | median L1 | row sums |");
    println!("|---|---|---|---|---|---|---|---|");
    for (name, mut scene, subdivision) in scenes() {
        repair(&mut scene, RepairOptions::default());
        let model = Model::new(Patches::new(&scene, subdivision)?.into(), HierarchyOptions::default())?;
        let choice = RowChoice::Sample { count: rows, seed: 777 };
        let plan = Plan::new(&model, choice, Selection::default(), 1, true);
        let reference = Reference::new(
            &model,
            ReferenceSettings {
                target: 2e-3,
                ..ReferenceSettings::default()
            },
        )?;
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let exact = reference.rows(&plan.rows, threads, &mut |_| {})?;
        for (rung, kind, resolution, samples) in RUNGS {
            let correction = match kind {
                Rung::Pixel => Correction::Pixel,
                Rung::Area => Correction::Area(FactorRule::for_tolerance(1e-2)),
                Rung::Tolerance(tolerance) => Correction::Tolerance(Refinement::for_tolerance(tolerance)),
            };
            let plan = Plan::new(&model, choice, Selection::default(), samples, true).with_correction(correction);
            let settings = RenderSettings {
                resolution,
                culling: Culling::On,
                covered: false,
            };
            let mut best = f64::INFINITY;
            let mut parts: Vec<Part> = Vec::new();
            for _ in 0..3 {
                parts.clear();
                let execution = Execution {
                    threads: 1,
                    ..Execution::default()
                };
                let backend = Box::new(CpuBackend::new());
                let summary = compute(&model, &plan, settings, backend, execution, &mut parts, &mut |_| {})?;
                best = best.min(summary.elapsed.as_secs_f64() / plan.rows.len() as f64);
            }
            let estimated: Vec<EstimatedRow> = parts.iter().flat_map(EstimatedRow::of_part).collect();
            let m = errors_against(&exact, &estimated);
            println!(
                "| {name} | {rung} | {:.2} | {:.4} | {:.4} | {:.4} | {:.4} | {:.4} |",
                best * 1e3,
                m.relative_frobenius,
                m.row_error.median,
                m.row_error.percentile_90,
                m.row_l1.median,
                m.row_sum_error.mean,
            );
        }
        println!(
            "| {name} | *the reference's own noise* | | {:.4} | | | | |",
            noise_of(&exact)
        );
    }
    Ok(())
}
