//! `hemicube export`: the matrix, or results of its patches, in files for other programs.

mod patches;
mod solver;

use crate::args::{Report as ReportArguments, Talk, UpAxis};
use crate::exit::{self, Exit, hinted};
use crate::help::examples;
use crate::outputs::Paths;
use crate::progress::Bar;
use crate::report::{self, JsonReport, PendingFile, SCHEMA, count, counted, size};
use crate::stored;
use anyhow::{Context, Result, anyhow, bail};

use clap::{Args, ValueEnum};
use hemicube::analysis::zones::{GroupBy, Zone, ZoneFormat, write_zones, zones};
use hemicube::sky::{SkyDivision, StoredSky};
use hemicube::store::Store;
use hemicube_export::{
    ExportFormat, ExportOptions, ExportReport, Named, PatchFormat, WriteOptions, export, export_with_sky, listed,
};
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "  \
  hemicube export room.hemicube -o room.npz                      # SciPy: scipy.sparse.load_npz
  hemicube export room.hemicube -o room.mtx                      # MatrixMarket: MATLAB, Octave, Julia
  hemicube export city.hemicube -o city.npz --with-sky              # and what each patch sees of the sky
  hemicube export room.hemicube -o zones.csv --by object            # form factors between objects
  hemicube export room.hemicube -o room.vtp --scene room.obj        # ParaView: each patch with its results
  hemicube export room.hemicube -o room.glb --scene room.obj --up y --show seen
  hemicube export room.hemicube -o patches.csv                   # a line a patch
  hemicube export box.hemicube --for elmer -o mesh/ViewFactors.dat
  hemicube export zone.hemicube --for energyplus --zone 'Zone 1' -o factors.idf";

/// Arguments without a meaning for a solver.
const NOT_FOR_SOLVERS: [&str; 9] = [
    "with_sky",
    "allow_incomplete",
    "results",
    "scene",
    "show",
    "range",
    "solution",
    "up",
    "allow_large",
];

/// Arguments without a meaning for zones.
const OF_PATCHES: [&str; 7] = [
    "allow_incomplete",
    "results",
    "scene",
    "show",
    "range",
    "solution",
    "up",
];

/// `hemicube export`
#[derive(Args, Debug)]
#[command(about = about(), long_about = None, after_long_help = examples(EXAMPLES, false))]
pub(crate) struct Arguments {
    /// The matrix
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    #[arg(short, long, value_name = "OUT", help = output_help())]
    output: PathBuf,
    /// Add rows and columns up: one for each object, material or face of the scene's file. OUT is then a table with
    /// their names, `.csv`, what View3D writes, `.vf`, or any format of matrices, in the table's order; with `--for`,
    /// the solver's rows
    #[arg(long, value_name = "WHAT", conflicts_with_all = OF_PATCHES)]
    by: Option<ZoneName>,
    /// Add columns after those of the patches: the ground and the patches of the sky, as `hemicube sky --matrix` found
    /// them. OUT with `.columns.csv` in place of its ending says what each is
    #[arg(long, conflicts_with = "by")]
    pub(crate) with_sky: bool,
    /// Replace what is there
    #[arg(long)]
    pub(crate) overwrite: bool,
    /// Accept a matrix of which parts are missing; their rows become empty
    #[arg(long)]
    allow_incomplete: bool,
    /// Write the matrix as a solver reads it, or say what it lacks for that and the next step. Rows are the faces of
    /// the scene's file in its order; for petsc patches, for view3d and energyplus objects. `calculix:2.21` and
    /// `energyplus:9.6` write for that version [default: 2.20, 22.1 or later]
    #[arg(long = "for", value_name = "PROGRAM[:VERSION]", value_parser = solver::Programs::parser(), conflicts_with_all = NOT_FOR_SOLVERS,
        help_heading = "Solvers")]
    program: Option<String>,
    /// A text file with the solver's order of rows: a line each, the face's number from 0 or the object's name
    #[arg(long, value_name = "FILE", requires = "program", help_heading = "Solvers")]
    pub(crate) order: Option<PathBuf>,
    /// EnergyPlus: the zone or enclosure of the surfaces
    #[arg(long, value_name = "NAME", requires = "program", help_heading = "Solvers")]
    zone: Option<String>,
    #[arg(long, help_heading = "Patches", help = format!(
        "With a {}: write results for each patch instead of the matrix",
        either(" or "),
    ))]
    results: bool,
    #[arg(long, value_name = "SCENE", help_heading = "Patches", help = format!(
        "The scene that the matrix is of: it has the corners that {} need [default: the one that the matrix names, where it \
         is found]",
        patch_extensions(PatchFormat::needs_corners, " and "),
    ))]
    pub(crate) scene: Option<PathBuf>,
    /// Read a scene of which more would come than a file of its size may become (docs/security.md)
    #[arg(long, hide_short_help = true)]
    allow_large: bool,
    /// Which solutions to add (repeatable) [default: all that `hemicube solve` left beside the matrix]
    #[arg(long, value_name = "NAME", help_heading = "Patches")]
    solution: Vec<String>,
    #[arg(long, value_name = "COLUMN", help_heading = "Patches", help = format!(
        "What colours {}: a column such as flux, radiosity, sky_view_factor, escaped, seen [default: the first of \
         these that says something]",
        patch_extensions(PatchFormat::has_colors, " and "),
    ))]
    show: Option<String>,
    /// What the first and the last colour stand for [default: the least and the greatest value]
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true, help_heading = "Patches")]
    range: Option<[f64; 2]>,
    #[arg(long, value_name = "x|y|z", hide_possible_values = true, help_heading = "Patches", help = format!(
        "The axis that points up, for {}, where that is y [default: the scene's, or as `inspect` finds it]",
        patch_extensions(PatchFormat::is_upright, " and "),
    ))]
    up: Option<UpAxis>,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}

