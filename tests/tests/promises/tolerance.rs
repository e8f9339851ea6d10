//! Ask for 0.1 %, get 0.1 %: the public cases of `reference_cases.json` at a tolerance of 0.1 % and of 0.01 %, both
//! ways, whole and cut, wherever the scene is and whatever its unit; closed rooms; crossing surfaces; plates in near
//! contact and in one plane.
//!
//! What is promised of a factor is the tolerance as a share of it, and of a factor under 0.01 a hundredth of the
//! tolerance. Curved cases are held against the values of the polyhedra that stand for them, which are exact: a convex
//! shape that only sees another has the factor 1, reciprocity and closure give the rest, and between two polygons apart
//! from each other there is the contour integral. That these values tend to those of the file is tested too.

use glam::DVec3;
use hemicube::Model;
use hemicube::accuracy::correct::{Correction, Refinement};
use hemicube::driver::calibrate::calibrate;
use hemicube::driver::compute::{ComputeError, Execution, Plan, RowChoice, Selection};
use hemicube::store::{Part, RowShares};
use hemicube_scene::generate::{Generate, Kind, generate, room};
use hemicube_scene::{InputPatch, Scene, Subdivision};
use hemicube_tests::cases::{Pair, case, cases, expected, number, pairs};
use hemicube_tests::extremes::{room_with_a_block, tower_through_the_ground, walls_through_the_ground};
use hemicube_tests::geometry::{
    between_polygons, box_inside, circle, even, grid, moved, parallel_rectangles_apart, polygon_area, quad, scene_of,
    sphere,
};
use hemicube_tests::promise::{
    AS_IT_IS, FAR_AWAY, Motion, ROTATED, SCALED, Tally, WHOLE, between_groups, both_ways, bound, hold_pairs, matrix,
};
use hemicube_tests::rows::{Factors, Rung, backend, parts, plan, settings};
use hemicube_tests::scenes::{generated, model, model_as_it_is, read, say, scenes_or_skip};

use std::sync::atomic::AtomicBool;

type Triangle = [DVec3; 3];

const THIRDS: Subdivision = Subdivision::Split(3);
const HALVES: Subdivision = Subdivision::Split(2);

#[test]
fn unoccluded_pairs() {
    let Some(cases) = cases("tolerance::unoccluded_pairs") else {
        return;
    };
    let mut pairs = pairs(&cases);
    pairs.retain(|pair| pair.obstructions.is_empty());
    assert_eq!(pairs.len(), 8);
    let ways: Vec<(Motion, Subdivision)> = [AS_IT_IS, FAR_AWAY, ROTATED, SCALED]
        .into_iter()
        .flat_map(|motion| [(motion, WHOLE), (motion, THIRDS)])
        .collect();
    hold_pairs("unoccluded pairs", &pairs, 1e-3, &ways);
    hold_pairs("unoccluded pairs", &pairs, 1e-4, &ways);
}

fn occluded(test: &str) -> Option<Vec<Pair>> {
    let mut pairs = pairs(&cases(test)?);
    pairs.retain(|pair| !pair.obstructions.is_empty());
    assert_eq!(pairs.len(), 6);
    Some(pairs)
}

#[test]
fn occluded_pairs_to_a_thousandth() {
    let Some(pairs) = occluded("tolerance::occluded_pairs_to_a_thousandth") else {
        return;
    };
    let ways = [
        (AS_IT_IS, WHOLE),
        (FAR_AWAY, WHOLE),
        (ROTATED, WHOLE),
        (SCALED, WHOLE),
        (ROTATED, HALVES),
    ];
    hold_pairs("occluded pairs", &pairs, 1e-3, &ways);
}

#[test]
fn occluded_pairs_to_a_ten_thousandth() {
    let Some(pairs) = occluded("tolerance::occluded_pairs_to_a_ten_thousandth") else {
        return;
    };
    let ways = [(AS_IT_IS, WHOLE), (FAR_AWAY, WHOLE), (ROTATED, WHOLE), (SCALED, WHOLE)];
    hold_pairs("occluded pairs", &pairs, 1e-4, &ways);
}

#[test]
fn all_pairs_to_a_millionth() {
    let Some(cases) = cases("tolerance::all_pairs_to_a_millionth") else {
        return;
    };
    let pairs = pairs(&cases);
    assert_eq!(pairs.len(), 14);
    hold_pairs("public pairs", &pairs, 1e-6, &[(AS_IT_IS, WHOLE), (ROTATED, WHOLE)]);
}

