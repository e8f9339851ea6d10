//! The engines of the CPU backend see the same: pixel sums are the same bits, covered weights too, and engine `order`
//! is as lossless and as independent of the instruction set when it is forced on scenes that do not suit it. Rows of
//! engine `claims` are those of engine `depth`, to the last bit of the last tiny patch.

use glam::DVec3;
use hemicube::backend::{Culling, HemicubeBackend, RenderSettings, WHOLE};
use hemicube::delta::DeltaTable;
use hemicube::escaped::EscapedPixels;
use hemicube::row::{RowBlock, RowView};
use hemicube::{InputPatch, Model};
use hemicube_backend_cpu::{CpuBackend, EngineChoice, Isa};
use hemicube_scene::Subdivision;
use hemicube_scene::generate::{self, Kind};
use hemicube_tests::extremes;
use hemicube_tests::geometry::scene_of;
use hemicube_tests::rows::{hemicubes, render_with, spread};
use hemicube_tests::scenes::{cut_scenes, generated, model, read, say, scenes_or_skip};
use std::collections::{BTreeMap, BTreeSet};

fn backend(choice: EngineChoice, isa: Isa) -> CpuBackend {
    CpuBackend::with_isa(isa)
        .expect("an instruction set of this machine")
        .with_engine(choice)
}

fn settings(resolution: u32, covered: bool) -> RenderSettings {
    RenderSettings {
        resolution,
        culling: Culling::On,
        covered,
    }
}

fn rows(model: &Model, choice: EngineChoice, count: usize, settings: RenderSettings) -> RowBlock {
    let hemicubes = hemicubes(model, &spread(model, count));
    let mut backend = backend(choice, Isa::available()[0]);
    let (rows, _) = render_with(&mut backend, model, &hemicubes, settings);
    assert_eq!(backend.engine(), Some(choice));
    rows
}

/// Scenes of every kind, those that suit engine `order` and those that do not.
fn scenes() -> Vec<(String, Model)> {
    let mut found = vec![
        (
            "Cornell box ×256".to_owned(),
            model(generate::cornell_box(), Subdivision::Levels(4)),
        ),
        (
            "open Cornell box".to_owned(),
            model(generate::cornell_box_open(), Subdivision::Levels(2)),
        ),
    ];
    for (kind, count) in [
        (Kind::BlockCity, 9_000),
        (Kind::City, 9_000),
        (Kind::Maze, 5_000),
        (Kind::Spheres, 3_000),
        (Kind::Field, 3_000),
        (Kind::Soup, 1_500),
    ] {
        found.push((kind.name().to_owned(), generated(kind, count)));
    }
    let spec = generate::Generate {
        kind: Kind::Soup,
        target_patches: 1_500,
        seed: 5,
    };
    let mut scene = generate::generate(spec).expect("a target in range");
    for triangle in scene.triangles.iter_mut().step_by(3) {
        triangle.two_sided = true;
    }
    found.push(("two-sided soup".to_owned(), model(scene, Subdivision::None)));
    for (name, scene) in [
        ("duplicates", extremes::duplicates()),
        ("slivers", extremes::slivers()),
        ("room with a block", extremes::room_with_a_block(4)),
        ("mote", extremes::mote()),
        ("buried centroids", extremes::buried_centroids()),
    ] {
        found.push((name.to_owned(), model(scene, Subdivision::None)));
    }
    found
}

/// Rows of an engine, of what was cut as it was before and patch by patch.
fn whole_and_parted(model: &Model, choice: EngineChoice, count: usize, settings: RenderSettings) -> [RowBlock; 2] {
    let hemicubes = hemicubes(model, &spread(model, count));
    let backend = || backend(choice, Isa::available()[0]);
    let (mut whole, mut parted) = (backend(), backend().patch_by_patch());
    let rows = [&mut whole, &mut parted].map(|backend| render_with(backend, model, &hemicubes, settings).0);
    // Or the two would be one.
    assert_ne!(whole.info().version, parted.info().version);
    rows
}

