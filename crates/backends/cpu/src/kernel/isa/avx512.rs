//! AVX-512 with F, BW, DQ and VL.

mod bounds;
mod lane;

use super::avx2::sum_of;
use super::{Flags, Lanes};
use crate::kernel::bounds::{BoxGroup, GroupOnFaces, OnFaces, SceneBox};
use crate::kernel::coverage::{Canvas, OrderedCoverage, Rows, WIDTH};
use crate::kernel::depth::{Chunk, DepthPlane};
use crate::kernel::ordered::{BlockOnFace, DrawnLane};
use crate::kernel::spans::{BlockLines, EdgeLines, Spans};
use crate::kernel::{FaceGrid, Frame, GROUP, Transformed};
use std::arch::x86_64::*;
use std::ops::Range;

/// Token of AVX-512 F, BW, DQ and VL, and of the features of AVX2's token.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx512(());

impl Avx512 {
    /// Asks the processor.
    pub(super) fn detect() -> Option<Self> {
        let has = super::Avx2::detect().is_some()
            && is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl");
        has.then_some(Self(()))
    }
}

impl Lanes for Avx512 {
    #[inline(always)]
    fn on_faces(self, of: &SceneBox, frame: &Frame, faces: u8, touched: bool, out: &mut OnFaces) {
        // SAFETY: the token proves the instruction set.
        unsafe { bounds::on_faces(of, frame, faces, touched, out) };
    }

    #[inline(always)]
    fn test_group<const COVERED: bool>(
        self,
        group: &BoxGroup,
        used: u8,
        frame: &Frame,
        canvas: &mut OrderedCoverage,
        faces: u8,
    ) -> GroupOnFaces {
        // SAFETY: the token proves the instruction set.
        unsafe { bounds::test_group::<COVERED>(self, group, used, frame, canvas, faces) }
    }

    #[inline(always)]
    fn block_lines(self, triangles: &Transformed, grid: FaceGrid, out: &mut BlockLines) {
        // SAFETY: the token proves the instruction set.
        unsafe { lane::block_lines(triangles, grid, out) };
    }

    #[inline(always)]
    fn draw_lane<const COVERED: bool, C: Canvas>(
        self,
        on: &BlockOnFace<'_>,
        lane: usize,
        columns: Range<i32>,
        rows: Range<i32>,
        canvas: &mut C,
    ) -> DrawnLane {
        // SAFETY: the token proves the instruction set.
        unsafe { lane::draw_lane::<COVERED, C>(on, lane, columns, rows, canvas) }
    }

    #[inline(always)]
    fn lacking(self, rows: &[u64; GROUP], mask: u64) -> u8 {
        // SAFETY: the token proves the instruction set; the load is as long as the array.
        unsafe {
            let bits = _mm512_loadu_epi64(rows.as_ptr().cast());
            let mask = _mm512_set1_epi64(mask.cast_signed());
            _mm512_cmpneq_epi64_mask(_mm512_and_si512(bits, mask), mask)
        }
    }

