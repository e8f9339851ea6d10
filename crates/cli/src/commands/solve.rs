//! `hemicube solve`: radiosity or thermal exchange from a matrix.

mod heat;
mod light;
mod moments;
mod suns;
mod surfaces;

use crate::args::{By, EngineSettings, Report as ReportArguments, StoredMatrix, Talk};
use crate::enclosure;
use crate::exit::{self, Exit, hinted};
use crate::forecast;
use crate::help::examples;
use crate::materials;
use crate::outputs::Paths;
use crate::prepare::Prepared;
use crate::progress::Bar;
use crate::report::{
    self, JsonReport, Listing, PendingFile, SCHEMA, count, counted, duration, figures, percent, size, small_percent,
};
use crate::stored::{self, Limits};
use crate::suns::Suns;
use crate::table::field;
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use hemicube::analysis::surfaces::ERROR_MOST;
use hemicube::sky::sky_product;
use hemicube::solve::{
    ArrayFile, Block, EnergyBalance, Factors, HeatSolution, Method, Optics, OutOfCore, Pairs, Problem, Reading, SUMS,
    Solution, SolutionWriter, SolveError, SolveOptions, Step, StoredSolution, Temperature, energy_balance,
    require_shares, solve,
};
use hemicube::store::{PatchTable, RowTable, Store};
use hemicube_scene::Budget;
use hemicube_spatial::whole;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use suns::Lit;

/// Most right-hand sides in a table: more columns nobody opens.
const CSV_COLUMNS_MAX: u64 = 256;
/// Right-hand sides with a printed balance.
const BALANCES_SHOWN: usize = 6;
/// Least returned share of the input to be printed.
const RETURNED_SHOWN: f64 = 1e-4;
/// Iterations of GMRES until it begins anew.
const RESTART: u32 = 20;
/// Vectors in memory a right-hand side, besides GMRES's.
const VECTORS: u64 = 9;
/// Options of what is solved, which `--print-materials` does not do.
const OF_SOLVING: [&str; 18] = [
    "threads",
    "overwrite",
    "thermal",
    "load",
    "schedule",
    "suns",
    "emission",
    "sky_radiance",
    "sky",
    "residual",
    "max_iterations",
    "as_stored",
    "memory",
    "solution",
    "output",
    "by",
    "network",
    "json",
];
const EXAMPLES: &str = "  \
  hemicube solve room.hemicube
  hemicube solve city.hemicube --materials city.toml -o city.npz -o city.csv
  hemicube solve room.hemicube --print-materials > room.toml
  hemicube solve oven.hemicube --thermal --materials oven.toml --sky-temperature '20 °C'
  hemicube solve room.hemicube --thermal --materials room.toml --by object -o room.csv
  hemicube solve room.hemicube --thermal --materials room.toml --load heating.csv --by object -o hours.csv
  hemicube solve yard.hemicube --thermal --materials yard.toml --suns day.csv --sky-temperature '5 °C'";

/// Solve for light or heat: radiosity of every patch from a matrix and its materials
#[derive(Args, Debug)]
#[command(after_long_help = examples(EXAMPLES, false))]
#[command(mut_arg("overwrite", |overwrite| overwrite.requires("output")))]
pub(crate) struct Arguments {
    #[command(flatten)]
    pub(crate) matrix: StoredMatrix,
    /// Take reflectance and emission from this scene: glTF, MTL or AC3D; with `--suns` and `--materials` its geometry
    /// alone [default without `--materials`: the matrix's own scene, where it is found]
    #[arg(long, value_name = "SCENE", help_heading = "Materials")]
    pub(crate) scene: Option<PathBuf>,
    /// Lift the safety limits on the size of a scene (docs/security.md)
    #[arg(long, hide_short_help = true)]
    pub(crate) allow_large: bool,
    /// Properties of objects and materials by name (TOML): reflectance, emission, emissivity, temperature, flux, heat;
    /// they go before the scene's
    #[arg(long, value_name = "FILE", help_heading = "Materials")]
    pub(crate) materials: Option<PathBuf>,
    /// Print a file for `--materials` with all objects, materials and the values that hold, and solve nothing
    #[arg(long, conflicts_with_all = OF_SOLVING, help_heading = "Materials")]
    pub(crate) print_materials: bool,
    /// Exchange heat instead of light: emissivity and temperature to net flux
    #[arg(long, help_heading = "Materials")]
    pub(crate) thermal: bool,
    /// Temperature of what lies outside, for heat that leaves the scene: kelvin, or as `20 °C` [default: 0, cold space]
    #[arg(
        long,
        value_name = "KELVIN",
        value_parser = kelvin,
        requires = "thermal",
        allow_hyphen_values = true,
        help_heading = "Materials"
    )]
    pub(crate) sky_temperature: Option<Temperature>,
    /// Temperature of the ground, for heat that leaves below the horizon; needs `hemicube sky SCENE --matrix DIR`
    #[arg(
        long,
        value_name = "KELVIN",
        value_parser = kelvin,
        requires = "thermal",
        allow_hyphen_values = true,
        help_heading = "Materials"
    )]
    pub(crate) ground_temperature: Option<Temperature>,
    /// Heat that surfaces take up from elsewhere, as of the sun, W/m²: a line a surface and a column a moment (.csv), or
    /// a row a moment and a number a patch (.npy)
    #[arg(long, value_name = "FILE", requires = "thermal", help_heading = "Materials")]
    pub(crate) load: Option<PathBuf>,
    /// Sun and sky, with all reflections: a table of `hemicube suns`, or one with `x y z` towards the sun, `direct` W/m²
    /// across its beam and `diffuse` W/m² of the sky on a level plane; `--thermal` absorbs it by `absorptance`
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with_all = ["emission", "sky_radiance"],
        help_heading = "Materials"
    )]
    pub(crate) suns: Option<PathBuf>,
    /// Temperatures over moments, in place of those of the materials: kelvin, or `20 °C`, in a table as of `--load`; its
    /// surface `(surroundings)` is what lies outside
    #[arg(long, value_name = "FILE", requires = "thermal", help_heading = "Materials")]
    pub(crate) schedule: Option<PathBuf>,
    /// Emission of each patch: one row a right-hand side (.npy), row r of band r modulo the number of bands
    #[arg(
        long,
        value_name = "FILE.npy",
        conflicts_with = "thermal",
        help_heading = "Materials"
    )]
    pub(crate) emission: Option<PathBuf>,
    /// Relative residual at which the solver ends
    #[arg(long, value_name = "X", default_value = "1e-6", value_parser = residual, hide_short_help = true)]
    pub(crate) residual: f64,
    /// Products with the matrix before it gives up, with exit 1
    #[arg(
        long,
        value_name = "N",
        default_value = "500",
        value_parser = clap::value_parser!(u32).range(1..),
        hide_short_help = true
    )]
    pub(crate) max_iterations: u32,
    /// Take each row as it is stored, instead of one A_i F_ij of both rows for both directions of a pair
    #[arg(long, hide_short_help = true)]
    pub(crate) as_stored: bool,
    /// About how much memory to use; what of the matrix does not fit is read again each iteration
    #[arg(long, value_name = "SIZE", default_value = "1GB", value_parser = bytes, hide_short_help = true)]
    pub(crate) memory: u64,
    /// What the solution is called in the matrix's directory [default: radiosity, or thermal]
    #[arg(long, value_name = "NAME")]
    pub(crate) solution: Option<String>,
    /// Write the solution to FILE (repeatable): .npz or .csv by patch; .json, .parquet or with `--by` .csv by surface
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Vec<PathBuf>,
    /// What a surface is, in the table and in files by surface [default: object]
    #[arg(long, value_name = "object|material|face", hide_possible_values = true)]
    pub(crate) by: Option<By>,
    /// Solve for the surfaces of `--by` instead of patches, as textbooks do: each has one radiosity and one temperature
    #[arg(long, requires = "thermal")]
    pub(crate) network: bool,
    /// Radiance of the sky: one row a right-hand side, a number for the ground and one for each patch of it (.npy)
    #[arg(
        long,
        value_name = "FILE.npy",
        conflicts_with = "thermal",
        help_heading = "Materials"
    )]
    pub(crate) sky_radiance: Option<PathBuf>,
    /// The division of the sky that it is of [default: DIR/sky/sky.npz, from `hemicube sky --matrix`]
    #[arg(long, value_name = "FILE.npz", help_heading = "Materials", hide_short_help = true)]
    pub(crate) sky: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}

