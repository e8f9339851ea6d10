//! `hemicube export`: the matrix, and what is known of its patches, in the files that other programs read.

mod arguments;
mod parquet;
mod patches;

pub(crate) use arguments::Arguments;

use crate::args::Talk;
use crate::exit::{self, Exit, hinted};
use crate::progress::Bar;
use crate::report::{self, JsonReport, PendingFile, SCHEMA, count, counted, size};
use crate::stored;
use anyhow::{Context, Result, anyhow, bail};
use arguments::ZoneName;
use clap::ValueEnum;
use hemicube::analysis::zones::{GroupBy, Zone, ZoneFormat, write_zones, zones};
use hemicube::export::{ExportFormat, ExportOptions, ExportReport, export, export_with_sky};
use hemicube::sky::{SkyDivision, StoredSky};
use hemicube::store::Store;
use hemicube_export::{PatchFormat, WriteOptions};
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

#[derive(Serialize)]
struct Report<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    #[serde(flatten)]
    export: &'a ExportReport,
}

/// What is written, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    Matrix(ExportFormat),
    Parquet,
    Patches(PatchFormat),
}

impl Target {
    /// What the arguments ask for.
    ///
    /// # Errors
    /// When they do not say, or contradict each other.
    fn of(arguments: &Arguments) -> Result<Self> {
        let Arguments {
            output,
            format,
            patches,
            scene,
            show,
            range,
            solution,
            up,
            with_sky,
            ..
        } = arguments;
        let of_output = |path: &Path| {
            if let Some(format) = PatchFormat::of(path)
                && (*patches || format != PatchFormat::Npz)
            {
                return Some(Self::Patches(format));
            }
            if path
                .extension()
                .is_some_and(|extension| extension.eq_ignore_ascii_case("parquet"))
            {
                return Some(Self::Parquet);
            }
            ExportFormat::of(path).ok().map(Self::Matrix)
        };
        let target = match format {
            // The names are extensions.
            Some(name) => {
                let extension = name.to_possible_value().map(|value| value.get_name().to_owned());
                of_output(&Path::new("F").with_extension(extension.unwrap_or_default()))
            }
            None => of_output(output),
        };
        let target = target.ok_or_else(|| {
            hinted(
                anyhow!("`{}` does not say which format is wanted", output.display()),
                "end it in .npz, .mtx, .txt, .dat, .npy or .parquet for the matrix, in .vtp, .vtu, .glb, .ply or .csv for its \
                 patches, or name one with `--format`",
            )
        })?;
        let unwanted = [
            ("--with-sky", *with_sky && !matches!(target, Self::Matrix(_))),
            ("--patches", *patches && !matches!(target, Self::Patches(_))),
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
            ("--up", up.is_some() && target != Self::Patches(PatchFormat::Glb)),
        ];
        for (name, given) in unwanted {
            if given {
                return Err(hinted(
                    anyhow!("`{name}` has no meaning for `{}`", output.display()),
                    "`hemicube export --help` says which files it is for; a .npz of patches is asked for by `--patches`",
                ));
            }
        }
        Ok(target)
    }
}

