//! One bit a pixel that says if something covers it: drawn strictly front to back, a triangle shows the pixels that it
//! covers and nothing covered before. No depth, no ids.
//!
//! - [`Coverage`]: the bits of the atlas.
//! - [`OrderedCoverage`]: a hemicube drawn front to back, with a snapshot taken before each plane and a record of the
//!   pixels each lane shows.
//! - [`UncoveredWeights`]: weighs the uncovered pixels.
//!
//! [`Canvas`] is either coverage, to draw into.

use super::isa::Lanes;
use super::{AtlasBox, FaceGrid, GROUP};
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::escaped::EscapedPixels;
use hemicube_contract::face::Face;
use std::ops::Range;

/// Pixels of a column of words: one bit each.
pub(super) const WIDTH: usize = u64::BITS as usize;
/// Words of a row at the largest resolution.
pub(super) const MOST_COLUMNS: usize = 1024 / WIDTH;

/// From this resolution on, asking all centroids before a plane is drawn takes less time than snapshots.
const LEAST_WITHOUT_SNAPSHOTS: usize = 512;

/// Eight rows of one column of words: drawn at a time.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Rows(pub(super) [u64; GROUP]);

impl Rows {
    pub(super) const NONE: Self = Self([0; GROUP]);
    const ALL: Self = Self([u64::MAX; GROUP]);
}

/// Coverage bits of the atlas.
#[derive(Clone, Debug)]
pub(crate) struct Coverage {
    pub(crate) resolution: usize,
    /// Groups of eight rows in a column: the whole height of the atlas.
    pub(super) groups: usize,
    /// By column, then by group; one more at the end, as eight rows are drawn from a triangle's first row on and may
    /// reach past the last.
    pub(super) rows: Vec<Rows>,
}

impl Coverage {
    /// All uncovered.
    pub(crate) fn new(resolution: u32) -> Self {
        let resolution = resolution as usize;
        let groups = 3 * resolution / GROUP;
        Self {
            resolution,
            groups,
            rows: vec![Rows::NONE; groups * resolution.div_ceil(WIDTH) + 1],
        }
    }

    /// All covered.
    pub(crate) fn full(resolution: u32) -> Self {
        let mut coverage = Self::new(resolution);
        coverage.rows.fill(Rows::ALL);
        coverage
    }

    pub(crate) fn clear(&mut self) {
        self.rows.fill(Rows::NONE);
    }

    /// Returns true if a pixel of the atlas is covered.
    #[inline(always)]
    pub(crate) fn is_covered(&self, row: usize, x: usize) -> bool {
        self.rows[x / WIDTH * self.groups + row / GROUP].0[row % GROUP] >> (x % WIDTH) & 1 != 0
    }

    /// The word of a pixel of the atlas, and its bit in it.
    pub(crate) fn place_of(&self, row: usize, x: usize) -> (usize, u64) {
        let word = (x / WIDTH * self.groups + row / GROUP) * GROUP + row % GROUP;
        (word, 1 << (x % WIDTH))
    }

    /// The row and column of a bit of a word.
    pub(crate) fn pixel_at(&self, word: usize, bit: u32) -> (usize, usize) {
        let (column, group) = (word / GROUP / self.groups, word / GROUP % self.groups);
        (group * GROUP + word % GROUP, column * WIDTH + bit as usize)
    }

    /// The covered pixels of a word.
    #[inline(always)]
    pub(crate) fn word(&self, word: usize) -> u64 {
        self.rows[word / GROUP].0[word % GROUP]
    }

    /// Uncovers pixels `start..end` of an atlas row.
    pub(crate) fn uncover_span(&mut self, row: usize, start: usize, end: usize) {
        self.each_word(row, start, end, |covered, bits| *covered &= !bits);
    }

    /// Covers pixels `start..end` of an atlas row.
    pub(crate) fn cover_span(&mut self, row: usize, start: usize, end: usize) {
        self.each_word(row, start, end, |covered, bits| *covered |= bits);
    }

    /// Covers a box.
    #[cfg(test)]
    pub(crate) fn cover(&mut self, [x0, x1, y0, y1]: AtlasBox) {
        (y0..=y1).for_each(|y| self.cover_span(y, x0, x1 + 1));
    }

