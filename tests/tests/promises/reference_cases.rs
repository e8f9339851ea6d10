//! Form factors against closed forms: the public cases of `reference_cases.json`, and two that need no file.
//!
//! A plain hemicube at each centroid errs twice. *Aliasing* falls with the resolution N: it is measured against the
//! mean of the closed point-to-polygon factor over the same centroids. *Point instead of area* does not; it falls as
//! the emitter is cut finer: it is measured against the factor between the areas, at a resolution where aliasing is
//! small. Of either the slope is tested, and a bound at the finest setting.

use glam::DVec3;
use hemicube::Model;
use hemicube::backend::WHOLE;
use hemicube_scene::{InputPatch, Subdivision};
use hemicube_tests::cases::{self, cases, number};
use hemicube_tests::geometry::{
    box_inside, circle, even, grid, parallel_rectangles, perpendicular_rectangles, point_to_polygon, quad, scene_of,
    scene_with_sides, slope, sphere,
};
use hemicube_tests::rows::{hemicubes, render, settings};
use hemicube_tests::scenes::{model, model_as_it_is, say};
use serde_json::Value;

type Quad = [DVec3; 4];
type Triangle = [DVec3; 3];

/// From an emitter to a receiver, with plates between them that are opaque from either side.
#[derive(Clone, Debug)]
struct Pair {
    name: String,
    emitter: Vec<Quad>,
    receiver: Vec<Quad>,
    obstructions: Vec<Quad>,
    exact: f64,
}

impl Pair {
    /// The factor by hemicubes of `resolution`, the edges of all triangles cut into `pieces`; and the mean over the
    /// same points of the closed point-to-area factor, without the plates.
    fn estimate(&self, pieces: u32, resolution: u32) -> (f64, f64) {
        let triangles = |quads: &[Quad]| quads.iter().copied().flat_map(quad).collect::<Vec<Triangle>>();
        let (emitter, receiver) = (triangles(&self.emitter), triangles(&self.receiver));
        let (emitters, receivers) = (0..emitter.len(), emitter.len()..emitter.len() + receiver.len());
        let sided = emitter.into_iter().chain(receiver).map(|t| (t, false));
        let scene = scene_with_sides(sided.chain(triangles(&self.obstructions).into_iter().map(|t| (t, true))));
        let model = model_as_it_is(&scene, Subdivision::Split(pieces));
        let patches = model.patches();
        let rows_of: Vec<InputPatch> = patches
            .iter()
            .filter(|&p| emitters.contains(&patches.triangle(p)))
            .collect();
        let (rows, _) = render(&model, &hemicubes(&model, &rows_of), settings(resolution));
        let (mut weight, mut points, mut area) = (0.0, 0.0, 0.0);
        for (k, &patch) in rows_of.iter().enumerate() {
            let row = rows.row(k);
            let seen = row.patches.iter().zip(row.visible);
            let seen = seen.filter(|&(&p, _)| receivers.contains(&patches.triangle(InputPatch(p))));
            let received: u64 = seen.map(|(_, &v)| u64::from(v)).sum();
            weight += patches.area(patch) * received as f64 / f64::from(WHOLE);
            let (origin, normal) = (patches.centroid(patch), patches.normal(patch));
            points += patches.area(patch)
                * self
                    .receiver
                    .iter()
                    .map(|quad| point_to_polygon(origin, normal, quad))
                    .sum::<f64>();
            area += patches.area(patch);
        }
        (weight / area, points / area)
    }

    /// The same pair the other way round; A_i F_ij = A_j F_ji.
    fn reversed(&self) -> Self {
        let area = |quads: &[Quad]| {
            let twice = |[a, b, c]: Triangle| (b - a).cross(c - a).length();
            quads.iter().copied().flat_map(quad).map(twice).sum::<f64>()
        };
        Self {
            name: format!("{}, reversed", self.name),
            emitter: self.receiver.clone(),
            receiver: self.emitter.clone(),
            obstructions: self.obstructions.clone(),
            exact: self.exact * area(&self.emitter) / area(&self.receiver),
        }
    }
}

