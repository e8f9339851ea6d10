//! Enclosures: patches that exchange radiation, directly or through others.
//!
//! They are the connected components of the matrix, entries taken in both directions, found by union and find (Tarjan
//! 1975). Two parts are connected where a patch of one sees more than [`LEAST_EXCHANGE`] of its view of the other: by one
//! entry, or by all of its entries there together. Two rooms with a gap between them are one enclosure where the matrix
//! shows more of it than its own rounding could.

use super::{Block, Factors, OPEN_LEAST, Problem, SolveError, multiply};
use hemicube_store::Error;
use std::collections::HashMap;
use std::path::Path;

/// The enclosures of a matrix, numbered from 0 by their first patch.
///
/// ```
/// use hemicube_solve::solve::{InMemory, enclosures};
/// // Plates 0 and 2 see each other, plate 1 sees nothing.
/// let plates = InMemory::dense(&[vec![0.0, 0.0, 0.5], vec![0.0; 3], vec![0.5, 0.0, 0.0]]);
/// let found = enclosures(&plates)?;
/// assert_eq!((found.of_patch(), found.len()), (&[0, 1, 0][..], 2));
/// # Ok::<(), hemicube_solve::solve::SolveError>(())
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
        let mut number = HashMap::new();
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

/// The part of a patch's view above which what it sees there is connected with it.
///
/// Form factors are stored within 2⁻²⁴ of a row, and measured in single precision: between closed rooms that share a
/// wall, rounding made up to 1.5·10⁻⁷ of a view. A hole of 1 cm² seen from 1 m is 3·10⁻⁵, and 10⁻⁶ is what makes a closed
/// enclosure an open one. More takes small openings for closed, less takes rounding for an opening.
pub const LEAST_EXCHANGE: f64 = 1e-6;

/// Finds the enclosures of a matrix: one pass over its rows, and another where that leaves several; 12 bytes a patch, and
/// 16 for each part that one row sees.
///
/// # Errors
/// When rows cannot be read, or name patches that do not exist.
pub fn enclosures(factors: &dyn Factors) -> Result<Enclosures, SolveError> {
    let count = factors.patch_count();
    let mut sets = Sets::new(count);
    let mut has_weak = false;
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
                if factor > LEAST_EXCHANGE {
                    sets.join(patch, column);
                } else {
                    has_weak |= factor > 0.0;
                }
            }
        }
    }
    let mut roots: Vec<u32> = (0..).take(count).map(|patch| sets.find(patch)).collect();
    if has_weak && roots.iter().any(|&root| root != roots[0]) {
        join_by_rows(factors, &roots, &mut sets)?;
        roots = (0..).take(count).map(|patch| sets.find(patch)).collect();
    }
    Ok(Enclosures::numbered(&roots))
}

/// Joins parts of which a row sees enough by all of its entries together.
fn join_by_rows(factors: &dyn Factors, roots: &[u32], sets: &mut Sets) -> Result<(), SolveError> {
    let mut seen: HashMap<u32, f64> = HashMap::new();
    for run in 0..factors.run_count() {
        let part = factors.run(run)?;
        for (row, &patch) in part.rows.iter().enumerate() {
            let own = roots[patch as usize];
            seen.clear();
            let (columns, data) = part.row(row);
            for (&column, factor) in columns.iter().zip(data) {
                let other = roots[column.cast_unsigned() as usize];
                if other != own {
                    *seen.entry(other).or_insert(0.0) += factor;
                }
            }
            // The order of joins changes no root.
            for (&other, _) in seen.iter().filter(|(_, share)| **share > LEAST_EXCHANGE) {
                sets.join(own, other);
            }
        }
    }
    Ok(())
}

/// A patch that absorbs less than this of a band reflects all of it: rounding of 1 − ε. More is solved for.
const ABSORBED_LEAST: f64 = 1e-12;

