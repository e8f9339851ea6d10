//! The compact form of a part: columns as runs, form factors in 16 bits.
//!
//! ```text
//! format   `run`, which SciPy does not know
//! codes    u2, one an entry: F is 0 for code 0, else the f32 whose bits are (code << 13) + (64 << 23)
//! gaps     u2, lengths u1, one a run: `gap` columns that the row does not have after the end of the run before (or
//!          column 0), then `length` columns that it has; a wider gap is several runs, all but the last of length 0
//! runptr   i8, where each row's runs begin, and one more: where the last one's end
//! indptr   i8, the same for its entries, as in the plain form
//! ```
//!
//! A code is an f32 without sign, of 64 exponents and 10 bits of mantissa, rounded to nearest, ties to even:
//! |F' − F| ≤ 2⁻¹¹ F for every F from 2⁻⁶² up, smaller ones never become 0, and 0 and 1 are exact. Rounding again
//! changes nothing. Decoding takes whole numbers only: every machine and NumPy find the same bits.
//!
//! Through mirrors a form factor may be 2 and more (`validate.rs`). A part with such ones has the format `r15`:
//! every code stands for 2¹⁵ times as much.
//!
//! **Why runs.** Patches cut from one triangle follow each other in the input, and are seen together: half to 97 % of
//! the columns of a row are the one before plus 1, in any scene. **Why not deflate or zstd on top.** The rest is mostly
//! mantissas, which do not shrink: 4 to 23 % for a quarter of the speed of reading, and rows lose their offsets in the
//! file. `docs/dev/store.md` has the figures, and `examples/store_forms.rs` measures them.
//!
//! No compression of parts by deflate or zstd, because columns as runs and 16-bit form factors take a third of the
//! plain form at the plain form's speed. A general compressor takes little off that (mantissas) at several times the
//! cost; a row keeps its offset in the file. `docs/dev/store.md` has the figures.
//!
//! No part-wide dictionary of columns, because columns in input order come in runs already: gaps between ranks in the
//! union of a part's columns have more entropy, not less, once the union itself is stored.

/// The largest relative error of a form factor.
pub(crate) const VALUE_ERROR: f64 = 1.0 / 2048.0;

/// Bits of an f32's mantissa that are left out of a code.
const DROPPED: u32 = 13;

/// The bits of the f32 2⁻⁶³: code 0 would stand for it, but stands for 0.
const BASE: u32 = 64 << 23;

/// By how much codes of the format `r15` stand for more.
pub(crate) const RAISED: f32 = 32_768.0;

/// The smallest form factor but 0 of the format `r15`. Rows through mirrors have none below it in any compact part.
pub(crate) const LEAST_RAISED: f64 = 32_768.0 * 1.001 / 9_223_372_036_854_775_808.0;

/// The code of a form factor; `None` for a negative number, NaN, and numbers from 2 on.
pub(crate) fn code(factor: f32) -> Option<u16> {
    if factor == 0.0 {
        return Some(0);
    }
    if !(factor > 0.0 && factor < 2.0) {
        return None;
    }
    let above = factor.to_bits().saturating_sub(BASE);
    let odd = (above >> DROPPED) & 1;
    let rounded = (above + (1 << (DROPPED - 1)) - 1 + odd) >> DROPPED;
    u16::try_from(rounded.max(1)).ok()
}

/// The form factor of a code.
pub(crate) fn factor(code: u16) -> f32 {
    match code {
        0 => 0.0,
        code => f32::from_bits((u32::from(code) << DROPPED) + BASE),
    }
}

/// The form factor of a code as an f64. Moving its bits to an f64's exponent and mantissa is faster in vectors than a
/// conversion.
#[inline(always)]
pub(crate) fn factor_f64(code: u16) -> f64 {
    // Both exponents count from their own middle.
    const BASE: u64 = (1023 - 127 + 64) << 52;
    match code {
        0 => 0.0,
        code => f64::from_bits((u64::from(code) << (DROPPED + 29)) + BASE),
    }
}

