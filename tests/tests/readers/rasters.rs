//! Height models: the views of a model's cells are those of the same boxes as triangles.

use hemicube_tests::runs::Place;
use serde_json::Value;
use std::fmt::Write;

/// West, south, east, north and height of each, in whole cells.
const BOXES: [([usize; 4], f64); 3] = [([4, 4, 10, 8], 6.0), ([13, 3, 16, 15], 9.5), ([6, 11, 11, 17], 3.25)];
const COLUMNS: usize = 24;
const ROWS: usize = 20;
/// A slab with a step in it, which walls of three heights meet.
const STEP: ([usize; 4], f64) = ([10, 5, 13, 8], 2.0);

fn boxes() -> impl Iterator<Item = ([usize; 4], f64)> {
    BOXES.into_iter().chain([STEP])
}

fn model() -> String {
    let mut text = format!("ncols {COLUMNS}\nnrows {ROWS}\nxllcorner 0\nyllcorner 0\ncellsize 1\nNODATA_value -1\n");
    for row in (0..ROWS).rev() {
        for column in 0..COLUMNS {
            let over = boxes().find(|([west, south, east, north], _)| {
                (*west..*east).contains(&column) && (*south..*north).contains(&row)
            });
            write!(text, "{} ", over.map_or(0.0, |(_, height)| height)).expect("a string");
        }
        text.push('\n');
    }
    text
}

/// Ground and boxes, or boxes alone.
fn triangles(with_ground: bool) -> String {
    let mut text = format!("v 0 0 0\nv {COLUMNS} 0 0\nv {COLUMNS} {ROWS} 0\nv 0 {ROWS} 0\n");
    if with_ground {
        text.push_str("o ground\nf 1 2 3 4\n");
    }
    for (at, ([west, south, east, north], height)) in boxes().enumerate() {
        writeln!(text, "o box{at}").expect("a string");
        for z in [0.0, height] {
            for [x, y] in [[west, south], [east, south], [east, north], [west, north]] {
                writeln!(text, "v {x} {y} {z}").expect("a string");
            }
        }
        let v = |corner: usize| 5 + 8 * at + corner;
        for face in [[4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]] {
            let [a, b, c, d] = face.map(v);
            writeln!(text, "f {a} {b} {c} {d}").expect("a string");
        }
    }
    text
}

#[test]
fn a_model_of_boxes_has_the_views_of_the_boxes() {
    let place = Place::new();
    place.write("model.asc", model());
    place.write("boxes.obj", triangles(true));
    std::fs::create_dir(place.path("both")).expect("a folder");
    place.write("both/houses.obj", triangles(false));
    let head = model().lines().take(6).collect::<Vec<_>>().join("\n");
    place.write("both/ground.asc", format!("{head}\n{}", "0 ".repeat(COLUMNS * ROWS)));
    // On the ground, in corners, on a roof, on the step.
    place.write(
        "points.txt",
        "1.5 1.5 0.1\n11.5 9.2 0.1\n12.9 10.5 1.5\n5.5 9.5 0.3\n7.2 6.1 6.2\n11.5 6.5 2.1\n20 10 0.1\n16.2 4 4\n",
    );
    let sky = |scene: &str, body: &str| -> Vec<[f64; 2]> {
        let line = format!("points {scene} --up z --points points.txt --as {body} --tolerance 0.05% -o rows.json");
        let ran = place.line(&format!("{line} --overwrite"));
        assert!(ran.code.is_some_and(|code| code < 2), "{}", ran.err);
        let text = std::fs::read_to_string(place.path("rows.json")).expect("rows");
        let rows: Value = serde_json::from_str(&text).expect("JSON");
        let share = |row: &Value, name: &str| row[name].as_f64().expect("a share");
        let rows = rows["rows"].as_array().expect("rows");
        rows.iter()
            .map(|row| [share(row, "sky"), share(row, "ground")])
            .collect()
    };
    for body in ["sphere", "person"] {
        let of_boxes = sky("boxes.obj", body);
        assert_eq!(of_boxes.len(), 8);
        // As a raster, and as a mesh of the boxes on a raster of the ground.
        for other in ["model.asc", "both"] {
            for (a, b) in sky(other, body).iter().zip(&of_boxes) {
                assert!(
                    (a[0] - b[0]).abs() < 1e-3 && (a[1] - b[1]).abs() < 1e-3,
                    "{other}, {body}: {a:?} {b:?}"
                );
            }
        }
    }
}

#[test]
fn a_height_model_that_is_none_is_refused_by_its_line() {
    let place = Place::new();
    place.write("model.asc", model().replace("9.5", "9,5"));
    place
        .line("inspect model.asc")
        .is(2)
        .says(&["model.asc:", "`9,5` is no number"]);
    place.write("model.tif", "II*\0");
    place.line("inspect model.tif").is(2).says(&["model.tif", "TIFF"]);
    // No more memory than is allowed, whatever the cells.
    let wide = "ncols 2000\nnrows 2000\nxllcorner 0\nyllcorner 0\ncellsize 1\n";
    let rows = ("0 1 ".repeat(1000) + "\n" + &"1 0 ".repeat(1000) + "\n").repeat(1000);
    place.write("wide.asc", format!("{wide}{rows}"));
    place.line("inspect wide.asc --memory 1G").is(2).says(&[
        "wide.asc",
        "a height model of",
        "triangles takes",
        "allowed",
    ]);
}
