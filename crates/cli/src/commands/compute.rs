//! `hemicube compute`: the form-factor matrix of a scene, into a store.

mod arguments;

pub(crate) use arguments::Arguments;

use crate::args::{AutoSwitch, RowRange, SampleSize, SelectionSettings, Switch, Talk};
use crate::enclosure;
use crate::exit::{self, Exit, hinted};
use crate::forecast;
use crate::level::{self, Level};
use crate::prepare::{Prepared, RepairCounts, axis_name, prepare};
use crate::progress::{Bar, Status};
use crate::report::{
    self, BackendReport, Input, JsonReport, Listing, SCHEMA, Spread, TEMPORARY_SUFFIX, count, counted, duration,
    figures, percent, size,
};
use crate::shell::word;
use crate::verify::{Verification, Verify};
use anyhow::{Context, Result, anyhow, bail};
use hemicube::Model;
use hemicube::backend::{Counters, Culling, HemicubeBackend, RenderSettings};
use hemicube::driver::compute::{Execution, PartSink, Plan, RowChoice, Selection, Summary, compute};
use hemicube::driver::probe::{Probe, share_left};
use hemicube::driver::settings::RowSettings;
use hemicube::driver::storage_policy::StoragePolicy;
use hemicube::store::{
    Error as StoreError, Form, Kept, Manifest, Part, PatchTable, Shard, Store, StoreWriter, Thinning,
};
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// The report of `--json`.
#[derive(Serialize)]
struct Report {
    schema: u32,
    program: &'static str,
    version: &'static str,
    inputs: Vec<Input>,
    scene: SceneReport,
    settings: RowSettings,
    backend: BackendReport,
    culling: &'static str,
    threads: usize,
    repair: RepairCounts,
    store: String,
    form: Form,
    /// By how much of itself a form factor may be off what was computed, by the store's form.
    value_error: f64,
    bytes: u64,
    complete: bool,
    /// Which share of the rows this is.
    #[serde(skip_serializing_if = "Option::is_none")]
    shard: Option<String>,
    parts: u64,
    /// Those of them that an earlier run had computed.
    parts_kept: u32,
    part_count: u64,
    rows: u64,
    rows_kept: u64,
    row_count: u64,
    entries: u64,
    row_sum: Spread,
    escaped: f64,
    blocked: f64,
    unselected: f64,
    rows_mostly_blocked: u64,
    closure: f64,
    /// Relative Frobenius error that the rows are expected to have, where their rung estimates it.
    #[serde(skip_serializing_if = "Option::is_none")]
    expected_error: Option<f64>,
    /// What leaving out small form factors did, where that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    thinning: Option<Thinning>,
    /// Rays and points that visible fractions were measured with.
    rays: u64,
    /// Entries computed by this run that are a visible fraction of a closed form, not a sum of pixels.
    corrected: u64,
    /// Pairs among them of which a part only is visible.
    partial: u64,
    /// Rows of this run that their budget of work ended before all pairs worth it were measured.
    cut_short: u64,
    /// The row of this run that took longest.
    #[serde(skip_serializing_if = "Option::is_none")]
    slowest_row: Option<SlowestRow>,
    /// Rows of this run by second.
    #[serde(skip_serializing_if = "Option::is_none")]
    rows_per_second: Option<f64>,
    /// Numbers of rows by what they took.
    effort: Effort,
    counters: Counters,
    #[serde(skip_serializing_if = "Option::is_none")]
    verification: Option<Verification>,
    #[serde(skip_serializing_if = "Option::is_none")]
    timings: Option<Timings>,
    #[serde(skip_serializing_if = "Option::is_none")]
    peak_memory_bytes: Option<u64>,
}

/// Rows that take longer than so many seconds are named.
const LONG_ROW: f64 = 0.5;

#[derive(Clone, Copy, Debug, Serialize)]
struct SlowestRow {
    patch: u32,
    seconds: f64,
}

/// Histograms over rows: where the effort went.
#[derive(Clone, Debug, Default, Serialize)]
struct Effort {
    /// Rows by the hemicubes they took.
    hemicubes: std::collections::BTreeMap<u32, u64>,
    /// Rows by the rays and points their visible fractions took: up to this many, powers of 4, and more than the last
    /// before.
    rays: std::collections::BTreeMap<u64, u64>,
}

impl Effort {
    fn add(&mut self, hemicubes: u32, rays: u32) {
        *self.hemicubes.entry(hemicubes).or_default() += 1;
        let mut most = u64::from(rays.min(1));
        while most < u64::from(rays) {
            most *= 4;
        }
        *self.rays.entry(most).or_default() += 1;
    }

