//! `check` passes what is right, and each of its checks fails on a store that is doctored to break it.

use super::sample::{self, Sample, doctor_manifest, doctor_part, sample};
use hemicube::analysis::check::{Check, CheckOptions, CheckReport, check};
use hemicube::store::{HEMICUBE_WEIGHT, Part, RowErrors, RowShares, Store};
use std::path::Path;

fn report(directory: &Path, options: &CheckOptions) -> CheckReport {
    check(&Store::open(directory).unwrap(), options).unwrap()
}

fn failed(report: &CheckReport) -> Vec<Check> {
    assert_eq!(report.ok, report.failures.is_empty());
    report.failures.iter().map(|failure| failure.check).collect()
}

fn written(seed: u64) -> (tempfile::TempDir, Sample) {
    let directory = tempfile::tempdir().unwrap();
    let sample = sample(60, 60, 16, seed);
    sample.write(directory.path());
    (directory, sample)
}

#[test]
fn a_good_store_passes_and_is_described() {
    let (directory, sample) = written(20);
    let report = report(directory.path(), &CheckOptions::default());
    assert_eq!(failed(&report), []);
    assert_eq!((report.rows, report.patch_count, report.complete), (60, 60, true));
    assert_eq!(
        report.entries,
        sample.parts.iter().map(|part| part.data.len() as u64).sum::<u64>()
    );
    let hemicubes: u64 = sample
        .parts
        .iter()
        .flat_map(|part| &part.hemicubes)
        .map(|&count| u64::from(count))
        .sum();
    assert_eq!(report.sums.total(), Some(hemicubes * HEMICUBE_WEIGHT));
    assert!(report.entries_per_row.min == 0 && report.entries_per_row.max > report.entries_per_row.median);
    assert!(report.closure.max < 1e-7 && report.closure.mean <= report.closure.max && report.closure.rows == 60);
    assert_eq!(report.worst_rows.len(), 5);
    assert_eq!(report.worst_rows[0].closure_error, report.closure.max);
    // A random matrix is not reciprocal, and pixel mode does not ask it to be.
    assert!(report.reciprocity.residual > 0.1 && report.reciprocity.pairs == report.entries);
    serde_json::to_string(&report).unwrap();
}

#[test]
fn a_sampled_store_passes_and_an_interrupted_one_only_when_allowed() {
    let directory = tempfile::tempdir().unwrap();
    sample(60, 20, 16, 21).write(&directory.path().join("sampled"));
    assert!(report(&directory.path().join("sampled"), &CheckOptions::default()).ok);
    let interrupted = directory.path().join("interrupted");
    let sample = sample(60, 60, 16, 21);
    let mut writer = sample.writer(&interrupted);
    writer.write_part(&sample.parts[1]).unwrap();
    writer.interrupt().unwrap();
    assert_eq!(
        failed(&report(&interrupted, &CheckOptions::default())),
        [Check::Complete]
    );
    let options = CheckOptions {
        allow_incomplete: true,
        ..CheckOptions::default()
    };
    let report = report(&interrupted, &options);
    assert!(report.ok && !report.complete && report.rows == 16);
}

/// What `check` says of a store in which one part was replaced by a doctored one.
fn doctored(change: impl FnOnce(&mut Part)) -> Vec<Check> {
    let (directory, sample) = written(22);
    let mut part = sample.parts[1].clone();
    change(&mut part);
    doctor_part(directory.path(), &part);
    failed(&report(directory.path(), &CheckOptions::default()))
}

/// A row of the part that has entries, and where they are.
fn busy_row(part: &Part) -> (usize, std::ops::Range<usize>) {
    let row = (0..part.rows.len()).find(|&row| part.row(row).0.len() > 4).unwrap();
    (row, part.indptr[row] as usize..part.indptr[row + 1] as usize)
}

#[test]
fn the_doctor_itself_breaks_nothing() {
    assert_eq!(doctored(|_| {}), []);
}

