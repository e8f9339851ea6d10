//! Light, heat and sky by the program, against what is known of them: closed forms, conservation, and the measured
//! Cornell box.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

use glam::DVec3;
use hemicube::InputPatch;
use hemicube::solve::{ArrayFile, STEFAN_BOLTZMANN, StoredSolution};
use hemicube::store::Store;
use hemicube_scene::{Patches, ReadOptions, Subdivision};
use hemicube_tests::geometry::sphere;
use hemicube_tests::matrices::entries;
use hemicube_tests::random::Random;
use hemicube_tests::runs::{self, Ran};
use hemicube_tests::scenes::{scenes_or_skip, workspace};
use serde_json::Value;
use std::fmt::Write as _;
use std::path::PathBuf;

struct Place(runs::Place);

impl Place {
    fn new() -> Self {
        Self(runs::Place::new())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path(name)
    }

    fn write(&self, name: &str, text: &str) {
        self.0.write(name, text);
    }

    fn ran(&self, line: &str) -> (Option<i32>, String, String) {
        let Ran { code, out, err } = self.0.line(line);
        (code, out, err)
    }

    #[track_caller]
    fn line(&self, line: &str) -> String {
        let (code, out, err) = self.ran(line);
        assert_eq!(code, Some(0), "{line}: {err}");
        out
    }

    /// It ends with the error code and says these words, and nothing on standard output.
    #[track_caller]
    fn fails(&self, line: &str, words: &[&str]) {
        let (code, out, err) = self.ran(line);
        assert_eq!(code, Some(2), "{line}: {err}");
        assert_eq!(out, "");
        for word in words {
            assert!(err.contains(word), "`{word}` is not in: {err}");
        }
    }

    #[track_caller]
    fn json(&self, line: &str) -> Value {
        let out = self.line(line);
        serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error} in: {out}"))
    }

    /// A quantity of a solution: one vector a right-hand side.
    fn solution(&self, store: &str, name: &str, quantity: &str) -> Vec<Vec<f64>> {
        let store = Store::open(&self.path(store)).expect("a store");
        let array = StoredSolution::open(&store, name)
            .and_then(|solution| solution.quantity(quantity))
            .expect("a solution");
        (0..array.rows()).map(|row| array.row(row).expect("a row")).collect()
    }
}

/// Writes quads, each its own object and material `m0`, `m1`…, as OBJ.
fn obj(quads: &[[[f64; 3]; 4]]) -> String {
    let mut text = String::new();
    for (index, quad) in quads.iter().enumerate() {
        for [x, y, z] in quad {
            text.push_str(&format!("v {x} {y} {z}\n"));
        }
        let first = 4 * index + 1;
        text.push_str(&format!(
            "o q{index}\nusemtl m{index}\nf {first} {} {} {}\n",
            first + 1,
            first + 2,
            first + 3
        ));
    }
    text
}

