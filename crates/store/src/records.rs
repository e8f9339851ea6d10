//! Plain records of a manifest: changes of a matrix made from another.

use serde::{Deserialize, Serialize};

/// Residuals of a matrix: closure and reciprocity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Residuals {
    /// Largest closure error of a row.
    pub closure_max: f64,
    /// Root mean square of the rows' closure errors.
    pub closure_rms: f64,
    /// Number of rows compared: those rendered.
    pub closure_rows: u64,
    /// ‖A F − (A F)ᵀ‖ / ‖A F‖ over the pairs of present rows.
    pub reciprocity: f64,
    /// The largest |Aᵢ Fᵢⱼ − Aⱼ Fⱼᵢ| / min(Aᵢ, Aⱼ): by how much the smaller patch's form factor is off its counterpart.
    pub reciprocity_worst: f64,
}

/// The matrix that this one was made from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BalanceSource {
    /// [`Manifest::settings_hash`](super::Manifest::settings_hash) of it.
    pub settings_hash: String,
    /// BLAKE3 of its whole manifest, in hexadecimal; by the parts' checksums in it, of every bit of the matrix.
    pub manifest_blake3: String,
    /// Name of its correction.
    pub correction: String,
}

/// Balancing of a matrix. In the manifest, so that nobody takes it for the matrix computed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BalanceEntry {
    /// True if rows were scaled to closure.
    pub closure: bool,
    /// True if Aᵢ Fᵢⱼ and Aⱼ Fⱼᵢ were made equal.
    pub reciprocity: bool,
    /// Smaller form factors were left out.
    pub min_factor: f64,
    /// By how much a row could be scaled.
    pub max_scale: f64,
    /// Tolerance of the sweeps.
    pub tolerance: f64,
    /// Number of sweeps at most.
    pub max_sweeps: u32,
    /// The matrix balanced.
    pub source: BalanceSource,
    /// Sweeps of the scaling.
    pub sweeps: u32,
    /// True if the sweeps reached the tolerance, except for the rows counted below.
    pub converged: bool,
    /// Rows without entries, which cannot be scaled to their sum.
    pub rows_empty: u64,
    /// Rows with the sum 0 that have entries, because other patches see theirs.
    pub rows_without_target: u64,
    /// Rows without a scaling within the bounds: they see too few others, or others that see too little.
    pub rows_at_bound: u64,
    /// Largest closure error of the rows counted by none of these three.
    pub closure_max_of_others: f64,
    /// Rows that kept entries below the least factor because they would have lost nearly everything.
    pub rows_kept_whole: u64,
    /// The least scaling factor of an entry after symmetrising, at most 1.
    pub scale_min: f64,
    /// The largest of 1 and these.
    pub scale_max: f64,
    /// Pairs of patches seen by either.
    pub pairs: u64,
    /// Pairs in one of the two rows only. Counted only where reciprocity was asked for.
    pub pairs_one_sided: u64,
    /// Entries before.
    pub entries_before: u64,
    /// Entries after.
    pub entries_after: u64,
    /// Entries left out, being below the least factor.
    pub entries_dropped: u64,
    /// Share of Σ Aᵢ Fᵢⱼ of the entries left out; the others of their rows have it now.
    pub mass_dropped: f64,
    /// Residuals of closure and reciprocity.
    pub before: Residuals,
    /// Progress by now.
    pub after: Residuals,
}
