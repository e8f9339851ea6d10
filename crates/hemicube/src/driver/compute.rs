//! The driver: patches in the order of work → hemicubes → a backend → checked rows → parts → a sink.
//!
//! Rows do not depend on threads or batches: a row comes from its own hemicubes only, parts are fixed runs of the order
//! of work, and workers' results are put back in order before they leave.

use crate::Model;
use crate::accuracy::correct::{Attempt, Converter, Correction, Rendered};
use crate::accuracy::grain::{Grain, MOST_PER_EDGE};
use crate::backend::{BackendError, Counters, Hemicube, HemicubeBackend, RenderSettings};
use crate::row::{RowBlock, RowError};
use crate::sampling::splitmix;
use crate::store::{Form, Part, PartThinning, RowSums, StoreWriter, Thinning, small_entries};
use hemicube_scene::InputPatch;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError, mpsc};
use std::time::{Duration, Instant};

/// Which patches have rows and columns. Everything occludes, selected or not.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// For each patch whether it has a row; `None`: all have.
    pub emitters: Option<Vec<bool>>,
    /// For each patch whether it has a column; `None`: all have. What the others receive is counted as *unselected*.
    pub receivers: Option<Vec<bool>>,
}

impl Selection {
    fn emits(&self, patch: InputPatch) -> bool {
        self.emitters.as_ref().is_none_or(|e| e[patch.0 as usize])
    }

    fn receives(&self, patch: u32) -> bool {
        self.receivers.as_ref().is_none_or(|r| r[patch as usize])
    }
}

/// Which rows of the matrix to compute.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RowChoice {
    /// All that emit.
    All,
    /// Those of the input patches `start..end`.
    Range {
        /// The first input patch.
        start: u32,
        /// One past the last.
        end: u32,
    },
    /// A sample of this many, drawn without repetition.
    Sample {
        /// How many; all of them if there are fewer.
        count: u32,
        /// Which sample.
        seed: u64,
    },
}

/// What is to be computed: the rows in the order of work, cut into parts.
///
/// ```
/// use hemicube::driver::compute::{Plan, RowChoice, Selection};
/// use hemicube::accuracy::correct::Correction;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model()?;
///
/// // All rows of the room's 160 patches, four hemicubes each, corrected for area.
/// let plan = Plan::new(&model, RowChoice::All, Selection::default(), 2, true).with_correction(Correction::area());
/// assert_eq!((plan.rows.len(), plan.hemicubes_per_row(), plan.part_count()), (160, 4, 3));
///
/// // Ten rows of them: the same ten whenever the seed is the same.
/// let ten = |seed| Plan::new(&model, RowChoice::Sample { count: 10, seed }, Selection::default(), 1, true).rows;
/// assert_eq!(ten(1).len(), 10);
/// assert!(ten(1) == ten(1) && ten(1) != ten(2));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The emitting patch of each row, in the order of work.
    pub rows: Vec<InputPatch>,
    /// Rows of a part; the last part may have fewer.
    pub rows_per_part: u32,
    /// n of the n² hemicubes of a row.
    pub samples_per_edge: u32,
    /// True if each hemicube is turned about its normal.
    pub rotate: bool,
    /// Which patches have rows and columns.
    pub selection: Selection,
    /// How weights become form factors.
    pub correction: Correction,
    /// Form factors below this are left out, and the others of the row share what they carried; 0: none is.
    pub min_factor: f64,
    /// What form factors are rounded to.
    pub form: Form,
    /// The parts to compute, ascending; `None`: all. Parts do not depend on each other, so leaving out those that are
    /// there already, or that another process computes, changes nothing in the others.
    pub parts: Option<Vec<u32>>,
}

