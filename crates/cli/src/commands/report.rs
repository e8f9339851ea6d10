//! `hemicube report`: one page about a matrix, to be opened from the disk.
//!
//! `commands/report` writes one HTML file: sections as text, histograms as SVG, and arrays (`blocks.rs`: deflated, in
//! base64, each in a `<script>` that no browser runs), of which the largest entries of each row (`rows.rs`) are
//! unpacked a thousand at a time when somebody clicks. `viewer/` is what runs in it: one draw of all patches without an
//! index, so that the number of a vertex says whose it is; colours from a texture; what is under the mouse by a draw of
//! one pixel whose colours are ids. It is bundled with three.js by `scripts/viewer.sh` and committed, so that the
//! program is built without Node; `./test` bundles it again and compares. The page's own policy forbids it to load
//! anything.
//!
//! No own WebGL in the page, because three.js has turned and zoomed models on every browser for years; the page's own
//! code is what is special to patches.
//!
//! No zlib-rs in the page, because its output hangs on the processor's instructions; miniz_oxide's does not.

mod blocks;
mod geometry;
mod page;
mod plot;
mod rows;

use crate::args::{EngineSettings, Report as ReportArguments, Talk};
use crate::commands::view::matrix::{Order, Sparsity};
use crate::exit::Exit;
use crate::help::examples;
use crate::outputs::Paths;
use crate::progress::Bar;
use crate::report::{self, JsonReport, PendingFile, SCHEMA, count, counted, figures, percent, size};
use crate::stored;
use anyhow::{Context, Result, bail};
use blocks::Blocks;
use clap::Args;
use hemicube::analysis::check::{CheckOptions, CheckReport, check};
use hemicube::sky::{sky_beside, sky_view_factors_beside};
use hemicube::solve::StoredSolution;
use hemicube::store::{RowTable, Store};
use rows::RowPacker;
use serde::Serialize;
use std::io::Write;
use std::path::PathBuf;

/// Largest entries of a row that a page has, where nobody says.
const ENTRIES: u32 = 32;
/// Above so many patches a page has rows only if that is asked for: it would be too large to open.
const PATCHES_WITH_ROWS_MAX: u32 = 250_000;
/// Rows that are named for each way of being bad.
const WORST_ROWS: usize = 10;
/// Cells of the picture of the matrix.
const CELLS: u32 = 400;

/// Write one HTML page about a matrix, to be opened from the disk: what it is, whether it holds, the model in 3-D
#[derive(Args, Debug)]
#[command(after_long_help = examples("  hemicube report room.hemicube room.obj -o room.html\n  hemicube report city.hemicube city.obj -o city.html --entries 64", false))]
pub(crate) struct Arguments {
    /// The matrix
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// The scene that it is of
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    /// The page: .html
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Replace a file that is there
    #[arg(long)]
    pub(crate) overwrite: bool,
    /// How many of the largest entries of each row the page has; 0: no rows [default: 32, and 0 above 250,000 patches]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1024))]
    pub(crate) entries: Option<u32>,
    /// A solution to colour the model by (repeatable) [default: all that there are]
    #[arg(long, value_name = "NAME")]
    pub(crate) solution: Vec<String>,
    /// Read a scene of which more would come than a file of its size may become (docs/security.md)
    #[arg(long, hide_short_help = true)]
    pub(crate) allow_large: bool,
    #[command(flatten)]
    pub(crate) engine: EngineSettings,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}

impl Arguments {
    /// Paths that the command reads and writes.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default()
            .store([&self.store])
            .reads([&self.scene])
            .writes("-o", [&self.output], self.overwrite)
            .reports(&self.report)
    }
}

/// What the model can be coloured by.
#[derive(Debug, Serialize)]
struct Field {
    key: String,
    label: String,
    note: String,
    /// The arrays with a number a patch.
    columns: Vec<String>,
    /// True if there is a scale; light is shown as an eye would see it, objects in any colours.
    scale: bool,
    /// True if the scale is logarithmic at first.
    logarithmic: bool,
    light: bool,
}

impl Field {
    fn scale(key: &str, label: &str, note: &str, logarithmic: bool) -> Self {
        Self {
            key: key.to_owned(),
            label: label.to_owned(),
            note: note.to_owned(),
            columns: vec![key.to_owned()],
            scale: true,
            logarithmic,
            light: false,
        }
    }
}

/// Results for each patch, and how they may be shown.
struct Columns {
    fields: Vec<Field>,
    /// By the names of blocks.
    numbers: Vec<(String, Vec<f64>)>,
}

impl Columns {
    fn add(&mut self, field: Field, numbers: Vec<f64>) {
        self.numbers.push((field.key.clone(), numbers));
        self.fields.push(field);
    }
}

/// What the program says about a page, for programs.
#[derive(Serialize)]
struct Summary<'a> {
    schema: u32,
    program: &'static str,
    version: &'static str,
    path: &'a std::path::Path,
    bytes: u64,
    patches: u32,
    entries_per_row: u32,
    fields: Vec<&'a str>,
    ok: bool,
}

