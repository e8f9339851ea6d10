//! What `hemicube export` writes of patches, and the matrix as Parquet and as triplets, opened by readers of others:
//! every value is the store's, every corner where the store says the patch is.
//!
//! meshio, trimesh, DuckDB and Khronos's glTF validator in every run; VTK itself, pyarrow and GNU Octave, hundreds of
//! megabytes each, in `./test --full`.

use hemicube::InputPatch;
use hemicube::sky::read_sky_view_factors;
use hemicube::solve::StoredSolution;
use hemicube::store::Store;
use hemicube_export::{
    Error, ExportFormat, ExportOptions, PatchFormat, PatchResults, WriteOptions, export, write_patches,
};
use hemicube_tests::readers::{json_of, node, python};
use hemicube_tests::runs::Place;
use hemicube_tests::scenes::{skip, workspace};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;

const READERS: &str = include_str!("formats/readers.py");
const VALIDATE: &str = include_str!("formats/validate.js");

/// Names that formats have to quote, far from the origin as cities are.
const SCENE: &str = r#"mtllib yard.mtl
v 84000.25 447000.5 3
v 84004.25 447000.5 3
v 84004.25 447003.5 3
v 84000.25 447003.5 3
v 84000.25 447000.5 5
v 84004.25 447000.5 5
v 84000.25 447003.5 5
v 84004.25 447003.5 5
o Hof, "klein" <ö> & Co
usemtl grass
f 1 2 3 4
o wall
usemtl red brick
f 1 5 6 2
f 4 3 8 7
"#;

const MATERIALS: &str = "[material.grass]\nreflectance = 0.2\n[material.\"red brick\"]\nreflectance = [0.5, 0.2, 0.1]\nemission = [1, 2, 4]\n";

const OBJECTS: [&str; 2] = ["Hof, \"klein\" <ö> & Co", "wall"];

/// A solved yard with its sky, each surface two patches.
fn yard() -> Place {
    let place = Place::new();
    std::fs::write(place.path("yard.obj"), SCENE).expect("a file");
    std::fs::write(
        place.path("yard.mtl"),
        "newmtl grass\nKd 0.2 0.2 0.2\nnewmtl red brick\nKd 0.5 0.2 0.1\n",
    )
    .expect("a file");
    std::fs::write(place.path("m.toml"), MATERIALS).expect("a file");
    place
        .line("compute yard.obj --two-sided on --split 4 --up z -o F --config=none")
        .is(0);
    place.line("sky yard.obj --matrix F").is(0);
    place.line("solve F --materials m.toml").is(0);
    place
}

/// Everything that the store knows, by the names that exports give it.
fn known(store: &Store) -> BTreeMap<String, Vec<Option<f64>>> {
    let table = store.patches().expect("patches");
    let rows = store.row_table().expect("rows");
    let number = |value: f64| (!value.is_nan()).then_some(value);
    let reals = |values: &[f64]| values.iter().copied().map(number).collect::<Vec<_>>();
    let wholes = |values: &[u32]| values.iter().map(|&value| Some(value.into())).collect::<Vec<_>>();
    let mut known = BTreeMap::from([
        (
            "patch".to_owned(),
            (0..store.patch_count()).map(|p| Some(p.into())).collect(),
        ),
        ("object".to_owned(), wholes(&table.object)),
        ("material".to_owned(), wholes(&table.material)),
        ("face".to_owned(), wholes(&table.face)),
        (
            "side".to_owned(),
            table.side.iter().map(|&side| Some(side.into())).collect(),
        ),
        ("area".to_owned(), reals(&table.area)),
        ("row_sum".to_owned(), reals(&rows.row_sum)),
        ("escaped".to_owned(), reals(&rows.escaped)),
        ("blocked".to_owned(), reals(&rows.blocked)),
        ("unselected".to_owned(), reals(&rows.unselected)),
    ]);
    if rows.error.iter().any(|error| !error.is_nan()) {
        known.insert("error".to_owned(), reals(&rows.error));
        known.insert("sum_error".to_owned(), reals(&rows.sum_error));
        known.insert("escaped_error".to_owned(), reals(&rows.escaped_error));
    }
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let of = |vectors: &[[f64; 3]]| vectors.iter().map(|v| Some(v[axis])).collect::<Vec<_>>();
        known.insert(format!("centroid_{name}"), of(&table.centroid));
        known.insert(format!("normal_{name}"), of(&table.normal));
    }
    let seen = |patch| {
        let row = store.row(InputPatch(patch)).expect("a row");
        row.map(|row| row.data.len() as f64)
    };
    known.insert("seen".to_owned(), (0..store.patch_count()).map(seen).collect());
    if let Ok(sky) = read_sky_view_factors(&store.directory().join("sky/sky.npz")) {
        known.insert("sky_view_factor".to_owned(), reals(&sky));
    }
    for name in StoredSolution::names(store) {
        let solution = StoredSolution::open(store, &name).expect("a solution");
        for quantity in solution.quantities() {
            let array = solution.quantity(quantity).expect("a quantity");
            for (row, band) in ["red", "green", "blue"].into_iter().enumerate() {
                let values = array.row(row as u64).expect("a row");
                known.insert(format!("{quantity}_{band}"), reals(&values));
            }
        }
    }
    known
}