fn npy(rows: &[Vec<f64>]) -> Vec<u8> {
    let mut header = format!(
        "{{'descr': '<f8', 'fortran_order': False, 'shape': ({}, {}), }}",
        rows.len(),
        rows[0].len()
    );
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(u16::try_from(header.len()).expect("short").to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(rows.iter().flatten().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// The six faces of a unit cube, seen from within.
fn cube() -> String {
    let corner = |bits: u32| [0, 1, 2].map(|k| f64::from(bits >> k & 1));
    let face = |a, b, c, d| [corner(a), corner(b), corner(c), corner(d)];
    obj(&[
        face(0, 1, 3, 2),
        face(4, 6, 7, 5),
        face(0, 4, 5, 1),
        face(2, 3, 7, 6),
        face(0, 2, 6, 4),
        face(1, 5, 7, 3),
    ])
}

#[test]
fn a_closed_room_is_e_over_one_minus_rho() {
    let place = Place::new();
    place.write("cube.obj", &cube());
    place.write(
        "m.toml",
        "bands = [\"low\", \"high\"]\n[default]\nreflectance = [0.5, 0.8]\nemission = [1, 3]\n",
    );
    // One pixel sum a row sums to 1 exactly.
    place.line("compute cube.obj --split 8 --correction pixel -o F --config=none");
    let report = place.json("solve F --materials m.toml --residual 1e-7 --json");
    assert_eq!(report["converged"], true);
    let b = place.solution("F", "radiosity", "radiosity");
    for (row, expected) in b.iter().zip([1.0 / 0.5, 3.0 / 0.2]) {
        for value in row {
            assert!((value / expected - 1.0).abs() < 1e-4, "{value} {expected}");
        }
    }
    for balance in report["balance"].as_array().expect("balances") {
        let number = |key: &str| balance[key].as_f64().expect("a number");
        let input = number("emitted");
        assert!((number("absorbed") / input - 1.0).abs() < 1e-4, "{balance}");
        let all = [
            "absorbed",
            "escaped",
            "blocked",
            "unselected",
            "closure",
            "reciprocity",
            "residual",
        ];
        let sum: f64 = all.iter().map(|key| number(key)).sum();
        assert!((sum / input - 1.0).abs() < 1e-9, "{balance}");
    }
}

#[test]
fn few_memory_and_many_right_hand_sides_change_nothing() {
    let place = Place::new();
    place.write("cube.obj", &cube());
    place.write("m.toml", "bands = [\"all\"]\n[default]\nreflectance = 0.6\n");
    place.line("compute cube.obj --split 16 --form compact -o F --config=none");
    let patches = 12 * 256;
    let rows: Vec<Vec<f64>> = (0..5)
        .map(|row| (0..patches).map(|p| f64::from(u8::from(p % 7 == row))).collect())
        .collect();
    std::fs::write(place.path("e.npy"), npy(&rows)).expect("a file");
    place.line("solve F --materials m.toml --emission e.npy --solution much -o much.npz -o much.csv");
    // So little that right-hand sides are solved one by one, and the matrix is read again each time.
    let report =
        place.json("solve F --materials m.toml --emission e.npy --solution little --memory 1kB --threads 1 --json");
    assert_eq!(report["residuals"].as_array().expect("residuals").len(), 5);
    let (much, little) = (
        place.solution("F", "much", "radiosity"),
        place.solution("F", "little", "radiosity"),
    );
    for (a, b) in much.iter().flatten().zip(little.iter().flatten()) {
        assert!((a - b).abs() < 1e-5 * (1.0 + b.abs()));
    }
    let csv = std::fs::read_to_string(place.path("much.csv")).expect("a table");
    assert_eq!(csv.lines().count(), 1 + patches);
    assert!(csv.starts_with("patch,object,material,area,x,y,z,radiosity_all_0,"));
    assert!(place.path("much.npz").is_file());

    // A matrix that was computed anew does not have the old one's solutions.
    place.line("compute cube.obj --split 8 -o F --overwrite --config=none");
    let store = Store::open(&place.path("F")).expect("a store");
    assert!(StoredSolution::open(&store, "much").is_err_and(|error| error.to_string().contains("another matrix")));
}

#[test]
fn what_cannot_be_solved_is_refused_with_the_next_step() {
    let place = Place::new();
    place.write("cube.obj", &cube());
    place.line("compute cube.obj --split 2 --correction pixel --samples 4 --resolution 64 -o F --config=none");
    place.fails("solve F", &["no reflectance is known of `m0`", "--materials"]);
    place.write("dark.toml", "[default]\nreflectance = 0.5\n");
    place.fails("solve F --materials dark.toml", &["nothing emits"]);
    place.write("wrong.toml", "[material.m9]\nreflectance = 0.5\n");
    place.fails("solve F --materials wrong.toml", &["`m9` matches no material", "`m0`"]);
    place.fails(
        "solve F --thermal --materials dark.toml",
        &["no emissivity and temperature", "kelvin"],
    );
    place.write("other.obj", &cube().replace("m3", "other"));
    place.fails("solve F --scene other.obj", &["not the scene"]);
    place.fails(
        "view model F cube.obj --up z --show radiosity -o x.png",
        &["has no solution `radiosity`", "hemicube solve"],
    );
    place.fails("view model F cube.obj -o x.jpg --show seen", &[".png or .svg"]);
    place.fails("sky cube.obj -o sky", &["which axis points up", "--up"]);
    place.fails(
        "sky cube.obj --up z -o sky --split 2 --split 2",
        &["--split", "multiple times"],
    );
    place.fails("sky cube.obj -o sky --matrix F", &["`-o sky` is a second directory"]);
    place.line("compute cube.obj --split 2 --rows 0..5 -o G --config=none");
    place.write("lit.toml", "[default]\nreflectance = 0.5\nemission = 1\n");
    place.fails("solve G --materials lit.toml", &["rows of 5 patches only"]);
    // A solution that does not converge is kept, says so, and ends with 1.
    let (code, _, err) = place.ran("solve F --materials lit.toml --max-iterations 1 --residual 1e-12");
    assert_eq!(code, Some(1));
    assert!(err.contains("the residual did not reach"), "{err}");
}

#[test]
fn light_that_never_ends_is_refused_and_an_earlier_solution_stays() {
    let place = Place::new();
    place.write("cube.obj", &cube());
    place.line("compute cube.obj --split 2 -o F --config=none");
    let materials =
        |reflectance: &str| format!("bands = [\"all\"]\n[default]\nreflectance = {reflectance}\nemission = 1\n");
    place.write("grey.toml", &materials("0.5"));
    place.line("solve F --materials grey.toml");
    place.write("white.toml", &materials("1"));
    place.fails(
        "solve F --materials white.toml",
        &[
            "material `m0` and what it sees, 48 patches",
            "reflect all of it and let none out",
            "no radiosity is finite",
            "`reflectance` below 1",
        ],
    );
    let kept = &place.solution("F", "radiosity", "radiosity")[0];
    assert!(kept.iter().all(|b| (b - 2.0).abs() < 1e-4), "of the grey room");
    // One wall that absorbs is an end, and without emission there is nothing to end.
    place.write("end.toml", &(materials("1") + "[material.m3]\nreflectance = 0.5\n"));
    place.line("solve F --materials end.toml");
    let patches = place.solution("F", "radiosity", "radiosity")[0].len();
    std::fs::write(place.path("dark.npy"), npy(&[vec![0.0; patches]])).expect("a file");
    place.line("solve F --materials white.toml --emission dark.npy");
    assert!(
        place.solution("F", "radiosity", "radiosity")[0]
            .iter()
            .all(|b| *b == 0.0)
    );
}

#[test]
fn emissions_and_radiances_below_zero_are_refused_in_every_file() {
    let place = Place::new();
    place.write("cube.obj", &cube());
    place.line("compute cube.obj --split 2 -o F --config=none");
    place.line("sky cube.obj --up z --matrix F --quiet");
    place.write(
        "m.toml",
        "bands = [\"all\"]\n[default]\nreflectance = 0.5\nemission = 1\n",
    );
    place.line("solve F --materials m.toml");
    let patches = place.solution("F", "radiosity", "radiosity")[0].len();
    for (option, numbers, what) in [
        ("emission", patches, "an emission"),
        ("sky-radiance", 146, "a radiance"),
    ] {
        let mut rows = vec![vec![1.0; numbers]; 2];
        rows[1][3] = -0.25;
        std::fs::write(place.path("wrong.npy"), npy(&rows)).expect("a file");
        place.fails(
            &format!("solve F --materials m.toml --{option} wrong.npy"),
            &[
                "`wrong.npy` has -0.25 in row 1, column 3",
                &format!("{what} is a finite number from 0 on"),
            ],
        );
    }
    place.write("below.toml", "[default]\nreflectance = 0.5\nemission = -1\n");
    place.fails("solve F --materials below.toml", &["emission of -1"]);
}

/// At one temperature, the surroundings too, nothing flows; and a furnace is white. `settings` are of `compute`.
fn at_equilibrium(scene: &std::path::Path, settings: &str) {
    let place = Place::new();
    let scene = scene.display().to_string();
    place.line(&format!("compute {scene} -o m {settings} --quiet"));
    place.write("iso.toml", "[default]\nemissivity = 0.7\ntemperature = 300\n");
    place.line("solve m --thermal --materials iso.toml --sky-temperature 300");
    let black = STEFAN_BOLTZMANN * 300.0f64.powi(4);
    let flux = &place.solution("m", "thermal", "flux")[0];
    let worst = flux.iter().fold(0.0f64, |worst, flux| worst.max(flux.abs()));
    assert!(
        !flux.is_empty() && worst <= 1e-4 * black,
        "{scene} {settings}: {worst} W/m²"
    );

    place.write(
        "white.toml",
        "bands = [\"all\"]\n[default]\nreflectance = 0.6\nemission = 0.4\n",
    );
    place.line(&format!("sky {scene} --up z --matrix m --quiet"));
    std::fs::write(place.path("even.npy"), npy(&[vec![std::f64::consts::FRAC_1_PI; 146]])).expect("a file");
    place.line("solve m --materials white.toml --sky-radiance even.npy");
    let light = &place.solution("m", "radiosity", "radiosity")[0];
    let worst = light.iter().fold(0.0f64, |worst, light| worst.max((light - 1.0).abs()));
    assert!(worst <= 1e-4, "{scene} {settings}: {worst}");
}

#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn at_one_temperature_nothing_flows_and_a_furnace_is_white() {
    for settings in ["", "--tolerance 1%"] {
        at_equilibrium(&workspace().join("crates/scene/data/cornell-box.obj"), settings);
    }
    if let Some(scenes) = scenes_or_skip("at_one_temperature_nothing_flows_and_a_furnace_is_white") {
        for settings in ["", "--tolerance 1%"] {
            at_equilibrium(&scenes.join("../cases/open-scene/blocks.obj"), settings);
            at_equilibrium(&scenes.join("interior/aggressor.obj"), settings);
            at_equilibrium(&scenes.join("city/denhaag-8897.obj"), settings);
        }
    }
}

#[test]
#[ignore = "for the full run: a city of 38,936 triangles"]
fn a_city_on_two_triangles_is_at_equilibrium_and_its_rows_add_up() {
    if let Some(scenes) = scenes_or_skip("a_city_on_two_triangles_is_at_equilibrium_and_its_rows_add_up") {
        adds_up(&scenes.join("../cases/city/munich.obj"), "");
        at_equilibrium(&scenes.join("../cases/city/munich.obj"), "");
        at_equilibrium(&scenes.join("../cases/city/munich.obj"), "--tolerance 1%");
    }
}

/// What |Σ F + escaped + blocked + unselected − 1| is at most, its area-weighted root mean square, and that of the
/// hemicubes' shares.
fn off_one(store: &Store) -> [f64; 3] {
    let (areas, rows) = (store.patches().expect("patches").area, store.row_table().expect("rows"));
    let off = |of: [&[f64]; 3]| -> Vec<f64> {
        let sum = |patch: usize| rows.row_sum[patch] + of.iter().map(|share| share[patch]).sum::<f64>();
        (0..areas.len()).map(|patch| (sum(patch) - 1.0).abs()).collect()
    };
    let rms = |of: &[f64]| {
        let rows = areas.iter().zip(of).filter(|(_, off)| !off.is_nan());
        (rows.map(|(area, off)| area * off * off).sum::<f64>() / areas.iter().sum::<f64>()).sqrt()
    };
    let refined = off([&rows.escaped, &rows.blocked, &rows.unselected]);
    let seen = off([
        &rows.hemicube_escaped,
        &rows.hemicube_blocked,
        &rows.hemicube_unselected,
    ]);
    [refined.iter().copied().fold(0.0, f64::max), rms(&refined), rms(&seen)]
}

/// Every row of a scene sums to 1 within the tolerance, and within a quarter of it by root mean square, by the default
/// (2 %) and at 1 %.
fn adds_up(scene: &std::path::Path, cut: &str) {
    let place = Place::new();
    for (name, settings, tolerance) in [("area", "", 0.02), ("one", "--tolerance 1%", 0.01)] {
        place.line(&format!(
            "compute {} -o {name} {cut} {settings} --quiet",
            scene.display()
        ));
        let [most, rms, _] = off_one(&Store::open(&place.path(name)).expect("a store"));
        assert!(
            most <= tolerance && rms <= 0.25 * tolerance,
            "{} {settings}: {most}, {rms}",
            scene.display()
        );
    }
}

#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn every_row_adds_up() {
    let place = Place::new();
    place.line("generate maze --patches 3000 --seed 7 -o maze.obj");
    adds_up(&place.path("maze.obj"), "");
    adds_up(&workspace().join("crates/scene/data/cornell-box.obj"), "--split 4");
    if let Some(scenes) = scenes_or_skip("every_row_adds_up") {
        adds_up(&scenes.join("../cases/open-scene/blocks.obj"), "");
        adds_up(&scenes.join("interior/aggressor.obj"), "");
        adds_up(&scenes.join("city/denhaag-8897.obj"), "");
    }
}

/// A thousand slivers through one point of a room: every row meets the bound on its work with pairs left, whose
/// standard errors are too small. Sums were up to 1.41.
#[test]
fn rows_cut_short_by_their_bound_add_up() {
    let place = Place::new();
    place.line("generate room --patches 300 -o room.obj");
    let mut text = std::fs::read_to_string(place.path("room.obj")).expect("a room");
    let mut random = Random(7);
    let mut unit = || random.unit() - 0.5;
    text.push_str("o slivers\n");
    let middle = [278.0, 274.0, 280.0];
    for _ in 0..1000 {
        let along: [f64; 3] = std::array::from_fn(|_| unit());
        let length = along.iter().map(|a| a * a).sum::<f64>().sqrt();
        let end = |side: f64| -> [f64; 3] { std::array::from_fn(|k| middle[k] + side * along[k] / length) };
        let (start, end) = (end(-180.0), end(180.0));
        let beside: [f64; 3] = std::array::from_fn(|k| end[k] + 0.36 * unit());
        for [x, y, z] in [start, end, beside] {
            writeln!(text, "v {x} {y} {z}").expect("a string");
        }
        text.push_str("f -3 -2 -1\n");
    }
    std::fs::write(place.path("slivers.obj"), text).expect("written");
    place.line("compute slivers.obj -o m --rows 1 --two-sided on --quiet");
    let store = Store::open(&place.path("m")).expect("a store");
    let [most, ..] = off_one(&store);
    assert!(most <= 0.02, "{most}");
}

#[test]
fn rows_done_again_because_their_sums_are_off_add_up() {
    strips_add_up(&[404]);
}

#[test]
#[ignore = "more rows of the same scene: ./test --full"]
fn more_rows_done_again_add_up() {
    strips_add_up(&[381, 789]);
}

/// Two layers of crossed strips, 10⁻⁴ apart, in a closed room. By default sums of these rows were 1.10 to 1.14: their
/// standard errors are too small, and fractions moved by three of them at most.
fn strips_add_up(rows: &[usize]) {
    let place = Place::new();
    let corners = |axis: usize, at: f64, [u, v]: [[f64; 2]; 2]| -> [[f64; 3]; 4] {
        [[u[0], v[0]], [u[1], v[0]], [u[1], v[1]], [u[0], v[1]]].map(|[a, b]| match axis {
            0 => [at, a, b],
            1 => [b, at, a],
            _ => [a, b, at],
        })
    };
    let turned = |[a, b, c, d]: [[f64; 3]; 4]| [a, d, c, b];
    let mut quads = Vec::new();
    for axis in 0..3 {
        quads.push(corners(axis, 0.0, [[0.0, 2.0]; 2]));
        quads.push(turned(corners(axis, 2.0, [[0.0, 2.0]; 2])));
    }
    for z in [1.0, 1.0001] {
        for k in 0..150 {
            let low = 0.1 + 0.012 * f64::from(k);
            let (wide, long) = ([low, low + 0.004], [0.1, 1.9]);
            for strip in [corners(2, z, [wide, long]), corners(2, z + 1e-5, [long, wide])] {
                quads.extend([strip, turned(strip)]);
            }
        }
    }
    std::fs::write(place.path("strips.obj"), obj(&quads)).expect("written");
    for row in rows {
        place.line(&format!(
            "compute strips.obj -o m --rows {row}..{} --quiet --overwrite",
            row + 1
        ));
        let store = Store::open(&place.path("m")).expect("a store");
        let [most, ..] = off_one(&store);
        assert!(most <= 0.02, "row {row}: {most}");
    }
}

/// Cubes half buried in each other: a third of such rows met a bound on their work by default, and had pairs 2.4 to 3.1
/// times too large. Right values by `--tolerance 0.3%`.
#[test]
fn pairs_of_crossing_cubes_are_measured_by_default() {
    let Some(scenes) = scenes_or_skip("pairs_of_crossing_cubes_are_measured_by_default") else {
        return;
    };
    let place = Place::new();
    let cubes = scenes.join("gltf/misc/gltf-transform/many-cubes.gltf");
    for (from, to, right) in [(5113, 6008, 0.077), (728, 1557, 0.0345), (2445, 4593, 0.028)] {
        place.line(&format!(
            "compute {} -o m --rows {from}..{} --quiet --overwrite",
            cubes.display(),
            from + 1
        ));
        let found = entries(&place.path("m"), from..from + 1, |patch| patch)[&(from, to)];
        assert!(
            (found - right).abs() < 0.3 * right,
            "{from} to {to}: {found} and {right}"
        );
    }
}

/// A box of 1.2 × 1.5 × 0.016, finely cut: from most patches some are seen at grazing angles only, by no pixel of a
/// hemicube.
#[test]
fn rows_of_a_flat_cavity_add_up_and_its_ends_see_each_other() {
    let Some(scenes) = scenes_or_skip("rows_of_a_flat_cavity_add_up_and_its_ends_see_each_other") else {
        return;
    };
    let place = Place::new();
    let cavity = scenes.join("../cases/thin-enclosure/cavity.obj").display().to_string();
    place.line(&format!("compute {cavity} -o m --tolerance 0.1% --quiet"));
    let store = Store::open(&place.path("m")).expect("a store");
    let [most, rms, _] = off_one(&store);
    assert!(most <= 0.001 && rms <= 0.00025, "{most}, {rms}");
    // Parallel rectangles (Howell C-11): west to east, and south to north.
    let zones = hemicube::analysis::zones::zones(&store, hemicube::analysis::zones::GroupBy::Object).expect("zones");
    let factor = |from: &str, to: &str| {
        let index = |name: &str| zones.iter().position(|zone| zone.name == name).expect("a zone");
        zones[index(from)].factor_to(u32::try_from(index(to)).expect("few zones"))
    };
    for (from, to, right) in [("west", "east", 0.003_802_78), ("south", "north", 0.002_290_87)] {
        let found = factor(from, to);
        assert!((found / right - 1.0).abs() < 0.005, "{from} to {to}: {found}, {right}");
    }
}

#[test]
fn shares_of_open_scenes_are_refined_and_two_plates_stay_what_they_are() {
    let Some(scenes) = scenes_or_skip("shares_of_open_scenes_are_refined_and_two_plates_stay_what_they_are") else {
        return;
    };
    let place = Place::new();
    let open = |name: &str| Store::open(&place.path(name)).expect("a store");
    let blocks = scenes.join("../cases/open-scene/blocks.obj").display().to_string();
    for (name, settings, tolerance) in [("area", "", 0.02), ("one", "--tolerance 1%", 0.01)] {
        place.line(&format!("compute {blocks} -o {name} {settings} --quiet"));
        let [_, _, seen] = off_one(&open(name));
        assert!(seen > tolerance, "the hemicubes alone: {seen}");
    }
    let plates = scenes.join("../cases/open-scene/plates.obj").display().to_string();
    place.line(&format!("compute {plates} -o plates --tolerance 1e-4 --quiet"));
    place.line("balance plates --closure -o closed");
    for name in ["plates", "closed"] {
        let store = open(name);
        for zone in hemicube::analysis::zones::zones(&store, hemicube::analysis::zones::GroupBy::Object).expect("zones")
        {
            let other: f64 = zone.factors.iter().map(|(_, factor)| factor).sum();
            assert!(
                (other - 0.199_824_90).abs() < 1e-6 && (zone.escaped - 0.800_175_10).abs() < 1e-6,
                "{name}: {zone:?}"
            );
        }
    }
}

/// A unit square below the back of another, h = ½ apart: no form factor tells the sky from the back. The back takes
/// what the front would: F = 0.415253 (Howell C-11).
#[test]
fn the_sky_is_told_from_backs_though_every_form_factor_is_zero() {
    let place = Place::new();
    let square = |z: f64| [[0.0, 0.0, z], [1.0, 0.0, z], [1.0, 1.0, z], [0.0, 1.0, z]];
    std::fs::write(place.path("back.obj"), obj(&[square(0.0), square(0.5)])).expect("written");
    for (settings, bound) in [
        ("", 0.02),
        ("--tolerance 1%", 0.01),
        ("--tolerance 0.1%", 1e-3),
        ("--tolerance 1e-6", 1e-3),
    ] {
        place.line(&format!(
            "compute back.obj -o m --by face {settings} --quiet --overwrite"
        ));
        let rows = Store::open(&place.path("m"))
            .expect("a store")
            .row_table()
            .expect("rows")
            .clone();
        let [blocked, escaped] = [rows.blocked[0], rows.escaped[0]];
        assert!((blocked - 0.415_253).abs() < bound, "{settings}: {blocked}");
        assert!(
            (blocked + escaped - 1.0).abs() < 1e-9,
            "{settings}: {blocked}, {escaped}"
        );
        assert!(rows.escaped[1] == 1.0 && rows.blocked[1] == 0.0, "{settings}");
    }
}

/// A room behind an open side, with a block that hides it from the middles of two surfaces that see it from their rims:
/// what escapes there by rays was in no column, and the table had the blocked shares of the hemicubes.
#[test]
fn shares_of_the_sky_beside_a_matrix_are_the_matrixs() {
    let place = Place::new();
    let wall = |x: f64| [[x, 0.0, 0.0], [x, 3.5, 0.0], [x, 3.5, 3.0], [x, 0.0, 3.0]];
    let turned = |mut quad: [[f64; 3]; 4]| {
        quad.reverse();
        quad
    };
    let quads = [
        [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 4.0, 0.0], [0.0, 4.0, 0.0]],
        [[0.0, 0.0, 3.0], [0.0, 4.0, 3.0], [4.0, 4.0, 3.0], [4.0, 0.0, 3.0]],
        [[0.0, 4.0, 0.0], [4.0, 4.0, 0.0], [4.0, 4.0, 3.0], [0.0, 4.0, 3.0]],
        [[0.0, 0.0, 0.0], [0.0, 0.0, 3.0], [4.0, 0.0, 3.0], [4.0, 0.0, 0.0]],
        [[0.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 4.0, 3.0], [0.0, 0.0, 3.0]],
        turned(wall(1.8)),
        wall(1.9),
        [[1.8, 3.5, 0.0], [1.8, 3.5, 3.0], [1.9, 3.5, 3.0], [1.9, 3.5, 0.0]],
    ];
    std::fs::write(place.path("slit.obj"), obj(&quads)).expect("written");
    for settings in ["", "--tolerance 1%"] {
        place.line(&format!("compute slit.obj -o m {settings} --up z --quiet --overwrite"));
        place.line("sky slit.obj --matrix m -o sky.csv --overwrite --quiet");
        let store = Store::open(&place.path("m")).expect("a store");
        let rows = store.row_table().expect("rows").clone();
        let part = store.part(0).expect("a part").expect("rows");
        let table = read(&place, "sky.csv");
        let lost = part
            .sums
            .iter()
            .zip(&rows.escaped)
            .filter(|(sums, escaped)| sums.escaped == 0 && **escaped > 1e-3);
        assert!(lost.count() > 0, "{settings}: no row escapes by rays alone");
        for (patch, line) in table.lines().skip(1).enumerate() {
            let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap_or(f64::NAN)).collect();
            let [sky, ground, blocked] = cells[cells.len() - 3..] else {
                panic!("{line}")
            };
            assert!(
                (sky + ground - rows.escaped[patch]).abs() < 1.1e-3,
                "{settings}: {line}"
            );
            assert_eq!(blocked, rows.blocked[patch], "{settings}: {line}");
        }
    }
}

