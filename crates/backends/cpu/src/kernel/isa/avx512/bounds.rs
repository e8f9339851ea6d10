//! Boxes on faces: eight boxes on one face, or one box on all faces, in the lanes of a register.

use super::Avx512;
use crate::kernel::bounds::{self, BOXES, BoxGroup, FACES, GroupOnFaces, NEAREST, OnFaces, SceneBox, inset, is_hidden};
use crate::kernel::coverage::OrderedCoverage;
use crate::kernel::isa::avx2::along_axes;
use crate::kernel::{Frame, three};
use hemicube_contract::face::Face;
use std::arch::x86_64::*;

/// [`bounds::test_group`] with a box in each lane.
///
/// # Safety
/// The machine has the instruction set of the token.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
pub(super) unsafe fn test_group<const COVERED: bool>(
    isa: Avx512,
    group: &BoxGroup,
    used: u8,
    frame: &Frame,
    canvas: &mut OrderedCoverage,
    faces: u8,
) -> GroupOnFaces {
    if used.is_power_of_two() {
        return bounds::test_group::<_, COVERED>(isa, group, used, frame, canvas, faces);
    }
    let mut out = GroupOnFaces::default();
    let resolution = frame.resolution;
    // SAFETY: the caller's promise of the instruction set; loads and stores are as long as their arrays.
    unsafe {
        let all = _mm512_set1_pd;
        let sign_bit = all(-0.0);
        let d: [__m512d; 3] = three(|c| _mm512_sub_pd(_mm512_load_pd(group.center[c].as_ptr()), all(frame.origin[c])));
        let half_sides: [__m512d; 3] = three(|c| _mm512_load_pd(group.half[c].as_ptr()));
        let along = |m: [f64; 3], v: &[__m512d; 3]| {
            let [x, y, z] = three(|c| _mm512_mul_pd(all(m[c]), v[c]));
            _mm512_add_pd(_mm512_add_pd(x, y), z)
        };
        let bounds: [(__m512d, __m512d); 3] = three(|a| {
            let m = frame.axes[a];
            let middle = along(m, &d);
            let half = _mm512_add_pd(along(m.map(f64::abs), &half_sides), all(1e-14));
            (_mm512_sub_pd(middle, half), _mm512_add_pd(middle, half))
        });
        let used = used & _mm512_cmp_pd_mask::<_CMP_NLE_UQ>(bounds[2].1, all(frame.tolerance));
        if used == 0 {
            return out;
        }
        let (zero, one) = (_mm512_setzero_pd(), all(1.0));
        #[allow(clippy::cast_precision_loss, reason = "at most 1024")]
        let width = resolution as f64;
        let half_width = all(width * 0.5);
        let (inset, last_column) = (all(inset(COVERED)), all(width - 1.0));
        let positive = |x| _mm512_cmp_pd_mask::<_CMP_GT_OQ>(x, zero);
        for face in Face::ALL {
            if faces >> face as u8 & 1 == 0 {
                continue;
            }
            let (axis, sign) = face.axes();
            let range = |c: usize| {
                let (low, high) = bounds[axis[c]];
                if sign[c] > 0.0 {
                    (low, high)
                } else {
                    (_mm512_xor_pd(high, sign_bit), _mm512_xor_pd(low, sign_bit))
                }
            };
            let ((u0, u1), (v0, v1), (w0, w1)) = (range(0), range(1), range(2));
            let back = _mm512_xor_pd(w1, sign_bit);
            let bottom = if face.is_top() { back } else { zero };
            let outside = _mm512_cmp_pd_mask::<_CMP_LE_OQ>(w1, zero)
                | _mm512_cmp_pd_mask::<_CMP_GT_OQ>(u0, w1)
                | _mm512_cmp_pd_mask::<_CMP_LT_OQ>(u1, back)
                | _mm512_cmp_pd_mask::<_CMP_GT_OQ>(v0, w1)
                | _mm512_cmp_pd_mask::<_CMP_LT_OQ>(v1, bottom);
            let inside = used & !outside;
            if inside == 0 {
                continue;
            }
            let mut at_eye = inside & _mm512_cmp_pd_mask::<_CMP_LE_OQ>(w0, _mm512_mul_pd(all(NEAREST), w1));
            let inside = inside & !at_eye;
            if COVERED && at_eye & group.leaves != 0 {
                canvas.snapshot_all();
            }
            while at_eye != 0 {
                out.visible[at_eye.trailing_zeros() as usize] |= 1 << face as u8;
                at_eye &= at_eye - 1;
            }
            if inside == 0 {
                continue;
            }
            let (near, far) = (_mm512_div_pd(one, w0), _mm512_div_pd(one, w1));
            let (shift, last_row) = if face.is_top() {
                (half_width, last_column)
            } else {
                (zero, all(width * 0.5 - 1.0))
            };
            let place = |x, scale, shift| _mm512_add_pd(_mm512_mul_pd(_mm512_mul_pd(x, scale), half_width), shift);
            let first = |x, shift, last| {
                let scale = _mm512_mask_mov_pd(near, positive(x), far);
                let x = _mm512_add_pd(place(x, scale, shift), inset);
                _mm512_cvttpd_epi32(_mm512_max_pd(_mm512_min_pd(x, last), zero))
            };
            let end = |x, shift, last| {
                let scale = _mm512_mask_mov_pd(far, positive(x), near);
                _mm512_min_pd(_mm512_sub_pd(place(x, scale, shift), inset), last)
            };
            let (x0, y0) = (first(u0, half_width, last_column), first(v0, shift, last_row));
            let (x1, y1) = (end(u1, half_width, last_column), end(v1, shift, last_row));
            let empty = _mm512_cmp_pd_mask::<_CMP_GT_OQ>(_mm512_cvtepi32_pd(x0), x1)
                | _mm512_cmp_pd_mask::<_CMP_GT_OQ>(_mm512_cvtepi32_pd(y0), y1);
            let mut pending = inside & !empty;
            let (x1, y1) = (_mm512_cvttpd_epi32(x1), _mm512_cvttpd_epi32(y1));
            let mut pixels = [[0i32; BOXES]; 4];
            for (out, lanes) in pixels.iter_mut().zip([x0, x1, y0, y1]) {
                _mm256_storeu_si256(out.as_mut_ptr().cast(), lanes);
            }
            while pending != 0 {
                let l = pending.trailing_zeros() as usize;
                pending &= pending - 1;
                let snapshot = COVERED && group.leaves >> l & 1 != 0;
                let is_hidden = is_hidden(isa, pixels.map(|p| p[l]), face, canvas, snapshot);
                out.add(l, face, is_hidden);
            }
        }
    }
    out
}

