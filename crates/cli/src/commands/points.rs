//! `hemicube points`: view factors of sensors to patches, objects, sky and ground, and no row of a patch.

mod comfort;
mod crs;
mod grid;
mod heat;
mod map;
mod output;
mod sensors;
mod suns;

use crate::args::{EngineSettings, Report as ReportArguments, SceneSettings, Talk};
use crate::enclosure;
use crate::exit::{self, Exit, hinted};
use crate::forecast::{self, Meter};
use crate::help::{SCENE, examples, scene_help};
use crate::outputs::Paths;
use crate::portals::PortalSettings;
use crate::prepare::{Prepared, axis_name, prepare};
use crate::progress::Bar;
use crate::report::{Input, JsonReport, Listing, SCHEMA, count, counted, duration, figures, percent, print, table};
use crate::stored;
use crate::suns::Suns;
use anyhow::{Context, Result, anyhow};
use clap::{Args, ValueEnum};
use heat::Heat;
use hemicube::backend::{Culling, RenderSettings};
use hemicube::diagnose::Place;
use hemicube::driver::room::Work;
use hemicube::frame::Horizon;
use hemicube::points::{
    Body, PointOptions, SHARES_RESOLUTION, Sensor, SensorRow, Surroundings, first_resolution, rows_of_sensors,
};
use hemicube::portal::Portals;
use hemicube::reference::PointReference;
use output::{Groups, Kept, Written};
use sensors::{Sensors, Source};
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use suns::{Brought, Felt, Hours};

/// The integral over a piece at which reference rays cut no more.
const REFERENCE_PIECE: f64 = 1e-7;
/// Standard error of reference rows, in parts of the tolerance, and at least; and what stands for a tolerance where none
/// is asked for. Choices.
const SHARE_OF_TOLERANCE: f64 = 0.1;
const LEAST_TARGET: f64 = 2e-5;
const USUAL_ERROR: f64 = 5e-3;
/// Points in the table on the terminal.
const SHOWN: usize = 20;
/// 0 °C in kelvin.
const KELVIN_OF_ZERO: f64 = 273.15;

const EXAMPLES: &str = "  \
  hemicube points city.obj --points people.txt --as person -o people.csv
  hemicube points city.json --grid 1.0 --height 1.5 --tolerance 1% -o sky.tif -o sky.png
  hemicube points room.obj --grid 0.5 --on \"floor*\" -o floor.csv
  hemicube points street.obj --grid 1 --height 1.5 --periodic y=0..100 --specular glass.toml -o street.csv
  hemicube points room.obj --points seats.csv --as cylinder --solution room.hemicube -o comfort.csv";

