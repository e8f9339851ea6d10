//! Settling of a tolerance on a scene, in one pass over a seeded sample of its rows.
//!
//! 256 rows, from one hemicube each, tell the norm that the tolerance is relative to. 64 of them, compared with rays,
//! tell the error of visible fractions from one hemicube in this scene, the prior variances
//! ([`crate::accuracy::correct::PriorVariances`]), and the variance that rays leave
//! ([`crate::accuracy::error_model::RayGain`]). The multiplier λ at which the sample leaves 0.9 of the tolerance follows
//! from these. The rows are then done once. Where they expect a larger error, or more than the tolerance at three
//! standard errors, the error aimed at shrinks in proportion, and λ follows anew. Nothing is tried twice, and no row is
//! compared with a better one. Where patches are several elements, the error is that of the patches' matrix.
//! What a row sums to keeps the tolerance by itself, and so do closed forms. Everything depends on the scene, the
//! settings and the seed, never on a clock.
//!
//! Settling is bounded, as rows are: its rows take the steps of four rows' bounds, and what is under way then; eight are
//! done at least, evenly from the sample.
//!
//! No calibration in the store, because calibrating again from its seed gives the same and takes part of a second; a
//! stored one would be a second truth.

mod grouped;

use crate::accuracy::caster::Caster;
use crate::accuracy::correct::fraction;
use crate::accuracy::error_model::PriorSums;
use crate::accuracy::refine::{Pair, Refined, Refinement, Refiner, exact};
use crate::backend::{Culling, HemicubeBackend, RenderSettings, WHOLE};
use crate::driver::compute::{ComputeError, Execution, render, sample};
use crate::factor::FactorRule;
use crate::row::{RowBlock, RowView};
use crate::store::ERRORS;
use crate::visibility::spaces::Spaces;
use crate::{Grouping, Model};
use grouped::{Draw, added_up, mean_and_error, mean_norm, of_patch, share_of_elements};
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
    /// Relative Frobenius error that the rows done expect; 0 where none was done.
    pub expected: f64,
    /// `expected` with three standard errors added, of other rows and of chance.
    pub at_most: f64,
    /// Number of rows done.
    pub rows: usize,
    /// Resolution and errors in words.
    pub reason: String,
}

impl Calibration {
    /// Returns whether the tolerance is expected to be kept.
    pub fn keeps(&self, tolerance: f64) -> bool {
        self.at_most <= tolerance * (1.0 + 1e-9)
    }
}

/// Rows that the norm is estimated from, at most.
const NORM_ROWS: usize = 256;
/// Rows of them that are compared with rays and done.
const TRIED_ROWS: usize = 64;
/// Error that pairs are measured for, in parts of the tolerance: matrices are off by up to 1.2 times what is expected
/// (`scoreboard board`, measured over expected), as errors behind one edge are not independent.
const AIM: f64 = 0.9;
/// Patches of a scene, and the tolerance, up to which every pair is measured to a bound of its own: a room of 300 takes
/// less than half the time that rays took at 0.2 %.
const SMALL: usize = 400;
const FINE: f64 = 2e-3;
/// Tolerance that no number of rays keeps, and patches of a scene up to which every pair is then measured by itself.
const FINEST_OF_RAYS: f64 = 0.99e-5;
const MANY: usize = 4096;
/// Bound of the steps of the rows done, in bounds of a row: at 1 %, about four seconds of one thread. A choice: with more,
/// scenes of many occluders settle later; with less, of fewer rows.
const BOUND_IN_ROWS: u64 = 4;
/// Number of rows that are done at once, and the least number done.
const CHUNK: usize = 4;
const TRIED_AT_LEAST: usize = 8;
/// Patches seen after which no further row is drawn for the norm alone. A choice: with more, settling takes more memory
/// and time where each patch sees much of the scene; with fewer, the norm is of fewer rows.
const NORM_ENTRIES: usize = 1_000_000;
/// Seed of the sample.
const SEED: u64 = 0x7E57_0F70;
/// Pixels along an edge, at every tolerance: a choice. With fewer, more pairs are seen in part; with more, rendering takes
/// longer.
pub(crate) const RESOLUTION: u32 = 128;

/// Columns and form factors of a row.
type Row = Vec<(u32, f64)>;

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

/// Finds the refinement that keeps `tolerance` over the rows of `emitters`: of their patches, where those are several
/// elements. Threads do not change it.
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
    let tried: Vec<usize> = (0..own).step_by(stride).collect();
    // Of grouped patches all rows: they are added up by their places.
    let first = if grouping.is_some() {
        (0..rows.len()).collect()
    } else {
        tried.clone()
    };
    let (drawn, kept) = draw(model, &rows, first, rotate, backend)?;
    let sample = Sample {
        of: elements.len(),
        tried: tried.iter().filter_map(|k| kept.binary_search(k).ok()).collect(),
        rows: kept.into_iter().map(|k| rows[k]).collect(),
        drawn,
        weights,
        grouping,
        model,
        spaces: Spaces::of(model),
        receives,
        tolerance,
        execution,
    };
    let (known, norm) = sample.learn()?;
    sample.settle(known, norm)
}

