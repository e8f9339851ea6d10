//! The store on disk: it reads back, is the same bytes every time, notices damage, and survives a full disk.
#![allow(clippy::cast_possible_truncation, reason = "test matrices are small")]
#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]
#![allow(clippy::type_complexity, reason = "tables of cases")]

mod check;
mod compact;
mod mutants;
pub(crate) mod sample;

use hemicube::store::{
    Error, FactorVec, Form, HEMICUBE_WEIGHT, Matrix, Part, RowShares, RowSums, Shard, Store, StoreWriter, merge,
};
use hemicube_scene::InputPatch;
use sample::{Random, doctor_manifest, files, sample};
use std::path::Path;

#[test]
fn a_store_reads_back_what_was_written() {
    for form in [Form::Plain, Form::Compact, Form::Double] {
        reads_back(form);
    }
}

fn reads_back(form: Form) {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path().join("deep/er/store");
    let sample = sample(97, 60, 16, 1).in_form(form);
    let store = sample.write(&place);
    assert_eq!(store.patch_count(), 97);
    let manifest = store.manifest();
    assert_eq!(
        (manifest.part_count, manifest.rows_present(), manifest.complete),
        (4, 60, true)
    );
    assert_eq!(
        manifest.entries,
        sample.parts.iter().map(|part| part.data.len() as u64).sum::<u64>()
    );
    assert_eq!(store.patches().unwrap(), sample.patches);

    let dense = sample.dense();
    let expand = |row: hemicube::store::Row| {
        let mut expanded = vec![0.0; 97];
        for (&column, factor) in row.indices.iter().zip(&row.data) {
            expanded[column as usize] = factor;
        }
        expanded
    };
    for patch in 0..97 {
        let row = store.row(InputPatch(patch)).unwrap();
        assert_eq!(
            store.entries_of_row(InputPatch(patch)).unwrap(),
            row.as_ref().map(|row| row.data.len() as u64)
        );
        assert_eq!(row.map(expand), dense[patch as usize], "row {patch}");
    }
    assert_eq!(store.row(InputPatch(97)).unwrap(), None);
    assert_eq!(store.row(InputPatch(u32::MAX)).unwrap(), None);

    let order: Vec<u32> = store.rows().unwrap().map(|row| row.unwrap().0.0).collect();
    let wanted: Vec<u32> = (0..97).filter(|&patch| dense[patch as usize].is_some()).collect();
    assert_eq!(order, wanted);
    let order: Vec<u32> = store
        .rows_in_processing_order()
        .unwrap()
        .map(|row| row.unwrap().0.0)
        .collect();
    let wanted: Vec<u32> = sample.parts.iter().flat_map(|part| part.rows.clone()).collect();
    assert_eq!(order, wanted);

    for (place, part) in sample.parts.iter().enumerate() {
        store.verify_part(place).unwrap();
        assert_eq!(store.part(place).unwrap().as_ref(), Some(part));
    }
    assert_eq!(store.part(4).unwrap(), None);
    store.verify_patches().unwrap();

    let table = store.row_table().unwrap();
    for part in &sample.parts {
        for (row, &patch) in part.rows.iter().enumerate() {
            let (patch, whole) = (
                patch as usize,
                (u64::from(part.hemicubes[row]) * HEMICUBE_WEIGHT) as f64,
            );
            assert_eq!(table.escaped[patch], part.sums[row].escaped as f64 / whole);
            assert_eq!(table.blocked[patch], part.sums[row].blocked as f64 / whole);
            assert_eq!(table.unselected[patch], part.sums[row].unselected as f64 / whole);
            assert_eq!(table.hemicube_blocked[patch], table.blocked[patch], "sums of pixels");
            let off = (table.row_sum[patch] - part.sums[row].visible as f64 / whole).abs();
            assert!(off < 1e-7 + form.value_error());
        }
    }
    assert_eq!(table.row_sum.iter().filter(|sum| sum.is_nan()).count(), 37);
}

