//! Engine `order`: blocks drawn front to back into coverage, and the questions asked of it. Every engine draws the
//! patches of a visible parent triangle the same way.
//!
//! Spans are those of engine `depth`, to the bit.

use super::coverage::{
    Canvas, Coverage, MOST_COLUMNS, Rows, WIDTH, all_covered, all_uncovered, in_atlas, mark, weight_of,
};
use super::isa::Lanes;
use super::projection::{PixelBox, TriangleBoxes, at, clipped_box, pixel_box, project};
use super::spans::{BlockLines, Spans, edge_lines, spans_within, walk};
use super::transform::in_frame;
use super::{Count, FaceGrid, Frame, GROUP, Transformed, three};
use crate::bsp::PieceLines;
use hemicube_contract::bvh::{Block, LANES};
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::face::Face;
use std::ops::Range;

/// A way to draw the lanes of a block on some faces.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pass<'a> {
    pub(crate) faces: u8,
    pub(crate) turns: Turns<'a>,
    /// The surfaces of the block's pieces, if surfaces were cut.
    pub(crate) cut: Option<Cut<'a>>,
}

/// The order of a block's lanes, and the coverage that their centroids are tested against.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Turns<'a> {
    /// These lanes, nearest first; centroids are tested against the coverage before the block.
    InOrder(&'a [u8]),
    /// All lanes, none of which hides another; centroids are tested against the snapshot.
    Together,
    /// All lanes likewise; centroids were tested, and these lanes' are uncovered.
    Asked(u16),
    /// All lanes likewise, the patches of a parent; centroids are not tested.
    Parts,
}

/// The surfaces that the pieces of a block were cut from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cut<'a> {
    pub(crate) lines: &'a PieceLines,
    pub(crate) frame: &'a Frame,
}

impl Cut<'_> {
    /// Replaces the edges of some pieces by those of their surfaces, with the operations of `transform`.
    #[inline(always)]
    fn put_on_lines(&self, t: &mut Transformed, lanes: Range<usize>) {
        for k in 0..3 {
            for l in lanes.clone() {
                let at = |block: &Block| in_frame(self.frame, three(|c| block.corners[3 * k + c][l]));
                let ([ax, ay, az], [bx, by, bz]) = (at(&self.lines.from), at(&self.lines.to));
                t.edges[3 * k][l] = (ay * bz - az * by) * t.sign[l];
                t.edges[3 * k + 1][l] = (az * bx - ax * bz) * t.sign[l];
                t.edges[3 * k + 2][l] = (ax * by - ay * bx) * t.sign[l];
            }
        }
    }
}

/// Results of a block's lanes over all faces.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Shown {
    /// Visible weight.
    pub(crate) visible: [u32; LANES],
    /// Covered weight, only with `COVERED`.
    pub(crate) covered: [u32; LANES],
    /// Lanes with a visible pixel.
    pub(crate) seen: u16,
    /// Lanes left out on a face with a wholly covered box.
    pub(crate) hidden: u16,
    /// Lanes found without a pixel and with a visible centroid, if that was asked. Only with `COVERED`.
    pub(crate) subpixel: u16,
    /// Lanes found without a pixel. Only with `COVERED`.
    pub(crate) without: u16,
    /// Triangles drawn, counted once a face.
    pub(crate) drawn: u32,
}

impl Shown {
    fn new() -> Self {
        Self {
            visible: [0; LANES],
            covered: [0; LANES],
            seen: 0,
            hidden: 0,
            subpixel: 0,
            without: 0,
            drawn: 0,
        }
    }
}

/// From this number of lanes on, the lines of the whole block are computed at once.
const MANY_LANES: u32 = 4;

/// A block on one face.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockOnFace<'a> {
    pub(super) triangles: &'a Transformed,
    pub(super) grid: FaceGrid,
    pub(super) lines: &'a BlockLines,
    /// The face's running sum of delta form factors.
    pub(super) running: &'a [u32],
}

/// Result of one lane on one face.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct DrawnLane {
    pub(super) visible: u32,
    /// Covered weight, only with `COVERED`.
    pub(super) covered: u32,
    /// Covered pixels, only with `COVERED`.
    pub(super) pixels: u32,
    pub(super) seen: bool,
}

