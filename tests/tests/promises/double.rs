//! Form factors in f64, as a user meets them: `--form double` through every command, closed forms to 10⁻¹⁰, and
//! tolerances that f32 does not hold.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

use glam::DVec3;
use hemicube::store::{Form, Matrix, Precision, Store};
use hemicube_scene::InputPatch;
use hemicube_tests::cases::{cases, pairs};
use hemicube_tests::runs::{Place, files};
use std::fmt::Write as _;

/// A closed room of 4 × 5 × 3 m with a box that floats in it: 24 triangles.
fn room_with_a_box() -> Place {
    let mut text = String::new();
    let mut corners = 1;
    let mut body = |name: &str, low: [f64; 3], high: [f64; 3], faces: [[usize; 4]; 6]| {
        let _ = writeln!(text, "o {name}");
        for (x, y, z) in [
            (0, 0, 0),
            (1, 0, 0),
            (1, 1, 0),
            (0, 1, 0),
            (0, 0, 1),
            (1, 0, 1),
            (1, 1, 1),
            (0, 1, 1),
        ] {
            let at = |axis: usize, end: usize| if end == 0 { low[axis] } else { high[axis] };
            let _ = writeln!(text, "v {} {} {}", at(0, x), at(1, y), at(2, z));
        }
        for face in faces {
            let [a, b, c, d] = face.map(|corner| corner + corners);
            let _ = writeln!(text, "f {a} {b} {c} {d}");
        }
        corners += 8;
    };
    let inward = [
        [0, 1, 2, 3],
        [4, 7, 6, 5],
        [0, 4, 5, 1],
        [1, 5, 6, 2],
        [2, 6, 7, 3],
        [3, 7, 4, 0],
    ];
    let outward = inward.map(|[a, b, c, d]| [d, c, b, a]);
    body("room", [0.0; 3], [4.0, 5.0, 3.0], inward);
    body("box", [1.0, 1.0, 0.5], [2.0, 2.5, 1.5], outward);
    let place = Place::new();
    place.write("room.obj", text);
    place
}

fn doubles(store: &Store) -> Vec<f64> {
    let mut all = Vec::new();
    for row in store.rows().expect("rows") {
        let (_, row) = row.expect("a row");
        assert_eq!(row.data.precision(), Precision::Double);
        all.extend(&row.data);
    }
    all
}

#[test]
fn a_double_store_goes_through_every_command() {
    let place = room_with_a_box();
    place.line("compute room.obj -o plain").is(0);
    place
        .line("compute room.obj -o double --form double")
        .is(0)
        .says(&["kB, double"]);
    let store = Store::open(&place.path("double")).expect("a store");
    assert_eq!((store.manifest().form, store.manifest().version), (Form::Double, 5));
    let wide = doubles(&store);
    // Equal entries, with more digits of each than f32 holds.
    let plain = Store::open(&place.path("plain")).expect("a store");
    let narrow: Vec<f64> = plain
        .rows()
        .expect("rows")
        .flat_map(|row| row.expect("a row").1.data.into_f64())
        .collect();
    assert!(narrow.len() == wide.len() && narrow.len() > 200);
    assert!(
        wide.iter()
            .zip(&narrow)
            .all(|(&wide, &narrow)| Precision::Single.round(wide) == narrow)
    );
    assert!(
        wide.iter()
            .filter(|&&wide| Precision::Single.round(wide) != wide)
            .count()
            > wide.len() / 2
    );

    place.write(
        "materials.toml",
        "[default]\nreflectance = 0.5\nemissivity = 0.9\n\n[object.box]\nemission = 1.0\n",
    );
    for line in [
        "check double",
        "compare double plain",
        "solve double --materials materials.toml",
        "exchange double --by object --materials materials.toml",
        "sky room.obj --up z",
        "report double room.obj --up z -o page.html",
        "view hemicube room.obj --patch 3 -o hemicube.png",
        "view model double room.obj --up z --show row --patch 3 -o row.png",
        "view sparsity double -o sparsity.png",
        "export double -o F.npz",
        "export double -o F.npy",
        "export double -o F.mtx",
        "export double -o F.txt",
        "export double -o F.parquet",
        "export double -o zones.npz --by object",
        "balance double -o balanced --closure --reciprocity",
        "check balanced",
    ] {
        place.line(line).is(0);
    }
    for name in ["F.npz", "F.npy", "F.mtx"] {
        let matrix = Matrix::open(&place.path(name)).expect("a matrix");
        let rows = (0..matrix.patch_count()).map(|row| matrix.row(row).expect("a row").expect("all are there"));
        let found: Vec<f64> = rows.flat_map(|row| row.values).filter(|&value| value != 0.0).collect();
        assert_eq!(found, wide, "{name}");
    }
    // Balanced pairs agree to f64, where f32 leaves 10⁻⁷.
    let balanced = Store::open(&place.path("balanced")).expect("a store");
    assert_eq!(balanced.manifest().form, Form::Double);
    let area = balanced.patches().expect("a table").area;
    let factor = |i: u32, j: u32| {
        let row = balanced.row(InputPatch(i)).expect("a row").expect("it is there");
        row.indices.binary_search(&j).map_or(0.0, |at| row.data.at(at))
    };
    for (i, j) in [(0, 5), (2, 20), (7, 13)] {
        let (there, back) = (area[i as usize] * factor(i, j), area[j as usize] * factor(j, i));
        assert!(
            there > 0.0 && (there / back - 1.0).abs() < 1e-14,
            "{i} {j}: {there} {back}"
        );
    }
}