/// Rounds a form factor, also those from 2 on that the format `r15` holds; other numbers stay as they are.
pub(crate) fn round(value: f32) -> f32 {
    let raised = || code(value / RAISED).map(|code| factor(code) * RAISED);
    code(value).map(factor).or_else(raised).unwrap_or(value)
}

/// The columns of some rows.
#[derive(Debug, Default)]
pub(crate) struct Runs {
    pub(crate) runptr: Vec<i64>,
    pub(crate) gaps: Vec<u16>,
    pub(crate) lengths: Vec<u8>,
}

impl Runs {
    /// Encodes rows with ascending columns from 0 on.
    pub(crate) fn new(indptr: &[i64], indices: &[i32]) -> Self {
        let mut runs = Self {
            runptr: Vec::with_capacity(indptr.len()),
            ..Self::default()
        };
        runs.runptr.push(0);
        for bounds in indptr.windows(2) {
            let bound = |bound: i64| usize::try_from(bound).unwrap_or(usize::MAX);
            let row = indices.get(bound(bounds[0])..bound(bounds[1])).unwrap_or(&[]);
            runs.push_row(row);
            runs.runptr.push(i64::try_from(runs.gaps.len()).unwrap_or(i64::MAX));
        }
        runs
    }

    fn push_row(&mut self, mut row: &[i32]) {
        let mut end = 0;
        while let Some(&first) = row.first() {
            // 255 at most: the range of a length.
            let length = (first..)
                .zip(row)
                .take(255)
                .take_while(|&(next, &column)| next == column)
                .count();
            let mut gap = first - end;
            while gap > i32::from(u16::MAX) {
                self.push(u16::MAX, 0);
                gap -= i32::from(u16::MAX);
            }
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "both were bounded"
            )]
            self.push(gap as u16, length as u8);
            row = &row[length..];
            #[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "at most 255")]
            let length = length as i32;
            end = first.saturating_add(length);
        }
    }

    fn push(&mut self, gap: u16, length: u8) {
        self.gaps.push(gap);
        self.lengths.push(length);
    }
}

