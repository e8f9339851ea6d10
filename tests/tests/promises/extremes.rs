//! What breaks hemicubes elsewhere: plates a millionth apart, slivers a million times as long as high, triangles that
//! lie on one another, units of a nanometre and of a million kilometres, one patch, no view, a patch inside a solid,
//! plates with two sides, walls that pierce the ground.

use glam::DVec3;
use hemicube::Model;
use hemicube::backend::{Culling, Geometry, HemicubeBackend, RenderSettings, WHOLE};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection};
use hemicube::row::{RowBlock, RowView};
use hemicube_backend_cpu::{CpuBackend, EngineChoice};
use hemicube_scene::generate::cornell_box;
use hemicube_scene::{InputPatch, Scene, Side, Subdivision};
use hemicube_tests::extremes::{buried_centroids, room_with_a_block};
use hemicube_tests::geometry::{
    box_inside, even, flipped, grid, irrational_rotation, moved, parallel_rectangles, point_to_polygon, quad, scene_of,
    scene_with_sides,
};
use hemicube_tests::rows::{Rung, hemicubes, parts, render, settings, spread};
use hemicube_tests::scenes::{model, model_as_it_is, say};

fn all_rows(model: &Model, resolution: u32) -> RowBlock {
    let patches: Vec<InputPatch> = model.patches().iter().collect();
    let hemicubes = hemicubes(model, &patches);
    assert_eq!(hemicubes.len(), patches.len(), "a patch without a frame");
    let rows = render(model, &hemicubes, settings(resolution)).0;
    let brute = render(
        model,
        &hemicubes,
        RenderSettings {
            culling: Culling::Off,
            ..settings(resolution)
        },
    )
    .0;
    assert!(rows == brute, "culling changes rows");
    rows
}

/// The part of a row that shows patches for which `wanted` holds.
fn shown(row: RowView<'_>, wanted: impl Fn(InputPatch) -> bool) -> f64 {
    let seen = row
        .patches
        .iter()
        .zip(row.visible)
        .filter(|&(&patch, _)| wanted(InputPatch(patch)));
    seen.map(|(_, &weight)| f64::from(weight) / f64::from(WHOLE)).sum()
}

fn share(weight: u32) -> f64 {
    f64::from(weight) / f64::from(WHOLE)
}

#[test]
fn plates_a_millionth_apart() {
    let rotation = irrational_rotation();
    let gap = 1e-6;
    let [floor, ceiling, ..] = box_inside(DVec3::new(1.0, 1.0, gap));
    let triangles = [floor, ceiling]
        .into_iter()
        .flat_map(|face| grid(face, &even(6), &even(6)));
    let model = model_as_it_is(&moved(scene_of(triangles), |p| rotation * p), Subdivision::None);
    let rows = all_rows(&model, 256);
    for patch in model.patches().iter() {
        let row = rows.row(patch.0 as usize);
        let other = |seen: InputPatch| (seen.0 < 72) != (patch.0 < 72);
        let facing = shown(row, other);
        // Centroids are at least 0.05 from the rim: what escapes is below (gap/0.05)².
        assert!(1.0 - facing < 1e-6, "{patch:?}: {facing}");
        assert_eq!(row.blocked, 0);
        assert_eq!(shown(row, |seen| !other(seen)), 0.0, "a plate sees itself");
    }
}

#[test]
fn a_sheet_a_millionth_above_the_floor_hides_it() {
    let rotation = irrational_rotation();
    let [floor, ceiling, ..] = box_inside(DVec3::ONE);
    let sheet = floor.map(|p| p + DVec3::Z * 1e-6);
    // The floor has the smaller ids, which a tie would show.
    let faces = [floor, sheet, ceiling];
    let triangles = faces.into_iter().flat_map(|face| grid(face, &even(5), &even(5)));
    let model = model_as_it_is(&moved(scene_of(triangles), |p| rotation * p), Subdivision::None);
    let rows = all_rows(&model, 256);
    for patch in model.patches().iter() {
        let row = rows.row(patch.0 as usize);
        match patch.0 / 50 {
            0 => assert!(
                share(row.blocked) > 1.0 - 1e-6,
                "{patch:?} sees past the sheet: {}",
                share(row.blocked)
            ),
            1 => assert_eq!(shown(row, |seen| seen.0 < 100), 0.0, "{patch:?} sees its neighbours"),
            _ => {
                let through = shown(row, |seen| seen.0 < 50);
                assert!(
                    through == 0.0,
                    "{patch:?} sees {through} of the floor through the sheet"
                );
                assert!(shown(row, |seen| (50..100).contains(&seen.0)) > 0.1);
            }
        }
    }
}

