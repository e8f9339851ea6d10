//! The compact form: what it keeps, what it refuses, and that no reader trusts it blindly.

use super::sample::{Sample, array, doctor_manifest, npy, replace_members, sample};
use hemicube::analysis::check::{Check, CheckOptions, check};
use hemicube::store::{Error, Form, Matrix, Store};
use hemicube_export::{ExportFormat, ExportOptions, export};
use hemicube_scene::InputPatch;
use std::path::Path;

fn compact(seed: u64) -> Sample {
    sample(90, 90, 32, seed).in_form(Form::Compact)
}

#[test]
fn what_is_not_rounded_yet_is_when_it_is_written() {
    let place = tempfile::tempdir().unwrap();
    let exact = sample(90, 90, 32, 21);
    let mut unrounded = sample(90, 90, 32, 21);
    unrounded.header.form = Form::Compact;
    let store = unrounded.write(place.path());
    let rounded = compact(21);
    let table = store.row_table().unwrap();
    for (place, (part, exact)) in rounded.parts.iter().zip(&exact.parts).enumerate() {
        assert_eq!(store.part(place).unwrap().as_ref(), Some(part));
        assert_ne!(part.data, exact.data);
        for (kept, computed) in part.data.iter().zip(&exact.data) {
            let off = (kept - computed).abs();
            assert!(off <= Form::Compact.value_error() * computed);
        }
        for (row, &patch) in part.rows.iter().enumerate() {
            let sum: f64 = part.row(row).1.iter().sum();
            assert_eq!(table.row_sum[patch as usize], sum, "the table says what is stored");
        }
    }
    assert_eq!(store.manifest().value_error, 1.0 / 2048.0);
}

#[test]
fn a_check_allows_the_stated_error_and_no_more() {
    let place = tempfile::tempdir().unwrap();
    let sample = compact(22);
    let store = sample.write(place.path());
    let report = check(&store, &CheckOptions::default()).unwrap();
    assert!(report.ok, "{:?}", report.failures);
    assert_eq!((report.form, report.value_error), (Form::Compact, 1.0 / 2048.0));
    assert_eq!(report.closure.bound, Some(1e-6 + 1.0 / 2048.0));
    assert!(report.closure.max > 1e-6, "rounding shows");

    // Every factor of a row three codes up: three times what rounding can do.
    let path = place.path().join("parts/part-00000.npz");
    let mut codes: Vec<u16> = array(&path, "codes");
    let row = (0..).find(|&row| sample.parts[0].row(row).1.len() > 3).unwrap();
    let bounds = [row, row + 1].map(|row| usize::try_from(sample.parts[0].indptr[row]).unwrap());
    codes[bounds[0]..bounds[1]].iter_mut().for_each(|code| *code += 3);
    replace_members(
        &path,
        &[("codes", npy(&[codes.len() as u64], &codes))],
        zip::CompressionMethod::Stored,
    );
    let checksum = blake3::hash(&std::fs::read(&path).unwrap()).to_hex().to_string();
    doctor_manifest(place.path(), |manifest| {
        manifest["parts"][0]["blake3"] = checksum.into()
    });
    let report = check(&Store::open(place.path()).unwrap(), &CheckOptions::default()).unwrap();
    let failed: Vec<Check> = report.failures.iter().map(|failure| failure.check).collect();
    assert_eq!(failed, [Check::Table, Check::Visible, Check::Closure]);
}

#[test]
fn factors_that_the_form_cannot_hold_are_refused() {
    for wrong in [-0.25, 2.0, f64::NAN] {
        let place = tempfile::tempdir().unwrap();
        let mut sample = compact(23);
        let mut writer = sample.writer(place.path());
        sample.parts[0].data.set(3, wrong);
        let error = writer.write_part(&sample.parts[0]).unwrap_err();
        assert!(matches!(error, Error::Refused { .. }), "{error}");
        sample.parts[0].data.set(3, 0.25);
        writer.write_part(&sample.parts[0]).unwrap();
    }
}