impl Arguments {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default()
            .store([&self.matrix.store])
            .reads(&self.scene)
            .reads(&self.materials)
            .reads(&self.emission)
            .reads(&self.load)
            .reads(&self.schedule)
            .reads(&self.suns)
            .reads(&self.sky_radiance)
            .reads(&self.sky)
            .writes("-o", &self.output, self.matrix.overwrite)
    }
}

fn kelvin(text: &str) -> Result<Temperature, String> {
    text.parse()
        .map_err(|_: String| "a temperature in kelvin, from 0 on, is needed, or one such as `20 °C`".to_owned())
}

fn residual(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(residual) if (1e-14..1.0).contains(&residual) => Ok(residual),
        _ => Err("a number from 1e-14 up to 1 is needed".to_owned()),
    }
}

/// `500MB`, `2GB`, or bytes.
pub(crate) fn bytes(text: &str) -> Result<u64, String> {
    let size = crate::args::size(text).filter(|size| *size >= 0.0 && size.is_finite());
    let needed = || "a size such as `500MB` or `2GB` is needed".to_owned();
    size.map(whole::to_u64).ok_or_else(needed)
}

/// Materials of the solution, in its report and in `--json`.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
enum Surfaces {
    Light(Vec<Optics>),
    Heat {
        materials: Vec<heat::Recorded>,
        ambient: f64,
        /// Of each moment, where tables give it.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        ambients: Vec<f64>,
        #[serde(skip_serializing_if = "Option::is_none")]
        ground: Option<f64>,
    },
}

/// Record beside the solution. No clock and no machine.
#[derive(Debug, Serialize)]
struct Record {
    program: &'static str,
    quantity: &'static str,
    bands: Vec<String>,
    /// The band of each right-hand side.
    band_of_row: Vec<usize>,
    /// Names of the moments of heat, a right-hand side each; none where there are no tables over moments.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    moments: Vec<String>,
    surfaces: Surfaces,
    method: Method,
    tolerance: f64,
    /// What of the matrix stood for a pair.
    reading: Reading,
    converged: bool,
    iterations: u32,
    residuals: Vec<f64>,
    balance: Vec<EnergyBalance>,
    /// Sunlight of each moment.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    sunlight: Vec<Sunlight>,
    /// The part of its heat that is not known of the enclosure, or the body in one, of which least is.
    #[serde(skip_serializing_if = "Option::is_none")]
    energy_error: Option<f64>,
    /// What is to be told of it.
    #[serde(skip)]
    warnings: Vec<String>,
    /// The surfaces with most of what a solution that did not converge leaves.
    #[serde(skip)]
    unsettled: Option<String>,
    /// Heat by surface, a moment each; in files of results where there are several.
    #[serde(flatten, skip_serializing_if = "surfaces::Moments::is_no_single")]
    by_surface: surfaces::Moments,
}

/// What arrives from the sun and the sky on all patches, and what they absorb of it after all reflections, in W.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Sunlight {
    arriving: f64,
    absorbed: f64,
}

