//! Precision of coordinates: the digits that f32 would leave, the file's own rounding, and triangles too thin for
//! either.
//!
//! A file's rounding counts as its *grain* only if the coordinates prove it: all of them are multiples of a power of
//! ten, with last digits spread like those of measured numbers, or all of them are f32 numbers with used-up fractions.
//! Typed coordinates (0, 1, 2.5) are exact.

use super::{Examined, Example, Finding, FindingKind, Tally, scale_of, shape};
use crate::Model;
use hemicube_spatial::whole;
use serde::Serialize;

/// Surfaces examined for the grain.
const SAMPLE: usize = 20_000;
/// Least number of different coordinates with telling digits.
const VALUES_MIN: usize = 200;
/// Longest edge over height beyond which a triangle is a sliver.
const SLIVER: f64 = 1e3;
/// Rounding over height beyond which a triangle's plane is unknown: the tangent of 3°.
const TILT: f64 = 0.0524;

/// Rounding of a file's coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind", content = "step")]
pub enum Grain {
    /// To multiples of this power of ten.
    Decimal(f64),
    /// To f32; the step at the largest coordinate.
    Single(f64),
}

impl Grain {
    /// The distance between neighbouring coordinates, in the file's unit.
    pub fn step(self) -> f64 {
        match self {
            Self::Decimal(step) | Self::Single(step) => step,
        }
    }
}

/// Digits and rounding of a scene's coordinates, in the file's unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Precision {
    /// The largest coordinate by magnitude.
    pub largest: f64,
    /// The distance between f32 numbers there.
    pub f32_step: f64,
    /// Decimal digits that f32 would leave of a typical triangle's size. All coordinates here are f64.
    pub f32_digits: f64,
    /// The file's rounding of coordinates, if it is known.
    pub grain: Option<Grain>,
}

pub(super) fn measure(model: &Model, order: &[u32]) -> Precision {
    let surfaces = model.patches().surfaces();
    let largest = surfaces
        .iter()
        .flatten()
        .fold(0.0_f64, |largest, p| largest.max(p.abs().max_element()));
    let mut values = Vec::new();
    let mut sizes = Vec::new();
    for &index in order.iter().take(SAMPLE) {
        let surface = &model.geometry().surfaces[index as usize];
        let corners = model.patches().corners(surface.front);
        values.extend(corners.iter().flat_map(|p| p.to_array()));
        sizes.push(shape(&surface.corners).0);
    }
    sizes.sort_unstable_by(f64::total_cmp);
    let typical = sizes.get(sizes.len() / 2).copied().unwrap_or(0.0) / scale_of(model);
    values.sort_unstable_by(f64::total_cmp);
    values.dedup();
    let f32_step = f32_step(largest);
    Precision {
        largest,
        f32_step,
        f32_digits: (typical / f32_step).log10(),
        grain: decimal_grain(&values).or_else(|| single_grain(&values, largest)),
    }
}

/// The distance between neighbouring f32 numbers at `x`.
fn f32_step(x: f64) -> f64 {
    // 23 bits of fraction; f32 ends at 2⁻¹⁴⁹.
    let exponent = x.to_bits() & (0x7FF << 52);
    (f64::from_bits(exponent) * 2.0_f64.powi(-23)).max(2.0_f64.powi(-149))
}

/// The coarsest power of ten with all `values` (ascending, all different) as multiples, if their last digits are spread
/// like those of rounded numbers.
fn decimal_grain(values: &[f64]) -> Option<Grain> {
    if values.len() < VALUES_MIN {
        return None;
    }
    let multiple = |value: f64, per_unit: f64| {
        let steps = value * per_unit;
        // Beyond 2⁴⁰ steps every f64 is near a multiple.
        (steps.abs() < 1.1e12 && (steps - steps.round()).abs() <= 1e-6 + 1e-15 * steps.abs()).then(|| steps.round())
    };
    for digits in -2..=9 {
        let per_unit = 10f64.powi(digits);
        let Some(steps) = values
            .iter()
            .map(|&value| multiple(value, per_unit))
            .collect::<Option<Vec<f64>>>()
        else {
            continue;
        };
        let mut counts = [0usize; 10];
        for step in steps {
            let digit = whole::to_usize(step.abs().rem_euclid(10.0));
            counts[digit.min(9)] += 1;
        }
        let spread = counts
            .iter()
            .all(|&count| count * 30 >= values.len() && count * 4 <= values.len());
        return spread.then(|| Grain::Decimal(per_unit.recip()));
    }
    None
}

