//! What libraries advise, in the words of the command line: options, and commands that say more.

use hemicube::diagnose::Remedy;
use hemicube::driver::input::InputError;
use hemicube::driver::job::JobError;
use hemicube::driver::storage_policy::StoragePolicy;
use hemicube::solve::{PropertyError, PropertyStep};
use hemicube::store::Error as StoreError;
use hemicube_export::{Error as ExportError, UnfitStep};
use hemicube_scene::{Error as SceneError, ErrorKind, NoRoom};
use std::error::Error;
use std::path::Path;

/// The next step after an error of a library, if it has one.
pub(crate) fn of_error(error: &anyhow::Error) -> Option<String> {
    error.chain().find_map(of_cause)
}

fn of_cause(cause: &(dyn Error + 'static)) -> Option<String> {
    if let Some(error) = cause.downcast_ref::<SceneError>() {
        return of_scene(error);
    }
    if let Some(InputError::Patches(error)) = cause.downcast_ref::<InputError>() {
        return of_scene(error);
    }
    if let Some(refused) = cause.downcast_ref::<NoRoom>() {
        return Some(more_memory(refused));
    }
    if let Some(error) = cause.downcast_ref::<PropertyError>() {
        return error.step.as_ref().map(of_properties);
    }
    if let Some(JobError::MixedOptics { by, .. }) = cause.downcast_ref::<JobError>() {
        return Some(format!("`--by {by}` has no such patches"));
    }
    if let Some(error) = cause.downcast_ref::<ExportError>() {
        return match error {
            ExportError::Unfit { store, next, .. } => Some(of_export(next, store)),
            _ => None,
        };
    }
    match cause.downcast_ref::<StoreError>() {
        Some(StoreError::Exists { .. }) => Some("`--overwrite` replaces it, or choose another name".to_owned()),
        _ => None,
    }
}

fn of_scene(error: &SceneError) -> Option<String> {
    match &error.kind {
        ErrorKind::OverLimit(_) => Some("`--allow-large` lifts the limit".to_owned()),
        ErrorKind::NoRoom(refused) => Some(more_memory(refused)),
        _ => None,
    }
}

/// The bound that would do.
pub(crate) fn more_memory(refused: &NoRoom) -> String {
    // In whole megabytes, so that it does suffice.
    format!("`--memory {}M` allows it", refused.megabytes())
}

/// How to give surfaces what they lack.
pub(crate) fn of_properties(step: &PropertyStep) -> String {
    match step {
        PropertyStep::WithoutScene => "leave out `--scene`".to_owned(),
        PropertyStep::Reflectance => {
            "`--scene SCENE` takes those of the scene's file, `--materials FILE` names others; its table `[default]` is \
             for all that have none"
                .to_owned()
        }
        PropertyStep::Thermal => {
            "`--materials FILE` names them: `emissivity = 0.9`, `temperature = 300` (kelvin), or `adiabatic = true`; its \
             table `[default]` is for all that have none"
                .to_owned()
        }
        PropertyStep::Emissivity => {
            "`--materials FILE` names it: `emissivity = 0.9`; its table `[default]` is for all that have none".to_owned()
        }
        PropertyStep::Absorptance => {
            "`--materials FILE` names it: `absorptance = 0.6`, the share of sunlight that is absorbed; its table `[default]` \
             is for all that have none"
                .to_owned()
        }
        PropertyStep::Patches { kinds, table_of } => {
            let [one, other] = kinds.map(|kind| format!("`--by {}`", kind.name()));
            let compute = format!("compute the matrix by {one} or {other}");
            match table_of {
                Some(name) => format!("give {name} one in a table of its object, or {compute}"),
                None => compute,
            }
        }
        PropertyStep::Words(words) => words.clone(),
    }
}

/// How to make a matrix of `store` fit a solver.
fn of_export(step: &UnfitStep, store: &Path) -> String {
    let store = store.display();
    let balance = |option: &str| format!("`hemicube balance {store} -o balanced.hemicube {option}`, and export that");
    match step {
        UnfitStep::NameZone => "name the zone or enclosure by `--zone NAME`".to_owned(),
        UnfitStep::ZoneByZone => "compute each zone by itself, and export it with its own `--zone`".to_owned(),
        UnfitStep::SameRowsAndColumns => {
            "compute rows and columns of the same patches: leave `--emitters` and `--receivers` out, or name what only \
             occludes by `--occluders`"
                .to_owned()
        }
        UnfitStep::WithoutMirrors => {
            "`hemicube exchange` has what surfaces exchange by them; or compute without `--specular`".to_owned()
        }
        UnfitStep::Close => balance("--closure"),
        UnfitStep::Reciprocate => balance("--reciprocity"),
        UnfitStep::Check => format!("`hemicube check {store}` says what it has"),
        UnfitStep::CloseScene => {
            "close the scene: `hemicube inspect SCENE` names its holes and surfaces that face outwards".to_owned()
        }
        UnfitStep::ComputeSky => {
            format!("`hemicube sky SCENE --matrix {store}` computes it, with `--up` where the scene does not say")
        }
        UnfitStep::ByName => "leave `--by` out, or take `--by material`".to_owned(),
        UnfitStep::CutOrExclude => {
            "a facet that is covered in part, as ground that goes on under a house, has a row of no use: cut it along the \
             house in the modeller, or `compute --exclude NAME` where it is an object; `hemicube inspect` names what \
             faces inwards, and `compute --flip NAME` turns it"
                .to_owned()
        }
        UnfitStep::Words(words) => words.clone(),
    }
}

/// The options that do what helps against a finding; empty without any.
pub(crate) fn of_finding(helps: &[Remedy]) -> String {
    let option = |remedy: &Remedy| match remedy {
        Remedy::Split => "`--split 2`".to_owned(),
        Remedy::PatchSize(length) => format!("`--patch-size {length}`"),
        Remedy::TwoSided => "`--two-sided=on`".to_owned(),
        Remedy::Flip => "`--flip NAME`".to_owned(),
        Remedy::Emitters => "`--emitters NAME`".to_owned(),
        Remedy::Tolerance => "`--tolerance`".to_owned(),
    };
    let options: Vec<String> = helps.iter().map(option).collect();
    options.join(", ")
}

/// What was chosen because the scene is large, and the options for the opposite; `None` where nothing was.
pub(crate) fn of_storage(policy: &StoragePolicy) -> Option<String> {
    let form = policy.is_form_chosen.then_some("--form plain");
    let least = policy.is_min_factor_chosen.then_some("--min-factor 0");
    let otherwise: Vec<&str> = form.into_iter().chain(least).collect();
    Some(format!("{}; `{}` otherwise", policy.reason()?, otherwise.join(" ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context;
    use std::path::PathBuf;

    #[test]
    fn the_step_is_found_beneath_context() {
        let error: anyhow::Result<()> = Err(StoreError::Exists {
            path: PathBuf::from("box"),
        })
        .context("the matrix cannot be written");
        let error = error.expect_err("it is one");
        assert_eq!(
            of_error(&error).as_deref(),
            Some("`--overwrite` replaces it, or choose another name")
        );
        assert_eq!(of_error(&anyhow::anyhow!("no library's")), None);
    }
}
