//! Distance of one form-factor matrix from another.
//!
//! With d = a − b, b being the reference, over the rows of both:
//!
//! ```text
//! relative Frobenius  √(Σ d²) / √(Σ b²)
//! row error           ‖dᵢ‖₂ / ‖bᵢ‖₂                  median and 90th percentile over the rows
//! row L1              Σⱼ |dᵢⱼ| / Σⱼ bᵢⱼ
//! missed mass         Σ bᵢⱼ where aᵢⱼ is absent or 0, over Σ b;  spurious mass the other way round, over Σ b
//! row-sum error       |Σⱼ aᵢⱼ − Σⱼ bᵢⱼ|
//! worst entry         largest |dᵢⱼ|
//! ```
//!
//! Patches of two states of a scene are those with the same corners, to the bit: then all is over rows and columns of
//! both. Otherwise, and where corners differ by rounding alone, patch i of one is patch i of the other.

use hemicube_store::{Error, Matrix, MatrixRow, PatchTable, Result};
use serde::Serialize;
use std::ops::Range;
use std::path::PathBuf;

/// Corners that are no farther apart, over the largest coordinate, are one corner: a file of f32 rounds to 6e-8 of it.
const ROUNDING: f64 = 1e-6;

/// Rows to compare.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CompareOptions {
    /// Only these rows of the matrix; all if `None`.
    pub rows: Option<Range<u32>>,
}

/// The entry of largest difference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WorstEntry {
    /// Row, a patch of the matrix.
    pub i: u32,
    /// Column, a patch of the matrix.
    pub j: u32,
    /// Value in the matrix.
    pub a: f64,
    /// Value in the reference.
    pub b: f64,
}

/// A quantity over rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct OverRows {
    /// Half of the rows have no more.
    pub median: f64,
    /// Nine of ten rows have no more.
    pub percentile_90: f64,
    /// No row has more.
    pub max: f64,
    /// Average over the rows.
    pub mean: f64,
}

/// Distance of a matrix from a reference. All zero when they are equal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// The matrix, a.
    pub matrix: PathBuf,
    /// The reference, b.
    pub reference: PathBuf,
    /// Patches of both.
    pub patch_count: u32,
    /// True if patches are the same by their corners, false if by their numbers.
    pub by_corners: bool,
    /// Patches that the reference lacks.
    pub patches_only_in_matrix: u32,
    /// Patches that the matrix lacks.
    pub patches_only_in_reference: u32,
    /// Rows of both. Only a store tells whether a row was computed. In a file an empty row counts as not computed,
    /// unless it is empty in both.
    pub rows_compared: u64,
    /// Rows with entries that the reference lacks.
    pub rows_only_in_matrix: u64,
    /// Rows with entries that the matrix lacks.
    pub rows_only_in_reference: u64,
    /// Entries of the matrix in the rows compared.
    pub entries_in_matrix: u64,
    /// Entries of the reference in the rows compared.
    pub entries_in_reference: u64,
    /// √(Σ d²) / √(Σ b²).
    pub relative_frobenius: f64,
    /// ‖dᵢ‖₂ / ‖bᵢ‖₂ over the rows.
    pub row_error: OverRows,
    /// Σⱼ |dᵢⱼ| / Σⱼ bᵢⱼ over the rows.
    pub row_l1: OverRows,
    /// Rows empty in the reference only. They have no relative error, and count in the other figures only.
    pub rows_without_reference: u64,
    /// Σ bᵢⱼ over pairs with aᵢⱼ absent or 0, over Σ b.
    pub missed_mass: f64,
    /// The largest missed mass of a row, over its Σ b.
    pub missed_mass_worst_row: f64,
    /// Σ aᵢⱼ over pairs with bᵢⱼ absent or 0, over Σ b.
    pub spurious_mass: f64,
    /// |Σⱼ aᵢⱼ − Σⱼ bᵢⱼ| over the rows.
    pub row_sum_error: OverRows,
    /// The entry of largest difference, if any entry differs.
    pub worst_entry: Option<WorstEntry>,
}

