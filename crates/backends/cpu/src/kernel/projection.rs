//! Bounding boxes of triangles on a face, in pixels.

use super::isa::{Flags, Lanes};
use super::{FaceGrid, Transformed, greater, smaller, three};
use hemicube_contract::bvh::LANES;

/// A box of a face's pixels: `x0..x1` by `y0..y1`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelBox {
    pub(super) x0: i32,
    pub(super) x1: i32,
    pub(super) y0: i32,
    pub(super) y1: i32,
}

impl PixelBox {
    /// Adds a rim of one pixel: a box of centres becomes a box of all touched pixels.
    #[inline(always)]
    pub(super) fn wider(self, grid: FaceGrid) -> Self {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_possible_wrap,
            reason = "at most 1024"
        )]
        let width = grid.resolution as i32;
        let height = if grid.face.is_top() { width } else { width / 2 };
        Self {
            x0: (self.x0 - 1).max(0),
            x1: (self.x1 + 1).min(width),
            y0: (self.y0 - 1).max(0),
            y1: (self.y1 + 1).min(height),
        }
    }
}

/// Converts a place in a pixel box, never negative.
#[inline(always)]
pub(super) fn at(x: i32) -> usize {
    #[allow(clippy::cast_sign_loss, reason = "a pixel box lies within its face")]
    let at = x as u32;
    at as usize
}

/// Bounding boxes of sixteen triangles on a face. Aligned: whole registers are stored, and lanes read soon after.
#[repr(C, align(64))]
pub(super) struct TriangleBoxes {
    pub(super) x0: [i32; LANES],
    pub(super) x1: [i32; LANES],
    pub(super) y0: [i32; LANES],
    pub(super) y1: [i32; LANES],
    /// Least and greatest 1/w.
    pub(super) low: [f32; LANES],
    pub(super) high: [f32; LANES],
    /// Lanes wholly in front of the eye, with a non-empty box.
    pub(super) in_front: u16,
    /// Lanes partly behind the eye (w ≤ 0), or nearly.
    pub(super) straddling: u16,
}

impl TriangleBoxes {
    /// The pixels of a lane in front of the eye.
    #[inline(always)]
    pub(super) fn of_lane(&self, lane: usize) -> PixelBox {
        PixelBox {
            x0: self.x0[lane],
            x1: self.x1[lane],
            y0: self.y0[lane],
            y1: self.y1[lane],
        }
    }
}

/// Widening of a box beyond the projected f32 corners, in pixels: spans are f64.
const BOX_SLACK: f32 = 2e-3;
/// A triangle straddles the eye plane if its nearest corner is closer than this part of its farthest.
const STRADDLE: f32 = 1e-6;
/// Relative widening of 1/w at a corner, above the rounding inside the triangle.
const DEPTH_SLACK: f32 = 1e-6;

