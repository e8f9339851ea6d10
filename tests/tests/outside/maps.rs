//! Maps of `points --grid`, opened by rasterio (GDAL) and xarray: corner, cell, coordinate reference system, names, cells
//! without a value, and every value where the program says that its point is.

use hemicube_tests::readers::{json_of, python};
use hemicube_tests::runs::Place;
use serde_json::Value;
use std::collections::BTreeMap;
use std::process::Command;

const READERS: &str = r#"
import json, sys
import numpy, rasterio, xarray

def raster(path):
    with rasterio.open(path) as file:
        values = [numpy.where(band.mask, None, band.data.astype(float)).tolist() for band in file.read(masked=True)]
        return {"driver": file.driver, "transform": list(file.transform)[:6], "crs": file.crs and file.crs.to_epsg(),
                "nodata": file.nodata, "names": list(file.descriptions), "bands": values, "type": file.dtypes[0]}

found = {}
for path in sys.argv[1:]:
    found[path] = raster(path)
    if path.endswith(".nc"):
        with xarray.open_dataset(path, engine="scipy") as data:
            name = next(name for name in data.data_vars if name != "crs")
            column = data[name]
            values = numpy.where(column.isnull(), None, column.values.astype(float)).tolist()
            found[path].update(variable=name, dims=list(column.dims), x=column.x.values.tolist(), y=column.y.values.tolist(),
                               title=column.attrs["long_name"], units=column.attrs["units"], values=values,
                               sides=data.side.attrs["flag_meanings"].split() if "side" in data.coords else [])
json.dump(found, sys.stdout)
"#;

/// A house on a meadow in the Netherlands' system, with heights: the corner off the multiples of a cell.
fn city() -> String {
    let mut faces = vec!["[[0,1,2,3]]".to_owned()];
    for side in [
        [4, 5, 9, 8],
        [5, 6, 10, 9],
        [6, 7, 11, 10],
        [7, 4, 8, 11],
        [8, 9, 10, 11],
    ] {
        faces.push(format!("[{side:?}]"));
    }
    let corners =
        |[x0, y0, x1, y1, z]: [u32; 5]| format!("[{x0},{y0},{z}],[{x1},{y0},{z}],[{x1},{y1},{z}],[{x0},{y1},{z}]");
    format!(
        r#"{{"type":"CityJSON","version":"2.0","metadata":{{"referenceSystem":"https://www.opengis.net/def/crs/EPSG/0/7415"}},
        "transform":{{"scale":[0.5,0.5,0.5],"translate":[84000.0,447000.0,0.0]}},
        "vertices":[{},{},{}],
        "CityObjects":{{"meadow":{{"type":"LandUse","geometry":[{{"type":"MultiSurface","lod":"1","boundaries":[{}]}}]}},
        "house":{{"type":"Building","geometry":[{{"type":"MultiSurface","lod":"1","boundaries":[{}]}}]}}}}}}"#,
        corners([1, 1, 23, 19, 0]),
        corners([8, 4, 14, 10, 0]),
        corners([8, 4, 14, 10, 8]),
        faces[0],
        faces[1..].join(",")
    )
}

/// The programs' reading of some files.
fn opened(place: &Place, python: &std::ffi::OsStr, names: &[&str]) -> Value {
    json_of(
        Command::new(python)
            .arg("-c")
            .arg(READERS)
            .args(names)
            .current_dir(place.path("")),
    )
}

/// The sky view factor of each cell with a point, by column and row from the upper left corner, as the program has them.
fn known(place: &Place, name: &str, side: usize, each: usize) -> BTreeMap<(usize, usize), f64> {
    let text = std::fs::read_to_string(place.path(name)).expect("rows");
    let rows: Value = serde_json::from_str(&text).expect("JSON");
    let cell = |row: &Value| {
        let at = |axis: usize| row["position"][axis].as_f64().expect("a coordinate");
        // Whole numbers, as the cells are of one metre.
        let column = (0..12).find(|&column| (at(0) - 84000.5 - column as f64).abs() < 1e-6);
        let row_ = (0..10).find(|&row| (447009.5 - at(1) - row as f64).abs() < 1e-6);
        (
            (column.expect("a column"), row_.expect("a row")),
            row["sky"].as_f64().expect("a share"),
        )
    };
    let rows = rows["rows"].as_array().expect("rows");
    rows.iter().skip(side).step_by(each).map(cell).collect()
}

