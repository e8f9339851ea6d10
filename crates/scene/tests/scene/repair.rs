//! Repair: each rule at its bound and at extremes of scale, duplicates against a comparison of all pairs; and the
//! survey: small solids, and the real scenes against edge counts that an independent program took.

#![allow(clippy::print_stdout, reason = "a skipped test says so")]

use glam::DVec3;
use hemicube_scene::repair::{RepairOptions, RepairReport, repair};
use hemicube_scene::survey::{Edges, Survey, survey};
use hemicube_scene::{Axis, Material, ReadOptions, Scene, Triangle};
use proptest::prelude::*;

const KEEP: RepairOptions = RepairOptions { keep_duplicates: true };

fn scene(triangles: impl IntoIterator<Item = ([DVec3; 3], bool)>) -> Scene {
    Scene {
        triangles: (0..)
            .zip(triangles)
            .map(|(face, (corners, two_sided))| Triangle {
                corners,
                object: 0,
                material: 0,
                face,
                two_sided,
            })
            .collect(),
        objects: vec!["all".to_owned()],
        materials: vec![Material::default()],
        ..Scene::default()
    }
}

fn one_sided(triangles: impl IntoIterator<Item = [DVec3; 3]>) -> Scene {
    scene(triangles.into_iter().map(|corners| (corners, false)))
}

fn faces(scene: &Scene) -> Vec<u32> {
    scene.triangles.iter().map(|t| t.face).collect()
}

const A: DVec3 = DVec3::new(0.25, 0.5, 1.0);
const B: DVec3 = DVec3::new(3.0, 0.0, -1.0);
const C: DVec3 = DVec3::new(1.0, 7.0, 2.0);

// Rules 1 and 2.

#[test]
fn corners_that_are_not_finite() {
    let mut triangles = vec![[A, B, C]];
    for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        triangles.extend([
            [DVec3::new(x, 0.0, 0.0), B, C],
            [A, DVec3::new(0.0, x, 0.0), C],
            [A, B, DVec3::new(0.0, 0.0, x)],
        ]);
    }
    triangles.push([B, A, C]);
    let mut scene = one_sided(triangles);
    let report = repair(&mut scene, RepairOptions::default());
    assert_eq!((report.non_finite, report.degenerate), (9, 0));
    assert_eq!(faces(&scene), [0, 10]);
}

/// Returns whether a triangle is dropped as degenerate.
fn drops(corners: [DVec3; 3]) -> bool {
    let mut scene = one_sided([corners]);
    let report = repair(&mut scene, RepairOptions::default());
    assert_eq!(scene.triangles.len(), if report.degenerate == 0 { 1 } else { 0 });
    report.degenerate == 1
}

/// A cap and a needle: the apex above the middle of the longest edge, and above its end.
fn slivers(height: f64) -> [[DVec3; 3]; 2] {
    [0.5, 1.0].map(|x| [DVec3::ZERO, DVec3::X, DVec3::new(x, height, 0.0)])
}

#[test]
fn triangles_without_area() {
    assert!(drops([A, A, A]));
    assert!(drops([A, B, A]) && drops([A, A, B]) && drops([B, A, A]));
    assert!(drops([DVec3::ZERO, DVec3::X, DVec3::X * 3.0]));
    // Not exactly on a line, for 0.1 + 0.2 is not 0.3.
    assert!(drops([
        DVec3::splat(0.1),
        DVec3::new(0.3, 0.2, 0.1 + 0.2),
        DVec3::new(0.2, 0.15, 0.2)
    ]));
    assert!(drops([
        DVec3::splat(1e7),
        DVec3::splat(1e7) + DVec3::X,
        DVec3::splat(1e7) + DVec3::new(0.5, 5e-9, 0.0)
    ]));
}

#[test]
fn the_bound_of_shape_is_the_same_at_every_scale() {
    for exponent in [-1060, -1000, -600, -300, -30, 0, 30, 300, 600, 1000, 1022] {
        let scale = f64::from(exponent).exp2();
        for corner in 0..3 {
            for mut corners in slivers(1.01e-12).into_iter().chain(slivers(1e-6)) {
                corners.rotate_left(corner);
                // Near 2⁻¹⁰⁷⁴ there are no digits left to tell a sliver by.
                if exponent > -1000 {
                    assert!(!drops(corners.map(|p| p * scale)), "{corners:?} × 2^{exponent}");
                }
            }
            for mut corners in slivers(0.99e-12) {
                corners.rotate_left(corner);
                assert!(drops(corners.map(|p| p * scale)), "{corners:?} × 2^{exponent}");
            }
        }
        assert!(!drops([A, B, C].map(|p| p * 0.125 * scale)), "2^{exponent}");
    }
}

