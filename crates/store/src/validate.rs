//! Requirements on the arrays of a store, beyond fitting together. Writers refuse violations before a file is there,
//! readers before anything is made of it: no row, patch or column is handed out unchecked.

use super::csr::EncodedValues;
use super::{FactorSlice, Form, HEMICUBE_WEIGHT, Manifest, Part, PatchTable, RowSums, compact};
use crate::grouping::PatchKind;
use std::result::Result;

/// Form factors are below this, in either form. A fraction is 1 at most; errors of closed forms of patches that all but
/// touch stay far below the other 1.
pub(super) const FACTOR_END: f32 = 2.0;

/// Likewise where portals hand light on: what arrives at a mirror may have been there before. Beyond the most portals
/// that a path goes through.
pub(super) const PASSED_FACTOR_END: f32 = 65_536.0;

/// Most hemicubes of an element's row: 4096 by `--samples`, and 16 times as many for an inconsistent row.
pub(super) const HEMICUBES_MAX: u32 = 1 << 16;

/// By how much the square of a unit normal may be off 1.
const NORMAL_ERROR: f64 = 1e-6;

/// By how much fractions of one hemicube may sum to more than 1: rounding of three of them.
const FRACTION_ERROR: f64 = 1e-9;

/// Returns whether all are form factors: numbers from 0 to below `end`, [`FACTOR_END`] or [`PASSED_FACTOR_END`].
pub(super) fn are_factors(factors: FactorSlice<'_>, end: f32) -> bool {
    match factors {
        FactorSlice::Single(factors) => are_singles(factors.iter().copied(), end),
        FactorSlice::Double(factors) => are_doubles(factors.iter().copied(), end),
    }
}

fn are_singles(factors: impl Iterator<Item = f32> + Clone, end: f32) -> bool {
    // The two highest bits are the sign and 2, set in infinities and NaN too. Without a branch this takes a tenth of
    // the time of two comparisons each.
    let bits = factors.clone().fold(0, |bits, factor| bits | factor.to_bits());
    bits & 0xC000_0000 == 0 || factors.into_iter().all(|factor| is_factor(factor.into(), end))
}

fn are_doubles(factors: impl Iterator<Item = f64> + Clone, end: f32) -> bool {
    let bits = factors.clone().fold(0, |bits, factor| bits | factor.to_bits());
    bits >> 62 == 0 || factors.into_iter().all(|factor| is_factor(factor, end))
}

fn is_factor(factor: f64, end: f32) -> bool {
    (0.0..end.into()).contains(&factor)
}

/// Returns whether columns ascend, and are of a matrix of so many.
pub(super) fn are_columns(columns: &[i32], patch_count: u32) -> bool {
    let (Some(&first), Some(&last)) = (columns.first(), columns.last()) else {
        return true;
    };
    let mut ascends = true;
    for (before, after) in columns.iter().zip(&columns[1..]) {
        ascends &= before < after;
    }
    ascends && first >= 0 && last.cast_unsigned() < patch_count
}

/// Likewise for the bytes of a plain or double row, with its form factors.
pub(super) fn is_plain_row(columns: &[u8], values: EncodedValues<'_>, patch_count: u32, end: f32) -> bool {
    let columns = columns.as_chunks::<4>().0;
    let (Some(&first), Some(&last)) = (columns.first(), columns.last()) else {
        return true;
    };
    let mut ascends = true;
    for (&before, &after) in columns.iter().zip(&columns[1..]) {
        ascends &= i32::from_le_bytes(before) < i32::from_le_bytes(after);
    }
    ascends
        && i32::from_le_bytes(first) >= 0
        && i32::from_le_bytes(last).cast_unsigned() < patch_count
        && match values {
            EncodedValues::Single(values) => {
                are_singles(values.as_chunks().0.iter().map(|&value| f32::from_le_bytes(value)), end)
            }
            EncodedValues::Double(values) => {
                are_doubles(values.as_chunks().0.iter().map(|&value| f64::from_le_bytes(value)), end)
            }
        }
}

/// Origin of a part's entries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Entries {
    /// A caller: anything may be in them.
    Given,
    /// The file of a store. In the compact form, runs ascend and every code is a form factor: the last column of a row
    /// is all that can be wrong.
    Stored,
}

