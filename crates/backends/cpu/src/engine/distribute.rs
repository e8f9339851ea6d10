//! Visible weights of parent triangles, distributed over their patches: the second step of every engine.
//!
//! The visible pixels of a parent are uncovered in an otherwise full coverage, and its patches, made from the lattice
//! as needed, are drawn into them by the kernel of engine `order`. Rounding leaves some pixels over; they go to the
//! patch with the largest visible weight, or to the one nearest to the eye if none is visible, so that no weight is
//! lost.
//!
//! No pixel counts in place of weights where only ratios are wanted, because the weight of a whole span is two loads a
//! row of pixels, and every row can then be checked to sum to 2³¹. (Gather instructions cost more than those loads.)

use super::covered::CoveredCounter;
use super::{Remainder, View, ids_of};
use crate::SharedScene;
use crate::kernel::{Coverage, Pass, Transformed, Turns, bits};
use crate::parents::{ParentTriangle, ParentTriangles};
use hemicube_contract::InputPatch;
use hemicube_contract::bvh::{Block, LANES};
use hemicube_contract::row::RowBlock;

/// An entry of the row being made.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    patch: u32,
    visible: u32,
    /// Covered weight, [`UNCOUNTED`] or [`EVENLY`].
    covered: u32,
}

impl Entry {
    pub(super) fn new(patch: u32, visible: u32, covered: u32) -> Self {
        Self {
            patch,
            visible,
            covered,
        }
    }
}

/// A covered weight still to be counted: above the weight of all pixels.
pub(super) const UNCOUNTED: u32 = u32::MAX;

/// Weights equal to those of all other fully visible patches of the parent: their common part is still to be computed.
const EVENLY: u32 = u32::MAX - 1;

/// A visible parent triangle with more than one patch.
#[derive(Clone, Copy, Debug)]
pub(super) struct VisibleParent<'a> {
    pub(super) parents: &'a ParentTriangles,
    pub(super) parent: &'a ParentTriangle,
    /// The id it is drawn with.
    pub(super) id: u32,
    /// Faces with all its covered pixels; without covered weights, with all its visible pixels.
    pub(super) faces: u8,
    /// Visible weight.
    pub(super) weight: u32,
}

/// Working memory for the row of one hemicube.
#[derive(Debug)]
pub(super) struct Distributor {
    /// Full but for the visible pixels of the parent at hand.
    pub(super) uncovered: Coverage,
    /// Sixteen patches of the parent at hand.
    patches: Box<Block>,
    pub(super) triangles: Box<Transformed>,
    /// The row being made, in ascending order of patches.
    pub(super) entries: Vec<Entry>,
    /// Patches with a covered weight to be counted.
    uncounted: Vec<u32>,
    counter: CoveredCounter,
    /// Patches transformed since the last [`Self::take_transformed`].
    transformed: u64,
}

impl Distributor {
    pub(super) fn new(scene: &SharedScene) -> Self {
        let has_parents = scene.parents.is_some();
        Self {
            uncovered: Coverage::full(if has_parents { scene.settings.resolution } else { 0 }),
            patches: Box::new(Block::empty()),
            triangles: Box::new(Transformed::new()),
            entries: Vec::new(),
            uncounted: Vec::new(),
            counter: CoveredCounter::new(),
            transformed: 0,
        }
    }

    /// Number of patches transformed since the last call.
    pub(super) fn take_transformed(&mut self) -> u64 {
        std::mem::take(&mut self.transformed)
    }

    /// Transforms sixteen patches of a parent drawn with `id`; keeps those on the visible side.
    pub(super) fn transform(&mut self, view: View<'_>, of: &VisibleParent<'_>, block: usize) {
        of.parents.patches(of.parent, of.id, block, &mut self.patches);
        let t = &mut *self.triangles;
        view.scene.isa.transform(&self.patches, view.frame, t);
        self.transformed += LANES as u64;
        let sign = of.parent.sign(of.id);
        let same_side = (0..LANES).fold(0, |lanes, lane| lanes | u16::from(t.sign[lane] == sign) << lane);
        t.live &= same_side;
    }

    /// Lists all patches of a parent that shows everything it covers: so do they.
    pub(super) fn list_all(&mut self, view: View<'_>, seen: &VisibleParent<'_>) {
        let first = self.entries.len();
        if seen.parent.is_above(view.frame) {
            let patches = seen.parent.patches(seen.id);
            self.entries.extend(patches.map(|patch| Entry::new(patch, 0, EVENLY)));
        } else {
            for block in 0..seen.parents.block_count(seen.parent) {
                self.transform(view, seen, block);
                let live = ids_of(&self.triangles, self.triangles.live);
                self.entries.extend(live.map(|patch| Entry::new(patch, 0, EVENLY)));
            }
        }
        self.give(view, seen, seen.weight, first);
    }

