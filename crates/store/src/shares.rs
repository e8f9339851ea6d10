//! Shares of a patch's view that are no form factors: *escaped*, *blocked* and *unselected*, refined with the form
//! factors.
//!
//! Hemicubes measure all four from a point. Corrections make form factors of the whole emitter, by closed forms and
//! rays. The four then miss 1 by the *residual*
//!
//! ```text
//! r = 1 − Σ F − E − B − U          E, B, U: the hemicubes' shares
//! ```
//!
//! The residual is the hemicubes' error: they stand at one point, or a few, and F is of the whole patch. It is
//! distributed over the three in proportion to wₓ = X (1 − X), the variance of a quantity of 0 or 1 estimated from one
//! point. No share falls below 0 or rises by more than the root of that variance, and a share of 0 stays 0. The rest
//! that such bounds leave goes to the other shares; a rest that none can take is the form factors' own error.
//!
//! A residual above the expected error of the form factors, where backs or unselected patches may have a part in it,
//! has the hemicubes' shares replaced by rays' from all over the patch (`accuracy/lost.rs`). These are refined by three
//! times their own error at most, or, where the row would still be off by more than is permitted, by all of it. Where
//! each pair of the row was measured by itself, form factors keep no more than three times their expected error: what
//! is beyond it is the rays'.

use crate::{HEMICUBE_WEIGHT, RowSums};

/// Shares of a patch's view that go to no column, each from 0 to 1; NaN for a row without hemicubes.
///
/// ```
/// use hemicube_store::{HEMICUBE_WEIGHT, RowShares, RowSums};
///
/// // A hemicube from the middle of a patch loses half to the sky; of the whole patch, form factors sum to 0.45.
/// let half = HEMICUBE_WEIGHT / 2;
/// let sums = RowSums { visible: half, escaped: half, ..RowSums::default() };
/// let shares = RowShares::of_hemicubes(&sums, 1);
/// assert_eq!((shares.escaped, shares.refined(0.45, f64::NAN).escaped), (0.5, 0.55));
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct RowShares {
    /// To nothing: out of the scene.
    pub escaped: f64,
    /// To the backs of one-sided patches.
    pub blocked: f64,
    /// To patches without a column.
    pub unselected: f64,
}

impl PartialEq for RowShares {
    /// Bit by bit: NaN equals itself.
    fn eq(&self, other: &Self) -> bool {
        self.to_array().map(f64::to_bits) == other.to_array().map(f64::to_bits)
    }
}

/// The least 1 − X in a share's weight, one unit of a hemicube's weight: a share of nearly 1 can still fall.
const RESOLUTION: f64 = 1.0 / HEMICUBE_WEIGHT as f64;

/// Expected error of a row's sum at accuracy levels that do not estimate it.
const OWN_ERROR: f64 = 0.01;

/// By how many times its expected error a sum of form factors can be off.
pub const ERRORS: f64 = 3.0;

impl RowShares {
    /// Shares of a row without hemicubes.
    pub const UNKNOWN: Self = Self::from_array([f64::NAN; 3]);

    /// Shares by the weights of a row's hemicubes.
    pub fn of_hemicubes(sums: &RowSums, hemicubes: u32) -> Self {
        if hemicubes == 0 {
            return Self::UNKNOWN;
        }
        let whole = (u64::from(hemicubes) * HEMICUBE_WEIGHT) as f64;
        Self::from_array([sums.escaped, sums.blocked, sums.unselected].map(|weight| weight as f64 / whole))
    }

    /// These shares with the residual distributed over them. `factors` is the sum of the form factors, and `error` its
    /// expected error; NaN: 1 %.
    #[must_use]
    pub fn refined(self, factors: f64, error: f64) -> Self {
        let residual = 1.0 - factors - self.lost();
        let before = self.to_array();
        let likely = before.map(|share| (share + (share * (1.0 - share)).max(0.0).sqrt()).min(1.0));
        let (shares, left) = self.deal(before, residual, likely);
        let own = if error.is_nan() { OWN_ERROR } else { ERRORS * error };
        let shares = if left.abs() > own {
            self.deal(shares, left, [1.0; 3]).0
        } else {
            shares
        };
        Self::from_array(shares)
    }

    /// [`Self::refined`] for shares measured by rays. They take the residual where it is `permitted`. Of a larger one,
    /// which is the form factors' own, they take what exceeds `permitted`: pairs were looked for before, and uncertain
    /// ones moved. Rays that are known to be lost divide as those that were: each share takes its part of their sum.
    #[doc(hidden)]
    pub fn refined_within(self, factors: f64, permitted: f64) -> Self {
        let lost = self.lost();
        let residual = 1.0 - factors - lost;
        let taken = if residual.abs() <= permitted {
            residual
        } else {
            residual - permitted.copysign(residual)
        };
        let scale = if lost > 0.0 { (1.0 + taken / lost).max(0.0) } else { 1.0 };
        Self::from_array(self.to_array().map(|share| share * scale))
    }

    /// Distributes `residual` over `shares`, none of which may exceed its `most`. Returns the new shares and the rest.
    fn deal(self, mut shares: [f64; 3], mut residual: f64, most: [f64; 3]) -> ([f64; 3], f64) {
        let mut weights = self.to_array().map(|share| share * (1.0 - share).max(RESOLUTION));
        // Each round but the last exhausts a share.
        for _ in 0..shares.len() {
            let whole: f64 = weights.iter().sum();
            // No residual, no share to take it, or unknown shares.
            if residual == 0.0 || whole.is_nan() || whole <= 0.0 {
                break;
            }
            let round = residual;
            let mut is_bound = false;
            for ((share, most), weight) in shares.iter_mut().zip(most).zip(&mut weights) {
                let wanted = *share + round * *weight / whole;
                let within = wanted.clamp(0.0, most);
                residual -= within - *share;
                *share = within;
                if within != wanted {
                    *weight = 0.0;
                    is_bound = true;
                }
            }
            if !is_bound {
                break;
            }
        }
        (shares, residual)
    }

