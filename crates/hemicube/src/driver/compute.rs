//! The computation: patches in the order of work ▶ hemicubes ▶ a backend ▶ checked rows ▶ parts ▶ a sink.
//!
//! ```text
//! Queue ▶ Worker (one a thread: render, check, convert a batch) ▶ Collector (batches in order, parts) ▶ PartSink
//! ```
//!
//! Rows do not depend on threads or batches: a row comes from its own hemicubes only, parts are fixed runs of the order
//! of work, and the collector puts batches back in order.

use crate::Model;
use crate::accuracy::caster::Caster;
use crate::accuracy::correct::{Attempt, Converter, Correction, Rendered};
use crate::accuracy::grain::MOST_PER_EDGE;
use crate::backend::{BackendError, Counters, Hemicube, HemicubeBackend, RenderSettings};
use crate::delta::DeltaTable;
use crate::driver::aggregate::{ColumnSums, OpenRow};
use crate::driver::queue::{Queue, StopOnPanic};
use crate::face::Items;
use crate::portal::bands::{Common, Seen};
use crate::portal::extend::{Drawn, Extender};
use crate::row::{RowBlock, RowError};
use crate::steps;
use crate::store::{FinishedRow, Part, PartThinning, RowSums, StoreWriter, Thinning, small_entries};
use hemicube_scene::InputPatch;
use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};

pub(crate) use super::plan::sample;
pub use super::plan::{Groups, Plan, RowChoice, Selection};

/// Takes finished parts, in order, on a thread of its own: rows are computed while a part is written.
///
/// A sink need not keep the rows:
///
/// ```
/// use hemicube::driver::compute::{Execution, PartSink, compute};
/// use hemicube::store::{Error, Part};
/// # use hemicube::accuracy::correct::Correction;
/// # use hemicube_backend_cpu::CpuBackend;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model()?;
/// # let (plan, settings) = (room::plan(&model, Correction::Pixel), room::RENDER);
///
/// /// The patch that sees the most others, and how many.
/// #[derive(Default)]
/// struct MostSeeing(u32, usize);
///
/// impl PartSink for MostSeeing {
///     fn take(&mut self, part: Part) -> Result<(), Error> {
///         for (row, &patch) in part.rows.iter().enumerate() {
///             let (columns, _factors) = part.row(row);
///             if columns.len() > self.1 {
///                 *self = Self(patch, columns.len());
///             }
///         }
///         Ok(())
///     }
/// }
///
/// let (mut most, backend) = (MostSeeing::default(), Box::new(CpuBackend::new()));
/// let summary = compute(&model, &plan, settings, backend, Execution::default(), &mut most, &mut |_| {})?;
/// assert!(most.1 < 160, "no patch sees itself");
/// assert!(most.1 as u64 * summary.rows > summary.entries, "nor do all see as many");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait PartSink: Send {
    /// Takes the next part.
    ///
    /// # Errors
    /// When it cannot be kept. The computation then ends, and no further part comes.
    fn take(&mut self, part: Part) -> Result<(), crate::store::Error>;
}

impl PartSink for StoreWriter {
    fn take(&mut self, part: Part) -> Result<(), crate::store::Error> {
        self.write_part(&part)
    }
}

/// Keeps the parts in memory.
impl PartSink for Vec<Part> {
    fn take(&mut self, part: Part) -> Result<(), crate::store::Error> {
        self.push(part);
        Ok(())
    }
}

/// Progress of a computation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Rows of elements finished.
    pub rows: u64,
    /// Rows of elements in all.
    pub row_count: u64,
    /// Entries of the finished rows.
    pub entries: u64,
}

/// Threads, batches and cancellation of a computation. Nothing here changes a bit of the result.
#[derive(Clone, Copy, Debug, Default)]
pub struct Execution<'a> {
    /// Worker threads; 0: one a core.
    pub threads: usize,
    /// Hemicubes a call of the backend; 0: its preference.
    pub batch: usize,
    /// When this becomes true, the run ends, [`Summary::cancelled`]. The part under way is finished if that takes no
    /// longer than half a second; otherwise its rows are computed again when the run is resumed.
    pub cancel: Option<&'a AtomicBool>,
}

impl Execution<'_> {
    /// Returns whether it was cancelled.
    pub(crate) fn is_cancelled(&self) -> bool {
        self.cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed))
    }
}