/// A cube's inside whose faces are cut at 0, 0.1, 0.3, … and a ten-millionth after each: slivers of up to 10⁶ : 1
/// between ordinary patches, with common corners.
fn slivers() -> Scene {
    let width = 1e-7;
    let mut places = vec![0.0];
    for place in [0.123, 0.31, 0.5, 0.77] {
        places.extend([place, place + width]);
    }
    places.push(1.0);
    scene_of(
        box_inside(DVec3::ONE)
            .into_iter()
            .flat_map(|face| grid(face, &places, &places)),
    )
}

#[test]
fn slivers_do_not_leak() {
    let rotation = irrational_rotation();
    let scene = moved(slivers(), |p| rotation * p);
    let aspect = |[a, b, c]: [DVec3; 3]| {
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        longest * longest / (b - a).cross(c - a).length()
    };
    let worst = scene.triangles.iter().map(|t| aspect(t.corners)).fold(0.0, f64::max);
    assert!(worst > 1e6, "{worst}");
    let model = model(scene, Subdivision::None);
    assert_eq!(model.patches().len(), 6 * 81 * 2, "repair dropped a sliver");
    let (mut escaped, mut blocked, mut pixels) = (0u64, 0u64, 0u64);
    for resolution in [64, 256] {
        let rows = all_rows(&model, resolution);
        escaped += rows.escaped.iter().map(|&e| u64::from(e)).sum::<u64>();
        blocked += rows.blocked.iter().map(|&b| u64::from(b)).sum::<u64>();
        pixels += 3 * u64::from(resolution).pow(2) * rows.len() as u64;
    }
    say(&format!(
        "slivers: of {pixels} pixels, weight {escaped} escaped, {blocked} blocked"
    ));
    // Faces share their corners, so that no pixel's centre lies between two triangles.
    assert_eq!((escaped, blocked), (0, 0));
}

#[test]
fn slivers_that_meet_at_t_junctions_leak_next_to_nothing() {
    let rotation = irrational_rotation();
    let width = 1e-7;
    // Each face is cut along one direction only, so that its cuts end amid the edges of its neighbours.
    let places: Vec<f64> = (0..40)
        .flat_map(|k| [f64::from(k) / 40.0, f64::from(k) / 40.0 + width])
        .chain([1.0])
        .collect();
    let triangles = box_inside(DVec3::ONE).into_iter().enumerate().flat_map(|(k, face)| {
        if k % 2 == 0 {
            grid(face, &places, &even(1))
        } else {
            grid(face, &even(1), &places)
        }
    });
    let model = model(moved(scene_of(triangles), |p| rotation * p), Subdivision::None);
    let rows = all_rows(&model, 256);
    let leak = rows
        .escaped
        .iter()
        .zip(&rows.blocked)
        .map(|(&e, &b)| share(e) + share(b))
        .sum::<f64>()
        / rows.len() as f64;
    say(&format!("slivers at T-junctions: {leak:.1e} of the light leaks"));
    assert!(leak < 1e-6, "{leak}");
}

