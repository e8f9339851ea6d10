//! `hemicube sky`: views of the sky, the ground and the sun, from patches and points.

use crate::args::{By, Division, EngineSettings, Report as ReportArguments, SceneSettings, Talk};
use crate::enclosure;
use crate::exit::{self, Exit, hinted};
use crate::forecast;
use crate::help::{SCENE, examples, scene_help};
use crate::level::asked as asked_for;
use crate::level::percentage;
use crate::outputs::Paths;
use crate::portals;
use crate::prepare::{Prepared, axis_name, prepare};
use crate::progress::Bar;
use crate::report::{
    self, Input, JsonReport, Listing, PendingFile, SCHEMA, Spread, count, counted, duration, lines, percent,
};
use crate::stored;
use crate::suns::{self, ALTITUDE, direction_of};
use crate::table;
use anyhow::{Context, Result, anyhow, bail};
use clap::{Args, ValueEnum};
use glam::DVec3;
use hemicube::backend::{Culling, HemicubeBackend, RenderSettings, WHOLE};
use hemicube::diagnose::{Place, places};
use hemicube::driver::room::Work;
use hemicube::portal::specular::SpecularRecord;
use hemicube::portal::{Images, Portals, Specular};
use hemicube::reference::{Reference, ReferenceSettings};
use hemicube::sky::{
    Glazed, Horizon, LEVELS, PointRow, SUN_ERROR, SensorPoint, SkyDivision, SkyOptions, SkyRow, hemicubes_along,
    rows_of_points, sky_of_groups, sky_of_patches, sky_through_portals, sunlight, sunlit, write_points, write_sky,
    write_sunlight,
};
use hemicube::store::{FolderLock, PatchTable, Store, scene_hash};
use hemicube::{Grouping, InputPatch};
use hemicube_export::{PatchFormat, PatchResults, WriteOptions, write_patches};
use hemicube_spatial::whole;
use serde::Serialize;
use std::collections::{BTreeMap, HashMap};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Pixels along an edge, without an option or a matrix.
const RESOLUTION: u32 = 256;
/// A path ends where no more than this share of it is left.
const BOUND: f64 = 1e-4;
/// Rows that lose more than this to the sky by the matrix, and met none of it, are rendered again.
const LOST_LEAST: f64 = 1e-3;

/// Suns in the summary.
const SUNS_SHOWN: usize = 8;
/// Files in the output directory.
pub(crate) const FILES: [&str; 4] = ["sky.npz", "sky.json", "points-sky.npz", "sunlight.npy"];

const EXAMPLES: &str = "  \
  hemicube sky city.obj
  hemicube sky city.obj --up z -o city-sky -o sky.csv --tolerance 0.5%
  hemicube sky city.obj --matrix city.hemicube
  hemicube sky street.obj -o sky --division reinhart:4 --points people.txt --suns june.txt";

/// What patches and points see of the sky, of the ground below the horizon, and of the sun
#[derive(Args, Debug)]
#[command(after_long_help = examples(EXAMPLES, false))]
pub(crate) struct Arguments {
    #[arg(value_name = "SCENE", help = SCENE, long_help = scene_help())]
    pub(crate) scene: PathBuf,
    /// Take the patches and hemicubes of this matrix, and write into its directory `sky`
    #[arg(
        long,
        value_name = "DIR",
        conflicts_with_all = ["split", "patch_size", "two_sided", "flip", "exclude", "scale", "keep_duplicates"]
    )]
    pub(crate) matrix: Option<PathBuf>,
    /// The directory to write to, or a table, a line a patch: .csv (repeatable) [default: only the summary is printed]
    #[arg(short, long, value_name = "DIR|FILE.csv")]
    pub(crate) output: Vec<PathBuf>,
    /// Replace what `-o` names
    #[arg(long, requires = "output")]
    pub(crate) overwrite: bool,
    /// How the sky is divided: tregenza (145 patches) or reinhart:N (144 N² + 1)
    #[arg(long, value_name = "tregenza|reinhart:N", default_value = "tregenza")]
    pub(crate) division: Division,
    /// Turn north clockwise, seen from above; 0: +y where z is up, −z where y is up, +z where x is up
    #[arg(long, value_name = "DEGREES", default_value = "0", value_parser = crate::args::degrees, allow_negative_numbers = true)]
    pub(crate) north: f64,
    /// Rows of points, too: a file with `x y z nx ny nz` a line, or columns of these names
    #[arg(long, value_name = "FILE")]
    pub(crate) points: Option<PathBuf>,
    /// Which part of each patch sees these suns: a file with the direction `x y z` towards one a line, or columns of
    /// these names, or `azimuth` (clockwise from north) and `altitude` in degrees
    #[arg(long, value_name = "FILE")]
    pub(crate) suns: Option<PathBuf>,
    /// What hides suns: the ground below the horizon, or nothing, as in space
    #[arg(
        long,
        value_name = "ground|none",
        default_value = "ground",
        requires = "suns",
        hide_possible_values = true,
        hide_short_help = true
    )]
    pub(crate) horizon: HorizonName,
    /// Each .csv is a table of suns by surface, with sunlit and projected areas
    #[arg(
        long,
        value_name = "object|material|face",
        requires = "suns",
        hide_possible_values = true
    )]
    pub(crate) by: Option<By>,
    /// Refine each row until its sky view factor changes by no more than this share, and ground and blocked by no more
    /// of the view: 1%, 0.001. Exit 1 where rows do not settle; the last change bounds no error
    #[arg(long, value_name = "T", value_parser = crate::args::change)]
    pub(crate) tolerance: Option<f64>,
    /// Pixels along an edge: a multiple of 16 up to 1024 [default: 256, or the matrix's]
    #[arg(long, value_name = "N", value_parser = crate::args::pixels)]
    pub(crate) resolution: Option<u32>,
    /// Hemicubes a patch: 1, 4, 9, 16… [default: 1, or the matrix's]
    #[arg(long, value_name = "K", value_parser = samples, conflicts_with = "tolerance")]
    pub(crate) samples: Option<u32>,
    /// See through mirrors and panes, by FILE (docs/portals.md) or the `scene` [default: the matrix's]
    #[arg(long, value_name = "FILE", conflicts_with_all = ["tolerance", "points"])]
    pub(crate) specular: Option<PathBuf>,
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
        let folders = self.folders().flat_map(|folder| FILES.map(|name| folder.join(name)));
        let files: Vec<PathBuf> = folders.chain(self.tables().cloned()).collect();
        Paths::default()
            .reads([&self.scene])
            .store(&self.matrix)
            .reads(&self.points)
            .reads(&self.suns)
            .reads(&crate::portals::file_of(self.specular.as_ref()))
            .writes("-o", &files, self.overwrite)
    }
}

