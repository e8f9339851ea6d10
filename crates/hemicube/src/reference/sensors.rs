//! Reference rows of sensors by rays: no hemicube, and no closed form of a patch.
//!
//! The sphere of directions is an octahedron, cut evenly into [`START`] pieces a face. Rays through the corners and the
//! middle of a piece tell what it shows. A piece that shows one thing counts for it with the kernel's integral over it;
//! others are cut into four, until that integral is less than a limit, and are then shared by their rays. An edge of
//! what is seen separates corners of every piece that it crosses: what is missed is smaller than a first piece.
//!
//! At a mirror or a pane a ray branches, and what it shows is all that its branches come to, with the mean of the
//! piece's rays as the shares. A piece is cut while the part in which its rays differ is above the limit: not for
//! branches of which next to nothing is left.
//!
//! Rays branch into dozens between a few panes, and edges show in each of their images. So a row ends where its error is
//! small beside the one that is asked for, and at a bound of the ends of its rays: counted, never timed.

use super::portals::SightEnd;
use super::{Reference, ReferenceError, ReferenceSettings};
use crate::Model;
use crate::driver::compute::ComputeError;
use crate::frame::Horizon;
use crate::geometry::{in_front, quarters};
use crate::points::{Body, Part, Sensor, SensorRow, in_parallel, threads_of};
use crate::portal::Portals;
use glam::DVec3;
use hemicube_scene::InputPatch;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Levels of the even cut: 8 · 4⁶ pieces of 4 · 10⁻⁴ steradians.
const START: u32 = 6;
/// Levels at which a piece is cut no more, whatever its integral.
const DEEPEST: u32 = 16;
/// Limit of the first cut of a row that aims at an error: by its error, the next limit is chosen, one or two more as a
/// rule. Each cut begins anew, so that no piece is kept.
const FIRST_LIMIT: f64 = 1e-5;
/// Bound of the ends of a row's rays over all cuts, from which on the first cut's limit holds: some ten seconds. What that
/// leaves is in the row's error, and the row says so. A choice: with more, a row takes longer; with fewer,
/// more rows miss the error that they were asked for.
const MOST_ENDS: u64 = 1 << 25;
/// Corners of a piece are moved in by this share: the rays of neighbours then do not run along one edge.
const INWARDS: f64 = 1e-3;

/// A row of the reference.
#[derive(Clone, Debug, PartialEq)]
pub struct PointReferenceRow {
    /// The row; its `change` is NaN.
    pub row: SensorRow,
    /// Standard error of the row, Euclidean, in shares of the whole: of the pieces that were shared by their rays.
    pub error: f64,
    /// Rays traced.
    pub rays: u64,
    /// True if the bound of its rays ended it above what it aims at.
    pub met_bound: bool,
}

/// Makes reference rows.
#[derive(Debug)]
pub struct PointReference<'m> {
    model: &'m Model,
    reference: Reference<'m>,
    horizon: Horizon,
    limit: f64,
    /// Standard error to end at, in parts of a row's Euclidean norm; 0: at the limit only.
    target: f64,
    /// Bound of the ends of a row's rays.
    most_ends: u64,
}

/// Sums of one row.
#[derive(Default)]
struct Sums {
    /// Weight by what is seen: sky, ground, backs, what is cut off, then patches.
    weights: BTreeMap<u64, f64>,
    /// The weight that each patch reflects or lets through.
    passed: BTreeMap<u32, f64>,
    /// Σ of the pieces.
    whole: f64,
    squared_error: f64,
    rays: u64,
    /// Ends that the rays came to, their branches' included.
    ends: u64,
    /// True if pieces were cut no more because of the bound of these.
    met_bound: bool,
}

const SKY: u64 = 0;
const GROUND: u64 = 1;
const BACK: u64 = 2;
const CUT_OFF: u64 = 3;
const PATCHES: u64 = 4;

/// The ends of a ray: each with its share of the ray's weight, and the part reflected or let through there.
type Shown = Vec<(u64, f64, f64)>;

impl<'m> PointReference<'m> {
    /// `limit` is the integral of a kernel over a piece below which it is cut no more; 10⁻⁷ finds rows within 10⁻⁴.
    ///
    /// # Errors
    /// Those of [`Reference::new`].
    pub fn new(model: &'m Model, horizon: Horizon, limit: f64) -> Result<Self, ReferenceError> {
        Ok(Self {
            model,
            reference: Reference::new(model, ReferenceSettings::default())?,
            horizon,
            limit: limit.max(1e-9),
            target: 0.0,
            most_ends: MOST_ENDS,
        })
    }