impl Record {
    /// The moment with most light put in, the first of equals; the first without moments.
    fn brightest(&self) -> usize {
        let bands = self.bands.len().max(1);
        let input = |moment: usize| {
            let of_moment = self.balance.iter().skip(moment * bands).take(bands);
            of_moment.map(EnergyBalance::input).sum::<f64>()
        };
        let mut found = 0;
        for moment in 1..self.moments.len() {
            if input(moment) > input(found) {
                found = moment;
            }
        }
        found
    }

    /// Counts a solution.
    fn count(&mut self, solution: &Solution) {
        self.converged &= solution.converged;
        self.iterations = self.iterations.max(solution.iterations);
        self.residuals.extend(&solution.residuals);
    }
}

#[derive(Serialize)]
struct Report<'a> {
    schema: u32,
    version: &'static str,
    store: String,
    patches: u64,
    entries: u64,
    solution: String,
    #[serde(flatten)]
    record: &'a Record,
    #[serde(skip_serializing_if = "Option::is_none")]
    seconds: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    peak_memory_bytes: Option<u64>,
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let json = JsonReport::asked(&arguments.report);
    for output in &arguments.output {
        if !arguments.is_by_surface(output) {
            OutputFormat::of(output)?;
        }
    }
    arguments.require_quantities()?;
    report::require_matrix(&arguments.matrix.store)?;
    let store = Store::open(&arguments.matrix.store)?;
    if arguments.print_materials {
        return print_materials(arguments, &store, talk);
    }
    let mut suns = arguments.suns.as_deref().map(Suns::read).transpose()?;
    let mut prepared = prepare_scene(arguments, &store, talk)?;
    let cancel = exit::watch_interrupts().context("Ctrl-C cannot be watched")?;
    let started = Instant::now();
    let table = store.patches()?;
    let stored = OutOfCore::new(&store, arguments.memory / 2)?;
    let mut rows = store.exchange_table()?;
    let threads = arguments.options().threads();
    let pairs = match arguments.reading() {
        Reading::AsStored => None,
        Reading::Pairs => {
            let pairs = Pairs::new(&stored, &table.area, &rows, threads)?;
            rows = pairs.rows(&rows, threads)?;
            Some(pairs)
        }
    };
    let factors: &dyn Factors = match &pairs {
        Some(pairs) => pairs,
        None => &stored,
    };
    let mut planets = None;
    if let (Some(suns), Some(prepared)) = (&mut suns, &prepared)
        && let Some(warning) = suns.turn(|| stored::horizon(&store, prepared))?
    {
        talk.warn(&warning);
    }
    let sun = match (&suns, &mut prepared) {
        (Some(suns), Some(prepared)) => {
            let mut arriving = suns::skylight(arguments, &store, &rows, suns, talk)?;
            let lit = Lit::new(arguments, &store, prepared, talk)?;
            lit.add(suns, &mut arriving)?;
            planets = lit.planets(suns, table.len())?;
            if let Some(planets) = &planets {
                suns::add_albedo(suns, planets, &mut arriving);
            }
            Some((suns, arriving))
        }
        _ => None,
    };
    drop(prepared);
    let at_once = columns_at_once(arguments, &store);
    let work = Work {
        sun,
        planets,
        at_once,
        cancel,
        talk,
    };
    let task = match Task::new(arguments, (&store, factors), &table, &rows, work) {
        Err(error) if matches!(error.downcast_ref(), Some(SolveError::Interrupted)) => return Ok(Exit::Interrupted),
        task => task?,
    };
    let name = arguments.solution.as_deref().unwrap_or(arguments.quantity().name);
    let mut writer = SolutionWriter::create(&store, name, task.quantities(), task.rows)?;
    let mut record = task.record(arguments)?;
    let guard = exit::InterruptGuard::new();
    let Some(()) = task.solve(factors, at_once, &mut writer, &mut record, cancel, talk)? else {
        return Ok(Exit::Interrupted);
    };
    // Keeps the solution from being replaced while outputs are written.
    let (path, _lock) = writer.finish(&serde_json::to_value(&record).context("the report is no JSON")?)?;
    drop(guard);
    let stored = StoredSolution::open(&store, name)?;
    let light = match &task.kind {
        Kind::Light(_) => Some(light::Results::new(
            arguments.by,
            &stored,
            &store,
            &table,
            (&record.bands, record.brightest()),
        )?),
        Kind::Heat(_) => None,
    };
    for output in &arguments.output {
        match &light {
            None if arguments.is_by_surface(output) => record.by_surface.write(output)?,
            Some(light) if arguments.is_by_surface(output) && record.moments.is_empty() => light.write(output)?,
            Some(_) if arguments.is_by_surface(output) => {
                let at = |moment: usize| {
                    let bands = (&*record.bands, moment);
                    light::Results::new(arguments.by, &stored, &store, &table, bands)
                };
                light::write_moments(output, &record.moments, at)?;
            }
            _ => write_output(&stored, &store, &table, &record, output)?,
        }
    }
    let seconds = started.elapsed().as_secs_f64();
    if !arguments.report.json {
        let results = match &light {
            Some(light) => light.text(record.moments.get(record.brightest()).map(String::as_str)),
            None => record.by_surface.text(talk.verbose),
        };
        report::print(&(results + &sunlight_text(&record) + &energy(&record)))?;
    }
    talk.detail(text(&record, &store, seconds).trim_end());
    let matrix = crate::shell::word(store.directory());
    talk.say(&format!(
        "written: `{}`\nNext:\n  hemicube view model {matrix} --solution {name} -o {name}.png   # a picture",
        path.display()
    ));
    for warning in &record.warnings {
        talk.warn(warning);
    }
    if !record.converged {
        talk.warn(&format!(
            "the residual did not reach {}; allow more with `--max-iterations`, or look for surfaces that reflect \
             all{}",
            figures(record.tolerance),
            record.unsettled.as_deref().unwrap_or_default()
        ));
    }
    if let Some(json) = json {
        let timings = talk.verbose;
        json.write(&Report {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION"),
            store: arguments.matrix.store.display().to_string(),
            patches: store.patch_count().into(),
            entries: store.manifest().entries,
            solution: path.display().to_string(),
            record: &record,
            seconds: timings.then_some(seconds),
            peak_memory_bytes: report::peak_memory_bytes().filter(|_| timings),
        })?;
    }
    let holds = record.converged && record.energy_error.is_none_or(|share| share <= ERROR_MOST);
    Ok(if holds { Exit::Done } else { Exit::NotHeld })
}

