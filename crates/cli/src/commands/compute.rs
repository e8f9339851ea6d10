//! `hemicube compute`: the form-factor matrix of a scene, into a store.

mod arguments;

pub(crate) use arguments::Arguments;

use crate::advice;
use crate::args::{AutoSwitch, RowRange, RowsAsked, SampleSize, SelectionSettings, Talk};
use crate::enclosure;
use crate::exit::{self, Exit, hinted};
use crate::forecast;
use crate::level;
use crate::prepare::{BUILT_IN, Prepared, RepairCounts, of_devices, prepare};
use crate::progress::{self, Bar, Status};
use crate::report::{
    self, BackendReport, Input, JsonReport, Listing, SCHEMA, Spread, TEMPORARY_SUFFIX, count, counted, duration,
    figures, percent, size, small_percent,
};
use crate::shell::word;
use crate::verify::{Verification, Verify};
use anyhow::{Context, Result, anyhow, bail};
use hemicube::accuracy::correct::Correction;
use hemicube::backend::{Counters, Culling, HemicubeBackend};
use hemicube::driver::compute::{Plan, Progress, RowChoice, Summary};
use hemicube::driver::glazing::matrix_of_band;
use hemicube::driver::job::{
    Finished, Job, JobError, Note, Observer, OpenStore, PartListener, RowsFailed, Run, Sessions, Stage, StorePlace,
    StoreRun,
};
use hemicube::driver::probe::share_left;
use hemicube::driver::room::Work;
use hemicube::driver::settings::RowSettings;
use hemicube::driver::update::Update;
use hemicube::portal::Portals;
use hemicube::store::{Error as StoreError, Form, Manifest, Part, Shard, Store, Thinning};
use hemicube::{Grouping, InputPatch, PatchKind};
use hemicube_spatial::whole;
use serde::Serialize;
use std::cell::{Cell, RefCell};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
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
    /// Relative rounding error of a form factor, by the store's form.
    value_error: f64,
    bytes: u64,
    complete: bool,
    /// The share of the rows computed by this process.
    #[serde(skip_serializing_if = "Option::is_none")]
    shard: Option<String>,
    parts: u64,
    /// Parts resumed from an earlier run.
    parts_kept: u32,
    part_count: u64,
    rows: u64,
    rows_kept: u64,
    row_count: u64,
    /// Rows of this run that were taken over from an earlier state of the scene, and the others.
    #[serde(skip_serializing_if = "Option::is_none")]
    update: Option<UpdateReport>,
    entries: u64,
    row_sum: Spread,
    escaped: f64,
    blocked: f64,
    unselected: f64,
    /// Mean and largest share of a row cut off after the last portal, where there are portals.
    #[serde(skip_serializing_if = "Option::is_none")]
    cut_off: Option<[f64; 2]>,
    rows_mostly_blocked: u64,
    /// True if each surface has a patch on either side: what is blocked, other surfaces lie on.
    #[serde(skip)]
    is_two_sided: bool,
    closure: f64,
    /// Expected relative Frobenius error of the rows, at accuracy levels that estimate it.
    #[serde(skip_serializing_if = "Option::is_none")]
    expected_error: Option<f64>,
    /// Root mean square of the standard errors of the rows' sums.
    #[serde(skip_serializing_if = "Option::is_none")]
    row_sum_error: Option<f64>,
    /// Rows of which three standard errors of Σ F, or of the share that escapes, are more than the tolerance.
    #[serde(skip_serializing_if = "Option::is_none")]
    uncertain_rows: Option<u64>,
    /// Asked for.
    #[serde(skip)]
    tolerance: Option<f64>,
    /// Effect of leaving out small form factors, where that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    thinning: Option<Thinning>,
    /// Rays and points spent on visible fractions.
    rays: u64,
    /// Entries of this run that are a visible fraction of a closed form, not a sum of pixels.
    corrected: u64,
    /// Partially visible pairs among them.
    partial: u64,
    /// Rows of this run that met the bound on their work before all pairs worth it were measured.
    cut_short: u64,
    /// Work of this run's rows in steps of about a nanosecond, counted, as `inspect` foretells them.
    steps: u64,
    /// The slowest row of this run.
    #[serde(skip_serializing_if = "Option::is_none")]
    slowest_row: Option<SlowestRow>,
    /// Rows of this run by second.
    #[serde(skip_serializing_if = "Option::is_none")]
    rows_per_second: Option<f64>,
    /// Rows by effort.
    effort: Effort,
    counters: Counters,
    #[serde(skip_serializing_if = "Option::is_none")]
    verification: Option<Verification>,
    #[serde(skip_serializing_if = "Option::is_none")]
    timings: Option<Timings>,
    #[serde(skip_serializing_if = "Option::is_none")]
    peak_memory_bytes: Option<u64>,
}

/// What a run took over from the matrix of an earlier state of the scene.
#[derive(Default, Serialize)]
struct UpdateReport {
    matrix: String,
    rows_taken_over: u64,
    rows_computed: u64,
    patches_gone: u64,
    patches_new: u64,
}

/// Seconds from which the slowest row is named.
const LONG_ROW: f64 = 0.5;

#[derive(Clone, Copy, Debug, Serialize)]
struct SlowestRow {
    patch: u32,
    seconds: f64,
}

/// Histograms of rows by their effort.
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
    /// With those of a cell's images.
    #[serde(skip)]
    drawn: usize,
    patches: u64,
    area: f64,
    objects: u64,
    materials: u64,
    up: Option<&'static str>,
    metres_per_unit: Option<f64>,
}

/// Seconds. Parts are written while rows are computed: `write` overlaps `rows`.
#[derive(Clone, Copy, Debug, Default, Serialize)]
struct Timings {
    load: f64,
    build: f64,
    /// Calibration of a tolerance.
    settle: f64,
    rows: f64,
    write: f64,
    verify: f64,
}

