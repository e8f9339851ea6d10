//! Three scenes of View3D, of growing difficulty, from its input format to its output format: values of its manual,
//! exact values, and closure and reciprocity of an L-shaped room that is given in both of its geometry formats. And
//! zones of a city, from a CityJSON tile and from its OBJ twin.

use hemicube_scene::generate::{Generate, Kind, generate};
use hemicube_scene::write;
use hemicube_tests::runs::command_in;
use hemicube_tests::scenes::program;
use std::fmt::Write as _;
use std::path::Path;
use tempfile::TempDir;

fn run(directory: &Path, arguments: &[&str]) {
    let output = command_in(&program(), directory)
        .args(arguments)
        .output()
        .expect("the program starts");
    assert!(
        output.status.success(),
        "{arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// A matrix as View3D writes it.
struct ViewFactors {
    header: String,
    areas: Vec<f64>,
    factors: Vec<Vec<f64>>,
    emissivities: Vec<f64>,
}

fn view_factors(directory: &Path, scene: &str, tolerance: &str) -> ViewFactors {
    std::fs::write(directory.join("scene.vs3"), scene).unwrap();
    run(
        directory,
        &[
            "compute",
            "scene.vs3",
            "-o",
            "F",
            "--overwrite",
            "--tolerance",
            tolerance,
        ],
    );
    run(
        directory,
        &["export", "F", "-o", "F.vf", "--by", "object", "--overwrite"],
    );
    let text = std::fs::read_to_string(directory.join("F.vf")).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap().to_owned();
    let mut numbers = lines.map(|line| line.split(' ').map(|word| word.parse().unwrap()).collect::<Vec<f64>>());
    let areas = numbers.next().unwrap();
    let factors: Vec<Vec<f64>> = numbers.by_ref().take(areas.len()).collect();
    let emissivities = numbers.next().unwrap();
    assert!(numbers.next().is_none() && factors.iter().all(|row| row.len() == areas.len()));
    ViewFactors {
        header,
        areas,
        factors,
        emissivities,
    }
}

#[test]
fn a_cube_has_the_values_of_the_manual() {
    let place = TempDir::new().unwrap();
    let scene = "T cube\nC encl=1\nF 3\nV 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\nV 5 0 0 1\nV 6 1 0 1\nV 7 1 1 1\nV 8 0 1 1\n\
                 S 1 1 2 3 4 0 0 0.5 bottom\nS 2 1 4 8 5 0 0 0.5 west\nS 3 1 5 6 2 0 0 0.5 south\n\
                 S 4 7 6 5 8 0 0 0.6 top\nS 5 7 3 2 6 0 0 0.5 east\nS 6 7 8 4 3 0 0 0.5 north\nE\n";
    let found = view_factors(place.path(), scene, "0.01%");
    assert!(found.header.ends_with(" 0 0 0 6"), "{}", found.header);
    assert_eq!(found.areas, [1.0; 6]);
    assert_eq!(found.emissivities, [0.5, 0.5, 0.5, 0.6, 0.5, 0.5]);
    for (i, row) in found.factors.iter().enumerate() {
        for (j, &factor) in row.iter().enumerate() {
            // The manual prints 0.199825 for opposite faces and 0.200044 for neighbours.
            let expected = if i == j {
                0.0
            } else if i % 3 == j % 3 {
                0.199_825
            } else {
                0.200_044
            };
            assert!((factor - expected).abs() < 1.5e-6, "F({i}, {j}) = {factor}");
        }
    }
}

#[test]
fn an_obstruction_between_squares_has_its_exact_value() {
    let place = TempDir::new().unwrap();
    let scene = "F 3\nV 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\nV 5 0 0 1\nV 6 1 0 1\nV 7 1 1 1\nV 8 0 1 1\n\
                 V 9 0 0 .5\nV 10 .5 0 .5\nV 11 .5 .5 .5\nV 12 0 .5 .5\n\
                 S 1 1 2 3 4 0 0 0.5 low\nS 2 7 6 5 8 0 0 0.5 high\nS 3 9 10 11 12 0 0 0.5 between\n";
    let found = view_factors(place.path(), scene, "0.01%");
    // Exact by integration; View3D itself prints 0.149870.
    for factor in [found.factors[0][1], found.factors[1][0]] {
        assert!((factor / 0.149_868_671_773_8 - 1.0).abs() < 1e-5, "{factor}");
    }
    // The obstruction faces up only.
    assert_eq!((found.factors[0][2], found.factors[2][0]), (0.0, 0.0));
    assert!(found.factors[1][2] > 0.1);
}

/// A room whose plan is an L: walls 3 m high; floor and ceiling of three surfaces each, combined.
const L_ROOM: &str = "T L\nF 3\n\
    V 1 0 3 3\nV 2 1 3 3\nV 3 0 3 0\nV 4 1 3 0\nV 5 0 1 0\nV 6 1 1 0\nV 7 3 1 0\nV 8 0 0 0\n\
    V 9 1 0 0\nV 10 3 0 0\nV 11 0 0 3\nV 12 1 0 3\nV 13 3 0 3\nV 14 0 1 3\nV 15 1 1 3\nV 16 3 1 3\n\
    S 1 11 13 10 8 0 0 0.9 south\nS 2 10 13 16 7 0 0 0.9 east\nS 3 6 7 16 15 0 0 0.9 inner-north\n\
    S 4 4 6 15 2 0 0 0.9 inner-east\nS 5 3 4 2 1 0 0 0.9 north\nS 6 8 3 1 11 0 0 0.9 west\n\
    S 7 11 14 15 12 0 0 0.9 ceiling\nS 8 8 9 6 5 0 0 0.9 floor\nS 9 1 2 15 14 0 7 0.9 ceiling-2\n\
    S 10 15 16 13 12 0 7 0.9 ceiling-3\nS 11 5 6 4 3 0 8 0.9 floor-2\nS 12 9 10 7 6 0 8 0.9 floor-3\nEnd\n";

const L_ROOM_IN_PLANES: &str = "T L\nF 3a\n\
    S 1 R 0 0 .9 south\n3 0 0 0 90 3 3\nS 2 R 0 0 .9 east\n3 1 0 270 90 1 3\nS 3 R 0 0 .9 inner-north\n1 1 0 180 90\n2 3\n\
    S 4 R 0 0 .9 inner-east\n1 3 0 270 90 2 3\nS 5 R 0 0 .9 north\n0 3 0 180 90 1 3\nS 6 R 0 0 .9 west\n0 0 0 90 90 3 3\n\
    S 7 Q 0 0 .9 ceiling\n3 0 3 0 180\n2 0 3 0 3 1 2 1\nS 8 Q 0 0 .9 floor\n0 0 0 180 0\n0 0 1 0 1 1 0 1\n\
    S 9 Q 0 7 .9 ceiling-2\n3 0 3 0 180\n2 1 3 1 3 3 2 3\nS 10 Q 0 7 .9 ceiling-3\n3 0 3 0 180\n0 0 2 0 2 1 0 1\n\
    S 11 Q 0 8 .9 floor-2\n0 0 0 180 0\n0 1 1 1 1 3 0 3\nS 12 q 0 8 .9 floor-3\n0 0 0 180 0\n1 0 3 0 3 1 1 1\n*\n";

#[test]
fn a_room_with_a_corner_in_view_is_closed_and_reciprocal_in_both_formats() {
    let place = TempDir::new().unwrap();
    let room = view_factors(place.path(), L_ROOM, "0.01%");
    let in_planes = view_factors(place.path(), L_ROOM_IN_PLANES, "0.01%");
    assert_eq!(room.areas, [9.0, 3.0, 6.0, 6.0, 3.0, 9.0, 5.0, 5.0]);
    assert_eq!(in_planes.areas, room.areas);
    for (i, row) in room.factors.iter().enumerate() {
        let sum: f64 = row.iter().sum();
        assert!((sum - 1.0).abs() < 1e-4, "row {i} sums to {sum}");
        for (j, &factor) in row.iter().enumerate() {
            let back = room.factors[j][i];
            assert!(
                (room.areas[i] * factor - room.areas[j] * back).abs() < 1e-5,
                "F({i}, {j})"
            );
            assert!((factor - in_planes.factors[i][j]).abs() < 2e-5, "F({i}, {j}) in planes");
        }
    }
    // The plan is its own mirror image along the diagonal: south is west, east is north.
    let mirrored = [5, 4, 3, 2, 1, 0, 6, 7];
    for i in 0..8 {
        for j in 0..8 {
            let (one, other) = (room.factors[i][j], room.factors[mirrored[i]][mirrored[j]]);
            assert!((one - other).abs() < 2e-5, "F({i}, {j}) = {one}, mirrored {other}");
        }
    }
    // Walls in one line of the L do not see those behind the corner.
    assert_eq!(room.factors[2][3], 0.0);
}

#[test]
fn a_city_json_tile_and_its_obj_twin_give_the_same_matrix() {
    let place = TempDir::new().unwrap();
    let scene = generate(Generate {
        kind: Kind::BlockCity,
        target_patches: 1500,
        seed: 3,
    })
    .unwrap();
    let mut vertices: Vec<[f64; 3]> = Vec::new();
    let mut faces = String::new();
    for (at, triangle) in scene.triangles.iter().enumerate() {
        let first = vertices.len();
        vertices.extend(triangle.corners.map(|p| p.to_array()));
        let comma = if at == 0 { "" } else { "," };
        write!(faces, "{comma}[[{},{},{}]]", first, first + 1, first + 2).unwrap();
    }
    let vertices = serde_json::to_string(&vertices).unwrap();
    let city = format!(
        "{{\"type\":\"CityJSON\",\"version\":\"2.0\",\"transform\":{{\"scale\":[1,1,1],\"translate\":[0,0,0]}},\
         \"CityObjects\":{{\"tile\":{{\"type\":\"Building\",\"geometry\":[{{\"type\":\"MultiSurface\",\"lod\":\"2\",\
         \"boundaries\":[{faces}]}}]}}}},\"vertices\":{vertices}}}"
    );
    std::fs::write(place.path().join("tile.city.json"), city).unwrap();
    let mut twin = std::fs::File::create(place.path().join("tile.obj")).unwrap();
    write::obj(&scene, &mut twin).unwrap();
    for (scene, store) in [("tile.city.json", "A"), ("tile.obj", "B")] {
        run(
            place.path(),
            &["compute", scene, "-o", store, "--tolerance", "5%", "--two-sided", "off"],
        );
    }
    // Parts name the run that they are of, and a scene's hash is of its names too: what they hold is in the exports.
    let matrix = |store: &str| -> Vec<u8> {
        run(place.path(), &["export", store, "-o", "matrix.npz", "--overwrite"]);
        std::fs::read(place.path().join("matrix.npz")).unwrap()
    };
    assert!(matrix("A") == matrix("B"), "the two matrices are not the same bytes");
    run(place.path(), &["export", "A", "-o", "zones.csv", "--by", "object"]);
    let csv = std::fs::read_to_string(place.path().join("zones.csv")).unwrap();
    let lines: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(lines[0][..3], ["zone", "patches", "area"]);
    assert_eq!((lines.len(), lines[1][0], lines[1].len()), (2, "tile", 7));
    let number = |at: usize| lines[1][at].parse::<f64>().unwrap();
    // All of what leaves the tile reaches it, or escapes, or ends on a back.
    assert!((number(3) + number(4) + number(6) - 1.0).abs() < 0.02, "{:?}", lines[1]);
}

/// A table's own columns and those of zones that are called likewise are told apart.
#[test]
fn zones_called_as_columns_have_columns_of_their_own() {
    let place = TempDir::new().unwrap();
    let folder = place.path();
    run(
        folder,
        &["generate", "room", "--patches", "300", "-o", "room.obj", "-q"],
    );
    let room = std::fs::read_to_string(folder.join("room.obj")).unwrap();
    let named = room
        .replace("\no floor\n", "\no zone\n")
        .replace("\no ceiling\n", "\no escaped\n");
    assert_ne!(named, room);
    std::fs::write(folder.join("room.obj"), named).unwrap();
    run(folder, &["compute", "room.obj", "-o", "F", "-q", "--config=none"]);
    run(folder, &["export", "F", "-o", "F.csv", "--by", "object"]);
    let table = std::fs::read_to_string(folder.join("F.csv")).unwrap();
    let mut lines = table.lines();
    let columns: Vec<&str> = lines.next().unwrap().split(',').collect();
    let different: std::collections::HashSet<&&str> = columns.iter().collect();
    assert_eq!(different.len(), columns.len(), "{columns:?}");
    assert!(
        columns.contains(&"zone (zone)") && columns.contains(&"escaped (zone)"),
        "{columns:?}"
    );
    let rows: Vec<&str> = lines.filter_map(|line| line.split(',').next()).collect();
    assert!(rows.contains(&"zone") && rows.contains(&"escaped"), "{rows:?}");
}

/// Zones go into every format of matrices: the numbers are those of the table, in its order.
#[test]
fn zones_as_matrices() {
    let place = TempDir::new().unwrap();
    let folder = place.path();
    run(
        folder,
        &["generate", "room", "--patches", "300", "-o", "room.obj", "-q"],
    );
    run(folder, &["compute", "room.obj", "-o", "F", "-q", "--config=none"]);
    for file in ["F.csv", "F.mtx", "F.npz", "F.npy", "F.txt"] {
        run(folder, &["export", "F", "-o", file, "--by", "face"]);
    }
    let table = std::fs::read_to_string(folder.join("F.csv")).unwrap();
    let rows: Vec<Vec<f64>> = table
        .lines()
        .skip(1)
        .map(|line| line.split(',').skip(6).map(|cell| cell.parse().unwrap()).collect())
        .collect();
    let expected: f64 = rows.iter().flatten().sum();
    let mtx = std::fs::read_to_string(folder.join("F.mtx")).unwrap();
    let mut lines = mtx.lines().filter(|line| !line.starts_with('%'));
    let size = lines.next().unwrap();
    assert!(size.starts_with(&format!("{0} {0} ", rows.len())), "{size}");
    let mut sum = 0.0;
    for line in lines {
        let mut words = line.split(' ');
        let mut index = || words.next().unwrap().parse::<usize>().unwrap() - 1;
        let (row, column) = (index(), index());
        let value: f64 = words.next().unwrap().parse().unwrap();
        assert!((value - rows[row][column]).abs() <= 1e-7, "{line}");
        sum += value;
    }
    assert!((sum - expected).abs() < 1e-4, "{sum} and {expected}");
    let read = hemicube::store::Matrix::open(&folder.join("F.npz")).unwrap();
    let row = read.row(3).unwrap().unwrap();
    assert!(
        row.columns
            .iter()
            .zip(&row.values)
            .all(|(&to, &value)| (value - rows[3][to as usize]).abs() <= 1e-7)
    );
    let refused = command_in(&program(), folder)
        .args(["export", "F", "-o", "F.ply", "--by", "face"])
        .output()
        .unwrap();
    assert!(!refused.status.success() && String::from_utf8_lossy(&refused.stderr).contains("`--by` adds them up"));
}
