//! Clocks for measurements: processor time, unaffected by other programs.

use std::sync::OnceLock;
use std::time::Instant;

/// Processor seconds of this thread; wall-clock seconds on systems without `/proc`.
pub(crate) fn thread_seconds() -> f64 {
    of_schedstat("/proc/thread-self/schedstat").unwrap_or_else(wall_seconds)
}

/// Processor seconds of all threads of this process: a graphics driver on the processor has its own.
pub(crate) fn process_seconds() -> f64 {
    let tasks = std::fs::read_dir("/proc/self/task").ok();
    tasks
        .map(|tasks| {
            tasks
                .flatten()
                .filter_map(|task| of_schedstat(task.path().join("schedstat")))
                .sum()
        })
        .filter(|&seconds| seconds > 0.0)
        .unwrap_or_else(wall_seconds)
}

/// Processor seconds of all threads that this process has had, ended ones too.
#[cfg(unix)]
pub(crate) fn processor_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    #[allow(clippy::cast_precision_loss, reason = "seconds of a process")]
    let seconds = time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9;
    seconds
}

/// Seconds of the wall clock, where no other is known.
#[cfg(not(unix))]
pub(crate) fn processor_seconds() -> f64 {
    wall_seconds()
}

/// Seconds since the program first asked.
pub(crate) fn wall_seconds() -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}

fn of_schedstat(path: impl AsRef<std::path::Path>) -> Option<f64> {
    let text = std::fs::read_to_string(path).ok()?;
    Some(text.split(' ').next()?.parse::<f64>().ok()? * 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_takes_time_and_sleep_does_not() {
        let (thread, process) = (thread_seconds(), process_seconds());
        let mut sum = 0u64;
        for k in 0..20_000_000u64 {
            sum = std::hint::black_box(sum.wrapping_mul(31) ^ k);
        }
        let worked = thread_seconds() - thread;
        assert!(worked > 0.0 && process_seconds() - process > 0.0, "{sum}");
        if cfg!(target_os = "linux") {
            let before = thread_seconds();
            std::thread::sleep(std::time::Duration::from_millis(60));
            assert!(thread_seconds() - before < 0.05);
        }
    }
}
