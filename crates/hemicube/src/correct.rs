//! From weights to form factors: the rungs of the accuracy ladder.
//!
//! - *pixel*: F_ij = Σ visible weight. Aliasing falls with the resolution; that the emitter is a point does not.
//! - *point*: F_ij = visible fraction × the closed form from the hemicube's centre.
//! - *area*: F_ij = visible fraction × the closed form from the whole emitter, as symmetric as visibility allows.
//! - *tolerance*: the area rung, with the visible fraction of those pairs whose penumbra matters measured by rays in the
//!   shaft between the two patches ([`Refinement`]).
//!
//! The *visible fraction* is what a patch shows over what it would cover alone, by the same rasteriser. With K hemicubes a
//! patch, fractions are averaged with the closed form from each centre as weight, for that is the share that each part of
//! the emitter has in the whole.

use crate::Model;
use crate::backend::{Hemicube, WHOLE};
use crate::factor::{Exchanges, FactorRule, PointFactors};
use crate::row::RowView;
use crate::shaft::{RAYS, Shaft};
use crate::store::RowSums;
use glam::DVec3;
use hemicube_scene::InputPatch;

/// A rung of the accuracy ladder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Correction {
    /// Sums of pixels.
    Pixel,
    /// Visible fraction × point-to-area closed form.
    Point,
    /// Visible fraction × area-to-area closed form, integrated by this rule.
    Area(FactorRule),
    /// The area rung with as many rays at partly visible pairs as the tolerance asks for.
    Tolerance(Refinement),
}

/// How far the visible fractions of a row are refined.
///
/// Four hemicubes a row, at the centroid and near the corners, say which patches are visible throughout and which are in
/// transition. Those in transition whose F is so small that a rough fraction will do keep one; the others get rays, as
/// many as the row's share of the tolerance asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refinement {
    /// The relative Frobenius error to aim at.
    pub tolerance: f64,
    /// How the closed form is integrated.
    pub rule: FactorRule,
}

impl Refinement {
    /// The refinement for a relative Frobenius error.
    pub fn for_tolerance(tolerance: f64) -> Self {
        Self {
            tolerance,
            rule: FactorRule::for_tolerance(tolerance * 0.5),
        }
    }
}

/// Where the hemicubes of a row stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Samples {
    /// At the centroids of n² equal sub-triangles.
    Centroids(u32),
    /// At the centroid and at barycentric (0.9, 0.05, 0.05) and its permutations.
    CentroidAndCorners,
}

impl Samples {
    /// How many hemicubes a row has.
    pub fn count(self) -> usize {
        match self {
            Self::Centroids(n) => n as usize * n as usize,
            Self::CentroidAndCorners => 4,
        }
    }
}

impl Correction {
    /// The name in settings and manifests.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Pixel => "pixel",
            Self::Point => "point",
            Self::Area(_) => "area",
            Self::Tolerance(_) => "tolerance",
        }
    }

    /// Whether rows must carry covered weights.
    pub fn needs_covered(&self) -> bool {
        !matches!(self, Self::Pixel)
    }
}

/// A visible fraction this near to 1 is 1: what is missing is rounding of weights, not an occluder.
const ALL_VISIBLE: f64 = 0.9999;

/// Converts the rows of one patch at a time. One a thread.
#[derive(Debug)]
pub(crate) struct Converter {
    correction: Correction,
    /// (patch, sample, visible, covered) of all samples of the row.
    entries: Vec<(u32, u32, u32, u32)>,
    exchanges: Option<Exchanges>,
    fractions: Vec<f64>,
    values: Vec<f64>,
    points: PointFactors,
    shaft: Shaft,
    doubtful: Vec<Doubtful>,
}

/// A pair in transition between visible and hidden.
#[derive(Clone, Copy, Debug)]
struct Doubtful {
    /// Its place in the row.
    place: usize,
    patch: u32,
    /// F if all were visible.
    open: f64,
    /// How far its rough fraction may be off (standard deviation).
    doubt: f64,
}

impl Converter {
    pub(crate) fn new(correction: Correction) -> Self {
        Self {
            correction,
            entries: Vec::new(),
            exchanges: match correction {
                Correction::Area(rule) | Correction::Tolerance(Refinement { rule, .. }) => Some(Exchanges::new(rule)),
                Correction::Pixel | Correction::Point => None,
            },
            shaft: Shaft::default(),
            doubtful: Vec::new(),
            fractions: Vec::new(),
            values: Vec::new(),
            points: PointFactors::new(),
        }
    }

