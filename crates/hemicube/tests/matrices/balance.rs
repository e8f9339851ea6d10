//! Balancing a store: rows close and pairs agree, small entries go and their mass stays, what cannot be balanced is
//! refused or counted, and equal input gives equal bytes.
#![allow(clippy::cast_possible_truncation, reason = "test matrices are small")]
#![allow(clippy::cast_sign_loss, reason = "weights are not negative")]
#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use crate::store::sample::{self, Random, Sample, doctor_manifest, doctor_part, files, sample};
use hemicube::analysis::balance::{BalanceEntry, BalanceOptions, BalanceReport, balance};
use hemicube::analysis::check::{Check, CheckOptions, check};
use hemicube::store::{Error, HEMICUBE_WEIGHT, Part, RowErrors, RowShares, RowSums, Store, StoreWriter};
use std::path::Path;
use tempfile::TempDir;

/// What a random matrix is made with.
#[derive(Clone, Copy)]
struct Recipe {
    patches: u32,
    rows_per_part: u32,
    /// Relative error of form factors.
    noise: f64,
    /// Entries of which every so manieth is missing from one of its rows; 0: none.
    one_sided: u64,
    /// The largest area over the smallest.
    area_ratio: f64,
}

const RECIPE: Recipe = Recipe {
    patches: 60,
    rows_per_part: 16,
    noise: 0.1,
    one_sided: 9,
    area_ratio: 30.0,
};

fn unit(random: &mut Random) -> f64 {
    random.below(1 << 32) as f64 / (1u64 << 32) as f64
}

/// A matrix that is reciprocal and closed but for noise; some rows lose a part of their view.
fn noisy(recipe: Recipe, seed: u64) -> Sample {
    let mut random = Random(seed);
    let n = recipe.patches as usize;
    let mut base = sample(recipe.patches, recipe.patches, recipe.rows_per_part, seed);
    base.patches.area = (0..n).map(|_| recipe.area_ratio.powf(unit(&mut random))).collect();
    let areas = base.patches.area.clone();
    let mut exchange = vec![vec![0.0; n]; n];
    for i in 0..n {
        for j in i + 1..n {
            // Neighbours always see each other, so that no patch sees too few.
            if j - i < 3 || random.below(4) == 0 {
                let value = areas[i].min(areas[j]) * (0.05 + unit(&mut random)) * 0.1;
                (exchange[i][j], exchange[j][i]) = (value, value);
            }
        }
    }
    let sum = |i: usize| exchange[i].iter().sum::<f64>() / areas[i];
    let largest = (0..n).map(sum).fold(0.0, f64::max);
    let order: Vec<u32> = base.parts.iter().flat_map(|part| part.rows.clone()).collect();
    base.parts = order
        .chunks(recipe.rows_per_part as usize)
        .zip(0..)
        .map(|(rows, index)| {
            let mut part = Part {
                index,
                indptr: vec![0],
                ..Part::default()
            };
            for &patch in rows {
                let i = patch as usize;
                for j in 0..n {
                    let factor = exchange[i][j] / areas[i] / largest;
                    let is_missing = recipe.one_sided > 0 && random.below(recipe.one_sided) == 0;
                    let noise = 1.0 + recipe.noise * (2.0 * unit(&mut random) - 1.0);
                    if factor > 0.0 && !(is_missing && j.abs_diff(i) > 3) {
                        part.indices.push(j as i32);
                        part.data.push(factor * noise);
                    }
                }
                let visible = (sum(i) / largest * HEMICUBE_WEIGHT as f64) as u64;
                let lost = HEMICUBE_WEIGHT - visible.min(HEMICUBE_WEIGHT);
                push_sums(&mut part, patch, lost / 3, lost - lost / 3);
            }
            part
        })
        .collect();
    base.header.correction = "tolerance".into();
    base
}

