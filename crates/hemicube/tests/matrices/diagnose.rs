//! Each detector on scenes small enough to know the answer: where it must fire, with what measure, and where it must
//! not.

use glam::{DQuat, DVec3};
use hemicube::diagnose::{DiagnoseOptions, Diagnosis, Finding, FindingKind, Grain, diagnose};
use hemicube::factor::point_to_triangle;
use hemicube::{HierarchyOptions, InputPatch, Model};
use hemicube_scene::{Patches, Scene, Subdivision, Triangle};

fn p(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

fn scene(triangles: impl IntoIterator<Item = [DVec3; 3]>, two_sided: bool) -> Scene {
    Scene {
        triangles: (0..)
            .zip(triangles)
            .map(|(face, corners)| Triangle {
                corners,
                object: 0,
                material: 0,
                face,
                two_sided,
            })
            .collect(),
        ..Scene::default()
    }
}

fn model(scene: &Scene, subdivision: Subdivision) -> Model {
    let patches = Patches::new(scene, subdivision).expect("patches");
    Model::new(patches.into(), HierarchyOptions::default()).expect("a scene with an extent")
}

fn examine(triangles: impl IntoIterator<Item = [DVec3; 3]>) -> Diagnosis {
    diagnose(
        &model(&scene(triangles, false), Subdivision::None),
        DiagnoseOptions::default(),
    )
}

fn examine_two_sided(triangles: impl IntoIterator<Item = [DVec3; 3]>) -> Diagnosis {
    diagnose(
        &model(&scene(triangles, true), Subdivision::None),
        DiagnoseOptions::default(),
    )
}

fn kinds(diagnosis: &Diagnosis) -> Vec<FindingKind> {
    diagnosis.findings.iter().map(|finding| finding.kind).collect()
}

#[track_caller]
fn found(diagnosis: &Diagnosis, kind: FindingKind) -> &Finding {
    diagnosis
        .of(kind)
        .unwrap_or_else(|| panic!("no {kind:?} among {:?}", kinds(diagnosis)))
}

#[track_caller]
fn lacks(diagnosis: &Diagnosis, kind: FindingKind) {
    assert_eq!(diagnosis.of(kind), None);
}

#[track_caller]
fn near(found: f64, wanted: f64, tolerance: f64) {
    assert!((found - wanted).abs() <= tolerance, "{found} is not {wanted}");
}

fn quad([a, b, c, d]: [DVec3; 4]) -> [[DVec3; 3]; 2] {
    [[a, b, c], [a, c, d]]
}

/// A rectangle at height z whose front looks up.
fn plate([x0, x1]: [f64; 2], [y0, y1]: [f64; 2], z: f64) -> [[DVec3; 3]; 2] {
    quad([p(x0, y0, z), p(x1, y0, z), p(x1, y1, z), p(x0, y1, z)])
}

fn flipped<const N: usize>(triangles: [[DVec3; 3]; N]) -> [[DVec3; 3]; N] {
    triangles.map(|[a, b, c]| [a, c, b])
}

/// The box from −`half` to `half`, seen from outside.
fn solid(half: DVec3) -> Vec<[DVec3; 3]> {
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut n = DVec3::ZERO;
            n[axis] = sign;
            let mut u = DVec3::ZERO;
            u[(axis + 1) % 3] = 1.0;
            let v = n.cross(u);
            let corners = [n - u - v, n + u - v, n + u + v, n - u + v].map(|c| c * half);
            triangles.extend(quad(corners));
        }
    }
    triangles
}

fn inside_out(triangles: Vec<[DVec3; 3]>) -> Vec<[DVec3; 3]> {
    triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect()
}

const GROUND: [DVec3; 3] = [DVec3::ZERO, DVec3::new(4.0, 0.0, 0.0), DVec3::new(0.0, 4.0, 0.0)];

/// A triangle on edge over (1, 1), two high and one wide at its foot, which is at `foot`.
fn wall(foot: f64) -> [DVec3; 3] {
    [p(0.5, 1.0, foot), p(1.5, 1.0, foot), p(1.0, 1.0, foot + 2.0)]
}