    /// All three together.
    pub fn lost(self) -> f64 {
        self.escaped + self.blocked + self.unselected
    }

    /// Escaped, blocked, unselected: the order in files.
    pub fn to_array(self) -> [f64; 3] {
        [self.escaped, self.blocked, self.unselected]
    }

    /// The inverse of [`Self::to_array`].
    pub const fn from_array([escaped, blocked, unselected]: [f64; 3]) -> Self {
        Self {
            escaped,
            blocked,
            unselected,
        }
    }

    /// Returns whether they can be those of a row: from 0 to 1, or NaN without a hemicube.
    pub(crate) fn fit(self, hemicubes: u32) -> bool {
        let fits = |share: &f64| {
            if hemicubes == 0 {
                share.is_nan()
            } else {
                (0.0..=1.0).contains(share)
            }
        };
        self.to_array().iter().all(fits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shares(escaped: f64, blocked: f64, unselected: f64) -> RowShares {
        RowShares::from_array([escaped, blocked, unselected])
    }

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-15
    }

    #[test]
    fn shares_are_weights_over_all_hemicubes() {
        let sums = RowSums {
            visible: HEMICUBE_WEIGHT,
            escaped: HEMICUBE_WEIGHT / 2,
            blocked: HEMICUBE_WEIGHT / 4,
            unselected: HEMICUBE_WEIGHT / 4,
        };
        assert_eq!(RowShares::of_hemicubes(&sums, 2), shares(0.25, 0.125, 0.125));
        assert_eq!(RowShares::of_hemicubes(&RowSums::default(), 0), RowShares::UNKNOWN);
    }

    #[test]
    fn the_residual_goes_where_one_point_knows_least() {
        // Variances 0.25 · 0.75 and 0.05 · 0.95: four fifths, nearly, to what escapes.
        let (before, sum) = (shares(0.25, 0.05, 0.0), 0.6);
        let after = before.refined(sum, f64::NAN);
        let (of_escaped, of_blocked) = (0.25 * 0.75, 0.05 * 0.95);
        assert!(near(after.escaped, 0.25 + 0.1 * of_escaped / (of_escaped + of_blocked)));
        assert!(near(after.lost() + sum, 1.0));
        assert_eq!(after.unselected, 0.0, "what is 0 stays 0");
    }

    #[test]
    fn what_is_exhausted_leaves_the_rest_to_the_others() {
        let after = shares(0.5, 1e-6, 0.2).refined(0.6, f64::NAN);
        assert!(after.to_array().iter().all(|share| *share >= 0.0));
        assert!(near(after.lost(), 0.4));
        let after = shares(0.01, 0.6, 0.0).refined(0.9, f64::NAN);
        assert!(after.escaped >= 0.0 && near(after.lost(), 0.1), "{after:?}");
        // More than there is: all of it goes, and the row is over by the rest.
        assert_eq!(shares(0.1, 0.1, 0.0).refined(1.05, f64::NAN), shares(0.0, 0.0, 0.0));
    }

    #[test]
    fn what_one_point_knows_for_certain_moves_only_if_nothing_else_can() {
        assert!(
            near(shares(1.0, 0.0, 0.0).refined(0.1, f64::NAN).escaped, 0.9),
            "rays found more"
        );
        assert_eq!(
            shares(0.0, 0.0, 0.0).refined(0.97, f64::NAN),
            shares(0.0, 0.0, 0.0),
            "closed"
        );
        // A leak of 10⁻⁹ does not explain 3 ‰: the form factors are off.
        let leak = shares(1e-9, 0.0, 0.0).refined(0.997, f64::NAN);
        assert!(leak.escaped < 5e-5, "{leak:?}");
        // Nor a foot's view of the sky a tenth; but nothing else can, either.
        let foot = shares(1e-5, 0.0, 0.0);
        assert!(near(foot.refined(0.9, f64::NAN).escaped, 0.1) && near(foot.refined(0.9, 0.01).escaped, 0.1));
        assert!(
            foot.refined(0.9, 0.04).escaped < 4e-3,
            "form factors that may be off by a tenth"
        );
    }

    #[test]
    fn what_is_not_known_stays_so() {
        assert_eq!(RowShares::UNKNOWN.refined(0.5, f64::NAN), RowShares::UNKNOWN);
        assert!(RowShares::UNKNOWN.fit(0) && !RowShares::UNKNOWN.fit(1));
        assert!(shares(0.1, 0.0, 0.0).fit(1) && !shares(1.1, 0.0, 0.0).fit(1));
    }

    #[test]
    fn measured_shares_take_what_is_permitted_and_leave_that_of_what_is_not() {
        let before = shares(0.2, 0.1, 0.0);
        let near_by = before.refined_within(0.71, 0.1);
        assert!(near(near_by.lost(), 0.29), "{near_by:?}");
        // The form factors are 0.1 short, of which a row may keep 0.02.
        let far_off = before.refined_within(0.6, 0.02);
        assert!(near(far_off.lost(), 0.38), "{far_off:?}");
        let too_much = before.refined_within(0.75, 0.02);
        assert!(near(too_much.lost(), 0.27), "{too_much:?}");
    }
}
