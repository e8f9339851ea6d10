//! Rows through portals: a finished row of F becomes one of F^s.
//!
//! - *pixel*: the pixels that see a portal are drawn again as seen through it (`pass`), each with its weight, in whole
//!   numbers: visible + escaped + blocked + unselected stays hemicubes · 2³¹, with what was cut off in the last.
//! - *tolerance*: direct form factors stay. Rays aimed at the portals in sight (`aim`) find the pairs seen
//!   through them. Segments and closed forms (`pairs`) measure the largest of them, until the rest by rays keeps its
//!   share of the tolerance, unless more rays keep it for less. Two commuting mirrors, as of a duct, make one pair with
//!   one closed form for either order.
//!
//! What a row may cost is counted in legs between portals, never timed. With a tolerance T, rays end after 2¹⁸ · max(1
//! %/T, 1) legs, at most 2²⁴, and segments after as many again: what they leave is in the expected error. Paths are cut
//! off after 2²² legs, or 2²⁵ with a tolerance, after 10,000 portals, and where no more than the bound is left of them.
//! All that is counted.

use super::aim::Casts;
use super::bands::Common;
use super::gather::{Column, Found, Ledger, apportion};
use super::motion::{MotionId, Motions, OTHER};
use super::pairs::{Share, Through};
use super::pass::{Passes, PixelView, Taker};
use super::specular::Laws;
use super::trace::{Surfaces, Tracer};
use super::{Images, Optics, Portals};
use crate::Model;
use crate::accuracy::closing::{Lacking, Uncertain, project};
use crate::accuracy::correct::Correction;
use crate::accuracy::row::Emitter;
use crate::backend::{BackendError, Hemicube, HemicubeBackend, WHOLE};
use crate::bvh::Tree;
use crate::delta::DeltaTable;
use crate::face::Items;
use crate::factor::{FactorRule, exchange};
use crate::store::{FinishedRow, HEMICUBE_WEIGHT, Passage, RowErrors, RowShares};
use hemicube_scene::InputPatch;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Parts of a pixel's unit of weight.
const FINE: u64 = 1 << 10;
/// Rays that a row begins with, of which those that meet a portal are cast. A choice: with fewer, a small portal is
/// missed at first; with more, rows pay for portals that hardly matter.
const RAYS: usize = 1 << 12;
/// Rays of a row at most.
const RAYS_MAX: usize = 1 << 20;
/// Hits expected of a pair, nothing hidden, from which on it is measured by segments.
/// Expected, not counted: replacing what was hit too often and keeping what was hit too seldom would lose light. For
/// the same reason pairs are looked at in an order that does not depend on hits, and those that rays found stand for
/// those that they missed ([`Known::measure`]).
const HITS: f64 = 8.0;
/// Legs of a row after which no further rays are cast, and as many again for segments; times
/// max(1 %/T, 1), up to 2²⁴. What is then left is in the row's expected error. A choice: with less, rows
/// between facing mirrors stop short of the tolerance; with more, they take longer.
const EFFORT: f64 = 262_144.0;
/// Legs of a hemicube whose pixels are followed, and of a row of rays, after which paths are cut off.
const LEGS_OF_PIXELS: u64 = 1 << 22;
const LEGS: u64 = 1 << 25;
/// Pairs of a row measured by segments. A choice: with fewer, more of a row is left to its rays; with more, its small
/// pairs take segments that rays had done for.
const PAIRS: usize = 1024;
/// Segments of a pair at least and at most. Choices: with fewer at least, those that agree by chance count as exact
/// more often; with more, pairs behind nothing pay for it. The most is a row's [`EFFORT`].
const SEGMENTS: (usize, usize) = (64, 1 << 18);
/// Pairs looked at for one that is measured. A choice: with fewer, pairs that rays missed are not found; with more,
/// looking costs more than measuring.
const LOOKS: usize = 4;
/// Part of a tolerance for what comes through portals. A choice: with more, the row before them must be finer, and with
/// less, they.
const PART: f64 = 0.5;

