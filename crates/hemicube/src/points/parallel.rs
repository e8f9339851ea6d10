//! Work on several threads, in order.

use crate::driver::compute::ComputeError;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// A number of threads; 0 is one a core.
pub(crate) fn threads_of(threads: usize) -> usize {
    match threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads,
    }
}

/// Does something for each of `count` rows by several threads, each with a state of its own, and keeps the order.
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
        for (done, (index, result)) in receiver.into_iter().enumerate() {
            rows[index] = Some(result?);
            if !progress(done + 1) {
                return Ok::<bool, ComputeError>(false);
            }
        }
        Ok(true)
    })?;
    // Every row is there unless a thread ended early, and then there was an error.
    Ok(finished.then(|| rows.into_iter().flatten().collect()))
}