impl Plan {
    /// Plans the rows of `choice`. Depends on the scene and the settings only.
    pub fn new(model: &Model, choice: RowChoice, selection: Selection, samples_per_edge: u32, rotate: bool) -> Self {
        let mut rows: Vec<InputPatch> = model.order().filter(|&p| selection.emits(p)).collect();
        match choice {
            RowChoice::All => {}
            RowChoice::Range { start, end } => rows.retain(|p| (start..end).contains(&p.0)),
            RowChoice::Sample { count, seed } => rows = sample(&rows, count as usize, seed),
        }
        Self {
            rows_per_part: Self::rows_per_part_of(rows.len()),
            rows,
            samples_per_edge,
            rotate,
            selection,
            correction: Correction::Pixel,
            min_factor: 0.0,
            form: Form::Plain,
            parts: None,
        }
    }

    /// Number of rows that a part of a plan of so many rows has.
    #[allow(clippy::cast_possible_truncation, reason = "clamped to 1024")]
    pub fn rows_per_part_of(rows: usize) -> u32 {
        // A part is what a killed run loses and what a job of a cluster computes: at most a few seconds and megabytes,
        // and some dozens of them even in a small scene.
        (rows / 64).next_power_of_two().clamp(64, 1024) as u32
    }

    /// The same plan for those of its parts that `wanted` says, to go on with a matrix or to compute a shard of it.
    #[must_use]
    pub fn with_parts(mut self, wanted: impl Fn(u32) -> bool) -> Self {
        let count = u32::try_from(self.part_count()).unwrap_or(u32::MAX);
        self.parts = Some((0..count).filter(|&part| wanted(part)).collect());
        self
    }

    /// The same plan with another rung of the accuracy ladder; that of a tolerance takes one hemicube a row.
    #[must_use]
    pub fn with_correction(mut self, correction: Correction) -> Self {
        if let Correction::Tolerance(_) = correction {
            self.samples_per_edge = 1;
        }
        self.correction = correction;
        self
    }

    /// The same plan without form factors below `min_factor`, at least 0 and below 1. The others of their row share
    /// what they carried in proportion, as [`balance`](crate::analysis::balance::balance) does it afterwards;
    /// [`Summary::thinning`] says what that did.
    #[must_use]
    pub fn with_min_factor(mut self, min_factor: f64) -> Self {
        self.min_factor = min_factor;
        self
    }

    /// The same plan for a store of another form: rows leave the driver as that store keeps them.
    #[must_use]
    pub fn with_form(mut self, form: Form) -> Self {
        self.form = form;
        self
    }

    /// Hemicubes along an edge of a patch: as planned, or as many as a patch asks for that is large beside what stands
    /// on it, on all rungs but that of pixel sums, which is the method as published.
    fn per_edge(&self, model: &Model, patch: InputPatch) -> u32 {
        match self.correction {
            Correction::Pixel => self.samples_per_edge,
            _ => Grain::of(model.geometry())
                .per_edge(model, patch)
                .max(self.samples_per_edge),
        }
    }

    /// Hemicubes of a row of a patch that is no larger than what stands on it.
    pub fn hemicubes_per_row(&self) -> usize {
        self.samples_per_edge as usize * self.samples_per_edge as usize
    }

    /// Number of parts.
    pub fn part_count(&self) -> usize {
        self.rows.len().div_ceil(self.rows_per_part as usize)
    }

    /// The places of a part's rows in [`Self::rows`]; none for a part that there is not.
    fn rows_of_part(&self, part: u32) -> std::ops::Range<usize> {
        let start = (part as usize * self.rows_per_part as usize).min(self.rows.len());
        start..(start + self.rows_per_part as usize).min(self.rows.len())
    }

    /// The parts to compute.
    fn wanted(&self) -> Vec<u32> {
        let count = u32::try_from(self.part_count()).unwrap_or(u32::MAX);
        match &self.parts {
            Some(parts) => parts.iter().copied().filter(|&part| part < count).collect(),
            None => (0..count).collect(),
        }
    }
}