/// The words for light or heat.
struct Quantity {
    /// In reports.
    kind: &'static str,
    /// Built-in name of the solution.
    name: &'static str,
}

impl Arguments {
    fn quantity(&self) -> Quantity {
        if self.thermal {
            Quantity {
                kind: "heat",
                name: "thermal",
            }
        } else {
            Quantity {
                kind: "light",
                name: "radiosity",
            }
        }
    }

    /// Refuses a sky that nothing is asked of.
    fn require_quantities(&self) -> Result<()> {
        if self.sky.is_some() && self.sky_radiance.is_none() && self.suns.is_none() && self.ground_temperature.is_none()
        {
            bail!(
                "`--sky` divides the sky for `--sky-radiance`, `--suns` or `--ground-temperature`, and none is given"
            );
        }
        Ok(())
    }

    /// Returns whether a file is written by surface: a .json, a .parquet, and a .csv where surfaces are asked for.
    fn is_by_surface(&self, output: &Path) -> bool {
        let ends_in = |name: &str| output.extension().is_some_and(|end| end.eq_ignore_ascii_case(name));
        ends_in("json") || ends_in("parquet") || ends_in("csv") && (self.by.is_some() || self.network)
    }

    /// The scene that properties are taken of: the one given; the matrix's own without any file of properties.
    fn scene(&self, store: &Store) -> Option<PathBuf> {
        let found = || stored::found_scene(store).filter(|_| self.materials.is_none());
        self.scene.clone().or_else(found)
    }

    /// Likewise for its properties: with suns and a file of properties, the scene says where shadows fall, and no more.
    fn scene_of_properties(&self, store: &Store) -> Option<PathBuf> {
        let is_geometry = self.suns.is_some() && self.materials.is_some();
        self.scene(store).filter(|_| !is_geometry)
    }

    /// What of the matrix stands for a pair.
    fn reading(&self) -> Reading {
        if self.as_stored {
            Reading::AsStored
        } else {
            Reading::Pairs
        }
    }

    fn options(&self) -> SolveOptions {
        SolveOptions {
            method: Method::Gmres { restart: RESTART },
            tolerance: self.residual,
            max_iterations: self.max_iterations,
            threads: self.matrix.threads as usize,
        }
    }
}

/// Looks at the scene before anything is solved: warns of surfaces that face the wrong way. Suns need it.
fn prepare_scene(arguments: &Arguments, store: &Store, talk: Talk) -> Result<Option<Prepared>> {
    let scene = match arguments.scene(store) {
        Some(scene) => scene,
        None if arguments.suns.is_some() => stored::scene_file(store, None, "`--scene SCENE`")?,
        None => return Ok(None),
    };
    let engine = EngineSettings::default();
    let prepared = stored::scene(store, &scene, &engine, Limits::of(arguments.allow_large))?;
    enclosure::warn_of_winding(&prepared, arguments.options().threads(), talk);
    Ok(Some(prepared))
}

/// Prints the file of materials to begin with.
fn print_materials(arguments: &Arguments, store: &Store, talk: Talk) -> Result<Exit> {
    let properties = materials::read(
        store.manifest(),
        &store.patches()?,
        arguments.scene(store).as_deref(),
        arguments.materials.as_deref(),
        arguments.allow_large,
        talk,
    )?;
    report::print(&materials::file_of(&properties.by_object(), &arguments.matrix.store))?;
    Ok(Exit::Done)
}

/// Number of right-hand sides solved together: their vectors take half the memory.
fn columns_at_once(arguments: &Arguments, store: &Store) -> u64 {
    let vectors = VECTORS
        + u64::from(RESTART)
        + 2
        + match arguments.reading() {
            Reading::Pairs => SUMS as u64,
            Reading::AsStored => 0,
        };
    (arguments.memory / 2 / (8 * vectors * u64::from(store.patch_count()).max(1))).clamp(1, 1024)
}

/// What is told of a solution of heat at a moment.
struct Judged {
    balance: Vec<EnergyBalance>,
    /// The part of the heat that is not known.
    share: f64,
    warnings: Vec<String>,
    unsettled: Option<String>,
    results: surfaces::Results,
}

/// What `of` makes of each item, in their order, by several threads.
fn in_parallel<T: Sync, R: Send>(items: &[T], threads: usize, of: &(dyn Fn(&T) -> R + Sync)) -> Vec<R> {
    let share = items.len().div_ceil(threads.max(1)).max(1);
    std::thread::scope(|scope| {
        let of_share = |items: &'_ [T]| items.iter().map(of).collect::<Vec<R>>();
        let workers: Vec<_> = items
            .chunks(share)
            .map(|items| scope.spawn(move || of_share(items)))
            .collect();
        let join = |worker: std::thread::ScopedJoinHandle<'_, Vec<R>>| {
            worker
                .join()
                .unwrap_or_else(|payload| std::panic::resume_unwind(payload))
        };
        workers.into_iter().flat_map(join).collect()
    })
}

/// How a task is worked on, and what shines on it: the suns, and what arrives of them on each patch.
struct Work<'a> {
    sun: Option<(&'a Suns, Block)>,
    /// What arrives on each patch from the planet of each moment, of a radiosity of 1.
    planets: Option<Block>,
    /// Right-hand sides solved together.
    at_once: u64,
    cancel: &'a AtomicBool,
    talk: Talk,
}

