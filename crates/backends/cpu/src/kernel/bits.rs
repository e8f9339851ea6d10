//! The arithmetic of engine `order`: one bit a pixel that says whether something covers it. What is drawn strictly
//! front to back needs no depth and no ids: what a triangle shows is what it covers and nothing covered before.
//!
//! Spans are those of engine `depth`, to the bit.

use super::{
    Boxes, Frame, GROUP, Lanes, PixelBox, Transformed, boxes, clipped_box, edge_lines, flat_rows, in_frame,
    spans_within, three, walk,
};
use crate::order::Lines;
use hemicube_contract::bvh::{Block, LANES};
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::face::Face;
use std::ops::Range;

/// Pixels of a column of words: one bit each.
pub(super) const WIDTH: usize = u64::BITS as usize;
/// Words of a row at the largest resolution.
pub(super) const MOST_COLUMNS: usize = 1024 / WIDTH;

/// From this resolution on, centroids are asked before a plane is drawn.
const LEAST_TO_ASK: usize = 512;

/// Eight rows of one column: what is drawn at a time.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Rows(pub(super) [u64; GROUP]);

/// Which pixels of the atlas are covered.
#[derive(Debug)]
pub(crate) struct Coverage {
    pub(crate) resolution: usize,
    /// Groups of eight rows in a column: all of the atlas.
    pub(super) groups: usize,
    /// By column, then by group; and one that is of no column.
    pub(super) rows: Vec<Rows>,
    /// What was covered before the surfaces of one plane were begun, as far as was asked: surfaces in one plane do not
    /// hide each other's centroids.
    before: Vec<Rows>,
    /// True if all of that was remembered.
    all_remembered: bool,
    /// True if anything is: of fine hemicubes, asking all centroids before a plane is drawn takes less time.
    pub(crate) remembers: bool,
    /// True if triangles whose box is covered are left out.
    pub(crate) culling: bool,
    /// What is drawn, where that is to be known later.
    pub(crate) record: Option<Record>,
    /// What all pixels of eight rows of a column weigh, in the order of `rows`, if weights are asked.
    weights: Vec<u32>,
}

/// What lanes of blocks show on a face, and what of the pixels that they touch was open when that was remembered.
#[derive(Debug, Default)]
pub(crate) struct Record {
    /// Where eight words begin, in a coverage as one array of words, and what is shown of them.
    places: Vec<u32>,
    shows: Vec<Rows>,
    /// Where words of a column begin, and their range in `open`.
    columns: Vec<(u32, Range<usize>)>,
    open: Vec<u64>,
    /// Lanes that show something on a face.
    pub(crate) lanes: Vec<(usize, Recorded)>,
    /// True if what was open is recorded.
    has_open: bool,
}

/// What a record has of a lane on a face: ranges of its lists.
#[derive(Clone, Debug)]
pub(crate) struct Recorded {
    pub(crate) face: Face,
    shows: Range<usize>,
    columns: Range<usize>,
}

impl Record {
    pub(crate) fn clear(&mut self) {
        self.places.clear();
        self.shows.clear();
        self.columns.clear();
        self.open.clear();
        self.lanes.clear();
    }

    /// Ends what is shown of a lane on a face, which has shown from place `shows` on, by what was open of some rows of
    /// columns.
    fn end_lane(
        &mut self,
        (lane, face): (usize, Face),
        shows: usize,
        before: &[u64],
        rows_of_column: usize,
        [x0, x1, y0, y1]: [usize; 4],
    ) {
        let columns = self.columns.len();
        let touched = if self.has_open {
            x0 / WIDTH..x1 / WIDTH + 1
        } else {
            0..0
        };
        for column in touched {
            let start = self.open.len();
            let place = column * rows_of_column + y0;
            self.open
                .extend(before[place..=place + y1 - y0].iter().map(|word| !word));
            #[allow(clippy::cast_possible_truncation, reason = "fewer than pixels of an atlas")]
            self.columns.push((place as u32, start..self.open.len()));
        }
        let recorded = Recorded {
            face,
            shows: shows..self.shows.len(),
            columns: columns..self.columns.len(),
        };
        self.lanes.push((lane, recorded));
    }

    /// Uncovers in `coverage` what a lane shows.
    pub(crate) fn uncover(&self, of: &Recorded, coverage: &mut Coverage) {
        let words = words_mut(&mut coverage.rows);
        let (places, shows) = (&self.places[of.shows.clone()], &self.shows[of.shows.clone()]);
        for (&place, Rows(shows)) in places.iter().zip(shows) {
            for (word, bits) in words[place as usize..][..GROUP].iter_mut().zip(shows) {
                *word &= !bits;
            }
        }
    }

    /// Covers that again.
    pub(crate) fn cover(&self, of: &Recorded, coverage: &mut Coverage) {
        let words = words_mut(&mut coverage.rows);
        for &place in &self.places[of.shows.clone()] {
            words[place as usize..][..GROUP].fill(u64::MAX);
        }
    }

    /// Uncovers in `coverage` what was open.
    pub(crate) fn uncover_open(&self, of: &Recorded, coverage: &mut Coverage) {
        let words = words_mut(&mut coverage.rows);
        for (place, range) in &self.columns[of.columns.clone()] {
            let open = &self.open[range.clone()];
            for (word, bits) in words[*place as usize..][..open.len()].iter_mut().zip(open) {
                *word &= !bits;
            }
        }
    }

    /// Covers that again.
    pub(crate) fn cover_open(&self, of: &Recorded, coverage: &mut Coverage) {
        let words = words_mut(&mut coverage.rows);
        for (place, range) in &self.columns[of.columns.clone()] {
            words[*place as usize..][..range.len()].fill(u64::MAX);
        }
    }
}

/// Rows of words as one array.
fn words(rows: &[Rows]) -> &[u64] {
    // SAFETY: `Rows` is an array of words and nothing else.
    unsafe { std::slice::from_raw_parts(rows.as_ptr().cast(), rows.len() * GROUP) }
}

/// [`words`], to be written to.
fn words_mut(rows: &mut [Rows]) -> &mut [u64] {
    // SAFETY: as above.
    unsafe { std::slice::from_raw_parts_mut(rows.as_mut_ptr().cast(), rows.len() * GROUP) }
}

impl Coverage {
    pub(crate) fn new(resolution: u32, culling: bool) -> Self {
        let resolution = resolution as usize;
        let groups = 3 * resolution / GROUP;
        // Eight rows are drawn from wherever a triangle begins, and may reach past the last of all.
        let rows = vec![Rows([0; GROUP]); groups * resolution.div_ceil(WIDTH) + 1];
        Self {
            resolution,
            groups,
            before: rows.clone(),
            rows,
            all_remembered: false,
            remembers: resolution < LEAST_TO_ASK,
            culling,
            record: None,
            weights: Vec::new(),
        }
    }

    /// The same, which records what is drawn, and what was open where it is drawn if that is asked.
    pub(crate) fn recording(mut self, has_open: bool) -> Self {
        self.record = Some(Record {
            has_open,
            ..Record::default()
        });
        // What was open is asked of parts, when what they are parts of was drawn.
        self.remembers |= has_open;
        self
    }

    /// Records what is shown of eight rows of a column, in the atlas from `row` on.
    #[inline(always)]
    fn note(&mut self, column: usize, row: usize, shows: &Rows) {
        if let Some(record) = &mut self.record {
            #[allow(clippy::cast_possible_truncation, reason = "fewer than pixels of an atlas")]
            record.places.push((column * self.groups * GROUP + row) as u32);
            record.shows.push(*shows);
        }
    }

    /// Begins the surfaces of a plane: from here on nothing is covered until all that is to be remembered is.
    pub(crate) fn begin_plane(&mut self) {
        self.all_remembered = false;
    }

    /// Remembers what is covered of all of the atlas.
    pub(crate) fn remember_all(&mut self) {
        if self.remembers && !self.all_remembered {
            self.before.copy_from_slice(&self.rows);
            self.all_remembered = true;
        }
    }

