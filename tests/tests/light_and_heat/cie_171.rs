//! CIE 171:2006, tests 5.9 to 5.14: daylight at points of a black room of 4 × 4 × 3 m, through an opening in its roof or
//! its south façade, under the 16 skies of ISO 15469, with the sun 60° high in the south and its own light left out. The
//! ground outside reflects 30 %.
//!
//! Each value is compared with an integral over the opening that is this file's own, and with the standard's table where
//! it has one (`tests/golden/cie171.txt`). A number of the table that the integral does not meet is an erratum, and must
//! be one of those that are named here and in docs/dev/yardsticks.md.
//!
//! Points see sun and sky directly alone. Under glass (tests 5.10 and 5.12) a small patch lies at each of them in place
//! of the point, and `solve` lights it by its row of the sky, which is seen through the pane.
//!
//! Masks of tests 5.13 and 5.14 are black, because the standard's say of what they reflect does not lead to its
//! tables; these are held where the opening shows no mask.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

use super::yardsticks::{cie_points, cie_room, level_irradiance, number, opening, pane, seen};
use glam::DVec3;
use hemicube_tests::rooms::{Corner, Quad, place, room};
use hemicube_tests::runs::Place;
use hemicube_tests::scenes::say;
use hemicube_weather::sky::{Cie, Model};
use std::collections::HashMap;
use std::f64::consts::PI;
use std::fmt::Write;

/// Reflectance of the ground outside.
const GROUND: f64 = 0.3;
/// Extinction of 6 mm of glass per metre, as fitted to the tables of test 5.10.
const EXTINCTION: f64 = 7.2;
/// Half of the last digit of a table in per cent.
const LAST_DIGIT: f64 = 5e-3;

/// Points and the directions that they look in.
type Points = Vec<(DVec3, DVec3)>;

/// An opening: a corner, and two edges. The second is upright in a façade.
struct Opening {
    corner: DVec3,
    edges: [DVec3; 2],
}

/// What stands in the opening, or outside before it.
#[derive(Clone, Copy)]
enum Mask {
    None,
    /// 6 mm of clear glass.
    Pane,
    /// At the roof's height, so deep.
    Overhang(f64),
    /// 6 m off, so high.
    Wall(f64),
}

impl Mask {
    /// Returns whether it hides a direction from a point.
    fn hides(self, at: DVec3, direction: DVec3) -> bool {
        match self {
            Self::None | Self::Pane => false,
            Self::Overhang(depth) => {
                let y = at.y + (3.0 - at.z) / direction.z * direction.y;
                direction.z > 0.0 && (-depth..=0.0).contains(&y)
            }
            Self::Wall(height) => {
                let z = at.z + (-6.0 - at.y) / direction.y * direction.z;
                direction.y < 0.0 && (0.0..=height).contains(&z)
            }
        }
    }
}

/// Towards the sun. In test 5.9 the wall of points A to F is the north wall of the standard's own axes.
fn sun(test: &str) -> [f64; 3] {
    let south = if test == "5.9" { 0.5 } else { -0.5 };
    [0.0, south, 0.75_f64.sqrt()]
}

/// A to F down the wall opposite the façade, and G to N along the floor towards it; then G to N along the ceiling.
fn facade_points() -> [Points; 2] {
    let along =
        |height: f64, normal: DVec3| (0..8).map(move |k| (DVec3::new(2.0, 3.75 - 0.5 * f64::from(k), height), normal));
    let wall = (0..6).map(|k| (DVec3::new(2.0, 4.0, 2.75 - 0.5 * f64::from(k)), -DVec3::Y));
    [
        wall.chain(along(0.0, DVec3::Z)).collect(),
        along(3.0, -DVec3::Z).collect(),
    ]
}

fn facade_opening(wide: f64, high: f64) -> Opening {
    Opening {
        corner: DVec3::new(2.0 - wide / 2.0, 0.0, if high < 3.0 { 1.0 } else { 0.0 }),
        edges: [DVec3::X * wide, DVec3::Z * high],
    }
}

