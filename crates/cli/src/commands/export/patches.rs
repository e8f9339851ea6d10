//! Results of each patch, on the model: for ParaView, viewers, mesh tools and tables.

use super::Arguments;
use crate::args::{EngineSettings, Talk};
use crate::exit::{Exit, hinted};
use crate::picture::canvas::{byte, shown};
use crate::picture::model::Tone;
use crate::report::{self, JsonReport, SCHEMA, counted, figures, size};
use crate::stored::{self, Limits};
use anyhow::{Result, anyhow};
use hemicube::sky::sky_view_factors_beside;
use hemicube::solve::StoredSolution;
use hemicube::store::Store;
use hemicube_export::{Colors, Column, Legend, PatchFormat, PatchResults, Values, write_patches};
use hemicube_scene::Axis;
use serde::Serialize;
use std::path::Path;

/// `solve`'s names for the bands of an eye.
const EYE: [&str; 3] = ["red", "green", "blue"];

#[derive(Serialize)]
struct Report<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    path: &'a Path,
    format: PatchFormat,
    patches: usize,
    columns: Vec<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    colors: Option<&'a Legend>,
    bytes: u64,
}

pub(super) fn run(arguments: &Arguments, format: PatchFormat, json: Option<JsonReport>, talk: Talk) -> Result<Exit> {
    report::require_matrix(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    if !arguments.allow_incomplete {
        store.require_complete()?;
    }
    let scene = if format.needs_corners() {
        Some(stored::scene_file(
            &store,
            arguments.scene.as_deref(),
            "`--scene SCENE`",
        )?)
    } else {
        arguments.scene.clone()
    };
    let mut results = read(&store, arguments, talk)?;
    let mut of_line = "patch";
    if let Some(path) = &scene {
        let prepared = stored::scene(
            &store,
            path,
            &EngineSettings::default(),
            Limits::of(arguments.allow_large),
        )?;
        let up = if format.is_upright() {
            prepared.tell_up(arguments.up, talk);
            prepared.up(arguments.up)?
        } else {
            Axis::Z
        };
        if let Some(grouping) = &prepared.grouping {
            results.spread(grouping)?;
            of_line = "triangle";
        }
        results.place(&prepared.patches, up)?;
    }
    if format.has_colors() {
        let column = match &arguments.show {
            Some(name) => name.clone(),
            None => telling(&results),
        };
        results.colors = Some(colors(&results, &column, arguments.range)?);
    }
    let Some(bytes) = super::interruptible(arguments, talk, |options| {
        write_patches(&results, arguments.output(), format, options)
    })?
    else {
        return Ok(Exit::Interrupted);
    };
    let columns: Vec<&str> = match format.has_results() {
        true => results.columns.iter().map(|column| column.name.as_str()).collect(),
        false => vec!["patch"],
    };
    talk.say(&format!(
        "`{}`: {}, {} with {}",
        arguments.output().display(),
        size(bytes),
        counted(results.patch_count() as u64, of_line),
        columns.join(", ")
    ));
    let legend = results.colors.as_ref().map(|colors| &colors.legend);
    if let Some(legend) = legend {
        let range = legend.range.map_or_else(String::new, |[low, high]| {
            format!(" from {} to {}", figures(low), figures(high))
        });
        talk.say(&format!("coloured by {}: {}{range}", legend.quantity, legend.color_map));
    }
    if let Some(json) = json {
        json.write(&Report {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            path: arguments.output(),
            format,
            patches: results.patch_count(),
            columns,
            colors: legend,
            bytes,
        })?;
    }
    Ok(Exit::Done)
}

/// All results: the store's own, the sky beside it, solutions.
fn read(store: &Store, arguments: &Arguments, talk: Talk) -> Result<PatchResults> {
    let mut names = arguments.solution.clone();
    if names.is_empty() {
        for name in StoredSolution::names(store) {
            match StoredSolution::open(store, &name) {
                Ok(_) => names.push(name),
                // Nobody asked for it by its name.
                Err(error) => talk.warn(&format!("the solution `{name}` is left out: {error}")),
            }
        }
    }
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut results = PatchResults::read(store, &names)?;
    if store.directory().join("sky").join("sky.npz").exists() {
        match stored::sky(store) {
            Ok(_) => results.push("sky_view_factor", sky_view_factors_beside(store)?)?,
            Err(error) => talk.warn(&format!("the sky is left out: {error}")),
        }
    }
    Ok(results)
}

/// The name of the most telling column: light or heat, the sky, what escapes, or the number of patches in sight.
fn telling(results: &PatchResults) -> String {
    let mut columns = results.columns.iter();
    let solved = |ending| {
        let mut columns = results.columns.iter();
        columns.find(move |column: &&Column| column.name.ends_with(ending))
    };
    if let Some(column) = solved("flux").or_else(|| solved("radiosity")) {
        return match components_of_eye(column) {
            true => column.name.clone(),
            false => column.labels().swap_remove(0),
        };
    }
    let says = |column: &&Column| {
        let tells = column.name == "sky_view_factor" || column.name == "escaped";
        tells && matches!(&column.values, Values::Real(values) if values.iter().any(|&value| value > 0.0))
    };
    // The sky comes after the escaped share, and is the better of the two.
    columns
        .rfind(says)
        .map_or_else(|| "seen".to_owned(), |column| column.name.clone())
}

fn components_of_eye(column: &Column) -> bool {
    column.components.is_empty() || column.components == EYE
}

/// The colours of a column, or of one of its components.
fn colors(results: &PatchResults, name: &str, range: Option<[f64; 2]>) -> Result<Colors> {
    if let Some(column) = results.column(name)
        && column.components == EYE
        && let Values::Real(values) = &column.values
    {
        if range.is_some() {
            return Err(hinted(
                anyhow!("`{name}` is light in red, green and blue, which no `--range` is for"),
                format!("`--show {name}_red --range` shows one band on a scale"),
            ));
        }
        return Ok(of_light(results, name, values.as_chunks::<3>().0));
    }
    if let Some(values) = results.numbers(name) {
        return Ok(Colors::on_scale(name, &values, range));
    }
    Err(hinted(
        anyhow!("there is no `{name}` to show"),
        format!("there are {}", results.labels().join(", ")),
    ))
}

fn of_light(results: &PatchResults, name: &str, light: &[[f64; 3]]) -> Colors {
    let areas = match results.column("area").map(|column| &column.values) {
        Some(Values::Real(areas)) => areas.as_slice(),
        _ => &[],
    };
    let light: Vec<[f64; 3]> = light.iter().map(|light| light.map(|band| band.max(0.0))).collect();
    let tone = Tone::of(light.iter().copied().zip(areas.iter().copied()));
    Colors {
        srgb: light
            .iter()
            .map(|&light| tone.map(light).map(|channel| byte(shown(channel))))
            .collect(),
        legend: Legend {
            quantity: name.to_owned(),
            color_map: "red, green and blue as an eye sees them, tone-mapped (Reinhard et al. 2002)".to_owned(),
            range: None,
        },
    }
}