#[test]
fn of_coinciding_triangles_the_smaller_id_takes_all() {
    let rotation = irrational_rotation();
    let once = moved(cornell_box(), |p| rotation * p);
    let mut pieces = Vec::new();
    once.triangles
        .iter()
        .for_each(|t| Subdivision::Levels(1).cut(&t.corners, &mut pieces));
    let single = model_as_it_is(&scene_of(pieces.iter().copied()), Subdivision::None);
    let expected = all_rows(&single, 96);
    // Each triangle and then its twin, from another corner; every third has a twin of the other winding besides.
    let mut twins = Vec::new();
    let mut first_of = Vec::new();
    for (k, &[a, b, c]) in pieces.iter().enumerate() {
        first_of.push(u32::try_from(twins.len()).expect("a small scene"));
        twins.push([a, b, c]);
        twins.push(if k % 2 == 0 { [b, c, a] } else { [c, a, b] });
        if k % 3 == 0 {
            twins.push([[c, b, a], [b, a, c], [a, c, b]][k / 3 % 3]);
        }
    }
    let doubled = model_as_it_is(&scene_of(twins), Subdivision::None);
    let rows = all_rows(&doubled, 96);
    // A reversed twin is no duplicate: what was under a block, and blocked, now sees the twins of the block's insides.
    let in_the_open: Vec<usize> = (0..first_of.len()).filter(|&k| expected.blocked[k] == 0).collect();
    assert!(in_the_open.len() > 150);
    for &k in &in_the_open {
        let first = first_of[k];
        // A patch's hemicube is turned by a hash of its id, so that ids must agree for rows to.
        let hemicube = single
            .hemicubes(InputPatch(u32::try_from(k).expect("a small scene")), 1, true)
            .remove(0);
        let same = hemicube::backend::Hemicube {
            emitter: Some(InputPatch(first)),
            ..hemicube
        };
        let (row, _) = render(&doubled, &[same], settings(96));
        let seen: Vec<u32> = expected.row(k).patches.iter().map(|&p| first_of[p as usize]).collect();
        assert_eq!(row.row(0).patches, seen, "patch {first}");
        assert_eq!(row.row(0).visible, expected.row(k).visible, "patch {first}");
        // The backs of reversed twins lie where a front is: that front wins.
        assert_eq!(
            (row.escaped[0], row.blocked[0]),
            (expected.escaped[k], expected.blocked[k]),
            "patch {first}"
        );
    }
    // Twins themselves see what the first see, and nobody sees a twin that another's front covers.
    let first: std::collections::BTreeSet<u32> = first_of.iter().copied().collect();
    for patch in in_the_open.iter().map(|&k| first_of[k]) {
        let row = rows.row(patch as usize);
        assert!(
            row.patches.iter().all(|p| first.contains(p)),
            "patch {patch} sees a twin"
        );
    }
}

#[test]
fn any_unit() {
    let scene = moved(cornell_box(), |p| irrational_rotation() * p);
    let rows_at = |factor: f64| {
        let model = model(moved(scene.clone(), |p| p * factor), Subdivision::Levels(1));
        assert_eq!(model.patches().len(), 160, "scale {factor}");
        all_rows(&model, 64)
    };
    let one = rows_at(1.0);
    for power in [-30, -1, 3, 30, 100] {
        assert!(rows_at(2f64.powi(power)) == one, "a power of two changes rows");
    }
    for factor in [1e-9, 1e-3, 1e3, 1e9] {
        let rows = rows_at(factor);
        let mut different = 0;
        for k in 0..rows.len() {
            assert_eq!(
                (rows.escaped[k], rows.blocked[k]),
                (one.escaped[k], one.blocked[k]),
                "scale {factor}"
            );
            different += u32::from(rows.row(k) != one.row(k));
        }
        // Corners are rounded anew, by 10⁻¹⁶ of the room: hardly ever does a pixel's centre change sides.
        assert!(different <= 2, "scale {factor}: {different} rows differ");
    }
}

/// As far off as a model still takes: `hemicube::ModelError::Dwarfed` is what comes of more.
#[test]
fn a_room_has_its_rows_also_beside_something_far_off() {
    let room = model(cornell_box(), Subdivision::None);
    let alone = all_rows(&room, 128);
    let beside = |distance: f64| {
        let mut scene = cornell_box();
        let corners = [DVec3::ZERO, DVec3::Y, DVec3::Z].map(|p| (DVec3::X + 0.1 * p) * distance);
        scene.triangles.push(hemicube_scene::Triangle {
            corners,
            ..scene.triangles[0]
        });
        all_rows(&model(scene, Subdivision::None), 128)
    };
    for distance in [1e6, 1e9, 2e11] {
        let rows = beside(distance);
        for k in 0..alone.len() {
            let apart = |id: u32| {
                let of = |rows: &RowBlock| shown(rows.row(k), |patch| patch.0 == id);
                (of(&rows) - of(&alone)).abs()
            };
            let apart = (0..41).map(apart).sum::<f64>();
            // Corners are rounded anew, by 10⁻⁷ of the room: a pixel or two change sides.
            assert!(apart < 5e-3, "{distance:e}, row {k}: {apart}");
        }
    }
}

