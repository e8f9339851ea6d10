//! Rows of patches that much stands on: a city on a ground of two triangles. They end, are near the reference, and say
//! so where their bound on work ended them.

use glam::DVec3;
use hemicube::backend::{Culling, RenderSettings};
use hemicube::driver::compute::{Execution, Plan, Summary, compute};
use hemicube::reference::{Reference, ReferenceRow, ReferenceSettings};
use hemicube::store::Part;
use hemicube::{InputPatch, Model};
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::Subdivision;
use hemicube_tests::geometry::{quad, scene_of};
use hemicube_tests::rows::{Rung, plan};
use hemicube_tests::scenes::{model, read, say, scenes_or_skip};

/// Houses in a square grid on a ground of two triangles, patches 0 and 1.
fn city(side: u32) -> Model {
    let p = DVec3::new;
    let size = 20.0 * f64::from(side);
    let mut triangles = quad([p(0., 0., 0.), p(size, 0., 0.), p(size, size, 0.), p(0., size, 0.)]).to_vec();
    for k in 0..side * side {
        let (x, y) = (20.0 * f64::from(k % side) + 4.3, 20.0 * f64::from(k / side) + 5.1);
        let (u, v, h) = (x + 9.0, y + 11.0, 6.0 + f64::from(k * 7 % 11));
        for wall in [
            [p(x, y, 0.), p(u, y, 0.), p(u, y, h), p(x, y, h)],
            [p(u, y, 0.), p(u, v, 0.), p(u, v, h), p(u, y, h)],
            [p(u, v, 0.), p(x, v, 0.), p(x, v, h), p(u, v, h)],
            [p(x, v, 0.), p(x, y, 0.), p(x, y, h), p(x, v, h)],
            [p(x, y, h), p(u, y, h), p(u, v, h), p(x, v, h)],
        ] {
            triangles.extend(quad(wall));
        }
    }
    model(scene_of(triangles), Subdivision::None)
}

fn rows_of(model: &Model, rung: Rung, rows: &[u32]) -> (Vec<Part>, Summary) {
    let plan = Plan {
        rows: rows.iter().copied().map(InputPatch).collect(),
        ..plan(model).with_correction(rung.correction)
    };
    let render = RenderSettings {
        resolution: rung.resolution,
        culling: Culling::On,
        covered: false,
    };
    let mut parts = Vec::<Part>::new();
    let backend = Box::new(CpuBackend::new());
    let summary = compute(
        model,
        &plan,
        render,
        backend,
        Execution::default(),
        &mut parts,
        &mut |_| {},
    );
    (parts, summary.expect("rows"))
}

/// √Σ (F − reference)² / √Σ reference² of a part's row.
fn error(part: &Part, place: usize, reference: &ReferenceRow) -> f64 {
    let (columns, values) = part.row(place);
    let mut squared = 0.0;
    let mut known: std::collections::HashMap<u32, f64> = reference
        .columns
        .iter()
        .copied()
        .zip(reference.values.iter().copied())
        .collect();
    for (&column, value) in columns.iter().zip(values) {
        squared += (value - known.remove(&column.cast_unsigned()).unwrap_or(0.0)).powi(2);
    }
    squared += known.values().map(|value| value * value).sum::<f64>();
    (squared / reference.squared_norm()).sqrt()
}

/// Both ground rows of a scene: what the default and a tolerance of 1 % make of them, and how far they may be off.
fn ground_rows_are_near_the_reference(name: &str, model: &Model, rows: &[u32], most: [f64; 2]) {
    let settings = ReferenceSettings {
        target: 0.01,
        ..ReferenceSettings::default()
    };
    let reference = Reference::new(model, settings).expect("good settings");
    let emitters: Vec<InputPatch> = rows.iter().copied().map(InputPatch).collect();
    let references = reference.rows(&emitters, 2, &mut |_| {}).expect("patches of the scene");
    for (rung, most) in [Rung::usual(model), Rung::settled(model, 0.01)].into_iter().zip(most) {
        let (parts, summary) = rows_of(model, rung, rows);
        assert!(
            summary.hemicubes >= 16 * summary.rows,
            "{name}: {} hemicubes for {} rows",
            summary.hemicubes,
            summary.rows
        );
        let mut place = 0;
        for part in &parts {
            for k in 0..part.rows.len() {
                let row = references
                    .iter()
                    .find(|row| row.emitter == part.rows[k])
                    .expect("one a row");
                let off = error(part, k, row);
                let missing = row.values.iter().sum::<f64>() - part.row(k).1.iter().sum::<f64>();
                say(&format!(
                    "{name}, {}, patch {}: {:.2} % off, its sum {missing:.4}, the reference's noise is {:.2} %; {} of {} rows cut \
                     short",
                    rung.correction.name(),
                    part.rows[k],
                    100.0 * off,
                    100.0 * row.noise(),
                    summary.cut_short,
                    summary.rows
                ));
                assert!(off <= most + row.noise(), "{name}, patch {}: {off}", part.rows[k]);
                assert!(
                    missing.abs() <= 0.02,
                    "{name}, patch {}: {missing} of the sum",
                    part.rows[k]
                );
                place += 1;
            }
        }
        assert_eq!(place, rows.len());
    }
}

#[test]
fn a_ground_of_two_triangles() {
    ground_rows_are_near_the_reference("houses", &city(40), &[0, 1], [0.06, 0.03]);
}

#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn the_grounds_of_a_real_city() {
    let Some(folder) = scenes_or_skip("the_grounds_of_a_real_city") else {
        return;
    };
    let model = model(
        read(&folder, "../cases/city/munich.obj").expect("a scene"),
        Subdivision::None,
    );
    ground_rows_are_near_the_reference("munich", &model, &[38_934, 38_935], [0.10, 0.06]);
}

/// A row that its bound ends is counted, and expects more of an error than the same row with a hundred times the bound.
#[test]
fn a_row_cut_short_says_so() {
    let model = city(40);
    let coarse = Rung::tolerance(0.01);
    let (parts, summary) = rows_of(&model, coarse, &[0]);
    let walls: Vec<u32> = (2..34).collect();
    let (_, of_walls) = rows_of(&model, coarse, &walls);
    assert_eq!(of_walls.cut_short, 0, "rows of walls have all they need");
    say(&format!(
        "{} rows cut short, expected error {:?}",
        summary.cut_short, parts[0].errors
    ));
    assert_eq!(summary.cut_short, 1, "of the ground there is always more to measure");
    let expected = f64::from(parts[0].errors[0].norm);
    assert!(expected > 0.0, "{expected}");
}