/// What sensors see of patches, objects, the sky and the ground: rows of points alone
#[derive(Args, Debug)]
#[command(after_long_help = examples(EXAMPLES, false))]
#[command(group = clap::ArgGroup::new("where").required(true))]
#[command(group = clap::ArgGroup::new("heat").args(["solution", "temperatures"]))]
pub(crate) struct Arguments {
    #[arg(value_name = "SCENE", help = SCENE, long_help = scene_help())]
    pub(crate) scene: PathBuf,
    /// The points: `x y z` or `x y z nx ny nz` a line, or columns of these names
    #[arg(long, value_name = "FILE", group = "where", help_heading = "Points")]
    pub(crate) points: Option<PathBuf>,
    /// Points every STEP, in the scene's unit: with `--height` above the ground, in cells at multiples of STEP; with
    /// `--on` on surfaces
    #[arg(long, value_name = "STEP", value_parser = length, group = "where", help_heading = "Points")]
    pub(crate) grid: Option<f64>,
    /// Height of the grid above the lowest surface that looks up; those in solids are left out
    #[arg(long, value_name = "HEIGHT", value_parser = real, requires = "grid", conflicts_with = "points",
        allow_negative_numbers = true, help_heading = "Points")]
    pub(crate) height: Option<f64>,
    /// Cells of the grid between these coordinates alone, along east and north: x and y where z is up
    #[arg(long = "box", value_name = "X0,Y0,X1,Y1", value_parser = extent, requires = "height",
        conflicts_with = "points", allow_hyphen_values = true, help_heading = "Points")]
    pub(crate) extent: Option<[f64; 4]>,
    /// Cells alone with their middles in the outline, seen from above, of these objects or materials (repeatable)
    #[arg(
        long,
        value_name = "GLOB",
        requires = "height",
        conflicts_with = "points",
        help_heading = "Points"
    )]
    pub(crate) clip: Vec<String>,
    /// Surfaces of the grid, by object or material (repeatable): to stand on, or with `--height` the ground
    #[arg(
        long,
        value_name = "GLOB",
        requires = "grid",
        conflicts_with = "points",
        help_heading = "Points"
    )]
    pub(crate) on: Vec<String>,
    /// The form of a sensor: plane, by its normal; sphere; cube, a row a side; person, standing, by six weighted sides;
    /// seated, likewise, facing along its normal, or anywhere; cylinder, upright [default: plane with normals and,
    /// looking up, for a grid with `--height`; sphere without, and for radiant temperatures of such a grid]
    #[arg(
        long = "as",
        value_name = "plane|sphere|cube|person|seated|cylinder",
        hide_possible_values = true,
        help_heading = "Points"
    )]
    pub(crate) body: Option<BodyName>,
    /// Mean radiant temperature by the radiosities of a solution of `solve --thermal`: a matrix of the scene, and the
    /// solution's name [default: thermal]. With `--suns` also reflected light by one of `solve --suns`, `DIR:radiosity`
    /// (repeatable)
    #[arg(
        long,
        value_name = "DIR[:NAME]",
        conflicts_with_all = ["split", "patch_size", "two_sided", "flip", "exclude", "scale", "keep_duplicates",
            "specular", "symmetry", "sector", "periodic"],
        help_heading = "Heat"
    )]
    pub(crate) solution: Vec<PathBuf>,
    /// Light of sun and sky at the moments of this table, as of `hemicube suns`; with radiosities of heat also the mean
    /// radiant temperature with it, and where the table knows the air, UTCI
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with_all = ["temperatures", "verify", "show", "symmetry", "sector", "periodic"],
        help_heading = "Heat"
    )]
    pub(crate) suns: Option<PathBuf>,
    /// Mean radiant temperature by black surfaces at the temperatures of a table: a line `name,20 °C` or `name,293` for
    /// each object or material, `*` for all others
    #[arg(long, value_name = "FILE", help_heading = "Heat")]
    pub(crate) temperatures: Option<PathBuf>,
    /// Temperature of the sky, in kelvin, or as `20 °C` [default: what lay outside for the solution]
    #[arg(
        long,
        value_name = "KELVIN",
        value_parser = kelvin,
        requires = "heat",
        allow_hyphen_values = true,
        help_heading = "Heat"
    )]
    pub(crate) sky_temperature: Option<f64>,
    /// Temperature of what is below the horizon, in kelvin, or as `20 °C` [default: the ground of the solution, or what
    /// lay outside for it; with `--temperatures` the sky's]
    #[arg(
        long,
        value_name = "KELVIN",
        value_parser = kelvin,
        requires = "heat",
        allow_hyphen_values = true,
        help_heading = "Heat"
    )]
    pub(crate) ground_temperature: Option<f64>,
    /// Refine each row until it changes by no more than this share: 1%, 0.001. Exit 1 where rows do not settle; the last
    /// change bounds no error, and `--verify` measures it
    #[arg(long, value_name = "T", value_parser = crate::args::change)]
    pub(crate) tolerance: Option<f64>,
    /// Pixels along an edge of the first hemicubes: a multiple of 16 up to 1024 [default: 256; 128 for a
    /// tolerance from 0.5%; 64 for `--by none`]
    #[arg(long, value_name = "N", value_parser = crate::args::pixels)]
    pub(crate) resolution: Option<u32>,
    /// Compare so many points with rows by rays
    #[arg(long, value_name = "POINTS", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) verify: Option<u32>,
    /// Write the rows to FILE: .csv, .json, .npz, for EnergyPlus' people .idf; of a grid as a map .tif, .nc, .asc, as a
    /// picture .png, .svg (repeatable)
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Vec<PathBuf>,
    /// Replace what is there
    #[arg(long, requires = "output")]
    pub(crate) overwrite: bool,
    /// Columns of .csv and .json; none: sky, ground and backs alone, by 64 pixels an edge, several times as fast
    #[arg(
        long,
        value_name = "object|material|patch|none",
        default_value = "object",
        hide_possible_values = true
    )]
    pub(crate) by: By,
    /// Coordinate reference system of a map, such as EPSG:28992 [default: the one that the scene names]
    #[arg(long, value_name = "EPSG:N", value_parser = crs::Crs::named, requires = "output")]
    pub(crate) crs: Option<crs::Crs>,
    /// What a map or a picture shows: sky, ground, blocked, mrt, or an object or material [default: mrt where there is one,
    /// else sky]
    #[arg(long, value_name = "COLUMN")]
    pub(crate) show: Option<String>,
    #[command(flatten)]
    pub(crate) portals: PortalSettings,
    #[command(flatten)]
    pub(crate) patches: SceneSettings,
    #[command(flatten)]
    pub(crate) engine: EngineSettings,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}

