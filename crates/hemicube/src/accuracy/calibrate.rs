//! What a tolerance takes on a given scene: the resolution and the effort, from a seeded sample of its rows.
//!
//! A few hundred rows from one hemicube each tell the norm that the tolerance is a share of; some dozens of them, held
//! against rays, how far visible fractions from one hemicube are off in this scene
//! ([`crate::accuracy::correct::PriorVariances`]). Then efforts, from the cheapest on, are tried on some rows against
//! the same rows with a quarter of the tolerance: the first that keeps the tolerance with a margin is taken. Everything
//! depends on the scene, the settings and the seed: never on a clock.
//!
//! No settled tolerance in the store, because settling again from its seed comes to the same and takes seconds; a
//! stored one would be a second truth.

use crate::Model;
use crate::accuracy::correct::fraction;
use crate::accuracy::error_model::PriorSums;
use crate::accuracy::refine::{Pair, Refinement, Refiner};
use crate::backend::{Culling, HemicubeBackend, RenderSettings, WHOLE};
use crate::driver::compute::{ComputeError, Execution, render, sample};
use crate::factor::FactorRule;
use crate::row::{RowBlock, RowView};
use hemicube_scene::InputPatch;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What to compute with so that a tolerance is kept.
///
/// ```
/// use hemicube::InputPatch;
/// use hemicube::driver::compute::Execution;
/// use hemicube::accuracy::calibrate::calibrate;
/// use hemicube_backend_cpu::CpuBackend;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model()?;
///
/// // Over all rows and columns of the room.
/// let emitters: Vec<InputPatch> = model.order().collect();
/// let mut backend = CpuBackend::new();
/// let settled = calibrate(&model, &emitters, &|_| true, true, 0.01, &mut backend, Execution::default())?;
/// assert!(settled.keeps(0.01) && !settled.keeps(0.001), "enough for what was asked, and no more");
/// assert!(settled.rows > 0 && settled.expected <= settled.at_most, "{}", settled.reason);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// How to refine rows, with what was learnt of the scene.
    pub refinement: Refinement,
    /// Pixels along an edge of the hemicube.
    pub resolution: u32,
    /// The relative Frobenius error that the rows tried had; 0 where none was tried.
    pub expected: f64,
    /// The same with a margin of standard errors for the rows not tried.
    pub at_most: f64,
    /// Rows that were tried.
    pub rows: usize,
    /// The same in words.
    pub reason: String,
}

impl Calibration {
    /// Returns whether the tolerance is expected to be kept.
    pub fn keeps(&self, tolerance: f64) -> bool {
        self.at_most <= tolerance
    }
}

const NORM_ROWS: usize = 256;
const TRIED_ROWS: usize = 64;
/// Standard errors that are added to what the rows tried have.
const SURE: f64 = 1.5;
/// Patches of a scene, and the tolerance, up to which every pair is measured by itself.
const SMALL: usize = 400;
const FINE: f64 = 2e-3;
/// What the rows tried must have of the tolerance at most, for the sake of those not tried.
const MARGIN: f64 = 0.82;
/// The finer of the resolutions of [`RUNGS`].
const FINEST: u32 = 128;
/// How much further an error may fall than in proportion to the effort.
const SLACK: f64 = 1.15;
/// No more than this is believed of rows that do so much better or worse than was expected of them.
const LEAST_ESTIMATE: f64 = 0.05;
const MOST_ESTIMATE: f64 = 4.0;
const SEED: u64 = 0x7E57_0F70;

/// Effort and resolution, from the cheapest to the dearest. Even the cheapest looks for pairs that its hemicube missed:
/// few rows of a scene have any, and a sample may have none of these.
const RUNGS: [(f64, u32); 24] = [
    (8.0, 64),
    (4.0, 64),
    (2.5, 64),
    (1.8, 128),
    (1.6, 128),
    (1.4, 128),
    (1.2, 128),
    (1.1, 128),
    (1.0, 128),
    (0.95, 128),
    (0.9, 128),
    (0.85, 128),
    (0.8, 128),
    (0.75, 128),
    (0.7, 128),
    (0.62, 128),
    (0.55, 128),
    (0.48, 128),
    (0.42, 128),
    (0.36, 128),
    (0.3, 128),
    (0.25, 128),
    (0.21, 128),
    (0.18, 128),
];

/// One row as a rung has it.
type Row = Vec<(u32, f64)>;