    /// Appends the columns and form factors of one row, and returns its sums of weights.
    ///
    /// `hemicubes` and `rows` are the emitter's samples; `receives` says whether a patch has a column.
    #[allow(clippy::too_many_arguments, reason = "called once, from the driver's inner loop")]
    pub(crate) fn convert<'r>(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        hemicubes: &[Hemicube],
        rows: impl Iterator<Item = RowView<'r>>,
        receives: impl Fn(u32) -> bool,
        columns: &mut Vec<i32>,
        data: &mut Vec<f32>,
    ) -> RowSums {
        let mut sums = RowSums::default();
        self.entries.clear();
        for (sample, row) in (0u32..).zip(rows) {
            sums.escaped += u64::from(row.escaped);
            sums.blocked += u64::from(row.blocked);
            for ((&patch, &visible), &covered) in row.patches.iter().zip(row.visible).zip(row.covered) {
                if receives(patch) {
                    sums.visible += u64::from(visible);
                    self.entries.push((patch, sample, visible, covered));
                } else {
                    sums.unselected += u64::from(visible);
                }
            }
        }
        if hemicubes.len() > 1 {
            self.entries.sort_unstable();
        }
        match self.correction {
            Correction::Pixel => self.pixel(hemicubes.len(), columns, data),
            Correction::Point => self.point(model, hemicubes, columns, data),
            Correction::Area(_) => self.area(model, emitter, hemicubes, None, columns, data),
            Correction::Tolerance(Refinement { tolerance, .. }) => {
                self.area(model, emitter, hemicubes, Some(tolerance), columns, data);
            }
        }
        sums
    }

    fn pixel(&self, samples: usize, columns: &mut Vec<i32>, data: &mut Vec<f32>) {
        let scale = 1.0 / (f64::from(WHOLE) * samples.max(1) as f64);
        for group in self.entries.chunk_by(|a, b| a.0 == b.0) {
            let weight: u64 = group.iter().map(|e| u64::from(e.2)).sum();
            push(columns, data, group[0].0, weight as f64 * scale);
        }
    }

    fn point(&mut self, model: &Model, hemicubes: &[Hemicube], columns: &mut Vec<i32>, data: &mut Vec<f32>) {
        let scale = 1.0 / hemicubes.len().max(1) as f64;
        for group in self.entries.chunk_by(|a, b| a.0 == b.0) {
            let patch = group[0].0;
            let corners = normalised_corners(model, patch);
            let centers = group.iter().map(|e| &hemicubes[e.1 as usize]);
            let factors = self.points.evaluate(centers.map(|h| (h.origin, h.axes[2])), &corners);
            let sum: f64 = group.iter().zip(factors).map(|(e, f)| fraction(e.2, e.3) * f).sum();
            push(columns, data, patch, sum * scale);
        }
    }

    /// The area rung; with a tolerance, that of [`Refinement`].
    fn area(
        &mut self,
        model: &Model,
        emitter: InputPatch,
        hemicubes: &[Hemicube],
        tolerance: Option<f64>,
        columns: &mut Vec<i32>,
        data: &mut Vec<f32>,
    ) {
        let Some(exchanges) = &mut self.exchanges else { return };
        let own = normalised_corners(model, emitter.0);
        let per_area = 2.0 / (own[1] - own[0]).cross(own[2] - own[0]).length();
        self.fractions.clear();
        self.values.clear();
        self.doubtful.clear();
        let groups = || self.entries.chunk_by(|a, b| a.0 == b.0);
        self.values.resize(groups().count(), 0.0);
        exchanges.begin(&own);
        for (place, group) in groups().enumerate() {
            let corners = normalised_corners(model, group[0].0);
            exchanges.add(place, &corners, &mut self.values);
            let all = group.len() == hemicubes.len() && group.iter().all(|e| fraction(e.2, e.3) == 1.0);
            let visible = if all {
                1.0
            } else if hemicubes.len() == 1 {
                fraction(group[0].2, group[0].3)
            } else if tolerance.is_some() {
                rough_fraction(group, hemicubes.len())
            } else {
                let centers = hemicubes.iter().map(|h| (h.origin, h.axes[2]));
                let factors = self.points.evaluate(centers, &corners);
                let whole: f64 = factors.iter().sum();
                let seen: f64 = group.iter().map(|e| fraction(e.2, e.3) * factors[e.1 as usize]).sum();
                if whole > 0.0 { seen / whole } else { 0.0 }
            };
            self.fractions.push(visible);
            if !all && tolerance.is_some() {
                let doubt = if visible > 0.0 && visible < 1.0 {
                    PARTLY_DOUBT
                } else {
                    EDGE_DOUBT
                };
                self.doubtful.push(Doubtful {
                    place,
                    patch: group[0].0,
                    open: 0.0,
                    doubt,
                });
            }
        }
        exchanges.finish(&mut self.values);
        for value in &mut self.values {
            *value *= per_area;
        }
        if let Some(tolerance) = tolerance {
            for pair in &mut self.doubtful {
                pair.open = self.values[pair.place];
            }
            self.doubtful.retain(|pair| pair.open > 0.0);
            self.refine(model, emitter, &own, tolerance);
        }
        let groups = self.entries.chunk_by(|a, b| a.0 == b.0);
        for ((group, &visible), &open) in groups.zip(&self.fractions).zip(&self.values) {
            push(columns, data, group[0].0, visible * open);
        }
    }

    /// Replaces rough fractions by measured ones until what the rest may contribute to the row's error is in its budget.
    fn refine(&mut self, model: &Model, emitter: InputPatch, own: &[DVec3; 3], tolerance: f64) {
        let norm: f64 = self
            .values
            .iter()
            .zip(&self.fractions)
            .map(|(f, v)| (f * v) * (f * v))
            .sum();
        let budget = tolerance * tolerance * norm;
        self.doubtful.sort_unstable_by(|a, b| {
            (a.open * a.doubt)
                .total_cmp(&(b.open * b.doubt))
                .then(a.patch.cmp(&b.patch))
        });
        // The smallest stay rough while they use up less than a quarter of the budget.
        let mut rough = 0.0;
        let mut first = 0;
        for pair in &self.doubtful {
            let error = (pair.open * pair.doubt) * (pair.open * pair.doubt);
            if rough + error > 0.25 * budget {
                break;
            }
            rough += error;
            first += 1;
        }
        let tree = model.geometry().tree();
        let total: f64 = self.doubtful[first..].iter().map(|pair| pair.open * PARTLY_DOUBT).sum();
        for pair in &self.doubtful[first..] {
            let corners = normalised_corners(model, pair.patch);
            let occluders = self.shaft.build(tree, (emitter.0, own), (pair.patch, &corners));
            if occluders == 0 {
                self.fractions[pair.place] = 1.0;
                continue;
            }
            let seed = (u64::from(emitter.0) << 32 | u64::from(pair.patch)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            let mut sums = (0.0, 0.0);
            self.shaft.cast(0, RAYS, seed, &mut sums);
            let pilot = if sums.1 > 0.0 { sums.0 / sums.1 } else { 0.0 };
            let spread = (pilot * (1.0 - pilot)).sqrt().max(LEAST_SPREAD);
            // Rays in proportion to what a pair contributes, for the budget as a whole; the sequence is four times as good
            // as independent rays.
            let wanted = spread * pair.open * total / (0.75 * budget * QUASI_GAIN);
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "saturates, then clamped"
            )]
            let rays = (wanted as usize).clamp(RAYS, MOST_RAYS).next_multiple_of(RAYS);
            if rays > RAYS {
                sums = (0.0, 0.0);
                self.shaft.cast(0, rays, seed, &mut sums);
            }
            // Where no ray had weight, as between planes that all but coincide, the rough fraction is all there is.
            if sums.1 > 0.0 {
                self.fractions[pair.place] = sums.0 / sums.1;
            }
        }
    }
}