#[test]
fn weights_that_do_not_sum_are_found() {
    // One unit in 2³¹.
    let found = doctored(|part| part.sums[3].escaped += 1);
    assert!(found.contains(&Check::Weights), "{found:?}");
    let found = doctored(|part| part.shares[3].escaped *= 0.5);
    assert!(
        found.contains(&Check::Weights),
        "shares that are not the weights' of sums of pixels: {found:?}"
    );
    let found = doctored(|part| part.hemicubes[3] += 1);
    assert!(found.contains(&Check::Weights), "{found:?}");
    let found = doctored(|part| (part.hemicubes[3], part.shares[3]) = (0, RowShares::UNKNOWN));
    assert!(found.contains(&Check::Weights), "{found:?}");
}

#[test]
fn form_factors_that_are_not_the_visible_weight_are_found() {
    // A change of 1e-5 of a factor of a few hundredths is within the closure bound, and not within f32's rounding.
    let found = doctored(|part| {
        let (_, range) = busy_row(part);
        let largest = range
            .max_by(|&a, &b| part.data.at(a).total_cmp(&part.data.at(b)))
            .unwrap();
        part.data.set(largest, part.data.at(largest) * (1.0 + 5e-6));
    });
    assert!(
        found.contains(&Check::Visible) && !found.contains(&Check::Closure),
        "{found:?}"
    );
    // Weight moved from visible to escaped leaves the sums exact.
    let found = doctored(|part| {
        let (row, _) = busy_row(part);
        part.sums[row].visible -= 1000;
        part.sums[row].escaped += 1000;
        part.shares[row] = RowShares::of_hemicubes(&part.sums[row], part.hemicubes[row]);
    });
    assert!(
        found.contains(&Check::Visible) && !found.contains(&Check::Weights),
        "{found:?}"
    );
}

#[test]
fn form_factors_out_of_range_are_found() {
    for value in [-1e-6, 1.000_001, f32::NAN, f32::INFINITY] {
        let found = doctored(|part| part.data.set(2, f64::from(value)));
        assert!(found.contains(&Check::Range), "{value}: {found:?}");
    }
}

#[test]
fn columns_out_of_order_or_out_of_range_are_found() {
    let found = doctored(|part| {
        let (_, range) = busy_row(part);
        part.indices.swap(range.start, range.start + 1);
    });
    assert!(found.contains(&Check::Columns), "{found:?}");
    let changes: [fn(&mut [i32]); 3] = [
        |columns| columns[0] = -1,
        |columns| columns[columns.len() - 1] = 60,
        |columns| columns[1] = columns[0],
    ];
    for change in changes {
        let found = doctored(|part| {
            let (_, range) = busy_row(part);
            change(&mut part.indices[range]);
        });
        assert!(found.contains(&Check::Columns), "{found:?}");
    }
}

#[test]
fn a_patch_that_sees_itself_is_found() {
    let found = doctored(|part| {
        let (row, range) = busy_row(part);
        let own = part.rows[row] as i32;
        // The nearest column becomes the diagonal, and the order stays.
        let place = range
            .clone()
            .find(|&place| part.indices[place] > own)
            .unwrap_or(range.end - 1);
        part.indices[place] = own;
        part.data.set(place, part.data.at(place).max(1e-6));
    });
    assert!(found.contains(&Check::Diagonal), "{found:?}");
}

#[test]
fn rows_that_do_not_close_are_found_within_the_stated_bound() {
    let lose = |part: &mut Part| {
        let (_, range) = busy_row(part);
        let largest = range
            .max_by(|&a, &b| part.data.at(a).total_cmp(&part.data.at(b)))
            .unwrap();
        part.data.set(largest, part.data.at(largest) - 1e-3);
    };
    let (directory, sample) = written(22);
    let mut part = sample.parts[1].clone();
    lose(&mut part);
    doctor_part(directory.path(), &part);
    let strict = report(directory.path(), &CheckOptions::default());
    assert!(failed(&strict).contains(&Check::Closure));
    assert!((strict.closure.max - 1e-3).abs() < 1e-6);
    assert_eq!(strict.worst_rows[0].patch, part.rows[busy_row(&part).0]);
    let options = CheckOptions {
        closure: Some(1e-2),
        ..CheckOptions::default()
    };
    assert!(!failed(&report(directory.path(), &options)).contains(&Check::Closure));
}

