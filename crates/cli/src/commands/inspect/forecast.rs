//! The forecast of a matrix: entries, bytes, memory and seconds, from the hemicubes of a random sample of patches.

use crate::args::RenderSettings as RenderArguments;
use crate::clock::processor_seconds;
use crate::forecast::{self, Rows, steps};
use crate::prepare::BUILT_IN;
use crate::report;
use anyhow::Result;
use hemicube::backend::{
    BackendError, BackendInfo, Counters, Culling, Geometry, Hemicube, HemicubeBackend, Rays, RenderSettings,
};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection, Summary, compute, load};
use hemicube::driver::level::Level;
use hemicube::driver::probe::{Probe, strata};
use hemicube::row::RowBlock;
use hemicube::store::{Form, Part};
use hemicube::{InputPatch, Model};
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// Patches rendered for the statistics of a row.
const SAMPLE: u32 = 64;
/// Rows of each stratum for the forecast of entries and time.
const ROWS_EACH: usize = 32;
/// The most, in scenes of less than [`SMALL`] patches: rows are cheap there, and a few of them take most of the time.
const ROWS_EACH_MAX: usize = 128;
/// Patches from which on [`ROWS_EACH`] are drawn.
const SMALL: usize = 10_000;
/// Bound of the work of all rows measured, in steps: about a second. Divided among the strata; what one leaves goes to
/// the next. A stratum that meets its part is told by fewer rows, at least [`FIRST_ROWS`], and the interval widens.
const MOST_STEPS: u64 = 1_000_000_000;
/// Rows of a stratum measured first, whatever they cost: the fewest that tell a spread well enough.
const FIRST_ROWS: usize = 4;
/// Rows computed before those that are measured.
const WARMING_ROWS: usize = 2;
/// Rows measured next, at most, for each measured so far.
const GROWTH: usize = 4;
/// Standard errors on either side of the forecast.
const STANDARD_ERRORS: f64 = 2.0;

/// Processor time of a run beside its scene and rows, in seconds: to make, seal and sync a store's files, and to start
/// its threads. Of rooms of 20 to 60 patches, `compute` took 0.007 to 0.017 s more than that of scene and rows
/// (`scripts/forecasts`, x86-64).
const BESIDE: f64 = 0.012;

/// Bytes of a store: an entry's column and value; a row's ends, patch, weights and hemicubes; a patch in the table.
const ENTRY_BYTES: f64 = 8.0;
const COMPACT_ENTRY_BYTES: f64 = 2.6;
const ROW_BYTES: f64 = 48.0;
const PATCH_BYTES: f64 = 101.0;

/// Estimates for all rows, from a sample.
#[derive(Serialize)]
pub(super) struct Forecast {
    pub(super) sampled_rows: usize,
    pub(super) seed: u64,
    pub(super) resolution: u32,
    pub(super) samples: u32,
    pub(super) visible_median: u64,
    pub(super) visible_percentile_90: u64,
    pub(super) culled: f64,
    pub(super) entries: f64,
    pub(super) bytes: f64,
    /// With `--store compact`.
    pub(super) bytes_compact: f64,
    /// Rows computed for `entries`, `bytes` and `seconds`.
    pub(super) measured_rows: usize,
    /// Their work in steps of about a nanosecond, counted.
    pub(super) measured_steps: u64,
    /// The work of all rows in such steps.
    pub(super) steps: f64,
    /// True if these are fewer than the sample has, because their work met its bound.
    pub(super) met_bound: bool,
    pub(super) threads: usize,
    /// Upper bound of the memory of a run of all rows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) memory_bytes: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) seconds: Option<f64>,
    /// The interval of the seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) seconds_range: Option<[f64; 2]>,
}

/// Patches in sight of sampled rows, and the work of their hemicubes.
struct Sight {
    /// Number of patches in sight of each sampled patch, ascending.
    visible: Vec<u64>,
    hemicubes: u64,
    triangles_transformed: u64,
}

