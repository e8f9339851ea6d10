//! Matrices as maps, to hold against each other.

use hemicube::store::Store;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Form factors by row and column.
pub type Entries = BTreeMap<(u32, u32), f64>;

/// The form factors of a store's rows up to a patch, columns as `fold` names them; equal ones are added up.
///
/// # Panics
/// When it cannot be read.
pub fn entries(store: &Path, rows: std::ops::Range<u32>, fold: impl Fn(u32) -> u32) -> Entries {
    let store = Store::open(store).expect("a store");
    let mut found = Entries::new();
    for row in store.rows().expect("rows") {
        let (patch, row) = row.expect("readable");
        if rows.contains(&patch.0) {
            for (&column, factor) in row.indices.iter().zip(row.data.iter()) {
                *found.entry((patch.0, fold(column))).or_default() += factor;
            }
        }
    }
    found
}

/// The relative Frobenius distance of `one` from `other`.
pub fn apart(one: &Entries, other: &Entries) -> f64 {
    let keys: BTreeSet<_> = one.keys().chain(other.keys()).collect();
    let of = |map: &Entries, key| map.get(key).copied().unwrap_or(0.0);
    let squares: f64 = keys
        .into_iter()
        .map(|key| (of(one, key) - of(other, key)).powi(2))
        .sum();
    (squares / other.values().map(|value| value * value).sum::<f64>()).sqrt()
}
