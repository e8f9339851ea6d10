//! Divides the escaped pixels of hemicubes over the columns of the sky.
//!
//! A pixel's direction runs along a straight line as its row is walked: d(x) = d₀ + x d₁. On such a line the altitude
//! rises to one maximum and falls again, so each ring's lower boundary, a cone, is crossed at the two roots of a
//! quadratic; the azimuth is monotone, so boundaries between patches of a ring are crossed one after the other, each at
//! the root of a linear equation. A row takes time by the columns that it crosses, not by its pixels.
//!
//! Where a crossing lies within 10⁻⁷ of a pixel's centre, or its root is not known well, the pixel's own column decides
//! ([`SkyDivision::column`]): weights are those of asking it for every pixel.

use super::{Horizon, SkyDivision, SkyRow};
use crate::backend::BackendError;
use glam::DVec3;
use hemicube_contract::backend::{Hemicube, HemicubeBackend};
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::escaped::{EscapedPixels, runs};
use hemicube_contract::face::{Face, Items};
use hemicube_spatial::whole;
use std::ops::Range;

/// A crossing this near a pixel's centre is decided by the centre's column; pixels.
const NEAR: f64 = 1e-7;
/// Discriminant relative to B² below which the roots of A x² + 2 B x + C are too near each other to be trusted.
const TANGENT: f64 = 1e-6;

/// Adds up one hemicube after another.
pub(super) struct Bins<'a> {
    division: &'a SkyDivision,
    horizon: Horizon,
    weights: Vec<u64>,
    escaped: EscapedPixels,
    walk: Walk,
}

/// The columns of a row of pixels.
#[derive(Default)]
struct Walk {
    /// End pixel of each stretch of one column, ascending, and the column.
    ends: Vec<(u32, u32)>,
    /// For each ring the part of the line above its lower boundary; NaN where not yet asked for.
    above: Vec<[f64; 2]>,
}

/// A row's line of directions, by parts along east, north and up: `start + x step` at the centre of pixel x.
#[derive(Clone, Copy)]
struct Line {
    start: DVec3,
    step: DVec3,
}

impl Line {
    fn at(&self, x: f64) -> DVec3 {
        self.start + self.step * x
    }

    /// The part of the line above an altitude, given by the square of its tangent: where z ≥ tan · √(e² + n²). `None`
    /// where the line all but touches the cone.
    fn above(&self, tangent_squared: f64) -> Option<[f64; 2]> {
        const NOWHERE: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];
        let (start, step) = (self.start, self.step);
        if tangent_squared == 0.0 {
            // The horizon: z ≥ 0.
            let root = -start.z / step.z;
            return Some(match step.z {
                z if z > 0.0 => [root, f64::INFINITY],
                z if z < 0.0 => [f64::NEG_INFINITY, root],
                _ if start.z >= 0.0 => [f64::NEG_INFINITY, f64::INFINITY],
                _ => NOWHERE,
            });
        }
        let level = |p: DVec3, q: DVec3| p.z * q.z - tangent_squared * (p.x * q.x + p.y * q.y);
        let (a, b, c) = (level(step, step), level(start, step), level(start, start));
        let discriminant = b * b - a * c;
        if discriminant.abs() <= TANGENT * (b * b).max((a * c).abs()) {
            return None;
        }
        if discriminant < 0.0 {
            // Only a line flatter than the cone, a < 0, misses it.
            return (a < 0.0).then_some(NOWHERE);
        }
        let far = -(b + discriminant.sqrt().copysign(b));
        let (one, other) = (far / a, c / far);
        let (low, high) = (one.min(other), one.max(other));
        if !low.is_finite() || !high.is_finite() {
            return None;
        }
        Some(if a > 0.0 {
            // The line meets both nappes: the upper one is where z grows to.
            if step.z > 0.0 {
                [high, f64::INFINITY]
            } else {
                [f64::NEG_INFINITY, low]
            }
        } else if self.at(0.5 * (low + high)).z > 0.0 {
            [low, high]
        } else {
            NOWHERE
        })
    }
}