#[test]
fn long_triangles_survive_far_from_the_origin() {
    let direction = DVec3::new(0.6, -0.48, 0.64);
    for scale in [1e-9, 1e-6, 1.0, 1e6, 1e9] {
        for corners in slivers(1e-6) {
            let turned = corners.map(|p| (direction * p.x + DVec3::new(0.8, 0.36, -0.48) * p.y) * scale);
            assert!(!drops(turned), "{turned:?}");
            // Ten million sizes away, where coordinates have steps of 2⁻²⁹ sizes.
            let far = turned.map(|p| p + DVec3::new(1e7, -1e7, 0.7e7) * scale);
            assert!(!drops(far), "{far:?}");
        }
    }
}

// Rules 3 and 4.

#[test]
fn duplicates_in_any_rotation() {
    let mut scene = one_sided([
        [A, B, C],
        [B, C, A],
        [A, C, B],
        [C, A, B],
        [C, B, A],
        [A, B, C + DVec3::X],
    ]);
    let before = scene.clone();
    let expected = RepairReport {
        duplicates: 3,
        duplicates_dropped: 3,
        reversed_duplicates: 1,
        ..RepairReport::default()
    };
    assert_eq!(repair(&mut scene, RepairOptions::default()), expected);
    assert_eq!(faces(&scene), [0, 2, 5]);
    assert_eq!(scene.triangles[1], before.triangles[2]);

    let mut kept = before.clone();
    let report = repair(&mut kept, KEEP);
    assert_eq!(
        report,
        RepairReport {
            duplicates_dropped: 0,
            ..expected
        }
    );
    assert_eq!(kept, before);
}

#[test]
fn positions_are_compared_by_value_to_the_last_bit() {
    let plain = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let signed = [
        DVec3::new(-0.0, 0.0, -0.0),
        DVec3::new(1.0, -0.0, 0.0),
        DVec3::new(0.0, 1.0, -0.0),
    ];
    let near = [DVec3::ZERO, DVec3::X, DVec3::new(0.0, 1.0 + f64::EPSILON, 0.0)];
    let mut scene = one_sided([plain, signed, near]);
    assert_eq!(repair(&mut scene, RepairOptions::default()).duplicates, 1);
    assert_eq!(faces(&scene), [0, 2]);
}

#[test]
fn sides_of_two_sided_duplicates() {
    let (forward, reverse) = ([A, B, C], [C, B, A]);
    // Triangles in; faces and their two-sidedness left; duplicates, reversed duplicates.
    type Case<'a> = (&'a [([DVec3; 3], bool)], &'a [(u32, bool)], u64, u64);
    let cases: [Case<'_>; 9] = [
        (&[(forward, true), (forward, true)], &[(0, true)], 1, 0),
        (&[(forward, true), (reverse, true)], &[(0, true)], 1, 0),
        (&[(forward, true), (forward, false)], &[(0, true)], 1, 0),
        (&[(forward, true), (reverse, false)], &[(0, true)], 1, 0),
        (&[(forward, false), (forward, true)], &[(0, true)], 1, 0),
        (&[(forward, false), (reverse, true)], &[(0, true)], 1, 0),
        (&[(forward, false), (reverse, false)], &[(0, false), (1, false)], 0, 1),
        (
            &[(forward, false), (reverse, false), (forward, true)],
            &[(0, false), (1, false)],
            1,
            1,
        ),
        (
            &[(forward, false), (reverse, true), (reverse, false), (forward, false)],
            &[(0, true)],
            3,
            0,
        ),
    ];
    for (triangles, expected, duplicates, reversed) in cases {
        let before = scene(triangles.iter().copied());
        let mut after = before.clone();
        let report = repair(&mut after, RepairOptions::default());
        let left: Vec<(u32, bool)> = after.triangles.iter().map(|t| (t.face, t.two_sided)).collect();
        assert_eq!(left, expected, "{triangles:?}");
        assert_eq!(
            (report.duplicates, report.reversed_duplicates),
            (duplicates, reversed),
            "{triangles:?}"
        );
        let mut kept = before.clone();
        repair(&mut kept, KEEP);
        assert_eq!(kept, before, "{triangles:?}");
    }
}