/// Draws `count` of `rows`, keeping their order (Knuth 1969, algorithm 3.4.2 S).
pub(crate) fn sample(rows: &[InputPatch], count: usize, seed: u64) -> Vec<InputPatch> {
    let mut state = seed;
    let mut chosen = Vec::with_capacity(count.min(rows.len()));
    for (i, &row) in rows.iter().enumerate() {
        let z = splitmix::next(&mut state);
        let (left, wanted) = ((rows.len() - i) as u128, count.saturating_sub(chosen.len()) as u128);
        if (u128::from(z) * left) >> 64 < wanted {
            chosen.push(row);
        }
    }
    chosen
}

/// Takes finished parts, in order, on a thread of its own, so that rows are computed while a part is written.
///
/// What is done with rows is the sink's own business; none need be kept:
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
    /// When it cannot be kept; the computation then ends, and no further part comes.
    fn take(&mut self, part: Part) -> Result<(), crate::store::Error>;
}

impl PartSink for StoreWriter {
    fn take(&mut self, part: Part) -> Result<(), crate::store::Error> {
        self.write_part(&part)
    }
}

/// Keeps the parts in memory: for small scenes, and for embedders.
impl PartSink for Vec<Part> {
    fn take(&mut self, part: Part) -> Result<(), crate::store::Error> {
        self.push(part);
        Ok(())
    }
}

/// Progress of a computation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Rows finished.
    pub rows: u64,
    /// Rows in all.
    pub row_count: u64,
    /// Entries of the finished rows.
    pub entries: u64,
}

/// How a computation is run. Nothing here changes a bit of the result.
#[derive(Clone, Copy, Debug, Default)]
pub struct Execution<'a> {
    /// Worker threads; 0: one a core.
    pub threads: usize,
    /// Hemicubes a call of the backend; 0: what the backend prefers.
    pub batch: usize,
    /// When this becomes true, the run ends, and the summary says so. The part being computed is finished and kept if
    /// that takes no longer than two seconds; if it does, its rows are computed again when the run goes on.
    pub cancel: Option<&'a AtomicBool>,
}

impl Execution<'_> {
    /// Returns whether it was told to end.
    pub(crate) fn is_cancelled(&self) -> bool {
        self.cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed))
    }
}

/// What a computation did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Rows computed.
    pub rows: u64,
    /// Entries in them.
    pub entries: u64,
    /// Parts handed to the sink.
    pub parts: u64,
    /// Weights of all rows together.
    pub sums: RowSums,
    /// Hemicubes rendered, the unit of `sums`.
    pub hemicubes: u64,
    /// Rays and points that visible fractions were measured with.
    pub rays: u64,
    /// Expected Σ (F − true F)² of all rows; 0 on rungs that do not estimate it.
    pub squared_error: f64,
    /// Σ F² of all rows.
    pub squared_norm: f64,
    /// What leaving out small form factors did, where that was asked for.
    pub thinning: Option<Thinning>,
    /// Entries that are a visible fraction of a closed form, not a sum of pixels.
    pub corrected: u64,
    /// Pairs of which a part only is visible, on rungs that know.
    pub partial: u64,
    /// Rows that their budget of work ended before all pairs were measured that were worth it. Their expected error, on
    /// rungs that estimate it, says so.
    pub cut_short: u64,
    /// What the backend counted.
    pub counters: Counters,
    /// True if it was cancelled before the last row.
    pub cancelled: bool,
    /// Worker threads used.
    pub threads: usize,
    /// Time from the first row asked for to the last part kept.
    pub elapsed: Duration,
    /// The row that took longest, and its time; `None` where there is no row.
    pub slowest: Option<(InputPatch, Duration)>,
    /// Time of all rows, one after the other.
    pub row_time: Duration,
    /// Time in the sink; rows were computed meanwhile.
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
        /// What it said.
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
    /// It was told to end before there was a row.
    #[error("the computation was cancelled before its first row")]
    Cancelled,
    /// The sink could not keep a part.
    #[error(transparent)]
    Store(#[from] crate::store::Error),
}