    /// Remembers what is covered now of a box of the atlas (inclusive).
    pub(crate) fn remember(&mut self, [x0, x1, y0, y1]: [usize; 4]) {
        if self.all_remembered || !self.remembers {
            return;
        }
        for column in x0 / WIDTH..=x1 / WIDTH {
            let range = column * self.groups + y0 / GROUP..=column * self.groups + y1 / GROUP;
            self.before[range.clone()].copy_from_slice(&self.rows[range]);
        }
    }

    /// Covers a box of the atlas (inclusive).
    #[cfg(test)]
    pub(crate) fn cover(&mut self, [x0, x1, y0, y1]: [usize; 4]) {
        for y in y0..=y1 {
            for x in x0..=x1 {
                self.rows[x / WIDTH * self.groups + y / GROUP].0[y % GROUP] |= 1 << (x % WIDTH);
            }
        }
    }

    pub(crate) fn clear(&mut self) {
        self.rows.fill(Rows([0; GROUP]));
    }

    /// One in which everything is covered, and triangles whose box is covered are left out.
    pub(crate) fn full(resolution: u32) -> Self {
        let mut coverage = Self::new(resolution, true);
        coverage.rows.fill(Rows([u64::MAX; GROUP]));
        coverage
    }

    /// Uncovers pixels `start..end` of a row of the atlas.
    pub(crate) fn open_span(&mut self, row: usize, start: usize, end: usize) {
        self.each_word(row, start, end, |covered, bits| *covered &= !bits);
    }

    /// Covers them.
    pub(crate) fn cover_span(&mut self, row: usize, start: usize, end: usize) {
        self.each_word(row, start, end, |covered, bits| *covered |= bits);
    }

    #[inline(always)]
    fn each_word(&mut self, row: usize, start: usize, end: usize, each: impl Fn(&mut u64, u64)) {
        for column in start / WIDTH..=(end - 1) / WIDTH {
            let left = column * WIDTH;
            let bits = low_bits(end - left) & !low_bits(start.saturating_sub(left));
            each(&mut self.rows[column * self.groups + row / GROUP].0[row % GROUP], bits);
        }
    }

    /// Returns whether a pixel of the atlas is covered, or was when that was remembered.
    #[inline(always)]
    pub(crate) fn is_covered(&self, row: usize, x: usize, remembered: bool) -> bool {
        let rows = if remembered { &self.before } else { &self.rows };
        rows[x / WIDTH * self.groups + row / GROUP].0[row % GROUP] >> (x % WIDTH) & 1 != 0
    }

    /// The same, of which it can be asked what pixels weigh.
    pub(crate) fn weighing(mut self, table: &DeltaTable) -> Self {
        let (top, side) = (table.running(Face::Top), table.running(Face::PosX));
        let places = self.places();
        self.weights = places
            .map(|(column, group)| self.weight_of_group(column, group, [0; GROUP], top, side))
            .collect();
        self
    }

    /// By column, then by group.
    fn places(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (columns, groups) = (self.resolution.div_ceil(WIDTH), self.groups);
        (0..columns).flat_map(move |column| (0..groups).map(move |group| (column, group)))
    }

    /// The pixels of a row that a column has.
    fn bits_of(&self, column: usize) -> u64 {
        low_bits((self.resolution - column * WIDTH).min(WIDTH))
    }

    /// The weight of those pixels of eight rows of a column that are not covered.
    fn weight_of_group(&self, column: usize, group: usize, covered: [u64; GROUP], top: &[u32], side: &[u32]) -> u32 {
        let whole = self.bits_of(column);
        let mut weight = 0;
        for (r, covered) in covered.into_iter().enumerate() {
            let open = !covered & whole;
            if open != 0 {
                let (running, row) = row_of(self.resolution, group * GROUP + r, top, side);
                weight += weight_of(open, &running[row * self.resolution + column * WIDTH..]);
            }
        }
        weight
    }

    /// The weight of all pixels that nothing covers: of a coverage that is [`weighing`](Self::weighing).
    pub(crate) fn open_weight(&self, top: &[u32], side: &[u32]) -> u32 {
        assert_eq!(self.weights.len() + 1, self.rows.len(), "a coverage that is weighing");
        let mut weight = 0;
        for (((column, group), rows), &all) in self.places().zip(&self.rows).zip(&self.weights) {
            let whole = self.bits_of(column);
            let rows = &rows.0;
            if rows.iter().fold(whole, |all, bits| all & bits) == whole {
                continue;
            }
            // Of most, all is open: the sky has more pixels than the roofs before it.
            if rows.iter().fold(0, |any, bits| any | bits) & whole == 0 {
                weight += all;
            } else {
                weight += self.weight_of_group(column, group, *rows, top, side);
            }
        }
        weight
    }
}

/// The running sum of the face that a row of the atlas belongs to, and which of its rows that is: the four sides share
/// a table.
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
pub(super) fn low_bits(count: usize) -> u64 {
    if count >= WIDTH { u64::MAX } else { (1 << count) - 1 }
}

/// The weight of the pixels whose bits are set; `running` begins at that of the lowest bit.
#[inline(always)]
pub(super) fn weight_of(mut bits: u64, running: &[u32]) -> u32 {
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
#[repr(C, align(64))]
pub(crate) struct Shown {
    pub(crate) visible: [u32; LANES],
    /// Only with `COVERED`.
    pub(crate) covered: [u32; LANES],
    /// Lanes of which a pixel is seen.
    pub(crate) seen: u16,
    /// Lanes that were left out on some face, as all their box was covered.
    pub(crate) hidden: u16,
    /// Lanes that were not found to cover a pixel and whose centroid was seen before any lane was drawn, where that was
    /// asked. Only with `COVERED`.
    pub(crate) tiny: u16,
    /// Lanes that were not found to cover a pixel. Only with `COVERED`.
    pub(crate) without: u16,
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
            without: 0,
            drawn: 0,
        }
    }
}

/// A place in a pixel box: none is negative.
#[inline(always)]
pub(super) fn at(x: i32) -> usize {
    #[allow(clippy::cast_sign_loss, reason = "a pixel box lies within its face")]
    let at = x as u32;
    at as usize
}

/// Which of eight words lack one of the bits of `mask`.
#[inline(always)]
pub(super) fn lacking(rows: &[u64; GROUP], mask: u64) -> u8 {
    let mut lacking = 0;
    for (r, &bits) in rows.iter().enumerate() {
        lacking |= u8::from(!bits & mask != 0) << r;
    }
    lacking
}

/// [`lacking`] with a row in each lane.
///
/// # Safety
/// The machine has AVX-512 F.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) unsafe fn lacking_avx512(rows: &[u64; GROUP], mask: u64) -> u8 {
    use std::arch::x86_64::*;
    // SAFETY: the caller's promise of the instruction set; the load is as long as the array.
    unsafe {
        let bits = _mm512_loadu_epi64(rows.as_ptr().cast());
        let mask = _mm512_set1_epi64(mask.cast_signed());
        _mm512_cmpneq_epi64_mask(_mm512_and_si512(bits, mask), mask)
    }
}

/// [`lacking`] with four rows in each register.
///
/// # Safety
/// The machine has AVX2.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) unsafe fn lacking_avx2(rows: &[u64; GROUP], mask: u64) -> u8 {
    use std::arch::x86_64::*;
    // SAFETY: the caller's promise of the instruction set; the two loads are as long as the array.
    unsafe {
        let mask = _mm256_set1_epi64x(mask.cast_signed());
        let half = |k: usize| {
            let bits = _mm256_loadu_si256(rows.as_ptr().cast::<__m256i>().add(k));
            let all = _mm256_cmpeq_epi64(_mm256_and_si256(bits, mask), mask);
            _mm256_movemask_pd(_mm256_castsi256_pd(all))
        };
        !low_byte(half(0) | half(1) << 4)
    }
}