/// What hides suns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum HorizonName {
    /// The ground below the horizon.
    Ground,
    /// Nothing: in space.
    None,
}

/// Returns whether an output is a table.
fn is_table(path: &Path) -> bool {
    path.extension().is_some_and(|end| end.eq_ignore_ascii_case("csv")) && !path.is_dir()
}

impl Arguments {
    /// Directories to write to: one at most, by [`require_places`].
    fn folders(&self) -> impl Iterator<Item = &PathBuf> {
        self.output.iter().filter(|path| !is_table(path))
    }

    /// Tables to write.
    fn tables(&self) -> impl Iterator<Item = &PathBuf> {
        self.output.iter().filter(|path| is_table(path))
    }
}

fn samples(text: &str) -> Result<u32, String> {
    match text.parse::<u32>() {
        Ok(k) if k > 0 && k <= 4096 && k.isqrt().pow(2) == k => Ok(k.isqrt()),
        _ => Err("a perfect square (1, 4, 9, 16…) up to 4096 is needed".to_owned()),
    }
}

/// Record beside the files.
#[derive(Debug, Serialize)]
struct Record {
    program: &'static str,
    scene: String,
    scene_blake3: String,
    division: String,
    columns: u32,
    /// Meaning of the columns, for readers without this program's documentation.
    order: &'static str,
    up: &'static str,
    north_degrees: f64,
    east: [f64; 3],
    north: [f64; 3],
    resolution: u32,
    tolerance: Option<f64>,
    patches: u64,
    points: u64,
    suns: u64,
    /// Suns below the horizon, by their place in the file from 0: nothing is lit by them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    suns_below_horizon: Vec<u64>,
    /// Points elsewhere than in the open.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    points_not_in_the_open: Vec<Misplaced>,
    /// The matrix's tolerance, where these rows are of its hemicubes and have none.
    #[serde(skip_serializing_if = "Option::is_none")]
    tolerance_of_matrix: Option<f64>,
    /// Rows with exactly the matrix's escaped weight; only beside a matrix.
    #[serde(skip_serializing_if = "Option::is_none")]
    rows_as_in_matrix: Option<u64>,
    sky_view_factor: Spread,
    ground: f64,
    /// Refined rows still changing by more than the tolerance at the last level.
    unsettled: u64,
    hemicubes: u64,
    /// Mirrors and panes that the sky and the suns are seen through.
    #[serde(skip_serializing_if = "Option::is_none")]
    specular: Option<SpecularRecord>,
}

/// A point elsewhere than in the open.
#[derive(Clone, Debug, Serialize)]
struct Misplaced {
    /// From 0.
    point: u64,
    #[serde(skip)]
    line: u64,
    place: Place,
}

#[derive(Serialize)]
struct Report<'a> {
    schema: u32,
    version: &'static str,
    inputs: Vec<Input>,
    #[serde(skip_serializing_if = "Option::is_none")]
    output: Option<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    tables: Vec<String>,
    #[serde(flatten)]
    record: &'a Record,
    #[serde(skip_serializing_if = "Option::is_none")]
    seconds: Option<f64>,
}

/// Items of a file, one a line, and their lines.
#[derive(Debug)]
struct Listed<T> {
    items: Vec<T>,
    lines: Vec<u64>,
}

impl<T> Default for Listed<T> {
    fn default() -> Self {
        Self {
            items: Vec::new(),
            lines: Vec::new(),
        }
    }
}

fn read_points(path: &Path) -> Result<Listed<SensorPoint>> {
    let mut found = Listed::default();
    for row in table::read(path, ["x", "y", "z", "nx", "ny", "nz"]).map_err(|error| {
        hinted(
            error,
            "a point needs the direction that it looks in, its normal `nx ny nz`: `0 0 1` looks up where z is up",
        )
    })? {
        let (position, normal) = row.looking(path)?;
        found.items.push(SensorPoint { position, normal });
        found.lines.push(row.line);
    }
    Ok(found)
}

/// Reads directions towards suns. The second value is true where they are along east, north and up, as of angles, and
/// false where they are along the scene's axes.
fn read_suns(path: &Path, talk: Talk) -> Result<(Listed<DVec3>, bool)> {
    let mut found = Listed::default();
    if let Some(unread) = suns::require_columns(&table::names(path)?, path)? {
        talk.warn(&unread);
    }
    if table::names_column(path, "azimuth")? {
        let [altitude, elevation] = ALTITUDE;
        let is_elevation = !table::names_column(path, altitude)? && table::names_column(path, elevation)?;
        for row in table::read(path, ["azimuth", if is_elevation { elevation } else { altitude }])? {
            let [azimuth, altitude] = row.values;
            let sun = direction_of(azimuth, altitude);
            found
                .items
                .push(sun.map_err(|error| anyhow!("{}:{}: {error}", path.display(), row.line))?);
            found.lines.push(row.line);
        }
        return Ok((found, true));
    }
    for row in table::read(path, ["x", "y", "z"])? {
        let sun = DVec3::from_array(row.values)
            .try_normalize()
            .ok_or_else(|| anyhow!("{}:{}: a direction without length", path.display(), row.line))?;
        found.items.push(sun);
        found.lines.push(row.line);
    }
    Ok((found, false))
}

/// Warns of suns below the horizon.
fn tell_of_suns(arguments: &Arguments, suns: &Listed<DVec3>, horizon: Horizon, talk: Talk) {
    let below: Vec<u64> = suns
        .items
        .iter()
        .zip(&suns.lines)
        .filter(|(sun, _)| horizon.is_below(**sun))
        .map(|(_, &line)| line)
        .collect();
    let (Some(path), false) = (&arguments.suns, below.is_empty()) else {
        return;
    };
    talk.warn(&format!(
        "{} of {} in `{}` {} below the horizon and {} nothing: {}; directions are towards the sun, `--up` says where \
         up is, and by `--horizon none` nothing is hidden",
        count(below.len() as u64),
        counted(suns.items.len() as u64, "sun"),
        path.display(),
        if below.len() == 1 { "is" } else { "are" },
        if below.len() == 1 { "lights" } else { "light" },
        lines(&below)
    ));
}

/// Warns of points that are not in the open, by place.
fn tell_of_points(arguments: &Arguments, points: usize, misplaced: &[Misplaced], talk: Talk) {
    if let Some(path) = &arguments.points {
        let places = misplaced.iter().map(|at| (at.place, at.line));
        report::tell_of_places(path, points, places, talk);
    }
}