#[allow(
    clippy::field_reassign_with_default,
    reason = "the options are open to new fields, so no literal makes them"
)]
pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let json = JsonReport::open(&arguments.report)?;
    if let Some(by) = arguments.by {
        return export_zones(arguments, by, json, talk);
    }
    let format = match Target::of(arguments)? {
        Target::Matrix(format) => format,
        Target::Parquet => return parquet::run(arguments, json, talk),
        Target::Patches(format) => return patches::run(arguments, format, json, talk),
    };
    report::require(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let mut options = ExportOptions::default();
    options.overwrite = arguments.overwrite;
    options.allow_incomplete = arguments.allow_incomplete;
    let sky = if arguments.with_sky {
        Some(SkyColumns::open(
            &store,
            &arguments.output,
            format,
            arguments.overwrite,
        )?)
    } else {
        None
    };
    let bar = Bar::spinner(talk, &format!("writing `{}`", arguments.output.display()));
    let found = match &sky {
        Some(sky) => export_with_sky(&store, &sky.rows, &arguments.output, format, options)?,
        None => export(&store, &arguments.output, format, options)?,
    };
    if let Some(sky) = &sky {
        sky.write()?;
    }
    drop(bar);
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
            counted(u64::from(found.sky_columns) - 1, "patch"),
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

/// Writes the file, which Ctrl-C may end: its bytes, or `None` then.
fn interruptible(
    arguments: &Arguments,
    talk: Talk,
    write: impl FnOnce(WriteOptions<'_>) -> hemicube_export::Result<u64>,
) -> Result<Option<u64>> {
    let cancel = exit::watch_interrupts()?;
    let _guard = exit::InterruptGuard::new();
    let bar = Bar::spinner(talk, &format!("writing `{}`", arguments.output.display()));
    let written = write(WriteOptions {
        overwrite: arguments.overwrite,
        cancel,
    });
    drop(bar);
    match written {
        Ok(bytes) => Ok(Some(bytes)),
        Err(hemicube_export::Error::Interrupted { .. }) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// The columns of the sky, and the table that says what they are.
struct SkyColumns {
    rows: StoredSky,
    division: SkyDivision,
    path: PathBuf,
    /// The number of the first, as the file counts.
    first: u32,
    from: u32,
}

impl SkyColumns {
    fn open(store: &Store, output: &Path, format: ExportFormat, overwrite: bool) -> Result<Self> {
        let path = stored::sky(store)?;
        let rows = StoredSky::beside(store)?;
        let division = stored::sky_division(store)?;
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
        // Matrix Market and MATLAB count from 1.
        let from = u32::from(matches!(format, ExportFormat::MatrixMarket | ExportFormat::Triplets));
        Ok(Self {
            rows,
            division,
            path,
            first: store.patch_count() + from,
            from,
        })
    }

    /// One line a column: which it is, where its middle is, and how large.
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

#[derive(Serialize)]
struct ZonesReport<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    path: &'a Path,
    format: ZoneFormat,
    by: GroupBy,
    bytes: u64,
    zones: &'a [Zone],
}

fn export_zones(arguments: &Arguments, by: ZoneName, json: Option<JsonReport>, talk: Talk) -> Result<Exit> {
    let format = ZoneFormat::of(&arguments.output)?;
    report::require(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let bar = Bar::spinner(talk, &format!("adding up `{}`", arguments.store.display()));
    let found = zones(&store, by.into())?;
    let materials = &store.manifest().materials;
    let bytes = write_zones(&found, materials, &arguments.output, format, arguments.overwrite)?;
    drop(bar);
    talk.say(&format!(
        "`{}`: {}, {} of {}",
        arguments.output.display(),
        size(bytes),
        counted(found.len() as u64, "zone"),
        counted(store.patch_count().into(), "patch"),
    ));
    if let Some(json) = json {
        json.write(&ZonesReport {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            path: &arguments.output,
            format,
            by: by.into(),
            bytes,
            zones: &found,
        })?;
    }
    Ok(Exit::Done)
}

/// What to type in the program that the file is for. F[i, j] is from i to j.
fn how_to_read(found: &ExportReport) -> Option<String> {
    let path = found.path.display().to_string();
    // Names that would need quoting in three languages are left to who chose them.
    if path.contains(['"', '\'', '\\']) {
        return None;
    }
    match found.format {
        ExportFormat::Npz => Some(format!("Python: F = scipy.sparse.load_npz(\"{path}\")")),
        ExportFormat::MatrixMarket => Some(format!("Python: F = scipy.io.mmread(\"{path}\").tocsr()")),
        ExportFormat::Triplets => Some(format!("MATLAB, Octave: F = spconvert(load('{path}'));")),
        ExportFormat::Npy => Some(format!("Python: F = numpy.load(\"{path}\", mmap_mode=\"r\")")),
        _ => None,
    }
}