fn column(value: &Value) -> Vec<Option<f64>> {
    value.as_array().expect("a column").iter().map(Value::as_f64).collect()
}

fn points(value: &Value) -> Vec<[f64; 9]> {
    let number = |value: &Value| value.as_f64().expect("a coordinate");
    let patch = |value: &Value| {
        let corners: Vec<f64> = value.as_array().expect("corners").iter().map(number).collect();
        corners.try_into().expect("nine coordinates")
    };
    value.as_array().expect("patches").iter().map(patch).collect()
}

/// Every column is there with every value, and there is no other.
#[track_caller]
fn assert_columns(found: &Value, known: &BTreeMap<String, Vec<Option<f64>>>, but: &[&str]) {
    let found = found["columns"].as_object().expect("columns");
    for (name, values) in known {
        if !but.contains(&name.as_str()) {
            let read = found.get(name).unwrap_or_else(|| panic!("there is no `{name}`"));
            assert!(column(read) == *values, "`{name}` is not what the store has");
        }
    }
    let more: Vec<&String> = found.keys().filter(|name| !known.contains_key(*name)).collect();
    assert!(more.is_empty(), "{more:?} are unknown");
}

/// Corners make the area, the centroid and the normal that the store has, within `near` of the scene's unit.
#[track_caller]
fn assert_corners(corners: &[[f64; 9]], store: &Store, near: f64) {
    let table = store.patches().expect("patches");
    assert_eq!(corners.len(), table.len());
    for (patch, corners) in corners.iter().enumerate() {
        let [a, b, c] = [0, 3, 6].map(|at: usize| glam::DVec3::from_slice(&corners[at..at + 3]));
        let cross = (b - a).cross(c - a);
        let centroid = (a + b + c) / 3.0;
        assert!(
            (centroid - glam::DVec3::from(table.centroid[patch])).length() < near
                && (cross.length() / 2.0 - table.area[patch]).abs() < near
                && (cross.normalize() - glam::DVec3::from(table.normal[patch])).length() < near,
            "patch {patch} is somewhere else, or turned"
        );
    }
}

fn read(python: &std::ffi::OsStr, reader: &str, path: &Path) -> Value {
    json_of(Command::new(python).args(["-c", READERS, reader]).arg(path))
}

/// Entries of a matrix by row and column.
fn entries(store: &Store) -> BTreeMap<(u64, u64), f64> {
    let mut entries = BTreeMap::new();
    for row in store.rows().expect("rows") {
        let (patch, row) = row.expect("a row");
        for (&column, factor) in row.indices.iter().zip(&row.data) {
            entries.insert((patch.0.into(), column.into()), factor);
        }
    }
    entries
}

#[allow(clippy::cast_possible_truncation, reason = "it was an f32")]
fn read_entries(value: &Value) -> BTreeMap<(u64, u64), f64> {
    let list = value["entries"].as_array().expect("entries");
    let entry = |entry: &Value| {
        let index = |place: usize| entry[place].as_u64().expect("an index");
        (
            (index(0), index(1)),
            f64::from(entry[2].as_f64().expect("a factor") as f32),
        )
    };
    let found: BTreeMap<_, _> = list.iter().map(entry).collect();
    assert_eq!(found.len(), list.len(), "an entry twice");
    found
}

