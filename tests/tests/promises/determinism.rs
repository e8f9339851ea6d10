//! The result depends on the scene and the settings alone: not on threads, batches, selections of columns or a
//! cancellation; and a backend that fails or lies ends the computation with the right error, in bounded time.

use hemicube::backend::{
    BackendError, BackendInfo, Counters, Geometry, Hemicube, HemicubeBackend, RenderSettings, WHOLE,
};
use hemicube::driver::compute::{
    ComputeError, Execution, PartSink, Plan, Progress, RowChoice, Selection, Summary, compute,
};
use hemicube::row::{RowBlock, RowError};
use hemicube::store::Part;
use hemicube::{InputPatch, Model};
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::Subdivision;
use hemicube_scene::generate::{self, Kind};
use hemicube_tests::rows::{parts, plan, settings};
use hemicube_tests::scenes::{generated, model};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};

fn cornell() -> Model {
    model(generate::cornell_box_open(), Subdivision::Levels(3))
}

fn run(model: &Model, plan: &Plan, threads: usize, batch: usize) -> (Vec<Part>, Summary) {
    parts(
        model,
        plan,
        settings(64),
        Box::new(CpuBackend::new()),
        Execution {
            threads,
            batch,
            cancel: None,
        },
    )
    .expect("a sound run")
}

fn same(model: &Model, plan: &Plan) -> (Vec<Part>, Summary) {
    let (first, summary) = run(model, plan, 1, 1);
    assert_eq!(first.iter().map(|p| p.rows.len()).sum::<usize>(), plan.rows.len());
    for (threads, batch) in [(1, 0), (1, 64), (2, 1), (2, 5), (7, 0), (7, 64)] {
        let (parts, other) = run(model, plan, threads, batch);
        assert!(parts == first, "{threads} threads, batches of {batch}");
        assert_eq!(
            other.counters, summary.counters,
            "{threads} threads, batches of {batch}"
        );
        assert_eq!((other.sums, other.entries), (summary.sums, summary.entries));
    }
    (first, summary)
}

#[test]
fn threads_and_batches_change_nothing() {
    for model in [cornell(), generated(Kind::City, 1_500)] {
        for samples_per_edge in [1, 2] {
            let plan = Plan::new(&model, RowChoice::All, Selection::default(), samples_per_edge, true);
            let (parts, summary) = same(&model, &plan);
            assert_eq!(
                summary.hemicubes,
                plan.rows.len() as u64 * u64::from(samples_per_edge).pow(2)
            );
            assert!(parts.len() > 10);
            for part in &parts {
                for (sums, &count) in part.sums.iter().zip(&part.hemicubes) {
                    assert_eq!(sums.total(), Some(u64::from(count) * u64::from(WHOLE)));
                }
            }
        }
    }
}

#[test]
fn a_sample_of_rows_is_the_same_rows() {
    let model = generated(Kind::City, 1_500);
    let (all, _) = run(&model, &plan(&model), 2, 0);
    let choice = RowChoice::Sample { count: 100, seed: 7 };
    let sampled = Plan::new(&model, choice, Selection::default(), 1, true);
    assert_eq!(sampled.rows.len(), 100);
    assert_eq!(sampled, Plan::new(&model, choice, Selection::default(), 1, true));
    let (some, _) = same(&model, &sampled);
    let find = |patch: u32| {
        all.iter().find_map(|part| {
            part.rows
                .iter()
                .position(|&p| p == patch)
                .map(|k| (part.row(k), part.sums[k]))
        })
    };
    for part in &some {
        for (k, &patch) in part.rows.iter().enumerate() {
            assert_eq!(find(patch), Some((part.row(k), part.sums[k])), "patch {patch}");
        }
    }
}