    /// Ends a row where its standard error is at most `target` of its Euclidean norm, before the limit of pieces.
    #[must_use]
    pub fn with_target(mut self, target: f64) -> Self {
        self.target = target;
        self
    }

    /// Ends a row's rays at so many ends instead of 2²⁵, a mirror's or a pane's branches included. The first and coarsest
    /// cut is made in any case.
    #[must_use]
    pub fn with_most_ends(mut self, most: u64) -> Self {
        self.most_ends = most;
        self
    }

    /// The reference through `portals`. Where they have images of a cell, the model is of all of them, and columns are
    /// the cell's.
    #[must_use]
    pub fn with_portals(mut self, portals: &Arc<Portals>) -> Self {
        self.reference = self.reference.with_portals(portals);
        self
    }

    /// The rows of sensors, [`Body::rows`] each, in order; `None` when `progress` returned false.
    ///
    /// # Errors
    /// None of its own.
    pub fn rows(
        &self,
        sensors: &[Sensor],
        threads: usize,
        progress: &mut dyn FnMut(usize) -> bool,
    ) -> Result<Option<Vec<PointReferenceRow>>, ComputeError> {
        let threads = threads_of(threads).clamp(1, sensors.len().max(1));
        let rows = in_parallel(
            sensors.len(),
            vec![(); threads],
            |(), index| Ok(self.of(&sensors[index])),
            progress,
        )?;
        Ok(rows.map(|rows| rows.into_iter().flatten().collect()))
    }

    fn of(&self, sensor: &Sensor) -> Vec<PointReferenceRow> {
        let parts = Body::parts(sensor.body, &self.horizon);
        parts.iter().map(|parts| self.row(sensor.position, parts)).collect()
    }

    fn row(&self, position: DVec3, parts: &[Part]) -> PointReferenceRow {
        // The first limit is kept in any case: a row that meets the bound is no worse.
        let coarse = FIRST_LIMIT.max(self.limit);
        let mut limit = if self.target > 0.0 { coarse } else { self.limit };
        let (mut rays, mut ends) = (0, 0);
        loop {
            let sums = self.cut_to(limit, coarse, self.most_ends.saturating_sub(ends), position, parts);
            (rays, ends) = (rays + sums.rays, ends + sums.ends);
            let (error, allowed) = (sums.squared_error.sqrt(), self.target * sums.norm());
            let is_last = limit <= self.limit || error <= allowed;
            if is_last || sums.met_bound || ends >= self.most_ends {
                let met_bound = sums.met_bound || !is_last;
                return sums.finish(rays, met_bound);
            }
            // Along edges, errors fall as the limit to the power of 3/4.
            limit *= (0.8 * (allowed / error).powf(4.0 / 3.0)).min(0.25);
            limit = limit.max(self.limit);
        }
    }

    /// Cuts the sphere until the rays of no piece differ in more than `limit` of the whole; once rays have come to `most`
    /// ends, in more than `coarse`.
    fn cut_to(&self, limit: f64, coarse: f64, most: u64, position: DVec3, parts: &[Part]) -> Sums {
        let mut sums = Sums::default();
        // An octahedron turned off the scene's axes, so that its edges run along nothing.
        let (a, b, c) = (
            DVec3::new(0.36, 0.48, 0.8),
            DVec3::new(-0.8, 0.6, 0.0),
            DVec3::new(-0.48, -0.64, 0.6),
        );
        let mut pending: Vec<([DVec3; 3], u32)> = Vec::new();
        for (x, y, z) in [a, -a]
            .into_iter()
            .flat_map(|x| [b, -b].into_iter().flat_map(move |y| [c, -c].map(|z| (x, y, z))))
        {
            pending.push(([x, y, z], 0));
        }
        while let Some((corners, level)) = pending.pop() {
            let cut = |pending: &mut Vec<([DVec3; 3], u32)>| {
                let parts = quarters(&corners).map(|part| (part.map(DVec3::normalize), level + 1));
                pending.extend(parts.into_iter().rev());
            };
            let weight = weight(parts, corners);
            if weight <= 0.0 {
                continue;
            }
            if level < START {
                cut(&mut pending);
                continue;
            }
            let middle = (corners[0] + corners[1] + corners[2]).normalize();
            let seen = [
                self.seen(position, corners[0].lerp(middle, INWARDS)),
                self.seen(position, corners[1].lerp(middle, INWARDS)),
                self.seen(position, corners[2].lerp(middle, INWARDS)),
                self.seen(position, middle),
            ];
            sums.rays += 4;
            sums.ends += seen.iter().map(|shown| shown.len() as u64).sum::<u64>();
            let differing = seen[1..].iter().map(|shown| apart(&seen[0], shown)).fold(0.0, f64::max);
            let is_above = |limit: f64| differing * weight > limit && level < DEEPEST;
            let is_spent = sums.ends >= most;
            if is_above(if is_spent { coarse } else { limit }) {
                cut(&mut pending);
                continue;
            }
            sums.met_bound |= is_spent && is_above(limit);
            sums.squared_error += (0.3 * differing * weight).powi(2);
            sums.whole += weight;
            for (what, share, passed) in seen.into_iter().flatten() {
                *sums.weights.entry(what).or_default() += 0.25 * weight * share;
                if passed > 0.0 {
                    let patch = u32::try_from(what - PATCHES).unwrap_or(u32::MAX);
                    *sums.passed.entry(patch).or_default() += 0.25 * weight * passed;
                }
            }
        }
        sums
    }