/// A wall that reaches 4 cm into the ground. Of its lower triangle, f = 1 − (1.96/2)² lies below: that part sees the
/// ground's back above it, to one half, and the centroid sees none.
#[test]
fn a_wall_sunk_in_the_ground_sees_its_back() {
    let place = Place::new();
    let ground = [
        [-999.0, -999.0, 0.0],
        [999.0, -999.0, 0.0],
        [999.0, 999.0, 0.0],
        [-999.0, 999.0, 0.0],
    ];
    let wall = [[0.0, 0.0, -0.04], [2.0, 0.0, -0.04], [2.0, 0.0, 1.96], [0.0, 0.0, 1.96]];
    std::fs::write(place.path("sunk.obj"), obj(&[ground, wall])).expect("written");
    for (settings, bound) in [("--tolerance 1%", 0.006), ("--tolerance 0.3%", 0.002)] {
        place.line(&format!(
            "compute sunk.obj -o m --rows 2..4 {settings} --quiet --overwrite"
        ));
        let rows = Store::open(&place.path("m"))
            .expect("a store")
            .row_table()
            .expect("rows")
            .clone();
        for (patch, below) in [(2, 0.04 / 2.0 * (2.0 - 0.04 / 2.0)), (3, (0.04f64 / 2.0).powi(2))] {
            let blocked = rows.blocked[patch];
            assert!((blocked - 0.5 * below).abs() < bound, "{settings}, {patch}: {blocked}");
            assert!(
                (rows.escaped[patch] - 0.5).abs() < bound,
                "{settings}, {patch}: {}",
                rows.escaped[patch]
            );
        }
    }
}