/// Root of the mean squared relative error of some cases.
fn relative_rms(errors: impl ExactSizeIterator<Item = (f64, f64)>) -> f64 {
    let count = errors.len() as f64;
    (errors
        .map(|(found, exact)| ((found - exact) / exact).powi(2))
        .sum::<f64>()
        / count)
        .sqrt()
}

/// Says a series of errors, and that it falls at least as fast as a power, to at most a bound.
fn falls(name: &str, series: &[(f64, f64)], power: f64, last: f64) {
    let found = slope(series);
    let list: Vec<String> = series.iter().map(|(x, e)| format!("{x}: {e:.1e}")).collect();
    say(&format!("{name}: {} (slope {found:.2})", list.join(", ")));
    assert!(found <= power, "{name}: {series:?} falls with the power {found}");
    assert!(
        series.last().is_some_and(|&(_, error)| error <= last),
        "{name}: {series:?} ends above {last}"
    );
}

fn aliasing_falls(name: &str, pairs: &[Pair]) {
    let series: Vec<(f64, f64)> = [32, 64, 128, 256, 512]
        .into_iter()
        .map(|n| (f64::from(n), relative_rms(pairs.iter().map(|pair| pair.estimate(3, n)))))
        .collect();
    falls(&format!("{name}, relative rms error by N"), &series, -0.9, 5e-4);
}

fn area_error_falls(name: &str, pairs: &[Pair], power: f64, last: f64) {
    let series: Vec<(f64, f64)> = [1, 2, 4, 8, 16]
        .into_iter()
        .map(|pieces| {
            let errors = pairs.iter().map(|pair| (pair.estimate(pieces, 256).0, pair.exact));
            (f64::from(pieces), relative_rms(errors))
        })
        .collect();
    falls(
        &format!("{name}, relative rms error by pieces of an edge"),
        &series,
        power,
        last,
    );
}

/// Unit squares opposite each other and at right angles, with factors computed here.
fn unit_squares() -> [Pair; 2] {
    let [floor, ceiling, wall, ..] = box_inside(DVec3::ONE);
    let pair = |name: &str, receiver: Quad, exact: f64| Pair {
        name: name.to_owned(),
        emitter: vec![floor],
        receiver: vec![receiver],
        obstructions: Vec::new(),
        exact,
    };
    [
        pair("parallel unit squares", ceiling, parallel_rectangles(1.0, 1.0, 1.0)),
        pair(
            "perpendicular unit squares",
            wall,
            perpendicular_rectangles(1.0, 1.0, 1.0),
        ),
    ]
}

#[test]
fn unit_squares_without_any_file() {
    let [parallel, perpendicular] = unit_squares();
    aliasing_falls("unit squares", &[parallel.clone(), perpendicular.clone()]);
    area_error_falls("parallel unit squares", &[parallel], -1.8, 8e-4);
    area_error_falls("perpendicular unit squares", &[perpendicular], -1.6, 4e-4);
}

/// Pairs of quads from the file, those with obstructions or those without.
fn pairs(cases: &[Value], occluded: bool) -> Vec<Pair> {
    cases::pairs(cases)
        .into_iter()
        .filter_map(|case| {
            let [exact, reversed] = case.exact;
            let pair = Pair {
                name: case.name,
                emitter: case.emitter,
                receiver: case.receiver,
                obstructions: case.obstructions,
                exact,
            };
            assert!(
                (pair.reversed().exact - reversed).abs() < 1e-12,
                "{}: not reciprocal",
                pair.name
            );
            (pair.obstructions.is_empty() != occluded).then_some(pair)
        })
        .collect()
}

