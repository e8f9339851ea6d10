//! Requirements on every backend on a device, given a way to open one: rows do not depend on culling, batches or the
//! run, are the sums of the item buffer, and agree with the CPU backend. Scenes for that are moved off all symmetry so
//! that no edge passes through a pixel's centre.

use crate::extremes;
use crate::geometry::{box_inside, even, flipped, grid, irrational_rotation, moved, scene_of, scene_with_sides};
use crate::rays::pixels;
use crate::rows::{hemicubes, render_with, rolled, spread};
use crate::scenes::{generated, model, read, say, scenes_or_skip};
use glam::DVec3;
use hemicube::Model;
use hemicube::backend::{BackendError, Counters, Culling, Hemicube, HemicubeBackend, RenderSettings, WHOLE};
use hemicube::delta::DeltaTable;
use hemicube::face::{Face, Items, pixel_count};
use hemicube::row::{RowBlock, RowView};
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::generate::{BlockCityParameters, Generate, Kind, generate};
use hemicube_scene::{InputPatch, Scene, Subdivision};
use std::collections::BTreeSet;

/// A session, or why there is none.
pub type Opened = Result<Box<dyn HemicubeBackend>, BackendError>;
/// Opens a session with options.
pub type Open<'a> = &'a dyn Fn(&str) -> Opened;

/// Returns whether a session opens, so that tests of a backend may go on. Otherwise says that they are skipped.
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

/// The generated scenes for tests of backends, by name.
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

/// A block city with every seventh triangle twice, every fourteenth the other way round. Twelve blocks along each side
/// make 36,864 triangles.
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

/// Scenes without occlusion: the inside of a box, and a bowl.
pub fn unoccluded() -> Vec<(&'static str, Model)> {
    let inside = box_inside(DVec3::new(1.0, 1.3, 0.8)).into_iter();
    let inside = scene_of(inside.flat_map(|f| grid(f, &even(9), &even(9))));
    let bowl = scene_of(crate::geometry::sphere(12, 1.0, true, false));
    let of = |scene| model(askew(scene), Subdivision::None);
    vec![("inside of a box", of(inside)), ("bowl", of(bowl))]
}

/// Legal scenes at the extremes, by name.
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

/// Runs of neighbours in the order of work: the driver's batches.
pub fn neighbours(model: &Model, count: usize) -> Vec<Hemicube> {
    let order: Vec<_> = model.order().collect();
    let runs = count.div_ceil(16);
    let chosen: Vec<_> = (0..runs)
        .flat_map(|run| order[run * order.len() / runs..].iter().take(16).copied())
        .take(count)
        .collect();
    hemicubes(model, &chosen)
}

/// Differences between two sets of rows of the same hemicubes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Apart {
    /// Rows with other bits.
    pub rows: usize,
    /// The largest Σ |a − b| of a row, escaped and blocked included, relative to the whole.
    pub worst: f64,
    /// The mean of it.
    pub mean: f64,
}

/// Compares rows.
///
/// # Panics
/// When their numbers differ.
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

/// Number of different pixels in two item buffers.
///
/// # Panics
/// When they are of different resolutions.
pub fn compare_items(a: &Items, b: &Items) -> usize {
    assert_eq!(a.resolution, b.resolution);
    a.seen.iter().zip(&b.seen).filter(|(a, b)| a != b).count()
}

/// Returns whether a row is the sum of an item buffer, to the bit, aside from the weightless entries of sub-pixel
/// patches.
pub fn is_sum_of(row: RowView<'_>, items: &Items, table: &DeltaTable) -> bool {
    let (weights, escaped, blocked) = items.reduce(table);
    let entries = row.patches.iter().zip(row.visible).filter(|(_, v)| **v > 0);
    let summed = weights.iter().filter(|(_, v)| *v > 0);
    (row.escaped, row.blocked) == (escaped, blocked)
        && entries.map(|(&p, &v)| (p, v)).eq(summed.map(|(p, v)| (p.0, *v)))
}

/// Rows by a session opened with options, checked like the driver's.
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
        // Alone and backwards, and the first also by a fork: no trace of earlier hemicubes may show.
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

/// Allowed difference from the CPU backend.
#[derive(Clone, Copy, Debug)]
pub struct Most {
    /// The share of different pixels.
    pub pixels: f64,
    /// The share of different pixels that snapping does not explain ([`unexplained`]): depths tied but for their
    /// rounding.
    pub unexplained: f64,
    /// The relative difference of a row.
    pub row: f64,
}