/// Returns whether every pixel of a box of the atlas (inclusive) is covered.
#[inline(always)]
pub(crate) unsafe fn all_covered<L: Lanes>(coverage: &Coverage, pixels: [usize; 4]) -> bool {
    // SAFETY: the caller's promise.
    none_of(&coverage.rows, coverage.groups, pixels, |rows, mask| unsafe {
        L::lacking(rows, mask)
    })
}

/// Those of some lanes that may have a point on one of these faces at a pixel that was not covered when that was
/// remembered: at least those that do.
#[inline(always)]
pub(crate) unsafe fn may_touch_open<L: Lanes>(t: &Transformed, lanes: u16, faces: u8, coverage: &Coverage) -> u16 {
    let resolution = coverage.resolution;
    let mut found = 0;
    for face in Face::ALL {
        if faces >> face as u8 & 1 == 0 {
            continue;
        }
        // SAFETY: the caller's promise.
        let boxes = unsafe { boxes::<L>(t, face, resolution) };
        found |= lanes & boxes.straddling;
        #[allow(clippy::cast_possible_truncation, reason = "at most 1024")]
        let first_row = face.first_row(resolution as u32) as usize;
        let height = if face.is_top() { resolution } else { resolution / 2 };
        let mut asked = lanes & !found;
        while asked != 0 {
            let lane = asked.trailing_zeros() as usize;
            asked &= asked - 1;
            // What touches a pixel is at most one beyond those whose centres it may cover, of which there may be none.
            let touched = |from: i32, to: i32, count: usize| (at((from - 1).max(0)), at(to.max(0)).min(count - 1));
            let (x0, x1) = touched(boxes.x0[lane], boxes.x1[lane], resolution);
            let (y0, y1) = touched(boxes.y0[lane], boxes.y1[lane], height);
            if x0 > x1 || y0 > y1 {
                continue;
            }
            // SAFETY: likewise.
            let is_covered = none_of(
                &coverage.before,
                coverage.groups,
                [x0, x1, first_row + y0, first_row + y1],
                |rows, mask| unsafe { L::lacking(rows, mask) },
            );
            found |= u16::from(!is_covered) << lane;
        }
    }
    found
}

/// Returns whether no pixel of a box of the atlas (inclusive) is covered.
#[inline(always)]
unsafe fn all_open<L: Lanes>(coverage: &Coverage, pixels: [usize; 4]) -> bool {
    // SAFETY: the caller's promise.
    none_of(&coverage.rows, coverage.groups, pixels, |rows, mask| unsafe {
        L::any_of(rows, mask)
    })
}

/// Whether none of a box's rows is among those that `which` says of eight rows of a column and the bits of the box
/// there.
#[inline(always)]
fn none_of(
    rows: &[Rows],
    groups: usize,
    [x0, x1, y0, y1]: [usize; 4],
    which: impl Fn(&[u64; GROUP], u64) -> u8,
) -> bool {
    for column in x0 / WIDTH..=x1 / WIDTH {
        let from = x0.saturating_sub(column * WIDTH);
        let to = (x1 + 1 - column * WIDTH).min(WIDTH);
        let mask = low_bits(to) & !low_bits(from);
        let column = &rows[column * groups..][..groups];
        let (low, high) = (y0 / GROUP, y1 / GROUP);
        for (group, rows) in (low..).zip(&column[low..=high]) {
            let mut found = which(&rows.0, mask);
            if group == low {
                found &= u8::MAX << (y0 % GROUP);
            }
            if group == high {
                found &= u8::MAX >> (GROUP - 1 - y1 % GROUP);
            }
            if found != 0 {
                return false;
            }
        }
    }
    true
}

/// Lanes of a block that have a box of pixels on one of these faces alone, none of which is covered.
#[inline(always)]
pub(crate) unsafe fn in_the_open<L: Lanes>(t: &Transformed, faces: u8, coverage: &Coverage) -> u16 {
    let resolution = coverage.resolution;
    let (mut open, mut any, mut several) = (0u16, 0u16, 0u16);
    for face in Face::ALL {
        if faces >> face as u8 & 1 == 0 {
            continue;
        }
        // SAFETY: the caller's promise.
        let boxes = unsafe { boxes::<L>(t, face, resolution) };
        several |= any & boxes.whole;
        // What reaches beyond the eye may be nowhere on this face. That must not be taken for being on it, as faces are
        // left out where all that they were asked for is nowhere.
        let mut straddling = boxes.straddling & !several;
        while straddling != 0 {
            let lane = straddling.trailing_zeros() as usize;
            straddling &= straddling - 1;
            several |= u16::from(clipped_box(t, face, lane, resolution).is_some()) << lane;
        }
        let mut asked = boxes.whole & !any & !several;
        any |= boxes.whole;
        #[allow(clippy::cast_possible_truncation, reason = "at most 1024")]
        let first_row = face.first_row(resolution as u32) as usize;
        while asked != 0 {
            let lane = asked.trailing_zeros() as usize;
            asked &= asked - 1;
            let (x0, x1) = (at(boxes.x0[lane]), at(boxes.x1[lane]) - 1);
            let (y0, y1) = (at(boxes.y0[lane]), at(boxes.y1[lane]) - 1);
            // SAFETY: likewise.
            let is_open = unsafe { all_open::<L>(coverage, [x0, x1, first_row + y0, first_row + y1]) };
            open |= u16::from(is_open) << lane;
        }
    }
    open & !several
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
    faces: u8,
    resolution: usize,
    top: &[u32],
    side: &[u32],
    out: &mut [(u32, u32); LANES],
) {
    for face in Face::ALL {
        if faces >> face as u8 & 1 == 0 {
            continue;
        }
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

/// In what order the lanes of a block are drawn, and of what it is asked whether their centroids are seen.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Turns<'a> {
    /// These lanes, nearest first; centroids are asked of what is covered before.
    InOrder(&'a [u8]),
    /// All lanes, which hide nothing of each other; centroids are asked of what was covered when that was remembered.
    Together,
    /// Likewise, where that was asked: these lanes' centroids are open.
    Asked(u16),
    /// Likewise, as parts of something; centroids are not asked.
    Parts,
}

/// What the pieces of a block were cut from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cut<'a> {
    pub(crate) lines: &'a Lines,
    pub(crate) frame: &'a Frame,
}

impl Cut<'_> {
    /// Gives some pieces the edges of the surfaces they are part of, by the operations of `transform`.
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

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "the arguments of `Kernel::draw_bits`")]
pub(crate) unsafe fn draw<L: Lanes, const COVERED: bool>(
    t: &mut Transformed,
    cut: Option<Cut<'_>>,
    faces: u8,
    turns: Turns<'_>,
    coverage: &mut Coverage,
    top: &[u32],
    side: &[u32],
    shown: &mut Shown,
) {
    let resolution = coverage.resolution;
    let mut with_pixels = 0u16;
    let mut on_lines = 0u16;
    let mut lines = BlockLines::new();
    // What is remembered stays, so that it can be asked later, of the few that turn out to have no pixel.
    let (order, open) = match turns {
        Turns::InOrder(order) if COVERED => (Some(order), open_centroids(t, t.live, faces, coverage, false)),
        Turns::InOrder(order) => (Some(order), 0),
        Turns::Asked(open) => (None, open),
        Turns::Together | Turns::Parts => (None, 0),
    };
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
        lines.ready = 0;
        if cut.is_none() && on_face.count_ones() >= MANY_LANES {
            // SAFETY: the caller's promise.
            unsafe { L::block_lines(t, face, resolution, &mut lines) };
        }
        let mut pending = on_face;
        let mut order = order.map(|order| order.iter());
        loop {
            // In ascending order where nothing hides anything, which saves looking at those that are not on the face.
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
            // One number after the other: a box stored in parts and loaded whole would have to wait for all of them.
            let (left, right, low, high);
            if boxes.whole >> lane & 1 != 0 {
                (left, right) = (boxes.x0[lane], boxes.x1[lane]);
                (low, high) = (boxes.y0[lane], boxes.y1[lane]);
            } else {
                let Some(clipped) = clipped_box(t, face, lane, resolution) else {
                    continue;
                };
                (left, right) = (clipped.x0, clipped.x1);
                (low, high) = (clipped.y0, clipped.y1);
            }
            if coverage.culling {
                let (x0, y0) = (at(left), first_row + at(low));
                let (x1, y1) = (at(right) - 1, first_row + at(high) - 1);
                // SAFETY: the caller's promise.
                if unsafe { all_covered::<L>(coverage, [x0, x1, y0, y1]) } {
                    shown.hidden |= 1 << lane;
                    continue;
                }
            }
            shown.drawn += 1;
            let recorded = coverage.record.as_ref().map_or(0, |record| record.shows.len());
            if let Some(cut) = &cut
                && on_lines >> lane & 1 == 0
            {
                // Of most blocks of pieces one is drawn, or none; where it is more, all of them take as long as two.
                if on_lines == 0 {
                    on_lines = 1 << lane;
                    cut.put_on_lines(t, lane..lane + 1);
                } else {
                    on_lines = u16::MAX;
                    cut.put_on_lines(t, 0..LANES);
                }
            }
            // SAFETY: the caller's promise.
            let drawn =
                unsafe { L::draw_lane::<COVERED>(t, &lines, face, lane, left, right, low, high, coverage, running) };
            shown.visible[lane] += drawn.visible;
            shown.covered[lane] += drawn.covered;
            with_pixels |= u16::from(drawn.pixels != 0) << lane;
            shown.seen |= u16::from(drawn.seen) << lane;
            if drawn.seen
                && let Some(record) = &mut coverage.record
            {
                // Points are at most a pixel beyond the rows whose centres they surround. Of a piece, what was open
                // there may not have been remembered, and points of other pieces may lie there.
                let beyond = usize::from(cut.is_none());
                let height = if face.is_top() { resolution } else { resolution / 2 };
                let (y0, y1) = (at(low).saturating_sub(beyond), (at(high) - 1 + beyond).min(height - 1));
                let touched = [at(left), at(right) - 1, first_row + y0, first_row + y1];
                let rows_of_column = coverage.groups * GROUP;
                record.end_lane((lane, face), recorded, words(&coverage.before), rows_of_column, touched);
            }
        }
    }
    if COVERED {
        let none = t.live & !with_pixels;
        shown.without = none;
        shown.tiny = match turns {
            Turns::InOrder(_) | Turns::Asked(_) => none & open,
            Turns::Together if none != 0 => open_centroids(t, none, faces, coverage, true),
            Turns::Together => 0,
            Turns::Parts => none,
        };
    }
}