/// The system: sources of the right-hand sides, and materials.
struct Task<'a> {
    bands: Vec<String>,
    rows: u64,
    table: &'a PatchTable,
    row_table: &'a RowTable,
    options: SolveOptions,
    kind: Kind,
}

/// Light from the sky: radiances, a row a right-hand side, and the sky rows of the patches.
struct Sky {
    radiance: ArrayFile,
    division: PathBuf,
}

enum Kind {
    Light(Box<Light>),
    Heat(Box<heat::Exchange>),
}

struct Light {
    optics: Vec<Optics>,
    /// Index of each patch into `optics`.
    kind_of_patch: Vec<u32>,
    emission: Option<ArrayFile>,
    sky: Option<Sky>,
    /// Names of the suns, and what arrives from each on each patch.
    sun: Option<(Vec<String>, Block)>,
}

impl Light {
    /// Names the surface of a patch.
    fn shown(&self, patch: usize) -> String {
        let of = &self.optics[self.kind_of_patch[patch] as usize];
        match &of.object {
            Some(object) => format!("object `{object}`"),
            None => format!("material `{}`", of.name),
        }
    }

    /// The error of light that never ends.
    fn endless(&self, patch: usize, count: usize) -> anyhow::Error {
        hinted(
            anyhow!(
                "{} and what it sees, {} in all, emit, reflect all of it and let none out: light adds up for ever, \
                 and no radiosity is finite",
                self.shown(patch),
                counted(count as u64, "patch")
            ),
            "give one of these surfaces a `reflectance` below 1 by `--materials FILE`, or open the scene",
        )
    }
}

impl<'a> Task<'a> {
    /// The record of a solution before the first right-hand side.
    fn record(&self, arguments: &Arguments) -> Result<Record> {
        Ok(Record {
            program: env!("CARGO_PKG_VERSION"),
            quantity: arguments.quantity().kind,
            bands: self.bands.clone(),
            band_of_row: (0..self.rows).map(|row| self.band(row)).collect(),
            surfaces: match &self.kind {
                Kind::Light(light) => Surfaces::Light(light.optics.clone()),
                Kind::Heat(exchange) => exchange.recorded(),
            },
            method: self.options.method,
            tolerance: self.options.tolerance,
            reading: arguments.reading(),
            converged: true,
            iterations: 0,
            residuals: Vec::new(),
            balance: Vec::new(),
            energy_error: None,
            warnings: Vec::new(),
            unsettled: None,
            moments: match &self.kind {
                Kind::Light(light) => light.sun.as_ref().map(|(names, _)| names.clone()).unwrap_or_default(),
                Kind::Heat(exchange) => exchange.names_of_moments().to_vec(),
            },
            sunlight: match &self.kind {
                Kind::Light(_) => Vec::new(),
                Kind::Heat(exchange) => exchange.sunlight.clone(),
            },
            by_surface: surfaces::Moments::default(),
        })
    }

    /// Solves all right-hand sides, `at_once` together, and writes them; `None` where interrupted.
    fn solve(
        &self,
        factors: &dyn Factors,
        at_once: u64,
        writer: &mut SolutionWriter,
        record: &mut Record,
        cancel: &AtomicBool,
        talk: Talk,
    ) -> Result<Option<()>> {
        let bar = Bar::spinner(talk, "solving");
        let mut first = 0;
        while first < self.rows {
            let end = (first + at_once).min(self.rows);
            let mut progress = |step: Step| {
                let text = format!(
                    "iteration {}, residual {}{}",
                    step.iteration,
                    figures(step.residual),
                    if end - first < self.rows {
                        format!(", right-hand sides {} to {end} of {}", first + 1, self.rows)
                    } else {
                        String::new()
                    }
                );
                bar.message(&text);
                talk.detail(&text);
                !cancel.load(Ordering::SeqCst)
            };
            let found = match &self.kind {
                Kind::Light(light) => {
                    let problem = self.problem(light, first..end)?;
                    let solution = match solve(factors, &problem, self.options, &mut progress) {
                        Ok(solution) => solution,
                        Err(SolveError::Interrupted) => return Ok(None),
                        Err(SolveError::Endless { patch, count }) => return Err(light.endless(patch, count)),
                        Err(error) => return Err(error.into()),
                    };
                    record.count(&solution);
                    let balance = energy_balance(&problem, &solution, &self.table.area, self.row_table);
                    record.balance.extend(balance);
                    keep(writer, &solution, None, self.row_table)?;
                    first = end;
                    continue;
                }
                Kind::Heat(exchange) => {
                    let place = |row: u64| usize::try_from(row).unwrap_or(usize::MAX);
                    let moments = place(first)..place(end);
                    exchange
                        .solve(factors, moments, self.options, &mut progress)?
                        .map(|found| (exchange, found))
                }
            };
            let Some((exchange, found)) = found else {
                return Ok(None);
            };
            let judge = |found: &HeatSolution| self.judged(exchange, factors, found);
            for (found, judged) in found.iter().zip(in_parallel(&found, self.options.threads(), &judge)) {
                let judged = judged?;
                record.count(&found.solution);
                record.balance.extend(judged.balance);
                // Of the moment of which least is known.
                if record.energy_error.is_none_or(|most| judged.share > most) {
                    record.energy_error = Some(judged.share);
                    record.warnings = judged.warnings;
                }
                record.unsettled = record.unsettled.take().or(judged.unsettled);
                keep(writer, &found.solution, Some(&found.temperature), self.row_table)?;
                if record.balance.len() == 1 {
                    let what = format!("results by surface of {}", counted(self.rows, "moment"));
                    let bytes = self.rows.saturating_mul(judged.results.bytes());
                    forecast::require(Budget::default(), bytes, &what, "solve for fewer moments at a time")?;
                }
                record
                    .by_surface
                    .add(record.moments.get(record.balance.len() - 1), judged.results);
            }
            first = end;
        }
        Ok(Some(()))
    }

