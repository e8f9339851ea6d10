//! The glTF reader on real files, on the official validator's and generator's files, and on small files made here.

#![cfg(feature = "gltf")]
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "tests report what they read and what they skipped"
)]

use glam::{DMat3, DVec3};
use hemicube_scene::{Axis, Budget, Error, ErrorKind, ReadOptions, Scene, Triangle, gltf};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The folder of real scenes, or a loud line and nothing.
fn scenes(test: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("HEMICUBE_SCENES").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes"),
        PathBuf::from,
    );
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIP {test}: no ../shared/scenes");
    None
}

const GEOMETRY: ReadOptions = ReadOptions {
    optics: false,
    allow_large: false,
    budget: Budget::new(None),
};
const OPTICS: ReadOptions = ReadOptions {
    optics: true,
    allow_large: false,
    budget: Budget::new(None),
};

fn read_file(path: &Path) -> Result<Scene, Error> {
    gltf::read(&std::fs::read(path).expect("a scene file"), path.parent(), OPTICS)
}

fn area(triangles: &[Triangle]) -> f64 {
    triangles.iter().map(|t| 0.5 * normal(t).length()).sum()
}

/// Normal, as long as twice the area.
fn normal(triangle: &Triangle) -> DVec3 {
    let [a, b, c] = triangle.corners;
    (b - a).cross(c - a)
}

