//! One lane of a block drawn into coverage, four rows in each register.

use crate::kernel::coverage::{Canvas, MOST_COLUMNS, Rows, WIDTH, weight_of};
use crate::kernel::ordered::{BlockOnFace, DrawnLane};
use crate::kernel::projection::at;
use crate::kernel::spans::{EdgeLines, edge_lines, flat_rows, rows_between};
use crate::kernel::{FaceGrid, GROUP, Transformed};
use std::arch::x86_64::*;
use std::mem::MaybeUninit;
use std::ops::Range;

/// Values of a lane's edges over a face's pixels, a · x + b · y + c, an edge in each of three lanes: by the operations
/// of `affine` and `edge_lines`.
///
/// # Safety
/// The machine has AVX2.
#[target_feature(enable = "avx2")]
#[inline]
pub(crate) unsafe fn edge_values(t: &Transformed, grid: FaceGrid, lane: usize) -> [__m256d; 3] {
    let (axis, sign) = grid.face.axes();
    let edge = |c: usize| {
        let e = &t.edges;
        let a = axis[c];
        let e = _mm256_setr_pd(e[a][lane], e[3 + a][lane], e[6 + a][lane], 1.0);
        _mm256_mul_pd(_mm256_set1_pd(sign[c]), e)
    };
    let (eu, ev, ew) = (edge(0), edge(1), edge(2));
    let step = 2.0 / grid.resolution as f64;
    let u0 = 0.5 * step - 1.0;
    let v0 = if grid.face.is_top() { u0 } else { 0.5 * step };
    let a = _mm256_mul_pd(eu, _mm256_set1_pd(step));
    let b = _mm256_mul_pd(ev, _mm256_set1_pd(step));
    let c = _mm256_add_pd(
        _mm256_add_pd(ew, _mm256_mul_pd(eu, _mm256_set1_pd(u0))),
        _mm256_mul_pd(ev, _mm256_set1_pd(v0)),
    );
    [a, b, c]
}

/// Weighs eight spans between places of a running sum: those in `weighed`, of which those in `whole` are wholly
/// visible. The others begin and end at 0.
///
/// # Safety
/// All places lie within `running`.
#[inline(always)]
pub(crate) unsafe fn weigh<const COVERED: bool>(
    running: &[u32],
    [before, after]: [&[u32; GROUP]; 2],
    mut whole: u8,
    weighed: u8,
    drawn: &mut DrawnLane,
) {
    // Keep them in memory: the compiler would make gathers of them, which are slower.
    let (before, after) = (std::hint::black_box(before), std::hint::black_box(after));
    // SAFETY: the caller's promise.
    let weight =
        |r: usize| unsafe { running.get_unchecked(after[r] as usize) - running.get_unchecked(before[r] as usize) };
    let mut all = 0u32;
    for r in 0..GROUP {
        all = all.wrapping_add(weight(r));
    }
    if COVERED {
        drawn.covered = drawn.covered.wrapping_add(all);
    }
    if weighed == whole {
        drawn.visible = drawn.visible.wrapping_add(all);
        return;
    }
    while whole != 0 {
        drawn.visible = drawn.visible.wrapping_add(weight(whole.trailing_zeros() as usize));
        whole &= whole - 1;
    }
}

/// Weight of the visible pixels of row `r` of eight, with running sum `row`, in the columns from `first` on.
///
/// # Safety
/// The columns of `shows` were written.
#[inline(always)]
pub(crate) unsafe fn weight_of_row(row: &[u32], first: usize, shows: &[MaybeUninit<Rows>], r: usize) -> u32 {
    let mut weight = 0;
    for (column, shows) in (first..).zip(shows) {
        // SAFETY: the caller's promise.
        let bits = unsafe { shows.assume_init_ref() }.0[r];
        weight += weight_of(bits, &row[column * WIDTH..]);
    }
    weight
}

/// A lane's edges as lines, edge k in all lanes of a register.
struct Edges {
    slope: [__m256d; 3],
    offset: [__m256d; 3],
    from_left: [__m256d; 3],
    from_right: [__m256d; 3],
    /// Present if an edge runs along the rows.
    flat: Option<EdgeLines>,
}

