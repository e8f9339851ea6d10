//! Where boxes of the scene lie on the five faces: what both engines ask of every node they meet.

use super::bits::{Coverage, all_covered, at};
use super::{Frame, Lanes, three};
use hemicube_contract::face::Face;

/// A lane for each face, and three that are not used.
const FACES: usize = 8;

/// A node whose nearest point is closer than this part of its farthest is not tested against what was drawn.
const NEAREST: f64 = 1e-6;

/// Positions on a face that boxes are widened by, in pixels.
const SLACK: f64 = 1e-6;

/// The pixels of a box, by face.
#[derive(Clone, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct OnFaces {
    /// 1/w of the nearest point.
    pub(crate) near: [f64; FACES],
    /// The first column.
    pub(crate) x0: [i32; FACES],
    /// The last column.
    pub(crate) x1: [i32; FACES],
    /// The first row of the face.
    pub(crate) y0: [i32; FACES],
    /// The last row of the face.
    pub(crate) y1: [i32; FACES],
    /// Faces of which the above says something.
    pub(crate) boxed: u8,
    /// Faces on which the box is so near that it has no pixels to speak of.
    pub(crate) at_eye: u8,
}

impl OnFaces {
    pub(crate) fn new() -> Self {
        Self {
            near: [0.0; FACES],
            x0: [0; FACES],
            x1: [0; FACES],
            y0: [0; FACES],
            y1: [0; FACES],
            boxed: 0,
            at_eye: 0,
        }
    }

    /// The pixels of the box on a face of which that is known, in the atlas (inclusive).
    #[inline(always)]
    pub(crate) fn in_atlas(&self, face: usize, resolution: usize) -> [usize; 4] {
        #[allow(clippy::cast_possible_truncation, reason = "at most 1024")]
        let first_row = Face::ALL[face].first_row(resolution as u32) as usize;
        let [x0, x1, y0, y1] = [self.x0, self.x1, self.y0, self.y1].map(|of| at(of[face]));
        [x0, x1, first_row + y0, first_row + y1]
    }
}

/// Between a position and the pixel it counts for: with tiny patches all pixels that a box touches, else those whose
/// centres it may cover.
#[inline(always)]
fn inset(touched: bool) -> f64 {
    if touched { 0.0 - SLACK } else { 0.5 - SLACK }
}

#[inline(always)]
pub(super) fn on_faces(
    center: &[f64; 3],
    half_sides: &[f64; 3],
    frame: &Frame,
    resolution: usize,
    faces: u8,
    touched: bool,
    out: &mut OnFaces,
) {
    (out.boxed, out.at_eye) = (0, 0);
    let d = three(|c| center[c] - frame.origin[c]);
    let (mut low, mut high) = ([0.0; 3], [0.0; 3]);
    for a in 0..3 {
        let m = &frame.axes[a];
        let center = m[0] * d[0] + m[1] * d[1] + m[2] * d[2];
        let half = m[0].abs() * half_sides[0] + m[1].abs() * half_sides[1] + m[2].abs() * half_sides[2];
        // Rounding of the sums, far above what it can be and far below what matters.
        let half = half + 1e-14;
        low[a] = center - half;
        high[a] = center + half;
    }
    if high[2] <= frame.tolerance {
        return;
    }
    for face in Face::ALL {
        if faces >> face as u8 & 1 != 0 {
            on_face(&low, &high, face, resolution, touched, out);
        }
    }
}