/// A wall that stands on a ground triangle, its front to the middle: only the corner behind it sees its back. What it
/// blocks is the closed form of the wall's back, from a scene in which that has a column. It was 0 by the hemicube at
/// the middle, and all of it escaped.
#[test]
fn a_back_that_only_a_part_of_a_patch_sees_is_blocked() {
    let place = Place::new();
    let mesh = "v 0 0 0\nv 3 0 0\nv 0 3 0\nv 2 0 0\nv 2 1 0\nv 2 1 3\nv 2 0 3\nf 1 2 3\nf 7 6 5 4\n";
    std::fs::write(place.path("foot.obj"), mesh).expect("written");
    let row = |settings: &str| {
        place.line(&format!(
            "compute foot.obj -o m --rows 0..1 {settings} --quiet --overwrite"
        ));
        let store = Store::open(&place.path("m")).expect("a store");
        let rows = store.row_table().expect("rows").clone();
        (rows.row_sum[0], rows.escaped[0], rows.blocked[0])
    };
    let (front, ..) = row("--tolerance 0.01%");
    let (both, ..) = row("--tolerance 0.01% --two-sided=on");
    let behind = both - front;
    assert!(behind > 0.025, "{front}, {both}");
    for (settings, bound) in [("", 0.02), ("--tolerance 1%", 0.01)] {
        let (_, escaped, blocked) = row(settings);
        assert!((blocked - behind).abs() <= bound, "{settings}: {blocked}, {behind}");
        assert!((escaped - (1.0 - both)).abs() <= bound, "{settings}: {escaped}, {both}");
    }
}

