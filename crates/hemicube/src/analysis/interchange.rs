//! Total interchange factors of grey, diffuse surfaces, Hottel's script-F: what leaves i as its own emission and is
//! absorbed by j, directly and after any number of reflections.
//!
//! ```text
//! 𝓕_ij = ε_i ε_j / (ρ_i ρ_j) · A_j Ψ_ij − δ_ij ε_i² / ρ_i       Ψ = (diag(A / ρ) − A F)⁻¹, ρ = 1 − ε
//! Σ_j 𝓕_ij = ε_i in an enclosure                                A_i 𝓕_ij = A_j 𝓕_ji
//! ```
//!
//! (Hottel & Sarofim 1967, *Radiative Transfer*, pp. 84–86.) The matrix is symmetric and positive definite where rows
//! sum to at most 1 and ε > 0; it is factorised as L D Lᵀ without pivots. n³/6 + n³ multiplications.

use thiserror::Error;

/// Surfaces of a matrix whose interchange factors are computed: n² numbers of 8 bytes, twice, and some n³ operations.
pub const SURFACES_MAX: usize = 8192;

/// Why there are no interchange factors.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum InterchangeError {
    /// More surfaces than [`SURFACES_MAX`].
    #[error("{0} surfaces are more than the {SURFACES_MAX} that interchange factors are computed of")]
    TooMany(usize),
    /// An emittance outside of (0, 1).
    #[error("the emittance of surface {number} is {emittance}, and must be above 0 and below 1")]
    Emittance {
        /// Number of the surface, from 0.
        number: usize,
        /// Its emittance.
        emittance: f64,
    },
    /// A pivot is not positive: rows sum to more than 1.
    #[error("the equations of surface {0} cannot be solved: form factors sum to more than 1")]
    Pivot(usize),
}

/// The interchange areas A_i 𝓕_ij, dense by rows, of symmetric exchange areas A_i F_ij, dense by rows.
///
/// # Errors
/// For emittances outside of (0, 1), too many surfaces, and sums above 1.
///
/// # Panics
/// When the lengths do not fit each other.
///
/// ```
/// use hemicube::analysis::interchange::interchange;
///
/// // Two parallel planes: 𝓕 = 1 / (1/ε₁ + 1/ε₂ − 1).
/// let areas = [2.0, 2.0];
/// let found = interchange(&[0.0, 2.0, 2.0, 0.0], &areas, &[0.5, 0.8])?;
/// assert!((found[1] / 2.0 - 1.0 / (2.0 + 1.25 - 1.0)).abs() < 1e-12);
/// # Ok::<(), hemicube::analysis::interchange::InterchangeError>(())
/// ```
pub fn interchange(exchange: &[f64], areas: &[f64], emittances: &[f64]) -> Result<Vec<f64>, InterchangeError> {
    let count = areas.len();
    assert_eq!((exchange.len(), emittances.len()), (count * count, count), "lengths");
    if count > SURFACES_MAX {
        return Err(InterchangeError::TooMany(count));
    }
    if let Some(number) = emittances.iter().position(|&e| !(e > 0.0 && e < 1.0)) {
        let emittance = emittances[number];
        return Err(InterchangeError::Emittance { number, emittance });
    }
    let mut lower: Vec<f64> = exchange.iter().map(|&area| -area).collect();
    for (i, (area, emittance)) in areas.iter().zip(emittances).enumerate() {
        lower[i * count + i] += area / (1.0 - emittance);
    }
    factorise(&mut lower, count)?;
    let scale: Vec<f64> = areas
        .iter()
        .zip(emittances)
        .map(|(area, e)| area * e / (1.0 - e))
        .collect();
    let mut found = vec![0.0; count * count];
    let mut column = vec![0.0; count];
    for (j, &emittance) in emittances.iter().enumerate() {
        column.fill(0.0);
        column[j] = scale[j];
        solve(&lower, count, &mut column);
        for (i, &value) in column.iter().enumerate() {
            found[i * count + j] = scale[i] * value;
        }
        found[j * count + j] -= scale[j] * emittance;
    }
    // Rounding leaves the two triangles apart by some last bits.
    for i in 0..count {
        for j in 0..i {
            let mean = 0.5 * (found[i * count + j] + found[j * count + i]);
            (found[i * count + j], found[j * count + i]) = (mean, mean);
        }
    }
    Ok(found)
}