/// Where a box, given in the hemicube's frame, lies on a face.
#[inline(always)]
fn on_face(low: &[f64; 3], high: &[f64; 3], face: Face, resolution: usize, touched: bool, out: &mut OnFaces) {
    let resolution = resolution as f64;
    let half = resolution * 0.5;
    let inset = inset(touched);
    let lane = face as usize;
    let (axis, sign) = face.axes();
    let range = |c: usize| {
        if sign[c] > 0.0 {
            (low[axis[c]], high[axis[c]])
        } else {
            (-high[axis[c]], -low[axis[c]])
        }
    };
    let ((u0, u1), (v0, v1), (w0, w1)) = (range(0), range(1), range(2));
    let bottom = if face.is_top() { -w1 } else { 0.0 };
    if w1 <= 0.0 || u0 > w1 || u1 < -w1 || v0 > w1 || v1 < bottom {
        return;
    }
    if w0 <= NEAREST * w1 {
        out.at_eye |= 1 << lane;
        return;
    }
    let (near, far) = (1.0 / w0, 1.0 / w1);
    let x0 = u0 * if u0 > 0.0 { far } else { near } * half + half;
    let x1 = u1 * if u1 > 0.0 { near } else { far } * half + half;
    let shift = if face.is_top() { half } else { 0.0 };
    let y0 = v0 * if v0 > 0.0 { far } else { near } * half + shift;
    let y1 = v1 * if v1 > 0.0 { near } else { far } * half + shift;
    let rows = if face.is_top() { resolution } else { half };
    // A box that only touches the right or upper edge belongs to the last pixel, as a centroid on the edge does.
    let x0 = (x0 + inset).min(resolution - 1.0).max(0.0);
    let x1 = (x1 - inset).min(resolution - 1.0);
    let y0 = (y0 + inset).min(rows - 1.0).max(0.0);
    let y1 = (y1 - inset).min(rows - 1.0);
    if x0.trunc() > x1 || y0.trunc() > y1 {
        return;
    }
    out.near[lane] = near;
    #[allow(clippy::cast_possible_truncation, reason = "within the face")]
    {
        out.x0[lane] = x0 as i32;
        out.x1[lane] = x1 as i32;
        out.y0[lane] = y0 as i32;
        out.y1[lane] = y1 as i32;
    }
    out.boxed |= 1 << lane;
}

/// Number of boxes that are tested at once.
pub(crate) const BOXES: usize = 8;

/// Boxes that are tested at once: the children of a node.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct BoxGroup {
    /// The middles, by axis.
    pub(crate) center: [[f64; BOXES]; 3],
    /// Half the sides.
    pub(crate) half: [[f64; BOXES]; 3],
    /// Boxes around what is drawn, and not around other boxes: what is covered of them is remembered.
    pub(crate) leaves: u8,
}

/// On which faces each box of a group may be seen, and on which of the others it is hidden.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct GroupOnFaces {
    pub(crate) visible: [u8; BOXES],
    pub(crate) hidden: [u8; BOXES],
}

/// Tests some boxes against what is covered; with `COVERED`, by all pixels that they touch, which are remembered of
/// leaves that may be seen.
#[inline(always)]
pub(crate) unsafe fn test_group<L: Lanes, const COVERED: bool>(
    group: &BoxGroup,
    mut used: u8,
    frame: &Frame,
    coverage: &mut Coverage,
    faces: u8,
) -> GroupOnFaces {
    let mut out = GroupOnFaces::default();
    let mut one = OnFaces::new();
    let resolution = coverage.resolution;
    while used != 0 {
        let l = used.trailing_zeros() as usize;
        used &= used - 1;
        let (center, half) = (three(|c| group.center[c][l]), three(|c| group.half[c][l]));
        // SAFETY: the caller's promise.
        unsafe { L::on_faces(&center, &half, frame, resolution, faces, COVERED, &mut one) };
        out.visible[l] = one.at_eye;
        let remember = COVERED && group.leaves >> l & 1 != 0;
        if remember && one.at_eye != 0 {
            // So near that it has no pixels to ask for.
            coverage.remember_all();
        }
        let mut boxed = one.boxed;
        while boxed != 0 {
            let face = boxed.trailing_zeros() as usize;
            boxed &= boxed - 1;
            let pixels = [one.x0[face], one.x1[face], one.y0[face], one.y1[face]];
            // SAFETY: the caller's promise.
            unsafe { test_pixels::<L>(pixels, Face::ALL[face], coverage, remember, l, &mut out) };
        }
    }
    out
}

