//! Enclosures: patches that exchange radiation, directly or through others.
//!
//! They are the connected components of the matrix, entries taken in both directions, found by union and find (Tarjan
//! 1975) in one pass over the rows. Two rooms with a gap between them, however thin, are one enclosure where a form
//! factor shows it.

use super::{Factors, SolveError};
use crate::store::Error;
use std::path::Path;

/// The enclosures of a matrix, numbered from 0 by their first patch.
///
/// ```
/// use hemicube::solve::{InMemory, enclosures};
/// // Plates 0 and 2 see each other, plate 1 sees nothing.
/// let plates = InMemory::dense(&[vec![0.0, 0.0, 0.5], vec![0.0; 3], vec![0.5, 0.0, 0.0]]);
/// let found = enclosures(&plates)?;
/// assert_eq!((found.of_patch(), found.len()), (&[0, 1, 0][..], 2));
/// # Ok::<(), hemicube::solve::SolveError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Enclosures {
    of_patch: Vec<u32>,
    count: usize,
}

impl Enclosures {
    /// Number of enclosures, patches that see nothing included.
    pub fn len(&self) -> usize {
        self.count
    }

    /// True for a matrix without patches.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The enclosure of each patch.
    pub fn of_patch(&self) -> &[u32] {
        &self.of_patch
    }

    /// The patches of each enclosure, ascending.
    pub fn patches(&self) -> Vec<Vec<u32>> {
        let mut patches = vec![Vec::new(); self.count];
        for (patch, &enclosure) in (0..).zip(&self.of_patch) {
            patches[enclosure as usize].push(patch);
        }
        patches
    }

    /// These, with the enclosures of each group joined: a body of one temperature conducts between its patches.
    pub(super) fn joined(&self, groups: &[Vec<u32>]) -> Self {
        let mut sets = Sets::new(self.count);
        for group in groups {
            for pair in group.windows(2) {
                sets.join(self.of_patch[pair[0] as usize], self.of_patch[pair[1] as usize]);
            }
        }
        let merged: Vec<u32> = self.of_patch.iter().map(|&enclosure| sets.find(enclosure)).collect();
        Self::numbered(&merged)
    }

    /// Numbers sets by their first patches.
    fn numbered(root_of_patch: &[u32]) -> Self {
        let mut number = std::collections::HashMap::new();
        let mut of_patch = Vec::with_capacity(root_of_patch.len());
        for &root in root_of_patch {
            let next = u32::try_from(number.len()).unwrap_or(u32::MAX);
            of_patch.push(*number.entry(root).or_insert(next));
        }
        let count = number.len();
        Self { of_patch, count }
    }
}

/// Disjoint sets of numbers.
struct Sets(Vec<u32>);

impl Sets {
    fn new(count: usize) -> Self {
        Self((0..).take(count).collect())
    }

    fn find(&mut self, mut member: u32) -> u32 {
        while self.0[member as usize] != member {
            let above = self.0[self.0[member as usize] as usize];
            self.0[member as usize] = above;
            member = above;
        }
        member
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        // The least member stays the root: roots do not depend on the order of rows.
        self.0[a.max(b) as usize] = a.min(b);
    }
}

/// Finds the enclosures of a matrix: one pass over its rows, 4 bytes a patch.
///
/// # Errors
/// When rows cannot be read, or name patches that do not exist.
pub fn enclosures(factors: &dyn Factors) -> Result<Enclosures, SolveError> {
    let count = factors.patch_count();
    let mut sets = Sets::new(count);
    for run in 0..factors.run_count() {
        let part = factors.run(run)?;
        for (row, &patch) in part.rows.iter().enumerate() {
            let (columns, data) = part.row(row);
            for (&column, factor) in columns.iter().zip(data) {
                let column = column.cast_unsigned();
                if column as usize >= count || patch as usize >= count {
                    let reason = format!("has an entry at {patch}, {column}, and {count} patches");
                    return Err(Error::malformed(Path::new("the matrix"), reason).into());
                }
                if factor > 0.0 {
                    sets.join(patch, column);
                }
            }
        }
    }
    let roots: Vec<u32> = (0..).take(count).map(|patch| sets.find(patch)).collect();
    Ok(Enclosures::numbered(&roots))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::InMemory;

    #[test]
    fn components_and_what_conducts() {
        // 0–3 and 1–4 exchange, 2 sees nothing; one direction of a pair is enough.
        let mut rows = vec![vec![0.0; 5]; 5];
        (rows[3][0], rows[1][4], rows[4][1]) = (0.25, 0.5, 0.5);
        let found = enclosures(&InMemory::dense(&rows)).expect("a matrix");
        assert_eq!(found.of_patch(), [0, 1, 2, 0, 1]);
        assert_eq!(found.patches(), [vec![0, 3], vec![1, 4], vec![2]]);
        let joined = found.joined(&[vec![3, 2], vec![1]]);
        assert_eq!(joined.of_patch(), [0, 1, 0, 0, 1]);
        assert_eq!(joined.len(), 2);
    }
}
