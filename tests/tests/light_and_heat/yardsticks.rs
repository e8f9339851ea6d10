//! Tables that others published: CIE 171, Clausing's tubes, Abaqus' rectangles and symmetries, FDS' box. Their geometry
//! and errata are in docs/dev/yardsticks.md.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

use glam::DVec3;
use hemicube::InputPatch;
use hemicube_scene::{Subdivision, Triangle};
use hemicube_tests::geometry::{circle, parallel_rectangles, point_to_polygon, quad, scene_of};
use hemicube_tests::promise::Tally;
use hemicube_tests::rooms::{Corner, Quad, obj, of, place, room, zones};
use hemicube_tests::rows::{Rung, factors};
use hemicube_tests::runs::Place;
use hemicube_tests::scenes::{model_as_it_is, say};
use serde_json::Value;
use std::f64::consts::PI;
use std::fmt::Write;

/// Points of tests 5.9 to 5.14: A to F down the south wall, G to N along the floor.
pub(super) fn cie_points() -> Vec<(char, DVec3, DVec3)> {
    let wall = (0..6).map(|k| (DVec3::new(2.0, 0.0, 2.75 - 0.5 * f64::from(k)), DVec3::Y));
    let floor = (0..8).map(|k| (DVec3::new(2.0, 0.25 + 0.5 * f64::from(k), 0.0), DVec3::Z));
    ('A'..='N')
        .zip(wall.chain(floor))
        .map(|(name, (at, normal))| (name, at, normal))
        .collect()
}

/// The roof's opening of so many metres.
pub(super) fn opening(width: f64) -> [DVec3; 4] {
    let (low, high) = (2.0 - width / 2.0, 2.0 + width / 2.0);
    [(low, low), (low, high), (high, high), (high, low)].map(|(x, y)| DVec3::new(x, y, 3.0))
}

/// The black room of 4 × 4 × 3 m under a roof with an opening; with `glass`, a pane in it.
pub(super) fn cie_room(width: f64, glass: bool) -> Place {
    let mut quads: Vec<Quad<'_>> = room(4.0, 4.0, 3.0).into_iter().filter(|quad| quad.0 != "top").collect();
    let (low, high) = (2.0 - width / 2.0, 2.0 + width / 2.0);
    let flat = |x: [f64; 2], y: [f64; 2]| -> [Corner; 4] {
        [
            [x[0], y[0], 3.0],
            [x[0], y[1], 3.0],
            [x[1], y[1], 3.0],
            [x[1], y[0], 3.0],
        ]
    };
    if width < 4.0 {
        quads.push(("roof", flat([0.0, low], [0.0, 4.0])));
        quads.push(("roof", flat([high, 4.0], [0.0, 4.0])));
        quads.push(("roof", flat([low, high], [0.0, low])));
        quads.push(("roof", flat([low, high], [high, 4.0])));
    }
    if glass {
        let [a, b, c, d] = flat([low, high], [low, high]);
        quads.push(("pane", [a, b, c, d]));
        quads.push(("pane", [a, d, c, b]));
    }
    let place = place(
        &quads,
        "[object.pane]\nindex = 1.52\nthickness = 0.006\nextinction = 7.2\n",
    );
    let mut points = String::new();
    for (_, at, n) in cie_points() {
        // A micrometre off the wall.
        let at = at + n * 1e-6;
        writeln!(points, "{} {} {} {} {} {}", at.x, at.y, at.z, n.x, n.y, n.z).expect("a string");
    }
    place.write("points.txt", points);
    place
}

/// Runs `points` and reads its rows.
pub(super) fn seen(place: &Place, more: &str) -> Vec<Value> {
    place
        .line(&format!(
            "points scene.obj --points points.txt --as plane --up z --tolerance 0.1% -o rows.json --overwrite {more}"
        ))
        .is(0);
    let text = std::fs::read_to_string(place.path("rows.json")).expect("the rows");
    let rows: Value = serde_json::from_str(&text).expect("JSON");
    rows["rows"].as_array().expect("rows").clone()
}

pub(super) fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// Half of the last digit of a table in per cent.
const LAST_DIGIT: f64 = 5e-5;