/// The edges of a block's triangles as lines over a face's pixels: where the span of row y begins or ends, x = slope ·
/// y + offset. What one division for each lane costs is little less than what one for all of them does.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct BlockLines {
    slope: [[f64; LANES]; 3],
    offset: [[f64; LANES]; 3],
    /// Lanes whose spans edge k bounds from the left, and from the right.
    left: [u16; 3],
    right: [u16; 3],
    /// Lanes of which the above says something.
    ready: u16,
}

impl BlockLines {
    fn new() -> Self {
        Self {
            slope: [[0.0; LANES]; 3],
            offset: [[0.0; LANES]; 3],
            left: [0; 3],
            right: [0; 3],
            ready: 0,
        }
    }
}

/// So many lanes are worth having the lines of all of them at once.
const MANY_LANES: u32 = 4;

/// What one lane showed and covered on one face.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct DrawnLane {
    visible: u32,
    /// This and the next only with `COVERED`.
    covered: u32,
    pixels: u32,
    seen: bool,
}

/// The lane of a block on a face, eight rows at a time: what [`Lanes::draw_lane`] must reproduce.
#[inline(always)]
#[allow(
    clippy::too_many_arguments,
    reason = "private, called once: numbers that stay in registers"
)]
pub(super) unsafe fn draw_lane<L: Lanes, const COVERED: bool>(
    t: &Transformed,
    face: Face,
    lane: usize,
    left: i32,
    right: i32,
    low: i32,
    high: i32,
    coverage: &mut Coverage,
    running: &[u32],
) -> DrawnLane {
    let resolution = coverage.resolution;
    let (lines, _) = edge_lines(t, face, lane, resolution);
    #[allow(clippy::cast_possible_truncation, reason = "at most 1024")]
    let first_row = face.first_row(resolution as u32) as usize;
    let mut drawn = DrawnLane::default();
    let mut starts = [0i32; GROUP];
    let mut ends = [0i32; GROUP];
    let pixels = PixelBox {
        x0: left,
        x1: right,
        y0: low,
        y1: high,
    };
    let (first, last) = (at(left) / WIDTH, (at(right) - 1) / WIDTH);
    let mut y = at(low) / GROUP * GROUP;
    while y < at(high) {
        // SAFETY: the caller's promise.
        let rows = unsafe { spans_within::<L>(&lines, y, pixels, &mut starts, &mut ends) };
        if rows != 0 {
            let group = (first_row + y) / GROUP;
            let mut visible = [Rows([0; GROUP]); MOST_COLUMNS];
            // Rows of which a pixel is seen, and rows of which one is not.
            let (mut seen, mut unseen) = (0u8, 0u8);
            for column in first..=last {
                let covered = &mut coverage.rows[column * coverage.groups + group].0;
                let (s, u) = mark(
                    &starts,
                    &ends,
                    rows,
                    column,
                    covered,
                    &mut visible[column - first].0,
                    None,
                );
                seen |= s;
                unseen |= u;
            }
            for column in (first..=last).filter(|_| seen != 0) {
                coverage.note(column, first_row + y, &visible[column - first]);
            }
            let face_row = y * resolution;
            let mut pending = if COVERED { rows } else { seen };
            drawn.seen |= seen != 0;
            while pending != 0 {
                let r = pending.trailing_zeros() as usize;
                pending &= pending - 1;
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

/// Covers the part of eight spans that lies in one column; returns the rows of which a pixel was not covered before,
/// and those of which one was. Those pixels are written to `over`.
#[inline(always)]
pub(super) fn mark(
    starts: &[i32; GROUP],
    ends: &[i32; GROUP],
    rows: u8,
    column: usize,
    covered: &mut [u64; GROUP],
    visible: &mut [u64; GROUP],
    mut over: Option<&mut [u64; GROUP]>,
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
        let (from, to) = (
            (starts[r] - offset).clamp(0, 64) as u64,
            (ends[r] - offset).clamp(0, 64) as u64,
        );
        let above = |count: u64| if count >= 64 { 0 } else { u64::MAX << count };
        let mask = if rows >> r & 1 != 0 {
            above(from) & !above(to)
        } else {
            0
        };
        let shows = mask & !covered[r];
        if let Some(over) = &mut over {
            over[r] = mask & covered[r];
        }
        covered[r] |= mask;
        visible[r] = shows;
        seen |= u8::from(shows != 0) << r;
        unseen |= u8::from(shows != mask) << r;
    }
    (seen, unseen)
}

/// [`mark`] with a row in each lane.
///
/// # Safety
/// The machine has AVX-512 F, BW, DQ and VL.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) unsafe fn mark_avx512(
    starts: &[i32; GROUP],
    ends: &[i32; GROUP],
    rows: u8,
    column: usize,
    covered: &mut [u64; GROUP],
    visible: &mut [u64; GROUP],
    over: &mut [u64; GROUP],
) -> (u8, u8) {
    use std::arch::x86_64::*;
    // SAFETY: the caller's promise of the instruction set; loads and stores are as long as their arrays.
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
        let (from, to) = (place(starts), place(ends));
        let mask = _mm512_maskz_andnot_epi64(rows, _mm512_sllv_epi64(ones, to), _mm512_sllv_epi64(ones, from));
        let before = _mm512_loadu_epi64(covered.as_ptr().cast());
        let shows = _mm512_andnot_si512(before, mask);
        let both = _mm512_and_si512(before, mask);
        _mm512_storeu_epi64(covered.as_mut_ptr().cast(), _mm512_or_si512(before, mask));
        _mm512_storeu_epi64(visible.as_mut_ptr().cast(), shows);
        _mm512_storeu_epi64(over.as_mut_ptr().cast(), both);
        (_mm512_test_epi64_mask(shows, shows), _mm512_test_epi64_mask(both, both))
    }
}

/// The values of a lane's edges over a face's pixels, a · x + b · y + c, an edge in each of three lanes: by the
/// operations of `affine` and `edge_lines`.
///
/// # Safety
/// The machine has AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn edge_values(t: &Transformed, face: Face, lane: usize, resolution: usize) -> [std::arch::x86_64::__m256d; 3] {
    use std::arch::x86_64::*;
    let (axis, sign) = face.axes();
    let edge = |c: usize| {
        let e = &t.edges;
        let a = axis[c];
        let e = _mm256_setr_pd(e[a][lane], e[3 + a][lane], e[6 + a][lane], 1.0);
        _mm256_mul_pd(_mm256_set1_pd(sign[c]), e)
    };
    let (eu, ev, ew) = (edge(0), edge(1), edge(2));
    let step = 2.0 / resolution as f64;
    let u0 = 0.5 * step - 1.0;
    let v0 = if face.is_top() { u0 } else { 0.5 * step };
    let a = _mm256_mul_pd(eu, _mm256_set1_pd(step));
    let b = _mm256_mul_pd(ev, _mm256_set1_pd(step));
    let c = _mm256_add_pd(
        _mm256_add_pd(ew, _mm256_mul_pd(eu, _mm256_set1_pd(u0))),
        _mm256_mul_pd(ev, _mm256_set1_pd(v0)),
    );
    [a, b, c]
}