/// Rows of one batch, ready to be appended to a part.
#[derive(Debug, Default)]
struct Batch {
    part: Part,
    /// What became of each row, where entries were left out.
    changes: Vec<small_entries::RowChange>,
    partial: u64,
    cut_short: u64,
    counters: Counters,
    slowest: Option<(InputPatch, Duration)>,
    row_time: Duration,
}

/// What workers share: who computes what, and how far the collector is.
#[derive(Debug)]
struct Queue {
    state: Mutex<QueueState>,
    changed: Condvar,
}

#[derive(Debug)]
struct QueueState {
    next: usize,
    end: usize,
    collected: usize,
}

impl Queue {
    fn lock(&self) -> MutexGuard<'_, QueueState> {
        // The state is three numbers that are always consistent, so a panic elsewhere does not spoil it.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The next batch to compute, or `None` when there is none left. Waits while the collector is `window` batches
    /// behind, which bounds memory.
    fn take(&self, window: usize) -> Option<usize> {
        let mut state = self.lock();
        while state.next < state.end && state.next >= state.collected + window {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        (state.next < state.end).then(|| {
            state.next += 1;
            state.next - 1
        })
    }

    fn collected(&self, count: usize) {
        self.lock().collected = count;
        self.changed.notify_all();
    }

    /// Hands out no batch from `end` on.
    fn stop_at(&self, end: usize) {
        let mut state = self.lock();
        state.end = state.end.min(end);
        drop(state);
        self.changed.notify_all();
    }
}

/// Stops the queue when its thread panics: nobody would compute the batch, or take the part, that the others wait for.
struct StopOnPanic<'a>(&'a Queue);

impl Drop for StopOnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.stop_at(0);
        }
    }
}