    #[inline(always)]
    fn each_word(&mut self, row: usize, start: usize, end: usize, each: impl Fn(&mut u64, u64)) {
        for column in start / WIDTH..=(end - 1) / WIDTH {
            let left = column * WIDTH;
            let bits = low_bits(end - left) & !low_bits(start.saturating_sub(left));
            each(&mut self.rows[column * self.groups + row / GROUP].0[row % GROUP], bits);
        }
    }

    /// Sets the bits of the uncovered pixels in `out`, a mask of the same resolution.
    pub(crate) fn write_uncovered(&self, out: &mut EscapedPixels) {
        for row in 0..3 * self.resolution {
            #[allow(clippy::cast_possible_truncation, reason = "at most 3072 rows")]
            let words = out.row_mut(row as u32);
            for (column, word) in words.iter_mut().enumerate() {
                let covered = self.rows[column * self.groups + row / GROUP].0[row % GROUP];
                *word = !covered & self.bits_of(column);
            }
        }
    }

    /// All words, by column, then by row.
    pub(super) fn words(&self) -> &[u64] {
        // SAFETY: `Rows` is an array of words and nothing else.
        unsafe { std::slice::from_raw_parts(self.rows.as_ptr().cast(), self.rows.len() * GROUP) }
    }

    /// [`Self::words`], mutable.
    pub(super) fn words_mut(&mut self) -> &mut [u64] {
        // SAFETY: as above.
        unsafe { std::slice::from_raw_parts_mut(self.rows.as_mut_ptr().cast(), self.rows.len() * GROUP) }
    }

    /// Column and group of each entry of `rows`.
    fn places(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (columns, groups) = (self.resolution.div_ceil(WIDTH), self.groups);
        (0..columns).flat_map(move |column| (0..groups).map(move |group| (column, group)))
    }

    /// Bits of a column's words that are pixels.
    fn bits_of(&self, column: usize) -> u64 {
        low_bits((self.resolution - column * WIDTH).min(WIDTH))
    }
}

/// A coverage that triangles are drawn into.
pub(crate) trait Canvas {
    fn coverage(&self) -> &Coverage;

    fn coverage_mut(&mut self) -> &mut Coverage;

    /// True if lanes with a covered box are left out.
    fn culls(&self) -> bool;

    /// The coverage before the plane being drawn, as far as asked.
    fn snapshot(&self) -> &Coverage;

    /// True if lanes are recorded.
    fn is_recording(&self) -> bool;

    /// Records the pixels shown in eight rows of a column, from atlas row `row` on.
    fn record_rows(&mut self, column: usize, row: usize, shows: &Rows);

    /// Number of recorded groups of rows.
    fn recorded(&self) -> usize;

    /// Ends the record of a lane, which began at place `first`; `touched` is the box of its points.
    fn record_lane(&mut self, lane: usize, face: Face, first: usize, touched: AtlasBox);
}

/// Patches drawn into the uncovered pixels of their parent: nothing is recorded, and a snapshot is never asked.
impl Canvas for Coverage {
    #[inline(always)]
    fn coverage(&self) -> &Coverage {
        self
    }

    #[inline(always)]
    fn coverage_mut(&mut self) -> &mut Coverage {
        self
    }

    #[inline(always)]
    fn culls(&self) -> bool {
        true
    }

    #[inline(always)]
    fn snapshot(&self) -> &Coverage {
        self
    }

    #[inline(always)]
    fn is_recording(&self) -> bool {
        false
    }

    #[inline(always)]
    fn record_rows(&mut self, _column: usize, _row: usize, _shows: &Rows) {}

    #[inline(always)]
    fn recorded(&self) -> usize {
        0
    }

    #[inline(always)]
    fn record_lane(&mut self, _lane: usize, _face: Face, _first: usize, _touched: AtlasBox) {}
}

/// The coverage of a hemicube drawn front to back.
#[derive(Debug)]
pub(crate) struct OrderedCoverage {
    pub(crate) now: Coverage,
    /// The coverage before the surfaces of the current plane, as far as asked: surfaces in one plane do not hide each
    /// other's centroids.
    pub(crate) snapshot: Coverage,
    /// True if the snapshot is of the whole atlas.
    snapshot_is_whole: bool,
    /// False for fine hemicubes, whose centroids are all asked before a plane is drawn.
    pub(crate) takes_snapshots: bool,
    /// True if triangles with a covered box are left out.
    pub(crate) culling: bool,
    /// The pixels that lanes show, for parent triangles.
    pub(crate) record: Option<Record>,
    weights: UncoveredWeights,
}

