//! `hemicube inspect`: the size of a scene, its defects, and the cost of its matrix.
//!
//! The forecast and the statistics come from the hemicubes of a random sample of patches; the forecast's time is the
//! only figure that a clock enters.

mod forecast;
mod report;
mod text;

use crate::args::{ConfigFiles, RenderSettings as RenderArguments, Report as ReportArguments, SceneSettings, Talk};
use crate::clock::processor_seconds;
use crate::exit::Exit;
use crate::help::{SCENE, examples, scene_help};
use crate::outputs::Paths;
use crate::prepare::{RepairCounts, prepare};
use crate::report::{BackendReport, JsonReport, SCHEMA, peak_memory_bytes, print};
use anyhow::{Result, bail};
use clap::Args;
use forecast::forecast;
use hemicube::diagnose::{DiagnoseOptions, SceneStatistics, diagnose};
use hemicube::driver::settings::LossRecord;
use hemicube_scene::survey::survey;
use report::{Report, Timings, diagnosis_report, enclosure_report, octree_report, patch_report, scene_report};
use std::path::PathBuf;
use std::time::Instant;
use text::text;

const EXAMPLES: &str = "  \
  hemicube inspect city.obj
  hemicube inspect city.obj --split 4 --json";

/// Describe a scene: size, area, sides, defects, and what its matrix would cost
#[derive(Args, Debug)]
#[command(override_usage = "hemicube inspect [OPTIONS] SCENE", after_long_help = examples(EXAMPLES, true))]
pub(crate) struct Arguments {
    #[arg(value_name = "SCENE", required_unless_present = "print_config", help = SCENE, long_help = scene_help())]
    pub(crate) scene: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) patches: SceneSettings,
    #[command(flatten)]
    pub(crate) render: RenderArguments,
    /// Which hemicubes the forecast is made from
    #[arg(
        long,
        value_name = "S",
        default_value = "1",
        help_heading = "Hemicubes",
        hide_short_help = true
    )]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) config: ConfigFiles,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}
impl Arguments {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default().reads(&self.scene).reads(&self.config.config)
    }
}

pub(crate) fn run(arguments: Arguments, talk: Talk) -> Result<Exit> {
    // clap requires it; only `--print-config` goes without.
    let Some(path) = arguments.scene.as_deref() else {
        bail!("a scene is needed")
    };
    let json = JsonReport::asked(&arguments.report);
    let mut backend = arguments.render.open_backend(arguments.patches.memory, talk)?;
    let prepared = prepare(path, &arguments.patches, &arguments.render, arguments.render.work())?;
    let (reading, preparing) = (peak_memory_bytes(), processor_seconds());
    let mut surveyed = survey(&prepared.scene, &prepared.scene.repaired);
    if arguments.patches.up.is_some() {
        "`--up` says so".clone_into(&mut surveyed.up_reason);
    }
    let started = Instant::now();
    let options = DiagnoseOptions {
        seed: arguments.seed,
        threads: arguments.render.thread_count(),
        ..DiagnoseOptions::default()
    };
    let diagnosis = diagnosis_report(&prepared, diagnose(&prepared.model, options));
    let enclosure = enclosure_report(&prepared, options);
    let diagnose_seconds = started.elapsed().as_secs_f64();
    let statistics = SceneStatistics::measure(
        &prepared.model,
        backend.as_mut(),
        arguments.render.resolution,
        arguments.seed,
    )?;
    let mut forecast = forecast(
        &prepared.model,
        &arguments.render,
        arguments.seed,
        preparing,
        backend.as_mut(),
    )?;
    // In vast scenes, reading and cutting them takes more than the rows do.
    forecast.memory_bytes = forecast.memory_bytes.max(reading);
    let timed = talk.verbose || !arguments.report.json;
    if !timed {
        (forecast.seconds, forecast.seconds_range) = (None, None);
        forecast.memory_bytes = None;
    }
    let device = backend.info().clone();
    let report = Report {
        schema: SCHEMA,
        program: "hemicube",
        version: env!("CARGO_PKG_VERSION"),
        scene: scene_report(&prepared, surveyed),
        repair: RepairCounts::from(&prepared.scene.repaired),
        losses: prepared
            .scene
            .ledger
            .losses()
            .map(|(what, loss)| LossRecord::of(what, loss))
            .collect(),
        noted: prepared
            .scene
            .ledger
            .notes()
            .map(|(what, count)| (what.to_owned(), count))
            .collect(),
        warnings: prepared.scene.ledger.warnings.clone(),
        crs: prepared.scene.crs.clone(),
        patches: patch_report(&prepared),
        octree: octree_report(&prepared.model),
        diagnosis,
        enclosure,
        backend: BackendReport {
            name: device.name,
            version: device.version,
            device: device.device,
        },
        statistics,
        forecast,
        timings: timed.then_some(Timings {
            load: prepared.load_seconds,
            build: prepared.build_seconds,
            diagnose: diagnose_seconds,
        }),
        peak_memory_bytes: peak_memory_bytes().filter(|_| timed),
        inputs: vec![prepared.input],
    };
    if !arguments.report.json {
        print(&text(&report, talk.verbose))?;
    }
    for warning in &prepared.scene.ledger.sentences() {
        talk.warn(warning);
    }
    if let Some(json) = json {
        json.write(&report)?;
    }
    Ok(Exit::Done)
}