/// Refuses light without an end: an enclosure of which no patch absorbs, and from which nothing escapes, with emission.
/// Nothing is read of a matrix whose patches all absorb.
pub(super) fn require_an_end(factors: &dyn Factors, problem: &Problem, threads: usize) -> Result<(), SolveError> {
    let count = factors.patch_count();
    let absorbs = |patch: usize, column: usize| problem.rho(patch, column) < 1.0 - ABSORBED_LEAST;
    let columns = 0..problem.emission.columns();
    let is_suspect = |patch: usize, column: usize| !absorbs(patch, column) && problem.emission.of(patch)[column] != 0.0;
    if !columns
        .clone()
        .any(|column| (0..count).any(|patch| is_suspect(patch, column)))
    {
        return Ok(());
    }
    let seen = multiply(factors, &Block::from_fn(count, 1, |_, _| 1.0), threads)?;
    let escapes = |patch: usize| 1.0 - seen.of(patch)[0] - problem.back(patch) > OPEN_LEAST;
    let found = enclosures(factors)?;
    for column in columns {
        let mut has_end = vec![false; found.len()];
        let (mut gives, mut takes) = (has_end.clone(), has_end.clone());
        for (patch, &enclosure) in found.of_patch().iter().enumerate() {
            let emission = problem.emission.of(patch)[column];
            has_end[enclosure as usize] |= absorbs(patch, column) || escapes(patch);
            gives[enclosure as usize] |= emission > 0.0;
            takes[enclosure as usize] |= emission < 0.0;
        }
        // Emissions of both signs may add up to 0.
        let is_endless = |enclosure: usize| !has_end[enclosure] && gives[enclosure] != takes[enclosure];
        if let Some(first) = (0..found.len()).find(|&enclosure| is_endless(enclosure)) {
            let mut patches = (0..count).filter(|&patch| found.of_patch()[patch] as usize == first);
            return Err(SolveError::Endless {
                patch: patches.next().unwrap_or(0),
                count: 1 + patches.count(),
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::{InMemory, SolveOptions, solve};

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
    #[test]
    fn emission_that_neither_ends_nor_leaves_is_refused() {
        // A room of patches 0 and 1, and one of 2 and 3 with `open` of each view to the outside.
        let found = |reflectance: [f64; 4], emission: [f64; 4], open: f64| {
            let mut rows = vec![vec![0.0; 4]; 4];
            (rows[0][1], rows[1][0]) = (1.0, 1.0);
            (rows[2][3], rows[3][2]) = (1.0 - open, 1.0 - open);
            let problem = Problem {
                reflectance: Block::from_fn(4, 1, |patch, _| reflectance[patch]),
                bands: vec![0],
                emission: Block::from_fn(4, 1, |patch, _| emission[patch]),
                outside: None,
                returned: None,
            };
            solve(&InMemory::dense(&rows), &problem, SolveOptions::default(), &mut |_| {
                true
            })
        };
        let white = [1.0; 4];
        for (emission, open) in [
            ([0.0, 1.0, 0.0, 0.0], 0.5),
            ([1.0; 4], 0.0),
            ([-1.0, 0.0, 0.0, 0.0], 0.5),
        ] {
            let refused = found(white, emission, open);
            assert!(
                matches!(refused, Err(SolveError::Endless { patch: 0, count: 2 })),
                "{refused:?}"
            );
        }
        let refused = found([0.5, 0.5, 1.0, 1.0], [1.0; 4], 1e-8);
        assert!(
            matches!(refused, Err(SolveError::Endless { patch: 2, count: 2 })),
            "{refused:?}"
        );
        // Nothing emits there; one wall absorbs; a share escapes; what one patch emits another takes.
        for (reflectance, emission, open) in [
            (white, [0.0; 4], 0.0),
            (white, [0.0, 0.0, 1.0, 0.0], 0.5),
            ([1.0, 0.9, 1.0, 0.9], [1.0; 4], 0.0),
            (white, [1.0, -1.0, 0.0, 0.0], 0.5),
        ] {
            let solution = found(reflectance, emission, open).expect("it has an end");
            assert!(solution.converged && solution.radiosity.values().iter().all(|b| b.abs() < 100.0));
        }
    }

    #[test]
    fn a_small_opening_connects_and_rounding_does_not() {
        // Two rooms of two patches; of room 0 and 1, patch 1 has `weak` of its view on each patch of the other.
        let rooms = |weak: f64| {
            let mut rows = vec![vec![0.0; 4]; 4];
            (rows[0][1], rows[1][0], rows[2][3], rows[3][2]) = (1.0, 1.0, 1.0, 1.0);
            (rows[1][2], rows[1][3]) = (weak, weak);
            enclosures(&InMemory::dense(&rows)).expect("a matrix").len()
        };
        assert_eq!(rooms(0.0), 2);
        assert_eq!(rooms(1.5e-7), 2, "rounding");
        assert_eq!(rooms(0.6e-6), 1, "together more than the least");
        assert_eq!(rooms(3e-5), 1, "a hole of 1 cm² from 1 m");
    }
}
