//! The arithmetic of engine 2: one bit a pixel that says whether something covers it. What is drawn strictly front to back
//! needs no depth and no ids: what a triangle shows is what it covers and nothing covered before.
//!
//! Spans are those of engine 1, to the bit.

use super::{
    Boxes, EdgeLines, GROUP, Lanes, PixelBox, Transformed, boxes, clipped_box, edge_lines, flat_rows, three, walk,
};
use hemicube::face::Face;
use hemicube::tree::LANES;

/// Pixels of a column of words: one bit each.
const WIDTH: usize = u64::BITS as usize;
/// Words of a row at the largest resolution.
const MOST_COLUMNS: usize = 1024 / WIDTH;

/// Eight rows of one column: what is drawn at a time.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Rows([u64; GROUP]);

/// Which pixels of the atlas are covered.
#[derive(Debug)]
pub(crate) struct Coverage {
    pub(crate) resolution: usize,
    /// Groups of eight rows in a column: all of the atlas.
    groups: usize,
    /// By column, then by group.
    rows: Vec<Rows>,
    /// Whether triangles whose box is covered are left out.
    pub(crate) culling: bool,
}

impl Coverage {
    pub(crate) fn new(resolution: u32, culling: bool) -> Self {
        let resolution = resolution as usize;
        let groups = 3 * resolution / GROUP;
        Self {
            resolution,
            groups,
            rows: vec![Rows([0; GROUP]); groups * resolution.div_ceil(WIDTH)],
            culling,
        }
    }

    pub(crate) fn clear(&mut self) {
        self.rows.fill(Rows([0; GROUP]));
    }

    /// Whether a pixel of the atlas is covered.
    #[inline(always)]
    pub(crate) fn is_covered(&self, row: usize, x: usize) -> bool {
        self.rows[x / WIDTH * self.groups + row / GROUP].0[row % GROUP] >> (x % WIDTH) & 1 != 0
    }

    /// The weight of all pixels that nothing covers.
    pub(crate) fn open_weight(&self, top: &[u32], side: &[u32]) -> u32 {
        let mut weight = 0;
        let columns = self.resolution.div_ceil(WIDTH);
        for column in 0..columns {
            let width = (self.resolution - column * WIDTH).min(WIDTH);
            let whole = low_bits(width);
            for group in 0..self.groups {
                let rows = &self.rows[column * self.groups + group].0;
                for (r, bits) in rows.iter().enumerate() {
                    let open = !bits & whole;
                    if open != 0 {
                        let (running, row) = row_of(self.resolution, group * GROUP + r, top, side);
                        weight += weight_of(open, &running[row * self.resolution + column * WIDTH..]);
                    }
                }
            }
        }
        weight
    }
}

/// The running sum of the face that a row of the atlas belongs to, and which of its rows that is: the four sides share a
/// table.
#[inline(always)]
fn row_of<'t>(resolution: usize, row: usize, top: &'t [u32], side: &'t [u32]) -> (&'t [u32], usize) {
    if row < resolution {
        (top, row)
    } else {
        (side, (row - resolution) % (resolution / 2))
    }
}

/// A word whose lowest `count` bits are set, for counts up to 64.
#[inline(always)]
fn low_bits(count: usize) -> u64 {
    if count >= WIDTH { u64::MAX } else { (1 << count) - 1 }
}

/// The weight of the pixels whose bits are set; `running` begins at that of the lowest bit.
#[inline(always)]
fn weight_of(mut bits: u64, running: &[u32]) -> u32 {
    let mut weight = 0;
    while bits != 0 {
        let start = bits.trailing_zeros() as usize;
        let length = (!(bits >> start)).trailing_zeros() as usize;
        weight += running[start + length] - running[start];
        if start + length >= WIDTH {
            break;
        }
        bits &= u64::MAX << (start + length);
    }
    weight
}

/// What the lanes of a block showed and covered, over all faces.
#[derive(Clone, Debug)]
pub(crate) struct Shown {
    pub(crate) visible: [u32; LANES],
    /// Only with `COVERED`.
    pub(crate) covered: [u32; LANES],
    /// Lanes of which a pixel is seen.
    pub(crate) seen: u16,
    /// Lanes that were left out on some face, as all their box was covered.
    pub(crate) hidden: u16,
    /// Lanes that cover no pixel and whose centroid was seen before any lane was drawn. Only with `COVERED`.
    pub(crate) tiny: u16,
    /// Triangles drawn, counted once a face.
    pub(crate) drawn: u32,
}

impl Shown {
    pub(crate) fn new() -> Self {
        Self {
            visible: [0; LANES],
            covered: [0; LANES],
            seen: 0,
            hidden: 0,
            tiny: 0,
            drawn: 0,
        }
    }
}

