//! `hemicube merge`: one matrix of several shards.

use crate::args::{Report as ReportArguments, Talk};
use crate::exit::{Exit, hinted};
use crate::help::examples;
use crate::outputs::Paths;
use crate::progress::Bar;
use crate::report::{self, JsonReport, SCHEMA, count, counted};
use crate::shell::word;
use anyhow::{Result, anyhow};
use clap::Args;
use hemicube::store::{Error, merge};
use serde::Serialize;
use std::path::PathBuf;

const EXAMPLES: &str = "  \
  hemicube merge city.hemicube
  hemicube merge city.hemicube /scratch/node1/city.hemicube /scratch/node2/city.hemicube";

/// Make one matrix of what shards computed
#[derive(Args, Debug)]
#[command(override_usage = "hemicube merge [OPTIONS] DIR [FROM]...", after_long_help = examples(EXAMPLES, false))]
pub(crate) struct Arguments {
    /// The directory that the shards wrote to, or that is to hold the whole
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// Other directories that shards wrote to; their parts are copied
    #[arg(value_name = "FROM")]
    pub(crate) sources: Vec<PathBuf>,
    /// Threads that check parts; 0: one for each core
    ///
    /// Results are the same.
    #[arg(long, value_name = "N", default_value = "0", value_parser = clap::value_parser!(u32).range(0..=1024))]
    pub(crate) threads: u32,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}
impl Arguments {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default().store([&self.store]).store(&self.sources)
    }
}

#[derive(Serialize)]
struct Report {
    schema: u32,
    program: &'static str,
    version: &'static str,
    store: String,
    complete: bool,
    parts: usize,
    part_count: u32,
    copied: u32,
    rows: u64,
    entries: u64,
    /// Parts missing or incomplete everywhere.
    missing: Vec<u32>,
    /// Their shards, if the number of shards is known.
    missing_shards: Vec<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    shard_count: Option<u32>,
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let json = JsonReport::asked(&arguments.report);
    if arguments.sources.is_empty() {
        report::require_matrix(&arguments.store)?;
    }
    for source in &arguments.sources {
        report::require_matrix(source)?;
    }
    let threads = match arguments.threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads as usize,
    };
    let bar = Bar::spinner(talk, "merging");
    let merged = merge(&arguments.store, &arguments.sources, threads);
    drop(bar);
    let merged = merged.map_err(|error| match error {
        Error::OtherRun { .. } => hinted(
            error.into(),
            "only shards of one scene, with one set of settings, by one version belong together",
        ),
        error => error.into(),
    })?;
    for file in &merged.not_kept {
        talk.warn(&format!("part {} is not there: {}", file.part, file.reason));
    }
    let manifest = &merged.manifest;
    let missing_shards = merged.missing_shards();
    if let Some(json) = json {
        json.write(&Report {
            schema: SCHEMA,
            program: "hemicube",
            version: env!("CARGO_PKG_VERSION"),
            store: arguments.store.display().to_string(),
            complete: manifest.complete,
            parts: manifest.parts.len(),
            part_count: manifest.part_count,
            copied: merged.copied,
            rows: manifest.rows_present(),
            entries: manifest.entries,
            missing: merged.missing.clone(),
            missing_shards: missing_shards.clone(),
            shard_count: merged.shard_count,
        })?;
    }
    if merged.missing.is_empty() {
        talk.say(&format!(
            "{} with {} are one matrix, `{}`: {}\nNext:\n  hemicube check {}",
            counted(manifest.parts.len() as u64, "part"),
            counted(manifest.rows_present(), "row"),
            arguments.store.display(),
            counted(manifest.entries, "entry"),
            word(&arguments.store)
        ));
        return Ok(Exit::Done);
    }
    let parts = format!(
        "{} of {} are missing: {}",
        count(merged.missing.len() as u64),
        counted(manifest.part_count.into(), "part"),
        ranges(&merged.missing)
    );
    let hint = match merged.shard_count {
        Some(shards) => {
            let list: Vec<String> = missing_shards.iter().map(|shard| format!("{shard}/{shards}")).collect();
            format!(
                "compute with {} again, which goes on where each stopped, and merge then",
                list.iter()
                    .map(|shard| format!("`--shard {shard}`"))
                    .collect::<Vec<_>>()
                    .join(", ")
            )
        }
        None => "`compute` without `--shard` computes what is missing".to_owned(),
    };
    Err(hinted(anyhow!("`{}`: {parts}", arguments.store.display()), hint))
}

/// Ascending numbers, consecutive ones in the form `3-7`.
fn ranges(numbers: &[u32]) -> String {
    let mut text = String::new();
    for run in numbers.chunk_by(|a, b| a + 1 == *b) {
        if !text.is_empty() {
            text.push_str(", ");
        }
        match run {
            [first, .., last] => text.push_str(&format!("{first}-{last}")),
            [one] => text.push_str(&one.to_string()),
            [] => {}
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_numbers_are_ranges() {
        assert_eq!(ranges(&[0, 2, 3, 4, 9, 10]), "0, 2-4, 9-10");
        assert_eq!(ranges(&[]), "");
    }
}