/// Holds a table of test 5.9 or 5.10 in per cent, A to J; K to N are J to G again. `errata` are the table's own.
fn hold_cie(name: &str, found: &[f64], exact: &[f64], table: [f64; 10], errata: &[char], share: f64) {
    let mut tally = Tally::default();
    let whole = table.iter().chain(table[6..].iter().rev());
    for (((point, ..), (&found, &exact)), &printed) in cie_points().iter().zip(found.iter().zip(exact)).zip(whole) {
        let printed = printed / 100.0;
        tally.hold(|| format!("{point}, closed form"), found, exact, 1e-3 * exact + 1e-5);
        if errata.contains(point) {
            let off = (printed - exact).abs();
            assert!(
                off > LAST_DIGIT + share * printed,
                "{name} {point} is no erratum: {printed}, {exact}"
            );
        } else {
            tally.hold(
                || format!("{point}, table"),
                found,
                printed,
                LAST_DIGIT + share * printed,
            );
        }
    }
    tally.finish(name);
}

/// CIE 171:2006, test 5.9, sky type 5 (uniform). The tables' A and B under the roof of 4 × 4 are 46.74 and 36.05, where
/// the closed form has 45.123 and 35.901.
#[test]
fn cie_171_daylight_through_an_open_roof() {
    let small = [1.04, 2.39, 2.59, 2.20, 1.70, 1.27, 1.95, 2.52, 3.04, 3.37];
    let large = [46.74, 36.05, 28.05, 21.67, 16.73, 12.98, 26.80, 30.95, 33.99, 35.58];
    for (width, table, errata) in [(1.0, small, &[][..]), (4.0, large, &['A', 'B'])] {
        let found: Vec<f64> = seen(&cie_room(width, false), "")
            .iter()
            .map(|row| number(&row["sky"]))
            .collect();
        let exact: Vec<f64> = cie_points()
            .iter()
            .map(|(_, at, n)| point_to_polygon(*at, *n, &opening(width)))
            .collect();
        hold_cie(
            &format!("CIE 171 5.9, {width} m"),
            &found,
            &exact,
            table,
            errata,
            2.5e-3,
        );
    }
}

/// The transmittance of a pane of 6 mm of index 1.52 (Duffie & Beckman 2013, § 5.1 to 5.3).
pub(super) fn pane(cosine: f64, extinction: f64) -> f64 {
    let inside = (1.0 - (1.0 - cosine * cosine) / (1.52 * 1.52)).sqrt();
    let absorbed = (-extinction * 0.006 / inside).exp();
    let through = |r: f64| absorbed * (1.0 - r) * (1.0 - r) / (1.0 - (r * absorbed).powi(2));
    let across = ((cosine - 1.52 * inside) / (cosine + 1.52 * inside)).powi(2);
    let along = ((1.52 * cosine - inside) / (1.52 * cosine + inside)).powi(2);
    0.5 * (through(across) + through(along))
}

/// What a point sees of the sky through the opening with a pane, by midpoints.
fn through_pane(at: DVec3, normal: DVec3, width: f64, extinction: f64) -> f64 {
    const PIECES: u32 = 1000;
    let low = 2.0 - width / 2.0;
    let step = width / f64::from(PIECES);
    let place = |k: u32| low + (f64::from(k) + 0.5) * step;
    let mut sum = 0.0;
    for (i, j) in (0..PIECES).flat_map(|i| (0..PIECES).map(move |j| (i, j))) {
        let way = DVec3::new(place(i), place(j), 3.0) - at;
        let distance = way.length();
        let (own, cosine) = (normal.dot(way) / distance, way.z / distance);
        if own > 0.0 {
            sum += own * cosine / (PI * distance * distance) * pane(cosine, extinction) * step * step;
        }
    }
    sum
}