/// Lane indices that pick, for each face, the lower bound along its axis `c` (first half) and the upper (second) from
/// [lower x, y, z, gap, upper x, y, z, gap], and from 8 on from their negatives.
const fn bounds_along(c: usize) -> [[i64; FACES]; 2] {
    let mut lanes = [[0; FACES]; 2];
    let mut f = 0;
    while f < Face::ALL.len() {
        let (axis, sign) = Face::ALL[f].axes();
        #[allow(clippy::cast_possible_wrap, reason = "below 3")]
        let axis = axis[c] as i64;
        (lanes[0][f], lanes[1][f]) = if sign[c] > 0.0 {
            (axis, 4 + axis)
        } else {
            (8 + 4 + axis, 8 + axis)
        };
        f += 1;
    }
    lanes
}

const BOUNDS: [[[i64; FACES]; 2]; 3] = [bounds_along(0), bounds_along(1), bounds_along(2)];

/// [`bounds::on_faces`] with a face in each lane.
///
/// # Safety
/// The machine has the instruction set of the token.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
pub(super) unsafe fn on_faces(of: &SceneBox, frame: &Frame, faces: u8, touched: bool, out: &mut OnFaces) {
    const TOP: u8 = 1 << Face::Top as u8;
    (out.boxed, out.at_eye) = (0, 0);
    // SAFETY: the caller's promise; loads and stores are as long as their arrays.
    unsafe {
        let (low, high) = along_axes(of, frame);
        let above = _mm256_cmp_pd_mask::<_CMP_NLE_UQ>(high, _mm256_set1_pd(frame.tolerance));
        if above & 0b100 == 0 {
            return;
        }
        let bounds = _mm512_insertf64x4::<1>(_mm512_castpd256_pd512(low), high);
        let negative = _mm512_xor_pd(bounds, _mm512_set1_pd(-0.0));
        let along = |c: usize, end: usize| {
            let lanes = _mm512_loadu_epi64(BOUNDS[c][end].as_ptr());
            _mm512_permutex2var_pd(bounds, lanes, negative)
        };
        let (u0, u1, v0, v1, w0, w1) = (
            along(0, 0),
            along(0, 1),
            along(1, 0),
            along(1, 1),
            along(2, 0),
            along(2, 1),
        );
        let zero = _mm512_setzero_pd();
        let back = _mm512_xor_pd(w1, _mm512_set1_pd(-0.0));
        let bottom = _mm512_maskz_mov_pd(TOP, back);
        let outside = _mm512_cmp_pd_mask::<_CMP_LE_OQ>(w1, zero)
            | _mm512_cmp_pd_mask::<_CMP_GT_OQ>(u0, w1)
            | _mm512_cmp_pd_mask::<_CMP_LT_OQ>(u1, back)
            | _mm512_cmp_pd_mask::<_CMP_GT_OQ>(v0, w1)
            | _mm512_cmp_pd_mask::<_CMP_LT_OQ>(v1, bottom);
        let inside = faces & !outside;
        let at_eye = inside & _mm512_cmp_pd_mask::<_CMP_LE_OQ>(w0, _mm512_mul_pd(_mm512_set1_pd(NEAREST), w1));
        out.at_eye = at_eye;
        let inside = inside & !at_eye;
        if inside == 0 {
            return;
        }
        let one = _mm512_set1_pd(1.0);
        let (near, far) = (_mm512_div_pd(one, w0), _mm512_div_pd(one, w1));
        #[allow(clippy::cast_precision_loss, reason = "at most 1024")]
        let width = frame.resolution as f64;
        let half = _mm512_set1_pd(width * 0.5);
        let shift = _mm512_maskz_mov_pd(TOP, half);
        let last_column = _mm512_set1_pd(width - 1.0);
        let last_row = _mm512_mask_mov_pd(_mm512_set1_pd(width * 0.5 - 1.0), TOP, last_column);
        let inset = _mm512_set1_pd(inset(touched));
        let positive = |x| _mm512_cmp_pd_mask::<_CMP_GT_OQ>(x, zero);
        let place = |x, scale, shift| _mm512_add_pd(_mm512_mul_pd(_mm512_mul_pd(x, scale), half), shift);
        let first = |x, shift, last| {
            let scale = _mm512_mask_mov_pd(near, positive(x), far);
            let x = _mm512_add_pd(place(x, scale, shift), inset);
            _mm512_cvttpd_epi32(_mm512_max_pd(_mm512_min_pd(x, last), zero))
        };
        let end = |x, shift, last| {
            let scale = _mm512_mask_mov_pd(far, positive(x), near);
            _mm512_min_pd(_mm512_sub_pd(place(x, scale, shift), inset), last)
        };
        let (x0, y0) = (first(u0, half, last_column), first(v0, shift, last_row));
        let (x1, y1) = (end(u1, half, last_column), end(v1, shift, last_row));
        let empty = _mm512_cmp_pd_mask::<_CMP_GT_OQ>(_mm512_cvtepi32_pd(x0), x1)
            | _mm512_cmp_pd_mask::<_CMP_GT_OQ>(_mm512_cvtepi32_pd(y0), y1);
        out.boxed = inside & !empty;
        _mm512_storeu_pd(out.near.as_mut_ptr(), near);
        _mm256_storeu_si256(out.x0.as_mut_ptr().cast(), x0);
        _mm256_storeu_si256(out.x1.as_mut_ptr().cast(), _mm512_cvttpd_epi32(x1));
        _mm256_storeu_si256(out.y0.as_mut_ptr().cast(), y0);
        _mm256_storeu_si256(out.y1.as_mut_ptr().cast(), _mm512_cvttpd_epi32(y1));
    }
}