    /// `12 up to 0, 3 up to 64`.
    fn text(&self) -> String {
        let list: Vec<String> = self
            .rays
            .iter()
            .map(|(&most, &rows)| format!("{} up to {}", count(rows), count(most)))
            .collect();
        list.join(", ")
    }
}

#[derive(Serialize)]
struct SceneReport {
    triangles: u64,
    triangles_used: u64,
    surfaces: u64,
    patches: u64,
    area: f64,
    objects: u64,
    materials: u64,
    up: Option<&'static str>,
    metres_per_unit: Option<f64>,
}

/// Seconds. Parts are written while rows are computed, so that `write` is in part within `rows`.
#[derive(Clone, Copy, Debug, Default, Serialize)]
struct Timings {
    load: f64,
    build: f64,
    /// Finding what keeps a tolerance.
    settle: f64,
    rows: f64,
    write: f64,
    verify: f64,
}

/// Keeps parts, and what their rows come to.
struct Recorder {
    writer: StoreWriter,
    tally: Tally,
}

/// What rows come to, those of an earlier run included.
#[derive(Debug)]
struct Tally {
    parts: u64,
    rows: u64,
    entries: u64,
    rays: u64,
    squared_error: f64,
    squared_norm: f64,
    /// Rows that were rendered.
    rendered: u64,
    sum: f64,
    min: f64,
    max: f64,
    closure: f64,
    mostly_blocked: u64,
    effort: Effort,
    escaped: f64,
    blocked: f64,
    unselected: f64,
}

impl PartSink for Recorder {
    fn take(&mut self, part: Part) -> Result<(), hemicube::store::Error> {
        self.writer.write_part(&part)?;
        self.tally.add(&part);
        Ok(())
    }
}

impl Tally {
    fn new() -> Self {
        Self {
            parts: 0,
            rows: 0,
            entries: 0,
            rays: 0,
            squared_error: 0.0,
            squared_norm: 0.0,
            rendered: 0,
            sum: 0.0,
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            closure: 0.0,
            mostly_blocked: 0,
            effort: Effort::default(),
            escaped: 0.0,
            blocked: 0.0,
            unselected: 0.0,
        }
    }

    fn add(&mut self, part: &Part) {
        self.parts += 1;
        self.rows += part.rows.len() as u64;
        self.entries += part.data.len() as u64;
        self.rays += part.rays.iter().map(|&rays| u64::from(rays)).sum::<u64>();
        let estimated = part.errors.iter().filter(|error| !error.is_nan());
        self.squared_error += estimated.map(|&error| f64::from(error).powi(2)).sum::<f64>();
        self.squared_norm += part.data.iter().map(|&factor| f64::from(factor).powi(2)).sum::<f64>();
        for (row, (shares, &hemicubes)) in part.shares.iter().zip(&part.hemicubes).enumerate() {
            if hemicubes == 0 {
                continue;
            }
            let lost = shares.to_array();
            // From 0: the sum of nothing is −0, which reads oddly in a report.
            let sum = part.row(row).1.iter().fold(0.0, |sum, &factor| sum + f64::from(factor));
            self.rendered += 1;
            self.effort.add(hemicubes, part.rays.get(row).copied().unwrap_or(0));
            self.sum += sum;
            self.min = self.min.min(sum);
            self.max = self.max.max(sum);
            self.closure = self.closure.max((sum + lost.iter().sum::<f64>() - 1.0).abs());
            self.mostly_blocked += u64::from(lost[1] > 0.5);
            self.escaped += lost[0];
            self.blocked += lost[1];
            self.unselected += lost[2];
        }
    }

    /// Relative Frobenius error that the rows are expected to have, where their rung estimates it.
    fn expected_error(&self) -> Option<f64> {
        let relative = (self.squared_error / self.squared_norm).sqrt();
        (self.squared_error > 0.0 && relative.is_finite()).then_some(relative)
    }

    fn mean(&self, sum: f64) -> f64 {
        if self.rendered == 0 {
            0.0
        } else {
            sum / self.rendered as f64
        }
    }

    fn row_sum(&self) -> Spread {
        if self.rendered == 0 {
            return Spread::default();
        }
        Spread {
            min: self.min,
            mean: self.mean(self.sum),
            max: self.max,
        }
    }
}

