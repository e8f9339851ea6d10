//! The built-in backend's rows are, to the bit, the plain pixel-by-pixel reduction of its own item buffers. That keeps
//! the reduction's correctness apart from the rasteriser's.

use hemicube::Model;
use hemicube::backend::{HemicubeBackend, RenderSettings};
use hemicube::delta::DeltaTable;
use hemicube::row::RowView;
use hemicube_backend_cpu::{CpuBackend, Isa};
use hemicube_scene::generate::{self, Kind};
use hemicube_scene::{InputPatch, Subdivision};
use hemicube_tests::rows::{hemicubes, render_with, rolled, settings, spread};
use hemicube_tests::scenes::{generated, model, read, scenes_or_skip};

/// Compares a row with its reduced item buffer. Tiny patches have no pixel, so they are left out.
fn agrees(row: RowView<'_>, reduced: &(Vec<(InputPatch, u32)>, u32, u32)) -> bool {
    let shown = row.patches.iter().zip(row.visible).zip(row.covered);
    let shown = shown.filter(|&((patch, &visible), &covered)| {
        visible > 0 || covered > 0 || reduced.0.binary_search(&(InputPatch(*patch), 0)).is_ok()
    });
    shown
        .map(|((&patch, &visible), _)| (InputPatch(patch), visible))
        .eq(reduced.0.iter().copied())
        && (row.escaped, row.blocked) == (reduced.1, reduced.2)
}

fn holds(name: &str, model: &Model) {
    for resolution in [64, 96, 256, 1024] {
        let table = DeltaTable::new(resolution);
        let count = if resolution > 256 { 3 } else { 12 };
        let hemicubes: Vec<_> = hemicubes(model, &spread(model, count))
            .into_iter()
            .enumerate()
            .map(|(k, hemicube)| {
                if k % 2 == 0 {
                    hemicube
                } else {
                    rolled(hemicube, k as f64)
                }
            })
            .collect();
        for isa in Isa::available() {
            let mut backend = CpuBackend::with_isa(isa).expect("it is available");
            for covered in [false, true] {
                let settings = RenderSettings {
                    covered,
                    ..settings(resolution)
                };
                let (rows, _) = render_with(&mut backend, model, &hemicubes, settings);
                for (k, hemicube) in hemicubes.iter().enumerate() {
                    let reduced = backend.items(hemicube).expect("a legal hemicube").reduce(&table);
                    assert!(
                        agrees(rows.row(k), &reduced),
                        "{name}, {isa:?}, N = {resolution}, covered {covered}: {:?} but {reduced:?}",
                        rows.row(k)
                    );
                }
            }
        }
    }
}

#[test]
fn closed_room() {
    holds(
        "Cornell box ×16",
        &model(generate::cornell_box(), Subdivision::Levels(2)),
    );
}

#[test]
fn open_room() {
    holds(
        "open Cornell box ×16",
        &model(generate::cornell_box_open(), Subdivision::Levels(2)),
    );
}

#[test]
fn generated_scenes() {
    for kind in [Kind::City, Kind::Soup] {
        holds(kind.name(), &generated(kind, 3000));
    }
}

#[test]
#[ignore = "more scenes of the same promise: ./test --full"]
fn more_generated_scenes() {
    for kind in [Kind::Maze, Kind::Spheres, Kind::Field] {
        holds(kind.name(), &generated(kind, 3000));
    }
}

#[test]
fn real_city_and_car() {
    let Some(folder) = scenes_or_skip("reduction::real_city_and_car") else {
        return;
    };
    for file in ["city/denhaag-8897.obj", "ac/sd-sc-spirit-300.acc"] {
        let scene = read(&folder, file).unwrap_or_else(|error| panic!("{error}"));
        holds(file, &model(scene, Subdivision::None));
    }
}

#[test]
fn a_wrong_reduction_would_be_noticed() {
    let model = model(generate::cornell_box_open(), Subdivision::Levels(2));
    let hemicubes = hemicubes(&model, &spread(&model, 1));
    let mut backend = CpuBackend::new();
    let (rows, _) = render_with(&mut backend, &model, &hemicubes, settings(64));
    let items = backend.items(&hemicubes[0]).expect("a legal hemicube");
    let table = DeltaTable::new(64);
    let reduced = items.reduce(&table);
    assert!(agrees(rows.row(0), &reduced));

    let mut moved = rows.clone();
    moved.visible[0] += 1;
    moved.visible[1] -= 1;
    assert!(!agrees(moved.row(0), &reduced), "one unit in a wrong place");
    let mut lost = reduced.clone();
    lost.0.remove(3);
    assert!(!agrees(rows.row(0), &lost), "an entry too many");
    let mut extra = reduced;
    extra.0.push((InputPatch(model.geometry().patch_count), 0));
    assert!(!agrees(rows.row(0), &extra), "an entry too few");
    let mut changed = items;
    changed.seen.swap(64 * 32 + 32, 64 * 90 + 2);
    assert!(
        !agrees(rows.row(0), &changed.reduce(&table)),
        "two pixels changed places"
    );
}