/// Drivers snap corners to 1/256 of a pixel, and the CPU backend samples edges exactly, so that some of the pixels on
/// edges differ: in scenes with patches of about 20 pixels, like these, 3 in 10,000.
pub const DRIVERS_EDGES: Most = Most {
    pixels: 3e-4,
    unexplained: 1e-5,
    row: 5e-3,
};

/// With `edges=exact`.
pub const EXACT_EDGES: Most = Most {
    pixels: 1e-4,
    ..DRIVERS_EDGES
};

/// Houses may share walls up to 10⁻⁵ of their distance: all pixels of such a wall may differ, and chance decides which
/// rows have one in front of them; see `docs/dev/gpu.md`.
pub const SHARED_WALLS: Most = Most {
    pixels: 5e-4,
    unexplained: 5e-4,
    row: 1e-2,
};

fn settings(resolution: u32, culling: Culling, covered: bool) -> RenderSettings {
    RenderSettings {
        resolution,
        culling,
        covered,
    }
}

/// Different pixels of two item buffers of a hemicube without an edge within 1/256 of a pixel: corners snapped to that
/// do not explain them. By every triangle of the scene in f64.
pub fn unexplained(model: &Model, hemicube: &Hemicube, a: &Items, b: &Items) -> usize {
    let differing = pixels(a.resolution)
        .zip(a.seen.iter().zip(&b.seen))
        .filter(|(_, (a, b))| a != b);
    differing
        .filter(|&((face, x, y), _)| !edge_passes(model, hemicube, face, [x, y], f64::from(a.resolution)))
        .count()
}

/// Returns whether an unhidden edge passes within 1/256 of a pixel of the pixel's centre.
fn edge_passes(model: &Model, hemicube: &Hemicube, face: Face, [x, y]: [u32; 2], n: f64) -> bool {
    let (from, sign) = face.axes();
    let centre = |k: u32| (2.0 * f64::from(k) + 1.0) / n;
    let towards = DVec3::new(centre(x) - 1.0, centre(y) - if face.is_top() { 1.0 } else { 0.0 }, 1.0);
    // Distance of the centre inside each triangle, in pixels, and distance to the triangle's plane.
    let others = model.geometry().surfaces.iter();
    let others = others.filter(|s| hemicube.emitter.is_none_or(|e| s.front != e && s.back != Some(e)));
    let met = others.filter_map(|surface| {
        let [a, b, c] = surface.corners.map(|corner| {
            let r = corner - hemicube.origin;
            let frame = hemicube.axes.map(|axis| axis.dot(r));
            DVec3::from_array([0, 1, 2].map(|k| sign[k] * frame[from[k]]))
        });
        let (normal, turn) = ((b - a).cross(c - a), a.dot(b.cross(c)).signum());
        let depth = normal.dot(a) / normal.dot(towards);
        let inside = [(a, b), (b, c), (c, a)]
            .map(|(p, q)| p.cross(q - p))
            .map(|edge| 0.5 * n * turn * edge.dot(towards) / edge.x.hypot(edge.y))
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        (depth > 0.0 && inside > -1.0).then_some((inside, depth))
    });
    let met: Vec<(f64, f64)> = met.collect();
    let nearest = met
        .iter()
        .filter(|(inside, _)| *inside > 0.0)
        .fold(f64::INFINITY, |nearest, (_, depth)| nearest.min(*depth));
    met.iter()
        .any(|(inside, depth)| inside.abs() <= 1.0 / 256.0 && *depth <= nearest * (1.0 + 1e-4))
}

/// Number of different pixels of two sessions' item buffers, of these without an edge ([`unexplained`]), and of these
/// beside no pixel shown alike by the second.
fn pixels_apart(
    one: &mut dyn HemicubeBackend,
    other: &mut dyn HemicubeBackend,
    model: &Model,
    hemicubes: &[Hemicube],
) -> [usize; 3] {
    let mut counts = [0; 3];
    for hemicube in hemicubes {
        let (a, b) = (
            one.items(hemicube).expect("legal"),
            other.items(hemicube).expect("legal"),
        );
        let n = a.resolution as usize;
        counts[0] += compare_items(&a, &b);
        counts[1] += unexplained(model, hemicube, &a, &b);
        for at in (0..a.seen.len()).filter(|&at| a.seen[at] != b.seen[at]) {
            let (x, y) = (at % n, at / n);
            let near = (y.saturating_sub(1)..=(y + 1).min(3 * n - 1))
                .flat_map(|y| (x.saturating_sub(1)..=(x + 1).min(n - 1)).map(move |x| y * n + x))
                .any(|near| b.seen[near] == a.seen[at]);
            counts[2] += usize::from(!near);
        }
    }
    counts
}