impl Arguments {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        let stores: Vec<PathBuf> = self.solution.iter().map(|given| heat::parts_of(given).0).collect();
        Paths::default()
            .reads([&self.scene])
            .reads(&self.points)
            .reads(&self.temperatures)
            .reads(&self.portals.file())
            .reads(&self.suns)
            .store(&stores)
            .writes("-o", &self.output, self.overwrite)
    }
}

/// The forms, by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum BodyName {
    /// By its normal.
    Plane,
    /// From all round.
    Sphere,
    /// Six sides.
    Cube,
    /// Six weighted sides.
    Person,
    /// Likewise, seated.
    Seated,
    /// Upright.
    Cylinder,
}

/// Columns of tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum By {
    /// Objects.
    Object,
    /// Materials.
    Material,
    /// Patches.
    Patch,
    /// What is no patch.
    None,
}

fn real(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err("a number is needed".to_owned()),
    }
}

fn length(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(length) if length > 0.0 && length.is_finite() => Ok(length),
        _ => Err("a length above 0 is needed, in the scene's unit".to_owned()),
    }
}

fn extent(text: &str) -> Result<[f64; 4], String> {
    let numbers: Result<Vec<f64>, String> = text.split(',').map(|number| real(number.trim())).collect();
    match numbers.ok().and_then(|numbers| <[f64; 4]>::try_from(numbers).ok()) {
        Some(corners @ [x0, y0, x1, y1]) if x0 < x1 && y0 < y1 => Ok(corners),
        _ => Err("four numbers are needed, X0,Y0,X1,Y1, with X0 below X1 and Y0 below Y1".to_owned()),
    }
}

fn kelvin(text: &str) -> Result<f64, String> {
    text.parse::<hemicube::solve::Temperature>()
        .map(hemicube::solve::Temperature::kelvin)
        .map_err(|_| "a temperature in kelvin, from 0 on, is needed, or one such as `20 °C`".to_owned())
}

/// A comparison with rays.
#[derive(Clone, Copy, Debug, Serialize)]
struct Verified {
    points: u64,
    /// ‖F − F_rays‖ / ‖F_rays‖ over the points; of sky and ground where there are no patches.
    error: f64,
    /// The part of it that the rays explain.
    noise: f64,
    /// The greatest difference of sky, ground or blocked share.
    share: f64,
    rays: u64,
    /// Rows that the bound of their rays ended; what it left is in `noise`.
    met_bound: u64,
}

