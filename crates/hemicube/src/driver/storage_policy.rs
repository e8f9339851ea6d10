//! Defaults of a matrix's storage: from a million patches on, the size of the output is the limit.

use crate::store::Form;

/// From how many patches on a matrix is kept small.
pub const LARGE: u32 = 1_000_000;

/// Form factors left out of a large matrix are below this: in a block city of 1.5 million patches two thirds of all
/// entries, with 0.005 % of Σ F (`docs/store.md`).
pub const LEAST_OF_LARGE: f64 = 1e-7;

/// A tolerance below this asks for everything, whatever it takes.
pub const FINE_TOLERANCE: f64 = 0.003;

/// The form of a matrix, and its least form factor.
///
/// ```
/// use hemicube::driver::storage_policy::StoragePolicy;
/// use hemicube::store::Form;
///
/// let small = StoragePolicy::choose(None, None, 140_000, None);
/// assert_eq!((small.form, small.min_factor, small.reason), (Form::Plain, 0.0, None));
///
/// let large = StoragePolicy::choose(None, None, 1_500_000, None);
/// assert_eq!((large.form, large.min_factor), (Form::Compact, 1e-7));
/// assert!(large.reason.is_some_and(|reason| reason.contains("below 1e-7 left out")));
///
/// let all = StoragePolicy::choose(Some(Form::Plain), Some(0.0), 1_500_000, None);
/// assert_eq!((all.form, all.min_factor, all.reason), (Form::Plain, 0.0, None));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct StoragePolicy {
    /// The form of its parts.
    pub form: Form,
    /// Smaller form factors are left out; 0: none.
    pub min_factor: f64,
    /// The choices made because the scene is large, and the settings for others.
    pub reason: Option<String>,
}

impl StoragePolicy {
    /// The storage of a scene's matrix; `form` and `min_factor` as asked for, otherwise by the number of patches and
    /// the tolerance.
    ///
    /// The rows computed do not matter.
    pub fn choose(form: Option<Form>, min_factor: Option<f64>, patches: u32, tolerance: Option<f64>) -> Self {
        let is_large = patches >= LARGE && tolerance.is_none_or(|tolerance| tolerance >= FINE_TOLERANCE);
        let mut chosen = Vec::new();
        let mut otherwise = Vec::new();
        if is_large && form.is_none() {
            chosen.push("compact form".to_owned());
            otherwise.push("--store plain");
        }
        if is_large && min_factor.is_none() {
            chosen.push(format!("form factors below {LEAST_OF_LARGE:e} left out"));
            otherwise.push("--min-factor 0");
        }
        Self {
            form: form.unwrap_or(if is_large { Form::Compact } else { Form::Plain }),
            min_factor: min_factor.unwrap_or(if is_large { LEAST_OF_LARGE } else { 0.0 }),
            reason: (!chosen.is_empty()).then(|| {
                format!(
                    "{}, as there are a million patches and more; `{}` otherwise",
                    chosen.join(", "),
                    otherwise.join(" "),
                )
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fine_tolerance_keeps_everything() {
        let kept = |tolerance| StoragePolicy::choose(None, None, LARGE, Some(tolerance));
        assert_eq!(
            (kept(0.01).form, kept(0.01).min_factor),
            (Form::Compact, LEAST_OF_LARGE)
        );
        assert_eq!((kept(0.001).form, kept(0.001).min_factor), (Form::Plain, 0.0));
        assert_eq!(kept(0.001).reason, None);
    }

    #[test]
    fn what_was_asked_for_stays() {
        let kept = StoragePolicy::choose(Some(Form::Plain), None, LARGE, None);
        assert_eq!((kept.form, kept.min_factor), (Form::Plain, LEAST_OF_LARGE));
        let reason = kept.reason.expect("something was chosen");
        assert!(
            reason.contains("--min-factor 0") && !reason.contains("compact"),
            "{reason}"
        );
        let kept = StoragePolicy::choose(None, Some(1e-5), LARGE, None);
        assert_eq!((kept.form, kept.min_factor), (Form::Compact, 1e-5));
        assert_eq!(StoragePolicy::choose(None, None, LARGE - 1, None).reason, None);
    }
}
