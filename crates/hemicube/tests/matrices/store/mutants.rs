//! Stores that were changed by somebody who seals them again, and by somebody who does not: no reader panics, and each
//! command's product is that of the whole store or an error.

use super::sample::{self, Random, Sample, doctor_manifest, doctor_part, sample};
use hemicube::analysis::check::{CheckOptions, check};
use hemicube::solve::{Block, OutOfCore, Problem, SolveOptions, solve};
use hemicube::store::{Error, Form, Matrix, Part, Store};
use hemicube_export::{ExportFormat, ExportOptions, export};
use std::path::Path;

/// A change of a number, and all of those that no store may have.
fn doctored_part(part: &mut Part, random: &mut Random) -> &'static str {
    let entry = random.below(part.data.len() as u64) as usize;
    let row = random.below(part.rows.len() as u64) as usize;
    match random.below(9) {
        0 => {
            let wrong = [f64::NAN, f64::INFINITY, -1e-3, 2.5, f32::MAX.into()];
            part.data.set(entry, wrong[random.below(5) as usize]);
            "factor"
        }
        1 => {
            part.indices[entry] = [-1, i32::MIN, i32::MAX, 40, 1 << 24][random.below(5) as usize];
            "column"
        }
        2 => {
            // There twice.
            let busy = (0..part.rows.len()).find(|&row| part.row(row).0.len() > 1).unwrap();
            let start = part.indptr[busy] as usize;
            part.indices[start] = part.indices[start + 1];
            "column twice"
        }
        3 => {
            part.rows[row] = [40, u32::MAX, 1 << 31][random.below(3) as usize];
            "row beyond"
        }
        4 => {
            let other = (row + 1) % part.rows.len();
            part.rows[row] = part.rows[other];
            "row twice"
        }
        5 => {
            part.sums[row].escaped ^= 1 << random.below(40);
            "weight"
        }
        6 => {
            part.hemicubes[row] = [0, 2, u32::MAX][random.below(3) as usize];
            "hemicubes"
        }
        7 => {
            part.indptr[row + 1] = [-1, i64::MAX, 1 << 40][random.below(3) as usize];
            "indptr"
        }
        _ => {
            part.errors[row].sum = [-1.0, f32::INFINITY][random.below(2) as usize];
            "error"
        }
    }
}

fn doctored_table(directory: &Path, random: &mut Random) -> &'static str {
    let path = directory.join("patches.npz");
    let place = random.below(40) as usize;
    let bad = [f64::NAN, f64::INFINITY, -1.0][random.below(3) as usize];
    let (name, bytes) = match random.below(6) {
        0 => {
            let mut areas: Vec<f64> = sample::array(&path, "area");
            areas[place] = if random.below(2) == 0 { 0.0 } else { bad };
            ("area", sample::npy(&[40], &areas))
        }
        1 => {
            let mut normals: Vec<f64> = sample::array(&path, "normal");
            normals[place] = bad * 3.0;
            ("normal", sample::npy(&[40, 3], &normals))
        }
        2 => {
            let mut materials: Vec<u32> = sample::array(&path, "material");
            materials[place] = [1, 9999, u32::MAX][random.below(3) as usize];
            ("material", sample::npy(&[40], &materials))
        }
        3 => {
            let mut objects: Vec<u32> = sample::array(&path, "object");
            objects[place] = [2, u32::MAX][random.below(2) as usize];
            ("object", sample::npy(&[40], &objects))
        }
        4 => {
            let mut sides: Vec<u8> = sample::array(&path, "side");
            sides[place] = 2 + random.below(254) as u8;
            ("side", sample::npy(&[40], &sides))
        }
        _ => {
            let areas: Vec<f64> = sample::array(&path, "area");
            ("area", sample::npy(&[20, 2], &areas))
        }
    };
    sample::replace_members(&path, &[(name, bytes)], zip::CompressionMethod::Stored);
    let checksum = blake3::hash(&std::fs::read(&path).unwrap()).to_hex().to_string();
    doctor_manifest(directory, |manifest| manifest["patches"]["blake3"] = checksum.into());
    name
}

fn doctored_manifest(directory: &Path, random: &mut Random) -> &'static str {
    let number = [0, 1, 41, 1 << 31, u64::from(u32::MAX), 1 << 40][random.below(6) as usize];
    let field = ["patch_count", "row_count", "part_count", "rows_per_part", "entries"][random.below(5) as usize];
    doctor_manifest(directory, |manifest| manifest[field] = number.into());
    field
}

/// A bit, a cut or some zeros anywhere; not sealed again.
fn raw(directory: &Path, random: &mut Random) -> &'static str {
    let files = [
        "manifest.json",
        "patches.npz",
        "parts/part-00000.npz",
        "parts/part-00001.npz",
    ];
    let path = directory.join(files[random.below(4) as usize]);
    let mut bytes = std::fs::read(&path).unwrap();
    let place = random.below(bytes.len() as u64) as usize;
    match random.below(3) {
        0 => bytes[place] ^= 1 << random.below(8),
        1 => bytes.truncate(place),
        _ => bytes[place..]
            .iter_mut()
            .take(16)
            .for_each(|byte| *byte = byte.wrapping_add(1)),
    }
    std::fs::write(&path, bytes).unwrap();
    "raw bytes"
}