#[test]
fn what_was_cut_shows_what_its_patches_show() {
    for (name, model) in cut_scenes() {
        for (choice, resolution) in [EngineChoice::Depth, EngineChoice::Order]
            .into_iter()
            .flat_map(|choice| [(choice, 64), (choice, 256)])
        {
            let [whole, parted] = whole_and_parted(&model, choice, 60, settings(resolution, false));
            for row in 0..whole.len() {
                assert_eq!(
                    whole.row(row),
                    parted.row(row),
                    "{name}, {choice:?}, N = {resolution}, row {row}"
                );
            }
        }
    }
}

/// Where a hemicube does not stand on its emitter, or does not look away from it, the other patches that were cut from
/// the same triangle are seen.
#[test]
fn from_off_a_triangle_its_other_patches_are_seen() {
    for (name, model) in cut_scenes() {
        let emitters = spread(&model, 24);
        let mut hemicubes = hemicubes(&model, &emitters);
        for (k, hemicube) in hemicubes.iter_mut().enumerate() {
            let [x, y, z] = hemicube.axes;
            match k % 4 {
                0 => {}
                1 => hemicube.origin -= z * 1e-3,
                2 => hemicube.origin += z * 1e-3 + x * 0.01,
                _ => hemicube.axes = [z, y, -x],
            }
        }
        let mut around = 0;
        for covered in [false, true] {
            let settings = settings(128, covered);
            let of = |mut backend: CpuBackend| render_with(&mut backend, &model, &hemicubes, settings).0;
            let depth = |isa| backend(EngineChoice::Depth, isa);
            let parted = of(depth(Isa::available()[0]).patch_by_patch());
            for choice in [EngineChoice::Depth, EngineChoice::Claims, EngineChoice::Order] {
                let whole = of(backend(choice, Isa::available()[0]));
                for row in (0..whole.len()).filter(|row| row % 4 != 0) {
                    assert_eq!(
                        whole.row(row),
                        parted.row(row),
                        "{name}, {choice:?}, covered {covered}, row {row}"
                    );
                }
            }
            // From behind, the others are all around the one that is not drawn.
            for (row, emitter) in emitters.iter().enumerate() {
                let row = parted.row(row);
                assert!(!row.patches.contains(&emitter.0), "{name}, patch {}", emitter.0);
                let is_near = |&p: &u32| p.abs_diff(emitter.0) <= 2;
                around += usize::from(row.blocked != 0 || row.patches.iter().any(is_near));
            }
        }
        assert!(around >= 6, "{name}: {around} rows see what is around their emitter");
    }
}

#[test]
fn slivers_that_were_cut_lose_no_light() {
    let scenes = [
        ("slivers", model(extremes::slivers(), Subdivision::Split(3))),
        ("duplicates", model(extremes::duplicates(), Subdivision::Split(3))),
        (
            "buried centroids",
            model(extremes::buried_centroids(), Subdivision::Split(3)),
        ),
    ];
    for (name, model) in scenes {
        for covered in [false, true] {
            let [whole, parted] = whole_and_parted(&model, EngineChoice::Depth, 60, settings(128, covered));
            let mut most = 0;
            for row in 0..whole.len() {
                let (whole, parted) = (whole.row(row), parted.row(row));
                let sum = |row: &RowView<'_>| row.visible.iter().sum::<u32>() + row.escaped + row.blocked;
                assert_eq!(sum(&whole), WHOLE, "{name}, row {row}");
                assert_eq!(
                    (whole.escaped, whole.blocked),
                    (parted.escaped, parted.blocked),
                    "{name}, row {row}"
                );
                most = most.max(apart(&whole, &parted));
            }
            say(&format!(
                "{name}: at most {:.1e} of a row apart",
                most as f64 / f64::from(WHOLE)
            ));
            assert!(most <= u64::from(WHOLE) / 1000, "{name}, covered {covered}: {most}");
        }
    }
}