#[test]
fn unoccluded_pairs() {
    let Some(cases) = cases("reference_cases::unoccluded_pairs") else {
        return;
    };
    let pairs = pairs(&cases, false);
    assert_eq!(pairs.len(), 8);
    let both: Vec<Pair> = pairs.iter().flat_map(|pair| [pair.clone(), pair.reversed()]).collect();
    aliasing_falls("pairs", &both);
    let touching = |pair: &Pair| {
        pair.emitter
            .iter()
            .flatten()
            .any(|p| pair.receiver.iter().flatten().any(|q| p == q))
    };
    let (touching, apart): (Vec<Pair>, Vec<Pair>) = both.into_iter().partition(touching);
    assert_eq!((touching.len(), apart.len()), (6, 10));
    area_error_falls("pairs apart", &apart, -1.8, 8e-4);
    area_error_falls("touching pairs", &touching, -1.5, 3e-3);
}

#[test]
fn occluded_pairs() {
    let Some(cases) = cases("reference_cases::occluded_pairs") else {
        return;
    };
    let (hidden, pairs): (Vec<Pair>, Vec<Pair>) = pairs(&cases, true).into_iter().partition(|pair| pair.exact == 0.0);
    assert_eq!((hidden.len(), pairs.len()), (1, 5));
    let both: Vec<Pair> = pairs.iter().flat_map(|pair| [pair.clone(), pair.reversed()]).collect();
    area_error_falls("occluded pairs", &both, -1.4, 6e-3);
    for pair in [hidden[0].clone(), hidden[0].reversed()] {
        for pieces in [1, 5, 16] {
            assert_eq!(
                pair.estimate(pieces, 128).0,
                0.0,
                "{}: light through an opaque plate",
                pair.name
            );
        }
    }
    // Without its plate every case must be off by more than the bound: the bound can tell.
    for pair in &both {
        let open = Pair {
            obstructions: Vec::new(),
            ..pair.clone()
        };
        let (found, _) = open.estimate(8, 128);
        assert!(
            (found / pair.exact - 1.0).abs() > 0.04,
            "{}: the plate makes no difference",
            pair.name
        );
    }
}

/// Factors between groups of triangles, area-weighted: `[from][to]`, then escaped and blocked of each.
#[derive(Debug)]
struct Groups {
    factors: Vec<Vec<f64>>,
    escaped: Vec<f64>,
    blocked: Vec<f64>,
}

fn groups(model: &Model, group_of_triangle: &[usize], resolution: u32) -> Groups {
    let count = group_of_triangle.iter().max().map_or(0, |g| g + 1);
    let mut groups = Groups {
        factors: vec![vec![0.0; count]; count],
        escaped: vec![0.0; count],
        blocked: vec![0.0; count],
    };
    let patches: Vec<InputPatch> = model.patches().iter().collect();
    let (rows, _) = render(model, &hemicubes(model, &patches), settings(resolution));
    let group = |patch: InputPatch| group_of_triangle[model.patches().triangle(patch)];
    let mut areas = vec![0.0; count];
    for &patch in &patches {
        areas[group(patch)] += model.patches().area(patch);
    }
    for (k, &patch) in patches.iter().enumerate() {
        let (row, from) = (rows.row(k), group(patch));
        let share = model.patches().area(patch) / areas[from] / f64::from(WHOLE);
        for (&seen, &weight) in row.patches.iter().zip(row.visible) {
            groups.factors[from][group(InputPatch(seen))] += share * f64::from(weight);
        }
        groups.escaped[from] += share * f64::from(row.escaped);
        groups.blocked[from] += share * f64::from(row.blocked);
    }
    groups
}

/// Triangles with their groups, ready for [`groups`].
fn grouped(parts: Vec<Vec<Triangle>>) -> (Model, Vec<usize>) {
    let groups = parts
        .iter()
        .enumerate()
        .flat_map(|(g, part)| std::iter::repeat_n(g, part.len()))
        .collect();
    let scene = scene_of(parts.into_iter().flatten());
    (model_as_it_is(&scene, Subdivision::None), groups)
}