#[test]
fn other_readers_find_the_same_arrays() {
    let directory = tempfile::tempdir().unwrap();
    let sample = sample(40, 40, 16, 2);
    sample.write(directory.path());
    for part in &sample.parts {
        let path = directory.path().join(format!("parts/part-{:05}.npz", part.index));
        match &part.data {
            FactorVec::Single(data) => assert_eq!(&sample::array::<f32>(&path, "data"), data),
            FactorVec::Double(data) => assert_eq!(&sample::array::<f64>(&path, "data"), data),
        }
        assert_eq!(sample::array::<i32>(&path, "indices"), part.indices);
        assert_eq!(sample::array::<i64>(&path, "indptr"), part.indptr);
        assert_eq!(sample::array::<u32>(&path, "rows"), part.rows);
        assert_eq!(sample::array::<u32>(&path, "hemicubes"), part.hemicubes);
        assert_eq!(sample::array::<i64>(&path, "shape"), [part.rows.len() as i64, 40]);
        let sums: Vec<u64> = sample::array(&path, "sums");
        assert_eq!(
            sums[..4],
            [
                part.sums[0].visible,
                part.sums[0].escaped,
                part.sums[0].blocked,
                part.sums[0].unselected
            ]
        );
    }
    let path = directory.path().join("patches.npz");
    assert_eq!(sample::array::<f64>(&path, "area"), sample.patches.area);
    assert_eq!(sample::array::<u8>(&path, "side"), sample.patches.side);
    assert_eq!(
        sample::array::<f64>(&path, "centroid"),
        sample.patches.centroid.as_flattened()
    );
}

#[test]
fn equal_runs_write_equal_bytes_whatever_the_order_of_the_parts() {
    for form in [Form::Plain, Form::Compact, Form::Double] {
        writes_equal_bytes(form);
    }
}

fn writes_equal_bytes(form: Form) {
    let directory = tempfile::tempdir().unwrap();
    let (first, second) = (directory.path().join("first"), directory.path().join("second"));
    let sample = sample(64, 64, 10, 3).in_form(form);
    sample.write(&first);
    let mut writer = sample.writer(&second);
    for part in sample.parts.iter().rev() {
        writer.write_part(part).unwrap();
    }
    writer.finish().unwrap();
    let (first, second) = (files(&first), files(&second));
    assert_eq!(first.len(), 2 + 7);
    assert!(first == second);
    let names: Vec<&String> = first.keys().collect();
    assert!(names.iter().all(|name| !name.contains("tmp")), "{names:?}");
    let other = self::sample(64, 64, 10, 4);
    let third = directory.path().join("third");
    other.write(&third);
    assert!(files(&third) != first);
}

#[test]
fn zero_rows_and_zero_patches_are_stores_too() {
    let directory = tempfile::tempdir().unwrap();
    let empty = sample(0, 0, 4, 5);
    let store = empty.write(&directory.path().join("empty"));
    assert!(store.manifest().complete);
    assert_eq!(store.rows().unwrap().count(), 0);
    let unsampled = sample(9, 0, 4, 5).write(&directory.path().join("unsampled"));
    assert_eq!(unsampled.row(InputPatch(3)).unwrap(), None);
    assert!(unsampled.row_table().unwrap().row_sum.iter().all(|sum| sum.is_nan()));
}

#[test]
fn an_interrupted_run_names_the_parts_that_are_there() {
    let directory = tempfile::tempdir().unwrap();
    let sample = sample(50, 50, 16, 6);
    let mut writer = sample.writer(directory.path());
    // Even a run that is killed here leaves a store, though one without parts.
    let killed = Store::open(directory.path()).unwrap();
    assert!(!killed.manifest().complete && killed.manifest().parts.is_empty());
    assert_eq!(killed.patches().unwrap(), sample.patches);
    writer.write_part(&sample.parts[2]).unwrap();
    writer.write_part(&sample.parts[0]).unwrap();
    let manifest = writer.interrupt().unwrap();
    assert!(!manifest.complete);
    let store = Store::open(directory.path()).unwrap();
    assert_eq!(store.manifest(), &manifest);
    assert_eq!(
        store.manifest().parts.iter().map(|part| part.index).collect::<Vec<_>>(),
        [0, 2]
    );
    let wanted: Vec<u32> = [0, 2]
        .iter()
        .flat_map(|&part: &usize| sample.parts[part].rows.clone())
        .collect();
    let order: Vec<u32> = store
        .rows_in_processing_order()
        .unwrap()
        .map(|row| row.unwrap().0.0)
        .collect();
    assert_eq!(order, wanted);
    assert_eq!(store.row(InputPatch(sample.parts[1].rows[0])).unwrap(), None);
    assert!(matches!(
        store.require_complete(),
        Err(Error::Incomplete {
            present: 2,
            expected: 4,
            ..
        })
    ));

    let again = directory.path().join("again");
    let mut writer = sample.writer(&again);
    writer.write_part(&sample.parts[1]).unwrap();
    assert!(matches!(
        writer.finish(),
        Err(Error::Incomplete {
            present: 1,
            expected: 4,
            ..
        })
    ));
    // An interrupt that comes after the last part has nothing to interrupt.
    let late = directory.path().join("late");
    let mut writer = sample.writer(&late);
    for part in &sample.parts {
        writer.write_part(part).unwrap();
    }
    assert!(writer.interrupt().unwrap().complete);
}

