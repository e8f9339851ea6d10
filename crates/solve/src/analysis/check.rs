//! Checks of a store against the laws of a form-factor matrix:
//!
//! ```text
//! weights      visible + escaped + blocked + unselected = hemicubes · 2³¹, exactly, for every row
//! visible      |Σⱼ Fᵢⱼ − visible / (hemicubes · 2³¹)| ≤ ε Σⱼ Fᵢⱼ: the rounding of each factor (pixel mode, triangles);
//!              ε is 2⁻²⁴ for f32, 2⁻¹¹ more in the compact form, and 2⁻²⁴ more where small factors were left out and
//!              shared
//! range        0 ≤ Fᵢⱼ ≤ 1
//! columns      ascending, of patches that exist
//! diagonal     Fᵢᵢ = 0: a triangle does not see itself but through portals; up to 10⁻³ of a patch of several elements
//!              in one plane, any where they lie in none
//! shares       escaped, blocked, unselected from 0 to 1; of triangles in pixel mode, weight / (hemicubes · 2³¹)
//! entries      some row has one
//! winding      no closed surface sees nothing around all that sees something (`winding.rs`; triangles, all rows)
//! escaped      of a row at most what the bound allows, if there is one
//! closure      |Σⱼ Fᵢⱼ + escaped + blocked + unselected − 1|, of the shares; less what mirrors and panes hand on
//! passed       Σⱼ (ρsⱼ + τⱼ) Fᵢⱼ, of the manifest's mirrors and panes, is what the row says that they handed on; of
//!              those whose optics depend on the angle it is from 0 to Σⱼ Fᵢⱼ
//! reciprocity  √(Σ (Aᵢ Fᵢⱼ − Aⱼ Fⱼᵢ)²) / √(Σ (Aᵢ Fᵢⱼ)²), over the entries of sampled rows i whose row j exists
//! ```
//!
//! and of its files against their checksums. [`verdict`] sums them up. Without bounds of their own, closure and reciprocity
//! are judged by what the run was asked for: its tolerance, or 2 % ([`verdict::LIMIT`]), and twice that where two rows
//! differ.

pub mod verdict;
mod winding;

use hemicube_scene::InputPatch;
use hemicube_store::PatchKind;
use hemicube_store::sky::{SkyCheck, check_sky, sky_beside};
use hemicube_store::{
    ERRORS, Error, FactorSlice, Form, HEMICUBE_WEIGHT, Part, Passage, PatchOptics, PatchTable, Result, RowErrors,
    RowShares, RowSums, RowTable, Store,
};
use serde::Serialize;
use std::path::PathBuf;
use verdict::{LIMIT, Quality, Verdicts, WARNED};
use winding::{Outwards, Sides};

/// By how much what is handed on may be off what arrives: rounding of both.
const PASSED: f64 = 1e-6;

/// Bounds of a check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckOptions {
    /// Bound on the closure error of a row. `None`: 1e-6 and the value error of the store's form with pixel sums;
    /// otherwise it is a doubt beyond the run's tolerance ([`Quality::closure_limit`]).
    pub closure: Option<f64>,
    /// Bound on the escaped share of a row, for closed scenes; `None` to report it only.
    pub escaped: Option<f64>,
    /// Bound on the reciprocity residual; `None`: it is a doubt beyond twice the run's tolerance, or three standard
    /// errors of both readings where these are more ([`Quality::reciprocity_limit`]).
    pub reciprocity: Option<f64>,
    /// Matrices of no more entries are held in memory to measure reciprocity, at 8 bytes each.
    pub entries_in_memory: u64,
    /// Pairs of entries looked up to measure reciprocity in a matrix too large for memory.
    pub reciprocity_pairs: u64,
    /// Number of rows named, by their closure errors.
    pub worst_rows: usize,
    /// Accept a store with missing parts.
    pub allow_incomplete: bool,
}

impl Default for CheckOptions {
    fn default() -> Self {
        Self {
            closure: None,
            escaped: None,
            reciprocity: None,
            entries_in_memory: 1 << 23,
            reciprocity_pairs: 200_000,
            worst_rows: 5,
            allow_incomplete: false,
        }
    }
}

