//! Sky rows and suns through mirrors and panes.
//!
//! An escaped pixel goes to the sky as ever. A pixel that shows a mirror or a pane is followed, and what of its weight
//! leaves the scene in the end goes to the patch of the sky that it leaves towards. What arrives at patches behind a
//! portal and stays there is in no column, as what is seen directly.

use super::bins::Bins;
use super::sun::mean_over;
use super::{SkyDivision, SkyOptions, SkyRow, failed};
use crate::Model;
use crate::backend::HemicubeBackend;
use crate::delta::DeltaTable;
use crate::driver::compute::ComputeError;
use crate::frame::Horizon;
use crate::points::{in_parallel, threads_of};
use crate::portal::sight::{PathEnd, ThroughPortals};
use crate::portal::{Images, Specular};
use glam::DVec3;
use hemicube_scene::InputPatch;
use std::sync::atomic::{AtomicBool, Ordering};

/// Parts of a pixel's unit of weight in paths through portals.
const FINE: u64 = 1 << 10;

/// The sky, and the mirrors and panes through which it is seen.
#[derive(Clone, Copy, Debug)]
pub struct Glazed<'a> {
    /// Its patches.
    pub division: &'a SkyDivision,
    /// Directions of up and north.
    pub horizon: Horizon,
    /// Mirrors and panes.
    pub specular: &'a Specular,
    /// Images of the cell that the model has, too.
    pub images: Option<&'a Images>,
}

/// A thread's state.
struct Worker<'a> {
    session: Box<dyn HemicubeBackend>,
    bins: Bins<'a>,
    through: ThroughPortals,
    /// Directions in which weight leaves the scene, and that weight in 1024ths.
    left: Vec<(DVec3, u64)>,
    /// True once rows are not wanted any more, and the one under way ends.
    stop: &'a AtomicBool,
}

/// Sky rows of patches through mirrors and panes. Otherwise as [`sky_of_patches`](super::sky_of_patches), without
/// refinement: the tolerance of `options` is not used.
///
/// # Errors
/// Those of [`sky_of_patches`](super::sky_of_patches).
pub fn sky_through_portals(
    model: &Model,
    rows: &[(InputPatch, u32)],
    glazed: Glazed<'_>,
    options: SkyOptions,
    mut backend: Box<dyn HemicubeBackend>,
    progress: &mut dyn FnMut(usize) -> bool,
) -> Result<Option<Vec<SkyRow>>, ComputeError> {
    backend
        .load(model.geometry(), options.render)
        .map_err(|error| failed(backend.as_ref(), error))?;
    let stop = AtomicBool::new(false);
    let worker = |session| Worker {
        session,
        bins: Bins::new(glazed.division, glazed.horizon),
        through: ThroughPortals::new(glazed.specular, glazed.images, model),
        left: Vec::new(),
        stop: &stop,
    };
    let mut workers = Vec::new();
    for _ in 1..threads_of(options.threads).clamp(1, rows.len().max(1)) {
        let session = backend.fork().map_err(|error| failed(backend.as_ref(), error))?;
        workers.push(worker(session));
    }
    workers.push(worker(backend));
    let table = DeltaTable::new(options.render.resolution);
    in_parallel(
        rows.len(),
        workers,
        |worker, index| {
            let (patch, samples) = rows[index];
            worker.row(model, patch, samples, options.rotate, &table)
        },
        &mut |done| {
            let goes_on = progress(done);
            stop.store(!goes_on, Ordering::Relaxed);
            goes_on
        },
    )
}

impl Worker<'_> {
    fn row(
        &mut self,
        model: &Model,
        patch: InputPatch,
        samples_per_edge: u32,
        rotate: bool,
        table: &DeltaTable,
    ) -> Result<SkyRow, ComputeError> {
        let hemicubes = model.hemicubes(patch, samples_per_edge, rotate);
        let mut blocked = 0;
        let mut behind = 0;
        self.left.clear();
        for hemicube in &hemicubes {
            let items = self
                .session
                .items(hemicube)
                .map_err(|error| failed(self.session.as_ref(), error))?;
            blocked += self.bins.add_items(&items, table, &hemicube.axes, |_, _| {});
            let left = &mut self.left;
            self.through
                .look(hemicube, &items, table, self.stop, |end, weight| match end {
                    PathEnd::Nothing(towards) => left.push((towards, weight)),
                    PathEnd::Back => behind += weight,
                    PathEnd::Patch { .. } | PathEnd::CutOff => {}
                });
        }
        // Carry each ray's fraction of a unit over to the next ray: the sum is exact.
        let mut rest = 0;
        for &(towards, weight) in &self.left {
            rest += weight;
            self.bins.add_direction(towards, rest / FINE);
            rest %= FINE;
        }
        blocked += behind / FINE;
        let count = u32::try_from(hemicubes.len()).unwrap_or(u32::MAX);
        Ok(self.bins.take(blocked, count))
    }
}

/// The irradiance of each patch from each sun of 1 on a plane across its beam, directly, through panes and off mirrors:
/// the mean of Σ w cos θ over points of the patch, within `error` of its range ([`ThroughPortals::sunlight`]). A row
/// a patch, a number a sun. Suns below the horizon light nothing.
pub fn sunlight(
    model: &Model,
    patches: &[InputPatch],
    suns: &[DVec3],
    glazed: Glazed<'_>,
    error: f64,
    threads: usize,
) -> Vec<f32> {
    let mut light = vec![0.0f32; patches.len() * suns.len()];
    if suns.is_empty() {
        return light;
    }
    let share = patches.len().div_ceil(threads_of(threads)).max(1);
    std::thread::scope(|scope| {
        for (patches, light) in patches.chunks(share).zip(light.chunks_mut(share * suns.len())) {
            scope.spawn(move || {
                let mut through = ThroughPortals::new(glazed.specular, glazed.images, model);
                for (&patch, light) in patches.iter().zip(light.chunks_exact_mut(suns.len())) {
                    let corners = model.normalised_corners(patch.0);
                    let Some(normal) = crate::geometry::cross(&corners).try_normalize() else {
                        continue;
                    };
                    for (light, &sun) in light.iter_mut().zip(suns) {
                        if glazed.horizon.is_below(sun) {
                            continue;
                        }
                        let mean = mean_over(corners, error, |point| through.sunlight(point, normal, sun));
                        #[allow(clippy::cast_possible_truncation, reason = "a share of a sun")]
                        let mean = mean as f32;
                        *light = mean;
                    }
                }
            });
        }
    });
    light
}
