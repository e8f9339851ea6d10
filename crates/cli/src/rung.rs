//! From settings to a rung of the accuracy ladder: what form factors are made of, from how many pixels and hemicubes.

use crate::args::{Correction as Name, RenderSettings, Tolerance};
use crate::exit::hinted;
use crate::report::percent;
use anyhow::{Result, anyhow};
use hemicube::Model;
use hemicube::backend::HemicubeBackend;
use hemicube::compute::{Plan, RowChoice, Selection};
use hemicube::correct::Correction;
use hemicube::factor::FactorRule;
use hemicube::settle::{Settled, settle};
use hemicube::store::Form;

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

/// What keeps a tolerance in a scene: the same for `compute` and `tradeoff`, whichever of the rows they compute.
pub(crate) fn within(
    model: &Model,
    selection: &Selection,
    rotate: bool,
    tolerance: Tolerance,
    backend: &mut dyn HemicubeBackend,
    threads: usize,
) -> Result<Settled> {
    let emitters = Plan::new(model, RowChoice::All, selection.clone(), 1, rotate).rows;
    let receives = |patch: u32| {
        let chosen = selection.receivers.as_ref();
        chosen.is_none_or(|receivers| receivers.get(patch as usize).copied().unwrap_or(false))
    };
    Ok(settle(
        model,
        &emitters,
        &receives,
        rotate,
        tolerance.0,
        backend,
        threads,
    )?)
}

/// What of a tolerance is left for the rows when the store rounds them: the two errors have nothing to do with each
/// other, so their squares add.
fn left_by(form: Form, tolerance: Tolerance) -> Result<Tolerance> {
    let rounding = form.value_error();
    if rounding == 0.0 {
        return Ok(tolerance);
    }
    if tolerance.0 < 2.0 * rounding {
        return Err(hinted(
            anyhow!(
                "`--store compact` rounds form factors by up to {}, which leaves too little of a tolerance of {}",
                percent(rounding),
                percent(tolerance.0)
            ),
            "`--store plain` rounds nothing",
        ));
    }
    Ok(Tolerance((tolerance.0.powi(2) - rounding.powi(2)).sqrt()))
}

/// Settles the rung for a scene.
pub(crate) fn choose(
    model: &Model,
    selection: &Selection,
    settings: &RenderSettings,
    rotate: bool,
    form: Form,
    backend: &mut dyn HemicubeBackend,
) -> Result<Rung> {
    let Some(tolerance) = settings.tolerance else {
        return Ok(Rung {
            correction: correction(settings.correction),
            resolution: settings.resolution,
            samples_per_edge: settings.samples.per_edge,
            reason: None,
        });
    };
    let left = left_by(form, tolerance)?;
    let settled = within(model, selection, rotate, left, backend, settings.thread_count())?;
    Ok(Rung {
        correction: Correction::Tolerance(settled.refinement),
        resolution: settled.resolution,
        samples_per_edge: 1,
        reason: Some(format!("tolerance {}: {}", percentage(tolerance.0), settled.reason)),
    })
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