#[test]
fn what_is_not_selected_is_accounted_for() {
    let model = generated(Kind::City, 1_500);
    let count = model.patches().len();
    let emitters: Vec<bool> = (0..count).map(|p| p % 3 != 0).collect();
    let receivers: Vec<bool> = (0..count).map(|p| p % 4 != 1).collect();
    let selection = Selection {
        emitters: Some(emitters.clone()),
        receivers: Some(receivers.clone()),
    };
    let chosen = Plan::new(&model, RowChoice::All, selection, 2, true);
    assert_eq!(chosen.rows.len(), emitters.iter().filter(|&&e| e).count());
    let (some, summary) = same(&model, &chosen);
    let everything = Plan::new(&model, RowChoice::All, Selection::default(), 2, true);
    let (all, _) = run(&model, &everything, 2, 0);
    assert!(summary.sums.unselected > 0);
    for part in &some {
        for (k, &patch) in part.rows.iter().enumerate() {
            assert!(emitters[patch as usize]);
            let (full, place) = all
                .iter()
                .find_map(|p| p.rows.iter().position(|&q| q == patch).map(|place| (p, place)))
                .expect("every patch has a row");
            let (columns, values) = full.row(place);
            let expected: (Vec<i32>, Vec<f64>) = columns
                .iter()
                .zip(values)
                .filter(|&(&column, _)| receivers[usize::try_from(column).expect("a column")])
                .unzip();
            let (columns, values) = part.row(k);
            let values: Vec<f64> = values.iter().collect();
            assert_eq!((columns, values), (&expected.0[..], expected.1), "patch {patch}");
            let (sums, whole) = (part.sums[k], full.sums[place]);
            assert_eq!(sums.visible + sums.unselected, whole.visible, "patch {patch}");
            assert_eq!(
                (sums.escaped, sums.blocked),
                (whole.escaped, whole.blocked),
                "patch {patch}"
            );
            assert_eq!(sums.total(), Some(4 * u64::from(WHOLE)));
        }
    }
}

#[test]
fn no_row_at_all() {
    let model = cornell();
    let nobody = Selection {
        emitters: Some(vec![false; model.patches().len()]),
        receivers: None,
    };
    let (parts, summary) = run(&model, &Plan::new(&model, RowChoice::All, nobody, 1, true), 2, 0);
    assert!(parts.is_empty());
    assert_eq!((summary.rows, summary.cancelled), (0, false));
}

/// Runs in a thread of its own, so that a computation that never ends fails the test.
fn in_time<T: Send + 'static>(name: &str, run: impl FnOnce() -> T + Send + 'static) -> T {
    let (sender, receiver) = mpsc::channel();
    let thread = std::thread::spawn(move || sender.send(run()));
    match receiver.recv_timeout(Duration::from_secs(30)) {
        Ok(value) => value,
        Err(mpsc::RecvTimeoutError::Timeout) => panic!("{name}: still running after half a minute"),
        Err(mpsc::RecvTimeoutError::Disconnected) => panic!("{name}: panicked: {:?}", thread.join().err().map(|_| ())),
    }
}

#[test]
fn a_cancelled_run_keeps_whole_parts() {
    let model = cornell();
    let plan = plan(&model);
    let (all, _) = run(&model, &plan, 1, 0);
    for threads in [1, 2, 7] {
        let (model, plan) = (model.clone(), plan.clone());
        let (kept, summary) = in_time("a cancelled run", move || {
            let mut kept: Vec<Part> = Vec::new();
            let cancel = AtomicBool::new(false);
            let summary = compute(
                &model,
                &plan,
                settings(64),
                Box::new(CpuBackend::new()),
                Execution {
                    threads,
                    batch: 8,
                    cancel: Some(&cancel),
                },
                &mut kept,
                &mut |progress| {
                    if progress.rows >= 300 {
                        cancel.store(true, Ordering::Relaxed);
                    }
                },
            );
            (kept, summary.expect("a cancellation is no error"))
        });
        assert!(summary.cancelled, "{threads} threads");
        assert!(
            !kept.is_empty() && kept.len() < all.len(),
            "{threads} threads: {} of {}",
            kept.len(),
            all.len()
        );
        assert_eq!(kept[..], all[..kept.len()], "{threads} threads");
        assert_eq!(summary.rows, kept.iter().map(|p| p.rows.len() as u64).sum::<u64>());
    }
}

/// The fault of a [`Faulty`] backend, at the hemicube of one patch.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    LosesLight,
    InventsLight,
    Unsorted,
    OutOfRange,
    TooFewRows,
    TooManyRows,
    CoversLessThanItShows,
    Fails,
    Panics,
}