impl Edges {
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn new(t: &Transformed, grid: FaceGrid, lane: usize) -> Self {
        // SAFETY: the caller's promise.
        unsafe {
            let [a, b, c] = edge_values(t, grid, lane);
            let zero = _mm256_setzero_pd();
            let from_left = _mm256_cmp_pd::<_CMP_GT_OQ>(a, zero);
            let from_right = _mm256_cmp_pd::<_CMP_LT_OQ>(a, zero);
            let inverse = _mm256_div_pd(_mm256_set1_pd(-1.0), a);
            let (slope, offset) = (_mm256_mul_pd(b, inverse), _mm256_mul_pd(c, inverse));
            let is_flat = _mm256_movemask_pd(_mm256_or_pd(from_left, from_right)) & 0b111 != 0b111;
            let flat = if is_flat {
                Some(edge_lines(t, grid, lane).0)
            } else {
                None
            };
            macro_rules! each {
                ($of:expr) => {
                    [
                        _mm256_permute4x64_pd::<0b00_00_00_00>($of),
                        _mm256_permute4x64_pd::<0b01_01_01_01>($of),
                        _mm256_permute4x64_pd::<0b10_10_10_10>($of),
                    ]
                };
            }
            Self {
                slope: each!(slope),
                offset: each!(offset),
                from_left: each!(from_left),
                from_right: each!(from_right),
                flat,
            }
        }
    }

    /// First column and one past the last of the rows `ys`, within `columns`.
    ///
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn spans(&self, ys: __m256d, columns: [__m256d; 2]) -> [__m128i; 2] {
        let [first_x, end_x] = columns;
        // SAFETY: the caller's promise.
        unsafe {
            let (mut least, mut most) = (first_x, end_x);
            for k in 0..3 {
                let x = _mm256_add_pd(_mm256_mul_pd(self.slope[k], ys), self.offset[k]);
                // The second operand wins over NaN, as in the portable comparison.
                least = _mm256_blendv_pd(least, _mm256_max_pd(x, least), self.from_left[k]);
                most = _mm256_blendv_pd(most, _mm256_min_pd(x, most), self.from_right[k]);
            }
            let (least, most) = (_mm256_min_pd(least, end_x), _mm256_max_pd(most, first_x));
            [
                _mm256_cvtpd_epi32(_mm256_ceil_pd(least)),
                _mm256_cvtpd_epi32(_mm256_ceil_pd(most)),
            ]
        }
    }
}

/// Eight spans: first column, one past the last, and the rows that count.
#[derive(Clone, Copy)]
struct EightSpans {
    start: __m256i,
    end: __m256i,
    within: __m256i,
}

/// Covers the part of eight spans in one column of words. Returns the rows with a visible pixel, and with a hidden one.
///
/// With the feature itself, so that its closure has it too: without it no intrinsic is inlined there.
///
/// # Safety
/// The machine has AVX2, and `words` points to eight words aligned to 32 bytes.
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn cover_column(
    spans: EightSpans,
    column: usize,
    words: *mut __m256i,
    shows: &mut MaybeUninit<Rows>,
) -> (u8, u8) {
    // SAFETY: the caller's promise; `shows` is eight words too.
    unsafe {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_possible_wrap,
            reason = "at most 1024 pixels"
        )]
        let offset = _mm256_set1_epi32((column * WIDTH) as i32);
        let (ones, nothing) = (_mm256_set1_epi64x(-1), _mm256_setzero_si256());
        // Shifts by 64 and more give 0.
        let from = _mm256_max_epi32(_mm256_sub_epi32(spans.start, offset), nothing);
        let to = _mm256_max_epi32(_mm256_sub_epi32(spans.end, offset), nothing);
        let shown: *mut __m256i = shows.as_mut_ptr().cast();
        let (mut seen, mut unseen) = (0u8, 0u8);
        let mut half = |k: usize, from: __m128i, to: __m128i, within: __m128i| {
            let (from, to) = (_mm256_cvtepi32_epi64(from), _mm256_cvtepi32_epi64(to));
            let mask = _mm256_andnot_si256(_mm256_sllv_epi64(ones, to), _mm256_sllv_epi64(ones, from));
            let mask = _mm256_and_si256(mask, _mm256_cvtepi32_epi64(within));
            let covered = _mm256_load_si256(words.add(k));
            let shows = _mm256_andnot_si256(covered, mask);
            _mm256_store_si256(words.add(k), _mm256_or_si256(covered, mask));
            _mm256_store_si256(shown.add(k), shows);
            let four = |equal: __m256i| _mm256_movemask_pd(_mm256_castsi256_pd(equal)) ^ 0b1111;
            seen |= low_byte(four(_mm256_cmpeq_epi64(shows, nothing)) << (4 * k));
            unseen |= low_byte(four(_mm256_cmpeq_epi64(shows, mask)) << (4 * k));
        };
        half(
            0,
            _mm256_castsi256_si128(from),
            _mm256_castsi256_si128(to),
            _mm256_castsi256_si128(spans.within),
        );
        half(
            1,
            _mm256_extracti128_si256::<1>(from),
            _mm256_extracti128_si256::<1>(to),
            _mm256_extracti128_si256::<1>(spans.within),
        );
        (seen, unseen)
    }
}