/// The matrix's hemicubes: how many of each patch, n with n² of them, the escaped weight, the weight on backs, and the
/// refined shares of both.
struct OfMatrix {
    hemicubes: Vec<u32>,
    /// By element: n of n² hemicubes.
    samples: Vec<u32>,
    blocked: Vec<u64>,
    escaped: Vec<Option<u64>>,
    shares: Vec<Option<f64>>,
    blocked_shares: Vec<Option<f64>>,
    tolerance: Option<f64>,
}

fn of_matrix(store: &Store, prepared: &Prepared) -> Result<OfMatrix> {
    let count = store.patch_count() as usize;
    let mut found = OfMatrix {
        hemicubes: vec![0; count],
        samples: vec![1; count],
        blocked: vec![0; count],
        escaped: vec![None; count],
        shares: vec![None; count],
        blocked_shares: vec![None; count],
        tolerance: store.manifest().settings["tolerance"].as_f64(),
    };
    for place in 0..store.manifest().parts.len() {
        let Some(part) = store.part(place)? else { continue };
        let rows = part.rows.iter().zip(&part.sums).zip(&part.hemicubes).zip(&part.shares);
        for (((&patch, sums), &hemicubes), shares) in rows {
            found.hemicubes[patch as usize] = hemicubes;
            found.samples[patch as usize] = hemicubes.isqrt().max(1);
            found.blocked[patch as usize] = sums.blocked;
            found.escaped[patch as usize] = (hemicubes > 0).then_some(sums.escaped);
            found.shares[patch as usize] = (hemicubes > 0).then_some(shares.escaped);
            found.blocked_shares[patch as usize] = (hemicubes > 0).then_some(shares.blocked);
            if prepared.grouping.is_some() {
                // Sums of weights are of elements alike; rows are of elements by their areas.
                let whole = f64::from(hemicubes) * f64::from(WHOLE);
                found.blocked[patch as usize] = whole::to_u64(shares.blocked * whole);
            }
        }
    }
    // Rows of patches keep no hemicubes of each element, but those follow from the scene.
    if prepared.grouping.is_some() {
        let settings = &store.manifest().settings;
        let samples = settings["samples"].as_u64().map_or(1, |samples| samples.isqrt());
        let least = u32::try_from(samples).unwrap_or(1).max(1);
        let is_pixel = settings["correction"] == "pixel";
        let of = |element| {
            if is_pixel {
                least
            } else {
                hemicubes_along(&prepared.model, element, least)
            }
        };
        found.samples = prepared.patches.iter().map(of).collect();
    }
    Ok(found)
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    arguments.patches.require_one_cut()?;
    let json = JsonReport::asked(&arguments.report);
    let points = read_if_any(arguments.points.as_deref(), read_points)?;
    let (mut suns, is_of_angles) = arguments
        .suns
        .as_deref()
        .map(|path| read_suns(path, talk))
        .transpose()?
        .unwrap_or_default();
    let store = open_store(arguments)?;
    let output = match &store {
        Some(store) => Some(store.directory().join("sky")),
        None => arguments.folders().next().cloned(),
    };
    require_places(arguments, output.as_deref(), is_of_angles)?;
    let cancel = exit::watch_interrupts().context("Ctrl-C cannot be watched")?;
    let started = Instant::now();
    let mut prepared = prepare_scene(arguments, store.as_ref())?;
    enclosure::note_doubles(&mut prepared, arguments.engine.thread_count());
    enclosure::warn_of_winding(&prepared, arguments.engine.thread_count(), talk);
    let images = match &store {
        Some(store) => stored::portals(store, &mut prepared, arguments.engine.hierarchy())?.images,
        None => None,
    };
    prepared.tell(talk);
    let up = match arguments.horizon {
        // Up only turns the patches of the sky, which nobody reads.
        HorizonName::None if !is_of_angles && output.is_none() => prepared.up_or_guess(arguments.patches.up, talk),
        _ => {
            prepared.tell_up(arguments.patches.up, talk);
            prepared.up(arguments.patches.up)?
        }
    };
    let horizon = match arguments.horizon {
        HorizonName::Ground => Horizon::new(up, arguments.north),
        HorizonName::None => Horizon::new(up, arguments.north).without_ground(),
    };
    if is_of_angles {
        for sun in &mut suns.items {
            *sun = horizon.direction(sun.to_array());
        }
    }
    tell_of_suns(arguments, &suns, horizon, talk);
    let misplaced = misplaced(&prepared, &points, horizon);
    tell_of_points(arguments, points.items.len(), &misplaced, talk);
    let specular = specular(arguments, &prepared, store.as_ref())?;
    let portals = Portals { images, specular };
    if !suns.items.is_empty() {
        portals::tell_of_reflections(&portals, &prepared, talk);
    }
    let Portals { images, specular } = portals;
    require_memory(arguments, &prepared, points.items.len(), suns.items.len())?;
    let matrix = store.as_ref().map(|store| of_matrix(store, &prepared)).transpose()?;
    let task = Task {
        arguments,
        prepared: &prepared,
        division: SkyDivision::new(arguments.division.0).context("the sky cannot be divided like that")?,
        horizon,
        options: options(arguments, store.as_ref()),
        points: points.items,
        suns: suns.items,
        matrix,
        specular,
        images,
    };
    // Files of two runs side by side would claim to belong together.
    let _lock = output.as_deref().map(taken).transpose()?;
    let backend = arguments.engine.open_backend(talk)?;
    require_items(backend.as_ref())?;
    let guard = exit::InterruptGuard::new();
    let Some(of_patches) = task.of_patches(backend, cancel, talk)? else {
        return Ok(Exit::Interrupted);
    };
    let Some(of_points) = task.of_points(cancel)? else {
        return Ok(Exit::Interrupted);
    };
    let record = task.record(axis_name(up), &of_patches, &of_points, misplaced.clone());
    let lit = task.lit()?;
    if let Some(output) = &output {
        task.keep(output, &of_patches, &of_points, lit.as_deref(), &record)?;
    }
    for path in arguments.tables() {
        match arguments.by {
            Some(by) => task.write_suns(path, by, lit.as_deref().unwrap_or_default())?,
            None => task.write_table(path, &of_patches, cancel)?,
        }
    }
    drop(guard);
    let seconds = started.elapsed().as_secs_f64();
    let written: Vec<&Path> = output.iter().chain(arguments.tables()).map(PathBuf::as_path).collect();
    if !arguments.report.json {
        let suns = task.sunlit_text(lit.as_deref().unwrap_or_default());
        report::print(&(summary(&record, &of_points, &misplaced) + &suns))?;
    }
    if written.is_empty() {
        talk.say("values by patch: `-o sky.csv` writes a line each");
    }
    talk.detail(work(&record, seconds).trim_end());
    for path in written {
        talk.say(&format!("written: `{}`", path.display()));
    }
    if let (true, Some(tolerance)) = (record.unsettled > 0, record.tolerance) {
        talk.warn(&report::unsettled(record.unsettled, tolerance));
    }
    let exit = if record.unsettled == 0 {
        Exit::Done
    } else {
        Exit::NotHeld
    };
    if let Some(json) = json {
        json.write(&Report {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION"),
            inputs: vec![prepared.input],
            output: output.map(|output| output.display().to_string()),
            tables: arguments.tables().map(|path| path.display().to_string()).collect(),
            record: &record,
            seconds: talk.verbose.then_some(seconds),
        })?;
    }
    Ok(exit)
}