#[test]
fn exports_and_matrices_of_both_forms_are_the_same() {
    let place = tempfile::tempdir().unwrap();
    let stores = [Form::Plain, Form::Compact].map(|form| {
        let mut sample = compact(24);
        sample.header.form = form;
        sample.write(&place.path().join(format!("{form:?}")))
    });
    assert_ne!(
        std::fs::read(stores[0].directory().join("parts/part-00001.npz")).unwrap(),
        std::fs::read(stores[1].directory().join("parts/part-00001.npz")).unwrap()
    );
    for name in ["F.npz", "F.mtx", "F.txt", "F.npy"] {
        let files = stores.each_ref().map(|store| {
            let path = store.directory().with_extension(name);
            export(store, &path, ExportFormat::of(&path).unwrap(), ExportOptions::default()).unwrap();
            std::fs::read(path).unwrap()
        });
        assert!(files[0] == files[1], "{name}");
    }
    let matrices = stores.each_ref().map(|store| Matrix::open(store.directory()).unwrap());
    for row in 0..90 {
        assert_eq!(matrices[0].row(row).unwrap(), matrices[1].row(row).unwrap());
        let entries = stores
            .each_ref()
            .map(|store| store.entries_of_row(InputPatch(row)).unwrap());
        assert_eq!(entries[0], entries[1]);
    }
}

/// Rows and whole parts, which are read in two ways, and the error that both give.
fn refusal(directory: &Path) -> [String; 2] {
    let store = Store::open_trusting(directory).unwrap();
    let rows = store.rows().and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let row = rows.expect_err("a row that cannot be read");
    let part = store.part(1).expect_err("a part that cannot be read");
    [row.to_string(), part.to_string()]
}

#[test]
fn runs_that_are_not_of_the_entries_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let sample = compact(25);
    sample.write(place.path());
    let path = place.path().join("parts/part-00001.npz");
    let whole = std::fs::read(&path).unwrap();
    let gaps: Vec<u16> = array(&path, "gaps");
    let lengths: Vec<u8> = array(&path, "lengths");
    let runptr: Vec<i64> = array(&path, "runptr");
    let count = [gaps.len() as u64];
    let mut longer = lengths.clone();
    longer[2] += 1;
    let mut wider = gaps.clone();
    wider[1] = u16::MAX;
    let mut unsorted = runptr.clone();
    unsorted[1] = i64::MAX;
    let cases = [
        ("runs of columns", ("lengths", npy(&count, &longer))),
        ("leave the matrix", ("gaps", npy(&count, &wider))),
        ("runptr", ("lengths", npy(&[count[0] - 1], &lengths[1..]))),
        ("runptr", ("runptr", npy(&[runptr.len() as u64], &unsorted))),
        ("u2, u1 and u2", ("lengths", npy(&count, &gaps))),
    ];
    for (word, member) in cases {
        replace_members(&path, std::slice::from_ref(&member), zip::CompressionMethod::Stored);
        for error in refusal(place.path()) {
            assert!(error.contains(word) && error.contains("part-00001"), "{error}");
        }
        std::fs::write(&path, &whole).unwrap();
    }
    // Deflated by another program it is still the same part.
    replace_members(&path, &[], zip::CompressionMethod::Deflated);
    let store = Store::open_trusting(place.path()).unwrap();
    assert_eq!(store.part(1).unwrap().as_ref(), Some(&sample.parts[1]));
    assert_eq!(store.rows().unwrap().filter(Result::is_err).count(), 0);
}

#[test]
fn a_part_of_the_other_form_is_refused() {
    let place = tempfile::tempdir().unwrap();
    compact(26).write(&place.path().join("compact"));
    sample(90, 90, 32, 26).write(&place.path().join("plain"));
    let part = "parts/part-00001.npz";
    std::fs::copy(
        place.path().join("plain").join(part),
        place.path().join("compact").join(part),
    )
    .unwrap();
    for error in refusal(&place.path().join("compact")) {
        assert!(error.contains("Compact"), "{error}");
    }
}

#[test]
fn a_manifest_of_another_value_error_is_refused() {
    let place = tempfile::tempdir().unwrap();
    compact(27).write(place.path());
    doctor_manifest(place.path(), |manifest| manifest["value_error"] = 1e-6.into());
    let error = Store::open(place.path()).unwrap_err().to_string();
    assert!(error.contains("value error"), "{error}");
}