#[test]
fn what_is_in_the_way_is_refused_before_anything_is_computed() {
    let directory = tempfile::tempdir().unwrap();
    let sample = sample(20, 20, 8, 7);
    let create = |place: &Path, overwrite| {
        StoreWriter::create(place, sample.header.clone(), &sample.patches, overwrite).map(|_| ())
    };
    let file = directory.path().join("file");
    std::fs::write(&file, "important").unwrap();
    assert!(matches!(create(&file, true), Err(Error::InTheWay { .. })));
    assert!(matches!(create(&file.join("below"), true), Err(Error::Io { .. })));
    assert_eq!(std::fs::read(&file).unwrap(), b"important");
    let foreign = directory.path().join("foreign");
    std::fs::create_dir(&foreign).unwrap();
    std::fs::write(foreign.join("notes.txt"), "important").unwrap();
    let error = create(&foreign, true).unwrap_err();
    assert!(error.to_string().contains("holds something, and no store"), "{error}");
    assert_eq!(files(&foreign).len(), 1);
    let bare = directory.path().join("bare");
    std::fs::create_dir(&bare).unwrap();
    create(&bare, false).unwrap();

    let store = directory.path().join("store");
    sample.write(&store);
    let before = files(&store);
    let error = create(&store, false).unwrap_err();
    assert!(matches!(error, Error::Exists { .. }), "{error}");
    assert!(files(&store) == before);
    // Replaced, and nothing of the old store is left; what is not the store's stays.
    std::fs::write(store.join("notes.txt"), "important").unwrap();
    std::fs::write(store.join("parts/.part-00009.npz.hemicube-tmp"), "left by a killed run").unwrap();
    create(&store, true).unwrap();
    let names: Vec<String> = files(&store).into_keys().collect();
    assert_eq!(names, ["manifest.json", "notes.txt", "patches.npz"]);
    assert!(!Store::open(&store).unwrap().manifest().complete);
}

#[test]
fn a_part_that_no_reader_could_rely_on_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let sample = sample(30, 30, 10, 8);
    let mut writer = sample.writer(directory.path());
    let last = sample.parts[1].data.len() - 1;
    let cases: [(&str, &dyn Fn(&mut Part)); 17] = [
        ("part 7 of 3", &|part| part.index = 7),
        ("10 rows", &|part| {
            part.rows.pop();
        }),
        ("10 rows", &|part| {
            part.sums.pop();
        }),
        ("`indptr`", &|part| part.indptr[0] = 1),
        ("`indptr`", &|part| part.indptr[10] += 1),
        ("`indptr`", &|part| part.indptr[2] = part.indptr[10] + 1),
        ("does not exist", &|part| part.rows[3] = 30),
        ("has a row already", &|part| part.rows[3] = part.rows[4]),
        ("leave the matrix", &|part| part.indices[0] = -1),
        ("leave the matrix", &|part| part.indices[last] = 30),
        ("do not ascend", &|part| part.indices[1] = part.indices[0]),
        ("NaN", &|part| part.data.set(5, f64::NAN)),
        ("sum to", &|part| part.sums[0].escaped += 1),
        ("10 rows", &|part| {
            part.shares.pop();
        }),
        ("has the shares", &|part| part.shares[4].blocked = f64::NAN),
        ("has the shares", &|part| part.shares[4].escaped = 1.1),
        ("sum to", &|part| {
            part.sums[2] = RowSums {
                visible: u64::MAX,
                escaped: 5,
                ..RowSums::default()
            }
        }),
    ];
    for (wanted, doctor) in cases {
        let mut part = sample.parts[1].clone();
        doctor(&mut part);
        let error = writer.write_part(&part).unwrap_err();
        assert!(matches!(error, Error::Refused { .. }), "{error}");
        assert!(error.to_string().contains(wanted), "{error} does not say {wanted}");
    }
    for part in &sample.parts {
        writer.write_part(part).unwrap();
    }
    assert!(
        writer
            .write_part(&sample.parts[0])
            .unwrap_err()
            .to_string()
            .contains("written before")
    );
    writer.finish().unwrap();

    let mut header = sample.header.clone();
    header.row_count = 31;
    let place = directory.path().join("x");
    let mut patches = sample.patches.clone();
    assert!(matches!(
        StoreWriter::create(&place, header, &patches, false),
        Err(Error::Refused { .. })
    ));
    patches.area.pop();
    assert!(matches!(
        StoreWriter::create(&place, sample.header, &patches, false),
        Err(Error::Refused { .. })
    ));
    assert!(!place.exists());
}

