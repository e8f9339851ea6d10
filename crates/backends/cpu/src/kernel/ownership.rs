//! Engine `claims`: one coverage bit a pixel, like engine `order`, and an owner for each pixel; depths only where two
//! surfaces contend for a pixel.
//!
//! Triangles arrive nearly front to back. The pixels that a triangle covers first are its holding, a mask of bits in
//! each tile of 64 × 8 pixels that it touches; eight holdings a page are asked at once for the bytes of rows they have.
//! Of the pixels owned by others it wins those where it is nearer. Most contests end at a bound for each cell of 8 × 8
//! pixels: everything there is nearer. The next test is the difference of the two planes over the shared box, and the
//! pixels left are compared by the depths of engine `depth`, to the bit.

use super::coverage::{
    Coverage, MOST_COLUMNS, Rows, UncoveredWeights, WIDTH, all_covered, in_atlas, low_bits, weight_of,
};
use super::depth::{Chunk, Drawn, Plane, beyond_subpixel, plane};
use super::isa::{Flags, Lanes};
use super::projection::{PixelBox, at, lane_box, project};
use super::spans::{EdgeLines, Spans, edge_lines, spans_within};
use super::sums::{RunIndex, Sums};
use super::{AtlasBox, FaceGrid, GROUP, LanesOnFace, face_of_row, greater, smaller};
use hemicube_contract::bvh::LANES;
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::escaped::EscapedPixels;
use hemicube_contract::face::Face;
use std::mem::MaybeUninit;
use std::ops::Range;

/// A triangle on a face that owns pixels.
#[derive(Clone, Debug)]
struct Owner {
    plane: Plane,
    /// Bound on the rounding of a sum of the plane's terms.
    slack: f64,
    id: u32,
    /// Number and weight of its pixels.
    pixels: u32,
    weight: u32,
    /// Its holdings: a range of the list.
    holdings: Range<u32>,
}

impl Owner {
    fn new(plane: Plane, id: u32, resolution: usize) -> Self {
        let reach = plane.constant.abs() + (plane.x.abs() + plane.y.abs()) * resolution as f64;
        Self {
            plane,
            slack: 32.0 * f64::EPSILON * reach,
            id,
            pixels: 0,
            weight: 0,
            holdings: 0..0,
        }
    }

    /// Greatest and least depth in each cell of a tile from column `x` on, between two rows.
    #[inline(always)]
    fn range(&self, x: usize, rows: [f64; 2]) -> (Cells, Cells) {
        let Plane { low, high, .. } = self.plane;
        let ys = [self.plane.y * rows[0], self.plane.y * rows[1]];
        let last = self.plane.x * (CELL - 1) as f64;
        let most = self.plane.constant + ys[0].max(ys[1]) + last.max(0.0) + self.slack;
        let least = self.plane.constant + ys[0].min(ys[1]) + last.min(0.0) - self.slack;
        let mut out = (Cells([0.0; CELLS]), Cells([0.0; CELLS]));
        for cell in 0..CELLS {
            let at = self.plane.x * (x + cell * CELL) as f64;
            #[allow(clippy::cast_possible_truncation, reason = "rounding is covered by the factor")]
            let (most, least) = (((most + at) * ROUNDED_UP) as f32, ((least + at) * ROUNDED_DOWN) as f32);
            // Not a number may be anything between the bounds.
            out.0.0[cell] = greater(smaller(most, high), low);
            out.1.0[cell] = smaller(greater(least, low), high);
        }
        out
    }

    /// Least depth in a box of a face's pixels.
    #[inline(always)]
    fn least(&self, pixels: &PixelRange) -> f32 {
        let Plane { x, y, low, high, .. } = self.plane;
        let (xs, ys) = ((x * pixels.x0, x * pixels.x1), (y * pixels.y0, y * pixels.y1));
        let least = self.plane.constant + xs.0.min(xs.1) + ys.0.min(ys.1) - self.slack;
        #[allow(clippy::cast_possible_truncation, reason = "rounding is covered by the factor")]
        let least = (least * ROUNDED_DOWN) as f32;
        smaller(greater(least, low), high)
    }

    /// 1/w at sixteen pixels of a face from `first` on, where a chunk begins: the depths that engine `depth` compares.
    #[inline(always)]
    fn depths(&self, row: usize, first: usize) -> Chunk<f32> {
        let Plane {
            x: step,
            y,
            constant,
            low,
            high,
        } = self.plane;
        let base = constant + y * row as f64 + step * first as f64;
        let mut depths = Chunk([0.0; LANES]);
        for (i, depth) in depths.0.iter_mut().enumerate() {
            #[allow(clippy::cast_possible_truncation, reason = "rounding is wanted")]
            let z = (base + step * i as f64) as f32;
            *depth = smaller(greater(z, low), high);
        }
        depths
    }