/// Pixels along an edge for comparisons with the CPU backend.
const AGAINST_THE_CPU: u32 = 256;

/// With the driver's edges, more pixels of the room differ than [`EXACT_EDGES`] allows: that bound tells them from
/// exact ones.
///
/// # Panics
/// When it does not.
pub fn the_drivers_edges_are_told_from_exact_ones(open: Open<'_>) {
    let (_, room) = scenes().swap_remove(0);
    let hemicubes = some(&room, 24);
    let mut sessions = [open("edges=driver"), open("edges=exact")].map(|opened| opened.expect("it was there"));
    let names = sessions.each_ref().map(|session| session.info().version.clone());
    assert_ne!(names[0], names[1], "rows that differ are told apart by the version");
    let mut cpu = CpuBackend::new();
    let settings = settings(AGAINST_THE_CPU, Culling::On, false);
    cpu.load(room.geometry(), settings).expect("a small scene");
    let shares = sessions.each_mut().map(|session| {
        session.load(room.geometry(), settings).expect("a small scene");
        let [pixels, ..] = pixels_apart(&mut **session, &mut cpu, &room, &hemicubes);
        pixels as f64 / (hemicubes.len() * pixel_count(AGAINST_THE_CPU)) as f64
    });
    assert!(
        shares[0] > EXACT_EDGES.pixels && shares[1] <= EXACT_EDGES.pixels,
        "of the driver's and of exact edges' pixels differ {shares:?}"
    );
}

/// Agreement of a scene with the CPU backend: the share of different pixels, and the distance of rows. Most different
/// pixels are on an edge: next to one that the CPU backend sees so. (Except for patches smaller than pixels, and shared
/// walls.)
///
/// # Panics
/// When more differ than `most` allows, or all rows by more than 10⁻³ in the mean.
pub fn agrees_with_the_cpu(open: Open<'_>, options: &str, name: &str, model: &Model, most: Most) -> Apart {
    let resolution = AGAINST_THE_CPU;
    let hemicubes = some(model, 24);
    let mut gpu = open(options).expect("it was there");
    let mut cpu = CpuBackend::new();
    let (a, _) = render_with(&mut *gpu, model, &hemicubes, settings(resolution, Culling::On, false));
    let (b, _) = render_with(&mut cpu, model, &hemicubes, settings(resolution, Culling::On, false));
    let apart = compare_rows(&a, &b);
    let [pixels, without, off_edges] = pixels_apart(&mut *gpu, &mut cpu, model, &hemicubes);
    let all = (hemicubes.len() * pixel_count(resolution)) as f64;
    let (share, without) = (pixels as f64 / all, without as f64 / all);
    say(&format!(
        "{name}, `{options}`: {share:.1e} of the pixels differ, {without:.1e} with no edge within 1/256 \
         of a pixel, {off_edges} of {pixels} off edges; rows by {:.1e}, {:.1e} at most",
        apart.mean, apart.worst
    ));
    assert!(share <= most.pixels, "{name}: {share} of the pixels differ");
    assert!(
        without <= most.unexplained,
        "{name}: {without} of the pixels differ, and no edge is near"
    );
    assert!(apart.mean <= 1e-3, "{name}: {apart:?}");
    assert!(apart.worst <= most.row, "{name}: {apart:?}");
    apart
}

/// Agreement with the CPU backend in cities: 140,000 patches of towers, and with the scenes `munich` and
/// `denhaag-8897`, its triangles in 16.
///
/// # Panics
/// See [`agrees_with_the_cpu`].
pub fn cities_agree_with_the_cpu(open: Open<'_>, options: &str) {
    let towers = generated(Kind::BlockCity, 140_000);
    agrees_with_the_cpu(open, options, "140,000 patches of towers", &towers, EXACT_EDGES);
    let Some(folder) = scenes_or_skip("rows of large cities") else {
        return;
    };
    let of_file = |file: &str, cut| model(read(&folder, file).expect("a readable scene"), cut);
    let munich = of_file("../cases/city/munich.obj", Subdivision::None);
    agrees_with_the_cpu(open, options, "munich", &munich, SHARED_WALLS);
    let fine = of_file("city/denhaag-8897.obj", Subdivision::Levels(2));
    agrees_with_the_cpu(open, options, "denhaag-8897 ×16", &fine, SHARED_WALLS);
}