impl Sight {
    fn measure(
        model: &Model,
        render: &RenderArguments,
        plan: &Plan,
        backend: &mut dyn HemicubeBackend,
    ) -> Result<Self> {
        let mut found = Self {
            visible: Vec::new(),
            hemicubes: 0,
            triangles_transformed: 0,
        };
        let rotate = true;
        let mut block = RowBlock::default();
        for &patch in &plan.rows {
            let hemicubes = model.hemicubes(patch, render.samples.per_edge, rotate);
            if hemicubes.is_empty() {
                continue;
            }
            block.clear();
            let counters = backend.rows(&hemicubes, &mut block)?;
            found.hemicubes += counters.hemicubes;
            found.triangles_transformed += counters.triangles_transformed;
            let mut seen: Vec<u32> = block
                .patches
                .iter()
                .zip(&block.visible)
                .filter(|&(_, &weight)| weight > 0)
                .map(|(&p, _)| p)
                .collect();
            seen.sort_unstable();
            seen.dedup();
            found.visible.push(seen.len() as u64);
        }
        found.visible.sort_unstable();
        Ok(found)
    }

    fn percentile(&self, percent: usize) -> u64 {
        let place = (self.visible.len() * percent).div_ceil(100).saturating_sub(1);
        self.visible.get(place).copied().unwrap_or(0)
    }

    /// Share of the triangles of `surfaces` spared by culling.
    fn culled(&self, surfaces: usize) -> f64 {
        let all = self.hemicubes as f64 * surfaces as f64;
        if all > 0.0 {
            (1.0 - self.triangles_transformed as f64 / all).max(0.0)
        } else {
            0.0
        }
    }
}

/// Entries of all rows, and one thread's seconds for them, by a stratified sample (Cochran 1977, *Sampling Techniques*,
/// chapter 5).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Work {
    entries: f64,
    seconds: f64,
    /// Square of the standard error of `seconds`.
    variance: f64,
    /// Rows of the sample, their work in steps, and their seconds.
    rows: usize,
    steps: u64,
    /// Steps of all rows.
    all_steps: f64,
    measured: f64,
    /// True if the bound of work left rows of the sample unmeasured.
    met_bound: bool,
    /// Seconds of its slowest row.
    slowest: f64,
    /// Seconds beside the rows, on one thread: to start, read and cut the scene, load it into the backend, try out
    /// culling, and make the store.
    start: f64,
}

/// Rows drawn from each stratum of a scene of `patches`.
fn rows_each(patches: usize) -> usize {
    (ROWS_EACH * SMALL / patches.max(1)).clamp(ROWS_EACH, ROWS_EACH_MAX)
}

/// Rows of a stratum that were measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Measured {
    rows: usize,
    entries: f64,
    /// Sum of their seconds, and of their squares.
    sum: f64,
    squares: f64,
    slowest: f64,
    /// Their work, in steps.
    steps: u64,
}

impl Measured {
    /// Adds rows. `share` is the processor's share of the time that passed.
    fn add(&mut self, found: &Summary, share: f64) {
        self.rows += usize::try_from(found.rows).unwrap_or(usize::MAX);
        self.entries += found.entries as f64;
        self.sum += found.row_time.as_secs_f64() * share;
        self.squares += found.row_time_squared * share * share;
        let slowest = found.slowest.map_or(0.0, |(_, took)| took.as_secs_f64() * share);
        self.slowest = self.slowest.max(slowest);
        self.steps += steps(found);
    }

    /// Number of the rows to measure next within `left` steps, by those measured so far: at first [`FIRST_ROWS`], then
    /// at most [`GROWTH`] times as many as there are; 0 if no further row is paid for.
    fn next(&self, left: u64) -> usize {
        if self.rows == 0 {
            return FIRST_ROWS;
        }
        let paid = left.saturating_mul(self.rows as u64) / self.steps.max(1);
        usize::try_from(paid).unwrap_or(usize::MAX).min(GROWTH * self.rows)
    }
}