/// Weighs eight spans that begin and end at these places of a running sum: those in `weighed`, and of them those in
/// `whole`, which show all of theirs. The others begin and end at 0.
///
/// # Safety
/// All places lie within `running`.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
unsafe fn weigh<const COVERED: bool>(
    running: &[u32],
    before: &[u32; GROUP],
    after: &[u32; GROUP],
    mut whole: u8,
    weighed: u8,
    drawn: &mut DrawnLane,
) {
    // In memory, or the compiler makes gathers of it, which are slower.
    let (before, after) = (std::hint::black_box(before), std::hint::black_box(after));
    // SAFETY: the caller's promise.
    let weight =
        |r: usize| unsafe { running.get_unchecked(after[r] as usize) - running.get_unchecked(before[r] as usize) };
    let mut all = 0u32;
    for r in 0..GROUP {
        all = all.wrapping_add(weight(r));
    }
    if COVERED {
        drawn.covered = drawn.covered.wrapping_add(all);
    }
    if weighed == whole {
        drawn.visible = drawn.visible.wrapping_add(all);
        return;
    }
    while whole != 0 {
        drawn.visible = drawn.visible.wrapping_add(weight(whole.trailing_zeros() as usize));
        whole &= whole - 1;
    }
}

/// The weight of what shows of one of eight rows, whose running sum is `row`, in the columns from `first` on.
///
/// # Safety
/// What shows of those columns was written.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
unsafe fn weight_of_row(row: &[u32], first: usize, shows: &[std::mem::MaybeUninit<Rows>], r: usize) -> u32 {
    let mut weight = 0;
    for (column, shows) in (first..).zip(shows) {
        // SAFETY: the caller's promise.
        let bits = unsafe { shows.assume_init_ref() }.0[r];
        weight += weight_of(bits, &row[column * WIDTH..]);
    }
    weight
}

/// The lines of all lanes of a block, by the operations of `affine` and `edge_lines`.
///
/// # Safety
/// The machine has AVX-512 F.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
pub(super) unsafe fn block_lines_avx512(t: &Transformed, face: Face, resolution: usize, out: &mut BlockLines) {
    use std::arch::x86_64::*;
    const HALF: usize = LANES / 2;
    let (axis, sign) = face.axes();
    let step = 2.0 / resolution as f64;
    let u0 = 0.5 * step - 1.0;
    let v0 = if face.is_top() { u0 } else { 0.5 * step };
    // SAFETY: the caller's promise of the instruction set; loads and stores are of half an array.
    unsafe {
        let (step, u0, v0) = (_mm512_set1_pd(step), _mm512_set1_pd(u0), _mm512_set1_pd(v0));
        let zero = _mm512_setzero_pd();
        for k in 0..3 {
            let (mut left, mut right) = (0u16, 0u16);
            for half in [0, HALF] {
                let edge = |c: usize| {
                    let e = _mm512_load_pd(t.edges[3 * k + axis[c]].as_ptr().add(half));
                    _mm512_mul_pd(_mm512_set1_pd(sign[c]), e)
                };
                let (eu, ev, ew) = (edge(0), edge(1), edge(2));
                let a = _mm512_mul_pd(eu, step);
                let b = _mm512_mul_pd(ev, step);
                let c = _mm512_add_pd(_mm512_add_pd(ew, _mm512_mul_pd(eu, u0)), _mm512_mul_pd(ev, v0));
                let inverse = _mm512_div_pd(_mm512_set1_pd(-1.0), a);
                _mm512_store_pd(out.slope[k].as_mut_ptr().add(half), _mm512_mul_pd(b, inverse));
                _mm512_store_pd(out.offset[k].as_mut_ptr().add(half), _mm512_mul_pd(c, inverse));
                left |= u16::from(_mm512_cmp_pd_mask::<_CMP_GT_OQ>(a, zero)) << half;
                right |= u16::from(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, zero)) << half;
            }
            (out.left[k], out.right[k]) = (left, right);
        }
    }
    out.ready = u16::MAX;
}