/// Refuses outputs that would leave out what was asked for.
fn require_places(arguments: &Arguments, output: Option<&Path>, is_of_angles: bool) -> Result<()> {
    let folders: Vec<&PathBuf> = arguments.folders().collect();
    if let (Some(_), [folder, ..]) = (&arguments.matrix, &folders[..]) {
        return Err(hinted(
            anyhow!(
                "`-o {}` is a second directory: with `--matrix` the rows are written beside the matrix",
                folder.display()
            ),
            "leave it out, or name a .csv",
        ));
    }
    if folders.len() > 1 {
        bail!("`-o` names {} directories, and one is written", folders.len());
    }
    let asked = [
        ("--points", arguments.points.is_some()),
        ("--suns", arguments.suns.is_some() && arguments.by.is_none()),
        ("--division", arguments.division != Division(1)),
        ("--north", arguments.north != 0.0 && !is_of_angles),
    ];
    for (option, is_asked) in asked {
        if is_asked && output.is_none() {
            let of_suns = match option {
                "--suns" => "; `--by object` has tables of suns by surface",
                _ => "",
            };
            return Err(hinted(
                anyhow!("what `{option}` asks for is not in a table of patches"),
                format!("name a directory for it by `-o DIR`, or a matrix by `--matrix DIR`{of_suns}"),
            ));
        }
    }
    if arguments.by.is_some() && arguments.tables().next().is_none() {
        return Err(hinted(
            anyhow!("`--by` asks for a table of suns, and no .csv is named"),
            "name one by `-o FILE.csv`",
        ));
    }
    Ok(())
}

/// Makes a directory and takes it.
fn taken(output: &Path) -> Result<FolderLock> {
    std::fs::create_dir_all(output).with_context(|| format!("`{}` cannot be created", output.display()))?;
    Ok(FolderLock::take(output)?)
}

fn read_if_any<T: Default>(path: Option<&Path>, read: impl Fn(&Path) -> Result<T>) -> Result<T> {
    Ok(path.map(read).transpose()?.unwrap_or_default())
}

fn open_store(arguments: &Arguments) -> Result<Option<Store>> {
    let Some(path) = &arguments.matrix else { return Ok(None) };
    report::require_matrix(path)?;
    let store = Store::open(path)?;
    Ok(Some(store))
}

/// The mirrors and panes that the sky is seen through: those asked for, otherwise the matrix's.
fn specular(arguments: &Arguments, prepared: &Prepared, store: Option<&Store>) -> Result<Option<Specular>> {
    let of_matrix = match store {
        Some(store) => stored::specular(store, prepared)?,
        None => None,
    };
    let Some(path) = &arguments.specular else {
        return Ok(of_matrix);
    };
    let bound = of_matrix.as_ref().map_or(BOUND, |specular| specular.bound);
    let found = crate::portals::of_one_band(path, prepared, bound)?;
    match store {
        Some(store) if of_matrix.as_ref() != Some(&found) => bail!(
            "the mirrors and panes of `{}` are not those of `{}`: leave `--specular` out, and they are the matrix's",
            path.display(),
            store.directory().display()
        ),
        _ => Ok(Some(found)),
    }
}

/// Reads the scene, with the subdivision of the matrix if there is one.
fn prepare_scene(arguments: &Arguments, store: Option<&Store>) -> Result<Prepared> {
    match store {
        Some(store) => stored::scene(store, &arguments.scene, &arguments.engine, (&arguments.patches).into()),
        None => prepare(&arguments.scene, &arguments.patches, &arguments.engine, Work::Fractions),
    }
}

/// Points that are not in the open.
fn misplaced(prepared: &Prepared, points: &Listed<SensorPoint>, horizon: Horizon) -> Vec<Misplaced> {
    (0..)
        .zip(places(&prepared.model, &points.items, horizon.up))
        .zip(&points.lines)
        .filter(|((_, place), _)| *place != Place::Open)
        .map(|((point, place), &line)| Misplaced { point, line, place })
        .collect()
}

/// Settings of the hemicubes: given, otherwise the matrix's.
fn options(arguments: &Arguments, store: Option<&Store>) -> SkyOptions {
    let settings = store.map(|store| &store.manifest().settings);
    let resolution = settings
        .and_then(|s| s["resolution"].as_u64())
        .and_then(|n| u32::try_from(n).ok());
    SkyOptions {
        render: RenderSettings {
            resolution: arguments.resolution.or(resolution).unwrap_or(RESOLUTION),
            culling: Culling::On,
            covered: false,
        },
        samples_per_edge: arguments.samples.unwrap_or(1),
        tolerance: arguments.tolerance,
        rotate: settings.and_then(|s| s["rotation"].as_bool()).unwrap_or(true),
        threads: arguments.engine.thread_count(),
    }
}

/// A run: the scene with its sky, suns and points.
struct Task<'a> {
    arguments: &'a Arguments,
    prepared: &'a Prepared,
    division: SkyDivision,
    horizon: Horizon,
    options: SkyOptions,
    points: Vec<SensorPoint>,
    suns: Vec<DVec3>,
    matrix: Option<OfMatrix>,
    specular: Option<Specular>,
    /// The matrix's: the model has them, too.
    images: Option<Images>,
}

