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
/// assert_eq!((small.form, small.min_factor, small.reason()), (Form::Plain, 0.0, None));
///
/// let large = StoragePolicy::choose(None, None, 1_500_000, None);
/// assert_eq!((large.form, large.min_factor), (Form::Compact, 1e-7));
/// assert!(large.is_form_chosen && large.is_min_factor_chosen);
/// assert!(large.reason().is_some_and(|reason| reason.contains("below 1e-7 left out")));
///
/// let all = StoragePolicy::choose(Some(Form::Plain), Some(0.0), 1_500_000, None);
/// assert_eq!((all.form, all.min_factor, all.reason()), (Form::Plain, 0.0, None));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct StoragePolicy {
    /// The form of its parts.
    pub form: Form,
    /// Smaller form factors are left out; 0: none.
    pub min_factor: f64,
    /// True if the form is not asked for, and compact because the scene is large.
    pub is_form_chosen: bool,
    /// True if the least form factor is not asked for, and above 0 because the scene is large.
    pub is_min_factor_chosen: bool,
}

impl StoragePolicy {
    /// The storage of a scene's matrix; `form` and `min_factor` as asked for, otherwise by the number of patches and
    /// the tolerance.
    ///
    /// The rows computed do not matter.
    pub fn choose(form: Option<Form>, min_factor: Option<f64>, patches: u32, tolerance: Option<f64>) -> Self {
        let is_large = patches >= LARGE && tolerance.is_none_or(|tolerance| tolerance >= FINE_TOLERANCE);
        Self {
            is_form_chosen: is_large && form.is_none(),
            is_min_factor_chosen: is_large && min_factor.is_none(),
            form: form.unwrap_or(if is_large { Form::Compact } else { Form::Plain }),
            min_factor: min_factor.unwrap_or(if is_large { LEAST_OF_LARGE } else { 0.0 }),
        }
    }

    /// The choices made because the scene is large; `None` without any.
    pub fn reason(&self) -> Option<String> {
        let form = self.is_form_chosen.then(|| "compact form".to_owned());
        let left_out = || format!("form factors below {LEAST_OF_LARGE:e} left out");
        let chosen: Vec<String> = form
            .into_iter()
            .chain(self.is_min_factor_chosen.then(left_out))
            .collect();
        (!chosen.is_empty()).then(|| format!("{}, as there are a million patches and more", chosen.join(", ")))
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
        assert_eq!(kept(0.001).reason(), None);
    }

    #[test]
    fn what_was_asked_for_stays() {
        let kept = StoragePolicy::choose(Some(Form::Plain), None, LARGE, None);
        assert_eq!((kept.form, kept.min_factor), (Form::Plain, LEAST_OF_LARGE));
        let reason = kept.reason().expect("something was chosen");
        assert!(reason.contains("left out") && !reason.contains("compact"), "{reason}");
        let kept = StoragePolicy::choose(None, Some(1e-5), LARGE, None);
        assert_eq!((kept.form, kept.min_factor), (Form::Compact, 1e-5));
        assert_eq!(StoragePolicy::choose(None, None, LARGE - 1, None).reason(), None);
    }
}
