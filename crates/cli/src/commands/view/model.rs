//! `hemicube view model`: the model in the colours of a solution, a row, the sky, or a property of each row.

use crate::args::{EngineSettings, Talk};
use crate::exit::Exit;
use crate::picture::canvas::Format;
use crate::picture::model::{Camera, Scale, Values, draw, of_solution};
use crate::report::{count, counted};
use crate::stored::{self, Limits};
use anyhow::{Result, anyhow, bail};
use clap::Args;
use hemicube::InputPatch;
use hemicube::sky::sky_view_factors_beside;
use hemicube::solve::StoredSolution;
use hemicube::store::Store;
use hemicube_scene::Side;
use std::path::PathBuf;
use std::str::FromStr;

/// `hemicube view model`
#[derive(Args, Debug)]
pub(crate) struct Arguments {
    /// The matrix
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// The scene that it is of [default: the one that the matrix names, beside it or here]
    #[arg(value_name = "SCENE")]
    pub(crate) scene: Option<PathBuf>,
    /// The picture: .png or .svg
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Replace what is there
    #[arg(long)]
    pub(crate) overwrite: bool,
    /// radiosity (or irradiance, flux, temperature of a solution), seen (patches in sight), row, sky, error (expected
    /// of each row), closure (how far each row is from closing) [default: a solution's, else sky, else seen]
    #[arg(long, value_name = "WHAT")]
    pub(crate) show: Option<Show>,
    /// The patch whose row is shown
    #[arg(long, value_name = "I", required_if_eq("show", "row"))]
    pub(crate) patch: Option<u32>,
    /// Which solution: `radiosity`, or the only one, where none is given
    #[arg(long, value_name = "NAME")]
    pub(crate) solution: Option<String>,
    /// Read a scene of which more would come than a file of its size may become (docs/security.md)
    #[arg(long, hide_short_help = true)]
    pub(crate) allow_large: bool,
    #[command(flatten)]
    pub(crate) camera: Camera,
}

impl Arguments {
    /// Refuses options of what is not shown.
    fn require_shown(&self) -> Result<()> {
        if self.patch.is_some() && self.show != Some(Show::Row) {
            bail!("`--patch` chooses a row, and `--show row` is not given");
        }
        if self.solution.is_some() && !matches!(self.show, None | Some(Show::Quantity(_))) {
            bail!("`--solution` is of radiosity, irradiance, flux or temperature, and `--show` names none of them");
        }
        Ok(())
    }
}

/// Quantity shown by colours.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Show {
    /// A quantity of a solution.
    Quantity(String),
    /// Number of patches in sight.
    Seen,
    /// One row.
    Row,
    /// Sky view factors.
    Sky,
    /// The expected error of each row.
    Error,
    /// Distance of each row's sum from 1.
    Closure,
}

impl FromStr for Show {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "seen" => Ok(Self::Seen),
            "row" => Ok(Self::Row),
            "sky" => Ok(Self::Sky),
            "error" => Ok(Self::Error),
            "closure" => Ok(Self::Closure),
            "radiosity" | "irradiance" | "flux" | "temperature" => Ok(Self::Quantity(text.to_owned())),
            _ => Err(
                "there are `radiosity`, `irradiance`, `flux`, `temperature`, `seen`, `row`, `sky`, `error` and \
                    `closure`"
                    .to_owned(),
            ),
        }
    }
}