/// Factor by which [`STANDARD_ERRORS`] standard errors grow where a few rows tell the spread: Student's quantile of
/// 97.5 % over that of many.
fn student(rows: usize) -> f64 {
    const FEW: [f64; 7] = [6.48, 2.20, 1.62, 1.42, 1.31, 1.25, 1.21];
    let degrees = rows.saturating_sub(1).max(1);
    FEW.get(degrees - 1).copied().unwrap_or(1.0 + 1.4 / degrees as f64)
}

impl Work {
    /// Adds a stratum of `rows` rows.
    fn add(&mut self, rows: usize, found: &Measured) {
        let (all, n) = (rows as f64, found.rows as f64);
        if found.rows == 0 {
            return;
        }
        self.entries += all / n * found.entries;
        self.seconds += all / n * found.sum;
        self.all_steps += all / n * found.steps as f64;
        self.measured += found.sum;
        self.rows += found.rows;
        self.steps += found.steps;
        if found.rows > 1 {
            let spread = ((found.squares - found.sum * found.sum / n) / (n - 1.0)).max(0.0);
            self.variance += student(found.rows).powi(2) * all * (all - n).max(0.0) * spread / n;
        }
        self.slowest = self.slowest.max(found.slowest);
    }

    /// The least and the most seconds of a run by some threads. At its end, all but one may wait for the slowest row.
    fn range(&self, threads: usize) -> [f64; 2] {
        let threads = threads.max(1) as f64;
        let error = STANDARD_ERRORS * self.variance.sqrt();
        let least = (self.seconds - error).max(self.measured) / threads;
        let most = (self.seconds + error) / threads + self.slowest * (1.0 - 1.0 / threads);
        [least, most].map(|seconds| self.start + seconds.max(self.slowest))
    }

    /// Seconds of a run by some threads.
    fn run(&self, threads: usize) -> f64 {
        self.start + (self.seconds / threads.max(1) as f64).max(self.slowest)
    }

    /// Measures rows of every stratum with the settings of the run, on one thread, by a backend that has the
    /// scene.
    fn measure(
        model: &Model,
        backend: &dyn HemicubeBackend,
        plan: &Plan,
        settings: RenderSettings,
        seed: u64,
    ) -> Result<Self> {
        let mut work = Self::default();
        let strata = strata(model, plan, rows_each(plan.rows.len()), seed);
        let is_processor = backend.info().name == BUILT_IN;
        let run = |sample: &[InputPatch]| {
            let some = Plan {
                rows: sample.to_vec(),
                ..plan.clone()
            };
            let execution = Execution {
                threads: 1,
                ..Execution::default()
            };
            let (mut parts, mut begun) = (Vec::<Part>::new(), None);
            // The first report comes before the first row.
            let mut progress = |_| {
                begun.get_or_insert_with(|| (processor_seconds(), Instant::now()));
            };
            let session = Box::new(Loaded(backend.fork()?));
            let summary = compute(model, &some, settings, session, execution, &mut parts, &mut progress)?;
            let share = match begun {
                // Other programs take the rest.
                Some((processor, wall)) if is_processor => {
                    (processor_seconds() - processor) / wall.elapsed().as_secs_f64().max(1e-9)
                }
                _ => 1.0,
            };
            anyhow::Ok((summary, share.min(1.0)))
        };
        // The first rows fetch the scene into the caches, like the start of a full run.
        let mut left = MOST_STEPS;
        if let Some(last) = strata.last() {
            let (summary, _) = run(&last.sample[..last.sample.len().min(WARMING_ROWS)])?;
            left = left.saturating_sub(steps(&summary));
        }
        for (place, stratum) in strata.iter().enumerate() {
            // What a stratum leaves goes to those after it.
            let allowed = left / (strata.len() - place) as u64;
            let mut found = Measured::default();
            while found.rows < stratum.sample.len() {
                let next = found.next(allowed.saturating_sub(found.steps));
                if next == 0 {
                    work.met_bound = true;
                    break;
                }
                let end = stratum.sample.len().min(found.rows.saturating_add(next));
                let (summary, share) = run(&stratum.sample[found.rows..end])?;
                if summary.rows == 0 {
                    break;
                }
                found.add(&summary, share);
            }
            left = left.saturating_sub(found.steps);
            work.add(stratum.rows, &found);
        }
        Ok(work)
    }
}