/// CIE 171:2006, test 5.10, sky type 5. Its 6 mm of glass absorb: an extinction of 7.2 /m is fitted to the tables, which
/// do not say theirs; without any, they are 4 to 7 % low. A under the roof of 4 × 4 is off as in test 5.9.
#[test]
fn cie_171_daylight_through_a_glazed_roof() {
    let small = [0.35, 1.69, 2.12, 1.87, 1.47, 1.11, 1.71, 2.22, 2.68, 2.96];
    let large = [32.66, 27.87, 22.92, 18.23, 14.31, 11.20, 23.43, 27.12, 29.83, 31.25];
    for (width, table, errata) in [(1.0, small, &[][..]), (4.0, large, &['A'])] {
        let rows = seen(&cie_room(width, true), "--specular optics.toml");
        let found: Vec<f64> = rows.iter().map(|row| number(&row["sky"])).collect();
        let of = |extinction: f64| -> Vec<f64> {
            let each = |(_, at, n): &(char, DVec3, DVec3)| through_pane(*at, *n, width, extinction);
            cie_points().iter().map(each).collect()
        };
        hold_cie(
            &format!("CIE 171 5.10, {width} m"),
            &found,
            &of(7.2),
            table,
            errata,
            7e-3,
        );
        let clear = of(0.0);
        for (k, printed) in table.iter().enumerate().skip(1) {
            let off = clear[k] / (printed / 100.0) - 1.0;
            assert!((0.02..0.08).contains(&off), "without extinction, {k}: {off}");
        }
    }
}

/// The share of what enters a tube at one end that leaves it at the other, with diffuse walls of reflectance 1: t of
/// walls is F to the outlet and F to walls of their t. Facets touch the circle from outside: twice the section over
/// the girth is then the radius, as in the circle.
fn transmission(ratio: u32, facets: u32, rings: u32) -> f64 {
    let (length, rim) = (f64::from(ratio), |z: f64| {
        circle(facets, 1.0 / (PI / f64::from(facets)).cos(), z)
    });
    let mut triangles = Vec::new();
    for ring in 0..rings {
        let at = |k: u32| length * f64::from(k) / f64::from(rings);
        let (low, high) = (rim(at(ring)), rim(at(ring + 1)));
        for k in 0..facets as usize {
            let next = (k + 1) % facets as usize;
            // Seen from within.
            triangles.extend(quad([low[k], high[k], high[next], low[next]]));
        }
    }
    let walls = triangles.len();
    let (inlet, outlet) = (rim(0.0), rim(length));
    for k in 0..facets as usize {
        let next = (k + 1) % facets as usize;
        triangles.push([DVec3::ZERO, inlet[k], inlet[next]]);
    }
    let ends = triangles.len();
    for k in 0..facets as usize {
        let next = (k + 1) % facets as usize;
        triangles.push([DVec3::Z * length, outlet[next], outlet[k]]);
    }
    let scene = scene_of(triangles);
    let facing = |t: &Triangle| {
        let [a, b, c] = t.corners;
        (b - a).cross(c - a).dot(DVec3::Z * length / 2.0 - a) > 0.0
    };
    assert!(scene.triangles.iter().all(facing), "all look inside");
    let model = model_as_it_is(&scene, Subdivision::None);
    let matrix = factors(&model, Rung::tolerance(1e-3)).expect("a backend that keeps its contract");
    let mut through = vec![0.0; matrix.rows.len()];
    through[ends..].iter_mut().for_each(|t| *t = 1.0);
    let of =
        |row: usize, through: &[f64]| -> f64 { matrix.rows[row].iter().map(|&(c, f)| f * through[c as usize]).sum() };
    // Gauss–Seidel: each sweep loses what leaves by the ends.
    for _ in 0..10_000 {
        let mut change = 0.0_f64;
        for row in 0..walls {
            let new = of(row, &through);
            change = change.max((new - through[row]).abs());
            through[row] = new;
        }
        if change < 1e-9 {
            break;
        }
    }
    let area = |row: usize| {
        model
            .patches()
            .area(InputPatch(u32::try_from(row).expect("few patches")))
    };
    let sum: f64 = (walls..ends).map(|row| area(row) * of(row, &through)).sum();
    sum / (walls..ends).map(area).sum::<f64>()
}