/// Projects sixteen triangles onto a face.
#[inline(always)]
pub(super) fn project<L: Lanes>(isa: L, t: &Transformed, grid: FaceGrid) -> TriangleBoxes {
    let (axis, sign) = grid.face.axes();
    #[allow(clippy::cast_possible_truncation, reason = "±1")]
    let s = [sign[0] as f32, sign[1] as f32, sign[2] as f32];
    let width = grid.resolution as f32;
    let height = if grid.face.is_top() { width } else { width * 0.5 };
    let half = width * 0.5;
    // Pixel x has its centre at (x + ½) 2/N − 1.
    let (u_shift, v_shift) = (half - 0.5, if grid.face.is_top() { half - 0.5 } else { -0.5 });
    let mut out = TriangleBoxes {
        x0: [0; LANES],
        x1: [0; LANES],
        y0: [0; LANES],
        y1: [0; LANES],
        low: [0.0; LANES],
        high: [0.0; LANES],
        in_front: 0,
        straddling: 0,
    };
    let mut boxed = Flags([0; LANES]);
    let mut straddling = Flags([0; LANES]);
    for l in 0..LANES {
        let w = [
            s[2] * t.near[axis[2]][l],
            s[2] * t.near[3 + axis[2]][l],
            s[2] * t.near[6 + axis[2]][l],
        ];
        let u = [
            s[0] * t.near[axis[0]][l],
            s[0] * t.near[3 + axis[0]][l],
            s[0] * t.near[6 + axis[0]][l],
        ];
        let v = [
            s[1] * t.near[axis[1]][l],
            s[1] * t.near[3 + axis[1]][l],
            s[1] * t.near[6 + axis[1]][l],
        ];
        let far = greater(greater(w[0], w[1]), w[2]);
        let near = smaller(smaller(w[0], w[1]), w[2]);
        let i = [1.0 / w[0], 1.0 / w[1], 1.0 / w[2]];
        let x = [
            u[0] * i[0] * half + u_shift,
            u[1] * i[1] * half + u_shift,
            u[2] * i[2] * half + u_shift,
        ];
        let y = [
            v[0] * i[0] * half + v_shift,
            v[1] * i[1] * half + v_shift,
            v[2] * i[2] * half + v_shift,
        ];
        // The comparisons send NaN to a bound, so that the conversions below are in range for every lane.
        let x0 = smaller(greater(smaller(smaller(x[0], x[1]), x[2]) - BOX_SLACK, -0.5), width);
        let x1 = greater(
            smaller(greater(greater(x[0], x[1]), x[2]) + BOX_SLACK, width - 1.0),
            -1.0,
        );
        let y0 = smaller(greater(smaller(smaller(y[0], y[1]), y[2]) - BOX_SLACK, -0.5), height);
        let y1 = greater(
            smaller(greater(greater(y[0], y[1]), y[2]) + BOX_SLACK, height - 1.0),
            -1.0,
        );
        out.x0[l] = ceil_to_int(x0);
        out.x1[l] = floor_to_int(x1) + 1;
        out.y0[l] = ceil_to_int(y0);
        out.y1[l] = floor_to_int(y1) + 1;
        let in_front = near > STRADDLE * far;
        boxed.0[l] = u32::from(in_front & (out.x0[l] < out.x1[l]) & (out.y0[l] < out.y1[l]));
        straddling.0[l] = u32::from(!in_front & (far > 0.0));
        out.low[l] = greater(
            smaller(smaller(i[0], i[1]), i[2]) * (1.0 - DEPTH_SLACK),
            f32::MIN_POSITIVE,
        );
        out.high[l] = greater(greater(i[0], i[1]), i[2]) * (1.0 + DEPTH_SLACK);
    }
    out.in_front = isa.mask(&boxed) & t.live;
    out.straddling = isa.mask(&straddling) & t.live;
    out
}

/// ⌈x⌉ for −1 ≤ x ≤ 2³⁰.
#[inline(always)]
fn ceil_to_int(x: f32) -> i32 {
    // SAFETY: callers clamp to the pixels of a face, by comparisons that NaN fails.
    let i: i32 = unsafe { x.to_int_unchecked() };
    i + i32::from((i as f32) < x)
}

/// ⌊x⌋ for −1 ≤ x ≤ 2³⁰.
#[inline(always)]
fn floor_to_int(x: f32) -> i32 {
    // SAFETY: as above.
    let i: i32 = unsafe { x.to_int_unchecked() };
    i - i32::from((i as f32) > x)
}