/// Appends the `count` columns of a row. Returns false when the runs have more or fewer, or reach beyond the range of
/// columns.
pub(crate) fn columns(gaps: &[u16], lengths: &[u8], count: u64, columns: &mut Vec<i32>) -> bool {
    // Checked against the count first: no more is made than was asked for.
    let total: u64 = lengths.iter().map(|&length| u64::from(length)).sum();
    if total != count {
        return false;
    }
    let mut next = 0i32;
    for (&gap, &length) in gaps.iter().zip(lengths) {
        let Some(first) = next.checked_add(gap.into()) else {
            return false;
        };
        let Some(end) = first.checked_add(length.into()) else {
            return false;
        };
        columns.extend(first..end);
        next = end;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::super::validate::FACTOR_END;
    use super::*;

    #[test]
    fn every_code_is_its_own() {
        for all in 0..=u16::MAX {
            assert_eq!(code(factor(all)), Some(all));
            assert_eq!(factor_f64(all).to_bits(), f64::from(factor(all)).to_bits());
            assert_eq!(round(factor(all)).to_bits(), factor(all).to_bits());
        }
        assert!((1..=u16::MAX).all(|all| factor(all) > factor(all - 1)));
        assert_eq!((factor(0), code(1.0).map(factor)), (0.0, Some(1.0)));
        assert!(factor(u16::MAX) < FACTOR_END, "readers rely on it");
    }

    #[test]
    fn values_keep_the_error_that_is_stated() {
        // Every exponent; mantissas around each code's ends and middle, and between.
        for exponent in 65..=126u32 {
            for mantissa in (0..1u32 << 23)
                .step_by(509)
                .chain([0, 4095, 4096, 4097, 8191, (1 << 23) - 1])
            {
                let value = f32::from_bits(exponent << 23 | mantissa);
                let off = (f64::from(round(value)) - f64::from(value)).abs();
                assert!(off <= VALUE_ERROR * f64::from(value), "{value:e}");
                assert!(round(value) <= 1.0);
            }
        }
        // The bound is reached: half a step above a power of two.
        let worst = f64::from(round(0.5 + 0.5 / 2048.0)) / (0.5 + 0.5 / 2048.0) - 1.0;
        assert!(worst.abs() > 0.999 * VALUE_ERROR);
        // Ties go to the even code, up and down.
        let tie = |code: u16| f32::from_bits(factor(code).to_bits() + 4096);
        assert_eq!((code(tie(40_000)), code(tie(40_001))), (Some(40_000), Some(40_002)));
    }

    #[test]
    fn what_is_small_stays_an_entry_and_what_is_none_is_refused() {
        assert_eq!(code(1e-30), Some(1));
        assert_eq!(code(f32::from_bits(1)), Some(1));
        assert_eq!(code(-0.0), Some(0));
        for wrong in [f32::NAN, f32::INFINITY, -1e-9, 2.0, 1.9999] {
            assert_eq!(code(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn what_mirrors_get_again_and_again_keeps_the_same_error() {
        for value in [1.9999f32, 2.0, 3.5, 77.7, 40_000.0] {
            let kept = round(value);
            assert!(
                (f64::from(kept) / f64::from(value) - 1.0).abs() <= VALUE_ERROR,
                "{value}"
            );
            assert_eq!(round(kept).to_bits(), kept.to_bits());
            assert_eq!(code(kept / RAISED).map(|code| factor(code) * RAISED), Some(kept));
        }
        // Whatever is in such a part, its codes are what `round` makes of it.
        for value in [0.1f32, 0.999, 1e-9, 3e-13] {
            assert_eq!(
                code(value / RAISED).map(|code| factor(code) * RAISED),
                Some(round(value))
            );
        }
    }

    fn round_trip(rows: &[Vec<i32>]) -> Runs {
        let mut indptr = vec![0];
        for row in rows {
            indptr.push(indptr.last().copied().unwrap() + i64::try_from(row.len()).unwrap());
        }
        let runs = Runs::new(&indptr, &rows.concat());
        assert_eq!(runs.runptr.len(), indptr.len());
        for (k, row) in rows.iter().enumerate() {
            let bounds = [runs.runptr[k], runs.runptr[k + 1]].map(|bound| usize::try_from(bound).unwrap());
            let (gaps, lengths) = (&runs.gaps[bounds[0]..bounds[1]], &runs.lengths[bounds[0]..bounds[1]]);
            let mut found = Vec::new();
            assert!(columns(gaps, lengths, row.len() as u64, &mut found));
            assert_eq!(&found, row);
            assert!(!columns(gaps, lengths, row.len() as u64 + 1, &mut Vec::new()));
        }
        runs
    }

    #[test]
    fn columns_come_back() {
        let runs = round_trip(&[
            vec![],
            vec![0],
            (0..255).collect(),
            (7..263).collect(),
            vec![65_535, 65_536, 131_073],
            vec![65_536],
            vec![1, 3, 5, 1_500_000],
            vec![i32::MAX - 1],
            vec![],
        ]);
        assert!(
            runs.gaps.len() > 32_768,
            "the last column takes half as many runs as u16 has values"
        );
        assert_eq!(round_trip(&[(3..258).collect()]).lengths, [255]);
    }

    #[test]
    fn runs_that_leave_the_matrix_are_refused() {
        let gaps = vec![u16::MAX; 40_000];
        let mut lengths = vec![0; 40_000];
        lengths[39_999] = 1;
        assert!(!columns(&gaps, &lengths, 1, &mut Vec::new()));
        assert!(!columns(&[0], &[2], 1, &mut Vec::new()));
    }
}