/// Clausing 1932; to eleven digits by Li, Chen, Zhang & Jousten, Vacuum 97 (2013). That t is one number a
/// triangle, and the circle a polygon, leaves an error in proportion to the square of their size, which two sizes take
/// off (Richardson 1911).
#[test]
fn clausings_tubes() {
    hold_tubes(&[(1, 6, 0.671_984), (2, 8, 0.514_231)]);
}

#[test]
#[ignore = "1,800 patches that see each other: ./test --full"]
fn clausings_longest_tube() {
    hold_tubes(&[(5, 14, 0.310_525)]);
}

/// Tubes by L/R, with their rings of patches and Clausing's value.
fn hold_tubes(tubes: &[(u32, u32, f64)]) {
    let mut tally = Tally::default();
    for &(ratio, rings, exact) in tubes {
        let [coarse, fine] = [1, 2].map(|finer| transmission(ratio, 16 * finer, rings * finer));
        let found = (4.0 * fine - coarse) / 3.0;
        say(&format!(
            "L/R {ratio}: {found:.6}, exact {exact}, coarse {coarse:.6}, fine {fine:.6}"
        ));
        assert!((fine - exact).abs() < 0.5 * (coarse - exact).abs(), "it converges");
        tally.hold(|| format!("L/R {ratio}"), found, exact, 2e-4 * exact);
    }
    tally.finish("Clausing's tubes");
}

/// Abaqus Benchmarks 1.6.7: rectangles of 5 × 8 opposite each other; its own answers are up to 11 % off. The table's
/// four digits are those of the closed form.
#[test]
fn abaqus_rectangles() {
    let mut tally = Tally::default();
    for (c, printed) in [
        (1.0, 0.7374),
        (3.0, 0.4237),
        (6.0, 0.2090),
        (10.0, 0.1001),
        (15.0, 0.0502),
        (25.0, 0.0195),
        (35.0, 0.0102),
        (40.0, 0.0078),
    ] {
        let exact = parallel_rectangles(5.0, 8.0, c);
        assert!((exact - printed).abs() <= 5e-5, "{exact} {printed}");
        let floor = [[0., 0., 0.], [5., 0., 0.], [5., 8., 0.], [0., 8., 0.]];
        let roof = [[0., 0., c], [0., 8., c], [5., 8., c], [5., 0., c]];
        let place = place(&[("floor", floor), ("roof", roof)], "");
        place.line("compute scene.obj -o store --tolerance 0.1% --quiet").is(0);
        let zones = zones(&place, "store");
        for (from, to) in [("floor", "roof"), ("roof", "floor")] {
            tally.hold(
                || format!("{from}, c = {c}"),
                of(&zones, from, to),
                printed,
                5e-5 + 1e-3 * printed,
            );
        }
    }
    tally.finish("Abaqus' rectangles");
}

/// A bar of width 1 in a square tube of width 2, both without end, as Abaqus Verification 5.1.18 models its tube: whole,
/// half, a quarter by two planes, a quarter by a sector, and one cell of each along the tube. F between faces of bar and
/// tube are those of crossed strings (Hottel 1954).
#[test]
fn abaqus_symmetries() {
    // Walls look inwards, the bar outwards; from −1 to 1 across, one metre along y.
    let upright = |name: &'static str, a: [f64; 2], b: [f64; 2]| -> Quad<'static> {
        (
            name,
            [[a[0], 0., a[1]], [a[0], 1., a[1]], [b[0], 1., b[1]], [b[0], 0., b[1]]],
        )
    };
    let whole = || {
        vec![
            upright("outer", [1., -1.], [-1., -1.]),
            upright("outer", [-1., -1.], [-1., 1.]),
            upright("outer", [-1., 1.], [1., 1.]),
            upright("outer", [1., 1.], [1., -1.]),
            upright("inner", [-0.5, -0.5], [0.5, -0.5]),
            upright("inner", [-0.5, 0.5], [-0.5, -0.5]),
            upright("inner", [0.5, 0.5], [-0.5, 0.5]),
            upright("inner", [0.5, -0.5], [0.5, 0.5]),
        ]
    };
    let half = vec![
        upright("outer", [1., -1.], [0., -1.]),
        upright("outer", [0., 1.], [1., 1.]),
        upright("outer", [1., 1.], [1., -1.]),
        upright("inner", [0., -0.5], [0.5, -0.5]),
        upright("inner", [0.5, 0.5], [0., 0.5]),
        upright("inner", [0.5, -0.5], [0.5, 0.5]),
    ];
    let quarter = || {
        vec![
            upright("outer", [0., 1.], [1., 1.]),
            upright("outer", [1., 1.], [1., 0.]),
            upright("inner", [0.5, 0.5], [0., 0.5]),
            upright("inner", [0.5, 0.], [0.5, 0.5]),
        ]
    };
    let mut tally = Tally::default();
    for (name, quads, portals) in [
        ("whole", whole(), ""),
        ("half", half, "--symmetry x=0"),
        ("quarter", quarter(), "--symmetry x=0,z=0"),
        ("sector", quarter(), "--sector y,4"),
    ] {
        let place = Place::new();
        place.write("scene.obj", obj(&quads));
        place
            .line(&format!(
                "compute scene.obj -o store --split 4 --tolerance 0.1% --periodic y=0..1 {portals} --quiet"
            ))
            .is(0);
        let zones = zones(&place, "store");
        for (from, to, exact) in [
            ("inner", "outer", 1.0),
            ("outer", "inner", 0.5),
            ("outer", "outer", 0.5),
        ] {
            tally.hold(|| format!("{name}: {from} to {to}"), of(&zones, from, to), exact, 2e-3);
        }
    }
    tally.finish("Abaqus' symmetries");
}