    /// Pixels of a row's word, from `x` on, that it wins over another owner.
    #[inline(always)]
    fn wins<L: Lanes>(&self, isa: L, over: &Self, row: usize, x: usize, pixels: u64) -> u64 {
        let earlier = self.id < over.id;
        let mut won = 0;
        for first in (0..WIDTH).step_by(LANES) {
            #[allow(clippy::cast_possible_truncation, reason = "sixteen of them")]
            let mask = (pixels >> first) as u16;
            if mask != 0 {
                let (new, old) = (self.depths(row, x + first), over.depths(row, x + first));
                let mut wins = Flags([0; LANES]);
                for i in 0..LANES {
                    wins.0[i] = u32::from(new.0[i] > old.0[i]) | u32::from(new.0[i] == old.0[i]) & u32::from(earlier);
                }
                won |= u64::from(isa.mask(&wins) & mask) << first;
            }
        }
        won
    }
}

/// Factors beyond the rounding of a positive number to f32, up and down; others are clamped.
const ROUNDED_UP: f64 = 1.0 + 1e-6;
const ROUNDED_DOWN: f64 = 1.0 - 1e-6;

/// A box of a face's pixels, by the places of their centres.
#[derive(Clone, Copy, Debug)]
struct PixelRange {
    x0: f64,
    x1: f64,
    y0: f64,
    y1: f64,
}

/// Width and height of a tile's cells, in pixels.
const CELL: usize = GROUP;
const CELLS: usize = WIDTH / CELL;

/// A number for each cell of a tile.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
struct Cells([f32; CELLS]);

impl Cells {
    /// Lowers the numbers of some cells.
    #[inline(always)]
    fn lower(&mut self, to: &Self, cells: u8) {
        for cell in 0..CELLS {
            let lower = if cells >> cell & 1 != 0 {
                to.0[cell]
            } else {
                f32::INFINITY
            };
            self.0[cell] = smaller(lower, self.0[cell]);
        }
    }
}

/// Cells with any of a row's pixels.
#[inline(always)]
pub(super) fn cells_of(bits: u64) -> u8 {
    let any = bits | bits >> 4;
    let any = any | any >> 2;
    let any = (any | any >> 1) & 0x0101_0101_0101_0101;
    #[allow(clippy::cast_possible_truncation, reason = "the upper byte")]
    {
        (any.wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8
    }
}

/// Pixels of a row in some cells.
#[inline(always)]
fn pixels_of(cells: u8) -> u64 {
    // Of a copy in each byte, keep its own bit; then the highest bit of each byte with one.
    let own = (u64::from(cells) * 0x0101_0101_0101_0101) & 0x8040_2010_0804_0201;
    let carried = (own & 0x7F7F_7F7F_7F7F_7F7F) + 0x7F7F_7F7F_7F7F_7F7F;
    let highest = (carried | own) & 0x8080_8080_8080_8080;
    (highest >> 7).wrapping_mul(0xFF)
}

/// A tile: eight rows of a word of pixels.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Tile {
    /// Lower bound on 1/w of the owners in each cell.
    farthest: Cells,
    /// Bytes with pixels of its first holding, see [`Lanes::occupied`]: most tiles of fine hemicubes have no other.
    occupied: u64,
    /// The first holding's place in the list, plus 1.
    first: u32,
    /// The page of its newest holding, plus 1, if there are others.
    page: u32,
}

/// A tile without owners.
const CLEAR: Tile = Tile {
    farthest: Cells([f32::INFINITY; CELLS]),
    occupied: 0,
    first: 0,
    page: 0,
};

/// Some of a tile's holdings.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Page {
    /// For each, the bytes with pixels: see [`Lanes::occupied`].
    occupied: [u64; ON_PAGE],
    /// Places in the list.
    holdings: [u32; ON_PAGE],
    count: u32,
    /// The page with the tile's previous holdings, plus 1.
    before: u32,
}

/// Holdings of a page.
const ON_PAGE: usize = GROUP;

/// An owner's pixels in a tile.
#[derive(Clone, Copy, Debug)]
struct Holding {
    owner: u32,
    tile: u32,
}

/// The buffer that one hemicube is drawn into.
#[derive(Debug)]
pub(crate) struct OwnershipBuffer {
    coverage: Coverage,
    weights: UncoveredWeights,
    tiles: Vec<Tile>,
    owners: Vec<Owner>,
    holdings: Vec<Holding>,
    /// The pixels of each holding.
    shows: Vec<Rows>,
    pages: Vec<Page>,
    /// The id of pixels that hit nothing.
    nothing: u32,
    /// True if hidden triangles are left out.
    culling: bool,
    beyond_subpixel: f32,
    /// Index of `owners` by id.
    index: RunIndex,
}

/// A new owner on a tile.
struct Contest<'a> {
    new: &'a Owner,
    tile: usize,
    /// The tile's first column, and its first row on the face.
    x: usize,
    y: usize,
    running: &'a [u32],
}

/// Search of the owners of some covered pixels of a tile.
struct Search {
    /// The tile's first holding, plus 1, if still to be looked at.
    first: u32,
    /// The page to look at next, plus 1.
    page: u32,
    /// Holdings of that page that may have some of the pixels, still to be looked at.
    hits: u8,
    /// Pixels without a known owner.
    left: Rows,
    /// Bytes with any of them, see [`Lanes::occupied`].
    occupied: u64,
}

/// Some pixels of a tile with one owner.
#[derive(Clone, Copy, Debug)]
struct Owned {
    pixels: Rows,
    /// Rows with any of them.
    rows: u8,
    holding: usize,
    /// Page and slot of the holding; `None` for the tile's first.
    place: Option<(usize, usize)>,
}