impl OrderedCoverage {
    pub(crate) fn new(table: &DeltaTable, culling: bool) -> Self {
        let now = Coverage::new(table.resolution());
        Self {
            snapshot: now.clone(),
            snapshot_is_whole: false,
            takes_snapshots: now.resolution < LEAST_WITHOUT_SNAPSHOTS,
            culling,
            record: None,
            weights: UncoveredWeights::new(&now, table),
            now,
        }
    }

    /// Records the pixels of each lane; with `has_uncovered`, also the uncovered pixels of its box before its plane,
    /// for the centroids of patches, asked after their parents are drawn.
    pub(crate) fn recording(mut self, has_uncovered: bool) -> Self {
        self.record = Some(Record {
            has_uncovered,
            ..Record::default()
        });
        self.takes_snapshots |= has_uncovered;
        self
    }

    /// Begins the surfaces of a plane. Until the snapshot is complete, nothing may be drawn.
    pub(crate) fn begin_plane(&mut self) {
        self.snapshot_is_whole = false;
    }

    /// Adds the whole atlas to the snapshot.
    pub(crate) fn snapshot_all(&mut self) {
        if self.takes_snapshots && !self.snapshot_is_whole {
            self.snapshot.rows.copy_from_slice(&self.now.rows);
            self.snapshot_is_whole = true;
        }
    }

    /// Adds a box to the snapshot.
    pub(crate) fn snapshot_box(&mut self, [x0, x1, y0, y1]: AtlasBox) {
        if self.snapshot_is_whole || !self.takes_snapshots {
            return;
        }
        let groups = self.now.groups;
        for column in x0 / WIDTH..=x1 / WIDTH {
            let range = column * groups + y0 / GROUP..=column * groups + y1 / GROUP;
            self.snapshot.rows[range.clone()].copy_from_slice(&self.now.rows[range]);
        }
    }

    /// Weight of the uncovered pixels.
    pub(crate) fn uncovered_weight(&self, table: &DeltaTable) -> u32 {
        self.weights.of(&self.now, table)
    }
}

impl Canvas for OrderedCoverage {
    #[inline(always)]
    fn coverage(&self) -> &Coverage {
        &self.now
    }

    #[inline(always)]
    fn coverage_mut(&mut self) -> &mut Coverage {
        &mut self.now
    }

    #[inline(always)]
    fn culls(&self) -> bool {
        self.culling
    }

    #[inline(always)]
    fn snapshot(&self) -> &Coverage {
        &self.snapshot
    }

    #[inline(always)]
    fn is_recording(&self) -> bool {
        self.record.is_some()
    }

    #[inline(always)]
    fn record_rows(&mut self, column: usize, row: usize, shows: &Rows) {
        if let Some(record) = &mut self.record {
            #[allow(clippy::cast_possible_truncation, reason = "fewer than pixels of an atlas")]
            record.places.push((column * self.now.groups * GROUP + row) as u32);
            record.shows.push(*shows);
        }
    }

    #[inline(always)]
    fn recorded(&self) -> usize {
        self.record.as_ref().map_or(0, |record| record.shows.len())
    }

    #[inline(always)]
    fn record_lane(&mut self, lane: usize, face: Face, first: usize, touched: AtlasBox) {
        if let Some(record) = &mut self.record {
            record.end_lane(lane, face, first, &self.snapshot, touched);
        }
    }
}

/// The pixels that lanes of blocks show on a face, and the pixels of their boxes uncovered at the snapshot.
#[derive(Debug, Default)]
pub(crate) struct Record {
    /// First of eight words, as a place in [`Coverage::words`], and their visible pixels.
    places: Vec<u32>,
    shows: Vec<Rows>,
    /// First word in a column, and a range of `uncovered`.
    columns: Vec<(u32, Range<usize>)>,
    uncovered: Vec<u64>,
    /// Lanes that show pixels on a face.
    pub(crate) lanes: Vec<(usize, Recorded)>,
    /// True if uncovered pixels are recorded.
    has_uncovered: bool,
}