#[test]
fn meshio_and_trimesh_find_every_value() {
    let Some(python) = python(
        "formats::meshio_and_trimesh_find_every_value",
        &["numpy", "meshio", "trimesh"],
    ) else {
        return;
    };
    let place = yard();
    for file in ["p.vtu", "p.ply", "p.glb", "p.csv", "p.npz"] {
        let more = match file {
            "p.npz" => "--results",
            "p.ply" | "p.glb" => "--show seen",
            _ => "",
        };
        place.line(&format!("export F -o {file} --scene yard.obj {more}")).is(0);
    }
    let store = Store::open(&place.path("F")).expect("a store");
    let known = known(&store);
    assert!(known.contains_key("sky_view_factor") && known.contains_key("irradiance_blue"));
    assert_eq!(store.patch_count(), 2 * 6 * 16);

    let vtu = read(&python, "meshio", &place.path("p.vtu"));
    assert_columns(&vtu, &known, &[]);
    let corners = points(&vtu["corners"]);
    assert_corners(&corners, &store, 1e-9);
    // Three rectangles of 4 × 4 cells on two edges that they share: points are shared, too, by both sides.
    assert_eq!(vtu["points"], 3 * 25 - 2 * 5);

    let npz = read(&python, "npz", &place.path("p.npz"));
    assert_columns(&npz, &known, &[]);
    assert_eq!(npz["names"]["object"], serde_json::json!(OBJECTS));
    assert!(points(&npz["corners"]) == corners);

    let csv = read(&python, "csv", &place.path("p.csv"));
    assert_columns(&csv, &known, &["object", "material"]);
    assert!(points(&csv["corners"]) == corners);
    let words = |column: &str, names: [&str; 2]| -> Vec<Value> {
        let name = |&index: &Option<f64>| names[usize::from(index == Some(1.0))].into();
        known[column].iter().map(name).collect()
    };
    assert!(csv["words"]["object"] == Value::from(words("object", OBJECTS)));
    assert!(csv["words"]["material"] == Value::from(words("material", ["grass", "red brick"])));

    let ply = read(&python, "ply", &place.path("p.ply"));
    assert_columns(&ply, &known, &[]);
    assert!(points(&ply["corners"]) == corners);
    assert_eq!(ply["colors"], ply["vertex_colors"]);

    let glb = read(&python, "glb", &place.path("p.glb"));
    // glTF is y up, and its positions are f32 relative to the middle of a scene of some metres.
    let upright = points(&glb["corners"]).into_iter().map(|patch| {
        let [a, b, c] = [0, 3, 6].map(|at: usize| [patch[at], -patch[at + 2], patch[at + 1]]);
        [a, b, c].concat().try_into().expect("nine coordinates")
    });
    assert_corners(&upright.collect::<Vec<[f64; 9]>>(), &store, 1e-6);
    assert!(glb["words"] == serde_json::json!({ "object": words("object", OBJECTS) }));

    // The scale goes from viridis's first colour to its last, and the same number has the same colour.
    let seen: Vec<f64> = known["seen"].iter().map(|seen| seen.expect("a number")).collect();
    let least = seen.iter().copied().fold(f64::INFINITY, f64::min);
    let most = seen.iter().copied().fold(0.0, f64::max);
    assert!(least < most);
    let screen = |color: &Value| [0, 1, 2].map(|c: usize| color[c].as_u64().expect("a channel"));
    for (patch, &value) in seen.iter().enumerate() {
        let shown = screen(&ply["colors"][patch]);
        if value == least {
            assert_eq!(shown, [68, 1, 84]);
        } else if value == most {
            assert_eq!(shown, [253, 231, 37]);
        }
        for channel in 0..3 {
            let light = f64::from(u32::try_from(shown[channel]).expect("8 bits")) / 255.0;
            let light = if light <= 0.04045 {
                light / 12.92
            } else {
                ((light + 0.055) / 1.055).powf(2.4)
            };
            let linear = glb["colors"][patch][channel].as_f64().expect("a channel");
            assert!((linear / 65535.0 - light).abs() < 1e-4, "{linear} {light}");
        }
    }
}

