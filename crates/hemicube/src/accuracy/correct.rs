//! From weights to form factors, by the chosen accuracy level.
//!
//! - *pixel*: F_ij = Σ visible weight. Aliasing falls with the resolution; the error of a point emitter does not.
//! - *tolerance*: F_ij = visible fraction × the closed form from the whole emitter. Rays measure the fractions of all
//!   pairs whose penumbra matters ([`Refinement`]).
//!
//! The *visible fraction* is a patch's visible weight over the weight it would cover alone, by the same rasteriser.
//! Over K hemicubes of a patch, fractions are averaged with the closed form from each centre as weight: the share of
//! that part of the emitter in the whole.

use crate::Model;
use crate::accuracy::caster::Caster;
use crate::accuracy::closing::Lacking;
pub use crate::accuracy::error_model::PriorVariances;
use crate::accuracy::grain::Grain;
use crate::accuracy::ray_shares::{self, NONE_MET, RayShares};
pub use crate::accuracy::refine::Refinement;
use crate::accuracy::refine::{Pair, Refined, Refiner, insert, sees, sum_of};
use crate::accuracy::row::Emitter;
use crate::backend::{BackendError, Hemicube, WHOLE};
use crate::bvh::Tree;
use crate::factor::PointFactors;
use crate::row::RowView;
use crate::store::{ERRORS, FinishedRow, Precision, RowErrors, RowShares, RowSums};
use crate::visibility::coplanar::CoplanarRegions;
use crate::visibility::spaces::Spaces;
use hemicube_scene::InputPatch;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

/// An accuracy level: how the weights of hemicubes become form factors.
///
/// Two unit squares that face each other at unit distance exchange 0.19982 of what leaves them:
///
/// ```
/// # use hemicube::driver::compute::{Execution, compute};
/// # use hemicube::store::Part;
/// # use hemicube::InputPatch;
/// # use hemicube_backend_cpu::CpuBackend;
/// use hemicube::accuracy::correct::{Correction, Refinement};
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model_of(&room::squares())?;
/// # let exchanged = |correction: Correction| -> room::Result<f64> {
/// #     let (plan, mut parts) = (room::plan(&model, correction), Vec::<Part>::new());
/// #     let backend = Box::new(CpuBackend::new());
/// #     compute(&model, &plan, room::RENDER, backend, Execution::default(), &mut parts, &mut |_| {})?;
/// #     let row_of = |part: &Part, row: usize| (part.rows[row], part.row(row).1.iter().sum::<f64>());
/// #     let rows_of = |part: &Part| (0..part.rows.len()).map(|row| row_of(part, row)).collect();
/// #     let rows = parts.iter().flat_map::<Vec<_>, _>(rows_of);
/// #     let of = |(patch, sum): (u32, f64)| model.patches().area(InputPatch(patch)) * sum;
/// #     Ok(0.5 * rows.map(of).sum::<f64>())
/// # };
///
/// // `exchanged` computes the squares' rows, eight patches each, and adds them up.
/// let error = |found: f64| (found / 0.199_825 - 1.0).abs();
/// let within = Correction::Tolerance(Refinement::for_tolerance(0.02));
/// let (pixel, whole) = (error(exchanged(Correction::Pixel)?), error(exchanged(within)?));
/// assert!(whole < 1e-3, "nothing is hidden: only the closed form is left: {whole}");
/// assert!(pixel > 5.0 * whole, "from one point of a patch, another is seen larger or smaller: {pixel}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(
    clippy::large_enum_variant,
    reason = "there is one of it in a run, and it stays `Copy` as what it holds"
)]
pub enum Correction {
    /// Sums of pixels.
    Pixel,
    /// Visible fraction × area-to-area closed form, with rays at the pairs that matter, in numbers by the tolerance.
    Tolerance(Refinement),
}