#[inline(always)]
pub(crate) fn all_covered(coverage: &Coverage, [x0, x1, y0, y1]: [usize; 4]) -> bool {
    for column in x0 / WIDTH..=x1 / WIDTH {
        let from = x0.saturating_sub(column * WIDTH);
        let to = (x1 + 1 - column * WIDTH).min(WIDTH);
        let mask = low_bits(to) & !low_bits(from);
        let first = column * coverage.groups;
        for group in y0 / GROUP..=y1 / GROUP {
            let rows = &coverage.rows[first + group].0;
            let (low, high) = (y0.saturating_sub(group * GROUP), y1 - group * GROUP);
            let mut open = 0;
            for (r, bits) in rows.iter().enumerate() {
                open |= if r >= low && r <= high { !bits & mask } else { 0 };
            }
            if open != 0 {
                return false;
            }
        }
    }
    true
}

/// The box of a lane's pixels on a face, where it has any.
#[inline(always)]
fn pixel_box(t: &Transformed, boxes: &Boxes, face: Face, lane: usize, resolution: usize) -> Option<PixelBox> {
    if boxes.whole >> lane & 1 != 0 {
        Some(PixelBox {
            x0: boxes.x0[lane],
            x1: boxes.x1[lane],
            y0: boxes.y0[lane],
            y1: boxes.y1[lane],
        })
    } else if boxes.straddling >> lane & 1 != 0 {
        clipped_box(t, face, lane, resolution)
    } else {
        None
    }
}

#[inline(always)]
pub(crate) unsafe fn cover_lanes<L: Lanes>(
    t: &Transformed,
    lanes: u16,
    resolution: usize,
    top: &[u32],
    side: &[u32],
    out: &mut [(u32, u32); LANES],
) {
    for face in Face::ALL {
        // SAFETY: the caller's promise.
        let boxes = unsafe { boxes::<L>(t, face, resolution) };
        let running = if face.is_top() { top } else { side };
        let mut pending = (boxes.whole | boxes.straddling) & lanes;
        while pending != 0 {
            let lane = pending.trailing_zeros() as usize;
            pending &= pending - 1;
            let Some(pixels) = pixel_box(t, &boxes, face, lane, resolution) else {
                continue;
            };
            let (lines, _) = edge_lines(t, face, lane, resolution);
            let (count, weight) = &mut out[lane];
            // SAFETY: the caller's promise.
            unsafe {
                walk::<L>(&lines, pixels, |row, start, end| {
                    #[allow(clippy::cast_possible_truncation, reason = "at most 1024 pixels")]
                    {
                        *count += (end - start) as u32;
                    }
                    *weight += running[row * resolution + end] - running[row * resolution + start];
                });
            }
        }
    }
}

#[inline(always)]
pub(crate) unsafe fn draw<L: Lanes, const COVERED: bool>(
    t: &Transformed,
    faces: u8,
    order: &[u8],
    coverage: &mut Coverage,
    top: &[u32],
    side: &[u32],
    shown: &mut Shown,
) {
    let resolution = coverage.resolution;
    let mut pixels = [0u32; LANES];
    let open = if COVERED { open_centroids(t, coverage) } else { 0 };
    for face in Face::ALL {
        if faces >> face as u8 & 1 == 0 {
            continue;
        }
        // SAFETY: the caller's promise.
        let boxes = unsafe { boxes::<L>(t, face, resolution) };
        let on_face = (boxes.whole | boxes.straddling) & t.live;
        if on_face == 0 {
            continue;
        }
        #[allow(clippy::cast_possible_truncation, reason = "at most 1024")]
        let first_row = face.first_row(resolution as u32) as usize;
        let running = if face.is_top() { top } else { side };
        for &lane in order {
            let lane = usize::from(lane);
            if on_face >> lane & 1 == 0 {
                continue;
            }
            let Some(pixel_box) = pixel_box(t, &boxes, face, lane, resolution) else {
                continue;
            };
            if coverage.culling {
                #[allow(clippy::cast_sign_loss, reason = "a pixel box lies within its face")]
                let [x0, x1, y0, y1] = [pixel_box.x0, pixel_box.x1 - 1, pixel_box.y0, pixel_box.y1 - 1].map(|x| x as usize);
                if all_covered(coverage, [x0, x1, first_row + y0, first_row + y1]) {
                    shown.hidden |= 1 << lane;
                    continue;
                }
            }
            shown.drawn += 1;
            let (lines, _) = edge_lines(t, face, lane, resolution);
            // SAFETY: the caller's promise.
            let drawn = unsafe { draw_lane::<L, COVERED>(&lines, pixel_box, coverage, first_row, running) };
            shown.visible[lane] += drawn.visible;
            shown.covered[lane] += drawn.covered;
            pixels[lane] += drawn.pixels;
            shown.seen |= u16::from(drawn.seen) << lane;
        }
    }
    if COVERED {
        let mut none = 0;
        for (lane, &pixels) in pixels.iter().enumerate() {
            none |= u16::from(pixels == 0) << lane;
        }
        shown.tiny = none & open & !shown.hidden;
    }
}

/// What one lane showed and covered on one face.
#[derive(Default)]
struct DrawnLane {
    visible: u32,
    covered: u32,
    pixels: u32,
    seen: bool,
}

