//! Rows of which only visible fractions are asked: the CPU backend then lists patches that were cut from a triangle and
//! show all that they cover without finding out how much that is of each.

use hemicube::backend::{Culling, HemicubeBackend, RenderSettings};
use hemicube::row::{RowBlock, RowView};
use hemicube::{InputPatch, Model};
use hemicube_backend_cpu::{CpuBackend, EngineChoice, Isa};
use hemicube_scene::Subdivision;
use hemicube_scene::generate::{self, Generate, Kind};
use hemicube_tests::rows::{hemicubes, render_with, spread};
use hemicube_tests::scenes::{cut_scenes, generated, model, read, say, scenes_or_skip};
use std::collections::BTreeMap;

fn settings(resolution: u32) -> RenderSettings {
    RenderSettings {
        resolution,
        culling: Culling::On,
        covered: true,
    }
}

fn backend(choice: EngineChoice, isa: Isa) -> CpuBackend {
    CpuBackend::with_isa(isa)
        .expect("an instruction set of this machine")
        .with_engine(choice)
}

/// Rows for fractions, checked as the driver checks them.
fn for_fractions(backend: &mut CpuBackend, model: &Model, rows: &[InputPatch], settings: RenderSettings) -> RowBlock {
    let hemicubes = hemicubes(model, rows);
    backend
        .load_for_fractions(model.geometry(), settings)
        .expect("legal settings");
    let mut found = RowBlock::default();
    backend.rows(&hemicubes, &mut found).expect("legal hemicubes");
    found
        .check(hemicubes.len(), model.geometry().patch_count, true)
        .expect("rows that keep the contract");
    found
}

/// The listed weights of a row: visible and covered.
fn listed(row: RowView<'_>) -> BTreeMap<u32, (u32, u32)> {
    let weights = row.visible.iter().copied().zip(row.covered.iter().copied());
    row.patches.iter().copied().zip(weights).collect()
}

/// How rows for fractions differ from those of weights.
#[derive(Debug, Default, PartialEq, Eq)]
struct Apart {
    /// Patches with weights whose fraction is the same.
    alike: usize,
    /// Patches whose fraction is another.
    other: usize,
    /// Patches without weight that only weights have, and that only fractions have.
    tiny: [usize; 2],
    /// Others that only one has.
    lost: usize,
    /// Rows of which another part escapes or is blocked; nothing else is compared of them.
    rows: usize,
}

fn apart(weights: &RowBlock, fractions: &RowBlock) -> Apart {
    let mut apart = Apart::default();
    for row in 0..weights.len() {
        let (weights, fractions) = (weights.row(row), fractions.row(row));
        if (weights.escaped, weights.blocked) != (fractions.escaped, fractions.blocked) {
            apart.rows += 1;
            continue;
        }
        let (weights, fractions) = (listed(weights), listed(fractions));
        for (patch, &(visible, covered)) in &weights {
            match fractions.get(patch) {
                Some(&(v, c)) if u64::from(v) * u64::from(covered) == u64::from(visible) * u64::from(c) => {
                    apart.alike += 1
                }
                Some(_) => apart.other += 1,
                None if covered == 0 => apart.tiny[0] += 1,
                None => apart.lost += 1,
            }
        }
        for (patch, &(visible, covered)) in &fractions {
            if !weights.contains_key(patch) {
                let is_seen = visible == covered;
                apart.tiny[1] += usize::from(is_seen);
                apart.lost += usize::from(!is_seen);
            }
        }
    }
    apart
}