/// The sides that radiate, as corners in order, the smallest first.
fn sides(t: &Triangle) -> Vec<[[u64; 3]; 3]> {
    let mut sides = Vec::new();
    let [a, b, c] = t.corners.map(|p| p.to_array().map(f64::to_bits));
    for mut side in [[a, b, c], [c, b, a]].into_iter().take(1 + usize::from(t.two_sided)) {
        while side[0] > side[1] || side[0] > side[2] {
            side.rotate_left(1);
        }
        sides.push(side);
    }
    sides
}

proptest! {
    #[test]
    fn every_side_of_the_file_is_left_once(
        triangles in prop::collection::vec((prop::array::uniform3(prop::array::uniform3(0..2_u8)), any::<bool>()), 0..60),
    ) {
        let corner = |p: [u8; 3]| DVec3::from_array(p.map(f64::from));
        let before = scene(triangles.into_iter().map(|(t, two_sided)| (t.map(corner), two_sided)));
        let mut after = before.clone();
        let report = repair(&mut after, RepairOptions::default());

        // Any three different corners of a cube make a triangle.
        let sound = |t: &&Triangle| t.corners[0] != t.corners[1] && t.corners[1] != t.corners[2] && t.corners[2] != t.corners[0];
        let mut asked: Vec<_> = before.triangles.iter().filter(sound).flat_map(sides).collect();
        asked.sort_unstable();
        asked.dedup();
        let mut left: Vec<_> = after.triangles.iter().flat_map(sides).collect();
        left.sort_unstable();
        prop_assert_eq!(asked, left);

        prop_assert!(faces(&after).is_sorted_by(|a, b| a < b));
        prop_assert_eq!(report.non_finite, 0);
        let dropped = (before.triangles.len() - after.triangles.len()) as u64;
        prop_assert_eq!(report.degenerate + report.duplicates_dropped, dropped);
        prop_assert_eq!(report.duplicates, report.duplicates_dropped);

        // Nothing is left to repair, and the first of each place stays.
        let mut again = after.clone();
        let second = repair(&mut again, RepairOptions::default());
        prop_assert_eq!(&again, &after);
        prop_assert_eq!((second.degenerate, second.duplicates), (0, 0));
        prop_assert_eq!(second.reversed_duplicates, report.reversed_duplicates);
        let mut kept = before.clone();
        let counted = repair(&mut kept, KEEP);
        prop_assert_eq!(counted, RepairReport { duplicates_dropped: 0, ..report });
    }

    #[test]
    fn any_coordinates_at_all(
        triangles in prop::collection::vec((prop::array::uniform3(prop::array::uniform3(any::<f64>())), any::<bool>()), 0..20),
    ) {
        let mut scene = scene(triangles.into_iter().map(|(t, two_sided)| (t.map(DVec3::from_array), two_sided)));
        let count = scene.triangles.len() as u64;
        let report = repair(&mut scene, RepairOptions::default());
        prop_assert_eq!(report.non_finite + report.degenerate + report.duplicates_dropped + scene.triangles.len() as u64, count);
        let survey = survey(&scene, &report);
        prop_assert_eq!(survey.triangle_count, scene.triangles.len());
    }
}

#[test]
fn many_copies_of_one_triangle_take_no_minutes() {
    let start = std::time::Instant::now();
    let mut scene = one_sided(std::iter::repeat_n([A, B, C], 300_000));
    assert_eq!(repair(&mut scene, RepairOptions::default()).duplicates_dropped, 299_999);
    assert_eq!(faces(&scene), [0]);
    assert!(
        start.elapsed() < std::time::Duration::from_secs(20),
        "{:?}",
        start.elapsed()
    );
}

// The survey.

/// A cube from `low` of edge `edge`, closed, its faces looking outward.
fn cube(low: DVec3, edge: f64) -> Vec<[DVec3; 3]> {
    let at = |i: u8| low + edge * DVec3::from_array([i & 1, i >> 1 & 1, i >> 2].map(f64::from));
    let quads: [[u8; 4]; 6] = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    quads
        .iter()
        .flat_map(|&[a, b, c, d]| [[at(a), at(b), at(c)], [at(a), at(c), at(d)]])
        .collect()
}

fn survey_of(mut scene: Scene) -> Survey {
    let report = repair(&mut scene, RepairOptions::default());
    survey(&scene, &report)
}

