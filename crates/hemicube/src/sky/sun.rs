//! Sunlight on patches: means over points of a patch, as many as an error asks for.
//!
//! n² points fill a patch evenly, as if each had a triangle of its own. First n² ≥ 1 / error: a shadow that covers one of
//! these is found. Where the points differ, the patch is partly lit, and a shadow's edge crosses about n triangles; each
//! of them errs by half of its area, independently. The standard error of the mean is ½ √n / n² = ½ n^(−3/2); three of
//! them are the error for n² = (⅔ error)^(−4/3).
//!
//! The points are those of a scrambled Sobol sequence: points of a lattice err together where a shadow's edge runs along
//! it, as along the edges of a wall.

use super::Horizon;
use crate::Model;
use crate::points::threads_of;
use crate::reference::{Reference, ReferenceError, ReferenceSettings};
use crate::sampling::sobol::{BATCH, Sequence, fold};
use glam::DVec3;
use hemicube_scene::InputPatch;
use hemicube_spatial::whole;

/// Error of the share of a patch that a sun lights, unless another is asked for: that of a matrix by default.
pub const SUN_ERROR: f64 = 0.02;
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

/// The share of each patch lit by each sun, directly, within `error` (three standard errors): a row a patch, a number a
/// sun. 0 for patches turned away, and for suns below the horizon. Directions are towards the suns.
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
    let share = patches.len().div_ceil(threads_of(threads)).max(1);
    std::thread::scope(|scope| {
        let mut workers = Vec::new();
        for (patches, lit) in patches.chunks(share).zip(lit.chunks_mut(share * suns.len())) {
            let reference = &reference;
            workers.push(scope.spawn(move || -> Result<(), ReferenceError> {
                for (&patch, lit) in patches.iter().zip(lit.chunks_exact_mut(suns.len())) {
                    let normal = model.patches().normal(patch);
                    let corners = model.patches().corners(patch);
                    for (lit, &sun) in lit.iter_mut().zip(suns) {
                        if normal.dot(sun) <= 0.0 || horizon.is_below(sun) {
                            continue;
                        }
                        let mut failed = None;
                        let mean = mean_over(corners, error, |point| {
                            match reference.is_open(Some(patch), point, normal, sun) {
                                Ok(is_open) => f64::from(u8::from(is_open)),
                                Err(error) => {
                                    failed = Some(error);
                                    0.0
                                }
                            }
                        });
                        if let Some(error) = failed {
                            return Err(error);
                        }
                        #[allow(clippy::cast_possible_truncation, reason = "a share")]
                        let mean = mean as f32;
                        *lit = mean;
                    }
                }
                Ok(())
            }));
        }
        for worker in workers {
            worker
                .join()
                .unwrap_or_else(|payload| std::panic::resume_unwind(payload))?;
        }
        Ok(())
    })?;
    Ok(lit)
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
