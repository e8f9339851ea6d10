//! A box on faces, a face in each lane of a register.

use crate::kernel::bounds::{self, NEAREST, OnFaces, SceneBox, inset};
use crate::kernel::{FaceGrid, Frame, three};
use hemicube_contract::face::Face;
use std::arch::x86_64::*;

/// Least and greatest coordinate of a box along each of the frame's axes, by the operations of [`bounds::on_faces`].
///
/// # Safety
/// The machine has AVX2.
#[target_feature(enable = "avx2")]
#[inline]
pub(crate) unsafe fn along_axes(of: &SceneBox, frame: &Frame) -> (__m256d, __m256d) {
    // SAFETY: the caller's promise of the instruction set; loads are as long as their arrays.
    unsafe {
        let column = |c: usize| _mm256_loadu_pd(frame.columns[c].as_ptr());
        let along = |c: usize| _mm256_set1_pd(of.center[c] - frame.origin[c]);
        let middle = _mm256_add_pd(
            _mm256_add_pd(_mm256_mul_pd(column(0), along(0)), _mm256_mul_pd(column(1), along(1))),
            _mm256_mul_pd(column(2), along(2)),
        );
        let sign = _mm256_set1_pd(-0.0);
        let reach = |c: usize| _mm256_mul_pd(_mm256_andnot_pd(sign, column(c)), _mm256_set1_pd(of.half[c]));
        let half = _mm256_add_pd(_mm256_add_pd(reach(0), reach(1)), reach(2));
        let half = _mm256_add_pd(half, _mm256_set1_pd(1e-14));
        (_mm256_sub_pd(middle, half), _mm256_add_pd(middle, half))
    }
}