/// Figures of a computation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Rows computed, of patches.
    pub rows: u64,
    /// Entries in them.
    pub entries: u64,
    /// Parts handed to the sink.
    pub parts: u64,
    /// Weights of all rows together.
    pub sums: RowSums,
    /// Hemicubes rendered, the unit of `sums`.
    pub hemicubes: u64,
    /// Rays and points spent on visible fractions.
    pub rays: u64,
    /// Work of closed forms and visible fractions in steps of about a nanosecond, counted; rendering is in `counters`.
    pub steps: u64,
    /// Expected Σ (F − true F)² of all rows; 0 at accuracy levels that do not estimate it.
    pub squared_error: f64,
    /// Σ F² of all rows.
    pub squared_norm: f64,
    /// Effect of leaving out small form factors, where that was asked for.
    pub thinning: Option<Thinning>,
    /// Entries that are a visible fraction of a closed form, not a sum of pixels; those of elements' rows.
    pub corrected: u64,
    /// Partially visible pairs, at accuracy levels that know.
    pub partial: u64,
    /// Rows taken over from the matrix of an earlier state of the scene.
    pub taken: u64,
    /// Rows of elements that met the bound on their work before all pairs worth it were measured. Their expected error,
    /// at accuracy levels that estimate it, includes the pairs left.
    pub cut_short: u64,
    /// Counts of the backend.
    pub counters: Counters,
    /// True if it was cancelled before the last row.
    pub cancelled: bool,
    /// Worker threads used.
    pub threads: usize,
    /// Time from the first row's request to the last part's writing.
    pub elapsed: Duration,
    /// The element of the slowest row and its time; `None` without rows.
    pub slowest: Option<(InputPatch, Duration)>,
    /// Sum of the rows' times.
    pub row_time: Duration,
    /// Sum of the squares of the rows' times, in s².
    pub row_time_squared: f64,
    /// Time in the sink, in parallel with the rows.
    pub sink: Duration,
}

/// Why a computation failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ComputeError {
    /// The backend reported an error.
    #[error("backend `{backend}`: {source}")]
    Backend {
        /// Its name.
        backend: String,
        /// Its error.
        source: BackendError,
    },
    /// The backend returned rows that break the contract.
    #[error("backend `{backend}` returned a wrong row for the batch that begins with patch {patch}: {source}")]
    Row {
        /// Its name.
        backend: String,
        /// The first patch of the batch.
        patch: u32,
        /// Kind of defect.
        source: RowError,
    },
    /// A worker or the sink panicked: a defect of this program.
    #[error("a worker thread panicked: {message}; this is a defect of hemicube, please report it")]
    Panic {
        /// The panic's message.
        message: String,
    },
    /// It was cancelled before there was a row.
    #[error("the computation was cancelled before its first row")]
    Cancelled,
    /// The sink could not keep a part.
    #[error(transparent)]
    Store(#[from] crate::store::Error),
}

/// Loads a model into a backend as [`compute`] does, with covered weights if `correction` needs them. From then on
/// [`HemicubeBackend::info`] and [`HemicubeBackend::choices`] are those of the run. Returns the settings loaded.
///
/// # Errors
/// When the backend cannot take the model or the settings.
pub fn load(
    model: &Model,
    correction: &Correction,
    settings: RenderSettings,
    backend: &mut dyn HemicubeBackend,
) -> Result<RenderSettings, ComputeError> {
    let settings = RenderSettings {
        covered: settings.covered || correction.needs_covered(),
        ..settings
    };
    // Corrections use weights for fractions only.
    let loaded = if correction.needs_covered() {
        backend.load_for_fractions(model.geometry(), settings)
    } else {
        backend.load(model.geometry(), settings)
    };
    match loaded {
        Ok(()) => Ok(settings),
        Err(source) => Err(ComputeError::Backend {
            backend: backend.info().name.clone(),
            source,
        }),
    }
}

/// Computes the rows of `plan` with `backend` and hands them, part by part, to `sink`.
///
/// Loads `settings` into the backend, with covered weights if the plan's correction needs them. Calls `progress` on
/// this thread some times a second.
///
/// # Errors
/// When the backend fails or breaks the contract, or the sink cannot keep a part. Earlier parts stay.
///
/// Threads and batches change no bit of the rows:
///
/// ```
/// use hemicube::driver::compute::{ComputeError, Execution, compute};
/// use hemicube::store::{HEMICUBE_WEIGHT, Part};
/// use hemicube_backend_cpu::CpuBackend;
/// # use hemicube::accuracy::correct::Correction;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model()?;
/// # let (plan, settings) = (room::plan(&model, Correction::Pixel), room::RENDER);
///
/// let rows_by = |threads, batch| {
///     let execution = Execution { threads, batch, cancel: None };
///     let (backend, mut parts) = (Box::new(CpuBackend::new()), Vec::<Part>::new());
///     let summary = compute(&model, &plan, settings, backend, execution, &mut parts, &mut |progress| {
///         assert!(progress.rows <= progress.row_count);
///     })?;
///     Ok::<_, ComputeError>((summary, parts))
/// };
/// let (summary, parts) = rows_by(1, 1)?;
/// assert_eq!(parts, rows_by(3, 7)?.1);
///
/// // Weights are conserved, to the last of the 2³¹ of each hemicube.
/// assert_eq!(summary.sums.total(), Some(summary.hemicubes * HEMICUBE_WEIGHT));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn compute(
    model: &Model,
    plan: &Plan,
    settings: RenderSettings,
    backend: Box<dyn HemicubeBackend>,
    execution: Execution<'_>,
    sink: &mut dyn PartSink,
    progress: &mut dyn FnMut(Progress),
) -> Result<Summary, ComputeError> {
    let mut bands = [Band { plan, sink }];
    let summaries = compute_bands(model, &mut bands, settings, backend, execution, progress)?;
    summaries.into_iter().next().ok_or(ComputeError::Cancelled)
}