#[test]
fn damaged_files_are_found() {
    for file in ["parts/part-00002.npz", "patches.npz"] {
        let (directory, _) = written(23);
        let path = directory.path().join(file);
        let mut bytes = std::fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 4;
        std::fs::write(&path, &bytes).unwrap();
        let flipped = report(directory.path(), &CheckOptions::default());
        assert!(
            failed(&flipped).contains(&Check::Files),
            "{file}: {:?}",
            flipped.failures
        );
        assert!(
            flipped.failures.iter().any(|failure| failure.first.contains(file)),
            "{:?}",
            flipped.failures
        );
        bytes.truncate(bytes.len() - 1);
        std::fs::write(&path, &bytes).unwrap();
        assert!(failed(&report(directory.path(), &CheckOptions::default())).contains(&Check::Files));
    }
    let (directory, _) = written(23);
    std::fs::remove_file(directory.path().join("parts/part-00002.npz")).unwrap();
    let report = report(directory.path(), &CheckOptions::default());
    assert!(failed(&report).contains(&Check::Files));
}

#[test]
fn a_manifest_with_other_totals_is_found() {
    let (directory, _) = written(24);
    doctor_manifest(directory.path(), |manifest| {
        let visible = manifest["parts"][1]["sums"]["visible"].as_u64().unwrap();
        manifest["parts"][1]["sums"]["visible"] = (visible + 1).into();
    });
    assert_eq!(
        failed(&report(directory.path(), &CheckOptions::default())),
        [Check::Manifest]
    );
}

#[test]
fn a_patch_table_that_says_otherwise_is_found() {
    for column in [
        "escaped",
        "blocked",
        "unselected",
        "row_sum",
        "hemicube_escaped",
        "hemicube_blocked",
    ] {
        let (directory, _) = written(25);
        let path = directory.path().join("patches.npz");
        let mut values: Vec<f64> = sample::array(&path, column);
        values[7] += 1e-9;
        sample::replace_members(
            &path,
            &[(column, sample::npy(&[60], &values))],
            zip::CompressionMethod::Stored,
        );
        let checksum = blake3::hash(&std::fs::read(&path).unwrap()).to_hex().to_string();
        doctor_manifest(directory.path(), |manifest| {
            manifest["patches"]["blake3"] = checksum.into()
        });
        let report = report(directory.path(), &CheckOptions::default());
        assert_eq!(failed(&report), [Check::Table], "{column}");
        assert!(report.failures[0].count == 1 && report.failures[0].first.contains("patch 7"));
    }
}

/// A matrix of two patches of areas 1 and 2 that see each other with `forward` and `backward`.
fn pair(directory: &Path, forward: f32, backward: f32) {
    let mut sample = sample(2, 2, 2, 26);
    let part = &mut sample.parts[0];
    part.rows = vec![0, 1];
    part.indptr = vec![0, 1, 2];
    part.indices = vec![1, 0];
    part.data = vec![forward, backward].into();
    part.hemicubes = vec![1, 1];
    part.errors = vec![RowErrors::from_array([0.0; 3]); 2];
    part.rays = vec![0; 2];
    for (sums, factor) in part.sums.iter_mut().zip([forward, backward]) {
        let visible = (f64::from(factor) * HEMICUBE_WEIGHT as f64) as u64;
        *sums = hemicube::store::RowSums {
            visible,
            escaped: HEMICUBE_WEIGHT - visible,
            ..Default::default()
        };
    }
    part.shares = part.sums.iter().map(|sums| RowShares::of_hemicubes(sums, 1)).collect();
    sample.write(directory);
}

