//! Unknown is not 0: rows that were not computed, skies that have not settled, files without a triangle.

use hemicube_tests::runs::Place;

/// The Cornell box by object, rows of its first two objects only.
fn two_rows() -> Place {
    let place = Place::new();
    place.line("generate room --patches 200 -o room.obj").is(0);
    place
        .line("compute room.obj -o two --patches object --rows 0..2 --resolution 32")
        .is(0);
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
    place.line("export two zones.csv --by object").is(0);
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
        .line("export two zones.vf --by object")
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
            .says(&["has rows of 2 patches only", "--rows"]);
    }
}

#[test]
fn a_file_without_triangles_says_what_it_has_instead() {
    let place = Place::new();
    let strip = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                 element face 0\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n";
    place.write("none.ply", strip);
    place
        .line("inspect none.ply")
        .is(2)
        .says(&["none.ply: holds no triangle"]);
    let cell = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n\
                0 0 0 1 0 0 0 1 0 0 0 1\n\
                CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n42\n";
    place.write("poly.vtk", cell);
    place
        .line("inspect poly.vtk")
        .is(2)
        .says(&["poly.vtk: holds no triangle that is read", "1 × polyhedron, not read"]);
    let text = "# exported by a tool that puts its name first, and then some more words to fill a header\n\
                solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
                endsolid a\n";
    place.write("named.stl", text);
    place
        .line("inspect named.stl")
        .is(2)
        .says(&["named.stl:1: is text that does not begin with `solid`"]);
}

/// A wall, two triangles, and a low one before it, of which the upper half of the first sees less.
const WALLS: &str = "v 0 0 0\nv 6 0 0\nv 6 0 6\nv 0 0 6\no wall\nf 4 3 2 1\n\
                     v 0 1.5 -2\nv 6 1.5 -2\nv 6 1.5 1\nv 0 1.5 1\no low\nf 5 6 7 8\n";

#[test]
fn the_sky_settles_with_the_ground_below_it() {
    let place = Place::new();
    place.write("walls.obj", WALLS);
    place
        .line("sky walls.obj --up z --csv settled.csv --tolerance 0.2%")
        .is(0);
    place.line("sky walls.obj --up z --csv fine.csv --samples 256").is(0);
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