/// Ends a row that lost so much.
fn push_sums(part: &mut Part, patch: u32, escaped: u64, blocked: u64) {
    part.rows.push(patch);
    part.indptr.push(part.data.len() as i64);
    part.hemicubes.push(1);
    part.errors.push(RowErrors::from_array([0.0; 3]));
    part.rays.push(0);
    part.sums.push(RowSums {
        visible: HEMICUBE_WEIGHT - escaped - blocked,
        escaped,
        blocked,
        unselected: 0,
    });
    part.shares
        .push(RowShares::of_hemicubes(&part.sums[part.sums.len() - 1], 1));
}

fn closure() -> BalanceOptions {
    BalanceOptions {
        closure: true,
        max_scale: 4.0,
        ..BalanceOptions::default()
    }
}

fn reciprocity() -> BalanceOptions {
    BalanceOptions {
        reciprocity: true,
        max_scale: 4.0,
        ..BalanceOptions::default()
    }
}

fn cut(min_factor: f64) -> BalanceOptions {
    BalanceOptions {
        min_factor,
        max_scale: 4.0,
        ..BalanceOptions::default()
    }
}

/// A store and what became of it.
struct Balanced {
    _place: TempDir,
    source: Store,
    result: Store,
    report: BalanceReport,
}

fn run(sample: &Sample, options: &BalanceOptions) -> Balanced {
    let place = tempfile::tempdir().unwrap();
    let source = sample.write(&place.path().join("source"));
    let output = place.path().join("result");
    let report = balance(&source, &output, options).unwrap();
    let result = Store::open(&output).unwrap();
    let names: Vec<String> = files(&output).into_keys().collect();
    assert!(!names.iter().any(|name| name.contains("tmp")), "{names:?}");
    Balanced {
        _place: place,
        source,
        result,
        report,
    }
}

/// What does not come about as wanted, as an error.
fn refusal(sample: &Sample, options: &BalanceOptions, doctor: impl FnOnce(&Path)) -> Error {
    let place = tempfile::tempdir().unwrap();
    let directory = place.path().join("source");
    sample.write(&directory);
    doctor(&directory);
    let output = place.path().join("result");
    let error = Store::open(&directory)
        .and_then(|store| balance(&store, &output, options))
        .unwrap_err();
    assert!(
        Store::open(&output).is_err() || !Store::open(&output).unwrap().manifest().complete,
        "a result that looks whole is left behind"
    );
    error
}

/// The matrix as rows of f64.
fn dense(store: &Store) -> Vec<Vec<f64>> {
    let n = store.patch_count() as usize;
    let mut rows = vec![vec![0.0; n]; n];
    for row in store.rows().unwrap() {
        let (patch, row) = row.unwrap();
        for (&column, factor) in row.indices.iter().zip(&row.data) {
            rows[patch.0 as usize][column as usize] = factor;
        }
    }
    rows
}

fn bounds(closure: f64, reciprocity: f64) -> CheckOptions {
    CheckOptions {
        closure: Some(closure),
        reciprocity: Some(reciprocity),
        ..CheckOptions::default()
    }
}

fn failed(store: &Store, options: &CheckOptions) -> Vec<Check> {
    let report = check(store, options).unwrap();
    report.failures.iter().map(|failure| failure.check).collect()
}

