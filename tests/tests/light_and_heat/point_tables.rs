//! Tables of sensors: units, decimal commas, and columns of what is written.

use crate::heat_cases::{Obj, tank};
use glam::DVec3;
use hemicube_tests::geometry::point_to_polygon;
use hemicube_tests::rooms::{obj, room};
use hemicube_tests::runs::{Place, finish};
use std::collections::BTreeSet;

/// Three numbers with decimal commas were taken for a point and its direction, and points in millimetres for points of
/// an open field.
#[test]
fn tables_in_other_units_and_with_decimal_commas_are_told() {
    let place = Place::new();
    place.write("tank.obj", tank());
    let points = |text: &str, rest: &str| {
        place.write("points.txt", text);
        place.line(&format!("points tank.obj --up z --points points.txt{rest}"))
    };
    for text in ["0,5 1,25 1,5\n", "0,5, 1,25, 1,5\n", "0,5; 1,25; 1,5\n"] {
        points(text, "").is(2).says(&["points.txt:1:", "decimal comma"]);
    }
    // Commas that separate, whatever the blanks beside them.
    for text in ["1,1,1\n", "1, 1, 1\n", "1 ,1 ,1\n", "1,1,1,0,0,1\n", "1,1,1, 0,0,1\n"] {
        let read = points(text, "").is(0);
        assert!(!read.err.contains("warning"), "{text}: {}", read.err);
    }
    let far = points("500 500 1000\n1 1 1\n", " -o far.csv").is(0);
    assert!(
        far.err.contains("1 of 2 points in `points.txt` is more than ten times"),
        "{}",
        far.err
    );
    assert!(far.err.contains("line 1"), "{}", far.err);
    let table = std::fs::read_to_string(place.path("far.csv")).expect("a table");
    assert_eq!(table.matches(",far-off,").count(), 1, "{table}");
    // Temperatures as `solve` takes them.
    place.write("warm.csv", "*,17 °C\n");
    let said = points("3 1 1\n", " --temperatures warm.csv --sky-temperature 17°C").is(0);
    assert!(said.out.contains("290.15 K"), "{}", said.out);
    // A mast beside a scene of 2 m is not far off.
    let mast = points("10 0 10\n", "").is(0);
    assert!(!mast.err.contains("warning"), "{}", mast.err);
}

#[test]
fn tables_of_points_have_one_column_of_each_name() {
    let place = Place::new();
    let mut obj = Obj::default();
    obj.surface(
        "ground",
        "sky",
        &[[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [9.0, 9.0, 0.0], [-9.0, 9.0, 0.0]],
    );
    obj.object("house", "brick").block([1.0, -3.0, 0.0], [5.0, 3.0, 6.0]);
    // Objects of one name are one, as everywhere.
    obj.object("house", "brick").block([-5.0, -3.0, 0.0], [-1.0, 3.0, 6.0]);
    place.write("yard.obj", obj.text);
    place.write("point.txt", "0 0 1.5\n");
    let header = |options: &str| {
        place
            .line(&format!(
                "points yard.obj --up z --points point.txt -o p.csv --overwrite {options}"
            ))
            .is(0);
        let text = std::fs::read_to_string(place.path("p.csv")).expect("a table");
        let header: Vec<String> = text
            .lines()
            .next()
            .expect("a header")
            .split(',')
            .map(str::to_owned)
            .collect();
        let distinct: BTreeSet<&String> = header.iter().collect();
        assert_eq!(distinct.len(), header.len(), "{header:?}");
        header
    };
    assert_eq!(header("")[9..], ["ground (object)", "house"]);
    assert_eq!(header("--by material")[9..], ["sky (material)", "brick"]);
    let mut command = place.command("points yard.obj --up z --grid 3 --height 1.5 -o ground.png");
    command.args(["--show", "ground (object)"]);
    finish(place.spawn(command)).is(0);
}

/// EnergyPlus' angle factors of a standing person are those of six weighted sides, by closed forms; they add up to 1, and
/// stand behind the name of the point and, where the table has one, of the zone.
#[test]
fn people_in_a_zone_are_written_for_energyplus() {
    let place = Place::new();
    let quads = room(4.0, 3.0, 2.5);
    place.write("zone.obj", obj(&quads));
    place.write(
        "people.csv",
        "name,x,y,z,zone\nDesk,1.2,0.9,0.6,Zone One\nDoor,3.1,2,1.1,Zone One\n",
    );
    let objects = |options: &str| -> Vec<Vec<String>> {
        place
            .line(&format!(
                "points zone.obj --up z --tolerance 0.1% -o people.idf --overwrite {options}"
            ))
            .is(0);
        let text = std::fs::read_to_string(place.path("people.idf")).expect("a model");
        let fields = |object: &str| object.split(',').map(|field| field.trim().to_owned()).collect();
        text.split(';')
            .filter(|object| !object.trim().is_empty())
            .map(fields)
            .collect()
    };
    let found = objects("--points people.csv --as person");
    assert_eq!(found.len(), 2);
    for (object, (name, at)) in found
        .iter()
        .zip([("Desk", DVec3::new(1.2, 0.9, 0.6)), ("Door", DVec3::new(3.1, 2.0, 1.1))])
    {
        assert_eq!(object[..3], ["ComfortViewFactorAngles", name, "Zone One"]);
        let mut sum = 0.0;
        for (surface, corners) in &quads {
            let place = object.iter().position(|field| field == surface).expect("a surface");
            let factor: f64 = object[place + 1].parse().expect("a factor");
            let corners = corners.map(DVec3::from_array);
            let side = |normal: DVec3, weight: f64| weight * point_to_polygon(at, normal, &corners);
            let level: f64 = [DVec3::X, DVec3::Y, -DVec3::X, -DVec3::Y]
                .map(|normal| side(normal, 0.22))
                .iter()
                .sum();
            let exact = level + side(DVec3::Z, 0.06) + side(-DVec3::Z, 0.06);
            assert!((factor - exact).abs() < 2e-3, "{name}, {surface}: {factor} for {exact}");
            sum += factor;
        }
        assert!((sum - 1.0).abs() < 1e-9, "{sum}");
        assert_eq!(object.len(), 3 + 2 * quads.len());
    }
    // Without names and zones, as the dictionary has been since 24.1.
    place.write("plain.txt", "1 1 1\n");
    let found = objects("--points plain.txt --as seated");
    assert_eq!(found[0][..2], ["ComfortViewFactorAngles", "Point 0"]);
    assert_eq!(found[0].len(), 2 + 2 * quads.len());

    let refused = |options: &str, words: &[&str]| {
        place
            .line(&format!("points {options} --up z -o bad.idf"))
            .is(2)
            .says(words);
        assert!(!place.path("bad.idf").exists());
    };
    refused("zone.obj --points plain.txt --as cube", &["six"]);
    refused("zone.obj --points plain.txt --by material", &["objects"]);
    place.write("twice.csv", "name,x,y,z\nA,1,1,1\na,2,1,1\n");
    refused("zone.obj --points twice.csv", &["two points are called `a`"]);
    // A zone without its roof.
    let open: Vec<_> = quads.iter().copied().filter(|quad| quad.0 != "top").collect();
    place.write("open.obj", obj(&open));
    refused("open.obj --points plain.txt", &["`Point 0` sees", "add up to 1"]);
}
