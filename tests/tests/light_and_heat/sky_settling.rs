//! The sky's shares settle as finely as is asked.

use hemicube_tests::runs::Place;

/// The cells of a table, by row.
fn table(place: &Place, name: &str) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(place.path(name)).expect("a table");
    let cells = |line: &str| line.split(',').map(str::to_owned).collect();
    text.lines().skip(1).map(cells).collect()
}

/// A wall, two triangles, and a low one before it, of which the upper half of the first sees less.
const WALLS: &str = "v 0 0 0\nv 6 0 0\nv 6 0 6\nv 0 0 6\no wall\nf 4 3 2 1\n\
                     v 0 1.5 -2\nv 6 1.5 -2\nv 6 1.5 1\nv 0 1.5 1\no low\nf 5 6 7 8\n";

#[test]
fn the_sky_settles_with_the_ground_below_it() {
    let place = Place::new();
    place.write("walls.obj", WALLS);
    // Four rows still change at the last level, and are as exact as is asked all the same.
    place.line("sky walls.obj --up z -o settled.csv --tolerance 0.2%").is(1);
    place.line("sky walls.obj --up z -o fine.csv --samples 256").is(0);
    let columns = std::fs::read_to_string(place.path("fine.csv")).expect("a table");
    let columns: Vec<&str> = columns.lines().next().expect("names").split(',').collect();
    let (settled, fine) = (table(&place, "settled.csv"), table(&place, "fine.csv"));
    for name in ["sky_view_factor", "ground"] {
        let at = columns.iter().position(|&column| column == name).expect("a column");
        for (row, fine) in settled.iter().zip(&fine).take(2) {
            let [found, fine] = [row, fine].map(|row| row[at].parse::<f64>().expect("a share"));
            assert!((found - fine).abs() < 0.003, "{name}: {found} for {fine}");
        }
    }
}

#[test]
fn rows_of_the_sky_that_do_not_settle_end_with_1() {
    let place = Place::new();
    place.write("walls.obj", WALLS);
    let ran = place
        .line("sky walls.obj --up z -o t.csv --tolerance 0.001% --json")
        .is(1);
    assert!(ran.json()["unsettled"].as_u64().is_some_and(|rows| rows > 0));
    ran.says(&["still changed by more than", "an error may be greater"]);
}