/// Draws a block into a canvas.
#[inline(always)]
pub(super) fn draw<L: Lanes, const COVERED: bool>(
    isa: L,
    t: &mut Transformed,
    pass: Pass<'_>,
    canvas: &mut impl Canvas,
    table: &DeltaTable,
) -> Shown {
    let Pass { faces, turns, cut } = pass;
    let resolution = canvas.coverage().resolution;
    let mut shown = Shown::new();
    let mut with_pixels = 0u16;
    let mut on_lines = 0u16;
    let mut lines = BlockLines::new();
    // The snapshot stays, so that it can be asked after drawing, for the few lanes without a pixel.
    let (order, uncovered) = match turns {
        Turns::InOrder(order) if COVERED => {
            let uncovered = uncovered_centroids(isa, t, t.live, faces, canvas.coverage());
            (Some(order), uncovered)
        }
        Turns::InOrder(order) => (Some(order), 0),
        Turns::Asked(uncovered) => (None, uncovered),
        Turns::Together | Turns::Parts => (None, 0),
    };
    for face in Face::ALL {
        if faces >> face as u8 & 1 == 0 {
            continue;
        }
        let grid = FaceGrid::new(face, resolution);
        let boxes = project(isa, t, grid);
        let on_face = (boxes.in_front | boxes.straddling) & t.live;
        if on_face == 0 {
            continue;
        }
        lines.ready = 0;
        if cut.is_none() && on_face.count_ones() >= MANY_LANES {
            isa.block_lines(t, grid, &mut lines);
        }
        let mut pending = on_face;
        let mut order = order.map(|order| order.iter());
        loop {
            // Ascending where no lane hides another: lanes not on the face cost nothing.
            let lane = match &mut order {
                None if pending == 0 => break,
                None => pending.trailing_zeros() as usize,
                Some(order) => match order.next() {
                    Some(&lane) => usize::from(lane),
                    None => break,
                },
            };
            pending &= !(1 << lane);
            if on_face >> lane & 1 == 0 {
                continue;
            }
            let Some([columns, rows]) = lane_ranges(t, &boxes, grid, lane) else {
                continue;
            };
            let (left, right, low, high) = (columns.start, columns.end, rows.start, rows.end);
            if canvas.culls() {
                let pixels = in_atlas(grid, at(left), at(right) - 1, at(low), at(high) - 1);
                if all_covered(isa, canvas.coverage(), pixels) {
                    shown.hidden |= 1 << lane;
                    continue;
                }
            }
            shown.drawn += 1;
            let first = canvas.recorded();
            if let Some(cut) = &cut
                && on_lines >> lane & 1 == 0
            {
                // Most blocks of pieces have one lane drawn, or none. Two lanes on their own take as long as all.
                if on_lines == 0 {
                    on_lines = 1 << lane;
                    cut.put_on_lines(t, lane..lane + 1);
                } else {
                    on_lines = u16::MAX;
                    cut.put_on_lines(t, 0..LANES);
                }
            }
            let on = BlockOnFace {
                triangles: t,
                grid,
                lines: &lines,
                running: table.running(face),
            };
            let drawn = isa.draw_lane::<COVERED, _>(&on, lane, columns, rows, canvas);
            shown.visible[lane] += drawn.visible;
            shown.covered[lane] += drawn.covered;
            with_pixels |= u16::from(drawn.pixels != 0) << lane;
            shown.seen |= u16::from(drawn.seen) << lane;
            if drawn.seen && canvas.is_recording() {
                // Points lie at most a pixel beyond the rows with centres. The snapshot of a piece may lack those rows,
                // and points of other pieces may lie there.
                let beyond = usize::from(cut.is_none());
                let (y0, y1) = (
                    at(low).saturating_sub(beyond),
                    (at(high) - 1 + beyond).min(grid.height() - 1),
                );
                canvas.record_lane(lane, face, first, in_atlas(grid, at(left), at(right) - 1, y0, y1));
            }
        }
    }
    if COVERED {
        let none = t.live & !with_pixels;
        shown.without = none;
        shown.subpixel = match turns {
            Turns::InOrder(_) | Turns::Asked(_) => none & uncovered,
            Turns::Together if none != 0 => uncovered_centroids(isa, t, none, faces, canvas.snapshot()),
            Turns::Together => 0,
            Turns::Parts => none,
        };
    }
    shown
}

/// The columns and the rows of a lane on a face.
#[inline(always)]
fn lane_ranges(t: &Transformed, boxes: &TriangleBoxes, grid: FaceGrid, lane: usize) -> Option<[Range<i32>; 2]> {
    // Load one number after the other: a box stored in parts and loaded whole would wait for all of them.
    if boxes.in_front >> lane & 1 != 0 {
        Some([boxes.x0[lane]..boxes.x1[lane], boxes.y0[lane]..boxes.y1[lane]])
    } else {
        let clipped = clipped_box(t, grid, lane)?;
        Some([clipped.x0..clipped.x1, clipped.y0..clipped.y1])
    }
}