impl Correction {
    /// The name in settings and manifests.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Pixel => "pixel",
            Self::Tolerance(_) => "tolerance",
        }
    }

    /// Builds the lookup structures of a row now instead of with the first row: a tree over the scene's surfaces and
    /// one over its coplanar regions. They are cached with the scene.
    pub fn prepare(&self, model: &Model) {
        Spaces::of(model);
        if matches!(self, Self::Tolerance(_)) {
            Tree::of(model.geometry());
            CoplanarRegions::of(model);
            Grain::of(model.geometry());
        }
    }

    /// Returns whether much is known to escape from the scene, so that inconsistent rows say little.
    pub(crate) fn is_in_the_open(&self) -> bool {
        matches!(self, Self::Tolerance(refinement) if refinement.is_open)
    }

    /// Returns whether rows must carry covered weights.
    pub fn needs_covered(&self) -> bool {
        !matches!(self, Self::Pixel)
    }

    /// The relative Frobenius error asked of the rows, where one is.
    pub fn tolerance(&self) -> Option<f64> {
        match self {
            Self::Tolerance(refinement) => Some(refinement.tolerance),
            _ => None,
        }
    }

    /// The price of a pair found for the tolerance, where one is asked, for manifests.
    pub(crate) fn price(&self) -> Option<String> {
        match self {
            Self::Tolerance(refinement) => Some(refinement.price()),
            Self::Pixel => None,
        }
    }

    /// |ΣF + non-visible shares − 1| from which on a row with these weights is inconsistent. Where nothing escapes, the sum
    /// is known, and no row may be off by more than T and 2 %.
    fn inconsistent_from(&self, sums: &RowSums) -> f64 {
        match self {
            Self::Pixel => f64::INFINITY,
            Self::Tolerance(_) if sums.escaped > 0 => INCONSISTENT,
            Self::Tolerance(refinement) => refinement.tolerance.max(DEFAULT_TOLERANCE),
        }
    }
}

/// The hemicubes of a row as rendered.
pub(crate) struct Rendered<'a, R> {
    pub(crate) model: &'a Model,
    pub(crate) emitter: InputPatch,
    pub(crate) hemicubes: &'a [Hemicube],
    /// The row of each hemicube.
    pub(crate) rows: R,
    pub(crate) attempt: Attempt,
}

/// Attempt at a row: inconsistent ones are rendered again, with more hemicubes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Attempt {
    pub(crate) is_last: bool,
    /// True if the emitter is so large that it has several hemicubes in any case ([`crate::accuracy::grain`]).
    pub(crate) is_large: bool,
}

/// Result of a row's conversion.
#[derive(Debug)]
pub(crate) struct Converted {
    pub(crate) row: FinishedRow,
    /// Number of partly visible pairs, at levels that know.
    pub(crate) partial: u64,
    /// True if form factors and non-visible shares are so far from summing to 1 that the hemicubes cannot stand for the
    /// emitter.
    pub(crate) is_odd: bool,
    /// Non-visible share of the hemicubes' weight.
    pub(crate) lost: f64,
    /// True if the bound of its work ended the row with pairs unmeasured.
    pub(crate) cut_short: bool,
}

/// |ΣF + non-visible shares − 1| from which on a row is inconsistent, where something escapes. In the open, one hemicube
/// is that far off about the sky now and then. A choice: with less, such rows are rendered again for nothing.
const INCONSISTENT: f64 = 0.15;
/// Visible fraction from which on a patch is all visible: the rest is rounding of weights, not an occluder.
const ALL_VISIBLE: f64 = 0.9999;
/// Part of a sum's permitted error that form factors and shares may be off 1 before rays are asked, and that a standard
/// error by rays may be. A choice: with less, more rays are cast; with more, more sums are off by more than permitted.
const ASKED: f64 = 0.75;
/// Standard error of shares that divide what form factors leave, and of a sum by which form factors are held to be off,
/// in parts of the permitted error: three standard errors are within it.
const SURE_PART: f64 = 1.0 / ERRORS;
/// The relative Frobenius error of a matrix that nobody asked a tolerance for, and the permitted error of a row's sum at
/// most, whatever the tolerance: from three quarters of it on, rays do not look for shares where hemicubes show none
/// that matters. A choice: with less, runs cost more (1 % takes 1.4 times the steps, `scoreboard board`); with more,
/// they are less exact, and rows lose what nobody looks for.
pub const DEFAULT_TOLERANCE: f64 = 0.02;

/// A patch in one of the row's hemicubes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Seen {
    patch: u32,
    /// Index of the hemicube.
    sample: u32,
    visible: u32,
    covered: u32,
}

impl Seen {
    fn fraction(&self) -> f64 {
        fraction(self.visible, self.covered)
    }
}

/// The hemicubes of a row, in their scene.
struct View<'a> {
    model: &'a Model,
    emitter: u32,
    hemicubes: &'a [Hemicube],
    spaces: &'a Spaces,
}

impl View<'_> {
    /// Where the weight goes that no surface stopped. In a closed space it went through a seam of the walls, or the patch
    /// lies on one of them: to backs.
    fn outside<'s>(&self, sums: &'s mut RowSums) -> &'s mut u64 {
        if self.spaces.is_closed(self.emitter) {
            &mut sums.blocked
        } else {
            &mut sums.escaped
        }
    }

    /// Returns whether a hemicube's centre lies in a patch's plane. A patch without a pixel is seen at its centroid; from
    /// a point in its plane, that is along the wall that it lies in, and says nothing of what other points see.
    fn lies_in_plane_of(&self, sample: u32, patch: u32) -> bool {
        let corners = self.model.normalised_corners(patch);
        let normal = crate::geometry::cross(&corners).normalize_or_zero();
        let height = self
            .hemicubes
            .get(sample as usize)
            .map(|h| normal.dot(h.origin - corners[0]));
        height.is_some_and(|height| height.abs() <= self.model.geometry().plane_tolerance)
    }
}