/// [`draw_lane`] with a row in each lane of the registers.
///
/// # Safety
/// The machine has AVX-512 F, BW, DQ and VL.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline(never)]
#[allow(
    clippy::too_many_arguments,
    reason = "private, called once: numbers that stay in registers"
)]
pub(super) unsafe fn draw_lane_avx512<const COVERED: bool>(
    t: &Transformed,
    ready: &BlockLines,
    face: Face,
    lane: usize,
    left: i32,
    right: i32,
    low: i32,
    high: i32,
    coverage: &mut Coverage,
    running: &[u32],
) -> DrawnLane {
    use std::arch::x86_64::*;
    let resolution = coverage.resolution;
    let mut drawn = DrawnLane::default();
    // SAFETY: the caller's promise of the instruction set. Columns lie within the coverage, and so do eight rows from
    // any row of its last column on, as it has a group to spare; and gathered places within `running`, as spans are
    // clamped to their pixel box and that to its face.
    unsafe {
        // An edge's slope and offset in all lanes.
        let slope: [__m512d; 3];
        let offset: [__m512d; 3];
        let from_left: [u8; 3];
        let from_right: [u8; 3];
        if ready.ready >> lane & 1 != 0 {
            slope = three(|k| _mm512_set1_pd(ready.slope[k][lane]));
            offset = three(|k| _mm512_set1_pd(ready.offset[k][lane]));
            let all = |mask: u16| u8::from(mask >> lane & 1 != 0).wrapping_neg();
            (from_left, from_right) = (three(|k| all(ready.left[k])), three(|k| all(ready.right[k])));
        } else {
            let [a, b, c] = edge_values(t, face, lane, resolution);
            let zero = _mm256_setzero_pd();
            let left = _mm256_cmp_pd_mask::<_CMP_GT_OQ>(a, zero);
            let right = _mm256_cmp_pd_mask::<_CMP_LT_OQ>(a, zero);
            let inverse = _mm256_div_pd(_mm256_set1_pd(-1.0), a);
            let (mut slopes, mut offsets) = ([0.0; 4], [0.0; 4]);
            _mm256_storeu_pd(slopes.as_mut_ptr(), _mm256_mul_pd(b, inverse));
            _mm256_storeu_pd(offsets.as_mut_ptr(), _mm256_mul_pd(c, inverse));
            slope = three(|k| _mm512_set1_pd(slopes[k]));
            offset = three(|k| _mm512_set1_pd(offsets[k]));
            let all = |mask: u8, k: usize| (mask >> k & 1).wrapping_neg();
            (from_left, from_right) = (three(|k| all(left, k)), three(|k| all(right, k)));
        }
        let is_flat = three(|k| from_left[k] | from_right[k]) != [u8::MAX; 3];
        let flat_lines = if is_flat {
            Some(edge_lines(t, face, lane, resolution).0)
        } else {
            None
        };

        #[allow(clippy::cast_possible_truncation, reason = "at most 1024")]
        let first_row = face.first_row(resolution as u32) as usize;
        let (x0, x1, y0, y1) = (at(left), at(right) - 1, at(low), at(high));
        let (first, last) = (x0 / WIDTH, x1 / WIDTH);
        let iota = _mm512_setr_pd(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0);
        let ones = _mm512_set1_epi64(-1);
        let (first_x, end_x) = (_mm512_set1_pd(f64::from(left)), _mm512_set1_pd(f64::from(right)));
        let mut pixel_sum = _mm256_setzero_si256();
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_possible_wrap,
            reason = "at most 1024"
        )]
        let (width, row_steps) = (
            resolution as i32,
            _mm256_mullo_epi32(
                _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7),
                _mm256_set1_epi32(resolution as i32),
            ),
        );
        // What shows of each column; written before it is read.
        let mut visible = [const { std::mem::MaybeUninit::<Rows>::uninit() }; MOST_COLUMNS];
        let height = if face.is_top() { resolution } else { resolution / 2 };
        let mut y = y0.min(height - GROUP);
        while y < y1 {
            let mut rows = u8::MAX;
            if let Some(lines) = &flat_lines {
                rows = flat_rows(lines, y as f64, rows);
            }
            if y < y0 {
                rows &= u8::MAX << (y0 - y);
            }
            if y + GROUP > y1 {
                rows &= u8::MAX >> (y + GROUP - y1);
            }
            let ys = _mm512_add_pd(_mm512_set1_pd(y as f64), iota);
            let (mut least, mut most) = (first_x, end_x);
            for k in 0..3 {
                let x = _mm512_add_pd(_mm512_mul_pd(slope[k], ys), offset[k]);
                least = _mm512_mask_max_pd(least, from_left[k], x, least);
                most = _mm512_mask_min_pd(most, from_right[k], x, most);
            }
            least = _mm512_min_pd(least, end_x);
            most = _mm512_max_pd(most, first_x);
            const UP: i32 = _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC;
            let start = _mm512_cvtpd_epi32(_mm512_roundscale_pd::<UP>(least));
            let end = _mm512_cvtpd_epi32(_mm512_roundscale_pd::<UP>(most));
            rows &= _mm256_cmplt_epi32_mask(start, end);
            if rows == 0 {
                y += GROUP;
                continue;
            }
            let (mut seen, mut unseen) = (0u8, 0u8);
            let (start64, end64) = (_mm512_cvtepi32_epi64(start), _mm512_cvtepi32_epi64(end));
            for column in first..=last {
                let offset = _mm512_set1_epi64((column * WIDTH) as i64);
                let zero = _mm512_setzero_si512();
                // Shifts by 64 and more give 0.
                let from = _mm512_max_epi64(_mm512_sub_epi64(start64, offset), zero);
                let to = _mm512_max_epi64(_mm512_sub_epi64(end64, offset), zero);
                let mask = _mm512_maskz_andnot_epi64(rows, _mm512_sllv_epi64(ones, to), _mm512_sllv_epi64(ones, from));
                let words = coverage
                    .rows
                    .as_mut_ptr()
                    .cast::<i64>()
                    .add(column * coverage.groups * GROUP + first_row + y);
                let covered = _mm512_loadu_epi64(words);
                let shows = _mm512_andnot_si512(covered, mask);
                _mm512_storeu_epi64(words, _mm512_or_si512(covered, mask));
                _mm512_store_epi64(visible.get_unchecked_mut(column - first).as_mut_ptr().cast(), shows);
                seen |= _mm512_test_epi64_mask(shows, shows);
                unseen |= _mm512_cmpneq_epi64_mask(shows, mask);
            }
            if seen != 0 && coverage.record.is_some() {
                for column in first..=last {
                    let shows = visible.get_unchecked(column - first).assume_init_ref();
                    coverage.note(column, first_row + y, shows);
                }
            }
            drawn.seen |= seen != 0;
            let whole_rows = rows & !unseen;
            let weighed = if COVERED { rows } else { whole_rows };
            if weighed != 0 {
                #[allow(
                    clippy::cast_possible_truncation,
                    clippy::cast_possible_wrap,
                    reason = "at most 2^20 pixels"
                )]
                let base = _mm256_add_epi32(row_steps, _mm256_set1_epi32(y as i32 * width));
                // Rows that are not weighed begin and end at 0.
                let mut before = [0u32; GROUP];
                let mut after = [0u32; GROUP];
                let place = |x: __m256i| _mm256_maskz_add_epi32(weighed, base, x);
                _mm256_storeu_si256(before.as_mut_ptr().cast(), place(start));
                _mm256_storeu_si256(after.as_mut_ptr().cast(), place(end));
                weigh::<COVERED>(running, &before, &after, whole_rows, weighed, &mut drawn);
                if COVERED {
                    pixel_sum = _mm256_mask_add_epi32(pixel_sum, rows, pixel_sum, _mm256_sub_epi32(end, start));
                }
            }
            let mut part = rows & seen & unseen;
            while part != 0 {
                let r = part.trailing_zeros() as usize;
                part &= part - 1;
                drawn.visible += weight_of_row(&running[(y + r) * resolution..], first, &visible[..=last - first], r);
            }
            y += GROUP;
        }
        if COVERED {
            drawn.pixels = sum_of(pixel_sum);
        }
    }
    drawn
}

