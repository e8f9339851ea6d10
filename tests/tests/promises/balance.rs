//! Balancing real matrices: a closed room becomes closed and reciprocal, small entries can go, and what that does to
//! the error against the reference is measured, not assumed.
//!
//! Its table: `cargo test --release -p hemicube-tests --test promises -- balance:: --ignored --nocapture`

use hemicube::accuracy::correct::{Correction, Refinement};
use hemicube::analysis::balance::{BalanceEntry, BalanceOptions, BalanceReport, balance};
use hemicube::analysis::check::{Check, CheckOptions, check};
use hemicube::backend::{Culling, RenderSettings};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection, compute};
use hemicube::reference::{EstimatedRow, Measured, Reference, ReferenceRow, ReferenceSettings, errors_against};
use hemicube::store::{BackendEntry, Header, PatchTable, SceneEntry, Store, StoreWriter, scene_hash};
use hemicube::{HierarchyOptions, Model};
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::generate::{Generate, Kind, generate};
use hemicube_scene::repair::{RepairOptions, repair};
use hemicube_scene::{InputPatch, Patches, Scene, Subdivision};
use hemicube_tests::scenes::{read, say, scenes_or_skip};
use std::path::Path;
use std::time::Instant;

/// A scene, what is rendered of it, and the table that its store has.
struct Subject {
    scene: Scene,
    table: PatchTable,
    model: Model,
}

impl Subject {
    fn new(mut scene: Scene, subdivision: Subdivision) -> Self {
        repair(&mut scene, RepairOptions::default());
        let patches = Patches::new(&scene, subdivision).expect("a scene that fits");
        Self {
            table: PatchTable::new(&scene, &patches),
            model: Model::new(patches.into(), HierarchyOptions::default()).expect("a scene with an extent"),
            scene,
        }
    }

    fn generated(kind: Kind, target_patches: u64) -> Self {
        let spec = Generate {
            kind,
            target_patches,
            seed: 1,
        };
        Self::new(generate(spec).expect("a target in range"), Subdivision::None)
    }

    /// Computes the whole matrix into a store.
    fn compute(&self, correction: Correction, resolution: u32, directory: &Path) -> Store {
        let plan = Plan::new(&self.model, RowChoice::All, Selection::default(), 1, true).with_correction(correction);
        let count = |number: usize| u32::try_from(number).expect("a small scene");
        let name = match correction {
            Correction::Pixel => "pixel",
            Correction::Tolerance(_) => "tolerance",
        };
        let header = Header {
            program: env!("CARGO_PKG_VERSION").to_owned(),
            scene: SceneEntry {
                file: "scene".to_owned(),
                blake3: scene_hash(&self.scene, self.model.patches()),
            },
            settings: serde_json::json!({ "correction": name, "resolution": resolution }),
            correction: name.to_owned(),
            patch_count: count(self.model.patches().len()),
            row_count: count(plan.rows.len()),
            rows_per_part: plan.rows_per_part,
            form: hemicube::store::Form::Plain,
            min_factor: 0.0,
            backend: BackendEntry {
                name: "cpu".to_owned(),
                version: "1".to_owned(),
            },
            objects: self.scene.objects.clone(),
            materials: self.scene.materials.iter().map(|m| m.name.clone()).collect(),
        };
        let mut writer = StoreWriter::create(directory, header, &self.table, false).expect("a place for the store");
        let settings = RenderSettings {
            resolution,
            culling: Culling::On,
            covered: false,
        };
        let backend = Box::new(CpuBackend::new());
        let execution = Execution::default();
        compute(
            &self.model,
            &plan,
            settings,
            backend,
            execution,
            &mut writer,
            &mut |_| {},
        )
        .expect("rows");
        writer.finish().expect("a whole store");
        Store::open(directory).expect("the store")
    }
}

fn within() -> Correction {
    Correction::Tolerance(Refinement::for_tolerance(0.02))
}

fn closure() -> BalanceOptions {
    BalanceOptions {
        closure: true,
        ..BalanceOptions::default()
    }
}

fn balanced(store: &Store, output: &Path, options: &BalanceOptions) -> (Store, BalanceReport) {
    let report = balance(store, output, options).expect("a balanced matrix");
    (Store::open(output).expect("the balanced store"), report)
}

/// How far rows of a store are from the reference's.
fn error_of(store: &Store, exact: &[ReferenceRow]) -> Measured {
    let rows: Vec<EstimatedRow> = exact
        .iter()
        .map(|row| {
            let found = store
                .row(InputPatch(row.emitter))
                .expect("a sound store")
                .expect("a row");
            EstimatedRow {
                emitter: InputPatch(row.emitter),
                columns: found.indices,
                values: found.data.into_f64(),
            }
        })
        .collect();
    errors_against(exact, &rows)
}

/// `count` sampled rows of the reference.
fn reference(subject: &Subject, count: u32) -> Vec<ReferenceRow> {
    let choice = RowChoice::Sample { count, seed: 777 };
    let plan = Plan::new(&subject.model, choice, Selection::default(), 1, true);
    let settings = ReferenceSettings {
        target: 2e-3,
        ..ReferenceSettings::default()
    };
    let reference = Reference::new(&subject.model, settings).expect("settings in range");
    reference.rows(&plan.rows, 2, &mut |_| {}).expect("rows of the scene")
}