/// Figures of the rows, resumed ones included.
#[derive(Debug)]
struct Tally {
    parts: u64,
    rows: u64,
    entries: u64,
    rays: u64,
    squared_error: f64,
    squared_norm: f64,
    /// Rendered rows.
    rendered: u64,
    sum: f64,
    min: f64,
    max: f64,
    closure: f64,
    mostly_blocked: u64,
    uncertain: u64,
    /// Σ of the squared standard errors of sums, and their number.
    sum_errors: (f64, u64),
    tolerance: f64,
    effort: Effort,
    escaped: f64,
    blocked: f64,
    unselected: f64,
    /// Sum and largest.
    cut_off: Option<[f64; 2]>,
}

impl Tally {
    /// For rows of which this is asked; ∞ where nothing is.
    fn new(tolerance: f64) -> Self {
        Self {
            uncertain: 0,
            sum_errors: (0.0, 0),
            tolerance,
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
            cut_off: None,
        }
    }

    fn add(&mut self, part: &Part) {
        self.parts += 1;
        self.rows += part.rows.len() as u64;
        self.entries += part.data.len() as u64;
        self.rays += part.rays.iter().map(|&rays| u64::from(rays)).sum::<u64>();
        self.squared_error += part.squared_error();
        self.squared_norm += part.data.iter().map(|factor| factor.powi(2)).sum::<f64>();
        for (row, (shares, &hemicubes)) in part.shares.iter().zip(&part.hemicubes).enumerate() {
            if hemicubes == 0 {
                continue;
            }
            let lost = shares.to_array();
            // From 0: the sum of no numbers is −0, an odd sight in a report.
            let sum = part.row(row).1.iter().fold(0.0, |sum, factor| sum + factor);
            self.rendered += 1;
            self.effort.add(hemicubes, part.rays.get(row).copied().unwrap_or(0));
            self.sum += sum;
            self.min = self.min.min(sum);
            self.max = self.max.max(sum);
            let passage = part.passages.get(row).copied();
            if let Some(passage) = passage {
                let [sum, largest] = self.cut_off.unwrap_or_default();
                self.cut_off = Some([sum + passage.cut_off, largest.max(passage.cut_off)]);
            }
            let passed = passage.map_or(0.0, |passage| passage.passed);
            self.closure = self.closure.max((sum - passed + lost.iter().sum::<f64>() - 1.0).abs());
            self.mostly_blocked += u64::from(lost[1] > 0.5);
            if let Some(errors) = part.errors.get(row).filter(|errors| !errors.sum.is_nan()) {
                self.uncertain += u64::from(errors.exceed(self.tolerance));
                self.sum_errors.0 += f64::from(errors.sum).powi(2);
                self.sum_errors.1 += 1;
            }
            self.escaped += lost[0];
            self.blocked += lost[1];
            self.unselected += lost[2];
        }
    }

    /// Expected relative Frobenius error of the rows, at accuracy levels that estimate it.
    fn expected_error(&self) -> Option<f64> {
        // Rows without an entry are as they are.
        let relative = if self.squared_error > 0.0 {
            (self.squared_error / self.squared_norm).sqrt()
        } else {
            0.0
        };
        (self.tolerance.is_finite() && self.rows > 0 && relative.is_finite()).then_some(relative)
    }

    /// Root mean square of the standard errors of the rows' sums, where rows state them.
    fn row_sum_error(&self) -> Option<f64> {
        let (squares, rows) = self.sum_errors;
        (rows > 0).then(|| (squares / rows as f64).sqrt())
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

pub(crate) fn run(mut arguments: Arguments, talk: Talk) -> Result<Exit> {
    if let Some(earlier) = &arguments.update {
        arguments.render.engine.follow(earlier);
    }
    let bands = arguments.portals.bands()?;
    let cancel = exit::watch_interrupts().context("Ctrl-C cannot be watched")?;
    // clap requires a scene; only `--print-config` goes without.
    let (Some(scene), Some(whole)) = (arguments.scene.as_deref(), arguments.output.as_deref()) else {
        bail!("a scene is needed");
    };
    if bands.len() == 1 {
        let outputs = [Output {
            band: None,
            directory: whole.to_owned(),
        }];
        return run_bands(&arguments, scene, &outputs, cancel, talk);
    }
    if arguments.report.json {
        bail!(
            "`--json` reports on one matrix, and mirrors and panes of {} bands give as many; leave it out, and ask \
             `hemicube check DIR --json` of each",
            bands.len()
        );
    }
    let outputs: Vec<Output> = bands
        .into_iter()
        .map(|name| Output {
            directory: matrix_of_band(whole, &name),
            band: Some(name),
        })
        .collect();
    run_bands(&arguments, scene, &outputs, cancel, talk)
}

/// A matrix to compute.
struct Output {
    /// The band, if there are several.
    band: Option<String>,
    directory: PathBuf,
}

/// Computes a matrix for each band.
fn run_bands(
    arguments: &Arguments,
    scene: &Path,
    outputs: &[Output],
    cancel: &'static AtomicBool,
    talk: Talk,
) -> Result<Exit> {
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
    let json = JsonReport::asked(&arguments.report);
    let backend = arguments.render.open_backend(arguments.patches.memory, talk)?;
    outputs.iter().try_for_each(|output| check_place(&output.directory))?;
    let status = Status::open(arguments.process.progress_file.as_deref())?;
    let opened = Opened {
        outputs,
        backend,
        cancel,
        shard,
        status: &status,
        talk,
    };
    let result = compute_into(arguments, scene, opened, json);
    status.end(match &result {
        Ok(Exit::Interrupted) => "interrupted",
        Ok(_) => "done",
        Err(_) => "failed",
    });
    exit::remove_unused();
    result
}

/// Everything opened before the scene is read.
struct Opened<'a> {
    outputs: &'a [Output],
    backend: Box<dyn HemicubeBackend>,
    cancel: &'a AtomicBool,
    shard: Option<Shard>,
    status: &'a Status,
    talk: Talk,
}

/// Follows a run: the progress file, the bar, and the times of the stages.
struct Watch<'a> {
    status: &'a Status,
    cancel: &'a AtomicBool,
    talk: Talk,
    current: RefCell<Option<Current<'a>>>,
    times: Cell<Timings>,
}