/// A matrix of several that are computed together: plans that differ in nothing but their mirrors and panes.
pub struct Band<'a> {
    /// The plan.
    pub plan: &'a Plan,
    /// Takes the parts.
    pub sink: &'a mut dyn PartSink,
}

/// Computes the rows of several matrices by [`compute`]: what a row sees directly is rendered and refined once for all
/// of them. Rows are those of each alone, to the bit. Returns a summary each, with the times and counts of all.
///
/// # Errors
/// As for [`compute`].
///
/// # Panics
/// Without a matrix.
pub fn compute_bands(
    model: &Model,
    bands: &mut [Band<'_>],
    settings: RenderSettings,
    mut backend: Box<dyn HemicubeBackend>,
    execution: Execution<'_>,
    progress: &mut dyn FnMut(Progress),
) -> Result<Vec<Summary>, ComputeError> {
    let plans: Vec<&Plan> = bands.iter().map(|band| band.plan).collect();
    let plan = plans[0];
    let settings = load(model, &plan.correction, settings, backend.as_mut())?;
    let batches = Batches::new(plan, execution.batch, backend.as_ref());
    let sessions = sessions(backend, execution.threads, batches.count)?;
    let run = Run {
        model,
        plan,
        plans,
        settings,
        queue: Queue::new(batches.count),
        abandon: AtomicBool::new(false),
        batches,
        window: 8 * sessions.len(),
    };
    let started = Instant::now();
    let mut collectors = Collectors::new(&run, sessions.len());
    let sink_time = std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::channel();
        let run = &run;
        let _stop = StopOnPanic(&run.queue);
        let mut parts = Vec::with_capacity(bands.len());
        let writers: Vec<_> = bands
            .iter_mut()
            .map(|band| {
                let (sender, finished) = mpsc::sync_channel(PARTS_WAITING);
                parts.push(sender);
                let sink = &mut *band.sink;
                scope.spawn(move || {
                    let _stop = StopOnPanic(&run.queue);
                    keep_parts(&finished, &run.queue, sink)
                })
            })
            .collect();
        let workers: Vec<_> = sessions
            .into_iter()
            .map(|session| {
                let sender = sender.clone();
                scope.spawn(move || Worker::new(run, session).work(&sender))
            })
            .collect();
        drop(sender);

        let result = collectors.collect(&receiver, parts, execution.cancel, progress);
        // However the collection ended, nobody may wait for it, and no further rows are wanted.
        run.queue.stop_at(0);
        run.abandon.store(true, Ordering::Relaxed);
        drop(receiver);
        let mut panic = None;
        for worker in workers {
            if let Err(payload) = worker.join() {
                panic.get_or_insert(panicked(payload.as_ref()));
            }
        }
        // Waiting parts are whole, and are written however the run ended.
        let mut kept = Vec::with_capacity(writers.len());
        for writer in writers {
            kept.push(match writer.join() {
                Ok(kept) => kept.map_err(ComputeError::from),
                Err(payload) => Err(panic.take().unwrap_or_else(|| panicked(payload.as_ref()))),
            });
        }
        panic.map_or(result, Err)?;
        kept.into_iter().collect::<Result<Vec<Duration>, ComputeError>>()
    })?;
    let elapsed = started.elapsed();
    let summaries = collectors.each.into_iter().zip(sink_time);
    let summaries = summaries.map(|(collector, sink)| Summary {
        sink,
        elapsed,
        ..collector.summary
    });
    Ok(summaries.collect())
}

/// A session for each worker: at most one a batch.
fn sessions(
    backend: Box<dyn HemicubeBackend>,
    threads: usize,
    batch_count: usize,
) -> Result<Vec<Box<dyn HemicubeBackend>>, ComputeError> {
    let threads = match threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads,
    }
    .clamp(1, batch_count.max(1));
    let mut sessions = Vec::with_capacity(threads);
    for _ in 1..threads {
        let forked = backend.fork().map_err(|source| ComputeError::Backend {
            backend: backend_name(backend.as_ref()),
            source,
        });
        sessions.push(forked?);
    }
    sessions.push(backend);
    Ok(sessions)
}

fn panicked(payload: &(dyn std::any::Any + Send)) -> ComputeError {
    let message = payload
        .downcast_ref::<&str>()
        .map(|s| (*s).to_owned())
        .or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".to_owned());
    ComputeError::Panic { message }
}

/// Parts that wait while the sink takes one: two keep a slow disk busy. A third one stops the workers, which bounds
/// memory.
const PARTS_WAITING: usize = 2;

/// Hands parts to the sink as they come. Returns the sink's time. An error of the sink stops the queue.
fn keep_parts(
    finished: &mpsc::Receiver<Part>,
    queue: &Queue,
    sink: &mut dyn PartSink,
) -> Result<Duration, crate::store::Error> {
    let mut spent = Duration::ZERO;
    for part in finished {
        let before = Instant::now();
        if let Err(error) = sink.take(part) {
            queue.stop_at(0);
            return Err(error);
        }
        spent += before.elapsed();
    }
    Ok(spent)
}