pub(crate) fn run(arguments: Arguments, talk: Talk) -> Result<Exit> {
    // clap requires both; only `--print-config` goes without.
    let (Some(scene_path), Some(directory)) = (arguments.scene.as_deref(), arguments.output.as_deref()) else {
        bail!("a scene and `--output` are needed");
    };
    let cancel = exit::watch_interrupts().context("Ctrl-C cannot be watched")?;
    let shard = arguments
        .process
        .shard
        .map(|choice| crate::shard::shard(choice, &|name| std::env::var(name).ok()))
        .transpose()?
        .map(|(shard, said)| {
            talk.say(&match said {
                Some(said) => format!("shard {shard}, by {said}"),
                None => format!("shard {shard}"),
            });
            shard
        });
    let json = JsonReport::open(&arguments.report)?;
    let backend = arguments.render.open_backend(talk)?;
    check_place(directory)?;
    let status = Status::open(arguments.process.progress_file.as_deref())?;
    let result = compute_into(
        &arguments, scene_path, directory, backend, cancel, shard, json, &status, talk,
    );
    status.end(match &result {
        Ok(Exit::Interrupted) => "interrupted",
        Ok(_) => "done",
        Err(_) => "failed",
    });
    exit::remove_unused();
    result
}

#[allow(
    clippy::too_many_arguments,
    reason = "called once: what was opened before the scene is read"
)]
fn compute_into(
    arguments: &Arguments,
    scene_path: &Path,
    directory: &Path,
    mut backend: Box<dyn HemicubeBackend>,
    cancel: &std::sync::atomic::AtomicBool,
    shard: Option<Shard>,
    json: Option<JsonReport>,
    status: &Status,
    talk: Talk,
) -> Result<Exit> {
    let mut timings = Timings::default();
    let stage = status.stage("load");
    let mut prepared = prepare(
        scene_path,
        &arguments.patches,
        &arguments.render,
        arguments.process.memory,
    )?;
    drop(stage);
    let selection = crate::selection::selection(&prepared.scene, &prepared.patches, &arguments.selection)?;
    #[allow(clippy::cast_possible_truncation, reason = "at most 2³¹ patches")]
    let keep = StoragePolicy::choose(
        arguments.store.form(),
        arguments.min_factor,
        prepared.patches.len() as u32,
        arguments.render.tolerance.map(|tolerance| tolerance.0),
    );
    let stage = status.stage("settle");
    let started = Instant::now();
    // A session of its own, so that what is settled and what is computed do not share a loaded scene.
    let rung = level::choose(
        &prepared.model,
        &selection,
        &arguments.render,
        arguments.render.rotation == Switch::On,
        keep.form,
        arguments.render.open_backend(Talk::SILENT)?.as_mut(),
    )?;
    timings.settle = started.elapsed().as_secs_f64();
    drop(stage);
    let stage = status.stage("build");
    let (mut plan, rows) = plan(&prepared.model, selection, arguments, &rung, &keep)?;
    let mut threads = arguments.render.thread_count();
    prepared.tell(talk);
    for reason in [&rung.reason, &keep.reason].into_iter().flatten() {
        talk.say(reason);
    }

    let started = Instant::now();
    let mut render = RenderSettings {
        resolution: rung.resolution,
        culling: Culling::On,
        covered: false,
    };
    if arguments.culling == AutoSwitch::Off {
        render.culling = Culling::Off;
    }
    let probe = Probe::render(&prepared.model, &plan, render, backend.as_mut())?;
    if arguments.culling == AutoSwitch::Auto {
        render.culling = culling(probe, talk);
    }
    // What it chooses by the scene is part of what the store is made with.
    hemicube::driver::compute::load(&prepared.model, &plan.correction, render, backend.as_mut())?;
    // Before memory is asked for: rows would build it.
    plan.correction.prepare(&prepared.model);
    let device = backend.info().clone();
    talk.say(&format!(
        "backend {} {} ({}), {}, {}",
        device.name,
        device.version,
        device.device,
        counted(threads as u64, "thread"),
        counted(prepared.patches.len() as u64, "patch"),
    ));
    for choice in backend.choices() {
        talk.say(&choice);
    }
    let rows_of_run = forecast::Rows {
        entries_per_row: probe.entries_per_row,
        rows_per_part: plan.rows_per_part,
        rows_per_batch: match arguments.batch {
            0 => u32::try_from(device.preferred_rows).unwrap_or(u32::MAX),
            rows => rows,
        },
    };
    if let Some(limit) = arguments.process.memory {
        threads = keep_within(limit, threads, rows_of_run, talk)?;
    }
    drop(stage);
    timings.load = prepared.load_seconds;
    timings.build = prepared.build_seconds + started.elapsed().as_secs_f64();

    let settings = row_settings(arguments, &prepared, rows, &rung, &plan);
    let area = prepared.patches.iter().map(|patch| prepared.patches.area(patch)).sum();
    // From here to the last manifest an interrupt waits, so that what it leaves is a store.
    let guard = exit::InterruptGuard::new();
    let started = Instant::now();
    let stage = status.stage("store");
    let mut tally = Tally::new();
    let (writer, kept) = open_store(
        arguments,
        &prepared,
        &plan,
        &settings,
        backend.as_ref(),
        directory,
        shard,
        &mut tally,
    )?;
    drop(stage);
    tell_kept(&writer, &kept, directory, talk);
    let missing = writer.missing_parts();
    warn_of_disk(
        directory,
        rows_of_parts(&writer, &missing),
        probe.entries_per_row,
        &plan,
        talk,
    );
    plan = plan.with_parts(|part| missing.binary_search(&part).is_ok());
    timings.write = started.elapsed().as_secs_f64();
    let scene = SceneReport {
        triangles: prepared.triangles_read,
        triangles_used: prepared.scene.triangles.len() as u64,
        surfaces: prepared.patches.surfaces().len() as u64,
        patches: prepared.patches.len() as u64,
        area,
        objects: prepared.scene.objects.len() as u64,
        materials: prepared.scene.materials.len() as u64,
        up: prepared.scene.up.map(axis_name),
        metres_per_unit: prepared.scene.metres_per_unit,
    };
    let objects = enclosure::objects(&prepared);
    // Not needed any more, and as large as the patches.
    prepared.scene.triangles = Vec::new();

    let mut recorder = Recorder { writer, tally };
    let all_rows = rows_of_parts(&recorder.writer, &missing) + kept.rows;
    let bar = Bar::rows(talk, all_rows, kept.rows);
    let stage = status.rows(all_rows, kept.rows);
    let execution = Execution {
        threads,
        batch: arguments.batch as usize,
        cancel: Some(cancel),
    };
    let started = Instant::now();
    let computed = compute(
        &prepared.model,
        &plan,
        render,
        backend,
        execution,
        &mut recorder,
        &mut |p| {
            bar.show(p);
            stage.show(p);
        },
    );
    drop(bar);
    drop(stage);
    let summary = match computed {
        Ok(summary) => summary,
        Err(error) => {
            return Err(keep_what_is_there(
                anyhow::Error::new(error),
                recorder.writer,
                recorder.tally.parts,
            ));
        }
    };
    timings.rows = summary.elapsed.as_secs_f64();
    timings.build += (started.elapsed().as_secs_f64() - timings.rows).max(0.0);

    let started = Instant::now();
    let stage = status.stage("finish");
    let Recorder { writer, mut tally } = recorder;
    let means = [tally.escaped, tally.blocked, tally.unselected].map(|sum| tally.mean(sum));
    let effort = std::mem::take(&mut tally.effort);
    let manifest = if summary.cancelled {
        writer.interrupt()
    } else {
        writer.finish()
    }?;
    drop(stage);
    drop(guard);
    timings.write += summary.sink.as_secs_f64() + started.elapsed().as_secs_f64();

    let [escaped, blocked, unselected] = means;
    let row_sum = tally.mean(tally.sum);
    let wound = if tally.rendered > 0 && enclosure::is_odd(prepared.scene.objects.len(), [row_sum, escaped, blocked]) {
        enclosure::questions(&prepared, &objects, [row_sum, blocked], threads)
    } else {
        Vec::new()
    };
    let mut report = Report {
        schema: SCHEMA,
        program: "hemicube",
        version: env!("CARGO_PKG_VERSION"),
        inputs: vec![prepared.input],
        scene,
        settings,
        backend: BackendReport {
            name: device.name,
            version: device.version,
            device: device.device,
        },
        culling: if render.culling == Culling::On { "on" } else { "off" },
        threads: summary.threads,
        repair: RepairCounts::from(&prepared.repaired),
        store: directory.display().to_string(),
        form: manifest.form,
        value_error: manifest.value_error,
        bytes: bytes_of(directory, &manifest),
        complete: manifest.complete,
        shard: shard.map(|shard| shard.to_string()),
        parts: tally.parts,
        parts_kept: kept.parts,
        part_count: u64::from(kept.parts) + missing.len() as u64,
        rows: tally.rows,
        rows_kept: kept.rows,
        row_count: all_rows,
        entries: tally.entries,
        row_sum: tally.row_sum(),
        escaped,
        blocked,
        unselected,
        rows_mostly_blocked: tally.mostly_blocked,
        closure: tally.closure,
        expected_error: tally.expected_error(),
        thinning: manifest.thinning,
        rays: tally.rays,
        corrected: summary.corrected,
        partial: summary.partial,
        cut_short: summary.cut_short,
        slowest_row: summary
            .slowest
            .filter(|_| !arguments.report.no_timings)
            .map(|(patch, took)| SlowestRow {
                patch: patch.0,
                seconds: took.as_secs_f64(),
            }),
        rows_per_second: (summary.elapsed.as_secs_f64() > 0.0 && !arguments.report.no_timings)
            .then(|| summary.rows as f64 / summary.elapsed.as_secs_f64()),
        effort,
        counters: summary.counters,
        verification: None,
        timings: (!arguments.report.no_timings).then_some(timings),
        peak_memory_bytes: report::peak_memory_bytes().filter(|_| !arguments.report.no_timings),
    };
    talk.say(summarise(&report, &summary, directory).trim_end());
    for sentence in wound {
        talk.warn(&sentence);
    }
    if let (Some(tolerance), Some(error), Some(thinning)) =
        (arguments.render.tolerance, report.expected_error, report.thinning)
        && error > tolerance.0
    {
        talk.warn(&format!(
            "the expected error, {}, is above the tolerance with form factors below {} left out; a smaller \
             `--min-factor` keeps it",
            percent(error),
            figures(thinning.min_factor)
        ));
    }
    let mut exit = if summary.cancelled {
        Exit::Interrupted
    } else {
        Exit::Done
    };
    if let (Some(wanted), Exit::Done) = (arguments.verify, exit) {
        let _stage = status.stage("verify");
        let started = Instant::now();
        let verify = Verify {
            rows: wanted,
            seed: arguments.selection.seed,
            tolerance: arguments.render.tolerance,
            threads,
            cancel,
        };
        let verification = verify.run(&prepared.model, &plan, &Store::open(directory)?, talk)?;
        talk.say(verification.text().trim_end());
        exit = verification.exit();
        report.verification = Some(verification);
        if let Some(timings) = &mut report.timings {
            timings.verify = started.elapsed().as_secs_f64();
        }
    }
    if let Some(json) = json {
        json.write(&report)?;
    }
    Ok(exit)
}

