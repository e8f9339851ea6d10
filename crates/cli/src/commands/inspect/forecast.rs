//! The forecast of a matrix: entries, bytes, memory and seconds, from the hemicubes of a random sample of patches.

use crate::args::{RenderSettings as RenderArguments, Switch, Talk};
use crate::clock::processor_seconds;
use crate::forecast::{self, Rows};
use crate::prepare::BUILT_IN;
use crate::report;
use anyhow::Result;
use hemicube::accuracy::correct::Correction;
use hemicube::backend::{Culling, HemicubeBackend, RenderSettings};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection, Summary, compute};
use hemicube::driver::probe::{Probe, strata};
use hemicube::factor::FactorRule;
use hemicube::row::RowBlock;
use hemicube::store::Part;
use hemicube::{InputPatch, Model};
use serde::Serialize;
use std::time::Instant;

/// Patches rendered for the statistics of a row.
const SAMPLE: u32 = 64;
/// Rows of each stratum for the forecast of entries and time.
const ROWS_EACH: usize = 32;
/// The most, in scenes of less than [`SMALL`] patches: rows are cheap there, and a few of them take most of the time.
const ROWS_EACH_MAX: usize = 128;
/// Patches from which on [`ROWS_EACH`] are drawn.
const SMALL: usize = 10_000;
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
        let rotate = render.rotation == Switch::On;
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
    /// Seconds of the rows of the sample.
    measured: f64,
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

impl Work {
    /// Adds a stratum of `rows` rows. `share` is the processor's share of the time that passed.
    fn add(&mut self, rows: usize, found: &Summary, share: f64) {
        let (all, n) = (rows as f64, found.rows as f64);
        if n == 0.0 {
            return;
        }
        let sum = found.row_time.as_secs_f64() * share;
        let squares = found.row_time_squared * share * share;
        self.entries += all / n * found.entries as f64;
        self.seconds += all / n * sum;
        self.measured += sum;
        if n > 1.0 {
            let spread = ((squares - sum * sum / n) / (n - 1.0)).max(0.0);
            self.variance += all * (all - n).max(0.0) * spread / n;
        }
        let slowest = found.slowest.map_or(0.0, |(_, took)| took.as_secs_f64() * share);
        self.slowest = self.slowest.max(slowest);
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

    /// Measures rows of every stratum with the built-in settings of `compute`, on one thread.
    fn measure(
        model: &Model,
        render: &RenderArguments,
        plan: &Plan,
        settings: RenderSettings,
        seed: u64,
    ) -> Result<Self> {
        let mut work = Self::default();
        let strata = strata(model, plan, rows_each(plan.rows.len()), seed);
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
            let opened = processor_seconds();
            // The first report comes once the scene is loaded.
            let mut progress = |_| {
                begun.get_or_insert_with(|| (processor_seconds(), Instant::now()));
            };
            let backend = render.open_backend(Talk::SILENT)?;
            let is_processor = backend.info().name == BUILT_IN;
            let summary = compute(model, &some, settings, backend, execution, &mut parts, &mut progress)?;
            let share = match begun {
                // Other programs take the rest.
                Some((processor, wall)) if is_processor => {
                    (processor_seconds() - processor) / wall.elapsed().as_secs_f64().max(1e-9)
                }
                _ => 1.0,
            };
            let loading = begun.map_or(0.0, |(processor, _)| processor - opened);
            anyhow::Ok((summary, share.min(1.0), loading))
        };
        // The first rows fetch the scene into the caches, like the start of a full run.
        if let Some(last) = strata.last() {
            let (.., loading) = run(&last.sample)?;
            work.start = loading;
        }
        for stratum in &strata {
            let (summary, share, _) = run(&stratum.sample)?;
            work.add(stratum.rows, &summary, share);
        }
        Ok(work)
    }
}

/// Forecasts a run of all rows by the settings. `prepared` is the processor time of starting, reading and cutting, in
/// seconds.
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
    let rotate = render.rotation == Switch::On;
    let plan = |choice| Plan::new(model, choice, Selection::default(), render.samples.per_edge, rotate);
    let settings = RenderSettings {
        resolution: render.resolution,
        culling: Culling::On,
        covered: false,
    };
    backend.load(model.geometry(), settings)?;
    let sight = Sight::measure(model, render, &plan(RowChoice::Sample { count: SAMPLE, seed }), backend)?;
    let corrected = plan(RowChoice::All).with_correction(Correction::Area(FactorRule::for_tolerance(1e-2)));
    let mut work = Work::measure(model, render, &corrected, settings, seed)?;
    // A run tries out culling before its rows.
    let began = processor_seconds();
    Probe::render(model, &corrected, settings, backend, None)?;
    work.start += prepared + processor_seconds() - began + BESIDE;
    let entries = work.entries;
    let patch_count = model.patches().len() as f64;
    let threads = render.thread_count();
    let rows = Rows {
        entries_per_row: entries / patch_count.max(1.0),
        rows_per_part: Plan::rows_per_part_of(model.patches().len()),
        rows_per_batch: u32::try_from(backend.info().preferred_rows).unwrap_or(u32::MAX),
    };
    // Includes the memory of survey and diagnosis: an upper bound.
    let memory_bytes = report::resident_memory_bytes().map(|resident| forecast::memory(resident, threads, rows));
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

    fn found(rows: u64, seconds: &[f64]) -> Summary {
        Summary {
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
        }
    }

    #[test]
    fn slow_rows_that_were_all_measured_are_certain_and_the_rest_is_an_interval() {
        let mut work = Work::default();
        work.add(2, &found(2, &[20.0, 40.0]), 1.0);
        assert_eq!((work.seconds, work.variance), (60.0, 0.0));
        assert_eq!(work.range(1), [60.0, 60.0]);
        // One row may keep two threads waiting.
        assert_eq!(work.range(2), [40.0, 50.0]);
        // The time before the rows is not divided among threads.
        let started = Work { start: 5.0, ..work };
        assert_eq!((started.range(1), started.range(2)), ([65.0, 65.0], [45.0, 55.0]));
        assert_eq!((started.run(1), started.run(2)), (65.0, 45.0));
        work.add(1000, &found(4, &[0.1, 0.1, 0.2, 0.2]), 1.0);
        assert!((work.seconds - 210.0).abs() < 1e-9 && work.entries == 10_020.0);
        let [least, most] = work.range(1);
        assert!(
            100.0 < least && least < 210.0 && 210.0 < most && most < 320.0,
            "{least} to {most}"
        );
    }

    #[test]
    fn more_rows_are_drawn_from_small_scenes() {
        let drawn = [1, 2_500, 5_000, 10_000, 1_000_000].map(rows_each);
        assert_eq!(drawn, [128, 128, 64, 32, 32]);
    }

    #[test]
    fn time_that_other_programs_take_is_not_counted() {
        let mut work = Work::default();
        work.add(10, &found(10, &[1.0; 10]), 0.25);
        assert_eq!((work.seconds, work.measured, work.slowest), (2.5, 2.5, 0.25));
    }
}