/// The batches of a plan: rows of one part that a worker renders by one call of the backend.
#[derive(Debug)]
struct Batches<'a> {
    plan: &'a Plan,
    /// The parts to compute.
    parts: Vec<u32>,
    /// Number of the first batch after each of them.
    ends: Vec<usize>,
    rows_per_batch: usize,
    count: usize,
}

/// Most rows of a batch.
const ROWS_PER_BATCH_MAX: usize = 1024;

impl<'a> Batches<'a> {
    /// Batches of `hemicubes` hemicubes; 0: as the backend prefers.
    fn new(plan: &'a Plan, hemicubes: usize, backend: &dyn HemicubeBackend) -> Self {
        let hemicubes = match hemicubes {
            0 => backend.info().preferred_rows,
            hemicubes => hemicubes,
        };
        let most = match plan.groups {
            Some(_) => ROWS_PER_BATCH_MAX,
            None => plan.rows_per_part as usize,
        };
        let rows_per_batch = (hemicubes / plan.hemicubes_per_row().max(1)).clamp(1, most);
        let parts = plan.wanted();
        let mut count = 0;
        let ends = parts.iter().map(|&part| {
            count += plan.rows_of_part(part).len().div_ceil(rows_per_batch);
            count
        });
        Self {
            ends: ends.collect(),
            count,
            plan,
            parts,
            rows_per_batch,
        }
    }

    /// The emitters of a batch.
    fn rows(&self, batch: usize) -> &'a [InputPatch] {
        let part = self.ends.partition_point(|&end| end <= batch);
        let first = part.checked_sub(1).map_or(0, |before| self.ends[before]);
        let rows = self.plan.rows_of_part(self.parts[part]);
        let start = rows.start + (batch - first) * self.rows_per_batch;
        &self.plan.rows[start..(start + self.rows_per_batch).min(rows.end)]
    }

    /// The end of a part's batches, from `batch` on.
    fn end_from(&self, batch: usize) -> usize {
        if batch == 0 {
            return 0;
        }
        let part = self.ends.partition_point(|&end| end < batch);
        self.ends.get(part).copied().unwrap_or(self.count)
    }
}

/// Everything that workers and collector share.
#[derive(Debug)]
struct Run<'a> {
    model: &'a Model,
    plan: &'a Plan,
    /// The plan of each band, the first of which is `plan`.
    plans: Vec<&'a Plan>,
    settings: RenderSettings,
    batches: Batches<'a>,
    queue: Queue,
    /// Batches that workers may be ahead of the collector.
    window: usize,
    /// Set when rows under way are not wanted any more.
    abandon: AtomicBool,
}

/// Rows of one batch, ready to be appended to a part.
#[derive(Debug, Default)]
struct Batch {
    /// With the change of each, where small entries are left out. Where patches are several elements, the elements'
    /// rows with added up columns.
    rows: Vec<(FinishedRow, Option<small_entries::RowChange>)>,
    /// Entries of elements' rows before that.
    pairs: u64,
    partial: u64,
    cut_short: u64,
    taken: u64,
    counters: Counters,
    slowest: Option<(InputPatch, Duration)>,
    row_time: Duration,
    row_time_squared: f64,
    steps: u64,
}

/// A batch by its number, of each band, or its failure.
type Computed = (usize, Result<Vec<Batch>, ComputeError>);

/// A row of a batch, and its hemicubes there.
#[derive(Debug)]
struct BatchRow {
    emitter: InputPatch,
    /// The row, where it is taken over: it has no hemicubes then.
    taken: Option<FinishedRow>,
    /// n of the n² hemicubes.
    per_edge: u32,
    hemicubes: Range<usize>,
}

/// A worker's state of one band.
struct WorkerBand<'a> {
    plan: &'a Plan,
    columns: ColumnSums,
    /// The columns of mirrors and panes.
    portals: Vec<bool>,
    extender: Option<Extender<'a>>,
}

impl<'a> WorkerBand<'a> {
    fn new(run: &'a Run<'a>, plan: &'a Plan, table: &OnceCell<Arc<DeltaTable>>) -> Self {
        Self {
            plan,
            columns: ColumnSums::default(),
            portals: plan.portal_columns(),
            extender: (!plan.portals.is_empty()).then(|| {
                let (portals, correction) = (&plan.portals, plan.correction);
                let table = || Arc::clone(table.get_or_init(|| Arc::new(DeltaTable::new(run.settings.resolution))));
                Extender::new(portals, run.model, correction, table, &run.abandon)
            }),
        }
    }