#[test]
fn nothing_is_said_of_a_scene_without_defects() {
    let room = scene(inside_out(solid(p(2.0, 1.5, 1.0))), false);
    let diagnosis = diagnose(&model(&room, Subdivision::Split(8)), DiagnoseOptions::default());
    assert_eq!(kinds(&diagnosis), []);
    // A solid on a ground that is cut along it is no mistake either.
    let mut yard = solid(p(1.0, 1.0, 1.0));
    for (x, y) in [
        (-3.0, -3.0),
        (-3.0, -1.0),
        (-3.0, 1.0),
        (-1.0, -3.0),
        (-1.0, 1.0),
        (1.0, -3.0),
        (1.0, -1.0),
        (1.0, 1.0),
    ] {
        yard.extend(plate([x, x + 2.0], [y, y + 2.0], -1.0));
    }
    let diagnosis = diagnose(
        &model(&scene(yard, false), Subdivision::Split(8)),
        DiagnoseOptions::default(),
    );
    assert_eq!(kinds(&diagnosis), []);
    assert_eq!(kinds(&examine([GROUND])), []);
}

#[test]
fn crossing_lines_have_their_length_and_place() {
    let diagnosis = examine([GROUND, wall(-1.0)]);
    let crossing = found(&diagnosis, FindingKind::Crossing);
    assert_eq!((crossing.count, crossing.examined, crossing.population), (1, 2, 2));
    // Half way up, the wall is half as wide as at its foot.
    near(crossing.total.expect("a total"), 0.5, 1e-12);
    let worst = crossing.examples[0];
    near(worst.value, 0.5, 1e-12);
    assert!((worst.at - p(1.0, 1.0, 0.0)).length() < 1e-12, "{}", worst.at);
    assert_eq!((worst.patch, worst.other), (InputPatch(1), Some(InputPatch(0))));
    assert!(crossing.next.contains("cut them finer"), "{}", crossing.next);

    // Standing on it, a hair into it, over it, beside it, and joined at an edge.
    for foot in [0.0, -1e-4, 0.1] {
        lacks(&examine([GROUND, wall(foot)]), FindingKind::Crossing);
    }
    lacks(
        &examine([GROUND, wall(-1.0).map(|c| c + p(5.0, 0.0, 0.0))]),
        FindingKind::Crossing,
    );
    lacks(
        &examine([GROUND, [GROUND[0], GROUND[1], p(1.0, 1.0, 1.0)]]),
        FindingKind::Crossing,
    );
    // In the plane of each other's, but past its end.
    lacks(
        &examine([GROUND, wall(-1.0).map(|c| c + p(3.0, 2.0, 0.0))]),
        FindingKind::Crossing,
    );
}

#[test]
fn crossings_do_not_depend_on_where_or_how_large_the_scene_is() {
    let turn = DQuat::from_axis_angle(p(1.0, 2.0, 3.0).normalize(), 2f64.sqrt());
    for (scale, offset) in [
        (1.0, 1e7),
        (1e-9, 0.0),
        (1e9, 0.0),
        (1.0, -3e5),
        (1e-59, 0.0),
        (1e59, 0.0),
    ] {
        let place = |c: DVec3| turn * c * scale + DVec3::splat(offset);
        let diagnosis = examine([GROUND, wall(-1.0)].map(|t| t.map(place)));
        let crossing = found(&diagnosis, FindingKind::Crossing);
        let rounding = 1e-12 * scale + 1e-15 * f64::abs(offset);
        near(crossing.examples[0].value, 0.5 * scale, 100.0 * rounding);
        let off = crossing.examples[0].at - place(p(1.0, 1.0, 0.0));
        assert!(off.abs().max_element() <= 100.0 * rounding);
    }
}

/// Where the edge from a to b passes through the inside of a triangle.
fn pierced(a: DVec3, b: DVec3, [p, q, r]: [DVec3; 3]) -> Option<DVec3> {
    let volume = |i: DVec3, j: DVec3, k: DVec3, l: DVec3| (j - i).cross(k - i).dot(l - i);
    let (from, to) = (volume(p, q, r, a), volume(p, q, r, b));
    let sides = [volume(a, b, p, q), volume(a, b, q, r), volume(a, b, r, p)];
    let inside = sides.iter().all(|&s| s > 0.0) || sides.iter().all(|&s| s < 0.0);
    (from * to < 0.0 && inside).then(|| a + (b - a) * (from / (from - to)))
}

