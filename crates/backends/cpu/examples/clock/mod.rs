//! The clock of the examples and benches.

/// Time that this thread was on a processor, so that other programs do not count; the clock on the wall where the
/// system does not tell.
pub(crate) fn thread_seconds() -> f64 {
    std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|s| s.split(' ').next()?.parse::<f64>().ok())
        .map_or_else(
            || std::time::UNIX_EPOCH.elapsed().map_or(0.0, |d| d.as_secs_f64()),
            |ns| ns * 1e-9,
        )
}