/// A field of spheres whose rows see many patches and mostly sky: rays that differ by chance from form factors that
/// agree with their hemicubes leave them as they are. 0.007 of a ΣF of 0.07 was moved in several rows of a thousand.
#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn rows_that_agree_with_their_hemicubes_stay_as_they_are() {
    let place = Place::new();
    let mut text = String::new();
    for k in 0..24 {
        let middle = 4.0 * DVec3::new(f64::from(k % 6), f64::from(k / 6), 0.0);
        for corners in sphere(5, 1.0, false, true) {
            for corner in corners {
                let [x, y, z] = (corner + middle).to_array();
                writeln!(text, "v {x} {y} {z}").expect("a string");
            }
            text.push_str("f -3 -2 -1\n");
        }
    }
    std::fs::write(place.path("field.obj"), text).expect("written");
    let sums = |name: &str, tolerance: &str| {
        place.line(&format!("compute field.obj -o {name} --tolerance {tolerance} --quiet"));
        let store = Store::open(&place.path(name)).expect("a store");
        store.row_table().expect("rows").row_sum.clone()
    };
    let (coarse, fine) = (sums("coarse", "1%"), sums("fine", "0.1%"));
    let off = coarse
        .iter()
        .zip(&fine)
        .filter(|(a, b)| (*a - *b).abs() > 0.003)
        .count();
    assert!(off <= 2, "{off} of {}", coarse.len());
}

/// Two large plates close together: q = σ(T₁⁴ − T₂⁴) / (1/ε₁ + 1/ε₂ − 1).
#[test]
fn two_plates_exchange_what_the_textbook_says() {
    let place = Place::new();
    let gap = 1e-4;
    place.write(
        "plates.obj",
        &obj(&[
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
            [[0.0, 0.0, gap], [0.0, 1.0, gap], [1.0, 1.0, gap], [1.0, 0.0, gap]],
        ]),
    );
    place.write(
        "m.toml",
        "[material.m0]\nemissivity = 0.8\ntemperature = 800\n[material.m1]\nemissivity = 0.4\ntemperature = 500\n",
    );
    place.line("compute plates.obj -o F --tolerance 0.1% --config=none");
    place.line("solve F --thermal --materials m.toml -o heat.csv");
    let expected = STEFAN_BOLTZMANN * (800f64.powi(4) - 500f64.powi(4)) / (1.0 / 0.8 + 1.0 / 0.4 - 1.0);
    let flux = place.solution("F", "thermal", "flux");
    for (patch, value) in flux[0].iter().enumerate() {
        let sign = if patch < 2 { 1.0 } else { -1.0 };
        assert!(
            (value * sign / expected - 1.0).abs() < 1e-3,
            "{patch}: {value} {expected}"
        );
    }
}

/// A regular tetrahedron of which two faces reradiate, and so are one surface: F = 1/3 between any two faces, and Q₁ =
/// A σ(T₁⁴ − T₂⁴) / ((1−ε₁)/ε₁ + 1/(F₁₂ + 1/(1/F₁ᵣ + 1/F₂ᵣ)) + (1−ε₂)/ε₂) with F₁ᵣ = F₂ᵣ = 2/3 (three-surface
/// enclosure, Incropera & DeWitt, section 13.3.5). A face is one patch, as the textbook's surfaces are.
#[test]
fn an_enclosure_of_three_surfaces_exchanges_what_the_textbook_says() {
    let place = Place::new();
    let corners = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]];
    let mut text = String::new();
    for [x, y, z] in corners {
        text.push_str(&format!("v {x} {y} {z}\n"));
    }
    // Each face from within, opposite to the corner that it lacks.
    for (index, [a, b, c]) in [[2, 3, 4], [1, 4, 3], [1, 2, 4], [1, 3, 2]].into_iter().enumerate() {
        text.push_str(&format!("usemtl m{index}\nf {a} {b} {c}\n"));
    }
    place.write("tetrahedron.obj", &text);
    place.write(
        "m.toml",
        "[material.m0]\nemissivity = 0.8\ntemperature = 1200\n[material.m1]\nemissivity = 0.4\ntemperature = 500\n\
         [material.m2]\nadiabatic = true\n[material.m3]\nadiabatic = true\n",
    );
    place.line("compute tetrahedron.obj -o F --tolerance 0.05% --config=none");
    place.line("solve F --thermal --materials m.toml --residual 1e-9");
    let exchange = 1.0 / 3.0 + 1.0 / (1.5 + 1.5);
    let expected = STEFAN_BOLTZMANN * (1200f64.powi(4) - 500f64.powi(4)) / (0.2 / 0.8 + 1.0 / exchange + 0.6 / 0.4);
    let flux = &place.solution("F", "thermal", "flux")[0];
    let temperature = &place.solution("F", "thermal", "temperature")[0];
    assert!((flux[0] / expected - 1.0).abs() < 1e-3, "{} {expected}", flux[0]);
    assert!((flux[1] / expected + 1.0).abs() < 1e-3, "{} {expected}", flux[1]);
    for wall in [2, 3] {
        assert!(flux[wall].abs() < 1e-3 * expected, "{}", flux[wall]);
        // A surface without heat of its own takes a temperature between those of the others.
        assert!((500.0..1200.0).contains(&temperature[wall]), "{}", temperature[wall]);
    }
}

/// From the measured box and published reflectances to a picture. What is known of the picture: the side of the tall
/// block that faces the red wall is redder than the one that faces the green wall; the ceiling is lit from below only;
/// shadows have soft edges.
#[test]
fn the_cornell_box_bleeds_colour() {
    let place = Place::new();
    let data = workspace().join("crates/scene/data");
    for file in ["cornell-box.obj", "cornell-box.mtl"] {
        std::fs::copy(data.join(file), place.path(file)).expect("the scene");
    }
    place.line("compute cornell-box.obj --split 8 -o box --config=none");
    place.line("solve box");
    place.line("view model box -o box.png --up y --eye 278,273,-800 --look-at 278,273,0 --fov 39.3 --size 160x160");
    let png = std::fs::read(place.path("box.png")).expect("a picture");
    assert_eq!(&png[..8], b"\x89PNG\r\n\x1a\n");

    let store = Store::open(&place.path("box")).expect("a store");
    let b = place.solution("box", "radiosity", "radiosity");
    let table = store.patches().expect("patches");
    let objects = &store.manifest().objects;
    let mean = |wanted: &dyn Fn(usize) -> bool, band: usize| {
        let (mut sum, mut area) = (0.0, 0.0);
        for patch in (0..table.len()).filter(|&patch| wanted(patch)) {
            sum += table.area[patch] * b[band][patch];
            area += table.area[patch];
        }
        assert!(area > 0.0);
        sum / area
    };
    let side = |object: &str, towards: f64| {
        let wanted =
            |patch: usize| objects[table.object[patch] as usize] == object && table.normal[patch][0] * towards > 0.7;
        mean(&wanted, 0) / mean(&wanted, 1)
    };
    // The red wall is at x = 552, the green one at x = 0.
    for block in ["short_block", "tall_block"] {
        let (red, green) = (side(block, 1.0), side(block, -1.0));
        assert!(red > 1.3 * green, "{block}: {red} towards red, {green} towards green");
    }
    // On the floor, going out of the tall block's shadow, no step between neighbours is more than half of what there
    // is.
    let floor = |patch: usize| objects[table.object[patch] as usize] == "floor";
    let lit = mean(&|patch| floor(patch) && table.centroid[patch][2] < 60.0, 1);
    let dark = (0..table.len())
        .filter(|&patch| floor(patch))
        .map(|patch| b[1][patch])
        .filter(|&value| value > 0.0)
        .fold(f64::INFINITY, f64::min);
    assert!(dark < 0.35 * lit, "shadows are dark: {dark} {lit}");

    // Every other picture, too.
    for show in ["seen", "row --patch 7", "radiosity"] {
        let name = show.split_whitespace().next().expect("a word");
        place.line(&format!(
            "view model box cornell-box.obj --up y --size 96x64 --eye 278,273,-800 --show {show} -o {name}.png"
        ));
        assert!(place.path(&format!("{name}.png")).metadata().expect("a picture").len() > 1000);
    }
    for show in ["ids", "depth", "delta", "occlusion"] {
        place.line(&format!(
            "view hemicube cornell-box.obj --matrix box --patch 700 --resolution 64 --show {show} -o {show}.svg"
        ));
        let svg = std::fs::read_to_string(place.path(&format!("{show}.svg"))).expect("a picture");
        assert!(svg.contains("patch 700") && svg.ends_with("</svg>\n"));
    }
    place.line("view sparsity box --order work -o sparsity.png");

    // Errors, with how many patches have which: the bars stand on the picture's scale.
    place.line("view model box cornell-box.obj --up y --size 400x300 --show closure -o closure.svg");
    let svg = std::fs::read_to_string(place.path("closure.svg")).expect("a picture");
    assert!(svg.contains("patches; the tallest bar is") && svg.contains("of each row"));
    place.line("compute cornell-box.obj --split 8 -o pixels --correction pixel --config=none");
    place.fails(
        "view model pixels cornell-box.obj --up y --show error -o error.png",
        &["expected errors", "--tolerance"],
    );
    place.line("compute cornell-box.obj --split 4 --tolerance 3% -o refined --config=none");
    place.line("view model refined cornell-box.obj --up y --size 400x300 --show error -o error.svg");
    let svg = std::fs::read_to_string(place.path("error.svg")).expect("a picture");
    assert!(svg.contains("expected") && svg.contains("the tallest bar is"));
}