/// Rows are the sums of the session's own item buffers, and no more comes back than their entries.
///
/// # Panics
/// When they are not, or more does.
pub fn rows_are_sums_and_little_comes_back(open: Open<'_>, options: &str) {
    for (name, model) in scenes() {
        let hemicubes = some(&model, 12);
        let table = DeltaTable::new(208);
        let mut session = open(options).expect("it was there");
        let (rows, counters) = render_with(&mut *session, &model, &hemicubes, settings(208, Culling::On, true));
        for (k, hemicube) in hemicubes.iter().enumerate() {
            let items = session.items(hemicube).expect("legal");
            assert!(is_sum_of(rows.row(k), &items, &table), "{name}, row {k}");
            let mut doctored = items.clone();
            let at = doctored.seen.len() / 3;
            doctored.seen[at] = if doctored.seen[at] == 0 { 1 } else { 0 };
            assert!(
                !is_sum_of(rows.row(k), &doctored, &table),
                "one pixel more or less shows"
            );
        }
        // Some entries are dropped after they came back: sub-pixel patches that cover a pixel after all.
        let entries = rows.patches.len() as u64;
        let bound = 16 * entries + 64 * hemicubes.len() as u64;
        assert!(
            counters.bytes_read_back <= bound && counters.bytes_read_back >= 12 * entries,
            "{name}: {} bytes for {entries} entries",
            counters.bytes_read_back
        );
    }
}

/// Without occlusion, covered weights are the visible ones; with occlusion they are not.
///
/// # Panics
/// When it is otherwise.
pub fn all_that_nothing_hides_is_seen(open: Open<'_>, options: &str) {
    for (name, model) in unoccluded() {
        let hemicubes = some(&model, 40);
        let (rows, _) = rows_with(open, options, &model, &hemicubes, settings(128, Culling::On, true));
        assert_eq!(rows.covered, rows.visible, "{name}");
    }
    // With occlusion they differ.
    let (name, model) = scenes().swap_remove(3);
    let (rows, _) = rows_with(
        open,
        options,
        &model,
        &some(&model, 40),
        settings(128, Culling::On, true),
    );
    assert_ne!(rows.covered, rows.visible, "{name}");
}

/// Covered weights and tiny patches are about the CPU backend's.
///
/// # Panics
/// When covered weights are a hundredth apart, or a third of the tiny patches are of one only.
pub fn covered_and_tiny_agree_with_the_cpu(open: Open<'_>, options: &str) {
    for (name, model) in scenes() {
        let hemicubes = some(&model, 24);
        let settings = settings(64, Culling::On, true);
        let (a, _) = rows_with(open, options, &model, &hemicubes, settings);
        let (b, _) = render_with(&mut CpuBackend::new(), &model, &hemicubes, settings);
        let (mut both, mut only) = (0, [0, 0]);
        let (mut apart, mut all) = (0u64, 0u64);
        for k in 0..hemicubes.len() {
            let tiny = |rows: &RowBlock| -> BTreeSet<u32> {
                let row = rows.row(k);
                let tiny = (0..row.patches.len()).filter(|&e| row.visible[e] == 0);
                tiny.map(|e| row.patches[e]).collect()
            };
            let (c, d) = (tiny(&a), tiny(&b));
            both += c.intersection(&d).count();
            only[0] += c.difference(&d).count();
            only[1] += d.difference(&c).count();
            let (a, b) = (a.row(k), b.row(k));
            for (e, patch) in a.patches.iter().enumerate() {
                if let Ok(f) = b.patches.binary_search(patch) {
                    apart += u64::from(a.covered[e].abs_diff(b.covered[f]));
                    all += u64::from(b.covered[f]);
                }
            }
        }
        let apart = apart as f64 / all as f64;
        say(&format!(
            "{name}, `{options}`: {both} tiny patches of both, {only:?} of one; covered weights {apart:.1e} apart"
        ));
        assert!(apart < 1e-2, "{name}: covered weights are {apart} apart");
        // Chance orders surfaces that lie on one another, such as houses on the ground.
        assert!(
            (only[0] + only[1]) * 3 <= both.max(40),
            "{name}: {both} of both, {only:?} of one"
        );
    }
}