/// Triangles of about this size anywhere in a unit cube.
fn scattered(count: u64, size: f64) -> Vec<[DVec3; 3]> {
    let mut state = 1u64;
    let mut unit = || {
        // Knuth's MMIX generator.
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut point = || p(unit(), unit(), unit());
    (0..count)
        .map(|_| {
            let middle = point();
            [point(), point(), point()].map(|c| middle + (c - DVec3::splat(0.5)) * size)
        })
        .collect()
}

#[test]
fn crossings_are_those_whose_edges_pierce_the_other() {
    let triangles = scattered(600, 0.5);
    let (mut count, mut total) = (0u64, 0.0);
    for (i, p) in triangles.iter().enumerate() {
        for q in &triangles[..i] {
            let edges = |t: &[DVec3; 3]| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
            let mut ends: Vec<DVec3> = edges(p).iter().filter_map(|&(a, b)| pierced(a, b, *q)).collect();
            ends.extend(edges(q).iter().filter_map(|&(a, b)| pierced(a, b, *p)));
            if let [a, b] = ends[..] {
                count += 1;
                total += a.distance(b);
            }
        }
    }
    assert!(count > 300, "{count} crossings are too few to tell");
    let diagnosis = examine(triangles);
    let crossing = found(&diagnosis, FindingKind::Crossing);
    // Those too short to matter are not counted.
    assert!(
        crossing.count <= count && crossing.count as f64 >= 0.97 * count as f64,
        "{} of {count}",
        crossing.count
    );
    near(crossing.total.expect("a total"), total, 1e-3 * total);
}

#[test]
fn triangles_in_one_plane_overlap_by_their_common_area() {
    let lower = [DVec3::ZERO, p(2.0, 0.0, 0.0), p(0.0, 2.0, 0.0)];
    let upper = lower.map(|c| c + p(1.0, 0.0, 0.0));
    for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
        let diagnosis = examine([lower, order.map(|k| upper[k])]);
        let overlap = found(&diagnosis, FindingKind::Overlap);
        assert_eq!(overlap.count, 1);
        // The corner that x ≥ 1 cuts off.
        near(overlap.examples[0].value, 0.5, 1e-12);
        near(overlap.total.expect("a total"), 0.5, 1e-12);
        // Turned over they are seen from opposite sides: neither hides the other.
        let turned = examine([lower, [upper[order[0]], upper[order[2]], upper[order[1]]]]);
        lacks(&turned, FindingKind::Overlap);
        // Unless both sides of them count.
        let turned = examine_two_sided([lower, [upper[order[0]], upper[order[2]], upper[order[1]]]]);
        assert_eq!(found(&turned, FindingKind::Overlap).count, 1);
    }
    // The whole of it, twice.
    let twice = examine([lower, [lower[1], lower[2], lower[0]]]);
    near(found(&twice, FindingKind::Overlap).examples[0].value, 2.0, 1e-12);
    // Neighbours in a plane, and a tile that touches at a corner.
    lacks(&examine(plate([0.0, 1.0], [0.0, 1.0], 0.0)), FindingKind::Overlap);
    lacks(
        &examine([lower, lower.map(|c| c + p(2.0, 0.0, 0.0))]),
        FindingKind::Overlap,
    );
    // A decal one ten-thousandth of its size over a table hides it; one further up is a thing of its own.
    let table = plate([0.0, 4.0], [0.0, 4.0], 0.0);
    let decal = |z| plate([1.0, 2.0], [0.2, 0.8], z);
    let over = |z| examine(table.into_iter().chain(decal(z)));
    assert!(found(&over(1e-6), FindingKind::Overlap).count >= 2);
    lacks(&over(1e-2), FindingKind::Overlap);
}