/// Refuses a place that cannot become a store, before a large scene is read; makes the directory. The store's writer
/// has the last word.
fn check_place(directory: &Path) -> Result<()> {
    let shown = directory.display();
    match std::fs::metadata(directory) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            std::fs::create_dir_all(directory).with_context(|| format!("`{shown}` cannot be created"))?;
            exit::made_for_later(directory);
        }
        Err(error) => return Err(error).with_context(|| format!("`{shown}` cannot be read")),
        Ok(metadata) if !metadata.is_dir() => {
            bail!("`{shown}` is a file, and a matrix is written to a directory; choose another name");
        }
        Ok(_) if directory.join("manifest.json").exists() => {}
        Ok(_) => {
            let entries = std::fs::read_dir(directory).with_context(|| format!("`{shown}` cannot be read"))?;
            for entry in entries {
                let name = entry.with_context(|| format!("`{shown}` cannot be read"))?.file_name();
                if name != "parts" && !name.to_string_lossy().ends_with(TEMPORARY_SUFFIX) {
                    bail!(
                        "`{shown}` is a directory that holds something else (`{}`); choose another name",
                        name.to_string_lossy()
                    );
                }
            }
        }
    }
    let tried = hemicube::store::TemporaryFile::create(&directory.join("probe"));
    if tried.is_err() {
        exit::remove_unused();
    }
    tried.map(drop).with_context(|| format!("`{shown}` cannot be written"))
}