/// The stage under way. The bar is cleared before the stage ends.
struct Current<'a> {
    bar: Option<Bar>,
    stage: progress::Stage<'a>,
    started: Instant,
}

impl<'a> Watch<'a> {
    fn new(status: &'a Status, cancel: &'a AtomicBool, talk: Talk) -> Self {
        Self {
            status,
            cancel,
            talk,
            current: RefCell::new(None),
            times: Cell::new(Timings::default()),
        }
    }
}

impl Observer for Watch<'_> {
    fn begin(&self, stage: Stage) {
        let (bar, shown) = match stage {
            Stage::Calibrate => (None, self.status.stage("settle")),
            Stage::Build => (None, self.status.stage("build")),
            Stage::Store => (None, self.status.stage("store")),
            Stage::Rows { row_count, resumed } => (
                Some(Bar::rows(self.talk, row_count, resumed)),
                self.status.rows(row_count, resumed),
            ),
            _ => (None, self.status.stage("finish")),
        };
        *self.current.borrow_mut() = Some(Current {
            bar,
            stage: shown,
            started: Instant::now(),
        });
    }

    fn end(&self, stage: Stage) {
        let Some(ended) = self.current.borrow_mut().take() else {
            return;
        };
        let took = ended.started.elapsed().as_secs_f64();
        let mut times = self.times.get();
        match stage {
            Stage::Calibrate => times.settle += took,
            Stage::Build => times.build += took,
            Stage::Rows { .. } => times.rows += took,
            _ => times.write += took,
        }
        self.times.set(times);
    }

    fn note(&self, note: Note<'_>) {
        match note {
            Note::Level(reason) => self.talk.detail(reason),
            Note::Storage(policy) => {
                if let Some(chosen) = advice::of_storage(policy) {
                    self.talk.say(&chosen);
                }
            }
            Note::Culling(probe) => self.talk.detail(&format!(
                "culling {}: it leaves {} of the triangles in {}",
                on_or_off(probe.culling()),
                percent(probe.left),
                counted(probe.hemicubes, "trial hemicube"),
            )),
            _ => {}
        }
    }

    fn progress(&self, progress: Progress) {
        if let Some(Current { bar, stage, .. }) = &*self.current.borrow() {
            if let Some(bar) = bar {
                bar.show(progress);
            }
            stage.show(progress);
        }
    }

    fn cancel(&self) -> Option<&AtomicBool> {
        Some(self.cancel)
    }
}

fn on_or_off(culling: Culling) -> &'static str {
    if culling == Culling::On { "on" } else { "off" }
}

/// Reads the scene and computes its rows into the store.
fn compute_into(arguments: &Arguments, scene: &Path, opened: Opened<'_>, json: Option<JsonReport>) -> Result<Exit> {
    let Opened {
        outputs,
        backend,
        cancel,
        shard,
        status,
        talk,
    } = opened;
    let watch = Watch::new(status, cancel, talk);
    let stage = status.stage("load");
    let work = match arguments.render.work() {
        Work::Fractions if arguments.by != arguments::Kind::Triangle => Work::Grouped,
        work => work,
    };
    let mut prepared = prepare(scene, &arguments.patches, &arguments.render, work)?;
    enclosure::note_doubles(&mut prepared, arguments.render.thread_count());
    let tolerance = arguments.render.tolerance().map(|tolerance| tolerance.0);
    let hierarchy = arguments.render.engine.hierarchy();
    let portals = arguments.portals.portals(&mut prepared, hierarchy, tolerance)?;
    let further = arguments
        .portals
        .of_further_bands(&portals, &prepared, tolerance, outputs.len())?;
    drop(stage);
    prepared.tell(talk);
    tell_portals(&portals, talk);
    let update = match &arguments.update {
        Some(directory) => {
            let update = Update::open(directory, prepared.model.patches())?;
            prepared.model = update.number(prepared.model);
            Some(Arc::new(update))
        }
        None => None,
    };
    let sessions = Sessions {
        rows: backend,
        calibration: arguments.render.open_backend(arguments.patches.memory, Talk::SILENT)?,
    };
    let has_portals = !portals.is_empty();
    let job = Job {
        update: update.clone(),
        ..job(arguments, &prepared, portals)?
    };
    let mut run = job
        .prepare(&prepared.scene, &prepared.model, sessions, &watch)
        .map_err(explain)?;
    for portals in further {
        run = run
            .with_band(&job, &prepared.scene, Arc::new(portals))
            .map_err(explain)?;
    }
    tell_taken(arguments, &run, update.as_deref(), talk);
    tell_backend(&run, &prepared, talk);
    tell_composed(&run, talk);
    tell_rays(&run, &arguments.render.engine.backend_option, talk);
    let entries_per_row = run.probe.map_or(0.0, |probe| probe.entries_per_row);
    if let Some(limit) = arguments.patches.memory {
        let rows = forecast_rows(&run, entries_per_row, arguments.batch);
        let surfaces = prepared.model.geometry().surfaces.len() as u64;
        let mut besides = 0;
        if run.backend().info().name != BUILT_IN {
            besides += of_devices(limit);
        }
        if casts_rays(&run) {
            besides += bytes_of_rays(surfaces, run.threads);
        }
        run.threads = keep_within(limit, besides, run.threads, rows, talk)?;
    }

    // From here to the last manifest an interrupt waits, so that the directory is a store afterwards.
    let guard = exit::InterruptGuard::new();
    let update = arguments.update.as_deref().zip(update.as_deref());
    let begin = |_| Begun::new(&prepared, &run, shard, update);
    let begun: Vec<Begun> = outputs.iter().map(begin).collect();
    let threads = run.threads;
    let asked = run.plan.correction.tolerance().unwrap_or(f64::INFINITY);
    let mut tallies: Vec<Tally> = outputs.iter().map(|_| Tally::new(asked)).collect();
    let mut takers: Vec<_> = tallies
        .iter_mut()
        .map(|tally| move |part: &Part| tally.add(part))
        .collect();
    let mut listeners: Vec<PartListener<'_>> = takers.iter_mut().map(|taker| taker as PartListener<'_>).collect();
    let places: Vec<StorePlace<'_>> = outputs
        .iter()
        .map(|output| StorePlace {
            directory: &output.directory,
            overwrite: arguments.overwrite,
            shard,
        })
        .collect();
    let store = run
        .open_bands(&prepared.scene, &places, &mut listeners, &watch)
        .map_err(explain_store)?;
    store.stores().iter().for_each(|store| tell_resumed(store, talk));
    warn_of_disk(&store, entries_per_row, talk);
    let objects = enclosure::objects(&prepared);
    // As large as the patches, and not needed any more.
    prepared.scene.scene.triangles = Vec::new();
    let finished = store.compute_bands(&mut listeners, &watch).map_err(explain)?;
    drop(guard);
    drop(listeners);
    drop(takers);

    let ending = Ending {
        arguments,
        prepared: &prepared,
        watch: &watch,
        objects: &objects,
        threads,
        has_portals,
    };
    let mut exit = Exit::Done;
    let mut reports = Vec::with_capacity(outputs.len());
    for (place, (begun, finished)) in begun.into_iter().zip(&finished).enumerate() {
        if let Some(name) = &outputs[place].band {
            talk.say(&format!("band {name}, {} of {}", place + 1, outputs.len()));
        }
        let (report, of_band) = ending.report(begun, &tallies[place], finished)?;
        if exit == Exit::Done {
            exit = of_band;
        }
        reports.push(report);
    }
    if let (Some(json), [report]) = (json, &reports[..]) {
        json.write(report)?;
    }
    Ok(exit)
}