    /// Distributes the visible weight of a parent, with its visible pixels uncovered. Returns true if some of them may
    /// still be uncovered.
    ///
    /// Calls `subpixel(patches, lanes found without a pixel, lanes hidden somewhere)`; the hidden ones may have pixels.
    pub(super) fn distribute<const COVERED: bool>(
        &mut self,
        view: View<'_>,
        seen: &VisibleParent<'_>,
        mut subpixel: impl FnMut(&Transformed, u16, u16),
    ) -> bool {
        let scene = view.scene;
        let pass = Pass {
            faces: seen.faces,
            turns: Turns::Parts,
            cut: None,
        };
        let first = self.entries.len();
        let mut left = seen.weight;
        let mut stays_uncovered = false;
        for block in 0..seen.parents.block_count(seen.parent) {
            self.transform(view, seen, block);
            let t = &mut *self.triangles;
            let mut wholly_visible = 0;
            if scene.fractions {
                wholly_visible = scene.isa.wholly_uncovered(t, seen.faces, &self.uncovered);
                t.live &= !wholly_visible;
                stays_uncovered |= wholly_visible != 0;
            }
            let shown = (t.live != 0).then(|| {
                scene
                    .isa
                    .draw_patches::<COVERED>(t, pass, &mut self.uncovered, &scene.table)
            });
            let listed = wholly_visible | shown.as_ref().map_or(0, |shown| shown.seen);
            for lane in bits(u32::from(listed)) {
                let Some(shown) = shown.as_ref().filter(|_| wholly_visible >> lane & 1 == 0) else {
                    self.entries.push(Entry::new(t.seen[lane], 0, EVENLY));
                    continue;
                };
                left -= shown.visible[lane];
                let is_known = COVERED && shown.hidden >> lane & 1 == 0;
                let covered = if is_known { shown.covered[lane] } else { UNCOUNTED };
                self.entries
                    .push(Entry::new(t.seen[lane], shown.visible[lane], covered));
            }
            if let Some(shown) = shown.filter(|shown| COVERED && shown.subpixel != 0) {
                subpixel(t, shown.subpixel, shown.hidden);
            }
        }
        self.give(view, seen, left, first);
        // Near the horizon of a fine hemicube, pixels have no weight.
        left != 0 || stays_uncovered
    }

    /// Distributes a parent's remaining weight equally over its fully visible entries, among those from `first` on. If
    /// there are none, only rounding is left, from pixel centres on the parent's outline: any entry may take it, but
    /// the row must sum to 2³¹.
    fn give(&mut self, view: View<'_>, seen: &VisibleParent<'_>, left: u32, first: usize) {
        let of_parent = &mut self.entries[first..];
        #[allow(clippy::cast_possible_truncation, reason = "fewer than patches")]
        let count = of_parent.iter().filter(|entry| entry.covered == EVENLY).count() as u32;
        if let Some(part) = left.checked_div(count) {
            let mut more = left % count;
            for entry in of_parent.iter_mut().filter(|entry| entry.covered == EVENLY) {
                entry.visible = part + u32::from(more != 0);
                entry.covered = entry.visible;
                more = more.saturating_sub(1);
            }
        } else if left != 0 {
            match of_parent.iter_mut().max_by_key(|entry| entry.visible) {
                Some(entry) => entry.visible += left,
                None => {
                    let nearest = seen.parents.nearest(seen.parent, seen.id, view.frame);
                    self.entries.push(Entry::new(nearest, left, UNCOUNTED));
                }
            }
        }
    }

    /// Ends the row: its entries and the sub-pixel patches, both ascending. Counts the unknown covered weights.
    pub(super) fn end_row<const COVERED: bool>(
        &mut self,
        view: View<'_>,
        subpixel: &[u32],
        remainder: Remainder,
        out: &mut RowBlock,
    ) {
        if !COVERED {
            for entry in self.entries.drain(..) {
                out.push(InputPatch(entry.patch), entry.visible, 0);
            }
            out.end_row(remainder.escaped, remainder.blocked);
            return;
        }
        self.uncounted.clear();
        let unknown = self.entries.iter().filter(|entry| entry.covered == UNCOUNTED);
        self.uncounted.extend(unknown.map(|entry| entry.patch));
        let counts = self.counter.count(view, &self.uncounted);
        let mut counted = counts.iter();
        let mut subpixel = subpixel.iter().copied().peekable();
        for entry in self.entries.drain(..) {
            while let Some(patch) = subpixel.next_if(|&patch| patch <= entry.patch) {
                // A sub-pixel patch that was given the rounding has its entry.
                if patch < entry.patch {
                    out.push(InputPatch(patch), 0, 0);
                }
            }
            let covered = match entry.covered {
                UNCOUNTED => counted.next().map_or(0, |count| count.weight),
                known => known,
            };
            // Visible pixels are covered.
            out.push(InputPatch(entry.patch), entry.visible, covered.max(entry.visible));
        }
        for patch in subpixel {
            out.push(InputPatch(patch), 0, 0);
        }
        out.end_row(remainder.escaped, remainder.blocked);
    }
}