    /// What is told of a solution of heat.
    fn judged(
        &self,
        exchange: &heat::Exchange,
        factors: &dyn Factors,
        found: &HeatSolution,
    ) -> Result<Judged, SolveError> {
        let enclosures = exchange.enclosures(factors, self.table, self.row_table, found)?;
        Ok(Judged {
            balance: energy_balance(&found.problem, &found.solution, &self.table.area, self.row_table),
            share: enclosures.share(),
            warnings: exchange.warnings(&enclosures),
            unsettled: exchange.unsettled(found),
            results: exchange.by_surface(self.table, self.row_table, found, enclosures),
        })
    }

    fn new(
        arguments: &Arguments,
        (store, factors): (&Store, &dyn Factors),
        table: &'a PatchTable,
        row_table: &'a RowTable,
        work: Work<'_>,
    ) -> Result<Self> {
        let talk = work.talk;
        let properties = materials::read(
            store.manifest(),
            table,
            arguments.scene_of_properties(store).as_deref(),
            arguments.materials.as_deref(),
            arguments.allow_large,
            talk,
        )?;
        for note in properties.notes() {
            talk.warn(note);
        }
        if arguments.thermal {
            let exchange = heat::Exchange::new(arguments, (store, factors), table, row_table, &properties, work)?;
            exchange.question(arguments, table, row_table, talk);
            return Ok(Self {
                bands: vec!["total".to_owned()],
                rows: exchange.moments() as u64,
                table,
                row_table,
                options: arguments.options(),
                kind: Kind::Heat(Box::new(exchange)),
            });
        }
        let bands = properties.bands().to_vec();
        let optics = properties.optics().map_err(materials::told)?;
        let emission = arguments.emission.as_deref().map(ArrayFile::open).transpose()?;
        if let (Some(array), Some(path)) = (&emission, &arguments.emission) {
            if array.columns() != u64::from(store.patch_count()) {
                bail!(
                    "`{}` has {}, and the matrix {}: one row a right-hand side is needed",
                    path.display(),
                    counted(array.columns(), "column"),
                    counted(store.patch_count().into(), "patch")
                );
            }
            require_bands(array, path, &bands)?;
            require_from_zero(array, path, "an emission")?;
        }
        let sky = Sky::read(arguments, store, &bands, emission.as_ref())?;
        let kind_of_patch = properties.kind_of_patch().to_vec();
        let of = |patch: usize| &optics[kind_of_patch[patch] as usize];
        let shown = |patch: usize| match (&of(patch).object, &of(patch).name) {
            (Some(object), _) => format!("object `{object}`"),
            (None, material) => format!("material `{material}`"),
        };
        let most = |patch: usize| of(patch).reflectance.iter().copied().fold(0.0, f64::max);
        require_shares(row_table, "reflectance", shown, most)?;
        let dark = |kind: &u32| optics[*kind as usize].emission.iter().all(|&emission| emission == 0.0);
        let sun = work.sun.map(|(suns, arriving)| (suns.names.clone(), arriving));
        if emission.is_none() && sky.is_none() && sun.is_none() && kind_of_patch.iter().all(dark) {
            return Err(hinted(
                anyhow!("nothing emits: every material has an emission of 0"),
                "give one an `emission` by `--materials FILE`, patches theirs by `--emission FILE.npy`, the sky by \
                 `--sky-radiance FILE.npy`, or suns by `--suns FILE`",
            ));
        }
        let of_bands = |moments: u64| moments * bands.len() as u64;
        Ok(Self {
            rows: emission.as_ref().or(sky.as_ref().map(|sky| &sky.radiance)).map_or(
                of_bands(sun.as_ref().map_or(1, |(names, _)| names.len() as u64)),
                ArrayFile::rows,
            ),
            bands,
            table,
            row_table,
            options: arguments.options(),
            kind: Kind::Light(Box::new(Light {
                optics,
                kind_of_patch,
                emission,
                sky,
                sun,
            })),
        })
    }

    fn band(&self, row: u64) -> usize {
        usize::try_from(row % self.bands.len() as u64).unwrap_or(0)
    }

    fn quantities(&self) -> &'static [&'static str] {
        match self.kind {
            Kind::Light(_) => &["radiosity", "irradiance"],
            Kind::Heat(_) => &["radiosity", "irradiance", "flux", "temperature"],
        }
    }

    fn problem(&self, light: &Light, rows: std::ops::Range<u64>) -> Result<Problem> {
        let patches = self.table.len();
        let optics = |patch: usize| &light.optics[light.kind_of_patch[patch] as usize];
        let bands: Vec<usize> = rows.clone().map(|row| self.band(row)).collect();
        let mut returned = self.row_table.returned();
        let outside = match &light.sky {
            // A patch of the sky sends π times its radiance, like a white wall.
            Some(sky) => {
                let mut radiances = Vec::new();
                for row in rows.clone() {
                    let radiance = sky.radiance.row(row)?;
                    radiances.push(radiance.into_iter().map(|l| std::f64::consts::PI * l).collect());
                }
                // Sum over the patches of the sky: all known surroundings.
                radiances.push(vec![1.0; radiances.first().map_or(0, Vec::len)]);
                let product = sky_product(&sky.division, &radiances)?;
                let (last, columns) = (radiances.len() - 1, product.patches());
                let outside = Block::from_fn(columns, last, |patch, row| product.of(patch)[row]);
                let seen: Vec<f64> = (0..columns).map(|patch| product.of(patch)[last]).collect();
                if outside.patches() != patches {
                    bail!(
                        "`{}` is of another number of patches than the matrix",
                        sky.division.display()
                    );
                }
                returned = self.row_table.returned_beside(&seen);
                Some(outside)
            }
            None => light.sun.as_ref().map(|(_, arriving)| {
                let moment =
                    |column: u64| usize::try_from((rows.start + column) / self.bands.len() as u64).unwrap_or(0);
                Block::from_fn(patches, bands.len(), |patch, column| {
                    arriving.of(patch)[moment(column as u64)]
                })
            }),
        };
        let emission = match &light.emission {
            None => Block::from_fn(patches, bands.len(), |patch, column| {
                optics(patch).emission[bands[column]]
            }),
            Some(array) => {
                let read: Vec<Vec<f64>> = rows.map(|row| array.row(row)).collect::<Result<_, _>>()?;
                Block::from_fn(patches, bands.len(), |patch, column| read[column][patch])
            }
        };
        Ok(Problem {
            reflectance: Block::from_fn(patches, self.bands.len(), |patch, band| optics(patch).reflectance[band]),
            bands,
            emission,
            outside,
            returned: Some(returned),
        })
    }
}