/// The hemicubes' view of a row before correction.
#[derive(Clone, Copy, Debug)]
struct Weights {
    samples: usize,
    /// Non-visible shares.
    shares: RowShares,
    /// Their sum.
    lost: f64,
    /// True if some weight did not escape.
    sees_anything: bool,
    /// See [`Correction::inconsistent_from`].
    bound: f64,
}

impl Weights {
    fn new(sums: &RowSums, samples: usize, correction: &Correction) -> Self {
        let whole = f64::from(WHOLE) * samples.max(1) as f64;
        Self {
            samples,
            shares: RowShares::of_hemicubes(sums, u32::try_from(samples).unwrap_or(u32::MAX)),
            lost: (sums.escaped + sums.blocked + sums.unselected) as f64 / whole,
            sees_anything: sums.escaped < u64::from(WHOLE) * samples as u64,
            bound: correction.inconsistent_from(sums),
        }
    }

    /// Returns whether form factors of this sum are inconsistent with the hemicubes' shares.
    fn is_inconsistent_with(&self, factors: f64) -> bool {
        self.samples > 0 && (factors + self.lost - 1.0).abs() > self.bound
    }
}

/// Result of the level *tolerance*.
#[derive(Clone, Copy, Debug)]
struct Corrected {
    /// Expected Σ (F − true F)².
    squared_error: f64,
    rays: u64,
    partial: usize,
    cut_short: bool,
}

impl Default for Corrected {
    fn default() -> Self {
        Self {
            squared_error: f64::NAN,
            rays: 0,
            partial: 0,
            cut_short: false,
        }
    }
}

/// Converts rows one after the other; one a thread.
#[derive(Debug)]
pub(crate) struct Converter<'c> {
    correction: Correction,
    /// The width of form factors.
    precision: Precision,
    cancel: Option<&'c AtomicBool>,
    /// Rays' shares of the last emitter of which they were asked for.
    ray_shares: Option<(InputPatch, RayShares)>,
    /// The patches with a column that these rays met, one a ray: at most 131,072.
    met: Vec<u32>,
    /// Patches in all samples of the row.
    seen: Vec<Seen>,
    /// Patches in other spaces that a sample shows, and their visible weights.
    apart: Vec<(u32, u32)>,
    points: PointFactors,
    refiner: Option<Refiner<'c>>,
}

impl<'c> Converter<'c> {
    /// When `cancel` becomes true, rows are left as they are.
    pub(crate) fn new(correction: Correction, precision: Precision, cancel: Option<&'c AtomicBool>) -> Self {
        Self {
            correction,
            precision,
            cancel,
            ray_shares: None,
            met: Vec::new(),
            seen: Vec::new(),
            apart: Vec::new(),
            refiner: match correction {
                Correction::Tolerance(refinement) => Some(Refiner::new(refinement, cancel)),
                Correction::Pixel => None,
            },
            points: PointFactors::new(),
        }
    }