/// L below the diagonal, D on it, of the matrix whose lower triangle is given.
fn factorise(matrix: &mut [f64], count: usize) -> Result<(), InterchangeError> {
    let mut scaled = vec![0.0; count];
    for i in 0..count {
        let (above, row) = matrix.split_at_mut(i * count);
        // Entries of row i become L_ij D_j, then L_ij.
        for j in 0..i {
            let other = &above[j * count..j * count + j];
            let dot: f64 = row[..j].iter().zip(other).map(|(a, b)| a * b).sum();
            row[j] -= dot;
        }
        let mut pivot = row[i];
        for j in 0..i {
            scaled[j] = row[j] / above[j * count + j];
            pivot -= row[j] * scaled[j];
        }
        row[..i].copy_from_slice(&scaled[..i]);
        if pivot.is_nan() || pivot <= 0.0 {
            return Err(InterchangeError::Pivot(i));
        }
        row[i] = pivot;
    }
    Ok(())
}

/// Solves L D Lᵀ x = b in place.
fn solve(lower: &[f64], count: usize, x: &mut [f64]) {
    for i in 0..count {
        let row = &lower[i * count..i * count + i];
        let dot: f64 = row.iter().zip(&*x).map(|(a, b)| a * b).sum();
        x[i] -= dot;
    }
    for i in 0..count {
        x[i] /= lower[i * count + i];
    }
    for i in (0..count).rev() {
        let value = x[i];
        for (x, l) in x[..i].iter_mut().zip(&lower[i * count..i * count + i]) {
            *x -= l * value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube of unit faces: opposite faces 0.2, the others 0.2, so that rows sum to 1.
    fn cube() -> Vec<f64> {
        (0..36).map(|at| if at / 6 == at % 6 { 0.0 } else { 0.2 }).collect()
    }

    #[test]
    fn an_enclosure_absorbs_what_it_emits() {
        let emittances = [0.1, 0.3, 0.5, 0.7, 0.9, 0.95];
        let found = interchange(&cube(), &[1.0; 6], &emittances).unwrap();
        for (i, emittance) in emittances.iter().enumerate() {
            let sum: f64 = found[6 * i..6 * i + 6].iter().sum();
            assert!((sum - emittance).abs() < 1e-12, "{sum} of {emittance}");
            for j in 0..6 {
                assert!((found[6 * i + j] - found[6 * j + i]).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn one_bounce_by_hand() {
        // Black-ish surroundings but for one mirror-like face: 𝓕_01 = ε₀ ε₁ (F + ρ-terms), by the fixed point.
        let emittances = [0.9, 0.8, 0.7, 0.6, 0.5, 0.4];
        let found = interchange(&cube(), &[1.0; 6], &emittances).unwrap();
        // Irradiation of each face for unit emissive power of face 0: H = F (ε e₀ + ρ H).
        let mut h = [0.0; 6];
        for _ in 0..400 {
            let j: Vec<f64> = (0..6)
                .map(|k| f64::from(u8::from(k == 0)) * emittances[0] + (1.0 - emittances[k]) * h[k])
                .collect();
            for i in 0..6 {
                h[i] = (0..6).filter(|&k| k != i).map(|k| 0.2 * j[k]).sum();
            }
        }
        for i in 0..6 {
            assert!((found[i] - emittances[i] * h[i]).abs() < 1e-12, "{i}");
        }
    }

    #[test]
    fn what_cannot_be_is_refused() {
        assert!(matches!(
            interchange(&[0.0, 1.0, 1.0, 0.0], &[1.0; 2], &[0.5, 1.0]),
            Err(InterchangeError::Emittance { number: 1, .. })
        ));
        assert_eq!(
            interchange(&[0.0, 9.0, 9.0, 0.0], &[1.0; 2], &[0.5, 0.5]),
            Err(InterchangeError::Pivot(1))
        );
    }
}