impl Search {
    /// Begins a search of the owners of `left` in a tile.
    #[inline(always)]
    fn new<L: Lanes>(isa: L, tile: &Tile, left: Rows) -> Self {
        let occupied = isa.occupied(&left.0);
        Self {
            first: if tile.occupied & occupied != 0 { tile.first } else { 0 },
            page: tile.page,
            hits: 0,
            occupied,
            left,
        }
    }

    /// Finds the next holding with any of the pixels left; `None` when none is left.
    #[inline(always)]
    fn next<L: Lanes>(&mut self, isa: L, buffer: &OwnershipBuffer) -> Option<Owned> {
        while self.occupied != 0 {
            let (holding, place);
            if self.first != 0 {
                (holding, place) = (self.first as usize - 1, None);
                self.first = 0;
            } else {
                let page = self.page as usize - 1;
                if self.hits == 0 {
                    self.hits = isa.any_of(&buffer.pages[page].occupied, self.occupied);
                    if self.hits == 0 {
                        self.page = buffer.pages[page].before;
                        continue;
                    }
                }
                let slot = self.hits.trailing_zeros() as usize;
                self.hits &= self.hits - 1;
                (holding, place) = (buffer.pages[page].holdings[slot] as usize, Some((page, slot)));
                if self.hits == 0 {
                    self.page = buffer.pages[page].before;
                }
            }
            let mut pixels = Rows::NONE;
            let (rows, left) = isa.common(&buffer.shows[holding].0, &mut self.left.0, &mut pixels.0);
            if rows != 0 {
                self.occupied = left;
                return Some(Owned {
                    pixels,
                    rows,
                    holding,
                    place,
                });
            }
        }
        None
    }
}

impl OwnershipBuffer {
    /// Sets the bits of the pixels that hit nothing in `out`, a mask of the same resolution.
    pub(crate) fn write_uncovered(&self, out: &mut EscapedPixels) {
        self.coverage.write_uncovered(out);
    }

    pub(crate) fn new(table: &DeltaTable, nothing: u32, culling: bool, index: RunIndex) -> Self {
        let coverage = Coverage::new(table.resolution());
        let tiles = coverage.rows.len();
        Self {
            weights: UncoveredWeights::new(&coverage, table),
            coverage,
            tiles: vec![CLEAR; tiles],
            owners: Vec::new(),
            holdings: Vec::new(),
            shows: Vec::new(),
            pages: Vec::new(),
            nothing,
            culling,
            beyond_subpixel: beyond_subpixel(table.resolution() as usize),
            index,
        }
    }

    /// Adds a holding in a tile.
    #[inline(always)]
    fn push<L: Lanes>(&mut self, isa: L, owner: u32, tile: usize, shows: &Rows) {
        let state = &mut self.tiles[tile];
        let occupied = isa.occupied(&shows.0);
        #[allow(clippy::cast_possible_truncation, reason = "fewer holdings and tiles than 2³²")]
        let (holding, of_tile) = (self.holdings.len() as u32, tile as u32);
        self.holdings.push(Holding { owner, tile: of_tile });
        self.shows.push(*shows);
        if state.first == 0 {
            (state.first, state.occupied) = (holding + 1, occupied);
            return;
        }
        if state.page == 0 || self.pages[state.page as usize - 1].count as usize == ON_PAGE {
            self.pages.push(Page {
                occupied: [0; ON_PAGE],
                holdings: [0; ON_PAGE],
                count: 0,
                before: state.page,
            });
            #[allow(clippy::cast_possible_truncation, reason = "fewer pages than 2³²")]
            {
                state.page = self.pages.len() as u32;
            }
        }
        let page = &mut self.pages[state.page as usize - 1];
        let slot = page.count as usize % ON_PAGE;
        (page.holdings[slot], page.occupied[slot]) = (holding, occupied);
        page.count += 1;
    }

    fn tile_of(&self, row: usize, x: usize) -> usize {
        x / WIDTH * self.coverage.groups + row / GROUP
    }

    /// Lower bound on 1/w at a pixel of the atlas, for the rest of the hemicube.
    pub(crate) fn at_least(&self, row: usize, x: usize) -> f32 {
        if self.coverage.is_covered(row, x) {
            self.tiles[self.tile_of(row, x)].farthest.0[x % WIDTH / CELL]
        } else {
            0.0
        }
    }

    /// Visible id at a pixel of the atlas, and its 1/w.
    pub(crate) fn seen_at(&self, row: usize, x: usize) -> (u32, f32) {
        if !self.coverage.is_covered(row, x) {
            return (self.nothing, 0.0);
        }
        let resolution = self.coverage.resolution;
        let state = &self.tiles[self.tile_of(row, x)];
        let at = 1 << (row % GROUP * (WIDTH / 8) + x % WIDTH / 8);
        let has = |occupied: u64, holding: u32| {
            occupied & at != 0 && self.shows[holding as usize].0[row % GROUP] >> (x % WIDTH) & 1 != 0
        };
        let mut holding = state.first - 1;
        if !has(state.occupied, holding) {
            let mut page = &self.pages[state.page as usize - 1];
            holding = loop {
                let mut on_page = page.occupied.iter().zip(&page.holdings);
                if let Some((_, &holding)) = on_page.find(|&(&occupied, &holding)| has(occupied, holding)) {
                    break holding;
                }
                page = &self.pages[page.before as usize - 1];
            };
        }
        let owner = &self.owners[self.holdings[holding as usize].owner as usize];
        let face_row = if row < resolution {
            row
        } else {
            (row - resolution) % (resolution / 2)
        };
        (owner.id, owner.depths(face_row, x / LANES * LANES).0[x % LANES])
    }