    /// Returns whether nobody wants further rows.
    pub(crate) fn is_cancelled(&self) -> bool {
        self.cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed))
    }

    /// Makes a row of its hemicubes.
    ///
    /// `receives` tells the patches with a column. An inconsistent row is left unfinished if another attempt follows,
    /// and is finished at the last one.
    ///
    /// # Errors
    /// That of a device that casts rays.
    pub(crate) fn convert<'r>(
        &mut self,
        rendered: Rendered<'_, impl Iterator<Item = RowView<'r>>>,
        receives: impl Fn(u32) -> bool,
        mut caster: Caster<'_>,
    ) -> Result<Converted, BackendError> {
        let Rendered {
            model,
            emitter,
            hemicubes,
            rows,
            attempt,
        } = rendered;
        let mut row = FinishedRow::new(emitter.0, self.precision);
        row.hemicubes = u32::try_from(hemicubes.len()).unwrap_or(u32::MAX);
        let spaces = Spaces::of(model);
        let view = View {
            model,
            emitter: emitter.0,
            hemicubes,
            spaces: &spaces,
        };
        row.sums = self.gather(&view, rows, &receives);
        let receives = |patch| receives(patch) && !spaces.separate(emitter.0, patch);
        if hemicubes.len() > 1 {
            self.seen.sort_unstable();
        }
        let weights = Weights::new(&row.sums, hemicubes.len(), &self.correction);
        row.shares = weights.shares;
        let Correction::Tolerance(refinement) = self.correction else {
            self.pixel(&mut row);
            return Ok(Converted {
                row,
                partial: 0,
                is_odd: false,
                lost: weights.lost,
                cut_short: false,
            });
        };
        let mut balance = SumBalance {
            model,
            emitter,
            hemicubes: weights.shares,
            permitted: refinement.tolerance.min(DEFAULT_TOLERANCE),
            receives,
            found: self.ray_shares,
            met: std::mem::take(&mut self.met),
            closed: 0.0,
            crossed: None,
            caster: &mut caster,
        };
        let corrected = self.tolerance(&weights, attempt, &mut balance, &mut row);
        let factors = row.factors.as_slice().sum();
        // Where each pair was measured, a row's error is known, and what is beyond it is the rays'.
        let measured = self.refiner.as_ref().is_some_and(Refiner::measures_each);
        #[allow(clippy::cast_possible_truncation, reason = "an estimate")]
        let norm = corrected.squared_error.sqrt() as f32;
        let own = if measured {
            ERRORS * f64::from(norm)
        } else {
            f64::INFINITY
        };
        row.shares = balance.refined_shares(factors, norm, own);
        let [sum, escaped] = balance.standard_errors(factors, corrected.squared_error, row.shares, measured);
        self.ray_shares = balance.found;
        self.met = balance.met;
        row.errors = RowErrors::from_array([norm, sum, escaped]);
        row.rays = corrected.rays;
        caster.end()?;
        Ok(Converted {
            row,
            partial: corrected.partial as u64,
            is_odd: weights.is_inconsistent_with(factors),
            lost: weights.lost,
            cut_short: corrected.cut_short,
        })
    }

    /// The level *tolerance*.
    fn tolerance(
        &mut self,
        weights: &Weights,
        attempt: Attempt,
        balance: &mut SumBalance<'_, '_, impl Fn(u32) -> bool>,
        finished: &mut FinishedRow,
    ) -> Corrected {
        let is_strict = attempt.is_last && !self.correction.is_in_the_open();
        let Some(refiner) = &mut self.refiner else {
            return Corrected::default();
        };
        let samples = weights.samples;
        let share = 1.0 / samples.max(1) as f64;
        let groups = &self.seen;
        let seen = || {
            groups.chunk_by(|a, b| a.patch == b.patch).map(|group| {
                let mean = share * group.iter().map(Seen::fraction).sum::<f64>();
                let is_seen_by_all = group.len() == samples;
                (group[0].patch, if is_seen_by_all { mean } else { mean.min(0.999) })
            })
        };
        let adds_up = !refiner.measures_each() && weights.sees_anything;
        let finish = |refiner: &mut Refiner<'_>, balance: &mut SumBalance<'_, '_, _>, is_strict: bool| {
            let (model, emitter) = (balance.model, balance.emitter);
            let usual = refiner.make_strict(is_strict);
            let mut refined = refiner.row(
                model,
                emitter,
                seen(),
                attempt.is_large,
                &balance.receives,
                balance.caster,
            );
            refiner.set(usual);
            let mut row = std::mem::take(&mut refiner.pairs);
            if adds_up {
                let closes = attempt.is_last || !weights.is_inconsistent_with(sum_of(&row));
                let most = closes.then_some(if is_strict { f64::INFINITY } else { ERRORS });
                let added = balance.add_up(&Emitter::new(model, emitter), &mut row, refiner, most);
                refined.rays += added.rays;
                refined.points += added.points;
            }
            (row, refined)
        };
        let (mut row, mut refined) = finish(refiner, balance, is_strict);
        // Entries that did not move far enough are surer of themselves than they are right.
        if adds_up && !is_strict && balance.is_surely_off(sum_of(&row)) {
            let again;
            (row, again) = finish(refiner, balance, true);
            refined = Refined {
                rays: refined.rays + again.rays,
                points: refined.points + again.points,
                ..again
            };
        }
        for pair in &row {
            finished.push(pair.patch, pair.factor());
        }
        let is_partial = |pair: &&Pair| pair.fraction > 0.0 && pair.fraction < 1.0;
        let partial = row.iter().filter(is_partial).count();
        refiner.pairs = row;
        Corrected {
            squared_error: refined.squared_error,
            rays: refined.rays + refined.points,
            partial,
            cut_short: refined.cut_short,
        }
    }

    /// Lists the patches in an emitter's samples; returns the sums of their weights.
    fn gather<'r>(
        &mut self,
        view: &View<'_>,
        rows: impl Iterator<Item = RowView<'r>>,
        receives: &impl Fn(u32) -> bool,
    ) -> RowSums {
        let mut sums = RowSums::default();
        self.seen.clear();
        for (sample, row) in (0u32..).zip(rows) {
            *view.outside(&mut sums) += u64::from(row.escaped);
            sums.blocked += u64::from(row.blocked);
            let first = self.seen.len();
            self.apart.clear();
            for ((&patch, &visible), &covered) in row.patches.iter().zip(row.visible).zip(row.covered) {
                if view.spaces.separate(view.emitter, patch) {
                    sums.blocked += u64::from(visible);
                    if visible > 0 && view.spaces.overlap() {
                        self.apart.push((patch, visible));
                    }
                } else if receives(patch) {
                    sums.visible += u64::from(visible);
                    if (visible, covered) == (0, 0) && view.lies_in_plane_of(sample, patch) {
                        continue;
                    }
                    self.seen.push(Seen {
                        patch,
                        sample,
                        visible,
                        covered,
                    });
                } else {
                    sums.unselected += u64::from(visible);
                }
            }
            if !self.apart.is_empty() {
                self.give_to_own(view, sample, first, receives, &mut sums);
            }
        }
        sums
    }

    /// Gives the pixels of patches in other spaces to the patches of the emitter's own space that lie on them, in
    /// proportion to the closed forms of what they have in common. `first`: where the sample's patches begin in `seen`.
    fn give_to_own(
        &mut self,
        view: &View<'_>,
        sample: u32,
        first: usize,
        receives: &impl Fn(u32) -> bool,
        sums: &mut RowSums,
    ) {
        let Some(hemicube) = view.hemicubes.get(sample as usize) else {
            return;
        };
        let center = || std::iter::once((hemicube.origin, hemicube.axes[2]));
        let mut gained: BTreeMap<u32, u32> = BTreeMap::new();
        let mut own: Vec<(u32, f64)> = Vec::new();
        for &(apart, weight) in &self.apart {
            own.clear();
            for (patch, common) in view.spaces.own_at(view.emitter, apart) {
                let fan = (2..common.len()).map(|k| [common[0], common[k - 1], common[k]]);
                let factor: f64 = fan.map(|part| self.points.evaluate(center(), &part)[0]).sum();
                if factor > 0.0 {
                    own.push((patch, factor));
                }
            }
            let mut left: f64 = own.iter().map(|&(_, factor)| factor).sum();
            let mut weight = weight;
            for (k, &(patch, factor)) in own.iter().enumerate() {
                let share = if k + 1 == own.len() {
                    1.0
                } else {
                    (factor / left).min(1.0)
                };
                #[allow(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "part of a weight"
                )]
                let given = (f64::from(weight) * share).round() as u32;
                left -= factor;
                weight -= given;
                *gained.entry(patch).or_default() += given;
            }
        }
        let listed = self.seen.len();
        for (patch, given) in gained {
            sums.blocked -= u64::from(given);
            if !receives(patch) {
                sums.unselected += u64::from(given);
                continue;
            }
            sums.visible += u64::from(given);
            match self.seen[first..listed].binary_search_by_key(&patch, |seen| seen.patch) {
                Ok(at) => self.seen[first + at].visible += given,
                Err(_) => {
                    // No pixel shows it: what it covers is its closed form.
                    let factor = self.points.evaluate(center(), &view.model.normalised_corners(patch))[0];
                    #[allow(
                        clippy::cast_possible_truncation,
                        clippy::cast_sign_loss,
                        reason = "a share of WHOLE"
                    )]
                    let covered = (factor * f64::from(WHOLE)).round() as u32;
                    self.seen.push(Seen {
                        patch,
                        sample,
                        visible: given,
                        covered,
                    });
                }
            }
        }
        self.seen[first..].sort_unstable();
    }

    /// The level *pixel*.
    fn pixel(&self, row: &mut FinishedRow) {
        let scale = 1.0 / (f64::from(WHOLE) * f64::from(row.hemicubes.max(1)));
        for group in self.seen.chunk_by(|a, b| a.patch == b.patch) {
            let weight: u64 = group.iter().map(|seen| u64::from(seen.visible)).sum();
            row.push(group[0].patch, weight as f64 * scale);
        }
    }
}