fn figures_of(entry: &BalanceEntry) -> String {
    format!(
        "{:.1e} {:.1e} | {:.3} {:.1e} → {:.1e} {:.1e} | {:.1e} {:.1e} | {} sweeps, at bound {}, empty {}, no target {}, one-sided {:.1} %, d² {:.2}–{:.2}, entries {} → {}, dropped {:.4}",
        entry.before.closure_max,
        entry.before.closure_rms,
        entry.before.reciprocity,
        entry.before.reciprocity_worst,
        entry.after.closure_max,
        entry.after.closure_rms,
        entry.after.reciprocity,
        entry.after.reciprocity_worst,
        entry.sweeps,
        entry.rows_at_bound,
        entry.rows_empty,
        entry.rows_without_target,
        100.0 * entry.pairs_one_sided as f64 / entry.pairs.max(1) as f64,
        entry.scale_min,
        entry.scale_max,
        entry.entries_before,
        entry.entries_after,
        entry.mass_dropped,
    )
}

#[test]
#[ignore = "a measurement of some minutes, for the documentation"]
fn what_balancing_does_to_the_error() {
    let mut subjects = vec![
        ("room 10,240", Subject::generated(Kind::Room, 10_240)),
        ("city 9k", Subject::generated(Kind::City, 9_000)),
        ("block city 9k", Subject::generated(Kind::BlockCity, 9_000)),
    ];
    if let Some(folder) = scenes_or_skip("what_balancing_does_to_the_error") {
        let scene = read(&folder, "city/denhaag-8897.obj").expect("the tile");
        subjects.push(("denhaag-8897", Subject::new(scene, Subdivision::None)));
    }
    for (name, subject) in &subjects {
        let exact = reference(subject, 32);
        for (rung, correction, resolution) in [("pixel", Correction::Pixel, 256), ("tolerance 2 %", within(), 128)] {
            let place = tempfile::tempdir().expect("a temporary directory");
            let store = subject.compute(correction, resolution, &place.path().join("raw"));
            let raw = error_of(&store, &exact);
            say(&format!(
                "| {name} | {rung} | as computed | {:.4} | {:.4} | {:.4} | {:.4} | noise {:.4} |",
                raw.relative_frobenius,
                raw.row_error.median,
                raw.row_l1.median,
                raw.row_sum_error.mean,
                raw.reference_noise,
            ));
            let cases = [
                ("reciprocity", false, 0.0),
                ("closure", true, 0.0),
                ("min-factor 1e-5", false, 1e-5),
                ("closure, min-factor 1e-5", true, 1e-5),
            ];
            for (number, (case, closes, min_factor)) in cases.into_iter().enumerate() {
                let options = BalanceOptions {
                    closure: closes,
                    reciprocity: number == 0,
                    min_factor,
                    ..BalanceOptions::default()
                };
                let output = place.path().join(number.to_string());
                let start = Instant::now();
                let (store, report) = balanced(&store, &output, &options);
                let took = start.elapsed().as_secs_f64();
                let error = error_of(&store, &exact);
                say(&format!(
                    "| {name} | {rung} | {case} | {:.4} | {:.4} | {:.4} | {:.4} | {took:.1} s | {} |",
                    error.relative_frobenius,
                    error.row_error.median,
                    error.row_l1.median,
                    error.row_sum_error.mean,
                    figures_of(&report.balance),
                ));
            }
        }
    }
}

#[test]
fn a_closed_room_becomes_closed_and_reciprocal() {
    let subject = Subject::generated(Kind::Room, 640);
    let place = tempfile::tempdir().expect("a temporary directory");
    let store = subject.compute(within(), 64, &place.path().join("raw"));
    let before = check(&store, &CheckOptions::default()).expect("a readable store");
    // Only a broken matrix can be repaired.
    assert!(before.closure.max > 1e-3, "{:?}", before.closure);
    assert!(before.reciprocity.residual > 1e-3, "{:?}", before.reciprocity);
    let (store, report) = balanced(&store, &place.path().join("balanced"), &closure());
    let found = &report.balance;
    assert!(found.converged, "{found:?}");
    // Patches at the foot of a block are half inside it, and one hemicube says all or nothing; they cannot be closed.
    let hopeless = found.rows_at_bound + found.rows_without_target;
    assert!(hopeless <= 16 && found.rows_empty == 0, "{found:?}");
    assert!(found.closure_max_of_others < 2e-6, "{found:?}");
    let bounds = CheckOptions {
        closure: Some(2e-6),
        reciprocity: Some(1e-6),
        ..CheckOptions::default()
    };
    let after = check(&store, &bounds).expect("a readable store");
    let failures: Vec<(Check, u64)> = after.failures.iter().map(|f| (f.check, f.count)).collect();
    let open: Vec<_> = (hopeless > 0)
        .then_some((Check::Closure, hopeless))
        .into_iter()
        .collect();
    assert_eq!(failures, open, "every other row closes, and all pairs agree");
}