    /// Calls `each(row, column)` for the pixels of a holding.
    fn each_pixel(&self, holding: usize, mut each: impl FnMut(usize, usize)) {
        let groups = self.coverage.groups;
        let tile = self.holdings[holding].tile as usize;
        let (row, x) = (tile % groups * GROUP, tile / groups * WIDTH);
        for (row, &shows) in (row..).zip(&self.shows[holding].0) {
            let mut left = shows;
            while left != 0 {
                each(row, x + left.trailing_zeros() as usize);
                left &= left - 1;
            }
        }
    }

    /// Appends the visible id of each pixel of the atlas, row by row.
    pub(crate) fn write_items(&self, out: &mut Vec<u32>) {
        let resolution = self.coverage.resolution;
        let start = out.len();
        out.resize(start + 3 * resolution * resolution, self.nothing);
        let items = &mut out[start..];
        for holding in 0..self.holdings.len() {
            let id = self.owners[self.holdings[holding].owner as usize].id;
            self.each_pixel(holding, |row, x| items[row * resolution + x] = id);
        }
    }

    /// Appends the row and column of each pixel of an indexed id.
    pub(crate) fn pixels_of(&self, id: u32, out: &mut Vec<(usize, usize)>) {
        for owner in self.index.of(id) {
            let Range { start, end } = self.owners[owner].holdings;
            for holding in start as usize..end as usize {
                self.each_pixel(holding, |row, x| out.push((row, x)));
            }
        }
    }

    /// Adds up the visible weights of each id.
    pub(crate) fn reduce(&mut self, table: &DeltaTable, sums: &mut Sums) {
        for owner in &self.owners {
            if owner.pixels == 0 {
                self.index.skip();
                continue;
            }
            sums.add(owner.id, owner.pixels, owner.weight);
            if self.index.is_used() {
                self.index.add(owner.id);
            }
        }
        sums.add(self.nothing, 0, self.weights.of(&self.coverage, table));
    }

    /// Calls `each(word of coverage, visible bits)` for each row with pixels of an indexed id. Returns their faces.
    pub(crate) fn each_of(&self, id: u32, coverage: &mut Coverage, each: impl Fn(&mut u64, u64)) -> u8 {
        let mut faces = 0;
        for owner in self.index.of(id) {
            let Range { start, end } = self.owners[owner].holdings;
            for holding in start as usize..end as usize {
                let tile = self.holdings[holding].tile as usize;
                faces |= face_of_row(tile % coverage.groups * GROUP, coverage.resolution);
                let rows = &mut coverage.rows[tile].0;
                for (covered, &shows) in rows.iter_mut().zip(&self.shows[holding].0) {
                    each(covered, shows);
                }
            }
        }
        faces
    }

    /// Forgets the pixels of an id.
    pub(crate) fn forget(&mut self, id: u32) {
        self.index.forget(id);
    }

    /// Clears the buffer for the next hemicube.
    pub(crate) fn clear(&mut self) {
        self.owners.clear();
        self.holdings.clear();
        self.shows.clear();
        self.pages.clear();
        self.coverage.clear();
        self.tiles.fill(CLEAR);
        self.index.clear();
    }

    /// Adds to `won` the pixels of `left`, all covered, that the new owner wins; returns true if it wins any.
    #[inline(always)]
    fn contest<L: Lanes>(&mut self, isa: L, contest: &Contest<'_>, left: Rows, won: &mut Rows) -> bool {
        let Contest { new, x, y, .. } = *contest;
        let mut any = false;
        let resolution = self.coverage.resolution;
        let mut search = Search::new(isa, &self.tiles[contest.tile], left);
        while let Some(mut owned) = search.next(isa, self) {
            let holding = owned.holding;
            let old = &mut self.owners[self.holdings[holding].owner as usize];
            // Many are farther than all of the other: depths are clamped to the plane's range.
            if new.plane.high < old.plane.low {
                continue;
            }
            let difference = Difference::new(new, old, &owned.range(isa, x, y));
            if difference.is_behind() {
                continue;
            }
            if !difference.is_in_front() {
                let mut unclear = owned.rows;
                while unclear != 0 {
                    let r = unclear.trailing_zeros() as usize;
                    unclear &= unclear - 1;
                    owned.pixels.0[r] = difference.won(isa, [new, old], owned.pixels.0[r], y + r, x);
                }
            }
            let shows = &mut self.shows[holding];
            let mut taken = owned.rows;
            while taken != 0 {
                let r = taken.trailing_zeros() as usize;
                taken &= taken - 1;
                let bits = owned.pixels.0[r];
                any |= bits != 0;
                shows.0[r] &= !bits;
                won.0[r] |= bits;
                old.pixels -= bits.count_ones();
                old.weight -= weight_of(bits, &contest.running[(y + r) * resolution + x..]);
            }
            let occupied = isa.occupied(&shows.0);
            match owned.place {
                Some((page, slot)) => self.pages[page].occupied[slot] = occupied,
                None => self.tiles[contest.tile].occupied = occupied,
            }
        }
        any
    }
}