#[test]
fn khronos_validates_the_glb() {
    let Some(mut node) = node("formats::khronos_validates_the_glb", "gltf-validator") else {
        return;
    };
    let place = yard();
    for (file, more) in [
        ("a.glb", "--up y"),
        ("b.glb", "--show escaped --range 0,1"),
        ("c.glb", "--show area"),
    ] {
        place.line(&format!("export F -o {file} --scene yard.obj {more}")).is(0);
    }
    // A file that is wrong in one place: a count of vertices.
    let mut wrong = std::fs::read(place.path("a.glb")).expect("a file");
    let key = b"\"count\":";
    let at = wrong
        .windows(key.len())
        .position(|bytes| bytes == key)
        .expect("an accessor")
        + key.len();
    wrong[at] = b'9';
    std::fs::write(place.path("wrong.glb"), wrong).expect("a file");
    let files = ["a.glb", "b.glb", "c.glb", "wrong.glb"].map(|file| place.path(file));
    let reports = json_of(node.args(["-e", VALIDATE]).args(&files));
    for report in &reports.as_array().expect("reports")[..3] {
        let issues = &report["issues"];
        for kind in ["numErrors", "numWarnings", "numInfos", "numHints"] {
            assert_eq!(issues[kind], 0, "{report}");
        }
        assert_eq!(report["info"]["totalTriangleCount"], 2 * 6 * 16);
        assert_eq!(report["info"]["drawCallCount"], 2);
    }
    assert!(
        reports[3]["issues"]["numErrors"]
            .as_u64()
            .is_some_and(|errors| errors > 0),
        "a wrong file was not noticed: {}",
        reports[3]
    );
}

#[test]
fn duckdb_finds_every_factor() {
    let Some(python) = python("formats::duckdb_finds_every_factor", &["duckdb", "numpy"]) else {
        return;
    };
    let place = yard();
    parquet_is_the_store(&place, &|path| {
        let found = read(&python, "duckdb", path);
        assert_eq!(found["types"], serde_json::json!(["int32", "int32", "float32"]));
        found
    });
}

/// Results by surface over moments, as their `.csv` has them: light in bands, and heat.
#[test]
fn duckdb_finds_every_result_of_every_moment() {
    let Some(python) = python("formats::duckdb_finds_every_result_of_every_moment", &["duckdb"]) else {
        return;
    };
    let place = yard();
    place.write(
        "suns.csv",
        "time,x,y,z,direct,diffuse\nnoon,0,0,1,800,100\nlow,1,0,1,500,60\n",
    );
    let heat = "solve F --thermal --materials h.toml --suns suns.csv --sky-temperature 270 --by material";
    place.write(
        "h.toml",
        "[default]\nemissivity = 0.9\nabsorptance = 0.6\nadiabatic = true\n",
    );
    for (line, file) in [
        ("solve F --materials m.toml --suns suns.csv --by material", "light"),
        (heat, "heat"),
    ] {
        place.line(&format!("{line} -o {file}.csv -o {file}.parquet")).is(0);
        let found = read(&python, "duckdb_table", &place.path(format!("{file}.parquet")));
        let text = std::fs::read_to_string(place.path(format!("{file}.csv"))).expect("a table");
        let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let head = lines.next().expect("a head");
        assert_eq!(found["names"], serde_json::json!(head), "{file}");
        let types = found["types"].as_array().expect("types");
        assert!(types[0] == "VARCHAR" && types[1] == "VARCHAR" && types[2..].iter().all(|kind| kind == "DOUBLE"));
        let cells = |line: Vec<&str>| -> Vec<Value> {
            let cell = |(at, cell): (usize, &str)| match at {
                0 | 1 => Value::from(cell),
                _ => cell.parse::<f64>().ok().map_or(Value::Null, Value::from),
            };
            line.into_iter().enumerate().map(cell).collect()
        };
        let wanted: Vec<Vec<Value>> = lines.map(cells).collect();
        assert!(
            wanted.len() >= 4 && found["rows"] == serde_json::json!(wanted),
            "{file}: {found}"
        );
    }
}

/// The matrix of both forms of a store, by a reader.
fn parquet_is_the_store(place: &Place, reader: &dyn Fn(&Path) -> Value) {
    place
        .line("compute yard.obj --two-sided on --split 8 --form compact -o C --config=none")
        .is(0);
    for (directory, file) in [("F", "F.parquet"), ("C", "C.parquet")] {
        place
            .line(&format!("export {directory} -o {file}"))
            .is(0)
            .says(&["DuckDB", "from row to col"]);
        let store = Store::open(&place.path(directory)).expect("a store");
        let found = reader(&place.path(file));
        let entries = entries(&store);
        assert!(entries.len() > 3000 && read_entries(&found) == entries, "{file}");
        let metadata = &found["metadata"];
        assert_eq!(metadata["hemicube.patch_count"], store.patch_count().to_string());
        assert_eq!(metadata["hemicube.scene_blake3"], store.manifest().scene.blake3);
    }
}