/// Checks a part of `row_count` rows against everything that readers of `manifest`'s store rely on. Returns the sums
/// over its rows.
///
/// # Errors
/// The first violation, as a clause about the part.
pub(super) fn part(part: &Part, row_count: usize, manifest: &Manifest, source: Entries) -> Result<RowSums, String> {
    let hemicubes_max = if manifest.patch_kind().is_triangle() {
        HEMICUBES_MAX
    } else {
        u32::MAX
    };
    let (patch_count, form, end) = (manifest.patch_count, manifest.form, manifest.factor_end());
    let passages = if manifest.has_portals() { row_count } else { 0 };
    if part.passages.len() != passages {
        return Err(format!("does not say of {passages} rows what portals did with them"));
    }
    let lengths = [
        part.rows.len(),
        part.sums.len(),
        part.shares.len(),
        part.hemicubes.len(),
        part.errors.len(),
        part.rays.len(),
        part.indptr.len().saturating_sub(1),
    ];
    if lengths.iter().any(|&length| length != row_count) {
        return Err(format!("does not have {row_count} rows"));
    }
    if part.data.precision() != form.precision() {
        return Err(format!("has form factors that are not of the form `{}`", form.name()));
    }
    if part.indices.len() != part.data.len()
        || part.indptr.first() != Some(&0)
        || part.indptr.last().copied() != i64::try_from(part.data.len()).ok()
        || !part.indptr.is_sorted()
    {
        return Err("has an `indptr` that does not divide its entries into rows".into());
    }
    let mut order: Vec<u32> = (0..).take(row_count).collect();
    order.sort_unstable_by_key(|&row| part.rows[row as usize]);
    let twice = order
        .windows(2)
        .find(|pair| part.rows[pair[0] as usize] == part.rows[pair[1] as usize])
        .map(|pair| part.rows[pair[0] as usize]);
    if let Some(patch) = twice.or_else(|| part.rows.iter().copied().find(|&patch| patch >= patch_count)) {
        return Err(no_row(patch));
    }
    let mut total = RowSums::default();
    let is_decoded = source == Entries::Stored && form == Form::Compact;
    for (row, &patch) in part.rows.iter().enumerate() {
        let (columns, factors) = part.row(row);
        let fit = if is_decoded {
            columns.last().is_none_or(|&last| last.cast_unsigned() < patch_count)
        } else {
            are_columns(columns, patch_count)
        };
        if !fit {
            return Err(format!(
                "has columns in the row of patch {patch} that do not ascend, or leave the matrix"
            ));
        }
        if !is_decoded {
            require_factors(factors, form, end).map_err(|reason| format!("{reason} in the row of patch {patch}"))?;
        }
        let (sums, hemicubes) = (&part.sums[row], part.hemicubes[row]);
        if hemicubes > hemicubes_max {
            return Err(format!(
                "has {hemicubes} hemicubes in the row of patch {patch}, where {hemicubes_max} are the most"
            ));
        }
        if sums.total() != Some(u64::from(hemicubes) * HEMICUBE_WEIGHT) {
            return Err(format!(
                "has weights in the row of patch {patch} that sum to {:?}, not to {hemicubes} hemicubes of \
                 {HEMICUBE_WEIGHT}",
                sums.total()
            ));
        }
        if !part.shares[row].fit(hemicubes) {
            return Err(format!(
                "has the shares {:?} in the row of patch {patch}",
                part.shares[row]
            ));
        }
        let is_error = |error: &f32| error.is_nan() || *error >= 0.0 && error.is_finite();
        if let Some(error) = part.errors[row].to_array().iter().find(|error| !is_error(error)) {
            return Err(format!("has the expected error {error} in the row of patch {patch}"));
        }
        if let Some(passage) = part.passages.get(row).filter(|passage| !passage.is_valid()) {
            return Err(format!("has {passage:?} in the row of patch {patch}"));
        }
        total = total.plus(sums).ok_or("has weights that do not fit 64 bits")?;
    }
    Ok(total)
}

/// Checks the form factors of a row.
///
/// # Errors
/// The first that is none, or that `form` cannot hold.
fn require_factors(factors: FactorSlice<'_>, form: Form, end: f32) -> Result<(), String> {
    if !are_factors(factors, end) {
        let bad = factors.iter().find(|&factor| !is_factor(factor, end));
        return Err(format!("has the form factor {}", bad.unwrap_or(f64::NAN)));
    }
    if form != Form::Compact {
        return Ok(());
    }
    let mut singles = factors.to_single().into_iter();
    singles
        .find(|&factor| {
            compact::code(factor).is_none() && (end <= FACTOR_END || compact::code(factor / compact::RAISED).is_none())
        })
        .map_or(Ok(()), |bad| {
            Err(format!(
                "has the form factor {bad}, which the compact form cannot hold,"
            ))
        })
}

/// Names a row of a patch that does not exist, or that has a row already.
pub(super) fn no_row(patch: u32) -> String {
    format!("has a row of patch {patch}, which does not exist or has a row already")
}

