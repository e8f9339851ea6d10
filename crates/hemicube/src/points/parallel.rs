//! Work on several threads, in order.

use crate::driver::compute::ComputeError;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::Duration;

/// A number of threads; 0 is one a core.
pub(crate) fn threads_of(threads: usize) -> usize {
    match threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads,
    }
}

/// Longest time between two calls of a progress.
const PATIENCE: Duration = Duration::from_millis(50);

/// Does something for each of `count` rows by several threads, each with a state of its own, and keeps the order.
/// `progress` is told how many are done, after each and while none is, and says whether to go on; rows under way are
/// waited for.
pub(crate) fn in_parallel<S: Send, R: Send>(
    count: usize,
    states: Vec<S>,
    work: impl Fn(&mut S, usize) -> Result<R, ComputeError> + Sync,
    progress: &mut dyn FnMut(usize) -> bool,
) -> Result<Option<Vec<R>>, ComputeError> {
    let next = AtomicUsize::new(0);
    let mut rows: Vec<Option<R>> = (0..count).map(|_| None).collect();
    let finished = std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::sync_channel(64);
        for mut state in states {
            let (sender, next, work) = (sender.clone(), &next, &work);
            scope.spawn(move || {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count {
                        break;
                    }
                    let result = work(&mut state, index);
                    let failed = result.is_err();
                    if sender.send((index, result)).is_err() || failed {
                        break;
                    }
                }
            });
        }
        drop(sender);
        let mut done = 0;
        loop {
            match receiver.recv_timeout(PATIENCE) {
                Ok((index, result)) => {
                    rows[index] = Some(result?);
                    done += 1;
                }
                Err(mpsc::RecvTimeoutError::Timeout) => {}
                Err(mpsc::RecvTimeoutError::Disconnected) => return Ok::<bool, ComputeError>(true),
            }
            if !progress(done) {
                return Ok(false);
            }
        }
    })?;
    // Every row is there unless a thread ended early, and then there was an error.
    Ok(finished.then(|| rows.into_iter().flatten().collect()))
}