#[test]
fn the_centroid_alone_breaks_what_the_tolerance_keeps() {
    let Some(pairs) = occluded("tolerance::the_centroid_alone_breaks_what_the_tolerance_keeps") else {
        return;
    };
    let mut far_off = 0;
    for pair in pairs.iter().filter(|pair| pair.exact[0] > 0.0) {
        let found = both_ways(pair, ROTATED, WHOLE, |_| Rung::PIXEL);
        let off = found.iter().zip(pair.exact).map(|(f, exact)| (f / exact - 1.0).abs());
        let worst = off.fold(0.0, f64::max);
        say(&format!(
            "{} from one hemicube a row: {:.1} % off",
            pair.name,
            100.0 * worst
        ));
        assert!(worst > 1e-3, "{}: one hemicube has it right to {worst}", pair.name);
        far_off += u32::from(worst > 2e-2);
    }
    assert!(far_off >= 3, "one hemicube has only {far_off} pairs wrong by 2 %");
    // And the tally that says so.
    let failed = std::panic::catch_unwind(|| {
        let mut tally = Tally::default();
        tally.hold(|| "wrong by 0.2 %".to_owned(), 1.002, 1.0, 1e-3);
        tally.finish("a wrong factor");
    });
    assert!(failed.is_err());
    let failed = std::panic::catch_unwind(|| {
        let mut tally = Tally::default();
        tally.hold(|| "no number".to_owned(), f64::NAN, 1.0, 1e-3);
        tally.finish("no factor");
    });
    assert!(failed.is_err());
}

/// Triangles with their groups, ready for [`between_groups`].
fn grouped(parts: Vec<Vec<Triangle>>, motion: Motion) -> (Model, Vec<usize>) {
    let groups = parts
        .iter()
        .enumerate()
        .flat_map(|(g, part)| vec![g; part.len()])
        .collect();
    let scene = moved(scene_of(parts.into_iter().flatten()), motion.1);
    (model_as_it_is(&scene, WHOLE), groups)
}

fn area_of(triangles: &[Triangle]) -> f64 {
    triangles.iter().map(|t| polygon_area(t)).sum()
}

fn hold_enclosure(
    tally: &mut Tally,
    name: &str,
    parts: &[Vec<Triangle>],
    motion: Motion,
    tolerance: f64,
    expected: &[(usize, usize, f64)],
) {
    let (model, groups) = grouped(parts.to_vec(), motion);
    let found = between_groups(&model, &matrix(&model, Rung::settled(&model, tolerance)), &groups);
    for &(from, to, exact) in expected {
        let name = || format!("{name}, {}, at {tolerance}, {from} to {to}", motion.0);
        tally.hold(name, found[from][to], exact, bound(exact, tolerance));
    }
}

#[test]
fn enclosures_with_flat_faces() {
    let Some(cases) = cases("tolerance::enclosures_with_flat_faces") else {
        return;
    };
    let mut tally = Tally::default();
    let faces = box_inside(DVec3::ONE);
    let (opposite, adjacent) = (
        expected(&cases, "cube_faces", "opposite"),
        expected(&cases, "cube_faces", "adjacent"),
    );
    let cube: Vec<(usize, usize, f64)> = (0..36)
        .map(|k| (k / 6, k % 6))
        .map(|(i, j)| {
            let exact = if i / 2 == j / 2 { opposite } else { adjacent };
            (i, j, if i == j { 0.0 } else { exact })
        })
        .collect();
    let third = expected(&cases, "tetrahedron_regular", "F_ij (i!=j)");
    let p = [(1., 1., 1.), (1., -1., -1.), (-1., 1., -1.), (-1., -1., 1.)].map(|(x, y, z)| DVec3::new(x, y, z));
    let inward = |[a, b, c]: Triangle| {
        if (b - a).cross(c - a).dot(-a) > 0.0 {
            [a, b, c]
        } else {
            [a, c, b]
        }
    };
    let tetrahedron = [
        [p[0], p[1], p[2]],
        [p[0], p[1], p[3]],
        [p[0], p[2], p[3]],
        [p[1], p[2], p[3]],
    ]
    .map(inward);
    let thirds: Vec<(usize, usize, f64)> = (0..16)
        .map(|k| (k / 4, k % 4, if k / 4 == k % 4 { 0.0 } else { third }))
        .collect();
    let strip = expected(&cases, "infinite_strips_w1_h1", "1->2 (length 200, exact C-11)");
    let [strip_floor, strip_ceiling, ..] = box_inside(DVec3::new(1.0, 200.0, 1.0));
    let canyon = "street_canyon_10x10x50";
    let (floor_wall, wall_wall) = (
        expected(&cases, canyon, "floor->one wall"),
        expected(&cases, canyon, "wall->wall"),
    );
    let [floor, _, west, east, ..] = box_inside(DVec3::new(10.0, 50.0, 10.0));
    for tolerance in [1e-3, 1e-4] {
        for motion in [AS_IT_IS, ROTATED, FAR_AWAY] {
            for pieces in [1, 2] {
                let cuts = |quad| grid(quad, &even(pieces), &even(pieces));
                hold_enclosure(&mut tally, "cube", &faces.map(cuts), motion, tolerance, &cube);
                let cuts = |face: Triangle| {
                    let mut parts = Vec::new();
                    Subdivision::Split(pieces).cut(&face, &mut parts);
                    parts
                };
                hold_enclosure(
                    &mut tally,
                    "tetrahedron",
                    &tetrahedron.map(cuts),
                    motion,
                    tolerance,
                    &thirds,
                );
            }
            let strips = [quad(strip_floor).to_vec(), quad(strip_ceiling).to_vec()];
            let expected = [(0, 1, strip), (1, 0, strip)];
            hold_enclosure(&mut tally, "strips", &strips, motion, tolerance, &expected);
            let expected = [
                (0, 1, floor_wall),
                (1, 0, floor_wall),
                (2, 0, floor_wall),
                (1, 2, wall_wall),
                (2, 1, wall_wall),
            ];
            let parts = [floor, west, east].map(|face| quad(face).to_vec());
            hold_enclosure(&mut tally, "street canyon", &parts, motion, tolerance, &expected);
        }
    }
    tally.finish("enclosures with flat faces");
}