/// The balance ΣF + escaped + blocked + unselected = 1 of a row, with the non-visible shares by rays where the
/// hemicubes' do not do.
struct SumBalance<'a, 's, R> {
    model: &'a Model,
    emitter: InputPatch,
    /// The hemicubes' shares.
    hemicubes: RowShares,
    /// Permitted error of the sum.
    permitted: f64,
    /// Tells the patches with a column.
    receives: R,
    /// Rays' shares of the last emitter of which they were asked for.
    found: Option<(InputPatch, RayShares)>,
    /// The patches with a column that these rays met, one a ray.
    met: Vec<u32>,
    /// The largest expected square of what the row lacked before it was closed, without what rays explain.
    closed: f64,
    /// Whether a one-sided surface crosses the emitter, where that was asked.
    crossed: Option<bool>,
    /// What casts rays beside the processor.
    caster: &'a mut Caster<'s>,
}

impl<R: Fn(u32) -> bool> SumBalance<'_, '_, R> {
    /// The rays cast from this patch so far.
    fn cast(&self) -> Option<RayShares> {
        self.found
            .filter(|(patch, _)| *patch == self.emitter)
            .map(|(_, found)| found)
    }

    /// Returns whether rays were asked for this patch's shares.
    fn has_ray_shares(&self) -> bool {
        self.cast().is_some_and(|found| found.is_measurement())
    }