/// Settings and surroundings for reports on a finished run.
struct Ending<'a> {
    arguments: &'a Arguments,
    prepared: &'a Prepared,
    watch: &'a Watch<'a>,
    objects: &'a enclosure::Objects,
    threads: usize,
    has_portals: bool,
}

impl Ending<'_> {
    /// Tells the results of a matrix, and verifies it where that was asked for.
    fn report(&self, begun: Begun, tally: &Tally, finished: &Finished) -> Result<(Report, Exit)> {
        let Self {
            arguments, prepared, ..
        } = *self;
        let Watch {
            status, cancel, talk, ..
        } = *self.watch;
        let shares = [tally.sum, tally.escaped, tally.blocked].map(|sum| tally.mean(sum));
        let is_examined = || enclosure::is_examined(prepared, tally.rendered, shares);
        let questions = if tally.rendered > 0 && !self.has_portals && is_examined() {
            let [row_sum, _, blocked] = shares;
            enclosure::questions(prepared, self.objects, [row_sum, blocked], self.threads)
        } else {
            Vec::new()
        };
        let timings = talk.verbose.then(|| timings(self.watch, prepared, finished));
        let mut report = report_of(begun, prepared, tally, finished, timings);
        if !finished.resumed.is_complete {
            let took = finished.summary.elapsed.as_secs_f64();
            talk.say(&format!(
                "{} in {}",
                counted(finished.summary.rows, "row"),
                duration(took)
            ));
        }
        talk.detail(details(&report, &finished.summary).trim_end());
        let exit = match arguments.verify {
            _ if finished.summary.cancelled => Exit::Interrupted,
            None => Exit::Done,
            Some(rows) => {
                let _stage = status.stage("verify");
                let verify = Verify {
                    rows,
                    seed: arguments.selection.seed,
                    tolerance: arguments.render.tolerance(),
                    threads: self.threads,
                    cancel,
                    engine: &arguments.render.engine,
                };
                verify_rows(&verify, prepared, finished, &mut report, talk)?
            }
        };
        if !arguments.report.json {
            report::print_verdicts(&summary(&report, finished))?;
        }
        warn_of_backs(&report, arguments, talk);
        for question in questions {
            talk.warn(&question);
        }
        warn_of_error(&report, arguments, talk);
        if !finished.resumed.is_complete {
            talk.say(next_step(&report, &finished.summary, &finished.directory).trim_end());
        }
        Ok((report, exit))
    }
}

/// Compares rows of the store with reference rows, and enters the result into the report.
fn verify_rows(
    verify: &Verify<'_>,
    prepared: &Prepared,
    finished: &Finished,
    report: &mut Report,
    talk: Talk,
) -> Result<Exit> {
    let started = Instant::now();
    let store = Store::open(&finished.directory)?;
    let verification = verify.run(&prepared.model, &finished.plan, &store, talk)?;
    talk.detail(verification.text().trim_end());
    let exit = verification.exit();
    report.verification = Some(verification);
    if let Some(timings) = &mut report.timings {
        timings.verify = started.elapsed().as_secs_f64();
    }
    Ok(exit)
}

/// The job of the arguments.
fn job(arguments: &Arguments, prepared: &Prepared, portals: Portals) -> Result<Job> {
    let selection = &arguments.selection;
    Ok(Job {
        accuracy: arguments.render.accuracy(),
        rotate: true,
        rows: row_choice(selection, arguments.by.into(), prepared)?,
        emitters: selection.emitters.clone(),
        receivers: selection.receivers.clone(),
        occluders: selection.occluders.clone(),
        form: arguments.form.form(),
        min_factor: arguments.min_factor,
        patches: arguments.by.into(),
        culling: match arguments.culling {
            AutoSwitch::Auto => None,
            AutoSwitch::On => Some(Culling::On),
            AutoSwitch::Off => Some(Culling::Off),
        },
        forecasts: true,
        threads: arguments.render.thread_count(),
        batch: arguments.batch as usize,
        portals: Arc::new(portals),
        update: None,
    })
}

/// Tells the images of the cell.
fn tell_portals(portals: &Portals, talk: Talk) {
    if let Some(images) = &portals.images {
        let cells = counted(images.count().into(), "cell");
        talk.say(&match images.repeats() {
            Some(repeats) => format!("{cells}, the scene and its images: {repeats} repeats on either side of a period"),
            None => format!("{cells}, the scene and its images"),
        });
    }
}