#[test]
fn a_single_patch_and_an_empty_view() {
    let triangle = [
        DVec3::new(3.0, 1.0, 2.0),
        DVec3::new(4.0, 1.5, 2.0),
        DVec3::new(3.0, 2.0, 2.5),
    ];
    for (two_sided, count) in [(false, 1), (true, 2)] {
        let rows = all_rows(&model(scene_with_sides([(triangle, two_sided)]), Subdivision::None), 64);
        assert_eq!(rows.len(), count);
        assert!(rows.escaped.iter().all(|&e| e == WHOLE));
        assert!(rows.patches.is_empty());
    }
    // Back to back, and side by side in a plane: neither sees the other.
    let [a, b, c] = triangle;
    let below = [a, c, b].map(|p| p - DVec3::new(-0.5, 1.0, 1.0));
    for other in [below, triangle.map(|p| p + (b - a) * 3.0)] {
        let rows = all_rows(&model(scene_of([triangle, other]), Subdivision::None), 64);
        assert!(rows.escaped.iter().all(|&e| e == WHOLE), "{:?}", rows);
    }
}

#[test]
fn a_patch_inside_a_solid_is_blocked() {
    let solid = box_inside(DVec3::ONE).map(flipped).into_iter().flat_map(quad);
    let inner = |s: f64| {
        [
            DVec3::new(0.3, 0.4, 0.5),
            DVec3::new(0.3 + s, 0.4, 0.55),
            DVec3::new(0.3, 0.4 + s, 0.45),
        ]
    };
    for size in [0.2, 1e-6] {
        let scene = scene_with_sides(solid.clone().map(|t| (t, false)).chain([(inner(size), true)]));
        let model = model_as_it_is(&moved(scene, |p| irrational_rotation() * p), Subdivision::None);
        let rows = all_rows(&model, 64);
        assert_eq!(rows.len(), 14);
        for k in 12..14 {
            assert_eq!(rows.blocked[k], WHOLE, "size {size}");
            assert!(rows.row(k).patches.is_empty());
        }
        // The solid's own patches look out.
        assert!(rows.escaped[..12].iter().all(|&e| e == WHOLE));
    }
}

#[test]
fn two_sided_plates() {
    let [floor, ceiling, ..] = box_inside(DVec3::ONE);
    let middle = floor.map(|p| p + DVec3::Z * 0.5);
    let sided = [floor, middle, ceiling]
        .into_iter()
        .flat_map(|face| grid(face, &even(8), &even(8)))
        .map(|t| (t, true));
    let rotation = irrational_rotation();
    let model = model(moved(scene_with_sides(sided), |p| rotation * p), Subdivision::None);
    let patches = model.patches();
    assert_eq!(patches.len(), 3 * 128 * 2);
    let rows = all_rows(&model, 128);
    let plate = |patch: InputPatch| patches.surface(patch) / 128;
    // From one side of a plate to one of the next, area-weighted; plates are half a unit apart.
    let mut sums = [[0.0; 2]; 3];
    for patch in patches.iter() {
        let row = rows.row(patch.0 as usize);
        assert_eq!(row.blocked, 0, "a two-sided plate has no back");
        // Floor and middle look up with their front, the ceiling down.
        let up = (patches.side(patch) == Side::Front) == (plate(patch) != 2);
        let next = if up {
            plate(patch).checked_add(1)
        } else {
            plate(patch).checked_sub(1)
        };
        let facing = |seen: InputPatch| {
            let seen_up = (patches.side(seen) == Side::Front) == (plate(seen) != 2);
            Some(plate(seen)) == next && seen_up != up
        };
        assert_eq!(shown(row, |seen| !facing(seen)), 0.0, "{patch:?} sees what it cannot");
        sums[plate(patch)][usize::from(up)] += shown(row, facing) / 128.0;
    }
    let exact = parallel_rectangles(1.0, 1.0, 0.5);
    for (plate, sides) in sums.iter().enumerate() {
        for (up, &found) in sides.iter().enumerate() {
            let expected = if (plate, up) == (0, 0) || (plate, up) == (2, 1) {
                0.0
            } else {
                exact
            };
            assert!(
                (found - expected).abs() < 4e-3,
                "plate {plate}, up {up}: {found}, not {expected}"
            );
        }
    }
}

