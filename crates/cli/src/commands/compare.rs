//! `hemicube compare`: how far one matrix is from another.

mod map;
mod plot;

use crate::args::{Report as ReportArguments, RowRange, Talk, not_negative};
use crate::exit::{self, Exit};
use crate::help::examples;
use crate::outputs::Paths;
use crate::picture::sheet::Format;
use crate::progress::Bar;
use crate::report::{self, JsonReport, Listing, PendingFile, SCHEMA, count, counted, figures};
use anyhow::{Context, Result, bail};
use clap::Args;
use hemicube::analysis::compare::{CompareOptions, Comparison, OverRows, RowDifference, compare_rows};
use hemicube::store::Matrix;
use hemicube_export::{PatchFormat, WriteOptions, write_patches};
use plot::Picture;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "  \
  hemicube compare fast.hemicube fine.hemicube --max-error 0.02
  hemicube compare fast.hemicube fine.hemicube -o errors.svg
  hemicube compare without.hemicube city.hemicube -o change.ply";

/// Compare two matrices (stores, .npz, .mtx or .npy); the second is the reference
///
/// Of two states of a scene, the patches that stand in both are compared.
#[derive(Args, Debug)]
#[command(after_long_help = examples(EXAMPLES, false))]
pub(crate) struct Arguments {
    /// The matrix: a store, or a .npz, .mtx or .npy file
    #[arg(value_name = "A")]
    pub(crate) matrix: PathBuf,
    /// The reference
    #[arg(value_name = "B")]
    pub(crate) reference: PathBuf,
    /// Exit 1 when the relative Frobenius error is above X
    #[arg(long, value_name = "X", value_parser = not_negative, allow_negative_numbers = true)]
    pub(crate) max_error: Option<f64>,
    /// Compare only the rows A to B − 1, counted from 0
    #[arg(long, value_name = "A..B")]
    pub(crate) rows: Option<RowRange>,
    /// Draw how many rows have which error into FILE, beside what A expected of them if it was computed to a tolerance:
    /// .svg or .png; or write the difference of each row, on the model: .vtp, .vtu, .glb, .ply, or as a table, .csv
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// Replace what is there
    #[arg(long, requires = "output")]
    pub(crate) overwrite: bool,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}
impl Arguments {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        let (stores, files): (Vec<_>, Vec<_>) = [&self.matrix, &self.reference]
            .into_iter()
            .partition(|path| path.is_dir());
        Paths::default()
            .store(stores)
            .reads(files)
            .writes("-o", &self.output, self.overwrite)
    }
}

#[derive(Serialize)]
struct Report<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    #[serde(flatten)]
    comparison: &'a Comparison,
    equal: bool,
    max_error: Option<f64>,
    ok: bool,
}

#[allow(
    clippy::field_reassign_with_default,
    reason = "the options are open to new fields, so no literal makes them"
)]
pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let output = arguments.output.as_deref().map(Output::of).transpose()?;
    let json = JsonReport::asked(&arguments.report);
    report::require(&arguments.matrix)?;
    report::require(&arguments.reference)?;
    let (matrix, reference) = (Matrix::open(&arguments.matrix)?, Matrix::open(&arguments.reference)?);
    let size = matrix.patch_count();
    if let Some(rows) = arguments.rows
        && (rows.start >= size || rows.end.is_some_and(|end| end > size))
    {
        let has = counted(u64::from(size), "row");
        bail!("`--rows`: `{}` has {has}, from 0 on", arguments.matrix.display());
    }
    let mut options = CompareOptions::default();
    options.rows = arguments.rows.map(|rows| rows.start..rows.end.unwrap_or(u32::MAX));
    let bar = Bar::spinner(talk, "comparing");
    let mut rows = Vec::new();
    let found = compare_rows(&matrix, &reference, &options, |row| {
        if output.is_some() {
            rows.push(row);
        }
    })?;
    drop(bar);
    // Not `>`: NaN is above every bound.
    let ok = arguments
        .max_error
        .is_none_or(|bound| found.relative_frobenius <= bound);
    match output {
        Some(Output::Picture(format, mut file)) => {
            let picture = picture(&found, &rows, &matrix, arguments)?;
            file.write_all(&plot::draw(&picture, format)?)
                .context("the picture cannot be written")?;
            file.commit()?;
        }
        Some(Output::Map(format, path)) => {
            let options = WriteOptions {
                overwrite: arguments.overwrite,
                cancel: exit::watch_interrupts()?,
            };
            write_patches(&map::of(&rows, [&matrix, &reference], format)?, path, format, options)?;
        }
        None => {}
    }
    if let Some(json) = json {
        json.write(&Report {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            comparison: &found,
            equal: found.is_equal(),
            max_error: arguments.max_error,
            ok,
        })?;
    }
    if !arguments.report.json {
        report::print(&text(&found, arguments.max_error, ok))?;
    }
    Ok(if ok { Exit::Done } else { Exit::NotHeld })
}

/// What a comparison is written as.
enum Output<'a> {
    /// Errors of the rows, by their number.
    Picture(Format, PendingFile),
    /// The difference of each row, on the model.
    Map(PatchFormat, &'a Path),
}