impl Comparison {
    /// Returns whether no entry differs, and both have the same patches and rows.
    pub fn is_equal(&self) -> bool {
        let alone = [self.patches_only_in_matrix, self.patches_only_in_reference];
        self.worst_entry.is_none()
            && alone == [0, 0]
            && self.rows_only_in_matrix == 0
            && self.rows_only_in_reference == 0
    }
}

/// Distance of one row from the reference's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowDifference {
    /// The row, a patch of the matrix.
    pub row: u32,
    /// The row of the reference, a patch of that.
    pub reference_row: u32,
    /// ‖dᵢ‖₂.
    pub distance: f64,
    /// ‖bᵢ‖₂.
    pub reference: f64,
    /// Σⱼ dᵢⱼ.
    pub sum: f64,
}

impl RowDifference {
    /// ‖dᵢ‖₂ / ‖bᵢ‖₂; 0 for two empty rows, infinite for an empty reference row.
    pub fn relative(&self) -> f64 {
        over(self.distance, self.reference)
    }
}

/// 0/0 is no difference; anything else over 0 is infinite.
fn over(part: f64, whole: f64) -> f64 {
    if part == 0.0 { 0.0 } else { part / whole }
}

/// Compares `matrix` with `reference`, row by row.
///
/// # Errors
/// [`Error::Incomparable`] when they have no patch or no row in common; otherwise errors of reading.
///
/// ```
/// use hemicube_solve::analysis::compare::{CompareOptions, compare};
/// use hemicube_store::Matrix;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let (coarse, fine) = (folder.path().join("coarse"), folder.path().join("fine"));
/// # room::stored(&coarse, 0.05)?;
/// # room::stored(&fine, 0.0)?;
///
/// // Stores here; files of SciPy, Matrix Market and NumPy are opened as well.
/// let (coarse, fine) = (Matrix::open(&coarse)?, Matrix::open(&fine)?);
/// let comparison = compare(&coarse, &fine, &CompareOptions::default())?;
/// assert_eq!(comparison.rows_compared, 6);
/// assert!(comparison.relative_frobenius > 0.0 && comparison.missed_mass < comparison.relative_frobenius);
/// assert!(compare(&fine, &fine, &CompareOptions::default())?.is_equal());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn compare(matrix: &Matrix, reference: &Matrix, options: &CompareOptions) -> Result<Comparison> {
    compare_rows(matrix, reference, options, |_| ())
}