/// Kinds of checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Check {
    /// Every part is there.
    Complete,
    /// The files are unchanged, and all that readers rely on holds: one row a patch, areas above 0, unit normals.
    Files,
    /// The totals of the manifest are those of the parts.
    Manifest,
    /// The patch table agrees with the parts about every row.
    Table,
    /// A row's weights sum to its hemicubes'; sums of pixels have no other shares than these.
    Weights,
    /// A row's form factors sum to its visible weight.
    Visible,
    /// Form factors are between 0 and 1.
    Range,
    /// Columns ascend, and exist.
    Columns,
    /// No patch sees itself.
    Diagonal,
    /// Mirrors and panes hand on their share of what arrives.
    Passed,
    /// A row's form factors and shares sum to 1.
    Closure,
    /// No more of a row escapes than a bound allows.
    Escaped,
    /// Some row has an entry: a matrix without entries is of no scene.
    Entries,
    /// The model is not wound outwards: no closed surface that sees nothing is around all that sees something.
    Winding,
    /// A_i F_ij = A_j F_ji.
    Reciprocity,
    /// The sky rows beside the matrix are unchanged, and sum to its escaped shares.
    Sky,
}

/// A failed check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Failure {
    /// Its kind.
    pub check: Check,
    /// In how many rows, entries or files.
    pub count: u64,
    /// The first case, as a clause for a person.
    pub first: String,
}

/// Entries of a row, over the rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct EntriesPerRow {
    /// Fewest.
    pub min: u64,
    /// Half of the rows have no more.
    pub median: u64,
    /// Most.
    pub max: u64,
}

/// Distance of the rows' sums from 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Closure {
    /// Largest error of a row.
    pub max: f64,
    /// Average over the rows.
    pub mean: f64,
    /// Bound on a row, if there is one.
    pub bound: Option<f64>,
    /// Rows compared: those rendered, which have weights.
    pub rows: u64,
}

/// Difference of A_i F_ij and A_j F_ji.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Reciprocity {
    /// √(Σ (A_i F_ij − A_j F_ji)²) / √(Σ (A_i F_ij)²).
    pub residual: f64,
    /// Number of ordered pairs compared.
    pub pairs: u64,
    /// From how many rows they are: all, or evenly spaced ones.
    pub rows: u64,
    /// Standard error of `residual` by the rows' own, n_i: √(2 Σ (A_i n_i)² / Σ (A_i F_ij)²), as if both readings erred
    /// independently; NaN where a row states none.
    #[serde(skip)]
    pub expected: f64,
    /// Bound, if there is one.
    pub bound: Option<f64>,
}

/// Standard errors of the rows' sums and shares, as the rows state them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct RowErrorsFound {
    /// Of Σ F: 95 % of the rows have no more.
    pub sum_95: f64,
    /// The largest.
    pub sum_max: f64,
    /// Of the share that leaves the scene: 95 % of the rows have no more.
    pub escaped_95: f64,
    /// The largest.
    pub escaped_max: f64,
    /// Rows of which three standard errors of Σ F or of that share are more than the tolerance.
    pub uncertain_rows: u64,
    /// The patch of the row with the largest standard error of Σ F.
    pub worst_patch: u32,
}

impl RowErrorsFound {
    /// Summarises the rows that state their errors: patch, of Σ F, of the share that leaves. `None` if there are none.
    fn of(mut rows: Vec<(u32, RowErrors)>, tolerance: f64) -> Option<Self> {
        let uncertain_rows = rows.iter().filter(|(_, errors)| errors.exceed(tolerance)).count() as u64;
        let at_95 = (95 * rows.len()).div_ceil(100).saturating_sub(1);
        rows.sort_unstable_by(|p, q| p.1.escaped.total_cmp(&q.1.escaped));
        let (escaped_95, escaped_max) = (rows.get(at_95)?.1.escaped, rows.last()?.1.escaped);
        rows.sort_unstable_by(|p, q| p.1.sum.total_cmp(&q.1.sum).then(q.0.cmp(&p.0)));
        let (sum_95, worst) = (rows.get(at_95)?.1.sum, rows.last()?);
        Some(Self {
            sum_95: sum_95.into(),
            sum_max: worst.1.sum.into(),
            escaped_95: escaped_95.into(),
            escaped_max: escaped_max.into(),
            uncertain_rows,
            worst_patch: worst.0,
        })
    }
}

/// A row with its sum and shares.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WorstRow {
    /// The input patch.
    pub patch: u32,
    /// |Σ F + escaped + blocked + unselected − 1|.
    pub closure_error: f64,
    /// Σ F.
    pub row_sum: f64,
    /// Share that leaves the scene.
    pub escaped: f64,
    /// Share that ends on backs of one-sided patches.
    pub blocked: f64,
}