/// Reads everything, without looking at a checksum first: it may find an error, and must not panic or hang.
fn read_all(directory: &Path) -> Result<(), Error> {
    let store = Store::open_trusting(directory)?;
    for row in store.rows()? {
        row?;
    }
    for place in 0..store.manifest().parts.len() {
        store.part(place)?;
    }
    store.patches()?;
    store.row_table()?;
    Ok(())
}

#[test]
fn every_truncation_is_an_error_that_names_the_file() {
    for form in [Form::Plain, Form::Compact, Form::Double] {
        truncations_are_errors(form);
    }
}

fn truncations_are_errors(form: Form) {
    let directory = tempfile::tempdir().unwrap();
    sample(120, 120, 40, 9).in_form(form).write(directory.path());
    for file in ["parts/part-00001.npz", "patches.npz", "manifest.json"] {
        let path = directory.path().join(file);
        let whole = std::fs::read(&path).unwrap();
        for fiftieth in 0..50 {
            std::fs::write(&path, &whole[..whole.len() * fiftieth / 50]).unwrap();
            let error = read_all(directory.path()).unwrap_err().to_string();
            assert!(error.contains(file), "{fiftieth}/50 of {file}: {error}");
            if file != "manifest.json"
                && let Ok(store) = Store::open(directory.path())
            {
                assert!(store.verify_part(1).is_err() || store.verify_patches().is_err());
            }
        }
        std::fs::write(&path, &whole).unwrap();
    }
    std::fs::remove_file(directory.path().join("parts/part-00001.npz")).unwrap();
    let error = read_all(directory.path()).unwrap_err().to_string();
    assert!(error.contains("part-00001.npz"), "{error}");
}

#[test]
fn every_flipped_bit_is_detected_and_none_brings_a_reader_down() {
    for form in [Form::Plain, Form::Compact, Form::Double] {
        flipped_bits_are_detected(form);
    }
}

fn flipped_bits_are_detected(form: Form) {
    let directory = tempfile::tempdir().unwrap();
    sample(120, 120, 40, 10).in_form(form).write(directory.path());
    let mut random = Random(11);
    for file in ["parts/part-00001.npz", "patches.npz", "manifest.json"] {
        let path = directory.path().join(file);
        let whole = std::fs::read(&path).unwrap();
        // Anywhere, and among the headers at the end, which decide what is allocated.
        for case in 0..400u64 {
            let reach = if case % 2 == 0 {
                whole.len()
            } else {
                whole.len().min(900)
            } as u64;
            let bit = (whole.len() as u64 - reach) * 8 + random.below(reach * 8);
            let mut doctored = whole.clone();
            doctored[usize::try_from(bit / 8).unwrap()] ^= 1 << (bit % 8);
            std::fs::write(&path, &doctored).unwrap();
            let read = read_all(directory.path());
            match Store::open(directory.path()) {
                Ok(store) => {
                    assert_ne!(file, "manifest.json", "bit {bit} of the manifest went unnoticed");
                    // Whoever reads a row of the part, or the table, is told.
                    let row = store
                        .rows_in_processing_order()
                        .and_then(|mut rows| rows.nth(45).transpose());
                    assert!(
                        row.is_err() || file == "patches.npz" && store.patches().is_err(),
                        "bit {bit} of {file}"
                    );
                    let verified = store.verify_part(1).and_then(|()| store.verify_patches());
                    assert!(
                        matches!(verified, Err(Error::Checksum { .. })),
                        "bit {bit} of {file}: {verified:?}"
                    );
                }
                Err(_) => assert!(read.is_err()),
            }
        }
        std::fs::write(&path, &whole).unwrap();
    }
    read_all(directory.path()).unwrap();
}