/// The built-in backend with a fault.
struct Faulty {
    inner: Box<dyn HemicubeBackend>,
    fault: Fault,
    at: InputPatch,
}

impl HemicubeBackend for Faulty {
    fn info(&self) -> &BackendInfo {
        self.inner.info()
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.inner.load(geometry, settings)
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        Ok(Box::new(Self {
            inner: self.inner.fork()?,
            fault: self.fault,
            at: self.at,
        }))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let counters = self.inner.rows(hemicubes, out)?;
        let Some(row) = hemicubes.iter().position(|h| h.emitter == Some(self.at)) else {
            return Ok(counters);
        };
        let first = if row == 0 { 0 } else { out.row_end[row - 1] };
        match self.fault {
            Fault::LosesLight => out.visible[first] -= 1,
            Fault::InventsLight => out.blocked[row] += 1,
            Fault::Unsorted => out.patches.swap(first, first + 1),
            Fault::OutOfRange => out.patches[out.row_end[row] - 1] = u32::MAX - 1,
            Fault::TooFewRows => {
                out.row_end.pop();
            }
            Fault::TooManyRows => out.end_row(WHOLE, 0),
            Fault::CoversLessThanItShows => out.covered[first] = 0,
            Fault::Fails => return Err(BackendError::DeviceLost("it fell off the bus".to_owned())),
            Fault::Panics => panic!("a defect of the faulty backend"),
        }
        Ok(counters)
    }
}

/// The error that a fault ends with, and how many parts were kept before.
fn fails(fault: Fault, threads: usize, batch: usize) -> (ComputeError, usize) {
    in_time(
        &format!("{fault:?}, {threads} threads, batches of {batch}"),
        move || {
            let model = cornell();
            let plan = plan(&model);
            // Early in the order, so that there is much left for the other threads to wait with.
            let backend = Faulty {
                inner: Box::new(CpuBackend::new()),
                fault,
                at: plan.rows[150],
            };
            let settings = RenderSettings {
                covered: fault == Fault::CoversLessThanItShows,
                ..settings(64)
            };
            let mut kept: Vec<Part> = Vec::new();
            let error = compute(
                &model,
                &plan,
                settings,
                Box::new(backend),
                Execution {
                    threads,
                    batch,
                    cancel: None,
                },
                &mut kept,
                &mut |_: Progress| {},
            )
            .expect_err("a faulty backend passed");
            (error, kept.len())
        },
    )
}

#[test]
fn faults_end_in_the_right_error() {
    for threads in [1, 2, 7] {
        for batch in [1, 5] {
            let row = |fault| match fails(fault, threads, batch) {
                (ComputeError::Row { backend, source, .. }, kept) => {
                    assert_eq!(backend, "cpu");
                    assert!(kept <= 2, "{fault:?}: the part with the fault was kept");
                    source
                }
                (other, _) => panic!("{fault:?}: {other}"),
            };
            assert!(matches!(row(Fault::LosesLight), RowError::Sum { found, .. } if found == u64::from(WHOLE) - 1));
            assert!(matches!(row(Fault::InventsLight), RowError::Sum { found, .. } if found == u64::from(WHOLE) + 1));
            assert!(matches!(row(Fault::Unsorted), RowError::NotAscending { .. }));
            assert!(matches!(row(Fault::OutOfRange), RowError::OutOfRange { patch, .. } if patch == u32::MAX - 1));
            assert!(matches!(row(Fault::TooFewRows), RowError::Shape { .. }));
            assert!(matches!(row(Fault::TooManyRows), RowError::Shape { .. }));
            assert!(matches!(
                row(Fault::CoversLessThanItShows),
                RowError::CoveredBelowVisible { .. }
            ));
            let (error, _) = fails(Fault::Fails, threads, batch);
            assert!(
                matches!(
                    &error,
                    ComputeError::Backend {
                        source: BackendError::DeviceLost(_),
                        ..
                    }
                ),
                "{threads} threads: {error}"
            );
            assert!(error.to_string().contains("it fell off the bus"));
        }
    }
}