impl Arguments {
    /// Paths that the command reads and writes.
    pub(crate) fn paths(&self) -> Paths {
        let columns = self.with_sky.then(|| self.output().with_extension("columns.csv"));
        let outputs = solver::files(self).unwrap_or_else(|| vec![self.output().to_owned()]);
        Paths::default()
            .store([&self.store])
            .reads(&self.scene)
            .reads(&self.order)
            .writes("-o", &outputs, self.overwrite)
            .writes("--with-sky", &columns, self.overwrite)
    }

    /// OUT; one of the two is there.
    fn output(&self) -> &Path {
        &self.output
    }
}

fn range(text: &str) -> Result<[f64; 2], String> {
    let ends = text.split_once(',').and_then(|(low, high)| {
        let end = |text: &str| text.trim().parse::<f64>().ok().filter(|end| end.is_finite());
        Some([end(low)?, end(high)?])
    });
    ends.filter(|[low, high]| low < high)
        .ok_or_else(|| "two numbers such as `0,0.5` are needed, the smaller first".to_owned())
}

/// Rule for joining patches to zones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ZoneName {
    /// Objects of one name
    Object,
    /// Materials of one name
    Material,
    /// Faces of the scene's file
    Face,
}

/// `.npz, .mtx or .txt`, with `last` before the last.
fn joined(mut words: Vec<String>, last: &str) -> String {
    match words.pop() {
        Some(word) if words.is_empty() => word,
        Some(word) => words.join(", ") + last + &word,
        None => String::new(),
    }
}

fn dotted(named: &[Named]) -> Vec<String> {
    let extensions = named.iter().flat_map(|(extensions, _)| extensions.iter());
    extensions.map(|extension| format!(".{extension}")).collect()
}

fn matrix_formats() -> Vec<Named> {
    ExportFormat::ALL.iter().map(|format| format.named()).collect()
}

/// The formats of patches with a property, without extensions of the matrix.
fn patch_formats(property: impl Fn(PatchFormat) -> bool) -> Vec<Named> {
    let is_matrix = |extension: &&str| {
        matrix_formats()
            .iter()
            .any(|(extensions, _)| extensions.contains(extension))
    };
    let all = PatchFormat::ALL.iter().copied();
    let wanted = all.filter(|&format| property(format) && !format.extensions().iter().any(is_matrix));
    wanted.map(PatchFormat::named).collect()
}