#[test]
fn a_triangle_too_small_for_a_pixel_shows_its_patches() {
    // One looks up, the other down from far above, aside of the middle of any pixel; nothing else is in view.
    let floor = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let above = floor.map(|p| DVec3::new(0.1 * p.y + 20.0, 0.1 * p.x + 7.0, 100.0));
    // Cut, and so small beside the other that it is not.
    for (subdivision, patches) in [
        (Subdivision::Split(2), &[4, 5, 6, 7][..]),
        (Subdivision::PatchSize(0.3), &[25]),
    ] {
        let model = model(scene_of([floor, above]), subdivision);
        let hemicubes = hemicubes(&model, &[InputPatch(0)]);
        for choice in [EngineChoice::Depth, EngineChoice::Claims] {
            let whole = backend(choice, Isa::available()[0]);
            let parted = backend(choice, Isa::available()[0]).patch_by_patch();
            let rows =
                [whole, parted].map(|mut backend| render_with(&mut backend, &model, &hemicubes, settings(16, true)).0);
            let row = rows[0].row(0);
            assert_eq!((row.patches, row.escaped), (patches, WHOLE), "{choice:?}");
            assert_eq!(row, rows[1].row(0), "{choice:?}");
        }
    }
}

#[test]
fn what_was_cut_covers_what_its_patches_cover() {
    for ((name, model), choice) in cut_scenes()
        .iter()
        .flat_map(|scene| [(scene, EngineChoice::Depth), (scene, EngineChoice::Order)])
    {
        let name = format!("{name}, {choice:?}");
        let [whole, parted] = whole_and_parted(model, choice, 60, settings(128, true));
        let (mut shared, mut tiny_of_whole, mut tiny_of_parted) = (0, 0, 0);
        for row in 0..whole.len() {
            let of = |row: RowView<'_>| -> BTreeMap<u32, (u32, u32)> {
                let weights = row.visible.iter().copied().zip(row.covered.iter().copied());
                row.patches.iter().copied().zip(weights).collect()
            };
            let (whole, parted) = (of(whole.row(row)), of(parted.row(row)));
            for (patch, weights) in &whole {
                match parted.get(patch) {
                    Some(others) => {
                        assert_eq!(weights, others, "{name}, row {row}, patch {patch}");
                        shared += 1;
                    }
                    None => {
                        assert_eq!(*weights, (0, 0), "{name}, row {row}, patch {patch} is not seen");
                        tiny_of_whole += 1;
                    }
                }
            }
            for (patch, weights) in parted.iter().filter(|(patch, _)| !whole.contains_key(patch)) {
                assert_eq!(*weights, (0, 0), "{name}, row {row}, patch {patch} is seen");
                tiny_of_parted += 1;
            }
        }
        say(&format!(
            "{name}: {shared} entries alike; tiny patches seen only whole: {tiny_of_whole}, only patch by patch: {tiny_of_parted}"
        ));
        // Engine `order` asks for them what was covered before a plane was begun, and wholes have others than patches.
        let most = if choice == EngineChoice::Order { 5 } else { 20 };
        assert!(
            tiny_of_whole + tiny_of_parted <= shared / most + 8,
            "{name}: of {shared}"
        );
    }
}

#[test]
fn culling_and_instruction_sets_change_nothing_of_what_was_cut() {
    for (name, model) in cut_scenes() {
        let hemicubes = hemicubes(&model, &spread(&model, 20));
        for covered in [false, true] {
            let of = |isa, culling| {
                let settings = RenderSettings {
                    culling,
                    ..settings(144, covered)
                };
                render_with(&mut backend(EngineChoice::Depth, isa), &model, &hemicubes, settings).0
            };
            let wanted = of(Isa::available()[0], Culling::Off);
            for isa in Isa::available() {
                let found = of(isa, Culling::On);
                for row in 0..wanted.len() {
                    assert_eq!(
                        found.row(row),
                        wanted.row(row),
                        "{name}, {isa:?}, covered {covered}, row {row}"
                    );
                }
            }
        }
    }
}