fn assert_fractions_are_those_of_weights(
    name: &str,
    model: &Model,
    choice: EngineChoice,
    count: usize,
    resolution: u32,
    (most_lost, most_rows): (usize, usize),
) {
    let name = &format!("{name}, {choice:?}");
    let rows = spread(model, count);
    let mut exact = backend(choice, Isa::available()[0]);
    if choice == EngineChoice::Order {
        // Nothing of it is what the other does.
        exact = exact.patch_by_patch();
    }
    let (weights, _) = render_with(&mut exact, model, &hemicubes(model, &rows), settings(resolution));
    let mut quick = backend(choice, Isa::available()[0]);
    let fractions = for_fractions(&mut quick, model, &rows, settings(resolution));
    // Or the two would be one.
    assert_ne!(exact.info().version, quick.info().version, "{name}");
    let apart = apart(&weights, &fractions);
    say(&format!("{name}, N = {resolution}: {apart:?}"));
    assert!(
        apart.other == 0 && apart.lost <= most_lost && apart.rows <= most_rows,
        "{name}, N = {resolution}: {apart:?}"
    );
    // At the rim of a triangle whose pixels are all seen, patches without a pixel are, too. Engine `order` asks for
    // them what was covered before a plane or a leaf was begun, and wholes have others than patches, above all in
    // cities whose terrain is cut to pieces.
    let most = if choice == EngineChoice::Order { 5 } else { 10 };
    assert!(
        apart.tiny.iter().sum::<usize>() <= apart.alike / most + 8,
        "{name}, N = {resolution}: {apart:?}"
    );
}

#[test]
fn fractions_are_those_of_weights() {
    for (name, model) in cut_scenes() {
        for choice in [EngineChoice::Depth, EngineChoice::Order] {
            for resolution in [64, 256] {
                assert_fractions_are_those_of_weights(&name, &model, choice, 60, resolution, (0, 0));
            }
        }
    }
}

#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn fractions_of_real_scenes_are_those_of_weights() {
    let Some(folder) = scenes_or_skip("fractions::fractions_of_real_scenes_are_those_of_weights") else {
        return;
    };
    // Engine `order` where it suits the scene: it finds fewer of the patches without a pixel where terrain must be cut
    // to pieces.
    let (depth, both) = (
        &[EngineChoice::Depth][..],
        &[EngineChoice::Depth, EngineChoice::Order][..],
    );
    for (file, subdivision, choices, most) in [
        ("city/denhaag-8897.obj", Subdivision::Split(4), both, (0, 0)),
        ("city/rotterdam-delfshaven.obj", Subdivision::Split(3), depth, (0, 0)),
        // One eye lies on the edge of a floor, whose pixels no patch of it covers: where the floor is drawn they are
        // given to one that is hardly seen, and where patches are, they are seen of what is behind.
        ("interior/aggressor.obj", Subdivision::Split(3), both, (1, 1)),
        (
            "cornell/cornell-measured-closed-20q.obj",
            Subdivision::Split(6),
            both,
            (0, 0),
        ),
    ] {
        let scene = read(&folder, file).unwrap_or_else(|error| panic!("{error}"));
        let model = model(scene, subdivision);
        for &choice in choices {
            // Engine `depth` draws the floor in both, so that the same is blocked.
            let most = match choice {
                EngineChoice::Order => (0, most.1),
                _ => (most.0, 0),
            };
            assert_fractions_are_those_of_weights(file, &model, choice, 300, 128, most);
            if choice == EngineChoice::Order {
                assert_bits_are_the_same(file, &model, &[choice], 128, 100);
            }
        }
    }
}

#[test]
fn neither_engine_nor_culling_nor_instruction_set_changes_a_bit() {
    for (name, model) in cut_scenes() {
        assert_bits_are_the_same(&name, &model, &[EngineChoice::Depth, EngineChoice::Claims], 144, 20);
        for resolution in [48, 144, 512] {
            assert_bits_are_the_same(&name, &model, &[EngineChoice::Order], resolution, 20);
        }
    }
}

fn assert_bits_are_the_same(name: &str, model: &Model, choices: &[EngineChoice], resolution: u32, count: usize) {
    let rows = spread(model, count);
    let of = |choice, isa, culling| {
        let settings = RenderSettings {
            culling,
            ..settings(resolution)
        };
        for_fractions(&mut backend(choice, isa), model, &rows, settings)
    };
    let wanted = of(choices[0], Isa::available()[0], Culling::Off);
    for isa in Isa::available() {
        for (&choice, culling) in choices.iter().flat_map(|c| [Culling::On, Culling::Off].map(|k| (c, k))) {
            let found = of(choice, isa, culling);
            assert_eq!(
                (&found.row_end, &found.escaped, &found.blocked),
                (&wanted.row_end, &wanted.escaped, &wanted.blocked),
                "{name}, {choice:?}, {isa:?}, {culling:?}"
            );
            for row in 0..wanted.len() {
                let (found, wanted) = (listed(found.row(row)), listed(wanted.row(row)));
                let differ: Vec<_> = found
                    .iter()
                    .filter(|(patch, weights)| wanted.get(patch) != Some(weights))
                    .take(4)
                    .collect();
                let there: Vec<_> = differ.iter().map(|(patch, _)| wanted.get(patch)).collect();
                assert!(
                    found == wanted,
                    "{name}, {choice:?}, {isa:?}, {culling:?}, row {row}: {differ:?}, not {there:?}; {} and {}",
                    found.len(),
                    wanted.len()
                );
            }
        }
    }
}