fn agrees(band: &Value, known: &BTreeMap<(usize, usize), f64>) {
    let mut missing = 0;
    for row in 0..10 {
        for column in 0..12 {
            let value = band[row][column].as_f64();
            match (value, known.get(&(column, row))) {
                (Some(value), Some(known)) => assert!((value - known).abs() < 1e-6, "{column} {row}: {value} {known}"),
                (None, None) => missing += 1,
                (value, known) => panic!("{column} {row}: {value:?} {known:?}"),
            }
        }
    }
    // The house covers the middles of 3 × 3 cells.
    assert_eq!(missing, 9);
}

#[test]
fn maps_are_where_the_points_are_and_nothing_stands_inside_solids() {
    let Some(python) = python("maps::maps_are_where_the_points_are", &["numpy", "rasterio", "xarray"]) else {
        return;
    };
    let place = Place::new();
    place.write("city.city.json", city());
    place
        .line("points city.city.json --grid 1 --height 0.5 -o a.tif -o a.nc -o a.asc -o a.json")
        .is(0);
    let found = opened(&place, &python, &["a.tif", "a.nc", "a.asc"]);
    let known = known(&place, "a.json", 0, 1);
    assert_eq!(known.len(), 12 * 10 - 9);
    for name in ["a.tif", "a.nc", "a.asc"] {
        let file = &found[name];
        let transform: Vec<f64> = serde_json::from_value(file["transform"].clone()).expect("numbers");
        assert_eq!(transform, [1.0, 0.0, 84000.0, 0.0, -1.0, 447010.0], "{name}");
        assert_eq!(file["nodata"], -9999.0, "{name}");
        assert_eq!(file["type"], "float32", "{name}");
        // An ASCII grid has no system.
        let crs = if name == "a.asc" { Value::Null } else { 28992.into() };
        assert_eq!(file["crs"], crs, "{name}");
        agrees(&file["bands"][0], &known);
    }
    assert_eq!(found["a.tif"]["names"][0], "sky view factor (horizontal plane)");
    let file = &found["a.nc"];
    assert_eq!(file["variable"], "sky_view_factor");
    assert_eq!(file["title"], "sky view factor (horizontal plane)");
    assert_eq!(
        (&file["x"][0], &file["y"][0], &file["y"][9]),
        (&84000.5.into(), &447009.5.into(), &447000.5.into())
    );
    agrees(&file["values"], &known);
}

#[test]
fn maps_of_cubes_have_a_band_a_side_with_its_name() {
    let Some(python) = python(
        "maps::maps_of_cubes_have_a_band_a_side",
        &["numpy", "rasterio", "xarray"],
    ) else {
        return;
    };
    let place = Place::new();
    place.write("city.city.json", city());
    let line = "points city.city.json --grid 1 --height 0.5 --as cube --resolution 64 --crs EPSG:25832";
    place.line(&format!("{line} -o c.tif -o c.nc -o c.json")).is(0);
    let found = opened(&place, &python, &["c.tif", "c.nc"]);
    let sides = ["east", "north", "west", "south", "up", "down"];
    for (at, side) in sides.iter().enumerate() {
        let known = known(&place, "c.json", at, 6);
        agrees(&found["c.tif"]["bands"][at], &known);
        agrees(&found["c.nc"]["values"][at], &known);
        assert_eq!(
            found["c.tif"]["names"][at],
            format!("sky view factor (side of a cube): {side}")
        );
        assert_eq!(found["c.nc"]["sides"][at], *side);
    }
    assert_eq!(found["c.tif"]["crs"], 25832);
}

#[test]
fn a_map_shows_a_column_by_its_name() {
    let Some(python) = python(
        "maps::a_map_shows_a_column_by_its_name",
        &["numpy", "rasterio", "xarray"],
    ) else {
        return;
    };
    let place = Place::new();
    // A name with what XML quotes, and letters beyond ASCII.
    place.write("city.city.json", city().replace("\"house\"", "\"Höfe <1> & 2\""));
    place.write("warm.csv", "*,20 °C\n");
    let line = "points city.city.json --grid 1 --height 0.5 --overwrite";
    place.line(&format!("{line} --show ground -o a.tif")).is(0);
    let heat = "--temperatures warm.csv --sky-temperature 260 --ground-temperature 280";
    place.line(&format!("{line} {heat} -o b.tif -o b.nc")).is(0);
    let mut command = place.command("points city.city.json --grid 1 --height 0.5 -o c.tif");
    command.args(["--show", "Höfe <1> & 2"]);
    hemicube_tests::runs::finish(place.spawn(command)).is(0);
    let found = opened(&place, &python, &["a.tif", "b.tif", "b.nc", "c.tif"]);
    assert_eq!(
        found["a.tif"]["names"][0],
        "view factor of what is below the horizon (horizontal plane)"
    );
    // A radiant temperature is of a body in the open, unless another form is named.
    assert_eq!(found["b.tif"]["names"][0], "mean radiant temperature (sphere)");
    assert_eq!(
        (&found["b.nc"]["variable"], &found["b.nc"]["units"]),
        (&"mean_radiant_temperature".into(), &"K".into())
    );
    let kelvin = found["b.tif"]["bands"][0][0][0].as_f64().expect("a temperature");
    assert!((260.0..293.2).contains(&kelvin), "{kelvin}");
    assert_eq!(
        found["c.tif"]["names"][0],
        "view factor of Höfe <1> & 2 (horizontal plane)"
    );
}