impl Owned {
    /// The box around the pixels, in a tile that begins at this pixel of the face.
    #[inline(always)]
    fn range<L: Lanes>(&self, isa: L, x: usize, y: usize) -> PixelRange {
        let columns = isa.columns(&self.pixels.0);
        PixelRange {
            x0: (x + columns.trailing_zeros() as usize) as f64,
            x1: (x + WIDTH - 1 - columns.leading_zeros() as usize) as f64,
            y0: (y + self.rows.trailing_zeros() as usize) as f64,
            y1: (y + GROUP - 1 - self.rows.leading_zeros() as usize) as f64,
        }
    }
}

/// Difference of two owners' depths, new − old, in 1/w.
#[derive(Clone, Copy, Debug)]
struct Difference {
    x: f64,
    y: f64,
    constant: f64,
    /// Least and greatest value in a box.
    least: f64,
    most: f64,
    /// Bound on all rounding: of both planes, of the clamping to the corners' depths, and to f32.
    margin: f64,
}

impl Difference {
    #[inline(always)]
    fn new(new: &Owner, old: &Owner, span: &PixelRange) -> Self {
        let (p, q) = (&new.plane, &old.plane);
        let (x, y, constant) = (p.x - q.x, p.y - q.y, p.constant - q.constant);
        let (xs, ys) = ((x * span.x0, x * span.x1), (y * span.y0, y * span.y1));
        let greatest = |p: &Plane| p.constant + (p.x * span.x0).max(p.x * span.x1) + (p.y * span.y0).max(p.y * span.y1);
        Self {
            x,
            y,
            constant,
            least: constant + xs.0.min(xs.1) + ys.0.min(ys.1),
            most: constant + xs.0.max(xs.1) + ys.0.max(ys.1),
            margin: 3.0 * (new.slack + old.slack) + 1e-6 * greatest(p).abs().max(greatest(q).abs()),
        }
    }

    /// Returns true if the new owner is farther in the whole box. Not a number is neither this nor in front.
    #[inline(always)]
    fn is_behind(&self) -> bool {
        self.most < -self.margin
    }

    /// Returns true if the new owner is nearer in the whole box.
    #[inline(always)]
    fn is_in_front(&self) -> bool {
        self.least > self.margin
    }

    /// Pixels of a row, from `x` on, that the new owner wins.
    #[inline(always)]
    fn won<L: Lanes>(&self, isa: L, [new, old]: [&Owner; 2], bits: u64, row: usize, x: usize) -> u64 {
        let first = self.constant + self.y * row as f64 + self.x * x as f64;
        let ends = [bits.trailing_zeros(), u64::BITS - 1 - bits.leading_zeros()];
        let ends = ends.map(|bit| first + self.x * f64::from(bit));
        if ends.iter().all(|&end| end < -self.margin) {
            return 0;
        }
        if ends.iter().all(|&end| end > self.margin) {
            return bits;
        }
        // The zero of the difference, from the first pixel on, and the distance from it below which the sign is
        // unclear.
        let inverse = -1.0 / self.x;
        let (root, reach) = (first * inverse, (self.margin * inverse).abs() + 1.0);
        let (from, to) = (root - reach, root + reach);
        let (before, after) = if self.x > 0.0 { (0, u64::MAX) } else { (u64::MAX, 0) };
        // All are unclear where the plane runs along the row, and where a value is not a number.
        let (below, above) = if from.is_finite() && to.is_finite() {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
            let place = |x: f64| low_bits(x.clamp(0.0, 64.0) as usize);
            (place(from), !place(to + 1.0))
        } else {
            (0, 0)
        };
        let won = bits & (below & before | above & after);
        won | new.wins(isa, old, row, x, bits & !below & !above)
    }
}

/// Returns true if every pixel of a box on a face is owned by a triangle nearer than `bound`.
#[inline(always)]
pub(super) fn is_hidden<L: Lanes>(isa: L, buffer: &OwnershipBuffer, face: Face, pixels: AtlasBox, bound: f32) -> bool {
    if !all_covered(isa, &buffer.coverage, pixels) {
        return false;
    }
    let first_row = FaceGrid::new(face, buffer.coverage.resolution).first_row();
    let [x0, x1, y0, y1] = pixels;
    for column in x0 / WIDTH..=x1 / WIDTH {
        for group in y0 / GROUP..=y1 / GROUP {
            let tile = column * buffer.coverage.groups + group;
            let (left, right) = (x0.max(column * WIDTH), x1.min(column * WIDTH + WIDTH - 1));
            let mask = low_bits(right + 1 - column * WIDTH) & !low_bits(left - column * WIDTH);
            let state = &buffer.tiles[tile];
            let cells = isa.up_to(&state.farthest.0, &[bound; CELLS]);
            let mask = mask & pixels_of(cells);
            if mask == 0 {
                continue;
            }
            let (low, high) = (y0.max(group * GROUP), y1.min(group * GROUP + GROUP - 1));
            let rows = u8::MAX << (low % GROUP) & u8::MAX >> (GROUP - 1 - high % GROUP);
            let mut left = Rows::NONE;
            for (r, bits) in left.0.iter_mut().enumerate() {
                *bits = if rows >> r & 1 != 0 { mask } else { 0 };
            }
            let (x, y) = (column * WIDTH, group * GROUP - first_row);
            let mut search = Search::new(isa, state, left);
            while let Some(owned) = search.next(isa, buffer) {
                let owner = &buffer.owners[buffer.holdings[owned.holding].owner as usize];
                // Most are nearer all over.
                if owner.plane.low <= bound && owner.least(&owned.range(isa, x, y)) <= bound {
                    return false;
                }
            }
        }
    }
    true
}

