//! What is seen of triangles that were cut, shared out among their patches: the second step of every engine that draws
//! them whole.
//!
//! No pixel counts in place of weights where only ratios are wanted, because weights of whole spans are two loads a row
//! of pixels, and every row can then be checked to sum to 2³¹. (Gather instructions cost more than those loads.)

use crate::Shared;
use crate::alone::Alone;
use crate::kernel::{Coverage, Frame, Kernel, Shown, Transformed, Turns};
use crate::whole::{Whole, Wholes};
use hemicube_contract::InputPatch;
use hemicube_contract::bvh::{Block, LANES};
use hemicube_contract::face::Face;
use hemicube_contract::row::RowBlock;
use std::marker::PhantomData;

/// An entry of the row being made.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    pub(crate) patch: u32,
    pub(crate) visible: u32,
    /// Or [`UNCOUNTED`].
    pub(crate) covered: u32,
}

impl Entry {
    pub(crate) fn new(patch: u32, visible: u32, covered: u32) -> Self {
        Self {
            patch,
            visible,
            covered,
        }
    }
}

/// Stands for a covered weight that is to be counted: more than all pixels have.
pub(crate) const UNCOUNTED: u32 = u32::MAX;

/// Stands for a weight that is an equal part of what its whole shows beside patches whose weights are known.
const EVENLY: u32 = u32::MAX - 1;

/// A triangle that was cut and is seen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SeenWhole<'a> {
    pub(crate) whole: &'a Whole,
    /// What it is drawn as.
    pub(crate) id: u32,
    /// With covered weights, all that it covers is on these; without, all that it shows.
    pub(crate) faces: u8,
    /// What is seen of it.
    pub(crate) weight: u32,
}

/// Working memory of the sharing of one hemicube's row.
#[derive(Debug)]
pub(crate) struct Sharing<K> {
    /// All is covered but, for the moment, what one triangle that was cut shows.
    pub(crate) open: Coverage,
    /// Patches of such a triangle, and where they are in a hemicube's frame.
    patches: Box<Block>,
    pub(crate) triangles: Box<Transformed>,
    /// The row being made, in ascending order of patches.
    pub(crate) entries: Vec<Entry>,
    /// Patches of which it is to be counted what they cover alone.
    uncounted: Vec<u32>,
    alone: Alone<K>,
    /// Patches that were brought into a frame since that was last asked.
    transformed: u64,
    kernel: PhantomData<K>,
}

impl<K: Kernel> Sharing<K> {
    pub(crate) fn new(shared: &Shared) -> Self {
        Self {
            open: Coverage::full(if shared.wholes.is_some() {
                shared.settings.resolution
            } else {
                0
            }),
            patches: Box::new(Block::empty()),
            triangles: Box::new(Transformed::new()),
            entries: Vec::new(),
            uncounted: Vec::new(),
            alone: Alone::new(),
            transformed: 0,
            kernel: PhantomData,
        }
    }

    /// Number of patches that were brought into a frame since this was last asked.
    pub(crate) fn take_transformed(&mut self) -> u64 {
        std::mem::take(&mut self.transformed)
    }

    /// Brings sixteen patches of a triangle that was cut, and drawn as `id`, into a frame.
    pub(crate) fn transform(&mut self, wholes: &Wholes, frame: &Frame, whole: &Whole, id: u32, block: usize) {
        wholes.patches(whole, id, block, &mut self.patches);
        let t = &mut *self.triangles;
        // SAFETY: `Isa::available` checked the machine for K's instruction set before any engine was made.
        unsafe { K::transform(&self.patches, frame, t) };
        self.transformed += LANES as u64;
        let sign = whole.sign(id);
        let same_side = (0..LANES).fold(0, |lanes, lane| lanes | u16::from(t.sign[lane] == sign) << lane);
        t.live &= same_side;
    }

    /// Lists the patches of a triangle that was cut and shows all that it covers: so do they.
    pub(crate) fn list_all(&mut self, wholes: &Wholes, frame: &Frame, seen: &SeenWhole<'_>) {
        let &SeenWhole { whole, id, .. } = seen;
        let first = self.entries.len();
        if whole.is_above(frame) {
            self.entries
                .extend(whole.patches(id).map(|patch| Entry::new(patch, 0, EVENLY)));
        } else {
            for block in 0..wholes.block_count(whole) {
                self.transform(wholes, frame, whole, id, block);
                let live = patches_of(&self.triangles, self.triangles.live);
                self.entries.extend(live.map(|patch| Entry::new(patch, 0, EVENLY)));
            }
        }
        self.give(wholes, frame, seen, seen.weight, first);
    }

