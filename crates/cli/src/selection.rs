//! Patches that have rows and columns, by the settings' globs.

use crate::args::SelectionSettings;
use crate::exit::hinted;
use anyhow::{Result, anyhow};
use hemicube::driver::compute::Selection;
use hemicube::driver::selection::{Names, NoMatch};
pub(crate) use hemicube::driver::selection::{matches_glob, matching_objects};
use hemicube_scene::{Patches, Scene};

/// The rows and columns that the settings ask for.
///
/// # Errors
/// When a glob matches nothing.
pub(crate) fn selection(scene: &Scene, patches: &Patches, settings: &SelectionSettings) -> Result<Selection> {
    let names = Names {
        emitters: &settings.emitters,
        receivers: &settings.receivers,
        occluders: &settings.occluders,
    };
    Selection::by_name(scene, patches, names).map_err(no_match)
}

/// A glob that matches nothing, with the names that there are.
pub(crate) fn no_match(error: NoMatch) -> anyhow::Error {
    hinted(
        anyhow!(
            "`--{} {}` matches no object and no material of a patch",
            error.list,
            error.glob
        ),
        error.there,
    )
}