/// Standard deviation of a rough fraction between 0 and 1, and of one that the hemicubes have at 0 or 1 throughout where
/// they see the patch at all (measured on rooms and cities).
const PARTLY_DOUBT: f64 = 0.3;
const EDGE_DOUBT: f64 = 0.15;
/// A few rays that agree do not prove that all would.
const LEAST_SPREAD: f64 = 0.15;
/// How much smaller the squared error of the additive sequence is than that of independent rays.
const QUASI_GAIN: f64 = 4.0;
/// Rays at one pair, at most.
const MOST_RAYS: usize = 16_384;

/// The visible fraction from the centroid and the corners: 0.654 and 0.346 are the weights that fit the fraction from the
/// whole emitter best.
fn rough_fraction(group: &[(u32, u32, u32, u32)], samples: usize) -> f64 {
    let mut center = 0.0;
    let mut corners = 0.0;
    for entry in group {
        let v = fraction(entry.2, entry.3);
        if entry.1 == 0 { center = v } else { corners += v }
    }
    if samples < 2 {
        center
    } else {
        0.654 * center + 0.346 * corners / (samples - 1) as f64
    }
}

/// What a patch shows of what it would cover alone. Nothing covered is a patch too small for a pixel, seen at its
/// centroid.
fn fraction(visible: u32, covered: u32) -> f64 {
    if covered == 0 {
        return 1.0;
    }
    let fraction = f64::from(visible) / f64::from(covered);
    if fraction >= ALL_VISIBLE { 1.0 } else { fraction }
}

fn normalised_corners(model: &Model, patch: u32) -> [DVec3; 3] {
    model.patches().corners(InputPatch(patch)).map(|p| model.normalise(p))
}

fn push(columns: &mut Vec<i32>, data: &mut Vec<f32>, patch: u32, value: f64) {
    #[allow(clippy::cast_possible_truncation, reason = "rounding to the store's f32 is wanted")]
    let value = value as f32;
    if value > 0.0 {
        columns.push(patch.cast_signed());
        data.push(value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions() {
        assert_eq!(fraction(0, 0), 1.0, "a tiny patch is seen");
        assert_eq!(fraction(5, 10), 0.5);
        assert_eq!(fraction(99_999, 100_000), 1.0);
        assert_eq!(fraction(0, 10), 0.0);
    }
}
