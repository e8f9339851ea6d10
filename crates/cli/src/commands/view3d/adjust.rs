//! Exchange areas between surfaces, and what View3D makes of them: an enclosure, and interchange factors.

use hemicube::analysis::exchange::{self, Network};
use hemicube::solve::{InMemory, SolveError};
use std::collections::HashMap;

/// Largest error of a row's sum after [`Exchange::enclose`], and its sweeps: View3D's.
const SUM_ERROR: f64 = 1e-7;
const SWEEPS: u32 = 100;
/// Most surfaces of interchange factors, which are dense: n² numbers of 8 bytes, twice.
const SURFACES_MAX: usize = 8192;

/// A_i F_ij, sparse.
#[derive(Clone, Debug)]
pub(super) struct Exchange {
    pub(super) areas: Vec<f64>,
    rows: Vec<HashMap<u32, f64>>,
}

impl Exchange {
    pub(super) fn new(count: usize) -> Self {
        Self {
            areas: vec![0.0; count],
            rows: vec![HashMap::new(); count],
        }
    }

    pub(super) fn add(&mut self, from: u32, to: u32, area: f64) {
        *self.rows[from as usize].entry(to).or_insert(0.0) += area;
    }

    /// Makes A_i F_ij and A_j F_ji equal: their mean, each weighted by the other surface's area, as in
    /// [`hemicube::analysis::balance`].
    pub(super) fn symmetrise(&mut self) {
        let mut mean: Vec<HashMap<u32, f64>> = vec![HashMap::new(); self.rows.len()];
        for (i, row) in (0_u32..).zip(&self.rows) {
            for (&j, &area) in row {
                let weight = self.areas[j as usize] / (self.areas[i as usize] + self.areas[j as usize]);
                *mean[i as usize].entry(j).or_insert(0.0) += weight * area;
                *mean[j as usize].entry(i).or_insert(0.0) += weight * area;
            }
        }
        self.rows = mean;
    }

    /// Scales d_i S_ij d_j so that row i sums to A_i t_i; returns the sweeps. Sinkhorn & Knopp (1967).
    ///
    /// # Errors
    /// The row without entries.
    pub(super) fn enclose(&mut self, wanted: &[f64]) -> Result<u32, usize> {
        let rows: Vec<Vec<(u32, f64)>> = (0..self.rows.len()).map(|row| self.sorted(row)).collect();
        if let Some(row) = rows.iter().position(|row| row.iter().all(|&(_, area)| area <= 0.0)) {
            return Err(row);
        }
        let mut scale = vec![1.0; rows.len()];
        let mut sweep = 0;
        let mut error = f64::INFINITY;
        while sweep < SWEEPS && error > SUM_ERROR {
            error = 0.0;
            for (i, row) in rows.iter().enumerate() {
                let sum: f64 = row.iter().map(|&(j, area)| area * scale[j as usize]).sum::<f64>() * scale[i];
                let sum = sum / self.areas[i];
                error = error.max((sum - wanted[i]).abs());
                scale[i] *= wanted[i] / sum;
            }
            sweep += 1;
        }
        for (i, row) in self.rows.iter_mut().enumerate() {
            for (&j, area) in row.iter_mut() {
                *area *= scale[i] * scale[j as usize];
            }
        }
        Ok(sweep)
    }

    /// Replaces A_i F_ij by A_i 𝓕_ij; what a row lacks of 1 is lost.
    ///
    /// # Errors
    /// For more than [`SURFACES_MAX`] surfaces, and those of [`exchange::Exchange::new`].
    pub(super) fn reflect(&mut self, emittances: &[f64]) -> Result<(), SolveError> {
        let count = self.rows.len();
        if count > SURFACES_MAX {
            return Err(SolveError::Problem(format!(
                "{count} surfaces are more than the {SURFACES_MAX} that interchange factors are computed of"
            )));
        }
        let mut dense = vec![vec![0.0; count]; count];
        for (row, dense) in dense.iter_mut().enumerate() {
            self.factors(row)
                .iter()
                .for_each(|&(column, factor)| dense[column as usize] = factor);
        }
        let network = Network {
            names: (1..=count).map(|surface| surface.to_string()).collect(),
            area: self.areas.clone(),
            patches: vec![1; count],
            of_patch: (0..).take(count).collect(),
            escaped: vec![0.0; count],
            returned: vec![0.0; count],
            error: vec![0.0; count],
            handed_on: Vec::new(),
            factors: InMemory::dense(&dense),
        };
        drop(dense);
        let found = exchange::Exchange::new(&network, &[emittances.to_vec()], 0, &mut |_, _| true)?;
        for (i, row) in self.rows.iter_mut().enumerate() {
            // The mean of both directions, which differ by roundings.
            let area = |j: usize| (found.area(&network, 0, i, j) + found.area(&network, 0, j, i)) / 2.0;
            *row = (0..)
                .zip((0..count).map(area))
                .filter(|&(_, area)| area > 0.0)
                .collect();
        }
        Ok(())
    }