impl Task<'_> {
    /// Computes the rows of all patches, with the matrix's refined escaped shares; `None` where interrupted.
    fn of_patches(
        &self,
        backend: Box<dyn HemicubeBackend>,
        cancel: &AtomicBool,
        talk: Talk,
    ) -> Result<Option<Vec<SkyRow>>> {
        let grouping = self.prepared.grouping.as_ref();
        let patch_of = |element| grouping.map_or(element, |grouping| grouping.patch_of(element));
        let closed = self
            .prepared
            .patches
            .iter()
            .map(|element| self.closed(patch_of(element)));
        let closed: Vec<Option<SkyRow>> = closed.collect();
        let open = self
            .prepared
            .patches
            .iter()
            .filter(|patch| closed[patch.0 as usize].is_none());
        let rows: Vec<(InputPatch, u32)> = open
            .map(|patch| {
                let of_matrix = self
                    .matrix
                    .as_ref()
                    .map_or(1, |matrix| matrix.samples[patch.0 as usize]);
                (patch, self.arguments.samples.unwrap_or(of_matrix))
            })
            .collect();
        let bar = Bar::rows(talk, rows.len() as u64, 0);
        let mut go_on = |done: usize| {
            bar.at(done as u64);
            !cancel.load(Ordering::SeqCst)
        };
        let Some(found) = self.rendered(&rows, backend, &mut go_on)? else {
            return Ok(None);
        };
        let mut found = found.into_iter();
        let rows = closed.into_iter().map(|row| row.or_else(|| found.next()));
        let mut found: Vec<SkyRow> = rows.collect::<Option<_>>().context("a row of the sky is missing")?;
        if let Some(grouping) = &self.prepared.grouping {
            found = sky_of_groups(&found, grouping, &self.areas());
            for (patch, row) in (0..).zip(&mut found) {
                if let Some(closed) = self.closed(InputPatch(patch)) {
                    *row = closed;
                }
            }
        }
        if let Some(matrix) = &self.matrix {
            if grouping.is_none() && !self.find_lost(matrix, &mut found, cancel)? {
                return Ok(None);
            }
            for (row, share) in found.iter_mut().zip(&matrix.shares) {
                share.map(|share| row.refine(share));
            }
        }
        Ok(Some(found))
    }

    /// Renders rows with n of n² hemicubes each; `None` where interrupted.
    fn rendered(
        &self,
        rows: &[(InputPatch, u32)],
        backend: Box<dyn HemicubeBackend>,
        go_on: &mut dyn FnMut(usize) -> bool,
    ) -> Result<Option<Vec<SkyRow>>> {
        let model = &self.prepared.model;
        Ok(match self.glazed() {
            Some(glazed) => sky_through_portals(model, rows, glazed, self.options, backend, go_on)?,
            None => sky_of_patches(model, rows, &self.division, self.horizon, self.options, backend, go_on)?,
        })
    }

    /// Renders rows anew, from more points of the patch, that escape by the matrix and met no sky: 4, 16 and 64 times
    /// the hemicubes. Where none of these meets the sky, what escapes is in no column. Returns `false` where
    /// interrupted.
    fn find_lost(&self, matrix: &OfMatrix, found: &mut [SkyRow], cancel: &AtomicBool) -> Result<bool> {
        for finer in [2, 4, 8] {
            let is_lost = |row: &SkyRow, share: Option<f64>| row.escaped == 0 && share.is_some_and(|s| s > LOST_LEAST);
            let rows: Vec<(InputPatch, u32)> = (0..)
                .zip(found.iter().zip(&matrix.shares).zip(&matrix.samples))
                .filter(|(_, ((row, share), _))| is_lost(row, **share))
                .map(|(patch, (_, &samples))| (InputPatch(patch), finer * samples))
                .collect();
            if rows.is_empty() {
                break;
            }
            let backend = self.arguments.engine.open_backend(Talk::SILENT)?;
            let Some(again) = self.rendered(&rows, backend, &mut |_| !cancel.load(Ordering::SeqCst))? else {
                return Ok(false);
            };
            for ((patch, _), row) in rows.into_iter().zip(again) {
                found[patch.0 as usize] = row;
            }
        }
        Ok(true)
    }

    /// The sky with the mirrors and panes that it is seen through.
    fn glazed(&self) -> Option<Glazed<'_>> {
        self.specular.as_ref().map(|specular| Glazed {
            division: &self.division,
            horizon: self.horizon,
            specular,
            images: self.images.as_ref(),
        })
    }

    /// Areas of the elements.
    fn areas(&self) -> Vec<f64> {
        let patches = &self.prepared.patches;
        patches.iter().map(|element| patches.area(element)).collect()
    }

    /// Returns whether the rows are of the matrix's hemicubes: neither a tolerance nor other hemicubes were asked for.
    fn is_of_matrix(&self) -> bool {
        self.options.tolerance.is_none() && self.arguments.resolution.is_none() && self.arguments.samples.is_none()
    }

    /// The row of a patch without any escaped weight in the matrix's hemicubes, if its row is to be of these.
    fn closed(&self, patch: InputPatch) -> Option<SkyRow> {
        let matrix = self.matrix.as_ref()?;
        let patch = patch.0 as usize;
        (self.is_of_matrix() && matrix.escaped[patch] == Some(0)).then(|| SkyRow {
            blocked: matrix.blocked[patch],
            hemicubes: matrix.hemicubes[patch],
            change: f64::NAN,
            change_below: f64::NAN,
            ..SkyRow::default()
        })
    }

    /// Computes the rows of all points; `None` where interrupted.
    fn of_points(&self, cancel: &AtomicBool) -> Result<Option<Vec<PointRow>>> {
        if self.points.is_empty() {
            return Ok(Some(Vec::new()));
        }
        let sessions = (0..LEVELS)
            .map(|_| self.arguments.engine.open_backend(Talk::SILENT))
            .collect::<Result<_>>()?;
        let found = rows_of_points(
            &self.prepared.model,
            &self.points,
            &self.division,
            self.horizon,
            self.options,
            sessions,
            &mut |_| !cancel.load(Ordering::SeqCst),
        )?;
        let fold = |row: PointRow| match &self.images {
            Some(images) => folded(row, images),
            None => row,
        };
        Ok(found.map(|rows| rows.into_iter().map(fold).collect()))
    }

    /// Error of the share of a patch that a sun lights.
    fn sun_error(&self) -> f64 {
        self.options.tolerance.unwrap_or(SUN_ERROR)
    }

    /// The share of each element lit by each sun; none without suns.
    fn lit(&self) -> Result<Option<Vec<f32>>> {
        if self.suns.is_empty() {
            return Ok(None);
        }
        let patches: Vec<InputPatch> = self.prepared.patches.iter().collect();
        let (model, threads) = (&self.prepared.model, self.options.threads);
        let lit = sunlit(model, &patches, &self.suns, self.horizon, self.sun_error(), threads)?;
        Ok(Some(lit))
    }

    /// Writes a line a sun and surface: its area, what of it faces the sun as seen from there, and what is lit.
    fn write_suns(&self, path: &Path, by: By, lit: &[f32]) -> Result<()> {
        let patches = &self.prepared.patches;
        let (names, of_patch) = surfaces_of(self.prepared, by);
        let suns = self.suns.len();
        // Of each surface and sun.
        let mut areas = vec![0.0; names.len()];
        let mut found = vec![Projected::default(); names.len() * suns];
        for (at, patch) in patches.iter().enumerate() {
            let (normal, area, surface) = (patches.normal(patch), patches.area(patch), of_patch[at]);
            areas[surface] += area;
            for (sun, direction) in self.suns.iter().enumerate() {
                let cosine = normal.dot(direction.normalize_or_zero()).max(0.0);
                let share = f64::from(lit[at * suns + sun]);
                let hidden = if self.horizon.is_below(*direction) { 0.0 } else { 1.0 };
                let of = &mut found[surface * suns + sun];
                of.projected += area * cosine * hidden;
                of.sunlit += area * cosine * share;
                of.on_surface += area * share;
            }
        }
        let cannot = || format!("`{}` cannot be written", path.display());
        let mut file = PendingFile::create(path)?;
        let mut out = std::io::BufWriter::new(&mut file);
        let head = "area,projected_area,sunlit_projected_area,sunlit_area";
        writeln!(out, "sun,x,y,z,{},{head}", by.name()).with_context(cannot)?;
        for (sun, direction) in self.suns.iter().enumerate() {
            let [x, y, z] = direction.to_array();
            for (surface, name) in names.iter().enumerate() {
                let Projected {
                    projected,
                    sunlit,
                    on_surface,
                } = found[surface * suns + sun];
                writeln!(
                    out,
                    "{sun},{x},{y},{z},{},{},{projected},{sunlit},{on_surface}",
                    table::field(name),
                    areas[surface]
                )
                .with_context(cannot)?;
            }
        }
        out.flush().with_context(cannot)?;
        drop(out);
        file.commit()
    }

    /// The part of the area that each sun reaches, for the first of them.
    fn sunlit_text(&self, lit: &[f32]) -> String {
        let patches = &self.prepared.patches;
        let suns = self.suns.len();
        let mut list = Listing::default();
        for sun in 0..suns.min(SUNS_SHOWN) {
            let (mut reached, mut whole) = (0.0, 0.0);
            for (at, patch) in patches.iter().enumerate() {
                let area = patches.area(patch);
                reached += area * f64::from(lit[at * suns + sun]);
                whole += area;
            }
            list.add(
                &format!("sun {sun}"),
                format!("reaches {} of the area", percent(reached / whole)),
            );
        }
        if suns > SUNS_SHOWN {
            list.add("suns", format!("{} more", count((suns - SUNS_SHOWN) as u64)));
        }
        list.text()
    }

    /// Writes the directory's files.
    fn keep(
        &self,
        output: &Path,
        of_patches: &[SkyRow],
        of_points: &[PointRow],
        lit: Option<&[f32]>,
        record: &Record,
    ) -> Result<()> {
        if let (Some(glazed), false) = (self.glazed(), self.suns.is_empty()) {
            let patches: Vec<InputPatch> = self.prepared.patches.iter().collect();
            let (model, threads) = (&self.prepared.model, self.options.threads);
            let light = sunlight(model, &patches, &self.suns, glazed, self.sun_error(), threads);
            write_sunlight(&output.join("sunlight.npy"), [patches.len(), self.suns.len()], &light)?;
        }
        let lit = lit.map(|lit| match &self.prepared.grouping {
            Some(grouping) => lit_patches(lit, self.suns.len(), grouping, &self.areas()),
            None => lit.to_vec(),
        });
        write_sky(
            &output.join("sky.npz"),
            self.division.columns(),
            of_patches,
            lit.as_deref().map(|lit| (self.suns.len(), lit)),
        )?;
        if !of_points.is_empty() {
            self.keep_points(output, of_points)?;
        }
        write_record(output, record)
    }

    /// Writes a line a patch.
    fn write_table(&self, path: &Path, rows: &[SkyRow], cancel: &AtomicBool) -> Result<()> {
        let (scene, patches) = (&self.prepared.scene, &self.prepared.patches);
        let table = PatchTable::of(scene, patches, self.prepared.grouping.as_ref());
        let name = self.arguments.scene.file_name().unwrap_or_default().to_string_lossy();
        let materials: Vec<String> = scene.materials.iter().map(|material| material.name.clone()).collect();
        let mut results = PatchResults::of_table(table, [&scene.objects, &materials], &name);
        let of = |share: &dyn Fn(&SkyRow) -> f64| rows.iter().map(share).collect();
        results.push("sky_view_factor", of(&SkyRow::sky_view_factor))?;
        results.push(
            "ground",
            of(&|row| (row.escaped_share() - row.sky_view_factor()).max(0.0)),
        )?;
        // Beside a matrix all shares are its own.
        let of_matrix = |patch: usize| self.matrix.as_ref().and_then(|matrix| matrix.blocked_shares[patch]);
        let blocked = (0..)
            .zip(rows)
            .map(|(patch, row)| of_matrix(patch).unwrap_or_else(|| row.blocked as f64 / row.whole() as f64));
        results.push("blocked", blocked.collect())?;
        let options = WriteOptions {
            overwrite: self.arguments.overwrite,
            cancel,
        };
        write_patches(&results, path, PatchFormat::Csv, options)?;
        Ok(())
    }

    /// Writes the rows of points, and the suns lighting each.
    fn keep_points(&self, output: &Path, found: &[PointRow]) -> Result<()> {
        let lit = if self.suns.is_empty() {
            None
        } else {
            let reference = Reference::new(&self.prepared.model, ReferenceSettings::default())?;
            let mut lit = Vec::new();
            for point in &self.points {
                for &sun in &self.suns {
                    let open =
                        !self.horizon.is_below(sun) && reference.is_open(None, point.position, point.normal, sun)?;
                    lit.push(if open { 1.0f32 } else { 0.0 });
                }
            }
            Some(lit)
        };
        let sky: Vec<SkyRow> = found.iter().map(|row| row.sky.clone()).collect();
        write_sky(
            &output.join("points-sky.npz"),
            self.division.columns(),
            &sky,
            lit.as_deref().map(|lit| (self.suns.len(), lit)),
        )?;
        let path = output.join("points.npz");
        let count = |len: usize| u32::try_from(len).context("too many patches");
        match &self.prepared.grouping {
            Some(grouping) => Ok(write_points(
                &path,
                count(grouping.len())?,
                &of_patches(found, grouping),
            )?),
            None => Ok(write_points(&path, count(self.prepared.patches.len())?, found)?),
        }
    }

    /// The record of the run: settings, and averages by area over the patches.
    fn record(&self, up: &'static str, rows: &[SkyRow], points: &[PointRow], misplaced: Vec<Misplaced>) -> Record {
        let views = self.views(rows);
        let unsettled = self.options.tolerance.map_or(0, |tolerance| {
            let all = rows.iter().chain(points.iter().map(|point| &point.sky));
            all.filter(|row| row.change >= 0.0 && !row.is_settled(tolerance))
                .count() as u64
        });
        Record {
            program: env!("CARGO_PKG_VERSION"),
            scene: self
                .arguments
                .scene
                .file_name()
                .map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            scene_blake3: scene_hash(&self.prepared.scene, &self.prepared.patches),
            division: if self.division.parts() == 1 {
                "tregenza".to_owned()
            } else {
                format!("reinhart:{}", self.division.parts())
            },
            columns: self.division.columns(),
            order: "column 0 is the ground; then ring by ring upwards, each from north clockwise, the first patch's \
                    middle due north",
            up,
            north_degrees: self.arguments.north,
            east: self.horizon.east.to_array(),
            north: self.horizon.north.to_array(),
            resolution: self.options.render.resolution,
            tolerance: self.options.tolerance,
            patches: rows.len() as u64,
            points: points.len() as u64,
            suns: self.suns.len() as u64,
            suns_below_horizon: (0..)
                .zip(&self.suns)
                .filter(|(_, sun)| self.horizon.is_below(**sun))
                .map(|(at, _)| at)
                .collect(),
            points_not_in_the_open: misplaced,
            tolerance_of_matrix: self
                .matrix
                .as_ref()
                .filter(|_| self.is_of_matrix())
                .and_then(|matrix| matrix.tolerance),
            // Weights of several triangles are means by area, and the matrix's are sums.
            rows_as_in_matrix: self
                .matrix
                .as_ref()
                .filter(|_| self.prepared.grouping.is_none())
                .map(|matrix| {
                    let same = rows
                        .iter()
                        .zip(&matrix.escaped)
                        .filter(|(row, escaped)| Some(row.escaped) == **escaped);
                    same.count() as u64
                }),
            sky_view_factor: views.sky,
            ground: views.ground,
            unsettled,
            hemicubes: rows.iter().map(|row| u64::from(row.hemicubes)).sum(),
            specular: self.specular.as_ref().map(Specular::record),
        }
    }

    /// Averages of the patches by their areas.
    fn views(&self, rows: &[SkyRow]) -> Views {
        let (mut area, mut sky, mut ground) = (0.0, 0.0, 0.0);
        let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
        let areas = match &self.prepared.grouping {
            Some(grouping) => {
                let table = PatchTable::grouped(&self.prepared.scene, &self.prepared.patches, grouping);
                table.area
            }
            None => self.areas(),
        };
        for (own, row) in areas.into_iter().zip(rows) {
            let factor = row.sky_view_factor();
            if factor.is_nan() {
                continue;
            }
            area += own;
            sky += own * factor;
            // Of refined rows the difference of equal shares is rounding, of either sign.
            ground += own * (row.escaped_share() - factor).max(0.0);
            min = min.min(factor);
            max = max.max(factor);
        }
        let whole = if area > 0.0 { area } else { 1.0 };
        Views {
            sky: if area > 0.0 {
                Spread {
                    min,
                    mean: sky / whole,
                    max,
                }
            } else {
                Spread::default()
            },
            ground: ground / whole,
        }
    }
}

