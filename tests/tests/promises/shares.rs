//! Rows in which rays tell what escapes and what backs take, and rows of walls before which fine parts stand: held
//! against closed forms, reciprocity and a finer tolerance.

use glam::DVec3;
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection};
use hemicube::reference::{Reference, ReferenceSettings};
use hemicube::store::RowShares;
use hemicube::{InputPatch, Model};
use hemicube_scene::Subdivision;
use hemicube_tests::geometry::{box_inside, box_outside, even, grid, scene_of};
use hemicube_tests::promise::{Tally, WHOLE, between_groups, matrix};
use hemicube_tests::rows::{Rung, backend, factors, parts, plan, settings};
use hemicube_tests::scenes::{model, model_as_it_is, read, say, scenes_or_skip};

/// The shares of each patch at a tolerance.
fn shares(model: &Model, tolerance: f64) -> Vec<RowShares> {
    let rung = Rung::settled(model, tolerance);
    let plan = plan(model).with_correction(rung.correction);
    let (parts, _) = parts(model, &plan, settings(rung.resolution), backend(), Execution::default())
        .expect("a backend that keeps its contract");
    let mut shares = vec![RowShares::UNKNOWN; model.patches().len()];
    for part in &parts {
        for (&row, &of_row) in part.rows.iter().zip(&part.shares) {
            shares[row as usize] = of_row;
        }
    }
    shares
}

/// Plates over a floor, every other one turned: what its back takes is the form factor to it when it faces the floor,
/// which nothing occludes. The rest escapes. Rays that divide what is lost leave a third of the tolerance, root mean square,
/// and its sum, off by 0.75 T at most, half of that: √(0.33² + 0.38²) T. The worst of so many normal errors is three times as far.
#[test]
fn backs_take_what_their_fronts_would_see() {
    let size = DVec3::new(1.0, 1.0, 0.35);
    let [floor, ceiling, ..] = box_inside(size);
    let (low, high) = (grid(floor, &even(8), &even(8)), grid(ceiling, &even(7), &even(7)));
    let is_turned = |k: usize| k / 2 % 2 == 1;
    let all = low.iter().chain(&high).copied();
    let right = model_as_it_is(&scene_of(all), WHOLE);
    let turned = high
        .iter()
        .enumerate()
        .map(|(k, &[a, b, c])| if is_turned(k) { [a, c, b] } else { [a, b, c] });
    let wrong = model_as_it_is(&scene_of(low.iter().copied().chain(turned)), WHOLE);
    let exact = factors(&right, Rung::tolerance(1e-4)).expect("a backend that keeps its contract");
    for tolerance in [2e-2, 1e-2, 3e-3] {
        let mut tally = Tally::default();
        let most = 1.5 * tolerance;
        let (mut squares, found) = (0.0, shares(&wrong, tolerance));
        for (patch, found) in found.iter().enumerate().take(low.len()) {
            let emitter = InputPatch(u32::try_from(patch).expect("few patches"));
            let blocked = exact.sum_to(emitter, |to| {
                (to.0 as usize).checked_sub(low.len()).is_some_and(is_turned)
            });
            let escaped = 1.0 - exact.sum(emitter);
            tally.hold(
                || format!("blocked of {patch} at {tolerance}"),
                found.blocked,
                blocked,
                most,
            );
            tally.hold(
                || format!("escaped of {patch} at {tolerance}"),
                found.escaped,
                escaped,
                most,
            );
            squares += (found.blocked - blocked).powi(2);
        }
        let root = (squares / low.len() as f64).sqrt();
        say(&format!(
            "blocked at {tolerance}: {:.2} tolerances, root mean square",
            root / tolerance
        ));
        assert!(root < 0.5 * tolerance, "{root} at {tolerance}");
        tally.finish("what backs take");
    }
}

/// Each of the ceiling's triangles sees one side of a pipe from its centroid, and all of it from elsewhere: the row has
/// its sum, since it has too much of other walls. The pipe's rows tell what is missing.
#[test]
fn walls_see_all_sides_of_fine_pipes() {
    const SIDES: u32 = 10;
    let size = DVec3::new(0.6, 0.5, 0.4);
    let mut groups = Vec::new();
    let mut triangles = Vec::new();
    let mut add = |group: usize, of: Vec<[DVec3; 3]>| {
        groups.resize(groups.len() + of.len(), group);
        triangles.extend(of);
    };
    for (k, face) in box_inside(size).into_iter().enumerate() {
        add(k, grid(face, &even(3), &even(3)));
    }
    // A tray below, which has most of the matrix's norm with the floor.
    let tray = box_outside(DVec3::new(0.05, 0.05, 0.15), DVec3::new(0.5, 0.4, 0.002));
    for face in tray {
        add(6, grid(face, &even(3), &even(3)));
    }
    let pipes = [0.1, 0.3, 0.5];
    for (k, x) in pipes.into_iter().enumerate() {
        let [low, high] = [0.05, 0.45];
        let at = |side: u32, y: f64| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(side) / f64::from(SIDES)).sin_cos();
            DVec3::new(x + 0.008 * cos, y, 0.37 + 0.008 * sin)
        };
        for side in 0..SIDES {
            let face = [at(side, low), at(side, high), at(side + 1, high), at(side + 1, low)];
            add(7 + k, grid(face, &even(3), &even(3)));
        }
        for (y, is_front) in [(low, true), (high, false)] {
            let centre = DVec3::new(x, y, 0.37);
            let cap = |side: u32| {
                let [a, b] = [at(side, y), at(side + 1, y)];
                if is_front { [centre, a, b] } else { [centre, b, a] }
            };
            add(7 + k, (0..SIDES).map(cap).collect());
        }
    }
    let model = model_as_it_is(&scene_of(triangles), WHOLE);
    let found = between_groups(&model, &matrix(&model, Rung::settled(&model, 1e-2)), &groups);
    let patches = model.patches();
    let area = |group: usize| -> f64 {
        let own = patches.iter().filter(|&patch| groups[patches.triangle(patch)] == group);
        own.map(|patch| patches.area(patch)).sum()
    };
    let mut tally = Tally::default();
    for k in 0..pipes.len() {
        let exact = found[7 + k][1] * area(7 + k) / area(1);
        assert!(exact > 0.01, "the ceiling sees the pipe: {exact}");
        tally.hold(|| format!("ceiling to pipe {k}"), found[1][7 + k], exact, 0.05 * exact);
    }
    tally.finish("walls over fine pipes");
}