/// [`compare`], and `each` is called with every row of both, in ascending order.
///
/// # Errors
/// Those of [`compare`].
///
/// ```
/// use hemicube_solve::analysis::compare::{CompareOptions, compare_rows};
/// # use hemicube_store::Matrix;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let (coarse, fine) = (folder.path().join("coarse"), folder.path().join("fine"));
/// # room::stored(&coarse, 0.05)?;
/// # room::stored(&fine, 0.0)?;
/// # let (coarse, fine) = (Matrix::open(&coarse)?, Matrix::open(&fine)?);
///
/// // Of the first four rows, the one that is farthest off.
/// let (mut rows, mut worst) = (0, None);
/// let options = CompareOptions { rows: Some(0..4) };
/// let comparison = compare_rows(&coarse, &fine, &options, |row| {
///     rows += 1;
///     if worst.is_none_or(|(_, error)| row.relative() > error) {
///         worst = Some((row.row, row.relative()));
///     }
/// })?;
/// assert_eq!(rows, 4);
/// assert!(worst.is_some_and(|(row, error)| row < 4 && error == comparison.row_error.max));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn compare_rows(
    matrix: &Matrix,
    reference: &Matrix,
    options: &CompareOptions,
    mut each: impl FnMut(RowDifference),
) -> Result<Comparison> {
    let incomparable = |reason: String| Error::Incomparable {
        path: matrix.path().to_owned(),
        reference: reference.path().to_owned(),
        reason,
    };
    let kind = |matrix: &Matrix| Some(matrix.store()?.manifest().patch_kind());
    if let (Some(kind), Some(other)) = (kind(matrix), kind(reference))
        && kind != other
    {
        return Err(incomparable(format!(
            "their patches are by {} and by {}; compute both by the same",
            kind.name(),
            other.name()
        )));
    }
    let pairs = Pairs::of(matrix, reference, incomparable)?;
    let size = matrix.patch_count();
    let rows = options.rows.clone().unwrap_or(0..size);
    let mut tally = Tally::default();
    let mut next = rows.start;
    while next < rows.end.min(size) {
        let Some((row, other)) = pairs.next(matrix, reference, next).filter(|&(row, _)| row < rows.end) else {
            break;
        };
        next = row + 1;
        let (a, b) = pairs.in_common(matrix.row(row)?, reference.row(other)?);
        // Only a store knows computed rows without entries.
        let has = |found: &Option<MatrixRow>, source: &Matrix| {
            found
                .as_ref()
                .is_some_and(|row| source.store().is_some() || !row.columns.is_empty())
        };
        let is_empty = |found: &Option<MatrixRow>| found.as_ref().is_some_and(|row| row.columns.is_empty());
        match (has(&a, matrix), has(&b, reference)) {
            (false, false) => {}
            (true, false) if !(is_empty(&a) && b.is_some()) => tally.rows_only_in_matrix += 1,
            (false, true) if !(is_empty(&b) && a.is_some()) => tally.rows_only_in_reference += 1,
            _ => each(tally.add([row, other], &a.unwrap_or_default(), &b.unwrap_or_default())),
        }
    }
    // Also when there is no row at all: nothing compared is not equal.
    if tally.rows_compared == 0 {
        return Err(incomparable(
            "they have no row in common; compute the same rows of both".to_owned(),
        ));
    }
    Ok(tally.finish(matrix, reference, &pairs))
}

/// Which patch of the matrix is which of the reference.
enum Pairs {
    /// Those of one number.
    ByNumber,
    /// Those of the same corners.
    ByCorners {
        /// By patch of the matrix, that of the reference.
        there: Vec<Option<u32>>,
        /// By patch of the reference, that of the matrix.
        here: Vec<Option<u32>>,
    },
}

impl Pairs {
    fn of(matrix: &Matrix, reference: &Matrix, incomparable: impl Fn(String) -> Error) -> Result<Self> {
        let (size, other) = (matrix.patch_count(), reference.patch_count());
        let table = |matrix: &Matrix| -> Result<Option<PatchTable>> {
            let with_table = matrix.store().filter(|store| store.manifest().patches.is_some());
            let table = with_table.map(|store| store.patches()).transpose()?;
            Ok(table.filter(|table| !table.corners.is_empty()))
        };
        let mut reason = format!(
            "they have {size} and {other} patches; compute both from the same patches, or compare stores of triangles, \
             whose corners tell which are the same"
        );
        if let (Some(own), Some(table)) = (table(matrix)?, table(reference)?)
            && !is_rounded(&own, &table)
        {
            let there = table.partners(own.corners.iter().copied());
            let mut here = vec![None; table.len()];
            for (patch, there) in (0..).zip(&there) {
                if let Some(there) = there {
                    here[*there as usize] = Some(patch);
                }
            }
            if there.iter().any(Option::is_some) {
                return Ok(Self::ByCorners { there, here });
            }
            reason = format!(
                "they have {size} and {other} patches, and none of one is where one of the other is, to the last digit; \
                 cut both scenes in the same way, and leave coordinates as they are"
            );
        }
        if size == other {
            Ok(Self::ByNumber)
        } else {
            Err(incomparable(reason))
        }
    }

    /// The first row of both from `next` on, by its number in either. Rows of files that cannot have entries in either
    /// are skipped.
    fn next(&self, matrix: &Matrix, reference: &Matrix, next: u32) -> Option<(u32, u32)> {
        match self {
            Self::ByNumber => {
                let rows = [matrix.next_row(next), reference.next_row(next)];
                rows.into_iter().flatten().min().map(|row| (row, row))
            }
            Self::ByCorners { there, .. } => {
                let mut pairs = (next..).zip(&there[next as usize..]);
                pairs.find_map(|(row, other)| Some((row, (*other)?)))
            }
        }
    }