impl Walk {
    /// Finds the columns of the pixels `range`, pixel by pixel.
    fn pixel_by_pixel(&mut self, division: &SkyDivision, line: Line, range: Range<u32>) {
        self.ends.clear();
        for x in range {
            let column = division.column(line.at(f64::from(x)));
            match self.ends.last_mut() {
                Some((end, last)) if *last == column => *end = x + 1,
                _ => self.ends.push((x + 1, column)),
            }
        }
    }

    /// Finds the columns of the pixels `range` by the boundaries that the line crosses; `None` if a root is uncertain.
    fn by_crossings(&mut self, division: &SkyDivision, line: Line, range: Range<u32>) -> Option<()> {
        let rings = &division.rings;
        self.ends.clear();
        self.above.clear();
        self.above.resize(rings.len(), [f64::NAN; 2]);
        let mut at = f64::from(range.start);
        let mut begin = range.start;
        let turning = line.step.x * line.start.y - line.start.x * line.step.y;
        let mut place = division.locate(line.at(at));
        // A line that turns about the zenith crosses each boundary at most twice.
        for _ in 0..4 * division.columns() {
            let column = place.map_or(0, |(ring, patch)| rings[ring].first + patch);
            let mut above = |ring: usize| -> Option<[f64; 2]> {
                if self.above[ring][0].is_nan() {
                    self.above[ring] = line.above(division.tangents[ring])?;
                }
                Some(self.above[ring])
            };
            // The next ring, up or down.
            let (mut next, then) = match place {
                None => {
                    let [enter, _] = above(0)?;
                    (if enter > at { enter } else { f64::INFINITY }, Some(0))
                }
                Some((ring, _)) => {
                    let [enter, leave] = if ring + 1 < rings.len() {
                        above(ring + 1)?
                    } else {
                        [f64::INFINITY, f64::NEG_INFINITY]
                    };
                    if enter < leave && enter > at {
                        (enter, Some(ring + 1))
                    } else {
                        (above(ring)?[1].max(at), ring.checked_sub(1))
                    }
                }
            };
            // The next patch of the ring.
            let mut patch = None;
            if let Some((ring, now)) = place
                && rings[ring].count() > 1
            {
                if turning.abs() <= 1e-12 * line.start.length_squared() {
                    return None;
                }
                let count = rings[ring].count();
                let before = if now == 0 { count - 1 } else { now - 1 };
                let (end, after) = if turning > 0.0 {
                    (now, if now + 1 == count { 0 } else { now + 1 })
                } else {
                    (before, before)
                };
                let [sine, cosine] = rings[ring].bearings[end as usize];
                let root = -(line.start.x * cosine - line.start.y * sine) / (line.step.x * cosine - line.step.y * sine);
                let there = line.at(root);
                if root > at - NEAR && root < next && there.x * sine + there.y * cosine > 0.0 {
                    next = root;
                    patch = Some(after);
                }
            }
            let last = f64::from(range.end - 1);
            if next > last + NEAR {
                self.ends.push((range.end, column));
                return Some(());
            }
            let nearest = next.round();
            let end = if (next - nearest).abs() <= NEAR {
                let pixel = whole::to_u32(nearest);
                pixel + u32::from(division.column(line.at(nearest)) == column)
            } else {
                whole::to_u32(next.ceil())
            };
            let end = end.clamp(begin, range.end);
            if end > begin {
                self.ends.push((end, column));
                begin = end;
            }
            if end == range.end {
                return Some(());
            }
            at = at.max(next);
            place = match (patch, then) {
                (Some(patch), _) => place.map(|(ring, _)| (ring, patch)),
                (None, Some(ring)) => Some((ring, rings[ring].place(line.at(at)))),
                (None, None) => None,
            };
        }
        None
    }
}

impl<'a> Bins<'a> {
    pub(super) fn new(division: &'a SkyDivision, horizon: Horizon) -> Self {
        Self {
            division,
            horizon,
            weights: vec![0; division.columns() as usize],
            escaped: EscapedPixels::default(),
            walk: Walk::default(),
        }
    }

    /// Renders a hemicube, adds its escaped pixels, and returns the blocked weight.
    pub(super) fn render(
        &mut self,
        backend: &mut dyn HemicubeBackend,
        table: &DeltaTable,
        hemicube: &Hemicube,
    ) -> Result<u64, BackendError> {
        let mut escaped = std::mem::take(&mut self.escaped);
        let result = backend.escaped(hemicube, table, &mut escaped);
        if result.is_ok() {
            self.add(&escaped, table, &hemicube.axes);
        }
        let blocked = u64::from(escaped.blocked);
        self.escaped = escaped;
        result.map(|()| blocked)
    }