#[test]
fn a_cube() {
    let cube_survey = survey_of(one_sided(cube(DVec3::new(1.0, 2.0, 3.0), 2.0)));
    let closed = Edges {
        count: 18,
        ..Edges::default()
    };
    assert_eq!((cube_survey.edges, cube_survey.welded_edges), (closed, closed));
    assert!(cube_survey.edges.are_closed());
    assert_eq!(
        (
            cube_survey.triangle_count,
            cube_survey.object_count,
            cube_survey.closed_object_count
        ),
        (12, 1, 1)
    );
    assert_eq!(
        cube_survey.bounds,
        Some([DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 4.0, 5.0)])
    );
    assert_eq!(
        (cube_survey.area, cube_survey.area_min, cube_survey.area_max),
        (24.0, 2.0, 2.0)
    );
    assert!((cube_survey.diagonal - 12.0_f64.sqrt()).abs() < 1e-15);
    assert_eq!(cube_survey.worst.len(), 5);
    assert!(
        (cube_survey.worst[0].aspect - 2.0).abs() < 1e-12,
        "half a square is twice as long as high"
    );
    assert_eq!((cube_survey.up, cube_survey.up_guessed), (Axis::Y, true));
    assert!(cube_survey.unit_hints.is_empty());
}

#[test]
fn cubes_with_mistakes() {
    let edges = |change: fn(&mut Vec<[DVec3; 3]>)| {
        let mut triangles = cube(DVec3::ZERO, 1.0);
        change(&mut triangles);
        survey_of(one_sided(triangles))
    };
    let open = edges(|t| {
        t.pop();
    });
    assert_eq!(
        (open.edges.boundary, open.edges.non_manifold, open.edges.inconsistent),
        (3, 0, 0)
    );
    assert_eq!(open.closed_object_count, 0);
    let turned = edges(|t| t[0].swap(0, 1));
    assert_eq!(
        (
            turned.edges.boundary,
            turned.edges.non_manifold,
            turned.edges.inconsistent
        ),
        (0, 0, 3)
    );
    assert_eq!(turned.closed_object_count, 0);
    let fin = edges(|t| t.push([DVec3::ZERO, DVec3::X, DVec3::new(0.5, -1.0, -1.0)]));
    assert_eq!(
        (fin.edges.boundary, fin.edges.non_manifold, fin.edges.inconsistent),
        (2, 1, 0)
    );
    // A crack of one unit in the last place: open, but for rounding.
    let crack = edges(|t| t[0][1].y += f64::EPSILON);
    assert_eq!(crack.edges.boundary, 4);
    assert!(crack.welded_edges.are_closed());
    let gap = edges(|t| t[0][1].y += 1e-5);
    assert_eq!((gap.edges.boundary, gap.welded_edges.boundary), (4, 4));
}

#[test]
fn objects_are_closed_each_on_its_own() {
    // Two cubes side by side, in one object and in two.
    let mut scene = one_sided([cube(DVec3::ZERO, 1.0), cube(DVec3::X, 1.0)].concat());
    assert_eq!(survey_of(scene.clone()).closed_object_count, 0);
    scene.objects = vec!["left".to_owned(), "right".to_owned(), "none".to_owned()];
    for triangle in &mut scene.triangles[12..] {
        triangle.object = 1;
    }
    let survey = survey_of(scene);
    assert_eq!((survey.object_count, survey.closed_object_count), (3, 2));
    assert!(survey.edges.non_manifold > 0);
    assert_eq!(survey.repair.reversed_duplicates, 2);
}

#[test]
fn the_worst_triangles() {
    let sliver = |height: f64| [DVec3::ZERO, DVec3::X, DVec3::new(0.5, height, 0.0)];
    let mut scene = one_sided([1e-3, 0.5, 1e-6, 1e-2, 1e-5, 0.1, 0.2, -1e-6].map(sliver));
    scene.triangles[2].object = 1;
    scene.objects.push("blade".to_owned());
    let worst = survey_of(scene).worst;
    assert_eq!(worst.iter().map(|w| w.face).collect::<Vec<_>>(), [2, 7, 4, 0, 3]);
    assert_eq!((worst[0].object.as_str(), worst[1].object.as_str()), ("blade", "all"));
    assert!((worst[0].aspect - 1e6).abs() < 1.0 && (worst[0].area - 0.5e-6).abs() < 1e-15);
}

