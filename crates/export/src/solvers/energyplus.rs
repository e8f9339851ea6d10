//! EnergyPlus' `ZoneProperty:UserViewFactors:BySurfaceName`, as IDF or epJSON: an object to put into a model.
//!
//! Read: EnergyPlus 9.3, `src/EnergyPlus/HeatBalanceIntRadExchange.cc` (`GetInputViewFactorsbyName`: names of the
//! surface from and to, then the factor; a pair left out is 0; a name that is not of the enclosure ends the run.
//! `FixViewFactors`: a row is of the surface from and sums to 1; A_i F_ij and A_j F_ji are averaged and rows scaled
//! until both hold), and the order of fields in EnergyPlus 22.1 and later
//! (`zone_or_zonelist_or_space_or_spacelist_name`, before that `zone_or_zonelist_name`).
//!
//! Surfaces are objects by their names, which EnergyPlus compares without case. All of them are one enclosure: what
//! sees no more than 10⁻⁶ of the others, which rounding makes, is refused.

use super::{SolverJob, SolverWriter};
use crate::faces::{Faces, Found, Grouping, Needs, Sums};
use crate::write::{Cancellable, too_large};
use crate::{Error, Result, UnfitStep};
use hemicube_solve::analysis::zones::GroupBy;
use hemicube_solve::solve::LEAST_EXCHANGE;
use std::collections::HashSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Surfaces of an enclosure: EnergyPlus takes all pairs.
const SURFACES_MAX: usize = 4096;
const OBJECT: &str = "ZoneProperty:UserViewFactors:BySurfaceName";

pub(crate) struct EnergyPlus;

/// The form by the extension; `None` for neither.
pub(super) fn is_json(path: &Path) -> Option<bool> {
    match path.extension()?.to_string_lossy().to_ascii_lowercase().as_str() {
        "epjson" | "json" => Some(true),
        "idf" => Some(false),
        _ => None,
    }
}

/// The one file of a model, in the form that its extension names.
pub(super) fn path_of_model(faces: &Faces<'_>, path: &Path) -> Result<Vec<PathBuf>> {
    match is_json(path) {
        Some(_) => Ok(vec![path.to_owned()]),
        None => Err(faces.unfit(
            format!("`{}` does not say which form of model is wanted", path.display()),
            "end OUT in `.idf` or `.epJSON`",
        )),
    }
}

impl SolverWriter for EnergyPlus {
    fn needs(&self) -> Needs {
        Needs {
            grouping: Grouping::By(GroupBy::Object),
            sums: Sums::One,
            reciprocal: false,
        }
    }

    fn paths(&self, faces: &Faces<'_>, path: &Path) -> Result<Vec<PathBuf>> {
        path_of_model(faces, path)
    }

    fn forecast(&self, faces: &Faces<'_>, _: &Found, path: &Path) -> Result<Option<u64>> {
        if faces.len() > SURFACES_MAX {
            return Err(too_large(
                path,
                "EnergyPlus takes all pairs of surfaces, and this writer 4,096 surfaces",
            ));
        }
        names_are_good(faces)?;
        is_one_enclosure(faces)?;
        Ok(Some(32 * (faces.len() * faces.len()) as u64))
    }

