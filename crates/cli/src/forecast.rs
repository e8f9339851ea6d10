//! What a run will take of memory and disk, before it is begun.
//!
//! ```text
//! memory ≤ max(reading the scene, scene + (T − 1) · session + 8 T · batch + 5 · part + 16 MB)
//!   scene    what is resident when the scene is read, cut and loaded into a backend, before the first row
//!   session  what each further thread has for itself: a copy of what the backend changes
//!   batch    rows a call of the backend × entries a row × 20 bytes
//!   part     rows of a part × entries a row × 8 bytes: one is filled, two wait, one is written and encoded
//! ```
//!
//! `docs/store.md` holds this against what runs took.

use hemicube::store::Form;
use std::path::Path;

/// What each further thread of the CPU backend has for itself: buffers of pixels, lists, and room that the allocator
/// keeps.
const SESSION: f64 = 12e6;
/// What is not counted elsewhere.
const REST: f64 = 16e6;
/// Parts that are in memory at once: one that is filled, two that wait, one that is written and its bytes.
const PARTS: f64 = 5.0;
/// Batches that are under way, by thread.
const BATCHES: f64 = 8.0;
/// An entry on its way: in the backend's rows and as column and factor.
const ENTRY: f64 = 20.0;

/// Rows, as a forecast needs them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rows {
    pub(crate) entries_per_row: f64,
    pub(crate) rows_per_part: u32,
    pub(crate) rows_per_batch: u32,
}

/// Bytes that a run comes to at most, when so many are resident before its first row.
pub(crate) fn memory(resident: u64, threads: usize, rows: Rows) -> u64 {
    let threads = threads.max(1) as f64;
    let batch = f64::from(rows.rows_per_batch.min(rows.rows_per_part)) * rows.entries_per_row * ENTRY;
    let part = f64::from(rows.rows_per_part) * rows.entries_per_row * 8.0;
    bytes(resident as f64 + (threads - 1.0) * SESSION + BATCHES * threads * batch + PARTS * part + REST)
}

/// The most threads, up to `threads`, with which a run keeps within `limit` bytes; `None` when one is too many.
pub(crate) fn threads_within(limit: u64, resident: u64, threads: usize, rows: Rows) -> Option<usize> {
    (1..=threads)
        .rev()
        .find(|&threads| memory(resident, threads, rows) <= limit)
}

/// Bytes that so many patches take at least: corners, tree and tables of a scene that was not cut (`docs/limits.md`).
pub(crate) fn patches_at_least(count: u64) -> u64 {
    count.saturating_mul(400)
}

/// Bytes that so many patches take at most until the first row: with what finds the triangles that they were cut from.
pub(crate) fn patches_at_most(count: u64) -> u64 {
    count.saturating_mul(1_400).saturating_add(20_000_000)
}

/// The memory that a run may take: what was asked for, otherwise what the machine has, in either case no more than the
/// process may have; `None` where nobody says.
pub(crate) fn memory_limit(asked: Option<u64>) -> Option<u64> {
    let least = |limits: &[Option<u64>]| limits.iter().flatten().copied().min();
    least(&[asked.or_else(free_memory), address_space()])
}

/// What the system would give: memory that is free or can be freed, and swap; no more than the group of processes may
/// have.
fn free_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let field = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()
    };
    let free = 1024 * (field("MemAvailable:")? + field("SwapFree:").unwrap_or(0));
    // `max` where there is no limit.
    let group = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok();
    let group = group.and_then(|text| text.trim().parse::<u64>().ok());
    Some(group.map_or(free, |group| group.min(free)))
}

/// The most memory that the process may have addresses for (`ulimit -v`), if there is a limit.
#[cfg(unix)]
fn address_space() -> Option<u64> {
    rustix::process::getrlimit(rustix::process::Resource::As).current
}

#[cfg(not(unix))]
fn address_space() -> Option<u64> {
    None
}

/// Bytes that rows take on the disk, to some percent.
pub(crate) fn disk(rows: u64, entries_per_row: f64, form: Form) -> u64 {
    let entry = match form {
        Form::Plain => 8.0,
        // From `docs/store.md`: between 2.1 and 2.6 in large scenes.
        Form::Compact => 2.6,
    };
    bytes(rows as f64 * (entries_per_row * entry + 60.0))
}

/// What the disk of a directory that is there has left, where the system tells.
pub(crate) fn available(directory: &Path) -> Option<u64> {
    fs4::available_space(directory).ok()
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "saturation is wanted"
)]
fn bytes(number: f64) -> u64 {
    number as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: Rows = Rows {
        entries_per_row: 4_500.0,
        rows_per_part: 1024,
        rows_per_batch: 64,
    };

    #[test]
    fn threads_are_as_many_as_fit() {
        let of = |threads| memory(500_000_000, threads, ROWS);
        assert!(of(1) < of(2) && of(2) < of(16));
        assert_eq!(threads_within(of(7), 500_000_000, 16, ROWS), Some(7));
        assert_eq!(threads_within(of(7) - 1, 500_000_000, 16, ROWS), Some(6));
        assert_eq!(threads_within(u64::MAX, 500_000_000, 16, ROWS), Some(16));
        assert_eq!(threads_within(of(1) - 1, 500_000_000, 16, ROWS), None);
    }

    #[test]
    fn the_compact_form_takes_a_third() {
        let [plain, compact] = [Form::Plain, Form::Compact].map(|form| disk(1_000_000, 4_000.0, form) as f64);
        assert!((0.3..0.4).contains(&(compact / plain)));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_system_tells_what_the_disk_has_left() {
        assert!(available(Path::new("/")).is_some());
    }
}