/// The rows that the settings ask for.
fn plan(
    model: &Model,
    selection: Selection,
    arguments: &Arguments,
    rung: &Level,
    keep: &StoragePolicy,
) -> Result<(Plan, RowChoice)> {
    #[allow(clippy::cast_possible_truncation, reason = "at most 2³¹ patches")]
    let patch_count = model.patches().len() as u32;
    let emitting = selection.emitters.as_ref().map_or(u64::from(patch_count), |emitters| {
        emitters.iter().filter(|&&emits| emits).count() as u64
    });
    let SelectionSettings {
        rows,
        sample_rows,
        seed,
        ..
    } = &arguments.selection;
    let choice = match (*rows, *sample_rows) {
        (Some(RowRange { start, end }), _) => {
            let end = end.unwrap_or(patch_count);
            if start >= end || end > patch_count {
                bail!(
                    "`--rows {start}..{end}`: the scene has {}, from 0 on",
                    counted(patch_count.into(), "patch")
                );
            }
            RowChoice::Range { start, end }
        }
        (None, Some(size)) => {
            let wanted = match size {
                SampleSize::Count(number) => u64::from(number),
                #[allow(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "up to the patch count"
                )]
                SampleSize::Percent(percent) => (percent / 100.0 * emitting as f64).ceil() as u64,
            };
            let sampled = u32::try_from(wanted.min(emitting)).unwrap_or(patch_count);
            RowChoice::Sample {
                count: sampled,
                seed: *seed,
            }
        }
        (None, None) => RowChoice::All,
    };
    let plan = Plan::new(
        model,
        choice,
        selection,
        rung.samples_per_edge,
        arguments.render.rotation == Switch::On,
    )
    .with_correction(rung.correction)
    .with_min_factor(keep.min_factor)
    .with_form(keep.form);
    if plan.rows.is_empty() {
        bail!("no row is left to compute: `--rows`, `--emitters` and `--occluders` together exclude every patch");
    }
    Ok((plan, choice))
}