/// A lane on a face: ranges of a record's lists.
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
        self.uncovered.clear();
        self.lanes.clear();
    }

    /// Ends the record of a lane from place `first` on with the uncovered pixels of its box.
    fn end_lane(&mut self, lane: usize, face: Face, first: usize, snapshot: &Coverage, [x0, x1, y0, y1]: AtlasBox) {
        let columns = self.columns.len();
        let touched = if self.has_uncovered {
            x0 / WIDTH..x1 / WIDTH + 1
        } else {
            0..0
        };
        let rows_of_column = snapshot.groups * GROUP;
        for column in touched {
            let start = self.uncovered.len();
            let place = column * rows_of_column + y0;
            let words = &snapshot.words()[place..=place + y1 - y0];
            self.uncovered.extend(words.iter().map(|word| !word));
            #[allow(clippy::cast_possible_truncation, reason = "fewer than pixels of an atlas")]
            self.columns.push((place as u32, start..self.uncovered.len()));
        }
        let recorded = Recorded {
            face,
            shows: first..self.shows.len(),
            columns: columns..self.columns.len(),
        };
        self.lanes.push((lane, recorded));
    }

    /// Uncovers in `coverage` the pixels that a lane shows.
    pub(crate) fn uncover_shown(&self, of: &Recorded, coverage: &mut Coverage) {
        let words = coverage.words_mut();
        let (places, shows) = (&self.places[of.shows.clone()], &self.shows[of.shows.clone()]);
        for (&place, Rows(shows)) in places.iter().zip(shows) {
            for (word, bits) in words[place as usize..][..GROUP].iter_mut().zip(shows) {
                *word &= !bits;
            }
        }
    }

    /// Covers them again, where all else is covered.
    pub(crate) fn cover_shown(&self, of: &Recorded, coverage: &mut Coverage) {
        let words = coverage.words_mut();
        for &place in &self.places[of.shows.clone()] {
            words[place as usize..][..GROUP].fill(u64::MAX);
        }
    }

    /// Uncovers in `coverage` the pixels of a lane's box uncovered at the snapshot.
    pub(crate) fn uncover_box(&self, of: &Recorded, coverage: &mut Coverage) {
        let words = coverage.words_mut();
        for (place, range) in &self.columns[of.columns.clone()] {
            let uncovered = &self.uncovered[range.clone()];
            for (word, bits) in words[*place as usize..][..uncovered.len()].iter_mut().zip(uncovered) {
                *word &= !bits;
            }
        }
    }

    /// Covers them again, where all else is covered.
    pub(crate) fn cover_box(&self, of: &Recorded, coverage: &mut Coverage) {
        let words = coverage.words_mut();
        for (place, range) in &self.columns[of.columns.clone()] {
            words[*place as usize..][..range.len()].fill(u64::MAX);
        }
    }
}

/// Weights of all pixels in eight rows of a column, in the order of [`Coverage::rows`].
#[derive(Debug)]
pub(super) struct UncoveredWeights(Vec<u32>);

impl UncoveredWeights {
    pub(super) fn new(coverage: &Coverage, table: &DeltaTable) -> Self {
        let places = coverage.places();
        Self(
            places
                .map(|(column, group)| weight_of_group(coverage, column, group, [0; GROUP], table))
                .collect(),
        )
    }

    /// Weight of the uncovered pixels.
    pub(super) fn of(&self, coverage: &Coverage, table: &DeltaTable) -> u32 {
        assert_eq!(self.0.len() + 1, coverage.rows.len(), "weights of another resolution");
        let mut weight = 0;
        for (((column, group), rows), &all) in coverage.places().zip(&coverage.rows).zip(&self.0) {
            let whole = coverage.bits_of(column);
            let rows = &rows.0;
            if rows.iter().fold(whole, |all, bits| all & bits) == whole {
                continue;
            }
            // Most are wholly uncovered: the sky has more pixels than the roofs before it.
            if rows.iter().fold(0, |any, bits| any | bits) & whole == 0 {
                weight += all;
            } else {
                weight += weight_of_group(coverage, column, group, *rows, table);
            }
        }
        weight
    }
}