#[test]
fn a_manifest_that_claims_too_much_is_refused_without_allocating_it() {
    let directory = tempfile::tempdir().unwrap();
    let fresh = || {
        let place = tempfile::tempdir_in(directory.path()).unwrap();
        sample(40, 40, 16, 12).write(place.path());
        place
    };
    let cases: [(&str, &dyn Fn(&mut serde_json::Value)); 10] = [
        ("version 4", &|manifest| manifest["version"] = 4.into()),
        ("no manifest", &|manifest| manifest["format"] = "other".into()),
        ("cannot be", &|manifest| {
            manifest["patch_count"] = 4_294_967_295u32.into()
        }),
        ("cannot be", &|manifest| manifest["row_count"] = 41.into()),
        ("cannot be", &|manifest| manifest["rows_per_part"] = 0.into()),
        ("does not fit", &|manifest| {
            manifest["parts"][1]["file"] = "../../secret.npz".into()
        }),
        ("does not fit", &|manifest| {
            manifest["parts"][1]["entries"] = u64::MAX.into()
        }),
        ("totals", &|manifest| manifest["entries"] = 1.into()),
        ("unknown field", &|manifest| manifest["surplus"] = 1.into()),
        ("patches.npz` is shorter", &|manifest| {
            manifest["patch_count"] = 2_000_000_000.into()
        }),
    ];
    for (wanted, change) in cases {
        let place = fresh();
        doctor_manifest(place.path(), change);
        let error = Store::open(place.path()).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error} does not say {wanted}");
    }
    let place = fresh();
    let path = place.path().join("manifest.json");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("room.obj", "roam.obj")).unwrap();
    assert!(
        Store::open(place.path())
            .unwrap_err()
            .to_string()
            .contains("changed since")
    );
    assert!(
        Store::open(directory.path())
            .unwrap_err()
            .to_string()
            .contains("is no store")
    );
    assert!(Store::open(&directory.path().join("nowhere")).is_err());
    // The helper itself does not invalidate a manifest.
    let place = fresh();
    doctor_manifest(place.path(), |_| {});
    read_all(place.path()).unwrap();
}

#[test]
fn a_part_that_claims_too_much_is_refused_without_allocating_it() {
    let directory = tempfile::tempdir().unwrap();
    sample(40, 40, 16, 13).write(directory.path());
    let path = directory.path().join("parts/part-00001.npz");
    let whole = std::fs::read(&path).unwrap();
    let claim = |text: &str| {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend_from_slice(&u16::try_from(text.len()).unwrap().to_le_bytes());
        bytes.extend_from_slice(text.as_bytes());
        bytes
    };
    let huge = claim("{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000,), }\n");
    let deep = claim(&format!("{{'descr': {}", "(".repeat(10_000)));
    let long = [b"\x93NUMPY\x02\x00".as_slice(), &u32::MAX.to_le_bytes(), &[b' '; 64]].concat();
    for member in ["data", "indices", "indptr", "rows", "sums", "format"] {
        for content in [&huge, &deep, &long, &Vec::new()] {
            for method in [zip::CompressionMethod::Stored, zip::CompressionMethod::Deflated] {
                std::fs::write(&path, &whole).unwrap();
                sample::replace_members(&path, &[(member, content.clone())], method);
                let error = read_all(directory.path()).unwrap_err().to_string();
                assert!(error.contains("part-00001.npz"), "{error}");
            }
        }
    }
}

#[test]
fn compressed_and_wider_matrices_are_read_as_scipy_saves_them() {
    let directory = tempfile::tempdir().unwrap();
    let sample = sample(16, 16, 16, 14);
    sample.write(directory.path());
    let path = directory.path().join("matrix.npz");
    let wide: Vec<i64> = sample.parts[0].indices.iter().map(|&index| index.into()).collect();
    let double: Vec<f64> = sample.parts[0].data.iter().collect();
    let entries = wide.len() as u64;
    for method in [zip::CompressionMethod::Stored, zip::CompressionMethod::Deflated] {
        std::fs::copy(directory.path().join("parts/part-00000.npz"), &path).unwrap();
        let members = [
            ("indices", sample::npy(&[entries], &wide)),
            ("data", sample::npy(&[entries], &double)),
        ];
        sample::replace_members(&path, &members, method);
        let matrix = Matrix::open(&path).unwrap();
        for (row, &patch) in sample.parts[0].rows.iter().enumerate() {
            let found = matrix.row(row as u32).unwrap().unwrap();
            let wanted = sample.dense()[patch as usize].clone().unwrap();
            let values: Vec<f64> = found.columns.iter().map(|&column| wanted[column as usize]).collect();
            assert_eq!(found.values, values);
        }
    }
    assert!(Matrix::open(&directory.path().join("patches.npz")).is_err());
    assert!(
        Matrix::open(Path::new("matrix.h5"))
            .unwrap_err()
            .to_string()
            .contains("`.npz`")
    );
}