/// Views of the patches.
struct Views {
    sky: Spread,
    /// The share of the ground below the horizon, averaged by area.
    ground: f64,
}

/// Rows of points over patches, from those over elements: weights add up.
fn of_patches(rows: &[PointRow], grouping: &Grouping) -> Vec<PointRow> {
    let of_row = |row: &PointRow| {
        let mut weights = std::collections::BTreeMap::new();
        for &(element, weight) in &row.patches {
            *weights.entry(grouping.patch_of(element)).or_insert(0) += weight;
        }
        PointRow {
            patches: weights.into_iter().collect(),
            sky: row.sky.clone(),
        }
    };
    rows.iter().map(of_row).collect()
}

/// The share of each patch lit by each of `suns`, from those of its elements, by area.
fn lit_patches(lit: &[f32], suns: usize, grouping: &Grouping, areas: &[f64]) -> Vec<f32> {
    let mut found = vec![0.0f32; grouping.len() * suns];
    for sun in 0..suns {
        let of_sun: Vec<f64> = lit
            .iter()
            .skip(sun)
            .step_by(suns)
            .map(|&share| f64::from(share))
            .collect();
        for (patch, mean) in grouping.means(&of_sun, areas).into_iter().enumerate() {
            #[allow(clippy::cast_possible_truncation, reason = "shares are kept as f32")]
            let mean = mean as f32;
            found[patch * suns + sun] = mean;
        }
    }
    found
}