#[test]
fn plates_face_to_face_nearly_touch_and_plates_back_to_back_do_not() {
    let lower = plate([0.0, 1.0], [0.0, 1.0], 0.0);
    let upper = |z| plate([0.0, 1.0], [0.0, 1.0], z);
    let pair = |lower: [[DVec3; 3]; 2], upper: [[DVec3; 3]; 2]| examine(lower.into_iter().chain(upper));
    let diagnosis = pair(lower, flipped(upper(2e-5)));
    let contact = found(&diagnosis, FindingKind::NearContact);
    assert_eq!(contact.count, 2);
    near(contact.examples[0].value, 2e-5, 1e-12);
    lacks(&diagnosis, FindingKind::Overlap);
    lacks(&diagnosis, FindingKind::Crossing);

    lacks(&pair(lower, flipped(upper(1e-2))), FindingKind::NearContact);
    lacks(&pair(flipped(lower), upper(2e-5)), FindingKind::NearContact);
    assert_eq!(kinds(&pair(flipped(lower), upper(2e-5))), []);
    lacks(&pair(lower, upper(2e-5)), FindingKind::NearContact);
    // Both sides of both: one of each faces the other across the gap.
    let both = examine_two_sided(lower.into_iter().chain(upper(2e-5)));
    assert_eq!(found(&both, FindingKind::NearContact).count, 2);
}

#[test]
fn what_lies_inside_a_solid_is_buried() {
    let small = [p(0.1, 0.0, 0.1), p(0.3, 0.0, 0.1), p(0.1, 0.2, 0.2)];
    let with = |triangle: [DVec3; 3]| solid(DVec3::ONE).into_iter().chain([triangle]).collect::<Vec<_>>();
    let diagnosis = examine(with(small));
    let buried = found(&diagnosis, FindingKind::Buried);
    assert_eq!((buried.count, buried.examples[0].patch), (1, InputPatch(12)));
    let area = 0.5 * (small[1] - small[0]).cross(small[2] - small[0]).length();
    near(buried.examples[0].value, area, 1e-12);
    near(buried.total.expect("a share"), area / (24.0 + area), 1e-9);
    lacks(&diagnosis, FindingKind::CentroidBuried);

    // Outside, in a room (a solid inside out), and in a solid of sheets, it sees something.
    assert_eq!(kinds(&examine(with(small.map(|c| c + p(3.0, 0.0, 0.0))))), []);
    let room = inside_out(solid(DVec3::ONE)).into_iter().chain([small]);
    lacks(&examine(room), FindingKind::Buried);
    lacks(&examine_two_sided(with(small)), FindingKind::Buried);
}

#[test]
fn a_buried_centroid_is_told_from_a_buried_patch() {
    // Its middle is in the solid, its ends stick out on both sides.
    let long = [p(-9.0, 0.0, 0.0), p(9.0, -0.5, 0.0), p(9.0, 0.5, 0.1)];
    let centred = {
        let middle = long.iter().sum::<DVec3>() / 3.0;
        long.map(|c| c - middle)
    };
    let diagnosis = examine(solid(DVec3::ONE).into_iter().chain([centred]));
    let buried = found(&diagnosis, FindingKind::CentroidBuried);
    assert_eq!((buried.count, buried.examples[0].patch), (1, InputPatch(12)));
    assert!(
        (0.3..1.0).contains(&buried.examples[0].value),
        "{}",
        buried.examples[0].value
    );
    lacks(&diagnosis, FindingKind::Buried);
    assert!(found(&diagnosis, FindingKind::Crossing).count >= 2);
    // The other way round: its centroid is outside.
    let off = centred.map(|c| c + p(4.0, 0.0, 0.0));
    lacks(
        &examine(solid(DVec3::ONE).into_iter().chain([off])),
        FindingKind::CentroidBuried,
    );
}

#[test]
fn a_roof_that_faces_away_blocks_by_its_form_factor() {
    let small = [p(-0.1, -0.1, 0.0), p(0.1, -0.1, 0.0), p(0.0, 0.2, 0.0)];
    for (height, fires) in [(0.5, true), (2.0, false)] {
        let roof = plate([-1.0, 1.0], [-1.0, 1.0], height);
        let wanted: f64 = flipped(roof)
            .iter()
            .map(|triangle| point_to_triangle(DVec3::ZERO, DVec3::Z, triangle))
            .sum();
        assert_eq!(wanted > 0.55, fires, "{wanted}");
        let diagnosis = examine(roof.into_iter().chain([small]));
        assert_eq!(diagnosis.of(FindingKind::MostlyBlocked).is_some(), fires);
        if fires {
            let blocked = found(&diagnosis, FindingKind::MostlyBlocked);
            assert_eq!((blocked.count, blocked.examples[0].patch), (1, InputPatch(2)));
            near(blocked.examples[0].value, wanted, 0.05);
        }
        lacks(&diagnosis, FindingKind::Buried);
    }
}

