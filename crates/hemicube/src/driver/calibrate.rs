//! Calibration of a tolerance on a scene: effort and resolution, from a seeded sample of its rows.
//!
//! 256 rows, from one hemicube each, tell the norm that the tolerance is relative to. 64 of them, compared with rays,
//! tell the error of visible fractions from one hemicube in this scene: the prior variances
//! ([`crate::accuracy::correct::PriorVariances`]). Efforts are then tried on these rows, from the cheapest on, against
//! the same rows with a quarter of the tolerance. The first that keeps the tolerance with a margin is taken.
//! Where patches are several elements, the error is that of the patches' matrix (`grouped.rs`): errors of the elements'
//! rows may be larger, by efforts of up to 8. What a row sums to keeps the tolerance whatever the effort, and so do
//! closed forms. Everything depends on the scene, the settings and the seed, never on a clock.
//!
//! Settling is bounded, as rows are: its rows tried with a quarter of the tolerance take 6 · 10⁹ steps, or twice those
//! of a row's bound if these are more, and so do its efforts. Where the first do, fewer rows are tried, evenly from the
//! sample, eight at least; where the second do, the effort is the last one's in proportion to its error, and the reason
//! says so. A row tried that its bound cut short has its own expected error on top of what efforts differ from it by.
//!
//! No calibration in the store, because calibrating again from its seed gives the same and takes seconds; a stored one
//! would be a second truth.

mod grouped;

use crate::accuracy::correct::fraction;
use crate::accuracy::error_model::PriorSums;
use crate::accuracy::refine::{Pair, Refined, Refinement, Refiner, exact};
use crate::backend::{Culling, HemicubeBackend, RenderSettings, WHOLE};
use crate::driver::compute::{ComputeError, Execution, render, sample};
use crate::factor::FactorRule;
use crate::row::{RowBlock, RowView};
use crate::visibility::spaces::Spaces;
use crate::{Grouping, Model};
use grouped::{Draw, added_up, difference, mean_and_error, mean_norm, of_patch};
use hemicube_scene::InputPatch;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// An effort and a resolution for a tolerance, with the errors found for them.
///
/// ```
/// use hemicube::InputPatch;
/// use hemicube::driver::compute::Execution;
/// use hemicube::driver::calibrate::calibrate;
/// use hemicube_backend_cpu::CpuBackend;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model()?;
///
/// // Over all rows and columns of the room.
/// let emitters: Vec<InputPatch> = model.order().collect();
/// let mut backend = CpuBackend::new();
/// let found = calibrate(&model, &emitters, &|_| true, true, 0.01, &mut backend, Execution::default())?;
/// assert!(found.keeps(0.01) && !found.keeps(0.001), "enough for what was asked, and no more");
/// assert!(found.rows > 0 && found.expected <= found.at_most, "{}", found.reason);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// Refinement of the rows, with the scene's norm and prior variances.
    pub refinement: Refinement,
    /// Pixels along an edge of the hemicube.
    pub resolution: u32,
    /// Relative Frobenius error of the rows tried; 0 where none was tried.
    pub expected: f64,
    /// `expected` with 1.5 standard errors added, for the rows not tried.
    pub at_most: f64,
    /// Number of rows tried.
    pub rows: usize,
    /// Effort, resolution and errors in words.
    pub reason: String,
}

impl Calibration {
    /// Returns whether the tolerance is expected to be kept.
    pub fn keeps(&self, tolerance: f64) -> bool {
        self.at_most <= tolerance
    }
}