/// Every pair measured to the tolerance by itself: for scenes with few pairs, and a tolerance that wants each right.
fn each_pair(model: &Model, tolerance: f64) -> Calibration {
    Calibration {
        refinement: Refinement {
            each: true,
            rule: FactorRule::exact(),
            ..Refinement::for_tolerance(tolerance)
        },
        resolution: RESOLUTION,
        expected: 0.0,
        at_most: 0.0,
        rows: 0,
        reason: format!(
            "every pair measured to the tolerance by itself, as there are only {} patches",
            model.patches().len()
        ),
    }
}

/// A sample of a scene's rows, one hemicube each.
struct Sample<'a> {
    /// Number of rows that it is of.
    of: usize,
    model: &'a Model,
    spaces: Arc<Spaces>,
    receives: &'a (dyn Fn(u32) -> bool + Sync),
    tolerance: f64,
    execution: Execution<'a>,
    rows: Vec<InputPatch>,
    /// Places in `rows` of the rows that are done.
    tried: Vec<usize>,
    drawn: Drawn,
    /// The patches of elements. The second half of `rows` then are other elements of the patches of the first half,
    /// whose weights in their patches are here.
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
    fn seen(&self, k: usize) -> impl Iterator<Item = (u32, f64)> + '_ {
        let of = self.rows[k].0;
        seen(self.drawn.row(k)).filter(move |&(patch, _)| !self.spaces.separate(of, patch))
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
        let count = self.rows.len();
        let plain = Refinement {
            effort: f64::INFINITY,
            ..Refinement::for_tolerance(self.tolerance)
        };
        let mut refiner = self.refiner(plain);
        let (mut norm, mut rows) = (0.0, Vec::new());
        for k in 0..count {
            self.go_on()?;
            norm += refiner
                .row(
                    model,
                    self.rows[k],
                    self.seen(k),
                    false,
                    self.receivers(k),
                    &mut Caster::none(),
                )
                .squared_norm;
            if self.grouping.is_some() {
                rows.push(self.of_patches(values(&refiner.pairs)));
            }
        }
        let escaped: u64 = (0..count).map(|k| u64::from(self.drawn.row(k).escaped)).sum();
        let known = Refinement {
            mean_squared_norm: norm / count.max(1) as f64,
            is_open: escaped as f64 > self.tolerance * f64::from(WHOLE) * count as f64,
            ..Refinement::for_tolerance(self.tolerance)
        };
        let mut sums = PriorSums::default();
        let mut refiner = self.refiner(known);
        for &k in &self.tried {
            self.go_on()?;
            refiner.measure_priors(model, self.rows[k], self.seen(k), self.receivers(k), &mut sums);
        }
        let norm = match self.grouping {
            Some(_) => {
                let own = self.weights.len();
                let of = |(k, &weight): (usize, &f64)| of_patch(weight, &rows[k], &rows[own + k]);
                mean_norm(&self.weights.iter().enumerate().map(of).collect::<Vec<f64>>())
            }
            None => known.mean_squared_norm,
        };
        let (priors, gain) = (sums.priors(), sums.ray_gain());
        Ok((Refinement { priors, gain, ..known }, norm))
    }

    /// `known` at an effort, with the multiplier λ at which the sample's rows are expected to keep it.
    fn at_effort(&self, known: Refinement, effort: f64) -> Result<Refinement, ComputeError> {
        let refinement = Refinement { effort, ..known };
        let mut refiner = self.refiner(refinement);
        let mut expected_errors = Vec::with_capacity(self.tried.len());
        for &k in &self.tried {
            self.go_on()?;
            expected_errors.push(refiner.expected_errors(self.model, self.rows[k], self.seen(k), self.receivers(k)));
        }
        Ok(refinement.with_multiplier_of(&expected_errors))
    }

    /// Expected Σ (F − true F)² of the rows done at a refinement, with the places in `rows` that they have.
    fn done(&self, refinement: Refinement) -> Result<Vec<(usize, Refined)>, ComputeError> {
        let most_steps = BOUND_IN_ROWS * refinement.most_steps();
        let (mut steps, mut done) = (0, Vec::with_capacity(self.tried.len()));
        for chunk in spread(self.tried.len()).chunks(CHUNK) {
            let places: Vec<usize> = chunk.iter().map(|&n| self.tried[n]).collect();
            let found = side_by_side(self.execution, refinement, &places, |refiner, k| {
                refiner.row(
                    self.model,
                    self.rows[k],
                    self.seen(k),
                    false,
                    self.receivers(k),
                    &mut Caster::none(),
                )
            });
            self.go_on()?;
            steps += found.iter().map(|refined| refined.steps).sum::<u64>();
            done.extend(places.into_iter().zip(found));
            if steps >= most_steps && done.len() >= TRIED_AT_LEAST {
                break;
            }
        }
        Ok(done)
    }

    /// The refinement that keeps the tolerance relative to `norm`, the mean of Σ F² over the rows of the matrix.
    fn settle(&self, known: Refinement, norm: f64) -> Result<Calibration, ComputeError> {
        let norm = norm.max(f64::MIN_POSITIVE);
        // What an element's error counts for in its patch's, and so how far its own may be off.
        let share = |place: usize| self.weights.get(place).map_or(1.0, |&weight| share_of_elements(weight));
        let mean_share = match self.weights.len() {
            0 => 1.0,
            count => {
                self.weights
                    .iter()
                    .map(|&weight| share_of_elements(weight))
                    .sum::<f64>()
                    / count as f64
            }
        };
        let of_rows = known.mean_squared_norm.max(f64::MIN_POSITIVE);
        let effort = AIM * (norm / (of_rows * mean_share)).sqrt();
        let first = self.at_effort(known, effort)?;
        let done = self.done(first)?;
        let errors: Vec<f64> = done
            .iter()
            .map(|&(k, refined)| share(k) * refined.squared_error)
            .collect();
        let (mean, error) = mean_and_error(&errors);
        // The matrix's mean of squared errors differs from that expected of its sample: other rows have others, and few
        // pairs that make up much of it may all be off by more than they are expected to. ν pairs of equal variances
        // leave χ²_ν / ν of it, of the variance 2 / ν.
        let (sampled, all) = (done.len().max(1) as f64, self.of.max(done.len()).max(1) as f64);
        let of_chance = done
            .iter()
            .map(|&(k, refined)| 2.0 * share(k).powi(2) * refined.squared_variances);
        let variance = error * error * (1.0 - sampled / all) + of_chance.sum::<f64>() / (sampled * all);
        let found = (mean / norm).sqrt();
        let most = ((mean + ERRORS * variance.sqrt()) / norm).sqrt();
        // Errors fall in proportion to the effort.
        let scale = (AIM * self.tolerance / found).min(self.tolerance / most).min(1.0);
        let refinement = if scale < 1.0 {
            self.at_effort(known, effort * scale)?
        } else {
            first
        };
        let expected = scale * found;
        let at_most = scale * most;
        let percent = |x: f64| format!("{:.3} %", 100.0 * x);
        Ok(Calibration {
            refinement,
            resolution: RESOLUTION,
            expected,
            at_most,
            rows: done.len(),
            reason: format!(
                "N = {RESOLUTION}, an error of {} expected by {} sampled rows{}, at most about {}{}",
                percent(expected),
                done.len(),
                self.grouping.map_or_else(String::new, |grouping| format!(
                    ", added up by {}",
                    grouping.kind().name()
                )),
                percent(at_most),
                if at_most <= self.tolerance * (1.0 + 1e-9) {
                    ""
                } else {
                    "; more than was asked for"
                },
            ),
        })
    }
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