impl<'a> Output<'a> {
    fn of(file: &'a Path) -> Result<Self> {
        if let Ok(format) = PatchFormat::of(file) {
            return Ok(Self::Map(format, file));
        }
        let Ok(format) = Format::of(file) else {
            bail!(
                "`-o {}`: a name that ends in .svg or .png is needed, or in .csv, .vtp, .vtu, .glb or .ply for a map",
                file.display()
            );
        };
        Ok(Self::Picture(format, PendingFile::create(file)?))
    }
}

/// The picture of a comparison.
fn picture(found: &Comparison, rows: &[RowDifference], matrix: &Matrix, arguments: &Arguments) -> Result<Picture> {
    let name = |path: &Path| {
        path.file_name()
            .unwrap_or(path.as_os_str())
            .to_string_lossy()
            .into_owned()
    };
    let (matrix_name, reference_name) = (name(&arguments.matrix), name(&arguments.reference));
    // Rows empty in the reference have no relative error, neither measured nor expected.
    let relative: Vec<&RowDifference> = rows.iter().filter(|row| row.reference > 0.0).collect();
    let expected = match matrix.store() {
        Some(store) if store.manifest().patches.is_some() => {
            let table = store.row_table()?;
            let of_row = |row: &&RowDifference| {
                let error = table.error.get(row.row as usize)?;
                error.is_finite().then_some(error / row.reference)
            };
            relative.iter().filter_map(of_row).collect()
        }
        _ => Vec::new(),
    };
    Ok(Picture {
        title: format!("{matrix_name} against {reference_name}"),
        subtitle: format!(
            "{} of {}; over the whole matrix the relative Frobenius error is {}",
            counted(found.rows_compared, "row"),
            counted(u64::from(found.patch_count), "patch"),
            self::relative(found.relative_frobenius)
        ),
        measured: relative.iter().map(|row| row.relative()).collect(),
        expected,
        matrix: found.relative_frobenius,
        bound: arguments.max_error,
    })
}

fn text(found: &Comparison, bound: Option<f64>, ok: bool) -> String {
    let mut list = Listing::default();
    list.add("matrix", found.matrix.display().to_string());
    list.add("reference", found.reference.display().to_string());
    let only = |number: u64, of: &str| {
        if number > 0 {
            format!(", {} only in the {of}", count(number))
        } else {
            String::new()
        }
    };
    if found.by_corners {
        list.add(
            "patches",
            format!(
                "{} in both, by their corners{}{}",
                count(found.patch_count.into()),
                only(found.patches_only_in_matrix.into(), "matrix"),
                only(found.patches_only_in_reference.into(), "reference")
            ),
        );
    }
    list.add(
        "rows",
        format!(
            "{} compared{}{}",
            count(found.rows_compared),
            only(found.rows_only_in_matrix, "matrix"),
            only(found.rows_only_in_reference, "reference")
        ),
    );
    list.add(
        "entries",
        format!(
            "{}, in the reference {}",
            count(found.entries_in_matrix),
            count(found.entries_in_reference)
        ),
    );
    list.add("relative Frobenius error", relative(found.relative_frobenius));
    list.add(
        "missed mass",
        format!(
            "{}, in the worst row {}",
            relative(found.missed_mass),
            relative(found.missed_mass_worst_row)
        ),
    );
    list.add("spurious mass", relative(found.spurious_mass));
    if let Some(worst) = found.worst_entry {
        list.add(
            "worst entry",
            format!(
                "F[{}, {}] is {}, in the reference {}",
                worst.i,
                worst.j,
                figures(worst.a),
                figures(worst.b)
            ),
        );
    }
    if found.rows_without_reference > 0 {
        list.add(
            "rows without reference",
            format!("{}, empty there and not here", count(found.rows_without_reference)),
        );
    }
    let mut text = list.text();
    text.push('\n');
    let row = |name: &str, over: OverRows, show: fn(f64) -> String| {
        [
            name.to_owned(),
            show(over.median),
            show(over.percentile_90),
            show(over.mean),
            show(over.max),
        ]
    };
    text.push_str(&report::table(
        ["over the rows", "median", "90 %", "mean", "worst"],
        [
            row("relative error", found.row_error, relative),
            row("relative L1", found.row_l1, relative),
            row("row-sum error", found.row_sum_error, figures),
        ],
    ));
    text.push('\n');
    text.push_str(&match bound {
        _ if found.is_equal() => "The matrices are equal.\n".to_owned(),
        None => "The matrices differ.\n".to_owned(),
        Some(bound) if ok => format!("The error is within the bound of {}.\n", relative(bound)),
        Some(bound) => format!("FAILED: the error is above the bound of {}.\n", relative(bound)),
    });
    text
}

/// A relative quantity as a percentage, with enough digits to compare.
fn relative(value: f64) -> String {
    if value == 0.0 {
        "0".to_owned()
    } else if !value.is_finite() {
        "infinite".to_owned()
    } else {
        format!("{} %", figures(100.0 * value))
    }
}
