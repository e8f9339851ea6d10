//! Sunlight on patches: exactly, by cuts ([`super::shadow`]), and where these take too many pieces, or mirrors and panes
//! bring light, means over points of a patch, as many as an error asks for.
//!
//! n² points fill a patch evenly, as if each had a triangle of its own. First n² ≥ 1 / error: a shadow that covers one of
//! these is found. Where the points differ, the patch is partly lit, and a shadow's edge crosses about n triangles; each
//! of them errs by half of its area, independently. The standard error of the mean is ½ √n / n² = ½ n^(−3/2); three of
//! them are the error for n² = (⅔ error)^(−4/3).
//!
//! The points are those of a scrambled Sobol sequence: points of a lattice err together where a shadow's edge runs along
//! it, as along the edges of a wall.

use super::Horizon;
use super::shadow::{Cutter, Facet, View};
use crate::Model;
use crate::points::threads_of;
use crate::reference::{Reference, ReferenceError, ReferenceSettings};
use crate::sampling::sobol::{BATCH, Sequence, fold};
use glam::DVec3;
use hemicube_scene::InputPatch;
use hemicube_spatial::whole;
use std::sync::{Mutex, PoisonError};

/// Error of the share of a patch that a sun lights, unless another is asked for: that of a matrix by default.
pub const SUN_ERROR: f64 = 0.02;
/// Suns whose views are held at a time, and surfaces in all of these: of small scenes 300 MB at most, of a large one a
/// view of 112 bytes a surface. A choice: with fewer views, threads wait for each other more often.
const VIEWS: usize = 64;
const IN_VIEWS: usize = 1 << 18;
/// Patches that a thread takes at a time, all under one sun: its view then stays in the processor's cache.
const PATCHES: usize = 4096;
/// Points of a patch at most. A choice: a smaller error costs no more.
const MOST: f64 = 65_536.0;

/// The mean of a value over a patch with these corners, within `error` of its range (three standard errors).
pub(super) fn mean_over(corners: [DVec3; 3], error: f64, mut value: impl FnMut(DVec3) -> f64) -> f64 {
    let [a, b, c] = corners;
    let sequence = Sequence::new(0);
    let batches = |points: f64| whole::to_u32(points.min(MOST) / BATCH as f64).max(1);
    let (mut sum, mut count, mut least, mut most) = (0.0, 0.0, f64::INFINITY, f64::NEG_INFINITY);
    let mut add = |batch: u32| {
        let [u, v, ..] = sequence.points(batch as usize * BATCH);
        for (u, v) in u.into_iter().zip(v) {
            let (u, v) = fold(u, v);
            let value = value(a + (b - a) * u + (c - a) * v);
            (sum, count) = (sum + value, count + 1.0);
            (least, most) = (least.min(value), most.max(value));
        }
        most > least
    };
    let first = batches((1.0 / error).ceil() + BATCH as f64 - 1.0);
    let mut differs = false;
    for batch in 0..first {
        differs |= add(batch);
    }
    if differs {
        let fine = batches((error * 2.0 / 3.0).powf(-4.0 / 3.0).ceil() + BATCH as f64 - 1.0);
        for batch in first..fine {
            add(batch);
        }
    }
    sum / count
}

