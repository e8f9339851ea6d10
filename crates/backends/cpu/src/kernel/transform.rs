//! Triangles in a hemicube's frame, sixteen at a time, and their centroids.

use super::{Flags, Frame, Lanes, three};
use hemicube_contract::bvh::{Block, LANES, UNUSED};
use hemicube_contract::face::Face;

/// Sixteen triangles in a hemicube's frame.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Transformed {
    /// x, y, z of corner 0, then 1, then 2.
    pub(crate) corners: [[f64; LANES]; 9],
    /// `corners` rounded to f32, for bounding boxes.
    pub(super) near: [[f32; LANES]; 9],
    /// v1 × v2, v2 × v0, v0 × v1, times the sign of the determinant.
    pub(crate) edges: [[f64; LANES]; 9],
    /// Sign of det(v0, v1, v2): the factor in `edges`.
    pub(crate) sign: [f64; LANES],
    /// |det(v0, v1, v2)|.
    pub(crate) determinant: [f64; LANES],
    /// Id of the visible side: a patch, or the id for blocked.
    pub(crate) seen: [u32; LANES],
    /// Lanes above the horizon with an area, other than the emitter.
    pub(crate) live: u16,
}

impl Transformed {
    pub(crate) fn new() -> Self {
        Self {
            corners: [[0.0; LANES]; 9],
            near: [[0.0; LANES]; 9],
            edges: [[0.0; LANES]; 9],
            sign: [1.0; LANES],
            determinant: [0.0; LANES],
            seen: [UNUSED; LANES],
            live: 0,
        }
    }

    /// Returns true if a face shows the whole lane above the horizon: its corners lie in the face's pyramid, and the
    /// pyramid is convex.
    pub(crate) fn is_within(&self, face: Face, lane: usize) -> bool {
        let (axis, sign) = face.axes();
        (0..3).all(|k| {
            let [u, v, w] = three(|c| sign[c] * self.corners[3 * k + axis[c]][lane]);
            w > 0.0 && u.abs() <= w && v.abs() <= w
        })
    }
}

/// Projected centroids of sixteen triangles.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Centroids {
    /// The pixel's column.
    pub(crate) x: [u32; LANES],
    /// The pixel's row of the atlas.
    pub(crate) row: [u32; LANES],
    /// 1/w.
    pub(crate) depth: [f64; LANES],
    /// The direction, scaled to w = 1.
    pub(crate) direction: [[f64; LANES]; 3],
    /// Lanes with a centroid above the horizon.
    pub(crate) above: u16,
}

impl Centroids {
    pub(crate) fn new() -> Self {
        Self {
            x: [0; LANES],
            row: [0; LANES],
            depth: [0.0; LANES],
            direction: [[0.0; LANES]; 3],
            above: 0,
        }
    }
}

/// Transforms a point into a hemicube's frame; heights up to the tolerance become 0.
#[inline(always)]
pub(super) fn in_frame(frame: &Frame, point: [f64; 3]) -> [f64; 3] {
    let [t, b, n] = &frame.axes;
    let [x, y, z] = three(|c| point[c] - frame.origin[c]);
    let height = n[0] * x + n[1] * y + n[2] * z;
    [
        t[0] * x + t[1] * y + t[2] * z,
        b[0] * x + b[1] * y + b[2] * z,
        if height.abs() <= frame.tolerance { 0.0 } else { height },
    ]
}

