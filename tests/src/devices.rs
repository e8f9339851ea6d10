//! What every backend on a device must show, given a way to open one: rows that do not depend on culling, batches or the run,
//! that are the sums of the item buffer, and that agree with the CPU backend. Scenes for that, moved off all symmetry so that
//! no edge passes through a pixel's centre.

use crate::extremes;
use crate::geometry::{box_inside, even, flipped, grid, irrational_rotation, moved, scene_of, scene_with_sides};
use crate::rows::{hemicubes, render_with, spread};
use crate::scenes::{model, say};
use glam::DVec3;
use hemicube::Model;
use hemicube::backend::{BackendError, Counters, Culling, Hemicube, HemicubeBackend, RenderSettings, WHOLE};
use hemicube::delta::DeltaTable;
use hemicube::face::Items;
use hemicube::row::{RowBlock, RowView};
use hemicube_scene::generate::{BlockCityParameters, Generate, Kind, generate};
use hemicube_scene::{Scene, Subdivision};

/// A session, or why there is none.
pub type Opened = Result<Box<dyn HemicubeBackend>, BackendError>;
/// Opens a session with options.
pub type Open<'a> = &'a dyn Fn(&str) -> Opened;

/// Whether tests of a backend may go on: a session could be opened. Else says that they are skipped.
///
/// # Panics
/// When there is no device and `HEMICUBE_REQUIRE_BACKENDS` (a list with commas) names the backend.
pub fn is_there(backend: &str, opened: &Opened) -> bool {
    let Err(reason) = opened else { return true };
    let required = std::env::var("HEMICUBE_REQUIRE_BACKENDS").unwrap_or_default();
    assert!(
        !required.split(',').any(|name| name.trim() == backend),
        "`{backend}` is required and cannot be opened: {reason}"
    );
    say(&format!("SKIP {backend}: {reason}"));
    false
}

/// A scene off all symmetry.
fn askew(scene: Scene) -> Scene {
    let turn = irrational_rotation();
    moved(scene, move |p| {
        turn * p + DVec3::new(0.123_456_7, -7.654_321, 2.236_068)
    })
}

fn made(kind: Kind, target_patches: u64) -> Scene {
    let spec = Generate {
        kind,
        target_patches,
        seed: 1,
    };
    generate(spec).expect("a target in range")
}

/// The generated scenes that backends are tested on, by name.
pub fn scenes() -> Vec<(&'static str, Model)> {
    let plates = {
        let [floor, ceiling, ..] = box_inside(DVec3::new(1.0, 1.2, 0.7));
        let one_sided = [floor, ceiling].into_iter().flat_map(|f| grid(f, &even(12), &even(12)));
        let [plate, ..] = box_inside(DVec3::new(0.6, 0.5, 0.1));
        let raised = |h: f64| plate.map(move |p| p + DVec3::new(0.17, 0.29, h));
        let two_sided = [0.21, 0.43]
            .into_iter()
            .flat_map(move |h| grid(raised(h), &even(7), &even(7)));
        scene_with_sides(one_sided.map(|t| (t, false)).chain(two_sided.map(|t| (t, true))))
    };
    let bare = |scene| model(askew(scene), Subdivision::None);
    vec![
        ("room", bare(made(Kind::Room, 10_000))),
        ("spheres", bare(made(Kind::Spheres, 12_000))),
        ("soup", bare(made(Kind::Soup, 6_000))),
        ("two-sided plates", bare(plates)),
        ("maze", bare(made(Kind::Maze, 8_000))),
        ("city with duplicates", city_with_duplicates(12)),
    ]
}

/// A block city in which every seventh triangle is there twice, every fourteenth the other way round. Twelve blocks along
/// each side make 36,864 triangles.
pub fn city_with_duplicates(blocks: u32) -> Model {
    let city = BlockCityParameters {
        blocks,
        split: 4,
        seed: 1,
    };
    let mut scene = city.generate().expect("a target in range");
    let again: Vec<_> = scene.triangles.iter().step_by(7).copied().collect();
    for (k, mut triangle) in again.into_iter().enumerate() {
        let [a, b, c] = triangle.corners;
        triangle.corners = if k % 2 == 0 { [b, c, a] } else { [b, a, c] };
        scene.triangles.push(triangle);
    }
    crate::scenes::model_as_it_is(&askew(scene), Subdivision::None)
}

/// Scenes in which nothing hides anything: the inside of a box, and a bowl.
pub fn unoccluded() -> Vec<(&'static str, Model)> {
    let inside = box_inside(DVec3::new(1.0, 1.3, 0.8)).into_iter();
    let inside = scene_of(inside.flat_map(|f| grid(f, &even(9), &even(9))));
    let bowl = scene_of(crate::geometry::sphere(12, 1.0, true, false));
    let of = |scene| model(askew(scene), Subdivision::None);
    vec![("inside of a box", of(inside)), ("bowl", of(bowl))]
}

/// Scenes at the extremes of what is legal, by name.
pub fn extreme_scenes() -> Vec<(&'static str, Model)> {
    let of = |scene| model(askew(scene), Subdivision::None);
    vec![
        ("slivers", of(extremes::slivers())),
        ("mote", of(extremes::mote())),
        ("near plates", of(extremes::near_plates(1e-3))),
        ("hinge", of(extremes::hinge(12.0))),
        ("one triangle", of(extremes::single_patch())),
        ("empty view", of(extremes::empty_view())),
        (
            "duplicates of a room inside out",
            of(scene_of(
                box_inside(DVec3::ONE)
                    .into_iter()
                    .flat_map(|f| [f, flipped(f)])
                    .flat_map(|f| grid(f, &even(3), &even(3))),
            )),
        ),
    ]
}