/// Result of a check.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct CheckReport {
    /// The store.
    pub store: PathBuf,
    /// True if nothing failed.
    pub ok: bool,
    /// The failed checks.
    pub failures: Vec<Failure>,
    /// True if every part is there.
    pub complete: bool,
    /// Patches of the scene.
    pub patch_count: u32,
    /// Their kind; absent in JSON for triangles.
    #[serde(skip_serializing_if = "PatchKind::is_triangle")]
    pub patch_kind: PatchKind,
    /// Rows present.
    pub rows: u64,
    /// Entries present.
    pub entries: u64,
    /// Form of its parts.
    pub form: Form,
    /// Relative rounding error of a form factor, by the form.
    pub value_error: f64,
    /// The tolerance asked for, where one was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<f64>,
    /// Relative Frobenius error expected of the matrix, √(Σ e² / Σ F²) over the rows that estimate theirs, e; absent
    /// without a tolerance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_error: Option<f64>,
    /// Standard errors of the rows' sums and shares; absent without a tolerance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub row_errors: Option<RowErrorsFound>,
    /// Entries of a row, over the rows.
    pub entries_per_row: EntriesPerRow,
    /// Weights over all rows.
    pub sums: RowSums,
    /// Average over the rendered rows of the share that leaves the scene.
    pub escaped: f64,
    /// Largest such share of a row.
    pub escaped_max: f64,
    /// Bound on it, if there is one.
    pub escaped_bound: Option<f64>,
    /// Average over the rendered rows of the share on backs of one-sided patches.
    pub blocked: f64,
    /// Average over the rendered rows of the share on patches without a column.
    pub unselected: f64,
    /// Average over the rendered rows of the share cut off after the last portal, a part of `unselected`; `None`
    /// without portals.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cut_off: Option<f64>,
    /// Largest such share of a row.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cut_off_max: Option<f64>,
    /// Rows with any blocked share.
    pub blocked_rows: u64,
    /// Distance of the rows' sums from 1.
    pub closure: Closure,
    /// Difference of A_i F_ij and A_j F_ji.
    pub reciprocity: Reciprocity,
    /// Evidence of quality besides bounds.
    pub quality: Quality,
    /// Integrity, conservation and quality.
    pub verdicts: Verdicts,
    /// The rows with the largest closure error, largest first.
    pub worst_rows: Vec<WorstRow>,
    /// The sky rows beside the matrix, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sky: Option<SkyCheck>,
}

/// Checks a store. A damaged file is a failure in the report, as long as the directory can be told for a store.
///
/// # Errors
/// [`Error::Io`] when a file cannot be read at all.
///
/// ```
/// use hemicube_solve::analysis::check::{Check, CheckOptions, check};
/// use hemicube_store::Store;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let directory = folder.path().join("room.hemicube");
/// # let store = room::stored(&directory, 0.05)?;
///
/// let report = check(&store, &CheckOptions::default())?;
/// assert!(report.ok && report.closure.max < 1e-6, "{:?}", report.failures);
/// assert!(report.verdicts.integrity.failed.is_empty());
///
/// // One bit of the matrix, on a disk that forgets.
/// let part = directory.join(&store.manifest().parts[0].file);
/// let mut bytes = std::fs::read(&part)?;
/// let middle = bytes.len() / 2;
/// bytes[middle] ^= 1;
/// std::fs::write(&part, bytes)?;
/// let report = check(&Store::open(&directory)?, &CheckOptions::default())?;
/// assert!(!report.ok && report.failures.iter().any(|failure| failure.check == Check::Files));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn check(store: &Store, options: &CheckOptions) -> Result<CheckReport> {
    let manifest = store.manifest();
    let is_pixel = manifest.correction == "pixel";
    let closure_bound = options.closure.or(is_pixel.then_some(1e-6 + manifest.value_error));
    let mut tally = Tally::new(store, is_pixel, closure_bound, options.worst_rows);
    let tolerance = manifest.settings["tolerance"].as_f64();
    let asked = tolerance.unwrap_or(LIMIT);
    tally.quality.closure_limit = closure_bound.unwrap_or(asked);
    // Each of the two readings may be off by what was asked.
    tally.quality.reciprocity_limit = options.reciprocity.unwrap_or(2.0 * asked);
    tally.escaped_bound = options.escaped;
    if !manifest.complete && !options.allow_incomplete {
        let missing = format!("{} of {} parts are there", manifest.parts.len(), manifest.part_count);
        tally.fail(Check::Complete, missing);
    }
    let table = tally.files(store.verify_patches().and_then(|()| store.patches()))?;
    tally.handed_on = table.as_ref().and_then(|table| manifest.optics_of(table));
    let row_table = if manifest.complete {
        tally.files(store.row_table())?
    } else {
        None
    };
    if !manifest.patch_kind().is_triangle() {
        tally.is_pixel = false;
    }
    // Without a table, nothing is known against what a patch sees of itself.
    let most = |table: &PatchTable| table.most_of_itself(manifest.patch_kind(), manifest.has_portals());
    tally.most_of_itself = table.as_ref().map(most);
    let slots = row_table.as_ref().map_or(0, |_| manifest.patch_count as usize);
    let mut row_sums = vec![None; slots];
    tally.parts(store, &mut row_sums)?;
    if let Some(table) = &row_table {
        tally.row_table(table, &row_sums);
    }
    if let Some(table) = &table {
        tally.winding(table);
    }
    let reciprocity = tally.reciprocity(store, table.as_ref(), options)?;
    let sky = sky_beside(store);
    let sky = match &row_table {
        Some(rows) if sky.exists() => match check_sky(&sky, &rows.escaped) {
            Ok(found) => Some(found),
            Err(Error::Io { path, action, source }) => return Err(Error::Io { path, action, source }),
            Err(error) => {
                tally.fail(Check::Sky, error.to_string());
                None
            }
        },
        _ => None,
    };
    let mut report = CheckReport {
        sky,
        ..tally.finish(store, reciprocity)
    };
    report.verdicts = Verdicts::of(&report);
    Ok(report)
}

