//! A few trial hemicubes, spread over a plan: whether culling pays, and how many entries rows have.

use crate::Model;
use crate::backend::{Counters, Culling, HemicubeBackend, RenderSettings};
use crate::driver::compute::{ComputeError, Plan, load, sample};
use crate::row::RowBlock;
use crate::sampling::splitmix;
use hemicube_scene::InputPatch;
use std::sync::atomic::{AtomicBool, Ordering};

/// Hemicubes that measure culling.
const CULLING_PROBES: usize = 16;

/// Most hemicubes that measure entries.
const ENTRY_PROBES: usize = 256;

/// Share of the triangles left by culling from which its tests cost more than they save.
const CULLING_PAYS_BELOW: f64 = 0.97;

/// Findings of the trial hemicubes.
///
/// They forecast the size of a matrix before it is computed:
///
/// ```
/// use hemicube::driver::probe::Probe;
/// use hemicube_backend_cpu::CpuBackend;
/// # use hemicube::accuracy::correct::Correction;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model()?;
/// # let (plan, settings) = (room::plan(&model, Correction::Pixel), room::RENDER);
///
/// let probe = Probe::render(&model, &plan, settings, &mut CpuBackend::new(), None)?;
/// let forecast = probe.entries_per_row * plan.rows.len() as f64;
/// let entries: usize = room::parts(&model, Correction::Pixel)?.iter().map(|part| part.data.len()).sum();
/// assert!((forecast / entries as f64 - 1.0).abs() < 0.2, "{forecast} forecast, {entries} computed");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Number of hemicubes of `left`.
    pub hemicubes: u64,
    /// Share of the triangles left by culling.
    pub left: f64,
    /// Entries of a row, on average.
    pub entries_per_row: f64,
}

impl Probe {
    /// Renders trial hemicubes of `plan`. Leaves the model loaded into the backend, with `settings` and the needs of
    /// the plan's correction.
    ///
    /// # Errors
    /// When the backend fails, and [`ComputeError::Cancelled`] when `cancel` becomes true.
    pub fn render(
        model: &Model,
        plan: &Plan,
        settings: RenderSettings,
        backend: &mut dyn HemicubeBackend,
        cancel: Option<&AtomicBool>,
    ) -> Result<Self, ComputeError> {
        let probes: Vec<InputPatch> = (0..CULLING_PROBES)
            .filter_map(|probe| plan.rows.get(probe * plan.rows.len() / CULLING_PROBES).copied())
            .collect();
        let hemicubes: Vec<_> = probes
            .iter()
            .flat_map(|&patch| model.hemicubes(patch, 1, plan.rotate))
            .collect();
        let name = backend.info().name.clone();
        let failed = |source| ComputeError::Backend {
            backend: name.clone(),
            source,
        };
        load(model, &plan.correction, settings, backend)?;
        let mut block = RowBlock::default();
        let counters = backend.rows(&hemicubes, &mut block).map_err(failed)?;
        // Entries vary more from row to row than the effect of culling.
        let count = (plan.rows.len() / 32).clamp(CULLING_PROBES, ENTRY_PROBES);
        let more: Vec<_> = (0..count)
            .filter_map(|probe| plan.rows.get((2 * probe + 1) * plan.rows.len() / (2 * count)))
            .flat_map(|&patch| model.hemicubes(patch, 1, plan.rotate))
            .collect();
        let mut seen = counters.hemicubes;
        for batch in more.chunks(backend.info().preferred_rows.max(1)) {
            if cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
                return Err(ComputeError::Cancelled);
            }
            seen += backend.rows(batch, &mut block).map_err(failed)?.hemicubes;
        }
        Ok(Self {
            hemicubes: counters.hemicubes,
            left: share_left(&counters, model.geometry().surfaces.len()),
            entries_per_row: block.patches.len() as f64 / seen.max(1) as f64,
        })
    }

    /// Returns whether culling pays in this scene. By no clock: equal runs choose equally.
    pub fn culling(&self) -> Culling {
        if self.left > CULLING_PAYS_BELOW {
            Culling::Off
        } else {
            Culling::On
        }
    }
}

/// Rows of a plan with about the same work, and some drawn from them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stratum {
    /// Number of its rows.
    pub rows: usize,
    /// The rows drawn, in random order: the first ones of them are a sample, too.
    pub sample: Vec<InputPatch>,
}

/// The rows of `plan` in strata by expected work, the most first, with up to `each` rows drawn from every one.
///
/// A row's work grows with its hemicubes, which are many for a large patch with much on it, and then with its area. The
/// first stratum has `each` rows, and is drawn whole; each of the others has three times as many rows as all before it.
/// So the few rows that take most of the time are in the sample, which a random one misses.
///
/// ```
/// use hemicube::driver::probe::strata;
/// # use hemicube::accuracy::correct::Correction;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model()?;
/// # let plan = room::plan(&model, Correction::Pixel);
///
/// let strata = strata(&model, &plan, 8, 1);
/// assert_eq!(strata.iter().map(|stratum| stratum.rows).collect::<Vec<_>>(), [8, 24, 96, 32]);
/// assert!(strata.iter().all(|stratum| stratum.sample.len() == 8));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn strata(model: &Model, plan: &Plan, each: usize, seed: u64) -> Vec<Stratum> {
    let work = |&patch: &InputPatch| (plan.per_edge(model, patch), model.patches().area(patch));
    let mut rows: Vec<((u32, f64), InputPatch)> = plan.rows.iter().map(|patch| (work(patch), *patch)).collect();
    // Stable: patches of one size stay in the order of work.
    rows.sort_by(|(a, _), (b, _)| b.0.cmp(&a.0).then(b.1.total_cmp(&a.1)));
    let rows: Vec<InputPatch> = rows.into_iter().map(|(_, patch)| patch).collect();
    let (mut found, mut start, mut end) = (Vec::new(), 0, each.max(1));
    while start < rows.len() {
        let of = &rows[start..end.min(rows.len())];
        let mut sample = sample(of, each, seed);
        sample.sort_by_key(|row| splitmix::hash(seed ^ u64::from(row.0)));
        found.push(Stratum { rows: of.len(), sample });
        (start, end) = (end, end.saturating_mul(4));
    }
    found
}

/// Share of the triangles that were transformed, over the hemicubes.
pub fn share_left(counters: &Counters, surfaces: usize) -> f64 {
    let all = counters.hemicubes as f64 * surfaces as f64;
    // Blocks of triangles may count their padding.
    if all > 0.0 {
        (counters.triangles_transformed as f64 / all).min(1.0)
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_that_culling_leaves() {
        let counters = Counters {
            hemicubes: 4,
            triangles_transformed: 100,
            ..Counters::default()
        };
        assert_eq!(share_left(&counters, 100), 0.25);
        assert_eq!(share_left(&counters, 20), 1.0);
        assert_eq!(share_left(&Counters::default(), 20), 1.0);
    }
}
