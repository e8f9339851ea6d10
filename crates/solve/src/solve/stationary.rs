//! Jacobi's and Gauss–Seidel's iterations.

use super::factors::{in_order, row_product};
use super::pairs::Sweeps;
use super::{Block, SolveError, Work};

/// From `b` until the residual is within the tolerance.
pub(super) fn jacobi(work: &mut Work<'_>, mut b: Block) -> Result<Block, SolveError> {
    let minus = vec![-1.0; work.columns()];
    while !work.is_out_of_iterations() {
        let product = work.product(&b)?;
        let mut next = work.reflect(product);
        next.add_scaled(&vec![1.0; work.columns()], &work.source);
        // The change of a step is the residual of its start.
        for patch in 0..next.patches() {
            for (column, value) in next.of_mut(patch).iter_mut().enumerate() {
                *value = work.problem.step(patch, column, b.of(patch)[column], *value);
            }
        }
        let mut change = next.clone();
        change.add_scaled(&minus, &b);
        b = next;
        let relative = work.relative(change.norms());
        if work.tell(&relative)? {
            break;
        }
    }
    Ok(b)
}

/// Gauss–Seidel: each row takes the newest values. The change of a sweep bounds the residual after it: a row's residual
/// is R F times the changes later in the sweep.
pub(super) fn gauss_seidel(work: &mut Work<'_>, mut b: Block) -> Result<Block, SolveError> {
    let columns = work.columns();
    let mut sums = vec![0.0; columns];
    let mut changes = vec![0.0; columns];
    let mut pairs = match work.factors.weights() {
        Some(weights) => {
            // Reads the matrix as a product does.
            work.iterations += 1;
            Some(Sweeps::new(work.factors, weights, &b)?)
        }
        None => None,
    };
    while !work.is_out_of_iterations() {
        let mut squares = vec![0.0; columns];
        let (problem, source) = (work.problem, &work.source);
        in_order(work.factors, |part| {
            for (row, &patch) in part.rows.iter().enumerate() {
                let (indices, data) = part.row(row);
                let patch = patch as usize;
                match &pairs {
                    Some(pairs) => pairs.product(patch, (indices, data), &b, &mut sums),
                    None => row_product(indices, data, &b, &mut sums),
                }
                let source = source.of(patch);
                for (column, value) in b.of_mut(patch).iter_mut().enumerate() {
                    let arriving = sums[column] + problem.back(patch) * *value;
                    let new = source[column] + problem.rho(patch, column) * arriving;
                    let new = problem.step(patch, column, *value, new);
                    changes[column] = new - *value;
                    squares[column] += changes[column] * changes[column];
                    *value = new;
                }
                if let Some(pairs) = &mut pairs {
                    pairs.changed(patch, (indices, data), &changes);
                }
            }
        })?;
        work.iterations += 1;
        let relative = work.relative(squares.into_iter().map(f64::sqrt).collect());
        if work.tell(&relative)? {
            break;
        }
    }
    Ok(b)
}
