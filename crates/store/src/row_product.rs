//! Contribution of one row of a store to F·x and Fᵀ·x, from the bytes of its file.
//!
//! A row of F·x is [`LANES`] sums, entry k in sum k mod [`LANES`], added from the first to the last at the end, in
//! either form and on every instruction set. Multiplications and additions are rounded one by one, never fused. The
//! same source is compiled for each instruction set, so all give the same bits.

use super::compact;
use super::csr::{EncodedRow, EncodedValues};
use hemicube_spatial::simd::{InstructionSet, dispatch};

/// Independent sums of a row.
const LANES: usize = 8;
/// Columns handled together: runs have seven columns on average in a city of 1.5 million patches.
const RUN: usize = 4;

/// Buffers of decoded rows of the compact form.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// Values of x at the columns of a row.
    of_row: Vec<f64>,
    /// The columns of a row.
    columns: Vec<u32>,
    long: Vec<Long>,
}

/// Σ F x of a row; `None` when a column is none.
pub(super) fn dot(row: EncodedRow<'_>, x: &[f64], scratch: &mut Scratch) -> Option<f64> {
    match row {
        EncodedRow::Plain {
            columns,
            values: EncodedValues::Single(values),
        } => dot_plain(InstructionSet::widest(), columns, values, x),
        EncodedRow::Plain {
            columns,
            values: EncodedValues::Double(values),
        } => dot_double(InstructionSet::widest(), columns, values, x),
        EncodedRow::Compact {
            gaps,
            lengths,
            codes,
            scale,
        } => dot_compact(
            InstructionSet::widest(),
            gaps,
            lengths,
            codes,
            x,
            &mut scratch.of_row,
            &mut scratch.long,
        )
        // By a power of two: exact, whenever it is done.
        .map(|sum| sum * f64::from(scale)),
    }
}

/// Adds F x to the arrivals at the patches seen by a row; `None` for a column out of range.
pub(super) fn scatter(row: EncodedRow<'_>, x: f64, y: &mut [f64], scratch: &mut Scratch) -> Option<()> {
    match row {
        EncodedRow::Plain {
            columns,
            values: EncodedValues::Single(values),
        } => scatter_values(columns, values, single, x, y),
        EncodedRow::Plain {
            columns,
            values: EncodedValues::Double(values),
        } => scatter_values(columns, values, f64::from_le_bytes, x, y),
        EncodedRow::Compact {
            gaps,
            lengths,
            codes,
            scale,
        } => scatter_compact(
            InstructionSet::widest(),
            gaps,
            lengths,
            codes,
            x * f64::from(scale),
            y,
            &mut scratch.columns,
            &mut scratch.long,
        ),
    }
}

dispatch! {
    fn dot_plain = dot_plain_portable(columns: &[u8], values: &[u8], x: &[f64]) -> Option<f64>
}
dispatch! {
    fn dot_double = dot_double_portable(columns: &[u8], values: &[u8], x: &[f64]) -> Option<f64>
}
dispatch! {
    fn dot_compact = dot_compact_portable(
        gaps: &[u8], lengths: &[u8], codes: &[u8], x: &[f64], of_row: &mut Vec<f64>, long: &mut Vec<Long>
    ) -> Option<f64>
}
dispatch! {
    fn scatter_compact = scatter_compact_portable(
        gaps: &[u8], lengths: &[u8], codes: &[u8], x: f64, y: &mut [f64], columns: &mut Vec<u32>, long: &mut Vec<Long>
    ) -> Option<()>
}

fn column(bytes: [u8; 4]) -> usize {
    // A negative column is beyond every vector.
    i32::from_le_bytes(bytes).cast_unsigned() as usize
}

/// First of a run of adjacent columns.
fn run(columns: &[[u8; 4]; RUN]) -> Option<usize> {
    let first = i32::from_le_bytes(columns[0]);
    let mut differs = 0;
    let mut wanted = first;
    for &column in columns {
        differs |= i32::from_le_bytes(column) ^ wanted;
        wanted = wanted.wrapping_add(1);
    }
    (differs == 0 && first >= 0).then_some(first.cast_unsigned() as usize)
}

/// An f32 of a plain row.
#[inline(always)]
fn single(bytes: [u8; 4]) -> f64 {
    f64::from(f32::from_le_bytes(bytes))
}

#[inline(always)]
fn dot_plain_portable(columns: &[u8], values: &[u8], x: &[f64]) -> Option<f64> {
    dot_values(columns, values, single, x)
}

