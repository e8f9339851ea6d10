//! Long work on a thread of its own, attended by the calling thread: that one releases the interpreter's lock, looks
//! for signals some times a second, and calls back with the progress.

use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::Duration;

/// Longest time that a signal waits.
const PATIENCE: Duration = Duration::from_millis(50);

/// The work's side: cancellation, and reports of its progress.
#[derive(Debug)]
pub(crate) struct Attendant<'a, P> {
    cancel: &'a AtomicBool,
    reports: Sender<P>,
}

impl<P> Attendant<'_, P> {
    /// Becomes true when the work is to end.
    pub(crate) fn cancel(&self) -> &AtomicBool {
        self.cancel
    }

    /// Tells how far it is, and says whether to go on.
    pub(crate) fn tell(&self, progress: P) -> bool {
        // Nobody listens any more only when it is to end.
        self.reports.send(progress).is_ok() && !self.cancel.load(Ordering::Relaxed)
    }
}

/// Waits, and returns the latest report, and whether the work is done.
fn wait<P>(reports: &Receiver<P>) -> (Option<P>, bool) {
    let (mut latest, mut done) = match reports.recv_timeout(PATIENCE) {
        Ok(report) => (Some(report), false),
        Err(RecvTimeoutError::Timeout) => (None, false),
        Err(RecvTimeoutError::Disconnected) => (None, true),
    };
    while !done {
        match reports.try_recv() {
            Ok(report) => latest = Some(report),
            Err(mpsc::TryRecvError::Empty) => break,
            Err(mpsc::TryRecvError::Disconnected) => done = true,
        }
    }
    (latest, done)
}

/// Runs `work`. Calls `callback`, on this thread, with the latest report. After a signal with a handler that raises
/// (Ctrl-C's does), or a callback that raises, the work is cancelled, and the exception is raised once it has ended.
pub(crate) fn attended<P, T>(
    py: Python<'_>,
    callback: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(Attendant<'_, P>) -> T + Send,
) -> PyResult<T>
where
    P: Send + for<'py> IntoPyObject<'py, Target = PyTuple, Output = Bound<'py, PyTuple>, Error = PyErr>,
    T: Send,
{
    let cancel = AtomicBool::new(false);
    let (sender, mut reports) = mpsc::channel();
    std::thread::scope(|scope| {
        let attendant = Attendant {
            cancel: &cancel,
            reports: sender,
        };
        let worker = scope.spawn(move || work(attendant));
        let mut raised = None;
        loop {
            let (received, (latest, done)) = py.detach(move || {
                let found = wait(&reports);
                (reports, found)
            });
            reports = received;
            if raised.is_none() {
                let told = match (latest, callback) {
                    (Some(latest), Some(callback)) => latest
                        .into_pyobject(py)
                        .and_then(|arguments| callback.call1(arguments).map(drop)),
                    _ => Ok(()),
                };
                if let Err(error) = told.and_then(|()| py.check_signals()) {
                    cancel.store(true, Ordering::Relaxed);
                    raised = Some(error);
                }
            }
            if done {
                break;
            }
        }
        let result = py.detach(|| worker.join());
        match (raised, result) {
            // A panic takes precedence over the exception that interrupted it.
            (_, Err(panic)) => std::panic::resume_unwind(panic),
            (Some(error), Ok(_)) => Err(error),
            (None, Ok(result)) => Ok(result),
        }
    })
}
