//! One room from every format that brings groups: the same matrix. Files with the same triangles in the same order have
//! the same bytes of it; those with faces from other corners on, or in other orders, the same areas and form factors
//! by object.

use hemicube_tests::runs::Place;
use hemicube_tests::scenes::workspace;
use std::collections::BTreeMap;

/// Areas, and form factors and losses times areas, by the names of objects without the numbers at their ends.
#[derive(Debug, Default, PartialEq)]
struct Zones {
    areas: BTreeMap<String, f64>,
    exchange: BTreeMap<(String, String), f64>,
    /// The escaped and the blocked share.
    lost: BTreeMap<String, f64>,
}

fn group(name: &str) -> String {
    name.trim_end_matches(|c: char| c == ' ' || c.is_ascii_digit())
        .to_owned()
}

/// Computes a file of the room, changed before, and returns its matrix and its zones.
fn room(place: &Place, name: &str, change: [&str; 2]) -> (Vec<u8>, Zones) {
    let from = workspace().join("crates/scene/tests/meshes").join(name);
    let mut bytes = std::fs::read(from).expect("a file");
    if change[0] != change[1] {
        bytes = String::from_utf8(bytes)
            .expect("text")
            .replace(change[0], change[1])
            .into_bytes();
    }
    std::fs::write(place.path(name), bytes).expect("a file");
    place
        .line(&format!("compute {name} -o m --overwrite --up z --tolerance 0.1% -q"))
        .is(0);
    place.line("export m -o m.mtx --overwrite").is(0);
    place.line("export m -o m.csv --by object --overwrite").is(0);
    let text = std::fs::read_to_string(place.path("m.csv")).expect("a table");
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = lines.next().expect("a header");
    assert_eq!(header[..3], ["zone", "patches", "area"], "{name}");
    let mut zones = Zones::default();
    for line in lines {
        let number = |at: usize| line[at].parse::<f64>().expect("a number");
        let (from, area) = (group(line[0]), number(2));
        *zones.areas.entry(from.clone()).or_default() += area;
        *zones.lost.entry(from.clone()).or_default() += area * (number(3) + number(4));
        for (at, to) in header.iter().enumerate().skip(6) {
            *zones.exchange.entry((from.clone(), group(to))).or_default() += area * number(at);
        }
    }
    (std::fs::read(place.path("m.mtx")).expect("a matrix"), zones)
}

/// The largest difference of areas, and of form factors.
fn difference(found: &Zones, expected: &Zones) -> (f64, f64) {
    assert_eq!(
        found.areas.keys().collect::<Vec<_>>(),
        expected.areas.keys().collect::<Vec<_>>()
    );
    let areas = expected
        .areas
        .iter()
        .map(|(name, area)| (found.areas[name] - area).abs());
    let factors = expected.exchange.iter().map(|(pair, exchange)| {
        let area = expected.areas[&pair.0];
        (found.exchange[pair] - exchange).abs() / area
    });
    (areas.fold(0.0, f64::max), factors.fold(0.0, f64::max))
}

#[test]
fn every_format_has_the_same_matrix_of_the_room() {
    let place = Place::new();
    let (matrix, zones) = room(&place, "room.obj", [""; 2]);
    assert_eq!(
        zones.areas.keys().collect::<Vec<_>>(),
        ["ceiling", "floor", "tent", "walls"]
    );
    assert!((zones.areas["floor"] - 12.0).abs() < 1e-12);
    // The tent has no floor, and blocks what comes from beneath.
    for (name, area) in &zones.areas {
        let of = |pair: &(String, String)| pair.0 == *name;
        let sum: f64 = zones
            .exchange
            .iter()
            .filter(|(pair, _)| of(pair))
            .map(|(_, exchange)| exchange)
            .sum();
        let whole = (sum + zones.lost[name]) / area;
        assert!((whole - 1.0).abs() < 2e-3, "{name}: {whole}");
    }
    for name in [
        "room-22-text.msh",
        "room-41-binary.msh",
        "room-raw-zlib.vtu",
        "room-appended-none.vtp",
        "room.inp",
    ] {
        let (found, by_object) = room(&place, name, [""; 2]);
        assert!(found == matrix, "{name}: another matrix");
        assert_eq!(by_object, zones, "{name}");
    }
    // Each face an object of its own, whose sums are rounded otherwise; or faces from other corners on.
    // Cells of hidden pairs are cut otherwise then: within the tolerance's bound of an entry.
    for (name, is_same, most) in [
        ("room-assembly.inp", false, 1e-5),
        ("room.idf", true, 1e-7),
        ("room-relative.idf", true, 1e-7),
        ("room.epJSON", true, 1e-7),
        ("room.gbxml", true, 1e-7),
        ("room-solids.inp", false, 1e-3),
    ] {
        let (found, by_object) = room(&place, name, [""; 2]);
        assert!(!is_same || found == matrix, "{name}: another matrix");
        let (areas, factors) = difference(&by_object, &zones);
        assert!(
            areas < 1e-9 && factors < most,
            "{name}: areas off by {areas}, form factors by {factors}"
        );
    }
}

#[test]
fn another_room_is_told_apart() {
    let place = Place::new();
    let (matrix, zones) = room(&place, "room.obj", [""; 2]);
    // The ceiling a tenth of a metre lower, and a tent that is lower.
    for (name, change) in [
        ("room.idf", ["2.5", "2.4"]),
        (
            "room.gbxml",
            ["<Coordinate>1</Coordinate></C", "<Coordinate>0.9</Coordinate></C"],
        ),
    ] {
        let (areas, factors) = difference(&room(&place, name, change).1, &zones);
        assert!(
            areas > 0.01 && factors > 2e-3,
            "{name}: areas off by {areas}, form factors by {factors}"
        );
    }
    let (other, _) = room(&place, "room.inp", ["1, 1, 2, 3, 4", "1, 2, 3, 4, 1"]);
    assert!(other != matrix, "a quadrilateral that is cut otherwise");
}

#[test]
fn lengths_in_feet_are_named_until_they_are_metres() {
    let place = Place::new();
    let text = std::fs::read_to_string(workspace().join("crates/scene/tests/meshes/room.gbxml")).expect("a file");
    let feet = text.replace("lengthUnit=\"Meters\"", "lengthUnit=\"Feet\"");
    assert!(feet != text);
    place.write("feet.gbxml", feet);
    let compute = "compute feet.gbxml -o m --overwrite --tolerance 2%";
    let said = "the file's unit is 0.3048 m, and its lengths are taken as they stand";
    place.line(compute).is(0).says(&[said, "--scale 0.3048"]);
    // Whoever gives a scale has one in mind.
    let scaled = [
        "feet.gbxml -o m --overwrite --tolerance 2% --scale 0.3048",
        "room.gbxml -o m --overwrite --scale 1000",
    ];
    place.write("room.gbxml", text);
    for line in scaled {
        let ran = place.line(&format!("compute {line}")).is(0);
        assert!(!ran.err.contains("the file's unit"), "{line}: {}", ran.err);
    }
}