    /// Adds the escaped pixels of an item buffer and returns the blocked weight. Calls `seen` for every patch's pixel.
    pub(super) fn add_items(
        &mut self,
        items: &Items,
        table: &DeltaTable,
        axes: &[DVec3; 3],
        mut seen: impl FnMut(u32, u32),
    ) -> u64 {
        let mut escaped = std::mem::take(&mut self.escaped);
        escaped.take(items, table);
        self.add(&escaped, table, axes);
        let weights = Face::ALL.into_iter().flat_map(|face| table.running(face).windows(2));
        for (&item, sums) in items.seen.iter().zip(weights) {
            if item != Items::ESCAPED && item != Items::BLOCKED {
                seen(item, sums[1] - sums[0]);
            }
        }
        let blocked = u64::from(escaped.blocked);
        self.escaped = escaped;
        blocked
    }

    /// Adds the escaped pixels of a hemicube with these axes.
    pub(super) fn add(&mut self, escaped: &EscapedPixels, table: &DeltaTable, axes: &[DVec3; 3]) {
        let resolution = escaped.resolution();
        let axes = axes.map(|axis| self.horizon.local(axis));
        let step = 2.0 / f64::from(resolution);
        for face in Face::ALL {
            let ([u, v, w], [su, sv, sw]) = face.axes();
            let (right, up, forward) = (axes[u] * su, axes[v] * sv, axes[w] * sw);
            let low = if face.is_top() { -1.0 } else { 0.0 };
            for y in 0..face.rows(resolution) {
                let row = escaped.row(face.first_row(resolution) + y);
                let Some(first) = runs(row).next() else { continue };
                let end = row.len() * 64 - leading_zeros(row);
                #[allow(clippy::cast_possible_truncation, reason = "a row has at most 1024 pixels")]
                let range = first.start..end as u32;
                let middle = forward + up * (low + (f64::from(y) + 0.5) * step);
                let line = Line {
                    start: middle + right * (0.5 * step - 1.0),
                    step: right * step,
                };
                if self.walk.by_crossings(self.division, line, range.clone()).is_none() {
                    self.walk.pixel_by_pixel(self.division, line, range);
                }
                let running = &table.running(face)[(y * resolution) as usize..];
                let mut columns = self.walk.ends.iter();
                let mut now = columns.next();
                for run in runs(row) {
                    let mut begin = run.start;
                    while let Some(&(end, column)) = now {
                        let until = end.min(run.end);
                        if until > begin {
                            let weight = running[until as usize] - running[begin as usize];
                            self.weights[column as usize] += u64::from(weight);
                            begin = until;
                        }
                        if end > run.end {
                            break;
                        }
                        now = columns.next();
                    }
                }
            }
        }
    }

    /// Adds a weight that leaves the scene in a direction.
    pub(super) fn add_direction(&mut self, towards: DVec3, weight: u64) {
        let column = self.division.column(self.horizon.local(towards));
        self.weights[column as usize] += weight;
    }

    /// The row of all additions since the last one.
    pub(super) fn take(&mut self, blocked: u64, hemicubes: u32) -> SkyRow {
        let columns: Vec<(u32, u64)> = (0u32..)
            .zip(&mut self.weights)
            .filter_map(|(column, weight)| match std::mem::take(weight) {
                0 => None,
                weight => Some((column, weight)),
            })
            .collect();
        SkyRow {
            escaped: columns.iter().map(|(_, weight)| weight).sum(),
            columns,
            blocked,
            hemicubes,
            change: f64::NAN,
            change_below: f64::NAN,
            refined: None,
        }
    }
}