    /// The shares by rays, whose standard errors are within [`ASKED`] of the permitted error, cast where they were
    /// not; `None` for a patch without area.
    fn ray_shares(&mut self, emitter: &Emitter<'_>) -> Option<RayShares> {
        let wanted = ASKED * self.permitted;
        self.refined_until(emitter, |found| found.for_shares(wanted))
    }

    /// [`Self::ray_shares`], where two of them matter with as many rays as divide what the form factors leave.
    fn divided_ray_shares(&mut self, emitter: &Emitter<'_>) -> Option<RayShares> {
        let found = self.ray_shares(emitter)?;
        if self.matter(found.shares()) < 2 {
            return Some(found);
        }
        let wanted = SURE_PART * self.permitted;
        self.refined_until(emitter, |found| found.for_division(wanted))
    }

    /// Casts rays until there are as many as `wanted` says, or their bound is met; `None` for a patch without area.
    fn refined_until(&mut self, emitter: &Emitter<'_>, wanted: impl Fn(&RayShares) -> f64) -> Option<RayShares> {
        let mut found = self.look(emitter)?;
        found.refine(
            emitter,
            self.permitted,
            wanted,
            self.caster,
            noting(&self.receives, &mut self.met),
        );
        self.found = Some((self.emitter, found));
        Some(found)
    }

    /// [`Self::ray_shares`], with as many rays as tell whether form factors of this sum are off by more than permitted.
    fn sure_ray_shares(&mut self, emitter: &Emitter<'_>, factors: f64) -> Option<RayShares> {
        self.ray_shares(emitter)?;
        let (permitted, part) = (self.permitted, ASKED * self.permitted);
        self.refined_until(emitter, |found| {
            // Sums below 1 that lose nothing by rays may lose what few rays miss, as at the rim of a narrow gap.
            let may_miss = factors < 1.0 && found.none_leaves() > part;
            let is_off = (1.0 - factors - found.shares().lost()).abs() > part;
            match (is_off, may_miss) {
                (true, true) => found.for_sum(SURE_PART * permitted).max(NONE_MET / part),
                (true, false) => found.for_sum(SURE_PART * permitted),
                (false, _) => 0.0,
            }
        })
    }

    /// Returns whether a row whose form factors have this sum needs shares by rays: for their sum, or to divide it.
    fn needs_rays(&mut self, emitter: &Emitter<'_>, factors: f64) -> bool {
        self.is_off(factors) || self.is_split(emitter, self.hemicubes.refined(factors, f64::NAN))
    }

    /// Returns whether form factors of this sum and the hemicubes' shares are off 1, or rays were asked for.
    fn is_off(&self, factors: f64) -> bool {
        !self.agree(factors) || self.has_ray_shares()
    }

    /// Returns whether form factors of this sum and the hemicubes' shares come to 1.
    fn agree(&self, factors: f64) -> bool {
        let residual = (1.0 - factors - self.hemicubes.lost()).abs();
        residual <= ASKED * self.permitted && factors <= 1.0 + ASKED * self.permitted
    }

    /// Number of shares that matter.
    fn matter(&self, shares: RowShares) -> usize {
        let shares = shares.to_array();
        shares.iter().filter(|&&share| share > self.permitted).count()
    }

    /// Returns whether at least two of these shares matter, or rays see others. The form factors tell their sum and not
    /// how it divides, and a hemicube at the centroid of a large patch divides it as the centroid sees it. It may see
    /// no back of a surface that crosses the patch, or that only a part of it sees. Rays are not asked where no share
    /// matters and the permitted error is [`ASKED`] of [`DEFAULT_TOLERANCE`] or more.
    fn is_split(&mut self, emitter: &Emitter<'_>, shares: RowShares) -> bool {
        match self.matter(shares) {
            0 if self.permitted >= ASKED * DEFAULT_TOLERANCE => false,
            0 | 1 => self.differs(emitter, shares) || self.is_crossed(emitter),
            _ => true,
        }
    }