/// The report.
#[derive(Serialize)]
struct Report {
    schema: u32,
    version: &'static str,
    inputs: Vec<Input>,
    outputs: Vec<String>,
    body: BodyName,
    up: &'static str,
    points: u64,
    rows: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    left_out: Option<u64>,
    not_in_the_open: u64,
    tolerance: Option<f64>,
    resolution: u32,
    hemicubes: u64,
    unsettled: u64,
    sky: f64,
    ground: f64,
    blocked: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    cut_off: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mean_radiant_temperature: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    verified: Option<Verified>,
    #[serde(skip_serializing_if = "Option::is_none")]
    seconds: Option<f64>,
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    arguments.patches.require_one_cut()?;
    output::require(arguments)?;
    let json = JsonReport::asked(&arguments.report);
    let listed = arguments.points.as_deref().map(sensors::read).transpose()?;
    let mut table = arguments.suns.as_deref().map(Suns::read).transpose()?;
    let solutions = heat::open_all(&arguments.solution, table.is_some())?;
    let store = solutions.first();
    let cancel = exit::watch_interrupts().context("Ctrl-C cannot be watched")?;
    let mut prepared = match store {
        Some((store, _)) => stored::scene(store, &arguments.scene, &arguments.engine, (&arguments.patches).into()),
        None => prepare(&arguments.scene, &arguments.patches, &arguments.engine, Work::Pixels),
    }?;
    enclosure::note_doubles(&mut prepared, arguments.engine.thread_count());
    enclosure::warn_of_winding(&prepared, arguments.engine.thread_count(), talk);
    let hierarchy = arguments.engine.hierarchy();
    let portals = match store {
        Some((store, _)) => stored::portals(store, &mut prepared, hierarchy)?,
        None => arguments
            .portals
            .of_one_band(&mut prepared, hierarchy, arguments.tolerance)?,
    };
    prepared.tell(talk);
    let up = prepared.up(arguments.patches.up)?;
    prepared.tell_up(arguments.patches.up, talk);
    let horizon = Horizon::new(up, 0.0);
    if let Some(table) = &mut table {
        // Sun and reflected light go by one north.
        let lit = solutions
            .iter()
            .map(|(store, _)| store)
            .find(|store| stored::sky(store).is_ok());
        let of_sky = lit.map(|store| stored::horizon(store, &prepared)).transpose()?;
        if let Some(warning) = table.turn(|| Ok(of_sky.unwrap_or(horizon)))? {
            talk.warn(&warning);
        }
    }
    let started = Instant::now();
    let source = match listed {
        Some(listed) => Source::Listed(listed),
        None => Source::Grid(grid::grid(arguments, &prepared, &horizon)?),
    };
    let sensors = Sensors::new(arguments, source, &prepared, &horizon)?;
    sensors.require_within(&portals)?;
    sensors.tell(arguments, talk);
    output::require_columns(arguments, &portals)?;
    output::require_map(arguments, &prepared, &sensors, talk)?;
    let hours = match table {
        Some(table) => {
            Hours::require_one_cell(&portals)?;
            crate::portals::tell_of_reflections(&portals, &prepared, talk);
            Some(Hours::new(
                arguments,
                table,
                &solutions,
                &prepared,
                (&sensors, &portals),
            )?)
        }
        None => None,
    };
    let heat = match (store, &arguments.temperatures) {
        _ if hours.is_some() => None,
        (Some((store, solution)), _) => Some(Heat::alone(arguments, store, solution, &prepared)?),
        (None, Some(path)) => Some(Heat::of_table(arguments, path, &prepared, talk)?),
        (None, None) => None,
    };
    for path in &arguments.output {
        forecast::require_disk(path, output::bytes_at_least(path, sensors.items.len()))?;
    }
    let groups = Groups::new(arguments.by, &prepared);
    output::require_column(arguments, &groups, heat.is_some())?;
    let task = Task {
        arguments,
        prepared: &prepared,
        horizon,
        portals: Arc::new(portals),
        sensors: &sensors,
        groups: &groups,
        heat: heat.as_ref(),
        hours: hours.as_ref(),
        is_verbose: talk.verbose,
    };
    let guard = exit::InterruptGuard::new();
    let Some(mut rows) = task.rows(cancel, talk)? else {
        return Ok(Exit::Interrupted);
    };
    let felt = task.felt(&mut rows)?;
    if let Some(heat) = &heat {
        heat.require_outside(rows.iter().map(|row| &row.row))?;
    }
    if let Some(heat) = &heat {
        let greatest = |of: fn(&Kept) -> f64| {
            let all = rows.iter().map(of);
            all.fold(
                0.0,
                |most: f64, value| if value.abs() > most.abs() { value } else { most },
            )
        };
        let (change, seen) = (greatest(|row| row.change_by_ground), greatest(|row| row.row.ground));
        if let Some(question) = heat.question_of_ground(change, seen) {
            talk.warn(&question);
        }
    }
    let Some(verified) = task.verify(&rows, cancel)? else {
        return Ok(Exit::Interrupted);
    };
    let written = Written {
        arguments,
        prepared: &prepared,
        sensors: &sensors,
        groups: &groups,
        rows: &rows,
        has_portals: !task.portals.is_empty(),
        hours: hours.as_ref().zip(felt.as_deref()),
    };
    for path in &arguments.output {
        written.write(path)?;
    }
    drop(guard);
    let seconds = started.elapsed().as_secs_f64();
    if !arguments.report.json {
        let of_hours = written.hours.map(|(hours, felt)| hours.text(felt)).unwrap_or_default();
        print(&(of_hours + &task.results(&rows, verified)))?;
    }
    talk.detail(task.work(&rows, seconds).trim_end());
    for output in &arguments.output {
        talk.say(&format!("written: `{}`", output.display()));
    }
    if let Some((hours, felt)) = written.hours {
        hours.tell(felt, talk);
    }
    let unsettled = rows.iter().filter(|row| !row.row.is_settled).count() as u64;
    if let (true, Some(tolerance)) = (unsettled > 0, arguments.tolerance) {
        talk.warn(&crate::report::unsettled(unsettled, tolerance));
    }
    let is_held = task.is_held(&rows, verified);
    if let Some(json) = json {
        json.write(&task.report(axis_name(up), &rows, verified, seconds))?;
    }
    Ok(if is_held { Exit::Done } else { Exit::NotHeld })
}