/// Bounding box of a straddling triangle's visible part: clipped to the face's pyramid, in f64.
pub(super) fn clipped_box(t: &Transformed, grid: FaceGrid, lane: usize) -> Option<PixelBox> {
    let (axis, sign) = grid.face.axes();
    let corner = |k: usize| three(|c| sign[c] * t.corners[3 * k + axis[c]][lane]);
    let mut polygon = [[0.0f64; 3]; 8];
    for (k, p) in polygon.iter_mut().take(3).enumerate() {
        *p = corner(k);
    }
    let mut count = 3;
    let bottom = if grid.face.is_top() { 1.0 } else { 0.0 };
    for plane in [[1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [0.0, 1.0, bottom], [0.0, -1.0, 1.0]] {
        let mut sides = [0.0f64; 8];
        let (mut inside, mut outside) = (true, true);
        for (p, side) in polygon[..count].iter().zip(&mut sides) {
            *side = plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2];
            inside &= *side >= 0.0;
            outside &= *side < 0.0;
        }
        // Most planes leave all of it or nothing.
        if inside {
            continue;
        }
        if outside {
            return None;
        }
        let mut kept = [[0.0f64; 3]; 8];
        let mut kept_count = 0;
        for i in 0..count {
            let next = if i + 1 == count { 0 } else { i + 1 };
            let (p, q) = (polygon[i], polygon[next]);
            let (sp, sq) = (sides[i], sides[next]);
            if sp >= 0.0 {
                kept[kept_count] = p;
                kept_count += 1;
            }
            if (sp < 0.0) != (sq < 0.0) {
                let f = sp / (sp - sq);
                kept[kept_count] = three(|c| p[c] + (q[c] - p[c]) * f);
                kept_count += 1;
            }
        }
        (polygon, count) = (kept, kept_count);
        if count < 3 {
            return None;
        }
    }
    let width = grid.resolution as f64;
    let height = if grid.face.is_top() { width } else { width * 0.5 };
    let half = width * 0.5;
    let v_shift = if grid.face.is_top() { half } else { 0.0 };
    let (mut x0, mut x1, mut y0, mut y1) = (f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY);
    for p in &polygon[..count] {
        if p[2] <= 1e-14 {
            // The polygon reaches the eye: it may fill the face.
            (x0, x1, y0, y1) = (0.0, width, 0.0, height);
            break;
        }
        let (x, y) = (p[0] / p[2] * half + half - 0.5, p[1] / p[2] * half + v_shift - 0.5);
        (x0, x1, y0, y1) = (x0.min(x), x1.max(x), y0.min(y), y1.max(y));
    }
    // Clipping moves corners by rounding only; a hundredth of a pixel is far more than that.
    let slack = 0.01;
    #[allow(clippy::cast_possible_truncation, reason = "saturates, clamped to the face")]
    let pixels = PixelBox {
        x0: (x0 - slack).ceil().clamp(0.0, width) as i32,
        x1: (x1 + slack).floor().clamp(-1.0, width - 1.0) as i32 + 1,
        y0: (y0 - slack).ceil().clamp(0.0, height) as i32,
        y1: (y1 + slack).floor().clamp(-1.0, height - 1.0) as i32 + 1,
    };
    (pixels.x0 < pixels.x1 && pixels.y0 < pixels.y1).then_some(pixels)
}

/// The pixels of a lane of `boxes` on the face.
#[inline(always)]
pub(super) fn pixel_box(t: &Transformed, boxes: &TriangleBoxes, grid: FaceGrid, lane: usize) -> Option<PixelBox> {
    if boxes.in_front >> lane & 1 != 0 {
        Some(boxes.of_lane(lane))
    } else if boxes.straddling >> lane & 1 != 0 {
        clipped_box(t, grid, lane)
    } else {
        None
    }
}

/// A lane's pixels on a face, and its range of 1/w there.
#[derive(Clone, Copy, Debug)]
pub(super) struct LaneBox {
    pub(super) pixels: PixelBox,
    pub(super) low: f32,
    pub(super) high: f32,
}

/// The box of a lane in front of the eye or straddling, `None` if it has no pixels.
#[inline(always)]
pub(super) fn lane_box(t: &Transformed, boxes: &TriangleBoxes, grid: FaceGrid, lane: usize) -> Option<LaneBox> {
    if boxes.straddling >> lane & 1 != 0 {
        return Some(LaneBox {
            pixels: clipped_box(t, grid, lane)?,
            low: f32::MIN_POSITIVE,
            high: f32::MAX,
        });
    }
    Some(LaneBox {
        pixels: boxes.of_lane(lane),
        low: boxes.low[lane],
        high: boxes.high[lane],
    })
}