/// Threads with which the run keeps within a limit of memory.
fn keep_within(limit: u64, threads: usize, rows: forecast::Rows, talk: Talk) -> Result<usize> {
    let Some(resident) = report::resident_memory_bytes() else {
        talk.warn("this system does not tell how much memory is in use: `--memory` is not kept");
        return Ok(threads);
    };
    // What reading the scene took is over, and was too much all the same.
    let peak = report::peak_memory_bytes().unwrap_or(0);
    if peak > limit {
        return Err(hinted(
            anyhow!("`--memory` of {}: reading the scene took {}", size(limit), size(peak)),
            "give it more, or cut the scene",
        ));
    }
    let Some(within) = forecast::threads_within(limit, resident, threads, rows) else {
        return Err(hinted(
            anyhow!(
                "`--memory` of {}: the scene alone takes {}, and with one thread it would be about {}",
                size(limit),
                size(resident),
                size(forecast::memory(resident, 1, rows))
            ),
            "give it more, or cut the scene",
        ));
    };
    if within < threads {
        talk.say(&format!(
            "{} of {threads}, to keep within {} of memory",
            counted(within as u64, "thread"),
            size(limit)
        ));
    }
    Ok(within)
}

/// Says when the disk will probably not do. The run begins all the same: it goes on when there is room.
fn warn_of_disk(directory: &Path, rows: u64, entries_per_row: f64, plan: &Plan, talk: Talk) {
    let wanted = forecast::disk(rows, entries_per_row, plan.form);
    let Some(available) = forecast::available(directory).filter(|&available| available < wanted) else {
        return;
    };
    let at_most = if plan.min_factor > 0.0 { "up to " } else { "" };
    let compact = if plan.form == Form::Plain {
        "`--store compact` takes a third to a quarter of that, "
    } else {
        ""
    };
    talk.warn(&format!(
        "{} will take {at_most}about {}, and the disk of `{}` has {} left; {compact}a larger `--min-factor` less",
        counted(rows, "row"),
        size(wanted),
        directory.display(),
        size(available)
    ));
}

/// Returns whether culling pays in this scene, said.
fn culling(probe: Probe, talk: Talk) -> Culling {
    let culling = probe.culling();
    talk.say(&format!(
        "culling {}: it leaves {} of the triangles in {}",
        if culling == Culling::On { "on" } else { "off" },
        percent(probe.left),
        counted(probe.hemicubes, "trial hemicube"),
    ));
    culling
}

fn row_settings(arguments: &Arguments, prepared: &Prepared, rows: RowChoice, rung: &Level, plan: &Plan) -> RowSettings {
    let Arguments {
        patches,
        render,
        selection,
        ..
    } = arguments;
    RowSettings {
        resolution: rung.resolution,
        samples: u32::try_from(plan.hemicubes_per_row()).unwrap_or(u32::MAX),
        correction: rung.correction.name(),
        tolerance: render.tolerance.map(|tolerance| tolerance.0),
        reason: rung.reason.clone(),
        rotation: render.rotation == Switch::On,
        subdivision: patches.subdivision().into(),
        two_sided: match patches.two_sided {
            AutoSwitch::Auto => "auto",
            AutoSwitch::On => "on",
            AutoSwitch::Off => "off",
        },
        flip: patches.flip.clone(),
        keep_duplicates: patches.keep_duplicates == Switch::On,
        scale: patches.scale,
        up: prepared.scene.up.map(axis_name),
        rows: rows.into(),
        emitters: selection.emitters.clone(),
        receivers: selection.receivers.clone(),
        occluders: selection.occluders.clone(),
        min_factor: (plan.min_factor > 0.0).then_some(plan.min_factor),
    }
}