/// [`draw_lane`] with four rows in each register.
///
/// # Safety
/// The machine has AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline(never)]
#[allow(
    clippy::too_many_arguments,
    reason = "private, called once: numbers that stay in registers"
)]
pub(super) unsafe fn draw_lane_avx2<const COVERED: bool>(
    t: &Transformed,
    face: Face,
    lane: usize,
    left: i32,
    right: i32,
    low: i32,
    high: i32,
    coverage: &mut Coverage,
    running: &[u32],
) -> DrawnLane {
    use std::arch::x86_64::*;
    let resolution = coverage.resolution;
    let mut drawn = DrawnLane::default();
    // SAFETY: the caller's promise of the instruction set. Groups and columns lie within the coverage, and places read
    // within `running`, as spans are clamped to their pixel box and that to its face.
    unsafe {
        let [a, b, c] = edge_values(t, face, lane, resolution);
        let zero = _mm256_setzero_pd();
        let from_left = _mm256_cmp_pd::<_CMP_GT_OQ>(a, zero);
        let from_right = _mm256_cmp_pd::<_CMP_LT_OQ>(a, zero);
        let inverse = _mm256_div_pd(_mm256_set1_pd(-1.0), a);
        let (slope, offset) = (_mm256_mul_pd(b, inverse), _mm256_mul_pd(c, inverse));
        let is_flat = _mm256_movemask_pd(_mm256_or_pd(from_left, from_right)) & 0b111 != 0b111;
        let flat_lines = if is_flat {
            Some(edge_lines(t, face, lane, resolution).0)
        } else {
            None
        };
        // Edge k in all lanes.
        macro_rules! each {
            ($of:expr) => {
                [
                    _mm256_permute4x64_pd::<0b00_00_00_00>($of),
                    _mm256_permute4x64_pd::<0b01_01_01_01>($of),
                    _mm256_permute4x64_pd::<0b10_10_10_10>($of),
                ]
            };
        }
        let (slope, offset, from_left, from_right) = (each!(slope), each!(offset), each!(from_left), each!(from_right));

        #[allow(clippy::cast_possible_truncation, reason = "at most 1024")]
        let first_row = face.first_row(resolution as u32) as usize;
        let (x0, x1, y0, y1) = (at(left), at(right) - 1, at(low), at(high));
        let (first, last) = (x0 / WIDTH, x1 / WIDTH);
        let ones = _mm256_set1_epi64x(-1);
        let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
        let (first_x, end_x) = (_mm256_set1_pd(f64::from(left)), _mm256_set1_pd(f64::from(right)));
        let mut pixel_sum = _mm256_setzero_si256();
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_possible_wrap,
            reason = "at most 1024"
        )]
        let row_steps = _mm256_mullo_epi32(
            _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7),
            _mm256_set1_epi32(resolution as i32),
        );
        // What shows of each column; written before it is read.
        let mut visible = [const { std::mem::MaybeUninit::<Rows>::uninit() }; MOST_COLUMNS];
        let mut y = y0 / GROUP * GROUP;
        while y < y1 {
            let spans = |ys: __m256d| {
                let (mut least, mut most) = (first_x, end_x);
                for k in 0..3 {
                    let x = _mm256_add_pd(_mm256_mul_pd(slope[k], ys), offset[k]);
                    // The second operand wins over NaN, as in the portable comparison.
                    least = _mm256_blendv_pd(least, _mm256_max_pd(x, least), from_left[k]);
                    most = _mm256_blendv_pd(most, _mm256_min_pd(x, most), from_right[k]);
                }
                let (least, most) = (_mm256_min_pd(least, end_x), _mm256_max_pd(most, first_x));
                (
                    _mm256_cvtpd_epi32(_mm256_ceil_pd(least)),
                    _mm256_cvtpd_epi32(_mm256_ceil_pd(most)),
                )
            };
            let first_y = _mm256_set1_pd(y as f64);
            let (start_low, end_low) = spans(_mm256_add_pd(first_y, _mm256_setr_pd(0.0, 1.0, 2.0, 3.0)));
            let (start_high, end_high) = spans(_mm256_add_pd(first_y, _mm256_setr_pd(4.0, 5.0, 6.0, 7.0)));
            let (start, end) = (
                _mm256_set_m128i(start_high, start_low),
                _mm256_set_m128i(end_high, end_low),
            );
            let mut within = _mm256_cmpgt_epi32(end, start);
            let mut wanted = u8::MAX;
            if let Some(lines) = &flat_lines {
                wanted = flat_rows(lines, y as f64, wanted);
            }
            if y < y0 {
                wanted &= u8::MAX << (y0 - y);
            }
            if y + GROUP > y1 {
                wanted &= u8::MAX >> (y + GROUP - y1);
            }
            let wanted = _mm256_and_si256(_mm256_set1_epi32(i32::from(wanted)), bits);
            within = _mm256_and_si256(within, _mm256_cmpeq_epi32(wanted, bits));
            let rows = low_byte(_mm256_movemask_ps(_mm256_castsi256_ps(within)));
            if rows == 0 {
                y += GROUP;
                continue;
            }
            let (mut seen, mut unseen) = (0u8, 0u8);
            let group = (first_row + y) / GROUP;
            for column in first..=last {
                #[allow(
                    clippy::cast_possible_truncation,
                    clippy::cast_possible_wrap,
                    reason = "at most 1024 pixels"
                )]
                let offset = _mm256_set1_epi32((column * WIDTH) as i32);
                let nothing = _mm256_setzero_si256();
                // Shifts by 64 and more give 0.
                let from = _mm256_max_epi32(_mm256_sub_epi32(start, offset), nothing);
                let to = _mm256_max_epi32(_mm256_sub_epi32(end, offset), nothing);
                let words: *mut __m256i = coverage
                    .rows
                    .get_unchecked_mut(column * coverage.groups + group)
                    .0
                    .as_mut_ptr()
                    .cast();
                let shown: *mut __m256i = visible.get_unchecked_mut(column - first).as_mut_ptr().cast();
                let mut half = |k: usize, from: __m128i, to: __m128i, within: __m128i| {
                    let (from, to) = (_mm256_cvtepi32_epi64(from), _mm256_cvtepi32_epi64(to));
                    let mask = _mm256_andnot_si256(_mm256_sllv_epi64(ones, to), _mm256_sllv_epi64(ones, from));
                    let mask = _mm256_and_si256(mask, _mm256_cvtepi32_epi64(within));
                    let covered = _mm256_load_si256(words.add(k));
                    let shows = _mm256_andnot_si256(covered, mask);
                    _mm256_store_si256(words.add(k), _mm256_or_si256(covered, mask));
                    _mm256_store_si256(shown.add(k), shows);
                    let four = |equal: __m256i| _mm256_movemask_pd(_mm256_castsi256_pd(equal)) ^ 0b1111;
                    seen |= low_byte(four(_mm256_cmpeq_epi64(shows, nothing)) << (4 * k));
                    unseen |= low_byte(four(_mm256_cmpeq_epi64(shows, mask)) << (4 * k));
                };
                half(
                    0,
                    _mm256_castsi256_si128(from),
                    _mm256_castsi256_si128(to),
                    _mm256_castsi256_si128(within),
                );
                half(
                    1,
                    _mm256_extracti128_si256::<1>(from),
                    _mm256_extracti128_si256::<1>(to),
                    _mm256_extracti128_si256::<1>(within),
                );
            }
            if seen != 0 && coverage.record.is_some() {
                for column in first..=last {
                    let shows = visible.get_unchecked(column - first).assume_init_ref();
                    coverage.note(column, first_row + y, shows);
                }
            }
            drawn.seen |= seen != 0;
            let whole_rows = rows & !unseen;
            let weighed = if COVERED { rows } else { whole_rows };
            if weighed != 0 {
                #[allow(
                    clippy::cast_possible_truncation,
                    clippy::cast_possible_wrap,
                    reason = "at most 2^20 pixels"
                )]
                let base = _mm256_add_epi32(row_steps, _mm256_set1_epi32((y * resolution) as i32));
                let mut before = [0u32; GROUP];
                let mut after = [0u32; GROUP];
                // Rows that are not weighed begin and end at 0.
                let these = if COVERED {
                    within
                } else {
                    _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(i32::from(weighed)), bits), bits)
                };
                let place = |x: __m256i| _mm256_and_si256(_mm256_add_epi32(base, x), these);
                _mm256_storeu_si256(before.as_mut_ptr().cast(), place(start));
                _mm256_storeu_si256(after.as_mut_ptr().cast(), place(end));
                weigh::<COVERED>(running, &before, &after, whole_rows, weighed, &mut drawn);
                if COVERED {
                    let pixels = _mm256_and_si256(_mm256_sub_epi32(end, start), within);
                    pixel_sum = _mm256_add_epi32(pixel_sum, pixels);
                }
            }
            let mut part = rows & seen & unseen;
            while part != 0 {
                let r = part.trailing_zeros() as usize;
                part &= part - 1;
                drawn.visible += weight_of_row(&running[(y + r) * resolution..], first, &visible[..=last - first], r);
            }
            y += GROUP;
        }
        if COVERED {
            drawn.pixels = sum_of(pixel_sum);
        }
    }
    drawn
}

/// The lowest eight bits.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn low_byte(bits: i32) -> u8 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "eight bits")]
    {
        bits as u8
    }
}

/// The sum of eight lanes.
///
/// # Safety
/// The machine has AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
#[inline]
pub(super) unsafe fn sum_of(v: std::arch::x86_64::__m256i) -> u32 {
    use std::arch::x86_64::*;
    let v = _mm_add_epi32(_mm256_castsi256_si128(v), _mm256_extracti128_si256::<1>(v));
    let v = _mm_add_epi32(v, _mm_shuffle_epi32::<0b00_00_11_10>(v));
    let v = _mm_add_epi32(v, _mm_shuffle_epi32::<0b00_00_00_01>(v));
    _mm_cvtsi128_si32(v).cast_unsigned()
}