    /// Ends a row that is seen directly: extends it, adds it up or thins it, and appends it to the batch.
    fn end_row(
        &mut self,
        mut row: FinishedRow,
        drawn: Drawn<'_>,
        session: &mut dyn HemicubeBackend,
        common: (&mut Common, usize),
        batch: &mut Batch,
    ) -> Result<(), ComputeError> {
        let plan = self.plan;
        if let Some(extender) = &mut self.extender {
            let extended = extender.extend(&mut row, drawn, |patch| plan.selection.receives(patch), session, common);
            extended.map_err(|source| failed(session, source))?;
        }
        let mut change = None;
        if let Some(groups) = &plan.groups {
            batch.pairs += row.factors.len() as u64;
            self.columns.add_up(&groups.grouping, &mut row);
        } else if plan.keeping(&self.portals).changes() {
            let changed = small_entries::keep(&mut row, plan.keeping(&self.portals));
            change = (plan.min_factor > 0.0).then_some(changed);
        }
        batch.rows.push((row, change));
        Ok(())
    }
}

/// Bound of the pixels of one row's item buffers that are kept until its portals are followed: 64 MiB. Of larger rows
/// each hemicube is drawn again.
const MOST_PIXELS_KEPT: u64 = 1 << 24;

/// Computes batches on a thread of its own.
struct Worker<'a> {
    run: &'a Run<'a>,
    session: Box<dyn HemicubeBackend>,
    rows: RowBlock,
    converter: Converter<'a>,
    bands: Vec<WorkerBand<'a>>,
    /// What bands share behind their portals.
    common: Common,
    /// True where one drawing gives a row and the pixels that the extender follows: `items`, of the row under way.
    draws_once: bool,
    items: Vec<Items>,
}

impl<'a> Worker<'a> {
    fn new(run: &'a Run<'a>, session: Box<dyn HemicubeBackend>) -> Self {
        let follows_pixels =
            run.plan.correction == Correction::Pixel && run.plans.iter().any(|plan| plan.portals.specular.is_some());
        let table = OnceCell::new();
        let bands: Vec<_> = run
            .plans
            .iter()
            .map(|&plan| WorkerBand::new(run, plan, &table))
            .collect();
        Self {
            run,
            common: Common::new(bands.iter().filter_map(|band| band.extender.as_ref())),
            draws_once: follows_pixels && session.draws_once(),
            items: Vec::new(),
            session,
            rows: RowBlock::default(),
            converter: Converter::new(run.plan.correction, run.plan.form.precision(), Some(&run.abandon)),
            bands,
        }
    }

    /// Computes batches until there are no more, one fails, or nobody collects them.
    fn work(mut self, sender: &mpsc::Sender<Computed>) {
        let Run { queue, abandon, .. } = self.run;
        let _stop = StopOnPanic(queue);
        while let Some(batch) = queue.take(self.run.window) {
            let result = self.compute(self.run.batches.rows(batch));
            if abandon.load(Ordering::Relaxed) {
                break;
            }
            let failed = result.is_err();
            if sender.send((batch, result)).is_err() || failed {
                queue.stop_at(0);
                break;
            }
        }
    }

    /// Renders, checks and converts the rows of one batch, for each band.
    fn compute(&mut self, emitters: &[InputPatch]) -> Result<Vec<Batch>, ComputeError> {
        let Run { model, plan, .. } = self.run;
        let mut hemicubes = Vec::with_capacity(emitters.len());
        let mut rows = Vec::with_capacity(emitters.len());
        for &emitter in emitters {
            let start = hemicubes.len();
            let taken = plan
                .taken
                .as_ref()
                .map(|taken| taken.row(emitter))
                .transpose()?
                .flatten();
            let per_edge = plan.per_edge(model, emitter);
            if taken.is_none() {
                hemicubes.extend(model.hemicubes(emitter, per_edge, plan.rotate));
            }
            rows.push(BatchRow {
                emitter,
                taken,
                per_edge,
                hemicubes: start..hemicubes.len(),
            });
        }
        self.rows.clear();
        let first = emitters.first().copied().unwrap_or(InputPatch(0));
        let (began, steps_before) = (Instant::now(), steps::taken());
        let session = self.session.as_mut();
        let counters = if self.draws_once || hemicubes.is_empty() {
            Counters::default()
        } else {
            render(model, self.run.settings, session, first, &hemicubes, &mut self.rows)?
        };
        let rendering = began.elapsed();

        let batch = || Batch {
            counters,
            ..Batch::default()
        };
        let mut batches: Vec<Batch> = self.bands.iter().map(|_| batch()).collect();
        for mut row in rows {
            if self.converter.is_cancelled() {
                break;
            }
            if let Some(taken) = row.taken.take() {
                self.end_taken(taken, &mut batches)?;
                continue;
            }
            let began = Instant::now();
            let own = &hemicubes[row.hemicubes.clone()];
            if self.draws_once {
                let counters = self.draw(row.emitter, own)?;
                batches.iter_mut().for_each(|batch| batch.counters += counters);
                row.hemicubes = 0..own.len();
            }
            self.convert(&row, own, &mut batches)?;
            // Hemicubes are rendered together: each has its share of that time.
            let share = row.hemicubes.len() as f64 / hemicubes.len().max(1) as f64;
            let took = began.elapsed() + rendering.mul_f64(share);
            for batch in &mut batches {
                batch.row_time += took;
                batch.row_time_squared += took.as_secs_f64().powi(2);
                if batch.slowest.is_none_or(|(_, longest)| took > longest) {
                    batch.slowest = Some((row.emitter, took));
                }
            }
        }
        let steps = steps::taken() - steps_before;
        batches.iter_mut().for_each(|batch| batch.steps = steps);
        Ok(batches)
    }