/// Zero bits above the highest set bit of a row.
fn leading_zeros(row: &[u64]) -> usize {
    let mut count = 0;
    for word in row.iter().rev() {
        count += word.leading_zeros() as usize;
        if *word != 0 {
            break;
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame;
    use hemicube_scene::Axis;

    /// Random bits, a share of 1 − 2⁻ⁿ of them set.
    fn mask(resolution: u32, n: u32, random: &mut impl FnMut() -> u64) -> EscapedPixels {
        let mut escaped = EscapedPixels::default();
        escaped.clear(resolution);
        for row in 0..3 * resolution {
            for (word, bits) in escaped.row_mut(row).iter_mut().enumerate() {
                let none = (0..n).fold(u64::MAX, |bits, _| bits & random());
                let width = (resolution - 64 * u32::try_from(word).expect("small")).min(64);
                *bits = !none & (u64::MAX >> (64 - width));
            }
        }
        escaped
    }

    /// Weights by asking for the column of every pixel.
    fn slowly(bins: &Bins<'_>, escaped: &EscapedPixels, table: &DeltaTable, axes: &[DVec3; 3]) -> Vec<u64> {
        let mut weights = vec![0; bins.weights.len()];
        let n = escaped.resolution();
        let axes = axes.map(|axis| bins.horizon.local(axis));
        let step = 2.0 / f64::from(n);
        for face in Face::ALL {
            let ([u, v, w], [su, sv, sw]) = face.axes();
            let low = if face.is_top() { -1.0 } else { 0.0 };
            for y in 0..face.rows(n) {
                for x in runs(escaped.row(face.first_row(n) + y)).flatten() {
                    let direction = axes[w] * sw
                        + axes[v] * sv * (low + (f64::from(y) + 0.5) * step)
                        + axes[u] * su * ((f64::from(x) + 0.5) * step - 1.0);
                    weights[bins.division.column(direction) as usize] += u64::from(table.weight(face, x, y));
                }
            }
        }
        weights
    }

    #[test]
    fn weights_are_those_of_asking_for_every_pixel() {
        let mut state = 1u64;
        let mut random = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state ^ (state >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9)
        };
        #[allow(clippy::cast_precision_loss, reason = "a random number")]
        let unit = |bits: u64| (bits >> 11) as f64 / (1u64 << 53) as f64;
        for parts in [1, 2, 5] {
            let division = SkyDivision::new(parts).expect("in range");
            for resolution in [32, 112, 256] {
                let table = DeltaTable::new(resolution);
                let mut bins = Bins::new(&division, Horizon::new(Axis::Z, 17.0));
                for case in 0..40 {
                    let normal = DVec3::new(unit(random()) - 0.5, unit(random()) - 0.5, unit(random()) - 0.5);
                    let axes = frame::axes_of(normal, unit(random()) * 6.0).expect("a direction");
                    let escaped = mask(resolution, case % 9, &mut random);
                    bins.add(&escaped, &table, &axes);
                    let (found, wanted) = (bins.weights.clone(), slowly(&bins, &escaped, &table, &axes));
                    let moved: u64 = found.iter().zip(&wanted).map(|(a, b)| a.abs_diff(*b)).sum();
                    assert_eq!(moved, 0, "{parts} parts, {resolution} pixels, case {case}");
                    bins.take(0, 1);
                }
            }
        }
    }

    #[test]
    fn symmetric_frames_lose_nothing() {
        // Boundaries run through centres of pixels: rounding decides the column of such a pixel, and none may be lost.
        for turn in [0.0, 6.0, 45.0] {
            let division = SkyDivision::new(2).expect("in range");
            let table = DeltaTable::new(64);
            for normal in [
                DVec3::Z,
                DVec3::X,
                DVec3::NEG_Y,
                DVec3::NEG_Z,
                DVec3::new(1.0, 1.0, 0.0),
            ] {
                let axes = frame::axes_of(normal, 0.0).expect("a direction");
                let mut escaped = EscapedPixels::default();
                escaped.clear(64);
                (0..192).for_each(|row| escaped.row_mut(row).fill(u64::MAX));
                let mut bins = Bins::new(&division, Horizon::new(Axis::Z, turn));
                bins.add(&escaped, &table, &axes);
                let (found, wanted) = (bins.weights.clone(), slowly(&bins, &escaped, &table, &axes));
                assert_eq!(found.iter().sum::<u64>(), u64::from(crate::backend::WHOLE));
                let moved: u64 = found.iter().zip(&wanted).map(|(a, b)| a.abs_diff(*b)).sum();
                assert!(
                    moved * 1000 < u64::from(crate::backend::WHOLE),
                    "{normal}, {turn}°: {moved}"
                );
            }
        }
    }
}
