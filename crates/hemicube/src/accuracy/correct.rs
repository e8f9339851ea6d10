//! From weights to form factors: the rungs of the accuracy ladder.
//!
//! - *pixel*: F_ij = Σ visible weight. Aliasing falls with the resolution; that the emitter is a point does not.
//! - *point*: F_ij = visible fraction × the closed form from the hemicube's centre.
//! - *area*: F_ij = visible fraction × the closed form from the whole emitter, as symmetric as visibility allows. The
//!   few pairs that one point is most wrong about are looked at by rays: patches that all but touch, seen or not, and
//!   large ones that are partly seen.
//! - *tolerance*: the area rung, with the visible fraction of all pairs whose penumbra matters measured by rays in the
//!   shaft between the two patches ([`Refinement`]).
//!
//! The *visible fraction* is what a patch shows over what it would cover alone, by the same rasteriser. With K
//! hemicubes a patch, fractions are averaged with the closed form from each centre as weight, for that is the share
//! that each part of the emitter has in the whole.

use crate::Model;
use crate::accuracy::grain::Grain;
use crate::accuracy::lost::{self, Lost};
use crate::accuracy::refine::{Mended, Refined, Refiner};
pub use crate::accuracy::refine::{PriorVariances, Refinement};
use crate::backend::{Hemicube, WHOLE};
use crate::bvh::Tree;
use crate::factor::{Exchanges, FactorRule, PointFactors};
use crate::geometry::area;
use crate::row::RowView;
use crate::store::{RowShares, RowSums};
use crate::visibility::coplanar::CoplanarRegions;
use hemicube_scene::InputPatch;
use std::sync::atomic::{AtomicBool, Ordering};

/// A rung of the accuracy ladder.
///
/// Two unit squares that face each other at unit distance exchange 0.19982 of what leaves them:
///
/// ```
/// # use hemicube::driver::compute::{Execution, compute};
/// # use hemicube::store::Part;
/// # use hemicube::InputPatch;
/// # use hemicube_backend_cpu::CpuBackend;
/// use hemicube::accuracy::correct::Correction;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model_of(&room::squares())?;
/// # let exchanged = |correction: Correction| -> room::Result<f64> {
/// #     let (plan, mut parts) = (room::plan(&model, correction), Vec::<Part>::new());
/// #     let backend = Box::new(CpuBackend::new());
/// #     compute(&model, &plan, room::RENDER, backend, Execution::default(), &mut parts, &mut |_| {})?;
/// #     let rows_of = |part: &Part| (0..part.rows.len()).map(|row| (part.rows[row], part.row(row).1.to_vec())).collect();
/// #     let rows = parts.iter().flat_map::<Vec<_>, _>(rows_of);
/// #     let of = |(patch, factors): (u32, Vec<f32>)| {
/// #         model.patches().area(InputPatch(patch)) * factors.iter().map(|&f| f64::from(f)).sum::<f64>()
/// #     };
/// #     Ok(0.5 * rows.map(of).sum::<f64>())
/// # };
///
/// // `exchanged` computes the squares' rows, eight patches each, and adds them up.
/// let error = |found: f64| (found / 0.199_825 - 1.0).abs();
/// let (pixel, area) = (error(exchanged(Correction::Pixel)?), error(exchanged(Correction::area())?));
/// assert!(area < 1e-3, "where nothing is hidden, only the closed form is left: {area}");
/// assert!(pixel > 5.0 * area, "from one point of a patch, another is seen larger or smaller: {pixel}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Correction {
    /// Sums of pixels.
    Pixel,
    /// Visible fraction × point-to-area closed form.
    Point,
    /// Visible fraction × area-to-area closed form, integrated by this rule; some fractions by rays.
    Area(FactorRule),
    /// The area rung with as many rays at partly visible pairs as the tolerance asks for.
    Tolerance(Refinement),
}

impl Correction {
    /// The area rung where no tolerance is asked for: a closed form that is right to some thousandths, as one hemicube
    /// leaves more than that to visibility.
    pub fn area() -> Self {
        Self::Area(FactorRule::for_tolerance(1e-2))
    }