#[test]
fn a_map_that_cannot_be_placed_is_refused_or_told() {
    let place = Place::new();
    place.write("city.city.json", city());
    let says = |line: &str, words: &[&str]| {
        place.line(&format!("points city.city.json {line}")).is(2).says(words);
    };
    says("--grid 1 --height 1 -o a.tif --crs EPSG:4326", &["not projected"]);
    says("--grid 1 --height 1 -o a.tif --crs 28992", &["EPSG:28992"]);
    says("--grid 1 --height 1 -o a.png --crs EPSG:28992", &[".tif or .nc"]);
    says("--grid 1 --height 1 -o a.asc --as cube", &["a cube has six"]);
    says("--grid 1 --on house -o a.tif", &["look"]);
    place.write("wall.obj", "o wall\nv 0 0 0\nv 4 0 0\nv 4 0 3\nv 0 0 3\nf 1 2 3 4\n");
    place
        .line("points wall.obj --up z --grid 1 --on wall -o a.tif")
        .is(2)
        .says(&["do not look up", ".npz"]);
    place.write("degrees.city.json", city().replace("EPSG/0/7415", "EPSG/0/4979"));
    let told = place
        .line("points degrees.city.json --grid 1 --height 1 -o a.tif")
        .is(0);
    assert!(told.err.contains("no coordinate reference system"), "{}", told.err);
}

const CANOPY: &str = r#"
import numpy, rasterio
from rasterio.transform import from_origin

bands = numpy.zeros((3, 21, 21), "float32")
bands[2, 6:15, 6:15] = 8
place = {"crs": "EPSG:28992", "transform": from_origin(85000, 447021, 1, 1)}
with rasterio.open("yard.tif", "w", driver="GTiff", interleave="pixel", width=21, height=21, count=3, dtype="float32", **place) as file:
    file.write(bands)
print("{}")
"#;

/// A tree of 9 × 9 m on a meadow, from 2 to 8 m: its bottom is all that hides the sky from the middle below it.
#[test]
fn trees_of_a_canopy_raster_let_part_of_the_sky_through() {
    let Some(python) = python("maps::trees_of_a_canopy_raster", &["numpy", "rasterio"]) else {
        return;
    };
    let place = Place::new();
    json_of(Command::new(python).arg("-c").arg(CANOPY).current_dir(place.path("")));
    place.write("crown.toml", "[object.canopy]\ntransmittance = 0.5\n");
    place.write("below.csv", "85010.5 447010.5 0.001 0 0 1\n");
    let sky = |options: &str| {
        place
            .line(&format!(
                "points yard.tif --points below.csv -o p.json --overwrite --resolution 512 -q {options}"
            ))
            .is(0);
        let text = std::fs::read_to_string(place.path("p.json")).expect("rows");
        let rows: Value = serde_json::from_str(&text).expect("JSON");
        rows["rows"][0]["sky"].as_f64().expect("a share")
    };
    // The view factor of a rectangle overhead (Howell C-3), four of them.
    let side = 4.5 / 2.0f64;
    let slant = (1.0 + side * side).sqrt();
    let hidden = 4.0 * (2.0 * side / slant * (side / slant).atan()) / std::f64::consts::TAU;
    for (options, part) in [("", 0.0), ("--specular crown.toml", 0.25)] {
        let (found, exact) = (sky(options), 1.0 - hidden * (1.0 - part));
        assert!((found - exact).abs() < 2e-3, "{options}: {found} {exact}");
    }
    place
        .line("compute yard.tif --specular crown.toml -o yard --correction pixel --resolution 64 -q")
        .is(0);
    let report = place.line("check yard --json").is(0).json();
    assert_eq!(report["ok"], true, "{report}");
}