/// A fan round the middle of a rim; counter-clockwise for a normal of +z, or the other way round.
fn fan(rim: &[DVec3], up: bool) -> Vec<Triangle> {
    let middle = rim.iter().sum::<DVec3>() / rim.len() as f64;
    (0..rim.len())
        .map(|k| (rim[k], rim[(k + 1) % rim.len()]))
        .map(|(p, q)| if up { [middle, p, q] } else { [middle, q, p] })
        .collect()
}

/// End to end, end to side, side to end and side to side of a prism of `count` sides, from the factor of its ends.
fn prism_factors(low: &[DVec3], high: &[DVec3], side_area: f64) -> [f64; 4] {
    let end_end = between_polygons(low, high);
    let side_end = (1.0 - end_end) * polygon_area(low) / side_area;
    [end_end, 1.0 - end_end, side_end, 1.0 - 2.0 * side_end]
}

/// The limit of what errs with the square of the mesh width, from two widths of which one is half of the other.
fn limit(coarse: f64, fine: f64) -> f64 {
    fine + (fine - coarse) / 3.0
}

#[test]
fn enclosures_with_curved_faces() {
    let Some(cases) = cases("tolerance::enclosures_with_curved_faces") else {
        return;
    };
    let prism = |count: u32| {
        let (low, high) = (circle(count, 1.0, 0.0), circle(count, 1.0, 2.0));
        let side: Vec<Triangle> = (0..low.len())
            .map(|i| (i, (i + 1) % low.len()))
            .flat_map(|(i, j)| quad([low[i], high[i], high[j], low[j]]))
            .collect();
        let exact = prism_factors(&low, &high, area_of(&side));
        (vec![fan(&low, true), fan(&high, false), side], exact)
    };
    let (coarse, fine) = (prism(128).1, prism(256).1);
    for (k, key) in ["end->end", "end->side", "side->end", "side->side"]
        .into_iter()
        .enumerate()
    {
        let exact = expected(&cases, "closed_cylinder_r1_h2", key);
        let found = limit(coarse[k], fine[k]);
        assert!(
            (found - exact).abs() < 1e-7,
            "{key}: prisms tend to {found}, not {exact}"
        );
    }

    let hemisphere = |pieces: u32| {
        let dome = sphere(pieces, 1.0, true, false);
        let mut rim: Vec<DVec3> = dome.iter().flatten().copied().filter(|p| p.z == 0.0).collect();
        rim.sort_by(|p, q| p.y.atan2(p.x).total_cmp(&q.y.atan2(q.x)));
        rim.dedup();
        let base = fan(&rim, true);
        let share = area_of(&base) / area_of(&dome);
        (vec![base, dome], share)
    };
    let found = limit(hemisphere(16).1, hemisphere(32).1);
    let exact = expected(&cases, "hemisphere_r1", "dome->base");
    assert!((found - exact).abs() < 1e-4, "domes tend to {found}, not {exact}");

    let spheres = |pieces: u32| {
        let (outer, inner) = (sphere(pieces, 3.0, true, true), sphere(pieces, 1.0, false, true));
        let share = area_of(&inner) / area_of(&outer);
        (vec![outer, inner], share)
    };
    let exact = expected(&cases, "concentric_spheres_b", "outer->inner");
    assert!((spheres(2).1 - exact).abs() < 1e-12, "the polyhedra are alike");

    let mut tally = Tally::default();
    for tolerance in [1e-3, 1e-4] {
        for motion in [AS_IT_IS, ROTATED] {
            let (parts, [end_end, end_side, side_end, side_side]) = prism(12);
            let exact = [
                (0, 1, end_end),
                (1, 0, end_end),
                (0, 2, end_side),
                (2, 0, side_end),
                (2, 2, side_side),
            ];
            hold_enclosure(&mut tally, "prism", &parts, motion, tolerance, &exact);
            let (parts, share) = hemisphere(3);
            let exact = [(0, 1, 1.0), (1, 0, share), (1, 1, 1.0 - share)];
            hold_enclosure(&mut tally, "dome", &parts, motion, tolerance, &exact);
            let (parts, share) = spheres(1);
            let exact = [(1, 0, 1.0), (0, 1, share), (0, 0, 1.0 - share), (1, 1, 0.0)];
            hold_enclosure(
                &mut tally,
                "polyhedron in a polyhedron",
                &parts,
                motion,
                tolerance,
                &exact,
            );
        }
    }
    tally.finish("enclosures with curved faces");
}