/// FDS Verification Guide, radiation_box: from points of a cube's face to the opposite face, along its diagonal.
#[test]
fn fds_box() {
    let printed = [0.146, 0.160, 0.175, 0.189, 0.202, 0.213, 0.223, 0.231, 0.236, 0.239];
    let place = place(&room(1.0, 1.0, 1.0), "");
    let at: Vec<f64> = (0..20).map(|k| 0.025 + 0.05 * f64::from(k)).collect();
    let points: String = at.iter().map(|t| format!("{} {t} {t} -1 0 0\n", 1.0 - 1e-6)).collect();
    place.write("points.txt", points);
    let rows = seen(&place, "");
    let mut tally = Tally::default();
    for (k, row) in rows.iter().enumerate() {
        let found = number(&row["view_factors"]["x0"]);
        let exact = point_to_polygon(
            DVec3::new(1.0, at[k], at[k]),
            -DVec3::X,
            &[(0., 0.), (0., 1.), (1., 1.), (1., 0.)].map(|(y, z)| DVec3::new(0.0, y, z)),
        );
        tally.hold(|| format!("{k}, table"), found, printed[k.min(19 - k)], 5e-4 + 2e-4);
        tally.hold(|| format!("{k}, closed form"), found, exact, 1e-3 * exact);
    }
    tally.finish("FDS' box");
}

/// A value off by its bound and a tenth fails.
#[test]
fn a_table_that_is_not_met_is_told() {
    let wrong = |found: f64| {
        std::panic::catch_unwind(|| {
            let mut tally = Tally::default();
            tally.hold(|| "a point".to_owned(), found, 0.1, 1e-3);
            tally.finish("a table");
        })
        .is_err()
    };
    assert!(!wrong(0.1009) && wrong(0.1011) && wrong(f64::NAN));
}