fn patch_extensions(property: impl Fn(PatchFormat) -> bool, last: &str) -> String {
    joined(dotted(&patch_formats(property)), last)
}

/// The extensions of both the matrix and patches.
fn either(last: &str) -> String {
    let of_patches = PatchFormat::ALL.iter().flat_map(|format| format.extensions());
    let of_matrix = |extension: &&&str| {
        matrix_formats()
            .iter()
            .any(|(extensions, _)| extensions.contains(extension))
    };
    joined(of_patches.filter(of_matrix).map(|e| format!(".{e}")).collect(), last)
}

/// The usual extension of each format; neighbours for one program have that of the first.
fn usual(formats: &[Named]) -> String {
    let groups = formats.chunk_by(|a, b| !a.1.is_empty() && a.1 == b.1);
    let extensions: Vec<String> = groups.map(|group| format!(".{}", group[0].0[0])).collect();
    extensions.join(", ")
}

fn about() -> String {
    format!(
        "Write a matrix ({}), or what is known of its patches ({})",
        usual(&matrix_formats()),
        usual(&patch_formats(|_| true))
    )
}

fn output_help() -> String {
    format!(
        "The file to write; its extension says what: the matrix as {}; a row of results for each patch, on the model, \
         as {}, or as a table, {}",
        listed(matrix_formats(), "").join(", "),
        listed(patch_formats(PatchFormat::needs_corners), "").join(", "),
        joined(listed(patch_formats(|format| !format.needs_corners()), ""), " or "),
    )
}

/// The extension and the program of the dialogue's export.
pub(super) fn first_choice() -> (&'static str, &'static str) {
    let format = ExportFormat::ALL[0];
    (format.extensions()[0], format.label())
}

#[derive(Serialize)]
struct Report<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    #[serde(flatten)]
    export: &'a ExportReport,
}

/// The object and the format of an export.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    Matrix(ExportFormat),
    Patches(PatchFormat),
}