/// Rows that the norm is estimated from.
const NORM_ROWS: usize = 256;
/// Rows of them that efforts are tried on.
const TRIED_ROWS: usize = 64;
/// Standard errors added to the error of the rows tried.
const SURE: f64 = 1.5;
/// Patches of a scene, and the tolerance, up to which every pair is measured to a bound of its own: a room of 300 takes
/// less than half the time that rays took at 0.2 %.
const SMALL: usize = 400;
const FINE: f64 = 2e-3;
/// Tolerance that no number of rays keeps, and patches of a scene up to which every pair is then measured by itself.
const FINEST_OF_RAYS: f64 = 0.99e-5;
const MANY: usize = 4096;
/// Share of the tolerance that the rows tried may have, for the sake of the others.
const MARGIN: f64 = 0.82;
/// Slack in the rule that an error falls in proportion to the effort at most.
const SLACK: f64 = 1.15;
/// Squared error of patches, in the mean squared error of their elements' rows, at least: a choice. By it, an error of
/// elements is taken for up to four times that of their patches.
const LEAST_SHARED: f64 = 1.0 / 16.0;
/// Bounds of the ratio of a found to an expected squared error: rows tried are too few to believe more.
const LEAST_ESTIMATE: f64 = 0.05;
const MOST_ESTIMATE: f64 = 4.0;
/// Bound of the steps of the rows tried with a quarter of the tolerance, and of the efforts tried; and the same in
/// bounds of a row: the larger counts. About ten seconds of one thread each. Choices.
const BOUND: u64 = 6_000_000_000;
const BOUND_IN_ROWS: u64 = 2;
/// Number of rows, and of their twins, that are tried at once, and the least number tried.
const CHUNK: usize = 4;
const TRIED_AT_LEAST: usize = 8;
/// Entries after which no further row counts for the norm, and the rows that count in any case. Choices.
const NORM_ENTRIES: usize = 1_000_000;
const NORM_ROWS_AT_LEAST: usize = 64;
/// A calibration's reason where its effort was not tried.
const BY_PROPORTION: &str = "by proportion";
/// Seed of the sample.
const SEED: u64 = 0x7E57_0F70;

/// Efforts, from the cheapest to the dearest. Even the cheapest looks for pairs missed by its hemicube: few rows of a
/// scene have any, and a sample may have none of these.
const EFFORTS: [f64; 24] = [
    8.0, 4.0, 2.5, 1.8, 1.6, 1.4, 1.2, 1.1, 1.0, 0.95, 0.9, 0.85, 0.8, 0.75, 0.7, 0.62, 0.55, 0.48, 0.42, 0.36, 0.3,
    0.25, 0.21, 0.18,
];
/// Pixels along an edge for efforts above [`COARSE_EFFORT`], and for the others.
const COARSE: u32 = 64;
const FINEST: u32 = 128;
const COARSE_EFFORT: f64 = 2.0;

fn resolution_of(effort: f64) -> u32 {
    if effort > COARSE_EFFORT { COARSE } else { FINEST }
}

/// Columns and form factors of a row at some effort.
type Row = Vec<(u32, f64)>;

/// A row with a quarter of the tolerance.
struct Tried {
    row: Row,
    /// Expected Σ (F − true F)² of a row that met its bound; 0 of others.
    squared_error: f64,
}

/// Elements with rows, and the patches that they are of.
#[derive(Clone, Copy, Debug)]
pub struct Emitters<'a> {
    /// The elements, in the order of work.
    pub elements: &'a [InputPatch],
    /// Their patches; `None`: each is its own.
    pub grouping: Option<&'a Grouping>,
}

impl<'a> From<&'a [InputPatch]> for Emitters<'a> {
    fn from(elements: &'a [InputPatch]) -> Self {
        Self {
            elements,
            grouping: None,
        }
    }
}

impl<'a> From<&'a Vec<InputPatch>> for Emitters<'a> {
    fn from(elements: &'a Vec<InputPatch>) -> Self {
        elements.as_slice().into()
    }
}