    /// Two rows over the patches of both, by the numbers of the matrix.
    fn in_common(&self, a: Option<MatrixRow>, b: Option<MatrixRow>) -> (Option<MatrixRow>, Option<MatrixRow>) {
        let Self::ByCorners { there, here } = self else {
            return (a, b);
        };
        let kept = |row: MatrixRow, of: &dyn Fn(u32) -> Option<u32>| {
            let entries = row.columns.into_iter().zip(row.values);
            let mut entries: Vec<(u32, f64)> = entries
                .filter_map(|(column, value)| Some((of(column)?, value)))
                .collect();
            entries.sort_unstable_by_key(|&(column, _)| column);
            let (columns, values) = entries.into_iter().unzip();
            MatrixRow { columns, values }
        };
        let own = |column: u32| there[column as usize].map(|_| column);
        let other = |column: u32| here[column as usize];
        (a.map(|row| kept(row, &own)), b.map(|row| kept(row, &other)))
    }

    /// Patches that only the matrix has, and that only the reference has.
    fn alone(&self) -> [u32; 2] {
        let Self::ByCorners { there, here } = self else {
            return [0, 0];
        };
        let alone = |of: &[Option<u32>]| of.iter().map(|other| u32::from(other.is_none())).sum();
        [alone(there), alone(here)]
    }
}

/// Returns whether two tables have the same corners in the same order, but for rounding.
fn is_rounded(a: &PatchTable, b: &PatchTable) -> bool {
    let (a, b) = (
        a.corners.as_flattened().as_flattened(),
        b.corners.as_flattened().as_flattened(),
    );
    let largest = a
        .iter()
        .fold(0.0, |largest: f64, coordinate| largest.max(coordinate.abs()));
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= ROUNDING * largest)
}

#[derive(Debug, Default)]
struct Tally {
    rows_compared: u64,
    rows_only_in_matrix: u64,
    rows_only_in_reference: u64,
    entries: (u64, u64),
    difference_squared: f64,
    reference_squared: f64,
    reference_mass: f64,
    missed: f64,
    spurious: f64,
    missed_worst: f64,
    row_error: Vec<f64>,
    row_l1: Vec<f64>,
    row_sum_error: Vec<f64>,
    rows_without_reference: u64,
    worst: Option<WorstEntry>,
}

impl Tally {
    fn add(&mut self, [i, other]: [u32; 2], a: &MatrixRow, b: &MatrixRow) -> RowDifference {
        self.rows_compared += 1;
        self.entries.0 += a.columns.len() as u64;
        self.entries.1 += b.columns.len() as u64;
        let (mut squared, mut squared_b, mut l1, mut missed) = (0.0, 0.0, 0.0, 0.0);
        for (j, a, b) in Merged::new(a, b) {
            let difference: f64 = a - b;
            squared += difference * difference;
            squared_b += b * b;
            l1 += difference.abs();
            if a == 0.0 {
                missed += b;
            }
            if b == 0.0 {
                self.spurious += a;
            }
            let worst = self.worst.map_or(0.0, |worst| (worst.a - worst.b).abs());
            if difference.abs() > worst {
                self.worst = Some(WorstEntry { i, j, a, b });
            }
        }
        let (sum_a, sum_b): (f64, f64) = (a.values.iter().sum(), b.values.iter().sum());
        self.difference_squared += squared;
        self.reference_squared += squared_b;
        self.reference_mass += sum_b;
        self.missed += missed;
        self.row_sum_error.push((sum_a - sum_b).abs());
        if squared_b > 0.0 && sum_b > 0.0 {
            self.row_error.push((squared / squared_b).sqrt());
            self.row_l1.push(l1 / sum_b);
            self.missed_worst = self.missed_worst.max(missed / sum_b);
        } else if l1 > 0.0 {
            self.rows_without_reference += 1;
        } else {
            self.row_error.push(0.0);
            self.row_l1.push(0.0);
        }
        RowDifference {
            row: i,
            reference_row: other,
            distance: squared.sqrt(),
            reference: squared_b.sqrt(),
            sum: sum_a - sum_b,
        }
    }