impl Tally {
    /// Checks every part, and notes the sums of its rows by their patches.
    fn parts(&mut self, store: &Store, row_sums: &mut [Option<[f64; 9]>]) -> Result<()> {
        for place in 0..store.manifest().parts.len() {
            let part = store.verify_part(place).and_then(|()| store.part_as_it_is(place));
            let Some((path, part)) = self.files(part)?.flatten() else {
                continue;
            };
            let failures = self.failures.iter().map(|failure| failure.count).sum::<u64>();
            self.part(place, &part);
            // Violations noticed by no check above: rows that another part has, and the like.
            if failures == self.failures.iter().map(|failure| failure.count).sum::<u64>() {
                self.files(store.validate(place, &path, &part))?;
            }
            for row in 0..part.rows.len() {
                if let Some(slot) = row_sums.get_mut(part.rows[row] as usize) {
                    *slot = Some(of_row(&part, row));
                }
            }
        }
        Ok(())
    }

    /// Compares the table of rows with their sums.
    fn row_table(&mut self, table: &RowTable, row_sums: &[Option<[f64; 9]>]) {
        for (patch, &expected) in row_sums.iter().enumerate() {
            let found = [
                table.row_sum[patch],
                table.escaped[patch],
                table.blocked[patch],
                table.unselected[patch],
                table.hemicube_escaped[patch],
                table.hemicube_blocked[patch],
                table.hemicube_unselected[patch],
                table.passed.get(patch).copied().unwrap_or(f64::NAN),
                table.cut_off.get(patch).copied().unwrap_or(f64::NAN),
            ];
            let expected = expected.unwrap_or([f64::NAN; 9]);
            // NaN marks absent rows, and equals itself here.
            let equal = found
                .iter()
                .zip(expected)
                .all(|(a, b)| *a == b || a.is_nan() && b.is_nan());
            if !equal {
                self.fail(
                    Check::Table,
                    format!("patch {patch} has {found:?}, its row {expected:?}"),
                );
            }
        }
    }

    /// Measures reciprocity, unless rows cannot be trusted as rows.
    fn reciprocity(
        &mut self,
        store: &Store,
        table: Option<&PatchTable>,
        options: &CheckOptions,
    ) -> Result<Reciprocity> {
        let bound = options.reciprocity;
        let is_unreadable = |failure: &Failure| matches!(failure.check, Check::Files | Check::Columns | Check::Range);
        let table = table.filter(|_| !self.failures.iter().any(is_unreadable));
        let stated = |table: &PatchTable| {
            let mut stated = vec![f64::NAN; table.area.len()];
            for &(patch, errors) in &self.row_errors {
                if let Some(own) = stated.get_mut(patch as usize) {
                    *own = errors.norm.into();
                }
            }
            stated
        };
        let found = table.map(|table| reciprocal(store, &table.area, &stated(table), options));
        let found = found.map(|found| self.files(found));
        let Some(found) = found.transpose()?.flatten() else {
            return Ok(Reciprocity {
                bound,
                ..Reciprocity::default()
            });
        };
        if let Some(bound) = bound
            && (found.residual > bound || found.residual.is_nan())
        {
            self.fail(
                Check::Reciprocity,
                format!("the residual is {:e}, the bound {bound:e}", found.residual),
            );
        }
        if bound.is_none() {
            let limit = &mut self.quality.reciprocity_limit;
            *limit = limit.max(ERRORS * found.expected);
        }
        Ok(Reciprocity { bound, ..found })
    }
}