/// The room with an opening in the wall at y = 0, and a mask before it or a pane in it.
fn facade_room(opening: &Opening, mask: Mask) -> Place {
    let mut quads: Vec<Quad<'_>> = room(4.0, 4.0, 3.0).into_iter().filter(|quad| quad.0 != "y0").collect();
    let upright = |x: [f64; 2], z: [f64; 2], y: f64| -> [Corner; 4] {
        [[x[0], y, z[0]], [x[0], y, z[1]], [x[1], y, z[1]], [x[1], y, z[0]]]
    };
    let (low, high) = (opening.corner, opening.corner + opening.edges[0] + opening.edges[1]);
    for (x, z) in [
        ([0.0, low.x], [0.0, 3.0]),
        ([high.x, 4.0], [0.0, 3.0]),
        ([low.x, high.x], [0.0, low.z]),
        ([low.x, high.x], [high.z, 3.0]),
    ] {
        if x[0] < x[1] && z[0] < z[1] {
            quads.push(("front", upright(x, z, 0.0)));
        }
    }
    let mut both = |name: &'static str, [a, b, c, d]: [Corner; 4]| {
        quads.push((name, [a, b, c, d]));
        quads.push((name, [a, d, c, b]));
    };
    // Without end, as far as a window shows.
    const FAR: f64 = 400.0;
    match mask {
        Mask::None => {}
        Mask::Pane => both("pane", upright([low.x, high.x], [low.z, high.z], 0.0)),
        Mask::Overhang(depth) => both(
            "mask",
            [
                [-FAR, -depth, 3.0],
                [-FAR, 0.0, 3.0],
                [FAR, 0.0, 3.0],
                [FAR, -depth, 3.0],
            ],
        ),
        Mask::Wall(height) => both("mask", upright([-FAR, FAR], [0.0, height], -6.0)),
    }
    place(
        &quads,
        &format!("[object.pane]\nindex = 1.52\nthickness = 0.006\nextinction = {EXTINCTION}\n"),
    )
}

fn write_points(place: &Place, points: &[(DVec3, DVec3)]) {
    let mut text = String::new();
    for (at, n) in points {
        // A micrometre off the wall.
        let at = *at + *n * 1e-6;
        writeln!(text, "{} {} {} {} {} {}", at.x, at.y, at.z, n.x, n.y, n.z).expect("a string");
    }
    place.write("points.txt", text);
}

/// Writes the 16 skies, of 100 on a level plane in the open.
fn write_skies(place: &Place, sun: [f64; 3], ground: f64) {
    let mut table = String::from("time,x,y,z,direct,diffuse,sky,ground\n");
    for sky in 1..=16 {
        writeln!(table, "{sky},{},{},{},0,100,cie{sky},{ground}", sun[0], sun[1], sun[2]).expect("a string");
    }
    place.write("skies.csv", table);
}

/// Irradiances of the points under each of the 16 skies.
fn under_skies(place: &Place, sun: [f64; 3], ground: f64, points: usize) -> Vec<Vec<f64>> {
    write_skies(place, sun, ground);
    place
        .line(
            "points scene.obj --points points.txt --as plane --up z --tolerance 0.1% --suns skies.csv -o felt.csv \
             --overwrite",
        )
        .is(0);
    let felt = std::fs::read_to_string(place.path("felt.csv")).expect("a table");
    let mut lines = felt.lines();
    let head: Vec<&str> = lines.next().expect("a head").split(',').collect();
    let column = head.iter().position(|head| head.starts_with("irradiance"));
    let column = column.expect("a column");
    let value = |line: &str| line.split(',').nth(column).and_then(|cell| cell.parse().ok());
    let found: Vec<f64> = lines.map(|line| value(line).expect("a number")).collect();
    assert_eq!(found.len(), 16 * points);
    found.chunks(points).map(<[f64]>::to_vec).collect()
}