/// Tells how many rows are taken over.
fn tell_taken(arguments: &Arguments, run: &Run<'_>, update: Option<&Update>, talk: Talk) {
    if let (Some(update), Some(taken), Some(directory)) = (update, &run.plan.taken, &arguments.update) {
        let [removed, added] = update.changed().map(count);
        talk.say(&format!(
            "{} of {} taken over from `{}`: nothing of what changed can be seen there ({removed} patches gone, {added} new)",
            count(run.plan.rows.iter().filter(|&&patch| taken.is_taken(patch)).count() as u64),
            counted(run.plan.rows.len() as u64, "row"),
            directory.display(),
        ));
    }
}

/// Tells who follows what is seen through mirrors and panes, where the backend does not.
fn tell_composed(run: &Run<'_>, talk: Talk) {
    let backend = &run.backend().info().name;
    if run.plan.draws_passes(run.backend().info()) {
        talk.detail(&format!(
            "`{backend}` renders what is seen directly, and through mirrors and panes where passes are large; the rest \
             is followed on the processor"
        ));
    } else if run.plan.portals.specular.is_some() && backend != "cpu" {
        talk.detail(&format!(
            "`{backend}` renders what is seen directly; what is seen through mirrors and panes is followed on the \
             processor"
        ));
    }
}

/// Returns whether a backend casts rays for this run.
fn casts_rays(run: &Run<'_>) -> bool {
    run.backend().info().capabilities.rays && run.plan.correction != Correction::Pixel
}

/// Memory that a backend's rays take in the built-in plugins: 60 bytes a triangle for the tree and as much for each
/// session's copy, with 131,072 rays and answers there, as if the device were the processor.
fn bytes_of_rays(surfaces: u64, threads: usize) -> u64 {
    const TREE: u64 = 60;
    const RAYS: u64 = 36 << 17;
    TREE * surfaces + threads as u64 * (TREE * surfaces + RAYS)
}

/// Tells where rays are the backend's, and where it was asked for them in vain.
fn tell_rays(run: &Run<'_>, options: &[String], talk: Talk) {
    let backend = run.backend().info();
    let name = &backend.name;
    if casts_rays(run) {
        talk.detail(&format!(
            "`{name}` casts the rays beyond a patch's first 256 that measure what escapes and is blocked, and those \
             beyond a pair's first 256 where more than 256 triangles are between; those that it cannot decide are the \
             processor's"
        ));
    } else if options.iter().any(|option| option == "rays=on") {
        talk.say(&format!(
            "`rays=on` changes nothing: {}",
            if backend.capabilities.rays {
                "rows by pixels need no rays".to_owned()
            } else {
                format!("backend `{name}` casts none")
            }
        ));
    }
}

/// The rows asked for: all, a range of patches, or a sample of the emitting ones.
fn row_choice(settings: &SelectionSettings, kind: PatchKind, prepared: &Prepared) -> Result<RowChoice> {
    let grouping = Grouping::new(&prepared.scene, &prepared.patches, kind);
    let patch_count = grouping.as_ref().map_or(prepared.patches.len(), Grouping::len);
    let patch_count = u32::try_from(patch_count).unwrap_or(u32::MAX);
    let SelectionSettings { rows, seed, .. } = settings;
    Ok(match *rows {
        Some(RowsAsked::Range(RowRange { start, end })) => {
            let end = end.unwrap_or(patch_count);
            if start >= end || end > patch_count {
                bail!(
                    "`--rows {start}..{end}`: the scene has {}, from 0 on",
                    counted(patch_count.into(), "patch")
                );
            }
            RowChoice::Range { start, end }
        }
        Some(RowsAsked::Sample(size)) => {
            let selection = crate::selection::selection(&prepared.scene, &prepared.patches, settings)?;
            let emitting = selection.emitters.map_or(u64::from(patch_count), |emitters| {
                let emitting = (0..).zip(&emitters).filter(|&(_, &emits)| emits);
                let emitting = emitting.map(|(element, _)| InputPatch(element));
                match &grouping {
                    Some(grouping) => {
                        let patches: HashSet<_> = emitting.map(|element| grouping.patch_of(element)).collect();
                        patches.len() as u64
                    }
                    None => emitting.count() as u64,
                }
            });
            let wanted = match size {
                SampleSize::Count(number) => u64::from(number),
                SampleSize::Percent(percent) => whole::to_u64((percent / 100.0 * emitting as f64).ceil()),
            };
            RowChoice::Sample {
                count: u32::try_from(wanted.min(emitting)).unwrap_or(patch_count),
                seed: *seed,
            }
        }
        None => RowChoice::All,
    })
}

/// A failed run, with the next step.
fn explain(error: JobError) -> anyhow::Error {
    match error {
        JobError::NoMatch(error) => crate::selection::no_match(error),
        JobError::Partly(error) => hinted(
            anyhow!("`--{}`: {error}", error.list),
            "name all of it, or compute by `--by face` or `--by triangle`",
        ),
        JobError::Level(error) => level::explain(error),
        JobError::NoRows => {
            anyhow!("no row is left to compute: `--rows`, `--emitters` and `--occluders` together exclude every patch")
        }
        JobError::Compute(error) => error.into(),
        JobError::Rows(failed) => explain_rows(*failed),
        JobError::Store(error) => error.into(),
        error => error.into(),
    }
}

/// Failed rows, with the parts kept and the way to resume them.
fn explain_rows(failed: RowsFailed) -> anyhow::Error {
    let RowsFailed {
        source,
        directory,
        parts,
        part_count,
        are_named,
    } = failed;
    let directory = word(&directory);
    let hint = if parts == 0 {
        format!("nothing was computed yet; `{directory}` holds an empty matrix")
    } else if are_named {
        format!(
            "{parts} of {part_count} parts are kept, and the same command goes on there; `hemicube check {directory} \
             --allow-incomplete` looks at them"
        )
    } else {
        format!(
            "{parts} of {part_count} parts are kept in `{directory}`, though its manifest could not name them; the \
             same command goes on there"
        )
    };
    hinted(source.into(), hint)
}

/// A store that cannot be made or resumed, with the next step.
fn explain_store(error: StoreError) -> anyhow::Error {
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
}