#[inline(always)]
fn dot_double_portable(columns: &[u8], values: &[u8], x: &[f64]) -> Option<f64> {
    dot_values(columns, values, f64::from_le_bytes, x)
}

#[inline(always)]
fn dot_values<const SIZE: usize>(
    columns: &[u8],
    values: &[u8],
    decode: impl Fn([u8; SIZE]) -> f64,
    x: &[f64],
) -> Option<f64> {
    let mut sums = [0.0; LANES];
    let (columns, values) = (columns.as_chunks::<4>().0, values.as_chunks::<SIZE>().0);
    let (whole, rest) = columns.as_chunks::<LANES>();
    let (of_whole, of_rest) = values.as_chunks::<LANES>();
    for (columns, values) in whole.iter().zip(of_whole) {
        let mut of_row = [0.0; LANES];
        for (x_of, &bytes) in of_row.iter_mut().zip(columns) {
            *x_of = *x.get(column(bytes))?;
        }
        for lane in 0..LANES {
            sums[lane] += decode(values[lane]) * of_row[lane];
        }
    }
    for ((&columns, &values), sum) in rest.iter().zip(of_rest).zip(&mut sums) {
        *sum += decode(values) * x.get(column(columns))?;
    }
    Some(sums.iter().sum())
}

/// A run longer than [`LANES`]: its first column, its start in the row, and its length.
type Long = (usize, usize, usize);

/// Unrolls the runs of a row of `count` entries: `place` fills a slice for the columns from one on, or refuses them.
/// Returns its results combined, and one past the last column.
#[inline(always)]
fn unroll<'r, T: Clone + Default>(
    gaps: &[u8],
    lengths: &[u8],
    entries: usize,
    room: &'r mut Vec<T>,
    long: &mut Vec<Long>,
    place: impl Fn(&mut [T], usize) -> Option<()>,
) -> Option<(&'r [T], usize)> {
    room.resize(room.len().max(entries + LANES), T::default());
    let room = room.get_mut(..entries + LANES)?;
    long.resize(long.len().max(lengths.len() + 1), Long::default());
    let (mut next, mut at, mut long_count) = (0usize, 0usize, 0usize);
    for (&gap, &length) in gaps.as_chunks::<2>().0.iter().zip(lengths) {
        let length = usize::from(length);
        let first = next + usize::from(u16::from_le_bytes(gap));
        next = first + length;
        // Nineteen of twenty runs are no longer than LANES. LANES columns are placed for each, whatever its length: the
        // next run overwrites the excess, and longer ones are completed below. A branch on lengths would be
        // mispredicted.
        if place(room.get_mut(at..at + LANES)?, first).is_none() {
            place(room.get_mut(at..at + length)?, first)?;
        }
        *long.get_mut(long_count)? = (first, at, length);
        long_count += usize::from(length > LANES);
        at += length;
    }
    if at != entries {
        return None;
    }
    for &(first, at, length) in long.get(..long_count)? {
        place(room.get_mut(at..at + length)?, first)?;
    }
    Some((room.get(..entries)?, next))
}

#[inline(always)]
fn dot_compact_portable(
    gaps: &[u8],
    lengths: &[u8],
    codes: &[u8],
    x: &[f64],
    of_row: &mut Vec<f64>,
    long: &mut Vec<Long>,
) -> Option<f64> {
    let codes = codes.as_chunks::<2>().0;
    let (room, _) = unroll(gaps, lengths, codes.len(), of_row, long, |of_row, first| {
        of_row.copy_from_slice(x.get(first..first + of_row.len())?);
        Some(())
    })?;
    let mut sums = [0.0; LANES];
    let (whole, rest) = codes.as_chunks::<LANES>();
    let (of_whole, of_rest) = room.split_at_checked(codes.len() - rest.len())?;
    for (codes, x) in whole.iter().zip(of_whole.as_chunks::<LANES>().0) {
        for lane in 0..LANES {
            sums[lane] += compact::factor_f64(u16::from_le_bytes(codes[lane])) * x[lane];
        }
    }
    for ((&code, x), sum) in rest.iter().zip(of_rest).zip(&mut sums) {
        *sum += compact::factor_f64(u16::from_le_bytes(code)) * x;
    }
    Some(sums.iter().sum())
}