/// Sum of the form factors, shares, and the hemicubes' shares, by the same operations as in the table.
fn of_row(part: &Part, row: usize) -> [f64; 9] {
    let sum = part.row(row).1.iter().sum();
    let [a, b, c] = part.shares[row].to_array();
    let [d, e, f] = RowShares::of_hemicubes(&part.sums[row], part.hemicubes[row]).to_array();
    let passage = part.passages.get(row);
    let [g, h] = passage.map_or([f64::NAN; 2], |passage| [passage.passed, passage.cut_off]);
    [sum, a, b, c, d, e, f, g, h]
}

#[derive(Debug)]
struct Tally {
    patch_count: u32,
    /// Most of itself that each patch may see.
    most_of_itself: Option<Vec<f64>>,
    /// True for triangles with sums of pixels.
    is_pixel: bool,
    has_portals: bool,
    has_specular: bool,
    /// ρs + τ of each patch.
    handed_on: Option<Vec<Option<PatchOptics>>>,
    /// Sum and largest of the shares cut off.
    cut_off: [f64; 2],
    /// By how much of itself each form factor can be off its weight.
    rounding: f64,
    worst_count: usize,
    failures: Vec<Failure>,
    entries: u64,
    entries_of_rows: Vec<u64>,
    sums: RowSums,
    parts: Vec<(u64, RowSums)>,
    lost: [f64; 3],
    blocked_rows: u64,
    escaped_max: f64,
    escaped_bound: Option<f64>,
    closure: Closure,
    closure_sum: f64,
    /// Σ e² of the rows' expected errors, and Σ F².
    squares: [f64; 2],
    /// Patch, standard error of Σ F and of the share that leaves, of each row that states them.
    row_errors: Vec<(u32, RowErrors)>,
    quality: Quality,
    worst: Vec<WorstRow>,
    /// The sides that rows look to; for triangles without portals.
    sides: Option<Sides>,
}

impl Tally {
    fn new(store: &Store, is_pixel: bool, closure_bound: Option<f64>, worst_count: usize) -> Self {
        Self {
            patch_count: store.patch_count(),
            most_of_itself: None,
            is_pixel,
            has_portals: store.manifest().has_portals(),
            has_specular: store.manifest().has_specular(),
            handed_on: None,
            cut_off: [0.0; 2],
            rounding: {
                let once = store.manifest().form.precision().rounding();
                let shared = if store.manifest().min_factor > 0.0 { once } else { 0.0 };
                (1.0 + once) * (1.0 + shared) * (1.0 + store.manifest().value_error) - 1.0
            },
            worst_count,
            failures: Vec::new(),
            entries: 0,
            entries_of_rows: Vec::new(),
            sums: RowSums::default(),
            parts: store
                .manifest()
                .parts
                .iter()
                .map(|part| (part.entries, part.sums))
                .collect(),
            lost: [0.0; 3],
            blocked_rows: 0,
            escaped_max: 0.0,
            escaped_bound: None,
            closure: Closure {
                bound: closure_bound,
                ..Closure::default()
            },
            closure_sum: 0.0,
            squares: [0.0; 2],
            row_errors: Vec::new(),
            quality: Quality::default(),
            worst: Vec::new(),
            sides: (store.manifest().patch_kind().is_triangle() && !store.manifest().has_portals())
                .then(|| Sides::new(store.patch_count() as usize)),
        }
    }

    fn fail(&mut self, check: Check, first: String) {
        match self.failures.iter_mut().find(|failure| failure.check == check) {
            Some(failure) => failure.count += 1,
            None => self.failures.push(Failure { check, count: 1, first }),
        }
    }

    /// A damaged or missing file is a finding; a file that the system refuses to read is an error.
    fn files<T>(&mut self, result: Result<T>) -> Result<Option<T>> {
        match result {
            Ok(value) => Ok(Some(value)),
            Err(Error::Io { path, action, source }) if source.kind() != std::io::ErrorKind::NotFound => {
                Err(Error::Io { path, action, source })
            }
            Err(error) => {
                self.fail(Check::Files, error.to_string());
                Ok(None)
            }
        }
    }