#[test]
fn rows_close_and_pairs_agree() {
    for seed in 0..40 {
        let recipe = Recipe {
            patches: 20 + seed as u32 * 3,
            rows_per_part: [7, 16, 64][seed as usize % 3],
            noise: 0.02 * (seed % 10) as f64 + 0.01,
            one_sided: [0, 0, 20][seed as usize % 3],
            area_ratio: [1.0, 30.0, 1e6][seed as usize / 2 % 3],
        };
        let ran = run(&noisy(recipe, seed), &closure());
        let found = &ran.report.balance;
        assert!(found.converged, "{seed}: {found:?}");
        assert_eq!(
            (found.rows_at_bound, found.rows_empty, found.rows_without_target),
            (0, 0, 0),
            "{seed}"
        );
        assert!(found.after.closure_max < 2e-6, "{seed}: {found:?}");
        assert!(found.before.closure_max > 1e-4, "{seed}: nothing to repair: {found:?}");
        // The same two bounds that the result keeps do not hold for what it was made from.
        let bounds = bounds(2e-6, 2e-7);
        assert_eq!(
            failed(&ran.source, &bounds),
            [Check::Closure, Check::Reciprocity],
            "{seed}"
        );
        assert_eq!(failed(&ran.result, &bounds), [], "{seed}");
        // What the report says of both is what anyone finds who reads the files.
        let areas = ran.result.patches().unwrap().area;
        for (store, said) in [(&ran.source, found.before), (&ran.result, found.after)] {
            let (mut difference, mut total, mut worst) = (0.0, 0.0, 0.0f64);
            let rows = dense(store);
            for i in 0..rows.len() {
                for j in 0..rows.len() {
                    let off = areas[i] * rows[i][j] - areas[j] * rows[j][i];
                    difference += off * off;
                    total += (areas[i] * rows[i][j]).powi(2);
                    worst = worst.max(off.abs() / areas[i].min(areas[j]));
                }
            }
            let residual = f64::sqrt(difference / total);
            assert!(
                (residual - said.reciprocity).abs() <= 1e-6 * residual + 1e-15,
                "{seed}: {residual} {said:?}"
            );
            assert!(
                (worst - said.reciprocity_worst).abs() <= 1e-6 * worst + 1e-15,
                "{seed}: {worst} {said:?}"
            );
        }
    }
}

#[test]
fn the_noise_that_was_put_in_is_mostly_taken_out() {
    let clean = Recipe {
        noise: 0.0,
        one_sided: 0,
        ..RECIPE
    };
    let noisy_one = Recipe { one_sided: 0, ..RECIPE };
    // The same random numbers with and without noise: the same matrix.
    let place = tempfile::tempdir().unwrap();
    let truth = dense(&noisy(clean, 5).write(place.path()));
    let ran = run(&noisy(noisy_one, 5), &closure());
    let error = |rows: &[Vec<f64>]| -> f64 {
        let squared = |of: &dyn Fn(usize, usize) -> f64| -> f64 {
            (0..truth.len())
                .flat_map(|i| (0..truth.len()).map(move |j| (i, j)))
                .map(|(i, j)| of(i, j).powi(2))
                .sum()
        };
        (squared(&|i, j| rows[i][j] - truth[i][j]) / squared(&|i, j| truth[i][j])).sqrt()
    };
    let (before, after) = (error(&dense(&ran.source)), error(&dense(&ran.result)));
    assert!(before > 0.03 && after < 0.9 * before, "{before} → {after}");
}

#[test]
fn a_pair_becomes_the_mean_weighted_by_the_other_patch() {
    let ran = run(&noisy(RECIPE, 3), &reciprocity());
    let areas = ran.source.patches().unwrap().area;
    let (before, after) = (dense(&ran.source), dense(&ran.result));
    let mut one_sided = 0;
    for i in 0..areas.len() {
        for j in 0..areas.len() {
            let wanted = areas[j] * (before[i][j] + before[j][i]) / (areas[i] + areas[j]);
            let wanted = wanted.min(areas[j].min(areas[i]) / areas[i]);
            assert!((after[i][j] - wanted).abs() <= 3e-7 * wanted, "{i} {j}");
            one_sided += u64::from(i < j && (before[i][j] > 0.0) != (before[j][i] > 0.0));
        }
    }
    let found = &ran.report.balance;
    assert_eq!(found.pairs_one_sided, one_sided);
    assert!(one_sided > 5);
    assert_eq!(
        (found.sweeps, found.converged, found.scale_min, found.scale_max),
        (0, true, 1.0, 1.0)
    );
    assert_eq!(found.entries_after, 2 * found.pairs);
}