#[test]
fn item_buffers_of_what_was_cut_add_up_to_its_rows() {
    for (name, model) in cut_scenes() {
        let settings = settings(112, false);
        let table = DeltaTable::new(settings.resolution);
        let hemicubes = hemicubes(&model, &spread(&model, 12));
        let mut backend = backend(EngineChoice::Depth, Isa::available()[0]);
        let (rows, _) = render_with(&mut backend, &model, &hemicubes, settings);
        for (row, hemicube) in hemicubes.iter().enumerate() {
            let items = backend.items(hemicube).expect("a legal hemicube");
            let (seen, escaped, blocked) = items.reduce(&table);
            let row = rows.row(row);
            let entries = row.patches.iter().copied().zip(row.visible.iter().copied());
            assert_eq!(
                (seen, escaped, blocked),
                (
                    entries.map(|(p, weight)| (InputPatch(p), weight)).collect(),
                    row.escaped,
                    row.blocked
                ),
                "{name}, {hemicube:?}"
            );
        }
    }
}

#[test]
fn pixel_sums_are_the_same_bits() {
    for (name, model) in scenes() {
        for resolution in [64, 256] {
            let [depth, order] = [EngineChoice::Depth, EngineChoice::Order]
                .map(|engine| rows(&model, engine, 60, settings(resolution, false)));
            for row in 0..depth.len() {
                assert_eq!(depth.row(row), order.row(row), "{name}, N = {resolution}, row {row}");
            }
        }
    }
}

#[test]
fn covered_weights_are_the_same_bits() {
    for (name, model) in scenes() {
        let [depth, order] =
            [EngineChoice::Depth, EngineChoice::Order].map(|engine| rows(&model, engine, 60, settings(128, true)));
        let (mut shared, mut tiny_of_depth, mut tiny_of_order) = (0, 0, 0);
        for row in 0..depth.len() {
            let (depth, order) = (depth.row(row), order.row(row));
            assert_eq!(
                (depth.escaped, depth.blocked),
                (order.escaped, order.blocked),
                "{name}, row {row}"
            );
            let mut others = order.patches.iter().zip(order.visible).zip(order.covered).peekable();
            for ((patch, visible), covered) in depth.patches.iter().zip(depth.visible).zip(depth.covered) {
                while others.next_if(|((p, _), _)| *p < patch).is_some() {
                    tiny_of_order += 1;
                }
                match others.next_if(|((p, _), _)| *p == patch) {
                    Some(((_, v), c)) => {
                        assert_eq!((v, c), (visible, covered), "{name}, row {row}, patch {patch}");
                        shared += 1;
                    }
                    None => {
                        assert_eq!(
                            (*visible, *covered),
                            (0, 0),
                            "{name}, row {row}, patch {patch} is not seen"
                        );
                        tiny_of_depth += 1;
                    }
                }
            }
            for ((patch, visible), covered) in others {
                assert_eq!((*visible, *covered), (0, 0), "{name}, row {row}, patch {patch} is seen");
                tiny_of_order += 1;
            }
        }
        assert!(shared > 0, "{name}: nothing was compared");
        say(&format!(
            "{name}: {shared} entries alike; tiny patches seen by one engine only: depth {tiny_of_depth}, order {tiny_of_order}"
        ));
        // Where pixels decide what hides a tiny patch, the engines may differ on some.
        assert!(
            tiny_of_depth + tiny_of_order <= shared / 4 + 8,
            "{name}: {tiny_of_depth} + {tiny_of_order} of {shared}"
        );
    }
}

#[test]
fn culling_in_order_is_lossless() {
    for (name, model) in scenes().into_iter().chain(cut_scenes()) {
        // Of fine hemicubes, what is covered before a plane is drawn is asked, not remembered.
        for (covered, resolution, count) in [(false, 64, 30), (true, 64, 30), (true, 512, 6)] {
            let on = settings(resolution, covered);
            let off = RenderSettings {
                culling: Culling::Off,
                ..on
            };
            let [on, off] = [on, off].map(|s| rows(&model, EngineChoice::Order, count, s));
            for row in 0..on.len() {
                assert_eq!(
                    on.row(row),
                    off.row(row),
                    "{name}, covered {covered}, N = {resolution}, row {row}"
                );
            }
        }
    }
}