/// A hemicube outside its emitter's plane does not see it, and otherwise agrees with the CPU backend's.
///
/// # Panics
/// When it does.
pub fn emitters_are_not_seen_from_off_their_planes(open: Open<'_>, options: &str) {
    let (_, model) = scenes().swap_remove(0);
    let mut hemicubes = some(&model, 12);
    for (k, hemicube) in hemicubes.iter_mut().enumerate() {
        if k % 2 == 0 {
            // Behind its patch, which would be in front of everything.
            hemicube.origin -= hemicube.axes[2] * 1e-3;
        }
        *hemicube = rolled(*hemicube, 0.3);
    }
    let (a, _) = rows_with(open, options, &model, &hemicubes, settings(64, Culling::On, false));
    let (b, _) = render_with(
        &mut CpuBackend::new(),
        &model,
        &hemicubes,
        settings(64, Culling::On, false),
    );
    for (k, hemicube) in hemicubes.iter().enumerate() {
        let emitter = hemicube.emitter.expect("a patch's").0;
        assert!(
            a.row(k).patches.binary_search(&emitter).is_err(),
            "row {k} sees its emitter"
        );
    }
    assert!(compare_rows(&a, &b).worst < 2e-2, "{:?}", compare_rows(&a, &b));
}

/// Impossible requests are refused, and the session lives. `options` leave it three megabytes.
///
/// # Panics
/// When it is not, or does not.
pub fn refusals_leave_the_session_alive(open: Open<'_>, options: &str) {
    let (_, model) = scenes().swap_remove(3);
    let hemicubes = some(&model, 4);
    let mut session = open(options).expect("it was there");
    let mut rows = RowBlock::default();
    assert!(matches!(
        session.rows(&hemicubes, &mut rows),
        Err(BackendError::InvalidArgument(_))
    ));
    assert!(session.fork().is_err());
    let error = session.load(model.geometry(), settings(512, Culling::On, false));
    assert!(matches!(error, Err(BackendError::OutOfMemory(_))), "{error:?}");
    let error = session.load(model.geometry(), settings(100, Culling::On, false));
    assert!(matches!(error, Err(BackendError::InvalidArgument(_))));
    session
        .load(model.geometry(), settings(64, Culling::On, false))
        .expect("that fits");
    let mut wrong = hemicubes.clone();
    wrong[1].emitter = Some(InputPatch(u32::MAX - 7));
    assert!(matches!(
        session.rows(&wrong, &mut rows),
        Err(BackendError::InvalidArgument(_))
    ));
    session.rows(&hemicubes, &mut rows).expect("it lives");
    rows.check(4, model.geometry().patch_count, false).expect("four rows");
}

/// Every stage takes time, if `options` ask for measuring it.
///
/// # Panics
/// When one does not.
pub fn every_stage_takes_time(open: Open<'_>, options: &str) {
    let city = city_with_duplicates(12);
    let hemicubes = neighbours(&city, 64);
    let covered = settings(64, Culling::On, true);
    let mut timed = open(options).expect("it was there");
    render_with(&mut *timed, &city, &hemicubes, covered);
    let times = timed.stage_times();
    for (stage, time) in [
        ("cull", times.cull),
        ("render", times.render),
        ("cover", times.cover),
        ("reduce", times.reduce),
        ("read back", times.read_back),
    ] {
        assert!(time > 0, "{stage} takes time");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comparators_find_what_is_doctored() {
        let mut a = RowBlock::default();
        a.push(InputPatch(3), WHOLE / 2, 0);
        a.end_row(WHOLE / 2, 0);
        let mut b = a.clone();
        assert_eq!(compare_rows(&a, &b), Apart::default());
        b.visible[0] -= 1 << 21;
        b.escaped[0] += 1 << 21;
        let apart = compare_rows(&a, &b);
        assert_eq!(apart.rows, 1);
        assert!((apart.worst - 2.0 / 1024.0).abs() < 1e-12);
        let required = "a required backend that is not there";
        let missing: Opened = Err(BackendError::Unsupported(required.to_owned()));
        assert!(!is_there("a backend nobody requires", &missing));
    }
}
