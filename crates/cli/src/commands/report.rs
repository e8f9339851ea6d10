//! `hemicube report`: one page about a matrix, to be opened from the disk.
//!
//! `page.rs` writes one HTML file: sections as text, histograms as SVG, and arrays (`blocks.rs`: deflated, in base64,
//! each in a `<script>` that no browser runs). The entries of each row (`rows.rs`), all of them or the largest, are
//! unpacked 65,536 at a time, on a click. `viewer/` runs in the page. It draws all patches at once without an index, so
//! that a vertex's number gives its patch; colours come from a texture, and the patch under the mouse from one pixel
//! drawn in colours of ids. It is bundled with three.js by `scripts/viewer.sh` and committed, so that the program is
//! built without Node; `./test` bundles it again and compares. The page's own policy forbids it to load anything.
//!
//! No own WebGL in the page, because three.js has turned and zoomed models on every browser for years; the page's own
//! code is only the part special to patches.
//!
//! No zlib-rs in the page, because its output depends on the processor's instructions; miniz_oxide's does not.

mod blocks;
mod columns;
mod geometry;
mod page;
mod plot;
mod rows;
mod worst;

use crate::args::{EngineSettings, Report as ReportArguments, Talk, UpAxis};
use crate::exit::Exit;
use crate::help::examples;
use crate::outputs::Paths;
use crate::picture::sparsity::{Order, Sparsity};
use crate::progress::Bar;
use crate::report::{self, JsonReport, PendingFile, SCHEMA, counted, size};
use crate::stored::{self, Limits};
use anyhow::{Context, Result, bail};
use blocks::Blocks;
use clap::Args;
use columns::{Columns, columns};
use hemicube::Grouping;
use hemicube::analysis::check::verdict::Verdicts;
use hemicube::analysis::check::{CheckOptions, CheckReport, check};
use hemicube::store::{PatchTable, Store};
use rows::RowPacker;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};
use worst::{WORST_ROWS, worst};

/// Number of a row's largest entries in a page that cannot have all.
const ENTRIES: u32 = 32;
/// Bytes of a page that rows may take in full, and those of an entry: a gap and 16 bits, deflated, in base64.
const ROW_BYTES_MAX: u64 = 32_000_000;
const BYTES_PER_ENTRY: u64 = 5;
/// Entries of a row, where all are in the page.
const ALL: u32 = u32::MAX;
/// Above this number of patches, a page has no rows: it would be too large to open.
const PATCHES_WITH_ROWS_MAX: u32 = 250_000;
/// Cells of the picture of the matrix.
const CELLS: u32 = 400;

const EXAMPLES: &str = "  \
  hemicube report room.hemicube
  hemicube report city.hemicube models/city.obj -o city.html";

/// Write one HTML page about a matrix, to be opened from the disk: what it is, whether it holds, the model in 3-D
#[derive(Args, Debug)]
#[command(after_long_help = examples(EXAMPLES, false))]
pub(crate) struct Arguments {
    /// The matrix
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// The scene that it is of [default: the one that the matrix names, beside it or here]
    #[arg(value_name = "SCENE")]
    pub(crate) scene: Option<PathBuf>,
    /// The page: .html [default: DIR's name with .html]
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// Replace what is there
    #[arg(long)]
    pub(crate) overwrite: bool,
    /// A solution to colour the model by (repeatable) [default: all that there are]
    #[arg(long, value_name = "NAME")]
    pub(crate) solution: Vec<String>,
    /// The axis that points up [default: the scene's, or as `inspect` finds it]
    #[arg(long, value_name = "x|y|z", hide_possible_values = true)]
    pub(crate) up: Option<UpAxis>,
    /// Read a scene of which more would come than a file of its size may become (docs/security.md)
    #[arg(long, hide_short_help = true)]
    pub(crate) allow_large: bool,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}

impl Arguments {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default()
            .store([&self.store])
            .reads(&self.scene)
            .writes("-o", [&self.page()], self.overwrite)
    }

    /// The page's file: beside the matrix, unless it is named.
    fn page(&self) -> PathBuf {
        let beside = || self.store.with_extension("html");
        self.output.clone().unwrap_or_else(beside)
    }
}

/// The report of `--json`.
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
    verdicts: &'a Verdicts,
}