/// Finds the effort and resolution that keep `tolerance` over the rows of `emitters`: of their patches, where those are
/// several elements. Threads do not change them.
///
/// # Errors
/// When the backend fails or breaks the contract, and [`ComputeError::Cancelled`] when it is cancelled: half a sample
/// is no answer.
pub fn calibrate<'a>(
    model: &Model,
    emitters: impl Into<Emitters<'a>>,
    receives: &(dyn Fn(u32) -> bool + Sync),
    rotate: bool,
    tolerance: f64,
    backend: &mut dyn HemicubeBackend,
    execution: Execution<'_>,
) -> Result<Calibration, ComputeError> {
    let each_up_to = if tolerance < FINEST_OF_RAYS { MANY } else { SMALL };
    let is_small = model.patches().len() <= each_up_to && tolerance <= FINE;
    if is_small || exact::is_worth(model, tolerance) {
        return Ok(each_pair(model, tolerance));
    }
    let Emitters { elements, grouping } = emitters.into();
    // A patch without area has no hemicube.
    let has_area = |row: &InputPatch| !model.hemicubes(*row, 1, rotate).is_empty();
    let (rows, weights) = match grouping {
        None => {
            let mut rows = sample(elements, NORM_ROWS, SEED);
            rows.retain(has_area);
            (rows, Vec::new())
        }
        Some(grouping) => {
            let elements: Vec<InputPatch> = elements.iter().copied().filter(has_area).collect();
            let mut draw = Draw::new(grouping, model.patches(), &elements, NORM_ROWS, SEED);
            draw.rows.append(&mut draw.twins);
            (draw.rows, draw.weights)
        }
    };
    // Twins follow the rows that they are of.
    let own = if grouping.is_some() { weights.len() } else { rows.len() };
    let stride = own.div_ceil(TRIED_ROWS).max(1);
    let tried = (0..own).step_by(stride);
    let mut sample = Sample {
        tried: match grouping {
            None => tried.collect(),
            Some(_) => tried.clone().chain(tried.map(|place| own + place)).collect(),
        },
        // Where all pairs are measured, no effort is tried with coarse ones.
        coarse: if model.patches().len() <= SMALL {
            RowBlock::default()
        } else {
            hemicubes(model, &rows, rotate, COARSE, backend)?
        },
        fine: hemicubes(model, &rows, rotate, FINEST, backend)?,
        rows,
        weights,
        grouping,
        model,
        spaces: Spaces::of(model),
        receives,
        tolerance,
        execution,
    };
    let (known, norm) = sample.learn()?;
    let exact = sample.exact(known)?;
    let mut calibration = sample.search(known, norm, &exact)?;
    let percent = |x: f64| format!("{:.3} %", 100.0 * x);
    let verdict = if calibration.reason == BY_PROPORTION {
        "; the effort in proportion, as settling met the bound of its work"
    } else if calibration.keeps(tolerance) {
        ""
    } else {
        "; more than was asked for, and the most that is tried"
    };
    calibration.reason = format!(
        "visible fractions refined with effort {}, N = {}: {} off on {} rows tried{}, at most about {}{verdict}",
        calibration.refinement.effort,
        calibration.resolution,
        percent(calibration.expected),
        calibration.rows,
        grouping.map_or_else(String::new, |grouping| format!(
            ", added up by {}",
            grouping.kind().name()
        )),
        percent(calibration.at_most),
    );
    Ok(calibration)
}

/// Every pair measured to the tolerance by itself: for scenes with few pairs, and a tolerance that wants each right.
fn each_pair(model: &Model, tolerance: f64) -> Calibration {
    Calibration {
        refinement: Refinement {
            each: true,
            rule: FactorRule::exact(),
            ..Refinement::for_tolerance(tolerance)
        },
        resolution: FINEST,
        expected: 0.0,
        at_most: 0.0,
        rows: 0,
        reason: format!(
            "every pair measured to the tolerance by itself, as there are only {} patches",
            model.patches().len()
        ),
    }
}