/// A file system of `kibibytes`, unmounted when dropped.
#[cfg(target_os = "linux")]
struct SmallDisk(tempfile::TempDir);

#[cfg(target_os = "linux")]
impl SmallDisk {
    fn new(test: &str, kibibytes: u32) -> Option<Self> {
        let directory = tempfile::tempdir().unwrap();
        let mounted = std::process::Command::new("mount")
            .args(["-t", "tmpfs", "-o", &format!("size={kibibytes}k"), "tmpfs"])
            .arg(directory.path())
            .output();
        match mounted {
            Ok(output) if output.status.success() => Some(Self(directory)),
            _ => {
                eprintln!("SKIP {test}: a small file system cannot be mounted (needs root and `mount`)");
                None
            }
        }
    }
}

#[cfg(target_os = "linux")]
impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = std::process::Command::new("umount").arg(self.0.path()).status();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_loses_nothing_that_was_written() {
    let Some(disk) = SmallDisk::new("a_full_disk_loses_nothing_that_was_written", 296) else {
        return;
    };
    let ballast = disk.0.path().join("ballast");
    std::fs::write(&ballast, vec![1; 16 << 10]).unwrap();
    let sample = sample(300, 300, 50, 15);
    let place = disk.0.path().join("store");
    let mut writer = sample.writer(&place);
    let mut written = 0;
    let error = loop {
        match writer.write_part(&sample.parts[written]) {
            Ok(()) => written += 1,
            Err(error) => break error,
        }
    };
    assert!((1..6).contains(&written), "{written}");
    let Error::NoSpace { path, wanted, .. } = &error else {
        panic!("{error:?}")
    };
    assert!(path.ends_with(format!("parts/part-{written:05}.npz")), "{error}");
    assert!(*wanted > 8 * sample.parts[written].data.len() as u64);
    let left: Vec<String> = files(&place).into_keys().filter(|name| name.contains("tmp")).collect();
    assert_eq!(left, [".lock.hemicube-tmp"], "the writer is still there");
    // The manifest needs some room again.
    std::fs::remove_file(&ballast).unwrap();
    writer.interrupt().unwrap();
    let store = Store::open(&place).unwrap();
    assert_eq!(store.manifest().parts.len(), written);
    for place in 0..written {
        store.verify_part(place).unwrap();
        assert_eq!(store.part(place).unwrap().as_ref(), Some(&sample.parts[place]));
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_disk_that_is_too_small_is_told_before_the_first_row() {
    let Some(disk) = SmallDisk::new("a_disk_that_is_too_small_is_told_before_the_first_row", 16) else {
        return;
    };
    let sample = sample(2000, 0, 50, 16);
    let place = disk.0.path().join("store");
    let error = StoreWriter::create(&place, sample.header.clone(), &sample.patches, false).unwrap_err();
    assert!(matches!(error, Error::NoSpace { .. }), "{error:?}");
}

#[test]
fn products_are_those_of_the_rows_whatever_the_threads() {
    for form in [Form::Plain, Form::Compact, Form::Double] {
        let directory = tempfile::tempdir().unwrap();
        // Rows of some patches only, in many parts, of which the last is short.
        let sample = sample(230, 190, 7, 21).in_form(form);
        let store = sample.write(directory.path());
        let dense = sample.dense();
        let x: Vec<f64> = (0..230).map(|k| f64::from(k * 37 % 101) - 50.0).collect();
        let y = store.multiply(&x, 1).unwrap();
        let transposed = store.multiply_transposed(&x, 1).unwrap();
        let mut wanted = vec![0.0; 230];
        for (patch, row) in dense.iter().enumerate() {
            let Some(row) = row else {
                assert!(y[patch].is_nan(), "a row that was not computed");
                continue;
            };
            let sum: f64 = row.iter().zip(&x).map(|(&factor, x)| factor * x).sum();
            assert!((y[patch] - sum).abs() < 1e-12 * 50.0, "{} {sum}", y[patch]);
            for (wanted, &factor) in wanted.iter_mut().zip(row) {
                *wanted += factor * x[patch];
            }
        }
        for (found, wanted) in transposed.iter().zip(&wanted) {
            assert!((found - wanted).abs() < 1e-12 * 50.0, "{found} {wanted}");
        }
        let bits = |numbers: &[f64]| numbers.iter().map(|n| n.to_bits()).collect::<Vec<u64>>();
        for threads in [0, 2, 3, 16] {
            assert_eq!(bits(&store.multiply(&x, threads).unwrap()), bits(&y));
            assert_eq!(
                bits(&store.multiply_transposed(&x, threads).unwrap()),
                bits(&transposed)
            );
        }
        assert!(matches!(store.multiply(&x[1..], 1), Err(Error::Refused { .. })));

        // A flipped bit among the entries is seen, once for each store that is opened.
        let path = directory.path().join("parts/part-00003.npz");
        let mut bytes = std::fs::read(&path).unwrap();
        let middle = bytes.len() / 3;
        bytes[middle] ^= 1;
        std::fs::write(&path, bytes).unwrap();
        let store = Store::open(directory.path()).unwrap();
        assert!(matches!(store.multiply(&x, 2), Err(Error::Checksum { .. })));
        assert!(matches!(store.multiply_transposed(&x, 2), Err(Error::Checksum { .. })));
    }
    let directory = tempfile::tempdir().unwrap();
    let sample = sample(40, 40, 8, 22);
    let mut writer = sample.writer(directory.path());
    writer.write_part(&sample.parts[0]).unwrap();
    writer.interrupt().unwrap();
    let store = Store::open(directory.path()).unwrap();
    assert!(matches!(store.multiply(&[0.0; 40], 1), Err(Error::Incomplete { .. })));
}

#[test]
fn shards_and_resumed_runs_write_the_bytes_of_one_run() {
    let directory = tempfile::tempdir().unwrap();
    let whole = directory.path().join("whole");
    let sample = sample(90, 90, 8, 23);
    sample.write(&whole);
    let whole = files(&whole);
    let resume = |place: &Path, shard: Option<Shard>| {
        StoreWriter::resume(place, sample.header.clone(), &sample.patches, shard, 2, &mut |_| {})
    };
    let finish = |mut writer: StoreWriter| {
        for part in writer.missing_parts() {
            writer.write_part(&sample.parts[part as usize]).unwrap();
        }
        writer.finish().unwrap()
    };

    // A run that was dropped without a word, as a killed one is, after parts in any order.
    let place = directory.path().join("resumed");
    let mut writer = sample.writer(&place);
    for part in [5, 0, 11] {
        writer.write_part(&sample.parts[part]).unwrap();
    }
    drop(writer);
    let (writer, kept) = resume(&place, None).unwrap();
    assert_eq!((kept.was_there, kept.is_complete, kept.parts), (true, false, 3));
    assert_eq!(writer.missing_parts(), [1, 2, 3, 4, 6, 7, 8, 9, 10]);
    finish(writer);
    assert!(files(&place) == whole);
    let (writer, kept) = resume(&place, None).unwrap();
    assert!(kept.is_complete && writer.missing_parts().is_empty());
    finish(writer);
    assert!(files(&place) == whole);

    // Shards that work at once in one directory.
    let shared = directory.path().join("shared");
    let shard = |number: u32| Shard::new(number - 1, 4);
    let (first, _) = resume(&shared, shard(1)).unwrap();
    let (third, _) = resume(&shared, shard(3)).unwrap();
    assert!(matches!(resume(&shared, shard(3)), Err(Error::Locked { .. })));
    assert!(matches!(resume(&shared, None), Err(Error::Locked { .. })));
    assert!(matches!(merge(&shared, &[], 2), Err(Error::Locked { .. })));
    finish(third);
    finish(first);
    finish(resume(&shared, shard(4)).unwrap().0);
    let merged = merge(&shared, &[], 2).unwrap();
    assert!(!merged.manifest.complete);
    assert_eq!(merged.missing, [1, 5, 9]);
    assert_eq!((merged.missing_shards(), merged.shard_count), (vec![2], Some(4)));
    finish(resume(&shared, shard(2)).unwrap().0);
    assert!(merge(&shared, &[], 2).unwrap().manifest.complete);
    assert!(files(&shared) == whole);
    // Once more changes nothing, and a shard finds nothing to do.
    assert!(merge(&shared, &[], 2).unwrap().missing.is_empty());
    finish(resume(&shared, shard(2)).unwrap().0);
    merge(&shared, &[], 2).unwrap();
    assert!(files(&shared) == whole);

    // Shards in directories of their own, merged into a new one.
    let own: Vec<_> = (1..=4)
        .map(|number| directory.path().join(format!("own-{number}")))
        .collect();
    for (number, place) in (1..).zip(&own) {
        finish(resume(place, shard(number)).unwrap().0);
    }
    let together = directory.path().join("together");
    let merged = merge(&together, &own[1..], 2).unwrap();
    assert_eq!((merged.missing_shards(), merged.copied), (vec![1], 9));
    let merged = merge(&together, &own, 2).unwrap();
    assert_eq!((merged.manifest.complete, merged.copied), (true, 3));
    assert!(files(&together) == whole);

    // What does not fit is refused by name.
    let mut other = sample.header.clone();
    other.settings["resolution"] = 512.into();
    let foreign = directory.path().join("foreign");
    let (writer, _) = StoreWriter::resume(&foreign, other, &sample.patches, shard(2), 1, &mut |_| {}).unwrap();
    finish(writer);
    let error = merge(&together, std::slice::from_ref(&foreign), 1).unwrap_err();
    assert!(
        matches!(&error, Error::OtherRun { path, difference } if *path == foreign && difference.contains("resolution 512")),
        "{error}"
    );
    let mut later = sample.header.clone();
    later.program = "9.9.9".into();
    let error = StoreWriter::resume(&place, later, &sample.patches, None, 1, &mut |_| {}).unwrap_err();
    assert!(error.to_string().contains("version of hemicube is "), "{error}");
    // The same part with other bits, sealed all the same: a machine that computes otherwise, or memory that fails.
    let mut odd = sample.parts[6].clone();
    odd.data.set(3, odd.data.at(3) + 1e-3);
    let wrong = directory.path().join("wrong");
    let (mut writer, _) = resume(&wrong, shard(3)).unwrap();
    writer.write_part(&odd).unwrap();
    drop(writer);
    let error = merge(&together, std::slice::from_ref(&wrong), 1).unwrap_err();
    assert!(error.to_string().contains("in two versions"), "{error}");
    // A part that is damaged in one place and whole in another is taken from there.
    let damaged = own[2].join("parts/part-00006.npz");
    std::fs::write(&damaged, b"short").unwrap();
    let merged = merge(&own[2], &own, 2).unwrap();
    assert_eq!((merged.missing, merged.not_kept.len()), (vec![6], 2));
    let mut sources = own.clone();
    sources.push(place.clone());
    assert!(merge(&own[2], &sources, 2).unwrap().manifest.complete);
    assert!(files(&own[2]) == whole);
}

#[test]
fn refined_shares_come_back_from_parts_table_and_a_run_that_goes_on() {
    let directory = tempfile::tempdir().unwrap();
    let mut sample = sample(40, 40, 16, 7);
    sample.header.correction = "tolerance".into();
    for part in &mut sample.parts {
        for (row, shares) in part.shares.iter_mut().enumerate() {
            *shares = shares.refined(part.sums[row].visible as f64 / HEMICUBE_WEIGHT as f64 * 0.9, f64::NAN);
        }
    }
    let mut writer = sample.writer(directory.path());
    writer.write_part(&sample.parts[1]).unwrap();
    drop(writer);
    let (mut writer, kept) = StoreWriter::resume(
        directory.path(),
        sample.header.clone(),
        &sample.patches,
        None,
        1,
        &mut |_| (),
    )
    .unwrap();
    assert_eq!(kept.parts, 1);
    for part in [0, 2] {
        writer.write_part(&sample.parts[part]).unwrap();
    }
    writer.finish().unwrap();
    let store = Store::open(directory.path()).unwrap();
    let table = store.row_table().unwrap();
    let mut moved = 0;
    for (place, part) in sample.parts.iter().enumerate() {
        assert_eq!(store.part(place).unwrap().as_ref(), Some(part));
        for (row, &patch) in part.rows.iter().enumerate() {
            let seen = RowShares::of_hemicubes(&part.sums[row], part.hemicubes[row]);
            assert_eq!(table.shares(patch as usize), part.shares[row]);
            assert_eq!(table.hemicube_escaped[patch as usize], seen.escaped);
            moved += u32::from(seen != part.shares[row]);
        }
    }
    assert!(moved > 20, "{moved} of 40 rows are refined");
}