impl Sky {
    /// The radiances of `--sky-radiance`, and the division that they are of.
    fn read(
        arguments: &Arguments,
        store: &Store,
        bands: &[String],
        emission: Option<&ArrayFile>,
    ) -> Result<Option<Self>> {
        let Some(path) = &arguments.sky_radiance else {
            return Ok(None);
        };
        let radiance = ArrayFile::open(path)?;
        require_bands(&radiance, path, bands)?;
        require_from_zero(&radiance, path, "a radiance")?;
        if let Some(emission) = emission
            && emission.rows() != radiance.rows()
        {
            bail!(
                "`{}` has {} right-hand sides, and the emission {}",
                path.display(),
                radiance.rows(),
                emission.rows()
            );
        }
        let division = match &arguments.sky {
            Some(division) => division.clone(),
            None => stored::sky(store)?,
        };
        Ok(Some(Self { radiance, division }))
    }
}

/// Writes right-hand sides: radiosity and irradiance, and of heat flux and temperature.
fn keep(writer: &mut SolutionWriter, solution: &Solution, temperature: Option<&[f64]>, rows: &RowTable) -> Result<()> {
    writer.append(0, &solution.radiosity)?;
    writer.append(1, &solution.irradiance)?;
    if let Some(temperature) = temperature {
        let (b, g) = (&solution.radiosity, &solution.irradiance);
        writer.append(
            2,
            &Block::from_fn(b.patches(), 1, |patch, _| {
                b.of(patch)[0] - rows.kept(patch) * g.of(patch)[0]
            }),
        )?;
        writer.append(3, &Block::from_fn(b.patches(), 1, |patch, _| temperature[patch]))?;
    }
    Ok(())
}

fn require_bands(array: &ArrayFile, path: &Path, bands: &[String]) -> Result<()> {
    if array.rows() == 0 || !array.rows().is_multiple_of(bands.len() as u64) {
        bail!(
            "`{}` has {}, which is no multiple of the {} bands; `bands = [\"all\"]` in the file of materials \
             makes one",
            path.display(),
            counted(array.rows(), "row"),
            bands.len()
        );
    }
    Ok(())
}

