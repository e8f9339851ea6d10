//! What holds at the extremes, on every backend and rung; prints the table of docs/dev/extremes.md.
//!
//! `extremes [large] [BACKEND…]`: over the built-in backend and the plugins named, each of which must open; with
//! `large`, also a scene of more than 2²⁴ patches, which takes 9 GB and a few minutes. Plugins are those of `cargo
//! build --release --workspace`.
#![allow(clippy::print_stdout, reason = "an example prints")]

use glam::DVec3;
use hemicube::backend::HemicubeBackend;
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection};
use hemicube::reference::{EstimatedRow, Reference, ReferenceRow, ReferenceSettings, errors_against, noise_of};
use hemicube::store::Part;
use hemicube::{InputPatch, Model};
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::{Scene, Subdivision};
use hemicube_tests::extremes;
use hemicube_tests::geometry::{irrational_rotation, moved, scene_of, triangle_to_polygon};
use hemicube_tests::plugins::{self, try_session};
use hemicube_tests::rows::{Rung, parts, settings};
use hemicube_tests::scenes::model_as_it_is;

/// Rows that are held against rays, at most.
const ROWS: usize = 48;

/// A session of the backend of that name.
fn open(name: &str) -> Result<Box<dyn HemicubeBackend>, Box<dyn std::error::Error>> {
    Ok(match name {
        "cpu" => Box::new(CpuBackend::new()),
        name => Box::new(try_session(&plugins::rust(name), &[])?),
    })
}

struct Case {
    name: String,
    scene: Scene,
    /// Whether nothing can escape.
    closed: bool,
    /// Whether every patch sees another whole or not at all, so that quadrature of the closed form is exact. Where
    /// nearly nothing of the view is filled, rays find nothing.
    is_unoccluded: bool,
    /// Which rows; `None`: all.
    rows: Option<RowChoice>,
}

impl Case {
    fn new(name: impl Into<String>, closed: bool, scene: Scene) -> Self {
        Self {
            name: name.into(),
            scene,
            closed,
            is_unoccluded: false,
            rows: None,
        }
    }
}

fn cases(large: bool) -> Vec<Case> {
    let room = || extremes::room_with_a_block(2);
    let rotation = irrational_rotation();
    let turned = |scene: Scene| moved(scene, |p| rotation * p);
    let mut cases = vec![
        Case::new("room with a block", true, room()),
        Case::new(
            "10⁷ sizes away",
            true,
            moved(room(), |p| rotation * p + DVec3::new(1.1e7, -0.9e7, 1.3e7)),
        ),
        Case::new("scaled by 10⁻⁹", true, moved(room(), |p| rotation * p * 1e-9)),
        Case::new("scaled by 10⁹", true, moved(room(), |p| rotation * p * 1e9)),
        Case::new("rotated by irrational angles", true, turned(room())),
        Case::new("edges of 1 and 10⁻⁷", true, turned(extremes::slivers())),
        Case::new("a patch 10⁻⁶ the size of the others", true, turned(extremes::mote())),
        Case::new("plates 10⁻⁶ apart", false, turned(extremes::near_plates(1e-6))),
    ];
    for degrees in [0.1, 1.0, 20.0, 90.0, 160.0, 179.0, 179.9] {
        let scene = turned(extremes::hinge(degrees));
        cases.push(Case {
            is_unoccluded: true,
            ..Case::new(format!("common edge at {degrees}°"), false, scene)
        });
    }
    let open = |numbered: Vec<(usize, [DVec3; 3])>| turned(scene_of(numbered.into_iter().map(|t| t.1)));
    cases.extend([
        Case::new("coplanar duplicates", true, turned(extremes::duplicates())),
        Case::new(
            "walls through the ground",
            false,
            open(extremes::walls_through_the_ground(false)),
        ),
        Case::new("the same, split", false, open(extremes::walls_through_the_ground(true))),
        Case::new(
            "a tower through the ground",
            false,
            open(extremes::tower_through_the_ground(false)),
        ),
        Case::new("the same, split", false, open(extremes::tower_through_the_ground(true))),
        Case::new("a single patch", false, extremes::single_patch()),
        Case::new("an empty view", false, extremes::empty_view()),
        Case::new("centroids inside solids", false, turned(extremes::buried_centroids())),
    ]);
    if large {
        let scene = extremes::many_ids();
        let end = u32::try_from(scene.triangles.len()).expect("a little more than 2²⁴");
        cases.push(Case {
            rows: Some(RowChoice::Range { start: end - 48, end }),
            ..Case::new("ids above 2²⁴", true, scene)
        });
    }
    cases
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (large, named): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|word| word == "large");
    let large = !large.is_empty();
    let backends: Vec<&str> = std::iter::once("cpu").chain(named.iter().map(String::as_str)).collect();
    for name in &backends {
        println!("{name}: {}", open(name)?.info().device);
    }
    let columns = ["case", "patches", "rung"]
        .into_iter()
        .chain(backends.iter().copied())
        .chain(["reference"]);
    let columns: Vec<&str> = columns.collect();
    println!("\n| {} |", columns.join(" | "));
    println!("|{}", "---|".repeat(columns.len()));
    let mut refused = Vec::new();
    for case in cases(large) {
        let model = model_as_it_is(&case.scene, Subdivision::None);
        let emitters = emitters(&model, &case);
        let reference = if case.is_unoccluded {
            emitters.iter().map(|&emitter| by_quadrature(&model, emitter)).collect()
        } else {
            let rays = ReferenceSettings {
                target: 2e-3,
                max_rays: 2_000_000,
                ..ReferenceSettings::default()
            };
            Reference::new(&model, rays)?.rows(&emitters, 0, &mut |_| {})?
        };
        for (rung, settled) in rungs(&model) {
            let plan = Plan {
                rows: emitters.clone(),
                ..Plan::new(&model, RowChoice::All, Selection::default(), 1, true)
            }
            .with_correction(settled.correction);
            let settings = settings(settled.resolution);
            print!("| {} | {} | {rung}", case.name, model.patches().len());
            for name in &backends {
                let cell = match parts(&model, &plan, settings, open(name)?, Execution::default()) {
                    Ok((parts, _)) => cell(&case, &model, &parts, &reference),
                    Err(reason) => {
                        refused.push(format!("{}, {rung}, {name}: {reason}", case.name));
                        "refused".to_owned()
                    }
                };
                print!(" | {cell}");
            }
            println!(" | {:.1e} |", noise_of(&reference));
        }
    }
    for reason in refused {
        println!("\nRefused: {reason}");
    }
    Ok(())
}