/// What is made of a store, as bits; each an error where it is refused.
fn products(directory: &Path, scratch: &Path) -> Vec<Result<Vec<u64>, String>> {
    let bits = |values: Vec<f64>| values.into_iter().map(f64::to_bits).collect::<Vec<u64>>();
    let told = |error: Error| error.to_string();
    let open = || Store::open(directory).map_err(told);
    let x: Vec<f64> = (0..40).map(|k| 1.0 + f64::from(k) / 7.0).collect();
    let rows = |store: Store| {
        let mut found = Vec::new();
        for row in store.rows()? {
            let (patch, row) = row?;
            found.push(u64::from(patch.0));
            found.extend(row.indices.iter().map(|&column| u64::from(column)));
            found.extend(row.data.iter().map(f64::to_bits));
        }
        Ok(found)
    };
    let parts = |store: Store| {
        let mut found = Vec::new();
        for place in 0..store.manifest().parts.len() {
            let part = store.part(place)?.unwrap();
            found.extend(part.rows.iter().map(|&row| u64::from(row)));
            found.extend(part.data.iter().map(f64::to_bits));
            found.extend(part.indices.iter().map(|&column| u64::from(column.cast_unsigned())));
        }
        Ok(found)
    };
    let solved = |store: Store| -> Result<Vec<u64>, String> {
        let problem = Problem {
            reflectance: Block::from_fn(40, 1, |_, _| 0.5),
            bands: vec![0],
            emission: Block::from_fn(40, 1, |patch, _| x[patch]),
            outside: None,
            returned: None,
        };
        let factors = OutOfCore::new(&store, 0).map_err(told)?;
        let solution = solve(&factors, &problem, SolveOptions::default(), &mut |_| true);
        let solution = solution.map_err(|error| error.to_string())?;
        Ok(bits(solution.radiosity.values().to_vec()))
    };
    let exported = |store: Store| -> Result<Vec<u64>, String> {
        let path = scratch.join("F.npz");
        let options = ExportOptions {
            overwrite: true,
            ..ExportOptions::default()
        };
        export(&store, &path, ExportFormat::Npz, options).map_err(|error| error.to_string())?;
        let matrix = Matrix::open(&path).map_err(told)?;
        let mut found = Vec::new();
        for row in 0..matrix.patch_count() {
            found.extend(bits(matrix.row(row).map_err(told)?.unwrap().values));
        }
        Ok(found)
    };
    let table = |store: Store| -> Result<Vec<u64>, Error> {
        let table = store.patches()?;
        let numbers = table
            .object
            .iter()
            .chain(&table.material)
            .map(|&index| u64::from(index));
        Ok(numbers.chain(table.area.iter().map(|area| area.to_bits())).collect())
    };
    vec![
        open().and_then(|store| rows(store).map_err(told)),
        open().and_then(|store| parts(store).map_err(told)),
        open().and_then(|store| table(store).map_err(told)),
        open().and_then(|store| store.multiply(&x, 1).map(bits).map_err(told)),
        open().and_then(|store| store.multiply_transposed(&x, 1).map(bits).map_err(told)),
        open().and_then(solved),
        open().and_then(exported),
    ]
}

/// Returns whether `check` refuses a store or says that something of it does not hold.
fn is_found(directory: &Path) -> bool {
    match Store::open(directory) {
        Ok(store) => check(&store, &CheckOptions::default()).map_or(true, |report| !report.ok),
        Err(_) => true,
    }
}

fn mutants(count: u64, seed: u64) {
    let whole: Vec<(tempfile::TempDir, Sample)> = [Form::Plain, Form::Compact, Form::Double]
        .into_iter()
        .map(|form| {
            let place = tempfile::tempdir().unwrap();
            let sample = sample(40, 40, 20, 71).in_form(form);
            sample.write(place.path());
            (place, sample)
        })
        .collect();
    let place = tempfile::tempdir().unwrap();
    let mut random = Random(seed);
    let wanted: Vec<_> = whole
        .iter()
        .map(|(whole, _)| products(whole.path(), place.path()))
        .collect();
    assert!(wanted.iter().flatten().all(Result::is_ok), "the whole stores are sound");
    let mut refused = 0;
    for number in 0..count {
        // Parts are doctored through arrays that the plain form has.
        let kind = random.below(4);
        let form = if kind == 0 { 0 } else { random.below(2) as usize };
        let directory = place.path().join("F");
        for (file, bytes) in sample::files(whole[form].0.path()) {
            let path = directory.join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, bytes).unwrap();
        }
        let change = match kind {
            0 => {
                let mut part = whole[0].1.parts[random.below(2) as usize].clone();
                let change = doctored_part(&mut part, &mut random);
                doctor_part(&directory, &part);
                change
            }
            1 => doctored_table(&directory, &mut random),
            2 => doctored_manifest(&directory, &mut random),
            _ => raw(&directory, &mut random),
        };
        let found = products(&directory, place.path());
        for (product, (found, wanted)) in found.iter().zip(&wanted[form]).enumerate() {
            assert!(
                found.is_err() || found == wanted,
                "mutant {number} ({change}): product {product} differs from the whole store's"
            );
        }
        let differs = found.iter().any(Result::is_err);
        refused += u64::from(differs);
        assert!(
            !differs || is_found(&directory),
            "mutant {number} ({change}): `check` says that it holds"
        );
        std::fs::remove_dir_all(&directory).unwrap();
    }
    eprintln!("{refused} of {count} mutants refused, the others as the whole store");
    assert!(refused * 10 > count * 8, "{refused} of {count}: most mutants are none");
}

#[test]
fn mutants_of_stores_are_refused_or_as_the_whole() {
    mutants(300, 1);
}

#[test]
#[ignore = "minutes: ./test --full"]
fn many_mutants_of_stores_are_refused_or_as_the_whole() {
    mutants(20_000, 2);
}