/// The hemicubes that a row is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Drawn<'r> {
    pub(crate) hemicubes: &'r [Hemicube],
    /// Their item buffers; empty if they are still to be drawn.
    pub(crate) items: &'r [Items],
}

/// Arrivals through portals, as shares of the patch's emission.
#[derive(Debug, Default)]
struct Brought {
    /// Columns, by patch of the model.
    factors: Vec<(u32, f64)>,
    /// Escaped, blocked, unselected, cut off.
    lost: [f64; 4],
    passed: f64,
    /// Expected squared errors of the entries together, of their sum and of *escaped*.
    variances: [f64; 3],
}

/// A pair that rays found.
type Entry = ((MotionId, u32), Found);

/// Extends rows, one after the other; one a thread.
#[derive(Debug)]
pub(crate) struct Extender<'a> {
    portals: &'a Portals,
    pub(super) model: &'a Model,
    correction: Correction,
    pub(super) cancel: &'a AtomicBool,
    /// Weights of pixels and their further passes, where pixels are followed.
    pixels: Option<(Arc<DeltaTable>, Passes<1>)>,
    tracer: Tracer,
    motions: Motions,
    ledger: Ledger,
    row: Vec<(u32, f64)>,
}

impl<'a> Extender<'a> {
    /// `table` gives the weights of the hemicubes' pixels.
    pub(crate) fn new(
        portals: &'a Portals,
        model: &'a Model,
        correction: Correction,
        table: impl FnOnce() -> Arc<DeltaTable>,
        cancel: &'a AtomicBool,
    ) -> Self {
        let count = model.geometry().patch_count;
        let specular = portals.specular.as_ref();
        let laws = specular.map_or_else(Laws::default, |specular| specular.laws(portals.images.as_ref(), count));
        let tree = Tree::of(model.geometry());
        let follows_pixels = specular.is_some() && correction == Correction::Pixel;
        Self {
            portals,
            model,
            correction,
            cancel,
            pixels: follows_pixels.then(|| (table(), Passes::new(&tree, [&laws.means]))),
            tracer: Tracer::new(tree, laws),
            motions: Motions::default(),
            ledger: Ledger::default(),
            row: Vec::new(),
        }
    }

    /// Weights of pixels, where they are followed.
    pub(super) fn table(&self) -> Option<&Arc<DeltaTable>> {
        self.pixels.as_ref().map(|(table, _)| table)
    }

    /// The share of its weight at which a path ends.
    pub(super) fn bound(&self) -> f64 {
        bound(self.portals)
    }