#[inline(always)]
unsafe fn draw_lane<L: Lanes, const COVERED: bool>(
    lines: &EdgeLines,
    pixels: PixelBox,
    coverage: &mut Coverage,
    first_row: usize,
    running: &[u32],
) -> DrawnLane {
    let resolution = coverage.resolution;
    let mut drawn = DrawnLane::default();
    let mut starts = [0i32; GROUP];
    let mut ends = [0i32; GROUP];
    let (x0, x1) = (f64::from(pixels.x0), f64::from(pixels.x1));
    #[allow(clippy::cast_sign_loss, reason = "a pixel box lies within its face")]
    let [left, right, y0, y1] = [pixels.x0, pixels.x1 - 1, pixels.y0, pixels.y1].map(|x| x as usize);
    let (first, last) = (left / WIDTH, right / WIDTH);
    let mut y = y0 / GROUP * GROUP;
    while y < y1 {
        // SAFETY: the caller's promise.
        let mut rows = unsafe { L::spans(lines, y as f64, x0, x1, &mut starts, &mut ends) };
        if lines.any_flat {
            rows = flat_rows(lines, y as f64, rows);
        }
        if y < y0 {
            rows &= u8::MAX << (y0 - y);
        }
        if y + GROUP > y1 {
            rows &= u8::MAX >> (y + GROUP - y1);
        }
        if rows != 0 {
            let group = (first_row + y) / GROUP;
            let mut visible = [Rows([0; GROUP]); MOST_COLUMNS];
            // Rows of which a pixel is seen, and rows of which one is not.
            let (mut seen, mut unseen) = (0u8, 0u8);
            for column in first..=last {
                let covered = &mut coverage.rows[column * coverage.groups + group].0;
                let (s, u) = mark(&starts, &ends, rows, column, covered, &mut visible[column - first].0);
                seen |= s;
                unseen |= u;
            }
            let face_row = y * resolution;
            let mut left = if COVERED { rows } else { seen };
            drawn.seen |= seen != 0;
            while left != 0 {
                let r = left.trailing_zeros() as usize;
                left &= left - 1;
                let row = &running[face_row + r * resolution..];
                #[allow(clippy::cast_sign_loss, reason = "spans lie within the pixel box")]
                let (start, end) = (starts[r] as usize, ends[r] as usize);
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

/// Covers the part of eight spans that lies in one column; returns the rows of which a pixel was not covered before, and
/// those of which one was.
#[inline(always)]
fn mark(
    starts: &[i32; GROUP],
    ends: &[i32; GROUP],
    rows: u8,
    column: usize,
    covered: &mut [u64; GROUP],
    visible: &mut [u64; GROUP],
) -> (u8, u8) {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        reason = "at most 1024 pixels"
    )]
    let offset = (column * WIDTH) as i32;
    let (mut seen, mut unseen) = (0, 0);
    for r in 0..GROUP {
        #[allow(clippy::cast_sign_loss, reason = "clamped")]
        let (from, to) = ((starts[r] - offset).clamp(0, 64) as u64, (ends[r] - offset).clamp(0, 64) as u64);
        let above = |count: u64| if count >= 64 { 0 } else { u64::MAX << count };
        let mask = if rows >> r & 1 != 0 { above(from) & !above(to) } else { 0 };
        let shows = mask & !covered[r];
        covered[r] |= mask;
        visible[r] = shows;
        seen |= u8::from(shows != 0) << r;
        unseen |= u8::from(shows != mask) << r;
    }
    (seen, unseen)
}

/// Lanes whose centroid lies above the horizon at a pixel that nothing covers.
#[inline(always)]
fn open_centroids(t: &Transformed, coverage: &Coverage) -> u16 {
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
        // The frames of the faces, as `Face::axes` gives them.
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
        let edge = 2.0 * half - 1.0;
        let column = clamped(u * inverse * half + half, edge);
        let (shift, first, last) = if on_top {
            (half, 0.0, edge)
        } else {
            (0.0, 2.0 * half + side * half, half - 1.0)
        };
        let row = clamped(v * inverse * half + shift, last) + first;
        // SAFETY: both are clamped to the atlas, by comparisons that NaN does not pass.
        unsafe {
            rows[l] = row.to_int_unchecked();
            columns[l] = column.to_int_unchecked();
        }
        above[l] = u32::from(z > 0.0);
    }
    let mut open = 0;
    let mut lanes = t.live;
    while lanes != 0 {
        let l = lanes.trailing_zeros() as usize;
        lanes &= lanes - 1;
        if above[l] != 0 && !coverage.is_covered(rows[l] as usize, columns[l] as usize) {
            open |= 1 << l;
        }
    }
    open
}

/// x, between 0 and `most`; NaN is 0.
#[inline(always)]
fn clamped(x: f32, most: f32) -> f32 {
    let x = if x > 0.0 { x } else { 0.0 };
    if x < most { x } else { most }
}