/// Transforms a block: corners, signed edge vectors, and the id of the visible side.
#[inline(always)]
pub(super) fn transform<L: Lanes>(isa: L, block: &Block, frame: &Frame, out: &mut Transformed) {
    let mut live = Flags([0; LANES]);
    for l in 0..LANES {
        let corner = |k: usize| in_frame(frame, three(|c| block.corners[3 * k + c][l]));
        let corners = [corner(0), corner(1), corner(2)];
        for k in 0..9 {
            let x = corners[k / 3][k % 3];
            out.corners[k][l] = x;
            #[allow(clippy::cast_possible_truncation, reason = "rounding is wanted")]
            {
                out.near[k][l] = x as f32;
            }
        }
        let edge = |k: usize| {
            let ([ax, ay, az], [bx, by, bz]) = (corners[(k + 1) % 3], corners[(k + 2) % 3]);
            [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
        };
        let edges = [edge(0), edge(1), edge(2)];
        let determinant = corners[0][0] * edges[0][0] + corners[0][1] * edges[0][1] + corners[0][2] * edges[0][2];
        let above = (corners[0][2] > 0.0) | (corners[1][2] > 0.0) | (corners[2][2] > 0.0);
        let (negative, positive) = (block.negative[l], block.positive[l]);
        let emitter = (negative == frame.emitter) | (positive == frame.emitter);
        let turned = determinant < 0.0;
        out.seen[l] = if turned { negative } else { positive };
        live.0[l] = u32::from(above & (determinant != 0.0) & !emitter & (negative != UNUSED));
        let sign = if turned { -1.0 } else { 1.0 };
        out.sign[l] = sign;
        out.determinant[l] = determinant.abs();
        for k in 0..9 {
            out.edges[k][l] = edges[k / 3][k % 3] * sign;
        }
    }
    out.live = isa.mask(&live);
}

/// Projects centroids. Heights up to the frame's tolerance lie below the horizon, like the corners that `transform` has
/// put into it.
#[inline(always)]
pub(super) fn centroids<L: Lanes>(isa: L, t: &Transformed, frame: &Frame, out: &mut Centroids) {
    let half = frame.resolution as f64 * 0.5;
    let edge = frame.resolution as f64 - 1.0;
    let mut above = Flags([0; LANES]);
    for l in 0..LANES {
        let [x, y, z] = three(|c| (t.corners[c][l] + t.corners[3 + c][l] + t.corners[6 + c][l]) / 3.0);
        let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
        let on_top = (az >= ax) & (az >= ay);
        let on_x = ax >= ay;
        // Choose the face and its frame, like `Face::axes`.
        let w = if on_top {
            z
        } else if on_x {
            ax
        } else {
            ay
        };
        let u = if on_top {
            x
        } else if on_x {
            if x > 0.0 { y } else { -y }
        } else if y > 0.0 {
            -x
        } else {
            x
        };
        let v = if on_top { y } else { z };
        let side = match (on_x, x > 0.0, y > 0.0) {
            (true, true, _) => 0.0,
            (true, false, _) => 1.0,
            (false, _, true) => 2.0,
            (false, _, false) => 3.0,
        };
        let inverse = 1.0 / w;
        let (shift, first, last) = if on_top {
            (half, 0.0, edge)
        } else {
            (0.0, (2.0 + side) * half, half - 1.0)
        };
        let column = clamped(u * inverse * half + half, edge);
        let row = clamped(v * inverse * half + shift, last);
        // SAFETY: both are clamped to the face by comparisons that NaN fails, and the face lies in the atlas.
        unsafe {
            let column: i32 = column.to_int_unchecked();
            let row: i32 = row.to_int_unchecked();
            let first: i32 = first.to_int_unchecked();
            out.x[l] = column.cast_unsigned();
            out.row[l] = (row + first).cast_unsigned();
        }
        out.depth[l] = inverse;
        out.direction[0][l] = x * inverse;
        out.direction[1][l] = y * inverse;
        out.direction[2][l] = z * inverse;
        above.0[l] = u32::from(z > frame.tolerance);
    }
    out.above = isa.mask(&above);
}

/// Clamps x to 0..=`most`; NaN becomes 0.
#[inline(always)]
fn clamped(x: f64, most: f64) -> f64 {
    let x = if x > 0.0 { x } else { 0.0 };
    if x < most { x } else { most }
}
