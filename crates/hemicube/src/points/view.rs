//! One hemicube's view: weights of an item buffer by patch, and their view factors.

use super::Part;
use super::kernel::Kernel;
use crate::Model;
use crate::backend::{BackendError, Hemicube, WHOLE};
use crate::delta::DeltaTable;
use crate::face::{Face, Items};
use crate::geometry::in_front;
use crate::outline::weights_within;
use crate::portal::sensors::Arrivals;
use glam::DVec3;
use hemicube_scene::InputPatch;
use std::collections::BTreeMap;

/// Visible part of a patch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    visible: u64,
    /// The whole outline's; `visible` where all of it is seen.
    covered: u64,
    is_whole: bool,
}

/// Weights of some hemicubes of one place and direction.
#[derive(Clone, Debug, Default)]
pub(super) struct Sum {
    pub(super) seen: BTreeMap<u32, Seen>,
    sky: u64,
    ground: u64,
    blocked: u64,
    hemicubes: u32,
    /// Likewise what comes through portals.
    pub(super) through: Arrivals,
}

/// View factors of one direction of a body, summing to 1; without patches, their shares.
pub(super) struct Factors {
    pub(super) patches: Vec<(InputPatch, f64)>,
    pub(super) sky: f64,
    pub(super) ground: f64,
    pub(super) blocked: f64,
}

/// Room for a thread's views.
pub(super) struct Scratch {
    /// Weight of each patch, 0 between views.
    weights: Vec<u64>,
    touched: Vec<u32>,
    polygon: Vec<DVec3>,
    /// False: sky, ground and blocked share alone, by pixels.
    has_patches: bool,
}

impl Scratch {
    pub(super) fn new(model: &Model, has_patches: bool) -> Self {
        Self {
            has_patches,
            weights: vec![0; model.geometry().patch_count as usize],
            touched: Vec::new(),
            polygon: Vec::new(),
        }
    }

    /// Adds the weights of a hemicube's item buffer.
    ///
    /// # Errors
    /// When the buffer names a patch beyond the scene, or is not of the table's resolution.
    pub(super) fn add(
        &mut self,
        model: &Model,
        items: &Items,
        table: &DeltaTable,
        hemicube: &Hemicube,
        up: DVec3,
        sum: &mut Sum,
    ) -> Result<(), BackendError> {
        let n = items.resolution;
        let wrong = |what: &str| BackendError::Internal(format!("an item buffer {what}"));
        if n != table.resolution() || items.seen.len() != crate::face::pixel_count(n) {
            return Err(wrong("is not of the resolution asked for"));
        }
        let mut total = 0u64;
        for face in Face::ALL {
            for y in 0..face.rows(n) {
                let start = (face.first_row(n) + y) as usize * n as usize;
                let row = &items.seen[start..start + n as usize];
                let mut x = 0;
                while x < n {
                    let item = row[x as usize];
                    let mut end = x + 1;
                    while end < n && row[end as usize] == item {
                        end += 1;
                    }
                    let weight = u64::from(table.span(face, y, x, end));
                    total += weight;
                    match item {
                        Items::BLOCKED => sum.blocked += weight,
                        Items::ESCAPED => {
                            let above = above(face, y, x..end, n, &hemicube.axes, up);
                            let sky = if above.is_empty() {
                                0
                            } else {
                                u64::from(table.span(face, y, above.start, above.end))
                            };
                            sum.sky += sky;
                            sum.ground += weight - sky;
                        }
                        patch => {
                            let Some(slot) = self.weights.get_mut(patch as usize) else {
                                return Err(wrong("names a patch beyond the scene"));
                            };
                            if self.has_patches {
                                if *slot == 0 {
                                    self.touched.push(patch);
                                }
                                *slot += weight;
                            }
                        }
                    }
                    x = end;
                }
            }
        }
        if total != u64::from(WHOLE) {
            return Err(wrong("has weights that do not sum to the whole"));
        }
        for patch in self.touched.drain(..) {
            let visible = std::mem::take(&mut self.weights[patch as usize]);
            if visible == 0 {
                continue;
            }
            let corners = model.normalised_corners(patch).map(|corner| {
                let from = corner - hemicube.origin;
                hemicube.axes.map(|axis| axis.dot(from))
            });
            let (certain, within) = weights_within(&corners, table);
            let is_whole = visible >= u64::from(certain);
            let covered = if is_whole {
                visible
            } else {
                u64::from(within).max(visible)
            };
            let seen = sum.seen.entry(patch).or_insert(Seen {
                visible: 0,
                covered: 0,
                is_whole: true,
            });
            seen.visible += visible;
            seen.covered += covered;
            seen.is_whole &= is_whole;
        }
        sum.hemicubes += 1;
        Ok(())
    }