#[test]
fn weights_of_what_was_not_cut_are_what_they_are() {
    for kind in [Kind::City, Kind::Spheres, Kind::Soup] {
        let model = generated(kind, 2_000);
        let rows = spread(&model, 20);
        for choice in [EngineChoice::Depth, EngineChoice::Claims] {
            let mut exact = backend(choice, Isa::available()[0]);
            let mut quick = backend(choice, Isa::available()[0]);
            let (weights, _) = render_with(&mut exact, &model, &hemicubes(&model, &rows), settings(128));
            assert_eq!(
                weights,
                for_fractions(&mut quick, &model, &rows, settings(128)),
                "{}",
                kind.name()
            );
            assert_eq!(exact.info().version, quick.info().version);
        }
    }
}

#[test]
fn a_difference_is_noticed() {
    let row = |weights: &[(u32, u32, u32)]| {
        let mut rows = RowBlock::default();
        for &(patch, visible, covered) in weights {
            rows.push(InputPatch(patch), visible, covered);
        }
        rows.end_row(1, 2);
        rows
    };
    let weights = row(&[(1, 30, 60), (2, 7, 7), (3, 0, 0), (4, 5, 9)]);
    let alike = row(&[(1, 15, 30), (2, 9, 9), (3, 2, 2), (4, 10, 18)]);
    let wanted = Apart {
        alike: 4,
        ..Apart::default()
    };
    assert_eq!(apart(&weights, &alike), wanted);
    let mut elsewhere = alike.clone();
    elsewhere.blocked[0] += 1;
    let wanted = Apart {
        rows: 1,
        ..Apart::default()
    };
    assert_eq!(apart(&weights, &elsewhere), wanted);
    let other = row(&[(1, 31, 60), (2, 7, 7), (5, 3, 3), (6, 3, 4)]);
    let wanted = Apart {
        alike: 1,
        other: 1,
        tiny: [1, 1],
        lost: 2,
        rows: 0,
    };
    assert_eq!(apart(&weights, &other), wanted);
}

#[test]
fn what_can_be_put_in_order_is_whichever_is_asked() {
    let chosen = |model: &Model| {
        let mut backend = CpuBackend::new();
        let load = |backend: &mut CpuBackend, fractions| {
            let loaded = if fractions {
                backend.load_for_fractions(model.geometry(), settings(128))
            } else {
                backend.load(model.geometry(), settings(128))
            };
            loaded.expect("legal settings");
            (backend.engine(), backend.choices().join("\n"))
        };
        [false, true].map(|fractions| load(&mut backend, fractions))
    };
    let room = model(generate::cornell_box(), Subdivision::Levels(4));
    for (name, model) in [
        ("room", room),
        ("block city", generated(Kind::BlockCity, 140_000)),
        ("maze", generated(Kind::Maze, 10_000)),
    ] {
        for (engine, reason) in chosen(&model) {
            assert_eq!(engine, Some(EngineChoice::Order), "{name}: {reason}");
        }
    }
    // Much of these is seen: in the room of few triangles that are soon ordered, in the field of many.
    let small_room = chosen(&generated(Kind::Room, 1_000));
    let field = chosen(&model(generate_field(), Subdivision::Split(2)));
    for (engine, reason) in small_room {
        assert_eq!(engine, Some(EngineChoice::Order), "small room: {reason}");
    }
    for (engine, reason) in field {
        assert_eq!(engine, Some(EngineChoice::Depth), "field: {reason}");
    }
}

fn generate_field() -> hemicube_scene::Scene {
    let spec = Generate {
        kind: Kind::Field,
        target_patches: 2_500,
        seed: 1,
    };
    generate::generate(spec).expect("a target in range")
}