#[test]
fn the_inside_of_a_sphere() {
    let Some(cases) = cases("tolerance::the_inside_of_a_sphere") else {
        return;
    };
    // The exchange of two facets, over that of the sphere's.
    let share = expected(&cases, "sphere_interior", "F_ij*4*pi*R^2/A_j");
    let facets = sphere(3, 1.0, true, true);
    let model = model_as_it_is(&moved(scene_of(facets.iter().copied()), ROTATED.1), WHOLE);
    for tolerance in [1e-3, 1e-4] {
        let found = matrix(&model, Rung::settled(&model, tolerance));
        let (mut off, mut norm, mut rough, mut sums) = (0.0, 0.0, 0.0f64, 0.0f64);
        for i in model.patches().iter() {
            sums = sums.max((found.sum(i) - 1.0).abs());
            for j in model.patches().iter() {
                let (own, other) = (&facets[i.0 as usize], &facets[j.0 as usize]);
                if own.iter().any(|p| other.iter().any(|q| p.distance(*q) < 1e-9)) {
                    continue;
                }
                let exact = between_polygons(own, other);
                off += (found.get(i, j) - exact).powi(2);
                norm += exact * exact;
                let in_the_sphere = share * polygon_area(other) / (4.0 * std::f64::consts::PI);
                rough = rough.max((exact / in_the_sphere - 1.0).abs());
            }
        }
        let error = (off / norm).sqrt();
        say(&format!(
            "sphere at {tolerance}: error {error:.1e}, row sums {sums:.1e} off, facets {rough:.2} off the sphere"
        ));
        assert!(error <= tolerance, "{error}");
        assert!(sums <= tolerance, "{sums}");
        // Facets of 30° are not a sphere, but not far from one either.
        assert!(rough < 0.4, "{rough}");
    }
}

#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn discs() {
    let Some(cases) = cases("tolerance::discs") else {
        return;
    };
    let mut tally = Tally::default();
    for id in ["disks_equal", "disks_1_0.5_h3"] {
        let case = case(&cases, id);
        let (one, two) = (number(&case["emitter"]["radius"]), number(&case["receiver"]["radius"]));
        let height = number(&case["receiver"]["center"][2]);
        let round = ["F_emitter_to_receiver", "F_receiver_to_emitter"].map(|key| number(&case[key]));
        for (corners, motion, tolerances) in [(512, AS_IT_IS, &[1e-3, 1e-4][..]), (48, ROTATED, &[1e-3, 1e-4][..])] {
            let (low, high) = (circle(corners, one, 0.0), circle(corners, two, height));
            let parts = [fan(&low, true), fan(&high, false)];
            let own = between_polygons(&low, &high);
            let exact = if corners == 512 {
                round
            } else {
                [own, own * polygon_area(&low) / polygon_area(&high)]
            };
            for &tolerance in tolerances {
                let expected = [(0, 1, exact[0]), (1, 0, exact[1])];
                hold_enclosure(
                    &mut tally,
                    &format!("{id} of {corners}"),
                    &parts,
                    motion,
                    tolerance,
                    &expected,
                );
            }
        }
    }
    tally.finish("discs");
}