/// Irradiances under each of the 16 skies of small patches at the points, for a scene with a pane.
fn under_skies_and_glass(place: &Place, sun: [f64; 3], ground: f64, points: &[(DVec3, DVec3)]) -> Vec<Vec<f64>> {
    // Distance from the middle to the corners, and off the wall, in metres: no value changes by 0.1 % over it.
    const SIZE: f64 = 2e-3;
    const OFF: f64 = 2e-4;
    let mut scene = std::fs::read_to_string(place.path("scene.obj")).expect("a scene");
    for (number, &(at, normal)) in points.iter().enumerate() {
        let (u, v) = normal.any_orthonormal_pair();
        writeln!(scene, "o point{number}").expect("a string");
        for corner in 0..3 {
            let (sine, cosine) = (2.0 * PI * f64::from(corner) / 3.0).sin_cos();
            let corner = at + OFF * normal + SIZE * (cosine * u + sine * v);
            writeln!(scene, "v {} {} {}", corner.x, corner.y, corner.z).expect("a string");
        }
        writeln!(scene, "f -3 -2 -1").expect("a string");
    }
    place.write("patches.obj", scene);
    place.write("black.toml", "bands = [\"all\"]\n[default]\nreflectance = 0\n");
    write_skies(place, sun, ground);
    for line in [
        "compute patches.obj --up z -o room --specular optics.toml --correction pixel --resolution 512",
        "sky patches.obj --matrix room --division reinhart:8",
        "solve room --materials black.toml --suns skies.csv -o light.csv",
    ] {
        place.line(line).is(0);
    }
    let light = std::fs::read_to_string(place.path("light.csv")).expect("a table");
    let mut lines = light.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().expect("a head");
    let column = |sky: usize| {
        let name = format!("irradiance_{}", sky + 1);
        head.iter().position(|head| *head == name).expect("a column")
    };
    let columns: Vec<usize> = (0..16).map(column).collect();
    let mut found = vec![vec![f64::NAN; points.len()]; 16];
    for line in lines {
        let Some(point) = line[1].strip_prefix("point") else {
            continue;
        };
        let point: usize = point.parse().expect("a number");
        for (found, &column) in found.iter_mut().zip(&columns) {
            found[point] = line[column].parse().expect("a number");
        }
    }
    found
}