    fn finish(self, matrix: &Matrix, reference: &Matrix, pairs: &Pairs) -> Comparison {
        let [patches_only_in_matrix, patches_only_in_reference] = pairs.alone();
        Comparison {
            matrix: matrix.path().to_owned(),
            reference: reference.path().to_owned(),
            patch_count: matrix.patch_count() - patches_only_in_matrix,
            by_corners: matches!(pairs, Pairs::ByCorners { .. }),
            patches_only_in_matrix,
            patches_only_in_reference,
            rows_compared: self.rows_compared,
            rows_only_in_matrix: self.rows_only_in_matrix,
            rows_only_in_reference: self.rows_only_in_reference,
            entries_in_matrix: self.entries.0,
            entries_in_reference: self.entries.1,
            relative_frobenius: over(self.difference_squared.sqrt(), self.reference_squared.sqrt()),
            row_error: OverRows::new(self.row_error),
            row_l1: OverRows::new(self.row_l1),
            rows_without_reference: self.rows_without_reference,
            missed_mass: over(self.missed, self.reference_mass),
            missed_mass_worst_row: self.missed_worst,
            spurious_mass: over(self.spurious, self.reference_mass),
            row_sum_error: OverRows::new(self.row_sum_error),
            worst_entry: self.worst,
        }
    }
}

impl OverRows {
    fn new(mut values: Vec<f64>) -> Self {
        values.sort_unstable_by(f64::total_cmp);
        // The smallest value that is not exceeded by this share of the rows.
        let at = |percent: usize| {
            let rank = (values.len() * percent).div_ceil(100);
            values.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        let mean = if values.is_empty() {
            0.0
        } else {
            values.iter().sum::<f64>() / values.len() as f64
        };
        Self {
            median: at(50),
            percentile_90: at(90),
            max: at(100),
            mean,
        }
    }
}

/// The entries of two rows side by side: column, value in the first, value in the second; 0 for an absent one.
struct Merged<'a> {
    a: &'a MatrixRow,
    b: &'a MatrixRow,
    at_a: usize,
    at_b: usize,
}

impl<'a> Merged<'a> {
    fn new(a: &'a MatrixRow, b: &'a MatrixRow) -> Self {
        Self { a, b, at_a: 0, at_b: 0 }
    }
}