/// √(Σ (Aᵢ Fᵢⱼ − Aⱼ Fⱼᵢ)²) / √(Σ (Aᵢ Fᵢⱼ)²).
fn reciprocity(model: &Model, factors: &Factors) -> f64 {
    let patches = model.patches();
    let (mut off, mut norm) = (0.0, 0.0);
    for i in patches.iter() {
        for &(j, factor) in &factors.rows[i.0 as usize] {
            let j = InputPatch(j);
            let (there, back) = (patches.area(i) * factor, patches.area(j) * factors.get(j, i));
            // A pair that only one of the two has is met once, and would be met twice if both had it.
            off += (there - back).powi(2) * if back == 0.0 { 2.0 } else { 1.0 };
            norm += there * there;
        }
    }
    (off / norm).sqrt()
}

/// Rows whose hemicube and whose area see alike: those of patches of the measured room that no block's edge crosses.
fn not_crossed(model: &Model, scene: &Scene) -> Vec<InputPatch> {
    let object = |name: &str| {
        scene
            .objects
            .iter()
            .position(|o| o == name)
            .expect("the room has this object")
    };
    let floor = object("floor");
    let blocks = ["short_block", "tall_block"].map(object);
    let feet: Vec<[DVec3; 2]> = scene
        .triangles
        .iter()
        .filter(|t| blocks.contains(&(t.object as usize)))
        .flat_map(|t| [0, 1, 2].map(|k| [t.corners[k], t.corners[(k + 1) % 3]]))
        .filter(|edge| edge.iter().all(|p| p.y == 0.0))
        .collect();
    assert!(feet.len() >= 8, "two blocks of four sides");
    let crosses = |t: Triangle, [p, q]: [DVec3; 2]| {
        // A point of the edge, from end to end, inside the triangle.
        (0..=200).any(|k| {
            let x = p + (q - p) * (f64::from(k) / 200.0);
            let side = |a: DVec3, b: DVec3| (b.x - a.x) * (x.z - a.z) - (b.z - a.z) * (x.x - a.x);
            let sides = [side(t[0], t[1]), side(t[1], t[2]), side(t[2], t[0])];
            sides.iter().all(|&s| s >= 0.0) || sides.iter().all(|&s| s <= 0.0)
        })
    };
    let patches = model.patches();
    patches
        .iter()
        .filter(|&p| {
            let triangle = patches.triangle(p);
            scene.triangles[triangle].object as usize != floor
                || !feet
                    .iter()
                    .any(|&foot| crosses(scene.triangles[triangle].corners, foot))
        })
        .collect()
}

fn hold_room(
    tally: &mut Tally,
    name: &str,
    scene: &Scene,
    motion: Motion,
    tolerance: f64,
    rows: impl Fn(&Model) -> Vec<InputPatch>,
) {
    let model = model(moved(scene.clone(), motion.1), WHOLE);
    assert_eq!(
        model.patches().len(),
        scene.triangles.len(),
        "{name}: repair changed it"
    );
    let patches = model.patches();
    let found = matrix(&model, Rung::settled(&model, tolerance));
    let rows = rows(&model);
    let mut closure = (0.0f64, InputPatch(0));
    for &i in &rows {
        let off = (found.sum(i) + found.blocked[i.0 as usize] - 1.0).abs();
        if off > closure.0 || off.is_nan() {
            closure = (off, i);
        }
    }
    let mut excess = 0.0f64;
    for i in patches.iter() {
        assert_eq!(found.escaped[i.0 as usize], 0.0, "{name}: {i:?} leaks");
        for &(j, factor) in &found.rows[i.0 as usize] {
            assert_ne!(j, i.0, "{name}: {i:?} sees itself");
            excess = excess.max(factor / (patches.area(InputPatch(j)) / patches.area(i)).min(1.0));
        }
    }
    let residual = reciprocity(&model, &found);
    let at = format!("{name}, {}, at {tolerance}", motion.0);
    say(&format!(
        "{at}: {} of {} rows off by {:.1e} ({:?}) at most, reciprocity {residual:.1e}, F at most {excess:.4} of what it can be",
        rows.len(),
        patches.len(),
        closure.0,
        closure.1
    ));
    tally.hold(|| format!("{at}: row {:?}", closure.1), 1.0 + closure.0, 1.0, tolerance);
    // Each of the two readings of a pair may be off by the tolerance, as `check` has it.
    tally.hold(|| format!("{at}: reciprocity"), residual, 0.0, 2.0 * tolerance);
    tally.hold(
        || format!("{at}: F over what it can be"),
        excess.max(1.0),
        1.0,
        tolerance,
    );
}