/// ∫ L cos θ dω over an opening, by midpoints of its area; in a façade above and below the horizon by themselves.
fn through(opening: &Opening, at: DVec3, normal: DVec3, radiance: &dyn Fn(DVec3) -> f64) -> f64 {
    const ACROSS: u32 = 100;
    const UP: u32 = 240;
    let [u, v] = opening.edges;
    let horizon = if v.z > 0.0 {
        ((at.z - opening.corner.z) / v.z).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let axis = u.cross(v);
    let mut sum = 0.0;
    for [from, to] in [[0.0, horizon], [horizon, 1.0]] {
        if from >= to {
            continue;
        }
        let mut part = 0.0;
        for row in 0..UP {
            let high = from + (to - from) * (f64::from(row) + 0.5) / f64::from(UP);
            for column in 0..ACROSS {
                let way = opening.corner + u * ((f64::from(column) + 0.5) / f64::from(ACROSS)) + v * high - at;
                let square = way.length_squared();
                let direction = way / square.sqrt();
                let own = direction.dot(normal);
                if own > 0.0 {
                    part += radiance(direction) * own * direction.dot(axis).abs() / square;
                }
            }
        }
        sum += part * (to - from) / f64::from(UP * ACROSS);
    }
    sum
}

/// How many of some values are within 1 %, and the worst.
#[derive(Default)]
struct Score {
    close: u32,
    count: u32,
    worst: (f64, String),
}

impl Score {
    /// Beyond `digit` counts.
    fn add(&mut self, what: &str, found: f64, wanted: f64, digit: f64) {
        let off = match found - wanted {
            off if off.is_nan() => f64::INFINITY,
            off => (off.abs() - digit).max(0.0) / wanted,
        };
        self.count += 1;
        self.close += u32::from(off <= 0.01);
        if off > self.worst.0 {
            self.worst = (off, format!("{what}: {found:.3} for {wanted:.3}"));
        }
    }

    /// 95 % are within 1 %, and all within 3 %.
    fn finish(&self, of: &str) {
        say(&format!(
            "CIE 171, {of}: {} of {} values within 1 %, the worst {:.2} % off, {}",
            self.close,
            self.count,
            100.0 * self.worst.0,
            self.worst.1
        ));
        assert!(
            self.count > 0 && f64::from(self.close) >= 0.95 * f64::from(self.count) && self.worst.0 < 0.03,
            "{of}: {} of {}, {:?}",
            self.close,
            self.count,
            self.worst
        );
    }
}

/// A table's rows, by their names and skies.
fn tables() -> HashMap<(String, u8), Vec<f64>> {
    let text = include_str!("../../golden/cie171.txt");
    let rows = text.lines().filter(|line| !line.starts_with('#')).map(|line| {
        let mut cells = line.split(' ');
        let name = cells.next().expect("a table").to_owned();
        let sky = cells.next().and_then(|sky| sky.parse().ok()).expect("a sky");
        ((name, sky), cells.map(|cell| cell.parse().expect("a number")).collect())
    });
    rows.collect()
}

/// Numbers of the tables that are off: A under the roof of 4 × 4 m (B.3, B.7), G there under sky 13 (B.4 has 42.07 for
/// 47.01), four of the six points opposite the façade of 4 × 3 m (B.12, B.18), N beside it on the floor and the ceiling,
/// all of the floor's sky 14, which is sky 15's line again (B.13), and H behind the pane of 2 × 1 m under sky 15 (B.16
/// has 2.47 for 2.74).
fn is_erratum(table: &str, sky: u8, point: usize) -> bool {
    let name = char::from(b'A' + u8::try_from(point).expect("few points"));
    match table {
        "5.9:4" => name == 'A' || name == 'G' && sky == 13,
        "5.10:4" => name == 'A',
        "5.12:2x1" => name == 'H' && sky == 15,
        "5.11:4x3" => matches!(name, 'A' | 'C' | 'D' | 'F' | 'N') || sky == 14 && name >= 'G',
        "5.12:4x3" => matches!(name, 'A' | 'C' | 'D' | 'F' | 'N'),
        // G to N along the ceiling.
        "5.11:4x3:ceiling" | "5.12:4x3:ceiling" => point == 7,
        _ => false,
    }
}

/// Scores of values against integrals and tables, and the tables' errata.
#[derive(Default)]
struct Held {
    integrals: Score,
    tables: Score,
    errata: u32,
}

impl Held {
    fn hold(&mut self, (table, sky, point): (&str, u8, usize), found: f64, exact: f64, printed: Option<f64>) {
        let what = format!("{table}, sky {sky}, point {point}");
        self.integrals.add(&what, found, exact, 0.0);
        let Some(printed) = printed else { return };
        if (exact - printed).abs() > 0.01 * exact + LAST_DIGIT {
            assert!(
                is_erratum(table, sky, point),
                "{what}: {printed} is printed, the integral is {exact:.3}"
            );
            self.errata += 1;
        } else {
            self.tables.add(&what, found, printed, LAST_DIGIT);
        }
    }

    fn finish(&self, of: &str) {
        self.integrals.finish(&format!("{of}, integrals"));
        if self.tables.count > 0 {
            self.tables.finish(&format!("{of}, tables"));
        }
    }
}

fn skies(sun: [f64; 3]) -> Vec<(u8, Model, f64)> {
    let sky = |number: u8| {
        let model = Model::Cie(Cie::new(number).expect("a sky"));
        let level = level_irradiance(&model, sun);
        (number, model, level)
    };
    (1..=16).map(sky).collect()
}

/// A room's points under the 16 skies, against integrals and the table of this name; `first` is the first point's place
/// in the table.
fn hold(held: &mut Held, name: &str, place: &Place, (opening, mask): (&Opening, Mask), points: &[(DVec3, DVec3)]) {
    let printed = tables();
    let is_roof = opening.edges[1].z == 0.0;
    let (sun, ground) = (
        sun(if is_roof { "5.9" } else { "" }),
        if is_roof { 0.0 } else { GROUND },
    );
    let is_glazed = matches!(mask, Mask::Pane);
    let found = if is_glazed {
        under_skies_and_glass(place, sun, ground, points)
    } else {
        write_points(place, points);
        under_skies(place, sun, ground, points.len())
    };
    let axis = opening.edges[0].cross(opening.edges[1]).normalize();
    for (sky, model, level) in skies(sun) {
        let row = printed.get(&(name.to_owned(), sky));
        for (point, &(at, normal)) in points.iter().enumerate() {
            let radiance = |direction: DVec3| {
                let passed = match mask {
                    Mask::Pane => pane(direction.dot(axis).abs(), EXTINCTION),
                    _ => f64::from(u8::from(!mask.hides(at, direction))),
                };
                if direction.z > 0.0 {
                    passed * 100.0 / level * model.relative(direction.to_array(), Some(sun))
                } else {
                    passed * 100.0 * ground / PI
                }
            };
            let exact = through(opening, at, normal, &radiance);
            let found = found[usize::from(sky - 1)][point];
            held.hold((name, sky, point), found, exact, row.map(|row| row[point]));
        }
    }
}

/// A roof with openings of 1 × 1 and 4 × 4 m; a test's number.
fn roofs(test: &str, mask: Mask) -> Held {
    let mut held = Held::default();
    for width in [1.0, 4.0] {
        let points: Points = cie_points().into_iter().map(|(_, at, normal)| (at, normal)).collect();
        let [a, b, _, d] = opening(width);
        let opening = Opening {
            corner: a,
            edges: [d - a, b - a],
        };
        let place = cie_room(width, matches!(mask, Mask::Pane));
        let name = format!("{test}:{width}");
        hold(&mut held, &name, &place, (&opening, mask), &points);
    }
    held.finish(&format!("test {test}"));
    held
}

/// Test 5.9: 448 values, of which the table has fifteen wrong.
#[test]
#[ignore = "the other tables of the same series: ./test --full"]
fn an_open_roof_under_the_sixteen_skies() {
    assert_eq!(roofs("5.9", Mask::None).errata, 15);
}

/// Test 5.10: 448 values, of which the table has fourteen wrong: A under the roof of 4 × 4 m.
#[test]
fn a_glazed_roof_under_the_sixteen_skies() {
    assert_eq!(roofs("5.10", Mask::Pane).errata, 14);
}

/// Test 5.11: 448 values at wall and floor; and 16 at the ceiling, which sees the ground alone.
#[test]
fn an_open_facade_under_the_sixteen_skies() {
    let mut held = Held::default();
    let [points, ceiling] = facade_points();
    for (name, wide, high) in [("5.11:2x1", 2.0, 1.0), ("5.11:4x3", 4.0, 3.0)] {
        let opening = facade_opening(wide, high);
        let place = facade_room(&opening, Mask::None);
        hold(&mut held, name, &place, (&opening, Mask::None), &points);
        write_points(&place, &ceiling);
        let found = &under_skies(&place, sun(""), GROUND, ceiling.len())[4];
        let name = format!("{name}:ceiling");
        let printed = &tables()[&(name.clone(), 5)];
        for (point, &(at, normal)) in ceiling.iter().enumerate() {
            let exact = through(&opening, at, normal, &|_| 100.0 * GROUND / PI);
            held.hold((&name, 5, point), found[point], exact, Some(printed[point]));
        }
    }
    held.finish("test 5.11");
    assert_eq!(held.errata, 60);
}

/// Test 5.12: 448 values at wall and floor.
#[test]
#[ignore = "the other tables of the same series: ./test --full"]
fn a_glazed_facade_under_the_sixteen_skies() {
    let mut held = Held::default();
    let [points, _] = facade_points();
    for (name, wide, high) in [("5.12:2x1", 2.0, 1.0), ("5.12:4x3", 4.0, 3.0)] {
        let opening = facade_opening(wide, high);
        let place = facade_room(&opening, Mask::Pane);
        hold(&mut held, name, &place, (&opening, Mask::Pane), &points);
    }
    held.finish("test 5.12, all skies");
    assert_eq!(held.errata, 53);
}

/// Test 5.12 under the even sky, and its ceiling: what points see of sky and ground through the pane.
#[test]
fn a_glazed_facade_under_the_even_sky() {
    let mut held = Held::default();
    for (name, wide, high) in [("5.12:2x1", 2.0, 1.0), ("5.12:4x3", 4.0, 3.0)] {
        let opening = facade_opening(wide, high);
        let place = facade_room(&opening, Mask::Pane);
        for (name, points) in [name.to_owned(), format!("{name}:ceiling")]
            .into_iter()
            .zip(facade_points())
        {
            write_points(&place, &points);
            let rows = seen(&place, "--specular optics.toml");
            let printed = &tables()[&(name.clone(), 5)];
            for (point, &(at, normal)) in points.iter().enumerate() {
                let radiance = |direction: DVec3| {
                    let sent = if direction.z > 0.0 { 100.0 } else { 100.0 * GROUND };
                    sent / PI * pane(direction.y.abs(), EXTINCTION)
                };
                let exact = through(&opening, at, normal, &radiance);
                let found = 100.0 * (number(&rows[point]["sky"]) + GROUND * number(&rows[point]["ground"]));
                held.hold((&name, 5, point), found, exact, Some(printed[point]));
            }
        }
    }
    held.finish("test 5.12");
    assert_eq!(held.errata, 6);
}

/// Tests 5.13 and 5.14: floor points behind an overhang, and behind a wall outside, both black. Points that see no mask
/// have the numbers of the tables of test 5.11.
#[test]
#[ignore = "the other tables of the same series: ./test --full"]
fn masks_before_a_facade_under_the_sixteen_skies() {
    let mut held = Held::default();
    let [points, _] = facade_points();
    let opening = facade_opening(2.0, 1.0);
    let masks = [0.5, 1.0, 2.0].map(Mask::Overhang).into_iter();
    let masks = masks.chain([3.0, 6.0, 9.0].map(Mask::Wall));
    let mut shaded = 0;
    for mask in masks {
        let place = facade_room(&opening, mask);
        // Those that see any of the sky and the ground.
        let open = |&(at, normal): &(DVec3, DVec3)| {
            let lit = |direction: DVec3| f64::from(u8::from(!mask.hides(at, direction)));
            through(&opening, at, normal, &lit) / through(&opening, at, normal, &|_| 1.0)
        };
        let lit: Points = points[6..].iter().copied().filter(|point| open(point) > 0.02).collect();
        shaded += points[6..].iter().filter(|point| open(point) < 0.98).count();
        let name = match mask {
            Mask::Overhang(_) => "5.13",
            _ => "5.14",
        };
        hold(&mut held, name, &place, (&opening, mask), &lit);
    }
    held.finish("tests 5.13 and 5.14");
    // Masks hide something of most points.
    assert!(shaded >= 15, "{shaded}");
}

/// A value 4 % off fails, and so do too many at 2 %, none at all, and a table's number that no erratum explains.
#[test]
fn what_is_off_is_told() {
    let fails = |values: &[f64]| {
        let mut score = Score::default();
        values.iter().for_each(|&value| score.add("a point", value, 1.0, 0.0));
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| score.finish("a test"))).is_err()
    };
    assert!(!fails(&[1.009; 20]) && !fails(&[[1.0; 19].as_slice(), &[1.02]].concat()));
    assert!(fails(&[[1.0; 19].as_slice(), &[1.04]].concat()) && fails(&[[1.0; 18].as_slice(), &[1.02; 2]].concat()));
    assert!(fails(&[]) && fails(&[f64::NAN]));
    let unexplained = || Held::default().hold(("5.9:1", 1, 0), 1.0, 1.0, Some(1.1));
    assert!(std::panic::catch_unwind(unexplained).is_err());
}