    /// Ends a row that is taken over, for each band.
    fn end_taken(&mut self, row: FinishedRow, batches: &mut [Batch]) -> Result<(), ComputeError> {
        let drawn = Drawn {
            hemicubes: &[],
            items: &[],
        };
        let session = self.session.as_mut();
        let rows = std::iter::repeat_n(row, batches.len());
        for (number, ((band, batch), row)) in self.bands.iter_mut().zip(batches).zip(rows).enumerate() {
            batch.taken += 1;
            band.end_row(row, drawn, session, (&mut self.common, number), batch)?;
        }
        Ok(())
    }

    /// Renders and checks a row, with its item buffers unless they exceed [`MOST_PIXELS_KEPT`].
    fn draw(&mut self, emitter: InputPatch, hemicubes: &[Hemicube]) -> Result<Counters, ComputeError> {
        self.rows.clear();
        self.items.clear();
        let session = self.session.as_mut();
        let pixels = 3 * u64::from(self.run.settings.resolution).pow(2) * hemicubes.len() as u64;
        let drawn = if pixels <= MOST_PIXELS_KEPT {
            session.rows_and_items(hemicubes, &mut self.rows, &mut self.items)
        } else {
            session.rows(hemicubes, &mut self.rows)
        };
        let counters = drawn.map_err(|source| failed(session, source))?;
        check(
            session,
            self.run.model,
            self.run.settings,
            emitter,
            &self.rows,
            hemicubes.len(),
        )?;
        Ok(counters)
    }

    /// Converts a rendered row, with more hemicubes where it is inconsistent, and ends it for each band.
    fn convert(&mut self, row: &BatchRow, hemicubes: &[Hemicube], batches: &mut [Batch]) -> Result<(), ComputeError> {
        let Run { model, plan, .. } = self.run;
        let emitter = row.emitter;
        let receives = |patch| plan.selection.receives(patch);
        let attempts = more_per_edge(plan, row.per_edge);
        let mut attempt = Attempt {
            is_large: row.per_edge > plan.samples_per_edge,
            is_last: attempts.is_empty(),
        };
        let Some(Batch { counters: all, .. }) = batches.first_mut() else {
            return Ok(());
        };
        let rendered = Rendered {
            model,
            emitter,
            hemicubes,
            rows: row.hemicubes.clone().map(|place| self.rows.row(place)),
            attempt,
        };
        let mut taken = None;
        let caster = Caster::new(self.session.as_mut());
        let converted = self.converter.convert(rendered, receives, caster);
        let mut converted = converted.map_err(|source| failed(self.session.as_ref(), source))?;
        for (place, &per_edge) in attempts.iter().enumerate() {
            if !converted.is_odd {
                break;
            }
            // The hemicubes' points do not represent the emitter: its centroid lies in a solid that it reaches out of,
            // say.
            let more = model.hemicubes(emitter, per_edge, plan.rotate);
            let mut rows = RowBlock::default();
            let session = self.session.as_mut();
            *all += render(model, self.run.settings, session, emitter, &more, &mut rows)?;
            attempt.is_last = place + 1 == attempts.len();
            let rendered = Rendered {
                model,
                emitter,
                hemicubes: &more,
                rows: (0..more.len()).map(|row| rows.row(row)),
                attempt,
            };
            let lost = converted.lost;
            let again = self.converter.convert(rendered, receives, Caster::new(session));
            converted = again.map_err(|source| failed(session, source))?;
            taken = Some(more);
            if matches!(plan.correction, Correction::Tolerance(_)) && (converted.lost - lost).abs() > LOST {
                break;
            }
        }
        let drawn = Drawn {
            hemicubes: taken.as_deref().unwrap_or(hemicubes),
            items: if taken.is_none() { &self.items } else { &[] },
        };
        for batch in batches.iter_mut() {
            batch.partial += converted.partial;
            batch.cut_short += u64::from(converted.cut_short);
        }
        let session = self.session.as_mut();
        let extenders: Vec<&Extender<'_>> = self.bands.iter().filter_map(|band| band.extender.as_ref()).collect();
        if extenders.len() > 1 {
            let seen = Seen {
                drawn,
                columns: &converted.row.columns,
            };
            let began = self.common.begin_row(&extenders, seen, receives, session);
            began.map_err(|source| failed(session, source))?;
        }
        let rows = std::iter::repeat_n(converted.row, batches.len());
        for (number, ((band, batch), row)) in self.bands.iter_mut().zip(batches).zip(rows).enumerate() {
            band.end_row(row, drawn, session, (&mut self.common, number), batch)?;
        }
        Ok(())
    }
}

/// Largest difference of a row's non-visible share between two sets of hemicubes. Above it the hemicubes know the share
/// worse than rays know the form factors, and the sum of both tells nothing.
const LOST: f64 = 0.01;