/// Tests the pixels of a box on a face.
#[inline(always)]
unsafe fn test_pixels<L: Lanes>(
    pixels: [i32; 4],
    face: Face,
    coverage: &mut Coverage,
    remember: bool,
    l: usize,
    out: &mut GroupOnFaces,
) {
    #[allow(clippy::cast_possible_truncation, reason = "at most 1024")]
    let first_row = face.first_row(coverage.resolution as u32) as usize;
    let [x0, x1, y0, y1] = pixels.map(at);
    let pixels = [x0, x1, first_row + y0, first_row + y1];
    // SAFETY: the caller's promise.
    if unsafe { all_covered::<L>(coverage, pixels) } {
        out.hidden[l] |= 1 << face as u8;
    } else {
        out.visible[l] |= 1 << face as u8;
        if remember {
            coverage.remember(pixels);
        }
    }
}

/// [`test_group`] with a box in each lane.
///
/// # Safety
/// The machine has AVX-512 F, DQ and VL.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
pub(super) unsafe fn test_group_avx512<L: Lanes, const COVERED: bool>(
    group: &BoxGroup,
    used: u8,
    frame: &Frame,
    coverage: &mut Coverage,
    faces: u8,
) -> GroupOnFaces {
    use std::arch::x86_64::*;
    if used.is_power_of_two() {
        // SAFETY: the caller's promise.
        return unsafe { test_group::<L, COVERED>(group, used, frame, coverage, faces) };
    }
    let mut out = GroupOnFaces::default();
    let resolution = coverage.resolution;
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
                coverage.remember_all();
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
                let remember = COVERED && group.leaves >> l & 1 != 0;
                test_pixels::<L>(pixels.map(|p| p[l]), face, coverage, remember, l, &mut out);
            }
        }
    }
    out
}

/// For each face, which of the lower bounds of x, y, z, a gap, the upper bounds and a gap, and of their negatives from
/// 8 on, is the lower bound along its axis `c`; in the second half, the upper.
#[cfg(target_arch = "x86_64")]
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

#[cfg(target_arch = "x86_64")]
const BOUNDS: [[[i64; FACES]; 2]; 3] = [bounds_along(0), bounds_along(1), bounds_along(2)];

/// The least and the greatest coordinate of a box along each of the frame's axes, by the operations of `on_faces`.
///
/// # Safety
/// The machine has AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn bounds(
    center: &[f64; 3],
    half_sides: &[f64; 3],
    frame: &Frame,
) -> (std::arch::x86_64::__m256d, std::arch::x86_64::__m256d) {
    use std::arch::x86_64::*;
    // SAFETY: the caller's promise of the instruction set; loads are as long as their arrays.
    unsafe {
        let column = |c: usize| _mm256_loadu_pd(frame.columns[c].as_ptr());
        let along = |c: usize| _mm256_set1_pd(center[c] - frame.origin[c]);
        let middle = _mm256_add_pd(
            _mm256_add_pd(_mm256_mul_pd(column(0), along(0)), _mm256_mul_pd(column(1), along(1))),
            _mm256_mul_pd(column(2), along(2)),
        );
        let sign = _mm256_set1_pd(-0.0);
        let reach = |c: usize| _mm256_mul_pd(_mm256_andnot_pd(sign, column(c)), _mm256_set1_pd(half_sides[c]));
        let half = _mm256_add_pd(_mm256_add_pd(reach(0), reach(1)), reach(2));
        let half = _mm256_add_pd(half, _mm256_set1_pd(1e-14));
        (_mm256_sub_pd(middle, half), _mm256_add_pd(middle, half))
    }
}