/// Loads a model into a backend as [`compute`] does, with what `correction` asks of rows: what the backend then says of
/// itself ([`HemicubeBackend::info`], [`HemicubeBackend::choices`]) is what it will be for the run. Returns the
/// settings that it was loaded with.
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
    // Corrections make fractions of the weights, and nothing else.
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
/// `settings` are loaded into the backend here, with covered weights whenever the plan's correction needs them.
/// `progress` is called on this thread now and then.
///
/// # Errors
/// When the backend fails or breaks the contract, or the sink cannot keep a part. Parts already kept stay.
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
/// // No light is lost or invented, to the last of 2³¹ parts of each hemicube.
/// assert_eq!(summary.sums.total(), Some(summary.hemicubes * HEMICUBE_WEIGHT));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn compute(
    model: &Model,
    plan: &Plan,
    settings: RenderSettings,
    mut backend: Box<dyn HemicubeBackend>,
    execution: Execution<'_>,
    sink: &mut dyn PartSink,
    progress: &mut dyn FnMut(Progress),
) -> Result<Summary, ComputeError> {
    let name = backend.info().name.clone();
    let backend_error = |source| ComputeError::Backend {
        backend: name.clone(),
        source,
    };
    let settings = load(model, &plan.correction, settings, backend.as_mut())?;

    let samples = plan.hemicubes_per_row();
    let hemicubes_per_call = if execution.batch == 0 {
        backend.info().preferred_rows
    } else {
        execution.batch
    };
    let rows_per_batch = (hemicubes_per_call / samples.max(1)).clamp(1, plan.rows_per_part as usize);
    let batches_per_part = (plan.rows_per_part as usize).div_ceil(rows_per_batch);
    let wanted = plan.wanted();
    // Only the last part of a plan is shorter than the others, and it is the last that is wanted, too.
    let rows_of_last = wanted.last().map_or(0, |&part| plan.rows_of_part(part).len());
    let batch_count = wanted.len().saturating_sub(1) * batches_per_part + rows_of_last.div_ceil(rows_per_batch);
    let rows_of_batch = |batch: usize| {
        let rows = plan.rows_of_part(wanted[batch / batches_per_part]);
        let start = rows.start + batch % batches_per_part * rows_per_batch;
        &plan.rows[start..(start + rows_per_batch).min(rows.end)]
    };

    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = if execution.threads == 0 {
        cores
    } else {
        execution.threads
    }
    .clamp(1, batch_count.max(1));
    let mut sessions = Vec::with_capacity(threads);
    for _ in 1..threads {
        sessions.push(backend.fork().map_err(backend_error)?);
    }
    sessions.push(backend);

    let queue = Queue {
        state: Mutex::new(QueueState {
            next: 0,
            end: batch_count,
            collected: 0,
        }),
        changed: Condvar::new(),
    };
    let abandon = AtomicBool::new(false);
    let window = 8 * threads;
    let started = Instant::now();
    let mut summary = Summary {
        threads,
        ..Summary::default()
    };
    std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::channel();
        let (parts, finished) = mpsc::sync_channel(PARTS_WAITING);
        let writer = {
            let queue = &queue;
            scope.spawn(move || {
                let _stop = StopOnPanic(queue);
                keep_parts(&finished, queue, sink)
            })
        };
        let workers: Vec<_> = sessions
            .into_iter()
            .map(|mut session| {
                let (sender, queue, rows_of_batch, abandon) = (sender.clone(), &queue, &rows_of_batch, &abandon);
                scope.spawn(move || {
                    let _stop = StopOnPanic(queue);
                    let mut rows = RowBlock::default();
                    let mut converter = Converter::new(plan.correction, Some(abandon));
                    while let Some(batch) = queue.take(window) {
                        let result = compute_batch(
                            model,
                            plan,
                            settings,
                            session.as_mut(),
                            rows_of_batch(batch),
                            &mut rows,
                            &mut converter,
                        );
                        if abandon.load(Ordering::Relaxed) {
                            break;
                        }
                        let failed = result.is_err();
                        if sender.send((batch, result)).is_err() || failed {
                            queue.stop_at(0);
                            break;
                        }
                    }
                })
            })
            .collect();
        drop(sender);

        let result = collect(
            model,
            plan,
            &wanted,
            batches_per_part,
            &queue,
            &receiver,
            parts,
            progress,
            (execution.cancel, &abandon),
            &mut summary,
        );
        // Whatever ended the collection, nobody may wait for it any more, and nobody wants further rows.
        queue.stop_at(0);
        abandon.store(true, Ordering::Relaxed);
        drop(receiver);
        let mut panic = None;
        for worker in workers {
            if let Err(payload) = worker.join() {
                panic.get_or_insert(panicked(payload.as_ref()));
            }
        }
        // Parts that are waiting are whole, and are kept whatever ended the run.
        let kept = match writer.join() {
            Ok(kept) => kept.map_err(ComputeError::from),
            Err(payload) => Err(panic.take().unwrap_or_else(|| panicked(payload.as_ref()))),
        };
        summary.sink = panic.map_or(result, Err).and(kept)?;
        Ok::<(), ComputeError>(())
    })?;
    summary.elapsed = started.elapsed();
    Ok(summary)
}

fn panicked(payload: &(dyn std::any::Any + Send)) -> ComputeError {
    let message = payload
        .downcast_ref::<&str>()
        .map(|s| (*s).to_owned())
        .or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".to_owned());
    ComputeError::Panic { message }
}

/// Parts that wait for the sink while it is at one: two, so that a slow disk is always busy. What is beyond them stops
/// the workers, which bounds memory.
const PARTS_WAITING: usize = 2;

/// Hands parts to the sink as they come; the time it took. Its error ends the run: the workers get no further batch.
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