#[test]
fn instruction_sets_draw_the_same() {
    for (name, model) in scenes().into_iter().chain(cut_scenes()) {
        for (covered, resolution, count) in [(false, 144, 30), (true, 144, 30), (true, 512, 6)] {
            let hemicubes = hemicubes(&model, &spread(&model, count));
            let of = |isa| {
                let mut backend = backend(EngineChoice::Order, isa);
                render_with(&mut backend, &model, &hemicubes, settings(resolution, covered))
            };
            let portable = of(Isa::Portable);
            for isa in Isa::available() {
                assert_eq!(
                    of(isa),
                    portable,
                    "{name}, {isa:?}, covered {covered}, N = {resolution}"
                );
            }
        }
    }
}

/// The rows of engine `claims`, on every instruction set, with culling and without, are those of engine `depth`.
fn assert_claims_are_rows_of_depth(name: &str, model: &Model, count: usize, resolutions: &[u32]) {
    let hemicubes = hemicubes(model, &spread(model, count));
    for (&resolution, covered) in resolutions.iter().flat_map(|n| [(n, false), (n, true)]) {
        let on = settings(resolution, covered);
        let mut depth = backend(EngineChoice::Depth, Isa::available()[0]);
        let (wanted, _) = render_with(&mut depth, model, &hemicubes, on);
        let off = RenderSettings {
            culling: Culling::Off,
            ..on
        };
        for isa in Isa::available() {
            // Drawing everything takes long; one instruction set is enough, as culling knows nothing of it.
            for settings in if isa == Isa::available()[0] {
                vec![on, off]
            } else {
                vec![on]
            } {
                let mut claims = backend(EngineChoice::Claims, isa);
                let (found, _) = render_with(&mut claims, model, &hemicubes, settings);
                assert_eq!(claims.engine(), Some(EngineChoice::Claims));
                for row in 0..wanted.len() {
                    assert_eq!(
                        found.row(row),
                        wanted.row(row),
                        "{name}, N = {resolution}, covered {covered}, {isa:?}, culling {:?}, row {row}",
                        settings.culling
                    );
                }
            }
        }
    }
}

#[test]
fn claims_are_the_rows_of_depth() {
    for (name, model) in scenes() {
        assert_claims_are_rows_of_depth(&name, &model, 30, &[16, 144, 256]);
    }
    for (name, model) in cut_scenes() {
        assert_claims_are_rows_of_depth(&name, &model, 20, &[64, 144]);
    }
}

#[test]
fn claims_are_the_rows_of_depth_at_the_finest() {
    for (name, model) in [
        ("soup", generated(Kind::Soup, 1_500)),
        ("duplicates", model(extremes::duplicates(), Subdivision::None)),
        (
            "room with a block",
            model(extremes::room_with_a_block(4), Subdivision::None),
        ),
    ] {
        assert_claims_are_rows_of_depth(name, &model, 6, &[1024]);
    }
}

#[test]
fn claims_in_real_scenes_are_the_rows_of_depth() {
    let Some(folder) = scenes_or_skip("engines::claims_in_real_scenes_are_the_rows_of_depth") else {
        return;
    };
    for (file, subdivision) in [
        ("city/denhaag-8897.obj", Subdivision::None),
        ("city/denhaag-8897.obj", Subdivision::Split(3)),
        ("city/rotterdam-delfshaven.obj", Subdivision::None),
        ("interior/aggressor.obj", Subdivision::None),
        ("interior/aggressor.obj", Subdivision::Split(2)),
        ("cornell/cornell-measured-closed-20q.obj", Subdivision::None),
    ] {
        let scene = read(&folder, file).unwrap_or_else(|error| panic!("{error}"));
        let model = model(scene, subdivision);
        assert_claims_are_rows_of_depth(file, &model, 40, &[256]);
    }
}