/// Draws lanes of a block on a face; `running` is its running sum of delta form factors. With `COUNT`, adds each lane's
/// covered pixels to `pixels`.
#[inline(always)]
pub(super) fn draw<L: Lanes, const COUNT: bool>(
    isa: L,
    on: LanesOnFace<'_>,
    buffer: &mut OwnershipBuffer,
    running: &[u32],
    pixels: &mut [u32; LANES],
) -> Drawn {
    let (t, face) = (on.triangles, on.face);
    let resolution = buffer.coverage.resolution;
    let grid = FaceGrid::new(face, resolution);
    let boxes = project(isa, t, grid);
    let mut pending = (boxes.in_front | boxes.straddling) & on.lanes;
    let mut drawn = Drawn {
        on: pending,
        ..Drawn::default()
    };
    while pending != 0 {
        let lane = pending.trailing_zeros() as usize;
        pending &= pending - 1;
        let Some(lane_box) = lane_box(t, &boxes, grid, lane) else {
            continue;
        };
        if buffer.culling {
            let in_atlas = |p: PixelBox| in_atlas(grid, at(p.x0), at(p.x1) - 1, at(p.y0), at(p.y1) - 1);
            if is_hidden(isa, buffer, face, in_atlas(lane_box.pixels), lane_box.high) {
                drawn.hidden |= 1 << lane;
                let touched = in_atlas(lane_box.pixels.wider(grid));
                if COUNT && is_hidden(isa, buffer, face, touched, lane_box.high * buffer.beyond_subpixel) {
                    drawn.behind |= 1 << lane;
                }
                continue;
            }
        }
        drawn.drawn |= 1 << lane;
        let (lines, sum) = edge_lines(t, grid, lane);
        let plane = plane(t, grid, lane, sum, buffer.nothing, lane_box);
        let claimant = Claimant {
            lines,
            pixels: lane_box.pixels,
            first_row: grid.first_row(),
            owner: Owner::new(plane, t.seen[lane], resolution),
        };
        let covered = claimant.claim::<L, COUNT>(isa, buffer, running);
        if COUNT {
            pixels[lane] += covered;
        }
    }
    drawn
}

/// A triangle about to be drawn on a face.
struct Claimant {
    lines: EdgeLines,
    pixels: PixelBox,
    /// The face's first row in the atlas.
    first_row: usize,
    owner: Owner,
}

impl Claimant {
    /// Covers the triangle's pixels, and takes those it wins. Returns the number of covered pixels with `COUNT`.
    #[inline(always)]
    fn claim<L: Lanes, const COUNT: bool>(mut self, isa: L, buffer: &mut OwnershipBuffer, running: &[u32]) -> u32 {
        let resolution = buffer.coverage.resolution;
        let pixels = self.pixels;
        let mut spans = Spans::default();
        let (x0, x1, y0, y1) = (at(pixels.x0), at(pixels.x1) - 1, at(pixels.y0), at(pixels.y1));
        let (first, last) = (x0 / WIDTH, x1 / WIDTH);
        let mut covered_pixels = 0;
        let holdings_before = buffer.holdings.len();
        let mut y = y0 / GROUP * GROUP;
        while y < y1 {
            spans_within(isa, &self.lines, y, pixels, &mut spans);
            if spans.rows == 0 {
                y += GROUP;
                continue;
            }
            if COUNT {
                covered_pixels += isa.pixels_of(&spans);
            }
            // Rows with a pixel won, and rows with a pixel lost.
            let (mut held, mut lost) = (0u8, 0u8);
            // Pixels won in each column.
            let mut shows = [const { MaybeUninit::<Rows>::uninit() }; MOST_COLUMNS];
            for column in first..=last {
                let shows = shows[column - first].write(Rows::NONE);
                let (seen, unseen) = self.claim_column(isa, buffer, &spans, [column, y], running, shows);
                held |= seen;
                lost |= unseen;
            }
            let owner = &mut self.owner;
            let mut pending = held;
            while pending != 0 {
                let r = pending.trailing_zeros() as usize;
                pending &= pending - 1;
                let row = &running[(y + r) * resolution..];
                if lost >> r & 1 == 0 {
                    let (start, end) = (at(spans.starts[r]), at(spans.ends[r]));
                    owner.weight += row[end] - row[start];
                    #[allow(clippy::cast_possible_truncation, reason = "at most 1024 pixels")]
                    {
                        owner.pixels += (end - start) as u32;
                    }
                } else {
                    for (column, shows) in (first..=last).zip(&shows) {
                        // SAFETY: written above.
                        let bits = unsafe { shows.assume_init_ref() }.0[r];
                        owner.weight += weight_of(bits, &row[column * WIDTH..]);
                        owner.pixels += bits.count_ones();
                    }
                }
            }
            y += GROUP;
        }
        if buffer.holdings.len() > holdings_before {
            #[allow(clippy::cast_possible_truncation, reason = "fewer holdings than 2³²")]
            {
                self.owner.holdings = holdings_before as u32..buffer.holdings.len() as u32;
            }
            buffer.owners.push(self.owner);
        }
        covered_pixels
    }

