//! The arithmetic of engine `claims`: one coverage bit a pixel, as in engine `order`, and whose it is; depth only where
//! two surfaces contend for a pixel.
//!
//! Triangles come nearly front to back. What a triangle covers first is its claim, a mask of bits in each tile that it
//! touches; what it covers of other claims it gets where it is nearer there, by the depths of engine `depth`, to the
//! bit. Mostly a bound says that it is behind everything that covers the tile, and no depth is worked out at all.

use super::bits::{Coverage, MOST_COLUMNS, Rows, WIDTH, all_covered, at, low_bits, weight_of};
use super::{
    Chunk, Drawn, EdgeLines, Flags, GROUP, Lanes, Noted, PixelBox, Plane, Sums, Transformed, beyond_tiny, boxes,
    edge_lines, face_of_row, greater, lane_box, plane, smaller, spans_within,
};
use hemicube_contract::bvh::LANES;
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::face::Face;

/// A triangle on a face, as far as it contends for pixels.
#[derive(Clone, Copy, Debug)]
struct Claimant {
    plane: Plane,
    /// By how much a sum of the plane's terms may be off.
    slack: f64,
    id: u32,
    /// What it holds.
    pixels: u32,
    weight: u32,
    /// Its claims: these places in the list.
    claims: [u32; 2],
}

impl Claimant {
    fn new(plane: Plane, id: u32, resolution: usize) -> Self {
        let reach = plane.constant.abs() + (plane.x.abs() + plane.y.abs()) * resolution as f64;
        Self {
            plane,
            slack: 32.0 * f64::EPSILON * reach,
            id,
            pixels: 0,
            weight: 0,
            claims: [0; 2],
        }
    }

    /// The greatest and the least that depths can be in the cells of a tile that begins at column `x`, in these rows.
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
            // What is not a number may be anything between the bounds.
            out.0.0[cell] = greater(smaller(most, high), low);
            out.1.0[cell] = smaller(greater(least, low), high);
        }
        out
    }

    /// The least that depths can be in a box of a face's pixels.
    #[inline(always)]
    fn least(&self, pixels: &Span) -> f32 {
        let Plane { x, y, low, high, .. } = self.plane;
        let (xs, ys) = ((x * pixels.x0, x * pixels.x1), (y * pixels.y0, y * pixels.y1));
        let least = self.plane.constant + xs.0.min(xs.1) + ys.0.min(ys.1) - self.slack;
        #[allow(clippy::cast_possible_truncation, reason = "rounding is covered by the factor")]
        let least = (least * ROUNDED_DOWN) as f32;
        smaller(greater(least, low), high)
    }

    /// 1/w at sixteen pixels of a face, from `first` on, where a chunk begins: what engine `depth` compares.
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

    /// Those of a row's pixels, from `x` on, where a word begins, that it wins over another.
    #[inline(always)]
    unsafe fn wins<L: Lanes>(&self, over: &Self, row: usize, x: usize, pixels: u64) -> u64 {
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
                // SAFETY: the caller's promise.
                won |= u64::from(unsafe { L::mask(&wins) } & mask) << first;
            }
        }
        won
    }
}

/// More than what rounding to f32 adds, and takes away, of what is positive: what is not is clamped.
const ROUNDED_UP: f64 = 1.0 + 1e-6;
const ROUNDED_DOWN: f64 = 1.0 - 1e-6;

/// A box of a face's pixels, by their places.
#[derive(Clone, Copy, Debug)]
struct Span {
    x0: f64,
    x1: f64,
    y0: f64,
    y1: f64,
}

/// A tile's cells are this wide, and as high.
const CELL: usize = GROUP;
const CELLS: usize = WIDTH / CELL;

/// A number for each cell of a tile.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
struct Cells([f32; CELLS]);