/// Checks the patches' names and geometry. Patches of several elements may have [`PatchTable::SEVERAL`] faces, objects
/// or materials, and no normal.
///
/// # Errors
/// The first violation, as a clause about the table.
pub(super) fn patches(table: &PatchTable, objects: usize, materials: usize, kind: PatchKind) -> Result<(), String> {
    let may_be_several = !kind.is_triangle();
    let beyond = |what: &str, numbers: &[u32], names: usize| {
        let is_beyond = |number| number as usize >= names && !(may_be_several && number == PatchTable::SEVERAL);
        let found = (0..).zip(numbers).find(|&(_, &number)| is_beyond(number));
        found.map_or(Ok(()), |(patch, number): (u32, _)| {
            Err(format!(
                "has patch {patch} of the {what} {number}, and the manifest names {names}"
            ))
        })
    };
    beyond("object", &table.object, objects)?;
    beyond("material", &table.material, materials)?;
    for (patch, &side) in table.side.iter().enumerate() {
        if side > 1 {
            return Err(format!(
                "has patch {patch} on the side {side}, which is neither 0 nor 1"
            ));
        }
    }
    for (patch, &area) in table.area.iter().enumerate() {
        if area == 0.0 {
            return Err(format!(
                "has patch {patch} without area, whose form factors are nothing; take it out of the scene and compute \
                 again"
            ));
        }
        if !(area > 0.0 && area.is_finite()) {
            return Err(format!(
                "has patch {patch} with the area {area}: it is damaged; compute the matrix again"
            ));
        }
    }
    for (patch, (centroid, normal)) in table.centroid.iter().zip(&table.normal).enumerate() {
        if !centroid.iter().all(|coordinate| coordinate.is_finite()) {
            return Err(format!("has patch {patch} with the centroid {centroid:?}"));
        }
        if let Some(corners) = table.corners.get(patch)
            && !corners.as_flattened().iter().all(|coordinate| coordinate.is_finite())
        {
            return Err(format!("has patch {patch} with the corners {corners:?}"));
        }
        let square: f64 = normal.iter().map(|component| component * component).sum();
        let off = (square - 1.0).abs();
        if may_be_several && square == 0.0 {
            continue;
        }
        if off > NORMAL_ERROR || off.is_nan() {
            return Err(format!(
                "has patch {patch} with the normal {normal:?}, which is no unit vector"
            ));
        }
    }
    Ok(())
}

/// Checks a column of the row table against its range; NaN is unknown.
///
/// # Errors
/// The first value out of range, as a clause about the table.
pub(super) fn column(name: &str, values: &[f64], most: f64) -> Result<(), String> {
    let is_sound = |value: f64| value.is_nan() || value >= 0.0 && value <= most && value.is_finite();
    match (0..).zip(values).find(|&(_, &value)| !is_sound(value)) {
        None => Ok(()),
        Some((patch, value)) => {
            let patch: u64 = patch;
            Err(format!("has `{name}` of {value} for patch {patch}"))
        }
    }
}

/// Holds the fractions of each row's hemicubes against the whole.
///
/// # Errors
/// The first row that lost more than 1.
pub(super) fn fractions(columns: &[&[f64]]) -> Result<(), String> {
    let count = columns.first().map_or(0, |column| column.len());
    for patch in 0..count {
        let sum: f64 = columns.iter().filter_map(|column| column.get(patch)).sum();
        if sum > 1.0 + FRACTION_ERROR {
            return Err(format!("has patch {patch} that lost {sum} of its view"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_told_from_what_is_none() {
        let all = |factors: &[f32]| are_factors(FactorSlice::Single(factors), FACTOR_END);
        assert!(all(&[]) && all(&[0.0, 1.0, 1.999, f32::MIN_POSITIVE, 1e-45]) && all(&[0.5, -0.0]));
        for bad in [2.0, -1e-45, -1.0, f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(!all(&[bad]) && !all(&[0.5, bad, 0.25]), "{bad}");
            let doubles = [0.5, f64::from(bad), 1e-300];
            assert!(!are_factors(FactorSlice::Double(&doubles), FACTOR_END), "{bad}");
            assert!(are_factors(FactorSlice::Double(&doubles[2..]), FACTOR_END));
        }
    }

    #[test]
    fn columns_ascend_within_the_matrix() {
        for (columns, holds) in [
            (vec![], true),
            (vec![0, 1, 29], true),
            (vec![30], false),
            (vec![-1, 3], false),
            (vec![3, 3], false),
            (vec![4, 3, 9], false),
            (vec![0, i32::MIN, 7], false),
        ] {
            assert_eq!(are_columns(&columns, 30), holds, "{columns:?}");
            let bytes: Vec<u8> = columns.iter().flat_map(|column| column.to_le_bytes()).collect();
            let values: Vec<u8> = columns.iter().flat_map(|_| 0.5_f32.to_le_bytes()).collect();
            assert_eq!(
                is_plain_row(&bytes, EncodedValues::Single(&values), 30, FACTOR_END),
                holds,
                "{columns:?}"
            );
            let values: Vec<u8> = columns.iter().flat_map(|_| f32::NAN.to_le_bytes()).collect();
            assert_eq!(
                is_plain_row(&bytes, EncodedValues::Single(&values), 30, FACTOR_END),
                columns.is_empty()
            );
        }
    }
}