#[test]
fn reciprocity_is_measured_and_bounded_when_asked() {
    let directory = tempfile::tempdir().unwrap();
    let (even, odd) = (directory.path().join("even"), directory.path().join("odd"));
    pair(&even, 0.5, 0.25);
    pair(&odd, 0.5, 0.125);
    let options = CheckOptions {
        reciprocity: Some(0.1),
        ..CheckOptions::default()
    };
    let found = report(&even, &options);
    assert!(found.ok && found.reciprocity.residual == 0.0 && found.reciprocity.pairs == 2);
    let found = report(&odd, &options);
    assert_eq!(failed(&found), [Check::Reciprocity]);
    // 0.25 apart twice, over 0.5 and 0.25.
    let wanted = (2.0 * 0.25f64.powi(2) / (0.5f64.powi(2) + 0.25f64.powi(2))).sqrt();
    assert!((found.reciprocity.residual - wanted).abs() < 1e-12);
    assert!(report(&odd, &CheckOptions::default()).ok);
}

#[test]
fn reciprocity_of_a_large_matrix_is_measured_on_some_of_its_rows() {
    let (directory, _) = written(27);
    let held = report(directory.path(), &CheckOptions::default()).reciprocity;
    let options = CheckOptions {
        entries_in_memory: 0,
        ..CheckOptions::default()
    };
    let looked_up = report(directory.path(), &options).reciprocity;
    assert_eq!(
        (looked_up.residual, looked_up.pairs, looked_up.rows),
        (held.residual, held.pairs, held.rows)
    );
    let options = CheckOptions {
        reciprocity_pairs: 200,
        ..options
    };
    let sampled = report(directory.path(), &options).reciprocity;
    assert!(
        sampled.rows < 20 && sampled.rows > 3 && sampled.pairs < 300,
        "{sampled:?}"
    );
    assert!(
        (sampled.residual / held.residual).ln().abs() < 0.5,
        "{sampled:?} {held:?}"
    );
}

#[test]
fn a_patch_sees_itself_only_where_its_elements_lie_in_no_plane() {
    let of = |kind: Option<&str>, normal: [f64; 3], own: f32| {
        let directory = tempfile::tempdir().unwrap();
        let mut sample = sample(3, 3, 16, 30);
        if let Some(kind) = kind {
            sample.header.settings["patches"] = kind.into();
        }
        sample.patches.normal = vec![normal; 3];
        let quarter = HEMICUBE_WEIGHT / 4;
        // More hemicubes than a triangle has, a quarter of each on the next patch and on the patch itself.
        let hemicubes = if kind.is_some() { 1 << 20 } else { 1 };
        let sums = hemicube::store::RowSums {
            visible: 2 * quarter * hemicubes,
            escaped: 2 * quarter * hemicubes,
            ..Default::default()
        };
        let count = u32::try_from(hemicubes).unwrap();
        sample.parts = vec![Part {
            indptr: vec![0, 2, 4, 6],
            rows: vec![2, 0, 1],
            indices: vec![1, 2, 0, 1, 1, 2],
            data: [[0.5 - own, own], [own, 0.5 - own], [own, 0.5 - own]].concat().into(),
            sums: vec![sums; 3],
            shares: vec![RowShares::of_hemicubes(&sums, count); 3],
            hemicubes: vec![count; 3],
            errors: vec![RowErrors::UNKNOWN; 3],
            rays: vec![0; 3],
            ..Part::default()
        }];
        sample.write(directory.path());
        failed(&report(directory.path(), &CheckOptions::default()))
    };
    let flat = [0.0, 0.0, 1.0];
    assert_eq!(of(None, flat, 0.25), [Check::Diagonal]);
    assert_eq!(of(Some("object"), flat, 0.25), [Check::Diagonal]);
    assert_eq!(of(Some("object"), flat, 1e-4), []);
    assert_eq!(of(Some("object"), [0.0; 3], 0.25), []);
}