/// Renders, checks and converts the rows of one batch.
fn compute_batch(
    model: &Model,
    plan: &Plan,
    settings: RenderSettings,
    backend: &mut dyn HemicubeBackend,
    emitters: &[InputPatch],
    rows: &mut RowBlock,
    converter: &mut Converter<'_>,
) -> Result<Batch, ComputeError> {
    let mut hemicubes = Vec::with_capacity(emitters.len());
    let mut of_rows = Vec::with_capacity(emitters.len());
    for &emitter in emitters {
        let before = hemicubes.len();
        let per_edge = plan.per_edge(model, emitter);
        hemicubes.extend(model.hemicubes(emitter, per_edge, plan.rotate));
        of_rows.push((hemicubes.len() - before, per_edge));
    }
    rows.clear();
    let first = emitters.first().copied().unwrap_or(InputPatch(0));
    let began = Instant::now();
    let counters = render(model, settings, backend, first, &hemicubes, rows)?;
    let rendering = began.elapsed();

    let mut batch = Batch {
        counters,
        ..Batch::default()
    };
    let part = &mut batch.part;
    let mut first = 0;
    let receives = |patch| plan.selection.receives(patch);
    for (&emitter, &(count, per_edge)) in emitters.iter().zip(&of_rows) {
        if converter.is_cancelled() {
            break;
        }
        let began = Instant::now();
        let samples = first..first + count;
        first += count;
        let start = part.data.len();
        let of_row = samples.clone().map(|row| rows.row(row));
        let mut hemicubes_of_row = count;
        // A large patch has the hemicubes that it asks for.
        let most = MOST_PER_EDGE.max(plan.samples_per_edge * 4);
        let attempts: Vec<u32> = more_samples(&plan.correction)
            .iter()
            .map(|more| more * per_edge)
            .collect();
        let attempts = &attempts[..attempts.partition_point(|&more| more <= most)];
        let rendered = Rendered {
            model,
            emitter,
            hemicubes: &hemicubes[samples],
            rows: of_row,
            attempt: Attempt {
                is_first: true,
                is_large: per_edge > plan.samples_per_edge,
                is_last: attempts.is_empty(),
            },
        };
        let mut converted = converter.convert(rendered, receives, part);
        for (place, &more) in attempts.iter().enumerate() {
            if !converted.is_odd {
                break;
            }
            // The points do not stand for the emitter: a centroid inside a solid, say, of a patch that reaches out of
            // it.
            let more = model.hemicubes(emitter, more, plan.rotate);
            let mut odd = RowBlock::default();
            batch.counters += render(model, settings, backend, emitter, &more, &mut odd)?;
            let of_row = (0..more.len()).map(|row| odd.row(row));
            part.indices.truncate(start);
            part.data.truncate(start);
            let rendered = Rendered {
                model,
                emitter,
                hemicubes: &more,
                rows: of_row,
                attempt: Attempt {
                    is_first: false,
                    is_large: per_edge > plan.samples_per_edge,
                    is_last: place + 1 == attempts.len(),
                },
            };
            let lost = converted.lost;
            converted = converter.convert(rendered, receives, part);
            hemicubes_of_row = more.len();
            if matches!(plan.correction, Correction::Tolerance(_)) && (converted.lost - lost).abs() > LOST {
                break;
            }
        }
        if plan.min_factor > 0.0 || plan.form != Form::Plain {
            let change = small_entries::keep(part, start, plan.min_factor, plan.form, &mut converted.error);
            if plan.min_factor > 0.0 {
                batch.changes.push(change);
            }
        }
        batch.partial += converted.partial;
        batch.cut_short += u64::from(converted.cut_short);
        part.rows.push(emitter.0);
        part.indptr.push(i64::try_from(part.indices.len()).unwrap_or(i64::MAX));
        part.sums.push(converted.sums);
        part.shares.push(converted.shares);
        part.hemicubes.push(u32::try_from(hemicubes_of_row).unwrap_or(u32::MAX));
        part.errors.push(converted.error);
        part.rays.push(u32::try_from(converted.rays).unwrap_or(u32::MAX));
        // Hemicubes are rendered together: each has its share of that time.
        let took = began.elapsed() + rendering.mul_f64(count as f64 / hemicubes.len().max(1) as f64);
        batch.row_time += took;
        if batch.slowest.is_none_or(|(_, longest)| took > longest) {
            batch.slowest = Some((emitter, took));
        }
    }
    Ok(batch)
}