#[test]
fn closed_rooms() {
    let spheres = generate(Generate {
        kind: Kind::Spheres,
        target_patches: 200,
        seed: 3,
    })
    .expect("a target in range");
    let measured = room(2).expect("160 patches");
    let mut tally = Tally::default();
    let all = |model: &Model| model.patches().iter().collect::<Vec<_>>();
    for motion in [ROTATED, FAR_AWAY] {
        let block = room_with_a_block(2);
        hold_room(&mut tally, "room with a block", &block, motion, 1e-2, all);
        hold_room(&mut tally, "room with spheres", &spheres, motion, 1e-2, all);
        hold_room(&mut tally, "measured room", &measured, motion, 1e-2, |model| {
            not_crossed(model, &measured)
        });
    }
    let block = room_with_a_block(1);
    hold_room(&mut tally, "room with a block", &block, ROTATED, 1e-3, all);
    tally.finish("closed rooms");
}

/// Row sums of the triangles' groups, area-weighted.
fn sums_of_groups(triangles: &[(usize, Triangle)], tolerance: Option<f64>) -> Vec<f64> {
    let scene = moved(scene_of(triangles.iter().map(|t| t.1)), ROTATED.1);
    let model = model_as_it_is(&scene, WHOLE);
    let rung = tolerance.map_or(Rung::PIXEL, |tolerance| Rung::settled(&model, tolerance));
    let groups: Vec<usize> = triangles.iter().map(|t| t.0).collect();
    let found = between_groups(&model, &matrix(&model, rung), &groups);
    found.iter().map(|row| row.iter().sum()).collect()
}

#[test]
fn crossing_surfaces_and_their_split_twins() {
    let mut tally = Tally::default();
    for (name, scene) in [
        ("walls", walls_through_the_ground as fn(bool) -> Vec<(usize, Triangle)>),
        ("tower", tower_through_the_ground),
    ] {
        let (whole, twin) = (scene(false), scene(true));
        let (found, exact) = (sums_of_groups(&whole, Some(1e-3)), sums_of_groups(&twin, Some(1e-3)));
        for (k, (&found, &exact)) in found.iter().zip(&exact).enumerate() {
            tally.hold(|| format!("{name}, face {k}"), found, exact, 1e-3);
        }
        let rough = sums_of_groups(&whole, None);
        let worst = rough.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(
            worst > 2e-3,
            "{name}: one hemicube a row is right to {worst}, so that the twins tell nothing"
        );
    }
    tally.finish("crossing surfaces");
}

/// A row: how many hemicubes and rays it took, and its columns and factors.
type Counted = (u32, u32, Vec<(i32, f64)>);

/// 96 rows of a scene.
fn some_rows(model: &Model, refinement: Refinement, resolution: u32) -> Vec<Counted> {
    let sample = RowChoice::Sample { count: 96, seed: 3 };
    let plan = Plan::new(model, sample, Selection::default(), 1, true);
    let plan = plan.with_correction(Correction::Tolerance(refinement));
    let (parts, _) = parts(model, &plan, settings(resolution), backend(), Execution::default()).expect("rows");
    let of_part = |part: &Part| {
        let row = |place: usize| {
            let (columns, values) = part.row(place);
            let entries = columns.iter().copied().zip(values).collect();
            (part.hemicubes[place], part.rays[place], entries)
        };
        (0..part.rows.len()).map(row).collect::<Vec<_>>()
    };
    parts.iter().flat_map(of_part).collect()
}

