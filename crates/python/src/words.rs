//! What libraries advise, in the keywords of the package.

use hemicube::solve::PropertyStep;
use hemicube_export::UnfitStep;
use hemicube_scene::{Error as SceneError, ErrorKind};

/// What helps against an error of a scene's file, if a keyword does.
pub(crate) fn of_scene(error: &SceneError) -> Option<&'static str> {
    match &error.kind {
        ErrorKind::OverLimit(_) => Some("`allow_large=True` lifts the limit"),
        _ => None,
    }
}

/// How to give surfaces what they lack.
pub(crate) fn of_properties(step: &PropertyStep) -> String {
    match step {
        PropertyStep::WithoutScene => "leave the scene's properties out".to_owned(),
        PropertyStep::Reflectance => {
            "`properties` names them: `{'material': {'wall': {'reflectance': 0.5}}}`; its table `'default'` is for all \
             that have none"
                .to_owned()
        }
        PropertyStep::Thermal => {
            "`properties` names them: `'emissivity': 0.9`, `'temperature': 300` (kelvin), or `'adiabatic': True`; its \
             table `'default'` is for all that have none"
                .to_owned()
        }
        PropertyStep::Emissivity => {
            "`properties` names it: `'emissivity': 0.9`; its table `'default'` is for all that have none".to_owned()
        }
        PropertyStep::Absorptance => {
            "`properties` names it: `'absorptance': 0.6`; its table `'default'` is for all that have none".to_owned()
        }
        PropertyStep::Patches { kinds, table_of } => {
            let [one, other] = kinds.map(|kind| format!("`patches='{}'`", kind.name()));
            let compute = format!("compute the matrix by {one} or {other}");
            match table_of {
                Some(name) => format!("give {name} one in a table of its object, or {compute}"),
                None => compute,
            }
        }
        PropertyStep::Words(words) => words.clone(),
    }
}

/// How to make a matrix fit a solver.
pub(crate) fn of_export(step: &UnfitStep) -> String {
    match step {
        UnfitStep::NameZone => "name the zone or enclosure by `zone`",
        UnfitStep::ZoneByZone => "compute each zone by itself, and export it with its own `zone`",
        UnfitStep::SameRowsAndColumns => {
            "compute rows and columns of the same patches: leave `emitters` and `receivers` out, or name what only \
             occludes by `occluders`"
        }
        UnfitStep::WithoutMirrors => "compute without `specular`",
        UnfitStep::Close => "close its rows: the program's `hemicube balance` does",
        UnfitStep::Reciprocate => "make it reciprocal: the program's `hemicube balance` does",
        UnfitStep::Check => "`check` says what it has",
        UnfitStep::CloseScene => "close the scene: `inspect` names its holes and surfaces that face outwards",
        UnfitStep::ComputeSky => "compute sky rows beside it: the program's `hemicube sky SCENE` does, with the matrix named",
        UnfitStep::ByName => "take surfaces by objects or materials",
        UnfitStep::CutOrExclude => {
            "a facet that is covered in part, as ground that goes on under a house, has a row of no use: cut it along the \
             house in the modeller, or `exclude` its object; `flip` turns what faces inwards"
        }
        UnfitStep::Words(words) => words,
    }
    .to_owned()
}