    /// The name in settings and manifests.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Pixel => "pixel",
            Self::Point => "point",
            Self::Area(_) => "area",
            Self::Tolerance(_) => "tolerance",
        }
    }

    /// Builds now, and not with the first row, what a row of this looks things up in: a tree over the scene's surfaces
    /// and one over its walls. They are kept with the scene, so that asking again costs nothing.
    pub fn prepare(&self, model: &Model) {
        if matches!(self, Self::Area(_) | Self::Tolerance(_)) {
            Tree::of(model.geometry());
            CoplanarRegions::of(model);
        }
        if !matches!(self, Self::Pixel) {
            Grain::of(model.geometry());
        }
    }

    /// Returns whether much is known to escape from the scene, so that odd rows say little.
    pub(crate) fn is_in_the_open(&self) -> bool {
        matches!(self, Self::Tolerance(refinement) if refinement.open)
    }

    /// Returns whether rows must carry covered weights.
    pub fn needs_covered(&self) -> bool {
        !matches!(self, Self::Pixel)
    }
}

/// What a row's conversion came to.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Converted {
    pub(crate) sums: RowSums,
    /// What of the row is no form factor, refined with its form factors.
    pub(crate) shares: RowShares,
    /// Expected √Σ (F − true F)²; NaN where the rung does not estimate it.
    pub(crate) error: f32,
    /// Rays and points that fractions were measured with.
    pub(crate) rays: u64,
    /// Pairs of which a part only is visible, on rungs that know.
    pub(crate) partial: u64,
    /// True if the form factors and what was lost are so far from summing to 1 that the hemicubes cannot stand for the
    /// emitter.
    pub(crate) is_odd: bool,
    /// The share of the hemicubes that showed no receiving patch.
    pub(crate) lost: f64,
    /// True if its budget ended it before all was measured that was worth it.
    pub(crate) cut_short: bool,
}

/// Which of the attempts at a row it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Attempt {
    pub(crate) is_first: bool,
    pub(crate) is_last: bool,
    /// True if the emitter is so large that it has several hemicubes in any case ([`crate::accuracy::grain`]).
    pub(crate) is_large: bool,
}

/// Rows that sum so badly are odd: in the open, what one hemicube says of the sky is that far off now and then.
const ODD: f64 = 0.15;
/// Where nothing escapes, rows know better; but no better than hemicubes know what is blocked.
const ODD_IN_THE_CLOSED: f64 = 0.05;
const ODD_AT_LEAST: f64 = 0.01;

/// The share of backs and of patches without a column from which on rays are asked what is lost.
const BACKS: f64 = 0.1;

/// A visible fraction this near to 1 is 1: what is missing is rounding of weights, not an occluder.
const ALL_VISIBLE: f64 = 0.9999;

/// Converts the rows of one patch at a time. One a thread.
#[derive(Debug)]
pub(crate) struct Converter<'c> {
    correction: Correction,
    cancel: Option<&'c AtomicBool>,
    /// What rays found lost of the last emitter that they were asked about.
    lost: Option<(InputPatch, Lost)>,
    /// (patch, sample, visible, covered) of all samples of the row.
    entries: Vec<(u32, u32, u32, u32)>,
    exchanges: Option<Exchanges>,
    /// Those of the row, with their visible fractions and A_i F_ij if all were visible.
    patches: Vec<u32>,
    fractions: Vec<f64>,
    values: Vec<f64>,
    points: PointFactors,
    refiner: Option<Refiner<'c>>,
}

impl<'c> Converter<'c> {
    /// When `cancel` becomes true, rows are left as they are.
    pub(crate) fn new(correction: Correction, cancel: Option<&'c AtomicBool>) -> Self {
        Self {
            correction,
            cancel,
            lost: None,
            entries: Vec::new(),
            exchanges: match correction {
                Correction::Area(rule) => Some(Exchanges::new(rule)),
                Correction::Pixel | Correction::Point | Correction::Tolerance(_) => None,
            },
            refiner: match correction {
                Correction::Tolerance(refinement) => Some(Refiner::new(refinement, cancel)),
                Correction::Area(rule) => Some(Refiner::new(Refinement::without_tolerance(rule), cancel)),
                Correction::Pixel | Correction::Point => None,
            },
            patches: Vec::new(),
            fractions: Vec::new(),
            values: Vec::new(),
            points: PointFactors::new(),
        }
    }

