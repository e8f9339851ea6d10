//! A finished row as a value, handed from stage to stage of a run, and appended to a part at the end.

use super::{FactorVec, Part, Passage, Precision, RowErrors, RowShares, RowSums};

/// A row of the matrix, and what is known of it: one row of each array of a [`Part`].
///
/// ```
/// use hemicube_store::{FinishedRow, Part, Precision};
///
/// let mut row = FinishedRow::new(7, Precision::Single);
/// assert!(row.push(2, 0.25) && row.push(5, 0.5));
/// assert!(!row.push(6, 0.0), "what is not seen is no entry");
/// let mut part = Part::default();
/// part.push(&row);
/// assert_eq!((part.rows, part.indptr, part.indices), (vec![7], vec![0, 2], vec![2, 5]));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FinishedRow {
    /// The input patch of the row.
    pub patch: u32,
    /// The input patch of each entry's column, ascending.
    pub columns: Vec<i32>,
    /// The form factor of each entry.
    pub factors: FactorVec,
    /// Weights.
    pub sums: RowSums,
    /// Shares, refined with the form factors; with pixel sums, the weights' shares.
    pub shares: RowShares,
    /// Number of hemicubes; 0 for a row made without any.
    pub hemicubes: u32,
    /// Standard errors.
    pub errors: RowErrors,
    /// Number of rays and points that visible fractions were measured with.
    pub rays: u64,
    /// Passage through portals, where there are any.
    pub passage: Option<Passage>,
}

impl FinishedRow {
    /// A row without entries, of form factors of a width.
    pub fn new(patch: u32, precision: Precision) -> Self {
        Self {
            patch,
            columns: Vec::new(),
            factors: FactorVec::new(precision),
            sums: RowSums::default(),
            shares: RowShares::default(),
            hemicubes: 0,
            errors: RowErrors::default(),
            rays: 0,
            passage: None,
        }
    }

    /// Appends an entry, unless its form factor is 0 as rounded. Returns whether it did.
    pub fn push(&mut self, column: u32, factor: f64) -> bool {
        let is_positive = self.factors.push_positive(factor);
        if is_positive {
            self.columns.push(column.cast_signed());
        }
        is_positive
    }

    /// The entries: column and form factor, by ascending column.
    pub fn entries(&self) -> impl Iterator<Item = (u32, f64)> {
        let columns = self.columns.iter().map(|column| column.cast_unsigned());
        columns.zip(&self.factors)
    }

    /// Removes all entries.
    pub fn clear(&mut self) {
        self.columns.clear();
        self.factors.clear();
    }
}

impl Part {
    /// Appends a row. More rays than fit into 32 bits count as the most that do.
    pub fn push(&mut self, row: &FinishedRow) {
        if self.indptr.is_empty() {
            self.indptr.push(0);
        }
        self.rows.push(row.patch);
        self.indices.extend_from_slice(&row.columns);
        self.data.extend(row.factors.as_slice());
        self.indptr.push(i64::try_from(self.indices.len()).unwrap_or(i64::MAX));
        self.sums.push(row.sums);
        self.shares.push(row.shares);
        self.hemicubes.push(row.hemicubes);
        self.errors.push(row.errors);
        self.rays.push(u32::try_from(row.rays).unwrap_or(u32::MAX));
        self.passages.extend(row.passage);
    }
}