/// n of the n² hemicubes of an inconsistent row: of its next attempt, and of the one after that. At most
/// [`MOST_PER_EDGE`], or 4 times the plan's n.
fn more_per_edge(plan: &Plan, per_edge: u32) -> Vec<u32> {
    // In the open, the centroid of an inconsistent row is a bad place to see the sky from. In a closed scene its sum is
    // part of the promise.
    let times: &[u32] = if plan.correction.is_in_the_open() {
        &[2]
    } else {
        &[2, 4]
    };
    let most = MOST_PER_EDGE.max(plan.samples_per_edge * 4);
    let more = times.iter().map(|times| times * per_edge);
    more.take_while(|&more| more <= most).collect()
}

/// Renders and checks rows. Errors name `first`, the first emitter.
pub(crate) fn render(
    model: &Model,
    settings: RenderSettings,
    backend: &mut dyn HemicubeBackend,
    first: InputPatch,
    hemicubes: &[Hemicube],
    rows: &mut RowBlock,
) -> Result<Counters, ComputeError> {
    let counters = backend
        .rows(hemicubes, rows)
        .map_err(|source| failed(backend, source))?;
    check(backend, model, settings, first, rows, hemicubes.len())?;
    Ok(counters)
}

/// Checks `count` rows. Errors name `first`, the first emitter.
fn check(
    backend: &dyn HemicubeBackend,
    model: &Model,
    settings: RenderSettings,
    first: InputPatch,
    rows: &RowBlock,
    count: usize,
) -> Result<(), ComputeError> {
    rows.check(count, model.geometry().patch_count, settings.covered)
        .map_err(|source| ComputeError::Row {
            backend: backend_name(backend),
            patch: first.0,
            source,
        })
}

fn failed(backend: &dyn HemicubeBackend, source: BackendError) -> ComputeError {
    ComputeError::Backend {
        backend: backend_name(backend),
        source,
    }
}

fn backend_name(backend: &dyn HemicubeBackend) -> String {
    backend.info().name.clone()
}

/// Puts batches back in order, and has the parts of each band made of them.
#[derive(Debug)]
struct Collectors<'a> {
    run: &'a Run<'a>,
    each: Vec<Collector<'a>>,
    /// Batches that came before their turn.
    early: BTreeMap<usize, Vec<Batch>>,
    /// The next batch.
    next: usize,
    /// When the run was cancelled.
    cancelled: Option<Instant>,
}

/// Appends the batches of a band to parts, and adds up their figures.
#[derive(Debug)]
struct Collector<'a> {
    run: &'a Run<'a>,
    plan: &'a Plan,
    row_count: u64,
    /// The part under way.
    part: Part,
    /// The row under way, where patches are several elements, and the elements that have come.
    open: Option<OpenRow<'a>>,
    elements: u64,
    /// Place of the next part among the parts to compute.
    next_part: usize,
    thinned: PartThinning,
    summary: Summary,
}

impl<'a> Collectors<'a> {
    fn new(run: &'a Run<'a>, threads: usize) -> Self {
        Self {
            run,
            each: run
                .plans
                .iter()
                .map(|&plan| Collector::new(run, plan, threads))
                .collect(),
            early: BTreeMap::new(),
            next: 0,
            cancelled: None,
        }
    }

    fn progress(&self) -> Progress {
        self.each.first().map(Collector::progress).unwrap_or_default()
    }

    /// Collects batches and hands full parts on, until all have come, one fails, or `cancel` is set. Ends early,
    /// without an error of its own, when nobody takes parts any more.
    fn collect(
        &mut self,
        batches: &mpsc::Receiver<Computed>,
        parts: Vec<mpsc::SyncSender<Part>>,
        cancel: Option<&AtomicBool>,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<(), ComputeError> {
        progress(self.progress());
        loop {
            self.look_for_cancellation(cancel);
            // A time-out: a cancellation is noticed, and passing time shown, while one slow batch is under way.
            let (index, batch) = match batches.recv_timeout(Duration::from_millis(100)) {
                Ok(received) => received,
                Err(mpsc::RecvTimeoutError::Timeout) => {
                    progress(self.progress());
                    continue;
                }
                Err(mpsc::RecvTimeoutError::Disconnected) => break,
            };
            self.early.insert(index, batch?);
            while let Some(batches) = self.early.remove(&self.next) {
                self.next += 1;
                for ((collector, batch), parts) in self.each.iter_mut().zip(batches).zip(&parts) {
                    collector.append(batch);
                    if self.run.batches.ends.get(collector.next_part - 1) == Some(&self.next) {
                        let part = collector.end_part();
                        if parts.send(part).is_err() {
                            return Ok(());
                        }
                    }
                }
            }
            self.run.queue.collected(self.next);
            progress(self.progress());
        }
        self.each.iter_mut().for_each(Collector::end);
        Ok(())
    }

    /// After a cancellation, ends the queue with the part under way, and after [`PATIENCE`] the rows as well.
    fn look_for_cancellation(&mut self, cancel: Option<&AtomicBool>) {
        if self.cancelled.is_some_and(|since| since.elapsed() > PATIENCE) {
            self.run.abandon.store(true, Ordering::Relaxed);
        }
        if self.cancelled.is_none() && cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
            self.cancelled = Some(Instant::now());
            // Whole parts only: the part of the first batch not yet handed out is still computed.
            let queue = &self.run.queue;
            queue.stop_at(self.run.batches.end_from(queue.next()));
        }
    }
}