/// A sample of a scene's rows, one hemicube each at both resolutions.
struct Sample<'a> {
    model: &'a Model,
    spaces: Arc<Spaces>,
    receives: &'a (dyn Fn(u32) -> bool + Sync),
    tolerance: f64,
    execution: Execution<'a>,
    rows: Vec<InputPatch>,
    /// Places in `rows` of the rows that efforts are tried on.
    tried: Vec<usize>,
    coarse: RowBlock,
    fine: RowBlock,
    /// The patches of elements. The second half of `rows`, and of `tried`, then are other elements of the patches of
    /// the first half, whose weights in their patches are here.
    grouping: Option<&'a Grouping>,
    weights: Vec<f64>,
}

impl Sample<'_> {
    fn go_on(&self) -> Result<(), ComputeError> {
        if self.execution.is_cancelled() {
            Err(ComputeError::Cancelled)
        } else {
            Ok(())
        }
    }

    fn refiner(&self, refinement: Refinement) -> Refiner<'_> {
        Refiner::new(refinement, self.execution.cancel)
    }

    /// The patches that the k-th row's hemicube saw, with their visible fractions.
    fn seen<'r>(&'r self, block: &'r RowBlock, k: usize) -> impl Iterator<Item = (u32, f64)> + 'r {
        let of = self.rows[k].0;
        seen(block.row(k)).filter(move |&(patch, _)| !self.spaces.separate(of, patch))
    }

    /// Tells the patches that the k-th row may have an entry for.
    fn receivers(&self, k: usize) -> impl Fn(u32) -> bool + '_ {
        let of = self.rows[k].0;
        move |patch| (self.receives)(patch) && !self.spaces.separate(of, patch)
    }

    /// A row as the matrix has it, with columns of patches.
    fn of_patches(&self, row: Row) -> Row {
        match self.grouping {
            Some(grouping) => added_up(&row, grouping),
            None => row,
        }
    }

    /// A refinement that knows the scene's norm, whether it is open, and its prior variances; and the mean of Σ F² over
    /// the rows of the matrix.
    fn learn(&self) -> Result<(Refinement, f64), ComputeError> {
        let model = self.model;
        let (count, patch_count) = (self.rows.len(), model.patches().len());
        let plain = Refinement {
            effort: f64::INFINITY,
            ..Refinement::for_tolerance(self.tolerance)
        };
        let mut refiner = self.refiner(plain);
        let (mut norm, mut rows) = (0.0, Vec::new());
        // All rows of grouped patches: they are added up by their places.
        let places = match self.grouping {
            Some(_) => (0..count).collect(),
            None => spread(count),
        };
        let (mut counted, mut entries) = (0usize, 0);
        for k in places {
            if self.grouping.is_none() && entries >= NORM_ENTRIES && counted >= NORM_ROWS_AT_LEAST {
                break;
            }
            self.go_on()?;
            norm += refiner
                .row(model, self.rows[k], self.seen(&self.fine, k), false, self.receivers(k))
                .squared_norm;
            entries += refiner.pairs.len();
            counted += 1;
            if self.grouping.is_some() {
                rows.push(self.of_patches(values(&refiner.pairs)));
            }
        }
        let escaped: u64 = (0..count).map(|k| u64::from(self.fine.row(k).escaped)).sum();
        let known = Refinement {
            mean_squared_norm: norm / counted.max(1) as f64,
            is_open: escaped as f64 > self.tolerance * f64::from(WHOLE) * count as f64,
            all: patch_count <= SMALL,
            ..Refinement::for_tolerance(self.tolerance)
        };
        let mut sums = PriorSums::default();
        let mut refiner = self.refiner(known);
        for &k in &self.tried {
            self.go_on()?;
            refiner.measure_priors(
                model,
                self.rows[k],
                self.seen(&self.fine, k),
                self.receivers(k),
                &mut sums,
            );
        }
        let norm = match self.grouping {
            Some(_) => {
                let own = self.weights.len();
                let of = |(k, &weight): (usize, &f64)| of_patch(weight, &rows[k], &rows[own + k]);
                mean_norm(&self.weights.iter().enumerate().map(of).collect::<Vec<f64>>())
            }
            None => known.mean_squared_norm,
        };
        let priors = sums.priors();
        Ok((Refinement { priors, ..known }, norm))
    }

    /// `known` at an effort, with its Lagrange multiplier.
    fn at_effort(&self, known: Refinement, effort: f64) -> Result<Refinement, ComputeError> {
        let refinement = Refinement { effort, ..known };
        let mut refiner = self.refiner(refinement);
        let asked = if refinement.all {
            (0..self.rows.len()).collect()
        } else {
            self.tried.clone()
        };
        let mut expected_errors = Vec::with_capacity(asked.len());
        for k in asked {
            self.go_on()?;
            let seen = self.seen(&self.fine, k);
            expected_errors.push(refiner.expected_errors(self.model, self.rows[k], seen, self.receivers(k)));
        }
        Ok(refinement.with_multiplier_of(&expected_errors))
    }

    /// The k-th row refined, with its expected error and cost.
    fn refined(&self, refiner: &mut Refiner<'_>, block: &RowBlock, k: usize) -> (Row, Refined) {
        let refined = refiner.row(self.model, self.rows[k], self.seen(block, k), false, self.receivers(k));
        (values(&refiner.pairs), refined)
    }

    /// The rows tried, with a quarter of the tolerance. Where they meet the bound of settling, `self.tried` has fewer
    /// of them afterwards.
    fn exact(&mut self, known: Refinement) -> Result<Vec<Tried>, ComputeError> {
        let finest = Refinement {
            rule: FactorRule::for_tolerance(self.tolerance * 0.1),
            ..self.at_effort(known, 0.25)?
        };
        let own = match self.grouping {
            Some(_) => self.tried.len() / 2,
            None => self.tried.len(),
        };
        let most_steps = bound(&finest);
        let mut exact: Vec<(usize, Tried)> = Vec::with_capacity(self.tried.len());
        let mut steps = 0;
        for chunk in spread(own).chunks(CHUNK) {
            let twins = chunk.iter().map(|n| own + n).filter(|&n| n < self.tried.len());
            let numbers: Vec<usize> = chunk.iter().copied().chain(twins).collect();
            let found = side_by_side(self.execution, finest, &numbers, |refiner, n| {
                self.refined(refiner, &self.fine, self.tried[n])
            });
            self.go_on()?;
            for (n, (row, refined)) in numbers.into_iter().zip(found) {
                steps += refined.steps;
                let squared_error = if refined.cut_short { refined.squared_error } else { 0.0 };
                exact.push((n, Tried { row, squared_error }));
            }
            if steps >= most_steps && exact.len() >= TRIED_AT_LEAST {
                break;
            }
        }
        exact.sort_by_key(|&(n, _)| n);
        self.tried = exact.iter().map(|&(n, _)| self.tried[n]).collect();
        Ok(exact.into_iter().map(|(_, tried)| tried).collect())
    }

    /// Tries an effort: the error of the rows tried, relative to `norm`, the mean of Σ F²; and its steps.
    fn try_effort(
        &self,
        known: Refinement,
        norm: f64,
        exact: &[Tried],
        effort: f64,
    ) -> Result<(Calibration, u64), ComputeError> {
        let refinement = self.at_effort(known, effort)?;
        // Where all pairs are measured, hemicubes only tell escaped and blocked shares: coarse ones would save nothing.
        let resolution = if known.all { FINEST } else { resolution_of(effort) };
        let block = if resolution == COARSE { &self.coarse } else { &self.fine };
        let numbered: Vec<usize> = (0..self.tried.len()).collect();
        let found: Vec<(Row, Refined)> = side_by_side(self.execution, refinement, &numbered, |refiner, n| {
            self.refined(refiner, block, self.tried[n])
        });
        self.go_on()?;
        let (rows, refined): (Vec<Row>, Vec<Refined>) = found.into_iter().unzip();
        let steps = refined.iter().map(|refined| refined.steps).sum();
        let errors = rows
            .iter()
            .zip(exact)
            .map(|(row, exact)| squared_difference(row, &exact.row) + exact.squared_error);
        let errors: Vec<f64> = errors.collect();
        let squared: f64 = errors.iter().sum();
        let expected: f64 = refined.iter().map(|refined| refined.squared_error).sum();
        #[allow(clippy::cast_possible_truncation, reason = "an estimate")]
        let estimate = if expected > 0.0 {
            (squared / expected).clamp(LEAST_ESTIMATE, MOST_ESTIMATE) as f32
        } else {
            1.0
        };
        let norm = norm.max(f64::MIN_POSITIVE);
        let (mut mean, mut error) = mean_and_error(&errors);
        if self.grouping.is_some() {
            let differences: Vec<Row> = rows
                .iter()
                .zip(exact)
                .map(|(row, exact)| difference(row, &exact.row))
                .collect();
            let own = differences.len() / 2;
            let of = |n: usize| {
                let of_elements = of_patch(self.weights[self.tried[n]], &differences[n], &differences[own + n]);
                of_elements + exact[n].squared_error
            };
            let of_patches: Vec<f64> = (0..own).map(of).collect();
            // Few pairs know a mean near 0 badly.
            let least = LEAST_SHARED * mean;
            (mean, error) = mean_and_error(&of_patches);
            mean = mean.max(least);
        }
        let calibration = Calibration {
            refinement: Refinement { estimate, ..refinement },
            resolution,
            expected: (mean / norm).sqrt(),
            at_most: ((mean + SURE * error) / norm).sqrt(),
            rows: if self.grouping.is_some() {
                errors.len() / 2
            } else {
                errors.len()
            },
            reason: String::new(),
        };
        Ok((calibration, steps))
    }

    /// The cheapest effort that keeps the tolerance with a margin, otherwise the dearest; of those that the bound of
    /// settling's work leaves untried, the one that keeps it if errors fall in proportion to efforts.
    fn search(&self, known: Refinement, norm: f64, exact: &[Tried]) -> Result<Calibration, ComputeError> {
        let [cheapest, dearer @ ..] = EFFORTS;
        let [.., dearest] = EFFORTS;
        let most = MARGIN * self.tolerance;
        let most_steps = bound(&known);
        let (mut found, mut steps) = self.try_effort(known, norm, exact, cheapest)?;
        for effort in dearer {
            if found.at_most <= most {
                break;
            }
            // An error falls with the effort at most: an effort that cannot do is not tried.
            let share = effort / found.refinement.effort;
            let hope = share * found.at_most;
            if steps >= most_steps {
                if hope <= most || effort == dearest {
                    let refinement = self.at_effort(known, effort)?;
                    found = Calibration {
                        refinement: Refinement {
                            estimate: found.refinement.estimate,
                            ..refinement
                        },
                        resolution: if known.all { FINEST } else { resolution_of(effort) },
                        expected: share * found.expected,
                        at_most: hope,
                        reason: BY_PROPORTION.to_owned(),
                        ..found
                    };
                    break;
                }
            } else if hope <= SLACK * MARGIN * self.tolerance
                || effort == dearest
                || resolution_of(effort) != found.resolution
            {
                let (tried, more) = self.try_effort(known, norm, exact, effort)?;
                (found, steps) = (tried, steps + more);
            }
        }
        Ok(found)
    }
}