#[test]
fn walls_that_pierce_an_unsplit_ground() {
    let ground = [(-50., -50.), (50., -50.), (50., 50.), (-50., 50.)].map(|(x, y)| DVec3::new(x, y, 0.0));
    let wall = |p: DVec3| p * DVec3::new(2.0, 3.0, 8.0) + DVec3::new(0.3, 0.7, -4.0);
    let tower = box_inside(DVec3::ONE).map(|face| flipped(face).map(wall));
    let mut triangles: Vec<[DVec3; 3]> = quad(ground).to_vec();
    let ground_count = triangles.len();
    // Seven pieces of eight units: no cut lies in the ground's plane.
    triangles.extend(tower.into_iter().flat_map(|face| grid(face, &even(7), &even(7))));
    let rotation = irrational_rotation();
    let model = model(moved(scene_of(triangles), |p| rotation * p), Subdivision::None);
    let rows = all_rows(&model, 256);
    let ground = ground.map(|p| rotation * p);
    let up = rotation * DVec3::Z;
    for patch in model.patches().iter().skip(ground_count) {
        let row = rows.row(patch.0 as usize);
        let (origin, normal) = (model.patches().centroid(patch), model.patches().normal(patch));
        let height = origin.dot(up);
        assert!(height.abs() > 0.05);
        // A convex tower sees nothing but the ground: from above its front, from below its back.
        let exact = point_to_polygon(origin, normal, &ground);
        let found = if height > 0.0 {
            shown(row, |seen| seen.0 < 2)
        } else {
            share(row.blocked)
        };
        assert!(
            (found - exact).abs() < 2e-3,
            "{patch:?} at {height}: {found}, not {exact}"
        );
        assert!(
            (found + share(row.escaped) - 1.0).abs() < 1e-12,
            "{patch:?} sees something else"
        );
    }
    for patch in 0..2 {
        let row = rows.row(patch);
        let above = shown(row, |seen| model.patches().centroid(seen).dot(up) > -8.0 / 7.0);
        assert!(
            above > 0.0 && shown(row, |_| true) == above,
            "the ground sees what is under it"
        );
        assert_eq!(row.blocked, 0);
    }
}

#[test]
fn patches_that_share_an_edge_at_any_angle() {
    let rotation = irrational_rotation();
    for degrees in [1e-3, 0.1, 1.0, 20.0, 90.0, 160.0, 179.0, 179.9, 179.999] {
        let (sine, cosine) = f64::to_radians(degrees).sin_cos();
        let hinge = [DVec3::ZERO, DVec3::X];
        let floor = [hinge[0], hinge[1], DVec3::new(0.5, 1.0, 0.0)];
        let leaf = [hinge[1], hinge[0], DVec3::new(0.5, cosine, sine)];
        let [floor, leaf] = [floor, leaf].map(|t| t.map(|p| rotation * p));
        let model = model(scene_of([floor, leaf]), Subdivision::Levels(2));
        let rows = all_rows(&model, 256);
        let mut worst = 0.0f64;
        for patch in model.patches().iter() {
            let (from, to) = if patch.0 < 16 { (0..16, &leaf) } else { (16..32, &floor) };
            let row = rows.row(patch.0 as usize);
            let (origin, normal) = (model.patches().centroid(patch), model.patches().normal(patch));
            let found = shown(row, |seen| !from.contains(&seen.0));
            worst = worst.max((found - point_to_polygon(origin, normal, to)).abs());
            assert_eq!(
                shown(row, |seen| from.contains(&seen.0)),
                0.0,
                "{degrees}°: a triangle sees itself"
            );
            assert_eq!(row.blocked, 0, "{degrees}°");
        }
        assert!(worst < 2e-3, "{degrees}°: off by {worst}");
    }
}

#[test]
fn a_patch_a_million_times_smaller_than_the_room() {
    let rotation = irrational_rotation();
    let room: Vec<[DVec3; 3]> = box_inside(DVec3::ONE)
        .into_iter()
        .flat_map(|face| grid(face, &even(4), &even(4)))
        .collect();
    let at = DVec3::new(0.41, 0.53, 0.37);
    let mote = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| at + p * 1e-6);
    let mote_id = u32::try_from(room.len()).expect("a small scene");
    let scene = scene_with_sides(room.into_iter().map(|t| (t, false)).chain([(mote, true)]));
    let model = model(moved(scene, |p| rotation * p), Subdivision::None);
    let rows = all_rows(&model, 256);
    for patch in [mote_id, mote_id + 1].map(InputPatch) {
        let row = rows.row(patch.0 as usize);
        assert_eq!((row.escaped, row.blocked), (0, 0));
        let (origin, normal) = (model.patches().centroid(patch), model.patches().normal(patch));
        for (face, quad) in box_inside(DVec3::ONE).into_iter().enumerate() {
            let exact = point_to_polygon(origin, normal, &quad.map(|p| rotation * p));
            let found = shown(row, |seen| seen.0 as usize / 32 == face);
            assert!(
                (found - exact).abs() < 2e-3,
                "side {patch:?}, face {face}: {found}, not {exact}"
            );
        }
    }
    // No pixel's centre falls on it, but from everywhere it is nearest at its centroid.
    let settings = RenderSettings {
        covered: true,
        ..settings(256)
    };
    let walls: Vec<InputPatch> = spread(&model, 200).into_iter().filter(|p| p.0 < mote_id).collect();
    let (rows, _) = render(&model, &hemicubes(&model, &walls), settings);
    for (k, patch) in walls.iter().enumerate() {
        let row = rows.row(k);
        let entries: Vec<usize> = (0..row.patches.len()).filter(|&e| row.patches[e] >= mote_id).collect();
        assert_eq!(entries.len(), 1, "{patch:?} sees one side of the mote");
        assert_eq!(
            (row.visible[entries[0]], row.covered[entries[0]]),
            (0, 0),
            "{patch:?}: it is tiny"
        );
    }
}