#[allow(clippy::cast_possible_truncation, reason = "the page has f32")]
fn narrow(numbers: &[f64]) -> Vec<f32> {
    numbers.iter().map(|&number| number as f32).collect()
}

/// Returns whether there is anything to see in these numbers.
fn tells(numbers: &[f64]) -> bool {
    numbers.iter().any(|&number| number > 0.0)
}

#[allow(
    clippy::field_reassign_with_default,
    reason = "the options are open to new fields, so no literal makes them"
)]
pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let json = JsonReport::open(&arguments.report)?;
    if arguments
        .output
        .extension()
        .is_none_or(|extension| !extension.eq_ignore_ascii_case("html"))
    {
        bail!("`{}`: the name of a page ends in .html", arguments.output.display());
    }
    report::require(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    store.require_complete()?;
    let prepared = stored::scene(&store, &arguments.scene, &arguments.engine, arguments.allow_large)?;
    let bar = Bar::spinner(talk, "checking");
    let mut options = CheckOptions::default();
    options.worst_rows = WORST_ROWS;
    let checked = check(&store, &options)?;
    bar.message("reading the rows");
    let (table, of_rows) = (store.patches()?, store.row_table()?);
    let entries = arguments
        .entries
        .unwrap_or(if store.patch_count() > PATCHES_WITH_ROWS_MAX {
            0
        } else {
            ENTRIES
        });
    let mut packer = RowPacker::new(&table, store.manifest().objects.len(), entries as usize);
    let mut sparsity = Sparsity::new(&store, Order::Work, CELLS)?;
    let mut seen = vec![f64::NAN; table.len()];
    for place in 0..store.manifest().parts.len() {
        let Some(part) = store.part(place)? else { continue };
        sparsity.add(&part);
        for (row, &patch) in part.rows.iter().enumerate() {
            let (columns, factors) = part.row(row);
            seen[patch as usize] = columns.len() as f64;
            packer.add(patch, columns, factors)?;
        }
    }
    let mut columns = columns(&store, &of_rows, seen, &arguments.solution, talk)?;
    if entries > 0 {
        columns.fields.push(Field {
            columns: Vec::new(),
            ..Field::scale("row", "Row of the selected patch", "", true)
        });
    }
    if store.manifest().objects.len() > 1 {
        columns.fields.push(Field {
            columns: Vec::new(),
            scale: false,
            ..Field::scale("object", "Objects", "each object in a colour of its own", false)
        });
    }

    bar.message("writing the page");
    let mut blocks = Blocks::default();
    let bounds = geometry::write(&prepared, &mut blocks);
    blocks.add("object", &table.object);
    blocks.add("material", &table.material);
    blocks.add("area", &narrow(&table.area));
    for (name, numbers) in &columns.numbers {
        blocks.add(name, &narrow(numbers));
    }
    let packed = packer.finish(&mut blocks);
    let page = page::Page {
        store: &store,
        checked: &checked,
        worst: worst(&checked, &of_rows),
        columns: &columns,
        sparsity: &sparsity,
        bounds,
        up: prepared.scene.up,
        packed,
    };
    let text = page.html(&blocks)?;
    let mut file = PendingFile::create(&arguments.output)?;
    file.write_all(text.as_bytes())
        .with_context(|| format!("`{}` cannot be written", arguments.output.display()))?;
    file.commit()?;
    drop(bar);
    talk.say(&format!(
        "`{}`: {}, {}, {}",
        arguments.output.display(),
        size(text.len() as u64),
        counted(store.patch_count().into(), "patch"),
        if entries == 0 {
            "no rows".to_owned()
        } else {
            format!("the largest {} of each row", counted(entries.into(), "entry"))
        }
    ));
    if let Some(json) = json {
        json.write(&Summary {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            path: &arguments.output,
            bytes: text.len() as u64,
            patches: store.patch_count(),
            entries_per_row: entries,
            fields: columns.fields.iter().map(|field| field.key.as_str()).collect(),
            ok: checked.ok,
        })?;
    }
    if checked.ok {
        return Ok(Exit::Done);
    }
    for failure in &checked.failures {
        talk.warn(&format!("check failed: {}", failure.first));
    }
    Ok(Exit::NotHeld)
}