impl Target {
    /// The target named by the arguments.
    ///
    /// # Errors
    /// When they do not say, or contradict each other.
    fn of(arguments: &Arguments) -> Result<Self> {
        let output = arguments.output();
        let Arguments {
            results,
            scene,
            show,
            range,
            solution,
            up,
            with_sky,
            ..
        } = arguments;
        let of_output = |path: &Path| match (PatchFormat::of(path), ExportFormat::of(path)) {
            (Ok(format), Ok(_)) if *results => Some(Self::Patches(format)),
            (_, Ok(format)) => Some(Self::Matrix(format)),
            (Ok(format), Err(_)) => Some(Self::Patches(format)),
            (Err(_), Err(_)) => None,
        };
        let target = of_output(output).ok_or_else(|| {
            hinted(
                anyhow!("`{}` does not say which format is wanted", output.display()),
                format!(
                    "end it in {} for the matrix, in {} for its patches",
                    joined(dotted(&matrix_formats()), " or "),
                    patch_extensions(|_| true, " or "),
                ),
            )
        })?;
        let unwanted = [
            (
                "--with-sky",
                *with_sky && !matches!(target, Self::Matrix(format) if format.takes_sky()),
            ),
            ("--results", *results && !matches!(target, Self::Patches(_))),
            ("--scene", scene.is_some() && !matches!(target, Self::Patches(_))),
            (
                "--solution",
                !solution.is_empty() && !matches!(target, Self::Patches(_)),
            ),
            (
                "--show",
                show.is_some() && !matches!(target, Self::Patches(format) if format.has_colors()),
            ),
            (
                "--range",
                range.is_some() && !matches!(target, Self::Patches(format) if format.has_colors()),
            ),
            (
                "--up",
                up.is_some() && !matches!(target, Self::Patches(format) if format.is_upright()),
            ),
        ];
        for (name, given) in unwanted {
            if given {
                return Err(hinted(
                    anyhow!("`{name}` has no meaning for `{}`", output.display()),
                    format!(
                        "`hemicube export --help` says which files it is for; a {} of patches is asked for by \
                         `--results`",
                        either(" or ")
                    ),
                ));
            }
        }
        Ok(target)
    }
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let json = JsonReport::asked(&arguments.report);
    if let Some(program) = &arguments.program {
        return solver::run(arguments, program, json, talk);
    }
    if let Some(by) = arguments.by {
        return export_zones(arguments, by, json, talk);
    }
    let format = match Target::of(arguments)? {
        Target::Matrix(format) => format,
        Target::Patches(format) => return patches::run(arguments, format, json, talk),
    };
    report::require_matrix(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let sky = if arguments.with_sky {
        Some(SkyColumns::open(
            &store,
            arguments.output(),
            format,
            arguments.overwrite,
        )?)
    } else {
        None
    };
    let found = interruptible(arguments, talk, |WriteOptions { overwrite, cancel }| {
        let options = ExportOptions {
            overwrite,
            allow_incomplete: arguments.allow_incomplete,
            cancel: Some(cancel),
        };
        match &sky {
            Some(sky) => export_with_sky(&store, &sky.rows, arguments.output(), format, options),
            None => export(&store, arguments.output(), format, options),
        }
    });
    let Some(found) = found.map_err(|error| match error.downcast_ref() {
        Some(hemicube_export::Error::NotBuilt { .. }) => hinted(
            error,
            format!("build it with default features, or write a `.{}`", first_choice().0),
        ),
        _ => error,
    })?
    else {
        return Ok(Exit::Interrupted);
    };
    if let Some(sky) = &sky {
        sky.write()?;
    }
    talk.say(&format!(
        "`{}`: {}, {} of {} of {}",
        found.path.display(),
        size(found.bytes),
        counted(found.entries, "entry"),
        counted(found.rows, "row"),
        count(found.patch_count.into()),
    ));
    if let Some(sky) = &sky {
        talk.say(&format!(
            "`{}`: columns from {} on are the ground and {} of the sky",
            sky.path.display(),
            count(sky.first.into()),
            counted(u64::from(sky.rows.columns()) - 1, "patch"),
        ));
    }
    if let Some(how) = how_to_read(&found) {
        talk.say(&how);
    }
    if let Some(json) = json {
        json.write(&Report {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            export: &found,
        })?;
    }
    Ok(Exit::Done)
}

/// Writes the file, unless Ctrl-C ends that: then it returns `None`.
fn interruptible<T>(
    arguments: &Arguments,
    talk: Talk,
    write: impl FnOnce(WriteOptions<'_>) -> hemicube_export::Result<T>,
) -> Result<Option<T>> {
    let cancel = exit::watch_interrupts()?;
    let _guard = exit::InterruptGuard::new();
    let bar = Bar::spinner(talk, &format!("writing `{}`", arguments.output().display()));
    let written = write(WriteOptions {
        overwrite: arguments.overwrite,
        cancel,
    });
    drop(bar);
    match written {
        Ok(written) => Ok(Some(written)),
        Err(hemicube_export::Error::Interrupted { .. }) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// The columns of the sky, and the table describing them.
struct SkyColumns {
    rows: StoredSky,
    division: SkyDivision,
    path: PathBuf,
    /// The number of the first, as counted in the file.
    first: u32,
    from: u32,
}

impl SkyColumns {
    fn open(store: &Store, output: &Path, format: ExportFormat, overwrite: bool) -> Result<Self> {
        let path = stored::sky(store)?;
        let rows = StoredSky::beside(store)?;
        let (division, _) = stored::sky_frame(&stored::sky(store)?)?;
        if division.columns() != rows.columns() {
            bail!("`{}` does not have the columns that `sky.json` says", path.display());
        }
        let path = output.with_extension("columns.csv");
        if path.exists() && !overwrite {
            return Err(hinted(
                anyhow!("`{}` is there already", path.display()),
                "`--overwrite` replaces it, or choose another name",
            ));
        }
        let from = format.first_index();
        Ok(Self {
            rows,
            division,
            path,
            first: store.patch_count() + from,
            from,
        })
    }

    /// One line a column: its name, its middle, and its solid angle.
    fn write(&self) -> Result<()> {
        let mut file = PendingFile::create(&self.path)?;
        let mut text = format!(
            "column_from_{},name,azimuth_degrees,altitude_degrees,solid_angle_sr\n",
            self.from
        );
        for column in 0..self.division.columns() {
            let middle = self.division.middle(column);
            let place = if column == 0 {
                ",".to_owned()
            } else {
                let azimuth = middle.x.atan2(middle.y).to_degrees().rem_euclid(360.0);
                let altitude = middle.z.clamp(-1.0, 1.0).asin().to_degrees();
                format!("{azimuth:.4},{altitude:.4}")
            };
            let name = if column == 0 {
                "ground".to_owned()
            } else {
                format!("sky {column}")
            };
            text.push_str(&format!(
                "{},{name},{place},{:.9}\n",
                self.first + column,
                self.division.solid_angle(column)
            ));
        }
        file.write_all(text.as_bytes())
            .with_context(|| format!("`{}` cannot be written", self.path.display()))?;
        file.commit()
    }
}

impl From<ZoneName> for GroupBy {
    fn from(name: ZoneName) -> Self {
        match name {
            ZoneName::Object => Self::Object,
            ZoneName::Material => Self::Material,
            ZoneName::Face => Self::Face,
        }
    }
}

/// A format of zones: a table with their names, or one of matrices.
#[derive(Clone, Copy, Serialize)]
#[serde(untagged)]
enum ZonesIn {
    Table(ZoneFormat),
    Matrix(ExportFormat),
}

impl ZonesIn {
    /// The format asked for by the file's name.
    fn of(arguments: &Arguments) -> Result<Self> {
        if let Ok(table) = ZoneFormat::of(arguments.output()) {
            return Ok(Self::Table(table));
        }
        match Target::of(arguments)? {
            Target::Matrix(format) => Ok(Self::Matrix(format)),
            Target::Patches(_) => Err(hinted(
                anyhow!(
                    "`{}` is of patches, and `--by` adds them up",
                    arguments.output().display()
                ),
                "end it in `.csv` (a table with names), `.vf` (View3D's) or a format of matrices, such as `.npz`",
            )),
        }
    }
}

#[derive(Serialize)]
struct ZonesReport<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    path: &'a Path,
    format: ZonesIn,
    by: GroupBy,
    bytes: u64,
    zones: &'a [Zone],
}

fn export_zones(arguments: &Arguments, by: ZoneName, json: Option<JsonReport>, talk: Talk) -> Result<Exit> {
    let format = ZonesIn::of(arguments)?;
    report::require_matrix(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let bar = Bar::spinner(talk, &format!("adding up `{}`", arguments.store.display()));
    let found = zones(&store, by.into())?;
    drop(bar);
    let materials = &store.manifest().materials;
    let bytes = match format {
        ZonesIn::Table(table) => write_zones(&found, materials, arguments.output(), table, arguments.overwrite)?,
        ZonesIn::Matrix(matrix) => {
            let written = interruptible(arguments, talk, |options| {
                let options = ExportOptions {
                    overwrite: options.overwrite,
                    allow_incomplete: false,
                    cancel: Some(options.cancel),
                };
                hemicube_export::export_zones(&store, &found, arguments.output(), matrix, options)
            })?;
            match written {
                Some(written) => written.bytes,
                None => return Ok(Exit::Interrupted),
            }
        }
    };
    talk.say(&format!(
        "`{}`: {}, {} of {}",
        arguments.output().display(),
        size(bytes),
        counted(found.len() as u64, "zone"),
        counted(store.patch_count().into(), "patch"),
    ));
    if let Some(json) = json {
        json.write(&ZonesReport {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            path: arguments.output(),
            format,
            by: by.into(),
            bytes,
            zones: &found,
        })?;
    }
    Ok(Exit::Done)
}

/// The words to type in the file's program. F[i, j] is from i to j.
fn how_to_read(found: &ExportReport) -> Option<String> {
    let mut path = found.path.display().to_string();
    if cfg!(windows) {
        // Each of them takes either separator there.
        path = path.replace('\\', "/");
    }
    // Names in need of quoting in three languages are left to their owner.
    if path.contains(['"', '\'', '\\']) {
        return None;
    }
    found.format.how_to_read(&path)
}