#[test]
fn odd_rows_take_care_where_sums_are_known_and_no_more_where_they_are_not() {
    let test = "tolerance::odd_rows_take_care_where_sums_are_known_and_no_more_where_they_are_not";
    let Some(folder) = scenes_or_skip(test) else { return };
    let tile = read(&folder, "city/denhaag-8897.obj").expect("a scene");
    let tile = model(tile, WHOLE);
    let settled = |model: &Model| match Rung::settled(model, 1e-2) {
        Rung {
            correction: Correction::Tolerance(refinement),
            resolution,
        } => (refinement, resolution),
        other => panic!("{other:?}"),
    };
    let room = generated(Kind::Room, 1500);
    assert!(!settled(&room).0.is_open, "nothing escapes from a room");
    let (refinement, resolution) = settled(&tile);
    assert!(refinement.is_open, "over a city there is the sky");
    let open = some_rows(&tile, refinement, resolution);
    let closed = some_rows(
        &tile,
        Refinement {
            is_open: false,
            ..refinement
        },
        resolution,
    );
    let with = |rows: &[Counted], count: u32| rows.iter().filter(|row| row.0 == count).count();
    let rays = |rows: &[Counted]| rows.iter().map(|row| u64::from(row.1)).sum::<u64>();
    let squares = |row: &[(i32, f64)]| row.iter().map(|e| e.1.powi(2)).sum::<f64>();
    let (mut apart, mut all) = (0.0, 0.0);
    for (a, b) in open.iter().zip(&closed) {
        let find = |row: &[(i32, f64)], column: i32| row.iter().find(|e| e.0 == column).map_or(0.0, |e| e.1);
        apart += a.2.iter().map(|e| (e.1 - find(&b.2, e.0)).powi(2)).sum::<f64>();
        apart +=
            b.2.iter()
                .filter(|e| find(&a.2, e.0) == 0.0)
                .map(|e| e.1.powi(2))
                .sum::<f64>();
        all += squares(&b.2);
    }
    let apart = (apart / all).sqrt();
    say(&format!(
        "tile at 1 %, 96 rows: {} and {} of four hemicubes, {} and {} of sixteen; {} and {} rays; {apart:.1e} apart",
        with(&open, 4),
        with(&closed, 4),
        with(&open, 16),
        with(&closed, 16),
        rays(&open),
        rays(&closed)
    ));
    assert_eq!(with(&open, 1) + with(&open, 4), open.len(), "one hemicube or four");
    assert!(with(&open, 4) > 0, "some rows are odd");
    assert!(with(&closed, 16) > 0, "and would get more, were the sums of rows known");
    assert!(rays(&open) < rays(&closed));
    assert!(
        apart < 1e-2,
        "what that would change is less than was asked for: {apart}"
    );
}

#[test]
fn plates_in_near_contact() {
    let mut tally = Tally::default();
    let (x, y) = (0.3, 1.0 - std::f64::consts::FRAC_1_SQRT_2);
    for gap in [1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9] {
        let [floor, ceiling, ..] = box_inside(DVec3::new(1.0, 1.0, gap));
        let parts = [floor, ceiling.map(|p| p + DVec3::new(x, y, 0.0))].map(|face| quad(face).to_vec());
        let exact = parallel_rectangles_apart([[0.0, 1.0]; 2], [[x, x + 1.0], [y, y + 1.0]], gap);
        assert!((exact - (1.0 - x) * (1.0 - y)).abs() < 2.0 * gap, "{exact}");
        for tolerance in [1e-2, 1e-3] {
            for motion in [AS_IT_IS, ROTATED] {
                let expected = [(0, 1, exact), (1, 0, exact)];
                hold_enclosure(&mut tally, &format!("gap {gap}"), &parts, motion, tolerance, &expected);
            }
        }
    }
    tally.finish("plates in near contact");
}