/// Ingersoll, Svitek & Murray (Icarus 100, 1992): in a spherical bowl of depth d and diameter D = 5 d, under a sun 15°
/// high, all of the shadow has one temperature: 155.513 K for a reflectance of 0.3 and an emissivity of 0.95.
#[test]
fn the_shadow_of_a_crater_has_the_temperature_of_ingersoll() {
    const RINGS: u32 = 14;
    const SECTORS: u32 = 48;
    let (depth, diameter) = (1.0, 5.0);
    let radius = (0.25 * diameter * diameter + depth * depth) / (2.0 * depth);
    let middle = DVec3::new(0.0, 0.0, radius - depth);
    // A polygon in place of each circle, of its area: the temperature follows from the areas of opening and bowl.
    let turn = 2.0 * PI / f64::from(SECTORS);
    let widened = (turn / turn.sin()).sqrt();
    // Rings of one area: heights are evenly apart.
    let corner = |ring: u32, sector: u32| {
        let z = -depth + depth * f64::from(ring) / f64::from(RINGS);
        let across = widened * (radius * radius - (z - middle.z).powi(2)).max(0.0).sqrt();
        let (sine, cosine) = (turn * f64::from(sector % SECTORS)).sin_cos();
        DVec3::new(across * cosine, across * sine, z)
    };
    let mut text = String::from("o bowl\n");
    let mut count = 0;
    let mut face = |corners: &[DVec3]| {
        for at in corners {
            writeln!(text, "v {} {} {}", at.x, at.y, at.z).expect("a string");
        }
        let numbers: Vec<String> = (1..=corners.len()).map(|k| (count + k).to_string()).collect();
        count += corners.len();
        writeln!(text, "f {}", numbers.join(" ")).expect("a string");
    };
    for sector in 0..SECTORS {
        face(&[corner(0, 0), corner(1, sector), corner(1, sector + 1)]);
        for ring in 1..RINGS {
            let [a, b] = [corner(ring, sector), corner(ring + 1, sector)];
            let [c, d] = [corner(ring + 1, sector + 1), corner(ring, sector + 1)];
            face(&[a, b, c]);
            face(&[a, c, d]);
        }
    }
    let place = Place::new();
    place.write("bowl.obj", text);
    let elevation = 15f64.to_radians();
    let sun = DVec3::new(elevation.cos(), 0.0, elevation.sin());
    place.write("sun.csv", format!("x,y,z,direct\n{},{},{},1000\n", sun.x, sun.y, sun.z));
    place.write(
        "m.toml",
        "[default]\nabsorptance = 0.7\nemissivity = 0.95\nadiabatic = true\n",
    );
    place.line("compute bowl.obj -o bowl --tolerance 0.3%").is(0);
    place
        .line("solve bowl --thermal --materials m.toml --suns sun.csv --sky-temperature 0 -o heat.csv")
        .is(0);
    let found = std::fs::read_to_string(place.path("heat.csv")).expect("a table");
    let head: Vec<&str> = found.lines().next().expect("a head").split(',').collect();
    let column = |name: &str| {
        let is = |head: &&str| head.split('_').next() == Some(name);
        head.iter().position(is).expect("a column")
    };
    let columns = ["area", "temperature", "x", "y", "z"].map(column);
    let (mut sum, mut area, mut off) = (0.0, 0.0, 0.0f64);
    for line in found.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let [of_patch, kelvin, x, y, z] = columns.map(|at| cells[at].parse::<f64>().expect("a number"));
        let from = DVec3::new(x, y, z) - middle;
        // Where the ray to the sun meets the sphere again: well below the rim, all of the patch is in shadow.
        let met = from - 2.0 * from.dot(sun) * sun;
        if met.z + middle.z < -0.1 * depth {
            sum += of_patch * kelvin;
            area += of_patch;
            off = off.max((kelvin - 155.513).abs());
        }
    }
    let mean = sum / area;
    say(&format!(
        "Ingersoll's crater: {mean:.3} K in its shadow for 155.513, at most {off:.2} K off"
    ));
    // A patch that the sun touches would be warmer by more than that.
    assert!(
        area > 1.0 && (mean - 155.513).abs() < 0.05 && off < 5.0,
        "{mean} on {area} m², {off}"
    );
}

/// ∫ L sin γ dω over the sky, by midpoints.
pub(super) fn level_irradiance(model: &hemicube_weather::sky::Model, sun: [f64; 3]) -> f64 {
    const N: u32 = 240;
    let mut sum = 0.0;
    for ring in 0..N {
        // Heights evenly apart have equal solid angles.
        let z = (f64::from(ring) + 0.5) / f64::from(N);
        let across = (1.0 - z * z).sqrt();
        for sector in 0..2 * N {
            let (sine, cosine) = (PI * (f64::from(sector) + 0.5) / f64::from(N)).sin_cos();
            sum += z * model.relative([across * sine, across * cosine, z], Some(sun));
        }
    }
    sum * 2.0 * PI / f64::from(2 * N * N)
}