    /// Covers the part of eight spans in one column of words, writes the pixels won to `shows`, and adds the holding.
    /// Returns the rows with a pixel won, and with a pixel lost.
    #[inline(always)]
    fn claim_column<L: Lanes>(
        &self,
        isa: L,
        buffer: &mut OwnershipBuffer,
        spans: &Spans,
        [column, y]: [usize; 2],
        running: &[u32],
        shows: &mut Rows,
    ) -> (u8, u8) {
        let pixels = self.pixels;
        let (x0, x1, y0, y1) = (at(pixels.x0), at(pixels.x1) - 1, at(pixels.y0), at(pixels.y1));
        let tile = column * buffer.coverage.groups + (self.first_row + y) / GROUP;
        let covered = &mut buffer.coverage.rows[tile];
        let mut over = Rows::NONE;
        let (mut seen, mut unseen) = isa.mark(spans, column, covered, shows, &mut over);
        if seen | unseen == 0 {
            return (0, 0);
        }
        let within = cells_of(low_bits(x1 + 1 - column * WIDTH) & !low_bits(x0.saturating_sub(column * WIDTH)));
        let rows = [y0.max(y) as f64, (y1 - 1).min(y + GROUP - 1) as f64];
        let (most, least) = self.owner.range(column * WIDTH, rows);
        if unseen != 0 {
            // Nothing is to be won in cells with surely nearer owners.
            let mut left = Rows::NONE;
            let cells = isa.up_to(&buffer.tiles[tile].farthest.0, &most.0) & within;
            let rows = isa.restrict(&over.0, pixels_of(cells), &mut left.0);
            if rows != 0 {
                let contest = Contest {
                    new: &self.owner,
                    tile,
                    x: column * WIDTH,
                    y,
                    running,
                };
                if buffer.contest(isa, &contest, left, shows) {
                    seen = isa.beyond(&shows.0, &[0; GROUP]);
                    unseen = isa.beyond(&over.0, &shows.0);
                }
            }
        }
        if seen != 0 {
            #[allow(clippy::cast_possible_truncation, reason = "fewer owners than fragments")]
            let owner = buffer.owners.len() as u32;
            buffer.push(isa, owner, tile, shows);
            let cells = cells_of(isa.columns(&shows.0));
            buffer.tiles[tile].farthest.lower(&least, cells);
        }
        (seen, unseen)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Isa;
    use crate::kernel::{DepthBuffer, Frame, InstructionSet, Transformed};
    use hemicube_contract::bvh::{Block, UNUSED};
    use proptest::prelude::*;

    /// Coordinates on a coarse grid, where surfaces share planes, edges and corners, and anywhere. A few are absurd: a
    /// model's are normalised.
    fn coordinate() -> impl Strategy<Value = f64> {
        prop_oneof![
            6 => (-4i32..=4).prop_map(|k| f64::from(k) * 0.25),
            4 => -1.0..1.0f64,
            1 => prop::sample::select(vec![1e-12, -1e-9, 1e6, -1e9, 5e-324]),
        ]
    }

    /// Ids: patches, then blocked.
    const PATCHES: u32 = 48;
    const BLOCKED: u32 = PATCHES;

    fn blocks() -> impl Strategy<Value = Vec<Block>> {
        let triangle = (prop::collection::vec(coordinate(), 9), prop::bool::weighted(0.8));
        prop::collection::vec(triangle, 1..=PATCHES as usize).prop_map(|triangles| {
            let mut patch = 0u32;
            let block = |triangles: &[(Vec<f64>, bool)]| {
                let mut block = Block {
                    corners: [[0.0; LANES]; 9],
                    negative: [UNUSED; LANES],
                    positive: [UNUSED; LANES],
                };
                for (lane, (corners, two_sided)) in triangles.iter().enumerate() {
                    for (to, &from) in block.corners.iter_mut().zip(corners) {
                        to[lane] = from;
                    }
                    block.positive[lane] = patch;
                    block.negative[lane] = if *two_sided { patch } else { BLOCKED };
                    patch += 1;
                }
                block
            };
            triangles.chunks(LANES).map(block).collect()
        })
    }

    /// Sums of a buffer: id, pixels, weight; for nothing its weight alone.
    fn drained(mut sums: Sums) -> Vec<(u32, u32, u32)> {
        let mut found = Vec::new();
        sums.drain(|id, pixels, weight| match id {
            id if id > BLOCKED && weight == 0 => {}
            id if id > BLOCKED => found.push((id, 0, weight)),
            _ => found.push((id, pixels, weight)),
        });
        found
    }

    /// Results of a buffer: the sums, the pixels of each lane, and the visible id and depth of each pixel.
    type Seen = (Vec<(u32, u32, u32)>, Vec<[u32; LANES]>, Vec<(u32, u32)>);

    fn by_depth(blocks: &[Block], frame: &Frame, table: &DeltaTable) -> Seen {
        let isa = InstructionSet::of(Isa::Portable).expect("any machine has it");
        let mut target = DepthBuffer::new(table.resolution(), BLOCKED + 1, false, RunIndex::default());
        let mut t = Transformed::new();
        let mut pixels = vec![[0; LANES]; blocks.len()];
        for (block, pixels) in blocks.iter().zip(&mut pixels) {
            isa.transform(block, frame, &mut t);
            for face in Face::ALL {
                let on = LanesOnFace {
                    triangles: &t,
                    face,
                    lanes: t.live,
                };
                isa.draw_depth::<true>(on, &mut target, pixels);
            }
        }
        let seen = target.items.iter().zip(&target.depth);
        let seen = seen.flat_map(|(items, depths)| (0..LANES).map(|l| (items.0[l], depths.0[l].to_bits())));
        let seen = seen.collect();
        let mut sums = Sums::new(PATCHES as usize + 2);
        isa.reduce(&mut target, table, &mut sums);
        (drained(sums), pixels, seen)
    }

    /// With culling, hidden triangles are left out, and nothing is known of their pixels.
    fn by_ownership(
        isa: InstructionSet,
        blocks: &[Block],
        frame: &Frame,
        table: &DeltaTable,
        culling: bool,
    ) -> (Seen, u32) {
        let mut buffer = OwnershipBuffer::new(table, BLOCKED + 1, culling, RunIndex::default());
        let mut t = Transformed::new();
        let mut pixels = vec![[0; LANES]; blocks.len()];
        let mut hidden = 0;
        for (block, pixels) in blocks.iter().zip(&mut pixels) {
            isa.transform(block, frame, &mut t);
            for face in Face::ALL {
                let on = LanesOnFace {
                    triangles: &t,
                    face,
                    lanes: t.live,
                };
                let drawn = isa.draw_owned::<true>(on, &mut buffer, table.running(face), pixels);
                hidden += drawn.hidden.count_ones();
            }
        }
        let side = table.resolution() as usize;
        let seen = (0..3 * side).flat_map(|row| (0..side).map(move |x| (row, x)));
        let mut items = Vec::new();
        buffer.write_items(&mut items);
        assert!(seen.clone().map(|(row, x)| buffer.seen_at(row, x).0).eq(items));
        let seen = seen.map(|(row, x)| buffer.seen_at(row, x));
        let seen = seen.map(|(id, depth)| (id, depth.to_bits())).collect();
        let mut sums = Sums::new(PATCHES as usize + 2);
        buffer.reduce(table, &mut sums);
        buffer.clear();
        assert!(buffer.holdings.is_empty() && buffer.coverage.rows.iter().all(|rows| rows.0 == [0; GROUP]));
        ((drained(sums), pixels, seen), hidden)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        #[test]
        fn claims_see_what_depths_see(
            blocks in blocks(),
            resolution in prop::sample::select(vec![16u32, 48, 64, 144]),
            (a, b) in (prop_oneof![Just(0.0), -7.0..7.0f64], prop_oneof![Just(0.0), -7.0..7.0f64]),
            origin in prop::array::uniform3(prop_oneof![Just(0.0), -0.3..0.3f64]),
        ) {
            let turn = glam::DMat3::from_euler(glam::EulerRot::ZYX, a, b, 0.0);
            let frame = Frame::new(origin, turn.to_cols_array_2d(), 1e-12, UNUSED, resolution as usize);
            let table = DeltaTable::new(resolution);
            let wanted = by_depth(&blocks, &frame, &table);
            for isa in Isa::available() {
                let set = InstructionSet::of(isa).expect("available");
                let (found, hidden) = by_ownership(set, &blocks, &frame, &table, false);
                prop_assert_eq!(hidden, 0);
                prop_assert_eq!(&found, &wanted, "{:?}", isa);
                let (found, _) = by_ownership(set, &blocks, &frame, &table, true);
                prop_assert_eq!((&found.0, &found.2), (&wanted.0, &wanted.2), "{:?}, with culling", isa);
            }
        }
    }

    #[test]
    fn cells_and_their_pixels() {
        for cells in 0..=u8::MAX {
            let pixels = pixels_of(cells);
            for bit in 0..WIDTH {
                assert_eq!(
                    pixels >> bit & 1 != 0,
                    cells >> (bit / CELL) & 1 != 0,
                    "{cells:b} {bit}"
                );
            }
            for part in [
                0x8080_8080_8080_8080,
                0x0101_0101_0101_0101,
                0x1000_0200_0040_0008 | pixels,
            ] {
                assert_eq!(cells_of(pixels & part) & cells, cells_of(pixels & part));
            }
            assert_eq!(cells_of(pixels), cells);
            assert_eq!(cells_of(pixels & 0x1010_1010_1010_1010), cells);
        }
    }
}