#[test]
fn rows_that_are_cut_keep_their_sums() {
    let ran = run(&noisy(RECIPE, 7), &cut(0.01));
    let (before, after) = (dense(&ran.source), dense(&ran.result));
    let (mut dropped, mut entries) = (0, 0);
    for (before, after) in before.iter().zip(&after) {
        let (old, new): (f64, f64) = (before.iter().sum(), after.iter().sum());
        assert!((old - new).abs() < 1e-6 * old, "{old} {new}");
        let kept: f64 = before.iter().filter(|&&factor| factor >= f64::from(0.01f32)).sum();
        let is_whole = 16.0 * kept < old;
        for (&b, &a) in before.iter().zip(after) {
            entries += u64::from(a > 0.0);
            if b >= 0.01 || is_whole {
                assert!((a - if is_whole { b } else { b * old / kept }).abs() < 1e-6 * b.max(a));
            } else {
                dropped += u64::from(b > 0.0);
                assert_eq!(a, 0.0);
            }
        }
    }
    let found = &ran.report.balance;
    assert!(dropped > 100, "{dropped}");
    assert_eq!((found.entries_dropped, found.entries_after), (dropped, entries));
    assert_eq!(found.entries_before, found.entries_after + found.entries_dropped);
    assert!(found.mass_dropped > 0.0 && found.mass_dropped < 0.5);
    assert!(ran.report.bytes_after < ran.report.bytes_before);
    // Rows on their own lose reciprocity, and the report says so.
    assert!(found.after.reciprocity > 1e-3);
    assert!(!found.reciprocity);
}

#[test]
fn rows_of_a_sample_can_be_cut_and_not_closed() {
    let sampled = sample(97, 40, 16, 4);
    let ran = run(&sampled, &cut(1e-3));
    assert_eq!(ran.result.manifest().rows_present(), 40);
    assert!(ran.report.balance.entries_dropped > 0);
    let error = refusal(&sampled, &closure(), |_| {}).to_string();
    assert!(
        error.contains("40 of 97") && error.contains("compute it with all rows"),
        "{error}"
    );
    // A whole matrix of selected receivers.
    let error = refusal(&sample(60, 60, 16, 4), &reciprocity(), |_| {}).to_string();
    assert!(error.contains("selected receivers"), "{error}");
}

#[test]
fn pairs_go_together_and_rows_keep_what_they_came_to() {
    let sample = noisy(RECIPE, 11);
    let least = 0.01;
    let plain = run(&sample, &reciprocity());
    let both = BalanceOptions {
        min_factor: least,
        ..reciprocity()
    };
    let ran = run(&sample, &both);
    let found = &ran.report.balance;
    assert!(found.converged && found.rows_at_bound == 0, "{found:?}");
    assert!(found.entries_dropped > 50, "{found:?}");
    assert!(found.after.reciprocity < 2e-7, "{found:?}");
    let (whole, after) = (dense(&plain.result), dense(&ran.result));
    for i in 0..whole.len() {
        let (old, new): (f64, f64) = (whole[i].iter().sum(), after[i].iter().sum());
        assert!((old - new).abs() < 2e-6 * old, "{i}: {old} {new}");
        for j in 0..whole.len() {
            assert_eq!(after[i][j] > 0.0, after[j][i] > 0.0, "{i} {j}");
            if whole[i][j].max(whole[j][i]) > least * 1.000001 {
                assert!(after[i][j] > 0.0, "{i} {j}: the pair has a large side");
            }
        }
    }
    // With closure too, the sums are those of the weights.
    let all = run(
        &sample,
        &BalanceOptions {
            min_factor: least,
            ..closure()
        },
    );
    assert!(all.report.balance.after.closure_max < 2e-6, "{:?}", all.report.balance);
    assert_eq!(failed(&all.result, &bounds(2e-6, 2e-7)), []);
}