impl Cells {
    /// The less of two in some cells.
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

/// The cells that have any of a row's pixels.
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

/// The pixels of a row in some cells.
#[inline(always)]
fn pixels_of(cells: u8) -> u64 {
    // Of a copy in each byte, its own bit; then the highest bit of each byte that has one.
    let own = (u64::from(cells) * 0x0101_0101_0101_0101) & 0x8040_2010_0804_0201;
    let carried = (own & 0x7F7F_7F7F_7F7F_7F7F) + 0x7F7F_7F7F_7F7F_7F7F;
    let highest = (carried | own) & 0x8080_8080_8080_8080;
    (highest >> 7).wrapping_mul(0xFF)
}

/// A tile: eight rows of a word of pixels.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Tile {
    /// What covers each cell is at least as near as this, in 1/w.
    farthest: Cells,
    /// What its first claim has any of, see [`Lanes::occupied`]: of fine hemicubes, most tiles have no other.
    occupied: u64,
    /// That claim's place in the list, plus 1.
    first: u32,
    /// The page of its newest claim, plus 1, if there are others.
    page: u32,
}

/// A tile that nothing covers.
const CLEAR: Tile = Tile {
    farthest: Cells([f32::INFINITY; CELLS]),
    occupied: 0,
    first: 0,
    page: 0,
};

/// Some of a tile's claims.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Page {
    /// Of each, a bit for every eight pixels of a row of which it has any: see [`Lanes::occupied`].
    occupied: [u64; ON_PAGE],
    /// Their places in the list.
    claims: [u32; ON_PAGE],
    /// The number that there are.
    count: u32,
    /// The page with the tile's claims before these, plus 1.
    before: u32,
}

/// Claims of a page.
const ON_PAGE: usize = GROUP;

/// A triangle's claim to pixels of a tile.
#[derive(Clone, Copy, Debug)]
struct Claim {
    claimant: u32,
    tile: u32,
}

/// The buffer that one hemicube is drawn into.
#[derive(Debug)]
pub(crate) struct Claims {
    coverage: Coverage,
    tiles: Vec<Tile>,
    claimants: Vec<Claimant>,
    claims: Vec<Claim>,
    /// The pixels of each claim.
    shows: Vec<Rows>,
    pages: Vec<Page>,
    /// The id of pixels that hit nothing.
    nothing: u32,
    beyond_tiny: f32,
    /// Claimants of the ids that are noted.
    noted: Noted,
}

/// A claimant on its way over a tile.
struct Contest<'a> {
    new: &'a Claimant,
    tile: usize,
    /// The tile's first column, and its first row on the face.
    x: usize,
    y: usize,
    running: &'a [u32],
}

/// The claims of a tile that have any of some pixels, all of which are covered.
struct Search {
    /// The tile's first claim, plus 1, if that is still to be looked at.
    first: u32,
    /// Where it looks then, plus 1.
    page: u32,
    /// Claims of that page that may have some, and are to be looked at.
    hits: u8,
    /// The pixels that were not found yet.
    left: Rows,
    /// What has any of them, see [`Lanes::occupied`].
    occupied: u64,
}

/// Some pixels of a tile that are a claim's.
#[derive(Clone, Copy, Debug)]
struct Found {
    pixels: Rows,
    /// Rows that have any of them.
    rows: u8,
    claim: usize,
    /// Where it stands: the page, and the place there; nowhere if it is the tile's first.
    place: Option<(usize, usize)>,
}

impl Search {
    /// Begins to look for the owners of `left` in a tile.
    #[inline(always)]
    unsafe fn new<L: Lanes>(tile: &Tile, left: Rows) -> Self {
        // SAFETY: the caller's promise.
        let occupied = unsafe { L::occupied(&left.0) };
        Self {
            first: if tile.occupied & occupied != 0 { tile.first } else { 0 },
            page: tile.page,
            hits: 0,
            occupied,
            left,
        }
    }

    /// A claim that has any of the pixels that were not found yet, and which these are; `None` when there are no more.
    #[inline(always)]
    unsafe fn next<L: Lanes>(&mut self, claims: &Claims) -> Option<Found> {
        while self.occupied != 0 {
            let (claim, place);
            if self.first != 0 {
                (claim, place) = (self.first as usize - 1, None);
                self.first = 0;
            } else {
                let page = self.page as usize - 1;
                if self.hits == 0 {
                    // SAFETY: the caller's promise.
                    self.hits = unsafe { L::any_of(&claims.pages[page].occupied, self.occupied) };
                    if self.hits == 0 {
                        self.page = claims.pages[page].before;
                        continue;
                    }
                }
                let slot = self.hits.trailing_zeros() as usize;
                self.hits &= self.hits - 1;
                (claim, place) = (claims.pages[page].claims[slot] as usize, Some((page, slot)));
                if self.hits == 0 {
                    self.page = claims.pages[page].before;
                }
            }
            let mut pixels = Rows([0; GROUP]);
            // SAFETY: the caller's promise.
            let (rows, left) = unsafe { L::common(&claims.shows[claim].0, &mut self.left.0, &mut pixels.0) };
            if rows != 0 {
                self.occupied = left;
                return Some(Found {
                    pixels,
                    rows,
                    claim,
                    place,
                });
            }
        }
        None
    }
}