fn write_record(output: &Path, record: &Record) -> Result<()> {
    let mut file = PendingFile::create(&output.join("sky.json"))?;
    let mut text = serde_json::to_string_pretty(record).context("the report is no JSON")?;
    text.push('\n');
    file.write_all(text.as_bytes())
        .with_context(|| format!("`{}` cannot be written", output.display()))?;
    file.commit()
}

fn require_items(backend: &dyn HemicubeBackend) -> Result<()> {
    let info = backend.info();
    if info.capabilities.items {
        return Ok(());
    }
    Err(hinted(
        anyhow!(
            "backend `{}` hands out no item buffers, from which the sky is read",
            info.name
        ),
        "`--backend cpu` does",
    ))
}

/// Adds the patches of images into the cell's; what goes beyond the last of them is seen of no patch.
fn folded(row: PointRow, images: &Images) -> PointRow {
    let mut patches: BTreeMap<u32, u64> = BTreeMap::new();
    for (patch, weight) in row.patches {
        if let Some(patch) = images.fold(patch.0) {
            *patches.entry(patch).or_default() += weight;
        }
    }
    let patches = patches.into_iter().map(|(patch, weight)| (InputPatch(patch), weight));
    PointRow {
        patches: patches.collect(),
        sky: row.sky,
    }
}