/// Refuses numbers below 0, and what is none.
fn require_from_zero(array: &ArrayFile, path: &Path, what: &str) -> Result<()> {
    for row in 0..array.rows() {
        let values = array.row(row)?;
        let is_sound = |value: &f64| *value >= 0.0 && value.is_finite();
        if let Some(at) = values.iter().position(|value| !is_sound(value)) {
            bail!(
                "`{}` has {} in row {row}, column {at}, counted from 0; {what} is a finite number from 0 on",
                path.display(),
                values[at]
            );
        }
    }
    Ok(())
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OutputFormat {
    Npz,
    Csv,
}

impl OutputFormat {
    fn of(path: &Path) -> Result<Self> {
        match path.extension().map(std::ffi::OsStr::to_ascii_lowercase) {
            Some(extension) if extension == "npz" => Ok(Self::Npz),
            Some(extension) if extension == "csv" => Ok(Self::Csv),
            _ => bail!(
                "`--output {}`: a name that ends in .npz, .csv, .json or .parquet is needed",
                path.display()
            ),
        }
    }
}

fn write_output(
    stored: &StoredSolution,
    store: &Store,
    table: &PatchTable,
    record: &Record,
    path: &Path,
) -> Result<()> {
    match OutputFormat::of(path)? {
        OutputFormat::Npz => Ok(stored.write_npz(path)?),
        OutputFormat::Csv => write_csv(stored, store, table, record, path),
    }
}

fn write_csv(stored: &StoredSolution, store: &Store, table: &PatchTable, record: &Record, path: &Path) -> Result<()> {
    let mut columns = Vec::new();
    let mut header = "patch,object,material,area,x,y,z".to_owned();
    for quantity in stored.quantities() {
        let array = stored.quantity(quantity)?;
        if array.rows() > CSV_COLUMNS_MAX {
            bail!(
                "{} right-hand sides are too many columns for `{}`; write a .npz",
                array.rows(),
                path.display()
            );
        }
        for row in 0..array.rows() {
            let place = usize::try_from(row).unwrap_or(usize::MAX);
            let band = &record.bands[record.band_of_row[place]];
            let name = match record.moments.get(place / record.bands.len()) {
                Some(moment) if record.bands.len() == 1 => format!("{quantity}_{moment}"),
                Some(moment) => format!("{quantity}_{band}_{moment}"),
                None if array.rows() > record.bands.len() as u64 => format!("{quantity}_{band}_{row}"),
                None => format!("{quantity}_{band}"),
            };
            header.push_str(&format!(",{}", field(&name)));
            columns.push(array.row(row)?);
        }
    }
    let mut file = PendingFile::create(path)?;
    let cannot = || format!("`{}` cannot be written", path.display());
    let manifest = store.manifest();
    let mut out = std::io::BufWriter::with_capacity(1 << 20, &mut file);
    writeln!(out, "{header}").with_context(cannot)?;
    for patch in 0..table.len() {
        let name =
            |names: &[String], index: u32| names.get(index as usize).map_or_else(String::new, |name| field(name));
        let [x, y, z] = table.centroid[patch];
        write!(
            out,
            "{patch},{},{},{},{x},{y},{z}",
            name(&manifest.objects, table.object[patch]),
            name(&manifest.materials, table.material[patch]),
            table.area[patch]
        )
        .with_context(cannot)?;
        for column in &columns {
            write!(out, ",{}", column[patch]).with_context(cannot)?;
        }
        writeln!(out).with_context(cannot)?;
    }
    out.flush().with_context(cannot)?;
    drop(out);
    file.commit()
}

/// How much of the energy the solution does not account for, in a line.
/// Sunlight of a single moment, or its means over several.
fn sunlight_text(record: &Record) -> String {
    let count = record.sunlight.len();
    if count == 0 {
        return String::new();
    }
    let mean = |of: &dyn Fn(&Sunlight) -> f64| record.sunlight.iter().map(of).sum::<f64>() / count as f64;
    let mut list = Listing::default();
    list.add(
        "sunlight",
        format!(
            "{} W arrives from the sun and the sky, {} W is absorbed after all reflections{}",
            figures(mean(&|of| of.arriving)),
            figures(mean(&|of| of.absorbed)),
            if count > 1 { ", on average" } else { "" }
        ),
    );
    list.text()
}

fn energy(record: &Record) -> String {
    let unaccounted = |balance: &EnergyBalance| balance.unaccounted().abs();
    let worst = record.balance.iter().map(unaccounted).fold(0.0, f64::max);
    let mut list = Listing::default();
    list.add(
        "energy error",
        format!(
            "{} of the energy put in is unaccounted for{}",
            small_percent(worst),
            if record.balance.len() > 1 { ", at most" } else { "" }
        ),
    );
    list.text()
}

/// The solver's work, for `-v`.
fn text(record: &Record, store: &Store, seconds: f64) -> String {
    let mut list = Listing::default();
    let worst = record.residuals.iter().copied().fold(0.0, f64::max);
    list.add(
        "solved",
        format!(
            "{} for {} of {} by GMRES: residual {} after {}, {}",
            if record.quantity == "heat" { "heat" } else { "light" },
            counted(record.residuals.len() as u64, "right-hand side"),
            counted(store.patch_count().into(), "patch"),
            figures(worst),
            counted(record.iterations.into(), "product"),
            duration(seconds),
        ),
    );
    for (row, balance) in record.balance.iter().enumerate().take(BALANCES_SHOWN) {
        let input = balance.input();
        let share = |power: f64| if input == 0.0 { 0.0 } else { power / input };
        let mut parts = vec![format!("{} absorbed", percent(share(balance.absorbed)))];
        for (power, what) in [
            (balance.escaped, "escaped"),
            (balance.blocked, "blocked by backs"),
            (balance.unselected, "to patches without columns"),
        ] {
            if power != 0.0 {
                parts.push(format!("{} {what}", percent(share(power))));
            }
        }
        if share(balance.returned).abs() > RETURNED_SHOWN {
            parts.push(format!(
                "{} returned from backs and what rows lack",
                percent(share(balance.returned))
            ));
        }
        list.add(
            &format!("balance of {}", record.bands[record.band_of_row[row]]),
            format!(
                "{} put in; {}; unaccounted {:+.2e} (rows' sums {:+.1e}, reciprocity {:+.1e}, iteration {:+.1e})",
                figures(input),
                parts.join(", "),
                balance.unaccounted(),
                share(balance.closure),
                share(balance.reciprocity),
                share(balance.residual),
            ),
        );
    }
    if record.balance.len() > BALANCES_SHOWN {
        let worst = record.balance.iter().map(|b| b.unaccounted().abs()).fold(0.0, f64::max);
        list.add(
            "balances",
            format!(
                "{} more; of all, at most {} unaccounted",
                count((record.balance.len() - BALANCES_SHOWN) as u64),
                percent(worst)
            ),
        );
    }
    if let Some(memory) = report::peak_memory_bytes() {
        list.add("memory", size(memory));
    }
    list.text()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube::store::{ElementType, NpyHeader};

    #[test]
    fn sizes() {
        assert_eq!(bytes("500MB"), Ok(500_000_000));
        assert_eq!(bytes("1.5 gb"), Ok(1_500_000_000));
        assert_eq!(bytes("77"), Ok(77));
        for wrong in ["", "MB", "-3", "3XB", "nan"] {
            assert!(bytes(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn numbers_of_arrays_are_from_zero_on() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("e.npy");
        let told = |values: [f64; 4]| {
            let mut bytes = NpyHeader::bytes(ElementType::F64, &[2, 2]);
            values
                .iter()
                .for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
            std::fs::write(&path, bytes).unwrap();
            let told = require_from_zero(&ArrayFile::open(&path).unwrap(), &path, "an emission");
            told.map_err(|error| error.to_string())
        };
        assert_eq!(told([0.0, 1.0, 2.0, 1e9]), Ok(()));
        for (wrong, shown) in [(-3.0, "-3"), (f64::NAN, "NaN"), (f64::INFINITY, "inf")] {
            let error = told([0.0, 1.0, 2.0, wrong]).unwrap_err();
            let reason =
                format!("has {shown} in row 1, column 1, counted from 0; an emission is a finite number from 0");
            assert!(error.contains(&reason), "{error}");
        }
    }

    #[test]
    fn fields_of_tables() {
        assert_eq!(field("wall"), "wall");
        assert_eq!(field("a, \"b\""), "\"a, \"\"b\"\"\"");
    }
}