/// Makes the store, or opens the one that is there to go on with it.
#[allow(
    clippy::too_many_arguments,
    reason = "called once: everything that a store's header says"
)]
fn open_store(
    arguments: &Arguments,
    prepared: &Prepared,
    plan: &Plan,
    settings: &RowSettings,
    backend: &dyn HemicubeBackend,
    directory: &Path,
    shard: Option<Shard>,
    tally: &mut Tally,
) -> Result<(StoreWriter, Kept)> {
    let scene = &prepared.scene;
    let file = Path::new(&prepared.input.path);
    let header = settings.header(scene, &prepared.patches, file, plan, backend.info())?;
    let table = PatchTable::new(scene, &prepared.patches);
    if arguments.overwrite {
        return Ok((StoreWriter::create(directory, header, &table, true)?, Kept::default()));
    }
    let threads = arguments.render.thread_count();
    StoreWriter::resume(directory, header, &table, shard, threads, &mut |part| tally.add(part)).map_err(|error| {
        match error {
            StoreError::OtherRun { .. } => hinted(
                error.into(),
                "the same scene and settings go on with it; `--overwrite` replaces it; another name leaves it",
            ),
            StoreError::Malformed { .. } => hinted(error.into(), "`--overwrite` replaces the store"),
            StoreError::Io { .. } => hinted(
                error.into(),
                "no part was touched; try again when the disk can be read, or remove the file: its part is computed again",
            ),
            error => error.into(),
        }
    })
}

/// Says what of an earlier run is kept, and what is not.
fn tell_kept(writer: &StoreWriter, kept: &Kept, directory: &Path, talk: Talk) {
    if !writer.is_locked() {
        talk.warn(&format!(
            "the file system of `{}` has no locks: see to it that nothing else writes there",
            directory.display()
        ));
    }
    for file in &kept.not_kept {
        talk.warn(&format!("part {} is computed again: {}", file.part, file.reason));
    }
    if kept.is_complete {
        talk.say(&format!(
            "`{}` is complete and as it was written: there is nothing to compute",
            directory.display()
        ));
    } else if kept.parts > 0 {
        talk.say(&format!(
            "going on with `{}`: {} with {} are there",
            directory.display(),
            counted(kept.parts.into(), "part"),
            counted(kept.rows, "row"),
        ));
    }
}

/// The rows of some parts.
fn rows_of_parts(writer: &StoreWriter, parts: &[u32]) -> u64 {
    let of = |&part: &u32| u64::from(writer.manifest().rows_of_part(part));
    parts.iter().map(of).sum()
}

/// A computation failed: names the parts that are on the disk in the manifest, and says so.
fn keep_what_is_there(error: anyhow::Error, writer: StoreWriter, parts: u64) -> anyhow::Error {
    let directory = word(writer.directory());
    let part_count = parts + writer.missing_parts().len() as u64;
    if parts == 0 {
        return hinted(
            error,
            format!("nothing was computed yet; `{directory}` holds an empty matrix"),
        );
    }
    match writer.interrupt() {
        Ok(_) => hinted(
            error,
            format!(
                "{parts} of {part_count} parts are kept, and the same command goes on there; `hemicube check {directory} \
                 --allow-incomplete` looks at them"
            ),
        ),
        Err(_) => hinted(
            error,
            format!(
                "{parts} of {part_count} parts are kept in `{directory}`, though its manifest could not name them; the same \
                 command goes on there"
            ),
        ),
    }
}

/// What a store takes on the disk.
fn bytes_of(directory: &Path, manifest: &Manifest) -> u64 {
    let files = manifest.parts.iter().map(|part| part.file.as_str());
    files
        .chain(manifest.patches.iter().map(|table| table.file.as_str()))
        .chain(["manifest.json"])
        .filter_map(|file| std::fs::metadata(directory.join(file)).ok())
        .map(|metadata| metadata.len())
        .sum()
}