fn seen(row: RowView<'_>) -> impl Iterator<Item = (u32, f64)> + '_ {
    row.patches
        .iter()
        .zip(row.visible)
        .zip(row.covered)
        .map(|((&patch, &visible), &covered)| (patch, fraction(visible, covered)))
}

/// Rows of one hemicube each, rendered a chunk at a time.
struct Drawn {
    chunks: Vec<RowBlock>,
    /// The chunk of each row, and its place there.
    place: Vec<(usize, usize)>,
}

impl Drawn {
    /// The k-th row.
    fn row(&self, k: usize) -> RowView<'_> {
        let (chunk, place) = self.place[k];
        self.chunks[chunk].row(place)
    }
}

/// Draws one hemicube for each of the rows: those at the places `first`, ascending, and others, evenly spread, while all
/// together see fewer than [`NORM_ENTRIES`] patches. Returns them with their places in `rows`, ascending.
fn draw(
    model: &Model,
    rows: &[InputPatch],
    first: Vec<usize>,
    rotate: bool,
    backend: &mut dyn HemicubeBackend,
) -> Result<(Drawn, Vec<usize>), ComputeError> {
    let settings = RenderSettings {
        resolution: RESOLUTION,
        culling: Culling::On,
        covered: true,
    };
    backend
        .load_for_fractions(model.geometry(), settings)
        .map_err(|source| ComputeError::Backend {
            backend: backend.info().name.clone(),
            source,
        })?;
    let others: Vec<usize> = spread(rows.len())
        .into_iter()
        .filter(|k| first.binary_search(k).is_err())
        .collect();
    let (mut chunks, mut places, mut entries) = (Vec::new(), Vec::with_capacity(rows.len()), 0);
    for chunk in std::iter::once(&*first).chain(others.chunks(first.len().max(1))) {
        if chunk.is_empty() || entries >= NORM_ENTRIES {
            break;
        }
        let asked: Vec<_> = chunk
            .iter()
            .flat_map(|&k| model.hemicubes(rows[k], 1, rotate))
            .collect();
        let mut block = RowBlock::default();
        render(model, settings, backend, rows[chunk[0]], &asked, &mut block)?;
        entries += (0..chunk.len())
            .map(|place| block.row(place).patches.len())
            .sum::<usize>();
        places.extend(chunk.iter().enumerate().map(|(place, &k)| (k, (chunks.len(), place))));
        chunks.push(block);
    }
    places.sort_unstable();
    let (kept, place) = places.into_iter().unzip();
    Ok((Drawn { chunks, place }, kept))
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