/// [`bounds::on_faces`] with one of the four sides in each lane.
///
/// # Safety
/// The machine has the instruction set of the token.
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
pub(super) unsafe fn on_faces(of: &SceneBox, frame: &Frame, faces: u8, touched: bool, out: &mut OnFaces) {
    // The sides follow the top, in the order of the lanes below.
    const FIRST: usize = Face::PosX as usize;
    const _: () = assert!(
        Face::Top as usize == 0
            && FIRST == 1
            && Face::NegX as usize == 2
            && Face::PosY as usize == 3
            && Face::NegY as usize == 4
    );
    (out.boxed, out.at_eye) = (0, 0);
    // SAFETY: the caller's promise of the instruction set; loads are as long as their arrays, and stores begin at lane
    // 1 and end at 4 of the eight.
    unsafe {
        let (low, high) = along_axes(of, frame);
        let sign = _mm256_set1_pd(-0.0);
        let above = _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_NLE_UQ>(high, _mm256_set1_pd(frame.tolerance)));
        if above & 0b100 == 0 {
            return;
        }
        if faces >> Face::Top as u8 & 1 != 0 {
            let (mut low_of, mut high_of) = ([0.0; 4], [0.0; 4]);
            _mm256_storeu_pd(low_of.as_mut_ptr(), low);
            _mm256_storeu_pd(high_of.as_mut_ptr(), high);
            bounds::on_face(
                &three(|c| low_of[c]),
                &three(|c| high_of[c]),
                FaceGrid::new(Face::Top, frame.resolution),
                touched,
                out,
            );
        }
        let sides = i32::from(faces >> FIRST) & 0b1111;
        if sides == 0 {
            return;
        }
        // The frames of the faces, as `Face::axes` gives them: ±x and ±y along w; y, −y, −x and x along u; z along v.
        let (back, front) = (_mm256_xor_pd(low, sign), _mm256_xor_pd(high, sign));
        let along_w = |of| _mm256_permute4x64_pd::<0b01_01_00_00>(of);
        let along_u = |of| _mm256_permute4x64_pd::<0b00_00_01_01>(of);
        let w0 = _mm256_blend_pd::<0b1010>(along_w(low), along_w(front));
        let w1 = _mm256_blend_pd::<0b1010>(along_w(high), along_w(back));
        let u0 = _mm256_blend_pd::<0b0110>(along_u(low), along_u(front));
        let u1 = _mm256_blend_pd::<0b0110>(along_u(high), along_u(back));
        let v0 = _mm256_permute4x64_pd::<0b10_10_10_10>(low);
        let v1 = _mm256_permute4x64_pd::<0b10_10_10_10>(high);
        let zero = _mm256_setzero_pd();
        let outside = _mm256_or_pd(
            _mm256_or_pd(
                _mm256_cmp_pd::<_CMP_LE_OQ>(w1, zero),
                _mm256_cmp_pd::<_CMP_GT_OQ>(u0, w1),
            ),
            _mm256_or_pd(
                _mm256_cmp_pd::<_CMP_LT_OQ>(u1, _mm256_xor_pd(w1, sign)),
                _mm256_or_pd(
                    _mm256_cmp_pd::<_CMP_GT_OQ>(v0, w1),
                    _mm256_cmp_pd::<_CMP_LT_OQ>(v1, zero),
                ),
            ),
        );
        let inside = sides & !_mm256_movemask_pd(outside);
        let nearest = _mm256_mul_pd(_mm256_set1_pd(NEAREST), w1);
        let at_eye = inside & _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(w0, nearest));
        let faces_of = |sides: i32| {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "four bits")]
            let sides = sides as u8;
            sides << FIRST
        };
        out.at_eye |= faces_of(at_eye);
        let inside = inside & !at_eye;
        if inside == 0 {
            return;
        }
        let one = _mm256_set1_pd(1.0);
        let (near, far) = (_mm256_div_pd(one, w0), _mm256_div_pd(one, w1));
        #[allow(clippy::cast_precision_loss, reason = "at most 1024")]
        let width = frame.resolution as f64;
        let half = _mm256_set1_pd(width * 0.5);
        let last_column = _mm256_set1_pd(width - 1.0);
        let last_row = _mm256_set1_pd(width * 0.5 - 1.0);
        let inset = _mm256_set1_pd(inset(touched));
        let positive = |x| _mm256_cmp_pd::<_CMP_GT_OQ>(x, zero);
        let place = |x, scale, shift| _mm256_add_pd(_mm256_mul_pd(_mm256_mul_pd(x, scale), half), shift);
        let first = |x, shift, last| {
            let scale = _mm256_blendv_pd(near, far, positive(x));
            let x = _mm256_add_pd(place(x, scale, shift), inset);
            _mm256_cvttpd_epi32(_mm256_max_pd(_mm256_min_pd(x, last), zero))
        };
        let end = |x, shift, last| {
            let scale = _mm256_blendv_pd(far, near, positive(x));
            _mm256_min_pd(_mm256_sub_pd(place(x, scale, shift), inset), last)
        };
        let (x0, y0) = (first(u0, half, last_column), first(v0, zero, last_row));
        let (x1, y1) = (end(u1, half, last_column), end(v1, zero, last_row));
        let empty = _mm256_or_pd(
            _mm256_cmp_pd::<_CMP_GT_OQ>(_mm256_cvtepi32_pd(x0), x1),
            _mm256_cmp_pd::<_CMP_GT_OQ>(_mm256_cvtepi32_pd(y0), y1),
        );
        out.boxed |= faces_of(inside & !_mm256_movemask_pd(empty));
        _mm256_storeu_pd(out.near.as_mut_ptr().add(FIRST), near);
        _mm_storeu_si128(out.x0.as_mut_ptr().add(FIRST).cast(), x0);
        _mm_storeu_si128(out.x1.as_mut_ptr().add(FIRST).cast(), _mm256_cvttpd_epi32(x1));
        _mm_storeu_si128(out.y0.as_mut_ptr().add(FIRST).cast(), y0);
        _mm_storeu_si128(out.y1.as_mut_ptr().add(FIRST).cast(), _mm256_cvttpd_epi32(y1));
    }
}
