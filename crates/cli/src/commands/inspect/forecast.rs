//! The forecast of a matrix: entries, bytes, memory and seconds, from the hemicubes of a random sample of patches.

use crate::args::{RenderSettings as RenderArguments, Switch, Talk};
use crate::forecast::{self, Rows};
use crate::report;
use anyhow::Result;
use hemicube::Model;
use hemicube::accuracy::correct::Correction;
use hemicube::backend::{Culling, HemicubeBackend, RenderSettings};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection, compute};
use hemicube::factor::FactorRule;
use hemicube::row::RowBlock;
use hemicube::store::Part;
use serde::Serialize;

/// Patches rendered for the statistics of a row.
const SAMPLE: u32 = 64;
/// Rows for the forecast of entries and time: some see a hundred times as much as others.
const FORECAST_ROWS: u32 = 256;

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

/// Entries and one thread's seconds of all rows, from rows computed with the built-in settings of `compute`.
fn entries_and_seconds(
    model: &Model,
    render: &RenderArguments,
    plan: &Plan,
    settings: RenderSettings,
) -> Result<(f64, f64)> {
    let mut summary = None;
    // The first round fetches the scene into the caches, like the start of a full run; the second is measured.
    for _ in 0..2 {
        let mut parts: Vec<Part> = Vec::new();
        summary = Some(compute(
            model,
            plan,
            settings,
            render.open_backend(Talk::SILENT)?,
            Execution {
                threads: 1,
                ..Execution::default()
            },
            &mut parts,
            &mut |_| {},
        )?);
    }
    let patch_count = model.patches().len() as f64;
    Ok(summary.map_or((0.0, 0.0), |s| {
        let share = patch_count / (s.rows.max(1)) as f64;
        (s.entries as f64 * share, s.elapsed.as_secs_f64() * share)
    }))
}

/// Forecasts a run of all rows by the settings.
///
/// # Errors
/// When the backend fails.
pub(super) fn forecast(
    model: &Model,
    render: &RenderArguments,
    seed: u64,
    backend: &mut dyn HemicubeBackend,
) -> Result<Forecast> {
    let rotate = render.rotation == Switch::On;
    let plan = |count: u32| {
        let choice = RowChoice::Sample { count, seed };
        Plan::new(model, choice, Selection::default(), render.samples.per_edge, rotate)
    };
    let settings = RenderSettings {
        resolution: render.resolution,
        culling: Culling::On,
        covered: false,
    };
    backend.load(model.geometry(), settings)?;
    let sight = Sight::measure(model, render, &plan(SAMPLE), backend)?;
    let corrected = plan(FORECAST_ROWS).with_correction(Correction::Area(FactorRule::for_tolerance(1e-2)));
    let (entries, seconds) = entries_and_seconds(model, render, &corrected, settings)?;
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
        seconds: Some(seconds / threads as f64),
    })
}
