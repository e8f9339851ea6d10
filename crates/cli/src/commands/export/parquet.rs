//! The matrix as Parquet triplets.

use super::arguments::Arguments;
use crate::args::Talk;
use crate::exit::Exit;
use crate::report::JsonReport;
use anyhow::Result;

#[cfg(not(feature = "parquet"))]
pub(super) fn run(_: &Arguments, _: Option<JsonReport>, _: Talk) -> Result<Exit> {
    Err(crate::exit::hinted(
        anyhow::anyhow!("this program was built without the feature `parquet`"),
        "build it with default features, or write a `.npz`",
    ))
}

#[cfg(feature = "parquet")]
pub(super) fn run(arguments: &Arguments, json: Option<JsonReport>, talk: Talk) -> Result<Exit> {
    use crate::report::{self, SCHEMA, count, counted, size};
    use hemicube::store::Store;
    use hemicube_export::write_parquet;
    use serde::Serialize;
    use std::path::Path;

    #[derive(Serialize)]
    struct Report<'a> {
        schema: u32,
        program: &'static str,
        version: &'static str,
        path: &'a Path,
        format: &'static str,
        patch_count: u32,
        rows: u64,
        entries: u64,
        bytes: u64,
    }

    report::require(&arguments.store)?;
    let store = Store::open(&arguments.store)?;
    let Some(bytes) = super::interruptible(arguments, talk, |options| {
        write_parquet(&store, &arguments.output, arguments.allow_incomplete, options)
    })?
    else {
        return Ok(Exit::Interrupted);
    };
    let manifest = store.manifest();
    let path = arguments.output.display().to_string();
    talk.say(&format!(
        "`{path}`: {}, {} of {} of {}",
        size(bytes),
        counted(manifest.entries, "entry"),
        counted(manifest.rows_present(), "row"),
        count(manifest.patch_count.into()),
    ));
    if !path.contains(['"', '\'', '\\']) {
        talk.say(&format!(
            "DuckDB: SELECT row, sum(value) FROM '{path}' GROUP BY row; F[row, col] is from row to col, counted from 0"
        ));
    }
    if let Some(json) = json {
        json.write(&Report {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            path: &arguments.output,
            format: "parquet",
            patch_count: manifest.patch_count,
            rows: manifest.rows_present(),
            entries: manifest.entries,
            bytes,
        })?;
    }
    Ok(Exit::Done)
}