/// A session over a scene that is loaded already: to load 40,000 patches takes half a second.
struct Loaded(Box<dyn HemicubeBackend>);

impl HemicubeBackend for Loaded {
    fn info(&self) -> &BackendInfo {
        self.0.info()
    }

    /// Keeps what is loaded.
    fn load(&mut self, _: &Arc<Geometry>, _: RenderSettings) -> Result<(), BackendError> {
        Ok(())
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        self.0.fork()
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        self.0.rows(hemicubes, out)
    }

    fn rays(&mut self, rays: &Rays<'_>) -> Result<Vec<u32>, BackendError> {
        self.0.rays(rays)
    }
}

/// Forecasts a run of all rows by the settings. `prepared` is the processor time of starting, reading and cutting, in
/// seconds; `backend` has the scene, as [`hemicube::diagnose::SceneStatistics::measure`] loads it.
///
/// # Errors
/// When the backend fails.
pub(super) fn forecast(
    model: &Model,
    render: &RenderArguments,
    seed: u64,
    prepared: f64,
    backend: &mut dyn HemicubeBackend,
) -> Result<Forecast> {
    let rotate = true;
    let plan = |choice| Plan::new(model, choice, Selection::default(), render.samples.per_edge, rotate);
    let settings = RenderSettings {
        resolution: render.resolution,
        culling: Culling::On,
        covered: false,
    };
    let sight = Sight::measure(model, render, &plan(RowChoice::Sample { count: SAMPLE, seed }), backend)?;
    // A tolerance is settled as a run settles it: by the same rows, and for the same time.
    let began = processor_seconds();
    let execution = Execution {
        threads: render.thread_count(),
        ..Execution::default()
    };
    let all = Selection::default();
    let level = Level::resolve(render.accuracy(), model, &all, rotate, Form::Plain, backend, execution);
    let level = level.map_err(crate::level::explain)?;
    let settling = (processor_seconds() - began) / render.thread_count().max(1) as f64;
    let settings = RenderSettings {
        resolution: level.resolution,
        ..settings
    };
    let corrected =
        Plan::new(model, RowChoice::All, all, level.samples_per_edge, rotate).with_correction(level.correction);
    // A run loads the scene to try out culling, and again for its rows.
    let began = processor_seconds();
    load(model, &corrected.correction, settings, backend)?;
    let loading = processor_seconds() - began;
    Probe::render(model, &corrected, settings, &mut Loaded(backend.fork()?), None)?;
    let start = prepared + settling + processor_seconds() - began + loading + BESIDE;
    let work = Work {
        start,
        ..Work::measure(model, backend, &corrected, settings, seed)?
    };
    let entries = work.entries;
    let patch_count = model.patches().len() as f64;
    let threads = render.thread_count();
    let rows = Rows {
        entries_per_row: entries / patch_count.max(1.0),
        rows_per_part: Plan::rows_per_part_of(model.patches().len()),
        rows_per_batch: u32::try_from(backend.info().preferred_rows).unwrap_or(u32::MAX),
    };
    // The most so far, with that of survey and diagnosis: an upper bound of what making the model takes on its way.
    let memory_bytes = report::peak_memory_bytes().map(|most| forecast::memory(most, threads, rows));
    Ok(Forecast {
        sampled_rows: sight.visible.len(),
        seed,
        resolution: render.resolution,
        samples: render.samples.per_edge * render.samples.per_edge,
        visible_median: sight.percentile(50),
        visible_percentile_90: sight.percentile(90),
        culled: sight.culled(model.geometry().surfaces.len()),
        entries,
        bytes: entries * ENTRY_BYTES + patch_count * (ROW_BYTES + PATCH_BYTES),
        bytes_compact: entries * COMPACT_ENTRY_BYTES + patch_count * (ROW_BYTES + PATCH_BYTES),
        measured_rows: work.rows,
        measured_steps: work.steps,
        steps: work.all_steps,
        met_bound: work.met_bound,
        memory_bytes,
        threads,
        seconds: Some(work.run(threads)),
        seconds_range: Some(work.range(threads)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn found(rows: u64, seconds: &[f64], share: f64) -> Measured {
        let summary = Summary {
            rows,
            entries: 10 * rows,
            row_time: Duration::from_secs_f64(seconds.iter().sum()),
            row_time_squared: seconds.iter().map(|s| s * s).sum(),
            slowest: seconds
                .iter()
                .copied()
                .reduce(f64::max)
                .map(|s| (InputPatch(0), Duration::from_secs_f64(s))),
            ..Summary::default()
        };
        let mut measured = Measured::default();
        measured.add(&summary, share);
        measured
    }

    #[test]
    fn slow_rows_that_were_all_measured_are_certain_and_the_rest_is_an_interval() {
        let mut work = Work::default();
        work.add(2, &found(2, &[20.0, 40.0], 1.0));
        assert_eq!((work.seconds, work.variance), (60.0, 0.0));
        assert_eq!(work.range(1), [60.0, 60.0]);
        // One row may keep two threads waiting.
        assert_eq!(work.range(2), [40.0, 50.0]);
        // The time before the rows is not divided among threads.
        let started = Work { start: 5.0, ..work };
        assert_eq!((started.range(1), started.range(2)), ([65.0, 65.0], [45.0, 55.0]));
        assert_eq!((started.run(1), started.run(2)), (65.0, 45.0));
        work.add(1000, &found(4, &[0.1, 0.1, 0.2, 0.2], 1.0));
        assert!((work.seconds - 210.0).abs() < 1e-9 && work.entries == 10_020.0);
        let [least, most] = work.range(1);
        assert!(
            100.0 < least && least < 210.0 && 210.0 < most && most < 320.0,
            "{least} to {most}"
        );
    }

    #[test]
    fn rows_are_measured_as_their_bound_pays_for_them() {
        let mut measured = Measured::default();
        assert_eq!(measured.next(0), FIRST_ROWS);
        (measured.rows, measured.steps) = (2, 200);
        assert_eq!(
            [0, 99, 100, 350, 100_000].map(|left| measured.next(left)),
            [0, 0, 1, 3, 8]
        );
        // Where rows cost nothing, all are measured.
        measured.steps = 0;
        assert_eq!(measured.next(10), 8);
    }

    #[test]
    fn a_few_rows_tell_less_of_the_spread() {
        let factors = [2, 3, 8, 9, 31, 1_000_000].map(student);
        assert!(factors.is_sorted_by(|few, more| few > more), "{factors:?}");
        assert!(factors[0] > 6.0 && factors[5] < 1.001, "{factors:?}");
    }

    #[test]
    fn more_rows_are_drawn_from_small_scenes() {
        let drawn = [1, 2_500, 5_000, 10_000, 1_000_000].map(rows_each);
        assert_eq!(drawn, [128, 128, 64, 32, 32]);
    }

    #[test]
    fn time_that_other_programs_take_is_not_counted() {
        let mut work = Work::default();
        work.add(10, &found(10, &[1.0; 10], 0.25));
        assert_eq!((work.seconds, work.measured, work.slowest), (2.5, 2.5, 0.25));
    }
}