#[inline(always)]
fn scatter_values<const SIZE: usize>(
    columns: &[u8],
    values: &[u8],
    decode: impl Fn([u8; SIZE]) -> f64,
    x: f64,
    y: &mut [f64],
) -> Option<()> {
    let (columns, values) = (columns.as_chunks::<4>().0, values.as_chunks::<SIZE>().0);
    let (whole, rest) = columns.as_chunks::<RUN>();
    let (of_whole, of_rest) = values.as_chunks::<RUN>();
    for (columns, values) in whole.iter().zip(of_whole) {
        if let Some(first) = run(columns) {
            let y: &mut [f64; RUN] = y.get_mut(first..first + RUN)?.try_into().ok()?;
            for lane in 0..RUN {
                y[lane] += decode(values[lane]) * x;
            }
        } else {
            for lane in 0..RUN {
                *y.get_mut(column(columns[lane]))? += decode(values[lane]) * x;
            }
        }
    }
    for (&columns, &values) in rest.iter().zip(of_rest) {
        *y.get_mut(column(columns))? += decode(values) * x;
    }
    Some(())
}

/// The columns of a run.
#[inline(always)]
fn count_up(columns: &mut [u32], first: usize) {
    #[allow(
        clippy::cast_possible_truncation,
        reason = "what is no column is refused by who calls"
    )]
    let first = first as u32;
    for (column, k) in columns.iter_mut().zip(0u32..) {
        *column = first.wrapping_add(k);
    }
}