fn expect(cases: &[Value], id: &str, key: &str) -> f64 {
    let case = cases
        .iter()
        .find(|case| case["id"] == id)
        .unwrap_or_else(|| panic!("no case `{id}`"));
    number(&case["expected"][key])
}

/// Error of an enclosure for some finenesses: the largest difference of the factors that `pick` names from the
/// expected.
fn enclosure(
    name: &str,
    finenesses: [u32; 3],
    build: impl Fn(u32) -> Vec<Vec<Triangle>>,
    expected: &[(usize, usize, f64)],
    last: f64,
) -> Groups {
    let mut series = Vec::new();
    let mut finest = None;
    for fineness in finenesses {
        let (model, group_of) = grouped(build(fineness));
        let found = groups(&model, &group_of, 256);
        let error = expected
            .iter()
            .map(|&(from, to, exact)| (found.factors[from][to] - exact).abs())
            .fold(0.0, f64::max);
        series.push((f64::from(fineness), error));
        finest = Some(found);
    }
    // Of the tetrahedron the coarsest is within 10⁻⁴ already, not far above what pixels can tell.
    let power = if name == "tetrahedron" { -0.8 } else { -1.1 };
    falls(&format!("{name}, worst error by fineness"), &series, power, last);
    finest.expect("three finenesses")
}

fn closed(name: &str, found: &Groups) {
    let none = |values: &[f64]| values.iter().all(|&v| v == 0.0);
    assert!(none(&found.escaped), "{name} leaks: {:?}", found.escaped);
    assert!(none(&found.blocked), "{name} shows a back: {:?}", found.blocked);
}

/// A disc round the z axis whose rim is `rim`, in `rings` rings; counter-clockwise for a normal of +z.
fn disc(rim: &[DVec3], rings: u32) -> Vec<Triangle> {
    let z = DVec3::Z * rim[0].z;
    let at = |k: usize, ring: u32| {
        let p = rim[k % rim.len()];
        if ring == rings {
            p
        } else {
            z + (p - z) * (f64::from(ring) / f64::from(rings))
        }
    };
    let mut triangles = Vec::new();
    for k in 0..rim.len() {
        triangles.push([z, at(k, 1), at(k + 1, 1)]);
        for ring in 1..rings {
            triangles.extend(quad([
                at(k, ring),
                at(k, ring + 1),
                at(k + 1, ring + 1),
                at(k + 1, ring),
            ]));
        }
    }
    triangles
}

fn reversed(triangles: Vec<Triangle>) -> Vec<Triangle> {
    triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect()
}

#[test]
fn enclosures_with_flat_faces() {
    let Some(cases) = cases("reference_cases::enclosures_with_flat_faces") else {
        return;
    };
    let (opposite, adjacent) = (
        expect(&cases, "cube_faces", "opposite"),
        expect(&cases, "cube_faces", "adjacent"),
    );
    let faces = box_inside(DVec3::ONE);
    let mut expected = Vec::new();
    for from in 0..6 {
        for to in 0..6 {
            let exact = if from == to {
                0.0
            } else if from / 2 == to / 2 {
                opposite
            } else {
                adjacent
            };
            expected.push((from, to, exact));
        }
    }
    let cube = |k: u32| faces.map(|face| grid(face, &even(k), &even(k))).to_vec();
    let found = enclosure("cube", [2, 4, 8], cube, &expected, 8e-4);
    closed("cube", &found);
    assert!(
        (0..6).all(|k| found.factors[k][k] == 0.0),
        "a face of the cube sees itself"
    );

    let third = expect(&cases, "tetrahedron_regular", "F_ij (i!=j)");
    let p = [(1., 1., 1.), (1., -1., -1.), (-1., 1., -1.), (-1., -1., 1.)].map(|(x, y, z)| DVec3::new(x, y, z));
    let faces = [
        [p[0], p[2], p[1]],
        [p[0], p[1], p[3]],
        [p[0], p[3], p[2]],
        [p[1], p[2], p[3]],
    ];
    let cut = |face: &Triangle, k: u32| {
        let mut parts = Vec::new();
        Subdivision::Split(k).cut(face, &mut parts);
        parts
    };
    let inward = faces.iter().all(|[a, b, c]| (*b - *a).cross(*c - *a).dot(-*a) > 0.0);
    let faces = if inward {
        faces
    } else {
        faces.map(|[a, b, c]| [a, c, b])
    };
    let off_diagonal: Vec<(usize, usize, f64)> = (0..16)
        .filter(|k| k / 4 != k % 4)
        .map(|k| (k / 4, k % 4, third))
        .collect();
    let build = |k: u32| faces.iter().map(|face| cut(face, k)).collect();
    let found = enclosure("tetrahedron", [2, 4, 8], build, &off_diagonal, 8e-5);
    closed("tetrahedron", &found);
    assert!(
        (0..4).all(|k| found.factors[k][k] == 0.0),
        "a face of the tetrahedron sees itself"
    );
}