/// A floor that reaches into a solid: all of its form factors are too large by its centroid, and no entry of its row by
/// itself tells so.
#[test]
fn rows_of_patches_that_reach_into_solids_come_near_their_sum() {
    let Some(folder) = scenes_or_skip("rows_of_patches_that_reach_into_solids_come_near_their_sum") else {
        return;
    };
    let scene = read(&folder, "interior/oa_dm5.obj").expect("a scene");
    let model = model(scene, Subdivision::None);
    let sum = |rung: Rung| {
        let only = RowChoice::Range {
            start: 35_447,
            end: 35_448,
        };
        let plan = Plan::new(&model, only, Selection::default(), 1, true).with_correction(rung.correction);
        let (parts, _) = parts(
            &model,
            &plan,
            settings(rung.resolution),
            backend(),
            Execution::default(),
        )
        .expect("a backend that keeps its contract");
        parts[0].row(0).1.into_iter().sum::<f64>()
    };
    let (found, exact) = (sum(Rung::settled(&model, 1e-2)), sum(Rung::tolerance(1e-3)));
    say(&format!("the row's sum is {found} at 1 %, {exact} at 0.1 %"));
    assert!((found - exact).abs() < 2e-2, "{found}, {exact}");
}

/// A floor of 144 squares, 36 of which carry a hollow post without a bottom. A square sees little of its post's sides
/// and little of the post's inside, both far finer than what few rays resolve; rows whose errors were believed to be
/// those of rays that resolve all stated 0.04 % where they were off by 1.3 %.
#[test]
fn sums_beside_thin_posts_are_off_by_no_more_than_their_standard_errors_say() {
    const CELLS: u32 = 12;
    const WIDTH: f64 = 0.08;
    let side = f64::from(CELLS);
    let [floor, ..] = box_inside(DVec3::new(side, side, 1.0));
    let mut triangles = grid(floor, &even(CELLS), &even(CELLS));
    let cells = (0..CELLS)
        .step_by(2)
        .flat_map(|i| (0..CELLS).step_by(2).map(move |j| [i, j]));
    for (k, cell) in (1u32..).zip(cells) {
        // Places spread evenly: multiples of irrational numbers.
        let within = [0.618_033_988_7, 0.754_877_666_2].map(|step| (step * f64::from(k) + 0.6).fract());
        let at = |axis: usize| f64::from(cell[axis]) + 0.1 + (0.8 - WIDTH) * within[axis];
        let [_, top, sides @ ..] = box_outside(DVec3::new(at(0), at(1), 0.0), DVec3::new(WIDTH, WIDTH, 3.0));
        triangles.extend(grid(top, &even(1), &even(1)));
        for side in sides {
            triangles.extend(grid(side, &even(1), &even(2)));
        }
    }
    let model = model_as_it_is(&scene_of(triangles), WHOLE);
    let bearing = |patch: &u32| {
        let [a, b, c] = model.patches().corners(InputPatch(*patch));
        let centre = (a + b + c) / 3.0;
        centre.z == 0.0 && [centre.x, centre.y].iter().all(|&at| at.floor() % 2.0 == 0.0)
    };
    let rows: Vec<_> = (0..2 * CELLS * CELLS).filter(bearing).map(InputPatch).collect();
    assert_eq!(rows.len(), 72);
    let settings_of_reference = ReferenceSettings {
        target: 2e-3,
        ..ReferenceSettings::default()
    };
    let reference = Reference::new(&model, settings_of_reference).expect("settings in range");
    let exact = reference.rows(&rows, 2, &mut |_| {}).expect("rows of the scene");
    for tolerance in [2e-2, 1e-2] {
        let rung = Rung::settled(&model, tolerance);
        let plan = plan(&model).with_correction(rung.correction);
        let (parts, _) = parts(
            &model,
            &plan,
            settings(rung.resolution),
            backend(),
            Execution::default(),
        )
        .expect("a backend that keeps its contract");
        let mut tally = Tally::default();
        for part in &parts {
            for (place, row) in part.rows.iter().enumerate() {
                let Some(exact) = exact.iter().find(|exact| exact.emitter == *row) else {
                    continue;
                };
                let (errors, sum) = (part.errors[place], part.row(place).1.into_iter().sum::<f64>());
                let most = |stated: f32, noise: f64| tolerance + 3.0 * f64::from(stated) + 3.0 * noise;
                tally.hold(
                    || format!("sum of {row} at {tolerance}"),
                    sum,
                    exact.sum(),
                    most(errors.sum, exact.sum_noise()),
                );
                tally.hold(
                    || format!("escaped of {row} at {tolerance}"),
                    part.shares[place].escaped,
                    exact.escaped,
                    most(errors.escaped, exact.error_of_shares),
                );
            }
        }
        tally.finish("sums beside thin posts");
    }
}
