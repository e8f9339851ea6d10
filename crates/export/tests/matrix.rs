//! Exports hold the matrix, to the bit, in the form that each format prescribes.
#![allow(clippy::cast_possible_truncation, reason = "test matrices are small")]
#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

#[path = "../../hemicube/tests/matrices/store/sample.rs"]
mod sample;

use hemicube_export::{Error, ExportFormat, ExportOptions, ExportReport, export};
use hemicube_solve::analysis::compare::{CompareOptions, compare};
use hemicube_store::{self as store, Matrix, Store};
use sample::{Sample, sample};
use std::path::Path;

fn write(store: &Store, path: &Path) -> ExportReport {
    export(store, path, ExportFormat::of(path).unwrap(), ExportOptions::default()).unwrap()
}

fn exported(extension: &str, seed: u64) -> (tempfile::TempDir, Sample, std::path::PathBuf, ExportReport) {
    let directory = tempfile::tempdir().unwrap();
    let sample = sample(83, 70, 16, seed);
    let store = sample.write(&directory.path().join("store"));
    let path = directory.path().join(format!("matrix.{extension}"));
    let report = write(&store, &path);
    assert_eq!(report.bytes, std::fs::metadata(&path).unwrap().len());
    assert_eq!(
        (report.rows, report.patch_count, report.entries),
        (70, 83, store.manifest().entries)
    );
    let off = report.forecast.unwrap().abs_diff(report.bytes);
    assert!(off < 512 || off < report.bytes / 50, "{report:?}");
    (directory, sample, path, report)
}

#[test]
fn npz_is_the_matrix() {
    let (_directory, sample, path, _) = exported("npz", 1);
    let indptr: Vec<i64> = sample::array(&path, "indptr");
    let indices: Vec<i32> = sample::array(&path, "indices");
    let data: Vec<f32> = sample::array(&path, "data");
    assert_eq!(sample::array::<i64>(&path, "shape"), [83, 83]);
    assert_eq!(indptr.len(), 84);
    for (patch, row) in sample.dense().into_iter().enumerate() {
        let mut found = vec![0.0; 83];
        for place in indptr[patch] as usize..indptr[patch + 1] as usize {
            found[indices[place] as usize] = f64::from(data[place]);
        }
        assert_eq!(found, row.unwrap_or(vec![0.0; 83]), "row {patch}");
    }
}

#[test]
fn npy_is_the_matrix() {
    let (_directory, sample, path, report) = exported("npy", 2);
    assert_eq!(report.forecast, Some(report.bytes));
    let file = npyz::NpyFile::new(std::fs::File::open(&path).unwrap()).unwrap();
    assert_eq!(file.shape(), [83, 83]);
    let found: Vec<f32> = file.into_vec().unwrap();
    let wanted: Vec<f32> = sample
        .dense()
        .into_iter()
        .flat_map(|row| row.unwrap_or(vec![0.0; 83]))
        .map(|factor| factor as f32)
        .collect();
    assert_eq!(found, wanted);
}

/// The matrix that `row column value` lines say, and how many there are.
fn from_lines<'a>(lines: impl Iterator<Item = &'a str>) -> (Vec<Vec<f64>>, usize) {
    let (mut matrix, mut count) = (vec![vec![0.0; 83]; 83], 0);
    for line in lines {
        let words: Vec<&str> = line.split(' ').collect();
        let place = |word: &str| word.parse::<usize>().unwrap() - 1;
        matrix[place(words[0])][place(words[1])] = words[2].parse::<f32>().unwrap().into();
        count += 1;
    }
    (matrix, count)
}

fn wanted(sample: &Sample) -> Vec<Vec<f64>> {
    sample
        .dense()
        .into_iter()
        .map(|row| row.unwrap_or(vec![0.0; 83]))
        .collect()
}

#[test]
fn matrix_market_is_the_matrix() {
    let (_directory, sample, path, report) = exported("mtx", 3);
    let text = std::fs::read_to_string(&path).unwrap();
    let mut lines = text.lines().skip_while(|line| line.starts_with('%'));
    assert!(text.starts_with("%%MatrixMarket matrix coordinate real general\n"));
    assert!(text.contains("F[i,j] is from i to j"));
    assert_eq!(lines.next(), Some(format!("83 83 {}", report.entries).as_str()));
    let (matrix, count) = from_lines(lines);
    assert_eq!(count as u64, report.entries);
    assert_eq!(matrix, wanted(&sample));
}

#[test]
fn triplets_are_the_matrix_and_end_with_its_size() {
    for extension in ["txt", "dat"] {
        let (_directory, sample, path, report) = exported(extension, 4);
        let text = std::fs::read_to_string(&path).unwrap();
        let body = text.strip_suffix("83 83 0\n").unwrap();
        let (matrix, count) = from_lines(body.lines());
        assert_eq!(count as u64, report.entries);
        assert_eq!(matrix, wanted(&sample));
    }
}