impl Claims {
    pub(crate) fn new(table: &DeltaTable, nothing: u32, culling: bool, noted: Noted) -> Self {
        let coverage = Coverage::new(table.resolution(), culling).weighing(table);
        let tiles = coverage.rows.len();
        Self {
            coverage,
            tiles: vec![CLEAR; tiles],
            claimants: Vec::new(),
            claims: Vec::new(),
            shows: Vec::new(),
            pages: Vec::new(),
            nothing,
            beyond_tiny: beyond_tiny(table.resolution() as usize),
            noted,
        }
    }

    /// Adds a claim to pixels of a tile.
    #[inline(always)]
    unsafe fn push<L: Lanes>(&mut self, claimant: u32, tile: usize, shows: &Rows) {
        let state = &mut self.tiles[tile];
        // SAFETY: the caller's promise.
        let occupied = unsafe { L::occupied(&shows.0) };
        #[allow(clippy::cast_possible_truncation, reason = "fewer claims and tiles than 2³²")]
        let (claim, of_tile) = (self.claims.len() as u32, tile as u32);
        self.claims.push(Claim {
            claimant,
            tile: of_tile,
        });
        self.shows.push(*shows);
        if state.first == 0 {
            (state.first, state.occupied) = (claim + 1, occupied);
            return;
        }
        if state.page == 0 || self.pages[state.page as usize - 1].count as usize == ON_PAGE {
            self.pages.push(Page {
                occupied: [0; ON_PAGE],
                claims: [0; ON_PAGE],
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
        (page.claims[slot], page.occupied[slot]) = (claim, occupied);
        page.count += 1;
    }

    /// Returns whether all of a box of the atlas (inclusive) is nearer than `bound`.
    #[inline(always)]
    pub(crate) unsafe fn is_hidden<L: Lanes>(&self, face: Face, pixels: [usize; 4], bound: f32) -> bool {
        // SAFETY: the caller's promise.
        if unsafe { !all_covered::<L>(&self.coverage, pixels) } {
            return false;
        }
        #[allow(clippy::cast_possible_truncation, reason = "at most 1024")]
        let first_row = face.first_row(self.coverage.resolution as u32) as usize;
        let [x0, x1, y0, y1] = pixels;
        for column in x0 / WIDTH..=x1 / WIDTH {
            for group in y0 / GROUP..=y1 / GROUP {
                let tile = column * self.coverage.groups + group;
                let (left, right) = (x0.max(column * WIDTH), x1.min(column * WIDTH + WIDTH - 1));
                let mask = low_bits(right + 1 - column * WIDTH) & !low_bits(left - column * WIDTH);
                let state = &self.tiles[tile];
                // SAFETY: the caller's promise.
                let cells = unsafe { L::up_to(&state.farthest.0, &[bound; CELLS]) };
                let mask = mask & pixels_of(cells);
                if mask == 0 {
                    continue;
                }
                let (low, high) = (y0.max(group * GROUP), y1.min(group * GROUP + GROUP - 1));
                let rows = u8::MAX << (low % GROUP) & u8::MAX >> (GROUP - 1 - high % GROUP);
                let mut left = Rows([0; GROUP]);
                for (r, bits) in left.0.iter_mut().enumerate() {
                    *bits = if rows >> r & 1 != 0 { mask } else { 0 };
                }
                let (x, y) = (column * WIDTH, group * GROUP - first_row);
                // SAFETY: the caller's promise.
                unsafe {
                    let mut search = Search::new::<L>(state, left);
                    while let Some(found) = search.next::<L>(self) {
                        let claimant = &self.claimants[self.claims[found.claim].claimant as usize];
                        // Most are nearer all over.
                        if claimant.plane.low <= bound && claimant.least(&found.span::<L>(x, y)) <= bound {
                            return false;
                        }
                    }
                }
            }
        }
        true
    }

    fn tile_of(&self, row: usize, x: usize) -> usize {
        x / WIDTH * self.coverage.groups + row / GROUP
    }

    /// 1/w at a pixel of the atlas is at least this and stays so.
    pub(crate) fn at_least(&self, row: usize, x: usize) -> f32 {
        if self.coverage.is_covered(row, x, false) {
            self.tiles[self.tile_of(row, x)].farthest.0[x % WIDTH / CELL]
        } else {
            0.0
        }
    }

    /// What is seen at a pixel of the atlas, and its 1/w.
    pub(crate) fn seen_at(&self, row: usize, x: usize) -> (u32, f32) {
        if !self.coverage.is_covered(row, x, false) {
            return (self.nothing, 0.0);
        }
        let resolution = self.coverage.resolution;
        let state = &self.tiles[self.tile_of(row, x)];
        let at = 1 << (row % GROUP * (WIDTH / 8) + x % WIDTH / 8);
        let has = |occupied: u64, claim: u32| {
            occupied & at != 0 && self.shows[claim as usize].0[row % GROUP] >> (x % WIDTH) & 1 != 0
        };
        let mut claim = state.first - 1;
        if !has(state.occupied, claim) {
            let mut page = &self.pages[state.page as usize - 1];
            claim = loop {
                let mut on_page = page.occupied.iter().zip(&page.claims);
                if let Some((_, &claim)) = on_page.find(|&(&occupied, &claim)| has(occupied, claim)) {
                    break claim;
                }
                page = &self.pages[page.before as usize - 1];
            };
        }
        let claimant = &self.claimants[self.claims[claim as usize].claimant as usize];
        let face_row = if row < resolution {
            row
        } else {
            (row - resolution) % (resolution / 2)
        };
        (claimant.id, claimant.depths(face_row, x / LANES * LANES).0[x % LANES])
    }

    /// Adds up what each id shows.
    pub(crate) fn reduce(&mut self, top: &[u32], side: &[u32], sums: &mut Sums) {
        for claimant in &self.claimants {
            if claimant.pixels == 0 {
                self.noted.skip();
                continue;
            }
            sums.add(claimant.id, claimant.pixels, claimant.weight);
            if self.noted.any() {
                self.noted.add(claimant.id);
            }
        }
        sums.add(self.nothing, 0, self.coverage.open_weight(top, side));
    }

    /// Does something to each row of `coverage` where an id that is noted shows pixels: these. Returns the faces that
    /// they are on.
    pub(crate) fn each_of(&self, id: u32, coverage: &mut Coverage, each: impl Fn(&mut u64, u64)) -> u8 {
        let mut faces = 0;
        for claimant in self.noted.of(id) {
            let [start, end] = self.claimants[claimant].claims;
            for claim in start as usize..end as usize {
                let tile = self.claims[claim].tile as usize;
                faces |= face_of_row(tile % coverage.groups * GROUP, coverage.resolution);
                let rows = &mut coverage.rows[tile].0;
                for (covered, &shows) in rows.iter_mut().zip(&self.shows[claim].0) {
                    each(covered, shows);
                }
            }
        }
        faces
    }

    /// Forgets what an id shows.
    pub(crate) fn forget(&mut self, id: u32) {
        self.noted.forget(id);
    }

    /// Clears the buffer for the next hemicube.
    pub(crate) fn clear(&mut self) {
        self.claimants.clear();
        self.claims.clear();
        self.shows.clear();
        self.pages.clear();
        self.coverage.clear();
        self.tiles.fill(CLEAR);
        self.noted.clear();
    }

    /// Gives a new claimant what it wins of `left`, pixels of a tile that are covered, and adds that to `won`; returns
    /// whether it is anything.
    #[inline(always)]
    unsafe fn contest<L: Lanes>(&mut self, contest: &Contest<'_>, left: Rows, won: &mut Rows) -> bool {
        let Contest { new, x, y, .. } = *contest;
        let mut any = false;
        let resolution = self.coverage.resolution;
        // SAFETY: the caller's promise.
        let mut search = unsafe { Search::new::<L>(&self.tiles[contest.tile], left) };
        // SAFETY: likewise.
        while let Some(mut found) = unsafe { search.next::<L>(self) } {
            let claim = found.claim;
            let old = &mut self.claimants[self.claims[claim].claimant as usize];
            // Many are farther than all of the other: depths are clamped to these.
            if new.plane.high < old.plane.low {
                continue;
            }
            // SAFETY: likewise.
            let difference = Difference::new(new, old, &unsafe { found.span::<L>(x, y) });
            if difference.is_behind() {
                continue;
            }
            if !difference.is_in_front() {
                let mut unclear = found.rows;
                while unclear != 0 {
                    let r = unclear.trailing_zeros() as usize;
                    unclear &= unclear - 1;
                    // SAFETY: likewise.
                    found.pixels.0[r] = unsafe { difference.won::<L>(new, old, found.pixels.0[r], y + r, x) };
                }
            }
            let shows = &mut self.shows[claim];
            let mut taken = found.rows;
            while taken != 0 {
                let r = taken.trailing_zeros() as usize;
                taken &= taken - 1;
                let bits = found.pixels.0[r];
                any |= bits != 0;
                shows.0[r] &= !bits;
                won.0[r] |= bits;
                old.pixels -= bits.count_ones();
                old.weight -= weight_of(bits, &contest.running[(y + r) * resolution + x..]);
            }
            // SAFETY: likewise.
            let occupied = unsafe { L::occupied(&shows.0) };
            match found.place {
                Some((page, slot)) => self.pages[page].occupied[slot] = occupied,
                None => self.tiles[contest.tile].occupied = occupied,
            }
        }
        any
    }
}

impl Found {
    /// The box around them, in a tile that begins at this pixel of the face.
    #[inline(always)]
    unsafe fn span<L: Lanes>(&self, x: usize, y: usize) -> Span {
        // SAFETY: the caller's promise.
        let columns = unsafe { L::columns(&self.pixels.0) };
        Span {
            x0: (x + columns.trailing_zeros() as usize) as f64,
            x1: (x + WIDTH - 1 - columns.leading_zeros() as usize) as f64,
            y0: (y + self.rows.trailing_zeros() as usize) as f64,
            y1: (y + GROUP - 1 - self.rows.leading_zeros() as usize) as f64,
        }
    }
}

/// How much nearer one claimant is than another, in 1/w.
#[derive(Clone, Copy, Debug)]
struct Difference {
    x: f64,
    y: f64,
    constant: f64,
    /// The least and the greatest that it is in a box.
    least: f64,
    most: f64,
    /// Beyond what rounding can change: of both planes, of the clamping to what the corners have, and to f32.
    margin: f64,
}

impl Difference {
    #[inline(always)]
    fn new(new: &Claimant, old: &Claimant, span: &Span) -> Self {
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

    /// Returns whether the new one is farther all over the box. Neither this nor the next of what is not a number.
    #[inline(always)]
    fn is_behind(&self) -> bool {
        self.most < -self.margin
    }

    /// Returns whether it is nearer all over the box.
    #[inline(always)]
    fn is_in_front(&self) -> bool {
        self.least > self.margin
    }

    /// The pixels of a row, from `x` on, that the new one wins.
    #[inline(always)]
    unsafe fn won<L: Lanes>(&self, new: &Claimant, old: &Claimant, bits: u64, row: usize, x: usize) -> u64 {
        let first = self.constant + self.y * row as f64 + self.x * x as f64;
        let ends = [bits.trailing_zeros(), u64::BITS - 1 - bits.leading_zeros()];
        let ends = ends.map(|bit| first + self.x * f64::from(bit));
        if ends.iter().all(|&end| end < -self.margin) {
            return 0;
        }
        if ends.iter().all(|&end| end > self.margin) {
            return bits;
        }
        // Where the difference is 0, from the first pixel, and how far from there on it is too small to tell.
        let inverse = -1.0 / self.x;
        let (root, reach) = (first * inverse, (self.margin * inverse).abs() + 1.0);
        let (from, to) = (root - reach, root + reach);
        let (before, after) = if self.x > 0.0 { (0, u64::MAX) } else { (u64::MAX, 0) };
        // Of a plane along the row, and of what is not a number, all are unclear.
        let (below, above) = if from.is_finite() && to.is_finite() {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
            let place = |x: f64| low_bits(x.clamp(0.0, 64.0) as usize);
            (place(from), !place(to + 1.0))
        } else {
            (0, 0)
        };
        let won = bits & (below & before | above & after);
        // SAFETY: the caller's promise.
        won | unsafe { new.wins::<L>(old, row, x, bits & !below & !above) }
    }
}

/// Draws lanes of a block on a face. With `COUNT`, adds the pixels that each lane covers to `pixels`.
#[inline(always)]
pub(crate) unsafe fn draw<L: Lanes, const COUNT: bool>(
    t: &Transformed,
    face: Face,
    lanes: u16,
    claims: &mut Claims,
    running: &[u32],
    pixels: &mut [u32; LANES],
) -> Drawn {
    let resolution = claims.coverage.resolution;
    // SAFETY: the caller's promise.
    let boxes = unsafe { boxes::<L>(t, face, resolution) };
    let mut pending = (boxes.whole | boxes.straddling) & lanes;
    let mut drawn = Drawn {
        on: pending,
        ..Drawn::default()
    };
    #[allow(clippy::cast_possible_truncation, reason = "at most 1024")]
    let first_row = face.first_row(resolution as u32) as usize;
    while pending != 0 {
        let lane = pending.trailing_zeros() as usize;
        pending &= pending - 1;
        let Some((pixel_box, low, high)) = lane_box(t, &boxes, face, lane, resolution) else {
            continue;
        };
        if claims.coverage.culling {
            let in_atlas = |pixels: PixelBox| {
                let [y0, y1] = [at(pixels.y0), at(pixels.y1) - 1].map(|y| first_row + y);
                [at(pixels.x0), at(pixels.x1) - 1, y0, y1]
            };
            // SAFETY: the caller's promise.
            if unsafe { claims.is_hidden::<L>(face, in_atlas(pixel_box), high) } {
                drawn.hidden |= 1 << lane;
                let touched = in_atlas(pixel_box.wider(face, resolution));
                // SAFETY: likewise.
                if COUNT && unsafe { claims.is_hidden::<L>(face, touched, high * claims.beyond_tiny) } {
                    drawn.behind |= 1 << lane;
                }
                continue;
            }
        }
        drawn.drawn |= 1 << lane;
        let (lines, sum) = edge_lines(t, face, lane, resolution);
        let plane = plane(t, face, lane, resolution, sum, claims.nothing, low, high);
        let mut new = Claimant::new(plane, t.seen[lane], resolution);
        // SAFETY: the caller's promise.
        let covered = unsafe { claim::<L, COUNT>(&lines, pixel_box, first_row, claims, &mut new, running) };
        if COUNT {
            pixels[lane] += covered;
        }
    }
    drawn
}

/// Covers the pixels of a triangle, and takes those that it wins; returns how many it covers.
#[inline(always)]
unsafe fn claim<L: Lanes, const COUNT: bool>(
    lines: &EdgeLines,
    pixels: PixelBox,
    first_row: usize,
    claims: &mut Claims,
    new: &mut Claimant,
    running: &[u32],
) -> u32 {
    let resolution = claims.coverage.resolution;
    let mut starts = [0i32; GROUP];
    let mut ends = [0i32; GROUP];
    let (x0, x1, y0, y1) = (at(pixels.x0), at(pixels.x1) - 1, at(pixels.y0), at(pixels.y1));
    let (first, last) = (x0 / WIDTH, x1 / WIDTH);
    #[allow(clippy::cast_possible_truncation, reason = "fewer claimants than fragments")]
    let claimant = claims.claimants.len() as u32;
    let mut covered_pixels = 0;
    let claims_before = claims.claims.len();
    let mut y = y0 / GROUP * GROUP;
    while y < y1 {
        // SAFETY: the caller's promise.
        let rows = unsafe { spans_within::<L>(lines, y, pixels, &mut starts, &mut ends) };
        if rows == 0 {
            y += GROUP;
            continue;
        }
        if COUNT {
            // SAFETY: the caller's promise.
            covered_pixels += unsafe { L::pixels_of(&starts, &ends, rows) };
        }
        let group = (first_row + y) / GROUP;
        // Rows of which a pixel is its, and of which one is not.
        let (mut held, mut lost) = (0u8, 0u8);
        // What is its in each column.
        let mut shows = [const { std::mem::MaybeUninit::<Rows>::uninit() }; MOST_COLUMNS];
        for column in first..=last {
            let tile = column * claims.coverage.groups + group;
            let covered = &mut claims.coverage.rows[tile].0;
            let shows = shows[column - first].write(Rows([0; GROUP]));
            let mut over = Rows([0; GROUP]);
            // SAFETY: the caller's promise.
            let (mut seen, mut unseen) =
                unsafe { L::mark(&starts, &ends, rows, column, covered, &mut shows.0, &mut over.0) };
            if seen | unseen == 0 {
                continue;
            }
            let within = cells_of(low_bits(x1 + 1 - column * WIDTH) & !low_bits(x0.saturating_sub(column * WIDTH)));
            let (most, least) = new.range(column * WIDTH, [y0.max(y) as f64, (y1 - 1).min(y + GROUP - 1) as f64]);
            if unseen != 0 {
                // Where what covers a cell is surely nearer, nothing is to be won.
                let mut left = Rows([0; GROUP]);
                // SAFETY: the caller's promise.
                let rows = unsafe {
                    let cells = L::up_to(&claims.tiles[tile].farthest.0, &most.0) & within;
                    L::restrict(&over.0, pixels_of(cells), &mut left.0)
                };
                if rows != 0 {
                    let contest = Contest {
                        new,
                        tile,
                        x: column * WIDTH,
                        y,
                        running,
                    };
                    // SAFETY: the caller's promise.
                    unsafe {
                        if claims.contest::<L>(&contest, left, shows) {
                            seen = L::beyond(&shows.0, &[0; GROUP]);
                            unseen = L::beyond(&over.0, &shows.0);
                        }
                    }
                }
            }
            held |= seen;
            lost |= unseen;
            if seen != 0 {
                // SAFETY: the caller's promise.
                unsafe {
                    claims.push::<L>(claimant, tile, shows);
                    let cells = cells_of(L::columns(&shows.0));
                    claims.tiles[tile].farthest.lower(&least, cells);
                }
            }
        }
        let mut pending = held;
        while pending != 0 {
            let r = pending.trailing_zeros() as usize;
            pending &= pending - 1;
            let row = &running[(y + r) * resolution..];
            if lost >> r & 1 == 0 {
                let (start, end) = (at(starts[r]), at(ends[r]));
                new.weight += row[end] - row[start];
                #[allow(clippy::cast_possible_truncation, reason = "at most 1024 pixels")]
                {
                    new.pixels += (end - start) as u32;
                }
            } else {
                for (column, shows) in (first..=last).zip(&shows) {
                    // SAFETY: written above.
                    let bits = unsafe { shows.assume_init_ref() }.0[r];
                    new.weight += weight_of(bits, &row[column * WIDTH..]);
                    new.pixels += bits.count_ones();
                }
            }
        }
        y += GROUP;
    }
    if claims.claims.len() > claims_before {
        #[allow(clippy::cast_possible_truncation, reason = "fewer claims than 2³²")]
        {
            new.claims = [claims_before, claims.claims.len()].map(|place| place as u32);
        }
        claims.claimants.push(*new);
    }
    covered_pixels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Isa;
    use crate::kernel::{Frame, Kernel, Portable, Reduction, Target};
    use hemicube_contract::bvh::{Block, UNUSED};
    use proptest::prelude::*;

    /// Coordinates on a coarse grid, where surfaces share planes, edges and corners, and anywhere; a few are absurd, as
    /// those of a model, which are normalised, never are.
    fn coordinate() -> impl Strategy<Value = f64> {
        prop_oneof![
            6 => (-4i32..=4).prop_map(|k| f64::from(k) * 0.25),
            4 => -1.0..1.0f64,
            1 => prop::sample::select(vec![1e-12, -1e-9, 1e6, -1e9, 5e-324]),
        ]
    }

    /// Whatever is seen of a triangle: a patch, or what is blocked.
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

    /// What a buffer adds up: id, pixels, weight; of nothing its weight alone.
    fn drained(mut sums: Sums) -> Vec<(u32, u32, u32)> {
        let mut found = Vec::new();
        sums.drain(|id, pixels, weight| match id {
            id if id > BLOCKED && weight == 0 => {}
            id if id > BLOCKED => found.push((id, 0, weight)),
            _ => found.push((id, pixels, weight)),
        });
        found
    }

    /// What depths make of some triangles, and what claims do: the sums, the pixels of each lane, and what is seen at
    /// each pixel.
    type Seen = (Vec<(u32, u32, u32)>, Vec<[u32; LANES]>, Vec<(u32, u32)>);

    fn by_depth(blocks: &[Block], frame: &Frame, table: &DeltaTable, resolution: u32) -> Seen {
        let mut target = Target::new(resolution, BLOCKED + 1, false, Noted::default());
        let mut t = Transformed::new();
        let mut pixels = vec![[0; LANES]; blocks.len()];
        for (block, pixels) in blocks.iter().zip(&mut pixels) {
            // SAFETY: the portable path needs no instruction set.
            unsafe {
                <Portable as Kernel>::transform(block, frame, &mut t);
                for face in Face::ALL {
                    <Portable as Kernel>::draw::<true>(&t, face, t.live, &mut target, pixels);
                }
            }
        }
        let seen = target.items.iter().zip(&target.depth);
        let seen = seen.flat_map(|(items, depths)| (0..LANES).map(|l| (items.0[l], depths.0[l].to_bits())));
        let seen = seen.collect();
        let mut sums = Sums::new(PATCHES as usize + 2);
        let (top, side) = (table.running(Face::Top), table.running(Face::PosX));
        // SAFETY: as above.
        unsafe {
            <Portable as Kernel>::reduce(
                &mut target,
                Reduction {
                    top,
                    side,
                    sums: &mut sums,
                },
            );
        }
        (drained(sums), pixels, seen)
    }

    /// With culling, what is hidden is left out, and of its pixels nothing is known.
    fn by_claims<K: Kernel>(
        blocks: &[Block],
        frame: &Frame,
        table: &DeltaTable,
        resolution: u32,
        culling: bool,
    ) -> (Seen, u32) {
        let mut claims = Claims::new(table, BLOCKED + 1, culling, Noted::default());
        let mut t = Transformed::new();
        let mut pixels = vec![[0; LANES]; blocks.len()];
        let mut hidden = 0;
        for (block, pixels) in blocks.iter().zip(&mut pixels) {
            // SAFETY: callers checked the machine for K's instruction set.
            unsafe {
                K::transform(block, frame, &mut t);
                for face in Face::ALL {
                    let drawn = K::claim::<true>(&t, face, t.live, &mut claims, table.running(face), pixels);
                    hidden += drawn.hidden.count_ones();
                }
            }
        }
        let side = resolution as usize;
        let seen = (0..3 * side).flat_map(|row| (0..side).map(move |x| (row, x)));
        let seen = seen.map(|(row, x)| claims.seen_at(row, x));
        let seen = seen.map(|(id, depth)| (id, depth.to_bits())).collect();
        let mut sums = Sums::new(PATCHES as usize + 2);
        claims.reduce(table.running(Face::Top), table.running(Face::PosX), &mut sums);
        claims.clear();
        assert!(claims.claims.is_empty() && claims.coverage.rows.iter().all(|rows| rows.0 == [0; GROUP]));
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
            let frame = Frame::new(origin, turn.to_cols_array_2d(), 1e-12, UNUSED);
            let table = DeltaTable::new(resolution);
            let wanted = by_depth(&blocks, &frame, &table, resolution);
            for isa in Isa::available() {
                let path = match isa {
                    #[cfg(target_arch = "x86_64")]
                    Isa::Avx512 => by_claims::<crate::kernel::x86::Avx512>,
                    #[cfg(target_arch = "x86_64")]
                    Isa::Avx2 => by_claims::<crate::kernel::x86::Avx2>,
                    _ => by_claims::<Portable>,
                };
                let (found, hidden) = path(&blocks, &frame, &table, resolution, false);
                prop_assert_eq!(hidden, 0);
                prop_assert_eq!(&found, &wanted, "{:?}", isa);
                let (found, _) = path(&blocks, &frame, &table, resolution, true);
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