/// Tells the backend, its device and its choices for the scene.
fn tell_backend(run: &Run<'_>, prepared: &Prepared, talk: Talk) {
    let device = run.backend().info();
    talk.detail(&format!(
        "backend {} {} ({}), {}, {}",
        device.name,
        device.version,
        device.device,
        counted(run.threads as u64, "thread"),
        match &run.plan.groups {
            Some(groups) => format!(
                "{} by {}, of {}",
                counted(groups.grouping.len() as u64, "patch"),
                groups.grouping.kind().name(),
                counted(prepared.patches.len() as u64, "triangle")
            ),
            None => counted(prepared.patches.len() as u64, "patch"),
        },
    ));
    for choice in run.backend().choices() {
        talk.detail(&choice);
    }
}

/// Rows of a run, for the forecast of its memory.
fn forecast_rows(run: &Run<'_>, entries_per_row: f64, batch: u32) -> forecast::Rows {
    let rows_per_batch = match batch {
        0 => u32::try_from(run.backend().info().preferred_rows).unwrap_or(u32::MAX),
        rows => rows,
    };
    let rows_per_part = match &run.plan.groups {
        // Batches are of elements, parts of the longer rows of patches: as many entries in shorter ones.
        Some(_) => {
            let entries = f64::from(run.plan.rows_per_part) * entries_of_row(&run.plan, entries_per_row);
            let rows = whole::to_u32((entries / entries_per_row.max(1.0)).ceil());
            rows.max(rows_per_batch)
        }
        None => run.plan.rows_per_part,
    };
    forecast::Rows {
        entries_per_row,
        rows_per_part,
        rows_per_batch,
    }
}

/// Most entries of a row, on average, by those of an element's: a patch sees what its elements see.
fn entries_of_row(plan: &Plan, of_element: f64) -> f64 {
    match &plan.groups {
        Some(groups) => {
            let elements = plan.rows.len() as f64 / plan.row_count().max(1) as f64;
            (of_element * elements).min(groups.grouping.len() as f64)
        }
        None => of_element,
    }
}

/// Times of the run. Setting up and joining the workers counts as building, the sink's time as writing.
fn timings(watch: &Watch<'_>, prepared: &Prepared, finished: &Finished) -> Timings {
    let stages = watch.times.get();
    let rows = finished.summary.elapsed.as_secs_f64();
    Timings {
        load: prepared.load_seconds,
        build: prepared.build_seconds + stages.build + (stages.rows - rows).max(0.0),
        rows,
        write: stages.write + finished.summary.sink.as_secs_f64(),
        ..stages
    }
}

/// Warns where leaving out small form factors takes the expected error above the tolerance.
fn warn_of_error(report: &Report, arguments: &Arguments, talk: Talk) {
    if let (Some(tolerance), Some(error), Some(thinning)) =
        (arguments.render.tolerance(), report.expected_error, report.thinning)
        && error > tolerance.0
    {
        talk.warn(&format!(
            "the expected error, {}, is above the tolerance with form factors below {} left out; a smaller \
             `--min-factor` keeps it",
            percent(error),
            figures(thinning.min_factor)
        ));
    }
}

/// Refuses a place that cannot become a store before a large scene is read. Makes the directory. The store's writer
/// checks again.
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