    /// [`ray_shares::is_crossed`], asked once a row.
    fn is_crossed(&mut self, emitter: &Emitter<'_>) -> bool {
        *self.crossed.get_or_insert_with(|| ray_shares::is_crossed(emitter))
    }

    /// Returns whether a first look by rays meets what has no share, finds that a share matters that does not by
    /// hemicubes, or differs from these shares by more than three standard errors and the permitted one.
    fn differs(&mut self, emitter: &Emitter<'_>, shares: RowShares) -> bool {
        let Some(found) = self.look(emitter) else {
            return false;
        };
        self.found = Some((self.emitter, found));
        let pairs = found.shares().to_array().into_iter().zip(shares.to_array());
        pairs.zip(found.errors()).any(|((seen, share), error)| {
            let is_missed = share < self.permitted && seen > share + self.permitted;
            let is_beyond = (seen - share).abs() > (ERRORS * error).max(self.permitted);
            (share == 0.0 && seen > 0.0) || is_missed || is_beyond
        })
    }

    /// The rays cast from this patch so far, or first ones; `None` for a patch without area.
    fn look(&mut self, emitter: &Emitter<'_>) -> Option<RayShares> {
        self.cast().or_else(|| {
            self.met.clear();
            RayShares::look(
                emitter,
                self.permitted,
                self.caster,
                noting(&self.receives, &mut self.met),
            )
        })
    }

    /// The share of the view in patches that rays met and the row does not see; 0 up to [`ASKED`] of the permitted error,
    /// or where no rays were asked for. The row's sum tells nothing of this share where other entries are too large: from
    /// its centroid, a wall over fine pipes sees one side of each.
    fn unseen_share(&mut self, emitter: &Emitter<'_>, row: &[Pair]) -> f64 {
        let permitted = ASKED * self.permitted;
        let Some(mut found) = self.cast() else { return 0.0 };
        let count_of = |met: &[u32]| met.iter().filter(|&&patch| !sees(row, patch)).count() as f64;
        let mut count = count_of(&self.met);
        // With a standard error of the count more, and with one less.
        let may_be_much = |count: f64, found: &RayShares| count + count.sqrt() > permitted * found.rays() as f64;
        let is_much = |count: f64, found: &RayShares| count - count.sqrt() > permitted * found.rays() as f64;
        while may_be_much(count, &found) {
            let before = self.met.len();
            let wanted = NONE_MET / permitted;
            if !found.go_on(
                emitter,
                self.permitted,
                wanted,
                self.caster,
                noting(&self.receives, &mut self.met),
            ) {
                break;
            }
            count += count_of(&self.met[before..]);
        }
        self.found = Some((self.emitter, found));
        if is_much(count, &found) {
            count / found.rays() as f64
        } else {
            0.0
        }
    }

    /// Difference of form factors of this sum from their known sum; `None` if permitted.
    fn lacking(&mut self, emitter: &Emitter<'_>, factors: f64) -> Option<Lacking> {
        if !self.needs_rays(emitter, factors) {
            return None;
        }
        let found = self.sure_ray_shares(emitter, factors)?;
        let sum = 1.0 - factors - found.shares().lost();
        let error = found.error();
        let noise = if self.agree(factors) { ERRORS * error } else { 0.0 };
        (sum.abs() > noise.max(ASKED * self.permitted)).then_some(Lacking { sum, error })
    }

    /// Returns whether form factors of this sum are still off their known one by more than permitted, and by more than
    /// rays may be.
    fn is_surely_off(&mut self, factors: f64) -> bool {
        let emitter = Emitter::new(self.model, self.emitter);
        let lacking = self.lacking(&emitter, factors);
        lacking.is_some_and(|lacking| lacking.sum.abs() > ERRORS * lacking.error)
    }

    /// Brings a row nearer to its known sum if it is off by more than permitted: by unseen pairs, and by moving
    /// uncertain fractions, where they may move, by `most` standard errors each.
    fn add_up(
        &mut self,
        emitter: &Emitter<'_>,
        row: &mut Vec<Pair>,
        refiner: &mut Refiner<'_>,
        most: Option<f64>,
    ) -> Refined {
        let lacking = self.lacking(emitter, sum_of(row));
        let by_sum = lacking.filter(|lacking| lacking.sum > ERRORS * lacking.error);
        let missing = by_sum
            .map_or(0.0, |lacking| lacking.sum)
            .max(self.unseen_share(emitter, row));
        let mut refined = Refined::default();
        if missing > 0.0 {
            let is_known = |patch| !(self.receives)(patch) || sees(row, patch);
            refined = refiner.find_unseen(emitter, missing, is_known);
            insert(row, &refiner.unseen);
        }
        if let Some(most) = most
            && let Some(lacking) = self.lacking(emitter, sum_of(row))
        {
            refiner.move_fractions(row, lacking, most);
            self.closed = self.closed.max(lacking.common());
        }
        refined
    }

