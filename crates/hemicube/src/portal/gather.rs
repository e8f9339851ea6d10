//! Arrivals of rays through portals at a row's columns.

use super::motion::MotionId;
use super::trace::{Arrival, Ray, Tally};
use std::collections::HashMap;

/// The place of a patch in the matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Column {
    /// It has a column.
    Of,
    /// It has none.
    None,
    /// It is a curtain: its weight was cut off.
    CutOff,
}

/// Weight that arrived at a patch under a motion.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Found {
    pub(super) weight: u64,
    /// The part handed on.
    pub(super) passed: u64,
    pub(super) hits: u32,
}

/// The weights of a row after its first portals: `sent` = `kept` + `escaped` + `blocked` + `unselected` + `cut_off`.
#[derive(Debug, Default)]
pub(super) struct Ledger {
    /// Handed on by the first surfaces of rays.
    pub(super) sent: u64,
    /// Kept by patches with columns.
    pub(super) kept: u64,
    pub(super) escaped: u64,
    /// The part of `escaped` below the horizon, where that is told apart.
    pub(super) ground: u64,
    pub(super) blocked: u64,
    pub(super) unselected: u64,
    pub(super) cut_off: u64,
    pub(super) entries: HashMap<(MotionId, u32), Found>,
    /// Weight of first arrivals, and the part handed on, of patches where that depends on the angle.
    pub(super) first: HashMap<u32, [u64; 2]>,
}

impl Ledger {
    pub(super) fn clear(&mut self) {
        let mut entries = std::mem::take(&mut self.entries);
        entries.clear();
        let mut first = std::mem::take(&mut self.first);
        first.clear();
        *self = Self {
            entries,
            first,
            ..Self::default()
        };
    }

    /// The ends of `sent`: kept, escaped, blocked, unselected, cut off.
    pub(super) fn ends(&self) -> [u64; 5] {
        [self.kept, self.escaped, self.blocked, self.unselected, self.cut_off]
    }

    /// The entries, by descending weight, then by motion and patch.
    pub(super) fn sorted(&self) -> Vec<((MotionId, u32), Found)> {
        let mut entries: Vec<_> = self.entries.iter().map(|(&key, &found)| (key, found)).collect();
        entries.sort_unstable_by(|(a, p), (b, q)| q.weight.cmp(&p.weight).then(a.cmp(b)));
        entries
    }
}

/// Enters rays into a ledger.
pub(super) struct Gather<'a, C> {
    pub(super) ledger: &'a mut Ledger,
    pub(super) column: C,
}

impl<C: Fn(u32) -> Column> Tally for Gather<'_, C> {
    fn arrive(&mut self, ray: &Ray, arrival: &Arrival) {
        let ledger = &mut *self.ledger;
        if ray.passes == 0 {
            ledger.sent += arrival.passed;
            if let (true, Some(patch)) = (arrival.varies, arrival.patch) {
                let [met, passed] = ledger.first.entry(patch).or_default();
                *met += ray.weight;
                *passed += arrival.passed;
            }
            return;
        }
        let kept = ray.weight - arrival.passed;
        match arrival.patch.map(|patch| (patch, (self.column)(patch))) {
            None => ledger.blocked += kept,
            Some((_, Column::None)) => ledger.unselected += kept,
            Some((_, Column::CutOff)) => ledger.cut_off += kept,
            Some((patch, Column::Of)) => {
                ledger.kept += kept;
                let found = ledger.entries.entry((ray.motion, patch)).or_default();
                found.weight += ray.weight;
                found.passed += arrival.passed;
                found.hits = found.hits.saturating_add(1);
            }
        }
    }

    fn escape(&mut self, ray: &Ray) {
        if ray.passes > 0 {
            self.ledger.escaped += ray.weight;
        }
    }

    fn cut(&mut self, _ray: &Ray, weight: u64) {
        self.ledger.cut_off += weight;
    }
}

/// Divides `whole` in proportion to `parts`, exactly: the largest remainders get what rounding left. All goes to the
/// last if all parts are 0.
pub(super) fn apportion<const N: usize>(whole: u64, parts: [u64; N]) -> [u64; N] {
    let sum: u128 = parts.iter().map(|&part| u128::from(part)).sum();
    let mut shares = [0; N];
    if sum == 0 {
        if let Some(last) = shares.last_mut() {
            *last = whole;
        }
        return shares;
    }
    let mut remainders = [(0u128, 0usize); N];
    for (place, &part) in parts.iter().enumerate() {
        let product = u128::from(whole) * u128::from(part);
        shares[place] = u64::try_from(product / sum).unwrap_or(u64::MAX);
        remainders[place] = (product % sum, place);
    }
    let left = whole - shares.iter().sum::<u64>();
    remainders.sort_unstable_by(|(a, p), (b, q)| b.cmp(a).then(p.cmp(q)));
    for &(_, place) in remainders.iter().take(usize::try_from(left).unwrap_or(N)) {
        shares[place] += 1;
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_lost_in_division() {
        assert_eq!(apportion(10, [1, 1, 1]), [4, 3, 3]);
        assert_eq!(apportion(7, [0, 0, 0]), [0, 0, 7]);
        assert_eq!(apportion(0, [3, 1]), [0, 0]);
        for whole in [1, 2, 1 << 31, (1 << 31) - 1] {
            let parts = [1 << 60, 12_345, 0, 77, 1 << 59];
            let shares = apportion(whole, parts);
            assert_eq!(shares.iter().sum::<u64>(), whole);
            assert_eq!(shares[2], 0);
        }
    }
}