impl Iterator for Merged<'_> {
    type Item = (u32, f64, f64);

    fn next(&mut self) -> Option<Self::Item> {
        let of = |row: &MatrixRow, at: usize| row.columns.get(at).copied().zip(row.values.get(at).copied());
        let (a, b) = (of(self.a, self.at_a), of(self.b, self.at_b));
        let column = match (a, b) {
            (Some((a, _)), Some((b, _))) => a.min(b),
            (Some((column, _)), None) | (None, Some((column, _))) => column,
            (None, None) => return None,
        };
        let mut take = |entry: Option<(u32, f64)>, first: bool| match entry {
            Some((found, value)) if found == column => {
                *(if first { &mut self.at_a } else { &mut self.at_b }) += 1;
                value
            }
            _ => 0.0,
        };
        Some((column, take(a, true), take(b, false)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn market(directory: &Path, name: &str, entries: &[(u32, u32, f64)]) -> Matrix {
        let mut text = format!(
            "%%MatrixMarket matrix coordinate real general\n% a comment\n4 4 {}\n",
            entries.len()
        );
        for (row, column, value) in entries {
            text.push_str(&format!("{row} {column} {value:e}\n"));
        }
        let path = directory.join(name);
        std::fs::write(&path, text).unwrap();
        Matrix::open(&path).unwrap()
    }

    const REFERENCE: [(u32, u32, f64); 5] = [(1, 2, 0.3), (1, 3, 0.4), (2, 1, 0.5), (3, 4, 0.25), (4, 3, 0.125)];

    #[test]
    fn equal_matrices_have_no_error() {
        let directory = tempfile::tempdir().unwrap();
        let b = market(directory.path(), "b.mtx", &REFERENCE);
        let mut shuffled = REFERENCE;
        shuffled.reverse();
        let a = market(directory.path(), "a.mtx", &shuffled);
        let comparison = compare(&a, &b, &CompareOptions::default()).unwrap();
        assert!(comparison.is_equal());
        assert_eq!(comparison.rows_compared, 4);
        assert_eq!(comparison.relative_frobenius, 0.0);
        let none = OverRows::default();
        assert_eq!(
            [comparison.row_error, comparison.row_l1, comparison.row_sum_error],
            [none; 3]
        );
        assert_eq!(
            [
                comparison.missed_mass,
                comparison.spurious_mass,
                comparison.missed_mass_worst_row
            ],
            [0.0; 3]
        );
    }

    #[test]
    fn every_figure_is_what_it_is_by_hand() {
        let directory = tempfile::tempdir().unwrap();
        let b = market(directory.path(), "b.mtx", &REFERENCE);
        // One entry gone, one changed, one too many; row 4 is not there.
        let doctored = [(1, 2, 0.3), (2, 1, 0.5 + 0.05), (2, 3, 0.02), (3, 4, 0.25)];
        let a = market(directory.path(), "a.mtx", &doctored);
        let found = compare(&a, &b, &CompareOptions::default()).unwrap();
        assert!(!found.is_equal());
        assert_eq!(
            (
                found.rows_compared,
                found.rows_only_in_matrix,
                found.rows_only_in_reference
            ),
            (3, 0, 1)
        );
        assert_eq!((found.entries_in_matrix, found.entries_in_reference), (4, 4));
        let near = |value: f64, wanted: f64| assert!((value - wanted).abs() < 1e-12, "{value} is not {wanted}");
        let squared_b = 0.09 + 0.16 + 0.25 + 0.0625;
        near(
            found.relative_frobenius,
            ((0.16 + 0.0025 + 0.0004f64) / squared_b).sqrt(),
        );
        near(found.row_error.max, 0.4 / 0.5);
        near(found.row_error.median, (0.0029f64).sqrt() / 0.5);
        near(found.row_error.percentile_90, 0.8);
        near(found.row_l1.max, 0.4 / 0.7);
        near(found.row_l1.mean, (0.4 / 0.7 + 0.07 / 0.5) / 3.0);
        near(found.missed_mass, 0.4 / 1.45);
        near(found.missed_mass_worst_row, 0.4 / 0.7);
        near(found.spurious_mass, 0.02 / 1.45);
        near(found.row_sum_error.max, 0.4);
        assert_eq!(
            found.worst_entry,
            Some(WorstEntry {
                i: 0,
                j: 2,
                a: 0.0,
                b: 0.4
            })
        );
        let mut rows = Vec::new();
        let each = compare_rows(&a, &b, &CompareOptions::default(), |row| {
            rows.push((row.row, row.relative()))
        });
        assert_eq!(each.unwrap(), found);
        assert_eq!(rows.iter().map(|row| row.0).collect::<Vec<_>>(), [0, 1, 2]);
        near(rows[0].1, 0.8);
        near(rows[1].1, (0.0029f64).sqrt() / 0.5);
        assert_eq!(rows[2].1, 0.0);
        let one_row = compare(&a, &b, &CompareOptions { rows: Some(2..3) }).unwrap();
        assert_eq!((one_row.rows_compared, one_row.relative_frobenius), (1, 0.0));
    }

    #[allow(
        dead_code,
        unreachable_pub,
        clippy::pedantic,
        reason = "the documentation's examples use more of it"
    )]
    mod room {
        include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs"));
    }

    /// A store of the room whose patches are where these triangles are.
    fn placed(directory: &Path, off: f64, places: [f64; 6]) -> Matrix {
        let table = PatchTable {
            corners: places.map(|x| [[x, 0.0, 0.0], [x, 1.0, 0.0], [x, 0.0, 1.0]]).to_vec(),
            ..room::table()
        };
        let mut writer = hemicube_store::StoreWriter::create(directory, room::header(), &table, false).unwrap();
        for part in room::parts(off) {
            writer.write_part(&part).unwrap();
        }
        writer.finish().unwrap();
        Matrix::open(directory).unwrap()
    }

    #[test]
    fn two_states_of_a_scene_are_compared_over_the_patches_of_both() {
        let directory = tempfile::tempdir().unwrap();
        let place = |name: &str| directory.path().join(name);
        let a = placed(&place("a"), 0.05, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        // Two change places, and one is another.
        let b = placed(&place("b"), 0.0, [2.0, 1.0, 0.0, 3.0, 4.0, 7.0]);
        let dense = |matrix: &Matrix| {
            [0, 1, 2, 3, 4, 5].map(|row| {
                let (row, mut of) = (matrix.row(row).unwrap().unwrap(), [0.0; 6]);
                row.columns
                    .iter()
                    .zip(&row.values)
                    .for_each(|(&j, &value)| of[j as usize] = value);
                of
            })
        };
        let (of_a, of_b, partner) = (dense(&a), dense(&b), [2, 1, 0, 3, 4]);
        let (mut squared, mut squared_b) = (0.0, 0.0);
        for i in 0..5 {
            for j in 0..5 {
                let reference: f64 = of_b[partner[i]][partner[j]];
                squared += (of_a[i][j] - reference).powi(2);
                squared_b += reference.powi(2);
            }
        }
        let mut rows = Vec::new();
        let found = compare_rows(&a, &b, &CompareOptions::default(), |row| rows.push(row)).unwrap();
        assert!(found.by_corners && !found.is_equal());
        let counts = [
            found.patch_count,
            found.patches_only_in_matrix,
            found.patches_only_in_reference,
        ];
        assert_eq!((counts, found.rows_compared), ([5, 1, 1], 5));
        assert!((found.relative_frobenius - (squared / squared_b).sqrt()).abs() < 1e-12 && squared > 1e-4);
        let numbers: Vec<_> = rows.iter().map(|row| (row.row, row.reference_row as usize)).collect();
        assert_eq!(numbers, [(0, 2), (1, 1), (2, 0), (3, 3), (4, 4)]);
        let sum = |row: &[f64; 6]| row[..5].iter().sum::<f64>();
        assert!((rows[0].sum - (sum(&of_a[0]) - sum(&of_b[2]))).abs() < 1e-12);

        // Corners that are rounded, and those of another frame, are matched by number.
        for (name, places) in [("rounded", 1.0 + 1e-8), ("elsewhere", 1.5)] {
            let c = placed(
                &place(name),
                0.05,
                [0.1, 1.0, 2.0, 3.0, 4.0, 5.0].map(|x| x * places + 0.5 * (places - 1.0)),
            );
            let d = placed(&place(&format!("{name} 2")), 0.05, [0.1, 1.0, 2.0, 3.0, 4.0, 5.0]);
            let found = compare(&c, &d, &CompareOptions::default()).unwrap();
            assert!(!found.by_corners && found.is_equal(), "{name}");
        }
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let b = market(directory.path(), "b.mtx", &REFERENCE);
        let path = directory.path().join("small.mtx");
        std::fs::write(&path, "%%MatrixMarket matrix coordinate real general\n3 3 0\n").unwrap();
        let small = Matrix::open(&path).unwrap();
        let error = compare(&small, &b, &CompareOptions::default()).unwrap_err();
        assert!(error.to_string().contains("3 and 4 patches"), "{error}");
        let top = market(directory.path(), "top.mtx", &REFERENCE[..2]);
        let bottom = market(directory.path(), "bottom.mtx", &REFERENCE[3..]);
        let error = compare(&top, &bottom, &CompareOptions::default()).unwrap_err();
        assert!(error.to_string().contains("no row in common"), "{error}");
        let error = compare(&b, &b, &CompareOptions { rows: Some(4..9) }).unwrap_err();
        assert!(error.to_string().contains("no row in common"), "{error}");
    }

    #[test]
    fn hostile_market_files_are_refused() {
        let directory = tempfile::tempdir().unwrap();
        let banner = "%%MatrixMarket matrix coordinate real general\n";
        for (name, text) in [
            ("empty", String::new()),
            ("binary", "\u{0}\u{1}".repeat(9000)),
            (
                "pattern",
                "%%MatrixMarket matrix coordinate pattern general\n1 1 1\n1 1\n".into(),
            ),
            ("sizes", format!("{banner}4 4\n")),
            ("oblong", format!("{banner}4 5 0\n")),
            ("huge", format!("{banner}4294967295 4294967295 0\n")),
            ("many", format!("{banner}4 4 18446744073709551615\n1 1 1\n")),
            ("truncated", format!("{banner}4 4 2\n1 1 1\n")),
            ("surplus", format!("{banner}4 4 1\n1 1 1\n1 2 1\n1 3 1\n")),
            ("outside", format!("{banner}4 4 1\n5 1 0.5\n")),
            ("zeroth", format!("{banner}4 4 1\n0 1 0.5\n")),
            ("word", format!("{banner}4 4 1\n1 1 half\n")),
            ("long", format!("{banner}{}", "1".repeat(10_000))),
        ] {
            let path = directory.path().join(format!("{name}.mtx"));
            std::fs::write(&path, text).unwrap();
            assert!(Matrix::open(&path).is_err(), "{name}");
        }
        // A height that is only a claim costs nothing.
        let tall = directory.path().join("tall.mtx");
        std::fs::write(&tall, format!("{banner}2000000000 2000000000 1\n1999999999 7 0.5\n")).unwrap();
        let (a, b) = (Matrix::open(&tall).unwrap(), Matrix::open(&tall).unwrap());
        let found = compare(&a, &b, &CompareOptions::default()).unwrap();
        assert_eq!((found.rows_compared, found.relative_frobenius), (1, 0.0));
        let nan = market(directory.path(), "nan.mtx", &[(1, 1, f64::NAN)]);
        assert!(compare(&nan, &nan, &CompareOptions::default()).is_err());
    }

    #[test]
    fn symmetric_entries_are_expanded() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("symmetric.mtx");
        std::fs::write(
            &path,
            "%%MatrixMarket matrix coordinate real symmetric\n3 3 2\n2 1 0.5\n3 3 1\n",
        )
        .unwrap();
        let matrix = Matrix::open(&path).unwrap();
        let row = |column: u32, value: f64| {
            let (columns, values) = (vec![column], vec![value]);
            Some(MatrixRow { columns, values })
        };
        assert_eq!(matrix.row(0).unwrap(), row(1, 0.5));
        assert_eq!(matrix.row(1).unwrap(), row(0, 0.5));
        assert_eq!(matrix.row(2).unwrap(), row(2, 1.0));
        assert_eq!(matrix.row(3).unwrap(), None);
    }

    #[test]
    fn a_second_entry_of_a_place_is_refused_by_its_line() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("doubled.mtx");
        let refused = |symmetry: &str, entries: &str, line: u32, place: &str| {
            let banner = format!("%%MatrixMarket matrix coordinate real {symmetry}\n% a comment\n3 3 3\n");
            std::fs::write(&path, banner + entries).unwrap();
            let error = Matrix::open(&path).unwrap_err().to_string();
            let expected = format!("{}:{line}: {place} has an entry before", path.display());
            assert!(error.starts_with(&expected), "{error}");
        };
        refused("general", "1 2 0.5\n2 1 0.5\n\n1 2 0.25\n", 7, "row 1, column 2");
        refused("general", "3 3 0\n2 1 0.5\n3 3 1\n", 6, "row 3, column 3");
        refused("symmetric", "2 1 0.5\n3 3 1\n1 2 0.25\n", 6, "row 1, column 2");
        // A line that is wrong by itself is named likewise.
        std::fs::write(&path, "%%MatrixMarket matrix coordinate real general\n2 2 1\n1 x 0.5\n").unwrap();
        let error = Matrix::open(&path).unwrap_err().to_string();
        assert!(
            error.contains("doubled.mtx:3: should have a row and a column"),
            "{error}"
        );
    }
}