    /// Returns whether nobody wants further rows.
    pub(crate) fn is_cancelled(&self) -> bool {
        self.cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed))
    }

    /// Appends the columns and form factors of one row, and returns what it came to.
    ///
    /// `hemicubes` and `rows` are the emitter's samples; `receives` says whether a patch has a column. A row that is
    /// odd is left unfinished where another attempt follows, and is as good as this can be where it is the last.
    #[allow(clippy::too_many_arguments, reason = "called once, from the driver's inner loop")]
    pub(crate) fn convert<'r>(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        hemicubes: &[Hemicube],
        rows: impl Iterator<Item = RowView<'r>>,
        receives: impl Fn(u32) -> bool,
        attempt: Attempt,
        columns: &mut Vec<i32>,
        data: &mut Vec<f32>,
    ) -> Converted {
        let (mut error, mut rays, mut cut_short) = (f32::NAN, 0, false);
        let start = data.len();
        // By far the most rows of a large scene: no list of samples to sort and to group.
        let is_plain = hemicubes.len() == 1 && matches!(self.correction, Correction::Area(_));
        let sums = if is_plain {
            self.fractions_of_one(rows, &receives)
        } else {
            self.gather(rows, &receives)
        };
        if hemicubes.len() > 1 {
            self.entries.sort_unstable();
        }
        let seen = RowShares::of_hemicubes(&sums, u32::try_from(hemicubes.len()).unwrap_or(u32::MAX));
        let whole = f64::from(WHOLE) * hemicubes.len().max(1) as f64;
        let escaped_all = u64::from(WHOLE) * hemicubes.len() as u64;
        let lost = (sums.escaped + sums.blocked + sums.unselected) as f64 / whole;
        let bound = match self.correction {
            Correction::Pixel => f64::INFINITY,
            _ if sums.escaped > 0 => ODD,
            Correction::Tolerance(refinement) if refinement.open => ODD_IN_THE_CLOSED,
            Correction::Point | Correction::Area(_) => ODD_IN_THE_CLOSED,
            Correction::Tolerance(refinement) => refinement.tolerance.max(ODD_AT_LEAST),
        };
        let is_odd = |sum: f64| !hemicubes.is_empty() && (sum + lost - 1.0).abs() > bound;
        let mut odd = None;
        match self.correction {
            Correction::Pixel => self.pixel(hemicubes.len(), columns, data),
            Correction::Point => self.point(model, hemicubes, columns, data),
            Correction::Area(_) => {
                if !is_plain {
                    self.fractions(model, hemicubes);
                }
                let per_area = self.exchange(model, emitter);
                let shown = self.shown(per_area);
                // Where backs are seen, the points may lie in a solid and agree with each other: rays from all over the
                // patch know better what is lost; so they do where the points do not agree with the form factors.
                let backs = (sums.blocked + sums.unselected) as f64 / whole;
                let asks = backs > BACKS || is_odd(shown) || self.is_lost_known(emitter);
                let bound = if attempt.is_first {
                    ODD_IN_THE_CLOSED
                } else {
                    2.0 * ODD_IN_THE_CLOSED
                };
                let mut is_odd = asks && self.is_odd_by_rays(model, emitter, shown, bound, &receives);
                if (!is_odd || attempt.is_last) && sums.escaped < escaped_all {
                    let mended = self.mend(model, emitter, (hemicubes.len(), attempt.is_large), &receives);
                    rays = mended.rays + mended.points;
                    cut_short = mended.cut_short;
                    // What rays mend of it is not all that there is to mend.
                    let shown = self.shown(per_area);
                    if !asks && (shown + lost - 1.0).abs() > bound {
                        is_odd = self.is_odd_by_rays(model, emitter, shown, bound, &receives);
                    }
                }
                odd = Some(is_odd);
                if (!is_odd || attempt.is_last) && !attempt.is_large && sums.escaped < escaped_all {
                    let added = self.add_up(model, emitter, (seen, hemicubes.len()), USUAL_SUM, &receives);
                    rays += added.rays + added.points;
                }
                for ((&patch, &visible), &exchange) in self.patches.iter().zip(&self.fractions).zip(&self.values) {
                    push(columns, data, patch, visible * exchange * per_area);
                }
            }
            Correction::Tolerance(_) => {
                let care = attempt.is_last && !self.correction.is_in_the_open();
                let mut refined = self.tolerance(model, emitter, (hemicubes.len(), care, attempt.is_large), &receives);
                let is_each = self.refiner.as_ref().is_some_and(Refiner::measures_each);
                if !is_each && !attempt.is_large && sums.escaped < escaped_all {
                    let moves = attempt.is_last || !is_odd(self.factors());
                    let added = self.add_up_pairs(model, emitter, seen, moves, &receives);
                    refined.rays += added.rays;
                    refined.points += added.points;
                }
                for pair in self.refiner.iter().flat_map(|refiner| &refiner.pairs) {
                    push(columns, data, pair.patch, pair.fraction * pair.open);
                }
                #[allow(clippy::cast_possible_truncation, reason = "an estimate")]
                let estimate = refined.squared_error.sqrt() as f32;
                (error, rays, cut_short) = (estimate, refined.rays + refined.points, refined.cut_short);
            }
        }
        let partial = match self.correction {
            Correction::Pixel => 0,
            Correction::Point => {
                let groups = self.entries.chunk_by(|a, b| a.0 == b.0);
                groups
                    .filter(|group| group.iter().any(|e| fraction(e.2, e.3) < 1.0))
                    .count()
            }
            Correction::Area(_) => self.fractions.iter().filter(|&&fraction| fraction < 1.0).count(),
            Correction::Tolerance(_) => self.refiner.as_ref().map_or(0, |refiner| {
                let is_partial = |fraction: f64| fraction > 0.0 && fraction < 1.0;
                refiner.pairs.iter().filter(|pair| is_partial(pair.fraction)).count()
            }),
        };
        let is_left = odd.unwrap_or(false) && !attempt.is_last;
        let factors = sum(&data[start..]);
        let shares = match self.correction {
            Correction::Pixel => seen,
            Correction::Point => seen.refined(factors, error.into()),
            Correction::Area(_) | Correction::Tolerance(_) if is_left => seen,
            Correction::Area(_) => self.refined(model, emitter, seen, (factors, error, USUAL_SUM), &receives),
            Correction::Tolerance(refinement) => {
                let permitted = refinement.tolerance.min(USUAL_SUM);
                self.refined(model, emitter, seen, (factors, error, permitted), &receives)
            }
        };
        Converted {
            sums,
            shares,
            error,
            rays,
            partial: partial as u64,
            is_odd: odd.unwrap_or_else(|| is_odd(factors)),
            lost,
            cut_short,
        }
    }

    /// What of a row is no form factor, as right as its form factors, which sum to `factors`, have this error and may
    /// have their sum `permitted` off.
    fn refined(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        seen: RowShares,
        (factors, error, permitted): (f64, f32, f64),
        receives: impl Fn(u32) -> bool,
    ) -> RowShares {
        if !self.asks(emitter, seen, factors, permitted) {
            return seen.refined(factors, error.into());
        }
        self.lost(model, emitter, permitted, receives)
            .map_or(seen.refined(factors, error.into()), |found| {
                found.shares.refined_within(factors, found.errors(), ASKED * permitted)
            })
    }

    /// Returns whether form factors that sum to this, and what rays find lost, are farther off 1 than `bound`.
    fn is_odd_by_rays(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        factors: f64,
        bound: f64,
        receives: impl Fn(u32) -> bool,
    ) -> bool {
        let found = self.lost(model, emitter, USUAL_SUM, receives);
        found.is_some_and(|found| (factors + found.shares.lost() - 1.0).abs() > bound)
    }

    /// Returns whether rays were asked what this patch loses.
    fn is_lost_known(&self, emitter: InputPatch) -> bool {
        self.lost.is_some_and(|(patch, _)| patch == emitter)
    }

    /// What rays find lost; `None` for a patch without area.
    fn lost(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        permitted: f64,
        receives: impl Fn(u32) -> bool,
    ) -> Option<Lost> {
        if self.lost.is_none_or(|(patch, _)| patch != emitter) {
            self.lost = lost::measure(model, emitter, permitted, receives).map(|found| (emitter, found));
        }
        self.lost.map(|(_, found)| found)
    }

    /// Lists the entries of an emitter's samples; returns where their weight went.
    fn gather<'r>(&mut self, rows: impl Iterator<Item = RowView<'r>>, receives: &impl Fn(u32) -> bool) -> RowSums {
        let mut sums = RowSums::default();
        self.entries.clear();
        for (sample, row) in (0u32..).zip(rows) {
            sums.escaped += u64::from(row.escaped);
            sums.blocked += u64::from(row.blocked);
            for ((&patch, &visible), &covered) in row.patches.iter().zip(row.visible).zip(row.covered) {
                if receives(patch) {
                    sums.visible += u64::from(visible);
                    self.entries.push((patch, sample, visible, covered));
                } else {
                    sums.unselected += u64::from(visible);
                }
            }
        }
        sums
    }

    fn pixel(&self, samples: usize, columns: &mut Vec<i32>, data: &mut Vec<f32>) {
        let scale = 1.0 / (f64::from(WHOLE) * samples.max(1) as f64);
        for group in self.entries.chunk_by(|a, b| a.0 == b.0) {
            let weight: u64 = group.iter().map(|e| u64::from(e.2)).sum();
            push(columns, data, group[0].0, weight as f64 * scale);
        }
    }

    fn point(&mut self, model: &Model, hemicubes: &[Hemicube], columns: &mut Vec<i32>, data: &mut Vec<f32>) {
        let scale = 1.0 / hemicubes.len().max(1) as f64;
        let pairs = self.entries.iter().map(|e| {
            let hemicube = &hemicubes[e.1 as usize];
            (hemicube.origin, hemicube.axes[2], model.normalised_corners(e.0))
        });
        let mut factors = self.points.pairs(pairs);
        for group in self.entries.chunk_by(|a, b| a.0 == b.0) {
            let (of_group, rest) = factors.split_at(group.len());
            let sum: f64 = group.iter().zip(of_group).map(|(e, f)| fraction(e.2, e.3) * f).sum();
            push(columns, data, group[0].0, sum * scale);
            factors = rest;
        }
    }

    /// Lists the patches of a row of one sample, and their visible fractions; returns where its weight went.
    fn fractions_of_one<'r>(
        &mut self,
        rows: impl Iterator<Item = RowView<'r>>,
        receives: &impl Fn(u32) -> bool,
    ) -> RowSums {
        let mut sums = RowSums::default();
        self.patches.clear();
        self.fractions.clear();
        for row in rows {
            sums.escaped += u64::from(row.escaped);
            sums.blocked += u64::from(row.blocked);
            self.patches.reserve(row.patches.len());
            self.fractions.reserve(row.patches.len());
            for ((&patch, &visible), &covered) in row.patches.iter().zip(row.visible).zip(row.covered) {
                if receives(patch) {
                    sums.visible += u64::from(visible);
                    self.patches.push(patch);
                    self.fractions.push(fraction(visible, covered));
                } else {
                    sums.unselected += u64::from(visible);
                }
            }
        }
        sums
    }

    /// Lists the patches of all samples, and their visible fractions.
    fn fractions(&mut self, model: &Model, hemicubes: &[Hemicube]) {
        self.patches.clear();
        self.fractions.clear();
        for group in self.entries.chunk_by(|a, b| a.0 == b.0) {
            let all = group.len() == hemicubes.len() && group.iter().all(|e| fraction(e.2, e.3) == 1.0);
            let visible = if all {
                1.0
            } else {
                let centers = hemicubes.iter().map(|h| (h.origin, h.axes[2]));
                let factors = self.points.evaluate(centers, &model.normalised_corners(group[0].0));
                let whole: f64 = factors.iter().sum();
                let seen: f64 = group.iter().map(|e| fraction(e.2, e.3) * factors[e.1 as usize]).sum();
                if whole > 0.0 { seen / whole } else { 0.0 }
            };
            self.patches.push(group[0].0);
            self.fractions.push(visible);
        }
    }

    /// A_i F_ij of the listed patches if all were visible; returns 1 / A_i.
    fn exchange(&mut self, model: &Model, emitter: InputPatch) -> f64 {
        let own = model.normalised_corners(emitter.0);
        self.values.clear();
        self.values.resize(self.patches.len(), 0.0);
        if let Some(exchanges) = &mut self.exchanges {
            exchanges.begin(&own);
            exchanges.row(model, &self.patches, &mut self.values);
        }
        2.0 / (own[1] - own[0]).cross(own[2] - own[0]).length()
    }

    /// Σ F of the listed patches.
    fn shown(&self, per_area: f64) -> f64 {
        let shown = self.fractions.iter().zip(&self.values);
        per_area * shown.map(|(visible, exchange)| visible * exchange).sum::<f64>()
    }

    fn mend(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        (samples, is_large): (usize, bool),
        receives: impl Fn(u32) -> bool,
    ) -> Refined {
        let row = Mended {
            patches: &mut self.patches,
            fractions: &mut self.fractions,
            exchanges: &mut self.values,
            samples,
            is_large,
        };
        let refiner = self.refiner.as_mut();
        refiner.map_or_else(Refined::default, |refiner| refiner.mend(model, emitter, row, receives))
    }

    fn tolerance(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        (samples, care, is_large): (usize, bool, bool),
        receives: impl Fn(u32) -> bool,
    ) -> Refined {
        let Some(refiner) = &mut self.refiner else {
            return Refined::default();
        };
        let share = 1.0 / samples.max(1) as f64;
        let seen = self.entries.chunk_by(|a, b| a.0 == b.0).map(|group| {
            let sum: f64 = group.iter().map(|e| fraction(e.2, e.3)).sum();
            (
                group[0].0,
                if group.len() == samples {
                    share * sum
                } else {
                    (share * sum).min(0.999)
                },
            )
        });
        let usual = refiner.with_care(care);
        let refined = refiner.row(model, emitter, seen, is_large, receives);
        refiner.set(usual);
        refined
    }

    /// Σ F of the refiner's row.
    fn factors(&self) -> f64 {
        let pairs = self.refiner.iter().flat_map(|refiner| &refiner.pairs);
        pairs.map(|pair| pair.fraction * pair.open).sum()
    }

    /// Brings the refiner's row nearer to what it is known to sum to, if it is off by more than is permitted: by pairs
    /// that it lacks, and if it `moves`, by those that are uncertain.
    fn add_up_pairs(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        seen: RowShares,
        moves: bool,
        receives: impl Fn(u32) -> bool,
    ) -> Refined {
        let permitted = match self.correction {
            Correction::Tolerance(refinement) => refinement.tolerance.min(USUAL_SUM),
            _ => USUAL_SUM,
        };
        let mut refined = Refined::default();
        let Some(lacking) = self.lacking(model, emitter, (seen, self.factors()), permitted, &receives) else {
            return refined;
        };
        let Some(refiner) = &mut self.refiner else {
            return refined;
        };
        if lacking.0 > SURELY * lacking.1 {
            let mut known: Vec<u32> = refiner
                .pairs
                .iter()
                .filter(|p| p.fraction > 0.0)
                .map(|p| p.patch)
                .collect();
            known.sort_unstable();
            let is_known = |patch| !receives(patch) || known.binary_search(&patch).is_ok();
            refined = refiner.find_unseen(model, emitter, lacking.0, is_known);
            refiner.take_unseen();
        }
        let left = self.lacking(model, emitter, (seen, self.factors()), permitted, &receives);
        if let (true, Some(lacking), Some(refiner)) = (moves, left, &mut self.refiner) {
            refiner.move_pairs(model, emitter, lacking);
        }
        refined
    }

    /// Likewise for the row in `patches`, `fractions` and `values`.
    fn add_up(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        (seen, samples): (RowShares, usize),
        permitted: f64,
        receives: impl Fn(u32) -> bool,
    ) -> Refined {
        let per_area = 1.0 / area(&model.normalised_corners(emitter.0));
        let mut refined = Refined::default();
        let Some(lacking) = self.lacking(model, emitter, (seen, self.shown(per_area)), permitted, &receives) else {
            return refined;
        };
        if let (true, Some(refiner)) = (lacking.0 > SURELY * lacking.1, &mut self.refiner) {
            let (patches, fractions) = (&self.patches, &self.fractions);
            let is_known =
                |patch| !receives(patch) || patches.binary_search(&patch).is_ok_and(|place| fractions[place] > 0.0);
            refined = refiner.find_unseen(model, emitter, lacking.0, is_known);
            let mut row = Mended {
                patches: &mut self.patches,
                fractions: &mut self.fractions,
                exchanges: &mut self.values,
                samples,
                is_large: false,
            };
            row.insert(&refiner.unseen);
        }
        let left = self.lacking(model, emitter, (seen, self.shown(per_area)), permitted, &receives);
        if let (Some(lacking), Some(refiner)) = (left, &mut self.refiner) {
            let row = Mended {
                patches: &mut self.patches,
                fractions: &mut self.fractions,
                exchanges: &mut self.values,
                samples,
                is_large: false,
            };
            refiner.move_fractions(model, emitter, row, lacking);
        }
        refined
    }

    /// What form factors that sum to `factors` lack of what they are known to sum to, negative if they have too much,
    /// and the standard error of that; `None` where it is no more than is permitted.
    fn lacking(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        (seen, factors): (RowShares, f64),
        permitted: f64,
        receives: impl Fn(u32) -> bool,
    ) -> Option<(f64, f64)> {
        if !self.asks(emitter, seen, factors, permitted) {
            return None;
        }
        let found = self.lost(model, emitter, permitted, receives)?;
        let lacking = 1.0 - factors - found.shares.lost();
        (lacking.abs() > ASKED * permitted).then(|| (lacking, found.error()))
    }

    /// Returns whether rays are to say what a row loses whose form factors sum to `factors`.
    fn asks(&self, emitter: InputPatch, seen: RowShares, factors: f64, permitted: f64) -> bool {
        let residual = (1.0 - factors - seen.lost()).abs();
        // Of a row in which only the sky is lost, the sum of the form factors says what the sky has.
        let is_sky = seen.escaped > 0.0 && seen.blocked == 0.0 && seen.unselected == 0.0;
        let is_off = residual > ASKED * permitted * if is_sky { SURE } else { 1.0 };
        is_off || factors > 1.0 + ASKED * permitted || self.is_lost_known(emitter)
    }
}