    pub(super) fn surfaces(&self) -> Surfaces<'_> {
        self.tracer.surfaces()
    }

    /// The place of a patch of the model, `receives` telling the patches with a column.
    pub(super) fn column(&self, patch: u32, receives: impl Fn(u32) -> bool) -> Column {
        column(self.portals, patch, receives)
    }

    /// Extends a row that is seen directly, of a run's `band`. `receives` tells the patches with a column, and `common` has what bands share.
    ///
    /// # Errors
    /// When the backend hands out no item buffers, where pixels are followed.
    pub(crate) fn extend(
        &mut self,
        row: &mut FinishedRow,
        drawn: Drawn<'_>,
        receives: impl Fn(u32) -> bool,
        session: &mut dyn HemicubeBackend,
        (common, band): (&mut Common, usize),
    ) -> Result<(), BackendError> {
        let images = self.portals.images.as_ref();
        let mut passage = Passage::default();
        self.row.clear();
        self.row.extend(row.entries());
        if images.is_some_and(Images::has_curtains) {
            passage.cut_off = self.cut_off(row);
        }
        self.ledger.clear();
        let sent = self.sent();
        if sent > 0.0 {
            let portals = self.portals;
            let column = |patch: u32| column(portals, patch, &receives);
            let brought = if self.pixels.is_some() {
                match common.take(band) {
                    Some(followed) => {
                        std::mem::swap(&mut self.ledger, &mut followed.ledger);
                        self.tracer.legs = followed.legs;
                    }
                    None => self.follow_pixels(drawn, column, session)?,
                }
                self.by_pixels(drawn.hemicubes.len())
            } else {
                std::mem::swap(&mut self.tracer.known, &mut common.known);
                let brought = self.by_rays(InputPatch(row.patch), column);
                std::mem::swap(&mut self.tracer.known, &mut common.known);
                brought
            };
            row.rays += std::mem::take(&mut self.tracer.legs);
            self.enter(row, &brought, &mut passage);
            self.row.extend(brought.factors);
        }
        self.write(row);
        row.passage = Some(passage);
        Ok(())
    }

    /// Takes the columns of curtains out of the row. Returns their sum, which is *unselected* from now on.
    fn cut_off(&mut self, row: &mut FinishedRow) -> f64 {
        let Some(images) = &self.portals.images else { return 0.0 };
        let mut sum = 0.0;
        self.row.retain(|&(patch, factor)| {
            let is_kept = images.fold(patch).is_some();
            sum += if is_kept { 0.0 } else { factor };
            is_kept
        });
        let count = row.hemicubes.max(1);
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of the whole"
        )]
        let weight = (sum * (u64::from(count) * HEMICUBE_WEIGHT) as f64).round() as u64;
        let weight = weight.min(row.sums.visible);
        row.sums.visible -= weight;
        row.sums.unselected += weight;
        if self.correction == Correction::Pixel {
            row.shares = RowShares::of_hemicubes(&row.sums, count);
        } else {
            row.shares.unselected += sum;
        }
        sum
    }

    /// Σ (ρs + τ) F of direct arrivals; of patches whose ρs + τ depend on the angle by the mean of the row's rays, and
    /// before these are cast by the hemisphere's.
    fn sent(&self) -> f64 {
        let passed = |patch: u32| match self.ledger.first.get(&patch) {
            Some(&[met, passed]) => passed as f64 / met.max(1) as f64,
            None => self.tracer.optics.get(patch as usize).map_or(0.0, Optics::passed),
        };
        self.row.iter().map(|&(patch, factor)| factor * passed(patch)).sum()
    }

    /// Follows the pixels that see a portal.
    fn follow_pixels(
        &mut self,
        Drawn { hemicubes, items }: Drawn<'_>,
        column: impl Fn(u32) -> Column,
        session: &mut dyn HemicubeBackend,
    ) -> Result<(), BackendError> {
        let Self {
            pixels: Some((table, passes)),
            tracer,
            ledger,
            portals,
            row,
            cancel,
            ..
        } = self
        else {
            return Ok(());
        };
        ledger.clear();
        let mut taker = Taker {
            ledgers: std::array::from_mut(ledger),
            column,
            up: None,
        };
        let is_portal = |patch: u32| tracer.optics.get(patch as usize).is_some_and(Optics::is_portal);
        let seen: Vec<u32> = row
            .iter()
            .map(|&(patch, _)| patch)
            .filter(|&patch| is_portal(patch))
            .collect();
        let pixels = RowPixels {
            hemicubes,
            items,
            table,
            bound: bound(portals),
            cancel,
        };
        follow_row(passes, pixels, &seen, [tracer.surfaces()], &mut taker, session)?;
        [tracer.legs] = std::mem::take(&mut passes.legs);
        Ok(())
    }

    /// What pixels brought, followed from so many hemicubes.
    fn by_pixels(&self, hemicubes: usize) -> Brought {
        let ledger = &self.ledger;
        let whole = (u64::from(WHOLE) * FINE) as f64 * hemicubes.max(1) as f64;
        let passed: u64 = ledger.entries.values().map(|found| found.passed).sum();
        Brought {
            factors: ledger
                .sorted()
                .iter()
                .map(|&((_, patch), found)| (patch, found.weight as f64 / whole))
                .collect(),
            lost: [ledger.escaped, ledger.blocked, ledger.unselected, ledger.cut_off].map(|lost| lost as f64 / whole),
            passed: (ledger.sent + passed) as f64 / whole,
            variances: [0.0; 3],
        }
    }

    /// Casts rays at portals from all over the patch, and measures what they find most of.
    fn by_rays(&mut self, emitter: InputPatch, column: impl Fn(u32) -> Column) -> Brought {
        let emitter = &Emitter::new(self.model, emitter);
        let (tolerance, rule) = match self.correction {
            Correction::Tolerance(refinement) => (refinement.tolerance, refinement.rule),
            // Nothing comes through portals here: pixels are followed.
            Correction::Pixel => (1.0, FactorRule::for_tolerance(1e-2)),
        };
        let bound = self.portals.specular.as_ref().map_or(0.0, |specular| specular.bound);
        self.tracer.legs_max = LEGS;
        let effort = EFFORT * (0.01 / tolerance).max(1.0);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        let effort = (effort as u64).min(LEGS / 2);
        let is_portal = |&(patch, _): &(u32, f64)| {
            let optics = self.tracer.optics.get(patch as usize);
            optics.is_some_and(Optics::is_portal)
        };
        let seen = self.row.iter().copied().filter(is_portal);
        let mut casts = Casts::new(emitter, &self.tracer, seen, RAYS);
        self.motions.begin();
        self.ledger.clear();
        let mut is_by_rays = false;
        let permitted = loop {
            let (tracer, motions) = (&mut self.tracer, &mut self.motions);
            casts.cast(bound, self.cancel, tracer, motions, &mut self.ledger, &column);
            let factors = self.row.iter().map(|&(_, factor)| factor * factor).sum::<f64>();
            let seen = self.ledger.entries.values();
            let through: f64 = seen.map(|found| casts.share(found.weight).powi(2)).sum();
            let permitted = (PART * tolerance).powi(2) * (factors + through);
            // The next round takes as many legs as all before it.
            let is_over = 2 * self.tracer.legs >= effort || self.cancel.load(Ordering::Relaxed);
            let entries = self.ledger.sorted();
            if casts.rest(&entries, 0, 0.0) <= permitted {
                is_by_rays = true;
                break permitted;
            }
            let is_measured = casts.rest(&entries, PAIRS, HITS) <= permitted / 2.0;
            if is_over || casts.count >= RAYS_MAX || is_measured && !is_cheaper(&casts, &entries, permitted) {
                break permitted;
            }
        };
        // What is handed on first is known from closed forms: rays only divide it.
        let sent = self.sent();
        let scale = if self.ledger.sent > 0 {
            sent / casts.share(self.ledger.sent)
        } else {
            1.0
        };
        let Ledger {
            escaped,
            blocked,
            unselected,
            cut_off,
            ..
        } = self.ledger;
        let each = casts.mean_each(self.ledger.entries.values());
        let lost = [escaped, blocked, unselected].map(|lost| {
            let lost = casts.share(lost);
            (lost * scale, casts.variance_of_share(lost, each) * scale * scale)
        });
        let mut cut_off = casts.share(cut_off) * scale;
        if self.ledger.sent == 0 {
            // No ray found a portal that the row sees.
            cut_off += sent;
        }
        let most = if is_by_rays { 0 } else { PAIRS };
        let limits = Limits {
            permitted,
            most,
            until: self.tracer.legs.saturating_add(effort),
        };
        // A segment is followed to its end.
        self.tracer.legs_max = u64::MAX;
        let known = self.measure(&casts, limits, rule, scale);
        closed(sent, &known, lost, cut_off)
    }

    /// Arrivals at each patch under each motion: by segments and closed forms for the largest, by rays otherwise.
    fn measure(&mut self, casts: &Casts<'_>, limits: Limits, rule: FactorRule, scale: f64) -> Vec<Known> {
        let Limits { permitted, most, until } = limits;
        let entries = self.ledger.sorted();
        let entries = self.by_size(casts.emitter, entries);
        let looks = LOOKS * most;
        let part = |found: &Found| casts.share(found.weight).powf(0.8);
        let parts = entries.iter().take(looks).map(|(_, found)| part(found)).sum();
        let mut effort = Effort {
            permitted,
            until,
            left: parts,
            parts,
        };
        let emitter = casts.emitter;
        let mut measured = 0;
        let mut known = Vec::with_capacity(entries.len());
        for (place, ((motion, patch), found)) in entries.into_iter().enumerate() {
            let mut entry = Known {
                patch,
                factor: casts.share(found.weight) * scale,
                handed_on: found.passed as f64 / found.weight.max(1) as f64,
                variance: casts.variance(&found) * scale * scale,
            };
            let is_left = measured < most && place < looks && self.tracer.legs < until;
            if is_left && motion != OTHER && !self.cancel.load(Ordering::Relaxed) {
                let own = self.motions.get(motion).inverse().triangle(emitter.corners);
                let whole = exchange(&own, &self.model.normalised_corners(patch), &rule) / emitter.area;
                if whole * casts.count as f64 >= HITS {
                    measured += 1;
                    let (wanted, until) = effort.of(part(&found), self.tracer.legs);
                    let through = Through {
                        emitter,
                        motion,
                        patch,
                        least: SEGMENTS.0,
                        most: SEGMENTS.1,
                        until,
                        bound: self.portals.specular.as_ref().map_or(0.0, |specular| specular.bound),
                    };
                    let share = through.measure(wanted / whole, &mut self.tracer, &mut self.motions);
                    entry.measure(whole, share, casts, &found);
                }
            }
            known.push(entry);
        }
        known
    }

    /// Pairs found, the largest first by what centroids exchange with nothing in between: an order that does not
    /// depend on the number of hits.
    fn by_size(&self, emitter: &Emitter<'_>, entries: Vec<Entry>) -> Vec<Entry> {
        let own = crate::geometry::centroid(&emitter.corners);
        let normal = crate::geometry::cross(&emitter.corners);
        let size = |&((motion, patch), _): &Entry| {
            if motion == OTHER {
                return 0.0;
            }
            let image = self.motions.get(motion).triangle(self.model.normalised_corners(patch));
            let between = crate::geometry::centroid(&image) - own;
            let facing = -crate::geometry::cross(&image).dot(between);
            normal.dot(between).max(0.0) * facing.max(0.0) / between.length_squared().powi(2).max(f64::MIN_POSITIVE)
        };
        let mut sized: Vec<(f64, Entry)> = entries.into_iter().map(|entry| (size(&entry), entry)).collect();
        sized.sort_by(|(a, (one, _)), (b, (other, _))| b.total_cmp(a).then(one.cmp(other)));
        sized.into_iter().map(|(_, entry)| entry).collect()
    }

    /// Enters arrivals through portals into the row's weights, shares and error.
    fn enter(&self, row: &mut FinishedRow, brought: &Brought, passage: &mut Passage) {
        let whole = u64::from(row.hemicubes.max(1)) * HEMICUBE_WEIGHT;
        let sent = self.sent();
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of the whole"
        )]
        let sent_weight = if self.correction == Correction::Pixel {
            self.ledger.sent / FINE
        } else {
            (sent * whole as f64).round() as u64
        };
        let sent_weight = sent_weight.min(row.sums.visible);
        let [kept, escaped, blocked, unselected, cut_off] = apportion(sent_weight, self.ledger.ends());
        let sums = &mut row.sums;
        sums.visible = sums.visible - sent_weight + kept;
        sums.escaped += escaped;
        sums.blocked += blocked;
        sums.unselected += unselected + cut_off;
        let [by_sky, by_backs, by_others, cut] = brought.lost;
        passage.passed = brought.passed;
        passage.cut_off += cut;
        if self.correction == Correction::Pixel {
            row.shares = RowShares::of_hemicubes(sums, row.hemicubes);
            return;
        }
        row.shares.escaped += by_sky;
        row.shares.blocked += by_backs;
        row.shares.unselected += by_others + cut;
        // An error that is not known stays NaN.
        let mut errors = row.errors.to_array();
        for (error, variance) in errors.iter_mut().zip(brought.variances) {
            #[allow(clippy::cast_possible_truncation, reason = "an estimate")]
            let with_brought = (f64::from(*error).powi(2) + variance).sqrt() as f32;
            *error = with_brought;
        }
        row.errors = RowErrors::from_array(errors);
    }

    /// Writes the row with the columns of images added into the cell's.
    fn write(&mut self, row: &mut FinishedRow) {
        if let Some(images) = &self.portals.images {
            self.row.retain_mut(|(patch, _)| {
                let folded = images.fold(*patch);
                *patch = folded.unwrap_or(*patch);
                folded.is_some()
            });
        }
        // Stable: sums of equal columns are in the order of images and motions.
        self.row.sort_by_key(|&(patch, _)| patch);
        row.clear();
        for group in self.row.chunk_by(|a, b| a.0 == b.0) {
            row.push(group[0].0, group.iter().map(|&(_, factor)| factor).sum());
        }
    }
}