#[test]
fn the_manifest_says_what_was_done_and_to_what() {
    let ran = run(&noisy(RECIPE, 1), &closure());
    let (source, result) = (ran.source.manifest(), ran.result.manifest());
    assert_eq!(source.balance, None);
    let text = std::fs::read_to_string(ran.source.directory().join("manifest.json")).unwrap();
    assert!(
        !text.contains("balance"),
        "a matrix as it was computed says nothing of balancing"
    );
    let record = result.balance.as_ref().unwrap();
    // Figures come back from JSON to the last bit but one.
    let counts = |entry: &BalanceEntry| {
        (
            entry.closure,
            entry.source.clone(),
            entry.sweeps,
            entry.pairs,
            entry.entries_after,
        )
    };
    assert_eq!(counts(record), counts(&ran.report.balance));
    assert!((record.after.closure_max - ran.report.balance.after.closure_max).abs() < 1e-15);
    assert_eq!(result.correction, "tolerance, balanced");
    assert_ne!(result.settings_hash, source.settings_hash);
    assert_eq!(record.source.settings_hash, source.settings_hash);
    assert_eq!(result.scene, source.scene);
    assert_eq!(result.part_count, source.part_count);
    for place in 0..source.parts.len() {
        let (one, other) = (
            ran.source.part(place).unwrap().unwrap(),
            ran.result.part(place).unwrap().unwrap(),
        );
        assert_eq!(one.rows, other.rows);
    }
    assert_eq!(ran.result.patches().unwrap(), ran.source.patches().unwrap());
    // Balanced once more it is the same matrix, and says what it came from.
    let again = ran.result.directory().with_file_name("again");
    let report = balance(&ran.result, &again, &closure()).unwrap();
    assert_eq!(report.balance.source.settings_hash, result.settings_hash);
    assert_eq!(
        Store::open(&again).unwrap().manifest().correction,
        "tolerance, balanced"
    );
    let (one, other) = (dense(&ran.result), dense(&Store::open(&again).unwrap()));
    for (a, b) in one.iter().flatten().zip(other.iter().flatten()) {
        assert!((a - b).abs() <= 2e-6 * a, "{a} {b}");
    }
}

#[test]
fn equal_input_gives_equal_bytes() {
    for options in [
        closure(),
        reciprocity(),
        cut(0.01),
        BalanceOptions {
            min_factor: 0.01,
            ..closure()
        },
    ] {
        let sample = noisy(RECIPE, 2);
        let (one, other) = (run(&sample, &options), run(&sample, &options));
        assert_eq!(files(one.result.directory()), files(other.result.directory()));
    }
}