#[test]
fn real_scenes_that_were_cut_show_what_their_patches_show() {
    let Some(folder) = scenes_or_skip("engines::real_scenes_that_were_cut_show_what_their_patches_show") else {
        return;
    };
    let scenes = [
        ("city/denhaag-8897.obj", Subdivision::Split(4), 0),
        ("city/rotterdam-delfshaven.obj", Subdivision::Split(3), 0),
        // One eye lies on the edge of a floor: whether it sees the floor or what is behind it hangs on rounding.
        ("interior/aggressor.obj", Subdivision::Split(3), 1),
        ("cornell/cornell-measured-closed-20q.obj", Subdivision::Split(6), 0),
    ];
    for ((file, subdivision, most), choice) in scenes
        .into_iter()
        .flat_map(|scene| [(scene, EngineChoice::Depth), (scene, EngineChoice::Order)])
    {
        let scene = read(&folder, file).unwrap_or_else(|error| panic!("{error}"));
        let model = model(scene, subdivision);
        let [whole, parted] = whole_and_parted(&model, choice, 600, settings(128, false));
        let apart: Vec<usize> = (0..whole.len())
            .filter(|&r| apart(&whole.row(r), &parted.row(r)) > 0)
            .collect();
        assert!(apart.len() <= most, "{file}, {choice:?}: rows {apart:?}");
        for row in apart {
            // A span that rounding gives to no patch goes to the one that the eye lies on.
            let eye = hemicubes(&model, &spread(&model, 600))[row].origin;
            let (whole, parted) = (whole.row(row), parted.row(row));
            let others: Vec<u32> = whole
                .patches
                .iter()
                .filter(|p| !parted.patches.contains(p))
                .copied()
                .collect();
            let [patch] = others[..] else {
                panic!("{file}, row {row}: {others:?}");
            };
            let surfaces = &model.geometry().surfaces;
            let [a, b, c] = surfaces
                .iter()
                .find(|s| s.front.0 == patch)
                .expect("it is one-sided")
                .corners;
            let detour = |p: DVec3, q: DVec3| p.distance(eye) + eye.distance(q) - p.distance(q);
            assert!(
                detour(a, b).min(detour(b, c)).min(detour(c, a)) < 1e-9,
                "{file}, row {row}: {patch}"
            );
        }
    }
}

#[test]
fn fine_hemicubes_are_drawn_by_claims() {
    let model = generated(Kind::Spheres, 3_000);
    let hemicubes = hemicubes(&model, &spread(&model, 4));
    let of = |choice, resolution, culling| {
        let mut backend = backend(choice, Isa::available()[0]);
        let settings = RenderSettings {
            culling,
            ..settings(resolution, true)
        };
        let (rows, _) = render_with(&mut backend, &model, &hemicubes, settings);
        (backend.engine(), rows, backend.info().version.clone())
    };
    let depth = Some(EngineChoice::Depth);
    assert_eq!(of(EngineChoice::Auto, 64, Culling::On).0, depth);
    assert_eq!(of(EngineChoice::Auto, 1024, Culling::Off).0, depth);
    let (engine, rows, version) = of(EngineChoice::Auto, 1024, Culling::On);
    assert_eq!(engine, Some(EngineChoice::Claims));
    // So a run that was begun by one can be taken up by the other.
    assert_eq!((depth, rows, version), of(EngineChoice::Depth, 1024, Culling::On));
}

