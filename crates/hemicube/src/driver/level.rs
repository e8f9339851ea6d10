//! From the accuracy asked for to an accuracy level: a correction with its pixels and hemicubes.

pub use crate::accuracy::correct::DEFAULT_TOLERANCE;
use crate::accuracy::correct::{Correction, Refinement};
use crate::backend::HemicubeBackend;
use crate::driver::calibrate::{Calibration, Emitters, RESOLUTION, calibrate};
use crate::driver::compute::{ComputeError, Execution, Plan, RowChoice, Selection};
use crate::driver::update::{Update, UpdateError};
use crate::factor::FactorRule;
use crate::store::Form;
use crate::{Grouping, Model};

/// The accuracy asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(
    clippy::large_enum_variant,
    reason = "there is one of it in a run, and it stays `Copy` as what it holds"
)]
pub enum Asked {
    /// An accuracy level by its settings.
    Settings {
        /// The correction of weights into form factors.
        correction: Correction,
        /// Pixels along an edge of the hemicube.
        resolution: u32,
        /// n of the n² hemicubes of a patch.
        samples_per_edge: u32,
    },
    /// A relative Frobenius error.
    Tolerance(f64),
}

impl Default for Asked {
    fn default() -> Self {
        Self::Tolerance(DEFAULT_TOLERANCE)
    }
}

impl Asked {
    /// The tolerance, if one is asked for.
    pub fn tolerance(&self) -> Option<f64> {
        match *self {
            Self::Tolerance(tolerance) => Some(tolerance),
            Self::Settings { .. } => None,
        }
    }
}

/// An accuracy level. It holds everything that rows depend on.
///
/// ```
/// use hemicube::driver::compute::{Execution, Selection};
/// use hemicube::driver::level::{Asked, Level, LevelError};
/// use hemicube::store::Form;
/// use hemicube_backend_cpu::CpuBackend;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model()?;
///
/// let resolve = |asked, form| {
///     let (selection, mut backend) = (Selection::default(), CpuBackend::new());
///     Level::resolve(asked, &model, &selection, true, form, &mut backend, Execution::default())
/// };
/// let level = resolve(Asked::Tolerance(0.001), Form::Plain)?;
/// assert_eq!((level.correction.name(), level.resolution), ("tolerance", 128));
/// assert!(level.reason.is_some_and(|reason| reason.starts_with("tolerance 0.1%: every pair")));
///
/// // The store's rounding must leave something of the tolerance.
/// let refused = resolve(Asked::Tolerance(0.0005), Form::Compact);
/// assert!(matches!(refused, Err(LevelError::Rounding { .. })));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    /// The correction of weights into form factors.
    pub correction: Correction,
    /// Pixels along an edge of the hemicube.
    pub resolution: u32,
    /// n of the n² hemicubes of a patch; 1 with a tolerance.
    pub samples_per_edge: u32,
    /// Reason of the level, where a tolerance chose it.
    pub reason: Option<String>,
}

/// Why there is no accuracy level.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LevelError {
    /// The store's rounding leaves too little of the tolerance.
    #[error(
        "the {} form rounds form factors by up to {}, which leaves too little of a tolerance of {}; {}",
        form.name(),
        percentage(*rounding),
        percentage(*tolerance),
        wider(*form)
    )]
    Rounding {
        /// The form.
        form: Form,
        /// Relative rounding error of a form factor.
        rounding: f64,
        /// The tolerance.
        tolerance: f64,
    },
    /// Calibration failed.
    #[error(transparent)]
    Compute(#[from] ComputeError),
    /// The matrix that rows are taken over from has no price.
    #[error(transparent)]
    Update(#[from] UpdateError),
}

/// Elements with rows and columns, and the patches that they are of.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// The elements.
    pub selection: &'a Selection,
    /// Their patches; `None`: each is its own.
    pub grouping: Option<&'a Grouping>,
}

impl<'a> From<&'a Selection> for Rows<'a> {
    fn from(selection: &'a Selection) -> Self {
        Self {
            selection,
            grouping: None,
        }
    }
}

