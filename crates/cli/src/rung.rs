//! From settings to a rung of the accuracy ladder: what form factors are made of, from how many pixels and hemicubes.

use crate::args::{Correction as Name, RenderSettings, Tolerance};
use hemicube::Model;
use hemicube::correct::{Correction, Refinement};
use hemicube::factor::FactorRule;

/// A rung with everything settled that its rows depend on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Rung {
    pub(crate) correction: Correction,
    pub(crate) resolution: u32,
    /// n of the n² hemicubes of a patch, on rungs that let one choose.
    pub(crate) samples_per_edge: u32,
    /// Why this one, where the program chose.
    pub(crate) reason: Option<String>,
}

/// The correction of a name.
pub(crate) fn correction(name: Name) -> Correction {
    match name {
        Name::Pixel => Correction::Pixel,
        Name::Point => Correction::Point,
        // A closed form that is right to some thousandths: one hemicube leaves more than that to visibility.
        Name::Area => Correction::Area(FactorRule::for_tolerance(1e-2)),
    }
}

/// The correction that aims at a tolerance.
pub(crate) fn correction_within(tolerance: Tolerance) -> Correction {
    Correction::Tolerance(Refinement::for_tolerance(tolerance.0))
}

/// Settles the rung for a scene.
pub(crate) fn settle(_model: &Model, settings: &RenderSettings) -> Rung {
    let (correction, reason) = match settings.tolerance {
        None => (correction(settings.correction), None),
        Some(tolerance) => {
            let reason = format!(
                "tolerance {}: visible fraction × closed form, with as many rays at pairs in penumbra as that needs",
                percentage(tolerance.0)
            );
            (correction_within(tolerance), Some(reason))
        }
    };
    Rung {
        correction,
        resolution: settings.resolution,
        samples_per_edge: settings.samples.per_edge,
        reason,
    }
}

/// 0.003 as `0.3%`: a value of `--tolerance`.
pub(crate) fn percentage(share: f64) -> String {
    // Nine digits: enough for what anybody types, and few enough to hide the rounding of the multiplication.
    let text = format!("{:.9}", 100.0 * share);
    format!("{}%", text.trim_end_matches('0').trim_end_matches('.'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentages_are_as_short_as_they_can_be() {
        assert_eq!(
            [0.01, 0.003, 0.5, 1e-5, 0.0123].map(percentage),
            ["1%", "0.3%", "50%", "0.001%", "1.23%"]
        );
    }
}