    /// The view factors of what was added.
    pub(super) fn factors(&mut self, model: &Model, origin: DVec3, part: &Part, sum: &Sum) -> Factors {
        let whole = f64::from(WHOLE) * f64::from(sum.hemicubes.max(1));
        let share = |weight: u64| weight as f64 / whole;
        if !self.has_patches {
            let [sky, ground, blocked] = [sum.sky, sum.ground, sum.blocked].map(share);
            return Factors {
                patches: Vec::new(),
                sky,
                ground,
                blocked,
            };
        }
        let axis = part.axis.normalize_or_zero();
        let mut patches = Vec::with_capacity(sum.seen.len());
        // By how much each may be wrong: pixels along an edge go either way, and nothing is seen of what is hidden.
        let mut slack = Vec::with_capacity(sum.seen.len());
        for (&patch, seen) in &sum.seen {
            let all = self.unoccluded(model, origin, axis, part.kernel, patch);
            let (factor, of_patch) = if all <= 0.0 {
                // Nothing of it is above the horizon by the closed form, and a pixel shows it: the pixel decides.
                (share(seen.visible), share(seen.visible))
            } else if seen.is_whole {
                (all, 0.0)
            } else {
                let factor = all * (seen.visible as f64 / seen.covered.max(1) as f64);
                (factor, factor.min(all - factor))
            };
            patches.push((InputPatch(patch), factor));
            slack.push(of_patch);
        }
        let mut shares = [sum.sky, sum.ground, sum.blocked].map(share);
        let slack_of_shares = shares.map(|share| share.min(1.0 - share));
        let found = patches.iter().map(|(_, factor)| factor).sum::<f64>() + shares.iter().sum::<f64>();
        let all_slack = slack.iter().sum::<f64>() + slack_of_shares.iter().sum::<f64>();
        let lacking = 1.0 - found;
        if lacking.abs() <= all_slack {
            let scale = if all_slack > 0.0 { lacking / all_slack } else { 0.0 };
            for ((_, factor), slack) in patches.iter_mut().zip(slack) {
                *factor += slack * scale;
            }
            for (share, slack) in shares.iter_mut().zip(slack_of_shares) {
                *share += slack * scale;
            }
        } else {
            // A sliver without a pixel, and nothing to make up for it: shared among all.
            let scale = 1.0 / found;
            patches.iter_mut().for_each(|(_, factor)| *factor *= scale);
            shares = shares.map(|share| share * scale);
        }
        let [sky, ground, blocked] = shares;
        Factors {
            patches,
            sky,
            ground,
            blocked,
        }
    }

    /// The integral of the kernel over the part of a patch above the horizon.
    fn unoccluded(&mut self, model: &Model, origin: DVec3, axis: DVec3, kernel: Kernel, patch: u32) -> f64 {
        let corners = model.normalised_corners(patch).map(|corner| corner - origin);
        let tolerance = model.geometry().plane_tolerance;
        let Some(polygon) = in_front(&corners, DVec3::ZERO, axis, tolerance) else {
            return 0.0;
        };
        self.polygon.clear();
        self.polygon.extend_from_slice(polygon.corners());
        kernel.over(axis, &self.polygon)
    }
}

/// The pixels of a range that look above the horizon, by their centres. Heights along a row of pixels are linear.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the range"
)]
fn above(
    face: Face,
    y: u32,
    range: std::ops::Range<u32>,
    resolution: u32,
    axes: &[DVec3; 3],
    up: DVec3,
) -> std::ops::Range<u32> {
    let ([u, v, w], [su, sv, sw]) = face.axes();
    let n = f64::from(resolution);
    let low = if face.is_top() { -1.0 } else { 0.0 };
    let center = |k: u32| (2.0 * f64::from(k) + 1.0) / n;
    let heights = axes.map(|axis| axis.dot(up));
    let start = sw * heights[w] + sv * heights[v] * (low + center(y)) + su * heights[u] * (1.0 / n - 1.0);
    let step = su * heights[u] * 2.0 / n;
    if step == 0.0 {
        return if start >= 0.0 { range } else { range.start..range.start };
    }
    let crossing = (-start / step).clamp(-1.0, n + 1.0);
    if step > 0.0 {
        let first = (crossing.ceil().max(0.0) as u32).clamp(range.start, range.end);
        first..range.end
    } else {
        let past = ((crossing.floor() + 1.0).max(0.0) as u32).clamp(range.start, range.end);
        range.start..past
    }
}