/// A run.
struct Task<'a> {
    arguments: &'a Arguments,
    prepared: &'a Prepared,
    horizon: Horizon,
    portals: Arc<Portals>,
    sensors: &'a Sensors,
    groups: &'a Groups,
    heat: Option<&'a Heat>,
    hours: Option<&'a Hours>,
    is_verbose: bool,
}

impl Task<'_> {
    fn options(&self) -> PointOptions {
        PointOptions {
            render: RenderSettings {
                resolution: self.arguments.resolution.unwrap_or(match self.arguments.by {
                    By::None => SHARES_RESOLUTION,
                    _ => first_resolution(self.arguments.tolerance),
                }),
                culling: Culling::On,
                covered: false,
            },
            tolerance: self.arguments.tolerance,
            threads: self.arguments.engine.thread_count(),
            patches: self.arguments.by != By::None,
        }
    }

    /// The rows; `None` where interrupted.
    fn rows(&self, cancel: &AtomicBool, talk: Talk) -> Result<Option<Vec<Kept>>> {
        let options = self.options();
        let mut sessions = Vec::new();
        for level in 0..options.resolutions().len() {
            let talk = if level == 0 { talk } else { Talk::SILENT };
            let backend = self.arguments.engine.open_backend(talk)?;
            if !backend.info().capabilities.items {
                return Err(hinted(
                    anyhow!(
                        "backend `{}` hands out no item buffers, from which points are computed",
                        backend.info().name
                    ),
                    "`--backend cpu` does",
                ));
            }
            sessions.push(backend);
        }
        let bar = Bar::counting(talk, self.sensors.items.len() as u64, "points");
        let keeps_patches = output::keeps_patches(self.arguments);
        let verified = self.verified_places();
        let meter = Meter::new(self.prepared.budget);
        let keep = |sensor: usize, row: SensorRow| {
            let keeps = keeps_patches || verified.binary_search(&sensor).is_ok();
            let brought = self.hours.map(|hours| hours.of_row(&row)).unwrap_or_default();
            let mut kept = Kept::new(sensor, row, self.groups, self.heat, keeps);
            kept.brought = brought;
            meter.take(kept.bytes(), "keeping more rows");
            kept
        };
        let surroundings = Surroundings {
            horizon: self.horizon,
            portals: Some(&self.portals),
        };
        let found = rows_of_sensors(
            &self.prepared.model,
            &self.sensors.items,
            surroundings,
            options,
            sessions,
            &keep,
            &mut |done| {
                bar.at(done as u64);
                meter.fits() && !cancel.load(Ordering::SeqCst)
            },
        )?;
        meter.require("fewer points at a time take less, and `--by object` less than patches")?;
        Ok(found)
    }

    /// Light and temperatures of all rows at all moments; `None` without a table of suns. Rows then have their means.
    fn felt(&self, rows: &mut [Kept]) -> Result<Option<Vec<Felt>>> {
        let Some(hours) = self.hours else { return Ok(None) };
        let brought: Vec<(f64, &[Brought])> = rows.iter().map(|row| (row.row.sky, &*row.brought)).collect();
        let threads = self.arguments.engine.thread_count();
        let felt = hours.felt(self.prepared, (self.sensors, &self.portals), &brought, threads)?;
        if let Some(means) = hours.radiant_means(&felt) {
            for (row, mean) in rows.iter_mut().zip(means) {
                row.temperature = mean;
            }
        }
        Ok(Some(felt))
    }

    /// Sensors that are compared with rays, evenly over all.
    fn verified_places(&self) -> Vec<usize> {
        let (all, wanted) = (self.sensors.items.len(), self.arguments.verify.unwrap_or(0) as usize);
        let wanted = wanted.min(all);
        (0..wanted).map(|k| k * all / wanted).collect()
    }

    /// Standard error of reference rows: small beside what they judge.
    fn reference_target(&self) -> f64 {
        let asked = self.arguments.tolerance.unwrap_or(USUAL_ERROR);
        (SHARE_OF_TOLERANCE * asked).max(LEAST_TARGET)
    }

    /// Compares with rays; the outer `None` where interrupted.
    fn verify(&self, rows: &[Kept], cancel: &AtomicBool) -> Result<Option<Option<Verified>>> {
        let places = self.verified_places();
        if places.is_empty() {
            return Ok(Some(None));
        }
        let sensors: Vec<Sensor> = places.iter().map(|&place| self.sensors.items[place]).collect();
        let reference = PointReference::new(&self.prepared.model, self.horizon, REFERENCE_PIECE)?;
        let reference = reference
            .with_portals(&self.portals)
            .with_target(self.reference_target());
        let threads = self.arguments.engine.thread_count();
        let found = reference.rows(&sensors, threads, &mut |_| !cancel.load(Ordering::SeqCst))?;
        let Some(found) = found else { return Ok(None) };
        let ours = rows.iter().filter(|row| places.binary_search(&row.sensor).is_ok());
        let (mut squared, mut norm, mut noise, mut share) = (0.0, 0.0, 0.0, 0.0f64);
        for (ours, theirs) in ours.zip(&found) {
            if self.arguments.by == By::None {
                for (a, b) in [(ours.row.sky, theirs.row.sky), (ours.row.ground, theirs.row.ground)] {
                    squared += (a - b).powi(2);
                    norm += b * b;
                }
            } else {
                squared += output::squared_difference(&ours.row, &theirs.row);
                norm += theirs.row.squared_norm();
            }
            noise += theirs.error * theirs.error;
            for (a, b) in [
                (ours.row.sky, theirs.row.sky),
                (ours.row.ground, theirs.row.ground),
                (ours.row.blocked, theirs.row.blocked),
            ] {
                share = share.max((a - b).abs());
            }
        }
        let of_norm = |squared: f64| if norm > 0.0 { (squared / norm).sqrt() } else { 0.0 };
        Ok(Some(Some(Verified {
            points: sensors.len() as u64,
            error: of_norm(squared),
            noise: of_norm(noise),
            share,
            rays: found.iter().map(|row| row.rays).sum(),
            met_bound: found.iter().filter(|row| row.met_bound).count() as u64,
        })))
    }

    /// Returns whether the tolerance holds, by refinement and, where they were asked for, by rays.
    fn is_held(&self, rows: &[Kept], verified: Option<Verified>) -> bool {
        let Some(tolerance) = self.arguments.tolerance else {
            return true;
        };
        let by_rays = verified.is_none_or(|verified| {
            verified.error <= tolerance + verified.noise && verified.share <= tolerance + verified.noise
        });
        by_rays && rows.iter().all(|row| row.row.is_settled)
    }

    fn mean(&self, rows: &[Kept], of: impl Fn(&Kept) -> f64) -> f64 {
        rows.iter().map(of).sum::<f64>() / rows.len().max(1) as f64
    }

    fn report(&self, up: &'static str, rows: &[Kept], verified: Option<Verified>, seconds: f64) -> Report {
        Report {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION"),
            inputs: vec![self.prepared.input.clone()],
            outputs: self
                .arguments
                .output
                .iter()
                .map(|path| path.display().to_string())
                .collect(),
            body: self.sensors.body,
            up,
            points: self.sensors.items.len() as u64,
            rows: rows.len() as u64,
            left_out: self.sensors.raster.as_ref().map(|raster| raster.left_out),
            not_in_the_open: self
                .sensors
                .places
                .iter()
                .filter(|&&place| place != Place::Open)
                .count() as u64,
            tolerance: self.arguments.tolerance,
            resolution: self.options().render.resolution,
            hemicubes: self.hemicubes(rows),
            unsettled: rows.iter().filter(|row| !row.row.is_settled).count() as u64,
            sky: self.mean(rows, |row| row.row.sky),
            ground: self.mean(rows, |row| row.row.ground),
            blocked: self.mean(rows, |row| row.row.blocked),
            cut_off: (!self.portals.is_empty()).then(|| self.mean(rows, |row| row.row.cut_off)),
            mean_radiant_temperature: self.heat.map(|_| self.mean(rows, |row| row.temperature)),
            verified,
            seconds: self.is_verbose.then_some(seconds),
        }
    }

    fn hemicubes(&self, rows: &[Kept]) -> u64 {
        let of_rows: u64 = rows.iter().map(|row| u64::from(row.row.hemicubes)).sum();
        of_rows / if self.sensors.body == BodyName::Cube { 6 } else { 1 }
    }

    /// Means over all points, the error where it was measured, and the first points.
    fn results(&self, rows: &[Kept], verified: Option<Verified>) -> String {
        let mut list = Listing::default();
        let form = self.sensors.form();
        let points = self.sensors.items.len() as u64;
        let left_out = match &self.sensors.raster {
            Some(raster) => format!(
                ", {} × {} cells, {} left out: without a surface, or in solids",
                count(raster.columns as u64),
                count(raster.rows as u64),
                count(raster.left_out)
            ),
            None => String::new(),
        };
        list.add("points", format!("{}{left_out}", count(points)));
        if self.heat.is_some() {
            let of = |fold: fn(f64, f64) -> f64, start: f64| rows.iter().map(|row| row.temperature).fold(start, fold);
            let mean = self.mean(rows, |row| row.temperature);
            list.add(
                &format!("mean radiant temperature ({form})"),
                format!(
                    "{mean:.2} K ({:.2} °C) on average, from {:.2} to {:.2} K",
                    mean - KELVIN_OF_ZERO,
                    of(f64::min, f64::INFINITY),
                    of(f64::max, f64::NEG_INFINITY)
                ),
            );
        }
        let range = |of: fn(&Kept) -> f64| {
            let ends = rows
                .iter()
                .map(of)
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
                    (low.min(value), high.max(value))
                });
            format!(
                "{:.4} on average, from {:.4} to {:.4}",
                self.mean(rows, of),
                ends.0,
                ends.1
            )
        };
        list.add(&format!("sky view factor ({form})"), range(|row| row.row.sky));
        list.add("ground below the horizon", range(|row| row.row.ground));
        list.add("backs of surfaces", range(|row| row.row.blocked));
        if !self.portals.is_empty() {
            let most = rows.iter().map(|row| row.row.cut_off).fold(0.0, f64::max);
            list.add(
                "cut off",
                format!(
                    "{} behind the last mirror or pane followed, {} of a row at most",
                    percent(self.mean(rows, |row| row.row.cut_off)),
                    percent(most)
                ),
            );
        }
        match verified {
            Some(verified) => {
                let short = match verified.met_bound {
                    0 => String::new(),
                    rows => format!("; {} hit the limit of rays: less certain", counted(rows, "row")),
                };
                list.add(
                    "error",
                    format!(
                        "{} against rays at {} (noise of the rays: {}); shares within {}{short}",
                        percent(verified.error),
                        counted(verified.points, "point"),
                        percent(verified.noise),
                        figures(verified.share)
                    ),
                );
            }
            None if self.hours.is_some() => {
                list.add(
                    "error",
                    "not measured; `--verify 20` without `--suns` compares 20 points with rays",
                );
            }
            None => list.add("error", "not measured; `--verify 20` compares 20 points with rays"),
        }
        let mut text = list.text();
        text.push('\n');
        text.push_str(&self.table(rows));
        if rows.len() > SHOWN {
            text.push_str(&format!(
                "{} more are not shown{}\n",
                count((rows.len() - SHOWN) as u64),
                if self.arguments.output.is_empty() {
                    "; `-o FILE.csv` has all"
                } else {
                    ""
                }
            ));
        }
        text
    }

    /// The first rows.
    fn table(&self, rows: &[Kept]) -> String {
        let shown = rows.iter().take(SHOWN).map(|row| {
            let most = row.groups.iter().max_by(|a, b| a.1.total_cmp(&b.1));
            [
                row.sensor.to_string(),
                if row.temperature.is_nan() {
                    "–".to_owned()
                } else {
                    format!("{:.2}", row.temperature)
                },
                format!("{:.4}", row.row.sky),
                format!("{:.4}", row.row.ground),
                most.map_or_else(String::new, |(group, factor)| {
                    format!("`{}` {factor:.4}", self.groups.name(*group))
                }),
                self.place(row).to_owned(),
            ]
        });
        table(["point", "radiant, K", "sky", "ground", "most seen", ""], shown)
    }

    /// The work, for `-v`.
    fn work(&self, rows: &[Kept], seconds: f64) -> String {
        let (points, hemicubes) = (self.sensors.items.len() as u64, self.hemicubes(rows));
        let mut list = Listing::default();
        list.add(
            "hemicubes",
            format!(
                "{}, {:.1} a point, in {}",
                count(hemicubes),
                hemicubes as f64 / points.max(1) as f64,
                duration(seconds)
            ),
        );
        list.text()
    }

    /// Where a point is, unless it is in the open.
    fn place(&self, row: &Kept) -> &'static str {
        match self.sensors.places.get(row.sensor) {
            Some(Place::InSolid) => "in a solid",
            Some(Place::BelowGround) => "below the ground",
            Some(Place::BehindSheet) => "behind a surface",
            Some(Place::FarOff) => "far off the scene",
            _ => "",
        }
    }
}

impl BodyName {
    /// The form of a sensor with this normal.
    fn with(self, normal: glam::DVec3, facing: Option<glam::DVec3>) -> Body {
        match self {
            Self::Seated => Body::Seated(facing),
            Self::Plane => Body::Plane(normal),
            Self::Sphere => Body::Sphere,
            Self::Cube => Body::Cube,
            Self::Person => Body::Person,
            Self::Cylinder => Body::Cylinder,
        }
    }
}