/// What hemicubes lose of one row may differ by so much. Where it does by more, rays know the form factors better than
/// hemicubes know what is lost, and the sum of both tells nothing.
const LOST: f64 = 0.01;

/// How many times as many hemicubes along an edge a row gets whose hemicubes do not stand for its emitter; and if those
/// do not, how many then.
fn more_samples(correction: &Correction) -> &'static [u32] {
    match correction {
        // What matters of such a row is looked at by rays, and more than four hemicubes make little of the rest better,
        // but where rays say that they still see what the patch does not.
        Correction::Area(_) => &[2, 4],
        // In the open, a row that sums oddly has a centroid that is a bad place to see the sky from; in the closed, the
        // sum is part of the promise.
        Correction::Tolerance(_) if correction.is_in_the_open() => &[2],
        Correction::Tolerance(_) => &[2, 4],
        Correction::Pixel | Correction::Point => &[2, 4],
    }
}

/// Renders and checks rows; `first` is the emitter to name where something is wrong.
pub(crate) fn render(
    model: &Model,
    settings: RenderSettings,
    backend: &mut dyn HemicubeBackend,
    first: InputPatch,
    hemicubes: &[Hemicube],
    rows: &mut RowBlock,
) -> Result<Counters, ComputeError> {
    let counters = backend.rows(hemicubes, rows).map_err(|source| ComputeError::Backend {
        backend: backend_name(backend),
        source,
    })?;
    rows.check(hemicubes.len(), model.geometry().patch_count, settings.covered)
        .map_err(|source| ComputeError::Row {
            backend: backend_name(backend),
            patch: first.0,
            source,
        })?;
    Ok(counters)
}

fn backend_name(backend: &dyn HemicubeBackend) -> String {
    backend.info().name.clone()
}