/// Draws one lane, eight rows at a time: the definition of [`Lanes::draw_lane`].
#[inline(always)]
pub(super) fn draw_lane<L: Lanes, const COVERED: bool, C: Canvas>(
    isa: L,
    on: &BlockOnFace<'_>,
    lane: usize,
    columns: Range<i32>,
    rows: Range<i32>,
    canvas: &mut C,
) -> DrawnLane {
    let (grid, running) = (on.grid, on.running);
    let resolution = grid.resolution;
    let (lines, _) = edge_lines(on.triangles, grid, lane);
    let first_row = grid.first_row();
    let mut drawn = DrawnLane::default();
    let mut spans = Spans::default();
    let pixels = PixelBox {
        x0: columns.start,
        x1: columns.end,
        y0: rows.start,
        y1: rows.end,
    };
    let (first, last) = (at(columns.start) / WIDTH, (at(columns.end) - 1) / WIDTH);
    let mut y = at(rows.start) / GROUP * GROUP;
    while y < at(rows.end) {
        spans_within(isa, &lines, y, pixels, &mut spans);
        if spans.rows != 0 {
            let group = (first_row + y) / GROUP;
            let mut visible = [Rows::NONE; MOST_COLUMNS];
            // Rows with a visible pixel, and rows with a hidden one.
            let (mut seen, mut unseen) = (0u8, 0u8);
            for column in first..=last {
                let coverage = canvas.coverage_mut();
                let covered = &mut coverage.rows[column * coverage.groups + group];
                let (s, u) = mark(&spans, column, covered, &mut visible[column - first], None);
                seen |= s;
                unseen |= u;
            }
            for column in (first..=last).filter(|_| seen != 0) {
                canvas.record_rows(column, first_row + y, &visible[column - first]);
            }
            let face_row = y * resolution;
            let mut pending = if COVERED { spans.rows } else { seen };
            drawn.seen |= seen != 0;
            while pending != 0 {
                let r = pending.trailing_zeros() as usize;
                pending &= pending - 1;
                let row = &running[face_row + r * resolution..];
                let (start, end) = (at(spans.starts[r]), at(spans.ends[r]));
                let whole = row[end] - row[start];
                if COVERED {
                    drawn.covered += whole;
                    #[allow(clippy::cast_possible_truncation, reason = "at most 1024 pixels")]
                    {
                        drawn.pixels += (end - start) as u32;
                    }
                }
                if unseen >> r & 1 == 0 {
                    drawn.visible += whole;
                } else if seen >> r & 1 != 0 {
                    for column in first..=last {
                        drawn.visible += weight_of(visible[column - first].0[r], &row[column * WIDTH..]);
                    }
                }
            }
        }
        y += GROUP;
    }
    drawn
}

/// Adds the pixels and the weight of lanes alone, over some faces.
#[inline(always)]
pub(super) fn cover_lanes<L: Lanes>(
    isa: L,
    t: &Transformed,
    lanes: u16,
    faces: u8,
    table: &DeltaTable,
    out: &mut [Count; LANES],
) {
    let resolution = table.resolution() as usize;
    for face in Face::ALL {
        if faces >> face as u8 & 1 == 0 {
            continue;
        }
        let grid = FaceGrid::new(face, resolution);
        let boxes = project(isa, t, grid);
        let running = table.running(face);
        let mut pending = (boxes.in_front | boxes.straddling) & lanes;
        while pending != 0 {
            let lane = pending.trailing_zeros() as usize;
            pending &= pending - 1;
            let Some(pixels) = pixel_box(t, &boxes, grid, lane) else {
                continue;
            };
            let (lines, _) = edge_lines(t, grid, lane);
            let Count { pixels: count, weight } = &mut out[lane];
            walk(isa, &lines, pixels, |row, start, end| {
                #[allow(clippy::cast_possible_truncation, reason = "at most 1024 pixels")]
                {
                    *count += (end - start) as u32;
                }
                *weight += running[row * resolution + end] - running[row * resolution + start];
            });
        }
    }
}

/// Finds the lanes that may touch, on `faces`, a pixel uncovered in the snapshot.
#[inline(always)]
pub(super) fn may_touch_uncovered<L: Lanes>(
    isa: L,
    t: &Transformed,
    lanes: u16,
    faces: u8,
    snapshot: &Coverage,
) -> u16 {
    let resolution = snapshot.resolution;
    let mut found = 0;
    for face in Face::ALL {
        if faces >> face as u8 & 1 == 0 {
            continue;
        }
        let grid = FaceGrid::new(face, resolution);
        let boxes = project(isa, t, grid);
        found |= lanes & boxes.straddling;
        let mut asked = lanes & !found;
        while asked != 0 {
            let lane = asked.trailing_zeros() as usize;
            asked &= asked - 1;
            // Touched pixels lie at most one beyond the centres that the lane may cover; there may be no centre.
            let touched = |from: i32, to: i32, count: usize| (at((from - 1).max(0)), at(to.max(0)).min(count - 1));
            let (x0, x1) = touched(boxes.x0[lane], boxes.x1[lane], resolution);
            let (y0, y1) = touched(boxes.y0[lane], boxes.y1[lane], grid.height());
            if x0 > x1 || y0 > y1 {
                continue;
            }
            let is_covered = all_covered(isa, snapshot, in_atlas(grid, x0, x1, y0, y1));
            found |= u16::from(!is_covered) << lane;
        }
    }
    found
}