/// A street canyon along y: floor, and walls that face each other.
fn canyon(width: f64, height: f64, strips: usize) -> String {
    const LONG: f64 = 2e4;
    let half = width / 2.0;
    let mut quads = Vec::new();
    for (from, to) in [(-0.5, 0.5), (-LONG, -0.5), (0.5, LONG)] {
        for strip in 0..strips {
            let x = |k: usize| -half + width * k as f64 / strips as f64;
            let (x0, x1) = (x(strip), x(strip + 1));
            quads.push([[x0, from, 0.0], [x1, from, 0.0], [x1, to, 0.0], [x0, to, 0.0]]);
        }
    }
    quads.push([
        [-half, -LONG, 0.0],
        [-half, LONG, 0.0],
        [-half, LONG, height],
        [-half, -LONG, height],
    ]);
    quads.push([
        [half, LONG, 0.0],
        [half, -LONG, 0.0],
        [half, -LONG, height],
        [half, LONG, height],
    ]);
    obj(&quads)
}

/// Along the floor the sky view factor is (sin α + sin β) / 2 with the angles from the vertical to the eaves, and on
/// average √(1 + (H/W)²) − H/W (crossed strings, Hottel 1954).
#[test]
fn the_sky_over_a_street_is_that_of_the_closed_form() {
    const STRIPS: usize = 8;
    let place = Place::new();
    let (width, height) = (10.0, 8.0);
    place.write("street.obj", &canyon(width, height, STRIPS));
    place.write(
        "points.txt",
        "# in the middle and aside\n0 0 1e-4 0 0 1\n2.5 0 1e-4 0 0 1\n",
    );
    place.write("suns.txt", "0 0 1\n5 0 8.1\n5 0 1\n0 0 -1\n");
    let line = "sky street.obj --up z -o sky --tolerance 0.1% --points points.txt --suns suns.txt --json";
    let (code, out, err) = place.ran(line);
    let report: Value = serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error} in: {out}{err}"));
    // Two rows still change at the last level; they are as exact as is asked.
    assert_eq!((code, &report["unsettled"]), (Some(1), &2.into()), "{err}");
    assert_eq!(
        (report["columns"].as_u64(), report["points"].as_u64()),
        (Some(146), Some(2))
    );
    let factors = hemicube::sky::read_sky_view_factors(&place.path("sky/sky.npz")).expect("factors");
    let mean: f64 = factors[..2 * STRIPS].iter().sum::<f64>() / (2 * STRIPS) as f64;
    let expected = (1.0 + (height / width) * (height / width)).sqrt() - height / width;
    assert!((mean / expected - 1.0).abs() < 2e-3, "{mean} {expected}");
    let at = |x: f64| {
        let sine = |aside: f64| aside / aside.hypot(height);
        0.5 * (sine(width / 2.0 - x) + sine(width / 2.0 + x))
    };
    // Each triangle of the middle strip by the mean over its width, by Simpson's rule with a linear density.
    for strip in 0..STRIPS {
        let (x0, h) = (
            -width / 2.0 + width * strip as f64 / STRIPS as f64,
            width / STRIPS as f64,
        );
        let (near, middle, far) = (at(x0), at(x0 + h / 2.0), at(x0 + h));
        let both = (near + 4.0 * middle + far) / 6.0;
        let found = (factors[2 * strip] + factors[2 * strip + 1]) / 2.0;
        assert!((found / both - 1.0).abs() < 2e-3, "strip {strip}: {found} {both}");
    }
    let points = hemicube::sky::read_sky_view_factors(&place.path("sky/points-sky.npz")).expect("factors");
    for (found, x) in points.iter().zip([0.0, 2.5]) {
        assert!((found / at(x) - 1.0).abs() < 2e-3, "{found} {}", at(x));
    }
    // A sky of radiance 1/π everywhere lights a patch by its sky view factor; one of the ground lights no floor.
    let mut sky = vec![std::f64::consts::FRAC_1_PI; 146];
    sky[0] = 0.0;
    let light = hemicube::sky::sky_product(&place.path("sky/sky.npz"), &[sky]).expect("a product");
    for (patch, factor) in factors.iter().enumerate() {
        assert!((light.of(patch)[0] * std::f64::consts::PI - factor).abs() < 1e-12);
    }
}

/// A matrix that lost nothing renders no sky: the bytes are those of rendering it.
#[test]
fn nothing_escapes_from_a_closed_cube() {
    let place = Place::new();
    place.write("cube.obj", &cube());
    place.line("compute cube.obj --split 2 --correction pixel --samples 4 --resolution 64 -o F --config=none");
    let beside = place.json("sky cube.obj --matrix F --up z --json");
    assert_eq!(beside["sky_view_factor"]["max"].as_f64(), Some(0.0));
    assert_eq!(beside["rows_as_in_matrix"], beside["patches"]);
    let alone = place.json("sky cube.obj -o sky --split 2 --samples 4 --resolution 64 --up z --json");
    assert_eq!(beside["hemicubes"], alone["hemicubes"]);
    let bytes = |folder: &str| std::fs::read(place.path(folder).join("sky.npz")).expect("a file");
    assert_eq!(bytes("F/sky"), bytes("sky"));
}

fn read(place: &Place, file: &str) -> String {
    std::fs::read_to_string(place.path(file)).expect("a file")
}

/// A table needs no matrix: a line a patch, whose numbers are those of the arrays.
#[test]
fn the_sky_as_a_table() {
    let place = Place::new();
    place.line("generate city --patches 400 --seed 5 -o city.obj");
    place.line("sky city.obj --up y -o sky.csv -o sky --resolution 64");
    let table = read(&place, "sky.csv");
    let mut lines = table.lines();
    let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let at = |name: &str| names.iter().position(|found| *found == name).expect("a column");
    let factors = hemicube::sky::read_sky_view_factors(&place.path("sky/sky.npz")).expect("factors");
    let mut count = 0;
    for (line, factor) in lines.zip(&factors) {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |name: &str| cells[at(name)].parse::<f64>().expect("a number");
        assert!((number("sky_view_factor") - factor).abs() < 1e-6, "{line}");
        assert!(number("sky_view_factor") + number("ground") + number("blocked") <= 1.0 + 1e-6);
        count += 1;
    }
    assert_eq!(count, factors.len());
    place.line("sky city.obj --up y -o alone.csv --resolution 64");
    assert_eq!(read(&place, "alone.csv"), table);
    place.fails("sky city.obj --up y -o one -o two", &["names 2 directories"]);
    place.fails("sky city.obj --up y -o alone.csv", &["--overwrite"]);
    place.write("suns.txt", "0 1 0\n");
    place.fails(
        "sky city.obj --up y -o b.csv --suns suns.txt",
        &["what `--suns` asks for", "-o DIR", "--by object"],
    );
}

