//! Edges as lines over a face's pixels, and the spans between them, eight rows at a time.

use super::isa::Lanes;
use super::projection::{PixelBox, at};
use super::{FaceGrid, GROUP, Transformed, three};
use hemicube_contract::bvh::LANES;

/// The three edges of a triangle on a face as lines x = slope · y + offset, in pixels.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct EdgeLines {
    pub(super) slope: [f64; 3],
    pub(super) offset: [f64; 3],
    /// All ones for edges that bound the span from the left: whole bytes, as they are masks of eight rows.
    pub(super) left: [u8; 3],
    /// All ones for edges that bound it from the right.
    pub(super) right: [u8; 3],
    /// True if an edge runs along the rows, so that each row lies wholly on one side of it.
    pub(super) any_flat: bool,
    pub(super) flat_y: [f64; 3],
    pub(super) flat_constant: [f64; 3],
}

/// The edges of a block's triangles as lines: span limits x = slope · y + offset. One division for all lanes costs
/// little more than one for each lane drawn.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct BlockLines {
    pub(super) slope: [[f64; LANES]; 3],
    pub(super) offset: [[f64; LANES]; 3],
    /// Lanes with spans that edge k bounds from the left, and from the right.
    pub(super) left: [u16; 3],
    pub(super) right: [u16; 3],
    /// Lanes with valid entries above.
    pub(super) ready: u16,
}

impl BlockLines {
    pub(super) fn new() -> Self {
        Self {
            slope: [[0.0; LANES]; 3],
            offset: [[0.0; LANES]; 3],
            left: [0; 3],
            right: [0; 3],
            ready: 0,
        }
    }
}

/// Eight spans of pixels, one a row: `starts[r]..ends[r]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Spans {
    pub(super) starts: [i32; GROUP],
    pub(super) ends: [i32; GROUP],
    /// Rows with a non-empty span.
    pub(super) rows: u8,
}

/// An edge vector's value over a face's pixels: a · x + b · y + c.
#[inline(always)]
pub(super) fn affine(e: [f64; 3], grid: FaceGrid) -> [f64; 3] {
    let step = 2.0 / grid.resolution as f64;
    let u0 = 0.5 * step - 1.0;
    let v0 = if grid.face.is_top() { u0 } else { 0.5 * step };
    // Every operation is odd in e, so the shared edge of two triangles has the same zero line to the bit.
    [e[0] * step, e[1] * step, e[2] + e[0] * u0 + e[1] * v0]
}

/// The edge lines of a lane, and the sum of its edge vectors in the face's frame.
#[inline(always)]
pub(super) fn edge_lines(t: &Transformed, grid: FaceGrid, lane: usize) -> (EdgeLines, [f64; 3]) {
    let (axis, sign) = grid.face.axes();
    let mut lines = EdgeLines::default();
    let mut sum = [0.0; 3];
    for k in 0..3 {
        let e = three(|c| sign[c] * t.edges[3 * k + axis[c]][lane]);
        for c in 0..3 {
            sum[c] += e[c];
        }
        let [a, b, c] = affine(e, grid);
        let inverse = -1.0 / a;
        lines.slope[k] = b * inverse;
        lines.offset[k] = c * inverse;
        lines.left[k] = u8::from(a > 0.0).wrapping_neg();
        lines.right[k] = u8::from(a < 0.0).wrapping_neg();
        lines.any_flat |= a == 0.0;
        lines.flat_y[k] = b;
        lines.flat_constant[k] = c;
    }
    (lines, sum)
}

/// Removes the rows outside a flat edge from `rows`. On the line itself, one of its two sides wins.
#[inline(always)]
pub(super) fn flat_rows(lines: &EdgeLines, y: f64, mut rows: u8) -> u8 {
    for k in 0..3 {
        if lines.left[k] | lines.right[k] == 0 {
            for r in 0..GROUP {
                let value = lines.flat_y[k] * (y + r as f64) + lines.flat_constant[k];
                let inside = value > 0.0 || (value == 0.0 && lines.flat_y[k] > 0.0);
                if !inside {
                    rows &= !(1 << r);
                }
            }
        }
    }
    rows
}

/// Removes the rows outside `y0..y1` from those of a group that begins at `y`.
#[inline(always)]
pub(super) fn rows_between(y0: usize, y1: usize, y: usize, mut rows: u8) -> u8 {
    if y < y0 {
        rows &= u8::MAX << (y0 - y);
    }
    if y + GROUP > y1 {
        rows &= u8::MAX >> (y + GROUP - y1);
    }
    rows
}

/// Computes the spans of eight rows from `y` on within a triangle's box.
#[inline(always)]
pub(super) fn spans_within<L: Lanes>(isa: L, lines: &EdgeLines, y: usize, pixels: PixelBox, out: &mut Spans) {
    let (x0, x1) = (f64::from(pixels.x0), f64::from(pixels.x1));
    let (y0, y1) = (at(pixels.y0), at(pixels.y1));
    isa.spans(lines, y as f64, x0, x1, out);
    if lines.any_flat {
        out.rows = flat_rows(lines, y as f64, out.rows);
    }
    out.rows = rows_between(y0, y1, y, out.rows);
}

/// Calls `each(row of the face, start, end)` for each span of a triangle on a face.
#[inline(always)]
pub(super) fn walk<L: Lanes>(isa: L, lines: &EdgeLines, pixels: PixelBox, mut each: impl FnMut(usize, usize, usize)) {
    let mut spans = Spans::default();
    let mut y = at(pixels.y0) / GROUP * GROUP;
    while y < at(pixels.y1) {
        spans_within(isa, lines, y, pixels, &mut spans);
        let mut rows = spans.rows;
        while rows != 0 {
            let r = rows.trailing_zeros() as usize;
            rows &= rows - 1;
            #[allow(clippy::cast_sign_loss, reason = "spans lie within the pixel box")]
            each(y + r, spans.starts[r] as usize, spans.ends[r] as usize);
        }
        y += GROUP;
    }
}