#[allow(clippy::cast_possible_truncation, reason = "the page has f32")]
fn narrow(numbers: &[f64]) -> Vec<f32> {
    numbers.iter().map(|&number| number as f32).collect()
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let json = JsonReport::asked(&arguments.report);
    let is_html = |extension: &std::ffi::OsStr| extension.eq_ignore_ascii_case("html");
    let output = arguments.page();
    if !output.extension().is_some_and(is_html) {
        bail!("`{}`: the name of a page ends in .html", output.display());
    }
    report::require_matrix(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    store.require_complete()?;
    let scene = stored::scene_file(&store, arguments.scene.as_deref(), "`hemicube report DIR SCENE`")?;
    let prepared = stored::scene(
        &store,
        &scene,
        &EngineSettings::default(),
        Limits::of(arguments.allow_large),
    )?;
    let up = prepared.up(arguments.up)?;
    prepared.tell_up(arguments.up, talk);
    let bar = Bar::spinner(talk, "checking");
    let checked = checked(&store)?;
    bar.message("reading the rows");
    let entries = entries_per_row(&store, &checked);
    let (table, of_rows) = (store.patches()?, store.row_table()?);
    let rows = read_rows(&store, &table, entries)?;
    let mut columns = columns(&store, &of_rows, rows.seen, &arguments.solution, talk)?;
    columns.add_choices(entries > 0, store.manifest().objects.len() > 1);

    bar.message("writing the page");
    let mut blocks = Blocks::default();
    let bounds = geometry::write(&prepared, &mut blocks);
    add_blocks(&mut blocks, &table, &columns);
    if let Some(grouping) = &prepared.grouping {
        blocks.array("patch-of", grouping.patches());
    }
    let packed = rows.packer.finish(&mut blocks);
    let page = page::Page {
        store: &store,
        checked: &checked,
        worst: worst(&checked, &of_rows),
        columns: &columns,
        sparsity: &rows.sparsity,
        bounds,
        up,
        packed,
        elements: prepared.grouping.as_ref().map(Grouping::elements),
    };
    let text = page.html(&blocks)?;
    write(&output, &text)?;
    drop(bar);
    talk.say(&format!(
        "`{}`: {}, {}, {}",
        output.display(),
        size(text.len() as u64),
        counted(store.patch_count().into(), "patch"),
        if entries == 0 {
            "no rows".to_owned()
        } else if u64::from(entries) >= checked.entries_per_row.max {
            "rows in full".to_owned()
        } else {
            format!("the largest {} of each row", counted(entries.into(), "entry"))
        }
    ));
    if let Some(json) = json {
        json.write(&Summary {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            path: &output,
            bytes: text.len() as u64,
            patches: store.patch_count(),
            entries_per_row: entries,
            fields: columns.fields.iter().map(|field| field.key.as_str()).collect(),
            ok: checked.ok,
            verdicts: &checked.verdicts,
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

#[allow(
    clippy::field_reassign_with_default,
    reason = "the options are open to new fields, so no literal makes them"
)]
fn checked(store: &Store) -> Result<CheckReport> {
    let mut options = CheckOptions::default();
    options.worst_rows = WORST_ROWS;
    Ok(check(store, &options)?)
}

/// Number of entries a row: none above [`PATCHES_WITH_ROWS_MAX`], all within [`ROW_BYTES_MAX`], or
/// [`ENTRIES`]. At most those of the longest row.
fn entries_per_row(store: &Store, checked: &CheckReport) -> u32 {
    let usual = if store.patch_count() > PATCHES_WITH_ROWS_MAX {
        0
    } else if checked.entries * BYTES_PER_ENTRY <= ROW_BYTES_MAX {
        ALL
    } else {
        ENTRIES
    };
    let longest = u32::try_from(checked.entries_per_row.max).unwrap_or(ALL);
    match usual {
        0 => 0,
        entries => entries.min(longest.max(1)),
    }
}

/// Rows of the matrix, for the page.
struct Rows<'a> {
    packer: RowPacker<'a>,
    sparsity: Sparsity,
    /// Entries of each patch's row; NaN without a row.
    seen: Vec<f64>,
}

/// Reads all parts once.
fn read_rows<'a>(store: &Store, table: &'a PatchTable, entries: u32) -> Result<Rows<'a>> {
    let mut rows = Rows {
        packer: RowPacker::new(table, store.manifest().objects.len(), entries as usize),
        sparsity: Sparsity::new(store, Order::Work, CELLS)?,
        seen: vec![f64::NAN; table.len()],
    };
    for place in 0..store.manifest().parts.len() {
        let Some(part) = store.part(place)? else { continue };
        rows.sparsity.add(&part);
        for (row, &patch) in part.rows.iter().enumerate() {
            let (columns, factors) = part.row(row);
            rows.seen[patch as usize] = columns.len() as f64;
            rows.packer.add(patch, columns, factors)?;
        }
    }
    Ok(rows)
}

/// Adds an array for each shown column of the patch table, and for each of `columns`.
fn add_blocks(blocks: &mut Blocks, table: &PatchTable, columns: &Columns) {
    blocks.add("object", &table.object);
    blocks.add("material", &table.material);
    blocks.add("area", &narrow(&table.area));
    for (name, numbers) in &columns.numbers {
        blocks.add(name, &narrow(numbers));
    }
}

fn write(path: &Path, text: &str) -> Result<()> {
    let mut file = PendingFile::create(path)?;
    file.write_all(text.as_bytes())
        .with_context(|| format!("`{}` cannot be written", path.display()))?;
    file.commit()
}