/// Number of standard errors of the lost share that a row must lack before pairs are looked for.
const SURELY: f64 = 2.0;

/// The part of the error that a row's sum may have from which on rays are asked what is lost.
const ASKED: f64 = 0.75;
/// Factor on that part where only the sky is lost.
const SURE: f64 = 4.0;
/// What the sum of a row may be off by where no tolerance is asked for.
const USUAL_SUM: f64 = 0.02;

/// What a patch shows of what it would cover alone. Nothing covered is a patch too small for a pixel, seen at its
/// centroid.
pub(crate) fn fraction(visible: u32, covered: u32) -> f64 {
    if covered == 0 {
        return 1.0;
    }
    let fraction = f64::from(visible) / f64::from(covered);
    if fraction >= ALL_VISIBLE { 1.0 } else { fraction }
}

/// In eight sums, so that none waits for the one before.
fn sum(values: &[f32]) -> f64 {
    let mut sums = [0.0; 8];
    let chunks = values.chunks_exact(sums.len());
    let rest: f64 = chunks.remainder().iter().map(|&value| f64::from(value)).sum();
    for chunk in chunks {
        for (sum, &value) in sums.iter_mut().zip(chunk) {
            *sum += f64::from(value);
        }
    }
    sums.iter().sum::<f64>() + rest
}

fn push(columns: &mut Vec<i32>, data: &mut Vec<f32>, patch: u32, value: f64) {
    #[allow(clippy::cast_possible_truncation, reason = "rounding to the store's f32 is wanted")]
    let value = value as f32;
    if value > 0.0 {
        columns.push(patch.cast_signed());
        data.push(value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions() {
        assert_eq!(fraction(0, 0), 1.0, "a tiny patch is seen");
        assert_eq!(fraction(5, 10), 0.5);
        assert_eq!(fraction(99_999, 100_000), 1.0);
        assert_eq!(fraction(0, 10), 0.0);
    }
}