#[test]
fn a_store_and_its_exports_compare_as_equal_and_a_changed_one_does_not() {
    let directory = tempfile::tempdir().unwrap();
    let sample = sample(60, 45, 16, 5);
    let place = directory.path().join("store");
    let store = sample.write(&place);
    let reference = Matrix::open(&place).unwrap();
    for extension in ["npz", "mtx", "npy"] {
        let path = directory.path().join(format!("matrix.{extension}"));
        write(&store, &path);
        let found = compare(&Matrix::open(&path).unwrap(), &reference, &CompareOptions::default()).unwrap();
        assert!(found.is_equal(), "{extension}: {found:?}");
        assert_eq!(
            (found.rows_compared, found.relative_frobenius),
            (45, 0.0),
            "{extension}"
        );
        assert_eq!(found.entries_in_reference, store.manifest().entries);
    }
    let mut changed = self::sample(60, 45, 16, 5);
    let part = &mut changed.parts[1];
    let largest = (0..part.data.len())
        .max_by(|&a, &b| part.data.at(a).total_cmp(&part.data.at(b)))
        .unwrap();
    part.data.set(largest, part.data.at(largest) * 0.5);
    let other = directory.path().join("other");
    changed.write(&other);
    let found = compare(&Matrix::open(&other).unwrap(), &reference, &CompareOptions::default()).unwrap();
    assert!(!found.is_equal() && found.relative_frobenius > 0.0 && found.row_error.max > 0.0);
    let worst = found.worst_entry.unwrap();
    assert_eq!(
        (worst.j, worst.a * 2.0),
        (changed.parts[1].indices[largest] as u32, worst.b)
    );
    // Fewer rows, and fewer of them in common.
    let fewer = self::sample(60, 30, 16, 5);
    let few = directory.path().join("few");
    fewer.write(&few);
    let found = compare(&Matrix::open(&few).unwrap(), &reference, &CompareOptions::default()).unwrap();
    assert_eq!(
        (
            found.rows_compared,
            found.rows_only_in_matrix,
            found.rows_only_in_reference
        ),
        (30, 0, 15)
    );
}

#[test]
fn what_cannot_be_exported_is_refused_and_leaves_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let sample = sample(60, 60, 16, 6);
    let store = sample.write(&directory.path().join("store"));
    let refuse = |path: &Path, options| export(&store, path, ExportFormat::Npz, options).unwrap_err();
    let path = directory.path().join("matrix.npz");
    std::fs::write(&path, "important").unwrap();
    assert!(matches!(
        refuse(&path, ExportOptions::default()),
        Error::Store(store::Error::Exists { .. })
    ));
    assert_eq!(std::fs::read(&path).unwrap(), b"important");
    assert!(matches!(
        refuse(directory.path(), ExportOptions::default()),
        Error::Store(store::Error::InTheWay { .. })
    ));
    assert!(matches!(
        refuse(&directory.path().join("no/where.npz"), ExportOptions::default()),
        Error::Store(store::Error::Io { .. })
    ));
    let options = ExportOptions {
        overwrite: true,
        ..ExportOptions::default()
    };
    export(&store, &path, ExportFormat::Npz, options).unwrap();
    Matrix::open(&path).unwrap();
    let error = ExportFormat::of(Path::new("matrix.h5")).unwrap_err();
    assert!(error.to_string().contains("`.mtx`"), "{error}");

    let interrupted = directory.path().join("interrupted");
    let mut writer = sample.writer(&interrupted);
    writer.write_part(&sample.parts[0]).unwrap();
    writer.interrupt().unwrap();
    let partial = Store::open(&interrupted).unwrap();
    let path = directory.path().join("partial.npz");
    let error = export(&partial, &path, ExportFormat::Npz, ExportOptions::default()).unwrap_err();
    assert!(matches!(error, Error::Store(store::Error::Incomplete { .. })));
    let options = ExportOptions {
        allow_incomplete: true,
        ..options
    };
    assert_eq!(export(&partial, &path, ExportFormat::Npz, options).unwrap().rows, 16);

    // A part that turns out to be damaged half way leaves no half of a file, and no temporary one.
    let part = directory.path().join("store/parts/part-00002.npz");
    let bytes = std::fs::read(&part).unwrap();
    std::fs::write(&part, &bytes[..bytes.len() / 2]).unwrap();
    let damaged = Store::open(&directory.path().join("store")).unwrap();
    for extension in ["npz", "npy", "mtx", "txt"] {
        let path = directory.path().join(format!("damaged.{extension}"));
        let error = export(
            &damaged,
            &path,
            ExportFormat::of(&path).unwrap(),
            ExportOptions::default(),
        )
        .unwrap_err();
        assert!(error.to_string().contains("part-00002.npz"), "{error}");
    }
    let names: Vec<String> = sample::files(directory.path()).into_keys().collect();
    assert!(
        names
            .iter()
            .all(|name| !name.contains("damaged") && !name.contains("tmp")),
        "{names:?}"
    );
}

#[cfg(target_os = "linux")]
#[test]
fn an_export_that_the_disk_cannot_hold_is_refused_before_it_is_written() {
    let directory = tempfile::tempdir().unwrap();
    let store = sample(2000, 3, 2, 7).write(&directory.path().join("store"));
    let small = tempfile::tempdir().unwrap();
    let mount = std::process::Command::new("mount")
        .args(["-t", "tmpfs", "-o", "size=1m", "tmpfs"])
        .arg(small.path())
        .output();
    if !mount.is_ok_and(|output| output.status.success()) {
        eprintln!("SKIP an_export_that_the_disk_cannot_hold: a small file system cannot be mounted");
        return;
    }
    let path = small.path().join("dense.npy");
    let refused = export(&store, &path, ExportFormat::Npy, ExportOptions::default());
    let left = std::fs::read_dir(small.path()).unwrap().count();
    let fits = export(
        &store,
        &small.path().join("sparse.npz"),
        ExportFormat::Npz,
        ExportOptions::default(),
    );
    assert!(
        std::process::Command::new("umount")
            .arg(small.path())
            .status()
            .unwrap()
            .success()
    );
    let Err(Error::Store(store::Error::DiskTooSmall { wanted, available, .. })) = refused else {
        panic!("{refused:?}")
    };
    assert_eq!((wanted, left), (16_000_128, 0));
    assert!(available <= 1 << 20);
    fits.unwrap();
}
