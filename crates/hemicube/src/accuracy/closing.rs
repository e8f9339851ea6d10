//! The closing of a row: what its view ends on is 1 together, so what it lacks is made up where it is uncertain.
//!
//! ```text
//! value ← clip(value + μ · variance, 0, ceiling),   μ such that Σ value changes by what is lacking
//! ```
//!
//! Rows seen directly close so (`refine/sums`), and what comes through portals (`portal::extend`).

/// Halvings by which μ is found.
const HALVINGS: usize = 100;

/// Difference of a row's sum from what it is known to be.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lacking {
    /// Negative if the row has too much.
    pub(crate) sum: f64,
    /// Standard error of `sum`.
    pub(crate) error: f64,
}

impl Lacking {
    /// The square of what is lacking less what noise explains: the variance of a row whose errors have one cause.
    pub(crate) fn common(self) -> f64 {
        (self.sum * self.sum - self.error * self.error).max(0.0)
    }
}

/// A share of a view that may be off.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Uncertain {
    pub(crate) value: f64,
    /// The most that it can be: a patch's unoccluded form factor.
    pub(crate) ceiling: f64,
    pub(crate) variance: f64,
}

impl Uncertain {
    /// The value moved by so many of its variances, by `most` standard errors and from 0 to its ceiling.
    fn moved(self, by: f64, most: f64) -> f64 {
        if self.variance <= 0.0 {
            return self.value;
        }
        let most = most * self.variance.sqrt();
        (self.value + (by * self.variance).clamp(-most, most)).clamp(0.0, self.ceiling)
    }
}

/// Moves all shares by the same number μ of their variances, so that their sum changes by its expectation
/// `lacking.sum` · V / (V + e²), V = Σ variance and e = `lacking.error`: the most probable row of that sum.
///
/// Errors of one row may have one cause, a centroid that stands badly for its patch. The most likely factor on V, at
/// least 1, is what the sum lacks less what noise explains, over V. None moves by more than `most` standard errors.
pub(crate) fn project(shares: &mut [Uncertain], lacking: Lacking, most: f64) {
    let own: f64 = shares.iter().map(|share| share.variance).sum();
    if own <= 0.0 {
        return;
    }
    let noise = lacking.error * lacking.error;
    let own_or_more = own.max(lacking.common());
    let wanted = lacking.sum * own_or_more / (own_or_more + noise);
    let gained = |by: f64| -> f64 { shares.iter().map(|share| share.moved(by, most) - share.value).sum() };
    // Beyond this, all are at their bounds.
    let end = shares
        .iter()
        .filter(|share| share.variance > 0.0)
        .map(|share| (most / share.variance.sqrt()).min(share.ceiling / share.variance))
        .fold(0.0, f64::max);
    let (mut low, mut high) = if wanted < 0.0 { (-end, 0.0) } else { (0.0, end) };
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if gained(middle) < wanted {
            low = middle;
        } else {
            high = middle;
        }
    }
    let by = 0.5 * (low + high);
    for share in shares {
        share.value = share.moved(by, most);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::ERRORS;

    fn shares(of: &[(f64, f64, f64)]) -> Vec<Uncertain> {
        of.iter()
            .map(|&(value, ceiling, error)| Uncertain {
                value,
                ceiling,
                variance: error * error,
            })
            .collect()
    }

    fn lacking(sum: f64, error: f64) -> Lacking {
        Lacking { sum, error }
    }

    fn sum(of: &[Uncertain]) -> f64 {
        of.iter().map(|share| share.value).sum()
    }

    #[test]
    fn what_is_uncertain_takes_the_difference_and_what_is_exact_stays() {
        let mut row = shares(&[(0.5, 0.5, 0.0), (0.2, 0.3, 0.02), (0.1, 0.3, 0.01)]);
        project(&mut row, lacking(0.03, 0.0), ERRORS);
        assert_eq!(row[0].value, 0.5);
        assert!(
            (row[1].value - 0.224).abs() < 1e-9 && (row[2].value - 0.106).abs() < 1e-9,
            "{row:?}"
        );
        // As uncertain as they are together, a known sum is believed half.
        let mut row = shares(&[(0.2, 0.3, 0.03), (0.1, 0.3, 0.04)]);
        project(&mut row, lacking(-0.04, 0.05), ERRORS);
        assert!((sum(&row) - 0.28).abs() < 1e-9, "{row:?}");
        // What lacks far more than all their errors says that these have one cause.
        let mut row = shares(&[(0.2, 0.3, 1e-3), (0.1, 0.3, 1e-3)]);
        project(&mut row, lacking(-0.1, 0.01), ERRORS);
        assert!((sum(&row) - 0.294).abs() < 1e-9, "three standard errors each: {row:?}");
    }

    #[test]
    fn none_moves_by_more_than_three_errors_or_beyond_what_it_can_be() {
        let mut row = shares(&[(0.2, 0.3, 0.01), (0.299, 0.3, 0.01), (0.001, 0.3, 0.01)]);
        project(&mut row, lacking(0.05, 0.0), ERRORS);
        assert!(row[1].value == 0.3 && (sum(&row) - 0.55).abs() < 1e-9, "{row:?}");
        let before = sum(&row);
        project(&mut row, lacking(-5.0, 0.0), ERRORS);
        assert!(
            (before - sum(&row) - 0.085).abs() < 1e-3 && row[2].value >= 0.0,
            "{row:?}"
        );
        let mut exact = shares(&[(0.2, 0.3, 0.0)]);
        project(&mut exact, lacking(0.1, 0.0), ERRORS);
        assert_eq!(exact[0].value, 0.2);
    }
}
