//! Work counted in steps of about a nanosecond of one core of 2024 with AVX-512, never timed: bounds depend on the scene
//! and the settings, and on no clock.
//!
//! What costs most of a row adds its steps to its thread's count: closed forms along edges, shafts, rays and segments.
//! A row is computed by one thread, so its work is what the count has grown by. It counts for what has no bound of its
//! own to keep: forecasts from a sample of rows.

use std::cell::Cell;

thread_local! {
    static TAKEN: Cell<u64> = const { Cell::new(0) };
}

/// Adds to the steps of this thread.
#[inline]
pub(crate) fn add(steps: u64) {
    TAKEN.set(TAKEN.get().wrapping_add(steps));
}

/// Steps of this thread since it began.
pub(crate) fn taken() -> u64 {
    TAKEN.get()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_counts_its_own_steps() {
        let before = taken();
        add(3);
        std::thread::spawn(|| add(100)).join().expect("a thread");
        add(4);
        assert_eq!(taken() - before, 7);
    }
}