#[test]
fn a_panic_ends_in_an_error_and_not_in_waiting() {
    for threads in [1, 2, 7] {
        for batch in [1, 5] {
            let (error, _) = fails(Fault::Panics, threads, batch);
            assert!(
                matches!(&error, ComputeError::Panic { message } if message.contains("a defect of the faulty backend")),
                "{threads} threads: {error}"
            );
        }
    }
}

#[test]
fn a_backend_that_refuses_the_settings() {
    let model = cornell();
    let refused = settings(60);
    let result = parts(
        &model,
        &plan(&model),
        refused,
        Box::new(CpuBackend::new()),
        Execution::default(),
    );
    assert!(matches!(
        result,
        Err(ComputeError::Backend {
            source: BackendError::InvalidArgument(_),
            ..
        })
    ));
}

/// A sink that has room for a few parts.
struct Full {
    room: usize,
}

impl PartSink for Full {
    fn take(&mut self, _: Part) -> Result<(), hemicube::store::Error> {
        if self.room == 0 {
            let error = std::io::Error::from(std::io::ErrorKind::StorageFull);
            return Err(hemicube::store::Error::Io {
                path: "full".into(),
                action: "written",
                source: error,
            });
        }
        self.room -= 1;
        Ok(())
    }
}

#[test]
fn a_sink_that_is_full_ends_the_run() {
    for threads in [1, 2, 7] {
        let error = in_time("a full sink", move || {
            let model = cornell();
            let plan = plan(&model);
            compute(
                &model,
                &plan,
                settings(64),
                Box::new(CpuBackend::new()),
                Execution {
                    threads,
                    batch: 3,
                    cancel: None,
                },
                &mut Full { room: 2 },
                &mut |_| {},
            )
            .expect_err("a full sink passed")
        });
        assert!(matches!(error, ComputeError::Store(_)), "{error}");
    }
}

/// A sink that panics.
struct Panics;

impl PartSink for Panics {
    fn take(&mut self, _: Part) -> Result<(), hemicube::store::Error> {
        panic!("the sink is broken");
    }
}

/// A sink that keeps its first part waiting until more rows are computed than it has been given.
struct Slow {
    /// Rows that are computed and collected.
    rows: Arc<AtomicU64>,
    rows_per_part: u64,
    waited: bool,
}

impl PartSink for Slow {
    fn take(&mut self, part: Part) -> Result<(), hemicube::store::Error> {
        let deadline = Instant::now() + Duration::from_secs(20);
        while part.index == 0 && Instant::now() < deadline {
            if self.rows.load(Ordering::SeqCst) >= 2 * self.rows_per_part {
                self.waited = true;
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    }
}

#[test]
fn a_sink_that_panics_ends_the_run() {
    for threads in [1, 3] {
        let error = in_time("a sink that panics", move || {
            let model = cornell();
            let plan = plan(&model);
            let execution = Execution {
                threads,
                ..Execution::default()
            };
            let backend = Box::new(CpuBackend::new());
            compute(
                &model,
                &plan,
                settings(64),
                backend,
                execution,
                &mut Panics,
                &mut |_| {},
            )
            .expect_err("a panic passed")
        });
        assert!(
            matches!(&error, ComputeError::Panic { message } if message.contains("broken")),
            "{error}"
        );
    }
}

#[test]
fn rows_are_computed_while_a_part_is_written() {
    for threads in [1, 2] {
        let sink = in_time("a slow sink", move || {
            let model = cornell();
            let plan = plan(&model);
            let rows = Arc::new(AtomicU64::new(0));
            let mut sink = Slow {
                rows: Arc::clone(&rows),
                rows_per_part: plan.rows_per_part.into(),
                waited: false,
            };
            assert!(plan.part_count() > 3);
            let execution = Execution {
                threads,
                batch: 4,
                cancel: None,
            };
            let backend = Box::new(CpuBackend::new());
            let mut progress = |p: Progress| rows.store(p.rows, Ordering::SeqCst);
            let summary = compute(
                &model,
                &plan,
                settings(64),
                backend,
                execution,
                &mut sink,
                &mut progress,
            )
            .expect("rows");
            assert_eq!(summary.parts, plan.part_count() as u64);
            sink
        });
        assert!(sink.waited, "nothing was computed while the sink was at its first part");
    }
}