/// Finds what keeps `tolerance` over the rows of `emitters`. How it is run does not change it.
///
/// # Errors
/// When the backend fails or breaks the contract, and [`ComputeError::Cancelled`] when it is told to end: half of what
/// is looked at is no answer.
pub fn calibrate(
    model: &Model,
    emitters: &[InputPatch],
    receives: &(dyn Fn(u32) -> bool + Sync),
    rotate: bool,
    tolerance: f64,
    backend: &mut dyn HemicubeBackend,
    execution: Execution<'_>,
) -> Result<Calibration, ComputeError> {
    let go_on = || {
        if execution.is_cancelled() {
            Err(ComputeError::Cancelled)
        } else {
            Ok(())
        }
    };
    if model.patches().len() <= SMALL && tolerance <= FINE {
        // Few enough to look at every pair, and whoever asks for so much of so few wants each pair right.
        let each = Refinement {
            each: true,
            rule: FactorRule::for_tolerance(tolerance * 0.1),
            ..Refinement::for_tolerance(tolerance)
        };
        return Ok(Calibration {
            refinement: each,
            resolution: 128,
            expected: 0.0,
            at_most: 0.0,
            rows: 0,
            reason: format!(
                "every pair measured to the tolerance by itself, as there are only {} patches",
                model.patches().len()
            ),
        });
    }
    // A patch without area has no hemicube.
    let mut rows = sample(emitters, NORM_ROWS, SEED);
    rows.retain(|&row| !model.hemicubes(row, 1, rotate).is_empty());
    let tried: Vec<usize> = {
        let stride = rows.len().div_ceil(TRIED_ROWS).max(1);
        (0..rows.len()).step_by(stride).collect()
    };
    let coarse = hemicubes(model, &rows, rotate, 64, backend)?;
    let fine = hemicubes(model, &rows, rotate, 128, backend)?;
    let plain = Refinement {
        effort: f64::INFINITY,
        ..Refinement::for_tolerance(tolerance)
    };
    let mut refiner = Refiner::new(plain, execution.cancel);
    let mut norm = 0.0;
    for (k, &row) in rows.iter().enumerate() {
        go_on()?;
        norm += refiner.row(model, row, seen(fine.row(k)), false, receives).squared_norm;
    }
    let mean_squared_norm = norm / rows.len().max(1) as f64;
    let escaped: u64 = (0..rows.len()).map(|k| u64::from(fine.row(k).escaped)).sum();
    let known = Refinement {
        mean_squared_norm,
        is_open: escaped as f64 > tolerance * f64::from(WHOLE) * rows.len() as f64,
        all: model.patches().len() <= SMALL,
        ..Refinement::for_tolerance(tolerance)
    };
    let mut sums = PriorSums::default();
    let mut refiner = Refiner::new(known, execution.cancel);
    for &k in &tried {
        go_on()?;
        refiner.measure_priors(model, rows[k], seen(fine.row(k)), receives, &mut sums);
    }
    let known = Refinement {
        priors: sums.priors(),
        ..known
    };
    // What a squared error is worth follows from the error that an effort stands for.
    let priced = |refinement: Refinement| -> Result<Refinement, ComputeError> {
        let mut refiner = Refiner::new(refinement, execution.cancel);
        let asked: Vec<usize> = if refinement.all {
            (0..rows.len()).collect()
        } else {
            tried.clone()
        };
        let mut expected_errors = Vec::with_capacity(asked.len());
        for k in asked {
            go_on()?;
            expected_errors.push(refiner.expected_errors(model, rows[k], seen(fine.row(k)), receives));
        }
        Ok(refinement.with_multiplier_of(&expected_errors))
    };
    let row_of = |refiner: &mut Refiner<'_>, block: &RowBlock, k: usize| {
        let refined = refiner.row(model, rows[k], seen(block.row(k)), false, receives);
        (values(&refiner.pairs), refined.squared_error)
    };
    let finest = Refinement {
        rule: FactorRule::for_tolerance(tolerance * 0.1),
        ..priced(Refinement { effort: 0.25, ..known })?
    };
    let exact: Vec<Row> = side_by_side(execution, finest, &tried, |refiner, k| row_of(refiner, &fine, k).0);
    go_on()?;
    let norm = mean_squared_norm.max(f64::MIN_POSITIVE);
    let numbered: Vec<usize> = (0..tried.len()).collect();
    let try_rung = |(effort, resolution): (f64, u32)| -> Result<Calibration, ComputeError> {
        let refinement = priced(Refinement { effort, ..known })?;
        // Where all pairs are measured, hemicubes only say what escapes and what is blocked, and no rung need save
        // there.
        let resolution = if known.all { FINEST } else { resolution };
        let block = if resolution == 64 { &coarse } else { &fine };
        let found: Vec<(f64, f64)> = side_by_side(execution, refinement, &numbered, |refiner, n| {
            let (row, expected) = row_of(refiner, block, tried[n]);
            (squared_difference(&row, &exact[n]), expected)
        });
        go_on()?;
        let (errors, expected): (Vec<f64>, Vec<f64>) = found.into_iter().unzip();
        let (squared, expected): (f64, f64) = (errors.iter().sum(), expected.iter().sum());
        #[allow(clippy::cast_possible_truncation, reason = "an estimate")]
        let estimate = if expected > 0.0 {
            (squared / expected).clamp(LEAST_ESTIMATE, MOST_ESTIMATE) as f32
        } else {
            1.0
        };
        let count = errors.len().max(1) as f64;
        let mean = errors.iter().sum::<f64>() / count;
        let variance = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / (count * (count - 1.0).max(1.0));
        Ok(Calibration {
            refinement: Refinement { estimate, ..refinement },
            resolution,
            expected: (mean / norm).sqrt(),
            at_most: ((mean + SURE * variance.sqrt()) / norm).sqrt(),
            rows: errors.len(),
            reason: String::new(),
        })
    };
    let [cheapest, dearer @ ..] = RUNGS;
    let mut settled = try_rung(cheapest)?;
    let [.., dearest] = RUNGS;
    for rung in dearer {
        if settled.at_most <= MARGIN * tolerance {
            break;
        }
        // An error falls with the effort at most: what cannot do is not tried.
        let hope = rung.0 / settled.refinement.effort * settled.at_most;
        if hope <= SLACK * MARGIN * tolerance || rung == dearest || rung.1 != settled.resolution {
            settled = try_rung(rung)?;
        }
    }
    let percent = |x: f64| format!("{:.3} %", 100.0 * x);
    let verdict = if settled.keeps(tolerance) {
        ""
    } else {
        "; more than was asked for, and the most that is tried"
    };
    settled.reason = format!(
        "visible fractions refined with effort {}, N = {}: {} off on {} rows tried, at most about {}{verdict}",
        settled.refinement.effort,
        settled.resolution,
        percent(settled.expected),
        settled.rows,
        percent(settled.at_most),
    );
    Ok(settled)
}

/// `of` each of `items`, in order, by several threads with a refiner each; of some only, where it is told to end.
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