#[test]
fn a_floor_that_is_large_beside_its_wall_is_too_large_until_it_is_cut() {
    // The wall stands close to the floor's centroid and takes much of its view, and little of the floor's average.
    let floor = [p(-9.0, -9.0, 0.0), p(18.0, -9.0, 0.0), p(-9.0, 18.0, 0.0)];
    let wall = quad([p(1.0, -2.0, 0.0), p(1.0, -2.0, 3.0), p(1.0, 2.0, 3.0), p(1.0, 2.0, 0.0)]);
    let both = scene([floor].into_iter().chain(wall), false);
    let normal = (both.triangles[1].corners[1] - both.triangles[1].corners[0])
        .cross(both.triangles[1].corners[2] - both.triangles[1].corners[0]);
    assert!(normal.x < 0.0, "the wall looks at the centroid");
    let diagnosis = diagnose(&model(&both, Subdivision::None), DiagnoseOptions::default());
    let large = found(&diagnosis, FindingKind::LargePatch);
    let worst = large.examples[0];
    assert_eq!((large.count, worst.patch), (1, InputPatch(0)));
    // From the centroid in closed form; the average over the floor is next to nothing.
    let corners = both.triangles[worst.other.expect("a pair").0 as usize].corners;
    let from_centroid = point_to_triangle(DVec3::ZERO, DVec3::Z, &corners);
    assert!(from_centroid > 0.1, "{from_centroid}");
    near(worst.value, from_centroid, 0.03);
    let longest = 27.0 * 2f64.sqrt();
    assert!(
        large
            .next
            .contains("no longer than 20, half their size, is 2.0 times as many"),
        "half of {longest} in: {}",
        large.next
    );

    let fine = diagnose(&model(&both, Subdivision::Split(32)), DiagnoseOptions::default());
    let left = fine.of(FindingKind::LargePatch).map_or(0, |finding| finding.count);
    assert!(left <= 2, "{left} of {} are still too large", 3 * 32 * 32);
    // Far away the same wall is no trouble.
    let away = scene(
        [floor]
            .into_iter()
            .chain(wall.map(|t| t.map(|c| c * 0.1 + p(9.0, 3.0, 30.0)))),
        false,
    );
    lacks(
        &diagnose(&model(&away, Subdivision::None), DiagnoseOptions::default()),
        FindingKind::LargePatch,
    );
}

#[test]
fn slivers_are_counted_beyond_a_thousand() {
    let of = |aspect: f64| [DVec3::ZERO, p(1.0, 0.0, 0.0), p(0.5, 1.0 / aspect, 0.0)];
    let diagnosis = examine(
        [of(2000.0), of(500.0), of(2.0)]
            .into_iter()
            .zip(0..)
            .map(|(t, k)| t.map(|c| c + p(0.0, 0.0, f64::from(k)))),
    );
    let slivers = found(&diagnosis, FindingKind::Sliver);
    assert_eq!((slivers.count, slivers.examples[0].patch), (1, InputPatch(0)));
    near(slivers.examples[0].value, 2000.0, 1e-6);
}

/// A field of triangles with corners as if measured, rounded to multiples of `step` (0: not at all).
fn field(step: f64) -> Vec<[DVec3; 3]> {
    let n = 16;
    let height = |i: u32, j: u32| f64::from((i * 7919 + j * 104_729) % 1013) / 10_130.0;
    let corner = |i: u32, j: u32| {
        let c = p(
            f64::from(i) + height(j, i),
            f64::from(j) + height(i + 3, j),
            height(i, j + 5),
        ) * std::f64::consts::LN_2;
        if step > 0.0 { (c / step).round() * step } else { c }
    };
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..n {
            triangles.extend(quad([
                corner(i, j),
                corner(i + 1, j),
                corner(i + 1, j + 1),
                corner(i, j + 1),
            ]));
        }
    }
    triangles
}