/// Finds the lanes with a box of pixels on exactly one of `faces`, all of them uncovered.
#[inline(always)]
pub(super) fn wholly_uncovered<L: Lanes>(isa: L, t: &Transformed, faces: u8, coverage: &Coverage) -> u16 {
    let resolution = coverage.resolution;
    let (mut uncovered, mut any, mut several) = (0u16, 0u16, 0u16);
    for face in Face::ALL {
        if faces >> face as u8 & 1 == 0 {
            continue;
        }
        let grid = FaceGrid::new(face, resolution);
        let boxes = project(isa, t, grid);
        several |= any & boxes.in_front;
        let clipped = lanes_on_face(t, grid, boxes.straddling & !several);
        several |= clipped;
        let mut asked = boxes.in_front & !any & !several;
        any |= boxes.in_front;
        while asked != 0 {
            let lane = asked.trailing_zeros() as usize;
            asked &= asked - 1;
            let (x0, x1) = (at(boxes.x0[lane]), at(boxes.x1[lane]) - 1);
            let (y0, y1) = (at(boxes.y0[lane]), at(boxes.y1[lane]) - 1);
            let is_uncovered = all_uncovered(isa, coverage, in_atlas(grid, x0, x1, y0, y1));
            uncovered |= u16::from(is_uncovered) << lane;
        }
    }
    uncovered & !several
}

/// Straddling lanes with pixels on the face. A lane beyond the eye plane may have none: then it must not count as on
/// the face, as faces are left out where every lane asked for is nowhere.
#[inline(always)]
fn lanes_on_face(t: &Transformed, grid: FaceGrid, mut straddling: u16) -> u16 {
    let mut on = 0;
    while straddling != 0 {
        let lane = straddling.trailing_zeros() as usize;
        straddling &= straddling - 1;
        on |= u16::from(clipped_box(t, grid, lane).is_some()) << lane;
    }
    on
}

/// Finds the lanes with a centroid above the horizon, on `faces`, at an uncovered pixel.
#[inline(always)]
pub(super) fn uncovered_centroids<L: Lanes>(
    _isa: L,
    t: &Transformed,
    mut lanes: u16,
    faces: u8,
    coverage: &Coverage,
) -> u16 {
    let resolution = coverage.resolution;
    #[allow(clippy::cast_precision_loss, reason = "at most 1024")]
    let half = resolution as f32 * 0.5;
    let mut rows = [0u32; LANES];
    let mut columns = [0u32; LANES];
    let mut above = [0u32; LANES];
    for l in 0..LANES {
        let [x, y, z] = three(|c| t.near[c][l] + t.near[3 + c][l] + t.near[6 + c][l]);
        let (ax, ay) = (x.abs(), y.abs());
        let on_top = (z >= ax) & (z >= ay);
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
        let (side, bit) = match (on_x, x > 0.0, y > 0.0) {
            (true, true, _) => (0.0, 1 << Face::PosX as u32),
            (true, false, _) => (1.0, 1 << Face::NegX as u32),
            (false, _, true) => (2.0, 1 << Face::PosY as u32),
            (false, _, false) => (3.0, 1 << Face::NegY as u32),
        };
        let bit = if on_top { 1 << Face::Top as u32 } else { bit };
        let inverse = 1.0 / w;
        let edge = 2.0 * half - 1.0;
        let column = clamped(u * inverse * half + half, edge);
        let (shift, first, last) = if on_top {
            (half, 0.0, edge)
        } else {
            (0.0, 2.0 * half + side * half, half - 1.0)
        };
        let row = clamped(v * inverse * half + shift, last) + first;
        // SAFETY: both are clamped to the atlas by comparisons that NaN fails.
        unsafe {
            rows[l] = row.to_int_unchecked();
            columns[l] = column.to_int_unchecked();
        }
        above[l] = u32::from(z > 0.0) & u32::from(u32::from(faces) & bit != 0);
    }
    let mut uncovered = 0;
    while lanes != 0 {
        let l = lanes.trailing_zeros() as usize;
        lanes &= lanes - 1;
        if above[l] != 0 && !coverage.is_covered(rows[l] as usize, columns[l] as usize) {
            uncovered |= 1 << l;
        }
    }
    uncovered
}

/// Clamps x to 0..=`most`; NaN becomes 0.
#[inline(always)]
fn clamped(x: f32, most: f32) -> f32 {
    let x = if x > 0.0 { x } else { 0.0 };
    if x < most { x } else { most }
}