/// Asks for the memory of all rows, before the first. A closed body's patches see half of the directions on average, and
/// so half of the columns; what a sun lights is a number of each patch, and another where portals pass it on.
fn require_memory(arguments: &Arguments, prepared: &Prepared, points: usize, suns: usize) -> Result<()> {
    let division = SkyDivision::new(arguments.division.0).context("the sky cannot be divided like that")?;
    let rows = (prepared.patches.len() + points) as u64;
    let columns = u64::from(division.columns()) / 2 * size_of::<(u32, u64)>() as u64;
    let lit = 2 * size_of::<f32>() as u64 * suns as u64;
    // A surface has a patch at least.
    let by_surface = arguments.by.map_or(0, |_| size_of::<Projected>() as u64 * suns as u64);
    let what = format!("keeping {} of the sky", counted(rows, "row"));
    let next = "a coarser `--division`, and fewer suns at a time, take less";
    forecast::require(
        prepared.budget,
        rows.saturating_mul(columns + lit + by_surface),
        &what,
        next,
    )
}

/// What of a surface faces a sun, and what of that it lights: as seen from the sun, and on the surface.
#[derive(Clone, Copy, Debug, Default)]
struct Projected {
    projected: f64,
    sunlit: f64,
    on_surface: f64,
}

/// Names of surfaces, in the order of their first elements, and the surface of each element.
fn surfaces_of(prepared: &Prepared, by: By) -> (Vec<String>, Vec<usize>) {
    let scene = &prepared.scene;
    let table = PatchTable::of(scene, &prepared.patches, None);
    let name = |index: u32| match by {
        By::Object => scene.objects.get(index as usize).cloned().unwrap_or_default(),
        By::Material => {
            let material = scene.materials.get(index as usize);
            material.map_or_else(String::new, |material| material.name.clone())
        }
        By::Face => index.to_string(),
    };
    let indices = match by {
        By::Object => &table.object,
        By::Material => &table.material,
        By::Face => &table.face,
    };
    let mut places = HashMap::new();
    let mut names = Vec::new();
    let mut of_patch = Vec::with_capacity(indices.len());
    for &index in indices {
        let name = name(index);
        of_patch.push(*places.entry(name.clone()).or_insert_with(|| {
            names.push(name);
            names.len() - 1
        }));
    }
    (names, of_patch)
}

/// What was found.
fn summary(record: &Record, points: &[PointRow], misplaced: &[Misplaced]) -> String {
    let mut list = Listing::default();
    let factor = record.sky_view_factor;
    list.add(
        "sky view factor",
        format!(
            "{:.4} on average over the area of {}, from {:.4} to {:.4}",
            factor.mean,
            counted(record.patches, "patch"),
            factor.min,
            factor.max,
        ),
    );
    list.add(
        "ground below the horizon",
        format!("{} on average", percent(record.ground)),
    );
    list.add(
        "sky",
        format!(
            "{}, {} up: the ground and {} patches of the sky",
            record.division,
            record.up,
            count(u64::from(record.columns) - 1),
        ),
    );
    list.add(
        "error",
        match (record.tolerance, record.tolerance_of_matrix) {
            (Some(tolerance), _) => match record.unsettled {
                0 => format!(
                    "rows changed by {} at most at the last refinement",
                    asked_for(tolerance)
                ),
                rows => format!(
                    "{} still changed by more than {}",
                    counted(rows, "row"),
                    asked_for(tolerance)
                ),
            },
            (None, Some(tolerance)) => format!(
                "may be above the matrix's tolerance; `--tolerance {}` refines to it",
                percentage(tolerance)
            ),
            (None, None) => "not known; `--tolerance 1%` refines".to_owned(),
        },
    );
    if let Some(same) = record.rows_as_in_matrix {
        list.add(
            "matrix",
            format!(
                "escaped energy agrees with the matrix in {} of {}{}",
                count(same),
                counted(record.patches, "row"),
                match record.tolerance {
                    _ if same == record.patches => "",
                    Some(_) => "; the others are refined here, by other hemicubes than the matrix's",
                    None => "; the others are rows of other hemicubes than the matrix's",
                }
            ),
        );
    }
    for (index, point) in points.iter().enumerate().take(5) {
        list.add(
            &format!("point {index}"),
            format!(
                "sky {:.4}, {} in sight with {}{}",
                point.sky.sky_view_factor(),
                counted(point.patches.len() as u64, "patch"),
                percent(
                    point.patches.iter().map(|(_, weight)| weight).sum::<u64>() as f64
                        / (f64::from(point.sky.hemicubes.max(1)) * f64::from(WHOLE))
                ),
                match misplaced.iter().find(|at| at.point == index as u64).map(|at| at.place) {
                    Some(Place::InSolid) => ": it is in a solid",
                    Some(Place::BelowGround) => ": it is below the ground",
                    Some(_) => ": it is behind a surface",
                    None => "",
                },
            ),
        );
    }
    if points.len() > 5 {
        list.add(
            "",
            format!(
                "{} more points are not shown; `-o DIR` has all",
                count((points.len() - 5) as u64)
            ),
        );
    }
    list.text()
}

/// The work, for `-v`.
fn work(record: &Record, seconds: f64) -> String {
    let mut list = Listing::default();
    list.add(
        "hemicubes",
        format!(
            "{}, {:.1} a patch, of {} pixels along an edge, in {}",
            count(record.hemicubes),
            record.hemicubes as f64 / record.patches.max(1) as f64,
            record.resolution,
            duration(seconds),
        ),
    );
    list.text()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn divisions() {
        assert_eq!("tregenza".parse(), Ok(Division(1)));
        assert_eq!("reinhart:4".parse(), Ok(Division(4)));
        for wrong in ["reinhart", "reinhart:0", "reinhart:17", "tregenza:2", ""] {
            assert!(wrong.parse::<Division>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn points_are_read_and_refused_by_line() {
        let path = std::env::temp_dir().join(format!("hemicube-points-{}", std::process::id()));
        std::fs::write(&path, "# here\n0 0 1  0 0 1\n\n1,2,3,0,-1,0 # there\n").expect("a file");
        let points = read_points(&path).expect("good points");
        assert_eq!((points.items[1].normal, points.lines[1]), (DVec3::NEG_Y, 4));
        std::fs::write(&path, "0 0 1 0 0 1\n0 0 1 0 0\n").expect("a file");
        assert!(
            read_points(&path)
                .expect_err("five numbers")
                .to_string()
                .contains(":2: ")
        );
        std::fs::write(&path, "0 0 1 0 0 0\n").expect("a file");
        assert!(read_points(&path).is_err());
        std::fs::remove_file(&path).expect("it was there");
    }
}