#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn enclosures_with_curved_faces() {
    let Some(cases) = cases("reference_cases::enclosures_with_curved_faces") else {
        return;
    };
    let id = "closed_cylinder_r1_h2";
    let end_end = expect(&cases, id, "end->end");
    let end_side = expect(&cases, id, "end->side");
    let (side_end, side_side) = (expect(&cases, id, "side->end"), expect(&cases, id, "side->side"));
    let cylinder = |k: u32| {
        let (low, high) = (circle(8 * k, 1.0, 0.0), circle(8 * k, 1.0, 2.0));
        let side = (0..low.len()).flat_map(|i| {
            let j = (i + 1) % low.len();
            grid([low[i], high[i], high[j], low[j]], &even(2 * k), &even(1))
        });
        vec![disc(&low, k), reversed(disc(&high, k)), side.collect()]
    };
    let expected = [
        (0, 1, end_end),
        (1, 0, end_end),
        (0, 2, end_side),
        (2, 0, side_end),
        (2, 2, side_side),
    ];
    closed("cylinder", &enclosure("cylinder", [2, 4, 8], cylinder, &expected, 1e-3));

    let hemisphere = |k: u32| {
        let dome = sphere(k, 1.0, true, false);
        let mut rim: Vec<DVec3> = dome.iter().flatten().copied().filter(|p| p.z == 0.0).collect();
        rim.sort_by(|p, q| p.y.atan2(p.x).total_cmp(&q.y.atan2(q.x)));
        rim.dedup();
        vec![disc(&rim, k), dome]
    };
    let id = "hemisphere_r1";
    let expected = [
        (0, 1, expect(&cases, id, "base->dome")),
        (1, 0, expect(&cases, id, "dome->base")),
        (1, 1, expect(&cases, id, "dome->dome")),
    ];
    let found = enclosure("hemisphere", [2, 4, 8], hemisphere, &expected[1..], 8e-3);
    closed("hemisphere", &found);
    assert!(
        (found.factors[0][1] - expected[0].2).abs() < 1e-12,
        "the base sees the dome alone"
    );

    let spheres = |k: u32| vec![sphere(k, 3.0, true, true), sphere(k, 1.0, false, true)];
    let id = "concentric_spheres_b";
    let expected = [
        (0, 1, expect(&cases, id, "outer->inner")),
        (0, 0, expect(&cases, id, "outer->outer")),
    ];
    let found = enclosure("concentric spheres", [2, 4, 8], spheres, &expected, 2e-3);
    closed("concentric spheres", &found);
    assert!((found.factors[1][0] - expect(&cases, id, "inner->outer")).abs() < 1e-12);

    // From every patch to each octant of the sphere: its share of the area, which by symmetry is an eighth.
    let octants = |k: u32| {
        sphere(k, 1.0, true, true)
            .chunks((k * k) as usize)
            .map(<[_]>::to_vec)
            .collect::<Vec<_>>()
    };
    let share = expect(&cases, "sphere_interior", "F_ij*4*pi*R^2/A_j") / 8.0;
    let expected: Vec<(usize, usize, f64)> = (0..64).map(|k| (k / 8, k % 8, share)).collect();
    closed("sphere", &enclosure("sphere", [2, 4, 8], octants, &expected, 1.5e-2));

    for id in ["disks_equal", "disks_1_0.5_h3"] {
        let case = cases.iter().find(|case| case["id"] == id).expect("a case of discs");
        let (one, two) = (number(&case["emitter"]["radius"]), number(&case["receiver"]["radius"]));
        let height = number(&case["receiver"]["center"][2]);
        let discs = |k: u32| {
            vec![
                disc(&circle(8 * k, one, 0.0), k),
                reversed(disc(&circle(8 * k, two, height), k)),
            ]
        };
        let expected = [
            (0, 1, number(&case["F_emitter_to_receiver"])),
            (1, 0, number(&case["F_receiver_to_emitter"])),
        ];
        enclosure(id, [2, 4, 8], discs, &expected, 4e-4);
    }
}

