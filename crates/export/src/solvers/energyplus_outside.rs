//! EnergyPlus' surroundings of exterior surfaces, as IDF or epJSON: `SurfaceProperty:SurroundingSurfaces` with the view
//! factors of sky, ground and other surfaces, and the `SurfaceProperty:LocalEnvironment` that gives it to a surface.
//!
//! Read: EnergyPlus 9.4 to 22.2, the dictionary's entries of both (fields: name, sky view factor, schedule of the sky's
//! temperature, ground view factor, schedule of the ground's, then name, view factor and schedule of the temperature of
//! each surrounding surface), the schema's names of them, and the design document of local ground properties (a factor
//! that is not given is made up of what the others leave of 1). Before 9.4 there is no ground.
//!
//! Surfaces are objects by their names, and so are those around them: their names need not be the model's. Of what
//! escapes, the sky rows beside the matrix tell what lies below the horizon. A surrounding surface has the temperature of
//! a schedule by its name, which the model has to have: nothing here knows it.

use super::energyplus::{is_json, names_are_good, path_of_model};
use super::{SolverJob, SolverWriter};
use crate::faces::{Faces, Found, Grouping, Needs, Sums};
use crate::write::Cancellable;
use crate::{Result, UnfitStep};
use hemicube_solve::analysis::zones::{GroupBy, surfaces_of};
use hemicube_store::sky::StoredSky;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// View factors that are left out: the file's digits.
const LEAST: f64 = 5e-7;
/// Share of backs in a surface's view from which on it is said: they are neither sky nor ground nor a surface. A choice:
/// with less, errors of the matrix are named; with more, surfaces that see less than is written are not.
const BACKS: f64 = 0.01;
const SURROUNDINGS: &str = "SurfaceProperty:SurroundingSurfaces";
const ENVIRONMENT: &str = "SurfaceProperty:LocalEnvironment";

pub(crate) struct EnergyPlusOutside;

/// The share of each face's view that leaves the scene below the horizon.
fn grounds(faces: &Faces<'_>) -> Result<Vec<f64>> {
    let Grouping::By(by @ (GroupBy::Object | GroupBy::Material)) = faces.grouping else {
        return Err(faces.unfit("EnergyPlus knows surfaces by their names", UnfitStep::ByName));
    };
    let store = faces.store;
    let sky = StoredSky::beside(store).map_err(|error| {
        faces.unfit(
            format!("what of the view is sky, and what ground, is not known ({error})"),
            UnfitStep::ComputeSky,
        )
    })?;
    let (table, shares) = (store.patches()?, store.row_table()?);
    let (surfaces, surface_of) = surfaces_of(store, &table, by)?;
    let (mut below, mut area) = (vec![0.0; surfaces.len()], vec![0.0; surfaces.len()]);
    for (patch, &surface) in surface_of.iter().enumerate() {
        let (columns, parts) = sky.row(patch);
        let whole: f64 = parts.iter().sum();
        // Column 0 is the ground.
        let ground = columns
            .iter()
            .zip(parts)
            .find(|(column, _)| **column == 0)
            .map_or(0.0, |(_, part)| *part);
        let escaped = shares.escaped[patch];
        let surface = surface as usize;
        area[surface] += table.area[patch];
        if whole > 0.0 && escaped > 0.0 {
            below[surface] += table.area[patch] * escaped * (ground / whole).min(1.0);
        }
    }
    let shares = below.iter().zip(&area).map(|(below, area)| below / area);
    let of_names: HashMap<&str, f64> = surfaces.iter().map(|surface| &*surface.name).zip(shares).collect();
    let of = |name: &str| of_names.get(name).copied().filter(|share| share.is_finite());
    Ok(faces.faces.iter().map(|face| of(&face.name).unwrap_or(0.0)).collect())
}

/// A surface's surroundings.
struct Around<'a> {
    name: &'a str,
    sky: f64,
    ground: f64,
    others: Vec<(&'a str, f64)>,
}