#[test]
fn the_grain_of_a_file_and_what_it_spoils() {
    // A triangle four steps high, and one whose corner is one step off a neighbour's.
    let thin = [p(2.0, 2.0, 3.0), p(2.5, 2.0, 3.0), p(2.25, 2.004, 3.0)];
    let mut rounded = field(1e-3);
    let corner = rounded[40][0];
    rounded.push(thin);
    let clean = examine(rounded.clone());
    assert_eq!(clean.precision.grain, Some(Grain::Decimal(1e-3)));
    let coarse = found(&clean, FindingKind::CoarseGrain);
    assert_eq!((coarse.count, coarse.examples[0].patch), (1, InputPatch(512)));
    near(coarse.examples[0].value, 0.25f64.atan().to_degrees(), 1e-6);
    assert!(coarse.next.contains("1e-3"), "{}", coarse.next);
    lacks(&clean, FindingKind::Crack);

    rounded.push([
        corner + p(0.001, 0.0, 0.0),
        corner + p(0.5, 0.0, 1.0),
        corner + p(0.0, 0.5, 1.0),
    ]);
    let cracked = examine(rounded);
    let crack = found(&cracked, FindingKind::Crack);
    assert_eq!(crack.count, 1, "one place, however many triangles meet there");
    near(crack.examples[0].value, 1e-3, 1e-9);
    assert!((crack.examples[0].at - corner).length() < 1e-3);

    // The same to full precision: no grain, so none of it is rounding.
    let mut exact = field(0.0);
    exact.push(thin);
    let exact = examine(exact);
    assert_eq!(exact.precision.grain, None);
    lacks(&exact, FindingKind::CoarseGrain);
    // Typed numbers are exact, however few their digits.
    assert_eq!(examine([GROUND, wall(-1.0)]).precision.grain, None);
}

#[test]
fn the_digits_that_f32_would_leave() {
    let at = |offset: f64| examine(field(0.0).into_iter().map(|t| t.map(|c| c + DVec3::splat(offset)))).precision;
    let (here, away) = (at(0.0), at(3e6));
    assert!(here.f32_digits > 5.5 && here.f32_step <= 1e-6, "{here:?}");
    assert!(away.f32_digits < 0.7 && away.f32_step == 0.25, "{away:?}");
}

#[test]
fn threads_change_nothing_and_a_sample_estimates_the_whole() {
    let model = model(&scene(scattered(4000, 0.2), false), Subdivision::None);
    let run = |threads, surfaces_max| {
        diagnose(
            &model,
            DiagnoseOptions {
                seed: 9,
                threads,
                surfaces_max,
                ..DiagnoseOptions::default()
            },
        )
    };
    let all = run(1, usize::MAX);
    let some = run(1, 1500);
    for threads in [2, 3] {
        assert_eq!(run(threads, usize::MAX), all);
        assert_eq!(run(threads, 1500), some);
    }
    let (whole, part) = (found(&all, FindingKind::Crossing), found(&some, FindingKind::Crossing));
    assert!(!whole.is_estimate() && whole.estimate == whole.count as f64);
    assert!(part.is_estimate() && part.examined == 1500 && part.count < whole.count);
    near(part.estimate, whole.estimate, 0.15 * whole.estimate);
    let total = |finding: &Finding| finding.total.expect("a total");
    near(total(part), total(whole), 0.15 * total(whole));
}

#[test]
fn a_thousand_triangles_in_one_place_end_soon() {
    // Every pair overlaps and every box meets every other.
    let pile = (0..8000).map(|k| GROUND.map(|c| c * (1.0 + 1e-4 * f64::from(k))));
    let started = std::time::Instant::now();
    let diagnosis = examine(pile);
    let overlap = found(&diagnosis, FindingKind::Overlap);
    assert!(overlap.is_estimate(), "{} of {}", overlap.examined, overlap.population);
    let pairs = 8000.0 * 7999.0 / 2.0;
    near(overlap.estimate, pairs, 0.15 * pairs);
    assert!(started.elapsed().as_secs() < 120);
}