#[test]
fn what_cannot_be_balanced_is_refused_with_a_reason() {
    let good = noisy(RECIPE, 1);
    let says = |error: Error, words: &[&str]| {
        let text = error.to_string();
        for word in words {
            assert!(text.contains(word), "`{word}` is not in: {text}");
        }
    };
    says(
        refusal(&good, &BalanceOptions::default(), |_| {}),
        &["nothing is to be done"],
    );
    says(refusal(&good, &cut(1.0), |_| {}), &["least factor 1"]);
    says(refusal(&good, &cut(f64::NAN), |_| {}), &["least factor NaN"]);
    says(refusal(&good, &cut(-1e-3), |_| {}), &["least factor"]);
    let with = |tolerance, max_sweeps| BalanceOptions {
        tolerance,
        max_sweeps,
        ..closure()
    };
    says(refusal(&good, &with(1e-9, 10), |_| {}), &["tolerance", "seven digits"]);
    says(refusal(&good, &with(f64::NAN, 10), |_| {}), &["tolerance NaN"]);
    says(refusal(&good, &with(1e-6, 0), |_| {}), &["no sweep"]);
    for max_scale in [1.0, 17.0, f64::NAN] {
        let options = BalanceOptions { max_scale, ..closure() };
        says(refusal(&good, &options, |_| {}), &["largest scale"]);
    }
    for options in [closure(), cut(0.01)] {
        says(
            refusal(&good, &options, |directory| {
                std::fs::remove_file(directory.join("parts/part-00002.npz")).unwrap();
            }),
            &["part-00002.npz"],
        );
        says(
            refusal(&good, &options, |directory| {
                doctor_manifest(directory, |manifest| {
                    let entries = manifest["parts"][3]["entries"].as_u64().unwrap();
                    manifest["parts"].as_array_mut().unwrap().pop();
                    manifest["entries"] = (manifest["entries"].as_u64().unwrap() - entries).into();
                    manifest["complete"] = false.into();
                });
            }),
            &["is incomplete", "3 of 4", "compute it to the end"],
        );
        let flip = |file: &str, from_end: usize| {
            refusal(&good, &options, |directory| {
                let path = directory.join(file);
                let mut bytes = std::fs::read(&path).unwrap();
                let place = bytes.len() - from_end;
                bytes[place] ^= 1;
                std::fs::write(&path, bytes).unwrap();
            })
        };
        assert!(matches!(flip("parts/part-00001.npz", 1000), Error::Checksum { .. }));
        assert!(matches!(flip("patches.npz", 2000), Error::Checksum { .. }));
        for value in [f32::NAN, f32::INFINITY, -0.1] {
            let bad = |directory: &Path| {
                let mut part = good.parts[1].clone();
                part.data.set(5, f64::from(value));
                doctor_part(directory, &part);
            };
            says(refusal(&good, &options, bad), &["part-00001.npz", "the form factor"]);
        }
        let diagonal = |directory: &Path| {
            let mut part = good.parts[0].clone();
            let own = part.rows[0].cast_signed();
            let row = &mut part.indices[..part.indptr[1] as usize];
            // The entry before its own column, or the first, becomes it: columns ascend all the same.
            let place = row.partition_point(|&column| column < own).saturating_sub(1);
            row[place] = own;
            doctor_part(directory, &part);
        };
        says(
            refusal(&good, &options, diagonal),
            &["part-00000.npz", "where none can be"],
        );
    }
    for (area, words) in [(0.0, "patch 7 without area"), (f64::NAN, "patch 7 with the area NaN")] {
        let flat = |directory: &Path| {
            let path = directory.join("patches.npz");
            let mut areas: Vec<f64> = sample::array(&path, "area");
            areas[7] = area;
            let member = ("area", sample::npy(&[areas.len() as u64], &areas));
            sample::replace_members(&path, &[member], zip::CompressionMethod::Stored);
            let checksum = blake3::hash(&std::fs::read(&path).unwrap()).to_hex().to_string();
            doctor_manifest(directory, |manifest| manifest["patches"]["blake3"] = checksum.into());
        };
        says(refusal(&good, &closure(), flat), &[words]);
        says(refusal(&good, &cut(0.01), flat), &[words]);
    }
    // No such store is written in the first place.
    let mut flat = noisy(RECIPE, 1);
    flat.patches.area[7] = 0.0;
    let place = tempfile::tempdir().unwrap();
    let refused = StoreWriter::create(&place.path().join("F"), flat.header.clone(), &flat.patches, false);
    says(refused.unwrap_err(), &["patch 7 without area"]);
}

#[test]
fn a_result_replaces_only_what_it_is_told_to() {
    let place = tempfile::tempdir().unwrap();
    let sample = noisy(RECIPE, 1);
    let source = sample.write(&place.path().join("source"));
    let overwrite = BalanceOptions {
        overwrite: true,
        ..closure()
    };
    for options in [closure(), overwrite.clone()] {
        let error = balance(&source, source.directory(), &options).unwrap_err();
        assert!(matches!(error, Error::InTheWay { .. }), "{error}");
    }
    let output = place.path().join("result");
    balance(&source, &output, &closure()).unwrap();
    let before = files(&output);
    let error = balance(&source, &output, &closure()).unwrap_err();
    assert!(matches!(error, Error::Exists { .. }), "{error}");
    assert_eq!(files(&output), before);
    balance(&source, &output, &overwrite).unwrap();
    assert_eq!(files(&output), before);
}

/// A matrix of the rows given: patch, columns and form factors, escaped share. All areas are 1.
fn by_hand(rows: &[(&[(i32, f32)], f64)]) -> Sample {
    let n = rows.len() as u32;
    let mut made = sample(n, n, n, 1);
    made.patches.area = vec![1.0; rows.len()];
    let mut part = Part {
        indptr: vec![0],
        ..Part::default()
    };
    for (patch, (entries, escaped)) in (0..).zip(rows) {
        for &(column, factor) in *entries {
            part.indices.push(column);
            part.data.push(f64::from(factor));
        }
        push_sums(&mut part, patch, (escaped * HEMICUBE_WEIGHT as f64) as u64, 0);
    }
    made.parts = vec![part];
    made.header.correction = "tolerance".into();
    made
}