/// The step of f32 at the largest coordinate, if all `values` are f32 numbers and those near the largest use the last
/// bit.
fn single_grain(values: &[f64], largest: f64) -> Option<Grain> {
    #[allow(
        clippy::cast_possible_truncation,
        reason = "whether anything is lost is the question"
    )]
    let is_single = |value: f64| f64::from(value as f32) == value;
    if values.len() < VALUES_MIN || !values.iter().all(|&value| is_single(value)) {
        return None;
    }
    let large: Vec<f64> = values
        .iter()
        .copied()
        .filter(|value| value.abs() >= 0.25 * largest)
        .collect();
    let odd = large
        .iter()
        .filter(|value| (value.abs() / f32_step(value.abs())).rem_euclid(2.0) == 1.0)
        .count();
    (large.len() >= VALUES_MIN / 4 && odd * 4 >= large.len()).then(|| Grain::Single(f32_step(largest)))
}

/// Slivers, and triangles at the grain. All surfaces are looked at.
pub(super) fn findings(model: &Model, grain: Option<Grain>) -> Vec<Finding> {
    let patches = model.patches();
    let file_step = grain.map_or(0.0, Grain::step);
    let step = file_step * scale_of(model);
    let (mut slivers, mut coarse) = (Tally::default(), Tally::default());
    let population = model.geometry().surfaces.len() as u64;
    for surface in &model.geometry().surfaces {
        let patch = surface.front;
        let (longest, height) = shape(&surface.corners);
        let example = |value| Example {
            patch,
            other: None,
            at: patches.centroid(patch),
            value,
        };
        if longest > SLIVER * height {
            let aspect = longest / height;
            slivers.add(aspect, 0.0, example(aspect));
        }
        if step > TILT * height {
            let tilt = (step / height).atan().to_degrees();
            coarse.add(tilt, 0.0, example(tilt));
        }
    }
    let of = Examined {
        examined: population,
        population,
    };
    let next =
        "merge their corners, or cut again the polygons that they come from; they are patches like any other here";
    let findings = [
        slivers.finding(FindingKind::Sliver, of, None, next.to_owned()),
        coarse.finding(
            FindingKind::CoarseGrain,
            of,
            None,
            format!(
                "export the scene again with more digits, about an origin near it: this file's coordinates have steps \
                 of {file_step:.0e}"
            ),
        ),
    ];
    findings.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers as if measured, ascending.
    fn measured(count: u64, size: f64) -> Vec<f64> {
        let mut values: Vec<f64> = (0..count)
            .map(|k| size * (super::super::sample::hash(7, k) >> 11) as f64 / (1u64 << 53) as f64)
            .collect();
        values.sort_unstable_by(f64::total_cmp);
        values
    }

    #[test]
    fn a_grain_is_found_where_numbers_were_rounded_and_nowhere_else() {
        let values = measured(3000, 300.0);
        assert_eq!(decimal_grain(&values).or_else(|| single_grain(&values, 300.0)), None);
        let rounded = |per_unit: f64| {
            let mut values: Vec<f64> = values.iter().map(|v| (v * per_unit).round() / per_unit).collect();
            values.dedup();
            values
        };
        assert_eq!(decimal_grain(&rounded(1000.0)), Some(Grain::Decimal(1e-3)));
        assert_eq!(decimal_grain(&rounded(1e6)), Some(Grain::Decimal(1e-6)));
        #[allow(clippy::cast_possible_truncation, reason = "the point of the test")]
        let single: Vec<f64> = values.iter().map(|&v| f64::from(v as f32)).collect();
        assert_eq!(decimal_grain(&single), None);
        assert_eq!(single_grain(&single, 300.0), Some(Grain::Single(2.0_f64.powi(8 - 23))));
        // Half a thousand numbers of an exact raster: all multiples of 0.1, but of 0.5 rather.
        let raster: Vec<f64> = (0..500).map(|k| 0.5 * f64::from(k)).collect();
        assert_eq!(decimal_grain(&raster).or_else(|| single_grain(&raster, 250.0)), None);
        // Too few to tell.
        assert_eq!(decimal_grain(&rounded(1000.0)[..100]), None);
    }

    #[test]
    fn steps_of_f32() {
        assert_eq!(f32_step(1.0), f64::from(f32::EPSILON));
        assert_eq!(f32_step(2_678_220.0), 0.25);
        assert_eq!(f32_step(0.0), 2.0_f64.powi(-149));
    }
}