/// [`Lanes::draw_lane`](super::super::Lanes::draw_lane) with four rows in each register.
///
/// # Safety
/// The machine has the instruction set of the token.
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline(never)]
pub(super) unsafe fn draw_lane<const COVERED: bool, C: Canvas>(
    on: &BlockOnFace<'_>,
    lane: usize,
    columns: Range<i32>,
    rows: Range<i32>,
    canvas: &mut C,
) -> DrawnLane {
    let (grid, running) = (on.grid, on.running);
    let resolution = grid.resolution;
    let mut drawn = DrawnLane::default();
    // SAFETY: the caller's promise of the instruction set. Groups and columns lie within the coverage, and places read
    // within `running`, as spans are clamped to their pixel box and that to its face.
    unsafe {
        let edges = Edges::new(on.triangles, grid, lane);
        let first_row = grid.first_row();
        let (x0, x1, y0, y1) = (at(columns.start), at(columns.end) - 1, at(rows.start), at(rows.end));
        let (first, last) = (x0 / WIDTH, x1 / WIDTH);
        let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
        let limits = [
            _mm256_set1_pd(f64::from(columns.start)),
            _mm256_set1_pd(f64::from(columns.end)),
        ];
        let mut pixel_sum = _mm256_setzero_si256();
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_possible_wrap,
            reason = "at most 1024"
        )]
        let row_steps = _mm256_mullo_epi32(
            _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7),
            _mm256_set1_epi32(resolution as i32),
        );
        // Visible pixels of each column, written before they are read.
        let mut visible = [const { MaybeUninit::<Rows>::uninit() }; MOST_COLUMNS];
        let mut y = y0 / GROUP * GROUP;
        while y < y1 {
            let first_y = _mm256_set1_pd(y as f64);
            let [start_low, end_low] = edges.spans(_mm256_add_pd(first_y, _mm256_setr_pd(0.0, 1.0, 2.0, 3.0)), limits);
            let [start_high, end_high] =
                edges.spans(_mm256_add_pd(first_y, _mm256_setr_pd(4.0, 5.0, 6.0, 7.0)), limits);
            let (start, end) = (
                _mm256_set_m128i(start_high, start_low),
                _mm256_set_m128i(end_high, end_low),
            );
            let mut within = _mm256_cmpgt_epi32(end, start);
            let mut wanted = u8::MAX;
            if let Some(lines) = &edges.flat {
                wanted = flat_rows(lines, y as f64, wanted);
            }
            let wanted = rows_between(y0, y1, y, wanted);
            let wanted = _mm256_and_si256(_mm256_set1_epi32(i32::from(wanted)), bits);
            within = _mm256_and_si256(within, _mm256_cmpeq_epi32(wanted, bits));
            let rows = low_byte(_mm256_movemask_ps(_mm256_castsi256_ps(within)));
            if rows == 0 {
                y += GROUP;
                continue;
            }
            let spans = EightSpans { start, end, within };
            let (mut seen, mut unseen) = (0u8, 0u8);
            let group = (first_row + y) / GROUP;
            for column in first..=last {
                let coverage = canvas.coverage_mut();
                let place = column * coverage.groups + group;
                let words: *mut __m256i = coverage.rows.get_unchecked_mut(place).0.as_mut_ptr().cast();
                let (s, u) = cover_column(spans, column, words, visible.get_unchecked_mut(column - first));
                seen |= s;
                unseen |= u;
            }
            if seen != 0 && canvas.is_recording() {
                for column in first..=last {
                    let shows = visible.get_unchecked(column - first).assume_init_ref();
                    canvas.record_rows(column, first_row + y, shows);
                }
            }
            drawn.seen |= seen != 0;
            let whole_rows = rows & !unseen;
            let weighed = if COVERED { rows } else { whole_rows };
            if weighed != 0 {
                #[allow(
                    clippy::cast_possible_truncation,
                    clippy::cast_possible_wrap,
                    reason = "at most 2^20 pixels"
                )]
                let base = _mm256_add_epi32(row_steps, _mm256_set1_epi32((y * resolution) as i32));
                let mut before = [0u32; GROUP];
                let mut after = [0u32; GROUP];
                // Rows not weighed begin and end at 0.
                let these = if COVERED {
                    within
                } else {
                    _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(i32::from(weighed)), bits), bits)
                };
                let place = |x: __m256i| _mm256_and_si256(_mm256_add_epi32(base, x), these);
                _mm256_storeu_si256(before.as_mut_ptr().cast(), place(start));
                _mm256_storeu_si256(after.as_mut_ptr().cast(), place(end));
                weigh::<COVERED>(running, [&before, &after], whole_rows, weighed, &mut drawn);
                if COVERED {
                    let pixels = _mm256_and_si256(_mm256_sub_epi32(end, start), within);
                    pixel_sum = _mm256_add_epi32(pixel_sum, pixels);
                }
            }
            let mut part = rows & seen & unseen;
            while part != 0 {
                let r = part.trailing_zeros() as usize;
                part &= part - 1;
                drawn.visible += weight_of_row(&running[(y + r) * resolution..], first, &visible[..=last - first], r);
            }
            y += GROUP;
        }
        if COVERED {
            drawn.pixels = sum_of(pixel_sum);
        }
    }
    drawn
}

