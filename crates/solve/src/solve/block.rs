//! Vectors of one number a patch, several side by side.

/// Range of sums of squares that have lost nothing to the ends of f64's range.
const SQUARES: std::ops::Range<f64> = 1e-250..1e300;

/// Several right-hand sides, or bands, of one number a patch. Stored patch by patch: an entry of the matrix is read
/// once for all of them.
///
/// ```
/// use hemicube_solve::solve::Block;
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

    /// The values of `value` for each patch and column.
    pub fn from_fn(patches: usize, columns: usize, mut value: impl FnMut(usize, usize) -> f64) -> Self {
        let mut block = Self::zeros(patches, columns);
        for patch in 0..patches {
            for (column, place) in block.of_mut(patch).iter_mut().enumerate() {
                *place = value(patch, column);
            }
        }
        block
    }

    /// Number of vectors.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Length of each column.
    pub fn patches(&self) -> usize {
        self.values.len().checked_div(self.columns).unwrap_or(0)
    }

    /// The numbers of a patch, one a vector.
    pub fn of(&self, patch: usize) -> &[f64] {
        &self.values[patch * self.columns..(patch + 1) * self.columns]
    }

    /// The numbers of a patch, mutable.
    pub fn of_mut(&mut self, patch: usize) -> &mut [f64] {
        &mut self.values[patch * self.columns..(patch + 1) * self.columns]
    }

    /// All numbers, patch by patch.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// All numbers, mutable.
    pub(super) fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
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

    /// The Euclidean norm of each column, also of columns with squares out of the range of f64. NaN for a column with
    /// NaN.
    pub fn norms(&self) -> Vec<f64> {
        let squares = self.dot(self);
        let norm = |(column, square): (usize, f64)| {
            if SQUARES.contains(&square) {
                return square.sqrt();
            }
            let largest = self.largest(column);
            if largest == 0.0 || !largest.is_finite() {
                return largest;
            }
            let squares = self.column(column).map(|value| (value / largest) * (value / largest));
            largest * squares.sum::<f64>().sqrt()
        };
        squares.into_iter().enumerate().map(norm).collect()
    }

    /// The largest magnitude in a column; NaN for a column with NaN.
    pub(super) fn largest(&self, column: usize) -> f64 {
        let larger = |most: f64, value: f64| if value.is_nan() { value } else { most.max(value.abs()) };
        self.column(column).fold(
            0.0,
            |most, value| if f64::is_nan(most) { most } else { larger(most, value) },
        )
    }

    /// Multiplies column c by 2 to the power of `exponents[c]`; exact within the range of f64.
    pub(super) fn scale_by_powers(&mut self, exponents: &[i32]) {
        // Half of the power twice: 2⁻¹⁰⁷⁴ takes 2¹⁰⁷⁴ to become 1, more than an f64 holds.
        for half in [|e: i32| e / 2, |e: i32| e - e / 2] {
            let factors: Vec<f64> = exponents.iter().map(|&e| 2.0_f64.powi(half(e))).collect();
            self.scale(&factors);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn norms_are_right_wherever_numbers_are() {
        for scale in [1.0, 1e160, 1e-170, 1e300, 1e-300] {
            let block = Block::from_fn(2, 2, |patch, column| scale * [[3.0, 4.0], [5.0, 12.0]][column][patch]);
            for (norm, wanted) in block.norms().into_iter().zip([5.0, 13.0]) {
                assert!((norm / scale / wanted - 1.0).abs() < 1e-14, "{norm} at {scale}");
            }
        }
        assert_eq!(Block::zeros(3, 1).norms(), [0.0]);
        for bad in [f64::NAN, f64::INFINITY] {
            let norms = Block::from_fn(3, 2, |patch, column| if (patch, column) == (1, 1) { bad } else { 1.0 }).norms();
            assert!(
                (norms[0] - 3.0_f64.sqrt()).abs() < 1e-15 && !norms[1].is_finite(),
                "{norms:?}"
            );
        }
    }

    #[test]
    fn powers_of_two_scale_without_rounding() {
        let mut block = Block::from_fn(1, 2, |_, column| [0.1, 5e-324][column]);
        block.scale_by_powers(&[-900, 1074]);
        assert_eq!(block.of(0), [0.1 * 2.0_f64.powi(-900), 1.0]);
        block.scale_by_powers(&[900, -1074]);
        assert_eq!(block.of(0), [0.1, 5e-324]);
    }
}