impl Around<'_> {
    fn idf(&self) -> String {
        let Self { name, sky, ground, .. } = self;
        let mut text = format!(
            "{ENVIRONMENT},\n  {name} environment,\n  {name},\n  ,\n  {name} surroundings;\n\n{SURROUNDINGS},\n  \
             {name} surroundings,\n  {sky:.6},\n  ,\n  {ground:.6},\n  "
        );
        for (other, factor) in &self.others {
            // Writing to a string cannot fail.
            let _ = write!(text, ",\n  {other},\n  {factor:.6},\n  {other} temperature");
        }
        text.push_str(";\n\n");
        text
    }

    fn environment(&self) -> (String, serde_json::Value) {
        let value = serde_json::json!({
            "exterior_surface_name": self.name,
            "surrounding_surfaces_object_name": format!("{} surroundings", self.name),
        });
        (format!("{} environment", self.name), value)
    }

    fn surroundings(&self) -> (String, serde_json::Value) {
        let rounded = |factor: f64| (factor * 1e6).round() / 1e6;
        let surfaces = self.others.iter().map(|&(other, factor)| {
            serde_json::json!({
                "surrounding_surface_name": other,
                "surrounding_surface_view_factor": rounded(factor),
                "surrounding_surface_temperature_schedule_name": format!("{other} temperature"),
            })
        });
        let value = serde_json::json!({
            "sky_view_factor": rounded(self.sky),
            "ground_view_factor": rounded(self.ground),
            "surfaces": surfaces.collect::<Vec<_>>(),
        });
        (format!("{} surroundings", self.name), value)
    }
}

impl SolverWriter for EnergyPlusOutside {
    fn needs(&self) -> Needs {
        Needs {
            grouping: Grouping::By(GroupBy::Object),
            sums: Sums::AtMostOne,
            reciprocal: false,
        }
    }

    fn paths(&self, faces: &Faces<'_>, path: &Path) -> Result<Vec<PathBuf>> {
        path_of_model(faces, path)
    }

    fn forecast(&self, faces: &Faces<'_>, found: &Found, _: &Path) -> Result<Option<u64>> {
        names_are_good(faces)?;
        Ok(Some(100 * (found.entries + faces.len() as u64)))
    }

    fn write(&self, job: &SolverJob<'_>, files: &mut [Cancellable<'_>]) -> Result<()> {
        let faces = job.faces;
        let grounds = grounds(faces)?;
        let around = |place: usize| -> Result<Around<'_>> {
            let (face, ground) = (&faces.faces[place], grounds[place]);
            let row = faces.row(place)?.into_iter().filter(|(_, factor)| *factor >= LEAST);
            Ok(Around {
                name: &face.name,
                sky: (face.escaped - ground).max(0.0),
                ground,
                others: row
                    .map(|(to, factor)| (&*faces.faces[to as usize].name, factor))
                    .collect(),
            })
        };
        if is_json(&job.paths[0]) != Some(true) {
            for place in 0..faces.len() {
                job.put(files, 0, around(place)?.idf().as_bytes())?;
            }
            return Ok(());
        }
        let (mut environments, mut surroundings) = (serde_json::Map::new(), serde_json::Map::new());
        for place in 0..faces.len() {
            let around = around(place)?;
            environments.extend([around.environment()]);
            surroundings.extend([around.surroundings()]);
        }
        let model = serde_json::json!({ ENVIRONMENT: environments, SURROUNDINGS: surroundings });
        job.put(files, 0, format!("{model:#}\n").as_bytes())
    }

    fn next(&self, faces: &Faces<'_>, _: &Found, paths: &[PathBuf]) -> String {
        let mut text = format!(
            "EnergyPlus: add the objects of `{}` to the model, and a schedule `NAME temperature` (°C) for each surface that \
             another sees; leave out surfaces that are not the model's",
            paths[0].display()
        );
        let blocked = || faces.faces.iter().filter(|face| face.blocked > BACKS);
        if let Some(most) = blocked().max_by(|a, b| a.blocked.total_cmp(&b.blocked)) {
            // Writing to a string cannot fail.
            let _ = write!(
                text,
                "; backs of one-sided surfaces are in no view factor: of {} surfaces they fill more than {} % of the view, \
                 `{}` most, {:.1} %",
                blocked().count(),
                100.0 * BACKS,
                most.name,
                100.0 * most.blocked
            );
        }
        text
    }
}