/// What leaves a narrow gap leaves from within its width of the rim: of most patches nothing, of some little, which few
/// rays find. Form factors in closed form tell it.
#[test]
fn rims_of_narrow_gaps() {
    const CUTS: u32 = 6;
    let cut = |[a, b, c]: Triangle| {
        let at = |i: u32, j: u32| a + ((b - a) * f64::from(i) + (c - a) * f64::from(j)) / f64::from(CUTS);
        let mut pieces = Vec::new();
        for (i, j) in (0..CUTS).flat_map(|i| (0..CUTS - i).map(move |j| (i, j))) {
            pieces.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
            if i + j + 1 < CUTS {
                pieces.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        pieces
    };
    let mut tally = Tally::default();
    for (gap, tolerance) in [(1e-2, 1e-2), (1e-3, 1e-3), (1e-3, 1e-4)] {
        let corner = |x, y, z| DVec3::new(x, y, z);
        let low = cut([corner(0.0, 0.0, 0.0), corner(1.0, 0.0, 0.0), corner(0.2, 0.9, 0.0)]);
        let high = cut([corner(0.03, 0.0, gap), corner(0.2, 0.9, gap), corner(1.0, 0.02, gap)]);
        let model = grouped(vec![low, high], AS_IT_IS).0;
        for (patch, factors, shares) in sums(&model, tolerance) {
            let name = || format!("patch {patch}, gap {gap}, at {tolerance}");
            tally.hold(name, factors + shares.lost(), 1.0, tolerance);
        }
    }
    tally.finish("rims of narrow gaps");
}

/// What escapes is what form factors in closed form leave, not what rays met.
#[test]
fn what_escapes_between_plates() {
    let mut tally = Tally::default();
    let [floor, ceiling, ..] = box_inside(DVec3::ONE);
    for cuts in [1, 4] {
        let plates = [floor, ceiling].map(|face| grid(face, &even(cuts), &even(cuts)));
        let model = grouped(plates.to_vec(), AS_IT_IS).0;
        for tolerance in [1e-2, 1e-3, 1e-4] {
            let rows = sums(&model, tolerance);
            for &(patch, factors, shares) in &rows {
                let name = || format!("patch {patch} of {} at {tolerance}", rows.len());
                tally.hold(name, factors + shares.escaped, 1.0, 1e-2 * tolerance);
            }
        }
    }
    tally.finish("what escapes between plates");
}

/// Each row's patch, the sum of its form factors, and its shares.
fn sums(model: &Model, tolerance: f64) -> Vec<(u32, f64, RowShares)> {
    let rung = Rung::settled(model, tolerance);
    let plan = plan(model).with_correction(rung.correction);
    let (parts, _) = parts(model, &plan, settings(rung.resolution), backend(), Execution::default())
        .expect("a backend that keeps its contract");
    let rows = |part: &Part| {
        let row = |k: usize| (part.rows[k], part.row(k).1.into_iter().sum::<f64>(), part.shares[k]);
        (0..part.rows.len()).map(row).collect::<Vec<_>>()
    };
    parts.iter().flat_map(rows).collect()
}

#[test]
fn of_patches_in_one_plane_the_smaller_id_is_seen() {
    let mut tally = Tally::default();
    let [floor, ceiling, ..] = box_inside(DVec3::ONE);
    let part = |low: f64, high: f64| ceiling.map(|p| DVec3::new(low + (high - low) * p.x, p.y, p.z));
    let exact = |low: f64, high: f64| parallel_rectangles_apart([[0.0, 1.0]; 2], [[low, high], [0.0, 1.0]], 1.0);
    let tolerance = 1e-3;
    for motion in [AS_IT_IS, ROTATED] {
        for turn in 0..3 {
            let turned = |mut t: Triangle| {
                t.rotate_left(turn);
                t
            };
            // A duplicate from another corner.
            let twin: Vec<Triangle> = quad(ceiling).into_iter().map(turned).collect();
            let parts = [quad(floor).to_vec(), quad(ceiling).to_vec(), twin];
            let expected = [
                (0, 1, exact(0.0, 1.0)),
                (0, 2, 0.0),
                (1, 0, exact(0.0, 1.0)),
                (1, 2, 0.0),
                (2, 1, 0.0),
            ];
            hold_enclosure(
                &mut tally,
                &format!("duplicate {turn}"),
                &parts,
                motion,
                tolerance,
                &expected,
            );
            // Two plates that share a part of their plane: the second shows what the first leaves.
            let (left, right) = (quad(part(0.0, 0.6)), quad(part(0.4, 1.0)).map(turned));
            for (first, second, seen) in [(left, right, [0.6, 1.0]), (right, left, [0.0, 0.4])] {
                let parts = [quad(floor).to_vec(), first.to_vec(), second.to_vec()];
                let whole = exact(0.0, 0.6);
                let expected = [(0, 1, whole), (0, 2, exact(seen[0], seen[1])), (1, 0, whole / 0.6)];
                hold_enclosure(
                    &mut tally,
                    &format!("overlap {turn}"),
                    &parts,
                    motion,
                    tolerance,
                    &expected,
                );
            }
        }
    }
    tally.finish("patches in one plane");
}

#[test]
fn settling_ends_when_it_is_told_to() {
    let scene = generate(Generate {
        kind: Kind::City,
        target_patches: 2000,
        seed: 1,
    });
    let model = model_as_it_is(&scene.expect("a city"), Subdivision::None);
    let emitters: Vec<InputPatch> = model.order().collect();
    let settled = |cancel: &AtomicBool| {
        let execution = Execution {
            threads: 1,
            cancel: Some(cancel),
            ..Execution::default()
        };
        calibrate(&model, &emitters, &|_| true, true, 0.05, backend().as_mut(), execution)
    };
    assert!(matches!(settled(&AtomicBool::new(true)), Err(ComputeError::Cancelled)));
    assert!(settled(&AtomicBool::new(false)).is_ok_and(|settled| settled.rows > 0));
}
