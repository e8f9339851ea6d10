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

/// What each further thread of the CPU backend has for itself: buffers of pixels, lists, and room that the allocator keeps.
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
