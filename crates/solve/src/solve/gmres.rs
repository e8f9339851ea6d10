//! GMRES for several right-hand sides: Krylov spaces of their own, products with the matrix in common.
//!
//! Source: Saad & Schultz 1986, algorithm 4, with modified Gram–Schmidt and Givens rotations. Where it is asked for,
//! the last steps of a cycle go along the corrections of the cycles before (LGMRES: Baker, Jessup & Manteuffel 2005,
//! *SIAM J. Matrix Anal. Appl.* 26, 962): restarts then no longer forget the slow directions, such as the level of a
//! whole room in which one small surface alone has a temperature.

use super::{Block, SolveError, Work};

/// A vector shorter than this share of its former length is rounding: the space holds the solution.
const BREAKDOWN: f64 = 1e-14;

/// The upper triangle of one right-hand side's Hessenberg matrix after the rotations, and the rotated residual.
#[derive(Clone, Debug, Default)]
struct Column {
    upper: Vec<Vec<f64>>,
    rotations: Vec<(f64, f64)>,
    residual: Vec<f64>,
    /// Dimension of the space when it held the solution.
    done: Option<usize>,
}

impl Column {
    fn new(norm: f64) -> Self {
        Self {
            residual: vec![norm],
            // A residual of nothing is a solution already.
            done: (norm == 0.0).then_some(0),
            ..Self::default()
        }
    }

    /// Takes the next column of the Hessenberg matrix; the residual's norm.
    fn push(&mut self, mut column: Vec<f64>, below: f64, scale: f64) -> f64 {
        for (row, &(cosine, sine)) in self.rotations.iter().enumerate() {
            let (a, b) = (column[row], column[row + 1]);
            column[row] = cosine * a + sine * b;
            column[row + 1] = cosine * b - sine * a;
        }
        let last = column.len() - 1;
        let length = (column[last] * column[last] + below * below).sqrt();
        let (cosine, sine) = if length > 0.0 {
            (column[last] / length, below / length)
        } else {
            (1.0, 0.0)
        };
        column[last] = length;
        self.rotations.push((cosine, sine));
        self.upper.push(column);
        let residual = self.residual[last];
        self.residual[last] = cosine * residual;
        self.residual.push(-sine * residual);
        if below <= BREAKDOWN * scale {
            self.done = Some(self.upper.len());
        }
        (sine * residual).abs()
    }

    /// Coefficients of the solution in the space's vectors.
    fn coefficients(&self) -> Vec<f64> {
        let size = self.done.unwrap_or(self.upper.len());
        let mut y = vec![0.0; size];
        for row in (0..size).rev() {
            let rest: f64 = (row + 1..size).map(|k| self.upper[k][row] * y[k]).sum();
            let pivot = self.upper[row][row];
            // A pivot of 0 is a direction in the matrix's kernel: its coefficient is 0.
            y[row] = if pivot == 0.0 {
                0.0
            } else {
                (self.residual[row] - rest) / pivot
            };
        }
        y
    }
}

/// Moves `b` along the directions of a cycle; the correction, each column of length 1.
fn corrected(b: &mut Block, directions: &[&Block], spaces: &[Column], wants_correction: bool) -> Option<Block> {
    let coefficients: Vec<Vec<f64>> = spaces.iter().map(Column::coefficients).collect();
    let mut correction = wants_correction.then(|| Block::zeros(b.patches(), b.columns()));
    for (step, vector) in directions.iter().enumerate() {
        let factors: Vec<f64> = coefficients
            .iter()
            .map(|y| y.get(step).copied().unwrap_or(0.0))
            .collect();
        b.add_scaled(&factors, vector);
        if let Some(correction) = &mut correction {
            correction.add_scaled(&factors, vector);
        }
    }
    let mut correction = correction?;
    let lengths = correction.norms();
    correction.scale(&inverse(&lengths));
    lengths.iter().all(|&length| length > 0.0).then_some(correction)
}

/// 1 / n; 0 for 0.
fn inverse(norms: &[f64]) -> Vec<f64> {
    norms.iter().map(|&n| if n > 0.0 { 1.0 / n } else { 0.0 }).collect()
}

/// The direction of a step: the newest vector of the basis, or, in the last steps of a cycle, a former correction.
fn direction<'a>(basis: &'a [Block], corrections: &'a [Block], step: usize, restart: u32) -> &'a Block {
    let last = (restart as usize).saturating_sub(corrections.len());
    match step.checked_sub(last.max(1)) {
        Some(place) => &corrections[place],
        None => &basis[step],
    }
}

/// From `b` until the residual is within the tolerance.
pub(super) fn gmres(work: &mut Work<'_>, mut b: Block, restart: u32) -> Result<Block, SolveError> {
    let columns = work.columns();
    let ones = vec![1.0; columns];
    // Corrections of the last cycles, the newest last.
    let mut corrections: Vec<Block> = Vec::new();
    while !work.is_out_of_iterations() {
        // r = E + R H + R F b − b
        let product = work.product(&b)?;
        let mut residual = work.reflect(product);
        residual.add_scaled(&ones, &work.source);
        residual.add_scaled(&vec![-1.0; columns], &b);
        let norms = residual.norms();
        let relative = work.relative(norms.clone());
        if work.tell(&relative)? {
            break;
        }
        residual.scale(&inverse(&norms));
        let mut basis = vec![residual];
        let mut spaces: Vec<Column> = norms.iter().map(|&norm| Column::new(norm)).collect();
        let mut finished = false;
        for step in 0..restart as usize {
            if work.is_out_of_iterations() || spaces.iter().all(|space| space.done.is_some()) {
                break;
            }
            // w = (I − R F) v
            let direction = direction(&basis, &corrections, step, restart);
            let product = work.product(direction)?;
            let mut next = work.reflect(product);
            next.scale(&vec![-1.0; columns]);
            next.add_scaled(&ones, direction);
            let lengths = next.norms();
            let mut hessenberg = vec![Vec::with_capacity(step + 1); columns];
            for vector in &basis {
                let along = next.dot(vector);
                next.add_scaled(&along.iter().map(|a| -a).collect::<Vec<_>>(), vector);
                for (column, a) in hessenberg.iter_mut().zip(along) {
                    column.push(a);
                }
            }
            let below = next.norms();
            let mut left = Vec::with_capacity(columns);
            let mut keep = inverse(&below);
            for (c, (space, column)) in spaces.iter_mut().zip(hessenberg).enumerate() {
                let norm = match space.done {
                    Some(size) => space.residual.get(size).copied().unwrap_or(0.0).abs(),
                    None => space.push(column, below[c], lengths[c]),
                };
                if space.done.is_some() {
                    // Nothing but rounding is left to go on with.
                    keep[c] = 0.0;
                }
                left.push(norm);
            }
            next.scale(&keep);
            basis.push(next);
            let relative = work.relative(left);
            if work.tell(&relative)? {
                finished = true;
                break;
            }
        }
        let directions: Vec<&Block> = (0..basis.len().min(restart as usize))
            .map(|step| direction(&basis, &corrections, step, restart))
            .collect();
        let correction = corrected(&mut b, &directions, &spaces, work.corrections_kept > 0);
        corrections.extend(correction);
        if corrections.len() > work.corrections_kept {
            corrections.remove(0);
        }
        if finished {
            break;
        }
    }
    Ok(b)
}