/// What is shown unasked: a solution, if there is one or one is named; sky view factors; what is in sight.
fn what_there_is(store: &Store, named: Option<&str>) -> Result<Show> {
    if named.is_some() || !StoredSolution::names(store).is_empty() {
        let is_heat = solution(store, named)?.quantities().contains(&"flux");
        return Ok(Show::Quantity(if is_heat { "flux" } else { "radiosity" }.to_owned()));
    }
    Ok(if stored::sky(store).is_ok() {
        Show::Sky
    } else {
        Show::Seen
    })
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    Format::of(&arguments.output)?;
    arguments.require_shown()?;
    crate::report::require_matrix(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let patches = store.patch_count() as usize;
    let scene = stored::scene_file(
        &store,
        arguments.scene.as_deref(),
        "`hemicube view model DIR SCENE -o FILE`",
    )?;
    let show = match &arguments.show {
        Some(show) => show.clone(),
        None => what_there_is(&store, arguments.solution.as_deref())?,
    };
    let values = match &show {
        Show::Quantity(quantity) => of_solution(&solution(&store, arguments.solution.as_deref())?, quantity)?,
        Show::Seen => Values::Scale(Scale::linear("patches in sight", in_sight(&store)?)),
        Show::Row => Values::Scale(row(&store, arguments.patch.unwrap_or(0))?),
        Show::Error => Values::Scale(expected_errors(&store)?),
        Show::Closure => Values::Scale(closure_errors(&store)?),
        Show::Sky => {
            stored::sky(&store)?;
            Values::Scale(Scale::linear("sky view factor", sky_view_factors_beside(&store)?))
        }
    };
    let prepared = stored::scene(
        &store,
        &scene,
        &EngineSettings::default(),
        Limits::of(arguments.allow_large),
    )?;
    prepared.tell_up(arguments.camera.up, talk);
    let specular = stored::specular(&store, &prepared)?;
    draw(
        &prepared,
        &values,
        &arguments.camera,
        specular.as_ref(),
        &arguments.output,
    )?;
    let backs = prepared
        .patches
        .iter()
        .filter(|&p| prepared.patches.side(p) == Side::Back)
        .count();
    talk.detail(&format!("{} of the patches are backs", count(backs as u64)));
    talk.say(&format!(
        "`{}`: {}",
        arguments.output.display(),
        counted(patches as u64, "patch")
    ));
    Ok(Exit::Done)
}

/// The solution of a name; without one, `radiosity` or the only one.
fn solution(store: &Store, name: Option<&str>) -> Result<StoredSolution> {
    const USUAL: &str = "radiosity";
    let names = StoredSolution::names(store);
    let name = match (name, &names[..]) {
        (Some(name), _) => name,
        (None, [only]) => only,
        (None, names) if names.len() > 1 && names.iter().all(|name| name != USUAL) => bail!(
            "the matrix has the solutions `{}`; choose one by `--solution`",
            names.join("`, `")
        ),
        _ => USUAL,
    };
    stored::solution(store, name)
}

/// Number of patches in sight of each patch; NaN without a row.
fn in_sight(store: &Store) -> Result<Vec<f64>> {
    let mut values = vec![f64::NAN; store.patch_count() as usize];
    for index in 0..store.manifest().parts.len() {
        let Some(part) = store.part(index)? else { continue };
        for (row, &patch) in part.rows.iter().enumerate() {
            values[patch as usize] = part.row(row).0.len() as f64;
        }
    }
    Ok(values)
}

/// Form factors from one patch.
fn row(store: &Store, patch: u32) -> Result<Scale> {
    let patches = store.patch_count();
    if patch >= patches {
        bail!(
            "`--patch {patch}`: the matrix has {}, from 0 on",
            counted(patches.into(), "patch")
        );
    }
    let row = store
        .row(InputPatch(patch))?
        .ok_or_else(|| anyhow!("the row of patch {patch} was not computed"))?;
    let mut values = vec![f64::NAN; patches as usize];
    for (&column, factor) in row.indices.iter().zip(&row.data) {
        values[column as usize] = factor;
    }
    Ok(Scale {
        logarithmic: true,
        marked: Some(patch),
        ..Scale::linear(format!("form factor from patch {patch} (red)"), values)
    })
}

/// Expected errors √Σ (F − true F)² of the rows.
fn expected_errors(store: &Store) -> Result<Scale> {
    let missing = "expected errors: a matrix of `compute --tolerance` does";
    of_rows(
        store,
        "expected √Σ (F − true F)² of each row",
        store.row_table()?.error,
        missing,
    )
}

/// Distances |ΣF + escaped + blocked + unselected − 1| of the rows.
fn closure_errors(store: &Store) -> Result<Scale> {
    let rows = store.row_table()?;
    let losses = rows.escaped.iter().zip(&rows.blocked).zip(&rows.unselected);
    let closure = rows
        .row_sum
        .iter()
        .zip(losses)
        .map(|(sum, ((escaped, blocked), unselected))| (sum + escaped + blocked + unselected - 1.0).abs());
    let missing = "closure errors: every row sums to 1, or the matrix is not complete";
    of_rows(
        store,
        "|sum of F + escaped + blocked − 1| of each row",
        closure.collect(),
        missing,
    )
}

/// Errors of rows on a logarithmic scale.
///
/// # Errors
/// When all are 0: there is nothing to put on a scale.
fn of_rows(store: &Store, title: &str, values: Vec<f64>, missing: &str) -> Result<Scale> {
    if !values.iter().any(|&value| value > 0.0) {
        bail!("`{}` says no {missing}", store.directory().display());
    }
    Ok(Scale {
        logarithmic: true,
        histogram: true,
        ..Scale::linear(title, values)
    })
}