/// The rows of a case, or some of them evenly.
fn emitters(model: &Model, case: &Case) -> Vec<InputPatch> {
    let choice = case.rows.unwrap_or(RowChoice::All);
    let all = Plan::new(model, choice, Selection::default(), 1, true).rows;
    let stride = all.len().div_ceil(ROWS).max(1);
    all.into_iter().step_by(stride).collect()
}

/// The row of an emitter whose view of others nothing hides.
fn by_quadrature(model: &Model, emitter: InputPatch) -> ReferenceRow {
    let patches = model.patches();
    let own = patches.corners(emitter);
    let mut row = ReferenceRow {
        emitter: emitter.0,
        ..ReferenceRow::default()
    };
    for patch in patches.iter() {
        let other = patches.corners(patch);
        let faces = patches.normal(patch).dot(patches.centroid(emitter) - other[0]) > 0.0;
        let above = patches.normal(emitter).dot(patches.centroid(patch) - own[0]) > 0.0;
        // Patches of one triangle lie in one plane, of which rounding knows nothing.
        if patch.0 / 16 == emitter.0 / 16 || !faces || !above {
            continue;
        }
        let (value, error) = triangle_to_polygon(&own, &other);
        row.columns.push(patch.0);
        row.values.push(value);
        row.errors.push(error);
    }
    row
}

fn rungs(model: &Model) -> [(&'static str, Rung); 3] {
    [
        ("pixel", Rung::PIXEL),
        ("tolerance 2 %", Rung::usual(model)),
        ("tolerance 1 %", Rung::settled(model, 1e-2)),
    ]
}

/// What rows come to: how far sums are off, what is the emitter's own or behind it, what leaks, and the error.
fn cell(case: &Case, model: &Model, parts: &[Part], reference: &[ReferenceRow]) -> String {
    let rows: Vec<EstimatedRow> = parts.iter().flat_map(EstimatedRow::of_part).collect();
    let escaped = parts.iter().flat_map(|part| &part.sums).map(|sums| sums.escaped).max();
    let measured = errors_against(reference, &rows);
    let (mut sums, mut own) = (0.0f64, 0.0f64);
    for row in &rows {
        let Some(exact) = reference.iter().find(|exact| exact.emitter == row.emitter.0) else {
            continue;
        };
        // Nothing that a hemicube says of what escapes enters.
        let whole = if case.closed {
            1.0 - exact.blocked
        } else {
            exact.values.iter().sum()
        };
        sums = sums.max((row.values.iter().sum::<f64>() - whole).abs());
        own = own.max(self_hits(model, row));
    }
    let leaks = if case.closed {
        few(escaped.unwrap_or(0) as f64 / hemicube::store::HEMICUBE_WEIGHT as f64)
    } else {
        "open".to_owned()
    };
    let error = few(measured.relative_frobenius_with_noise);
    format!("{} · {} · {leaks} · **{error}**", few(sums), few(own))
}

/// A number to two figures; nought is exactly nought.
fn few(value: f64) -> String {
    if value == 0.0 {
        "0".to_owned()
    } else {
        format!("{value:.1e}")
    }
}

/// What a row gives to patches that lie in its emitter's plane or below it, whole.
fn self_hits(model: &Model, row: &EstimatedRow) -> f64 {
    let patches = model.patches();
    let (normal, origin) = (
        patches.normal(row.emitter),
        patches.corners(row.emitter).map(|p| model.normalise(p))[0],
    );
    let tolerance = model.geometry().plane_tolerance;
    let below = |patch: u32| {
        let corners = patches.corners(InputPatch(patch)).map(|p| model.normalise(p));
        corners.iter().all(|&p| normal.dot(p - origin) <= tolerance)
    };
    let entries = row.columns.iter().zip(&row.values);
    entries
        .filter(|&(&patch, _)| below(patch))
        .map(|(_, &value)| value)
        .sum()
}