#[test]
fn rows_that_no_scaling_closes_are_counted_and_do_no_harm() {
    // 0 and 1 see only each other, and disagree on how much; 2 sees 3 and 4, who see it; 5 is to sum to something and
    // has nothing; 6 is to sum to nothing, and 2 sees it.
    let made = by_hand(&[
        (&[(1, 0.9)], 0.0),
        (&[(0, 0.5)], 0.5),
        (&[(3, 0.3), (4, 0.3), (6, 0.1)], 0.2),
        (&[(2, 0.35), (4, 0.3)], 0.25),
        (&[(2, 0.3), (3, 0.3)], 0.35),
        (&[], 0.5),
        (&[], 1.0),
    ]);
    let ran = run(&made, &closure());
    let found = &ran.report.balance;
    assert!(found.converged, "{found:?}");
    assert_eq!(
        (found.rows_at_bound, found.rows_empty, found.rows_without_target),
        (2, 1, 1),
        "{found:?}"
    );
    let rows = dense(&ran.result);
    assert!(
        rows.iter().flatten().all(|factor| (0.0..=1.0).contains(factor)),
        "{rows:?}"
    );
    assert!(
        found.closure_max_of_others < 2e-6 && found.after.closure_max > 0.1,
        "{found:?}"
    );
    for (row, target) in [(2, 0.8), (3, 0.75), (4, 0.65)] {
        let sum: f64 = rows[row].iter().sum();
        assert!((sum - target).abs() < 2e-6, "{row}: {sum}");
    }
    // Too few sweeps are said to be too few.
    let hasty = BalanceOptions {
        max_sweeps: 2,
        ..closure()
    };
    let found = run(&made, &hasty).report.balance;
    assert!(!found.converged && found.sweeps == 2, "{found:?}");
}

#[test]
fn a_matrix_of_nothing_stays_one() {
    let nothing = by_hand(&[(&[], 1.0), (&[], 1.0)]);
    for options in [closure(), reciprocity(), cut(0.1)] {
        let found = run(&nothing, &options).report.balance;
        assert!(found.converged, "{found:?}");
        assert_eq!(found.before, found.after);
        assert_eq!((found.after.closure_max, found.after.reciprocity), (0.0, 0.0));
    }
}

#[test]
fn a_disk_that_is_full_leaves_nothing_that_looks_whole() {
    #[cfg(target_os = "linux")]
    {
        let disk = tempfile::tempdir().unwrap();
        let mounted = std::process::Command::new("mount")
            .args(["-t", "tmpfs", "-o", "size=192k", "tmpfs"])
            .arg(disk.path())
            .output();
        if !mounted.is_ok_and(|output| output.status.success()) {
            eprintln!("SKIP a_disk_that_is_full_leaves_nothing_that_looks_whole: needs root and `mount`");
            return;
        }
        let place = tempfile::tempdir().unwrap();
        let recipe = Recipe { patches: 220, ..RECIPE };
        let source = noisy(recipe, 1).write(&place.path().join("source"));
        let output = disk.path().join("result");
        let too_small = balance(&source, &output, &closure());
        let is_there = output.exists();
        // Room for what is certain, but not for all.
        let filled = balance(&source, &output, &cut(1e-9));
        let complete = Store::open(&output).map(|store| store.manifest().complete);
        let left: Vec<String> = files(disk.path())
            .into_keys()
            .filter(|name| name.contains("tmp"))
            .collect();
        let _ = std::process::Command::new("umount").arg(disk.path()).status();
        assert!(matches!(too_small, Err(Error::DiskTooSmall { .. })), "{too_small:?}");
        assert!(!is_there, "nothing is written that cannot be finished");
        assert!(matches!(filled, Err(Error::NoSpace { .. })), "{filled:?}");
        assert_eq!(complete.ok(), Some(false));
        assert!(left.is_empty(), "{left:?}");
    }
}