    fn write(&self, job: &SolverJob<'_>, files: &mut [Cancellable<'_>]) -> Result<()> {
        let faces = job.faces;
        let Some(zone) = job.options.zone else {
            return Err(faces.unfit("no zone is named", UnfitStep::NameZone));
        };
        if let Some(c) = forbidden(zone) {
            return Err(faces.unfit(
                format!("zone `{zone}` has `{c}`"),
                "IDF keeps `,`, `;` and `!` to itself",
            ));
        }
        let json = is_json(&job.paths[0]) == Some(true);
        let count = faces.len();
        let quoted = |text: &str| serde_json::Value::from(text).to_string();
        let begin = match json {
            true => format!(
                "{{\n  \"{OBJECT}\": {{\n    \"{OBJECT} 1\": {{\n      \"{}\": {},\n      \"view_factors\": [\n",
                field(job.options.version),
                quoted(zone)
            ),
            false => format!("{OBJECT},\n  {zone},\n"),
        };
        job.put(files, 0, begin.as_bytes())?;
        let mut text = String::new();
        for (place, from) in faces.faces.iter().enumerate() {
            let row = faces.row(place)?;
            let mut next = row.iter().peekable();
            text.clear();
            for (column, to) in faces.faces.iter().enumerate() {
                let factor = next
                    .next_if(|&&(at, _)| at as usize == column)
                    .map_or(0.0, |&(_, factor)| factor);
                let is_last = place + 1 == count && column + 1 == count;
                // Writing to a string cannot fail.
                let _ = match json {
                    true => writeln!(
                        text,
                        "        {{\"from_surface\": {}, \"to_surface\": {}, \"view_factor\": {factor:.9}}}{}",
                        quoted(&from.name),
                        quoted(&to.name),
                        if is_last { "" } else { "," }
                    ),
                    false => writeln!(
                        text,
                        "  {},{},{factor:.9}{}",
                        from.name,
                        to.name,
                        if is_last { ";" } else { "," }
                    ),
                };
            }
            job.put(files, 0, text.as_bytes())?;
        }
        if json {
            job.put(files, 0, b"      ]\n    }\n  }\n}\n")?;
        }
        Ok(())
    }

    fn next(&self, _: &Faces<'_>, _: &Found, paths: &[PathBuf]) -> String {
        format!(
            "EnergyPlus: add the object of `{}` to the model; surfaces not named see nothing",
            paths[0].display()
        )
    }
}

/// The field of the zone's name, by the version; the newest unless one is named.
fn field(version: Option<&str>) -> &'static str {
    let major = version.and_then(|version| version.split('.').next()?.parse::<u32>().ok());
    match major {
        Some(..22) => "zone_or_zonelist_name",
        _ => "zone_or_zonelist_or_space_or_spacelist_name",
    }
}

/// A character that no name in an IDF may have.
fn forbidden(name: &str) -> Option<char> {
    name.chars().find(|&c| matches!(c, ',' | ';' | '!') || c.is_control())
}

pub(super) fn names_are_good(faces: &Faces<'_>) -> Result<()> {
    let mut taken = HashSet::new();
    let next = "name the scene's objects as the model's surfaces";
    for face in &faces.faces {
        let problem = match forbidden(&face.name) {
            Some(c) => Some(format!("has `{}`", c.escape_default())),
            None if face.name.trim().is_empty() => Some("is empty".to_owned()),
            None if !taken.insert(face.name.trim().to_uppercase()) => {
                Some("differs from another by case only".to_owned())
            }
            None => None,
        };
        if let Some(problem) = problem {
            return Err(faces.unfit(format!("the name `{}` {problem}", face.name.escape_debug()), next));
        }
    }
    Ok(())
}

/// Every surface must be joined with every other by pairs that see more of each other than rounding makes.
fn is_one_enclosure(faces: &Faces<'_>) -> std::result::Result<(), Error> {
    let count = faces.len();
    let mut joined = vec![Vec::new(); count];
    for place in 0..count {
        for (column, factor) in faces.row(place)? {
            if factor > LEAST_EXCHANGE {
                joined[place].push(column as usize);
                joined[column as usize].push(place);
            }
        }
    }
    let mut reached = vec![false; count];
    let mut open = vec![0];
    reached[0] = true;
    while let Some(place) = open.pop() {
        for &other in &joined[place] {
            if !std::mem::replace(&mut reached[other], true) {
                open.push(other);
            }
        }
    }
    match reached.iter().position(|&is| !is) {
        None => Ok(()),
        Some(other) => Err(faces.unfit(
            format!("{} and {} are of two enclosures", faces.named(0), faces.named(other)),
            UnfitStep::ZoneByZone,
        )),
    }
}