#[test]
fn two_exports_have_the_same_bytes() {
    let place = yard();
    for file in ["p.vtp", "p.vtu", "p.glb", "p.ply", "p.csv", "p.npz", "F.parquet"] {
        let more = match file {
            "F.parquet" => "",
            "p.npz" => "--results --scene yard.obj",
            _ => "--scene yard.obj",
        };
        let mut bytes = Vec::new();
        for overwrite in ["", "--overwrite"] {
            place.line(&format!("export F -o {file} {more} {overwrite}")).is(0);
            bytes.push(std::fs::read(place.path(file)).expect("a file"));
        }
        assert!(bytes[0] == bytes[1] && bytes[0].len() > 1000, "{file}");
        place
            .line(&format!("export F -o {file} {more}"))
            .is(2)
            .says(&["exists", "--overwrite"]);
    }
}

/// The book's page of formats has every extension of the tables.
#[test]
fn the_book_lists_every_format() {
    let page = std::fs::read_to_string(workspace().join("docs/formats.md")).expect("the page");
    let page = page.to_lowercase();
    let scenes = hemicube_scene::Format::ALL
        .iter()
        .flat_map(|format| format.extensions());
    let matrices = ExportFormat::ALL.iter().flat_map(|format| format.extensions());
    let patches = PatchFormat::ALL.iter().flat_map(|format| format.extensions());
    let missing = |page: &str| {
        let all = scenes.clone().chain(matrices.clone()).chain(patches.clone());
        all.filter(|extension| !page.contains(&format!("`.{extension}")))
            .count()
    };
    assert_eq!(missing(&page), 0, "docs/formats.md lacks formats");
    assert_eq!(
        missing(&page.replace("`.mtx`", "")),
        1,
        "a missing format was not noticed"
    );
}

#[test]
fn a_cancelled_file_leaves_nothing() {
    let place = yard();
    let store = Store::open(&place.path("F")).expect("a store");
    let results = PatchResults::read(&store, &["radiosity"]).expect("results");
    std::fs::create_dir(place.path("out")).expect("a directory");
    let left = || std::fs::read_dir(place.path("out")).expect("a directory").count();
    for cancelled in [true, false] {
        let cancel = AtomicBool::new(cancelled);
        let options = WriteOptions {
            overwrite: false,
            cancel: &cancel,
        };
        let csv = place.path("out/p.csv");
        let written = write_patches(&results, &csv, PatchFormat::Csv, options);
        let mut all = vec![written];
        for format in ExportFormat::ALL {
            let path = place.path("out/F").with_extension(format.extensions()[0]);
            let options = ExportOptions {
                cancel: Some(&cancel),
                ..ExportOptions::default()
            };
            all.push(export(&store, &path, *format, options).map(|report| report.bytes));
        }
        let count = all.len();
        for written in all {
            assert_eq!(matches!(written, Err(Error::Interrupted { .. })), cancelled);
            assert_eq!(written.is_ok(), !cancelled);
        }
        assert_eq!(left(), if cancelled { 0 } else { count });
    }
    // Formats of places and colours are refused before there is a file.
    let cancel = AtomicBool::new(false);
    let options = WriteOptions {
        overwrite: false,
        cancel: &cancel,
    };
    let path = place.path("out/p.glb");
    let refused = write_patches(&results, &path, PatchFormat::Glb, options);
    assert!(matches!(refused, Err(Error::Missing { .. })) && !path.exists());
}

#[test]
fn what_is_asked_for_is_said_to_be_wrong() {
    let place = yard();
    for (line, words) in [
        (
            "export F -o p.glb --scene yard.obj --show seem",
            &["no `seem`", "escaped", "radiosity_red"][..],
        ),
        (
            "export F -o p.glb --scene yard.obj --show radiosity --range 0,1",
            &["--range", "radiosity_red"],
        ),
        (
            "export F -o p.vtp --scene yard.obj --show seen",
            &["--show", "no meaning"],
        ),
        (
            "export F -o F.npz --scene yard.obj",
            &["--scene", "no meaning", "--results"],
        ),
        ("export F -o F.parquet --results", &["--results", "no meaning"]),
        (
            "export F -o p.csv --by object --results",
            &["--results", "cannot be used"],
        ),
        ("export F -o p.csv --solution thermal", &["thermal", "radiosity"]),
        ("export F -o p.xyz", &[".vtp", ".parquet", ".npz"]),
        ("export F -o p.vtp --scene F", &["F"]),
    ] {
        place.line(line).is(2).says(words);
    }
    for file in ["p.vtp", "p.glb", "p.csv", "F.npz", "F.parquet"] {
        assert!(!place.path(file).exists(), "{file}");
    }
}

