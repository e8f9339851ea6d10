//! One lane of a block drawn into coverage, a row in each lane of a register.

use crate::kernel::coverage::{Canvas, Coverage, MOST_COLUMNS, Rows, WIDTH};
use crate::kernel::isa::avx2::{edge_values, sum_of, weigh, weight_of_row};
use crate::kernel::ordered::{BlockOnFace, DrawnLane};
use crate::kernel::projection::at;
use crate::kernel::spans::{BlockLines, EdgeLines, edge_lines, flat_rows, rows_between};
use crate::kernel::{FaceGrid, GROUP, Transformed, three};
use hemicube_contract::bvh::LANES;
use std::arch::x86_64::*;
use std::mem::MaybeUninit;
use std::ops::Range;

/// Computes the lines of all lanes of a block, by the operations of `affine` and `edge_lines`.
///
/// # Safety
/// The machine has the instruction set of the token.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
pub(super) unsafe fn block_lines(t: &Transformed, grid: FaceGrid, out: &mut BlockLines) {
    const HALF: usize = LANES / 2;
    let (axis, sign) = grid.face.axes();
    let step = 2.0 / grid.resolution as f64;
    let u0 = 0.5 * step - 1.0;
    let v0 = if grid.face.is_top() { u0 } else { 0.5 * step };
    // SAFETY: the caller's promise; loads and stores are of half an array.
    unsafe {
        let (step, u0, v0) = (_mm512_set1_pd(step), _mm512_set1_pd(u0), _mm512_set1_pd(v0));
        let zero = _mm512_setzero_pd();
        for k in 0..3 {
            let (mut left, mut right) = (0u16, 0u16);
            for half in [0, HALF] {
                let edge = |c: usize| {
                    let e = _mm512_load_pd(t.edges[3 * k + axis[c]].as_ptr().add(half));
                    _mm512_mul_pd(_mm512_set1_pd(sign[c]), e)
                };
                let (eu, ev, ew) = (edge(0), edge(1), edge(2));
                let a = _mm512_mul_pd(eu, step);
                let b = _mm512_mul_pd(ev, step);
                let c = _mm512_add_pd(_mm512_add_pd(ew, _mm512_mul_pd(eu, u0)), _mm512_mul_pd(ev, v0));
                let inverse = _mm512_div_pd(_mm512_set1_pd(-1.0), a);
                _mm512_store_pd(out.slope[k].as_mut_ptr().add(half), _mm512_mul_pd(b, inverse));
                _mm512_store_pd(out.offset[k].as_mut_ptr().add(half), _mm512_mul_pd(c, inverse));
                left |= u16::from(_mm512_cmp_pd_mask::<_CMP_GT_OQ>(a, zero)) << half;
                right |= u16::from(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, zero)) << half;
            }
            (out.left[k], out.right[k]) = (left, right);
        }
    }
    out.ready = u16::MAX;
}

/// A lane's edges as lines, edge k in all lanes of a register.
struct Edges {
    slope: [__m512d; 3],
    offset: [__m512d; 3],
    from_left: [u8; 3],
    from_right: [u8; 3],
    /// Present if an edge runs along the rows.
    flat: Option<EdgeLines>,
}

impl Edges {
    /// # Safety
    /// The machine has the instruction set of the token.
    #[inline(always)]
    unsafe fn new(t: &Transformed, ready: &BlockLines, grid: FaceGrid, lane: usize) -> Self {
        let (slope, offset): ([__m512d; 3], [__m512d; 3]);
        let (from_left, from_right): ([u8; 3], [u8; 3]);
        // SAFETY: the caller's promise; stores are as long as their arrays.
        unsafe {
            if ready.ready >> lane & 1 != 0 {
                slope = three(|k| _mm512_set1_pd(ready.slope[k][lane]));
                offset = three(|k| _mm512_set1_pd(ready.offset[k][lane]));
                let all = |mask: u16| u8::from(mask >> lane & 1 != 0).wrapping_neg();
                (from_left, from_right) = (three(|k| all(ready.left[k])), three(|k| all(ready.right[k])));
            } else {
                let [a, b, c] = edge_values(t, grid, lane);
                let zero = _mm256_setzero_pd();
                let left = _mm256_cmp_pd_mask::<_CMP_GT_OQ>(a, zero);
                let right = _mm256_cmp_pd_mask::<_CMP_LT_OQ>(a, zero);
                let inverse = _mm256_div_pd(_mm256_set1_pd(-1.0), a);
                let (mut slopes, mut offsets) = ([0.0; 4], [0.0; 4]);
                _mm256_storeu_pd(slopes.as_mut_ptr(), _mm256_mul_pd(b, inverse));
                _mm256_storeu_pd(offsets.as_mut_ptr(), _mm256_mul_pd(c, inverse));
                slope = three(|k| _mm512_set1_pd(slopes[k]));
                offset = three(|k| _mm512_set1_pd(offsets[k]));
                let all = |mask: u8, k: usize| (mask >> k & 1).wrapping_neg();
                (from_left, from_right) = (three(|k| all(left, k)), three(|k| all(right, k)));
            }
        }
        let is_flat = three(|k| from_left[k] | from_right[k]) != [u8::MAX; 3];
        let flat = if is_flat {
            Some(edge_lines(t, grid, lane).0)
        } else {
            None
        };
        Self {
            slope,
            offset,
            from_left,
            from_right,
            flat,
        }
    }