/// Lanes whose centroid lies above the horizon at a pixel of one of the faces that nothing covers.
#[inline(always)]
pub(crate) fn open_centroids(t: &Transformed, mut lanes: u16, faces: u8, coverage: &Coverage, remembered: bool) -> u16 {
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
        // SAFETY: both are clamped to the atlas, by comparisons that NaN does not pass.
        unsafe {
            rows[l] = row.to_int_unchecked();
            columns[l] = column.to_int_unchecked();
        }
        above[l] = u32::from(z > 0.0) & u32::from(u32::from(faces) & bit != 0);
    }
    let mut open = 0;
    while lanes != 0 {
        let l = lanes.trailing_zeros() as usize;
        lanes &= lanes - 1;
        if above[l] != 0 && !coverage.is_covered(rows[l] as usize, columns[l] as usize, remembered) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Isa;
    use crate::kernel::{Kernel, Portable};
    use crate::order::Draw;

    /// From 0 to 1.
    fn share(draw: &mut Draw) -> f64 {
        draw.below(1 << 24) as f64 / f64::from(1 << 24)
    }

    /// Triangles of many sizes, near and far, some of which reach below the horizon.
    fn block(draw: &mut Draw) -> Block {
        let mut block = Block::empty();
        for lane in 0..LANES {
            let size = 2.0 * share(draw).powi(6);
            let at = [share(draw) * 4.0 - 2.0, share(draw) * 4.0 - 2.0, share(draw) * 2.0];
            for k in 0..3 {
                for (c, &at) in at.iter().enumerate() {
                    block.corners[3 * k + c][lane] = at + size * (share(draw) - 0.5);
                }
            }
            #[allow(clippy::cast_possible_truncation, reason = "at most 16")]
            let id = lane as u32;
            (block.negative[lane], block.positive[lane]) = (id, id);
        }
        block
    }

    #[test]
    fn whatever_centroid_is_open_its_triangle_may_touch_the_open() {
        let mut draw = Draw(3);
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let frame = Frame::new([0.0; 3], axes, 1e-9, u32::MAX);
        let (mut open, mut none) = (0, 0);
        for resolution in [16, 48, 128, 256] {
            for _ in 0..100 {
                let mut coverage = Coverage::new(resolution, true).recording(true);
                for _ in 0..draw.below(40) {
                    let (y0, x0) = (draw.below(3 * coverage.resolution), draw.below(coverage.resolution));
                    let y1 = (y0 + draw.below(coverage.resolution)).min(3 * coverage.resolution - 1);
                    let x1 = (x0 + draw.below(coverage.resolution)).min(coverage.resolution - 1);
                    coverage.cover([x0, x1, y0, y1]);
                }
                coverage.begin_plane();
                coverage.remember_all();
                let mut t = Transformed::new();
                // SAFETY: any machine has the portable path.
                unsafe {
                    Portable::transform(&block(&mut draw), &frame, &mut t);
                    let faces = 0b1_1111;
                    let centroids = Portable::open_centroids(&t, t.live, faces, &coverage, true);
                    let touching = Portable::may_touch_open(&t, t.live, faces, &coverage);
                    assert_eq!(centroids & !touching, 0, "N = {resolution}");
                    open += centroids.count_ones();
                    none += (t.live & !touching).count_ones();
                }
            }
        }
        assert!(open > 500 && none > 200, "{open} open, {none} that touch nothing open");
    }

    #[test]
    fn what_is_recorded_of_a_lane_is_what_it_covers_and_nothing_did_before() {
        for isa in Isa::available() {
            match isa {
                #[cfg(target_arch = "x86_64")]
                Isa::Avx512 => assert_recorded::<crate::kernel::x86::Avx512>(),
                #[cfg(target_arch = "x86_64")]
                Isa::Avx2 => assert_recorded::<crate::kernel::x86::Avx2>(),
                _ => assert_recorded::<Portable>(),
            }
        }
    }

    /// Only for a kernel whose instruction set this machine has.
    fn assert_recorded<K: Kernel>() {
        let mut draw = Draw(5);
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let frame = Frame::new([0.0; 3], axes, 1e-9, u32::MAX);
        let resolution = 144;
        let table = hemicube_contract::delta::DeltaTable::new(resolution);
        let (top, side) = (table.running(Face::Top), table.running(Face::PosX));
        let mut recorded = 0;
        for _ in 0..40 {
            let mut t = Transformed::new();
            let mut coverage = Coverage::new(resolution, true).recording(true);
            coverage.begin_plane();
            coverage.remember_all();
            let mut shown = Shown::new();
            // SAFETY: the caller's promise.
            unsafe {
                K::transform(&block(&mut draw), &frame, &mut t);
                K::draw_bits::<true>(
                    &mut t,
                    None,
                    0b1_1111,
                    Turns::Together,
                    &mut coverage,
                    top,
                    side,
                    &mut shown,
                );
            }
            let record = coverage.record.as_ref().expect("it records");
            let mut open = Coverage::full(resolution).weighing(&table);
            let weight = |coverage: &Coverage| coverage.open_weight(top, side);
            for lane in 0..LANES {
                let of_lane = || record.lanes.iter().filter(|(l, _)| *l == lane).map(|(_, of)| of);
                of_lane().for_each(|of| record.uncover(of, &mut open));
                assert_eq!(weight(&open), shown.visible[lane], "lane {lane}");
                of_lane().for_each(|of| record.cover(of, &mut open));
                assert_eq!(weight(&open), 0);
                // All was open before.
                of_lane().for_each(|of| record.uncover_open(of, &mut open));
                assert!(weight(&open) >= shown.visible[lane], "lane {lane}");
                of_lane().for_each(|of| record.cover_open(of, &mut open));
                assert_eq!(weight(&open), 0);
                recorded += of_lane().count();
            }
        }
        assert!(recorded > 100, "{recorded}");
    }

    #[test]
    fn what_is_open_weighs_what_its_pixels_do() {
        let mut draw = Draw(6);
        let mut between = 0;
        for resolution in [16, 48, 64, 144, 256] {
            let table = DeltaTable::new(resolution);
            let (top, side) = (table.running(Face::Top), table.running(Face::PosX));
            let mut coverage = Coverage::new(resolution, true).weighing(&table);
            let size = coverage.resolution;
            assert_eq!(coverage.open_weight(top, side), hemicube_contract::backend::WHOLE);
            for _ in 0..20 {
                let (y0, x0) = (draw.below(3 * size), draw.below(size));
                let (y1, x1) = (
                    (y0 + draw.below(size)).min(3 * size - 1),
                    (x0 + draw.below(size)).min(size - 1),
                );
                coverage.cover([x0, x1, y0, y1]);
                let pixels = (0..3 * size).flat_map(|row| (0..size).map(move |x| (row, x)));
                let open = pixels.filter(|&(row, x)| !coverage.is_covered(row, x, false));
                let weight = open.map(|(row, x)| {
                    let (running, row) = row_of(size, row, top, side);
                    running[row * size + x + 1] - running[row * size + x]
                });
                let weight: u32 = weight.sum();
                assert_eq!(coverage.open_weight(top, side), weight, "N = {resolution}");
                between += u32::from(weight != 0 && weight != hemicube_contract::backend::WHOLE);
            }
        }
        assert!(between > 50, "{between}");
    }

    #[test]
    fn eight_rows_from_the_last_row_on_lie_within_the_coverage() {
        for resolution in (16..=1024).step_by(16) {
            let mut coverage = Coverage::new(resolution, true);
            let last = coverage.resolution.div_ceil(WIDTH) * coverage.groups * GROUP - 1;
            assert_eq!(
                words_mut(&mut coverage.rows)[last..].len(),
                GROUP + 1,
                "N = {resolution}"
            );
            assert_eq!(words(&coverage.before).len(), last + GROUP + 1, "N = {resolution}");
        }
    }
}
