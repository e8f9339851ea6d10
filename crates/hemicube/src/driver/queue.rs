//! The queue of batches that workers take from and the collector follows.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Numbers of batches, handed out to workers in order.
#[derive(Debug)]
pub(super) struct Queue {
    state: Mutex<QueueState>,
    changed: Condvar,
}

#[derive(Debug)]
struct QueueState {
    /// The next batch to be handed out.
    next: usize,
    /// One past the last batch to be handed out.
    end: usize,
    /// Batches collected, in order.
    collected: usize,
}

impl Queue {
    /// A queue of the batches `0..count`.
    pub(super) fn new(count: usize) -> Self {
        Self {
            state: Mutex::new(QueueState {
                next: 0,
                end: count,
                collected: 0,
            }),
            changed: Condvar::new(),
        }
    }

    /// The next batch to be handed out.
    pub(super) fn next(&self) -> usize {
        self.lock().next
    }

    fn lock(&self) -> MutexGuard<'_, QueueState> {
        // The state is three numbers that are always consistent, so a panic elsewhere does not spoil it.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the next batch; `None` when there is none left. Waits while the collector is `window` batches behind, to
    /// bound memory.
    pub(super) fn take(&self, window: usize) -> Option<usize> {
        let mut state = self.lock();
        while state.next < state.end && state.next >= state.collected + window {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        (state.next < state.end).then(|| {
            state.next += 1;
            state.next - 1
        })
    }

    /// Notes the number of batches collected.
    pub(super) fn collected(&self, count: usize) {
        self.lock().collected = count;
        self.changed.notify_all();
    }

    /// Hands out no batch from `end` on.
    pub(super) fn stop_at(&self, end: usize) {
        let mut state = self.lock();
        state.end = state.end.min(end);
        drop(state);
        self.changed.notify_all();
    }
}

/// Stops the queue when its thread panics: the others would wait for its batch, or for its part to be taken.
pub(super) struct StopOnPanic<'a>(pub(super) &'a Queue);

impl Drop for StopOnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.stop_at(0);
        }
    }
}