/// Bound of the steps of settling's rows, or of its efforts.
fn bound(refinement: &Refinement) -> u64 {
    BOUND.max(BOUND_IN_ROWS * refinement.most_steps())
}

/// The numbers below `count`, each first part of them evenly spread: those of the even places follow those of every
/// fourth, and so on.
fn spread(count: usize) -> Vec<usize> {
    let mut numbers: Vec<usize> = (0..count).collect();
    numbers.sort_by_key(|&n| (std::cmp::Reverse(n.trailing_zeros()), n));
    numbers
}

/// `of` each of `items`, in order, on several threads with a refiner each; of some only, where it is cancelled.
fn side_by_side<T: Send>(
    execution: Execution<'_>,
    refinement: Refinement,
    items: &[usize],
    of: impl Fn(&mut Refiner<'_>, usize) -> T + Sync,
) -> Vec<T> {
    let threads = match execution.threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads,
    }
    .clamp(1, items.len().max(1));
    let next = AtomicUsize::new(0);
    let mut done: Vec<(usize, T)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|_| {
                scope.spawn(|| {
                    let mut refiner = Refiner::new(refinement, execution.cancel);
                    let mut own = Vec::new();
                    while !execution.is_cancelled() {
                        let place = next.fetch_add(1, Ordering::Relaxed);
                        let Some(&item) = items.get(place) else { return own };
                        own.push((place, of(&mut refiner, item)));
                    }
                    own
                })
            })
            .collect();
        let join = |worker: std::thread::ScopedJoinHandle<'_, Vec<(usize, T)>>| match worker.join() {
            Ok(own) => own,
            Err(panic) => std::panic::resume_unwind(panic),
        };
        workers.into_iter().flat_map(join).collect()
    });
    done.sort_by_key(|&(place, _)| place);
    done.into_iter().map(|(_, value)| value).collect()
}