#[inline(always)]
fn scatter_compact_portable(
    gaps: &[u8],
    lengths: &[u8],
    codes: &[u8],
    x: f64,
    y: &mut [f64],
    columns: &mut Vec<u32>,
    long: &mut Vec<Long>,
) -> Option<()> {
    let codes = codes.as_chunks::<2>().0;
    let (room, end) = unroll(gaps, lengths, codes.len(), columns, long, |columns, first| {
        count_up(columns, first);
        Some(())
    })?;
    if end > y.len() {
        return None;
    }
    let (whole, rest) = codes.as_chunks::<LANES>();
    let (of_whole, of_rest) = room.split_at_checked(codes.len() - rest.len())?;
    for (codes, columns) in whole.iter().zip(of_whole.as_chunks::<LANES>().0) {
        let mut products = [0.0; LANES];
        for lane in 0..LANES {
            products[lane] = compact::factor_f64(u16::from_le_bytes(codes[lane])) * x;
        }
        for (&column, product) in columns.iter().zip(products) {
            *y.get_mut(column as usize)? += product;
        }
    }
    for (&code, &column) in rest.iter().zip(of_rest) {
        *y.get_mut(column as usize)? += compact::factor_f64(u16::from_le_bytes(code)) * x;
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compact::{Runs, code, factor};

    /// Columns with runs of all lengths and gaps of all widths, the last at the matrix' end.
    fn columns(seed: u64, patch_count: i32) -> Vec<i32> {
        let mut state = seed;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            i32::try_from(state >> 40).unwrap()
        };
        let mut columns = Vec::new();
        let mut column = next() % 3;
        while column < patch_count {
            let length = [1, 1, 2, 3, 7, 8, 9, 16, 17, 300][usize::try_from(next()).unwrap() % 10];
            columns.extend(column..(column + length).min(patch_count));
            column += length + 1 + [0, 1, 3, 70_000][usize::try_from(next()).unwrap() % 4];
        }
        columns
    }

    struct Sample {
        columns: Vec<u8>,
        values: Vec<u8>,
        doubles: Vec<u8>,
        gaps: Vec<u8>,
        lengths: Vec<u8>,
        codes: Vec<u8>,
    }

    impl Sample {
        fn new(columns: &[i32]) -> Self {
            let codes: Vec<u16> = (0u16..).zip(columns).map(|(k, _)| k.wrapping_mul(5113)).collect();
            let runs = Runs::new(&[0, i64::try_from(columns.len()).unwrap()], columns);
            Self {
                columns: columns.iter().flat_map(|column| column.to_le_bytes()).collect(),
                values: codes.iter().flat_map(|&code| factor(code).to_le_bytes()).collect(),
                doubles: codes
                    .iter()
                    .flat_map(|&code| f64::from(factor(code)).to_le_bytes())
                    .collect(),
                gaps: runs.gaps.iter().flat_map(|gap| gap.to_le_bytes()).collect(),
                lengths: runs.lengths,
                codes: codes.iter().flat_map(|code| code.to_le_bytes()).collect(),
            }
        }

        fn plain(&self) -> EncodedRow<'_> {
            EncodedRow::Plain {
                columns: &self.columns,
                values: EncodedValues::Single(&self.values),
            }
        }

        fn double(&self) -> EncodedRow<'_> {
            EncodedRow::Plain {
                columns: &self.columns,
                values: EncodedValues::Double(&self.doubles),
            }
        }

        fn compact(&self) -> EncodedRow<'_> {
            EncodedRow::Compact {
                gaps: &self.gaps,
                lengths: &self.lengths,
                codes: &self.codes,
                scale: 1.0,
            }
        }
    }

    #[test]
    fn forms_and_instruction_sets_give_the_bits_of_the_sums_as_they_are_written_down() {
        let patch_count = 200_003;
        let x: Vec<f64> = (0..patch_count)
            .map(|k| f64::from(k * 37 % 1019) / 7.0 - 50.0)
            .collect();
        let mut scratch = Scratch::default();
        for seed in 0..40 {
            let mut columns = columns(seed, patch_count);
            if seed % 4 == 0 {
                columns.truncate(usize::try_from(seed).unwrap());
            }
            let sample = Sample::new(&columns);
            let mut lanes = [0.0; LANES];
            let mut sent: Vec<f64> = x.clone();
            for (k, &column) in columns.iter().enumerate() {
                let code = u16::from_le_bytes([sample.codes[2 * k], sample.codes[2 * k + 1]]);
                let column = usize::try_from(column).unwrap();
                lanes[k % LANES] += f64::from(factor(code)) * x[column];
                sent[column] += f64::from(factor(code)) * 0.7;
            }
            let wanted: f64 = lanes.iter().sum();
            let Sample {
                columns,
                values,
                doubles,
                gaps,
                lengths,
                codes,
            } = &sample;
            for (name, found) in [
                ("plain", dot(sample.plain(), &x, &mut scratch)),
                ("double", dot(sample.double(), &x, &mut scratch)),
                ("compact", dot(sample.compact(), &x, &mut scratch)),
                ("plain, portable", dot_plain_portable(columns, values, &x)),
                ("double, portable", dot_double_portable(columns, doubles, &x)),
                (
                    "compact, portable",
                    dot_compact_portable(gaps, lengths, codes, &x, &mut Vec::new(), &mut Vec::new()),
                ),
            ] {
                assert_eq!(found.map(f64::to_bits), Some(wanted.to_bits()), "{seed}, {name}");
            }
            let mut found = [x.clone(), x.clone(), x.clone(), x.clone()];
            scatter(sample.double(), 0.7, &mut found[3], &mut scratch).unwrap();
            scatter(sample.plain(), 0.7, &mut found[0], &mut scratch).unwrap();
            scatter(sample.compact(), 0.7, &mut found[1], &mut scratch).unwrap();
            scatter_compact_portable(
                gaps,
                lengths,
                codes,
                0.7,
                &mut found[2],
                &mut Vec::new(),
                &mut Vec::new(),
            )
            .unwrap();
            assert!(found.iter().all(|found| found == &sent), "{seed}");
        }
    }

    #[test]
    fn columns_beyond_the_matrix_and_runs_of_other_entries_are_none() {
        let mut scratch = Scratch::default();
        let (x, mut y) = (vec![1.0; 30], vec![0.0; 30]);
        for columns in [
            vec![30],
            vec![29, 30],
            (0..31).collect(),
            (20..31).collect(),
            vec![90_000],
        ] {
            let sample = Sample::new(&columns);
            for row in [sample.plain(), sample.double(), sample.compact()] {
                assert_eq!(dot(row, &x, &mut scratch), None, "{columns:?}");
                assert_eq!(scatter(row, 1.0, &mut y, &mut scratch), None, "{columns:?}");
            }
        }
        assert_eq!(code(1.0).map(factor), Some(1.0));
        let one = code(1.0).unwrap().to_le_bytes();
        for (lengths, entries, fits) in [
            ([3, 9], 12, true),
            ([3, 9], 11, false),
            ([3, 9], 13, false),
            ([20, 9], 3, false),
        ] {
            let codes: Vec<u8> = one.repeat(entries);
            let row = EncodedRow::Compact {
                gaps: &[0, 0, 1, 0],
                lengths: &lengths,
                codes: &codes,
                scale: 1.0,
            };
            assert_eq!(
                dot(row, &x, &mut scratch),
                fits.then_some(12.0),
                "{lengths:?} {entries}"
            );
            assert_eq!(
                scatter(row, 1.0, &mut y, &mut scratch).is_some(),
                fits,
                "{lengths:?} {entries}"
            );
        }
    }
}