#[test]
fn an_empty_scene() {
    let survey = survey_of(Scene::default());
    assert_eq!(
        (survey.bounds, survey.area, survey.area_min, survey.diagonal),
        (None, 0.0, 0.0, 0.0)
    );
    assert!(!survey.edges.are_closed() && survey.worst.is_empty() && survey.unit_hints.is_empty());
}

#[test]
fn up_axis() {
    let ground = |scale: DVec3| one_sided(cube(DVec3::ZERO, 1.0).into_iter().map(move |t| t.map(|p| p * scale)));
    assert_eq!(survey_of(ground(DVec3::new(100.0, 80.0, 10.0))).up, Axis::Z);
    assert_eq!(survey_of(ground(DVec3::new(100.0, 10.0, 80.0))).up, Axis::Y);
    let mut said = ground(DVec3::new(100.0, 80.0, 10.0));
    said.up = Some(Axis::X);
    let survey = survey_of(said);
    assert_eq!(
        (survey.up, survey.up_guessed, survey.up_reason.as_str()),
        (Axis::X, false, "the format says so")
    );
}

#[test]
fn hints_about_units() {
    let hints = |low: f64, edge: f64| survey_of(one_sided(cube(DVec3::splat(low), edge))).unit_hints.join(" ");
    assert_eq!(hints(0.0, 3.0), "");
    assert_eq!(hints(0.0, 9e4), "");
    assert!(hints(0.0, 2.5e5).contains("250000 units across: 1 unit is probably a millimetre, which makes it 250 m"));
    assert!(
        hints(0.0, 1e-4).contains("only 1.000e-4 units across"),
        "{}",
        hints(0.0, 1e-4)
    );
    assert!(
        hints(2.6e6, 10.0).contains("steps of 0.25 (3.5 % of"),
        "{}",
        hints(2.6e6, 10.0)
    );
    assert!(hints(1e12, 10.0).contains("more than all"), "{}", hints(1e12, 10.0));
    let mut metres = one_sided(cube(DVec3::ZERO, 2.5e5));
    metres.metres_per_unit = Some(1.0);
    assert_eq!(
        survey_of(metres).unit_hints.join(" "),
        "",
        "the format says what a unit is"
    );
}

/// Files of which the manifest has other counts, with ours: boundary, non-manifold and inconsistent edges, degenerate
/// triangles, duplicates of either winding.
///
/// The manifest cuts polygons into fans, welds before it looks for degenerate triangles, and calls those degenerate
/// that then have no area or two corners at one place.
#[cfg(feature = "obj")]
const NOT_AS_MANIFEST: [(&str, [u64; 5]); 3] = [
    // A triangle 7.5 · 10⁻⁷ high that welding flattens is kept here: it closes three edges of its neighbours.
    ("city/rotterdam-delfshaven.obj", [16_666, 86, 0, 2, 0]),
    // Ear clipping makes fewer triangles without area, and none that lie on one another.
    ("city/rotterdam-ngons.obj", [16_669, 86, 0, 282, 0]),
    // The repeated corner that makes a triangle of the fan degenerate is left out when the polygon is cut.
    ("obj/tinyobjloader/issue-319-002.obj", [19, 0, 0, 0, 0]),
];

#[cfg(feature = "obj")]
#[test]
fn real_scenes_have_the_edges_of_the_manifest() {
    use std::path::{Path, PathBuf};
    let root = std::env::var_os("HEMICUBE_SCENES").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes"),
        PathBuf::from,
    );
    let Ok(manifest) = std::fs::read_to_string(root.join("manifest.tsv")) else {
        println!("SKIP real_scenes_have_the_edges_of_the_manifest: no ../shared/scenes");
        return;
    };
    let (mut compared, mut complaints) = (0, Vec::new());
    for row in manifest.lines() {
        let columns: Vec<&str> = row.split('\t').collect();
        let file = columns[0];
        if !file.ends_with(".obj") {
            continue;
        }
        let bytes = std::fs::read(root.join(file)).unwrap();
        let Ok(mut scene) = hemicube_scene::obj::read(&bytes, None, hemicube_scene::ReadOptions::default()) else {
            continue;
        };
        // The manifest counts duplicates of either winding and keeps them.
        let report = repair(&mut scene, KEEP);
        let survey = survey(&scene, &report);
        if columns[5].is_empty() {
            continue;
        }
        let edges = survey.welded_edges;
        let ours = [
            edges.boundary as u64,
            edges.non_manifold as u64,
            edges.inconsistent as u64,
            report.degenerate,
            report.duplicates + report.reversed_duplicates,
        ];
        let expected = NOT_AS_MANIFEST.iter().find(|row| row.0 == file).map_or_else(
            || [5, 6, 7, 3, 4].map(|column: usize| columns[column].parse().unwrap()),
            |row| row.1,
        );
        if ours != expected {
            complaints.push(format!("{file}: {ours:?} instead of {expected:?}"));
        }
        if edges.are_closed() != (columns[8] == "True") {
            complaints.push(format!("{file}: closed: {}", edges.are_closed()));
        }
        if survey.edges != survey.welded_edges {
            complaints.push(format!(
                "{file}: exact {:?}, welded {:?}",
                survey.edges, survey.welded_edges
            ));
        }
        compared += 1;
    }
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
    assert!(compared > 50, "{compared}");
}