/// Hemicubes of some patches of a scene.
pub fn some(model: &Model, count: usize) -> Vec<Hemicube> {
    hemicubes(model, &spread(model, count))
}

/// Runs of neighbours in the order of work, as the driver asks for them.
pub fn neighbours(model: &Model, count: usize) -> Vec<Hemicube> {
    let order: Vec<_> = model.order().collect();
    let runs = (count / 16).max(1);
    let chosen: Vec<_> = (0..runs)
        .flat_map(|run| order[run * order.len() / runs..].iter().take(16).copied())
        .collect();
    hemicubes(model, &chosen)
}

/// How two sets of rows of the same hemicubes differ.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Apart {
    /// Rows that are not the same bits.
    pub rows: usize,
    /// The largest Σ |a − b| of a row, escaped and blocked included, as a part of the whole.
    pub worst: f64,
    /// The mean of it.
    pub mean: f64,
}

/// Compares rows.
///
/// # Panics
/// When there are not as many of one as of the other.
pub fn compare_rows(a: &RowBlock, b: &RowBlock) -> Apart {
    assert_eq!(a.len(), b.len(), "as many rows of one as of the other");
    let mut apart = Apart::default();
    for k in 0..a.len() {
        let (a, b) = (a.row(k), b.row(k));
        apart.rows += usize::from(a != b);
        let distance = row_distance(a, b);
        apart.worst = apart.worst.max(distance);
        apart.mean += distance;
    }
    apart.mean /= a.len().max(1) as f64;
    apart
}

fn row_distance(a: RowView<'_>, b: RowView<'_>) -> f64 {
    let mut weights = std::collections::BTreeMap::new();
    for (row, sign) in [(a, 1), (b, -1)] {
        for (&patch, &weight) in row.patches.iter().zip(row.visible) {
            *weights.entry(patch).or_insert(0i64) += sign * i64::from(weight);
        }
    }
    let sum: u64 = weights.values().map(|w| w.unsigned_abs()).sum();
    let sum = sum + u64::from(a.escaped.abs_diff(b.escaped)) + u64::from(a.blocked.abs_diff(b.blocked));
    sum as f64 / f64::from(WHOLE)
}

/// How many pixels of two item buffers differ.
///
/// # Panics
/// When they are of different resolutions.
pub fn compare_items(a: &Items, b: &Items) -> usize {
    assert_eq!(a.resolution, b.resolution);
    a.seen.iter().zip(&b.seen).filter(|(a, b)| a != b).count()
}

/// Whether a row is the sum of an item buffer, to the bit; entries without weight, as tiny patches have, aside.
pub fn is_sum_of(row: RowView<'_>, items: &Items, table: &DeltaTable) -> bool {
    let (weights, escaped, blocked) = items.reduce(table);
    let entries = row.patches.iter().zip(row.visible).filter(|(_, v)| **v > 0);
    let summed = weights.iter().filter(|(_, v)| *v > 0);
    (row.escaped, row.blocked) == (escaped, blocked)
        && entries.map(|(&p, &v)| (p, v)).eq(summed.map(|(p, v)| (p.0, *v)))
}

/// Rows by a session opened with options, checked as the driver checks them.
///
/// # Panics
/// When the backend refuses, or a row breaks the contract.
pub fn rows_with(
    open: Open<'_>,
    options: &str,
    model: &Model,
    hemicubes: &[Hemicube],
    settings: RenderSettings,
) -> (RowBlock, Counters) {
    let mut session = open(options).unwrap_or_else(|error| panic!("options `{options}`: {error}"));
    render_with(&mut *session, model, hemicubes, settings)
}

/// Rows are the same bits with each of some options, alone and in one call, from a fork, and run to run. Returns the
/// counters with the first options.
///
/// # Panics
/// When they are not.
pub fn rows_do_not_depend(
    open: Open<'_>,
    options: &[&str],
    name: &str,
    model: &Model,
    hemicubes: &[Hemicube],
    covered: bool,
    resolution: u32,
) -> Counters {
    let settings = RenderSettings {
        resolution,
        culling: Culling::On,
        covered,
    };
    let off = RenderSettings {
        culling: Culling::Off,
        ..settings
    };
    let (plain, counted) = rows_with(open, options[0], model, hemicubes, off);
    assert_eq!(
        counted.nodes_hidden + counted.nodes_outside,
        0,
        "{name}: culling is off"
    );
    let mut first = Counters::default();
    for (k, options) in options.iter().enumerate() {
        let mut session = open(options).unwrap_or_else(|error| panic!("options `{options}`: {error}"));
        let (rows, counters) = render_with(&mut *session, model, hemicubes, settings);
        let apart = compare_rows(&rows, &plain);
        assert_eq!(
            apart,
            Apart::default(),
            "{name}, N = {resolution}, covered {covered}, `{options}`"
        );
        if k == 0 {
            first = counters;
        }
        // Alone and backwards, and the first also by a fork: what was seen before must not show.
        let mut sessions = vec![session];
        if k == 0 {
            sessions.push(sessions[0].fork().expect("another session"));
        }
        for (row, hemicube) in hemicubes.iter().enumerate().rev().step_by(5) {
            for session in &mut sessions {
                let mut alone = RowBlock::default();
                session
                    .rows(std::slice::from_ref(hemicube), &mut alone)
                    .expect("a legal hemicube");
                assert_eq!(alone.row(0), plain.row(row), "{name}, `{options}`: row {row} alone");
            }
        }
    }
    first
}