    /// Shares out what is seen of a triangle that was cut, whose pixels are open, among its patches; returns whether
    /// some may still be.
    ///
    /// `tiny` is given lanes of patches that were found to cover no pixel, and those of them that were left out
    /// somewhere, so that this does not say much.
    pub(crate) fn share<const COVERED: bool>(
        &mut self,
        shared: &Shared,
        wholes: &Wholes,
        frame: &Frame,
        seen: &SeenWhole<'_>,
        mut tiny: impl FnMut(&Transformed, u16, u16),
    ) -> bool {
        let &SeenWhole {
            whole,
            id,
            faces,
            weight,
        } = seen;
        let (top, side) = (shared.table.running(Face::Top), shared.table.running(Face::PosX));
        let first = self.entries.len();
        let mut left = weight;
        let mut stays_open = false;
        for block in 0..wholes.block_count(whole) {
            self.transform(wholes, frame, whole, id, block);
            let t = &mut *self.triangles;
            let mut shown = Shown::new();
            let mut in_the_open = 0;
            // SAFETY: `Isa::available` checked the machine for K's instruction set before any engine was made.
            unsafe {
                if shared.fractions {
                    in_the_open = K::in_the_open(t, faces, &self.open);
                    t.live &= !in_the_open;
                    stays_open |= in_the_open != 0;
                }
                if t.live != 0 {
                    K::draw_bits::<COVERED>(t, None, faces, Turns::Parts, &mut self.open, top, side, &mut shown);
                }
            }
            let mut listed = shown.seen | in_the_open;
            while listed != 0 {
                let lane = listed.trailing_zeros() as usize;
                listed &= listed - 1;
                if in_the_open >> lane & 1 != 0 {
                    self.entries.push(Entry::new(t.seen[lane], 0, EVENLY));
                    continue;
                }
                left -= shown.visible[lane];
                let is_known = COVERED && shown.hidden >> lane & 1 == 0;
                let covered = if is_known { shown.covered[lane] } else { UNCOUNTED };
                self.entries
                    .push(Entry::new(t.seen[lane], shown.visible[lane], covered));
            }
            if COVERED && shown.tiny != 0 {
                tiny(t, shown.tiny, shown.hidden);
            }
        }
        self.give(wholes, frame, seen, left, first);
        // Near the horizon of a fine hemicube, pixels have no weight.
        left != 0 || stays_open
    }

    /// Gives what is left of a whole's weight to its entries, those from `first` on: to those that show all that they
    /// cover an equal part each; where there are none, it is what rounding leaves, which has the outline of the patches
    /// at the other side of a pixel's centre: whose that is hardly matters; that it is somebody's does.
    fn give(&mut self, wholes: &Wholes, frame: &Frame, seen: &SeenWhole<'_>, left: u32, first: usize) {
        let of_whole = &mut self.entries[first..];
        #[allow(clippy::cast_possible_truncation, reason = "fewer than patches")]
        let count = of_whole.iter().filter(|entry| entry.covered == EVENLY).count() as u32;
        if let Some(part) = left.checked_div(count) {
            let mut more = left % count;
            for entry in of_whole.iter_mut().filter(|entry| entry.covered == EVENLY) {
                entry.visible = part + u32::from(more != 0);
                entry.covered = entry.visible;
                more = more.saturating_sub(1);
            }
        } else if left != 0 {
            match of_whole.iter_mut().max_by_key(|entry| entry.visible) {
                Some(entry) => entry.visible += left,
                None => self
                    .entries
                    .push(Entry::new(wholes.nearest(seen.whole, seen.id, frame), left, UNCOUNTED)),
            }
        }
    }

    /// Adds the row of the entries, which are forgotten, and of what was found tiny, in ascending order; what is not
    /// known of covered weights is counted.
    pub(crate) fn end_row<const COVERED: bool>(
        &mut self,
        shared: &Shared,
        frame: &Frame,
        tiny: &[u32],
        (escaped, blocked): (u32, u32),
        out: &mut RowBlock,
    ) {
        if !COVERED {
            for entry in self.entries.drain(..) {
                out.push(InputPatch(entry.patch), entry.visible, 0);
            }
            out.end_row(escaped, blocked);
            return;
        }
        self.uncounted.clear();
        let unknown = self.entries.iter().filter(|entry| entry.covered == UNCOUNTED);
        self.uncounted.extend(unknown.map(|entry| entry.patch));
        let counts = self.alone.count(shared, frame, &self.uncounted);
        let mut counted = counts.iter();
        let mut tiny = tiny.iter().copied().peekable();
        for entry in self.entries.drain(..) {
            while let Some(tiny) = tiny.next_if(|&t| t <= entry.patch) {
                // One that was given what rounding left over has its entry.
                if tiny < entry.patch {
                    out.push(InputPatch(tiny), 0, 0);
                }
            }
            let covered = match entry.covered {
                UNCOUNTED => counted.next().map_or(0, |count| count.1),
                known => known,
            };
            // What shows of a patch, it covers.
            out.push(InputPatch(entry.patch), entry.visible, covered.max(entry.visible));
        }
        for tiny in tiny {
            out.push(InputPatch(tiny), 0, 0);
        }
        out.end_row(escaped, blocked);
    }
}

/// Those of these lanes that cover no pixel, which is to be shown of those in `unproved`: of parts of a triangle that
/// is on these faces.
pub(crate) fn without_pixels<K: Kernel>(shared: &Shared, t: &Transformed, lanes: u16, unproved: u16, faces: u8) -> u16 {
    let mut without = lanes;
    if lanes & unproved != 0 {
        let (top, side) = (shared.table.running(Face::Top), shared.table.running(Face::PosX));
        let resolution = shared.settings.resolution as usize;
        let mut counts = [(0, 0); LANES];
        // SAFETY: `Isa::available` checked the machine for K's instruction set before any engine was made.
        unsafe { K::cover_lanes(t, lanes & unproved, faces, resolution, top, side, &mut counts) };
        for (lane, (pixels, _)) in counts.iter().enumerate() {
            without &= !(u16::from(*pixels != 0) << lane);
        }
    }
    without
}

/// The patches of these lanes.
pub(crate) fn patches_of(t: &Transformed, mut lanes: u16) -> impl Iterator<Item = u32> + use<'_> {
    std::iter::from_fn(move || {
        (lanes != 0).then(|| {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            t.seen[lane]
        })
    })
}