/// What a person wants to know of a run.
fn summarise(report: &Report, summary: &Summary, directory: &Path) -> String {
    let shown = word(directory);
    let mut list = Listing::default();
    list.add(
        "rows",
        if report.rows == report.scene.patches {
            format!("{}, one for each patch", count(report.rows))
        } else if report.rows == report.row_count {
            format!("{} of {}", count(report.rows), counted(report.scene.patches, "patch"))
        } else {
            format!(
                "{} of {} that were to be computed",
                count(report.rows),
                count(report.row_count)
            )
        },
    );
    let per_row = report.entries as f64 / (report.rows.max(1) as f64);
    list.add(
        "entries",
        format!(
            "{}: {} a row, {} of a full matrix's",
            count(report.entries),
            figures(per_row),
            percent(per_row / report.scene.patches.max(1) as f64)
        ),
    );
    if let Some(thinning) = report.thinning {
        list.add(
            "left out",
            format!(
                "{} below {}, with {} of what all carry; the others carry it now, {} times as large at most{}",
                counted(thinning.entries_dropped, "entry"),
                figures(thinning.min_factor),
                percent(thinning.mass_dropped),
                figures(thinning.scale_max),
                match thinning.rows_kept_whole {
                    0 => String::new(),
                    rows => format!("; {} kept all, having little else", counted(rows, "row")),
                }
            ),
        );
        list.add(
            "closure",
            format!(
                "error of the worst row {} before and {} after, root mean square {} and {}",
                figures(thinning.closure_max_before),
                figures(thinning.closure_max_after),
                figures(thinning.closure_rms_before),
                figures(thinning.closure_rms_after)
            ),
        );
    }
    if let Some(error) = report.expected_error {
        list.add(
            "error",
            format!(
                "{} expected, by {} rays a row (`--verify ROWS` measures it)",
                percent(error),
                figures(report.rays as f64 / report.rows.max(1) as f64)
            ),
        );
        list.add("rays", format!("rows by rays: {}", report.effort.text()));
    }
    let sum = report.row_sum;
    list.add(
        "row sums",
        format!("{:.4} on average, from {:.4} to {:.4}", sum.mean, sum.min, sum.max),
    );
    list.add(
        "escaped",
        format!("{} of what leaves a patch leaves the scene", percent(report.escaped)),
    );
    list.add(
        "blocked",
        format!("{} ends on backs of one-sided surfaces", percent(report.blocked)),
    );
    if report.unselected > 0.0 {
        list.add(
            "unselected",
            format!("{} ends on patches that have no column", percent(report.unselected)),
        );
    }
    if report.corrected > 0 {
        list.add(
            "partial",
            format!(
                "{} of the pairs are visible in part; {} are corrected: a visible fraction of a closed form",
                percent(report.partial as f64 / report.corrected as f64),
                counted(report.corrected, "entry")
            ),
        );
    }
    if report.cut_short > 0 {
        list.add(
            "budget",
            format!(
                "{} met the bound on their work before all pairs worth it were measured{}",
                counted(report.cut_short, "row"),
                if report.expected_error.is_some() {
                    "; their expected error says so"
                } else {
                    ""
                }
            ),
        );
    }
    let seconds = summary.elapsed.as_secs_f64();
    let rate = if seconds > 0.0 {
        summary.hemicubes as f64 / seconds
    } else {
        0.0
    };
    let culled = 1.0
        - share_left(
            &report.counters,
            usize::try_from(report.scene.surfaces).unwrap_or(usize::MAX),
        );
    let per_second = if seconds > 0.0 {
        summary.rows as f64 / seconds
    } else {
        0.0
    };
    if summary.rows > 0 {
        list.add(
            "time",
            format!(
                "{}, {} rows/s, {} hemicubes/s{}{}",
                duration(seconds),
                figures(per_second),
                figures(rate),
                if report.culling == "on" {
                    format!("; culling spared {} of the triangles", percent(culled))
                } else {
                    String::new()
                },
                match report.slowest_row {
                    Some(SlowestRow { patch, seconds }) if seconds > LONG_ROW =>
                        format!("; the slowest row, of patch {patch}, took {}", duration(seconds)),
                    _ => String::new(),
                }
            ),
        );
    }
    if let Some(peak) = report.peak_memory_bytes {
        list.add("memory", format!("{} at most", size(peak)));
    }
    let form = match report.form {
        Form::Plain => String::new(),
        Form::Compact => format!(
            ", compact: form factors within {} of themselves",
            percent(report.value_error)
        ),
    };
    list.add(
        "matrix",
        format!("`{}`, {}{form}", directory.display(), size(report.bytes)),
    );
    let mut text = list.text();
    if report.rows_mostly_blocked > 0 {
        text.push_str(&format!(
            "warning: {} the back of one-sided surfaces in more than half of the view: wrong winding, or patches inside \
             solids? `--two-sided on` makes every side a patch\n",
            if report.rows_mostly_blocked == 1 {
                "1 row sees".to_owned()
            } else {
                format!("{} rows see", count(report.rows_mostly_blocked))
            }
        ));
    }
    if summary.cancelled {
        text.push_str(&format!(
            "interrupted: {} of {} are kept; the same command goes on there, and `hemicube check {shown} \
             --allow-incomplete` looks at them\n",
            count(report.parts),
            counted(report.part_count, "part")
        ));
    } else if let Some(shard) = &report.shard {
        text.push_str(&format!(
            "shard {shard} is done. When all are:\n  hemicube merge {shown}\n"
        ));
    } else {
        let name = directory
            .file_stem()
            .map_or_else(|| "matrix".to_owned(), |name| name.to_string_lossy().into_owned());
        let export = word(format!("{name}.npz").as_ref());
        text.push_str(&format!(
            "Next:\n  hemicube check {shown}\n  hemicube export {shown} {export}\n"
        ));
        // Names that would need quoting in two languages at once are left to who chose them.
        if !name.contains(['"', '\'', '\\']) {
            text.push_str(&format!(
                "  python3 -c 'import scipy.sparse as s; print(s.load_npz(\"{name}.npz\").sum(axis=1))'\n"
            ));
        }
    }
    text
}