/// Weight of the pixels not in `covered`, in the eight rows of a group of a column.
fn weight_of_group(coverage: &Coverage, column: usize, group: usize, covered: [u64; GROUP], table: &DeltaTable) -> u32 {
    let (whole, resolution) = (coverage.bits_of(column), coverage.resolution);
    let mut weight = 0;
    for (r, covered) in covered.into_iter().enumerate() {
        let uncovered = !covered & whole;
        if uncovered != 0 {
            let (running, row) = row_of(resolution, group * GROUP + r, table);
            weight += weight_of(uncovered, &running[row * resolution + column * WIDTH..]);
        }
    }
    weight
}

/// The running sum of an atlas row's face, and the row's place in it: the four sides share a table.
#[inline(always)]
fn row_of(resolution: usize, row: usize, table: &DeltaTable) -> (&[u32], usize) {
    if row < resolution {
        (table.running(Face::Top), row)
    } else {
        (table.running(Face::PosX), (row - resolution) % (resolution / 2))
    }
}

/// A word with the lowest `count` bits set, for counts up to 64.
#[inline(always)]
pub(super) fn low_bits(count: usize) -> u64 {
    if count >= WIDTH { u64::MAX } else { (1 << count) - 1 }
}

/// Weight of the set bits; `running` begins at the lowest bit.
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

/// Mask of the words that lack a bit of `mask`.
#[inline(always)]
pub(super) fn lacking(rows: &[u64; GROUP], mask: u64) -> u8 {
    let mut lacking = 0;
    for (r, &bits) in rows.iter().enumerate() {
        lacking |= u8::from(!bits & mask != 0) << r;
    }
    lacking
}

/// Covers the part of eight spans in one column: [`Lanes::mark`]. Writes the pixels covered before to `over` if asked.
#[inline(always)]
pub(super) fn mark(
    spans: &super::spans::Spans,
    column: usize,
    covered: &mut Rows,
    shows: &mut Rows,
    mut over: Option<&mut Rows>,
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
            (spans.starts[r] - offset).clamp(0, 64) as u64,
            (spans.ends[r] - offset).clamp(0, 64) as u64,
        );
        let above = |count: u64| if count >= 64 { 0 } else { u64::MAX << count };
        let mask = if spans.rows >> r & 1 != 0 {
            above(from) & !above(to)
        } else {
            0
        };
        let visible = mask & !covered.0[r];
        if let Some(over) = &mut over {
            over.0[r] = mask & covered.0[r];
        }
        covered.0[r] |= mask;
        shows.0[r] = visible;
        seen |= u8::from(visible != 0) << r;
        unseen |= u8::from(visible != mask) << r;
    }
    (seen, unseen)
}

/// Returns true if every pixel of a box is covered.
#[inline(always)]
pub(super) fn all_covered<L: Lanes>(isa: L, coverage: &Coverage, pixels: AtlasBox) -> bool {
    none_of(coverage, pixels, |rows, mask| isa.lacking(rows, mask))
}

/// Returns true if no pixel of a box is covered.
#[inline(always)]
pub(super) fn all_uncovered<L: Lanes>(isa: L, coverage: &Coverage, pixels: AtlasBox) -> bool {
    none_of(coverage, pixels, |rows, mask| isa.any_of(rows, mask))
}

/// Returns true if no row of a box is in the mask that `find` makes of eight words of a column and the box's bits
/// there.
#[inline(always)]
fn none_of(coverage: &Coverage, [x0, x1, y0, y1]: AtlasBox, find: impl Fn(&[u64; GROUP], u64) -> u8) -> bool {
    for column in x0 / WIDTH..=x1 / WIDTH {
        let from = x0.saturating_sub(column * WIDTH);
        let to = (x1 + 1 - column * WIDTH).min(WIDTH);
        let mask = low_bits(to) & !low_bits(from);
        let column = &coverage.rows[column * coverage.groups..][..coverage.groups];
        let (low, high) = (y0 / GROUP, y1 / GROUP);
        for (group, rows) in (low..).zip(&column[low..=high]) {
            let mut found = find(&rows.0, mask);
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

/// The atlas box of a pixel box on a face, given by inclusive places on the face.
#[inline(always)]
pub(super) fn in_atlas(grid: FaceGrid, x0: usize, x1: usize, y0: usize, y1: usize) -> AtlasBox {
    let first_row = grid.first_row();
    [x0, x1, first_row + y0, first_row + y1]
}