/// All files below `folder` with an extension of glTF, sorted.
fn gltf_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder of scenes") {
            let path = entry.expect("a folder entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "gltf" || e == "glb") {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

fn outcome(result: &Result<Scene, Error>) -> String {
    match result {
        Ok(scene) => format!("{} triangles", scene.triangles.len()),
        Err(e) => format!("refused: {e}"),
    }
}

/// The same file with a node for every mesh and nothing else to show, so that its meshes are really read.
fn with_all_meshes_placed(json: &[u8]) -> Option<Vec<u8>> {
    let mut root: Value = serde_json::from_slice(json).ok()?;
    let count = root.get("meshes")?.as_array()?.len();
    let root = root.as_object_mut()?;
    root.remove("scene");
    root.remove("scenes");
    root.insert(
        "nodes".to_owned(),
        (0..count).map(|mesh| json!({ "mesh": mesh })).collect(),
    );
    serde_json::to_vec(root).ok()
}

/// What must come of a file, as it is or with all its meshes placed.
enum Expected {
    Triangles(usize),
    /// Words of the refusal.
    Refused(&'static str),
}
use Expected::{Refused, Triangles};

/// Of the validator's files as they are.
const VALIDATOR: [(&str, Expected); 44] = [
    (
        "accessor/unresolved_bufferviews.gltf",
        Refused("`accessors[0].bufferView` is "),
    ),
    ("accessor/valid.gltf", Triangles(0)),
    ("asset/1_0_version.gltf", Refused("`1.0`; only glTF 2 is read: convert")),
    ("asset/2_1_version.gltf", Triangles(0)),
    (
        "asset/invalid_version.gltf",
        Refused("`asset.version` is not a version"),
    ),
    ("asset/min_version_invalid.gltf", Refused("`asset.minVersion` is `2.1`")),
    (
        "buffer_view/unresolved_buffer.gltf",
        Refused("`bufferViews[0].buffer` is "),
    ),
    ("buffer/not_found.gltf", Triangles(0)),
    ("glb/chunk_too_big.glb", Refused("chunk 0 of the GLB")),
    ("glb/empty_file.glb", Refused("is empty")),
    ("glb/empty_json_object.glb", Refused("`asset` is missing")),
    ("glb/extra_data.glb", Triangles(0)),
    (
        "glb/invalid_json_chunk.glb",
        Refused("the JSON chunk of the GLB cannot be read"),
    ),
    ("glb/invalid_magic.glb", Refused("is neither GLB nor the JSON")),
    ("glb/invalid_version.glb", Refused("GLB of version 0; only version 2")),
    ("glb/json_and_two_buffers.glb", Refused("a second BIN chunk")),
    (
        "glb/length_mismatch.glb",
        Refused("claims 49 bytes, but the file has 48: it is cut off"),
    ),
    (
        "glb/only_bin_chunk.glb",
        Refused("the first chunk of the GLB is not its JSON"),
    ),
    ("glb/only_header.glb", Refused("has no JSON chunk")),
    (
        "glb/truncated_chunk_data.glb",
        Refused("it is cut off; fetch the file again"),
    ),
    ("glb/two_valid_json_chunks.glb", Refused("a second JSON chunk")),
    ("glb/zero_length.glb", Refused("claims 0 bytes")),
    ("json/bom.gltf", Triangles(0)),
    ("json/empty_file.gltf", Refused("is empty")),
    ("json/integer_written_as_float.gltf", Triangles(0)),
    ("json/invalid_object.gltf", Refused("the JSON is not an object")),
    ("json/invalid_syntax.gltf", Refused("line 1: the JSON cannot be read")),
    (
        "mesh/indices_invalid_format.gltf",
        Refused("which does not hold indices"),
    ),
    (
        "mesh/position_accessor_invalid_format.gltf",
        Refused("which does not hold positions"),
    ),
    (
        "mesh/unresolved_indices.gltf",
        Refused("`meshes[0].primitives[0].indices` is 1, but the file has 1 `accessors`"),
    ),
    (
        "mesh/unresolved_material.gltf",
        Refused("`meshes[0].primitives[0].material` is 0"),
    ),
    (
        "mesh/unresolved_positions.gltf",
        Refused("`meshes[0].primitives[0].attributes.POSITION` is 0"),
    ),
    (
        "node/infinite_transform.gltf",
        Refused("line 8: the JSON cannot be read (number out of range"),
    ),
    (
        "node/matrix_indecomposable.gltf",
        Refused("the last row of `nodes[0].matrix`"),
    ),
    ("node/matrix_trs.gltf", Refused("`nodes[0]` has a `matrix` beside")),
    ("node/node_loop.gltf", Refused("is among its own descendants")),
    (
        "node/node_parent_override.gltf",
        Refused("is a child of `nodes[0]` and again of `nodes[1]`"),
    ),
    (
        "node/unresolved_mesh.gltf",
        Refused("`nodes[0].mesh` is 0, but the file has 0 `meshes`"),
    ),
    ("node/valid.gltf", Triangles(1)),
    ("root/named_objects.gltf", Refused("`buffers[0]` has no `uri`")),
    (
        "root/undefined_used_extensions.gltf",
        Refused("requires the extension `KHR_extension`"),
    ),
    (
        "scene/non_root_node.gltf",
        Refused("lists `nodes[1]` as a root, but it is a child"),
    ),
    (
        "scene/unresolved_default_scene.gltf",
        Refused("`scene` is 0, but the file has 0 `scenes`"),
    ),
    ("scene/valid.gltf", Triangles(0)),
];

/// Of the validator's files with all their meshes placed.
const VALIDATOR_PLACED: [(&str, Expected); 11] = [
    ("KHR_mesh_quantization/primitive/valid.gltf", Triangles(1)),
    ("json/integer_written_as_float.gltf", Triangles(1)),
    ("mesh/morph_unequal_targets_count.gltf", Triangles(6)),
    ("mesh/primitive_generated_tangent_space.gltf", Triangles(4)),
    ("mesh/primitive_incompatible_mode.gltf", Triangles(1)),
    ("mesh/primitive_no_position.gltf", Triangles(0)),
    ("mesh/uv.gltf", Triangles(3)),
    ("mesh/valid.gltf", Triangles(2)),
    ("mesh_data/index_buffer_degenerate_triangle.gltf", Triangles(3)),
    (
        "mesh_data/index_buffer_oob.gltf",
        Refused("index 5 is 5, but there are 4 positions"),
    ),
    (
        "mesh_data/index_buffer_primitive_restart.gltf",
        Refused("index 2 is 255, the value for primitive restart"),
    ),
];

fn assert_expected(file: &str, expected: &Expected, result: &Result<Scene, Error>) {
    match (expected, result) {
        (Triangles(count), Ok(scene)) => assert_eq!(scene.triangles.len(), *count, "{file}"),
        (Refused(words), Err(e)) => assert!(e.to_string().contains(words), "{file}: `{e}` lacks `{words}`"),
        _ => panic!("{file}: {}", outcome(result)),
    }
}

#[test]
fn the_validators_files_load_or_are_refused() {
    let Some(folder) = scenes("the_validators_files_load_or_are_refused") else {
        return;
    };
    let folder = folder.join("gltf/khronos-validator");
    let files = gltf_files(&folder);
    assert_eq!(files.len(), 179);
    let began = Instant::now();
    let (mut loaded, mut refused, mut placed) = (0, 0, 0);
    let (mut met, mut met_placed) = (0, 0);
    for path in &files {
        let name = path
            .strip_prefix(&folder)
            .expect("below the folder")
            .to_str()
            .expect("a plain name");
        let result = read_file(path);
        match &result {
            Ok(_) => loaded += 1,
            Err(e) => {
                refused += 1;
                let message = e.to_string();
                assert!(
                    ["export", "fetch", "convert"].iter().any(|step| message.contains(step)),
                    "{name}: no next step in `{message}`"
                );
            }
        }
        if let Some((_, expected)) = VALIDATOR.iter().find(|(file, _)| *file == name) {
            assert_expected(name, expected, &result);
            met += 1;
        }
        let bytes = std::fs::read(path).expect("a scene file");
        if let Some(changed) = with_all_meshes_placed(&bytes) {
            let result = gltf::read(&changed, path.parent(), GEOMETRY);
            placed += 1;
            if let Some((_, expected)) = VALIDATOR_PLACED.iter().find(|(file, _)| *file == name) {
                assert_expected(name, expected, &result);
                met_placed += 1;
            }
        }
    }
    assert_eq!(
        (met, met_placed),
        (VALIDATOR.len(), VALIDATOR_PLACED.len()),
        "files of the tables are missing"
    );
    println!("{loaded} of 179 loaded, {refused} refused; {placed} read again with all meshes placed");
    assert!(began.elapsed() < Duration::from_secs(20), "{:?}", began.elapsed());
}

/// Files whose row in the manifest was made by a reader that did not refuse what must be refused.
const REFUSED: [(&str, &str); 9] = [
    (
        "gltf/khronos-asset-generator/Compatibility/Compatibility_04.gltf",
        "`asset.minVersion` is `2.1`",
    ),
    (
        "gltf/khronos-asset-generator/Compatibility/Compatibility_05.gltf",
        "requires the extension `EXT_QuantumRendering`",
    ),
    (
        "gltf/misc/gltf-transform/BoxDraco.gltf",
        "export without Draco compression",
    ),
    (
        "gltf/misc/gltf-transform/BoxMeshopt.glb",
        "export without meshopt compression",
    ),
    (
        "gltf/misc/gltf-transform/DenseSphere.glb",
        "export without Draco compression",
    ),
    (
        "gltf/misc/tinygltf/integer-out-of-bounds.gltf",
        "`bufferViews[0].byteLength` is 1e+300",
    ),
    (
        "gltf/misc/tinygltf/invalid-buffer-index.gltf",
        "`bufferViews[1].buffer` is 1, but the file has 1 `buffers`",
    ),
    (
        "gltf/misc/tinygltf/invalid-buffer-view-index.gltf",
        "`bufferViews[0].buffer` is 0, but the file has 0 `buffers`",
    ),
    (
        "gltf/misc/tinygltf/invalid-primitive-indices.gltf",
        "`bufferViews[0].buffer` is 0, but the file has 0 `buffers`",
    ),
];

/// Rows of the manifest that are glTF, not the validator's, and not refused.
const COMPARED: usize = 76;

#[test]
fn real_files_have_the_triangles_and_areas_of_the_manifest() {
    let Some(folder) = scenes("real_files_have_the_triangles_and_areas_of_the_manifest") else {
        return;
    };
    let manifest = std::fs::read_to_string(folder.join("manifest.tsv")).expect("the manifest");
    let (mut compared, mut refused) = (0, 0);
    for line in manifest.lines().skip(1) {
        let columns: Vec<&str> = line.split('\t').collect();
        let file = columns[0];
        if !(file.ends_with(".gltf") || file.ends_with(".glb")) || file.contains("khronos-validator") {
            continue;
        }
        let result = read_file(&folder.join(file));
        if let Some((_, words)) = REFUSED.iter().find(|(name, _)| *name == file) {
            assert_expected(file, &Refused(words), &result);
            refused += 1;
            continue;
        }
        let scene = result.unwrap_or_else(|e| panic!("{file}: {e}"));
        assert_eq!(
            scene.triangles.len(),
            columns[2].parse::<usize>().expect("a triangle count"),
            "{file}"
        );
        if let Ok(expected) = columns[11].parse::<f64>() {
            // The manifest gives six decimals.
            let got = area(&scene.triangles);
            assert!(
                (got - expected).abs() <= 1e-6 * expected + 6e-7,
                "{file}: area {got}, manifest {expected}"
            );
        }
        assert!(
            scene.triangles.iter().zip(0..).all(|(t, n)| t.face == n),
            "{file}: faces are not in reading order"
        );
        assert_eq!((scene.up, scene.metres_per_unit), (Some(Axis::Y), Some(1.0)));
        compared += 1;
    }
    println!("{compared} files as the manifest has them, {refused} refused");
    assert_eq!((compared, refused), (COMPARED, REFUSED.len()));
}

#[test]
fn the_hague_nested_and_quantized_agree() {
    let Some(folder) = scenes("the_hague_nested_and_quantized_agree") else {
        return;
    };
    let nested = read_file(&folder.join("city/denhaag-nested.glb")).expect("the nested tile");
    let quantized = read_file(&folder.join("city/denhaag-quantized.glb")).expect("the quantised tile");
    for (scene, expected, tolerance) in [(&nested, 761_092.550_769, 1e-6), (&quantized, 761_099.430_829, 1e-4)] {
        assert_eq!(scene.triangles.len(), 41_183);
        assert_eq!(scene.objects.len(), 1_991);
        let got = area(&scene.triangles);
        assert!(
            (got / expected - 1.0).abs() < tolerance,
            "area {got}, expected {expected}"
        );
    }
    // y is up: the tile is 35 m high and some 800 m wide.
    let heights = nested.triangles.iter().flat_map(|t| t.corners).map(|c| c.y);
    let (low, high) = heights.fold((f64::MAX, f64::MIN), |(low, high), y| (low.min(y), high.max(y)));
    assert!(
        (low - 2.463).abs() < 1e-3 && (high - 37.481).abs() < 1e-3,
        "{low} to {high}"
    );
}

#[test]
fn the_cornell_box_has_its_areas_reflectances_and_emission() {
    let Some(folder) = scenes("the_cornell_box_has_its_areas_reflectances_and_emission") else {
        return;
    };
    let path = folder.join("cornell/cornell-measured-closed.gltf");
    let scene = read_file(&path).expect("the Cornell box");
    let got = area(&scene.triangles);
    assert!((got / 2_224_950.407_677 - 1.0).abs() < 1e-9, "area {got}");
    assert_eq!(scene.objects[0], "floor");
    assert_eq!(scene.objects.len(), 9);
    let material = |name: &str| scene.materials.iter().find(|m| m.name == name).expect("a material");
    assert_eq!(material("green").diffuse, Some([0.14, 0.45, 0.091]));
    assert_eq!(material("white").emission, None);
    let emission = material("light").emission.expect("the light's emission");
    for (got, expected) in emission.into_iter().zip([17.0, 12.0, 4.0]) {
        assert!((got - expected).abs() < 1e-4, "{emission:?}");
    }
    let bytes = std::fs::read(&path).expect("the Cornell box");
    let plain = gltf::read(&bytes, None, GEOMETRY).expect("the Cornell box without its materials' properties");
    assert_eq!(plain.triangles, scene.triangles);
    assert!(
        plain
            .materials
            .iter()
            .all(|m| m.diffuse.is_none() && m.emission.is_none())
    );
}

/// A mirrored copy keeps its outside outside: the normals are those of the unmirrored one, moved by the inverse
/// transpose of the scale.
#[test]
fn negative_scales_of_the_generator_keep_the_outside_outside() {
    let Some(folder) = scenes("negative_scales_of_the_generator_keep_the_outside_outside") else {
        return;
    };
    let folder = folder.join("gltf/khronos-asset-generator/Node_NegativeScale");
    let read = |n: usize| read_file(&folder.join(format!("Node_NegativeScale_{n:02}.gltf"))).expect("a generated file");
    let plain = read(0);
    // Node 1 has the scale (−2, 1, 1) in these files, as `scale` or as `matrix`.
    let inverse_transpose = DMat3::from_diagonal(DVec3::new(-0.5, 1.0, 1.0));
    for n in 3..=8 {
        let mirrored = read(n);
        assert_eq!(mirrored.triangles.iter().filter(|t| t.object == 1).count(), 48);
        for (before, after) in plain.triangles.iter().zip(&mirrored.triangles) {
            let turned = if after.object == 1 {
                inverse_transpose * normal(before)
            } else {
                normal(before)
            };
            let cosine = turned.normalize().dot(normal(after).normalize());
            assert!(cosine > 0.999_999, "file {n}, face {}: {cosine}", after.face);
        }
    }
}

// From here on: files made here, for what the collections do not hold.

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for group in bytes.chunks(3) {
        let bits = group.iter().fold(0_u32, |bits, b| bits << 8 | u32::from(*b)) << (8 * (3 - group.len()));
        for n in 0..=group.len() {
            text.push(char::from(DIGITS[(bits >> (18 - 6 * n) & 63) as usize]));
        }
    }
    while !text.len().is_multiple_of(4) {
        text.push('=');
    }
    text
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// One buffer, one view over all of it.
fn buffer_of(bytes: &[u8]) -> (Value, Value) {
    let uri = format!("data:application/octet-stream;base64,{}", base64(bytes));
    (
        json!([{ "byteLength": bytes.len(), "uri": uri }]),
        json!([{ "buffer": 0, "byteLength": bytes.len() }]),
    )
}

/// One node, one mesh, one primitive with these positions.
fn file_of(positions: &[f32]) -> Value {
    let (buffers, views) = buffer_of(&floats(positions));
    json!({
        "asset": { "version": "2.0" },
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": positions.len() / 3, "type": "VEC3" }],
        "bufferViews": views,
        "buffers": buffers,
    })
}

fn read_json(root: &Value) -> Result<Scene, Error> {
    gltf::read(root.to_string().as_bytes(), None, OPTICS)
}

fn refusal(root: &Value) -> String {
    match read_json(root) {
        Ok(scene) => panic!("{} triangles were read", scene.triangles.len()),
        Err(e) => e.to_string(),
    }
}

const TRIANGLE: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
/// A zigzag (0,0) (1,0) (0,1) (1,1) (0,2) (1,2) in the plane z = 0.
const ZIGZAG: [f32; 18] = [
    0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0, 1.0, 2.0, 0.0,
];

#[test]
fn strips_and_fans_face_one_way() {
    let mut root = file_of(&ZIGZAG);
    root["meshes"][0]["primitives"][0]["mode"] = json!(5);
    let strip = read_json(&root).expect("a strip");
    assert_eq!(strip.triangles.len(), 4);
    assert!(strip.triangles.iter().all(|t| normal(t) == DVec3::Z));

    let mut root = file_of(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    root["meshes"][0]["primitives"][0]["mode"] = json!(6);
    let fan = read_json(&root).expect("a fan");
    assert_eq!(fan.triangles.len(), 2);
    assert!(fan.triangles.iter().all(|t| normal(t) == DVec3::Z));
    assert_eq!(area(&fan.triangles), 1.0);

    root["nodes"][0]["scale"] = json!([1, 1, -1]);
    let mirrored = read_json(&root).expect("a mirrored fan");
    assert!(
        mirrored.triangles.iter().all(|t| normal(t) == -DVec3::Z),
        "mirrored in z, what faced up faces down"
    );
    root["nodes"][0]["scale"] = json!([-1, 1, 1]);
    let mirrored = read_json(&root).expect("a mirrored fan");
    assert!(
        mirrored
            .triangles
            .iter()
            .all(|t| normal(t) == DVec3::Z && t.corners.iter().all(|c| c.x <= 0.0))
    );
}

#[test]
fn a_matrix_of_any_size_mirrors_and_two_mirrors_do_not() {
    for size in [1e-120, 1.0, 1e60] {
        let mut root = file_of(&TRIANGLE);
        root["nodes"] = json!([
            { "mesh": 0, "matrix": [-size, 0, 0, 0, 0, size, 0, 0, 0, 0, size, 0, 0, 0, 0, 1] },
            { "children": [2], "scale": [-size, size, size] },
            { "mesh": 0, "scale": [-1, 1, 1] }
        ]);
        let scene = read_json(&root).expect("two triangles");
        for triangle in &scene.triangles {
            let [a, b, c] = triangle.corners.map(|corner| corner / size);
            assert!((b - a).cross(c - a).z > 0.5, "size {size}: {triangle:?}");
        }
    }
}

#[test]
fn points_lines_and_rests_are_counted() {
    let mut root = file_of(&ZIGZAG[..15]);
    let primitive = |mode: u32| json!({ "attributes": { "POSITION": 0 }, "mode": mode });
    root["meshes"][0]["primitives"] = (0..5).map(primitive).collect();
    let scene = read_json(&root).expect("points, lines and a triangle");
    assert_eq!(scene.triangles.len(), 1);
    assert_eq!(scene.ledger.get("point element"), 5);
    assert_eq!(scene.ledger.get("line element"), 2 + 5 + 4);
    assert_eq!(scene.ledger.get("primitive that ends inside a triangle"), 1);
    root["meshes"][0]["primitives"][0]["mode"] = json!(7);
    assert!(refusal(&root).contains("`meshes[0].primitives[0].mode` is 7"));
}

#[test]
fn quantised_positions_are_exact() {
    let shorts: Vec<u8> = [-32768_i16, 32767, 16384]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let words: Vec<u8> = [0_u16, 65535, 13107].iter().flat_map(|v| v.to_le_bytes()).collect();
    let cases: [(u32, Vec<u8>, bool, [f64; 3]); 6] = [
        (5120, vec![128, 127, 255], true, [-1.0, 1.0, -1.0 / 127.0]),
        (5120, vec![128, 127, 255], false, [-128.0, 127.0, -1.0]),
        (5121, vec![0, 255, 51], true, [0.0, 1.0, 0.2]),
        (5122, shorts.clone(), true, [-1.0, 1.0, 16384.0 / 32767.0]),
        (5122, shorts, false, [-32768.0, 32767.0, 16384.0]),
        (5123, words, true, [0.0, 1.0, 0.2]),
    ];
    for (code, element, normalized, expected) in cases {
        let bytes = element.repeat(3);
        let mut root = file_of(&TRIANGLE);
        let (buffers, views) = buffer_of(&bytes);
        root["buffers"] = buffers;
        root["bufferViews"] = views;
        root["accessors"][0]["componentType"] = json!(code);
        root["accessors"][0]["normalized"] = json!(normalized);
        root["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
        root["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
        let scene = read_json(&root).expect("a quantised triangle");
        assert_eq!(
            scene.triangles[0].corners,
            [DVec3::from_array(expected); 3],
            "type {code}, normalised {normalized}"
        );
        assert!(scene.ledger.entries.is_empty());
    }
    let mut root = file_of(&TRIANGLE);
    root["accessors"][0]["componentType"] = json!(5125);
    assert!(refusal(&root).contains("does not hold positions"));
}

#[test]
fn interleaved_and_sparse_positions_and_indices_of_each_size() {
    // Position and a float that is none, vertex by vertex, after 4 bytes of something else.
    let mut bytes = floats(&[9.0]);
    for corner in TRIANGLE.chunks(3) {
        bytes.extend(floats(corner));
        bytes.extend(floats(&[7.0]));
    }
    let stride = 16;
    for (code, indices) in [
        (5121, vec![2_u8, 1, 0]),
        (5123, vec![2, 0, 1, 0, 0, 0]),
        (5125, [2_u32, 1, 0].iter().flat_map(|i| i.to_le_bytes()).collect()),
    ] {
        let sparse_at = bytes.len();
        let mut all = bytes.clone();
        all.extend([1, 0]); // the sparse index 1, two bytes
        all.extend(floats(&[5.0, 0.0, 0.0]));
        let indices_at = all.len();
        all.extend(&indices);
        let (buffers, _) = buffer_of(&all);
        let root = json!({
            "asset": { "version": "2.0" },
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
            "accessors": [
                { "bufferView": 0, "byteOffset": 4, "componentType": 5126, "count": 3, "type": "VEC3", "sparse": {
                    "count": 1,
                    "indices": { "bufferView": 1, "componentType": 5123 },
                    "values": { "bufferView": 1, "byteOffset": 2 } } },
                { "bufferView": 2, "componentType": code, "count": 3, "type": "SCALAR" }
            ],
            "bufferViews": [
                { "buffer": 0, "byteLength": sparse_at, "byteStride": stride },
                { "buffer": 0, "byteOffset": sparse_at, "byteLength": 14 },
                { "buffer": 0, "byteOffset": indices_at, "byteLength": indices.len() }
            ],
            "buffers": buffers,
        });
        let scene = read_json(&root).expect("a sparse triangle");
        assert_eq!(scene.triangles[0].corners, [DVec3::Y, DVec3::X * 5.0, DVec3::ZERO]);

        let mut wrong = root.clone();
        wrong["accessors"][0]["sparse"]["count"] = json!(4);
        assert!(refusal(&wrong).contains("`accessors[0].sparse.count` is 4, more than the 3 elements"));
        // Byte 4 + 3 · 16 of a view of 52 bytes is its end: the last element does not fit with a stride of 20.
        let mut wrong = root.clone();
        wrong["bufferViews"][0]["byteStride"] = json!(20);
        assert!(refusal(&wrong).contains("`accessors[0]` claims 3 elements of 12 bytes every 20"));
        wrong["bufferViews"][0]["byteStride"] = json!(8);
        assert!(refusal(&wrong).contains("`bufferViews[0].byteStride` is 8, less than the 12 bytes"));
    }
}

#[test]
fn sparse_indices_must_ascend_and_positions_without_bytes_are_zero() {
    let mut bytes = vec![1, 1];
    bytes.extend([0, 0]);
    bytes.extend(floats(&[1.0; 6]));
    let (buffers, views) = buffer_of(&bytes);
    let mut root = file_of(&TRIANGLE);
    root["buffers"] = buffers;
    root["bufferViews"] = views;
    root["accessors"][0] = json!({ "componentType": 5126, "count": 3, "type": "VEC3", "sparse": {
        "count": 2,
        "indices": { "bufferView": 0, "componentType": 5121 },
        "values": { "bufferView": 0, "byteOffset": 4 } } });
    assert!(refusal(&root).contains("`accessors[0].sparse.indices`: index 1 is 1, which is not above"));
    root["accessors"][0]["sparse"]["count"] = json!(1);
    let scene = read_json(&root).expect("a triangle with one corner off the origin");
    assert_eq!(scene.triangles[0].corners, [DVec3::ZERO, DVec3::ONE, DVec3::ZERO]);
}

#[test]
fn transforms_are_f64_and_composed_from_the_root() {
    let mut root = file_of(&TRIANGLE);
    let quarter_turn: Value = serde_json::from_str("[0, 0, 0.7071068, 0.7071068]").expect("JSON");
    root["nodes"] = json!([
        { "mesh": 0, "translation": [2600000.1, 0, 0], "name": "leaf" },
        { "children": [0], "rotation": quarter_turn, "scale": [2, 2, 2] },
    ]);
    let scene = read_json(&root).expect("a moved triangle");
    assert_eq!(scene.objects, ["leaf"]);
    // A quarter turn about z takes x to y; the quaternion's seven digits must not stretch it.
    let [a, b, c] = scene.triangles[0].corners;
    assert!((a - DVec3::new(0.0, 5_200_000.2, 0.0)).length() < 1e-8, "{a}");
    assert!((b - a - DVec3::Y * 2.0).length() < 1e-8 && (c - a + DVec3::X * 2.0).length() < 1e-8);
}

#[test]
fn names_and_sidedness_and_materials() {
    let mut root = file_of(&TRIANGLE);
    root["nodes"] = json!([{ "mesh": 0 }, { "mesh": 1 }, { "mesh": 1, "name": "tower" }]);
    root["meshes"][0]["name"] = json!("roof");
    root["meshes"]
        .as_array_mut()
        .expect("meshes")
        .push(json!({ "primitives": [
        { "attributes": { "POSITION": 0 } },
        { "attributes": { "POSITION": 0 }, "material": 1 },
    ] }));
    root["materials"] = json!([
        { "name": "unused" },
        { "doubleSided": true, "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.25, 1, 1], "metallicFactor": 0.5, "baseColorTexture": { "index": 0 } } },
    ]);
    root["textures"] = json!([{ "source": 0 }]);
    root["images"] = json!([{ "uri": "not-there.png" }]);
    let scene = read_json(&root).expect("three nodes");
    assert_eq!(scene.objects, ["roof", "node 1", "tower"]);
    let names: Vec<&str> = scene.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names, ["", "material 1"]);
    assert_eq!(scene.materials[1].diffuse, Some([0.25, 0.125, 0.5]));
    assert_eq!(scene.materials[0].diffuse, None);
    assert_eq!(scene.ledger.get("reflectance texture not read"), 1);
    let sides: Vec<bool> = scene.triangles.iter().map(|t| t.two_sided).collect();
    assert_eq!(sides, [false, false, true, false, true]);
}

#[test]
fn compressed_geometry_is_read_only_with_a_fallback() {
    let mut root = file_of(&TRIANGLE);
    root["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    root["meshes"][0]["primitives"][0]["extensions"] =
        json!({ "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": { "POSITION": 0 } } });
    assert_eq!(read_json(&root).expect("the fallback").triangles.len(), 1);
    let mut without = root.clone();
    without["accessors"][0]
        .as_object_mut()
        .expect("an accessor")
        .remove("bufferView");
    assert!(refusal(&without).contains("export without Draco compression"));
    root["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    assert!(refusal(&root).contains("export without Draco compression"));

    let mut root = file_of(&TRIANGLE);
    root["buffers"][0] = json!({ "byteLength": 36, "extensions": { "EXT_meshopt_compression": { "fallback": true } } });
    assert!(refusal(&root).contains("`buffers[0]` holds its geometry only as `EXT_meshopt_compression`"));
    for (name, read) in [
        ("KHR_materials_clearcoat", true),
        ("EXT_texture_webp", true),
        ("EXT_mesh_gpu_instancing", true),
        ("KHR_gaussian_splatting", false),
    ] {
        let mut root = file_of(&TRIANGLE);
        root["extensionsRequired"] = json!([name]);
        assert_eq!(read_json(&root).is_ok(), read, "{name}");
    }
}

#[test]
fn copies_by_instancing_stand_where_their_attributes_say() {
    let mut root = file_of(&TRIANGLE);
    let plain = read_json(&root).expect("a scene");
    // The positions of the triangle as the places of three copies, in a node that is moved itself.
    root["nodes"][0]["translation"] = json!([0, 0, 5]);
    root["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 0 } } });
    let scene = read_json(&root).expect("copies");
    assert_eq!(scene.triangles.len(), 3);
    for (copy, &place) in scene.triangles.iter().zip(&plain.triangles[0].corners) {
        let due = plain.triangles[0]
            .corners
            .map(|corner| corner + place + DVec3::new(0.0, 0.0, 5.0));
        assert_eq!(copy.corners, due);
    }
    // A mirroring scale turns the winding, and a wrong width is an error.
    root["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = json!({ "ROTATION": 0 });
    assert!(refusal(&root).contains("not 4 numbers an element"));
    assert_eq!(scene.ledger.losses().count(), 0, "{}", scene.ledger);
}

#[test]
fn buffers_are_found_beside_the_scene_or_missed_by_name() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("gltf buffers");
    std::fs::create_dir_all(&folder).expect("a folder for buffers");
    std::fs::write(folder.join("a b.bin"), floats(&TRIANGLE)).expect("a buffer");
    let with = |uri: &str, base: Option<&Path>| {
        let mut root = file_of(&TRIANGLE);
        root["buffers"][0]["uri"] = json!(uri);
        gltf::read(root.to_string().as_bytes(), base, GEOMETRY)
    };
    for uri in ["a%20b.bin", "a b.bin", "./a b.bin"] {
        assert_eq!(
            with(uri, Some(&folder))
                .expect("a buffer beside the scene")
                .triangles
                .len(),
            1
        );
    }
    let refusals = [
        ("gone.bin", "`buffers[0]` in `gone.bin`"),
        (".", "it is a directory, and a regular file is needed"),
        ("%2Fetc%2Fpasswd", "absolute address `/etc/passwd`"),
        ("%66ile%3A///a.bin", "absolute address `file:///a.bin`"),
        ("../a.bin", "leads out of the scene's folder"),
        ("sub%2F..%2f..%2Fa.bin", "leads out of the scene's folder"),
        (
            "http://example.org/a.bin",
            "absolute address `http://example.org/a.bin`",
        ),
        ("file:///a.bin", "absolute address"),
        ("/a.bin", "absolute address"),
        ("data:,AAAA", "only base64 is read"),
        ("data:;base64,A!AA", "character 1 is no base64 digit"),
        (
            "data:application/octet-stream;base64,AAAA",
            "has 3 bytes, but its `byteLength` is 36",
        ),
        ("%ff", "does not decode to a file name"),
    ];
    for (uri, words) in refusals {
        let e = with(uri, Some(&folder)).expect_err(uri);
        assert!(e.to_string().contains(words), "{uri}: {e}");
    }
    assert!(matches!(
        with("gone.bin", Some(&folder)),
        Err(Error {
            kind: ErrorKind::Io(_),
            ..
        })
    ));
    assert!(
        with("a b.bin", None)
            .expect_err("no folder")
            .to_string()
            .contains("was not read from a folder")
    );
    std::fs::write(folder.join("short.bin"), [0; 35]).expect("a buffer");
    assert!(
        with("short.bin", Some(&folder))
            .expect_err("35 bytes")
            .to_string()
            .contains("has 35 bytes")
    );
}

/// A GLB of this JSON and these bytes.
fn glb(root: &Value, bin: &[u8]) -> Vec<u8> {
    let chunk = |kind: &[u8; 4], data: &[u8], padding: u8| {
        let mut data = data.to_vec();
        data.resize(data.len().next_multiple_of(4), padding);
        let length = u32::try_from(data.len()).expect("a small chunk");
        [&length.to_le_bytes()[..], kind, &data].concat()
    };
    let chunks = [
        chunk(b"JSON", root.to_string().as_bytes(), b' '),
        chunk(b"BIN\0", bin, 0),
    ]
    .concat();
    let length = u32::try_from(12 + chunks.len()).expect("a small file");
    [b"glTF", &2_u32.to_le_bytes()[..], &length.to_le_bytes(), &chunks].concat()
}

#[test]
fn a_glb_is_read_whole_and_refused_at_every_cut() {
    let mut root = file_of(&TRIANGLE);
    root["buffers"] = json!([{ "byteLength": 36 }]);
    let file = glb(&root, &floats(&TRIANGLE));
    let scene = gltf::read(&file, None, GEOMETRY).expect("a GLB");
    assert_eq!(scene, read_json(&file_of(&TRIANGLE)).expect("the same as text"));
    for length in 0..file.len() {
        let e = gltf::read(&file[..length], None, GEOMETRY).expect_err("a GLB that is cut off");
        assert!(e.to_string().len() > 20, "{e}");
    }
    let longer = [&file[..], b"!"].concat();
    let scene = gltf::read(&longer, None, GEOMETRY).expect("a GLB with more behind it");
    assert_eq!(scene.ledger.get("byte after the end of the GLB"), 1);
}

#[test]
fn claims_are_refused_before_they_cost_anything() {
    let began = Instant::now();
    let mut root = file_of(&TRIANGLE);
    for count in [4_u64, 1 << 40, u64::MAX] {
        root["accessors"][0]["count"] = json!(count);
        assert!(refusal(&root).contains("`accessors[0]"), "{count}");
    }
    let mut root = file_of(&TRIANGLE);
    for offset in [4_u64, 1 << 63, u64::MAX] {
        root["accessors"][0]["byteOffset"] = json!(offset);
        assert!(refusal(&root).contains("`accessors[0]` claims 3 elements"), "{offset}");
        root["bufferViews"][0]["byteOffset"] = json!(offset);
        assert!(
            refusal(&root).contains("`bufferViews[0]` is 36 bytes from byte"),
            "{offset}"
        );
        root["bufferViews"][0]["byteOffset"] = json!(0);
    }
    let mut root = file_of(&TRIANGLE);
    root["accessors"][0] = json!({ "componentType": 5126, "count": 3_000_000_000_u64, "type": "VEC3" });
    assert!(refusal(&root).contains("3000000000 elements but no `bufferView`"));
    let mut root = file_of(&TRIANGLE);
    root["nodes"][0]["mesh"] = json!(1_u64 << 32);
    assert!(refusal(&root).contains("`nodes[0].mesh` is 4294967296, but the file has 1 `meshes`"));

    // 65,536 nodes times 65,534 triangles.
    let mut root = file_of(&vec![0.0; 65_536 * 3]);
    root["meshes"][0]["primitives"][0]["mode"] = json!(5);
    root["nodes"] = (0..65_536).map(|_| json!({ "mesh": 0 })).collect();
    let e = read_json(&root).expect_err("four thousand million triangles");
    assert!(matches!(e.kind, ErrorKind::TooLarge(_)));
    assert!(e.to_string().contains("place 4294836224 triangles"), "{e}");

    // Nesting of JSON, and of nodes.
    let deep = format!("{}{}", "[".repeat(100_000), "]".repeat(100_000));
    assert!(gltf::read(deep.as_bytes(), None, GEOMETRY).is_err());
    let mut root = file_of(&TRIANGLE);
    let count = 200_000;
    root["nodes"] = (0..count)
        .map(|n| {
            if n + 1 < count {
                json!({ "children": [n + 1] })
            } else {
                json!({ "mesh": 0 })
            }
        })
        .collect();
    assert_eq!(read_json(&root).expect("a long chain of nodes").triangles.len(), 1);
    root["nodes"][count - 1]["children"] = json!([1000]);
    assert!(refusal(&root).contains("`nodes[1000]` is a child of `nodes[999]` and again of"));
    root["nodes"][999]["children"] = json!([]);
    assert!(refusal(&root).contains("is among its own descendants"));

    // Many placements of a mesh with many primitives that hold no triangle.
    let mut root = file_of(&TRIANGLE);
    root["meshes"][0]["primitives"] = (0..20_000)
        .map(|_| json!({ "attributes": { "POSITION": 0 }, "mode": 0 }))
        .collect();
    root["nodes"] = (0..20_000).map(|_| json!({ "mesh": 0 })).collect();
    let scene = read_json(&root).expect("points");
    assert_eq!(scene.ledger.get("point element"), 20_000 * 20_000 * 3);

    assert!(
        gltf::read(&vec![b'{'; 5_000_000], None, GEOMETRY)
            .expect_err("braces")
            .to_string()
            .contains("split")
    );
    assert!(began.elapsed() < Duration::from_secs(20), "{:?}", began.elapsed());
}

#[test]
fn scenes_choose_what_is_read() {
    let mut root = file_of(&TRIANGLE);
    root["nodes"] = json!([{ "mesh": 0, "name": "a" }, { "mesh": 0, "name": "b" }]);
    assert_eq!(read_json(&root).expect("no scenes").objects, ["a", "b"]);
    root["scenes"] = json!([{ "nodes": [1] }, { "nodes": [1, 0] }, {}]);
    let scene = read_json(&root).expect("no default scene");
    assert_eq!(
        (scene.objects.as_slice(), scene.ledger.warnings.len()),
        (&["b".to_owned()][..], 1)
    );
    root["scene"] = json!(1);
    assert_eq!(read_json(&root).expect("the second scene").objects, ["b", "a"]);
    root["scene"] = json!(2);
    assert!(read_json(&root).expect("a scene without nodes").triangles.is_empty());
    root["scenes"][2]["nodes"] = json!([0, 0]);
    assert!(refusal(&root).contains("`scenes[2]` lists `nodes[0]` twice"));
}

/// SplitMix64 (Steele, Lea, Flood 2014): the same cases on every run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, end: usize) -> usize {
        usize::try_from(self.next() % end as u64).expect("below a usize")
    }
}

/// A panic, a hang or a huge allocation would end this test; what is read at all must be sound.
#[test]
fn damaged_files_are_read_or_refused() {
    let Some(folder) = scenes("damaged_files_are_read_or_refused") else {
        return;
    };
    let files = [
        "gltf/kenney-city-kit/building-garage.glb",
        "gltf/misc/box_sparse.glb",
        "cornell/cornell-measured-closed.gltf",
        "gltf/khronos-asset-generator/Node_NegativeScale/Node_NegativeScale_08.gltf",
    ];
    let mut random = Random(20_250_101);
    let (mut loaded, mut refused) = (0, 0);
    for file in files {
        let path = folder.join(file);
        let bytes = std::fs::read(&path).expect("a scene file");
        for _ in 0..600 {
            let mut damaged = bytes.clone();
            for _ in 0..=random.below(4) {
                let at = random.below(damaged.len());
                match random.below(16) {
                    0 => damaged.truncate(at + 1),
                    1..=4 => damaged[at] = random.next().to_le_bytes()[0],
                    5..=8 => damaged[at] ^= 1 << random.below(8),
                    // What JSON is made of, so that more than its syntax is damaged.
                    9..=11 => damaged[at] = b"0123456789-.eE\"[]{},: "[random.below(22)],
                    _ => {
                        // The next digit becomes another one, or several nines.
                        if let Some(digit) = damaged[at..].iter().position(u8::is_ascii_digit) {
                            let nines = random.below(12);
                            let new = b'0' + random.next().to_le_bytes()[0] % 10;
                            damaged.splice(at + digit..=at + digit, std::iter::repeat_n(b'9', nines).chain([new]));
                        }
                    }
                }
            }
            let began = Instant::now();
            match gltf::read(&damaged, path.parent(), OPTICS) {
                Ok(scene) => {
                    loaded += 1;
                    for triangle in &scene.triangles {
                        assert!((triangle.object as usize) < scene.objects.len());
                        assert!((triangle.material as usize) < scene.materials.len());
                    }
                }
                Err(_) => refused += 1,
            }
            assert!(
                began.elapsed() < Duration::from_secs(5),
                "{file}: {:?}",
                began.elapsed()
            );
        }
    }
    println!("{loaded} damaged files loaded, {refused} refused");
    assert!(
        loaded > 100 && refused > 100,
        "{loaded} loaded, {refused} refused: the damage is no test"
    );
}