/// The share of each patch lit by each sun, directly: a row a patch, a number a sun. 0 for patches turned away, and for
/// suns below the horizon. Directions are towards the suns. Shares are exact but for rounding; a shadow of very many
/// pieces is found by rays, within `error` (three standard errors).
///
/// # Errors
/// When the scene has no such patch, or is too large.
pub fn sunlit(
    model: &Model,
    patches: &[InputPatch],
    suns: &[DVec3],
    horizon: Horizon,
    error: f64,
    threads: usize,
) -> Result<Vec<f32>, ReferenceError> {
    let mut lit = vec![0.0f32; patches.len() * suns.len()];
    if suns.is_empty() {
        return Ok(lit);
    }
    let reference = Reference::new(model, ReferenceSettings::default())?;
    let threads = threads_of(threads);
    let at_once = (IN_VIEWS / View::surfaces(model).max(1)).clamp(1, VIEWS);
    let facets: Vec<Option<Facet>> = patches.iter().map(|&patch| Facet::new(model, patch)).collect();
    for (block, directions) in suns.chunks(at_once).enumerate() {
        let views = views(model, directions, threads);
        // A row a sun, in pieces of some patches.
        let mut of_block = vec![0.0f32; patches.len() * directions.len()];
        let rows = of_block.chunks_mut(patches.len().max(1)).enumerate();
        let pieces = Mutex::new(rows.flat_map(|(sun, row)| {
            let pieces = row.chunks_mut(PATCHES).enumerate();
            pieces.map(move |(piece, lit)| (sun, piece * PATCHES, lit))
        }));
        std::thread::scope(|scope| {
            let work = || -> Result<(), ReferenceError> {
                let mut cutter = Cutter::new(model);
                loop {
                    let next = pieces.lock().unwrap_or_else(PoisonError::into_inner).next();
                    let Some((sun, first, lit)) = next else { return Ok(()) };
                    let (view, sun) = (&views[sun], directions[sun]);
                    if horizon.is_below(sun) {
                        continue;
                    }
                    for (lit, (&patch, facet)) in lit.iter_mut().zip(patches.iter().zip(&facets).skip(first)) {
                        if model.patches().normal(patch).dot(sun) <= 0.0 {
                            continue;
                        }
                        let whole = facet.as_ref().zip(view.as_ref());
                        let exact = whole.and_then(|(facet, view)| cutter.lit(model, view, facet));
                        let mean = match exact {
                            Some(exact) => exact,
                            None => by_points(model, &reference, patch, sun, error)?,
                        };
                        #[allow(clippy::cast_possible_truncation, reason = "a share")]
                        let mean = mean as f32;
                        *lit = mean;
                    }
                }
            };
            let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
            for worker in workers {
                worker
                    .join()
                    .unwrap_or_else(|payload| std::panic::resume_unwind(payload))?;
            }
            Ok(())
        })?;
        for (sun, row) in of_block.chunks(patches.len().max(1)).enumerate() {
            let of_patches = lit.iter_mut().skip(block * at_once + sun).step_by(suns.len());
            of_patches.zip(row).for_each(|(lit, found)| *lit = *found);
        }
    }
    Ok(lit)
}

/// The views of suns, by several threads.
fn views(model: &Model, suns: &[DVec3], threads: usize) -> Vec<Option<View>> {
    let share = suns.len().div_ceil(threads).max(1);
    std::thread::scope(|scope| {
        let of = |suns: &'_ [DVec3]| suns.iter().map(|&sun| View::new(model, sun)).collect::<Vec<_>>();
        let workers: Vec<_> = suns.chunks(share).map(|suns| scope.spawn(move || of(suns))).collect();
        let join = |worker: std::thread::ScopedJoinHandle<'_, Vec<Option<View>>>| {
            worker
                .join()
                .unwrap_or_else(|payload| std::panic::resume_unwind(payload))
        };
        workers.into_iter().flat_map(join).collect()
    })
}

