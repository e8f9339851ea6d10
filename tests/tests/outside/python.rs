//! SciPy and NumPy open what is written: a part of a store, and the exports. Each value is compared with the computed
//! one.
//!
//! Needs Python with SciPy: `HEMICUBE_PYTHON`, otherwise `python3`.

use hemicube::Model;
use hemicube::driver::compute::Execution;
use hemicube::store::{BackendEntry, Form, Header, Part, PatchTable, SceneEntry, Store, StoreWriter, scene_hash};
use hemicube_backend_cpu::CpuBackend;
use hemicube_export::{ExportFormat, ExportOptions, export};
use hemicube_scene::Subdivision;
use hemicube_scene::generate::cornell_box;
use hemicube_tests::readers::python;
use hemicube_tests::rows::{parts, plan, settings};
use hemicube_tests::scenes::{model, workspace};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

const SCIPY: &[&str] = &["numpy", "scipy.sparse", "scipy.io"];

/// Opens the files it is given and prints what is in them, values as the shortest decimals of f64.
const SCRIPT: &str = r#"
import json, sys
import numpy, scipy.io, scipy.sparse

def entries(matrix):
    matrix = scipy.sparse.coo_matrix(matrix)
    return {"shape": list(matrix.shape), "type": str(matrix.dtype),
            "entries": sorted([int(i), int(j), float(numpy.float32(v))]
                              for i, j, v in zip(matrix.row, matrix.col, matrix.data))}

part, npz, mtx, txt, npy, patches = sys.argv[1:]
whole = scipy.sparse.load_npz(npz)
triplets = numpy.loadtxt(txt)
dense = numpy.load(npy)
with numpy.load(part) as archive:
    rows = {"rows": archive["rows"].tolist(), "sums": archive["sums"].tolist(),
            "hemicubes": archive["hemicubes"].tolist()}
with numpy.load(patches) as archive:
    table = {"area": archive["area"].tolist(), "blocked": archive["blocked"].tolist(),
             "row_sum": archive["row_sum"].tolist()}
json.dump({
    "part": entries(scipy.sparse.load_npz(part)), "rows": rows, "patches": table,
    "npz": entries(whole), "format": whole.format, "sorted": bool(whole.has_sorted_indices),
    "mtx": entries(scipy.io.mmread(mtx)),
    "txt": entries(scipy.sparse.coo_matrix((triplets[:, 2], (triplets[:, 0].astype(int) - 1, triplets[:, 1].astype(int) - 1)))),
    "npy": entries(dense), "contiguous": bool(dense.flags["C_CONTIGUOUS"]),
    "product": float((whole @ numpy.ones(whole.shape[1])).sum()),
}, sys.stdout)
"#;

/// Decodes the parts it is given with the function in the documentation, and prints what `SCRIPT` prints of a matrix.
const COMPACT_SCRIPT: &str = r#"
import json, sys
json.dump([{"shape": list(m.shape), "sorted": bool(m.has_sorted_indices), "type": str(m.dtype),
            "entries": [[int(i), int(j), float(v)] for i, j, v in zip(m.tocoo().row, m.tocoo().col, m.data)]}
           for m in map(compact_part, sys.argv[1:])], sys.stdout)
"#;

/// Loads a store with the function in the documentation, and prints it.
const LOAD_SCRIPT: &str = r#"
import sys
m = load(sys.argv[1]).tocoo()
json.dump({"shape": list(m.shape), "entries": [[int(i), int(j), float(v)] for i, j, v in zip(m.row, m.col, m.data)]}, sys.stdout)
"#;

/// The Python in `docs/store.md` that defines this function.
fn documented(function: &str) -> String {
    let path = workspace().join("docs/store.md");
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("`{}`: {error}", path.display()));
    let blocks = text.split("```python\n").skip(1);
    let mut code = blocks
        .filter_map(|block| block.split_once("```"))
        .map(|(code, _)| code.to_owned());
    code.find(|code| code.contains(&format!("def {function}(")))
        .unwrap_or_else(|| panic!("`docs/store.md` has no `{function}`"))
}