/// A cube's floor as a polygon that begins at a corner of it, facing up or down, and its first triangle's sides.
fn with_floor(again: &str) -> (Scene, hemicube_scene::repair::RepairReport) {
    let text = format!(
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 0 0\nv 0.3 1 0\no floor\nf 1 2 3 4\no again\nf {again}\no roof\nv 0 0 \
         1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nf -1 -2 -3 -4\n"
    );
    let mut scene = hemicube_scene::obj::read(text.as_bytes(), None, ReadOptions::default()).unwrap();
    let report = repair(&mut scene, RepairOptions::default());
    (scene, report)
}

#[test]
fn a_polygon_written_twice_is_one_whatever_corner_it_begins_at() {
    for again in ["2 3 4 1", "1 5 2 3 6 4", "3 4 1 5 2", "4 1 2 3", "1 2 3 4"] {
        let (scene, report) = with_floor(again);
        assert_eq!(scene.triangles.len(), 4, "{again}: {report:?}");
        let losses: Vec<_> = scene.ledger.losses().collect();
        assert_eq!(losses.len(), 1, "{again}: {}", scene.ledger);
        assert!((losses[0].1.area.unwrap() - 1.0).abs() < 1e-12 && losses[0].0.contains("very place"));
        assert_eq!(losses[0].1.first.as_deref(), Some("`again`, face 1"));
    }
    // Another polygon of the same corners, and one that covers half of it, are none.
    for again in ["1 2 4", "5 3 4 1", "1 2 4 3"] {
        let (scene, _) = with_floor(again);
        assert!(
            scene.ledger.losses().all(|(what, _)| !what.contains("very place")),
            "{again}"
        );
    }
}

#[test]
fn a_polygon_written_back_to_back_is_cut_as_the_first() {
    for again in ["4 3 2 1", "1 4 3 2", "4 6 3 2 5 1"] {
        let (scene, report) = with_floor(again);
        assert_eq!((scene.triangles.len(), report.duplicates), (6, 0), "{again}");
        let triangles = &scene.triangles;
        for (front, back) in triangles[..2].iter().zip(&triangles[2..4]) {
            let corners = |t: &Triangle| {
                let mut corners = t.corners.map(|corner| corner.to_array().map(f64::to_bits));
                corners.sort_unstable();
                corners
            };
            assert!(
                triangles[2..4].iter().any(|other| corners(other) == corners(front)),
                "{again}"
            );
            let normal = |t: &Triangle| (t.corners[1] - t.corners[0]).cross(t.corners[2] - t.corners[0]).z;
            assert!(normal(front) > 0.0 && normal(back) < 0.0);
        }
    }
}

#[test]
fn a_sheet_of_two_sides_takes_the_place_of_both() {
    let mut scene = with_floor("2 3 4 1").0;
    let sheet = scene.triangles[..2].to_vec();
    let [a, b, c, d] = [
        sheet[0].corners[0],
        sheet[0].corners[1],
        sheet[0].corners[2],
        sheet[1].corners[2],
    ];
    let triangle = |corners| Triangle {
        corners,
        face: 9,
        two_sided: true,
        ..sheet[0]
    };
    scene.triangles.extend([triangle([d, c, b]), triangle([d, b, a])]);
    let report = repair(&mut scene, RepairOptions::default());
    assert_eq!((report.duplicate_faces, scene.triangles.len()), (1, 4));
    let sides: Vec<bool> = scene.triangles.iter().map(|triangle| triangle.two_sided).collect();
    assert_eq!(sides, [true, true, false, false]);
}