impl<'a> Collector<'a> {
    fn new(run: &'a Run<'a>, plan: &'a Plan, threads: usize) -> Self {
        let mut collector = Self {
            run,
            plan,
            row_count: plan.elements_of(plan.wanted()),
            part: Part::new(plan.form),
            open: OpenRow::new(plan),
            elements: 0,
            next_part: 0,
            thinned: PartThinning::default(),
            summary: Summary {
                threads,
                ..Summary::default()
            },
        };
        collector.part = collector.begin_part();
        collector
    }

    fn is_thinned(&self) -> bool {
        self.plan.min_factor > 0.0
    }

    /// An empty part. Past the last one nothing comes.
    fn begin_part(&mut self) -> Part {
        let index = self.run.batches.parts.get(self.next_part).copied();
        self.next_part += 1;
        Part {
            index: index.unwrap_or(u32::MAX),
            indptr: vec![0],
            thinning: self.is_thinned().then(PartThinning::default),
            ..Part::new(self.plan.form)
        }
    }

    fn progress(&self) -> Progress {
        Progress {
            rows: self.elements,
            row_count: self.row_count,
            entries: self.summary.entries + self.part.indices.len() as u64,
        }
    }

    /// Ends the figures.
    fn end(&mut self) {
        self.summary.cancelled = self.summary.rows < self.plan.wanted_rows();
        self.summary.thinning = self.is_thinned().then(|| self.thinned.finish(self.plan.min_factor));
    }

    /// Appends the next batch to the part under way.
    fn append(&mut self, batch: Batch) {
        self.summary.row_time += batch.row_time;
        self.summary.row_time_squared += batch.row_time_squared;
        self.summary.steps += batch.steps;
        self.summary.cut_short += batch.cut_short;
        self.summary.taken += batch.taken;
        if let Some((patch, took)) = batch.slowest
            && self.summary.slowest.is_none_or(|(_, longest)| took > longest)
        {
            self.summary.slowest = Some((patch, took));
        }
        self.summary.counters += batch.counters;
        self.summary.partial += batch.partial;
        self.elements += batch.rows.len() as u64;
        if self.open.is_some() {
            return self.add_up(&batch);
        }
        for (row, change) in &batch.rows {
            let area = self.run.model.patches().area(InputPatch(row.patch));
            self.push(row, change.as_ref().map(|change| (area, change)));
        }
    }

    /// Appends a row to the part under way, with its patch's area and change where small entries are left out.
    fn push(&mut self, row: &FinishedRow, change: Option<(f64, &small_entries::RowChange)>) {
        let place = self.part.rows.len();
        self.part.push(row);
        if let (Some(mut changed), Some((area, change))) = (self.part.thinning, change) {
            changed.add(&self.part, place, area, change);
            self.part.thinning = Some(changed);
        }
    }

    /// Adds the elements of a batch to the rows of their patches.
    fn add_up(&mut self, batch: &Batch) {
        if self.plan.correction != Correction::Pixel {
            self.summary.corrected += batch.pairs;
        }
        for (row, _) in &batch.rows {
            if self.open.as_ref().is_some_and(|open| open.ends_before(row.patch)) {
                self.close_row();
            }
            let area = self.run.model.patches().area(InputPatch(row.patch));
            if let Some(open) = &mut self.open {
                open.add(row, area);
            }
        }
    }

    /// Ends the row under way, of a patch of several elements.
    fn close_row(&mut self) {
        if let Some((row, area, change)) = self.open.as_mut().and_then(OpenRow::close) {
            self.push(&row, Some((area, &change)));
        }
    }

    /// Adds the figures of a full part to the summary and begins the next one.
    fn end_part(&mut self) -> Part {
        self.close_row();
        let next = self.begin_part();
        let part = std::mem::replace(&mut self.part, next);
        let summary = &mut self.summary;
        summary.rows += part.rows.len() as u64;
        summary.entries += part.indices.len() as u64;
        if self.plan.correction != Correction::Pixel && self.open.is_none() {
            summary.corrected += part.indices.len() as u64;
        }
        summary.parts += 1;
        summary.rays += part.rays.iter().map(|&r| u64::from(r)).sum::<u64>();
        summary.squared_error += part.squared_error();
        summary.squared_norm += part.data.iter().map(|factor| factor.powi(2)).sum::<f64>();
        summary.hemicubes += part.hemicubes.iter().map(|&h| u64::from(h)).sum::<u64>();
        for sums in &part.sums {
            summary.sums.visible += sums.visible;
            summary.sums.escaped += sums.escaped;
            summary.sums.blocked += sums.blocked;
            summary.sums.unselected += sums.unselected;
        }
        if let Some(of_part) = &part.thinning {
            self.thinned.merge(of_part);
        }
        part
    }
}

/// Time that a cancelled run may take to finish the part under way.
const PATIENCE: Duration = Duration::from_millis(500);