/// What there is of each patch; first what a person most likely wants to see.
fn columns(store: &Store, rows: &RowTable, seen: Vec<f64>, wanted: &[String], talk: Talk) -> Result<Columns> {
    let mut columns = Columns {
        fields: Vec::new(),
        numbers: Vec::new(),
    };
    let names = if wanted.is_empty() {
        StoredSolution::names(store)
    } else {
        wanted.to_vec()
    };
    for name in names {
        match StoredSolution::open(store, &name) {
            Ok(solution) => add_solution(&mut columns, &name, &solution)?,
            // One that nobody asked for by its name may be an old one.
            Err(error) if wanted.is_empty() => talk.warn(&format!("left out: {error}")),
            Err(error) => return Err(error.into()),
        }
    }
    if sky_beside(store).exists() {
        match stored::sky(store) {
            Ok(_) => {
                let factors = sky_view_factors_beside(store)?;
                let note = "sky view factor: of what leaves a patch, what reaches the sky";
                columns.add(Field::scale("sky", "Sky view factor", note, false), factors);
            }
            Err(error) => talk.warn(&format!("left out: {error}")),
        }
    }
    let closure = (0..rows.row_sum.len())
        .map(|patch| {
            (rows.row_sum[patch] + rows.escaped[patch] + rows.blocked[patch] + rows.unselected[patch] - 1.0).abs()
        })
        .collect();
    let escapes = tells(&rows.escaped);
    if escapes {
        let note = "escaped: of what leaves a patch, what leaves the scene (sky, and ground below the horizon)";
        columns.add(Field::scale("escaped", "Escaped", note, false), rows.escaped.clone());
    }
    columns.add(
        Field::scale(
            "seen",
            "Patches seen",
            "entries of the row: patches that a patch sees",
            false,
        ),
        seen,
    );
    columns.add(
        Field::scale("row_sum", "Sum of the row", "sum of the form factors of the row", false),
        rows.row_sum.clone(),
    );
    if tells(&rows.error) {
        let note = "expected error: √Σ (F − true F)² of the row, as estimated while it was computed";
        columns.add(Field::scale("error", "Expected error", note, true), rows.error.clone());
    }
    let note = "closure error: |sum of F + escaped + blocked − 1|";
    columns.add(Field::scale("closure", "Closure error", note, true), closure);
    if tells(&rows.blocked) {
        let note = "blocked: of what leaves a patch, what ends on the back of a one-sided surface";
        columns.add(Field::scale("blocked", "Blocked", note, false), rows.blocked.clone());
    }
    Ok(columns)
}

fn add_solution(columns: &mut Columns, name: &str, solution: &StoredSolution) -> Result<()> {
    let light = solution.report()["quantity"] == "light";
    for quantity in solution.quantities() {
        let (label, unit) = match quantity {
            "radiosity" => ("Radiosity", ""),
            "flux" => ("Net flux", ", W/m²"),
            "temperature" => ("Temperature", ", K"),
            _ => continue,
        };
        let array = solution.quantity(quantity)?;
        let key = format!("{name}-{quantity}");
        let label = if name == quantity {
            label.to_owned()
        } else {
            format!("{label} ({name})")
        };
        if light && array.rows() == 3 {
            let bands: Vec<String> = ["r", "g", "b"].iter().map(|band| format!("{key}-{band}")).collect();
            for (row, band) in (0..).zip(&bands) {
                columns.numbers.push((band.clone(), array.row(row)?));
            }
            columns.fields.push(Field {
                key,
                label,
                note: "radiosity in red, green and blue; the average over the patches is shown as middle grey"
                    .to_owned(),
                columns: bands,
                scale: false,
                logarithmic: false,
                light: true,
            });
        } else {
            let first = if array.rows() > 1 {
                format!(", the first right-hand side of {}", count(array.rows()))
            } else {
                String::new()
            };
            let note = format!("{}{unit}{first}", label.to_lowercase());
            columns.add(Field::scale(&key, &label, &note, false), array.row(0)?);
        }
    }
    Ok(())
}

/// A table of the worst rows.
struct Worst {
    heading: &'static str,
    columns: Vec<&'static str>,
    /// The patch, and what else is said of it.
    rows: Vec<(u32, Vec<String>)>,
}

fn worst(checked: &CheckReport, rows: &RowTable) -> Vec<Worst> {
    let mut tables = Vec::new();
    if checked.closure.max > 0.0 {
        tables.push(Worst {
            heading: "By closure error",
            columns: vec!["patch", "closure error", "sum of F", "escaped", "blocked"],
            rows: checked
                .worst_rows
                .iter()
                .map(|row| {
                    let facts = vec![
                        figures(row.closure_error),
                        format!("{:.6}", row.row_sum),
                        percent(row.escaped),
                        percent(row.blocked),
                    ];
                    (row.patch, facts)
                })
                .collect(),
        });
    }
    let mut order: Vec<u32> = (0u32..)
        .zip(&rows.error)
        .filter(|(_, error)| **error > 0.0)
        .map(|(patch, _)| patch)
        .collect();
    if !order.is_empty() {
        let error = |patch: u32| rows.error[patch as usize];
        order.sort_by(|&a, &b| error(b).total_cmp(&error(a)).then(a.cmp(&b)));
        order.truncate(WORST_ROWS);
        tables.push(Worst {
            heading: "By expected error",
            columns: vec!["patch", "expected √Σ (F − true F)²", "sum of F"],
            rows: order
                .into_iter()
                .map(|patch| {
                    let facts = vec![figures(error(patch)), format!("{:.6}", rows.row_sum[patch as usize])];
                    (patch, facts)
                })
                .collect(),
        });
    }
    tables
}