/// Columns of a row add up to what escaped, exactly; beside a matrix they are what the matrix lost, to the last unit.
#[test]
fn sky_and_ground_are_what_escaped() {
    let place = Place::new();
    place.line("generate city --patches 400 --seed 5 -o city.obj");
    place.line("compute city.obj --up y -o F --config=none");
    let report = place.json("sky city.obj --matrix F --division reinhart:2 --json");
    assert_eq!(report["columns"].as_u64(), Some(578));
    assert_eq!(report["rows_as_in_matrix"], report["patches"]);
    assert!(report["ground"].as_f64().expect("a share") > 0.0);
    // Equal bytes, whatever the threads.
    place.write("points.txt", "0 30 0 0 1 0\n5 2 5 1 0 0\n");
    let run = |threads: u32| {
        let out = format!("sky-{threads}");
        let line = format!(
            "sky city.obj --up y -o {out} --tolerance 5% --resolution 64 --points points.txt --threads {threads}"
        );
        // Some rows of the city do not settle.
        let (code, _, err) = place.ran(&line);
        assert_eq!(code, Some(1), "{err}");
        ["sky.npz", "points.npz", "points-sky.npz", "sky.json"]
            .map(|file| std::fs::read(place.path(&out).join(file)).expect("a file"))
    };
    assert_eq!(run(1), run(3));

    // By the sky, and out again: a sky of radiance 1/π over white ground and white walls lights nothing by more than 1.
    let mut sky = vec![0.3; 578];
    sky[0] = 0.0;
    std::fs::write(place.path("sky.npy"), npy(&[sky])).expect("a file");
    place.write("m.toml", "bands = [\"all\"]\n[default]\nreflectance = 0.3\n");
    let report = place.json("solve F --materials m.toml --sky-radiance sky.npy --json");
    let balance = &report["balance"][0];
    let number = |key: &str| balance[key].as_f64().expect("a number");
    assert!(number("from_outside") > 0.0 && number("emitted") == 0.0);
    let all = [
        "absorbed",
        "escaped",
        "blocked",
        "unselected",
        "closure",
        "reciprocity",
        "residual",
    ];
    let sum: f64 = all.iter().map(|key| number(key)).sum();
    assert!((sum / number("from_outside") - 1.0).abs() < 1e-9, "{balance}");
    assert!(number("escaped") > 0.0);
    let irradiance = &place.solution("F", "radiosity", "irradiance")[0];
    let most = irradiance.iter().copied().fold(0.0, f64::max);
    assert!(
        most > 0.5 * 0.3 * std::f64::consts::PI && most < 1.2 * 0.3 * std::f64::consts::PI,
        "{most}"
    );
    // The picture of it, too.
    place.line("view model F city.obj --show sky --size 64x48 -o sky.png");

    // The sky of another scene is not taken for this one's.
    place.line("generate city --patches 400 --seed 6 -o other.obj");
    place.line("compute other.obj --up y -o F --overwrite --config=none");
    place.fails(
        "view model F other.obj --show sky -o sky.png --overwrite",
        &["another scene", "hemicube sky"],
    );
    place.fails("solve F --materials m.toml --sky-radiance sky.npy", &["another scene"]);
}

/// In an export with -o the sky, rows and what is blocked sum to 1 in all formats, the columns are named, and `check` sees
/// every changed byte of the sky rows.
#[test]
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "numbers of rows and columns, and f32 that were printed"
)]
fn the_sky_is_columns_of_the_export() {
    let place = Place::new();
    place.line("generate city --patches 600 --seed 5 -o city.obj");
    place.line("compute city.obj --up y --correction pixel -o F --config=none");
    place.fails("export F -o F.npz --with-sky", &["no sky rows", "hemicube sky"]);
    place.line("sky city.obj --matrix F");
    let report = place.json("check F --json");
    let store = Store::open(&place.path("F")).expect("a store");
    let patches = store.patch_count() as usize;
    assert_eq!(report["sky"]["columns"], 146);
    // The matrix's own hemicubes: to the last unit.
    assert_eq!(report["sky"]["rows_as_in_matrix"], report["sky"]["rows"]);
    assert!(place.line("check F").contains("agree with the escaped energy"));

    place.line("export F -o F.npy --with-sky");
    let array = ArrayFile::open(&place.path("F.npy")).expect("an array");
    assert_eq!((array.rows(), array.columns()), (patches as u64, patches as u64 + 146));
    let table = store.row_table().expect("a table");
    let mut grounds = 0;
    for patch in 0..patches {
        let row = array.row(patch as u64).expect("a row");
        let sky: f64 = row[patches..].iter().sum();
        assert!(
            (sky - table.escaped[patch]).abs() < 1e-6,
            "patch {patch}: {sky} {}",
            table.escaped[patch]
        );
        let sum: f64 = row.iter().sum();
        assert!((sum + table.blocked[patch] - 1.0).abs() < 2e-6, "patch {patch}: {sum}");
        grounds += u32::from(row[patches] > 0.0);
    }
    assert!(grounds > 0, "no row sees the ground below the horizon");

    let columns = std::fs::read_to_string(place.path("F.columns.csv")).expect("a table");
    let lines: Vec<&str> = columns.lines().collect();
    assert_eq!(lines.len(), 147);
    assert!(lines[0].starts_with("column_from_0,name,azimuth_degrees,"));
    assert!(lines[1].starts_with(&format!("{patches},ground,,,6.28")));
    assert!(lines[2].starts_with(&format!("{},sky 1,0.0000,6.0000,", patches + 1)));
    assert!(lines[146].starts_with(&format!("{},sky 145,0.0000,90.0000,", patches + 145)));

    // The other formats have the same numbers.
    let report = place.json("export F -o F.npz --with-sky --overwrite --json");
    assert_eq!(report["sky_columns"], 146);
    place.line("export F -o F.txt --with-sky --overwrite");
    let text = std::fs::read_to_string(place.path("F.txt")).expect("triplets");
    let size = format!("{patches} {} 0", patches + 146);
    assert_eq!(text.lines().last(), Some(size.as_str()));
    assert_eq!(
        text.lines().count() as u64 - 1,
        report["entries"].as_u64().expect("a number")
    );
    for line in text.lines().filter(|line| !line.ends_with(" 0")) {
        let words: Vec<f64> = line.split(' ').map(|word| word.parse().expect("a number")).collect();
        let row = array.row(words[0] as u64 - 1).expect("a row");
        assert_eq!(row[words[1] as usize - 1] as f32, words[2] as f32, "{line}");
    }
    assert!(
        std::fs::read_to_string(place.path("F.columns.csv"))
            .expect("a table")
            .starts_with("column_from_1,")
    );
    place.line("export F -o F.mtx --with-sky --overwrite");
    let market = std::fs::read_to_string(place.path("F.mtx")).expect("a matrix");
    assert!(market.contains(&format!("% column {} is the ground", patches + 1)));
    let head = format!("\n{patches} {} {}\n", patches + 146, report["entries"]);
    assert!(market.contains(&head), "{head}");

    let path = place.path("F/sky/sky.npz");
    let sound = std::fs::read(&path).expect("sky rows");
    for at in [100, sound.len() / 2, sound.len() - 10] {
        let mut bytes = sound.clone();
        bytes[at] ^= 4;
        std::fs::write(&path, &bytes).expect("sky rows");
        let (code, out, err) = place.ran("check F");
        assert_eq!(code, Some(1), "byte {at}: {err}");
        assert!(out.contains("sky: "), "{out}");
    }
}

