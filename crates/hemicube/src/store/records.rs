//! Plain records of a manifest: what was done to a matrix that was made of another.

use serde::{Deserialize, Serialize};

/// Residuals of a matrix: closure and reciprocity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Residuals {
    /// Largest closure error of a row.
    pub closure_max: f64,
    /// Root mean square of the rows' closure errors.
    pub closure_rms: f64,
    /// Rows that these are over: those that were rendered.
    pub closure_rows: u64,
    /// ‖A F − (A F)ᵀ‖ / ‖A F‖ over the pairs of rows that are there.
    pub reciprocity: f64,
    /// The largest |Aᵢ Fᵢⱼ − Aⱼ Fⱼᵢ| / min(Aᵢ, Aⱼ): by how much the smaller patch's form factor is off its counterpart.
    pub reciprocity_worst: f64,
}

/// The matrix that another was made from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BalanceSource {
    /// [`Manifest::settings_hash`](super::Manifest::settings_hash) of it.
    pub settings_hash: String,
    /// BLAKE3 of its whole manifest, in hexadecimal; by the parts' checksums in it, of every bit of the matrix.
    pub manifest_blake3: String,
    /// What its form factors are made of.
    pub correction: String,
}

/// What was done to a matrix; in its manifest, so that nobody takes it for one as it was computed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BalanceEntry {
    /// True if rows were made to sum to what their hemicubes did not lose.
    pub closure: bool,
    /// True if Aᵢ Fᵢⱼ and Aⱼ Fⱼᵢ were made equal.
    pub reciprocity: bool,
    /// Below what form factors were left out.
    pub min_factor: f64,
    /// By how much a row could be scaled.
    pub max_scale: f64,
    /// What the sweeps were to reach.
    pub tolerance: f64,
    /// Number of sweeps at most.
    pub max_sweeps: u32,
    /// What was balanced.
    pub source: BalanceSource,
    /// Sweeps of the scaling.
    pub sweeps: u32,
    /// True if they reached the tolerance, but for the rows that are counted below.
    pub converged: bool,
    /// Rows that cannot be scaled to their sum because they have no entries.
    pub rows_empty: u64,
    /// Rows that are to sum to nothing and have entries, because other patches see theirs.
    pub rows_without_target: u64,
    /// Rows for which no scaling within the bounds gives the sum: they see too few others, or others that see too
    /// little.
    pub rows_at_bound: u64,
    /// The largest closure error of the rows that none of these three counts.
    pub closure_max_of_others: f64,
    /// Rows that kept entries below the least factor because they would have lost nearly everything.
    pub rows_kept_whole: u64,
    /// The least of 1 and the factors that entries were multiplied by, after symmetrising.
    pub scale_min: f64,
    /// The largest of 1 and these.
    pub scale_max: f64,
    /// Pairs of patches that either sees.
    pub pairs: u64,
    /// Those of them that only one of the two rows had. Only counted where reciprocity was asked for.
    pub pairs_one_sided: u64,
    /// Entries before.
    pub entries_before: u64,
    /// Entries after.
    pub entries_after: u64,
    /// Entries that were below the least factor and left out.
    pub entries_dropped: u64,
    /// What they carried, Σ Aᵢ Fᵢⱼ, as a share of what all did; the others carry it now.
    pub mass_dropped: f64,
    /// Residuals of closure and reciprocity.
    pub before: Residuals,
    /// Progress by now.
    pub after: Residuals,
}