#[test]
fn strips_and_a_street_canyon() {
    let Some(cases) = cases("reference_cases::strips_and_a_street_canyon") else {
        return;
    };
    let exact = expect(&cases, "infinite_strips_w1_h1", "1->2 (length 200, exact C-11)");
    assert!((parallel_rectangles(1.0, 200.0, 1.0) - exact).abs() < 1e-12);
    assert!((exact - expect(&cases, "infinite_strips_w1_h1", "1->2 (infinite)")).abs() < 5e-3);
    let [floor, ceiling, ..] = box_inside(DVec3::new(1.0, 200.0, 1.0));
    let strips = |k: u32| vec![grid(floor, &even(k), &even(100)), grid(ceiling, &even(100), &even(k))];
    enclosure("strips", [1, 2, 4], strips, &[(0, 1, exact), (1, 0, exact)], 3e-3);

    let id = "street_canyon_10x10x50";
    let (floor_wall, wall_wall) = (expect(&cases, id, "floor->one wall"), expect(&cases, id, "wall->wall"));
    let [floor, _, west, east, ..] = box_inside(DVec3::new(10.0, 50.0, 10.0));
    let canyon = |k: u32| {
        vec![
            grid(floor, &even(k), &even(5 * k)),
            grid(west, &even(5 * k), &even(k)),
            grid(east, &even(k), &even(5 * k)),
        ]
    };
    let expected = [
        (0, 1, floor_wall),
        (0, 2, floor_wall),
        (1, 0, floor_wall),
        (2, 0, floor_wall),
        (1, 2, wall_wall),
        (2, 1, wall_wall),
    ];
    let found = enclosure("street canyon", [2, 4, 8], canyon, &expected, 8e-4);
    for (from, key) in [(0, "floor row sum"), (1, "wall row sum"), (2, "wall row sum")] {
        let sum: f64 = found.factors[from].iter().sum();
        assert!((sum - expect(&cases, id, key)).abs() < 1e-3, "{key}: {sum}");
        assert!((sum + found.escaped[from] - 1.0).abs() < 1e-12);
    }
}

#[test]
fn a_wrong_factor_would_be_noticed() {
    let [parallel, _] = unit_squares();
    let wrong = Pair {
        exact: parallel.exact * 1.01,
        ..parallel
    };
    let failed = std::panic::catch_unwind(|| area_error_falls("a factor 1 % off", &[wrong], -1.8, 8e-4));
    assert!(failed.is_err());
    let open = model(
        scene_of(box_inside(DVec3::ONE)[..5].iter().copied().flat_map(quad)),
        Subdivision::Levels(1),
    );
    let found = groups(&open, &[0; 10], 64);
    assert!(std::panic::catch_unwind(|| closed("an open cube", &found)).is_err());
}