/// [`on_faces`] with a face in each lane.
///
/// # Safety
/// The machine has AVX-512 F, DQ and VL.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
pub(super) unsafe fn on_faces_avx512(
    center: &[f64; 3],
    half_sides: &[f64; 3],
    frame: &Frame,
    resolution: usize,
    faces: u8,
    touched: bool,
    out: &mut OnFaces,
) {
    use std::arch::x86_64::*;
    const TOP: u8 = 1 << Face::Top as u8;
    (out.boxed, out.at_eye) = (0, 0);
    // SAFETY: the caller's promise of the instruction set; loads and stores are as long as their arrays.
    unsafe {
        let (low, high) = bounds(center, half_sides, frame);
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
        let width = resolution as f64;
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

/// [`on_faces`] with one of the four sides in each lane.
///
/// # Safety
/// The machine has AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
pub(super) unsafe fn on_faces_avx2(
    center: &[f64; 3],
    half_sides: &[f64; 3],
    frame: &Frame,
    resolution: usize,
    faces: u8,
    touched: bool,
    out: &mut OnFaces,
) {
    use std::arch::x86_64::*;
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
        let (low, high) = bounds(center, half_sides, frame);
        let sign = _mm256_set1_pd(-0.0);
        let above = _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_NLE_UQ>(high, _mm256_set1_pd(frame.tolerance)));
        if above & 0b100 == 0 {
            return;
        }
        if faces >> Face::Top as u8 & 1 != 0 {
            let (mut low_of, mut high_of) = ([0.0; 4], [0.0; 4]);
            _mm256_storeu_pd(low_of.as_mut_ptr(), low);
            _mm256_storeu_pd(high_of.as_mut_ptr(), high);
            on_face(
                &three(|c| low_of[c]),
                &three(|c| high_of[c]),
                Face::Top,
                resolution,
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
        let width = resolution as f64;
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A frame that looks along a direction and is turned about it.
    fn frame() -> impl Strategy<Value = Frame> {
        let angle = prop_oneof![4 => -7.0..7.0f64, 1 => Just(0.0)];
        (prop::array::uniform3(-1.0..1.0f64), angle.clone(), angle.clone(), angle).prop_map(|(origin, a, b, c)| {
            let turn = glam::DMat3::from_euler(glam::EulerRot::ZYX, a, b, c);
            Frame::new(origin, turn.to_cols_array_2d(), 1e-9, 0)
        })
    }

    /// Boxes beside, around and far from the eye, some of them flat.
    fn scene_box() -> impl Strategy<Value = ([f64; 3], [f64; 3])> {
        let side = prop_oneof![1 => Just(0.0), 2 => 0.0..1e-3f64, 4 => 0.0..2.0f64];
        (prop::array::uniform3(-2.0..2.0f64), prop::array::uniform3(side))
    }

    fn same_on_every_path<const COVERED: bool>(
        group: &BoxGroup,
        used: u8,
        frame: &Frame,
        coverage: &mut Coverage,
        faces: u8,
    ) -> Result<(), TestCaseError> {
        use crate::kernel::{Kernel, Portable};
        type Path = unsafe fn(&BoxGroup, u8, &Frame, &mut Coverage, u8) -> GroupOnFaces;
        // SAFETY: the portable path needs no instruction set.
        let portable = unsafe { <Portable as Kernel>::test_group::<COVERED>(group, used, frame, coverage, faces) };
        let mut both = portable.hidden.iter().zip(&portable.visible);
        prop_assert!(both.all(|(hidden, visible)| hidden & visible == 0));
        for isa in crate::Isa::available() {
            let path: Path = match isa {
                #[cfg(target_arch = "x86_64")]
                crate::Isa::Avx512 => <super::super::x86::Avx512 as Kernel>::test_group::<COVERED>,
                #[cfg(target_arch = "x86_64")]
                crate::Isa::Avx2 => <super::super::x86::Avx2 as Kernel>::test_group::<COVERED>,
                _ => continue,
            };
            // SAFETY: the machine has the instruction set.
            let wide = unsafe { path(group, used, frame, coverage, faces) };
            prop_assert_eq!(portable, wide);
        }
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        #[cfg(target_arch = "x86_64")]
        #[test]
        fn boxes_are_the_same_on_every_path(
            frame in frame(),
            (center, half) in scene_box(),
            resolution in prop::sample::select(vec![16usize, 128, 256, 1024]),
            faces in 0u8..32,
            touched in any::<bool>(),
        ) {
            type Path = unsafe fn(&[f64; 3], &[f64; 3], &Frame, usize, u8, bool, &mut OnFaces);
            let (mut portable, mut wide) = (OnFaces::new(), OnFaces::new());
            on_faces(&center, &half, &frame, resolution, faces, touched, &mut portable);
            for isa in crate::Isa::available() {
                let path: Path = match isa {
                    crate::Isa::Avx512 => on_faces_avx512,
                    crate::Isa::Avx2 => on_faces_avx2,
                    crate::Isa::Portable => continue,
                };
                // SAFETY: the machine has the instruction set.
                unsafe { path(&center, &half, &frame, resolution, faces, touched, &mut wide) };
                prop_assert_eq!((portable.boxed, portable.at_eye), (wide.boxed, wide.at_eye));
                for f in (0..FACES).filter(|f| portable.boxed >> f & 1 != 0) {
                    let of = |b: &OnFaces| (b.near[f].to_bits(), b.x0[f], b.x1[f], b.y0[f], b.y1[f]);
                    prop_assert_eq!(of(&portable), of(&wide));
                }
            }
        }

        #[test]
        fn a_group_of_boxes_is_tested_as_each_of_them(
            frame in frame(),
            boxes in prop::collection::vec(scene_box(), BOXES),
            covered in prop::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>(), 0usize..40), 0..60),
            resolution in prop::sample::select(vec![16u32, 128, 256]),
            (faces, used) in (0u8..32, any::<u8>()),
            touched in any::<bool>(),
        ) {
            let mut group = BoxGroup { center: [[0.0; BOXES]; 3], half: [[0.0; BOXES]; 3], leaves: 0b1010_0110 };
            for (l, (center, half)) in boxes.iter().enumerate() {
                for c in 0..3 {
                    (group.center[c][l], group.half[c][l]) = (center[c], half[c]);
                }
            }
            let mut coverage = Coverage::new(resolution, true);
            let side = resolution as usize;
            for (x, y, size) in covered {
                let (x, y) = (x.index(side), y.index(3 * side));
                coverage.cover([x, (x + size).min(side - 1), y, (y + size).min(3 * side - 1)]);
            }
            if touched {
                same_on_every_path::<true>(&group, used, &frame, &mut coverage, faces)?;
            } else {
                same_on_every_path::<false>(&group, used, &frame, &mut coverage, faces)?;
            }
        }

        #[test]
        fn what_lies_in_a_box_lies_in_its_pixels(
            frame in frame(),
            (center, half) in scene_box(),
            place in prop::array::uniform3(-1.0..=1.0f64),
            resolution in prop::sample::select(vec![16usize, 128, 256, 1024]),
        ) {
            let mut boxes = OnFaces::new();
            on_faces(&center, &half, &frame, resolution, 0b1_1111, true, &mut boxes);
            let d = three(|c| center[c] + half[c] * place[c] - frame.origin[c]);
            let [x, y, z] = three(|a| frame.axes[a][0] * d[0] + frame.axes[a][1] * d[1] + frame.axes[a][2] * d[2]);
            if z <= 1e-6 {
                return Ok(());
            }
            for face in Face::ALL {
                let (axis, sign) = face.axes();
                let [u, v, w] = three(|c| sign[c] * [x, y, z][axis[c]]);
                let lowest = if face.is_top() { -w } else { 0.0 };
                if w <= 0.0 || u.abs() > w || v > w || v < lowest {
                    continue;
                }
                let lane = face as usize;
                if boxes.at_eye >> lane & 1 != 0 {
                    continue;
                }
                prop_assert!(boxes.boxed >> lane & 1 != 0, "{:?}", face);
                prop_assert!(1.0 / w <= boxes.near[lane] * (1.0 + 1e-12));
                let half = resolution as f64 * 0.5;
                let rows = if face.is_top() { resolution as f64 } else { half };
                let shift = if face.is_top() { half } else { 0.0 };
                let column = (u / w * half + half).min(resolution as f64 - 1.0).floor();
                let row = (v / w * half + shift).min(rows - 1.0).floor();
                prop_assert!((f64::from(boxes.x0[lane])..=f64::from(boxes.x1[lane])).contains(&column));
                prop_assert!((f64::from(boxes.y0[lane])..=f64::from(boxes.y1[lane])).contains(&row));
            }
        }
    }
}