#[test]
fn real_scenes_are_the_same_in_both() {
    let Some(folder) = scenes_or_skip("engines::real_scenes_are_the_same_in_both") else {
        return;
    };
    for (file, most) in [
        ("city/denhaag-8897.obj", 12),
        ("city/rotterdam-delfshaven.obj", 6),
        ("interior/aggressor.obj", 0),
        ("cornell/cornell-measured-closed-20q.obj", 0),
    ] {
        let scene = read(&folder, file).unwrap_or_else(|error| panic!("{error}"));
        let model = model(scene, Subdivision::None);
        let [depth, order] =
            [EngineChoice::Depth, EngineChoice::Order].map(|engine| rows(&model, engine, 60, settings(128, false)));
        // Walls a hair apart are nearer to each other than f32 depths can tell; the order can.
        let apart: Vec<u64> = (0..depth.len())
            .map(|r| apart(&depth.row(r), &order.row(r)))
            .filter(|&weight| weight > 0)
            .collect();
        say(&format!(
            "{file}: {} of {} rows differ, by at most {:.1e} of the whole",
            apart.len(),
            depth.len(),
            apart.iter().max().map_or(0.0, |&w| w as f64 / f64::from(WHOLE))
        ));
        assert!(apart.len() <= most, "{file}: {} rows differ", apart.len());
        assert!(
            apart.iter().all(|&weight| weight <= u64::from(WHOLE) / 1000),
            "{file}: {apart:?}"
        );
    }
}

/// Half the weight that two rows disagree about.
fn apart(a: &RowView<'_>, b: &RowView<'_>) -> u64 {
    let of = |row: &RowView<'_>| -> BTreeMap<u32, u32> {
        row.patches.iter().copied().zip(row.visible.iter().copied()).collect()
    };
    let (of_a, of_b) = (of(a), of(b));
    let patches: BTreeSet<u32> = of_a.keys().chain(of_b.keys()).copied().collect();
    let weight = |row: &BTreeMap<u32, u32>, patch| row.get(&patch).copied().unwrap_or(0);
    let entries: u64 = patches
        .iter()
        .map(|p| u64::from(weight(&of_a, *p).abs_diff(weight(&of_b, *p))))
        .sum();
    (entries + u64::from(a.escaped.abs_diff(b.escaped)) + u64::from(a.blocked.abs_diff(b.blocked))) / 2
}

#[test]
fn a_difference_is_noticed() {
    fn row(visible: &[u32; 2], escaped: u32) -> RowView<'_> {
        RowView {
            patches: &[3, 5],
            visible,
            covered: &[0, 0],
            escaped,
            blocked: 0,
        }
    }
    assert_eq!(apart(&row(&[10, 20], 5), &row(&[10, 20], 5)), 0);
    assert_eq!(apart(&row(&[10, 20], 5), &row(&[12, 17], 6)), 3);
}

#[test]
fn what_cannot_be_put_in_order_is_refused_or_drawn_by_depth() {
    // A heap of copies: every one overlaps every other.
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let copies = (0..3000).map(|k| corners.map(|p| p * (1.0 + f64::from(k) * 1e-6)));
    let model = model(scene_of(copies), Subdivision::None);
    let mut asked = CpuBackend::new().with_engine(EngineChoice::Order);
    let refused = asked.load(model.geometry(), settings(64, false));
    assert!(
        refused
            .as_ref()
            .is_err_and(|e| e.to_string().contains("overlap in one plane")),
        "{refused:?}"
    );
    let mut auto = CpuBackend::new();
    auto.load(model.geometry(), settings(64, false)).expect("any scene");
    // Few of them are drawn, as all lie behind the first.
    assert_eq!(auto.engine(), Some(EngineChoice::Claims));
    assert!(
        auto.choices()[0].contains("overlap in one plane"),
        "{:?}",
        auto.choices()
    );
}