    fn part(&mut self, place: usize, part: &Part) {
        let mut of_part = Some(RowSums::default());
        self.squares[0] += part.squared_error();
        let stated = part
            .rows
            .iter()
            .zip(&part.errors)
            .filter(|(_, errors)| !errors.sum.is_nan());
        self.row_errors.extend(stated.map(|(&patch, &errors)| (patch, errors)));
        self.squares[1] += part.data.iter().map(|factor| factor * factor).sum::<f64>();
        for (row, &patch) in part.rows.iter().enumerate() {
            let (columns, factors) = part.row(row);
            self.entries += columns.len() as u64;
            self.entries_of_rows.push(columns.len() as u64);
            self.entries_of_row(patch, columns, factors);
            let passage = part.passages.get(row).copied().unwrap_or_default();
            self.passed_of_row(patch, columns, factors, passage);
            of_part = of_part.and_then(|sum| sum.plus(&part.sums[row]));
            self.weights_of_row(part, row, passage);
        }
        let found = (part.data.len() as u64, of_part);
        if let Some(&(entries, sums)) = self.parts.get(place)
            && found != (entries, Some(sums))
        {
            self.fail(
                Check::Manifest,
                format!("part {} has the sums {found:?}, not {:?}", part.index, (entries, sums)),
            );
        }
        self.sums = of_part.and_then(|sums| sums.plus(&self.sums)).unwrap_or(self.sums);
    }

    fn entries_of_row(&mut self, patch: u32, columns: &[i32], factors: FactorSlice<'_>) {
        let mut before = -1;
        for (&column, factor) in columns.iter().zip(factors) {
            let exists = u32::try_from(column).is_ok_and(|column| column < self.patch_count);
            if !exists || column <= before {
                self.fail(
                    Check::Columns,
                    format!("patch {patch} has column {column} after {before}"),
                );
            }
            before = column;
            // Also NaN.
            // Energy that returns to a mirror arrives there again.
            let is_of_arrivals = self.has_specular && factor >= 0.0 && factor.is_finite();
            if !((0.0..=1.0).contains(&factor) || is_of_arrivals) {
                self.fail(Check::Range, format!("F[{patch}, {column}] = {factor}"));
            }
            if i64::from(column) == i64::from(patch) && factor > self.most_of_itself(patch) {
                self.fail(Check::Diagonal, format!("F[{patch}, {patch}] = {factor}"));
            }
        }
    }

    /// Most of itself that a patch may see.
    fn most_of_itself(&self, patch: u32) -> f64 {
        let known = self.most_of_itself.as_ref().and_then(|most| most.get(patch as usize));
        known.copied().unwrap_or(1.0)
    }

    /// Holds what a row's mirrors and panes handed on against what arrives there.
    fn passed_of_row(&mut self, patch: u32, columns: &[i32], factors: FactorSlice<'_>, passage: Passage) {
        if !self.has_portals {
            return;
        }
        let [sum, largest] = &mut self.cut_off;
        *sum += passage.cut_off;
        *largest = largest.max(passage.cut_off);
        let Some(optics) = &self.handed_on else { return };
        // The least and the largest share that is reflected or let through.
        let (mut least, mut most) = (0.0, 0.0);
        for (&column, factor) in columns.iter().zip(factors) {
            let column = usize::try_from(column).ok();
            let Some(Some(optics)) = column.and_then(|column| optics.get(column)) else {
                continue;
            };
            let passed = (optics.specular + optics.transmittance) * factor;
            least += if optics.varies { 0.0 } else { passed };
            most += if optics.varies { factor } else { passed };
        }
        let off = (least - passage.passed).max(passage.passed - most);
        if off > (PASSED + self.rounding) * (1.0 + most) || off.is_nan() {
            let passed = passage.passed;
            let expected = if least == most {
                format!("{most}")
            } else {
                format!("{least} to {most}")
            };
            self.fail(
                Check::Passed,
                format!("mirrors and panes hand on {expected} of the row of patch {patch}, and it says {passed}"),
            );
        }
    }