/// The number of threads that keeps the run within a limit of memory, where a backend other than the built-in one takes so
/// much `besides`.
fn keep_within(limit: u64, besides: u64, threads: usize, rows: forecast::Rows, talk: Talk) -> Result<usize> {
    let Some(resident) = report::resident_memory_bytes() else {
        talk.warn("this system does not tell how much memory is in use: `--memory` is not kept");
        return Ok(threads);
    };
    let resident = resident + besides;
    let Some(within) = forecast::threads_within(limit, resident, threads, rows) else {
        return Err(hinted(
            anyhow!(
                "`--memory` of {}: the scene alone takes {}, and with one thread it would be about {}",
                size(limit),
                size(resident),
                size(forecast::memory(resident, 1, rows))
            ),
            "give it more, or cut its triangles into fewer patches",
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

/// Warns of a disk that is probably too small. The run begins all the same: it can be resumed once there is room.
fn warn_of_disk(store: &StoreRun<'_>, entries_per_row: f64, talk: Talk) {
    let plan = store.plan();
    let Some(directory) = store.stores().first().map(|store| store.writer.directory()) else {
        return;
    };
    let rows = store.missing_rows() * store.stores().len() as u64;
    let wanted = forecast::disk(rows, entries_of_row(plan, entries_per_row), plan.form);
    let Some(available) = forecast::available(directory).filter(|&available| available < wanted) else {
        return;
    };
    let at_most = if plan.min_factor > 0.0 { "up to " } else { "" };
    let compact = if plan.form == Form::Plain {
        "`--form compact` takes a third to a quarter of that, "
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

/// Tells the parts resumed from an earlier run, and those computed again.
fn tell_resumed(OpenStore { writer, resumed, .. }: &OpenStore, talk: Talk) {
    let shown = writer.directory().display();
    if !writer.is_locked() {
        talk.warn(&format!(
            "the file system of `{shown}` has no locks: see to it that nothing else writes there"
        ));
    }
    for file in &resumed.not_kept {
        talk.warn(&format!("part {} is computed again: {}", file.part, file.reason));
    }
    if !resumed.is_complete && resumed.parts > 0 {
        talk.say(&format!(
            "going on with `{shown}`: {} with {} are there",
            counted(resumed.parts.into(), "part"),
            counted(resumed.rows, "row"),
        ));
    }
}

/// Facts of a run known before its first row, for the report.
struct Begun {
    scene: SceneReport,
    settings: RowSettings,
    backend: BackendReport,
    culling: Culling,
    shard: Option<Shard>,
    update: Option<UpdateReport>,
}

impl Begun {
    fn new(prepared: &Prepared, run: &Run<'_>, shard: Option<Shard>, update: Option<(&Path, &Update)>) -> Self {
        let Prepared { scene, patches, .. } = prepared;
        let device = run.backend().info();
        Self {
            scene: SceneReport {
                triangles: scene.triangles_read,
                triangles_used: scene.triangles.len() as u64,
                surfaces: patches.surfaces().len() as u64,
                drawn: prepared.model.geometry().surfaces.len(),
                patches: run.plan.groups.as_ref().map_or(patches.len(), |of| of.grouping.len()) as u64,
                area: patches.iter().map(|patch| patches.area(patch)).sum(),
                objects: scene.objects.len() as u64,
                materials: scene.materials.len() as u64,
                up: scene.up_name(),
                metres_per_unit: scene.metres_per_unit,
            },
            settings: run.settings.clone(),
            backend: BackendReport {
                name: device.name.clone(),
                version: device.version.clone(),
                device: device.device.clone(),
            },
            culling: run.render.culling,
            shard,
            update: update.map(|(directory, update)| {
                let [patches_gone, patches_new] = update.changed();
                UpdateReport {
                    matrix: directory.display().to_string(),
                    patches_gone,
                    patches_new,
                    ..UpdateReport::default()
                }
            }),
        }
    }
}

/// The report of a run. Without `timings` equal runs have equal reports.
fn report_of(
    begun: Begun,
    prepared: &Prepared,
    tally: &Tally,
    finished: &Finished,
    timings: Option<Timings>,
) -> Report {
    let Finished {
        summary,
        manifest,
        resumed,
        directory,
        ..
    } = finished;
    let seconds = summary.elapsed.as_secs_f64();
    Report {
        schema: SCHEMA,
        program: "hemicube",
        version: env!("CARGO_PKG_VERSION"),
        inputs: vec![prepared.input.clone()],
        scene: begun.scene,
        settings: begun.settings,
        backend: begun.backend,
        culling: on_or_off(begun.culling),
        threads: summary.threads,
        repair: RepairCounts::from(&prepared.scene.repaired),
        store: directory.display().to_string(),
        form: manifest.form,
        value_error: manifest.value_error,
        bytes: bytes_of(directory, manifest),
        complete: manifest.complete,
        shard: begun.shard.map(|shard| shard.to_string()),
        parts: tally.parts,
        parts_kept: resumed.parts,
        part_count: u64::from(resumed.parts) + finished.plan.wanted().len() as u64,
        rows: tally.rows,
        rows_kept: resumed.rows,
        row_count: resumed.rows + finished.plan.wanted_rows(),
        update: begun.update.map(|update| UpdateReport {
            rows_taken_over: summary.taken,
            rows_computed: summary.rows - summary.taken,
            ..update
        }),
        entries: tally.entries,
        row_sum: tally.row_sum(),
        escaped: tally.mean(tally.escaped),
        blocked: tally.mean(tally.blocked),
        unselected: tally.mean(tally.unselected),
        cut_off: tally.cut_off.map(|[sum, largest]| [tally.mean(sum), largest]),
        rows_mostly_blocked: tally.mostly_blocked,
        is_two_sided: prepared
            .model
            .geometry()
            .surfaces
            .iter()
            .all(|surface| surface.back.is_some()),
        closure: tally.closure,
        expected_error: tally.expected_error(),
        row_sum_error: tally.row_sum_error(),
        uncertain_rows: tally.expected_error().map(|_| tally.uncertain),
        tolerance: finished.plan.correction.tolerance(),
        thinning: manifest.thinning,
        rays: tally.rays,
        corrected: summary.corrected,
        partial: summary.partial,
        cut_short: summary.cut_short,
        steps: forecast::steps(summary),
        slowest_row: timings.and(summary.slowest).map(|(element, took)| SlowestRow {
            patch: match &finished.plan.groups {
                Some(groups) => groups.grouping.patch_of(element).0,
                None => element.0,
            },
            seconds: took.as_secs_f64(),
        }),
        rows_per_second: timings.filter(|_| seconds > 0.0).map(|_| summary.rows as f64 / seconds),
        effort: tally.effort.clone(),
        counters: summary.counters,
        verification: None,
        peak_memory_bytes: timings.and_then(|_| report::peak_memory_bytes()),
        timings,
    }
}

/// Size of a store on the disk.
fn bytes_of(directory: &Path, manifest: &Manifest) -> u64 {
    let files = manifest.parts.iter().map(|part| part.file.as_str());
    files
        .chain(manifest.patches.iter().map(|table| table.file.as_str()))
        .chain(["manifest.json"])
        .filter_map(|file| std::fs::metadata(directory.join(file)).ok())
        .map(|metadata| metadata.len())
        .sum()
}

/// What was made, how wrong it is, and where the energy goes.
fn summary(report: &Report, finished: &Finished) -> String {
    let mut list = Listing::default();
    let shown = finished.directory.display();
    let patches = report.scene.patches;
    let rows = if report.rows == patches {
        format!("{} × {}", count(patches), count(patches))
    } else if report.rows == report.row_count {
        format!("{} of {}", count(report.rows), counted(patches, "row"))
    } else {
        format!("{} of {} so far", count(report.rows), counted(report.row_count, "row"))
    };
    let form = match report.form {
        Form::Plain => "",
        Form::Compact => ", compact",
        Form::Double => ", double",
    };
    let full = report.entries as f64 / (report.rows.max(1) as f64 * patches.max(1) as f64);
    // No time: equal runs print equally.
    let took = if finished.resumed.is_complete {
        "; it was complete, and nothing was computed"
    } else {
        ""
    };
    list.add(
        "matrix",
        format!(
            "{shown}: {rows}, {} ({} full), {}{form}{took}",
            counted(report.entries, "entry"),
            percent(full),
            size(report.bytes)
        ),
    );
    if let Some(update) = report.update.as_ref().filter(|_| !finished.resumed.is_complete) {
        let [taken_over, computed] = [update.rows_taken_over, update.rows_computed].map(count);
        let from = &update.matrix;
        list.add(
            "rows",
            format!("{taken_over} taken over from `{from}`, {computed} computed"),
        );
    }
    if let Some(expected) = report.expected_error {
        let typed = report.settings.tolerance;
        let asked = match report.tolerance {
            // What the form's rounding leaves is to be kept; what was typed is said.
            Some(left) if expected > left => format!(" (asked: {}): NOT REACHED", level::asked(typed.unwrap_or(left))),
            Some(left) => format!(" (asked: {})", level::asked(typed.unwrap_or(left))),
            None => String::new(),
        };
        let sums = report.row_sum_error.map_or_else(String::new, |error| {
            format!(", {} of a row's sum", small_percent(error))
        });
        let measure = if report.verification.is_none() {
            "; `--verify 32` measures it"
        } else {
            ""
        };
        list.add(
            "error",
            format!("{} expected{asked}{sums}{measure}", small_percent(expected)),
        );
    } else if report.verification.is_none() {
        list.add("error", "not estimated for sums of pixels; `--verify 32` measures it");
    }
    if let Some(verification) = &report.verification {
        list.add("measured", verification.line());
    }
    let mut energy = vec![format!("{} escapes", percent(report.escaped))];
    energy.push(format!("{} blocked by backs of surfaces", percent(report.blocked)));
    if report.unselected > 0.0 {
        energy.push(format!("{} to patches without a column", percent(report.unselected)));
    }
    if let Some([mean, _]) = report.cut_off {
        energy.push(format!("{} cut off behind mirrors and panes", percent(mean)));
    }
    list.add(
        "energy",
        format!(
            "{}; rows close within {}",
            energy.join(", "),
            small_percent(report.closure)
        ),
    );
    if let Some(thinning) = report.thinning {
        list.add(
            "left out",
            format!(
                "form factors below {}: {} of the energy, given to the others of their row",
                figures(thinning.min_factor),
                percent(thinning.mass_dropped)
            ),
        );
    }
    list.text()
}

/// The engine's work, for `-v`.
fn details(report: &Report, summary: &Summary) -> String {
    let mut list = Listing::default();
    list_rows(report, &mut list);
    list_work(report, summary, &mut list);
    list.text()
}

/// Warns of rows that see mostly backs, or other surfaces on their patch.
fn warn_of_backs(report: &Report, arguments: &Arguments, talk: Talk) {
    let rows = report.rows_mostly_blocked;
    if rows == 0 {
        return;
    }
    let scene = arguments
        .scene
        .as_deref()
        .map_or_else(|| "SCENE".into(), |scene| word(scene).to_string());
    talk.warn(&if report.is_two_sided {
        format!(
            "{} covered by other surfaces in more than half of the view; `hemicube inspect {scene}` says where",
            if rows == 1 {
                "1 patch is".to_owned()
            } else {
                format!("{} patches are", count(rows))
            },
        )
    } else {
        format!(
            "{} mostly backs of surfaces; `hemicube inspect {scene}` says where, and why",
            if rows == 1 {
                "1 patch sees".to_owned()
            } else {
                format!("{} patches see", count(rows))
            },
        )
    });
}

/// Numbers of rows and entries, the effect of leaving out small ones, and the expected error.
fn list_rows(report: &Report, list: &mut Listing) {
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
    let sum = report.row_sum;
    list.add(
        "sum of F",
        format!("{:.4} on average, from {:.4} to {:.4}", sum.mean, sum.min, sum.max),
    );
    if report.expected_error.is_some() {
        let rays = figures(report.rays as f64 / report.rows.max(1) as f64);
        list.add("rays", format!("{rays} a row; rows by rays: {}", report.effort.text()));
    }
}

/// Corrected pairs, time and memory.
fn list_work(report: &Report, summary: &Summary, list: &mut Listing) {
    if report.corrected > 0 {
        // Of pairs with images several may be one entry.
        let partial = if report.cut_off.is_some() {
            format!("{} are", counted(report.partial, "pair"))
        } else {
            let share = report.partial as f64 / report.corrected as f64;
            format!("{} of the pairs are", percent(share))
        };
        let corrected = counted(report.corrected, "entry");
        list.add(
            "partial",
            format!("{partial} partly hidden; {corrected}: visible fraction × closed form"),
        );
    }
    if report.cut_short > 0 {
        list.add(
            "budget",
            format!(
                "{} hit the limit of work; their last pairs are estimates{}",
                if report.settings.patches.is_triangle() {
                    counted(report.cut_short, "row")
                } else {
                    format!("rows of {}", counted(report.cut_short, "triangle"))
                },
                if report.expected_error.is_some() {
                    ", as their expected error says"
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
    let culled = 1.0 - share_left(&report.counters, report.scene.drawn);
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
                    Some(SlowestRow { patch, seconds }) if seconds > LONG_ROW => format!(
                        "; the slowest row, of {}patch {patch}, took {}",
                        if report.settings.patches.is_triangle() {
                            ""
                        } else {
                            "a triangle of "
                        },
                        duration(seconds)
                    ),
                    _ => String::new(),
                }
            ),
        );
    }
    if let Some(peak) = report.peak_memory_bytes {
        list.add("memory", format!("{} at most", size(peak)));
    }
}

/// The commands that follow a run.
fn next_step(report: &Report, summary: &Summary, directory: &Path) -> String {
    let shown = word(directory);
    if summary.cancelled {
        return format!(
            "interrupted: {} of {} are kept; the same command goes on there, and `hemicube check {shown} \
             --allow-incomplete` looks at them\n",
            count(report.parts),
            counted(report.part_count, "part")
        );
    }
    if let Some(shard) = &report.shard {
        return format!("shard {shard} is done. When all are:\n  hemicube merge {shown}\n");
    }
    let name = directory
        .file_stem()
        .map_or_else(|| "matrix".to_owned(), |name| name.to_string_lossy().into_owned());
    let export = word(format!("{name}.npz").as_ref());
    format!(
        "Next:\n  hemicube check {shown}{0:after$}# does it hold?\n  hemicube export {shown} -o {export}  # for \
         SciPy\n  hemicube report {shown}{0:page$}# a page with the model in 3-D\n",
        "",
        after = 7 + export.chars().count(),
        page = 6 + export.chars().count(),
    )
}