/// Calibrates a tolerance on a scene, over all rows of the selection, whichever of them are computed later.
///
/// # Errors
/// As [`calibrate`].
pub fn within<'a>(
    model: &Model,
    rows: impl Into<Rows<'a>>,
    rotate: bool,
    tolerance: f64,
    backend: &mut dyn HemicubeBackend,
    execution: Execution<'_>,
) -> Result<Calibration, ComputeError> {
    let Rows { selection, grouping } = rows.into();
    let emitters = Plan::new(model, RowChoice::All, selection.clone(), 1, rotate).rows;
    let receives = |patch: u32| {
        let chosen = selection.receivers.as_ref();
        chosen.is_none_or(|receivers| receivers.get(patch as usize).copied().unwrap_or(false))
    };
    let emitters = Emitters {
        elements: &emitters,
        grouping,
    };
    calibrate(model, emitters, &receives, rotate, tolerance, backend, execution)
}

/// The form to take in place of one that rounds too much.
fn wider(form: Form) -> &'static str {
    match form {
        Form::Compact => "the plain form rounds in the eighth digit",
        Form::Plain | Form::Double => "the form `double` keeps sixteen digits",
    }
}

/// The rows' share of a tolerance T with the store's rounding error r: √(T² − r²), the two being independent; T in the
/// plain form, where r is nothing beside it but near its end, 1.2 · 10⁻⁷.
fn left_by(form: Form, tolerance: f64) -> Result<f64, LevelError> {
    let rounding = form.value_error().max(form.precision().rounding());
    if tolerance < 2.0 * rounding {
        return Err(LevelError::Rounding {
            form,
            rounding,
            tolerance,
        });
    }
    if form.value_error() == 0.0 {
        return Ok(tolerance);
    }
    Ok((tolerance.powi(2) - rounding.powi(2)).sqrt())
}

/// Tolerance from which on the closed forms of a double store are exact to 10⁻¹⁰.
const EXACT_FROM: f64 = 1e-3;

impl Level {
    /// Resolves the accuracy asked for in a scene; calibrates a tolerance.
    ///
    /// # Errors
    /// When the store's form leaves too little of the tolerance, or as [`calibrate`].
    pub fn resolve<'a>(
        asked: Asked,
        model: &Model,
        rows: impl Into<Rows<'a>>,
        rotate: bool,
        form: Form,
        backend: &mut dyn HemicubeBackend,
        execution: Execution<'_>,
    ) -> Result<Self, LevelError> {
        let tolerance = match asked {
            Asked::Settings {
                correction,
                resolution,
                samples_per_edge,
            } => {
                return Ok(Self {
                    correction,
                    resolution,
                    samples_per_edge,
                    reason: None,
                });
            }
            Asked::Tolerance(tolerance) => tolerance,
        };
        let left = left_by(form, tolerance)?;
        let found = within(model, rows, rotate, left, backend, execution)?;
        Ok(Self::of_tolerance(tolerance, form, found.refinement, &found.reason))
    }

    /// The level of a tolerance at the price of the matrix that rows are taken over from.
    ///
    /// # Errors
    /// When the store's form leaves too little of the tolerance, or the matrix has no price.
    pub(crate) fn of_update(tolerance: f64, form: Form, update: &Update) -> Result<Self, LevelError> {
        let refinement = update.refinement(left_by(form, tolerance)?)?;
        let reason = "the price of the matrix that rows are taken over from";
        Ok(Self::of_tolerance(tolerance, form, refinement, reason))
    }

    fn of_tolerance(tolerance: f64, form: Form, mut refinement: Refinement, reason: &str) -> Self {
        if form == Form::Double && tolerance <= EXACT_FROM {
            (refinement.rule, refinement.proves) = (FactorRule::exact(), true);
        }
        Self {
            correction: Correction::Tolerance(refinement),
            resolution: RESOLUTION,
            samples_per_edge: 1,
            reason: Some(format!("tolerance {}: {reason}", percentage(tolerance))),
        }
    }
}

/// 0.003 as `0.3%`, as a person types it.
///
/// ```
/// assert_eq!(hemicube::driver::level::percentage(0.003), "0.3%");
/// ```
pub fn percentage(share: f64) -> String {
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

    #[test]
    fn rounding_takes_its_share_of_a_tolerance() {
        assert_eq!(left_by(Form::Double, 1e-7).unwrap(), 1e-7);
        assert_eq!(left_by(Form::Plain, 1e-6).unwrap(), 1e-6);
        let refused = left_by(Form::Plain, 1e-7).unwrap_err().to_string();
        assert!(
            refused.contains("plain form") && refused.contains("`double`"),
            "{refused}"
        );
        let left = left_by(Form::Compact, 1e-2).unwrap();
        assert!((left.hypot(Form::Compact.value_error()) / 1e-2 - 1.0).abs() < 1e-12);
        assert!(matches!(left_by(Form::Compact, 1e-4), Err(LevelError::Rounding { .. })));
    }
}