    /// The non-visible shares of a finished row, refined to form factors of this sum and this expected error, which may
    /// be off by `own` at most; ∞ where that is not known. Where it is, rays do not tell the sum better, and only divide
    /// it.
    fn refined_shares(&mut self, factors: f64, error: f32, own: f64) -> RowShares {
        let by_hemicubes = self.hemicubes.refined(factors, error.into());
        let emitter = Emitter::new(self.model, self.emitter);
        if own.is_finite() {
            let none_matters = 1.0 - factors + own <= self.permitted;
            if none_matters || !self.is_split(&emitter, by_hemicubes) {
                return by_hemicubes;
            }
            let wanted = SURE_PART * self.permitted;
            let divided = self.refined_until(&emitter, |found| found.for_division(wanted));
            return divided.map_or(by_hemicubes, |found| {
                found.shares().refined_within(factors, own.min(ASKED * self.permitted))
            });
        }
        if !self.needs_rays(&emitter, factors) {
            return by_hemicubes;
        }
        if self.divided_ray_shares(&emitter).is_none() {
            return by_hemicubes;
        }
        self.sure_ray_shares(&emitter, factors).map_or(by_hemicubes, |found| {
            found.shares().refined_within(factors, own.min(ASKED * self.permitted))
        })
    }

    /// The standard errors of Σ F and of *escaped*, of a row with this sum, expected Σ (F − true F)² and these shares.
    ///
    /// Entries that err independently leave their sum the variance V = Σ Var F. Neighbours behind one edge err
    /// together, and the sum is off by more. What a closed row had lacked ([`Lacking::common`]) takes the place of V
    /// where it is larger. Rays, or else hemicubes, tell the sum as well: their difference from the row's, where it is
    /// larger than √V, takes its place, unless each pair was measured by itself (`is_exact`). Rays of the standard
    /// error e leave V e² / (V + e²), and the part V / (V + e²) of a difference D that the row was not moved by is an
    /// error, too. A share X of L = 1 − Σ F has the part X / L of that error, and that of the rays that divide L.
    /// `scoreboard board` prints both beside what rows are off by.
    fn standard_errors(&self, factors: f64, squared_error: f64, shares: RowShares, is_exact: bool) -> [f32; 2] {
        let rays = self.cast().filter(RayShares::is_measurement);
        let lost = rays.map_or(self.hemicubes, |rays| rays.shares()).lost();
        let mut squared = squared_error.max(self.closed);
        if !is_exact {
            let difference = 1.0 - factors - lost;
            squared = squared.max(difference.powi(2));
            if let Some(noise) = rays.map(|rays| rays.error().powi(2)) {
                let known = squared / (squared + noise);
                squared = known * noise + (known * difference).powi(2);
            }
        }
        let lost = shares.lost();
        let part = if lost > 0.0 { shares.escaped / lost } else { 0.0 };
        let division = rays.map_or(0.0, |rays| rays.escaped_error());
        let escaped = squared * part.powi(2) + division.powi(2);
        #[allow(clippy::cast_possible_truncation, reason = "estimates")]
        [squared, escaped].map(|squared| squared.sqrt() as f32)
    }
}

/// Tells the patches with a column, and notes those that were asked for.
fn noting<'a>(receives: &'a impl Fn(u32) -> bool, met: &'a mut Vec<u32>) -> impl FnMut(u32) -> bool + 'a {
    |patch| {
        let has_column = receives(patch);
        if has_column {
            met.push(patch);
        }
        has_column
    }
}

/// Visible over covered weight. A patch that covers no pixel is smaller than one and seen at its centroid: 1.
pub(crate) fn fraction(visible: u32, covered: u32) -> f64 {
    if covered == 0 {
        return 1.0;
    }
    let fraction = f64::from(visible) / f64::from(covered);
    if fraction >= ALL_VISIBLE { 1.0 } else { fraction }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions() {
        assert_eq!(fraction(0, 0), 1.0, "a patch without a pixel is seen");
        assert_eq!(fraction(5, 10), 0.5);
        assert_eq!(fraction(99_999, 100_000), 1.0);
        assert_eq!(fraction(0, 10), 0.0);
    }
}
