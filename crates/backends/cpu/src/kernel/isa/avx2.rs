//! AVX2, with the bit instructions of its generation.

mod bounds;
mod lane;

use super::{Flags, Lanes};
use crate::kernel::bounds::{OnFaces, SceneBox};
use crate::kernel::coverage::Canvas;
use crate::kernel::depth::{Chunk, DepthPlane};
use crate::kernel::ordered::{BlockOnFace, DrawnLane};
use crate::kernel::spans::{EdgeLines, Spans};
use crate::kernel::{Frame, GROUP};
pub(super) use bounds::along_axes;
pub(super) use lane::{edge_values, sum_of, weigh, weight_of_row};
use std::arch::x86_64::*;
use std::ops::Range;

/// Token of AVX2, BMI1, BMI2, LZCNT and POPCNT.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2(());

impl Avx2 {
    /// Asks the processor.
    pub(super) fn detect() -> Option<Self> {
        let has = is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt");
        has.then_some(Self(()))
    }
}

impl Lanes for Avx2 {
    #[inline(always)]
    fn on_faces(self, of: &SceneBox, frame: &Frame, faces: u8, touched: bool, out: &mut OnFaces) {
        // SAFETY: the token proves the instruction set.
        unsafe { bounds::on_faces(of, frame, faces, touched, out) };
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
        // SAFETY: the token proves the instruction set.
        unsafe { lane::lacking(rows, mask) }
    }

    #[inline(always)]
    fn spans(self, lines: &EdgeLines, y: f64, x0: f64, x1: f64, out: &mut Spans) {
        // SAFETY: the token proves the instruction set; each half stores four of the eight entries.
        unsafe {
            out.rows = 0;
            let (first, end) = (_mm256_set1_pd(x0), _mm256_set1_pd(x1));
            let side = |bits: u8| _mm256_castsi256_pd(_mm256_set1_epi8(bits.cast_signed()));
            for half in 0..2 {
                let rows = _mm256_add_pd(
                    _mm256_set1_pd(y),
                    if half == 0 {
                        _mm256_setr_pd(0.0, 1.0, 2.0, 3.0)
                    } else {
                        _mm256_setr_pd(4.0, 5.0, 6.0, 7.0)
                    },
                );
                let (mut low, mut high) = (first, end);
                for k in 0..3 {
                    let x = _mm256_add_pd(
                        _mm256_mul_pd(_mm256_set1_pd(lines.slope[k]), rows),
                        _mm256_set1_pd(lines.offset[k]),
                    );
                    // Which side an edge is on is as good as random: no branch.
                    low = _mm256_blendv_pd(low, _mm256_max_pd(x, low), side(lines.left[k]));
                    high = _mm256_blendv_pd(high, _mm256_min_pd(x, high), side(lines.right[k]));
                }
                low = _mm256_min_pd(low, end);
                high = _mm256_max_pd(high, first);
                let low = _mm256_cvtpd_epi32(_mm256_ceil_pd(low));
                let high = _mm256_cvtpd_epi32(_mm256_ceil_pd(high));
                _mm_storeu_si128(out.starts.as_mut_ptr().add(4 * half).cast(), low);
                _mm_storeu_si128(out.ends.as_mut_ptr().add(4 * half).cast(), high);
                let below = _mm_movemask_ps(_mm_castsi128_ps(_mm_cmplt_epi32(low, high)));
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "four bits")]
                {
                    out.rows |= (below as u8) << (4 * half);
                }
            }
        }
    }

    #[inline(always)]
    fn test(self, depth: &mut Chunk<f32>, items: &mut Chunk<u32>, mask: u16, base: f64, plane: &DepthPlane) -> bool {
        // SAFETY: the token proves the instruction set; each half is eight of the sixteen lanes, aligned to
        // 32 bytes.
        unsafe {
            let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let id = _mm256_set1_epi32(plane.id.cast_signed());
            let mut any = false;
            for half in 0..2 {
                let wanted = _mm256_set1_epi32(i32::from(mask >> (8 * half)));
                let wanted = _mm256_cmpeq_epi32(_mm256_and_si256(wanted, bits), bits);
                let depth_at = depth.0.as_mut_ptr().add(8 * half);
                let items_at = items.0.as_mut_ptr().add(8 * half).cast::<__m256i>();
                let steps = plane.steps.as_ptr().add(8 * half);
                let base = _mm256_set1_pd(base);
                let near = _mm256_cvtpd_ps(_mm256_add_pd(base, _mm256_load_pd(steps)));
                let far = _mm256_cvtpd_ps(_mm256_add_pd(base, _mm256_load_pd(steps.add(4))));
                let z = _mm256_set_m128(far, near);
                let z = _mm256_max_ps(z, _mm256_set1_ps(plane.plane.low));
                let z = _mm256_min_ps(z, _mm256_set1_ps(plane.plane.high));
                let old = _mm256_load_ps(depth_at);
                let old_id = _mm256_load_si256(items_at);
                let nearer = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_GT_OQ>(z, old));
                let equal = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_EQ_OQ>(z, old));
                // Ids are below 2³¹, so a signed comparison will do.
                let smaller = _mm256_cmpgt_epi32(old_id, id);
                let won = _mm256_and_si256(wanted, _mm256_or_si256(nearer, _mm256_and_si256(equal, smaller)));
                // Whether any wins is as good as random: no branch.
                _mm256_store_ps(depth_at, _mm256_blendv_ps(old, z, _mm256_castsi256_ps(won)));
                _mm256_store_si256(items_at, _mm256_blendv_epi8(old_id, id, won));
                any |= _mm256_testz_si256(won, won) == 0;
            }
            any
        }
    }

    #[inline(always)]
    fn nearer(self, depth: &Chunk<f32>, mask: u16, bound: f32) -> bool {
        // SAFETY: the token proves the instruction set; each half is eight of the sixteen lanes.
        unsafe {
            let half = |k: usize| {
                let depth = _mm256_load_ps(depth.0.as_ptr().add(8 * k));
                _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(depth, _mm256_set1_ps(bound)))
            };
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "sixteen bits")]
            let nearer = (half(0) | half(1) << 8) as u16;
            nearer & mask == mask
        }
    }

    #[inline(always)]
    fn mask(self, flags: &Flags) -> u16 {
        // SAFETY: the token proves the instruction set; each half is eight of the sixteen flags.
        unsafe {
            let zero = _mm256_setzero_si256();
            let half = |k: usize| {
                let flags = _mm256_load_si256(flags.0.as_ptr().add(8 * k).cast());
                _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpgt_epi32(flags, zero)))
            };
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "sixteen bits")]
            {
                (half(0) | half(1) << 8) as u16
            }
        }
    }

    #[inline(always)]
    fn changes(self, items: &Chunk<u32>, before: u32) -> u16 {
        // SAFETY: the token proves the instruction set; the second half's left neighbours start at lane 7.
        unsafe {
            let p = items.0.as_ptr();
            let rotate = _mm256_setr_epi32(7, 0, 1, 2, 3, 4, 5, 6);
            let low = _mm256_load_si256(p.cast());
            let shifted = _mm256_permutevar8x32_epi32(low, rotate);
            let shifted = _mm256_blend_epi32::<1>(shifted, _mm256_set1_epi32(before.cast_signed()));
            let high = _mm256_load_si256(p.add(8).cast());
            let high_shifted = _mm256_loadu_si256(p.add(7).cast());
            let same = |a, b| _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(a, b)));
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "sixteen bits")]
            {
                !((same(low, shifted) | same(high, high_shifted) << 8) as u16)
            }
        }
    }
}
