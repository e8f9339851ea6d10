//! Rows that were not computed are unknown, not 0: empty in tables, and refused where all rows are needed.

use hemicube_tests::runs::Place;

/// The Cornell box by object, rows of its first two objects only.
fn two_rows() -> Place {
    let place = Place::new();
    place.line("generate room --patches 200 -o room.obj").is(0);
    place.line("compute room.obj -o two --by object --rows 0..2").is(0);
    place
}

/// The cells of a table, by row.
fn table(place: &Place, name: &str) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(place.path(name)).expect("a table");
    let cells = |line: &str| line.split(',').map(str::to_owned).collect();
    text.lines().skip(1).map(cells).collect()
}

#[test]
fn zones_without_rows_are_empty_in_tables_and_refused_by_view3d() {
    let place = two_rows();
    place.line("export two -o zones.csv --by object").is(0);
    let rows = table(&place, "zones.csv");
    assert!(rows.len() > 2);
    for (at, row) in rows.iter().enumerate() {
        let sum = row[3..].iter().filter_map(|cell| cell.parse::<f64>().ok()).sum::<f64>();
        if at < 2 {
            assert!((sum - 1.0).abs() < 0.02, "{row:?}");
        } else {
            assert!(row[3..].iter().all(String::is_empty), "{row:?}");
            assert!(row[2].parse::<f64>().is_ok_and(|area| area > 0.0), "{row:?}");
        }
    }
    place
        .line("export two -o zones.vf --by object")
        .is(2)
        .says(&["cannot say that zone `light` has no rows", ".csv"]);
}

#[test]
fn what_surfaces_exchange_takes_all_rows() {
    let place = two_rows();
    place.write("grey.toml", "[default]\nemissivity = 0.8\n");
    for by in ["object", "patch"] {
        place
            .line(&format!("exchange two --materials grey.toml --by {by}"))
            .is(2)
            .says(&["has rows of 2 patches only", "compute it with all rows"]);
    }
}