    fn sorted(&self, row: usize) -> Vec<(u32, f64)> {
        let mut entries: Vec<(u32, f64)> = self.rows[row].iter().map(|(&column, &area)| (column, area)).collect();
        entries.sort_unstable_by_key(|&(column, _)| column);
        entries
    }

    /// F_ij of a row, ascending by column.
    pub(super) fn factors(&self, row: usize) -> Vec<(u32, f64)> {
        let area = self.areas[row];
        self.sorted(row)
            .into_iter()
            .map(|(column, exchanged)| (column, exchanged / area))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_enclosure_is_closed_and_reciprocal() {
        let mut exchange = Exchange::new(3);
        exchange.areas = vec![1.0, 2.0, 3.0];
        for (i, j, area) in [
            (0, 1, 0.4),
            (1, 0, 0.42),
            (0, 2, 0.55),
            (2, 0, 0.6),
            (1, 2, 1.5),
            (2, 1, 1.4),
            (2, 2, 1.1),
        ] {
            exchange.add(i, j, area);
        }
        exchange.symmetrise();
        assert!(exchange.enclose(&[1.0; 3]).expect("every row sees something") > 1);
        for row in 0..3 {
            let factors = exchange.factors(row);
            let sum: f64 = factors.iter().map(|&(_, factor)| factor).sum();
            assert!((sum - 1.0).abs() < 1e-6, "row {row}: {sum}");
            for (column, factor) in factors {
                let back = exchange
                    .factors(column as usize)
                    .iter()
                    .find(|&&(to, _)| to as usize == row)
                    .map(|&(_, f)| f);
                let back = back.unwrap_or_default() * exchange.areas[column as usize];
                assert!((factor * exchange.areas[row] - back).abs() < 1e-12);
            }
        }
        let mut blind = Exchange::new(2);
        blind.areas = vec![1.0, 1.0];
        assert_eq!(blind.enclose(&[1.0; 2]), Err(0));
    }

    #[test]
    fn an_enclosure_absorbs_what_it_emits_and_parallel_planes_are_the_textbook_s() {
        // A cube of unit faces that all see a fifth of each other.
        let emittances = [0.1, 0.3, 0.5, 0.7, 0.9, 0.95];
        let mut cube = Exchange::new(6);
        cube.areas = vec![1.0; 6];
        for (i, j) in (0..36).map(|at| (at / 6, at % 6)).filter(|(i, j)| i != j) {
            cube.add(i, j, 0.2);
        }
        cube.reflect(&emittances).expect("a solution");
        for (row, emittance) in emittances.iter().enumerate() {
            let sum: f64 = cube.factors(row).iter().map(|&(_, factor)| factor).sum();
            assert!((sum - emittance).abs() < 1e-6, "{sum} of {emittance}");
        }
        let mut planes = Exchange::new(2);
        planes.areas = vec![2.0, 2.0];
        planes.add(0, 1, 2.0);
        planes.add(1, 0, 2.0);
        planes.reflect(&[0.5, 0.8]).expect("a solution");
        let (_, factor) = planes.factors(0)[1];
        assert!((factor - 1.0 / (2.0 + 1.25 - 1.0)).abs() < 1e-9, "{factor}");
        assert!(Exchange::new(SURFACES_MAX + 1).reflect(&[]).is_err());
    }
}