/// Puts batches back in order, appends them to parts, and hands full parts on. Ends early, and without an error of its
/// own, when nobody takes parts any more.
#[allow(clippy::too_many_arguments, reason = "private, called once: the pieces of one loop")]
fn collect(
    model: &Model,
    plan: &Plan,
    wanted: &[u32],
    batches_per_part: usize,
    queue: &Queue,
    receiver: &mpsc::Receiver<(usize, Result<Batch, ComputeError>)>,
    parts: mpsc::SyncSender<Part>,
    progress: &mut dyn FnMut(Progress),
    (cancel, abandon): (Option<&AtomicBool>, &AtomicBool),
    summary: &mut Summary,
) -> Result<(), ComputeError> {
    let row_count = wanted
        .iter()
        .map(|&part| plan.rows_of_part(part).len() as u64)
        .sum::<u64>();
    let mut wanted = wanted.iter().copied();
    let is_thinned = plan.min_factor > 0.0;
    // Past the last part nothing comes.
    let mut next_part = || {
        let mut part = empty_part(wanted.next().unwrap_or(u32::MAX));
        part.thinning = is_thinned.then(PartThinning::default);
        part
    };
    let mut early: BTreeMap<usize, Batch> = BTreeMap::new();
    let mut next = 0;
    let mut part = next_part();
    let mut cancelling: Option<Instant> = None;
    let mut thinned = PartThinning::default();
    let so_far = |summary: &Summary, part: &Part| Progress {
        rows: summary.rows + part.rows.len() as u64,
        row_count,
        entries: summary.entries + part.indices.len() as u64,
    };
    progress(so_far(summary, &part));
    loop {
        if cancelling.is_some_and(|since| since.elapsed() > PATIENCE) {
            abandon.store(true, Ordering::Relaxed);
        }
        if cancelling.is_none() && cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
            cancelling = Some(Instant::now());
            // Whole parts only: the one in which the first batch not yet handed out lies is still computed.
            let handed_out = queue.lock().next;
            queue.stop_at(handed_out.div_ceil(batches_per_part) * batches_per_part);
        }
        // A time-out, so that a cancellation is noticed while one slow batch is under way.
        let (index, batch) = match receiver.recv_timeout(Duration::from_millis(100)) {
            Ok(received) => received,
            Err(mpsc::RecvTimeoutError::Timeout) => {
                // So that what shows the progress can show that time goes by.
                progress(so_far(summary, &part));
                continue;
            }
            Err(mpsc::RecvTimeoutError::Disconnected) => break,
        };
        let batch = batch?;
        summary.row_time += batch.row_time;
        summary.cut_short += batch.cut_short;
        if let Some((patch, took)) = batch.slowest
            && summary.slowest.is_none_or(|(_, longest)| took > longest)
        {
            summary.slowest = Some((patch, took));
        }
        early.insert(index, batch);
        while let Some(batch) = early.remove(&next) {
            next += 1;
            summary.counters += batch.counters;
            summary.partial += batch.partial;
            let before = part.rows.len();
            append(&mut part, batch.part);
            if let Some(mut changed) = part.thinning {
                for (row, change) in (before..).zip(&batch.changes) {
                    let area = model.patches().area(InputPatch(part.rows[row]));
                    changed.add(&part, row, area, change);
                }
                part.thinning = Some(changed);
            }
            let full = next % batches_per_part == 0 || part.rows.len() as u64 + summary.rows == row_count;
            if full {
                summary.rows += part.rows.len() as u64;
                summary.entries += part.indices.len() as u64;
                if plan.correction != Correction::Pixel {
                    summary.corrected += part.indices.len() as u64;
                }
                summary.parts += 1;
                summary.rays += part.rays.iter().map(|&r| u64::from(r)).sum::<u64>();
                summary.squared_error += part
                    .errors
                    .iter()
                    .filter(|e| !e.is_nan())
                    .map(|&e| f64::from(e).powi(2))
                    .sum::<f64>();
                summary.squared_norm += part.data.iter().map(|&f| f64::from(f).powi(2)).sum::<f64>();
                summary.hemicubes += part.hemicubes.iter().map(|&h| u64::from(h)).sum::<u64>();
                for sums in &part.sums {
                    summary.sums.visible += sums.visible;
                    summary.sums.escaped += sums.escaped;
                    summary.sums.blocked += sums.blocked;
                    summary.sums.unselected += sums.unselected;
                }
                if let Some(of_part) = &part.thinning {
                    thinned.merge(of_part);
                }
                if parts.send(std::mem::replace(&mut part, next_part())).is_err() {
                    return Ok(());
                }
            }
        }
        queue.collected(next);
        progress(so_far(summary, &part));
    }
    summary.cancelled = summary.rows < row_count;
    summary.thinning = is_thinned.then(|| thinned.finish(plan.min_factor));
    Ok(())
}

/// How long a run that was told to end may go on with the part that it is at.
const PATIENCE: Duration = Duration::from_secs(2);

fn empty_part(index: u32) -> Part {
    Part {
        index,
        indptr: vec![0],
        ..Part::default()
    }
}

fn append(part: &mut Part, batch: Part) {
    let base = part.indptr.last().copied().unwrap_or(0);
    part.rows.extend(batch.rows);
    part.indptr.extend(batch.indptr.iter().map(|end| base + end));
    part.indices.extend(batch.indices);
    part.data.extend(batch.data);
    part.sums.extend(batch.sums);
    part.shares.extend(batch.shares);
    part.hemicubes.extend(batch.hemicubes);
    part.errors.extend(batch.errors);
    part.rays.extend(batch.rays);
}