/// The lowest eight bits.
#[inline(always)]
pub(crate) fn low_byte(bits: i32) -> u8 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "eight bits")]
    {
        bits as u8
    }
}

/// Mask of the rows that lack some bit of `mask`: of [`Lanes::lacking`](super::super::Lanes::lacking).
///
/// # Safety
/// The machine has AVX2.
#[target_feature(enable = "avx2")]
#[inline]
pub(super) unsafe fn lacking(rows: &[u64; GROUP], mask: u64) -> u8 {
    let mask = _mm256_set1_epi64x(mask.cast_signed());
    let half = |k: usize| {
        // SAFETY: the two loads are as long as the array.
        let bits = unsafe { _mm256_loadu_si256(rows.as_ptr().cast::<__m256i>().add(k)) };
        let all = _mm256_cmpeq_epi64(_mm256_and_si256(bits, mask), mask);
        _mm256_movemask_pd(_mm256_castsi256_pd(all))
    };
    !low_byte(half(0) | half(1) << 4)
}

/// Sum of eight lanes.
///
/// # Safety
/// The machine has AVX2.
#[target_feature(enable = "avx2")]
#[inline]
pub(crate) unsafe fn sum_of(v: __m256i) -> u32 {
    let v = _mm_add_epi32(_mm256_castsi256_si128(v), _mm256_extracti128_si256::<1>(v));
    let v = _mm_add_epi32(v, _mm_shuffle_epi32::<0b00_00_11_10>(v));
    let v = _mm_add_epi32(v, _mm_shuffle_epi32::<0b00_00_00_01>(v));
    _mm_cvtsi128_si32(v).cast_unsigned()
}
