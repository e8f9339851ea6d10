//! Tables of sensors: units, decimal commas, and columns of what is written.

use crate::heat_cases::{Obj, tank};
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