#[test]
fn shards_and_resumed_runs_have_the_bytes_of_one() {
    let place = room_with_a_box();
    let line = "compute room.obj --split 3 --form double --tolerance 0.05%";
    place.line(&format!("{line} -o whole")).is(0);
    for shard in [1, 2] {
        place.line(&format!("{line} -o parts --shard {shard}/2")).is(0);
    }
    place.line("merge parts").is(0);
    let bytes = |name: &str| files(&place.path(name)).into_values().collect::<Vec<_>>();
    assert_eq!(bytes("whole"), bytes("parts"));
    let part = std::fs::read_dir(place.path("whole/parts"))
        .expect("parts")
        .next()
        .expect("a part");
    std::fs::remove_file(part.expect("a file").path()).expect("it is removed");
    place.line(&format!("{line} -o whole")).is(0);
    assert_eq!(bytes("whole"), bytes("parts"));
    // Another form is another run.
    place
        .line("compute room.obj --split 3 --tolerance 0.05% -o whole --form plain")
        .is(2)
        .says(&["its form is double, here it is plain"]);
}

#[test]
fn unoccluded_pairs_are_exact_to_ten_digits() {
    let Some(cases) = cases("double::unoccluded_pairs_are_exact_to_ten_digits") else {
        return;
    };
    let mut pairs = pairs(&cases);
    pairs.retain(|pair| pair.obstructions.is_empty());
    assert_eq!(pairs.len(), 8);
    let mut worst = 0.0f64;
    for pair in &pairs {
        let place = Place::new();
        let mut text = String::new();
        let mut next = 1;
        for (name, triangles) in ["emitter", "receiver"].iter().zip(pair.triangles()) {
            let _ = writeln!(text, "o {name}");
            for triangle in triangles {
                for DVec3 { x, y, z } in triangle {
                    let _ = writeln!(text, "v {x} {y} {z}");
                }
                let _ = writeln!(text, "f {next} {} {}", next + 1, next + 2);
                next += 3;
            }
        }
        place.write("pair.obj", text);
        for (tolerance, split) in [("0.09%", 1), ("0.00001%", 1), ("0.01%", 3)] {
            let out = format!("F-{split}-{tolerance}");
            let line = format!("compute pair.obj --form double --tolerance {tolerance} --split {split} -o {out}");
            place.line(&line).is(0);
            let store = Store::open(&place.path(&out)).expect("a store");
            let table = store.patches().expect("a table");
            let mut exchange = [0.0; 2];
            let mut area = [0.0; 2];
            for row in store.rows().expect("rows") {
                let (patch, row) = row.expect("a row");
                let (of, own) = (table.object[patch.0 as usize] as usize, table.area[patch.0 as usize]);
                area[of] += own;
                exchange[of] += own * row.data.iter().sum::<f64>();
            }
            for (from, exact) in pair.exact.into_iter().enumerate() {
                let off = (exchange[from] / area[from] - exact).abs();
                worst = worst.max(off);
                assert!(off < 1e-10, "{} {from}, {line}: {off:e}", pair.name);
            }
        }
    }
    assert!(worst < 1e-12, "the worst of 48: {worst:e}");
}

#[test]
fn rows_of_a_closed_cube_sum_to_one() {
    let place = Place::new();
    let mut text = String::from("o cube\n");
    for k in 0..8 {
        let _ = writeln!(text, "v {} {} {}", k & 1, k >> 1 & 1, k >> 2);
    }
    text.push_str("f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n");
    place.write("cube.obj", text);
    let line = "compute cube.obj --split 4 --tolerance 0.05% -o";
    place.line(&format!("{line} double --form double")).is(0);
    place.line(&format!("{line} plain")).is(0);
    let worst = |name: &str| {
        let store = Store::open(&place.path(name)).expect("a store");
        assert_eq!(store.manifest().row_count, 192);
        let sums = store.row_table().expect("a table").row_sum;
        sums.into_iter().map(|sum| (sum - 1.0).abs()).fold(0.0, f64::max)
    };
    assert!(worst("double") < 1e-10, "{:e}", worst("double"));
    // The bound is not met by rounding alone.
    assert!(worst("plain") > 1e-9, "{:e}", worst("plain"));
    place.line("check double --max-closure 1e-10").is(0);
    place.line("check plain --max-closure 1e-10").is(1);
}

#[test]
fn tolerances_that_f32_does_not_hold_are_refused_by_a_sentence() {
    let place = room_with_a_box();
    let line = "compute room.obj --rows 0..1 -o F";
    place.line(&format!("{line} --tolerance 1e-7")).is(2).says(&[
        "`--form plain` rounds form factors by up to",
        "`--form double` is needed",
    ]);
    place
        .line(&format!("{line} --tolerance 9e-8 --form double"))
        .is(2)
        .says(&["0.00001% (1e-7) to 50%"]);
    place.line(&format!("{line} --tolerance 1e-6")).is(0);
    // The expected error against what was asked: said, whether it is reached or not.
    let checked = place.line("check F").is(0);
    assert!(checked.out.contains("0.0001 % asked"), "{}", checked.out);
}