    #[inline(always)]
    fn mark(self, spans: &Spans, column: usize, covered: &mut Rows, shows: &mut Rows, over: &mut Rows) -> (u8, u8) {
        // SAFETY: the token proves the instruction set; loads and stores are as long as their arrays.
        unsafe {
            let ones = _mm512_set1_epi64(-1);
            let zero = _mm256_setzero_si256();
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_possible_wrap,
                reason = "at most 1024 pixels"
            )]
            let offset = _mm256_set1_epi32((column * WIDTH) as i32);
            // Shifts by 64 and more give 0.
            let place = |of: &[i32; GROUP]| {
                let x = _mm256_loadu_si256(of.as_ptr().cast());
                _mm512_cvtepi32_epi64(_mm256_max_epi32(_mm256_sub_epi32(x, offset), zero))
            };
            let (from, to) = (place(&spans.starts), place(&spans.ends));
            let mask =
                _mm512_maskz_andnot_epi64(spans.rows, _mm512_sllv_epi64(ones, to), _mm512_sllv_epi64(ones, from));
            let before = _mm512_loadu_epi64(covered.0.as_ptr().cast());
            let visible = _mm512_andnot_si512(before, mask);
            let both = _mm512_and_si512(before, mask);
            _mm512_storeu_epi64(covered.0.as_mut_ptr().cast(), _mm512_or_si512(before, mask));
            _mm512_storeu_epi64(shows.0.as_mut_ptr().cast(), visible);
            _mm512_storeu_epi64(over.0.as_mut_ptr().cast(), both);
            (
                _mm512_test_epi64_mask(visible, visible),
                _mm512_test_epi64_mask(both, both),
            )
        }
    }

    #[inline(always)]
    fn occupied(self, rows: &[u64; GROUP]) -> u64 {
        // SAFETY: the token proves the instruction set; the load is as long as the array.
        unsafe {
            let rows = _mm512_loadu_epi64(rows.as_ptr().cast());
            _mm512_test_epi8_mask(rows, rows)
        }
    }

    #[inline(always)]
    fn any_of(self, words: &[u64; GROUP], with: u64) -> u8 {
        // SAFETY: the token proves the instruction set; the load is as long as the array.
        unsafe {
            let words = _mm512_loadu_epi64(words.as_ptr().cast());
            _mm512_test_epi64_mask(words, _mm512_set1_epi64(with.cast_signed()))
        }
    }

    #[inline(always)]
    fn common(self, shows: &[u64; GROUP], left: &mut [u64; GROUP], common: &mut [u64; GROUP]) -> (u8, u64) {
        // SAFETY: the token proves the instruction set; loads and stores are as long as their arrays.
        unsafe {
            let shows = _mm512_loadu_epi64(shows.as_ptr().cast());
            let before = _mm512_loadu_epi64(left.as_ptr().cast());
            let (both, rest) = (_mm512_and_si512(shows, before), _mm512_andnot_si512(shows, before));
            _mm512_storeu_epi64(left.as_mut_ptr().cast(), rest);
            _mm512_storeu_epi64(common.as_mut_ptr().cast(), both);
            (_mm512_test_epi64_mask(both, both), _mm512_test_epi8_mask(rest, rest))
        }
    }

    #[inline(always)]
    fn pixels_of(self, spans: &Spans) -> u32 {
        // SAFETY: the token proves the instruction set; loads are as long as the arrays.
        unsafe {
            let (starts, ends) = (
                _mm256_loadu_si256(spans.starts.as_ptr().cast()),
                _mm256_loadu_si256(spans.ends.as_ptr().cast()),
            );
            sum_of(_mm256_maskz_sub_epi32(spans.rows, ends, starts))
        }
    }

    #[inline(always)]
    fn beyond(self, rows: &[u64; GROUP], others: &[u64; GROUP]) -> u8 {
        // SAFETY: the token proves the instruction set; loads are as long as the arrays.
        unsafe {
            let rows = _mm512_loadu_epi64(rows.as_ptr().cast());
            let beyond = _mm512_andnot_si512(_mm512_loadu_epi64(others.as_ptr().cast()), rows);
            _mm512_test_epi64_mask(beyond, beyond)
        }
    }

    #[inline(always)]
    fn restrict(self, rows: &[u64; GROUP], mask: u64, out: &mut [u64; GROUP]) -> u8 {
        // SAFETY: the token proves the instruction set; the load and the store are as long as the arrays.
        unsafe {
            let rows = _mm512_loadu_epi64(rows.as_ptr().cast());
            let rows = _mm512_and_si512(rows, _mm512_set1_epi64(mask.cast_signed()));
            _mm512_storeu_epi64(out.as_mut_ptr().cast(), rows);
            _mm512_test_epi64_mask(rows, rows)
        }
    }

    #[inline(always)]
    fn columns(self, rows: &[u64; GROUP]) -> u64 {
        // SAFETY: the token proves the instruction set; the load is as long as the array.
        unsafe { _mm512_reduce_or_epi64(_mm512_loadu_epi64(rows.as_ptr().cast())).cast_unsigned() }
    }

    #[inline(always)]
    fn up_to(self, a: &[f32; GROUP], b: &[f32; GROUP]) -> u8 {
        // SAFETY: the token proves the instruction set; loads are as long as the arrays.
        unsafe { _mm256_cmp_ps_mask::<_CMP_LE_OQ>(_mm256_loadu_ps(a.as_ptr()), _mm256_loadu_ps(b.as_ptr())) }
    }

    #[inline(always)]
    fn spans(self, lines: &EdgeLines, y: f64, x0: f64, x1: f64, out: &mut Spans) {
        // SAFETY: the token proves the instruction set; stores are as long as the arrays.
        unsafe {
            let rows = _mm512_add_pd(
                _mm512_set1_pd(y),
                _mm512_setr_pd(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0),
            );
            let (first, end) = (_mm512_set1_pd(x0), _mm512_set1_pd(x1));
            let (mut low, mut high) = (first, end);
            for k in 0..3 {
                let x = _mm512_add_pd(
                    _mm512_mul_pd(_mm512_set1_pd(lines.slope[k]), rows),
                    _mm512_set1_pd(lines.offset[k]),
                );
                // The second operand wins over NaN, as in the portable comparison.
                low = _mm512_mask_max_pd(low, lines.left[k], x, low);
                high = _mm512_mask_min_pd(high, lines.right[k], x, high);
            }
            low = _mm512_min_pd(low, end);
            high = _mm512_max_pd(high, first);
            let low = _mm512_cvtpd_epi32(_mm512_roundscale_pd::<{ _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC }>(
                low,
            ));
            let high = _mm512_cvtpd_epi32(_mm512_roundscale_pd::<{ _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC }>(
                high,
            ));
            _mm256_storeu_si256(out.starts.as_mut_ptr().cast(), low);
            _mm256_storeu_si256(out.ends.as_mut_ptr().cast(), high);
            out.rows = _mm256_cmplt_epi32_mask(low, high);
        }
    }

    #[inline(always)]
    fn test(self, depth: &mut Chunk<f32>, items: &mut Chunk<u32>, mask: u16, base: f64, plane: &DepthPlane) -> bool {
        // SAFETY: the token proves the instruction set; chunks are 16 lanes, aligned to 64 bytes.
        unsafe {
            let base = _mm512_set1_pd(base);
            let near = _mm512_cvtpd_ps(_mm512_add_pd(base, _mm512_load_pd(plane.steps.as_ptr())));
            let far = _mm512_cvtpd_ps(_mm512_add_pd(base, _mm512_load_pd(plane.steps.as_ptr().add(8))));
            let z = _mm512_insertf32x8::<1>(_mm512_castps256_ps512(near), far);
            let z = _mm512_max_ps(z, _mm512_set1_ps(plane.plane.low));
            let z = _mm512_min_ps(z, _mm512_set1_ps(plane.plane.high));
            let old = _mm512_load_ps(depth.0.as_ptr());
            let mut won = _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(mask, z, old);
            let equal = _mm512_mask_cmp_ps_mask::<_CMP_EQ_OQ>(mask, z, old);
            let id = _mm512_set1_epi32(plane.id.cast_signed());
            if equal != 0 {
                let old_id = _mm512_load_si512(items.0.as_ptr().cast());
                won |= _mm512_mask_cmplt_epu32_mask(equal, id, old_id);
            }
            // Whether any wins is as good as random: no branch. Whole stores, as what was stored in part is soon
            // read whole.
            _mm512_store_ps(depth.0.as_mut_ptr(), _mm512_mask_mov_ps(old, won, z));
            let old_id = _mm512_load_si512(items.0.as_ptr().cast());
            _mm512_store_si512(items.0.as_mut_ptr().cast(), _mm512_mask_mov_epi32(old_id, won, id));
            won != 0
        }
    }

    #[inline(always)]
    fn nearer(self, depth: &Chunk<f32>, mask: u16, bound: f32) -> bool {
        // SAFETY: the token proves the instruction set; chunks are 16 lanes, aligned to 64 bytes.
        unsafe {
            let depth = _mm512_load_ps(depth.0.as_ptr());
            _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(mask, depth, _mm512_set1_ps(bound)) == mask
        }
    }

    #[inline(always)]
    fn mask(self, flags: &Flags) -> u16 {
        // SAFETY: the token proves the instruction set; flags are 16 lanes, aligned to 64 bytes.
        unsafe {
            let flags = _mm512_load_si512(flags.0.as_ptr().cast());
            _mm512_test_epi32_mask(flags, flags)
        }
    }

    #[inline(always)]
    fn changes(self, items: &Chunk<u32>, before: u32) -> u16 {
        // SAFETY: the token proves the instruction set; chunks are 16 lanes, aligned to 64 bytes.
        unsafe {
            let items = _mm512_load_si512(items.0.as_ptr().cast());
            let before = _mm512_set1_epi32(before.cast_signed());
            _mm512_cmpneq_epi32_mask(items, _mm512_alignr_epi32::<15>(items, before))
        }
    }
}