    fn weights_of_row(&mut self, part: &Part, row: usize, passage: Passage) {
        let (patch, factors) = (part.rows[row], part.row(row).1);
        let (sums, shares, hemicubes) = (&part.sums[row], part.shares[row], part.hemicubes[row]);
        let whole = u64::from(hemicubes) * HEMICUBE_WEIGHT;
        if sums.total() != Some(whole) {
            let total = sums.total();
            self.fail(
                Check::Weights,
                format!("the weights of patch {patch} sum to {total:?}, not to {whole}"),
            );
        }
        if hemicubes == 0 {
            return;
        }
        let row_sum: f64 = factors.iter().fold(0.0, |sum, factor| sum + factor);
        let whole = whole as f64;
        // Form factors are of what arrives, weights of what stays.
        let visible = sums.visible as f64 / whole + passage.passed;
        // Half a unit in the last place of each factor for every rounding; then the errors of f64 in the sum, and of
        // factors below f32's normal range.
        let roundings = if self.has_portals { 4.0 } else { 1.0 };
        let unit = if self.has_portals { 1e-8 } else { 0.0 };
        let bound = visible * self.rounding * roundings + factors.len() as f64 * 1e-16 + unit;
        let is_off = (row_sum - visible).abs() > bound || row_sum.is_nan();
        if self.is_pixel && is_off {
            self.fail(
                Check::Visible,
                format!("the form factors of patch {patch} sum to {row_sum}, its visible weight is {visible}"),
            );
        }
        let seen = RowShares::of_hemicubes(sums, hemicubes);
        if self.is_pixel && shares != seen {
            self.fail(
                Check::Weights,
                format!("the shares of patch {patch} are {shares:?}, those of its weights {seen:?}"),
            );
        }
        if let Some(sides) = &mut self.sides {
            sides.add(patch, shares);
        }
        let lost = shares.to_array();
        for (total, lost) in self.lost.iter_mut().zip(lost) {
            *total += lost;
        }
        self.blocked_rows += u64::from(shares.blocked > 0.0);
        self.quality.warned_rows += u64::from(shares.blocked > WARNED);
        self.escaped_max = self.escaped_max.max(lost[0]);
        if let Some(bound) = self.escaped_bound.filter(|&bound| lost[0] > bound) {
            self.fail(
                Check::Escaped,
                format!(
                    "{:.3e} of the view of patch {patch} leaves the scene, the bound is {bound:e}",
                    lost[0]
                ),
            );
        }
        let error = (row_sum - passage.passed + lost.iter().sum::<f64>() - 1.0).abs();
        // NaN is infinitely far off.
        let error = if error.is_nan() { f64::INFINITY } else { error };
        self.closure.rows += 1;
        self.closure_sum += error;
        self.quality.closure_rows += u64::from(error > self.quality.closure_limit);
        self.closure.max = self.closure.max.max(error);
        if self.closure.bound.is_some_and(|bound| error > bound) {
            self.fail(
                Check::Closure,
                format!("patch {patch} and what it lost sum to 1 only within {error:e}"),
            );
        }
        let place = self.worst.partition_point(|other| other.closure_error >= error);
        if place < self.worst_count {
            let [escaped, blocked, _] = lost;
            self.worst.insert(
                place,
                WorstRow {
                    patch,
                    closure_error: error,
                    row_sum,
                    escaped,
                    blocked,
                },
            );
            self.worst.truncate(self.worst_count);
        }
    }

    /// Looks for a model that is wound outwards, and whose things within see each other.
    fn winding(&mut self, table: &PatchTable) {
        let found = self.sides.as_ref().filter(|_| self.entries > 0);
        let first = match found.and_then(|sides| sides.outwards(table)) {
            None => return,
            Some(Outwards::All) => {
                "the model is wound outwards throughout: a closed surface around it sees nothing, and what it encloses \
                 sees its own inside only"
            }
            Some(Outwards::Shell) => {
                "the closed surface around the model is wound outwards: it sees nothing, and what it encloses does not \
                 see it"
            }
        };
        self.fail(Check::Winding, first.to_owned());
    }

    fn finish(mut self, store: &Store, reciprocity: Reciprocity) -> CheckReport {
        if self.entries == 0 && self.closure.rows > 0 && store.manifest().complete {
            let share = |lost: f64| 100.0 * lost / self.closure.rows as f64;
            let first = format!(
                "no patch sees another: {:.1} % of the view leaves the scene, {:.1} % is backs of one-sided surfaces",
                share(self.lost[0]),
                share(self.lost[1])
            );
            self.fail(Check::Entries, first);
        }
        self.failures.sort_by_key(|failure| failure.check);
        self.entries_of_rows.sort_unstable();
        let of_rows = &self.entries_of_rows;
        let rendered = self.closure.rows.max(1) as f64;
        let tolerance = store.manifest().settings["tolerance"].as_f64();
        CheckReport {
            store: store.directory().to_owned(),
            ok: self.failures.is_empty(),
            failures: self.failures,
            complete: store.manifest().complete,
            patch_count: self.patch_count,
            patch_kind: store.manifest().patch_kind(),
            rows: of_rows.len() as u64,
            entries: self.entries,
            form: store.manifest().form,
            value_error: store.manifest().value_error,
            tolerance,
            expected_error: tolerance.and(Some((self.squares[0] / self.squares[1]).sqrt()).filter(|e| e.is_finite())),
            row_errors: tolerance.and_then(|tolerance| RowErrorsFound::of(self.row_errors, tolerance)),
            entries_per_row: EntriesPerRow {
                min: of_rows.first().copied().unwrap_or(0),
                median: of_rows.get(of_rows.len().saturating_sub(1) / 2).copied().unwrap_or(0),
                max: of_rows.last().copied().unwrap_or(0),
            },
            sums: self.sums,
            escaped: self.lost[0] / rendered,
            escaped_max: self.escaped_max,
            escaped_bound: self.escaped_bound,
            blocked: self.lost[1] / rendered,
            unselected: self.lost[2] / rendered,
            cut_off: self.has_portals.then(|| self.cut_off[0] / rendered),
            cut_off_max: self.has_portals.then_some(self.cut_off[1]),
            blocked_rows: self.blocked_rows,
            closure: Closure {
                mean: self.closure_sum / rendered,
                ..self.closure
            },
            reciprocity,
            quality: self.quality,
            verdicts: Verdicts::default(),
            worst_rows: self.worst,
            sky: None,
        }
    }
}

