//! Parts put together to one matrix in memory, rows in input order.

use super::{FactorVec, Part, Precision};

/// An integer for numbers of entries and columns: `i32` or `i64`.
pub trait Index: Copy + Default + From<i32> + TryFrom<u64> + TryInto<usize> + Send + Sync {}

impl Index for i32 {}
impl Index for i64 {}

/// A matrix in memory, put together part by part: compressed rows in input order, as of `scipy.sparse.csr_matrix`. Rows
/// without a part are empty.
///
/// Memory is touched only where a part is placed: parts dropped one after the other make room for the matrix.
///
/// ```
/// use hemicube_scene::InputPatch;
/// use hemicube_store::{Assembly, Precision};
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let store = room::stored(&folder.path().join("room.hemicube"), 0.05)?;
///
/// // How long rows are is read without reading them; parts then come one by one.
/// let lengths = (0..store.patch_count()).map(|patch| Ok(store.entries_of_row(InputPatch(patch))?.unwrap_or(0)));
/// let lengths = lengths.collect::<hemicube_store::Result<Vec<u64>>>()?;
/// let mut matrix = Assembly::<i32>::new(&lengths, Precision::Single).ok_or("too large")?;
/// for place in 0..store.manifest().parts.len() {
///     let part = store.part(place)?.ok_or("no such part")?;
///     matrix.place(&part).map_err(|patch| format!("row {patch} has another length"))?;
/// }
/// let (indptr, indices, data) = matrix.into_arrays();
/// let row = indptr[2] as usize..indptr[3] as usize;
/// assert_eq!(data.get(row.clone()), Some(store.row(InputPatch(2))?.ok_or("no row")?.data.as_slice()));
/// assert!(indices[row].is_sorted() && data.len() as u64 == store.manifest().entries);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Assembly<I> {
    indptr: Vec<I>,
    indices: Vec<I>,
    data: FactorVec,
}

impl<I: Index> Assembly<I> {
    /// For rows of so many entries each, in input order, of this width. `None` when there are more of them than `I`
    /// counts.
    pub fn new(entries_of_rows: &[u64], precision: Precision) -> Option<Self> {
        let mut indptr = Vec::with_capacity(entries_of_rows.len() + 1);
        let mut end = 0_u64;
        indptr.push(I::default());
        for &entries in entries_of_rows {
            end = end.checked_add(entries)?;
            indptr.push(I::try_from(end).ok()?);
        }
        let count = usize::try_from(end).ok()?;
        Some(Self {
            indptr,
            indices: vec![I::default(); count],
            data: FactorVec::zeros(precision, count),
        })
    }

    /// Places the rows of a part.
    ///
    /// # Errors
    /// The patch of the first row with another number of entries than announced.
    pub fn place(&mut self, part: &Part) -> Result<(), u32> {
        for (row, &patch) in part.rows.iter().enumerate() {
            let (columns, factors) = part.row(row);
            let bound = |place: usize| self.indptr.get(place).and_then(|&bound| bound.try_into().ok());
            let (Some(start), Some(end)) = (bound(patch as usize), bound(patch as usize + 1)) else {
                return Err(patch);
            };
            let range: std::ops::Range<usize> = start..end;
            let Some(indices) = self.indices.get_mut(range.clone()) else {
                return Err(patch);
            };
            if indices.len() != factors.len() || !self.data.place(range.start, factors) {
                return Err(patch);
            }
            for (index, &column) in indices.iter_mut().zip(columns) {
                *index = column.into();
            }
        }
        Ok(())
    }

    /// Starts of rows, and the last one's end; columns; form factors.
    pub fn into_arrays(self) -> (Vec<I>, Vec<I>, FactorVec) {
        (self.indptr, self.indices, self.data)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(rows: Vec<u32>, indptr: Vec<i64>, indices: Vec<i32>) -> Part {
        Part {
            data: indices
                .iter()
                .map(|&column| column as f32 + 0.5)
                .collect::<Vec<f32>>()
                .into(),
            rows,
            indptr,
            indices,
            ..Part::default()
        }
    }

    fn assembled<I: Index>() -> (Vec<I>, Vec<I>, FactorVec) {
        let parts = [
            part(vec![3, 0], vec![0, 2, 3], vec![0, 2, 1]),
            part(vec![1], vec![0, 3], vec![0, 2, 3]),
        ];
        let mut whole = Assembly::<I>::new(&[1, 3, 0, 2], Precision::Single).unwrap();
        for part in &parts {
            whole.place(part).unwrap();
        }
        whole.into_arrays()
    }

    #[test]
    fn rows_come_into_input_order() {
        let data = FactorVec::from(vec![1.5_f32, 0.5, 2.5, 3.5, 0.5, 2.5]);
        assert_eq!(
            assembled::<i32>(),
            (vec![0, 1, 4, 4, 6], vec![1, 0, 2, 3, 0, 2], data.clone())
        );
        assert_eq!(assembled::<i64>(), (vec![0, 1, 4, 4, 6], vec![1, 0, 2, 3, 0, 2], data));
    }

    #[test]
    fn more_than_can_be_counted_and_what_does_not_fit_is_refused() {
        assert!(Assembly::<i32>::new(&[1 << 30, 1 << 30], Precision::Single).is_none());
        assert!(Assembly::<i64>::new(&[u64::MAX, 1], Precision::Double).is_none());
        let mut whole = Assembly::<i32>::new(&[1, 1], Precision::Single).unwrap();
        assert_eq!(whole.place(&part(vec![1], vec![0, 2], vec![0, 1])), Err(1));
        assert_eq!(whole.place(&part(vec![2], vec![0, 1], vec![0])), Err(2));
    }
}