/// The place of a patch of the model.
fn column(portals: &Portals, patch: u32, receives: impl Fn(u32) -> bool) -> Column {
    match &portals.images {
        Some(images) if images.fold(patch).is_none() => Column::CutOff,
        _ if receives(patch) => Column::Of,
        _ => Column::None,
    }
}

/// The share of its weight at which a path ends.
fn bound(portals: &Portals) -> f64 {
    portals.specular.as_ref().map_or(0.0, |specular| specular.bound)
}

/// A row's hemicubes, and how their pixels are followed.
#[derive(Clone, Copy)]
pub(super) struct RowPixels<'r> {
    pub(super) hemicubes: &'r [Hemicube],
    /// Item buffers; empty if they are still to be drawn.
    pub(super) items: &'r [Items],
    pub(super) table: &'r DeltaTable,
    /// The share of its weight at which a path ends.
    pub(super) bound: f64,
    pub(super) cancel: &'r AtomicBool,
}

/// Follows a row's pixels for N bands. `portals` are those that the row may see. Returns false where each band is to be
/// followed alone.
///
/// # Errors
/// When the backend hands out no item buffers, or does not draw a pass.
pub(super) fn follow_row<const N: usize>(
    passes: &mut Passes<N>,
    row: RowPixels<'_>,
    portals: &[u32],
    surfaces: [Surfaces<'_>; N],
    taker: &mut Taker<'_, N, impl Fn(u32) -> Column>,
    session: &mut dyn HemicubeBackend,
) -> Result<bool, BackendError> {
    passes.begin_row();
    passes.legs_max = LEGS_OF_PIXELS * row.hemicubes.len().max(1) as u64;
    for (place, hemicube) in row.hemicubes.iter().enumerate() {
        let drawn;
        let items = match row.items.get(place) {
            Some(items) => items,
            None => {
                drawn = session.items(hemicube)?;
                &drawn
            }
        };
        let view = PixelView {
            hemicube,
            items,
            table: row.table,
            fine: FINE,
            bound: row.bound,
            cancel: Some(row.cancel),
        };
        if !passes.follow(&view, portals, surfaces, taker, Some(&mut *session))? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Returns whether as many more rays as keep the permitted error cost less than measuring pairs by segments.
fn is_cheaper(casts: &Casts<'_>, entries: &[((MotionId, u32), Found)], permitted: f64) -> bool {
    let cast = casts.rays();
    let over = casts.rest(entries, 0, 0.0) / permitted;
    // The variance falls as n^(−5/4): by roots, n = over^(3/4) is a little less, and is asked again when they are cast.
    let wanted = cast as f64 * over.sqrt() * over.sqrt().sqrt();
    let pairs = entries
        .iter()
        .take(PAIRS)
        .filter(|(_, found)| f64::from(found.hits) >= HITS);
    wanted <= (pairs.count() * SEGMENTS.0) as f64
}

/// The error and the legs that a row's pairs share. Segments err by c n^(−3/4), c as a pair's factor: fewest leave it
/// c^(4/5) of the squared error, and take as much of the legs. Those that it does not need are its successors', or the
/// first walls seen in part through a pane would take all.
struct Effort {
    permitted: f64,
    until: u64,
    /// Σ c^(4/5), and what of it is not begun.
    parts: f64,
    left: f64,
}

impl Effort {
    /// The error wanted of a pair with that part, and the legs at which it ends; `legs` are traced.
    fn of(&mut self, part: f64, legs: u64) -> (f64, u64) {
        let share = if self.left > part { part / self.left } else { 1.0 };
        self.left -= part;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of legs")]
        let own = (self.until.saturating_sub(legs) as f64 * share) as u64;
        let wanted = (0.5 * self.permitted * part / self.parts.max(f64::MIN_POSITIVE)).sqrt();
        (wanted, legs + own)
    }
}

/// Bounds of what a row's arrivals by segments may cost.
struct Limits {
    /// Squared error that they may leave.
    permitted: f64,
    /// Number of pairs.
    most: usize,
    /// Legs of the tracer at which they end.
    until: u64,
}

/// Arrivals at a patch under a motion.
#[derive(Clone, Copy, Debug)]
struct Known {
    patch: u32,
    factor: f64,
    /// The part of it handed on.
    handed_on: f64,
    variance: f64,
}

impl Known {
    /// The part of it that stays. Weights are divided in whole numbers, by which panes that absorb nothing keep some 10⁻¹².
    fn kept(&self) -> f64 {
        let kept = 1.0 - self.handed_on;
        if kept > 1e-6 { kept } else { 0.0 }
    }

    /// Takes a share measured by segments, if it says more than rays do. It is a pair that rays found: of P = 1 −
    /// e^(−n) of such pairs, with n hits expected. Each stands for 1 / P of them (Horvitz & Thompson 1952), or what
    /// rays happen to miss would be lost, and what they know alone would be moved for it.
    fn measure(&mut self, whole: f64, share: Option<Share>, casts: &Casts<'_>, found: &Found) {
        let Some(share) = share else { return };
        let (factor, error) = (whole * share.share, whole * share.error);
        let hits = casts.hits(factor, found);
        // Segments to a patch all but touched say less than rays. By the hits expected: by those counted, pairs hit too
        // seldom would stay as they are.
        if factor <= 0.0 || error * error > casts.variance_at(hits, found) {
            return;
        }
        let is_found = -(-hits).exp_m1();
        self.factor = factor / is_found;
        self.handed_on = share.passed;
        self.variance = error * error + factor * factor * (1.0 - is_found) / is_found;
    }
}

/// Closes what a row's portals hand on: kept, lost and cut off are `sent` together, as what a row sees directly is 1.
/// `lost` are escaped, blocked and unselected with their variances.
///
/// A share of the variance v is known to v (1 − v / V) afterwards, V = Σ v, and so is a sum of shares. Where they lack
/// more than √V, they err together, and V is the square of what they lack. What portals hand on further is not kept: it
/// counts once for each time.
fn closed(sent: f64, known: &[Known], lost: [(f64, f64); 3], cut_off: f64) -> Brought {
    let of_known = |entry: &Known| (entry.factor * entry.kept(), entry.variance * entry.kept().powi(2));
    let all = || known.iter().map(of_known).chain(lost);
    let sum = sent - cut_off - all().map(|(value, _)| value).sum::<f64>();
    let shares = all().map(|(value, variance)| Uncertain {
        value,
        ceiling: value + sum.abs(),
        variance,
    });
    let mut shares: Vec<Uncertain> = shares.collect();
    project(&mut shares, Lacking { sum, error: 0.0 }, f64::INFINITY);
    let variance: f64 = shares.iter().map(|share| share.variance).sum();
    let (together, unknown) = if variance > 0.0 {
        ((sum * sum / variance).max(1.0), 0.0)
    } else {
        (1.0, sum * sum)
    };
    let left = |own: f64| together * own * (1.0 - own / variance.max(f64::MIN_POSITIVE));
    let (kept, lost) = shares.split_at(known.len());
    let mut brought = Brought {
        lost: [lost[0].value, lost[1].value, lost[2].value, cut_off],
        passed: sent,
        ..Brought::default()
    };
    let of_kept = left(kept.iter().map(|share| share.variance).sum());
    brought.variances = [unknown, unknown + of_kept, left(lost[0].variance)];
    for (entry, kept) in known.iter().zip(kept) {
        let factor = if entry.kept() > 0.0 {
            kept.value / entry.kept()
        } else {
            entry.factor
        };
        brought.passed += factor * entry.handed_on;
        let further = together * (entry.variance - kept.variance);
        brought.variances[0] += left(kept.variance) + further;
        brought.variances[1] += further;
        brought.factors.push((entry.patch, factor));
    }
    brought
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known(factor: f64, handed_on: f64, error: f64) -> Known {
        Known {
            patch: 0,
            factor,
            handed_on,
            variance: error * error,
        }
    }

    fn kept_and_lost(brought: &Brought, known: &[Known]) -> f64 {
        let factors = brought.factors.iter().zip(known);
        let kept: f64 = factors.map(|(&(_, factor), entry)| factor * entry.kept()).sum();
        kept + brought.lost.iter().sum::<f64>()
    }

    #[test]
    fn what_portals_hand_on_is_kept_lost_or_cut_off() {
        let known = [
            known(0.2, 0.0, 0.01),
            known(0.1, 0.5, 0.02),
            known(0.3, 1.0, 0.01),
            known(0.1, 0.0, 0.0),
            known(0.1, 1.0 - 1e-12, 3e-9),
        ];
        for sent in [0.2, 0.47, 0.5, 0.9] {
            let brought = closed(sent, &known, [(0.1, 1e-4), (0.0, 0.0), (0.01, 1e-6)], 0.02);
            assert!(
                (kept_and_lost(&brought, &known) - sent).abs() < 1e-9,
                "{sent}: {brought:?}"
            );
            assert_eq!(brought.lost[1], 0.0, "nothing stays nothing");
            let factors = [2, 3, 4].map(|k: usize| brought.factors[k].1);
            assert_eq!(factors, [0.3, 0.1, 0.1], "what is exact or hands on all");
        }
    }

    #[test]
    fn what_lacks_more_than_its_errors_says_that_they_are_larger() {
        let known = [known(0.2, 0.0, 1e-3), known(0.1, 0.0, 1e-3)];
        let error = |sent: f64| closed(sent, &known, [(0.1, 1e-6), (0.0, 0.0), (0.0, 0.0)], 0.0).variances[0].sqrt();
        let usual = error(0.4);
        assert!((usual - 1e-3 * (4.0f64 / 3.0).sqrt()).abs() < 1e-9, "{usual}");
        assert_eq!(error(0.401), usual, "within their errors");
        assert!(
            (error(0.41) / usual - 0.01 / 3e-6f64.sqrt()).abs() < 1e-6,
            "{}",
            error(0.41)
        );
    }

    #[test]
    fn what_nothing_is_lost_of_is_known_in_sum() {
        let known = [known(0.2, 0.0, 1e-3), known(0.1, 0.0, 1e-3)];
        let brought = closed(0.3, &known, [(0.0, 0.0); 3], 0.0);
        assert!(
            brought.variances[0] > 0.0 && brought.variances[1].abs() < 1e-15,
            "{brought:?}"
        );
    }
}