/// The reciprocity residual: over the whole matrix if it fits in memory, else over evenly spaced rows until enough
/// entries are looked up. `errors` are the rows' standard errors of their norm.
fn reciprocal(store: &Store, areas: &[f64], errors: &[f64], options: &CheckOptions) -> Result<Reciprocity> {
    let pairs_max = options.reciprocity_pairs;
    let manifest = store.manifest();
    let present = manifest.rows_present();
    if present == 0 {
        return Ok(Reciprocity::default());
    }
    let held = if manifest.entries <= options.entries_in_memory {
        let mut rows = vec![None; manifest.patch_count as usize];
        for row in store.rows_in_processing_order()? {
            let (patch, row) = row?;
            rows[patch.0 as usize] = Some(row);
        }
        Some(rows)
    } else {
        None
    };
    let factor = |i: u32, j: u32| -> Result<Option<f64>> {
        let of = |row: &hemicube_store::Row| row.indices.binary_search(&j).map_or(0.0, |place| row.data.at(place));
        match &held {
            Some(rows) => Ok(rows[i as usize].as_ref().map(of)),
            None => Ok(store.row(InputPatch(i))?.as_ref().map(of)),
        }
    };
    let order: Vec<u32> = match &held {
        Some(rows) => (0..)
            .zip(rows)
            .filter_map(|(patch, row)| row.as_ref().map(|_| patch))
            .collect(),
        None => {
            let all: Vec<u32> = store.computed_patches()?.into_iter().map(|patch| patch.0).collect();
            let per_row = (manifest.entries / present).max(1);
            let wanted = usize::try_from((pairs_max / per_row).clamp(1, present)).unwrap_or(usize::MAX);
            (0..wanted).map(|number| all[number * all.len() / wanted]).collect()
        }
    };
    // As shares of the largest: no square leaves the range of f64.
    let largest = areas.iter().copied().fold(0.0, f64::max);
    let areas: Vec<f64> = areas.iter().map(|area| area / largest).collect();
    let (mut difference, mut total, mut stated, mut pairs, mut rows) = (0.0, 0.0, 0.0, 0u64, 0u64);
    for &i in &order {
        if held.is_none() && pairs >= pairs_max {
            break;
        }
        let row = match &held {
            Some(held) => held[i as usize].clone(),
            None => store.row(InputPatch(i))?,
        };
        let Some(row) = row else { continue };
        rows += 1;
        stated += (areas[i as usize] * errors[i as usize]).powi(2);
        for (&j, forward) in row.indices.iter().zip(&row.data) {
            let Some(backward) = factor(j, i)? else { continue };
            let (forward, backward) = (areas[i as usize] * forward, areas[j as usize] * backward);
            difference += (forward - backward).powi(2);
            total += forward.powi(2);
            pairs += 1;
        }
    }
    let residual = if difference == 0.0 {
        0.0
    } else {
        (difference / total).sqrt()
    };
    Ok(Reciprocity {
        residual,
        pairs,
        rows,
        expected: (2.0 * stated / total).sqrt(),
        bound: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_state_how_wrong_their_sums_may_be() {
        assert_eq!(RowErrorsFound::of(Vec::new(), 0.01), None);
        // 0.5 % may be off by 1.5 %: one row in forty, and its neighbour's share that leaves.
        let of = |sum, escaped| RowErrors::from_array([0.0, sum, escaped]);
        let mut rows: Vec<_> = (0..40u32).map(|patch| (patch, of(1e-3, 2e-3))).collect();
        rows[7] = (7, of(5e-3, 1e-3));
        rows[8] = (8, of(1e-3, 4e-3));
        let found = RowErrorsFound::of(rows, 0.01).expect("rows");
        assert_eq!((found.uncertain_rows, found.worst_patch), (2, 7));
        let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert!(near(found.sum_95, 1e-3) && near(found.sum_max, 5e-3), "{found:?}");
        assert!(
            near(found.escaped_95, 2e-3) && near(found.escaped_max, 4e-3),
            "{found:?}"
        );
    }
}