    /// First column and one past the last of the rows `ys`, within `columns`.
    ///
    /// # Safety
    /// The machine has the instruction set of the token.
    #[inline(always)]
    unsafe fn spans(&self, ys: __m512d, columns: [__m512d; 2]) -> [__m256i; 2] {
        const UP: i32 = _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC;
        let [first_x, end_x] = columns;
        // SAFETY: the caller's promise.
        unsafe {
            let (mut least, mut most) = (first_x, end_x);
            for k in 0..3 {
                let x = _mm512_add_pd(_mm512_mul_pd(self.slope[k], ys), self.offset[k]);
                least = _mm512_mask_max_pd(least, self.from_left[k], x, least);
                most = _mm512_mask_min_pd(most, self.from_right[k], x, most);
            }
            least = _mm512_min_pd(least, end_x);
            most = _mm512_max_pd(most, first_x);
            [
                _mm512_cvtpd_epi32(_mm512_roundscale_pd::<UP>(least)),
                _mm512_cvtpd_epi32(_mm512_roundscale_pd::<UP>(most)),
            ]
        }
    }
}

/// Covers the part of eight spans from atlas row `row` on in one column of words. Returns the rows with a visible
/// pixel, and with a hidden one.
///
/// # Safety
/// The machine has the instruction set of the token; the column and the row lie within the coverage.
#[inline(always)]
unsafe fn cover_column(
    [start, end]: [__m512i; 2],
    rows: u8,
    [column, row]: [usize; 2],
    coverage: &mut Coverage,
    visible: &mut MaybeUninit<Rows>,
) -> (u8, u8) {
    // SAFETY: the caller's promise. Eight rows from any row on lie within the coverage: it has a group to spare.
    unsafe {
        #[allow(clippy::cast_possible_wrap, reason = "at most 1024 pixels")]
        let offset = _mm512_set1_epi64((column * WIDTH) as i64);
        let (zero, ones) = (_mm512_setzero_si512(), _mm512_set1_epi64(-1));
        // Shifts by 64 and more give 0.
        let from = _mm512_max_epi64(_mm512_sub_epi64(start, offset), zero);
        let to = _mm512_max_epi64(_mm512_sub_epi64(end, offset), zero);
        let mask = _mm512_maskz_andnot_epi64(rows, _mm512_sllv_epi64(ones, to), _mm512_sllv_epi64(ones, from));
        let place = column * coverage.groups * GROUP + row;
        let words = coverage.rows.as_mut_ptr().cast::<i64>().add(place);
        let covered = _mm512_loadu_epi64(words);
        let shows = _mm512_andnot_si512(covered, mask);
        _mm512_storeu_epi64(words, _mm512_or_si512(covered, mask));
        _mm512_store_epi64(visible.as_mut_ptr().cast(), shows);
        (
            _mm512_test_epi64_mask(shows, shows),
            _mm512_cmpneq_epi64_mask(shows, mask),
        )
    }
}

/// [`Lanes::draw_lane`](super::super::Lanes::draw_lane) with a row in each lane of the registers.
///
/// # Safety
/// The machine has the instruction set of the token.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt")]
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
    // SAFETY: the caller's promise of the instruction set. Columns lie within the coverage, and gathered places within
    // `running`, as spans are clamped to their pixel box and that to its face.
    unsafe {
        let edges = Edges::new(on.triangles, on.lines, grid, lane);
        let first_row = grid.first_row();
        let (x0, x1, y0, y1) = (at(columns.start), at(columns.end) - 1, at(rows.start), at(rows.end));
        let (first, last) = (x0 / WIDTH, x1 / WIDTH);
        let iota = _mm512_setr_pd(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0);
        let limits = [
            _mm512_set1_pd(f64::from(columns.start)),
            _mm512_set1_pd(f64::from(columns.end)),
        ];
        let mut pixel_sum = _mm256_setzero_si256();
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_possible_wrap,
            reason = "at most 1024"
        )]
        let (width, row_steps) = (
            resolution as i32,
            _mm256_mullo_epi32(
                _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7),
                _mm256_set1_epi32(resolution as i32),
            ),
        );
        // Visible pixels of each column, written before they are read.
        let mut visible = [const { MaybeUninit::<Rows>::uninit() }; MOST_COLUMNS];
        let mut y = y0.min(grid.height() - GROUP);
        while y < y1 {
            let mut rows = u8::MAX;
            if let Some(lines) = &edges.flat {
                rows = flat_rows(lines, y as f64, rows);
            }
            rows = rows_between(y0, y1, y, rows);
            let [start, end] = edges.spans(_mm512_add_pd(_mm512_set1_pd(y as f64), iota), limits);
            rows &= _mm256_cmplt_epi32_mask(start, end);
            if rows == 0 {
                y += GROUP;
                continue;
            }
            let (mut seen, mut unseen) = (0u8, 0u8);
            let spans = [_mm512_cvtepi32_epi64(start), _mm512_cvtepi32_epi64(end)];
            for column in first..=last {
                let shows = visible.get_unchecked_mut(column - first);
                let (s, u) = cover_column(spans, rows, [column, first_row + y], canvas.coverage_mut(), shows);
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
                let base = _mm256_add_epi32(row_steps, _mm256_set1_epi32(y as i32 * width));
                // Rows not weighed begin and end at 0.
                let mut before = [0u32; GROUP];
                let mut after = [0u32; GROUP];
                let place = |x: __m256i| _mm256_maskz_add_epi32(weighed, base, x);
                _mm256_storeu_si256(before.as_mut_ptr().cast(), place(start));
                _mm256_storeu_si256(after.as_mut_ptr().cast(), place(end));
                weigh::<COVERED>(running, [&before, &after], whole_rows, weighed, &mut drawn);
                if COVERED {
                    pixel_sum = _mm256_mask_add_epi32(pixel_sum, rows, pixel_sum, _mm256_sub_epi32(end, start));
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