    /// All that a ray shows.
    fn seen(&self, position: DVec3, direction: DVec3) -> Shown {
        let mut shown = Vec::new();
        let from = self.model.normalise(position);
        self.reference.ends(from, direction.normalize_or_zero(), |end, share| {
            let (what, passed) = match end {
                SightEnd::Nothing(towards) if towards.dot(self.horizon.up) >= 0.0 => (SKY, 0.0),
                SightEnd::Nothing(_) => (GROUND, 0.0),
                SightEnd::Back => (BACK, 0.0),
                SightEnd::CutOff => (CUT_OFF, 0.0),
                SightEnd::Patch { patch, passed } => (PATCHES + u64::from(patch), passed),
            };
            shown.push((what, share, passed));
        });
        shown
    }

    /// The model.
    pub fn model(&self) -> &'m Model {
        self.model
    }
}

/// The part of two rays' weight that comes to different ends: 0 for the same ends in one order, 1 for two rays without
/// branches that end apart.
fn apart(one: &Shown, other: &Shown) -> f64 {
    if one.iter().map(|end| end.0).eq(other.iter().map(|end| end.0)) {
        return 0.0;
    }
    let mut differences: BTreeMap<u64, f64> = BTreeMap::new();
    for (shown, sign) in [(one, 0.5), (other, -0.5)] {
        for &(what, share, _) in shown {
            *differences.entry(what).or_default() += sign * share;
        }
    }
    differences.values().map(|difference| difference.abs()).sum()
}

/// The integral of the kernels of some parts over a piece of the sphere.
fn weight(parts: &[Part], [a, b, c]: [DVec3; 3]) -> f64 {
    // Counter-clockwise as a front seen from the middle.
    let corners = if a.dot(b.cross(c)) > 0.0 { [a, c, b] } else { [a, b, c] };
    let of_part = |part: &Part| {
        let axis = part.axis.normalize_or_zero();
        let polygon = in_front(&corners, DVec3::ZERO, axis, 0.0);
        polygon.map_or(0.0, |polygon| part.weight * part.kernel.over(axis, polygon.corners()))
    };
    parts.iter().map(of_part).sum()
}

impl Sums {
    /// The Euclidean norm of the row.
    fn norm(&self) -> f64 {
        let squares = self.weights.range(PATCHES..).map(|(_, weight)| weight * weight);
        squares.sum::<f64>().sqrt()
    }

    fn finish(self, rays: u64, met_bound: bool) -> PointReferenceRow {
        let whole = self.whole;
        let share = |what: u64| self.weights.get(&what).copied().unwrap_or(0.0) / whole;
        let passed = self.passed.iter();
        let passed = passed.map(|(&patch, &weight)| (InputPatch(patch), weight / whole));
        let patches = self.weights.range(PATCHES..).map(|(&what, &weight)| {
            let patch = u32::try_from(what - PATCHES).unwrap_or(u32::MAX);
            (InputPatch(patch), weight / whole)
        });
        PointReferenceRow {
            row: SensorRow {
                patches: patches.collect(),
                sky: share(SKY),
                ground: share(GROUND),
                blocked: share(BACK),
                passed: passed.collect(),
                cut_off: share(CUT_OFF),
                change: f64::NAN,
                is_settled: true,
                hemicubes: 0,
            },
            error: self.squared_error.sqrt(),
            rays,
            met_bound,
        }
    }
}