/// The mean share of rows that goes to patches in the emitter's own plane, or to the backs of one-sided ones, of which
/// a closed room shows none: with frames in f64 as they are, or made of f32 world coordinates, where the emitter is hit
/// like anything else.
fn self_hits(model: &Model, is_single: bool) -> f64 {
    #[allow(clippy::cast_possible_truncation, reason = "the loss is what is shown")]
    let single = |p: DVec3| p.as_vec3().as_dvec3();
    let geometry = model.geometry();
    let mut surfaces = geometry.surfaces.clone();
    let patches: Vec<InputPatch> = model.patches().iter().collect();
    let mut asked = hemicubes(model, &patches);
    let mut tolerance = geometry.plane_tolerance;
    if is_single {
        surfaces.iter_mut().for_each(|s| s.corners = s.corners.map(single));
        for hemicube in &mut asked {
            hemicube.origin = single(hemicube.origin);
            hemicube.axes = hemicube.axes.map(single);
            hemicube.emitter = None;
        }
        tolerance = 0.0;
    }
    let geometry = Geometry::new(surfaces, geometry.octree.clone(), geometry.patch_count, tolerance);
    let mut backend = CpuBackend::new();
    backend
        .load(&std::sync::Arc::new(geometry), settings(64))
        .expect("legal settings");
    let mut rows = RowBlock::default();
    backend.rows(&asked, &mut rows).expect("legal hemicubes");
    rows.check(asked.len(), model.geometry().patch_count, false)
        .expect("rows that sum to 1 all the same");
    let of_own_plane = |(k, &patch): (usize, &InputPatch)| {
        let (normal, origin) = (model.patches().normal(patch), model.patches().centroid(patch));
        let row = rows.row(k);
        let in_plane = |seen: InputPatch| {
            let corners = model.patches().corners(seen);
            corners.iter().all(|&p| normal.dot(p - origin).abs() < 1e-9)
        };
        shown(row, in_plane) + share(row.blocked)
    };
    patches.iter().enumerate().map(of_own_plane).sum::<f64>() / patches.len() as f64
}

#[test]
fn world_coordinates_in_f32_hit_the_emitter_s_own_plane() {
    let model = model(
        moved(room_with_a_block(2), |p| irrational_rotation() * p),
        Subdivision::None,
    );
    assert_eq!(self_hits(&model, false), 0.0);
    let share = self_hits(&model, true);
    say(&format!(
        "f32 world coordinates: {share:.3} of the light goes to the emitter's own plane"
    ));
    assert!(share > 0.1, "{share}");
}

/// Crossing solids are cut by each other's planes, and a point that stands for a buried centroid may lie in such a
/// plane but for rounding. There a patch's pieces once showed more than the patch was counted to cover, and the run was
/// refused.
#[test]
fn points_in_the_plane_of_a_cut_patch_have_rows_that_hold() {
    let scene = moved(buried_centroids(), |p| irrational_rotation() * p);
    let model = model_as_it_is(&scene, Subdivision::None);
    let settled = Rung::settled(&model, 1e-2);
    let plan = Plan::new(&model, RowChoice::All, Selection::default(), 1, true).with_correction(settled.correction);
    for engine in [EngineChoice::Depth, EngineChoice::Order, EngineChoice::Claims] {
        let backend = Box::new(CpuBackend::new().with_engine(engine));
        let (parts, _) = parts(
            &model,
            &plan,
            settings(settled.resolution),
            backend,
            Execution::default(),
        )
        .unwrap_or_else(|error| panic!("{engine:?}: {error}"));
        assert_eq!(
            parts.iter().map(|part| part.rows.len()).sum::<usize>(),
            model.patches().len()
        );
    }
}