fn values(pairs: &[Pair]) -> Row {
    pairs
        .iter()
        .filter(|pair| pair.factor() > 0.0)
        .map(|pair| (pair.patch, pair.factor()))
        .collect()
}

/// Σ (a − b)² of two rows with ascending patches.
fn squared_difference(a: &Row, b: &Row) -> f64 {
    let (mut at, mut sum) = (0, 0.0);
    for &(patch, value) in a {
        while at < b.len() && b[at].0 < patch {
            sum += b[at].1.powi(2);
            at += 1;
        }
        if at < b.len() && b[at].0 == patch {
            sum += (value - b[at].1).powi(2);
            at += 1;
        } else {
            sum += value * value;
        }
    }
    sum + b[at..].iter().map(|e| e.1.powi(2)).sum::<f64>()
}

fn seen(row: RowView<'_>) -> impl Iterator<Item = (u32, f64)> + '_ {
    row.patches
        .iter()
        .zip(row.visible)
        .zip(row.covered)
        .map(|((&patch, &visible), &covered)| (patch, fraction(visible, covered)))
}

/// One hemicube for each row.
fn hemicubes(
    model: &Model,
    rows: &[InputPatch],
    rotate: bool,
    resolution: u32,
    backend: &mut dyn HemicubeBackend,
) -> Result<RowBlock, ComputeError> {
    let settings = RenderSettings {
        resolution,
        culling: Culling::On,
        covered: true,
    };
    backend
        .load_for_fractions(model.geometry(), settings)
        .map_err(|source| ComputeError::Backend {
            backend: backend.info().name.clone(),
            source,
        })?;
    let mut block = RowBlock::default();
    let asked: Vec<_> = rows.iter().flat_map(|&row| model.hemicubes(row, 1, rotate)).collect();
    let first = rows.first().copied().unwrap_or(InputPatch(0));
    render(model, settings, backend, first, &asked, &mut block)?;
    Ok(block)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_parts_of_a_spread_sample_are_spread() {
        for count in [0, 1, 7, 64, 100] {
            let numbers = spread(count);
            let mut sorted = numbers.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, (0..count).collect::<Vec<_>>());
        }
        let numbers = spread(64);
        for first in [8, 16, 32] {
            let mut part = numbers[..first].to_vec();
            part.sort_unstable();
            let largest = part.windows(2).map(|pair| pair[1] - pair[0]).max();
            assert_eq!(largest, Some(64 / first), "{part:?}");
        }
    }
}
