//! Vectors of one number a patch, several side by side.

/// Several right-hand sides, or bands, of one number a patch. Patch by patch, so that an entry of the matrix is read once
/// for all of them.
///
/// ```
/// use hemicube::solve::Block;
/// // Three patches, two right-hand sides.
/// let block = Block::from_fn(3, 2, |patch, side| (10 * side + patch) as f64);
/// assert_eq!(block.of(1), [1.0, 11.0]);
/// assert!(block.column(1).eq([10.0, 11.0, 12.0]));
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Block {
    columns: usize,
    values: Vec<f64>,
}

impl Block {
    /// Zeros.
    pub fn zeros(patches: usize, columns: usize) -> Self {
        Self {
            columns,
            values: vec![0.0; patches * columns],
        }
    }

    /// The values that `value` gives for a patch and a column.
    pub fn from_fn(patches: usize, columns: usize, mut value: impl FnMut(usize, usize) -> f64) -> Self {
        let mut block = Self::zeros(patches, columns);
        for patch in 0..patches {
            for (column, place) in block.of_mut(patch).iter_mut().enumerate() {
                *place = value(patch, column);
            }
        }
        block
    }

    /// How many vectors there are.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// How many numbers each has.
    pub fn patches(&self) -> usize {
        self.values.len().checked_div(self.columns).unwrap_or(0)
    }

    /// The numbers of a patch, one a vector.
    pub fn of(&self, patch: usize) -> &[f64] {
        &self.values[patch * self.columns..(patch + 1) * self.columns]
    }

    /// The same, to be changed.
    pub fn of_mut(&mut self, patch: usize) -> &mut [f64] {
        &mut self.values[patch * self.columns..(patch + 1) * self.columns]
    }

    /// All numbers, patch by patch.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// One of the vectors.
    pub fn column(&self, column: usize) -> impl Iterator<Item = f64> + '_ {
        self.values.iter().skip(column).step_by(self.columns.max(1)).copied()
    }

    /// Adds `factors[c]` times column c of `other` to column c.
    pub(super) fn add_scaled(&mut self, factors: &[f64], other: &Self) {
        for (mine, theirs) in self
            .values
            .chunks_exact_mut(self.columns)
            .zip(other.values.chunks_exact(self.columns))
        {
            for ((mine, theirs), factor) in mine.iter_mut().zip(theirs).zip(factors) {
                *mine += factor * theirs;
            }
        }
    }

    /// Multiplies column c by `factors[c]`.
    pub(super) fn scale(&mut self, factors: &[f64]) {
        for mine in self.values.chunks_exact_mut(self.columns) {
            for (mine, factor) in mine.iter_mut().zip(factors) {
                *mine *= factor;
            }
        }
    }

    /// The scalar product of column c with column c of `other`, for each c.
    pub(super) fn dot(&self, other: &Self) -> Vec<f64> {
        let mut sums = vec![0.0; self.columns];
        for (mine, theirs) in self
            .values
            .chunks_exact(self.columns)
            .zip(other.values.chunks_exact(self.columns))
        {
            for ((sum, mine), theirs) in sums.iter_mut().zip(mine).zip(theirs) {
                *sum += mine * theirs;
            }
        }
        sums
    }

    /// The Euclidean norm of each column.
    pub fn norms(&self) -> Vec<f64> {
        self.dot(self).into_iter().map(f64::sqrt).collect()
    }
}