#[test]
fn each_scene_gets_the_engine_that_suits_it() {
    let chosen = |model: &Model| {
        let mut backend = CpuBackend::new();
        backend
            .load(model.geometry(), settings(64, false))
            .expect("legal settings");
        (backend.engine(), backend.choices().join("\n"))
    };
    for (kind, count, wanted) in [
        (Kind::BlockCity, 9_000, EngineChoice::Order),
        (Kind::BlockCity, 140_000, EngineChoice::Order),
        (Kind::Maze, 10_000, EngineChoice::Order),
        (Kind::Spheres, 10_000, EngineChoice::Depth),
        (Kind::Soup, 10_000, EngineChoice::Depth),
    ] {
        let (engine, reason) = chosen(&generated(kind, count));
        assert_eq!(engine, Some(wanted), "{}: {reason}", kind.name());
        assert!(reason.starts_with("engine "), "{reason}");
    }
    let room = model(generate::cornell_box(), Subdivision::Levels(4));
    assert_eq!(chosen(&room).0, Some(EngineChoice::Order));
}

/// Escaped pixels of every engine are those of its item buffer, their weight is the row's, and the session renders the
/// same rows afterwards.
#[test]
fn escaped_pixels_are_those_of_item_buffers_and_rows() {
    let mut all = scenes();
    all.extend(cut_scenes());
    for (name, model) in all {
        for (choice, resolution) in [EngineChoice::Depth, EngineChoice::Claims, EngineChoice::Order]
            .into_iter()
            .flat_map(|choice| [(choice, 48), (choice, 128)])
        {
            let settings = settings(resolution, false);
            let hemicubes = hemicubes(&model, &spread(&model, 12));
            let mut backend = backend(choice, Isa::available()[0]);
            let (rows, _) = render_with(&mut backend, &model, &hemicubes, settings);
            let table = DeltaTable::new(resolution);
            let (mut found, mut by_items) = (EscapedPixels::default(), EscapedPixels::default());
            for (row, hemicube) in hemicubes.iter().enumerate() {
                let of = format!("{name}, {choice:?}, N = {resolution}, row {row}");
                backend.escaped(hemicube, &table, &mut found).expect("renders");
                by_items.take(&backend.items(hemicube).expect("renders"), &table);
                let view = rows.row(row);
                assert_eq!(
                    (found.weight(&table), found.blocked),
                    (view.escaped, view.blocked),
                    "{of}"
                );
                if choice != EngineChoice::Order {
                    assert!(found == by_items, "{of}");
                }
            }
            let (again, _) = render_with(&mut backend, &model, &hemicubes, settings);
            assert!(rows == again, "{name}, {choice:?}: rows after escaped pixels");
        }
    }
}

/// The instructions of AVX and its successors that are functions of their own, in what `nm` prints of a program: what
/// calls one lacks the feature, so that the compiler could not put the instruction there.
#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
fn called_instructions(symbols: &str) -> Vec<&str> {
    let names = symbols.lines().filter_map(|line| line.split("9core_arch3x86").nth(1));
    // The length of a module's name stands before it.
    let module = |name: &str| name.trim_start_matches(|c: char| c.is_ascii_digit()).starts_with("avx");
    names.filter(|name| module(name)).collect()
}

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
#[test]
fn kernels_have_their_instructions_and_call_none() {
    // An instruction that a closure without its feature called made hemicubes by AVX2 3.7 times as dear.
    let listed = std::process::Command::new("nm")
        .arg(hemicube_tests::scenes::program())
        .output();
    let symbols = String::from_utf8(listed.expect("nm, beside the linker").stdout).expect("names");
    assert!(symbols.contains("hemicube_backend_cpu"), "a program with its symbols");
    let mut found = called_instructions(&symbols);
    found.retain(|name| !name.ends_with("__mm256_movemask_epi8")); // memchr's
    assert!(found.is_empty(), "{found:?}");
    let symbols = "0 t _RNvNtNtNtCs_4core9core_arch3x864avx218__mm256_cmpeq_epi64\n\
        0 t _ZN4core9core_arch3x863avx17_mm256_set1_pd17h4fd8eaddd785604cE\n\
        0 t _RNvNtNtNtCs_4core9core_arch3x8610avx512vbmi23__mm512_permutexvar_epi8\n\
        0 t _RNvNtNtNtCs_4core9core_arch3x865xsave7__xgetbv";
    assert_eq!(called_instructions(symbols).len(), 3);
}