/// A free, level plane sees ∫ cos θ dΩ / π of each patch of the sky, and in all 1.
#[test]
fn a_free_plane_sees_the_whole_sky() {
    let place = Place::new();
    place.write(
        "plane.obj",
        &obj(&[[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]]),
    );
    place.line("sky plane.obj --up z -o sky --resolution 1024");
    let division = hemicube::sky::SkyDivision::new(1).expect("Tregenza's");
    let mut total = 0.0;
    for column in 0..division.columns() {
        let mut unit = vec![0.0; 146];
        unit[column as usize] = 1.0;
        let seen = hemicube::sky::sky_product(&place.path("sky/sky.npz"), &[unit]).expect("a product");
        let expected = division.share_of_a_level_plane(column);
        assert!(
            (seen.of(0)[0] - expected).abs() <= 1e-2 * expected,
            "{column}: {} {expected}",
            seen.of(0)[0]
        );
        total += seen.of(0)[0];
    }
    assert_eq!(total, 1.0, "in weights, and so to the last bit");
    assert!((0..146).map(|c| division.share_of_a_level_plane(c)).sum::<f64>() > 1.0 - 1e-12);
}

/// The readers' optics reach the solution: OBJ with MTL, glTF with its strength of emission, AC3D.
#[test]
fn reflectance_and_emission_come_from_every_format() {
    let place = Place::new();
    let [a, b] = [0.0, 1.0];
    let quads = [
        [[a, a, a], [b, a, a], [b, b, a], [a, b, a]],
        [[a, a, b], [a, b, b], [b, b, b], [b, a, b]],
    ];
    place.write("s.obj", &format!("mtllib s.mtl\n{}", obj(&quads)));
    place.write(
        "s.mtl",
        "newmtl m0\nKd 0.5 0.4 0.3\nKe 8 4 2\nnewmtl m1\nKd 0.9 0.6 0.3\n",
    );
    #[allow(clippy::cast_possible_truncation, reason = "zeros and ones")]
    let positions: Vec<u8> = quads
        .iter()
        .flat_map(|[p, q, r, s]| [p, q, r, p, r, s])
        .flatten()
        .flat_map(|&x| (x as f32).to_le_bytes())
        .collect();
    let mut glb = gltf(&positions);
    glb.truncate(glb.trim_ascii_end().len());
    std::fs::write(place.path("s.gltf"), glb).expect("a file");
    std::fs::write(place.path("s.bin"), positions).expect("a file");
    let mut ac = "AC3Db\nMATERIAL \"m0\" rgb 0.5 0.4 0.3 amb 0 0 0 emis 8 4 2 spec 0 0 0 shi 0 trans 0\n\
                  MATERIAL \"m1\" rgb 0.9 0.6 0.3 amb 0 0 0 emis 0 0 0 spec 0 0 0 shi 0 trans 0\nOBJECT world\nkids 2\n"
        .to_owned();
    for (index, quad) in quads.iter().enumerate() {
        ac.push_str(&format!("OBJECT poly\nname \"q{index}\"\nnumvert 4\n"));
        for [x, y, z] in quad {
            ac.push_str(&format!("{x} {y} {z}\n"));
        }
        ac.push_str(&format!(
            "numsurf 1\nSURF 0x0\nmat {index}\nrefs 4\n0 0 0\n1 0 0\n2 0 0\n3 0 0\nkids 0\n"
        ));
    }
    place.write("s.ac", &ac);
    let mut found = Vec::new();
    for file in ["s.obj", "s.gltf", "s.ac"] {
        place.line(&format!("compute {file} -o F --overwrite --config=none"));
        place.line(&format!("solve F --scene {file}"));
        found.push(place.solution("F", "radiosity", "radiosity"));
    }
    // m0 emits, m1 only reflects: in the ratio of emission times both reflectances, to first order.
    assert!(found[0][0][0] > 8.0 && found[0][2][0] > 2.0 && found[0][0][2] > 0.5);
    for other in &found[1..] {
        for (a, b) in other.iter().flatten().zip(found[0].iter().flatten()) {
            assert!((a / b - 1.0).abs() < 1e-5, "{a} {b}");
        }
    }
}

/// Two meshes of two triangles each, unindexed, in `s.bin`.
fn gltf(positions: &[u8]) -> Vec<u8> {
    let material = |name: &str, color: [f64; 3], emission: [f64; 3], strength: f64| {
        serde_json::json!({
            "name": name,
            "pbrMetallicRoughness": {"baseColorFactor": [color[0], color[1], color[2], 1.0], "metallicFactor": 0.0},
            "emissiveFactor": emission,
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": strength}},
        })
    };
    let accessor = |offset: usize| {
        serde_json::json!({"bufferView": 0, "byteOffset": offset, "componentType": 5126, "count": 6, "type": "VEC3",
                           "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0]})
    };
    let mesh = |index: usize| {
        serde_json::json!({"name": format!("q{index}"),
                           "primitives": [{"attributes": {"POSITION": index}, "material": index}]})
    };
    let document = serde_json::json!({
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_emissive_strength"],
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"mesh": 1}],
        "meshes": [mesh(0), mesh(1)],
        "materials": [
            material("m0", [0.5, 0.4, 0.3], [1.0, 0.5, 0.25], 8.0),
            material("m1", [0.9, 0.6, 0.3], [0.0; 3], 1.0),
        ],
        "accessors": [accessor(0), accessor(72)],
        "bufferViews": [{"buffer": 0, "byteLength": positions.len()}],
        "buffers": [{"uri": "s.bin", "byteLength": positions.len()}],
    });
    document.to_string().into_bytes()
}

/// Rays towards a sun and the sky's weights are of the same scene: where the sun in the zenith is open all over a
/// patch, the cap of the sky has weight.
#[test]
fn suns_are_seen_where_the_sky_is_open() {
    let place = Place::new();
    // A floor, half of it under a roof that faces down.
    place.write(
        "roof.obj",
        &obj(&[
            [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 0.0]],
            [[0.0, 0.0, 0.5], [0.0, 2.0, 0.5], [1.0, 2.0, 0.5], [1.0, 0.0, 0.5]],
        ]),
    );
    place.write("suns.txt", "0 0 1\n");
    place.line("sky roof.obj --up z --split 8 -o sky --suns suns.txt");
    let scene = hemicube_scene::load(&place.path("roof.obj"), ReadOptions::default()).expect("a scene");
    let patches = Patches::new(&scene, Subdivision::Split(8)).expect("patches");
    let archive = std::fs::read(place.path("sky/sky.npz")).expect("an archive");
    let lit = npz_f32(&archive, "suns.npy");
    for patch in patches.iter() {
        let floor = patches.normal(patch).z > 0.0;
        let expected = if floor && patches.centroid(patch).x > 1.0 {
            1.0
        } else {
            0.0
        };
        assert_eq!(lit[patch.0 as usize], expected, "{:?}", patches.centroid(patch));
    }
    assert_eq!(lit.len(), patches.len());
    assert!(patches.iter().any(|patch| patch == InputPatch(0)));
    let array = ArrayFile::open(&place.path("sky/sky.npz"));
    assert!(array.is_err(), "an archive is no array");
}

/// The f32s of a stored member of a zip archive.
fn npz_f32(archive: &[u8], member: &str) -> Vec<f32> {
    let at = archive
        .windows(member.len())
        .position(|window| window == member.as_bytes())
        .expect("the member");
    let data = &archive[at..];
    let magic = data
        .windows(6)
        .position(|window| window == b"\x93NUMPY")
        .expect("an array");
    let header = u16::from_le_bytes([data[magic + 8], data[magic + 9]]) as usize;
    let text = std::str::from_utf8(&data[magic + 10..magic + 10 + header]).expect("text");
    let shape = text
        .split("'shape': (")
        .nth(1)
        .and_then(|rest| rest.split(')').next())
        .expect("a shape");
    let count: usize = shape
        .split(',')
        .filter_map(|n| n.trim().parse::<usize>().ok())
        .product();
    let begin = magic + 10 + header;
    data[begin..begin + 4 * count]
        .chunks_exact(4)
        .map(|bytes| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
        .collect()
}