#[test]
fn rows_that_were_not_computed_are_empty() {
    let place = yard();
    place
        .line("compute yard.obj --two-sided on --split 4 --rows 5..9 -o R --config=none")
        .is(0);
    place.line("export R -o r.csv").is(0);
    place.line("export R -o r.ply --scene yard.obj --show seen").is(0);
    let text = std::fs::read_to_string(place.path("r.csv")).expect("a table");
    let store = Store::open(&place.path("R")).expect("a store");
    let known = known(&store);
    assert_eq!(known["seen"].iter().flatten().count(), 4);
    let mut lines = text.lines();
    let fields: Vec<&str> = lines.next().expect("a header").split(',').collect();
    // The name of an object has commas, and columns after it are found from the end.
    let from_end = fields.len() - fields.iter().position(|&name| name == "seen").expect("a column");
    for (line, seen) in lines.zip(&known["seen"]) {
        let found = line.rsplit(',').nth(from_end - 1).expect("a field");
        assert_eq!(found, seen.map_or(String::new(), |seen| seen.to_string()));
    }
}

#[test]
#[ignore = "VTK takes 500 MB: ./test --full"]
fn vtk_finds_every_value() {
    let Some(python) = python("formats::vtk_finds_every_value", &["vtkmodules.vtkIOXML", "numpy"]) else {
        return;
    };
    let place = yard();
    let store = Store::open(&place.path("F")).expect("a store");
    for file in ["p.vtp", "p.vtu"] {
        place.line(&format!("export F -o {file} --scene yard.obj")).is(0);
        let found = read(&python, "vtk", &place.path(file));
        assert_columns(&found, &known(&store), &[]);
        assert_corners(&points(&found["corners"]), &store, 1e-9);
        assert_eq!(found["points"], 3 * 25 - 2 * 5);
        if file == "p.vtp" {
            assert_eq!(
                found["names"],
                serde_json::json!({ "object": OBJECTS, "material": ["grass", "red brick"] })
            );
        }
    }
}

#[test]
#[ignore = "pyarrow takes 170 MB: ./test --full"]
fn pyarrow_finds_every_factor() {
    let Some(python) = python("formats::pyarrow_finds_every_factor", &["pyarrow.parquet"]) else {
        return;
    };
    parquet_is_the_store(&yard(), &|path| {
        let found = read(&python, "pyarrow", path);
        assert_eq!(found["types"], serde_json::json!(["int32", "int32", "float"]));
        found
    });
}

#[test]
#[ignore = "GNU Octave takes 300 MB: ./test --full"]
fn octave_finds_every_factor() {
    if Command::new("octave-cli").arg("--version").output().is_err() {
        skip(
            "formats::octave_finds_every_factor",
            "GNU Octave is not installed",
            "HEMICUBE_REQUIRE_OCTAVE",
        );
        return;
    }
    let place = yard();
    place.line("export F -o F.txt").is(0).says(&["spconvert"]);
    let code = "F = spconvert(load('F.txt')); printf('%d %d\\n', size(F)); [i, j, v] = find(F); \
                printf('%d %d %.9g\\n', [i - 1, j - 1, v]');";
    let output = Command::new("octave-cli")
        .args(["--no-gui", "--norc", "--eval", code])
        .current_dir(place.path("."))
        .output()
        .expect("Octave runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).expect("text");
    let mut lines = text.lines();
    let store = Store::open(&place.path("F")).expect("a store");
    assert_eq!(lines.next(), Some(format!("{0} {0}", store.patch_count()).as_str()));
    let entry = |line: &str| {
        let mut words = line.split(' ');
        let mut next = || words.next().expect("three numbers");
        let place = (next().parse().expect("a row"), next().parse().expect("a column"));
        (place, next().parse().expect("a factor"))
    };
    let found: BTreeMap<(u64, u64), f64> = lines.map(entry).collect();
    assert!(
        found == entries(&store),
        "Octave reads other factors than the store has"
    );
}