/// The share of a patch that a sun lights, by rays from points of it.
fn by_points(
    model: &Model,
    reference: &Reference<'_>,
    patch: InputPatch,
    sun: DVec3,
    error: f64,
) -> Result<f64, ReferenceError> {
    let patches = model.patches();
    let normal = patches.normal(patch);
    let mut failed = None;
    let mean = mean_over(patches.corners(patch), error, |point| {
        match reference.is_open(Some(patch), point, normal, sun) {
            Ok(is_open) => f64::from(u8::from(is_open)),
            Err(error) => {
                failed = Some(error);
                0.0
            }
        }
    });
    failed.map_or(Ok(mean), Err)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shadows with straight edges, of many slopes and places.
    #[test]
    fn partly_lit_patches_are_within_the_error() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        for error in [0.02, 0.003] {
            let (mut squares, mut worst, mut count) = (0.0f64, 0.0f64, 0.0);
            for turn in 0..40 {
                let (sine, cosine) = (f64::from(turn) * 0.157).sin_cos();
                for step in 1..10 {
                    let bound = f64::from(step) * 0.1;
                    let is_lit = |point: DVec3| f64::from(u8::from(cosine * point.x + sine * point.y < bound * cosine));
                    let found = mean_over(corners, error, is_lit);
                    let right = mean_over(corners, 1e-5, is_lit);
                    squares += (found - right).powi(2);
                    worst = worst.max((found - right).abs());
                    count += 1.0;
                }
            }
            let rms = (squares / count).sqrt();
            assert!(rms < error / 3.0 && worst < error, "{error}: {rms} {worst}");
        }
    }

    /// A city and a heap of triangles under suns of all heights: what is cut out is what rays find.
    #[test]
    fn cuts_leave_what_rays_find_lit() {
        use crate::HierarchyOptions;
        use hemicube_scene::generate::{Generate, Kind, generate};
        use hemicube_scene::{Patches, Subdivision};
        for kind in [Kind::City, Kind::Soup] {
            let spec = Generate {
                kind,
                target_patches: 300,
                seed: 1,
            };
            let mut scene = generate(spec).expect("a scene");
            // The heap lies in a closed room, where no sun comes in.
            let heap = scene.objects.iter().position(|name| name == "soup");
            if kind == Kind::Soup {
                scene
                    .triangles
                    .retain(|triangle| Some(triangle.object as usize) == heap);
            }
            let patches = Patches::new(&scene, Subdivision::None).expect("patches");
            let model = Model::new(patches.into(), HierarchyOptions::default()).expect("a model");
            let all: Vec<InputPatch> = model.patches().iter().collect();
            let suns: Vec<DVec3> = (0..9)
                .map(|turn| {
                    let (sine, cosine) = (f64::from(turn) * 0.7 + 0.1).sin_cos();
                    DVec3::new(cosine, 0.05 + 0.15 * f64::from(turn), sine).normalize()
                })
                .collect();
            let horizon = Horizon::new(hemicube_scene::Axis::Y, 0.0).without_ground();
            let found = sunlit(&model, &all, &suns, horizon, 0.02, 1).expect("shares");
            let again = sunlit(&model, &all, &suns, horizon, 0.02, 3).expect("shares");
            assert_eq!(found, again);
            let reference = Reference::new(&model, ReferenceSettings::default()).expect("rays");
            let (mut partly, mut squares, mut worst) = (0.0, 0.0, 0.0f64);
            for (place, &patch) in all.iter().enumerate().step_by(3) {
                for (sun, &direction) in suns.iter().enumerate() {
                    if model.patches().normal(patch).dot(direction) <= 0.0 {
                        continue;
                    }
                    let exact = f64::from(found[place * suns.len() + sun]);
                    let rays = by_points(&model, &reference, patch, direction, 0.003).expect("a mean");
                    worst = worst.max((exact - rays).abs());
                    if exact > 0.0 && exact < 1.0 {
                        (partly, squares) = (partly + 1.0, squares + (exact - rays).powi(2));
                    }
                }
            }
            assert!(partly > 50.0, "{partly}");
            let rms: f64 = (squares / partly).sqrt();
            // Rays that look closer: a shadow smaller than the distance of their first points is not found.
            assert!(rms < 0.01 / 3.0 && worst < 0.02, "{rms} {worst}");
        }
    }

    #[test]
    fn what_is_lit_evenly_costs_few_points() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let mut points = 0;
        let found = mean_over(corners, 0.003, |_| {
            points += 1;
            0.25
        });
        // 1 / 0.003, in whole batches of 16.
        assert_eq!((found, points), (0.25, 336));
    }
}