#[test]
fn the_documented_function_reads_compact_parts() {
    let Some(python) = python("python::the_documented_function_reads_compact_parts", SCIPY) else {
        return;
    };
    let model = model(cornell_box(), Subdivision::Levels(2));
    let plan = plan(&model).with_form(Form::Compact);
    let (parts, _) = parts(
        &model,
        &plan,
        settings(64),
        Box::new(CpuBackend::new()),
        Execution::default(),
    )
    .expect("a sound run");
    let place = tempfile::tempdir().expect("a temporary directory");
    let directory = place.path().join("F");
    let table = PatchTable::new(&cornell_box(), model.patches());
    let header = header(&model, plan.rows_per_part, Form::Compact);
    let mut writer = StoreWriter::create(&directory, header, &table, false).expect("a new store");
    parts
        .iter()
        .for_each(|part| writer.write_part(part).expect("a part is written"));
    let manifest = writer.finish().expect("all parts are there");
    let output = Command::new(python)
        .args(["-c", &format!("{}{COMPACT_SCRIPT}", documented("compact_part"))])
        .args(manifest.parts.iter().map(|part| directory.join(&part.file)))
        .output()
        .expect("Python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Vec<Value> = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(parts.len() > 1 && found.len() == parts.len());
    for (part, found) in parts.iter().zip(&found) {
        assert!(part.data.len() > 100);
        assert_eq!(entries(found), computed(std::slice::from_ref(part), false));
        assert_eq!(found["shape"], json!([part.rows.len(), model.geometry().patch_count]));
        assert_eq!((&found["sorted"], &found["type"]), (&json!(true), &json!("float32")));
    }
}

type Entries = BTreeMap<(u64, u64), f64>;

fn entries(value: &Value) -> Entries {
    let list = value["entries"].as_array().expect("a list of entries");
    let number = |v: &Value| v.as_u64().expect("an index");
    let entry = |e: &Value| {
        let factor = e[2].as_f64().expect("a number");
        ((number(&e[0]), number(&e[1])), factor)
    };
    let map: Entries = list.iter().map(entry).collect();
    assert_eq!(map.len(), list.len(), "an entry twice");
    map
}

/// The entries of some parts: by the patch of the row, or by the row's place in its part.
fn computed(parts: &[Part], by_patch: bool) -> Entries {
    let mut all = Entries::new();
    for part in parts {
        for (k, &patch) in part.rows.iter().enumerate() {
            let (columns, factors) = part.row(k);
            for (&column, factor) in columns.iter().zip(factors) {
                let row = if by_patch { u64::from(patch) } else { k as u64 };
                all.insert((row, u64::try_from(column).expect("a column")), factor);
            }
        }
    }
    all
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a temporary path is text")
}

/// Of a store with all rows.
fn header(model: &Model, rows_per_part: u32, form: Form) -> Header {
    let patch_count = model.geometry().patch_count;
    let scene = cornell_box();
    Header {
        program: "test".to_owned(),
        scene: SceneEntry {
            file: "room".to_owned(),
            blake3: scene_hash(&scene, model.patches()),
        },
        settings: json!({ "resolution": 64 }),
        correction: "pixel".to_owned(),
        patch_count,
        row_count: patch_count,
        rows_per_part,
        form,
        min_factor: 0.0,
        backend: BackendEntry {
            name: "cpu".to_owned(),
            version: "1".to_owned(),
        },
        objects: scene.objects.clone(),
        materials: scene.materials.iter().map(|m| m.name.clone()).collect(),
    }
}

#[test]
fn scipy_opens_everything() {
    let Some(python) = python("python::scipy_opens_everything", SCIPY) else {
        return;
    };
    let mut scene = cornell_box();
    scene.triangles.rotate_left(7);
    let model = model(scene.clone(), Subdivision::Levels(1));
    let plan = plan(&model);
    let (computed_parts, _) = parts(
        &model,
        &plan,
        settings(64),
        Box::new(CpuBackend::new()),
        Execution::default(),
    )
    .expect("a sound run");
    let place = tempfile::tempdir().expect("a temporary directory");
    let directory = place.path().join("F");
    let patch_count = model.geometry().patch_count;
    let header = header(&model, plan.rows_per_part, Form::Plain);
    let table = PatchTable::new(&scene, model.patches());
    let mut writer = StoreWriter::create(&directory, header, &table, false).expect("a new store");
    computed_parts
        .iter()
        .for_each(|part| writer.write_part(part).expect("a part is written"));
    let manifest = writer.finish().expect("all parts are there");
    assert!(
        manifest.parts.len() > 1,
        "more than one part, or rows need no gathering"
    );

    let store = Store::open(&directory).expect("a store");
    let files = ["F.npz", "F.mtx", "F.txt", "F.npy"].map(|name| place.path().join(name));
    for file in &files {
        let format = ExportFormat::of(file).expect("a known extension");
        export(&store, file, format, ExportOptions::default()).expect("an export");
    }
    let code = documented("load");
    assert!(
        code.lines().filter(|line| !line.trim().is_empty()).count() <= 10,
        "{code}"
    );
    let loaded = Command::new(&python)
        .args(["-c", &format!("{code}{LOAD_SCRIPT}"), text(&directory)])
        .output()
        .expect("Python runs");
    assert!(loaded.status.success(), "{}", String::from_utf8_lossy(&loaded.stderr));
    let loaded: Value = serde_json::from_slice(&loaded.stdout).expect("JSON");
    assert_eq!(loaded["shape"], json!([patch_count, patch_count]));
    assert!(
        entries(&loaded) == computed(&computed_parts, true),
        "what `load` reads is not what was computed"
    );

    let part = directory.join(&manifest.parts[1].file);
    let output = Command::new(python)
        .args(["-c", SCRIPT, text(&part)])
        .args(files.iter().map(|file| text(file)))
        .arg(text(&directory.join("patches.npz")))
        .output()
        .expect("Python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Value = serde_json::from_slice(&output.stdout).expect("JSON");

    let whole = computed(&computed_parts, true);
    assert!(whole.len() > 5_000 && whole.values().all(|&factor| factor > 0.0));
    for export in ["npz", "mtx", "txt", "npy"] {
        assert_eq!(found[export]["shape"], json!([patch_count, patch_count]), "{export}");
        let mut read = entries(&found[export]);
        // The last line of triplets gives the size, as an explicit zero where the corner is empty.
        read.retain(|_, factor| *factor != 0.0);
        assert!(read == whole, "{export}: other entries than were computed");
    }
    assert_eq!(found["npz"]["type"], "float32");
    assert_eq!(found["npy"]["type"], "float32");
    assert_eq!(
        (&found["format"], &found["sorted"], &found["contiguous"]),
        (&json!("csr"), &json!(true), &json!(true))
    );
    let sum: f64 = whole.values().sum();
    assert!((found["product"].as_f64().expect("a number") - sum).abs() < 1e-9 * sum);

    let one = &computed_parts[1];
    assert_eq!(entries(&found["part"]), computed(std::slice::from_ref(one), false));
    assert_eq!(found["part"]["shape"], json!([one.rows.len(), patch_count]));
    assert_eq!(found["rows"]["rows"], json!(one.rows));
    assert_eq!(found["rows"]["hemicubes"], json!(one.hemicubes));
    let sums: Vec<[u64; 4]> = one
        .sums
        .iter()
        .map(|s| [s.visible, s.escaped, s.blocked, s.unselected])
        .collect();
    assert_eq!(found["rows"]["sums"], json!(sums));

    let areas = found["patches"]["area"].as_array().expect("a column");
    assert_eq!(areas.len(), table.area.len());
    for (read, area) in areas.iter().zip(&table.area) {
        // The JSON between may be read one unit in the last place off.
        assert!((read.as_f64().expect("a number") / area - 1.0).abs() < 1e-15);
    }
    let blocked = found["patches"]["blocked"].as_array().expect("a column");
    let row_sums = found["patches"]["row_sum"].as_array().expect("a column");
    assert_eq!(
        (blocked.len(), row_sums.len()),
        (patch_count as usize, patch_count as usize)
    );
    for (blocked, sum) in blocked.iter().zip(row_sums) {
        let total = blocked.as_f64().expect("a number") + sum.as_f64().expect("a number");
        // Each of some hundred entries was rounded to an f32.
        assert!((total - 1.0).abs() < 1e-5, "a row of a closed room sums to {total}");
    }
    let mut wrong = whole;
    wrong
        .values_mut()
        .next()
        .into_iter()
        .for_each(|factor| *factor = f64::from_bits(factor.to_bits() + 1));
    assert!(entries(&found["npz"]) != wrong, "one bit of one entry was not noticed");
}
